"""Vector layers as DXF drawings, for CAD.

Points become POINT, or TEXT where they have an attribute `text` (its size is `text_height`, its
turn `angle`, in degrees counterclockwise; it is centred, or begins there where `anchor` is left), a
straight line with a text the DIMENSION that it is the line of, other lines and rings of polygons
LWPOLYLINE, or POLYLINE where they have heights. An attribute `layer`, or else `kind`, names the
layer of each; all attributes stand at the entity as extended data of the application LIDAR-TOOLBOX,
one text `name=value` each. What has a `severity`, and index contours (`is_index`), have layers of
their own, such as objects_critical and contours_index; what is of the kind `data edge` is on
data_edge, whatever it is part of. A drawing has a unit, but no CRS.
"""

from __future__ import annotations

import math
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.data.crs import length_problem, metres_per_unit
from toolbox.errors import DataError

if TYPE_CHECKING:
    import geopandas
    from ezdxf.document import Drawing

APPLICATION = "LIDAR-TOOLBOX"
LAYER, KIND = "layer", "kind"
TEXT, ANGLE, SIZE, ANCHOR, SHIFT = "text", "angle", "text_height", "anchor", "shift"
ABOUT = "about"  # what of a set a text is about: without one, nothing stands there
TICK, ABOVE = 0.6, 0.3  # of the height of a text: half a stroke of a dimension, gap below its text
EDGE = "data edge"  # a kind of lines that are no shore and no wall
DASHED = EDGE.replace(" ", "_")  # a layer of broken lines: what ends there goes on, unseen
_DASH = 5.0, 3.0  # heights of a text, or parts in 300 of the drawing: a stroke and a gap
_CROSS, _SHARE = 35, -1.5  # points are shown as circles with a cross, in percent of the view
_SCREEN = 1.5  # width over height of the window in which a drawing opens
_AROUND = 1.1  # height of what is seen there over that of the drawing
_STYLE = "measured"  # of dimensions
_BY_LAYER = 256  # colour of lines: that of their layer
_SIZE = 2.0  # of texts that say none, in the unit of the drawing
SEVERITY, INDEX = "severity", "is_index"
_OF_INDEX = "_index"
_OF_LABELS = "_labels"  # how layers of texts end, which have the colour of what they name
_OF_SEVERITY = {"critical": 1, "warning": 30, "watch": 52, "no rule": 8, "not sure": 9}
_OF_LAYER = {  # colours as numbers of AutoCAD; offices plot by them, so a name has always the same
    "frame": 7,
    "walls": 7,
    "openings": 5,
    "door": 22,
    "window": 5,
    "door_or_window": 34,
    "unseen": 8,
    "data_edge": 8,
    "dimensions": 200,
    "levels": 134,
    "numbers": 6,
    "title": 94,
    "contours": 34,
    "contours_index": 22,
    "wires": 5,
    "towers": 6,
    "crossings": 200,
}
_OTHERS = 3, 4, 5, 6, 8, 22, 34, 54, 94, 134, 140, 174, 194, 200, 230  # for other names
COLOUR_NAMES = {  # of colours, for people
    1: "red",
    3: "green",
    4: "cyan",
    5: "blue",
    6: "magenta",
    7: "black or white",
    8: "grey",
    9: "light grey",
    22: "brown",
    30: "orange",
    34: "dark orange",
    52: "dark yellow",
    54: "olive",
    94: "dark green",
    134: "teal",
    140: "light blue",
    174: "dark blue",
    194: "dark violet",
    200: "violet",
    230: "pink",
}
_HEAVY = 35  # hundredths of a millimetre: lines of index contours on paper
_LONGEST, _MOST = 255, 16_000  # bytes of a text, and of all at one entity
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")  # an end of line begins another entity
_UNITS = {
    1.0: 6,
    0.3048: 2,
    1200 / 3937: 21,
    0.001: 4,
    0.01: 5,
}  # metres of a unit: code of $INSUNITS
UNIT_NAMES = {6: "metres", 2: "feet", 21: "US survey feet", 4: "millimetres", 5: "centimetres"}


def write(frame: geopandas.GeoDataFrame, path: Path, layer: str) -> None:
    """Write features as a DXF drawing of AutoCAD 2010; the same features make the same bytes.

    Parameters
    ----------
    layer : of features without an attribute `layer` or `kind`

    Raises
    ------
    DataError
        An attribute is too long or has a line break, or no drawing can have a layer of this name.
    """
    with _without_times():
        places = shapely.get_coordinates(frame.geometry.to_numpy(), include_z=True)
        places[:, 2] = np.nan_to_num(places[:, 2])  # of plane features, as the drawing has them
        _save(_drawing(frame, path, layer), path, places)


