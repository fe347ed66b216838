"""Smoothing of outlines: what it takes out, and what it must not touch."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scenes.lakes import ORIGIN, RADIUS, lake

from algorithms.shoreline._smooth import smooth_part, smooth_ring
from algorithms.shoreline.extract import ShorelineExtract

CIRCLE = shapely.Point(ORIGIN[0] + 50, ORIGIN[1] + 50).buffer(RADIUS, quad_segs=90)


def circle(
    radius: float, n: int = 300, noise: float = 0.0, far: float = 0.0
) -> NDArray[np.float64]:
    angle = np.linspace(0, 2 * math.pi, n, endpoint=False)
    r = radius + np.random.default_rng(0).normal(0, noise, n)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)]) + far


def free(ring: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.zeros(len(ring), bool)


@pytest.mark.parametrize(("density", "bar"), [(1.0, 0.01), (5.0, 0.01), (20.0, 0.01)])
def test_perimeter_is_that_of_the_lake(density: float, bar: float) -> None:
    points = lake(density=density)
    smooth = ShorelineExtract(points=points).run().water.frame.iloc[0]
    rough = ShorelineExtract(points=points, smoothing=0.0).run().water.frame.iloc[0]
    assert smooth.perimeter == pytest.approx(CIRCLE.length, rel=bar)
    assert rough.perimeter > (1 + 2 * bar) * CIRCLE.length
    assert smooth.area == pytest.approx(rough.area, abs=smooth.area_error)
    off = [g.symmetric_difference(CIRCLE).area for g in (smooth.geometry, rough.geometry)]
    assert off[0] < off[1]


@pytest.mark.parametrize("far", [0.0, 5e6])
def test_noise_goes_and_the_circle_stays(far: float) -> None:
    ring = circle(30.0, noise=0.2, far=far)
    smooth = smooth_ring(ring, free(ring), 1.5)
    off = np.hypot(*(smooth - far).T) - 30
    assert abs(off).max() < 0.25
    assert off.std() < 0.12
    assert abs(off.mean()) < 0.03


def test_small_rings_keep_their_size_whatever_is_asked_for() -> None:
    ring = circle(2.5, n=40)
    area = shapely.Polygon(smooth_ring(ring, free(ring), 50.0)).area
    assert area == pytest.approx(shapely.Polygon(ring).area, rel=0.03)


def test_corners_at_the_edge_of_the_data_stay() -> None:
    ring = circle(30.0, noise=0.3)
    fixed = ring[:, 0] > 10
    smooth = smooth_ring(ring, fixed, 1.5)
    np.testing.assert_array_equal(smooth[fixed], ring[fixed])
    assert not np.allclose(smooth[~fixed], ring[~fixed], atol=0.01)


def test_an_island_beside_the_shore_is_not_crossed() -> None:
    box = np.array(shapely.segmentize(shapely.box(0, 0, 40, 40), 0.5).exterior.coords)[:-1]
    hole = np.array(shapely.segmentize(shapely.box(0.05, 18, 10, 30), 0.5).exterior.coords)[:-1]
    alone = [smooth_ring(ring, free(ring), 4.0) for ring in (box, hole)]
    assert not shapely.Polygon(alone[0], alone[1:]).is_valid
    both = smooth_part([box, hole], [free(box), free(hole)], 4.0)
    assert shapely.Polygon(both[0], both[1:]).is_valid
    assert not np.array_equal(both[0], box)  # less, but not none
