"""Reports in a real browser: nothing is loaded, nothing fails, tables sort, maps answer.

The browser is the chromium of the system, as the library that drives it has none of its own. Where
there is none the tests skip, unless TOOLBOX_TEST_BROWSER is "required".
"""

from __future__ import annotations

import html
import itertools
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from scenes.browser import CHROMIUM, IN_A_BROWSER, WEBGL

import toolbox
from toolbox import catalog, language
from toolbox.data import PointCloud, Report, Rows, Section, Table, Vector
from toolbox.data.crs import parse_crs
from toolbox.data.report import Column

CRS = parse_crs("EPSG:32635+3855")
pytestmark = IN_A_BROWSER


def squares(sizes: list[float], shift: float) -> Vector:
    shapes = [shapely.box(40 * k + shift, 0, 40 * k + shift + s, s) for k, s in enumerate(sizes)]
    moved = shapely.transform(np.array(shapes), lambda xy: xy + np.array([5e5, 4.4e6]))
    frame = geopandas.GeoDataFrame({"name": [f"{s:g} m" for s in sizes]}, geometry=moved, crs=CRS)
    return Vector(frame, name="areas.gpkg")


def house() -> PointCloud:
    """Ground, and a house of 20 m by 12 m with a flat roof 6 m above it, points 0.5 m apart."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 60, 0.5), np.arange(0, 40, 0.5)))
    roof = (x > 20) & (x < 40) & (y > 14) & (y < 26)
    noise = np.random.default_rng(1).normal(0, 0.02, len(x))
    xyz = np.column_stack([x + 500_000, y + 4_400_000, 100 + 6.0 * roof + noise])
    classes = np.where(roof, 6, 2)
    more = {"classification": classes, "intensity": np.where(roof, 90, 40) + (x % 7).astype(int)}
    return PointCloud(xyz, more, crs=CRS, name="house.laz")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The pages of several tools, by name."""
    folder = tmp_path_factory.mktemp("pages")
    sizes = [8.0 + k for k in range(14)]
    given: dict[str, tuple[str, dict[str, Any]]] = {
        "areas": ("compare.areas", {"areas": squares(sizes, 2), "reference": squares(sizes, 0)}),
        "planes": ("planes.extract", {"points": house()}),
        "grid": ("surface.grid", {"points": house()}),
        "info": ("points.info", {"points": house()}),
    }
    made = {name: folder / f"{name}.html" for name in given}
    for name, (tool, values) in given.items():
        toolbox.run(tool, {**values, "page": made[name]})
    return made


@pytest.fixture(scope="module")
def driver() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as found:
        yield found.chromium


class Opened:
    """A page in the browser, with all that it said and asked for."""

    def __init__(self, driver: Any, path: Path, *args: str, width: int = 1200) -> None:
        self.browser = driver.launch(executable_path=CHROMIUM, args=["--no-sandbox", *args])
        self.page = self.browser.new_page(viewport={"width": width, "height": 900})
        self.errors: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", lambda m: self.errors.append(m.text) if m.type == "error" else 0)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(path.as_uri())

    def __enter__(self) -> Opened:
        return self

    def __exit__(self, *_: object) -> None:
        self.browser.close()

    def drawn(self, kind: str) -> Any:
        """The plot of a kind, once it is drawn."""
        self.page.locator(f"figure[data-kind={kind}]").first.scroll_into_view_if_needed()
        figure = self.page.locator(f"figure.drawn[data-kind={kind}]").first
        figure.wait_for(timeout=60_000)
        return figure


def test_on_a_phone_the_first_column_stays_beside_what_is_pulled(
    pages: dict[str, Path], driver: Any
) -> None:
    """Numbers of a wide table had been pulled away from what they are about."""
    with Opened(driver, pages["areas"], width=360) as opened:
        assert opened.page.evaluate("document.documentElement.scrollWidth") == 360
        pulled = opened.page.evaluate(
            "[...document.querySelectorAll('.scroll')].map(one => { one.scrollLeft = 9999;"
            "const cell = one.querySelector('tbody tr > *').getBoundingClientRect();"
            "return [one.scrollLeft, cell.left - one.getBoundingClientRect().left, cell.width]; })"
        )
        wide = [place for place in pulled if place[0] > 0]
        assert wide
        assert all(abs(left) < 1 and 40 < width < 0.5 * 360 for _, left, width in wide), wide


