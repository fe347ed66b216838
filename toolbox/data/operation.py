"""Coordinate operations: how coordinates go from one CRS to another, chosen and run with PROJ.

Nothing is guessed of heights: they change with an operation of PROJ or a geoid of the user, they
keep the height system that they have, or it is an error. An operation whose grid is not installed
is named, and never replaced by another one without being asked for.

References
----------
ISO 19111:2019, Referencing by coordinates: operations, accuracy, dynamic reference frames.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.crs import CompoundCRS
from pyproj.enums import TransformDirection
from pyproj.transformer import TransformerGroup

from toolbox.context import QUIET, Context, log
from toolbox.data.area_of_use import reaching_beyond
from toolbox.data.crs import (
    describe_crs,
    has_heights,
    is_local,
    length_problem,
    metres_per_height,
    metres_per_unit,
    same_crs,
    vertical_unit,
)
from toolbox.data.lattice import in_plan
from toolbox.errors import DataError

MissingGrid = Literal["refuse", "next_best"]
_BLOCK = 500_000  # points between two reports of progress, some tenths of a second
_TIME = re.compile(r"\bt_epoch=|\bproj=deformation\b|\bproj=velocity\b")  # needs a time

Floats = NDArray[np.float64]
Step = Callable[[Floats, bool], None]
"""Changes x, y and z, of shape (3, n), in place; the other way if asked to."""


@dataclass(frozen=True)
class Operation:
    """The way from one CRS to another.

    Attributes
    ----------
    source, target : CRS; that of the target has the heights of the source if it states none itself
    name : of the operation, as PROJ says it
    accuracy : metres, as its publisher states it; None if it is not known
    moves_heights : whether heights change
    steps : done one after the other
    """

    source: CRS
    target: CRS
    name: str
    accuracy: float | None
    moves_heights: bool
    steps: tuple[Step, ...]

    @property
    def accuracy_text(self) -> str:
        """The accuracy in words."""
        if self.accuracy is None:
            return "accuracy not known"
        return f"accuracy {self.accuracy:g} m" if self.accuracy else "exact"

    def __str__(self) -> str:
        return f"{self.name} ({self.accuracy_text})"

    def transform(
        self, xyz: Floats, *, back: bool = False, strict: bool = True, ctx: Context = QUIET
    ) -> Floats:
        """Bring coordinates of shape (n, 3) or (n, 2) to the target, or back to the source.

        Unless strict, coordinates where it is not defined become infinite.

        Raises
        ------
        DataError
            Coordinates lie where the operation is not defined.
        """
        found = np.empty(xyz.shape)
        count, axes = xyz.shape
        lost: list[NDArray[np.intp]] = []
        for start in range(0, count, _BLOCK):
            ctx.progress(start / count)
            rows = slice(start, min(start + _BLOCK, count))
            block = np.zeros((3, rows.stop - start))
            block[:axes] = xyz[rows].T
            for step in reversed(self.steps) if back else self.steps:
                step(block, back)
            found[rows] = block[:axes].T
            lost.append(start + np.flatnonzero(~np.isfinite(block.sum(axis=0))))
        ctx.progress(1.0)
        if strict and (number := sum(map(len, lost))):
            first = next(int(rows[0]) for rows in lost if len(rows))
            text = ", ".join(f"{value:.10g}" for value in xyz[first])
            raise DataError(
                f"{number} of {count} coordinates, such as {text}, lie where {self.name} is not "
                "defined"
            )
        return found


def operation(
    source: CRS | None,
    target: CRS,
    bounds: Sequence[float],
    *,
    heights: bool = True,
    geoid: str | Path | None = None,
    epoch: float | None = None,
    missing_grid: MissingGrid = "refuse",
) -> Operation:
    """Choose the best operation between two CRS for an area.

    Parameters
    ----------
    source : of the coordinates
    target : wanted; if it states no height system, heights keep theirs
    bounds : xmin, ymin, xmax, ymax of the coordinates, in the source
    heights : whether the coordinates have heights
    geoid : file of a geoid model (GeoTIFF or GTX, as PROJ reads it), between heights above the
        ellipsoid and those above the geoid; in place of what PROJ has for it
    epoch : of the coordinates, a year with decimals, for operations that depend on time
    missing_grid : whether an operation whose grids are installed may stand in for a better one

    Raises
    ------
    DataError
        There is no such operation, a grid for it is missing, it depends on time and no epoch is
        given, or one of the CRS does not say what its heights are measured from.

    Examples
    --------
    >>> way = operation(CRS(32635), CRS(32636), (500_000, 4_600_000, 500_100, 4_600_100))
    >>> way.transform(np.array([[500_000.0, 4_600_000.0, 12.0]])).round(2).tolist()
    [[-488.8, 4617415.98, 12.0]]
    >>> str(way)
    'Inverse of UTM zone 35N + UTM zone 36N (exact)'
    """
    if source is None:
        raise DataError("has no CRS; state it with assume_crs, or in the file: points.assign_crs")
    if is_local(source) or is_local(target):
        return _scaling(source, target)
    if beyond := reaching_beyond(source, target, in_plan(bounds)):
        log.warning("reprojecting: %s", beyond)
    area = _area(source, bounds)
    how = {"area": area, "epoch": epoch, "missing_grid": missing_grid}
    if not heights:
        return _in_plane(plane(source), plane(target), **how)
    if geoid is not None:
        return _by_geoid(source, target, Path(geoid), **how)
    if has_heights(target) and not has_heights(source):
        raise DataError(
            f"is in {describe_crs(source)}, which does not say what heights are measured from; say "
            "it with points.assign_crs --crs CODE+CODE (or CODE+ellipsoid) first"
        )
    if has_heights(source) and not has_heights(target):
        target = _with_heights_of(source, target)
    if _same_heights(source, target):
        found = _in_plane(plane(source), plane(target), **how)
        return _with_unit(replace(found, source=source, target=target))
    return _in_space(source, target, **how)


def plane(crs: CRS) -> CRS:
    """The horizontal component of a CRS in two dimensions, with what it states of WGS 84.

    >>> plane(CRS("EPSG:2154+5720")).to_epsg()
    2154
    """
    if crs.is_compound:
        return plane(crs.sub_crs_list[0])
    return crs.to_2d() if len(crs.axis_info) == 3 else crs


def _scaling(source: CRS, target: CRS) -> Operation:
    """Between local CRS in two units."""
    if not (is_local(source) and is_local(target)):
        local, other = (source, target) if is_local(source) else (target, source)
        text = f"there is no way between {describe_crs(local)} and {describe_crs(other)}"
        raise DataError(f"{text}, since a local CRS has no relation to the Earth")
    factor = metres_per_unit(source) / metres_per_unit(target)
    steps = (_factors(factor, factor),)
    name = f"factor {factor:.15g}"
    return Operation(source, target, name, 0.0, factor != 1, steps)


def _factors(across: float, up: float) -> Step:
    factors = np.array([[across], [across], [up]])

    def step(xyz: Floats, back: bool) -> None:
        xyz *= 1 / factors if back else factors

    return step


def _area(source: CRS, bounds: Sequence[float]) -> AreaOfInterest | None:
    """Longitudes and latitudes of bounds; None if they have none."""
    xmin, ymin, xmax, ymax = in_plan(bounds)
    flat = plane(source)
    flat = flat.source_crs if flat.is_bound and flat.source_crs else flat
    degrees = flat.geodetic_crs
    if degrees is None or not np.isfinite(bounds).all():
        return None
    x, y = (v.ravel() for v in np.meshgrid((xmin, xmax), (ymin, ymax)))
    to_degrees = Transformer.from_crs(flat, degrees.to_2d(), always_xy=True)
    east, north = to_degrees.transform(x, y)
    if not (np.isfinite(east).all() and np.isfinite(north).all() and np.abs(north).max() <= 90):
        return None
    east = (np.asarray(east) + 180) % 360 - 180
    return AreaOfInterest(east.min(), np.min(north), east.max(), np.max(north))


def _same_heights(source: CRS, target: CRS) -> bool:
    """Whether heights are measured from the same surface in the same unit, or neither says it."""
    one, other = ([*crs.sub_crs_list, None, None][1] for crs in (source, target))
    if one is None and other is None:
        return not has_heights(source) and not has_heights(target)
    return same_crs(one, other)


def _with_heights_of(source: CRS, target: CRS) -> CRS:
    """The target, with the height system of the source."""
    if not source.is_compound:
        return target.to_3d()
    vertical = source.sub_crs_list[1]
    made = CRS(CompoundCRS(f"{target.name} + {vertical.name}", [target, vertical]))
    if not target.is_geographic and (text := length_problem(made)):
        unit = vertical_unit(target)
        raise DataError(
            f"{text}; name a height system in {unit} behind a + of the CRS, such as "
            f"{target.to_string()}+5703"
        )
    return made


def _with_unit(found: Operation) -> Operation:
    """Heights of which no CRS says more are in the unit of the plan, before and after."""
    if has_heights(found.source):
        return found
    factor = metres_per_height(found.source) / metres_per_height(found.target)
    if factor == 1:
        return found
    steps = (*found.steps, _factors(1.0, factor))
    return replace(found, moves_heights=True, steps=steps)


def _in_plane(source: CRS, target: CRS, **how: Any) -> Operation:
    """The operation of x and y."""
    if same_crs(source, target):
        return Operation(source, target, "no change of x and y", 0.0, False, ())
    best, accuracy = _best(source, target, **how)
    return Operation(
        source, target, best.description, accuracy, False, (_step(best, 2, how["epoch"]),)
    )


def _in_space(source: CRS, target: CRS, **how: Any) -> Operation:
    """The operation of x, y and z."""
    best, accuracy = _best(source, target, **how)
    return Operation(
        source, target, best.description, accuracy, True, (_step(best, 3, how["epoch"]),)
    )


def _step(transformer: Any, axes: int, epoch: float | None) -> Step:
    """The step that PROJ does, in which only some axes change."""

    def step(xyz: Floats, back: bool) -> None:
        way = TransformDirection.INVERSE if back else TransformDirection.FORWARD
        given = [*xyz[:axes]]
        if epoch is not None:
            given = [*given, *np.zeros((3 - axes, xyz.shape[1])), np.full(xyz.shape[1], epoch)]
        transformer.transform(*given, direction=way, inplace=True)

    return step


def _best(
    source: CRS,
    target: CRS,
    *,
    area: Any,
    epoch: float | None,
    missing_grid: MissingGrid,
) -> tuple[Transformer, float | None]:
    """The best operation of PROJ, and its accuracy in metres."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the best operation is missing, which we say below
        group = TransformerGroup(
            source, target, always_xy=True, area_of_interest=area, allow_ballpark=False
        )
    ways = f"from {describe_crs(source)} to {describe_crs(target)}"
    if not group.transformers and not group.unavailable_operations:
        raise DataError(f"PROJ knows no operation {ways} there")
    lacking = _better(group)
    if lacking and (missing_grid == "refuse" or not group.transformers):
        raise DataError(_missing(lacking, group, ways))
    best = group.transformers[0]
    if epoch is None and _TIME.search(best.definition):
        raise DataError(
            f"the operation {ways} depends on time ({best.description}); say of which time the "
            "coordinates are: epoch, such as 2021.5"
        )
    return best, None if best.accuracy < 0 else float(best.accuracy)


