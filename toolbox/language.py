"""Texts in the language of the user, from the gettext catalogues in metadata/translations.

The language is that of TOOLBOX_LANG, else that of the locale; English where it has no catalogue.
A text without a translation stays English. Data, names of parameters and JSON are never
translated.

Code that knows no languages says warnings, errors and reports in English, with values in them.
`told` finds the text among those of the catalogue, in which {1}, {2} stand for the values.
"""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from toolbox.counting import agree
from toolbox.places import METADATA

FOLDER = METADATA / "translations"
_language: ContextVar[str] = ContextVar("language", default="")
VARIABLES = ("TOOLBOX_LANG", "LC_ALL", "LC_MESSAGES", "LANG")
TOLD = "told.po"  # texts with values in them
_VALUE = re.compile(r"\{\d+\}")
_NAME = re.compile(r"[a-z_]+")
_WORD = re.compile(r"[^\W\d_]+")
_SHARE = re.compile(  # of a list: "water 4.0 %", "40 critical", "tree 94", "road 9 m"
    r"(?P<before>\d+ )?(?P<name>.+?)(?P<share> [\d.]+ (?:%|m)|(?<=[a-z]) \d+)?", re.DOTALL
)
_PARTS = re.compile(r"(?<=[;:.]) +")
_THIN = "\u202f"  # a narrow blank that no line is broken at, between thousands
_LONG = 40  # letters of a text by which it is known, whatever its values hold
_SHORT = 8  # letters that many texts have, so that the first value must be a number
_ONE = r"(?:'[^']*'|[^;,( ](?:(?![;,]| \().)*)"  # a value before one that adds something to it
_FILE = r"(?P<file>(?:\w+: )?\S*\w\.\w\S* )?"  # what a text is about, which begins with its verb
# A decimal number by itself: no part of a name, of a path, a version, an address or a law.
_PAIR = re.compile(r"(\d\.\d+),(?=[-+]?\d+\.\d)")  # the comma between two decimal numbers
_DECIMAL = re.compile(r"(?<![\w./:-])(?<!§ )([-+]?\d+)\.(\d+)(?![\w/]|\.\w|-\d)")


def languages() -> list[str]:
    """The languages that have a catalogue."""
    return sorted(path.name for path in FOLDER.glob("*") if path.is_dir())


@contextmanager
def speaking(code: str) -> Iterator[None]:
    """Texts are in this language for a while, whatever the language of the user."""
    before = _language.set(code)
    try:
        yield
    finally:
        _language.reset(before)


def chosen() -> str:
    """The language of the user, such as "tr"; "en" without a catalogue of it."""
    if code := _language.get():
        return code
    said = next((text for name in VARIABLES if (text := os.environ.get(name))), "")
    code = _code(said)
    return code if code.isalpha() and (FOLDER / code).is_dir() else "en"


def _code(said: str) -> str:
    """The language of a locale: "tr" of tr_TR.UTF-8."""
    return said.partition(".")[0].partition("_")[0].partition("-")[0].lower()


def missing() -> str:
    """What is said of a language that TOOLBOX_LANG asks for and that has no catalogue; else ""."""
    said = os.environ.get("TOOLBOX_LANG", "")
    if not said or _code(said) in ("c", "posix", "en", *languages()):
        return ""
    return f"TOOLBOX_LANG={said}: texts are English; there are only en, {', '.join(languages())}"


@functools.cache
def catalogue(code: str, files: str = "*.po") -> Mapping[str, str]:
    """The translations of a language by the English texts, from all files of it or from some."""
    if code == "en":
        return {}
    import polib

    made: dict[str, str] = {}
    for path in sorted((FOLDER / code).glob(files)):
        entries = polib.pofile(str(path), encoding="utf-8").translated_entries()
        made |= {entry.msgid: entry.msgstr for entry in entries}
    return made


def text(english: str) -> str:
    """A text in the language of the user.

    >>> text("a text that nobody has translated")
    'a text that nobody has translated'
    """
    return catalogue(chosen()).get(english, english)


def told(english: str) -> str:
    """A text with values in it, line by line, in the language of the user.

    >>> told("a text that nobody has translated"), told("1 points are")
    ('a text that nobody has translated', '1 point is')
    """
    if (code := chosen()) == "en":
        return agree(english)
    return "\n".join(_line(code, line) for line in english.split("\n"))


_UNIT = r"(?:(?:US )?[A-Za-z]{1,2}[²³]?)?"
_NUMBER = re.compile(rf"[^A-Za-z]*\d[^A-Za-z]*{_UNIT}(?: to [^A-Za-z]*\d[^A-Za-z]*{_UNIT})?")
_MARKS = "; ", ": ", ", ", " (", " ["  # between the parts of a label


