"""Points in another version or point format of LAS; what would be lost is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from laspy import PointFormat
from laspy.header import Version
from laspy.point.dims import is_point_fmt_compatible_with_version
from numpy.typing import NDArray

from toolbox.data.las.crs import is_crs_vlr
from toolbox.data.las.header import LasMetadata, point_format, standard_names
from toolbox.data.las.points import SCAN_ANGLE, attribute, converted, put, with_crs
from toolbox.errors import DataError

Array = NDArray[Any]

VERSIONS = ("1.0", "1.1", "1.2", "1.3", "1.4")
"""Versions of LAS that are written."""

_FORMATS = {0: 1, 1: 1, 2: 3, 3: 5, 4: 10}  # the last point format of each version 1.x
_OLDER = {6: 1, 7: 3, 8: 3, 9: 4, 10: 5}  # formats with the same attributes before LAS 1.4
_REPLACED = {"scan_angle": "scan_angle_rank", "scan_angle_rank": "scan_angle"}


def recast(
    metadata: LasMetadata, minor: int, number: int
) -> tuple[LasMetadata, Callable[[Array], Array]]:
    """The metadata in LAS 1.`minor` and a point format, and what converts point records to it.

    Raises
    ------
    DataError
        The version does not have the format, or cannot hold the records behind the points; the
        converter raises it where an attribute that the format lacks is not zero in all points.
    """
    old = metadata.header.point_format
    if not is_point_fmt_compatible_with_version(number, f"1.{max(minor, 1)}"):
        raise DataError(f"LAS 1.{minor} has no point format {number}")
    if metadata.evlrs and minor < 4:
        raise DataError(f"LAS 1.{minor} has no records behind the points, and there are some")
    extras = [_params(extra) for extra in metadata.extras]
    header = metadata.header.copy()
    header.version = Version(1, 4)  # which has all formats; laspy compares the two
    header.point_format = point_format(number, extras, metadata.spare)
    header.version = Version(1, max(minor, 1))
    made = replace(metadata, header=header, minor=minor)
    unread = made.crs is None and any(map(is_crs_vlr, made.all_vlrs))  # kept as it is
    if not unread and (old.id < 6) != (number < 6):
        header.global_encoding.wkt = number >= 6
        made = with_crs(made, made.crs)
        if made.header.version.minor > max(minor, 1):
            raise DataError(f"LAS 1.{minor} cannot say the CRS, which has no EPSG code")
    new = header.point_format

    def convert(packed: Array) -> Array:
        if old.id == number:
            return packed
        _check_kept(packed, old, new)
        points = converted(packed, old, new, [n for n in _REPLACED if n in new.dimension_names])
        for name, source in _REPLACED.items():
            if name in new.dimension_names and name in standard_names(number):
                _put_angle(points, name, packed, old, source)
        found: Array = points.array
        return found

    return made, convert


def wanted(
    metadata: LasMetadata, version: str | None, number: int | None
) -> tuple[LasMetadata, Callable[[Array], Array]]:
    """As :func:`recast`, where one of the two may be left to the data.

    Of a version alone, the point format is the one with the same attributes that it has.

    Raises
    ------
    DataError
        As for :func:`recast`.
    """
    if version is None and number is None:
        return metadata, lambda packed: packed
    now = metadata.header.point_format.id
    minor = int(version[2:]) if version else None
    if number is None:
        number = now if minor is None or now <= _FORMATS[minor] else _OLDER.get(now, now)
    if minor is None:
        oldest = next(minor for minor, last in _FORMATS.items() if number <= last)
        minor = max(metadata.minor if now == number else oldest, oldest)
    return recast(metadata, minor, number)


def _params(extra: Any) -> Any:
    from laspy import ExtraBytesParams

    return ExtraBytesParams(extra.name, extra.dtype, extra.description, extra.offsets, extra.scales)


def _put_angle(points: Any, name: str, packed: Array, old: PointFormat, source: str) -> None:
    """Write the scan angle, in degrees before point format 6, and in steps of 0.006 from there."""
    if name in standard_names(old.id):
        put(points, name, attribute(old, packed, name))
    elif source in standard_names(old.id):
        values = attribute(old, packed, source).astype(float)
        factor = 1 / SCAN_ANGLE if name == "scan_angle" else SCAN_ANGLE
        put(points, name, np.rint(values * factor))


def _check_kept(packed: Array, old: PointFormat, new: PointFormat) -> None:
    """Raise a DataError if an attribute is lost that any point has, or a value does not fit."""
    lost = set(standard_names(old.id)) - set(standard_names(new.id)) - set(_REPLACED)
    lost = {name for name in lost if attribute(old, packed, name).any()}
    if lost:
        listed = ", ".join(sorted(lost))
        raise DataError(f"point format {new.id} has no {listed}, which the points have")
    for name in ("classification", "return_number", "number_of_returns"):
        values, most = attribute(old, packed, name), PointFormat(new.id)[name].max
        if len(values) and values.max() > most:
            text = f"point format {new.id} holds {name} up to {most}"
            raise DataError(f"{text}, and there is {values.max()}")
