"""models.reservoir_shoreline: the lake of a synthetic survey, and the way of the Kestel study."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely

import toolbox
from algorithms.shoreline.extract import ShorelineExtract
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Table, Vector
from toolbox.data.crs import parse_crs
from toolbox.errors import ParameterError

MODEL = "models.reservoir_shoreline"
CRS = parse_crs("EPSG:32635")
LAKE = shapely.Point(500_060, 4_600_060).buffer(35, quad_segs=32)


@pytest.fixture
def bowl() -> PointCloud:
    """A round lake at 93.7 m in a bowl; the water gives few and dark returns."""
    rng = np.random.default_rng(3)
    xy = rng.uniform(0, 120, (60_000, 2))
    away = np.hypot(*(xy - 60).T) - 35
    z = 93.7 + 0.15 * away + rng.normal(0, 0.02, len(xy))
    water = away < 0
    z[water] = 93.7
    seen = ~water | (rng.uniform(size=len(xy)) < 0.05)
    intensity = np.where(water, 12, 300 + rng.integers(0, 200, len(xy))).astype(np.uint16)
    xyz = np.column_stack([xy[:, 0] + 500_000, xy[:, 1] + 4_600_000, z])
    return PointCloud(xyz[seen], {"intensity": intensity[seen]}, crs=CRS, name="bowl.laz")


@pytest.fixture
def chart() -> Vector:
    """A map of two lakes, one of them beyond the points."""
    other = shapely.Point(502_000, 4_600_060).buffer(20)
    return Vector(geopandas.GeoDataFrame(geometry=[LAKE, other], crs=CRS), name="map.gpkg")


def iou(water: Vector) -> float:
    (shape,) = shapely.force_2d(water.frame.geometry.to_numpy())
    return float(shape.intersection(LAKE).area / shape.union(LAKE).area)


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "least"), [("default", 0.985), ("thesis", 0.92)])
def test_lake_of_a_bowl(bowl: PointCloud, chart: Vector, preset: str, least: float) -> None:
    found = toolbox.run(MODEL, {"points": bowl, "reference": chart, "preset": preset})
    assert iou(found["water"]) > least
    rows = found["table"].frame.set_index("measure")["value"]
    assert rows["iou"] == pytest.approx(100 * iou(found["water"]), abs=1e-6)
    assert found["area"] == pytest.approx(LAKE.area, rel=0.08)
    lines = found["shoreline"].frame
    assert lines.length.sum() == pytest.approx(LAKE.length, rel=0.3)
    assert found["level"] == pytest.approx(93.7, abs=0.01 if preset == "default" else 0.2)


@pytest.mark.slow
def test_stages_are_counted_and_layers_stand_together(bowl: PointCloud, tmp_path: Path) -> None:
    place = tmp_path / "lake.gpkg"
    values = {
        "points": bowl,
        "preset": "thesis",
        "extent": (500_010, 4_600_010, 500_110, 4_600_110),
    }
    toolbox.run(MODEL, {**values, "water": place, "shoreline": place, "counts": place})
    assert set(Vector.layers(place)) == {"water", "shoreline"}
    rows = Table.open(place, layer="counts").frame
    stages = rows[rows["name"].isin(["clipped", "kept", "clean", "thinned", "inliers"])]
    assert stages["step"].to_list() == ["part", "bright", "clean", "thin", "band", "plane"]
    assert stages["count"].is_monotonic_decreasing
    assert stages["count"].iloc[-1] > 50


def test_numbers_of_the_study_that_do_not_fit_are_told(
    bowl: PointCloud, caplog: pytest.LogCaptureFixture
) -> None:
    scaled = bowl.with_attributes({"intensity": bowl["intensity"] * np.uint16(100)})
    corner = np.hypot(*(scaled.xyz[:, :2] - (500_000, 4_600_000)).T) < 4
    deep = scaled.with_xyz(scaled.xyz - 20 * np.outer(corner, (0, 0, 1)))
    values = {"points": deep, "preset": "thesis", "seed_point": (500_060, 4.6e6)}
    with caplog.at_level("WARNING", "toolbox"):
        toolbox.run(MODEL, values)
    assert "minimum: 40 is far below all intensities, which begin at 1200" in caplog.text
    assert "lie in the band above the lowest, which is at 8" in caplog.text
    assert "seed_point: is not used by any step that runs" in caplog.text
    caplog.clear()
    toolbox.run(MODEL, {**values, "points": bowl, "intensity": 100, "seed_point": None})
    assert "minimum" not in caplog.text
    assert "band" not in caplog.text
    assert "not used" not in caplog.text


def test_a_preset_that_there_is_not(bowl: PointCloud) -> None:
    with pytest.raises(ParameterError, match="preset: must be one of default, thesis"):
        toolbox.run(MODEL, {"points": bowl, "preset": "theses"})


def test_a_survey_is_not_read_into_memory_at_once(
    bowl: PointCloud, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where every step that reads the points can do so piece by piece."""
    west = bowl["x"] < 500_060
    for number, half in enumerate((west, ~west)):
        bowl.select(half).save(tmp_path / f"{number}.laz")
    seen: list[str] = []
    run = ShorelineExtract.run

    def watched(self: ShorelineExtract, ctx: Context = QUIET) -> Any:
        seen.append(type(self.points).__name__)
        return run(self, ctx)

    monkeypatch.setattr(ShorelineExtract, "run", watched)
    whole = toolbox.run(MODEL, {"points": bowl})
    parts = toolbox.run(MODEL, {"points": tmp_path})
    part = toolbox.run(MODEL, {"points": tmp_path, "extent": (5e5, 4.6e6, 500_120, 4_600_120)})
    assert seen == ["PointCloud", "Survey", "PointCloud"]
    assert parts["area"] == pytest.approx(whole["area"], rel=1e-3)
    assert part["area"] == pytest.approx(whole["area"], rel=1e-3)
