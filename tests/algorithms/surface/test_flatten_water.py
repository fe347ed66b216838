"""surface.flatten_water: water at its level, shores not below it, what lies lower elsewhere."""

from __future__ import annotations

from dataclasses import replace

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


def test_heights_keep_their_unit() -> None:
    """A report said no unit, and no range in words, of a terrain that had lost it."""
    terrain = replace(bowl(), units=("metre",))
    found = SurfaceFlattenWater(terrain=terrain, water=pond()).run()
    assert found.flattened.units == ("metre",)


def test_water_that_is_not_there_or_elsewhere_is_told(caplog: pytest.LogCaptureFixture) -> None:
    elsewhere = Vector(pond().frame.translate(1000.0).to_frame("geometry").assign(level=10.0))
    nothing = Vector(pond().frame.iloc[:0])
    for water, says in (
        (elsewhere, "1 of 1 bodies of water hold no cell"),
        (nothing, "there is no water to flatten"),
    ):
        found = SurfaceFlattenWater(terrain=bowl(), water=water).run()
        assert found.bodies == 0
        assert found.in_words() == "No water lies on the terrain: it is as it was."
        assert says in caplog.text
    found = SurfaceFlattenWater(terrain=bowl(), water=pond()).run()
    assert (found.bodies, found.in_words()[:18]) == (1, "The water is level")


def test_lower_ground_beyond_the_shore_stays() -> None:
    z = bowl().band().copy()
    z[3:7, 7:] = 9.0  # a valley that runs off to the east
    found = SurfaceFlattenWater(terrain=raster(z), water=pond(), shore=2.0).run().flattened.band()
    assert (found[3:7, 7:9] == 10.0).all()
    assert (found[3:7, 9:] == 9.0).all()


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
    with pytest.raises((DataError, ParameterError), match="has no attribute level"):
        SurfaceFlattenWater(terrain=bowl(), water=bare).run()
    with pytest.raises(DataError, match="a polygon has no level"):
        SurfaceFlattenWater(terrain=bowl(), water=pond(np.nan)).run()
