"""planes.openings: openings of known size, shadows that are none, and what is seen behind."""

from __future__ import annotations

import itertools
import logging
import math
import types
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.planes._fronts import fronts_of, outside
from algorithms.planes._gaps import TOO_WIDE, Gap, _squares, too_large
from algorithms.planes._openings import (
    EITHER,
    SIDES,
    Opening,
    _edge,
    _free,
    _with_intervals,
    kind_of,
)
from algorithms.planes._relief import (
    _held,
    _holes,
    _level,
    _parted,
    _Plane,
    _plane,
    _size,
    _walls,
    around,
)
from algorithms.planes._shades import by_chance
from algorithms.planes.drawing import PlanesDrawing
from algorithms.planes.extract import PlanesExtract
from algorithms.planes.openings import PlanesOpenings, fitted
from algorithms.samples.scene import scene
from algorithms.shared.plane_fit import Plane
from toolbox.data import PointCloud
from toolbox.data.crs import LOCAL, parse_crs
from toolbox.errors import DataError, ParameterError

UTM = CRS(32635)
FAR = np.array([543_210.5, 4_567_890.25, 812.0])
WALL, WINDOW, DOOR, CURTAIN, GROUND, SHADOW = 1, 2, 3, 4, 5, 6
OPEN = {WINDOW: (2.0, 1.0, 3.2, 2.4), DOOR: (5.0, 0.1, 6.0, 2.2)}  # left, bottom, right, top
DARK = (7.5, 1.0, 8.5, 2.0)  # a shadow

Floats = NDArray[np.float64]


def flat(box: tuple[float, ...], density: float, depth: float, rng: np.random.Generator) -> Floats:
    """Points on an upright rectangle, some way behind the wall."""
    left, bottom, right, top = box
    n = round(density * (right - left) * (top - bottom))
    places = rng.random((n, 2)) * [right - left, top - bottom] + [left, bottom]
    away = depth + rng.normal(0, 0.003, n)
    return np.column_stack([places[:, 0], away, places[:, 1]])


def test_panes_above_each_other_are_no_larger_than_one() -> None:
    uv = np.random.default_rng(1).random((3000, 2)) * [3.0, 8.0]
    stacked = uv[(uv[:, 1] < 3.4) | (uv[:, 1] > 4.6)]
    assert _size(uv, *_held(uv)) == pytest.approx([2.9, 7.7], abs=0.1)
    assert _size(stacked, *_held(stacked)) == pytest.approx([2.9, 3.3], abs=0.2)


def test_panes_are_not_wall_by_others_between_them_and_the_wall() -> None:
    """Each is as near to the one before as points of one plane may be; the wall is not."""
    sizes = [(20.0, 8.0), (1.0, 1.5), (1.0, 1.5), (1.0, 1.5)]
    parts = [
        _Plane(
            *(k, 0.05 * k, 0.02, np.array(size), math.nan, math.nan, 0.0),
            np.array([[0, 0, 0.05 * k], [*size, 0.05 * k]]),
        )
        for k, size in enumerate(sizes)
    ]
    assert _walls(parts, (4.0, 6.0), recess=0.25, least=0.02).planes == [0, 1]


@pytest.mark.parametrize(
    ("before", "beside", "depth", "wide", "level"),
    [
        (0.0, 1.5, 0.1, 0.4, False),
        (0.0, 0.5, 0.1, 0.4, True),
        (0.0, 1.5, 0.5, 0.4, True),
        (0.0, 1.5, 0.5, 0.6, False),
        (-9.0, 1.5, 0.1, 0.4, True),
    ],
    ids=[
        "a pane",
        "with wall beside in its depth",
        "between deep pilasters",
        "a curtain",
        "nothing before it",
    ],
)
def test_what_stands_back_from_the_wall_beside_it_is_none(
    before: float, beside: float, depth: float, wide: float, level: bool
) -> None:
    """Though other wall lies in its depth, far along the front."""
    up = np.linspace(0, 2, 50)

    def strip(left: float, depth: float, wide: float = 0.5) -> _Plane:
        some = np.column_stack([left + up / 2 * wide, up, 0 * up + depth])
        return _Plane(0, depth, 0.003, np.array([wide, 2.0]), math.nan, math.nan, 0.0, some)

    part = strip(5.0, depth)
    walls = [strip(4.4 + before, 0.0, wide), strip(5.5 + beside, depth)]
    assert _level(part, walls, (0.02, 0.25), 1.0) is level


@cache
def front(turn: float = 0.0, metre: float = 1.0) -> PointCloud:
    """A wall of 10 by 4 m with a window, a door and a shadow, a curtain, a box and the ground."""
    rng = np.random.default_rng(1)
    wall = flat((0, 0, 10, 4), 1500, 0, rng)
    for box in (*OPEN.values(), DARK):
        inside = (wall[:, 0] > box[0]) & (wall[:, 0] < box[2])
        wall = wall[~(inside & (wall[:, 2] > box[1]) & (wall[:, 2] < box[3]))]
    parts = {
        WALL: wall,
        WINDOW: flat(OPEN[WINDOW], 80, 0.15, rng),
        DOOR: flat(OPEN[DOOR], 1500, 0.2, rng),
        CURTAIN: flat((1.9, 1.0, 3.3, 2.4), 800, 0.7, rng),
        GROUND: np.column_stack([*(rng.random((2, 40_000)) * [[10], [-8]]), np.zeros(40_000)]),
        SHADOW: flat(DARK, 1500, -1.0, rng),
    }
    xyz = np.vstack(list(parts.values()))
    kind = np.repeat(list(parts), [len(part) for part in parts.values()])
    c, s = math.cos(turn), math.sin(turn)
    turned = np.column_stack([xyz[:, :2] @ np.array([[c, s], [-s, c]]), xyz[:, 2]])
    columns = {"plane_id": kind.astype(np.int32), "kind": kind.astype(np.uint8)}
    crs = UTM if metre == 1.0 else CRS(2992)
    return PointCloud((turned + FAR) * metre, columns, crs=crs)


def with_more(cloud: PointCloud, xyz: Floats, plane: int) -> PointCloud:
    """The cloud with another plane, its points in the coordinates of the wall."""
    numbers = np.append(cloud["plane_id"], np.full(len(xyz), plane, np.int32))
    columns = {"plane_id": numbers.astype(np.int32), "kind": numbers.astype(np.uint8)}
    return PointCloud(np.vstack([cloud.xyz, xyz + FAR]), columns, crs=cloud.crs)


def found(cloud: PointCloud, **settings: Any) -> PlanesOpenings.Outputs:
    return PlanesOpenings(points=cloud, **settings).run()


def test_an_opening_ends_at_a_frame_that_stands_before_the_wall() -> None:
    """Stone or timber of another colour is no plane of the wall: it was a part of the opening."""
    rng = np.random.default_rng(2)
    left, bottom, right, top = OPEN[WINDOW]
    outer = flat((left - 0.2, bottom - 0.2, right + 0.2, top + 0.2), 1500, -0.05, rng)
    inner = (outer[:, 0] > left) & (outer[:, 0] < right)
    ring = outer[~(inner & (outer[:, 2] > bottom) & (outer[:, 2] < top))]
    cloud = front()
    xyz = cloud.xyz - FAR
    hidden = ((xyz > outer.min(axis=0)) & (xyz < outer.max(axis=0)))[:, [0, 2]].all(axis=1)
    bare = cloud.select(~(hidden & (cloud["plane_id"] == WALL)))
    frame = found(with_more(bare, ring, 7)).openings.frame.set_index("kind")
    row = frame.loc["window"]
    assert (row.width, row.height) == pytest.approx((right - left, top - bottom), abs=0.05)


def test_a_door_in_the_depth_of_the_next_house_is_one() -> None:
    """It stands back from the wall around it, though the wall of the next house lies there, too."""
    rng = np.random.default_rng(3)
    house = flat((10.0, 0, 18.0, 4.0), 1500, 0.2, rng)
    frame = found(with_more(front(), house, 7)).openings.frame
    assert sorted(frame["kind"]) == ["door", "window"]


@pytest.mark.parametrize("turn", [0.0, 0.5, 3.0])
def test_a_window_and_a_door(turn: float) -> None:
    out = found(front(turn))
    frame = out.openings.frame.set_index("kind")
    assert sorted(frame.index) == ["door", "window"]
    for kind, number in (("window", WINDOW), ("door", DOOR)):
        left, bottom, right, top = OPEN[number]
        row = frame.loc[kind]
        assert (row.width, row.height) == pytest.approx((right - left, top - bottom), abs=0.02)
        assert row.sill == pytest.approx(bottom, abs=0.02)
        assert row.rectangle
        corners = shapely.get_coordinates(row.geometry, include_z=True) - FAR
        along = corners[:, :2] @ [math.cos(turn), math.sin(turn)]
        assert (along.min(), along.max()) == pytest.approx((left, right), abs=0.015)
        assert (corners[:, 2].min(), corners[:, 2].max()) == pytest.approx((bottom, top), abs=0.015)
        away = corners[:, :2] @ [-math.sin(turn), math.cos(turn)]
        assert np.abs(away).max() < 0.001
    assert frame.set_back["window"] == pytest.approx(0.15, abs=0.005)
    assert frame.set_back["door"] == pytest.approx(0.2, abs=0.005)
    assert out.openings.crs == UTM


def test_the_elevation_has_the_openings_as_holes_from_the_left() -> None:
    out = found(front(3.0))  # the front faces north-west there, so left is in the east
    shown = out.elevation.frame.set_index("kind")
    assert shown.geometry["window"].bounds == pytest.approx(OPEN[WINDOW], abs=0.03)
    assert shown.geometry["door"].bounds == pytest.approx(OPEN[DOOR], abs=0.03)
    wall = shown.geometry["facade"]
    assert wall.area == pytest.approx(40 - 1.2 * 1.4 - 2.1, rel=0.01)  # a shadow is wall
    assert not wall.contains(shown.geometry["window"].centroid)
    assert out.elevation.crs == parse_crs("local")


