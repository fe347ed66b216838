"""The plugin on Qt 6, as QGIS 4 has it: enums written in full, and its code run under PyQt6.

The second needs PyQt6, in this Python or in that which TOOLBOX_TEST_QT6 names.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from toolbox.qgis import install as qgis_install
from toolbox.qgis.install import SOURCE

TESTS = Path(__file__).parents[2] / "qgis"
TRIAL = Path(__file__).with_name("qt6_trial.py")
PYTHON = os.environ.get("TOOLBOX_TEST_QT6", sys.executable)
FILES = [*SOURCE.glob("*.py"), *(TESTS / n for n in ("person.py", "dialogs.py", "inside.py"))]


def spelt_for_qt5(code: str) -> list[str]:
    """What PyQt6 does not know: enums without their class, such as Qt.LeftButton, and exec_()."""
    tree = ast.parse(code)
    imported = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("qgis.")
        for alias in node.names
    }
    whole = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    whole |= {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    return list(_short(tree, imported, whole))


def _short(tree: ast.AST, imported: set[str], whole: set[int]) -> Iterator[str]:
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute):
            continue
        owner = node.value
        if node.attr == "exec_":
            yield ast.unparse(node)
        elif isinstance(owner, ast.Name) and owner.id in imported and id(node) not in whole:
            constant = node.attr.isupper()  # such as QgsProcessing.TEMPORARY_OUTPUT
            enum_class = owner.id == "QgsMapLayerType"  # is an enum itself
            if node.attr[0].isupper() and not constant and not enum_class:
                yield ast.unparse(node)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_enums_are_written_in_full(path: Path) -> None:
    assert spelt_for_qt5(path.read_text(encoding="utf-8")) == []


def test_short_enums_are_found() -> None:
    code = "from qgis.PyQt.QtCore import Qt\nfrom qgis.core import QgsA\n"
    assert spelt_for_qt5(code + "a = Qt.LeftButton\n") == ["Qt.LeftButton"]
    assert spelt_for_qt5(code + "a = Qt.MouseButton.LeftButton\n") == []
    assert spelt_for_qt5(code + "a(QgsA.NoError)\n") == ["QgsA.NoError"]
    assert spelt_for_qt5(code + "a = QgsA.Options(1)\n") == []
    assert spelt_for_qt5(code + "a.exec_()\n") == ["a.exec_"]


def test_the_code_runs_under_qt6(tmp_path: Path) -> None:
    """Every module is imported, every parameter made, every widget shown and pressed."""
    has = subprocess.run([PYTHON, "-c", "import PyQt6.QtWidgets"], capture_output=True, check=False)
    if has.returncode:
        pytest.skip("there is no PyQt6; TOOLBOX_TEST_QT6 may name a Python that has it")
    plugin = tmp_path / "lidar_toolbox"
    for name, text in qgis_install.contents().items():
        (plugin / name).parent.mkdir(parents=True, exist_ok=True)
        (plugin / name).write_text(text, encoding="utf-8")
    done = subprocess.run(
        [PYTHON, str(TRIAL), str(tmp_path)],
        env=os.environ | {"QT_QPA_PLATFORM": "offscreen", "HOME": str(tmp_path)},
        capture_output=True,
        encoding="utf-8",
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    told = json.loads(done.stdout)
    assert told["qt"].startswith("6.")
    assert told["tools"] > 70
    assert told["widgets"] > 400
    assert told["pressed"] == ["Classes", "Names", "Attribute", "CRS", "Files", "settings"]
