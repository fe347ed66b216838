"""Lineage of a run: the record of a run that begins, from its inputs, settings and counts.

The files of the inputs are named with size and hash, layers in memory with the hash of what they
hold. Files that carry a record themselves become ancestors of the products.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from pyproj import CRS

from toolbox import __version__
from toolbox.context import QUIET, Context, log
from toolbox.data import shapefile
from toolbox.data.crs import crs_text
from toolbox.data.layer import Inside, Layer
from toolbox.data.reading import Reading
from toolbox.data.remote.address import Address
from toolbox.declare.fields import Field, Spec
from toolbox.errors import DataError
from toolbox.models.model import Model, Runner, leading_steps, run_tool
from toolbox.reports.page import Told, told_by
from toolbox.runs import origins
from toolbox.runs.origins import Origin
from toolbox.runs.provenance import Count, Entry, Input, Record, plain, read, with_room
from toolbox.runs.source import Source, Sources
from toolbox.runs.target import Target

MANY = 100  # files of a source; of more the record keeps one hash instead of their names
FILE = "file"  # the word of parameters that name a file
IN_MEMORY = "in memory"  # what stands for the name of a file where there is none


def record_of(
    spec: Spec,
    settings: Mapping[str, Any],
    sources: Sources,
    reading: Reading,
    *,
    assume_crs: CRS | None = None,
    model: Path | None = None,
    ctx: Context = QUIET,
) -> Record:
    """The record of a run that is about to begin, without outputs and counts.

    What each output is comes with :meth:`Record.of`, and the counts come from the run.

    Parameters
    ----------
    settings : values of parameters; those that are missing have their defaults
    sources, reading : what is read, and what is known of the files already
    model : file of the model, unless it is part of the toolbox
    """
    inputs, ancestors, omitted = describe_inputs(spec, sources, reading, ctx)
    inputs |= _of_settings(spec, settings, reading)
    return Record(
        version=__version__,
        tool=spec.id,
        title=spec.title,
        model=describe_files([model]) if model else None,
        qgis=qgis_of(spec),
        parameters={
            name: _parameter(field, settings.get(name, field.default))
            for name, field in spec.inputs.items()
            if field.role == "param"
        },
        inputs=inputs,
        assume_crs=crs_text(assume_crs),
        leads={output: frozenset(leading_to(spec, output)) for output in spec.results},
        ancestors=ancestors,
        omitted=omitted,
    )


def _of_settings(
    spec: Spec, settings: Mapping[str, Any], reading: Reading
) -> dict[str, tuple[Input, ...]]:
    """The files that parameters name.

    Raises
    ------
    DataError
        One cannot be read.
    """
    named = {n: settings.get(n) for n, f in spec.inputs.items() if f.kind.word == FILE}
    try:
        return {
            name: (_described([Path(value)], {}, reading, QUIET),)
            for name, value in named.items()
            if value is not None
        }
    except DataError as error:
        raise DataError(f"{spec.id}: {error}") from error


def qgis_of(spec: Spec) -> str:
    """The version of the QGIS whose algorithms a tool or model runs, or ""."""
    if not isinstance(spec, Model):
        return getattr(spec.make, "qgis_version", "")
    return next(filter(None, (qgis_of(step.spec) for step in spec.steps.values())), "")


def describe_inputs(
    spec: Spec, sources: Sources, reading: Reading, ctx: Context = QUIET
) -> tuple[dict[str, tuple[Input, ...]], dict[str, Entry], int]:
    """Description of the sources of a run with their hashes, and the records of their files.

    Parameters
    ----------
    reading : what is known of the files; the others are read for their hashes
    ctx : progress over all bytes, which are hashed

    Returns
    -------
    inputs : by name of the source
    ancestors : as in :class:`Record`
    omitted : number of ancestors that the records of the inputs leave out

    Raises
    ------
    DataError
        Files cannot be read: all of them, by source.
    """
    inputs: dict[str, tuple[Input, ...]] = {name: () for name in spec.sources if name in sources}
    given = [(name, source) for name in inputs for source in sources[name]]
    problems: dict[str, str] = {}
    files: list[Path] = []
    for place, (name, source) in enumerate(given):
        part = ctx.part(place / len(given), (place + 1) / len(given))
        try:
            inputs[name] += tuple(_inputs(source, reading, part))
            files += read_files(source.files)
        except DataError as error:
            problems[name] = str(error)
    if problems:
        raise DataError(spec.id, problems)
    ctx.progress(1.0)
    return inputs, *_ancestors(files, filter(None, map(_origin, (s for _, s in given))), reading)


def leading_to(spec: Spec, output: str) -> Iterator[tuple[str, str]]:
    """The layers that an output depends on, as pairs of step and name, itself included.

    A run may make more layers than were asked for, and does so differently on tiles: they are
    no part of how this one was made.
    """
    if not isinstance(spec, Model):
        yield from ((spec.id, name) for name in (*spec.sources, output))
        return
    names = spec.returns[output].names if output in spec.returns else (output,)
    steps = [spec.steps[name] for name in leading_steps(spec.steps, names)]
    used = {*names, *(need for step in steps for need in step.needs)}
    for step in steps:
        yield from ((step.name, name) for name in step.spec.sources)
        yield from (
            (step.name, name) for name in step.spec.outputs if f"{step.name}.{name}" in used
        )


def counting(counts: list[Count], inner: Runner = run_tool) -> Runner:
    """Runner for `ModelRun.runner` that runs `inner`, and appends the sizes of layers to a list."""

    def run(step: str, job: Any, ctx: Context) -> Any:
        counts.extend(counted(step, job.spec.sources, job))
        result = inner(step, job, ctx)
        counts.extend(counted(step, job.spec.outputs, result))
        return result

    return run


def telling(told: Told, inner: Runner) -> Runner:
    """Runner that runs `inner`, and notes what the results of each step say in words."""

    def run(step: str, job: Any, ctx: Context) -> Any:
        result = inner(step, job, ctx)
        words, unseen = told_by(job.spec, result)
        told.words += [(step, text) for text in words]
        told.unseen += unseen
        return result

    return run


def sizes_of(found: Mapping[str, Any]) -> dict[str, int | None]:
    """Points, features, rows or cells with a value of the layers among results, by name."""
    return {name: layer.size() for name, layer in found.items() if isinstance(layer, Layer)}


def tell_empty(
    spec: Spec, sizes: Mapping[str, int | None], targets: Iterable[Target], told: Told
) -> None:
    """Warn, before all else, of rasters without a single cell that has a value.

    What a set alone holds is not told: it is left out of that, which its README says.

    Parameters
    ----------
    sizes : cells with a value, by name of the result
    targets : what is written
    """
    wanted = {*spec.outputs, *(target.output for target in targets if not target.delivered)}
    gridded = [n for n in sizes if n in wanted and spec.results[n].kind.is_gridded]
    if empty := [name for name in gridded if sizes[name] == 0]:
        titles = ", ".join(f"{name} ({spec.results[name].title})" for name in empty)
        log.warning("not a single cell has a value in: %s", titles)
        told.warnings.insert(0, told.warnings.pop())


def counted(
    step: str, fields: Mapping[str, Field], values: Any, inside: Inside | None = None
) -> Iterator[Count]:
    """Sizes of the layers of a step.

    Parameters
    ----------
    step : id of the tool, or name of the step
    fields : its sources or its outputs
    values : what has them as attributes: the tool itself, or what its run gave
    inside : count only what belongs to this tile
    """
    for name, field in fields.items():
        if not field.kind.is_layer:
            continue
        layers: tuple[Layer | None, ...] = field.items(getattr(values, name, None))
        sizes = [layer.size(inside) for layer in layers if layer is not None]
        if known := [size for size in sizes if size is not None]:
            yield Count(step, name, sum(known))


def _parameter(field: Field, value: Any) -> Any:
    """A value as JSON, from which the field parses the same value again; of files their names."""
    if field.kind.word == FILE and value is not None:
        return Path(value).name
    return plain(_numbers_as_floats(field.to_json(value), field.kind.schema))


def _numbers_as_floats(value: Any, schema: Mapping[str, Any]) -> Any:
    """JSON value with floats where the schema says number: 2 is the same as 2.0."""
    if isinstance(value, list):
        return [_numbers_as_floats(item, schema.get("items", schema)) for item in value]
    is_number = schema.get("type") == "number" and isinstance(value, int | float)
    return float(value) if is_number else value


def _inputs(source: Source, reading: Reading, ctx: Context) -> Iterator[Input]:
    """Descriptions of the files of a layer: one each, or a single one if there are very many."""
    if origin := _origin(source):
        yield Input(IN_MEMORY, origin.sha256, None)
        return
    options = plain(source.options)
    paths = source.files
    groups = [paths] if len(paths) > MANY else [(path,) for path in paths]
    for place, group in enumerate(groups):
        part = ctx.part(place / len(groups), (place + 1) / len(groups))
        yield _described(group, options, reading, part)


def _origin(source: Source) -> Origin | None:
    """What is known of a layer that is or was in memory; None of one in files."""
    return source.origin or (None if source.layer is None else origins.of(source.layer))


def remember(
    found: Mapping[str, Any],
    sources: Sources,
    reading: Reading,
    describe: Callable[[Sources, Reading], Record],
    counts: Sequence[Count],
) -> None:
    """Remember how the layers were made that a run leaves in memory.

    Parameters
    ----------
    found : the results of the run that are no files, by name
    sources, reading : what the run has read, and what is known of the files
    describe : gives the record of the run, without counts
    """
    if not any(isinstance(value, Layer | tuple) for value in found.values()):
        return
    kept = {
        n: tuple(replace(s, layer=None, origin=_origin(s)) for s in sources[n]) for n in sources
    }
    before = tuple(s.origin for items in kept.values() for s in items if s.origin)

    def record(output: str, number: int | None, crs: str) -> Record:
        origins.check_unchanged(reading)
        whole = replace(describe(kept, reading), counts=tuple(counts))
        return replace(whole.of(output, None, {}, number), crs=crs)

    for name, value in found.items():
        several = isinstance(value, tuple)
        for number, layer in enumerate(value if several else [value], start=1):
            if isinstance(layer, Layer):
                which = (name, number if several else None, crs_text(layer.crs))
                origins.remember(layer, Origin(partial(record, *which), before))


def _described(
    paths: Sequence[Path], options: Mapping[str, Any], reading: Reading, ctx: Context
) -> Input:
    """Description of one file with its side-cars, or of many files together."""
    parts = list(read_files(paths))
    hashes: dict[Path, str] = {}
    for place, part in enumerate(parts):
        share = ctx.part(place / len(parts), (place + 1) / len(parts))
        hashes[part] = reading.hash_of(part, share)
    name = _pattern(paths) if len(paths) > 1 else _shown(paths[0])
    size = sum(reading.sizes[part] for part in parts)
    return Input(name, joint_hash(hashes), size, len(parts), options)


def _shown(path: Path) -> str:
    """The name of a file; of one on the web its address, without what must stay secret."""
    return str(path) if isinstance(path, Address) else path.name


def describe_files(paths: Sequence[Path], ctx: Context = QUIET) -> Input:
    """Description of one file, or of many together, without options.

    Raises
    ------
    DataError
        A file cannot be read.
    """
    return _described(paths, {}, Reading(), ctx)


def read_files(paths: Iterable[Path]) -> Iterator[Path]:
    """The files that are read for some paths: several for a Shapefile."""
    for path in paths:
        yield from shapefile.parts(path) if path.suffix.lower() == shapefile.SUFFIX else [path]


def _pattern(paths: Iterable[Path]) -> str:
    """Pattern for the names of files: *.laz where all have this suffix, else *."""
    suffixes = {path.suffix for path in paths}
    return f"*{suffixes.pop()}" if len(suffixes) == 1 else "*"


def joint_hash(hashes: Mapping[Path, str]) -> str:
    """The hash of one file, or the common hash of several; see :class:`Input`."""
    if len(hashes) == 1:
        return next(iter(hashes.values()))
    lines = sorted((path.name, digest) for path, digest in hashes.items())
    text = "".join(f"{digest}  {name}\n" for name, digest in lines)
    return hashlib.sha256(text.encode()).hexdigest()


def _ancestors(
    files: Iterable[Path], layers: Iterable[Origin], reading: Reading
) -> tuple[dict[str, Entry], int]:
    """Records of inputs and of their ancestors by hash, and the number of ancestors left out."""
    records = {origin.sha256: origin.record for origin in layers}
    for path in dict.fromkeys(files):
        try:
            records[reading.hash_of(path)] = read(path, reading)
        except DataError as error:
            log.warning("%s; how it was made is not passed on", error)
    known = {key: record for key, record in records.items() if record is not None}
    found: dict[str, Entry] = {key: record.entry() for key, record in known.items()}
    for record in known.values():
        found |= {key: entry for key, entry in record.ancestors.items() if key not in found}
    kept = with_room(found)
    lost = (len({*one.ancestors} - {*kept}) + one.omitted for one in known.values())
    return kept, max(len(found) - len(kept), *lost, 0)
