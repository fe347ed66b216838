"""What differs between two versions of a layer, in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd


def of_frames(old: pd.DataFrame, now: pd.DataFrame) -> Iterator[str]:
    """What differs between the rows of two tables or the features of two vector layers."""
    import pandas as pd

    if len(old) != len(now):
        yield f"{len(old)} rows, now {len(now)}"
        return
    for name in (name for name in old.columns if name in now):
        before, after = old[name], now[name]
        if pd.api.types.is_numeric_dtype(before) and pd.api.types.is_numeric_dtype(after):
            columns = (c.to_numpy(float, na_value=np.nan) for c in (before, after))
            yield from of_arrays({name: next(columns)}, {name: next(columns)}, "rows")
        elif count := sum(map(_unequal, before, after)):
            yield f"{name}: {count} of {len(old)} rows differ"
    yield from of_names(old.columns, now.columns)


def _unequal(one: Any, other: Any) -> bool:
    """Also for geometries; two missing values are the same."""
    import pandas as pd

    missing = [bool(pd.isna(value)) for value in (one, other)]
    return missing[0] != missing[1] if any(missing) else bool(one != other)


def of_names(old: Iterable[str], now: Iterable[str]) -> Iterator[str]:
    """Which names are missing, and which are new."""
    for text, one, other in (("is missing", old, now), ("is new", now, old)):
        yield from (f"{name}: {text}" for name in one if name not in other)


def of_arrays(old: Mapping[str, Any], now: Mapping[str, Any], what: str) -> Iterator[str]:
    """How many values differ, and by how much at most; where both are NaN they do not.

    Parameters
    ----------
    old, now : arrays by name; all names of the first are in the second
    what : the arrays hold one value for each of, such as "points"
    """
    for name, before in old.items():
        after = now[name]
        if before.shape != after.shape:
            yield f"{name}: of the shape {before.shape}, now {after.shape}"
            continue
        one, other = before.astype(np.float64), after.astype(np.float64)
        differ = (before != after) & ~(np.isnan(one) & np.isnan(other))
        if differ.any():
            apart = np.abs(one - other)[differ]
            most = f" by up to {np.nanmax(apart):g}" if not np.isnan(apart).all() else ""
            yield f"{name}: {np.count_nonzero(differ)} of {differ.size} {what} differ{most}"
