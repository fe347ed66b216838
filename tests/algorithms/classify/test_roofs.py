"""Attributes of buildings: heights of the main roof, its form, identity, confidence, density."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from scenes.layers import cloud

from algorithms.classify import _density
from algorithms.classify._density import Lengths, spacing
from algorithms.classify._roofs import Roof, form, main_section
from algorithms.classify.buildings import ClassifyBuildings
from algorithms.ground.classify import GroundClassify
from algorithms.samples.scene import SamplesScene
from algorithms.shared.places import once_each
from toolbox.data import PointCloud

Floats = NDArray[np.float64]
Surface = Callable[[Floats, Floats], Floats]

A, B, SLOPE = 7.0, 5.0, 0.7  # half sides and slope of the roofs below


def side_roof(x: Floats, y: Floats) -> Floats:
    return 4 + SLOPE * (B - abs(y))


SHAPES: dict[str, Surface] = {
    "flat": lambda x, y: 6 + 0.02 * x,
    "monopitch": lambda x, y: 4 + 0.3 * (y + B),
    "gable": side_roof,
    "hip": lambda x, y: np.minimum(side_roof(x, y), 4 + SLOPE * (A - abs(x))),
}


def lot(*more: Floats, surface: Surface = SHAPES["flat"], density: float = 10.0) -> PointCloud:
    """40 x 40 m with a house of 14 x 10 m in the middle; further points are of walls and so on."""
    rng = np.random.default_rng(0)
    count = int(1600 * density)
    x, y = rng.uniform(-20, 20, (count, 2)).T
    house = (abs(x) < A) & (abs(y) < B)
    z = np.where(house, surface(x, y), 0.0) + rng.normal(0, 0.02, count)
    xyz = np.vstack([np.column_stack([x, y, z]), *more])
    classes = np.r_[np.where(house, 1, 2), np.ones(len(xyz) - count, int)]
    columns = {name: np.ones(len(xyz), np.uint8) for name in ("return_number", "number_of_returns")}
    columns["number_of_returns"][0] = 2
    return cloud(xyz + np.array([500_000, 4_600_000, 100]), classes, **columns)


def the_row(points: PointCloud, **settings: Any) -> dict[str, Any]:
    (row,) = ClassifyBuildings(points=points, **settings).run().outlines.frame.to_dict("records")
    return row


@pytest.mark.parametrize("name", list(SHAPES))
@pytest.mark.parametrize("turn", [0.0, 35.0])
def test_the_form_of_a_roof_is_told_in_any_direction(name: str, turn: float) -> None:
    points = lot(surface=SHAPES[name])
    shapes = shapely.MultiPoint(points.xyz[:, :2])
    xy = shapely.get_coordinates(shapely.affinity.rotate(shapes, turn, (500_000, 4_600_000)))
    row = the_row(points.with_xyz(np.column_stack([xy, points.xyz[:, 2]])))
    assert row["form"] == name
    assert row["eave"] == pytest.approx(106 if name == "flat" else 104.3, abs=0.4)


def test_an_angle_of_two_gables_has_another_form() -> None:
    normal = np.array([[SLOPE, 0, 1], [-SLOPE, 0, 1], [0, SLOPE, 1], [0, -SLOPE, 1]])
    normal = np.repeat(normal / np.hypot(1, SLOPE), 10, axis=0)
    roof = Roof(np.zeros((40, 3)), normal)
    angle = shapely.Polygon([(0, 0), (9, 0), (9, 4), (4, 4), (4, 9), (0, 9)])
    assert form(roof, angle) == "other"
    assert form(roof, shapely.box(0, 0, 9, 9)) == "hip"
    assert form(roof.select(np.arange(40) < 20), angle) == "gable"
    assert form(Roof(np.zeros((2, 3)), np.full((2, 3), np.nan)), angle) == "unknown"


def test_walls_balconies_and_annexes_do_not_lower_the_eave() -> None:
    """The roof is flat and 16 m high; points on walls and balconies are many, and on planes."""
    rng = np.random.default_rng(1)
    wall = np.column_stack([np.full(600, A), rng.uniform(-B, B, 600), rng.uniform(2, 16, 600)])
    floors = [
        np.column_stack([rng.uniform((A, -B), (A + 1.2, B), (150, 2)), np.full(150, z)])
        for z in (3.0, 6.0, 9.0)
    ]
    annexe = np.column_stack([rng.uniform((-A, -9), (0, -B), (300, 2)), np.full(300, 3.5)])
    row = the_row(lot(wall, *floors, annexe, surface=lambda x, y: 16 + 0 * x))
    assert row["eave"] == pytest.approx(116, abs=0.1)
    assert row["ridge"] == pytest.approx(116, abs=0.1)
    assert row["form"] == "flat"


def test_a_section_ends_where_the_surface_steps() -> None:
    x, y = np.random.default_rng(0).uniform(0, 20, (4000, 2)).T
    low = x > 14
    xyz = np.column_stack([x, y, np.where(low, 6.0, 8.0) + 0.5 * y])
    normal = np.tile(np.array([0, -0.5, 1]) / np.hypot(1, 0.5), (len(x), 1))
    section = main_section(Roof(xyz, normal), 0.3)
    assert len(section.roof.xyz) == pytest.approx(np.count_nonzero(~low), rel=0.08)
    assert (section.roof.xyz[:, 0] <= 14).all()
    assert section.eave == pytest.approx(8.3, abs=0.3)
    assert section.parts == 2
    level = xyz + np.where(low, 2.0, 0.0)[:, None] * (0, 0, 1)
    assert main_section(Roof(level, normal), 0.3).parts == 1
    few = (x > 18) & (y < 4)  # 8 m²: no roof of its own
    small = xyz + np.where(low, 2.0, 0.0)[:, None] * (0, 0, 1) - few[:, None] * (0, 0, 3.0)
    assert main_section(Roof(small, normal), 0.3).parts == 1


def test_houses_that_touch_are_one_building_and_its_roofs_are_counted() -> None:
    """Two flat roofs, 16 and 12 m high, wall to wall."""
    row = the_row(lot(surface=lambda x, y: np.where(x > 0, 16.0, 12.0) + 0 * y))
    assert row["sections"] == 2
    assert the_row(lot(surface=lambda x, y: 16 + 0 * x))["sections"] == 1


def test_buildings_have_names_of_their_own_and_are_more_or_less_sure() -> None:
    made = SamplesScene(kind="town", size=100.0, density=8.0).run().points
    ground = GroundClassify(points=made).run().classified
    frame = ClassifyBuildings(points=ground).run().outlines.frame
    assert frame["id"].is_unique
    for name, shape in zip(frame["id"], frame.geometry, strict=True):
        west, south = map(int, name.split("_"))
        assert shape.distance(shapely.box(west, south, west + 1, south + 1)) == 0
    assert frame["confidence"].between(0.5, 1).all()
    roof = lot(surface=SHAPES["flat"])
    z, inside = roof.xyz[:, 2], roof.xyz[:, 2] > 104
    hole = inside & (np.random.default_rng(2).random(len(z)) < 0.05)
    classes = np.where(hole, 2, roof["classification"]).astype(np.uint8)
    xyz = np.column_stack([roof.xyz[:, :2], np.where(hole, 100.0, z)])
    leaky = roof.with_xyz(xyz).with_attributes({"classification": classes})
    assert the_row(leaky)["confidence"] < the_row(roof)["confidence"] - 0.3


# Density -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("density", "apart"), [(16.0, 0.25), (1.0, 1.0), (0.9, 1.0), (0.25, 2.0)])
@pytest.mark.parametrize("metre", [1.0, 3937 / 1200])
def test_spacing_is_that_of_last_returns(density: float, apart: float, metre: float) -> None:
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 100, (int(density * 1e4), 2))
    twice = np.vstack([np.column_stack([xy, np.full(len(xy), z)]) for z in (0.0, 8.0)])
    number = np.repeat([2, 1], len(xy)).astype(np.uint8)
    points = cloud(
        twice * metre,
        1,
        crs=CRS(32635) if metre == 1 else CRS(2263),
        return_number=number,
        number_of_returns=np.full(len(number), 2, np.uint8),
    )
    assert spacing(points) == apart
    assert spacing(points.select([])) == 1.0


def test_spacing_is_told_by_some_cells_of_many_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of points that come twice; the west, a quarter of the area, is four times as dense."""
    xyz = np.random.default_rng(0).uniform(0, (200, 200, 5), (40_000, 3))
    dense = np.random.default_rng(1).uniform(0, (50, 200, 5), (30_000, 3))
    points = PointCloud(np.vstack([xyz, dense, xyz, dense]))
    looked_at = []
    monkeypatch.setattr(
        _density, "once_each", lambda xyz: looked_at.append(len(xyz)) or once_each(xyz)
    )
    assert spacing(points) == 1.0
    monkeypatch.setattr(_density, "SAMPLE", 20_000)
    assert spacing(points) == 1.0
    assert looked_at[0] == 140_000
    assert 14_000 < looked_at[1] < 21_000


