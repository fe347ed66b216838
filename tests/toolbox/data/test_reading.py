"""What is learned of files while they are read, and within which bounds that is done."""

from __future__ import annotations

import gzip
import hashlib
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes.layers import cloud

import toolbox
from toolbox.context import Context
from toolbox.data import PointCloud, Raster, Table, Vector, reading
from toolbox.data.las import read as las_read
from toolbox.data.reading import Reading, errors_named, file_hash, need_memory, opened
from toolbox.errors import Cancelled, DataError, MemoryShort, ParameterError

PLY = "ply\nformat ascii 1.0\nelement vertex 4000\n"
PLY += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
CONTENT = bytes(range(256)) * 300  # more than the buffer of a stream


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (KeyError("columns"), "a.x is damaged: KeyError: 'columns'"),
        (UnboundLocalError("wkt"), "a.x is damaged: UnboundLocalError: wkt"),
        (UnicodeDecodeError("utf-8", b"\xe5", 0, 1, "no"), "a.x is damaged: 'utf-8'"),
        (RecursionError("deep"), "a.x is damaged: it is nested too deeply"),
        (MemoryError(), "a.x is damaged: it claims more than fits in memory"),
        (PermissionError(13, "Permission denied"), "a.x is damaged: Permission denied"),
        (DataError("a.x has no rows"), "a.x has no rows"),
    ],
)
def test_whatever_a_library_raises_names_the_file(error: Exception, said: str) -> None:
    with pytest.raises(DataError) as caught, errors_named("a.x is damaged"):
        raise error
    assert str(caught.value).startswith(said)


def test_what_stops_a_run_is_no_error_of_a_file() -> None:
    for stop in (Cancelled(), KeyboardInterrupt()):
        with pytest.raises(type(stop)), errors_named("a.x is damaged"):
            raise stop


def test_memory_is_asked_for_before_it_is_used() -> None:
    need_memory(1000, "a.tif")
    with pytest.raises(MemoryShort, match=r"^a\.tif needs 1e\+09 GB of memory, and .* GB are free"):
        need_memory(1e18, "a.tif")


