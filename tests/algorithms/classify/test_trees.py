"""classify.trees: known crowns, dips between them, a town, units, bad input."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS
from scipy.spatial import cKDTree

from algorithms.classify.trees import ClassifyTrees, trees
from algorithms.samples.scene import SamplesScene
from tests.scenes.layers import cloud
from toolbox.data import PointCloud
from toolbox.declare import ClassList
from toolbox.errors import DataError, NothingToDo

Crown = tuple[float, float, float, float]  # x, y, radius, height
PAIR: list[Crown] = [(10, 10, 3, 9), (16, 10, 3, 7)]  # they grow into one another, with a dip


def park(crowns: list[Crown], density: float = 8.0, *, unit: float = 1.0) -> PointCloud:
    """30 x 20 m of slope with round crowns."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform((0, 0), (30, 20), (int(600 * density), 2)).T
    ground, top = 100 + 0.05 * x, np.zeros(len(x))
    for east, north, radius, height in crowns:
        inside = np.clip(1 - ((x - east) ** 2 + (y - north) ** 2) / radius**2, 0, None)
        top = np.maximum(top, np.where(inside > 0, height - 4 * (1 - np.sqrt(inside)), 0))
    xyz = np.column_stack([x + 500_000, y + 4_600_000, ground + top])
    classes = np.where(top > 0, 5, 2)
    crs = CRS(32635) if unit == 1 else CRS(2263)
    return cloud(xyz * unit, classes, crs=crs)


def rows(points: PointCloud, **settings: Any) -> list[dict[str, Any]]:
    """Attributes of the trees from the highest to the lowest."""
    frame = ClassifyTrees(points=points, **settings).run().tops.frame
    found: list[dict[str, Any]] = frame.sort_values("height", ascending=False).to_dict("records")
    return found


def test_what_the_file_calls_building_is_no_tree(caplog: pytest.LogCaptureFixture) -> None:
    """A spire of 26 m was the highest tree of a town."""
    points = park([(8, 10, 3, 9), (22, 10, 3, 14)])
    spire = (points["classification"] == 5) & (points["x"] > 500_015)
    given = points.with_attributes({"classification": np.where(spire, 6, 1).astype(np.uint8)})
    (tree,) = rows(points, given=given)
    assert tree["height"] == pytest.approx(9, abs=0.1)
    assert "the file calls most points building: 1; they are left out of" in caplog.text
    assert "the highest, 14" in caplog.text
    half = points.with_attributes({"classification": np.where(spire, 1, 6).astype(np.uint8)})
    assert len(rows(points, given=half)) == 1
    bare = points.with_attributes({"classification": np.ones(len(points), np.uint8)})
    assert len(rows(points, given=bare)) == 2


def test_crowns_at_the_edge_of_the_data_are_cut() -> None:
    """24 of 74 crowns of a tile were halves, with areas and heights as if they were whole."""
    out = ClassifyTrees(points=park([(10, 10, 3, 9), (29, 10, 3, 8)])).run()
    assert out.crowns.frame.sort_values("height")["cut"].tolist() == [True, False]
    told = " ".join(out.not_looked_at())
    assert "edge of the data cuts: 1 of 2" in told
    assert "without a dip count as one tree" in told


def test_trees_of_overlapping_tiles_are_counted_once() -> None:
    """A set of four tiles said that there are 156 trees, of which its files had 39."""
    whole = park([(8, 10, 3, 9), (22, 10, 3, 8)])
    west = whole["x"] < 500_015
    number = np.arange(len(whole))
    halves = [whole.with_origin(np.where(own, number, -1 - number)) for own in (west, ~west)]
    out = [ClassifyTrees(points=half).run() for half in halves]
    assert [len(one.tops) for one in out] == [2, 2], "each tile sees the other's tree in its halo"
    assert [one.count for one in out] == [1, 1]
    assert out[0].in_words().startswith("Single trees: 2")


def test_a_tree_has_its_place_height_and_crown() -> None:
    out = ClassifyTrees(points=park([(10, 8, 3, 9)])).run()
    (top,), (crown,) = (layer.frame.to_dict("records") for layer in (out.tops, out.crowns))
    assert out.count == 1
    assert top["height"] == pytest.approx(9, abs=0.2)
    assert top["elevation"] == pytest.approx(109.5, abs=0.2)
    assert np.hypot(top["geometry"].x - 500_010, top["geometry"].y - 4_600_008) < 1
    assert crown["crown_diameter"] == pytest.approx(6, rel=0.07)
    assert crown["crown_area"] == crown["geometry"].area
    assert crown["geometry"].contains(top["geometry"])
    assert {k: top[k] for k in top if k != "geometry"} == {
        k: crown[k] for k in crown if k != "geometry"
    }


