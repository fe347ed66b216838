"""What the verb ``list`` prints: tools in groups, as wide as the terminal, or those of a search."""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby, zip_longest
from typing import IO, Any

from toolbox import language

Summary = Mapping[str, Any]

_NARROWEST = 60  # columns; a terminal of less breaks lines as it likes
_GAP = 2  # blanks between columns
_PLURAL = re.compile(r"(?<=\w{3})(s|lar|ler)$")  # of English and Turkish


def guide() -> str:
    """What the command line says where no verb is given."""
    return language.text(
        """\
Geoprocessing tools for LiDAR. For a beginning:

  python -m toolbox list                 all tools
  python -m toolbox list contour         tools that speak of contours
  python -m toolbox info FILE            what a file holds
  python -m toolbox run ID --help        what a tool takes and gives
  python -m toolbox run samples.scene --points town.laz
                                         a sample survey to try them on
  python -m toolbox run models.terrain --points town.laz --dtm dtm.tif
                                         a terrain model of it

More: python -m toolbox --help"""
    )


def matching(tools: Sequence[Summary], words: Sequence[str]) -> list[Summary]:
    """The tools that speak of all words, in English or the language of the user.

    First come those whose id, title or tags do. One tree and several are the same word.

    Examples
    --------
    >>> tools = [
    ...     {"id": "a.b", "title": "Gaps", "description": "Of a DTM.", "keywords": []},
    ...     {"id": "a.c", "title": "Grid", "description": "Cells.", "keywords": ["dtm"]},
    ... ]
    >>> [tool["id"] for tool in matching(tools, ["dtm"])]
    ['a.c', 'a.b']
    """
    wanted = [word.lower() for word in words]

    def of(tool: Summary, *keys: str) -> str:
        both = tool, language.summary(tool)
        return " ".join(str(text[key]) for text in both for key in keys).lower()

    names = "id", "title", "keywords"
    named = [t for t in tools if all(_speaks(of(t, *names), word) for word in wanted)]
    told = [t for t in tools if all(_speaks(of(t, *names, "description"), w) for w in wanted)]
    return named + [tool for tool in told if tool not in named]


def _speaks(text: str, word: str) -> bool:
    """Whether a word of a text begins so, or is one of several: tree finds trees, no streets.

    >>> _speaks("a tree", "trees"), _speaks("its length", "lens")
    (True, False)
    """
    whole = rf"{re.escape(_PLURAL.sub('', word))}(?![^\W_])"
    return re.search(rf"(?<![^\W_])({re.escape(word)}|{whole})", text) is not None


def width_of(stream: IO[str]) -> int | None:
    """Columns of the terminal; None for a file or pipe, where lines may be of any length."""
    return max(shutil.get_terminal_size().columns, _NARROWEST) if stream.isatty() else None


def lines(tools: Sequence[Summary], width: int | None) -> Iterator[str]:
    """A line for each tool below the name of its group: id, and what it does."""
    ids = max(len(tool["id"]) for tool in tools) + _GAP
    first = True
    for group, members in groupby(tools, lambda tool: str(tool["id"]).partition(".")[0]):
        yield f"{'' if first else chr(10)}{group}"
        first = False
        for tool in members:
            says = tool["description"].partition("\n")[0].rstrip(".") or tool["title"]
            told = textwrap.wrap(says, width - ids - 2) if width else [says]
            for name, line in zip_longest([tool["id"]], told, fillvalue=""):
                yield f"  {name:{ids}}{line}".rstrip()
