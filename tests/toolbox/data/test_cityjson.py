"""Blocks of buildings in CityJSON: closed, facing outwards, of the right size and heights."""

from __future__ import annotations

import json
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS

from algorithms.classify._columns import BUILDINGS, PARTS
from toolbox.data import Vector
from toolbox.data.cityjson import PART
from toolbox.errors import DataError

RD = CRS("EPSG:28992+5709")


def town(*shapes: Any, **values: Any) -> Vector:
    columns = {"ground": 1.0, "mean": 7.5, "name": "hall", **values}
    frame = geopandas.GeoDataFrame(
        {n: [v] * len(shapes) for n, v in columns.items()}, geometry=list(shapes), crs=RD
    )
    return Vector(frame)


def saved(layer: Vector, tmp_path: Path) -> dict[str, Any]:
    layer.save(tmp_path / "a.city.json", overwrite=True)
    made: dict[str, Any] = json.loads((tmp_path / "a.city.json").read_text())
    return made


def shells(model: dict[str, Any]) -> list[list[Any]]:
    found = []
    for building in model["CityObjects"].values():
        for geometry in building.get("geometry", []):
            solids = geometry["boundaries"]
            found += [
                solid[0] for solid in (solids if geometry["type"] == "MultiSolid" else [solids])
            ]
    return found


def volume(model: dict[str, Any], shell: list[Any]) -> float:
    """The volume as a sum over triangles of all surfaces, if all of them face outwards."""
    places = np.array(model["vertices"]) * model["transform"]["scale"]
    total = 0.0
    for surface in shell:
        for ring in surface:
            a = places[ring[0]]
            for one, other in pairwise(ring[1:]):
                total += float(a @ np.cross(places[one], places[other]))
    return total / 6


LONE = shapely.box(100_000, 400_000, 100_010, 400_008)
YARD = shapely.box(100_020, 400_000, 100_040, 400_020).difference(
    shapely.box(100_025, 400_005, 100_035, 400_015)
)
PAIR = shapely.MultiPolygon([shapely.box(0, 0, 5, 5), shapely.box(9, 0, 14, 5)])


@pytest.mark.parametrize(("shape", "area"), [(LONE, 80), (YARD, 300), (PAIR, 50)])
def test_blocks_are_closed_and_hold_their_volume(shape: Any, area: float, tmp_path: Path) -> None:
    model = saved(town(shape), tmp_path)
    found = shells(model)
    assert sum(volume(model, shell) for shell in found) == pytest.approx(area * 6.5, abs=0.01)
    for shell in found:
        edges = Counter(
            (ring[k - 1], ring[k])
            for surface in shell
            for ring in surface
            for k in range(len(ring))
        )
        assert max(edges.values()) == 1
        assert all((b, a) in edges for a, b in edges), "each edge has a surface on both sides"


def test_the_model_says_where_and_what_it_is(tmp_path: Path) -> None:
    model = saved(town(LONE), tmp_path)
    assert (model["type"], model["version"]) == ("CityJSON", "2.0")
    assert model["metadata"]["referenceSystem"] == "https://www.opengis.net/def/crs/EPSG/0/7415"
    np.testing.assert_allclose(
        model["metadata"]["geographicalExtent"], [100_000, 400_000, 1, 100_010, 400_008, 7.5]
    )
    (building,) = model["CityObjects"].values()
    assert building["attributes"]["name"] == "hall"
    (geometry,) = building["geometry"]
    assert (geometry["type"], geometry["lod"]) == ("Solid", "1.2")
    assert geometry["semantics"]["values"] == [[0, 1, 2, 2, 2, 2]]
    assert all(isinstance(n, int) for vertex in model["vertices"] for n in vertex)


def test_other_heights(tmp_path: Path) -> None:
    model = saved(town(LONE, mean=float("nan"), height=3.0), tmp_path)
    assert model["metadata"]["geographicalExtent"][5] == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("layer", "says"),
    [
        (town(LONE, ground=float("nan")), "no attribute ground"),
        (town(LONE, mean=None), "none of mean, eave, ridge and height"),
        (town(shapely.Point(0, 0)), "buildings are polygons, got a Point"),
    ],
)
def test_what_is_no_building(layer: Vector, says: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=says):
        layer.save(tmp_path / "a.city.json")
    assert not (tmp_path / "a.city.json").exists()


