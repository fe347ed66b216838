"""Runs a tool by its id, on paths or layers, and writes the outputs that have a path."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Never

from pyproj import CRS

from toolbox import catalog, language, renamed
from toolbox.context import QUIET, Context, listening, log
from toolbox.data.crs import parse_crs, unit_of, unit_of_lengths
from toolbox.data.reading import Reading
from toolbox.declare.fields import Spec
from toolbox.errors import ParameterError, memory_named, nearest
from toolbox.models.model import Model, ModelRun
from toolbox.reports.page import Told
from toolbox.runs import cells, delivery
from toolbox.runs import source as sources
from toolbox.runs import target as targets
from toolbox.runs.cache import Cache
from toolbox.runs.lineage import (
    counting,
    read_files,
    record_of,
    remember,
    sizes_of,
    tell_empty,
    telling,
)
from toolbox.runs.provenance import Count, Record
from toolbox.runs.results import Results
from toolbox.runs.source import Sources
from toolbox.runs.target import Target
from toolbox.shown import PICTURE, SHOWN
from toolbox.tiles.tiling import Tiling

# shares of the progress at which hashing and reading end, and writing begins
HASH, READ, WRITE = 0.03, 0.15, 0.85
NO_VALUES: Mapping[str, Any] = MappingProxyType({})


@memory_named()
def run(
    id: str,
    values: Mapping[str, Any] = NO_VALUES,
    *,
    overwrite: bool = False,
    assume_crs: str | CRS | None = None,
    picture: str | Path | None = None,
    tiling: Tiling | None = None,
    resume: bool = False,
    ctx: Context = QUIET,
    **named: Never,
) -> Results:
    """Run a tool on files or layers.

    Parameters
    ----------
    id : such as "ground.csf", or the path of a model file
    values : inputs by name, and the path of each output to write; for a model also a path under
        ``step.output``, for the result of a step. A source is a
        layer, a path, or a mapping of a path and options of reading, for example
        ``{"path": "a.txt", "columns": ["x", "y", "z", "label"]}``; an output may likewise be
        ``{"path": "a.tif", "cog": True}``. Texts are read as on the command line. "page" is the
        path of the report, an HTML file with all results, and "counts" that of a table with the
        sizes of the inputs and outputs of each step.
    overwrite : whether outputs may replace files
    assume_crs : CRS of sources that state none; "local" for plain metres
    picture : path of the plot, a PNG of the resulting layers
    tiling : how to cut the point clouds, which must be files; None to run on whole clouds
    resume : store the results of the tool, or of each step of a model, and use those that an
        earlier run has stored for the same layers and settings (see `toolbox.runs.cache`); in
        tiles, continue a run that was stopped
    ctx : takes the progress, and may cancel the run
    named : nothing; inputs and outputs by name belong into the dict

    Returns
    -------
    Results
        A dict, by output name: the path if one was given, else the layer, number or text; for a
        repeated step of a model a tuple of them. ``results.surface`` is ``results["surface"]``.

    Raises
    ------
    ParameterError
        Wrong names, values or paths: all of them in one error.
    DataError
        A source cannot be read, or holds what the tool cannot use.
    Cancelled
        `ctx` asked the run to stop; nothing was written.
    TypeError
        The inputs and outputs are no dict.

    Examples
    --------
    >>> made = run("samples.scene", {"kind": "town", "size": 40, "density": 2})
    >>> made = run("surface.grid", {"points": made.points, "cell": 2})
    >>> made
    <Results of surface.grid>
      surface: <Raster in memory: 20 rows, 20 columns, cell 2>
      filled_share: 0.9975
    >>> made.surface.cell
    2.0
    >>> made.dtm
    Traceback (most recent call last):
    toolbox.errors.UnknownResult: surface.grid has no result 'dtm', only surface, filled_share
    """
    if named or not isinstance(values, Mapping):
        got = ", ".join(f"{name}=..." for name in named) or repr(values)
        meant = next(filter(None, (nearest(name, OPTIONS) for name in named)), "")
        raise TypeError(
            f'{id}: give inputs and outputs in one dict, as run("{id}", {{"points": "a.laz"}}); '
            f"got {got}{meant}"
        )
    values = {**values, PICTURE: picture} if picture is not None else values
    with listening() as warnings:
        how = {"overwrite": overwrite, "resume": resume}
        asked = _Asked.of(id, values, tiling, assume_crs, Told(warnings=warnings), **how)
        return asked.in_tiles(tiling, ctx) if tiling else asked.whole(ctx)


OPTIONS = tuple(
    name
    for name, option in inspect.signature(run).parameters.items()
    if option.kind is option.KEYWORD_ONLY
)
"""The names of the options of a run, beside its inputs and outputs."""


@dataclass(frozen=True)
class _Asked:
    """What is asked of a tool, checked as far as can be done without the data."""

    id: str
    spec: Spec
    settings: Mapping[str, Any]
    reads: Sources
    writes: Mapping[str, Target]
    files: Reading
    crs: CRS | None
    told: Told
    overwrite: bool
    resume: bool

    @classmethod
    def of(
        cls,
        id: str,
        values: Mapping[str, Any],
        tiling: Tiling | None,
        assume_crs: str | CRS | None,
        told: Told,
        *,
        overwrite: bool,
        resume: bool,
    ) -> _Asked:
        """Check the values, and warn of those that are idle."""
        spec = catalog.load(id)
        values = renamed.values(spec.id, values)
        results = spec.results.keys() | SHOWN
        given = {name: value for name, value in values.items() if name not in results}
        wanted = {n: v for n, v in values.items() if n in results and v is not None}
        reads, writes = sources.of_run(given, spec), delivery.of_run(wanted, spec)
        whole = spec
        if isinstance(spec, Model):
            handed = spec.handed if delivery.is_asked(writes) else {}
            told.of_set = frozenset(handed.keys() - given.keys())
            given = {**handed, **given}
            spec = spec.wanting(target.output for target in writes.values())
        settings = _checked(spec, given, reads, writes, tiling, overwrite=overwrite)
        delivery.tell_missing(writes)
        _tell_idle(whole, [n for n in spec.idle(settings) if given.get(n) is not None])
        spec, crs = spec.under(settings), _crs(assume_crs, id)
        files = Reading.of(read_files(sources.paths(reads)))
        return cls(id, spec, settings, reads, writes, files, crs, told, overwrite, resume)

    @property
    def reading(self) -> Reading | None:
        """The files that a record of the run names; none is made where nothing is written."""
        return self.files if self.writes else None

    @property
    def describe(self) -> Callable[..., Record]:
        """Make the record of the run from what was read."""
        model = Path(self.id) if self.id.endswith(catalog.MODEL) else None
        return partial(record_of, self.spec, self.settings, assume_crs=self.crs, model=model)

    def record(self, ctx: Context) -> Record | None:
        """The record of the run, if something is written."""
        return self.describe(self.reads, self.reading, ctx=ctx) if self.reading else None

    def in_tiles(self, tiling: Tiling, ctx: Context) -> Results:
        """Run the tool on the points of a tile at a time."""
        from toolbox.tiles import engine as tiles
        from toolbox.tiles.plan import surveys_of

        surveys = surveys_of(self.spec, self.reads, self.crs, ctx.part(0, 0))
        asked = self._suited(surveys)
        with delivery.folder_of(self.writes):
            made = tiles.run(
                self.id,
                self.spec,
                asked.settings,
                self.reads,
                self.writes,
                tiling,
                surveys=surveys,
                reading=self.reading,
                record=asked.record(ctx.part(0, HASH)),
                overwrite=self.overwrite,
                resume=self.resume,
                assume_crs=self.crs,
                told=self.told,
                ctx=ctx.part(HASH if self.writes else 0, 1),
            )
        return Results.of(self.spec, made)

    def whole(self, ctx: Context) -> Results:
        """Run the tool on all points at once."""
        opening = ctx.part(0, READ - HASH)
        layers = sources.opened(self.spec, self.reads, self.crs, self.reading, opening)
        return self._suited(layers)._run(layers, ctx)

    def _suited(self, layers: Mapping[str, Any]) -> _Asked:
        """What is asked for, with defaults in feet where the data are."""
        settings = {**self.settings, **self.spec.in_feet({**self.settings, **layers})}
        crs = self.spec.crs_of(layers)
        _tell_lengths(self.spec, settings, crs)
        if delivery.is_asked(self.writes):
            delivery.tell_heights(crs)
        return replace(self, settings=settings)

    def _run(self, layers: Mapping[str, Any], ctx: Context) -> Results:
        """Run the tool on layers that are open, and write what was asked for."""
        spec, writes, counts = self.spec, self.writes, list[Count]()
        self._check(layers)
        record = self.record(ctx.part(READ - HASH, READ))
        if self.reading:
            self.reading.check_unchanged()
        found = self._made(layers, counts, ctx.part(READ, WRITE))
        tell_empty(spec, sizes_of(found), writes.values(), self.told)
        how = {
            "record": record and replace(record, counts=tuple(counts)),
            "told": self.told,
            "overwrite": self.overwrite,
        }
        made = _written(spec, found, writes, ctx.part(WRITE, 1), **how)
        in_memory = {name: value for name, value in made.items() if value is found.get(name)}
        remember(in_memory, self.reads, self.files, self.describe, counts)
        return made

    def _check(self, layers: Mapping[str, Any]) -> None:
        """Check the settings that depend on the layers."""
        spec = self.spec
        each = (layer for n, value in layers.items() for layer in spec.sources[n].items(value))
        targets.check_crs(spec.id, self.writes, each)
        cells.check(spec, self.settings, layers)

    def _made(self, layers: Mapping[str, Any], counts: list[Count], ctx: Context) -> dict[str, Any]:
        """Run the tool or model; its results by name, and those of steps that are written."""
        job = self.spec.build({**self.settings, **layers})
        between = _between(self.spec, self.writes)
        runner = Cache().runner(counting(counts)) if self.resume else counting(counts)
        runner = telling(self.told, runner)
        self.told.given = layers
        if isinstance(job, ModelRun):
            result = replace(job, keep=frozenset(between), runner=runner).run(ctx)
        else:
            result = runner(self.id, job, ctx)
        return {name: getattr(result, name) for name in [*self.spec.outputs, *between]}


def _written(
    spec: Spec, found: Mapping[str, Any], writes: Mapping[str, Target], ctx: Context, **how: Any
) -> Results:
    """Write what has a target, and give what was made, files or layers."""
    if writes:  # of many points it takes as long as some tools
        ctx.stage(language.text("Writing the results"))
    with delivery.folder_of(writes):
        done = delivery.write(spec, found, writes, ctx=ctx, **how)
    shown = {n: value for n, value in found.items() if n in spec.outputs or n in writes}
    return Results.of(spec, shown | done, sizes_of(found))


def _between(spec: Spec, writes: Mapping[str, Target]) -> list[str]:
    """The results of steps that are written, in the order of the steps."""
    written = {target.output for target in writes.values()}
    return [name for name in spec.between if name in written]


def _tell_idle(spec: Spec, names: Iterable[str]) -> None:
    """Warn of settings that no step uses, and say which ones would.

    Raises
    ------
    ParameterError
        A layer is one of them, and another input decides whether it is used.
    """
    for name in names:
        titles = ", ".join(map(language.text, spec.users(name)))
        if name in spec.sources and (switches := spec.switches(name)):
            text = f"is used only with {' and '.join(switches)}; it is for: {titles}"
            raise ParameterError(spec.id, {name: text})
        log.warning("%s: is not used by any step that runs; it is for: %s", name, titles)


def _tell_lengths(spec: Spec, given: Mapping[str, Any], crs: CRS | None) -> None:
    """Say what lengths are in the unit of the data, where that is not the metre."""
    if (own := unit_of_lengths(crs)) is None:
        return
    name_of_unit, metres = own
    unit = unit_of(metres) or name_of_unit
    texts = [
        f"{name} {value:.6g} m = {value / metres:.7g} {unit}"
        for name, value in given.items()
        if spec.inputs[name].unit == "m" and isinstance(value, int | float)
    ]
    if texts:
        log.info("lengths are in metres, the data in %s: %s", unit, ", ".join(texts))


def _crs(crs: str | CRS | None, where: str) -> CRS | None:
    if crs is None or isinstance(crs, CRS):
        return crs
    try:
        return parse_crs(str(crs))
    except ValueError as err:
        raise ParameterError(where, {"assume_crs": str(err)}) from None


def _elsewhere(name: str, spec: Spec) -> str:
    """Where what is no input belongs, if it is an option of the run or of a source."""
    source, dot, option = name.partition(".")
    if dot and source in spec.sources and option in spec.sources[source].kind.open_options:
        said = f"--{name}, in Python {{{source!r}: {{'path': ..., {option!r}: ...}}}}"
        return f"is an option of reading {source}: {said}"
    if name not in spec.inputs and name in OPTIONS:
        return f"is an option of the run and no input: in Python {name}=... beside the dict"
    return ""


def _checked(
    spec: Spec,
    given: Mapping[str, Any],
    reads: Sources,
    writes: Mapping[str, Target],
    tiling: Tiling | None,
    *,
    overwrite: bool,
) -> dict[str, Any]:
    """Read and check all values that need no data; gives those that are no layers."""
    settings = {name: value for name, value in given.items() if name not in spec.sources}
    values, found = spec.parse(settings, present=reads)
    if not found:
        found = spec.rules(values)
    found |= {name: text for name in found if (text := _elsewhere(name, spec))}
    found |= sources.problems(reads, spec)
    if tiling and PICTURE in writes:
        found[PICTURE] = "is not drawn of tiles; draw the products with the tool that reads them"
    single = {n: t for n, t in writes.items() if not ((tiling and t.folder) or t.delivered)}
    taken = sources.folders(reads)
    found |= delivery.problems(spec, writes, sources.paths(reads), taken, overwrite=overwrite)
    found |= targets.problems(single, sources.paths(reads), overwrite=overwrite)
    if found:
        raise ParameterError(spec.id, dict(sorted(found.items())))
    return values
