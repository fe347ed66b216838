"""The verb ``replay``: makes a product again from its record, and compares the two."""

from __future__ import annotations

import glob
import os
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolbox import __version__, catalog
from toolbox.context import QUIET, Context, log
from toolbox.data import Report
from toolbox.data.crs import FEET, describe_crs, same_crs
from toolbox.data.layer import Layer
from toolbox.data.reading import file_hash
from toolbox.declare.kinds import find
from toolbox.errors import DataError, ParameterError
from toolbox.execute import run
from toolbox.models.model import Model
from toolbox.runs import lineage, provenance
from toolbox.runs.provenance import Input, Record
from toolbox.runs.source import Source
from toolbox.runs.target import Target, kind_of
from toolbox.shown import PAGE, PICTURE, SHOWN
from toolbox.tiles.tiling import Tiling

_REPORT = find(Report)
_LOOKS = re.compile(rb"<style>.*?</style>\s*|<img class=\"logo\"[^>]*>\s*", re.S)
FIND, COMPARE = 0.05, 0.9  # of the progress, when inputs are found and comparison begins


def replay(
    path: str | Path, *, inputs: Path | Sequence[Path] = (), ctx: Context = QUIET
) -> list[str]:
    """Run the tool that made a file again, and compare.

    Parameters
    ----------
    path : of the product
    inputs : folders to search for the inputs and the file of a model, with all folders below them;
        the folder of the product is searched first
    ctx : takes the progress, and may cancel the run

    Returns
    -------
    list of str
        The differences; empty if all points, cells or features are the same. It is logged whether
        the files are the same byte for byte.

    Raises
    ------
    DataError
        The file has no record, was made from layers in memory that no run made, or inputs are
        missing or have changed; the error lists them all.
    ParameterError
        This version of the toolbox does not know the tool or a parameter of it, or a folder is
        not there.
    """
    path = Path(path)
    given = (inputs,) if isinstance(inputs, Path) else tuple(inputs)
    if lost := [str(one) for one in given if not one.is_dir()]:
        raise ParameterError("replay", {"inputs": f"there is no folder {', '.join(lost)}"})
    record = provenance.read(path)
    if record is None:
        raise DataError(f"{path} carries no record of how it was made")
    if record.version != __version__:
        log.warning("%s was made by version %s; this is %s", path, record.version, __version__)
    finder = _Finder(path.absolute().parent, given)
    last = finder.last(record, ctx.part(0, FIND))
    tool = last.tool
    _check(path, record, tool)
    if record.qgis and record.qgis != (here := lineage.qgis_of(catalog.load(tool))):
        log.warning("%s was made with QGIS %s; this is %s", path, record.qgis, here)
    with tempfile.TemporaryDirectory(prefix="toolbox-replay-") as folder:
        count = len(finder.steps)
        begin = FIND + (COMPARE - FIND) * count / (count + 1)  # of the last, of as many equal parts
        values = last.given(_handed_on(finder.steps, last, ctx.part(FIND, begin)))
        made = _made_again(record, tool, values, Path(folder) / path.name, ctx.part(begin, COMPARE))
        if _same_files(path, made, kind_of(record.output, catalog.load(tool)).own_files):
            log.info("%s: the same, byte for byte", path.name)
            return []
        found = list(_differences(path, made, record, tool))
    if not found:
        log.info("%s: the content is the same, but not every byte of the file", path.name)
    ctx.progress(1.0)
    return found


def _that_were_set(values: Mapping[str, Any], tool: str, wanted: Iterable[str]) -> dict[str, Any]:
    """The values without defaults: a record names them too, and some no step of a model may use.

    A length that has another default for data in feet counts as set wherever it is used: which of
    the two the run took need not be known then.

    Parameters
    ----------
    wanted : the results to make
    """
    spec = catalog.load(tool)
    idle = (spec.wanting(wanted) if isinstance(spec, Model) else spec).idle(values)
    defaults: dict[str, list[Any]] = {
        name: [field.to_json(field.default_in(foot)) for foot in (None, *FEET)]
        for name, field in spec.inputs.items()
        if field.role == "param" and not field.required and (field.feet is None or name in idle)
    }
    return {n: value for n, value in values.items() if value not in defaults.get(n, ())}


@dataclass(frozen=True)
class _Handed:
    """A layer that an earlier run handed on in memory; it is known by the hash of its record."""

    sha256: str


