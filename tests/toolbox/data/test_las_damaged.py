"""Damaged LAS and LAZ files: a clear error or a correct read, never a hang or a crash."""

from __future__ import annotations

import io
import logging
import math
import resource
import struct
from collections.abc import Callable
from pathlib import Path

import laspy
import lazrs
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from toolbox.data import PointCloud
from toolbox.data.reading import errors_named
from toolbox.errors import DataError


def make(number: int = 1, minor: int = 2, *, compress: bool = False, count: int = 30) -> bytes:
    """A good file with an unknown VLR and, in 1.4, an EVLR."""
    header = laspy.LasHeader(version=f"1.{minor}", point_format=number)
    header.vlrs.append(laspy.VLR("maker", 1, "note", b"something"))
    cloud = laspy.LasData(header)
    cloud.x = np.arange(count) / 4
    cloud.y, cloud.z = cloud.x * 2, np.sin(np.asarray(cloud.x))
    if minor == 4:
        cloud.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("maker", 2, "late", b"more")])
    file = io.BytesIO()
    cloud.write(file, do_compress=compress)
    return file.getvalue()


LAS, LAZ = make(), make(compress=True)
LAS14, LAZ14 = make(7, 4), make(7, 4, compress=True)


def patched(content: bytes, offset: int, form: str, *values: float) -> bytes:
    changed = bytearray(content)
    struct.pack_into(form, changed, offset, *values)
    return bytes(changed)


def start_of_points(content: bytes) -> int:
    return int(struct.unpack_from("<I", content, 96)[0])


NAN, INF = float("nan"), float("inf")
TABLE = struct.unpack_from("<q", LAZ, start_of_points(LAZ))[0]
LASZIP = LAZ.index(b"laszip encoded") + 52  # where the content of the record begins
BROKEN = {
    "no LAS": (b"PK\3\4" + LAS[4:], "is not a LAS file"),
    "header cut": (LAS[:100], "ends within the header"),
    "version": (patched(LAS, 25, "<B", 7), r"version 1\.7"),
    "major version": (patched(LAS, 24, "<B", 2), r"version 2\.2"),
    "short header": (patched(LAS, 94, "<H", 200), "header of 200 bytes"),
    "long header": (patched(LAS, 94, "<H", 60_000), "header of 60000 bytes"),
    "points before header": (patched(LAS, 96, "<I", 100), "points begin at byte 100"),
    "points after end": (patched(LAS, 96, "<I", 10**9), "points begin at byte 1000000000"),
    "point format": (patched(LAS, 104, "<B", 11), "unknown point format 11"),
    "old compression": (patched(LAS, 104, "<B", 0xC1), "unknown point format 193"),
    "record length": (patched(LAS, 105, "<H", 20), "records of 20 bytes"),
    "count": (patched(LAS, 107, "<I", 31), "promises 31 points, and 30 are there"),
    "huge count": (patched(LAS14, 247, "<Q", 2**60), "promises 1152921504606846976 points"),
    "cut": (LAS[:-1], "promises 30 points, and 29 are there"),
    "zero scale": (patched(LAS, 131, "<d", 0), "impossible scale 0.0 for x"),
    "NaN scale": (patched(LAS, 139, "<d", NAN), "impossible scale nan for y"),
    "huge scale": (patched(LAS, 131, "<d", 1e300), r"impossible scale 1e\+300 for x"),
    "infinite offset": (patched(LAS, 171, "<d", INF), "impossible offset inf for z"),
    "EVLR before points": (patched(LAS14, 235, "<Q", 10), "records after the points at byte 10"),
    "EVLR after end": (patched(LAS14, 235, "<Q", 2**62), "records after the points at byte"),
    "many EVLRs": (patched(LAS14, 243, "<I", 2**31), "record 2 of 2147483648 after the points"),
    "EVLR cut": (LAS14[:-1], "record 1 of 1 after the points ends beyond the file"),
    "LAZ without laszip": (LAZ.replace(b"laszip encoded", b"laszip_encoded"), "no LASzip record"),
    "LAZ cut": (LAZ[: TABLE - 5], "is cut off or damaged: its table of chunks"),
    "LAZ table place": (patched(LAZ, start_of_points(LAZ), "<q", 3), "table of chunks"),
    "LAZ chunks": (patched(LAZ, TABLE + 4, "<I", 10**9), "claims 1000000000 chunks"),
    "LAZ count": (patched(LAZ, 107, "<I", 10**9), "promises 1000000000 points"),
    "LAZ no chunked": (patched(LAZ, LASZIP, "<H", 1), "in the way 1"),
    "LAZ items": (patched(LAZ, LASZIP + 32, "<H", 9), "damaged LASzip record"),
    "LAZ item size": (patched(LAZ, LASZIP + 36, "<H", 21), "but compressed ones of 29"),
    "LAZ layer": (
        patched(LAZ14, start_of_points(LAZ14) + 8 + 36 + 4, "<I", 2**32 - 1),
        "the chunk of points at byte .* is incomplete",
    ),
    "LAZ dense": (
        patched(patched(LAZ14, 247, "<Q", 10**9), LAZ14.index(b"laszip enc") + 64, "<I", 2**31),
        "claims 1000000000 points in",
    ),
}


