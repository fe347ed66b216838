"""Provenance records: how a product was made, as JSON text that every output carries.

A record names the tool with all its parameters (seeds among them), the inputs with size and hash,
the CRS, and how many points, features and cells went in and came out of each step. It says enough
to run the tool again (see `toolbox.cli.replay`), and nothing that differs from one run to the next:
no times, users, computers, folders, or number of processes or tiles. So two runs on the same
inputs give the same bytes, wherever they take place.

Of the software it names the version of this toolbox, and that of QGIS where its algorithms took
part. Versions of numpy or GDAL differ between computers although the products do not; they are in
the lock file or the environment of whoever needs them, and a replay says whether they made a
difference.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from pyproj import CRS

from toolbox import __version__
from toolbox.context import QUIET, Context, log
from toolbox.data.crs import crs_text
from toolbox.data.layer import Inside, Layer, text_array
from toolbox.data.reading import Reading, file_hash
from toolbox.data.record import MEMBER, read_record
from toolbox.declare.fields import Field, Spec
from toolbox.errors import DataError
from toolbox.models.model import Model, Runner, leading_steps, run_tool
from toolbox.runs.source import Source, Sources

LONGEST = 60_000  # bytes of a record; a VLR of a LAS file holds 65 535
MANY = 100  # files of a source; of more the record keeps one hash instead of their names
IN_MEMORY = "in memory"  # what stands for the name of a file where there is none
_SHAPEFILE = (".dbf", ".shx", ".prj", ".cpg")  # parts of a Shapefile that are read

Entry = Mapping[str, Any]
"""A record as JSON, without its ancestors."""


@dataclasses.dataclass(frozen=True)
class Input:
    """A file that was read, or a layer that was given in memory.

    Attributes
    ----------
    file : name without folder; "in memory"; of very many files what their names have in common,
        such as "*.laz"
    sha256 : of the file; of several (many files, the parts of a Shapefile) that of the lines
        ``<hash>  <name>`` in the order of the names, as the program sha256sum prints them
    bytes : size, of all files together; None in memory
    files : their number
    options : how the file was opened, such as columns or bounds
    """

    file: str
    sha256: str
    bytes: int | None
    files: int = 1
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def in_memory(self) -> bool:
        """Whether the layer was given in memory, without a file."""
        return self.bytes is None


@dataclasses.dataclass(frozen=True)
class Count:
    """Number of points, features, rows or cells with a value of a layer that a step read or gave.

    Attributes
    ----------
    step : id of the tool, or name of the step in a model
    name : of its input or output
    """

    step: str
    name: str
    count: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class Record:
    """Provenance record of one file.

    Attributes
    ----------
    version : of the toolbox
    tool : id of the tool or model
    title : what it does, in a few words
    model : the file of a model that is not part of the toolbox
    qgis : version of the QGIS whose algorithms took part, or "", which the text leaves out
    output, number : which output of the tool the file is, and which layer of several, from 1
    file : of a folder of files, one for each file of a survey: the name of the one it belongs to
    options : how it was written, such as cog
    layers : other outputs of the run in the same GeoPackage, and how they were written
    parameters : all of them, also those that were left at their defaults, as JSON values
    inputs : by name of the source
    assume_crs : what was assumed for sources that state no CRS, or ""
    crs : of the file, as a code, "local" or WKT; "" if it has none
    counts : in the order of the steps; of a file, those of the layers that led to it
    leads : which layers lead to each output, as pairs of step and name; not part of the text
    ancestors : the records of files from which the inputs were made, and so on backwards, by the
        sha256 of each file; the nearest come first
    omitted : number of ancestors for which there was no room, at least
    """

    version: str
    tool: str
    title: str
    model: Input | None = None
    qgis: str = ""
    output: str = ""
    number: int | None = None
    file: str = ""
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    layers: Mapping[str, Mapping[str, Any]] = dataclasses.field(default_factory=dict)
    parameters: Mapping[str, Any]
    inputs: Mapping[str, tuple[Input, ...]]
    assume_crs: str = ""
    crs: str = ""
    counts: tuple[Count, ...] = ()
    leads: Mapping[str, frozenset[tuple[str, str]]] = dataclasses.field(
        default_factory=dict, repr=False, compare=False
    )
    ancestors: Mapping[str, Entry] = dataclasses.field(default_factory=dict)
    omitted: int = 0

    def of(
        self,
        output: str,
        layer: Any,
        options: Mapping[str, Any],
        number: int | None = None,
        *,
        file: str = "",
        layers: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> Self:
        """The record of one output, from the record of its run.

        Parameters
        ----------
        layer : that is written; anything without a CRS, such as a picture, has none
        options : values as the layer's `save` takes them
        layers : the options of other outputs in the same file, by name
        """
        crs = getattr(layer, "crs", None)
        own = {"number": number, "file": file, "options": _plain(options), "crs": crs_text(crs)}
        leads = [self.leads.get(name) for name in (output, *(layers or {}))]
        counts = (c for c in self.counts if any(way is None or _is_among(c, way) for way in leads))
        own["layers"] = _plain(layers or {})
        return dataclasses.replace(self, output=output, counts=tuple(counts), **own)

    def entry(self) -> dict[str, Any]:
        """The record as JSON values, without its ancestors."""
        values = dataclasses.asdict(self)
        for name in ("version", "ancestors", "omitted", "leads", *(() if self.qgis else ("qgis",))):
            values.pop(name)
        return {MEMBER: self.version, **_plain(values)}

    def to_json(self) -> str:
        """The record as one line of ASCII; of too long ones the oldest ancestors are left out."""
        kept, omitted = dict(self.ancestors), self.omitted
        sizes = {key: len(_dumps({key: entry})) for key, entry in kept.items()}
        total = len(_dumps(self.entry())) + sum(sizes.values()) + 100  # with what stands around
        while kept and total > LONGEST:
            key, _ = kept.popitem()
            total -= sizes[key]
            omitted += 1
        return _dumps(self.entry() | {"ancestors": kept, "omitted": omitted})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read what :meth:`to_json` has written; members of later versions are left out.

        Raises
        ------
        DataError
            It is not such a text.
        """
        try:
            found = dict(json.loads(text))
            found["version"] = found.pop(MEMBER)
            known = {field.name for field in dataclasses.fields(cls)}
            values = {name: value for name, value in found.items() if name in known}
            if values.get("model"):
                values["model"] = Input(**values["model"])
            inputs = {n: tuple(Input(**i) for i in items) for n, items in found["inputs"].items()}
            counts = tuple(Count(**count) for count in found["counts"])
            ancestors = {key: dict(entry) for key, entry in found["ancestors"].items()}
            values |= {"inputs": inputs, "counts": counts, "ancestors": ancestors}
            return cls(**values)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise DataError(f"the record is damaged or of a later version: {error!r}") from error

    def text(self) -> str:
        """The record as text to read."""
        return "\n".join(_words(self))


