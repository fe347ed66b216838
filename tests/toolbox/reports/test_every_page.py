"""The report of every tool in a real browser: it fails nowhere, asks for nothing, and answers."""

from __future__ import annotations

import io
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import test_every_tool as laws
from PIL import Image
from scenes.browser import CHROMIUM, IN_A_BROWSER, WEBGL
from test_every_tool import block as block  # noqa: PLC0414  (a fixture)

import toolbox
from toolbox.data import PointCloud
from toolbox.declare.fields import Spec

pytestmark = IN_A_BROWSER

FIRST_PLACE = """() => {
  const figure = document.querySelector("figure[data-kind=map]");
  const data = JSON.parse(figure.querySelector("script").textContent);
  const canvas = figure.querySelector(".canvas"), box = canvas.getBoundingClientRect();
  const { xaxis: x, yaxis: y } = canvas._fullLayout;
  for (const layer of data.layers) for (const group of layer.groups) {
    if (layer.hidden) continue;
    for (const [, [part]] of group.features) {
      const across = x.d2p(data.x0 + part[0]), down = y.d2p(data.y0 + part[1]);
      if (across < 5 || down < 5 || across > x._length / 2 || down > y._length - 30) continue;
      return [box.left + x._offset + across, box.top + y._offset + down];
    }
  }
  return null;
}"""


OF_WATER = {"models.reservoir_storage"}  # tools for which a slope without water is an error


def lake() -> PointCloud:
    found = toolbox.run("samples.scene", {"kind": "reservoir", "size": 160.0, "density": 2.0})
    points: PointCloud = found["points"]
    return points


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as found:
        made = found.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", *WEBGL])
        yield made
        made.close()


@pytest.mark.parametrize("spec", laws.TOOLS, ids=laws.name_of)
def test_every_page_works_in_a_browser(
    spec: Spec, block: PointCloud, browser: Any, tmp_path: Path
) -> None:
    place = tmp_path / "page.html"
    settings = laws.FAST.get(spec.id, {}) | laws.REFERENCE.get(spec.id, {})
    points = lake() if spec.id in OF_WATER else block
    toolbox.run(spec.id, {**settings, **laws.layers(spec, points), "page": place})
    opened = browser.new_page(viewport={"width": 1200, "height": 900})
    try:
        said: list[str] = []
        opened.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
        opened.on("pageerror", lambda error: said.append(str(error)))
        asked: list[str] = []
        opened.on("request", lambda request: asked.append(request.url))
        opened.goto(place.as_uri())
        _check_tables(opened)
        _check_map(opened)
        _check_space(opened)
        assert said == []
        assert [u for u in asked if not u.startswith(("data:", "blob:"))] == [place.as_uri()]
        _check_paper(opened, tmp_path / "page.pdf")
    finally:
        opened.close()


def _check_tables(opened: Any) -> None:
    """Each table sorts by its last column, up and down.

    No pointer is moved: a plot that is being drawn beside moves the heading away below it.
    """
    tables = opened.locator("main section > .table:not(.on-paper) table")
    for place in range(tables.count()):
        heads = tables.nth(place).locator("thead th")
        if not heads.locator("button").count():
            continue
        heads.last.locator("button").dispatch_event("click")
        assert heads.last.get_attribute("aria-sort") == "ascending"
        up = tables.nth(place).locator("tbody td:last-child").all_text_contents()
        heads.last.locator("button").dispatch_event("click")
        down = tables.nth(place).locator("tbody td:last-child").all_text_contents()
        assert sorted(up) == sorted(down)
        if "number" in (heads.last.get_attribute("class") or ""):
            numbers = [float(text) for text in up if text.strip()]
            assert numbers == sorted(numbers)


def _check_map(opened: Any) -> None:
    """A click on a feature tells of it."""
    figure = opened.locator("figure[data-kind=map]").first
    if not opened.locator("figure[data-kind=map]").count():
        return
    figure.scroll_into_view_if_needed()
    opened.locator("figure.drawn[data-kind=map]").first.wait_for(timeout=60_000)
    if place := opened.evaluate(FIRST_PLACE):
        opened.mouse.click(*place)
        assert figure.locator(".asked").is_visible()


def _check_space(opened: Any) -> None:
    """The view in space draws something."""
    if not opened.locator("figure[data-kind=space]").count():
        return
    opened.locator("figure[data-kind=space]").scroll_into_view_if_needed()
    opened.locator("figure.drawn[data-kind=space]").wait_for(timeout=60_000)
    canvas = opened.locator("figure[data-kind=space] .gl-container canvas").first
    opened.wait_for_timeout(300)
    with Image.open(io.BytesIO(canvas.screenshot())) as image:
        assert len(image.convert("RGB").quantize(64).getcolors() or []) > 3


def _check_paper(opened: Any, place: Path) -> None:
    """All words of the last column of each table are on paper."""
    tables = opened.locator("main section .table:not(.on-paper) table")
    texts = [
        tables.nth(k).locator("tbody td:last-child").all_text_contents()
        for k in range(tables.count())
    ]
    opened.pdf(path=place, prefer_css_page_size=True)
    told = subprocess.run(["pdftotext", "-layout", place, "-"], capture_output=True, check=True)
    paper = "".join(told.stdout.decode().split()).replace("-", "")
    words = {word for column in texts for text in column for word in text.replace("-", "").split()}
    assert [word for word in sorted(words) if word not in paper] == []
