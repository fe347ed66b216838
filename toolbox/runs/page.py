"""The page of a run: what came out of a tool or model, as a report for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from toolbox.data import Figure, PointCloud, Raster, Report, Rows, Section, Table, Vector
from toolbox.data.report import Block
from toolbox.declare.fields import Spec
from toolbox.pictures.picture import drawable, png
from toolbox.runs.provenance import Record

MOST_FEATURES = 50  # whose attributes are listed


def page(spec: Spec, found: Mapping[str, Any], record: Record | None) -> Report:
    """Put together a report.

    Parameters
    ----------
    spec : of the tool
    found : what it gave, by name
    record : how that was made
    """
    numbers, layers, sizes = _values(spec, found), drawable(found), _sizes(spec, found)
    sections = [
        _section("Results", [Rows(numbers)] if len(numbers) else []),
        _section("Map", [Figure(png(layers), ", ".join(layers))] if layers else []),
        *(section for name, value in found.items() for section in _of_layer(spec, name, value)),
        _section("Layers", [Rows(sizes)] if len(sizes) else []),
        _section("How it was made", [record.text()] if record else []),
    ]
    shown = [section for section in sections if section.blocks]
    return Report(spec.title, shown, summary=_flowing(spec.help), name=spec.id)


def _section(title: str, blocks: list[Block]) -> Section:
    return Section(title, tuple(blocks))


def _values(spec: Spec, found: Mapping[str, Any]) -> Table:
    """One row for each number or text."""
    fields = spec.results
    return Table.from_rows(
        {"result": fields[name].help, "value": str(_short(value)), "unit": fields[name].unit}
        for name, value in found.items()
        if value is not None and not fields[name].kind.is_layer
    )


def _short(value: Any) -> Any:
    return f"{value:.6g}" if isinstance(value, float) else value


def _of_layer(spec: Spec, name: str, value: Any) -> Iterator[Section]:
    help = spec.results[name].help
    match value:
        case Report():
            yield from value.sections
        case Table():
            yield _section(name, [Rows(value, help)])
        case Vector():
            frame = value.frame
            attributes = Table(frame.drop(columns=frame.geometry.name))
            yield _section(name, [Rows(attributes, help, MOST_FEATURES)])


def _sizes(spec: Spec, found: Mapping[str, Any]) -> Table:
    """One row for each cloud and raster, which a page cannot list."""
    rows = []
    for name, value in found.items():
        match value:
            case PointCloud():
                size = f"{len(value):,} points"
            case Raster():
                size = "{:,} rows, {:,} columns".format(*value.values.shape[1:])
            case _:
                continue
        rows.append({"layer": name, "holds": spec.results[name].help, "size": size})
    return Table.from_rows(rows)


def _flowing(text: str) -> str:
    """Paragraphs without the line breaks of the source code."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))
