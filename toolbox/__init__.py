"""Declare, check, run and chain geoprocessing tools for LiDAR.

>>> import toolbox
>>> result = toolbox.run("ground.csf", {"points": "a.laz", "classified": "b.laz"})  # doctest: +SKIP
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from toolbox.data import PointCloud, Raster, Survey, Table, Vector
    from toolbox.execute import run

__version__ = "0.1.0"
__all__ = ["PointCloud", "Raster", "Survey", "Table", "Vector", "__version__", "run"]

_MODULES = {"run": "toolbox.execute"} | dict.fromkeys(
    ["PointCloud", "Raster", "Survey", "Table", "Vector"], "toolbox.data"
)


def __getattr__(name: str) -> Any:
    """Import on first use: `list` and `--help` must not wait for numerical libraries."""
    if name in _MODULES:
        return getattr(importlib.import_module(_MODULES[name]), name)
    raise AttributeError(f"module 'toolbox' has no attribute {name!r}")


def __dir__() -> list[str]:
    """What a notebook offers behind ``toolbox.``: also what is not imported yet."""
    return sorted({*globals(), *__all__})