@pytest.mark.parametrize("what", BROKEN)
def test_what_is_wrong_is_said(tmp_path: Path, what: str) -> None:
    content, message = BROKEN[what]
    path = tmp_path / "a.laz"
    path.write_bytes(content)
    with pytest.raises(DataError, match=message) as caught:
        PointCloud.open(path)
    assert str(caught.value).startswith(str(path))


def test_a_panic_of_the_decompressor_is_an_error(capfd: pytest.CaptureFixture[str]) -> None:
    """It is not even an Exception in Python."""
    laszip = LAZ[LASZIP : LASZIP + 34 + 2 * 6]
    with pytest.raises(DataError, match="damaged"), errors_named("damaged"):
        lazrs.decompress_points_with_chunk_table(b"abc", laszip, np.zeros(28, "u1"), [(1, 99)])
    capfd.readouterr()  # Rust prints its own account
    with pytest.raises(KeyboardInterrupt), errors_named("damaged"):
        raise KeyboardInterrupt


def test_missing_empty_and_wrong_files(tmp_path: Path) -> None:
    (tmp_path / "empty.las").touch()
    (tmp_path / "a.tif").write_bytes(b"II*")
    (tmp_path / "dir.las").mkdir()
    for name, message in {
        "none.las": "there is no file",
        "empty.las": "is empty",
        "a.tif": "points are read from",
        "dir.las": "holds no files of points",
    }.items():
        with pytest.raises(DataError, match=message):
            PointCloud.open(tmp_path / name)
    with pytest.raises(DataError, match="cannot be written"):
        PointCloud([[0, 0, 0]]).save(tmp_path / "nowhere" / "a.las")
    with pytest.raises(DataError, match="points are written as"):
        PointCloud([[0, 0, 0]]).save(tmp_path / "a.las.gz")


HARMLESS = {
    "VLR count": (patched(LAS, 100, "<I", 2**32 - 1), "promises 4294967295 variable length"),
    "VLR length": (patched(LAS, 227 + 20, "<H", 60_000), "promises 1 variable length records, but"),
    "box": (patched(LAS, 179, "<6d", -5, 5, NAN, NAN, INF, -INF), "bounding box"),
    "legacy count": (patched(LAS14, 107, "<I", 7), "7 in the field for older readers"),
    "too many records": (LAS + bytes(100), "room for 3 points more"),
}


@pytest.mark.parametrize("what", HARMLESS)
def test_what_does_no_harm_is_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, what: str
) -> None:
    content, message = HARMLESS[what]
    (tmp_path / "a.las").write_bytes(content)
    with caplog.at_level(logging.WARNING, "toolbox"):
        cloud = PointCloud.open(tmp_path / "a.las")
    assert message in caplog.text
    assert np.array_equal(cloud.xyz, laspy.read(io.BytesIO(LAS)).xyz)
    cloud.save(tmp_path / "b.las")
    header = laspy.read(tmp_path / "b.las").header
    assert np.array_equal(header.maxs, cloud.xyz.max(axis=0))
    assert np.array_equal(header.mins, cloud.xyz.min(axis=0))


@pytest.mark.parametrize("bits", [5, 0])
def test_wrong_extra_bytes_are_kept_but_not_shown(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, bits: int
) -> None:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.add_extra_dim(laspy.ExtraBytesParams("mine", "u2"))
    cloud = laspy.LasData(header)
    cloud.x, cloud.mine = np.arange(5.0), np.arange(5)
    cloud.write(tmp_path / "a.las")
    content = (tmp_path / "a.las").read_bytes()
    place = content.index(b"LASF_Spec") + 52 + 2  # the type of the dimension
    (tmp_path / "a.las").write_bytes(patched(content, place, "<B", bits and 31))
    with caplog.at_level(logging.WARNING, "toolbox"):
        found = PointCloud.open(tmp_path / "a.las")
    assert "extra bytes" in caplog.text
    assert "mine" not in found
    changed = found.with_attributes({"other": np.arange(5.0)})
    changed.save(tmp_path / "b.laz")
    raw = laspy.read(tmp_path / "b.laz").points.array.view("u1").reshape(5, -1)
    assert raw[:, -2:].copy().view("<u2").ravel().tolist() == [0, 1, 2, 3, 4]
    assert np.array_equal(PointCloud.open(tmp_path / "b.laz")["other"], np.arange(5.0))


def test_an_absurd_chunk_size_does_no_harm(tmp_path: Path) -> None:
    """laspy would set memory aside for such a chunk, which ends the process."""
    (tmp_path / "a.laz").write_bytes(patched(LAZ, LASZIP + 12, "<I", 2**32 - 2))
    found = PointCloud.open(tmp_path / "a.laz")
    assert np.array_equal(found.xyz, laspy.read(io.BytesIO(LAZ)).xyz)


