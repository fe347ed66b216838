"""points.profile: chainages and offsets by hand, cross-sections, drawings to scale, units."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import ezdxf
import geopandas
import matplotlib.image
import numpy as np
import pytest
import shapely
from pyproj import CRS
from scenes.layers import NORTH, UTM, WEST, cloud

import toolbox
from algorithms.points.profile import PointsProfile, across, medians
from toolbox.data import Drawing, PointCloud, Survey, Vector
from toolbox.data.drawing import Panel
from toolbox.data.record import read_record
from toolbox.errors import DataError, ParameterError

BEND = [(0, 0), (100, 0), (100, 50)]  # metres from the corner
CORNER = np.array([WEST, NORTH, 0.0])
FOOT = 1200 / 3937


def line(*corners: Any, crs: CRS | None = UTM, unit: float = 1.0) -> Vector:
    shapes = [shapely.LineString((np.array(c, float) + CORNER[:2]) / unit) for c in corners]
    return Vector(geopandas.GeoDataFrame(geometry=shapes, crs=crs), name="axis.gpkg")


def at(*places: tuple[float, float, float], classes: Any = 2) -> PointCloud:
    return cloud(np.array(places) + CORNER, classes)


def slope(seed: int = 0, count: int = 20_000) -> PointCloud:
    """Ground that rises by a tenth to the east, with a wall of another class."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((-20, -30, 0), (130, 80, 0), (count, 3))
    xyz[:, 2] = 5 + xyz[:, 0] / 10
    wall = (abs(xyz[:, 0] - 60) < 3) & (abs(xyz[:, 1]) < 8)
    xyz[wall, 2] += rng.uniform(0, 6, wall.sum())
    return cloud(xyz + CORNER, np.where(wall, 6, 2))


def test_chainage_and_offset_by_hand() -> None:
    points = at(
        (30, 0.5, 1), (30, -0.5, 2), (99.6, 20, 3), (30, 2, 4), (-0.3, 0, 5), (100.3, 50, 6)
    )
    found = PointsProfile(points=points, line=line(BEND), width=2.0).run().section
    assert found["z"].tolist() == [1, 2, 3, 6]
    np.testing.assert_allclose(found["chainage"], [30, 30, 120, 150], atol=1e-3)
    np.testing.assert_allclose(found["offset"], [0.5, -0.5, 0.4, -0.3], atol=1e-3)
    assert set(found["section"]) == {1}


def test_cross_sections_run_from_left_to_right() -> None:
    points = at((40, 9, 1), (40, -9, 2), (40, 11, 3), (60, 0, 4), (100, 25, 5), (40.4, 1, 6))
    job = PointsProfile(points=points, line=line(BEND), width=1.0, every=20.0, length=20.0)
    result = job.run()
    found = dict(zip(result.section["z"], result.section["chainage"], strict=True))
    assert found == pytest.approx({1: 1.0, 2: 19.0, 4: 10.0, 6: 9.0}, abs=1e-3)
    assert result.count == 8
    sections = dict(zip(result.section["z"], result.section["section"], strict=True))
    assert sections == {1: 3, 2: 3, 4: 4, 6: 3}
    offset = result.section["offset"][result.section["z"] == 6]
    assert offset == pytest.approx(0.4, abs=1e-3)  # ahead along the line is left of left to right
    assert [panel.origin for panel in result.drawing.panels] == [-10.0] * 8
    assert result.without_points == 6


def test_a_point_in_two_sections_is_there_twice() -> None:
    job = PointsProfile(points=at((1, 0, 7.0)), line=line(BEND), width=4.0, every=2.0)
    assert job.run().section["section"].tolist() == [1, 2]


def test_the_last_section_may_stand_at_the_very_end() -> None:
    vertices = np.array([(0, 0), (0.1, 0), (0.3, 0)])
    assert [at for at, _, _ in across(vertices, 0.1)] == pytest.approx([0, 0.1, 0.2, 0.3])
    _, place, way = list(across(np.array(BEND, float), 60.0))[2]
    assert place.tolist() == [100, 20]
    assert way.tolist() == [0, 1]


def test_the_surface_is_that_of_the_ground() -> None:
    job = PointsProfile(
        points=slope(), line=line([(0, 0), (100, 0)]), width=4.0, piece=2.0, max_gap=9.0
    )
    (shape,) = job.run().surface.frame.geometry
    xyz = shapely.get_coordinates(shape, include_z=True) - CORNER
    np.testing.assert_allclose(xyz[:, 2], 5 + xyz[:, 0] / 10, atol=0.15)
    assert np.diff(xyz[:, 0]).max() == pytest.approx(6.0)  # across the wall
    assert len(xyz) == 48
    everything = job.run().drawing.panels[0].xy
    assert everything[:, 1].max() > 14  # the wall is drawn, too


