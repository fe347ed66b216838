"""Parts of buildings by height: they tile the outline, and lie where the roof steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from scenes.layers import cloud

from algorithms.classify._parts import levels, merged
from algorithms.classify._roofs import Roof, main_section
from algorithms.classify.buildings import ClassifyBuildings
from toolbox.data import PointCloud, Vector

Floats = NDArray[np.float64]
CENTRE = np.array([500_000.0, 4_600_000.0])

Block = tuple[Any, float]
"""A polygon around (0, 0), and the height of the flat roof on it."""


def survey(
    *blocks: Block, seed: int = 0, density: float = 10.0, turn: float = 0.0, metre: float = 1.0
) -> PointCloud:
    """Level ground with a building of blocks, the later ones above; `turn` is in degrees."""
    rng = np.random.default_rng(seed)
    reach = 12 + max(np.abs(shape.bounds).max() for shape, _ in blocks)
    xy = rng.uniform(-reach, reach, (int(density * 4 * reach**2), 2))
    z = np.zeros(len(xy))
    for shape, height in blocks:
        z[shapely.contains_xy(shape, *xy.T)] = height
    xyz = np.column_stack([turned(xy, turn), z + rng.normal(0, 0.02, len(z)) + 100])
    returns = {name: np.ones(len(z), np.uint8) for name in ("return_number", "number_of_returns")}
    returns["number_of_returns"][0] = 2
    crs = CRS(32635) if metre == 1 else CRS("EPSG:2263+6360")
    return cloud(xyz * metre, np.where(z > 0, 1, 2), crs=crs, **returns)


def turned(xy: Floats, turn: float) -> Floats:
    angle = np.radians(turn)
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return np.asarray(xy @ rotation + CENTRE)


def the_parts(points: PointCloud, **settings: Any) -> tuple[Any, Vector]:
    """The one outline, and its parts."""
    out = ClassifyBuildings(points=points, **settings).run()
    (row,) = out.outlines.frame.itertuples()
    frame = out.parts.frame
    assert (frame["building"] == row.id).all()
    assert len(frame) == row.parts
    shapes = frame.geometry.to_numpy()
    assert shapely.coverage_is_valid(shapes)
    assert shapely.area(shapes).sum() == pytest.approx(row.geometry.area, rel=1e-9)
    assert shapely.union_all(shapes).symmetric_difference(row.geometry).area < 1e-3
    assert (frame["ground"] == row.ground).all()
    assert frame["points"].sum() == row.points
    return row, out.parts


TOWER, WING = (shapely.box(0, -11, 12, 11), 24.0), (shapely.box(-20, -6, 0, 6), 6.0)


@pytest.mark.parametrize("turn", [0.0, 35.0])
@pytest.mark.parametrize("metre", [1.0, 3937 / 1200])
def test_a_tower_and_its_wing_have_heights_of_their_own(turn: float, metre: float) -> None:
    row, parts = the_parts(survey(TOWER, WING, turn=turn, metre=metre))
    frame = parts.frame.sort_values("mean")
    np.testing.assert_allclose(frame["mean"] / metre, [106, 124], atol=0.05)
    np.testing.assert_allclose(frame["eave"] / metre, [106, 124], atol=0.1)
    np.testing.assert_allclose(frame["height"] / metre, [6, 24], atol=0.1)
    np.testing.assert_allclose(frame["area"] / metre**2, [240, 264], rtol=0.02)
    for shape, (true, _) in zip(frame.geometry, (WING, TOWER), strict=True):
        corners = turned(shapely.get_coordinates(true), turn) * metre
        assert shape.hausdorff_distance(shapely.Polygon(corners)) < 0.35 * metre
        assert shapely.get_num_coordinates(shape) <= 14
    assert row.ridge / metre == pytest.approx(124, abs=0.1)


def test_a_part_is_cut_where_the_data_end_at_itself() -> None:
    """Parts far inside the data took over that their building is cut."""
    points = survey(TOWER, WING)
    row, parts = the_parts(points.select(points["x"] > CENTRE[0] - 12))
    assert row.cut
    assert parts.frame.sort_values("mean")["cut"].tolist() == [True, False]


def test_a_building_is_as_high_as_its_highest_part() -> None:
    """A tower of less than a hundredth of a hall was above the ridge of the building."""
    hall, mast = shapely.box(-40, -25, 40, 25), shapely.box(-3, -3, 3, 3)
    row, parts = the_parts(survey((hall, 8.0), (mast, 20.0)))
    assert row.parts == 2
    assert row.height == pytest.approx(20, abs=0.1)
    assert row.height == row.ridge - row.ground == parts.frame["height"].max()


def test_what_is_no_part_counts_for_the_height_of_the_building() -> None:
    dormer = shapely.box(-19, -1, -16, 2), 28.0
    row, parts = the_parts(survey(TOWER, WING, dormer))
    assert row.height == pytest.approx(28, abs=0.1)
    assert parts.frame["height"].max() == pytest.approx(24, abs=0.1)
    assert (parts.frame["building_height"] == row.height).all()


def test_a_roof_at_one_height_is_one_part() -> None:
    row, parts = the_parts(survey((shapely.box(-10, -6, 10, 6), 8.0)))
    (only,) = parts.frame.itertuples()
    assert only.geometry.equals(row.geometry)
    assert (only.id, only.mean, only.form) == (row.id, row.mean, row.form)


@pytest.mark.parametrize(("step", "count"), [(1.6, 1), (2.4, 2)])
def test_parts_differ_by_two_metres(step: float, count: int) -> None:
    blocks = (shapely.box(-12, -6, 0, 6), 8.0), (shapely.box(0, -6, 12, 6), 8.0 + step)
    row, _ = the_parts(survey(*blocks))
    assert (row.parts, row.sections) == (count, 2)


def test_what_is_smaller_than_ten_square_metres_is_no_part() -> None:
    dormer = shapely.box(-1, -1, 2, 2), 13.0
    assert the_parts(survey((shapely.box(-10, -6, 10, 6), 8.0), dormer))[0].parts == 1


def test_a_tower_in_a_wide_roof_leaves_a_hole() -> None:
    _, parts = the_parts(survey((shapely.box(-15, -15, 15, 15), 6.0), (TOWER[0], 30.0)))
    assert sorted(len(shape.interiors) for shape in parts.frame.geometry) == [0, 1]


def test_parts_of_sparse_points_keep_the_points_of_their_level() -> None:
    """Straightened walls moved a part off the place by which its points were found: it had none."""
    boxes = {
        (-32, -32, 32, 32): 5.0,
        (-4, -12, 12, 5): 8.0,
        (5, -19, 22, -10): 12.0,
        (9, -18, 16, 0): 18.0,
        (7, -16, 19, 0): 16.0,
    }
    blocks = [(shapely.box(*box), height) for box, height in boxes.items()]
    row, parts = the_parts(survey(*blocks, seed=4, density=0.5))
    assert row.parts > 2
    assert np.isfinite(parts.frame[["mean", "ridge", "eave"]]).all(axis=None)


def test_outlines_as_the_points_lie_have_straight_walls_between_parts() -> None:
    _, parts = the_parts(survey(TOWER, WING), outline="alpha")
    low, high = parts.frame.sort_values("mean").geometry
    wall = low.intersection(high)
    assert shapely.get_num_coordinates(shapely.line_merge(wall)) <= 6
    assert wall.length == pytest.approx(12, abs=3.5)


def test_pieces_are_joined_from_the_most_alike() -> None:
    border = np.ones((4, 4)) - np.eye(4)
    height, area = np.array([3.0, 4.9, 6.5, 20.0]), np.array([50.0, 50.0, 50.0, 4.0])
    assert merged(height, area, border).tolist() == [0, 1, 1, 1]
    apart = np.zeros((4, 4))
    assert merged(height, area, apart).tolist() == [0, 1, 2, 3]


def steep_edge(step: float) -> Roof:
    """Two flat roofs with points on the edge between, whose planes lean as those do across it."""
    rng = np.random.default_rng(0)
    xy = rng.uniform((-10, -6), (10, 6), (3000, 2))
    z = np.where(xy[:, 0] > 0, 4.0 + step, 4.0)
    edge = np.abs(xy[:, 0]) < 0.15
    normal = np.where(edge[:, None], (np.sin(1.25), 0.0, np.cos(1.25)), (0.0, 0.0, 1.0))
    return Roof(np.column_stack([xy, z]), normal)


def test_planes_across_a_step_do_not_join_its_sides() -> None:
    """Delft's church and the wing at its foot were one section, and one block."""
    roof = steep_edge(3.0)
    assert main_section(roof, 0.3).parts == 2
    assert set(levels(roof, 0.3).tolist()) <= {-1, 0, 1}
    assert levels(roof, 0.3).max() == 1