def label(english: str) -> str:
    """A label of a map, chart or axis in the language of the user; its parts are told one by one.

    Names that are in no catalogue, as people give them, are kept as they are.

    >>> label("Height nobody has translated (m)")
    'Height nobody has translated (m)'
    >>> with speaking("tr"):
    ...     label("Elevation (m)"), label("0.25 m"), label("-0.1 to 0.2"), label("Plot 2.5")
    ('Yükseklik (m)', '0,25 m', '-0,1 to 0,2', 'Plot 2.5')
    """
    if chosen() == "en":
        return english
    if (made := told(english)) != english:
        return decimals(made)
    for mark in _MARKS:
        first, found, rest = english.partition(mark)
        if found:
            return f"{label(first)}{mark}{label(rest)}"
    return decimals(english) if _NUMBER.fullmatch(english) else english


def decimals(text: str) -> str:
    """The numbers of a text for people with the decimal sign of the language of the user.

    >>> with speaking("tr"):
    ...     decimals("0.25 m in EPSG:32635, lidar-toolbox 0.1.0, a.laz")
    '0,25 m in EPSG:32635, lidar-toolbox 0.1.0, a.laz'
    >>> with speaking("tr"):
    ...     decimals("at 500100.9,4400152.4: classes 2,9")
    'at 500100,9; 4400152,4: classes 2,9'
    """
    return text if chosen() == "en" else _DECIMAL.sub(r"\1,\2", _PAIR.sub(r"\1; ", text))


def counted(number: int) -> str:
    """A number of things; between its thousands a comma, or what is no decimal sign.

    >>> counted(54864)
    '54,864'
    >>> with speaking("tr"):
    ...     told(f"{counted(54864)} points")
    '54\\u202f864 nokta'
    """
    return f"{number:,}" if chosen() == "en" else f"{number:,}".replace(",", _THIN)


def for_people(english: str) -> str:
    """A text with values in it as reports say it: :func:`told`, with :func:`decimals`."""
    return decimals(told(english))


def capitalised(text: str) -> str:
    """A text that begins with a large letter, as a sentence does.

    >>> with speaking("tr"):
    ...     capitalised("iki nokta"), capitalised("intensity"), capitalised("5 nokta")
    ('İki nokta', 'Intensity', '5 nokta')
    """
    first = "İ" if text[:1] == "i" and _is_turkish(text) else text[:1].upper()
    return first + text[1:]


def uncapitalised(text: str) -> str:
    """A text that begins with a small letter, as within a sentence; DTM and IoU stay.

    >>> uncapitalised("Height"), uncapitalised("DTM of all"), uncapitalised("IoU")
    ('height', 'DTM of all', 'IoU')
    >>> with speaking("tr"):
    ...     uncapitalised("Işığın yönü"), uncapitalised("İki nokta"), uncapitalised("Intensity")
    ('ışığın yönü', 'iki nokta', 'intensity')
    """
    if (word := _WORD.match(text)) and word[0][1:] != word[0][1:].lower():
        return text
    first = (
        "\u0131" if text[:1] == "I" and _is_turkish(text) else text[:1].replace("İ", "i").lower()
    )
    return first + text[1:]


def _is_turkish(text: str) -> bool:
    """Whether a text begins with a word of Turkish, whose i and I are two letters each."""
    word = _WORD.match(text)
    return chosen() == "tr" and word is not None and _small(word[0]) in _own_words("tr")


@functools.cache
def _own_words(code: str) -> frozenset[str]:
    """The words of the translations that no English text has, in small letters of Turkish."""
    english, own = (
        {_small(word) for said in texts for word in _WORD.findall(said)}
        for texts in (catalogue(code).keys(), catalogue(code).values())
    )
    return frozenset(own - english)


def _small(word: str) -> str:
    return word.replace("İ", "i").replace("I", "\u0131").lower()


def _line(code: str, line: str) -> str:
    """A line; if it is not known as a whole, its longest parts that are known, one by one."""
    text = line.strip()
    if not text:
        return line
    if (made := _known(code, text)) is None:
        ends = [part.span() for part in _PARTS.finditer(text)]
        if not ends:
            return line
        found = ((end, start, _known(code, text[:end])) for end, start in reversed(ends))
        longest = next((one for one in found if one[2]), (*ends[0], None))
        end, start, first = longest
        made = f"{first or text[:end]}{text[end:start]}{_line(code, text[start:])}"
    return line.replace(text, made, 1)


def _known(code: str, text: str) -> str | None:
    """A text of the catalogue with its values; these may be texts, too."""
    bare, ending = (text[:-1], text[-1]) if text[-1] in ".,;:" else (text, "")
    if made := _whole(code, text, ""):
        return made
    if made := _whole(code, bare, ending):
        return made + ending
    if made := _filled(code, bare, ending):
        return made
    name, _, rest = text.partition(" ")  # of a file, before what is wrong with it
    if rest and "." in name[:-1] and (said := _known(code, rest)):
        return f"{name} {said}"
    return None


