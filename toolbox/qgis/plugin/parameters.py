"""Makes parameters of QGIS from the fields of tools.json."""

from __future__ import annotations

from typing import Any

import qgis.core
from qgis.core import (
    QgsProcessing,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterFile,
    QgsUnitTypes,
)

from . import language
from .layers import is_path

POINTS_AS_LAYERS = hasattr(qgis.core, "QgsProcessingParameterPointCloudDestination")  # 3.24
INFINITE = 1.7976931348623157e308
LARGEST = 2147483647
TYPES = {
    "pointcloud": QgsProcessing.SourceType.TypePointCloud,
    "raster": QgsProcessing.SourceType.TypeRaster,
    "vector": QgsProcessing.SourceType.TypeVectorAnyGeometry,
    "table": QgsProcessing.SourceType.TypeVector,
}
SHAPES = {
    "point": QgsProcessing.SourceType.TypeVectorPoint,
    "line": QgsProcessing.SourceType.TypeVectorLine,
    "polygon": QgsProcessing.SourceType.TypeVectorPolygon,
}
WORDS = {  # of the kinds of files
    "pointcloud": language.text("Point clouds"),
    "raster": language.text("Rasters"),
    "vector": language.text("Vector layers"),
    "table": language.text("Tables"),
}
NUMBERS = ("number", "integer", "length")  # also of outputs
WIDGETS: dict[Any, Any] = {}
"""The widget of ours by class of parameter; filled where there are dialogs."""


def _parameter(name: str) -> Any:
    return getattr(qgis.core, f"QgsProcessingParameter{name}")


