"""corridor.extract_voxels: what the chain of the thesis finds, and what it cannot."""

from __future__ import annotations

import itertools
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pyproj import CRS
from scenes.corridors import CORNER, bar, cloud, ground, line, quality, wire

from algorithms.corridor._voxels.growing import agree, grown, seeds_of
from algorithms.corridor._voxels.hull import Hull
from algorithms.corridor._voxels.towers import bounds_of, nearest, towers_among, within
from algorithms.corridor._voxels.voxels import Voxels, lines_in, otsu, trials
from algorithms.corridor.extract_voxels import CorridorExtractVoxels
from toolbox.data import PointCloud, Vector
from toolbox.declare import ClassList
from toolbox.errors import DataError

DATA = Path(os.environ.get("TOOLBOX_TEST_DATA", "/nowhere"))

GROUND = ground(200, 60, 3)
GROWING: dict[str, Any] = {
    "grow_to": "26",
    "gap": 20.0,
    "slope_test": "direction",
    "slope_limit": 1.0,
    "fewest": 2,
}


@pytest.fixture(scope="module")
def points() -> PointCloud:
    """Two spans of three wires, 32 m above the ground."""
    _, wires, _ = line([0, 90, 180], [-6, 0, 6], 32, 900, per_metre=8)
    towers = [lattice_tower(x, 0, 34, 7) for x in (0, 90, 180)]
    return with_heights(cloud(GROUND, *wires, *towers, classes=[2, *[14] * 6, *[15] * 3]))


@pytest.fixture(scope="module")
def stacked() -> PointCloud:
    """Two spans of four wires, three of them above each other; a tower of few points."""
    wires = [
        wire((a, y, z), (a + 90, y, z), 900, per_metre=12)[1]
        for a, (y, z) in itertools.product((0, 90), ((-6, 25), (-6, 30), (-6, 36), (6, 30)))
    ]
    tower = lattice_tower(90, 0, 38, 7, per_metre=5)
    return with_heights(cloud(GROUND, *wires, tower, classes=[2, *[14] * 8, 15]))


def lattice_tower(x: float, y: float, top: float, half: float, per_metre: float = 12) -> Any:
    """Four legs, and an arm across a line along x."""
    legs = [bar((x + i, y + j, 0), (x, y, top), per_metre) for i in (-2, 2) for j in (-2, 2)]
    return np.vstack([*legs, bar((x, y - half, top - 2), (x, y + half, top - 2), 10)])


def with_heights(points: PointCloud) -> PointCloud:
    """The heights above the ground of the scene, so that it need not be found."""
    x, z = points.xyz[:, 0] - CORNER[0], points.xyz[:, 2] - CORNER[2]
    height = (z - np.sin(x / 40)).astype(np.float32)
    return points.with_attributes({"HeightAboveGround": height})


def classes(points: PointCloud, **settings: Any) -> Any:
    return CorridorExtractVoxels(points=points, **settings).run().classified["classification"]


# --- the whole chain ------------------------------------------------------------------------


def test_high_wires_are_found_with_low_variance_only(points: PointCloud) -> None:
    shares = {
        variance: quality(classes(points, variance=variance) == 14, points["truth"] == 14)
        for variance in ("low", "high")
    }
    assert shares["low"] > 0.85
    assert shares["high"] < 0.2


def test_points_on_a_catenary_have_its_numbers(points: PointCloud) -> None:
    result = CorridorExtractVoxels(points=points).run()
    found, frame = result.classified, result.wires.frame
    assert result.span_count == frame.span_id.nunique() == 2
    numbered = found["span_id"] > 0
    assert numbered.any()
    assert set(found["span_id"][numbered]) <= set(frame.span_id)
    assert (found["classification"][found["wire_id"] > 0] == 14).all()
    assert (found["wire_id"][numbered] > 0).all()


def test_wires_end_at_the_towers_counted(points: PointCloud) -> None:
    result = CorridorExtractVoxels(points=points).run()
    towers, spans = result.towers.frame, result.wires.frame
    assert result.tower_count == len(towers) == 3
    assert towers.points.tolist() == [
        int((result.classified["tower_id"] == k).sum()) for k in towers.tower_id
    ]
    middle = int(towers.tower_id[np.abs(shapely.centroid(towers.geometry).x - 500_090).argmin()])
    ends = spans[["from_tower", "to_tower"]].to_numpy()
    assert (ends == middle).any(axis=1).all()
    assert (np.sort(ends, axis=1)[:, 0] > 0).all()


