"""compare.rasters: maps of classes against maps, polygons and samples of points."""

from __future__ import annotations

from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.compare.rasters import CompareRasters
from toolbox.data import Lattice, Raster, Table, Vector
from toolbox.declare import ClassList
from toolbox.errors import DataError

UTM = CRS(32635)
LATTICE = Lattice.cover((0, 0, 200, 100), 2.0)


def raster(codes: NDArray[Any], lattice: Lattice = LATTICE, crs: CRS = UTM) -> Raster:
    return Raster.from_lattice(codes.astype(np.uint8), lattice, crs=crs, nodata=255)


def halves() -> NDArray[np.int64]:
    """Class 1 in the west, 2 in the east."""
    codes = np.ones(LATTICE.shape, int)
    codes[:, LATTICE.cols // 2 :] = 2
    return codes


def shifted(cells: int) -> NDArray[np.int64]:
    return np.roll(halves(), cells, axis=1)


def layer(shapes: list[Any], **columns: Any) -> Vector:
    return Vector(geopandas.GeoDataFrame(columns, geometry=shapes, crs=UTM), name="a.gpkg")


def by(table: Table, column: str) -> dict[str, dict[str, Any]]:
    return {row[column]: row for row in table.rows()}


def test_quantity_and_allocation() -> None:
    grown = halves()
    grown[:, 50:60] = 1  # a tenth of the map
    out = CompareRasters(classes=raster(grown), reference=raster(halves())).run()
    assert out.overall_accuracy == pytest.approx(90)
    assert (out.quantity_disagreement, out.allocation_disagreement) == pytest.approx((10, 0))
    out = CompareRasters(classes=raster(shifted(10)), reference=raster(halves())).run()
    assert (out.quantity_disagreement, out.allocation_disagreement) == pytest.approx((0, 20))
    assert out.difference is not None
    assert (out.difference.values == 1).mean() == pytest.approx(0.2)


def test_cells_without_a_value_and_beyond_the_reference_are_counted() -> None:
    codes = halves()
    codes[:5] = 255
    smaller = Lattice.cover((20, 0, 240, 100), 2.0)  # begins ten columns later, and goes on
    truth = raster(np.ones(smaller.shape), smaller)
    out = CompareRasters(classes=raster(codes), reference=truth).run()
    assert out.count == 45 * 90
    assert out.missing == 45 * 10
    assert out.absent == 5 * 90 + 50 * 20  # cells without a value, and columns beyond the map
    assert out.overall_accuracy == pytest.approx(100 * 40 / 90)
    assert out.difference is not None
    assert (out.difference.values == 255).sum() == 5 * 100 + 45 * 10


def test_polygons_with_names_of_classes() -> None:
    shapes = [shapely.box(0, 0, 100, 100), shapely.box(100, 0, 180, 100)]
    truth = layer(shapes, kind=["field", "wood"])
    out = CompareRasters(
        classes=raster(halves()), areas=truth, class_attribute="kind", map=("1=field", "2=wood")
    ).run()
    assert out.overall_accuracy == 100
    assert (out.missing, out.absent) == (50 * 10, 0)
    assert [row["class"] for row in out.by_class.rows()] == ["field", "wood"]


def test_polygons_with_codes_and_classes_left_out() -> None:
    shapes = [shapely.box(0, 0, 100, 100), shapely.box(100, 0, 200, 100)]
    truth = layer(shapes, code=[1, 0])
    out = CompareRasters(
        classes=raster(halves()),
        areas=truth,
        class_attribute="code",
        leave_out=ClassList([0]),
    ).run()
    assert out.count == 50 * 50
    assert out.overall_accuracy == 100


def test_polygons_that_the_map_does_not_hold_are_counted(caplog: pytest.LogCaptureFixture) -> None:
    """One over cells without a class, one half beyond the map, one that is left out."""
    codes = halves()
    codes[:, :10] = 255
    shapes = [
        shapely.box(0, 0, 40, 100),
        shapely.box(180, 0, 220, 100),
        shapely.box(300, 0, 400, 9),
    ]
    truth = layer(shapes, code=[1, 2, 0])
    job: dict[str, Any] = {"classes": raster(codes), "areas": truth, "class_attribute": "code"}
    out = CompareRasters(**job, leave_out=ClassList([0])).run()
    assert out.count == 50 * 20
    assert out.absent == 50 * 10 + 50 * 10
    assert "1000 of 2000 cells of the reference (50 %) are absent" in caplog.text
    assert CompareRasters(**job).run().absent == 1000 + 225


def test_points_beyond_the_map_are_absent_and_few_points_are_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    points = layer(list(shapely.points([10, 190, 250], 50)), seen=[1, 2, 2])
    out = CompareRasters(classes=raster(halves()), checkpoints=points, class_attribute="seen").run()
    assert (out.count, out.missing, out.absent) == (2, 1, 1)
    assert "only 2 points are compared" in caplog.text
    assert "up to 78 % of all such points could differ" in caplog.text
    assert caplog.text.count("absent from") == 0  # one warning is enough


def test_a_stratified_sample_counts_for_the_area_of_the_map() -> None:
    """25 points in each class, of which one holds nine tenths of the map."""
    codes = np.ones(LATTICE.shape, int)
    codes[:, 90:] = 2
    rng = np.random.default_rng(0)
    x = np.r_[rng.uniform(0, 180, 25), rng.uniform(180, 200, 25)]
    points = shapely.points(x, rng.uniform(0, 100, 50))
    truth = np.r_[np.ones(25), np.full(25, 2)]
    truth[:5] = 2  # a fifth of the larger class is wrong
    sample = layer(list(points), seen=truth)
    job: dict[str, Any] = {"classes": raster(codes), "class_attribute": "seen"}
    plain = CompareRasters(**job, checkpoints=sample).run()
    assert plain.overall_accuracy == pytest.approx(90)
    assert plain.class_areas is None
    out = CompareRasters(**job, checkpoints=sample, stratified=True).run()
    assert out.class_areas is not None
    rows = by(out.class_areas, "class")
    assert rows["all"]["overall_accuracy"] == pytest.approx(100 * (0.9 * 0.8 + 0.1))
    assert rows["class 1"]["mapped_area"] == pytest.approx(18_000)
    assert rows["class 2"]["area"] == pytest.approx(2_000 + 0.2 * 18_000)
    assert rows["class 2"]["area_low"] < 5_600 < rows["class 2"]["area_high"]
    error = np.sqrt(0.9**2 * 0.8 * 0.2 / 24) * 20_000  # equation 10, by hand
    width = rows["class 2"]["area_high"] - rows["class 2"]["area_low"]
    assert width == pytest.approx(2 * 1.96 * error)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({}, "reference: give one of reference, areas and checkpoints, got none"),
        ({"reference": "cells"}, "has cells of 3, not the 2"),
        ({"reference": "crs"}, "reference: "),
        ({"reference": "same", "class_attribute": "a"}, "class_attribute: is for polygons"),
        ({"reference": "same", "stratified": True}, "stratified: is for checkpoints"),
        ({"areas": "points", "class_attribute": "seen"}, "areas: must be polygons"),
        ({"checkpoints": "points", "class_attribute": "b"}, "no attribute 'b'; there are seen"),
    ],
)
def test_what_cannot_be_compared(settings: dict[str, Any], text: str) -> None:
    other = Lattice.cover((0, 0, 200, 100), 3.0)
    layers: dict[str, Any] = {
        "cells": raster(np.ones(other.shape), other),
        "crs": raster(halves(), crs=CRS(32636)),
        "same": raster(halves()),
        "points": layer([shapely.Point(1, 1)], seen=[1]),
    }
    given = {name: layers.get(str(value), value) for name, value in settings.items()}
    with pytest.raises(DataError, match=text):
        CompareRasters(classes=raster(halves()), **given)


def test_heights_are_no_classes() -> None:
    heights = Raster.from_lattice(np.full(LATTICE.shape, 1.5), LATTICE, crs=UTM)
    with pytest.raises(DataError, match=r"classes must be whole numbers, got 1\.5"):
        CompareRasters(classes=heights, reference=raster(halves())).run()
