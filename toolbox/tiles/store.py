"""Stores the points of a survey sorted by position, so that a tile reads no more than it needs.

A bucket is a square of the plane; a tile consists of SIDE x SIDE buckets. Each block of points is
read once and stored sorted by bucket, with the index of each point in the survey, its origin.
A stored folder appears under its name only when it is complete, so that a later run can continue
one that was killed. It holds arrays and JSON: whatever somebody has put there, reading it runs no
code.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from toolbox import files
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Raster, Vector
from toolbox.data.layer import Inside, Layer
from toolbox.data.survey import Survey
from toolbox.errors import DataError

SIDE = 8  # buckets along the side of a tile
LAYER = "layer.json"  # all of a stored layer but its arrays
BOXES = "runs/boxes.npy"  # of each RUN points; apart from the arrays, whose names are anything
RUN = 1024  # points that follow each other in a file, as a rule near each other
_TYPES: Mapping[str, type[PointCloud | Raster | Vector]]
_TYPES = {made.__name__: made for made in (PointCloud, Raster, Vector)}

Box = tuple[float, float, float, float]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class TileGrid:
    """The grid of square tiles, whose corners are whole multiples of their size.

    Attributes
    ----------
    size : side of a tile, in the unit of the coordinates
    """

    size: float

    def bounds(self, tile: tuple[int, int], halo: float = 0.0) -> Box:
        """xmin, ymin, xmax, ymax of the tile in this row and column, widened by a halo."""
        row, col = tile
        west, south = col * self.size, row * self.size
        return west - halo, south - halo, west + self.size + halo, south + self.size + halo

    def buckets(self, xy: NDArray[np.float64]) -> Indices:
        """Row and column of the bucket of each point: array of shape (n, 2)."""
        return np.floor(xy[:, ::-1] * (SIDE / self.size)).astype(np.int64)

    def holds(self, tile: tuple[int, int], xy: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Mask of the points, of shape (n, 2), in a tile; its west and south edges belong to it."""
        inside = self.inside(tile)
        return inside(xy[:, 0], 0) & inside(xy[:, 1], 1)

    def inside(self, tile: tuple[int, int]) -> Inside:
        """Give a function that tells which coordinates along an axis are those of a tile."""

        def holds(values: NDArray[np.float64], axis: int) -> NDArray[np.bool_]:
            places, first = values * (SIDE / self.size), SIDE * tile[1 - axis]
            return np.asarray((places >= first) & (places < first + SIDE))  # as `buckets` has it

        return holds


@dataclass(frozen=True)
class FileBlock:
    """A block of the points of one file of a survey: from start up to, but without, stop.

    Attributes
    ----------
    source : the parameter that takes the survey
    file : index of the file in the survey
    first : number of points of the survey before this block
    """

    source: str
    file: int
    start: int
    stop: int
    first: int

    @property
    def name(self) -> str:
        return f"{self.source}_{self.file}_{self.start}"


def blocks(source: str, survey: Survey, file: int, size: int) -> list[FileBlock]:
    """Cut the points of a file of a survey into blocks of at most `size` points.

    Raises
    ------
    DataError
        The file is damaged.
    """
    before = sum(other.count for other in survey.files[:file])
    cuts = survey.files[file].ranges(size)
    return [FileBlock(source, file, start, stop, before + start) for start, stop in cuts]


def split(
    survey: Survey, block: FileBlock, grid: TileGrid, folder: Path, ctx: Context = QUIET
) -> Indices:
    """Read a block of points and store it sorted by bucket, unless it is stored already.

    Returns
    -------
    array of shape (m, 3)
        Row, column and number of points of each bucket that has any.
    """
    path = folder / block.name
    if not path.exists():
        cloud = survey.files[block.file].read(block.start, block.stop, ctx=ctx)
        cloud = cloud.like(survey.template)
        if not np.isfinite(cloud.xyz).all():
            raise DataError(f"{cloud.name} has coordinates that are no finite numbers")
        buckets = grid.buckets(cloud.xyz[:, :2])
        order = np.lexsort((buckets[:, 1], buckets[:, 0]))
        buckets = buckets.take(order, axis=0)
        starts = np.flatnonzero(
            np.r_[True, (buckets[1:] != buckets[:-1]).any(axis=1)][: len(order)]
        )
        table = np.column_stack([buckets[starts], np.diff(starts, append=len(order))])
        arrays = cloud.select(order).arrays() | {"origin": block.first + order, "table": table}
        with whole(path) as draft:
            save_arrays(draft, arrays)
    with sound(path):
        stored: Indices = np.load(path / "table.npy")
        if stored[:, 2].sum() != len(np.load(path / "origin.npy", mmap_mode="r")):
            raise ValueError("it has another number of points")
    return stored


def gather(
    survey: Survey, blocks: Iterable[FileBlock], bounds: Box, grid: TileGrid, folder: Path
) -> PointCloud:
    """Read the points within bounds, edges included, in the order of the survey.

    Parameters
    ----------
    blocks : stored blocks that may have points there
    """
    low, high = grid.buckets(np.reshape(bounds, (2, 2)))
    clouds: list[PointCloud] = []
    for block in blocks:
        with sound(folder / block.name):
            arrays = load_arrays(folder / block.name)
            for rows in _row_slices(arrays.pop("table"), low, high):
                columns = {name: values[rows] for name, values in arrays.items()}
                origin = columns.pop("origin")
                clouds.append(survey.template.with_arrays(columns).with_origin(origin))
    joint = survey.template.filled(clouds, sum(map(len, clouds)))
    return in_order(joint.with_origin(_origins(clouds)), np.flatnonzero(joint.inside(bounds)))


