"""Reports are one page that shows what it was given."""

from __future__ import annotations

import base64
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import openpyxl
import pytest

from toolbox import language
from toolbox.data import Figure, Report, Rows, Section, Table
from toolbox.data.record import MEMBER, read_record
from toolbox.data.report import Column, Head, Plot
from toolbox.data.report.blocks import Piece, in_order_of_paper
from toolbox.data.report.render import render
from toolbox.errors import DataError

RECORD = json.dumps({MEMBER: "1", "text": "</script><b>"})
TABLE = Table.from_rows([{"name": "<b>a&b</b>", "x": 1 / 3, "n": 4}, {"name": None, "x": None}])


def report(*blocks: str | Rows | Figure) -> Report:
    return Report("Title <1>", [Section("First", blocks)], summary="Said before.")


def body(made: Report) -> ET.Element:
    """The page as a tree, which only well-formed pages have."""
    text = made.html().removeprefix("<!DOCTYPE html>\n")
    text = re.sub("<script>.*?</script>|<style>.*?</style>", "", text, flags=re.S)
    for tag in ("meta charset", "meta name", "img"):
        head, *parts = text.split(f"<{tag}")
        text = head + "".join(f"<{tag}" + part.replace(">", "/>", 1) for part in parts)
    return ET.fromstring(text)


def test_texts_and_tables_stand_on_the_page_as_they_are() -> None:
    tree = body(report("One\ntwo <three>", Rows(TABLE, "A table")))
    assert [e.text for e in tree.iter("h1")] == ["Title <1>"]
    assert [e.text for e in tree.iter("p")] == ["Said before.", "One\ntwo <three>", "A table"]
    assert [e.text for e in tree.iter("th")] == ["Name", "x", "N"]
    assert [e.text or "" for e in tree.iter("td")] == ["<b>a&b</b>", "0.33", "4", "", "", ""]
    assert [e.get("class") for e in tree.iter("td")][:3] == ["short", "number", "number"]
    assert [e.get("class") for e in tree.iter("p")][2:] == ["caption"]


def test_names_stand_out_and_markup_stays_text() -> None:
    tree = body(report("Use `a<b` of two."))
    assert [e.text for e in tree.iter("code")] == ["a<b"]
    assert "".join(list(tree.iter("p"))[-1].itertext()) == "Use a<b of two."


def test_rows_that_are_left_out_are_told() -> None:
    tree = body(report(Rows(Table.from_rows({"n": n} for n in range(7)), "Seven", most=2)))
    assert [e.text for e in tree.iter("td")] == ["0", "1"]
    captions = [e.text for e in tree.iter("p") if e.get("class") == "caption"]
    assert captions == ["Seven (the first 2 of 7 rows)"]


def test_an_empty_cell_of_a_printed_list_moves_no_heading() -> None:
    """A turned table has a line for each column that says something, and none for others."""
    table = Table.from_rows([{**{f"n{k}": k for k in range(10)}, "n3": "", "n4": "four"}])
    printed = render(report(Rows(table)), on_paper=True)
    pairs = dict(re.findall(r'<th scope="row">(.*?)</th><td.*?>(.*?)</td>', printed))
    assert pairs["N4"] == "four"
    assert "N3" not in pairs


def test_a_picture_is_in_the_page() -> None:
    tree = body(report(Figure(b"\x89PNG", 'A "map"')))
    (image,) = tree.iter("img")
    assert image.get("alt") == 'A "map"'
    assert base64.b64decode((image.get("src") or "").partition(",")[2]) == b"\x89PNG"


def test_the_record_comes_back(tmp_path: Path) -> None:
    for name in ("a.html", "b.html"):
        report("x").save(tmp_path / name, record=RECORD)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert json.loads(read_record(tmp_path / "a.html")) == json.loads(RECORD)
    report("x").save(tmp_path / "a.html", overwrite=True)
    assert read_record(tmp_path / "a.html") == ""
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ".html"] == []


def test_what_cannot_be_done(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"reports are written as \.html, \.pdf"):
        report("x").save(tmp_path / "a.doc")
    with pytest.raises(DataError, match="cannot be written"):
        report("x").save(tmp_path / "none" / "a.html")
    with pytest.raises(DataError, match="reports are written, not read"):
        Report.open(tmp_path / "a.html")


