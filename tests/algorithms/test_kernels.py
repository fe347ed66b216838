"""Every function in algorithms has annotations, or is a kernel: numba compiles it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import algorithms

ROOT = Path(algorithms.__file__).parent
COMPILERS = {"njit", "helper"}  # helper is njit for functions that only kernels call


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda p: str(p.relative_to(ROOT)))
def test_only_kernels_have_no_annotations(path: Path) -> None:
    functions = (f for f in ast.walk(ast.parse(path.read_text())) if isinstance(f, ast.FunctionDef))
    bare = [
        f.name
        for f in functions
        if f.returns is None
        and not any(ast.unparse(d).split("(")[0] in COMPILERS for d in f.decorator_list)
    ]
    assert bare == []
