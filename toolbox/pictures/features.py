"""Colours of vector layers whose features say what they are: a kind, an offset or an error."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.data import Vector
from toolbox.data.crs import vertical_unit
from toolbox.pictures.images import LENGTHS, OTHER, Classes, Ramp

_MOST_KINDS = 12
_OF_KINDS = {"agree": "#d4d4d4", "commission": "#d7261e", "omission": "#2166d1"}
_UNKNOWN = "#9a9a9a"
_ABOUT_ZERO = {"offset": "Offset{}, left of the reference above zero", "error": "error{}"}


def feature_key(layer: Vector) -> Classes | Ramp | None:
    """How the features are coloured: by the texts of `kind`, by numbers, or not."""
    frame = layer.frame
    if name := _about_zero(layer):
        unit = LENGTHS.get(vertical_unit(layer.crs), "")
        label = _ABOUT_ZERO[name].format(f" ({unit})" if unit else "")
        return Ramp.about_zero(frame[name].to_numpy(float), label)
    if "kind" not in frame:
        return None
    kinds = [str(kind) for kind in frame["kind"].dropna().unique()]
    if not 0 < len(kinds) <= _MOST_KINDS:
        return None
    kinds.sort()
    others = iter([name for name in kinds if name not in _OF_KINDS])
    own = dict(zip(others, (OTHER * 2), strict=False))
    return {code: (name, own.get(name) or _OF_KINDS[name]) for code, name in enumerate(kinds)}


def _about_zero(layer: Vector) -> str | None:
    """The attribute that is shown in two colours about zero."""
    columns = layer.frame.dtypes
    if "normal_x" in columns:
        return None  # the offset is that of a plane
    return next((n for n in _ABOUT_ZERO if n in columns and columns[n].kind == "f"), None)


def feature_colours(layer: Vector, key: Classes | Ramp) -> NDArray[Any]:
    """One colour per feature, as shape (n, 4)."""
    from matplotlib.colors import to_rgba

    if isinstance(key, Ramp):
        values = layer.frame[str(_about_zero(layer))].to_numpy(float)
        share = np.clip((values - key.low) / (key.high - key.low), 0, 1)
        rgba = np.array(key.colour_map()(np.nan_to_num(share)), np.float64)
        rgba[~np.isfinite(values)] = to_rgba(_UNKNOWN)
        return rgba
    table = {name: to_rgba(colour) for name, colour in key.values()}
    kinds = layer.frame["kind"].astype(str)
    return np.array([table.get(kind, to_rgba(_UNKNOWN)) for kind in kinds]).reshape(-1, 4)