def problems(model: dict[str, Any]) -> list[str]:
    """What the schema of CityJSON 2.0 and the rules of ISO 19107 for solids do not allow here."""
    found = _of_kinds(model)
    places = [tuple(vertex) for vertex in model["vertices"]]
    if len(set(places)) < len(places):
        found.append("two vertices at one place")
    if any(scale <= 0 for scale in model["transform"]["scale"]):
        found.append("a scale that is not above 0")
    rings = [ring for shell in shells(model) for surface in shell for ring in surface]
    if any(len(set(ring)) < max(len(ring), 3) for ring in rings):
        found.append("a ring with a vertex twice, or too few")
    if {k for ring in rings for k in ring} != set(range(len(places))):
        found.append("a vertex that nothing uses, or that is not there")
    for shell in shells(model):
        edges: Counter[tuple[int, int]] = Counter()
        for surface in shell:
            edges.update((ring[k - 1], ring[k]) for ring in surface for k in range(len(ring)))
            corners = np.array([places[k] for ring in surface for k in ring], float)
            flatness = np.linalg.svd(corners - corners.mean(axis=0))[1][2]
            if flatness > 2 * len(corners):  # thousandths, to which corners are rounded
                found.append("a surface that is not plane")
        if any(count > 1 for count in edges.values()):
            found.append("an edge twice in one direction")
        if any((b, a) not in edges for a, b in edges):
            found.append("a shell that is not closed")
        elif not all(_is_one_fan(shell, vertex) for vertex in {v for edge in edges for v in edge}):
            found.append("surfaces that meet at a vertex only")
    return found


def _is_one_fan(shell: list[Any], vertex: int) -> bool:
    """Whether the surfaces around a vertex follow each other in one circle, as in a manifold."""
    after = {}
    for surface in shell:
        for ring in surface:
            for k in (k for k, other in enumerate(ring) if other == vertex):
                after[ring[k - 1]] = ring[(k + 1) % len(ring)]
    first = at = next(iter(after))
    for count in range(1, len(after) + 1):
        at = after[at]
        if at == first:
            return count == len(after)
    return False


def _of_kinds(model: dict[str, Any]) -> list[str]:
    found = []
    for building in model["CityObjects"].values():
        for geometry in building.get("geometry", []):
            solids = geometry["boundaries"]
            kinds = geometry["semantics"]["values"]
            if geometry["type"] == "Solid":
                solids, kinds = [solids], [kinds]
            counts = [[len(shell) for shell in solid] for solid in solids]
            if counts != [[len(values) for values in each] for each in kinds]:
                found.append("surfaces without a kind")
            if {type(geometry["lod"])} != {str}:
                found.append("a level of detail that is no text")
    return found


def test_a_town_is_a_valid_model(tmp_path: Path) -> None:
    """Outlines with holes and parts, and one whose corners fall together at a thousandth."""
    close = shapely.Polygon([(0, 0), (0.0002, 0.0002), (9, 0), (9, 9), (0, 9)])
    shared = shapely.box(9, 0, 15, 9)  # has a wall in common with the one before
    model = saved(town(LONE, YARD, PAIR, close, shared), tmp_path)
    assert problems(model) == []
    assert len(model["CityObjects"]) == 5
    broken = json.loads(json.dumps(model))
    shells(broken)[0].pop()
    assert "a shell that is not closed" in problems(broken)
    broken = json.loads(json.dumps(model))
    broken["vertices"].append(broken["vertices"][0])
    assert "two vertices at one place" in problems(broken)
    broken = json.loads(json.dumps(model))
    broken["vertices"][0][2] += 500
    assert "a surface that is not plane" in problems(broken)
    tetrahedra = [
        [[[0, a, b]], [[0, b, c]], [[0, c, a]], [[a, c, b]]] for a, b, c in ((1, 2, 3), (4, 5, 6))
    ]
    assert _is_one_fan(tetrahedra[0], 0)
    assert not _is_one_fan(tetrahedra[0] + tetrahedra[1], 0)


@pytest.mark.parametrize(
    "holes",
    [
        [[(0, 4), (3, 3), (3, 5)]],  # at the wall
        [[(3, 3), (5, 3), (4, 5)], [(4, 5), (5, 7), (3, 7)]],  # at each other
    ],
)
def test_holes_that_touch_at_a_point_are_drawn_in(holes: Any, tmp_path: Path) -> None:
    """Such a polygon is valid, but its block has an upright edge that four walls share."""
    touching = shapely.Polygon(shapely.box(0, 0, 9, 9).exterior, holes)
    assert touching.is_valid
    model = saved(town(touching), tmp_path)
    assert problems(model) == []
    (shell,) = shells(model)
    assert len(shell[0]) == 1 + len(holes)
    assert volume(model, shell) == pytest.approx(touching.area * 6.5, rel=0.01)


def test_height_form_title_and_day_have_the_names_of_the_standard(tmp_path: Path) -> None:
    """A viewer showed 6.5 m beside an attribute of 11; title and date stood nowhere."""
    layer = town(LONE, ridge=12.0, form="gable")
    made = saved(layer.with_head({"title": "Town", "date": "2026-11-24"}), tmp_path)
    assert made["metadata"]["title"] == "Town"
    assert made["metadata"]["referenceDate"] == "2026-11-24"
    (building,) = made["CityObjects"].values()
    assert building["attributes"]["measuredHeight"] == 11.0
    assert building["attributes"]["roofType"] == "gable"
    feet = Vector(layer.frame.set_crs("EPSG:2263+6360", allow_override=True))
    (building,) = saved(feet, tmp_path)["CityObjects"].values()
    assert building["attributes"]["measuredHeight"] == pytest.approx(11 * 0.3048, abs=0.001)
    bare = saved(town(LONE).with_head({"date": "autumn 2026"}), tmp_path)
    assert not {"title", "referenceDate"} & set(bare["metadata"])
    (building,) = bare["CityObjects"].values()
    assert "measuredHeight" not in building["attributes"]


