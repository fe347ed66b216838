"""vectors.reproject, and layers that are reprojected as they are read."""

from __future__ import annotations

from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS

from algorithms.vectors.reproject import VectorsReproject
from toolbox.data import Vector
from toolbox.data.crs import same_crs
from toolbox.errors import DataError


def layer(*shapes: shapely.Geometry | None, crs: int | str | None = 32635) -> Vector:
    frame = geopandas.GeoDataFrame({"name": range(len(shapes))}, geometry=list(shapes), crs=crs)
    return Vector(frame, name="a.gpkg")


def test_as_geopandas_does_it() -> None:
    given = layer(
        shapely.box(500_000, 4_600_000, 500_100, 4_600_050),
        shapely.LineString([(500_000, 4_600_000), (500_400, 4_600_400)]),
        None,
    )
    out = VectorsReproject(features=given, crs=CRS(32636)).run().reprojected
    wanted = given.frame.to_crs(32636)
    assert out.frame.geometry.geom_equals_exact(wanted.geometry, 1e-6).tolist()[:2] == [True] * 2
    assert out.frame.geometry[2] is None
    assert out.names == ("name",)
    assert same_crs(out.crs, CRS(32636))


def test_heights_in_feet_become_metres() -> None:
    given = layer(shapely.Point(1e6, 2e5, 100.0), shapely.Point(1e6, 2e5), crs=2263)
    out = VectorsReproject(features=given, crs=CRS(26918)).run().reprojected.frame.geometry
    assert out[0].z == pytest.approx(30.48006, abs=1e-5)
    assert not out[1].has_z


def test_long_edges_get_vertices() -> None:
    given = layer(shapely.LineString([(500_000, 4_600_000), (560_000, 4_600_000)]))
    plain = VectorsReproject(features=given, crs=CRS(4326)).run().reprojected.frame.geometry[0]
    dense = VectorsReproject(features=given, crs=CRS(4326), max_edge=1000.0).run()
    curve = dense.reprojected.frame.geometry[0]
    assert len(curve.coords) == 61
    apart = shapely.hausdorff_distance(plain, curve) * 111_320
    sagitta = 60_000**2 / (8 * 6_371_000) * np.tan(np.radians(41.55))
    assert apart == pytest.approx(sagitta, rel=0.02)  # of the parallel of latitude


def test_a_map_is_reprojected_as_it_is_read(tmp_path: Path) -> None:
    """Google Earth's KML has heights of 0 that mean nothing."""
    lake = layer(shapely.box(500_000, 4_600_000, 500_100, 4_600_050))
    lake.save(tmp_path / "lake.kml")
    read = Vector.open(tmp_path / "lake.kml", reproject=CRS(32635))
    assert same_crs(read.crs, CRS(32635))
    np.testing.assert_allclose(read.bounds, lake.bounds, rtol=0, atol=1e-3)
    high = Vector.open(tmp_path / "lake.kml", reproject=CRS("EPSG:32635+5773"))
    np.testing.assert_allclose(high.bounds, lake.bounds, rtol=0, atol=1e-3)


def test_without_crs() -> None:
    with pytest.raises(DataError, match=r"features: a\.gpkg: has no CRS"):
        VectorsReproject(features=layer(shapely.Point(1, 2), crs=None), crs=CRS(4326)).run()
