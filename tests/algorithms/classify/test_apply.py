"""classify.apply: unknown points, neighbours, drift, damaged models, other data."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas
import pytest
from pyproj import CRS

from algorithms.classify._learning import drift
from algorithms.classify.apply import ClassifyApply
from algorithms.classify.train import ClassifyTrain
from tests.scenes.parks import NAMES, QUICK, UTM, yard
from toolbox.data import PointCloud, Table
from toolbox.errors import DataError


def test_what_is_expected_is_the_mean_probability(made: Any) -> None:
    out = ClassifyApply(points=yard(3), model=made.model).run()
    assert out.expected == pytest.approx(float(out.classified["probability"].mean()), abs=1e-5)
    right = (out.classified["classification"] == yard(3)["classification"]).mean()
    assert out.expected == pytest.approx(float(right), abs=0.03)


def test_neighbours_may_share_what_they_are() -> None:
    """Within a radius in metres, and the tiles of a survey are as much larger."""
    other, few = yard(2), ("height_above_ground", "planarity@1")  # which leave something to mend
    made = ClassifyTrain(points=yard(), features=few, **QUICK).run()
    plain = ClassifyApply(points=other, model=made.model).run()
    tool = ClassifyApply(points=other, model=made.model, smooth=1.5)
    out = tool.run()
    truth, before = other["classification"], plain.classified["classification"]
    after = out.classified["classification"]
    assert (after == truth).mean() > (before == truth).mean()
    assert out.expected == pytest.approx((after == truth).mean(), abs=0.03)
    assert tool.halo() == ClassifyApply(points=other, model=made.model).halo() + 3.0
    feet = other.with_xyz(other.xyz * 3937 / 1200).with_crs(CRS(2263))
    in_feet = ClassifyApply(points=feet, model=made.model, smooth=1.5).run()
    away = np.abs(in_feet.classified["probability"] - out.classified["probability"])
    assert (away < 1e-3).mean() > 0.99


def test_points_that_are_not_probable_enough_are_unknown(made: Any) -> None:
    other = yard(2)
    every = ClassifyApply(points=other, model=made.model).run()
    out = ClassifyApply(points=other, model=made.model, min_probability=0.9).run()
    unsure = every.classified["probability"] < 0.9
    assert out.unknown == unsure.sum() > 0
    np.testing.assert_array_equal(out.classified["classification"] == 1, unsure)


def test_drift_tells_another_sensor_from_another_place(
    made: Any, caplog: pytest.LogCaptureFixture
) -> None:
    other = yard(3)
    alike = ClassifyApply(points=other, model=made.model).run()
    assert [row for row in alike.drift.rows() if row["verdict"] == "unlike"] == []
    assert alike.outside < 0.02
    brighter = other.with_attributes({"intensity": other["intensity"] * np.uint16(5)})
    out = ClassifyApply(points=brighter, model=made.model).run()
    first = out.drift.rows()[0]
    assert (first["feature"], first["verdict"]) == ("intensity", "unlike")
    assert first["outside"] > 90
    assert out.outside > 0.9
    assert "unlike the training, most of all intensity" in caplog.text


def test_other_densities_and_lacking_features_are_refused(made: Any) -> None:
    dense = yard(4, density=40.0)
    with pytest.raises(
        DataError, match=r"points: yard.laz has .* the model was trained with 4\.\d"
    ):
        ClassifyApply(points=dense, model=made.model).run()
    assert ClassifyApply(points=dense, model=made.model, any_density=True).run().unknown == 0
    plain = PointCloud(dense.xyz, {}, crs=UTM)
    with pytest.raises(DataError, match="points: 'intensity' is no attribute"):
        ClassifyApply(points=plain, model=made.model)


def about(change: Callable[[dict[str, Any]], Any]) -> Callable[[pandas.DataFrame], None]:
    def apply(frame: pandas.DataFrame) -> None:
        said = json.loads(frame.loc[0, "about"])
        change(said)
        frame.loc[0, "about"] = json.dumps(said)

    return apply


def cell(column: str, value: Any, row: int = 1) -> Callable[[pandas.DataFrame], None]:
    def apply(frame: pandas.DataFrame) -> None:
        frame.loc[row, column] = value

    return apply


@pytest.mark.parametrize(
    ("damage", "text"),
    [
        (cell("about", "{}", 0), "is no model of classify.train, or damaged"),
        (cell("about", "[1", 0), "is no model of classify.train, or damaged"),
        (cell("left", 0), "a branch leads to no node"),
        (cell("right", 10**9), "a branch leads to no node"),
        (
            lambda frame: frame.loc.__setitem__((1, "left"), frame.loc[1, "right"]),
            "leads to no node",
        ),
        (cell("feature", 99), "a branch leads to no node"),
        (cell("feature", -7), "a branch leads to no node"),
        (cell("tree", 5), "a branch leads to no node"),
        (cell("threshold", np.nan), "a number is missing or not finite"),
        (cell("value_1", np.inf), "a number is missing or not finite"),
        (about(lambda said: said.update(format=1)), "format 1, this version reads 2: train anew"),
        (about(lambda said: said.update(temperature=0)), "must be above zero"),
        (about(lambda said: said.update(classes=[2, 5])), "baseline is not as many numbers"),
        (about(lambda said: said.update(classes=[2, 5, 300])), "no codes from 0 to 255"),
        (about(lambda said: said["features"].pop()), "usual is not as many numbers"),
        (about(lambda said: said["quantiles"].pop()), "quantiles"),
        (about(lambda said: said.update(kind="pickle")), "its kind is unknown"),
        (lambda frame: frame.pop("left"), "no column 'left'"),
    ],
)
def test_a_damaged_model_is_refused(made: Any, damage: Any, text: str) -> None:
    frame = made.model.frame.copy()
    frame = frame.astype(dict.fromkeys(("threshold",), float))
    damage(frame)
    with pytest.raises(DataError, match=text):
        ClassifyApply(points=yard(), model=Table(frame))


def test_stability_index_counts_within_classes() -> None:
    """More of one class is no drift; a class that looks otherwise is."""
    rng = np.random.default_rng(0)
    label = rng.integers(0, 2, 4000)
    values = rng.normal(10.0 * label, 1.0).astype(np.float32)
    edges = np.array([np.quantile(values[label == c], drift.LEVELS) for c in (0, 1)])
    many = np.concatenate([np.flatnonzero(label == 1), np.flatnonzero(label == 0)[:100]])
    assert drift.unlike(edges, values[many], label[many]) < 0.05
    moved = (values + 2 * (label == 1)).astype(np.float32)
    assert drift.unlike(edges, moved, label) > drift.MAJOR


@pytest.fixture(scope="module")
def line() -> Any:
    """A model whose scores are linear in the features."""
    return ClassifyTrain(points=yard(), features=NAMES, learner="logistic", **QUICK).run()


def test_lines_do_not_go_on_beyond_the_training(line: Any) -> None:
    """Intensities of another sensor outweigh no other feature."""
    other = yard(3)
    brighter = other.with_attributes({"intensity": np.full(len(other), 65535, np.uint16)})
    out = ClassifyApply(points=brighter, model=line.model).run()
    right = (out.classified["classification"] == other["classification"]).mean()
    assert right > 0.7  # 0.11 without a limit, as all are houses, the brightest


def test_a_feature_that_is_stuck_is_told(line: Any, caplog: pytest.LogCaptureFixture) -> None:
    other = yard(3)
    dark = other.with_attributes({"intensity": np.zeros(len(other), np.uint16)})
    ClassifyApply(points=dark, model=line.model).run()
    assert "intensity is 0 in all points, beyond all of the training" in caplog.text
    assert "all points become" not in caplog.text


def test_one_class_for_all_of_another_survey_is_told(
    made: Any, caplog: pytest.LogCaptureFixture
) -> None:
    bare = yard(3)
    bare = bare.select(bare["classification"] == 2)
    ClassifyApply(points=bare, model=made.model).run()
    assert "all points become" not in caplog.text  # ground is all there is
    high = bare.with_attributes({"intensity": bare["intensity"] * np.uint16(5)})
    ClassifyApply(points=high, model=made.model).run()
    assert "all points become class 2, while 100 %" in caplog.text
