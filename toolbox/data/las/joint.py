"""Points of several LAS files joined in the layout of one.

Files of the same layout (point format, extra bytes, scale and offset) are joined as they are, bit
for bit. Otherwise the first file gives the header and its VLRs, and the layout becomes one that
holds the attributes of all.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from laspy import ExtraBytesParams
from laspy.point.dims import DimensionInfo
from numpy.typing import NDArray

from toolbox.context import log
from toolbox.data.las.crs import is_crs_vlr
from toolbox.data.las.header import (
    EXTRA_BYTES,
    SPARE,
    LasMetadata,
    oldest_version,
    point_format,
    standard_names,
)
from toolbox.data.las.points import (
    Box,
    attribute,
    converted,
    extra_bytes,
    number_with,
    put,
    with_crs,
    with_description,
)
from toolbox.errors import DataError

Array = NDArray[Any]
_NEW_IN_6 = {"overlap", "scanner_channel", "scan_angle"}  # older formats do without them
_FURTHEST = 2**31 - 1  # steps from the offset


def joint_metadata(
    members: Sequence[LasMetadata],
    names: Sequence[str],
    boxes: Callable[[], Sequence[Box]],
    covered: Collection[str] = (),
) -> LasMetadata:
    """The metadata of one LAS file for the points of several files.

    Header and VLRs are those of the first file. The point format is the first one
    with the attributes of all, an extra-byte dimension that files hold in different types takes
    one for all, the scale is the finest, and the offset that of the first file unless 32 bits do
    not reach the others from there. What a file does not hold will be 0 in its points.

    Parameters
    ----------
    members : of the files
    names : of the files, for messages
    boxes : gives those of the files that hold points
    covered : attributes that do not come from the files, so that it matters not who lacks them

    Raises
    ------
    DataError
        No layout suits all files.
    """
    first, *others = members
    if all(_same_layout(first, other) for other in others):
        _warn(members, names, first, covered)
        return first
    number = number_with(
        {name for metadata in members for name in standard_names(_number(metadata))},
        max(map(_number, members)),
    )
    extras, changed = _joint_extras(members, names, number)
    header = first.header.copy()
    header.version = oldest_version(header.version.minor, number)  # first: laspy compares them
    header.point_format = point_format(number, extras, max(metadata.spare for metadata in members))
    header.scales, header.offsets = _joint_scales(members, boxes())
    joint = replace(first, header=header, minor=max(first.minor, header.version.minor))
    joint = with_description(joint, changed, others)
    unread = joint.crs is None and any(map(is_crs_vlr, joint.all_vlrs))  # kept as it is
    if _number(first) < 6 <= number and not unread:
        joint = with_crs(joint, joint.crs)
    scales = ", ".join(f"{scale:g}" for scale in header.scales)
    text = "files of different layouts are joined in LAS %s, point format %s, scale %s"
    log.info(text, header.version, number, scales)
    _warn(members, names, joint, covered)
    return joint


def with_layout(layout: LasMetadata, owner: LasMetadata) -> LasMetadata:
    """The metadata of one file (owner) for points in the layout of another."""
    header = owner.header.copy()
    header.version = oldest_version(owner.header.version.minor, _number(layout))
    header.point_format = layout.header.point_format
    header.scales, header.offsets = layout.header.scales, layout.header.offsets
    header.global_encoding.wkt = layout.header.global_encoding.wkt
    kept = owner.without(lambda vlr: is_crs_vlr(vlr) or vlr.key == EXTRA_BYTES)
    own = [r for r in layout.vlrs if is_crs_vlr(r) or r.key == EXTRA_BYTES]
    minor = max(owner.minor, header.version.minor)
    return replace(kept, header=header, minor=minor, vlrs=(*kept.vlrs, *own), crs=layout.crs)


def in_layout(metadata: LasMetadata, packed: Array, joint: LasMetadata) -> Array:
    """Point records in the joint layout; the same array if they have it already.

    Raises
    ------
    DataError
        The points are too far from the offset, so the box in the header of their file is wrong.
    """
    if metadata is joint or _same_layout(metadata, joint):
        return packed
    old, new = metadata.header.point_format, joint.header.point_format
    kinds = _kinds(joint)
    changed = [name for name, kind in _kinds(metadata).items() if kinds.get(name) != kind]
    points = converted(packed, old, new, [*changed, SPARE])
    for name in changed:
        put(points, name, attribute(old, packed, name))
    if metadata.spare:
        target = points.array[SPARE].reshape(len(packed), -1)
        target[:, : metadata.spare] = packed[SPARE].reshape(len(packed), -1)
    if _steps(metadata) != _steps(joint):
        _move(points.array, metadata, joint)
    made: Array = points.array
    return made


def _number(metadata: LasMetadata) -> int:
    return int(metadata.header.point_format.id)


def _same_layout(a: LasMetadata, b: LasMetadata) -> bool:
    same = _number(a) == _number(b) and a.spare == b.spare and _steps(a) == _steps(b)
    return same and list(_kinds(a).items()) == list(_kinds(b).items())


def _steps(metadata: LasMetadata) -> list[float]:
    return [*metadata.header.scales.tolist(), *metadata.header.offsets.tolist()]


def _kinds(metadata: LasMetadata) -> dict[str, tuple[Any, ...]]:
    """Type, size, scales and offsets of each extra-byte dimension, by name."""
    return {extra.name: _kind(extra) for extra in metadata.extras}


def _kind(extra: DimensionInfo) -> tuple[Any, ...]:
    scales, offsets = (
        None if values is None else tuple(values) for values in (extra.scales, extra.offsets)
    )
    return extra.dtype.base.str, extra.num_elements, scales, offsets


def _joint_extras(
    members: Sequence[LasMetadata], names: Sequence[str], number: int
) -> tuple[list[ExtraBytesParams], set[str]]:
    """Extra bytes for the values of all files, and the names of those that change their type."""
    extras: list[ExtraBytesParams] = []
    changed: set[str] = set()
    known = [
        (file, extra)
        for file, metadata in zip(names, members, strict=True)
        for extra in metadata.extras
    ]
    for name in dict.fromkeys(extra.name for _, extra in known):
        if name in standard_names(number):
            continue
        same = [(file, extra) for file, extra in known if extra.name == name]
        kept = same[0][1]
        if all(_kind(extra) == _kind(kept) for _, extra in same):
            text, offsets, scales = kept.description, kept.offsets, kept.scales
            extras.append(ExtraBytesParams(name, kept.dtype, text, offsets, scales))
            continue
        if len({extra.num_elements for _, extra in same}) > 1:
            listed = ", ".join(f"{extra.num_elements} in {file}" for file, extra in same)
            raise DataError(f"attribute {name!r} has {listed} elements; they cannot be joined")
        common = np.result_type(*(_values_type(extra) for _, extra in same))
        shape = (0,) if kept.num_elements == 1 else (0, kept.num_elements)
        extras.append(extra_bytes(name, np.empty(shape, common), kept.description))
        changed.add(name)
    return extras, changed


def _values_type(extra: DimensionInfo) -> np.dtype[Any]:
    return np.dtype("f8") if extra.is_scaled else extra.dtype.base


def _joint_scales(
    members: Sequence[LasMetadata], boxes: Sequence[Box]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The finest scales of all files, and offsets from which 32 bits reach all boxes."""
    headers = [metadata.header for metadata in members]
    scales = np.min([np.abs(header.scales) for header in headers], axis=0)
    offsets = headers[0].offsets.copy()
    if not boxes:
        return scales, offsets
    low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    for axis, name in enumerate("xyz"):
        reach = np.array([low[axis], high[axis]])
        if np.abs(reach - offsets[axis]).max() > _FURTHEST * scales[axis]:
            offsets[axis] = np.floor(reach.mean())
            log.info("%s needs the new offset %s", name, offsets[axis])
        if np.abs(reach - offsets[axis]).max() > _FURTHEST * scales[axis]:
            raise DataError(
                f"{name} reaches from {reach[0]} to {reach[1]}, which LAS cannot hold in the "
                f"steps of {scales[axis]:g} that the finest of the files has"
            )
    return scales, offsets


