"""The tool that docs/CONTRIBUTING.md shows is a tool, and the test that it shows passes."""

from __future__ import annotations

import importlib.util
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from toolbox.declare.spec import REGISTRY

PAGE = (Path(__file__).parents[1] / "docs" / "CONTRIBUTING.md").read_text("utf-8")
TOOL, TEST = (textwrap.dedent(code) for code in re.findall(r"```python\n(.*?)```", PAGE, re.S))
NAME = "algorithms.points.higher"


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The tool under the name that it would have in its folder."""
    path = tmp_path / "higher.py"
    path.write_text(TOOL, "utf-8")
    spec = importlib.util.spec_from_file_location(NAME, path)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, NAME, made)
    spec.loader.exec_module(made)
    yield made
    REGISTRY.pop("points.higher")


def test_the_skeleton_is_short_and_declares_a_tool(module: ModuleType) -> None:
    assert len([line for line in TOOL.splitlines() if line.strip()]) <= 32
    assert module.PointsHigher.spec.inputs["elevation"].unit == "m"


def test_its_test_passes(module: ModuleType) -> None:
    names: dict[str, Any] = {}
    exec(compile(TEST, "test_higher.py", "exec"), names)
    tests = [value for name, value in names.items() if name.startswith("test_")]
    assert len(tests) == 1
    tests[0]()
