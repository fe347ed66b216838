"""compare.classes: accuracies of several classes, and two classifications of the same points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.compare._paired import mcnemar
from algorithms.compare.classes import CompareClasses
from toolbox.data import PointCloud, Table
from toolbox.declare import Attribute, ClassList
from toolbox.errors import DataError, ParameterError
from toolbox.pictures.draw import draw

STUDY = np.array([[13068, 1123, 3630], [82, 8840, 1943], [1631, 418, 15703]])
CODES = np.array([6, 5, 2])  # building, vegetation, ground
TRUTH: dict[str, Any] = {"reference_attribute": Attribute("truth")}


def study(**more: NDArray[Any]) -> PointCloud:
    """The points of the study of Şen and Bayaslı (2020), by their matrix, over 62 x 120 m."""
    row, column = np.divmod(np.repeat(np.arange(9), STUDY.ravel()), 3)
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, (62, 120, 19), (len(row), 3)).round(3)
    xyz += np.array([500_000, 4_300_000, 76])
    columns = {"classification": CODES[column], "truth": CODES[row]}
    attributes = {name: codes.astype(np.uint8) for name, codes in columns.items()}
    return PointCloud(xyz, attributes | more, crs=CRS(32635), name="study.laz")


def by(table: Table, column: str) -> dict[str, dict[str, Any]]:
    return {row[column]: row for row in table.rows()}


def test_tables_of_the_som_study() -> None:
    """Overall accuracy, accuracy of each class and kappa come out of the tool itself."""
    names = ("2=ground", "5=vegetation", "6=building")
    out = CompareClasses(points=study(), map=names, **TRUTH).run()
    assert out.overall_accuracy == pytest.approx(80.99, abs=0.005)
    assert out.kappa_of_classes == pytest.approx(0.708, abs=0.0005)
    classes = by(out.classes, "class")
    assert list(classes) == ["ground", "vegetation", "building"]
    published = {"building": 73.33, "vegetation": 81.36, "ground": 88.46}
    for name, value in published.items():
        row = classes[name]
        assert row["producers_accuracy"] == pytest.approx(value, abs=0.005)
        assert row["producers_accuracy_low"] < value < row["producers_accuracy_high"]
    matrix = by(out.confusion, "reference")
    assert matrix["building"] == {
        "reference": "building",
        "ground": 3630,
        "vegetation": 1123,
        "building": 13068,
        "total": 17821,
    }
    accuracy = by(out.accuracy, "measure")
    assert accuracy["overall_accuracy"]["low"] < 80.99 < accuracy["overall_accuracy"]["high"]
    assert 80 < accuracy["blocks"]["value"] < 130
    assert out.kappa == pytest.approx(0.665, abs=0.0005)  # of ground and objects, as before


def test_classes_are_merged_and_left_out() -> None:
    out = CompareClasses(
        points=study(), map=("5,6=object",), leave_out=ClassList([2]), **TRUTH
    ).run()
    assert out.left_out == STUDY[2].sum()
    matrix = by(out.confusion, "reference")
    assert matrix["object"]["object"] == STUDY[:2, :2].sum()
    assert matrix["object"]["class 2"] == STUDY[:2, 2].sum()
    assert out.overall_accuracy == pytest.approx(100 * STUDY[:2, :2].sum() / STUDY[:2].sum())
    assert np.count_nonzero(out.errors["error"] == 4) == out.left_out


def test_a_reference_with_other_codes() -> None:
    points = study()
    other = points.with_attributes({"truth": (points["truth"] + 100).astype(np.uint8)})
    names = ("2=ground", "5=vegetation", "6=building")
    theirs = ("102=ground", "105=vegetation", "106=building")
    out = CompareClasses(points=other, map=names, reference_map=theirs, **TRUTH).run()
    assert out.overall_accuracy == pytest.approx(80.99, abs=0.005)


def test_neighbours_that_are_wrong_together_widen_the_intervals() -> None:
    """The same shares of errors, once scattered and once in two whole corners."""
    rng = np.random.default_rng(2)
    xyz = rng.uniform(0, 100, (20_000, 3))
    truth = np.full(len(xyz), 2, np.uint8)
    corner = (xyz[:, 0] < 30) & (xyz[:, 1] < 30)
    widths = {}
    for name, wrong in {"apart": rng.random(len(xyz)) < corner.mean(), "together": corner}.items():
        columns = {"classification": np.where(wrong, 6, 2).astype(np.uint8), "truth": truth}
        points = PointCloud(xyz, columns, crs=CRS(32635))
        out = CompareClasses(points=points, **TRUTH).run()
        row = by(out.accuracy, "measure")["overall_accuracy"]
        widths[name] = row["high"] - row["low"]
        total = by(out.table, "measure")["total error"]
        if name == "together":
            assert total["block_high"] - total["block_low"] > 4 * (total["high"] - total["low"])
    assert widths["together"] > 6 * widths["apart"]


def test_strata_have_the_measures_of_all_classes() -> None:
    returns = np.where(np.arange(STUDY.sum()) % 3, 1, 2).astype(np.uint8)
    points = study(return_number=returns)
    out = CompareClasses(points=points, stratum=Attribute("return_number"), **TRUTH).run()
    rows = by(out.strata, "stratum")
    one = CompareClasses(points=points.select(returns == 2), **TRUTH).run()
    row = rows["return_number 2"]
    assert row["overall_accuracy"] == pytest.approx(one.overall_accuracy)
    assert row["kappa_of_classes"] == pytest.approx(one.kappa_of_classes)
    low, high = (row[f"overall_accuracy_block_{end}"] for end in ("low", "high"))
    assert low < row["overall_accuracy"] < high
    # Limits of single points are in the same row, and have another name.
    assert "total_error_low" in row
    assert "overall_accuracy_low" not in row


def test_a_sample_drawn_by_class_is_weighted_by_the_mapped_area() -> None:
    """The example of Olofsson et al. (2014), with codes 1 to 4."""
    counts = np.array([[66, 0, 1, 2], [0, 55, 0, 1], [5, 8, 153, 9], [4, 12, 11, 313]])
    row, column = np.divmod(np.repeat(np.arange(16), counts.ravel()), 4)
    rng = np.random.default_rng(0)
    columns = {"classification": column + 1, "truth": row + 1}
    points = PointCloud(
        rng.uniform(0, 1000, (len(row), 3)),
        {name: codes.astype(np.uint8) for name, codes in columns.items()},
        crs=CRS(32635),
    )
    areas = ("1=200000", "2=150000", "class 3=3200000", "4=6450000")
    out = CompareClasses(points=points, mapped_area=areas, **TRUTH).run()
    assert out.areas is not None
    found = by(out.areas, "class")
    assert found["class 1"]["area"] == pytest.approx(235_086, abs=1)
    half = (found["class 1"]["area_high"] - found["class 1"]["area_low"]) / 2
    assert half == pytest.approx(68_418, abs=1)
    assert found["all"]["overall_accuracy"] == pytest.approx(94.65, abs=0.005)
    with pytest.raises(DataError, match="mapped_area: there is none for 'class 4'"):
        CompareClasses(points=points, mapped_area=areas[:3], **TRUTH).run()
    with pytest.raises(DataError, match="mapped_area: no class 'sand'"):
        CompareClasses(points=points, mapped_area=(*areas, "sand=3"), **TRUTH).run()


def with_errors(shares: tuple[float, float], seed: int = 0) -> PointCloud:
    """Points with two classifications, each wrong in whole patches of 5 m, by chance."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, 100, (20_000, 3))
    patch = np.floor(xyz[:, :2] / 5).astype(int)
    truth = rng.integers(2, 4, len(xyz))
    wrong = [(rng.random((20, 20)) < share)[patch[:, 0], patch[:, 1]] for share in shares]
    columns = {"truth": truth, "classification": np.where(wrong[0], 6, truth)}
    columns["second"] = np.where(wrong[1], 6, truth)
    return PointCloud(
        xyz, {name: codes.astype(np.uint8) for name, codes in columns.items()}, crs=CRS(32635)
    )