@given(
    moves=st.lists(st.tuples(st.integers(0, len(CONTENT) + 10), st.integers(-1, len(CONTENT)))),
)
def test_the_hash_is_the_same_in_whatever_order_a_file_is_read(
    moves: list[tuple[int, int]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path, reading = tmp_path_factory.mktemp("hash") / "a", Reading()
    path.write_bytes(CONTENT)
    with opened(path, reading) as stream:
        for start, size in moves:
            stream.seek(start)
            data = stream.read(size)
            assert data == CONTENT[start:][: size if size >= 0 else None]
    assert reading.hashes == {path: sha256(CONTENT)}


def old(path: Path, content: bytes = CONTENT) -> Path:
    """A file that was written long ago, so that the time tells when it is written again."""
    path.write_bytes(content)
    os.utime(path, (1000, 1000))
    return path


@pytest.mark.parametrize("reading", [Reading(), None])
def test_a_file_that_changes_while_it_is_read_is_an_error(
    tmp_path: Path, reading: Reading | None
) -> None:
    path = old(tmp_path / "a")

    def read() -> None:
        with opened(path, reading) as stream:
            stream.read(50_000)
            path.write_bytes(bytes(len(CONTENT)))

    with pytest.raises(DataError, match="a changed while the run was reading"):
        read()
    assert not (reading and reading.hashes)


def change(path: Path) -> None:
    path.write_bytes(bytes(len(CONTENT)))


def change_keeping_the_time(path: Path) -> None:
    change(path)
    os.utime(path, (1000, 1000))


def add(path: Path) -> None:
    path.write_bytes(CONTENT + b"more")
    os.utime(path, (1000, 1000))


def replace(path: Path) -> None:
    change_keeping_the_time(path.with_name("b"))
    path.with_name("b").replace(path)


@pytest.mark.parametrize("how", [change, change_keeping_the_time, add, replace])
def test_a_file_that_has_changed_since_is_named(
    how: Callable[[Path], None], tmp_path: Path
) -> None:
    path, other = old(tmp_path / "a"), old(tmp_path / "c")
    reading = Reading.of([path, other, tmp_path / "none"])
    reading.hash_of(path)
    reading.check_unchanged()
    how(path)
    with pytest.raises(DataError, match=f"^{path} changed while the run was reading"):
        reading.check_unchanged()
    reading.check_unchanged([other, tmp_path / "none"])


def link(path: Path) -> None:
    path.with_name("b").hardlink_to(path)


def allow(path: Path) -> None:
    path.chmod(0o600)


def copy(path: Path) -> None:
    old(path.with_name("b")).replace(path)


@pytest.mark.parametrize("how", [link, allow, copy, Path.unlink])
def test_a_file_of_the_same_content_is_the_same(
    how: Callable[[Path], None], tmp_path: Path
) -> None:
    path = old(tmp_path / "a")
    reading = Reading.of([path])
    reading.hash_of(path)
    how(path)
    reading.check_unchanged()


def test_a_file_that_cannot_be_read_has_no_hash(tmp_path: Path) -> None:
    path, reading = tmp_path / "a", Reading()
    path.write_bytes(CONTENT)
    with pytest.raises(ValueError, match="damaged"), opened(path, reading):
        raise ValueError("damaged")
    with pytest.raises(Cancelled), opened(path, reading, Context(stop=lambda: True)):
        pass
    assert not reading.hashes
    with pytest.raises(DataError, match="cannot be read"):
        reading.hash_of(tmp_path / "b")


def test_a_reader_may_close_what_it_reads(tmp_path: Path) -> None:
    path, reading = tmp_path / "a", Reading()
    path.write_bytes(CONTENT)
    with opened(path, reading) as stream:
        io.TextIOWrapper(stream, "latin-1").close()
    assert reading.hashes[path] == sha256(CONTENT)


@pytest.mark.parametrize("name", ["a.las", "a.laz", "a.csv", "a.csv.gz", "a.ply", "a.ply.gz"])
def test_a_point_cloud_is_hashed_while_it_is_read(name: str, tmp_path: Path) -> None:
    path, reading = tmp_path / name, Reading()
    points = cloud([[x, x % 7, 1.5] for x in range(5000)])
    if name == "a.ply.gz":
        points.save(tmp_path / "a.ply")
        path.write_bytes(gzip.compress((tmp_path / "a.ply").read_bytes()))
    else:
        points.save(path)
    read = PointCloud.open(path, reading=reading)
    assert reading.hashes == {path: sha256(path.read_bytes())}
    assert (read.xyz == PointCloud.open(path).xyz).all()


def test_a_survey_is_hashed_while_it_is_joined(tmp_path: Path) -> None:
    for k in range(3):
        cloud([[k, 0, 0], [k, 1, 1]]).save(tmp_path / f"{k}.laz")
    reading = Reading()
    PointCloud.open(tmp_path, reading=reading)
    assert reading.hashes == {p: sha256(p.read_bytes()) for p in tmp_path.iterdir()}
    near = Reading()
    PointCloud.open(tmp_path, bounds=(0, 0, 0.5, 1), reading=near)
    assert near.hashes.items() <= reading.hashes.items()  # the others are not touched
    assert len(near.hashes) == 1


@pytest.mark.parametrize("name", ["copc/simple.copc.laz", "feet/nebraska_wkt_and_geotiff.las"])
@pytest.mark.parametrize("bounds", [None, (0, 0, 1, 1)])
def test_of_a_real_file_all_is_hashed_although_not_all_is_read(
    data: Callable[[str], Path], name: str, bounds: tuple[float, ...] | None
) -> None:
    path, reading = data(name), Reading()
    PointCloud.open(path, bounds=bounds, reading=reading)
    assert reading.hashes == {path: file_hash(path)}


def test_a_file_that_is_cut_off_while_it_is_read_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.las"
    cloud([[x, 0, 0] for x in range(1000)]).save(path)
    plain = las_read.parse_metadata

    def cutting(stream: io.BufferedReader, *rest: object) -> object:
        found = plain(stream, *rest)  # type: ignore[arg-type]
        path.write_bytes(path.read_bytes()[:-10_000])
        return found

    monkeypatch.setattr(las_read, "parse_metadata", cutting)
    with pytest.raises(DataError, match="its points"):
        PointCloud.open(path)


def test_a_packed_file_is_unpacked_within_bounds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "_SMALL", 5000)
    text = b"1 2 3\n" * 4000
    for name, content in [("a.xyz.gz", text), ("a.ply.gz", PLY.encode() + text)]:
        path = tmp_path / name
        path.write_bytes(gzip.compress(content))
        most = 100 * path.stat().st_size  # deflate makes up to 1032 times as much
        with pytest.raises(DataError, match=f"unpacks to more than {most:,} bytes"):
            PointCloud.open(path)


@pytest.mark.parametrize("name", ["a.xyz", "a.xyz.gz"])
@pytest.mark.parametrize("before", [b"", b"1 2 3\n" * 5])
def test_a_line_without_end(name: str, before: bytes, tmp_path: Path) -> None:
    """It would be in memory whole, whoever reads it."""
    content = before + b"1 2 3 " * (reading.LONGEST // 6 + 1)
    (tmp_path / name).write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    with pytest.raises(DataError, match="has a line of more than 1,048,576 bytes"):
        PointCloud.open(tmp_path / name)


def test_long_files_of_short_lines_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.xyz"
    path.write_bytes(b"1 2 3\r" * 400_000)
    assert len(PointCloud.open(path)) == 400_000


OPENED = [(PointCloud, "a.laz"), (Raster, "a.tif"), (Vector, "a.gpkg"), (Table, "a.csv")]


@pytest.mark.parametrize(("layer", "name"), OPENED)
def test_an_address_on_the_web_is_named_as_given(layer: Any, name: str) -> None:
    pytest.importorskip("obstore")
    address = f"http://127.0.0.1:9/{name}"
    with pytest.raises(
        DataError, match=rf"^{address} cannot be read: the server cannot be reached"
    ):
        layer.open(address)


def test_an_address_given_to_a_run() -> None:
    pytest.importorskip("obstore")
    with pytest.raises(
        ParameterError, match=r"points: http://127\.0\.0\.1:9/a\.laz cannot be read"
    ):
        toolbox.run("points.info", {"points": "http://127.0.0.1:9/a.laz"})
