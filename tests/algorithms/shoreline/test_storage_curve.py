"""shoreline.storage_curve: bodies of known volume, what is joined, outlines, gaps, units."""

from __future__ import annotations

import logging
import math
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pyproj import CRS
from scenes.layers import NORTH, UTM, WEST, cloud, raster

from algorithms.shoreline._basin_pieces import Pieces
from algorithms.shoreline._basin_raster import RasterBasin, _of_any_square
from algorithms.shoreline._level import NINETY_FIVE
from algorithms.shoreline.storage_curve import ShorelineStorageCurve, height_system, storage
from algorithms.surface.flatten_water import SurfaceFlattenWater
from toolbox.context import Context
from toolbox.data import Lattice, PointCloud, Raster, Vector
from toolbox.declare import ClassList, Position
from toolbox.errors import Cancelled, DataError, NothingToDo, ParameterError

Floats = NDArray[np.float64]
FEET = CRS(2263)
FOOT = 1200 / 3937


def outline(shape: Any, crs: CRS = UTM) -> Vector:
    """A polygon counted from the north-western corner, y downwards."""
    placed = shapely.transform(shape, lambda xy: np.array([WEST, NORTH]) + xy * [1, -1])
    return Vector(geopandas.GeoDataFrame(geometry=[placed], crs=crs), name="o.gpkg")


def curve(**how: Any) -> Any:
    return ShorelineStorageCurve(**how).run().curve.frame


def bowl(reach: float = 60.0, cell: float = 1.0) -> tuple[Raster, Floats]:
    """A paraboloid, 10 m deep at a radius of 50 m, as cells and as random points."""
    steps = np.arange(-reach, reach + cell / 2, cell)
    x, y = np.meshgrid(steps, steps)
    places = np.random.default_rng(0).uniform(-reach, reach, (len(steps) ** 2, 2))
    xyz = np.column_stack([places + np.array([WEST, NORTH]), 100 + (places**2).sum(axis=1) / 250])
    return raster(100 + (x**2 + y**2) / 250, cell), xyz


def below(z: Floats, area: float, level: float, n: int = 400) -> tuple[float, float]:
    """Area and volume under a level in one triangle, from many samples in it."""
    u, v = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n)
    swap = u + v > 1
    u, v = np.where(swap, 1 - u, u), np.where(swap, 1 - v, v)
    depth = level - (z[0] + u * (z[1] - z[0]) + v * (z[2] - z[0]))
    return area * (depth > 0).mean(), area * np.maximum(depth, 0).mean()


corners = st.lists(st.sampled_from([0.0, 0.5, 1.0, 2.0, 2.5, 3.75]), min_size=3, max_size=3)


@given(corners)
@settings(max_examples=30)
def test_a_triangle_is_summed_up_in_closed_form(z: list[float]) -> None:
    levels = np.arange(-1, 5, 0.5)
    one = Pieces(np.array([[0, 1, 2]]), np.array(z), np.array([7.0]), np.array([-np.inf]))
    area, volume, everything = storage([one], levels)
    wanted = np.array([below(np.array(z), 7.0, level) for level in levels])
    np.testing.assert_allclose(np.column_stack([area, volume]), wanted, atol=0.05)
    np.testing.assert_array_equal(area, everything)


@given(corners, st.floats(-1, 4.9))
def test_volume_is_the_integral_of_area(z: list[float], joined: float) -> None:
    """Also below the level at which the triangle is joined, where there is none."""
    levels = np.linspace(-1, 5, 6001)
    one = Pieces(np.array([[0, 1, 2]]), np.array(z), np.array([2.0]), np.array([joined]))
    area, volume, _ = storage([one], levels)
    assert (area[levels <= joined] == 0).all()
    assert (volume[levels <= joined] == 0).all()
    after = np.flatnonzero(levels > joined)
    steps = (area[after][1:] + area[after][:-1]) / 2 * np.diff(levels[after])
    np.testing.assert_allclose(np.cumsum(steps), volume[after][1:] - volume[after][0], atol=2e-3)


@pytest.mark.parametrize("kind", ["terrain", "points"])
def test_a_bowl_has_the_volume_of_a_paraboloid(kind: str) -> None:
    ground, xyz = bowl()
    source: dict[str, Any] = {"terrain": ground} if kind == "terrain" else {"points": cloud(xyz)}
    out = ShorelineStorageCurve(**source, step=2.0, highest=110.0).run()
    frame = out.curve.frame
    depth = frame["level"] - 100
    assert frame["level"].tolist() == [100, 102, 104, 106, 108, 110]
    near = 1e-3 if kind == "terrain" else 4e-3  # random points, 1 per m2
    np.testing.assert_allclose(frame["area_m2"][2:], (math.pi * 250 * depth)[2:], rtol=near)
    np.testing.assert_allclose(frame["volume_m3"][2:], (math.pi * 125 * depth**2)[2:], rtol=near)
    assert out.volume == frame["volume_m3"].iloc[-1]
    assert out.volume == pytest.approx(math.pi * 12500, rel=1e-3)
    np.testing.assert_allclose(frame["volume_gain_m3"].cumsum(), frame["volume_m3"])
    np.testing.assert_allclose(frame["area_gain_m2"].cumsum(), frame["area_m2"])
    assert not frame["open"].any()
    assert (frame["apart_m2"] == 0).all()
    assert out.lowest_ground == pytest.approx(100, abs=0.01)
    assert out.missing_share == 0


