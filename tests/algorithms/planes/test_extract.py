"""planes.extract: planes with known answers, house fronts with truth, real scans, bad input."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.planes._cells import _Share, sort_into_cells
from algorithms.planes._cells_kernels import between_neighbours
from algorithms.planes._search import Rules, Search
from algorithms.planes.extract import PlanesExtract
from algorithms.samples.scene import scene
from toolbox.data import PointCloud
from toolbox.data.crs import LOCAL, parse_crs
from toolbox.errors import DataError, ParameterError

UTM = CRS(32635)
FAR = np.array([543_210.5, 4_567_890.25, 812.0])
NOISE = 0.004

Floats = NDArray[np.float64]


def patch(
    corner: Any, along: Any, up: Any, n: int, *, noise: float = NOISE, seed: int = 1
) -> Floats:
    """Points spread over a rectangle, with noise square to it."""
    rng = np.random.default_rng(seed)
    along, up = np.array(along, float), np.array(up, float)
    normal = np.cross(along, up)
    normal /= np.linalg.norm(normal)
    places = rng.random((n, 2)) @ np.array([along, up])
    away = rng.normal(0, noise, (n, 1)) * normal
    return np.asarray(FAR + np.array(corner, float) + places + away)


@cache
def corner() -> Floats:
    """A floor, two walls square to each other and a roof that falls to the south; 1:2:3:4."""
    return np.vstack(
        [
            patch((0, 0, 0), (8, 0, 0), (0, 6, 0), 4000, seed=1),
            patch((0, 6, 0), (8, 0, 0), (0, 0, 3), 3000, seed=2),
            patch((8, 0, 0), (0, 6, 0), (0, 0, 3), 2000, seed=3),
            patch((0, 3, 4.5), (8, 0, 0), (0, 3, 1.5), 2500, seed=4),
        ]
    )


OF_CORNER = np.repeat([1, 3, 4, 2], [4000, 3000, 2000, 2500])  # in an order to be translated


def extracted(xyz: Floats, crs: CRS | None = UTM, **settings: Any) -> PlanesExtract.Outputs:
    points = PointCloud(xyz, {"number": np.arange(len(xyz))}, crs=crs, name="a.laz")
    return PlanesExtract(points=points, **settings).run()


def ids_of(out: PlanesExtract.Outputs) -> NDArray[np.int64]:
    return np.asarray(out.segmented["plane_id"], np.int64)


def test_four_planes_and_their_numbers() -> None:
    out = extracted(corner())
    assert out.count == 4
    ids = ids_of(out)
    sizes = np.bincount(ids)[1:]
    assert (np.diff(sizes) <= 0).all()
    for value in range(1, 5):
        own = ids[value == OF_CORNER]
        assert (own == np.bincount(own).argmax()).mean() > 0.985
    frame = out.planes.frame.set_index("plane_id")
    floor, back, roof, side = (frame.loc[k] for k in (1, 2, 3, 4))
    assert floor.tilt == pytest.approx(0, abs=0.05)
    assert back.tilt == pytest.approx(90, abs=0.05)
    assert abs(back.normal_y) == pytest.approx(1, abs=1e-6)
    assert abs(side.normal_x) == pytest.approx(1, abs=1e-6)
    assert roof.tilt == pytest.approx(math.degrees(math.atan(0.5)), abs=0.05)
    assert roof.azimuth == pytest.approx(180, abs=0.1)
    for row, area, length, width in (
        (floor, 48, 8, 6),
        (back, 24, 8, 3),
        (roof, 8 * math.hypot(3, 1.5), 8, math.hypot(3, 1.5)),
    ):
        assert row.area == pytest.approx(area, rel=0.05)
        assert (row.length, row.width) == pytest.approx((length, width), abs=0.08)
        assert row.rms == pytest.approx(NOISE, rel=0.08)
    assert (roof.lowest - 812, roof.highest - 812) == pytest.approx((4.5, 6.0), abs=0.03)
    normals = frame[["normal_x", "normal_y", "normal_z"]].to_numpy()
    assert frame.offset.to_numpy() == pytest.approx(
        [math.fsum(n * FAR) + n @ c for n, c in zip(normals, CENTRES, strict=True)], abs=0.002
    )
    assert list(frame.points) == list(sizes)


CENTRES = np.array([(4, 3, 0), (4, 6, 1.5), (4, 4.5, 5.25), (8, 3, 1.5)], float)


def test_outlines_lie_in_their_planes_and_the_elevation_in_that_of_the_wall() -> None:
    out = extracted(corner())
    for _, row in out.planes.frame.iterrows():
        corners = shapely.get_coordinates(row.geometry, include_z=True)
        away = corners @ np.array([row.normal_x, row.normal_y, row.normal_z]) - row.offset
        assert np.abs(away).max() < 1e-6
    shown = out.elevation.frame.set_index("plane_id")
    assert out.elevation.crs == parse_crs("local")
    assert list(shown.kind) == ["facade"]  # nothing else faces north or south upright
    assert shown.geometry[2].bounds == pytest.approx((0, 0, 8, 3), abs=0.05)


def test_elevation_is_seen_from_the_front() -> None:
    """The door stands back on the right as one looks at the wall from where the ground is."""
    wall = patch((0, 0, 0), (10, 0, 0), (0, 0, 4), 4000)
    door = patch((8, 0.3, 0.1), (1, 0, 0), (0, 0, 2), 600, seed=2)
    ground = patch((-5, -9, 0), (20, 0, 0), (0, 9, 0), 9000, seed=3)
    frame = extracted(np.vstack([wall, door, ground])).elevation.frame.set_index("kind")
    assert frame.loc["behind"].depth == pytest.approx(0.3, abs=0.01)
    assert frame.loc["behind"].geometry.bounds == pytest.approx((8, 0.1, 9, 2.1), abs=0.1)


def relief() -> Floats:
    """A wall of 8 by 5 m, pilasters 0.4 m before it that hide it, a wall far behind, ground."""
    parts = [
        patch((x, 0, 0), (2.2, 0, 0), (0, 0, 5), 4000, seed=k)
        for k, x in enumerate((0.0, 2.8, 5.6))
    ]
    parts += [patch((x, -0.4, 0), (0.6, 0, 0), (0, 0, 5), 1500, seed=int(x)) for x in (2.2, 5.0)]
    parts.append(patch((-9, 6, 0), (30, 0, 0), (0, 0, 3), 9000, seed=8))
    parts.append(patch((-5, -9, 0), (20, 0, 0), (0, 8.5, 0), 9000, seed=9))
    return np.vstack(parts)


def test_a_front_is_one_with_its_relief() -> None:
    out = extracted(relief())
    planes, fronts = out.planes.frame, out.fronts.frame
    assert out.front_count == len(fronts) == 2
    front = fronts[fronts.planes > 1].iloc[0]
    assert (front.planes, front.height) == (3, pytest.approx(5.0, abs=0.05))
    assert front.length == pytest.approx(7.8, abs=0.05)
    assert front.azimuth == pytest.approx(180, abs=0.5)  # seen from the ground before it
    assert (front.relief_from, front.relief_to) == pytest.approx((0.0, 0.4), abs=0.005)
    own = planes[planes.front_id == front.front_id]
    assert sorted(own.relief.round(2).abs()) == [0, 0.4, 0.4]
    assert (planes.front_id[planes.tilt < 5] == 0).all()
    assert planes.relief[planes.front_id == 0].isna().all()
    numbers = out.segmented["front_id"]
    assert (numbers[: 3 * 4000 + 2 * 1500] == front.front_id).mean() > 0.98
    assert not numbers[-9000:].any()  # the ground
    shallow = extracted(relief(), front_depth=0.3)
    assert shallow.planes.frame.query("relief > 0.1").empty


def test_a_front_is_seen_from_where_its_panes_stand_back() -> None:
    """Nothing but a wall and panes 6 cm behind it, in the holes of the wall."""
    rng = np.random.default_rng(5)
    for turn in (1, -1):
        u, v = rng.random((2, 40_000)) * [[12], [6]]
        pane = (u % 3 > 0.8) & (u % 3 < 2.2) & (v % 3 > 0.8) & (v % 3 < 2.4)
        away = np.where(pane, 0.06, 0.0) + rng.normal(0, 0.002, u.size)
        (front,) = extracted(np.column_stack([u, turn * away, v]) + FAR).fronts.frame.itertuples()
        assert math.cos(math.radians(front.azimuth)) == pytest.approx(-turn, abs=0.001)
        assert front.relief_from == pytest.approx(-0.06, abs=0.005)


def test_each_point_is_near_its_plane_and_the_nearest_one() -> None:
    out = extracted(corner())
    ids, xyz = ids_of(out), corner() - FAR
    frame = out.planes.frame
    normals = frame[["normal_x", "normal_y", "normal_z"]].to_numpy()
    away = np.abs(xyz @ normals.T - (frame.offset.to_numpy() - normals @ FAR))
    on = ids > 0
    own = away[np.flatnonzero(on), ids[on] - 1]
    assert own.max() <= 1.1 * out.used_tolerance
    assert (own[:, None] <= away[on] + 1e-3).mean() > 0.99


@pytest.mark.parametrize(
    ("orientation", "found"),
    [("any", {1, 2, 3, 4}), ("vertical", {3, 4}), ("horizontal", {1}), ("sloped", {2})],
)
def test_orientation(orientation: Any, found: set[int]) -> None:
    ids = ids_of(extracted(corner(), orientation=orientation))
    kinds = {int(np.bincount(OF_CORNER[ids == k]).argmax()) for k in range(1, ids.max() + 1)}
    assert kinds == found
    assert ids.max() == len(found)


def test_the_same_for_any_order_seed_is_kept_and_large_coordinates() -> None:
    xyz = corner()
    first, again = extracted(xyz), extracted(xyz)
    np.testing.assert_array_equal(ids_of(first), ids_of(again))
    order = np.random.default_rng(5).permutation(len(xyz))
    shuffled = extracted(xyz[order])
    np.testing.assert_array_equal(ids_of(shuffled), ids_of(first)[order])
    near = extracted(xyz - FAR)
    assert (ids_of(near) == ids_of(first)).mean() > 0.999  # the coordinates are rounded elsewhere
    other = extracted(xyz, seed=7)
    assert other.count == 4


def test_a_plane_is_one_patch_unless_asked() -> None:
    apart = np.vstack(
        [patch((k, 0, 0), (3, 0, 0), (0, 0, 3), 2000, seed=k) for k in (0, 10)]
        + [patch((0, -9, 0), (14, 0, 0), (0, 9, 0), 9000)]
    )
    assert extracted(apart).count == 3
    assert extracted(apart, connected=False).count == 2
    assert extracted(apart, plane_gap=8.0).count == 2


def test_points_of_others_do_not_turn_a_plane() -> None:
    """A slab seen at a glance, with little noise, on a noisy wall of many points."""
    rng = np.random.default_rng(4)
    wall = patch((0, 0, -1), (6, 0, 0), (0, 0, 5), 60_000, noise=0.01)
    slab = patch((1, 0, 1), (3, 0, 0), (0, 1.2, 0), 400, seed=9, noise=0.0005)
    rest = patch((0, -6, -1), (6, 0, 0), (0, 6, 0), 20_000, seed=3, noise=0.01)
    out = extracted(np.vstack([wall, slab, rest])[rng.permutation(80_400)])
    row = out.planes.frame.set_index("plane_id").loc[3]
    assert row.tilt < 0.02  # the limit is some 0.005
    assert row.points == pytest.approx(400, rel=0.1)


def test_what_hides_a_wall_is_no_ghost_of_it() -> None:
    """Shutters before a wall by five times the noise, across which three squares of a gap lie."""
    wall = patch((0, 0, 0), (8, 0, 0), (0, 0, 5), 36_000, noise=0.01)
    u, v = (wall - FAR)[:, [0, 2]].T
    shut = (v > 1) & (v < 2.5) & (u % 2 > 0.5) & (u % 2 < 0.9)
    out = extracted(wall - np.where(shut, 0.05, 0.0)[:, None] * [0.0, 1.0, 0.0])
    assert out.count == 5
    assert out.planes.frame.points[1:].between(0.9 * shut.sum() / 4, 1.1 * shut.sum() / 4).all()


def test_clutter_does_not_turn_a_plane() -> None:
    """Things that lie at one side of a slab, within the tolerance that a noisy wall asks for."""
    rng = np.random.default_rng(4)
    wall = patch((0, 6, 0), (6, 0, 0), (0, 0, 5), 60_000, noise=0.01)
    slab = patch((1, 0, 1), (3, 0, 0), (0, 1.2, 0), 1000, seed=9, noise=0.0005)
    things = FAR + [1, 0, 1] + rng.random((100, 3)) * [3, 0.2, 0.02]
    out = extracted(np.vstack([wall, slab, things])[rng.permutation(61_100)])
    assert out.count == 2
    assert out.planes.frame.tilt[1] < 0.02


def test_an_obtuse_edge_does_not_turn_a_plane() -> None:
    """Each point is given to the nearer plane: what is left along the edge lies to one side."""
    slope = math.tan(math.radians(40))
    xyz = np.vstack(
        [
            patch((0, 0, 0), (0.7, 0, 0), (0, 0, 3), 20_000, noise=0.01),
            patch((0.7, 0, 0), (0.7, 0.7 * slope, 0), (0, 0, 3), 20_000, seed=5, noise=0.01),
        ]
    )
    frame = extracted(xyz).planes.frame
    turned = np.degrees(np.arctan2(frame.normal_x, frame.normal_y)) % 180
    turned = np.sort(np.minimum(turned, 180 - turned))
    assert turned == pytest.approx([0.0, 40.0], abs=0.06)


def test_noise_of_a_dense_scan() -> None:
    """Points a centimetre apart with noise of two: cells of a few points are balls."""
    out = extracted(patch((0, 0, 0), (3, 0, 0), (0, 0, 3), 60_000, noise=0.02))
    assert out.noise == pytest.approx(0.02, rel=0.1)
    assert (out.count, out.share > 0.995) == (1, True)


@pytest.mark.parametrize(("whole", "share"), [(True, 1.0), (False, 0.5)])
def test_points_of_a_sparse_cell_need_not_hang_together(whole: bool, share: float) -> None:
    """Two groups of points three metres apart in one cell, such as panes of two windows."""
    rng = np.random.default_rng(3)
    groups = rng.random((2, 14, 2)) * 0.5 + [[[0.0, 0.0]], [[3.0, 0.0]]]
    xyz = np.column_stack([groups.reshape(-1, 2), rng.normal(0, 0.001, 28)])
    cells = sort_into_cells(xyz, origin=np.zeros(3), noise=0.001)
    assert len(cells.counts) == 1
    rules = Rules(tolerance=0.01, angle=0.3, gap=0.6, min_points=10, min_extent=0.1)
    (found,) = Search(cells, rules, whole=whole).patches()
    assert found.over(xyz, rules.gap).mean() == share


def test_steps_of_a_wall_are_planes_of_their_own() -> None:
    """A door 5 cm behind the wall; with a tolerance of that size it is taken for the wall."""
    wall = patch((0, 0, 0), (4, 0, 0), (0, 0, 3), 6000)
    inside = (wall - FAR)[:, 0] > 3
    wall[inside] += [0, 0.05, 0]
    out = extracted(wall)
    assert out.count == 2
    ids = ids_of(out)
    assert (ids[inside] == 2).mean() > 0.98
    assert (ids[~inside] == 1).mean() > 0.98
    assert extracted(wall, tolerance=0.06).count == 1


def test_limits_leave_small_planes_out() -> None:
    xyz = np.vstack([corner(), patch((20, 0, 0), (0.3, 0, 0), (0, 0, 2), 300)])
    assert extracted(xyz).count == 5
    assert extracted(xyz, min_points=400).count == 4
    assert extracted(xyz, min_extent=0.5).count == 4


def test_steps_of_a_wall_are_not_its_noise() -> None:
    """Panes 15 cm behind the wall: every second cell of a metre holds some of both."""
    rng = np.random.default_rng(4)
    u, v = (np.mgrid[0:20:0.05, 0:9:0.05].reshape(2, -1)) + rng.normal(0, 0.01, (2, 72_000))
    pane = (u % 3.5 > 0.7) & (u % 3.5 < 3.3) & (v % 3 > 0.6) & (v % 3 < 2.7)
    away = np.where(pane, rng.normal(0.15, 0.01, u.size), rng.normal(0, 0.002, u.size))
    assert sort_into_cells(np.column_stack([u, away, v])).noise < 0.015


def test_neighbours_tell_noise_from_steps() -> None:
    """Neighbours differ across a plane as any two points do, but not where there are steps."""
    rng = np.random.default_rng(5)
    xyz = np.column_stack([rng.random((2000, 2)) * [4, 3], rng.normal(0, 0.02, 2000)])
    assert between_neighbours(xyz, 0.0, 0.0, 1.0) == pytest.approx(0.02**2, rel=0.1)
    xyz[xyz[:, 0] > 2, 2] += 0.2
    assert between_neighbours(xyz, 0.0, 0.0, 1.0) < 0.1 * xyz[:, 2].var()


@pytest.mark.parametrize("seed", [0, 1])
def test_noisy_panes_behind_a_narrow_wall_are_no_part_of_it(seed: int) -> None:
    """Half of what is seen are panes 13 cm back, and noisier than the wall."""
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, 20_000)) * [[16], [5]]
    pane = (u % 4 > 0.5) & (v < 4)
    away = np.where(pane, 0.13, 0.0) + rng.normal(0, np.where(pane, 0.028, 0.02))
    out = extracted(np.column_stack([u, away, v]))
    ids = out.segmented["plane_id"]
    shares = np.array([pane[ids == number].mean() for number in range(1, out.count + 1)])
    assert np.minimum(shares, 1 - shares).max() < 0.02
    assert out.used_tolerance == pytest.approx(2 * out.noise)


@pytest.mark.slow
def test_noise_of_a_wall_behind_quiet_ground() -> None:
    """Ground at a glance is flat in small cells; the wall, noise 3 cm, only in large ones."""
    xyz = scene("facade", size=22.0, density=900.0, seed=11, noise=0.03).xyz
    assert sort_into_cells(xyz).noise == pytest.approx(0.027, rel=0.1)


def test_noise_is_found_and_a_tolerance_below_it_is_told(caplog: pytest.LogCaptureFixture) -> None:
    for noise in (0.002, 0.01):
        wall = patch((0, 0, 0), (8, 0, 0), (0, 0, 6), 20_000, noise=noise)
        out = extracted(wall)
        assert out.noise == pytest.approx(noise, rel=0.25)
        assert out.used_tolerance == pytest.approx(3.3 * out.noise)
        assert out.count == 1
        assert out.share > 0.995
    assert not caplog.records
    extracted(wall, tolerance=0.01)
    assert "planes fall to pieces" in caplog.text


def test_planes_without_noise() -> None:
    grid = np.array([(x, y, 0.25 * x) for x in range(20) for y in range(20)], float)
    out = extracted(grid + FAR)
    assert out.count == 1
    assert out.share == 1.0


def test_millimetres_and_feet() -> None:
    mm = extracted(1000 * (corner() - FAR), crs=parse_crs("local:mm"))
    metres = extracted(corner() - FAR, crs=LOCAL)
    np.testing.assert_array_equal(ids_of(mm), ids_of(metres))
    assert mm.noise == pytest.approx(metres.noise, rel=1e-6)
    assert 0.001 < mm.noise < 0.01
    assert list(mm.planes.frame.area) == pytest.approx(list(1e6 * metres.planes.frame.area))


def test_unit_missing_is_said() -> None:
    with pytest.raises(DataError, match=r"no CRS; .*local:mm for millimetres"):
        extracted(corner() - FAR, crs=None)


def test_regular_planes() -> None:
    """Walls that lean by half a degree, and a window front in line with one of them."""
    lean = math.tan(math.radians(0.1))
    xyz = np.vstack(
        [
            patch((0, 0, 0), (8, 0, 0), (0, 0, 3), 6000),
            patch((0, 0, 0), (6 * lean, 6, 0), (0, 0, 6), 3000, seed=2),
            patch((12, 0, 0), (2, 0, 0), (0, 2 * lean, 2), 1000, seed=3),
        ]
    )
    loose, tidy = extracted(xyz), extracted(xyz, regularise=True)
    assert (loose.count, tidy.count) == (3, 2)
    normals = tidy.planes.frame[["normal_x", "normal_y", "normal_z"]].to_numpy()
    assert abs(normals[0] @ normals[1]) < 1e-12
    before = loose.planes.frame[["normal_x", "normal_y", "normal_z"]].to_numpy()
    assert abs(before[0] @ before[1]) > 1e-5
    far = extracted(xyz, regularise=True, regular_angle=0.01)
    assert far.count == 3


def test_a_plane_stays_with_its_points() -> None:
    """A long wall that is 1.5 degrees off square would leave them by centimetres."""
    lean = math.tan(math.radians(1.5))
    one = patch((0, 0, 0), (8, 0, 0), (0, 0, 3), 6000)
    other = patch((0, 0, 0), (6 * lean, 6, 0), (0, 0, 3), 3000, seed=2)
    frame = extracted(np.vstack([one, other]), regularise=True).planes.frame
    normals = frame[["normal_x", "normal_y"]].to_numpy()
    assert abs(normals[0] @ normals[1]) == pytest.approx(math.sin(math.radians(1.5)), rel=0.02)


def test_withheld_points_and_attributes() -> None:
    xyz = corner()
    columns: dict[str, NDArray[Any]] = {
        "intensity": np.arange(len(xyz)).astype(np.uint16),
        "red": np.full(len(xyz), 300, np.uint16),
        "withheld": (np.arange(len(xyz)) < 4000).astype(np.uint8),
    }
    out = PlanesExtract(points=PointCloud(xyz, columns, crs=UTM)).run()
    assert out.count == 3
    assert not ids_of(out)[:4000].any()
    for name, values in columns.items():
        np.testing.assert_array_equal(out.segmented[name], values)


# Bad input --------------------------------------------------------------------------------------


def test_too_few_points_lines_and_places() -> None:
    with pytest.raises(DataError, match="needs 3 points, there are 2"):
        extracted(FAR + np.zeros((2, 3)))
    line = FAR + np.arange(500)[:, None] * [1.0, 0.5, 0.25]
    with pytest.raises(DataError, match="all 500 are on a line"):
        extracted(line)
    with pytest.raises(DataError, match="at one place"):
        extracted(FAR + np.zeros((500, 3)))
    with pytest.raises(DataError, match="finite numbers, got y = nan at point 3"):
        extracted(np.where(np.arange(1500).reshape(-1, 3) == 10, np.nan, corner()[:500]))
    with pytest.raises(ParameterError, match="tolerance: must be > 0"):
        extracted(corner(), tolerance=0.0)


def test_lengths_below_rounding_are_errors() -> None:
    with pytest.raises(DataError, match="tolerance: 1e-300 is too small for points"):
        extracted(corner(), tolerance=1e-300)
    with pytest.raises(DataError, match="plane_gap: 1e-09 is too small for points"):
        extracted(corner(), plane_gap=1e-9)


def test_draws_are_no_more_than_allowed() -> None:
    assert extracted(corner(), max_trials=1).trials == 1
    rng = np.random.default_rng(1)
    assert extracted(FAR + rng.random((5000, 3)), tolerance=0.02, max_trials=600).trials <= 600


def test_no_plane_at_all(caplog: pytest.LogCaptureFixture) -> None:
    cloud = FAR + np.random.default_rng(1).uniform(0, 10, (3000, 3))
    out = extracted(cloud, tolerance=0.01)
    assert out.count == 0
    assert "no plane was found" in caplog.text
    assert not ids_of(out).any()
    assert len(out.planes) == len(out.elevation) == 0


def test_duplicates_change_nothing() -> None:
    xyz = corner()
    once, twice = extracted(xyz, min_points=100), extracted(np.vstack([xyz, xyz]), min_points=200)
    assert twice.count == once.count
    same = ids_of(twice)
    np.testing.assert_array_equal(same[: len(xyz)], same[len(xyz) :])


# House fronts with truth ------------------------------------------------------------------------


def truth_of(data: Any) -> tuple[NDArray[np.int64], geopandas.GeoDataFrame]:
    """The true plane of each point, faces that are one plane and touch joined, and the faces."""
    rows = [dict(p, geometry=s) for s, p in data.features if "plane_id" in p]
    faces = geopandas.GeoDataFrame(rows).set_index("plane_id")
    joined = np.arange(faces.index.max() + 1)
    fronts = faces[faces.kind == "balcony"]
    for one, a in fronts.iterrows():
        for other, b in fronts.iterrows():
            normal = np.array([a.normal_x, a.normal_y, a.normal_z])
            alike = abs(normal @ [b.normal_x, b.normal_y, b.normal_z]) > 1 - 1e-9
            if other > one and alike and abs(a.offset - b.offset) < 1e-6:
                gap = np.linalg.norm(
                    shapely.get_coordinates(a.geometry, include_z=True)[:, None]
                    - shapely.get_coordinates(b.geometry, include_z=True),
                    axis=2,
                ).min()
                joined[other] = joined[one] if gap < 0.01 else other
    return joined[data.attributes["plane_id"].astype(np.int64)], faces


def least_error(xyz: NDArray[np.float64], normal: NDArray[np.float64]) -> float:
    """Standard deviation of the normal of a plane of least squares through points, degrees."""
    near = xyz - xyz.mean(axis=0)
    spread = np.linalg.eigvalsh(near.T @ near)[1:]
    return math.degrees(float((near @ normal).std() * np.sqrt((1 / spread).sum())))


def check_front(
    seed: int, size: float, density: float, noise: float = NOISE
) -> tuple[float, float, float]:
    """Correctness, completeness and IoU of the wall; asserts on all larger planes."""
    data = scene("facade", size=size, density=density, seed=seed, noise=noise)
    true, faces = truth_of(data)
    cloud = PointCloud(data.xyz, {}, crs=UTM)
    out = PlanesExtract(points=cloud).run()
    ids = ids_of(out)
    count = np.zeros((out.count + 1, true.max() + 1), np.int64)
    np.add.at(count, (ids, true), 1)
    frame = out.planes.frame.set_index("plane_id")
    for face in np.flatnonzero(count.sum(axis=0) >= 200):
        row = faces.loc[face]
        if shapely.length(row.geometry) < 3.2 or row.kind in ("reveal", "glass"):
            continue  # no larger than half a square metre, or too few points
        best = int(count[1:, face].argmax()) + 1
        assert count[best, face] > 0.8 * count[:, face].sum(), (seed, row.kind)
        found = frame.loc[best]
        normal = np.array([row.normal_x, row.normal_y, row.normal_z])
        own = np.array([found.normal_x, found.normal_y, found.normal_z])
        angle = math.degrees(math.asin(min(1.0, float(np.linalg.norm(np.cross(own, normal))))))
        middle = data.xyz[ids == best].mean(axis=0)
        off = abs(normal @ middle - row.offset)
        # Of small planes with much noise no better normal can be known.
        assert angle < max(0.05, 3.5 * least_error(data.xyz[true == face], normal)), (
            *(seed, row.kind, angle),
        )
        assert off < 0.002, (seed, row.kind, off)
    size, own = count[1:].sum(axis=1), count[1:].max(axis=1)
    assert (2 * own > size)[size >= 200].all(), "invented"
    pieces = (count[1:] > 0.1 * count.sum(axis=0)).sum(axis=0)
    assert (pieces[count.sum(axis=0) >= 200] <= 1).all(), "split"
    wall = int(faces.index[faces.kind == "wall"][0])
    best = int(count[1:, wall].argmax()) + 1
    both = count[best, wall]
    o, e = count[best].sum(), count[:, wall].sum()
    return both / o, both / e, both / (o + e - both)


def test_a_front_against_its_truth() -> None:
    correctness, completeness, iou = check_front(1, 20.0, 400.0)
    assert correctness > 0.98
    assert completeness > 0.98
    assert iou > 0.965


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_ten_fronts(seed: int) -> None:
    """With a bay, a bush and noise of 2 to 10 mm."""
    noise = (0.002, 0.004, 0.006, 0.01)[seed % 4]
    correctness, completeness, iou = check_front(seed, 26.0 + seed, 900.0, noise)
    assert correctness > (0.995 if noise < 0.005 else 0.98)
    assert completeness > (0.995 if noise < 0.005 else 0.98)
    assert iou > (0.99 if noise < 0.005 else 0.965)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_a_palace_is_one_front(seed: int) -> None:
    """Pilasters 0.5 m before the wall, balconies, shutters, a tree: segments and their front."""
    data = scene("facade", size=24.0, density=900.0, seed=seed, relief=0.5, noise=0.006)
    out = extracted(data.xyz)
    true, faces = truth_of(data)
    ids, fronts = ids_of(out), out.segmented["front_id"]
    parts = ("wall", "pilaster", "course", "cornice", "shutter", "door")
    across = np.array([-math.sin(math.radians(17)), math.cos(math.radians(17))])
    kept, whole = [], []
    owner = np.array([np.bincount(true[ids == k]).argmax() for k in range(out.count + 1)])
    for face in faces[faces.kind.isin(parts)].itertuples():
        own = true == face.Index
        if own.sum() < 200 or abs(across @ [face.normal_x, face.normal_y]) < 0.99:
            continue
        kept.append(((owner[ids[own]] == face.Index) & (ids[own] > 0)).mean() > 0.8)
        whole.append(np.unique(fronts[own & (fronts > 0)], return_counts=True))
    assert len(kept) > 15
    assert np.mean(kept) >= 0.9
    largest = {int(numbers[counts.argmax()]) for numbers, counts in whole}
    assert len(largest) == 1


# Real scans -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "crs", "noise", "share"),
    [
        ("facade_pcl_cornice/region_growing_tutorial.pcd", "local:mm", (0.001, 0.005), 0.7),
        ("tls_plane_target/plane.laz", "local", (0.002, 0.008), 0.9),
        ("facade_street_corner/street_thinned.las", "local", (0.03, 0.07), 0.7),
        ("vaihingen_roofs/test3.txt.gz", "local", (0.02, 0.06), 0.75),
    ],
)
def test_real_scans(
    data: Callable[[str], Path], name: str, crs: str, noise: tuple[float, float], share: float
) -> None:
    out = PlanesExtract(points=PointCloud.open(data(name), assume_crs=parse_crs(crs))).run()
    assert noise[0] < out.noise < noise[1]
    assert out.share > share
    assert (out.planes.frame.rms <= out.used_tolerance * out.segmented.metre).all()


@pytest.mark.parametrize("name", ["facade_1.txt.gz", "facade_2.txt.gz"])
def test_noise_of_real_shop_fronts(data: Callable[[str], Path], name: str) -> None:
    """Bricks with a noise of 2 mm, panes with one of 7 mm, up to 15 cm apart."""
    path = data(f"facade_street_openings/{name}")
    xyz = np.loadtxt(path, skiprows=1, usecols=(0, 1, 2))
    assert 0.003 < sort_into_cells(xyz).noise < 0.015
    for seed in range(3):
        half = xyz[np.random.default_rng(seed).random(len(xyz)) < 0.5]
        assert 0.003 < sort_into_cells(half).noise < 0.02


@pytest.mark.parametrize(
    ("number", "share", "noise", "degrees", "seed"),
    [
        *((1, 0.5, 0.02, 75, 14), (2, 0.5, 0.02, 160, 23)),
        *((1, 1.0, 0.03, 50, 26), (1, 1.0, 0.03, 200, 42)),
        *((1, 1.0, 0.03, 274, 202), (1, 1.0, 0.04, 337, 301)),  # cut by a slanted plane
    ],
)
def test_noisy_walls_are_not_joined_with_their_panes(
    data: Callable[[str], Path],
    number: int,
    share: float,
    noise: float,
    degrees: float,
    seed: int,
) -> None:
    """A real front with noise, turned: the largest plane is wall, not windows."""
    table = np.loadtxt(data(f"facade_street_openings/facade_{number}.txt.gz"), skiprows=1)
    rng = np.random.default_rng(seed)
    some = table[rng.random(len(table)) < share]
    some[:, :3] += rng.normal(0.0, noise, (len(some), 3))
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    some[:, :2] = some[:, :2] @ np.array([[cosine, sine], [-sine, cosine]])
    out = PlanesExtract(points=PointCloud(some[:, :3], crs=LOCAL)).run()
    largest = ids_of(out) == 1
    assert (some[largest, 4] == 1).mean() > 0.75


def test_points_that_come_twice_make_no_scan_denser() -> None:
    """With all points twice neighbours were 0.7 times as far apart, and planes fell to pieces."""
    rng = np.random.default_rng(4)
    wall = rng.random((20_000, 3)) * [10, 0, 6] + rng.normal(0, 0.01, (20_000, 3))
    once, twice = sort_into_cells(wall), sort_into_cells(np.vstack([wall, wall]))
    assert (twice.noise, twice.apart) == (once.noise, once.apart)


def test_larger_cells_tell_the_noise_only_by_more_than_chance() -> None:
    """Nine planes of 71 cells are no more than 25 of 279; 300 of 1252 are more than 50 of 5115."""
    assert not _Share(9 / 71, 71).clearly_over(_Share(25 / 279, 279))
    assert _Share(300 / 1252, 1252).clearly_over(_Share(50 / 5115, 5115))
    assert not _Share(0.105, 100_000).clearly_over(_Share(0.1, 100_000))  # no chance, but alike
    assert not _Share(0.0, 50).clearly_over(_Share(0.0, 100))


def test_noise_of_4_cm_is_not_that_of_wall_and_panes(data: Callable[[str], Path]) -> None:
    """The largest cells, of 2,048 points along the wall, hold panes too: 6.9 cm were found."""
    path = data("facade_street_openings/facade_1.txt.gz")
    xyz = np.loadtxt(path, skiprows=1, usecols=(0, 1, 2))
    turn = 0.0338  # radians: along the axes
    cosine, sine = np.cos(turn), np.sin(turn)
    xyz[:, :2] = (xyz[:, :2] - xyz[:, :2].min(axis=0)) @ [[cosine, -sine], [sine, cosine]]
    for seed in (0, 4, 6):
        noisy = xyz + np.random.default_rng(seed).normal(0.0, 0.04, xyz.shape)
        assert 0.035 < sort_into_cells(noisy).noise < 0.05


def test_a_wall_of_few_points(data: Callable[[str], Path]) -> None:
    """Six cells hold all of the wall beside the street, some of them trees or rooms too."""
    path = data("facade_street_corner/street_thinned.las")
    out = PlanesExtract(points=PointCloud.open(path, assume_crs=LOCAL)).run()
    frame = out.planes.frame
    assert frame.points[frame.tilt > 89].max() > 170


def test_fronts_higher_than_any_building_ask_for_the_unit(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A wall of 8 by 3 m, once in metres and once in millimetres that are read as metres."""
    wall = patch((0, 0, 0), (8, 0, 0), (0, 0, 3), 3000, noise=0.0) - FAR
    for factor, told in ((1.0, False), (1000.0, True)):
        caplog.clear()
        out = PlanesExtract(points=PointCloud(wall * factor, crs=LOCAL)).run()
        assert out.front_count == 1
        assert ("are the points in millimetres?" in caplog.text) == told
    assert "the fronts are 2999 m high" in caplog.text
