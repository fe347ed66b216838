"""compare.lines: shifted lines and circles, brute force, polynomials of the thesis, bad input."""

from __future__ import annotations

import math
import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.compare import _frechet as leash
from algorithms.compare._frechet import can_walk, frechet
from algorithms.compare.lines import CompareLines
from algorithms.shared.routes import IndexedRoute, Route, farthest, within
from toolbox import run
from toolbox.context import Context
from toolbox.data import Vector
from toolbox.declare import Extent
from toolbox.errors import Cancelled, DataError, ParameterError

UTM, FEET = CRS(32635), CRS(2263)
EAST, NORTH = 500_000.0, 4_330_000.0
Array = NDArray[np.float64]


def line(*xy: tuple[float, ...]) -> Any:
    return shapely.LineString([(EAST + p[0], NORTH + p[1], *p[2:]) for p in xy])


def without_place() -> Any:
    """A line to nowhere, as files may hold it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return line((0, 0), (math.nan, 0))


def layer(*shapes: Any, crs: CRS | None = UTM, name: str = "a.gpkg") -> Vector:
    return Vector(geopandas.GeoDataFrame(geometry=list(shapes), crs=crs), name=name)


def compare(own: Any, other: Any, **more: Any) -> Any:
    own, other = (s if isinstance(s, list) else [s] for s in (own, other))
    return CompareLines(lines=layer(*own), reference=layer(*other, name="b.gpkg"), **more).run()


def measures(out: Any) -> dict[str, float]:
    return dict(zip(out.table.frame["measure"], out.table.frame["value"], strict=True))


def route(*lines: Any) -> Route:
    """Of vertices of shape (n, 2)."""
    return Route.of([np.column_stack([xy, np.full(len(xy), np.nan)]) for xy in lines])


# Known answers --------------------------------------------------------------------------------


def test_line_beside_a_line() -> None:
    """100 m eastwards, two metres to the north: on the left."""
    out = compare(line((0, 2), (100, 2)), line((0, 0), (100, 0)))
    found = measures(out)
    for name in ("mean", "rms", "median", "p95", "max", "reverse_mean", "hausdorff", "frechet"):
        assert found[name] == pytest.approx(2), name
    assert (out.bias, out.correctness, out.completeness) == (pytest.approx(2), 0, 0)
    assert (found["abeam"], found["left"]) == pytest.approx((100, 100))
    frame = out.offsets.frame
    assert len(frame) == 101
    np.testing.assert_allclose(frame["chainage"], np.arange(101), atol=1e-6)
    np.testing.assert_allclose(frame["reference_chainage"], np.arange(101), atol=1e-6)
    other_way = compare(line((0, 2), (100, 2)), line((100, 0), (0, 0)))
    assert other_way.bias == pytest.approx(-2)
    assert other_way.frechet == pytest.approx(2)  # walked backwards
    assert "backwards" in " ".join(other_way.table.frame["meaning"])


def test_distances_are_weighted_by_length_not_by_vertices() -> None:
    """90 m at a distance of 1 with two vertices, and 10 m at 3 with a hundred."""
    near, many = [(0, 1), (90, 1)], [(x, 3) for x in np.linspace(90, 100, 100)]
    out = compare([line(*near), line(*many)], line((-50, 0), (150, 0)), spacing=50)
    assert out.mean == pytest.approx(1.2)
    assert out.rms == pytest.approx(math.sqrt(0.9 + 0.1 * 9))
    assert measures(out)["median"] == pytest.approx(1)
    assert out.p95 == pytest.approx(3)
    assert out.frechet is None
    assert measures(out)["reverse_max"] == pytest.approx(math.hypot(50, 3))


def test_crossing_line_by_hand() -> None:
    """From 10 m on the right to 10 m on the left: means of a straight change."""
    out = compare(line((0, -10), (100, 10)), line((-50, 0), (150, 0)), buffer=2.5)
    found = measures(out)
    assert out.mean == pytest.approx(5, rel=1e-3)
    assert out.rms == pytest.approx(10 / math.sqrt(3), rel=1e-3)
    assert out.p95 == pytest.approx(9.5, rel=1e-3)
    assert out.bias == pytest.approx(0, abs=1e-6)
    assert found["left"] == pytest.approx(50, abs=1)
    assert out.correctness == pytest.approx(25)
    assert found["rms_found"] == pytest.approx(2.5 / math.sqrt(3), rel=1e-2)


def test_concentric_circles() -> None:
    """Radius 53 around 50: three metres everywhere, from any place to begin."""
    outer, inner = (shapely.Point(EAST, NORTH).buffer(radius, quad_segs=720) for radius in (53, 50))
    turned = shapely.LinearRing(np.roll(outer.exterior.coords[:-1], 700, axis=0))
    out = compare(turned, inner)
    for value in (out.mean, out.rms, out.p95, out.hausdorff, out.frechet):
        assert value == pytest.approx(3, abs=1e-3)
    assert out.bias == pytest.approx(-3, abs=1e-3)  # the inside of a polygon is on the left
    assert measures(out)["length"] == pytest.approx(2 * math.pi * 53, rel=1e-5)


def test_circle_moved_by_a_known_vector() -> None:
    """Moved by 4 m: distance |sqrt(r2 + d2 + 2 r d cos a) - r| at the angle a."""
    moved, still = (shapely.Point(EAST + x, NORTH).buffer(50, quad_segs=720) for x in (4, 0))
    out = compare(moved, still, spacing=0.1)
    angle = np.linspace(0, 2 * math.pi, 100_001)
    away = np.abs(np.sqrt(2500 + 16 + 400 * np.cos(angle)) - 50)
    assert out.mean == pytest.approx(np.trapezoid(away, angle) / (2 * math.pi), abs=1e-3)
    assert out.rms == pytest.approx(math.sqrt((away[:-1] ** 2).mean()), abs=1e-3)
    assert out.p95 == pytest.approx(np.quantile(away, 0.95), abs=1e-3)
    assert (out.hausdorff, out.frechet) == pytest.approx((4, 4), abs=1e-3)


def test_completeness_and_correctness_by_hand() -> None:
    """60 of 80 m of line lie on the reference of 120 m, which has 60 m twice."""
    own = [line((0, 0), (30, 0)), line((0, 0.1), (30, 0.1)), line((0, 50), (20, 50))]
    out = compare(own, line((0, 0), (120, 0)), buffer=0.5, spacing=0.25)
    found = measures(out)
    assert out.correctness == pytest.approx(100 * 60 / 80)
    assert out.completeness == pytest.approx(100 * (30 + 0.5) / 120, rel=1e-3)
    assert found["quality"] == pytest.approx(100 * 60 / (80 + 89.5), rel=1e-3)
    assert found["redundancy"] == pytest.approx(100 * (60 - 30.5) / 60, rel=1e-3)


def test_side_at_a_sharp_corner() -> None:
    """Beyond the tip of a needle both segments are equally near; one has the wrong side."""
    needle = line((0, 0), (10, 0), (0, 1))  # turns left by almost a half turn
    out = compare(line((12, -5), (12, 5)), needle, spacing=0.1)
    frame = out.offsets.frame
    tip = frame[np.isclose(frame["reference_chainage"], 10)]
    assert len(tip) > 50
    assert (tip["offset"] < 0).all()  # right of both, wherever beyond the tip


def test_beyond_the_end_there_is_no_side() -> None:
    out = compare(line((0, 1), (200, 1)), line((0, 0), (100, 0)))
    assert measures(out)["abeam"] == pytest.approx(50, abs=0.5)
    assert out.bias == pytest.approx(1, abs=1e-3)
    assert out.offsets.frame["offset"].isna().sum() == pytest.approx(100, abs=1)
    beyond = compare(line((150, 1), (200, 1)), line((0, 0), (100, 0)))
    assert beyond.bias is None


def test_parts_that_go_on_are_one_line() -> None:
    parts = shapely.MultiLineString([line((0, 0), (50, 0)), line((50, 0), (100, 0))])
    out = compare(line((0, 1), (100, 1)), parts)
    assert out.frechet == pytest.approx(1)
    assert out.offsets.frame["reference_chainage"].max() == pytest.approx(100)


def test_parts_of_opposite_directions_keep_their_sides() -> None:
    parts = [line((0, 0), (50, 0)), line((100, 0), (50, 0))]
    frame = compare(line((0, 1), (100, 1)), parts).offsets.frame
    assert (frame["offset"][:50] > 0).all()
    assert (frame["offset"][51:] < 0).all()


def test_heights_at_the_nearest_places() -> None:
    """The reference rises by a tenth; the line is half a metre above it."""
    own, other = line((0, 2, 0.5), (100, 2, 10.5)), line((0, 0, 0), (100, 0, 10))
    out = compare(own, other, compare_heights=True)
    found = measures(out)
    assert out.mean == pytest.approx(2)  # in the plane
    assert (found["height_bias"], found["height_rms"]) == pytest.approx((0.5, 0.5))
    assert out.offsets.frame["height"].to_numpy() == pytest.approx(np.full(101, 0.5))
    assert out.offsets.frame.geometry[100].z == pytest.approx(10.5)
    assert "height_bias" not in measures(compare(own, other))
    with pytest.raises(DataError, match=r"reference: b.gpkg has no heights \(Z\)"):
        compare(own, line((0, 0), (9, 0)), compare_heights=True)


# Brute force ----------------------------------------------------------------------------------

corner = st.tuples(st.integers(0, 20), st.integers(0, 20))
corners = st.lists(corner, min_size=2, max_size=6).filter(
    lambda some: all(a != b for a, b in pairwise(some))
)


@settings(max_examples=80)
@given(corners, corners)
def test_hausdorff_is_that_of_dense_places(one: Any, other: Any) -> None:
    a, b = np.array(one, float), np.array(other, float)
    here, there = route(a), IndexedRoute(route(b))
    found = farthest(here, there.feet(a), there, 1e-6)
    dense = shapely.segmentize(shapely.LineString(a), 0.05)
    away = shapely.distance(shapely.points(shapely.get_coordinates(dense)), shapely.LineString(b))
    assert away.max() - 1e-6 <= found <= away.max() + 0.025 + 1e-6


@pytest.mark.slow
@settings(max_examples=40)
@given(corners, corners)
def test_leash_is_that_of_dense_places(one: Any, other: Any) -> None:
    """The discrete Fréchet distance of places 0.2 apart is longer by 0.2 at most."""
    a, b = np.array(one, float), np.array(other, float)
    found, back = frechet(a, b, 0.0, 1e-6, 1.0)
    brute = min(discrete(a, b), discrete(a, b[::-1]))
    if (a[0] == a[-1]).all() and (b[0] == b[-1]).all():
        assert found <= brute + 1e-5
    else:
        assert found - 1e-5 <= brute <= found + 0.2
        way = b[::-1] if back else b
        assert can_walk(a, np.ascontiguousarray(way), found + 1e-5)
        assert found < 1e-3 or not can_walk(a, np.ascontiguousarray(way), found - 1e-4)


def discrete(one: Array, other: Array) -> float:
    """Discrete Fréchet distance by dynamic programming over all pairs."""
    p, q = (
        shapely.get_coordinates(shapely.segmentize(shapely.LineString(v), 0.1))
        for v in (one, other)
    )
    away = np.hypot(*(p[:, None] - q[None]).transpose(2, 0, 1))
    row = np.maximum.accumulate(away[0])
    for distances in away[1:]:
        before = np.minimum(row, np.append(np.inf, row[:-1])).tolist()
        left, new = math.inf, []
        for came, distance in zip(before, distances.tolist(), strict=True):
            left = max(min(came, left), distance)
            new.append(left)
        row = np.array(new)
    return float(row[-1])


def test_leash_is_longer_than_the_largest_distance_where_a_line_turns_back() -> None:
    """There, 20 m back and on again, against straight on: who goes straight waits in the middle."""
    there = np.array([(0, 0), (60, 0), (40, 0), (100, 0)], float)
    straight = np.array([(0, 0), (100, 0)], float)
    assert frechet(there, straight, 0.0, 1e-6, 1.0)[0] == pytest.approx(10, abs=1e-4)
    assert frechet(straight, there, 0.0, 1e-6, 1.0)[0] == pytest.approx(10, abs=1e-4)
    out = compare(line(*map(tuple, there)), line(*map(tuple, straight)))
    assert out.hausdorff == pytest.approx(0, abs=1e-6)
    assert out.frechet == pytest.approx(10, abs=1e-3)


def test_blocks_of_the_diagram_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    one = np.cumsum(rng.normal(1, 1, (60, 2)), axis=0)
    other = one + rng.normal(0, 0.8, one.shape)
    whole = frechet(one, other, 0.0, 1e-6, 1.0)
    monkeypatch.setattr(leash, "BLOCK", 60)
    assert frechet(one, other, 0.0, 1e-6, 1.0) == whole


# Polynomials ----------------------------------------------------------------------------------


def parabola(p1: float, shift: float = 0.0) -> Any:
    x = np.linspace(-300, 300, 61)
    return line(*zip(x, p1 * x**2 - 0.3 * x + 7 + shift, strict=True))


def test_polynomials_are_recovered_with_all_their_digits() -> None:
    """Coefficients of the size of those in the thesis, at coordinates of that size."""
    out = compare(parabola(0.00143, 2), parabola(0.00143), polynomial=2)
    rows = out.curves.frame.set_index("measure")
    assert rows.loc["c2", "lines"] == pytest.approx(0.00143, rel=1e-9)
    assert rows.loc["c1", "reference"] == pytest.approx(-0.3, rel=1e-6)
    assert rows.loc["p1", "lines"] == pytest.approx(0.00143, rel=1e-9)
    assert rows.loc["p2", "lines"] == pytest.approx(-0.3 - 2 * 0.00143 * EAST, rel=1e-9)
    p3 = 0.00143 * EAST**2 + 0.3 * EAST + 7 + NORTH
    assert rows.loc["p3", "reference"] == pytest.approx(p3, rel=1e-9)
    assert rows.loc["r2", "lines"] == pytest.approx(1, abs=1e-9)
    assert rows.loc["common", "lines"] == pytest.approx(600)
    for name in ("mean_dy", "rms_dy", "max_dy"):
        assert rows.loc[name, "lines"] == pytest.approx(2, abs=1e-6)
    assert rows.loc["hausdorff", "lines"] == pytest.approx(2, abs=1e-3)
    x = EAST + 250.0
    y = sum(rows.loc[f"p{3 - k}", "lines"] * x**k for k in range(3))
    assert y == pytest.approx(NORTH + 0.00143 * 250**2 - 75 + 9, abs=1e-6)


def test_equal_fit_is_no_agreement() -> None:
    """R2 is 1 for both, and the curves are as far apart as 0.0001 * x2 has it."""
    out = compare(parabola(0.0015), parabola(0.0014), polynomial=2)
    rows = out.curves.frame.set_index("measure")
    assert rows.loc["r2"][["lines", "reference"]].tolist() == pytest.approx([1, 1], abs=1e-9)
    assert rows.loc["max_dy", "lines"] == pytest.approx(9, rel=1e-6)
    assert rows.loc["mean_dy", "lines"] == pytest.approx(3, rel=1e-6)
    assert rows.loc["rms_dy", "lines"] == pytest.approx(9 / math.sqrt(5), rel=1e-6)


def test_polynomials_of_nothing_in_common_and_of_too_few_points() -> None:
    out = compare(line((0, 0), (5, 1), (9, 0)), line((50, 0), (55, 1), (59, 0)), polynomial=2)
    rows = out.curves.frame.set_index("measure")
    assert rows.loc["common", "lines"] == 0
    assert "rms_dy" not in rows.index
    with pytest.raises(DataError, match="degree 2 needs vertices at 3 different x, there are 2"):
        compare(line((0, 0), (5, 1)), line((0, 0), (5, 1)), polynomial=2)


# Units and bad input --------------------------------------------------------------------------


def test_feet_give_the_answer_of_metres() -> None:
    foot = 1200 / 3937
    rng = np.random.default_rng(1)
    x = np.linspace(0, 200, 40)
    own, other = (line(*zip(x, rng.normal(0, 2, 40), strict=True)) for _ in range(2))
    metres = compare(own, other, polynomial=2)
    scaled = [layer(shapely.transform(s, lambda xy: xy / foot), crs=FEET) for s in (own, other)]
    feet = CompareLines(lines=scaled[0], reference=scaled[1], polynomial=2).run()
    for name, field in CompareLines.spec.outputs.items():
        if field.kind.word == "number":
            assert getattr(feet, name) == pytest.approx(getattr(metres, name), abs=2e-4), name
    here, there = (out.table.frame["value"].to_numpy(float) for out in (feet, metres))
    np.testing.assert_allclose(here, there, atol=2e-4)
    np.testing.assert_allclose(
        feet.offsets.frame["distance"] * foot, metres.offsets.frame["distance"], atol=1e-6
    )
    curves = [out.curves.frame.set_index("measure")["lines"] for out in (feet, metres)]
    np.testing.assert_allclose(curves[0][["c2", "rmse"]], curves[1][["c2", "rmse"]], rtol=1e-6)


@pytest.mark.parametrize(
    ("shapes", "text"),
    [
        ([], "reference: b.gpkg has no lines"),
        ([shapely.Point(0, 0)], "reference: must be lines or polygons, b.gpkg holds a Point"),
        ([line((0, 0), (1, 1)), shapely.Point(0, 0)], "b.gpkg holds a Point (feature 2)"),
        ([line((0, 0), (1, 1)), None], "reference: b.gpkg has no geometry in feature 2"),
        ([line((0, 0), (0, 0))], "reference: b.gpkg is not valid in feature 1: Too few points"),
        ([without_place()], "has coordinates that are no numbers (feature 1)"),
    ],
)
def test_what_is_no_line_is_named(shapes: list[Any], text: str) -> None:
    with pytest.raises(DataError) as error:
        compare(line((0, 0), (9, 0)), shapes)
    assert text in str(error.value)


def test_crs_and_step() -> None:
    one = layer(line((0, 0), (9, 0)))
    with pytest.raises(DataError, match="reproject it to EPSG:32635"):
        CompareLines(lines=one, reference=layer(line((0, 0), (9, 0)), crs=CRS(32636)))
    degrees = layer(shapely.LineString([(29, 39), (30, 40)]), crs=CRS(4326))
    with pytest.raises(DataError, match="is in degrees"):
        CompareLines(lines=degrees, reference=degrees)
    with pytest.raises(DataError, match="spacing: makes 90,000,000 pieces"):
        CompareLines(lines=one, reference=one, spacing=1e-7).run()
    with pytest.raises(ParameterError, match="polynomial: must be >= 1"):
        CompareLines(lines=one, reference=one, polynomial=0)


def test_open_against_closed_has_no_leash() -> None:
    ring = shapely.box(EAST, NORTH, EAST + 9, NORTH + 9)
    out = compare(ring, line((0, 0), (9, 0)))
    assert out.frechet is None
    assert "not defined" in " ".join(out.table.frame["meaning"])


def test_cancelling() -> None:
    one = layer(line((0, 0), (9, 0)))
    with pytest.raises(Cancelled):
        CompareLines(lines=one, reference=one).run(Context(stop=lambda: True))


def test_files_and_picture(tmp_path: Path) -> None:
    layer(line((0, 1), (60, 3))).save(tmp_path / "a.gpkg")
    layer(line((0, 0), (40, 0))).save(tmp_path / "b.geojson")
    run(
        "compare.lines",
        {
            "lines": tmp_path / "a.gpkg",
            "reference": tmp_path / "b.geojson",
            "offsets": tmp_path / "o.gpkg",
            "table": tmp_path / "t.csv",
        },
        picture=tmp_path / "o.png",
    )
    frame = Vector.open(tmp_path / "o.gpkg").frame
    assert frame["offset"].isna().any()
    assert frame["distance"].min() == pytest.approx(1, abs=0.1)
    assert (tmp_path / "o.png").exists()


# A reach of the lines --------------------------------------------------------------------------


def reach(west: float, south: float, east: float, north: float) -> Extent:
    return Extent(EAST + west, NORTH + south, EAST + east, NORTH + north)


def test_only_the_reach_within_an_extent_is_compared() -> None:
    own = line((0, 1), (50, 1), (50, 7), (100, 7))
    other = line((0, 0), (50, 0), (50, 0.5), (100, 0.5))
    whole = compare(own, other)
    part = compare(own, other, extent=reach(10, -9, 40, 9))
    assert whole.hausdorff > 6
    assert part.mean == pytest.approx(1)
    assert part.bias == pytest.approx(1)
    assert measures(part)["length"] == pytest.approx(30)
    assert part.offsets.frame["chainage"].max() == pytest.approx(30)


def test_coverage_and_extent_are_both_kept_to() -> None:
    own, other = line((0, 1), (100, 1)), line((0, 0), (100, 0))
    box = shapely.box(EAST + 20, NORTH - 9, EAST + 60, NORTH + 9)
    hole = shapely.box(EAST + 30, NORTH - 9, EAST + 35, NORTH + 9)
    how: dict[str, Any] = {"coverage": layer(shapely.difference(box, hole))}
    out = compare(own, other, **how)
    assert measures(out)["length"] == pytest.approx(35)
    assert out.frechet is None  # two lines each
    out = compare(own, other, **how, extent=reach(0, -9, 25, 9))
    assert measures(out)["length"] == pytest.approx(5)


@pytest.mark.parametrize("seed", range(5))
def test_a_cut_line_runs_as_before(seed: int) -> None:
    """Or left and right would change sides."""
    rng = np.random.default_rng(seed)
    vertices = np.column_stack([rng.uniform(0, 100, (12, 2)), np.arange(12.0)])
    region = shapely.Point(50, 50).buffer(30)
    parts = within([vertices], region)
    whole = shapely.LineString(vertices[:, :2])
    length = sum(shapely.LineString(part[:, :2]).length for part in parts)
    assert length == pytest.approx(whole.intersection(region).length)
    for part in parts:
        assert (np.diff(part[:, 2]) > -1e-9).all()  # heights rise along the line


def test_a_ring_is_cut_to_one_reach_of_its_outline() -> None:
    """The edge of the extent is no part of it, and the ring may begin within."""
    ring = shapely.Point(EAST + 50, NORTH).buffer(40, quad_segs=64)
    out = compare(ring, ring.buffer(1, quad_segs=64), extent=reach(60, -50, 95, 50))
    half = np.arccos(10 / 40) * 40
    assert measures(out)["length"] == pytest.approx(2 * half, rel=1e-3)
    assert out.frechet is not None
    assert out.bias == pytest.approx(1, abs=0.05)  # the inside is on the left


def test_a_reach_without_lines_is_told() -> None:
    own, other = line((0, 1), (100, 1)), line((0, 0), (40, 0))
    with pytest.raises(DataError, match="extent: nothing of the reference lies within"):
        compare(own, other, extent=reach(50, -9, 90, 9))
    with pytest.raises(DataError, match=r"coverage: .*has no polygons"):
        compare(own, other, coverage=layer())


def test_polynomials_of_closed_lines_are_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    ring = shapely.Point(EAST, NORTH).buffer(40)
    compare(ring, line((-40, 0), (0, 40), (40, 0)), polynomial=2)
    assert "polynomial: the lines are closed" in caplog.text
    caplog.clear()
    out = compare(ring, ring, polynomial=2, extent=reach(-60, 5, 60, 60))
    assert "closed" not in caplog.text
    assert out.curves is not None
