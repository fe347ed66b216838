"""compare.classes: the published tables of the studies, and points in any order."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import CRS

from algorithms.compare._counterparts import counterparts
from algorithms.compare._counts import Counts, Proportion
from algorithms.compare._outcomes import OUTCOMES
from algorithms.compare.classes import COLOURS, CompareClasses
from toolbox.data import PointCloud
from toolbox.declare import Attribute, ClassList
from toolbox.errors import DataError

UTM = CRS(32635)


def from_counts(counts: dict[tuple[int, int], int], crs: CRS | None = UTM) -> PointCloud:
    """Points with a class and a true class; keys are (truth, class)."""
    true, said = (np.repeat([k[i] for k in counts], [*counts.values()]) for i in (0, 1))
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 1000, (len(true), 3)).round(3)
    columns = {"classification": said.astype(np.uint8), "truth": true.astype(np.uint8)}
    return PointCloud(xyz, columns, crs=crs, name="a.laz")


SOM_STUDY = {  # Şen and Bayaslı (2020), three classes: building 6, vegetation 5, ground 2
    (6, 6): 13068,
    (6, 5): 1123,
    (6, 2): 3630,
    (5, 6): 82,
    (5, 5): 8840,
    (5, 2): 1943,
    (2, 6): 1631,
    (2, 5): 418,
    (2, 2): 15703,
}


def test_published_figures_of_the_som_study() -> None:
    out = CompareClasses(
        points=from_counts(SOM_STUDY), reference_attribute=Attribute("truth")
    ).run()
    assert out.type_1 == pytest.approx(11.54, abs=0.005)
    assert out.type_2 == pytest.approx(19.43, abs=0.005)
    assert out.total_error == pytest.approx(16.41, abs=0.005)
    assert out.kappa == pytest.approx(0.665, abs=0.0005)
    rows = {row["measure"]: row["value"] for row in out.table.rows()}
    assert [rows[k] for k in "abcd"] == [15703, 2049, 5573, 23113]
    matrix = {row["reference"]: row for row in out.confusion.rows()}
    assert matrix["class 6"]["class 2"] == 3630
    assert matrix["class 2"]["total"] == 17752
    right = {c: matrix[f"class {c}"][f"class {c}"] for c in (6, 5, 2)}
    assert 100 * sum(right.values()) / 46438 == pytest.approx(80.99, abs=0.005)
    shares = [100 * right[c] / matrix[f"class {c}"]["total"] for c in (6, 5, 2)]
    assert shares == pytest.approx([73.33, 81.36, 88.46], abs=0.005)


def test_measures_of_the_power_line_study() -> None:
    """Quality follows from correctness and completeness: 97.13 and 97.36 make 94.64 %."""
    counts = Counts(a=9713 * 9736, b=9713 * 264, c=287 * 9736, d=10**9)
    assert counts.completeness == pytest.approx(97.36)
    assert counts.correctness == pytest.approx(97.13)
    assert counts.quality == pytest.approx(94.64, abs=0.005)


@pytest.mark.parametrize(
    ("part", "whole", "low", "high"),
    [
        (10, 200, 2.74, 8.96),  # 2.7 to 9.0 in the literature
        (81, 263, 25.53, 36.62),  # Newcombe (1998), table I, method 3
        (15, 148, 6.24, 16.05),
        (0, 20, 0, 16.11),
        (1, 29, 0.61, 17.18),
    ],
)
def test_intervals_of_wilson(part: int, whole: int, low: float, high: float) -> None:
    assert Proportion(part, whole).interval == pytest.approx((low, high), abs=0.005)
    assert Proportion(whole - part, whole).interval == pytest.approx(
        (100 - high, 100 - low), abs=0.005
    )


def test_all_or_nothing_lies_within_its_interval() -> None:
    for whole in range(1, 300):
        assert Proportion(0, whole).interval[0] == 0
        assert Proportion(whole, whole).interval[1] == 100
    assert Proportion(0, 0).interval == (None, None)


@pytest.mark.parametrize("cells", [(70, 10, 5, 15), (15703, 2049, 5573, 23113), (5, 40, 30, 25)])
def test_interval_of_kappa_is_that_of_the_delta_method(cells: tuple[int, ...]) -> None:
    """The variance from derivatives of kappa by the four shares, taken numerically."""
    counts = np.array(cells, float)

    def kappa(c: Any) -> float:
        a, b, c_, d = c / c.sum()
        chance = (a + b) * (a + c_) + (c_ + d) * (b + d)
        return float((a + d - chance) / (1 - chance))

    step = 1e-4 * counts.sum()
    slopes = [(kappa(counts + s) - kappa(counts - s)) / (2 * step) for s in np.eye(4) * step]
    slope = np.array(slopes) * counts.sum()
    share = counts / counts.sum()
    error = np.sqrt((share @ slope**2 - (share @ slope) ** 2) / counts.sum())
    low, high = Counts(*cells).kappa_interval
    assert low == pytest.approx(kappa(counts) - 1.959964 * error, abs=1e-5)
    assert high == pytest.approx(kappa(counts) + 1.959964 * error, abs=1e-5)


def test_a_kappa_whose_formula_has_no_spread_has_no_limits() -> None:
    assert Counts(5, 0, 0, 5).kappa == 1
    assert Counts(5, 0, 0, 5).kappa_interval == (None, None)
    assert Counts(0, 0, 525, 12781).kappa_interval == (None, None)
    assert Counts(5, 0, 0, 0).kappa_interval == (None, None)


def test_agreement_by_chance_is_a_kappa_of_zero() -> None:
    """In binary numbers 1 - 0.9 - 0.1 is no zero, and -0 or -1e-16 was told."""
    for cells in ((1, 9, 81, 729), (3, 27, 7, 63), (9, 1, 81, 9)):
        assert Counts(*cells).kappa == 0
        assert str(Counts(*cells).kappa) == "0.0"


def test_a_class_that_the_reference_does_not_have_is_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """As vegetation, where the reference has all but ground and buildings in class 1."""
    known: Any = {"reference_attribute": Attribute("truth"), "positive": ClassList([2])}
    CompareClasses(points=from_counts({(2, 2): 100, (1, 5): 4}), **known).run()
    assert "does not have" not in caplog.text
    points = from_counts({(2, 2): 100, (1, 5): 30, (2, 5): 5})
    CompareClasses(points=points, **known).run()
    assert "35 of 135 points (26 %) are of class 5" in caplog.text
    assert "there most are of class 1" in caplog.text
    caplog.clear()
    CompareClasses(points=points, map=("1,5=other",), **known).run()
    assert "does not have" not in caplog.text


def test_table_with_limits() -> None:
    out = CompareClasses(
        points=from_counts(SOM_STUDY), reference_attribute=Attribute("truth")
    ).run()
    rows = {row["measure"]: row for row in out.table.rows()}
    assert list(rows) == [
        *("a", "b", "c", "d", "unmatched", "absent", "Type I", "Type II", "total error", "kappa"),
        *("correctness", "completeness", "quality"),
    ]
    for row in [*rows.values()][6:]:
        assert row["low"] < row["value"] < row["high"]
    limits = [rows["Type I"][limit] for limit in ("low", "high")]
    assert limits == pytest.approx([11.08, 12.02], abs=0.01)
    assert rows["a"]["low"] is None


def test_errors_by_stratum() -> None:
    points = from_counts(SOM_STUDY)
    returns = np.where(np.arange(len(points)) % 3, 1, 2).astype(np.uint8)
    points = points.with_attributes({"return_number": returns})
    job: dict[str, Any] = {"points": points, "reference_attribute": Attribute("truth")}
    out = CompareClasses(**job, stratum=Attribute("return_number")).run()
    rows = {row["stratum"]: row for row in out.strata.rows()}
    assert list(rows) == ["return_number 1", "return_number 2"]
    for value in (1, 2):
        one = CompareClasses(**job | {"points": points.select(returns == value)}).run()
        row = rows[f"return_number {value}"]
        measures = ("type_1", "type_2", "total_error", "kappa")
        assert [row[name] for name in measures] == [getattr(one, name) for name in measures]
        assert row["type_1_low"] < row["type_1"] < row["type_1_high"]
    alone = CompareClasses(**job).run().strata.rows()
    assert [(row["stratum"], row["points"]) for row in alone] == [("all", len(points))]


def test_a_stratum_may_have_no_counterparts_but_not_a_value_for_each_point() -> None:
    points = from_counts({(2, 2): 300, (1, 2): 100})
    first = points.select(range(300))
    job: dict[str, Any] = {"points": points, "reference": first}
    job["reference_attribute"] = Attribute("truth")
    areas = np.repeat([1, 2], [300, 100]).astype(np.uint8)
    out = CompareClasses(
        **job | {"points": points.with_attributes({"user_data": areas})},
        stratum=Attribute("user_data"),
    ).run()
    second = out.strata.rows()[1]
    assert (second["points"], second["unmatched"], second["total_error"]) == (0, 100, None)
    with pytest.raises(DataError, match=r"stratum: 'x' has 4\d\d values, at most 256"):
        CompareClasses(**job, stratum=Attribute("x")).run()


def test_colours_are_those_of_the_picture(tmp_path: Path) -> None:
    assert ["#{:02x}{:02x}{:02x}".format(*rgb) for rgb in COLOURS] == [
        colour for _, colour in OUTCOMES.values()
    ]
    counts = {(2, 2): 1, (1, 1): 1, (2, 1): 1, (1, 2): 1}
    job: dict[str, Any] = {"points": from_counts(counts)}
    job["reference_attribute"] = Attribute("truth")
    CompareClasses(**job, colours=True).run().errors.save(tmp_path / "a.laz")
    errors = PointCloud.open(tmp_path / "a.laz")
    for code in range(4):
        point = np.flatnonzero(errors["error"] == code)[0]
        found = [errors[name][point] // 257 for name in ("red", "green", "blue")]
        assert tuple(found) == COLOURS[code]
    assert "red" not in CompareClasses(**job).run().errors


def test_error_attribute() -> None:
    counts = {(2, 2): 1, (1, 1): 1, (2, 1): 1, (1, 2): 1}
    out = CompareClasses(points=from_counts(counts), reference_attribute=Attribute("truth")).run()
    assert list(out.errors["error"]) == [0, 1, 2, 3]


def test_a_wrong_class_of_an_object_is_marked_but_not_what_a_ground_filter_leaves() -> None:
    """True roofs found as roof, plant, nothing and ground, and a true tree found as a bush."""
    points = from_counts({(6, 6): 1, (6, 5): 1, (6, 1): 1, (6, 2): 1, (5, 4): 1})
    job: dict[str, Any] = {"points": points, "reference_attribute": Attribute("truth")}
    assert list(CompareClasses(**job).run().errors["error"]) == [1, 5, 1, 3, 5]
    merged = CompareClasses(**job, map=("3-5=plants", "6=roofs")).run().errors
    assert list(merged["error"]) == [1, 5, 1, 3, 1], "trees and bushes are one class"
    named = CompareClasses(**job, map=("1=nothing", "3-6=objects")).run().errors
    assert list(named["error"]) == [1, 1, 5, 3, 1], "a class with a name is an answer"


@pytest.mark.parametrize("crs", [CRS(32635), None, CRS(4326)])
def test_another_cloud_in_another_order(crs: CRS | None) -> None:
    points = from_counts(SOM_STUDY, crs)
    truth = PointCloud(points.xyz, {"label": points["truth"]}, crs=crs)
    order = np.random.default_rng(1).permutation(len(truth))
    out = CompareClasses(
        points=points, reference=truth.select(order), reference_attribute=Attribute("label")
    ).run()
    assert out.total_error == pytest.approx(16.41, abs=0.005)
    assert out.unmatched == 0


def test_labels_of_the_isprs_test() -> None:
    points = from_counts({(0, 2): 5, (1, 2): 1, (1, 1): 4})
    out = CompareClasses(
        points=points,
        reference_attribute=Attribute("truth"),
        reference_positive=ClassList([0]),
    ).run()
    assert (out.type_1, out.type_2, out.total_error) == (0, 20, 10)
    assert out.overall_accuracy == 90, "0 and 1 beside 2 and 1 are no errors"
    assert out.kappa_of_classes == pytest.approx(out.kappa)
    assert [row["reference"] for row in out.confusion.rows()][:2] == ["of interest", "all others"]
    shared = CompareClasses(
        points=points,
        reference_attribute=Attribute("truth"),
        reference_positive=ClassList([0, 2]),
    ).run()
    assert "class 2" in [row["reference"] for row in shared.confusion.rows()], "codes of both"
    named = CompareClasses(
        points=points,
        reference_attribute=Attribute("truth"),
        reference_positive=ClassList([0]),
        map=("2=ground", "1=object"),
        reference_map=("0=ground", "1=object"),
    ).run()
    assert named.overall_accuracy == 90
    assert named.confusion.rows()[0]["reference"] == "ground"


def test_a_class_of_interest_that_nothing_has_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """It had a total error of 0 %."""
    points = from_counts({(2, 2): 5, (1, 1): 4})
    job: dict[str, Any] = {"points": points, "reference_attribute": Attribute("truth")}
    out = CompareClasses(**job, positive=ClassList([99])).run()
    assert (out.total_error, out.type_1, out.kappa) == (None, None, None)
    assert "positive: no point is of class 99, and none of the reference of class 99" in caplog.text
    assert out.overall_accuracy == 100
    rows = [
        row["total_error"]
        for row in CompareClasses(**job, stratum=Attribute("truth")).run().strata.rows()
    ]
    assert rows == [0, 0], "objects alone, all of them right"
    caplog.clear()
    CompareClasses(**job).run()
    assert "positive" not in caplog.text


def test_points_without_counterpart_are_counted_and_marked() -> None:
    points = from_counts({(2, 2): 6, (1, 2): 4})
    out = CompareClasses(
        points=points,
        reference=points.select(range(7)),
        reference_attribute=Attribute("truth"),
    ).run()
    assert (out.unmatched, out.absent) == (3, 0)
    assert out.total_error == pytest.approx(100 / 7)
    assert list(out.errors["error"][7:]) == [4, 4, 4]


def test_reference_points_that_are_absent_are_counted_and_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    whole = from_counts({(2, 2): 600, (1, 1): 400})
    job: dict[str, Any] = {"reference": whole, "reference_attribute": Attribute("truth")}
    out = CompareClasses(points=whole.select(range(300)), **job).run()
    assert (out.overall_accuracy, out.unmatched, out.absent) == (100, 0, 700)
    assert "700 of 1000 points of the reference (70 %) are absent" in caplog.text
    rows = {row["measure"]: row["value"] for row in out.table.rows()}
    assert (rows["unmatched"], rows["absent"]) == (0, 700)
    part = CompareClasses(points=whole.select(range(300)), **job, leave_out=ClassList([1])).run()
    assert part.absent == 300
    caplog.clear()
    assert CompareClasses(points=whole.select(range(995)), **job).run().absent == 5
    assert not caplog.text  # half a percent
    near = CompareClasses(points=whole.select(range(300)), **job, max_distance=1000.0).run()
    assert near.absent == 700


def test_few_points_are_told_to_prove_little(caplog: pytest.LogCaptureFixture) -> None:
    points = from_counts({(2, 2): 4, (1, 1): 4})
    out = CompareClasses(points=points, reference_attribute=Attribute("truth")).run()
    assert out.kappa == 1
    assert "only 8 points are compared" in caplog.text
    assert "up to 31 % of all such points could differ" in caplog.text
    assert any("Only 8 points are compared" in text for text in out.not_looked_at())
    assert any("blocks do not tell it" in text for text in out.not_looked_at())
    for row in [*out.accuracy.rows(), *out.classes.rows()]:
        assert all(value is None for name, value in row.items() if name.endswith(("low", "high")))
    assert next(r for r in out.table.rows() if r["measure"] == "kappa")["low"] is None
    caplog.clear()
    many = from_counts({(2, 2): 60, (1, 1): 50, (2, 1): 10})
    assert not list(
        CompareClasses(points=many, reference_attribute=Attribute("truth")).run().not_looked_at()
    )
    assert "points are compared" not in caplog.text


def test_other_points_altogether_are_an_error() -> None:
    points = from_counts({(2, 2): 5})
    moved = points.with_xyz(points.xyz + 50)
    with pytest.raises(DataError, match="no point has a counterpart"):
        CompareClasses(points=points, reference=moved).run()


def test_twins_are_told_apart_by_their_attributes_when_some_are_missing() -> None:
    """Points are a part of the reference: each finds itself, not the one before it."""
    xyz = np.repeat(np.arange(30.0).reshape(10, 3), 3, axis=0)
    columns = {
        "gps_time": np.tile([1.0, 2.0, 3.0], 10),
        "classification": np.tile([1, 6, 2], 10).astype(np.uint8),
    }
    whole = PointCloud(xyz, columns, crs=UTM)
    order = np.random.default_rng(0).permutation(len(whole))
    for part in (whole.select(whole["gps_time"] == 3), whole.select(order[:17])):
        out = CompareClasses(points=part, reference=whole.select(order[::-1])).run()
        assert (out.total_error, out.unmatched) == (0, 0)


def test_counterparts_within_a_distance() -> None:
    points = np.array([[0, 0, 0], [5, 0, 0], [9, 0, 0.0]])
    reference = points[[2, 0]] + [0, 0, 0.004]
    assert list(counterparts(points, reference, max_distance=0.01)) == [1, -1, 0]
    assert list(counterparts(points, reference, max_distance=0.001)) == [-1, -1, -1]
    assert list(counterparts(points, reference)) == [-1, -1, -1]
    assert list(counterparts(points, reference[:0], max_distance=1.0)) == [-1, -1, -1]
    assert list(counterparts(points, points[:1], max_distance=5.5)) == [0, 0, -1]
    assert list(counterparts(points[:0], reference, max_distance=1.0)) == []


def test_a_point_with_the_same_coordinates_goes_before_any_that_is_merely_near() -> None:
    """Shuffled, and with a distance that holds many: still each point finds itself."""
    points = from_counts(SOM_STUDY)
    order = np.random.default_rng(1).permutation(len(points))
    found = counterparts(points.xyz, points.xyz[order], max_distance=30.0)
    np.testing.assert_array_equal(order[found], np.arange(len(points)))


@pytest.mark.parametrize(
    ("place", "apart", "rounding"),
    [
        ([32.65, 39.93, 850.0], 1e-8, 1e-14),  # degrees: 1 mm
        ([500_000.3, 4_600_000.4, 850.0], 1e-5, 1e-9),
        ([500_000.0000005, 4_600_000.0000005, 5e-7], 1e-5, 1e-9),  # half way between steps
    ],
)
def test_same_coordinates(place: list[float], apart: float, rounding: float) -> None:
    """What arithmetic rounds is the same place, what a person can measure is not."""
    point = np.array([place])
    for axis in np.eye(3):
        for sign in (-1, 1):
            assert list(counterparts(point, point + sign * rounding * axis)) == [0]
            assert list(counterparts(point, point + sign * apart * axis)) == [-1]


def twins(n: int = 400) -> PointCloud:
    """Three points at each of many places, told apart by GPS time or, some, by their return."""
    rng = np.random.default_rng(5)
    xyz = np.repeat(rng.uniform(0, 500, (n, 3)).round(2), 3, axis=0)
    time = rng.permutation(3 * n).astype(float)
    time[:300] = 7.0
    columns = {
        "classification": rng.integers(1, 4, 3 * n).astype(np.uint8),
        "label": rng.integers(1, 4, 3 * n).astype(np.uint8),
        "gps_time": time,
        "return_number": np.tile([1, 2, 3], n).astype(np.uint8),
        "amplitude": rng.integers(0, 255, 3 * n).astype(np.uint8),
    }
    return PointCloud(xyz, columns, crs=UTM)


@pytest.mark.parametrize("max_distance", [None, 30.0])
def test_points_at_one_place_are_told_apart_by_what_the_sensor_gave(
    max_distance: float | None,
) -> None:
    """Figures of a shuffled reference are those of the points themselves."""
    points = twins()
    itself = CompareClasses(points=points, reference_attribute=Attribute("label")).run()
    order = np.random.default_rng(6).permutation(len(points))
    for reference in (points, points.select(order), points.select(order[::-1])):
        # An attribute that somebody changed has less to say than those of the sensor.
        changed = reference.with_attributes({"amplitude": reference["amplitude"][::-1]})
        out = CompareClasses(
            points=points,
            reference=changed,
            reference_attribute=Attribute("label"),
            max_distance=max_distance,
        ).run()
        np.testing.assert_array_equal(out.errors["error"], itself.errors["error"])
        assert out.unmatched == 0


def test_points_that_nothing_tells_apart_are_compared_in_favour_of_the_classes() -> None:
    xyz = np.zeros((4, 3))
    points = PointCloud(xyz, {"classification": np.array([2, 1, 1, 2], np.uint8)}, crs=UTM)
    truth = PointCloud(xyz, {"classification": np.array([0, 6, 0, 6], np.uint8)}, crs=UTM)
    for order in ([0, 1, 2, 3], [3, 1, 0, 2], [2, 3, 1, 0]):
        out = CompareClasses(
            points=points, reference=truth.select(order), reference_positive=ClassList([0])
        ).run()
        assert (out.total_error, out.unmatched) == (0, 0)


def test_a_reference_point_serves_one_point_of_its_place_but_several_near_ones() -> None:
    points = PointCloud(np.zeros((3, 3)), {"classification": np.full(3, 2, np.uint8)}, crs=UTM)
    one = points.select([0])
    assert CompareClasses(points=points, reference=one).run().unmatched == 2
    assert CompareClasses(points=points, reference=one, max_distance=0.5).run().unmatched == 0


def test_one_class_only_has_no_kappa() -> None:
    out = CompareClasses(
        points=from_counts({(2, 2): 9}), reference_attribute=Attribute("truth")
    ).run()
    assert (out.kappa, out.type_1, out.type_2, out.total_error) == (None, 0, None, 0)


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({}, "give reference points"),
        ({"reference_attribute": Attribute("label")}, "no attribute 'label'; there are"),
    ],
)
def test_reference_is_needed(parameters: dict[str, Any], text: str) -> None:
    with pytest.raises(DataError, match=text):
        CompareClasses(points=from_counts({(2, 2): 3}), **parameters)
