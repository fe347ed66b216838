"""The glossary: every word once, and words that it marks as not used occur nowhere."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GLOSSARY = ROOT / "docs" / "reference" / "glossary.md"

ALLOWED = {
    ("home", "toolbox/qgis/install.py"): "XDG_DATA_HOME of Linux",
    ("home", "toolbox/data/remote/credentials.py"): "Path.home of Python",
    ("station", "algorithms/samples/_facade.py"): "where a terrestrial scanner stands",
    ("station", "docs/explanation/denoise.md"): "the same",
    ("station", "docs/explanation/cloth-simulation.md"): "a railway station",
    ("station", "docs/explanation/ground-filters.md"): "the same",
    ("heap", "algorithms/shoreline/_basin_kernels.py"): "a priority queue in an array",
    ("collection", "toolbox/data/paths.py"): "STAC has item collections",
    ("collection", "toolbox/data/vpc.py"): "the same",
}
"""Words that mean something else in some files: word, pattern of paths, reason."""

OF_OTHERS = re.compile(r"\b(add_collection|collections)\b|\w*Collection\w*")
"""Names of Python, matplotlib and OGC."""


def entries() -> Iterator[list[str]]:
    """The cells of each entry: word, meaning, elsewhere, not used."""
    for line in GLOSSARY.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and cells[0] != "word" and set(cells[0]) != {"-"}:
            yield cells


def not_used() -> list[str]:
    return [word.strip() for *_, words in entries() for word in words.split(",") if word.strip()]


def words_of(text: str) -> str:
    """A text as lower-case words with a space between, those within identifiers too."""
    parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", OF_OTHERS.sub("", text))
    return f" {' '.join(parts).lower()} "


def texts() -> Iterator[tuple[str, str]]:
    """Path and words of each file of the code and the documentation."""
    for folder in ("toolbox", "algorithms", "docs"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in (".py", ".md", ".yaml") and path != GLOSSARY:
                yield path.relative_to(ROOT).as_posix(), words_of(path.read_text(encoding="utf-8"))


def found_in(words: str, word: str) -> bool:
    return f" {word} " in words or f" {word}s " in words


def test_each_word_has_one_entry_of_four_cells() -> None:
    found = list(entries())
    assert {len(cells) for cells in found} == {4}
    assert all(cells[1].endswith(".") for cells in found)
    words = [word.strip().lower() for cells in found for word in cells[0].split(",")]
    assert sorted(words) == sorted(set(words))


def test_classes_that_it_names_are_there() -> None:
    named = re.findall(r"the class `(\w+)`", GLOSSARY.read_text(encoding="utf-8"))
    code = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "toolbox").rglob("*.py"))
    assert named
    assert [name for name in named if f"class {name}" not in code] == []


def test_words_that_are_not_used_do_not_occur() -> None:
    problems = [
        f"{path}: {word}"
        for path, words in texts()
        for word in not_used()
        if found_in(words, word)
        and not any(word == known and fnmatch(path, pattern) for known, pattern in ALLOWED)
    ]
    assert problems == []


def test_exceptions_are_needed() -> None:
    everything = list(texts())
    idle = [
        (word, pattern)
        for word, pattern in ALLOWED
        if not any(fnmatch(path, pattern) and found_in(words, word) for path, words in everything)
    ]
    assert idle == []


@pytest.mark.parametrize("text", ["_strand_of", "StrandCount", "two strands hang", "STRANDS"])
def test_words_are_found_within_identifiers(text: str) -> None:
    assert found_in(words_of(text), "strand")
