"""The README of a set of files that is handed over: what was found, and what each file holds."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from toolbox import language
from toolbox.data.report.prose import sentence
from toolbox.declare.fields import Spec
from toolbox.reports.page import Told, said

if TYPE_CHECKING:
    from toolbox.runs.provenance import Record

_WIDTH = 100  # characters of a line
_LAYER = "layer"
_OF_JOINED = {_LAYER, "text", "angle", "text_height"}  # columns that joining features adds
_OPENS = {
    ".html": "a browser; it needs no network",
    ".pdf": "a reader of PDF",
    ".gpkg": "QGIS, which draws it in the colours of the report, ArcGIS and other GIS",
    ".shp": "any GIS; the files .shx, .dbf, .prj and .cpg belong to it, and .fields.csv, where "
    "there is one, has the names of columns that are cut to 10 letters",
    ".tif": "a GIS; cloud-optimised GeoTIFF",
    ".kmz": "Google Earth and GIS",
    ".kml": "Google Earth and GIS",
    ".dxf": "CAD",
    ".csv": "a spreadsheet; comma between columns, point before decimals, UTF-8",
    ".xlsx": "a spreadsheet",
    ".laz": "programs for points; LAS, packed",
    ".xyz": "programs for points; text with one line per point",
    ".ifc": "BIM programs; IFC4",
    ".png": "any program for images",
    ".json": "a text editor",
    ".city.json": "programs for CityJSON, such as ninja; QGIS and Blender with plug-ins",
}


@dataclass(frozen=True)
class Entry:
    """A file of the set, or a layer of one.

    Attributes
    ----------
    layer : its name in a GeoPackage, else ""
    size : points, features, rows or cells; None where nothing is counted
    shape : of its features: point, line or polygon; "" if of several or none
    without : points that were read and are not in it
    columns : name, unit and meaning of each column of a table or attribute of features
    left_out : why it is not there; "" if it is
    unit : of the coordinates of a drawing, in words
    drawn : name, colour and number of features of each layer of a drawing
    """

    file: str
    layer: str
    help: str
    size: int | None = None
    left_out: str = ""
    columns: Sequence[tuple[str, str, str]] = ()
    unit: str = ""
    drawn: Sequence[tuple[str, str, int]] = ()
    without: int = 0
    shape: str = ""


def readme(
    spec: Spec,
    found: Mapping[str, Any],
    record: Record | None,
    told: Told,
    entries: Sequence[Entry],
    head: Mapping[str, Any],
    sums: Mapping[str, str],
) -> str:
    """The text of the README.

    Parameters
    ----------
    spec : of the tool
    found : what it gave, by name
    record : how that was made
    told : what else the run has told
    entries : the files
    head : title, client, fields and date, as reports have them
    sums : SHA-256 of each file by its name
    """
    title = str(head.get("title") or spec.title)
    own = {"Client": head.get("client"), **head.get("fields", {}), "Date": head.get("date")}
    project = [(language.told(name), str(text)) for name, text in own.items() if text]
    given = {name: value for name, value in found.items() if name in spec.outputs}
    summary, known = said(spec, given, record, told)
    facts = [(language.told(name), language.for_people(text)) for name, text in known.facts]
    there = [entry for entry in entries if not entry.left_out]
    lines = [*_underlined(title, "=")[1:], "", *_pairs([*project, *facts])]
    lines += _section("Result", [summary])
    lines += _section("Warnings", known.warnings)
    lines += _section("Not looked at", known.unseen)
    lines += [*_underlined("Files"), *_files(there)]
    absent = [
        f"{entry.file}{f', {entry.layer}' if entry.layer else ''} ({language.told(entry.help)}): "
        f"{language.told(entry.left_out)}"
        for entry in entries
        if entry.left_out
    ]
    lines += _section("Left out", absent)
    lines += _drawings(there)
    lines += _columns(there)
    lines += [*_underlined("How it was made"), *_how(spec)]
    lines += [*_underlined("Checksums"), *_checksums(sums)]
    return "\n".join(lines) + "\n"


def _pairs(pairs: Sequence[tuple[str, str]]) -> Iterator[str]:
    width = max((len(name) for name, _ in pairs), default=0) + 2
    for name, text in pairs:
        indent = " " * width
        yield from textwrap.wrap(
            text, _WIDTH, initial_indent=name.ljust(width), subsequent_indent=indent
        ) or [name]


def _section(title: str, texts: Iterable[str]) -> list[str]:
    said = list(dict.fromkeys(line for text in texts for line in text.splitlines() if line.strip()))
    made = [
        line
        for text in said
        for line in textwrap.wrap(
            sentence(language.for_people(text)), _WIDTH, initial_indent="- ", subsequent_indent="  "
        )
    ]
    return [*_underlined(title), *made] if made else []


def _underlined(title: str, line: str = "-") -> list[str]:
    said = language.told(title)
    return ["", said, line * len(said)]


def _wrapped(text: str) -> list[str]:
    """A text in the language of the user, in lines."""
    return textwrap.wrap(language.told(text), _WIDTH)


def _files(entries: Sequence[Entry]) -> Iterator[str]:
    """Each file with what opens it, and its layers or what it holds."""
    for file in dict.fromkeys(entry.file for entry in entries):
        opens = _OPENS.get(_suffix(file), "")
        yield f"{file}{f'  ({language.told(opens)})' if opens else ''}"
        for entry in [entry for entry in entries if entry.file == file]:
            layer = f"{entry.layer}: " if entry.layer else ""
            count = "" if entry.size is None else f" [{_counted(entry)}]"
            if entry.without:
                lost = language.counted(entry.without)
                count += language.told(f"; {lost} of the points that were read are not in it")
            text = f"{layer}{language.told(entry.help)}{count}"
            yield from textwrap.wrap(
                text, _WIDTH, initial_indent="    ", subsequent_indent="      "
            )


def _counted(entry: Entry) -> str:
    """What a file or a layer holds, in numbers; of features what they are.

    A water or a façade may have several lines.
    """
    number = language.counted(entry.size or 0)
    if entry.shape == "line":
        return language.told(f"number of lines: {number}")
    return language.told(f"number of polygons: {number}") if entry.shape == "polygon" else number


def _drawings(entries: Sequence[Entry]) -> Iterator[str]:
    """The unit and the layers of each drawing, with their colours."""
    drawings = [entry for entry in entries if entry.drawn]
    if drawings:
        yield from _underlined("Drawings")
    for entry in drawings:
        unit = f"in {entry.unit}" if entry.unit else "of a unit that is not known"
        text = f"{entry.file}: {unit}; layer, colour (its number in CAD) [entities]"
        yield language.told(text)
        layers = [
            (f"    {name}", f"{_colour(colour)} [{language.counted(count)}]")
            for name, colour, count in sorted(entry.drawn, key=lambda one: one[0])
        ]
        yield from _pairs(layers)


def _colour(said: str) -> str:
    """The name of a colour in the language of the user, and its number in CAD."""
    name, mark, number = said.partition(" (")
    return f"{language.told(name)}{mark}{number}"


def _columns(entries: Sequence[Entry]) -> Iterator[str]:
    """The columns of each file that has some; files with the same columns stand together.

    Of features that were joined from layers of other files it is told that they are.
    """
    apart = [entry for entry in entries if not _is_joined(entry, entries)]
    joined = [entry for entry in entries if entry.columns and entry not in apart]
    tables: dict[tuple[tuple[str, str, str], ...], list[str]] = {}
    for entry in apart:
        if entry.columns:
            named = f"{entry.file}, {entry.layer}" if entry.layer else entry.file
            tables.setdefault(tuple(entry.columns), []).append(named)
    if tables:
        yield from _underlined("Columns")
    for columns, files in tables.items():
        yield from textwrap.wrap("; ".join(files), _WIDTH)
        said = [(name, language.told(unit), language.told(text)) for name, unit, text in columns]
        pairs = [(f"    {n}", f"{text} [{unit}]" if unit else text) for n, unit, text in said]
        yield from _pairs(pairs)
    if joined:
        named = " and ".join(entry.file for entry in joined)
        text = f"{named}: the columns of the layers above that they join, in `layer` by name"
        yield from _wrapped(text)


def _is_joined(entry: Entry, entries: Sequence[Entry]) -> bool:
    """Whether a file joins features of others, whose columns are told there."""
    names = {name for name, _, _ in entry.columns}
    others = [other for other in entries if other.file != entry.file and other.layer]
    told = {name for other in others for name, _, _ in other.columns}
    own = names - _OF_JOINED
    return _LAYER in names and bool(own) and own <= told


def _suffix(file: str) -> str:
    name = file.lower()
    return ".city.json" if name.endswith(".city.json") else name[name.rfind(".") :]


def _how(spec: Spec) -> list[str]:
    text = (
        f"By `python -m toolbox run {spec.id} ... --deliver FOLDER`. Each file carries the record "
        "of its inputs and settings: within it, or in the file beside it with .json after its "
        "name. `python -m toolbox provenance FILE` shows it, `python -m toolbox replay FILE` makes "
        "the file again and says whether it is the same. Numbers in [brackets] count points, "
        "features, rows, entities of a drawing, or cells with a value."
    )
    return _wrapped(text)


def _checksums(sums: Mapping[str, str]) -> list[str]:
    """The checksums in the form that the usual program compares, whatever stands around them."""
    text = (
        "SHA-256 of each file but .aux.xml, which a GIS changes; `sha256sum -c README.txt` "
        "compares them; and of this text. By them a later run into this folder knows which "
        "files it may replace; it stops at others."
    )
    return [*_wrapped(text), "", *(f"{found}  {name}" for name, found in sums.items())]