class _Cloned:
    """A parameter whose copies are of its own class, with what it knows besides."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.args = args

    def clone(self) -> Any:
        made = type(self)(*self.args)
        made.setFlags(self.flags())  # type: ignore[attr-defined]
        made.setHelp(self.help())  # type: ignore[attr-defined]
        made.setMetadata(self.metadata())  # type: ignore[attr-defined]
        made.__dict__ |= {name: v for name, v in self.__dict__.items() if name != "args"}
        return made


class _PathMixin(_Cloned):
    """A layer that may also be a path, which QGIS itself need not be able to open.

    QGIS without PDAL opens no LAS; and a survey is a folder, a pattern or several files.
    """

    def checkValueIsAcceptable(self, value: Any, context: Any = None) -> bool:
        values = value if isinstance(value, (list, tuple)) else [value]
        if values and all(map(is_path, values)):
            return True
        return bool(super().checkValueIsAcceptable(value, context))  # type: ignore[misc]


class PointCloud(_PathMixin, _parameter("PointCloudLayer")):  # type: ignore[misc]
    """A point cloud or a survey."""

    reads: Any = ()  # the endings of files that the tools read

    def createFileFilter(self) -> str:
        """What file dialogs show: all that the tools read, which is more than QGIS does."""
        patterns = " ".join(f"*{suffix} *{suffix.upper()}" for suffix in self.reads)
        return f"{WORDS['pointcloud']} ({patterns});;{all_files()}"


class Choice(_Cloned, _parameter("Enum")):  # type: ignore[misc]
    """A choice that is kept by its name and shown in words."""

    shown: Any = ()


class AnyCrs(_Cloned, _parameter("Crs")):  # type: ignore[misc]
    """A CRS, or what stands for none, such as "local"."""

    def checkValueIsAcceptable(self, value: Any, context: Any = None) -> bool:
        return isinstance(value, str) or bool(super().checkValueIsAcceptable(value, context))


class Suggested(_Cloned, _parameter("String")):  # type: ignore[misc]
    """A text, for which the names of attributes or bands of layers are offered."""

    sources: Any = ()  # the parameters of these layers
    offers: Any = ()  # texts that are always offered
    many = False  # whether several may be given, with ; between


class Condition(_Cloned, _parameter("String")):  # type: ignore[misc]
    """A condition on attributes, whose names are offered to be put into it."""

    sources: Any = ()


class Classes(_Cloned, _parameter("String")):  # type: ignore[misc]
    """Classes of points, such as 2,9,14-16, which can be chosen by their names."""

    known: Any = ()  # code and name of each


class Source(_PathMixin, _parameter("FeatureSource")):  # type: ignore[misc]
    """Features or rows."""


class Layers(_PathMixin, _parameter("MultipleLayers")):  # type: ignore[misc]
    """Several layers of one type."""


class _Saved(_Cloned):
    """A result whose file dialog offers the formats that this one can be written in."""

    filters = ""

    def createFileFilter(self) -> str:
        return self.filters


class _Raster(_Saved, _parameter("RasterDestination")):  # type: ignore[misc]
    """A raster."""


class _Features(_Saved, _parameter("VectorDestination")):  # type: ignore[misc]
    """Features or rows."""


DESTINATIONS: dict[str, Any] = {"raster": _Raster, "vector": _Features, "table": _Features}
"""The class of a result that QGIS shows as a layer, by type."""

if POINTS_AS_LAYERS:

    class _Points(_Saved, _parameter("PointCloudDestination")):  # type: ignore[misc]
        """Points."""

    DESTINATIONS["pointcloud"] = _Points


# Definitions ---------------------------------------------------------------------------------


def definition(field: dict[str, Any]) -> Any:
    """Make the parameter of an input or written output, or the QGIS output of a value.

    Raises
    ------
    ValueError
        The field is of a type that this plugin does not know.
    """
    name, label, type = field["name"].upper(), field["label"], field["type"]
    if is_value(field):
        word = "Number" if type in NUMBERS and not field["many"] else "String"
        word = "Boolean" if type == "boolean" else word
        return getattr(qgis.core, f"QgsProcessingOutput{word}")(name, label)
    made = _destination(field) if "suffixes" in field else _input(field)
    made.setHelp(_tip(field))
    if widget := WIDGETS.get(made.__class__):
        made.setMetadata({"widget_wrapper": {"class": widget}})
    if field.get("advanced"):
        made.setFlags(made.flags() | QgsProcessingParameterDefinition.Flag.FlagAdvanced)
    return made


def is_value(field: dict[str, Any]) -> bool:
    """Whether an output is a number or text, which is not written to a file."""
    return "suffixes" not in field and "required" not in field


def _tip(field: dict[str, Any]) -> str:
    rule = field.get("rule")
    several = field["many"] and field["type"] == "text"
    more = f" {language.text('Several with ; between.')}" if several else ""
    return field["help"] + (f" ({rule})" if rule else "") + "." + more


def all_files() -> str:
    """What file dialogs show of which nothing is known."""
    return f"{language.text('All files')} (*)"


def _input(field: dict[str, Any]) -> Any:
    """The parameter; one that may be left empty is optional to QGIS."""
    default = field.get("default")
    empty = not field["required"] and (field["nullable"] or default in (None, ""))
    if field["type"] in TYPES and field["many"] and field["type"] != "pointcloud":
        name, label = field["name"].upper(), field["label"]
        return Layers(name, label, TYPES[field["type"]], default, empty)
    make = MAKERS.get(field["type"])
    if make is None:
        raise ValueError(f"{field['name']} is of the unknown type {field['type']}")
    return make(field, field["name"].upper(), field["label"], default, empty)


def _source(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    shapes = [SHAPES[shape] for shape in field.get("shapes", ())]
    return Source(name, label, shapes or [TYPES[field["type"]]], default, empty)


def _choice(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    """A choice, whose values are its words, not their numbers, since these may change."""
    if field["many"]:  # which the widget of QGIS shows as a list to tick
        return _parameter("Enum")(name, label, field["choices"], True, default, empty, True)
    made = Choice(name, label, field["choices"], False, default, empty, True)
    made.shown = field.get("words", field["choices"])
    return made


def _points(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    made = PointCloud(name, label, default, empty)
    made.reads = field.get("reads", ())
    return made


def _crs(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    """A CRS; that of files which state none may be none at all."""
    made = AnyCrs if field.get("option") else _parameter("Crs")
    return made(name, label, default, not field["required"])


def _text(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    """A text; names of attributes of a layer, or of what the toolbox has, are offered."""
    if not (field.get("of") or field.get("offers")):
        return _parameter("String")(name, label, default, False, empty)
    made = Suggested(name, label, default, False, empty)
    made.sources = [name.upper() for name in field.get("of", ())]
    made.offers, made.many = field.get("offers", []), field["many"]
    return made


def _condition(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    made = Condition(name, label, default, False, empty)
    made.sources = [name.upper() for name in field.get("of", ())]
    return made


def _classes(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    made = Classes(name, label, default, False, empty)
    made.known = field["known"]
    return made


def _range(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    double = _parameter("Number").Type.Double
    return _parameter("Range")(name, label, double, _listed(default), True)


def _extent(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    box = default and [default[i] for i in (0, 2, 1, 3)]  # QGIS says both x first
    return _parameter("Extent")(name, label, _listed(box), True)


def _file(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    behaviour = QgsProcessingParameterFile.Behavior.File
    return QgsProcessingParameterFile(name, label, behaviour, "", default, empty, all_files())


def _listed(numbers: list[float] | None) -> str | None:
    return ",".join(map(str, numbers)) if numbers else None


def _number(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    """A number with its limits; a length in metres is shown with the unit to choose."""
    whole = field["type"] == "integer"
    far = LARGEST if whole else INFINITE
    low = max(field.get("ge", -far), field.get("gt", -far))
    high = min(field.get("le", far), field.get("lt", far))
    if field["type"] == "length":
        made = _parameter("Distance")(name, label, default, "", empty, low, high)
        made.setDefaultUnit(QgsUnitTypes.DistanceUnit.DistanceMeters)
        return made
    number = _parameter("Number")
    type = number.Type.Integer if whole else number.Type.Double
    return number(name, label, type, default, empty, low, high)


MAKERS: dict[str, Any] = {
    "pointcloud": _points,
    "raster": lambda f, *args: _parameter("RasterLayer")(*args),
    "vector": _source,
    "table": _source,
    "number": _number,
    "integer": _number,
    "length": _number,
    "boolean": lambda f, *args: _parameter("Boolean")(*args),
    "choice": _choice,
    "classes": _classes,
    "condition": _condition,
    "range": _range,
    "extent": _extent,
    "position": lambda f, n, label, default, _: _parameter("Point")(
        n, label, _listed(default), True
    ),
    "crs": _crs,
    "file": _file,
    "text": _text,
}


def _destination(field: dict[str, Any]) -> Any:
    """The destination of an output, which may be skipped."""
    name, label, type = field["name"].upper(), field["label"], field["type"]
    first = bool(field.get("first"))
    if field["many"] or type == "folder":
        return _parameter("FolderDestination")(name, label, None, True, first)
    patterns = (f"*{suffix}" for suffix in field["suffixes"])
    word = WORDS.get(type) or field["suffixes"][0][1:].upper()
    filters = ";;".join(f"{word} ({pattern})" for pattern in patterns)
    if type not in DESTINATIONS:
        return _parameter("FileDestination")(name, label, filters, None, True, first)
    what = [TYPES[type]] if type in ("vector", "table") else []
    made = DESTINATIONS[type](name, label, *what, None, True, first)
    made.filters = filters
    return made