@pytest.mark.parametrize(
    ("place", "kind", "value", "problem"),
    [
        (0, "<d", 1e6, "cube from .* does not hold the bounds of the header"),  # centre
        (24, "<d", 1.0, "cube from .* does not hold the bounds"),  # half of its side
        (24, "<d", math.nan, "cube from .* does not hold the bounds"),
        (24, "<d", math.inf, "cube from .* does not hold the bounds"),
        (
            48,
            "<Q",
            32,
            "holds 1? ?.*points, and the header promises 1065",
        ),  # bytes of the root page
        (48, "<Q", 33, "damaged COPC hierarchy"),
    ],
)
def test_a_damaged_cube_of_a_copc_file_is_no_result_with_fewer_points(
    place: int, kind: str, value: float, problem: str, data: Callable[[str], Path], tmp_path: Path
) -> None:
    content = bytearray(data("copc/simple.copc.laz").read_bytes())
    struct.pack_into(kind, content, content.index(b"copc\0") + 52 + place, value)
    (tmp_path / "a.copc.laz").write_bytes(content)
    with pytest.raises(DataError, match=problem):
        PointCloud.open(tmp_path / "a.copc.laz", bounds=(-1e9, -1e9, 1e9, 1e9))


@pytest.mark.parametrize(
    ("place", "value", "problem"),
    [
        (0, 31, "at a place that cannot be"),  # level
        (4, 1, "at a place that cannot be"),  # x of the root
        (28, 1, "and the header promises 1065"),  # number of points
        (28, -7, "damaged COPC hierarchy"),
        (24, 0, "damaged COPC hierarchy"),  # bytes
        (32 + 8, 7, "at a place that cannot be"),  # y of the second node
    ],
)
def test_a_damaged_node_of_a_copc_file(
    place: int, value: int, problem: str, data: Callable[[str], Path], tmp_path: Path
) -> None:
    content = bytearray(data("copc/simple.copc.laz").read_bytes())
    (root,) = struct.unpack_from("<Q", content, content.index(b"copc\0") + 52 + 40)
    struct.pack_into("<i", content, root + place, value)
    (tmp_path / "a.copc.laz").write_bytes(content)
    with pytest.raises(DataError, match=problem):
        PointCloud.open(tmp_path / "a.copc.laz", bounds=(-1e9, -1e9, 1e9, 1e9))


def test_copc_pages_in_a_circle_are_found(data: Callable[[str], Path], tmp_path: Path) -> None:
    content = bytearray(data("copc/simple.copc.laz").read_bytes())
    info = content.index(b"copc\0") + 52
    root, size = struct.unpack_from("<2Q", content, info + 40)
    struct.pack_into("<Qii", content, root + 16, root, size, -1)  # the page points at itself
    (tmp_path / "a.copc.laz").write_bytes(content)
    with pytest.raises(DataError, match="COPC hierarchy"):
        PointCloud.open(tmp_path / "a.copc.laz", bounds=(-1e9, -1e9, 1e9, 1e9))
    assert len(PointCloud.open(tmp_path / "a.copc.laz")) == 1065


def outcome(path: Path) -> PointCloud | str:
    """A cloud, or the text of the error."""
    try:
        return PointCloud.open(path)
    except DataError as error:
        return str(error)


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    content=st.sampled_from([LAS, LAZ, LAS14, LAZ14]),
    end=st.floats(0, 1) | st.none(),
    changes=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), max_size=6),
)
def test_any_damage_gives_an_error_or_a_cloud(
    tmp_path: Path, content: bytes, end: float | None, changes: list[tuple[float, int]]
) -> None:
    damaged = bytearray(content if end is None else content[: int(end * len(content))])
    for where, value in changes:
        if damaged:
            damaged[int(where * (len(damaged) - 1))] = value
    path = tmp_path / "a.laz"
    path.write_bytes(damaged)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = outcome(path)
    if isinstance(found, str):
        assert found.startswith(str(path))
    else:
        assert found.xyz.shape == (len(found), 3)
        assert all(len(found[name]) == len(found) for name in found.names)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # KiB


KNOWN = {
    "1.2-empty-geotiff-vlrs.las": 43,
    "1_4_w_evlr.laz": 1000,
    "bad_points_1.1.las": 1,
    "bad_vlr_count.las": 10,
    "extrabytes.las": 1065,
    "lots_of_vlr.las": 1,
    "malformed_extrabytes.las": 10,
    "no-points.las": 0,
    "nocrs.las": 30,
    "noepsg.laz": 17845,
    "simple1_3.las": 999,
    "single_point.laz": 1,
    "spurious.las": 1065,
    "warsaw_small.las": 3000,
    "1.2-with-color-clipped.las": None,
    "Semis_2022_0906_6665_nok.laz": None,
    "garbage_nVariableLength.las": ...,
    "simple-laszip-compressor-version-1.2r0.laz": None,
    "zero_bytes.las": None,
}


@pytest.mark.parametrize("name", KNOWN)
def test_odd_real_files(data: Callable[[str], Path], name: str) -> None:
    path, count = data(f"robustness/{name}"), KNOWN[name]
    if count is None:
        with pytest.raises(DataError, match=name):
            PointCloud.open(path)
    elif isinstance(count, int):
        assert len(PointCloud.open(path)) == count
    else:  # read or refused, but soon
        outcome(path)
