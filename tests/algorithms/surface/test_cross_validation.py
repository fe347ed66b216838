"""surface.cross_validation: which points are left out, and the errors at them."""

from __future__ import annotations

from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS

from algorithms.compare.surfaces import CompareSurfaces
from algorithms.surface.cross_validation import SurfaceCrossValidation, folds_of
from algorithms.surface.grid import SurfaceGrid
from toolbox.data import PointCloud, Vector
from toolbox.declare import Attribute, ClassList, Extent
from toolbox.errors import DataError, ParameterError

UTM, FEET = CRS(32635), CRS(2263)
SIZE = 40.0


def cloud(count: int = 2000, seed: int = 0, crs: CRS = UTM, **columns: Any) -> PointCloud:
    """A wavy surface, far from the origin."""
    xy = np.random.default_rng(seed).uniform(0, SIZE, (count, 2))
    z = 2 * np.sin(xy[:, 0] / 5) + np.cos(xy[:, 1] / 3)
    return PointCloud(np.column_stack([xy + np.array([5e5, 4.6e6]), z]), columns, crs=crs)


def rows(out: SurfaceCrossValidation.Outputs) -> dict[str, dict[str, Any]]:
    return {row["method"]: row for row in out.table.frame.to_dict("records")}


def test_folds_hold_each_place_once_and_are_of_one_size() -> None:
    xy = np.random.default_rng(0).uniform(0, 9, (103, 2))
    xy = np.vstack([xy, xy[:20]])  # some places twice
    fold = folds_of(xy, 10, None, 0)
    np.testing.assert_array_equal(fold[103:], fold[:20])
    sizes = np.bincount(fold[:103], minlength=10)
    assert set(sizes) == {10, 11}
    order = np.random.default_rng(1).permutation(len(xy))
    np.testing.assert_array_equal(folds_of(xy[order], 10, None, 0), fold[order])
    assert (folds_of(xy, 10, None, 1) != fold).any()


def test_blocks_go_whole() -> None:
    xy = np.random.default_rng(0).uniform(-20, 20, (3000, 2))
    fold = folds_of(xy, 4, 8.0, 0)
    square = np.floor(xy / 8)
    for key in np.unique(square, axis=0):
        assert len(set(fold[(square == key).all(axis=1)])) == 1
    blocks = np.unique(np.column_stack([square, fold]), axis=0)
    assert np.bincount(blocks[:, 2].astype(int)).tolist() == [9, 9, 9, 9]


@pytest.mark.parametrize("method", ["linear", "natural", "cubic", "idw", "mean"])
def test_errors_are_those_at_checkpoints_that_were_not_gridded(method: Any) -> None:
    """The same by hand: points of a fold as checkpoints, the raster from all the others."""
    points = cloud()
    out = SurfaceCrossValidation(points=points, methods=(method,), folds=5, rounds=1, cell=0.7)
    found = out.run()
    left = folds_of(points.xyz[:, :2], 5, None, 0) == 0
    box = Extent(5e5 - 2, 4.6e6 - 2, 5e5 + SIZE + 2, 4.6e6 + SIZE + 2)
    surface = SurfaceGrid(points=points.select(~left), method=method, cell=0.7, extent=box)
    checks = geopandas.GeoDataFrame(geometry=shapely.points(points.xyz[left]), crs=UTM)
    compared = CompareSurfaces(surface=surface.run().surface, checkpoints=Vector(checks)).run()
    row = rows(found)[method]
    assert (row["count"], row["missing"]) == (compared.count, compared.missing)
    assert row["rmse"] == pytest.approx(compared.rmse, abs=1e-6)
    assert row["bias"] == pytest.approx(compared.bias, abs=1e-6)
    assert row["le95"] == pytest.approx(compared.le95, abs=1e-6)
    assert len(found.residuals) == found.count == 400


