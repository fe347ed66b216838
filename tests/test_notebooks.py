"""The notebooks of the documentation run, and show pictures and tables."""

from __future__ import annotations

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted(Path(__file__).resolve().parents[1].glob("docs/notebooks/*.ipynb"))


def test_there_are_some_without_results_of_an_earlier_run() -> None:
    assert len(NOTEBOOKS) == 3
    cells = [cell for path in NOTEBOOKS for cell in nbformat.read(path, as_version=4).cells]
    assert not any(cell.get("outputs") for cell in cells)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs_and_shows_something(path: Path, tmp_path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    where = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources=where).execute()
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    shown = [kind for out in outputs for kind in out.get("data", {})]
    assert shown.count("image/png") >= 2
    assert shown.count("text/html") >= 2
    told = [out["text"] for out in outputs if out.get("name") == "stderr"]  # what tools warn of
    assert not [text for text in told if re.search(r"Warning\b|Error\b|Traceback", text)]
    assert list(tmp_path.iterdir()) == []
