"""Packed point records of LAS files: reading their attributes, and changing them without loss."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np
from laspy import ExtraBytesParams, LasHeader, PackedPointRecord, PointFormat
from laspy.errors import UnknownExtraType
from laspy.extradims import get_id_for_extra_dim_type
from laspy.point.dims import DimensionInfo
from laspy.vlrs.known import ExtraBytesStruct
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.context import log
from toolbox.data.crs import same_crs
from toolbox.data.las.crs import crs_vlrs, is_crs_vlr
from toolbox.data.las.header import (
    DESCRIPTOR,
    EXTRA_BYTES,
    LasMetadata,
    Vlr,
    oldest_version,
    point_format,
    standard_names,
)
from toolbox.errors import DataError

Array = NDArray[Any]

Box = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lowest and highest coordinates, each of shape (3,)."""

Steps = tuple[tuple[float, ...], tuple[float, ...]]
"""Scales of x, y and z, and their offsets."""

STANDARD = frozenset(name for number in range(11) for name in standard_names(number))
"""Attributes that some LAS point format has."""

MIXED_WAVEFORMS = "lazrs does not keep the wave packets of several scanner channels in LAZ"
"""Why LAZ spoils a file in which :func:`waveform_channels` finds more than one (lazrs 0.8)."""

MOST_INTENSE = 65_535  # intensity of LAS, of 16 bits
LEAST_RANGE = 100  # of intensities that may be rounded: a hundredth of it is as much as is lost
SCAN_ANGLE = 0.006  # degrees per step of scan_angle in point formats 6-10
WEEK = 604_800  # seconds; larger GPS times are not times of the week


def coordinates(header: LasHeader, packed: Array) -> NDArray[np.float64]:
    """x, y, z of shape (n, 3) in the unit of the CRS: integer times scale plus offset."""
    xyz = np.empty((len(packed), 3))
    for axis, name in enumerate("XYZ"):
        np.multiply(packed[name], header.scales[axis], out=xyz[:, axis])
    xyz += header.offsets
    return xyz


def axes_of(header: LasHeader, packed: Array, names: str = "XYZ") -> NDArray[np.float64]:
    """The same coordinates axis by axis, of shape (3, n), or of some axes only."""
    axes = np.empty((len(names), len(packed)))
    for k, name in enumerate(names):
        axis = "XYZ".index(name)
        np.multiply(packed[name], header.scales[axis], out=axes[k])
        axes[k] += header.offsets[axis]
    return axes


def box_of(header: LasHeader, packed: Array) -> Box:
    """Lowest and highest coordinates of at least one point."""
    limits = np.array([[packed[axis].min(), packed[axis].max()] for axis in "XYZ"], float)
    low, high = np.sort(limits.T * header.scales + header.offsets, axis=0)
    return low, high


def attribute(layout: PointFormat, packed: Array, name: str) -> Array:
    """One attribute of n points; (n, k) for an extra-byte dimension of k elements."""
    dimension = layout.dimension_by_name(name)
    if dimension.is_standard:
        return np.ascontiguousarray(PackedPointRecord(packed, layout)[name])
    values = np.ascontiguousarray(packed[name])
    return values * dimension.scales + dimension.offsets if dimension.is_scaled else values


def waveform_channels(metadata: LasMetadata, packed: Array) -> set[int]:
    """The scanner channels of the points that have waveform packets."""
    if metadata.header.point_format.id not in (9, 10):
        return set()
    channels = attribute(metadata.header.point_format, packed, "scanner_channel")
    return set(np.unique(channels).tolist())


