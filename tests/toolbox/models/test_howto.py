"""The examples of docs/howto/write-a-model.md run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from toolbox import catalog
from toolbox.data import PointCloud, Raster
from toolbox.execute import run

PAGE = (Path(__file__).parents[3] / "docs" / "howto" / "write-a-model.md").read_text("utf-8")
MODELS = re.findall(r"```yaml\n(.*?)```", PAGE, re.S)
COMMANDS = re.findall(r"```sh\n(.*?)```", PAGE, re.S)


@pytest.fixture
def town(tmp_path: Path) -> Path:
    scene = {"kind": "town", "size": 60.0, "density": 4.0}
    run("samples.scene", scene | {"points": tmp_path / "town.laz"})
    return tmp_path / "town.laz"


def test_models_are_models(tmp_path: Path) -> None:
    assert len(MODELS) == 4
    for text in MODELS:
        (tmp_path / "m.yaml").write_text(text, "utf-8")
        assert catalog.load(str(tmp_path / "m.yaml")).id.startswith("my.")


def test_repeated_outputs_are_numbered(town: Path, tmp_path: Path) -> None:
    (tmp_path / "p.yaml").write_text(MODELS[2], "utf-8")
    run(str(tmp_path / "p.yaml"), {"points": town, "dtm": tmp_path / "dtm.tif", "cells": [2, 4]})
    assert [Raster.open(tmp_path / f"dtm_{i}.tif").cell for i in (1, 2)] == [2.0, 4.0]


@pytest.mark.slow
def test_commands_work(town: Path, tmp_path: Path) -> None:
    """Those of the starter, and then the batch on the first model of the page."""
    town.unlink()  # the page makes it itself
    shell = ["bash", "-euc"]
    programs = {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    where = {"cwd": tmp_path, "env": os.environ | programs | {"TOOLBOX_HISTORY": ""}}
    subprocess.run([*shell, COMMANDS[0]], check=True, capture_output=True, **where)  # type: ignore[call-overload]
    assert (tmp_path / "starter.md").exists()
    assert len(PointCloud.open(town)) > 0
    (tmp_path / "heights.yaml").write_text(MODELS[0], "utf-8")
    subprocess.run([*shell, COMMANDS[1]], check=True, capture_output=True, **where)  # type: ignore[call-overload]
    assert (tmp_path / "result.csv").read_text().count(",done,") == 2
    assert Raster.open(tmp_path / "coarse.tif").cell == 5
