"""Lists and loads the tools; the list and the descriptions need no import of any tool.

The tools of this distribution are described by `metadata/tools/<id>.json`, and the tool `a.b` is
declared in `algorithms/a/b.py`, or the model `models.b` in `algorithms/models/b.yaml`. Any other
model goes by the path of its file, which ends in .yaml. Tools of other packages join through entry
points of the group `toolbox.tools`: the name is the tool's id, the value is ``module:Class``.
Algorithms of QGIS, where it is installed, are tools too, ``qgis:native:buffer``, but not listed.
"""

from __future__ import annotations

import functools
import importlib
import json
import os
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox import renamed
from toolbox.errors import DataError, ParameterError, nearest
from toolbox.places import ALGORITHMS, METADATA, hidden

if TYPE_CHECKING:
    from toolbox.declare.fields import Spec

NOT_GROUPS = ("shared",)  # folders of algorithms/ that hold no tools
MODEL = (".yaml", ".yml")  # endings of model files
QGIS = "qgis:"  # begins the id of an algorithm of QGIS


def own_files() -> Mapping[str, Path]:
    """The file that declares each tool of this distribution, by id, from the names of the files.

    Raises
    ------
    DataError
        Another package has the name of ours.
    """
    if problem := hidden():
        raise DataError(problem)
    return _own_files()


@functools.cache
def _own_files() -> Mapping[str, Path]:
    paths = [path for path in ALGORITHMS.glob("*/[!_]*.*") if path.suffix in (".py", *MODEL)]
    paths = [path for path in paths if path.parent.name not in NOT_GROUPS]
    return {f"{path.parent.name}.{path.stem}": path for path in sorted(paths)}


def own_ids() -> list[str]:
    """Ids of the tools of this distribution."""
    return sorted(own_files())


def ids() -> list[str]:
    """Ids of all tools, sorted."""
    return sorted({*own_ids(), *plugins()})


def describe(id: str) -> dict[str, Any]:
    """The process description of a tool, from metadata/tools if it is there.

    Raises
    ------
    ParameterError
        No tool has this id.
    """
    id = renamed.tool(id)
    path = METADATA / "tools" / f"{id}.json"
    if id in own_ids() and path.is_file():
        return dict(json.loads(path.read_text(encoding="utf-8")))
    return load(id).describe()


def summaries() -> list[dict[str, Any]]:
    """A summary of each tool; a plugin that cannot be loaded has the reason as its title."""
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


def load(id: str, running: tuple[Path, ...] = ()) -> Spec:
    """Import a tool, or read a model, and return its specification.

    Parameters
    ----------
    id : of a tool, model or algorithm of QGIS, or the path of a model file
    running : models that are being read, of which this is a step

    Raises
    ------
    ParameterError
        No tool has this id, its package cannot be imported, or the model is wrong.
    DataError
        A library that it needs cannot be loaded, as where memory is short.
    """
    from toolbox.declare.spec import REGISTRY

    renamed.warn(id)
    id = renamed.tool(id)
    path = own_files().get(id)
    if id.endswith(MODEL) or (path and path.suffix in MODEL):
        return _model(Path(os.path.realpath(path or id)), running)
    if id.startswith(QGIS):
        found: Spec = importlib.import_module("toolbox.qgis.steps").load(id)
        return found
    plugin = None if path else plugins().get(id)
    if not (path or plugin):
        hint = nearest(id, ids()) or "; 'list' shows all"
        raise ParameterError(f"no tool called {id!r}{hint}")
    module = plugin.module if plugin else f"algorithms.{id}"
    try:
        importlib.import_module(module)
    except Exception as err:
        if plugin:
            raise ParameterError(f"{id} cannot be loaded: {err}") from err
        if not isinstance(err, ImportError | OSError):
            raise
        why = "is there enough memory, and is the installation whole?"
        raise DataError(f"{id} cannot be loaded; {why} ({err})") from err
    if id not in REGISTRY:
        raise ParameterError(f"{module} does not declare a tool called {id!r}")
    return REGISTRY[id]


def _model(path: Path, running: tuple[Path, ...]) -> Spec:
    """Read a model; a step that names a model file means one beside it."""
    from toolbox.models.reader import load as read

    if path in running:
        circle = " -> ".join(model.stem for model in (*running[running.index(path) :], path))
        raise ParameterError(f"models run each other: {circle}")

    def find(id: str) -> Spec:
        return load(str(path.parent / id) if id.endswith(MODEL) else id, (*running, path))

    return read(path, find)


@functools.cache
def plugins() -> Mapping[str, EntryPoint]:
    """Tools of other packages, by id."""
    return {point.name: point for point in entry_points(group="toolbox.tools")}
