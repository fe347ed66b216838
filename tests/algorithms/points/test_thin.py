"""points.thin: what is kept of each cell, what becomes of attributes, and the same in any order."""

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

from algorithms.points._groups import cells
from algorithms.points.thin import PointsThin, mean
from toolbox import run
from toolbox.data import PointCloud
from toolbox.declare import Attribute
from toolbox.errors import DataError, ParameterError
from toolbox.tiles.tiling import Tiling

UTM = CRS(32635)
METHODS = ["grid_average", "first", "lowest", "highest", "random", "nearest_to_centre"]


def cloud(**columns: Any) -> PointCloud:
    """Four points in the cell from (0, 0, 0) to (1, 1, 1), one alone, and one on its upper edge."""
    xyz = [
        [0.1, 0.1, 0.9],
        [0.6, 0.5, 0.4],
        [0.2, 0.9, 0.1],
        [0.9, 0.9, 0.8],
        [3.5, 3.5, 0],
        [1, 0, 0],
    ]
    base: dict[str, Any] = {
        "number": np.arange(6),
        "gps_time": np.array([4, 3, 2, 1, 5, 6.0]),
        "intensity": np.array([10, 20, 30, 41, 50, 60], np.uint16),
        "classification": np.array([2, 5, 2, 2, 6, 6], np.uint8),
    }
    return PointCloud(np.array(xyz, float), base | columns, crs=UTM, name="a.laz")


def thinned(points: PointCloud | None = None, **parameters: Any) -> PointCloud:
    points = points or cloud()
    out = PointsThin(points=points, **{"cell": 1.0} | parameters).run()
    assert out.removed_share == pytest.approx(1 - len(out.thinned) / len(points))
    return out.thinned


@pytest.mark.parametrize(
    ("method", "kept"),
    [
        ("nearest_to_centre", [1, 4, 5]),
        ("lowest", [2, 4, 5]),
        ("highest", [0, 4, 5]),
        ("first", [3, 4, 5]),
    ],
)
def test_one_point_of_each_cell_as_it_was(method: str, kept: list[int]) -> None:
    points = cloud()
    found = thinned(method=method)
    assert found["number"].tolist() == kept
    np.testing.assert_array_equal(found.xyz, points.xyz[kept])
    for name in points.names:
        np.testing.assert_array_equal(found[name], points[name][kept])


def test_random_takes_each_point_equally_often() -> None:
    picks = [int(thinned(method="random", seed=seed)["number"][0]) for seed in range(400)]
    assert np.bincount(picks, minlength=4).min() > 70
    assert len(set(picks)) == 4
    assert picks[7] == int(thinned(method="random", seed=7)["number"][0])


def test_average_moves_the_nearest_point_and_averages_what_is_measured() -> None:
    ratio = np.array([0.5, 1.5, math.nan, 2.5, 7, 8], np.float32)
    found = thinned(cloud(ratio=ratio), method="grid_average")
    np.testing.assert_allclose(found.xyz[0], [0.45, 0.6, 0.55], rtol=1e-15)
    assert found["number"].tolist() == [1, 4, 5]  # it is nearest to the mean
    assert found["intensity"].tolist() == [25, 50, 60]  # the mean, 25.25, as a whole number
    assert found["classification"].tolist() == [5, 6, 6]
    assert found["gps_time"].tolist() == [3, 5, 6]
    assert found["ratio"].tolist() == [1.5, 7, 8]  # NaN does not count
    assert found["ratio"].dtype == np.float32
    np.testing.assert_array_equal(found.xyz[1:], cloud().xyz[4:])  # alone: untouched


def test_means_are_exact_and_so_the_same_in_any_order() -> None:
    """Millions whose last digits plain sums would lose, in an order that matters to them."""
    rng = np.random.default_rng(4)
    values = rng.uniform(4e6, 5e6, 10_001) * rng.choice([1e-6, 1, 1e6], 10_001)
    wanted = math.fsum(values) / len(values)
    for order in (np.arange(10_001), rng.permutation(10_001), np.argsort(values)):
        assert mean(np.zeros(10_001, np.int64), 1, values[order]).tolist() == [wanted]