def test_a_plane_is_exact() -> None:
    """A wedge of 10 m x 8 m under a level 1 m above its lowest edge."""
    ground = raster(np.tile(np.arange(11.0) / 10, (9, 1)))
    frame = curve(terrain=ground, step=0.25)
    np.testing.assert_allclose(frame["area_m2"], 80 * frame["level"], rtol=1e-12)
    np.testing.assert_allclose(frame["volume_m3"], 40 * frame["level"] ** 2, rtol=1e-12)
    xyz = np.array([[0, 0, 0], [10, 0, 1], [10, 8, 1], [0, 8, 0.0]]) + np.array([WEST, NORTH, 0])
    again = curve(points=cloud(xyz), step=0.25)
    np.testing.assert_allclose(again["volume_m3"], frame["volume_m3"], rtol=1e-9)


def two_valleys() -> Floats:
    """Bottoms at 0 and 1 in a row of cells, a ridge of 5 between them and walls of 9."""
    section = np.array([9, 4, 0, 4, 5, 4, 1, 4, 9.0])
    ground = np.tile(section, (7, 1))
    ground[[0, -1]] = 9
    return ground


def test_a_side_valley_counts_when_water_gets_there() -> None:
    ground = raster(two_valleys())
    joined, everything = (curve(terrain=ground, fill=how) for how in ("connected", "all"))
    level = joined.set_index("level")
    assert level["apart_m2"][1.0] == 0
    assert 0 < level["apart_m2"][5.0] < level["area_m2"][5.0]
    assert level["apart_m2"][6.0] == 0
    both = everything.set_index("level")
    np.testing.assert_allclose(level["area_m2"] + level["apart_m2"], both["area_m2"])
    assert level["volume_m3"][5.0] < both["volume_m3"][5.0]
    np.testing.assert_allclose(level["volume_m3"][[6.0, 9.0]], both["volume_m3"][[6.0, 9.0]])
    assert (both["apart_m2"] == 0).all()


@pytest.mark.parametrize("kind", ["terrain", "points"])
def test_the_place_named_chooses_the_basin(kind: str) -> None:
    """With a highest level below the ridge each valley is its own, above it they are one."""
    z = two_valleys()
    rows, cols = np.mgrid[: z.shape[0], : z.shape[1]]
    x, y = WEST + cols.ravel() + 0.5, NORTH - rows.ravel() - 0.5
    source: dict[str, Any] = {"terrain": raster(z)}
    if kind == "points":
        source = {"points": cloud(np.column_stack([x, y, z.ravel()]))}
    east = {"seed_point": Position(WEST + 6.4, NORTH - 3.6)}
    for seed, highest, lowest in (({}, 4.5, 0), (east, 4.5, 1), (east, 8.0, 0)):
        out = ShorelineStorageCurve(**source, **seed, highest=highest).run()
        assert out.lowest_ground == lowest
    mirrored = curve(**source, highest=4.5, **east)
    assert mirrored["area_m2"].iloc[0] == 0
    assert mirrored["area_m2"].iloc[-1] > 0


def test_water_at_the_edge_is_told(caplog: pytest.LogCaptureFixture) -> None:
    ground = two_valleys()
    ground[-1, 2] = 3.0  # a way out
    with caplog.at_level(logging.WARNING):
        out = ShorelineStorageCurve(terrain=raster(ground), step=1.0).run()
    assert out.opens == 3
    frame = out.curve.frame
    assert frame["level"][frame["open"]].min() == 3
    assert "from 3.000 m on the water reaches the edge" in caplog.text


def test_a_gap_opens_the_basin_and_is_counted(caplog: pytest.LogCaptureFixture) -> None:
    ground = bowl()[0].band().astype(float)
    ground[60, 90] = np.nan  # at 30 m: 3.6 m above the ground; its cells are four squares
    with caplog.at_level(logging.WARNING):
        out = ShorelineStorageCurve(terrain=raster(ground), highest=110.0).run()
    assert out.missing_share == pytest.approx(4 / 120**2)
    assert out.opens == pytest.approx(100 + 29**2 / 250)
    assert "has no ground" in caplog.text


