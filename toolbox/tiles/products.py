"""One product of a survey, made of the pieces that its tiles have stored."""

from __future__ import annotations

import dataclasses
import functools
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context
from toolbox.data import Lattice, PointCloud, Raster, Survey, Vector
from toolbox.data.paths import LAS
from toolbox.data.raster import STRIP
from toolbox.data.reading import Reading
from toolbox.data.survey import SurveyFile
from toolbox.runs.provenance import Record
from toolbox.runs.target import Target
from toolbox.tiles import store as tile_store
from toolbox.tiles.work import EXACT, TileJob

WINDOW = 1_000_000  # points that are written at a time

Interval = tuple[int, int]
"""Origins of points: from the first of these numbers up to, but without, the second."""


@dataclasses.dataclass(frozen=True)
class Product:
    """A file to write from the pieces of tiles.

    Attributes
    ----------
    output, result : the output, and the step.output that it comes from
    target : the file
    path : the temporary path where it is prepared
    file : for a folder of files, the index of the file of the survey
    """

    output: str
    result: str
    target: Target
    file: int | None = None
    path: Path = Path()

    @property
    def resolved(self) -> Path:
        """The path of the file, links followed."""
        assert self.target.resolved is not None
        return self.target.resolved


def pieces_of(folder: Path, name: str) -> list[Path]:
    """The stored pieces of a result, tile by tile from south to north and west to east."""
    done = [path for path in (folder / "tiles").iterdir() if not path.name.startswith(".")]
    folders = [path for path in done if (path / name / tile_store.LAYER).exists()]
    tiles = {tuple(map(int, path.name.split("_"))): path / name for path in folders}
    return [tiles[tile] for tile in sorted(tiles)]


def remove(folder: Path, name: str) -> None:
    """Remove the stored pieces of a result; the tiles themselves stay done."""
    for piece in pieces_of(folder, name):
        (piece / tile_store.LAYER).unlink()  # first: a kill meanwhile leaves no half of a piece
        shutil.rmtree(piece)
        shutil.rmtree(piece.with_name(name + EXACT), ignore_errors=True)


def read(folder: Path, name: str) -> Any:
    """The whole result of a step in memory; None if no tile gave any of it."""
    stored = pieces_of(folder, name)
    if not stored:
        return None
    return _joined(stored).whole()


def write(
    job: TileJob,
    folder: Path,
    output: str,
    name: str,
    path: Path,
    options: Mapping[str, Any],
    file: int | None,
    record: Record | None,
) -> None:
    """Write a point cloud or raster from its stored pieces to a file.

    LAS, LAZ and rasters are written in blocks; for other formats the whole result is in memory.

    Parameters
    ----------
    job : of the run
    folder : of the pass that made the pieces
    output, name : the output of the tool, and the step.output that it comes from
    path : the file to write
    options : of the format
    file : only the points of this file of the survey
    record : the provenance record of the run
    """
    stored = pieces_of(folder, name)
    joint = _joined(stored) if stored else None
    if isinstance(joint, Mosaic):
        text = _text(record, output, joint.first, options)
        joint.first.save_strips(path, joint.lattice, joint.strips(), record=text, **options)
    else:
        survey = job.surveys[job.first]
        points = Points(stored) if stored else None
        template = points.template if points else survey.template
        name = "" if file is None else survey.files[file].path.name
        text = _text(record, output, template, options, name)
        _write_points(points, template, survey, file, path, text, options)


def _text(
    record: Record | None, output: str, layer: Any, options: Mapping[str, Any], file: str = ""
) -> str:
    return record.of(output, layer, options, file=file).to_json() if record else ""


def _write_points(
    points: Points | None,
    template: PointCloud,
    survey: Survey,
    file: int | None,
    path: Path,
    record: str,
    options: Mapping[str, Any],
) -> None:
    interval = None
    if file is not None:
        before = sum(other.count for other in survey.files[:file])
        interval = before, before + survey.files[file].count
        template = template.with_header_of(survey.files[file].read(0, 0))
    size = points.size(interval) if points else 0
    windows = points.windows(interval) if points else iter(())
    if path.suffix.lower() in LAS:
        template.save_batches(path, windows, size, record=record, **options)
    else:
        template.filled(windows, size).save(path, record=record, **options)


@dataclasses.dataclass(frozen=True)
class StoredSurvey(Survey):
    """The stored pieces of a point cloud as a survey, for tools that read one piece by piece."""

    @classmethod
    def of(cls, folder: Path, name: str) -> StoredSurvey | None:
        """The survey of a result of tiles; None if no tile gave any of it."""
        files = tuple(_stored_file(piece) for piece in pieces_of(folder, name))
        return cls(files, tile_store.load_layer(files[0].path, empty=True).name) if files else None

    @functools.cached_property
    def points(self) -> Points:
        """The pieces."""
        return Points([file.path for file in self.files])

    @property
    def template(self) -> PointCloud:
        return self.points.template

    def batches(self, size: int, *, ctx: Context = QUIET) -> Iterator[PointCloud]:
        done = 0
        for piece in self.points.windows():
            yield piece
            done += len(piece)
            ctx.progress(done / max(self.count, 1))

    def read(
        self,
        *,
        bounds: Sequence[float] | None = None,
        reading: Reading | None = None,
        ctx: Context = QUIET,
    ) -> PointCloud:
        whole = self.template.filled(self.points.windows(), self.points.size())
        return whole if bounds is None else whole.within(bounds)


