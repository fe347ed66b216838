"""Sets the colours of results when they are loaded, from their content and not from the tool.

A point cloud is drawn by its classes. A raster is drawn as relief, as differences about zero or in
grey, by the description of its band. Features are drawn by their severity, class or kind.
"""

from __future__ import annotations

import math
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
)
from qgis.PyQt.QtGui import QColor

SAMPLE = 250000  # cells that statistics are taken of
GREY = ("hillshade", "intensity")
NO_HEIGHT = ("(std)", "(count)", "points", "distance", "error")
ABOUT_ZERO = ("differ", "change")
BLUE_RED = ("#2166ac", "#92c5de", "#f7f7f7", "#f4a582", "#b2182b")
VIRIDIS = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")
BY_WORD = ("severity", "class", "classification", "kind")  # attributes by which features are drawn
MOST = 20  # distinct values of such an attribute
SEVERITIES = {
    "#b2182b": ("critical", "severe", "danger", "dangerous", "high", "urgent", "immediate"),
    "#ef8a62": ("major", "warning", "medium", "moderate"),
    "#fddc7a": ("minor", "low", "notice", "watch", "advisory"),
    "#74a67a": ("none", "ok", "safe", "clear", "info"),
}
SEVERITY_CODES = [[1, "critical", "#b2182b"], [2, "warning", "#ef8a62"], [3, "watch", "#fddc7a"]]
KINDS = {"agree": "#d4d4d4", "commission": "#d7261e", "omission": "#2166d1"}


class Styler(QgsProcessingLayerPostProcessorInterface):
    """Sets the colours of a layer after it was loaded."""

    _kept: ClassVar[list[Any]] = []  # QGIS holds a bare pointer only

    @classmethod
    def of(cls, colours: dict[str, Any]) -> Styler:
        made = cls()
        made.colours = colours
        cls._kept.append(made)
        return made

    def postProcessLayer(self, layer: Any, context: Any, feedback: Any) -> None:
        try:
            style(layer, self.colours)
        except Exception as err:  # a layer in plain colours is better than none
            QgsMessageLog.logMessage(f"{layer.name()} keeps its colours: {err}", "LiDAR Toolbox")


def style(layer: Any, colours: dict[str, Any]) -> None:
    """Give a layer its colours."""
    if layer.type() == QgsMapLayerType.RasterLayer:
        _style_raster(layer, colours)
    elif layer.type() == QgsMapLayerType.VectorLayer:
        _style_features(layer, colours)
    elif layer.type() == QgsMapLayerType.PointCloudLayer:
        _style_points(layer, colours)
    layer.triggerRepaint()


def _style_raster(layer: Any, colours: dict[str, Any]) -> None:
    name = layer.bandName(1).partition(": ")[2].lower()
    stats = layer.dataProvider().bandStatistics(
        1, QgsRasterBandStats.Min | QgsRasterBandStats.Max | QgsRasterBandStats.StdDev
        | QgsRasterBandStats.Mean, layer.extent(), SAMPLE,
    )  # fmt: skip
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
    stretch.setContrastEnhancementAlgorithm(QgsContrastEnhancement.StretchToMinimumMaximum)
    stretch.setMinimumValue(low)
    stretch.setMaximumValue(high)
    renderer.setContrastEnhancement(stretch)
    layer.setRenderer(renderer)


def _ramp(layer: Any, colours: Any, low: float, high: float) -> None:
    """Colours in equal steps from low to high."""
    step = (high - low) / (len(colours) - 1)
    shown = QgsColorRampShader(low, high)
    shown.setColorRampType(QgsColorRampShader.Interpolated)
    shown.setColorRampItemList([
        QgsColorRampShader.ColorRampItem(low + i * step, QColor(colour), f"{low + i * step:.4g}")
        for i, colour in enumerate(colours)
    ])  # fmt: skip
    shader = QgsRasterShader(low, high)
    shader.setRasterShaderFunction(shown)
    renderer = QgsSingleBandPseudoColorRenderer(layer.dataProvider(), 1, shader)
    renderer.setClassificationMin(low)
    renderer.setClassificationMax(high)
    layer.setRenderer(renderer)


def _style_features(layer: Any, colours: dict[str, Any]) -> None:
    name = next((n for n in BY_WORD if layer.fields().indexOf(n) >= 0), None)
    if name is None or not layer.isSpatial():
        return
    values = sorted(layer.uniqueValues(layer.fields().indexOf(name), MOST + 1), key=str)
    values = [value for value in values if value is not None and str(value) != "NULL"]
    if not 0 < len(values) <= MOST:
        return
    looks = _looks(name, values, colours)
    categories = []
    for value, (label, colour) in zip(values, looks):
        symbol = QgsSymbol.defaultSymbol(layer.geometryType())
        symbol.setColor(QColor(colour))
        categories.append(QgsRendererCategory(value, symbol, label))
    layer.setRenderer(QgsCategorizedSymbolRenderer(name, categories))


def _looks(name: str, values: list[Any], colours: dict[str, Any]) -> list[tuple[str, str]]:
    """Label and colour of each value."""
    classes = {code: (label, colour) for code, label, colour in colours["classification"]}
    words = {word: colour for colour, group in SEVERITIES.items() for word in group}
    others = iter(list(colours["other"]) * 3)
    found = []
    for index, value in enumerate(values):
        if name == "severity":
            usual = _between("#fddc7a", "#b2182b", index / max(len(values) - 1, 1))
            found.append((str(value), words.get(str(value).lower(), usual)))
        elif value in classes:
            found.append(classes[value])
        else:
            found.append((str(value), KINDS.get(str(value)) or next(others)))
    return found


def _between(first: str, last: str, share: float) -> str:
    a, b = QColor(first).getRgb(), QColor(last).getRgb()
    return QColor(*(round(x + (y - x) * share) for x, y in zip(a, b))).name()


def _style_points(layer: Any, colours: dict[str, Any]) -> None:
    """By what the tool found: severities or errors, else the classes."""
    from qgis.core import QgsPointCloudCategory, QgsPointCloudClassifiedRenderer

    names = {a.name().lower(): a.name() for a in layer.attributes().attributes()}
    looked = {"severity": SEVERITY_CODES} | colours
    for name in ("severity", "error", "classification"):
        if name in names:
            looks = looked[name]
            made = [QgsPointCloudCategory(code, QColor(c), label) for code, label, c in looks]
            layer.setRenderer(QgsPointCloudClassifiedRenderer(names[name], made))
            return
