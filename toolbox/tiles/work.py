"""What a worker does for a survey in tiles: sort points into buckets, and run the tool on a tile.

All that a worker must know is in the job, which lies in the folder of its pass within the working
folder; its tasks are named by that folder alone. A task whose result is there already is done.
"""

from __future__ import annotations

import itertools
import logging
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray
from pyproj import CRS

from toolbox import catalog
from toolbox.context import Context, log
from toolbox.data import Lattice, PointCloud, Raster, Vector
from toolbox.data.survey import Survey
from toolbox.declare.fields import Field
from toolbox.errors import NothingToDo
from toolbox.models.model import INPUTS, Model, ModelRun
from toolbox.runs.provenance import Count, counted
from toolbox.runs.source import open_source
from toolbox.tiles import store as tile_store
from toolbox.tiles.plan import ALONE, as_model
from toolbox.tiles.store import Batch, Grid

Tile = tuple[int, int]


@dataclass(frozen=True)
class Job:
    """A pass of a tool or model over the survey that it is run on.

    Attributes
    ----------
    id : of the tool or model
    settings : values of its parameters
    layers : other sources, as they were given
    assume_crs : of those that state none
    surveys : point clouds, by the name of the source; the first one has the tiles
    steps : those that are run on tiles
    given : results of steps on the whole, by step.output
    before : for results of tiles in earlier passes, by step.output, the folder of that pass
    keep : results that are stored, by step.output
    las : those of them that become LAS files
    halo : how far beyond a tile its points must be known, in the unit of the coordinates
    """

    id: str
    settings: Mapping[str, Any]
    layers: Mapping[str, Any]
    assume_crs: CRS | None
    surveys: Mapping[str, Survey]
    steps: tuple[str, ...]
    given: Mapping[str, Any]
    before: Mapping[str, Path]
    keep: frozenset[str]
    las: frozenset[str]
    halo: float
    grid: Grid

    @property
    def first(self) -> str:
        """The source whose tiles are run."""
        return next(iter(self.surveys))


@dataclass(frozen=True)
class Result:
    """What a tile gave beside the layers that it stored.

    Attributes
    ----------
    values : numbers, by step.output
    counts : how large the layers of each step were, without what is only near the tile
    said : warnings
    memory : bytes that the worker had needed at most, so far
    """

    values: Mapping[str, Any]
    counts: tuple[Count, ...]
    said: tuple[str, ...]
    memory: int


@lru_cache(maxsize=2)
def opened(home: Path) -> tuple[Job, Model, dict[str, Any]]:
    """The job of a pass, its model, and its other layers."""
    job: Job = tile_store.load_object(home / "job")
    model = as_model(catalog.load(job.id))
    layers = {n: open_source(model.inputs[n], v, job.assume_crs) for n, v in job.layers.items()}
    return job, model, layers


def points_of(home: Path) -> Path:
    """Where the points are that all passes share."""
    return home.parent / "points"


def split(home: Path, batch: Batch) -> NDArray[np.int64]:
    """Store a batch of points by bucket; see :func:`tile_store.split`."""
    job, _, _ = opened(home)
    return tile_store.split(job.surveys[batch.source], batch, job.grid, points_of(home))


def run_tile(home: Path, tile: Tile, batches: tuple[Batch, ...]) -> Result:
    """Run the local steps on one tile and store what they give in its core."""
    place = home / "tiles" / name_of(tile)
    if place.exists():
        found: Result = tile_store.load_object(place / "result")
        return found
    job, model, layers = opened(home)
    needs = {need for name in job.steps for need in model.steps[name].needs}
    clouds = {
        name: _gathered(job, name, tile, batches, points_of(home))
        for name in job.surveys
        if f"{INPUTS}.{name}" in needs
    }
    pieces = {name: _earlier(job, tile, folder, name) for name, folder in job.before.items()}
    first = clouds.get(job.first, next(iter(pieces.values()), None))
    with _said() as said, tile_store.whole(place) as draft:
        values = dict.fromkeys(model.sources) | dict(job.settings) | layers | clouds
        counts: list[Count] = []
        given = {**job.given, **pieces}
        results = _results(job, model, values, given, tile, counts) if first else {}
        numbers = {name: v for name, v in results.items() if isinstance(v, float | int)}
        for name in results.keys() - numbers.keys():
            _store(draft / name, _cropped(job, tile, results[name]), las=name in job.las)
        made = Result(numbers, tuple(counts), tuple(said), _peak())
        tile_store.save_object(draft / "result", made)
    return made


def name_of(tile: Tile) -> str:
    return f"{tile[0]}_{tile[1]}"


def _gathered(
    job: Job, source: str, tile: Tile, batches: tuple[Batch, ...], points: Path
) -> PointCloud:
    """The points of a tile and its surroundings; what is only a neighbour has an origin < 0."""
    parts = [batch for batch in batches if batch.source == source]
    bounds = job.grid.bounds(tile, job.halo)
    cloud = tile_store.gather(job.surveys[source], parts, bounds, job.grid, points)
    core = job.grid.holds(tile, cloud.xyz[:, :2])
    origin = cloud.origin
    assert origin is not None
    cloud = cloud.with_file(job.surveys[source].file_of(origin))
    return cloud.with_origin(np.where(core, origin, -1 - origin))


