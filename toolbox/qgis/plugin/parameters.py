"""Makes parameters of QGIS from the fields of tools.json, and reads their values for the tools."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Any

import qgis.core
from qgis.core import (
    NULL,
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsCsException,
    QgsProcessing,
    QgsProcessingException,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterFile,
    QgsProcessingUtils,
    QgsProject,
    QgsUnitTypes,
    QgsVectorFileWriter,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QUrl

from .lasheader import las_attributes, las_crs

UNSET = object()
"""The value of a parameter that was not given: the tool uses its own default."""

POINTS_AS_LAYERS = hasattr(qgis.core, "QgsProcessingParameterPointCloudDestination")  # 3.24
INFINITE = 1.7976931348623157e308
LARGEST = 2147483647
SAME_PLACE = 1e-9  # of coordinates: millimetres in those of a map
FORMATS = ["gpkg", "shp", "geojson", "fgb"]  # of vector layers that a tool reads as they are
TYPES = {
    "pointcloud": QgsProcessing.TypePointCloud,
    "raster": QgsProcessing.TypeRaster,
    "vector": QgsProcessing.TypeVectorAnyGeometry,
    "table": QgsProcessing.TypeVector,
}
WORDS = {"pointcloud": "Point clouds", "raster": "Rasters", "vector": "Vectors", "table": "Tables"}
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
        return f"Points ({patterns});;All files (*)"


class Choice(_Cloned, _parameter("Enum")):  # type: ignore[misc]
    """A choice that is kept by its name and shown in words."""

    shown: Any = ()


class AnyCrs(_Cloned, _parameter("Crs")):  # type: ignore[misc]
    """A CRS, or what stands for none, such as "local"."""

    def checkValueIsAcceptable(self, value: Any, context: Any = None) -> bool:
        return isinstance(value, str) or bool(super().checkValueIsAcceptable(value, context))


class Suggested(_Cloned, _parameter("String")):  # type: ignore[misc]
    """A text, for which the names of attributes or bands of a layer are offered."""

    source = ""  # the parameter of the layer
    offers: Any = ()  # or texts that are always offered


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


def is_path(value: Any) -> bool:
    """Whether a value is the path of a file or folder that exists, or a pattern of paths."""
    if not isinstance(value, str) or not value:
        return False
    path = value.partition("|layername=")[0]
    return os.path.exists(path) or (any(c in path for c in "*?[") and os.path.isabs(path))


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
        made.setFlags(made.flags() | QgsProcessingParameterDefinition.FlagAdvanced)
    return made


def is_value(field: dict[str, Any]) -> bool:
    """Whether an output is a number or text, which is not written to a file."""
    return "suffixes" not in field and "required" not in field


def _tip(field: dict[str, Any]) -> str:
    rule = field.get("rule")
    more = " Several with ; between." if field["many"] and field["type"] == "text" else ""
    return field["help"] + (f" ({rule})" if rule else "") + "." + more


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
    return Source(name, label, [TYPES[field["type"]]], default, empty)


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
    made.source, made.offers = field.get("of", "").upper(), field.get("offers", [])
    return made


def _classes(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    made = Classes(name, label, default, False, empty)
    made.known = field["known"]
    return made


def _range(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    double = _parameter("Number").Double
    return _parameter("Range")(name, label, double, _listed(default), True)


def _extent(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    box = default and [default[i] for i in (0, 2, 1, 3)]  # QGIS says both x first
    return _parameter("Extent")(name, label, _listed(box), True)


def _file(field: dict[str, Any], name: str, label: str, default: Any, empty: bool) -> Any:
    file = QgsProcessingParameterFile
    return file(name, label, file.File, "", default, empty, "All files (*)")


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
        made.setDefaultUnit(QgsUnitTypes.DistanceMeters)
        return made
    number = _parameter("Number")
    type = number.Integer if whole else number.Double
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
    if field["many"]:
        return _parameter("FolderDestination")(name, label, None, True, first)
    patterns = (f"*{suffix}" for suffix in field["suffixes"])
    word = WORDS.get(type) or f"{field['suffixes'][0][1:].upper()} files"
    filters = ";;".join(f"{word} ({pattern})" for pattern in patterns)
    if type not in DESTINATIONS:
        return _parameter("FileDestination")(name, label, filters, None, True, first)
    what = [TYPES[type]] if type in ("vector", "table") else []
    made = DESTINATIONS[type](name, label, *what, None, True, first)
    made.filters = filters
    return made


# Values --------------------------------------------------------------------------------------


class Reader:
    """Reads the values of the parameters of one run.

    Parameters
    ----------
    algorithm : the algorithm that runs
    inputs : the fields of its inputs
    parameters, context, feedback : from QGIS
    """

    def __init__(
        self,
        algorithm: Any,
        inputs: list[dict[str, Any]],
        parameters: Any,
        context: Any,
        feedback: Any,
    ) -> None:
        self.algorithm, self.inputs = algorithm, inputs
        self.parameters, self.context, self.feedback = parameters, context, feedback
        self.crs: QgsCoordinateReferenceSystem | None = None  # of the data, once it is needed

    def input(self, field: dict[str, Any]) -> Any:
        """The value of an input for the command line, or UNSET."""
        name, type = field["name"].upper(), field["type"]
        raw = self.parameters.get(name)
        if is_missing(raw):
            cleared = name in self.parameters and field["nullable"] and "default" in field
            return None if cleared else UNSET
        if type in TYPES:
            given = self._layers(field) if field["many"] else self._layer(name, type, raw)
            return self._in_crs_of_data(field, given) if type == "vector" else given
        return getattr(self, f"_{type}")(field, name, raw)

    def _as(self, kind: str, name: str, *more: Any) -> Any:
        read = getattr(self.algorithm, f"parameterAs{kind}")
        return read(self.parameters, name, self.context, *more)

    def _number(self, field: dict[str, Any], name: str, raw: Any) -> Any:
        """QGIS takes the default for a text that is no number; the tool refuses it."""
        return raw if isinstance(raw, str) else float(self._as("Double", name))

    _length = _number

    def _integer(self, field: dict[str, Any], name: str, raw: Any) -> Any:
        """QGIS would cut 5.5 to 5; the tool refuses it."""
        number = self._number(field, name, raw)
        return int(number) if isinstance(number, float) and number.is_integer() else number

    def _boolean(self, field: dict[str, Any], name: str, raw: Any) -> Any:
        """QGIS takes the word "no" for true; the tool reads it."""
        return raw if isinstance(raw, str) else self._as("Bool", name)

    def _choice(self, field: dict[str, Any], name: str, raw: Any) -> Any:
        """QGIS passes over a word that is no choice; the tool refuses it."""
        if isinstance(raw, str):
            return [word.strip() for word in re.split("[,;]", raw)] if field["many"] else raw
        return self._as("EnumStrings" if field["many"] else "EnumString", name)

    def _text(self, field: dict[str, Any], name: str, raw: Any) -> Any:
        text = self._as("String", name)
        if not field["many"]:
            return text
        return [item.strip() for item in text.split(";") if item.strip()]

    _classes = _text

    def _file(self, field: dict[str, Any], name: str, raw: Any) -> Any:
        return self._as("File", name)

    def _range(self, field: dict[str, Any], name: str, raw: Any) -> Any:
        numbers = self._as("Range", name)
        if all(map(math.isfinite, numbers)):
            return numbers
        empty = not isinstance(raw, str) or re.search("nan|none", raw.lower())  # as QGIS says it
        return UNSET if empty else raw

    def _crs(self, field: dict[str, Any], name: str, raw: Any) -> Any:
        crs = self._as("Crs", name)
        if not crs.isValid():
            return str(raw)  # such as "local"; the tool says whether it knows it
        return crs.authid() or crs.toWkt(QgsCoordinateReferenceSystem.WKT_PREFERRED)

    def _extent(self, field: dict[str, Any], name: str, raw: Any) -> Any:
        box = self._as("Extent", name, self._target_crs(self._as("ExtentCrs", name), field))
        if box.isNull() and isinstance(raw, str):
            return raw  # no rectangle; the tool says so
        return [box.xMinimum(), box.yMinimum(), box.xMaximum(), box.yMaximum()]

    def _position(self, field: dict[str, Any], name: str, raw: Any) -> Any:
        point = self._as("Point", name, self._target_crs(self._as("PointCrs", name), field))
        if point.isEmpty() and isinstance(raw, str):
            return raw
        return [point.x(), point.y()]

    def _target_crs(self, stated: Any, field: dict[str, Any]) -> QgsCoordinateReferenceSystem:
        """The CRS of the data, to which coordinates from the map are transformed."""
        if not stated.isValid():
            return QgsCoordinateReferenceSystem()
        if self.crs is None:
            self.crs = self._data_crs()
        if not self.crs.isValid():
            self.feedback.pushWarning(
                f"{field['label']} is given in {stated.authid()}, and the CRS of the data is not "
                "known to QGIS: its numbers are taken as coordinates of the data."
            )
        return self.crs

    def _data_crs(self, types: Any = TYPES) -> QgsCoordinateReferenceSystem:
        """The CRS of the first given layer of these types that states one."""
        for field in (f for f in self.inputs if f["type"] in types):
            name = field["name"].upper()
            raw = self.parameters.get(name)
            raw = raw[0] if isinstance(raw, (list, tuple)) and raw else raw
            if is_missing(raw):
                continue
            found = QgsCoordinateReferenceSystem()
            if isinstance(raw, str) and os.path.isfile(raw) and (stated := las_crs(raw)):
                found.createFromUserInput(stated)
            layer = None if found.isValid() else self._loaded(field, name)
            if layer is not None:
                found = layer.crs()
            if found.isValid():
                return found
        return QgsCoordinateReferenceSystem()

    def _loaded(self, field: dict[str, Any], name: str) -> Any:
        if field["many"]:
            return next(iter(self._as("LayerList", name)), None)
        return self._as("Layer", name)

    def _layers(self, field: dict[str, Any]) -> list[Any]:
        name = field["name"].upper()
        raw = self.parameters[name]
        values = list(raw) if isinstance(raw, (list, tuple)) else [raw]
        if all(map(is_path, values)):
            return [_layer_path(value) for value in values]
        layers = self._as("LayerList", name)
        if len(layers) < len(values) and is_plain(values):
            return values  # the tool says which file is not there
        return [source_of(layer) for layer in layers]

    def _layer(self, name: str, type: str, raw: Any) -> Any:
        if isinstance(raw, (list, tuple)) and is_plain(raw):
            return list(raw)
        if is_path(raw):  # as it is: QGIS need not open it, nor build an index beside it
            return _layer_path(raw)
        layer = self._as("Layer", name)
        if layer is None and isinstance(raw, str):
            return raw  # the tool says that there is no such file
        if type in ("vector", "table"):
            return self._features(name)
        if layer is None:
            raise QgsProcessingException(f"{name}: {raw} is no layer and no file")
        return source_of(layer)

    def _in_crs_of_data(self, field: dict[str, Any], given: Any) -> Any:
        """Features in the CRS of the points or raster, as tools of QGIS take them.

        A file of them in another is written anew. One that the tool would refuse stays as it is.
        """
        source = f"{given['path']}|layername={given['layer']}" if is_layer(given) else given
        target = self._data_crs(("pointcloud", "raster"))
        if not (is_path(source) and target.isValid()):
            return given
        layer = QgsVectorLayer(source, field["name"], "ogr")
        if not (layer.isValid() and layer.isSpatial() and layer.crs().isValid()):
            return given
        way = QgsCoordinateTransform(layer.crs(), target, self.context.transformContext())
        if not moves(way, layer.extent()):
            return given
        options = QgsVectorFileWriter.SaveVectorOptions()
        options.driverName, options.ct = "GPKG", way
        path = QgsProcessingUtils.generateTempFilename(f"{field['name']}.gpkg")
        rules = self.context.transformContext()
        error, said, *_ = QgsVectorFileWriter.writeAsVectorFormatV3(layer, path, rules, options)
        if error != QgsVectorFileWriter.NoError:
            raise QgsProcessingException(f"{field['label']} cannot be reprojected: {said}")
        names = [crs.authid() or crs.description() for crs in (layer.crs(), target)]
        self.feedback.pushInfo(f"{field['label']}: reprojected from {names[0]} to {names[1]}")
        return path

    def _features(self, name: str) -> Any:
        """The file of a layer; one in memory, filtered or selected is written to a file first."""
        path, layer = self.algorithm.parameterAsCompatibleSourceLayerPathAndLayerName(
            self.parameters, name, self.context, FORMATS, "gpkg", self.feedback
        )
        return {"path": path, "layer": layer} if layer else path

    def output(self, field: dict[str, Any]) -> Any:
        """The path of an output, or UNSET if it is skipped.

        Raises
        ------
        QgsProcessingException
            It is not a file of its own.
        """
        name = field["name"].upper()
        if field["many"]:
            folder = self._as("String", name) if name in self.parameters else ""
            return self._in_folder(folder, field) if folder else UNSET
        loads = field["type"] in ("raster", "vector", "table") or (
            field["type"] == "pointcloud" and POINTS_AS_LAYERS and opens_points()
        )
        path = self._as("OutputLayer" if loads else "FileOutput", name)
        if not path:
            return UNSET
        database = re.fullmatch(r"ogr:dbname='(.+?)' table=\"(.+?)\".*", path)
        if database and os.path.exists(database[1]):
            raise QgsProcessingException(
                f"{field['label']}: {database[1]} exists, and its other layers would be lost: "
                "tools write whole files. Choose a new GeoPackage."
            )
        if not database and re.match("[a-z]{2,}:", path):
            raise QgsProcessingException(f"{field['label']}: must be a file, got {path}")
        return {"path": database[1], "layer": database[2]} if database else path

    def _in_folder(self, folder: str, field: dict[str, Any]) -> str:
        os.makedirs(folder, exist_ok=True)
        return str(Path(folder) / (field["name"] + field["suffixes"][0]))


def is_missing(value: Any) -> bool:
    """Whether a value is empty; QGIS has NULL for it."""
    return value is None or value == NULL or (isinstance(value, str) and value == "") or value == []


def is_plain(value: Any) -> bool:
    """Whether a value is a text or number, or several of these, which a tool reads itself."""
    if isinstance(value, (list, tuple)):
        return bool(value) and all(map(is_plain, value))
    return isinstance(value, (str, int, float)) and value != ""


def _layer_path(value: str) -> Any:
    path, _, layer = value.partition("|layername=")
    return {"path": path, "layer": layer} if layer else path


def source_of(layer: Any) -> Any:
    """The file behind a layer, or the file and the name of the layer in it.

    Raises
    ------
    QgsProcessingException
        There is none, as for a layer of a server, or the layer is filtered.
    """
    path, *more = layer.source().split("|")
    path = path.removeprefix("vpc://")
    if path.startswith("file:"):
        path = QUrl(path).toLocalFile()
    if not os.path.exists(path):
        raise QgsProcessingException(
            f"Layer '{layer.name()}' is no file on this computer; save it to a file first."
        )
    if hasattr(layer, "subsetString") and layer.subsetString():
        raise QgsProcessingException(
            f"Layer '{layer.name()}' is filtered, which its file is not; save it to a file first."
        )
    names = [item[len("layername=") :] for item in more if item.startswith("layername=")]
    return {"path": path, "layer": names[0]} if names else path


def is_layer(value: Any) -> bool:
    """Whether a value is a layer of a file, and not the file."""
    return isinstance(value, dict)


def moves(way: Any, extent: Any) -> bool:
    """Whether a transformation changes coordinates; one between names of one CRS does not."""
    if way.isShortCircuited() or extent.isNull():
        return False
    corners = [(extent.xMinimum(), extent.yMinimum()), (extent.xMaximum(), extent.yMaximum())]
    try:
        there = [way.transform(x, y) for x, y in corners]
    except QgsCsException:  # outside of where it holds; the tool says which CRS there are
        return False
    size = max(1.0, *(abs(number) for corner in corners for number in corner))
    far = [(abs(p.x() - x), abs(p.y() - y)) for p, (x, y) in zip(there, corners)]
    return max(max(pair) for pair in far) > SAME_PLACE * size


def suggestions(value: Any) -> list[str]:
    """The names of the attributes of a layer or file; none if they cannot be told."""
    first = value[0] if isinstance(value, (list, tuple)) and value else value
    if is_missing(first):
        return []
    layer = QgsProject.instance().mapLayer(str(first))
    if layer is None and is_path(first):
        if names := las_attributes(str(first)):
            return names
        layer = QgsVectorLayer(str(first), "", "ogr")
    if isinstance(layer, QgsVectorLayer):
        return [field.name() for field in layer.fields()] if layer.isValid() else []
    if layer is None or not hasattr(layer, "attributes"):
        return []
    return las_attributes(layer.source()) or [a.name() for a in layer.attributes().attributes()]


def opens_points() -> bool:
    """Whether this QGIS can show LAS files."""
    return "pdal" in qgis.core.QgsProviderRegistry.instance().providerList()
