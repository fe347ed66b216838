"""A QGIS plugin that shows every tool in the Processing toolbox and runs it in its own Python.

Nothing here imports more than `qgis` and the standard library.
"""

from __future__ import annotations

from typing import Any


def classFactory(iface: Any) -> Any:
    """Make the plugin; `iface` is None under qgis_process."""
    from .plugin import Plugin

    return Plugin(iface)
