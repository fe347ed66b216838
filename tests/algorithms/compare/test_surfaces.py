"""compare.surfaces: errors worked out by hand, land cover, the report, and bad input."""

from __future__ import annotations

import functools
import math
import re
from itertools import pairwise
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely
from pyproj import CRS
from scenes import layers
from scenes.layers import UTM, WEST
from scipy import stats

from algorithms.compare import surfaces as module
from algorithms.compare._spread import Quarters, spread
from algorithms.compare._statement import statement
from algorithms.compare.surfaces import CompareSurfaces, histogram, report, resampled, rounded_up
from algorithms.shared.error_measures import measures
from toolbox.data import Lattice, PointCloud, Raster, Vector
from toolbox.declare import ClassList
from toolbox.errors import DataError, ParameterError

FEET = CRS(2263)
NORTH = 100.0
raster = functools.partial(layers.raster, north=NORTH)
ERRORS = np.array([-0.3, -0.1, 0.0, 0.1, 0.8])


def slope(rows: int = 12, cols: int = 12, cell: float = 1.0, **more: Any) -> Raster:
    """10 m high in the north-western corner, 2 m per metre eastwards and 1 southwards."""
    row, col = (np.mgrid[0:rows, 0:cols] + 0.5) * cell
    return raster(10 + 2 * col + row, cell=cell, **more)


def true_height(x: Any, y: Any) -> Any:
    return 10 + 2 * (x - WEST) + (NORTH - y)


def checks(errors: Any = ERRORS, crs: CRS | None = UTM, **columns: Any) -> Vector:
    """Points on the slope that lie so far below it."""
    count = len(errors)
    x = WEST + 1 + 9 * np.random.default_rng(0).random(count)
    y = NORTH - 1 - 9 * np.random.default_rng(1).random(count)
    places = shapely.points(x, y, true_height(x, y) - errors)
    return Vector(geopandas.GeoDataFrame(columns, geometry=places, crs=crs), name="checks.gpkg")


def as_cloud(layer: Vector, **columns: Any) -> PointCloud:
    xyz = shapely.get_coordinates(layer.frame.geometry, include_z=True)
    return PointCloud(xyz, columns, crs=layer.crs, name="checks.csv")


def by(table: Any, key: str, value: str) -> dict[str, Any]:
    return dict(zip(table.frame[key], table.frame[value], strict=True))


# Measures -------------------------------------------------------------------------------------


def test_measures_by_hand() -> None:
    """Of -0.3, -0.1, 0, 0.1, 0.8: sum 0.5, squares 0.75; distances from the median 0 are sizes."""
    found = measures(ERRORS)
    assert found["count"] == 5
    assert found["bias"] == pytest.approx(0.1)
    assert found["rmse"] == pytest.approx(math.sqrt(0.75 / 5))
    assert found["std"] == pytest.approx(math.sqrt((0.75 - 5 * 0.01) / 4))
    assert (found["median"], found["min"], found["max"]) == (0, -0.3, 0.8)
    assert found["mad"] == pytest.approx(0.1)
    assert found["nmad"] == pytest.approx(0.14826)
    assert found["le90"] == pytest.approx(0.3 + 0.6 * 0.5)  # 3.6 of 4 steps through the sizes
    assert found["le95"] == pytest.approx(0.3 + 0.8 * 0.5)
    assert (found["p25"], found["p75"]) == pytest.approx((-0.1, 0.1))
    assert (found["p5"], found["p95"]) == pytest.approx((-0.26, 0.66))
    assert found["far"] == 1
    assert measures(np.array([0.5]))["std"] is None
    assert set(found) == set(module.MEANING)


def test_measures_agree_with_scipy_and_with_theory() -> None:
    error = np.random.default_rng(0).normal(0.02, 0.1, 200_000)
    found = measures(error)
    assert found["nmad"] == pytest.approx(1.4826 * stats.median_abs_deviation(error), rel=1e-12)
    assert found["nmad"] == pytest.approx(0.1, rel=0.01)
    assert found["rmse"] == pytest.approx(math.hypot(0.1, 0.02), rel=0.01)
    size = stats.foldnorm(0.2, scale=0.1)  # sizes of normal errors with a bias
    assert found["le90"] == pytest.approx(size.ppf(0.9), rel=0.01)
    assert found["le95"] == pytest.approx(size.ppf(0.95), rel=0.01)
    assert found["far"] / len(error) == pytest.approx(0.0027, abs=0.0005)
    assert measures(error[::-1]) == found


