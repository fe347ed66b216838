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

from toolbox.data import Vector
from toolbox.errors import DataError

RD = CRS("EPSG:28992+5709")


def town(*shapes: Any, **values: Any) -> Vector:
    columns = {"ground": 1.0, "mean": 7.5, "name": "hall", **values}
    frame = geopandas.GeoDataFrame(
        {n: [v] * len(shapes) for n, v in columns.items()}, geometry=list(shapes), crs=RD
    )
    return Vector(frame)


def saved(layer: Vector, tmp_path: Path) -> dict[str, Any]:
    layer.save(tmp_path / "a.city.json")
    made: dict[str, Any] = json.loads((tmp_path / "a.city.json").read_text())
    return made


def shells(model: dict[str, Any]) -> list[list[Any]]:
    found = []
    for building in model["CityObjects"].values():
        for geometry in building["geometry"]:
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
