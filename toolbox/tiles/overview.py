"""What a report of a run in tiles shows: few enough points and cells of the whole survey.

Which points are chosen depends on nothing but their place in the files, so the tiles do not show.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.data import Lattice, PointCloud, Raster
from toolbox.data.layer import Layer
from toolbox.reports import counted
from toolbox.reports.counted import Cells
from toolbox.tiles import store as tile_store
from toolbox.tiles.crew import Crew
from toolbox.tiles.products import Mosaic, pieces_of

MOST_POINTS = 1_500_000  # more than a map of a thousand pixels across can show
MOST_CELLS = 2000  # along the longer side of a raster
SPREAD, WIDTH = np.uint64(0x9E3779B97F4A7C15), 64  # the golden ratio of 64 bits (Knuth)


def results(crew: Crew, names: Iterable[str]) -> dict[str, Layer]:
    """The points and rasters that tiles have made for some outputs, thinned."""
    return {
        name: cells(Mosaic(pieces)) if is_gridded else _stored(pieces)
        for name, pieces, is_gridded in _made(crew, names)
    }


def _made(crew: Crew, names: Iterable[str]) -> Iterator[tuple[str, list[Path], bool]]:
    """The pieces of points and rasters that tiles have made, and whether it is a raster."""
    plan = crew.plan
    for name in names:
        result, kind = plan.stored.get(name), plan.model.results[name].kind
        if result is None or result not in plan.keep or not kind.in_blocks:
            continue
        if pieces := pieces_of(crew.folder(plan.keep[result]), result):
            yield name, pieces, kind.is_gridded


def cells_of(crew: Crew, names: Iterable[str]) -> dict[str, Cells]:
    """Figures of the rasters that tiles have made, of all their cells."""
    found: dict[str, Cells] = {}
    for name, pieces, is_gridded in _made(crew, names):
        if is_gridded:
            mosaic = Mosaic(pieces)
            bands = (dataclasses.replace(mosaic.first, values=v).band() for v in mosaic.strips())
            found[name] = Cells.of_parts(mosaic.first, mosaic.lattice, bands)
    return found


def by_class(crew: Crew) -> dict[str, Counter[int]]:
    """Number of points of each class, of all that were read and of all that tiles have made."""
    counts: dict[str, Counter[int]] = {}
    for name, survey in crew.job.surveys.items():
        for folder in sorted((crew.work / "points").glob(f"{name}_*")):
            arrays = tile_store.load_arrays(folder)
            own = {n: values for n, values in arrays.items() if n not in ("origin", "table")}
            cloud = survey.template.with_arrays(own)
            counts[name] = counts.get(name, Counter()) + counted.by_class(cloud)
    for name, pieces, is_gridded in _made(crew, crew.plan.model.outputs):
        if not is_gridded:
            layers = map(tile_store.load_layer, pieces)
            counts[name] = sum(map(counted.by_class, layers), Counter[int]())
    return {name: one for name, one in counts.items() if one}


def sources(crew: Crew) -> dict[str, Layer]:
    """The points that were read, thinned."""
    found: dict[str, Layer] = {}
    for name, survey in crew.job.surveys.items():
        folders = sorted((crew.work / "points").glob(f"{name}_*"))
        clouds = [survey.template.with_arrays(arrays) for arrays in _chosen(folders)]
        whole = survey.template.filled(clouds, sum(map(len, clouds)))
        whole.name = survey.name
        found[name] = whole
    return found


def _stored(pieces: list[Path]) -> PointCloud:
    shells = (tile_store.load_layer(piece, empty=True) for piece in pieces)
    chosen = _chosen(pieces)
    return PointCloud.concat([s.with_arrays(a) for s, a in zip(shells, chosen, strict=True)])


def _chosen(folders: list[Path]) -> list[dict[str, NDArray[Any]]]:
    """The arrays of so many of the points stored in some folders as can be shown."""
    stored = [tile_store.load_arrays(folder) for folder in folders]
    origins = [arrays.pop("origin", None) for arrays in stored]
    sizes = [len(arrays["packed" if "packed" in arrays else "xyz"]) for arrays in stored]
    share = min(1.0, MOST_POINTS / max(sum(sizes), 1))
    chosen = []
    for arrays, origin, size in zip(stored, origins, sizes, strict=True):
        arrays.pop("table", None)
        rows = np.flatnonzero(is_chosen(np.arange(size) if origin is None else origin, share))
        chosen.append({name: np.array(values[rows]) for name, values in arrays.items()})
    return chosen


def is_chosen(origin: NDArray[np.int64], share: float) -> NDArray[np.bool_]:
    """Whether points, given their number in the survey, are among a share of all."""
    if share >= 1:
        return np.ones(len(origin), np.bool_)
    mixed = np.asarray(origin).astype(np.uint64) * SPREAD
    return np.asarray(mixed < np.uint64(share * 2.0**WIDTH))


def cells(mosaic: Mosaic) -> Raster:
    """A raster with every so many cells of the whole one, in both directions."""
    lattice = mosaic.lattice
    step = max(1, math.ceil(max(lattice.rows, lattice.cols) / MOST_CELLS))
    values = np.concatenate(list(_every(mosaic.strips(), step)), axis=1)
    wide = Lattice(
        lattice.west, lattice.north, lattice.cell * step, values.shape[1], values.shape[2]
    )
    return dataclasses.replace(mosaic.first, values=values, transform=wide.transform)


def _every(strips: Iterator[NDArray[Any]], step: int) -> Iterator[NDArray[Any]]:
    row = 0
    for strip in strips:
        yield strip[:, -row % step :: step, ::step]
        row += strip.shape[1]
