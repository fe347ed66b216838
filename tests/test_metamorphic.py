"""A hundred runs of `python -m tests.bench metamorphic`, and whether it would notice a failure."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.bench import metamorphic
from tests.bench.metamorphic import (
    CASES,
    MOST_CI,
    TRANSFORMATIONS,
    Run,
    failures,
    measures,
    outcome,
    planned,
)
from toolbox import catalog
from toolbox.data import Lattice, PointCloud, Raster
from toolbox.data.crs import LOCALS
from toolbox.errors import Cancelled, DataError

RUNS, PARTS = 100, 4  # of which workers take one each
CASE = {case.name: case for case in CASES}
WITHOUT = {  # tools that no change of a single cloud tells anything about
    "classify.apply": "needs a model of other points",
    "classify.ndvi": "reads images",
    "classify.som_apply": "needs a map of other points",
    "classify.train": "gives a model, whose draws change with the order of blocks",
    "classify.suggest": "gives places of patches of a grid, which turning and shifting change",
    "classify.vegetation_by_ndvi": "needs an image",
    "classify.water": "needs a polygon of water",
    "compare.areas": "compares layers",
    "compare.lines": "compares layers",
    "compare.planes": "compares layers",
    "compare.rasters": "compares layers",
    "compare.spans": "compares layers",
    "compare.surfaces": "compares layers",
    "corridor.clearance": "is a step of models.power_line_clearance",
    "corridor.label": "is a step of models.power_line_clearance",
    "corridor.surroundings": "is a step of models.power_line_clearance",
    "models.facade": "numbers its fronts and openings, which change with the points",
    "models.reservoir_storage": "is models.reservoir_shoreline and shoreline.storage_curve",
    "planes.drawing": "reads features",
    "planes.openings": "needs the number of a plane, which changes with the points",
    "planes.orthophoto": "needs fronts",
    "points.assign_crs": "needs points without a CRS",
    "points.feature_codes": "renames classes, point by point",
    "points.denoise_voxels": "counts in voxels of a lattice, which turning and shifting change",
    "points.index": "lists files",
    "points.merge": "joins files",
    "points.normalise": "gives the heights of points.height_above_ground",
    "points.retile": "writes the points as they are",
    "points.profile": "needs a line",
    "points.reproject": "needs places on the Earth, which turning and shifting change",
    "points.sample_raster": "needs an image",
    "points.survey_quality": "counts in cells of a grid, which turning and shifting change",
    "points.waveform": "reads one packet, which turning does not turn",
    "samples.scene": "reads nothing",
    "shoreline.storage_curve": "needs a basin",
    "surface.difference": "compares layers",
    "surface.flatten_water": "needs a polygon of water",
    "surface.land_cover": "gives cells of a grid, which turning and shifting change",
    "surface.reproject": "reads rasters",
    "vectors.clip": "reads features",
    "vectors.merge": "reads features",
    "vectors.reproject": "reads features",
}


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
def test_what_means_nothing_changes_nothing(part: int) -> None:
    found = failures(planned(RUNS, 0, ci=True)[part::PARTS])
    assert [f"{run.name}: {text}" for run, text in found] == []


def test_every_tool_is_run_or_there_is_a_reason_why_not() -> None:
    ids = {case.id for case in CASES}
    assert ids | WITHOUT.keys() == set(catalog.own_ids())
    assert not ids & WITHOUT.keys()
    assert len(CASE) == len(CASES)


@pytest.fixture
def town(monkeypatch: pytest.MonkeyPatch) -> Run:
    """A run on random points, whose order is changed."""
    xyz = np.random.default_rng(0).uniform(0, 30, (900, 3))
    points = PointCloud(xyz, {"classification": np.full(900, 2, np.uint8)}, name="town")
    monkeypatch.setattr(metamorphic, "loaded", lambda name, seed, most: points)
    return Run(CASE["points.denoise"], "town", "shuffled", 0, MOST_CI)


def told(run: Run, monkeypatch: pytest.MonkeyPatch, result: Any) -> str:
    """What is said of a tool that gives or raises this."""

    def done(case: Any, points: PointCloud) -> Any:
        made = result(points)
        if isinstance(made, BaseException):
            raise made
        return {"clean": made}

    monkeypatch.setattr(metamorphic, "done", done)
    metamorphic.before.cache_clear()
    return "; ".join(outcome(run)[1])


def test_mistakes_and_lost_points_are_told(town: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    assert told(town, monkeypatch, lambda points: points) == ""
    assert "a mistake in the toolbox: KeyError" in told(town, monkeypatch, lambda _: KeyError("a"))
    assert "does not end" in told(town, monkeypatch, lambda _: Cancelled())
    assert told(town, monkeypatch, lambda _: DataError("no points")) == ""
    half = told(town, monkeypatch, lambda points: points.select(np.arange(0, 900, 2)))
    assert half == "900 points became 450"


def test_a_result_that_goes_with_the_order_is_told(
    town: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def first_is_noise(points: PointCloud) -> PointCloud:
        classes = np.full(len(points), 2, np.uint8)
        classes[0] = 7
        return points.with_attributes({"classification": classes})

    text = told(town, monkeypatch, first_is_noise)
    assert text == "classification of 0.222% of points changed (limit 0.0%)"


def test_the_area_of_a_surface_that_fills_the_box_does_not_turn_with_it() -> None:
    """Points in a square: turned by 45 degrees, their box is twice as large."""
    x, y = np.random.default_rng(0).uniform(-10, 10, (2, 4000))
    square = PointCloud(np.column_stack([x, y, 0 * x]), crs=LOCALS["local"])
    turned = square.with_xyz(np.column_stack([x + y, x - y, 0 * x]) / np.sqrt(2))
    one, two = (
        dict(measures({"surface": filled_box(points)}, points))["surface, area in m2"]
        for points in (square, turned)
    )
    assert one == pytest.approx(400, rel=0.05)
    assert two == pytest.approx(one, rel=0.05)


def filled_box(points: PointCloud) -> Raster:
    low, high = np.reshape(points.bounds, (2, 3))[:, :2]
    lattice = Lattice.cover((*low, *high), 0.5)
    return Raster.from_lattice(np.zeros(lattice.shape, np.float32), lattice, crs=points.crs)


@pytest.mark.parametrize("name", TRANSFORMATIONS)
def test_transformations_can_be_repeated(town: Run, name: str) -> None:
    run = Run(town.case, "town", name, 0, MOST_CI)
    np.testing.assert_array_equal(run.points().xyz, run.points().xyz)
    assert len(run.points()) > 100