def test_curtains_are_left_out_and_panes_stay() -> None:
    cloud = front()
    out = found(cloud)
    kind, ids = cloud["kind"], out.cleaned["plane_id"]
    assert not ids[kind == CURTAIN].any()
    assert (out.cleaned["behind"][kind == CURTAIN] == 1).all()
    assert not out.cleaned["behind"][kind != CURTAIN].any()
    for number in (WALL, WINDOW, DOOR, GROUND, SHADOW):
        assert (ids[kind == number] == number).all()
    assert (out.behind, out.given_up) == (int((kind == CURTAIN).sum()), 1)
    opening = out.openings.frame.set_index("kind").opening_id
    assert (out.cleaned["opening_id"][kind == WINDOW] == opening["window"]).mean() > 0.99
    assert (out.cleaned["opening_id"][kind == CURTAIN] == opening["window"]).all()
    assert (out.cleaned["opening_id"][kind == DOOR] == opening["door"]).mean() > 0.99
    assert not out.cleaned["opening_id"][kind == GROUND].any()
    assert set(out.planes.frame.plane_id) == {WALL, WINDOW, DOOR, GROUND, SHADOW}


def test_a_few_points_in_line_with_the_wall_are_no_wall() -> None:
    """Three points of the ground beside the wall, and a side wall behind them."""
    cloud, rng = front(), np.random.default_rng(6)
    strays = np.array([[10.2, 0, 0], [10.25, 0, 0], [10.3, 0, 0]]) + FAR
    side = FAR + np.column_stack([np.full(4000, 10.01), rng.random((4000, 2)) * [6, 4]])
    xyz = np.vstack([cloud.xyz, strays, side])
    ids = np.concatenate([cloud["plane_id"], np.full(3, WALL), np.full(4000, 9)])
    out = found(PointCloud(xyz, {"plane_id": ids}, crs=UTM))
    assert (out.cleaned["plane_id"][-4000:] == 9).all()
    assert out.count == 2


def test_a_hidden_edge_is_told() -> None:
    """A box before the window hides its lower part, and some of the wall below it."""
    cloud = front()
    u, _, v = (cloud.xyz - FAR).T
    hidden = (u > 1.95) & (u < 3.25) & (v > 0.6) & (v < 1.4) & (cloud["kind"] != SHADOW)
    frame = found(cloud.select(~hidden)).openings.frame.set_index("kind")
    assert (frame.hidden["window"], frame.hidden["door"]) == ("bottom", "")
    assert frame.edge_seen["door"] > 0.97
    # Not seen are the lower side of 1.3 m, and less than 0.8 m of those beside it, of 6.2 m.
    assert 0.5 < frame.edge_seen["window"] < 0.8
    assert (found(cloud).openings.frame.hidden == "").all()


def test_feet() -> None:
    metres, feet = found(front()), found(front(metre=1 / 0.3048))
    assert list(feet.openings.frame.kind) == list(metres.openings.frame.kind)
    assert list(feet.openings.frame.width * 0.3048) == pytest.approx(
        list(metres.openings.frame.width), abs=1e-4
    )
    np.testing.assert_array_equal(feet.cleaned["plane_id"], metres.cleaned["plane_id"])


def test_limits() -> None:
    assert found(front(), min_width=1.1).count == 1  # the door is a metre wide
    assert found(front(), max_width=1.1).count == 1
    assert found(front(), min_points=2000).count == 1  # behind the window are fewer
    with pytest.raises(ParameterError, match="max_width: is below min_width"):
        found(front(), min_width=1.0, max_width=0.5)


def test_another_outline_than_a_rectangle() -> None:
    """A round window keeps its shape."""
    cloud = front()
    away = np.hypot(*(cloud.xyz - FAR)[:, [0, 2]].T - np.array([[8.0], [3.0]]))
    some = cloud.select(~((cloud["kind"] == WALL) & (away < 0.6)))
    behind = flat((7.6, 2.6, 8.4, 3.4), 300, 0.2, np.random.default_rng(3)) + FAR
    xyz = np.vstack([some.xyz, behind])
    ids = np.append(some["plane_id"], np.full(len(behind), 7))
    out = found(PointCloud(xyz, {"plane_id": ids}, crs=UTM))
    frame = out.openings.frame
    assert out.count == 3
    (row,) = (row for row in frame.itertuples() if not row.rectangle)
    assert row.area == pytest.approx(math.pi * 0.36, rel=0.1)


def test_a_window_under_a_gable_keeps_its_sloping_head() -> None:
    """A rectangle would end where the slopes meet its sides, on glass, and call them not seen."""
    rng = np.random.default_rng(12)
    window = shapely.Polygon([(4.0, 1.0), (6.7, 1.0), (6.7, 2.8), (4.7, 3.5), (4.0, 3.0)])
    u, v = rng.random((2, 40_000)) * [[10], [4]]
    pane = shapely.contains_xy(window, u, v)
    wall = np.column_stack([u, np.where(pane, 0.15, 0.0) + rng.normal(0, 0.003, len(u)), v])
    ground = np.column_stack([*(rng.random((2, 5_000)) * [[10], [-8]]), np.zeros(5_000)])
    ids = np.append(np.where(pane, 0, 1), np.full(len(ground), 2)).astype(np.int32)
    out = found(PointCloud(np.vstack([wall, ground]) + FAR, {"plane_id": ids}, crs=UTM))
    (one,) = out.openings.frame.itertuples()
    assert (one.rectangle, one.unsure, one.hidden) == (False, "", "")
    assert one.area == pytest.approx(window.area, rel=0.05)
    corners = shapely.get_coordinates(one.geometry, include_z=True) - FAR
    ends = np.concatenate([corners[:, [0, 2]].min(axis=0), corners[:, [0, 2]].max(axis=0)])
    known = np.array([getattr(one, f"{side}_interval") for side in SIDES])
    assert (np.abs(ends - window.bounds) <= known).all()
    assert known.max() < 0.2


def test_the_tip_of_a_triangle_is_unsure() -> None:
    """Its outline ends before its tip, beside which too few rows of the wall tell where it is."""
    u, v = np.meshgrid(np.arange(0.025, 6, 0.05), np.arange(0.025, 4, 0.05))
    shape = shapely.Polygon([(1, 1), (3.5, 1), (1, 1.8)])
    kept = ~shapely.contains_xy(shape, u, v)
    one = Opening(shapely.Polygon([(1, 1), (3, 1), (3, 1.16), (1, 1.8)]), 9, 0.1, 0.9, "", "", 0.9)
    uv = np.column_stack([u[kept], v[kept]])
    made = _with_intervals(one, uv, types.SimpleNamespace(apart=0.05))  # type: ignore[arg-type]
    assert "right" in made.unsure.split(", ")
    assert made.hidden == ""
    assert made.intervals[2] >= 0.5
    assert max(made.intervals[:2]) < 0.2


def test_no_openings_and_no_facade(caplog: pytest.LogCaptureFixture) -> None:
    cloud = front()
    out = found(cloud.select(np.isin(cloud["kind"], [WALL, GROUND])))
    assert out.count == len(out.openings) == 0
    assert "has no openings" in caplog.text
    with pytest.raises(DataError, match="no plane of plane_id is upright"):
        found(cloud.select(cloud["kind"] == GROUND))
    with pytest.raises(DataError, match="none is on plane 99"):
        found(cloud, plane=99)
    negative = cloud["plane_id"].astype(np.int32) - 2
    with pytest.raises(DataError, match=r"plane_id is below 0 at \d+ points; planes must be"):
        found(cloud.with_attributes({"plane_id": negative}))


def test_a_front_without_openings_is_drawn() -> None:
    rng = np.random.default_rng(3)
    wall = flat((0, 0, 8, 4), 400, 0.0, rng)
    cloud = PointCloud(wall, {"plane_id": np.ones(len(wall), np.int32)}, crs=CRS(32635))
    elevation = found(cloud).elevation
    assert elevation.frame["kind"].tolist() == ["facade"]
    assert len(PlanesDrawing(elevation=elevation).run().schedule) == 0


def test_parts_without_points_of_the_wall_are_unseen(caplog: pytest.LogCaptureFixture) -> None:
    """The shadow, and, told as it is much of the wall, the air above a lower part of it."""
    frame = found(front()).elevation.frame
    (dark,) = frame.loc[frame["kind"] == "unseen"].geometry
    known = shapely.box(*DARK)
    assert dark.intersection(known).area / dark.union(known).area > 0.85
    assert "unseen" not in caplog.text
    cloud = front()
    away = cloud.xyz - FAR
    low = cloud.select((away[:, 0] < 6) | (away[:, 2] < 1.5) | (cloud["kind"] != WALL))
    frame = found(low).elevation.frame
    slant = frame[frame["kind"] == "unseen"].area.sum()  # the outline is cut straight there
    assert slant == pytest.approx(4 * 2.5 / 2, rel=0.1)
    assert "of front 1" in caplog.text
    assert "the elevation has these parts as unseen" in caplog.text


def test_parts_not_seen_that_may_hide_a_door_are_told(caplog: pytest.LogCaptureFixture) -> None:
    """A door behind a lorry was drawn as not seen among other such parts, and nobody looked."""
    found(front())
    assert "as large as a door" not in caplog.text, "the shadow is high above the foot"
    away = front().xyz - FAR
    hidden = (np.abs(away[:, 0] - 8.5) < 0.7) & (away[:, 2] < 2.2) & (away[:, 2] > 0.05)
    found(front().select(~hidden))
    assert "as large as a door and as low: 1, from 7.5 m on from its left end" in caplog.text
    warned = [one.getMessage() for one in caplog.records if one.levelno >= logging.WARNING]
    assert "merge a scan" not in " ".join(warned), "a client has no scans"