# Rasters --------------------------------------------------------------------------------------


def test_raster_against_raster_by_hand() -> None:
    """The reference begins one column to the east, and has a hole."""
    surface = raster([[1.0, 2, 3], [4, 5, np.nan]], name="a.tif")
    reference = raster([[1.5, 5], [np.nan, 1]], west=WEST + 1, name="b.tif")
    out = CompareSurfaces(surface=surface, reference=reference).run()
    assert out.difference is not None
    np.testing.assert_array_equal(
        out.difference.values[0], [[np.nan, 0.5, -2], [np.nan, np.nan, np.nan]]
    )
    assert (out.count, out.missing, out.report) == (2, 3, None)
    assert out.absent == 1  # where the surface has its hole
    assert out.bias == pytest.approx(-0.75)
    assert out.rmse == pytest.approx(math.sqrt(4.25 / 2))
    errors = out.errors.frame
    assert errors["rank"].tolist() == [1, 2]
    assert errors["error"].tolist() == [-2, 0.5]
    assert errors["surface"].tolist() == [3, 2]
    assert errors["reference"].tolist() == [5, 1.5]
    assert errors.geometry[0].equals(shapely.Point(WEST + 2.5, NORTH - 0.5))
    assert errors.geometry[0].z == 3
    assert errors["cover"].tolist() == ["all", "all"]


def test_other_cells_are_refused_and_resampled_bilinearly_on_request() -> None:
    surface, reference = slope(), slope(30, 30, 0.4, name="b.tif")
    with pytest.raises(DataError, match=r"reference: b.tif has cells of 0.4, .*; give resample"):
        CompareSurfaces(surface=surface, reference=reference)
    out = CompareSurfaces(surface=surface, reference=reference, resample=True).run()
    assert (out.count, out.missing) == (144, 0)  # each centre lies between four
    assert out.absent == 0
    assert out.rmse == pytest.approx(0, abs=1e-9)
    coarse = slope(4, 4, 3.0)
    out = CompareSurfaces(surface=surface, reference=coarse, resample=True).run()
    assert (out.count, out.missing) == (100, 44)  # nothing beyond the outermost centres
    assert out.rmse == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("resample", [False, True])
