"""points.filter: each condition by itself, together, and on points that lack what it asks for."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pyproj import CRS

from algorithms.points.filter import PointsFilter
from algorithms.shared.returns import ReturnNumbers
from algorithms.shared.selection import return_mask
from toolbox.data import PointCloud
from toolbox.declare import ClassList, Expression, Range
from toolbox.errors import DataError, ParameterError


def cloud(**columns: Any) -> PointCloud:
    base: dict[str, Any] = {
        "classification": np.array([2, 2, 6, 14, 7], np.uint8),
        "return_number": np.array([1, 2, 1, 1, 2], np.uint8),
        "number_of_returns": np.array([1, 2, 2, 3, 3], np.uint8),
        "intensity": np.array([10, 20, 30, 40, 50], np.uint16),
    }
    xyz = np.array([[0, 0, 5.0], [1, 0, 5.2], [2, 0, 5.3], [3, 0, 9], [4, 0, -90]])
    return PointCloud(xyz, base | columns, crs=CRS(32635), name="a.laz")


def kept(**parameters: Any) -> list[int]:
    """Which of the five points stay."""
    out = PointsFilter(points=cloud(), **parameters).run()
    assert out.removed_share == pytest.approx(1 - len(out.kept) / 5)
    return [int(x) for x in out.kept["x"]]


def test_no_points_have_nothing_removed() -> None:
    out = PointsFilter(points=cloud().select([])).run()
    assert (len(out.kept), out.removed_share) == (0, 0)


def test_without_conditions_all_points_stay() -> None:
    assert kept() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"classes": ClassList([2, 6])}, [0, 1, 2]),
        ({"where": Expression("intensity >= 30 and x < 4")}, [2, 3]),
        ({"returns": "first"}, [0, 2, 3]),
        ({"returns": "last"}, [0, 1]),
        ({"returns": "only"}, [0]),
        ({"returns": "intermediate"}, [4]),
        ({"returns": "first_of_many"}, [2, 3]),
        ({"returns": "last_of_many"}, [1]),
        ({"elevation_above_lowest": Range(0, 10)}, [4]),
        # The band is measured above the lowest point that meets the other conditions.
        ({"elevation_above_lowest": Range(0, 0.2), "classes": ClassList([2, 6])}, [0, 1]),
        ({"elevation_above_lowest": Range(0.1, 0.31), "where": Expression("z > 0")}, [1, 2]),
        ({"classes": ClassList([99])}, []),
    ],
)
def test_conditions(parameters: dict[str, Any], expected: list[int]) -> None:
    assert kept(**parameters) == expected


def test_band_in_feet_is_given_in_metres() -> None:
    foot = 1200 / 3937
    xyz = np.array([[0, 0, 0], [1, 0, 0.2 / foot], [2, 0, 0.2 / foot + 0.01]])
    points = PointCloud(xyz, crs=CRS(2263))
    out = PointsFilter(points=points, elevation_above_lowest=Range(0, 0.2)).run()
    assert len(out.kept) == 2


def test_withheld_points_do_not_tell_the_lowest() -> None:
    points = cloud(withheld=np.array([0, 0, 0, 0, 1], np.uint8))
    out = PointsFilter(points=points, elevation_above_lowest=Range(0, 0.2)).run()
    assert out.kept["z"].tolist() == [5.0, 5.2]


def test_halo_tells_tiles_whether_one_point_decides_for_all() -> None:
    assert PointsFilter(points=cloud()).halo() == 0
    assert PointsFilter(points=cloud(), elevation_above_lowest=Range(0, 1)).halo() == math.inf


def test_return_numbers_that_are_all_zero_are_no_returns() -> None:
    nothing = np.zeros(5, np.uint8)
    points = cloud(return_number=nothing, number_of_returns=nothing)
    with pytest.raises(DataError, match="no point has a valid return number"):
        PointsFilter(points=points, returns="last").run()
    assert len(PointsFilter(points=points).run().kept) == 5


def test_a_band_above_an_error_is_told(caplog: pytest.LogCaptureFixture) -> None:
    z = np.concatenate([np.linspace(5, 6, 2000), [-90.0]])
    points = PointCloud(np.column_stack([z, z, z]), {}, crs=CRS(32635))
    with caplog.at_level("WARNING", "toolbox"):
        PointsFilter(points=points, elevation_above_lowest=Range(0, 0.5)).run()
        assert "only 1 of 2001 points lie in the band above the lowest" in caplog.text
        caplog.clear()
        PointsFilter(points=points.select(z > 0), elevation_above_lowest=Range(0, 0.5)).run()
        assert not caplog.text


def test_invalid_return_numbers_are_left_out_and_said(caplog: pytest.LogCaptureFixture) -> None:
    found = ReturnNumbers(np.array([0, 1, 3]), np.array([0, 1, 2]))
    with caplog.at_level("WARNING", "toolbox"):
        assert list(return_mask(found, "last")) == [False, True, False]
    assert "2 points have an invalid return number" in caplog.text
    assert "no pulse has a single return" not in caplog.text


def test_single_returns_of_lists_of_first_and_last_ones(caplog: pytest.LogCaptureFixture) -> None:
    found = ReturnNumbers(np.array([1, 1, 2, 2]), np.array([2, 2, 2, 2]))
    assert list(return_mask(found, "last")) == [False, False, True, True]
    assert not caplog.text
    assert not return_mask(found, "only").any()
    assert "no pulse has a single return" in caplog.text


def test_missing_attributes_are_named() -> None:
    bare = PointCloud(np.zeros((2, 3)), crs=CRS(32635), name="bare.xyz")
    with pytest.raises(DataError, match=r"classes: bare\.xyz has no classification"):
        PointsFilter(points=bare, classes=ClassList([2]))
    with pytest.raises(DataError, match=r"returns: bare\.xyz has no return numbers"):
        PointsFilter(points=bare, returns="last")
    with pytest.raises(ParameterError, match="no attribute 'intensity'"):
        PointsFilter(points=bare, where=Expression("intensity > 1"))
