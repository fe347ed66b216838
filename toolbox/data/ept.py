"""Entwine point tiles (EPT): the files of points that an ept.json stands for.

References
----------
Hobu, Inc. (2019). Entwine Point Tile specification 1.0.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from toolbox.context import log
from toolbox.data.reading import errors_named
from toolbox.data.remote.address import Address
from toolbox.errors import DataError

NAME = "ept.json"

Key = tuple[int, int, int, int]
"""Depth of a node in the octree, and its place along x, y and z."""


def is_ept(path: Path) -> bool:
    """Whether a path is that of the description of an EPT.

    >>> is_ept(Path("a/ept.json")), is_ept(Path("a/b.json"))
    (True, False)
    """
    return path.name.lower() == NAME


def files_of(path: Path, bounds: Sequence[float] | None = None) -> list[Path]:
    """The files of the nodes that touch bounds (xmin, ymin, xmax, ymax); of all nodes without.

    Raises
    ------
    DataError
        It is no EPT, or its points are in a form that is not read.
    """
    with errors_named(f"{path} is no description of an EPT"):
        head = json.loads(path.read_text(encoding="utf-8"))
        kind, cube = head["dataType"], [float(value) for value in head["bounds"]]
        if kind != "laszip":
            raise DataError(f"{path}: points are read from EPT of laszip, not of {kind}")
        if len(cube) != 6 or not all(map(math.isfinite, cube)):
            raise ValueError(f"its bounds must be six numbers, got {cube}")
        nodes = dict(_nodes(path, cube, bounds))
        promised = int(head["points"])
    if not nodes:
        raise DataError(f"{path} has no points{' there' if bounds is not None else ''}")
    if bounds is None and (listed := sum(nodes.values())) != promised:
        log.warning("%s says %d points, and its hierarchy lists %d", path, promised, listed)
    return [_beside(path, f"ept-data/{_text(key)}.laz") for key in sorted(nodes)]


def _nodes(
    path: Path, cube: list[float], bounds: Sequence[float] | None
) -> Iterator[tuple[Key, int]]:
    """The nodes that touch bounds, and how many points each has, from all pages."""
    waiting: list[Key] = [(0, 0, 0, 0)]
    seen: set[Key] = set()
    while waiting:
        root = waiting.pop()
        if root in seen:
            raise ValueError(f"its hierarchy leads to {_text(root)} twice")
        seen.add(root)
        for text, count in _page(_beside(path, f"ept-hierarchy/{_text(root)}.json")).items():
            depth, x, y, z = map(int, text.split("-"))
            key = (depth, x, y, z)
            if not _touches(key, cube, bounds):
                continue
            if int(count) < 0:  # a page of its own says how many
                waiting.append(key)
            elif int(count) > 0:
                yield key, int(count)


def _page(path: Path) -> dict[str, Any]:
    """Number of points by node, -1 where a page of its own says it."""
    with errors_named(f"{path} is no page of the hierarchy of an EPT"):
        return dict(json.loads(path.read_text(encoding="utf-8")))


def _touches(key: Key, cube: list[float], bounds: Sequence[float] | None) -> bool:
    if bounds is None:
        return True
    side = (cube[3] - cube[0]) / 2 ** key[0]
    low = cube[0] + key[1] * side, cube[1] + key[2] * side
    return all(
        low[axis] <= bounds[axis + 2] and low[axis] + side >= bounds[axis] for axis in (0, 1)
    )


def _text(key: Key) -> str:
    return "-".join(map(str, key))


def _beside(path: Path, name: str) -> Path:
    return path.joined(name) if isinstance(path, Address) else path.parent / name