def test_crowns_are_parted_at_a_dip_of_the_prominence() -> None:
    high, low = rows(park(PAIR))
    assert (high["height"], low["height"]) == pytest.approx((9, 7), abs=0.3)
    assert 0.4 < low["crown_area"] / high["crown_area"] < 1
    (one,) = rows(park(PAIR), prominence=4.0)
    assert one["height"] == pytest.approx(9, abs=0.3)


def test_limits_of_height_crown_and_class() -> None:
    points = park([(10, 10, 3, 9), (20, 10, 2.5, 4.5)])
    assert len(rows(points)) == 2
    assert len(rows(points, min_height=5.0)) == 1
    assert len(rows(points, min_crown=23.0)) == 1
    assert rows(points, classes=ClassList([4])) == []


@pytest.mark.parametrize("density", [16.0, 1.0])
def test_cells_follow_the_density(density: float) -> None:
    assert len(rows(park(PAIR, density))) == 2


@pytest.mark.parametrize(("density", "told"), [(0.5, False), (0.25, True)])
@pytest.mark.parametrize("unit", [1.0, 3937 / 1200])
def test_that_points_are_too_sparse_is_told(
    density: float, told: bool, unit: float, caplog: pytest.LogCaptureFixture
) -> None:
    rows(park([(20, 20, 12, 15)], density, unit=unit))
    assert ("m apart, too sparse for single trees" in caplog.text) == told


def test_any_order_and_unit_gives_the_same() -> None:
    points = park(PAIR)
    order = np.random.default_rng(1).permutation(len(points))
    one, other = rows(points), rows(points.select(order))
    assert [row["geometry"] for row in one] == [row["geometry"] for row in other]
    assert [row["crown_area"] for row in one] == pytest.approx([r["crown_area"] for r in other])
    feet = 3937 / 1200
    in_feet = rows(park(PAIR, unit=feet))
    for row, wanted in zip(in_feet, one, strict=True):
        assert row["height"] == pytest.approx(wanted["height"] * feet, rel=1e-3)
        assert row["crown_area"] == pytest.approx(wanted["crown_area"] * feet**2, rel=0.02)


def test_points_of_one_hill_have_one_number() -> None:
    xyz = np.array([[0, 0, 5], [1, 0, 7], [2, 0, 5], [3, 0, 6], [4, 0, 5.0]])  # on edges of cells
    made = trees(xyz, xyz[:, 2], cell=1.0, smooth=0.01, prominence=0.5)
    assert len(set(made[:3])) == 1
    assert made[3] == made[4] != made[0]
    assert len(set(trees(xyz, xyz[:, 2], cell=1.0, smooth=0.01, prominence=1.5))) == 1


def test_trees_of_a_town_are_found() -> None:
    made = SamplesScene(kind="town", size=120.0, density=8.0, seed=7).run()
    frame = made.features.frame[made.features.frame.kind == "tree"]
    middle = np.array([(shape.centroid.x, shape.centroid.y) for shape in frame.geometry])
    tops = ClassifyTrees(points=made.points).run().tops.frame.geometry
    places: NDArray[np.float64] = np.column_stack([tops.x, tops.y])
    away, nearest = cKDTree(middle).query(places)
    own = away <= np.maximum(1.0, 0.6 * frame.crown_radius.to_numpy()[nearest])
    assert own.mean() > 0.95
    assert len(set(nearest[own])) > 0.8 * len(middle)


def test_a_part_of_the_points_gives_the_trees_of_the_whole() -> None:
    """All trees farther than 25 m from the cut, which no crown bridges, are the same."""
    points = SamplesScene(kind="town", size=120.0, density=4.0, seed=7).run().points
    height = points.xyz[:, 2] - points.xyz[:, 2].min()
    points = points.with_attributes({"HeightAboveGround": height})
    west = points.bounds[0]
    part = points.select(points.xyz[:, 0] < west + 80)

    def far_from_the_cut(cloud: PointCloud) -> list[tuple[Any, ...]]:
        frame = ClassifyTrees(points=cloud).run().tops.frame
        inside = frame[frame.geometry.x < west + 55]
        return sorted(zip(inside["id"], inside["height"].round(6), inside["points"], strict=True))

    whole = far_from_the_cut(points)
    assert len(whole) > 10
    assert far_from_the_cut(part) == whole


def test_bad_input_is_named(caplog: pytest.LogCaptureFixture) -> None:
    points = park(PAIR)
    with pytest.raises(DataError, match="has no classification; classify them first"):
        ClassifyTrees(points=PointCloud(points.xyz, crs=points.crs, name="a.laz")).run()
    raw = points.with_attributes({"classification": np.full(len(points), 5, np.uint8)})
    with pytest.raises(NothingToDo, match="none is of class 2,9-11") as error:
        ClassifyTrees(points=raw).run()
    assert len(error.value.instead.tops) == 0
    bare = points.select(points["classification"] == 2)
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert ClassifyTrees(points=bare).run().count == 0
    assert "no point of class 5 is 3 m high; classify vegetation first" in caplog.text
    assert ClassifyTrees(points=points.select([])).run().count == 0
