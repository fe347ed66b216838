"""Colours of vector layers by the values of an attribute."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.data import Vector
from toolbox.declare.show import Classes, Isolines, OfClass, Texts, Values
from toolbox.pictures.images import OTHER, Key, Ramp, ramp_of

_MOST_WORDS = len(OTHER)  # each has a colour of its own
_RANGES = 6  # of numbers, as classes
UNKNOWN = "#9a9a9a"  # features without a value

Colouring = Classes | Values | OfClass | Isolines | Texts
Coloured = tuple[Vector, Colouring | None]
"""A layer and how it is shown."""


def feature_key(features: Coloured) -> Key | None:
    """The key of the colours of features; None if all have the same colour."""
    layer, show = features
    match show:
        case Values():
            return ramp_of(show, layer.frame[show.attribute].to_numpy(float), layer.crs)
        case Classes():
            words = [str(word) for word in layer.frame[show.attribute].dropna().unique()]
            if not 0 < len(words) <= _MOST_WORDS:
                return None
            words.sort()
            others = iter([word for word in words if word not in show.looks])
            own = {w: (w, c) for w, c in zip(others, OTHER, strict=False)}
            return {code: own.get(w) or show.looks[w] for code, w in enumerate(words)}
        case _:
            return None


def feature_classes(features: Coloured) -> list[tuple[str, str, NDArray[np.bool_]]]:
    """Name, colour and features of each class; ranges of numbers are classes too.

    Features without a value are a class of their own. Nothing is given where all have one colour.
    """
    from matplotlib.colors import to_hex

    key = feature_key(features)
    if key is None:
        return []
    layer, show = features
    assert isinstance(show, Classes | Values)
    if isinstance(key, Ramp):
        values = layer.frame[show.attribute].to_numpy(float)
        edges = np.linspace(key.low, key.high, _RANGES + 1)
        which = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, _RANGES - 1)
        colours = [to_hex(key.colour_map()((k + 0.5) / _RANGES)) for k in range(_RANGES)]
        names = [f"{key.text(edges[k])} to {key.text(edges[k + 1])}" for k in range(_RANGES)]
        if key.extend in ("min", "both"):
            names[0] = f"≤ {key.text(edges[1])}"
        if key.extend in ("max", "both"):
            names[-1] = f"≥ {key.text(edges[-2])}"
        classes = [
            (f"{key.label}: {name}", colour, which == k)
            for k, (name, colour) in enumerate(zip(names, colours, strict=True))
        ]
        known = np.isfinite(values)
        classes = [(name, colour, own & known) for name, colour, own in classes]
    else:
        words = layer.frame[show.attribute]
        found = sorted(str(word) for word in words.dropna().unique())
        texts = words.astype(str).to_numpy(str)
        known = words.notna().to_numpy()
        classes = [
            (name, colour, (texts == word) & known)
            for word, (name, colour) in zip(found, key.values(), strict=True)
        ]
    classes.append(("not known", UNKNOWN, ~known))
    return [(name, colour, own) for name, colour, own in classes if own.any()]


def feature_colours(features: Coloured, key: Key) -> NDArray[Any]:
    """Colour of each feature as RGBA, array of shape (n, 4)."""
    from matplotlib.colors import to_rgba

    layer, show = features
    assert isinstance(show, Classes | Values)
    if isinstance(key, Ramp):
        values = layer.frame[show.attribute].to_numpy(float)
        share = np.clip((values - key.low) / (key.high - key.low), 0, 1)
        rgba = np.array(key.colour_map()(np.nan_to_num(share)), np.float64)
        rgba[~np.isfinite(values)] = to_rgba(UNKNOWN)
        return rgba
    words = layer.frame[show.attribute]
    known = sorted(str(word) for word in words.dropna().unique())
    table = {w: to_rgba(colour) for w, (_, colour) in zip(known, key.values(), strict=True)}
    return np.array([table.get(w, to_rgba(UNKNOWN)) for w in words.astype(str)]).reshape(-1, 4)
