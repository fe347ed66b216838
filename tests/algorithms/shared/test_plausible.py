"""Warnings of ground that says nothing, and none where it is ground."""

from __future__ import annotations

import importlib
import logging
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS
from scenes.layers import cloud
from scenes.towns import plane, town

from algorithms.points.info import PointsInfo
from algorithms.shared import plausible
from algorithms.shared.kernels.squares import box, ends, tops_between
from algorithms.shared.plausible import (
    height_problem,
    hidden_share,
    is_upright,
    lifted_strip,
    second_layer,
    spacing_and_rise,
    sparse_ground,
    squares_of,
    tell_of_ground,
)
from toolbox import catalog
from toolbox.data.crs import local_crs

Floats = NDArray[np.float64]
FILTERS = ["ground.classify", "ground.csf", "ground.ptd", "ground.robust_interpolation"]


def field(side: float = 40.0) -> Floats:
    """A field with 16 points/m2."""
    return plane(side, 0.25, jitter=0.2)


def forest(share: float) -> tuple[Floats, NDArray[np.bool_]]:
    """The field, with this share of its points on the ground and the rest in crowns 6 m deep."""
    rng = np.random.default_rng(3)
    xyz = field()
    ground = rng.random(len(xyz)) < share
    xyz[~ground, 2] += rng.uniform(10, 16, np.count_nonzero(~ground))
    return xyz, ground


def with_low_noise(share: float) -> tuple[Floats, NDArray[np.bool_]]:
    """The field with some points 1.5 to 6 m below it; which these are."""
    rng = np.random.default_rng(4)
    xyz = field()
    low = rng.random(len(xyz)) < share
    xyz[low, 2] -= rng.uniform(1.5, 6, np.count_nonzero(low))
    return xyz, low


def warned(caplog: pytest.LogCaptureFixture, id: str, xyz: Any) -> str:
    """The warnings of a tool."""
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        catalog.load(id).make(points=cloud(xyz)).run()
    return caplog.text


@pytest.mark.parametrize("id", FILTERS)
def test_filters_tell_of_few_points(id: str, caplog: pytest.LogCaptureFixture) -> None:
    lines = [[x, y, 1.0] for x in range(3) for y in range(3)]
    assert "so few points (1 that may be ground)" in warned(caplog, id, lines[:1])
    assert "so few points (8 that" in warned(caplog, id, lines[:8])
    assert warned(caplog, id, lines) == ""


@pytest.mark.parametrize("id", FILTERS)
def test_filters_tell_of_heights_in_another_unit(id: str, caplog: pytest.LogCaptureFixture) -> None:
    xyz = plane(20.0)
    assert warned(caplog, id, xyz) == ""
    assert "above 30080 m, where there is no land" in warned(caplog, id, xyz * (1, 1, 100))


def test_heights_that_no_land_has() -> None:
    xyz = plane(20.0)
    for shift, wrong in ((-790, False), (-820, True), (8_650, False), (8_750, True)):
        problem = height_problem(xyz + np.array([0, 0, shift]), 1.0)
        assert (problem is not None) == wrong
        feet = height_problem((xyz + np.array([0, 0, shift])) / 0.3048, 1 / 0.3048)
        assert (feet is not None) == wrong
    assert height_problem(xyz[:0], 1.0) is None


@pytest.mark.parametrize(("tilt", "wrong"), [(4.9, False), (5.3, True)])
def test_slopes_that_no_terrain_has(tilt: float, wrong: bool) -> None:
    xyz = plane(60.0, tilt=tilt)
    for unit in (1.0, 0.3048):
        problem = height_problem(xyz / unit, 1 / unit)
        assert (problem is not None and "which no terrain has" in problem) == wrong


@pytest.mark.parametrize(("height", "wrong"), [(5.0, True), (1.4, False)])
def test_a_flat_town_in_centimetres(height: float, wrong: bool) -> None:
    """Its ground has no slopes that could be told from steep ones, but its walls are too high."""
    xyz, _ = town(plane(60.0, tilt=0), {(9, 21, 9, 25): height, (30, 44, 30, 52): height})
    assert height_problem(xyz, 1.0) is None
    xyz[:, 2] -= 290
    problem = height_problem(xyz * (1, 1, 100), 1.0)
    assert (problem is not None and "the points spread over 5" in problem) == wrong


def test_woods_with_few_points_are_no_cliffs() -> None:
    xyz, _ = forest(0.03)
    assert height_problem(xyz[::40] * (1, 1, 3), 1.0) is None


def test_information_tells_of_heights_in_another_unit_on_a_map_alone() -> None:
    """A scan in a local CRS may be of a wall."""
    xyz = plane(20.0) * (1, 1, 100)
    for crs, wrong in ((CRS(32635), True), (local_crs("local"), False), (None, False)):
        table = PointsInfo(points=cloud(xyz, crs=crs)).run().table
        assert ("where there is no land" in " ".join(map(str, table.frame["value"]))) == wrong


