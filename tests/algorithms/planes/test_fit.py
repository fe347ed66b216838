"""planes.fit: planes with known answers, far from zero, among outliers, and where there is none."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.planes.fit import PlanesFit
from toolbox import run
from toolbox.data import PointCloud
from toolbox.declare import Direction
from toolbox.errors import DataError, ParameterError

UTM = CRS(32635)
FAR = np.array([543_210.5, 4_567_890.25, 812.0])


def plane_points(
    normal: tuple[float, float, float], n: int, noise: float, seed: int = 1
) -> NDArray[np.float64]:
    """Points on 40 x 30 m of a plane through FAR, with noise along the normal."""
    rng = np.random.default_rng(seed)
    unit = np.array(normal) / np.linalg.norm(normal)
    along = np.cross(unit, [0.3, 0.5, -0.8])
    along /= np.linalg.norm(along)
    places = rng.uniform(-1, 1, (n, 2)) * [20, 15]
    on = places @ np.array([along, np.cross(unit, along)])
    return FAR + on + rng.normal(0, noise, (n, 1)) * unit


def scattered(n: int, seed: int = 2) -> NDArray[np.float64]:
    return FAR + np.random.default_rng(seed).uniform(-20, 20, (n, 3))


def fitted(xyz: NDArray[np.float64], **parameters: Any) -> PlanesFit.Outputs:
    points = PointCloud(xyz, {"number": np.arange(len(xyz))}, crs=UTM, name="a.laz")
    return PlanesFit(points=points, **parameters).run()


def normal_of(out: PlanesFit.Outputs) -> NDArray[np.float64]:
    return np.array([out.normal_x, out.normal_y, out.normal_z])


def test_three_points_make_a_plane_through_them() -> None:
    out = fitted(FAR + np.array([[0, 0, 0], [4, 0, 0], [0, 4, 4.0]]))
    np.testing.assert_allclose(normal_of(out), [0, -math.sqrt(0.5), math.sqrt(0.5)], atol=1e-12)
    assert out.tilt == pytest.approx(45, abs=1e-9)
    assert out.azimuth == pytest.approx(180)  # it rises to the north
    assert len(out.inliers) == 3
    assert out.rms < 1e-9
    assert math.isnan(out.standard_error)
    assert out.offset == pytest.approx(normal_of(out) @ FAR, abs=1e-8)


def test_a_plane_among_outliers_is_as_good_as_without_them() -> None:
    """60 % of the points are anywhere; the normal is that of least squares on the others."""
    on = plane_points((0.2, -0.4, 0.9), 4000, 0.03)
    mean = on.mean(axis=0)
    known = np.linalg.svd(on - mean, full_matrices=False)[2][2]
    known *= np.sign(known[2])
    out = fitted(np.vstack([on, scattered(6000)]))
    assert np.degrees(np.arccos(normal_of(out) @ known)) < 0.02
    assert out.inlier_share == pytest.approx(0.4, abs=0.02)
    assert np.isin(np.arange(4000), out.inliers["number"]).all()
    clean = fitted(on)
    np.testing.assert_allclose(normal_of(clean), known, atol=1e-12)
    assert clean.rms == pytest.approx(0.03, rel=0.05)
    assert clean.standard_error == pytest.approx(clean.rms * math.sqrt(4000 / 3997))
    assert clean.offset == pytest.approx(math.fsum(known * mean), abs=2e-8)


def test_residuals_are_signed_and_stay_with_the_points() -> None:
    flat = np.array([[x, y, 0.0] for x in range(10) for y in range(10)]) + FAR
    xyz = np.vstack([flat, FAR + np.array([[5, 5, 0.1], [4, 4, -0.1], [5, 5, 7], [2, 2, -3]])])
    out = fitted(xyz)
    assert len(out.inliers) == 102
    assert out.inliers["PlaneDistance"][-2:] == pytest.approx([0.1, -0.1], abs=0.01)
    assert out.outliers["PlaneDistance"] == pytest.approx([7, -3], abs=0.01)
    assert out.inliers.descriptions["PlaneDistance"] == "from the plane, metre"
    assert np.sqrt(np.mean(out.inliers["PlaneDistance"].astype(float) ** 2)) == pytest.approx(
        out.rms, rel=1e-5
    )


def test_the_rectangle_lies_in_the_plane_around_its_points() -> None:
    out = fitted(plane_points((1.0, 0.5, 0.0), 3000, 0.01))
    feature = out.plane.frame.iloc[0]
    corners = np.array(feature.geometry.exterior.coords)
    away = corners @ normal_of(out) - out.offset
    assert out.height == out.plane.frame["centre_z"][0]
    assert np.abs(away).max() < 1e-6
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    assert sorted(sides)[::2] == pytest.approx([30, 40], abs=0.3)
    assert feature.points == 3000
    centre = np.array([feature.centre_x, feature.centre_y, feature.centre_z])
    assert centre @ normal_of(out) == pytest.approx(out.offset, abs=1e-7)
    assert out.plane.crs == UTM


def test_reference_chooses_among_planes() -> None:
    """A wall of 3000 points, and a floor of 1000."""
    xyz = np.vstack([plane_points((1, 0, 0), 3000, 0.01), plane_points((0, 0, 1), 1000, 0.01)])
    assert fitted(xyz).tilt == pytest.approx(90, abs=0.1)
    floor = fitted(xyz, reference=Direction(0.0, 0.0, 1.0))
    assert floor.tilt < 0.1
    assert floor.normal_z > 0
    down = fitted(xyz, reference=Direction(0.0, 0.0, -3.0))
    np.testing.assert_allclose(normal_of(down), -normal_of(floor), atol=1e-12)
    assert (down.tilt, down.azimuth) == (floor.tilt, floor.azimuth)


def test_no_plane_near_the_reference_is_said() -> None:
    wall = plane_points((1, 0, 0), 500, 0.0)
    with pytest.raises(DataError, match="points: 200 trials found no plane within 5 degrees"):
        fitted(wall, reference=Direction(0.0, 0.0, 1.0), max_trials=200)


def test_the_plane_stays_within_the_angle(caplog: pytest.LogCaptureFixture) -> None:
    """The best plane leans by 5.5 degrees; planes that are allowed are near it."""
    lean = math.tan(math.radians(5.5))
    xyz = plane_points((lean, 0, 1), 3000, 0.05)
    with caplog.at_level("WARNING", "toolbox"):
        out = fitted(xyz, reference=Direction(0.0, 0.0, 1.0), max_distance=1.0)
    assert 4 < out.tilt <= 5 + 1e-9
    assert "did not settle" in caplog.text
    assert fitted(
        xyz, reference=Direction(0.0, 0.0, 1.0), reference_angle=6.0
    ).tilt == pytest.approx(5.5, abs=0.1)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_points(count: int) -> None:
    with pytest.raises(DataError, match=f"a plane needs 3 points, there are {count}"):
        fitted(scattered(count))


def test_points_on_a_line_or_at_one_place_make_no_plane() -> None:
    line = FAR + np.linspace(0, 50, 100)[:, None] * np.array([0.3, 0.7, 0.2])
    for xyz in (line, np.tile(FAR, (9, 1))):
        with pytest.raises(DataError, match=r"all \d+ are on a line or at one place"):
            fitted(xyz)
    beside = np.vstack([line, line[:1] + np.array([0, 0, 1e-3])])
    assert len(fitted(beside).inliers) == 101


@pytest.mark.parametrize("text", ["0,1", "0,0,0", "up", "0,0,inf", "1,2,3,4"])
def test_bad_directions_are_refused(text: str) -> None:
    with pytest.raises(ParameterError, match="reference: must be a direction, got"):
        run("planes.fit", {"points": PointCloud(scattered(10), crs=UTM), "reference": text})


def test_directions_are_read_from_text_and_json() -> None:
    points = PointCloud(plane_points((0, 0, 1), 50, 0.0), crs=UTM)
    for reference in ("0,0,-2", [0, 0, -2.0]):
        assert run("planes.fit", {"points": points, "reference": reference})["normal_z"] < 0
    assert Direction.parse(str(Direction(-4.0, 3.0, 0.1))) == (-4, 3, 0.1)


def test_withheld_points_take_no_part() -> None:
    floor, wall = plane_points((0, 0, 1), 200, 0.0), plane_points((1, 0, 0), 900, 0.0)
    withheld = np.repeat([0, 1], [200, 900]).astype(np.uint8)
    points = PointCloud(np.vstack([floor, wall]), {"withheld": withheld}, crs=UTM)
    out = PlanesFit(points=points).run()
    assert (len(out.inliers), len(out.outliers)) == (200, 900)
    assert out.tilt < 1e-6


def test_trials_follow_from_the_share_and_end_at_the_limit() -> None:
    on = plane_points((0, 0, 1), 500, 0.0)
    assert fitted(on).trials == 32  # one batch is more than enough
    out = fitted(np.vstack([on, scattered(4500)]))
    needed = math.log(0.01) / math.log(1 - out.inlier_share**3)
    assert 0.95 * needed <= out.trials <= 1.05 * needed + 32
    assert fitted(np.vstack([on, scattered(4500)]), max_trials=100).trials == 100


@pytest.mark.slow
@given(st.permutations(range(60)), st.integers(0, 5))
def test_order_of_points_does_not_matter_and_seeds_are_kept(order: list[int], seed: int) -> None:
    xyz = np.vstack([plane_points((0.1, 0.2, 1), 40, 0.05), scattered(20)])
    one, other = (fitted(points, seed=seed) for points in (xyz, xyz[order]))
    assert normal_of(one).tolist() == normal_of(other).tolist()
    assert (one.offset, one.rms, one.trials) == (other.offset, other.rms, other.trials)


@pytest.mark.slow
def test_more_points_than_the_sample_in_any_order() -> None:
    xyz = np.vstack([plane_points((0.1, 0.2, 1), 150_000, 0.05), scattered(100_000)])
    order = np.random.default_rng(3).permutation(len(xyz))
    one, other = (fitted(points) for points in (xyz, xyz[order]))
    assert normal_of(one).tolist() == normal_of(other).tolist()
    assert one.rms == other.rms
    known = np.array([0.1, 0.2, 1]) / math.sqrt(1.05)
    assert np.degrees(np.arccos(normal_of(one) @ known)) < 0.01


def test_flat_target_at_large_coordinates(data: Callable[[str], Path]) -> None:
    """A scanned target, x and y in the millions: as least squares on points near the mean."""
    points = PointCloud.open(data("tls_plane_target") / "plane.laz").with_crs(UTM)
    out = PlanesFit(points=points, max_distance=0.05).run()
    near = points.xyz - points.xyz.mean(axis=0)
    values, vectors = np.linalg.eigh(near.T @ near / len(near))
    assert len(out.inliers) == len(points)
    assert abs(normal_of(out) @ vectors[:, 0]) == pytest.approx(1, abs=1e-12)
    assert out.rms == pytest.approx(math.sqrt(values[0]), rel=1e-4)


def test_ground_and_a_wall_of_a_street_corner(data: Callable[[str], Path]) -> None:
    """A terrestrial scan: the ground is largest, and a wall is found by its direction."""
    points = PointCloud.open(data("facade_street_corner") / "street_thinned.las").with_crs(UTM)
    ground = PlanesFit(points=points, max_distance=0.05).run()
    assert ground.tilt < 2
    assert len(ground.inliers) > 1600
    wall = PlanesFit(
        points=points, max_distance=0.05, reference=Direction(-4.0, 3.0, 0.0), reference_angle=10.0
    ).run()
    assert abs(wall.tilt - 90) < 2
    assert len(wall.inliers) > 200
