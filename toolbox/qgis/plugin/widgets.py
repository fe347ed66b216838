"""Widgets of the dialogs for what those of QGIS do not offer.

Points are a layer, a file, several files or a folder, of which QGIS itself need not be able to open
any. A CRS may be one that is none, for scans. Choices are shown in words and kept by their names.
Names of attributes and bands are offered, and may be typed. Classes are ticked in a list.
"""

from __future__ import annotations

from typing import Any

import qgis.core
from processing.gui.wrappers import DIALOG_MODELER, WidgetWrapper
from qgis.core import QgsProcessingModelChildParameterSource, QgsProcessingParameterDefinition
from qgis.PyQt.QtWidgets import QComboBox

from . import language
from .layers import suggestions
from .parameters import WIDGETS, AnyCrs, Choice, Classes, Condition, PointCloud, Suggested
from .rows import ClassesRow, ConditionRow, CrsRow, NamesRow, PointsRow, Row


class _Wrapper(WidgetWrapper):
    """What the dialogs of QGIS ask of the widget of a parameter.

    In the model designer its list also has the inputs and results of the model that it may take.
    """

    inputs: tuple[Any, ...] = ()  # classes of inputs of a model that it takes
    results: tuple[Any, ...] = ()  # and of results of other steps

    def createWidget(self, **more: Any) -> Any:
        self.row = self.made(self.parameterDefinition())
        self.row.setToolTip(self.parameterDefinition().toolTip())
        self.row.changed.connect(lambda: self.widgetValueHasChanged.emit(self))
        if self.dialogType == DIALOG_MODELER:
            offered = self.dialog.getAvailableValuesOfType(self.inputs, self.results)
            for source in filter(self.takes, offered):
                self.row.box.addItem(self.dialog.resolveValueDescription(source), source)
        return self.row

    def createLabel(self) -> Any:
        """The label, which says on a longer look what its box does: QGIS has it say the name."""
        label = super().createLabel()
        if label is not None:
            label.setToolTip(self.parameterDefinition().toolTip())
        return label

    def made(self, parameter: Any) -> Any:
        raise NotImplementedError

    def takes(self, source: Any) -> bool:
        """Whether an input or result of the model, of a class that it takes, can be a value."""
        return True

    def setValue(self, value: Any) -> None:
        each = value if isinstance(value, list) else [value]
        if each and all(isinstance(one, QgsProcessingModelChildParameterSource) for one in each):
            self._show_source(value if len(each) > 1 else each[0])
        else:
            self.row.show_value(value)

    def _show_source(self, source: Any) -> None:
        """Show where a step of a model has its value from, also if it is an expression."""
        box = self.row.box
        known = [n for n in range(box.count()) if box.itemData(n) == source]
        if not known:
            several = isinstance(source, list)
            named = [] if several else [source.expression(), source.expressionText()]
            box.addItem(next(filter(None, named), language.text("From several steps")), source)
        box.setCurrentIndex(known[0] if known else box.count() - 1)

    def value(self) -> Any:
        return self.row.shown()


class PointsWidget(_Wrapper):
    """Points: a layer, files or a folder."""

    inputs = (
        qgis.core.QgsProcessingParameterPointCloudLayer,
        qgis.core.QgsProcessingParameterMultipleLayers,
        qgis.core.QgsProcessingParameterFile,
        qgis.core.QgsProcessingParameterString,
    )
    results = tuple(
        getattr(qgis.core, f"QgsProcessingOutput{word}")
        for word in ("PointCloudLayer", "File", "Folder", "String")
        if hasattr(qgis.core, f"QgsProcessingOutput{word}")  # the first is of QGIS 3.24
    )

    def made(self, parameter: Any) -> Any:
        row = PointsRow(parameter.createFileFilter())
        row.list_layers()
        return row

    def takes(self, source: Any) -> bool:
        """Not the plots, reports and texts of our tools, which are files and texts as well."""
        if not source.outputChildId():  # an input of the model, or a value
            return True
        maker = self.dialog.model.childAlgorithm(source.outputChildId()).algorithm()
        fields = {f["name"].upper(): f for f in getattr(maker, "tool", {}).get("outputs", ())}
        field = fields.get(source.outputName())
        return field is None or field["type"] == "pointcloud"

    def value(self) -> Any:
        return self.row.shown() or None


