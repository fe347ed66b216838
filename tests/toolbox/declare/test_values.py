"""Class lists, ranges and extents: text forms, round trips, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from toolbox.declare import ClassList, Extent, Position, Range

finite = st.floats(allow_nan=False, allow_infinity=False)


def test_class_list_reads_numbers_and_ranges_in_any_order() -> None:
    assert ClassList.parse("14-16, 2,9,2") == (2, 9, 14, 15, 16)
    assert str(ClassList([16, 2, 14, 15, 9])) == "2,9,14-16"
    assert ClassList.parse([9, 2.0, "7"]) == (2, 7, 9)
    assert ClassList.parse(2) == (2,)
    with pytest.raises(ValueError, match=r"2\.5 is no whole number"):
        ClassList.parse([2.5])


@given(st.sets(st.integers(0, 255), min_size=1))
def test_class_list_round_trip(classes: set[int]) -> None:
    made = ClassList(classes)
    assert set(made) == classes
    assert ClassList.parse(str(made)) == made


@pytest.mark.parametrize(
    "text", ["", "256", "5-2", "-1", "two", "2,,3", "2.5", "1-2-3", "2-", "0-99999999999", "\uff12"]
)
def test_class_list_refuses(text: str) -> None:
    with pytest.raises(ValueError, match=r"is no class|is not a range"):
        ClassList.parse(text)


def test_class_list_of_arrays_and_bytes() -> None:
    assert ClassList.parse(np.array(2)) == ClassList.parse(np.uint8(2)) == (2,)
    assert ClassList.parse(np.array([9, 2], np.uint8)) == (2, 9)
    for value in (b"2,9", bytearray(b"2,9")):  # which were 44, 50 and 57
        with pytest.raises(ValueError, match="is no whole number"):
            ClassList.parse(value)
    with pytest.raises(ValueError, match="needs 2 numbers"):
        Position.parse(b"12")
    with pytest.raises(ValueError, match=r"2\.5 is no whole number"):
        ClassList.parse(np.array(2.5))


@given(finite, finite)
def test_range_keeps_order(a: float, b: float) -> None:
    if a <= b:
        assert Range.parse([a, b]) == (a, b)
    else:
        with pytest.raises(ValueError, match="above the upper"):
            Range.parse([a, b])


def test_extent_round_trip_and_order() -> None:
    box = Extent.parse("-5.25, 0 , 7e5, 8")
    assert box == (-5.25, 0, 7e5, 8)
    assert Extent.parse(str(box)) == box


def test_position_round_trip_and_refusals() -> None:
    position = Position.parse("500000.125, -7e5")
    assert position == (500000.125, -7e5)
    assert Position.parse(str(position)) == position
    with pytest.raises(ValueError, match="needs 2"):
        Position.parse("1,2,3")
    with pytest.raises(ValueError, match="finite"):
        Position.parse([1, float("nan")])


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("1,2,3", "needs 4"),
        ("1,2,1,4", "xmin must"),
        ("0,0,nan,1", "finite"),
        ("0,0,inf,1", "finite"),
    ],
)
def test_extent_refuses(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        Extent.parse(text)


@pytest.mark.parametrize("text", ["1", "1,2,3", "1,x"])
def test_range_refuses(text: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        Range.parse(text)
