"""models.power_line_clearance: from raw points to what is too close, and the real line of AHN4."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from pandas.testing import assert_frame_equal
from pyproj import CRS
from scenes import corridors as scenes
from scipy.spatial import cKDTree

import toolbox
from algorithms.corridor._clearance.objects import groups
from toolbox import catalog
from toolbox.data import PointCloud, Vector
from toolbox.errors import ParameterError
from toolbox.tiles.tiling import Tiling

MODEL = "models.power_line_clearance"
DATA = Path(os.environ.get("TOOLBOX_TEST_DATA", "/nowhere"))
TILES = DATA / "powerline_ahn4"
HILLS = DATA / "line_quebec_hills" / "west.laz"
TREES, CRANES = 5, 26  # classes of what was pasted under the line


@pytest.mark.slow
def test_a_tree_below_the_wires_is_found() -> None:
    curves, points, poles = scenes.line([0.0, 60.0, 120.0], [-1.0, 1.0], 10.0, 300.0)
    low = float(curves[0].height(np.array(30.0)))
    tree = scenes.tree(30.0, 1.0, low - 2.0, 1.5, 800)
    ground = scenes.ground(120.0, 60.0, 6.0)
    cloud = scenes.cloud(ground, *points, poles, tree)
    found = toolbox.run(MODEL, {"points": cloud, "distance": 4.0, "falling": False})
    frame = found["objects"].frame
    assert found["span_count"] == 2
    assert frame.clearance.to_list() == pytest.approx([2.0], abs=0.1)
    assert frame.geometry.x[0] == pytest.approx(scenes.CORNER[0] + 30, abs=1.5)
    assert found["critical_count"] == 1
    assert len(found["classified"]) == len(cloud)


def test_roads_that_the_file_knows_have_rules_of_their_own() -> None:
    """6.0 m are too little above a road, by ČSN EN 50423-1 for 22 kV, and enough above a field."""
    _, points, poles = scenes.line([0.0, 60.0, 120.0], [-1.0, 1.0], 8.2, 300.0)
    ground = scenes.ground(120.0, 40.0, 6.0)
    cloud = scenes.cloud(ground, *points, poles)
    road = np.arange(len(cloud)) < len(ground)
    road &= abs(cloud.xyz[:, 0] - scenes.CORNER[0] - 30) < 4
    values = {"rules": "en_50341", "voltage": 22, "falling": False}
    for kind, breached in ((11, {"cz-mv-road"}), (1, set())):
        classes = {"classification": np.where(road, kind, 1).astype(np.uint8)}
        found = toolbox.run(MODEL, {"points": cloud.with_attributes(classes), **values})
        assert set(found["objects"].frame["rule"]) == breached
        assert (found["classified"]["classification"][road] == (11 if breached else 2)).all()


def around_a_line(seed: int, *, returns: bool = True) -> PointCloud:
    """Two spans with a tree, a house, a crane and a stray point beside; truth."""
    rng = np.random.default_rng(seed)
    _, points, poles = scenes.line([0.0, 60.0, 120.0], [-1.0, 1.0], 10.0, 300.0)
    house = np.column_stack([rng.uniform((30, 14), (42, 22), (1500, 2)), np.full(1500, 6.0)])
    house[:, 2] += rng.normal(0, 0.02, 1500)
    crane = scenes.bar((90, -14, 0), (90, -14, 16), 40.0, 0.4, seed)
    tree = scenes.tree(30.0, -12.0, 9.0, 3.5, 1500, seed)
    ground = scenes.ground(120.0, 60.0, 6.0, seed)
    far = scenes.tree(60.0, -99.0, 9.0, 3.5, 800, seed)
    lawn = scenes.ground(120.0, 20.0, 6.0, seed) - np.array([0, 99.0, 0])
    cloud = scenes.cloud(
        ground, *points, poles, tree, house, crane, far, lawn,
        classes=[2, *[14] * len(points), 15, 5, 6, 26, 25, 2],
    )  # fmt: skip
    leaves = (np.isin(cloud["truth"], (5, 25))) & returns
    count = np.where(leaves, 2, 1).astype(np.uint8)
    number = np.where(leaves, rng.integers(1, 3, len(cloud)), 1).astype(np.uint8)
    ones = np.ones(len(cloud), np.uint8)
    return cloud.with_attributes(
        {"number_of_returns": count, "return_number": number, "classification": ones}
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_trees_and_buildings_near_the_line_are_told_apart(seed: int) -> None:
    """But not a crane, nor what is farther than a tree may fall."""
    cloud = around_a_line(seed)
    found = toolbox.run(MODEL, {"points": cloud, "distance": 15.0, "falling": False})
    classes, truth = found["classified"]["classification"], cloud["truth"]
    for true, told, least in ((5, (4, 5), 0.95), (6, (6,), 0.95), (26, (1,), 0.9), (25, (1,), 1)):
        assert np.isin(classes[truth == true], told).mean() >= least, true
    assert (classes[truth == 14] == 14).mean() > 0.95
    assert {"tree", "building"} <= set(found["objects"].frame["kind"])
    assert (found["classified"]["confidence"] <= 1).all()


def test_classes_of_the_file_stay_and_what_cannot_be_told_is_unclassified(
    caplog: pytest.LogCaptureFixture,
) -> None:
    cloud = around_a_line(2, returns=False)
    truth = cloud["truth"]
    given = np.where(truth == 6, 5, np.where(truth == 26, 64, 1)).astype(np.uint8)
    points = cloud.with_attributes({"classification": given})
    found = toolbox.run(MODEL, {"points": points, "distance": 15.0, "falling": False})
    classes = found["classified"]["classification"]
    assert (classes[given == 5] == 5).all()
    assert (classes[given == 64] == 64).mean() > 0.9  # its foot is ground
    assert (classes[truth == 5] == 1).all()
    assert "unclassified" in set(found["objects"].frame["kind"])
    assert "vegetation that the file does not name cannot be told" in caplog.text


def test_without_a_line_there_is_nothing_too_close(caplog: pytest.LogCaptureFixture) -> None:
    cloud = scenes.cloud(scenes.ground(60.0, 60.0, 3.0), scenes.tree(30, 0, 8, 2, 300))
    found = toolbox.run(MODEL, {"points": cloud, "rules": "thesis"})
    assert (found["span_count"], found["object_count"]) == (0, 0)
    assert "no power line was found" in caplog.text


def test_a_conductor_that_no_table_has_is_told_before_points_are_read(tmp_path: Path) -> None:
    bad = tmp_path / "points.las"
    bad.write_bytes(b"no points")
    with pytest.raises(ParameterError, match="no conductor 'Nosuch'"):
        toolbox.run(MODEL, {"points": bad, "rules": "thesis", "conductor": "Nosuch"})


def test_rules_that_want_a_voltage_say_so_before_points_are_read(tmp_path: Path) -> None:
    values = {"points": tmp_path / "none.laz", "rules": "ekaty", "spans": tmp_path / "s.csv"}
    with pytest.raises(ParameterError, match=r"clearance\.rules: .* give voltage"):
        toolbox.run(MODEL, values, tiling=Tiling(50.0, 1))
    with pytest.raises(ParameterError) as told:
        toolbox.run(MODEL, values | {"voltage": 34.5}, tiling=Tiling(50.0, 1))
    assert set(told.value.problems) == {"points"}


@pytest.mark.slow
@pytest.mark.skipif(not TILES.is_dir(), reason="the AHN4 power line is not there")
@pytest.mark.parametrize("tile", ["12AN2_20", "12BZ1_21"])
def test_all_that_was_pasted_near_the_line_is_found_and_nothing_else(tile: str) -> None:
    cloud = PointCloud.open(TILES / f"{tile}_as_published.laz", assume_crs=CRS(28992))
    found = toolbox.run(MODEL, {"points": cloud, "distance": 5.0, "falling": False})
    classes = np.asarray(cloud["classification"])
    pasted = np.flatnonzero(np.isin(classes, (TREES, CRANES)))
    number = groups(cloud.xyz[pasted], np.zeros(len(pasted), np.int64), 1.5)
    away = cKDTree(cloud.xyz[classes == 14]).query(cloud.xyz[pasted])[0]
    near = {int(k) for k in np.unique(number[away < 4.9])}
    bad = found["violations"]
    distance, own = cKDTree(cloud.xyz[pasted]).query(bad.xyz)
    assert near == {int(k) for k in np.unique(number[own[bad["object_id"] > 0]])}
    assert distance[bad["object_id"] > 0].max() < 0.01


@pytest.mark.slow
@pytest.mark.skipif(not HILLS.is_file(), reason="the line in the hills is not there")
def test_trees_on_real_hills_are_no_buildings_and_no_wire_is_missed() -> None:
    """Sparse crowns without return numbers have planes by chance; 6 % were buildings."""
    cloud = PointCloud.open(HILLS)
    blank = cloud.with_attributes({"classification": np.ones(len(cloud), np.uint8)})
    found = toolbox.run(MODEL, {"points": blank, "distance": 5.0, "falling": False})
    classes = np.asarray(found["classified"]["classification"])
    near = cKDTree(cloud.xyz[classes == 14, :2]).query(cloud.xyz[:, :2])[0] < 60
    trees = near & (cloud["classification"] == 5)
    assert (classes[trees] == 6).mean() < 0.01
    spans = found["spans"].frame
    assert len(spans) == 6
    assert spans.wire_like.sum() == 0


@pytest.fixture(scope="module")
def in_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two spans of 70 m with a tree below each, in three files, cut through both spans."""
    curves, points, poles = scenes.line([0.0, 70.0, 140.0], [-1.0, 1.0], 10.0, 300.0)
    trees = [
        scenes.tree(x, 1.0, float(curve.height(np.array(x - curve.x))) - 2.0, 1.5, 500)
        for x, curve in ((30.0, curves[0]), (101.0, curves[2]))
    ]
    cloud = scenes.cloud(scenes.ground(140.0, 50.0, 5.0), *points, poles, *trees)
    folder = tmp_path_factory.mktemp("survey")
    x = cloud.xyz[:, 0] - scenes.CORNER[0]
    for name, low, high in (("a", 31, 103), ("b", -99, 31), ("c", 103, 999)):
        part = cloud.select((x >= low) & (x < high))
        part.with_attributes({"classification": np.ones(len(part), np.uint8)}).save(
            folder / f"{name}.laz"
        )
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("size", [40.5, 90.0])
def test_tiles_smaller_than_a_span_give_what_the_whole_gives(
    size: float, in_files: Path, tmp_path: Path
) -> None:
    """Spans, wires, labels, violations and page are those of the cloud in one piece."""
    names = {
        "classified": "c.laz",
        "violations": "v.laz",
        "wires": "w.gpkg",
        "towers": "t.gpkg",
        "objects": "o.gpkg",
        "spans": "s.csv",
        "report": "r.html",
    }
    made: list[dict[str, Path]] = []
    numbers = []
    for where, tiling in (("whole", None), ("tiles", Tiling(size, 2))):
        (tmp_path / where).mkdir()
        made.append({name: tmp_path / where / file for name, file in names.items()})
        values = {"points": in_files, "rules": "ekaty", "voltage": 34.5, **made[-1]}
        found = toolbox.run(MODEL, values, tiling=tiling)
        numbers.append({name: found[name] for name in ("span_count", "object_count")})
    assert numbers[0] == numbers[1]
    assert numbers[0]["span_count"] == 2
    assert numbers[0]["object_count"] > 1
    whole, tiles = made
    for name in ("classified", "violations"):
        one, other = PointCloud.open(whole[name]), PointCloud.open(tiles[name])
        assert one.names == other.names
        np.testing.assert_array_equal(one.xyz, other.xyz)
        for attribute in one.names:
            loose = 1e-4 if attribute == "HeightAboveGround" else 0.0
            np.testing.assert_allclose(one[attribute], other[attribute], rtol=0, atol=loose)
    assert (PointCloud.open(whole["classified"])["classification"] == 14).sum() > 700
    for name in ("wires", "towers", "objects"):
        one, other = Vector.open(whole[name]).frame, Vector.open(tiles[name]).frame
        assert_frame_equal(one, other, check_exact=False, rtol=0, atol=1e-4)
    assert Vector.open(whole["wires"]).frame.equals(Vector.open(tiles["wires"]).frame)
    for name in ("spans", "report"):  # how it was made counts the cells of each tile
        one, other = (files[name].read_text().partition(">How it was made<") for files in made)
        assert one[0] == other[0]


def test_the_readme_says_in_which_state_wires_are_drawn() -> None:
    """Who opens the drawing could take them for the wires at their greatest sag."""
    drawn = [
        one.help
        for one in catalog.load("models.power_line_clearance").deliver
        if one.output == "wires" or one.file in ("line.kmz", "line.dxf")
    ]
    assert len(drawn) == 3
    assert all("as surveyed" in text for text in drawn)
