"""Tables, charts and texts of reports of data in feet are in feet, too."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from pyproj import CRS

from toolbox import catalog, language
from toolbox.data import PointCloud, Rows, Section, Table
from toolbox.data.reading import Reading
from toolbox.data.report import Column
from toolbox.declare.show import Axis, Curve, Histogram
from toolbox.reports.facts import chosen_settings
from toolbox.reports.page import Told, page
from toolbox.reports.units import drawn_in, in_both, in_unit, unit_of_data
from toolbox.runs.lineage import record_of

FOOT = ("ft", 0.3048)


def shown(frame: pd.DataFrame, **columns: Column) -> tuple[list[str], list[list[str]]]:
    """The headings with units and the cells of a table in feet."""
    (section,) = in_unit([Section("Table", [Rows(Table(frame), columns=columns)])], FOOT)
    (rows,) = section.blocks
    assert isinstance(rows, Rows)
    return [f"{how.heading} {how.unit}".strip() for how, _ in rows.headings], rows.cells


def test_lengths_areas_volumes_and_densities_of_a_table_are_in_feet() -> None:
    frame = pd.DataFrame(
        {"length": [0.3048], "area_m2": [92.90304], "volume_m3": [2.8316846592], "per": [0.04]}
    )
    columns = {"length": Column("Length", "m", 2), "per": Column("Density", "1/m²", 2)}
    headings, cells = shown(frame, **columns)
    assert headings == ["Length ft", "Area ft²", "Volume ft³", "Density 1/ft²"]
    assert cells == [["1.00", "1000.0", "100.0", "0.004"]]


def test_whole_numbers_of_metres_stay_in_metres() -> None:
    assert shown(pd.DataFrame({"reach_m": [3]})) == (["Reach m"], [["3"]])


def test_measures_have_the_unit_of_their_row_and_settings_stay() -> None:
    frame = pd.DataFrame(
        {
            "measure": ["bias", "count", "share"],
            "value": [0.3048, 7.0, 50.0],
            "unit": ["m", "1", "%"],
        }
    )
    _, cells = shown(frame)
    assert cells == [["bias", "1.000", "ft"], ["count", "7", ""], ["share", "50.00", "%"]]
    settings = pd.DataFrame({"setting": ["cell"], "value": ["1"], "unit": ["m"]})
    assert shown(settings)[1] == [["cell", "1", "m"]]


def test_bins_that_say_metres_and_their_bars_are_in_feet() -> None:
    frame = pd.DataFrame({"low": [0.0], "high": [0.3048], "count": [7], "unit": ["m"]})
    _, cells = shown(frame)
    assert [float(text) for text in cells[0][:3]] == [0.0, 1.0, 7.0]
    assert cells[0][3] == "ft"
    table, _ = drawn_in(Table(frame), [Histogram("low", "high", "count", "unit")], FOOT)
    assert table.frame["high"].tolist() == [1.0]
    assert drawn_in(Table(frame), [], None)[0].frame["high"].tolist() == [0.3048]


@pytest.mark.parametrize(
    ("axis", "unit", "factor"),
    [
        (Axis("volume", "volume", "m³"), "ft³", 0.3048**-3),
        (Axis("tolerance", "tolerance", "cm", factor=100), "ft", 1 / 0.3048),
        (Axis("level", "level", unit_in="unit"), "", 1.0),
        (Axis("share", "share", "%"), "%", 1.0),
    ],
)
def test_axes_of_curves_are_in_feet(axis: Axis, unit: str, factor: float) -> None:
    table = Table(pd.DataFrame({"level": [1.0]}))
    _, (made,) = drawn_in(table, [Curve(Axis("level", "level"), (axis,))], FOOT)
    assert isinstance(made, Curve)
    assert made.lines[0].unit == unit
    assert made.lines[0].factor == pytest.approx(factor)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("waves of 0.10 m", "waves of 0.10 m (0.328 ft)"),
        ("about 100 m2 at 5,7.5: level", "about 100 m2 (1076 ft²) at 5,7.5: level"),
        ("holds 28.3 m3.", "holds 28.3 m3 (999 ft³)."),
        ("0.68 m (2.23 ft) apart, 2 m/s", "0.68 m (2.23 ft) apart, 2 m/s"),
        ("2.2 per m2 (0.201/ft²)", "2.2 per m2 (0.201/ft²)"),
        ("0.40 m (95 %)", "0.40 m (1.31 ft) (95 %)"),
        ("3 of 40 m2", "3 of 40 m2 (32.3 of 431 ft²)"),
        ("206 of 1441 m of its outline", "206 of 1441 m (676 of 4728 ft) of its outline"),
        ("mean -0.305 m, \u22123.048 m", "mean -0.305 m (-1.00 ft), \u22123.048 m (-10.00 ft)"),
        ("1e-05 m, 10^3 m, 10^-3 m, 2-3 m", "1e-05 m, 10^3 m, 10^-3 m, 2-3 m"),
        ("3.1 to 12.5 m wide", "3.1 to 12.5 m (10.2 to 41.0 ft) wide"),
        ("-1 - 2 m2", "-1 - 2 m2 (-10.8 - 21.5 ft²)"),
        ("-1 to 2 m (-3 to 7 ft)", "-1 to 2 m (-3 to 7 ft)"),
        ("level 562.123 m", "level 562.123 m (1844.24 ft)"),
        ("Files are in metres, 1 m = 3.2808 ft.", "Files are in metres, 1 m = 3.2808 ft."),
    ],
)
def test_sizes_in_texts_are_told_in_both_units_once(text: str, said: str) -> None:
    assert in_both(text, FOOT) == said
    assert in_both(text, None) == text


def test_texts_in_both_units_are_in_the_language_of_the_user() -> None:
    text = "water body 3: 51 m of 265 m of its outline is the edge of the data, not a shore"
    with language.speaking("tr"):
        said = in_both(text, FOOT)
        assert said != text
        assert "265 m (869 ft)" in said
        assert language.told(said) == said


def test_a_height_in_feet_is_shown_once() -> None:
    frame = pd.DataFrame({"level": [10.0], "unit": ["foot"], "level_m": [3.048], "wide": ["yes"]})
    columns = {"level": Column("Level in its unit"), "level_m": Column("Level", "m", 3)}
    assert shown(frame, **columns) == (["Level ft", "Wide"], [["10.000", "yes"]])


def test_own_columns_of_people_stay_whatever_their_names_end_in() -> None:
    frame = pd.DataFrame({"dist": [7.0], "dist_m": [99.0]})
    assert len(shown(frame)[0]) == 2
    assert len(shown(pd.DataFrame({"elev": [500.5], "elev_m": [152]}))[0]) == 2


def test_whole_measures_of_a_row_are_in_its_unit() -> None:
    frame = pd.DataFrame({"value": [3, 9], "low": [1.0, 2.0], "unit": ["m", "1"]})
    assert shown(frame)[1] == [["9.843", "3.281", "ft"], ["9.0", "2.0", ""]]


def test_heights_in_another_unit_than_lengths_leave_tables_in_metres() -> None:
    xyz = np.zeros((1, 3))
    for mixed in ("EPSG:32610+6360", "EPSG:2263+5703"):  # heights in feet, heights in metres
        assert unit_of_data([PointCloud(xyz, crs=CRS(mixed))]) is None
    assert unit_of_data([PointCloud(xyz, crs=CRS(32610))]) is None
    assert unit_of_data([PointCloud(xyz, crs=CRS(2263))]) == ("US ft", pytest.approx(1200 / 3937))


def test_a_page_of_data_in_feet_has_its_results_in_feet() -> None:
    points = PointCloud(np.zeros((1, 3)), crs=CRS(2222))
    spec = catalog.load("points.survey_quality")
    area, water = catalog.load("shoreline.alpha_shape"), {"area": 100 * 123 * 0.3048**2}
    report = page(area, water, None, Told(given={"points": points}))
    (rows,) = next(part.blocks for part in report.sections if part.title == "Results")
    assert rows.cells[0][1:] == ["12300.00", "ft²"], "not of whole square metres"
    report = page(spec, {"spacing": 0.6096}, None, Told(given={"points": points}))
    (rows,) = next(part.blocks for part in report.sections if part.title == "Results")
    assert isinstance(rows, Rows)
    assert rows.cells == [["Spacing of pulses", "2.000", "ft"]]


def test_settings_in_the_unit_of_the_data_and_rules_by_their_titles() -> None:
    spec = catalog.load("corridor.clearance")
    feet = [PointCloud(np.zeros((1, 3)), crs=CRS(2222))]
    made = record_of(spec, {"distance": 3.048}, {}, Reading())
    assert "10 ft (3.048 m)" in chosen_settings(spec, made, feet)
    made = record_of(spec, {"rules": "ch_lev", "voltage": 110.0}, {}, Reading())
    assert "Rule set LeV of Switzerland (ch_lev)" in chosen_settings(spec, made)
