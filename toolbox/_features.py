"""Colours of vector layers that say what their features are: a kind, or an offset to the side."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from toolbox._images import LENGTHS, OTHER, Classes, Ramp
from toolbox.data import Vector
from toolbox.data.crs import vertical_unit

_MOST_KINDS = 12
_OF_KINDS = {"agree": "#d4d4d4", "commission": "#d7261e", "omission": "#2166d1"}
_UNKNOWN = "#9a9a9a"


def feature_key(layer: Vector) -> Classes | Ramp | None:
    """How the features are coloured: by the texts of `kind`, by the numbers of `offset`, or not."""
    frame = layer.frame
    if "offset" in frame and pd.api.types.is_float_dtype(frame["offset"]):
        unit = LENGTHS.get(vertical_unit(layer.crs), "")
        label = f"Offset{f' ({unit})' if unit else ''}, left of the reference above zero"
        return Ramp.about_zero(frame["offset"].to_numpy(float), label)
    if "kind" not in frame:
        return None
    kinds = [str(kind) for kind in pd.unique(frame["kind"].dropna())]
    if not 0 < len(kinds) <= _MOST_KINDS:
        return None
    kinds.sort()
    others = iter([name for name in kinds if name not in _OF_KINDS])
    own = dict(zip(others, (OTHER * 2), strict=False))
    return {code: (name, own.get(name) or _OF_KINDS[name]) for code, name in enumerate(kinds)}


def feature_colours(layer: Vector, key: Classes | Ramp) -> NDArray[Any]:
    """One colour per feature, as shape (n, 4)."""
    from matplotlib.colors import to_rgba

    if isinstance(key, Ramp):
        values = layer.frame["offset"].to_numpy(float)
        share = np.clip((values - key.low) / (key.high - key.low), 0, 1)
        rgba = np.array(key.colour_map()(np.nan_to_num(share)), np.float64)
        rgba[~np.isfinite(values)] = to_rgba(_UNKNOWN)
        return rgba
    table = {name: to_rgba(colour) for name, colour in key.values()}
    kinds = layer.frame["kind"].astype(str)
    return np.array([table.get(kind, to_rgba(_UNKNOWN)) for kind in kinds]).reshape(-1, 4)