@pytest.mark.parametrize("name", ["areas", "planes", "grid", "info"])
def test_pages_ask_for_nothing_and_report_no_error(
    name: str, pages: dict[str, Path], driver: Any
) -> None:
    with Opened(driver, pages[name], *WEBGL) as opened:
        for kind in ("map", "space"):
            if opened.page.locator(f"figure[data-kind={kind}]").count():
                opened.drawn(kind)
        assert opened.errors == []
        outside = [url for url in opened.asked if not url.startswith(("data:", "blob:"))]
        assert outside == [pages[name].as_uri()]
    assert pages[name].stat().st_size < 8e6


def test_tables_sort_and_unfold(pages: dict[str, Path], driver: Any) -> None:
    with Opened(driver, pages["areas"]) as opened:
        table = opened.page.locator("section#polygons .table:not(.on-paper) table")
        rows = table.locator("tbody tr")
        assert rows.count() == 28
        assert table.locator("tbody tr:visible").count() == 10
        opened.page.locator("section#polygons .unfold").click()
        assert table.locator("tbody tr:visible").count() == 28
        heads = [text.strip() for text in table.locator("th").all_inner_texts()]
        column = next(k for k, text in enumerate(heads) if text.startswith("Area"))
        for order in ("ascending", "descending"):
            table.locator("th button").nth(column).click()
            texts = table.locator(f"tbody td:nth-child({column + 1})").all_inner_texts()
            numbers = [float(text) for text in texts]
            assert numbers == sorted(numbers, reverse=order == "descending")
            assert table.locator("th").nth(column).get_attribute("aria-sort") == order


def test_a_page_with_decimal_commas_sorts_its_numbers(driver: Any, tmp_path: Path) -> None:
    values = [2.61, 2.05, 10.5, 2.4]
    columns = {"width": Column("Width", "m", 2, circa={"unsure": frozenset({"top"})})}
    sides = ["", "top", "top", ""]
    rows = Rows(
        Table.from_rows(
            [{"width": w, "unsure": side} for w, side in zip(values, sides, strict=True)]
        ),
        columns=columns,
    )
    with language.speaking("tr"):
        (tmp_path / "a.html").write_text(Report("A", [Section("B", [rows])]).html(), "utf-8")
    with Opened(driver, tmp_path / "a.html") as opened:
        opened.page.locator("th button").first.click()
        texts = opened.page.locator("tbody td:first-child").all_inner_texts()
    assert texts == ["yak. 2,05", "2,40", "2,61", "yak. 10,50"]


def test_the_map_answers_clicks_and_shows_what_a_row_links_to(
    pages: dict[str, Path], driver: Any
) -> None:
    with Opened(driver, pages["areas"]) as opened:
        figure = opened.drawn("map")
        link = opened.page.locator("section#difference a.place").nth(3)
        row = (
            opened.page.locator("section#difference tbody tr")
            .nth(3)
            .locator("td")
            .all_inner_texts()
        )
        link.click()
        asked = figure.locator(".asked")
        assert row[1] in asked.inner_text()
        opened.page.evaluate("document.querySelector('.asked').hidden = true")
        box = figure.locator(".nsewdrag").first.bounding_box()
        opened.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        assert asked.is_visible()
        before = opened.page.evaluate("document.querySelector('.canvas').layout.xaxis.range")
        figure.get_by_role("button", name="Zoom in").click()
        opened.page.wait_for_timeout(300)
        after = opened.page.evaluate("document.querySelector('.canvas').layout.xaxis.range")
        assert after[1] - after[0] == pytest.approx((before[1] - before[0]) / 2)
        assert "m" in figure.locator(".bar").inner_text()