def test_a_line_without_trees_is_not_one_tower(stacked: PointCloud) -> None:
    """Wires above each other are dense, but what is as long as the line is no tower."""
    truth = stacked["truth"]
    once = CorridorExtractVoxels(points=stacked, tower_threshold="once").run()
    assert once.towers.frame.length.max() > 150
    result = CorridorExtractVoxels(points=stacked).run()
    (box,) = result.towers.frame.geometry
    assert box.contains(shapely.Point(500_090, 4_400_000))
    said = result.classified["classification"]
    assert quality(said == 14, truth == 14) > 0.9


def test_the_ground_below_a_tower_is_tower_if_asked(points: PointCloud) -> None:
    low = points["truth"] == 2
    assert (classes(points)[low] == 15).sum() > 50
    assert (classes(points, tower_ground=False)[low] == 15).sum() == 0


def test_wires_below_the_height_are_not_found(
    points: PointCloud, caplog: pytest.LogCaptureFixture
) -> None:
    result = CorridorExtractVoxels(points=points, height=40.0).run()
    assert not np.isin(result.classified["classification"], (14, 15)).any()
    assert (result.span_count, result.tower_count, len(result.wires)) == (0, 0, 0)
    assert "no power line was found: no point is 40 m from the ground" in caplog.messages


def test_wires_that_hang_below_the_height_are_told(
    points: PointCloud, caplog: pytest.LogCaptureFixture
) -> None:
    CorridorExtractVoxels(points=points, height=25.0).run()
    assert not caplog.messages
    CorridorExtractVoxels(points=points, height=31.5).run()
    assert "reach down to the height of 31.5 m; what hangs below it" in caplog.text