@contextmanager
def _without_times() -> Iterator[None]:
    """Have ezdxf write no times and no random ids."""
    import ezdxf

    options = ezdxf.options  # type: ignore[attr-defined]
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


@dataclass(frozen=True, eq=False)
class Entity:
    """A line or text of a drawing in the plane, or points.

    Attributes
    ----------
    layer : its name
    xy : of shape (k, 2): one place for a text, more for a line
    text : to write at the place, of this `height`; "" for points or a line
    points : whether the places are points
    """

    layer: str
    xy: NDArray[np.float64]
    text: str = ""
    height: float = 0.0
    points: bool = False


def write_entities(
    path: Path, entities: Iterable[Entity], crs: CRS | None, colours: Mapping[str, str]
) -> None:
    """Write a drawing in the unit of a CRS; the same entities make the same bytes.

    Parameters
    ----------
    colours : of layers, as #rrggbb; others are black or white
    """
    from ezdxf.filemanagement import new

    from toolbox.data.dxf_points import add_points

    with _without_times():
        drawing = new("R2010", units=_unit(crs))
        space = drawing.modelspace()
        corners = [np.empty((0, 2))]
        for entity in entities:
            corners.append(entity.xy)
            name = re.sub(r'[<>/\\":;?*|=`,]', " ", entity.layer)
            if name not in drawing.layers:
                layer = drawing.layers.add(name)
                if colour := colours.get(entity.layer):
                    red, green, blue = bytes.fromhex(colour[1:])
                    layer.rgb = red, green, blue
            how = {"layer": name}
            if entity.text:
                made = space.add_text(entity.text, height=entity.height, dxfattribs=how)
                made.set_placement(tuple(entity.xy[0] - (0, 2 * entity.height)))
            elif entity.points:
                add_points(space, entity.xy, name)
            else:
                space.add_lwpolyline(entity.xy, dxfattribs=how)
        _save(drawing, path, np.pad(np.concatenate(corners), ((0, 0), (0, 1))))


def _save(drawing: Drawing, path: Path, places: NDArray[np.float64]) -> None:
    """Write a drawing that says where its entities are, so that CAD opens it there.

    Without it a drawing at coordinates of a map opens on nothing, at the origin.

    Parameters
    ----------
    places : corners and places of all entities, of shape (n, 3)
    """
    places = places[np.isfinite(places).all(axis=1)]
    if len(places):
        low, high = (end(places, axis=0).tolist() for end in (np.min, np.max))
        space = drawing.modelspace()
        space.reset_extents(low, high)
        space.reset_limits(low[:2], high[:2])
        wide, tall, _ = np.subtract(high, low)
        middle = np.add(low, high)[:2] / 2
        drawing.set_modelspace_vport(
            _AROUND * float(max(tall, wide / _SCREEN) or 1.0), tuple(middle.tolist())
        )
    for kind in sorted(drawing.entitydb.dxf_types_in_use()):  # ezdxf takes them as they are hashed
        drawing.classes.add_class(kind)
    drawing.saveas(path)


def _drawing(frame: geopandas.GeoDataFrame, path: Path, layer: str) -> Drawing:
    from ezdxf.filemanagement import new

    drawing = new("R2010", units=_unit(frame.crs))
    drawing.appids.add(APPLICATION)
    drawing.header["$PDMODE"], drawing.header["$PDSIZE"] = _CROSS, _SHARE
    space = drawing.modelspace()
    for name, (colour, _) in layers_of(frame, path, layer).items():
        made = drawing.layers.add(name, color=colour)
        if name.endswith(_OF_INDEX):
            made.dxf.lineweight = _HEAVY
        if name == DASHED:
            made.dxf.linetype = _dashes(drawing, frame)
    for row, geometry in zip(_rows(frame), frame.geometry, strict=True):
        how = {"layer": _layer_name(row, layer, path)}
        if is_blank(row):
            continue
        texts = _texts(row, path)
        for piece in shapely.get_parts(geometry):
            for entity in _written(space, piece, how, row) or _draw(space, piece, how):
                entity.set_xdata(APPLICATION, texts)
    return drawing


