"""The page of a run shows its numbers, tables, maps and how it was made."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import toolbox
from algorithms.surface.difference import SurfaceDifference
from toolbox import catalog
from toolbox.cli.replay import replay
from toolbox.data import Figure, Lattice, PointCloud, Raster, Report, Rows, Section, Table
from toolbox.data.crs import parse_crs
from toolbox.data.report import Plot
from toolbox.data.report.render import render
from toolbox.reports.page import Told, in_order, page, said
from toolbox.runs import target
from toolbox.tiles import overview
from toolbox.tiles.tiling import Tiling


@pytest.fixture
def points(tmp_path: Path) -> Path:
    rng = np.random.default_rng(1)
    xyz = np.column_stack([rng.uniform(0, 50, (3000, 2)) + 500_000, rng.uniform(0, 1, 3000)])
    classes = {"classification": rng.integers(1, 3, 3000)}
    PointCloud(xyz, classes, crs=parse_crs("EPSG:32635")).save(tmp_path / "a.laz")
    return tmp_path / "a.laz"


@pytest.mark.slow
def test_page_of_numbers_and_tables(points: Path) -> None:
    values = {"points": points, "reference": points, "positive": "2"}
    place = points.with_suffix(".html")
    written = toolbox.run("compare.classes", {**values, "page": place})
    assert written["page"] == place
    text = place.read_text()
    assert 'Agreement beyond chance (Cohen)</td><td class="number">1</td>' in text
    assert "<h2>Confusion matrix</h2>" in text
    assert "points: a.laz" in text
    assert replay(place) == []


@pytest.mark.slow
def test_page_with_a_map(points: Path) -> None:
    place = points.with_suffix(".html")
    toolbox.run("surface.grid", {"points": points, "page": place})
    text = place.read_text()
    assert text.count('<figure class="plot"') == text.count("<img src=") == 2
    assert text.count('<td class="number">50</td>') == 2  # rows and columns


def test_rasters_are_told_with_their_range_and_empty_cells() -> None:
    values = np.array([[1.0, 4.0], [np.nan, 2.0]])
    lattice = Lattice(500_000.0, 4_000_000.0, 0.5, 2, 2)
    raster = Raster.from_lattice(values, lattice, crs=parse_crs("EPSG:32635"), units=["metre"])
    spec = catalog.load("surface.grid")
    report = page(spec, {"surface": raster}, None)
    (rows,) = next(part.blocks for part in report.sections if part.title == "Rasters")
    assert isinstance(rows, Rows)
    assert rows.cells[0][2:] == ["0.50", "2", "2", "m", "1.00", "4.00", "25.0"]
    assert "EPSG:32635" in rows.caption


def test_points_of_each_class_are_counted_before_and_after() -> None:
    xyz = np.zeros((4, 3))
    before = PointCloud(xyz, {"classification": np.array([1, 1, 1, 6])}, crs=None)
    after = PointCloud(xyz, {"classification": np.array([1, 2, 2, 2])}, crs=None)
    spec = catalog.load("ground.classify")
    report = page(spec, {"classified": after}, None, Told(given={"points": before}))
    (rows,) = next(part.blocks for part in report.sections if part.title == "Points by class")
    assert isinstance(rows, Rows)
    assert rows.cells == [
        ["1", "Unclassified", "3", "1", "25.0"],
        ["2", "Ground", "0", "3", "75.0"],
        ["6", "Building", "1", "0", "0.0"],
    ]


def test_points_that_nobody_classified_are_in_no_table_of_classes() -> None:
    """The report on a façade said that 54864 points before and after were never classified."""
    scan = PointCloud(np.zeros((4, 3)), {"classification": np.zeros(4, np.uint8)}, crs=None)
    spec = catalog.load("ground.classify")
    report = page(spec, {"classified": scan}, None, Told(given={"points": scan}))
    assert "Points by class" not in [part.title for part in report.sections]


def test_classes_that_are_given_up_are_told_with_what_became_of_their_points() -> None:
    """Bridges of class 26 became ground, and only the console said a word."""
    xyz = np.arange(15.0).reshape(5, 3)
    before = PointCloud(xyz, {"classification": np.array([1, 26, 26, 26, 6])}, crs=None)
    after = PointCloud(xyz, {"classification": np.array([1, 2, 2, 5, 6])}, crs=None)
    spec = catalog.load("ground.classify")
    gone = (
        "Classes of the input that no point has any more: "
        "26 (Bridges and quays in Dutch surveys, points: 3"
    )
    for given, told in ((before, ", now 2 Ground, 1 High vegetation)."), (after, None)):
        _, head = said(spec, {"classified": after}, None, Told(given={"points": given}))
        assert list(head.unseen) == ([gone + told] if told else [])
    tiles = {"points": Counter({1: 1, 26: 3, 6: 1}), "classified": Counter({1: 1, 2: 3, 6: 1})}
    _, head = said(spec, {"classified": None}, None, Told(by_class=tiles))
    assert list(head.unseen) == [gone + ")."], "in tiles it is not known what they are now"


def test_of_a_part_of_the_points_no_numbers_of_before_are_told() -> None:
    before = PointCloud(np.zeros((3, 3)), {"classification": np.array([1, 1, 6])}, crs=None)
    spec = catalog.load("ground.classify")
    part = before.select(np.array([2]))
    report = page(spec, {"classified": part}, None, Told(given={"points": before}))
    (rows,) = next(one.blocks for one in report.sections if one.title == "Points by class")
    assert isinstance(rows, Rows)
    assert list(rows.shown) == ["Class", "Name", "Count", "Share"]
    assert rows.cells == [["6", "Building", "1", "100.0"]]


@pytest.mark.slow
def test_counts_of_all_steps(points: Path) -> None:
    place = points.with_suffix(".gpkg")
    values = {
        "points": points,
        "counts": {"path": place, "layer": "stages"},
        "denoise": False,
    }
    dtm = points.with_name("dtm.tif")
    toolbox.run("models.terrain", {**values, "image": False, "max_gap": 6.0})
    rows = Table.open(place, layer="stages").frame
    assert rows.columns.to_list() == ["step", "name", "count"]
    assert rows.iloc[0].to_list() == ["ground", "points", 3000]
    assert rows["step"].unique().tolist() == ["ground", "top", "bottom", "heights"]
    assert replay(place) == []
    tiled = points.with_suffix(".csv")
    tiling = Tiling.parse({"tile": "40", "workers": "1"})
    toolbox.run(
        "models.terrain",
        {**values, "image": False, "max_gap": 6.0, "counts": tiled, "dtm": dtm},
        tiling=tiling,
    )
    made = Table.open(tiled).frame
    assert made["step"].unique().tolist() == ["ground", "top", "bottom"]  # those that lead to it
    assert made.merge(rows, how="left", indicator=True)["_merge"].eq("both").all()


def test_labels_are_headings_of_results() -> None:
    spec = catalog.load("shoreline.storage_curve")
    curve = Table.from_rows(
        [
            {"level": float(k), "unit": "metre", "level_m": float(k), "area_m2": k * 1e3}
            for k in range(4)
        ]
    )
    titles = [section.title for section in page(spec, {"curve": curve}, None).sections]
    assert "Storage curve" in titles
    assert "Curve" not in titles


def test_on_paper_all_rasters_of_a_map_are_shown() -> None:
    rng = np.random.default_rng(1)
    lattice = Lattice(500_000.0, 4_600_000.0, 1.0, 20, 30)
    crs = parse_crs("EPSG:32635")
    surface, base = (
        Raster.from_lattice(rng.normal(9, 1, (20, 30)), lattice, crs=crs) for _ in "ab"
    )
    found = vars(SurfaceDifference(surface=surface, base=base).run())
    told = Told(given={"surface": surface, "base": base})
    report = page(catalog.load("surface.difference"), found, None, told)
    paper = render(report, style=None, logo=None, on_paper=True)
    assert paper.count('<figure class="other">') == 2
    for name in ("Surface (input)", "Base (input)"):
        assert f"<figcaption>{name}</figcaption>" in paper
    assert '<figure class="other">' not in report.html()


@pytest.mark.slow
def test_a_report_of_tiles_shows_points_and_rasters_and_says_what_the_whole_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The points on the page are few, and the same whatever the tiles."""
    monkeypatch.setattr(overview, "MOST_POINTS", 3000)
    monkeypatch.setattr(overview, "MOST_CELLS", 50)
    rng = np.random.default_rng(1)
    xyz = np.column_stack([rng.uniform(0, 120, (9000, 2)) + 500_000, rng.normal(50, 0.02, 9000)])
    xyz[:2, 2] = 90.0, 20.0
    more = {
        "gps_time": np.full(len(xyz), 306_288_000.0),
        "intensity": rng.integers(1, 99, len(xyz)),
    }
    PointCloud(xyz, more, crs=parse_crs("EPSG:32635")).save(tmp_path / "a.laz")
    seen: dict[str, list[Told]] = {}

    def shown(name: str, tile: str | None, **outputs: Path) -> str:
        def noted(*given: Any) -> Report:
            seen.setdefault(name, []).append(given[3])
            return page(*given)

        monkeypatch.setattr(target, "page", noted)
        place = tmp_path / f"{name}.html"
        values = {"points": tmp_path / "a.laz", "page": place, **outputs}
        tiling = Tiling.parse({"tile": tile, "workers": "1"}) if tile else None
        toolbox.run("models.terrain", values, tiling=tiling)
        return place.read_text()

    out = {"dtm": tmp_path / "dtm.tif", "classified": tmp_path / "c.laz"}
    tiled = shown("tiled", "40", **out)
    other = {name: path.with_stem(f"{path.stem}2") for name, path in out.items()}
    text = shown("other", "60", **other)
    whole = shown("whole", None, **{n: path.with_stem(f"{path.stem}4") for n, path in out.items()})
    assert "2 points were taken for noise: 1 low, 1 high." in whole
    for page_text in (tiled, text, whole):
        assert "<dt>Date of the survey</dt><dd>2021-05-29</dd>" in page_text
    assert "Rasters have cells of 1 m. Terrain (DTM) from 49.94 to 50.07 m, 0.4 % of its" in whole
    assert "tile by tile" not in tiled
    said = [html.partition('id="summary"')[2].partition("</section>")[0] for html in (tiled, whole)]
    assert said[0] == said[1]
    one, two = (dict[str, Any](seen[name][0].thinned) for name in ("tiled", "other"))
    assert one.keys() == two.keys() == {"dtm", "classified"}
    few, same = (np.unique(layers["classified"].xyz, axis=0) for layers in (one, two))
    assert 2500 < len(few) < 3500
    np.testing.assert_array_equal(few, same)
    assert max(one["dtm"].shape) <= 50
    assert one["dtm"].bounds[0] == Raster.open(out["dtm"]).bounds[0]
    assert tiled.count('data-kind="space"') == 1
    tables = [
        [
            html.partition(f"<h2>{name}</h2>")[2].partition("</section>")[0]
            for html in (tiled, whole)
        ]
        for name in ("Rasters", "Points by class")
    ]
    assert "dtm.tif</td>" in tables[0][0]
    numbers = [re.findall(r'class="number">([^<]*)<', text) for text in tables[1]]
    assert numbers[0] == numbers[1] != []
    dtm = [re.findall(r">Terrain \(DTM\)</td>.*?</tr>", text, re.S)[0] for text in tables[0]]
    one_row, all_rows = (re.findall(r'class="number">([^<]*)<', text) for text in dtm)
    assert one_row[-3:] == all_rows[-3:] == ["49.94", "50.07", "0.4"], "lowest, highest, empty"
    alone = shown("alone", "40", dtm=tmp_path / "dtm3.tif")
    assert seen["alone"][0].thinned.keys() == {"points", "dtm"}
    assert alone.count('data-kind="space"') == 1