@pytest.mark.parametrize("text", ["</script><script>alert(1)</script>", "<!--<script>"])
def test_no_text_of_a_record_ends_or_hides_the_page(text: str, tmp_path: Path) -> None:
    record = json.dumps({MEMBER: "1", "settings": {"where": text}})
    report("body").save(tmp_path / "a.html", record=record)
    inside = (tmp_path / "a.html").read_text().partition('id="provenance">')[2]
    assert "<" not in inside.partition("</script>\n<style>")[0]
    assert json.loads(read_record(tmp_path / "a.html"))["settings"]["where"] == text


def test_a_wide_table_is_printed_with_columns_as_wide_as_their_texts() -> None:
    rows = [
        {"span": 5 + n, "remark": "far from any wire, and of no kind that has a rule" + "." * n}
        | {f"measure_{k}": 1000.25 + k + n for k in range(9)}
        for n in range(3)
    ]
    block = Rows(Table.from_rows(rows))
    (piece,) = block.pieces(paper=True)
    widths = piece.widths
    assert sum(widths) == pytest.approx(100)
    assert len(widths) == len(block.headings) == 11
    # "Span" and "1000.25" with a gap of three, and 26 characters of the remark
    assert widths[0] / widths[2] == pytest.approx((3 + 4) / (3 + 7))
    assert widths[1] / widths[2] == pytest.approx((3 + 26) / (3 + 7))
    report = Report("Line", [Section("Spans", [block])])
    paper = render(report, style=None, logo=None, on_paper=True)
    assert paper.count("<col style=") == 11
    shown, printed = report.html().split('<div class="table on-paper')
    assert "<col style=" not in shown
    assert printed.count("<col style=") == 11, "a browser prints it as a PDF has it"


@pytest.mark.parametrize(
    ("columns", "size"),
    [(10, 7.5), (20, 762 / 0.6 / (20 * (3 + 6))), (30, 7.5)],
)
def test_a_wide_table_is_printed_as_large_as_fits(columns: int, size: float) -> None:
    """Lists of objects stood on four pages in 6 points, whatever there was room for."""
    rows = [{f"of_{k}": 1000.25 + k + n for k in range(columns)} for n in range(3)]
    block = Rows(Table.from_rows(rows))
    assert block.pieces(paper=True)[0].font_size == pytest.approx(size)
    report = Report("Line", [Section("Spans", [block])])
    paper = render(report, style=None, logo=None, on_paper=True)
    assert f'<table style="font-size: {size:.1f}pt">' in paper
    assert "<table>" in report.html()


def wide(rows: int) -> Rows:
    """A table of twelve columns, in two of which all rows say the same."""
    named = {f"measure_{k}": 10.0 + k for k in range(9)}
    return Rows(
        Table.from_rows(
            {"span": n, "state": "survey", "unit": "metre"}
            | {name: value + n for name, value in named.items()}
            for n in range(rows)
        ),
        "All spans",
    )


def test_what_all_rows_of_a_wide_table_say_is_said_once() -> None:
    block = wide(3)
    (piece,) = block.pieces(paper=False)
    assert [column.heading for column, _ in piece.headings][:2] == ["Span", "Measure 0"]
    assert len(block.pieces(paper=True)[0].cells[0]) == 10
    assert block.full_caption == "All spans. In all rows: State: survey; Unit: metre."
    assert len(block.cells[0]) == 12  # as in workbooks


def test_a_printed_column_has_room_for_its_heading_in_the_language_of_the_user() -> None:
    """Turkish headings were broken within words: "Görüle" over "n"."""
    rows = [{"sill": 1.0} | {f"n{k}": 10.5 for k in range(10)}]
    block = Rows(Table.from_rows(rows), columns={"sill": Column("Sill above the foot")})
    with language.speaking("tr"):
        assert block.pieces(paper=True)[0].needed[0] == 3 + len("Denizliğin")


def headings(piece: Piece) -> list[str]:
    return [column.heading for column, _ in piece.headings]


@pytest.mark.parametrize(("columns", "across"), [(9, False), (15, False), (16, True)])
def test_a_page_is_turned_for_a_table_that_cannot_be_read_upright(
    columns: int, across: bool
) -> None:
    """Each column needs 9 letters of 3.6 points: 15 of them are 486 of the 516 of a line."""
    rows = [{f"of_{k}": 1000.25 + k + n for k in range(columns)} for n in range(3)]
    block = Rows(Table.from_rows(rows))
    assert block.is_across is across
    (piece,) = block.pieces(paper=True)
    assert len(piece.columns) == columns
    assert 6.0 <= piece.font_size <= 7.5
    paper = render(Report("Line", [Section("Spans", [block])]), on_paper=True)
    assert ('class="across"' in paper) is across
    assert ('class="across"' in Report("Line", [Section("Spans", [block])]).html()) is across