def quantised(
    xyz: NDArray[np.float64], header: LasHeader
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Offsets and integer coordinates for a LAS file; offsets of the header stay where possible.

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
    return offsets, integers


def _too_far(steps: NDArray[np.float64]) -> bool:
    limits = np.iinfo(np.int32)
    return len(steps) > 0 and bool(steps.min() < limits.min or steps.max() > limits.max)


def new_metadata(
    xyz: NDArray[np.float64], columns: Mapping[str, Array], steps: Steps | None = None
) -> tuple[LasMetadata, Array]:
    """LAS 1.4 metadata for points that come from elsewhere, and point records of zeros.

    The scale is the coarsest power of ten from 0.01 to 1e-6 that reproduces the coordinates, or
    0.0001 if none does, and the offset the rounded minimum, unless `steps` gives both. The date is
    left at zero, so that the same points always give the same file. Points without return numbers
    count as return 1 of 1.
    """
    number = 8 if "nir" in columns else 7 if columns.keys() & {"red", "green", "blue"} else 6
    header = LasHeader(version="1.4", point_format=number)
    if steps is None:
        header.scales = np.array(_scales(xyz))
        header.offsets = np.floor(xyz.min(axis=0)) if len(xyz) else np.zeros(3)
    else:
        header.scales, header.offsets = map(np.array, steps)
    header.offsets[~np.isfinite(header.offsets)] = 0  # refused with the coordinates
    times = columns.get("gps_time")
    absolute = times is not None and len(times) > 0 and np.nanmax(times) > WEEK
    header.global_encoding.wkt, header.global_encoding.gps_time_type = True, int(absolute)
    points = PackedPointRecord.zeros(len(xyz), header.point_format)
    if "return_number" not in columns and "number_of_returns" not in columns:
        points.array["bit_fields"] = 0x11
    software = b"lidar-toolbox".ljust(32, b"\0")
    return LasMetadata(header, 4, software + software + bytes(4)), points.array


def decimals(values: NDArray[np.float64]) -> int | None:
    """Fewest decimals, from 2 to 6, that write all values without loss; None if 6 are too few."""
    if not np.isfinite(values).all():
        return None
    near = 4 * np.spacing(np.abs(values).max(initial=1.0))
    for count in range(2, 7):
        if np.allclose(np.round(values, count), values, rtol=0, atol=near):
            return count
    return None


def step_decimals(scale: float, offset: float) -> int | None:
    """Decimals that coordinates of this scale and offset have; None if more than twelve."""
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
    metadata: LasMetadata,
    packed: Array,
    *,
    xyz: NDArray[np.float64] | None,
    columns: Mapping[str, Array],
    descriptions: Mapping[str, str],
    crs: CRS | None,
) -> tuple[LasMetadata, Array]:
    """Metadata and point records with changes; all else stays the same, bit for bit.

    Parameters
    ----------
    metadata, packed : as read, or from :func:`new_metadata`
    xyz : changed coordinates, or None
    columns : changed and new attributes; what the point format lacks becomes extra bytes, or
        leads to the point format that has it
    descriptions : of new extra bytes
    crs : of the points; its VLRs are written anew if it is not the one that was read

    Raises
    ------
    DataError
        A value does not fit in its LAS field, or LAS has no type for an attribute.
    """
    before = metadata.header.point_format.id
    metadata = replace(metadata, header=metadata.header.copy())
    if columns:
        metadata, packed = _with_columns(metadata, packed, dict(columns), descriptions)
    if xyz is not None:
        metadata.header.offsets, integers = quantised(xyz, metadata.header)
        packed = packed if columns else packed.copy()
        for axis, name in enumerate("XYZ"):
            packed[name] = integers[:, axis]
    upgraded = before < 6 <= metadata.header.point_format.id
    unread = crs is None and any(map(is_crs_vlr, metadata.all_vlrs))  # kept as it is
    if not same_crs(crs, metadata.crs) or (upgraded and not unread):
        metadata = with_crs(metadata, crs)
    return metadata, packed


def with_crs(metadata: LasMetadata, crs: CRS | None) -> LasMetadata:
    encoding, number = metadata.header.global_encoding, metadata.header.point_format.id
    vlrs, encoding.wkt = crs_vlrs(crs, number, wkt=encoding.wkt)
    if encoding.wkt:
        metadata.header.version = oldest_version(4, number)
    metadata = metadata.without(is_crs_vlr)
    return replace(metadata, vlrs=metadata.vlrs + vlrs, crs=crs)


def _with_columns(
    metadata: LasMetadata, packed: Array, columns: dict[str, Array], descriptions: Mapping[str, str]
) -> tuple[LasMetadata, Array]:
    header, old = metadata.header, metadata.header.point_format
    number = _number(metadata, columns)
    known = {dimension.name for dimension in metadata.extras} - columns.keys()
    for name in known & set(standard_names(number)):  # e.g. nir, so far in extra bytes
        columns[name] = attribute(old, packed, name)
    if number >= 6 and "scan_angle_rank" in columns:
        columns.setdefault("scan_angle", _steps(columns.pop("scan_angle_rank")))
    extras = _extras(metadata, number, columns, descriptions)
    new = point_format(number, extras, metadata.spare)
    points = _lengthened(packed, new)
    if points is None:
        points = converted(packed, old, new, columns)
    for name, values in columns.items():
        put(points, name, values)
    if number != old.id:
        header.version = oldest_version(header.version.minor, number)
        metadata = replace(metadata, minor=header.version.minor)
        text = "written as LAS %s point format %s instead of %s, which cannot hold the attributes"
        log.info(text, header.version, number, old.id)
    before, header.point_format = metadata.extras, new
    if metadata.extras != before or any(dimension.name in columns for dimension in before):
        metadata = with_description(metadata, columns)
    return metadata, points.array