def _earlier(job: Job, tile: Tile, folder: Path, name: str) -> PointCloud | None:
    """What an earlier pass has given in a tile and its surroundings; None if there is nothing."""
    reach = math.ceil(job.halo / job.grid.size)
    rows, cols = (range(k - reach, k + reach + 1) for k in tile)
    places = [folder / "tiles" / name_of(near) / name for near in itertools.product(rows, cols)]
    cloud = tile_store.joined([p for p in places if p.exists()], job.grid.bounds(tile, job.halo))
    if cloud is None or cloud.origin is None:
        return cloud
    core = job.grid.holds(tile, cloud.xyz[:, :2])
    origin = cloud.origin
    cloud = cloud.with_file(job.surveys[job.first].file_of(origin))
    return cloud.with_origin(np.where(core, origin, -1 - origin))


def _results(
    job: Job, model: Model, values: Mapping[str, Any], given: Mapping[str, Any], tile: Tile,
    counts: list[Count],
) -> dict[str, Any]:  # fmt: skip
    """What the local steps give, by step.output."""

    def runner(name: str, tool: Any, ctx: Context) -> Any:
        step = tool.spec.id if name == ALONE else name
        result = _result(tool, ctx)
        counts.extend(_counts(job, tile, step, tool.spec.sources, tool))
        counts.extend(_counts(job, tile, step, tool.spec.outputs, result))
        return result

    part = model.subset(job.steps)
    run = ModelRun(part, values, keep=job.keep, given=given, runner=runner, gaps=True)
    result = run.run(Context(window=job.grid.bounds(tile, job.halo)))
    return {name: getattr(result, name) for name in sorted(job.keep)}


def _result(tool: Any, ctx: Context) -> Any:
    """What a tool gives; in a tile that has nothing for it, what it says instead."""
    try:
        return tool.run(ctx)
    except NothingToDo as err:
        if err.instead is not None:
            return err.instead
        return SimpleNamespace(**dict.fromkeys(tool.spec.outputs))


def _counts(
    job: Job, tile: Tile, step: str, fields: Mapping[str, Field], holder: Any
) -> Iterator[Count]:
    """How large the layers of a step are within the tile."""
    for name in fields:
        layer = getattr(holder, name)
        if isinstance(layer, PointCloud):
            yield Count(step, name, int(np.count_nonzero(_core(job, tile, layer))))
        else:
            cropped = SimpleNamespace(**{name: _cropped(job, tile, layer)})
            yield from counted(step, {name: fields[name]}, cropped)


def _core(job: Job, tile: Tile, cloud: PointCloud) -> NDArray[np.bool_]:
    """The points that belong to the tile: for new ones their place decides."""
    return cloud.core if cloud.origin is not None else job.grid.holds(tile, cloud.xyz[:, :2])


def _cropped(job: Job, tile: Tile, layer: Any) -> Any:
    """The part of a layer that belongs to the tile; None if there is none."""
    if isinstance(layer, PointCloud):
        return layer.select(_core(job, tile, layer))
    if isinstance(layer, Raster):
        return _cropped_raster(layer, job.grid, tile)
    if isinstance(layer, Vector):
        box = layer.frame.geometry.bounds.to_numpy()  # of a feature, the middle of its box decides
        middle = (box[:, :2] + box[:, 2:]) / 2
        inside = job.grid.holds(tile, middle)
        return Vector(layer.frame[inside], name=layer.name, geometry_type=layer.geometry_type)
    return None


def _cropped_raster(raster: Raster, grid: Grid, tile: Tile) -> Raster | None:
    """The cells whose centres are in the tile."""
    x, y = Lattice.of(raster).centres()
    middle = np.array(tile) * grid.size + grid.size / 2
    cols = np.flatnonzero(grid.holds(tile, np.column_stack([x, np.full(len(x), middle[0])])))
    rows = np.flatnonzero(grid.holds(tile, np.column_stack([np.full(len(y), middle[1]), y])))
    if not (len(rows) and len(cols)):
        return None
    return raster.window(slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1))


def _store(place: Path, layer: Any, *, las: bool) -> None:
    """Store a piece of a layer: what there is many of as arrays, apart from the rest."""
    if layer is None:
        return
    place.mkdir()
    if isinstance(layer, PointCloud):
        tile_store.save_points(place, layer.read_back() if las else layer)
    elif isinstance(layer, Raster):
        tile_store.save_arrays(place, {"values": layer.values})
        tile_store.save_object(place / "layer", layer.window(slice(0, 1), slice(0, 1)))
    else:
        tile_store.save_object(place / "layer", layer)


@contextmanager
def _said() -> Iterator[list[str]]:
    """Collect the warnings of the library; a worker has nobody to tell."""
    texts: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            texts.append(record.getMessage())

    handler = Collector(logging.WARNING)
    log.addHandler(handler)
    propagates, log.propagate = log.propagate, False
    try:
        yield texts
    finally:
        log.removeHandler(handler)
        log.propagate = propagates


def _peak() -> int:
    """Bytes that this process has needed at most."""
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
