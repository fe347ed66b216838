"""The tables of a report as a workbook (.xlsx): headings in words, units, numbers as numbers."""

from __future__ import annotations

import re
import textwrap
import zipfile
from collections.abc import Iterator, Sequence
from datetime import datetime
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from toolbox import language
from toolbox.data.measures import VALUE
from toolbox.data.report.blocks import Rows
from toolbox.data.report.columns import Column, guessed
from toolbox.data.report.prose import cell as said
from toolbox.data.report.prose import sentence
from toolbox.errors import DataError

if TYPE_CHECKING:
    from openpyxl.worksheet.worksheet import Worksheet

    from toolbox.data.report.document import Report

_EPOCH = datetime(1980, 1, 1)
_PROPERTIES = (  # openpyxl's say when, and name spaces as other libraries have registered them
    b'<cp:coreProperties xmlns:cp="http://schemas.openxmlformats.org/package/2006/metadata/'
    b'core-properties"><dc:creator xmlns:dc="http://purl.org/dc/elements/1.1/">lidar-toolbox'
    b"</dc:creator></cp:coreProperties>"
)
_MOST_ROWS = 1_048_575  # that a sheet holds below its head
_LONGEST_NAME = 31  # characters of the name of a sheet
_WIDEST = 48  # characters of a column
_LINE = 15  # points, height of a line
_SPARE = 2  # digits more than are shown, for sums; the others tell nothing
_FORBIDDEN = re.compile(r"[\[\]:*?/\\]")
_NUMBER = re.compile(r"-?\d+(\.\d+)?")  # among values that are texts, as those of settings
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f]")  # that a workbook cannot hold


def write_workbook(report: Report, path: Path) -> None:
    """Write a sheet with the head of a report, and one with all rows of each of its tables.

    Raises
    ------
    DataError
        A table has more rows than a sheet holds.
    """
    from openpyxl import Workbook
    from openpyxl.styles import Alignment

    book = Workbook()
    first = book.active
    first.title = language.text("Summary")
    for row in _head(report):
        first.append([_plain(cell) for cell in row])
    for cell in first["B"]:
        cell.alignment = Alignment(wrap_text=True, vertical="top")
    first.column_dimensions["A"].width, first.column_dimensions["B"].width = 24, 100
    for title, rows in _tables(report):
        if len(rows.table) > _MOST_ROWS:
            raise DataError(f"{path}: {title} has {len(rows.table):,} rows; write it as CSV")
        _fill(book.create_sheet(_name(language.told(title), book.sheetnames)), rows)
    for sheet in book:
        _for_paper(sheet)
    _save(book, path)


def _for_paper(sheet: Worksheet) -> None:
    """Let a sheet be printed on A4 across, as wide as a page."""
    sheet.page_setup.orientation, sheet.page_setup.paperSize = "landscape", sheet.PAPERSIZE_A4
    sheet.sheet_properties.pageSetUpPr.fitToPage = True
    sheet.page_setup.fitToHeight = 0


def _head(report: Report) -> Iterator[tuple[str, ...]]:
    yield language.told(report.title), ""
    yield from ((language.told(name), text) for name, text in report.head.project)
    yield from (
        (language.told(name), language.for_people(text)) for name, text in report.head.facts
    )
    for name, texts in (
        ("Result", report.summary.splitlines()),
        ("Warning", report.head.warnings),
        ("Not looked at", report.head.unseen),
    ):
        yield from ((language.told(name), sentence(language.for_people(text))) for text in texts)


def _tables(report: Report) -> Iterator[tuple[str, Rows]]:
    for section in report.sections:
        for block in section.blocks:
            if isinstance(block, Rows) and len(block.table):
                yield section.title, block


def _name(title: str, taken: list[str]) -> str:
    """A name for a sheet that no other has; of a long title what stands before its colon."""
    title = title if len(title) <= _LONGEST_NAME else title.partition(": ")[0]
    words = _FORBIDDEN.sub(" ", title)
    name = textwrap.wrap(words, _LONGEST_NAME)[0] if words.strip() else words
    number = 1
    while name.lower() in {other.lower() for other in taken}:
        number += 1
        ending = f" {number}"
        name = name[: _LONGEST_NAME - len(ending)] + ending
    return name