def _number(metadata: LasMetadata, columns: Mapping[str, Array]) -> int:
    """The first point format, beginning with the present one, that has all attributes needed."""
    present: int = metadata.header.point_format.id
    extras = {dimension.name for dimension in metadata.extras}
    needed = set(standard_names(present)) | (columns.keys() & STANDARD - extras)
    small = all(
        (columns[name] <= PointFormat(0)[name].max).all()
        for name in ("classification", "return_number", "number_of_returns")
        if name in columns
    )
    return number_with(needed, present, small=small)


def number_with(needed: set[str], present: int, *, small: bool = True) -> int:
    """The first point format, beginning with the present one, with some standard attributes.

    Parameters
    ----------
    small : whether classes and returns fit in the few bits of point formats 0-5
    """
    for number in (present, *range(0 if present < 6 else 6, 11)):
        lacking = needed - set(standard_names(number))
        if number >= 6:  # scan_angle says it there
            lacking -= {"scan_angle_rank"}
        if not lacking and (small or number >= 6):
            return int(number)
    raise DataError(f"no LAS point format has all of {', '.join(sorted(needed))}")


def _extras(
    metadata: LasMetadata,
    number: int,
    columns: Mapping[str, Array],
    descriptions: Mapping[str, str],
) -> list[ExtraBytesParams]:
    """The extra bytes after a change: those of the file, some in a new type, and new ones."""
    old = {dimension.name: dimension for dimension in metadata.extras}
    extras = []
    for name in dict.fromkeys([*old, *columns]):
        if name in standard_names(number):
            continue
        if name in columns:
            text = descriptions.get(name, old[name].description if name in old else "")
            extras.append(extra_bytes(name, columns[name], text))
        else:
            kept = old[name]
            extras.append(
                ExtraBytesParams(name, kept.dtype, kept.description, kept.offsets, kept.scales)
            )
    return extras


def extra_bytes(name: str, values: Array, description: str) -> ExtraBytesParams:
    base = np.dtype("u1") if values.dtype.kind == "b" else values.dtype.newbyteorder("=")
    dtype = np.dtype((base, values.shape[1:])) if values.ndim > 1 else base
    if not 0 < len(name.encode()) <= 32:
        raise DataError(f"LAS holds attribute names of 1 to 32 bytes, not {name!r}")
    try:
        get_id_for_extra_dim_type(dtype)
    except UnknownExtraType as error:
        message = f"attribute {name!r} is of type {values.dtype}, which LAS cannot hold"
        raise DataError(message) from error
    text = description.encode()[:32].decode(errors="ignore")
    return ExtraBytesParams(name, dtype, text)


def converted(
    packed: Array, old: PointFormat, new: PointFormat, changed: Iterable[str]
) -> PackedPointRecord:
    """Point records in another point format, without the attributes that will be changed."""
    if old.id == new.id and old.dtype() == new.dtype():
        return PackedPointRecord(packed.copy(), new)
    points = PackedPointRecord.zeros(len(packed), new)
    for name in set(old.dimension_names) & set(new.dimension_names) - set(changed):
        if {name} <= set(packed.dtype.names or ()) & set(points.array.dtype.names or ()):
            points.array[name] = packed[name]
        else:
            points[name] = attribute(old, packed, name)
    if old.id < 6 <= new.id:
        put(points, "scan_angle", _steps(packed["scan_angle_rank"]))
    return points


def _lengthened(packed: Array, new: PointFormat) -> PackedPointRecord | None:
    """Point records with more at the end; None where more differs.

    They are copied in one go, which takes a tenth of the time of one attribute after the other.
    """
    points = PackedPointRecord.zeros(len(packed), new)
    old, wanted = (list((kind.fields or {}).items()) for kind in (packed.dtype, points.array.dtype))
    if old != wanted[: len(old)]:
        return None
    _bytes_of(points.array)[:, : packed.itemsize] = _bytes_of(np.ascontiguousarray(packed))
    return points