def _stored_file(folder: Path) -> SurveyFile:
    stored: PointCloud = tile_store.load_layer(folder)
    shell = stored.select([])
    bounds: Any = tuple(tile_store.box_of(folder).ravel().tolist())
    attributes = tuple((n, shell[n].dtype.str, shell[n].shape[1:]) for n in shell.names)
    count, crs = len(stored), shell.crs
    return SurveyFile(path=folder, count=count, bounds=bounds, crs=crs, attributes=attributes)


class Points:
    """Reads the stored pieces of a point cloud in the order of the survey.

    Attributes
    ----------
    template : a cloud without points, whose attributes and header suit all pieces
    """

    def __init__(self, pieces: list[Path]) -> None:
        self._shells = [tile_store.load_layer(piece, empty=True) for piece in pieces]
        self._pieces = pieces
        found = map(tile_store.box_of, pieces)
        boxes = [(low, high) for low, high in found if np.isfinite(low).all()]
        self.template = PointCloud.template(self._shells, lambda: boxes)
        origins = [self._origin(number) for number in range(len(pieces))]
        self._sizes = np.array([len(origin) for origin in origins])
        ends = [(o[0], o[-1]) if len(o) else (0, -1) for o in origins]
        self._first, self._last = np.array(ends, np.int64).T

    def _origin(self, number: int) -> NDArray[np.int64]:
        """The origins of the points of a piece; without any, they follow those of other pieces."""
        path = self._pieces[number] / "origin.npy"
        if path.exists():
            found: NDArray[np.int64] = np.load(path, mmap_mode="r")
            return found
        size = len(next(iter(tile_store.load_arrays(self._pieces[number]).values())))
        return (number << 40) + np.arange(size)

    def whole(self) -> PointCloud:
        """All points in memory."""
        return self.template.filled(self.windows(), self.size())

    def size(self, interval: Interval | None = None) -> int:
        """The number of points, or of those whose origin is in an interval."""
        if interval is None:
            return int(self._sizes.sum())
        return sum(rows.stop - rows.start for _, rows in self._within(*interval))

    def _within(self, start: int, stop: int) -> Iterator[tuple[int, slice]]:
        """The numbers of the pieces with points in an interval, and the rows of these points."""
        for number in np.flatnonzero((self._first < stop) & (self._last >= start)):
            low, high = np.searchsorted(self._origin(int(number)), (start, stop))
            yield int(number), slice(int(low), int(high))

    def windows(self, interval: Interval | None = None) -> Iterator[PointCloud]:
        """The points in order, a window at a time, all like the template."""
        start, stop = interval or (int(self._first.min()), int(self._last.max()) + 1)
        while start < stop:
            end = min(start + WINDOW, stop)
            clouds, origins = [], [np.empty(0, np.int64)]
            for number, rows in self._within(start, end):
                arrays = tile_store.load_arrays(self._pieces[number])
                arrays.pop("origin", None)
                columns = {name: np.array(values[rows]) for name, values in arrays.items()}
                clouds.append(self._shells[number].with_arrays(columns).like(self.template))
                origins.append(self._origin(number)[rows])
            joint = self.template.filled(clouds, sum(map(len, clouds)))
            yield joint.select(np.argsort(np.concatenate(origins), kind="stable"))
            later = self._first[self._last >= end]
            start = max(end, int(later.min())) if len(later) else stop


class Mosaic:
    """Joins the stored pieces of a raster on one lattice.

    Attributes
    ----------
    first : a piece, which has all of the raster but its values
    lattice : of all pieces
    """

    def __init__(self, pieces: list[Path]) -> None:
        self._pieces: list[Raster] = [tile_store.load_layer(piece) for piece in pieces]
        lattices = [Lattice.of(piece) for piece in self._pieces]
        self.first = self._pieces[0]
        self.lattice = Lattice.union(lattices)
        self._corners = [self.lattice.position_of(lattice) for lattice in lattices]

    def whole(self) -> Raster:
        """All cells in memory."""
        values = np.concatenate(list(self.strips()), axis=1)
        return dataclasses.replace(self.first, values=values, transform=self.lattice.transform)

    def strips(self) -> Iterator[NDArray[Any]]:
        """Values of shape (bands, STRIP, cols) from north to south, the last may be shorter."""
        bands, dtype = len(self.first.values), self.first.values.dtype
        nothing = np.nan if dtype.kind == "f" else self.first.nodata or 0
        for top in range(0, self.lattice.rows, STRIP):
            rows = min(STRIP, self.lattice.rows - top)
            strip = np.full((bands, rows, self.lattice.cols), nothing, dtype)
            for (row, col), piece in zip(self._corners, self._pieces, strict=True):
                values = piece.values
                first, last = max(row, top), min(row + values.shape[1], top + rows)
                if first < last:
                    inside = strip[:, first - top : last - top, col : col + values.shape[2]]
                    inside[:] = values[:, first - row : last - row]
            yield strip


class Features:
    """Joins the stored pieces of a vector layer."""

    def __init__(self, pieces: list[Path]) -> None:
        self._layers: list[Vector] = [tile_store.load_layer(piece) for piece in pieces]

    def whole(self) -> Vector:
        """All features in memory."""
        return Vector.concat(self._layers)


_JOINTS: Mapping[str, type[Points | Mosaic | Features]]
_JOINTS = {"PointCloud": Points, "Raster": Mosaic, "Vector": Features}


def _joined(pieces: list[Path]) -> Points | Mosaic | Features:
    """Join stored pieces, by the type of the first."""
    return _JOINTS[tile_store.load_json(pieces[0] / tile_store.LAYER)["type"]](pieces)
