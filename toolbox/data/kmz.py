"""Vector layers as KMZ, for Google Earth: a folder and a colour for each kind of feature.

GDAL writes the features; the styles, which it does not write, are put in, and all is packed.

References
----------
OGC 12-007r2 (2015). OGC KML 2.3; a KMZ file is a ZIP archive whose first KML file is shown.
"""

from __future__ import annotations

import io
import itertools
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from toolbox.data import geopackage

if TYPE_CHECKING:
    import geopandas

SUFFIX = ".kmz"
_SPACE = "http://www.opengis.net/kml/2.2"
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of all files in the archive: the same layer is the same file
_COLOURS = (  # aabbggrr of folders in turn, told apart also by those who see no red or green
    "ff0055d4",
    "ffb27200",
    "ff731e79",
    "ff00a0e6",
    "ff739e00",
    "ff333333",
)
_OF_SEVERITY = {"critical": "ff0000d7", "warning": "ff0077ff", "watch": "ff00d7ff"}  # aabbggrr
_SEVERITY, _KIND = "severity", "kind"
_DOT, _DOT_SIZE = "files/dot.png", 32  # within the archive: nothing comes from a network; pixels
_NAMES = "name", "object_id", "tower_id", "wire_id", "span_id", "id"


def write(frame: geopandas.GeoDataFrame, path: Path, layer: str) -> None:
    """Write features in WGS 84, with a folder for each value of an attribute `layer`.

    What has an attribute `severity` has a folder and a colour for each.

    Parameters
    ----------
    layer : the folder of features without an attribute `layer`
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
            with geopackage.same_date():
                pyogrio.write_dataframe(_named(rows, name), draft, layer=name, driver="LIBKML")
            root = ElementTree.parse(draft).getroot()
            parts.append(_styled(root[0], number, name))
    for kind in zip(*parts, strict=True):  # the schema wants all styles first, then all columns
        document.extend(itertools.chain.from_iterable(kind))
    text = ElementTree.tostring(whole, encoding="utf-8", xml_declaration=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("doc.kml", _EPOCH), text, zipfile.ZIP_DEFLATED)
        archive.writestr(zipfile.ZipInfo(_DOT, _EPOCH), _dot(), zipfile.ZIP_STORED)


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


def _named(rows: geopandas.GeoDataFrame, layer: str) -> geopandas.GeoDataFrame:
    """The features with a name to show each by, and the attributes that hold anything."""
    empty = [n for n in rows if n != rows.geometry.name and rows[n].isna().all()]
    frame = rows.drop(columns=[*empty, *({"layer"} & set(rows))])
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
    style = ElementTree.Element(f"{{{_SPACE}}}Style", id=f"style{number}")
    severity = name.rpartition(", ")[2]
    colour = _OF_SEVERITY.get(severity, _COLOURS[number % len(_COLOURS)])
    icon = _add(style, "IconStyle", color=colour, scale="0.7")
    _add(_add(icon, "Icon"), "href").text = _DOT
    _add(style, "LabelStyle", scale="0.6")
    _add(style, "LineStyle", color=colour, width="2")
    _add(style, "PolyStyle", color=f"60{colour[2:]}")
    folder = ElementTree.Element(f"{{{_SPACE}}}Folder")
    ElementTree.SubElement(folder, f"{{{_SPACE}}}name").text = name
    for place in document.iter(f"{{{_SPACE}}}Placemark"):
        _set_style(place, f"#style{number}")
        folder.append(place)
    return [style], document.findall(f"{{{_SPACE}}}Schema"), [folder]


def _add(parent: ElementTree.Element, name: str, **texts: str) -> ElementTree.Element:
    made = ElementTree.SubElement(parent, f"{{{_SPACE}}}{name}")
    for child, text in texts.items():
        ElementTree.SubElement(made, f"{{{_SPACE}}}{child}").text = text
    return made


def _set_style(place: ElementTree.Element, url: str) -> None:
    """Put the reference where the schema has it: after the name, before the data."""
    made = ElementTree.Element(f"{{{_SPACE}}}styleUrl")
    made.text = url
    name = place.find(f"{{{_SPACE}}}name")
    place.insert(0 if name is None else list(place).index(name) + 1, made)
