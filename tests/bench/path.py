"""How far it is from the call of a run to the first line of the tool."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

from tests.bench.measuring import DATA, folder, say


def path() -> None:
    """Changes of module between `execute.run` and the tool, for a LAZ file and one output."""
    import toolbox
    from toolbox import catalog

    tool: Any = catalog.load("ground.csf").make
    first = tool.run.__wrapped__.__code__  # what stands in the class, below the change of units
    file = DATA / "feet/autzen_trim.laz"
    with folder() as out:
        values = {"points": file, "classified": out / "classified.laz"}
        toolbox.run("ground.csf", values)  # all modules are loaded, which is no part of the way
        visited = _modules(lambda: toolbox.run("ground.csf", values, overwrite=True), first)
    say(f"path     {len(visited) - 1} changes among {len(set(visited))} modules")


def _modules(work: Callable[[], Any], first: object) -> list[str]:
    """The modules of the toolbox in the order in which they are called, up to a function."""
    visited: list[str] = []

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event != "call":
            return
        if frame.f_code is first:
            sys.setprofile(None)
            return
        name = frame.f_globals.get("__name__", "")
        if name.startswith("toolbox.") and visited[-1:] != [name]:
            visited.append(name)

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return visited