def read(path: str | Path, reading: Reading | None = None) -> Record | None:
    """The record that a file carries; None if it has none.

    Parameters
    ----------
    reading : what is known of files that were read before

    Raises
    ------
    DataError
        The file is missing or damaged, or its record is.
    """
    known = reading.records.get(Path(path)) if reading else None
    text = read_record(path) if known is None else known
    try:
        return Record.from_json(text) if text else None
    except DataError as error:
        raise error.named(str(path)) from error


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
            files += [part for path in source.files for part in _parts(path)]
        except DataError as error:
            problems[name] = str(error)
    if problems:
        raise DataError(spec.id, problems)
    ctx.progress(1.0)
    return inputs, *_ancestors(files, reading)


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


def _is_among(count: Count, leads: frozenset[tuple[str, str]]) -> bool:
    """Whether a count belongs to one of the layers; for a model inside a model, to any of them."""
    step, inside, _ = count.step.partition("/")
    step = step.partition(" ")[0]
    return (step, count.name) in leads or bool(inside and any(step == name for name, _ in leads))


def counting(counts: list[Count], inner: Runner = run_tool) -> Runner:
    """Runner for `ModelRun.runner` that runs `inner`, and appends the sizes of layers to a list."""

    def run(step: str, job: Any, ctx: Context) -> Any:
        counts.extend(counted(step, job.spec.sources, job))
        result = inner(step, job, ctx)
        counts.extend(counted(step, job.spec.outputs, result))
        return result

    return run


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
    """A value as JSON, from which the field parses the same value again."""
    return _plain(_numbers_as_floats(field.to_json(value), field.kind.schema))


def _numbers_as_floats(value: Any, schema: Mapping[str, Any]) -> Any:
    """JSON value with floats where the schema says number: 2 is the same as 2.0."""
    if isinstance(value, list):
        return [_numbers_as_floats(item, schema.get("items", schema)) for item in value]
    is_number = schema.get("type") == "number" and isinstance(value, int | float)
    return float(value) if is_number else value


