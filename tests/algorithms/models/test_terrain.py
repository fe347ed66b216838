"""models.terrain: what the file calls road or water is terrain, bridges and viaducts are not."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS

import toolbox
from toolbox import catalog
from toolbox.data import PointCloud, Raster, Vector
from toolbox.errors import ParameterError

ROAD, BRIDGE = 11, 17


def hillside() -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """A slope of 10 % with a road along its contours, and which points are road."""
    x, y = (axis.ravel() + 0.01 for axis in np.mgrid[0:90:0.5, 0:90:0.5])
    road = abs(x - 45) < 6
    return np.column_stack([x, y, 0.1 * x + 0.03 * np.sin(7 * x + 3 * y)]), road


def dtm(xyz: NDArray[np.float64], classes: NDArray[np.int64]) -> Raster:
    attributes = {"classification": classes.astype(np.uint8), "intensity": classes.astype("u2")}
    cloud = PointCloud(xyz + np.array([5e5, 4.6e6, 0.0]), attributes, crs=CRS(32635))
    found = toolbox.run("models.terrain", {"points": cloud, "denoise": False})
    kept = np.isin(classes, (ROAD, BRIDGE))
    np.testing.assert_array_equal(found["classified"]["classification"][kept], classes[kept])
    made: Raster = found["dtm"]
    return made


def test_a_road_leaves_neither_hole_nor_step() -> None:
    xyz, road = hillside()
    with_road, without = (dtm(xyz, np.where(road, kind, 1)).band() for kind in (ROAD, 1))
    assert np.isfinite(with_road).all()
    np.testing.assert_array_equal(with_road, without)
    assert abs(np.diff(with_road, axis=1) - 0.1).max() < 0.1


def test_a_bridge_is_no_terrain_whatever_its_class() -> None:
    xyz, road = hillside()
    deck = road & (abs(xyz[:, 1] - 45) < 30)
    xyz[deck, 2] += 7
    for kind in (ROAD, BRIDGE):
        assert abs(dtm(xyz, np.where(road, kind, 1)).band() - 4.5).max() < 5


def canal() -> PointCloud:
    """Flat land of 2 m with a canal at 0 m, which gives one return of 20, and grass on its bank."""
    rng = np.random.default_rng(1)
    x, y = (axis.ravel() + 0.01 for axis in np.mgrid[0:120:0.5, 0:120:0.5])
    wet = abs(x - 60 - 0.1 * y) < 10
    seen = ~wet | (rng.random(len(x)) < 0.05)
    z = np.where(wet, 0.0, 2.0) + 0.02 * rng.standard_normal(len(x))
    xyz = np.column_stack([x, y, z])[seen] + np.array([5e5, 4.6e6, 0.0])
    brightness = np.where(wet, 10, 200)[seen].astype("u2")
    return PointCloud(xyz, {"intensity": brightness}, crs=CRS(32635))


def test_water_is_level_in_the_terrain_and_below_what_stands_on_it() -> None:
    """Triangles between the shores of a canal looked like measured ground."""
    values = {"points": canal(), "denoise": False, "image": False}
    found, as_it_was = (
        toolbox.run("models.terrain", {**values, "level_water": water}) for water in (True, False)
    )
    flat, rough = (one["dtm"].band()[60, 40:80] for one in (found, as_it_was))
    middle = slice(20, 32)  # of 60 to 70 m along this row
    assert np.ptp(flat[middle]) == 0
    assert abs(flat[middle][0]) < 0.05
    assert np.ptp(rough[middle]) > 0.02
    assert len(found["water_bodies"]) == 1
    assert as_it_was["water_bodies"] is None
    top, objects = found["dsm"].band(), found["ndsm"].band()
    assert np.isnan(as_it_was["dsm"].band()[60, 40:80][middle]).any()
    assert np.isfinite(top[60, 40:80][middle]).all(), "no holes over the water"
    assert abs(objects[60, 40:80][middle]).max() < 0.1
    np.testing.assert_allclose(objects, top - found["dtm"].band(), atol=1e-5)


def wet(points: PointCloud) -> NDArray[np.bool_]:
    """The returns from the canal, half a metre and more from its banks."""
    x, y = (points[axis] - origin for axis, origin in (("x", 5e5), ("y", 4.6e6)))
    return np.asarray(abs(x - 60 - 0.1 * y) < 9.5)


def with_named(points: PointCloud) -> PointCloud:
    """The canal with a bridge across, boats that nobody named, and returns of class 26."""
    above = points.xyz[wet(points)][::9] + np.array([0, 0, 1.5])
    y = points["y"] - 4.6e6
    classes = np.where(wet(points) & (abs(y - 60) < 2), 26, 1)
    xyz = np.vstack([points.xyz, above])
    attributes = {
        "classification": np.append(classes, np.ones(len(above))).astype(np.uint8),
        "intensity": np.append(points["intensity"], np.full(len(above), 200)).astype("u2"),
    }
    return PointCloud(xyz, attributes, crs=points.crs)


def test_last_returns_from_water_that_was_laid_are_class_9() -> None:
    """They had stayed ground, which contracts of mapping ask to be told apart."""
    points = with_named(canal())
    values = {"points": points, "denoise": False, "image": False, "keep_classes": "9,26"}
    found, as_it_was = (
        toolbox.run("models.terrain", {**values, "level_water": water}) for water in (True, False)
    )
    classes, before = (one["classified"]["classification"] for one in (found, as_it_was))
    low, named = points["z"] < 0.2, points["classification"] == 26
    water = wet(points) & low & ~named
    assert water.sum() > 400
    assert (classes[water] == 9).mean() > 0.98
    assert (classes[named] == 26).all()
    assert not (classes[~low] == 9).any(), "neither boats nor banks"
    assert not (before == 9).any()
    np.testing.assert_array_equal(classes[classes != 9], before[classes != 9])
    assert found["water_points"] == (classes == 9).sum()
    assert as_it_was["water_points"] is None


def test_known_water_is_class_9_too_and_the_terrain_is_the_same_in_tiles(tmp_path: Path) -> None:
    """With a river of a map, whose heights fall along it, beside water that was found."""
    from toolbox.tiles.tiling import Tiling

    path = tmp_path / "canal.laz"
    with_named(canal()).save(path)
    corners = [(40, 60, 0.3), (95, 60, 0.3), (95, 120, -0.3), (40, 120, -0.3)]
    shape = shapely.Polygon([(5e5 + x, 4.6e6 + y, z) for x, y, z in corners])
    known = tmp_path / "known.gpkg"
    river = geopandas.GeoDataFrame({"name": ["Spey"]}, geometry=[shape], crs=32635)
    Vector(river).save(known)
    values = {"points": path, "known_water": known, "level_water": True, "image": False}
    for name, tiling in (("whole", None), ("tiled", Tiling.parse({"tile": 40, "workers": 1}))):
        files = {"classified": tmp_path / f"{name}.laz", "dtm": tmp_path / f"{name}.tif"}
        found = toolbox.run("models.terrain", {**values, **files}, tiling=tiling)
        assert found["water_points"] > 400
    whole, tiled = (PointCloud.open(tmp_path / f"{name}.laz") for name in ("whole", "tiled"))
    np.testing.assert_array_equal(whole.xyz, tiled.xyz)
    np.testing.assert_array_equal(whole["classification"], tiled["classification"])
    assert (whole["classification"] == 9).sum() == found["water_points"]
    bands = [Raster.open(tmp_path / f"{name}.tif").band() for name in ("whole", "tiled")]
    np.testing.assert_array_equal(*bands)


def test_noise_that_was_taken_out_is_counted() -> None:
    xyz, _ = hillside()
    noisy = np.vstack([xyz, [[20.3, 20.3, 90.0], [60.3, 30.3, 95.0], [70.3, 70.3, -40.0]]])
    points = PointCloud(noisy + np.array([5e5, 4.6e6, 0.0]), crs=CRS(32635))
    found = toolbox.run("models.terrain", {"points": points, "image": False})
    assert (found["low_noise"], found["high_noise"]) == (1, 2)
    assert len(found["classified"]) == len(xyz)


def test_classes_that_stay_are_told_and_can_be_named(caplog: pytest.LogCaptureFixture) -> None:
    xyz, road = hillside()
    xyz[road, 2] += 7
    classes = np.where(road, 6, 1).astype(np.uint8)
    points = PointCloud(
        xyz + np.array([5e5, 4.6e6, 0.0]), {"classification": classes}, crs=CRS(32635)
    )
    values = {"points": points, "denoise": False, "image": False}
    with caplog.at_level("INFO", "toolbox"):
        lost = toolbox.run("models.terrain", values)["classified"]["classification"]
    assert "points of class 6 become 2 on the ground and 1 elsewhere" in caplog.text
    assert not (lost == 6).any()
    caplog.clear()
    with caplog.at_level("INFO", "toolbox"):
        kept = toolbox.run("models.terrain", {**values, "keep_classes": "6"})
    assert "become 1" not in caplog.text
    assert (kept["classified"]["classification"][road] == 6).all()


def test_a_bridge_of_class_26_is_no_ground_unless_that_is_asked_for(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Points of Dutch structures became class 2, and stood in the terrain."""
    xyz, road = hillside()
    classes = np.where(road, 26, 1).astype(np.uint8)
    points = PointCloud(
        xyz + np.array([5e5, 4.6e6, 0.0]), {"classification": classes}, crs=CRS(32635)
    )
    values = {"points": points, "denoise": False, "image": False}
    kept = toolbox.run("models.terrain", values)["classified"]["classification"]
    assert (kept[road] == 26).all()
    assert f"{road.sum()} points keep class 26 and are no ground" in caplog.text
    lost = toolbox.run("models.terrain", {**values, "keep_classes": "17"})["classified"]
    assert (lost["classification"][road] == 2).mean() > 0.9
    assert "points of class 26 become ground" in caplog.text


