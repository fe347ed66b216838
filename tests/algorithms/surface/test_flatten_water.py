"""surface.flatten_water: water at its level, shores not below it, what lies lower elsewhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS
from scenes.layers import NORTH, UTM, WEST, raster

from algorithms.surface.flatten_water import SurfaceFlattenWater
from toolbox.data import Raster, Vector
from toolbox.errors import DataError, ParameterError


def pond(level: float | None = 10.0, crs: CRS = UTM, side: float = 4.0) -> Vector:
    """A square of water whose corner is 3 m south-east of that of the raster."""
    shape = shapely.box(WEST + 3, NORTH - 3 - side, WEST + 3 + side, NORTH - 3)
    return Vector(geopandas.GeoDataFrame({"level": [level]}, geometry=[shape], crs=crs))


def bowl() -> Raster:
    """Ground of 12 m, 8 m at the water, a ditch of 9 m around it, and a hollow of 5 m."""
    z = np.full((20, 20), 12.0)
    z[2:8, 2:8] = 9.0
    z[3:7, 3:7] = 8.0
    z[4, 4] = np.nan
    z[15:18, 15:18] = 5.0
    return raster(z)


def test_water_is_level_and_no_shore_is_lower() -> None:
    found = SurfaceFlattenWater(terrain=bowl(), water=pond()).run()
    z = found.flattened.band()
    assert (z[2:8, 2:8] == 10.0).all(), "also where nothing was known"
    assert found.raised == 36 - 16
    assert found.largest_raise == pytest.approx(1.0)
    assert (z[15:18, 15:18] == 5.0).all()
    assert (z[0] == 12.0).all()


def test_water_fills_the_holes_of_a_surface_and_leaves_what_stands_on_it() -> None:
    """A surface model had a hole in each lake, over which its terrain was level."""
    top = bowl().band().copy()
    top[3:7, 3:7] = np.nan  # the water swallowed the pulses
    top[5, 5] = 13.0  # a boat
    top[6, 6] = 9.9  # a trough of the waves
    top[2, 4] = np.nan  # on the shore
    top[18, 18] = np.nan  # on land
    found = SurfaceFlattenWater(terrain=bowl(), surface=raster(top), water=pond()).run()
    filled = found.surface_with_water
    assert filled is not None
    terrain, surface = found.flattened.band(), filled.band()
    assert surface[5, 5] == 13.0
    objects = (surface - terrain)[2:8, 2:8]
    objects[3, 3] = 0
    assert (objects == 0).all(), "on the water, and on the shore that was raised to it"
    assert np.isnan(surface[18, 18])
    rest = np.ones(top.shape, bool)
    rest[2:8, 2:8] = False
    np.testing.assert_array_equal(surface[rest], top[rest])
    assert found.filled == 15
    assert "15 cells of the surface in which nothing came back" in found.in_words()
    with pytest.raises(DataError, match="surface: the raster covers another area than that of the"):
        SurfaceFlattenWater(terrain=bowl(), surface=raster(top[:-1]), water=pond())
    with pytest.raises(DataError, match="surface: the raster has 2 bands"):
        SurfaceFlattenWater(terrain=bowl(), surface=raster(np.stack([top, top])), water=pond())


def test_the_width_of_gaps_at_the_shore_is_told_in_metres(caplog: pytest.LogCaptureFixture) -> None:
    """It had been the number of feet, said to be metres."""
    z = np.where(bowl().band() == 9.0, 12.0, bowl().band())
    z[2, 4:6] = np.nan
    feet = CRS(2263)
    SurfaceFlattenWater(terrain=replace(raster(z), crs=feet), water=pond(crs=feet)).run()
    assert "at most 5 m from the water" in caplog.text


def test_gaps_at_the_shore_lie_between_water_and_ground(caplog: pytest.LogCaptureFixture) -> None:
    """Two empty cells at the shore of a real lake made a storage curve end at the edge of data."""
    z = np.where(bowl().band() == 9.0, 12.0, bowl().band())
    z[2, 4:6] = z[12, 12] = np.nan  # at the shore, and in the land
    found = SurfaceFlattenWater(terrain=raster(z), water=pond()).run().flattened.band()
    assert ((found[2, 4:6] > 10.0) & (found[2, 4:6] < 12.0)).all()
    assert "2 empty cells at shores have heights between water and ground" in caplog.text
    assert "at most 5 m from the water" in caplog.text
    assert np.isnan(found[12, 12])
    z[1, 4:6] = np.nan  # as far from the water as the shore is wide
    found = SurfaceFlattenWater(terrain=raster(z), water=pond(), shore=2).run().flattened.band()
    assert ((found[1:3, 4:6] >= 10.0) & (found[1:3, 4:6] <= 12.0)).all()
    z[1, 4:6], z[2, 4:] = 12.0, np.nan  # goes on to the edge of the data
    found = SurfaceFlattenWater(terrain=raster(z), water=pond()).run().flattened.band()
    assert np.isnan(found[2, 4:]).all()
    z[2, 17:] = 12.0  # farther from the water than the shore is wide
    found = SurfaceFlattenWater(terrain=raster(z), water=pond()).run().flattened.band()
    assert np.isnan(found[2, 4:17]).all()


def test_the_reach_of_what_is_made_up_is_told_in_metres(caplog: pytest.LogCaptureFixture) -> None:
    """Five metres were said to be 16.4042 m, which are feet."""
    z = bowl().band().copy()
    z[2, 4:6] = np.nan
    feet = CRS(2222)
    terrain = replace(raster(z), crs=feet)
    SurfaceFlattenWater(terrain=terrain, water=pond(crs=feet), shore=2).run()
    assert "at most 2 m from the water" in caplog.text


def test_water_far_above_the_ground_beside_it_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """A pond on a river bank that was none raised ground by 7.48 ft, and no warning named it."""
    feet = CRS(2263)
    for ditch, crs, told in (
        (9.0, UTM, ""),  # a metre, as a ditch may be deep
        (7.0, feet, ""),
        (6.0, feet, "20 cells beside water were raised by more than 1 m, by up to 4.00 US ft at"),
        (7.0, UTM, "20 cells beside water were raised by more than 1 m, by up to 3.00 m at"),
    ):
        z = bowl().band().copy()
        z[z == 9.0] = ditch
        caplog.clear()
        SurfaceFlattenWater(terrain=replace(raster(z), crs=crs), water=pond(crs=crs)).run()
        assert told in caplog.text
        assert bool(told) == bool(caplog.text)
    assert f"{WEST + 2.5:.1f},{NORTH - 2.5:.1f}" in caplog.text


def test_heights_keep_their_unit() -> None:
    """A report said no unit, and no range in words, of a terrain that had lost it."""
    terrain = replace(bowl(), units=("metre",))
    found = SurfaceFlattenWater(terrain=terrain, water=pond()).run()
    assert found.flattened.units == ("metre",)


def test_the_largest_raise_is_told_in_the_unit_of_the_data() -> None:
    feet = CRS(2263)
    terrain = replace(bowl(), crs=feet)
    found = SurfaceFlattenWater(terrain=terrain, water=pond(crs=feet)).run()
    assert found.largest_raise == pytest.approx(1200 / 3937)
    assert "by at most 1.00 US ft." in found.in_words()


def test_water_that_is_not_there_or_elsewhere_is_told(caplog: pytest.LogCaptureFixture) -> None:
    elsewhere = Vector(pond().frame.translate(1000.0).to_frame("geometry").assign(level=10.0))
    nothing = Vector(pond().frame.iloc[:0])
    for water, says in ((nothing, ""), (elsewhere, "1 of 1 bodies of water hold no cell")):
        found = SurfaceFlattenWater(terrain=bowl(), water=water).run()
        assert found.bodies == 0
        assert found.in_words() == "No water lies on the terrain: it is as it was."
        assert says in caplog.text
        assert bool(caplog.text) == bool(says), "a survey without water needs no warning"
    found = SurfaceFlattenWater(terrain=bowl(), water=pond()).run()
    assert (found.bodies, found.in_words()[:18]) == (1, "The water is level")


def test_lower_ground_beyond_the_shore_stays() -> None:
    z = bowl().band().copy()
    z[3:7, 7:] = 9.0  # a valley that runs off to the east
    found = SurfaceFlattenWater(terrain=raster(z), water=pond(), shore=2.0).run().flattened.band()
    assert (found[3:7, 7:9] == 10.0).all()
    assert (found[3:7, 9:] == 9.0).all()


def test_a_river_is_laid_as_the_plane_through_its_vertices() -> None:
    """A canal of one level is right at one place of a river only, and a dam at its ends."""
    across = shapely.box(WEST, NORTH - 12, WEST + 20, NORTH - 8)
    ring = shapely.get_coordinates(across)
    banks = shapely.Polygon(np.column_stack([ring, 8 + 0.1 * (ring[:, 0] - WEST)]))
    frame = geopandas.GeoDataFrame({"level": [9.0], "slope": [0.1]}, geometry=[banks], crs=UTM)
    ground = raster(np.full((20, 20), 12.0))
    found = SurfaceFlattenWater(terrain=ground, water=Vector(frame)).run().flattened.band()
    expected = np.tile(8 + 0.1 * (np.arange(20) + 0.5), (4, 1))
    np.testing.assert_allclose(found[8:12], expected, atol=1e-5)
    level = SurfaceFlattenWater(terrain=ground, water=Vector(frame.assign(slope=0.0))).run()
    assert (level.flattened.band()[8:12] == 9.0).all(), "a lake, whose vertices were not levelled"
    given = SurfaceFlattenWater(terrain=ground, water=Vector(frame), level=7.0).run()
    assert (given.flattened.band()[8:12] == 7.0).all()
    assert given.laid.frame[["level", "slope"]].to_numpy().tolist() == [[7.0, 0.0]]
    assert "Rivers among it are not level" not in given.in_words()
    fallen = SurfaceFlattenWater(terrain=ground, water=Vector(frame)).run()
    assert "Rivers among it are not level" in fallen.in_words()


def test_a_given_level_is_that_of_all_water() -> None:
    found = SurfaceFlattenWater(terrain=bowl(), water=pond(), level=11.0).run()
    assert (found.flattened.band()[3:7, 3:7] == 11.0).all()


def test_no_shore_is_raised_where_none_is_wanted() -> None:
    found = SurfaceFlattenWater(terrain=bowl(), water=pond(), shore=0.0).run()
    assert found.raised == 0
    assert found.flattened.band()[2, 2] == 9.0


def test_levels_must_be_known() -> None:
    water = pond()
    bare = Vector(water.frame.drop(columns="level"), name="w.gpkg")
    with pytest.raises((DataError, ParameterError), match="has no attribute level, and no heights"):
        SurfaceFlattenWater(terrain=bowl(), water=bare).run()
    with pytest.raises(DataError, match="a polygon has no level"):
        SurfaceFlattenWater(terrain=bowl(), water=pond(np.nan)).run()


def bank(west: float, east: float, heights: tuple[float, float]) -> shapely.Polygon:
    """A reach of a river from west to east, 4 m wide, with heights at its ends."""
    ring = shapely.get_coordinates(shapely.box(WEST + west, NORTH - 12, WEST + east, NORTH - 8))
    along = (ring[:, 0] - WEST - west) / (east - west)
    z = heights[0] + along * (heights[1] - heights[0])
    return shapely.Polygon(np.column_stack([ring, z]))


def layer(*shapes: shapely.Polygon, **attributes: list[Any]) -> Vector:
    return Vector(geopandas.GeoDataFrame(attributes, geometry=list(shapes), crs=UTM))


def test_known_water_is_laid_beside_what_was_found(caplog: pytest.LogCaptureFixture) -> None:
    """Two of the four pools of a river were not found, and there was no way to give them."""
    ground = raster(np.full((20, 20), 12.0))
    found = layer(bank(0, 8, (9.0, 9.0)), level=[9.0], slope=[0.0])
    rapids, pool = bank(8, 12, (9.0, 7.0)), bank(12, 20, (7.0, 7.0))
    known = layer(rapids, pool)
    made = SurfaceFlattenWater(terrain=ground, water=found, known=known).run()
    z = made.flattened.band()[9]
    np.testing.assert_allclose(z, [*[9] * 8, 8.75, 8.25, 7.75, 7.25, *[7] * 8], atol=1e-6)
    assert (np.diff(z) <= 0).all(), "a river does not rise on its way"
    assert made.bodies == 3
    assert made.laid.frame["evidence"].tolist()[1:] == ["known", "known"]
    assert "given as known: 2;" in made.in_words()
    assert len(caplog.records) == 1
    assert "2 known waters lie more than 1 m below the ground that was there" in caplog.text
    level = SurfaceFlattenWater(terrain=ground, water=found, known=layer(pool, level=[6.5])).run()
    assert (level.flattened.band()[9, 12:] == 6.5).all(), "an attribute, not heights left from it"


def test_known_water_takes_the_place_of_what_it_covers(caplog: pytest.LogCaptureFixture) -> None:
    ground = raster(np.full((20, 20), 12.0))
    found = layer(bank(0, 8, (9, 9)), bank(8, 20, (9, 9)), level=[9.0, 9.0])
    known = layer(bank(0, 10, (8, 8)))
    made = SurfaceFlattenWater(terrain=ground, water=found, known=known).run()
    assert "1 of 2 found waters give way to known ones" in caplog.text
    assert "water body" not in caplog.text, "they have no numbers"
    np.testing.assert_array_equal(made.flattened.band()[9], [*[8] * 10, *[9] * 10])
    assert made.laid.frame.geometry.area.tolist() == [40, 40], "what is left of the other one"
    assert "The water that was laid has 80 m² in all. " in made.in_words()
    low = SurfaceFlattenWater(terrain=ground, water=found, known=known, level=6.0).run()
    np.testing.assert_array_equal(low.flattened.band()[9], [*[8] * 10, *[6] * 10])


def test_known_water_is_numbered_after_what_was_found_and_has_its_lines() -> None:
    """Lines of the set were those of found water alone, also where it had given way."""
    ground = raster(np.full((20, 20), 12.0))
    shapes = bank(0, 8, (9, 9)), bank(8, 20, (9, 9))
    found = layer(*shapes, level=[9.0, 9.0], body=[1, 2], area=[32.0, 48.0])
    rings = [shapely.LineString(shape.exterior) for shape in shapes]
    lines = layer(*rings, body=[1, 2], kind=["shore"] * 2, level=[9.0, 9.0], length=[24.0, 32.0])
    made = SurfaceFlattenWater(
        terrain=ground, water=found, known=layer(bank(0, 10, (8, 8))), shoreline=lines
    ).run()
    assert made.laid.frame["body"].tolist() == [2, 3]
    assert made.laid.frame["area"].tolist() == [48.0, 40.0]
    assert made.laid.frame["level"].tolist() == [9.0, 8.0], "of heights that are all alike"
    assert made.laid_shoreline is not None
    drawn = made.laid_shoreline.frame
    assert set(zip(drawn["body"], drawn["kind"], drawn["level"], strict=True)) == {
        (2, "shore", 9.0),
        (3, "known", 8.0),
    }
    assert drawn["length"].sum() == pytest.approx((10 + 4 + 10) + (10 + 4) * 2)
    assert drawn.geometry.has_z.all()
    alone = SurfaceFlattenWater(terrain=ground, water=found, shoreline=lines).run().laid_shoreline
    assert alone is not None
    assert alone.frame.equals(lines.frame)


def test_known_water_of_one_height_is_no_river() -> None:
    """Heights at the vertices of a lake, and no attribute, made it fall downstream in words."""
    ground = raster(np.full((20, 20), 12.0))
    for heights, falls in (((8.0, 8.0), False), ((8.0, 7.0), True)):
        known = layer(bank(0, 10, heights))
        words = SurfaceFlattenWater(terrain=ground, water=pond(), known=known).run().in_words()
        assert ("they fall downstream" in words) == falls


BOW = shapely.Polygon(
    [(WEST, NORTH - 8), (WEST + 9, NORTH - 2), (WEST + 9, NORTH - 8), (WEST, NORTH)]
)


@pytest.mark.parametrize(
    ("known", "says"),
    [
        (layer(shapely.force_2d(bank(0, 9, (8, 8)))), "row 1 has no number in the attribute level"),
        (layer(bank(0, 9, (8, np.nan))), "row 1 has no number in the attribute level"),
        (layer(BOW, level=[8.0]), r"row 1 is no valid polygon \(Self-intersection"),
        (layer(bank(0, 9, (8, 8)), bank(5, 12, (9, 9))), "rows 1 and 2 overlap"),
        (layer(shapely.force_2d(bank(0, 9, (8, 8))), level=["8 m"]), "row 1 has no number"),
    ],
)
def test_known_water_that_cannot_be_laid_is_named(known: Vector, says: str) -> None:
    found = layer(bank(10, 20, (9, 9)), level=[9.0])
    with pytest.raises(DataError, match=f"known: {says}"):
        SurfaceFlattenWater(terrain=bowl(), water=found, known=known).run()


def test_a_pool_does_not_raise_the_lower_one_beside_it() -> None:
    """Its shore was laid five metres into the water below a weir."""
    pools = layer(bank(12, 20, (7, 7)), bank(0, 12, (9, 9)), level=[7.0, 9.0])
    made = SurfaceFlattenWater(terrain=raster(np.full((20, 20), 12.0)), water=pools).run()
    np.testing.assert_array_equal(made.flattened.band()[9], [*[9] * 12, *[7] * 8])
    assert made.raised == 0


@pytest.mark.parametrize(("half", "told"), [(0.6, True), (0.4, False), (None, False)])
def test_water_that_is_less_certain_than_contours_are_apart_is_told(
    half: float | None, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """A creek known to ± 2.73 ft was laid level among contours of 2 ft without a word."""
    water = Vector(pond().frame.assign(level_interval=[half]).astype({"level_interval": float}))
    SurfaceFlattenWater(terrain=bowl(), water=water, contour_interval=1.0).run()
    assert ("a level that is less certain (95 %) than contours" in caplog.text) == told
    assert (f"is 10.00 ± {half or 0:.2f} m" in caplog.text) == told
    caplog.clear()
    SurfaceFlattenWater(terrain=bowl(), water=water).run()
    assert "less certain" not in caplog.text, "there are no contours"


def sluice() -> tuple[Raster, Raster, Vector]:
    """Waters of 10 and 9.5 m, and between them 18 m of terrain at 9 m, of which nothing was seen.

    Returns
    -------
    terrain, ground_count, water
    """
    z, count = np.full((12, 30), 12.0), np.ones((12, 30))
    z[:, :6] = z[:, 24:] = z[3:9] = 9.0
    count[3:9] = 0
    count[5, 12] = 1  # a return from the water below the bridge
    shapes = [shapely.box(WEST + k, NORTH - 12, WEST + k + 6, NORTH) for k in (0, 24)]
    frame = geopandas.GeoDataFrame(
        {"level": [10.0, 9.5], "scatter": 0.04}, geometry=shapes, crs=UTM
    )
    return raster(z), raster(count), Vector(frame)


def test_below_a_bridge_water_goes_on_and_there_is_no_lower_terrain(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """In a sluice 451 cells lay below the waters on both sides, up to 19 m from any ground."""
    terrain, count, water = sluice()
    found = SurfaceFlattenWater(terrain=terrain, water=water, ground_count=count).run()
    z = found.flattened.band()
    assert (z[3:9, 6:11] == 10.0).all(), "the shore"
    assert (z[3:9, 11:] == 9.5).all(), "the lower of both waters"
    assert (z[:3, 6:24] == 12.0).all()
    text = "48 cells of the terrain lay below the water that they are joined to, by up to 0.50 m at"
    assert text in caplog.text
    (row,) = found.beneath.frame.to_dict("records")
    assert (row["level"], row["scatter"]) == (9.5, 0.04)
    assert row["geometry"].area == 6 * 18


@pytest.mark.parametrize("seen", [True, False])
def test_lower_land_that_is_seen_or_not_joined_to_water_stays(seen: bool) -> None:
    terrain, count, water = sluice()
    values = terrain.band().copy()
    if seen:  # as behind a dike or below a dam
        count = raster(np.ones(count.band().shape))
    else:
        values[:, [6, 23]] = 12.0
    terrain = raster(values)
    found = SurfaceFlattenWater(terrain=terrain, water=water, ground_count=count).run()
    assert (found.flattened.band()[3:9, 11:18] == 9.0).all()
    assert not len(found.beneath)


def test_cells_with_ground_must_be_those_of_the_terrain() -> None:
    terrain, count, water = sluice()
    with pytest.raises(DataError, match="ground_count: the raster covers another area"):
        SurfaceFlattenWater(terrain=terrain, water=water, ground_count=raster(count.band()[:-1]))


def test_terrain_above_all_points_is_told_with_places(caplog: pytest.LogCaptureFixture) -> None:
    """At a sluice heights of objects went down to -1.99 m, and nothing said so."""
    z = np.tile(12.0 + 0.6 * np.arange(20.0), (20, 1))
    top = z - 0.25  # within what a slope of 60 % explains
    top[15, 12] = z[15, 12] - 1.5
    terrain = raster(z)
    for surface, told in ((raster(z - 0.25), False), (raster(top), True)):
        caplog.clear()
        SurfaceFlattenWater(terrain=terrain, surface=surface, water=pond()).run()
        assert ("the terrain lies above all points" in caplog.text) == told
    assert "below 0: 1; no ground" in caplog.text
    assert f"1.50 m at {WEST + 12.5:.1f},{NORTH - 15.5:.1f}" in caplog.text
