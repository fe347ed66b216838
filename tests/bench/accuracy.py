"""Intervals of accuracies: how often they hold the truth, and how often they see what is not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from algorithms.compare._paired import mcnemar
from algorithms.shared.accuracy.blocks import LEAST, blocks, limits, percentiles
from tests.bench.measuring import say

RUNS, SIDE, PATCH, WRONG, POINTS, DRAWS = 400, 100.0, 5.0, 0.2, 20_000, 1000
RATE = 0.05  # of errors


def accuracy() -> None:
    """Points that are wrong in whole patches, by blocks of several sizes, and by McNemar's test."""
    for side in (2.5, 5.0, 10.0, 20.0, 33.4):
        held = differs = 0
        for seed in range(RUNS):
            xy, first, second = _scene(seed)
            number, _ = blocks(xy, side)
            low, high = _interval(number, first.astype(float))
            held += bool(low <= 1 - WRONG <= high)
            low, high = _interval(number, second.astype(float) - first)
            differs += not low <= 0 <= high
        say(
            f"accuracy  blocks of {side:4.1f} m: 95 % intervals hold the truth in "
            f"{100 * held / RUNS:5.1f} %, equal ones differ in {100 * differs / RUNS:4.1f} %"
        )
    _of_few_blocks()
    alone = [(f & ~s, s & ~f) for _, f, s in map(_scene, range(RUNS))]
    found = sum(mcnemar(int(a.sum()), int(b.sum()))[1] < 0.05 for a, b in alone)
    say(f"accuracy  McNemar: equal classifications differ in {100 * found / RUNS:.1f} %")


def _of_few_blocks() -> None:
    """Intervals of a rate of 5 % that differs between blocks as an exponential distribution."""
    rng = np.random.default_rng(2)
    for count in (4, 5, 6, LEAST, 15):
        held = 0
        for _ in range(RUNS):
            wrong = rng.binomial(1000, np.minimum(rng.exponential(RATE, count), 1.0))
            times = rng.multinomial(count, np.full(count, 1 / count), DRAWS)
            low, high = np.percentile(times @ wrong / (1000 * count), percentiles(count))
            held += bool(low <= RATE <= high)
        say(f"accuracy  {count:2d} blocks: intervals hold the truth in {100 * held / RUNS:5.1f} %")


def _scene(seed: int) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Positions, and which of them each of two classifications has right."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, SIDE, (POINTS, 2))
    row, column = np.floor(xy / PATCH).astype(int).T
    shape = (int(SIDE / PATCH),) * 2
    first, second = ((rng.random(shape) >= WRONG)[row, column] for _ in range(2))
    return xy, first, second


def _interval(number: NDArray[np.int64], values: NDArray[np.float64]) -> tuple[float, float]:
    """Interval of the mean of values, by blocks that are drawn with replacement."""
    total, count = np.bincount(number, values), np.bincount(number)
    rng, several = np.random.default_rng(0), len(total)
    times = rng.multinomial(several, np.full(several, 1 / several), DRAWS)
    low, high = limits((times @ total) / (times @ count), count)
    return float(low), float(high)
