"""compare.planes: the tables of Çömert and Avdan from their counts, and sets with known answers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.compare.planes import ComparePlanes, Sets, between
from toolbox.data import PointCloud
from toolbox.declare import Attribute
from toolbox.errors import DataError

UTM, TRUTH = CRS(32635), Attribute("truth")
# Çömert and Avdan, tables 2 and 3: O, E, both, O without E, E without O as printed, and percent.
CLOUD_1 = (213_672, 210_872, 208_320, 2_552, 5_352, 98.79)
CLOUD_2 = (47_807, 46_267, 45_377, 2_430, 890, 98.07)


@pytest.mark.parametrize(
    ("printed", "correctness", "iou"), [(CLOUD_1, 97.50, 96.34), (CLOUD_2, 94.92, 93.18)]
)
def test_published_tables(printed: tuple[Any, ...], correctness: float, iou: float) -> None:
    """Their percentages are completeness; correctness and IoU, which they leave out, are lower."""
    sets = Sets(*printed[:3])
    assert sets.completeness == pytest.approx(printed[5], abs=0.01)  # 98.076 is printed as 98.07
    assert sets.correctness == pytest.approx(correctness, abs=0.005)
    assert sets.iou == pytest.approx(iou, abs=0.005)
    assert {sets.o_alone, sets.e_alone} == set(printed[3:5])


def test_published_differences_are_swapped_in_one_table() -> None:
    one, two = Sets(*CLOUD_1[:3]), Sets(*CLOUD_2[:3])
    assert (one.e_alone, one.o_alone) == CLOUD_1[3:5]  # table 2 has them the wrong way round
    assert (two.o_alone, two.e_alone) == CLOUD_2[3:5]
    # The text has other counts for cloud 1 than its table, and 98.82 %.
    assert Sets(213_672, 210_867, 208_377).completeness == pytest.approx(98.82, abs=0.005)


def wall(n: int = 400, turn: float = 0.0, shift: float = 0.0) -> NDArray[np.float64]:
    """A square grid of 10 m, upright; turned about its lower edge by degrees, moved in depth."""
    side = round(n**0.5)
    u, v = np.meshgrid(np.linspace(0, 10, side), np.linspace(0, 10, side))
    angle = np.radians(turn)
    xyz = np.column_stack([u.ravel(), shift + v.ravel() * np.sin(angle), v.ravel() * np.cos(angle)])
    return xyz + np.array([500_000.0, 4_600_000.0, 800.0])


def compared(
    xyz: NDArray[np.float64], said: Any, true: Any, **settings: Any
) -> ComparePlanes.Outputs:
    columns = {"plane_id": np.asarray(said, np.int32), "truth": np.asarray(true, np.int32)}
    cloud = PointCloud(xyz, columns, crs=UTM)
    return ComparePlanes(points=cloud, reference_attribute=TRUTH, **settings).run()


def test_counts_by_hand() -> None:
    xyz = wall(100)
    true = np.repeat([5, 0], [80, 20])
    said = np.repeat([0, 2, 0], [10, 80, 10])  # loses 10 and takes 10 that are of none
    out = compared(xyz, said, true)
    row = out.table.frame.iloc[1]
    assert (row.kind, row.reference, row.plane) == ("found", 5, 2)
    counts = [row[name] for name in ("o", "e", "intersection", "o_without_e", "e_without_o")]
    assert counts == [80, 80, 70, 10, 10]
    assert row.correctness == row.completeness == pytest.approx(87.5)
    assert out.iou == pytest.approx(100 * 70 / 90)
    difference = out.differences["difference"]
    assert [int((difference == code).sum()) for code in range(4)] == [70, 10, 10, 10]
    assert (out.found, out.missed, out.invented, out.split) == (1, 0, 0, 0)


def test_split_merged_missed_and_invented() -> None:
    xyz = np.vstack([wall(400, shift=s) for s in (0, 3, 6, 9)])
    true = np.repeat([1, 2, 3, 0], 400)
    said = np.repeat([1, 2, 3, 0, 4], [230, 170, 400, 400, 400])
    out = compared(xyz, said, true)
    frame = out.table.frame.set_index("reference")
    assert list(frame.kind[1:4]) == ["found", "found", "missed"]
    assert list(frame.pieces[1:4]) == [2, 1, 0]
    assert (out.found, out.missed, out.invented, out.split) == (2, 1, 2, 1)
    assert sorted(out.table.frame.plane[out.table.frame.kind == "invented"]) == [2, 4]
    strict = compared(xyz, said, true, min_overlap=0.6)
    assert strict.found == 1


def test_angle_and_offset_between_the_planes() -> None:
    """Two clouds of the same points, of which one took a strip of a turned wall too."""
    xyz = np.vstack([wall(400), wall(400, turn=2.0, shift=0.1)])
    true, said = np.repeat([1, 0], 400), np.repeat([0, 7], 400)
    both = np.arange(0, 800, 2)
    # Half of each wall in either set: the planes are those of the same points, so without angle.
    alike = compared(xyz[both], np.ones(400), np.ones(400))
    assert alike.table.frame.angle[1] == pytest.approx(0.0, abs=1e-5)
    assert alike.table.frame.offset[1] == pytest.approx(0.0, abs=1e-7)
    angle, offset = between(xyz[said == 7], xyz[true == 1])
    assert angle == pytest.approx(2.0, abs=1e-6)
    rise = np.radians(2.0)
    assert offset == pytest.approx(0.1 * np.cos(rise) + 5 * np.sin(rise), abs=1e-6)


def test_reference_in_another_cloud_and_order() -> None:
    xyz = wall(100)
    order = np.random.default_rng(1).permutation(100)
    number = np.repeat([1, 2], 50)
    points = PointCloud(xyz, {"plane_id": number}, crs=UTM)
    other = PointCloud(xyz[order], {"plane_id": number[order] + 10}, crs=UTM)
    out = ComparePlanes(points=points, reference=other).run()
    assert out.iou == 100.0
    assert out.found == 2
    far = PointCloud(xyz + 1000, {"plane_id": number}, crs=UTM)
    with pytest.raises(DataError, match="reference: no point has a counterpart"):
        ComparePlanes(points=points, reference=far).run()


def test_offsets_are_metres_in_feet() -> None:
    xyz = wall(400) / 0.3048
    true = np.repeat([1, 0], [390, 10])
    moved = xyz + np.where(np.arange(400) < 380, 0.0, 0.5)[:, None] * [0, 1, 0]
    said = np.ones(400)
    columns = {"plane_id": said, "truth": true}
    out = ComparePlanes(
        points=PointCloud(moved, columns, crs=CRS(2992)), reference_attribute=TRUTH
    ).run()
    here = ComparePlanes(
        points=PointCloud(moved * 0.3048, columns, crs=UTM), reference_attribute=TRUTH
    ).run()
    assert out.table.frame.offset[1] == pytest.approx(here.table.frame.offset[1], abs=1e-7)
    assert out.table.frame.offset[1] > 1e-3


def test_the_same_attribute_is_no_reference() -> None:
    cloud = PointCloud(wall(100), {"plane_id": np.ones(100, int)}, crs=UTM)
    with pytest.raises(DataError, match="give reference points"):
        ComparePlanes(points=cloud)
    with pytest.raises(DataError, match="no attribute 'truth'"):
        ComparePlanes(points=cloud, reference_attribute=TRUTH)


def test_other_numberings(caplog: pytest.LogCaptureFixture) -> None:
    """Planes from 0 and -1 for none give what planes from 1 and 0 for none give."""
    xyz = np.vstack([wall(400, shift=s) for s in (0, 3, 6)])
    true, said = np.repeat([0, 1, 2], 400), np.repeat([1, 0, 2], [500, 200, 500])
    usual = compared(xyz, said, true)
    assert "truth: 2 planes; 0 is none, at 400 of 1200 points" not in caplog.text  # is no warning
    other = compared(xyz, said - 1, true - 1)
    text = "-1 is none, at 400 of 1200 points; the planes begin at number 0 (reference_none_id)"
    assert text in caplog.text
    assert other.iou == usual.iou
    assert other.table.frame["reference"].dropna().tolist() == [0, 1]
    np.testing.assert_array_equal(other.differences["difference"], usual.differences["difference"])
    assert compared(xyz, said - 1, true).iou == usual.iou  # each by itself
    assert compared(xyz, said + 5, true, none_id=5).iou == usual.iou
    with pytest.raises(DataError, match=r"3 negative numbers \(-4, -3, -2\); say with none_id"):
        compared(xyz, said - 4, true)
    half = ComparePlanes(
        points=PointCloud(xyz, {"plane_id": said + 0.5, "truth": true}, crs=UTM),
        reference_attribute=TRUTH,
    )
    with pytest.raises(DataError, match="plane_id has 1200 values that are no numbers of planes"):
        half.run()