def test_walls_that_scatter_are_told(caplog: pytest.LogCaptureFixture) -> None:
    quiet = front()
    found(quiet)
    assert "scatter" not in caplog.text
    away = np.random.default_rng(3).normal(0, 0.03, len(quiet))
    xyz = quiet.xyz + np.column_stack([0 * away, away, 0 * away])
    columns = {name: quiet[name] for name in ("plane_id", "kind")}
    found(PointCloud(xyz, columns, crs=UTM))
    assert "front 1 scatter about its wall: only what stands back by 0.09 m" in caplog.text
    assert "not by the 0.02 m" in caplog.text


def test_points_too_far_apart_for_openings_are_told(caplog: pytest.LogCaptureFixture) -> None:
    """The same front with points 0.05 m and, after all but one in 16, 0.2 m apart."""
    dense = front()
    found(dense)
    assert "apart" not in caplog.text
    sparse = found(dense.select(np.arange(0, len(dense), 16)))
    (wall,) = sparse.elevation.frame.loc[sparse.elevation.frame["kind"] == "facade", "spacing"]
    assert f"the points of front 1 are {wall:.2f} m apart" in caplog.text
    assert 0.1 < wall < 0.3


def test_a_wall_too_sparse_to_have_an_outline_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """Of a front of 150 m² an outline of 13 m² was left, and its points stood 0.05 m apart."""
    points = PointCloud(scene("facade", size=30.0, density=8.0, seed=0).xyz, crs=UTM)
    out = PlanesOpenings(points=PlanesExtract(points=points).run().segmented).run()
    (wall,) = out.elevation.frame.loc[out.elevation.frame["kind"] == "facade", "spacing"]
    assert 0.3 < wall < 0.7
    assert "the points of front 1 are" in caplog.text
    assert (out.openings.frame["certainty"] < 1).all()


def test_what_an_opening_is_found_by_and_what_was_dropped() -> None:
    out = found(front())
    frame = out.openings.frame.set_index("kind")
    assert frame.found_by["window"] == "behind"  # more points on the curtain than on the pane
    assert frame.found_by["door"] == "recess"
    assert (frame.certainty > 0.9).all()
    assert out.dropped_count == len(out.dropped.frame) > 0
    (dark,) = out.dropped.frame.query("reason == 'something stands before it'").geometry
    corners = shapely.get_coordinates(dark, include_z=True) - FAR
    assert (corners[:, 0].min(), corners[:, 0].max()) == pytest.approx((DARK[0], DARK[2]), abs=0.1)
    assert out.fronts == 1


def test_another_reflectance_is_told() -> None:
    cloud, rng = front(), np.random.default_rng(7)
    bright = np.where(np.isin(cloud["kind"], [DOOR]), 400, 3000) * rng.lognormal(0, 0.1, len(cloud))
    frame = found(cloud.with_attributes({"intensity": bright.astype(np.uint16)})).openings.frame
    assert sorted(frame.found_by) == ["behind", "recess, reflectance"]


def recesses(shade: float, rough: float = 0.003) -> PointCloud:
    """A wall with a dark window, and beside it a recess 12 cm deep of some brightness."""
    rng = np.random.default_rng(3)
    boxes = (2.0, 1.0, 3.2, 2.4), (6.0, 1.0, 7.2, 2.4)
    wall = flat((0, 0, 10, 4), 1500, 0, rng)
    for left, bottom, right, top in boxes:
        inside = (wall[:, [0, 2]] > (left, bottom)) & (wall[:, [0, 2]] < (right, top))
        wall = wall[~inside.all(axis=1)]
    window, niche = (flat(box, 1500, 0.12, rng) for box in boxes)
    niche[:, 1] += rng.normal(0, rough, len(niche))
    parts = wall, window, niche
    ids = np.repeat([1, 2, 3], [len(part) for part in parts])
    bright = np.array([0, 3000, 500, shade])[ids] * rng.lognormal(0, 0.2, len(ids))
    columns = {"plane_id": ids.astype(np.int32), "intensity": bright.astype(np.uint16)}
    return PointCloud(np.vstack(parts) + FAR, columns, crs=UTM)


def test_a_blind_niche_is_no_opening_and_told(caplog: pytest.LogCaptureFixture) -> None:
    out = found(recesses(3000))
    assert out.count == 1
    (reason,) = out.dropped.frame.reason
    assert reason == "wall at its back: a blind niche, or shutters as bright as the wall"
    assert "recesses of front 1 with wall at their back, no openings: 1;" in caplog.text


@pytest.mark.parametrize(("shade", "rough"), [(2500, 0.003), (3000, 0.03)])
def test_a_recess_of_another_brightness_or_not_flat_is_an_opening(
    shade: float, rough: float
) -> None:
    assert found(recesses(shade, rough)).count == 2


@pytest.mark.parametrize("shade", [2500, 3300])
def test_what_may_be_a_niche_of_another_paint_is_half_as_certain(
    caplog: pytest.LogCaptureFixture, shade: float
) -> None:
    certainty = found(recesses(shade)).openings.frame.certainty
    assert certainty[1] == pytest.approx(certainty[0] / 2, abs=0.05)
    assert "openings of front 1 that may be blind niches: 1;" in caplog.text


def hole(reveal: float) -> PointCloud:
    """A wall with a hole in which nothing is seen, and a side of it 12 cm deep."""
    rng = np.random.default_rng(6)
    wall = flat((0, 0, 10, 4), 1500, 0, rng)
    inside = (wall[:, [0, 2]] > (4.0, 1.0)) & (wall[:, [0, 2]] < (5.0, 2.4))
    side = (rng.random((3, 300)) * [[0.06], [0.12], [1.4]]).T
    side += (4.0, 0.0, 1.0)
    street = np.column_stack([*(rng.random((2, 20_000)) * [[10], [-8]]), np.zeros(20_000)])
    xyz = np.vstack([wall[~inside.all(axis=1)], side[: round(300 * reveal)], street])
    ids = np.zeros(len(xyz), np.int32)
    ids[: len(wall) - inside.all(axis=1).sum()] = 1
    return PointCloud(xyz + FAR, {"plane_id": ids}, crs=UTM)


@pytest.mark.parametrize("mixed", [False, True])
def test_intensity_by_chance_is_told_and_not_used(
    caplog: pytest.LogCaptureFixture, mixed: bool
) -> None:
    """By chance the back of a window is as bright as the wall, so that it would be a niche."""
    cloud = recesses(500)
    shade = cloud["intensity"]
    if mixed:
        shade = np.random.default_rng(1).permutation(shade)
    out = found(cloud.with_attributes({"intensity": shade}))
    assert out.count == 2
    assert ("the intensity of the points tells nothing" in caplog.text) == mixed
    assert out.openings.frame.found_by.str.contains("reflectance").any() == (not mixed)


def test_one_draw_of_a_hundred_by_chance_is_taken_for_a_reading() -> None:
    """Three standard errors leave one in 700; one or none would leave many."""
    cloud = recesses(2500)
    shade, xyz = cloud["intensity"][::20].astype(float), cloud.xyz[::20]
    assert not by_chance(shade, xyz)
    draws = [by_chance(np.random.default_rng(k).permutation(shade), xyz) for k in range(100)]
    assert sum(draws) >= 99


def test_a_hole_with_a_reveal_is_an_opening_by_its_outline() -> None:
    frame = found(hole(1.0)).openings.frame
    assert frame.found_by.tolist() == ["recess, outline"]
    assert frame.width[0] == pytest.approx(1.0, abs=0.06)  # where the reveal begins, it is wall
    assert frame.certainty[0] == pytest.approx(0.5, abs=0.05)


def test_a_hole_without_a_reveal_may_be_cut_out_and_is_no_opening() -> None:
    assert found(hole(0.0)).count == 0


def test_a_window_of_which_one_half_is_hidden_by_its_side_is_whole() -> None:
    """As a scanner beside the front sees it; a board above it that was cut out is not of it."""
    rng = np.random.default_rng(8)
    for top, height in ((2.4, 1.4), (3.2, 1.4)):
        wall = flat((0, 0, 10, 4), 1500, 0, rng)
        inside = (wall[:, [0, 2]] > (4.0, 1.0)) & (wall[:, [0, 2]] < (5.0, top))
        pane = flat((4.0 if top > 2.4 else 4.6, 1.0, 5.0, 2.4), 800, 0.12, rng)
        street = np.column_stack([*(rng.random((2, 20_000)) * [[10], [-8]]), np.zeros(20_000)])
        xyz = np.vstack([wall[~inside.all(axis=1)], pane, street])
        ids = np.zeros(len(xyz), np.int32)
        ids[: len(wall) - inside.all(axis=1).sum()] = 1
        frame = found(PointCloud(xyz + FAR, {"plane_id": ids}, crs=UTM)).openings.frame
        assert frame.width.tolist() == pytest.approx([1.0], abs=0.03)
        assert frame.height.tolist() == pytest.approx([height], abs=0.1)


def test_doors_in_one_depth_have_no_holes_and_panels_around_windows_have() -> None:
    held = np.zeros((20, 60), bool)
    held[:, :10] = held[:, 50:] = True
    assert _holes(held) == 0
    held[8:10, 4] = False  # a pane sends few points back
    assert _holes(held) == 0
    held[:] = True
    held[5:15, 20:30] = False
    assert _holes(held) == pytest.approx(100 / 1200)


