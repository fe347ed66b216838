"""COPC files: nothing is lost, each point in its node, levels uniform, read by laspy too."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import lazrs
import numpy as np
import pytest
from laspy.copc import Bounds
from pyproj import CRS
from scenes.layers import cloud

import toolbox
from toolbox.data import PointCloud
from toolbox.data.crs import same_crs
from toolbox.data.las import copc_write, octree
from toolbox.data.las.points import coordinates
from toolbox.data.record import read_record
from toolbox.errors import DataError
from toolbox.tiles.tiling import Tiling


def rolling(count: int = 60_000, seed: int = 3, **more: Any) -> PointCloud:
    """Rolling ground of 300 x 200 m, each point with a number of its own."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 300, count), rng.uniform(0, 200, count)
    z = 10 * np.sin(x / 40) + rng.normal(0, 0.05, count)
    xyz = np.column_stack([x + 500_000, y + 4_600_000, z]).round(2)
    attributes: dict[str, Any] = {
        "intensity": rng.integers(0, 60_000, count).astype(np.uint16),
        "gps_time": np.arange(count, dtype=float),
        "own": np.arange(count, dtype=np.uint32),
        "number_of_returns": np.full(count, 2, np.uint8),
        "return_number": rng.integers(1, 3, count).astype(np.uint8),
    }
    return cloud(xyz, 2, **(attributes | more))


def by_number(points: PointCloud) -> PointCloud:
    return points.select(np.argsort(points["own"], kind="stable"))


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several parts, though there are few points."""
    monkeypatch.setattr(copc_write, "_PART", 5_000)
    monkeypatch.setattr(copc_write, "_BLOCK", 7_000)


def test_nothing_is_lost(tmp_path: Path) -> None:
    points = rolling()
    points.save(tmp_path / "a.copc.laz")
    points.save(tmp_path / "a.laz")
    copc, plain = PointCloud.open(tmp_path / "a.copc.laz"), PointCloud.open(tmp_path / "a.laz")
    found = by_number(copc)
    assert found.names == plain.names
    np.testing.assert_array_equal(found.xyz, plain.xyz)
    for name in plain.names:
        np.testing.assert_array_equal(found[name], plain[name], err_msg=name)
    assert same_crs(found.crs, CRS(32635))


def test_laspy_reads_it_by_bounds_and_resolution(tmp_path: Path) -> None:
    points = rolling()
    points.save(tmp_path / "a.copc.laz")
    with laspy.CopcReader.open(str(tmp_path / "a.copc.laz")) as reader:
        assert reader.header.point_count == len(points)
        low, high = np.array([500_100, 4_600_050]), np.array([500_150, 4_600_090])
        near = reader.query(Bounds(mins=low, maxs=high))
        inside = points.within((*low, *high))
        assert sorted(near["own"].tolist()) == sorted(inside["own"].tolist())
        spacing = reader.copc_info.spacing
        coarse = reader.query(resolution=spacing)
        plan = np.column_stack([coarse.x, coarse.y])
        cells = np.floor((plan - reader.header.mins[:2]) / spacing)
        assert 0.1 < len(coarse) / len(points) < 0.5
        assert len(np.unique(cells, axis=0)) > 0.5 * len(coarse)
    ours = PointCloud.open(tmp_path / "a.copc.laz", bounds=(*low, *high))
    assert sorted(ours["own"].tolist()) == sorted(inside["own"].tolist())


def test_each_point_is_in_its_node(tmp_path: Path, small_parts: None) -> None:
    rolling().save(tmp_path / "a.copc.laz")
    with laspy.CopcReader.open(str(tmp_path / "a.copc.laz")) as reader:
        info, entries = reader.copc_info, reader.root_page.entries
        for key, entry in entries.items():
            edge = 2 * info.halfsize / 2**key.level
            low = info.center - info.halfsize + np.array([key.x, key.y, key.z]) * edge
            xyz = coordinates(reader.header, _unpacked(reader, entry))
            assert (xyz >= low - 1e-9).all()
            assert (xyz <= low + edge + 1e-9).all()
            assert len(xyz) == entry.point_count
            assert key.level == 0 or entry.point_count >= octree.FEWEST or _has_child(key, entries)


def _unpacked(reader: laspy.CopcReader, entry: Any) -> Any:
    """The point records of one node."""
    points = np.empty(entry.point_count, reader.header.point_format.dtype())
    reader.source.seek(entry.offset)
    lazrs.decompress_points_with_chunk_table(
        reader.source.read(entry.byte_size),
        reader.laszip_vlr.record_data,
        points.view(np.uint8),
        [(entry.point_count, entry.byte_size)],
    )
    return points


def _has_child(key: Any, entries: Any) -> bool:
    half = ((k.level, k.x // 2, k.y // 2, k.z // 2) for k in entries)
    return (key.level + 1, key.x, key.y, key.z) in half


def test_levels_do_not_show_the_parts(
    tmp_path: Path, small_parts: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Points of the coarse levels are the same, whether looked at in parts or at once."""
    points = rolling()
    points.save(tmp_path / "parts.copc.laz")
    monkeypatch.undo()
    points.save(tmp_path / "whole.copc.laz")
    parts, whole = (_levels(tmp_path / f"{name}.copc.laz") for name in ("parts", "whole"))
    assert parts == whole
    assert len(parts) > 2


