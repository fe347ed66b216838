"""How far points may be from planes: learned from the noise of the ground, the same in tiles."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS
from scenes.layers import cloud

from algorithms.classify import _evidence, _flatness
from algorithms.classify._evidence import PointFeatures
from algorithms.classify._flatness import by_noise
from algorithms.classify.buildings import ClassifyBuildings
from algorithms.samples.scene import SamplesScene
from toolbox.data import PointCloud

Floats = NDArray[np.float64]
FOOT = 1200 / 3937  # metres, US survey


def strip(length: float = 800.0, density: float = 0.5) -> tuple[Floats, Floats]:
    """Places in a strip of 60 m, and their scatter, which grows from 0.02 to 0.16 m."""
    rng = np.random.default_rng(3)
    west, south = 431_207, 5_000_013
    x = rng.uniform(west, west + length, int(length * 60 * density))
    xy = np.column_stack([x, rng.uniform(south, south + 60, len(x))])
    east = (x - west) / length
    return xy, (0.02 + 0.14 * east) * rng.uniform(0.9, 1.1, len(xy))


def test_it_is_the_least_with_the_lower_quartile_of_the_ground_in_squares() -> None:
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 50, (4000, 2))
    scatter = np.repeat([0.083, 0.3, np.nan, 0.01], 1000)
    ground = np.repeat([True, True, True, False], 1000)
    found = by_noise(xy, scatter, ground, 0.06, 1.0)
    assert found.shape == (4000,)
    noise = 0.080 + 0.005 / 2  # the middle of its class
    assert found == pytest.approx(np.sqrt(0.06**2 + noise**2 - 0.03**2), abs=1e-9)


@pytest.mark.parametrize(
    ("scatter", "least", "expected"),
    [
        (0.024, 0.06, 0.06),
        (0.5, 0.06, _flatness.MOST),
        (0.05, 0.3, 0.3),
        (np.nan, 0.06, 0.06),
    ],
)
def test_it_has_limits(scatter: float, least: float, expected: float) -> None:
    xy = np.random.default_rng(0).uniform(0, 50, (1000, 2))
    found = by_noise(xy, np.full(1000, scatter), np.ones(1000, bool), least, 1.0)
    assert (found == expected).all()


def test_ground_of_few_points_tells_nothing() -> None:
    xy = np.random.default_rng(0).uniform(0, 50, (1000, 2))
    for enough, expected in ((49, 0.06), (50, 0.114)):
        ground = np.arange(1000) < enough
        found = by_noise(xy, np.full(1000, 0.1), ground, 0.06, 1.0)
        assert found == pytest.approx(expected, abs=0.006)


def test_parts_with_what_is_in_reach_get_what_the_whole_gets() -> None:
    xy, scatter = strip()
    ground = np.random.default_rng(1).random(len(xy)) < 0.7
    whole = by_noise(xy, scatter, ground, 0.06, 1.0)
    assert whole.min() == 0.06
    assert whole.max() > 0.14
    core = np.abs(xy[:, 0] - 431_600) < 40
    near = np.abs(xy[:, 0] - 431_600) < 40 + _flatness.REACH
    part = by_noise(xy[near], scatter[near], ground[near], 0.06, 1.0)
    assert (part[core[near]] == whole[core]).all()
    tight = np.abs(xy[:, 0] - 431_600) < 40 + _flatness.REACH / 4
    assert (by_noise(xy[tight], scatter[tight], ground[tight], 0.06, 1.0) != whole[tight]).any()


def test_order_and_unit_do_not_matter() -> None:
    xy, scatter = strip()
    ground = np.ones(len(xy), bool)
    whole = by_noise(xy, scatter, ground, 0.06, 1.0)
    order = np.random.default_rng(2).permutation(len(xy))
    assert (by_noise(xy[order], scatter[order], ground, 0.06, 1.0) == whole[order]).all()
    feet = by_noise(xy / FOOT, scatter, ground, 0.06, 1 / FOOT)
    assert (feet == whole).mean() > 0.999  # but for points at the sides of windows
    assert len(by_noise(np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool), 0.06, 1.0)) == 0


def shaken(points: PointCloud, noise: float) -> PointCloud:
    up = np.random.default_rng(4).normal(0, noise, len(points))
    return points.with_xyz(points.xyz + up[:, None] * (0, 0, 1))


@pytest.fixture(scope="module")
def town() -> PointCloud:
    scene = SamplesScene(kind="town", size=100.0, density=8.0, seed=5).run().points
    ground = scene["classification"] == 2
    truth = scene.with_attributes({"truth": scene["classification"]})
    return truth.with_attributes({"classification": np.where(ground, 2, 1).astype(np.uint8)})


def found(points: PointCloud, flat: float | None = None) -> float:
    """IoU of the points of buildings."""
    out = ClassifyBuildings(points=points, flat=flat).run().classified
    own, true = out["classification"] == 6, out["truth"] == 6
    return float((own & true).sum() / (own | true).sum())


def test_roofs_are_found_in_noise_of_many_centimetres(
    town: PointCloud, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        clean = ClassifyBuildings(points=town).run()
    assert "scatter" not in caplog.text
    same = ClassifyBuildings(points=town, flat=0.06).run()
    assert (clean.classified["classification"] == same.classified["classification"]).all()
    noisy = shaken(town, 0.1)
    caplog.clear()
    assert found(noisy) > 0.95
    assert "points on the ground scatter so much that points may be up to 0.1" in caplog.text
    assert "are told less surely; `flat` sets how far" in caplog.text
    caplog.clear()
    assert found(noisy, 0.06) < 0.5
    assert "the points are too noisy; a tool with `flat` needs some 0.1" in caplog.text


def test_without_returns_noise_is_told_and_not_followed(
    town: PointCloud, caplog: pytest.LogCaptureFixture
) -> None:
    """Crowns are told by their planes alone then."""
    single = np.ones(len(town), np.uint8)
    bare = town.with_attributes({"return_number": single, "number_of_returns": single})
    noisy = shaken(bare, 0.1)
    assert found(noisy) == found(noisy, 0.06) < 0.5
    assert "the points are too noisy; a tool with `flat` needs some 0.1" in caplog.text


def test_a_part_of_the_ground_that_scatters_does_not_decide_elsewhere() -> None:
    """Noise of one flight line: planes of the other are told as before."""
    side = np.arange(0, 400, 0.5)
    xy = np.stack(np.meshgrid(side, side[:100]), -1).reshape(-1, 2)
    rough = xy[:, 0] < 150
    z = np.random.default_rng(0).normal(0, np.where(rough, 0.12, 0.01))
    number = {"return_number": np.ones(len(xy), np.uint8)}
    number["number_of_returns"] = np.where(np.arange(len(xy)) == 0, 2, 1).astype(np.uint8)
    points = cloud(np.column_stack([xy, z]), 2, crs=CRS(32635), **number)
    flatness = PointFeatures(points, 1.0, 3.0, ground_classes=(2,), by_noise=True).flatness
    assert flatness[xy[:, 0] < 100].min() > 0.09
    assert (flatness[xy[:, 0] > 250] == 0.06).all()


def test_noise_and_roofs_are_the_same_by_a_part_of_the_ground(
    town: PointCloud, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Planes are looked for on a quarter of the known ground, and everywhere above it."""
    points = shaken(town, 0.1)
    some = PointFeatures(points, 1.0, 3.0, ground_classes=(2,), by_noise=True)
    scatter, flatness = some.scatter, some.flatness
    monkeypatch.setattr(_evidence, "EACH", 1)
    every = PointFeatures(points, 1.0, 3.0, ground_classes=(2,), by_noise=True)
    ground = some.terrain[0]
    asked = np.isfinite(scatter[ground]).mean() / np.isfinite(every.scatter[ground]).mean()
    assert 0.2 < asked < 0.3
    to_warn = PointFeatures(points, 1.0, 3.0, ground_classes=(2,)).scatter[ground]
    assert 0.02 < np.isfinite(to_warn).mean() / np.isfinite(every.scatter[ground]).mean() < 0.06
    np.testing.assert_array_equal(scatter[~ground], every.scatter[~ground])
    np.testing.assert_allclose(flatness, every.flatness, atol=0.003)


def test_what_classes_call_ground_is_ground_where_it_is_raised_on_all_sides() -> None:
    """A bastion of 20 m, 6 m high, which a search for the terrain would take out."""
    side = np.arange(0, 100, 0.5)
    xy = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    top = (abs(xy - 50) < 10).all(axis=1)
    points = cloud(np.column_stack([xy, np.where(top, 6.0, 0.0)]), 2, crs=CRS(32635))
    middle = (abs(xy - 50) < 8).all(axis=1)
    height = PointFeatures(points, 1.0, 3.0, ground_classes=(2,)).terrain[1]
    assert abs(height[middle]).max() < 1


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_heights_bear_some_roofs_and_plants_that_are_called_ground(share: float) -> None:
    scene = SamplesScene(kind="town", size=100.0, density=8.0, seed=10).run().points
    truth = scene["classification"]
    wrong = (truth >= 3) & (np.random.default_rng(0).random(len(truth)) < share)
    called = scene.with_attributes({"classification": np.where(wrong, 2, truth).astype(np.uint8)})
    right, height = (
        PointFeatures(points, 1.0, 3.0, ground_classes=(2,)).terrain[1]
        for points in (scene, called)
    )
    assert np.quantile(abs(height - right)[truth == 6], 0.99) < 0.02