def _better(group: TransformerGroup) -> Any:
    """The best operation whose grids are missing, if it is better than those that are there."""
    if group.best_available or not group.unavailable_operations:
        return None
    first = group.unavailable_operations[0]
    there = [_spread(found.accuracy) for found in group.transformers[:1]]
    return first if not there or _spread(first.accuracy) < there[0] else None


def _spread(accuracy: float) -> float:
    return math.inf if accuracy < 0 else accuracy


def _missing(lacking: Any, group: TransformerGroup, ways: str) -> str:
    """Say which grids are missing, and what can be done."""
    grids = [grid.short_name for grid in lacking.grids if not grid.available]
    text = (
        f"the best operation {ways} ({lacking.name}, accuracy {lacking.accuracy:g} m) needs "
        f"{', '.join(grids)}, which PROJ does not have here; fetch it with "
        f"'{' && '.join(f'pyproj sync --file {grid}' for grid in grids)}'"
    )
    if group.transformers:
        other = group.transformers[0]
        known = f"accuracy {other.accuracy:g} m" if other.accuracy >= 0 else "accuracy not known"
        text += (
            f", or take the next best, {other.description} ({known}), with missing_grid next_best"
        )
    else:
        text += ", or give a geoid model of your own with geoid"
    return text


def _by_geoid(source: CRS, target: CRS, geoid: Path, **how: Any) -> Operation:
    """Heights above the ellipsoid and above a geoid, of which a file gives the undulation."""
    upward = _is_gravity(source)
    if not has_heights(target):
        raise DataError(
            f"geoid: {describe_crs(target)} does not say what heights are measured from; give "
            "CODE+CODE for heights above a geoid, or CODE+ellipsoid"
        )
    if not has_heights(source) or upward == _is_gravity(target):
        raise DataError(
            "geoid: leads between heights above the ellipsoid (CODE+ellipsoid) and above a geoid "
            f"(CODE+CODE), and these are {describe_crs(source)} and {describe_crs(target)}"
        )
    high, flat = (source, plane(source)) if upward else (target, plane(target))
    shift = _undulation(geoid, flat, 1 / metres_per_height(high), 1 if upward else -1)
    unit = _factors(1.0, metres_per_height(high) / metres_per_height(flat.to_3d()))
    if upward:
        solid = flat.to_3d()
        rest = _in_space(solid, target, **how) if not same_crs(solid, target) else None
        steps = (shift, unit, *(rest.steps if rest else ()))
    else:
        solid = flat.to_3d()
        rest = _in_space(source, solid, **how) if not same_crs(source, solid) else None
        steps = (*(rest.steps if rest else ()), _reversed(unit), shift)
    name = " + ".join(filter(None, [rest.name if rest else "", f"geoid {geoid.name}"]))
    return Operation(source, target, name, None, True, steps)


