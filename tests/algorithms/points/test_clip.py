"""points.clip: rectangle and polygons, inside and outside, and what cannot be clipped by."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS

from algorithms.points.clip import PointsClip
from toolbox import run
from toolbox.data import PointCloud, Vector
from toolbox.declare import Expression, Extent
from toolbox.errors import DataError, ParameterError
from toolbox.tiles.tiling import Tiling

UTM = CRS(32635)


def cloud(crs: CRS | None = UTM) -> PointCloud:
    """A lattice of 11 x 11 points, numbered by an extra attribute."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(11.0), np.arange(11.0)))
    xyz = np.column_stack([x + 500_000, y + 4_600_000, x * y])
    return PointCloud(xyz, {"number": np.arange(121)}, crs=crs, name="a.laz")


def layer(*shapes: Any, crs: CRS | None = UTM, **columns: Any) -> Vector:
    moved = [shapely.transform(s, lambda xy: xy + np.array([500_000, 4_600_000])) for s in shapes]
    return Vector(geopandas.GeoDataFrame(columns, geometry=moved, crs=crs), name="area.gpkg")


def box(west: float, south: float, east: float, north: float) -> Extent:
    return Extent(500_000 + west, 4_600_000 + south, 500_000 + east, 4_600_000 + north)


def count(**parameters: Any) -> int:
    out = PointsClip(points=cloud(), **parameters).run()
    assert out.removed_share == pytest.approx(1 - len(out.clipped) / 121)
    return len(out.clipped)


def test_points_on_the_edge_are_inside() -> None:
    assert count(extent=box(2, 3, 4, 6)) == 3 * 4
    assert count(polygons=layer(shapely.box(2, 3, 4, 6))) == 3 * 4


def test_inside_and_outside_are_all_points_and_none_twice() -> None:
    shape = layer(shapely.Point(5, 5).buffer(3.1))
    inside = PointsClip(points=cloud(), polygons=shape).run().clipped
    outside = PointsClip(points=cloud(), polygons=shape, keep="outside").run().clipped
    both = np.concatenate([inside["number"], outside["number"]])
    assert np.sort(both).tolist() == list(range(121))
    away = np.hypot(inside["x"] - 500_005, inside["y"] - 4_600_005)
    assert len(inside) == 29
    assert away.max() < 3.1


def test_a_rectangle_and_polygons_together_are_what_both_hold() -> None:
    both = {"extent": box(0, 0, 3, 10), "polygons": layer(shapely.box(2, 2, 8, 8))}
    assert count(**both) == 2 * 7
    assert count(keep="outside", **both) == 121 - 2 * 7


def test_multipolygons_holes_and_overlaps() -> None:
    ring = shapely.box(0, 0, 6, 6).difference(shapely.box(1, 1, 5, 5))
    shapes = shapely.MultiPolygon([ring, shapely.box(8, 8, 10, 10)])
    assert count(polygons=layer(shapes)) == 49 - 9 + 9
    assert count(polygons=layer(shapely.box(0, 0, 2, 2), shapely.box(1, 1, 3, 3))) == 9 + 9 - 4


def test_where_chooses_polygons() -> None:
    shapes = layer(shapely.box(0, 0, 1, 1), shapely.box(5, 5, 7, 7), kind=[1, 2], name=["a", "b"])
    assert count(polygons=shapes) == 4 + 9
    assert count(polygons=shapes, where=Expression("kind == 2")) == 9
    with pytest.raises(DataError, match=r"polygons: none of area\.gpkg meets kind > 2"):
        count(polygons=shapes, where=Expression("kind > 2"))
    with pytest.raises(DataError, match=r"where: attribute 'name' of area\.gpkg is no number"):
        count(polygons=shapes, where=Expression("name == 1"))
    with pytest.raises(ParameterError, match="no attribute 'x'; there are kind, name"):
        count(polygons=shapes, where=Expression("x == 1"))