def _whole(code: str, text: str, ending: str) -> str | None:
    """A text without values, or several between commas; a name before a colon stays."""
    exact = catalogue(code)
    if text in exact and not (ending == ":" and _NAME.fullmatch(text)):
        return exact[text]
    parts = [_SHARE.fullmatch(part) for part in text.split(", ")]
    names = [[part[k] or "" for k in ("before", "name", "share")] for part in parts if part]
    known = all(
        len(name) == 1
        or (name in exact and (name.islower() or not (before or share.strip().isdigit())))
        for before, name, share in names  # with a number of their own, large letters are names
    )
    several = len(names) == len(parts) and (names[1:] or names[0][0] or names[0][2])
    made = (before + exact.get(name, name) + share for before, name, share in names)
    return ", ".join(made) if known and several else None


def _filled(code: str, bare: str, ending: str) -> str | None:
    """A text with values, whose last sign may belong to it, or to the sentence around it."""
    for pattern, translated, last in _patterns(code):
        own = ending if translated.endswith((ending, last)) else ""
        if found := pattern.fullmatch(bare + own):
            named = found.groupdict()
            file = named.pop("file", "") or ""
            values = {name[1:]: _line(code, value) for name, value in named.items()}
            made = _VALUE.sub(lambda place: values[place[0][1:-1]], translated)  # noqa: B023
            return file + made + ("" if own else ending)
    return None


@functools.cache
def _patterns(code: str) -> list[tuple[re.Pattern[str], str, str]]:
    """What the texts with values look like, those that say most first, and the value
    with which each ends."""
    made = []
    entries = dict(catalogue(code, TOLD))
    # What goes on after a semicolon or a colon may stand alone.
    added = {e: t for e, t in entries.items() if e.startswith(("; ", ": "))}
    alone = {e[2:]: t.removeprefix(e[:2]) for e, t in added.items()}
    for english, translated in (alone | entries).items():
        words, values = _VALUE.split(english), _VALUE.findall(english)
        if not values or not any(word.strip(" :;,.()") for word in words):
            continue
        size = len("".join(words))
        end = r"\. " if ";" in english or size > _LONG else r"[.;] "
        inside = rf"(?:(?!{end}).)"
        # A value goes on beyond a sentence where a whole one stands first.
        whole = re.match(r"\{1\} [A-Z]", english)
        first = (
            r".+?"
            if whole
            else rf"[\d,.{_THIN}]+"
            if size <= _SHORT and not words[0]
            else rf"{inside}+?"
        )
        # One that follows without a blank may be empty.
        glued = [
            inside + ("+?" if word and not word[-1:].isalnum() else "*?") for word in words[1:]
        ]
        kinds = [rf"{inside}*?" if words[0][-1:].isalnum() else first, *glued]
        for at, word in enumerate(words[1:-1]):
            if not word:  # no word between this value and the next, which adds something to it
                kinds[at] = _ONE
        names = [f"(?P<v{v[1:-1]}>{k})" for v, k in zip(values, kinds, strict=False)] + [""]
        text = "".join(re.escape(w) + n for w, n in zip(words, names, strict=True))
        text = f"{_FILE}{text}" if english[0].islower() else text
        last = values[-1] if english.endswith(values[-1]) else "\0"  # which nothing ends with
        made.append((size, re.compile(text), translated, last))
    return [(how, text, last) for _, how, text, last in sorted(made, key=lambda one: -one[0])]


def paragraphs(english: str) -> str:
    """A text whose paragraphs are translated one by one."""
    return "\n\n".join(map(text, english.split("\n\n")))


def summary(tool: Mapping[str, Any]) -> dict[str, Any]:
    """The summary of a tool for a list, with the first sentence of its description."""
    first = tool["description"].partition("\n")[0]
    says = text(first.removesuffix(".")) + first[-1:]
    return dict(tool) | {"title": text(tool["title"]), "description": says}


def described(tool: Mapping[str, Any]) -> dict[str, Any]:
    """The description of a tool with its texts in the language of the user, for people to read."""
    if chosen() == "en":
        return dict(tool)
    first, _, more = tool["description"].partition("\n\n")
    summary = text(first.removesuffix("."))
    made = dict(tool) | {
        "title": text(tool["title"]),
        "description": "\n\n".join(filter(None, [f"{summary}.", paragraphs(more)])),
    }
    for side in ("inputs", "outputs", "between"):
        if side in tool:
            made[side] = {name: _field(field) for name, field in tool[side].items()}
    return made


SPOKEN = ("choice", "option", "coordinates")
"""Roles of the metadata of a field whose values are texts for people."""


def _field(field: Mapping[str, Any]) -> dict[str, Any]:
    words = [
        meta | {"value": text(meta["value"])} if meta["role"] in SPOKEN else meta
        for meta in field["metadata"]
    ]
    said = {name: text(field[name]) for name in ("title", "description")}
    return dict(field) | said | {"metadata": words}
