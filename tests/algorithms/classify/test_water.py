"""classify.water: last returns near the surface of water, and nothing else."""

from __future__ import annotations

from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS
from scenes.layers import NORTH, UTM, WEST, cloud

from algorithms.classify.water import ClassifyWater
from toolbox.data import PointCloud, Vector
from toolbox.errors import DataError


def water(crs: CRS = UTM, **attributes: Any) -> Vector:
    """A square of 10 m with its south-western corner at WEST, NORTH."""
    square = shapely.box(WEST, NORTH, WEST + 10, NORTH + 10)
    return Vector(
        geopandas.GeoDataFrame({k: [v] for k, v in attributes.items()}, geometry=[square], crs=crs)
    )


def over(heights: Any, classes: Any = 2, **attributes: Any) -> PointCloud:
    """Points in a row amid the square."""
    z = np.asarray(heights, float)
    x = WEST + 1 + np.arange(len(z))
    return cloud(np.column_stack([x, np.full(len(z), NORTH + 5), z]), classes, **attributes)


def classes(points: PointCloud, layer: Vector) -> list[int]:
    found = ClassifyWater(points=points, water=layer).run().classified
    assert np.array_equal(found.xyz, points.xyz)
    return np.asarray(found["classification"]).tolist()


def test_three_times_the_scatter_of_returns_is_water() -> None:
    points = over([10.11, 9.89, 10.13])
    assert classes(points, water(level=10.0, scatter=0.04)) == [9, 9, 2]


def test_below_the_water_is_no_bank_so_troughs_are_water_and_errors_are_not() -> None:
    """On the waves of the Wadden Sea one return of 40 was left as ground below the water."""
    points = over([9.86, 9.26, 9.24])
    assert classes(points, water(level=10.0, scatter=0.04)) == [9, 9, 1]
    assert classes(over([9.1, 8.9]), water(level=10.0, scatter=0.35)) == [9, 1]


def test_no_ground_is_left_deep_below_the_water(caplog: pytest.LogCaptureFixture) -> None:
    """Gridded again, the classes of Den Oever had pits in the water; other classes stay."""
    points = over([9.0, 9.0, 9.0, 9.95], classes=[2, 7, 1, 2])
    assert classes(points, water(level=10.0, scatter=0.04)) == [1, 7, 1, 9]
    assert "1 points of ground lie deep below" in caplog.text


@pytest.mark.parametrize("told", [{}, {"scatter": None}, {"scatter": np.nan}])
def test_water_whose_scatter_nobody_knows_may_be_rough(told: dict[str, Any]) -> None:
    points = over([10.74, 9.26, 10.76, 9.24])
    assert classes(points, water(level=10.0, **told)) == [9, 9, 2, 1]


def test_rough_water_is_as_rough_in_feet() -> None:
    points = over(np.array([10.74, 10.76]) / 0.3048, crs=CRS(2263))
    assert classes(points, water(CRS(2263), level=10.0 / 0.3048)) == [9, 2]


def test_classes_that_say_what_a_point_is_stay() -> None:
    """A deck laid on the water, noise, and what is withheld."""
    points = over([10.0] * 9, [0, 1, 2, 5, 7, 17, 18, 26, 2], withheld=[0] * 8 + [1])
    assert classes(points, water(level=10.0)) == [9, 9, 9, 5, 7, 17, 18, 26, 2]


def test_pulses_that_went_on_came_from_something_above() -> None:
    points = over([10.0] * 3, return_number=[1, 2, 1], number_of_returns=[2, 2, 1])
    assert classes(points, water(level=10.0)) == [2, 9, 9]


