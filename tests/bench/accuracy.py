"""Intervals of accuracies: how often they hold the truth, and how often they see what is not."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from algorithms.compare._paired import mcnemar
from algorithms.shared.accuracy.blocks import LEAST, Clumping, Tallies, blocks, intervals, spread
from tests.bench.measuring import say

RUNS, SIDE, PATCH, WRONG, POINTS = 200, 100.0, 5.0, 0.2, 20_000
RATE = 0.05  # of errors
CELLS, EDGE = 120, 60  # of a field of errors, and around it, so that what reaches in is there
REACHES = {"cut": (0.008, 0.016, 0.03, 0.045), "discs": (0.01, 0.023, 0.035, 0.047)}
RATES = (0.03, 0.2)
FIELDS = 200  # of each kind

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def accuracy() -> None:
    """Points that are wrong in whole patches, by blocks of several sizes, and by McNemar's test."""
    for side in (2.5, 5.0, 10.0, 20.0, 33.4):
        held = differs = 0
        for seed in range(RUNS):
            xy, first, second = _scene(seed)
            pair = [_tallied(xy, of, side) for of in (first, second)]
            low, high = intervals(pair[0], _share, 0)["right"]
            held += bool(low <= 1 - WRONG <= high)
            both = Tallies(np.stack([p.counts for p in pair], 1).astype(float), pair[0].square)
            low, high = spread(both, _apart, 0)["right"]
            differs += not low <= 0 <= high
        say(
            f"accuracy  blocks of {side:4.1f} m: 95 % intervals hold the truth in "
            f"{100 * held / RUNS:5.1f} %, equal ones differ in {100 * differs / RUNS:4.1f} %"
        )
    _of_few_blocks()
    alone = [(f & ~s, s & ~f) for _, f, s in map(_scene, range(RUNS))]
    found = sum(mcnemar(int(a.sum()), int(b.sum()))[1] < 0.05 for a, b in alone)
    say(f"accuracy  McNemar: equal classifications differ in {100 * found / RUNS:.1f} %")


def accuracy_fields(*options: str) -> None:
    """Errors that run on from block to block; `--seed 1000` draws other fields."""
    first = int(options[options.index("--seed") + 1]) if options else 0
    for kind, reaches in REACHES.items():
        for reach in reaches:
            for rate in RATES:
                held, told = _of_fields(kind, reach, rate, first)
                quiet = held[~told]
                say(
                    f"accuracy  {kind:5} of reach {reach:.3f}, {100 * rate:2.0f} % wrong: "
                    f"intervals hold the truth in {100 * held.mean():5.1f} %; told in "
                    f"{100 * told.mean():5.1f} %, hold where not told "
                    f"{100 * quiet.mean() if len(quiet) else np.nan:5.1f} %"
                )


def _of_fields(kind: str, reach: float, rate: float, first: int) -> tuple[Mask, Mask]:
    """Of each field whether the interval holds the truth, and whether a warning is given."""
    draw: Mapping[str, Callable[..., Mask]] = {"cut": _cut, "discs": _discs}
    xy = np.argwhere(np.ones((CELLS, CELLS), bool)).astype(float)
    found = []
    for seed in range(first, first + FIELDS):
        rng = np.random.default_rng((seed, round(1000 * reach), round(100 * rate)))
        tallies = _tallied(xy, ~draw[kind](rng, reach, rate).ravel(), None)
        low, high = intervals(tallies, _share, 0)["right"]
        clumping = Clumping.of(tallies)
        assert clumping is not None
        told = clumping.few or clumping.wide or np.isnan(low)
        found.append((low <= 1 - rate <= high, told))
    held, told = np.array(found, bool).T
    return held, told


def _cut(rng: np.random.Generator, reach: float, rate: float) -> Mask:
    """A field of noise, smoothed by a Gaussian of some share of the width, cut at a level."""
    from scipy.ndimage import gaussian_filter
    from scipy.special import ndtri

    noise = rng.standard_normal((CELLS + 2 * EDGE,) * 2)
    smooth = gaussian_filter(noise, reach * CELLS, mode="wrap")
    impulse = np.zeros_like(noise)
    impulse[EDGE, EDGE] = 1.0
    deviation = np.sqrt((gaussian_filter(impulse, reach * CELLS, mode="wrap") ** 2).sum())
    return np.asarray(smooth[EDGE:-EDGE, EDGE:-EDGE] < deviation * ndtri(rate))


def _discs(rng: np.random.Generator, reach: float, rate: float) -> Mask:
    """Discs of some share of the width as radius, which may overlap."""
    many = -np.log(1 - rate) / (np.pi * reach**2) * (1 + 2 * reach) ** 2
    x, y = (np.indices((CELLS, CELLS)) + 0.5) / CELLS
    wrong = np.zeros((CELLS, CELLS), bool)
    for cx, cy in rng.uniform(-reach, 1 + reach, (rng.poisson(many), 2)):
        wrong |= (x - cx) ** 2 + (y - cy) ** 2 < reach**2
    return wrong


def _of_few_blocks() -> None:
    """Intervals of a rate of 5 % that differs between blocks as an exponential distribution."""
    rng = np.random.default_rng(2)
    for count in (LEAST, 10, 15, 20):
        held = 0
        for _ in range(RUNS):
            wrong = rng.binomial(1000, np.minimum(rng.exponential(RATE, count), 1.0))
            counts = np.zeros((count, 2, 2), np.int64)
            counts[:, 0] = np.column_stack([1000 - wrong, wrong])
            alone = Tallies(counts, np.zeros(count, np.int64))
            low, high = intervals(alone, _share, 0)["right"]
            held += bool(low <= 1 - RATE <= high)
        say(f"accuracy  {count:2d} blocks: intervals hold the truth in {100 * held / RUNS:5.1f} %")


def _scene(seed: int) -> tuple[Floats, Mask, Mask]:
    """Positions, and which of them each of two classifications has right."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, SIDE, (POINTS, 2))
    row, column = np.floor(xy / PATCH).astype(int).T
    shape = (int(SIDE / PATCH),) * 2
    first, second = ((rng.random(shape) >= WRONG)[row, column] for _ in range(2))
    return xy, first, second


def _tallied(xy: Floats, right: Mask, side: float | None) -> Tallies:
    """Matrices of the blocks of points of one class, of which some are given another."""
    ground = blocks(xy, side)
    counts = np.bincount(ground.number * 4 + ~right, minlength=4 * len(ground))
    return Tallies(counts.reshape(-1, 2, 2), ground.square)


def _share(stack: Floats) -> dict[str, Floats]:
    return {"right": stack[..., 0, 0] / stack.sum(axis=(-2, -1))}


def _apart(stack: Floats) -> dict[str, Floats]:
    found = _share(stack)["right"]
    return {"right": found[:, 1] - found[:, 0]}
