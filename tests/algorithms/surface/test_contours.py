"""surface.contours: known lines, gaps, orientation, levels in the unit of the data."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import CRS
from scenes.layers import NORTH, UTM, WEST, raster

from algorithms.surface.contours import SurfaceContours
from toolbox.context import Context
from toolbox.data import Lattice, Raster, Vector
from toolbox.errors import Cancelled, DataError, ParameterError

FEET = CRS(2263)


def cone(size: int = 41, top: float = 20.0) -> Any:
    row, col = np.mgrid[0:size, 0:size] - size // 2
    return top - np.hypot(row, col)


def lines(surface: Raster, **settings: Any) -> list[tuple[float, Any]]:
    """Elevation, and coordinates of shape (n, 3) from the north-western corner."""
    frame = SurfaceContours(surface=surface, **settings).run().contours.frame
    found = [shapely.get_coordinates(g, include_z=True) for g in frame.geometry]
    return list(zip(frame["elevation"], [xyz - [WEST, NORTH, 0] for xyz in found], strict=True))


def rotation(xyz: Any) -> float:
    """Twice the area inside, below zero for a ring that runs clockwise."""
    x, y = (xyz - xyz[0])[:, :2].T
    return float(x[:-1] @ y[1:] - x[1:] @ y[:-1])


def test_a_slope_has_straight_lines_between_centres() -> None:
    """z = 0, 2, 4 at the centres 0.5, 1.5, 2.5 of columns: level 1 at x = 1, and 3 at x = 2."""
    found = lines(raster([[0, 2, 4]] * 3), base=1.0, interval=2.0)
    assert [level for level, _ in found] == [1, 3]
    for (level, xyz), x in zip(found, (1.0, 2.0), strict=True):
        np.testing.assert_allclose(xyz[:, 0], x, atol=1e-9)
        np.testing.assert_array_equal(xyz[:, 1], [-2.5, -1.5, -0.5])  # north: higher is east
        np.testing.assert_array_equal(xyz[:, 2], level)


def test_rings_are_closed_on_the_circle_with_the_top_on_the_right() -> None:
    found = lines(raster(cone(), 0.5), interval=3.0, base=-1.0)
    rings = [(level, xyz) for level, xyz in found if (xyz[0] == xyz[-1]).all()]
    assert [level for level, _ in rings] == [2, 5, 8, 11, 14, 17]
    for level, xyz in rings:
        away = np.hypot(xyz[:, 0] - 10.25, xyz[:, 1] + 10.25)
        np.testing.assert_allclose(away, 0.5 * (20 - level), atol=0.5 / 8 / (20 - level))
        assert rotation(xyz) < 0
    hollow = lines(raster(-cone()), interval=3.0, base=1.0)
    assert all(rotation(xyz) > 0 for _, xyz in hollow if (xyz[0] == xyz[-1]).all())


def test_lines_rise_in_order_and_repeat_no_vertex() -> None:
    found = lines(raster(np.round(cone())), interval=1.0)
    assert [level for level, _ in found] == sorted(level for level, _ in found)
    for _, xyz in found:
        assert (np.diff(xyz[:, :2], axis=0) != 0).any(axis=1).all()
    again = lines(raster(np.round(cone())), interval=1.0)
    np.testing.assert_equal(found, again)


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_lines_part_the_higher_from_the_lower_cells(seed: int) -> None:
    """A line passes between two neighbours if, and only if, they are on two sides of its level."""
    values = np.random.default_rng(seed).normal(0, 1, (7, 6))
    values[2, 3] = np.nan
    found = lines(raster(values), interval=10.0, base=0.1)
    xy = np.vstack([np.empty((0, 2)), *(xyz[:, :2] for _, xyz in found)])
    col, row = xy[:, 0] - 0.5, -xy[:, 1] - 0.5
    for one, other, along, across in (
        (values[:, :-1], values[:, 1:], row, col),
        (values[:-1].T, values[1:].T, col, row),
    ):
        # cells of a pair have a known pair beside them, or no square holds both
        square = np.isfinite(one) & np.isfinite(other)
        beside = np.zeros_like(square)
        beside[1:] |= square[:-1]
        beside[:-1] |= square[1:]
        wanted = np.argwhere(square & beside & ((one > 0.1) != (other > 0.1)))
        on = np.abs(along - np.round(along)) < 1e-9
        crossed = np.column_stack([np.round(along[on]), np.floor(across[on] + 1e-9)])
        assert {*map(tuple, crossed.astype(int).tolist())} == {*map(tuple, wanted.tolist())}


def test_a_gap_cuts_the_lines() -> None:
    """None has a vertex or a piece in the squares around a cell without value."""
    values = cone()
    values[20, 25] = np.nan
    whole, cut = lines(raster(cone()), interval=5.0), lines(raster(values), interval=5.0)
    assert len(whole) == len(cut)
    hole = shapely.box(24.5, -21.5, 26.5, -19.5)
    meet = [shapely.LineString(xyz).intersection(hole).length for _, xyz in cut]
    assert max(meet) < 1e-9
    assert max(shapely.LineString(xyz).intersection(hole).length for _, xyz in whole) > 1
    at_15 = [xyz for level, xyz in cut if level == 15]
    assert len(at_15) == 1
    assert (at_15[0][0] != at_15[0][-1]).any()  # was a ring


def test_plateaus_and_touches() -> None:
    """A cell at the level counts as below it: no dot around a hollow or top that only touches."""
    assert lines(raster([[1, 1, 1], [1, 0, 1], [1, 1, 1]]), interval=1.0) == []
    pit = np.full((5, 5), 2.0)
    pit[2, 2] = 1.0
    assert lines(raster(pit), interval=1.0) == []  # level 1 touches the pit, level 2 the rest
    pit[2, 2:4] = 1.0
    assert lines(raster(pit), interval=1.0) == []  # there and back again is no ring
    lake = np.full((6, 6), 3.0)
    lake[2:4, 2:4] = 1.0
    ((level, xyz),) = lines(raster(lake), interval=1.0, base=0.0)[:1]
    assert level == 1
    assert abs(rotation(xyz)) == pytest.approx(2)  # through the centres of its four cells


def test_index_contours_count_from_the_base() -> None:
    surface = raster([np.arange(13.0)] * 2)
    out = SurfaceContours(surface=surface, base=2.5, interval=1.0, index_every=4).run()
    frame = out.contours.frame
    np.testing.assert_array_equal(frame["elevation"], np.arange(0.5, 12))
    assert frame["elevation"][frame["is_index"]].tolist() == [2.5, 6.5, 10.5]
    assert frame["is_index"].dtype == bool
    assert out.levels == 12


def test_levels_are_round_numbers() -> None:
    frame = SurfaceContours(surface=raster([[0, 1.0]] * 2), interval=0.1).run().contours.frame
    assert frame["elevation"].tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9]
    shore = raster([[2.1, 2.2]] * 2)  # 2.1 / 0.3 is a little more than 7
    assert [level for level, _ in lines(shore, interval=0.3)] == [2.1]


ROUGH = [
    [7, 3, 8, 1, 9, 2],
    [4, 9, 2, 6, 5, 8],
    [1, 5, 7, 3, 8, 4],
    [6, 2, 9, 4, 1, 7],
    [3, 8, 5, 7, 2, 6],
]
# Vertices at 4.5 by gdal_contour 3.6.2 (-i 3 -off 1.5) for cells of 2 m, north at 10, sorted, but
# for those in the half cell at the edge, to which it extends its lines. It moves some by 1e-6.
GDAL = """
1 1.999999, 1 3.6, 1 7.333333, 1.2 7, 1.6 1, 1.75 3, 2.25 9, 2.75 5, 3 2.166667, 3 4.666667, 3
8.5, 3.6 9, 3.714286 3, 4.285714 7, 5 6, 5 7.833333, 6 9, 6.25 5, 6.25 7, 6.8 3, 7 2.666667, 7
5.999999, 7 7.6, 7.6 5, 7.875 9, 8 1, 9 4, 10.166667 3, 10.25 1, 10.285714 9, 10.75 5, 11
4.666667, 11 5.25, 11 8.166667
"""


def test_gdal_contour_gives_the_same_vertices() -> None:
    surface = Raster(np.array(ROUGH, float), Lattice(0, 10, 2.0, 5, 6).transform, crs=UTM)
    frame = SurfaceContours(surface=surface, interval=3.0, base=1.5).run().contours.frame
    xy = shapely.get_coordinates(frame.geometry[frame["elevation"] == 4.5])
    theirs = np.array([pair.split() for pair in GDAL.split(",")], float)
    np.testing.assert_allclose(np.unique(xy.round(5), axis=0), theirs, atol=1e-5)
    assert len(frame) == 17  # as many lines as gdal_contour


def test_interval_is_metres_in_feet_too() -> None:
    foot = 1200 / 3937
    slope = np.array([np.arange(0, 60.0)] * 2)
    feet = SurfaceContours(surface=raster(slope / foot, crs=FEET), interval=7.0, base=1.0).run()
    metres = SurfaceContours(surface=raster(slope), interval=7.0, base=1.0).run()
    here, there = feet.contours.frame, metres.contours.frame
    np.testing.assert_allclose(here["elevation"] * foot, there["elevation"], atol=1e-8)
    z = shapely.get_coordinates(here.geometry, include_z=True)[:, 2]
    assert sorted(set(z)) == here["elevation"].tolist()
    two_feet = SurfaceContours(surface=raster(slope, crs=FEET), interval=2 * foot).run()
    np.testing.assert_array_equal(two_feet.contours.frame["elevation"], np.arange(0, 59, 2))


def ripple() -> Raster:
    """Flat land between -0.1 and 0.2 m, with 18 straight lines at 0 that are 80 m long."""
    return raster(np.tile(0.05 + 0.15 * np.sin(np.arange(60.0)), (81, 1)))


def test_a_level_that_smoothing_would_empty_keeps_its_lines(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        out = SurfaceContours(surface=ripple(), smooth_tolerance=0.25, min_length=30.0).run()
    rough = SurfaceContours(surface=ripple(), min_length=30.0).run()
    assert len(out.contours) == len(rough.contours) == 18
    assert out.contours.frame.length.min() == pytest.approx(80)
    assert "18 lines are not smoothed: smoothing by up to 0.25 m" in caplog.text
    with caplog.at_level(logging.WARNING, "toolbox"):
        narrow = SurfaceContours(surface=ripple(), smooth_tolerance=0.25, interval=0.25).run()
    assert len(narrow.contours) == 0, "lines of two levels might cross"
    assert "there are no lines: smoothing by up to 0.25 m leaves none" in caplog.text


def test_lines_that_are_all_too_short_are_told(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        out = SurfaceContours(surface=ripple(), min_length=90.0).run()
    assert len(out.contours) == 0
    assert "there are no lines: all 18 are shorter than 90 m, the longest is 80 m" in caplog.text
    flat = raster([[5.5] * 3] * 3)
    with caplog.at_level(logging.WARNING, "toolbox"):
        SurfaceContours(surface=flat).run()
    assert "no height between cells is a multiple of the interval" in caplog.text


@pytest.mark.parametrize("values", [[[np.nan] * 3] * 3, [[5.0] * 3] * 3, [[1, 9.0]]])
def test_nothing_to_draw(values: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """No value, no slope, a single row: an empty layer that keeps its type."""
    with caplog.at_level(logging.WARNING, "toolbox"):
        out = SurfaceContours(surface=raster(values)).run()
    assert "there are no lines" in caplog.text
    assert (len(out.contours), out.levels) == (0, 0)
    out.contours.save(tmp_path / "none.gpkg")
    again = Vector.open(tmp_path / "none.gpkg")
    assert again.geometry_type == "LineString Z"
    assert list(again.frame.columns) == ["elevation", "is_index", "geometry"]


def test_far_from_the_origin_lines_keep_their_places() -> None:
    """A vertex is off by no more than the last bits of its coordinates."""
    near = Raster(cone(), Lattice(0, 41, 1.0, 41, 41).transform, crs=UTM)
    far = raster(cone())
    ring, moved = (
        shapely.get_coordinates(
            SurfaceContours(surface=s, interval=5.0).run().contours.frame.geometry
        )
        for s in (near, far)
    )
    np.testing.assert_allclose(moved - [WEST, NORTH - 41], ring, atol=2e-9)


def test_too_many_levels_and_cancelling() -> None:
    with pytest.raises(DataError, match="interval: makes 131073 levels, more than 10000"):
        SurfaceContours(surface=raster([[0, 1.0]] * 2), interval=2.0**-17).run()
    calls: list[int] = []

    def stop() -> bool:
        calls.append(1)
        return len(calls) > 5

    with pytest.raises(Cancelled):
        SurfaceContours(surface=raster(cone())).run(Context(stop=stop))
    assert len(calls) == 6


def test_bad_input_is_refused_by_name() -> None:
    with pytest.raises(DataError, match=r"surface: a.tif is in degrees"):
        SurfaceContours(surface=raster(cone(), crs=CRS(4326), name="a.tif"))
    with pytest.raises(DataError, match=r"surface: a.tif holds values in metre, not in US survey"):
        SurfaceContours(surface=raster(cone(), crs=FEET, units=("metre",), name="a.tif"))
    with pytest.raises(ParameterError, match="interval: must be > 0"):
        SurfaceContours(surface=raster(cone()), interval=0.0)
    assert math.isinf(SurfaceContours(surface=raster(cone())).halo())


def rough(seed: int = 1, size: int = 60) -> Any:
    """A plane that rises 6 m to the east, with noise of 0.1 m."""
    noise = np.random.default_rng(seed).normal(0, 0.1, (size, size))
    return np.linspace(0, 6, size)[None, :] + noise


def test_smoothing_moves_no_height_by_more_than_the_tolerance() -> None:
    found = SurfaceContours(surface=raster(rough()), smooth_tolerance=0.25).run()
    plain = SurfaceContours(surface=raster(rough())).run()
    assert 0.1 < found.largest_move <= 0.25 + 1e-9
    assert plain.largest_move == 0.0
    moved = f"no height was moved by more than {found.largest_move:.3f} m."
    assert moved in found.in_words(), "a set said that lines are smooth within a tolerance alone"
    assert "smooth" not in plain.in_words()
    smooth, crooked = (float(f.contours.frame.length.sum()) for f in (found, plain))
    assert smooth < 0.85 * crooked
    assert len(found.contours) < 0.5 * len(plain.contours)


def test_lines_of_a_smoothed_surface_do_not_cross() -> None:
    frame = (
        SurfaceContours(surface=raster(rough(2)), interval=0.25, smooth_tolerance=0.1)
        .run()
        .contours.frame
    )
    tree = shapely.STRtree(frame.geometry)
    one, other = tree.query(frame.geometry, predicate="crosses")
    assert not (one != other).any()


@pytest.mark.parametrize("tolerance", [0.1, 0.5])
def test_smoothing_draws_no_line_across_water_at_a_whole_level(tolerance: float) -> None:
    """A lake at 5 m in rough ground that rises from it by 0.2 m per metre."""
    row, col = np.mgrid[0:60, 0:60]
    away = np.hypot(row - 30, col - 30) - 15
    ground = 5.02 + 0.2 * away + np.random.default_rng(1).normal(0, 0.05, away.shape)
    heights = np.where(away < 0, 5.0, np.maximum(ground, 5.0))
    found = SurfaceContours(surface=raster(heights), smooth_tolerance=tolerance).run()
    lines = found.contours.frame.geometry[found.contours.frame["elevation"] == 5.0]
    inside = shapely.Point(WEST + 30.5, NORTH - 30.5).buffer(13.0)
    assert len(lines)
    assert not lines.intersects(inside).any()


def test_gaps_stay_gaps_when_smoothed() -> None:
    heights = rough()
    heights[20:30, 20:30] = np.nan
    found = SurfaceContours(surface=raster(heights), smooth_tolerance=0.25).run().contours.frame
    hole = shapely.box(WEST + 20.5, NORTH - 29.5, WEST + 29.5, NORTH - 20.5)
    assert not found.intersects(hole).any()


def test_short_lines_are_left_out_and_counted() -> None:
    every = SurfaceContours(surface=raster(rough())).run()
    found = SurfaceContours(surface=raster(rough()), min_length=20.0).run()
    assert found.contours.frame.length.min() >= 20.0
    assert found.left_out == len(every.contours) - len(found.contours) > 0
    assert every.left_out == 0


def test_labels_stand_on_index_contours_and_can_be_read() -> None:
    surface = raster(np.tile(np.linspace(0, 12, 100), (100, 1)))
    found = SurfaceContours(surface=surface, label_spacing=50.0).run()
    labels = found.labels.frame
    assert sorted(labels["text"]) == ["0", "0", "10", "10", "5", "5"]
    lines_there = found.contours.frame.geometry
    assert all(lines_there.distance(place).min() < 1e-6 for place in labels.geometry)
    assert labels["angle"].between(-90, 90).all()
    np.testing.assert_allclose(labels["angle"].abs(), 90)


def test_each_height_of_an_index_contour_has_a_label() -> None:
    """Three index contours of a town were shorter than half the spacing, and none had a label."""
    z = np.tile(np.arange(21.0), (21, 1))
    z[:, :3] = z[:, [3]]  # no line of 0
    found = SurfaceContours(surface=raster(z)).run()
    assert sorted(found.labels.frame["text"]) == ["10", "15", "5"]
    np.testing.assert_allclose(found.labels.frame["angle"].abs(), 90)


def test_a_tolerance_that_is_coarse_for_the_interval_is_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    z = np.tile(np.arange(21.0), (21, 1))
    for interval, told in ((1.0, False), (0.5, True)):
        caplog.clear()
        SurfaceContours(surface=raster(z), interval=interval, smooth_tolerance=0.25).run()
        assert ("more than a quarter of the interval" in caplog.text) == told


@pytest.mark.parametrize(
    ("said", "tolerance"),
    [
        ({}, 0.0),
        ({"smooth_lines": True, "interval": 1.0}, 0.25),
        ({"smooth_lines": True, "interval": 0.5}, 0.125),
        ({"smooth_lines": True, "interval": 5.0}, 0.25),
        ({"smooth_tolerance": 0.4}, 0.4),
        ({"smooth_lines": True, "smooth_tolerance": 0.0}, 0.0),
    ],
)
def test_smoothing_stays_within_a_quarter_of_the_interval(
    said: dict[str, Any], tolerance: float
) -> None:
    assert SurfaceContours(surface=raster(np.zeros((3, 3))), **said).tolerance == tolerance
