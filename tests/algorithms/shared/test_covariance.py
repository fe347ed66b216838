"""algorithms.shared.covariance: against numpy, known shapes, and what must not matter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.shared.covariance import FEATURES, Name, covariance_features
from algorithms.shared.kernels import covariance as kernels
from algorithms.shared.neighbours import PointTree
from toolbox.context import Context
from toolbox.errors import Cancelled

Floats = NDArray[np.float64]
ALL: tuple[Name, ...] = tuple(FEATURES)


def terrain(n: int = 3000, seed: int = 0) -> Floats:
    """Rough ground with a wall and a tree, far from the origin."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((0, 0, 0), (20, 20, 0.1), (n, 3))
    xyz[: n // 5] = rng.uniform((5, 0, 0), (5.02, 20, 6), (n // 5, 3))
    xyz[n // 5 : n // 3] = rng.normal((15, 15, 5), 1.0, (n // 3 - n // 5, 3))
    return np.asarray(xyz + np.array([500_000.0, 6_600_000.0, 300.0]))


def of_numpy(offsets: Floats, reach: float) -> dict[str, float]:
    """All features of a neighbourhood, given as offsets from its point."""
    values, axes = np.linalg.eigh(np.cov(offsets.T, bias=True))
    l3, l2, l1 = (max(float(v), 0.0) for v in values)
    shares = np.array([l1, l2, l3]) / (l1 + l2 + l3)
    normal = axes[:, 0] * np.sign(axes[2, 0])
    count, z = len(offsets), offsets[:, 2]
    return {
        "linearity": (l1 - l2) / l1,
        "planarity": (l2 - l3) / l1,
        "sphericity": l3 / l1,
        "anisotropy": (l1 - l3) / l1,
        "omnivariance": float(np.cbrt(shares.prod())),
        "eigenentropy": float(-(shares * np.log(np.maximum(shares, 1e-300))).sum()),
        "surface_variation": l3 / (l1 + l2 + l3),
        "verticality": 1 - abs(float(normal[2])),
        "roughness": abs(float(normal @ offsets.mean(axis=0))),
        **dict(zip(("nx", "ny", "nz"), map(float, normal), strict=True)),
        "height_range": float(np.ptp(z)),
        "height_deviation": float(z.std()),
        "volume_density": count / (4 / 3 * np.pi * reach**3),
        "surface_density": count / (np.pi * reach**2),
        "neighbours": count,
        "eigenvalue1": l1,
        "eigenvalue2": l2,
        "eigenvalue3": l3,
    }


@pytest.mark.parametrize(
    ("neighbours", "radius"), [(20, None), (8, None), (20, 0.8), (None, 0.8), (None, 2.5)]
)
def test_features_are_those_of_numpy(neighbours: int | None, radius: float | None) -> None:
    xyz = terrain()
    found = covariance_features(xyz, neighbours=neighbours, radius=radius, names=ALL)
    tree, few = cKDTree(xyz), 0
    for point in range(0, len(xyz), 7):
        if neighbours is None:
            near = np.array(tree.query_ball_point(xyz[point], radius))
            reach = float(radius or 0)
        else:
            away, near = tree.query(
                xyz[point], range(1, neighbours + 2), distance_upper_bound=radius or np.inf
            )
            near, reach = near[np.isfinite(away)], float(away[np.isfinite(away)].max())
        assert found["neighbours"][point] == len(near)
        if len(near) < 3:
            few += 1
            assert np.isnan(found["linearity"][point])
            continue
        for name, value in of_numpy(xyz[near] - xyz[point], reach).items():
            assert found[name][point] == pytest.approx(value, rel=1e-4, abs=2e-5), (name, point)  # type: ignore[index]
    assert few < 50


def clumps() -> Floats:
    """Dense and sparse clumps side by side, each point of one of them three times."""
    rng = np.random.default_rng(1)
    middles = rng.uniform(0, 40, (9, 3))
    parts = [rng.normal(middle, 0.02 * 3**k, (400, 3)) for k, middle in enumerate(middles[:6])]
    return np.concatenate([*parts, np.repeat(rng.normal(middles[6], 1.0, (150, 3)), 3, axis=0)])


def steps() -> Floats:
    """A regular grid: many neighbours are equally far away."""
    return np.stack(np.meshgrid(range(12), range(12), range(9)), -1).reshape(-1, 3).astype(float)


@pytest.mark.parametrize("cloud", [terrain, clumps, steps])
@pytest.mark.parametrize(("neighbours", "reach"), [(3, np.inf), (20, np.inf), (20, 0.5), (90, 2.0)])
def test_points_around_a_leaf_tell_what_a_search_for_each_point_does(
    cloud: Callable[[], Floats], neighbours: int, reach: float
) -> None:
    tree = PointTree.of(cloud())
    count, leaves = len(tree.xyz), 1 << tree.depth
    how = tree.xyz, tree.boxes, tree.depth, neighbours, reach
    together = np.empty((kernels.ROWS, count))
    kernels.nearest(0, leaves, *how, together)
    for leaf in range(leaves):  # the first leaf of a run has none before it to learn from
        some = slice(*((k * count) >> tree.depth for k in (leaf, leaf + 1)))
        single = np.empty((kernels.ROWS, some.stop - some.start))
        kernels.nearest(leaf, leaf + 1, *how, single)
        np.testing.assert_array_equal(together[:, some], single)


def test_a_line_a_plane_and_a_ball() -> None:
    rng = np.random.default_rng(1)
    along = rng.uniform(0, 10, 500)
    line = np.outer(along, [0.6, 0.0, 0.8])
    u, v = rng.uniform(0, 10, (2, 2000))
    plane = np.column_stack([u, v, 0.75 * u])
    ball = rng.normal(0, 1, (4000, 3))
    ball = ball[np.linalg.norm(ball, axis=1) < 1]
    wire = covariance_features(line, names=ALL)
    np.testing.assert_allclose(wire["linearity"], 1.0, atol=1e-5)
    roof = covariance_features(plane, names=ALL)
    np.testing.assert_allclose(roof["sphericity"], 0.0, atol=1e-9)
    np.testing.assert_allclose(roof["roughness"], 0.0, atol=1e-5)
    np.testing.assert_allclose(roof["nx"], -0.6, atol=1e-5)
    np.testing.assert_allclose(roof["nz"], 0.8, atol=1e-5)
    np.testing.assert_allclose(roof["verticality"], 0.2, atol=1e-5)
    assert np.median(roof["planarity"]) > 0.5
    tree = covariance_features(ball, neighbours=None, radius=1.5, names=ALL)
    inner = np.linalg.norm(ball, axis=1) < 0.2
    assert np.median(tree["sphericity"][inner]) > 0.85
    assert np.median(tree["eigenentropy"][inner]) == pytest.approx(np.log(3), abs=0.01)


def test_a_straight_line_has_no_plane_and_a_single_place_no_shape() -> None:
    line = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    found = covariance_features(line, neighbours=4, names=ALL)
    assert (found["linearity"] == 1).all()
    for name in ("verticality", "nx", "roughness"):
        assert np.isnan(found[name]).all()  # type: ignore[index]
    heap = covariance_features(np.ones((50, 3)), neighbours=4, names=ALL)
    assert (heap["neighbours"] == 5).all()
    for name in ("linearity", "nz", "volume_density", "eigenentropy"):
        assert np.isnan(heap[name]).all()  # type: ignore[index]


@pytest.mark.parametrize("neighbours", [3, 20, None])
@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_points_have_no_shape(neighbours: int | None, count: int) -> None:
    xyz = np.arange(3.0 * count).reshape(count, 3)
    found = covariance_features(xyz, neighbours=neighbours, radius=50.0, names=ALL)
    assert np.isnan(found["planarity"]).all()
    assert (found["neighbours"] == count).all()


@pytest.mark.parametrize("settings", [{"neighbours": 6}, {"neighbours": None, "radius": 1.5}])
def test_order_and_threads_do_not_matter(settings: dict[str, Any]) -> None:
    """Also on a lattice, where many are equally near, and with several points at one place."""
    lattice = np.stack(np.meshgrid(*[np.arange(12.0)] * 3), axis=-1).reshape(-1, 3)
    xyz = np.vstack([lattice, lattice[:300], terrain() - np.array([5e5, 6.6e6, 300])])
    found = covariance_features(xyz, names=ALL, **settings)
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(xyz))
        again = covariance_features(xyz[order], names=ALL, **settings)
        for name in ALL:
            np.testing.assert_array_equal(found[name][order], again[name], err_msg=name)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = covariance_features(xyz, names=ALL, **settings)
    finally:
        numba.set_num_threads(threads)
    for name in ALL:
        np.testing.assert_array_equal(found[name], alone[name], err_msg=name)


def test_a_shift_hardly_matters() -> None:
    """Coordinates are measured from the point: a northing of millions costs no digits."""
    near = terrain() - np.array([500_000.0, 6_600_000.0, 300.0])
    near = np.round(near * 1024) / 1024  # representable at both places
    here = covariance_features(near, names=ALL)
    there = covariance_features(near + np.array([500_000.0, 6_600_000.0, 300.0]), names=ALL)
    for name in ALL:
        np.testing.assert_array_equal(here[name], there[name], err_msg=name)


def matrices(kind: str, n: int = 500) -> Floats:
    """Symmetric matrices with eigenvalues of some kind, shape (n, 3, 3)."""
    rng = np.random.default_rng(4)
    values = {
        "any": rng.random((n, 3)),
        "plane": np.column_stack([10 ** rng.uniform(-14, -6, n), rng.uniform(1, 2, (n, 2))]),
        "line": 10 ** rng.uniform((-14, -9, 0), (-6, -3, 0), (n, 3)),
        "two equal": np.tile([0.1, 1.0, 1.0], (n, 1)),
        "other two equal": np.tile([1.0, 1.0, 2.0], (n, 1)),
        "almost equal": 1 + 1e-9 * rng.random((n, 3)),
        "one": np.tile([0.0, 0.0, 1.0], (n, 1)),
        "tiny": 1e-30 * rng.random((n, 3)),
    }[kind]
    turn = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    found = turn @ (values[:, :, None] * np.swapaxes(turn, 1, 2))
    return np.asarray((found + np.swapaxes(found, 1, 2)) / 2)


@numba.njit
def eigen(xx, xy, xz, yy, yz, zz):
    """A helper can only be called from compiled code."""
    return kernels.eigen(xx, xy, xz, yy, yz, zz)


@pytest.mark.parametrize(
    "kind",
    ["any", "plane", "line", "two equal", "other two equal", "almost equal", "one", "tiny"],
)
def test_eigenvalues_are_exact_to_rounding(kind: str) -> None:
    for matrix in matrices(kind):
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix
        *values, a, b, c = eigen(xx, xy, xz, yy, yz, zz)
        wanted = np.maximum(np.linalg.eigvalsh(matrix)[::-1], 0)
        axis, size = np.array([a, b, c]), wanted[0]
        np.testing.assert_allclose(values, wanted, rtol=0, atol=4e-15 * size)
        np.testing.assert_allclose(matrix @ axis, values[2] * axis, rtol=0, atol=4e-15 * size)
        assert np.linalg.norm(axis) == pytest.approx(1, abs=1e-14)


def test_what_cannot_be() -> None:
    with pytest.raises(ValueError, match="give neighbours"):
        covariance_features(terrain(), neighbours=None)
    with pytest.raises(ValueError, match="finite"):
        covariance_features(np.full((5, 3), np.nan))
    with pytest.raises(Cancelled):
        covariance_features(terrain(), ctx=Context(stop=lambda: True))


def test_some_points_have_the_features_that_they_have_among_all() -> None:
    xyz = terrain()
    some = np.arange(len(xyz)) % 7 == 0
    every = covariance_features(xyz, neighbours=None, radius=1.5, names=ALL)
    found = covariance_features(xyz, neighbours=None, radius=1.5, names=ALL, some=some)
    for name in ALL:
        np.testing.assert_array_equal(found[name][some], every[name][some])
        assert np.isnan(found[name][~some]).all()


def test_points_at_one_place_count_once_if_asked_for() -> None:
    xyz = terrain()
    twice = np.concatenate([xyz, xyz[::3]])
    single = covariance_features(xyz, neighbours=None, radius=1.5, names=ALL)
    found = covariance_features(twice, neighbours=None, radius=1.5, names=ALL, once=True)
    for name in ALL:
        np.testing.assert_array_equal(found[name], np.r_[single[name], single[name][::3]])