@contextmanager
def sound(folder: Path) -> Iterator[None]:
    """Name the folder of what an earlier run has stored, if it is not as it was.

    Raises
    ------
    DataError
        Something of it cannot be read, is missing, or does not fit the rest.
    """
    try:
        yield
    except DataError:
        raise
    except (ValueError, KeyError, TypeError, IndexError, EOFError) as err:
        text = f"{folder} is damaged ({err}); remove it, and what it holds is made again"
        raise DataError(text) from err


def in_order(cloud: PointCloud, which: Indices) -> PointCloud:
    """Some points of a cloud, given by index, sorted by their origin in the survey.

    What is stored consists of runs that are in order, which a stable sort merges.
    """
    assert cloud.origin is not None
    return cloud.select(which[np.argsort(cloud.origin[which], kind="stable")])


def _origins(clouds: Iterable[PointCloud]) -> Indices:
    found = [cloud.origin for cloud in clouds if cloud.origin is not None]
    return np.concatenate([*found, np.empty(0, np.int64)])


def save_layer(folder: Path, layer: Layer) -> None:
    """Store a layer in a new folder: points, cells and geometries as arrays, all else as JSON."""
    folder.mkdir()
    arrays, rest = layer.apart()
    save_arrays(folder, arrays)
    save_json(folder / LAYER, {"type": type(layer).__name__} | rest)
    if isinstance(layer, PointCloud):
        (folder / BOXES).parent.mkdir()
        np.save(folder / BOXES, layer.boxes(RUN))


def load_layer(folder: Path, *, empty: bool = False) -> Any:
    """Open a stored layer; only the values that are used are read from disk.

    Parameters
    ----------
    empty : give points without any of them
    """
    with sound(folder):
        rest, arrays = load_json(folder / LAYER), load_arrays(folder)
        if empty:
            arrays = {name: values[:0] for name, values in arrays.items() if name != "origin"}
        return _TYPES[rest["type"]].of_parts(arrays, rest)


def box_of(folder: Path) -> NDArray[np.float64]:
    """Lowest and highest coordinates of stored points, of shape (2, 3); NaN without points."""
    return np.array(load_json(folder / LAYER)["box"], np.float64)


def joined(folders: Iterable[Path], bounds: Box) -> PointCloud | None:
    """Read the stored points within bounds, in the order of the survey; None if there are none."""
    clouds: list[PointCloud] = []
    for folder in folders:
        box = box_of(folder)
        if (box[0, :2] <= bounds[2:]).all() and (box[1, :2] >= bounds[:2]).all():
            with sound(folder):
                clouds.append(_near(load_layer(folder), np.load(folder / BOXES), bounds))
    if not any(map(len, clouds)):
        return None
    joint = PointCloud.concat(clouds)
    if any(cloud.origin is None for cloud in clouds):  # points that a step made
        return joint.with_origin(None)
    return in_order(joint.with_origin(_origins(clouds)), np.arange(len(joint)))


def _near(cloud: PointCloud, boxes: NDArray[np.float64], bounds: Box) -> PointCloud:
    """The points within bounds: only those of runs that lie across them are looked at."""
    low, high = boxes[:, :2], boxes[:, 2:]
    meets = ((low <= bounds[2:]) & (high >= bounds[:2])).all(axis=1)
    within = ((low >= bounds[:2]) & (high <= bounds[2:])).all(axis=1)
    kept = np.repeat(within, RUN)[: len(cloud)]
    looked_at = np.flatnonzero(np.repeat(meets & ~within, RUN)[: len(cloud)])
    kept[looked_at] = cloud.select(looked_at).inside(bounds)
    return cloud if kept.all() else cloud.select(kept)


def _row_slices(table: Indices, low: Indices, high: Indices) -> Iterator[slice]:
    """The rows of the stored points in the buckets from low to high: a slice per row of buckets."""
    ends = np.cumsum(table[:, 2])
    inside = ((table[:, :2] >= low) & (table[:, :2] <= high)).all(axis=1)
    chosen = np.flatnonzero(inside)
    breaks = np.flatnonzero(np.diff(chosen) > 1) + 1
    for group in np.split(chosen, breaks) if len(chosen) else ():
        yield slice(int(ends[group[0]] - table[group[0], 2]), int(ends[group[-1]]))


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Give a temporary folder to write into, and rename it to `path` when all is written."""
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir(parents=True)
    try:
        yield draft
        shutil.rmtree(path, ignore_errors=True)
        draft.replace(path)
    except OSError as err:
        full = "; the disk is full" if files.is_full(draft) else ""
        raise DataError(f"{path} cannot be written: {err}{full}") from err
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def sweep(folder: Path) -> None:
    """Remove unfinished folders of processes that died; no other process may write there."""
    for draft in folder.glob(".*"):
        shutil.rmtree(draft, ignore_errors=True)


def save_arrays(folder: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write each array to a file of its own."""
    for name, values in arrays.items():
        np.save(folder / f"{quote(name, safe=' ')}.npy", values, allow_pickle=False)


def load_arrays(folder: Path) -> dict[str, NDArray[Any]]:
    """Open the arrays of a folder; only the values that are used are read from disk."""
    paths = sorted(folder.glob("*.npy"))
    return {unquote(path.stem): np.load(path, mmap_mode="r") for path in paths}


def save_json(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, default=_of_numpy), encoding="utf-8")


def load_json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _of_numpy(value: Any) -> Any:
    """The Python value of a number of numpy."""
    return value.item()