def test_withheld_points_are_in_the_section_but_not_drawn() -> None:
    points = slope()
    high = np.arange(len(points)) % 2 == 0
    points = points.with_xyz(points.xyz + np.column_stack([0 * high, 0 * high, 90.0 * high]))
    points = points.with_attributes({"withheld": high.astype(np.uint8)})
    found = PointsProfile(points=points, line=line([(0, 0), (100, 0)]), width=4.0).run()
    assert found.section["withheld"].any()
    assert found.drawing.panels[0].xy[:, 1].max() < 40
    (shape,) = found.surface.frame.geometry
    assert shapely.get_coordinates(shape, include_z=True)[:, 2].max() < 40


def test_gaps_are_not_drawn_across() -> None:
    chainage = np.array([0.1, 0.2, 0.6, 8.1, 8.6])
    found = medians(chainage, np.array([1.0, 3.0, 4, 5, 6]), 0.5, 5.0)
    assert [part.tolist() for part in found] == [
        [[0.25, 2.0], [0.75, 4.0]],
        [[8.25, 5.0], [8.75, 6.0]],
    ]
    assert len(medians(chainage, np.ones(5), 0.5, 8.0)) == 1


def test_a_survey_gives_what_a_cloud_gives(tmp_path: Path) -> None:
    points = slope()
    east = points.xyz[:, 0] > WEST + 42
    points.select(~east).save(tmp_path / "a.laz")
    points.select(east).save(tmp_path / "b.copc.laz")
    whole = PointCloud.open(tmp_path)
    how: dict[str, Any] = {"line": line(BEND), "width": 2.0}
    one, other = (
        PointsProfile(points=given, **how).run().section for given in (whole, Survey.open(tmp_path))
    )
    np.testing.assert_array_equal(np.sort(one.xyz, axis=0), np.sort(other.xyz, axis=0))
    assert len(one) > 100


def test_feet_are_cut_as_metres() -> None:
    points = slope()
    in_feet = points.with_xyz(points.xyz / FOOT).with_crs(CRS(2263))
    how: dict[str, Any] = {"width": 2.0, "every": 20.0, "length": 30.0}
    one = PointsProfile(points=points, line=line(BEND), **how).run()
    there = line(BEND, crs=CRS(2263), unit=FOOT)
    other = PointsProfile.spec.build({"points": in_feet, "line": there, **how}).run()
    assert len(one.section) == pytest.approx(len(other.section), abs=3)
    assert one.drawing.chosen_scale == other.drawing.chosen_scale
    assert [p.title for p in one.drawing.panels] == [p.title for p in other.drawing.panels]


def test_the_scale_fits_a_sheet_in_width_and_in_height() -> None:
    """A sheet A3 has 380 x 240 mm for a section: 70 m at 1:200, or 200 m of height at 1:1000."""
    xy = np.array([[0.0, 0.0], [70.0, 40.0]])
    panel = Panel("A", 70.0, 0.0, xy, np.zeros(2, int))
    sheet = Drawing("Road", (panel,), (("Ground", "#c2a477"),))
    assert sheet.chosen_scale == 200
    assert dataclasses.replace(sheet, exaggeration=5.0).chosen_scale == 1000
    steep = dataclasses.replace(panel, xy=xy * [1, 5])
    assert dataclasses.replace(sheet, panels=(steep,)).chosen_scale == 1000


def drawn(tmp_path: Path, name: str, **more: Any) -> Path:
    slope().save(tmp_path / "a.laz", overwrite=True)
    line(BEND).save(tmp_path / "axis.gpkg", overwrite=True)
    values = {"points": tmp_path / "a.laz", "line": tmp_path / "axis.gpkg", "width": 2.0}
    toolbox.run("points.profile", {**values, "drawing": tmp_path / name, **more}, overwrite=True)
    return tmp_path / name


def test_a_page_is_as_long_as_its_section_at_the_scale(tmp_path: Path) -> None:
    text = drawn(tmp_path, "a.pdf", paper_scale=500, every=50.0, length=60.0).read_bytes()
    boxes = re.findall(rb"/MediaBox \[\s*([\d. ]+)\]", text)
    assert len(boxes) == 4
    width = float(boxes[0].split()[2]) * 25.4 / 72
    assert width == pytest.approx(60_000 / 500 + 28, abs=0.1)  # and the margins
    assert b"CreationDate" not in text  # of the file, which is the same tomorrow
    assert "points.profile" in read_record(tmp_path / "a.pdf")


