"""A yard and a park with known classes, for tools that learn what points are."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyproj import CRS

from toolbox.data import PointCloud

UTM = CRS("EPSG:32635+5773")
QUICK: dict[str, Any] = {"trees": 10, "per_class": 400, "folds": 3}  # settings of classify.train
NAMES = ("height_above_ground", "planarity@2", "sphericity@2", "height_range@1", "intensity")


def yard(seed: int = 0, size: float = 60.0, density: float = 4.0) -> PointCloud:
    """Ground (2) with houses (6) and trees (5) in a raster of 20 m, moved about by chance."""
    rng = np.random.default_rng(seed)
    count = int(size * size * density)
    xyz = np.column_stack([rng.uniform(0, size, (count, 2)), rng.normal(0, 0.02, count)])
    codes = np.full(count, 2)
    for number, (west, south) in enumerate(np.ndindex(int(size / 20), int(size / 20))):
        middle = np.array([west, south]) * 20 + 10 + rng.uniform(-3, 3, 2)
        if number % 2:
            on = np.abs(xyz[:, :2] - middle).max(axis=1) < 5
            xyz[on, 2] += 6
            codes[on] = 6
        else:
            on = np.hypot(*(xyz[:, :2] - middle).T) < 4
            xyz[on, 2] += rng.uniform(1, 9, on.sum())
            codes[on] = 5
    columns = {"classification": codes.astype(np.uint8)}
    columns["intensity"] = (rng.normal(300, 30, count) + 100 * (codes == 6)).astype(np.uint16)
    xyz += np.array([500_000, 4_600_000, 50])
    return PointCloud(xyz, columns, crs=UTM, name="yard.laz")


def park(n: int = 24_000, seed: int = 0, shift: float = 0.0) -> PointCloud:
    """Gently sloping ground, three roofs and three groups of trees on 80 x 60 m, with truth."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform((0, 0), (80, 60), (n, 2)).T
    z, truth = 0.03 * x + rng.normal(0, 0.02, n), np.full(n, 2)
    count, number = np.ones(n, int), np.ones(n, int)
    for k, (east, north) in enumerate([(15, 15), (42, 15), (66, 20)]):
        roof = (abs(x - east) < 6) & (abs(y - north) < 5)
        z[roof] = 5 + k - 0.4 * abs(y - north)[roof] + rng.normal(0, 0.02, roof.sum())
        truth[roof] = 6
    for east, north in [(15, 42), (40, 45), (66, 45)]:
        tree = (np.hypot(x - east, y - north) < 7) & (rng.random(n) < 0.8)
        z[tree] += rng.uniform(1.5, 12, tree.sum())
        truth[tree] = 5
        count[tree] = rng.integers(1, 4, tree.sum())
        number[tree] = rng.integers(1, count[tree] + 1)
    columns = {
        "intensity": rng.normal(np.choose(truth // 2 - 1, [600, 300, 900]), 150).clip(1, 2000),
        "return_number": number,
        "number_of_returns": count,
        "truth": truth,
    }
    types = ["u2", "u1", "u1", "u1"]
    xyz = np.column_stack([x + 500_000 + shift, y + 4_600_000, z])
    return PointCloud(
        xyz,
        {name: v.astype(t) for (name, v), t in zip(columns.items(), types, strict=True)},
        crs=UTM,
        name="park.laz",
    )


def accuracy(cloud: PointCloud) -> float:
    return float(np.mean(cloud["classification"] == cloud["truth"]))
