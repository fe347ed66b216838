"""The layer of a report, which is written as HTML or as PDF."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

from numpy.typing import NDArray

from toolbox.context import QUIET, Context
from toolbox.data import extras
from toolbox.data.extras import Extra
from toolbox.data.layer import Layer, text_array
from toolbox.data.record import own_side_car, write_beside
from toolbox.data.report.blocks import Head, Section
from toolbox.data.report.columns import Column
from toolbox.data.writing import followed, refuse_to_replace
from toolbox.errors import DataError

PDF, WORKBOOK = ".pdf", ".xlsx"
LOOKS = frozenset({"style", "logo"})
"""Options that change how a report looks, and nothing that it says."""


NO_HEAD = Head()


class Report(Layer):
    """A report for people: a head, and sections with texts, tables, images and plots.

    Parameters
    ----------
    title : heading of the report
    sections : in the order of reading
    summary : the result in words
    head : what it is about
    name : for messages

    Examples
    --------
    >>> report = Report("Survey", [Section("Points", ["There are 42."])])
    >>> "There are 42." in report.html()
    True
    >>> report
    <Report in memory: 'Survey', 1 sections>
    """

    SUFFIXES: ClassVar[tuple[str, ...]] = (".html", PDF, WORKBOOK)
    NEEDS: ClassVar[Mapping[str, Extra]] = MappingProxyType({PDF: extras.PDF})
    crs: ClassVar[None] = None
    metre: ClassVar[float] = 1.0
    name: str

    def __init__(
        self,
        title: str,
        sections: Sequence[Section],
        *,
        summary: str = "",
        head: Head = NO_HEAD,
        name: str = "",
    ) -> None:
        self.title, self.sections, self.summary, self.name = title, tuple(sections), summary, name
        self.head = head

    def __repr__(self) -> str:
        size = f"{self.title!r}, {len(self.sections)} sections"
        return f"<Report {self.name or 'in memory'}: {size}>"

    @classmethod
    def open(cls, path: str | Path, *, ctx: Context = QUIET) -> Report:
        """Refuse: a report is for people, and its tables are written to files of their own.

        Raises
        ------
        DataError
            Always.
        """
        raise DataError(f"{path}: reports are written, not read")

    @classmethod
    def own_files(cls, path: str | Path) -> tuple[Path, ...]:
        """The file at a path, and the record beside it if it is no HTML."""
        return Path(path), *own_side_car(Path(path))

    # What every layer answers, see toolbox.data.layer ---------------------------------------------

    def contents(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """The page as a text."""
        yield "page", text_array(self.html())

    def page_sections(
        self, title: str, help: str, columns: Mapping[str, Column] = MappingProxyType({})
    ) -> tuple[Section, ...]:
        """Its own sections."""
        return self.sections

    def differences(self, now: Report) -> Iterator[str]:
        """Whether the page differs; it is not said where."""
        if self.html() != now.html():
            yield "the report differs"

    def titled(
        self,
        *,
        title: str | None = None,
        client: str | None = None,
        fields: Mapping[str, str] | None = None,
        date: str | None = None,
    ) -> Report:
        """The same report with the title and the facts of a project in its head."""
        own = {"Client": client, **(fields or {}), "Date of the report": date}
        project = [(name, text) for name, text in own.items() if text]
        head = replace(self.head, project=[*project, *self.head.project])
        title = title or self.title
        return Report(title, self.sections, summary=self.summary, head=head, name=self.name)

    def html(self, record: str = "", *, style: Path | None = None, logo: Path | None = None) -> str:
        """The HTML text.

        Parameters
        ----------
        record : JSON text, see `toolbox.runs.provenance`
        style : a CSS file whose rules come after those of the toolbox
        logo : an image, PNG, SVG or JPEG
        """
        from toolbox.data.report.render import render

        return render(self, record=record, style=style, logo=logo)

    def save(
        self,
        path: str | Path,
        *,
        title: str | None = None,
        client: str | None = None,
        fields: Mapping[str, str] | None = None,
        date: str | None = None,
        style: Path | None = None,
        logo: Path | None = None,
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write HTML, PDF, or a workbook with its tables; the same report makes the same bytes.

        Parameters
        ----------
        path : ends in .html, .pdf or .xlsx
        title : in place of its own
        client : for whom it was made
        fields : more of that kind by name, such as {"Contract": "2026-17"}
        date : of the report
        style, logo : see :meth:`html`
        overwrite : whether files at the path may be replaced
        record : how the file was made, as JSON text (see `toolbox.runs.provenance`)
        ctx : where to report progress

        Raises
        ------
        ParameterError
            A file is there that may not be replaced.
        DataError
            The suffix is another, or a file cannot be read or written.
        """
        path = followed(path)
        if path.suffix.lower() not in self.SUFFIXES:
            raise DataError(f"{path}: reports are written as {', '.join(self.SUFFIXES)}")
        refuse_to_replace(path, self.own_files, overwrite=overwrite)
        made = self.titled(title=title, client=client, fields=fields, date=date)
        try:
            if path.suffix.lower() == PDF:
                from toolbox.data.report.pdf import write_pdf

                write_pdf(made, path, style=style, logo=logo)
                write_beside(path, record)
            elif path.suffix.lower() == WORKBOOK:
                from toolbox.data.report.workbook import write_workbook

                write_workbook(made, path)
                write_beside(path, record)
            else:
                text = made.html(record, style=style, logo=logo)
                path.write_text(text, encoding="utf-8", newline="\n")
        except OSError as error:
            raise DataError(f"{path} cannot be written: {error}") from error
        ctx.progress(1.0)


def today() -> str:
    """The date of reports that are not given one: SOURCE_DATE_EPOCH, seconds since 1970, or today.

    Reference: https://reproducible-builds.org/specs/source-date-epoch/
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    day = datetime.fromtimestamp(int(epoch), UTC).date() if epoch.isdigit() else date.today()
    return day.isoformat()
