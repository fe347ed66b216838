"""Numbers in files that are handed over: the digits that a survey knows, and no more."""

from __future__ import annotations

from pathlib import Path

import geopandas
import pandas as pd
import pytest
import shapely

from toolbox.data import Table, Vector
from toolbox.data.rounding import rounded

TOLD = {
    "length": 217.19582883,
    "area_m2": 8983.737943,
    "volume": 12345.678,
    "seen_share": 0.9584421,
}
TOLD |= {"latitude": 46.63254012345, "level": 499.9999084472656, "tiny": 0.000123456}
SHOWN = {"length": 217.196, "area_m2": 8983.74, "volume": 12345.7, "seen_share": 0.9584}
SHOWN |= {"latitude": 46.63254012, "level": 500.0, "tiny": 0.0001235}


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("length", 0.0123456, 0.012),
        ("curvature", 0.000741234, 0.0007412),
        ("slope", 0.00004, 0.00004),  # of a calm river, which is none if it becomes 0
        ("area", 0.0512345, 0.05123),
        ("share", 0.00512345, 0.0051),
        ("volume", 0.0, 0.0),
        ("level", 800.0975, 800.097),  # as in words: a level stood with two values in one set
    ],
)
def test_a_column_that_would_have_one_digit_keeps_four(
    name: str, value: float, shown: float
) -> None:
    """By the digits that its unit has: of shares, with four decimals, 0.0051 are two."""
    assert rounded(Table.from_rows([{name: value}]).frame)[name].tolist() == [shown]


def test_numbers_that_may_be_missing_are_rounded() -> None:
    frame = pd.DataFrame({"length": pd.array([0.51234, None], "Float64")})
    assert rounded(frame)["length"].fillna(-1).tolist() == [0.512, -1]


def features() -> Vector:
    place = shapely.Point(230137.4012345, 562668.6754321, 28.766000000000002)
    rows = {name: [value] for name, value in {**TOLD, "points": 7, "kind": "tree"}.items()}
    return Vector(geopandas.GeoDataFrame(rows, geometry=[place], crs="EPSG:28992"))


def test_a_table_is_rounded_only_when_asked(tmp_path: Path) -> None:
    table = Table.from_rows([TOLD, {"length": None}])
    table.save(tmp_path / "a.csv", rounded=True)
    assert Table.open(tmp_path / "a.csv").rows()[0] == SHOWN
    table.save(tmp_path / "b.csv")
    assert Table.open(tmp_path / "b.csv").rows()[0] == TOLD


def test_each_row_of_measures_has_the_digits_of_its_unit() -> None:
    rows = [("kappa", 0.469513, "1"), ("area", 861.90595, "m2"), ("none", None, "m")]
    table = Table.from_rows([dict(zip(("measure", "value", "unit"), r, strict=True)) for r in rows])
    assert rounded(table.frame)["value"].tolist()[:2] == [0.4695, 861.91]


@pytest.mark.parametrize("name", ["a.gpkg", "a.geojson"])
def test_attributes_are_rounded_and_places_kept(tmp_path: Path, name: str) -> None:
    layer = features()
    layer.save(tmp_path / name, rounded=True)
    frame = Vector.open(tmp_path / name).frame
    assert {column: frame[column][0] for column in SHOWN} == SHOWN
    assert frame["points"][0] == 7
    if name.endswith(".gpkg"):
        assert frame.geometry[0].equals_exact(layer.frame.geometry[0], 0)


def test_coordinates_of_csv_have_millimetres(tmp_path: Path) -> None:
    features().save(tmp_path / "a.csv", rounded=True)
    assert "\n230137.401,562668.675,28.766," in (tmp_path / "a.csv").read_text()
    line = shapely.LineString([(0.123456, 1), (2.5, 3)])
    Vector(geopandas.GeoDataFrame(geometry=[line], crs=28992)).save(
        tmp_path / "b.csv", rounded=True
    )
    assert "LINESTRING (0.123 1, 2.5 3)" in (tmp_path / "b.csv").read_text()
    place = shapely.Point(5.2263271234567, 46)
    Vector(geopandas.GeoDataFrame(geometry=[place], crs=4326)).save(
        tmp_path / "c.csv", rounded=True
    )
    assert "5.22632712," in (tmp_path / "c.csv").read_text()
