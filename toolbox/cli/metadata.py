"""The verb ``metadata``: what catalogues want to know of a file, after ISO 19115."""

from __future__ import annotations

import argparse
from datetime import date
from pathlib import Path

from toolbox.cli.console import Console
from toolbox.cli.stopping import stoppable
from toolbox.errors import Cancelled
from toolbox.json_text import json_text


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument("file", help="a raster, a vector layer or points")
    parser.add_argument(
        "--organisation", type=_said, required=True, help="which answers for the file"
    )
    parser.add_argument("--email", type=_said, required=True, help="of the organisation")
    parser.add_argument("--title", type=_text, default="", help="of the file (made of its record)")
    parser.add_argument(
        "--abstract", type=_text, default="", help="what the file is (made of its record)"
    )
    parser.add_argument(
        "--rights", type=_said, default="not stated", help="what others may do with the file"
    )
    parser.add_argument(
        "--date", type=_day, help="on which it was made, such as 2026-11-23 (today)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace metadata that are there")


def run(args: argparse.Namespace, console: Console) -> None:
    """Write the metadata and say where."""
    from toolbox.data.report.document import today
    from toolbox.runs import iso19115

    names = ("organisation", "email", "title", "abstract", "rights")
    said = iso19115.Said(**{name: getattr(args, name) for name in names}, date=args.date or today())
    with console.progress() as report:
        made = stoppable(
            lambda ctx: iso19115.write(Path(args.file), said, overwrite=args.overwrite, ctx=ctx),
            report,
            farewell=lambda: console.error(Cancelled()),
        )
    print(json_text({"metadata": str(made)}, indent=2) if args.json else f"metadata: {made}")


def _said(text: str) -> str:
    """Text that says something."""
    if not text.strip():
        raise argparse.ArgumentTypeError(f"must not be blank, got {text!r}")
    return _text(text)


def _text(text: str) -> str:
    """Text that an XML file can hold: of printable characters and line ends."""
    if not all(char.isprintable() or char in "\n\t" for char in text):
        raise argparse.ArgumentTypeError(f"must be of printable characters, got {text!r}")
    return text


def _day(text: str) -> str:
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a day, such as 2026-11-23, got {text}") from None
