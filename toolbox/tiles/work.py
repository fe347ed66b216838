"""The tasks of a worker: store a block of points, and run the local steps on one tile.

A worker is given the job of a pass once, with all that it must know. A task whose result is stored
already is not done again.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray
from pyproj import CRS

from toolbox import catalog
from toolbox.context import Context, listening
from toolbox.data import PointCloud
from toolbox.data.layer import Inside, Layer
from toolbox.data.survey import Survey
from toolbox.declare.values import Share
from toolbox.errors import NothingToDo
from toolbox.models.model import INPUTS, Model, ModelRun, references
from toolbox.reports.page import told_by
from toolbox.runs.lineage import counted
from toolbox.runs.provenance import Count
from toolbox.runs.source import Sources, open_all
from toolbox.tiles import store as tile_store
from toolbox.tiles.plan import ALONE, as_model
from toolbox.tiles.store import FileBlock, TileGrid

Tile = tuple[int, int]
EXACT = " exact"  # after the name of points that a LAS file would round: for the steps that follow


@dataclass(frozen=True)
class TileJob:
    """All that a worker must know to run one pass of a tool or model on a tile.

    Attributes
    ----------
    folder : of the pass
    id : of the tool or model
    settings : values of its parameters
    sources : the layers that are not cut into tiles
    assume_crs : CRS of the sources that state none
    surveys : point clouds by source; the tiles are those of the first one
    steps : the steps to run on each tile
    given : results of steps on the whole survey, by step.output
    before : for each result of an earlier pass, by step.output, the folder of that pass
    keep : the results to store, by step.output
    las : those of `keep` that become LAS files
    halo : distance beyond a tile within which its steps need points, in coordinate units
    """

    folder: Path
    id: str
    settings: Mapping[str, Any]
    sources: Sources
    assume_crs: CRS | None
    surveys: Mapping[str, Survey]
    steps: tuple[str, ...]
    given: Mapping[str, Any]
    before: Mapping[str, Path]
    keep: frozenset[str]
    las: frozenset[str]
    halo: float
    grid: TileGrid

    @property
    def first(self) -> str:
        """The source whose survey is cut into tiles."""
        return next(iter(self.surveys))

    @property
    def points(self) -> Path:
        """The folder of the stored points, which all passes share."""
        return self.folder.parent / "points"

    @cached_property
    def model(self) -> Model:
        """The model, or the tool as one."""
        return as_model(catalog.load(self.id))

    @cached_property
    def layers(self) -> dict[str, Any]:
        """The layers that are not cut into tiles, opened."""
        inputs, items = self.model.inputs, self.sources.items()
        return {name: open_all(inputs[name], given, self.assume_crs) for name, given in items}


@dataclass(frozen=True)
class Result:
    """The numbers and messages of one tile; its layers are stored on disk.

    Attributes
    ----------
    values : numbers, by step.output
    counts : sizes of the layers of each step, within the tile
    said : warnings
    unseen : what the steps did not look at
    empty : why steps had nothing to do, for want of data
    memory : peak memory of the worker so far, bytes
    """

    values: Mapping[str, Any]
    counts: tuple[Count, ...]
    said: tuple[str, ...]
    unseen: tuple[str, ...]
    empty: tuple[str, ...]
    memory: int

    def to_json(self) -> dict[str, Any]:
        """What :meth:`from_json` makes a result of."""
        values = {
            name: [value.count, value.total] if isinstance(value, Share) else value
            for name, value in self.values.items()
        }
        return asdict(self) | {"values": values}

    @classmethod
    def from_json(cls, given: Mapping[str, Any]) -> Result:
        """The result that was stored."""
        values = {
            name: Share(*value) if isinstance(value, list) else value
            for name, value in given["values"].items()
        }
        counts = tuple(Count(**count) for count in given["counts"])
        said, unseen, empty = (tuple(given[name]) for name in ("said", "unseen", "empty"))
        return cls(values, counts, said, unseen, empty, given["memory"])


@dataclass
class _Notes:
    """What the steps of a tile leave beside their results, as :class:`Result` has it."""

    counts: list[Count] = field(default_factory=list)
    unseen: list[str] = field(default_factory=list)
    empty: list[str] = field(default_factory=list)


def split(job: TileJob, block: FileBlock) -> NDArray[np.int64]:
    """Store a block of points sorted by bucket; see :func:`toolbox.tiles.store.split`."""
    return tile_store.split(job.surveys[block.source], block, job.grid, job.points)


def run_tile(job: TileJob, tile: Tile, blocks: tuple[FileBlock, ...]) -> Result:
    """Run the local steps on one tile and its neighbourhood, and store the results in the tile."""
    path = job.folder / "tiles" / name_of(tile)
    if path.exists():
        return Result.from_json(tile_store.load_json(path / "result.json"))
    model = job.model
    pieces = {name: _earlier(job, tile, made_in, name) for name, made_in in job.before.items()}
    needs = _needs(job, {**job.given, **pieces})
    clouds = {
        name: _gathered(job, name, tile, blocks)
        for name in job.surveys
        if f"{INPUTS}.{name}" in needs
    }
    first = clouds.get(job.first, next((c for c in pieces.values() if c is not None), None))
    # A worker cannot show them to the user.
    with listening(aloud=False) as said, tile_store.whole(path) as draft:
        values = dict.fromkeys(model.sources) | dict(job.settings) | job.layers | clouds
        notes = _Notes()
        given = {**job.given, **pieces}
        results = _results(job, model, values, given, tile, notes) if first else {}
        numbers = {name: v for name, v in results.items() if isinstance(v, float | int)}
        for name, result in results.items():
            if result is not None and model.between[name].kind.is_layer:
                _store(draft / name, result, job.grid.inside(tile), las=name in job.las)
        unseen, empty = tuple(notes.unseen), tuple(notes.empty)
        made = Result(numbers, tuple(notes.counts), tuple(said), unseen, empty, _peak())
        tile_store.save_json(draft / "result.json", made.to_json())
    return made


def name_of(tile: Tile) -> str:
    return f"{tile[0]}_{tile[1]}"


def _needs(job: TileJob, found: Mapping[str, Any]) -> set[str]:
    """What the steps of a pass refer to, but for what stands in for a result that is there."""
    needs: set[str] = set()
    links = [link for name in job.steps for link in job.model.steps[name].links.values()]
    for reference in itertools.chain(*map(references, links)):
        there = (k for k, name in enumerate(reference.names) if found.get(name) is not None)
        needs.update(reference.names[: next(there, len(reference.names))])
    return needs


def _gathered(job: TileJob, source: str, tile: Tile, blocks: tuple[FileBlock, ...]) -> PointCloud:
    """The points of a tile and its neighbourhood."""
    own = [block for block in blocks if block.source == source]
    bounds = job.grid.bounds(tile, job.halo)
    cloud = tile_store.gather(job.surveys[source], own, bounds, job.grid, job.points)
    return _with_core(job, source, tile, cloud)


def _earlier(job: TileJob, tile: Tile, folder: Path, name: str) -> PointCloud | None:
    """The points that an earlier pass made in a tile and its neighbourhood; None without any."""
    reach = math.ceil(job.halo / job.grid.size)
    rows, cols = (range(k - reach, k + reach + 1) for k in tile)
    tiles = [folder / "tiles" / name_of(near) for near in itertools.product(rows, cols)]
    folders = [
        tile / (name + EXACT if (tile / (name + EXACT)).exists() else name) for tile in tiles
    ]
    cloud = tile_store.joined([f for f in folders if f.exists()], job.grid.bounds(tile, job.halo))
    if (
        cloud is None or cloud.origin is None
    ):  # points that a step made, as tops of trees, have none
        return cloud
    return _with_core(job, job.first, tile, cloud)


def _with_core(job: TileJob, source: str, tile: Tile, cloud: PointCloud) -> PointCloud:
    """The points, marked by the sign of their origin: in the tile, or around it.

    The point k of the survey has the origin k in its tile, and -1 - k (below 0 for all k) in the
    neighbourhoods of others: what a step says of a point counts in one tile alone.
    """
    origin = cloud.origin
    assert origin is not None
    inside = job.grid.holds(tile, cloud.xyz[:, :2])
    cloud = cloud.with_file(job.surveys[source].file_of(origin))
    return cloud.with_origin(np.where(inside, origin, -1 - origin))


def _results(
    job: TileJob,
    model: Model,
    values: Mapping[str, Any],
    given: Mapping[str, Any],
    tile: Tile,
    notes: _Notes,
) -> dict[str, Any]:
    """Run the local steps on a tile and give their results, by step.output."""
    inside = job.grid.inside(tile)

    def runner(name: str, tool: Any, ctx: Context) -> Any:
        step = tool.spec.id if name == ALONE else name
        result = _result(tool, ctx, notes.empty)
        notes.counts.extend(counted(step, tool.spec.sources, tool, inside))
        notes.counts.extend(counted(step, tool.spec.outputs, result, inside))
        if not isinstance(result, SimpleNamespace):  # of a tile without data
            notes.unseen.extend(told_by(tool.spec, result)[1])
        return result

    local = model.subset(job.steps)
    run = ModelRun(local, values, keep=job.keep, given=given, runner=runner, gaps=True)
    result = run.run(Context(window=job.grid.bounds(tile, job.halo)))
    return {name: getattr(result, name) for name in sorted(job.keep)}


def _result(tool: Any, ctx: Context, empty: list[str]) -> Any:
    """Run a tool; in a tile without data for it, note why, and give what it names instead."""
    try:
        return tool.run(ctx)
    except NothingToDo as err:
        empty.append(str(err))
        if err.instead is not None:
            return err.instead
        return SimpleNamespace(**dict.fromkeys(tool.spec.outputs))


def _store(folder: Path, layer: Layer, inside: Inside, *, las: bool) -> None:
    """Store the piece of a layer in a tile, if there is any; points as LAS would hold them.

    Where LAS would round them, as those of a text file, steps that follow take them unrounded.
    """
    piece: Any = layer.cropped(inside)
    if piece is None:
        return
    if not las:
        tile_store.save_layer(folder, piece)
        return
    held = piece.read_back()
    tile_store.save_layer(folder, held)
    if "xyz" in piece.arrays() and not np.array_equal(held.xyz, piece.xyz):
        tile_store.save_layer(folder.with_name(folder.name + EXACT), piece)


def _peak() -> int:
    """The peak memory of this process, bytes."""
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