def _dashes(drawing: Drawing, frame: geopandas.GeoDataFrame) -> str:
    """Make the type of broken lines, as long as the texts of a drawing are high; its name."""
    texts = frame[SIZE].max() if SIZE in frame else np.nan
    west, south, east, north = frame.total_bounds
    size = texts if np.isfinite(texts) else max(east - west, north - south) / 1500
    stroke, gap = (float(part * size) / 2 for part in _DASH)
    drawing.linetypes.add("DASHED", [stroke + gap, stroke, -gap], description="Dashed __ __ __")
    return "DASHED"


def _rows(frame: geopandas.GeoDataFrame) -> list[dict[Any, Any]]:
    rows: list[dict[Any, Any]] = frame.drop(columns=frame.geometry.name).to_dict("records")
    return rows


def layers_of(
    frame: geopandas.GeoDataFrame, path: Path, layer: str = ""
) -> dict[str, tuple[int, int]]:
    """The layers of a drawing of features in their order: colour, and number of features.

    A name has the same colour in each drawing, and texts have that of what they name.
    """
    rows = _rows(frame)
    names = [_layer_name(row, layer or path.stem, path) for row in rows]
    first = dict(zip(reversed(names), reversed(rows), strict=True))
    found = {}
    for name, count in Counter(names).items():
        row = first[name]
        plain = _layer_name({**row, SEVERITY: None}, layer or path.stem, path)
        found[name] = _OF_SEVERITY.get(str(row.get(SEVERITY))) or colour_of(plain), count
    return found


def colour_of(layer: str) -> int:
    """The colour of a layer without severity, as number of AutoCAD, by its name alone.

    Examples
    --------
    >>> colour_of("towers"), colour_of("towers_labels")
    (6, 6)
    """
    own = layer.removesuffix(_OF_LABELS)
    return _OF_LAYER.get(own) or _OTHERS[zlib.crc32(own.encode()) % len(_OTHERS)]


def colour_name(colour: int) -> str:
    """The name of a colour of a layer, and its number in CAD.

    Examples
    --------
    >>> colour_name(30)
    'orange (30)'
    """
    return f"{COLOUR_NAMES[colour]} ({colour})"


def unit_name(crs: CRS | None) -> str:
    """The unit of a drawing in words, as $INSUNITS has it; "" if the drawing says none.

    Examples
    --------
    >>> unit_name(CRS(28992)), unit_name(None)
    ('metres', '')
    """
    return UNIT_NAMES.get(_unit(crs), "")


def _unit(crs: CRS | None) -> int:
    known = crs is not None and length_problem(crs) is None
    metres = metres_per_unit(crs) if known else 0.0
    return next((code for size, code in _UNITS.items() if np.isclose(size, metres, rtol=1e-9)), 0)


def _layer_name(row: Mapping[Any, Any], layer: str, path: Path) -> str:
    import pandas as pd
    from ezdxf.lldxf.validator import is_valid_layer_name

    values = (row.get(name) for name in (LAYER, KIND))
    named, kind = (None if pd.isna(value) else str(value) for value in values)
    name = named or layer
    if kind and (not named or kind == EDGE):
        name = kind.replace(" ", "_")
    if not pd.isna(severity := row.get(SEVERITY)):
        name = f"{name}_{severity}".replace(" ", "_")
    if row.get(INDEX) is True:
        name += _OF_INDEX
    if not is_valid_layer_name(name) or _CONTROL.search(name):
        raise DataError(f"{path}: a DXF layer cannot be called {name!r}")
    return name


def _texts(row: Mapping[Any, Any], path: Path) -> list[tuple[int, str]]:
    """The attributes of a feature that have a value, as texts of extended data (XDATA)."""
    import pandas as pd

    texts = [f"{name}={value}" for name, value in row.items() if not pd.isna(value)]
    if broken := next((text for text in texts if _CONTROL.search(text)), None):
        raise DataError(
            f"{path}: a DXF drawing holds no line breaks and control characters, as in "
            f"{broken[:60]!r}; write a GeoPackage (.gpkg)"
        )
    sizes = [len(text.encode()) for text in texts]
    if max(sizes, default=0) > _LONGEST or sum(sizes) > _MOST:
        raise DataError(
            f"{path}: a DXF drawing holds attributes of at most {_LONGEST} bytes each and {_MOST} "
            "together; write a GeoPackage (.gpkg)"
        )
    return [(1000, text) for text in texts]


