"""Checks that run in the Python of QGIS, in one start of it.

``inside.py PROFILE CLOUD FOLDER``, with names of checks behind it only these.
Prints a JSON object: for each function ``check_...`` an empty text, or what went wrong.
"""

from __future__ import annotations

import json
import math
import os
import re
import shlex
import shutil
import sys
import threading
import time
import traceback
import zipfile
from array import array
from collections.abc import Callable
from pathlib import Path

from osgeo import gdal
from qgis.core import (
    NULL,
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsExpression,
    QgsExpressionContext,
    QgsFeature,
    QgsGeometry,
    QgsMapLayerType,
    QgsPointCloudAttribute,
    QgsPointCloudAttributeCollection,
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeatureSourceDefinition,
    QgsProcessingFeedback,
    QgsProcessingOutputLayerDefinition,
    QgsProcessingUtils,
    QgsProject,
    QgsProperty,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsRectangle,
    QgsReferencedRectangle,
    QgsVectorFileWriter,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import Qt

PROFILE, CLOUD, FOLDER = sys.argv[1], sys.argv[2], Path(sys.argv[3])
ONLY = sys.argv[4:]
sys.path.insert(0, str(Path(PROFILE) / "python" / "plugins"))

os.environ.pop("TOOLBOX_LANG", None)
app = QgsApplication([], False)
app.initQgis()

from lidar_toolbox import bridge, language, lasheader, parameters, settings, styling  # noqa: E402
from lidar_toolbox.algorithm import ToolAlgorithm, option_words  # noqa: E402
from lidar_toolbox.layers import moves, source_of, suggestions  # noqa: E402
from lidar_toolbox.plugin import Provider  # noqa: E402
from lidar_toolbox.values import UNSET, Reader, _count_layers  # noqa: E402

provider = Provider()
QgsApplication.processingRegistry().addProvider(provider)
COLOURS = provider.listed["colours"]


class Feedback(QgsProcessingFeedback):
    """Keeps what it is told."""

    def __init__(self) -> None:
        super().__init__(False)
        self.said: list[str] = []
        self.commands: list[str] = []
        self.percents: list[float] = []
        self.progressChanged.connect(self.percents.append)

    def pushInfo(self, text: str) -> None:
        self.said.append(text)

    def pushWarning(self, text: str) -> None:
        self.said.append(text)

    def pushCommandInfo(self, text: str) -> None:
        self.commands.append(text)

    def pushConsoleInfo(self, text: str) -> None:
        self.said.append(text)

    def reportError(self, text: str, fatal: bool = False) -> None:
        self.said.append(text)


def context() -> QgsProcessingContext:
    made = QgsProcessingContext()
    made.setProject(QgsProject.instance())
    return made


def run(tool: str, feedback: Feedback | None = None, **values: object) -> dict[str, object]:
    algorithm = provider.algorithm(tool.replace(".", "").replace("_", ""))
    feedback = feedback or Feedback()
    ctx = context()
    fine, text = algorithm.checkParameterValues(values, ctx)
    assert fine, text
    results, ok = algorithm.create().run(values, ctx, feedback)
    assert ok, feedback.said
    return results


def out(name: str) -> str:
    return str(FOLDER / f"ergebnis ü {name}")


def square(name: str = "squares") -> QgsVectorLayer:
    """A layer in memory: two squares, each with a severity."""
    layer = QgsVectorLayer("Polygon?crs=EPSG:32635&field=severity:string", name, "memory")
    for x, severity in ((500010, "critical"), (500040, "low")):
        feature = QgsFeature(layer.fields())
        feature.setGeometry(QgsGeometry.fromRect(QgsRectangle(x, 4500010, x + 15, 4500025)))
        feature.setAttribute("severity", severity)
        assert layer.dataProvider().addFeature(feature)
    return layer


# Checks ------------------------------------------------------------------------------------------


def check_every_tool_follows_the_conventions() -> None:
    assert len(provider.algorithms()) == len(provider.listed["tools"]) > 20
    for algorithm in provider.algorithms():
        name = algorithm.name()
        made = algorithm.create()
        count = len(made.parameterDefinitions()) + len(made.outputDefinitions())
        assert count >= len(made.tool["inputs"]) + len(made.tool["outputs"]), name
        assert re.fullmatch("[a-z0-9]+", name), name
        assert re.fullmatch("[a-z0-9]+", made.groupId()), name
        assert not made.displayName().endswith("."), name
        assert made.shortDescription().endswith("."), name
        assert "<h3>Outputs</h3>" in made.shortHelpString(), name
        assert "lidar" in made.tags(), name
        assert made.tool["id"] in made.tags(), name
        assert os.path.isfile(made.helpUrl().replace("file://", "").replace("%20", " ")) or (
            "%" in made.helpUrl()
        ), made.helpUrl()
        assert not made.icon().isNull(), name
        assert Path(made.svgIconPath()).stem == made.groupId(), "an icon for each group"
        assert len(made.displayName()) <= 30, name
        assert made.canExecute()[0], name
        for definition in made.parameterDefinitions():
            assert definition.name() == definition.name().upper(), name
            assert definition.help(), (name, definition.name())
            assert type(definition.clone()) is type(definition), (name, definition.name())


def field(type: str, **more: object) -> dict[str, object]:
    says = {"name": type, "type": type, "label": type, "help": type, "many": False}
    return says | {"required": False, "nullable": True, "rule": ""} | more


FIELDS = [
    field("number", ge=0, default=3.0),
    field("integer"),
    field("length"),
    field("boolean", default=False, nullable=False),
    field("choice", choices=["a", "b"], default="b"),
    field("text"),
    field("classes", known=[[2, "Ground"]]),
    field("range"),
    field("extent"),
    field("position"),
    field("crs"),
    field("pointcloud"),
    field("raster"),
    field("vector"),
    field("table"),
    field("file"),
    field("text", name="texts", many=True),
    field("choice", name="choices", many=True, choices=["a", "b", "c"]),
    field("pointcloud", name="clouds", many=True),
    field("vector", name="vectors", many=True),
]
EVERYTHING = {"id": "all.types", "algorithm": "alltypes", "inputs": FIELDS, "outputs": []}


def read(**values: object) -> dict[str, object]:
    """The values that a tool of all types would be given."""
    algorithm = ToolAlgorithm(EVERYTHING, COLOURS).create()
    feedback = Feedback()
    reader = Reader(algorithm, FIELDS, values, context(), feedback)
    found = {f["name"]: reader.input(f) for f in FIELDS}
    found["said"] = feedback.said
    return {name: value for name, value in found.items() if value is not UNSET}


def check_values_of_every_type() -> None:
    given = {"NUMBER": "2.5", "INTEGER": 5.5, "LENGTH": 12, "BOOLEAN": "no", "CHOICE": "a"}
    given |= {
        "CLASSES": "2,9,14-16",
        "TEXT": "a, b",
        "RANGE": "0,0.2",
        "EXTENT": "1,3,2,4",
        "POSITION": "5,6",
    }
    given |= {"CRS": "EPSG:2154", "TEXTS": " a ; b;", "CHOICES": ["a", "c"], "FILE": CLOUD}
    got = read(**given)
    assert got == {
        "number": "2.5",
        "integer": 5.5,
        "length": 12.0,
        "boolean": "no",
        "choice": "a",
        "text": "a, b",
        "classes": "2,9,14-16",
        "range": [0.0, 0.2],
        "extent": [1.0, 2.0, 3.0, 4.0],
        "position": [5.0, 6.0],
        "crs": "EPSG:2154",
        "texts": ["a", "b"],
        "choices": ["a", "c"],
        "file": CLOUD,
        "said": [],
    }, got
    assert read(INTEGER=5.0, BOOLEAN=True)["integer"] == 5
    assert read(NUMBER=QgsProperty.fromExpression("1 + 2"))["number"] == 3.0
    assert read(CRS="local")["crs"] == "local"


def check_what_is_left_empty_is_not_given() -> None:
    names = [f["name"].upper() for f in FIELDS]
    for nothing in (None, NULL, ""):
        got = read(**dict.fromkeys(names, nothing))
        # what has a default and may be none was cleared
        assert got == {"number": None, "choice": None, "said": []}, got
    assert read() == {"said": []}


def check_layers_of_every_type() -> None:
    layer = square()
    QgsProject.instance().addMapLayer(layer)
    package = out("two.gpkg")
    for name in ("first", "second"):
        options = QgsVectorFileWriter.SaveVectorOptions()
        options.layerName, options.driverName = name, "GPKG"
        if name == "second":
            options.actionOnExistingFile = (
                QgsVectorFileWriter.ActionOnExistingFile.CreateOrOverwriteLayer
            )
        transform = QgsProject.instance().transformContext()
        QgsVectorFileWriter.writeAsVectorFormatV2(layer, package, transform, options)
    second = f"{package}|layername=second"
    got = read(POINTCLOUD=CLOUD, VECTOR=layer.id(), TABLE=second, CLOUDS=[CLOUD, CLOUD])
    assert got["pointcloud"] == CLOUD
    assert got["clouds"] == [CLOUD, CLOUD]
    assert got["table"] == {"path": package, "layer": "second"}
    exported = got["vector"]["path"] if isinstance(got["vector"], dict) else got["vector"]
    assert QgsVectorLayer(exported).featureCount() == 2
    # selected features alone
    layer.select([1])
    chosen = QgsProcessingFeatureSourceDefinition(layer.id(), True)
    exported = read(VECTOR=chosen)["vector"]
    exported = exported["path"] if isinstance(exported, dict) else exported
    assert QgsVectorLayer(exported).featureCount() == 1
    # a layer of a GeoPackage in the project, then filtered
    loaded = QgsVectorLayer(second, "loaded", "ogr")
    QgsProject.instance().addMapLayer(loaded)
    assert read(VECTOR=loaded)["vector"] == {"path": package, "layer": "second"}
    loaded.setSubsetString("severity = 'low'")
    exported = read(VECTOR=loaded)["vector"]
    exported = exported["path"] if isinstance(exported, dict) else exported
    assert exported != package
    assert QgsVectorLayer(exported).featureCount() == 1
    assert read(POINTCLOUD=[CLOUD, CLOUD])["pointcloud"] == [CLOUD, CLOUD]
    assert read(POINTCLOUD=str(Path(CLOUD).parent))["pointcloud"] == str(Path(CLOUD).parent)


def check_a_layer_without_a_file_is_refused() -> None:
    layer = QgsRasterLayer(
        "url=http://localhost/none&layers=a&styles=&format=image/png", "w", "wms"
    )
    said = ""
    try:
        source_of(layer)
    except QgsProcessingException as err:
        said = str(err)
    assert "save it to a file first" in said
    package = out("parts.gpkg")
    options = QgsVectorFileWriter.SaveVectorOptions()
    options.layerName, options.driverName = "parts", "GPKG"
    transform = QgsProject.instance().transformContext()
    QgsVectorFileWriter.writeAsVectorFormatV2(square(), package, transform, options)
    part = QgsVectorLayer(f"{package}|layername=parts", "part", "ogr")
    assert source_of(part) == {"path": package, "layer": "parts"}
    part.setSubsetString("severity = 'low'")
    try:
        source_of(part)
    except QgsProcessingException as err:
        said = str(err)
    assert "'part' is filtered" in said


def check_what_is_drawn_on_the_map_comes_in_the_coordinates_of_the_data() -> None:
    degrees = QgsReferencedRectangle(
        QgsRectangle(27.0001, 40.6501, 27.0003, 40.6503), QgsCoordinateReferenceSystem("EPSG:4326")
    )
    got = read(POINTCLOUD=CLOUD, EXTENT=degrees, POSITION="27.0,40.65 [EPSG:4326]")
    assert abs(got["extent"][0] - 500008.5) < 2, got
    assert abs(got["position"][0] - 500000) < 1, got
    assert 4499000 < got["extent"][1] < 4501000, got
    assert got["said"] == []
    plain = str(FOLDER / "a.xyz")
    Path(plain).write_text("1 2 3\n")
    got = read(POINTCLOUD=plain, EXTENT=degrees)
    assert abs(got["extent"][0] - 27.0001) < 1e-9
    assert "taken as coordinates of the data" in got["said"][0]


def check_what_is_wrong_is_left_to_the_tool_to_say() -> None:
    algorithm = ToolAlgorithm(EVERYTHING, COLOURS).create()
    fine, text = algorithm.checkParameterValues({"NUMBR": 1}, context())
    assert (fine, "numbr: unknown parameter" in text) == (False, True), text
    needed = EVERYTHING | {"inputs": [field("pointcloud", required=True)]}
    assert not ToolAlgorithm(needed, COLOURS).create().checkParameterValues({}, context())[0]
    assert algorithm.checkParameterValues({"NUMBER": NULL}, context())[0]
    none = "/no/file.laz"
    wrong = {"NUMBER": "abc", "INTEGER": "1.5", "LENGTH": "nan", "CHOICE": "c", "RANGE": "3"}
    wrong |= {"EXTENT": "1,2,3", "POSITION": "5", "POINTCLOUD": none, "RASTER": none}
    wrong |= {"VECTOR": none, "CLOUDS": [none, CLOUD], "CRS": "EPSG:0"}
    assert algorithm.checkParameterValues(wrong, context())[0]
    got = read(**wrong)
    assert got.pop("said") == []
    assert got == {name.lower(): value for name, value in wrong.items()}, got
    assert read(CHOICES="a, d;b")["choices"] == ["a", "d", "b"]


def check_no_file_is_written_over_for_a_layer_of_it() -> None:
    taken = out("taken.gpkg")
    Path(taken).write_text("layers of somebody")
    output = {"name": "made", "type": "vector", "label": "Made", "help": "h", "many": False}
    output["suffixes"] = [".gpkg"]
    algorithm = ToolAlgorithm(EVERYTHING | {"outputs": [output]}, COLOURS).create()
    database = "ogr:dbname='{}' table=\"a\" (geom)"
    new, several = out("new.gpkg"), out("several.gpkg")
    for name in ("a", "b"):
        options = QgsVectorFileWriter.SaveVectorOptions()
        options.layerName = name
        if os.path.exists(several):
            options.actionOnExistingFile = (
                QgsVectorFileWriter.ActionOnExistingFile.CreateOrOverwriteLayer
            )
        QgsVectorFileWriter.writeAsVectorFormatV3(
            square(), several, QgsProject.instance().transformContext(), options
        )
    for place, expected in (
        (several, "its other layers would be lost"),
        (database.format(taken), "its other layers would be lost"),
        ("postgis:dbname='x' table=\"b\"", "must be a file"),
        (database.format(new), {"path": new, "layer": "a"}),
        (taken, taken),  # a plain file: the dialog has asked
    ):
        reader = Reader(algorithm, [], {"MADE": place}, context(), Feedback())
        try:
            got = reader.output(output)
        except QgsProcessingException as err:
            got = str(err)
        assert got == expected or str(expected) in got, got


def check_another_version_of_the_toolbox_is_told() -> None:
    program = FOLDER / "old python"
    event = json.dumps({"event": "error", "message": "no tool called 'samples.scene'"})
    told = f"case \"$*\" in *--version) echo lidar-toolbox 0.0.9;; *) echo '{event}'; exit 2;; esac"
    program.write_text(f"#!/bin/sh\n{told}\n")
    program.chmod(0o755)
    feedback = Feedback()
    os.environ[bridge.PYTHON] = str(program)
    try:
        _, ok = provider.algorithm("samplesscene").create().run({}, context(), feedback)
        os.environ[bridge.PYTHON] = "/no/python"
        assert "at /no/python" in provider.algorithm("samplesscene").create().canExecute()[1]
    finally:
        del os.environ[bridge.PYTHON]
    assert not ok
    assert any("has version 0.0.9" in text for text in feedback.said), feedback.said


def check_what_a_library_prints_is_shown() -> None:
    program = FOLDER / "chatty python"
    odd = ("plain text", '{"event": "progress"}', '["event"]', "{}")
    result = json.dumps({"event": "result", "outputs": {}})
    lines = "\n".join(f"echo '{line}'" for line in (*odd, result))
    program.write_text(f"#!/bin/sh\n{lines}\n")
    program.chmod(0o755)
    feedback = Feedback()
    os.environ[bridge.PYTHON] = str(program)
    try:
        assert bridge.run("a.b", [], {}, feedback) == {}
    finally:
        del os.environ[bridge.PYTHON]
    assert [text for text in feedback.said if text in odd] == list(odd), feedback.said


def check_how_a_tool_ended_is_told() -> None:
    program = FOLDER / "killed python"
    program.write_text("#!/bin/sh\nkill -9 $$\n")
    program.chmod(0o755)
    os.environ[bridge.PYTHON] = str(program)
    said = ""
    try:
        bridge.run("a.b", [], {}, Feedback())
    except QgsProcessingException as err:
        said = str(err)
    finally:
        del os.environ[bridge.PYTHON]
    assert "memory runs out" in said, said
    assert "tile size under Advanced" in said, said


def check_the_command_to_repeat_a_run() -> None:
    values = {"points": "/a b/c.laz", "offset": -2, "extent": [-1.0, 2.0, 3.0, 4.0]}
    values |= {"polygons": {"path": "/d.gpkg", "layer": "e"}, "reads": ["f", "g h"]}
    made = bridge.repeated("python", "points.clip", ["--overwrite"], values)
    assert made == (
        "python -m toolbox run points.clip --points '/a b/c.laz' --offset=-2 "
        "--extent=-1.0,2.0,3.0,4.0 --polygons /d.gpkg --polygons.layer e "
        "--reads f 'g h' --overwrite"
    ), made
    feedback = Feedback()
    run("points.info", feedback, POINTS=CLOUD)
    (told,) = [text for text in feedback.commands if "points.info" in text]
    assert told.endswith(f"-m toolbox run points.info --points {shlex.quote(CLOUD)} --overwrite"), (
        told
    )


def check_errors_are_in_the_words_of_the_dialog() -> None:
    algorithm = provider.algorithm("pointsdenoise").create()
    text = "points.denoise: 1 problem\n  points: a.xyz has no CRS; state it with --assume-crs"
    assert algorithm.in_words_of_the_dialog(
        f"{text} EPSG:..., or --assume-crs local\n  no: -x"
    ) == (
        "“Remove noise”: 1 problem\n  “Points”: a.xyz has no CRS; choose it in "
        "“CRS, if the file states none”: EPSG:..., or local\n  no: -x"
    )


def check_names_of_attributes_are_offered() -> None:
    described = out("described.laz")
    run("features.local", POINTS=CLOUD, DESCRIBED=described, FEATURES=["planarity"])
    names = lasheader.las_attributes(described)
    assert {"intensity", "classification", "planarity"} <= set(names), names
    assert list(suggestions([described, CLOUD])) == names
    layer = square("offered")
    QgsProject.instance().addMapLayer(layer)
    assert suggestions(layer.id()) == {"severity": "severity"}
    image = out("bands.tif")
    run("surface.grid", POINTS=CLOUD, CELL=2.0, SURFACE=image)
    assert list(suggestions(image, True).values()) == ["1"]
    clearance = provider.algorithm("corridorclearance").create()
    assert "thesis" in clearance.parameterDefinition("RULES").offers
    assert "Drake" in clearance.parameterDefinition("CONDUCTOR").clone().offers
    plain = FOLDER / "no header.xyz"
    plain.write_text("1 2 3\n")
    for nothing in (None, "", str(plain), "/no/file.laz", str(FOLDER)):
        assert suggestions(nothing) == {}, nothing
    assert suggestions("/no/file.tif", True) == {}
    for tool, name, source in (
        ("classifyndvi", "NIR", "IMAGE"),
        ("pointssampleraster", "BANDS", "RASTER"),
        ("compareareas", "LABEL", "AREAS"),
        ("comparespans", "SPAN", "REFERENCE"),
        ("pointsfilter", "WHERE", "POINTS"),
    ):
        holds = provider.algorithm(tool).create()
        made = holds.parameterDefinition(name)
        assert made.clone().sources == [source], (tool, made.sources)
    holds = provider.algorithm("comparerasters").create()
    assert holds.parameterDefinition("CLASS_ATTRIBUTE").sources == ["AREAS", "CHECKPOINTS"]
    holds = provider.algorithm("surfacegrid").create()
    assert holds.parameterDefinition("TILE").offers[0] == "auto"
    holds = provider.algorithm("pointsreproject").create()
    assert holds.parameterDefinition("GEOID").type() == "file"


def check_points_are_picked_by_all_endings_that_are_read() -> None:
    algorithm = provider.algorithm("pointsinfo").create()
    made = algorithm.parameterDefinition("POINTS")
    for copy in (made, made.clone()):
        filters = copy.createFileFilter()
        for ending in ("*.laz ", "*.LAS ", "*.e57 ", "*.xyz.gz ", "*.vpc "):
            assert ending in filters, filters
    assert made.checkValueIsAcceptable([CLOUD, CLOUD])
    assert made.checkValueIsAcceptable(str(FOLDER))


def check_the_crs_that_the_project_knows_of_a_layer_is_used() -> None:
    """The file of the layer states none, and its user has set it in QGIS."""
    bare, options = out("bare.shp"), QgsVectorFileWriter.SaveVectorOptions()
    options.driverName = "ESRI Shapefile"
    rules = QgsProject.instance().transformContext()
    QgsVectorFileWriter.writeAsVectorFormatV3(square(), bare, rules, options)
    os.remove(bare.replace(".shp", ".prj"))
    layer = QgsVectorLayer(bare, "plots", "ogr")
    assert not layer.crs().isValid()
    QgsProject.instance().addMapLayer(layer)
    assert read(VECTOR=layer.id())["vector"] == bare, "nobody has said it"
    layer.setCrs(QgsCoordinateReferenceSystem("EPSG:32635"))
    path = read(VECTOR=layer.id())["vector"]
    assert QgsVectorLayer(path).crs().authid() == "EPSG:32635", path
    assert "plots" in path
    assert QgsVectorLayer(path).featureCount() == 2


def check_features_in_another_crs_are_reprojected() -> None:
    layer = QgsVectorLayer("Polygon?crs=EPSG:4326&field=severity:string", "degrees", "memory")
    feature = QgsFeature(layer.fields())
    feature.setGeometry(QgsGeometry.fromRect(QgsRectangle(27.0001, 40.65, 27.0003, 40.6502)))
    assert layer.dataProvider().addFeature(feature)
    QgsProject.instance().addMapLayer(layer)
    got = read(POINTCLOUD=CLOUD, VECTOR=layer.id())
    made = QgsVectorLayer(got["vector"])
    assert made.crs().authid() == "EPSG:32635", made.crs().authid()
    assert abs(made.extent().xMinimum() - 500008.5) < 1, made.extent()
    assert got["said"] == ["vector: reprojected from EPSG:4326 to EPSG:32635"], got
    same = square("same")
    QgsProject.instance().addMapLayer(same)
    assert read(POINTCLOUD=CLOUD, VECTOR=same.id())["said"] == []
    assert read(VECTOR=layer.id())["said"] == []
    # of one place with a name of heights, as LAS files state it
    plain, compound = (QgsCoordinateReferenceSystem(f"EPSG:{n}") for n in (28992, 7415))
    way = QgsCoordinateTransform(plain, compound, QgsProject.instance())
    assert not moves(way, QgsRectangle(121000, 486000, 122000, 487000))


def check_save_dialogs_offer_what_can_be_written() -> None:
    for tool, name, offered, other in (
        ("compareclasses", "TABLE", "*.csv", "dxf"),
        ("shorelinealphashape", "OUTLINES", "*.dxf", "*.json"),
        ("surfacegrid", "SURFACE", "*.tif", "png"),
        ("pointsfilter", "KEPT", "*.laz", "e57"),
    ):
        algorithm = provider.algorithm(tool).create()
        made = algorithm.parameterDefinition(name)
        for copy in (made, made.clone()):
            filters = copy.createFileFilter()
            assert offered in filters, (tool, filters)
            assert other not in filters, (tool, filters)


def check_a_style_of_the_user_stays() -> None:
    mine = ("lidartoolbox:surfacegrid", "SURFACE")
    place = out("styled.tif")
    run("surface.grid", POINTS=CLOUD, SURFACE=place, CELL=5.0)
    layer = QgsRasterLayer(place, "DTM")
    sys.path[:0] = ["/usr/share/qgis/python/plugins"]
    from processing.gui.RenderingStyles import RenderingStyles

    assert not styling.has_style_of_user(layer, *mine)
    for chosen, output, expected in (
        ("lidartoolbox:surfacegrid", "SURFACE", True),
        ("lidartoolbox:surfacegrid", "OTHER", False),
        ("model:my", "bottom:DTM", True),
        ("model:my", "bottom:DSM", False),
        ("lidartoolbox:modelsterrain", "SURFACE", False),
    ):
        RenderingStyles.styles = {chosen: {output: "a.qml"}}
        assert styling.has_style_of_user(layer, *mine) == expected, (chosen, output)
    RenderingStyles.styles = {}
    layer.saveNamedStyle(place.replace(".tif", ".qml"))
    assert styling.has_style_of_user(layer, *mine)
    styler = styling.Styler.of(COLOURS, None, mine)
    styler.postProcessLayer(layer, context(), Feedback())
    assert type(layer.renderer()).__name__ == "QgsSingleBandGrayRenderer"


def wheel_of(check: str) -> Path:
    """A wheel that needs nothing, with a toolbox that answers the check of the plugin, or not."""
    path = FOLDER / "lidar_toolbox-9.9-py3-none-any.whl"
    about = "lidar_toolbox-9.9.dist-info"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("toolbox/__init__.py", "")
        archive.writestr("toolbox/qgis/__init__.py", "")
        archive.writestr("toolbox/qgis/tools.py", check)
        meta = "Metadata-Version: 2.1\nName: lidar-toolbox\nVersion: 9.9\n"
        archive.writestr(f"{about}/METADATA", meta)
        wheel = "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        archive.writestr(f"{about}/WHEEL", wheel)
        archive.writestr(f"{about}/RECORD", "")
    return path


def check_an_environment_is_made_of_a_file_and_whole_or_not_at_all() -> None:
    kept = settings.base_python, bridge.own_environment, bridge._root, settings.BUNDLED
    folder, python = FOLDER / "env ü", str(bridge.find_python())
    settings.base_python = lambda: python
    bridge.own_environment = lambda: folder
    bridge._root = lambda: ""

    def refused(**given: str) -> str:
        try:
            settings.create_environment(None, **given)
        except RuntimeError as err:
            return str(err)
        return ""

    try:
        for name in ("lidar-toolbox", "", "/no/lidar_toolbox-9.9.whl", str(FOLDER)):
            assert "is no wheel" in refused(wheel=name), name
        assert "failed" in refused(wheel=str(wheel_of("raise SystemExit('no')")))
        assert not folder.exists()
        path = wheel_of("def listing(): return {'toolbox': '9.9'}")
        settings.BUNDLED = FOLDER / "bundle"
        settings.BUNDLED.mkdir()
        shutil.copy(path, settings.BUNDLED)
        (settings.BUNDLED / "SHA256").write_text("0" * 64 + "  name\n")
        assert "is damaged" in refused(wheel=str(settings.bundled()))
        assert not folder.exists()
        made = settings.create_environment(None, wheel=str(path))
        assert (folder / bridge.COMPLETE).read_text() == "lidar-toolbox 9.9"
        assert os.path.isfile(made)
        kept_installed, bridge._installed = bridge._installed, dict
        try:
            assert bridge.find_python() == made
            (folder / bridge.COMPLETE).unlink()
            assert bridge.find_python() is None
        finally:
            bridge._installed = kept_installed
    finally:
        settings.base_python, bridge.own_environment, bridge._root, settings.BUNDLED = kept


def check_options_of_every_run_become_words() -> None:
    flag = {"option": "resume", "type": "boolean"}
    words = [option_words(flag, value) for value in (True, "true", False, "no", None)]
    assert words == [["--resume"], ["--resume"], [], [], []], words
    crs = {"option": "assume_crs", "type": "crs"}
    assert option_words(crs, "EPSG:2154") == ["--assume-crs", "EPSG:2154"]
    assert option_words(crs, None) == []


def check_layers_are_loaded_in_colours() -> None:
    ctx = context()
    algorithm = provider.algorithm("surfacegrid").create()
    dtm = out("dtm.tif")
    details = QgsProcessingContext.LayerDetails("DTM", QgsProject.instance(), "SURFACE")
    ctx.addLayerToLoadOnCompletion(dtm, details)
    unmade = QgsProcessingContext.LayerDetails("Cut", QgsProject.instance(), "OTHER")
    other = out("of another step.tif")
    ctx.addLayerToLoadOnCompletion(other, unmade)
    feedback = Feedback()
    values = {"POINTS": CLOUD, "CELL": 2.0, "CLASSES": "2", "SURFACE": dtm, "METHOD": "mean"}
    results, ok = algorithm.run(values, ctx, feedback)
    assert ok, feedback.said
    assert results["SURFACE"] == dtm
    assert 0 < results["FILLED_SHARE"] <= 1
    assert feedback.percents[-1] == 100
    # in a model the list has the layers of all steps
    assert set(ctx.layersToLoadOnCompletion()) == {dtm, other}
    assert ctx.layerToLoadOnCompletionDetails(other).postProcessor() is None
    layer = QgsRasterLayer(dtm, "dtm")
    ctx.layerToLoadOnCompletionDetails(dtm).postProcessor().postProcessLayer(layer, ctx, feedback)
    items = layer.renderer().shader().rasterShaderFunction().colorRampItemList()
    assert [item.color.name() for item in items] == COLOURS["relief"]
    if layer.elevationProperties() is not None:
        assert layer.elevationProperties().isEnabled()
    shade = out("shade.tif")
    run("surface.hillshade", SURFACE=dtm, HILLSHADE=shade)
    layer = QgsRasterLayer(shade, "shade")
    styling.style(layer, COLOURS)
    assert type(layer.renderer()).__name__ == "QgsSingleBandGrayRenderer"
    layer = square()
    looks = [["critical", "Urgent", "#b2182b"]]
    styling.style(layer, COLOURS, {"classes": {"attribute": "severity", "looks": looks}})
    colours = {c.value(): c.symbol().color().name() for c in layer.renderer().categories()}
    assert colours == {"critical": "#b2182b", "low": COLOURS["other"][0]}


def check_legends_are_short_and_classes_have_their_names() -> None:
    """A legend said "z (max) minus z (linear)" and 124.875544; a land cover was a ramp."""
    dtm, cover = out("ends.tif"), out("cover.tif")
    run("surface.grid", POINTS=CLOUD, CELL=2.0, SURFACE=dtm)
    layer = QgsRasterLayer(dtm, "dtm")
    styling.style(layer, COLOURS)
    shown = layer.renderer().shader().rasterShaderFunction()
    low, high = shown.minimumValue(), shown.maximumValue()
    written = shown.legendSettings().numericFormat()
    assert 1 < high - low < 10, (low, high)
    assert written.numberDecimalPlaces() == 2
    assert styling._in_words("z (linear)") == "Elevation"
    assert styling._in_words("z (max) minus z (linear)") == "Difference of heights"
    assert styling._in_words("intensity (mean)") == "intensity (mean)"
    run("surface.land_cover", POINTS=CLOUD, COVER=cover)
    layer = QgsRasterLayer(cover, "cover")
    styling.style(layer, COLOURS)
    found = {c.value: (c.label, c.color.name()) for c in layer.renderer().classes()}
    names = {code: (label, colour) for code, label, colour in COLOURS["classification"]}
    assert found.keys() == {2, 6}, found
    assert all(found[code] == names[code] for code in found), found


def check_only_layers_of_the_declared_shapes_are_offered() -> None:
    def offered(id: str, name: str) -> list[int]:
        algorithm = provider.algorithm(id)
        return list(algorithm.parameterDefinition(name).dataTypes())

    assert offered("compareareas", "REFERENCE") == [QgsProcessing.SourceType.TypeVectorPolygon]
    assert offered("compareareas", "COVERAGE") == [QgsProcessing.SourceType.TypeVectorPolygon]
    assert offered("comparelines", "LINES") == [
        QgsProcessing.SourceType.TypeVectorLine,
        QgsProcessing.SourceType.TypeVectorPolygon,
    ]
    assert offered("comparesurfaces", "CHECKPOINTS") == [QgsProcessing.SourceType.TypeVectorPoint]
    assert offered("vectorsclip", "FEATURES") == [QgsProcessing.SourceType.TypeVectorAnyGeometry]


def check_a_few_bright_cells_do_not_darken_a_raster() -> None:
    place = out("bright.tif")
    made = gdal.GetDriverByName("GTiff").Create(place, 100, 100, 1, gdal.GDT_Float32)
    made.GetRasterBand(1).SetDescription("intensity (mean)")
    values = [30.0 + n % 450 for n in range(10000)]
    values[5000:5010] = [10062.0] * 10  # a tenth of a percent, as of a glass roof
    made.GetRasterBand(1).WriteRaster(0, 0, 100, 100, array("f", values).tobytes())
    made = None
    layer = QgsRasterLayer(place, "bright")
    styling.style(layer, COLOURS)
    stretch = layer.renderer().contrastEnhancement()
    assert 25 < stretch.minimumValue() < 50, stretch.minimumValue()
    assert 450 < stretch.maximumValue() < 500, stretch.maximumValue()


def check_features_hide_nothing_and_index_lines_have_their_height() -> None:
    layer = square()
    styling.style(layer, COLOURS)
    assert layer.renderer().symbol().symbolLayer(0).brushStyle() == Qt.BrushStyle.NoBrush
    seen = []
    town = provider.algorithm("modelsurbanclasses").tool["outputs"]
    fields = {"plain": {}} | {f["name"]: f for f in town}
    for name in ("plain", "outlines", "tree_crowns", "water_bodies"):
        styling.style(layer, COLOURS, fields[name])
        seen.append(layer.renderer().symbol().symbolLayer(0).strokeColor().name())
    assert seen == [styling.LINE, "#923a2c", "#215829", "#346592"], seen
    run("surface.grid", POINTS=CLOUD, CELL=2.0, SURFACE=out("slope.tif"))
    lines, labels = out("lines.gpkg"), out("heights.gpkg")
    run("surface.contours", SURFACE=out("slope.tif"), INTERVAL=0.5, CONTOURS=lines, LABELS=labels)
    fields = {f["name"]: f for f in provider.algorithm("surfacecontours").tool["outputs"]}
    layer = QgsVectorLayer(lines, "lines")
    styling.style(layer, COLOURS, fields["contours"])
    widths = {c.value(): c.symbol().width() for c in layer.renderer().categories()}
    assert widths[True] > 2 * widths[False], widths
    assert layer.labelsEnabled()
    text = QgsExpression(layer.labeling().settings().fieldName)
    for feature in layer.getFeatures():
        scope = QgsExpressionContext()
        scope.setFeature(feature)
        index = feature["is_index"]
        assert text.evaluate(scope) == (feature["elevation"] if index else None), index
    layer = QgsVectorLayer(labels, "heights")
    styling.style(layer, COLOURS, fields["labels"])
    assert layer.renderer().type() == "nullSymbol"
    assert layer.labeling().settings().fieldName == '"text"'


def check_what_is_told_of_results() -> None:
    """Numbers with their unit, where points are that are not shown, and no box left alone."""
    feedback, ctx, place = Feedback(), context(), out("kept of a run.laz")
    provider_there = "pdal" in QgsProviderRegistry.instance().providerList()
    run("points.filter", feedback, POINTS=CLOUD, WHERE="intensity > 500", KEPT=place)
    assert any(re.fullmatch(r"Removed share: [\d.]+ %", text) for text in feedback.said)
    assert provider_there or any(f"written to {place}" in text for text in feedback.said)
    model = provider.algorithm("modelsterrain").create()
    values = {d.name(): d.defaultValue() for d in model.parameterDefinitions()}
    values = {name: value for name, value in values.items() if value is not None}
    feedback, dtm = Feedback(), out("untouched.tif")
    details = QgsProcessingContext.LayerDetails("Terrain (DTM)", QgsProject.instance(), "DTM")
    ctx.addLayerToLoadOnCompletion(dtm, details)
    _, ok = model.run(values | {"POINTS": CLOUD, "CELL": 2.0, "DTM": dtm}, ctx, feedback)
    assert ok, feedback.said
    assert {"INTERVAL", "CONTOUR_LENGTH"} <= values.keys()
    assert not any("is not used" in text for text in feedback.said), feedback.said
    assert ctx.layerToLoadOnCompletionDetails(dtm).name == "Terrain (DTM): punkte"
    feedback = Feedback()
    run("models.terrain", feedback, POINTS=CLOUD, CELL=2.0, INTERVAL=0.3, DTM=dtm)
    assert any("interval: is not used" in text for text in feedback.said), feedback.said
    told = model.in_words_of_the_dialog("contour_length: is not used; give `cell`, as x_y.laz")
    assert told == "“Contour length”: is not used; give “Cell size”, as x_y.laz", told
    told = model.in_words_of_the_dialog("name it (water_classes) or run shoreline.water_level")
    assert told == "name it (“Water classes”) or run “Water levels”", "of a step, and of a tool"
    kept = "see /data/points.denoise/a.laz, lake.gpkg and point_source_id"
    assert model.in_words_of_the_dialog(kept) == kept


def check_a_layer_that_was_not_written_is_not_loaded() -> None:
    program, dtm = FOLDER / "idle python", out("never made.tif")
    result = json.dumps({"event": "result", "outputs": {}})
    program.write_text(f"#!/bin/sh\necho '{result}'\n")
    program.chmod(0o755)
    ctx = context()
    for place in (dtm, out("of somebody.tif")):
        details = QgsProcessingContext.LayerDetails("DTM", QgsProject.instance(), "SURFACE")
        ctx.addLayerToLoadOnCompletion(place, details)
    os.environ[bridge.PYTHON] = str(program)
    try:
        values = {"POINTS": CLOUD, "SURFACE": dtm}
        _, ok = provider.algorithm("surfacegrid").create().run(values, ctx, Feedback())
    finally:
        del os.environ[bridge.PYTHON]
    assert ok
    assert list(ctx.layersToLoadOnCompletion()) == [out("of somebody.tif")]


def check_a_tool_of_each_group_and_all_kinds_of_output() -> None:
    done: set[str] = set()

    def go(tool: str, **values: object) -> dict[str, object]:
        made = run(tool, **values)
        for name, value in values.items():
            if isinstance(value, str) and "ergebnis" in value and name in made:
                assert os.path.exists(value), (tool, name)
                assert made[name] == value, (tool, name, made)
        done.add(tool.partition(".")[0])
        return made

    go("samples.scene", SIZE=40.0, DENSITY=2.0, POINTS=out("scene.laz"))
    ground = out("ground.laz")
    go("ground.classify", POINTS=CLOUD, CLASSIFIED=ground)
    made = go(
        "compare.classes",
        POINTS=ground,
        REFERENCE=CLOUD,
        TABLE=out("t.gpkg"),
        CONFUSION=out("c.csv"),
        PAGE=out("p.html"),
        COUNTS=out("n.csv"),
        PICTURE=out("p.png"),
    )
    assert 0 <= made["TYPE_1"] <= 100
    assert QgsVectorLayer(made["TABLE"]).featureCount() > 3
    assert {"PAGE", "COUNTS", "PICTURE"} <= made.keys()
    assert os.path.getsize(made["PAGE"]) > 1000
    made = go("points.info", POINTS=CLOUD, TABLE=out("i.csv"), PICTURE=out("i.png"))
    assert "PICTURE" not in made  # there is nothing to draw
    go("features.local", POINTS=CLOUD, DESCRIBED=out("f.laz"), FEATURES=["planarity", "nz"])
    go("planes.fit", POINTS=CLOUD, MAX_DISTANCE=0.2)
    layer = square()
    QgsProject.instance().addMapLayer(layer)
    go("points.clip", POINTS=CLOUD, POLYGONS=layer.id(), CLIPPED=out("k.laz"))
    go("points.merge", POINTS=[CLOUD], MERGED=out("m.laz"))
    go(
        "surface.grid",
        POINTS=CLOUD,
        SURFACE=out("s.tif"),
        CELL=2.0,
        METHOD="max",
        TILE="30",
        WORKERS=1,
        RESUME=True,
    )
    projected = out("projected.gpkg")
    go("vectors.reproject", FEATURES=layer.id(), CRS="EPSG:32636", REPROJECTED=projected)
    go("surface.contours", SURFACE=out("s.tif"), INTERVAL=0.5, CONTOURS=out("c.gpkg"))
    go(
        "shoreline.alpha_shape",
        POINTS=CLOUD,
        ALPHA="auto",
        SHAPES=out("a.gpkg"),
        OUTLINES=out("a.dxf"),
    )
    go("classify.urban", POINTS=CLOUD, CLASSIFIED=out("u.laz"))
    wire = FOLDER / "wire.xyz"  # states no CRS
    arc = [(x, 20 + 400 * (math.cosh((x - 40) / 400) - 1)) for x in range(80)]
    wire.write_text("".join(f"{500000 + x} 4500000 {z:.3f}\n" for x, z in arc))
    made = go("corridor.catenaries", POINTS=str(wire), ASSUME_CRS="EPSG:32635", WIRES=out("w.gpkg"))
    assert QgsVectorLayer(made["WIRES"]).crs().authid() == "EPSG:32635"
    groups = {tool["id"].partition(".")[0] for tool in provider.listed["tools"]} - {"models"}
    assert groups - done == set(), "run a tool of this group too"


def check_shipped_models_run() -> None:
    made = run("models.terrain", POINTS=CLOUD, CELL=2.0, DTM=out("m_dtm.tif"), NDSM=out("n.tif"))
    assert set(made) >= {"DTM", "NDSM"}
    assert QgsRasterLayer(made["NDSM"], "n").isValid()
    made = run("models.urban_classes", POINTS=CLOUD, WATER=False, CLASSIFIED=out("mu.laz"))
    assert os.path.getsize(made["CLASSIFIED"]) > 1000


def check_nothing_is_asked_for_that_a_model_cannot_make() -> None:
    """The dialog asks for all results of a model, into temporary files."""
    all_of_it = dict.fromkeys(("DTM", "WATER_BODIES", "INTENSITY"), QgsProcessing.TEMPORARY_OUTPUT)
    feedback = Feedback()
    made = run("models.terrain", feedback, POINTS=CLOUD, CELL=2.0, IMAGE=False, **all_of_it)
    assert set(made) >= {"DTM"}
    assert not set(made) & {"WATER_BODIES", "INTENSITY"}, made
    assert not [text for text in feedback.said if "nothing to write" in text], feedback.said
    own = {"INTENSITY": out("no intensity.tif")}  # which the user has asked for
    run("models.terrain", feedback, POINTS=CLOUD, CELL=2.0, IMAGE=False, **own)
    assert [text for text in feedback.said if "nothing to write" in text], feedback.said


def check_a_set_is_handed_over_and_its_layers_are_loaded() -> None:
    """Once from the folder, and not besides from a temporary file; an own file is loaded itself."""
    folder, ctx, feedback = out("set"), context(), Feedback()
    values = {"POINTS": CLOUD, "CELL": 2.0, "DELIVER": folder, "DSM": out("own dsm.tif")}
    values |= {"DTM": QgsProcessing.TEMPORARY_OUTPUT, "LEVEL_WATER": False}
    results, ok = provider.algorithm("modelsterrain").create().run(values, ctx, feedback)
    assert ok, feedback.said
    assert results["DELIVER"] == folder
    assert Path(results["DELIVER_README"]).read_text("utf-8").startswith("Terrain")
    page = Path(folder, "report.html").read_text("utf-8")
    record = json.loads(page.partition('id="provenance">')[2].partition("</script>")[0])
    assert record["parameters"]["level_water"] is False, "its box was not ticked"
    assert results["DTM"] == os.path.join(folder, "dtm.tif")
    loads = [path.replace(folder, "SET") for path in ctx.layersToLoadOnCompletion()]
    assert sorted(Path(path).name for path in loads if path.endswith("dtm.tif")) == ["dtm.tif"]
    assert {"SET/hillshade.tif", "SET/contours.gpkg|layername=contours"} <= set(loads), loads
    assert "SET/contours.gpkg|layername=labels" not in loads, "it would be empty"
    assert "SET/dsm.tif" not in loads, "the same as the own file"
    path = os.path.join(folder, "contours.gpkg|layername=contours")
    layer = QgsVectorLayer(path, "contours")  # in any QGIS, without the plugin
    widths = {str(c.value()): c.symbol().width() for c in layer.renderer().categories()}
    assert widths == {"true": styling.HEAVY, "false": styling.THIN}, widths
    assert styling.has_style_inside(layer)
    assert layer.labelsEnabled()
    assert _count_layers(os.path.join(folder, "contours.gpkg")) == 1
    assert not [text for text in feedback.said if "earlier set" in text], "there was none"
    _, ok = provider.algorithm("modelsterrain").create().run(values, context(), feedback)
    assert ok, feedback.said
    assert [text for text in feedback.said if "earlier set" in text], "it is replaced"
    for path, details in ctx.layersToLoadOnCompletion().items():
        assert details.postProcessor() is not None, path
        layer = QgsProcessingUtils.mapLayerFromString(path, ctx)
        assert layer is not None, path
        assert layer.isValid(), path
        details.postProcessor().postProcessLayer(layer, ctx, feedback)
        if path.endswith("contours.gpkg|layername=contours"):
            loaded = {str(c.value()): c.symbol().width() for c in layer.renderer().categories()}
            assert loaded == widths, loaded


def check_a_set_is_handed_over_whole_or_not_at_all() -> None:
    """Cancelled at any time, or refused, there is no folder, and no file in one that was there."""
    for percent in (5, 60, 95):
        feedback, folder = Feedback(), out(f"cancelled set {percent}")
        feedback.progressChanged.connect(
            lambda now, feedback=feedback, percent=percent: now > percent and feedback.cancel()
        )
        values = {"POINTS": CLOUD, "CELL": 0.5, "DELIVER": folder}
        _, ok = provider.algorithm("modelsterrain").create().run(values, context(), feedback)
        whole = os.path.isfile(os.path.join(folder, "README.txt"))  # cancelled too late
        assert ok == whole == os.path.exists(folder), percent
        assert percent == 95 or not whole
    nowhere = os.path.join(out("no folder"), "set")
    feedback = Feedback()
    values = {"POINTS": CLOUD, "DELIVER": nowhere}
    _, ok = provider.algorithm("modelsterrain").create().run(values, context(), feedback)
    assert not ok
    assert "there is no folder" in "".join(feedback.said)


def check_dialogs_speak_the_language_of_qgis() -> None:
    """Titles, labels and words are Turkish; names, values and results are as in English."""
    plain, other = out("plain.csv"), out("türkçe.csv")
    run("points.info", POINTS=CLOUD, TABLE=plain)
    assert language.chosen() == "en"
    os.environ[language.VARIABLE] = "tr_TR.UTF-8"
    for cached in (language.chosen, language._texts):
        cached.cache_clear()
    try:
        turkish = Provider()
        turkish.refreshAlgorithms()
        grid = turkish.algorithm("surfacegrid").create()
        assert grid.displayName() == "Noktaları raster olarak gridle"
        assert grid.parameterDefinition("CELL").description() == "Hücre boyutu"
        assert grid.parameterDefinition("METHOD").shown[0] == "Doğrusal (TIN)"
        assert grid.parameterDefinition("METHOD").options()[0] == "linear"
        assert "Girdi parametreleri" in grid.shortHelpString()
        assert grid.helpUrl().endswith("surface.grid.tr.html")
        assert bridge.clean_environment()[language.VARIABLE] == "tr"
        assert "bellek" in bridge._ended(-9)
        info = turkish.algorithm("pointsinfo").create()
        _, ok = info.run({"POINTS": CLOUD, "TABLE": other}, context(), Feedback())
        assert ok
    finally:
        del os.environ[language.VARIABLE]
        for cached in (language.chosen, language._texts):
            cached.cache_clear()
    assert Path(other).read_bytes() == Path(plain).read_bytes(), "points in decimals, not commas"


class Signal:
    """As much of a signal of Qt as is used."""

    def __init__(self) -> None:
        self.connected: list[Callable[[int], None]] = []

    def connect(self, call: Callable[[int], None]) -> None:
        self.connected.append(call)


class Points:
    """A layer of points as QGIS with PDAL has it: its attributes are known once it is indexed."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.indexGenerationStateChanged = Signal()
        self.renderers: list[object] = []

    def dataProvider(self) -> Points:
        return self

    def attributes(self) -> QgsPointCloudAttributeCollection:
        kind = QgsPointCloudAttribute.DataType.Char
        return QgsPointCloudAttributeCollection(
            [QgsPointCloudAttribute(name, kind) for name in self.names]
        )

    def type(self) -> object:
        return QgsMapLayerType.PointCloudLayer

    def setRenderer(self, renderer: object) -> None:
        self.renderers.append(renderer)

    def triggerRepaint(self) -> None:
        pass


def check_points_are_coloured_once_they_are_indexed() -> None:
    """A stand-in, as no QGIS of Debian has PDAL."""
    layer = Points()
    styling.style(layer, COLOURS)
    (call,) = layer.indexGenerationStateChanged.connected
    call(1)  # begun
    assert layer.renderers == []
    layer.names = ["X", "Intensity", "Classification"]
    call(2)
    (renderer,) = layer.renderers
    assert (renderer.type(), renderer.attribute()) == ("classified", "Classification")
    assert len(renderer.categories()) > 10
    assert len(layer.indexGenerationStateChanged.connected) == 1


def check_copc_is_loaded_at_once_where_qgis_opens_it() -> None:
    ctx, made, plain = context(), out("kept.copc.laz"), out("kept.laz")
    for path in (made, plain):
        place = QgsProcessingOutputLayerDefinition(path, QgsProject.instance())
        values = {"POINTS": CLOUD, "KEPT": place}
        _, ok = provider.algorithm("pointsfilter").create().run(values, ctx, Feedback())
        assert ok
    providers = QgsProviderRegistry.instance().providerList()
    loads = ctx.layersToLoadOnCompletion()
    assert (made in loads) == ("copc" in providers and parameters.POINTS_AS_LAYERS), providers
    assert (plain in loads) == ("pdal" in providers)
    if made in loads:
        layer = QgsProcessingUtils.mapLayerFromString(made, ctx)
        loads[made].postProcessor().postProcessLayer(layer, ctx, Feedback())
        assert layer.renderer().type() == "classified"


def check_several_results_of_a_repeated_step_go_to_a_folder() -> None:
    model = FOLDER / "pyramid.yaml"
    model.write_text(
        "id: my.pyramid\ntitle: P\ninputs:\n  points: {type: PointCloud, help: P}\nsteps:\n"
        "  grid: {tool: surface.grid, repeat: cell, cell: [2, 5], points: {from: inputs.points}}\n"
        "outputs:\n  dtm: {from: grid.surface}\n  share: {from: grid.filled_share}\n"
    )
    points = field("pointcloud", name="points", required=True)
    many = {"help": "h", "many": True}
    dtm = many | {"name": "dtm", "label": "DTM", "type": "raster", "suffixes": [".tif"]}
    share = many | {"name": "share", "label": "Share", "type": "number"}
    tool = {"id": str(model), "algorithm": "p", "title": "P", "inputs": [points]}
    tool["outputs"] = [dtm, share]
    algorithm, feedback = ToolAlgorithm(tool, COLOURS).create(), Feedback()
    values = {"POINTS": CLOUD, "DTM": out("folder")}
    results, ok = algorithm.run(values, context(), feedback)
    assert ok, feedback.said
    assert results["DTM"] == out("folder")
    assert [os.path.basename(path) for path in results["DTM_FILES"]] == ["dtm_1.tif", "dtm_2.tif"]
    assert all(os.path.dirname(path) == out("folder") for path in results["DTM_FILES"])
    assert len(results["SHARE"].split("; ")) == 2


def check_cancel_stops_within_a_second() -> None:
    feedback = Feedback()
    asked: list[float] = []

    def stop() -> None:
        time.sleep(2.5)
        asked.append(time.monotonic())
        feedback.cancel()

    threading.Thread(target=stop).start()
    algorithm = provider.algorithm("samplesscene").create()
    result = out("cancelled.laz")
    values = {"KIND": "town", "DENSITY": 100.0, "POINTS": result}
    _, ok = algorithm.run(values, context(), feedback)
    took = time.monotonic() - asked[0]
    assert not ok
    assert "Cancelled." in "".join(feedback.said)
    assert took < 2.0, took  # the machine of the tests may be busy
    assert not os.path.exists(result)


def check_the_environment_of_the_child_is_clean() -> None:
    os.environ.update({"PYTHONHOME": "/x", "PROJ_LIB": "/x", "QT_PLUGIN_PATH": "/x", "OURS": "1"})
    os.environ["GDAL_NUM_THREADS"] = "2"
    env = bridge.clean_environment()
    for name in ("PYTHONHOME", "PROJ_LIB", "QT_PLUGIN_PATH"):
        del os.environ[name]
        assert name not in env
    assert (env["OURS"], env["GDAL_NUM_THREADS"]) == ("1", "2")
    assert (env["PYTHONNOUSERSITE"], env["PYTHONSAFEPATH"]) == ("1", "1")
    elsewhere = FOLDER / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "toolbox.py").write_text("raise SystemExit('the wrong toolbox')")
    here = os.getcwd()
    os.chdir(elsewhere)
    try:
        assert bridge.said(bridge.command("-c", bridge.CHECK)).startswith("lidar-toolbox ")
    finally:
        os.chdir(here)


def main() -> None:
    found = {}
    for name, check in list(globals().items()):
        if name.startswith("check_") and (not ONLY or name in ONLY):
            began = time.monotonic()
            try:
                check()
                found[name] = ""
            except BaseException:
                found[name] = traceback.format_exc()
            print(f"{name}: {time.monotonic() - began:.1f} s", file=sys.stderr)
    print("\nRESULT " + json.dumps(found), flush=True)
    os._exit(0)  # what QGIS does at the end is not ours to test


main()