def complex_of(seed: int) -> list[Block]:
    """A hall with two to four lower or higher blocks along its sides, at random."""
    rng = np.random.default_rng(seed)
    base = rng.uniform(5, 12)
    blocks = [(shapely.box(-16, -7, 16, 7), base)]
    for number in range(rng.integers(2, 5)):
        west = -16 + 8 * number + rng.uniform(0, 1)
        south, north = ((-7 - rng.uniform(4, 9), -7), (7, 7 + rng.uniform(4, 9)))[number % 2]
        higher = base + rng.choice([-1, 1]) * rng.uniform(2.6, 8)
        blocks.append((shapely.box(west, south, west + 7, north), max(higher, 2.5)))
    return blocks


@pytest.mark.parametrize("seed", range(5, 13))
@pytest.mark.parametrize("density", [2.0, 8.0])
def test_complexes_of_blocks_are_parted(seed: int, density: float) -> None:
    """The widths of strips were chosen on these seeds; others are told on the page."""
    blocks = complex_of(seed)
    apart = [height for _, height in blocks if abs(height - blocks[0][1]) >= 2]
    points = survey(*blocks, seed=seed, density=density, turn=17.0 * seed)
    row, parts = the_parts(points)
    assert row.parts == 1 + len(apart)
    true = sum(shape.area * height for shape, height in blocks)
    found = (parts.frame["area"] * (parts.frame["mean"] - parts.frame["ground"])).sum()
    assert found == pytest.approx(true, rel=0.04)