def _levels(path: Path) -> dict[int, list[int]]:
    """The numbers of the points of each level."""
    found: dict[int, list[int]] = {}
    with laspy.CopcReader.open(str(path)) as reader:
        for level in range(20):
            numbers = reader.query(level=level)["own"].tolist()
            if numbers:
                found[level] = sorted(numbers)
    return found


def test_levels_are_uniform(tmp_path: Path) -> None:
    """A square with points of one density: as many in each part of the plan, at each level."""
    rng = np.random.default_rng(1)
    plan = rng.uniform(0, 100, (400_000, 2))
    xyz = np.column_stack([plan, np.zeros(len(plan))]).round(3)
    cloud(xyz).save(tmp_path / "a.copc.laz")
    with laspy.CopcReader.open(str(tmp_path / "a.copc.laz")) as reader:
        for level in (0, 1):
            points = reader.query(level=level)
            counts, *_ = np.histogram2d(np.asarray(points.x), np.asarray(points.y), bins=10)
            assert counts.min() > 0.9 * counts.mean()
            assert counts.max() < 1.1 * counts.mean()


def test_the_order_of_points_does_not_matter(tmp_path: Path) -> None:
    points = rolling(20_000)
    shuffled = points.select(np.random.default_rng(2).permutation(len(points)))
    points.save(tmp_path / "a.copc.laz")
    shuffled.save(tmp_path / "b.copc.laz")
    assert _levels(tmp_path / "a.copc.laz") == _levels(tmp_path / "b.copc.laz")


def test_header_tells_what_is_there(tmp_path: Path, small_parts: None) -> None:
    points = rolling()
    points.save(tmp_path / "a.copc.laz")
    with laspy.open(tmp_path / "a.copc.laz") as file:
        header = file.header
        np.testing.assert_allclose((*header.mins, *header.maxs), points.bounds, rtol=0, atol=1e-6)
        returns = np.bincount(points["return_number"], minlength=4)[1:4]
        assert header.number_of_points_by_return[:3].tolist() == returns.tolist()
        assert str(header.version) == "1.4"
        assert next(vlr.user_id for vlr in header.vlrs) == "copc"
        assert len(file.read()) == len(points)  # in the order of the file, by its chunk table
    with laspy.CopcReader.open(str(tmp_path / "a.copc.laz")) as reader:
        info = reader.copc_info
        assert (info.gps_min, info.gps_max) == (0.0, len(points) - 1.0)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_hardly_any_points(tmp_path: Path, count: int) -> None:
    rolling(3).select(range(count)).save(tmp_path / "a.copc.laz")
    assert len(PointCloud.open(tmp_path / "a.copc.laz")) == count
    if count:
        assert len(PointCloud.open(tmp_path / "a.copc.laz", bounds=(0, 0, 1e7, 1e7))) == count


def test_points_at_one_place(tmp_path: Path) -> None:
    cloud(np.zeros((5_000, 3)), own=np.arange(5_000)).save(tmp_path / "a.copc.laz")
    assert sorted(PointCloud.open(tmp_path / "a.copc.laz")["own"]) == list(range(5_000))