def test_what_lies_outside_of_the_data_is_no_gap(caplog: pytest.LogCaptureFixture) -> None:
    """Of a triangle in its rectangle, half was said to have no ground."""
    ground = bowl()[0].band().astype(float)
    ground[np.tri(*ground.shape, k=-20, dtype=bool)] = np.nan
    with caplog.at_level(logging.WARNING):
        assert ShorelineStorageCurve(terrain=raster(ground), highest=110.0).run().missing_share == 0
    assert "has no ground" not in caplog.text


def test_gaps_between_points() -> None:
    _, xyz = bowl()
    away = np.hypot(*(xyz[:, :2] - [WEST + 30, NORTH]).T)
    points = cloud(xyz[away > 8])
    spanned = ShorelineStorageCurve(points=points, highest=110.0).run()
    assert spanned.missing_share == 0
    assert spanned.opens is None or spanned.opens > 110
    gap = ShorelineStorageCurve(points=points, highest=110.0, max_gap=3.0).run()
    hole = 64 * math.pi / 120**2  # and some thin triangles at the hull
    assert hole < gap.missing_share < 2 * hole
    assert gap.opens == pytest.approx(100 + 22**2 / 250, abs=0.15)
    assert gap.volume < spanned.volume


@pytest.mark.parametrize("kind", ["terrain", "points"])
def test_an_outline_is_cut_exactly(kind: str) -> None:
    """A plane under polygons with a hole, crooked and concave, of which the volume is known."""
    x, y = np.meshgrid(np.arange(41.0), np.arange(41.0))
    z = 0.25 * x + 0.125 * y
    source: dict[str, Any] = {"terrain": raster(z)}
    if kind == "points":
        keep = np.random.default_rng(0).random(z.shape) < 0.5
        keep[[0, 0, -1, -1], [0, -1, 0, -1]] = True
        xyz = np.column_stack([WEST + 0.5 + x[keep], NORTH - 0.5 - y[keep], z[keep]])
        source = {"points": cloud(xyz)}
    star = [(5, 7), (31.3, 6.1), (22, 15), (36, 30.7), (17, 24), (6.5, 38.2), (11, 20)]
    shape = shapely.Polygon(star, [[(18, 12), (20.2, 13), (17, 18)]])
    out = ShorelineStorageCurve(**source, outline=outline(shape), highest=30.0, fill="all").run()
    assert out.area == pytest.approx(shape.area, rel=1e-9)
    centre = shape.centroid
    mean = 0.25 * (centre.x - 0.5) + 0.125 * (centre.y - 0.5)
    assert out.volume == pytest.approx(shape.area * (30 - mean), rel=1e-9)
    assert out.missing_share == 0
    level = 6.0  # the shore is where x / 4 + y / 8, from the centre of the first cell, is that
    shore = [(0.5 + 4 * level - t / 2, 0.5 + t) for t in (-900, 900)]
    half = shapely.Polygon([*shore, (-9999, 900), (-9999, -900)])
    wet = shapely.intersection(shape, half)
    at = ShorelineStorageCurve(**source, outline=outline(shape), highest=level, fill="all").run()
    assert at.area == pytest.approx(wet.area, rel=1e-9)


def test_an_outline_is_a_wall_and_may_stick_out() -> None:
    ground = two_valleys()
    wall = outline(shapely.box(0.5, 0.5, 4.2, 6.5))
    out = ShorelineStorageCurve(terrain=raster(ground), outline=wall, highest=9.0).run()
    assert out.area == pytest.approx(3.7 * 6)
    assert out.missing_share == 0
    wide = outline(shapely.box(-3.5, 0.5, 4.5, 6.5))
    out = ShorelineStorageCurve(terrain=raster(ground), outline=wide, highest=9.0).run()
    assert out.missing_share == pytest.approx(0.5)