def test_heights_are_exaggerated(tmp_path: Path) -> None:
    plain = matplotlib.image.imread(drawn(tmp_path, "a.png", paper_scale=500))
    tall = matplotlib.image.imread(drawn(tmp_path, "b.png", paper_scale=500, exaggeration=4.0))
    assert plain.shape[1] == tall.shape[1] == int((150_000 / 500 + 28) / 25.4 * 200)
    assert tall.shape[0] - plain.shape[0] > 3 * 10_000 / 500 / 25.4 * 200
    assert "points.profile" in read_record(tmp_path / "a.png")


def test_drawings_are_the_same_to_the_byte(tmp_path: Path) -> None:
    for name in ("a.svg", "a.pdf", "a.png", "a.dxf"):
        assert drawn(tmp_path, name).read_bytes() == drawn(tmp_path, name).read_bytes(), name


def test_a_dxf_has_units_layers_and_heights_as_they_are(tmp_path: Path) -> None:
    drawing = ezdxf.filemanagement.readfile(drawn(tmp_path, "a.dxf"))
    assert drawing.units == 6
    space = drawing.modelspace()
    points = np.array([e.dxf.location for e in space.query("POINT[layer=='Building']")])
    assert points[:, 0] == pytest.approx(60, abs=3.1)
    assert points[:, 1].max() > 14
    surface, _ = space.query("LWPOLYLINE[layer=='Surface']")
    assert surface.get_points()[0][1] == pytest.approx(5, abs=0.2)
    assert len(space.query("TEXT")) == 1


def test_points_of_a_dxf_are_whole_entities(tmp_path: Path) -> None:
    path = drawn(tmp_path, "a.dxf", every=50.0, length=40.0)
    drawing = ezdxf.filemanagement.readfile(path)
    points = drawing.modelspace().query("POINT")
    values = {"width": 2.0, "every": 50.0, "length": 40.0}
    found = PointsProfile(points=slope(), line=line(BEND), **values).run().section
    assert len(points) == len(found) > 100
    handles = re.findall(r"\n(?:  5|105)\n([0-9A-F]+)\n330\n", path.read_text())
    assert len(set(handles)) == len(handles) > len(points)
    assert not drawing.audit().errors
    kinds = [made.dxf.name for made in drawing.classes]
    assert kinds[:4] == sorted(kinds[:4])  # whatever the seed of hashes


def test_each_of_many_sections_has_the_points_that_it_has_alone() -> None:
    points = slope()
    bends = [[(x + 3 * np.sin(y / 4), y) for y in range(-40, 90, 3)] for x in range(-10, 120, 7)]
    many = PointsProfile(points=points, line=line(*bends), width=9.0).run().section
    for number, bend in enumerate(bends, start=1):
        alone = PointsProfile(points=points, line=line(bend), width=9.0).run().section
        there = many.select(many["section"] == number)
        assert len(alone) > 500
        for name in ("x", "y", "z", "chainage", "offset"):
            assert there[name].tolist() == alone[name].tolist()


def test_sections_of_a_dxf_stand_below_each_other(tmp_path: Path) -> None:
    drawing = ezdxf.filemanagement.readfile(drawn(tmp_path, "a.dxf", every=50.0, length=40.0))
    frames = drawing.modelspace().query("LWPOLYLINE[layer=='Frame']")
    lows = [frame.get_points()[1][1] for frame in frames]
    highs = [frame.get_points()[0][1] for frame in frames]
    assert len(lows) == 4
    assert all(high < low for low, high in zip(lows, highs[1:], strict=False))
    texts = [text.dxf.text for text in drawing.modelspace().query("TEXT")]
    assert texts[0] == "At 0+000.00"
    assert re.fullmatch(r"At 0\+050\.00, heights less \d+\.\d{3}", texts[1])


def test_what_is_too_large_for_paper_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"would be 15\.0 m wide"):
        drawn(tmp_path, "a.svg", paper_scale=10)
    with pytest.raises(DataError, match="makes 15001 sections, more than 2000"):
        drawn(tmp_path, "a.svg", every=0.01)
    assert not (tmp_path / "a.svg").exists()


def test_lines_are_asked_for() -> None:
    square = Vector(geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)], crs=UTM))
    with pytest.raises(DataError, match="line: must be lines, the layer holds a Polygon"):
        PointsProfile(points=slope(), line=square)
    with pytest.raises(DataError, match="have no length"):
        PointsProfile(points=slope(), line=line([(1, 1), (1, 1)])).run()
    with pytest.raises(ParameterError, match="width: must be"):
        PointsProfile(points=slope(), line=line(BEND), width=0.0)


def test_a_drawing_is_not_read(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="written, not read"):
        Drawing.open(tmp_path / "a.pdf")