def _plain(value: Any) -> Any:
    """A value with the types that JSON has."""
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _dumps(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


def _inputs(source: Source, reading: Reading, ctx: Context) -> Iterator[Input]:
    """Descriptions of the files of a layer: one each, or a single one if there are very many."""
    if source.layer is not None:
        yield Input(IN_MEMORY, _content(source.layer), None)
        return
    options = _plain(source.options)
    paths = source.files
    groups = [paths] if len(paths) > MANY else [(path,) for path in paths]
    for place, group in enumerate(groups):
        part = ctx.part(place / len(groups), (place + 1) / len(groups))
        yield _described(group, options, reading, part)


def _described(
    paths: Sequence[Path], options: Mapping[str, Any], reading: Reading, ctx: Context
) -> Input:
    """Description of one file with its side-cars, or of many files together."""
    parts = [part for path in paths for part in _parts(path)]
    hashes: dict[Path, str] = {}
    for place, part in enumerate(parts):
        share = ctx.part(place / len(parts), (place + 1) / len(parts))
        hashes[part] = reading.hash_of(part, share)
    name = paths[0].name if len(paths) == 1 else _pattern(paths)
    size = sum(reading.sizes[part] for part in parts)
    return Input(name, joint_hash(hashes), size, len(parts), options)


def describe_files(paths: Sequence[Path], ctx: Context = QUIET) -> Input:
    """Description of one file, or of many together, without options.

    Raises
    ------
    DataError
        A file cannot be read.
    """
    return _described(paths, {}, Reading(), ctx)


def _parts(path: Path) -> list[Path]:
    """The files that belong to a path: several for a Shapefile."""
    if path.suffix.lower() != ".shp":
        return [path]
    return [path, *(part for end in _SHAPEFILE if (part := path.with_suffix(end)).is_file())]


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


def _content(layer: Layer) -> str:
    """SHA-256 of the content of a layer, in memory and in files."""
    made = hashlib.sha256(crs_text(layer.crs).encode())
    of_files = ((path.name, text_array(file_hash(path))) for path in layer.paths)
    for name, values in itertools.chain(layer.contents(), of_files):
        array = np.ascontiguousarray(values)
        made.update(f"{name} {array.dtype.str} {array.shape}".encode())
        made.update(array.data if array.size else b"")
    return made.hexdigest()


def _ancestors(files: Iterable[Path], reading: Reading) -> tuple[dict[str, Entry], int]:
    """Records of files and of their ancestors by hash, and the number of ancestors left out."""
    near: dict[str, Entry] = {}
    far: dict[str, Entry] = {}
    omitted = 0
    for path in dict.fromkeys(files):
        try:
            record = read(path, reading)
        except DataError as error:
            log.warning("%s; how it was made is not passed on", error)
            continue
        if record is not None:
            near[reading.hash_of(path)] = record.entry()
            far |= {key: entry for key, entry in record.ancestors.items() if key not in far}
            omitted = max(omitted, record.omitted)
    return near | {key: entry for key, entry in far.items() if key not in near}, omitted


def _words(record: Record) -> Iterator[str]:
    number = "" if record.number is None else f" {record.number}"
    number += f" ({record.file})" if record.file else ""
    yield f"{record.output}{number} of {record.tool}: {record.title}"
    yield f"lidar-toolbox {record.version}"
    if record.qgis:
        yield f"QGIS {record.qgis}"
    if record.crs:
        yield f"CRS {_short(record.crs)}"
    yield from _listed("written with", record.options)
    yield "inputs"
    for name, items in record.inputs.items():
        yield from (f"  {name}: {_named(item)}" for item in items)
    if record.model:
        yield f"  model: {_named(record.model)}"
    if record.assume_crs:
        yield f"  CRS assumed where none is stated: {_short(record.assume_crs)}"
    yield from _listed("parameters", record.parameters)
    if record.counts:
        yield "counts"
    for count in record.counts:
        yield f"  {count.step}.{count.name}: {count.count}"
    if record.ancestors:
        yield "made from"
    names = _file_names(record)
    for digest, entry in record.ancestors.items():
        file = names.get(digest, digest[:12])
        yield f"  {file}: {entry.get('output', '')} of {entry.get('tool', '')}"
    if record.omitted:
        yield f"  and at least {record.omitted} files before"


def _listed(title: str, values: Mapping[str, Any]) -> Iterator[str]:
    if values:
        yield title
    yield from (f"  {name}: {_short(_dumps(value))}" for name, value in values.items())


def _named(item: Input) -> str:
    size = "" if item.bytes is None else f", {item.bytes} bytes"
    several = f" ({item.files} files)" if item.files > 1 else ""
    options = f", {_dumps(item.options)}" if item.options else ""
    return f"{item.file}{several}{size}, sha256 {item.sha256}{options}"


def _file_names(record: Record) -> dict[str, str]:
    """Names of files by hash, from the inputs of a record and of its ancestors."""
    found = {item.sha256: item.file for items in record.inputs.values() for item in items}
    for entry in record.ancestors.values():
        for items in dict(entry.get("inputs", {})).values():
            found |= {item.get("sha256"): item.get("file") for item in items}
    return found


def _short(text: str) -> str:
    """A text shortened to a hundred characters, since a WKT would fill a page."""
    return text if len(text) <= 100 else f"{text[:97]}..."
