"""The page of a run: what came out of a tool or model, as a report for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from toolbox.data import Figure, PointCloud, Raster, Report, Rows, Section, Table, Vector
from toolbox.data.report import Block
from toolbox.fields import Field, Spec
from toolbox.picture import has_something_to_see, png
from toolbox.provenance import Record

MOST_FEATURES = 50  # whose attributes are listed


def page(spec: Spec, found: Mapping[str, Any], record: Record | None) -> Report:
    """Put together a report.

    Parameters
    ----------
    spec : of the tool
    found : what it gave, by name
    record : how that was made
    """
    sections = [
        _section("Results", [Rows(_values(spec, found))] if any(_numbers(spec, found)) else []),
        _section("Map", [_map(found)] if any(map(has_something_to_see, found.values())) else []),
        *(section for name, value in found.items() for section in _of_layer(spec, name, value)),
        _section("Layers", [Rows(_sizes(spec, found))] if len(_sizes(spec, found)) else []),
        _section("How it was made", [record.text()] if record else []),
    ]
    shown = [section for section in sections if section.blocks]
    return Report(spec.title, shown, summary=_flowing(spec.help), name=spec.id)


def _section(title: str, blocks: list[Block]) -> Section:
    return Section(title, tuple(blocks))


def _numbers(spec: Spec, found: Mapping[str, Any]) -> Iterator[tuple[Field, Any]]:
    """The results that are no layers, and what they are."""
    for name, value in found.items():
        field = spec.results[name]
        if not field.kind.is_layer and value is not None:
            yield field, value


def _values(spec: Spec, found: Mapping[str, Any]) -> Table:
    """One row for each number or text."""
    return Table.from_rows(
        {"result": field.help, "value": str(_short(value)), "unit": field.unit}
        for field, value in _numbers(spec, found)
    )


def _short(value: Any) -> Any:
    return f"{value:.6g}" if isinstance(value, float) else value


def _map(found: Mapping[str, Any]) -> Figure:
    """All layers that can be drawn."""
    layers = {name: value for name, value in found.items() if has_something_to_see(value)}
    return Figure(png(layers), ", ".join(layers))


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
