"""compare.classes: the published tables of the studies, and points in any order."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pyproj import CRS

from algorithms.compare.classes import CompareClasses, Counts, counterparts
from toolbox.data import PointCloud
from toolbox.errors import DataError, ParameterError
from toolbox.values import Attribute, ClassList

UTM = CRS(32635)


def from_counts(counts: dict[tuple[int, int], int], crs: CRS | None = UTM) -> PointCloud:
    """Points with a class and a true class; keys are (truth, class)."""
    true, said = (np.repeat([k[i] for k in counts], [*counts.values()]) for i in (0, 1))
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 1000, (len(true), 3)).round(3)
    columns = {"classification": said.astype(np.uint8), "truth": true.astype(np.uint8)}
    return PointCloud(xyz, columns, crs=crs, name="a.laz")


SOM_STUDY = {  # Şen and Bayaslı (2020), three classes: building 6, vegetation 5, ground 2
    (6, 6): 13068, (6, 5): 1123, (6, 2): 3630,
    (5, 6): 82, (5, 5): 8840, (5, 2): 1943,
    (2, 6): 1631, (2, 5): 418, (2, 2): 15703,
}  # fmt: skip


def test_published_figures_of_the_som_study() -> None:
    out = CompareClasses(
        points=from_counts(SOM_STUDY), reference_attribute=Attribute("truth")
    ).run()
    assert out.type_1 == pytest.approx(11.54, abs=0.005)
    assert out.type_2 == pytest.approx(19.43, abs=0.005)
    assert out.total_error == pytest.approx(16.41, abs=0.005)
    assert out.kappa == pytest.approx(0.665, abs=0.0005)
    rows = {row["measure"]: row["value"] for row in out.table.records()}
    assert [rows[k] for k in "abcd"] == [15703, 2049, 5573, 23113]
    matrix = {row["reference"]: row for row in out.confusion.records()}
    assert matrix["class 6"]["class 2"] == 3630
    assert matrix["class 2"]["total"] == 17752


def test_measures_of_the_power_line_study() -> None:
    """Quality follows from correctness and completeness: 97.13 and 97.36 make 94.64 %."""
    counts = Counts(a=9713 * 9736, b=9713 * 264, c=287 * 9736, d=10**9)
    assert counts.completeness == pytest.approx(97.36)
    assert counts.correctness == pytest.approx(97.13)
    assert counts.quality == pytest.approx(94.64, abs=0.005)


def test_error_attribute() -> None:
    counts = {(2, 2): 1, (1, 1): 1, (2, 1): 1, (1, 2): 1}
    out = CompareClasses(points=from_counts(counts), reference_attribute=Attribute("truth")).run()
    assert list(out.errors["error"]) == [0, 1, 2, 3]


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


def test_points_without_counterpart_are_counted_and_marked() -> None:
    points = from_counts({(2, 2): 6, (1, 2): 4})
    out = CompareClasses(
        points=points,
        reference=points.select(range(7)),
        reference_attribute=Attribute("truth"),
    ).run()
    assert out.unmatched == 3
    assert out.total_error == pytest.approx(100 / 7)
    assert list(out.errors["error"][7:]) == [4, 4, 4]


def test_other_points_altogether_are_an_error() -> None:
    points = from_counts({(2, 2): 5})
    moved = points.with_xyz(points.xyz + 50)
    with pytest.raises(DataError, match="no point has a counterpart"):
        CompareClasses(points=points, reference=moved).run()


def test_counterparts_within_a_distance() -> None:
    points = np.array([[0, 0, 0], [5, 0, 0], [9, 0, 0.0]])
    reference = points[[2, 0]] + [0, 0, 0.004]
    assert list(counterparts(points, reference, 0.01)) == [1, -1, 0]
    assert list(counterparts(points, reference, 0.001)) == [-1, -1, -1]
    assert list(counterparts(points, reference[:0], 1.0)) == [-1, -1, -1]


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
    with pytest.raises(ParameterError, match=text):
        CompareClasses(points=from_counts({(2, 2): 3}), **parameters)
