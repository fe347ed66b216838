"""Reports as workbooks: sheets with headings in words, numbers as numbers, nothing that runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import openpyxl
import pytest

from toolbox.data import Report, Rows, Section, Table
from toolbox.data.report import Column
from toolbox.data.report.blocks import Head
from toolbox.data.report.render import render

ROWS = [
    {"span_id": 1, "length": 84.25, "share": 0.5, "kind": "tree", "hidden": 3},
    {"span_id": 2, "length": None, "share": 0.25, "kind": "=1+1", "hidden": 4},
]
COLUMNS = {
    "length": Column("Length of the span", "m", 1),
    "share": Column("Seen", "%", 0, 100.0),
    "hidden": Column(""),
}


def report(*titles: str) -> Report:
    table = Table.from_rows(ROWS)
    sections = [Section(title, [Rows(table, columns=COLUMNS, most=1)]) for title in titles]
    head = Head([("Client", "Grid Ltd")], ["Two wires are missing"], ["Rivers"])
    return Report("Line 12", sections, summary="All is well.", head=head)


def opened(made: Report, tmp_path: Path) -> Any:
    made.save(tmp_path / "a.xlsx", date="2026-05-01")
    return openpyxl.load_workbook(tmp_path / "a.xlsx")


def test_a_sheet_has_all_rows_with_headings_in_words(tmp_path: Path) -> None:
    book = opened(report("Spans"), tmp_path)
    rows = list(book["Spans"].iter_rows(values_only=True))
    assert rows[0] == ("Span", "Length of the span [m]", "Seen [%]", "Kind")
    assert rows[1] == (1, 84.25, 50.0, "tree")
    assert rows[2] == (2, None, 25.0, "'=1+1"), "all rows, and no formula"
    assert book["Spans"]["B2"].number_format == "0.0"


def test_names_of_sheets_are_whole_words(tmp_path: Path) -> None:
    """They were cut within a word: "Not sure  plants or parts of th"."""
    titles = "Not sure: plants or parts of the line", "Objects that lie near the wires of others"
    book = opened(report(*titles, "Points: 2"), tmp_path)
    assert book.sheetnames[1:] == ["Not sure", "Objects that lie near the wires", "Points  2"]


def test_cells_speak_the_language_of_the_user_and_names_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TOOLBOX_LANG", "tr")
    cells = [{"kind": "plant", "what": "Secondary text", "at": "Mast 2"}]
    kinds = {"kind": Column("Kind", names={"plant": "tree"})}
    made = Report("Line 12", [Section("Layers", [Rows(Table.from_rows(cells), columns=kinds)])])
    row = list(opened(made, tmp_path)["Katmanlar"].iter_rows(values_only=True))[1]
    assert row == ("ağaç", "İkincil metin", "Mast 2")


def test_names_of_settings_and_warnings_are_as_a_reader_needs_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The setting "plane" was "düzlem", which no command knows; "Warning" stayed English."""
    monkeypatch.setenv("TOOLBOX_LANG", "tr")
    table = Table.from_rows([{"kind": "facade", "name": "plane"}])
    rows = Rows(table, columns={"name": Column("Name", as_is=True)})
    made = Report("A", [Section("Settings", [rows])], head=Head([], ["Two wires are missing"], []))
    book = opened(made, tmp_path)
    assert list(book["Ayarlar"].iter_rows(values_only=True))[1] == ("cephe", "plane")
    assert "Uyar\u0131" in [row[0] for row in book["Özet"].iter_rows(values_only=True)]
    for on_paper in (False, True):
        page = render(made, on_paper=on_paper)
        assert ">plane</td>" in page
        assert ">cephe</td>" in page


def test_the_first_sheet_says_what_must_be_known(tmp_path: Path) -> None:
    rows = list(opened(report("Spans"), tmp_path)["Summary"].iter_rows(values_only=True))
    assert rows[0][0] == "Line 12"
    assert ("Client", "Grid Ltd") in rows
    assert ("Result", "All is well.") in rows
    assert ("Warning", "Two wires are missing") in rows
    assert ("Not looked at", "Rivers") in rows
    assert ("Date of the report", "2026-05-01") in rows


def test_sheets_have_names_of_their_own(tmp_path: Path) -> None:
    """Those that are too long end with a word, if they have several."""
    long, one = "A title that is longer than a sheet may be called", "w" * 40
    book = opened(report(long, long, one, "a/b", "Summary"), tmp_path)
    cut = ["A title that is longer than a", "A title that is longer than a 2", "w" * 31]
    assert book.sheetnames == ["Summary", *cut, "a b", "Summary 2"]


def test_the_same_report_is_the_same_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report("Spans").save(tmp_path / "a.xlsx")
    import time

    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 90_000)
    report("Spans").save(tmp_path / "b.xlsx")
    assert (tmp_path / "a.xlsx").read_bytes() == (tmp_path / "b.xlsx").read_bytes()


def test_sheets_are_printed_as_wide_as_a_page_with_heads_that_fit(tmp_path: Path) -> None:
    """A client's print of a lake had 19 pages, and heads of two lines lay over the first row."""
    rows = Rows(Table.from_rows([{"Low ground that no water reaches yet": 1.0, "B": 2.0}]))
    sheet = opened(Report("Lake", [Section("Curve", [rows])]), tmp_path)["Curve"]
    assert sheet.sheet_properties.pageSetUpPr.fitToPage
    assert (sheet.page_setup.orientation, sheet.page_setup.fitToHeight) == ("landscape", 0)
    assert sheet.print_title_rows == "$1:$1"
    assert sheet.row_dimensions[1].height > 30


def test_settings_that_are_numbers_are_numbers(tmp_path: Path) -> None:
    """A sum over them was 0, and a spreadsheet drew a green corner at each."""
    values = ["0.4", "12", "yes", "9-11", "-3"]
    cells = [{"Setting": f"{n}", "Value": text} for n, text in enumerate(values)]
    made = Report("Line 12", [Section("Settings", [Rows(Table.from_rows(cells))])])
    rows = list(opened(made, tmp_path)["Settings"].iter_rows(values_only=True, min_row=2))
    assert [value for _, value in rows] == [0.4, 12, "yes", "9-11", -3]
    assert [name for name, _ in rows] == list("01234"), "names stay texts"
