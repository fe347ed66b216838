"""Tables come back as they went."""

from __future__ import annotations

import csv
import datetime as dt
import json
import math
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from toolbox.data import Vector
from toolbox.data.table import Table
from toolbox.errors import DataError

ROWS: list[dict[str, Any]] = [
    {"id": 1, "count": 3, "share": 0.1 + 0.2, "text": "NA", "good": True, "seen": True},
    {"id": 2, "count": None, "share": None, "text": 'é, "x"', "good": False, "seen": None},
    {"id": 3, "count": 2**60 + 1, "share": 1e-300, "text": None, "good": True, "late": 5},
]
TYPES = ["int64", "Int64", "float64", "string", "bool", "boolean", "Int64"]


@pytest.mark.parametrize("suffix", Table.SUFFIXES)
def test_round_trip_keeps_values_and_types(tmp_path: Path, suffix: str) -> None:
    table = Table.from_rows(ROWS)
    assert [str(dtype) for dtype in table.frame.dtypes] == TYPES
    table.save(tmp_path / f"a{suffix}")
    found = Table.open(tmp_path / f"a{suffix}")
    assert found.name == f"a{suffix}"
    assert found.frame.dtypes.equals(table.frame.dtypes)
    assert found.frame.equals(table.frame)
    assert found.frame["share"][0] == 0.30000000000000004


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1))
def test_every_float_reads_back_exactly(
    tmp_path_factory: pytest.TempPathFactory, values: list[float]
) -> None:
    folder = tmp_path_factory.mktemp("floats")
    for suffix in (".csv", ".json"):
        Table.from_rows({"a": value} for value in values).save(folder / f"a{suffix}")
        assert Table.open(folder / f"a{suffix}").frame["a"].tolist() == values


def test_same_bytes_on_every_run(tmp_path: Path) -> None:
    for suffix in Table.SUFFIXES:
        made = []
        for name in ("a", "b"):
            (tmp_path / name).mkdir(exist_ok=True)
            Table.from_rows(ROWS).save(tmp_path / name / f"rows{suffix}")
            made.append((tmp_path / name / f"rows{suffix}").read_bytes())
        assert made[0] == made[1]


def test_json_is_a_list_of_records(tmp_path: Path) -> None:
    Table.from_rows(ROWS).save(tmp_path / "a.json")
    first, second, _ = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert first == ROWS[0] | {"late": None}
    assert second["count"] is None


def test_records_are_ready_for_json(tmp_path: Path) -> None:
    frame = pd.DataFrame(
        {
            "count": np.array([1, 2], np.uint16),
            "share": np.array([0.5, np.nan]),
            "seen": pd.array([True, None], dtype="boolean"),
            "flown": pd.to_datetime(["2024-05-01T10:00:00.25", None]),
            "took": pd.to_timedelta(["90s", None]),
            "mixed": [np.int64(7), np.datetime64("2024-05-01", "D")],
            "day": [dt.date(2024, 5, 1), dt.time(10, 30)],
            "codes": [np.array([2, 6]), None],
            8: ["é", None],
        }
    )
    first, second = Table(frame).rows()
    assert first == {
        "count": 1,
        "share": 0.5,
        "seen": True,
        "flown": "2024-05-01T10:00:00.250000",
        "took": "P0DT0H1M30S",
        "mixed": 7,
        "day": "2024-05-01",
        "codes": [2, 6],
        "8": "é",
    }
    assert second == dict.fromkeys(first) | {
        "count": 2,
        "mixed": "2024-05-01T00:00:00",
        "day": "10:30:00",
    }
    Table(frame).save(tmp_path / "a.json")
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == [first, second]
    assert Table.own_files(tmp_path / "a.json") == (tmp_path / "a.json",)


@pytest.mark.parametrize("suffix", Table.SUFFIXES)
def test_table_without_rows(tmp_path: Path, suffix: str) -> None:
    empty = Table(Table.from_rows(ROWS).frame.iloc[:0])
    empty.save(tmp_path / f"a{suffix}")
    found = Table.open(tmp_path / f"a{suffix}")
    assert len(found) == 0
    if suffix != ".json":  # a list of no records has no columns
        assert list(found.frame) == list(empty.frame)


