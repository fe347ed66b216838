"""Old names of tools and parameters, which go on working for a year: metadata/renamed.json.

The table has under "tools" each old id, and under "parameters" for the id of each tool its old
names of inputs and outputs; each entry says what is the name ``now``, and ``until`` which month the
old one works at least.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Mapping
from typing import Any

from toolbox.context import log
from toolbox.errors import ParameterError
from toolbox.places import METADATA

_FILE = METADATA / "renamed.json"


@functools.cache
def table() -> Mapping[str, Any]:
    """The table of old names."""
    return dict(json.loads(_FILE.read_text(encoding="utf-8"))) if _FILE.is_file() else {}


def tool(id: str) -> str:
    """The id that a tool has now."""
    entry = table().get("tools", {}).get(id)
    return str(entry["now"]) if entry else id


def warn(id: str) -> None:
    """Warn of the old id of a tool."""
    if entry := table().get("tools", {}).get(id):
        _warn(id, entry)


def values(id: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a tool under the names that its inputs and outputs have now.

    Raises
    ------
    ParameterError
        A value is given under its old and its new name.
    """
    names, made, problems = _names(id), dict[str, Any](), {}
    for name, value in given.items():
        entry = names.get(name)
        now = entry["now"] if entry else name
        if entry:
            _warn(f"{id}: {name}", entry)
        if entry and now in given:
            problems[name] = f"is the old name of {now}, which is given, too"
        made[now] = value
    if problems:
        raise ParameterError(id, problems)
    return made


def words(id: str, said: Iterable[str]) -> list[str]:
    """Words of a command line with the names that options have now."""
    return [_word(id, word) for word in said]


def _word(id: str, word: str) -> str:
    """``--old.columns=x,y`` with the new name in place of old."""
    if not word.startswith("--"):
        return word
    option, sign, text = word[2:].partition("=")
    name, dot, rest = option.partition(".")
    entry = _names(id).get(name.replace("-", "_"))
    if not entry:
        return word
    _warn(f"{id}: {name}", entry)
    return f"--{entry['now']}{dot}{rest}{sign}{text}"


def _names(id: str) -> Mapping[str, Any]:
    found: Mapping[str, Any] = table().get("parameters", {}).get(id, {})
    return found


def _warn(old: str, entry: Mapping[str, str]) -> None:
    text = "%s is now called %s; the old name works until %s"
    log.warning(text, old, entry["now"], entry["until"])