def test_a_pulse_that_is_in_two_lists_is_one_return_and_its_places_are_within_the_halo() -> None:
    """In the list of first returns it seemed to go on; its twin may be in the next tile."""
    xyz = [[WEST + x, NORTH + 5, 10.0] for x in (4.9, 5.1, 8.0)]
    points = cloud(xyz, 2, return_number=[1, 2, 2], number_of_returns=[2, 2, 2])
    assert classes(points, water(level=10.0)) == [9, 9, 9]
    tile = points.select(np.array([True, False, True]))
    assert classes(tile, water(level=10.0)) == [2, 9]
    assert ClassifyWater(points=points, water=water(level=10.0)).halo() > 0.2


def test_beside_the_polygon_nothing_is_water_and_its_edge_is_inside() -> None:
    xyz = [[WEST + x, NORTH + 5, 10.0] for x in (-0.01, 0.0, 10.0, 10.01)]
    assert classes(cloud(xyz, 2), water(level=10.0)) == [2, 9, 9, 2]


def river() -> Vector:
    """The square as a river that falls eastwards from 12 to 11, with a level of its middle."""
    corners = [(0, 0, 12), (10, 0, 11), (10, 10, 11), (0, 10, 12)]
    shape = shapely.Polygon([(WEST + x, NORTH + y, z) for x, y, z in corners])
    told = {"level": [11.5], "slope": [0.1], "scatter": [0.02]}
    return Vector(geopandas.GeoDataFrame(told, geometry=[shape], crs=UTM))


def test_a_river_is_where_its_surface_is_at_that_place() -> None:
    x = np.arange(1, 10)
    assert classes(over(12 - x / 10), river()) == [9] * 9
    assert classes(over([11.5] * 9), river()) == [9] * 5 + [2] * 4, "below, at and above it"
    without = Vector(river().frame.drop(columns=["level", "slope"]))
    assert classes(over(12 - x / 10), without) == [9] * 9


def test_waters_have_their_own_surfaces() -> None:
    """Two basins of a lock: the water of the upper one would be land beside the lower one."""
    shapes = [shapely.box(WEST + x, NORTH, WEST + x + 4.5, NORTH + 10) for x in (0, 4.6)]
    told = {"level": [12.0, 10.0], "scatter": [0.02, 0.02]}
    both = Vector(geopandas.GeoDataFrame(told, geometry=shapes, crs=UTM))
    assert classes(over([12.0, 12, 10, 10, 12, 10, 10, 12]), both) == [9, 9, 1, 1, 2, 9, 9, 2]


def test_points_below_bridges_are_water_by_a_layer_of_their_own() -> None:
    here, elsewhere = water(level=10.0, scatter=0.04), water(level=-99.0)
    points = over([10.1, 9.9, 10.2])
    found = ClassifyWater(points=points, water=elsewhere, beneath=here).run().classified
    assert found["classification"].tolist() == [9, 9, 2]


def test_what_is_told() -> None:
    points = over([10.0, 10.0, 12.0, 13.0], [2, 1, 2, 1], confidence=np.float32([0.2, 0.3, 0.4, 1]))
    found = ClassifyWater(points=points, water=water(level=10.0)).run()
    assert found.became == 2
    assert found.ground_share == 0.25
    said = found.in_words()
    assert said.startswith("2 points, last returns from the water, became class 9 (water)")
    assert "25.0 % of the points are ground in the end" in said
    np.testing.assert_allclose(found.classified["confidence"], [1, 1, 0.4, 1])


def test_without_water_all_stays_as_it_was() -> None:
    none = Vector(water(level=10.0).frame.iloc[:0], geometry_type="Polygon")
    found = ClassifyWater(points=over([10.0, 11.0]), water=none).run()
    assert found.classified["classification"].tolist() == [2, 2]
    assert found.in_words() == "No point became class 9 (water)."


def test_water_of_another_crs_or_without_heights_is_refused() -> None:
    with pytest.raises(DataError, match="water: is in EPSG:32636"):
        ClassifyWater(points=over([10.0]), water=water(CRS(32636), level=10.0))
    with pytest.raises(DataError, match="water: a polygon has no level"):
        ClassifyWater(points=over([10.0]), water=water()).run()
