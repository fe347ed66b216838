"""classify.urban and models.urban_classes: known scenes, water, real cities, bad input."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS

import toolbox
from algorithms.classify import _evidence
from algorithms.classify.urban import ClassifyUrban
from algorithms.samples.scene import SamplesScene
from toolbox import catalog
from toolbox.context import Context
from toolbox.data import PointCloud, Vector
from toolbox.errors import DataError, NothingToDo, ParameterError

UTM = CRS(32635)


def block(*, seed: int = 0) -> PointCloud:
    """50 x 40 m of lawn with a tree, hedges of 1 and 0.4 m, a car, a roof and a pond; truth."""
    rng = np.random.default_rng(seed)
    n = 16_000
    x, y = rng.uniform((0, 0), (50, 40), (n, 2)).T
    z, truth, count = rng.normal(0, 0.02, n), np.full(n, 2), np.ones(n, int)
    for cls, where, low, high in [
        (5, np.hypot(x - 10, y - 10) < 5, 1.6, 12),
        (4, abs(y - 20) < 1, 0.5, 1.4),
        (3, abs(y - 25) < 1, 0.25, 0.45),
    ]:
        plant = where & (rng.random(n) < 0.9)
        z[plant], truth[plant], count[plant] = rng.uniform(low, high, plant.sum()), cls, 2
    car = (abs(x - 40) < 2.2) & (abs(y - 10) < 1)
    roof = (abs(x - 40) < 5) & (abs(y - 33) < 4)
    for cls, where, height in [(1, car, 1.5), (6, roof, 7.0)]:
        z[where], truth[where] = height + rng.normal(0, 0.02, where.sum()), cls
    truth[(np.hypot(x - 10, y - 34) < 4) & (truth == 2)] = 9
    classes = np.where(np.isin(truth, (2, 6)), truth, 1)
    classes[truth == 9] = 2
    return PointCloud(
        np.column_stack([x + 500_000, y + 4_600_000, z + 50]),
        {
            "classification": classes.astype(np.uint8),
            "number_of_returns": count.astype(np.uint8),
            "return_number": np.where(count > 1, rng.integers(1, 3, n), 1).astype(np.uint8),
            "truth": truth.astype(np.uint8),
        },
        crs=UTM,
        name="block.laz",
    )


def pond(**columns: Any) -> Vector:
    shape = shapely.Point(500_010, 4_600_034).buffer(4, quad_segs=64)
    return Vector(geopandas.GeoDataFrame(columns, geometry=[shape], crs=UTM), name="pond.gpkg")


def recalls(out: Any) -> dict[int, float]:
    """Share of the points of each class that have it."""
    found, truth = out.classified["classification"], out.classified["truth"]
    return {int(k): float((found[truth == k] == k).mean()) for k in np.unique(truth)}


def test_each_class_is_found() -> None:
    out = ClassifyUrban(points=block(), water=pond()).run()
    found = recalls(out)
    assert found[2] == found[6] == 1
    assert found[9] > 0.999
    assert found[5] > 0.99
    assert found[4] > 0.95
    assert found[3] > 0.95
    assert found[1] > 0.95
    classes, confidence = out.classified["classification"], out.classified["confidence"]
    assert out.vegetation_share == np.isin(classes, (3, 4, 5)).mean()
    assert out.water_share == (classes == 9).mean()
    assert (confidence[np.isin(classes, (2, 9))] == 1).all()
    assert confidence.min() >= 0
    assert confidence[classes == 5].mean() > 0.5


def test_noise_beyond_what_planes_are_allowed_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """The ground scatters as much as roofs do; with a tolerance to suit there is nothing to say."""
    points = block()
    ClassifyUrban(points=points).run()
    assert "scatter" not in caplog.text
    shaken = np.random.default_rng(2).normal(0, 0.09, len(points))
    noisy = points.with_xyz(points.xyz + shaken[:, None] * (0, 0, 1))
    ClassifyUrban(points=noisy, flat=0.06).run()
    assert "points on the ground scatter by 0.09 m about the planes around them" in caplog.text
    assert "a tool with `flat` needs some 0.14 m" in caplog.text
    caplog.clear()
    ClassifyUrban(points=noisy, flat=0.14).run()
    assert "scatter" not in caplog.text
    assert recalls(ClassifyUrban(points=noisy).run())[1] > 0.95
    assert "points may be up to 0.1" in caplog.text


def test_what_lets_no_pulse_through_may_be_left_unclassified(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A mast is as rough as a tree, and the laser does not get through it."""
    points = block()
    mast = np.flatnonzero(np.hypot(*(points.xyz[:, :2] - (500_028, 4_600_010)).T) < 2)
    xyz, truth = points.xyz.copy(), points["truth"].copy()
    xyz[mast, 2] = 50 + np.random.default_rng(1).uniform(1, 15, len(mast))
    classes = np.where(np.isin(np.arange(len(points)), mast), 1, points["classification"])
    truth[mast] = 1
    points = points.with_xyz(xyz).with_attributes(
        {"truth": truth, "classification": classes.astype(np.uint8)}
    )
    asked = ClassifyUrban(points=points, penetration=0.25).run().classified["classification"]
    plain = ClassifyUrban(points=points).run().classified["classification"]
    assert (plain[mast] == 1).mean() < 0.3
    assert (asked[mast] == 1).mean() > 0.95
    assert (asked[truth == 5] == 5).mean() > 0.99
    single = points.with_attributes({"number_of_returns": np.ones(len(points), np.uint8)})
    caplog.clear()
    none = ClassifyUrban(points=single, penetration=0.25).run()
    assert none.vegetation_share == 0
    assert "vegetation that the file does not name cannot be told, and stays class 1" in caplog.text


