"""Sets the colours of results when they are loaded.

The output of a tool may declare the attribute by which points or features are coloured, or the one
colour of features that are all of one kind. Otherwise a point cloud is drawn by its classes, a
raster as relief, as differences about zero or in grey, by the description of its band, and features
as outlines that hide nothing below.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

from qgis.core import (
    QgsBasicNumericFormat,
    QgsCategorizedSymbolRenderer,
    QgsColorRampLegendNodeSettings,
    QgsColorRampShader,
    QgsContrastEnhancement,
    QgsFillSymbol,
    QgsLabeling,
    QgsLineSymbol,
    QgsMapLayerLegendUtils,
    QgsMapLayerType,
    QgsMarkerSymbol,
    QgsMessageLog,
    QgsNullSymbolRenderer,
    QgsPalettedRasterRenderer,
    QgsPalLayerSettings,
    QgsProcessingLayerPostProcessorInterface,
    QgsProperty,
    QgsRasterBandStats,
    QgsRasterShader,
    QgsRendererCategory,
    QgsSingleBandGrayRenderer,
    QgsSingleBandPseudoColorRenderer,
    QgsSingleSymbolRenderer,
    QgsSymbol,
    QgsTextBufferSettings,
    QgsTextFormat,
    QgsVectorLayerSimpleLabeling,
    QgsWkbTypes,
)
from qgis.PyQt.QtGui import QColor

from . import columns, language

SAMPLE = 250000  # cells that statistics are taken of
OUTERMOST = 0.005  # share of cells at either end that would fade all others, as in our plots
BLUE_RED = ("#2166ac", "#92c5de", "#f7f7f7", "#f4a582", "#b2182b")
VIRIDIS = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")
OF_GEOMETRY = {  # names of settings
    QgsWkbTypes.GeometryType.PointGeometry: "VECTOR_POINT_STYLE",
    QgsWkbTypes.GeometryType.LineGeometry: "VECTOR_LINE_STYLE",
    QgsWkbTypes.GeometryType.PolygonGeometry: "VECTOR_POLYGON_STYLE",
}
OF_Z = re.compile(r"\bz \(\w+\)")  # heights and how they were gridded
MOST = 20  # distinct values of such an attribute
LINE, THIN, HEAVY, DOT = "#1f3a5f", 0.15, 0.5, 2.0  # colour as in our plots; millimetres
TEXT, EDGE = 7.0, 0.7  # points, and millimetres around letters
PLAIN: Mapping[str, Any] = MappingProxyType({})  # says nothing of colours


class Styler(QgsProcessingLayerPostProcessorInterface):
    """Sets the colours of a layer after it was loaded, and its place in the tree.

    One that is hidden is in the project, but not drawn until it is switched on, see `tree.arrange`.
    """

    _kept: ClassVar[list[Any]] = []  # QGIS holds a bare pointer only

    @classmethod
    def of(cls, colours: dict[str, Any], field: dict[str, Any], output: tuple[str, str]) -> Styler:
        made = cls()
        made.colours, made.field, made.output = colours, field, output
        made.hidden, made.group, made.rank = False, None, 0
        cls._kept.append(made)
        return made

    def postProcessLayer(self, layer: Any, context: Any, feedback: Any) -> None:
        root = context.project() and context.project().layerTreeRoot()
        node = root and root.findLayer(layer)
        if node and self.group:
            node = self.group.take(node, self.rank, root)
        if node and layer.type() == QgsMapLayerType.RasterLayer:  # which says "Band 1: ... (Gray)"
            QgsMapLayerLegendUtils.setLegendNodeUserLabel(node, 0, _in_words(_band(layer)))
        try:
            if not has_style_of_user(layer, *self.output):
                if has_style_inside(layer):
                    layer.loadDefaultStyle()  # QGIS does not, of results of a tool
                else:
                    style(layer, self.colours, self.field)
                if layer.type() == QgsMapLayerType.VectorLayer:
                    columns.name(layer, self.colours["columns"] | self.field.get("columns", {}))
        except Exception as err:  # a layer in plain colours is better than none
            QgsMessageLog.logMessage(f"{layer.name()} keeps its colours: {err}", "LiDAR Toolbox")
        if node:
            node.setItemVisibilityChecked(not self.hidden)
            node.setExpanded(not self.hidden)


def has_style_inside(layer: Any) -> bool:
    """Whether the file of a layer holds a style for it, as a GeoPackage of a set does."""
    return layer.type() == QgsMapLayerType.VectorLayer and layer.listStylesInDatabase()[0] > 0


def has_style_of_user(layer: Any, algorithm: str, output: str) -> bool:
    """Whether QGIS has given the layer a style that the user has chosen, which stays.

    That is a style file beside the data, one for this output (of the tool, or of a model by the
    name that it gives the layer), or one for all results of the kind of layer.
    """
    if os.path.isfile(layer.styleURI()):
        return True
    try:
        from processing.core.ProcessingConfig import ProcessingConfig
        from processing.gui.RenderingStyles import RenderingStyles
    except ImportError:  # QGIS without its Processing plugin has no such choice
        return False
    ours = f"{algorithm.partition(':')[0]}:"
    for chosen, outputs in RenderingStyles.styles.items():
        if chosen == algorithm and output in outputs:
            return True
        names = {name.rpartition(":")[2] for name in outputs}
        if not chosen.startswith(ours) and {output, layer.name()} & names:  # of a model
            return True
    usual = {QgsMapLayerType.RasterLayer: "RASTER_STYLE"}
    if layer.type() == QgsMapLayerType.VectorLayer:
        usual[layer.type()] = OF_GEOMETRY.get(layer.geometryType(), "")
    setting = getattr(ProcessingConfig, usual.get(layer.type(), ""), None)
    return bool(setting and ProcessingConfig.getSetting(setting))


def style(layer: Any, colours: dict[str, Any], field: Mapping[str, Any] = PLAIN) -> None:
    """Give a layer its colours; the field of the output says how the tool declares them."""
    classes = field.get("classes")
    if layer.type() == QgsMapLayerType.RasterLayer:
        _style_raster(layer, colours)
    elif layer.type() == QgsMapLayerType.VectorLayer:
        if classes:
            _style_features(layer, colours, classes)
        elif "isolines" in field:
            _style_isolines(layer, **field["isolines"])
        elif "texts" in field:
            _style_texts(layer, **field["texts"])
        else:
            _style_plainly(layer, field.get("colour", LINE))
    elif layer.type() == QgsMapLayerType.PointCloudLayer:
        _style_points(layer, colours, classes)
    layer.triggerRepaint()


def _style_raster(layer: Any, colours: dict[str, Any]) -> None:
    if layer.dataProvider().colorTable(1):
        _palette(layer, colours["classification"])
        return
    name, words = _band(layer).lower(), colours["bands"]
    stats = layer.dataProvider().bandStatistics(
        1,
        QgsRasterBandStats.Stats.Min | QgsRasterBandStats.Stats.Max,
        layer.extent(),
        SAMPLE,
    )
    low, high = layer.dataProvider().cumulativeCut(
        1, OUTERMOST, 1 - OUTERMOST, layer.extent(), SAMPLE
    )
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        low, high = stats.minimumValue, stats.maximumValue  # nearly all cells are alike
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        return
    if any(word in name for word in words["grey"]):
        _grey(layer, low, high)
        return
    changes = any(word in name for word in words["changes"])
    if changes or (" minus " in name and -low > high / 20):
        far = max(-low, high)
        _ramp(layer, BLUE_RED, -far, far)
        return
    attribute, bracket, _ = name.partition(" (")  # as gridded attributes are named: "z (linear)"
    named = not bracket or attribute == "z" or "height" in attribute or "elevation" in attribute
    height = named and layer.bandCount() <= 4
    height = height and not any(word in name for word in words["no_heights"])
    _ramp(layer, colours["relief"] if height else VIRIDIS, low, high)
    if height and layer.elevationProperties() is not None:  # QGIS 3.24: for profiles and 3D
        layer.elevationProperties().setEnabled(True)


def _palette(layer: Any, looks: Any) -> None:
    """The colours of the file for the values that are there, with the names of our classes."""
    names = {code: label for code, label, _ in looks}
    provider, palette = layer.dataProvider(), QgsPalettedRasterRenderer
    there = {int(one.value) for one in palette.classDataFromRaster(provider, 1)}
    classes = [
        palette.Class(int(one.value), one.color, names.get(int(one.value), one.label))
        for one in provider.colorTable(1)
        if int(one.value) in there
    ]
    layer.setRenderer(palette(provider, 1, classes))


def _legend(low: float, high: float) -> Any:
    """How a legend writes the ends of a range: with three digits that tell something."""
    written, settings = QgsBasicNumericFormat(), QgsColorRampLegendNodeSettings()
    written.setNumberDecimalPlaces(max(0, 2 - math.floor(math.log10(high - low))))
    written.setShowThousandsSeparator(False)
    settings.setNumericFormat(written)
    return settings


def _band(layer: Any) -> str:
    """The description of the first band, without the number that QGIS puts before it."""
    return str(layer.bandName(1).partition(": ")[2])


def _in_words(band: str) -> str:
    """The description of a band for a legend: of heights not how their cells were made."""
    words = {"z": language.text("Elevation"), "z minus z": language.text("Difference of heights")}
    return words.get(OF_Z.sub("z", band), band)


def _grey(layer: Any, low: float, high: float) -> None:
    renderer = QgsSingleBandGrayRenderer(layer.dataProvider(), 1)
    stretch = QgsContrastEnhancement(layer.dataProvider().dataType(1))
    stretch.setContrastEnhancementAlgorithm(
        QgsContrastEnhancement.ContrastEnhancementAlgorithm.StretchToMinimumMaximum
    )
    stretch.setMinimumValue(low)
    stretch.setMaximumValue(high)
    renderer.setContrastEnhancement(stretch)
    renderer.setLegendSettings(_legend(low, high))
    layer.setRenderer(renderer)


def _ramp(layer: Any, colours: Any, low: float, high: float) -> None:
    """Colours in equal steps from low to high."""
    step = (high - low) / (len(colours) - 1)
    shown = QgsColorRampShader(low, high)
    shown.setColorRampType(QgsColorRampShader.Type.Interpolated)
    shown.setLegendSettings(_legend(low, high))
    shown.setColorRampItemList(
        [
            QgsColorRampShader.ColorRampItem(
                low + i * step, QColor(colour), f"{low + i * step:.4g}"
            )
            for i, colour in enumerate(colours)
        ]
    )
    shader = QgsRasterShader(low, high)
    shader.setRasterShaderFunction(shown)
    renderer = QgsSingleBandPseudoColorRenderer(layer.dataProvider(), 1, shader)
    renderer.setClassificationMin(low)
    renderer.setClassificationMax(high)
    layer.setRenderer(renderer)


def _style_features(layer: Any, colours: dict[str, Any], classes: dict[str, Any]) -> None:
    if not layer.isSpatial():
        return
    name = classes["attribute"]
    if layer.fields().indexOf(name) < 0:
        return
    values = sorted(layer.uniqueValues(layer.fields().indexOf(name), MOST + 1), key=str)
    values = [value for value in values if value is not None and str(value) != "NULL"]
    if not 0 < len(values) <= MOST:
        return
    known = {value: look for value, *look in classes["looks"]}
    others = iter(list(colours["other"]) * 3)
    categories = []
    for value in values:
        label, colour = known.get(value) or (str(value), next(others))
        symbol = QgsSymbol.defaultSymbol(layer.geometryType())
        symbol.setColor(QColor(colour))
        categories.append(QgsRendererCategory(value, symbol, label))
    layer.setRenderer(QgsCategorizedSymbolRenderer(name, categories))


def _style_plainly(layer: Any, colour: str) -> None:
    """Lines, and polygons without a filling, which would hide what is below."""
    kind = layer.geometryType()
    if kind == QgsWkbTypes.GeometryType.PolygonGeometry:
        looks = {"style": "no", "outline_color": colour, "outline_width": str(HEAVY)}
        layer.setRenderer(QgsSingleSymbolRenderer(QgsFillSymbol.createSimple(looks)))
    elif kind == QgsWkbTypes.GeometryType.LineGeometry:
        layer.setRenderer(QgsSingleSymbolRenderer(_line(HEAVY, colour)))
    elif colour != LINE:
        looks = {"color": colour, "size": str(DOT)}
        layer.setRenderer(QgsSingleSymbolRenderer(QgsMarkerSymbol.createSimple(looks)))


def _line(width: float, colour: str = LINE) -> Any:
    return QgsLineSymbol.createSimple({"color": colour, "width": str(width)})


def _style_isolines(layer: Any, attribute: str, heavy: str) -> None:
    """Heavy lines with their number along them, and thin ones between."""
    categories = [
        QgsRendererCategory(True, _line(HEAVY), language.text("Index lines")),
        QgsRendererCategory(False, _line(THIN), language.text("Lines between")),
    ]
    layer.setRenderer(QgsCategorizedSymbolRenderer(heavy, categories))
    text = f'CASE WHEN "{heavy}" THEN round("{attribute}", 3) END'
    settings = _labels(text)
    settings.placement = QgsPalLayerSettings.Placement.Line
    settings.lineSettings().setPlacementFlags(QgsLabeling.LinePlacementFlag.OnLine)
    _label(layer, settings)


def _style_texts(layer: Any, text: str, angle: str) -> None:
    """Texts at their angle instead of dots."""
    layer.setRenderer(QgsNullSymbolRenderer())
    settings = _labels(f'"{text}"')
    settings.placement = QgsPalLayerSettings.Placement.OverPoint
    turned = QgsProperty.fromExpression(f'-"{angle}"')  # QGIS turns clockwise
    settings.dataDefinedProperties().setProperty(QgsPalLayerSettings.Property.LabelRotation, turned)
    _label(layer, settings)


def _labels(expression: str) -> Any:
    """Small texts with a light edge, from an expression."""
    settings = QgsPalLayerSettings()
    settings.fieldName, settings.isExpression = expression, True
    shown, edge = QgsTextFormat(), QgsTextBufferSettings()
    shown.setSize(TEXT)
    shown.setColor(QColor(LINE))
    edge.setEnabled(True)
    edge.setSize(EDGE)
    shown.setBuffer(edge)
    settings.setFormat(shown)
    return settings


def _label(layer: Any, settings: Any) -> None:
    layer.setLabeling(QgsVectorLayerSimpleLabeling(settings))
    layer.setLabelsEnabled(True)


def _style_points(layer: Any, colours: dict[str, Any], classes: dict[str, Any] | None) -> None:
    """By the attribute that the output names, else by the classes.

    QGIS first makes an index of a LAZ in the background, and knows no attributes until then.
    """
    from qgis.core import QgsPointCloudCategory, QgsPointCloudClassifiedRenderer

    names = {a.name().lower(): a.name() for a in layer.attributes().attributes()}
    if not names:
        signal = layer.dataProvider().indexGenerationStateChanged
        signal.connect(lambda state: _style_once_indexed(layer, colours, classes))
        return
    usual = {"attribute": "classification", "looks": colours["classification"]}
    for shown in (classes or usual, usual):
        if shown["attribute"].lower() in names:
            looks = shown["looks"]
            made = [QgsPointCloudCategory(code, QColor(c), label) for code, label, c in looks]
            name = names[shown["attribute"].lower()]
            renderer = QgsPointCloudClassifiedRenderer()  # that of 3.22 takes nothing here
            renderer.setAttribute(name)
            renderer.setCategories(made)
            layer.setRenderer(renderer)
            return


def _style_once_indexed(layer: Any, colours: Any, classes: Any) -> None:
    if layer.attributes().attributes():
        _style_points(layer, colours, classes)
        layer.triggerRepaint()
