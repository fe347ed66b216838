"""The files that a page names are there, and its links lead to files."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "README.tr.md",
    ROOT / "SECURITY.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
NOW = [page for page in PAGES if page.parent.name != "decisions"]  # these tell of their time
FILES = re.compile(r"`((?:toolbox|algorithms|tests|docs|metadata)/[\w./-]*)`")
LINKS = re.compile(r"\]\((?!https?:|mailto:|#)([^)#\s]+)")
NOT_YET = {"algorithms/points/higher.py", "tests/algorithms/points/test_higher.py"}  # of a lesson


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", NOW, ids=name_of)
def test_files_that_a_page_names_are_there(page: Path) -> None:
    named = set(FILES.findall(page.read_text("utf-8"))) - NOT_YET
    assert not [name for name in named if not (ROOT / name).exists()]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_to_files(page: Path) -> None:
    links = LINKS.findall(page.read_text("utf-8"))
    assert not [link for link in links if not (page.parent / link).exists()]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_pictures_say_what_they_show_and_columns_have_a_head(page: Path) -> None:
    """For those who listen to the page."""
    text = page.read_text("utf-8")
    assert not re.findall(r"!\[\s*\]\([^)]*\)", text)
    heads = re.findall(r"(?m)^(\|.*)\n\|(?: ?:?-+:? ?\|)+$", text)
    assert not [head for head in heads if re.search(r"\|\s*\|", head)]


EXPLAINED = sorted((ROOT / "docs" / "explanation").glob("*.md"))


@pytest.mark.parametrize("page", EXPLAINED, ids=name_of)
def test_an_explanation_says_what_makes_its_figures(page: Path) -> None:
    """A measurement, the tests that hold them, or that they were measured once."""
    ways = r"tests\.bench|make bench|docs/make_|python -m toolbox|measured once|tests/[\w/]+\.py"
    assert re.search(ways, page.read_text("utf-8"))


def test_the_readme_quotes_the_figures_that_were_measured() -> None:
    """Each number of its table stands on the page that `make bench` writes."""
    readme = (ROOT / "README.md").read_text("utf-8")
    rows = re.findall(r"(?m)^\| [^|]+ \| ([^|]+) \|$", readme.partition("## How good")[2])
    numbers = [n for row in rows[:7] for n in re.findall(r"\d+(?:\.\d+)?", row)]
    page = (ROOT / "docs" / "reference" / "figures.md").read_text("utf-8")
    assert len(numbers) == 11
    assert not [n for n in numbers if not re.search(rf"(?<![\d.]){re.escape(n)}(?![\d.]\d)", page)]


def test_the_page_of_figures_is_made_of_what_was_measured() -> None:
    """A number that was changed by hand would be gone with the next `make docs`."""
    made = runpy.run_path(str(ROOT / "docs" / "make_figures.py"))
    assert made["PAGE"].read_text("utf-8") == made["page"]()