def test_buildings_are_called_as_in_other_files(tmp_path: Path) -> None:
    frame = town(LONE, YARD).frame.assign(id=["100005_400004", "100030_400010"])
    found = saved(Vector(frame), tmp_path)["CityObjects"]
    assert list(found) == ["building-100005_400004", "building-100030_400010"]


def test_buildings_without_ids_of_their_own_have_numbers(tmp_path: Path) -> None:
    frame = town(LONE, YARD).frame.assign(id=["a", "a"])
    assert list(saved(Vector(frame), tmp_path)["CityObjects"]) == ["building-1", "building-2"]


def test_parts_are_those_of_their_building(tmp_path: Path) -> None:
    """A tower beside its wing, and a lone house: LoD1.3."""
    wing, tower = shapely.box(0, 0, 20, 8), shapely.box(20, -4, 30, 12)
    frame = town(wing, tower, LONE, ridge=9.0, form="flat").frame
    frame["id"], frame["building"] = ["w", "t", "l"], ["12_4", "12_4", "l"]
    frame["points"], frame["cut"] = 100, False
    frame.loc[1, ["mean", "ridge"]] = 31.0, 32.0
    model = saved(Vector(frame), tmp_path)
    assert problems(model) == []
    objects = model["CityObjects"]
    assert list(objects) == ["building-12_4", "part-w", "part-t", "building-l"]
    whole, tall = objects["building-12_4"], objects["part-t"]
    assert whole["type"] == "Building"
    assert whole["children"] == ["part-w", "part-t"]
    assert "geometry" not in whole
    assert whole["attributes"]["measuredHeight"] == 31.0
    assert whole["attributes"]["ground"] == 1.0
    assert not {"id", "mean", "ridge"} & set(whole["attributes"])
    assert (tall["type"], tall["parents"]) == ("BuildingPart", ["building-12_4"])
    assert tall["geometry"][0]["lod"] == "1.3"
    assert (objects["building-l"]["type"], "parents" in objects["building-l"]) == (
        "Building",
        False,
    )
    volumes = [volume(model, shell) for shell in shells(model)]
    assert volumes == pytest.approx([160 * 6.5, 160 * 30, 80 * 6.5])


@pytest.mark.parametrize("cut", [[False, True], [True, True], [False, False]])
def test_a_building_is_cut_if_a_part_of_it_is(cut: list[bool], tmp_path: Path) -> None:
    """It said nothing where one part was cut and another was not."""
    frame = town(shapely.box(0, 0, 20, 8), shapely.box(20, -4, 30, 12)).frame
    frame = frame.assign(id=["a", "b"], building="c", points=100, cut=cut)
    objects = saved(Vector(frame), tmp_path)["CityObjects"]
    assert objects["building-c"]["attributes"]["cut"] is any(cut)


@pytest.mark.parametrize("metre", [1.0, 3937 / 1200])
def test_a_building_has_the_height_of_its_outline(metre: float, tmp_path: Path) -> None:
    """A dormer counts for the building alone: it was 1.35 m lower in CityJSON than its outline."""
    crs = None if metre == 1 else "EPSG:2263+6360"
    frame = town(shapely.box(0, 0, 20, 8), shapely.box(20, -4, 30, 12), ridge=9.0).frame
    frame = frame.assign(id=["a", "b"], building="c", building_height=9.5 * metre)
    frame = frame.assign(points=100, cut=False)
    frame = frame.set_crs(crs, allow_override=True)
    objects = saved(Vector(frame), tmp_path)["CityObjects"]
    assert objects["building-c"]["attributes"]["measuredHeight"] == pytest.approx(9.5)
    assert objects["part-a"]["attributes"]["measuredHeight"] == pytest.approx(8 / metre, abs=1e-3)


@pytest.mark.parametrize(
    ("more", "building"),
    [
        ({}, ["yes", "yes", "house"]),  # OpenStreetMap
        ({"points": 100, "cut": False}, ["w", "w", None]),
    ],
)
def test_an_attribute_building_alone_tells_no_parts(
    more: dict[str, Any], building: list[str | None], tmp_path: Path
) -> None:
    """Houses of OpenStreetMap 100 m apart were parts of a building called yes."""
    shapes = [shapely.box(x, 0, x + 10, 8) for x in (0, 100, 200)]
    frame = town(*shapes).frame.assign(id=["a", "b", "c"], building=building, **more)
    objects = saved(Vector(frame), tmp_path)["CityObjects"]
    assert list(objects) == ["building-a", "building-b", "building-c"]
    assert {(o["type"], o["geometry"][0]["lod"]) for o in objects.values()} == {("Building", "1.2")}


def test_what_parts_have_is_what_they_are_found_with() -> None:
    assert set(PART) <= set(PARTS)
    assert not set(PART) <= set(BUILDINGS)
