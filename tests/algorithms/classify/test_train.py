"""classify.train: trees, training, features, and honest probabilities; applied elsewhere."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pandas
import pytest
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.classify import _evidence
from algorithms.classify._learning import columns, model, reports
from algorithms.classify._learning import features as names_of
from algorithms.classify._learning.bins import Bins
from algorithms.classify._learning.model import softmax
from algorithms.classify._learning.training import (
    Kind,
    Labelled,
    Settings,
    binned,
    folds_of,
    temperature,
    trained,
)
from algorithms.classify.apply import ClassifyApply
from algorithms.classify.train import ClassifyTrain, drawn
from algorithms.shared.covariance import covariance_features
from tests.scenes.parks import NAMES, QUICK, UTM, yard
from toolbox.data import PointCloud, Table, Vector
from toolbox.declare import Attribute, ClassList
from toolbox.errors import DataError, ParameterError


def rows_and_labels(seed: int, classes: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    rng = np.random.default_rng(seed)
    label = rng.integers(0, classes, 600)
    data = rng.normal(label[:, None] * [1.0, -0.5, 0.0], 1.0, (600, 3)).astype(np.float32)
    data[:60, 1] = np.nan
    return data, label


def settings(classes: int, kind: Kind) -> Settings:
    codes = [2, 5, 6, 9][:classes]
    return Settings(kind, 8, False, 0, {"kind": kind, "classes": codes, "features": list("abc")})


@pytest.mark.parametrize("classes", [2, 3])
@pytest.mark.parametrize("kind", ["boosting", "forest"])
def test_trees_give_the_probabilities_of_scikit_learn(kind: Kind, classes: int) -> None:
    from sklearn.ensemble import HistGradientBoostingClassifier, RandomForestClassifier

    """Of rounded values, of which each is a bin, there and here."""
    data, label = rows_and_labels(0, classes)
    data = np.round(data, 1)
    points = Labelled(data, label, np.ones(600), np.arange(600) % 9)
    made = trained(points, settings(classes, kind))
    theirs = (
        HistGradientBoostingClassifier(
            max_iter=8,
            early_stopping=False,
            random_state=0,
            l2_regularization=1.0,
            max_features=1 / np.sqrt(3),
        )
        if kind == "boosting"
        else RandomForestClassifier(8, min_samples_leaf=5, random_state=0, max_depth=20)
    ).fit(data, label, np.ones(600))
    fresh = np.round(rows_and_labels(1, classes)[0], 1)
    expected = np.maximum(theirs.predict_proba(fresh), 1e-6)
    expected /= expected.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(made.probabilities(fresh), expected, atol=1e-6)


def test_bins_have_the_same_weight() -> None:
    """Light points are many to a bin; those without the feature are in none."""
    rng = np.random.default_rng(0)
    data = rng.normal(0, 1, (20_000, 1)).astype(np.float32)
    data[:500] = np.nan
    weight = np.where(data[:, 0] < 0, 1.0, 9.0)
    bins = Bins.of(data, weight)
    held = np.bincount(bins.number[500:, 0].astype(int), weight[500:])
    assert len(held) == 255
    np.testing.assert_allclose(held, weight[500:].sum() / 255, atol=9)
    assert np.isnan(bins.number[:500]).all()
    inside = bins.number[500:, 0] <= 99.5
    limit = bins.threshold(np.zeros(1, int), np.array([99.5]))
    np.testing.assert_array_equal(inside, data[500:, 0] <= limit)


def test_models_of_a_training_share_their_bins() -> None:
    """Those of a part branch at edges that all points have made."""
    data, label = rows_and_labels(0, 3)
    how = settings(3, "boosting")
    points = binned(Labelled(data, label, np.ones(600), np.arange(600) % 9), how)
    assert points.bins is not None
    part = trained(points.some(np.flatnonzero(points.block < 3)), how)
    inner = part.feature >= 0
    for feature, threshold in zip(part.feature[inner], part.threshold[inner], strict=True):
        assert threshold in points.bins.edges[feature]
    alone = trained(dataclasses.replace(points, bins=None), how)
    np.testing.assert_array_equal(alone.threshold, trained(points, how).threshold)


@pytest.mark.parametrize("kind", ["boosting", "forest", "logistic"])
def test_a_feature_that_no_point_of_a_part_has_tells_nothing(kind: Kind) -> None:
    """Such as planes where few patches are labelled; later points may have it."""
    data, label = rows_and_labels(0, 3)
    fresh, truth = rows_and_labels(1, 3)
    how = settings(3, kind)
    points = binned(Labelled(data, label, np.ones(600), np.arange(600) % 9), how)
    lacking = np.arange(60)  # whose second feature is missing
    with_it = np.flatnonzero(np.isnan(data[:, 1]))
    np.testing.assert_array_equal(with_it, lacking)
    made = trained(points.some(lacking), how)
    assert (made.scores(fresh).argmax(axis=1) == truth).mean() > 0.4
    fresh[:, 1] += 100.0
    other = made.scores(fresh)
    fresh[:, 1] = np.nan
    np.testing.assert_array_equal(made.scores(fresh), other)


def test_leaves_of_certain_points_have_a_penalty() -> None:
    """Without it their values grow beyond bounds, and later rounds chase them."""
    rng = np.random.default_rng(0)
    label = rng.choice(3, 20_000, p=[0.6, 0.39, 0.01])
    data = rng.normal(0, 1, (20_000, 4)).astype(np.float32)
    data[:, 0] += 9 * (label == 1)
    data[:, 1] += 9 * (label == 2)
    own = np.arange(20_000) < 15_000
    points = Labelled(data, label, np.where(label == 0, 30.0, 1.0), np.arange(20_000) % 9)
    about = {**settings(3, "boosting").about, "features": list("abcd")}
    how = dataclasses.replace(settings(3, "boosting"), trees=50, about=about)
    made = trained(points.some(own), how)
    assert np.abs(made.values).max() < 20
    assert (made.scores(data[~own]).argmax(axis=1) == label[~own]).mean() > 0.985


@pytest.mark.parametrize("classes", [2, 3])
def test_small_trees_asked_at_once_give_the_scores_of_one_after_another(
    classes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit, also without a feature and at the very thresholds."""
    data, label = rows_and_labels(0, classes)
    points = Labelled(data, label, np.ones(600), np.arange(600) % 9)
    made = trained(points, settings(classes, "boosting"))
    asked = rows_and_labels(1, classes)[0]
    asked[::5] = np.nan
    asked[1], asked[2] = np.inf, -np.inf
    inner = np.flatnonzero(made.feature >= 0)
    at = made.threshold[inner].astype(np.float32)
    for step in (
        np.float32(-np.inf),
        at,
        np.float32(np.inf),
    ):  # beside the threshold that is rounded, and on it
        rows = np.zeros((len(inner), 3), np.float32)
        rows[np.arange(len(inner)), made.feature[inner]] = np.nextafter(at, step)
        asked = np.vstack([asked, rows])
    found = made.scores(asked)
    monkeypatch.setattr(model, "MOST_LEAVES", 0)
    np.testing.assert_array_equal(found, made.scores(asked))


