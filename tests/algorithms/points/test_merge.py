"""points.merge: what is reconciled, what is refused, and duplicates of overlapping files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.points.merge import PointsMerge, in_earlier_file
from toolbox import run
from toolbox.data import PointCloud
from toolbox.errors import DataError
from toolbox.tiles.tiling import Tiling

UTM = CRS(32635)


def strip(west: float, n: int = 400, seed: int = 0, **more: Any) -> PointCloud:
    """Points of 40 x 20 m with times, in steps of 1 mm."""
    rng = np.random.default_rng(seed)
    xyz = np.round(rng.uniform(0, 1, (n, 3)) * [40, 20, 3], 3) + np.array([west, 4_600_000, 0])
    columns: dict[str, Any] = {"gps_time": np.round(rng.uniform(0, 9, n), 6) + 100 * seed}
    columns |= {"return_number": np.ones(n, "u1"), "number_of_returns": np.ones(n, "u1")}
    columns |= {"point_source_id": np.full(n, 7 + seed, "u2")}
    return PointCloud(xyz, columns | more, crs=UTM)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two tiles with a rim of 5 m of the same points in both."""
    points = PointCloud.concat([strip(500_000, seed=0), strip(500_040, seed=1)])
    (tmp_path / "in").mkdir()
    points.select(points["x"] < 500_045).save(tmp_path / "in" / "a.laz")
    points.select(points["x"] >= 500_035).save(tmp_path / "in" / "b.laz")
    return tmp_path


def rows(cloud: PointCloud) -> list[tuple[float, ...]]:
    return sorted(map(tuple, np.column_stack([cloud.xyz, cloud["gps_time"]]).tolist()))


def test_points_of_the_rim_are_kept_once(folder: Path) -> None:
    kept = run("points.merge", {"points": folder / "in"})
    assert kept["dropped"] == 0
    found = run("points.merge", {"points": folder / "in", "duplicates": "drop"})
    assert len(found["merged"]) == 800
    assert found["dropped"] == len(kept["merged"]) - 800 > 50
    whole = PointCloud.concat([strip(500_000, seed=0), strip(500_040, seed=1)])
    assert rows(found["merged"]) == pytest.approx(np.array(rows(whole)))


def test_numbering_tells_the_files(folder: Path) -> None:
    values = {"points": folder / "in", "duplicates": "drop"}
    merged = run("points.merge", values | {"numbering": "file_id"})["merged"]
    east = merged["x"] >= 500_045  # what is in both is taken from the first
    assert (merged["file_id"] == np.where(east, 2, 1)).all()
    assert set(merged["point_source_id"]) == {7, 8}
    merged = run("points.merge", values | {"numbering": "point_source_id"})["merged"]
    assert (merged["point_source_id"] == np.where(east, 2, 1)).all()


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.0, 0.002])
def test_tiles_give_the_same_points(folder: Path, tolerance: float) -> None:
    values = {"points": folder / "in", "duplicates": "drop", "numbering": "file_id"}
    values |= {"max_difference": tolerance}
    whole = run("points.merge", values)
    out = folder / "tiles.laz"
    tiles = run("points.merge", values | {"merged": out}, tiling=Tiling(7.0, 1, 1 << 30))
    assert tiles["dropped"] == whole["dropped"]
    found = PointCloud.open(out)
    np.testing.assert_array_equal(found.xyz, whole["merged"].xyz)
    np.testing.assert_array_equal(found["file_id"], whole["merged"]["file_id"])


def test_another_time_or_return_is_another_point() -> None:
    xyz, file = np.zeros((4, 3)), np.array([0, 1, 1, 2], np.int32)
    time, number = np.array([5, 5, 6, 5.0]), np.array([1, 1, 1, 2])
    assert in_earlier_file(xyz, file, []).tolist() == [False, True, True, True]
    assert in_earlier_file(xyz, file, [time]).tolist() == [False, True, False, True]
    assert in_earlier_file(xyz, file, [time, number]).tolist() == [False, True, False, False]