def _move(points: Array, metadata: LasMetadata, joint: LasMetadata) -> None:
    """Write coordinates as steps of the joint scale from the joint offset."""
    for axis, name in enumerate("XYZ"):
        scale, offset = metadata.header.scales[axis], metadata.header.offsets[axis]
        shifted = points[name] * scale + (offset - joint.header.offsets[axis])
        steps = np.rint(shifted / joint.header.scales[axis])
        if len(steps) and np.abs(steps).max() > _FURTHEST:
            raise DataError(
                "has points so far outside the bounding box in its header that they cannot be "
                "joined with those of the other files"
            )
        points[name] = steps


def _warn(
    members: Sequence[LasMetadata],
    names: Sequence[str],
    joint: LasMetadata,
    covered: Collection[str],
) -> None:
    """Log what is lost or filled in by joining, once for all files concerned."""
    for text, files in _differences(members, names, joint, covered):
        log.warning("%s: %s", named(files), text)


def named(files: Sequence[str]) -> str:
    """The name of the first of some files, and how many more there are.

    Examples
    --------
    >>> named(["a.laz", "b.laz", "c.laz"])
    'a.laz and 2 more files'
    """
    return files[0] + (f" and {len(files) - 1} more files" if len(files) > 1 else "")


def _differences(
    members: Sequence[LasMetadata],
    names: Sequence[str],
    joint: LasMetadata,
    covered: Collection[str],
) -> Iterable[tuple[str, list[str]]]:
    """What is lost or filled in by joining, each with the names of the files concerned."""
    found: dict[str, list[str]] = {}
    first = members[0]
    for file, metadata in zip(names, members, strict=True):
        there = {*metadata.names, *covered, *(_NEW_IN_6 if _number(metadata) < 6 else ())}
        lacking = [name for name in joint.names if name not in there]
        if lacking:
            found.setdefault(f"has no {', '.join(lacking)}; 0 is written there", []).append(file)
        if not _whole(metadata, joint):
            text = "coordinates are rounded by up to half a step of the joint scale"
            found.setdefault(text, []).append(file)
        if not _same_packets(metadata, first):
            text = "its waveform packets are not kept, only those of the first file"
            found.setdefault(text, []).append(file)
    return found.items()


def _same_packets(metadata: LasMetadata, first: LasMetadata) -> bool:
    """Whether the waveforms of a file are those of the first one, or it has none."""
    if metadata.packets:
        return metadata.packets == first.packets
    own, other = metadata.waveform, first.waveform
    return own is None or bool(other and own.data == other.data)


def _whole(metadata: LasMetadata, joint: LasMetadata) -> bool:
    """Whether coordinates of a file fit the joint scale without rounding."""
    scales = joint.header.scales
    ratios = [
        metadata.header.scales / scales,
        (metadata.header.offsets - joint.header.offsets) / scales,
    ]
    return all(np.allclose(ratio, np.rint(ratio), rtol=0, atol=1e-3) for ratio in ratios)