def test_what_the_surface_lacks_is_counted_and_told(
    resample: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """A hole in the surface, and the reference going on beyond it."""
    values = slope().values[0].copy()
    values[2:4, 2:4] = np.nan
    cell = 0.5 if resample else 1.0
    reference = slope(round(20 / cell), round(12 / cell), cell)
    out = CompareSurfaces(surface=raster(values), reference=reference, resample=resample).run()
    absent = (4 + 8 * 12) / cell**2
    assert out.absent == absent
    told = f"{absent:.0f} of {20 * 12 / cell**2:.0f} cells of the reference (42 %) are absent"
    assert told in caplog.text
    assert any("absent from the surface" in text for text in out.not_looked_at())
    caplog.clear()
    assert CompareSurfaces(surface=reference, reference=reference).run().absent == 0
    assert not caplog.text


def test_resampling_in_blocks_is_resampling_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(0).normal(0, 1, (20, 20))
    values[7, 7] = np.nan
    source, lattice = raster(values, cell=0.7), Lattice(WEST - 2, NORTH + 3, 0.3, 90, 60)
    found = resampled(source, lattice)
    x, y = np.meshgrid(*lattice.centres())
    np.testing.assert_allclose(found, source.sample(x, y, method="linear"), atol=1e-12)
    monkeypatch.setattr(module, "ROWS", 4)
    np.testing.assert_allclose(resampled(source, lattice), found, atol=1e-12)


# Points ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("as_points", [False, True])
def test_points_against_a_bilinear_surface(as_points: bool) -> None:
    layer = checks()
    source = {"points": as_cloud(layer)} if as_points else {"checkpoints": layer}
    out = CompareSurfaces(surface=slope(), **source).run()
    assert out.difference is None
    assert (out.count, out.missing) == (5, 0)
    found = np.sort(out.errors.frame["error"])
    np.testing.assert_allclose(found, np.sort(ERRORS), atol=1e-9)
    assert by(out.table, "measure", "value") == pytest.approx(measures(ERRORS), abs=1e-9)
    assert out.le95 == pytest.approx(0.7)


def test_points_without_a_surface_are_missing(caplog: pytest.LogCaptureFixture) -> None:
    values = slope().values[0].copy()
    values[0, 0] = np.nan
    places = [(1.2, 1.2), (0.2, 5), (5, 5), (90, 5)]  # at the hole, at the edge, inside, outside
    shapes = [shapely.Point(WEST + x, NORTH - y, 25) for x, y in places]
    layer = Vector(geopandas.GeoDataFrame({"id": list("ABCD")}, geometry=shapes, crs=UTM))
    out = CompareSurfaces(surface=raster(values), checkpoints=layer).run()
    assert (out.count, out.missing, out.absent) == (1, 3, 3)
    assert "3 of 4 checkpoints have no height of the surface below them: A at " in caplog.text
    assert f"; D at {WEST + 90:.10g},{NORTH - 5:.10g}" in caplog.text
    odd = layer.frame.assign(id=["a\n\x1b[31m" + "b" * 99, None, "C", "D"])
    caplog.clear()
    CompareSurfaces(surface=raster(values), checkpoints=Vector(odd)).run()
    assert f"below them: a [31m{'b' * 34} at " in caplog.text
    assert "None at" not in caplog.text
    apart = r"in both: surface x \d+ to \d+, y \d+ to \d+; checkpoints x \d+ to \d+, y"
    with pytest.raises(DataError, match=apart):
        CompareSurfaces(
            surface=slope(),
            checkpoints=Vector(geopandas.GeoDataFrame(geometry=shapes[3:], crs=UTM)),
        ).run()


def test_classes_and_withheld_points_choose() -> None:
    classes = np.array([2, 2, 6, 2, 2], np.uint8)
    cloud = as_cloud(checks(), classification=classes, withheld=np.array([0, 0, 0, 0, 1], np.uint8))
    out = CompareSurfaces(surface=slope(), points=cloud, classes=ClassList([2])).run()
    assert sorted(out.errors.frame["error"].round(6)) == [-0.3, -0.1, 0.1]


def test_the_largest_errors_come_first_and_ties_by_place() -> None:
    many = CompareSurfaces(surface=raster(np.ones((3, 3))), reference=raster(np.zeros((3, 3))))
    places = CompareSurfaces(**vars(many) | {"largest_errors": 4}).run().errors.frame.geometry
    assert [(p.x - WEST, NORTH - p.y) for p in places] == [
        (0.5, 2.5),
        (0.5, 1.5),
        (0.5, 0.5),
        (1.5, 2.5),
    ]
    assert len(CompareSurfaces(**vars(many) | {"largest_errors": 0}).run().errors) == 0


# Land cover -----------------------------------------------------------------------------------

COVERS = ["road", "road", "forest", None, "forest"]


def test_land_cover_of_checkpoints_by_hand() -> None:
    out = CompareSurfaces(
        surface=slope(),
        checkpoints=checks(lc=COVERS),
        cover_attribute="lc",
        vegetated=("forest",),
        checkpoint_rmse=0.3,
    ).run()
    assert by(out.covers, "cover", "count") == {"forest": 2, "road": 2, "not known": 1}
    bias = by(out.covers, "cover", "bias")
    assert bias == pytest.approx({"forest": 0.4, "road": -0.2, "not known": 0.1})
    assert out.report is not None
    report = by(out.report, "item", "value")
    fit = math.sqrt((0.09 + 0.01 + 0.01) / 3)  # forest apart
    assert report["NVA checkpoints"] == 3
    assert report["NVA RMSEV1"] == pytest.approx(fit)
    assert report["NVA RMSEV"] == pytest.approx(math.hypot(fit, 0.3))
    assert report["NVA 1.96 RMSEV1"] == pytest.approx(1.96 * fit, rel=1e-4)
    assert report["VVA checkpoints"] == 2
    assert report["VVA RMSEV"] == pytest.approx(math.hypot(math.sqrt(0.32), 0.3))
    assert report["VVA 95th percentile"] == pytest.approx(0.76)
    assert out.errors.frame["cover"].tolist()[:2] == ["forest", "road"]  # of 0.8 and -0.3


def test_a_blunder_among_checkpoints_is_told(caplog: pytest.LogCaptureFixture) -> None:
    for scatter, blunder, told in ((0.001, 0.09, False), (0.02, 0.15, False), (0.02, -3.0, True)):
        caplog.clear()
        errors = np.random.default_rng(2).normal(0.0, scatter, 40)
        errors[7] = blunder
        named = checks(errors=errors, id=[f"CP{n}" for n in range(40)])
        CompareSurfaces(surface=slope(), checkpoints=named).run()
        assert ("1 of 40 checkpoints are ten times" in caplog.text) == told, blunder
    assert "by -3.000 m: CP7 at " in caplog.text
    assert "The RMSE of the others is 0.019 m" in caplog.text


def test_the_largest_errors_keep_the_names_of_the_checkpoints() -> None:
    out = CompareSurfaces(
        surface=slope(),
        checkpoints=checks(id=["P1", "P2", "P3", "P4", "P5"], rank=[7] * 5),
        largest_errors=2,
    ).run()
    assert out.errors.frame["id"].tolist() == ["P5", "P1"]
    assert out.errors.frame["rank"].tolist() == [1, 2], "an own column of that name stays"


@pytest.mark.parametrize(
    ("count", "wanted", "says"),
    [
        (
            40,
            0.5,
            r"was tested to meet ASPRS .* Edition 2, Version 2 \(2024\) for a 50 \(cm\) RMSEV "
            r"Vertical Accuracy Class\. The Non-Vegetated .* to be RMSEV = 50\.0 \(cm\)\. The Veg",
        ),
        (40, 0.2, "the vertical accuracy class of 20 cm RMSEV is not met"),
        (40, None, "no accuracy class was asked for"),
        (29, 0.5, "using ONLY 29 checkpoints.* produced to meet a 50 .*NVA.* reduced number of"),
        (29, 0.4, "^Tested at 29 checkpoints, fewer than the 30 of .* of 40 cm RMSEV is not met"),
        (40, 12.0, r"for a 1200 \(cm\) RMSEV"),
        (40, 0.4999, r"class of 49\.99 cm RMSEV is not met"),
        (29, None, "Not tested by the ASPRS .* asks for 30 checkpoints .*; there are 29"),
    ],
)
def test_the_statement_says_whether_the_class_is_met(
    count: int, wanted: float | None, says: str
) -> None:
    """Errors of 0.3 m, and of 0.4 m of the checkpoints where that is given, make 0.5 m."""
    error = np.where(np.arange(count) % 2, 0.3, -0.3)
    own = 0.4 if wanted != 0.2 else None
    rows = [*report("NVA", error, own, wanted), *report("VVA", error[:5] * 2, own, None)]
    said = "\n".join(statement(pd.DataFrame(rows)))
    assert re.search(says, said)
    if own:
        assert f"(NVA) at {count} checkpoints: RMSEV 50.0 cm, of which 30.0 cm are the fit" in said
        assert "at 5 checkpoints: RMSEV 72.1 cm" in said
    else:
        assert f"(NVA) at {count} checkpoints: RMSEV 30.0 cm, the fit alone" in said


def test_an_error_just_beyond_the_class_does_not_look_like_it() -> None:
    rows = report("NVA", np.full(40, 0.1002), None, 0.1)
    said = "\n".join(statement(pd.DataFrame(rows)))
    assert "of 10 cm RMSEV is not met" in said
    assert "RMSEV 10.02 cm" in said


def test_the_statement_is_what_the_tool_says_and_horizontal_accuracy_is_not_tested() -> None:
    out = CompareSurfaces(surface=slope(), checkpoints=checks(), horizontal_rmse=0.25).run()
    assert out.in_words().startswith("Not tested by the ASPRS")
    assert (
        "Horizontal accuracy (RMSEH) was not tested; its maker states RMSEH 25 cm."
        in out.not_looked_at()
    )
    assert out.report is not None
    assert by(out.report, "item", "value")["RMSEH"] == 0.25


def lake(west: float, east: float) -> Vector:
    """Water over the whole height of the slope, between two distances from its western edge."""
    shape = shapely.box(WEST + west, NORTH - 12, WEST + east, NORTH)
    return Vector(geopandas.GeoDataFrame(geometry=[shape], crs=UTM), name="lake.gpkg")


def test_water_that_was_laid_level_is_no_terrain(caplog: pytest.LogCaptureFixture) -> None:
    """Its points were among those of the NVA, which told how well water had been levelled."""
    given = checks(np.where(np.arange(40) < 30, 0.1, 0.5))
    wet = given.frame.geometry.x.to_numpy() < WEST + 4
    reference = as_cloud(given, classification=np.full(40, 2, np.uint8))
    found = CompareSurfaces(
        surface=slope(), points=reference, water=lake(0, 4), accuracy_class=1.0
    ).run()
    items = by(found.report, "item", "value")
    assert 0 < wet.sum() < 40
    assert items["NVA checkpoints"] == (~wet).sum()
    assert items["Checkpoints on water"] == wet.sum()
    assert by(found.covers, "cover", "count") == {
        "land": (~wet).sum(),
        "water laid level": wet.sum(),
    }
    assert found.count == 40, "nothing is left out of the table"
    assert f"counted apart: {wet.sum()} points." in found.in_words()
    assert f"{wet.sum()} points of class 2 (ground) lie in water" in caplog.text


def test_water_is_apart_from_other_land_covers() -> None:
    given = checks(np.full(40, 0.1), kind=["road", "grass"] * 20)
    wet = given.frame.geometry.x.to_numpy() < WEST + 4
    how: dict[str, Any] = {"cover_attribute": "kind", "vegetated": ("grass",)}
    found = CompareSurfaces(surface=slope(), checkpoints=given, water=lake(0, 4), **how).run()
    items, grass = by(found.report, "item", "value"), np.arange(40) % 2 == 1
    assert items["NVA checkpoints"] == (~wet & ~grass).sum()
    assert items["VVA checkpoints"] == (~wet & grass).sum()
    covers = by(found.covers, "cover", "count")
    assert covers["water laid level"] == wet.sum()
    assert set(covers) == {"grass", "road", "water laid level"}


def test_points_on_a_level_part_of_the_surface_are_told(caplog: pytest.LogCaptureFixture) -> None:
    """Five cells along a side have one height: of 12 x 12 cells, 5 columns, their middle one."""
    given = checks(np.zeros(40))
    heights = slope().band().copy()
    heights[:, :5] = 12.0
    surface = raster(heights)
    CompareSurfaces(surface=surface, checkpoints=given).run()
    column = np.floor(given.frame.geometry.x.to_numpy() - WEST)
    row = np.floor(NORTH - given.frame.geometry.y.to_numpy())
    level = int(((column == 2) & (row >= 2) & (row < 10)).sum())
    assert level > 0
    assert f"{level} of 40 points lie where the surface is exactly level" in caplog.text
    caplog.clear()
    CompareSurfaces(surface=surface, checkpoints=given, water=lake(0, 5)).run()
    CompareSurfaces(surface=raster(np.full((12, 12), 12.0)), checkpoints=given).run()
    assert "exactly level" not in caplog.text


def test_land_cover_of_points_and_in_numeric_order() -> None:
    cloud = as_cloud(checks(), classification=np.array([10, 2, 2, 10, 9], np.uint8))
    out = CompareSurfaces(surface=slope(), points=cloud, cover_attribute="classification").run()
    assert out.covers.frame["cover"].tolist() == ["2", "9", "10"]
    assert out.covers.frame["count"].tolist() == [2, 1, 2]


def test_land_cover_from_a_raster_with_nodata() -> None:
    classes = raster(np.array([[1, 2], [0, 2]], np.uint8), nodata=0, cell=2.0)
    surface = raster(np.full((4, 5), 3.0))
    out = CompareSurfaces(surface=surface, reference=raster(np.ones((4, 5))), cover=classes).run()
    assert by(out.covers, "cover", "count") == {"1": 4, "2": 8, "not known": 8}


def test_land_cover_from_polygons_first_of_the_layer_wins() -> None:
    left, lower = shapely.box(WEST, NORTH - 4, WEST + 2, NORTH), shapely.box(WEST, 90, WEST + 9, 98)
    areas = Vector(geopandas.GeoDataFrame({"kind": [7.0, 8.0]}, geometry=[left, lower], crs=UTM))
    out = CompareSurfaces(
        surface=raster(np.full((4, 5), 3.0)),
        reference=raster(np.ones((4, 5))),
        areas=areas,
        cover_attribute="kind",
    ).run()
    assert by(out.covers, "cover", "count") == {"7": 8, "8": 6, "not known": 6}


# The report -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("size", "own", "verdict"),
    [(0.05, 0.0, "met"), (0.11, 0.0, "NOT MET"), (0.09, 0.05, "NOT MET"), (0.08, 0.06, "met")],
)
def test_accuracy_class_includes_the_error_of_the_checkpoints(
    size: float, own: float, verdict: str
) -> None:
    layer = checks(np.resize([size, -size], 40))
    out = CompareSurfaces(
        surface=slope(), checkpoints=layer, checkpoint_rmse=own, accuracy_class=0.1000001
    ).run()
    assert out.report is not None
    notes, values = by(out.report, "item", "note"), by(out.report, "item", "value")
    assert notes["NVA accuracy class"] == verdict
    assert values["NVA RMSEV"] == pytest.approx(math.hypot(size, own))
    assert ("MORE THAN HALF" in notes["NVA RMSEV2"]) == (own > 0.051)
    assert notes["NVA checkpoints"].startswith("enough")