def _fill(sheet: Worksheet, rows: Rows) -> None:
    from openpyxl.styles import Alignment, Font
    from openpyxl.utils import get_column_letter

    frame = rows.shown
    headings = [column for column, _ in rows.headings]
    sheet.append([_heading(column) for column in headings])
    for cell in sheet[1]:
        cell.font = Font(bold=True)
        cell.alignment = Alignment(wrap_text=True, vertical="top")
    columns = [
        [
            _value(_number(value) if str(name).lower() == VALUE else value, column)
            for value in frame[name]
        ]
        for name, column in zip(frame, headings, strict=True)
    ]
    for row in zip(*columns, strict=True):
        sheet.append(row)
    for number, (column, values) in enumerate(zip(headings, columns, strict=True), start=1):
        letter = get_column_letter(number)
        longest = max((len(str(v)) for v in values if isinstance(v, str)), default=0)
        sheet.column_dimensions[letter].width = min(max(longest, 12), _WIDEST)
        own: Sequence[int | None] = rows.row_digits or [column.digits] * len(values)
        guesses, before = rows.guesses(column), language.told(guessed("0")).removesuffix("0")
        for cell, digits, guess in zip(sheet[letter][1:], own, guesses, strict=True):
            if digits is not None and isinstance(cell.value, float):
                cell.value = round(cell.value, digits + _SPARE)
                shown = f"0.{'0' * digits}" if digits else "0"
                least = f'[<{0.5 * 10.0**-digits:g}]"{column.text(0.0, digits)}";'
                cell.number_format = f"{least}{shown}" if column.never_zero else shown
            if guess and isinstance(cell.value, int | float):
                cell.number_format = f'"{before}"{cell.number_format}'
    sheet.row_dimensions[1].height = _LINE * max(
        (
            len(textwrap.wrap(cell.value, int(sheet.column_dimensions[cell.column_letter].width)))
            for cell in (sheet[1] if headings else ())
        ),
        default=1,
    )
    sheet.print_title_rows = "1:1"
    sheet.freeze_panes = "B2"
    sheet.auto_filter.ref = sheet.dimensions


def _heading(column: Column) -> str:
    heading = language.told(column.heading)
    return f"{heading} [{column.unit}]" if column.unit else heading


def _number(value: Any) -> Any:
    """A value that was told in words as the number that it is; others as they are.

    >>> _number("0.4"), _number("-3"), _number("9-11"), _number("yes")
    (0.4, -3, '9-11', 'yes')
    """
    if not (isinstance(value, str) and _NUMBER.fullmatch(value)):
        return value
    return float(value) if "." in value else int(value)


def _value(value: Any, column: Column) -> Any:
    """What a cell holds: numbers in the unit of the heading, texts, or None for nothing."""
    if pd.isna(value):
        return None
    if isinstance(value, bool | np.bool_):
        return language.text("yes") if value else language.text("no")
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value * column.factor if np.isfinite(value) else None
    if isinstance(value, int):
        return value
    text = str(column.names.get(value, value))
    return _plain(text if column.as_is else said(text))


def _plain(text: str) -> str:
    """A text that no spreadsheet takes for a formula, without characters that XML has not."""
    text = _CONTROL.sub(" ", text)
    return f"'{text}" if text.startswith(("=", "+", "-", "@")) and len(text) > 1 else text


def _save(book: Any, path: Path) -> None:
    """Save with the same times always: openpyxl takes those of now for the files in the archive."""
    draft = BytesIO()
    book.save(draft)
    with zipfile.ZipFile(draft) as made, zipfile.ZipFile(path, "w") as archive:
        for item in made.infolist():
            content = made.read(item)
            if item.filename == "docProps/core.xml":
                content = _PROPERTIES
            entry = zipfile.ZipInfo(item.filename, _EPOCH.timetuple()[:6])
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
