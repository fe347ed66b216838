"""models.reservoir_storage: the curve of the lake that is there; without one, an error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import shapely
from pyproj import CRS
from scipy import ndimage

import toolbox
from algorithms.samples.scene import SamplesScene
from algorithms.shared.polygons import cells_within
from toolbox.cli.main import main
from toolbox.data import Lattice, PointCloud, Raster, Vector


@pytest.fixture(scope="module")
def lake() -> PointCloud:
    return SamplesScene(kind="reservoir", size=160.0, density=2.0).run().points


def behind_the_dam(bed: Raster, ponds: Any, level: float, top: float, size: float) -> float:
    """True volume between two levels north of the crest, from the cells of the bed."""
    lattice = Lattice.of(bed)
    z = bed.band().astype(float)
    for shape, water in zip(ponds.geometry, ponds["level"], strict=True):
        rows, cols = cells_within(shapely.force_2d(shape), lattice)
        z[rows, cols] = np.maximum(z[rows, cols], water)  # depth below their level is not seen
    north = lattice.centres()[1] - (lattice.north - size) > 0.25 * size
    bodies, _ = ndimage.label((z < top) & north[:, None], np.ones((3, 3)))
    lake = bodies == 1 + np.argmax(np.bincount(bodies.ravel())[1:])
    depth = np.where(lake, top - np.maximum(z, level), 0.0)
    return float(depth.sum() * lattice.cell**2)


@pytest.mark.slow
def test_the_curve_holds_what_lies_behind_the_dam_and_ends_at_its_crest() -> None:
    """Seeds and sizes that nothing was chosen on."""
    for seed, size in ((11, 140.0), (12, 200.0)):
        made = SamplesScene(kind="reservoir", size=size, seed=seed).run()
        found = toolbox.run("models.reservoir_storage", {"points": made.points})
        crest = 500 + min(3.0, 0.25 * min(14.0, 0.07 * size))
        assert found["spill"] == pytest.approx(crest, abs=0.05)
        place = found["spill_point"].frame.geometry.iloc[0]
        south = Lattice.of(made.terrain).north - size
        assert place.y - south == pytest.approx(0.25 * size, abs=4.0), "on the dam"
        frame, features = found["curve"].frame, made.features.frame
        assert frame["level_m"].iloc[-1] == found["spill"]
        assert not frame["overtopped"].any()
        ponds = features[features["body"] == "pond"]
        for row in frame.iloc[1:].itertuples():
            true = behind_the_dam(made.terrain, ponds, found["level"], row.level_m, size)
            assert row.volume_low_m3 < true < row.volume_high_m3
            # A level of a few decimetres holds little, of which the shore in cells is a large part.
            near = row.level_m - found["level"] < 0.5
            assert row.volume_m3 == pytest.approx(true, rel=0.02 if near else 0.01)


@pytest.mark.slow
def test_the_curve_begins_with_the_lake_whatever_the_order_of_the_points(lake: PointCloud) -> None:
    before = lake.xyz.copy()
    found = toolbox.run("models.reservoir_storage", {"points": lake, "highest": 506.0})
    np.testing.assert_array_equal(lake.xyz, before)
    frame = found["curve"].frame
    assert frame["level_m"].iloc[0] == pytest.approx(found["level"], abs=0.01)
    assert frame["area_m2"].iloc[0] == pytest.approx(found["water_area"], rel=0.03)
    assert (np.diff(frame["volume_m3"]) > 0).all()
    order = np.random.default_rng(1).permutation(len(lake))
    values = {"points": lake.select(order), "highest": 506.0}
    again = toolbox.run("models.reservoir_storage", values)["curve"].frame
    np.testing.assert_allclose(again["volume_m3"], frame["volume_m3"], rtol=1e-9)


@pytest.mark.slow
def test_the_set_tells_the_error_of_heights_and_shows_other_waters(tmp_path: Path) -> None:
    """Other waters were told in words alone, and a level seemed to be known to a millimetre."""
    out = tmp_path / "out"
    made = SamplesScene(kind="reservoir", size=160.0, density=2.0, seed=1).run()
    found = toolbox.run("models.reservoir_storage", {"points": made.points, "deliver": out})
    text = " ".join((out / "README.txt").read_text().split())
    assert "Common error of heights 0.05 m" in text
    assert text.partition("Result ------ - ")[2].startswith("At a level of")
    assert f"is known to ± {found['level_uncertainty']:.3f} m (95 %)" in text
    assert "(standard error 0.05 m), where the shore may lie" in text
    assert "They are for a level that a gauge tells" in text
    assert f"That is known to ± {found['rim_interval']:.2f} m (95 %) by the error" in text
    assert f"it holds {found['rim_volume']:.0f} m³" in text
    assert found["rim_interval"] > 0.0979
    assert "That error, 0.05 m, is an assumption unless it was given for this survey" in text
    assert "AHN" not in text, "a survey of another country"
    assert found["level_uncertainty"] > 0.0979 > found["level_interval"]
    assert ".fields.csv" in text
    assert len(Vector.open(out / "water.gpkg", layer="other_waters").frame) >= 1
    drawn = {entity.dxf.layer for entity in ezdxf.readfile(out / "contours.dxf").modelspace()}
    assert {"contours", "contours_labels", "shoreline", "other_waters", "spill_point"} <= drawn
    ponds = Vector.open(out / "water.gpkg", layer="other_bodies").frame
    assert {"level", "level_interval", "area"} <= set(ponds)
    terrain = Raster.open(out / "terrain.tif")
    lines = Vector.open(out / "water.gpkg", layer="contours").frame.geometry
    for shape, level in zip(shapely.force_2d(ponds.geometry), ponds["level"], strict=True):
        rows, cols = cells_within(shape, Lattice.of(terrain))
        np.testing.assert_allclose(terrain.band()[rows, cols], level, atol=1e-3)
        assert not lines.intersects(shape.buffer(-1.0)).any(), "lines run between cells of 1 m"
    page = (out / "report.html").read_text()
    data = page.partition('type="application/json">')[2].partition("</script>")[0]
    (others,) = (one for one in json.loads(data)["layers"] if one["name"] == "Other waters")
    assert all(group["thin"] and group["shape"] == "line" for group in others["groups"])


def test_a_survey_without_a_lake_is_an_error_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 60, (2, 9000))
    xyz = np.column_stack([x + 5e5, y + 4.4e6, 100 + 0.2 * x + rng.normal(0, 0.03, 9000)])
    PointCloud(xyz, crs=CRS(32635)).save(tmp_path / "slope.laz")
    out = tmp_path / "out"
    words = ["--points", str(tmp_path / "slope.laz"), "--deliver", str(out)]
    assert main(["run", "models.reservoir_storage", *words]) == 3
    assert "lake: holds no water" in capsys.readouterr().err
    assert not out.exists()