def test_too_few_checkpoints_are_said_to_be() -> None:
    layer = checks(np.zeros(29))
    out = CompareSurfaces(surface=slope(), checkpoints=layer, accuracy_class=0.1).run()
    assert out.report is not None
    notes, values = by(out.report, "item", "note"), by(out.report, "item", "value")
    assert notes["NVA checkpoints"] == "TOO FEW: at least 30 are needed"
    assert notes["NVA accuracy class"] == "met, by fewer than 30 checkpoints"
    assert "not given" in notes["NVA RMSEV2"]
    assert math.isnan(values["NVA RMSEV2"])


# The spread of checkpoints --------------------------------------------------------------------


def placed(xy: Any, **columns: Any) -> Vector:
    """Checkpoints on the slope at (n, 2) metres from its south-western corner."""
    x, y = WEST + np.asarray(xy)[:, 0], NORTH - 12 + np.asarray(xy)[:, 1]
    places = shapely.points(x, y, true_height(x, y))
    return Vector(geopandas.GeoDataFrame(columns, geometry=places, crs=UTM))


def test_quarters_have_one_area_whatever_the_outline() -> None:
    square = Quarters.of(slope())
    assert (square.east, *square.north) == (WEST + 6, NORTH - 6, NORTH - 6)
    assert square.area == 144
    values = slope().values[0].copy()
    values[:, 8:] = np.nan  # 8 columns are left, and in the eastern four the northern 6 rows
    values[6:, 4:] = np.nan
    shape = Quarters.of(raster(values))
    assert shape.east == WEST + 3  # 36 of 72 cells
    assert shape.north[0] == NORTH - 6
    known = np.argwhere(np.isfinite(values))[:, ::-1] * [1, -1] + [WEST + 0.5, NORTH - 0.5]
    np.testing.assert_allclose(shape.shares(known), 0.25, atol=0.04)  # whole cells


