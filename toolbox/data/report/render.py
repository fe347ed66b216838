"""The HTML of a report: a template, a stylesheet and a script, put into one file."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox import language
from toolbox.data.record import checked
from toolbox.data.report.blocks import Figure, Plot, Rows, in_order_of_paper
from toolbox.data.report.prose import cell, raised, sentence
from toolbox.errors import DataError

if TYPE_CHECKING:
    from markupsafe import Markup

    from toolbox.data.report.document import Report

_HERE = Path(__file__).parent
_NAMES = "name", "label", "low", "high"  # of what plots draw, and _CLASSES of its colours
_AXES, _CLASSES = "axes", "classes"
_IMAGES = {".png": "png", ".svg": "svg+xml", ".jpg": "jpeg", ".jpeg": "jpeg"}


def render(
    report: Report,
    *,
    record: str = "",
    style: Path | None = None,
    logo: Path | None = None,
    on_paper: bool = False,
) -> str:
    """The HTML text of a report; the same report makes the same text.

    Parameters
    ----------
    record : JSON text, see `toolbox.runs.provenance`
    style, logo : of a company, see `Report.html`
    on_paper : without the script and what only it can show

    Raises
    ------
    DataError
        The style or the logo cannot be read.
    """
    import jinja2

    loader = jinja2.FileSystemLoader(_HERE)
    environment = jinja2.Environment(
        loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"prose": _prose, "json": _json, "anchor": anchor}
    environment.filters["sentence"] = sentence
    said = {"said": language.text, "told": language.told, "decimals": language.decimals}
    environment.filters |= {**said, "cell": cell, "drawn": _drawn}
    kinds = {"is_rows": _is(Rows), "is_figure": _is(Figure), "is_plot": _is(Plot)}
    plots = [block for part in report.sections for block in part.blocks if isinstance(block, Plot)]
    interactive = bool(plots) and not on_paper
    return environment.get_template("page.html").render(
        report=report,
        sections=in_order_of_paper(report.sections) if on_paper else report.sections,
        lang=language.chosen(),
        words={} if language.chosen() == "en" else _words(),
        record=_inside_script(checked(record)) if record else "",
        styles=[_inside_style(text) for text in _styles(style)],
        logo=_logo(logo) if logo else "",
        script="" if on_paper else _inside_script(_text("page.js")),
        library=_library() if interactive else "",
        library_version=_library_version() if interactive else "",
        on_paper=on_paper,
        **kinds,
    )


def anchor(title: str) -> str:
    """The name of a section in links to it."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "section"


def _styles(style: Path | None) -> list[str]:
    texts = [_text("style.css")]
    if style is not None:
        try:
            texts.append(Path(style).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise DataError(f"style {style} cannot be read: {error}") from error
    return texts


def _logo(path: Path) -> str:
    """An image as a data URL."""
    kind = _IMAGES.get(Path(path).suffix.lower())
    if kind is None:
        raise DataError(f"logo {path}: images are read from {', '.join(_IMAGES)}")
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise DataError(f"logo {path} cannot be read: {error}") from error
    return f"data:image/{kind};base64," + base64.b64encode(content).decode()


def _text(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")


@cache
def _library() -> str:
    """plotly.js as the package plotly ships it, packed: a third of its size."""
    import plotly.offline

    packed = gzip.compress(plotly.offline.get_plotlyjs().encode(), 9, mtime=0)
    return base64.b64encode(packed).decode()


@cache
def _library_version() -> str:
    import plotly.offline

    return str(plotly.offline.get_plotlyjs_version())


def _words() -> dict[str, str]:
    """The texts of the script in the language of the user, by the English ones."""
    return {
        text: language.text(text) for text in re.findall(r'word\("([^"]+)"\)', _text("page.js"))
    }


def _drawn(data: Any, of: str = "") -> Any:
    """What a plot draws, with names and labels in the language of the user.

    Parameters
    ----------
    of : name of the data in what they are a part of
    """
    if isinstance(data, Mapping):
        return {name: _drawn(part, name) for name, part in data.items()}
    if of == _CLASSES:
        return [[language.label(name), colour] for name, colour in data]
    if isinstance(data, list) and (of == _AXES or isinstance(next(iter(data), 0), dict)):
        return [_drawn(part, of) for part in data]
    return language.label(data) if of in (*_NAMES, _AXES) else data


def _prose(text: str) -> Markup:
    """A text for the report, in which `names` stand out."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"`([^`\n]+)`", r"<code>\1</code>", str(escape(raised(text)))))


def _json(value: Any) -> Markup:
    from markupsafe import Markup

    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return Markup(_inside_script(text))


def _inside_script(text: str) -> str:
    """JSON or a script in which no text ends the element; of "<!--<script>" a browser would make
    a script that goes on to the end of the page."""
    return text.replace("<", "\\u003c") if text.startswith(("{", "[")) else text


def _inside_style(text: str) -> str:
    return text.replace("</", "<\\/")


def _is(kind: type) -> Callable[[object], bool]:
    return lambda block: isinstance(block, kind)