def test_a_map_that_is_a_strip_stands_after_the_drawings() -> None:
    def plot(title: str, *bounds: float) -> Section:
        return Section(title, [Plot("map", {"bounds": bounds}, Figure(b"", ""))])

    strip, wide = plot("Map", 0, 0, 2, 20), plot("Map", 0, 0, 12, 20)
    others = [plot("3-D view"), plot("Drawing: front", 0, 0, 20, 10)]
    assert in_order([strip, *others]) == [*others, strip]
    assert in_order([wide, *others]) == [wide, *others]
    assert in_order([strip, others[0]]) == [strip, others[0]]
    assert in_order([]) == []


def test_what_a_warning_says_is_not_said_again_of_what_was_not_looked_at() -> None:
    told = Told(
        warnings=["1.1 % of the area has no ground, and holds nothing"],
        unseen=[
            "1.1 % of the area has no ground, and holds nothing in these figures.",
            "Voids are counted whether they are water or not.",
        ],
    )
    report = page(catalog.load("surface.grid"), {}, None, told)
    assert list(report.head.unseen) == ["Voids are counted whether they are water or not."]


def test_what_a_warning_says_is_not_said_again_in_the_result() -> None:
    """Clearances of kinds without a rule stood twice on the first page."""
    spec = catalog.load("points.filter")
    report = Report("Line", [], summary="Spans: 2.\nNear a wire: tree 0.22 m.\nPoints: 5.")
    told = Told(warnings=["near a wire: tree 0.22 m"])
    summary, head = said(spec, {"report": report}, None, told)
    assert summary == "Spans: 2. Points: 5."
    assert list(head.warnings) == ["near a wire: tree 0.22 m"]


