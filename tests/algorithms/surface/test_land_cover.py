"""surface.land_cover: most first returns of a cell, small gaps, areas."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import geopandas
import numpy as np
import pytest
import shapely
from scenes.layers import NORTH, WEST, cloud

from algorithms.surface.land_cover import SurfaceLandCover
from toolbox.data import Raster, Vector
from toolbox.data.asprs import COLOURS
from toolbox.data.crs import parse_crs
from toolbox.errors import DataError, NothingToDo, ParameterError


def at(*places: tuple[float, float]) -> list[tuple[float, float, float]]:
    return [(WEST + x, NORTH - y, 0.0) for x, y in places]


def test_a_cell_has_the_class_of_most_first_returns() -> None:
    xyz = at((0.2, 0.5), (0.4, 0.5), (0.6, 0.5), (1.5, 0.5), (1.6, 0.5))
    points = cloud(xyz, [2, 2, 6, 2, 5], return_number=np.array([1, 1, 1, 2, 1], np.uint8))
    found = SurfaceLandCover(points=points).run()
    assert found.cover.band().tolist() == [[2, 5]]
    assert [(r["name"], r["area_m2"], r["share"]) for r in found.areas.rows()] == [
        ("Ground", 0.8, 0.5714),  # from the first point, at 0.2, to the last, at 1.6
        ("High vegetation", 0.6, 0.4286),
    ]


def test_names_of_classes_within_a_sentence_keep_the_capitals_of_names() -> None:
    """Areas were of "bridges and quays in dutch surveys"."""
    found = SurfaceLandCover(points=cloud(at((0.5, 0.5), (1.5, 0.5)), [2, 26])).run()
    said = found.in_words()
    assert ": ground 0 m² (50.0 %), bridges and quays in Dutch surveys 0 m² (50.0 %)." in said


def test_areas_make_up_the_extent_of_the_points() -> None:
    """Cells on the border of a tile of 7.2 x 3.4 m counted whole: 32 m2 for 24.48."""
    x, y = np.meshgrid(np.linspace(0.4, 7.6, 73), np.linspace(0.3, 3.7, 35))
    points = cloud(
        at(*zip(x.ravel().tolist(), y.ravel().tolist(), strict=True)), [2, 6] * 1277 + [2]
    )
    rows = list(SurfaceLandCover(points=points).run().areas.rows())
    assert sum(row["area_m2"] for row in rows) == pytest.approx(7.2 * 3.4)
    assert sum(row["share"] for row in rows) == pytest.approx(1.0)


def test_what_lies_under_a_crown_is_not_seen() -> None:
    """Of four returns on a cell one is the first: three later ones on the ground do not count."""
    number = np.array([1, 2, 3, 4], np.uint8)
    points = cloud(at(*[(0.5, 0.5)] * 4), [5, 2, 2, 2], return_number=number)
    assert SurfaceLandCover(points=points).run().cover.band().tolist() == [[5]]


def test_narrow_gaps_take_the_nearest_class_and_wide_ones_stay() -> None:
    """A circle of the radius of 2 m fits into a gap of 5 cells, not into one of 4."""
    places = [(x, y + 0.5) for x in (0.5, 5.5, 11.5) for y in range(9)]
    points = cloud(at(*places), [2] * 9 + [6] * 18)
    band = SurfaceLandCover(points=points, max_gap=2.0).run().cover.band()[4]
    assert band[:6].tolist() == [2, 2, 2, 6, 6, 6]
    assert np.isnan(band[6:11]).all()
    assert band[11] == 6


def test_nothing_is_filled_beyond_the_edge_of_the_data() -> None:
    """Three tiles in an L: a rim of 2 m around the missing one made 7500 m2 8014."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0, 40.5, 0.5), np.arange(0, 40.5, 0.5)))
    seen = ((x <= 20) | (y <= 20)) & ~((np.abs(x - 10) < 1.5) & (np.abs(y - 10) < 1.5))
    places = at(*zip(x[seen].tolist(), y[seen].tolist(), strict=True))
    found = SurfaceLandCover(points=cloud(places, [2] * len(places)), max_gap=2.0).run()
    whole = sum(row["area_m2"] for row in found.areas.rows())
    assert whole == pytest.approx(40 * 40 - 20 * 20, abs=25), "and half a cell at its border"
    assert found.cover.band()[10, 10] == 2, "a hole of 3 m in the data"