def test_checkpoints_in_one_corner_are_said_to_be_there(caplog: pytest.LogCaptureFixture) -> None:
    spots = np.random.default_rng(0).uniform(1, 11, (40, 2))
    even = CompareSurfaces(surface=slope(), checkpoints=placed(spots)).run()
    assert not caplog.text
    assert even.report is not None
    assert "whole area" not in even.in_words()
    row = even.report.frame.set_index("item").loc["NVA emptiest quarter"]
    counts = np.histogram2d(*spots.T, bins=[[0, 6, 12]] * 2)[0]
    assert row["value"] == pytest.approx(counts.min() / 40)
    assert row["note"].startswith("well spread: at least 20%")

    crowded = placed(1 + spots * [0.4, 0.4])
    out = CompareSurfaces(surface=slope(), checkpoints=crowded).run()
    assert out.report is not None
    notes = by(out.report, "item", "note")
    assert notes["NVA emptiest quarter"].startswith("UNEVEN")
    assert notes["NVA mean distance to next"].startswith("CROWDED: ")
    assert "NVA: only 0 % of the checkpoints are in the north-west" in caplog.text
    assert "NVA: the checkpoints are crowded" in caplog.text
    assert (
        "do not stand for the whole area: 0 % of them are in its north-west quarter, where a fifth "
        "belongs and they are closer together than places taken by chance (NSSDA, 1998, 3.2.2)"
    ) in out.in_words()


