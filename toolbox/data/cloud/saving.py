"""Writing point clouds to files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from toolbox.context import Context, log
from toolbox.data.crs import describe_crs, is_local
from toolbox.data.las import points as las_points
from toolbox.data.las import versions as las_versions
from toolbox.data.las.copc_write import points_sink, write_copc
from toolbox.data.las.waveforms import copy_packets
from toolbox.data.las.write import write_las
from toolbox.data.paths import LAS, is_copc, suffix_of
from toolbox.data.record import with_record, write_beside
from toolbox.data.writing import refuse_to_replace
from toolbox.errors import DataError

if TYPE_CHECKING:
    from toolbox.data.pointcloud import PointCloud

INTENSITY = "intensity"


def save(
    cloud: PointCloud,
    path: Path,
    *,
    columns: Sequence[str] | None,
    version: str | None,
    format: int | None,
    overwrite: bool,
    record: str,
    ctx: Context,
) -> None:
    """See :meth:`PointCloud.save`."""
    wanted = (version, format)
    suffix = suffix_of(path)
    if not path.name.lower().endswith(cloud.SUFFIXES):
        raise DataError(f"{path}: points are written as {', '.join(cloud.SUFFIXES)}")
    refuse_to_replace(path, cloud.own_files, overwrite=overwrite)
    holds_local = suffix == ".ply" and cloud.crs is not None and is_local(cloud.crs)
    holds_local |= suffix == ".parquet"
    if suffix not in LAS and cloud.crs is not None and not holds_local:
        log.info("%s: the format holds no CRS (%s)", path.name, describe_crs(cloud.crs))
    try:
        if columns is not None and suffix in (*LAS, ".ply"):
            raise DataError(f"{path}: columns are for text, not for {suffix}")
        if suffix in LAS:
            _save_las(cloud, path, record, wanted, compress=suffix == ".laz", ctx=ctx)
            return
        if wanted != (None, None):
            raise DataError(f"{path}: version and format are for LAS and LAZ, not {suffix}")
        if suffix == ".ply":
            from toolbox.data.ply import write_ply

            write_ply(path, cloud)
        elif suffix == ".parquet":
            from toolbox.data.geoparquet import write_geoparquet

            write_geoparquet(path, cloud, ctx=ctx)
        else:
            from toolbox.data.text import write_text

            write_text(path, cloud, wanted=columns, ctx=ctx)
        write_beside(path, record)
    except OSError as error:
        raise DataError(f"{path} cannot be written: {error.strerror or error}") from error


def _save_las(
    cloud: PointCloud,
    path: Path,
    record: str,
    wanted: tuple[str | None, int | None],
    *,
    compress: bool,
    ctx: Context,
) -> None:
    try:
        metadata, points = _with_las_intensity(cloud).as_las()
        metadata, convert = las_versions.wanted(metadata, *wanted)
        metadata, points = with_record(metadata, record), convert(points)
    except DataError as error:
        raise DataError(f"{path} cannot be written: {error}") from error
    if is_copc(path):
        write_copc(path, metadata, points, ctx=ctx)
    else:
        write_las(path, metadata, points, compress=compress, ctx=ctx)
        copy_packets(metadata, path)


def _with_las_intensity(cloud: PointCloud) -> PointCloud:
    """The cloud with intensities as LAS has them; scans have decimals there."""
    old = cloud._columns.get(INTENSITY)
    if old is None or old.dtype.kind != "f":
        return cloud
    return cloud.with_attributes({INTENSITY: las_points.whole_intensity(old)})


def save_batches(
    like: PointCloud,
    path: Path,
    clouds: Iterable[PointCloud],
    size: int,
    *,
    version: str | None,
    format: int | None,
    record: str,
    ctx: Context,
) -> None:
    """See :meth:`PointCloud.save_batches`."""
    metadata, _ = like.as_las()
    metadata, convert = las_versions.wanted(metadata, version, format)
    done, metadata = 0, with_record(metadata, record)
    with points_sink(path, metadata) as write:
        for cloud in clouds:
            ctx.progress(done / max(size, 1))
            write(convert(cloud.as_las()[1]))
            done += len(cloud)
    copy_packets(metadata, path)
