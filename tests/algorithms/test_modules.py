"""What holds for all modules of algorithms, and import-linter and mypy cannot be told."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import algorithms

ROOT = Path(algorithms.__file__).parent
COMPILERS = {"kernel", "helper", "inlined", "exact_sums", "rough_sums"}

each_module = pytest.mark.parametrize(
    "path", sorted(ROOT.rglob("*.py")), ids=lambda path: str(path.relative_to(ROOT))
)


@each_module
def test_only_kernels_have_no_annotations(path: Path) -> None:
    functions = (f for f in ast.walk(ast.parse(path.read_text())) if isinstance(f, ast.FunctionDef))
    bare = [
        f.name
        for f in functions
        if f.returns is None
        and not any(ast.unparse(d).split("(")[0] in COMPILERS for d in f.decorator_list)
    ]
    assert bare == []


@each_module
def test_only_one_module_asks_numba_to_compile(path: Path) -> None:
    text = path.read_text()
    assert "njit" not in text or path.name == "compiling.py"  # which keeps the names apart


@each_module
def test_no_module_imports_a_tool(path: Path) -> None:
    imported = [
        (*node.module.split("."), alias.name)
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    ]
    lent = [".".join(name) for name in imported if name[0] == "algorithms" and _is_of_tool(name)]
    assert lent == []  # give it to algorithms.shared, or to a private module of the theme


def _is_of_tool(name: tuple[str, ...]) -> bool:
    """Modules of a theme are its tools, but for those whose name begins with an underscore."""
    return name[1] != "shared" and not any(part.startswith("_") for part in name)
