"""What a report is made of: its head, and sections with texts, tables, images and plots."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from toolbox import language
from toolbox.data.measures import VALUE, row_digits, unit_column
from toolbox.data.report.columns import Column, column_of, guessed, unit_text
from toolbox.data.table import Table, is_number

if TYPE_CHECKING:
    import pandas as pd

_IN_SVG = re.compile(r"(<text\b[^>]*>)([^<]+)")
_MOST_ROWS = 500  # of a table; all of them are in the file of the layer
_SHORT = 10  # rows that are shown before all are asked for
_FEW_ROWS = 15  # of a table that is not cut on paper
_GAP = 3  # characters between the columns of a printed table
_LONGEST_WORD = 11  # characters of a heading before it is hyphenated in print
_LONGEST_TEXT = 26  # characters of a text in print before it goes on in another line
_WIDE = 9  # columns; of a table of more, each is printed as wide as its texts need
_UPRIGHT, _ACROSS = 516, 762  # points of a line on A4, without the margins of style.css
_NARROWER = (1.0, 0.9, 0.8, 0.7, 0.6)  # of that line, so that parts of a table are alike
_LETTER = 0.6  # width of a letter to its size: digits have 0.56 in Arial, 0.64 in DejaVu Sans
_SMALLEST, _LARGEST = 6.0, 7.5  # points: as small as is read in print, and that of other tables
_NAMING = 1  # column that says which row it is, and is shown also where all rows are alike
_MOST_NAMING = 3  # columns that are printed once more beside those that have no room next to them
_NAMED = ("measure", "meaning")  # columns that hold names of measures
_FEW_TURNED = 2  # rows of a wide table that are printed as columns, with a line for each heading


@dataclass(frozen=True)
class Figure:
    """An image in a report.

    Attributes
    ----------
    content : of a PNG or SVG file
    caption : what it shows, which is also read to those who cannot see it

    Examples
    --------
    >>> Figure(b"<svg/>", "An empty drawing").source
    'data:image/svg+xml;base64,PHN2Zy8+'
    """

    content: bytes
    caption: str

    @property
    def source(self) -> str:
        """The image as a data URL, so that the report is one file."""
        if self.content.startswith(b"\x89PNG"):
            return _data_url("png", self.content)
        return _data_url("svg+xml", _IN_SVG.sub(_said, self.content.decode()).encode())


def _data_url(kind: str, content: bytes) -> str:
    return f"data:image/{kind};base64," + base64.b64encode(content).decode()


def _said(found: re.Match[str]) -> str:
    """A text of an SVG in the language of the user."""
    return found[1] + html.escape(language.label(html.unescape(found[2])), quote=False)


def _plain_words(text: Any) -> Any:
    """The name of a measure without the marks that join its words in a file, or its text."""
    return language.text(text).replace("_", " ") if isinstance(text, str) else text


@dataclass(frozen=True)
class Rows:
    """A table in a report, of which the first rows are shown.

    Attributes
    ----------
    caption : what it shows
    most : rows to show
    columns : how columns are shown, by name; others by their names, see `Column`
    layer : name of the layer on the map of which each row is a feature; "" for none
    short : rows that are shown before all are asked for

    Examples
    --------
    >>> rows = Rows(Table.from_rows([{"class": 2}, {"class": 6}]), most=1)
    >>> rows.cells, rows.full_caption
    ([['2']], '(the first 1 of 2 rows)')
    """

    table: Table
    caption: str = ""
    most: int = _MOST_ROWS
    columns: Mapping[str, Column] = field(default_factory=dict)
    layer: str = ""
    short: int = _SHORT

    @cached_property
    def shown(self) -> pd.DataFrame:
        """The rows without the columns that reports leave out, and those that hold nothing.

        A height in its own unit is left out, with that unit, if the column in metres says the same.
        """
        frame = self.table.frame
        hidden = [n for n in frame if (c := self.columns.get(str(n))) and not c.heading]
        empty = [n for n in frame if len(frame) and frame[n].isna().all()]
        metres = [n for n in frame if f"{n}_m" in frame and frame[n].equals(frame[f"{n}_m"])]
        metres += [n for n in frame if metres and n == "unit"]
        units = unit_column(frame)
        if units is not None:
            named = {n: frame[n].map(_plain_words) for n in frame if str(n).lower() in _NAMED}
            named |= {units: frame[units].map(unit_text, na_action="ignore")}
            frame = frame.assign(**{str(name): texts for name, texts in named.items()})
        return frame.drop(columns=[*hidden, *empty, *metres])

    @cached_property
    def row_digits(self) -> list[int] | None:
        """Digits of the numbers of each row that is shown, if each has a unit of its own."""
        return row_digits(self.table.frame)

    @property
    def folded(self) -> int:
        """Number of rows that are shown when they are asked for; a few more are shown at once."""
        shown = min(len(self.table), self.most)
        return shown - self.short if shown > self.short + 2 else 0

    @property
    def is_short(self) -> bool:
        """Whether its rows stay together on paper."""
        return min(len(self.table), self.most) <= _FEW_ROWS

    @property
    def is_wide(self) -> bool:
        """Whether it has too many columns for an upright page."""
        return len(self.headings) > _WIDE

    @cached_property
    def headings(self) -> list[tuple[Column, bool]]:
        """How each column is shown, and whether it holds numbers."""
        return [
            (column_of(str(name), values, self.columns), self.is_number(name, values))
            for name, values in self.shown.items()
        ]

    def is_number(self, name: object, values: pd.Series[Any]) -> bool:
        """Whether a column holds numbers; among the values of measures may be texts."""
        measured = self.row_digits is not None and str(name).lower() == VALUE
        return is_number(values) or measured

    @cached_property
    def cells(self) -> list[list[str]]:
        """The texts of the cells of each row that is shown."""
        frame = self.shown.head(self.most)
        digits: Sequence[int | None] = self.row_digits or [None] * len(frame)
        texts = [
            [
                "" if absent else guessed(how.text(value, n)) if guess else how.text(value, n)
                for value, absent, n, guess in zip(
                    values, values.isna(), digits, self.guesses(how), strict=False
                )
            ]
            for (how, _), (_, values) in zip(self.headings, frame.items(), strict=True)
        ]
        return [list(row) for row in zip(*texts, strict=True)]

    def guesses(self, how: Column) -> list[bool]:
        """Whether the number of a column is a guess, row by row."""
        if not how.circa:
            return [False] * len(self.shown)
        return [how.is_guess(row) for row in self.shown.to_dict("records")]

    @cached_property
    def alike(self) -> list[int]:
        """The columns of a wide table in which all rows say the same: it is said once, above."""
        if not self.is_wide or len(self.cells) <= _FEW_TURNED:
            return []
        columns = list(zip(*self.cells, strict=True))
        return [k for k in range(_NAMING, len(columns)) if len(set(columns[k])) == 1]

    @property
    def said_once(self) -> str:
        """What all rows have in common, for a caption; "" for nothing."""
        alike = [(self.headings[k][0], self.cells[0][k]) for k in self.alike]
        parts = [
            f"{language.told(how.heading)}: {language.told(text)} {how.unit}".strip()
            for how, text in alike
            if text
        ]
        return f"{language.text('In all rows')}: {'; '.join(parts)}." if parts else ""

    @property
    def full_caption(self) -> str:
        """The caption, with what all rows have in common, and how many are shown."""
        count = len(self.table)
        more = f" (the first {self.most} of {count} rows)" if count > self.most else ""
        told = [part for part in (f"{self.caption}{more}".strip(), self.said_once) if part]
        return " ".join([*(f"{part.rstrip('.')}." for part in told[:-1]), *told[-1:]])

    def pieces(self, *, paper: bool) -> list[Piece]:
        """The tables that it is shown as: one in a browser, and on paper as many as it takes.

        Columns for which a page across has no room follow below, beside those that say which row
        it is; no table is much wider than another.
        """
        if not paper or not self.is_wide or self.is_turned or self._whole.fits(_ACROSS):
            return [self._whole]
        cuts = [list(self._cut(_ACROSS * share)) for share in _NARROWER]
        return [cut for cut in cuts if len(cut) == len(cuts[0])][-1]

    @cached_property
    def _whole(self) -> Piece:
        """All columns but those in which all rows are alike."""
        return Piece(self, [k for k in range(len(self.headings)) if k not in self.alike])

    def _naming(self, shown: Sequence[int]) -> int:
        """How many of the first columns it takes to tell all rows apart, if a few are enough."""
        for count in range(_NAMING, _MOST_NAMING + 1):
            if len({tuple(row[k] for k in shown[:count]) for row in self.cells}) == len(self.cells):
                return count
        return _NAMING

    def _cut(self, line: float) -> Iterator[Piece]:
        """Tables with as many of the columns as fit into a line of so many points."""
        columns = self._whole.columns
        naming = columns[: self._naming(columns)]
        piece = Piece(self, naming)
        for column in columns[len(naming) :]:
            wider = Piece(self, [*piece.columns, column])
            if not wider.fits(line) and len(piece.columns) > len(naming):
                yield piece
                wider = Piece(self, [*naming, column])
            piece = wider
        yield piece

    @property
    def is_turned(self) -> bool:
        """Whether it is printed with a line for each column: many columns of a row or two."""
        return self.is_wide and 0 < len(self.cells) <= _FEW_TURNED

    @property
    def turned(self) -> list[list[Line]]:
        """Its columns as lines, in two halves beside each other; what names the rows heads both.

        Columns that are empty in all rows are left out.
        """
        texts = [[row[k] for row in self.cells] for k in range(len(self.headings))]
        lines = [Line(*how, cells) for how, cells in zip(self.headings, texts, strict=True)]
        naming, *others = (line for line in lines if any(line.cells))
        half = -(-len(others) // 2)
        return [[naming, *others[:half]], [naming, *others[half:]]]

    @property
    def is_across(self) -> bool:
        """Whether it is printed on a page across."""
        return self.is_wide and not self.is_turned and not self._whole.fits(_UPRIGHT)


class Line(NamedTuple):
    """A column of a table that is printed as a line: how it is shown, if it is numbers, texts."""

    column: Column
    is_number: bool
    cells: list[str]


@dataclass(frozen=True)
class Piece:
    """Some columns of a table, as they are shown beside each other.

    Attributes
    ----------
    columns : places of the columns in the table
    """

    of: Rows
    columns: Sequence[int]

    @property
    def headings(self) -> list[tuple[Column, bool]]:
        """How each column is shown, and whether it holds numbers."""
        return [self.of.headings[k] for k in self.columns]

    @property
    def cells(self) -> list[list[str]]:
        """The texts of the cells of each row."""
        return [[row[k] for k in self.columns] for row in self.of.cells]

    @property
    def widths(self) -> list[float]:
        """Share of the width of a page that each column needs, in percent."""
        return [100 * one / sum(self.needed) for one in self.needed]

    @property
    def font_size(self) -> float:
        """Size of the print of a wide table in points: as large as its texts allow."""
        line = _ACROSS if self.of.is_across else _UPRIGHT
        return min(line / (_LETTER * sum(self.needed)), _LARGEST)

    def fits(self, line: float) -> bool:
        """Whether its texts can be read beside each other in a line of so many points."""
        return _LETTER * _SMALLEST * sum(self.needed) <= line

    @cached_property
    def needed(self) -> list[int]:
        """Characters that each column needs in print: by its longest text.

        Headings break between words, and long texts in lines.
        """
        headings = [f"{language.told(c.heading)} [{c.unit}]".split() for c, _ in self.headings]
        words = [max(len(word) for word in heading) for heading in headings]
        columns = zip(*self.cells, strict=True)
        texts = [max(map(len, column)) for column in columns] or words
        return [
            _GAP + max(min(word, _LONGEST_WORD), min(text, _LONGEST_TEXT))
            for word, text in zip(words, texts, strict=True)
        ]


@dataclass(frozen=True)
class Plot:
    """A map or a view in space that can be moved and asked.

    Attributes
    ----------
    kind : "map" from above, "space" to be turned
    data : what is drawn, as JSON values; see `toolbox.reports`
    picture : what is shown where the plot cannot be, as on paper
    others : makes what else the plot can show, for paper alone
    """

    kind: Literal["map", "space"]
    data: Mapping[str, Any]
    picture: Figure
    others: Callable[[], Iterable[Figure]] = field(default=tuple, compare=False)


Block = str | Rows | Figure | Plot


@dataclass(frozen=True)
class Section:
    """A heading of a report with texts, tables and images under it.

    Attributes
    ----------
    folded : shown when it is asked for, and on paper
    printed : what stands on paper in place of the blocks; nothing if it is empty

    Examples
    --------
    >>> Section("Points", ["There are 42.", Rows(Table.from_rows([{"class": 2}]))]).title
    'Points'
    """

    title: str
    blocks: Sequence[Block]
    folded: bool = False
    printed: Sequence[Block] | None = None

    def blocks_on(self, *, paper: bool) -> Sequence[Block]:
        """What is in it, in a browser or on paper."""
        return self.blocks if self.printed is None or not paper else self.printed

    def is_across(self, *, paper: bool) -> bool:
        """Whether it begins with a table that is printed on a page across."""
        first = next(iter(self.blocks_on(paper=paper)), None)
        return isinstance(first, Rows) and first.is_across


def in_order_of_paper(sections: Sequence[Section]) -> list[Section]:
    """Sections as a print has them: maps and views, texts and short tables, then wide tables.

    Then come long tables, and last how all was made. Within each of these they keep their order, so
    that pages are turned once and back.

    Examples
    --------
    >>> long, short = (Rows(Table.from_rows([{"class": k} for k in range(n)])) for n in (40, 2))
    >>> sections = [Section("Long", [long]), Section("Short", [short])]
    >>> [section.title for section in in_order_of_paper(sections)]
    ['Short', 'Long']
    """
    return sorted(sections, key=_place)


def _place(section: Section) -> int:
    blocks = section.blocks_on(paper=True)
    tables = [block for block in blocks if isinstance(block, Rows)]
    if any(isinstance(block, Plot) for block in blocks):
        return 0
    if section.folded:  # how all was made
        return 4
    if any(table.is_across for table in tables):
        return 2
    return 1 if all(table.is_short for table in tables) else 3


@dataclass(frozen=True)
class Head:
    """The head of a report: what it is about, and what must be known before all else.

    Attributes
    ----------
    facts : such as ("Coordinates", "local"), in the order of reading
    warnings : of the run
    unseen : what was not looked at
    project : facts that stand above these as they were given, such as ("Client", "City of Delft")
    """

    facts: Sequence[tuple[str, str]] = ()
    warnings: Sequence[str] = ()
    unseen: Sequence[str] = ()
    project: Sequence[tuple[str, str]] = ()
