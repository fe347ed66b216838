"""Targets: where and how the results of a run are written, all of them or none."""

from __future__ import annotations

import dataclasses
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from toolbox import files
from toolbox.context import Context, log
from toolbox.data import Report, Table, Vector, geopackage
from toolbox.data.crs import describe_crs, is_local
from toolbox.data.extras import Extra
from toolbox.data.las.waveforms import foreign_packets
from toolbox.data.layer import Layer
from toolbox.data.paths import LAS
from toolbox.data.record import foreign_side_car
from toolbox.data.remote.address import Address, as_path
from toolbox.data.report import Column
from toolbox.data.report.document import LOOKS, today
from toolbox.declare.fields import Spec
from toolbox.declare.kinds import Kind, find, parsed_options
from toolbox.errors import DataError
from toolbox.pictures import qml
from toolbox.pictures.draw import draw, drawable
from toolbox.reports.page import Told, framed, page
from toolbox.reports.words import columns_in
from toolbox.runs.provenance import Record
from toolbox.shown import COUNTS, PAGE, PICTURE, SHOWN

_KINDS: Mapping[str, Kind] = {
    PICTURE: Kind("picture", {}, lambda value: False, lambda value: value, suffixes=(".png",)),
    PAGE: find(Report),
    COUNTS: find(Table),
}


@dataclass(frozen=True)
class Target:
    """Path and options with which an output is written.

    Attributes
    ----------
    path : as it was given; None if the value does not name one
    resolved : the file to write, links followed; None if there is no usable path
    suffixes : endings that the output can have; none for a number, which is printed
    needs : optional libraries that files with some endings need
    output : the result that it is for
    folder : it is one, for one file per file of a survey
    special : endings that only layers of a certain content can have, and which content
    delivered : it belongs to the set of a folder, see `toolbox.runs.delivery`
    """

    path: Path | None
    resolved: Path | None
    options: Mapping[str, Any]
    suffixes: tuple[str, ...]
    needs: Mapping[str, Extra]
    known: tuple[str, ...]
    own_files: files.OwnFiles
    output: str = ""
    folder: bool = False
    special: Mapping[str, str] = field(default_factory=dict)
    delivered: bool = False

    @classmethod
    def of(cls, name: str, value: Any, spec: Spec) -> Target:
        """Parse a path, or a mapping of a path and options."""
        how = dict(value) if isinstance(value, Mapping) else {"path": value}
        path = how.pop("path", None)
        given = as_path(path) if isinstance(path, str | Path) and str(path) else None
        resolved = _resolved(given) if given else None
        kind = kind_of(name, spec)
        folder = kind.several and (
            str(path).endswith(("/", os.sep)) or bool(resolved and _is_folder(resolved))
        )
        suffixes = kind.suffixes if name in SHOWN else spec.results[name].suffixes
        own = suffixes, kind.needs, kind.save_options, kind.own_files
        return cls(given, resolved, how, *own, output=name, folder=folder, special=kind.special)

    @property
    def layer(self) -> str | None:
        """Name of the layer in a GeoPackage; None for other files."""
        resolved = self.resolved
        if (
            resolved is None
            or resolved.suffix.lower() != geopackage.SUFFIX
            or "layer" not in self.known
        ):
            return None
        return str(self.options.get("layer") or resolved.stem)

    @property
    def needs_crs(self) -> bool:
        """Whether its format needs a CRS of the Earth."""
        return bool(self.resolved and self.resolved.suffix.lower() in Vector.NEEDING_CRS)

    @property
    def in_balloons(self) -> bool:
        """Whether its format shows columns to people, under headings."""
        return bool(self.resolved and self.resolved.suffix.lower() in Vector.BALLOONS)

    @property
    def how(self) -> dict[str, Any]:
        """The options, parsed for the layer's `save`; a report without a date is of today."""
        given = {"date": today(), **self.options} if "date" in self.known else self.options
        return parsed_options(given, self.known)

    @property
    def recorded(self) -> dict[str, Any]:
        """The options that a record keeps: not those of mere looks, which name other files."""
        return {name: value for name, value in self.how.items() if name not in LOOKS}

    @property
    def is_las(self) -> bool:
        """Whether LAS or LAZ is written, as always in a folder."""
        return self.folder or (self.resolved is not None and self.resolved.suffix.lower() in LAS)

    @property
    def missing(self) -> str | None:
        """Which library is not there, and how to get it; None if nothing is missing."""
        extra = self.needs.get(self.resolved.suffix.lower()) if self.resolved else None
        return extra.missing() if extra else None

    def inside(self, name: str) -> Target:
        """Target in this folder for a file of a survey: LAS and COPC stay, all else becomes LAZ."""
        assert self.path is not None
        assert self.resolved is not None
        suffix = ".las" if name.lower().endswith(".las") else ".laz"
        stem = name.removesuffix(".gz")[: -len(Path(name.removesuffix(".gz")).suffix)]
        made = stem + suffix
        return replace(self, path=self.path / made, resolved=self.resolved / made, folder=False)

    def numbered(self, number: int) -> Target:
        """Target of one of several layers: dtm_1.tif, dtm_2.tif for dtm.tif."""
        path, resolved = (
            p and p.with_stem(f"{p.stem}_{number}") for p in (self.path, self.resolved)
        )
        return replace(self, path=path, resolved=resolved)

    def problem(self) -> str | None:
        """The problem of the target, not counting existing files; None if there is none."""
        if not self.suffixes:
            return "is a value, which is printed; it cannot be written to a file"
        if self.resolved is None or isinstance(self.path, Address):
            return self._unusable()
        try:
            parsed_options(self.options, self.known)
            return None if self.folder else self._unsuited(self.resolved)
        except OSError as err:
            return f"{self.path} cannot be a file: {err.strerror}"
        except ValueError as err:
            return str(err)

    def _unsuited(self, path: Path) -> str | None:
        """What the format cannot hold, or which file of somebody else stands beside; or None."""
        for suffix, content in self.special.items():
            if path.name.lower().endswith(suffix) and suffix not in self.suffixes:
                return f"{suffix} holds {content}, which this output has not; write .gpkg"
        if self.layer and self.layer.lower() == geopackage.STYLES:
            return f"QGIS keeps styles in the layer {self.layer}; choose another name"
        if other := foreign_side_car(path):
            return f"{other} stands where its record would be written; choose another name"
        if self.is_las and (other := foreign_packets(path)):
            return f"{other} holds the waveforms of another file; choose another name"
        return None

    def _unusable(self) -> str:
        """Why there is no file on this computer that could be written."""
        if isinstance(self.path, Address):
            return "nothing is written to the web; name a file on this computer"
        return "must be a path" if self.path is None else f"{self.path} is no usable path"


