"""What is learned of the height up to which points are ground."""

from __future__ import annotations

import numpy as np
import pytest

from algorithms.shared.tolerance import densest_heights, share_with_points, tolerances
from algorithms.shared.windows import spread, window_sums

ALL = np.ones((9, 9))
MIDDLE = 4 * 9 + 4


@pytest.mark.parametrize(
    ("densest", "scatter", "level"),
    [(0.0, 0.02, 0.11), (0.09, 0.05, 0.29), (0.0, 0.12, 0.3), (0.1, 0.12, 0.4)],
)
def test_tolerance_follows_the_scatter_of_the_ground(
    densest: float, scatter: float, level: float
) -> None:
    """5 cm and three standard deviations above the densest height, at most 0.3 m above that.

    A fifth of the points are plants, from the ground to 2 m, and do not count.
    """
    rng = np.random.default_rng(1)
    above = np.append(rng.normal(densest, scatter, 40_000), rng.uniform(densest, 2, 10_000))
    found = tolerances(above, np.full(len(above), MIDDLE), ALL)
    assert found[0, 4, 4] == pytest.approx(level, abs=0.04)


def test_where_little_is_known_the_tolerance_is_the_widest() -> None:
    nothing = tolerances(np.array([np.nan, 7.0]), np.array([MIDDLE, MIDDLE]), ALL)
    np.testing.assert_allclose(nothing[0], 0.3, rtol=1e-12)
    few = tolerances(np.zeros(40), np.full(40, MIDDLE), ALL)
    assert 0.1 < few[0, 4, 4] < 0.25


@pytest.mark.parametrize(("every", "slope"), [(1, 0.5), (2, 1.0), (4, 1.0)])
def test_on_slopes_half_the_distance_between_points_counts(every: int, slope: float) -> None:
    """In metres, at least that of the cells and at most a metre."""
    z = np.full((128, 128), np.nan, np.float32)
    z[::every, ::every] = 1
    found = tolerances(np.zeros(1), np.zeros(1, int), share_with_points(z))
    assert found[1, 8, 8] == pytest.approx(slope, rel=0.02)


def test_the_share_of_cells_with_points_is_never_zero() -> None:
    z = np.full((160, 160), np.nan, np.float32)
    z[:80] = 1
    share = share_with_points(z)
    assert share.shape == (20, 20)
    np.testing.assert_allclose(share[:6], 1, atol=0.01)
    np.testing.assert_allclose(share[14:], 0.02)


def test_windows_count() -> None:
    """A window of 16 cells holds as many ones as the integral of its bell, 2 pi 16^2."""
    counts = window_sums(np.ones((256, 256)), 8, 16.0)
    assert counts[16, 16] == pytest.approx(2 * np.pi * 256, rel=0.01)
    assert counts[0, 16] < 0.6 * counts[16, 16]  # nothing lies beyond the edge
    np.testing.assert_array_equal(spread(np.array([[1.0], [2.0]]), 2)[:, 0], [1, 1, 2, 2])


def test_a_single_point_changes_the_tolerance_by_little() -> None:
    """Two heights are as dense; a point moved by a micrometre, or one more, decides nothing."""
    rng = np.random.default_rng(2)
    above = np.concatenate([rng.normal(0, 0.02, 500), rng.normal(0.2, 0.02, 500)])
    blocks = np.full(len(above), MIDDLE)
    found = tolerances(above, blocks, ALL)
    for lift in (1e-6, -1e-6):
        moved = tolerances(above + lift, blocks, ALL)
        np.testing.assert_allclose(moved, found, rtol=0, atol=2e-5)
    for one in (0.0, 0.2):
        more = tolerances(np.append(above, one), np.append(blocks, MIDDLE), ALL)
        np.testing.assert_allclose(more, found, rtol=0, atol=2e-3)


def test_the_densest_height_is_between_two_that_are_as_dense_and_else_that_of_the_denser() -> None:
    height = np.arange(20.0)
    counts = np.zeros((2, 20))
    counts[:, 5], counts[:, 14] = 10, (10, 5)
    np.testing.assert_allclose(densest_heights(counts, height), [9.5, 5.0], atol=0.05)