def test_the_finding_stands_before_what_was_processed() -> None:
    """Steps whose results are the first of a model speak first; those that prepare come last."""
    spec = catalog.load("models.facade")
    told = Told(words=[("planes", "9 planes."), ("none", "Prepared."), ("gaps", "Openings: 4.")])
    summary, _ = said(spec, {}, None, told)
    assert summary == "Openings: 4. 9 planes. Prepared."


def test_what_a_later_step_decides_anew_is_not_said() -> None:
    """The share of ground before water was found stood beside that after it."""
    told = Told(words=[("clean", "Noise."), ("ground", "42 % ground."), ("rest", "41 % ground.")])
    summary, _ = said(catalog.load("models.urban_classes"), {}, None, told)
    assert summary == "41 % ground. Noise."


def test_maps_stand_before_counts_of_points_and_numbers() -> None:
    xyz = np.random.default_rng(1).uniform(0, 20, (200, 3))
    points = PointCloud(
        xyz, {"classification": np.full(200, 2, np.uint8)}, crs=parse_crs("EPSG:32635")
    )
    found = {"classified": points, "ground_share": 1.0}
    told = Told(given={"points": points})
    titles = [
        part.title for part in page(catalog.load("ground.classify"), found, None, told).sections
    ]
    assert titles[0] == "Map"
    assert titles.index("Map") < titles.index("Points by class") < titles.index("Results")
