"""Messages of a run as a report says them: sentences for people who have not run it."""

from __future__ import annotations

import re

from toolbox import language

_OF_INPUT = re.compile(r"[a-z_]+: (?=\w)")
_RAISED = re.compile(r"(?<![\w/.])(m|ft|km)([23])(?!\w)|(?<=/)(m|ft)([23])(?!\w)")
_FIGURES = {"2": "²", "3": "³"}


def sentence(text: str) -> str:
    """A message without the input that it is about, with a large letter and raised figures.

    A first word that is a name in a file stays as it is.

    Examples
    --------
    >>> sentence("all points are alike"), sentence("a.laz: 2 points"), sentence("nDSM is empty")
    ('All points are alike', 'a.laz: 2 points', 'nDSM is empty')
    >>> sentence("points: the water of about 20 m2 has 3 points per m2")
    'The water of about 20 m² has 3 points per m²'
    """
    if found := _OF_INPUT.match(text):
        text = text[found.end() :]
    first = text.split(maxsplit=1)[0].rstrip(":,") if text else ""
    text = language.capitalised(text) if first.isalpha() and first.islower() else text
    return raised(text)


def cell(text: str) -> str:
    """The text of a cell: a number, a sentence, a word of a few that are known, or a name.

    >>> with language.speaking("tr"):
    ...     cell("tree"), cell("0.25"), cell("Kestel 2")
    ('ağaç', '0,25', 'Kestel 2')
    """
    return language.decimals(language.told(text) if " " in text else language.text(text))


def raised(text: str) -> str:
    """Areas and volumes with raised figures.

    >>> raised("20 m2, 3 points/m2, a.ft2, 4 ft3")
    '20 m², 3 points/m², a.ft2, 4 ft³'
    """
    return _RAISED.sub(lambda m: (m[1] or m[3]) + _FIGURES[m[2] or m[4]], text)
