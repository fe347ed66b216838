"""Points sorted into cubes."""

from __future__ import annotations

import numpy as np
import pytest

from algorithms.shared.cells import MOST, WIDER, SortedCells


@pytest.mark.parametrize("radius", [0.3, 1.0, 500.0])
@pytest.mark.parametrize("writable", [True, False])
def test_cubes_are_those_that_numpy_counts(radius: float, writable: bool) -> None:
    """Numbers of cubes, and the order of the points, as by whole arrays."""
    xyz = np.random.default_rng(5).uniform(-40, 70, (3000, 3))
    xyz[:, 2] *= 0.1
    xyz.flags.writeable = writable
    cells = SortedCells.of(xyz, radius)
    low, extent = xyz.min(axis=0), np.ptp(xyz, axis=0)
    side = max(radius * WIDER, float(extent.max()) / MOST)
    size = (extent / side).astype(np.int64) + 3
    place = ((xyz - low) / side).astype(np.int64) + 1
    number = (place[:, 0] * size[1] + place[:, 1]) * size[2] + place[:, 2]
    order = np.argsort(number, kind="stable")
    key, first = np.unique(number, return_index=False), np.unique(number[order], return_index=True)
    assert cells.stride == (size[1] * size[2], size[2])
    assert np.array_equal(cells.order, order)
    assert np.array_equal(cells.key, key)
    assert np.array_equal(cells.start, np.append(first[1], len(xyz)))
    assert np.array_equal(cells.xyz, xyz[order])


def test_no_points_make_no_cubes() -> None:
    cells = SortedCells.of(np.empty((0, 3)), 1.0)
    assert len(cells.key) == 0
    assert cells.start.tolist() == [0]