def _bytes_of(records: Array) -> NDArray[np.uint8]:
    """The bytes of n records one after the other, shape (n, bytes of each), not copied."""
    return records.view(np.uint8).reshape(len(records), records.itemsize)


def without_extras(
    metadata: LasMetadata, packed: Array, dropped: Collection[str]
) -> tuple[LasMetadata, Array]:
    """Metadata and point records without some extra bytes; all else stays, bit for bit."""
    kept = [
        ExtraBytesParams(extra.name, extra.dtype, extra.description, extra.offsets, extra.scales)
        for extra in metadata.extras
        if extra.name not in dropped
    ]
    header = metadata.header.copy()
    old = header.point_format
    header.point_format = point_format(old.id, kept, metadata.spare)
    points = converted(packed, old, header.point_format, ())
    return with_description(replace(metadata, header=header), ()), points.array


def _steps(degrees: Array) -> NDArray[np.float64]:
    """Scan angles in degrees as steps of 0.006 degrees, as in point formats 6-10."""
    return np.asarray(np.rint(degrees / SCAN_ANGLE), np.float64)


def whole_intensity(values: Array) -> Array:
    """Intensities as LAS has them, whole numbers from 0 to 65535, which a warning tells.

    LAS asks for the range of the instrument to be spread to 16 bits; that of PTX and E57 is often
    0 to 1. What does not fit stays, and is refused later by name, as are ranges of which rounding
    would leave little.

    Examples
    --------
    >>> whole_intensity(np.array([0.0, 0.5, 1.0])).tolist()
    [0, 32768, 65535]
    >>> whole_intensity(np.array([7.0, -1.5])).tolist()
    [7.0, -1.5]
    """
    if not len(values) or not np.isfinite(values).all() or (values == np.rint(values)).all():
        return values
    low, high = values.min(), values.max()
    spread = high <= 1
    if low < 0 or high > MOST_INTENSE or not (spread or high >= LEAST_RANGE):
        return values
    log.warning(
        "intensities have decimals, which LAS does not hold: they are %s",
        f"written times {MOST_INTENSE}" if spread else "rounded",
    )
    whole: Array = np.rint(values * (MOST_INTENSE if spread else 1)).astype(np.uint16)
    return whole


def put(points: PackedPointRecord, name: str, values: Array) -> None:
    """Write an attribute into point records; a DataError says which value does not fit."""
    dimension = points.point_format.dimension_by_name(name)
    if not dimension.is_standard:  # of the type of the values
        points.array[name] = values
        return
    dtype = dimension.dtype or np.dtype("u1")  # none of single bits
    if dtype.kind in "iu":
        bad = (values < dimension.min) | (values > dimension.max)
        if values.dtype.kind == "f":
            bad |= values != np.rint(values)  # also NaN
        if bad.any():
            raise DataError(
                f"{name} has the value {values[bad][0]}, and LAS holds whole numbers from "
                f"{dimension.min} to {dimension.max} there"
            )
    points[name] = values.astype(dtype)


def with_description(
    metadata: LasMetadata, changed: Collection[str], others: Sequence[LasMetadata] = ()
) -> LasMetadata:
    """The metadata with a new extra-bytes VLR; old descriptions stay for what is unchanged."""
    known: dict[bytes, bytes] = {}
    for source in (*reversed(others), metadata):
        old = b"".join(vlr.data for vlr in source.vlrs if vlr.key == EXTRA_BYTES)
        pieces = [old[start : start + DESCRIPTOR] for start in range(0, len(old), DESCRIPTOR)]
        known |= {piece[4:36].split(b"\0")[0]: piece for piece in pieces}
    data = b""
    for dimension in metadata.extras:
        new = dimension.name in changed
        data += _descriptor(dimension) if new else known[dimension.name.encode()]
    if data == old:
        return metadata
    metadata = metadata.without(lambda vlr: vlr.key == EXTRA_BYTES)
    vlr = Vlr.make(*EXTRA_BYTES, "Extra bytes", data)
    return replace(metadata, vlrs=metadata.vlrs + ((vlr,) if data else ()))


def _descriptor(dimension: DimensionInfo) -> bytes:
    """The bytes that describe a dimension, without the range, which laspy 2.7 misreads."""
    made = ExtraBytesStruct.from_buffer_copy(bytes(DESCRIPTOR))
    made.name, made.description = dimension.name.encode(), dimension.description.encode()
    made.data_type = get_id_for_extra_dim_type(dimension.dtype)
    return bytes(made)
