"""A layer in whose coordinates a later step cannot measure is found before the first step runs."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from toolbox import catalog
from toolbox.context import Context
from toolbox.data import PointCloud
from toolbox.data.crs import parse_crs
from toolbox.errors import DataError
from toolbox.models.model import run_tool

MODEL = """
id: toy.third
title: Third
inputs:
  points: {type: PointCloud, help: Points}
steps:
  low: {tool: points.filter, points: {from: inputs.points}, where: "z < 5"}
  CHANGE
  bottom: {tool: surface.grid, points: {from: LAST}, cell: 2.0}
outputs:
  dtm: {from: bottom.surface}
"""
SAME = "high: {tool: points.filter, points: {from: low.kept}, where: z > 0}"
METRES = (
    "high: {tool: points.reproject, points: {from: low.kept}, crs: EPSG:32635, "
    "missing_grid: next_best}"
)


def job(tmp_path: Path, change: str, last: str, crs: str | None, names: list[str]) -> Any:
    """A run of the model, which notes the names of the steps that run."""
    path = tmp_path / "third.yaml"
    path.write_text(MODEL.replace("CHANGE", change).replace("LAST", last))
    xyz = np.column_stack([27 + np.arange(9) / 1e4, 40 + np.arange(9) ** 2 / 1e5, np.ones(9)])
    cloud = PointCloud(xyz, crs=parse_crs(crs) if crs else None, name="a.laz")

    def noted(name: str, tool: Any, ctx: Context) -> Any:
        names.append(name)
        return run_tool(name, tool, ctx)

    return dataclasses.replace(catalog.load(str(path)).build({"points": cloud}), runner=noted)


@pytest.mark.parametrize("crs", [None, "EPSG:4326"])
def test_no_step_runs_if_a_later_one_cannot_measure(tmp_path: Path, crs: str | None) -> None:
    names: list[str] = []
    with pytest.raises(DataError, match=r"points: a.laz .*\(step 'bottom' measures lengths\)"):
        job(tmp_path, SAME, "high.kept", crs, names).run()
    assert names == []


def test_a_step_may_bring_the_points_to_metres(tmp_path: Path) -> None:
    names: list[str] = []
    job(tmp_path, METRES, "high.reprojected", "EPSG:4326", names).run()
    assert names == ["low", "high", "bottom"]