@pytest.mark.parametrize("classes", [2, 3])
def test_logistic_regression_finds_what_is_linear(classes: int) -> None:
    data, label = rows_and_labels(0, classes)
    points = Labelled(data, label, np.ones(600), np.arange(600) % 9)
    made = trained(points, settings(classes, "logistic"))
    right = made.probabilities(data).argmax(axis=1) == label
    assert right.mean() > {2: 0.65, 3: 0.55}[classes]
    assert np.isfinite(made.probabilities(np.full((2, 3), np.nan, np.float32))).all()


def test_learnt_in_one_yard_it_holds_in_another(made: Any, tmp_path: Path) -> None:
    assert made.overall_accuracy > 97
    assert {row["verdict"] for row in made.report.rows()} <= {"ok", "look at it"}
    assert made.importance.rows()[0]["feature"] == "height_above_ground"
    made.model.save(tmp_path / "model.csv")
    model = Table.open(tmp_path / "model.csv")
    other = yard(1)
    out = ClassifyApply(points=other, model=model).run()
    right = out.classified["classification"] == other["classification"]
    assert right.mean() > 0.97
    sure = out.classified["probability"]
    assert sure.mean() == pytest.approx(right.mean(), abs=0.03)
    assert (out.classified["second_class"] != out.classified["classification"]).all()
    direct = ClassifyApply(points=other, model=made.model).run()
    np.testing.assert_array_equal(direct.classified["probability"], sure)


