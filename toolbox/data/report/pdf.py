"""Reports as PDF, through WeasyPrint: the HTML of the page without its script, on A4."""

from __future__ import annotations

import hashlib
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.data.extras import PDF
from toolbox.data.report.render import render
from toolbox.errors import DataError

if TYPE_CHECKING:
    from toolbox.data.report.document import Report


def write_pdf(report: Report, path: Path, *, style: Path | None, logo: Path | None) -> None:
    """Write a report as a PDF; the same report makes the same bytes.

    Raises
    ------
    DataError
        WeasyPrint, or Pango, which it needs, is not installed; or the style or logo is no file.
    """
    text = render(report, style=style, logo=logo, on_paper=True)
    library = _weasyprint()
    inside = library.urls.URLFetcher(allowed_protocols={"data"})  # nothing else is part of it
    html = library.HTML(string=text, url_fetcher=inside)
    # Else the identifier would differ from run to run.
    identifier = hashlib.sha256(text.encode()).digest()[:16]
    html.write_pdf(path, pdf_identifier=identifier, optimize_images=True)


def _weasyprint() -> Any:
    """The library, which needs one of the system."""
    if missing := PDF.missing():
        raise DataError(f"{missing}; or print the .html from a browser")
    for name in ("fontTools", "weasyprint"):
        logging.getLogger(name).setLevel(logging.ERROR)
    import weasyprint

    return weasyprint
