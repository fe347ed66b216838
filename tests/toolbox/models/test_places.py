"""A layer with whose coordinates a later step cannot work is found before the first step runs."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely

from toolbox import catalog
from toolbox.context import Context
from toolbox.data import PointCloud, Vector
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


MEETING = """
id: toy.meeting
title: Meeting
inputs:
  points: {type: PointCloud, help: Points}
  area: {type: Vector, help: Area}
steps:
  low: {tool: points.filter, points: {from: inputs.points}, where: "z < 5"}
  STEP
  part: {tool: points.clip, points: {from: low.kept}, polygons: {from: LAST}}
outputs:
  part: {from: part.clipped}
"""
THERE = (
    "there: {tool: vectors.reproject, features: {from: inputs.area}, crs: EPSG:32635, "
    "missing_grid: next_best}"
)


def meeting(tmp_path: Path, step: str, last: str, crs: str, names: list[str]) -> Any:
    """A run of a model whose points in EPSG:32635 meet an area in another CRS in a later step."""
    path = tmp_path / "meeting.yaml"
    path.write_text(MEETING.replace("STEP", step).replace("LAST", last))
    xyz = np.column_stack([5e5 + np.arange(9.0), 4.4e6 + np.arange(9.0), np.ones(9)])
    cloud = PointCloud(xyz, crs=parse_crs("EPSG:32635"), name="a.laz")
    square = geopandas.GeoSeries([shapely.box(5e5 - 9, 4.4e6 - 9, 5e5 + 9, 4.4e6 + 9)], crs=32635)
    area = Vector(geopandas.GeoDataFrame(geometry=square.to_crs(crs)), name="area.gpkg")

    def noted(name: str, tool: Any, ctx: Context) -> Any:
        names.append(name)
        return run_tool(name, tool, ctx)

    model = catalog.load(str(path)).build({"points": cloud, "area": area})
    return dataclasses.replace(model, runner=noted)


def test_no_step_runs_if_inputs_of_other_crs_meet_in_a_later_one(tmp_path: Path) -> None:
    names: list[str] = []
    with pytest.raises(DataError, match=r"area.gpkg is in EPSG:32636 .*\(step 'part' takes both\)"):
        meeting(tmp_path, "", "inputs.area", "EPSG:32636", names).run()
    assert names == []


@pytest.mark.parametrize(
    ("step", "last", "crs"),
    [("", "inputs.area", "EPSG:32635"), (THERE, "there.reprojected", "EPSG:32636")],
)
def test_inputs_that_a_step_brings_to_one_crs_may_meet(
    tmp_path: Path, step: str, last: str, crs: str
) -> None:
    names: list[str] = []
    assert len(meeting(tmp_path, step, last, crs, names).run().part) == 9
    assert names[-1] == "part"
