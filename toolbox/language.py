"""Texts in the language of the user, from the gettext catalogues in metadata/translations.

The language is that of TOOLBOX_LANG, else that of the locale; English where it has no catalogue.
A text without a translation stays English. Data, names of parameters and JSON are never
translated.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from toolbox.places import METADATA

FOLDER = METADATA / "translations"
_said: ContextVar[str] = ContextVar("language", default="")
VARIABLES = ("TOOLBOX_LANG", "LC_ALL", "LC_MESSAGES", "LANG")


def languages() -> list[str]:
    """The languages that have a catalogue."""
    return sorted(path.name for path in FOLDER.glob("*") if path.is_dir())


@contextmanager
def speaking(code: str) -> Iterator[None]:
    """Texts are in this language for a while, whatever the language of the user."""
    before = _said.set(code)
    try:
        yield
    finally:
        _said.reset(before)


def chosen() -> str:
    """The language of the user, such as "tr"; "en" without a catalogue of it."""
    if code := _said.get():
        return code
    said = next((text for name in VARIABLES if (text := os.environ.get(name))), "")
    code = said.partition(".")[0].partition("_")[0].partition("-")[0].lower()
    return code if code.isalpha() and (FOLDER / code).is_dir() else "en"


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
