"""Joining point clouds: the layout that suits all of them, and their points in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from toolbox.context import log
from toolbox.data.cloud.arrays import frozen, plain
from toolbox.data.crs import crs_conflicts
from toolbox.data.las.joint import in_layout, joint_metadata, named
from toolbox.data.las.points import WEEK, Box, box_of
from toolbox.errors import DataError

if TYPE_CHECKING:
    from toolbox.data.pointcloud import PointCloud


def template(clouds: Sequence[PointCloud], boxes: Callable[[], Sequence[Box]]) -> PointCloud:
    """See :meth:`PointCloud.template`."""
    if problems := crs_conflicts([(cloud.name, cloud.crs) for cloud in clouds]):
        raise DataError("\n    ".join(problems))
    first = clouds[0].select([])
    names = [cloud.name for cloud in clouds]
    members = [cloud._metadata for cloud in clouds if cloud._metadata is not None]
    if len(members) == len(clouds):
        columns = dict.fromkeys(name for cloud in clouds for name in cloud._columns)
        first._metadata = joint_metadata(members, names, boxes, columns)
        first._packed = frozen(np.empty(0, first._metadata.header.point_format.dtype()))
    else:
        first._metadata = first._packed = None
        columns = dict.fromkeys(name for cloud in clouds for name in cloud.names)
        _check_same_attributes(clouds, columns)
    first._columns = {name: _common_column(clouds, name) for name in columns}
    first._descriptions = {
        name: text for cloud in reversed(clouds) for name, text in cloud._descriptions.items()
    }
    first._moved = any(cloud._moved for cloud in clouds)
    first._xyz = frozen(np.empty((0, 3)))
    first.name = _joint_name(names)
    return first


def like(cloud: PointCloud, template: PointCloud) -> PointCloud:
    """See :meth:`PointCloud.like`."""
    if template._metadata is not None and cloud._metadata is None:
        raise DataError(f"{cloud.name} has no LAS records to join with those of others")
    made = cloud._copy()
    made.__dict__.update(
        _metadata=template._metadata, _descriptions=template._descriptions, crs=template.crs
    )
    made._columns = {
        name: _column_like(cloud, name, values) for name, values in template._columns.items()
    }
    keeps = template._moved or template._metadata is None
    made._xyz, made._moved = cloud.xyz if keeps else None, template._moved
    made._places = None
    if cloud._metadata is None or cloud._packed is None or template._metadata is None:
        made._packed = None
        return made
    try:
        made._packed = frozen(in_layout(cloud._metadata, cloud._packed, template._metadata))
    except DataError as error:
        raise DataError(f"{cloud.name} {error}") from error
    return made


def _column_like(cloud: PointCloud, name: str, values: NDArray[Any]) -> NDArray[Any]:
    """An attribute of a cloud in the type of `values`; 0 if it has none."""
    if name in cloud:
        return frozen(cloud[name].astype(values.dtype, copy=False))
    return frozen(np.zeros((len(cloud), *values.shape[1:]), values.dtype))


def filled(template: PointCloud, clouds: Iterable[PointCloud], size: int) -> PointCloud:
    """See :meth:`PointCloud.filled`."""
    whole = {n: np.empty((size, *a.shape[1:]), a.dtype) for n, a in template.arrays().items()}
    start = 0
    for cloud in clouds:
        rows = slice(start, start := start + len(cloud))
        for name, array in cloud.arrays().items():
            plain(whole[name])[rows] = plain(array)
    if start != size:
        raise DataError(f"{template.name} holds {start} points, and {size} were expected")
    return template.with_arrays({name: frozen(array) for name, array in whole.items()})


def boxes_of(clouds: Sequence[PointCloud]) -> list[Box]:
    """Lowest and highest coordinates of each cloud from LAS that has points."""
    return [
        box_of(cloud._metadata.header, cloud._packed)
        for cloud in clouds
        if cloud._metadata is not None and cloud._packed is not None and len(cloud)
    ]


def warn_of_clocks(clouds: Sequence[PointCloud], some: Callable[[], Sequence[PointCloud]]) -> None:
    """Tell of GPS times that count from another day than those of the first cloud, or seem to.

    Parameters
    ----------
    clouds : all that will be joined, with or without their points
    some : gives a few points of each that has any; asked if headers differ
    """
    if len(set(filter(None, map(_clock, clouds)))) < 2:
        return
    first, other, wrong = "", [], []
    for cloud in some():
        clock = _clock(cloud)
        if clock == "week" and (np.abs(cloud["gps_time"]) > WEEK).any():
            clock = "standard"
            wrong.append(cloud.name)
        first = first or clock
        if clock and clock != first:
            other.append(cloud.name)
    if other:
        log.warning("%s: GPS times count from another day than those of the first", named(other))
    if wrong:
        log.warning(
            "%s: the header calls GPS times seconds of the week, for which they are too large: "
            "they count as standard times",
            named(wrong),
        )


def _clock(cloud: PointCloud) -> str:
    """What GPS times are as the header says: standard, of the week, or "" without any."""
    if cloud._metadata is None or "gps_time" not in cloud:
        return ""
    return "standard" if cloud._metadata.header.global_encoding.gps_time_type else "week"


def _check_same_attributes(clouds: Sequence[PointCloud], names: Iterable[str]) -> None:
    """Raise a DataError unless all clouds have all of these attributes."""
    problems = []
    for cloud in clouds:
        if lacking := [name for name in names if name not in cloud]:
            having = next(other for other in clouds if lacking[0] in other)
            listed = ", ".join(lacking)
            problems.append(f"{cloud.name} has no attribute {listed}, which {having.name} has")
    if problems:
        raise DataError("\n    ".join(problems))


def _common_column(clouds: Sequence[PointCloud], name: str) -> NDArray[Any]:
    """An array of no points in the type that holds an attribute of all clouds."""
    having = [cloud.select([])[name] for cloud in clouds if name in cloud]
    if len({values.shape for values in having}) > 1:
        raise DataError(f"attribute {name!r} has not the same number of elements in all files")
    if lacking := [cloud.name for cloud in clouds if name not in cloud]:
        log.warning("%s: has no %s; it is 0 there", ", ".join(lacking), name)
    return frozen(np.empty(having[0].shape, np.result_type(*having)))


def _joint_name(names: Sequence[str]) -> str:
    """The name of joined clouds: that of the first, and how many others there are."""
    distinct = dict.fromkeys(names)
    more = f" and {len(distinct) - 1} more" if len(distinct) > 1 else ""
    return f"{names[0]}{more}"
