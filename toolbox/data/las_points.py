"""What the packed point records of a LAS file say, and how to change it without loss."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.data.crs import same_crs
from toolbox.data.las_crs import WKT_BIT, crs_records, is_crs_record
from toolbox.data.las_header import (
    SIZES,
    Extra,
    Frame,
    Header,
    Layout,
    Record,
    standard_names,
)
from toolbox.errors import DataError

log = logging.getLogger("toolbox")

Array = NDArray[Any]

STANDARD = frozenset(name for number in range(11) for name in standard_names(number))
"""Attributes that some LAS point format has."""

SCAN_ANGLE = 0.006  # degrees per step of scan_angle in point formats 6-10
_BLOCK = 65_536  # points whose coordinates stay in the cache
_EXTRA_BYTES = ("LASF_Spec", 4)
_MINOR = (0, 0, 2, 2, 3, 3, 4, 4, 4, 4, 4)  # first LAS 1.x that knows a point format
_WEEK = 604_800  # seconds; larger GPS times are not times of the week


def coordinates(header: Header, record: Array) -> NDArray[np.float64]:
    """x, y, z of shape (n, 3) in the unit of the CRS: integer times scale plus offset."""
    xyz = np.empty((len(record), 3))
    for start in range(0, len(record), _BLOCK):
        block, part = record[start : start + _BLOCK], xyz[start : start + _BLOCK]
        for axis, name in enumerate("XYZ"):
            np.multiply(block[name], header.scales[axis], out=part[:, axis])
        part += header.offsets
    return xyz


def attribute(layout: Layout, record: Array, name: str) -> Array:
    """One attribute of n points; (n, k) for an extra-byte dimension of k elements."""
    if name in layout.bits:
        field, first, count = layout.bits[name]
        found: Array = (record[field] >> first) & np.uint8((1 << count) - 1)
        return found
    extra = layout.extra(name)
    values = np.ascontiguousarray(record[name])
    if extra is None or extra.scale is None or extra.offset is None:
        return values
    return np.asarray(values * extra.scale + extra.offset).reshape(values.shape)


def quantised(xyz: NDArray[np.float64], header: Header) -> tuple[Header, NDArray[np.int32]]:
    """Coordinates as integers, with the scale of the header, and its offset where possible.

    Raises
    ------
    DataError
        A coordinate is not finite, or the points reach too far for 32 bits at this scale.
    """
    integers = np.empty(xyz.shape, np.int32)
    offsets = header.offsets.copy()
    for axis, name in enumerate("xyz"):
        values, scale = xyz[:, axis], header.scales[axis]
        bad = ~np.isfinite(values)
        if bad.any():
            raise DataError(f"{name} of point {int(np.argmax(bad))} is {values[bad][0]}")
        steps = np.rint((values - offsets[axis]) / scale)
        if _too_far(steps):
            offsets[axis] = np.floor((values.min() + values.max()) / 2)
            log.info("%s needs the new offset %s in the LAS file", name, offsets[axis])
            steps = np.rint((values - offsets[axis]) / scale)
        if _too_far(steps):
            raise DataError(
                f"{name} reaches from {values.min()} to {values.max()}, which LAS cannot hold in "
                f"steps of {scale:g}"
            )
        integers[:, axis] = steps
    return header.patched((155, "<3d", tuple(offsets))), integers


def _too_far(steps: NDArray[np.float64]) -> bool:
    limits = np.iinfo(np.int32)
    return len(steps) > 0 and bool(steps.min() < limits.min or steps.max() > limits.max)


def new_frame(xyz: NDArray[np.float64], columns: Mapping[str, Array]) -> tuple[Frame, Array]:
    """LAS 1.4 for points that come from elsewhere, and their records, still without content.

    The scale is the coarsest power of ten from 0.01 to 1e-6 that reproduces the coordinates, or
    0.0001 if none does; the offset is the rounded minimum. The date is left at zero, so that the
    same points always give the same file. Points without return numbers count as return 1 of 1.
    """
    offsets = np.floor(xyz.min(axis=0)) if len(xyz) else np.zeros(3)
    offsets[~np.isfinite(offsets)] = 0  # what is not finite is refused with the coordinates
    header = Header(b"LASF" + bytes(20) + b"\x01\x04" + bytes(SIZES[4] - 26))
    times = columns.get("gps_time")
    absolute = times is not None and len(times) > 0 and np.nanmax(times) > _WEEK
    software = b"lidar-toolbox"
    layout = Layout(
        8 if "nir" in columns else 7 if columns.keys() & {"red", "green", "blue"} else 6
    )
    header = header.patched(
        (6, "<H", (WKT_BIT | absolute,)),
        (26, "<32s32s", (software, software)),
        (94, "<H", (SIZES[4],)),
        (104, "<BH", (layout.point_format, layout.dtype.itemsize)),
        (131, "<6d", (*_scales(xyz), *offsets)),
    )
    record = np.zeros(len(xyz), layout.dtype)
    if "return_number" not in columns and "number_of_returns" not in columns:
        record["_returns"] = 0x11
    return Frame(header, layout), record


def decimals(values: NDArray[np.float64]) -> int | None:
    """Fewest decimals, from 2 to 6, that reproduce all values; None if no number of them does."""
    if not np.isfinite(values).all():
        return None
    near = 4 * np.spacing(np.abs(values).max(initial=1.0))
    for count in range(2, 7):
        if np.allclose(np.round(values, count), values, rtol=0, atol=near):
            return count
    return None


def step_decimals(scale: float, offset: float) -> int | None:
    """Decimals of all multiples of the scale plus the offset; None if more than twelve."""
    exponents = [
        Decimal(repr(float(value))).normalize().as_tuple().exponent for value in (scale, offset)
    ]
    count = max(0, *(-int(exponent) for exponent in exponents))
    return count if count <= 12 else None


def _scales(xyz: NDArray[np.float64]) -> list[float]:
    found = [decimals(xyz[:, axis]) for axis in range(3)]
    if None in found:
        log.info("coordinates are rounded to 0.0001 in the LAS file")
    return [10.0 ** -(4 if count is None else count) for count in found]


def revised(
    frame: Frame,
    record: Array,
    *,
    xyz: NDArray[np.float64] | None,
    columns: Mapping[str, Array],
    descriptions: Mapping[str, str],
    crs: CRS | None,
) -> tuple[Frame, Array]:
    """Frame and records with changes; what is not changed stays as it is, bit for bit.

    Parameters
    ----------
    frame, record : as read, or from :func:`new_frame`
    xyz : changed coordinates, or None
    columns : changed and new attributes; what the point format lacks becomes extra bytes, or
        leads to the point format that has it
    descriptions : of new extra bytes
    crs : of the points; its records are written anew if it is not the one that was read

    Raises
    ------
    DataError
        A value does not fit in its LAS field, or LAS has no type for an attribute.
    """
    before = frame.layout.point_format
    if columns:
        frame, record = _with_columns(frame, record, dict(columns), descriptions)
    if xyz is not None:
        header, integers = quantised(xyz, frame.header)
        frame = replace(frame, header=header)
        record = record if columns else record.copy()
        for axis, name in enumerate("XYZ"):
            record[name] = integers[:, axis]
    upgraded = before < 6 <= frame.layout.point_format and crs is not None
    if upgraded or not same_crs(crs, frame.crs):
        frame = _with_crs(frame, crs)
    return frame, record


def _with_crs(frame: Frame, crs: CRS | None) -> Frame:
    header = frame.header
    before = bool(header.encoding & WKT_BIT)
    records, wkt = crs_records(crs, frame.layout.point_format, wkt=before)
    encoding = header.encoding & ~WKT_BIT | WKT_BIT * wkt
    if wkt:
        header = header.with_minor(4)
    frame = replace(frame.without(is_crs_record), header=header.patched((6, "<H", (encoding,))))
    return replace(frame, vlrs=frame.vlrs + records, crs=crs)


def _with_columns(
    frame: Frame, record: Array, columns: dict[str, Array], descriptions: Mapping[str, str]
) -> tuple[Frame, Array]:
    old = frame.layout
    number = _point_format(old, record, columns)
    for name in set(standard_names(number)) - set(old.standard):
        if old.extra(name) and name not in columns:  # e.g. nir, so far in extra bytes
            columns[name] = attribute(old, record, name)
    if number >= 6 and "scan_angle_rank" in columns:
        columns.setdefault("scan_angle", _steps(columns.pop("scan_angle_rank")))
    layout = Layout(number, _extras(old, number, columns, descriptions), old.spare)
    record = _converted(record, old, layout)
    for name, values in columns.items():
        _put(layout, record, name, values)
    return _with_layout(frame, layout), record


def _point_format(layout: Layout, record: Array, columns: Mapping[str, Array]) -> int:
    """The first point format with all that is needed, beginning with the present one."""
    present = layout.point_format
    extras = {extra.name for extra in layout.extras}
    needed = set(layout.standard) | (columns.keys() & STANDARD - extras)
    small = all(_below(columns, name, limit) for name, limit in _OLD_LIMITS.items())
    old = range(6) if present < 6 and small else range(0)
    first = [present] if small or present >= 6 else []
    choices: list[int] = [*first, *old, *range(6, 11)]
    for number in choices:
        spoken = needed if number < 6 else {_modern(name) for name in needed}
        if spoken <= set(standard_names(number)):
            return number
    raise DataError(f"no LAS point format has all of {', '.join(sorted(needed))}")


_OLD_LIMITS = {"classification": 31, "return_number": 7, "number_of_returns": 7}


def _below(columns: Mapping[str, Array], name: str, limit: int) -> bool:
    return name not in columns or not (columns[name] > limit).any()


def _modern(name: str) -> str:
    return "scan_angle" if name == "scan_angle_rank" else name


def _extras(
    old: Layout, number: int, columns: Mapping[str, Array], descriptions: Mapping[str, str]
) -> tuple[Extra, ...]:
    """Extra bytes: those of the file that stay, those that change their type, the new ones."""
    standard = standard_names(number)
    extras = []
    for extra in old.extras:
        if extra.name not in columns:
            extras.append(extra)
        elif extra.name not in standard:
            dtype = _column_dtype(columns[extra.name])
            text = descriptions.get(extra.name, extra.description)
            extras.append(Extra.make(extra.name, dtype, text))
    known = {*standard, *(extra.name for extra in extras)}
    for name in columns.keys() - known:
        extras.append(Extra.make(name, _column_dtype(columns[name]), descriptions.get(name, "")))
    order = [*(extra.name for extra in old.extras), *columns]
    return tuple(sorted(extras, key=lambda extra: order.index(extra.name)))


def _column_dtype(values: Array) -> np.dtype[Any]:
    return np.dtype((values.dtype, values.shape[1:])) if values.ndim > 1 else values.dtype


def _converted(record: Array, old: Layout, new: Layout) -> Array:
    """The records in another layout, or a copy if it is the same."""
    if old.dtype == new.dtype and old.point_format == new.point_format:
        return record.copy()
    result = np.zeros(len(record), new.dtype)
    for field in set(old.dtype.names or ()) & set(new.dtype.names or ()):
        if field[0] != "_" and old.dtype[field] == new.dtype[field]:
            result[field] = record[field]
    if old.spare:
        result["_spare"] = record["_spare"]
    for name in old.standard:
        if name in new.bits or name in old.bits:
            _put(new, result, name, attribute(old, record, name))
    if "scan_angle_rank" in old.standard and "scan_angle" in new.standard:
        _put(new, result, "scan_angle", _steps(record["scan_angle_rank"]))
    return result


def _steps(degrees: Array) -> NDArray[np.float64]:
    """Scan angles as point formats 6-10 have them."""
    return np.asarray(np.rint(degrees / SCAN_ANGLE), np.float64)


def _put(layout: Layout, record: Array, name: str, values: Array) -> None:
    """Write an attribute into the records, or say why its values do not fit."""
    if name in layout.bits:
        field, first, count = layout.bits[name]
        _check_fit(name, values, 0, (1 << count) - 1)
        mask = np.uint8(((1 << count) - 1) << first)
        record[field] = (record[field] & ~mask) | (values.astype(np.uint8) << first)
        return
    dtype = layout.dtype[name].base
    if dtype.kind in "iu":
        _check_fit(name, values, np.iinfo(dtype).min, np.iinfo(dtype).max)
    record[name] = values


def _check_fit(name: str, values: Array, low: int, high: int) -> None:
    if values.dtype.kind == "b" or len(values) == 0:
        return
    bad = (values < low) | (values > high)
    if values.dtype.kind == "f":
        bad |= values != np.rint(values)  # also NaN
    if bad.any():
        raise DataError(
            f"{name} has the value {values[bad][0]}, and LAS holds whole numbers from {low} to "
            f"{high} there"
        )


def _with_layout(frame: Frame, layout: Layout) -> Frame:
    old, header = frame.layout, frame.header
    if layout.point_format != old.point_format:
        header = header.with_minor(_MINOR[layout.point_format])
        log.info(
            "written as LAS 1.%s point format %s instead of %s, which cannot hold the attributes",
            header.minor,
            layout.point_format,
            old.point_format,
        )
    header = header.patched((104, "<BH", (layout.point_format, layout.dtype.itemsize)))
    vlrs = frame.vlrs
    if layout.description != old.description:
        frame = frame.without(lambda record: record.key == _EXTRA_BYTES)
        described = Record.make(*_EXTRA_BYTES, "Extra bytes", layout.description)
        vlrs = frame.vlrs + ((described,) if layout.extras else ())
    return replace(frame, header=header, layout=layout, vlrs=vlrs)
