"""Fronts as IFC4: valid, where they are, as large as they are, with openings of the size told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely

from toolbox import language
from toolbox.data import Vector
from toolbox.data.crs import parse_crs
from toolbox.errors import DataError

ifcopenshell = pytest.importorskip("ifcopenshell")
FOOT = 0.3048


def elevation(unit: str = "local", metre: float = 1.0) -> Vector:
    """A wall of 10 m by 6 m that looks south, and one that looks east, with a door and a window."""
    door, window = shapely.box(1, 0, 2, 2.1), shapely.box(24, 1, 25.5, 2.5)
    south = shapely.box(0, 0, 10, 6).difference(door)
    east = shapely.box(20, 0, 26, 6).difference(window)
    names = [f"{name}_{axis}" for name in ("corner", "right", "up") for axis in "xyz"]
    # the place of (0, 0): the second front begins at 20 in the elevation, at y = 0 in space
    first = (500.25 * metre, 400.0 * metre, 100.0 * metre, 1, 0, 0, 0, 0, 1)
    second = (510.25 * metre, (400.0 - 20) * metre, 100.0 * metre, 0, 1, 0, 0, 0, 1)
    size = {"set_back": 0.1 * metre, "certainty": 0.9, "hidden": "left", "unsure": "top"}
    rows: list[dict[str, Any]] = [
        {"kind": "facade", "front_id": 1, "opening_id": 0, **dict(zip(names, first, strict=True))},
        {"kind": "facade", "front_id": 2, "opening_id": 0, **dict(zip(names, second, strict=True))},
        {"kind": "door", "front_id": 1, "opening_id": 1, "width": metre, "height": 2.1 * metre}
        | {"sill": 0.0, **size},
        {"kind": "window", "front_id": 2, "opening_id": 2, "width": 1.5 * metre}
        | {"height": 1.5 * metre, "sill": metre, **size},
    ]
    shapes = [shapely.transform(s, lambda xy: xy * metre) for s in (south, east, door, window)]
    return Vector(geopandas.GeoDataFrame(rows, geometry=shapes, crs=parse_crs(unit)))


def written(layer: Vector, path: Path) -> Any:
    layer.save(path, record=json.dumps({"lidar-toolbox": 1}))
    return ifcopenshell.open(path)


def corners(model: Any, element: Any) -> Any:
    """The least and greatest coordinates of an element in space."""
    import ifcopenshell.geom

    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    shape = ifcopenshell.geom.create_shape(settings, element)
    vertices = np.reshape(shape.geometry.verts, (-1, 3))
    return np.array([vertices.min(axis=0), vertices.max(axis=0)])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # files of theirs
@pytest.mark.parametrize(("unit", "metre"), [("local", 1.0), ("local:ft", 1 / FOOT)])
def test_a_front_is_valid_ifc_with_the_sizes_in_metres(
    tmp_path: Path, unit: str, metre: float
) -> None:
    import ifcopenshell.validate

    model = written(elevation(unit, metre), tmp_path / "a.ifc")
    logger = ifcopenshell.validate.json_logger()
    ifcopenshell.validate.validate(model, logger, express_rules=True)
    assert logger.statements == []
    assert model.schema == "IFC4"
    assert [wall.Name for wall in model.by_type("IfcWall")] == ["Front 1", "Front 2"]
    (door,), (window,) = model.by_type("IfcDoor"), model.by_type("IfcWindow")
    assert (door.OverallWidth, door.OverallHeight) == pytest.approx((1.0, 2.1))
    assert (window.OverallWidth, window.OverallHeight) == pytest.approx((1.5, 1.5))
    (fills,) = window.FillsVoids
    (voids,) = fills.RelatingOpeningElement.VoidsElements
    assert voids.RelatingBuildingElement.Name == "Front 2"
    properties = {
        one.Name: one.NominalValue.wrappedValue
        for defined in window.IsDefinedBy
        for one in defined.RelatingPropertyDefinition.HasProperties
    }
    assert properties["Sill"] == pytest.approx(1.0)
    assert properties["SidesNotSeen"] == "left"
    assert properties["SidesUnsure"] == "top", "its height stood there as if it were sure"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # files of theirs
def test_the_model_is_no_surer_than_the_layer_what_an_opening_is(tmp_path: Path) -> None:
    """A `door or window` was the IfcWindow `Window 2`, so that lists of windows had it."""
    import ifcopenshell.util.element
    import ifcopenshell.validate

    frame = elevation().frame
    frame.loc[frame["kind"] == "window", "kind"] = "door or window"
    model = written(Vector(frame), tmp_path / "a.ifc")
    logger = ifcopenshell.validate.json_logger()
    ifcopenshell.validate.validate(model, logger, express_rules=True)
    assert logger.statements == []
    assert not model.by_type("IfcWindow")
    (fills,) = (r for r in model.by_type("IfcRelFillsElement") if "2" in r[5].Name)
    either = fills.RelatedBuildingElement
    assert (either.is_a(), either.Name) == ("IfcBuildingElementProxy", "Door or window 2")
    assert either.ObjectType == "door or window"
    told = (
        "door or window, certainty 90 %; unsure sides: top; "
        "sides not seen, which may be elsewhere: left"
    )
    assert either.Description == told == fills.RelatingOpeningElement.Description
    facts = ifcopenshell.util.element.get_psets(either)["Survey_Opening"]
    assert (facts["Kind"], facts["Width"]) == ("door or window", 1.5)


def test_walls_and_openings_are_where_the_points_were(tmp_path: Path) -> None:
    """The walls go 0.3 m into the building: northwards, and westwards."""
    model = written(elevation(), tmp_path / "a.ifc")
    south, east = model.by_type("IfcWall")
    np.testing.assert_allclose(
        corners(model, south), [[500.25, 400, 100], [510.25, 400.3, 106]], atol=1e-6
    )
    np.testing.assert_allclose(
        corners(model, east), [[509.95, 400, 100], [510.25, 406, 106]], atol=1e-6
    )
    (window,) = model.by_type("IfcWindow")
    np.testing.assert_allclose(
        corners(model, window), [[510.10, 404, 101], [510.15, 405.5, 102.5]], atol=1e-6
    )


@pytest.mark.slow
def test_the_area_of_a_wall_that_was_not_seen_is_told(tmp_path: Path) -> None:
    """And no window is made of it."""
    import ifcopenshell.util.element

    frame = elevation().frame
    bare = geopandas.GeoDataFrame(
        {"kind": ["unseen"], "front_id": [1], "opening_id": [0]},
        geometry=[shapely.box(4, 1, 7, 5)],
        crs=frame.crs,
    )
    both = Vector(geopandas.GeoDataFrame(pd.concat([frame, bare], ignore_index=True)))
    model = written(both, tmp_path / "a.ifc")
    told = {
        wall.Name: ifcopenshell.util.element.get_psets(wall)["Survey_Wall"]["AreaNotSeen"]
        for wall in model.by_type("IfcWall")
    }
    assert told == {"Front 1": 12.0, "Front 2": 0.0}
    facts = [one for one in model.by_type("IfcPropertySingleValue") if one.Name == "AreaNotSeen"]
    assert {one.NominalValue.is_a() for one in facts} == {"IfcAreaMeasure"}, "it was a length"
    assert len(model.by_type("IfcOpeningElement")) == 2


def test_the_same_layer_makes_the_same_bytes_and_keeps_its_record(tmp_path: Path) -> None:
    for name in ("a.ifc", "b.ifc"):
        written(elevation(), tmp_path / name)
    assert (tmp_path / "a.ifc").read_bytes() == (tmp_path / "b.ifc").read_bytes()
    assert (tmp_path / "a.ifc.json").exists()


def test_two_buildings_in_one_model_have_no_identifier_in_common(tmp_path: Path) -> None:
    """Programs take elements with the same identifier for the same element."""
    first, moved = elevation(), elevation().frame
    moved["corner_z"] += 3
    ids = [
        {one.GlobalId for one in written(layer, tmp_path / f"{k}.ifc").by_type("IfcRoot")}
        for k, layer in enumerate((first, Vector(moved)))
    ]
    assert len(ids[0]) == len(ids[1]) > 10
    assert not ids[0] & ids[1]


def test_another_layer_is_refused(tmp_path: Path) -> None:
    layer = Vector(elevation().frame[["kind", "geometry"]])
    with pytest.raises(
        DataError, match=r"IFC holds fronts with openings.* has no attribute front_id"
    ):
        layer.save(tmp_path / "a.ifc")
    assert not (tmp_path / "a.ifc").exists()


def test_project_building_and_file_have_the_title_client_and_day_of_the_set(tmp_path: Path) -> None:
    """They were "Survey of fronts", "Building", "" and 1980-01-01 whatever was asked for."""
    head = {"title": "Town hall", "client": "The city", "date": "2026-11-24"}
    model = written(elevation().with_head(head), tmp_path / "a.ifc")
    (project,), (building,) = (model.by_type(kind) for kind in ("IfcProject", "IfcBuilding"))
    assert (project.Name, project.Description, building.Name) == (
        "Town hall",
        "For The city",
        "Town hall",
    )
    assert model.header.file_name.name == "Town hall"
    assert model.header.file_name.time_stamp == "2026-11-24T00:00:00"
    other = written(elevation().with_head({"date": "in autumn"}), tmp_path / "b.ifc")
    assert other.header.file_name.time_stamp == "1980-01-01T00:00:00", "the file says no words"


def test_names_and_descriptions_are_in_the_language_of_the_user(tmp_path: Path) -> None:
    """A building of a Turkish set had "Front 1" and "Door 1"; what programs read stays English."""
    with language.speaking("tr"):
        model = written(elevation().with_head({"client": "Muş"}), tmp_path / "a.ifc")
    assert model.by_type("IfcProject")[0].Description == "Muş için"
    names = {
        kind: [one.Name for one in model.by_type(kind)]
        for kind in ("IfcSite", "IfcBuildingStorey", "IfcWall", "IfcOpeningElement", "IfcDoor")
    }
    assert names == {
        "IfcSite": ["Arsa"],
        "IfcBuildingStorey": ["Tüm katlar"],
        "IfcWall": ["Cephe 1", "Cephe 2"],
        "IfcOpeningElement": ["Açıklık 1", "Açıklık 2"],
        "IfcDoor": ["Kapı 1"],
    }
    (window,) = model.by_type("IfcWindow")
    assert window.Name == "Pencere 2"
    assert window.Description == (
        "pencere, kesinlik % 90; kesin olmayan kenarlar: üst; görülmeyen, başka yerde olabilecek "
        "kenarlar: sol"
    )
    assert window.ObjectType == "window"
    assert model.by_type("IfcWall")[0].Description.startswith("60,0 m2 alanının 0,0 m2 kadarı")
    assert model.by_type("IfcBuilding")[0].Name == "Bina"
    assert model.by_type("IfcProject")[0].Name == "Cephe ölçmesi"