@pytest.mark.parametrize("id", FILTERS)
def test_filters_tell_that_a_surface_hides_their_ground(
    id: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here each filter takes noise for ground; the warning must not depend on which does."""
    xyz, low = with_low_noise(0.01)
    module = importlib.import_module(f"algorithms.{id}")
    name = "verdict" if id == "ground.classify" else "ground_mask"
    found = (low, np.ones(len(xyz))) if id == "ground.classify" else low
    monkeypatch.setattr(module, name, lambda *_, **__: found)
    assert "the ground that was found is probably noise below the ground" in warned(caplog, id, xyz)


def test_the_share_of_hidden_ground() -> None:
    xyz, low = with_low_noise(0.01)
    squares = squares_of(xyz, 1.0)
    assert hidden_share(xyz, low, squares, 1.0) > 0.95
    feet, metre = xyz / 0.3048, 1 / 0.3048
    assert hidden_share(feet, low, squares_of(feet, metre), metre) > 0.95
    assert hidden_share(xyz, ~low, squares, 1.0) == 0
    assert hidden_share(xyz, low & False, squares, 1.0) == 0


@pytest.mark.parametrize("share", [0.02, 0.05, 0.2])
def test_crowns_hide_no_ground(share: float) -> None:
    xyz, ground = forest(share)
    assert hidden_share(xyz, ground, squares_of(xyz, 1.0), 1.0) < 0.1


def test_roofs_hide_no_ground() -> None:
    xyz = field()
    roof = np.hypot(*(xyz[:, :2] - xyz[:, :2].mean(axis=0)).T) < 15
    xyz[roof, 2] += 8
    assert hidden_share(xyz, ~roof, squares_of(xyz, 1.0), 1.0) < 0.2


def two_surveys(apart: float, share: float = 0.5, tilt: float = 0.3) -> Floats:
    """A slope with houses and woods, of which a share of the points is so much higher."""
    rng = np.random.default_rng(5)
    xyz = plane(60.0, 0.25, jitter=0.2, tilt=tilt)
    east = xyz[:, 0] - xyz[:, 0].min()
    xyz[(east < 20) & (rng.random(len(xyz)) < 0.2), 2] += 9  # roofs, with ground beside them
    woods = (east > 45) & (rng.random(len(xyz)) < 0.8)
    xyz[woods, 2] += rng.uniform(4, 16, np.count_nonzero(woods))
    xyz[rng.random(len(xyz)) < share, 2] += apart
    return xyz


@pytest.mark.parametrize("id", FILTERS)
def test_filters_tell_of_two_surveys_whose_heights_do_not_fit(
    id: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert "a second surface 40.0 m above it" in warned(caplog, id, two_surveys(40.0, tilt=0.1))
    assert "second surface" not in warned(caplog, id, two_surveys(0.0, tilt=0.1))


@pytest.mark.parametrize(("apart", "share"), [(1.5, 0.5), (12.0, 0.5), (40.0, 0.6), (40.0, 0.35)])
def test_a_second_layer_is_found_on_slopes_and_in_feet(apart: float, share: float) -> None:
    xyz = two_surveys(apart, share)
    ground = xyz[:, 2] <= two_surveys(0.0, 0.0)[:, 2]
    ground &= np.isclose(xyz[:, 2], plane(60.0, 0.25, jitter=0.2, tilt=0.3)[:, 2])
    for unit in (1.0, 0.3048):
        points, metre = xyz / unit, 1 / unit
        found, height = second_layer(points, ground, squares_of(points, metre), metre)
        assert found > 0.45
        assert height == pytest.approx(apart, abs=0.1)


@pytest.mark.parametrize("share", [0.02, 0.05, 0.2, 0.5])
def test_crowns_are_no_second_layer(share: float) -> None:
    xyz, ground = forest(share)
    assert second_layer(xyz, ground, squares_of(xyz, 1.0), 1.0)[0] < 0.2


def test_squares_with_a_point_or_two_of_ground_do_not_count() -> None:
    """As in thick woods, where too few points are left to make a second surface."""
    one = field(40.0)
    sparse = plane(80.0, 4.0, jitter=0.2) + np.array([400.0, 0, 0])
    xyz = np.vstack([one, one + np.array([0, 0, 12.0]), sparse])
    ground = np.ones(len(xyz), bool)
    ground[len(one) : 2 * len(one)] = False
    assert second_layer(xyz, ground, squares_of(xyz, 1.0), 1.0)[0] > 0.9


@pytest.mark.parametrize("apart", [0.3, 1.2, 12.0, 250.0])
@pytest.mark.parametrize("share", [0.02, 0.1, 0.2, 0.35, 0.5])
@pytest.mark.parametrize("tilt", [0.0, 0.3, 2.0])
def test_a_second_layer_is_searched_for_only_where_there_may_be_one(
    apart: float, share: float, tilt: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    xyz = two_surveys(apart, share, tilt)[::7]
    squares = squares_of(xyz, 1.0)
    lowest, _ = ends(squares, xyz, int(squares.max()) + 1)
    ground = xyz[:, 2] < lowest[squares] + 1.0
    bounds: list[float] = []
    bound = plausible._most_layered

    def noted(*arguments: Any) -> float:
        bounds.append(bound(*arguments))
        return bounds[0]

    monkeypatch.setattr(plausible, "_most_layered", noted)
    found = second_layer(xyz, ground, squares, 1.0)
    monkeypatch.setattr(plausible, "_most_layered", lambda *_: 1.0)
    searched = second_layer(xyz, ground, squares, 1.0)
    assert bounds[0] >= searched[0]
    assert found == (searched if bounds[0] > plausible.TWICE else (0.0, 0.0))


def test_points_in_one_vertical_plane_do_not_tell_what_is_ground(
    caplog: pytest.LogCaptureFixture,
) -> None:
    for xyz in (np.full((50, 3), 7.0), [[x, 5.0, z] for x in range(9) for z in range(9)]):
        assert "one line seen from above" in warned(caplog, "ground.classify", xyz)


@pytest.mark.parametrize("metre", [1.0, 1 / 0.3048])
def test_a_wall_that_stands_askew_is_told_and_a_strip_of_land_is_not(metre: float) -> None:
    along, height = (a.ravel() for a in np.meshgrid(np.arange(0, 20, 0.1), np.arange(0, 9, 0.1)))
    for across, told in ((0.18, True), (0.22, False)):
        aside = np.random.default_rng(3).choice([-across / 2, across / 2], len(along))
        x, y = 0.8 * along - 0.6 * aside, 0.6 * along + 0.8 * aside
        xyz = np.column_stack([x + 5e5, y + 4.4e6, height])
        assert is_upright(xyz * metre, metre) == told


def test_ground_of_which_a_part_is_hidden_is_told_from_a_fifth_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    xyz, low = with_low_noise(0.01)
    middle = xyz[:, 0].min() + 20
    for west, told in ((-6, True), (-14, False)):
        caplog.clear()
        ground = np.where(xyz[:, 0] < middle + west, low, ~low)
        tell_of_ground(xyz, ground, np.zeros(len(xyz), np.uint16), 1.0)
        assert ("probably noise" in caplog.text) == told


def test_stray_points_do_not_stretch_memory() -> None:
    xyz = np.vstack([plane(60.0, tilt=5.3), [[9e9, 9e9, 0.0]]])
    assert "which no terrain has" in str(height_problem(xyz, 1.0))


def test_points_that_are_not_kept_make_no_second_survey() -> None:
    """As if they were not there, whatever their height."""
    xyz = two_surveys(12.0)
    kept = np.random.default_rng(7).random(len(xyz)) < 0.7
    noise = np.where(kept[:, None], xyz, xyz - [0, 0, 300.0])
    told = plausible.two_surveys(noise, 1.0, kept)
    assert told is not None
    assert told == plausible.two_surveys(xyz[kept], 1.0)
    assert plausible.two_surveys(xyz, 1.0, np.zeros(len(xyz), bool)) is None


@pytest.mark.parametrize("metre", [1.0, 1 / 0.3048])
@pytest.mark.parametrize(("slope", "told"), [(0.09, False), (0.12, True)])
def test_ground_that_rises_by_more_than_half_a_metre_from_point_to_point_is_told(
    slope: float, told: bool, metre: float
) -> None:
    """4 m apart, beside houses that are not looked at; stray points do not make it sparser."""
    xyz = plane(200.0, 4.0, jitter=1.0)
    xyz[:, 2] = slope * (xyz[:, 0] - xyz[0, 0])
    ground = np.random.default_rng(2).random(len(xyz)) < 0.8
    xyz[~ground, 2] += 9.0
    problem = sparse_ground(xyz * metre, ground, metre)
    assert (problem is not None) == told
    far = np.vstack([xyz, xyz[0] + np.array([4000.0, 3000.0, 0.0])])
    assert (sparse_ground(far * metre, np.append(ground, True), metre) is not None) == told


def test_how_sparse_ground_is_does_not_depend_on_how_cells_are_numbered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As a raster, or one by one where a stray point makes it too large."""
    xyz = plane(200.0, 4.0, jitter=1.0, tilt=0.1)
    xyz = np.vstack([xyz, xyz[0] + np.array([4000.0, 3000.0, 0.0])])
    ground = np.random.default_rng(6).random(len(xyz)) < 0.8
    as_raster = spacing_and_rise(xyz, ground, 1.0)
    monkeypatch.setattr(plausible, "FEW_CELLS", 0)
    assert not tops_between(box(xyz), ground, xyz, 2 * as_raster[0], 2 * len(xyz)).size
    assert spacing_and_rise(xyz, ground, 1.0) == as_raster


def test_only_ground_counts_where_points_are_sparse() -> None:
    xyz = plane(200.0, 4.0, jitter=1.0)
    xyz[:, 2] += np.random.default_rng(5).uniform(0, 9, len(xyz))
    assert sparse_ground(xyz, np.zeros(len(xyz), bool), 1.0) is None


@pytest.mark.parametrize("id", FILTERS)
def test_filters_tell_of_sparse_ground(id: str, caplog: pytest.LogCaptureFixture) -> None:
    """A hill with a point in 64 m2."""
    xyz = plane(300.0, 8.0, jitter=2.0)
    xyz[:, 2] += 15 * np.sin(xyz[:, 0] / 40) * np.sin(xyz[:, 1] / 40)
    assert "m apart, and rise" in warned(caplog, id, xyz)
    assert "m apart, and rise" not in warned(caplog, id, plane(300.0, 8.0, jitter=2.0))


@pytest.mark.parametrize("id", FILTERS)
def test_filters_tell_of_a_flight_line_that_lies_higher(
    id: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Ground is that of the lower line; up to 0.9 m nothing told of it."""
    xyz, high = field(), np.random.default_rng(2).random(160 * 160) < 0.5
    xyz[high, 2] += 0.8
    lines = {"point_source_id": np.where(high, 12, 11).astype(np.uint16)}
    for told, made in ((True, xyz), (False, field())):
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            catalog.load(id).make(points=cloud(made).with_attributes(lines)).run()
        assert ("points of flight line 12 lie some 0.8 m above" in caplog.text) == told


def lines(lost: float, squares: int, points: int, lift: Any = 0.5) -> tuple[Any, ...]:
    """Points of two lines in squares 4 m apart, of which the second has ground in some."""
    square = np.repeat(np.arange(squares), 2 * points)
    strip = np.tile(np.repeat([3, 9], points), squares).astype(np.uint16)
    ground = (strip == 3) | (square >= lost)
    height = np.where(ground, 0.0, np.broadcast_to(lift, squares)[square])
    return np.column_stack([4.0 * square, 0 * square, height]), ground, square, strip, 1.0


@pytest.mark.parametrize(
    ("lost", "squares", "points", "told"),
    [
        (55, 100, 4, True),
        (45, 100, 4, False),  # as where there was a crop in some fields
        (26, 28, 4, False),  # too few to tell
        (90, 100, 2, False),  # of so few points none is ground by chance, as in a wood
    ],
)
def test_a_line_is_higher_if_it_has_no_ground_in_most_squares(
    lost: int, squares: int, points: int, told: bool
) -> None:
    found = lifted_strip(*lines(lost, squares, points))
    assert (found is not None) == told
    if told:
        assert "points of flight line 9 lie some 0.5 m above" in str(found)


@pytest.mark.parametrize(
    ("least", "most", "told"),
    [
        (0.4, 0.6, True),
        (0.2, 1.0, False),  # 0.4 m between the quartiles, two thirds of the median: low plants
        (4.0, 9.0, False),  # crowns, or a wall that is seen from above its foot
        (1.6, 1.7, False),  # two surfaces, which are told apart from this
    ],
)
def test_a_line_is_higher_if_it_is_so_by_one_height(least: float, most: float, told: bool) -> None:
    lift = np.random.default_rng(1).uniform(least, most, 100)
    assert (lifted_strip(*lines(90, 100, 4, lift)) is not None) == told


def test_all_higher_lines_are_named() -> None:
    xyz, ground, square, strip, metre = lines(100, 100, 8)
    strip[strip == 9] += (np.arange(800) % 2).astype(np.uint16)
    assert "flight line 9, 10 lie some 0.5 m" in str(
        lifted_strip(xyz, ground, square, strip, metre)
    )


@pytest.mark.parametrize("columns", [201, 334])
def test_of_a_large_survey_squares_all_over_tell_of_a_higher_line(
    columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One square in a thousand had been one column for some widths of the survey."""
    monkeypatch.setattr(plausible, "LOOKED_AT_POINTS", 8 * columns)
    xyz, ground, square, strip, metre = lines(1000 * columns, 1000 * columns, 4)
    apart = (square % columns < 20) | (square % columns > 40)
    here = ~apart | (strip == 3)  # the higher line is in some columns
    assert lifted_strip(xyz[here], ground[here], square[here], strip[here], metre) is not None
