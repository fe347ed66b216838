"""classify.vegetation_by_returns: pulses by time and order, Canny, edges of roofs, bad input."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.classify._canny import canny
from algorithms.classify._pulses import near_each_other, pulses
from algorithms.classify.vegetation_by_returns import ClassifyVegetationByReturns
from toolbox.data import PointCloud
from toolbox.errors import DataError, NothingToDo, ParameterError

Floats = NDArray[np.float64]
UTM = CRS(32635)


def garden(*, seed: int = 0) -> PointCloud:
    """A lawn of 40 x 30 m, a flat roof of 12 x 10 m at 6 m, a tree, and their pulses.

    Around the roof runs a margin in which pulses have a first return on the roof and a last one on
    the lawn beside it; the tree sends back two or three returns of a pulse. Truth is in `truth`.
    """
    rng = np.random.default_rng(seed)
    x, y = rng.uniform((0, 0), (40, 30), (9600, 2)).T
    from_edge = np.maximum(abs(x - 10) - 6, abs(y - 15) - 5)
    roof, edge = from_edge < 0, abs(from_edge) < 0.3
    tree = np.hypot(x - 30, y - 15) < 5
    rows: list[tuple[float, ...]] = []
    for k in range(len(x)):
        if tree[k]:
            tops = sorted(rng.uniform(1, 12, rng.integers(1, 3)), reverse=True)
            returns = [(top, 5) for top in tops] + [(0.0, 2)]
        elif edge[k]:
            returns = [(6.0, 6), (0.0, 2)]
        else:
            returns = [(6.0, 6)] if roof[k] else [(0.0, 2)]
        for number, (z, cls) in enumerate(returns, start=1):
            rows.append((x[k], y[k], z, number, len(returns), k * 1e-5, cls))
    table = np.array(rows)
    table[:, 2] += rng.normal(0, 0.02, len(table))
    classes = np.where(table[:, 6] == 5, 1, table[:, 6])
    return PointCloud(
        table[:, :3] + [500_000, 4_600_000, 50],
        {
            "return_number": table[:, 3].astype(np.uint8),
            "number_of_returns": table[:, 4].astype(np.uint8),
            "gps_time": table[:, 5],
            "classification": classes.astype(np.uint8),
            "truth": table[:, 6].astype(np.uint8),
        },
        crs=UTM,
        name="garden.laz",
    )


def found(points: PointCloud, **settings: Any) -> NDArray[np.bool_]:
    out = ClassifyVegetationByReturns(points=points, **settings).run()
    return np.isin(out.classified["classification"], (3, 4, 5))


def test_edges_of_roofs_are_left_out_and_trees_are_not() -> None:
    points = garden()
    plant, wall = points["truth"] == 5, points["truth"] == 6
    everything = found(points, building_classes=None)
    assert everything[wall].sum() > 200  # by the difference alone
    kept = found(points)
    removed = 1 - kept[wall].sum() / everything[wall].sum()
    lost = 1 - kept[plant & everything].sum() / everything[plant].sum()
    assert removed >= 0.97
    assert lost <= 0.01
    assert not kept[points["truth"] == 2].any()


def test_the_difference_of_heights_decides() -> None:
    xyz = np.array([[0, 0, 9.0], [0, 0, 7.0], [0, 0, 5.0], [3, 0, 9.0], [3, 0, 5.1], [6, 0, 9.0]])
    attributes = {
        "return_number": [1, 2, 3, 1, 2, 1],
        "number_of_returns": [3, 3, 3, 2, 2, 1],
        "gps_time": [1.0, 1.0, 1.0, 2.0, 2.0, 3.0],
        "classification": np.array([1, 1, 2, 4, 2, 1], np.uint8),
    }
    cloud = PointCloud(xyz, attributes, crs=UTM)
    out = ClassifyVegetationByReturns(points=cloud, difference=3.95).run()
    assert out.classified["classification"].tolist() == [5, 5, 2, 1, 2, 1]
    assert (out.candidates, out.removed) == (2, 0)
    out = ClassifyVegetationByReturns(points=cloud, difference=3.5, high=3.0, low=2.5).run()
    assert out.classified["classification"].tolist() == [5, 3, 2, 5, 2, 1]
    assert out.vegetation_share == 3 / 6
    known = cloud.with_attributes({"HeightAboveGround": [0.2, 1.0, 0, 9, 0, 9]})
    out = ClassifyVegetationByReturns(points=known, difference=3.95).run()
    assert out.classified["classification"].tolist() == [3, 4, 2, 1, 2, 1]


def test_what_is_near_may_follow() -> None:
    points = garden()
    plant = points["truth"] == 5
    alone = found(points, difference=8.0)
    near = found(points, difference=8.0, spread=2.0)
    assert near[plant].mean() > alone[plant].mean() + 0.3
    assert not near[points["truth"] == 2].any()
    assert near[points["truth"] == 6].mean() < 0.01


def test_pairs_by_time_and_by_order_are_the_same() -> None:
    points = garden()
    by_time, by_order = (pulses(points, how) for how in ("gps_time", "order"))
    for one, other in zip(by_time, by_order, strict=True):
        np.testing.assert_array_equal(one, other)
    members, first, last = by_time
    np.testing.assert_array_equal(points["gps_time"][first], points["gps_time"][members])
    assert (points["return_number"][first] == 1).all()
    np.testing.assert_array_equal(points["return_number"][last], points["number_of_returns"][last])


def lists(points: PointCloud) -> PointCloud:
    """All first returns, then all last ones; each pulse claims two, and has no time."""
    count, number = points["number_of_returns"], points["return_number"]
    first, last = np.flatnonzero(number == 1), np.flatnonzero(number == count)
    both = np.concatenate([first, last])
    number = np.repeat([1, 2], len(first)).astype(np.uint8)
    columns = {"return_number": number, "number_of_returns": np.full(len(both), 2, np.uint8)}
    columns |= {"classification": points["classification"][both], "truth": points["truth"][both]}
    return PointCloud(points.xyz[both], columns, crs=UTM, name="lists.laz")


def slanted(points: PointCloud, slope: float = 0.3) -> PointCloud:
    """Seen from the side, so that the returns of a pulse are not above each other."""
    xyz = points.xyz.copy()
    xyz[:, 0] += slope * (xyz[:, 2] - 50)
    return points.with_xyz(xyz)


def test_lists_of_first_and_last_returns(caplog: pytest.LogCaptureFixture) -> None:
    points = slanted(garden())
    wanted = ClassifyVegetationByReturns(points=points, building_classes=None).run()
    first = points["return_number"][wanted.classified["classification"] == 5] == 1
    apart = lists(points)
    how: dict[str, Any] = {"pairs": "order", "building_classes": None}
    out = ClassifyVegetationByReturns(points=apart, **how).run()
    assert out.candidates == first.sum() > 300
    assert not caplog.text
    members, one, other = pulses(apart, "order")
    assert len(members) == len(apart)
    np.testing.assert_array_equal(other - one, len(apart) // 2)
    noise = np.zeros(len(apart), np.uint8)
    noise[::7] = 7  # takes no part, and shifts nothing
    some = apart.with_attributes({"classification": noise})
    kept = (noise[: len(apart) // 2] == 0) & (noise[len(apart) // 2 :] == 0)
    z = apart.xyz[:, 2]
    far = z[: len(apart) // 2] - z[len(apart) // 2 :] > 4
    assert ClassifyVegetationByReturns(points=some, **how).run().candidates == (far & kept).sum()


def test_lists_in_no_order_are_paired_by_place(caplog: pytest.LogCaptureFixture) -> None:
    apart = lists(slanted(garden(), 0.1))
    n, rng = len(apart) // 2, np.random.default_rng(0)
    z = apart.xyz[:, 2]
    far = z[:n] - z[n:] > 4
    for chosen in (rng.permutation(2 * n), np.flatnonzero(rng.random(2 * n) < 0.97)):
        there = np.isin(np.arange(2 * n), chosen)
        wanted = int((far & there[:n] & there[n:]).sum())
        caplog.clear()
        part = apart.select(chosen)
        out = ClassifyVegetationByReturns(points=part, pairs="order", building_classes=None).run()
        assert out.candidates == pytest.approx(wanted, rel=0.1)
        assert "are paired by their places, where slanted pulses may be mixed up" in caplog.text
        _, one, other = pulses(part, "order")
        pairs = {*zip(one.tolist(), other.tolist(), strict=True)}
        assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


def test_returns_farther_aside_than_a_scanner_looks_are_no_pulse() -> None:
    first = np.array([[0, 0, 10.0], [50, 0, 10], [100, 0, 0]])
    last = np.array([[3, 0, 5.0], [56, 0, 5], [100.2, 0, 0.1]])  # 31, 50 and 63 degrees
    one, other = near_each_other(first, last)
    assert sorted(zip(one.tolist(), other.tolist(), strict=True)) == [(0, 0), (2, 2)]


def test_orders_that_are_none_of_a_scan(caplog: pytest.LogCaptureFixture) -> None:
    points = garden()
    mixed = points.select(np.random.default_rng(0).permutation(len(points)))
    with pytest.raises(DataError, match=r"order does not tell .* use pairs gps_time"):
        pulses(mixed, "order")
    thinned = points.select(np.random.default_rng(0).random(len(points)) < 0.3)
    pulses(thinned, "gps_time")
    assert "are of pulses whose first and last return are there" in caplog.text
    caplog.clear()
    wrong = np.full(len(points), 5, np.uint8)
    single = {"return_number": wrong, "number_of_returns": np.ones(len(points), np.uint8)}
    assert not len(pulses(points.with_attributes(single), "gps_time").members)
    assert "cannot be, such as return 5 of 1; they belong to no pulse" in caplog.text


def test_a_real_list_of_returns(data: Callable[[str], Path]) -> None:
    points = PointCloud.open(data("isprs_sites/CSite2_orig-utm.laz"))
    out = ClassifyVegetationByReturns(points=points, pairs="order", building_classes=None).run()
    assert out.candidates == 30_169


def test_pulses_of_one_time_in_two_channels_are_two() -> None:
    cloud = PointCloud(
        np.zeros((4, 3)),
        {
            "return_number": [1, 1, 2, 2],
            "number_of_returns": [2, 2, 2, 2],
            "gps_time": np.ones(4),
            "scanner_channel": [0, 1, 1, 0],
        },
    )
    members, first, last = pulses(cloud, "gps_time")
    assert dict(
        zip(members.tolist(), zip(first.tolist(), last.tolist(), strict=True), strict=True)
    ) == {
        0: (0, 3),
        1: (1, 2),
        2: (1, 2),
        3: (0, 3),
    }


def test_pulses_without_an_end_tell_nothing() -> None:
    points = garden()
    last = points["return_number"] == points["number_of_returns"]
    single = points["number_of_returns"] == 1
    with pytest.raises(NothingToDo, match="no pulse has both its first and its last return") as err:
        ClassifyVegetationByReturns(points=points.select(~last | single)).run()
    assert err.value.instead.candidates == 0
    zeros = np.zeros(len(points), np.uint8)
    nothing = points.with_attributes({"return_number": zeros, "number_of_returns": zeros})
    with pytest.raises(NothingToDo, match="no pulse has both"):
        ClassifyVegetationByReturns(points=nothing).run()


def test_bad_input_is_named() -> None:
    points = garden()
    with pytest.raises(DataError, match="share their gps_time with other pulses; use pairs order"):
        ClassifyVegetationByReturns(
            points=points.with_attributes({"gps_time": np.zeros(len(points))})
        ).run()
    bare = PointCloud(points.xyz, crs=UTM, name="bare.laz")
    with pytest.raises(DataError, match=r"bare\.laz has no return_number and number_of_returns"):
        ClassifyVegetationByReturns(points=bare).run()
    with pytest.raises(DataError, match=r"has no gps_time; use order if"):
        ClassifyVegetationByReturns(points=bare).run()
    with pytest.raises(DataError, match=r"has no classification; classify buildings first"):
        ClassifyVegetationByReturns(points=bare).run()
    with pytest.raises(ParameterError, match=r"weak: must be <= strong \(0\.2\), got 0\.3"):
        ClassifyVegetationByReturns(points=points, weak=0.3)


def test_feet_give_what_metres_give() -> None:
    points = garden()
    feet = points.with_xyz(points.xyz * 3937 / 1200).with_crs(CRS(2263))
    assert (found(feet, spread=1.0) == found(points, spread=1.0)).mean() > 0.999


# Canny ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [0, 1])
def test_a_step_has_one_edge_of_one_cell(axis: int) -> None:
    values = np.zeros((20, 20))
    values[10:] = 1.0
    values[:, :] = values if axis == 0 else values.T
    edges = canny(values, 1.0, 0.1, 0.2, 20)
    lines = edges.all(axis=1 - axis)
    assert 1 <= lines.sum() <= 2  # the middle of the step lies between two cells
    assert edges.sum() == 20 * lines.sum()
    assert set(np.flatnonzero(lines)) <= {9, 10}
    assert not canny(0.1 * values, 1.0, 0.1, 0.2, 20).any()


def test_weak_edges_go_on_from_strong_ones_as_far_as_they_may() -> None:
    values = np.zeros((20, 60))
    values[10:] = np.linspace(1.0, 0.4, 60)  # a step that fades from left to right
    edges = [canny(values, 1.0, 0.1, 0.3, reach) for reach in (1, 10, 60)]
    lengths = [int(edge.any(axis=0).sum()) for edge in edges]
    assert lengths[0] + 9 == lengths[1] < lengths[2]
    assert not canny(0.6 * values, 1.0, 0.1, 0.3, 60).any()


def test_edges_of_a_disc_are_a_ring() -> None:
    y, x = np.indices((60, 60)) - 29.5
    away = np.hypot(x, y)
    edges = canny((away < 20).astype(float), 1.0, 0.1, 0.2, 20)
    assert np.abs(away[edges] - 20).max() < 1.2
    angle = np.degrees(np.arctan2(y, x))[edges]
    assert np.diff(np.sort(angle)).max() < 6  # closed


@pytest.mark.slow
def test_walls_and_trees_of_a_real_city(data: Callable[[str], Path]) -> None:
    points = PointCloud.open(data("ahn3_delft_bgt") / "ahn3_cropped_2.laz", assume_crs=CRS(28992))
    everything, kept = found(points, building_classes=None), found(points)
    wall, tree = (everything & (points["classification"] == k) for k in (6, 1))
    assert kept[wall].mean() < 0.1
    assert kept[tree].mean() > 0.99