def _resolved(path: Path) -> Path | None:
    """A path with links followed; None for circular links and impossible names."""
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError):
        return None


def _is_folder(path: Path) -> bool:
    """Whether a path is a folder; not if it has a name that no file can have."""
    try:
        return path.is_dir()
    except OSError:
        return False


def kind_of(name: str, spec: Spec) -> Kind:
    """The kind of an output, or of what every run can write: picture, page, counts."""
    return _KINDS[name] if name in SHOWN else spec.results[name].kind


def of_run(wanted: Mapping[str, Any], spec: Spec) -> dict[str, Target]:
    """Targets of a run by output name.

    Several outputs may go to one GeoPackage, as layers that have the names of the outputs where
    no others are given.
    """
    made = {name: Target.of(name, value, spec) for name, value in wanted.items()}
    uses = Counter(target.resolved for target in made.values() if target.layer)
    return {
        name: replace(target, options={"layer": name, **target.options})
        if uses[target.resolved] > 1
        else target
        for name, target in made.items()
    }


def problems(
    targets: Mapping[str, Target], reads: Iterable[Path], *, overwrite: bool
) -> dict[str, str]:
    """Problems of targets by output name; `reads` are the files that the run reads."""
    asked = {name: target for name, target in targets.items() if not target.delivered}
    found = {name: text for name, target in asked.items() if (text := target.missing)}
    found |= {name: text for name, target in targets.items() if (text := target.problem())}
    good = {name: target for name, target in targets.items() if name not in found}
    found |= dict(_twins(good))
    # Layers may share a GeoPackage, which is no clash: one of them stands for the file.
    first = {(t.resolved if t.layer else None) or n: n for n, t in reversed(good.items())}
    good = {name: target for name, target in good.items() if name in first.values()}
    return found | files.problems(
        {name: target.resolved for name, target in good.items() if target.resolved},
        {name: target.suffixes for name, target in good.items()},
        {name: target.own_files for name, target in good.items()},
        [path for path in reads if not isinstance(path, Address)],
        overwrite=overwrite,
    )


