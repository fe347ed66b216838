"""Numbers of squares, and heights shared by two classes."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.squares import (
    add_slices,
    box,
    held,
    near_bottom,
    numbered,
    rises,
    shared_by_two,
    slice_ends,
    tops_between,
)


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


def test_only_kept_points_make_the_bottom_of_a_square() -> None:
    rng = np.random.default_rng(2)
    squares, kept = rng.integers(0, 9, 300), rng.random(300) < 0.8
    squares[squares == 4] = 5  # none in one of them
    xyz = rng.uniform(0, 5, (300, 3))
    low = np.array([min(xyz[kept & (squares == k), 2], default=np.inf) for k in range(9)])
    near = near_bottom(squares, kept, xyz, 9, 1.0)
    np.testing.assert_array_equal(near, kept & (xyz[:, 2] - low[squares] < 1.0))
    number = np.where(np.arange(9) % 2 == 0, np.arange(9), -1)
    index = held(squares, number, kept)
    np.testing.assert_array_equal(index, np.flatnonzero(kept & (squares % 2 == 0)))


def test_slices_of_a_square_begin_with_an_empty_one() -> None:
    """Those beyond the limits count for the lowest and the highest."""
    xyz = np.array([[0, 0, z] for z in (-3.0, 0.2, 0.5, 1.2, 9.0)])
    assert slice_ends(xyz, 0.5) == (-6.0, 18.0)
    squares = np.array([0, 0, 1, 1, 2])
    add_slices(squares, xyz, 0.5, 0.0, 2.0, 5)
    assert squares.tolist() == [1, 1, 7, 8, 13]


def test_tops_are_those_of_the_chosen_points_and_rises_those_to_east_and_north() -> None:
    rng = np.random.default_rng(4)
    xyz, chosen = rng.uniform([-95, 40, -5], [130, 77, 5], (400, 3)), rng.random(400) < 0.7
    ends = box(xyz)
    assert ends == (*xyz[:, :2].min(axis=0), *xyz[:, :2].max(axis=0))
    col, row = np.floor(xyz[:, :2] / 4.0).astype(int).T
    col, row = col - col.min(), row - row.min()
    wanted = np.full((row.max() + 1, col.max() + 2), np.nan)
    for i in np.flatnonzero(chosen):
        wanted[row[i], col[i]] = np.fmax(wanted[row[i], col[i]], xyz[i, 2])
    top = tops_between(ends, chosen, xyz, 4.0, wanted.size)
    np.testing.assert_array_equal(top, wanted)
    assert tops_between(ends, chosen, xyz, 4.0, wanted.size - 1).size == 0
    places = np.flatnonzero(np.isfinite(wanted))
    east, north = np.diff(wanted, axis=1)[:-1], np.diff(wanted, axis=0)[:, :-1]
    both = np.isfinite(east + north)
    assert 20 < np.count_nonzero(both) < 0.8 * len(places)
    found = rises(places, wanted.shape[1], wanted.ravel()[places])
    np.testing.assert_array_equal(found, [east[both], north[both]])
