"""Sets the colours of results when they are loaded.

The output of a tool may declare the attribute by which points or features are coloured. Otherwise a
point cloud is drawn by its classes, and a raster as relief, as differences about zero or in grey,
by the description of its band.
"""

from __future__ import annotations

import math
import os
from typing import Any, ClassVar

from qgis.core import (
    QgsCategorizedSymbolRenderer,
    QgsColorRampShader,
    QgsContrastEnhancement,
    QgsMapLayerType,
    QgsMessageLog,
    QgsProcessingLayerPostProcessorInterface,
    QgsRasterBandStats,
    QgsRasterShader,
    QgsRendererCategory,
    QgsSingleBandGrayRenderer,
    QgsSingleBandPseudoColorRenderer,
    QgsSymbol,
    QgsWkbTypes,
)
from qgis.PyQt.QtGui import QColor

SAMPLE = 250000  # cells that statistics are taken of
GREY = ("hillshade", "intensity")
NO_HEIGHT = ("(std)", "(count)", "points", "distance", "error")
ABOUT_ZERO = ("differ", "change")
BLUE_RED = ("#2166ac", "#92c5de", "#f7f7f7", "#f4a582", "#b2182b")
VIRIDIS = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")
OF_GEOMETRY = {  # names of settings
    QgsWkbTypes.GeometryType.PointGeometry: "VECTOR_POINT_STYLE",
    QgsWkbTypes.GeometryType.LineGeometry: "VECTOR_LINE_STYLE",
    QgsWkbTypes.GeometryType.PolygonGeometry: "VECTOR_POLYGON_STYLE",
}
MOST = 20  # distinct values of such an attribute


class Styler(QgsProcessingLayerPostProcessorInterface):
    """Sets the colours of a layer after it was loaded.

    One that is hidden is in the project, but not drawn until it is switched on.
    """

    _kept: ClassVar[list[Any]] = []  # QGIS holds a bare pointer only

    @classmethod
    def of(
        cls, colours: dict[str, Any], classes: dict[str, Any] | None, output: tuple[str, str]
    ) -> Styler:
        made = cls()
        made.colours, made.classes, made.output = colours, classes, output
        made.hidden = False
        cls._kept.append(made)
        return made

    def postProcessLayer(self, layer: Any, context: Any, feedback: Any) -> None:
        try:
            if not has_style_of_user(layer, *self.output):
                style(layer, self.colours, self.classes)
        except Exception as err:  # a layer in plain colours is better than none
            QgsMessageLog.logMessage(f"{layer.name()} keeps its colours: {err}", "LiDAR Toolbox")
        tree = context.project().layerTreeRoot() if self.hidden and context.project() else None
        if node := tree and tree.findLayer(layer):
            node.setItemVisibilityChecked(False)


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


def style(layer: Any, colours: dict[str, Any], classes: dict[str, Any] | None = None) -> None:
    """Give a layer its colours; `classes` are those that the output of the tool declares."""
    if layer.type() == QgsMapLayerType.RasterLayer:
        _style_raster(layer, colours)
    elif layer.type() == QgsMapLayerType.VectorLayer:
        _style_features(layer, colours, classes)
    elif layer.type() == QgsMapLayerType.PointCloudLayer:
        _style_points(layer, colours, classes)
    layer.triggerRepaint()


def _style_raster(layer: Any, colours: dict[str, Any]) -> None:
    name = layer.bandName(1).partition(": ")[2].lower()
    stats = layer.dataProvider().bandStatistics(
        1,
        QgsRasterBandStats.Stats.Min
        | QgsRasterBandStats.Stats.Max
        | QgsRasterBandStats.Stats.StdDev
        | QgsRasterBandStats.Stats.Mean,
        layer.extent(),
        SAMPLE,
    )
    low, high = stats.minimumValue, stats.maximumValue
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        return
    if any(word in name for word in GREY):
        _grey(layer, low, high)
        return
    if any(word in name for word in ABOUT_ZERO) or (" minus " in name and -low > high / 20):
        far = min(max(-low, high), abs(stats.mean) + 3 * stats.stdDev)
        _ramp(layer, BLUE_RED, -far, far)
        return
    low = max(low, stats.mean - 3 * stats.stdDev)  # a few outliers would fade all others
    high = min(high, stats.mean + 3 * stats.stdDev)
    attribute, bracket, _ = name.partition(" (")  # as gridded attributes are named: "z (linear)"
    named = not bracket or attribute == "z" or "height" in attribute or "elevation" in attribute
    height = named and layer.bandCount() <= 4 and not any(word in name for word in NO_HEIGHT)
    _ramp(layer, colours["relief"] if height else VIRIDIS, low, high)
    if height and layer.elevationProperties() is not None:  # QGIS 3.24: for profiles and 3D
        layer.elevationProperties().setEnabled(True)


def _grey(layer: Any, low: float, high: float) -> None:
    renderer = QgsSingleBandGrayRenderer(layer.dataProvider(), 1)
    stretch = QgsContrastEnhancement(layer.dataProvider().dataType(1))
    stretch.setContrastEnhancementAlgorithm(
        QgsContrastEnhancement.ContrastEnhancementAlgorithm.StretchToMinimumMaximum
    )
    stretch.setMinimumValue(low)
    stretch.setMaximumValue(high)
    renderer.setContrastEnhancement(stretch)
    layer.setRenderer(renderer)


def _ramp(layer: Any, colours: Any, low: float, high: float) -> None:
    """Colours in equal steps from low to high."""
    step = (high - low) / (len(colours) - 1)
    shown = QgsColorRampShader(low, high)
    shown.setColorRampType(QgsColorRampShader.Type.Interpolated)
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


def _style_features(layer: Any, colours: dict[str, Any], classes: dict[str, Any] | None) -> None:
    if classes is None or not layer.isSpatial():
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
