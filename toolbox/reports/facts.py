"""The facts in the head of a report: survey, inputs, CRS, heights, settings, version."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from toolbox import __version__, language
from toolbox.data import PointCloud, Survey
from toolbox.data.crs import (
    Unit,
    describe_crs,
    foot_of,
    height_system,
    is_local,
)
from toolbox.data.layer import Layer, crs_of
from toolbox.data.report import unit_text
from toolbox.declare.fields import Field, Spec
from toolbox.reports import words
from toolbox.reports.units import unit_of_data

if TYPE_CHECKING:
    from toolbox.runs.provenance import Record

_ALWAYS = ("cell", "interval", "height_error", "rules", "voltage")
"""Settings that are told also at their defaults, apart from those that were given."""

_INSTEAD = {"rules": ("rule_table", "distance")}
"""Settings that are not used where one of others is given."""

_MOST_FILES = 4  # that are named


def facts_of(
    spec: Spec,
    found: Mapping[str, Any],
    record: Record | None,
    given: Mapping[str, Any],
    of_set: Collection[str] = (),
) -> tuple[tuple[str, str], ...]:
    """What the head of a report says of a run, as pairs of name and text.

    Parameters
    ----------
    of_set : settings that the set to hand over has of itself, as nobody gave them
    """
    layers = layers_of(given, found)
    facts = [("Date of the survey", survey_date(layers)), *_places(layers)]
    if record and record.assume_crs:
        facts += [("Given by hand", "the CRS, for inputs that state none")]
    facts += [("Input", text) for text in _inputs(record)]
    facts += [("Settings", chosen_settings(spec, record, layers, of_set))]
    facts += [("Defaults used", default_settings(spec, record, layers, of_set))]
    facts += [("Made with", f"lidar-toolbox {__version__}, {spec.id}")]
    return tuple((name, text) for name, text in facts if text)


def layers_of(given: Mapping[str, Any], found: Mapping[str, Any]) -> list[Layer]:
    """The layers of a run: those that were read, then the results."""
    return [layer for value in (*given.values(), *found.values()) for layer in _each(value)]


def _each(value: Any) -> Iterator[Layer]:
    for item in value if isinstance(value, tuple | list) else (value,):
        if isinstance(item, Layer):
            yield item


def survey_date(layers: list[Layer]) -> str:
    """The days on which points were measured, by their GPS time; "" if no layer holds points."""
    clouds = [layer for layer in layers if isinstance(layer, PointCloud | Survey)]
    if not clouds:
        return ""
    spans = [span for cloud in clouds[:1] if (span := cloud.days())]
    if not spans:
        return "not known: the points have no GPS time that tells the day"
    first, last = min(a for a, _ in spans), max(b for _, b in spans)
    beginning = f"{first.isoformat()}"
    return beginning if first == last else f"{beginning} to {last.isoformat()}"


def _places(layers: list[Layer]) -> list[tuple[str, str]]:
    """CRS and height system of the first layer that has a place."""
    if (crs := crs_of(layers)) is None:
        return []
    text = describe_crs(crs)
    named = "local coordinates, no position on the Earth" if is_local(crs) else text
    return [("Coordinates", named), ("Heights", height_system(crs))]


def _inputs(record: Record | None) -> Iterator[str]:
    if record is None:
        return
    for name, items in record.inputs.items():
        files = [f"{i.file} ({i.files} files)" if i.files > 1 else i.file for i in items]
        more = f" and {len(files) - _MOST_FILES} more" if len(files) > _MOST_FILES else ""
        if files:
            yield f"{words.title_of(name)}: {', '.join(files[:_MOST_FILES])}{more}"


def chosen_settings(
    spec: Spec,
    record: Record | None,
    layers: Sequence[Layer] = (),
    of_set: Collection[str] = (),
) -> str:
    """The settings that were given: those that differ from their defaults.

    Lengths are told in metres, and in the unit of the first layer that has another one; in feet,
    some have other defaults. What no step that runs uses is not told.
    """
    return _settings(spec, record, layers, lambda name, other: other and name not in of_set)


def default_settings(
    spec: Spec,
    record: Record | None,
    layers: Sequence[Layer] = (),
    of_set: Collection[str] = (),
) -> str:
    """The settings that nobody gave, and on which figures hang so much that they are told."""
    return _settings(
        spec, record, layers, lambda name, other: name in of_set or (name in _ALWAYS and not other)
    )


def _settings(
    spec: Spec,
    record: Record | None,
    layers: Sequence[Layer],
    is_told: Callable[[str, bool], bool],
) -> str:
    """The settings that are told, by name and whether the value is another than the default."""
    if record is None:
        return ""
    data_unit, foot, parts = unit_of_data(layers), foot_of(crs_of(layers)), []
    idle = spec.idle(record.parameters)
    for name, value in record.parameters.items():
        field = spec.inputs[name]
        if value is None or in_place_of(name, record) or name in idle:
            continue
        default = None if field.required else field.to_json(field.default_in(foot))
        if is_told(name, value != default):
            parts.append(f"{language.text(field.title)} {_told(field, value, data_unit)}")
    return "; ".join(parts)


def in_place_of(name: str, record: Record) -> str:
    """The input that was given in place of a setting, which was not used then; "" for none."""
    given = (
        other
        for other in _INSTEAD.get(name, ())
        if record.inputs.get(other) or record.parameters.get(other) is not None
    )
    return next(given, "")


def _told(field: Field, value: Any, data_unit: Unit | None) -> str:
    """The value of a setting with its unit; of a length also in the unit of the data."""
    if field.unit == "m" and isinstance(value, float | int):
        return words.length_text(value, data_unit)
    shown = words.setting_of(field, value)
    shown = language.text(shown) if isinstance(value, bool) else shown
    return shown if isinstance(value, str) else f"{shown} {unit_text(field.unit)}".strip()