def test_average_of_nothing_but_nan_is_nan() -> None:
    ratio = np.array([math.nan] * 4 + [7, 8.0])
    assert np.isnan(thinned(cloud(ratio=ratio), method="grid_average")["ratio"][0])


def test_attributes_of_several_numbers_are_averaged_one_by_one() -> None:
    wave = np.arange(18, dtype=np.float32).reshape(6, 3)
    found = thinned(cloud(wave=wave), method="grid_average")["wave"]
    assert found.tolist() == [[4.5, 5.5, 6.5], [12, 13, 14], [15, 16, 17]]


def test_columns_have_no_height() -> None:
    xyz = np.array([[0.5, 0.5, 0], [0.5, 0.5, 50], [0.5, 0.5, -20.0]])
    points = PointCloud(xyz, {"number": np.arange(3)}, crs=UTM)
    assert len(thinned(points)) == 3
    assert thinned(points, dimensions=2, method="lowest")["number"].tolist() == [2]


def test_points_on_edges_are_in_the_higher_cell_in_spite_of_rounding() -> None:
    """Coordinates in steps of 1 cm, cells of 1 cm: none is lost, wherever they are."""
    steps = np.arange(46_000_000, 46_010_000)
    x = steps * 0.01 + 4_140_000
    assert (np.diff(cells(x[:, None], 0.01)[:, 0]) == 1).all()
    xyz = np.column_stack([x, x, x])
    assert len(thinned(PointCloud(xyz, crs=UTM), cell=0.01)) == len(x)


def test_cells_are_metres_in_feet_too() -> None:
    foot = 1200 / 3937
    xyz = np.array([[0.05, 0.5, 0.5], [0.95, 0.5, 0.5], [1.05, 0.5, 0.5]]) / foot
    assert len(thinned(PointCloud(xyz, crs=CRS(2263)))) == 2


def test_duplicates_are_exact_and_the_earliest_stays() -> None:
    xyz = np.array(
        [
            [5e5, 4e6, 7],
            [5e5, 4e6, 7],
            [5e5, 4e6, 7 + 1e-9],
            [5e5, 4e6, 7],
            [0, -0.0, 0],
            [-0.0, 0, 0],
        ]
    )
    time = np.array([3, 2, 1, 2.5, 9, 8])
    classes = np.array([1, 1, 1, 2, 1, 1], np.uint8)
    columns = {"number": np.arange(6), "gps_time": time, "classification": classes}
    points = PointCloud(xyz, columns, crs=UTM)
    assert thinned(points, method="duplicates")["number"].tolist() == [1, 2, 5]
    agree = (Attribute("classification"),)
    found = thinned(points, method="duplicates", agree=agree)
    assert found["number"].tolist() == [1, 2, 3, 5]


@pytest.mark.parametrize("method", ["duplicates", "lowest", "random"])
def test_duplicates_without_any_attribute_are_one(method: str) -> None:
    twice = PointCloud(np.ones((2, 3)), crs=CRS(32635))
    assert twice.names == ()
    assert len(PointsThin(points=twice, method=method).run().thinned) == 1


def test_missing_times_and_useless_settings_are_refused() -> None:
    bare = PointCloud(np.zeros((2, 3)), crs=UTM, name="bare.xyz")
    with pytest.raises(DataError, match=r"method: first needs gps_time, which bare\.xyz does not"):
        PointsThin(points=bare, method="first")
    with pytest.raises(ParameterError, match="agree: is for method duplicates, not for lowest"):
        PointsThin(points=cloud(), method="lowest", agree=(Attribute("intensity"),))
    with pytest.raises(ParameterError, match="no attribute 'colour'"):
        PointsThin(points=cloud(), method="duplicates", agree=(Attribute("colour"),))


