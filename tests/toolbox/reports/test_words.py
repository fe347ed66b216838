"""What reports say in words: results, settings, the head, and what was not looked at."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely

import toolbox
from toolbox import catalog
from toolbox.cli.main import main
from toolbox.cli.replay import replay
from toolbox.data import PointCloud, Rows, Table, Vector
from toolbox.data.crs import parse_crs
from toolbox.data.reading import Reading
from toolbox.data.report import Column
from toolbox.declare.kinds import parsed_options
from toolbox.reports import words
from toolbox.reports.facts import chosen_settings, default_settings, facts_of
from toolbox.reports.page import page
from toolbox.runs.lineage import record_of
from toolbox.runs.provenance import Input

CRS = parse_crs("EPSG:28992+5709")
SECONDS = 1.0e9  # adjusted standard GPS time is less by so many


def gps(day: date) -> float:
    """Adjusted standard GPS time of noon on a day."""
    return (day - date(1980, 1, 6)).days * 86400.0 + 43200.0 - SECONDS


def cloud(times: np.ndarray | None = None) -> PointCloud:
    xyz = np.random.default_rng(1).uniform(0, 50, (400, 3)) + np.array([1e5, 4e5, 0])
    return PointCloud(xyz, {} if times is None else {"gps_time": times}, crs=CRS)


def facts(tmp_path: Path, points: PointCloud, **options: object) -> dict[str, str]:
    points.save(tmp_path / "a.laz")
    place = tmp_path / "a.html"
    toolbox.run("surface.grid", {"points": tmp_path / "a.laz", "page": {"path": place, **options}})
    text = place.read_text().partition('<dl class="facts">')[2].partition("</dl>")[0]
    cells = [part.partition("</d")[0] for part in text.replace("<dd>", "<dt>").split("<dt>")[1:]]
    return dict(zip(cells[::2], cells[1::2], strict=True))


@pytest.mark.slow
def test_the_head_tells_project_survey_and_reference_system(tmp_path: Path) -> None:
    times = np.linspace(gps(date(2021, 5, 27)), gps(date(2021, 5, 28)), 400)
    project = {"client": "City", "fields": {"Contract": "7 < 8"}, "date": "2026-01-02"}
    found = facts(tmp_path, cloud(times), title="Terrain of the city", **project)
    assert found["Client"] == "City"
    assert found["Contract"] == "7 &lt; 8"
    assert found["Date of the report"] == "2026-01-02"
    assert found["Date of the survey"] == "2021-05-27 to 2021-05-28"
    assert found["Coordinates"].startswith("EPSG:28992+5709")
    assert found["Heights"] == "NAP height"
    assert found["Input"] == "Points: a.laz"
    assert "Settings" not in found, "none was given"
    assert found["Defaults used"] == "Cell size 1 m"
    text = (tmp_path / "a.html").read_text()
    assert "<h1>Terrain of the city</h1>" in text
    assert replay(tmp_path / "a.html") == []


@pytest.mark.parametrize("assumed", ["", "EPSG:28992+5709"])
def test_a_crs_that_was_given_by_hand_is_told(assumed: str) -> None:
    spec = catalog.load("surface.grid")
    record = replace(record_of(spec, {}, {}, Reading()), assume_crs=assumed)
    assert ("Given by hand" in dict(facts_of(spec, {}, record, {}))) == bool(assumed)


def test_rules_are_not_told_where_one_distance_stands_in_their_place() -> None:
    spec = catalog.load("corridor.clearance")
    made = record_of(spec, {"voltage": 110.0}, {}, Reading())
    assert "Rule set" in default_settings(spec, made)
    made = record_of(spec, {"voltage": 110.0, "distance": 5.0}, {}, Reading())
    assert "Rule set" not in chosen_settings(spec, made) + default_settings(spec, made)
    assert "5 m" in chosen_settings(spec, made)


def test_settings_that_nobody_gave_are_told_apart() -> None:
    """Settings "other than the defaults" named cell and interval at their defaults."""
    spec = catalog.load("models.terrain")
    optional = {name: field for name, field in spec.inputs.items() if not field.required}
    values = {name: field.to_json(field.default) for name, field in optional.items()}
    values |= {"cell": 0.5, "level_water": True}
    made = replace(record_of(spec, {}, {}, Reading()), parameters=values)
    assert chosen_settings(spec, made, (), {"level_water"}) == "Cell size 0.5 m"
    assert chosen_settings(spec, made).endswith("Water laid level yes")
    told = default_settings(spec, made, (), {"level_water"})
    assert told == "Water laid level yes; Height between lines 1 m"
    found = dict(facts_of(spec, {}, made, {}, {"level_water"}))
    assert found["Settings"] == "Cell size 0.5 m"
    assert found["Defaults used"] == told


def test_a_rule_set_that_was_not_used_is_said_so() -> None:
    """Papers named the rule set of the defaults where a distance or a table took its place."""
    spec = catalog.load("models.power_line_clearance")
    values = {name: field.default for name, field in spec.inputs.items() if not field.required}
    made = replace(record_of(spec, {}, {}, Reading()), parameters=values)
    for record in (
        replace(made, parameters=values | {"distance": 5.0}),
        replace(made, inputs={"rule_table": (Input("own.csv", "a", 1),)}),
    ):
        sections = {section.title: section for section in page(spec, {}, record).sections}
        (table,) = sections["Settings"].blocks
        shown = table.table.frame.set_index("Setting")["Value"]
        other = "Distance" if record.parameters["distance"] else "Own rules"
        assert shown["Rule set"] == f"not used: {other} is given in its place"
        (printed,) = sections["Settings"].printed
        assert "Name in the program" not in printed.table.frame, "on paper"


@pytest.mark.slow
@pytest.mark.parametrize("times", [None, np.linspace(100.0, 600.0, 400)])
def test_a_survey_that_does_not_tell_its_date_is_said_so(
    times: np.ndarray | None, tmp_path: Path
) -> None:
    """Seconds of a week do not tell which week."""
    assert facts(tmp_path, cloud(times))["Date of the survey"].startswith("not known")


@pytest.mark.slow
def test_style_and_logo_do_not_change_what_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1767225600")
    (tmp_path / "own.css").write_text(":root { --accent: #7a1f3d; } </style><b>")
    (tmp_path / "logo.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    looks = {"style": tmp_path / "own.css", "logo": tmp_path / "logo.svg"}
    assert facts(tmp_path, cloud(), **looks)["Date of the report"] == "2026-01-01"
    text = (tmp_path / "a.html").read_text()
    assert "--accent: #7a1f3d; } <\\/style>" in text
    assert '<img class="logo" src="data:image/svg+xml;base64,' in text
    assert replay(tmp_path / "a.html") == []


def test_project_words_need_a_report(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "surface.grid", "--points", "a.laz", "--title", "A"]) == 2
    assert "title: is for a report, and none is written" in capsys.readouterr().err


@pytest.mark.parametrize("date", ["2026-11-14", "14/11/2026", "November 2026", "2026"])
def test_a_date_is_kept_as_it_is_written(date: str) -> None:
    assert parsed_options({"date": date}, ("date",)) == {"date": date}


@pytest.mark.parametrize("date", ["31.12.2026", "31-12-2026", "2026/12/31"])
def test_a_date_that_all_read_alike_is_written_as_all_others(date: str) -> None:
    """A report had 31.12.2026 at its head, and 2026-12-31 everywhere else."""
    assert parsed_options({"date": date}, ("date",)) == {"date": "2026-12-31"}


@pytest.mark.parametrize("date", ["99/99", "2026-13-01", "30.02.2026", "14"])
def test_figures_that_are_no_date_are_refused(date: str) -> None:
    with pytest.raises(ValueError, match=f"option date: must be a date, such as .* got '{date}'"):
        parsed_options({"date": date}, ("date",))


def test_every_warning_of_a_run_is_on_its_report(tmp_path: Path) -> None:
    """Also where the command line is told to be quiet."""
    points = cloud().with_crs(parse_crs("local"))
    points.save(tmp_path / "a.csv")
    place = tmp_path / "a.html"
    said = ["--points", str(tmp_path / "a.csv"), "--assume-crs", "local", "--page", str(place)]
    assert main(["run", "shoreline.extract", *said, "--quiet"]) == 0
    warned = place.read_text().partition('id="warnings"')[2].partition("</ul>")[0]
    assert "No water was found" in warned


def test_numbers_are_made_a_sentence_where_a_tool_says_none() -> None:
    spec = catalog.load("compare.planes")
    found = {"count": 3} if "count" in spec.outputs else {}
    made = page(spec, found, None)
    assert made.summary.endswith(".")
    assert all(str(value) in made.summary for value in found.values())


def test_what_was_not_looked_at_is_told_by_the_outputs() -> None:
    outputs = catalog.load("shoreline.extract").make.Outputs
    row = {
        "body": 1,
        "open_length": 40.0,
        "perimeter": 100.0,
        "hidden_area": 0.0,
        "evidence": "few returns, dark",
        "returned": 0.1,
        "darkness": 0.9,
        "scatter": 0.02,
    }
    row |= {"area_error": 10.0, "level": 3.5, "level_interval": 0.02, "slope": 0.0}
    row |= {"geometry": shapely.Point(0, 0)}
    water = Vector(geopandas.GeoDataFrame([row], geometry="geometry", crs=CRS))
    numbers = {"level": 3.5, "level_error": 0.01, "level_interval": 0.02, "area": 900.0, "count": 1}
    numbers |= {"detail": 1.0, "least_area": 250.0, "narrowest": 2.7}
    layers = dict.fromkeys(
        ("water", "shoreline", "vertices", "other_waters", "other_bodies"), water
    )
    made = outputs(**layers, **numbers)
    assert made.in_words() == (
        "One water body of 900 m² in all, 20 m² more or less, without what lies below "
        "bridges, jetties and boats; its level is 3.500 m, ± 0.020 m within the survey (95 % "
        "intervals); an error that all of its heights have in common comes "
        "on top."
    )
    water = Vector(water.frame.assign(level_interval=0.0002))
    exact = outputs(**{**layers, "water": water}, **numbers)
    assert "3.500 m, ± 0.001 m within" in exact.in_words(), "not 0.000"
    small, hidden, unseen = made.not_looked_at()
    assert small.startswith("Waters of less than 250 m²")
    assert "narrower than 2.7 m" in small
    assert "below bridges, decks and wide woods, and behind jetties and moored boats" in hidden
    assert "40 m of 100 m of its outline is the edge of the data" in unseen


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(0.25, "1", "0.25"), (-0.2597, "m", "-0.260"), (102431.4, "m2", "102431"), (7, "1", "7")],
)
def test_values_have_digits_that_tell_something(value: float, unit: str, text: str) -> None:
    assert words.value_text(value, unit) == text


def test_whole_numbers_of_which_one_is_missing_stay_whole() -> None:
    """Numbers of planes were 1.000 beside an opening that has none."""
    table = Table.from_rows([{"plane": 1, "size": 2.5}, {"plane": None, "size": None}])
    assert Rows(table).cells == [["1", "2.500"], ["", ""]]


def test_limits_of_a_column_are_shown_like_it() -> None:
    """Shares in percent stood in reports without a unit, and beside others that had one."""
    names = ["f1", "f1_low", "f1_block_high", "overlap_%", "own_low"]
    table = Table.from_rows([dict.fromkeys(names, 87.654)])
    rows = Rows(table, columns={"f1": Column("F1", "%", 1)})
    assert [(column.heading, column.unit) for column, _ in rows.headings] == [
        ("F1", "%"),
        ("F1, lower limit (95 %)", "%"),
        ("F1, upper limit by blocks (95 %)", "%"),
        ("Overlap", "%"),
        ("Own low", ""),
    ]
    assert rows.cells[0][1] == "87.7"


def test_columns_are_shown_as_declared() -> None:
    table = Table.from_rows([{"clearance": 1.2345, "seen": 0.5, "cov": 3.0, "gone": None}])
    columns = {
        "clearance": Column("Clearance", "m", 2),
        "seen": Column("Seen", "%", 0, 100.0),
        "cov": Column(""),
    }
    rows = Rows(table, columns=columns)
    assert [column.heading for column, _ in rows.headings] == ["Clearance", "Seen"]
    assert rows.cells == [["1.23", "50"]]


def test_features_are_listed_with_places_in_both_systems() -> None:
    frame = geopandas.GeoDataFrame({"n": [1]}, geometry=[shapely.Point(155000, 463000, 5)], crs=CRS)
    (row,) = Vector(frame).listed().rows()
    assert (row["easting"], row["northing"], row["elevation"]) == (155000, 463000, 5)
    assert row["latitude"] == pytest.approx(52.15517, abs=1e-4)  # the tower of Amersfoort
    assert row["longitude"] == pytest.approx(5.38721, abs=1e-4)
