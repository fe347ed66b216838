"""JSON that any program can read: numbers that JSON does not know are null."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


def json_text(value: Any, **how: Any) -> str:
    """The JSON text of a value; NaN and infinity, which RFC 8259 does not have, become null.

    Parameters
    ----------
    how : as for :func:`json.dumps`

    Examples
    --------
    >>> json_text({"bias": float("nan"), "levels": (1.5, float("inf"))})
    '{"bias": null, "levels": [1.5, null]}'
    """
    return json.dumps(_finite(value), allow_nan=False, **how)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