def test_feet_give_the_answer_of_metres() -> None:
    """The levels are in the unit of the heights, all else in metres."""
    _, xyz = bowl()
    metres = ShorelineStorageCurve(points=cloud(xyz), highest=110.0, step=2.0).run()
    feet = ShorelineStorageCurve(points=cloud(xyz / FOOT, crs=FEET), highest=110.0, step=2.0).run()
    here, there = feet.curve.frame, metres.curve.frame
    for name in ("level_m", "area_m2", "volume_m3", "volume_gain_m3"):
        np.testing.assert_allclose(here[name], there[name], rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(here["level"] * FOOT, here["level_m"])
    assert set(here["unit"]) == {"US survey foot"}
    assert feet.volume == pytest.approx(metres.volume, rel=1e-6)
    assert here["heights"][0] == "height system not stated, in US survey foot"


def test_height_systems_are_named() -> None:
    assert height_system(CRS("EPSG:2154+5720")) == "NGF-IGN69 height, in metre"
    assert height_system(CRS(4979).to_3d()).startswith("WGS 84")
    assert height_system(None) == "not stated"


def test_levels() -> None:
    ground = raster([[3.7, 9.0], [9.0, 9.0]])
    assert curve(terrain=ground, step=2.0)["level"].tolist() == [2, 4, 6, 8, 9]
    assert curve(terrain=ground, lowest=4.0, highest=5.0, step=0.1)["level"].tolist() == [
        4.0,
        4.1,
        4.2,
        4.3,
        4.4,
        4.5,
        4.6,
        4.7,
        4.8,
        4.9,
        5.0,
    ]
    assert curve(terrain=raster(np.full((3, 3), 5.0)))["area_m2"].tolist() == [0.0]
    assert curve(terrain=ground, lowest=3.0, step=1e300)["level"].tolist() == [3.0, 9.0]
    flat = curve(terrain=raster(np.full((3, 3), 5.0)), highest=7.0, step=1.0)
    assert flat["volume_m3"].tolist() == [0, 4, 8]


def test_a_small_rise_has_ten_levels_too() -> None:
    """A lake that runs over after 72 cm had a curve of two levels, one straight line."""
    ground = raster([[3.0, 3.72], [3.72, 3.72]])
    assert np.diff(curve(terrain=ground)["level"]).max() == pytest.approx(0.05)
    assert np.diff(curve(terrain=raster([[3.0, 63.0], [63.0, 63.0]]))["level"]).max() == 1.0


@pytest.mark.parametrize(
    ("how", "text"),
    [
        ({"step": 0.0}, "step: must be > 0 m"),
        ({"lowest": 5.0, "highest": 5.0}, r"lowest: must be < highest \(5\), got 5"),
        ({"seed_point": Position(5, 5), "fill": "all"}, "seed_point: is for connected water"),
    ],
)
def test_wrong_settings(how: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        ShorelineStorageCurve(terrain=raster(two_valleys()), **how)


def test_wrong_data() -> None:
    ground, points = raster(two_valleys()), cloud(bowl()[1])
    for how, text in (
        ({}, "points: give points or a terrain, one of both"),
        ({"terrain": ground, "points": points}, "one of both"),
        ({"terrain": ground, "max_gap": 1.0}, "max_gap: is for points"),
        ({"points": points, "classes": ClassList([2])}, "has no classification"),
        ({"terrain": raster(two_valleys(), units=("foot",))}, "holds values in foot"),
    ):
        with pytest.raises(DataError, match=text):
            ShorelineStorageCurve(**how)
    far = outline(shapely.box(900, 900, 901, 901))
    seed = {"seed_point": Position(WEST + 0.7, NORTH - 0.7)}
    for how, text in (
        ({"terrain": raster(np.full((3, 3), np.nan))}, "there is no ground$"),
        ({"terrain": raster([[1.0, 2.0]])}, "two rows and two columns"),
        ({"terrain": ground, "outline": far}, "no ground within the outline"),
        ({"points": points, "outline": far}, "no ground within the outline"),
        ({"terrain": ground, "seed_point": Position(0, 0)}, "seed_point: 0, 0 lies where"),
        ({"terrain": ground, "highest": 5.0, **seed}, "is not below the highest level"),
        ({"terrain": ground, "highest": -1.0}, "highest: -1 is below the lowest ground, 0"),
        ({"terrain": ground, "lowest": 99.0}, "lowest: 99 is above the highest ground, 9"),
        ({"terrain": ground, "step": 1e-6}, "step: makes 9000001 levels"),
        ({"terrain": ground, "highest": 1e300}, r"step: makes 1e\+300 levels"),
        ({"terrain": ground, "step": 1e-308}, "step: makes inf levels"),
        ({"points": points.select(range(2))}, "do not span a triangle"),
    ):
        with pytest.raises(DataError, match=text):
            ShorelineStorageCurve(**how).run()
    classed = cloud(bowl()[1], classification=np.full(121**2, 5, np.uint8))
    with pytest.raises(NothingToDo, match="none is of class 2"):
        ShorelineStorageCurve(points=classed, classes=ClassList([2])).run()


def test_vegetation_is_noticed(caplog: pytest.LogCaptureFixture) -> None:
    _, xyz = bowl()
    classes = np.where(np.arange(len(xyz)) % 3, 2, 5).astype(np.uint8)
    xyz[classes == 5, 2] += 10
    points = cloud(xyz, classification=classes)
    with caplog.at_level(logging.WARNING):
        wrong = ShorelineStorageCurve(points=points, highest=110.0).run()
        assert "points of all classes are taken for ground" in caplog.text
        right = ShorelineStorageCurve(points=points, highest=110.0, classes=ClassList([2])).run()
    assert wrong.volume < 0.9 * right.volume
    assert right.volume == pytest.approx(math.pi * 12500, rel=1e-3)


@pytest.mark.parametrize("kind", ["terrain", "points"])
def test_progress_rises_and_cancel_stops(kind: str) -> None:
    ground, xyz = bowl()
    source: dict[str, Any] = {"terrain": ground} if kind == "terrain" else {"points": cloud(xyz)}
    job = ShorelineStorageCurve(**source, outline=outline(shapely.box(20, 20, 50, 50)))
    seen: list[float] = []
    job.run(Context(seen.append))
    assert seen == sorted(seen)
    with pytest.raises(Cancelled):
        job.run(Context(stop=lambda: True))


@given(st.integers(0, 2**31), st.integers(3, 7), st.integers(3, 7))
@settings(max_examples=30)
def test_water_spreads_where_a_search_says_so(seed: int, rows: int, cols: int) -> None:
    """Against the definition: cells that are one with the lowest, at each level by itself."""
    from scipy.ndimage import label

    z = np.random.default_rng(seed).permutation(rows * cols).reshape(rows, cols).astype(float)
    basin = RasterBasin(z, Lattice(0, 0, 1.0, rows, cols), None)
    basin.fill(None, np.inf)
    for level in np.arange(rows * cols) + 0.5:
        fine = np.full((2 * rows - 1, 2 * cols - 1), np.inf)  # cells, and what is between them
        fine[::2, ::2] = z
        fine[1::2, ::2] = np.maximum(z[1:], z[:-1])
        fine[::2, 1::2] = np.maximum(z[:, 1:], z[:, :-1])
        fine[1::2, 1::2] = (z[1:, 1:] + z[1:, :-1] + z[:-1, 1:] + z[:-1, :-1]) / 4
        bodies, _ = label(fine < level, np.ones((3, 3), int))
        row, col = np.unravel_index(np.argmin(z), z.shape)
        wanted = (bodies == bodies[2 * row, 2 * col]) & (bodies > 0)
        np.testing.assert_array_equal(basin._joined < level, wanted[::2, ::2])


def test_cells_of_squares() -> None:
    squares = np.array([[True, False], [False, False]])
    wanted = [[1, 1, 0], [1, 1, 0], [0, 0, 0]]
    np.testing.assert_array_equal(_of_any_square(squares), np.array(wanted, bool))


def dammed() -> tuple[Raster, Vector]:
    """A lake at 10 m in a basin of 14 m with a gap at 11.5 m, and a valley of 5 m beyond."""
    z = np.full((30, 30), 14.0)
    z[5:15, 5:15] = 10.0
    z[15:18, 9:11] = 11.5
    z[18:30, 5:15] = 5.0
    lattice = Lattice(500_000.0, 4_400_000.0, 1.0, 30, 30)
    terrain = Raster.from_lattice(z, lattice, crs=CRS(32635))
    box = shapely.box(500_005, 4_399_985, 500_015, 4_399_995)
    return terrain, Vector(
        geopandas.GeoDataFrame({"level": [10.0]}, geometry=[box], crs=CRS(32635))
    )


def test_the_curve_of_a_lake_begins_at_its_level_and_ends_where_it_runs_over() -> None:
    terrain, lake = dammed()
    found = ShorelineStorageCurve(terrain=terrain, lake=lake, lowest=10.0, step=0.5).run()
    frame = found.curve.frame
    assert found.lowest_ground == 10.0
    assert found.spill == pytest.approx(11.5)
    assert found.opens is None
    place = found.spill_point.frame.geometry.iloc[0]
    assert (place.x, place.y) == (500_009.5, 4_399_982.5), "the last cell of the gap"
    assert "runs over its rim at 11.500 m, at 500009.5, 4399982.5" in found.in_words()
    assert "above the level of the survey, that is 10.000 m" in found.in_words()
    assert frame["level"].tolist() == [10.0, 10.5, 11.0, 11.5]
    assert frame["area_m2"].iloc[0] == pytest.approx(100.0), "nothing of the valley"
    other = ShorelineStorageCurve(terrain=terrain, lowest=10.0, step=0.5, highest=11.5).run()
    assert other.lowest_ground == 5.0


def test_the_first_level_of_a_lake_has_its_area_and_no_gains() -> None:
    """Its area was a gain, as of a basin that had been empty."""
    terrain, lake = dammed()
    found = ShorelineStorageCurve(terrain=terrain, lake=lake, step=0.5).run()
    frame = found.curve.frame
    assert frame[["area_gain_m2", "volume_gain_m3"]].iloc[0].isna().all()
    assert frame[["area_gain_m2", "volume_gain_m3"]].iloc[1:].notna().all(axis=None)
    assert "The first one is the water of the survey itself" in found.in_words()
    empty = ShorelineStorageCurve(terrain=terrain, step=0.5).run()
    assert "The first one" not in empty.in_words()
    assert empty.curve.frame["area_gain_m2"].notna().all()


def distances(cells: int) -> Raster:
    """Ground points in each cell but within some cells of the gap of `dammed`."""
    away = np.full((30, 30), 0.4)
    away[17 - cells : 18 + cells, 9 - cells : 10 + cells] = 0.5 + cells
    lattice = Lattice(500_000.0, 4_400_000.0, 1.0, 30, 30)
    names = ("z (nearest)", "points used", "distance to the nearest point")
    bands = np.stack([away, away, away])
    return Raster.from_lattice(bands, lattice, crs=CRS(32635), descriptions=names)


@pytest.mark.parametrize(("cells", "told"), [(0, False), (1, True)])
def test_a_spill_that_no_ground_point_is_near_is_told(
    cells: int, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Under a bridge the rim lies between ground on both sides, and seemed to be measured."""
    terrain, lake = dammed()
    near = distances(cells)
    found = ShorelineStorageCurve(terrain=terrain, lake=lake, distances=near).run()
    assert found.spill_point.frame["from_ground"].tolist() == [0.5 + cells]
    assert ("at 500009.5, 4399982.5, is not measured: no ground" in caplog.text) == told


def test_distances_are_those_of_the_cells_of_the_terrain() -> None:
    terrain, lake = dammed()
    with pytest.raises(DataError, match="has no band with the description"):
        ShorelineStorageCurve(terrain=terrain, lake=lake, distances=terrain).run()


def test_limits_of_volumes_hold_the_level_from_which_they_count() -> None:
    """A level that was known to 0.6 m had volumes as sure as those of a calm lake."""
    terrain, lake = dammed()
    unsure = Vector(lake.frame.assign(level_interval=0.6))
    calm, rough = (
        ShorelineStorageCurve(terrain=terrain, lake=one, step=0.5, height_error=0.01).run()
        for one in (lake, unsure)
    )
    one, two = calm.curve.frame, rough.curve.frame
    np.testing.assert_array_equal(one["volume_m3"], two["volume_m3"])
    up = two["volume_high_m3"] - two["volume_m3"]
    np.testing.assert_allclose(up, np.hypot(one["volume_high_m3"] - one["volume_m3"], 60.0))
    assert two["volume_low_m3"].min() == 0, "no water is less than none"
    assert two[["volume_low_m3", "volume_high_m3"]].iloc[0].isna().all(), "volumes count from there"
    last = two.iloc[-1]
    assert last["volume_m3"] - last["volume_low_m3"] == pytest.approx(60.0, rel=0.01)


def risen(heights: Floats, level: float, box: tuple[int, int, int, int], **how: Any) -> Any:
    """The curve of a lake on rows and columns of cells of 1 m; box is its rows and columns."""
    rows, cols = heights.shape
    lattice = Lattice(500_000.0, 4_400_000.0, 1.0, rows, cols)
    top, bottom, left, right = box
    shape = shapely.box(500_000 + left, 4.4e6 - bottom, 500_000 + right, 4.4e6 - top)
    frame = geopandas.GeoDataFrame({"level": [level]}, geometry=[shape], crs=CRS(32635))
    terrain = Raster.from_lattice(heights, lattice, crs=CRS(32635))
    return ShorelineStorageCurve(terrain=terrain, lake=Vector(frame), **how).run()


def test_levels_above_the_rim_count_the_side_of_the_lake_alone(
    caplog: pytest.LogCaptureFixture,
) -> None:
    terrain, lake = dammed()
    found = ShorelineStorageCurve(terrain=terrain, lake=lake, step=0.5, highest=13.0).run()
    frame = found.curve.frame.set_index("level")
    assert frame["overtopped"].tolist() == [False] * 4 + [True] * 3
    assert not frame["open"].any()
    # 10 x 10 m, sides of one cell that rise by 4 m, and a gap of 3 x 2 m at 11.5 m, no valley
    assert 300 < frame["volume_m3"][13.0] < 400
    assert "runs over its rim at 11.500 m, at 500009.5, 4399982.5: levels above" in caplog.text
    assert any("a rim that is raised would hold" in text for text in found.not_looked_at())


def test_a_lake_at_the_edge_is_open_from_its_level_on(caplog: pytest.LogCaptureFixture) -> None:
    """The first row said it was not, as heights of a raster have more digits than levels."""
    heights = np.full((20, 20), 3.0, np.float32)
    heights[5:15, :5] = np.float32(-0.26)
    out = risen(heights, -0.26, (5, 15, 0, 5), step=0.5, highest=2.0)
    assert "from -0.260 m on the water reaches the edge" in caplog.text
    assert out.curve.frame["open"].all()
    assert out.in_words().startswith("The water goes on beyond the edge of the data at all levels")


def test_an_edge_that_the_lake_touches_hides_no_spill() -> None:
    z = np.full((30, 30), 14.0)
    z[0:15, 5:15] = 10.0  # up to the edge of the data
    z[15:18, 9:11] = 11.5
    z[18:30, 5:15] = 5.0
    found = risen(z, 10.0, (0, 15, 5, 15), step=1.0)
    assert (found.opens, found.spill) == (10.0, 11.5)
    assert found.curve.frame["level"].iloc[-1] == 11.5
    assert found.curve.frame["open"].tolist() == [True, True, True]
    assert any("From 10.000 m on the water reaches" in text for text in found.not_looked_at())
    assert "What is seen of its rim is lowest at 11.500 m" in found.in_words()


@pytest.mark.parametrize(("behind", "spill"), [(8.0, True), (10.5, False)])
def test_a_hollow_at_the_edge_higher_than_the_lake_is_an_edge_and_no_spill(
    behind: float, spill: bool
) -> None:
    """What lies beyond may hold it; ground below the lake holds nothing of it."""
    z = np.full((30, 30), 14.0)
    z[5:15, 5:15] = 10.0
    z[15:18, 9:11] = 11.5
    z[18:30, 9:11] = behind
    found = risen(z, 10.0, (5, 15, 5, 15))
    assert (found.spill, found.opens) == ((11.5, None) if spill else (None, 11.5))


def test_roughness_at_the_edge_of_the_data_is_no_rim() -> None:
    """Waves of 10 cm between a lake and the edge, as where its polygon ends half a cell before."""
    z = np.full((30, 30), 14.0)
    z[0:15, 5:15] = 10.0
    z[1, 5:15] = 10.1
    z[0, 5:15] = 9.95
    found = risen(z, 10.0, (2, 15, 5, 15))
    assert (found.spill, found.opens) == (None, 10.1)


@pytest.mark.parametrize(("deep", "spill"), [(9.0, None), (5.0, 11.0)])
def test_a_hollow_is_of_the_lake_unless_it_takes_more_than_the_lake_has_stored(
    deep: float, spill: float | None
) -> None:
    """A lake of 100 m2 that has risen by 1 m, beside a hollow of 50 m2, 2 m or 6 m deep."""
    z = np.full((30, 30), 14.0)
    z[5:15, 5:15] = 10.0
    z[15, 9:11] = 11.0
    z[16:21, 5:15] = deep
    found = risen(z, 10.0, (5, 15, 5, 15), highest=13.0)
    assert found.spill == spill
    volume = found.curve.frame.set_index("level")["volume_m3"]
    assert (volume[12.0] > 300) == (spill is None)


def test_the_level_of_the_lake_is_named_where_the_highest_is_below_it() -> None:
    terrain, lake = dammed()
    with pytest.raises(DataError, match="highest: 9 is below the level of the lake in the survey"):
        ShorelineStorageCurve(terrain=terrain, lake=lake, highest=9.0).run()


def test_limits_are_the_curve_of_water_lower_and_higher() -> None:
    terrain, lake = dammed()
    how = {"terrain": terrain, "lake": lake, "lowest": 10.0, "step": 0.1, "highest": 11.0}
    frame = ShorelineStorageCurve(**how, height_error=0.1 / NINETY_FIVE).run().curve.frame  # type: ignore[arg-type]
    np.testing.assert_allclose(frame["volume_low_m3"][1:], frame["volume_m3"][:-1], atol=1e-4)
    np.testing.assert_allclose(frame["volume_high_m3"][1:-1], frame["volume_m3"][2:], atol=1e-4)
    assert (frame["area_low_m2"] >= frame["area_m2"].iloc[0]).all()


def test_the_level_is_no_surer_than_the_heights_of_the_survey() -> None:
    """Of a lake in 0.05 m of common error a level was told to be known to a millimetre."""
    terrain, lake = dammed()
    lake = Vector(lake.frame.assign(level_interval=0.03))
    how: dict[str, Any] = {"terrain": terrain, "lake": lake}
    found = ShorelineStorageCurve(**how, height_error=0.04 / NINETY_FIVE).run()
    assert found.level_uncertainty == pytest.approx(0.05)
    assert "the level of the survey is known to ± 0.050 m (95 %)" in found.in_words()
    assert ShorelineStorageCurve(**how).run().level_uncertainty is None


def test_limits_of_areas_hold_where_the_shore_of_the_lake_may_lie() -> None:
    terrain, lake = dammed()
    how: dict[str, Any] = {"terrain": terrain, "step": 0.1, "highest": 11.0, "height_error": 1e-6}
    lake = Vector(lake.frame.assign(area_error=3.0))
    frame = ShorelineStorageCurve(lake=lake, **how).run().curve.frame
    reach = 3.0 * NINETY_FIVE
    np.testing.assert_allclose(frame["area_low_m2"], frame["area_m2"] - reach, atol=1e-3)
    np.testing.assert_allclose(frame["area_high_m2"], frame["area_m2"] + reach, atol=1e-3)


def pond(radius: float, slope: float, cell: float) -> tuple[Raster, Vector]:
    """A round lake at 10 m in ground that rises evenly from its shore, laid level."""
    size = math.ceil(120 / cell)
    lattice = Lattice(500_000.0, 4_400_000.0, cell, size, size)
    x, y = np.meshgrid(*lattice.centres())
    middle = np.array([500_060.3, 4_399_940.4])
    apart = np.hypot(x - middle[0], y - middle[1])
    z = 10 + slope * np.maximum(apart - radius, -0.2)
    terrain = Raster.from_lattice(z, lattice, crs=CRS(32635))
    shape = shapely.Point(middle).buffer(radius, quad_segs=64)
    frame = geopandas.GeoDataFrame({"level": [10.0]}, geometry=[shape], crs=CRS(32635))
    lake = Vector(frame)
    return SurfaceFlattenWater(terrain=terrain, water=lake).run().flattened, lake


@pytest.mark.parametrize("cell", [0.5, 1.0, 3.0])
def test_at_its_level_a_lake_has_the_area_of_its_polygon(cell: float) -> None:
    terrain, lake = pond(30.0, 0.2, cell)
    made = ShorelineStorageCurve(terrain=terrain, lake=lake, highest=14.0, step=1.0).run()
    frame = made.curve.frame
    assert frame["area_m2"].iloc[0] == pytest.approx(lake.frame.area.iloc[0], rel=1e-9)
    assert frame["volume_m3"].iloc[0] == pytest.approx(0.0, abs=1e-6)
    wide = 30 + (frame["level_m"].to_numpy() - 10) / 0.2
    volume = math.pi * 0.2 / 3 * (wide**3 - 30**3)
    np.testing.assert_allclose(frame["area_m2"], math.pi * wide**2, rtol=2e-3)
    np.testing.assert_allclose(frame["volume_m3"][1:], volume[1:], rtol=0.02 * cell)


def test_an_outline_is_a_wall_to_a_lake_too() -> None:
    terrain, lake = pond(30.0, 0.2, 1.0)
    x, y = lake.frame.geometry.iloc[0].centroid.coords[0]
    half = shapely.box(x - 100, y - 100, x, y + 100)
    wall = Vector(geopandas.GeoDataFrame(geometry=[half], crs=CRS(32635)))
    how = {"terrain": terrain, "lake": lake, "highest": 14.0}
    whole = ShorelineStorageCurve(**how).run().curve.frame  # type: ignore[arg-type]
    west = lake.frame.intersection(half)
    west_lake = Vector(lake.frame.set_geometry(west))
    for one in (lake, west_lake):
        how["lake"] = one
        part = ShorelineStorageCurve(**how, outline=wall).run().curve.frame  # type: ignore[arg-type]
        np.testing.assert_allclose(part["area_m2"], whole["area_m2"] / 2, rtol=2e-3)
        np.testing.assert_allclose(part["volume_m3"], whole["volume_m3"] / 2, rtol=2e-3, atol=1e-6)


def test_a_lake_needs_a_terrain() -> None:
    _, lake = dammed()
    points = PointCloud(np.zeros((3, 3)), crs=CRS(32635))
    with pytest.raises(DataError, match="lake: is for a terrain"):
        ShorelineStorageCurve(points=points, lake=lake).run()


def test_a_lake_that_is_not_there_is_an_error() -> None:
    terrain, lake = dammed()
    none = Vector(lake.frame.iloc[:0])
    with pytest.raises(DataError, match="lake: holds no water"):
        ShorelineStorageCurve(terrain=terrain, lake=none).run()


def test_the_volume_at_the_level_of_a_flat_ground_is_nothing() -> None:
    level = np.float32(-0.2597)
    heights = np.full((60, 60), level)
    heights[20:40, 20:30] += np.random.default_rng(0).uniform(0, 4, (20, 10)).astype(np.float32)
    heights[[0, -1]] = heights[:, [0, -1]] = 5.0
    found = curve(terrain=raster(heights), step=1.0, lowest=float(level))
    assert found["volume_m3"].iloc[0] == 0.0
    assert found["area_m2"].iloc[0] > 2900
    assert (found["volume_m3"].diff().iloc[1:] > 0).all()


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_the_rim_is_known_as_well_as_one_cell_of_the_ground(noise: float) -> None:
    """A capacity of 3,876 m3 was told for a rim "by the common error alone"; another ground spilled
    0.17 m lower, at 2,903 m3.
    """
    terrain, lake = dammed()
    rough = np.random.default_rng(3).normal(0.0, noise, terrain.band().shape)
    y, x = np.mgrid[:30, :30]
    bowl = np.hypot(x - 9.5, y - 9.5) / 4  # rises 25 cm per metre
    z = 10.0 + bowl + rough
    z[5:15, 5:15] = 10.0
    z[20:] = 5.0
    ground = Raster.from_lattice(z, Lattice.of(terrain), crs=CRS(32635))
    found = ShorelineStorageCurve(terrain=ground, lake=lake, height_error=0.05).run()
    assert found.rim_interval == pytest.approx(1.96 * math.hypot(0.05, noise), rel=0.25)
    assert 0 < found.rim_volume < found.volume
    assert f"That is known to ± {found.rim_interval:.2f} m (95 %)" in found.in_words()