def test_halo_is_a_cell_and_none_for_duplicates() -> None:
    assert PointsThin(points=cloud(), cell=2.0).halo() == pytest.approx(2.0, rel=1e-3)
    assert PointsThin(points=cloud(), cell=2.0).halo() > 2.0
    assert PointsThin(points=cloud(), method="duplicates").halo() == 0


places = st.tuples(*[st.integers(-4, 4)] * 3)


@given(
    st.lists(st.tuples(places, st.integers(0, 2), st.integers(0, 2)), min_size=1, max_size=40),
    st.sampled_from([*METHODS, "duplicates"]),
    st.sampled_from([2, 3]),
    st.randoms(use_true_random=False),
)
def test_any_order_gives_the_same_points(
    rows: list[Any], method: str, dimensions: int, random: Any
) -> None:
    """Many of the points share place and time, so that ties of all sorts come up."""
    order = list(range(len(rows)))
    random.shuffle(order)
    found = []
    for some in (rows, [rows[i] for i in order]):
        xyz = np.array([row[0] for row in some]) / 3 + 1000
        columns = {"gps_time": [float(r[1]) for r in some], "kind": [r[2] for r in some]}
        points = PointCloud(xyz, columns, crs=UTM)
        out = thinned(points, method=method, dimensions=dimensions)
        columns = {name: out[name] for name in ("gps_time", "kind")}
        found.append(sorted(map(tuple, np.column_stack([out.xyz, *columns.values()]).tolist())))
        if method != "duplicates":
            groups = cells(points.xyz[:, :dimensions], 1.0)
            assert len(out) == len(np.unique(groups, axis=0))
    assert found[0] == found[1]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["grid_average", "lowest"])
def test_tiles_give_the_same_points(method: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    xyz = rng.uniform(0, 30, (3000, 3)) + np.array([500_000, 4_600_000, 0])
    columns = {"number": np.arange(3000), "intensity": rng.integers(0, 999, 3000).astype("u2")}
    PointCloud(xyz, columns, crs=UTM).save(tmp_path / "a.laz")
    given = {"points": tmp_path / "a.laz", "method": method, "cell": 3.1, "dimensions": 2}
    whole = run("points.thin", given | {"thinned": tmp_path / "whole.laz"})
    out = {"thinned": tmp_path / "tiles.laz"}
    tiles = run("points.thin", given | out, tiling=Tiling(7.0, 1, 1 << 30))
    assert tiles["removed_share"] == whole["removed_share"]
    found = []
    for name in ("whole", "tiles"):
        made = PointCloud.open(tmp_path / f"{name}.laz")
        order = np.argsort(made["number"])
        found.append(np.column_stack([made.xyz, made["number"], made["intensity"]])[order])
    np.testing.assert_array_equal(*found)


@pytest.mark.slow
def test_real_files_keep_one_point_per_cell(data: Callable[[str], Path]) -> None:
    """AHN3 around a lake in cells of half a metre, against numpy."""
    points = PointCloud.open(data("water_denoever_ahn3") / "AHN3.laz", assume_crs=CRS(28992))
    wanted = len(np.unique(np.floor(points.xyz / 0.5 + 1e-6), axis=0))
    for method in ("lowest", "grid_average"):
        found = thinned(points, method=method, cell=0.5)
        assert len(found) == wanted < len(points)
        assert found.names == points.names
        assert len(np.unique(np.floor(found.xyz / 0.5 + 1e-6), axis=0)) == wanted


@pytest.mark.parametrize("method", METHODS)
def test_withheld_points_stand_for_no_others(method: str) -> None:
    points = cloud(withheld=np.array([0, 0, 1, 0, 0, 0], np.uint8))
    firm = points["withheld"] == 0
    found, alone = thinned(points, method=method), thinned(points.select(firm), method=method)
    assert np.array_equal(found.select(found["withheld"] == 0).xyz, alone.xyz)
    assert found.select(found["withheld"] == 1)["number"].tolist() == [2]
