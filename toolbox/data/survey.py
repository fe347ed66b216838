"""Surveys: the files of a folder, list, pattern or virtual point cloud, known by their headers."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.context import QUIET, Context, log
from toolbox.data import vpc
from toolbox.data.cloud.joining import warn_of_clocks
from toolbox.data.crs import assumed, crs_conflicts, crs_of, metres_per_unit
from toolbox.data.las.points import Box
from toolbox.data.las.read import chunk_sizes, read_metadata
from toolbox.data.layer import Inside, Layer
from toolbox.data.paths import LAS, Paths, PointFiles, suffix_of
from toolbox.data.pointcloud import PointCloud
from toolbox.data.reading import CHANGED, Reading, errors_named, state
from toolbox.data.record import own_side_car, write_beside
from toolbox.data.writing import followed, refuse_to_replace
from toolbox.errors import DataError

_DATED = 20  # files that are asked for the day of the survey
_BATCH = 1_000_000  # points that are read at a time to find their bounds

Bounds = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class SurveyFile:
    """What the header of one file of a survey says; small, so that it can be sent to processes.

    Attributes
    ----------
    path : of the file
    count : number of points
    bounds : xmin, ymin, zmin, xmax, ymax, zmax; NaN without points. Those of a LAS file are what
        its header states, which nobody has checked against its points; only a header without
        any (all zero, turned round or not finite) leads to reading the points for them
    crs : that the file states, or else that is assumed
    version, point_format : of LAS; "" and None of other formats
    scales : of the coordinates of a LAS file
    attributes : name, type and further dimensions of each
    remarks : what is odd in the header but does no harm
    columns, separator : how a text file is read
    only : xmin, ymin, xmax, ymax of the area that is read, if not all
    state : of the file before its header was read, see `toolbox.data.reading.state`
    date : on which a LAS file was made, as its header says it (2026-11-22); "" if it does not
    copc : whether it is a COPC file, by its content

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     PointCloud([[0, 0, 5.0], [8, 9, 6.0]]).save(f"{folder}/a.las")
    ...     file = SurveyFile.open(Path(folder, "a.las"))
    >>> file.count, file.bounds
    (2, (0.0, 0.0, 5.0, 8.0, 9.0, 6.0))
    >>> file.touches((8, 8, 10, 10))
    True
    """

    path: Path
    count: int
    bounds: Bounds
    crs: CRS | None
    version: str = ""
    point_format: int | None = None
    scales: tuple[float, ...] = ()
    attributes: tuple[tuple[str, str, tuple[int, ...]], ...] = ()
    remarks: tuple[str, ...] = ()
    columns: tuple[str, ...] | None = None
    separator: str | None = None
    only: tuple[float, ...] | None = None
    state: tuple[int, int] | None = None
    date: str = ""
    copc: bool = False

    @classmethod
    def open(
        cls,
        path: Path,
        *,
        columns: Sequence[str] | None = None,
        separator: str | None = None,
        assume_crs: CRS | None = None,
        ctx: Context = QUIET,
    ) -> SurveyFile:
        """Read the header of a LAS file; a file of another format is read whole, and only counted.

        Raises
        ------
        DataError
            The file cannot be read, or the options do not suit it.
        """
        how: dict[str, Any] = {"columns": columns and tuple(columns), "separator": separator}
        before = _state(path)
        if suffix_of(path) not in LAS:
            cloud = PointCloud.open(path, assume_crs=assume_crs, ctx=ctx, **how)
            return cls(
                path=path,
                count=len(cloud),
                bounds=cloud.bounds,
                crs=cloud.crs,
                attributes=_attributes(cloud),
                state=before,
                **how,
            )
        if columns or separator:
            raise DataError(f"{path}: columns and separator are for text files")
        remarks: list[str] = []
        metadata = read_metadata(path, remarks.append)
        header = metadata.header
        file = cls(
            path=path,
            count=int(header.point_count),
            bounds=(*header.mins.tolist(), *header.maxs.tolist()),
            crs=assumed(metadata.crs, assume_crs),
            version=f"1.{metadata.minor}",
            copc=bool(metadata.copc),
            point_format=int(header.point_format.id),
            scales=tuple(header.scales.tolist()),
            attributes=_attributes(PointCloud.of_metadata(metadata, path.name)),
            remarks=tuple(remarks),
            state=before,
            date=str(header.creation_date or ""),
        )
        return file._with_bounds(ctx)

    def _with_bounds(self, ctx: Context) -> SurveyFile:
        """The same file with the bounds of its points if the header states none."""
        if self.count == 0:
            return replace(self, bounds=(np.nan,) * 6)
        low, high = np.reshape(self.bounds, (2, 3))
        if np.isfinite(self.bounds).all() and (low <= high).all() and np.any(self.bounds):
            return self
        text = "has no bounding box in its header; its points are read to find it"
        log.warning("%s %s", self.path.name, text)
        found = [self.read(*batch, ctx=ctx).bounds for batch in self.ranges(_BATCH)]
        return replace(self, bounds=_union(found), remarks=(*self.remarks, text))

    def ranges(self, size: int) -> list[tuple[int, int]]:
        """Index ranges (start, stop) of points that can be read with bounded memory.

        Parameters
        ----------
        size : at most so many points in each; but at least one chunk of a compressed file, and
            all of a file that is neither LAS nor LAZ

        Raises
        ------
        DataError
            The file is damaged.
        """
        if self.only and not self.touches(self.only):
            return []
        if suffix_of(self.path) not in LAS or (self.only and self.copc):
            return [(0, self.count)]
        chunks = chunk_sizes(self.path)
        if chunks is None:
            starts = list(range(0, self.count, size)) or [0]
            return list(zip(starts, [*starts[1:], self.count], strict=True))
        ends = np.cumsum(chunks)
        found, start = [], 0
        while start < self.count:
            last = max(
                np.searchsorted(ends, start + size, side="right") - 1,
                np.searchsorted(ends, start, side="right"),
            )
            found.append((start, int(ends[last])))
            start = int(ends[last])
        return found

    def read(
        self, start: int, stop: int, *, reading: Reading | None = None, ctx: Context = QUIET
    ) -> PointCloud:
        """Read the points with indices from start to before stop, if they lie in the area wanted.

        Raises
        ------
        DataError
            The file is damaged, or has not so many points.
        """
        whole = start == 0 and stop == self.count
        which = None if whole else (start, stop)
        cloud = self._opened(point_range=which, bounds=self.only, reading=reading, ctx=ctx)
        if not self.only and len(cloud) != stop - start:
            raise DataError(f"{self.path} has {len(cloud)} points now, and {self.count} before")
        return cloud

    def within(
        self,
        bounds: Sequence[float] | None,
        *,
        reading: Reading | None = None,
        ctx: Context = QUIET,
    ) -> PointCloud:
        """Read the points within (xmin, ymin, xmax, ymax), or all; COPC files only where needed.

        Raises
        ------
        DataError
            The file is damaged.
        """
        if bounds:
            return self._opened(bounds=bounds, reading=reading, ctx=ctx)
        return self.read(0, self.count, reading=reading, ctx=ctx)

    def _opened(self, **how: Any) -> PointCloud:
        cloud = PointCloud.open(self.path, columns=self.columns, separator=self.separator, **how)
        if self.state is not None and _state(self.path) != self.state:
            raise DataError(f"{self.path} {CHANGED}")
        return cloud.with_crs(self.crs)

    def touches(self, bounds: Sequence[float]) -> bool:
        """Whether the bounding box of the file touches (xmin, ymin, xmax, ymax)."""
        xmin, ymin, _, xmax, ymax, _ = self.bounds
        return (
            self.count > 0
            and xmin <= bounds[2]
            and xmax >= bounds[0]
            and ymin <= bounds[3]
            and ymax >= bounds[1]
        )


@dataclass(frozen=True)
class Survey(Layer):
    """Point cloud files in one CRS, of which only the headers have been read.

    Attributes
    ----------
    files : sorted by path
    name : of the folder, pattern or list, for messages
    overview : COPC file of a part of all points, which a virtual point cloud of them names

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     for name in ("a.las", "b.las"):
    ...         PointCloud([[0, 0, 5.0], [8, 9, 6.0]]).save(f"{folder}/{name}")
    ...     survey = Survey.open(folder)
    ...     near = survey.read(bounds=(0, 0, 1, 1))
    >>> survey.count, len(near)
    (4, 2)
    >>> repr(survey).endswith(": 2 files, 4 points>")
    True
    """

    files: tuple[SurveyFile, ...]
    name: str
    overview: Path | None = None
    SUFFIXES: ClassVar[tuple[str, ...]] = (vpc.SUFFIX,)
    is_spatial: ClassVar[bool] = True
    tools: ClassVar[str] = "points"
    axes: ClassVar[tuple[str, ...]] = PointCloud.axes

    def __repr__(self) -> str:
        return f"<Survey {self.name}: {len(self.files)} files, {self.count} points>"

    @classmethod
    def open(
        cls,
        paths: Paths | PointFiles,
        *,
        columns: Sequence[str] | None = None,
        separator: str | None = None,
        assume_crs: CRS | str | int | None = None,
        ctx: Context = QUIET,
    ) -> Survey:
        """Read the headers of all files that paths stand for.

        LAS and LAZ files have headers; those of other formats are read once from end to end, for
        their number of points and their bounds.

        Parameters
        ----------
        paths : a file, a folder (files directly in it; nested folders are not searched), a
            pattern such as ``tiles/**/*.laz``, a virtual point cloud (.vpc), or a list of these;
            see :meth:`toolbox.data.paths.PointFiles.of`
        columns, separator : of text files, as in :meth:`PointCloud.open`
        assume_crs : of files that state none, or the stated one with its height system
        ctx : told of progress, and asked whether to stop

        Raises
        ------
        DataError
            A path does not exist, or files are damaged, given twice, or in another CRS or unit
            than the first; tells all of them.
        """
        found, assume_crs = PointFiles.of(paths), crs_of(assume_crs)
        for text in found.remarks:
            log.warning(text)
        files, problems = [], []
        for number, path in enumerate(found.paths):
            share = ctx.part(number / len(found.paths), (number + 1) / len(found.paths))
            share.progress(0)
            try:
                files.append(
                    SurveyFile.open(
                        path, columns=columns, separator=separator, assume_crs=assume_crs, ctx=share
                    )
                )
            except DataError as error:
                problems.append(str(error))
        if not problems:
            problems = crs_conflicts([(str(file.path), file.crs) for file in files])
        if problems:
            raise DataError("\n    ".join(problems))
        return cls(tuple(files), found.name)

    def absolute(self) -> Survey:
        """The same survey with absolute paths, for processes in another folder."""
        files = tuple(replace(file, path=file.path.absolute()) for file in self.files)
        return replace(self, files=files)

    def limited_to(self, bounds: Sequence[float]) -> Survey:
        """The same survey, of which only the points within (xmin, ymin, xmax, ymax) are read."""
        files = tuple(replace(file, only=tuple(bounds)) for file in self.files)
        return replace(self, files=files)

    @classmethod
    def own_files(cls, path: str | Path) -> tuple[Path, ...]:
        """The index at a path, the tiles made with it, and the record that stands beside it."""
        return Path(path), *own_side_car(path), *vpc.own_files(Path(path))

    def save(
        self,
        path: str | Path,
        *,
        place: Path | None = None,
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write a virtual point cloud, which names the files relative to itself.

        Parameters
        ----------
        path : ends in .vpc
        place : where the file will be moved to; `path` unless given
        overwrite : whether files at the path may be replaced
        record : how the file was made, as JSON text (see `toolbox.runs.provenance`)

        Raises
        ------
        ParameterError
            A file is there that may not be replaced.
        DataError
            It cannot be written.
        """
        path = followed(path)
        if path.suffix.lower() not in self.SUFFIXES:
            raise DataError(f"{path}: a survey is written as {', '.join(self.SUFFIXES)}")
        refuse_to_replace(path, self.own_files, overwrite=overwrite)
        with errors_named(f"{path} cannot be written"):
            text = vpc.text_of(self.files, place or path, overview=self.overview)
            path.write_text(text, encoding="utf-8", newline="\n")
            write_beside(path, record)
        ctx.progress(1.0)

    @property
    def crs(self) -> CRS | None:
        """The CRS of all files; None if not known."""
        return self.files[0].crs

    @property
    def count(self) -> int:
        """Number of points of all files."""
        return sum(file.count for file in self.files)

    @property
    def bounds(self) -> Bounds:
        """xmin, ymin, zmin, xmax, ymax, zmax of all files; NaN without points."""
        return _union([file.bounds for file in self.files if file.count])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the attributes that some file has."""
        return tuple(dict.fromkeys(name for file in self.files for name, *_ in file.attributes))

    @property
    def metre(self) -> float:
        """Length of one metre in the unit of the coordinates; 1.0 without a CRS."""
        return 1 / metres_per_unit(self.crs)

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files that hold the points."""
        return tuple(file.path for file in self.files)

    def days(self) -> tuple[date, date] | None:
        """First and last day of the points that stand first and last in each of the first files.

        See `PointCloud.days`; None if the data do not tell.
        """
        found = []
        for file in self.files[:_DATED]:
            ranges = file.ranges(_BATCH)
            for start, stop in dict.fromkeys([*ranges[:1], *ranges[-1:]]):
                found.append(file.read(start, stop).days())
        known = [span for span in found if span]
        return (min(a for a, _ in known), max(b for _, b in known)) if known else None

    def size(self, inside: Inside | None = None) -> int | None:
        """Number of points; None for a tile, since nothing is read."""
        return self.count if inside is None else None

    def with_crs(self, crs: CRS | str | int | None) -> Survey:
        """The same survey, stated to be in another CRS; nothing is transformed."""
        return replace(self, files=tuple(replace(file, crs=crs_of(crs)) for file in self.files))

    @cached_property
    def template(self) -> PointCloud:
        """A cloud without points in the layout that joins the points of all files.

        ``survey.files[i].read(start, stop).like(survey.template)`` is, bit for bit, that piece of
        what `PointCloud.open` makes of the survey.
        """
        shells = [_empty(file) for file in self.files]
        warn_of_clocks(shells, lambda: [file.read(0, 1) for file in self.files if file.count])
        made = PointCloud.template(shells, self._boxes)
        return made.with_extent(self.bounds)

    def _boxes(self) -> list[Box]:
        boxes = [np.reshape(file.bounds, (2, 3)) for file in self.files if file.count]
        return [(low, high) for low, high in boxes]

    def read(
        self,
        *,
        bounds: Sequence[float] | None = None,
        reading: Reading | None = None,
        ctx: Context = QUIET,
    ) -> PointCloud:
        """Read all points in the order of the files, or those within bounds.

        Parameters
        ----------
        reading : where hashes and records of the files that are read are noted

        Raises
        ------
        DataError
            A file is damaged, or its points cannot be joined with those of the others.
        """
        bounds = bounds or self.files[0].only
        numbers = [n for n, f in enumerate(self.files) if bounds is None or f.touches(bounds)]
        files = [self.files[number] for number in numbers]
        shares = np.cumsum([0, *(file.count for file in files)]) / max(self.count, 1)
        clouds = (
            file.within(bounds, reading=reading, ctx=ctx.part(*share)).like(self.template)
            for file, share in zip(files, itertools.pairwise(shares.tolist()), strict=True)
        )
        counts = [file.count for file in files]
        if bounds is None:
            whole = self.template.filled(clouds, self.count)
        else:
            found = list(clouds)
            counts = [len(cloud) for cloud in found]
            whole = self.template.filled(found, sum(counts))
        whole.name = self.name
        return whole.with_file(np.repeat(np.array(numbers, np.int32), counts))

    def batches(self, size: int, *, ctx: Context = QUIET) -> Iterator[PointCloud]:
        """Read all points in the order of the files as clouds like the template; at least one.

        Parameters
        ----------
        size : at most so many points in each, where a file can be read so

        Raises
        ------
        DataError
            A file is damaged.
        """
        done = 0
        for file in self.files:
            for start, stop in file.ranges(size):
                yield file.read(start, stop).like(self.template)
                done += stop - start
                ctx.progress(done / self.count)
        if not done:
            yield self.template

    def file_of(self, number: NDArray[np.int64]) -> NDArray[np.int64]:
        """Index of the file that holds each point, given its index in the survey."""
        ends = np.cumsum([file.count for file in self.files])
        return np.searchsorted(ends, number, side="right")


def _state(path: Path) -> tuple[int, int]:
    try:
        return state(path.stat())
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error


def _empty(file: SurveyFile) -> PointCloud:
    """The point cloud of a file without its points."""
    name = file.path.name
    if file.version:
        return PointCloud.of_metadata(read_metadata(file.path, lambda text: None), name).with_crs(
            file.crs
        )
    columns = {name: np.empty((0, *shape), kind) for name, kind, shape in file.attributes}
    return PointCloud(np.empty((0, 3)), columns, crs=file.crs, name=name)


def _attributes(cloud: PointCloud) -> tuple[tuple[str, str, tuple[int, ...]], ...]:
    none = cloud.select([])
    return tuple((name, none[name].dtype.str, none[name].shape[1:]) for name in none.names)


def _union(bounds: Sequence[Bounds]) -> Bounds:
    """The bounds of some bounds; NaN if there are none."""
    if not bounds:
        return (np.nan,) * 6
    corners = np.array(bounds)
    low, high = corners[:, :3].min(axis=0), corners[:, 3:].max(axis=0)
    return (*low.tolist(), *high.tolist())
