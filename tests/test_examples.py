"""Examples in docstrings run, and every function that a tool may call has one."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from types import ModuleType

import pytest

import algorithms
import algorithms.shared
import toolbox
import toolbox.context
import toolbox.data.crs
import toolbox.errors

ALIKE = {"algorithms.shared.parameters"}  # the module has an example that stands for each function
STEPS = {  # of find_terrain, each on what the one before gives
    f"algorithms.shared.terrain.{name}"
    for name in (
        "add_planes",
        "blocks_of",
        "ground_cells",
        "near_surface",
        "planes_through",
        "raised_share",
        "robust_surface",
        "steps_down",
        "votes_of_planes",
        "without_thin",
    )
}


def modules(*packages: ModuleType) -> list[str]:
    """Names of all modules in packages, but for those that only QGIS can import."""
    found = [
        module.name
        for package in packages
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    ]
    return [name for name in found if not name.startswith("toolbox.qgis.plugin")]


@pytest.mark.parametrize("name", ["toolbox", *modules(toolbox, algorithms)])
def test_examples_give_what_they_say(name: str) -> None:
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def offered() -> Iterator[tuple[str, object]]:
    """The functions and classes that the author of a tool may call, with their names."""
    for module in (toolbox.declare, toolbox.data):
        yield from ((f"{module.__name__}.{name}", vars(module)[name]) for name in module.__all__)
    shared = [m.name for m in pkgutil.iter_modules(algorithms.shared.__path__) if not m.ispkg]
    names = {f"algorithms.shared.{name}" for name in shared} - ALIKE
    for name in ("toolbox.context", "toolbox.errors", "toolbox.data.crs", *sorted(names)):
        for own, value in vars(importlib.import_module(name)).items():
            if getattr(value, "__module__", None) == name and not own.startswith("_"):
                yield f"{name}.{own}", value


def has_example(value: object) -> bool:
    """Whether a function, or a class or one of its methods, shows its use."""
    members = vars(value).values() if inspect.isclass(value) else ()
    return any(">>>" in (inspect.getdoc(thing) or "") for thing in (value, *members))


def test_what_a_tool_may_call_has_an_example() -> None:
    lacking = {
        name
        for name, value in offered()
        if (inspect.isclass(value) or inspect.isfunction(value)) and not has_example(value)
    }
    assert lacking == STEPS