def test_a_dense_spot_has_all_nodes_above_it(tmp_path: Path) -> None:
    """Nodes of one point each lead down to it, which have too few to stay for themselves."""
    rng = np.random.default_rng(5)
    dense, wide = rng.uniform(0, 3, (50_000, 3)), rng.uniform(0, 1000, (500, 3))
    cloud(np.vstack([dense, wide]).round(3)).save(tmp_path / "a.copc.laz")
    assert len(PointCloud.open(tmp_path / "a.copc.laz", bounds=(0, 0, 3, 3))) > 49_000
    with laspy.CopcReader.open(str(tmp_path / "a.copc.laz")) as reader:
        entries = reader.root_page.entries
        assert max(key.level for key in entries) > 3
        keys = {(k.level, k.x, k.y, k.z) for k in entries}
        assert all((n - 1, x // 2, y // 2, z // 2) in keys for n, x, y, z in keys if n)


@pytest.mark.parametrize("number", [0, 1, 2, 3])
def test_older_formats_become_those_of_copc(tmp_path: Path, number: int) -> None:
    las = laspy.create(point_format=number, file_version="1.2")
    las.x, las.y, las.z = np.arange(3.0), np.arange(3.0), np.arange(3.0)
    las.classification = np.array([2, 5, 6], np.uint8)
    las.synthetic, las.withheld = np.array([0, 1, 0]), np.array([1, 0, 0])
    las.scan_angle_rank = np.array([-20, 0, 20], np.int8)
    las.header.parse_crs()
    las.write(tmp_path / "a.las")
    before = PointCloud.open(tmp_path / "a.las", assume_crs=CRS(32635))
    before.save(tmp_path / "a.copc.laz")
    found = PointCloud.open(tmp_path / "a.copc.laz")
    found = found.select(np.argsort(found["x"]))
    assert found.as_las()[0].header.point_format.id == (6 if number < 2 else 7)
    for name in ("classification", "synthetic", "withheld", *(["red"] if number >= 2 else [])):
        np.testing.assert_array_equal(found[name], before[name], err_msg=name)
    np.testing.assert_allclose(found["scan_angle"] * 0.006, [-20, 0, 20], rtol=0, atol=0.003)
    assert same_crs(found.crs, CRS(32635))


def test_waveforms_are_refused(tmp_path: Path) -> None:
    las = laspy.create(point_format=9, file_version="1.4")
    las.x = las.y = las.z = np.arange(2.0)
    las.write(tmp_path / "a.las")
    with pytest.raises(DataError, match=r"COPC holds no waveforms, .* write \.laz"):
        PointCloud.open(tmp_path / "a.las").save(tmp_path / "a.copc.laz")


def test_tiles_write_what_memory_does(tmp_path: Path, small_parts: None) -> None:
    rolling(20_000).save(tmp_path / "a.laz")
    values = {"points": tmp_path / "a.laz", "where": "intensity > 100"}
    toolbox.run("points.filter", {**values, "kept": tmp_path / "w.copc.laz"})
    tiling = Tiling(size=100.0, workers=1)
    toolbox.run("points.filter", {**values, "kept": tmp_path / "t.copc.laz"}, tiling=tiling)
    assert _levels(tmp_path / "w.copc.laz") == _levels(tmp_path / "t.copc.laz")
    assert "points.filter" in read_record(tmp_path / "t.copc.laz")
    assert not list(tmp_path.glob(".*.points"))


def test_real_data(data: Callable[[str], Path], tmp_path: Path) -> None:
    """A COPC file of PDAL through ours: the same points, extra bytes and records."""
    before = PointCloud.open(data("copc/ign_77050_627755_ground.copc.laz"))
    before.save(tmp_path / "a.copc.laz")
    found = PointCloud.open(tmp_path / "a.copc.laz")
    assert found.names == before.names
    names = ("gps_time", "return_number", "intensity", "x", "y", "z")
    orders = [np.lexsort([layer[name] for name in names]) for layer in (before, found)]
    for name in ("x", "y", "z", *before.names):
        ours, theirs = found[name][orders[1]], before[name][orders[0]]
        np.testing.assert_array_equal(ours, theirs, err_msg=name)
    with laspy.CopcReader.open(str(tmp_path / "a.copc.laz")) as reader:
        assert len(reader.query()) == len(before)


def test_a_point_stands_at_the_first_level_that_shows_it() -> None:
    """Against the definition: at a level each cell shows its point of lowest priority."""
    rng = np.random.default_rng(5)
    cube = octree.Cube(np.zeros(3), 1.0, 6)
    spots = rng.uniform(0, 1, (3, 40))  # dense spots of all sizes
    axes = np.clip(spots[:, rng.integers(0, 40, 5000)] + rng.normal(0, 0.01, (3, 5000)), 0, 0.999)
    axes[:, 4000:] = axes[:, :1000]  # points at one place
    codes = np.sort(cube.codes(axes))
    priority = rng.permutation(5000).astype(np.uint64)
    wanted = np.full(5000, cube.depth)
    for level in range(cube.depth - 1, -1, -1):
        cells = codes >> np.uint64(3 * (cube.depth - level))
        for cell in np.unique(cells):
            members = np.flatnonzero(cells == cell)
            wanted[members[np.argmin(priority[members])]] = level
    found = octree.levels_of(codes, priority, cube)
    np.testing.assert_array_equal(found, wanted)
