"""Vector layers as KMZ and KML, for Google Earth, with colours, names and a few words on each.

GDAL writes the features; what it does not write is put in. KMZ has a folder for each kind of
feature, and is packed; KML is one layer, which is read again.

References
----------
OGC 12-007r2 (2015). OGC KML 2.3; a KMZ file is a ZIP archive whose first KML file is shown.
"""

from __future__ import annotations

import html
import io
import itertools
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from toolbox.data import geopackage
from toolbox.data.report.columns import COMMON, Column, column_of

if TYPE_CHECKING:
    import geopandas
    import pandas as pd

SUFFIX = ".kmz"
_SPACE = "http://www.opengis.net/kml/2.2"
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of all files in the archive: the same layer is the same file
_COLOURS = (  # aabbggrr of folders in turn, told apart also by those who see no red or green;
    "ffb27200",  # the first is the blue of water, and the last are near those of severities
    "ff731e79",
    "ff739e00",
    "ff333333",
    "ff00a0e6",
    "ff0055d4",
)
_HALF = "80"  # aa of areas, which leave the picture below to be seen
_OF_SEVERITY = {"critical": "ff0000d7", "warning": "ff0077ff", "watch": "ff00d7ff"}  # aabbggrr
_SEVERITY, _KIND = "severity", "kind"
_DOT, _DOT_SIZE = "files/dot.png", 32  # within the archive: nothing comes from a network; pixels
_NAMES = "name", "object_id", "tower_id", "wire_id", "span_id", "body", "id", "elevation"
_MOST = 10  # rows of a balloon, which is read at a glance; the data behind it have all
_ANY = ""  # columns of layers that have none under their own name

Headings = Mapping[str, Mapping[str, Column]]
"""Columns as people read them, by layer and name; "" is for any other layer."""


def write(frame: geopandas.GeoDataFrame, path: Path, layer: str, headings: Headings) -> None:
    """Write features in WGS 84, with a folder for each value of an attribute `layer`.

    What has an attribute `severity` has a folder and a colour for each.

    Parameters
    ----------
    layer : the folder of features without an attribute `layer`
    headings : of the columns that the balloons of features show, the first of them
    """
    import pyogrio

    if "layer" in frame.columns:
        groups = [(str(name), rows) for name, rows in frame.groupby("layer", sort=False)]
    else:
        groups = [(layer, frame)]
    groups = [part for name, rows in groups for part in _by_severity(name, rows)]
    ElementTree.register_namespace("", _SPACE)
    whole = ElementTree.Element(f"{{{_SPACE}}}kml")
    document = ElementTree.SubElement(whole, f"{{{_SPACE}}}Document")
    parts = []
    with TemporaryDirectory(dir=path.parent, prefix=".kmz-") as folder:
        for number, (name, rows) in enumerate(groups):  # GDAL appends a layer very slowly
            draft = Path(folder) / f"{number}.kml"
            shown = named(_filled(rows), name)
            with geopackage.same_date():
                pyogrio.write_dataframe(shown, draft, layer=name, driver="LIBKML")
            made = ElementTree.parse(draft).getroot()[0]
            _describe(made, shown, _columns(name.partition(", ")[0], headings))
            parts.append(_styled(made, number, name))
    for kind in zip(*parts, strict=True):  # the schema wants all styles first, then all columns
        document.extend(itertools.chain.from_iterable(kind))
    text = ElementTree.tostring(whole, encoding="utf-8", xml_declaration=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("doc.kml", _EPOCH), text, zipfile.ZIP_DEFLATED)
        archive.writestr(zipfile.ZipInfo(_DOT, _EPOCH), _dot(), zipfile.ZIP_STORED)


def dress(path: Path, frame: geopandas.GeoDataFrame, layer: str, headings: Headings) -> None:
    """Put styles and balloons into a KML that GDAL has written of features with :func:`named`."""
    ElementTree.register_namespace("", _SPACE)
    whole = ElementTree.parse(path)
    document = whole.getroot()[0]
    _describe(document, frame, _columns(layer, headings))
    severities = [str(s) for s in frame[_SEVERITY]] if _SEVERITY in frame else [""] * len(frame)
    found = list(dict.fromkeys(severities))
    for place, severity in zip(document.iter(f"{{{_SPACE}}}Placemark"), severities, strict=True):
        _set_style(place, f"#style{found.index(severity)}")
    for number, severity in enumerate(found):
        document.insert(number, _style(number, _OF_SEVERITY.get(severity, _COLOURS[0]), ""))
    whole.write(path, encoding="utf-8", xml_declaration=True)


def _columns(layer: str, headings: Headings) -> Mapping[str, Column]:
    return headings.get(layer) or headings.get(_ANY, {})


def _describe(
    document: ElementTree.Element, rows: geopandas.GeoDataFrame, columns: Mapping[str, Column]
) -> None:
    """Give each feature a table of its first columns, with units, for its balloon."""
    if not columns:
        return
    how = {name: _shown(name, rows[name], columns) for name in _first(rows, columns)}
    there = rows[list(how)].notna().to_dict("records")
    told = rows[list(how)].to_dict("records")
    places = document.iter(f"{{{_SPACE}}}Placemark")
    for place, row, known in zip(places, told, there, strict=True):
        words = {name: how[name].text(row[name]) for name in how if known[name]}
        cells = (
            f"<tr><td>{html.escape(how[n].heading)}</td>"
            f"<td>{html.escape(f'{text} {how[n].unit}'.rstrip())}</td></tr>"
            for n, text in words.items()
            if text
        )
        table = "".join(itertools.islice(cells, _MOST))
        if table:
            made = ElementTree.Element(f"{{{_SPACE}}}description")
            made.text = f"<table>{table}</table>"
            place.insert(_after_name(place), made)