def test_arches_joined_at_their_foot_are_found_one_by_one() -> None:
    """Below the piers between them a strip of what is behind is seen."""
    rng = np.random.default_rng(5)
    wall = flat((0, 0, 12, 5), 600, 0, rng)
    behind = []
    for box in ((1.0, 0, 3.5, 3), (4.5, 0, 7.0, 3), (8.0, 0, 10.5, 3), (1.0, 0, 10.5, 0.25)):
        inside = (wall[:, [0, 2]] > box[:2]) & (wall[:, [0, 2]] < box[2:])
        wall = wall[~inside.all(axis=1)]
        behind.append(flat(box, 600, 2.0, rng))
    street = np.column_stack([*(rng.random((2, 20_000)) * [[12], [-8]]), np.zeros(20_000)])
    ids = np.zeros(len(wall) + sum(map(len, behind)) + len(street), np.int32)
    ids[: len(wall)] = 1
    xyz = np.vstack([wall, *behind, street]) + FAR
    frame = found(PointCloud(xyz, {"plane_id": ids}, crs=UTM)).openings.frame
    assert frame.width.tolist() == pytest.approx([2.5] * 3, abs=0.15)
    assert set(frame.kind) == {"door"}


def panels(back: float = 0.0) -> PointCloud:
    """Panels between pilasters that stand before them, with nine windows, one of them empty."""
    rng = np.random.default_rng(9)
    wall = flat((0, 0, 11, 9), 600, 0.0, rng)
    parts, ids = [], []
    for column, row in np.ndindex(3, 3):
        left, bottom = 1.1 + 3.6 * column, 0.9 + 2.9 * row
        inside = (wall[:, [0, 2]] > (left, bottom)) & (wall[:, [0, 2]] < (left + 1.4, bottom + 1.4))
        wall = wall[~inside.all(axis=1)]
        if (column, row) != (1, 1):
            parts.append(flat((left, bottom, left + 1.4, bottom + 1.4), 400, 0.15, rng))
            ids.append(20 + 3 * row + column)
    before = np.zeros(len(wall), bool)
    for k in range(4):  # the wall is not seen where a pilaster stands
        left = 3.5 * k
        before |= (wall[:, 0] > left) & (wall[:, 0] < left + 0.5)
        parts.append(flat((left, 0, left + 0.5, 9), 600, -0.5, rng))
        ids.append(10 + k)
    wall = wall[~before]
    panel = np.digitize(wall[:, 0], [3.7, 7.2]) + 3 * np.digitize(wall[:, 2], [2.9, 5.8]) + 1
    for part in (wall, *parts[5:8]):  # the last column stands back
        part[part[:, 0] > 7.2, 1] += back
    street = np.column_stack([*(rng.random((2, 30_000)) * [[11], [-9]]), np.zeros(30_000)])
    xyz = np.vstack([wall, *parts, street])
    numbers = [panel, *(np.full(len(p), k) for p, k in zip(parts, ids, strict=True))]
    plane = np.concatenate([*numbers, np.full(len(street), 99)]).astype(np.int32)
    shade = np.where((plane >= 20) & (plane < 99), 500, 9000) * rng.lognormal(0, 0.1, len(xyz))
    columns = {"plane_id": plane, "intensity": shade.astype(np.uint16)}
    return PointCloud(xyz + FAR, columns, crs=UTM)


def test_the_wall_around_a_window_is_not_the_pilasters_beside_it() -> None:
    level = np.full((5, 5), np.nan)
    level[0], level[4] = 0.0, 0.0  # the wall below and above
    level[:, 0], level[:, 4] = -0.5, -0.5  # pilasters
    assert (around(level)[1:4, 1:4] == 0.0).all()
    level[:, 4] = 3.0  # a wall far behind, seen past the house
    assert (around(level)[1:4, 1:4] == 0.0).all()


@pytest.mark.parametrize("back", [0.0, 0.2])
def test_windows_behind_pilasters(back: float) -> None:
    """Panels are wall, not openings, also one that stands back; an empty gap in a row is one."""
    out = found(panels(back))
    frame = out.openings.frame
    assert out.count == 9
    assert np.allclose(frame.width, 1.4, atol=0.05)
    assert np.allclose(frame.height, 1.4, atol=0.05)
    (empty,) = frame[frame.seen == 0].itertuples()
    assert empty.found_by == "grid"
    assert empty.certainty <= 0.5
    assert frame[frame.seen > 0].set_back.between(0.14, 0.16).all()
    assert not out.cleaned["behind"].any()


def test_all_fronts_are_looked_at() -> None:
    """The same front a second time, round the corner, is numbered on and drawn beside it."""
    one = panels()
    xyz = one.xyz - FAR
    turned = np.column_stack([11.6 - xyz[:, 1], xyz[:, 0] + 0.6, xyz[:, 2]]) + FAR
    ids = one["plane_id"].astype(np.int32)
    columns = {
        "plane_id": np.concatenate([ids, np.where(ids == 99, 99, ids + 100)]).astype(np.int32),
        "intensity": np.tile(one["intensity"], 2),
    }
    both = PointCloud(np.vstack([one.xyz, turned]), columns, crs=UTM)
    out = found(both)
    assert (out.count, out.fronts) == (18, 2)
    assert list(out.openings.frame.opening_id) == list(range(1, 19))
    walls = out.elevation.frame.query("kind == 'facade'").geometry
    assert walls.iloc[0].bounds[2] < walls.iloc[1].bounds[0]
    assert set(out.cleaned["opening_id"]) == {
        0,
        *out.openings.frame[lambda f: f.seen > 0].opening_id,
    }
    alone = found(both, plane=101)
    assert (alone.count, alone.fronts) == (9, 1)


@pytest.mark.parametrize("name", ["facade_1.txt.gz", "facade_2.txt.gz"])
def test_real_shop_fronts(data: Callable[[str], Path], name: str) -> None:
    """Doors and windows full of panes, shutters and goods, labelled one by one."""
    table = np.loadtxt(data(f"facade_street_openings/{name}"), skiprows=1)
    intensity = table[:, 3].astype(np.uint16)
    cloud = PointCloud(table[:, :3], {"intensity": intensity}, crs=LOCAL)
    out = found(PlanesExtract(points=cloud).run().segmented)
    shapes = [
        _along(shapely.get_coordinates(g, include_z=True)) for g in out.openings.frame.geometry
    ]
    kind, number = table[:, 4], table[:, 5]
    labelled = [
        _along(table[(kind == k) & (number == n), :3])
        for k in (2, 3)
        for n in np.unique(number[kind == k])
    ]
    shared = shapely.area(shapely.intersection(np.array(labelled)[:, None], np.array(shapes)[None]))
    areas = shapely.area(labelled)[:, None] + shapely.area(shapes)[None] - shared
    right = int((shared / areas >= 0.5).any(axis=1).sum())
    assert 2 * right / (len(shapes) + len(labelled)) == 1.0
    assert np.mean(_in_intervals(out.elevation.frame, table)) >= 0.9, "half of unsure ones did not"


def _in_intervals(elevation: Any, table: Floats) -> list[bool]:
    """Whether the label of each side that was seen lies in its interval."""
    wall = elevation[elevation["kind"] == "facade"].iloc[0]
    corner, right, up = (
        wall[[f"{name}_{axis}" for axis in "xyz"]].to_numpy(float)
        for name in ("corner", "right", "up")
    )
    uv = (table[:, :3] - corner) @ np.column_stack([right, up])
    labels = shapely.box(
        *np.transpose(
            [
                (*part.min(axis=0), *part.max(axis=0))
                for kind in (2, 3)
                for number in np.unique(table[table[:, 4] == kind, 5])
                for part in [uv[(table[:, 4] == kind) & (table[:, 5] == number)]]
            ]
        )
    )
    held = []
    for one in elevation[elevation["opening_id"] > 0].to_dict("records"):
        box = shapely.box(*one["geometry"].bounds)
        shared = shapely.area(shapely.intersection(labels, box))
        shares = shared / (shapely.area(labels) + box.area - shared)
        if shares.max() >= 0.5:
            off = np.abs(np.subtract(labels[shares.argmax()].bounds, box.bounds))
            known = np.array([one[f"{side}_interval"] for side in SIDES])
            held += (off <= known)[np.isfinite(known)].tolist()
    return held


def _along(xyz: Floats) -> Any:
    """Hull of points of a front that runs north and south, seen from the side."""
    return shapely.convex_hull(shapely.multipoints(xyz[:, 1:]))


def test_edges_are_found_where_the_noise_mixes_panes_with_the_wall() -> None:
    """With 5 cm noise many points of panes lie in the depth of the wall, but few in its plane."""
    rng = np.random.default_rng(4)
    boxes = [(left, 1.0, left + 1.2, 2.5) for left in (1.0, 3.5, 6.0, 8.5)]
    u, v = rng.random((2, 45_000)) * [[11], [4]]
    inside = [(u > a) & (u < c) & (v > b) & (v < d) for a, b, c, d in boxes]
    depth = np.where(np.any(inside, axis=0), 0.15, 0.0) + rng.normal(0, 0.05, len(u))
    columns = {"plane_id": (np.abs(depth) < 0.06).astype(np.int32)}
    ground = np.column_stack([*(rng.random((2, 20_000)) * [[11], [-8]]), np.zeros(20_000)])
    columns["plane_id"] = np.append(columns["plane_id"], np.full(len(ground), 2, np.int32))
    xyz = np.vstack([np.column_stack([u, depth, v]), ground])
    out = found(PointCloud(xyz + FAR, columns, crs=UTM))
    assert out.count == 4
    np.testing.assert_allclose(out.openings.frame.width, 1.2, atol=0.12)
    np.testing.assert_allclose(out.openings.frame.height, 1.5, atol=0.12)


