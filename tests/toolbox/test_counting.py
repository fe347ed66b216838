"""Words agree with their numbers, in all texts that a run can say."""

from __future__ import annotations

import re

import polib
import pytest

from toolbox.counting import _ONE, _OWN, agree
from toolbox.language import FOLDER, TOLD

_COUNT = re.compile(r"\{\d+\}")
_PLURAL = re.compile(rf"(?<![\w.,:/+-])1 (?:(?:{_OWN}) )*(?P<noun>[a-z]+(?:s|ices))\b")
_VERB = re.compile(
    rf"(?<![\w.,:/+-])(?<!near )(?<!than )1 (?:of 7 )?(?:{'|'.join(_ONE.values())})(?: that)? "
    r"(?:are|have|were|do|lie|hang|share)\b"
)
_NO_NOUNS = frozenset(
    (
        *("across", "also", "as", "asks", "begins", "belongs", "besides", "claims", "class"),
        *("depends", "differs", "does", "exists", "falls", "gives", "goes", "has", "hides"),
        *("holds", "is", "its", "keeps", "ps", "leaves", "less", "lies", "makes", "means"),
        *("names", "needs", "ones", "pages", "promises", "reaches", "says", "sends", "stands"),
        *("states", "takes", "this", "times", "towards", "turns", "us", "uses", "was", "whose"),
        *("works"),
    )
)
"""Words on s after a value that may be a name, such as "{1} has"; "1 times" is said of factors."""


def texts() -> list[str]:
    """All texts with values."""
    path = FOLDER / "tr" / TOLD
    entries = polib.pofile(str(path), encoding="utf-8")
    return [entry.msgid for entry in entries if not entry.obsolete]


def test_no_text_counts_one_as_many():
    wrong = []
    for text in texts():
        made = agree(_COUNT.sub("1", re.sub(r"of \{\d+\}", "of 7", text)))
        left = [m["noun"] for m in _PLURAL.finditer(made) if m["noun"] not in _NO_NOUNS]
        named = re.search(r"\b(class|level|span|plane|scan|line) 1 ", made)
        if (left or _VERB.search(made)) and not named:
            wrong.append(made)
    assert not wrong, "\n".join(wrong)


def test_texts_say_no_s_in_brackets():
    assert not [text for text in texts() if "(s)" in text]


@pytest.mark.parametrize(
    "text",
    [
        "class 1 points are kept",
        "0.1 points per m2",
        "21 objects are too close",
        "EPSG:1 points",
        "1.1 tiles",
        "from 0 to 1 m",
        "1 of its points",
    ],
)
def test_other_numbers_stay(text):
    assert agree(text) == text


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("1 points hang in mid-air", "1 point hangs in mid-air"),
        ("1 points that have no class", "1 point that has no class"),
        ("1 water bodies of 20 m²", "1 water body of 20 m²"),
        ("1 points of class 7 (low noise) were taken", "1 point of class 7 (low noise) was taken"),
        ("1 of 3,200 points lie far", "1 of 3,200 points lies far"),
        ("They stand in 1 clumps.", "They stand in 1 clump."),
        ("points near 1 wires hang in mid-air", "points near 1 wire hang in mid-air"),
        ("there are 1 classes", "there is 1 class"),
        ("1 level places are left out", "1 level place is left out"),
    ],
)
def test_one_is_not_many(text, made):
    assert agree(text) == made