def test_columns_without_room_on_paper_follow_below_with_what_names_the_row() -> None:
    """One span has two wires, so that both columns tell which row it is."""
    rows = [
        {"span": n // 2, "wire": n % 2} | {f"of_{k}": 1000.25 + k + n for k in range(40)}
        for n in range(4)
    ]
    first, *others = Rows(Table.from_rows(rows)).pieces(paper=True)
    assert others
    assert all(headings(piece)[:2] == ["Span", "Wire"] for piece in (first, *others))
    assert all(piece.font_size >= 6.0 for piece in (first, *others))
    assert all(6.0 * 0.6 * sum(piece.needed) <= 762 for piece in (first, *others))
    sizes = [len(piece.columns) for piece in (first, *others)]
    assert max(sizes) - min(sizes) <= 4, "one had only the last column"
    told = [name for piece in (first, *others) for name in headings(piece)[2:]]
    assert told == [f"Of {k}" for k in range(40)]


@pytest.mark.parametrize("rows", [1, 2])
def test_wide_tables_of_a_row_or_two_are_printed_with_a_line_for_each_column(rows: int) -> None:
    """In two halves beside each other, both headed by what names the rows."""
    block = wide(rows)
    report = Report("Line", [Section("Spans", [block])])
    paper = render(report, style=None, logo=None, on_paper=True)
    cells = "".join(f'<td class="number">{18 + n}.00</td>' for n in range(rows))
    assert f'<th scope="row">Measure 8</th>{cells}</tr>' in paper
    assert paper.count('class="naming"><th scope="row">Span</th>') == 2
    assert [len(half) for half in block.turned] == [7, 6]
    assert 'class="across"' not in paper
    shown, printed = report.html().split('<div class="table on-paper')
    assert '<table class="turned">' not in shown
    assert printed.count('<table class="turned">') == 2, "a browser prints it as a PDF has it"


def test_paper_shows_as_many_rows_as_the_page() -> None:
    block = Rows(Table.from_rows([{"n": n} for n in range(150)]), "Numbers")
    report = Report("Line", [Section("Numbers", [block])])
    pages = render(report, on_paper=True), report.html()
    assert [page.partition("<tbody>")[2].count("<tr") for page in pages] == [150, 150]
    assert block.full_caption == "Numbers"
    assert replace(block, most=100).full_caption == "Numbers (the first 100 of 150 rows)"


def test_measures_are_named_in_words() -> None:
    row = {"measure": "reference_area", "value": 1.5, "unit": "m2", "meaning": "area of b_c"}
    assert Rows(Table.from_rows([row])).cells[0][0] == "reference area"


def test_paper_has_what_a_section_says_for_it() -> None:
    told = Section("How", ["long"], folded=True, printed=["short"])
    none = Section("Settings", ["all"], folded=True, printed=[])
    paper = render(Report("Line", [told, none]), style=None, logo=None, on_paper=True)
    assert "short" in paper
    assert "<p>long" not in paper
    assert "Settings" not in paper
    assert "<p>long" in Report("Line", [told]).html()


def test_a_level_in_metres_is_shown_once() -> None:
    """In feet both columns tell something."""
    for level, names in ((2.5, ["level_m"]), (8.2, ["level", "unit", "level_m"])):
        one = {"level": level, "unit": "metre", "level_m": 2.5, "area_m2": 10.0}
        rows = Rows(Table.from_rows([one]))
        assert [str(n) for n in rows.shown] == [*names, "area_m2"]


def test_warnings_are_sentences_that_begin_large() -> None:
    made = Report("A", [], head=Head(warnings=["all points are alike", "a.laz: 2 points"]))
    page = made.html()
    assert "<li>All points are alike</li>" in page
    assert "<li>a.laz: 2 points</li>" in page


def test_paper_has_maps_first_and_how_it_was_made_last() -> None:
    wide = Rows(Table.from_rows([{f"c{k}": k * n for k in range(40)} for n in range(3)]))
    short = Rows(Table.from_rows([{"a": 1}]))
    long = Rows(Table.from_rows([{"a": n} for n in range(40)]))
    plot = Plot("map", {}, Figure(b"<svg/>", "Map"))
    made = Section("Made", ["All of it."], folded=True, printed=["Short."])
    given = {"Wide": wide, "Long": long, "Short": short, "Words": "Words.", "Map": plot}
    sections = [made, *(Section(name, [block]) for name, block in given.items())]
    found = [section.title for section in in_order_of_paper(sections)]
    assert found == ["Map", "Short", "Words", "Wide", "Long", "Made"]
    text = render(Report("R", sections), on_paper=True)
    assert text.index(">Short<") < text.index(">Wide<")
    text = render(Report("R", sections))
    assert text.index(">Wide<") < text.index(">Short<"), "a browser keeps their order"


def test_drawings_of_a_report_speak_the_language_of_their_user() -> None:
    """The profiles of a Turkish report had keys in English; names keep their points."""
    svg = '<svg><text x="1">critical</text><text>2.5 &lt; a &amp; b</text></svg>'
    with language.speaking("tr"):
        source = Figure(svg.encode(), "Profile").source
    made = base64.b64decode(source.partition(",")[2]).decode()
    assert made == svg.replace("critical", "kritik")


def test_the_result_stands_before_warnings() -> None:
    head = Head([("Client", "City")], ["points: 1 points of 3 m2 are lost"], [])
    text = render(Report("R", [], summary="All is well.", head=head))
    assert text.index("All is well.") < text.index("1 point of 3 m² is lost")
    assert "points: 1" not in text


def test_what_is_never_zero_is_not_told_as_zero(tmp_path: Path) -> None:
    """Intervals of levels below a millimetre were 0.000, as if nothing could be wrong."""
    how = {"error": Column("Error", "m", 3, never_zero=True), "shift": Column("Shift", "m", 3)}
    rows = Rows(Table.from_rows([{"error": 0.0002, "shift": 0.0002}]), columns=how)
    assert rows.cells == [["< 0.001", "0.000"]]
    assert how["error"].text(0.0005) == "0.001"
    assert how["error"].text(0.0) == "< 0.001"
    Report("R", [Section("T", [rows])]).save(tmp_path / "a.xlsx")
    sheet = openpyxl.load_workbook(tmp_path / "a.xlsx")["T"]
    assert sheet["A2"].value == 0.0002
    assert sheet["A2"].number_format == '[<0.0005]"< 0.001";0.000'
    assert sheet["B2"].number_format == "0.000"


def test_a_guess_is_told_to_people_and_stays_a_number(tmp_path: Path) -> None:
    """A size up to a side that was not seen read as if it were as sure as the others."""
    of_sides = frozenset({"left", "right"})
    how = {
        "width": Column("Width", "m", 2, circa={"unsure": of_sides, "hidden": of_sides}),
        "height": Column("Height", "mm", 0, circa={"unsure": frozenset({"top"})}),
    }
    table = Table.from_rows(
        [
            {"width": 1.204, "height": 2, "unsure": "left, top", "hidden": ""},
            {"width": 1.2, "height": 2, "unsure": "", "hidden": "right"},
            {"width": 1.2, "height": 2, "unsure": "", "hidden": "bottom"},
        ]
    )
    rows = Rows(table, columns=how)
    assert [cells[:2] for cells in rows.cells] == [
        *(["ca. 1.20", "ca. 2"], ["ca. 1.20", "2"], ["1.20", "2"])
    ]
    Report("R", [Section("T", [rows])]).save(tmp_path / "a.xlsx")
    sheet = openpyxl.load_workbook(tmp_path / "a.xlsx")["T"]
    assert [cell.value for cell in sheet["A"][1:]] == [1.204, 1.2, 1.2]
    assert [cell.number_format for cell in sheet["A"][1:]] == [*['"ca. "0.00'] * 2, "0.00"]
    assert sheet["B2"].number_format == '"ca. "General'


def test_a_workbook_holds_no_more_digits_than_tell_something(tmp_path: Path) -> None:
    rows = Rows(Table.from_rows([{"length": 10.80184671085273}]))
    Report("R", [Section("T", [rows])]).save(tmp_path / "a.xlsx")
    value = openpyxl.load_workbook(tmp_path / "a.xlsx")["T"]["A2"].value
    assert value == 10.8018
