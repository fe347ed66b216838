"""Folders that belong to the package, and to the user's account."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent

ALGORITHMS = _PACKAGE.parent / "algorithms"
"""The package of our tools."""

METADATA = next(
    (path for path in (_PACKAGE / "metadata", _PACKAGE.parent / "metadata") if path.is_dir()),
    _PACKAGE.parent / "metadata",
)
"""What is made from the declarations, translations and old names.

An installed wheel carries the folder inside the package, a checkout has it beside the package.
"""


def hidden() -> str:
    """Why our tools cannot be imported: another package has their name; empty if none has.

    Python looks into the working folder first, when it is started with ``-m`` or with nothing.
    """
    spec = find_spec(ALGORITHMS.name)
    found = Path((spec and spec.origin) or ALGORITHMS / "__init__.py").resolve().parent
    if found == ALGORITHMS:
        return ""
    return (
        f"{found} hides the package 'algorithms' of lidar-toolbox; "
        "rename it, or work in another folder"
    )


def cache(variable: str, name: str) -> Path:
    """A folder for what can be made again: the one that a variable names, else the system's.

    >>> os.environ["SCANS_HERE"] = "scans"
    >>> cache("SCANS_HERE", "steps").name
    'scans'
    """
    if named := os.environ.get(variable):
        return Path(named)
    from platformdirs import user_cache_path

    return user_cache_path("lidar-toolbox") / name
