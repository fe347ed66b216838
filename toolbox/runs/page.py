"""The report of a run: results, plots and tables of a tool or model as an HTML page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from toolbox.data import Figure, Report, Rows, Section, Table
from toolbox.data.layer import Layer
from toolbox.data.report import Block
from toolbox.declare.fields import Spec
from toolbox.pictures.draw import drawable, png
from toolbox.runs.provenance import Record


def page(spec: Spec, found: Mapping[str, Any], record: Record | None) -> Report:
    """The report of a run.

    Parameters
    ----------
    spec : of the tool
    found : what it gave, by name
    record : how that was made
    """
    numbers, layers, single = (
        _values(spec, found),
        drawable(found, spec.results),
        _layers(spec, found),
    )
    sizes = _sizes(spec, single)
    sections = [
        _section("Results", [Rows(numbers)] if len(numbers) else []),
        _section("Map", [Figure(png(layers), ", ".join(layers))] if layers else []),
        *(
            section
            for name, layer in single.items()
            for section in layer.page_sections(name, spec.results[name].help)
        ),
        _section("Layers", [Rows(sizes)] if len(sizes) else []),
        _section("How it was made", [record.text()] if record else []),
    ]
    shown = [section for section in sections if section.blocks]
    return Report(spec.title, shown, summary=_flowing(spec.text), name=spec.id)


def _section(title: str, blocks: list[Block]) -> Section:
    return Section(title, tuple(blocks))


def _values(spec: Spec, found: Mapping[str, Any]) -> Table:
    """Table with a row for each number or text among the results."""
    fields = spec.results
    return Table.from_rows(
        {"result": fields[name].help, "value": str(_short(value)), "unit": fields[name].unit}
        for name, value in found.items()
        if value is not None and not fields[name].kind.is_layer
    )


def _short(value: Any) -> Any:
    return f"{value:.6g}" if isinstance(value, float) else value


def _layers(spec: Spec, found: Mapping[str, Any]) -> dict[str, Layer]:
    """The single layers among the results by name, without tuples of repeated steps."""
    return {
        name: value
        for name, value in found.items()
        if spec.results[name].kind.is_layer and not (value is None or isinstance(value, tuple))
    }


def _sizes(spec: Spec, layers: Mapping[str, Layer]) -> Table:
    """Table with the size of each layer."""
    return Table.from_rows(
        {"layer": name, "holds": spec.results[name].help, "size": layer.size_text()}
        for name, layer in layers.items()
        if layer.size_text()
    )


def _flowing(text: str) -> str:
    """Text in which paragraphs have no line breaks."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))
