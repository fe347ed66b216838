"""points.filter_intensity: the thresholds of each method, against hand calculation and search."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS

from algorithms.points.filter_intensity import PointsFilterIntensity
from algorithms.shared.otsu import otsu_threshold
from toolbox.data import PointCloud
from toolbox.errors import DataError, ParameterError


def cloud(intensity: Any) -> PointCloud:
    values = np.asarray(intensity, np.uint16)
    xyz = np.column_stack([np.arange(len(values)), np.zeros((len(values), 2))]).astype(float)
    return PointCloud(xyz, {"intensity": values}, crs=CRS(32635))


def with_gaps() -> PointCloud:
    """As from a text file that lacks two intensities."""
    intensity = np.array([1.0, np.nan, 3.0, np.nan, 2.0])
    return PointCloud(np.zeros((5, 3)), {"intensity": intensity}, crs=CRS(32635))


def test_default_is_the_threshold_of_the_shoreline_study() -> None:
    out = PointsFilterIntensity(points=cloud([0, 39, 40, 41, 65535])).run()
    assert list(out.kept["intensity"]) == [40, 41, 65535]
    assert (out.threshold, out.removed_share) == (40, pytest.approx(0.4))


def test_a_limit_for_another_scale_is_told(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("WARNING", "toolbox"):
        PointsFilterIntensity(points=cloud([399, 41])).run()
        assert not caplog.text
        PointsFilterIntensity(points=cloud([400, 65535])).run()
    assert "40 is far below all intensities, which begin at 400" in caplog.text


def test_limits_on_both_sides() -> None:
    job = PointsFilterIntensity(points=cloud([1, 2, 3, 4]), minimum=2.0, maximum=3.0)
    assert list(job.run().kept["intensity"]) == [2, 3]
    job = PointsFilterIntensity(points=cloud([1, 2, 3, 4]), minimum=None, maximum=3.0)
    assert list(job.run().kept["intensity"]) == [1, 2, 3]
    assert job.run().threshold is None


def test_percentile() -> None:
    job = PointsFilterIntensity(
        points=cloud(range(101)), method="percentile", minimum=10.0, maximum=90.0
    )
    out = job.run()
    assert (out.kept["intensity"].min(), out.kept["intensity"].max()) == (10, 90)
    assert out.threshold == 10


def test_otsu_splits_two_groups() -> None:
    rng = np.random.default_rng(0)
    water, land = rng.normal(20, 4, 3000), rng.normal(90, 15, 5000)
    points = cloud(np.clip(np.concatenate([water, land]), 0, None))
    out = PointsFilterIntensity(points=points, method="otsu").run()
    assert out.threshold == pytest.approx(50, abs=8)
    assert out.removed_share == pytest.approx(3 / 8, abs=0.01)


@given(st.lists(st.integers(0, 40), min_size=2, max_size=60).filter(lambda v: len(set(v)) > 1))
def test_otsu_is_the_best_of_all_splits(values: list[int]) -> None:
    array = np.array(values)

    def between(threshold: float) -> float:
        low, high = array[array < threshold], array[array >= threshold]
        return float(len(low) * len(high) * (high.mean() - low.mean()) ** 2)

    best = max(between(level) for level in np.unique(array)[1:])
    assert between(otsu_threshold(array)) == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize("method", ["percentile", "otsu"])
def test_missing_intensities_have_no_rank(method: Any) -> None:
    with pytest.raises(DataError, match=r"points: 2 of 5 intensities are not a number \(NaN\)"):
        PointsFilterIntensity(points=with_gaps(), method=method).run()


@pytest.mark.parametrize("limits", [{"minimum": 2.0}, {"minimum": None, "maximum": 2.5}])
def test_missing_intensities_are_removed_and_said(
    limits: Any, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level("WARNING", "toolbox"):
        out = PointsFilterIntensity(points=with_gaps(), **limits).run()
    assert len(out.kept) == 2
    assert out.removed_share == pytest.approx(3 / 5)
    assert "2 points without an intensity (NaN) are removed" in caplog.text


def test_no_points_have_nothing_removed() -> None:
    out = PointsFilterIntensity(points=cloud([])).run()
    assert (len(out.kept), out.removed_share) == (0, 0)


def test_one_intensity_cannot_be_split() -> None:
    with pytest.raises(DataError, match="all intensities are 7"):
        PointsFilterIntensity(points=cloud([7, 7, 7]), method="otsu").run()


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"minimum": 50.0, "maximum": 40.0}, r"minimum: must be <= maximum \(40\), got 50"),
        ({"minimum": None}, "minimum: give a minimum, a maximum or both"),
        ({"method": "percentile", "minimum": 101.0}, "minimum: must be <= 100"),
    ],
)
def test_limits_that_do_not_fit(parameters: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        PointsFilterIntensity(points=cloud([1, 2]), **parameters)


def test_points_without_intensity() -> None:
    bare = PointCloud(np.zeros((2, 3)), crs=CRS(32635), name="bare.xyz")
    with pytest.raises(DataError, match=r"bare\.xyz has no intensity"):
        PointsFilterIntensity(points=bare)


def test_halo() -> None:
    assert PointsFilterIntensity(points=cloud([1, 2])).halo() == 0
    assert PointsFilterIntensity(points=cloud([1, 2]), method="otsu").halo() == math.inf


def test_real_water_is_darker_than_land(data: Callable[[str], Path]) -> None:
    """On the sea dam, an Otsu split removes a larger share of class 9 than of the rest."""
    points = PointCloud.open(data("water_denoever_ahn3/AHN3.laz"))
    out = PointsFilterIntensity(points=points, method="otsu").run()
    before, after = (
        np.array([(c["classification"] == 9).sum(), (c["classification"] != 9).sum()])
        for c in (points, out.kept)
    )
    water_left, land_left = after / before
    assert water_left < land_left