def test_panes_that_the_plane_of_the_wall_holds_stand_back_all_the_same() -> None:
    """Panes 7 cm behind a wall with noise of 2 cm, which return one pulse in five.

    A third of what is seen of them is within the tolerance of the wall, 5.8 cm, and of its plane.
    """
    rng = np.random.default_rng(5)
    boxes = [(left, 1.0, left + 1.2, 2.5) for left in (1.0, 3.5, 6.0, 8.5)]
    u, v = rng.random((2, 20_000)) * [[11], [4]]
    pane = np.any([(u > a) & (u < c) & (v > b) & (v < d) for a, b, c, d in boxes], axis=0)
    seen = ~pane | (rng.random(len(u)) < 0.2)
    depth = np.where(pane, 0.07, 0.0) + rng.normal(0, 0.02, len(u))
    wall = np.column_stack([u, depth, v])[seen]
    ground = np.column_stack([*(rng.random((2, 5_000)) * [[11], [-8]]), np.zeros(5_000)])
    ids = np.append(np.abs(wall[:, 1]) < 0.058, np.full(len(ground), 2)).astype(np.int32)
    out = found(PointCloud(np.vstack([wall, ground]) + FAR, {"plane_id": ids}, crs=UTM))
    assert out.count == 4
    np.testing.assert_allclose(out.openings.frame.width, 1.2, atol=0.07)
    np.testing.assert_allclose(out.openings.frame.height, 1.5, atol=0.07)


def test_sides_are_as_sure_as_their_points_and_uneven_ones_are_named() -> None:
    """Four windows; at the right side of the first, most rows of the wall end 0.1 m farther away.

    The seed was not used to choose the interval.
    """
    rng = np.random.default_rng(11)
    boxes = [(left, 1.0, left + 1.2, 2.5) for left in (1.0, 3.5, 6.0, 8.5)]
    u, v = rng.random((2, 40_000)) * [[11], [4]]
    pane = np.any([(u > a) & (u < c) & (v > b) & (v < d) for a, b, c, d in boxes], axis=0)
    lost = (u > 2.2) & (u < 2.3) & (v > 1) & (v < 1.85)
    depth = np.where(pane, 0.15, 0.0) + rng.normal(0, 0.003, len(u))
    wall = np.column_stack([u, depth, v])[~lost]
    ground = np.column_stack([*(rng.random((2, 5_000)) * [[11], [-8]]), np.zeros(5_000)])
    ids = np.append(np.where(wall[:, 1] < 0.07, 1, 0), np.full(len(ground), 2)).astype(np.int32)
    out = found(PointCloud(np.vstack([wall, ground]) + FAR, {"plane_id": ids}, crs=UTM))
    frame = out.openings.frame.sort_values("opening_id")
    assert out.count == 4
    assert frame.unsure.tolist() == ["right", "", "", ""]
    assert frame.right_interval.iloc[0] > 0.1
    sure = frame[[f"{side}_interval" for side in SIDES]].iloc[1:].to_numpy(float)
    assert ((sure > 0.01) & (sure < 0.05)).all()
    corners = [shapely.get_coordinates(s, include_z=True) - FAR for s in frame.geometry.iloc[1:]]
    ends = np.array([[*one[:, [0, 2]].min(axis=0), *one[:, [0, 2]].max(axis=0)] for one in corners])
    assert (np.abs(ends - np.array(boxes[1:])) <= sure).mean() >= 0.9
    assert "unsure: 1 of 16; that were not seen and may be elsewhere: 0." in out.in_words()


def test_the_lower_side_of_a_door_is_the_ground_and_has_no_interval() -> None:
    relief = types.SimpleNamespace(uv=np.zeros((1, 2)), own=np.ones(1, bool))
    known = {"intervals": (0.02, 0.9, 0.03, 0.02), "unsure": "bottom"}
    for height, interval, unsure in ((2.1, 0.03, ""), (1.0, 0.9, "bottom")):
        shape = shapely.box(0, 0.1, 1, 0.1 + height)
        one = Opening(shape, 9, 0.1, 0.9, "", "recess", 0.9, **known)  # type: ignore[arg-type]
        row = one.row(relief, 1.0)  # type: ignore[arg-type]
        assert (row["edge_interval"], row["unsure"]) == (interval, unsure)
        assert np.isnan(row["bottom_interval"]) == (row["kind"] == "door")


def test_a_side_of_which_half_of_the_rows_are_not_there_was_not_seen() -> None:
    """Points 0.1 apart around a square; a part of the wall right of it returned nothing."""
    u, v = np.meshgrid(np.arange(0.05, 3, 0.1), np.arange(0.05, 3, 0.1))
    wall = (np.abs(u - 1.5) > 0.5) | (np.abs(v - 1.5) > 0.5)
    one = Opening(shapely.box(1, 1, 2, 2), 9, 0.1, 0.9, "", "recess", 0.9)
    for lost, hidden in ((0.0, ""), (1.0, "right")):
        kept = wall & ~((u > 2) & (u < 2.6) & (v > 1) & (v < 1 + lost))
        uv = np.column_stack([u[kept], v[kept]])
        made = _with_intervals(one, uv, types.SimpleNamespace(apart=0.1))  # type: ignore[arg-type]
        assert made.hidden == hidden
        assert np.isnan(made.intervals).tolist() == [side == hidden for side in SIDES]


@pytest.mark.slow
def test_a_front_with_truth() -> None:
    """No curtain is left, all openings are found, edges in sight within 3 cm."""
    data = scene("facade", size=30.0, density=900.0, seed=3)
    kinds = {p["plane_id"]: p["kind"] for _, p in data.features if "plane_id" in p}
    out = PlanesExtract(points=PointCloud(data.xyz, crs=UTM)).run()
    made = found(out.segmented)
    true = np.array([kinds[k] for k in data.attributes["plane_id"]])
    assert (out.segmented["plane_id"][true == "curtain"] > 0).any()
    assert not made.cleaned["plane_id"][true == "curtain"].any()
    for kind in ("wall", "door", "glass", "roof", "van", "ground", "balcony"):
        assert not made.cleaned["behind"][true == kind].any(), kind
    truth = [s for s, p in data.features if p["kind"] == "opening"]
    assert made.count == len(truth)
    along = np.array([math.cos(math.radians(17)), math.sin(math.radians(17))])
    boxes = [_box(shape, along) for shape in made.openings.frame.geometry]
    off = []
    for shape in truth:
        box = _box(shape, along)
        best = min(boxes, key=lambda other: float(np.abs(other[[1, 3]] - box[[1, 3]]).sum()))
        off.append(np.abs(best - box))
    frame = made.openings.frame
    bottoms = np.array([_box(shape, along)[2] for shape in frame.geometry])
    lowest = [min(abs(_box(shape, along)[2] - bottom) for shape in truth) for bottom in bottoms]
    wrong = (np.array(lowest) > 0.03) & (frame.kind != "door")  # ground rises above sills of doors
    assert wrong.any()
    assert frame.hidden[wrong].str.contains("bottom").all()
    sides = np.array(off)[:, [0, 1, 3]]
    assert sides[:, 1].max() < 0.5
    assert np.median(sides) < 0.01
    assert (sides < 0.03).mean() > 0.95


def _box(shape: Any, along: Floats) -> Floats:
    """Left, and right, bottom and top of a shape on the front."""
    xyz = shapely.get_coordinates(shape, include_z=True)
    u = xyz[:, :2] @ along
    return np.array([u.min(), u.max(), xyz[:, 2].min(), xyz[:, 2].max()])


def test_squares_around_gaps_are_joined_without_a_warning() -> None:
    """Mitres of edges in one line divide by zero, which is an error in tests."""
    rows = ["0110111", "1000110", "1000011", "1111001", "1111010", "1000111", "0111111"]
    region = np.array([[cell == "1" for cell in row] for row in rows])
    joined = _squares(region, 0.1)
    assert joined.is_valid
    assert joined.area >= 0.1**2 * region.sum() - 1e-9


@pytest.mark.parametrize("sides", [1, 2])
def test_a_wall_scanned_from_both_sides_is_told(
    caplog: pytest.LogCaptureFixture, sides: int
) -> None:
    """A wall of 8 by 4 m, 0.3 m thick, with a window; nothing is told of one side alone."""
    rng = np.random.default_rng(3)
    u, v = rng.random((2, 20_000 * sides)) * [[8.0], [4.0]]
    side = np.arange(len(u)) % sides
    wall = (u < 3) | (u > 4.2) | (v < 1) | (v > 2.5)
    xyz = np.column_stack([u, 0.3 * side + rng.normal(0, 0.003, len(u)), v])[wall]
    points = PointCloud(xyz, {"plane_id": (side[wall] + 1).astype(np.int32)}, crs=LOCAL)
    PlanesOpenings(points=points).run()
    assert ("has two walls, one behind the other" in caplog.text) == (sides == 2)


@pytest.mark.parametrize("angle", [75.0, 90.0])
def test_a_side_wall_behind_the_corner_is_not_the_street(angle: float) -> None:
    """It holds more points than the street, behind few columns of the wall."""
    rng = np.random.default_rng(4)
    cloud = front()
    away, up = rng.random((2, 200_000)) * [[14.0], [4.0]]
    along = 0.05 + away * math.cos(math.radians(angle)) + rng.normal(0, 0.005, len(away))
    side = np.column_stack([along, away * math.sin(math.radians(angle)), up]) + FAR
    ids = np.append(cloud["plane_id"], np.full(len(side), 7, np.int32))
    both = PointCloud(np.vstack([cloud.xyz, side]), {"plane_id": ids}, crs=UTM)
    frame = found(both, plane=WALL).openings.frame
    for kind, (left, _, right, _) in (("window", OPEN[WINDOW]), ("door", OPEN[DOOR])):
        assert np.abs(frame.width[frame.kind == kind] - (right - left)).min() < 0.02