def test_spacing_is_the_same_where_stray_points_stretch_the_box() -> None:
    """Cells that are too many to be counted are sorted; empty ones count in neither way."""
    square = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0)), -1).reshape(-1, 2)
    near = np.column_stack([square, np.zeros(len(square))])
    far = np.vstack([near, [[4e5, 4e5, 0.0]]])
    beside = np.vstack([near, [[300.0, 300.0, 0.0]]])  # most cells of the box are empty
    for xyz in (near, far, beside):
        assert spacing(PointCloud(np.vstack([xyz, xyz]))) == 1.0


def test_lengths_follow_the_density_unless_they_are_given(caplog: pytest.LogCaptureFixture) -> None:
    dense, sparse = (cloud(np.random.default_rng(0).uniform(0, 60, (n, 3))) for n in (28_800, 3600))
    assert Lengths.of(dense, 0.06)[1:] == (1.0, 3.0, 1.5, 0.06, False)
    assert Lengths.of(dense)[1:] == (1.0, 3.0, 1.5, 0.06, True)
    with caplog.at_level(logging.INFO, "toolbox"):
        assert Lengths.of(sparse, 0.06) == pytest.approx((1.0, 1.75, 5.0, 2.25, 0.105, False))
    assert "points are some 1.0 m apart: radius 1.8 m, context 5 m, alpha 2.2 m" in caplog.text
    assert Lengths.of(sparse, 0.06, 1.2, None, 2.0) == (1.0, 1.2, 5.0, 2.0, 0.06, False)


def test_a_town_of_one_point_per_square_metre_is_mapped() -> None:
    scene = SamplesScene(kind="town", size=120.0, density=1.0, seed=5).run()
    made, frame = scene.points, scene.features.frame
    ground = GroundClassify(points=made).run().classified
    out = ClassifyBuildings(points=ground).run()
    found, true = (c["classification"] == 6 for c in (out.classified, made))
    assert (found & true).sum() / (found | true).sum() > 0.95
    corners, own = (
        shapely.count_coordinates(shapes.to_numpy())
        for shapes in (frame[frame.kind == "building"].geometry, out.outlines.frame.geometry)
    )
    assert own <= 1.1 * corners
    by_hand = ClassifyBuildings(points=ground, radius=1.75, context=5.0, alpha=2.25, flat=0.105)
    assert by_hand.run().building_share == out.building_share
    fixed = ClassifyBuildings(points=ground, radius=1.0, context=3.0, alpha=1.5).run()
    assert fixed.building_share < 0.6 * out.building_share