def test_residuals_carry_what_the_table_sums_up() -> None:
    points = cloud(600, classification=np.resize([2, 6], 600).astype(np.uint8))
    out = SurfaceCrossValidation(points=points, classes=ClassList([2]), folds=3, max_gap=4.0).run()
    assert out.count == len(out.residuals) == 300
    assert (out.residuals["classification"] == 2).all()
    methods = ("linear", "natural", "cubic", "idw", "nearest")
    errors = np.array([out.residuals[f"error_{method}"] for method in methods], float)
    common = np.isfinite(errors).all(axis=0)
    assert 0 < common.sum() < 300
    for method, error in zip(methods, errors, strict=True):
        row, known = rows(out)[method], error[np.isfinite(error)]
        assert row["missing"] == 300 - len(known)
        assert row["mae"] == pytest.approx(np.abs(known).mean(), rel=1e-5)
        assert row["rmse_common"] == pytest.approx(np.sqrt(np.mean(error[common] ** 2)), rel=1e-5)


def test_gaps_are_harder_than_single_points_and_bilinear_planes_are_easy() -> None:
    points, settings = cloud(4000), {"methods": ("linear",), "cell": 0.5}
    errors = [
        rows(SurfaceCrossValidation(points=points, block=block, **settings).run())["linear"]["rmse"]
        for block in (None, 3.0, 6.0)
    ]
    assert errors[0] < errors[1] / 3 < errors[2] / 6
    xyz = points.xyz.copy()
    xyz[:, 2] = 0.2 * xyz[:, 0] - 0.1 * xyz[:, 1]
    row = rows(SurfaceCrossValidation(points=PointCloud(xyz, crs=UTM), **settings).run())["linear"]
    assert row["max"] - row["min"] < 1e-6


def test_feet_give_metres_in_the_table_and_feet_in_the_points() -> None:
    foot, points = 1200 / 3937, cloud()
    in_feet = PointCloud(points.xyz / foot, crs=FEET)
    here, there = (
        SurfaceCrossValidation(points=p, methods=("linear",), block=5.0).run()
        for p in (points, in_feet)
    )
    assert rows(there)["linear"]["rmse"] == pytest.approx(rows(here)["linear"]["rmse"], rel=1e-5)
    np.testing.assert_allclose(
        foot * there.residuals["error_linear"], here.residuals["error_linear"], atol=1e-5
    )
    assert here.residuals.descriptions["error_linear"] == "surface minus point, metre"


def test_other_attributes_keep_their_unit() -> None:
    points = cloud(intensity=np.random.default_rng(0).integers(0, 4000, 2000).astype(np.uint16))
    intensity, plain = Attribute("intensity"), PointCloud(points.xyz, crs=UTM)
    out = SurfaceCrossValidation(points=points, attribute=intensity, methods=("idw", "mean")).run()
    assert 1000 < rows(out)["idw"]["rmse"] < 1600  # 4000 / sqrt(12), and that of the mean
    with pytest.raises(ParameterError, match="attribute: no attribute 'intensity'"):
        SurfaceCrossValidation(points=plain, attribute=intensity)


def test_a_method_without_any_value_says_so(caplog: pytest.LogCaptureFixture) -> None:
    out = SurfaceCrossValidation(points=cloud(100), methods=("linear",), max_gap=0.01).run()
    assert rows(out)["linear"]["count"] == 0
    assert rows(out)["linear"]["rmse"] is None
    assert "linear has no value at any of the points left out" in caplog.text


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"rounds": 11}, "rounds: must be at most the number of folds, 10, got 11"),
        ({"methods": ("idw", "idw")}, "methods: names a method twice: idw, idw"),
        ({"methods": ("count",)}, "methods: must be one of linear"),
        ({"classes": ClassList([2])}, "classes: .* has no classification"),
        ({"folds": 3000}, "points: lie in 2000 places, fewer than the 3000 folds"),
        ({"block": 30.0}, "points: lie in [46] blocks, fewer than the 10 folds"),
    ],
    ids=str,
)
def test_what_cannot_be_is_refused(settings: dict[str, Any], text: str) -> None:
    with pytest.raises((DataError, ParameterError), match=text):
        SurfaceCrossValidation(points=cloud(), **settings).run()
