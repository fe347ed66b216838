"""Tables of reports of data in feet are in feet."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from pyproj import CRS

from toolbox import catalog
from toolbox.data import PointCloud, Rows, Section, Table
from toolbox.data.reading import Reading
from toolbox.data.report import Column
from toolbox.reports.facts import chosen_settings
from toolbox.reports.page import Told, page
from toolbox.reports.units import in_unit, unit_of_data
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
    assert "3.048 m (10 ft)" in chosen_settings(spec, made, feet)
    made = record_of(spec, {"rules": "ch_lev", "voltage": 110.0}, {}, Reading())
    assert "Rule set LeV of Switzerland (ch_lev)" in chosen_settings(spec, made)