def colours(picture: bytes) -> int:
    import io

    from PIL import Image

    with Image.open(io.BytesIO(picture)) as image:
        return len(image.convert("RGB").quantize(64).getcolors() or [])


def test_the_view_in_space_draws_and_turns(pages: dict[str, Path], driver: Any) -> None:
    with Opened(driver, pages["planes"], *WEBGL) as opened:
        figure = opened.drawn("space")
        canvas = figure.locator(".gl-container canvas").first
        opened.page.wait_for_timeout(1000)
        first = canvas.screenshot()
        assert colours(first) > 5
        figure.get_by_role("application").focus()
        opened.page.keyboard.press("ArrowLeft")
        opened.page.wait_for_timeout(1000)
        assert canvas.screenshot() != first


def test_without_webgl_the_picture_stays(pages: dict[str, Path], driver: Any) -> None:
    with Opened(driver, pages["planes"], "--disable-3d-apis") as opened:
        figure = opened.page.locator("figure[data-kind=space]")
        figure.scroll_into_view_if_needed()
        opened.page.get_by_text("this browser cannot draw the plot").wait_for(timeout=30_000)
        assert figure.locator("> img").is_visible()
        assert opened.errors == []


@pytest.mark.parametrize("name", ["areas", "planes"])
def test_pages_fit_a_phone(name: str, pages: dict[str, Path], driver: Any) -> None:
    with Opened(driver, pages[name], *WEBGL, width=380) as opened:
        opened.drawn("map")
        opened.page.evaluate("document.querySelectorAll('details').forEach(it => it.open = true)")
        assert opened.page.evaluate("document.scrollingElement.scrollWidth") <= 380


def test_heads_of_tables_are_low_on_a_phone(pages: dict[str, Path], driver: Any) -> None:
    """One of 53 letters in a narrow column was 11 lines high, with nothing beside it."""
    with Opened(driver, pages["areas"], width=380) as opened:
        lines = opened.page.evaluate(
            "[...document.querySelectorAll('thead')].filter(one => one.offsetHeight)"
            ".map(one => one.offsetHeight / parseFloat(getComputedStyle(one).lineHeight))"
        )
        assert 0 < max(lines) < 6, lines


@pytest.mark.parametrize("width", [380, 700, 1200])
def test_the_legend_hides_nothing_of_the_map(width: int, driver: Any, tmp_path: Path) -> None:
    """It had lain over the upper right corner, where "Show all" did not help."""
    page = tmp_path / "page.html"
    areas = {"areas": squares([8.0, 9.0], 2), "reference": squares([8.0, 9.0], 0)}
    toolbox.run("compare.areas", {**areas, "page": page})
    with Opened(driver, page, width=width) as opened:
        figure = opened.drawn("map")
        figure.get_by_role("button", name="Show all").click()
        plot = figure.locator(".nsewdrag").first.bounding_box()
        legend = figure.locator(".legend").first.bounding_box()
        beside = legend["x"] >= plot["x"] + plot["width"]
        assert beside or legend["y"] >= plot["y"] + plot["height"], (plot, legend)
        assert legend["x"] + legend["width"] <= width
        assert plot["width"] > 0.5 * width


@pytest.mark.parametrize("writer", ["toolbox", "browser"])
def test_paper_holds_the_last_column_and_every_row(
    writer: str, pages: dict[str, Path], driver: Any, tmp_path: Path
) -> None:
    place = tmp_path / "page.pdf"
    if writer == "toolbox":
        sizes = [8.0 + k for k in range(14)]
        values = {"areas": squares(sizes, 2), "reference": squares(sizes, 0), "page": place}
        toolbox.run("compare.areas", values)
    else:
        with Opened(driver, pages["areas"]) as opened:
            opened.drawn("map")
            opened.page.pdf(path=place, prefer_css_page_size=True)
    text = subprocess.run(
        ["pdftotext", "-layout", place, "-"], capture_output=True, text=True, check=True
    ).stdout
    text_of_page = pages["areas"].read_text()
    last = text_of_page.partition('id="difference"')[2].partition("</tbody>")[0].count("<tr id=")
    assert last > 10
    longitudes = [word for word in text.split() if word.startswith(("26.99", "27.00"))]
    assert len(longitudes) >= last
    assert "Longitude" in text.replace("-\n", "")


