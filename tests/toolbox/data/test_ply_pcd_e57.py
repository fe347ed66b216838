"""PLY, PCD and E57: what other programs wrote comes in whole, or not at all."""

from __future__ import annotations

import gzip
import logging
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import plyfile
import pytest
from pypcd4.pypcd4 import Encoding
from pypcd4.pypcd4 import PointCloud as PcdFile

from toolbox.data import PointCloud
from toolbox.data.crs import parse_crs
from toolbox.data.e57 import _crs, _stretched
from toolbox.errors import DataError

XYZ = np.array([[1.5, 2, 3], [4, 5, 6], [7, 8, 9.25]])


def ply(path: Path, *, text: bool = False, order: str = "<") -> Path:
    kinds = [("x", "f8"), ("y", "f4"), ("z", "f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
    vertices = np.zeros(3, [*kinds, ("Classification", "i4")])
    vertices["x"], vertices["y"], vertices["z"] = XYZ.T
    vertices["red"], vertices["Classification"] = [0, 1, 255], [2, 3, 4]
    faces = np.array([([0, 1, 2],)], [("vertex_indices", "i4", (3,))])
    elements = [
        plyfile.PlyElement.describe(vertices, "vertex"),
        plyfile.PlyElement.describe(faces, "face"),
    ]
    plyfile.PlyData(elements, text=text, byte_order=order).write(str(path))
    return path


@pytest.mark.parametrize(("text", "order"), [(True, "="), (False, "<"), (False, ">")])
def test_ply_vertices(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, text: bool, order: str
) -> None:
    with caplog.at_level(logging.WARNING, "toolbox"):
        cloud = PointCloud.open(ply(tmp_path / "a.ply", text=text, order=order))
    assert "not its face" in caplog.text
    assert np.array_equal(cloud.xyz, XYZ)
    assert cloud["red"].tolist() == [0, 257, 65535]
    assert cloud["classification"].tolist() == [2, 3, 4]
    assert cloud["classification"].dtype.isnative


def test_ply_out_and_in_again(tmp_path: Path) -> None:
    cloud = PointCloud.open(ply(tmp_path / "a.ply")).with_attributes(
        {"ratio": np.array([0.1, 0.2, 0.3]), "flag": [True, False, True], "id": [1, 2, 2**31 - 1]}
    )
    cloud.save(tmp_path / "b.ply")
    header = plyfile.PlyData.read(tmp_path / "b.ply")
    assert header.header.splitlines()[1] == "format binary_little_endian 1.0"
    assert header["vertex"].ply_property("red").val_dtype == "u1"
    again = PointCloud.open(tmp_path / "b.ply")
    assert np.array_equal(again.xyz, cloud.xyz)
    for name in cloud.names:
        assert np.array_equal(again[name], cloud[name]), name
    wide = cloud.with_attributes({"red": [1, 2, 3]})
    wide.save(tmp_path / "c.ply")
    assert PointCloud.open(tmp_path / "c.ply")["red"].tolist() == [1, 2, 3]


def test_what_ply_cannot_hold(tmp_path: Path) -> None:
    for attributes, message in [
        ({"id": [2**40]}, "'id' is of type int64"),
        ({"echo width": [1]}, "'echo width' cannot be"),
        ({"triple": [[1, 2, 3]]}, "several values"),
    ]:
        with pytest.raises(DataError, match=message):
            PointCloud([[0, 0, 0]], attributes).save(tmp_path / "a.ply")  # type: ignore[arg-type]


def test_damaged_ply(tmp_path: Path) -> None:
    content = ply(tmp_path / "a.ply").read_bytes()
    start = content.index(b"end_header") + 11
    for broken, message in [
        (content[: start + 10], "cannot be read"),
        (b"plx" + content[3:], "cannot be read"),
        (content.replace(b"vertex 3", b"vertex 9"), "cannot be read"),
        (content.replace(b"vertex 3", b"vertex 999999999999999"), "cannot be read"),
        (content.replace(b"element vertex", b"element vortex"), "has no vertices"),
        (content.replace(b"double x", b"double u"), "has no x"),
        (content[:start] + b"\0\0\0\0\0\0\xf8\x7f" + content[start + 8 :], "point 0 has the coord"),
    ]:
        (tmp_path / "b.ply").write_bytes(broken)
        with pytest.raises(DataError, match=message):
            PointCloud.open(tmp_path / "b.ply")


def pcd(path: Path, encoding: Encoding = Encoding.BINARY) -> Path:
    rgb = np.array([0x00010203, 0x00FF8000, 0], np.uint32).view(np.float32)
    columns = [*XYZ.astype(np.float32).T, rgb, np.array([5, 6, 7], np.uint16)]
    kinds = [np.float32] * 4 + [np.uint16]
    names = ["x", "y", "z", "rgb", "label"]
    PcdFile.from_points(columns, names, kinds).save(path, encoding)
    return path


@pytest.mark.parametrize("encoding", [Encoding.BINARY, Encoding.BINARY_COMPRESSED])
def test_pcd_points(tmp_path: Path, encoding: Encoding) -> None:
    cloud = PointCloud.open(pcd(tmp_path / "a.pcd", encoding))
    assert np.array_equal(cloud.xyz, XYZ)
    assert (cloud["red"] // 257).tolist() == [1, 255, 0]
    assert (cloud["green"] // 257).tolist() == [2, 128, 0]
    assert (cloud["blue"] // 257).tolist() == [3, 0, 0]
    assert cloud["label"].tolist() == [5, 6, 7]


def test_pcd_places_without_a_point(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    columns = [np.array([1, np.nan, 3], np.float32)] * 3
    PcdFile.from_points(columns, ["x", "y", "z"], [np.float32] * 3).save(tmp_path / "a.pcd")
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert PointCloud.open(tmp_path / "a.pcd").xyz[:, 0].tolist() == [1, 3]
    assert "1 places without a point" in caplog.text


def test_damaged_pcd(tmp_path: Path) -> None:
    content = pcd(tmp_path / "a.pcd").read_bytes()
    for broken, message in [
        (content[:-30], "cannot be read|are there"),
        (content[:40], "cannot be read"),
        (content.replace(b"POINTS 3", b"POINTS 9"), "cannot be read|are there"),
        (content.replace(b"FIELDS x", b"FIELDS u"), "has no x"),
        (b"\xff\xfe" * 40, "cannot be read"),
    ]:
        (tmp_path / "b.pcd").write_bytes(broken)
        with pytest.raises(DataError, match=message):
            PointCloud.open(tmp_path / "b.pcd")


def e57(path: Path, *, scans: int = 2) -> Path:
    pye57 = pytest.importorskip("pye57")
    with pye57.E57(str(path), mode="w") as file:
        for number in range(scans):
            data: dict[str, Any] = {f"cartesian{a}": XYZ[:, k] for k, a in enumerate("XYZ")}
            data["intensity"] = np.array([0.0, 0.5, 1.0])
            for colour in ("Red", "Green", "Blue"):
                data[f"color{colour}"] = np.array([0, 1, 255], np.uint8)
            if number == 1:
                data["cartesianInvalidState"] = np.array([0, 1, 0], np.int8)
            turn = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # 90 degrees about z
            file.write_scan_raw(data, rotation=turn, translation=np.array([100.0, number, 0]))
    return path


def test_e57_scans_at_their_place(tmp_path: Path) -> None:
    cloud = PointCloud.open(e57(tmp_path / "a.e57"))
    turned = np.column_stack([100 - XYZ[:, 1], XYZ[:, 0], XYZ[:, 2]])
    assert np.allclose(cloud.xyz[:3], turned)
    assert np.allclose(cloud.xyz[3:], turned[[0, 2]] + (0, 1, 0))  # the invalid one is left out
    assert cloud["point_source_id"].tolist() == [1, 1, 1, 2, 2]
    assert cloud["intensity"].tolist() == [0, 32768, 65535, 0, 65535]
    assert cloud["red"].tolist() == [0, 257, 65535, 0, 65535]
    assert cloud.crs is None
    cloud.save(tmp_path / "a.laz")
    assert np.array_equal(PointCloud.open(tmp_path / "a.laz")["intensity"], cloud["intensity"])


@pytest.mark.parametrize(("text", "code"), [(None, 2154), ("", None), ("nonsense", None)])
def test_the_crs_of_an_e57_file(text: str | None, code: int | None) -> None:
    wkt = parse_crs("EPSG:2154").to_wkt() if text is None else text

    class Root(dict[str, Any]):
        isDefined = dict.__contains__

    file = SimpleNamespace(root=Root(coordinateMetadata=SimpleNamespace(value=lambda: wkt)))
    found = _crs(file, "a.e57")
    assert (found and found.to_epsg()) == code
    assert _crs(SimpleNamespace(root=Root()), "a.e57") is None


def test_e57_intensity_beyond_its_limits(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Values are kept with single precision, limits with double."""
    pye57 = pytest.importorskip("pye57")
    values = np.array([0.1, 0.35, 0.7])
    data = {f"cartesian{a}": XYZ[:, k] for k, a in enumerate("XYZ")} | {"intensity": values}
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        file.write_scan_raw(data)
    assert PointCloud.open(tmp_path / "a.e57")["intensity"].tolist() == [0, 27306, 65535]
    assert not caplog.records
    wide = _stretched("intensity", np.array([0.0, 50.0, 200.0]), (0.0, 100.0))
    assert wide.tolist() == [0, 16384, 65535]
    assert "intensity goes from 0 to 200, beyond the limits" in caplog.text


def test_damaged_e57(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    content = e57(tmp_path / "a.e57").read_bytes()
    for broken in (content[:-400], b"x" * 2000, content[:100]):
        (tmp_path / "b.e57").write_bytes(broken)
        with pytest.raises(DataError, match="cannot be read"):
            PointCloud.open(tmp_path / "b.e57")
    with pytest.raises(DataError, match="no scans"):
        PointCloud.open(e57(tmp_path / "c.e57", scans=0))
    capfd.readouterr()  # libE57Format prints its errors


def test_without_its_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = e57(tmp_path / "a.e57")
    cloud = PointCloud.open(path)
    cloud.save(tmp_path / "a.ply")
    monkeypatch.setattr("toolbox.data.extras.find_spec", lambda name: None)
    with pytest.raises(DataError, match="pip install pye57"):
        PointCloud.open(path)
    with pytest.raises(DataError, match="pip install plyfile"):
        PointCloud.open(tmp_path / "a.ply")
    with pytest.raises(DataError, match="pip install plyfile"):
        cloud.save(tmp_path / "b.ply")


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("cgal_b9_als/b9_training.ply", 22300),
        ("tls_room_scans/room_scan1.pcd", 112586),
        ("facade_pcl_cornice/region_growing_tutorial.pcd", 108104),
        ("isprs_samples/samp54.txt.gz", 8608),
    ],
)
def test_real_files_of_other_formats(data: Callable[[str], Path], name: str, count: int) -> None:
    assert len(PointCloud.open(data(name))) == count


def test_compressed_ply(tmp_path: Path) -> None:
    PointCloud(np.eye(3), {"intensity": np.arange(3, dtype=np.uint16)}).save(tmp_path / "a.ply")
    packed = gzip.compress((tmp_path / "a.ply").read_bytes())
    (tmp_path / "a.ply.gz").write_bytes(packed)
    cloud = PointCloud.open(tmp_path / "a.ply.gz")
    assert np.array_equal(cloud.xyz, np.eye(3))
    assert cloud["intensity"].tolist() == [0, 1, 2]
    for damaged in (packed[: len(packed) // 2], b"no gzip"):
        (tmp_path / "a.ply.gz").write_bytes(damaged)
        with pytest.raises(DataError, match=r"a\.ply\.gz"):
            PointCloud.open(tmp_path / "a.ply.gz")


def test_the_sample_of_the_cloth_simulation(data: Callable[[str], Path]) -> None:
    assert len(PointCloud.open(data("csf_sample/sample.ply.gz"))) > 10_000


PCD = (
    "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA binary\n"
)
PLY = "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\n"
PLY += "property double z\nelement face 0\nend_header\n1 2 3\n"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.pcd", PCD.replace("COUNT 1 1 1", "COUNT 1 1 1000000000000")),
        ("a.pcd", PCD.replace("COUNT 1 1 1", "COUNT 1 1 1000000000000").replace("TS 2", "TS 0")),
        ("a.pcd", PCD.replace("WIDTH 2", "WIDTH 99999999999").replace("TS 2", "TS 99999999999")),
        ("a.pcd", PCD.replace("binary", "binary_compressed") + "\1\0\0\0\xff\xff\xff\x7f"),
        ("a.ply", PLY.replace("element face 0", "element foo 100000000000")),
        ("a.ply", PLY.replace("vertex 1", "vertex 99999999999")),
        ("a.ply.gz", PLY.replace("element face 0", "element foo 100000000000")),
    ],
)
def test_a_header_that_promises_more_than_the_file_can_hold(
    name: str, content: str, tmp_path: Path
) -> None:
    """It is an error before any work is done, or the test would not end."""
    path, raw = tmp_path / name, content.encode("latin-1")
    path.write_bytes(gzip.compress(raw) if path.suffix == ".gz" else raw)
    with pytest.raises(DataError, match="promises"):
        PointCloud.open(path)


def test_a_ply_header_without_an_end(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(PLY.replace("end_header", "comment " + "x" * 2**20))
    with pytest.raises(DataError, match="header does not end"):
        PointCloud.open(tmp_path / "a.ply")


def test_scans_of_more_points_than_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = e57(tmp_path / "a.e57")
    monkeypatch.setattr("toolbox.data.e57._BITS", 0)
    with pytest.raises(DataError, match="scan 1 promises 3 points"):
        PointCloud.open(path)


def test_points_that_pack_as_well_as_lzf_can(tmp_path: Path) -> None:
    columns = [np.zeros(10_000, np.float32)] * 3
    file = PcdFile.from_points(columns, ["x", "y", "z"], [np.float32] * 3)
    file.save(tmp_path / "a.pcd", Encoding.BINARY_COMPRESSED)
    assert (tmp_path / "a.pcd").stat().st_size < 120_000 / 75
    assert len(PointCloud.open(tmp_path / "a.pcd")) == 10_000
