"""points.cluster: against scikit-learn, hulls and boxes, and what must not matter."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.points.cluster import MOST, PointsCluster, without_small
from algorithms.shared.clusters import dbscan, hdbscan
from toolbox.data import PointCloud
from toolbox.declare import ClassList
from toolbox.errors import DataError, ParameterError

UTM = CRS(32635)
Floats = NDArray[np.float64]


def heaps(seed: int = 0) -> Floats:
    """Three heaps of different density and a few points between them, far from the origin."""
    rng = np.random.default_rng(seed)
    sizes = (400, 200, 100)
    parts = [rng.normal((20 * k, 0, 0), 1 + k / 2, (n, 3)) for k, n in enumerate(sizes)]
    parts.append(rng.uniform(-10, 50, (60, 3)))
    return np.asarray(np.vstack(parts) + np.array([500_000.0, 6_600_000.0, 300.0]))


@pytest.mark.parametrize(("radius", "enough"), [(0.5, 4), (1.0, 10), (2.0, 3), (1.5, 1)])
@pytest.mark.parametrize("seed", [0, 1])
def test_cores_and_noise_are_those_of_scikit_learn(radius: float, enough: int, seed: int) -> None:
    from sklearn.cluster import DBSCAN

    xyz = heaps(seed)
    found, theirs = dbscan(xyz, radius, enough), DBSCAN(eps=radius, min_samples=enough).fit(xyz)
    np.testing.assert_array_equal(found == 0, theirs.labels_ < 0)
    core = theirs.core_sample_indices_
    both = np.unique(np.column_stack([found[core], theirs.labels_[core]]), axis=0)
    assert len(both) == len(np.unique(found[core])) == len(np.unique(theirs.labels_[core])) > 1
    for i in np.setdiff1d(np.flatnonzero(found), core):  # others go with the nearest core
        away = np.linalg.norm(xyz[core] - xyz[i], axis=1)
        assert found[i] == found[core[away.argmin()]]


@pytest.mark.parametrize("method", ["dbscan", "hdbscan"])
def test_the_order_of_the_points_does_not_matter(method: str) -> None:
    lattice = np.stack(np.meshgrid(*[np.arange(6.0)] * 3), axis=-1).reshape(-1, 3)
    xyz = np.vstack([lattice, lattice[:50] + 20, heaps()[:150] - [5e5, 6.6e6, 200]])
    order = np.random.default_rng(0).permutation(len(xyz))
    if method == "dbscan":
        one, other = dbscan(xyz, 1.0, 7), dbscan(xyz[order], 1.0, 7)
    else:
        one, other = hdbscan(xyz, 10), hdbscan(xyz[order], 10)
    assert one.max() > 1
    np.testing.assert_array_equal(one[order], other)


def test_a_box_on_the_ground() -> None:
    """A box of 4 by 2 by 1.5 m turned by 30 degrees from north, and a single point."""
    u, v, w = (part.ravel() for part in np.mgrid[0:4.01:0.5, 0:2.01:0.5, 0:1.51:0.5])
    sine, cosine = np.sin(np.radians(30)), np.cos(np.radians(30))
    xyz = np.column_stack([u * sine + v * cosine, u * cosine - v * sine, w + 7])
    xyz = np.vstack([xyz, [100, 100, 7]])
    out = PointsCluster(points=PointCloud(xyz, crs=UTM)).run()
    (row,) = out.clusters.frame.to_dict("records")
    assert out.count == 1
    assert out.clustered["cluster_id"].tolist() == [1] * (len(xyz) - 1) + [0]
    expected = {"points": len(xyz) - 1, "low": 7, "high": 8.5, "height": 1.5, "length": 4}
    expected |= {"width": 2, "direction": 30, "area": 8, "volume": 12}
    assert {name: row[name] for name in expected} == pytest.approx(expected)
    assert out.apart == pytest.approx(1 / len(xyz))


def test_points_on_a_line_have_a_hull_and_small_clusters_are_none() -> None:
    line = np.column_stack([np.arange(20.0) / 2, np.zeros(20), np.zeros(20)])
    pair = np.array([[50, 0, 0], [50.1, 0, 0]])
    cloud = PointCloud(np.vstack([line, pair]), crs=UTM)
    out = PointsCluster(points=cloud, min_points=2, min_size=3).run()
    (row,) = out.clusters.frame.to_dict("records")
    assert row["length"] == pytest.approx(9.52)
    assert row["direction"] == pytest.approx(90)
    assert row["volume"] == 0
    assert without_small(np.array([1, 1, 2]), 2).tolist() == [1, 1, 0]


def test_only_the_classes_asked_for_are_grouped() -> None:
    codes = np.repeat(np.array([5, 6], np.uint8), [400, 360])
    cloud = PointCloud(heaps(), {"classification": codes}, crs=UTM)
    out = PointsCluster(points=cloud, classes=ClassList([5])).run()
    assert out.count == 1
    assert not out.clustered["cluster_id"][codes == 6].any()
    assert out.apart < 0.05


def test_hdbscan_finds_heaps_of_different_density() -> None:
    out = PointsCluster(
        points=PointCloud(heaps(), crs=UTM), method="hdbscan", min_points=50, min_size=50
    ).run()
    assert out.count == 3
    for first, last in ((0, 400), (400, 600), (600, 700)):
        own = out.clustered["cluster_id"][first:last]
        assert np.bincount(own).argmax() > 0
        assert np.bincount(own).max() > 0.6 * len(own)


def test_what_cannot_be() -> None:
    with pytest.raises(ParameterError, match="min_points: must be at least 2 for hdbscan"):
        PointsCluster(points=PointCloud(heaps(), crs=UTM), method="hdbscan", min_points=1)
    with pytest.raises(ParameterError, match="radius: is for method dbscan, not for hdbscan"):
        PointsCluster(points=PointCloud(heaps(), crs=UTM), method="hdbscan", radius=1.0)
    many = PointCloud(np.random.default_rng(0).random((MOST + 1, 3)), crs=UTM)
    with pytest.raises(DataError, match="method: hdbscan takes up to 50,000 points, got 50,001"):
        PointsCluster(points=many, method="hdbscan")
    with pytest.raises(DataError, match="has no classification"):
        PointsCluster(points=PointCloud(heaps(), crs=UTM), classes=ClassList([5]))
