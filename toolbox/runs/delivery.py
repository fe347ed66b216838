"""The set of files that a run hands over with ``--deliver FOLDER``: all of them, or none.

Which results it holds, in which formats and under which names, is declared in the model, see
`toolbox.declare.delivered`. A README names each file in words.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from pyproj import CRS

from toolbox import files, language
from toolbox.context import Context, log
from toolbox.data import Drawing, PointCloud, Survey, Table, Vector, dxf
from toolbox.data.crs import NOT_STATED, crs_text, height_system, is_local
from toolbox.data.layer import Layer
from toolbox.data.report.columns import column_of
from toolbox.data.report.document import today
from toolbox.declare.delivered import Delivered
from toolbox.declare.fields import SHAPE_OF, Spec
from toolbox.errors import DataError, ParameterError
from toolbox.reports.page import Told
from toolbox.reports.readme import Entry, readme
from toolbox.reports.words import columns_in
from toolbox.runs import sealed
from toolbox.runs import target as targets
from toolbox.runs.provenance import Record
from toolbox.runs.target import More, Target
from toolbox.shown import DELIVER, PAGE, README

NOTHING = "nothing of this kind was asked for or found"
EMPTY = "it would be empty"
NOT_HERE = "it was not made on this computer"  # how to get what is missing is not for a client


def of_run(wanted: Mapping[str, Any], spec: Spec) -> dict[str, Target]:
    """Targets of a run by name, and those of the set under names that no output has.

    Raises
    ------
    ParameterError
        A set is asked for, and none is declared.
    """
    others = {name: value for name, value in wanted.items() if name != DELIVER}
    if DELIVER not in wanted:
        return targets.of_run(others, spec)
    if not spec.deliver:
        raise ParameterError(spec.id, {DELIVER: "this tool declares no set of files to hand over"})
    said = wanted[DELIVER]
    head = dict(said) if isinstance(said, Mapping) else {"path": said}
    folder = head.pop("path", None)
    if not isinstance(folder, str | Path) or not str(folder):
        raise ParameterError(spec.id, {DELIVER: "must be the path of a folder"})
    made = {f"{DELIVER} {one.key}": _target(one, Path(folder), head, spec) for one in spec.deliver}
    made[f"{DELIVER} {README}"] = Target(
        Path(folder) / README,
        Path(folder).resolve() / README,
        head,
        suffixes=(".txt",),
        needs={},
        known=targets.kind_of(PAGE, spec).save_options,
        own_files=files.itself,
        output=DELIVER,
        delivered=True,
    )
    return {**targets.of_run(others, spec), **made}


def _target(one: Delivered, folder: Path, head: Mapping[str, Any], spec: Spec) -> Target:
    known = targets.kind_of(one.output, spec).save_options
    usual: dict[str, Any] = {"rounded": True} if "rounded" in known else {}
    if "head" in known and one.file.lower().endswith((*Vector.HEADED, *Drawing.HEADED)):
        usual["head"] = _said(spec, head)
    options = {**(head if one.output == PAGE else {}), **usual, **one.options}
    made = Target.of(one.output, {"path": folder / one.file, **options}, spec)
    return replace(made, delivered=True)


def _said(spec: Spec, head: Mapping[str, Any]) -> dict[str, str]:
    """What drawings and models of a set say of themselves: title, client and date."""
    known = {"title": language.text(spec.title), "date": today(), **head}
    return {name: known[name] for name in ("title", "client", "date") if known.get(name)}


def problems(
    spec: Spec,
    writes: Mapping[str, Target],
    reads: Iterable[Path],
    taken: Collection[Path],
    *,
    overwrite: bool,
) -> dict[str, str]:
    """The problem of the folder of the set, by "deliver"; none if all is well.

    Parameters
    ----------
    spec : of the tool
    reads : files that the run reads
    taken : folders of which it reads all files
    """
    made = _of_set(writes)
    if not made:
        return {}
    if _folder(made) in taken:
        why = "all files in it are read, and the next run would read those of the set, too"
        return {DELIVER: f"{_folder(made)} is a folder of the inputs: {why}"}
    text = next(filter(None, (t.problem() for t in made.values())), None)
    text = text or _folder_problem(_folder(made))
    if text or not _folder(made).exists():
        return {DELIVER: text} if text else {}
    if text := sealed.problem(_folder(made), spec.id, _own(_owned(made))):
        return {DELIVER: text}
    there = [t.resolved.name for t in made.values() if t.resolved and t.resolved.exists()]
    if there and not overwrite:
        more = f" and {len(set(there)) - 1} more" if len(set(there)) > 1 else ""
        verb = "exist" if more else "exists"
        text = f"{there[0]}{more} {verb} in {_folder(made)}; allow it with overwrite=True"
        return {DELIVER: text}
    found = targets.problems(made, reads, overwrite=overwrite)
    return {DELIVER: next(iter(found.values()))} if found else {}


def tell_missing(writes: Mapping[str, Target]) -> None:
    """Say before the work which files of the set will not be there, for want of a library.

    It is no warning: reports and the README hold these, and go to people who cannot install it.
    """
    for name, target in _of_set(writes).items():
        if target.missing:
            told = name.removeprefix(f"{DELIVER} ")
            log.info("%s will be left out: %s", told, target.missing)


def tell_heights(crs: CRS | None) -> None:
    """Warn that nobody knows what the heights of a set are measured from.

    How to say it is no warning: reports and the README hold these, and their readers run nothing.
    """
    if crs is None or height_system(crs) != NOT_STATED:
        return
    code = crs_text(crs)
    log.warning(
        "the data state no height system, so no height of the set can be compared with a gauge, a "
        "map or another survey"
    )
    log.info(
        "where you know the height system, give it with the CRS, such as assume_crs %s, or for "
        "good with points.assign_crs",
        f"{code}+EPSG:CODE" if "[" not in code else "'COMPOUNDCRS[...]' (WKT)",
    )


def _folder_problem(folder: Path) -> str | None:
    """Why nothing can be written in a folder that may have to be made; None if it can."""
    if folder.exists():
        return files.folder_problem(folder)
    return files.folder_problem(folder.parent)


def is_asked(writes: Mapping[str, Target]) -> bool:
    """Whether a set is written."""
    return bool(_of_set(writes))


def _of_set(writes: Mapping[str, Target]) -> dict[str, Target]:
    return {name: target for name, target in writes.items() if target.delivered}


def _folder(made: Mapping[str, Target]) -> Path:
    """The folder of the set, links followed."""
    first = next(iter(made.values()))
    assert first.resolved is not None
    return first.resolved.parent


def _owned(made: Mapping[str, Target]) -> dict[Path, files.OwnFiles]:
    """The paths of the set, with what belongs to each."""
    return {target.resolved: target.own_files for target in made.values() if target.resolved}


def _own(owned: Mapping[Path, files.OwnFiles]) -> list[Path]:
    return [own for path, own_files in owned.items() for own in own_files(path)]


@contextmanager
def folder_of(writes: Mapping[str, Target]) -> Iterator[None]:
    """Make the folder of the set; it is removed again if nothing has been written into it."""
    made = _of_set(writes)
    new = bool(made) and not _folder(made).exists()
    with files.made(_folder(made)) if new else nullcontext():
        yield


def write(
    spec: Spec,
    found: Mapping[str, Any],
    writes: Mapping[str, Target],
    *,
    more: More = targets.NO_MORE,
    record: Record | None = None,
    told: Told | None = None,
    overwrite: bool,
    ctx: Context,
) -> dict[str, Any]:
    """Write the outputs that have a target, and the set with its README; see `targets.write`.

    What cannot be written of the set, as KML without a place on the Earth, is left out with a
    warning.

    Raises
    ------
    DataError
        What the set is about was not found, or a file cannot be written.
    """
    notes = next((t for t in writes.values() if t.output == DELIVER), None)
    how: dict[str, Any] = {"record": record, "told": told, "overwrite": overwrite, "ctx": ctx}
    if notes is None or notes.resolved is None:
        return targets.write(spec, found, writes, more=more, **how)
    others = {name: target for name, target in writes.items() if target is not notes}
    left_out = {n: why for n, t in others.items() if t.delivered and (why := _why_not(t, found))}
    _check_needed(spec, found)
    for name, why in left_out.items():
        level = logging.INFO if why in (NOTHING, EMPTY, NOT_HERE) else logging.WARNING
        log.log(level, "%s is left out: %s", name.removeprefix(f"{DELIVER} "), why)
    kept = {name: target for name, target in others.items() if name not in left_out}
    said = _said(spec, notes.how)
    found = {n: v.with_head(said) if isinstance(v, Layer) else v for n, v in found.items()}
    readme_path = notes.resolved
    of_tiles = {path.name for path in more.own_files}
    made = {t.output for t in kept.values()} | {
        one.output for one in spec.deliver if one.file in of_tiles
    }
    of_set, folder = _of_set(writes), readme_path.parent
    owned = {**_owned(of_set), **{p: o for p, o in more.own_files.items() if p.parent == folder}}
    if text := sealed.problem(folder, spec.id, _own(owned)):  # it may have become so
        raise DataError(spec.id, {DELIVER: text})
    # What an earlier run has left there goes: its set is replaced as a whole.
    old = {t.resolved: t.own_files for n, t in others.items() if n in left_out and t.resolved}
    old |= dict.fromkeys(sealed.files_of(folder), files.itself)
    more_files = {**old, **more.own_files, readme_path: notes.own_files}

    def write_readme(staged: Mapping[Path, Path]) -> None:
        read = _points_read(told)
        entries = [_entry(one, spec, found, left_out, made, read) for one in spec.deliver]
        head = {"date": today(), **notes.how}
        new = _own({staged[path]: of for path, of in owned.items() if path in staged})
        sums = sealed.sums(path for path in new if path.exists())
        text = sealed.sealed(
            readme(spec, found, record, told or Told(), entries, head, sums), spec.id
        )
        staged[readme_path].write_text(text, encoding="utf-8", newline="\n")

    more = More(more_files, more.write, write_readme)
    done = targets.write(spec, found, kept, more=more, **how)
    assert notes.path is not None
    made_of_set = {name: target for name, target in of_set.items() if name in done}
    paths = {
        t.output: t.path for t in reversed(list(made_of_set.values())) if t.output in spec.outputs
    }
    shown = {name: path for name, path in done.items() if name not in made_of_set}
    return {**paths, **shown, DELIVER: notes.path.parent}


def _check_needed(spec: Spec, found: Mapping[str, Any]) -> None:
    """Raise an error where a set would say nothing: what all else is about was not found."""
    for one in spec.deliver:
        if one.needed and _lacks(found.get(one.output)):
            text = f"there is nothing to hand over: {one.file} would be empty ({one.help})"
            raise DataError(spec.id, {DELIVER: text})


def _why_not(target: Target, found: Mapping[str, Any]) -> str | None:
    """Why a file of the set cannot be written; None if it can."""
    if target.missing:
        return NOT_HERE
    if target.output == PAGE:
        return None
    layer = found.get(target.output)
    if why := _lacks(layer):
        return why
    crs = getattr(layer, "crs", None)
    if target.needs_crs and (crs is None or is_local(crs)):
        return "the data have no CRS of the Earth"
    return None


def _lacks(layer: Any) -> str | None:
    """Why a file of a result would hold nothing; None if it would hold something."""
    if layer is None or layer == ():
        return NOTHING
    return EMPTY if isinstance(layer, Layer) and layer.size() == 0 else None


def _entry(
    one: Delivered,
    spec: Spec,
    found: Mapping[str, Any],
    left_out: Mapping[str, str],
    made: set[str],
    read: int | None,
) -> Entry:
    layer = found.get(one.output)
    size = layer.size() if isinstance(layer, Layer) else None
    reason = left_out.get(f"{DELIVER} {one.key}", "" if one.output in made else NOTHING)
    columns = _columns(spec, one.output, layer) if isinstance(layer, Table | Vector) else ()
    entry = Entry(one.file, str(one.options.get("layer", "")), one.help, size, reason, columns)
    if size is not None and read is not None and spec.results[one.output].kind.word == "PointCloud":
        entry = replace(entry, without=max(0, read - size))
    if isinstance(layer, Vector):
        shapes = {SHAPE_OF.get(name, "") for name in layer.frame.geom_type.dropna().unique()}
        entry = replace(entry, shape=shapes.pop() if len(shapes) == 1 else "")
    if not (one.file.lower().endswith(".dxf") and isinstance(layer, Vector)):
        return entry
    layers = dxf.layers_of(layer.frame, Path(one.file)).items()
    drawn = [(name, dxf.colour_name(colour), count) for name, (colour, count) in layers]
    return replace(entry, unit=dxf.unit_name(layer.crs), drawn=drawn)


def _points_read(told: Told | None) -> int | None:
    """Number of the points that a run has read; None unless it has read one cloud."""
    given = told.given.values() if told else ()
    clouds = [layer for layer in given if isinstance(layer, PointCloud | Survey)]
    return clouds[0].size() if len(clouds) == 1 else None


def _columns(spec: Spec, output: str, layer: Table | Vector) -> tuple[tuple[str, str, str], ...]:
    """Name, unit and meaning of the columns of a file, as it holds them.

    Shares that reports show in percent are shares of 1 there.
    """
    declared = columns_in(spec.results[output].columns, layer)
    said = {name: column for name, column in declared.items() if column.heading or column.meaning}
    told = []
    for name, values in layer.frame.items():
        if isinstance(layer, Vector) and name == layer.frame.geometry.name:
            continue
        how = column_of(str(name), values, said)
        unit = how.unit if how.factor == 1 else "1; % in the report" if how.unit == "%" else ""
        told.append((str(name), unit, how.meaning or how.heading))
    return tuple(told)