def check_crs(id: str, targets: Mapping[str, Target], layers: Iterable[Layer]) -> None:
    """Raise an error for formats that need a CRS of the Earth if no layer that is read has one.

    Raises
    ------
    DataError
        Names the outputs, before the tool runs.
    """
    found = [layer.crs for layer in layers if layer.is_spatial]
    if not found or any(crs is not None and not is_local(crs) for crs in found):
        return
    text = f"needs a CRS of the Earth, and the data have {describe_crs(found[0])}"
    if problems := {
        name: f"{target.resolved.suffix} {text}; write a GeoPackage (.gpkg)"
        for name, target in targets.items()
        if target.resolved and target.needs_crs and not target.delivered
    }:
        raise DataError(id, problems)


def _twins(targets: Mapping[str, Target]) -> Iterator[tuple[str, str]]:
    """Problems of outputs that name the same layer of a GeoPackage as an earlier one."""
    first: dict[tuple[Path | None, str], str] = {}
    for name, target in targets.items():
        if target.layer:
            twin = first.setdefault((target.resolved, target.layer.lower()), name)
            if twin != name:
                yield name, f"layer {target.layer} of {target.path} is also that of {twin}"


@dataclass(frozen=True)
class More:
    """Files that are written together with the outputs of a run, all of them or none.

    Attributes
    ----------
    own_files : what belongs to each, by its path
    write : writes them, given the path to write to for each
    finish : the same, after all outputs
    """

    own_files: Mapping[Path, files.OwnFiles] = field(default_factory=dict)
    write: Callable[[Mapping[Path, Path]], None] = lambda staged: None
    finish: Callable[[Mapping[Path, Path]], None] = lambda staged: None


NO_MORE = More()


def write(
    spec: Spec,
    found: Mapping[str, Any],
    targets: Mapping[str, Target],
    *,
    more: More = NO_MORE,
    record: Record | None = None,
    told: Told | None = None,
    overwrite: bool,
    ctx: Context,
) -> dict[str, Any]:
    """Write the outputs that have a target: all of them or, after an error, none.

    Parameters
    ----------
    spec : of the tool
    found : what the tool gave, by name
    targets : where to write it, also what shows it: "picture", "page" and "counts"
    more : what is written with it
    record : how it was made, which each file carries
    told : what else the run has told, for its report

    Returns
    -------
    dict
        The path of each output; a tuple of paths where there are several layers.

    Raises
    ------
    DataError
        Something cannot be written; nothing was.
    """
    shown: dict[str, Any] = {}
    wanted = {target.output for target in targets.values()}
    if PICTURE in wanted:
        shown[PICTURE] = drawable(found, spec.results)
    if PAGE in wanted:
        seen = {n: value for n, value in found.items() if _is_seen(n, spec, targets)}
        if told:
            told.files |= names_of(targets.values())
        shown[PAGE] = page(spec, seen, record and record.of(PAGE, None, {}), told)
    for name in wanted:
        if isinstance(report := found.get(name), Report):
            shown[name] = framed(report, spec, record, told)
    if COUNTS in wanted and record:
        shown[COUNTS] = Table.from_rows(map(dataclasses.asdict, record.counts))
    pieces = _pieces(spec.id, {**found, **shown}, targets, overwrite=overwrite)
    groups: dict[Path, list[_Piece]] = {}  # of one file each
    for piece in pieces:
        assert piece.target.resolved is not None
        groups.setdefault(piece.target.resolved, []).append(piece)
    try:
        own_files = {resolved: group[0].target.own_files for resolved, group in groups.items()}
        with files.staged({**more.own_files, **own_files}, overwrite=overwrite) as staged:
            more.write(staged)
            for index, (resolved, group) in enumerate(groups.items()):
                part = ctx.part(index / len(groups), (index + 1) / len(groups))
                _save_all(spec, group, record, staged[resolved], part)
            more.finish(staged)
            ctx.progress(1.0)
    except OSError as err:
        raise _unwritten(spec.id, groups, err) from err
    written: dict[str, Any] = {}
    for piece in pieces:
        path = piece.target.path
        several = isinstance(found.get(piece.output), tuple)
        written[piece.name] = (*written.get(piece.name, ()), path) if several else path
    return written


