"""Patches that classify.suggest chooses against as many by chance, within surveys."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.bench.learning import MERGED, TILES, _described, _learnt, _opened, _percents
from tests.bench.measuring import say

TOWN, LINE = (2, 3, 4, 5, 6), (1, 2, 5, 14, 15)
SURVEYS = {  # classes, and sides of the patches in metres
    "ign_lidarhd_decimated_1km/0382_6565.laz": (TOWN, 5.0),
    "nir_laz/ign_484_6632_rgbnir.laz": (TOWN, 5.0),
    "powerline_ahn4/12BZ1_21_as_published.laz": (LINE, 5.0),
    "powerline_ahn4/12AN2_20_as_published.laz": (LINE, 5.0),
    "ahn3_delft_bgt/ahn3_cropped_2.laz": ((1, 2, 6), 5.0),
    TILES[2]: (TOWN, 2.0),
}
ROUNDS, WANTED = 3, 20

Mask = NDArray[np.bool_]


def suggesting(*options: str) -> None:
    """Three rounds of 20 patches of one half against all of it, judged on the other half."""
    parser = argparse.ArgumentParser("suggesting")
    parser.add_argument("--only", default="", help="part of the names of the surveys")
    parser.add_argument("--draws", type=int, default=3)
    asked = parser.parse_args(options)
    for name in (name for name in SURVEYS if asked.only in name):
        codes, side = SURVEYS[name]
        cloud = _opened(name)
        extent = np.ptp(cloud.xyz[:, :2], axis=0)
        along = cloud.xyz[:, int(extent.argmax())]
        first = along < along.min() + extent.max() / 2
        for which in (first, ~first):
            _half(name, Half(cloud, which, codes, side), asked.draws)


class Half:
    """The half of a survey that is learnt from, and the other one."""

    def __init__(self, cloud: Any, which: Mask, codes: tuple[int, ...], side: float) -> None:
        from algorithms.classify._learning.features import usual
        from algorithms.classify.suggest import Squares

        self.names = usual(cloud, (1.0, 2.0, 4.0))
        data = _described(cloud, self.names)
        judged = ~which & np.isin(cloud["classification"], codes)
        self.pool, self.data, self.asked = cloud.select(which), data[which], data[judged]
        self.label = cloud["classification"][judged].astype(np.int64)
        self.codes, self.squares = codes, Squares.of(self.pool.xyz[:, :2], side)

    def learnt(self, some: Mask, seed: int) -> Any:
        """A model of some points of the pool, and its accuracy and mean F1 in the other half."""
        from sklearn.metrics import f1_score

        job = [self.data], [self.pool], [some], self.codes, self.names
        made = _learnt(*job, block=None if some.all() else self.squares.side, seed=seed)
        given = made.classes[made.probabilities(self.asked).argmax(axis=1)].astype(np.int64)
        true, said = (codes if 14 in self.codes else MERGED[codes] for codes in (self.label, given))
        f1 = f1_score(true, said, average=None, labels=np.unique(true), zero_division=0.0)
        return made, ((true == said).mean(), f1.mean())

    def rounds(self, suggest: bool, seed: int) -> Iterator[tuple[float, float]]:
        """Accuracy and mean F1 after each round of patches, suggested or by chance."""
        from algorithms.classify.suggest import FEWEST, Held, kinds, suggested

        rng, squares = np.random.default_rng(seed), self.squares
        taken, chance = np.zeros(len(squares.count), bool), np.ones((len(self.data), 1))
        for _ in range(ROUNDS):
            free = (squares.count >= FEWEST) & ~taken
            if suggest:
                held = Held.of(squares, kinds(self.pool.xyz, self.data, seed), chance)
                taken[suggested(held, taken, free, WANTED)] = True
            else:
                taken[rng.permutation(np.flatnonzero(free))[:WANTED]] = True
            made, figures = self.learnt(taken[squares.own], seed)
            chance = made.probabilities(self.data)
            yield figures


def _half(name: str, half: Half, draws: int) -> None:
    """Say how all of a half does, and in percent of it what patches do in each draw."""
    full = np.array(half.learnt(np.ones(len(half.data), bool), 0)[1])
    share = ROUNDS * WANTED / len(half.squares.count)
    say(
        f"suggesting  {name}, {100 * share:.1f} % of the ground: all of it has an accuracy of "
        f"{100 * full[0]:.1f} % and a mean F1 of {100 * full[1]:.1f} %"
    )
    for title, how in (("suggested", True), ("by chance", False)):
        after = []
        for seed in range(draws):
            found = np.array(list(half.rounds(how, seed))) / full
            after.append(found)
            say(
                f"suggesting    {title}, seed {seed}, after each round: accuracy "
                f"{_percents(found[:, 0])}, F1 {_percents(found[:, 1])} %"
            )
        for measure, of in (("accuracy", 0), ("F1", 1)):
            each = np.array(after)[:, :, of]
            say(
                f"suggesting    {title}, {measure} after each round: worst of {draws} "
                f"{_percents(each.min(axis=0))}, median {_percents(np.median(each, axis=0))} %"
            )