def test_points_of_one_file_at_one_place_stay() -> None:
    xyz, file = np.zeros((3, 3)), np.zeros(3, np.int32)
    assert not in_earlier_file(xyz, file, []).any()
    twice = PointCloud(xyz, crs=UTM)
    assert PointsMerge(points=twice, duplicates="drop").run().dropped == 0


@given(
    st.lists(st.tuples(*[st.integers(-9, 9)] * 3, st.integers(0, 2)), min_size=1, max_size=60),
    st.sampled_from([0.01, 0.02, 0.035]),
)
def test_tolerance_finds_what_is_near_and_nothing_else(
    found: list[tuple[int, ...]], tolerance: float
) -> None:
    """Against comparing all pairs."""
    table: NDArray[np.int64] = np.array(found)
    xyz, file = table[:, :3] / 100 + 500_000, table[:, 3].astype(np.int32)
    away = np.abs(table[:, None, :3] - table[None, :, :3]).max(axis=2)
    wanted = ((away <= tolerance * 100) & (file[None] < file[:, None])).any(axis=1)
    assert in_earlier_file(xyz, file, [], tolerance).tolist() == wanted.tolist()


def test_formats_scales_and_extra_bytes_are_reconciled(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """LAS 1.2 in steps of 1 cm and LAS 1.4 in steps of 1 mm, each with its own attribute."""
    fine = strip(500_000, 50, echo=np.arange(50, dtype=np.float32))
    fine.save(tmp_path / "fine.las")
    header = laspy.LasHeader(version="1.2", point_format=3)
    header.scales, header.offsets = [0.01] * 3, [500_000, 4_600_000, 0]
    header.add_crs(UTM)
    coarse = laspy.LasData(header)
    coarse.x, coarse.y, coarse.z = fine.xyz.T
    coarse.gps_time, coarse.red = fine["gps_time"], np.arange(50) * 100
    coarse.return_number = coarse.number_of_returns = np.ones(50, "u1")
    coarse.write(tmp_path / "rough.las")
    values = {"points": tmp_path, "merged": tmp_path / "out.laz"}
    with caplog.at_level("WARNING", "toolbox"):
        run("points.merge", values)
    merged = PointCloud.open(tmp_path / "out.laz")
    assert len(merged) == 100
    assert {"echo", "red", "gps_time"} <= set(merged.names)
    np.testing.assert_array_equal(merged["echo"], [*range(50), *[0] * 50])
    np.testing.assert_array_equal(merged["red"], [*[0] * 50, *range(0, 5000, 100)])
    np.testing.assert_allclose(merged.xyz[:50], fine.xyz, atol=1e-9)
    assert "rough.las: has no echo; 0 is written there" in caplog.text
    dropped = run("points.merge", {"points": tmp_path / "*.las", "duplicates": "drop"})["dropped"]
    assert dropped < 3  # rounded to 1 cm they are elsewhere
    near = {"points": tmp_path / "*.las", "duplicates": "drop", "max_difference": 0.005}
    assert run("points.merge", near)["dropped"] == 50


@pytest.mark.parametrize(
    ("crs", "message"),
    [
        ("EPSG:32634", "b.laz is in EPSG:32634 .*reproject it to EPSG:32635"),
        ("EPSG:2263", "b.laz is in EPSG:2263 .*reproject it to EPSG:32635"),  # feet
        ("EPSG:32635+5773", "b.laz is in EPSG:32635.5773 .*assign its heights"),
        (None, "b.laz has no CRS; state it with assume_crs"),
    ],
)
def test_other_crs_units_and_heights_are_refused(
    tmp_path: Path, crs: str | None, message: str
) -> None:
    strip(500_000).save(tmp_path / "a.laz")
    strip(500_000).with_crs(crs and CRS(crs)).save(tmp_path / "b.laz")
    with pytest.raises(DataError, match=message):
        run("points.merge", {"points": tmp_path})


def test_too_many_files_for_their_numbers() -> None:
    points = strip(500_000, 3).with_file(np.array([0, 1, 65_535]))
    with pytest.raises(DataError, match="numbering: LAS numbers up to 65535 files, got 65536"):
        PointsMerge(points=points, numbering="file_id").run()
    assert len(PointsMerge(points=points).run().merged) == 3
