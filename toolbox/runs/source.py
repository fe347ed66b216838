"""The layers that a run reads: checked before anything is opened, then opened."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pyproj import CRS

from toolbox.context import QUIET, Context, log
from toolbox.data import Layer
from toolbox.data.crs import describe_crs, same_crs
from toolbox.data.paths import missing
from toolbox.declare.fields import Field, Spec
from toolbox.declare.kinds import Kind, located, parsed_options
from toolbox.errors import DataError


def paths(field: Field, value: Any) -> list[Path]:
    """The files that the raw value of a source names."""
    found: list[Path] = []
    for item in field.given(value):
        try:
            place, _ = located(item)
            found += field.kind.files(place)
        except (ValueError, TypeError, OSError):
            continue  # a layer, or a mistake that is reported elsewhere
    return found


def problem(field: Field, value: Any) -> str | None:
    """What is wrong with the raw value of a source, before anything is opened."""
    if value is None and field.optional:
        return None
    items = field.given(value)
    if not items:
        return f"takes at least one {field.kind.word}, got 0"
    return next(filter(None, (_item_problem(field.kind, item) for item in items)), None)


def _item_problem(kind: Kind, item: Any) -> str | None:
    if kind.accepts(item):
        return None
    try:
        place, how = located(item)
        parsed_options(how, kind.open_options)
        places = place if isinstance(place, list) else [place]
        if not all(isinstance(path, str | Path) and str(path) for path in places):
            return f"must be a path or a {kind.word}, got {item!r}"
        if len(places) != 1 and not (kind.several and places):
            return f"takes one {kind.word}, got {len(places)}"
        absent = missing(places) if kind.several else [p for p in places if not Path(p).exists()]
    except (ValueError, OSError) as err:
        return str(err)
    return f"there is no file {', '.join(map(str, absent))}" if absent else None


def opened(spec: Spec, sources: Mapping[str, Any], crs: CRS | None, ctx: Context) -> dict[str, Any]:
    """All sources of a run, or one error that names those that cannot be opened.

    Parameters
    ----------
    crs : of layers that state none
    """
    layers, problems = {}, {}
    for index, (name, value) in enumerate(sources.items()):
        part = ctx.part(index / len(sources), (index + 1) / len(sources))
        try:
            layers[name] = open_source(spec.sources[name], value, crs, part)
        except (ValueError, OSError) as err:
            problems[name] = str(err)
    if problems:
        raise DataError(spec.id, problems)
    return layers


def absolute(field: Field, value: Any) -> Any:
    """The raw value of a source for a process that may be in another folder; layers stay."""

    def of(item: Any) -> Any:
        if field.kind.accepts(item):
            return item
        place, options = located(item)
        places = place if isinstance(place, list) else [place]
        made = [str(Path(path).absolute()) for path in places]
        return {"path": made if isinstance(place, list) else made[0], **options}

    items = [of(item) for item in field.given(value)]
    return items if field.many else items[0]


def open_source(field: Field, value: Any, crs: CRS | None, ctx: Context = QUIET) -> Any:
    """The layer, or layers, that the raw value of a source stands for."""
    made = field.parse(_openable(field, value, {"ctx": ctx, "assume_crs": crs}))
    if crs is None or made is None:
        return made
    assumed = tuple(_with_crs(layer, crs) for layer in field.items(made))
    return assumed if field.many else assumed[0]


def _openable(field: Field, value: Any, how: Mapping[str, Any]) -> Any:
    """Paths become mappings that say how to open them; layers and None stay as they are."""

    def openable(item: Any) -> Any:
        if item is None or field.kind.accepts(item):
            return item
        place, options = located(item)
        return {"path": place, **options, **how}

    made = tuple(map(openable, field.given(value)))
    return made if field.many else made[0]


def _with_crs(layer: Layer, crs: CRS) -> Layer:
    if layer.crs is None:
        return layer.with_crs(crs)
    if not same_crs(layer.crs, crs):
        known, given = describe_crs(layer.crs), describe_crs(crs)
        log.warning("%s states its CRS, %s; %s is not assumed", layer.name, known, given)
    return layer