def test_nothing_inside_is_an_empty_cloud_and_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("WARNING", "toolbox"):
        out = PointsClip(points=cloud(), extent=box(20, 20, 30, 30)).run()
    assert (len(out.clipped), out.removed_share) == (0, 1.0)
    assert out.clipped.names == ("number",)
    assert "no point is inside" in caplog.text


def test_features_without_geometry_are_told(caplog: pytest.LogCaptureFixture) -> None:
    shapes = layer(shapely.box(0, 0, 1, 1), shapely.Polygon())
    with caplog.at_level("WARNING", "toolbox"):
        assert count(polygons=shapes) == 4
    assert "polygons: 1 of area.gpkg have no geometry" in caplog.text


def test_something_to_clip_by_is_needed() -> None:
    with pytest.raises(DataError, match="extent: neither a rectangle nor polygons"):
        PointsClip(points=cloud())
    with pytest.raises(DataError, match="where: is a condition for polygons"):
        PointsClip(points=cloud(), extent=box(0, 0, 1, 1), where=Expression("a > 1"))
    with pytest.raises(DataError, match=r"polygons: area\.gpkg is empty"):
        PointsClip(points=cloud(), polygons=layer())
    with pytest.raises(DataError, match=r"polygons: none of area\.gpkg has a geometry"):
        count(polygons=layer(shapely.Polygon()))


def test_polygons_in_another_crs_are_refused() -> None:
    degrees = layer(shapely.box(2, 3, 4, 6), crs=CRS(4326))
    with pytest.raises(DataError, match=r"polygons: area\.gpkg is in EPSG:4326 .*reproject it"):
        count(polygons=degrees)
    bare = layer(shapely.box(2, 3, 4, 6), crs=None)
    with pytest.raises(DataError, match=r"polygons: area\.gpkg has no CRS"):
        count(polygons=bare)
    assert len(PointsClip(points=cloud(None), polygons=bare).run().clipped) == 12


def test_polygons_without_heights_go_with_points_that_have_a_vertical_crs() -> None:
    points = cloud(CRS("EPSG:32635+3855"))
    out = PointsClip(points=points, polygons=layer(shapely.box(2, 3, 4, 6))).run()
    assert len(out.clipped) == 12


@pytest.mark.slow
def test_tiles_give_the_same_points(tmp_path: Path) -> None:
    layer(shapely.Point(5, 5).buffer(4.3)).save(tmp_path / "area.gpkg")
    cloud().save(tmp_path / "points.laz")
    given = {"points": tmp_path / "points.laz", "polygons": tmp_path / "area.gpkg"}
    whole = run("points.clip", given)
    out = {"clipped": tmp_path / "tiles.laz"}
    tiles = run("points.clip", given | out, tiling=Tiling(3.0, 1, 1 << 30))
    assert tiles["removed_share"] == whole["removed_share"]
    found = PointCloud.open(tmp_path / "tiles.laz")
    assert sorted(found["number"]) == sorted(whole["clipped"]["number"])


@pytest.mark.slow
def test_records_of_a_real_file_stay_bit_for_bit(
    data: Callable[[str], Path], tmp_path: Path
) -> None:
    """Half of a tile of AHN3 by a polygon over it, against GEOS."""
    points = PointCloud.open(sorted(data("water_denoever_ahn3").glob("*.la[sz]"))[0])
    west, south, _, east, north, _ = points.bounds
    area = shapely.Polygon([(west, south), (east, south), (east, north)])
    frame = geopandas.GeoDataFrame(geometry=[area], crs=points.crs)
    out = PointsClip(points=points, polygons=Vector(frame, name="half")).run().clipped
    wanted = shapely.intersects_xy(area, points["x"], points["y"])
    assert 0 < wanted.sum() < len(points)
    same = points.select(wanted)
    np.testing.assert_array_equal(out.arrays()["packed"], same.arrays()["packed"])