@pytest.mark.slow
def test_the_report_of_the_set_has_the_contours_on_its_map(tmp_path: Path) -> None:
    xyz, _ = hillside()
    points = PointCloud(xyz + np.array([5e5, 4.6e6, 0.0]), crs=CRS(32635))
    values = {"points": points, "denoise": False, "image": False}
    toolbox.run("models.terrain", {**values, "deliver": tmp_path / "out"})
    text = (tmp_path / "out" / "report.html").read_text()
    data = text.partition('type="application/json">')[2].partition("</script>")[0]
    assert [layer["name"] for layer in json.loads(data)["layers"]] == ["Contours"]
    head, _, rest = text.partition("<h2>Results</h2>")
    assert head
    assert "Unit" not in rest.partition("</table>")[0], "counts have none"


def test_known_water_is_laid_in_place_of_what_was_found() -> None:
    known = geopandas.GeoDataFrame(
        {"level": [-0.5]}, geometry=[shapely.box(5e5 + 40, 4.6e6, 5e5 + 80, 4.6e6 + 120)], crs=32635
    )
    values = {"points": canal(), "denoise": False, "image": False, "level_water": True}
    found = toolbox.run("models.terrain", {**values, "known_water": Vector(known)})
    assert found["dtm"].band()[60, 60] == np.float32(-0.5)
    assert found["water_bodies"].frame["evidence"].tolist() == ["known"]


def test_known_water_that_nothing_would_lay_is_an_error_before_the_work() -> None:
    """A river of a map was read, and the terrain was as if there were none, but for a warning."""
    known = geopandas.GeoDataFrame({"level": [-0.5]}, geometry=[shapely.box(0, 0, 9, 9)], crs=32635)
    values = {"points": canal(), "known_water": Vector(known)}
    with pytest.raises(ParameterError, match="is used only with level_water") as told:
        toolbox.run("models.terrain", values)
    assert set(told.value.problems) == {"known_water"}


def test_water_that_was_laid_has_the_headings_and_units_of_water_that_was_found() -> None:
    """They were those of no tool: "level Level", with no unit."""
    fields = [
        catalog.load(tool).outputs[name]
        for tool, name in (
            ("shoreline.extract", "water"),
            ("surface.flatten_water", "laid"),
            ("models.terrain", "water_bodies"),
        )
    ]
    assert all(field.columns == fields[0].columns for field in fields)
    assert fields[2].columns["level_error"].unit == "unit"