def test_spread_is_told_by_land_cover() -> None:
    spots = np.array(
        [[2.0, 2], [2, 10], [10, 2], [10, 10], [3, 3], [9, 9], [9, 10], [9, 3], [3, 2]]
    )
    kinds = ["grass"] * 4 + ["wood"] * 5
    layer = placed(spots, lc=kinds)
    out = CompareSurfaces(
        surface=slope(), checkpoints=layer, cover_attribute="lc", vegetated=("wood",)
    ).run()
    assert by(out.covers, "cover", "emptiest_quarter") == {"grass": 0.25, "wood": 0.0}
    assert out.report is not None
    values, notes = by(out.report, "item", "value"), by(out.report, "item", "note")
    assert (values["NVA emptiest quarter"], values["VVA emptiest quarter"]) == (0.25, 0.0)
    assert notes["VVA emptiest quarter"].endswith("fewest in the north-west")
    assert values["NVA mean distance to next"] == pytest.approx(8.0)
    # 8 m to the next; at random it would be half the root of 36 m2 a checkpoint.
    assert notes["NVA mean distance to next"] == "2.67 times that of random places"
    rasters = CompareSurfaces(surface=slope(), reference=slope()).run()
    assert "emptiest_quarter" not in rasters.covers.frame


def test_random_places_are_crowded_one_time_in_forty() -> None:
    """One side of 95 %."""
    rng, area = np.random.default_rng(0), Quarters.of(slope())
    places = (rng.uniform((WEST, NORTH - 12), (WEST + 12, NORTH), (50, 2)) for _ in range(400))
    notes = [row["note"] for xy in places for row in spread("NVA", xy, area)]
    assert 0 < sum(note.startswith("CROWDED") for note in notes) < 20


