"""Points and features brought to another CRS by a coordinate operation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context, log
from toolbox.data.crs import metres_per_height, metres_per_unit, vertical_unit
from toolbox.data.las.points import Steps
from toolbox.data.operation import Operation, plane
from toolbox.data.pointcloud import PointCloud

if TYPE_CHECKING:
    from pyproj import CRS

    from toolbox.data.vector import Vector

DEGREE = 111_320.0
"""Metres of a degree of latitude, and the most that one of longitude has."""

_COARSEST = 1e-3  # metres: a step that loses no more than 0.5 mm
_ROUND = {True: 1.0, False: 1000.0}  # of offsets in degrees or lengths, the same for near tiles
_REACH = 2**31 - 1  # steps from the offset


def points(cloud: PointCloud, way: Operation, *, ctx: Context = QUIET) -> PointCloud:
    """The points in the target of an operation, with steps that suit it.

    LAS holds the coordinates that change in steps of a power of ten, at most half of the step of
    the source and at most 1 mm on the ground. Attributes whose description ends with the unit of
    the heights are brought to the new one.

    Raises
    ------
    DataError
        Points lie where the operation is not defined.
    """
    before = cloud.steps
    there = way.transform(cloud.xyz, ctx=ctx)
    there.flags.writeable = False  # so that it need not be copied
    moved = cloud.with_xyz(there).with_crs(way.target)
    return _in_unit(moved, way).with_steps(_steps(moved.xyz, before, way))


def features(layer: Vector, way: Operation) -> Vector:
    """The features in the target of an operation, vertex by vertex; heights where they have any.

    Raises
    ------
    DataError
        A vertex lies where the operation is not defined.
    """
    import shapely

    from toolbox.data.vector import Vector

    frame = layer.frame
    shapes = np.array(frame.geometry.array)
    upright = frame.has_z.to_numpy()
    for chosen, three in ((upright, True), (~upright, False)):
        shapes[chosen] = shapely.transform(shapes[chosen], way.transform, include_z=three)
    frame = frame.set_geometry(type(frame.geometry)(shapes, index=frame.index, crs=way.target))
    return Vector(frame, name=layer.name, geometry_type=layer.geometry_type)


def unit_of_plan(crs: CRS) -> float:
    """Metres of a unit of x and y; of degrees the most that one has."""
    flat = plane(crs)
    return (
        DEGREE * math.degrees(flat.axis_info[0].unit_conversion_factor)
        if (flat.is_geographic)
        else metres_per_unit(flat)
    )


def _steps(xyz: NDArray[np.float64], before: Steps | None, way: Operation) -> Steps:
    """Scales and offsets for coordinates in the target."""
    old = np.abs(before[0]) if before else np.full(3, _COARSEST)
    known = before is not None
    units = [(unit_of_plan(crs), metres_per_height(crs)) for crs in (way.source, way.target)]
    scales, offsets = [], []
    for axis in range(3):
        up = axis == 2
        if known and up and not way.moves_heights:
            scales.append(float(before[0][2]))  # type: ignore[index]
            offsets.append(float(before[1][2]))  # type: ignore[index]
            continue
        metres = min(old[axis] * units[0][up] / 2, _COARSEST)
        scale = 10.0 ** math.floor(math.log10(metres / units[1][up]) + 1e-9)
        scale, offset = _reaching(xyz[:, axis], scale, units[1][up] > 1000 and not up)
        scales.append(scale)
        offsets.append(offset)
    return tuple(scales), tuple(offsets)


def _reaching(values: NDArray[np.float64], scale: float, degrees: bool) -> tuple[float, float]:
    """The scale, or a coarser one where 32 bits do not reach all values from the offset."""
    if not len(values):
        return scale, 0.0
    low, high = float(values.min()), float(values.max())
    offset = math.floor(low / _ROUND[degrees]) * _ROUND[degrees]
    wanted = scale
    while high - offset > _REACH * scale:
        scale *= 10
    if scale != wanted:
        log.warning("coordinates from %.10g to %.10g need the coarser step %g", low, high, scale)
    return float(f"{scale:.0e}"), offset


def _in_unit(cloud: PointCloud, way: Operation) -> PointCloud:
    """The points, with attributes that are heights in the unit of the target."""
    old, new = vertical_unit(way.source), vertical_unit(way.target) or "metre"
    factor = metres_per_height(way.source) / metres_per_height(way.target)
    if factor == 1 or not old:
        return cloud
    texts = {n: t for n, t in cloud.descriptions.items() if t.endswith(f", {old}") and n in cloud}
    columns: dict[str, Any] = {
        name: (cloud[name] * factor).astype(_float_like(cloud[name])) for name in texts
    }
    said = {name: f"{text.removesuffix(old)}{new}" for name, text in texts.items()}
    return cloud.with_attributes(columns, descriptions=said)


def _float_like(values: NDArray[Any]) -> np.dtype[Any]:
    return values.dtype if values.dtype.kind == "f" else np.dtype("f8")