@pytest.mark.parametrize(
    ("matrix", "points", "found", "advice"),
    [
        ([[300, 300], [0, 900]], 600, "66.7 %", ""),  # 300 of the 600 that are it in either
        ([[299, 301], [0, 900]], 600, "66.5 %: 50 % of its points are taken for class 5", "leave"),
        ([[600, 0], [900, 0]], 600, "57.1 %: 60 % of what is taken for it is class 5", "leave"),
        (
            [[90, 310], [0, 900]],
            400,
            "36.7 %: 78 % of its points are taken for class 5",
            "label more",
        ),
    ],
)
def test_classes_that_are_learnt_badly_are_told_with_why_and_what_to_do(
    matrix: list[list[int]], points: int, found: str, advice: str
) -> None:
    """Below an F1 of two thirds the IoU, F1 / (2 - F1), is below one half."""
    counts = np.array(matrix, float)
    f1 = 200 * counts[0, 0] / (counts[0].sum() + counts[:, 0].sum())
    rows = [
        {"class": 2, "points": points, "blocks": 20, "f1": f1},
        {"class": 5, "points": 900, "blocks": 20, "f1": 99.0},
    ]
    told = {row["what"]: row for row in reports.verdict_rows(rows, counts, [], 0.0)}
    row = told["F1 of class 2"]
    assert row["found"] == found
    assert row["verdict"] == ("look at it" if advice else "ok")
    assert advice in row.get("advice", "")
    assert ("advice" in row) == bool(advice)
    assert told["F1 of class 5"]["verdict"] == "ok"
    if advice:
        assert reports.in_words(row).startswith(f"F1 of class 2: {found} (at least 66.7 %); ")


def test_intervals_that_are_too_narrow_are_told(caplog: pytest.LogCaptureFixture) -> None:
    """As compare.classes tells them: few blocks, and a corner in which all labels are wrong."""
    cloud = yard()
    corner = (cloud.xyz[:, :2] < cloud.xyz[:, :2].min(axis=0) + 12).all(axis=1)
    wrong = cloud.with_attributes(
        {"classification": np.where(corner, 6, cloud["classification"]).astype(np.uint8)}
    )
    for points, block, text in (
        (cloud, 40.0, r"only \d blocks hold points: below 8 there are no intervals"),
        (cloud, 20.0, r"only \d squares of four blocks hold points: below 8"),
        (wrong, 5.0, r"the errors are as uncertain as \d.\d independent ones"),
    ):
        caplog.clear()
        ClassifyTrain(**{**QUICK, "folds": 2, "block": block}, points=points, features=NAMES).run()
        assert re.search(text, caplog.text)


def test_the_order_of_the_points_does_not_matter(made: Any) -> None:
    cloud = yard()
    order = np.random.default_rng(5).permutation(len(cloud))
    again = ClassifyTrain(points=cloud.select(order), features=NAMES, **QUICK).run()
    assert again.model.rows() == made.model.rows()
    assert again.accuracy.rows() == made.accuracy.rows()


def test_radii_are_metres_in_feet_too() -> None:
    feet = yard().with_xyz(yard().xyz * 3937 / 1200).with_crs(CRS(2263))
    out = ClassifyTrain(points=feet, radii=(1.0, 4.0), trees=2, per_class=100, folds=2).run()
    said = json.loads(out.model.frame["about"].iloc[0])["features"]
    assert {name.partition("@")[2] for name in said if "@" in name} == {"1", "4"}


