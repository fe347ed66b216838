"""Run a tool or model on a survey of any size: tile by tile, on several processes.

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

import hashlib
import itertools
import json
import math
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout
from pyproj import CRS

from toolbox import files
from toolbox.catalog import MODEL
from toolbox.context import Context, log
from toolbox.data import PointCloud, Survey
from toolbox.data.layer import Layer
from toolbox.data.reading import Reading
from toolbox.declare.fields import Spec
from toolbox.errors import Cancelled, DataError, ParameterError
from toolbox.models.model import Model, resolved
from toolbox.reports.page import Told
from toolbox.runs import cells
from toolbox.runs.cache import code_of
from toolbox.runs.delivery import write
from toolbox.runs.lineage import read_files, sizes_of, tell_empty
from toolbox.runs.provenance import Record
from toolbox.runs.source import Sources
from toolbox.runs.target import More, Target, check_crs, names_of
from toolbox.runs.target import problems as targets_problems
from toolbox.shown import PAGE, SHOWN
from toolbox.tiles import overview, spoken
from toolbox.tiles import store as tile_store
from toolbox.tiles.crew import Crew, reach_of
from toolbox.tiles.plan import ALONE, TilePlan, as_model
from toolbox.tiles.products import Product
from toolbox.tiles.store import TileGrid
from toolbox.tiles.tiling import Tiling, memory_of
from toolbox.tiles.work import TileJob
from toolbox.tiles.workers import workers_of

LIBRARIES = 150_000_000  # bytes of a worker that has no points yet; measured: 117 MB
SMALLEST = 0.1  # metres: smaller tiles are taken for a mistake in the size
RIM = 40.0  # metres that a raster may reach beyond all points: whole blocks of its cells
STORED, DONE = 0.1, 0.9  # of the progress, when all points are stored, and when all tiles are done
_WORK, _LOCK = ".tiles-", "lock"  # beginning of the names of working folders; a file in them
_REMOVAL = "removal"  # a file in a working folder of which some may be removed already


def run(
    id: str,
    spec: Spec,
    settings: Mapping[str, Any],
    sources: Sources,
    targets: Mapping[str, Target],
    tiling: Tiling,
    *,
    surveys: Mapping[str, Survey],
    reading: Reading | None,
    record: Record | None,
    overwrite: bool,
    resume: bool,
    assume_crs: CRS | None,
    told: Told,
    ctx: Context,
) -> dict[str, Any]:
    """Run a tool or model in tiles.

    Parameters
    ----------
    id, spec : the tool and its specification
    settings : values of its parameters
    sources : the layers to read; point clouds are in files
    targets : the outputs to write
    surveys : the point clouds among the sources, opened by `surveys_of`
    reading : what is known of the files, with their hashes
    record : the provenance record, which each product carries
    overwrite : whether products may replace files
    resume : whether to continue an earlier run that was stopped
    assume_crs : CRS of sources that state none
    told : what else the run tells, for its report

    Returns
    -------
    dict
        By output name the path of a layer, or the number; layers without a path are not made.

    Raises
    ------
    ParameterError, DataError
        The tool needs the whole cloud, a file cannot be read, or tiles have failed.
    """
    if tiling.scheduler is None:
        memory_of(tiling)  # an error of it comes before anything is read or written
    defaults = {name: f.default for name, f in spec.inputs.items() if not f.required}
    settings = {n: v for n, v in (defaults | dict(settings)).items() if n not in spec.sources}
    wanted = [target.output for target in targets.values()]
    plan = TilePlan.of(as_model(spec), settings, wanted)
    if reading:
        reading.check_unchanged()  # since they were hashed; from now on the survey does so
    check_crs(spec.id, targets, surveys.values())
    survey = next(iter(surveys.values()))  # the one whose tiles are run
    size = _size(spec, survey, plan, tiling)
    cells.check(spec, settings, surveys, size + 2 * plan.halo)
    others = {n: items for n, items in sources.items() if n not in surveys}
    las = {plan.stored[t.output] for t in targets.values() if t.output in plan.stored and t.is_las}
    job = TileJob(
        Path(),
        str(Path(id).absolute()) if id.endswith(MODEL) else id,
        settings,
        {n: tuple(source.absolute() for source in items) for n, items in others.items()},
        assume_crs,
        surveys,
        steps=(),
        given={},
        before={},
        keep=frozenset(plan.keep),
        las=frozenset(las),
        halo=reach_of(plan.halo, survey.metre),
        grid=TileGrid(size * survey.metre),
    )
    told.given = {**surveys, **job.layers}
    products = _products(plan, targets, survey)
    _check_products(spec.id, products, surveys, overwrite=overwrite)
    with (
        _working_folder(job, plan, record, targets, resume=resume) as work,
        workers_of(tiling) as workers,
    ):
        try:
            crew = Crew(workers, spec.id, work, job, plan, told)
            _pass_by_pass(crew, plan, survey.metre, ctx)
            if reading:
                of_others = (source.files for items in others.values() for source in items)
                reading.check_unchanged(read_files(itertools.chain(*of_others)))
            return _finish(
                spec, crew, products, targets, record, told, overwrite, ctx.part(DONE, 1)
            )
        except Cancelled:
            if reading:  # else nothing is kept
                log.warning("stopped; --resume goes on from here, with what is kept in %s", work)
            raise


def _size(spec: Spec, survey: Survey, plan: TilePlan, tiling: Tiling) -> float:
    """Side of the tiles, metres: the one asked for, if their neighbourhoods allow it."""
    size = tiling.size or suitable_size(survey, plan, tiling)
    if size < (least := max(plan.halo / 20, SMALLEST)):
        raise ParameterError(spec.id, {"tile": f"must be at least {least:g} m here, got {size:g}"})
    log.info("tiles of %g m, each with %g m of its neighbourhood", size, plan.halo)
    return size


def _pass_by_pass(crew: Crew, plan: TilePlan, metre: float, ctx: Context) -> None:
    """Store the points by tiles, and run each part of the plan on all tiles, until one fails."""
    rim = RIM if plan.gives_rasters else 0.0
    tiles = crew.split(rim * metre, ctx.part(0, STORED))
    for number in range(len(plan.passes)):
        edges = (STORED + (DONE - STORED) * (number + k) / len(plan.passes) for k in (0, 1))
        crew.run_pass(number, tiles, ctx.part(*edges))
        if crew.failures:
            break


def _products(plan: TilePlan, targets: Mapping[str, Target], survey: Survey) -> list[Product]:
    """The files to write from pieces; for a folder, one for each file of the survey."""
    found: list[Product] = []
    for target in targets.values():
        name = target.output
        if (result := plan.stored.get(name)) is None or not _in_blocks(plan, name):
            continue
        if target.folder:
            inside = [target.inside(file.path.name) for file in survey.files]
            found += [Product(name, result, t, number) for number, t in enumerate(inside)]
        else:
            found.append(Product(name, result, target))
    return found


def _in_blocks(plan: TilePlan, output: str) -> bool:
    """Whether an output is written from its pieces; not so features, which may share a file."""
    return plan.model.results[output].kind.in_blocks


def _check_products(
    id: str, products: list[Product], surveys: Mapping[str, Survey], *, overwrite: bool
) -> None:
    """Raise an error if a product must not be written, or two products have the same path."""
    problems: dict[str, str] = {}
    paths = {n: file.path for n, file in enumerate(next(iter(surveys.values())).files)}
    twins: dict[Path, Product] = {}
    for product in [product for product in products if product.file is not None]:
        if twin := twins.get(product.resolved):
            one, other = paths[twin.file or 0], paths[product.file or 0]
            problems[product.output] = f"{one} and {other} would both become {product.resolved}"
        twins[product.resolved] = product
        parent = product.resolved.parent
        if not parent.is_dir() and (text := files.folder_problem(parent.parent)):
            problems[product.output] = text
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
    crew: Crew,
    products: list[Product],
    targets: Mapping[str, Target],
    record: Record | None,
    told: Told,
    overwrite: bool,
    ctx: Context,
) -> dict[str, Any]:
    """Write all products; after failures, only those files of folders that are complete."""
    products = _complete(crew, products)
    found = _found(crew, [target.output for target in targets.values()])
    spoken.tell(crew, told)
    tell_empty(spec, _sizes(crew, found), targets.values(), told)
    made = record and replace(record, counts=tuple(crew.plan.ordered(crew.counts)))
    if any(target.output == PAGE for target in targets.values()):
        told.thinned = _thinned(spec, crew)
        told.cells, told.by_class = overview.cells_of(crew, spec.outputs), overview.by_class(crew)
        told.files |= names_of(product.target for product in products)
    for folder in {product.resolved.parent for product in products}:
        folder.mkdir(exist_ok=True)

    def write_products(staged: Mapping[Path, Path]) -> None:
        prepared = [replace(product, path=staged[product.resolved]) for product in products]
        crew.write(prepared, made, ctx.part(0.5, 0.9))

    more = More({p.resolved: p.target.own_files for p in products}, write_products)
    part = ctx.part(0.9, 1)
    others = {n: t for n, t in targets.items() if t.output in found or t.output in SHOWN}
    saved = write(
        spec, found, others, more=more, record=made, told=told, overwrite=overwrite, ctx=part
    )
    crew.report()
    asked = {n: value for n, value in found.items() if n in spec.outputs or n in targets}
    return _results(spec, asked | saved, {product.output for product in products}, targets)


def _sizes(crew: Crew, found: Mapping[str, Any]) -> dict[str, int | None]:
    """How much the results hold, by name; after failures nothing is said of those of tiles."""
    alone = crew.job.id  # the name in counts of what runs without a model
    held = {f"{ALONE if c.step == alone else c.step}.{c.name}": c.count for c in crew.counts}
    stored = {} if crew.failures else crew.plan.stored
    made = {name: held[full] for name, full in stored.items() if full in held}
    return made | sizes_of(found)


def _thinned(spec: Spec, crew: Crew) -> dict[str, Layer]:
    """What a report shows of points and rasters: what was read, where tiles made no points."""
    made = overview.results(crew, spec.outputs)
    if any(isinstance(layer, PointCloud) for layer in made.values()):
        return made
    return overview.sources(crew) | made


def _complete(crew: Crew, products: list[Product]) -> list[Product]:
    """The products that can be written: after failures, files of a folder that miss nothing."""
    if not crew.failures:
        return products
    complete, done, keep = crew.complete(), crew.done, crew.plan.keep
    return [p for p in products if p.file in complete and keep[p.result] in done]


def _found(crew: Crew, wanted: list[str]) -> dict[str, Any]:
    """What is known of the whole survey, by name: numbers, and layers that no block makes."""
    plan = crew.plan
    known = {n: w for n, w in plan.model.returns.items() if crew.found.keys() & set(w.names)}
    found = {n: resolved(link, crew.found) for n, link in known.items()}
    found |= {n: value for n, value in crew.found.items() if n in wanted}
    if lost := [n for n, value in found.items() if value is None and n in plan.stored]:
        log.warning("not known from tiles: %s", ", ".join(lost))
    found = {n: value for n, value in found.items() if n not in lost}
    at_once = [n for n in dict.fromkeys(wanted) if n in plan.stored and not _in_blocks(plan, n)]
    return found | {name: crew.read(plan.stored[name]) for name in at_once}


def _results(
    spec: Spec, known: Mapping[str, Any], written: set[str], targets: Mapping[str, Target]
) -> dict[str, Any]:
    """What the run returns, in the order of the tool: what is known, and where files are."""
    shown = written & {*spec.outputs, *targets}
    first = {t.output: t.path for t in reversed(list(targets.values())) if t.output in shown}
    given = {**known, **first, **{n: t.path for n, t in targets.items() if n in shown}}
    return {n: given[n] for n in dict.fromkeys([*spec.outputs, *given]) if n in given}


def suitable_size(survey: Survey, plan: TilePlan, tiling: Tiling) -> float:
    """Choose the largest tile that fits into memory with its halo and gives each worker some.

    Returns
    -------
    float
        Metres; at least half of the halo, or most of the work would be done twice.
    """
    boxes = np.reshape([file.bounds for file in survey.files if file.count], (-1, 2, 3))
    area = float(np.prod(boxes[:, 1, :2] - boxes[:, 0, :2], axis=1).sum()) / survey.metre**2
    side = 0.0  # of points in a line, which cover no area
    if area:
        side = plan.side(survey.count / area, memory_of(tiling) - LIBRARIES)
        side = min(side, math.sqrt(area / (2 * tiling.workers)))
    return max(float(round(side, -1)), 50.0, float(round(plan.halo / 2, -1)))


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
    work = first.parent / f"{_WORK}{_key(job, plan.model, record)}"
    goes_on = resume and work.exists() and not (work / _REMOVAL).exists()
    _tell_of_others(work, goes_on=goes_on, resume=resume)
    work.mkdir(mode=0o700, exist_ok=True)
    if not files.is_private(work):
        raise DataError(f"{job.id}: {work} must be a folder in which only you may write; remove it")
    lock = FileLock(work / _LOCK, blocking=False)
    try:
        lock.acquire()
    except Timeout:
        raise DataError(f"{job.id}: another run is at work in {work}") from None
    try:
        if goes_on:
            log.info("going on where an earlier run was stopped (%s)", work)
        else:
            _empty(work, plan)
            (work / _REMOVAL).unlink()
        for folder in _folders(work, plan):
            folder.mkdir(parents=True, exist_ok=True)
            tile_store.sweep(folder)
        yield work
        _empty(work, plan)
        shutil.rmtree(work, ignore_errors=True)
    finally:
        lock.release()


def _empty(work: Path, plan: TilePlan) -> None:
    """Remove what a working folder holds, and mark it first.

    A run that is killed meanwhile leaves tiles that have lost some of their points; by the mark,
    none goes on from them.
    """
    (work / _REMOVAL).touch()
    for folder in _folders(work, plan):
        shutil.rmtree(folder, ignore_errors=True)


def _tell_of_others(work: Path, *, goes_on: bool, resume: bool) -> None:
    """Warn of what stopped runs with other settings or other data have left beside a folder."""
    left = [folder for folder in sorted(work.parent.glob(f"{_WORK}*")) if _is_left(folder, work)]
    if not left or goes_on:
        return
    names = ", ".join(folder.name for folder in left)
    says = "nothing to go on with for these settings and data; " if resume else ""
    log.warning("%sstopped runs with others have left %s in %s", says, names, work.parent)
    log.warning("give --resume with the settings of such a run, or remove what it has left")


def _is_left(folder: Path, work: Path) -> bool:
    """Whether a folder is that of a run with other settings that is at work no more."""
    lock = FileLock(folder / _LOCK, blocking=False)
    if folder == work or not folder.is_dir():
        return False
    try:
        with lock:
            return True
    except (Timeout, OSError):
        return False


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
