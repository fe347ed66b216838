"""Points of a survey on disk, sorted into buckets, so that a tile reads no more than it needs.

A bucket is a square of the plane; a tile is SIDE x SIDE of them. Each batch of points is read from
its file once and stored sorted by bucket, with the place of each point in the survey. Whatever is
stored appears under its name whole or not at all, so that a run can go on where another was killed.
"""

from __future__ import annotations

import os
import pickle
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox import files
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud
from toolbox.data.survey import Survey
from toolbox.errors import DataError

SIDE = 8  # buckets along the side of a tile

Box = tuple[float, float, float, float]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Grid:
    """Square tiles whose corners are whole multiples of their size.

    Attributes
    ----------
    size : of a tile, in the unit of the coordinates
    """

    size: float

    def bounds(self, tile: tuple[int, int], halo: float = 0.0) -> Box:
        """xmin, ymin, xmax, ymax of the tile in this row and column, grown by a halo."""
        row, col = tile
        west, south = col * self.size, row * self.size
        return west - halo, south - halo, west + self.size + halo, south + self.size + halo

    def buckets(self, xy: NDArray[np.float64]) -> Indices:
        """Row and column, of shape (n, 2), of the bucket that holds each point."""
        return np.floor(xy[:, ::-1] * (SIDE / self.size)).astype(np.int64)

    def holds(self, tile: tuple[int, int], xy: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which points of shape (n, 2) are in a tile, which has its west and south edge."""
        return np.asarray((self.buckets(xy) // SIDE == tile).all(axis=1))


@dataclass(frozen=True)
class Batch:
    """Points start to before stop of a file of a survey.

    Attributes
    ----------
    source : the parameter that the survey is given for
    file : number of the file
    first : how many points of the survey come before
    """

    source: str
    file: int
    start: int
    stop: int
    first: int

    @property
    def name(self) -> str:
        return f"{self.source}_{self.file}_{self.start}"


def batches(source: str, survey: Survey, file: int, size: int) -> list[Batch]:
    """All points of a file of a survey, cut so that each batch can be read in bounded memory.

    Raises
    ------
    DataError
        The file is damaged.
    """
    before = sum(other.count for other in survey.files[:file])
    cuts = survey.files[file].ranges(size)
    return [Batch(source, file, start, stop, before + start) for start, stop in cuts]


def split(survey: Survey, batch: Batch, grid: Grid, folder: Path, ctx: Context = QUIET) -> Indices:
    """Store a batch sorted by bucket.

    Returns
    -------
    array of shape (m, 3)
        Row and column of each bucket with points, and the number of these.
    """
    place = folder / batch.name
    if not place.exists():
        cloud = survey.files[batch.file].read(batch.start, batch.stop, ctx=ctx)
        cloud = cloud.like(survey.template)
        if not np.isfinite(cloud.xyz).all():
            raise DataError(f"{cloud.name} has coordinates that are no finite numbers")
        buckets = grid.buckets(cloud.xyz[:, :2])
        order = np.lexsort((buckets[:, 1], buckets[:, 0]))
        buckets = buckets[order]
        starts = np.flatnonzero(
            np.r_[True, (buckets[1:] != buckets[:-1]).any(axis=1)][: len(order)]
        )
        table = np.column_stack([buckets[starts], np.diff(starts, append=len(order))])
        arrays = cloud.select(order).arrays() | {"origin": batch.first + order, "table": table}
        with whole(place) as draft:
            save_arrays(draft, arrays)
    stored: Indices = np.load(place / "table.npy")
    return stored


def gather(
    survey: Survey, parts: Iterable[Batch], bounds: Box, grid: Grid, folder: Path
) -> PointCloud:
    """The points within bounds, edges included, in the order of the survey, with their origin.

    Parameters
    ----------
    parts : the batches that may have points there
    """
    low, high = grid.buckets(np.reshape(bounds, (2, 2)))
    clouds: list[PointCloud] = []
    origins: list[Any] = []
    for batch in parts:
        arrays = load_arrays(folder / batch.name)
        for rows in _runs(arrays.pop("table"), low, high):
            part = {name: np.array(values[rows]) for name, values in arrays.items()}
            origin = part.pop("origin")
            cloud = survey.template.with_arrays(part).with_origin(origin).within(bounds)
            clouds.append(cloud)
            origins.append(cloud.origin)
    joint = survey.template.filled(clouds, sum(map(len, clouds)))
    return in_order(joint, np.concatenate([*origins, np.empty(0, np.int64)]))


def in_order(cloud: PointCloud, origin: Indices) -> PointCloud:
    """Points in the order of the survey, given the place there of each."""
    order = np.argsort(origin)
    return cloud.select(order).with_origin(origin[order])


def save_points(place: Path, cloud: PointCloud) -> None:
    """Store points: what there is many of as arrays, apart from the rest."""
    origin = {} if cloud.origin is None else {"origin": cloud.origin}
    save_arrays(place, cloud.arrays() | origin)
    box = np.reshape(cloud.bounds, (2, 3))
    save_object(place / "layer", (cloud.select([]).with_origin(None), box))


def joined(places: Iterable[Path], bounds: Box) -> PointCloud | None:
    """Those of stored points within bounds, in the order of the survey; None if there are none."""
    clouds: list[PointCloud] = []
    for place in places:
        shell, box = load_object(place / "layer")
        if (box[0, :2] <= bounds[2:]).all() and (box[1, :2] >= bounds[:2]).all():
            arrays = load_arrays(place)
            origin = arrays.pop("origin", None)
            clouds.append(shell.with_arrays(arrays).with_origin(origin).within(bounds))
    if not any(map(len, clouds)):
        return None
    origins = [cloud.origin for cloud in clouds if cloud.origin is not None]
    joint = PointCloud.concat(clouds).with_origin(None)
    return in_order(joint, np.concatenate(origins)) if len(origins) == len(clouds) else joint


def _runs(table: Indices, low: Indices, high: Indices) -> Iterator[slice]:
    """The stored points of buckets from low to high: one slice per row of buckets."""
    ends = np.cumsum(table[:, 2])
    inside = ((table[:, :2] >= low) & (table[:, :2] <= high)).all(axis=1)
    chosen = np.flatnonzero(inside)
    breaks = np.flatnonzero(np.diff(chosen) > 1) + 1
    for group in np.split(chosen, breaks) if len(chosen) else ():
        yield slice(int(ends[group[0]] - table[group[0], 2]), int(ends[group[-1]]))


@contextmanager
def whole(place: Path) -> Iterator[Path]:
    """A folder to write into, which is moved to its place when all is written."""
    draft = place.with_name(f".{place.name}.{os.getpid()}")
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir(parents=True)
    try:
        yield draft
        shutil.rmtree(place, ignore_errors=True)
        draft.replace(place)
    except OSError as err:
        full = "; the disk is full" if files.is_full(draft) else ""
        raise DataError(f"{place} cannot be written: {err}{full}") from err
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def sweep(folder: Path) -> None:
    """Remove what was being written when its writer died; nobody else may be at work there."""
    for draft in folder.glob(".*"):
        shutil.rmtree(draft, ignore_errors=True)


def save_arrays(folder: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write each array as a file of its own."""
    for name, values in arrays.items():
        np.save(folder / f"{name}.npy", values)


def load_arrays(folder: Path) -> dict[str, NDArray[Any]]:
    """The arrays of a folder, of which only what is used will be read."""
    return {path.stem: np.load(path, mmap_mode="r") for path in sorted(folder.glob("*.npy"))}


def save_object(path: Path, value: Any) -> None:
    with path.open("wb") as stream:
        pickle.dump(value, stream)


def load_object(path: Path) -> Any:
    with path.open("rb") as stream:
        return pickle.load(stream)
