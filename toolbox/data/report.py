"""Reports: texts, tables and images in one HTML file that needs no other file."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from numpy.typing import NDArray

from toolbox.context import QUIET, Context
from toolbox.data.layer import Layer, text_array
from toolbox.data.record import checked
from toolbox.data.table import Table, cell_texts, is_number
from toolbox.errors import DataError

if TYPE_CHECKING:
    from markupsafe import Markup

_MOST_ROWS = 200  # of a table; a report is to be read by people


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
        kind = "png" if self.content.startswith(b"\x89PNG") else "svg+xml"
        return f"data:image/{kind};base64," + base64.b64encode(self.content).decode()


@dataclass(frozen=True)
class Rows:
    """A table in a report, of which the first rows are shown.

    Attributes
    ----------
    caption : what it shows
    most : rows to show

    Examples
    --------
    >>> rows = Rows(Table.from_rows([{"class": 2}, {"class": 6}]), most=1)
    >>> rows.cells, rows.left_out
    ([['2']], 1)
    """

    table: Table
    caption: str = ""
    most: int = _MOST_ROWS

    @property
    def left_out(self) -> int:
        """Number of rows that are not shown."""
        return max(len(self.table) - self.most, 0)

    @property
    def columns(self) -> list[tuple[str, bool]]:
        """Name of each column, and whether it holds numbers."""
        return [(str(name), is_number(column)) for name, column in self.table.frame.items()]

    @property
    def cells(self) -> list[list[str]]:
        """The texts of the cells of each row that is shown."""
        frame = self.table.frame.head(self.most)
        columns = [cell_texts(column, missing="") for _, column in frame.items()]
        return [list(row) for row in zip(*columns, strict=True)]


Block = str | Rows | Figure


@dataclass(frozen=True)
class Section:
    """A heading of a report with texts, tables and images under it.

    Examples
    --------
    >>> Section("Points", ["There are 42.", Rows(Table.from_rows([{"class": 2}]))]).title
    'Points'
    """

    title: str
    blocks: Sequence[Block]


class Report(Layer):
    """A report for people: sections with texts, tables and images.

    Parameters
    ----------
    title : heading of the report
    sections : in the order of reading
    summary : what to know before all else
    name : for messages

    Examples
    --------
    >>> report = Report("Survey", [Section("Points", ["There are 42."])])
    >>> "There are 42." in report.html()
    True
    """

    SUFFIXES: ClassVar[tuple[str, ...]] = (".html",)
    crs: ClassVar[None] = None
    metre: ClassVar[float] = 1.0
    name: str

    def __init__(
        self, title: str, sections: Sequence[Section], *, summary: str = "", name: str = ""
    ) -> None:
        self.title, self.sections, self.summary, self.name = title, tuple(sections), summary, name

    @classmethod
    def open(cls, path: str | Path, *, ctx: Context = QUIET) -> Report:
        """Refuse: a report is for people, and its tables are written to files of their own.

        Raises
        ------
        DataError
            Always.
        """
        raise DataError(f"{path}: reports are written, not read")

    # What every layer answers, see toolbox.data.layer ---------------------------------------------

    def contents(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """The page as a text."""
        yield "page", text_array(self.html())

    def page_sections(self, title: str, help: str) -> tuple[Section, ...]:
        """Its own sections."""
        return self.sections

    def differences(self, now: Report) -> Iterator[str]:
        """Whether the page differs; it is not said where."""
        if self.html() != now.html():
            yield "the report differs"

    def html(self, record: str = "") -> str:
        """The HTML text; `record` is JSON text, see `toolbox.runs.provenance`."""
        import jinja2

        page = Path(__file__).with_name("report.html").read_text(encoding="utf-8")
        environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
        environment.filters["prose"] = _prose
        kinds = {"is_rows": _is(Rows), "is_figure": _is(Figure)}
        # Of "<!--<script>" a browser would make a script that goes on to the end of the page.
        safe = checked(record).replace("<", "\\u003c") if record else ""
        return environment.from_string(page).render(report=self, record=safe, **kinds)

    def save(self, path: str | Path, *, record: str = "", ctx: Context = QUIET) -> None:
        """Write the HTML file; the same report makes the same bytes.

        Parameters
        ----------
        path : ends in .html
        record : how the file was made, as JSON text (see `toolbox.runs.provenance`)
        ctx : where to report progress

        Raises
        ------
        DataError
            The suffix is another, or the file cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() not in self.SUFFIXES:
            raise DataError(f"{path}: reports are written as {', '.join(self.SUFFIXES)}")
        try:
            path.write_text(self.html(record), encoding="utf-8", newline="\n")
        except OSError as error:
            raise DataError(f"{path} cannot be written: {error}") from error
        ctx.progress(1.0)


def _prose(text: str) -> Markup:
    """A text for the report, in which `names` stand out."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"`([^`\n]+)`", r"<code>\1</code>", str(escape(text))))


def _is(kind: type) -> Callable[[object], bool]:
    return lambda block: isinstance(block, kind)
