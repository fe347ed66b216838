"""PTX: scans brought to the common system, pulses without a return, and damage by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from toolbox.data import PointCloud
from toolbox.errors import DataError

TURNED = "0 1 0 0\n-1 0 0 0\n0 0 1 0\n100 200 5 1"  # x becomes y, and y becomes -x
STRAIGHT = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1"


def scan(*points: str, matrix: str = STRAIGHT, columns: int | None = None) -> str:
    head = f"{columns or len(points)}\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n{matrix}\n"
    return head + "".join(f"{point}\n" for point in points)


def opened(folder: Path, text: str) -> PointCloud:
    (folder / "a.ptx").write_text(text)
    return PointCloud.open(folder / "a.ptx")


def test_scans_are_brought_to_one_system(tmp_path: Path) -> None:
    text = scan("1 2 3 0.5", "0 0 0 0.5", "4 5 6 1", matrix=TURNED) + scan("7 8 9 0")
    cloud = opened(tmp_path, text)
    np.testing.assert_allclose(cloud.xyz, [[98, 201, 8], [95, 204, 11], [7, 8, 9]])
    assert cloud["point_source_id"].tolist() == [1, 1, 2]
    assert cloud["intensity"].tolist() == [32768, 65535, 0]
    assert "red" not in cloud


def test_colours(tmp_path: Path) -> None:
    cloud = opened(tmp_path, scan("1 2 3 0.5 255 0 1", "4 5 6 0.5 1 2 3"))
    assert cloud["red"].tolist() == [65535, 257]
    assert cloud["blue"].tolist() == [257, 771]


def test_colours_that_only_some_scans_have_are_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cloud = opened(tmp_path, scan("1 2 3 0.5 255 0 1") + scan("1 2 3 0.5"))
    assert "red" not in cloud
    assert "not all scans have colours" in caplog.text
    assert len(cloud) == 2


def test_a_scan_without_returns(tmp_path: Path) -> None:
    assert len(opened(tmp_path, scan("0 0 0 0.5", "0 0 0 0.5"))) == 0


def test_blocks_make_no_difference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    points = [" ".join(f"{v:.4f}" for v in row) for row in rng.uniform(0.1, 1, (50, 4))]
    once = opened(tmp_path, scan(*points)).xyz
    monkeypatch.setattr("toolbox.data.ptx._BLOCK", 7)
    np.testing.assert_array_equal(opened(tmp_path, scan(*points)).xyz, once)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (scan("1 2 3 0.5", columns=3), "scan 1 is cut off"),
        (scan("1 2 3 0.5") + "5\n1\n0 0", "scan 2 does not begin with the ten lines"),
        (scan("1 2 3 0.5", columns=10**12), "scan 1 promises"),
        (scan("1 2 3 0.5", matrix=STRAIGHT.replace("1", "2")), "is no turn and shift"),
        (scan("1 2 3 900"), "intensities beyond 0 to 1"),
        (scan("1 2 3"), "lines of other than 4 or 7 numbers"),
        (scan("1 2 3 a"), "scan 1: "),
        ("\n", "has no scans"),
    ],
)
def test_what_is_wrong_is_told(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=says):
        opened(tmp_path, text)
