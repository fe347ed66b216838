"""Which tools there are, and what they say of themselves, without importing any of them.

The tools of this distribution are described by `metadata/tools/<id>.json`, and the tool `a.b` is
declared in `algorithms/a/b.py`. Tools of other packages join through entry points of the group
`toolbox.tools`: the name is the tool's id, the value is ``module:Class``.
"""

from __future__ import annotations

import functools
import importlib
import json
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.errors import ParameterError, nearest

if TYPE_CHECKING:
    from toolbox.fields import Spec

NOT_GROUPS = ("models", "shared")  # folders of algorithms/ that hold no tools
_PACKAGE = Path(__file__).parent
# An installed wheel carries metadata/ inside the package, a checkout has it beside the package.
METADATA = next(
    (p for p in (_PACKAGE / "metadata", _PACKAGE.parent / "metadata") if p.is_dir()),
    _PACKAGE.parent / "metadata",
)


def own_ids() -> list[str]:
    """Ids of the tools of this distribution, from the names of their files."""
    found = find_spec("algorithms")
    folders = [Path(name) for name in (found and found.submodule_search_locations) or []]
    paths = [path for folder in folders for path in folder.glob("*/[!_]*.py")]
    paths = [path for path in paths if path.parent.name not in NOT_GROUPS]
    return sorted(f"{path.parent.name}.{path.stem}" for path in paths)


def ids() -> list[str]:
    """Ids of all tools, sorted."""
    return sorted({*own_ids(), *plugins()})


def describe(id: str) -> dict[str, Any]:
    """The process description of a tool, from its file if it has one.

    Raises
    ------
    ParameterError
        No tool has this id.
    """
    path = METADATA / "tools" / f"{id}.json"
    if id in own_ids() and path.is_file():
        return dict(json.loads(path.read_text(encoding="utf-8")))
    return load(id).describe()


def summaries() -> list[dict[str, Any]]:
    """What a list of tools shows of each; a plugin that cannot be loaded says so as its title."""
    keys = ("id", "version", "title", "description", "keywords", "jobControlOptions")
    found = []
    for id in ids():
        try:
            tool = describe(id)
        except ParameterError as err:
            why = str(err).removeprefix(f"{id} ")
            tool = dict.fromkeys(keys, "") | {"id": id, "title": f"({why})"}
        found.append({key: tool[key] for key in keys})
    return found


def load(id: str) -> Spec:
    """Import a tool and return its specification.

    Raises
    ------
    ParameterError
        No tool has this id, or its package cannot be imported.
    """
    from toolbox.spec import REGISTRY

    if id not in ids():
        hint = nearest(id, ids()) or "; 'list' shows all"
        raise ParameterError(f"no tool called {id!r}{hint}")
    plugin = plugins().get(id)
    module = plugin.module if plugin else f"algorithms.{id}"
    try:
        importlib.import_module(module)
    except Exception as err:
        if not plugin:
            raise
        raise ParameterError(f"{id} cannot be loaded: {err}") from err
    if id not in REGISTRY:
        raise ParameterError(f"{module} does not declare a tool called {id!r}")
    return REGISTRY[id]


@functools.cache
def plugins() -> Mapping[str, EntryPoint]:
    """Tools of other packages, by id."""
    return {point.name: point for point in entry_points(group="toolbox.tools")}
