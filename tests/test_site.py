"""The site in a real browser: WCAG 2.2 AA as far as axe can tell, phones, and the keyboard."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from scenes.browser import CHROMIUM, IN_A_BROWSER

pytestmark = IN_A_BROWSER

DOCS = Path(__file__).resolve().parents[1] / "docs"
# One page of each kind; those with wide tables, code, pictures and diagrams among them.
PAGES = [
    "index",
    "start/first-quarter-hour",
    "jobs/terrain",
    "jobs/in-qgis",
    "choose/ground-filter",
    "gallery",
    "tools/index",
    "tools/models.terrain",
    "tools/corridor.clearance",
    "explanation/urban-classes",
    "reference/figures",
    "reference/glossary",
    "tr/jobs/terrain",
    "search",
]
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
OF_THE_THEME = {"page-has-heading-one"}  # its search page has none; no rule of WCAG
VIEWS = {"desktop, light": (1200, "light"), "phone, dark": (360, "dark")}

# How far it moves where a table is pulled.
FIRST_COLUMN = """[...document.querySelectorAll('table.docutils')].map(one => {
    one.scrollLeft = 9999;
    const cell = one.querySelector('tbody tr > *').getBoundingClientRect();
    return Math.round(cell.left - one.getBoundingClientRect().left); })"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "sphinx", "--quiet", "-d", str(folder / "trees")]
    env = os.environ | {"PYTHONPATH": str(DOCS.parent)}
    subprocess.run([*words, str(DOCS), str(folder / "html")], env=env, check=True)
    return folder / "html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as found:
        made = found.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield made
        made.close()


@pytest.mark.parametrize("view", VIEWS)
def test_pages_are_accessible_and_fit_the_screen(view: str, site: Path, browser: Any) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    width, scheme = VIEWS[view]
    context = browser.new_context(viewport={"width": width, "height": 800}, color_scheme=scheme)
    wrong = []
    for name in PAGES:
        page = context.new_page()
        page.goto((site / f"{name}.html").as_uri())
        found = axe.run(page, options={"runOnly": RULES, "resultTypes": ["violations"]})
        for rule in found.response["violations"]:
            if rule["id"] not in OF_THE_THEME:
                wrong += [(name, rule["id"], node["html"][:120]) for node in rule["nodes"]]
        beyond = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        if beyond > 0:
            wrong.append((name, "wider than the screen by", beyond))
        moved = page.evaluate(FIRST_COLUMN) if width < 700 else []
        wrong += [(name, "its first column moves by", by) for by in moved if abs(by) >= 1]
        page.close()
    assert not wrong


def test_pages_name_their_language(site: Path) -> None:
    for name, code in (("tr/jobs/terrain", "tr"), ("jobs/terrain", "en")):
        assert f' lang="{code}"' in (site / f"{name}.html").read_text("utf-8")[:300]


def test_a_page_is_used_with_keys_alone(site: Path, browser: Any) -> None:
    page = browser.new_page(viewport={"width": 1200, "height": 800})
    page.goto((site / "start" / "first-quarter-hour.html").as_uri())
    page.keyboard.press("Tab")
    first = page.evaluate("document.activeElement.innerText")
    assert "content" in first  # over the menu, to the text
    seen = set()
    for _ in range(200):
        page.keyboard.press("Tab")
        seen.add(
            page.evaluate(
                "(a => a.type === 'search' || a.name === 'q' ? 'search' : a.tagName)"
                "(document.activeElement)"
            )
        )
    assert {"search", "A", "BUTTON"} <= seen  # links, the search, and the buttons that copy
    page.close()