def test_polygons_on_the_map_are_labels() -> None:
    """Squares of one metre whose points are all of one class."""
    cloud = yard()
    points = PointCloud(cloud.xyz, {"intensity": cloud["intensity"]}, crs=UTM)
    frame = pandas.DataFrame(np.floor(cloud.xyz[:, :2]), columns=["x", "y"])
    kinds = frame.assign(code=cloud["classification"]).groupby(["x", "y"])["code"].agg(set)
    pure = [(x, y, min(kind)) for (x, y), kind in kinds.items() if len(kind) == 1]
    shapes = [shapely.box(x, y, x + 0.99, y + 0.99) for x, y, _ in pure]
    columns = {"code": [code for _, _, code in pure]}
    layer = Vector(geopandas.GeoDataFrame(columns, geometry=shapes, crs=UTM), name="a.gpkg")
    job: dict[str, Any] = {"points": points, "features": NAMES, "class_attribute": "code", **QUICK}
    out = ClassifyTrain(**job, areas=layer).run()
    assert [row["class"] for row in out.by_class.rows()] == [2, 5, 6]
    assert out.overall_accuracy > 95
    clash = geopandas.GeoDataFrame({"code": [9]}, geometry=shapes[:1], crs=UTM)
    both = Vector(pandas.concat([layer.frame, clash]), name="b.gpkg")
    with pytest.raises(DataError, match="areas: no point lies in polygons of class 9 alone"):
        ClassifyTrain(**job, areas=both).run()


def test_only_points_in_polygons_teach_but_all_are_seen() -> None:
    """Labels outside are not looked at, but what stands there is in the features inside."""
    cloud = yard()
    corners = [(5e5 + x, 46e5 + y) for x in (0, 24, 48) for y in (0, 24, 48)]
    shapes = [shapely.box(x, y, x + 12, y + 12) for x, y in corners]
    layer = Vector(geopandas.GeoDataFrame(geometry=shapes, crs=UTM), name="patches.gpkg")
    inside = shapely.contains_xy(shapely.union_all(shapes), *cloud.xyz[:, :2].T)
    job: dict[str, Any] = {"features": NAMES, "block": 12.0, **QUICK}
    wrong = cloud.with_attributes(
        {"classification": np.where(inside, cloud["classification"], 9).astype(np.uint8)}
    )
    out = ClassifyTrain(points=wrong, areas=layer, **job).run()
    assert [row["class"] for row in out.by_class.rows()] == [2, 5, 6]
    left = ClassifyTrain(points=wrong, leave_out=ClassList([9]), **job).run()
    pandas.testing.assert_frame_equal(out.model.frame, left.model.frame)
    away = Vector(layer.frame.translate(1e3).to_frame("geometry"), name="away.gpkg")
    with pytest.raises(DataError, match="areas: no point lies in the polygons"):
        ClassifyTrain(points=cloud, areas=away, **job).run()


def test_polygons_that_are_not_filled_in_teach_nothing(caplog: pytest.LogCaptureFixture) -> None:
    cloud = yard()
    shapes = [shapely.box(x, 46e5, x + 20, 46e5 + 60) for x in 5e5 + np.array([0, 20, 40])]
    frame = geopandas.GeoDataFrame({"class": [2, None, 6]}, geometry=shapes, crs=UTM)
    frame["class"] = frame["class"].astype("Int64")
    job: dict[str, Any] = {"points": cloud, "features": ("intensity",), **QUICK}
    job |= {"class_attribute": "class", "block": 6.0}
    out = ClassifyTrain(**job, areas=Vector(frame, name="patches.gpkg")).run()
    assert [row["class"] for row in out.by_class.rows()] == [2, 6]
    assert "1 polygons have no class, and teach nothing" in caplog.text


def test_sampling_is_by_place_and_says_what_each_point_stands_for() -> None:
    cloud = yard()
    label = cloud["classification"].astype(np.int64)
    chosen, weight = drawn(cloud.xyz, label, [2, 6], 100, seed=1)
    for code, own in ((2, slice(0, 100)), (6, slice(100, 200))):
        assert (label[chosen[own]] == code).all()
        assert weight[own].sum() == pytest.approx((label == code).sum())
    order = np.random.default_rng(0).permutation(len(cloud))
    shuffled, _ = drawn(cloud.xyz[order], label[order], [2, 6], 100, seed=1)
    np.testing.assert_array_equal(order[shuffled], chosen)


def test_folds_keep_whole_blocks_back() -> None:
    block = np.repeat(np.arange(20), 30)
    kept = np.zeros(len(block), int)
    for own, away in folds_of(block, 4):
        assert not np.isin(block[away], block[own]).any()
        kept[away] += 1
    assert (kept == 1).all()


