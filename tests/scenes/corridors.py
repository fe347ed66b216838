"""Small clouds of power lines, and of what looks like them, with known truth."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.corridor._curves.catenary import Catenary
from toolbox.data import PointCloud

Floats = NDArray[np.float64]
CORNER = np.array([500_000.0, 4_400_000.0, 100.0])


def ground(length: float, width: float, density: float, seed: int = 0) -> Floats:
    """Gently rolling ground around the x axis."""
    rng = np.random.default_rng(seed)
    n = int(length * width * density)
    x, y = rng.uniform(-20, length + 20, n), rng.uniform(-width / 2, width / 2, n)
    return np.column_stack([x, y, np.sin(x / 40) + rng.normal(0, 0.03, n)])


def wire(
    start: Sequence[float],
    end: Sequence[float],
    c: float,
    per_metre: float = 4.0,
    seed: int = 0,
    noise: float = 0.03,
) -> tuple[Catenary, Floats]:
    """A wire between two places, and points on it."""
    rng = np.random.default_rng(seed + int(1000 * abs(start[1]) + 10 * start[2] + start[0]))
    a, b = np.array(start, float), np.array(end, float)
    length = float(np.hypot(*(b - a)[:2]))
    ex, ey = (b - a)[:2] / length
    curve = Catenary(a[0], a[1], ex, ey, length, a[2], b[2], 1 / c)
    u = np.sort(rng.uniform(0, length, int(per_metre * length)))
    return curve, curve.points(u) + rng.normal(0, noise, (len(u), 3))


def bar(
    start: Sequence[float],
    end: Sequence[float],
    per_metre: float,
    noise: float = 0.05,
    seed: int = 0,
) -> Floats:
    """Points along a straight bar."""
    rng = np.random.default_rng(seed)
    a, b = np.array(start, float), np.array(end, float)
    t = rng.uniform(0, 1, max(1, int(per_metre * np.linalg.norm(b - a))))
    return a + t[:, None] * (b - a) + rng.normal(0, noise, (len(t), 3))


def pole(x: float, y: float, top: float, per_metre: float = 6.0, half: float = 1.2) -> Floats:
    """A pole with an arm along y just below its top."""
    post = bar((x, y, 0.0), (x, y, top), per_metre, 0.08)
    arm = bar((x, y - half, top - 0.4), (x, y + half, top - 0.4), 3 * per_metre, 0.05)
    return np.vstack([post, arm])


def tree(x: float, y: float, top: float, radius: float, count: int, seed: int = 0) -> Floats:
    """A ball of leaves."""
    rng = np.random.default_rng(seed)
    step = rng.normal(0, 1, (count, 3))
    step *= (rng.uniform(0, 1, count) ** (1 / 3) / np.linalg.norm(step, axis=1))[:, None]
    return np.array([x, y, top - radius]) + radius * step


def line(
    positions: Sequence[float],
    offsets: Sequence[float],
    height: float,
    c: float,
    per_metre: float = 4.0,
) -> tuple[list[Catenary], list[Floats], Floats]:
    """Wires along the x axis between poles: curves, their points, and points of the poles."""
    curves, points = [], []
    for k, (a, b) in enumerate(itertools.pairwise(positions)):
        for offset in offsets:
            made = wire((a, offset, height), (b, offset, height), c, per_metre, seed=k)
            curves.append(made[0])
            points.append(made[1])
    half = max(map(abs, offsets)) + 0.3
    return curves, points, np.vstack([pole(x, 0.0, height + 0.5, half=half) for x in positions])


def cloud(*parts: Floats, classes: Sequence[int] | None = None) -> PointCloud:
    """One cloud of several parts, with their classes as truth."""
    truth = np.repeat(classes or [0] * len(parts), [len(part) for part in parts]).astype(np.uint8)
    return PointCloud(np.vstack(parts) + CORNER, {"truth": truth}, crs=CRS(32635), name="line.laz")


def unlabelled(points: PointCloud) -> PointCloud:
    """The same points, of which none is classified."""
    return points.with_attributes({"classification": np.ones(len(points), np.uint8)})


def quality(said: Floats, true: Floats) -> float:
    """Share of points that are both among those that are either; masks of shape (n,)."""
    return float((said & true).sum() / (said | true).sum())


def in_hills(
    bundle: Sequence[tuple[float, float]],
    noise: float,
    per_metre: float,
    slope: float,
    beside: Sequence[Floats] = (),
) -> PointCloud:
    """Three phases of bundles on three long spans up a slope, which wander by 3 cm along them.

    They hang by strings of 6 m.

    Parameters
    ----------
    bundle : where the subconductors are, aside and up, metres
    noise : of heights; two fifths of it aside
    per_metre : points of each subconductor
    beside : what else is there
    """
    rng, towers = np.random.default_rng(5), (0, 430, 850, 1270)

    def rise(x: Floats | float) -> Floats:
        return np.asarray(slope * np.asarray(x) + 15 * np.sin(np.asarray(x) / 150))

    x, y = rng.uniform(-20, 1290, 240_000), rng.uniform(-40, 80, 240_000)
    parts = [np.column_stack([x, y, rise(x) + rng.normal(0, 0.08, len(x))])]
    for (a, b), phase in itertools.product(itertools.pairwise(towers), (-13.4, 0.0, 13.4)):
        knots = np.arange(a, b + 26, 25.0)
        stray = rng.normal(0, 0.03, len(knots))
        for aside, up in bundle:
            ends = [(t, phase + aside, float(rise(t)) + 35 + up) for t in (a, b)]
            points = wire(*ends, 1500, per_metre, noise=0.0)[1]
            points += rng.normal(0, 1, points.shape) * [0, 0.4 * noise, noise]
            points[:, 2] += np.interp(points[:, 0], knots, stray)
            parts.append(points)
    wires = len(parts) - 1
    for t in towers:
        foot = float(rise(t))
        legs = [
            bar((t + i, j, foot), (t + 0.3 * i, 0.3 * j, foot + 41), 4, 0.1)
            for i in (-3, 3)
            for j in (-3, 3)
        ]
        parts.append(np.vstack([*legs, bar((t, -15, foot + 41), (t, 15, foot + 41), 10, 0.2)]))
    classes = [2, *[14] * wires, *[15] * len(towers), *[0] * len(beside)]
    return cloud(*parts, *beside, classes=classes)
