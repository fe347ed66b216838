"""What of ours scikit-learn could do: the same answers, and its processor time beside ours."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tests.bench.measuring import DATA, say

TOWN = "ign_urban_50m/77055_627755.laz"


def scikit() -> None:
    """Neighbours, clusters, planes, thresholds and measures of a real town, one core."""
    from threadpoolctl import threadpool_limits

    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / TOWN)
    xyz = cloud.xyz - cloud.xyz.min(axis=0)
    with threadpool_limits(1):
        _neighbours(xyz)
        _clusters(xyz[cloud["classification"] > 2])
        _planes(xyz[cloud["classification"] == 6])
        _thresholds(xyz[:, 2])
        _measures()


def _said(what: str, ours: Callable[[], Any], theirs: Callable[[], Any], same: Any) -> None:
    seconds, found = [], []
    for work in (ours, theirs):
        work()
        start = time.process_time()
        found.append(work())
        seconds.append(time.process_time() - start)
    say(
        f"scikit  {what:44} ours {seconds[0]:8.4f} s, scikit-learn {seconds[1]:8.4f} s "
        f"({seconds[1] / seconds[0]:6.1f} times); {same(*found)}"
    )


def _neighbours(xyz: Any) -> None:
    from sklearn.neighbors import NearestNeighbors

    from algorithms.shared.neighbours import PointTree

    def ours() -> Any:
        tree, mean = PointTree.of(xyz), np.empty(len(xyz))
        mean[tree.order] = tree.mean_distances(20)[0]
        return mean

    def theirs() -> Any:
        found = NearestNeighbors(n_neighbors=20, algorithm="kd_tree").fit(xyz)
        return found.kneighbors()[0].mean(axis=1)

    _said(
        f"mean distance of 20 neighbours, {len(xyz):,}",
        ours,
        theirs,
        lambda a, b: f"largest difference {np.abs(a - b).max():.1e} m",
    )


def _clusters(xyz: Any) -> None:
    from sklearn.cluster import DBSCAN
    from sklearn.metrics import adjusted_rand_score

    from algorithms.shared.clusters import dbscan

    _said(
        f"DBSCAN of 0.5 m and 10, {len(xyz):,}",
        lambda: dbscan(xyz, 0.5, 10),
        lambda: DBSCAN(eps=0.5, min_samples=10, algorithm="kd_tree").fit(xyz).labels_,
        lambda a, b: f"adjusted Rand index {adjusted_rand_score(a, b):.5f}",
    )


def _planes(xyz: Any) -> None:
    """The plane of most points of a town's roofs."""
    from sklearn.linear_model import RANSACRegressor

    from algorithms.shared.plane_fit import sample, search

    def ours() -> Any:
        plane, _ = search(sample(xyz, 0), 0.1)
        assert plane is not None
        return (np.abs((xyz - plane.origin - plane.centre) @ plane.normal) < 0.1).sum()

    def theirs() -> Any:
        made = RANSACRegressor(residual_threshold=0.1, max_trials=1000, random_state=0)
        return made.fit(xyz[:, :2], xyz[:, 2]).inlier_mask_.sum()

    _said(
        f"plane within 0.1 m, {len(xyz):,} roof points",
        ours,
        theirs,
        lambda a, b: f"{a:,} and {b:,} points near it",
    )


def _thresholds(values: Any) -> None:
    from sklearn.mixture import GaussianMixture

    from algorithms.shared.otsu import otsu_threshold

    def theirs() -> float:
        made = GaussianMixture(2, random_state=0).fit(values[:, None])
        grid = np.linspace(*np.sort(made.means_.ravel()), 1000)
        label = made.predict(grid[:, None])
        return float(grid[np.flatnonzero(label != label[0])[0]])

    _said(
        f"two kinds of heights, {len(values):,}",
        lambda: otsu_threshold(values),
        theirs,
        lambda a, b: f"thresholds {a:.2f} (Otsu) and {b:.2f} m (mixture)",
    )


def _measures() -> None:
    from algorithms.shared.accuracy.confusion import Confusion, measures

    counts = np.random.default_rng(0).integers(0, 900, (100, 5, 5))
    labels = ("a", "b", "c", "d", "e")
    _said(
        "measures of 100 matrices",
        lambda: measures(counts.astype(float))["kappa"],
        lambda: np.array([Confusion(labels, c).measures()["kappa"] for c in counts]),
        lambda a, b: f"largest difference {np.abs(a - b).max():.1e}",
    )