def test_the_temperature_makes_probabilities_honest() -> None:
    rng = np.random.default_rng(0)
    scores = rng.normal(0, 1.5, (8000, 3))
    label = np.array([rng.choice(3, p=p) for p in softmax(scores)])
    points = Labelled(np.zeros((8000, 1), np.float32), label, np.ones(8000), label)
    assert temperature(scores, points) == pytest.approx(1.0, abs=0.06)
    assert temperature(4 * scores, points) == pytest.approx(4.0, abs=0.25)


def test_one_point_per_voxel_has_the_features_of_features_local() -> None:
    """Sparse points are not thinned, so the numbers are those of the shared implementation."""
    rng = np.random.default_rng(0)
    index = rng.permutation(20**3)[:900]
    xyz = np.stack(np.unravel_index(index, (20, 20, 20)), axis=1) + rng.uniform(0.2, 0.8, (900, 3))
    cloud = PointCloud(xyz, {}, crs=UTM)
    names = ("planarity@3", "linearity@3", "height_range@3")  # in voxels of a metre
    found = names_of.described(cloud, names)
    bases = [names_of.split(name)[0] for name in names]
    expected = covariance_features(xyz, neighbours=None, radius=3.0, names=bases)  # type: ignore[arg-type]
    for k, base in enumerate(bases):
        np.testing.assert_allclose(found[:, k], expected[base], atol=1e-4)  # type: ignore[index]


def test_what_is_around_is_told_by_the_neighbourhoods_of_a_metre() -> None:
    """Points about planes are those in voxels, made once for all features that need them."""
    cloud = yard()
    names = ("planarity", "roughness", "surface_variation@1")
    found = names_of.described(cloud, names)
    means, place = names_of.voxel_means(cloud.xyz, 1.0 / names_of.PER_RADIUS)
    shapes = covariance_features(
        means, neighbours=None, radius=1.0, names=("eigenvalue3", "neighbours", "surface_variation")
    )
    scatter = _evidence.scatter_of(shapes["eigenvalue3"], shapes["neighbours"])[place]
    around = _evidence.PointFeatures(cloud, 1.0, 3.0, given_scatter=scatter)
    for k, name in enumerate(names[:2]):
        np.testing.assert_allclose(found[:, k], around.feature(name), atol=1e-4)
        np.testing.assert_array_equal(found[:, k], names_of.described(cloud, (name,))[:, 0])
    np.testing.assert_allclose(found[:, 2], shapes["surface_variation"][place], atol=1e-4)


def test_voxels_are_the_same_whatever_else_there_is() -> None:
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 10, (4000, 3)) + np.array([500_000, 4_600_000, 0])
    means, place = names_of.voxel_means(xyz, 0.7)
    part = np.flatnonzero(np.floor(xyz[:, 0] / 0.7) > np.floor(500_005 / 0.7))[::-1]
    own, own_place = names_of.voxel_means(xyz[part], 0.7)
    np.testing.assert_array_equal(own[own_place], means[place[part]])


def test_heights_in_columns() -> None:
    xyz = np.array([[0.5, 0.5, 2.0], [1.5, 0.5, 5.0], [9.5, 0.5, 1.0]])
    found = names_of.described(PointCloud(xyz, {}, crs=UTM), ("above_lowest@1", "below_highest@1"))
    np.testing.assert_allclose(found, [[0, 3], [3, 0], [0, 0]])