def test_the_better_one_differs() -> None:
    points = with_errors((0.3, 0.1))
    out = CompareClasses(points=points, other_attribute=Attribute("second"), **TRUTH).run()
    assert out.difference is not None
    row = by(out.difference, "measure")["overall_accuracy"]
    assert row["verdict"] == "differs"
    assert row["low"] < row["second"] - row["first"] == row["difference"] < row["high"]


@pytest.mark.slow
def test_luck_with_whole_patches_does_not_differ() -> None:
    """Of pairs that are equally good, where McNemar takes neighbours for independent."""
    verdicts, p = [], []
    for seed in range(20):
        points = with_errors((0.2, 0.2), seed)
        second: dict[str, Any] = {"other_attribute": Attribute("second"), "block": 10.0}
        out = CompareClasses(points=points, **TRUTH, **second).run()
        assert out.difference is not None
        rows = by(out.difference, "measure")
        verdicts.append(rows["overall_accuracy"]["verdict"])
        p.append(rows["mcnemar_p"]["difference"])
    assert verdicts.count("may be luck") >= 17
    assert sum(value < 0.05 for value in p) >= 12


def test_another_classification_in_another_file_and_order() -> None:
    points = with_errors((0.3, 0.1))
    inside = CompareClasses(points=points, other_attribute=Attribute("second"), **TRUTH).run()
    order = np.random.default_rng(4).permutation(len(points))
    other = PointCloud(points.xyz, {"classification": points["second"]}, crs=points.crs)
    beside = CompareClasses(points=points, other=other.select(order), **TRUTH).run()
    assert inside.difference is not None
    assert beside.difference is not None
    assert beside.difference.rows() == inside.difference.rows()