def _unwritten(id: str, groups: Mapping[Path, list[_Piece]], err: OSError) -> DataError:
    """The error of files that cannot be put in their places: which results they are, and why."""
    folders = Path(err.filename).parents if err.filename else [path.parent for path in groups]
    names = [p.name for path, group in groups.items() for p in group if path.parent in folders]
    if not names:
        return DataError(f"{id}: cannot write: {err}")
    return DataError(id, dict.fromkeys(names, f"cannot write: {err}"))


def names_of(targets: Iterable[Target]) -> dict[str, str]:
    """The name of the file that holds each result, the first of several."""
    return {t.output: t.path.name for t in reversed(list(targets)) if t.path is not None}


def _is_seen(name: str, spec: Spec, targets: Mapping[str, Target]) -> bool:
    """Whether a report shows a result: of what is made only to be handed over what asks for it."""
    asks = any(one.output == name and one.in_report for one in spec.deliver)
    return asks or name in spec.outputs or name in targets


@dataclass(frozen=True)
class _Piece:
    """One layer and its target, by the name of that; for the picture, all layers by name."""

    name: str
    layer: Any
    target: Target
    number: int | None = None

    @property
    def output(self) -> str:
        """The result that it is."""
        return self.target.output


def _pieces(
    id: str, found: Mapping[str, Any], targets: Mapping[str, Target], *, overwrite: bool
) -> list[_Piece]:
    pieces: list[_Piece] = []
    numbered: dict[str, Target] = {}
    for name, target in targets.items():
        layer = found[target.output]
        if not isinstance(layer, tuple):
            pieces += [_Piece(name, layer, target)] if layer is not None and layer != {} else []
        for number, item in enumerate(layer if isinstance(layer, tuple) else (), start=1):
            numbered[f"{name} {number}"] = target.numbered(number)
            pieces.append(_Piece(name, item, target.numbered(number), number))
    missing = [name for name in targets if name not in {piece.name for piece in pieces}]
    for name in missing:
        log.warning("%s: there is nothing to write", name)
    if found_problems := problems(numbered, [], overwrite=overwrite):
        raise DataError(id, found_problems)
    return pieces


def _save_all(
    spec: Spec, group: list[_Piece], record: Record | None, path: Path, ctx: Context
) -> None:
    """Save one file, with several layers if it is a GeoPackage."""
    first, *others = group
    layers = {piece.output: piece.target.recorded for piece in others}
    how, kept = first.target.how, first.target.recorded
    own = record and record.of(first.output, first.layer, kept, first.number, layers=layers)
    made = own.to_json() if own else ""
    for piece in group:
        how = piece.target.how if piece is first else {**piece.target.how, "add": True}
        if piece.target.in_balloons:
            how = {**how, "headings": _headings(spec, piece)}
        if piece.target.delivered and isinstance(piece.layer, Vector) and piece.target.layer:
            how = {**how, "qml": qml.style(piece.layer, spec.results[piece.output].show)}
        _save(spec.id, piece, made if piece is group[-1] else "", path, how, ctx)


def _headings(spec: Spec, piece: _Piece) -> dict[str, dict[str, Column]]:
    """The columns of a layer, and of other results whose names its features have as layers."""
    own = spec.results[piece.output].columns if piece.output in spec.results else {}
    named = {name: field.columns for name, field in spec.results.items() if field.columns}
    return {name: columns_in(how, piece.layer) for name, how in {**named, "": own}.items()}


def _save(
    id: str, piece: _Piece, record: str, path: Path, how: Mapping[str, Any], ctx: Context
) -> None:
    target = piece.target
    try:
        if piece.output == PICTURE:
            draw(piece.layer, path, record=record)
        else:
            if piece.layer.paths:  # which it names relative to its own
                how = {**how, "place": target.resolved}
            piece.layer.save(path, record=record, ctx=ctx, **how)
    except (OSError, DataError) as err:
        text = str(err).replace(str(path), str(target.path))
        if files.is_full(path.parent):
            text += "; the disk is full"
        raise DataError(id, {piece.output: text}) from err
