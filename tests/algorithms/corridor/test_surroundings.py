"""corridor.surroundings: what is near the wires in plan, and what is no line."""

from __future__ import annotations

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS

import toolbox
from toolbox.data import PointCloud, Vector
from toolbox.errors import DataError

METRE = 3937 / 1200  # US survey feet


def points(metre: float = 1.0, crs: int = 32635) -> PointCloud:
    """A row of points square to a wire along x, one per metre, high and low in turn."""
    y = np.arange(-30.0, 31.0)
    xyz = np.column_stack([np.full(61, 50.0), y, np.where(y % 2, 0.0, 900.0)])
    return PointCloud(xyz * metre, crs=CRS(crs), name="a.laz")


def wires(*shapes: shapely.Geometry, metre: float = 1.0, crs: int = 32635) -> Vector:
    scaled = [shapely.transform(s, lambda xyz: xyz * metre, include_z=s.has_z) for s in shapes]
    return Vector(geopandas.GeoDataFrame(geometry=scaled, crs=crs), name="w.gpkg")


WIRE = shapely.LineString([(0, 0, 20), (100, 0, 25)])


@pytest.mark.parametrize(("metre", "crs"), [(1.0, 32635), (METRE, 2263)])
def test_near_is_told_in_plan_and_to_the_centimetre(metre: float, crs: int) -> None:
    sources = {"points": points(metre, crs), "wires": wires(WIRE, metre=metre, crs=crs)}
    found = toolbox.run("corridor.surroundings", sources | {"reach": 12.01})
    y = found["near"].xyz[:, 1] / metre
    assert np.round(y).tolist() == list(range(-12, 13))
    assert found["removed_share"] == pytest.approx(36 / 61)


def test_beyond_the_end_of_a_wire_the_end_counts() -> None:
    short = shapely.LineString([(0, 0, 20), (45, 0, 20)])
    sources = {"points": points(), "wires": wires(short), "reach": 13.002}
    y = toolbox.run("corridor.surroundings", sources)["near"].xyz[:, 1]
    assert np.abs(y).max() == 12.0  # 5 m behind the end


def test_no_wire_has_no_surroundings() -> None:
    found = toolbox.run("corridor.surroundings", {"points": points(), "wires": wires()})
    assert len(found["near"]) == 0


def test_polygons_are_refused() -> None:
    with pytest.raises(DataError, match=r"wires: must be lines, w\.gpkg holds a Polygon"):
        toolbox.run(
            "corridor.surroundings", {"points": points(), "wires": wires(shapely.box(0, 0, 1, 1))}
        )
