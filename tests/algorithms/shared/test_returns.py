"""Return numbers: lists of first and last returns, and numbers that contradict each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.classify.som import ClassifySom
from algorithms.shared.ground import may_be_ground
from algorithms.shared.returns import ReturnNumbers, let_through
from toolbox.data import PointCloud


def pulse(number: Any, count: Any, xyz: Any = None, crs: CRS | None = None) -> PointCloud:
    columns = {"return_number": np.asarray(number), "number_of_returns": np.asarray(count)}
    places = np.arange(3 * len(columns["return_number"])).reshape(-1, 3) if xyz is None else xyz
    return PointCloud(np.asarray(places, float), columns, crs=crs)


def test_returns_in_the_order_of_a_scan() -> None:
    cloud = pulse([1, 1, 2, 3, 0, 5, 0], [1, 3, 3, 3, 0, 1, 2])
    assert let_through(cloud).tolist() == [False, True, True, False, False, False, False]
    assert may_be_ground(cloud, "last").tolist() == [True, False, False, True, True, True, True]
    found = ReturnNumbers.of(cloud)
    assert found.impossible.tolist() == [False] * 5 + [True, True]
    assert not found.in_lists
    assert not let_through(PointCloud(np.zeros((2, 3)))).any()


@pytest.mark.parametrize("crs", [None, CRS(2263)])
def test_pulses_with_one_place_in_both_lists_are_single(crs: CRS | None) -> None:
    metre = 1.0 if crs is None else 3937 / 1200
    xyz = np.array([[0, 0, 9.0], [5, 0, 1], [9, 0, 1], [0, 0, 1], [5, 0, 1.28], [9, 0, 1.35]])
    cloud = pulse([1, 1, 1, 2, 2, 2], [2] * 6, xyz * metre, crs)
    assert let_through(cloud).tolist() == [True, False, True, False, False, False]
    with_single = pulse([1, 1, 1, 2, 2, 1], [2, 2, 2, 2, 2, 1], xyz * metre, crs)
    assert let_through(with_single).tolist() == [True, True, True, False, False, False]


def test_numbers_that_contradict_each_other_are_told(caplog: pytest.LogCaptureFixture) -> None:
    assert not let_through(pulse([5] * 4, [1] * 4)).any()
    text = "4 of 4 points have a return number that cannot be, such as return 5 of 1; they are"
    assert text in caplog.text
    caplog.clear()
    let_through(pulse([0] * 4, [0] * 4))  # not known, as in files that say nothing
    let_through(pulse([5] + [1] * 150, [1] * 151))
    assert not caplog.text


def test_pulses_without_their_last_return_are_told(caplog: pytest.LogCaptureFixture) -> None:
    """Return 1 of 2 of what has one return: no ground is looked for there, so it must be said."""
    may_be_ground(pulse([1] * 100, [2] * 60 + [1] * 40), "last")
    text = "60 points are the first of several returns, but only 0 are a last one: returns are"
    assert text in caplog.text
    assert "all but last returns are no ground, unless returns is all" in caplog.text
    caplog.clear()
    may_be_ground(pulse([1] * 100, [2] * 60 + [1] * 40), "all")
    may_be_ground(pulse([1] * 60 + [2] * 30, [2] * 90), "last")  # half of them is there
    may_be_ground(pulse([1] * 100, [2] + [1] * 99), "last")  # a hundredth
    assert not caplog.text
    may_be_ground(pulse([1] * 60 + [2] * 29, [2] * 89), "last")
    assert "but only 29 are a last one" in caplog.text


def street(rng: np.random.Generator) -> NDArray[np.float64]:
    """A street of 60 x 40 m, and a roof of 12 x 20 m at 8 m, at 4 points per square metre."""
    x, y = rng.uniform(0, (60, 40), (9600, 2)).T
    roof = (abs(x - 40) < 6) & (abs(y - 20) < 10)
    return np.column_stack([x, y, np.where(roof, 8.0, 0.0) + rng.normal(0, 0.02, len(x))])


def test_a_street_in_both_lists_is_no_plant() -> None:
    """With trees beside it, whose pulses have two returns."""
    rng = np.random.default_rng(0)
    last = street(rng)
    first = last + rng.normal(0, 0.02, last.shape)
    tree = last[:, 0] < 8
    first[tree, 2] += rng.uniform(2, 10, tree.sum())
    cloud = pulse(np.repeat([1, 2], len(last)), [2] * 2 * len(last), np.vstack([first, last]))
    found = ClassifySom(points=cloud.with_crs(CRS(32635))).run().classified["classification"]
    of_first, of_last = np.split(found, 2)
    road = (last[:, 0] > 10) & (last[:, 0] < 28)
    assert (of_first[road] == 2).mean() > 0.99
    assert (of_last[road] == 2).mean() > 0.99
    assert (of_first[tree] == 5).mean() > 0.9
    assert (of_first[last[:, 2] > 4] == 6).mean() > 0.9


def test_numbers_of_eight_bits_are_as_those_of_more() -> None:
    number, count = np.array([1, 1, 2, 255, 0, 5, 0]), np.array([1, 2, 2, 255, 0, 1, 2])
    wide = pulse(number, count)
    narrow = pulse(number.astype(np.uint8), count.astype(np.uint8))
    assert ReturnNumbers.of(narrow).number.dtype == np.int16
    assert ReturnNumbers.of(narrow).number.tolist() == number.tolist()
    np.testing.assert_array_equal(let_through(narrow), let_through(wide))