def _written(space: Any, piece: Any, how: Mapping[str, str], row: Mapping[Any, Any]) -> list[Any]:
    """Add the text of a point to a drawing, centred on it; none for what has no text."""
    import pandas as pd
    from ezdxf.enums import TextEntityAlignment

    text = row.get(TEXT)
    if piece.is_empty or pd.isna(text):
        return []
    angle, height = (_number(row.get(name), usual) for name, usual in ((ANGLE, 0.0), (SIZE, _SIZE)))
    if shapely.get_dimensions(piece) == 1 and len(piece.coords) == 2:
        return [_dimension(space, piece, str(text), height, shift_of(row), how)]
    if shapely.get_dimensions(piece) != 0:
        return []
    (xyz,) = shapely.get_coordinates(piece, include_z=bool(piece.has_z))
    made = space.add_text(str(text), height=height, rotation=angle, dxfattribs=how)
    align = TextEntityAlignment
    left = row.get(ANCHOR) == "left"
    return [made.set_placement(xyz, align=align.MIDDLE_LEFT if left else align.MIDDLE_CENTER)]


def is_blank(row: Mapping[Any, Any]) -> bool:
    """Whether a row is a text about a set that says nothing of it, as of its client."""
    return isinstance(row.get(ABOUT), str) and not isinstance(row.get(TEXT), str)


def shift_of(row: Mapping[Any, Any]) -> float:
    """How far above its line the middle of a dimension's text stands, in heights of the text."""
    return _number(row.get(SHIFT), ABOVE + 0.5)


def _dimension(
    space: Any, line: Any, text: str, height: float, shift: float, how: Mapping[str, str]
) -> Any:
    """Add a dimension whose line this is: CAD measures it, with the decimals of its text.

    Words before the number, as in "ca. 1.20", stay before what is measured.

    Parameters
    ----------
    shift : of the middle of the text above the line, in heights of the text
    """
    (x0, y0), (x1, y1) = shapely.get_coordinates(line).tolist()
    before, number = text[: text.rfind(" ") + 1], text[text.rfind(" ") + 1 :]
    sign = "," if "," in number else "."
    look = {
        "dimtxt": height,
        "dimtsz": TICK * height,
        "dimgap": ABOVE * height,
        "dimtad": 1,  # the text stands above the line
        "dimtih": 0,  # and along it, also where it is between
        "dimtoh": 0,
        "dimse1": 1,  # without lines to what is measured
        "dimse2": 1,
        "dimdec": len(number.partition(sign)[2]),
        "dimzin": 0,  # zeros at the end are kept
        "dimdsep": ord(sign),
        "dimclrd": _BY_LAYER,
        "dimtmove": 2,  # a text that is moved has no leader
    }
    place = None
    if not math.isclose(shift, ABOVE + 0.5):
        up = shift * height / math.hypot(x1 - x0, y1 - y0)
        place = ((x0 + x1) / 2 - up * (y1 - y0), (y0 + y1) / 2 + up * (x1 - x0))
    if _STYLE not in space.doc.dimstyles:  # LibreCAD reads no other look than that of the header
        style = space.doc.dimstyles.new(_STYLE, dxfattribs=look)
        style.copy_to_header(space.doc)
    made = space.add_linear_dim(
        base=(x0, y0),
        p1=(x0, y0),
        p2=(x1, y1),
        angle=math.degrees(math.atan2(y1 - y0, x1 - x0)),
        location=place,
        text=f"{before}<>",
        dimstyle=_STYLE,
        override=look,
        dxfattribs=dict(how),
    )
    made.render()
    for part in made.dimension.get_geometry_block() or ():
        if part.dxf.layer == "0":  # of the block, which viewers draw black
            part.dxf.layer = how["layer"]
    return made.dimension


def _number(value: Any, usual: float) -> float:
    import pandas as pd

    return usual if pd.isna(value) else float(value)


def _draw(space: Any, piece: Any, how: Mapping[str, str]) -> list[Any]:
    """Add a point, line or polygon to a drawing; gives the DXF entities made."""
    if piece.is_empty:
        return []
    solid = bool(piece.has_z)
    if shapely.get_dimensions(piece) == 0:
        (xyz,) = shapely.get_coordinates(piece, include_z=solid)
        return [space.add_point(xyz, how)]
    polygon = shapely.get_dimensions(piece) == 2
    lines = [piece.exterior, *piece.interiors] if polygon else [piece]
    draw = space.add_polyline3d if solid else space.add_lwpolyline
    made = []
    for line in lines:
        vertices = shapely.get_coordinates(line, include_z=solid)
        closed = polygon or bool(line.is_closed)
        made.append(draw(vertices[:-1] if closed else vertices, close=closed, dxfattribs=how))
    return made