def curtain_wall(echoes: float) -> PointCloud:
    """Frames of 8 cm around 4 by 3 panels of 1.5 by 3 m, 5 cm before glass with so many echoes."""
    rng = np.random.default_rng(3)
    uv = rng.random((80_000, 2)) * [6.08, 9.08]
    frame = ((uv[:, 0] % 1.5 < 0.08) | (uv[:, 1] % 3.0 < 0.08))[:, None]
    seen = frame[:, 0] | (rng.random(len(uv)) < echoes)
    away = np.where(frame[:, 0], 0.0, 0.05) + rng.normal(0, 0.002, len(uv))
    wall = np.column_stack([uv[:, 0], away, uv[:, 1]])[seen]
    ground = np.column_stack([*(rng.random((2, 9_000)) * [[6], [-8]]), np.zeros(9_000)])
    xyz = np.vstack([wall, ground])
    kind = np.where(frame[seen, 0], 2, 1).astype(np.int32)
    plane_id = np.append(kind, np.full(len(ground), 3, np.int32))
    return PointCloud(xyz, {"plane_id": plane_id}, crs=LOCAL)


def test_panels_of_a_curtain_wall_are_openings_and_its_glass_is_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    out = found(curtain_wall(0.1))
    assert out.count == 12
    assert out.openings.frame.width.between(1.38, 1.46).all()
    assert "front 1 is a curtain wall: plane 1 is taken for glass" in caplog.text


def test_bands_below_the_panes_of_a_curtain_wall_are_wall() -> None:
    """In the plane of the glass, of which they hold most points; frames are a scan column wide."""
    x, z = (
        grid.ravel() for grid in np.meshgrid(np.arange(0, 6.05, 0.04), np.arange(0, 9.05, 0.04))
    )
    beside = np.abs(x / 1.5 - np.round(x / 1.5)) * 1.5
    column, row = beside < 0.01, np.min([z % 3, (z - 1) % 3], axis=0) < 0.07
    frame, band = column | row, z % 3 < 1
    seen = frame | band | (np.random.default_rng(3).random(len(x)) < 0.1)
    wall = np.column_stack([x, np.where(frame, 0.0, 0.06), z])[seen]
    # The sides of the frames have more points than their fronts.
    step = np.arange(0.01, 0.06, 0.01)
    ends = np.array([(a, up) for a in np.arange(0, 6.1, 1.5) for up in np.arange(0, 9.05, 0.04)])
    sides = np.column_stack(
        [np.repeat(ends[:, 0] + 0.02, 5), np.tile(step, len(ends)), np.repeat(ends[:, 1], 5)]
    )
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(0, 6, 0.1), np.arange(-8, 0, 0.1)))
    xyz = np.vstack([wall, sides, np.column_stack([u, v, 0 * u])])
    numbers = [np.where(frame[seen], 2, 1), np.zeros(len(sides)), np.full(len(u), 3)]
    ids = np.concatenate(numbers).astype(np.int32)
    frame = found(PointCloud(xyz, {"plane_id": ids}, crs=LOCAL)).openings.frame
    assert len(frame) == 12
    assert frame.width.between(1.4, 1.5).all()
    assert frame.height.between(1.85, 2.0).all()


def test_panels_with_as_many_points_as_their_frames_are_wall(
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert found(curtain_wall(0.9)).count == 0
    assert "curtain wall: plane" not in caplog.text
    assert "no openings, as its wall has no gaps; of a curtain wall" in caplog.text


def test_a_wall_without_gaps_is_told_to_be_one(caplog: pytest.LogCaptureFixture) -> None:
    """Its gaps were said to be "none", and to lie in a layer."""
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(0, 8, 0.1), np.arange(0, 5, 0.1)))
    cloud = PointCloud(
        np.column_stack([x, 0 * x, z]), {"plane_id": np.ones(len(x), np.int32)}, crs=LOCAL
    )
    assert found(cloud).count == 0
    assert "the front of plane 1 has no openings, as its wall has no gaps" in caplog.text


def test_balconies_before_gaps_do_not_turn_a_front() -> None:
    """Somewhat more squares before gaps than in them, and twice as much ground on that side."""
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(0, 10, 0.1), np.arange(0, 6, 0.1)))
    gap = (np.abs(z - 3) < 1) & ((np.abs(x - 3) < 1) | (np.abs(x - 7) < 1))
    balcony, room = (gap & (np.abs(x - at) < wide) for at, wide in ((3, 1), (7, 0.9)))
    wall = np.column_stack([x, 0 * x, z])[~gap]
    before = np.column_stack([x, 0 * x - 0.8, z])[balcony]
    behind = np.column_stack([x, 0 * x + 0.8, z])[room]
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(0, 10, 0.2), np.arange(-9, 5, 0.2)))
    ground = np.column_stack([u, v, 0 * u])
    xyz = np.vstack([wall, before, behind, ground])
    for normal in ([0.0, 1.0, 0.0], [0.0, -1.0, 0.0]):
        plane = Plane(np.array(normal), np.zeros(3), np.zeros(3))
        none = np.zeros(len(xyz), bool)
        assert outside(xyz, plane, np.arange(len(wall)), 1.0, none)[0].normal[1] == -1.0


def wall_with_panes(back: float) -> tuple[Any, Any]:
    """Points of a wall of 10 by 6 m with two gaps, and of the panes in these, seen from -y."""
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(0, 10, 0.1), np.arange(0, 6, 0.1)))
    gap = (np.abs(z - 3) < 1) & ((np.abs(x - 3) < 1) | (np.abs(x - 7) < 1))
    return np.column_stack([x, 0 * x, z])[~gap], np.column_stack([x, 0 * x + back, z])[gap]


@pytest.mark.parametrize("place", ["around the corner", "behind the house", "over the street"])
def test_the_walls_of_other_fronts_are_no_street(place: str) -> None:
    """Each of the first two lies behind the wall, and there is no ground at all."""
    wall, pane = wall_with_panes(0.2)
    along, up = (grid.ravel() for grid in np.meshgrid(np.arange(0, 12, 0.1), np.arange(0, 6, 0.1)))
    other = {
        "around the corner": np.column_stack([0 * along + 9.9, along, up]),
        "behind the house": np.column_stack([along, 0 * along + 8, up]),
        "over the street": np.column_stack([along, 0 * along - 8, up]),
    }[place]
    xyz = np.vstack([wall, pane, other])
    others = np.arange(len(xyz)) >= len(wall) + len(pane)
    for normal in ([0.0, 1.0, 0.0], [0.0, -1.0, 0.0]):
        plane = Plane(np.array(normal), np.zeros(3), np.zeros(3))
        assert outside(xyz, plane, np.arange(len(wall)), 1.0, others)[0].normal[1] == -1.0


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_walls_of_other_fronts_tell_the_side_where_nothing_else_does(way: float) -> None:
    wall, _ = wall_with_panes(0.2)
    along, up = (grid.ravel() for grid in np.meshgrid(np.arange(0, 12, 0.1), np.arange(0, 6, 0.1)))
    xyz = np.vstack([wall, np.column_stack([along, 0 * along + 8 * way, up])])
    plane = Plane(np.array([0.0, 1.0, 0.0]), np.zeros(3), np.zeros(3))
    others = np.arange(len(xyz)) >= len(wall)
    seen, told = outside(xyz, plane, np.arange(len(wall)), 1.0, others)
    assert seen.normal[1] == way
    assert not told, "it may stand behind the house"


def test_what_is_seen_past_the_end_of_a_wall_is_not_before_it() -> None:
    """Goods beside the end of the house, on no plane, and no ground."""
    wall, pane = wall_with_panes(0.2)
    goods = np.random.default_rng(2).random((4_000, 3)) * [0.9, 12, 3] + [9.1, 1.5, 0]
    xyz = np.vstack([wall, pane, goods])
    plane = Plane(np.array([0.0, 1.0, 0.0]), np.zeros(3), np.zeros(3))
    none = np.zeros(len(xyz), bool)
    assert outside(xyz, plane, np.arange(len(wall)), 1.0, none)[0].normal[1] == -1.0


@pytest.mark.parametrize("noise", [0.002, 0.02])
def test_a_strip_in_the_plane_of_a_wall_is_not_its_reference(noise: float) -> None:
    """However much its points scatter: it has no gaps, so that none tells what stands back."""
    rng = np.random.default_rng(3)
    wall, pane = wall_with_panes(0.2)
    along, up = rng.random((2, 3_000)) * [[2.6], [2.6]]
    strip = np.column_stack([along + 10.3, rng.normal(0, noise, len(along)), up])
    wall[:, 1] += rng.normal(0, 0.002, len(wall))
    xyz = np.vstack([wall, pane, strip])
    ids = np.repeat([1, 2, 3], [len(wall), len(pane), len(strip)]).astype(np.int32)
    planes = [fitted(xyz[ids == k]) for k in (1, 2, 3)]
    front = fronts_of(xyz, ids, planes, depth=1.5, metre=1.0)[0]
    assert front.members[0] == 0
    assert front.plane.normal[1] < -0.99


@pytest.mark.parametrize(
    ("wall", "wall_noise", "other", "other_noise"),
    [((3.0, 2.6), 0.002, (4.0, 2.6), 0.015), ((12.0, 6.0), 0.02, (6.0, 2.6), 0.003)],
    ids=["goods in a shop", "gates of garages in a wall of rubble"],
)
def test_the_reference_is_large_and_flat(
    wall: tuple[float, float], wall_noise: float, other: tuple[float, float], other_noise: float
) -> None:
    """Neither what scatters over more area, nor what is flatter on much less."""
    rng = np.random.default_rng(4)
    parts = []
    for size, noise, depth in ((wall, wall_noise, 0.0), (other, other_noise, 0.12)):
        places = rng.random((4_000, 2)) * size
        parts.append(np.column_stack([places[:, 0], rng.normal(depth, noise, 4_000), places[:, 1]]))
    ids = np.repeat([1, 2], 4_000).astype(np.int32)
    planes = [fitted(part) for part in parts]
    front = fronts_of(np.vstack(parts), ids, planes, depth=1.5, metre=1.0)[0]
    assert front.members[0] == 0


