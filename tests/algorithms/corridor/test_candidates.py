"""corridor.candidates: what may be of a line, and what stands for the rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pyproj import CRS

import toolbox
from algorithms.corridor.candidates import CorridorCandidates
from toolbox.data import PointCloud
from toolbox.errors import DataError

METRE = 3937 / 1200  # US survey feet


def cloud(metre: float = 1.0, crs: int = 32635) -> PointCloud:
    """Four points per square metre of ground, every tenth cell bare of it, and some above."""
    rng = np.random.default_rng(2)
    xyz = rng.uniform([500.0, 800.0, 0.0], [530.0, 820.0, 0.3], (2400, 3))
    xyz = xyz[np.floor(xyz[:, 0]) % 10 != 0]
    above = rng.uniform([500.0, 800.0, 0.5], [530.0, 820.0, 9.0], (300, 3))
    places = np.vstack([xyz, above])[rng.permutation(len(xyz) + len(above))]
    columns: dict[str, Any] = {
        "HeightAboveGround": (places[:, 2] * metre).astype(np.float32),
        "classification": np.ones(len(places), np.uint8),
    }
    return PointCloud(places * metre, columns, crs=CRS(crs))


@pytest.mark.parametrize(("metre", "crs"), [(1.0, 32635), (METRE, 2263)])
def test_all_in_the_air_and_the_lowest_of_each_square_metre(metre: float, crs: int) -> None:
    points = cloud(metre, crs)
    found = toolbox.run("corridor.candidates", {"points": points})["candidates"]
    number, stands_for = found["point_number"], found["stands_for"]
    np.testing.assert_array_equal(found.xyz, points.xyz[number])
    assert stands_for.sum() == len(points)
    height = points.xyz[:, 2] / metre
    in_air = np.flatnonzero(height > 0.4)
    assert set(in_air) <= set(number)
    cell = np.floor(points.xyz[:, :2] / metre).astype(int) @ [1000, 1]
    low = np.setdiff1d(number, in_air)
    assert len(low) == len(np.unique(cell[height <= 0.4]))
    for k, n in zip(low, stands_for[np.searchsorted(number, low)], strict=True):
        own = np.flatnonzero((cell == cell[k]) & (height <= 0.4))
        assert (len(own), height[own].min()) == (n, height[k])


def test_what_takes_no_part_is_not_chosen() -> None:
    points = cloud()
    classes = np.where(np.arange(len(points)) % 3 == 0, 7, 1).astype(np.uint8)
    noisy = points.with_attributes({"classification": classes})
    found = toolbox.run("corridor.candidates", {"points": noisy, "ignore": "7"})["candidates"]
    assert not (found["point_number"] % 3 == 0).any()
    assert found["stands_for"].sum() == np.count_nonzero(classes == 1)


def test_points_without_known_heights_stand_for_the_ground() -> None:
    points = cloud()
    unknown = np.full(len(points), np.nan, np.float32)
    found = toolbox.run(
        "corridor.candidates", {"points": points.with_attributes({"HeightAboveGround": unknown})}
    )["candidates"]
    assert found["stands_for"].sum() == len(points)
    assert len(found) <= 30 * 20


@pytest.mark.parametrize("enough", [True, False])
def test_a_square_may_lie_across_the_edge_of_a_tile(enough: bool) -> None:
    points, edge = cloud(), 513.5
    halo = CorridorCandidates(points=points).halo() if enough else 0.0
    tile = points.select(points.xyz[:, 0] < edge + halo)
    whole, part = (
        toolbox.run("corridor.candidates", {"points": p})["candidates"] for p in (points, tile)
    )
    mine, own = (c.select(c.xyz[:, 0] < edge) for c in (whole, part))
    same = len(mine) == len(own) and np.array_equal(mine["stands_for"], own["stands_for"])
    assert same == enough


def test_heights_must_be_there() -> None:
    bare = PointCloud([[0.0, 0.0, 0.0]], crs=CRS(32635), name="a.laz")
    with pytest.raises(DataError, match=r"a\.laz has no HeightAboveGround"):
        toolbox.run("corridor.candidates", {"points": bare})


@pytest.mark.parametrize("id", ["corridor.candidates", "corridor.extract"])
def test_heights_must_not_be_infinite(id: str) -> None:
    points = cloud()
    height = np.array(points["HeightAboveGround"])
    height[[3, 8]] = np.inf, -np.inf
    with pytest.raises(DataError, match=r"HeightAboveGround of .* is infinite for 2"):
        toolbox.run(id, {"points": points.with_attributes({"HeightAboveGround": height})})