def _first(rows: geopandas.GeoDataFrame, columns: Mapping[str, Column]) -> list[str]:
    """The columns with a heading: what tells a feature from others, then as they are declared."""
    headed = {**COMMON, **columns}
    names = dict.fromkeys([*_NAMES, _SEVERITY, _KIND, *columns, *COMMON])
    return [name for name in names if name in rows and name in headed and headed[name].heading]


def _shown(name: str, values: pd.Series[Any], columns: Mapping[str, Column]) -> Column:
    """How a column is shown; whole numbers of a layer that others have joined are whole again."""
    found = column_of(name, values, columns)
    known = values.dropna()
    usual = columns.get(name) or COMMON[name]
    if usual.digits is None and values.dtype.kind == "f" and (known == known.round()).all():
        return replace(found, digits=0)
    return found


def _by_severity(
    name: str, rows: geopandas.GeoDataFrame
) -> list[tuple[str, geopandas.GeoDataFrame]]:
    """The features of a layer in a group for each severity, the worst first; or all in one."""
    known = [s for s in _OF_SEVERITY if _SEVERITY in rows and (rows[_SEVERITY] == s).any()]
    groups = [(f"{name}, {s}", rows[rows[_SEVERITY] == s]) for s in known]
    others = rows[~rows[_SEVERITY].isin(known)] if known else rows
    return [*groups, *([(name, others)] if len(others) or not known else [])]


def _dot() -> bytes:
    """A white disc, which the colour of a style is laid on."""
    from PIL import Image, ImageDraw

    image = Image.new("RGBA", (_DOT_SIZE, _DOT_SIZE))
    ImageDraw.Draw(image).ellipse((4, 4, _DOT_SIZE - 5, _DOT_SIZE - 5), "white", "black")
    made = io.BytesIO()
    image.save(made, "PNG")
    return made.getvalue()


def _filled(rows: geopandas.GeoDataFrame) -> geopandas.GeoDataFrame:
    """The features with the attributes that hold anything."""
    empty = [n for n in rows if n != rows.geometry.name and rows[n].isna().all()]
    return rows.drop(columns=[*empty, *({"layer"} & set(rows))])


def named(frame: geopandas.GeoDataFrame, layer: str) -> geopandas.GeoDataFrame:
    """The features with a name to show each by."""
    frame = frame.copy()
    number = next((name for name in _NAMES if name in frame), None)
    if number is not None and "Name" not in frame:
        kinds = (
            frame[_KIND].where(frame[_KIND].notna(), layer)
            if _KIND in frame
            else [layer] * len(frame)
        )
        texts = (f"{kind} {_text(value)}" for kind, value in zip(kinds, frame[number], strict=True))
        missing = frame[number].isna()
        frame.insert(0, "Name", [layer if m else t for m, t in zip(missing, texts, strict=True)])
    return frame


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _styled(
    document: ElementTree.Element, number: int, name: str
) -> tuple[list[ElementTree.Element], list[ElementTree.Element], list[ElementTree.Element]]:
    """The style of a layer, its columns, and a folder with its features."""
    severity = name.rpartition(", ")[2]
    style = _style(number, _OF_SEVERITY.get(severity, _COLOURS[number % len(_COLOURS)]), _DOT)
    folder = ElementTree.Element(f"{{{_SPACE}}}Folder")
    ElementTree.SubElement(folder, f"{{{_SPACE}}}name").text = name
    for place in document.iter(f"{{{_SPACE}}}Placemark"):
        _set_style(place, f"#style{number}")
        folder.append(place)
    return [style], document.findall(f"{{{_SPACE}}}Schema"), [folder]


def _style(number: int, colour: str, icon: str) -> ElementTree.Element:
    """A style of points, lines and areas; points have the pin of the program without an icon."""
    style = ElementTree.Element(f"{{{_SPACE}}}Style", id=f"style{number}")
    point = _add(style, "IconStyle", color=colour, scale="0.7")
    if icon:
        _add(_add(point, "Icon"), "href").text = icon
    _add(style, "LabelStyle", scale="0.6")
    _add(style, "LineStyle", color=colour, width="2")
    _add(style, "PolyStyle", color=f"{_HALF}{colour[2:]}")
    return style


def _add(parent: ElementTree.Element, name: str, **texts: str) -> ElementTree.Element:
    made = ElementTree.SubElement(parent, f"{{{_SPACE}}}{name}")
    for child, text in texts.items():
        ElementTree.SubElement(made, f"{{{_SPACE}}}{child}").text = text
    return made


def _set_style(place: ElementTree.Element, url: str) -> None:
    """Put the reference where the schema has it: after name and words, before the data."""
    made = ElementTree.Element(f"{{{_SPACE}}}styleUrl")
    made.text = url
    place.insert(_after_name(place), made)


def _after_name(place: ElementTree.Element) -> int:
    """Where what follows the name, and the words on a feature, belongs."""
    tags = [child.tag for child in place]
    first = (f"{{{_SPACE}}}{name}" for name in ("description", "name"))
    return next((tags.index(tag) + 1 for tag in first if tag in tags), 0)