@dataclass(frozen=True)
class _Step:
    """A run with its values, as its record has them, and all that it reads from files found."""

    record: Record
    tool: str
    values: Mapping[str, Any]

    def handed(self) -> set[str]:
        """The layers that earlier runs handed on to it."""
        items = (i for v in self.values.values() for i in (v if isinstance(v, list) else [v]))
        return {item.sha256 for item in items if isinstance(item, _Handed)}

    def given(self, made: Mapping[str, Any]) -> dict[str, Any]:
        """The values to run it with, without defaults.

        Parameters
        ----------
        made : the layers that were handed on
        """

        def layer(value: Any) -> Any:
            if isinstance(value, list):
                return [layer(item) for item in value]
            return made[value.sha256] if isinstance(value, _Handed) else value

        wanted = (self.record.output, *self.record.layers)
        values = _that_were_set(self.values, self.tool, wanted)
        return {n: layer(value) for n, value in values.items()}

    def run(self, made: Mapping[str, Any], ctx: Context) -> Any:
        """Run it again, and give the layer that it handed on."""
        how: dict[str, Any] = {"assume_crs": self.record.assume_crs or None, "ctx": ctx}
        found = run(self.tool, self.given(made), **how)[self.record.output]
        return found if self.record.number is None else found[self.record.number - 1]


def _handed_on(steps: Mapping[str, _Step], last: _Step, ctx: Context) -> dict[str, Any]:
    """What the last run needs of earlier ones, each of which is run once.

    A layer is kept no longer than steps need it.

    Parameters
    ----------
    steps : the earlier runs, each behind those that it needs
    """
    until = {key: place for place, step in enumerate(steps.values()) for key in step.handed()}
    needed = last.handed()
    made: dict[str, Any] = {}
    for place, (key, step) in enumerate(steps.items()):
        made[key] = step.run(made, ctx.part(place / len(steps), (place + 1) / len(steps)))
        for old in step.handed() - needed:
            if until[old] == place:
                del made[old]
    return made


class _Finder:
    """Finds the inputs of records by name, and checks that they have not changed.

    Attributes
    ----------
    problems : of inputs that are missing or have changed, by where they belong
    steps : the runs that handed a layer on in memory, by the hash of its record; each stands
        behind those that it needs
    begun : the hashes of those whose own inputs are looked for
    """

    def __init__(self, beside: Path, below: Sequence[Path]) -> None:
        self.beside, self.below = beside, below
        self.problems: dict[str, str] = {}
        self.steps: dict[str, _Step] = {}
        self.begun: set[str] = set()

    def last(self, record: Record, ctx: Context) -> _Step:
        """The run that made the product; one error lists all that is missing or has changed."""
        found = self._step(record, (), ctx)
        if self.problems:
            raise DataError(f"{record.tool} cannot run again", self.problems)
        return found

    def _step(self, record: Record, way: tuple[str, ...], ctx: Context) -> _Step:
        """A run, with the paths of its inputs.

        Parameters
        ----------
        way : the inputs that lead to it from the product
        """
        named = [(name, item) for name, items in record.inputs.items() for item in items]
        found: dict[str, list[Any]] = {name: [] for name in record.inputs}
        for index, (name, item) in enumerate(named):
            part = ctx.part(index / len(named), (index + 1) / len(named))
            here = (*way, f"{record.tool}.{name}" if way else name)
            if item.in_memory:
                found[name].append(self._layer(record, item, here, part))
            elif paths := self._paths(item, here, part):
                found[name] += self._openable(item, paths)
        sources = {n: layers[0] if len(layers) == 1 else layers for n, layers in found.items()}
        here = (*way, f"{record.tool}.model" if way else "model")
        models = self._paths(record.model, here, ctx) if record.model else []
        return _Step(record, str([*models, record.tool][0]), dict(record.parameters) | sources)

    def _layer(self, record: Record, item: Input, here: tuple[str, ...], ctx: Context) -> _Handed:
        """A layer in memory, of which the run is found; if none made it, a problem is noted."""
        before = record.ancestor(item.sha256)
        if before is None:
            self.problems[_joined(here)] = _why_unknown(record, item)
        elif item.sha256 in self.begun - self.steps.keys():
            self.problems[_joined(here)] = "is made of itself, which no run can have recorded"
        elif item.sha256 not in self.steps:
            self.begun.add(item.sha256)
            self.steps[item.sha256] = self._step(before, here, ctx)
        return _Handed(item.sha256)

    def _openable(self, item: Input, paths: list[Path]) -> list[Any]:
        return [{**item.options, "path": path} if item.options else path for path in paths]

    def _paths(self, item: Input, here: tuple[str, ...], ctx: Context) -> list[Path]:
        """The files of an input; if there are none, a problem is noted."""
        candidates = list(self._candidates(item))
        for paths in candidates:
            if lineage.describe_files(paths, ctx).sha256 == item.sha256:
                return paths
        where = " and ".join([f"in {self.beside}", *(f"in {one} or below" for one in self.below)])
        if candidates:
            text = f"{item.file} {where} has changed since: its sha256 is not {item.sha256}"
        else:
            text = f"there is no file {item.file} {where}"
            text += "" if self.below else "; say with --inputs FOLDER where it is"
        name = _joined(here)
        self.problems[f"{name}, {item.file}" if name in self.problems else name] = text
        return []

    def _candidates(self, item: Input) -> Iterator[list[Path]]:
        """Files that may be the input: those of its name, or all that match its pattern."""
        if Path(item.file).name != item.file:  # a record that was tampered with
            return
        if item.file.startswith("*") and item.files > 1:
            yield from filter(None, self._named(item.file))
            return
        for paths in self._named(glob.escape(item.file)):
            yield from ([path] for path in paths)

    def _named(self, pattern: str) -> Iterator[list[Path]]:
        """The files of a name or pattern in each of the folders."""
        found = [self.beside.glob(pattern), *(one.glob(f"**/{pattern}") for one in self.below)]
        yield from (sorted(path for path in paths if path.is_file()) for paths in found)


