"""Shapefiles: names that do not fit come back, and values that do not fit are told."""

from __future__ import annotations

import logging
from pathlib import Path

import geopandas
import numpy as np
import pandas as pd
import pyogrio
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from toolbox.data import shapefile
from toolbox.data.vector import Vector
from toolbox.errors import DataError


def layer(**columns: object) -> Vector:
    columns = columns or {"height_above_ground": [1.5], "height_above_water": [2.5], "id": [3]}
    size = len(next(iter(columns.values())))  # type: ignore[arg-type]
    places = [shapely.Point(place, 0) for place in range(size)]
    return Vector(geopandas.GeoDataFrame(columns, geometry=places, crs=32635))


@pytest.mark.parametrize(
    ("names", "fields"),
    [
        (["id", "ten_bytes_"], ["id", "ten_bytes_"]),
        (["height_above_ground", "height_above_water"], ["height_abo", "height_a_1"]),
        (
            ["height_above_ground", "height_abo", "HEIGHT_A_1"],
            ["height_a_2", "height_abo", "HEIGHT_A_1"],
        ),
        (["Name", "name"], ["Name", "name_1"]),  # which a data base takes for one
        (["ööööö", "öööööö", "aööööö"], ["ööööö", "öööö_1", "aöööö"]),  # two bytes each
        (["ten chars and more"], ["ten chars"]),
        ([f"attribute_{n}" for n in range(11)][-2:], ["attribute_", "attribut_1"]),
    ],
)
def test_the_rule_of_short_names(names: list[str], fields: list[str]) -> None:
    found = shapefile.field_names(names)
    assert [found[name] for name in names] == fields


@given(st.lists(st.text(st.characters(exclude_categories=("C",)), min_size=1), unique=True))
def test_short_names_fit_and_differ(names: list[str]) -> None:
    found = shapefile.field_names(names)
    assert found.keys() == set(names)
    assert all(len(field.encode()) <= 10 for field in found.values())
    assert len({field.lower() for field in found.values()}) == len(names)


def test_long_names_come_back(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    path = tmp_path / "a.shp"
    layer().save(path)
    assert (tmp_path / "a.fields.csv").read_bytes() == (
        b"field,attribute\nheight_abo,height_above_ground\nheight_a_1,height_above_water\n"
    )
    assert (
        "a.shp: names of more than 10 bytes are cut, and stand in a.fields.csv" in caplog.messages
    )
    assert list(pyogrio.read_dataframe(path))[:3] == ["height_abo", "height_a_1", "id"]
    assert Vector.open(path).frame.equals(layer().frame)
    assert {tmp_path / "a.fields.csv", *shapefile.parts(path)} <= set(Vector.own_files(path))
    assert tmp_path / "a.fields.csv" in shapefile.parts(path)


def test_no_side_table_without_need(tmp_path: Path) -> None:
    layer().save(tmp_path / "a.shp")
    layer(id=[1]).save(tmp_path / "a.shp", overwrite=True)
    assert not (tmp_path / "a.fields.csv").exists()
    assert Vector.open(tmp_path / "a.shp").names == ("id",)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "id,attribute\n",
        "field,attribute\nid\n",
        "field,attribute\nid,long\nid_1,long\n",
        "\xff\n",
    ],
)
def test_a_damaged_side_table_is_an_error(tmp_path: Path, text: str) -> None:
    layer().save(tmp_path / "a.shp")
    (tmp_path / "a.fields.csv").write_text(text, encoding="latin-1")
    with pytest.raises(DataError, match=r"a\.fields\.csv"):
        Vector.open(tmp_path / "a.shp")


def test_times_become_texts(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    times = pd.to_datetime(["2024-05-01T10:00:00.5", None])
    layer(flown=times).save(tmp_path / "a.shp")
    found = Vector.open(tmp_path / "a.shp").frame["flown"]
    assert found.fillna("").tolist() == ["2024-05-01T10:00:00.500000", ""]
    assert "a.shp: a Shapefile has no times; flown is text" in caplog.messages


def test_small_numbers_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    layer(share=[0.0, 1e-8, np.nan]).save(tmp_path / "a.shp")
    assert not caplog.messages
    layer(share=[0.0, 1.23456789e-9, np.nan]).save(tmp_path / "a.shp", overwrite=True)
    assert "share has numbers below 1e-08" in caplog.text
    assert Vector.open(tmp_path / "a.shp").frame["share"][1] == pytest.approx(1.234568e-9, rel=1e-6)


def test_numbers_that_fit_come_back(tmp_path: Path) -> None:
    large = [10**18 - 1, -(10**17) + 1, 2**53 + 1]
    layer(n=large, x=[123456789.123456789, 1e17, -1e-3]).save(tmp_path / "a.shp")
    found = Vector.open(tmp_path / "a.shp").frame
    assert found["n"].tolist() == large
    assert found["x"].tolist() == [123456789.123456789, 1e17, -1e-3]