class CrsWidget(_Wrapper):
    """A CRS, also one that is none."""

    inputs = (qgis.core.QgsProcessingParameterCrs, qgis.core.QgsProcessingParameterString)

    def made(self, parameter: Any) -> Any:
        return CrsRow()


class ChoiceWidget(_Wrapper):
    """One of several words."""

    inputs = (qgis.core.QgsProcessingParameterEnum, qgis.core.QgsProcessingParameterString)

    def made(self, parameter: Any) -> Any:
        row = Row(QComboBox())
        row.box.setEditable(False)
        if parameter.flags() & QgsProcessingParameterDefinition.Flag.FlagOptional:
            row.box.addItem("", None)
        for word, name in zip(parameter.shown, parameter.options()):
            row.box.addItem(word, name)
        return row


class ClassesWidget(_Wrapper):
    """Classes of points."""

    inputs = (qgis.core.QgsProcessingParameterString,)

    def made(self, parameter: Any) -> Any:
        return ClassesRow(parameter.known)

    def value(self) -> Any:
        return self.row.shown() or None


class _OfLayers(_Wrapper):
    """Offers the names in the layers that are chosen, now and later."""

    inputs = (qgis.core.QgsProcessingParameterString, qgis.core.QgsProcessingParameterField)
    sources: Any = ()  # the wrappers of these layers

    def postInitialize(self, wrappers: Any) -> None:
        known = {wrapper.parameterDefinition().name(): wrapper for wrapper in wrappers}
        wanted = self.parameterDefinition().sources
        self.sources = [known[name] for name in wanted if name in known]
        for wrapper in self.sources:
            wrapper.widgetValueHasChanged.connect(lambda changed: self.offer())
        self.offer()

    def names(self) -> dict[str, str]:
        """What there is in the layers, by how it is shown."""
        found: dict[str, str] = {}
        for wrapper in self.sources:
            raster = wrapper.parameterDefinition().type() == "raster"
            found.update(suggestions(wrapper.parameterValue(), raster))
        return found

    def offer(self) -> None:
        raise NotImplementedError

    def value(self) -> Any:
        return self.row.shown() or None


class SuggestedWidget(_OfLayers):
    """A text, for which names in the layers and others are offered; several are ticked."""

    def made(self, parameter: Any) -> Any:
        row = NamesRow() if parameter.many else Row(QComboBox())
        row.box.lineEdit().setClearButtonEnabled(True)
        self._fill(row, {text: text for text in parameter.offers})
        return row

    def offer(self) -> None:
        self._fill(self.row, {t: t for t in self.parameterDefinition().offers} | self.names())

    def _fill(self, row: Any, names: dict[str, str]) -> None:
        """Offer these, and keep what is given and what a model offers."""
        box, said = row.box, row.shown()
        items = [(box.itemText(n), box.itemData(n)) for n in range(box.count())]
        kept = [item for item in items if item[1] is not None and not isinstance(item[1], str)]
        box.blockSignals(True)
        box.clear()
        for shown, name in [*names.items(), *kept]:
            box.addItem(shown, name)
        box.setCurrentIndex(-1)
        row.show_value(said)
        box.blockSignals(False)


class ConditionWidget(_OfLayers):
    """A condition, into which attributes are put from a list."""

    def made(self, parameter: Any) -> Any:
        return ConditionRow(self.names)

    def offer(self) -> None:
        """The list is made when it is opened."""


def use() -> None:
    """Let the dialogs show these widgets."""
    WIDGETS.update(
        {
            PointCloud: PointsWidget,
            AnyCrs: CrsWidget,
            Choice: ChoiceWidget,
            Classes: ClassesWidget,
            Condition: ConditionWidget,
            Suggested: SuggestedWidget,
        }
    )
