"""algorithms.shared.neighbours: against scipy, whatever the density and however many are equal."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.shared.kernels.neighbours import DEEPEST, first, nearest
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.neighbours import LEAF, PointTree
from toolbox.context import QUIET, Context
from toolbox.errors import Cancelled

Floats = NDArray[np.float64]


def knn(
    xyz: Floats, k: int, *, max_distance: float = np.inf, ctx: Context = QUIET
) -> tuple[Floats, NDArray[np.int64]]:
    """Distances of the k nearest others of each point, inf where there is none, and indices, -1."""
    tree = PointTree.of(xyz, ctx=ctx.part(0.0, 0.2))
    distance, index = np.full((len(xyz), k), np.inf), np.full((len(xyz), k), -1)
    arrays = (tree.xyz, tree.order, tree.boxes, tree.depth, max_distance, distance, index)
    side_by_side(_neighbours, tree.leaves, *arrays, ctx=ctx.part(0.2, 1.0))
    return distance, index


@numba.njit(nogil=True)
def _neighbours(first_leaf, last_leaf, xyz, order, box, depth, reach, distance, index):
    """Fill in the rows of the points of some leaves, as tools do it in their own loops."""
    n, k = len(xyz), distance.shape[1]
    near, far = np.empty(k, np.int64), np.empty(k)
    held, held_away = np.empty(DEEPEST, np.int64), np.empty(DEEPEST)
    for leaf in range(first_leaf, last_leaf):
        for own in range(first(leaf, depth, n), first(leaf + 1, depth, n)):
            found = nearest(xyz, box, depth, leaf, own, reach, near, far, held, held_away)
            for j in range(found):
                distance[order[own], j] = np.sqrt(far[j])
                index[order[own], j] = order[near[j]]


def clouds() -> dict[str, Floats]:
    """Points of many kinds: even, in dense clumps, flat, far away, on a line."""
    rng = np.random.default_rng(0)
    even = rng.uniform(0, 100, (1500, 3))
    clumps = np.vstack([even, rng.normal(50, 0.01, (1500, 3)), [[9e4, -9e4, 4e3]]])
    return {
        "even": even,
        "clumps": clumps,
        "flat": even * [1, 1, 0],
        "line": even * [0, 1, 0],
        "far away": even + np.array([5e6, -5e6, 0]),
        "one leaf": even[:LEAF],
        "one more": even[: LEAF + 1],
    }


@pytest.mark.parametrize("name", clouds())
@pytest.mark.parametrize(("k", "reach"), [(1, np.inf), (7, np.inf), (20, np.inf), (20, 6.0)])
def test_neighbours_are_those_of_scipy(name: str, k: int, reach: float) -> None:
    xyz = clouds()[name]
    distance, index = knn(xyz, k, max_distance=reach)
    wanted, who = (
        np.asarray(a)[:, 1:]
        for a in cKDTree(xyz).query(xyz, range(1, k + 2), distance_upper_bound=reach)
    )
    np.testing.assert_allclose(distance, wanted, rtol=1e-12)
    np.testing.assert_array_equal(index, np.where(who == len(xyz), -1, who))
    mean, farthest = PointTree.of(xyz).mean_distances(k, max_distance=reach)
    order = PointTree.of(xyz).order
    capped = np.minimum(wanted, reach)
    np.testing.assert_allclose(mean, capped.mean(axis=1)[order], rtol=1e-12)
    np.testing.assert_allclose(farthest, capped[:, -1][order], rtol=1e-12)


def test_of_equally_near_points_the_place_decides_not_the_index() -> None:
    """On a regular grid a point has up to 6 equally near ones; all orders give the same places."""
    xyz = np.stack(np.meshgrid(*[np.arange(7.0)] * 3), axis=-1).reshape(-1, 3)
    distance, index = knn(xyz, 4)
    inner = np.flatnonzero((xyz == 3).all(axis=1))[0]
    np.testing.assert_array_equal(xyz[index[inner]], [[2, 3, 3], [3, 2, 3], [3, 3, 2], [3, 3, 4]])
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(xyz))
        again, places = knn(xyz[order], 4)
        np.testing.assert_array_equal(again, distance[order])
        np.testing.assert_array_equal(xyz[order][places], xyz[index[order]])


@pytest.mark.slow
def test_many_points_at_one_place() -> None:
    """Neighbours are other points at distance 0, and the search does not look at all of them."""
    xyz = np.vstack([np.zeros((30_000, 3)), np.ones((3, 3))])
    distance, index = knn(xyz, 5)
    assert (distance[:30_000] == 0).all()
    assert (index != np.arange(len(xyz))[:, None]).all()
    np.testing.assert_allclose(distance[-1], [0, 0, *[np.sqrt(3)] * 3])
    mean, _ = PointTree.of(xyz).mean_distances(5)
    assert np.count_nonzero(mean) == 3


def test_fewer_points_than_neighbours() -> None:
    for n in range(4):
        distance, index = knn(np.arange(3.0 * n).reshape(n, 3), 3)
        assert distance.shape == index.shape == (n, 3)
        assert np.isinf(distance).sum() == (index < 0).sum() == n * (4 - n)
        mean, _ = PointTree.of(np.zeros((n, 3))).mean_distances(3, max_distance=6.0)
        np.testing.assert_allclose(mean, 6.0 * (4 - n) / 3)


def test_threads_make_no_difference() -> None:
    xyz = clouds()["clumps"]
    threads = numba.get_num_threads()
    several = knn(xyz, 9)
    try:
        numba.set_num_threads(1)
        np.testing.assert_array_equal(knn(xyz, 9), several)
    finally:
        numba.set_num_threads(threads)


def test_bad_input() -> None:
    with pytest.raises(ValueError, match=r"finite numbers, got y = nan at point 1"):
        PointTree.of(np.array([[0, 0, 0], [0, np.nan, 0]]))


def test_progress_and_cancel() -> None:
    seen: list[float] = []
    xyz = clouds()["even"]
    knn(xyz, 3, ctx=Context(seen.append))
    assert seen == sorted(seen)
    assert seen[-1] == 1
    with pytest.raises(Cancelled):
        knn(xyz, 3, ctx=Context(stop=lambda: True))
