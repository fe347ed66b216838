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
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from toolbox.data.crs import crs_text
from toolbox.data.reading import Reading
from toolbox.data.record import MEMBER, read_record
from toolbox.data.remote.address import as_path
from toolbox.errors import DataError

LONGEST = 60_000  # bytes of a record; a VLR of a LAS file holds 65 535

Entry = Mapping[str, Any]
"""A record as JSON, without its ancestors."""


@dataclasses.dataclass(frozen=True)
class Input:
    """A file that was read, or a layer that was given in memory.

    Attributes
    ----------
    file : name without folder; "in memory"; of very many files what their names have in common,
        such as "*.laz"
    sha256 : of the file; of a layer in memory that of the record of the run that made it, or of
        its content if none did; of several (many files, the parts of a Shapefile) that of the lines
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
    ancestors : the records of the inputs, files or layers in memory that a run made, of those that
        they were made from, and so on backwards, by the sha256 of each; the nearest come first
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
        own = {"number": number, "file": file, "options": plain(options), "crs": crs_text(crs)}
        leads = [self.leads.get(name) for name in (output, *(layers or {}))]
        counts = (c for c in self.counts if any(way is None or _is_among(c, way) for way in leads))
        own["layers"] = plain(layers or {})
        return dataclasses.replace(self, output=output, counts=tuple(counts), **own)

    def entry(self) -> dict[str, Any]:
        """The record as JSON values, without its ancestors."""
        values = dataclasses.asdict(dataclasses.replace(self, ancestors={}, leads={}))
        for name in ("version", "ancestors", "omitted", "leads", *(() if self.qgis else ("qgis",))):
            values.pop(name)
        return {MEMBER: self.version, **plain(values)}

    def to_json(self) -> str:
        """The record as one line of ASCII; of too long ones the oldest ancestors are left out."""
        own = len(_dumps(self.entry())) + 100  # with what stands around
        kept = with_room(self.ancestors, LONGEST - own)
        omitted = self.omitted + len(self.ancestors) - len(kept)
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

    def ancestor(self, sha256: str) -> Self | None:
        """The record of one of the ancestors; None if there is none.

        Raises
        ------
        DataError
            It is damaged.
        """
        entry = self.ancestors.get(sha256)
        rest = {"ancestors": self.ancestors, "omitted": self.omitted}
        return None if entry is None else self.from_json(_dumps({**entry, **rest}))

    def text(self) -> str:
        """The record as text to read."""
        return "\n".join(_words(self))


def with_room(ancestors: Mapping[str, Entry], room: int = LONGEST) -> dict[str, Entry]:
    """The first ancestors, as many as have room.

    Parameters
    ----------
    room : bytes for their text
    """
    kept = {}
    for key, entry in ancestors.items():
        room -= len(_dumps({key: entry}))
        if room < 0:
            break
        kept[key] = entry
    return kept


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
    known = reading.records.get(as_path(path)) if reading else None
    text = read_record(path) if known is None else known
    try:
        return Record.from_json(text) if text else None
    except DataError as error:
        raise error.named(str(path)) from error


def _is_among(count: Count, leads: frozenset[tuple[str, str]]) -> bool:
    """Whether a count belongs to one of the layers; for a model inside a model, to any of them."""
    step, inside, _ = count.step.partition("/")
    step = step.partition(" ")[0]
    return (step, count.name) in leads or bool(inside and any(step == name for name, _ in leads))


def plain(value: Any) -> Any:
    """A value with the types that JSON has."""
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _dumps(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


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
    digest = f"sha256 {item.sha256}" if item.sha256 else "made of what has changed since"
    return f"{item.file}{several}{size}, {digest}{options}"


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