def test_points_that_take_no_part_keep_their_confidence() -> None:
    points = block()
    wire = np.arange(len(points)) < 100
    classes = np.where(wire, 14, points["classification"]).astype(np.uint8)
    sure = np.full(len(points), 0.625, np.float32)
    points = points.with_attributes({"classification": classes, "confidence": sure})
    found = ClassifyUrban(points=points).run().classified["confidence"]
    assert (found[wire] == 0.625).all()
    assert (found[points["classification"] == 2] == 1).all()


def test_heights_that_points_have_are_taken() -> None:
    """By the points' own heights the hedge of 1 m is 3 m high; no terrain is made."""
    points = block()
    height = np.where(points["truth"] == 4, 3.0, points.xyz[:, 2] - 50).astype(np.float32)
    out = ClassifyUrban(points=points.with_attributes({"HeightAboveGround": height})).run()
    assert (out.classified["classification"][points["truth"] == 4] == 5).mean() > 0.95


def test_no_points_give_no_points() -> None:
    assert len(ClassifyUrban(points=block().select([])).run().classified) == 0


def test_heights_part_the_vegetation() -> None:
    out = ClassifyUrban(points=block(), low=0.2, high=1.45).run()
    classes, truth = out.classified["classification"], out.classified["truth"]
    assert (classes[truth == 3] == 4).mean() > 0.95
    assert not (classes == 3).any()
    feet = block()
    feet = feet.with_xyz(feet.xyz * 3937 / 1200).with_crs(CRS(2263))
    metres = ClassifyUrban(points=block()).run().classified["classification"]
    same = ClassifyUrban(points=feet).run().classified["classification"] == metres
    assert same.mean() > 0.999


def test_water_is_low_and_sure() -> None:
    points = block()
    boat = np.flatnonzero(points["truth"] == 9)[:40]
    xyz = points.xyz.copy()
    xyz[boat, 2] += 2.0
    classes = points["classification"].copy()
    classes[boat] = 1
    raised = points.with_xyz(xyz).with_attributes({"classification": classes})
    out = ClassifyUrban(points=raised, water=pond(evidence=["few returns, level"])).run()
    found = out.classified["classification"]
    assert not (found[boat] == 9).any()
    assert (found == 9).sum() > 300
    square = ClassifyUrban(points=points, water=pond(evidence=["level"])).run()
    assert square.water_share == 0


def test_bad_input_is_named() -> None:
    points = block()
    with pytest.raises(ParameterError, match=r"low: must be <= high \(1\.5\), got 2"):
        ClassifyUrban(points=points, low=2.0)
    bare = PointCloud(points.xyz, crs=UTM, name="bare.laz")
    with pytest.raises(DataError, match=r"bare\.laz has no classification; classify ground first"):
        ClassifyUrban(points=bare).run()
    far = Vector(
        geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)], crs=2154), name="f.gpkg"
    )
    with pytest.raises(DataError, match=r"water: f\.gpkg is in EPSG:2154"):
        ClassifyUrban(points=points, water=far).run()
    raw = points.with_attributes({"classification": np.ones(len(points), np.uint8)})
    with pytest.raises(
        NothingToDo, match="none is of class 2,9-11; classify ground first"
    ) as error:
        ClassifyUrban(points=raw).run()
    assert error.value.instead.rest_share == 1


