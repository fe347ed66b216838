"""points.retile: each point in one tile, margins, names, and files that are replaced together."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from pyproj import CRS
from scenes.layers import cloud

import toolbox
from algorithms.points.retile import PointsRetile
from toolbox.data import PointCloud, Survey
from toolbox.data.record import read_record
from toolbox.errors import DataError, ParameterError

SIDE, OVERLAP = 50.0, 7.0


def scene(count: int = 5000, seed: int = 1) -> PointCloud:
    """Points in 230 x 130 m, some exactly on edges of tiles, with attributes."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((499_930, 4_600_010, 0), (500_160, 4_600_140, 9), (count, 3))
    xyz[:40, 0], xyz[20:60, 1] = 500_000, 4_600_050
    columns = {
        "gps_time": np.arange(count, dtype=float),
        "intensity": rng.integers(0, 999, count).astype(np.uint16),
        "height": rng.uniform(0, 9, count).astype(np.float32),
    }
    return cloud(xyz, **columns)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder `in` with two files, and an empty folder `out`."""
    for name in ("in", "out"):
        (tmp_path / name).mkdir()
    whole = scene()
    west = whole.xyz[:, 0] < 500_033
    whole.select(west).save(tmp_path / "in/a.laz")
    whole.select(~west).save(tmp_path / "in/b.laz")
    return tmp_path


def retile(folder: Path, **values: Any) -> Path:
    out = folder / "out/tiles.vpc"
    overwrite = values.pop("overwrite", False)
    given = {"points": folder / "in", "side": SIDE, "tiles": out, **values}
    toolbox.run("points.retile", given, overwrite=overwrite)
    return out


def rows_of(points: PointCloud) -> list[tuple[Any, ...]]:
    columns = [points.xyz, *(points[name] for name in ("gps_time", "intensity", "height"))]
    return sorted(map(tuple, np.column_stack(columns).tolist()))


def test_each_point_is_in_one_tile_as_it_was(folder: Path) -> None:
    index = retile(folder)
    survey = Survey.open(index)
    assert rows_of(survey.read()) == rows_of(PointCloud.open(folder / "in"))
    whole = PointCloud.open(folder / "in")
    for file in survey.files:
        corner = np.array(file.path.stem.split("_")[1:], float)
        inside = (np.floor(whole.xyz[:, :2] / SIDE) * SIDE == corner).all(axis=1)
        tile = PointCloud.open(file.path)
        np.testing.assert_array_equal(tile["gps_time"], whole["gps_time"][inside])  # in their order
    assert len(survey.files) == 18
    assert not list((folder / "out").glob(".*"))


def test_tiles_hold_all_points_near_them(folder: Path) -> None:
    index = retile(folder, overlap=OVERLAP)
    whole = PointCloud.open(folder / "in")
    for file in Survey.open(index).files:
        corner = np.array(file.path.stem.split("_")[1:], float)
        points = PointCloud.open(file.path)
        away = np.maximum(corner - whole.xyz[:, :2], whole.xyz[:, :2] - corner - SIDE).max(axis=1)
        near = whole.select((away < OVERLAP - 1e-6) & (away >= -SIDE))
        assert rows_of(near) == rows_of(points)
        own = (np.floor(points.xyz[:, :2] / SIDE) * SIDE == corner).all(axis=1)
        np.testing.assert_array_equal(points["tile_margin"] == 0, own)
    assert "tiles.vpc" in {path.name for path in index.parent.iterdir()}


def test_margins_are_left_out_when_tiles_are_cut_again(folder: Path) -> None:
    retile(folder, overlap=OVERLAP)
    again = folder / "again.vpc"
    given = {"points": folder / "out/tiles.vpc", "side": 80.0, "tiles": again}
    toolbox.run("points.retile", given)
    found = PointCloud.open(again)
    assert rows_of(found) == rows_of(PointCloud.open(folder / "in"))
    assert "tile_margin" not in found


def test_side_and_margin_are_metres_in_feet(tmp_path: Path) -> None:
    foot = 1200 / 3937
    points = scene()
    points.with_xyz(points.xyz / foot).with_crs(CRS(2263)).save(tmp_path / "a.laz")
    out = tmp_path / "tiles.vpc"
    values = {"points": tmp_path / "a.laz", "side": SIDE, "overlap": OVERLAP, "tiles": out}
    toolbox.run("points.retile", values | {"pattern": "{column}_{row}.laz"})
    file = next(f for f in Survey.open(out).files if f.path.name == "10001_92001.laz")
    width = (file.bounds[3] - file.bounds[0]) * foot
    assert width == pytest.approx(SIDE + 2 * OVERLAP, abs=1.0)


def test_copc_tiles_are_read_by_laspy(folder: Path) -> None:
    index = retile(folder, pattern="{column}-{row}.copc.laz")
    survey = Survey.open(index)
    with laspy.CopcReader.open(survey.files[3].path) as reader:
        assert len(reader.query()) == survey.files[3].count
    assert rows_of(survey.read()) == rows_of(PointCloud.open(folder / "in"))


def test_copc_tiles_merge_to_the_copc_of_all(folder: Path) -> None:
    """The same points in the same nodes, so that no tile edge shows at any level."""
    points = scene(60_000)
    for path in (folder / "in").iterdir():
        path.unlink()
    points.save(folder / "in/a.laz")
    index = retile(folder, pattern="{x}_{y}.copc.laz")
    merged, direct = folder / "merged.copc.laz", folder / "direct.copc.laz"
    toolbox.run("points.merge", {"points": index, "merged": merged})
    points.save(direct)
    found, known = nodes_of(merged), nodes_of(direct)
    assert found == known
    assert min(map(len, known.values())) > 1000


def nodes_of(path: Path) -> dict[int, list[float]]:
    """GPS times of the points at each level of a COPC file."""
    with laspy.CopcReader.open(path) as reader:
        levels = {level: reader.query(level=level) for level in range(2)}
    return {level: sorted(found.gps_time.tolist()) for level, found in levels.items()}


def test_text_files_get_the_steps_of_all_points(tmp_path: Path) -> None:
    scene().save(tmp_path / "a.csv")
    values = {"points": tmp_path / "a.csv", "side": SIDE, "tiles": tmp_path / "t.vpc"}
    toolbox.run("points.retile", values, assume_crs="EPSG:32635")
    found, known = (PointCloud.open(tmp_path / name) for name in ("t.vpc", "a.csv"))
    order, other = (np.argsort(points["gps_time"]) for points in (found, known))
    np.testing.assert_allclose(found.xyz[order], known.xyz[other], atol=6e-5)
    assert len({file.scales for file in Survey.open(tmp_path / "t.vpc").files}) == 1


def test_earlier_tiles_are_replaced_with_the_index(folder: Path) -> None:
    retile(folder)
    before = set((folder / "out").iterdir())
    with pytest.raises(ParameterError, match="exists; allow it with overwrite=True"):
        retile(folder, side=70.0)
    assert set((folder / "out").iterdir()) == before
    index = retile(folder, side=70.0, overwrite=True)
    files = {file.path.name for file in Survey.open(index).files}
    assert {path.name for path in index.parent.glob("*.laz")} == files
    assert "points.retile" in read_record(index)
    assert "points.retile" in read_record(next(index.parent.glob("*.laz")))


def test_files_of_a_plain_index_stay(folder: Path) -> None:
    """Those that were there before belong to nobody."""
    toolbox.run("points.index", {"points": folder / "in", "index": folder / "in/tiles.vpc"})
    other = folder / "other.laz"
    scene(seed=2).save(other)
    values = {"points": other, "side": SIDE, "tiles": folder / "in/tiles.vpc"}
    toolbox.run("points.retile", values, overwrite=True)
    assert (folder / "in/a.laz").exists()


def test_inputs_are_never_overwritten(folder: Path) -> None:
    (folder / "in/b.laz").rename(folder / "in/tile_500000_4600000.laz")
    before = {path: path.read_bytes() for path in (folder / "in").iterdir()}
    values = {"points": folder / "in", "side": SIDE, "tiles": folder / "in/x.vpc"}
    with pytest.raises(DataError, match=r"tile_500000_4600000\.laz is also an input"):
        toolbox.run("points.retile", values, overwrite=True)
    assert {path: path.read_bytes() for path in (folder / "in").iterdir()} == before


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        ("tile_{x}.laz", "must tell tiles apart"),
        ("{x}_{y}.tif", r"ends in \.las or \.laz"),
        ("a/{x}_{y}.laz", "a file beside the index"),
        ("{x}_{y}_{z}.laz", r"\{z\} is not known"),
        ("{x_{y}.laz", "cannot be read"),
        ("{x:e}_{y:s}.laz", "cannot be read"),
    ],
)
def test_a_pattern_must_name_files(pattern: str, text: str, folder: Path) -> None:
    with pytest.raises(ParameterError, match=text):
        retile(folder, pattern=pattern)


def test_names_that_agree_are_refused(folder: Path) -> None:
    with pytest.raises(DataError, match="called alike"):
        retile(folder, pattern="{x:.0e}_{y}.laz")
    assert not list((folder / "out").iterdir())


def test_limits_between_values(folder: Path) -> None:
    with pytest.raises(ParameterError, match="overlap: must be less than the side, 50, got 50"):
        retile(folder, overlap=50.0)
    with pytest.raises(DataError, match=r"side: 0\.5 m would make up to \d+,\d+ files"):
        retile(folder, side=0.5)


def test_blocks_make_no_difference(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same files whether points are read at once or a thousand at a time."""
    index = retile(folder, overlap=OVERLAP)
    once = {path.name: path.read_bytes() for path in index.parent.glob("*.laz")}
    monkeypatch.setattr("toolbox.data.retiled._BATCH", 1000)
    retile(folder, overlap=OVERLAP, overwrite=True)
    assert {path.name: path.read_bytes() for path in index.parent.glob("*.laz")} == once


def test_empty_input_is_told(tmp_path: Path) -> None:
    scene().select([]).save(tmp_path / "a.laz")
    with pytest.raises(DataError, match="has no points"):
        PointsRetile(points=Survey.open(tmp_path / "a.laz")).run()


def test_the_index_says_that_its_files_are_its_own(folder: Path) -> None:
    index = json.loads(retile(folder).read_text())
    assert [len(item["assets"]) for item in index["features"]] == [1] * 18
    assert index["lidar_toolbox:files_belong_to_index"] is True