def test_on_a_slope_the_distance_to_the_ground_counts() -> None:
    """A wire 21 m above a slope of 45 degrees is 15 m from it."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, 90, (2, 40_000))
    slope = np.column_stack([x, y, y])
    over = wire((0, 45, 66), (90, 45, 66), 3000, per_metre=8)[1]
    points = cloud(slope, over, classes=[2, 14])
    points = points.with_attributes({"classification": points["truth"]})
    kept = [
        CorridorExtractVoxels(points=points, ground_classes=ClassList([2]), height=height)
        .run()
        .voxels.frame.points.sum()
        for height in (14.0, 17.0)
    ]
    assert kept[0] > 0.95 * (points["truth"] == 14).sum()
    assert kept[1] == 0


def test_feet_give_what_metres_give(points: PointCloud) -> None:
    foot = 1200 / 3937
    height = points["HeightAboveGround"] / foot
    feet = PointCloud(points.xyz / foot, {"HeightAboveGround": height}, crs=CRS(2263))
    one, other = (CorridorExtractVoxels(points=p).run() for p in (points, feet))
    for number in (14, 15):
        said = [found.classified["classification"] == number for found in (one, other)]
        assert quality(*said) > 0.98
    assert one.tower_count == other.tower_count
    voxels = [found.voxels.frame for found in (one, other)]
    assert np.allclose(voxels[0].density.max(), voxels[1].density.max())
    assert np.allclose(voxels[0].variance.max(), voxels[1].variance.max(), rtol=0.01)
    volumes = [found.hull.frame.volume.sum() for found in (one, other)]
    assert volumes[0] == pytest.approx(volumes[1], rel=0.02)
    widths = [found.towers.frame.width.sum() for found in (one, other)]
    assert widths[0] == pytest.approx(widths[1], rel=0.01)
    assert np.allclose(one.voxels.bounds, np.array(other.voxels.bounds) * foot, atol=0.01)


def test_the_order_of_the_points_does_not_matter(points: PointCloud) -> None:
    order = np.random.default_rng(4).permutation(len(points))
    assert (classes(points.select(order)) == classes(points)[order]).all()


def test_no_points_and_unknown_heights_are_an_empty_result_that_says_so(
    points: PointCloud, caplog: pytest.LogCaptureFixture
) -> None:
    unknown = points.with_attributes(
        {"HeightAboveGround": np.full(len(points), np.nan, np.float32)}
    )
    for some, why in ((points.select([]), ""), (unknown, ": no height above the ground is known")):
        result = CorridorExtractVoxels(points=some).run()
        assert (result.span_count, result.tower_count, len(result.wires)) == (0, 0, 0)
        assert (len(result.voxels), len(result.hull), len(result.towers)) == (0, 0, 0)
        assert caplog.messages[-1] == f"no power line was found{why}"


def test_a_few_high_points_are_no_line(caplog: pytest.LogCaptureFixture) -> None:
    few = with_heights(cloud(GROUND, np.array([[50.0, 0, 30], [51, 0, 30], [90, 0, 31]])))
    result = CorridorExtractVoxels(points=few).run()
    assert (result.tower_count, len(result.hull)) == (0, 0)
    assert result.voxels.frame.points.sum() == 3
    assert "whose lines agree are next to each other" in caplog.text


def test_wires_without_ground_are_refused() -> None:
    _, wires, _ = line([0, 90, 180], [-6, 0, 6], 32, 900, per_metre=8)
    with pytest.raises(DataError, match="without the ground"):
        CorridorExtractVoxels(points=cloud(*wires)).run()


def test_one_tower_alone_is_no_line() -> None:
    alone = with_heights(cloud(GROUND, bar((90, 0, 0), (90, 0, 40), 20)))
    result = CorridorExtractVoxels(points=alone).run()
    assert result.span_count == 0
    assert len(result.wires) == 0


def test_layers_are_written_and_read_again(points: PointCloud, tmp_path: Path) -> None:
    result = CorridorExtractVoxels(points=points).run()
    for name in ("voxels", "hull", "towers"):
        path = tmp_path / f"{name}.gpkg"
        layer = getattr(result, name)
        layer.save(path)
        again = Vector.open(path)
        assert (len(again), again.crs) == (len(layer), points.crs)
        assert set(layer.names) <= set(again.names)


# --- voxels and their lines -------------------------------------------------------------------


def test_the_table_of_voxels_is_that_of_the_high_points(points: PointCloud) -> None:
    result = CorridorExtractVoxels(points=points, voxel=4.0).run()
    frame = result.voxels.frame
    assert abs(frame.points.sum() - (points["HeightAboveGround"] > 20).sum()) < 20
    assert np.allclose(frame.density, frame.points / 64)
    length = np.linalg.norm(frame[["line_east", "line_north", "line_up"]], axis=1)
    assert np.all(np.isclose(length, 1) | (length == 0))
    low, high = points.xyz.min(axis=0)[:2], points.xyz.max(axis=0)[:2]
    for place in (result.voxels.bounds, result.hull.bounds, result.towers.bounds):
        assert (low <= place[:2]).all()
        assert (place[2:] <= high).all()
    assert frame.seed.sum() == frame.group_id[frame.group_id > 0].nunique()
    assert (frame.group_id[frame.seed] > 0).all()
    assert (frame.variance[frame.kept].max()) <= frame.variance[
        ~frame.kept & (frame.points > 2)
    ].min()


def test_the_threshold_of_otsu_parts_two_groups() -> None:
    rng = np.random.default_rng(1)
    values = np.concatenate([rng.normal(1, 0.2, 500), rng.normal(5, 0.5, 300)])
    assert 1.6 < otsu(values) < 3.8
    assert otsu(np.array([2.0, 2.0, 2.0])) == 2.0
    assert otsu(np.array([])) == 0.0


@pytest.mark.parametrize(
    ("certainty", "outliers", "count"),
    [(0.99, 0.6, 27), (0.99, 0.5, 17), (0.9, 0.6, 14), (0.9, 0, 1)],
)
def test_random_lines_are_as_many_as_the_formula_says(
    certainty: float, outliers: float, count: int
) -> None:
    assert trials(certainty, outliers) == count


def test_the_line_of_a_voxel_bears_outliers() -> None:
    rng = np.random.default_rng(3)
    along = bar((0, 1, 1), (3, 2, 1), 10, noise=0.01)
    xyz = np.vstack([along, rng.uniform(0, 3, (30, 3))])
    voxels = Voxels.of(np.clip(xyz, 0, 2.999), 3.0)
    direction, share = lines_in(xyz, voxels, tolerance=0.1, tries=200, seed=0)
    assert abs(direction[0] @ np.array([3, 1, 0]) / np.sqrt(10)) > 0.99
    assert 0.5 < share[0] < 0.75
    wide = lines_in(xyz, voxels, tolerance=1.0, tries=200, seed=0)[1]
    assert wide[0] > share[0] + 0.1


def test_points_in_one_place_have_no_line() -> None:
    voxels = Voxels.of(np.ones((5, 3)), 3.0)
    direction, share = lines_in(np.ones((5, 3)), voxels, tolerance=0.3, tries=5, seed=0)
    assert not direction.any()
    assert not share.any()


# --- growing ---------------------------------------------------------------------------------


def along_x(*columns: int, row: int = 0) -> Voxels:
    """Voxels of 3 m with five points each along x, at some columns."""
    return Voxels.of(
        np.vstack(
            [
                bar((3 * c + 0.2, 3 * row + 1.5, 1.5), (3 * c + 2.8, 3 * row + 1.5, 1.5), 2, 0.0)
                for c in columns
            ]
        ),
        3.0,
    )


def test_lines_go_on_in_neighbours_or_across_a_gap() -> None:
    voxels = along_x(0, 1, 4, 5, 20)
    direction = np.tile([1.0, 0, 0], (5, 1))
    kept = np.ones(5, bool)

    def groups(**settings: Any) -> list[int]:
        return list(grown(voxels, direction, kept, **(GROWING | settings)))

    assert groups() == [1, 1, 2, 2, 0]
    assert groups(fewest=3) == [0, 0, 0, 0, 0]
    assert groups(grow_to="gap") == [1, 1, 1, 1, 0]
    assert groups(grow_to="gap", gap=8.0) == [1, 1, 2, 2, 0]
    assert groups(grow_to="gap", gap=50.0) == [1, 1, 1, 1, 1]
    assert groups(gap=2.0) == [0, 0, 0, 0, 0]
    direction[1] = [0, 0.8, 0.6]  # across: neither a neighbour's line nor ahead of one
    assert groups() == [0, 0, 1, 1, 0]


def test_across_a_gap_only_what_is_ahead_follows() -> None:
    """Of a wire beside another one, no voxel does."""
    xyz = np.vstack([bar((0.2, y, 1.5), (2.8, y, 1.5), 2, 0.0) for y in (1.5, 7.5)])
    voxels = Voxels.of(xyz, 3.0)
    direction = np.tile([1.0, 0, 0], (2, 1))
    group = grown(voxels, direction, np.ones(2, bool), **(GROWING | {"grow_to": "gap"}))
    assert not group.any()


@pytest.mark.parametrize(("to", "linked"), [("6", 1), ("18", 2), ("26", 3)])
def test_which_voxels_are_neighbours(to: Any, linked: int) -> None:
    """Of one across a face, across an edge and across a corner."""
    cells = np.array([[0, 0, 0], [-1, 0, 0], [0, 1, -1], [1, -1, 1]])
    voxels = Voxels.of(cells * 3 + 1.5, 3.0)
    direction, kept = np.tile([1.0, 0, 0], (4, 1)), np.ones(4, bool)
    group = grown(voxels, direction, kept, **(GROWING | {"grow_to": to}))
    assert np.count_nonzero(group) == linked + 1


def test_slopes_as_printed_fail_along_an_axis() -> None:
    """Two lines half a degree apart, to both sides of north."""
    turn = np.radians(0.25)
    one = np.array([[np.sin(turn), np.cos(turn), 0.02]])
    other = one * [-1, 1, 1]
    assert agree(one, other, "direction", 1.0).all()
    assert not agree(one, other, "slopes", 1.0).any()
    flat = np.array([[1.0, 1.0, 1.0]])
    other = np.array([[1.0, 1.5, 1.0]])
    assert agree(flat, other, "slopes", 1.0).all()
    assert not agree(flat, other, "slopes", 0.4).any()
    unit = [line / np.linalg.norm(line) for line in (flat, other)]
    assert agree(unit[0], unit[1], "direction", 0.3).all()
    assert not agree(unit[0], unit[1], "direction", 0.1).any()


def test_the_seed_of_a_group_has_the_best_line() -> None:
    group = np.array([0, 1, 1, 1, 2])
    share = np.array([1.0, 0.5, 0.9, 0.9, 0.2])
    seeds = seeds_of(group, share, np.array([9, 9, 4, 6, 3]))
    assert np.flatnonzero(seeds).tolist() == [3, 4]


# --- towers and hull ---------------------------------------------------------------------------


def test_towers_nearer_than_their_spacing_are_one() -> None:
    xyz = np.vstack([along_x(*range(20)).centroid.repeat(3, 0)])
    for x in (10.5, 28.5):
        xyz = np.vstack([xyz, bar((x, 1.5, 0), (x, 1.5, 20), 20, 0.0)])
    voxels = Voxels.of(xyz, 3.0)
    group = (voxels.cell[:, 2] == 0).astype(np.int64)
    counts = [
        towers_among(voxels, group, spacing=spacing, repeated=False).max()
        for spacing in (10.0, 15.0, 20.0)
    ]
    assert counts == [2, 2, 1]


def test_dense_columns_away_from_wires_are_no_tower() -> None:
    tree = np.random.default_rng(1).uniform((10, 30, 0), (16, 36, 9), (500, 3))
    xyz = np.vstack([along_x(*range(9)).centroid.repeat(3, 0), tree])
    voxels = Voxels.of(xyz, 3.0)
    group = (voxels.cell[:, 1] == 0).astype(np.int64)
    assert towers_among(voxels, group, spacing=30.0, repeated=True).max() == 0


def test_points_in_two_bounds_are_of_the_smaller() -> None:
    bounds = np.array([[2.0, 2, 3, 3], [0, 0, 10, 10]])
    at = np.array([[2.5, 2.5, 0], [5, 5, 9], [11, 5, 0]])
    assert within(bounds, at).tolist() == [1, 2, 0]
    assert nearest(bounds[:1], at, 4.0).tolist() == [1, 1, 0]
    assert nearest(bounds, at, 4.0).tolist() == [1, 2, 2]
    assert nearest(bounds[:0], at, 4.0).tolist() == [0, 0, 0]
    assert bounds_of(at, np.array([1, 1, 0])).tolist() == [[2.5, 2.5, 5, 5]]


def test_a_convex_hull_is_closed_and_holds_what_is_between() -> None:
    corners = np.array(list(itertools.product((0.0, 10), (0.0, 4), (0.0, 5))))
    hull = Hull.of(corners, None, 0.3)
    ((faces, volume),) = hull.bodies()
    assert np.isclose(volume, 200)
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2, 3), axis=1)
    assert len(faces) == 12
    assert len(edges) == 36
    at = np.array([[5.0, 2, 2], [10.2, 4, 5], [5, 4.2, 2]])
    assert hull.hold(at, 0.3).tolist() == [True, True, False]
    assert hull.hold(at, 0.1).tolist() == [True, False, False]


def test_a_concave_hull_stays_between_near_wires() -> None:
    wires = [bar((0, y, 20), (60, y, 20), 5, 0.05, seed=k) for k, y in enumerate((0, 6, 80, 86))]
    at = np.array([[30.0, 3, 20], [30, 40, 20]])
    concave, convex = (Hull.of(np.vstack(wires), radius, 0.3) for radius in (20.0, None))
    assert concave.hold(at, 0.3).tolist() == [True, False]
    assert convex.hold(at, 0.3).tolist() == [True, True]
    assert len(list(concave.bodies())) >= 2
    assert len(list(convex.bodies())) == 1


def test_wires_in_one_plane_have_no_hull_but_their_points() -> None:
    flat = np.column_stack([np.arange(20.0), np.zeros(20), np.arange(20.0) ** 2])
    hull = Hull.of(flat, 20.0, 0.3)
    assert list(hull.bodies()) == []
    assert hull.hold(np.array([[3.0, 0.1, 9], [3, 1, 9]]), 0.3).tolist() == [True, False]


# --- real data ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tile", "least"), [("12AN2_20", 0.88), pytest.param("12BZ1_21", 0.95, marks=pytest.mark.slow)]
)
def test_a_real_line_without_the_trees_pasted_below_it(tile: str, least: float) -> None:
    path = DATA / "powerline_ahn4" / f"{tile}_as_published.laz"
    if not path.is_file():
        pytest.skip("needs TOOLBOX_TEST_DATA")
    points = PointCloud.open(path, assume_crs=CRS(28992))
    points = points.select(np.flatnonzero(~np.isin(points["classification"], (5, 26))))
    said = classes(points, height=12.0, tower_ground=False)
    assert quality(said == 14, points["classification"] == 14) > least