def _is_gravity(crs: CRS) -> bool:
    return bool(crs.is_compound)


def _reversed(step: Step) -> Step:
    return lambda xyz, back: step(xyz, not back)


def _undulation(geoid: Path, flat: CRS, unit: float, sign: int) -> Step:
    """Add `sign` times the undulation, given in metres, to heights of which `unit` make a metre."""
    if not geoid.is_file():
        raise DataError(f"geoid: there is no file {geoid}")
    horizontal = flat.source_crs if flat.is_bound and flat.source_crs else flat
    geodetic: Any = horizontal.geodetic_crs
    to_degrees = Transformer.from_crs(horizontal, geodetic.to_2d(), always_xy=True)
    degrees = "step proj=unitconvert xy_in={} xy_out={} "
    try:
        grid = Transformer.from_pipeline(
            "proj=pipeline "
            + degrees.format("deg", "rad")
            + f'step proj=vgridshift grids="{geoid.resolve()}" multiplier=1 '
            + degrees.format("rad", "deg")
        )
    except Exception as error:
        raise DataError(f"geoid: PROJ cannot read {geoid}: {error}") from error

    def step(xyz: Floats, back: bool) -> None:
        east, north = to_degrees.transform(xyz[0], xyz[1])
        *_, undulation = grid.transform(east, north, np.zeros(len(east)))
        xyz[2] += (-sign if back else sign) * unit * np.asarray(undulation)

    return step
