"""Reads the values of the dialogs, or of the line of QGIS, for the tools."""

from __future__ import annotations

import math
import os
import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsProcessing,
    QgsProcessingException,
    QgsProcessingFeatureSourceDefinition,
    QgsProcessingOutputLayerDefinition,
    QgsProcessingUtils,
    QgsVectorFileWriter,
    QgsVectorLayer,
)

from . import language
from .lasheader import las_crs
from .layers import (
    is_layer,
    is_missing,
    is_path,
    is_plain,
    layer_path,
    moves,
    opens_points,
    source_of,
)
from .parameters import POINTS_AS_LAYERS, TYPES

UNSET = object()
"""The value of a parameter that was not given: the tool uses its own default."""

FORMATS = ["gpkg", "shp", "geojson", "fgb"]  # of vector layers that a tool reads as they are


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

    _classes = _condition = _text

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
                language.text(
                    "{label} is given in {crs}, and the CRS of the data is not known to QGIS: its "
                    "numbers are taken as coordinates of the data."
                ).format(label=field["label"], crs=stated.authid())
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
            return [layer_path(value) for value in values]
        layers = self._as("LayerList", name)
        if len(layers) < len(values) and is_plain(values):
            return values  # the tool says which file is not there
        return [source_of(layer) for layer in layers]

    def _layer(self, name: str, type: str, raw: Any) -> Any:
        if isinstance(raw, (list, tuple)) and is_plain(raw):
            return list(raw)
        if is_path(raw):  # as it is: QGIS need not open it, nor build an index beside it
            return layer_path(raw)
        layer = self._as("Layer", name)
        if layer is None and isinstance(raw, str):
            return raw  # the tool says that there is no such file
        if type in ("vector", "table"):
            return self._features(name)
        if layer is None:
            raise QgsProcessingException(
                language.text("{name}: {value} is no layer and no file").format(
                    name=name, value=raw
                )
            )
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
        path = self._saved(layer, field["label"], f"{field['name']}.gpkg", way)
        names = [crs.authid() or crs.description() for crs in (layer.crs(), target)]
        text = language.text("{label}: reprojected from {old} to {new}")
        self.feedback.pushInfo(text.format(label=field["label"], old=names[0], new=names[1]))
        return path

    def _saved(self, layer: Any, label: str, file: str, way: Any = None) -> str:
        """The path of a temporary file with the features of a layer, moved if there is a way.

        Raises
        ------
        QgsProcessingException
            It cannot be written.
        """
        options = QgsVectorFileWriter.SaveVectorOptions()
        options.driverName = "GPKG"
        if way is not None:
            options.ct = way
        path = QgsProcessingUtils.generateTempFilename(file)
        rules = self.context.transformContext()
        error, said, *_ = QgsVectorFileWriter.writeAsVectorFormatV3(layer, path, rules, options)
        if error != QgsVectorFileWriter.WriterError.NoError:
            raise QgsProcessingException(
                language.text("{label} cannot be saved: {why}").format(label=label, why=said)
            )
        return str(path)

    def _features(self, name: str) -> Any:
        """The file of a layer; one in memory, filtered or selected is written to a file first.

        So is one whose CRS the project knows and its file does not state.
        """
        whole = not isinstance(self.parameters[name], QgsProcessingFeatureSourceDefinition)
        shown = self._as("Layer", name) if whole else None
        if shown is not None and shown.crs().isValid() and shown.providerType() == "ogr":
            of_file = QgsVectorLayer(shown.source(), name, "ogr")
            if of_file.isValid() and not of_file.crs().isValid():
                file = re.sub(r"[^\w -]", "_", shown.name())
                return self._saved(shown, shown.name(), f"{file}.gpkg")
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
        if field["type"] == "folder":
            return self._folder(field, name)
        if field["many"]:
            folder = self._as("String", name) if name in self.parameters else ""
            return self._in_folder(folder, field) if folder else UNSET
        loads = field["type"] in ("raster", "vector", "table") or (
            field["type"] == "pointcloud" and POINTS_AS_LAYERS and opens_points(self._place(name))
        )
        path = self._as("OutputLayer" if loads else "FileOutput", name)
        if not path:
            return UNSET
        database = re.fullmatch(r"ogr:dbname='(.+?)' table=\"(.+?)\".*", path)
        file = database[1] if database else path
        if (database and os.path.exists(file)) or _count_layers(file) > 1:
            raise QgsProcessingException(
                language.text(
                    "{label}: {file} exists, and its other layers would be lost: tools write whole "
                    "files. Choose a new GeoPackage."
                ).format(label=field["label"], file=file)
            )
        if not database and re.match("[a-z]{2,}:", path):
            raise QgsProcessingException(
                language.text("{label}: must be a file, got {path}").format(
                    label=field["label"], path=path
                )
            )
        return {"path": database[1], "layer": database[2]} if database else path

    def _folder(self, field: dict[str, Any], name: str) -> Any:
        """The path of a folder that the tool makes; a temporary one is its own.

        Dialogs do not ask whether the files of an earlier set may be replaced, so this is told.
        """
        if self.is_temporary(name):
            return QgsProcessingUtils.generateTempFilename(name.lower())
        if is_missing(self.parameters.get(name)):
            return UNSET
        path = self._as("String", name)
        if os.path.exists(os.path.join(path, field["readme"])):
            text = language.text(
                "{label}: the files of an earlier set in {folder} are replaced, unless any was "
                "changed"
            )
            self.feedback.pushWarning(text.format(label=field["label"], folder=path))
        return path

    def is_temporary(self, name: str) -> bool:
        """Whether an output has no place of its own."""
        return self._place(name) == QgsProcessing.TEMPORARY_OUTPUT

    def _place(self, name: str) -> str:
        """The path of an output as it was given."""
        raw = self.parameters.get(name)
        if isinstance(raw, QgsProcessingOutputLayerDefinition):
            raw = raw.sink.staticValue()
        return raw if isinstance(raw, str) else ""

    def _in_folder(self, folder: str, field: dict[str, Any]) -> str:
        os.makedirs(folder, exist_ok=True)
        return str(Path(folder) / (field["name"] + field["suffixes"][0]))


def _count_layers(path: str) -> int:
    """The number of layers of a GeoPackage; 0 for what is none or not there, 2 for one in use."""
    if not (path.lower().endswith(".gpkg") and os.path.isfile(path)):
        return 0
    try:
        with closing(
            sqlite3.connect(f"{Path(path).absolute().as_uri()}?mode=ro", uri=True, timeout=0)
        ) as file:
            count = "SELECT count(*) FROM gpkg_contents WHERE table_name <> 'layer_styles'"
            return int(file.execute(count).fetchone()[0])
    except sqlite3.OperationalError:  # another program holds it, and it may have any number
        return 2
    except sqlite3.DatabaseError:
        return 0