# Units, histogram -----------------------------------------------------------------------------


def test_tables_are_metres_and_layers_feet() -> None:
    foot = 1200 / 3937
    errors = np.random.default_rng(0).normal(0.1, 0.4, 40)
    metric = CompareSurfaces(
        surface=slope(),
        checkpoints=checks(errors),
        checkpoint_rmse=0.2,
        accuracy_class=0.5,
    ).run()
    frame = checks(errors).frame
    frame = frame.set_geometry(frame.geometry.scale(1 / foot, 1 / foot, 1 / foot, (0, 0, 0)))
    layer = Vector(frame.set_crs(FEET, allow_override=True))
    lattice = Lattice(WEST / foot, NORTH / foot, 1 / foot, 12, 12)
    surface = Raster(slope().values / foot, lattice.transform, crs=FEET)
    feet = CompareSurfaces(
        surface=surface, checkpoints=layer, checkpoint_rmse=0.2, accuracy_class=0.5
    ).run()
    for name in ("bias", "rmse", "nmad", "le95"):
        assert getattr(feet, name) == pytest.approx(getattr(metric, name), abs=1e-7)
    bare = CompareSurfaces(surface=surface, checkpoints=layer).run()
    assert "the fit alone" in bare.in_words(), "of checkpoints without RMSE"
    for name in ("table", "covers", "report", "histogram"):
        here, there = (getattr(out, name).frame for out in (feet, metric))
        for column in there.columns:
            if there[column].dtype.kind == "f":
                np.testing.assert_allclose(here[column], there[column], atol=1e-7)
            else:
                assert here[column].tolist() == there[column].tolist()
    np.testing.assert_allclose(
        feet.errors.frame["error"][:8] * foot, metric.errors.frame["error"][:8], atol=1e-7
    )
    told = feet.in_words()
    assert re.search(rf"cm \({metric.rmse / foot:.3g}\d* US ft\)", told)
    assert "The data are in US ft, and so are errors on a map." in told
    assert "metres, 1 m = 3.2808 US ft." in told
    assert "US ft" not in metric.in_words()


def test_histogram_counts_every_error_once() -> None:
    error = np.concatenate([np.random.default_rng(0).normal(0.003, 0.05, 5000), [90.0, -3]])
    rows = list(histogram(error))
    assert sum(row["count"] for row in rows) == len(error)
    assert (rows[0]["low"], rows[-1]["high"]) == (None, None)
    assert 10 < len(rows) < 90
    for before, row in pairwise(rows):
        assert before["high"] == row["low"]
    for row in rows[1:-1]:
        assert row["count"] == np.sum((error >= row["low"]) & (error < row["high"]))
    widths = {round(row["high"] - row["low"], 9) for row in rows[1:-1]}
    assert widths == {0.01}  # 2 * 0.067 / 17.1 = 0.0079, rounded up


def test_widths_are_rounded_up_to_1_2_or_5() -> None:
    widths = [rounded_up(width) for width in (0.0079, 0.011, 0.2, 0.21, 0.5, 7)]
    assert widths == pytest.approx([0.01, 0.02, 0.2, 0.5, 0.5, 10])


@pytest.mark.parametrize("value", [0.0, 0.25, -1.0])
def test_histogram_of_one_value(value: float) -> None:
    rows = list(histogram(np.full(7, value)))
    assert sum(row["count"] for row in rows[1:-1]) == 7
    assert len(rows) >= 3


# Bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({}, "reference: give one of reference, checkpoints and points, got none"),
        (
            {"checkpoints": checks(), "reference": slope()},
            "reference: give one of reference, checkpoints and points, got reference and check",
        ),
        ({"reference": slope(crs=CRS(32636), name="b.tif")}, "reproject it to EPSG:32635"),
        ({"reference": slope(units=("foot",), name="b.tif")}, "b.tif holds values in foot"),
        ({"checkpoints": checks(), "cover_attribute": "lc"}, "no attribute 'lc'; there are none"),
        ({"checkpoints": checks(), "vegetated": ("a",)}, "vegetated: there is no land cover"),
        ({"checkpoints": checks(), "classes": ClassList([2])}, "classes: there are no points"),
        ({"checkpoints": checks(), "resample": True}, "resample: is for a reference raster"),
        ({"reference": slope(), "accuracy_class": 0.1}, "accuracy_class: is for the report"),
        (
            {"reference": slope(), "cover": slope(), "cover_attribute": "lc"},
            "cover: give the land cover once",
        ),
        (
            {"reference": slope(), "areas": checks()},
            "areas: must be polygons, checks.gpkg holds a Point",
        ),
    ],
)
def test_what_does_not_fit_is_refused_by_name(more: dict[str, Any], text: str) -> None:
    with pytest.raises((DataError, ParameterError)) as error:
        CompareSurfaces(surface=slope(name="a.tif"), **more)
    assert text in str(error.value)


@pytest.mark.parametrize(
    ("shape", "text"),
    [
        (shapely.Point(WEST + 5, 95), "holds a point without a height (Z)"),
        (shapely.LineString([(WEST, 95, 1), (WEST + 5, 95, 1)]), "holds a LineString"),
        (None, "holds a feature without a place"),
        ([], "holds no points"),
    ],
)
def test_checkpoints_are_points_with_heights(shape: Any, text: str) -> None:
    shapes = [shape] if shape != [] else []
    layer = Vector(geopandas.GeoDataFrame(geometry=shapes, crs=UTM), name="c.gpkg")
    with pytest.raises(DataError, match=r"checkpoints: .*c\.gpkg") as error:
        CompareSurfaces(surface=slope(), checkpoints=layer)
    assert text in str(error.value)


def test_heights_in_a_column_of_another_name_are_asked_for() -> None:
    frame = geopandas.GeoDataFrame({"pt": ["A"], "level": [5.0]}, geometry=[shapely.Point(1, 2)])
    layer = Vector(frame.set_crs(UTM), name="c.csv")
    with pytest.raises(DataError, match="of a CSV it is the column z, and there are pt, level"):
        CompareSurfaces(surface=slope(), checkpoints=layer)


def test_covers_that_do_not_occur_are_named() -> None:
    with pytest.raises(DataError, match=r"no land cover 'wood' was met; there are forest, road"):
        CompareSurfaces(
            surface=slope(),
            checkpoints=checks(lc=COVERS),
            cover_attribute="lc",
            vegetated=("wood",),
        ).run()


@pytest.mark.parametrize("resample", [False, True])
@pytest.mark.parametrize("cell", [1.0, 0.4])
def test_rasters_of_other_places_cannot_be_resampled(resample: bool, cell: float) -> None:
    """Whatever their cells are, what is wrong is the place."""
    lattice = Lattice(WEST + 12, NORTH, cell, 5, 5)  # beside the surface, edge to edge
    away = Raster.from_lattice(np.ones((5, 5)), lattice, crs=slope().crs)
    with pytest.raises(DataError, match="lies nowhere on the area") as caught:
        CompareSurfaces(surface=slope(), reference=away, resample=resample).run()
    assert "give resample" not in str(caught.value)


@pytest.mark.parametrize(
    ("turn", "told"),
    [
        (lambda z: z + 44.0, "lies 44.00 m below the reference"),
        (lambda z: z / 0.3048, "feet beside metres"),
        (lambda z: z * 1000.0, "millimetres beside metres"),
        (lambda z: z + 0.5, ""),  # ground that was built up
        (lambda z: z + 2.0 + np.sin(40.0 * z), ""),  # no offset alike everywhere
    ],
)
def test_heights_of_another_unit_or_system_are_told(
    turn: Any, told: str, caplog: pytest.LogCaptureFixture
) -> None:
    one = slope()
    other = raster(turn(one.band().astype(float)), cell=1.0)
    CompareSurfaces(surface=one, reference=other).run()
    assert told in caplog.text
    assert bool(told) == bool(caplog.messages)
