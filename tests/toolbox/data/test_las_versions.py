"""The version and point format of LAS that is asked for, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from scenes.layers import cloud

import toolbox
from toolbox.data import PointCloud
from toolbox.data.crs import same_crs
from toolbox.errors import DataError, ParameterError
from toolbox.tiles.tiling import Tiling


def points(**more: Any) -> PointCloud:
    xyz = np.array([[500_000, 4_600_000, 5], [500_100, 4_600_050, 9.0]])
    attributes = {"scan_angle": np.array([-3000, 3000], np.int16), "own": np.array([1.5, 2.5])}
    return cloud(xyz, [2, 5], **(attributes | more))


@pytest.mark.parametrize(
    ("how", "version", "number"),
    [
        ({"version": "1.2"}, "1.2", 1),
        ({"version": "1.2", "format": 3}, "1.2", 3),
        ({"format": 7}, "1.4", 7),
        ({"format": 1}, "1.0", 1),
        ({"version": "1.4"}, "1.4", 6),
    ],
)
def test_what_is_asked_for_is_written(
    tmp_path: Path, how: dict[str, Any], version: str, number: int
) -> None:
    points().save(tmp_path / "a.laz", **how)
    with (tmp_path / "a.laz").open("rb") as file:
        head = file.read(110)
    assert f"{head[24]}.{head[25]}" == version
    assert head[104] & 0x3F == number
    found = PointCloud.open(tmp_path / "a.laz")
    np.testing.assert_array_equal(found.xyz, points().xyz)
    assert found["classification"].tolist() == [2, 5]
    assert found["own"].tolist() == [1.5, 2.5]
    angle = found["scan_angle"] * 0.006 if number >= 6 else found["scan_angle_rank"]
    np.testing.assert_allclose(angle, [-18, 18])
    assert same_crs(found.crs, points().crs)
    assert len(laspy.read(tmp_path / "a.laz")) == 2


@pytest.mark.parametrize(
    ("more", "how", "text"),
    [
        ({"classification": [2, 64]}, {"version": "1.2"}, "holds classification up to 31, .* 64"),
        ({"return_number": [1, 9]}, {"format": 1}, "holds return_number up to 7, and there is 9"),
        ({"nir": [1, 2]}, {"version": "1.2"}, "point format 3 has no nir, which the points have"),
        ({"red": [1, 2]}, {"format": 6}, "point format 6 has no red, which"),
        ({"gps_time": [1.0, 2.0]}, {"format": 0}, "point format 0 has no gps_time"),
        ({}, {"version": "1.2", "format": 6}, "LAS 1.2 has no point format 6"),
    ],
)
def test_what_would_be_lost_is_refused(
    tmp_path: Path, more: dict[str, Any], how: dict[str, Any], text: str
) -> None:
    given = {name: np.array(values) for name, values in more.items()}
    layer = points().with_attributes(given)
    with pytest.raises(DataError, match=text):
        layer.save(tmp_path / "a.laz", **how)


def test_by_the_command_and_in_tiles(tmp_path: Path) -> None:
    points().save(tmp_path / "a.laz")
    for name, tiling in (("w.laz", None), ("t.laz", Tiling(size=50.0, workers=1))):
        kept = {"path": tmp_path / name, "version": "1.2", "format": "3"}
        values = {"points": tmp_path / "a.laz", "where": "intensity >= 0", "kept": kept}
        toolbox.run("points.filter", values, tiling=tiling)
        assert laspy.read(tmp_path / name).header.point_format.id == 3
    with pytest.raises(ParameterError, match=r"option version: must be one of 1\.0, "):
        toolbox.run(
            "points.filter",
            {"points": tmp_path / "a.laz", "kept": {"path": tmp_path / "b.laz", "version": 2}},
        )
    with pytest.raises(DataError, match="are for LAS and LAZ"):
        points().save(tmp_path / "a.xyz", version="1.2")