def test_columns_are_those_of_brute_force() -> None:
    """Of nine cells, counted point by point; whatever the order of the points."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform((0, 0, 0), (12, 9, 8), (400, 3))
    ground, passing = rng.random(400) < 0.4, rng.random(400) < 0.3
    light = rng.integers(0, 3000, 400).astype(float)
    height = np.round(xyz[:, 2] - 1, 3)
    bent = np.where(rng.random(400) < 0.1, np.nan, rng.random(400) / 10)
    points = columns.Measured(xyz, height, ground, passing, light, bent)
    found = columns.features(points, 2.0)
    cell = np.floor((xyz[:, :2] + columns.BORDER) / 2.0)
    for i in range(0, 400, 7):
        near = (np.abs(cell - cell[i]) <= 1).all(axis=1)
        tops = [height[(cell == c).all(axis=1)].max() for c in np.unique(cell[near], axis=0)]
        up = near & ~ground
        expected = {
            "above_lowest": xyz[i, 2] - xyz[near, 2].min(),
            "below_highest": xyz[near, 2].max() - xyz[i, 2],
            "top_height": height[near].max(),
            "top_spread": np.std(tops),
            "ground_share": ground[near].mean(),
            "passing_share": passing[up].mean(),
            "mean_height": height[up].mean(),
            "height_spread": height[up].std(),
            "above_mean": height[i] - height[up].mean(),
            "mean_intensity": light[near].mean(),
            "intensity_spread": light[near].std(),
            "mean_variation": np.where(np.isnan(bent), columns.SHAPELESS, bent)[up].mean(),
            "flat_share": (bent < columns.FLAT)[up & (height > columns.HIGH)].mean(),
            "below_top": xyz[(cell == cell[i]).all(axis=1), 2].max() - xyz[i, 2],
        }
        assert set(expected) == set(columns.NAMES)
        for name, value in expected.items():
            assert found[name][i] == pytest.approx(value, rel=1e-4, abs=1.5e-3), name
    order = rng.permutation(400)
    parts = (xyz[order], height[order], ground[order], passing[order], light[order], bent[order])
    again = columns.features(columns.Measured(*parts), 2.0)
    for name in columns.NAMES:
        np.testing.assert_array_equal(found[name][order], again[name])


def test_columns_without_points_above_the_ground_have_no_heights() -> None:
    xyz, yes = np.array([[0.5, 0.5, 2.0], [0.7, 0.5, 5.0]]), np.ones(2, bool)
    found = columns.features(
        columns.Measured(xyz, np.zeros(2), yes, ~yes, np.zeros(2), np.zeros(2)), 1.0
    )
    assert np.isnan(found["passing_share"]).all()
    assert np.isnan(found["above_mean"]).all()
    far = columns.Measured(xyz * 1e9, np.zeros(2), yes, ~yes, np.zeros(2), np.zeros(2))
    with pytest.raises(DataError, match="too far for these radii"):
        columns.features(far, 1.0)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (
            {"leave_out": ClassList([5, 6])},
            r"the points must be of two classes at least, got \[2\]",
        ),
        ({"labels": Attribute("intensity")}, "must hold classes from 0 to 255"),
        ({"block": 30.0}, "block: 4 blocks hold labels, 6 are needed for 3 folds"),
        ({"features": ("intensity", "colour")}, "features: 'colour' is no attribute of yard.laz"),
        ({"features": ("planar@1",)}, "features: 'planar@1' is no feature of a radius"),
        ({"features": ("planarity@99",)}, "the radius must be above 0 and at most 10 m"),
        ({"features": ("intensity", "intensity")}, "features: a name is given twice"),
        ({"features": ("returns",)}, "returns needs the attributes"),
        ({"labels": Attribute("truth")}, "labels: no attribute 'truth'; there are"),
        ({"class_attribute": "code"}, "class_attribute: is an attribute of areas; give them"),
    ],
)
def test_what_cannot_be_learnt(given: dict[str, Any], text: str) -> None:
    with pytest.raises((DataError, ParameterError), match=text):
        ClassifyTrain(**{"points": yard(), "features": ("intensity",), **QUICK, **given}).run()


def test_features_that_are_not_named_are_those_of_each_radius_that_the_points_can_have() -> None:
    """Columns of light need intensities; a radius written twice in two ways is the same."""
    cloud = yard()
    every = names_of.usual(cloud, (1.0, 2.0))
    for name in ("planarity", "mean_intensity", "top_height"):
        assert {f"{name}@1", f"{name}@2"} <= set(every)
    dark = cloud.with_attributes({"intensity": np.zeros(len(cloud))})
    assert not any("intensity" in name for name in names_of.usual(dark, (1.0, 2.0)))
    twice = names_of.described(cloud, ("mean_variation@2", "planarity@1", "planarity@1.0"))
    np.testing.assert_array_equal(twice[:, 1], twice[:, 2])
    bent = names_of.described(cloud, ("mean_variation@2",))[:, 0]  # needs the neighbourhoods of 1 m
    np.testing.assert_array_equal(twice[:, 0], bent)
    assert np.nanmax(bent) > 0
