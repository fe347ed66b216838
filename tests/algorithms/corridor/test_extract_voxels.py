"""corridor.extract_voxels: what the chain of the thesis finds, and what it cannot."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import CRS
from scenes.corridors import cloud, ground, line, quality

from algorithms.corridor.extract_voxels import CorridorExtractVoxels, otsu
from toolbox.data import PointCloud

GROUND = ground(200, 60, 8)


@pytest.fixture(scope="module")
def points() -> PointCloud:
    """Two spans of three wires, 32 m above the ground."""
    _, wires, towers = line([0, 90, 180], [-6, 0, 6], 32, 900, per_metre=8)
    return cloud(GROUND, *wires, towers, classes=[2, *[14] * 6, 15])


def test_high_wires_are_found_with_low_variance_only(points: PointCloud) -> None:
    shares = {}
    for variance in ("low", "high"):
        result = CorridorExtractVoxels(points=points, variance=variance).run()
        shares[variance] = quality(result.classified["classification"] == 14, points["truth"] == 14)
    assert shares["low"] > 0.6
    assert shares["high"] < 0.2


def test_points_on_a_catenary_have_its_numbers(points: PointCloud) -> None:
    result = CorridorExtractVoxels(points=points).run()
    found, frame = result.classified, result.wires.frame
    assert result.span_count == frame.span_id.nunique() > 0
    numbered = found["span_id"] > 0
    assert numbered.any()
    assert set(found["span_id"][numbered]) <= set(frame.span_id)
    assert (found["classification"][found["wire_id"] > 0] == 14).all()
    assert (found["wire_id"][numbered] > 0).all()


def test_wires_below_the_height_are_not_found(points: PointCloud) -> None:
    result = CorridorExtractVoxels(points=points, height=40.0).run()
    assert not np.isin(result.classified["classification"], (14, 15)).any()
    assert (result.span_count, len(result.wires)) == (0, 0)


def test_feet_give_the_wires_of_metres(points: PointCloud) -> None:
    foot = 1200 / 3937
    feet = PointCloud(points.xyz / foot, {"truth": points["truth"]}, crs=CRS(2263))
    one, other = (CorridorExtractVoxels(points=p).run().classified for p in (points, feet))
    wires = [found["classification"] == 14 for found in (one, other)]
    assert wires[0].sum() > 1000
    assert quality(*wires) > 0.9


def test_no_points_and_unknown_heights_are_an_empty_result_that_says_so(
    points: PointCloud, caplog: pytest.LogCaptureFixture
) -> None:
    unknown = points.with_attributes(
        {"HeightAboveGround": np.full(len(points), np.nan, np.float32)}
    )
    for some, why in ((points.select([]), ""), (unknown, ": no height above the ground is known")):
        result = CorridorExtractVoxels(points=some).run()
        assert (result.span_count, len(result.wires)) == (0, 0)
        assert caplog.messages[-1] == f"no power line was found{why}"


def test_the_threshold_of_otsu_parts_two_groups() -> None:
    rng = np.random.default_rng(1)
    values = np.concatenate([rng.normal(1, 0.2, 500), rng.normal(5, 0.5, 300)])
    assert 1.6 < otsu(values) < 3.8