def test_text_is_aligned() -> None:
    rows = [
        {"name": "Ground", "x": 6277500.25, "share": 2 / 3, "n": 12, "ok": True},
        {"name": "a", "x": 5.0, "share": None, "n": None, "ok": False},
    ]
    assert Table.from_rows(rows).text() == (
        "name             x     share   n  ok\n"
        "Ground  6277500.25  0.666667  12  True\n"
        "a                5         -   -  False"
    )


def test_frame_handed_out_may_be_changed() -> None:
    table = Table.from_rows(ROWS)
    frame = table.frame
    frame.loc[0, "id"] = 99
    assert table.frame["id"][0] == 1


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("a.csv", "a,b\n1,2\n3,4,5\n", "Expected 2 fields"),
        ("a.json", '{"a": 1}', "a list of records is needed"),
        ("a.json", "[1, 2]", "a list of records is needed"),
        ("a.json", "[{", "cannot be read as a table"),
        ("a.json", "[" * 100_000, "nested too deeply"),
        ("a.parquet", "no", "cannot be read as a table"),
        ("a.xlsx", "", "tables are read from .csv, .json, .parquet"),
    ],
)
def test_what_is_no_table(tmp_path: Path, name: str, content: str, problem: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(DataError, match=problem) as error:
        Table.open(tmp_path / name)
    assert name in str(error.value)


@pytest.mark.parametrize("suffix", [".gpkg", ".parquet", ".csv", ".json"])
def test_damage_is_an_error_or_seen_in_the_rows(tmp_path: Path, suffix: str) -> None:
    """Whatever the library raises: a damaged file is no mistake of ours."""
    Table.from_rows(ROWS).save(tmp_path / f"a{suffix}")
    content = (tmp_path / f"a{suffix}").read_bytes()
    used = np.flatnonzero(np.frombuffer(content, np.uint8))
    rng, path, refused = np.random.default_rng(0), tmp_path / f"b{suffix}", 0
    for _ in range(60):
        broken = bytearray(content)
        for at in rng.choice(used, min(20, len(used))):
            broken[at] = rng.integers(256)
        path.write_bytes(broken)
        try:
            Table.open(path)
        except DataError as error:
            assert path.name in str(error)  # noqa: PT017  some are read
            refused += 1
    assert refused


def test_missing_file() -> None:
    with pytest.raises(DataError, match=r"nowhere.csv: no such file"):
        Table.open("nowhere.csv")


def test_what_a_format_cannot_hold(tmp_path: Path) -> None:
    table = Table.from_rows([{"a": math.inf}])
    table.save(tmp_path / "a.csv")
    assert Table.open(tmp_path / "a.csv").frame["a"][0] == math.inf
    with pytest.raises(DataError, match=r"a\.json cannot be written: .*not JSON compliant"):
        table.save(tmp_path / "a.json")
    with pytest.raises(DataError, match="tables are written as"):
        table.save(tmp_path / "a.txt")
    with pytest.raises(DataError, match="cannot be written"):
        table.save(tmp_path / "no folder" / "a.csv")


def test_parquet_needs_pyarrow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("toolbox.data.extras.find_spec", lambda name: None)
    with pytest.raises(DataError, match="pip install pyarrow"):
        Table.from_rows(ROWS).save(tmp_path / "a.parquet")


def test_rows_longer_than_the_header_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1,2,3\n4,5,6\n")
    with pytest.raises(DataError, match="more cells than its header"):
        Table.open(tmp_path / "a.csv")


def test_parquet_writes_columns_of_mixed_types_as_text(tmp_path: Path) -> None:
    table = Table.from_rows([{"a": 1}, {"a": "two"}, {"a": None}])
    table.save(tmp_path / "a.parquet")
    assert [row["a"] for row in Table.open(tmp_path / "a.parquet").rows()] == ["1", "two", None]


def test_geopackage_of_a_table_and_a_layer(tmp_path: Path) -> None:
    roofs = gpd.GeoDataFrame({"a": [1]}, geometry=[shapely.Point(1, 2)], crs=32635)
    rows = pd.DataFrame({"n": pd.array([1, None], dtype="Int64"), "x": [0.1, np.nan]})
    for name in ("a.gpkg", "b.gpkg"):
        Vector(roofs).save(tmp_path / name, layer="roofs")
        Table(rows).save(tmp_path / name, layer="rows", add=True)
        Table(rows.assign(n=3)).save(tmp_path / name, layer="more", add=True)
    assert (tmp_path / "a.gpkg").read_bytes() == (tmp_path / "b.gpkg").read_bytes()
    assert Vector.layers(tmp_path / "a.gpkg") == ("roofs",)
    pd.testing.assert_frame_equal(Table.open(tmp_path / "a.gpkg", layer="rows").frame, rows)
    with pytest.raises(DataError, match="its tables are rows, more; name one as layer"):
        Table.open(tmp_path / "a.gpkg")
    Table(rows).save(tmp_path / "a.gpkg", overwrite=True)
    assert len(Table.open(tmp_path / "a.gpkg")) == 2
    assert Vector.layers(tmp_path / "a.gpkg") == ()


FORMULAS = ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\tx", "\r=x", "'=1+1", "''@a"]
HARMLESS = ["-5.2", "+49123", "-", "a=b", "'quoted'", "-inf", "", "=", "1e-3"]


def read_cells(path: Path) -> list[list[str]]:
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_texts_that_a_spreadsheet_takes_for_formulas(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.csv"
    table = Table.from_rows({"=name": text, "n": -1.5} for text in FORMULAS)
    table.save(path)
    rows = read_cells(path)
    assert [row[0] for row in rows] == [f"'{text}" for text in ("=name", *FORMULAS)]
    assert {row[1] for row in rows[1:]} == {"-1.5"}
    assert "apostrophe stands before" in caplog.text
    assert "'=name' and 8 more" in caplog.text
    assert Table.open(path).frame.equals(table.frame)


def test_texts_that_are_no_formulas_stay_as_they_are(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    Table.from_rows({"text": text, "n": 1} for text in HARMLESS).save(tmp_path / "a.csv")
    assert [row[0] for row in read_cells(tmp_path / "a.csv")] == ["text", *HARMLESS]
    assert not caplog.text


def test_every_end_of_line_within_a_cell_comes_back(tmp_path: Path) -> None:
    table = Table.from_rows({"text": text, "n": 1} for text in ("a\rb", "a\nb", "a\r\nb", "a"))
    table.save(tmp_path / "a.csv")
    assert Table.open(tmp_path / "a.csv").frame.equals(table.frame)


def test_a_zero_byte_would_cut_a_text_of_a_geopackage(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"'text' has a zero byte in 'a\\x00b'"):
        Table.from_rows([{"text": "a\0b"}]).save(tmp_path / "a.gpkg")
    assert not (tmp_path / "a.gpkg").exists()


def test_measures_are_rounded_for_people_unless_they_are_not_to_be(tmp_path: Path) -> None:
    rows = [{"measure": "limit", "value": 0.1 + 0.2, "unit": "m"}]
    measures, others = Table.from_rows(rows), Table.from_rows([{"level": 0.1 + 0.2}])
    measures.save(tmp_path / "a.csv")
    assert "0.3,m" in (tmp_path / "a.csv").read_text()
    measures.save(tmp_path / "b.csv", rounded=False)
    assert "0.30000000000000004,m" in (tmp_path / "b.csv").read_text()
    measures.save(tmp_path / "c.json")
    assert "0.30000000000000004" in (tmp_path / "c.json").read_text()
    others.save(tmp_path / "d.csv")
    assert "0.30000000000000004" in (tmp_path / "d.csv").read_text(), "which tools read again"
