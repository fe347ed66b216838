"""Run a tool or model on a survey of any size: tile by tile, on the workers of a Dask cluster.

1. Each file is read once, and its points are stored sorted by position (`toolbox.tiles.store`).
2. The local steps run on each tile and its neighbourhood, whose width is the `halo()` of the tool,
   and their results are cut to the tile (`toolbox.tiles.work`). Steps that need the whole survey
   run in this process, on the joined results of the tiles. Steps that need their results run in
   another pass over the tiles (`toolbox.tiles.plan`).
3. The pieces of all tiles are joined to one product each (`toolbox.tiles.products`).

The intermediate files lie in a working folder beside the first output, with which `--resume`
continues a run that was stopped. They take as much space as all points and all results together.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
import operator
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray
from pyproj import CRS

from toolbox import files
from toolbox.catalog import MODEL
from toolbox.context import Context, log
from toolbox.data import Survey
from toolbox.declare.fields import Spec
from toolbox.declare.values import Share
from toolbox.errors import DataError, ParameterError, ToolboxError
from toolbox.models.model import INPUTS, Model, ModelRun, reads_batches, resolved
from toolbox.runs.cache import code_of
from toolbox.runs.provenance import Count, Record, counting
from toolbox.runs.source import Sources
from toolbox.runs.target import Target, write
from toolbox.runs.target import problems as targets_problems
from toolbox.shown import SHOWN
from toolbox.tiles import products as tile_products
from toolbox.tiles import store as tile_store
from toolbox.tiles import work as tile_work
from toolbox.tiles.cluster import client_of, memory_of
from toolbox.tiles.plan import TilePlan, as_model, surveys_of
from toolbox.tiles.products import StoredSurvey
from toolbox.tiles.store import SIDE, FileBlock, TileGrid
from toolbox.tiles.tiling import Tiling
from toolbox.tiles.work import Tile, TileJob

BLOCK = 2_000_000  # points that are read and sorted at a time
BYTES_PER_POINT = 400  # that the hungriest tools need for a tile with its neighbours
SLACK, NEAR = 1 + 1e-9, 1e-6  # of the halo, and metres: what lies on its edge is not lost
SMALLEST, MOST_TILES = 0.1, 10**6  # metres; more are taken for a mistake in the size
RIM = 40.0  # metres that a raster may reach beyond all points: whole blocks of its cells
LISTED = 10  # problems and warnings that are listed
STORED, DONE = 0.1, 0.9  # of the progress, when all points are stored, and when all tiles are done


def run(
    id: str,
    spec: Spec,
    settings: Mapping[str, Any],
    sources: Sources,
    targets: Mapping[str, Target],
    tiling: Tiling,
    *,
    record: Record | None,
    overwrite: bool,
    resume: bool,
    assume_crs: CRS | None,
    ctx: Context,
) -> dict[str, Any]:
    """Run a tool or model in tiles.

    Parameters
    ----------
    id, spec : the tool and its specification
    settings : values of its parameters
    sources : the layers to read; point clouds are in files
    targets : the outputs to write
    record : the provenance record, which each product carries
    overwrite : whether products may replace files
    resume : whether to continue an earlier run that was stopped
    assume_crs : CRS of sources that state none

    Returns
    -------
    dict
        By output name the path of a layer, or the number; layers without a path are not made.

    Raises
    ------
    ParameterError, DataError
        The tool needs the whole cloud, a file cannot be read, or tiles have failed.
    """
    defaults = {name: f.default for name, f in spec.inputs.items() if not f.required}
    settings = {n: v for n, v in (defaults | dict(settings)).items() if n not in spec.sources}
    plan = TilePlan.of(as_model(spec), settings, targets)
    surveys = surveys_of(spec, sources, assume_crs, ctx)
    survey = next(iter(surveys.values()))  # the one whose tiles are run
    metre, size = survey.metre, tiling.size or suitable_size(survey, plan.halo, tiling)
    if size < (least := max(plan.halo / 20, SMALLEST)):
        raise ParameterError(spec.id, {"tile": f"must be at least {least:g} m here, got {size:g}"})
    log.info("tiles of %g m, each with %g m of its neighbourhood", size, plan.halo)
    others = {n: items for n, items in sources.items() if n not in surveys}
    job = TileJob(
        str(Path(id).absolute()) if id.endswith(MODEL) else id,
        settings,
        {n: tuple(source.absolute() for source in items) for n, items in others.items()},
        assume_crs,
        surveys,
        steps=(),
        given={},
        before={},
        keep=frozenset(plan.keep),
        las=frozenset(plan.stored[n] for n, t in targets.items() if n in plan.stored and t.is_las),
        halo=_reach(plan.halo, metre),
        grid=TileGrid(size * metre),
    )
    products = _products(plan, targets, survey)
    _check_products(spec.id, products, surveys, overwrite=overwrite)
    with (
        _working_folder(job, plan, record, targets, resume=resume) as work,
        client_of(tiling) as client,
    ):
        crew = _Crew(client, spec.id, work, job, plan)
        rim = RIM if plan.gives_rasters else 0.0
        tiles = crew.split(rim * metre, ctx.part(0, STORED))
        for number in range(len(plan.passes)):
            edges = (STORED + (DONE - STORED) * (number + k) / len(plan.passes) for k in (0, 1))
            crew.run_pass(number, tiles, ctx.part(*edges))
            if crew.failures:
                break
        return _finish(spec, crew, products, targets, record, overwrite, ctx.part(DONE, 1))


@dataclass(frozen=True)
class _Product:
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


def _products(plan: TilePlan, targets: Mapping[str, Target], survey: Survey) -> list[_Product]:
    """The files to write from pieces; for a folder, one for each file of the survey."""
    found: list[_Product] = []
    for name, target in targets.items():
        if (result := plan.stored.get(name)) is None or not _in_blocks(plan, name):
            continue
        if target.folder:
            inside = [target.inside(file.path.name) for file in survey.files]
            found += [_Product(name, result, t, number) for number, t in enumerate(inside)]
        else:
            found.append(_Product(name, result, target))
    return found


def _in_blocks(plan: TilePlan, output: str) -> bool:
    """Whether an output is written from its pieces; not so features, which may share a file."""
    return plan.model.results[output].kind.in_blocks


def _check_products(
    id: str, products: list[_Product], surveys: Mapping[str, Survey], *, overwrite: bool
) -> None:
    """Raise an error if a product must not be written, or two products have the same path."""
    problems: dict[str, str] = {}
    paths = {n: file.path for n, file in enumerate(next(iter(surveys.values())).files)}
    twins: dict[Path, _Product] = {}
    for product in [product for product in products if product.file is not None]:
        if twin := twins.get(product.resolved):
            one, other = paths[twin.file or 0], paths[product.file or 0]
            problems[product.output] = f"{one} and {other} would both become {product.resolved}"
        twins[product.resolved] = product
        if not product.resolved.parent.parent.is_dir():
            problems[product.output] = f"there is no folder {product.resolved.parent.parent}"
    if problems:
        raise ParameterError(id, problems)
    reads = [file.path for survey in surveys.values() for file in survey.files]
    there = [p for p in products if p.file is None or p.resolved.parent.is_dir()]
    names = [p.output if p.file is None else f"{p.output} {p.resolved.name}" for p in there]
    of_files = {name: product.target for name, product in zip(names, there, strict=True)}
    if problems := targets_problems(of_files, reads, overwrite=overwrite):
        raise ParameterError(id, problems)


def _finish(
    spec: Spec,
    crew: _Crew,
    products: list[_Product],
    targets: Mapping[str, Target],
    record: Record | None,
    overwrite: bool,
    ctx: Context,
) -> dict[str, Any]:
    """Write all products; after failures, only those files of folders that are complete."""
    plan = crew.plan
    if crew.failures:
        complete, done = crew.complete(), crew.done
        products = [p for p in products if p.file in complete and plan.keep[p.result] in done]
    known = {n: w for n, w in plan.model.returns.items() if crew.found.keys() & set(w.names)}
    found = {n: resolved(link, crew.found) for n, link in known.items()}
    found |= {n: value for n, value in crew.found.items() if n in targets}
    if lost := [n for n, value in found.items() if value is None and n in plan.stored]:
        log.warning("not known from tiles: %s", ", ".join(lost))
        found = {n: value for n, value in found.items() if n not in lost}
    at_once = [name for name in targets if name in plan.stored and not _in_blocks(plan, name)]
    found |= {name: crew.read(plan.stored[name]) for name in at_once}
    made = record and replace(record, counts=tuple(plan.ordered(crew.counts)))
    others = {n: target for n, target in targets.items() if n in found or n in SHOWN}
    try:
        own_files = {product.resolved: product.target.own_files for product in products}
        for folder in {product.resolved.parent for product in products}:
            folder.mkdir(exist_ok=True)
        with files.staged(own_files, overwrite=overwrite) as staged:
            prepared = [replace(product, path=staged[product.resolved]) for product in products]
            crew.write(prepared, made, ctx.part(0.5, 0.9))
            found |= write(
                spec, found, others, record=made, overwrite=overwrite, ctx=ctx.part(0.9, 1)
            )
    except OSError as err:
        raise DataError(f"{crew.id}: cannot write: {err}") from err
    crew.report()
    return found | {p.output: targets[p.output].path for p in products}


def _reach(halo: float, metre: float) -> float:
    """A halo in coordinate units, a little wider, so that points on its edge are within."""
    return (halo * SLACK + NEAR) * metre


def _sum(values: list[Any]) -> Any:
    """The sum of the numbers of all tiles; None if they are no counts and no shares."""
    if all(isinstance(value, Share) for value in values) or all(type(v) is int for v in values):
        return functools.reduce(operator.add, values)
    return None


def _reason(error: BaseException) -> str:
    if isinstance(error, ToolboxError):
        return str(error)
    if type(error).__name__ == "KilledWorker":
        return "its worker died, perhaps for want of memory; take smaller tiles or more memory"
    return f"{type(error).__name__}: {error}"


def _tiles(table: NDArray[np.int64], reach: int) -> set[Tile]:
    """The tiles that have one of some buckets within reach, which is a number of buckets.

    Parameters
    ----------
    table : of shape (m, 3): row, column and number of points of each bucket
    """
    low, high = (table[:, :2] - reach) // SIDE, (table[:, :2] + reach) // SIDE
    found: set[Tile] = set()
    for down in range(int((high - low).max(initial=0)) + 1):
        for right in range(int((high - low).max(initial=0)) + 1):
            tiles = np.minimum(low + np.array([down, right]), high)
            found |= set(map(tuple, np.unique(tiles, axis=0).tolist()))
    return found


def suitable_size(survey: Survey, halo: float, tiling: Tiling) -> float:
    """Choose the largest tile that fits into memory with its halo and gives each worker some.

    Parameters
    ----------
    halo : metres

    Returns
    -------
    float
        Metres; at least half of the halo, or most of the work would be done twice.
    """
    boxes = np.reshape([file.bounds for file in survey.files if file.count], (-1, 2, 3))
    area = float(np.prod(boxes[:, 1, :2] - boxes[:, 0, :2], axis=1).sum()) / survey.metre**2
    side = math.sqrt(memory_of(tiling) / BYTES_PER_POINT * area / survey.count) - 2 * halo
    side = min(side, math.sqrt(area / (2 * tiling.workers)))
    return max(float(round(side, -1)), 50.0, float(round(halo / 2, -1)))


@contextmanager
def _working_folder(
    job: TileJob,
    plan: TilePlan,
    record: Record | None,
    targets: Mapping[str, Target],
    *,
    resume: bool,
) -> Iterator[Path]:
    """Make the working folder of a run; it is removed after success, and kept after a failure."""
    first = next((target.resolved for target in targets.values() if target.resolved), None)
    if record is None or first is None:  # only numbers are asked for
        with files.scratch() as work:
            for folder in _folders(work, plan):
                folder.mkdir(parents=True)
            yield work
        return
    work = first.parent / f".tiles-{_key(job, plan.model, record)}"
    goes_on = resume and work.exists()
    work.mkdir(exist_ok=True)
    lock = FileLock(work / "lock", blocking=False)
    try:
        lock.acquire()
    except Timeout:
        raise DataError(f"{job.id}: another run is at work in {work}") from None
    try:
        if goes_on:
            log.info("going on where an earlier run was stopped (%s)", work)
        for folder in _folders(work, plan):
            if not goes_on:
                shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True, exist_ok=True)
            tile_store.sweep(folder)
        yield work
        shutil.rmtree(work, ignore_errors=True)
    finally:
        lock.release()


def _folders(work: Path, plan: TilePlan) -> list[Path]:
    """The folders of the stored points, and of the results of the tiles of each pass."""
    return [work / "points", *(work / str(k) / "tiles" for k in range(len(plan.passes)))]


def _key(job: TileJob, model: Model, record: Record) -> str:
    """A name that is the same for the same code, tool, settings, contents of files, and tiles."""
    says = [
        record.entry(),
        _outline(model),
        job.grid.size,
        job.halo,
        sorted(job.keep),
        sorted(job.las),
    ]
    bounds = [file.only for survey in job.surveys.values() for file in survey.files]
    text = json.dumps([*says, bounds, code_of("algorithms")], default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _outline(spec: Spec) -> Any:
    """What identifies a tool: its id, or the steps of a model."""
    if not isinstance(spec, Model):
        return spec.id
    steps = spec.steps.values()
    return [[s.name, _outline(s.spec), s.settings, s.links, s.when, s.repeat] for s in steps]


@dataclass(frozen=True)
class _Failed:
    """The result of a task that has failed twice."""

    why: str


class _Crew:
    """Gives tasks to the workers of a run, and collects their results and failures.

    Attributes
    ----------
    job : what all passes have in common
    found : numbers of all tiles, None where they have no sum, and results on the whole survey
    counts : sizes of the layers of each step
    done : passes whose tiles were run
    failed : the reason, for each tile that could not be run
    unreadable : the reason, for each file whose points could not be read or stored
    """

    def __init__(self, client: Any, id: str, work: Path, job: TileJob, plan: TilePlan) -> None:
        self.client, self.id, self.work, self.job, self.plan = client, id, work, job, plan
        self.found: dict[str, Any] = {}
        self.counts: list[Count] = []
        self.done: set[int] = set()
        self.failed: dict[Tile, str] = {}
        self.unreadable: dict[Path, str] = {}

    def folder(self, number: int) -> Path:
        """The folder of a pass."""
        return self.work / str(number)

    def read(self, name: str) -> Any:
        """Join a result of the tiles in memory."""
        return tile_products.read(self.folder(self.plan.keep[name]), name)

    def all(
        self, task: Callable[..., Any], calls: list[tuple[Any, ...]], ctx: Context
    ) -> list[Any]:
        """Run a task for each tuple of arguments: its results, or `_Failed` after a second try."""
        futures = [self.client.submit(task, *call, pure=False, retries=1) for call in calls]
        try:
            while left := sum(not future.done() for future in futures):
                ctx.progress(1 - left / len(futures))
                time.sleep(0.05)
        except BaseException:
            self.client.cancel(futures, force=True)
            raise
        ctx.progress(1.0)
        return [_Failed(_reason(f.exception())) if f.exception() else f.result() for f in futures]

    # Points

    def split(self, rim: float, ctx: Context) -> dict[Tile, list[FileBlock]]:
        """Store all points, and give the stored blocks with points in or near each tile.

        Parameters
        ----------
        rim : distance beyond the points to which a result may extend, in coordinate units
        """
        blocks: list[FileBlock] = []
        for source, survey in self.job.surveys.items():
            for number, file in enumerate(survey.files):
                try:
                    blocks += tile_store.blocks(source, survey, number, BLOCK)
                except DataError as err:
                    self.unreadable[file.path] = str(err)
        self._begin(0)
        tables = self.all(tile_work.split, [(self.folder(0), block) for block in blocks], ctx)
        reach = math.ceil(self.job.halo * SIDE / self.job.grid.size)
        near: dict[Tile, list[FileBlock]] = {}
        core: set[Tile] = set()
        for block, table in zip(blocks, tables, strict=True):
            if isinstance(table, _Failed):
                path = self.job.surveys[block.source].files[block.file].path
                self.unreadable[path] = table.why
                continue
            for tile in _tiles(table, reach):
                near.setdefault(tile, []).append(block)
            core |= _tiles(table, 0) if block.source == self.job.first else set()
        self._give_up(near.keys() | core)
        if not core:
            return {}
        if len(core) > MOST_TILES:
            raise DataError(f"{self.id}: {len(core)} tiles are too many; take larger ones")
        xmin, ymin, _, xmax, ymax, _ = self.job.surveys[self.job.first].bounds
        corners = np.array([[xmin - rim, ymin - rim], [xmax + rim, ymax + rim]])
        edge = map(tuple, (self.job.grid.buckets(corners) // SIDE).tolist()) if rim else ()
        rows, cols = (range(min(n), max(n) + 1) for n in zip(*core, *edge, strict=True))
        # Also tiles without points among those that have some: a gap may be filled there.
        among = {t: b for t, b in near.items() if t[0] in rows and t[1] in cols}
        return {tile: b for tile, b in among.items() if tile not in self.failed}

    def _give_up(self, tiles: Iterable[Tile]) -> None:
        """Mark the tiles that need points of unreadable files as failed."""
        survey_files = [file for survey in self.job.surveys.values() for file in survey.files]
        lost = [file for file in survey_files if file.path in self.unreadable]
        for tile in tiles if lost else ():
            bounds = self.job.grid.bounds(tile, self.job.halo)
            for file in [file for file in lost if file.touches(bounds)]:
                self.failed[tile] = self.unreadable[file.path]

    # Tiles

    def run_pass(self, number: int, tiles: Mapping[Tile, list[FileBlock]], ctx: Context) -> None:
        """Run the local steps of a pass on all tiles, then its other steps on whole results."""
        one = self.plan.passes[number]
        if one.local:
            self._begin(number)
            self._run_tiles(number, tiles, ctx.part(0, 0.7))
            self.done.add(number)
        if one.rest and not self.failures:
            self.found |= self._run_rest(number, ctx.part(0.7, 1))

    def _begin(self, number: int) -> None:
        """Write the job file of a pass for the workers."""
        one, model, keep = self.plan.passes[number], self.plan.model, self.plan.keep
        needs = {need for name in one.local for need in model.steps[name].needs}
        earlier = {n for n in needs & keep.keys() if keep[n] < number}
        clouds = {n for n in earlier if model.between[n].kind.several}
        job = replace(
            self.job,
            steps=one.local,
            given={n: value for n, value in self.found.items() if n in needs}
            | {n: self.read(n) for n in earlier - clouds},
            before={n: self.folder(keep[n]) for n in sorted(clouds)},
            keep=one.keep,
            halo=_reach(one.halo, self.job.surveys[self.job.first].metre),
        )
        tile_store.save_object(self.folder(number) / "job", job)

    def _run_tiles(self, number: int, tiles: Mapping[Tile, list[FileBlock]], ctx: Context) -> None:
        folder = self.folder(number)
        calls = [(folder, tile, tuple(tiles[tile])) for tile in sorted(tiles)]
        results = self.all(tile_work.run_tile, calls, ctx)
        said: dict[str, list[Tile]] = {}
        numbers: dict[str, list[Any]] = {}
        counts: dict[tuple[str, str], int] = {}
        for (_, tile, _), result in zip(calls, results, strict=True):
            if isinstance(result, _Failed):
                self.failed[tile] = result.why
                continue
            for text in dict.fromkeys(result.said):
                said.setdefault(text, []).append(tile)
            for name, value in result.values.items():
                numbers.setdefault(name, []).append(value)
            for count in result.counts:
                key = count.step, count.name
                counts[key] = counts.get(key, 0) + count.count
        for text, where in list(said.items())[:LISTED]:
            more = f" and {len(where) - 1} more tiles" if len(where) > 1 else ""
            log.warning("tile %s%s: %s", tile_work.name_of(where[0]), more, text)
        memory = max((r.memory for r in results if not isinstance(r, _Failed)), default=0)
        log.debug("%d tiles; a worker needed up to %d MB", len(calls), memory // 10**6)
        self.found |= {name: _sum(values) for name, values in numbers.items()}
        self.counts += [Count(*key, count) for key, count in counts.items()]

    def _run_rest(self, number: int, ctx: Context) -> dict[str, Any]:
        """Run the steps of a pass that need the whole survey or whole results."""
        one = self.plan.passes[number]
        _, model, layers = tile_work.opened(self.folder(0))
        rest = model.subset(one.rest)
        steps = rest.steps.values()
        needs = {need for step in steps for need in step.needs}
        clouds = {
            name: survey
            if reads_batches(steps, f"{INPUTS}.{name}")
            else survey.read(ctx=ctx.part(0, 0.1))
            for name, survey in self.job.surveys.items()
            if f"{INPUTS}.{name}" in needs
        }
        given = self.found | {
            name: StoredSurvey.of(self.folder(self.plan.keep[name]), name)
            if reads_batches(steps, name)
            else self.read(name)
            for name in needs & self.plan.keep.keys()
        }
        values = dict.fromkeys(model.sources) | dict(self.plan.settings) | layers | clouds
        runner = counting(self.counts)
        run = ModelRun(rest, values, keep=one.gives, given=given, runner=runner)
        result = run.run(ctx.part(0.1, 1))
        return {name: getattr(result, name) for name in one.gives}

    # Products

    def write(self, products: list[_Product], record: Record | None, ctx: Context) -> None:
        """Write products to the temporary paths where they are prepared."""
        folders = [self.folder(self.plan.keep[p.result]) for p in products]
        calls = [
            (folder, p.output, p.result, p.path, p.target.how, p.file, record)
            for folder, p in zip(folders, products, strict=True)
        ]
        done = self.all(tile_products.write, calls, ctx)
        pairs = zip(products, done, strict=True)
        if wrong := {p.output: d.why for p, d in pairs if isinstance(d, _Failed)}:
            raise DataError(self.id, wrong)

    @property
    def failures(self) -> bool:
        """Whether anything has gone wrong."""
        return bool(self.failed or self.unreadable)

    def complete(self) -> set[int]:
        """The indices of the files of the survey that no failed tile touches."""
        files = enumerate(self.job.surveys[self.job.first].files)
        boxes = [self.job.grid.bounds(tile) for tile in self.failed]
        lost = self.unreadable
        return {n for n, f in files if f.path not in lost and not any(map(f.touches, boxes))}

    def report(self) -> None:
        """Raise an error that lists the failures, if there are any."""
        if not self.failures:
            return
        where: dict[str, list[Tile]] = {}
        for tile in sorted(self.failed):
            where.setdefault(self.failed[tile], []).append(tile)
        lines = {str(path): why for path, why in list(self.unreadable.items())[:LISTED]}
        for why, tiles in list(where.items())[:LISTED]:
            lines[self._names(tiles)] = why
        if (more := len(where) - LISTED) > 0:
            lines["and"] = f"{more} more problems"
        lines["what to do"] = (
            f"mend the cause and run again with --resume; what is done is kept in {self.work}"
        )
        raise DataError(self.id, lines)

    def _names(self, tiles: list[Tile]) -> str:
        """Name the first of some tiles, with its bounds, and the number of the others."""
        box = ", ".join(f"{value:.10g}" for value in self.job.grid.bounds(tiles[0]))
        more = f" and {len(tiles) - 1} more tiles" if len(tiles) > 1 else ""
        return f"tile {tile_work.name_of(tiles[0])} ({box}){more}"