def _joined(way: tuple[str, ...]) -> str:
    """Where an input belongs: of a long way that leads to it only its ends."""
    return ", ".join(way if len(way) < 3 else (way[0], "...", way[-1]))


def _why_unknown(record: Record, item: Input) -> str:
    """Why a layer in memory has no run that could make it again."""
    if not item.sha256:
        return "was a layer in memory; what it was made of had changed before it was recorded"
    if record.omitted:
        return (
            "was a layer in memory; if a run of the toolbox made it, its record had no room: at "
            f"least {record.omitted} were left out"
        )
    return "was a layer in memory, which no run of the toolbox made"


def _check(path: Path, record: Record, tool: str) -> None:
    """Refuse a record that no run can have made: it might name other files to write."""
    results = {*SHOWN, *catalog.load(tool).results}
    if {record.output, *record.layers} - results or record.parameters.keys() & results:
        raise DataError(f"{path}: its record does not fit {record.tool}")


def _made_again(
    record: Record, tool: str, values: Mapping[str, Any], path: Path, ctx: Context
) -> Path:
    """Run the tool with outputs in a temporary folder, and give the path of the product."""
    how: dict[str, Any] = {"assume_crs": record.assume_crs or None, "ctx": ctx}
    if record.file:  # one of a folder of files, which are made in tiles
        folder = f"{path.parent}{os.sep}"
        wanted = {**values, record.output: {**record.options, "path": folder}}
        run(tool, wanted, tiling=Tiling.parse({"tile": "auto"}), **how)
        made = Target.of(record.output, folder, catalog.load(tool)).inside(record.file).resolved
        assert made is not None
        return made
    if record.number:  # the path that was asked for has no number
        path = path.with_stem(path.stem.removesuffix(f"_{record.number}"))
    layers = {record.output: record.options, **record.layers}
    wanted = {name: {**options, "path": path} for name, options in layers.items()}
    written = run(tool, {**values, **wanted}, **how)[record.output]
    made = written[(record.number or 1) - 1] if isinstance(written, tuple) else written
    return Path(made)


def _same_files(path: Path, made: Path, own_files: Callable[[Path], tuple[Path, ...]]) -> bool:
    """Whether all files that were made again are the same; others may have been added since."""
    pairs = [
        (old, new)
        for old, new in zip(own_files(path), own_files(made), strict=False)
        if new.exists()
    ]
    return all(old.exists() and _same_bytes(old, new) for old, new in pairs)


def _same_bytes(one: Path, other: Path) -> bool:
    same_size = one.stat().st_size == other.stat().st_size
    return same_size and file_hash(one) == file_hash(other)


def _differences(path: Path, made: Path, record: Record, tool: str) -> Iterator[str]:
    if record.output in (PICTURE, PAGE) or kind_of(record.output, catalog.load(tool)) is _REPORT:
        if not _same_but_for_looks(path, made):
            yield f"the {record.output} differs"
        return
    for name, options in {record.output: record.options, **record.layers}.items():
        kind = kind_of(name, catalog.load(tool))
        how = {"layer": options["layer"]} if "layer" in options else {}
        sources = (Source.of(kind, {"path": each, **how}) for each in (path, made))
        old, new = (source.open(kind) for source in sources)
        for text in _differences_of(old, new):
            yield f"{name}, {text}" if record.layers else text


def _same_but_for_looks(path: Path, made: Path) -> bool:
    """Whether HTML reports differ in nothing but stylesheets and logo, which no record keeps."""
    texts = [each.read_bytes() for each in (path, made)]
    plain = [_LOOKS.sub(b"", text) for text in texts]
    return path.suffix.lower() == ".html" and plain[0] == plain[1]


def _differences_of(old: Layer, new: Layer) -> Iterator[str]:
    if not same_crs(old.crs, new.crs):
        yield f"CRS: {describe_crs(old.crs)}, now {describe_crs(new.crs)}"
    yield from old.differences(new)
