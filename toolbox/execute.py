"""Runs a tool by its id, on paths or layers, and writes the outputs that have a path."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Never

from pyproj import CRS

from toolbox import catalog, language, renamed
from toolbox.context import QUIET, Context, listening, log
from toolbox.data.crs import length_problem, metres_per_unit, parse_crs, short_unit, unit_of
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
from toolbox.runs.provenance import Count
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
    with listening() as warnings:
        return _run(
            id,
            values,
            Told(warnings=warnings),
            overwrite=overwrite,
            assume_crs=assume_crs,
            picture=picture,
            tiling=tiling,
            resume=resume,
            ctx=ctx,
        )


OPTIONS = tuple(
    name
    for name, option in inspect.signature(run).parameters.items()
    if option.kind is option.KEYWORD_ONLY
)
"""The names of the options of a run, beside its inputs and outputs."""


def _run(
    id: str,
    values: Mapping[str, Any],
    told: Told,
    *,
    overwrite: bool,
    assume_crs: str | CRS | None,
    picture: str | Path | None,
    tiling: Tiling | None,
    resume: bool,
    ctx: Context,
) -> Results:
    """Run a tool; what it tells is noted."""
    spec = catalog.load(id)
    values = renamed.values(spec.id, values)
    values = {**values, PICTURE: picture} if picture is not None else values
    results = spec.results.keys() | SHOWN
    given = {name: value for name, value in values.items() if name not in results}
    wanted = {n: v for n, v in values.items() if n in results and v is not None}
    reads = sources.of_run(given, spec)
    writes = delivery.of_run(wanted, spec)
    whole = spec
    if isinstance(spec, Model):
        given = {**(spec.handed if delivery.is_asked(writes) else {}), **given}
        spec = spec.wanting(target.output for target in writes.values())
    settings = _checked(spec, given, reads, writes, tiling, overwrite=overwrite)
    delivery.tell_missing(writes)
    _tell_idle(whole, [n for n in spec.idle(settings) if given.get(n) is not None])
    spec = spec.under(settings)
    crs = _crs(assume_crs, id)
    files = Reading.of(read_files(sources.paths(reads)))
    reading = files if writes else None
    model = Path(id) if id.endswith(catalog.MODEL) else None
    describe = partial(record_of, spec, settings, assume_crs=crs, model=model)
    if tiling:
        from toolbox.tiles import engine as tiles

        with delivery.folder_of(writes):
            made = tiles.run(
                id,
                spec,
                settings,
                reads,
                writes,
                tiling,
                reading=reading,
                record=describe(reads, reading, ctx=ctx.part(0, HASH)) if reading else None,
                overwrite=overwrite,
                resume=resume,
                assume_crs=crs,
                told=told,
                ctx=ctx.part(HASH if writes else 0, 1),
            )
        return Results.of(spec, made)
    layers = sources.opened(spec, reads, crs, reading, ctx.part(0, READ - HASH))
    given_layers = (layer for n, value in layers.items() for layer in spec.sources[n].items(value))
    targets.check_crs(spec.id, writes, given_layers)
    cells.check(spec, settings, layers)
    _tell_lengths(spec, {n: settings[n] for n in given if n in settings}, layers)
    record = describe(reads, reading, ctx=ctx.part(READ - HASH, READ)) if reading else None
    if reading:
        reading.check_unchanged()
    job = spec.build(settings | layers)
    asked, counts = _between(spec, writes), list[Count]()
    runner = Cache().runner(counting(counts)) if resume else counting(counts)
    runner = telling(told, runner)
    told.given = layers
    if isinstance(job, ModelRun):
        result = replace(job, keep=frozenset(asked), runner=runner).run(ctx.part(READ, WRITE))
    else:
        result = runner(id, job, ctx.part(READ, WRITE))
    found = {name: getattr(result, name) for name in [*spec.outputs, *asked]}
    tell_empty(spec, sizes_of(found), writes.values(), told)
    record = record and replace(record, counts=tuple(counts))
    part = ctx.part(WRITE, 1)
    made = _written(spec, found, writes, part, record=record, told=told, overwrite=overwrite)
    in_memory = {name: value for name, value in made.items() if value is found.get(name)}
    remember(in_memory, reads, files, describe, counts)
    return made


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
    """Warn of settings that no step uses, and say which ones would."""
    for name in names:
        titles = ", ".join(map(language.text, spec.users(name)))
        log.warning("%s: is not used by any step that runs; it is for: %s", name, titles)


def _tell_lengths(spec: Spec, given: Mapping[str, Any], layers: Mapping[str, Any]) -> None:
    """Say what given lengths are in the unit of the data, where that is not the metre."""
    found = (layer for n, value in layers.items() for layer in spec.sources[n].items(value))
    crs = next((layer.crs for layer in found if layer.is_spatial and layer.crs), None)
    if crs is None or length_problem(crs) or metres_per_unit(crs) == 1:
        return
    unit = unit_of(metres_per_unit(crs)) or short_unit(crs)
    texts = [
        f"{name} {value:.6g} m = {value / metres_per_unit(crs):.7g} {unit}"
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