def test_gaps_of_all_pieces_of_a_wall_tell_its_side() -> None:
    """The largest piece has none."""
    wall, pane = wall_with_panes(0.2)
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(11, 23, 0.1), np.arange(0, 6, 0.1)))
    blank = np.column_stack([x, 0 * x, z])
    xyz = np.vstack([wall, pane, blank])
    ids = np.repeat([1, 2, 3], [len(wall), len(pane), len(blank)]).astype(np.int32)
    for normal in ([0.0, 1.0, 0.0], [0.0, -1.0, 0.0]):
        planes = [Plane(np.array(normal), np.zeros(3), xyz[ids == k][0]) for k in (1, 2, 3)]
        front = fronts_of(xyz, ids, planes, depth=1.5, metre=1.0)[0]
        assert front.members[0] == 2
        assert front.plane.normal[1] == -1.0


@pytest.mark.parametrize(
    ("back", "street", "told"), [(0.2, False, False), (0.0, False, True), (0.0, True, False)]
)
def test_a_front_of_which_nothing_tells_the_side_is_told(
    back: float, street: bool, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Panes stand back, or there is twice as much ground before the wall as behind."""
    wall, pane = wall_with_panes(back)
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(0, 10, 0.2), np.arange(-9, 5, 0.2)))
    ground = np.column_stack([u, v, 0 * u])[: len(u) * street]
    xyz = np.vstack([wall, pane[pane[:, 1] > 0], ground])
    ids = np.where(np.arange(len(xyz)) < len(wall), 1, 2).astype(np.int32)
    found(PointCloud(xyz, {"plane_id": ids}, crs=LOCAL))
    assert ("from which side front 1 was seen is not told" in caplog.text) == told


def test_a_wall_without_gaps_may_have_been_seen_from_either_side(
    caplog: pytest.LogCaptureFixture,
) -> None:
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(0, 8, 0.1), np.arange(0, 5, 0.1)))
    xyz = np.column_stack([x, 0 * x, z])
    found(PointCloud(xyz, {"plane_id": np.ones(len(x), np.int32)}, crs=LOCAL))
    assert "from which side" not in caplog.text


@pytest.mark.parametrize(("crs", "metre"), [(LOCAL, 1.0), (parse_crs("EPSG:2263"), 1 / 0.3048006)])
def test_gaps_that_are_too_large_alone_are_told(
    crs: Any, metre: float, caplog: pytest.LogCaptureFixture
) -> None:
    """Shop windows as wide as two metres are none with a smaller limit, which is said."""
    wall, pane = wall_with_panes(0.2)
    xyz = metre * np.vstack([wall, pane])
    ids = np.repeat([1, 2], [len(wall), len(pane)]).astype(np.int32)
    cloud = PointCloud(xyz, {"plane_id": ids}, crs=crs)
    assert found(cloud).count == 2
    assert "too large for openings" not in caplog.text
    found(cloud, max_width=1.5)
    assert "with wall beside: 2, the largest about 1.9 m wide and 1.9 m high" in caplog.text


@pytest.mark.parametrize(
    ("rectangle", "beside", "told"),
    [(True, (1, 0, 1, 1), True), (True, (0, 1, 1, 0), False), (False, (1, 1, 1, 1), False)],
)
def test_strips_and_ragged_gaps_are_not_told_as_too_large(
    rectangle: bool, beside: Any, told: bool
) -> None:
    gap = Gap(shapely.box(0, 0, 5, 5), rectangle, "behind", TOO_WIDE, 1.0, beside)
    assert too_large(gap) == told
    assert not too_large(gap._replace(dropped="too narrow"))


def test_a_front_on_a_curve_is_told(caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(5)
    along, up = rng.random((2, 9_000)) * [[15], [5]]
    piece = np.floor(along / 3) * 3 + 1.5
    for radius, told in ((40.0, True), (1e6, False)):
        angle = piece / radius
        away = radius * (1 - np.cos(angle)) + (along - piece) * np.sin(angle)
        across = radius * np.sin(angle) + (along - piece) * np.cos(angle)
        number = (piece // 3 + 1).astype(np.int32)
        xyz = np.column_stack([across, away + rng.normal(0, 0.002, len(up)), up])
        caplog.clear()
        found(PointCloud(xyz, {"plane_id": number}, crs=LOCAL))
        assert ("as on a curve" in caplog.text) == told


def test_a_door_whose_foot_was_not_seen_may_be_a_window() -> None:
    """A car or a hedge before a door gives it a sill; above 0.8 m it is a window all the same."""
    assert kind_of(2.0, 0.3, "bottom", 1.0) == "door"
    for metre in (1.0, 1000.0):
        assert kind_of(2.0 * metre, 0.32 * metre, "right, bottom", metre) == EITHER
        assert kind_of(2.0 * metre, 0.32 * metre, "right", metre) == "window"
        assert kind_of(2.0 * metre, 0.9 * metre, "bottom", metre) == "window"
        assert kind_of(1.2 * metre, 0.32 * metre, "bottom", metre) == "window"


def test_an_opening_that_may_be_two_things_is_half_as_certain() -> None:
    uv = np.array([[0.5, 0.0], [0.5, 3.0]])
    front = types.SimpleNamespace(uv=uv, own=np.ones(2, bool))
    found = {
        hidden: Opening(shapely.box(0, 0.4, 1, 2.5), 9, 0.1, 0.9, hidden, "recess", 0.9).row(
            front,  # type: ignore[arg-type]
            1.0,
        )
        for hidden in ("", "bottom")
    }
    assert [row["kind"] for row in found.values()] == ["window", EITHER]
    assert [row["certainty"] for row in found.values()] == [0.9, pytest.approx(0.45)]


@pytest.mark.parametrize(
    ("low", "hidden", "unsure", "by", "certainty"),
    [
        (1.0, "left, top", "", "recess", 0.9),
        (1.0, "left, top", "bottom", "recess", 0.5),
        (1.0, "top", "left, right", "recess", 0.5),
        (1.0, "top", "left, bottom, right", "recess", 0.25),
        (1.0, "left, bottom, top", "", "recess", 0.25),
        (1.0, "bottom, top", "", "recess", 0.25),
        (1.0, "left, bottom, top", "", "outline", 0.5),
        (0.0, "left, bottom, top", "", "recess", 0.9),
        (0.0, "bottom, top", "left", "recess", 0.9),
        (0.0, "left, bottom, right", "", "recess", 0.25),
    ],
)
def test_an_opening_of_no_known_size_is_not_sure(
    low: float, hidden: str, unsure: str, by: str, certainty: float
) -> None:
    """Three of its sides, or both ends of one size, are not told; a door has no lower side."""
    front = types.SimpleNamespace(uv=np.array([[0.5, 0.0]]), own=np.ones(1, bool))
    shape = shapely.box(0, low, 1, low + 2)
    one = Opening(shape, 9, 0.1, 0.5, hidden, by, 0.9, unsure=unsure)
    assert one.row(front, 1.0)["certainty"] == certainty  # type: ignore[arg-type]


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_front_without_a_street_is_seen_from_where_its_openings_are(
    way: float, caplog: pytest.LogCaptureFixture
) -> None:
    """Boxes with flowers stand before its panes, as many as these: neither tells the side."""
    rng = np.random.default_rng(11)
    wall, parts = flat((0, 0, 10, 4), 1500, 0.0, rng), []
    for left in (1.0, 4.0, 7.0):
        box = (left, 1.0, left + 1.5, 2.5)
        inside = (wall[:, [0, 2]] > box[:2]) & (wall[:, [0, 2]] < box[2:])
        wall = wall[~inside.all(axis=1)]
        parts += [flat(box, 600, 0.12, rng), flat(box, 600, -0.4, rng)]
    xyz = np.vstack([wall, *parts]) * [1.0, way, 1.0]
    ids = np.repeat([1, 2, 0, 2, 0, 2, 0], [len(part) for part in (wall, *parts)]).astype(np.int32)
    out = found(PointCloud(xyz + FAR, {"plane_id": ids}, crs=UTM))
    assert out.openings.frame.width.tolist() == pytest.approx([1.5] * 3, abs=0.1)
    assert any(text.startswith("from which side front 1") for text in caplog.messages)


@pytest.mark.parametrize(("wide", "sure"), [(0.45, False), (0.55, True)])
def test_an_opening_as_small_as_the_least_is_not_sure(wide: float, sure: bool) -> None:
    rng = np.random.default_rng(7)
    wall, pane = flat((0, 0, 4, 3), 6000, 0.0, rng), (1.5, 1.0, 1.5 + wide, 2.0)
    inside = (wall[:, [0, 2]] > pane[:2]) & (wall[:, [0, 2]] < pane[2:])
    wall, back = wall[~inside.all(axis=1)], flat(pane, 800, 0.12, rng)
    street = np.column_stack([*(rng.random((2, 20_000)) * [[4], [-8]]), np.zeros(20_000)])
    ids = np.repeat([1, 2, 0], [len(wall), len(back), len(street)]).astype(np.int32)
    xyz = np.vstack([wall, back, street])
    (one,) = found(PointCloud(xyz + FAR, {"plane_id": ids}, crs=UTM)).openings.frame.itertuples()
    assert one.width == pytest.approx(wide, abs=0.04)
    assert (one.certainty > 0.7) is sure
    assert (one.certainty > 0.45) is True


def behind_a_post(
    wide: float,
    high: float = 9.0,
    *,
    lefts: tuple[float, ...] = (1.0, 4.0, 7.0),
    width: float = 2.0,
) -> PlanesOpenings.Outputs:
    """A wall of 10 by 7 m with six windows, two of them crossed by a strip without points."""
    rng = np.random.default_rng(3)
    wall, panes = flat((0, 0, 10, 7), 600, 0.0, rng), []
    for left, bottom in itertools.product(lefts, (1.0, 4.0)):
        box = (left, bottom, left + width, bottom + 1.5)
        inside = (wall[:, [0, 2]] > box[:2]) & (wall[:, [0, 2]] < box[2:])
        wall = wall[~inside.all(axis=1)]
        panes.append(flat(box, 500, 0.12, rng))
    xyz, ids = np.vstack([wall, *panes]), np.repeat([1, 2], [len(wall), sum(map(len, panes))])
    keep = (np.abs(xyz[:, 0] - 5.0) > wide / 2) | (xyz[:, 2] > high)
    street = np.column_stack([*(rng.random((2, 20_000)) * [[10], [-8]]), np.zeros(20_000)])
    xyz = np.vstack([xyz[keep], street])
    ids = np.append(ids[keep], np.zeros(len(street), int)).astype(np.int32)
    return found(PointCloud(xyz + FAR, {"plane_id": ids}, crs=UTM))


def test_windows_in_the_shadow_of_a_post_are_whole_and_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    frame = behind_a_post(0.5).openings.frame
    assert frame.width.tolist() == pytest.approx([2.0] * 6, abs=0.1)
    assert frame.height.tolist() == pytest.approx([1.5] * 6, abs=0.1)
    assert (frame.certainty < 0.6).tolist() == [False, False, True, True, False, False]
    (told,) = (text for text in caplog.messages if text.startswith("strips of front 1"))
    assert "1, from 4.8 m" in told
    assert any("strips cross: 2," in text for text in caplog.messages)


@pytest.mark.parametrize("seed", range(3))
def test_open_shutters_of_a_front_without_a_street_are_no_windows(seed: int) -> None:
    """Seen from behind they are, and of the same area: which side it was had been chance."""
    rng = np.random.default_rng(seed)
    wall, parts = flat((0, 0, 10, 5), 600, 0.0, rng), []
    for left in (1.0, 4.0, 7.0):
        for first, last, depth in ((-0.5, 0.0, -0.06), (0.0, 1.0, 0.12), (1.0, 1.5, -0.06)):
            box = (left + first, 1.5, left + last, 3.0)
            inside = (wall[:, [0, 2]] > box[:2]) & (wall[:, [0, 2]] < box[2:])
            wall = wall[~inside.all(axis=1)]
            parts.append(flat(box, 500, depth, rng))
    xyz = np.vstack([wall, *parts])
    ids = np.repeat([1, 0], [len(wall), len(xyz) - len(wall)]).astype(np.int32)
    frame = found(PointCloud(xyz + FAR, {"plane_id": ids}, crs=UTM)).openings.frame
    assert frame.width.tolist() == pytest.approx([1.0] * 3, abs=0.05)


def test_windows_on_both_sides_of_a_column_before_their_pier_are_two() -> None:
    """They were one of 3.6 m: the pier is not seen, and what stands back is on both sides."""
    frame = behind_a_post(0.5, lefts=(0.8, 3.2, 5.25, 7.6), width=1.6).openings.frame
    assert frame.width.tolist() == pytest.approx([1.6] * 8, abs=0.2)
    assert (frame.certainty > 0.9).all()


@pytest.mark.parametrize("width", [1.6, 1.1])
def test_where_no_other_opening_tells_there_may_be_one_or_two(width: float) -> None:
    frame = behind_a_post(0.5, lefts=(5.0 - width,), width=2 * width).openings.frame
    assert len(frame) == 4
    assert (frame.certainty < 0.6).all()


def test_windows_without_a_post_are_not_told(caplog: pytest.LogCaptureFixture) -> None:
    assert (behind_a_post(0.0).openings.frame.certainty > 0.9).all()
    assert "strips of front" not in caplog.text


def test_a_strip_that_is_lower_than_an_opening_may_be_is_none(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A window a storey high, as of a staircase, that has no glass to be seen."""
    behind_a_post(0.5, high=5.9)
    assert "strips of front" not in caplog.text


def test_windows_that_end_at_a_wide_strip_are_parts_and_not_sure() -> None:
    """More than a metre wide, it may hide wall between two windows as well."""
    frame = behind_a_post(1.1).openings.frame
    assert len(frame) == 8
    assert (frame.certainty < 0.6).sum() == 4


@pytest.mark.parametrize(
    ("ends", "edge"),
    [
        ([1.0, 1.01, 1.0, 1.01, 1.0, 1.6, 1.7], 1.01),
        ([1.0, 1.0, 1.0, 1.0, 1.0, 1.09, 1.09], 1.09),
        ([1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6], 1.57),
        ([1.0, 1.05, 1.1, 1.15, 1.2, 1.9, 2.0], 1.19),
        ([1.0, 1.6, 1.6, 1.61, 1.6, 1.6, 1.0], 1.607),
    ],
    ids=[
        "two go on alone",
        "within a distance",
        "all are uneven",
        "uneven and two alone",
        "two end early",
    ],
)
def test_rows_that_go_on_alone_are_no_edge(ends: list[float], edge: float) -> None:
    assert _edge(np.array(ends), 0.1) == pytest.approx(edge, abs=0.005)


def test_the_air_above_a_gable_is_no_window_below_it() -> None:
    """A strip of wall 0.15 m high parts them, and is less than the gap reaches over."""
    side, apart = 0.2, 0.05
    u, v = np.meshgrid(np.arange(0, 3, apart), np.arange(0, 2.2, apart))
    wall = ((np.abs(u - 1.5) > 0.5) | (v < 1.0) | (v > 1.65)) & (v < 1.8)
    uv = np.column_stack([u[wall], v[wall]])
    gap = Gap(shapely.box(1.0, 1.0, 2.0, 1.9), True, "behind", "", 1.0, (1.0,) * 4)
    shape = _free(gap, uv, types.SimpleNamespace(side=side, apart=apart))  # type: ignore[arg-type]
    assert shape.bounds[3] == pytest.approx(1.65, abs=0.1)


@pytest.mark.parametrize(("wide", "deep"), [(2.5, 0.14), (4.5, 0.14), (2.5, 0.0)])
def test_a_plane_through_a_wall_and_a_pane_beside_it_is_parted(wide: float, deep: float) -> None:
    """A plane of 2.5 m of wall and a pane: it is 5 m wide, the pane no wider than an opening.

    Where what is left is larger than an opening, or nothing is, the plane stays whole.
    """
    rng = np.random.default_rng(2)
    wall, rest = rng.random((2, 4000)) * [[12], [4]], rng.random((2, 3000)) * [[2.5 + wide], [2.5]]
    uv = np.hstack([wall, np.add(rest, [[12], [0]])]).T
    away = np.where(uv[:, 0] > 14.5, deep, 0.0) + rng.normal(0, 0.03, len(uv))
    ids = np.repeat([1, 2], [4000, 3000])
    parts = [_plane(k, uv, away, ids, None) for k in (0, 1)]
    made, numbers = _parted(parts, uv, away, ids, None, (4.0, 6.0), 0.02)
    parted = deep > 0 and wide < 4
    assert made[1].size[0] == pytest.approx(2.5 if parted else 2.5 + wide, abs=0.35)
    back = uv[:, 0] > 14.5
    assert ((numbers == 1) == ~back).mean() > (0.95 if parted else 0.0)
    assert (numbers == ids).all() == (not parted)


@pytest.mark.parametrize(
    ("noise", "deep", "parted"),
    [(0.03, 0.16, True), (0.03, 0.05, False), (0.01, 0.06, False)],
    ids=["slanting", "no deeper than noise", "little noise"],
)
def test_a_small_plane_that_slants_through_wall_and_pane_is_parted_in_noise(
    noise: float, deep: float, parted: bool
) -> None:
    """It is 1.2 m wide, half of it wall, and as a whole in the depth of the wall."""
    rng = np.random.default_rng(2)
    wall, rest = rng.random((2, 4000)) * [[12], [4]], rng.random((2, 800)) * [[1.2], [2.5]]
    uv = np.hstack([wall, np.add(rest, [[12], [0]])]).T
    away = np.where(uv[:, 0] > 12.7, deep, 0.0) + rng.normal(0, noise, len(uv))
    ids = np.repeat([1, 2], [4000, 800])
    parts = [_plane(k, uv, away, ids, None) for k in (0, 1)]
    _, numbers = _parted(parts, uv, away, ids, None, (4.0, 6.0), 0.02)
    back = uv[:, 0] > 12.7
    assert ((numbers == 1) == ~back).mean() > (0.97 if parted else 0.0)
    assert (numbers == ids).all() == (not parted)


def test_mullions_just_before_sparse_panels_of_their_own_plane_are_no_frames() -> None:
    """All of the front had been glass, and no wall was left to see it against."""
    rng = np.random.default_rng(1)
    side = np.arange(0, 9, 0.02)
    bars = [np.column_stack([np.full(len(side), x), side]) for x in np.arange(0, 6.1, 1.5)]
    bars += [np.column_stack([side[:300], np.full(300, y)]) for y in np.arange(0, 9.1, 3)]
    frame, panel = np.vstack(bars), rng.random((9000, 2)) * [6, 9]
    uv, away = np.vstack([frame, panel]), np.repeat([-0.015, 0.0], [len(frame), len(panel)])
    xyz = np.column_stack([uv[:, 0], away + rng.normal(0, 0.002, len(uv)), uv[:, 1]])
    assert found(PointCloud(xyz, {"plane_id": np.ones(len(xyz), np.int32)}, crs=LOCAL)).count == 0
