"""Tables of measures in reports: each row has the digits of its own unit, in all three formats."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import openpyxl
import pytest

from toolbox.data import Report, Rows, Section, Table, measures

ROWS = [
    {"measure": "count", "value": 159996.0, "low": None, "high": None, "unit": "1"},
    {"measure": "bias", "value": -0.0131, "low": -0.0142, "high": -0.012, "unit": "m"},
    {"measure": "kappa", "value": 0.46951, "low": 0.41, "high": 0.53, "unit": "1"},
    {"measure": "Type II", "value": 2.4567, "low": None, "high": None, "unit": "%"},
    {"measure": "area", "value": 861.90595, "low": None, "high": None, "unit": "m2"},
    {"measure": "nothing", "value": -0.00001, "low": None, "high": None, "unit": "ft"},
]
SHOWN = [
    ["count", "159996", "", "", ""],
    ["bias", "-0.0131", "-0.0142", "-0.0120", "m"],
    ["kappa", "0.4695", "0.4100", "0.5300", ""],
    ["Type II", "2.46", "", "", "%"],
    ["area", "861.91", "", "", "m²"],
    ["nothing", "0.000", "", "", "ft"],
]


def report() -> Report:
    return Report("Accuracy", [Section("Measures", [Rows(Table.from_rows(ROWS))])])


def test_each_row_of_the_page_has_the_digits_of_its_unit() -> None:
    text = report().html()
    found = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>.*", text)]
    assert [row for row in found if row] == SHOWN


@pytest.mark.skipif(not shutil.which("pdftotext"), reason="reads the PDF with pdftotext")
def test_each_row_on_paper_has_the_digits_of_its_unit(tmp_path: Path) -> None:
    report().save(tmp_path / "a.pdf")
    read = ["pdftotext", "-layout", tmp_path / "a.pdf", "-"]
    words = subprocess.run(read, capture_output=True, text=True, check=True).stdout
    for row in SHOWN:
        assert all(cell in words for cell in row)


def test_each_cell_of_the_workbook_has_the_digits_of_its_unit(tmp_path: Path) -> None:
    report().save(tmp_path / "a.xlsx")
    sheet = openpyxl.load_workbook(tmp_path / "a.xlsx")["Measures"]
    forms = [cell.number_format for cell in sheet["B"][1:]]
    assert forms == ["0", "0.0000", "0.0000", "0.00", "0.00", "0.000"]
    assert sheet["C3"].number_format == "0.0000"
    assert sheet["B3"].value == -0.0131, "the number is whole"


@pytest.mark.parametrize(
    ("values", "unit", "digits"),
    [
        ([], "m", 0),
        ([0.0], "1", 0),
        ([0.0353], "m", 3),
        ([0.00042, 0.00040, 0.00044], "m", 6),
        ([123.456], "1", 1),
        ([0.00012], "1/m2", 7),
        ([1e-12], "1/m2", 8),
        ([12.3456], "deg", 4),
        ([2.0], "points", 0),
        ([5043.0], "m2", 0),  # rounded, as results are in their sentences
        ([5042.73], "m2", 2),
        ([12.0], "m2", 2),
    ],
)
def test_digits_follow_the_unit_and_the_interval(
    values: list[float], unit: str, digits: int
) -> None:
    assert measures.digits_of(values, unit) == digits


def test_a_table_of_other_things_keeps_the_digits_of_its_columns() -> None:
    rows = Rows(Table.from_rows([{"level": 500.0, "unit": "metre"}, {"level": 0.5, "unit": "m"}]))
    assert rows.cells == [["500.0", "metre"], ["0.5", "m"]]


def test_numbers_stand_among_texts_in_a_table_of_results(tmp_path: Path) -> None:
    rows = [{"Result": "Mean", "Value": 0.01312, "Unit": "m"}, {"Result": "Kind", "Value": "flat"}]
    made = Report("A", [Section("Results", [Rows(Table.from_rows(rows))])])
    assert '<td class="number">0.013</td>' in made.html()
    made.save(tmp_path / "a.xlsx")
    sheet = openpyxl.load_workbook(tmp_path / "a.xlsx")["Results"]
    assert sheet["B2"].value == 0.01312
    assert sheet["B2"].number_format == "0.000"