def test_empty_cells_in_water_are_water_and_bridges_over_it_stay() -> None:
    """A canal that swallows all pulses, 12 m wide, and a bridge of class 17 across it."""
    points = cloud(at((0.5, 0.5), (1.5, 0.5), (7.5, 0.5), (14.5, 0.5)), [2, 2, 17, 2])
    canal = shapely.box(WEST + 2, NORTH - 1, WEST + 14, NORTH)
    water = Vector(geopandas.GeoDataFrame(geometry=[canal], crs=points.crs))
    found = SurfaceLandCover(points=points, water=water, max_gap=0.0).run()
    assert found.cover.band()[0].tolist() == [2, 2, *[9] * 5, 17, *[9] * 6, 2]
    assert {row["name"]: row["area_m2"] for row in found.areas.rows()}["Water"] == 11


def test_water_without_returns_does_not_take_the_class_of_its_shore() -> None:
    """A canal of 6 m lost 2 m on each side: 528 cells of one survey were ground and trees."""
    points = cloud(at((0.5, 0.5), (1.5, 0.5), (8.5, 0.5)), [2, 5, 2])
    canal = shapely.box(WEST + 2, NORTH - 1, WEST + 8, NORTH)
    water = Vector(geopandas.GeoDataFrame(geometry=[canal], crs=points.crs))
    found = SurfaceLandCover(points=points, water=water, max_gap=2.0).run()
    assert found.cover.band()[0].tolist() == [2, 5, *[9] * 6, 2]


def test_water_must_have_the_crs_of_the_points() -> None:
    points = cloud(at((0.5, 0.5)), [2])
    water = Vector(geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)], crs=4326))
    with pytest.raises(DataError, match="water"):
        SurfaceLandCover(points=points, water=water).run()


def test_noise_takes_no_part() -> None:
    points = cloud(at((0.5, 0.5), (0.6, 0.5), (0.7, 0.5)), [2, 7, 7])
    assert SurfaceLandCover(points=points).run().cover.band().tolist() == [[2]]


def test_points_never_classified_take_no_part(caplog: pytest.LogCaptureFixture) -> None:
    places = at((0.5, 0.5), (0.6, 0.5), (0.7, 0.5))
    with pytest.raises(NothingToDo, match="all are of class 0"):
        SurfaceLandCover(points=cloud(places, [0, 0, 0])).run()
    found = SurfaceLandCover(points=cloud(places, [0, 0, 6])).run()
    assert found.cover.band().tolist() == [[6]]
    assert "2 points of class 0" in caplog.text


def test_points_need_classes() -> None:
    with pytest.raises(DataError, match="has no classification"):
        SurfaceLandCover(points=cloud(at((0, 0)))).run()


def test_cells_wider_than_the_data_are_told_and_larger_ones_refused(
    caplog: pytest.LogCaptureFixture,
) -> None:
    points = cloud(at((0.5, 0.5), (9.5, 0.5)), [2, 2])
    SurfaceLandCover(points=points, cell=5.0).run()
    assert not caplog.text
    SurfaceLandCover(points=points, cell=5000.0).run()
    assert "one cell of 5000 m holds all points" in caplog.text
    with pytest.raises(ParameterError, match="cell: must be > 0 and <= 10000 m, got 1000000000"):
        SurfaceLandCover(points=points, cell=1e9)


def test_the_file_has_colours_and_names_of_its_classes_and_no_heights(tmp_path: Path) -> None:
    """As a GIS reads them: GDAL, from the file and what stands beside it."""
    import rasterio
    from rasterio.enums import ColorInterp

    places = at(*((0.5 + k, 0.5 + row) for k in range(40) for row in range(30)))
    points = cloud(places, [2, 6, 9, 26] * 300)
    raster = SurfaceLandCover(points=points.with_crs(parse_crs("EPSG:28992+5709"))).run().cover
    for name, cog in (("a.tif", False), ("b.tif", True)):
        raster.save(tmp_path / name, cog=cog)
        with rasterio.open(tmp_path / name) as source:
            assert source.colorinterp == (ColorInterp.palette,)
            colours = source.colormap(1)
            assert source.units == ("1",), "not metres, as a CRS with heights makes of it"
        for number in (2, 6, 9, 26):
            assert "#{:02x}{:02x}{:02x}".format(*colours[number]) == COLOURS[number]
        beside = ElementTree.parse(tmp_path / f"{name}.aux.xml")
        names = [item.text or "" for item in beside.iter("Category")]
        assert {number: names[number] for number in (2, 6, 9, 26)} == {
            2: "Ground",
            6: "Building",
            9: "Water",
            26: "Bridges and quays in Dutch surveys",
        }
        again = Raster.open(tmp_path / name)
        np.testing.assert_array_equal(again.values, raster.values)
        assert {path.name for path in Raster.own_files(tmp_path / name) if path.exists()} == {
            name,
            f"{name}.aux.xml",
        }
    assert not list(tmp_path.glob(".plain*"))