def test_mcnemar() -> None:
    assert mcnemar(121, 59)[0] == pytest.approx(61**2 / 180)
    assert mcnemar(3, 3) == (0.0, 1.0)
    assert mcnemar(9, 1)[1] == pytest.approx(22 / 1024)  # of the binomial distribution
    assert mcnemar(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"map": ("vegetation",)}, "map: 'vegetation' is not classes=name"),
        ({"map": ("2=ground 6=building",)}, "map: '2=ground 6=building' is not classes=name"),
        ({"map": ("3,x=vegetation",)}, "map: 'x' is no class"),
        ({"map": ("3=a", "3-5=b")}, "map: class 3 is both 'a' and 'b'"),
        ({"reference_map": ("=a",)}, "reference_map: '=a' is not classes=name"),
        ({"mapped_area": ("a=0",)}, "mapped_area: 'a=0' is not class=area with an area above zero"),
        ({"mapped_area": ("a=1e",)}, "mapped_area: 'a=1e' is not class=area"),
    ],
)
def test_entries_that_cannot_be_read(settings: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        CompareClasses(points=study(), **settings, **TRUTH)


def test_layers_that_cannot_be_compared() -> None:
    points = study()
    with pytest.raises(DataError, match="other_attribute: no attribute 'new'; there are"):
        CompareClasses(points=points, other_attribute=Attribute("new"), **TRUTH)
    with pytest.raises(DataError, match="is the attribute that it is to be compared with"):
        CompareClasses(points=points, other_attribute=Attribute("classification"), **TRUTH)
    with pytest.raises(DataError, match="leave_out: no point is left"):
        CompareClasses(points=points, leave_out=ClassList([2, 5, 6]), **TRUTH).run()
    halves = points.with_attributes({"truth": points["truth"] + np.float32(0.5)})
    with pytest.raises(DataError, match="reference_attribute: classes must be whole numbers, got"):
        CompareClasses(points=halves, **TRUTH).run()


def test_the_matrix_is_drawn(tmp_path: Path) -> None:
    """Green where classes are right; rows of classes that are not in the reference are left out."""
    from matplotlib.image import imread

    out = CompareClasses(points=study(), **TRUTH)
    matrix = out.run().confusion
    show = out.spec.outputs["confusion"].show
    draw({"confusion": (matrix, show)}, tmp_path / "a.png")
    picture = imread(tmp_path / "a.png")[..., :3]
    green = (picture[..., 1] - picture[..., 0] > 0.2).mean()
    red = (picture[..., 0] - picture[..., 1] > 0.05).mean()
    assert green > 0.05
    assert red > 0.02