def agreement(found: NDArray[Any], truth: NDArray[Any]) -> tuple[float, float, float, float]:
    """Overall accuracy and IoU of ground, building, vegetation, among points of these classes."""
    known = np.isin(truth, (2, 3, 4, 5, 6))

    def joint(classes: NDArray[Any]) -> NDArray[Any]:
        return np.where(np.isin(classes, (3, 4, 5)), 5, classes)[known]

    one, other = joint(found), joint(truth)
    each = [
        ((one == k) & (other == k)).sum() / ((one == k) | (other == k)).sum() for k in (2, 6, 5)
    ]
    return float((one == other).mean()), *map(float, each)


def modelled(points: PointCloud, **settings: Any) -> Any:
    """The model on points whose classes it does not know."""
    bare = points.with_attributes({"classification": np.zeros(len(points), np.uint8)})
    return toolbox.run("models.urban_classes", {"points": bare, **settings})


@pytest.mark.parametrize("name", ["classify.urban", "models.urban_classes"])
def test_noise_and_classes_that_stay_are_said(name: str) -> None:
    """The README of a set knew of classes 1 to 6 and 9 only."""
    said = catalog.load(name).outputs["classified"].help
    assert "7, 18" in said
    assert "classes that stay" in said


@pytest.mark.slow
def test_a_town_from_raw_points() -> None:
    made = SamplesScene(kind="town", size=200.0, density=8.0).run()
    found = modelled(made.points)
    classes, truth = found["classified"]["classification"], made.points["classification"]
    overall, ground, building, plants = agreement(classes, truth)
    assert overall > 0.95
    assert ground > 0.94
    assert building > 0.98
    assert plants > 0.75
    assert (classes[truth == 9] == 9).mean() > 0.9
    assert len(found["outlines"]) == (made.features.frame.kind == "building").sum()


def test_steps_share_what_they_look_at(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def counted(name: str, inner: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            calls.append(name)
            return inner(*arguments, **options)

        return call

    for name in ("find_terrain", "covariance_features", "means_around"):
        monkeypatch.setattr(_evidence, name, counted(name, getattr(_evidence, name)))
    shared = modelled(block(), water=False)
    assert sorted(calls) == ["covariance_features", "find_terrain", "means_around"]
    monkeypatch.setattr(Context, "keeping", lambda ctx: ctx)
    alone = modelled(block(), water=False)
    assert calls.count("find_terrain") == 4
    for name in ("classification", "confidence"):
        np.testing.assert_array_equal(shared["classified"][name], alone["classified"][name])


def test_what_is_around_is_known_above_known_ground_alone() -> None:
    x, y = (axis.ravel() / 2 for axis in np.mgrid[:40, :40])
    roof = (abs(x - 10) < 4) & (abs(y - 10) < 4)
    xyz = np.column_stack([x, y, np.where(roof, 5.0, 0.0)])
    cloud = PointCloud(xyz, {"classification": np.where(roof, 1, 2).astype(np.uint8)})
    for classes, known in (((2,), roof), (None, np.ones(len(roof), bool))):
        around = _evidence.PointFeatures(cloud, 1.0, 3.0, ground_classes=classes).around
        for name in ("planarity", "roughness", "returns"):
            np.testing.assert_array_equal(np.isfinite(around[name]), known)
        assert around["planarity"][roof].min() > 0.9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("77050_627755", (0.97, 0.97, 0.95, 0.95)),
        ("77055_627755", (0.97, 0.97, 0.95, 0.80)),
        ("77060_627760", (0.91, 0.93, 0.86, 0.74)),
    ],
)
def test_real_tiles(name: str, least: tuple[float, ...], data: Callable[[str], Path]) -> None:
    points = PointCloud.open(data("ign_urban_50m") / f"{name}.laz")
    classes = modelled(points, water=False)["classified"]["classification"]
    found = agreement(classes, points["classification"])
    assert all(value > limit for value, limit in zip(found, least, strict=True)), found
