"""Numbers of squares, and heights shared by two classes."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.squares import numbered, shared_by_two


def test_numbers_are_row_by_row_with_empty_squares_between() -> None:
    xyz = np.random.default_rng(1).uniform([-95, 40, 0], [130, 77, 5], (500, 3))
    col, row = np.floor(xyz[:, :2] / 4.0).astype(int).T
    for margin in (0, 1):
        found, cols = numbered(xyz, 4.0, margin)
        assert cols == np.ptp(col) + margin + 2
        wanted = (row - row.min() + margin) * cols + col - col.min() + margin
        np.testing.assert_array_equal(found, wanted)


def test_heights_are_shared_by_the_nearest_middles() -> None:
    """Classes of 0.5 m from -1 m on have their middles at -0.75, -0.25, 0.25 and 0.75 m."""
    lower, upper = np.zeros((2, 2, 4))
    above = np.array([-0.25, 0.0, 0.15, 0.8, -0.75, np.nan, -0.9])
    shared_by_two(above, np.array([0, 0, 1, 1, 1, 0, 0]), 1.0, 0.5, lower, upper)
    np.testing.assert_allclose(lower, [[0, 1.5, 0, 0], [0, 0.2, 0, 0]])
    np.testing.assert_allclose(upper, [[0, 0, 0.5, 0], [0, 0, 0.8, 0]])
