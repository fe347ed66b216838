"""points.reproject: there and back, steps, tiles, units of attributes."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import rasterio
from affine import Affine
from pyproj import CRS
from scenes.layers import cloud

import toolbox
from algorithms.points.reproject import PointsReproject
from toolbox.cli.replay import replay
from toolbox.data import PointCloud, Survey
from toolbox.data.crs import same_crs
from toolbox.data.record import read_record
from toolbox.errors import DataError
from toolbox.tiles.tiling import Tiling

FEET = CRS(2263)


def scattered(count: int = 500, **more: object) -> PointCloud:
    rng = np.random.default_rng(4)
    xyz = rng.uniform((500_000, 4_600_000, 0), (500_900, 4_600_700, 80), (count, 3)).round(3)
    return cloud(xyz, 2, intensity=np.arange(count) % 60_000, **more)


def test_the_record_tells_which_geoid_it_was(tmp_path: Path) -> None:
    """By its hash, so that another file of its name is noticed."""
    values = {"crs": "EPSG:32635+5773", "geoid": tmp_path / "geoid.tif"}
    scattered(crs=CRS("EPSG:32635").to_3d()).save(tmp_path / "a.laz")
    write_geoid(tmp_path / "geoid.tif", 30.0)
    out = {"points": tmp_path / "a.laz", "reprojected": tmp_path / "b.laz"}
    toolbox.run("points.reproject", {**values, **out})
    record = json.loads(read_record(tmp_path / "b.laz"))
    digest = hashlib.sha256((tmp_path / "geoid.tif").read_bytes()).hexdigest()
    assert digest in json.dumps(record["inputs"])
    assert record["parameters"]["geoid"] == "geoid.tif"
    assert replay(tmp_path / "b.laz") == []
    write_geoid(tmp_path / "geoid.tif", 31.0)
    with pytest.raises(DataError, match=r"geoid\.tif .* has changed since"):
        replay(tmp_path / "b.laz")


def test_a_kept_result_is_of_the_same_geoid(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv("TOOLBOX_CACHE", str(tmp_path / "cache"))
    points = scattered(crs=CRS("EPSG:32635").to_3d())
    values = {"points": points, "crs": "EPSG:32635+5773", "geoid": str(tmp_path / "geoid.tif")}
    found = []
    for height in (30.0, 31.0):
        write_geoid(tmp_path / "geoid.tif", height)
        found.append(toolbox.run("points.reproject", values, resume=True)["reprojected"]["z"])
    np.testing.assert_allclose(found[0] - found[1], 1.0, atol=2e-3)


def write_geoid(path: Path, height: float) -> None:
    """The same height everywhere around 27 E and 41.5 N."""
    profile = {"driver": "GTiff", "height": 30, "width": 30, "count": 1, "dtype": "float32"}
    place = Affine(0.1, 0, 25.5, 0, -0.1, 43.0)
    with rasterio.open(path, "w", **profile, crs="EPSG:4326", transform=place) as sink:
        sink.write(np.full((30, 30), height, np.float32), 1)


@pytest.mark.parametrize("crs", ["EPSG:32636", "EPSG:4326", "EPSG:3857", "EPSG:25835"])
def test_through_files_and_back_within_a_millimetre(tmp_path: Path, crs: str) -> None:
    first = tmp_path / "a.laz"
    scattered().save(first)
    there = toolbox.run(
        "points.reproject", {"points": first, "crs": crs, "reprojected": tmp_path / "b.laz"}
    )
    toolbox.run(
        "points.reproject",
        {"points": there["reprojected"], "crs": "EPSG:32635", "reprojected": tmp_path / "c.laz"},
    )
    back, before = PointCloud.open(tmp_path / "c.laz"), PointCloud.open(first)
    assert np.linalg.norm(back.xyz - before.xyz, axis=1).max() < 0.001
    np.testing.assert_array_equal(back["intensity"], before["intensity"])
    there_again = PointCloud.open(tmp_path / "b.laz")
    assert same_crs(there_again.crs, CRS(crs))
    np.testing.assert_array_equal(there_again.xyz[:, 2], before.xyz[:, 2])  # exactly


def test_steps_suit_the_target(tmp_path: Path) -> None:
    path = tmp_path / "b.laz"
    PointsReproject(points=scattered(), crs=CRS(4326)).run().reprojected.save(path)
    with laspy.open(path) as file:
        np.testing.assert_allclose(file.header.scales[:2], 1e-9)  # 0.1 mm, half of 1 mm or less
        assert file.header.offsets[:2].tolist() == [27, 41]


def test_feet_become_metres_with_their_attributes() -> None:
    points = scattered(crs=CRS("EPSG:2263+6360")).with_xyz([[1e6, 2e5, 100.0]] * 500)
    heights = np.full(500, 10, np.float32)
    points = points.with_attributes(
        {"HeightAboveGround": heights, "score": heights},
        descriptions={"HeightAboveGround": "above ground, US survey foot"},
    )
    moved = PointsReproject(points=points, crs=CRS("EPSG:26918+5703")).run().reprojected
    assert moved.xyz[0, 2] == pytest.approx(30.48006, abs=1e-5)
    assert moved["HeightAboveGround"][0] == pytest.approx(3.048006, abs=1e-6)
    assert moved.descriptions["HeightAboveGround"] == "above ground, metre"
    assert moved["score"][0] == 10


def test_tiles_choose_the_operation_of_the_whole(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    points = scattered()
    for number, half in enumerate([points["x"] < 500_400, points["x"] >= 500_400]):
        points.select(half).save(tmp_path / "in" / f"{number}.laz")
    values = {"points": tmp_path / "in", "crs": "EPSG:4326"}
    tiling = Tiling(size=200.0, workers=1)
    toolbox.run("points.reproject", {**values, "reprojected": tmp_path / "t.laz"}, tiling=tiling)
    toolbox.run("points.reproject", {**values, "reprojected": tmp_path / "w.laz"})
    tiles, whole = PointCloud.open(tmp_path / "t.laz"), PointCloud.open(tmp_path / "w.laz")
    np.testing.assert_allclose(tiles.xyz, whole.xyz, rtol=0, atol=1.01e-9)
    survey = Survey.open(tmp_path / "in")
    assert survey.template.extent == survey.bounds
    assert survey.read(bounds=(5e5, 4.6e6, 500_100, 4_600_100)).extent == survey.bounds


def test_what_was_done_is_told() -> None:
    rows = PointsReproject(points=scattered(), crs=CRS(25835)).run().operation.frame
    found = dict(zip(rows["property"], rows["value"], strict=True))
    assert found["to"].startswith("EPSG:25835")
    assert "ETRS89 to WGS 84 (1)" in found["operation"]
    assert float(found["accuracy"]) == 1.0


def test_no_crs_is_an_error_that_says_what_to_do() -> None:
    with pytest.raises(DataError, match=r"points: a\.laz: has no CRS; .*points\.assign_crs"):
        PointsReproject(points=scattered(crs=None), crs=CRS(32635)).run()


def test_differing_layers_name_the_command_that_mends_it() -> None:
    other = scattered(crs=CRS(32636), name="b.laz")
    text = r"b\.laz is in EPSG:32636 .*\(points\.reproject --crs EPSG:32635\)"
    with pytest.raises(DataError, match=text):
        PointCloud.concat([scattered(), other])
