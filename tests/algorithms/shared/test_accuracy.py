"""Measures of confusion matrices, samples drawn by class, and intervals from blocks."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from algorithms.shared.accuracy.blocks import (
    DRAWS,
    Clumping,
    Tallies,
    blocks,
    drawn,
    intervals,
)
from algorithms.shared.accuracy.confusion import Confusion, class_measures, measures
from algorithms.shared.accuracy.samples import Estimates
from toolbox.errors import DataError

STUDY = Confusion(  # Şen and Bayaslı (2020), rows of the reference
    ("building", "vegetation", "ground"),
    np.array([[13068, 1123, 3630], [82, 8840, 1943], [1631, 418, 15703]]),
)


def random_matrix(seed: int, size: int = 5) -> NDArray[np.int64]:
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 90, (size, size)) + np.diag(rng.integers(0, 900, size))
    if seed % 3 == 1:
        counts[:, 2] = 0  # a class that is never given
    if seed % 3 == 2:
        counts[2] = 0  # a class that is not in the reference
    return np.asarray(counts)


def test_figures_of_the_som_study() -> None:
    found, each = STUDY.measures(), STUDY.class_measures()
    assert found["overall_accuracy"] == pytest.approx(80.99, abs=0.005)
    assert found["kappa"] == pytest.approx(0.708, abs=0.0005)
    assert each["producers_accuracy"] == pytest.approx([73.33, 81.36, 88.46], abs=0.005)
    assert each["users_accuracy"] == pytest.approx([88.41, 85.16, 73.81], abs=0.005)


@pytest.mark.parametrize("seed", range(6))
def test_stacks_of_matrices_have_the_figures_of_scikit_learn(seed: int) -> None:
    counts = random_matrix(seed)
    stack = np.stack([counts, 3 * counts]).astype(float)
    one = Confusion(("a", "b", "c", "d", "e"), counts)
    for name, value in one.measures().items():
        assert measures(stack)[name] == pytest.approx([value, value]), name
    for name, values in one.class_measures().items():
        expected = [np.nan if value is None else value for value in values]
        np.testing.assert_allclose(class_measures(stack)[name][1], expected, err_msg=name)


def test_disagreement_of_quantity_and_allocation_make_up_all_errors() -> None:
    found = STUDY.measures()
    assert found["overall_accuracy"] is not None
    parts = found["quantity_disagreement"], found["allocation_disagreement"]
    assert sum(part or 0 for part in parts) == pytest.approx(100 - found["overall_accuracy"])
    moved = Confusion(("a", "b"), np.array([[40, 10], [10, 40]])).measures()
    assert (moved["quantity_disagreement"], moved["allocation_disagreement"]) == (0, 20)
    grown = Confusion(("a", "b"), np.array([[40, 20], [0, 40]])).measures()
    assert (grown["quantity_disagreement"], grown["allocation_disagreement"]) == (20, 0)


def test_what_is_not_defined_is_none() -> None:
    alone = Confusion(("a",), np.array([[7]]))
    assert alone.measures()["kappa"] is None
    assert alone.measures()["mcc"] is None
    assert Confusion((), np.zeros((0, 0), int)).measures()["overall_accuracy"] is None
    given = Confusion(("a", "b"), np.array([[7, 1], [0, 0]])).class_measures()
    assert given["producers_accuracy"][1] is None
    assert given["users_accuracy"][1] == 0


def test_the_example_of_olofsson() -> None:
    """Section 4.3: deforestation, gain, stable forest, stable non-forest, in pixels of 0.09 ha."""
    counts = np.array([[66, 0, 1, 2], [0, 55, 0, 1], [5, 8, 153, 9], [4, 12, 11, 313]])
    mapped = np.array([200_000, 150_000, 3_200_000, 6_450_000.0])
    found = Estimates.of(counts, mapped)
    assert found.overall.value == pytest.approx(0.95, abs=0.005)
    assert 1.96 * found.overall.error == pytest.approx(0.02, abs=0.005)
    assert 1.96 * found.users.error == pytest.approx([0.07, 0.10, 0.04, 0.02], abs=0.005)
    assert found.producers.value == pytest.approx([0.75, 0.85, 0.93, 0.96], abs=0.005)
    assert 1.96 * found.producers.error == pytest.approx([0.21, 0.25, 0.03, 0.02], abs=0.005)
    hectares = 0.09 * mapped.sum()
    assert found.share.value[0] * hectares == pytest.approx(21_158, abs=1)
    assert 1.96 * found.share.error[0] * hectares == pytest.approx(6_158, abs=1)


def test_blocks_do_not_depend_on_the_order_and_are_about_a_hundred() -> None:
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 1000, (5000, 2))
    xy = xy[np.abs(xy[:, 0] - xy[:, 1]) < 100]  # a slanted corridor
    found = blocks(xy, None)
    number, side = found.number, found.side
    assert len(found) == number.max() + 1
    assert len(found) / 4 < found.square.max() + 1 < len(found) / 2
    assert 60 < number.max() + 1 < 160
    order = rng.permutation(len(xy))
    np.testing.assert_array_equal(blocks(xy[order], None).number, number[order])
    assert blocks(xy, 2 * side).number.tolist() == found.square[number].tolist()
    assert blocks(np.zeros((4, 2)), None).number.tolist() == [0, 0, 0, 0]
    with pytest.raises(DataError, match=r"block: .* blocks hold points, at most 10,000"):
        blocks(rng.uniform(0, 1000, (20_000, 2)), 1.0)


def clumps(seed: int, side: float) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Points on 200 m, of which those of whole patches of some metres are wrong, by chance."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 200, (4000, 2))
    patch = np.floor(xy / side).astype(int)
    wrong = rng.random((patch.max() + 1,) * 2) < 0.2
    return xy, wrong[patch[:, 0], patch[:, 1]]


def tallied(xy: NDArray[np.float64], wrong: NDArray[np.bool_], side: float) -> Tallies:
    """Matrices of blocks of points of one class, of which some are given another one."""
    ground = blocks(xy, side)
    counts = np.bincount(ground.number * 4 + wrong, minlength=4 * len(ground))
    return Tallies(counts.reshape(-1, 2, 2), ground.square)


def covered(block: float, patch: float = 10.0, runs: int = 60) -> float:
    """Share of scenes whose interval of the overall accuracy holds the true 80 %."""
    held = 0
    for seed in range(runs):
        xy, wrong = clumps(seed, patch)
        low, high = intervals(tallied(xy, wrong, block), measures, seed)["overall_accuracy"]
        held += bool(low <= 80 <= high)
    return held / runs


@pytest.mark.slow
def test_intervals_hold_the_truth_if_blocks_are_larger_than_clumps_of_errors() -> None:
    assert covered(20.0) > 0.88
    assert covered(1.99, runs=20) < 0.8  # as if neighbours were independent


def alone(counts: NDArray[np.int64]) -> Tallies:
    """Blocks of which no four make a square."""
    return Tallies(counts, np.zeros(len(counts), np.int64))


def test_draws_are_those_of_the_seed_and_of_whole_blocks() -> None:
    by_block = np.arange(3 * 4).reshape(3, 2, 2)
    first, again = (np.concatenate([*drawn(by_block, 5)]) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert len(first) == DRAWS
    assert not np.array_equal(first, np.concatenate([*drawn(by_block, 6)]))
    low, high = intervals(alone(by_block[:1]), measures, 0)["overall_accuracy"]
    assert np.isnan(low)
    assert np.isnan(high)


def test_no_interval_is_made_of_few_blocks_or_of_blocks_that_are_all_alike() -> None:
    block = np.array([[5, 1], [0, 4]])

    def share(stack: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        return {"right": stack[:, [0, 1], [0, 1]].sum(axis=1) / stack.sum(axis=(1, 2))}

    differing = np.array([block + np.array([[0, k % 3], [0, 0]]) for k in range(8)])
    low, high = intervals(alone(differing), share, 0)["right"]
    assert low < high
    for given in (differing[:-1], np.array([block] * 50)):
        assert np.isnan(intervals(alone(given), share, 0)["right"]).all()


def board(same: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """A point on each of 20 x 20 m, of which 20 % are wrong in patches of `same` by `same`."""
    x, y = np.indices((20, 20)).reshape(2, -1)
    wrong = np.random.default_rng(3).permutation(400).reshape(20, 20) % 5 == 0
    return np.column_stack([x, y]).astype(float), wrong[x // same, y // same]


def test_errors_wider_than_blocks_widen_the_interval_and_are_told() -> None:
    apart, wide = (tallied(*board(same), 1.0) for same in (1, 4))
    assert 0.7 < Clumping.of(apart).growth < 1.4  # type: ignore[union-attr]
    found = Clumping.of(wide)
    assert found is not None
    assert found.growth == pytest.approx(4, rel=0.02)  # all four blocks of a square are alike
    assert found.wide
    assert not Clumping.of(apart).wide  # type: ignore[union-attr]
    assert not Clumping.of(apart).few  # type: ignore[union-attr]
    assert found.clumps < 0.25 * Clumping.of(apart).clumps  # type: ignore[union-attr]
    blind = Tallies(wide.joined(), np.zeros(len(wide.joined()), np.int64))
    (low, high), (least, most) = (
        intervals(of, measures, 0)["overall_accuracy"] for of in (wide, blind)
    )
    # that squares of four vary more than blocks says that what is larger will vary still more
    assert high - low > 1.25 * (most - least)


def test_clumping_is_not_known_of_few_blocks_or_without_errors() -> None:
    xy, wrong = board(1)
    assert Clumping.of(tallied(xy, wrong, 5.0)) is None  # 16 blocks are 4 squares
    none = Clumping.of(tallied(xy, np.zeros_like(wrong), 1.0))
    assert none is not None
    assert np.isnan(none.clumps)
    assert not none.few


def test_few_clumps_of_errors_are_told() -> None:
    x, y = np.indices((20, 20)).reshape(2, -1)
    xy = np.column_stack([x, y]).astype(float)
    for places, few in ((3, True), (30, False)):
        wrong = np.zeros((20, 20), bool)
        wrong.ravel()[np.random.default_rng(0).permutation(400)[:places]] = True
        found = Clumping.of(tallied(xy, wrong.ravel(), 1.0))
        assert found is not None
        assert found.few == few
        assert found.clumps == pytest.approx(places, rel=0.4)


@pytest.mark.slow
def test_intervals_hold_the_truth_if_clumps_of_errors_are_wider_than_blocks() -> None:
    assert covered(10.0, patch=18.0) > 0.82  # 0.68 without the squares of four