@pytest.mark.parametrize("name", ["planes", "town"])
def test_paper_holds_all_columns_rows_and_settings_of_the_page(name: str, tmp_path: Path) -> None:
    """Every word of every table; what only a detail needs had been left to the page and files.

    Names of settings in the program are on the page alone: nobody types them on paper.
    """
    tool, given = {
        "planes": ("planes.extract", {"points": house()}),
        "town": ("models.urban_classes", {"points": house(), "smallest": 20.0}),
    }[name]
    page, paper = tmp_path / "page.html", tmp_path / "page.pdf"
    for place in (page, paper):
        toolbox.run(tool, {**given, "page": place})
    read = subprocess.run(["pdftotext", "-layout", paper, "-"], capture_output=True, check=True)
    printed = "".join(read.stdout.decode().split()).replace("-", "")
    cells = re.findall(r"<t[hd]\b[^>]*>(.*?)</t[hd]>", page.read_text("utf-8"), re.S)
    told = " ".join(html.unescape(re.sub(r"<[^>]*>", " ", cell)) for cell in cells)
    names = {"program", *catalog.load(tool).inputs}
    words = set(re.split(r"[\s\[\]]+", told.replace("-", ""))) - names
    assert len(words) > 100
    assert [word for word in sorted(words) if word not in printed] == []


def test_headings_stay_with_their_tables_on_paper_and_short_tables_whole(tmp_path: Path) -> None:
    """Whatever stands before them on the page; without the rules some of these lengths cut them."""

    def table(count: int) -> Rows:
        rows = [{"one": k + 0.5, "two": 2.5 * k} for k in range(count)]
        return Rows(Table.from_rows(rows), "A caption")

    place = tmp_path / "page.pdf"
    for count in range(36, 54):
        parts = [Section("First", [table(count)]), Section("Long", [table(40)])]
        Report("Paper", [*parts, Section("Short", [table(12)])]).save(place, overwrite=True)
        told = subprocess.run(["pdftotext", "-layout", place, "-"], capture_output=True, check=True)
        for title, least in (("Long", 1), ("Short", 12)):
            page = next(page for page in told.stdout.decode().split("\f") if title in page)
            after = page.partition(title)[2].splitlines()
            assert sum("." in line for line in after) >= least, (count, title)


def test_heads_of_wide_tables_stand_apart_on_paper(tmp_path: Path) -> None:
    """Of right-aligned heads, as Azimuth [°] and Span length [m], one could read one."""
    heads = {f"column {k}": "MMMMMMMMMMMMMMMM"[: 5 + k % 12] for k in range(24)}
    how = {name: Column(head) for name, head in heads.items()}
    table = Table.from_rows(dict.fromkeys(heads, 123456.5 + k) for k in range(8))
    place = tmp_path / "page.pdf"
    Report("Paper", [Section("Wide", [Rows(table, "", columns=how)])]).save(place)
    read = subprocess.run(["pdftotext", "-bbox", place, "-"], capture_output=True, check=True)
    words = re.findall(
        r'xMin="([\d.]+)" yMin="([\d.]+)" xMax="([\d.]+)" yMax="[\d.]+">M+-?<', read.stdout.decode()
    )
    lines: dict[str, list[tuple[float, float]]] = {}
    for left, top, right in words:
        lines.setdefault(top, []).append((float(left), float(right)))
    gaps = [b[0] - a[1] for line in lines.values() for a, b in itertools.pairwise(sorted(line))]
    assert len(gaps) > 10
    assert min(gaps) > 4.0, "points; a letter is some 4 wide"
