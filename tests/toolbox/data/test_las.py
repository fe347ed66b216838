"""LAS and LAZ: nothing is lost, and changes go where the format has room for them."""

from __future__ import annotations

import io
import logging
import struct
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from laspy.vlrs.vlrlist import VLRList

from toolbox.context import Context
from toolbox.data import PointCloud, Survey
from toolbox.data.crs import LOCALS, parse_crs, same_crs
from toolbox.data.las import read as las
from toolbox.data.las.crs import crs_vlrs, read_crs
from toolbox.data.las.header import parse_metadata
from toolbox.errors import Cancelled, DataError

COMBINATIONS = [(2, f) for f in range(4)] + [(3, f) for f in range(6)] + [(4, f) for f in range(11)]
WAVEFORMS = {9, 10}


def make(minor: int, number: int, count: int = 40, *, compress: bool = False) -> bytes:
    """A file full of oddities, written by laspy: extra bytes, records, flags, spare bytes."""
    rng = np.random.default_rng(number + 100 * minor)
    header = laspy.LasHeader(version=f"1.{minor}", point_format=number)
    header.scales, header.offsets = [0.001, 0.01, 0.0025], [500_000, 5_100_000.5, -3]
    header.file_source_id, header.uuid = 77, uuid.UUID(int=2**100 + 5)
    header.global_encoding.value = 17 if number >= 6 else 1
    header.system_identifier, header.generating_software = "Scanner 3", "Flight tool"
    header.extra_header_bytes, header.extra_vlr_bytes = b"more", b"\xdd\xcc gap"
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams("height", "i2", "above ground", [7.5], [0.01]),
            laspy.ExtraBytesParams("echo width", "f8", "ns"),
            laspy.ExtraBytesParams("triple", "3u2"),
        ]
    )
    header.vlrs.append(laspy.VLR("maker", 12, "notes", b"\0\1\2 text \xff"))
    cloud = laspy.LasData(header)
    raw = rng.integers(0, 256, (count, header.point_format.size), np.uint8)
    record = np.frombuffer(raw.tobytes(), header.point_format.dtype()).copy()
    for name in record.dtype.names or ():
        if record.dtype[name].base.kind == "f":  # arbitrary bits make NaN
            record[name] = rng.normal(size=record[name].shape)
    if number in WAVEFORMS:  # which LAZ keeps for a single scanner channel only
        record["classification_flags"] &= 0b11001111
    cloud.points = laspy.ScaleAwarePointRecord(
        record, header.point_format, header.scales, header.offsets
    )
    if minor == 4:
        cloud.evlrs = VLRList([laspy.VLR("maker", 13, "long notes", bytes(range(256)) * 300)])
    file = io.BytesIO()
    cloud.write(file, do_compress=compress)
    odd = bytearray(file.getvalue())
    odd[90:94] = bytes(4)  # no date
    place = struct.unpack_from("<H", odd, 94)[0]
    odd[place : place + 2] = b"\xbb\xaa"  # reserved bytes of the first record
    return bytes(odd)


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def without_counts(content: bytes) -> bytes:
    """laspy leaves the counts for older readers empty, we fill them in."""
    return content[:107] + content[131:]


@pytest.mark.parametrize(("minor", "number"), COMBINATIONS)
def test_a_las_file_comes_back_byte_for_byte(tmp_path: Path, minor: int, number: int) -> None:
    content = make(minor, number)
    cloud = PointCloud.open(write(tmp_path / "a.las", content))
    cloud.save(tmp_path / "b.las")
    assert without_counts((tmp_path / "b.las").read_bytes()) == without_counts(content)


@pytest.mark.parametrize(("minor", "number"), COMBINATIONS)
def test_compressing_and_unpacking_loses_nothing(tmp_path: Path, minor: int, number: int) -> None:
    content = make(minor, number)
    PointCloud.open(write(tmp_path / "a.las", content)).save(tmp_path / "b.laz")
    PointCloud.open(tmp_path / "b.laz").save(tmp_path / "c.las")
    assert without_counts((tmp_path / "c.las").read_bytes()) == without_counts(content)
    packed = write(tmp_path / "d.laz", make(minor, number, compress=True))
    PointCloud.open(packed).save(tmp_path / "e.las")
    assert without_counts((tmp_path / "e.las").read_bytes()) == without_counts(content)


def test_waveforms_of_several_channels_are_not_spoilt_by_compression(tmp_path: Path) -> None:
    cloud = PointCloud.open(write(tmp_path / "a.las", make(4, 9)))
    mixed = cloud.with_attributes({"scanner_channel": np.arange(40) % 4})
    with pytest.raises(DataError, match=r"write \.las"):
        mixed.save(tmp_path / "b.laz")
    mixed.save(tmp_path / "b.las")
    assert np.array_equal(PointCloud.open(tmp_path / "b.las")["x_t"], cloud["x_t"])


@pytest.mark.parametrize(("minor", "number"), COMBINATIONS)
def test_values_are_those_of_laspy(tmp_path: Path, minor: int, number: int) -> None:
    path = write(tmp_path / "a.las", make(minor, number))
    cloud, other = PointCloud.open(path), laspy.read(path)
    assert set(cloud.names) == set(other.point_format.dimension_names) - {"X", "Y", "Z"}
    assert np.array_equal(cloud.xyz, other.xyz)
    for name in cloud.names:
        assert np.array_equal(cloud[name], np.asarray(other[name])), name
    assert cloud.descriptions["height"] == "above ground"


@pytest.mark.parametrize(("minor", "number"), [(2, 1), (4, 3), (4, 8)])
def test_other_programs_read_what_is_written(tmp_path: Path, minor: int, number: int) -> None:
    cloud = PointCloud.open(write(tmp_path / "a.las", make(minor, number)))
    some = cloud.select(np.arange(0, 40, 3)).with_attributes({"quality": np.arange(14.0)})
    some.save(tmp_path / "b.laz")
    other = laspy.read(tmp_path / "b.laz")
    assert np.array_equal(other.xyz, cloud.xyz[::3])
    assert np.array_equal(other["quality"], np.arange(14.0))
    assert other.header.point_count == 14
    assert np.array_equal(other.header.mins, cloud.xyz[::3].min(axis=0))
    assert np.array_equal(other.header.maxs, cloud.xyz[::3].max(axis=0))
    counts = np.bincount(np.asarray(other.return_number), minlength=16)[1:]
    limit = 5 if minor < 4 else 15
    assert np.array_equal(other.header.number_of_points_by_return[:limit], counts[:limit])
    for name in cloud.names:
        assert np.array_equal(np.asarray(other[name]), cloud[name][::3]), name


@pytest.mark.parametrize(("minor", "later"), [(0, 2), (1, 2)])
def test_versions_that_laspy_does_not_write_stay(tmp_path: Path, minor: int, later: int) -> None:
    content = bytearray(make(2, 1))
    content[25] = minor
    cloud = PointCloud.open(write(tmp_path / "a.las", bytes(content)))
    cloud.save(tmp_path / "b.las")
    assert (tmp_path / "b.las").read_bytes() == content
    cloud.with_attributes({"red": np.ones(40, int)}).save(tmp_path / "c.las")
    assert (tmp_path / "c.las").read_bytes()[25] == later  # the first that has point format 3


def test_waveforms_within_a_1_3_file_keep_their_place(tmp_path: Path) -> None:
    content = bytearray(make(3, 4))
    struct.pack_into("<H", content, 6, 3)
    struct.pack_into("<Q", content, 227, len(content))
    packets = b"\0\0" + b"LASF_Spec".ljust(16, b"\0") + struct.pack("<HQ", 65535, 8) + bytes(32)
    write(tmp_path / "a.las", bytes(content) + packets + b"waveform")
    PointCloud.open(tmp_path / "a.las").select(np.arange(10)).save(tmp_path / "b.las")
    result = (tmp_path / "b.las").read_bytes()
    (start,) = struct.unpack_from("<Q", result, 227)
    assert result[start:] == packets + b"waveform"
    assert len(content) > start > 0


def opened(tmp_path: Path, number: int = 1, minor: int = 2) -> PointCloud:
    cloud = PointCloud.open(write(tmp_path / "source.las", make(minor, number)))
    return cloud.with_crs(parse_crs("EPSG:2154+5720"))


def saved(cloud: PointCloud, suffix: str = ".las") -> tuple[PointCloud, Any]:
    """The cloud after a way through a file, and what laspy says of it."""
    path = Path(str(PATHS.pop())).with_suffix(suffix)
    cloud.save(path)
    return PointCloud.open(path), laspy.read(path)


PATHS: list[Path] = []


@pytest.fixture(autouse=True)
def paths(tmp_path: Path) -> None:
    PATHS[:] = [tmp_path / f"saved{k}.las" for k in range(20)]


@pytest.mark.parametrize(("number", "upgraded"), [(0, 6), (1, 6), (2, 7), (3, 7), (4, 9), (5, 10)])
def test_classes_above_31_lead_to_a_newer_point_format(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, number: int, upgraded: int
) -> None:
    cloud = opened(tmp_path, number, 3)
    classes = np.full(40, 64)
    with caplog.at_level(logging.INFO, "toolbox"):
        result, header = saved(cloud.with_attributes({"classification": classes}))
    assert header.header.point_format.id == upgraded
    assert str(header.header.version) == "1.4"
    assert header.header.global_encoding.wkt
    assert f"point format {upgraded}" in caplog.text
    assert (result["classification"] == 64).all()
    assert np.array_equal(result.xyz, cloud.xyz)
    assert same_crs(result.crs, cloud.crs)
    degrees = result["scan_angle"] * 0.006
    assert np.abs(degrees - cloud["scan_angle_rank"]).max() <= 0.003
    for name in set(cloud.names) - {"classification", "scan_angle_rank"}:
        assert np.array_equal(result[name], cloud[name]), name


@pytest.mark.parametrize("text", [None, "EPSG:2154+5720"])
def test_a_newer_point_format_states_the_crs_of_the_file_as_wkt(
    tmp_path: Path, text: str | None
) -> None:
    crs = parse_crs(text) if text else None
    source, header = saved(opened(tmp_path).with_crs(crs))
    assert str(header.header.version) == "1.2"
    result, header = saved(source.with_attributes({"classification": np.full(40, 64)}))
    assert str(header.header.version) == "1.4"
    assert header.header.global_encoding.wkt, "which LAS 1.4 asks for, with a CRS or without"
    assert len(header.header.vlrs.get("WktCoordinateSystemVlr")) == (1 if text else 0)
    assert same_crs(result.crs, crs)


def test_classes_up_to_31_stay_in_the_old_point_format(tmp_path: Path) -> None:
    cloud = opened(tmp_path).with_attributes({"classification": np.full(40, 31)})
    result, header = saved(cloud)
    assert header.header.point_format.id == 1
    assert np.array_equal(result["withheld"], cloud["withheld"])  # in the same byte


@pytest.mark.parametrize("name", ["return_number", "number_of_returns"])
def test_many_returns_lead_to_a_newer_point_format(tmp_path: Path, name: str) -> None:
    result, header = saved(opened(tmp_path).with_attributes({name: np.full(40, 15)}))
    assert header.header.point_format.id == 6
    assert (result[name] == 15).all()


@pytest.mark.parametrize(
    ("number", "name", "result_number"),
    [
        (0, "gps_time", 1),
        (1, "red", 3),
        (3, "nir", 8),
        (6, "green", 7),
        (7, "nir", 8),
        (2, "overlap", 7),
    ],
)
def test_a_standard_attribute_leads_to_the_format_that_has_it(
    tmp_path: Path, number: int, name: str, result_number: int
) -> None:
    cloud = opened(tmp_path, number, 4).with_attributes({name: np.ones(40, int)})
    result, header = saved(cloud)
    assert header.header.point_format.id == result_number
    assert (result[name] == 1).all()


@pytest.mark.parametrize(
    "dtype", ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8", ">i4", "bool"]
)
def test_new_attributes_become_extra_bytes_of_their_type(tmp_path: Path, dtype: str) -> None:
    values = np.arange(40).astype(dtype)
    cloud = opened(tmp_path).with_attributes({"mine": values}, descriptions={"mine": "what, m"})
    result, header = saved(cloud, ".laz")
    expected = np.dtype("u1") if dtype == "bool" else np.dtype(dtype).newbyteorder("<")
    assert result["mine"].dtype == expected
    assert np.array_equal(result["mine"], values)
    assert np.array_equal(header["mine"], values)
    assert result.descriptions["mine"] == "what, m"
    assert np.array_equal(result["height"], cloud["height"])


def test_unknown_values_in_extra_bytes_stay_unknown(tmp_path: Path) -> None:
    result, _ = saved(opened(tmp_path).with_attributes({"mine": np.full(40, np.nan)}))
    assert np.isnan(result["mine"]).all()


def test_a_changed_extra_byte_attribute_takes_its_new_type(tmp_path: Path) -> None:
    heights = np.linspace(-1e6, 1e6, 40)
    result, header = saved(opened(tmp_path).with_attributes({"height": heights}))
    assert np.array_equal(result["height"], heights)
    assert np.array_equal(header["height"], heights)
    assert result.descriptions["height"] == "above ground"
    assert [name for name in result.names if name in ("height", "triple")] == ["height", "triple"]


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("classification", 300, "300"),
        ("intensity", -1, "-1"),
        ("intensity", 1.5, "1.5"),
        ("intensity", np.nan, "nan"),
        ("user_data", 256, "256"),
        ("return_number", 16, "16"),
        ("edge_of_flight_line", 2, "2"),
        ("scan_angle_rank", 200, "200"),
    ],
)
def test_what_does_not_fit_in_its_field_is_refused(
    tmp_path: Path, name: str, value: float, shown: str
) -> None:
    values = np.zeros(40)
    values[7] = value
    cloud = opened(tmp_path).with_attributes({name: values})
    with pytest.raises(DataError, match=rf"{name} has the value {shown}"):
        cloud.save(tmp_path / "refused.las")


@pytest.mark.parametrize("dtype", ["f2", "longdouble"])
def test_types_that_las_lacks_are_refused(tmp_path: Path, dtype: str) -> None:
    cloud = opened(tmp_path).with_attributes({"mine": np.zeros(40, dtype)})
    with pytest.raises(DataError, match=r"'mine' is of type"):
        cloud.save(tmp_path / "refused.las")


def test_long_names_are_refused(tmp_path: Path) -> None:
    cloud = opened(tmp_path).with_attributes({"n" * 33: np.zeros(40)})
    with pytest.raises(DataError, match="32 bytes"):
        cloud.save(tmp_path / "refused.las")


def test_moved_points_keep_scale_and_offset(tmp_path: Path) -> None:
    cloud = opened(tmp_path)
    before = laspy.read(tmp_path / "source.las")
    moved = cloud.xyz.copy()
    moved[3] += (0.004, 0.5, 0.0074)
    result, header = saved(cloud.with_xyz(moved))
    assert np.array_equal(header.header.scales, before.header.scales)
    assert np.array_equal(header.header.offsets, before.header.offsets)
    others = np.arange(40) != 3
    for axis in "XYZ":
        assert np.array_equal(header[axis][others], before[axis][others])
    assert np.allclose(result.xyz[3] - cloud.xyz[3], (0.004, 0.5, 0.0075), atol=1e-9)


def test_far_moves_take_a_new_offset(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    cloud = opened(tmp_path).select([0, 1]).with_xyz([[9e9, 5e6, 1], [9e9 + 3.25, 5e6, 2]])
    with caplog.at_level(logging.INFO, "toolbox"):
        result, _ = saved(cloud)
    assert "x needs the new offset" in caplog.text
    assert np.allclose(result.xyz, cloud.xyz, rtol=0, atol=0.0013)


@pytest.mark.parametrize(
    ("x", "message"),
    [(np.nan, "x of point 1 is nan"), (np.inf, "x of point 1 is inf"), (9e9, "x reaches from")],
)
def test_impossible_coordinates_are_refused(tmp_path: Path, x: float, message: str) -> None:
    cloud = opened(tmp_path).select([0, 1]).with_xyz([[0, 0, 0], [x, 0, 0]])
    with pytest.raises(DataError, match=message):
        cloud.save(tmp_path / "refused.las")
    with pytest.raises(DataError, match=message if x != 9e9 else "x reaches"):
        PointCloud([[0, 0, 0.123456789], [x, 0, 0]]).save(tmp_path / "refused.las")


@pytest.mark.parametrize("text", ["EPSG:2154", "EPSG:2154+5720", "EPSG:2994", "EPSG:4326"])
@pytest.mark.parametrize(("minor", "number", "wkt"), [(2, 3, False), (4, 3, False), (4, 6, True)])
def test_a_crs_is_written_and_read(
    tmp_path: Path, text: str, minor: int, number: int, wkt: bool
) -> None:
    crs = parse_crs(text)
    result, header = saved(opened(tmp_path, number, minor).with_crs(crs))
    assert same_crs(result.crs, crs)
    assert header.header.global_encoding.wkt == wkt
    kind = "WktCoordinateSystemVlr" if wkt else "GeoKeyDirectoryVlr"
    assert [type(v).__name__ for v in header.vlrs if v.user_id == "LASF_Projection"] == [kind]
    again, header = saved(result.with_crs(parse_crs("EPSG:32631")))
    assert same_crs(again.crs, parse_crs("EPSG:32631"))
    assert len([v for v in header.vlrs if v.user_id == "LASF_Projection"]) == 1


def test_a_crs_without_codes_goes_to_wkt(tmp_path: Path) -> None:
    crs = parse_crs(
        parse_crs("EPSG:2154").to_wkt().replace("700000", "700001").replace(',ID["EPSG",2154]', "")
    )
    result, header = saved(opened(tmp_path).with_crs(crs))
    assert same_crs(result.crs, crs)
    assert header.header.global_encoding.wkt
    assert str(header.header.version) == "1.4"


@pytest.mark.parametrize("crs", [None, *LOCALS.values()])
@pytest.mark.parametrize("number", [3, 6])
def test_no_crs_leaves_no_record_and_a_local_one_a_record_of_ours(
    tmp_path: Path, crs: Any, number: int
) -> None:
    first, _ = saved(opened(tmp_path, number, 4))
    assert first.crs is not None
    result, header = saved(first.with_crs(crs))
    assert same_crs(result.crs, crs)
    assert not [v for v in header.vlrs if v.user_id == "LASF_Projection"]
    assert len([v for v in header.vlrs if v.user_id == "lidar-toolbox"]) == (crs is not None)
    back, header = saved(result.with_crs(first.crs))
    assert same_crs(back.crs, first.crs)
    assert not [v for v in header.vlrs if v.user_id == "lidar-toolbox"]


def test_a_crs_of_the_earth_counts_more_than_a_local_one(tmp_path: Path) -> None:
    """Another program has given one to our file, and has left our record in it."""
    first, _ = saved(opened(tmp_path, 3, 4))
    local, _ = saved(first.with_crs(LOCALS["local:mm"]))
    (ours,), _ = crs_vlrs(local.crs, 3, wkt=False)
    (theirs,), wkt = crs_vlrs(first.crs, 3, wkt=False)
    assert same_crs(read_crs([ours, theirs], wkt=wkt, name="a.las"), first.crs)


def test_an_unchanged_crs_keeps_its_record(tmp_path: Path) -> None:
    first, _ = saved(opened(tmp_path, 3, 4))
    _, header = saved(first.with_crs(parse_crs("EPSG:2154+5720")))
    _, other = saved(first)
    assert header.vlrs.get_by_id("LASF_Projection")[0].record_data_bytes() == (
        other.vlrs.get_by_id("LASF_Projection")[0].record_data_bytes()
    )


@pytest.mark.parametrize(
    ("x", "scale"), [(1.25, 0.01), (1.125, 0.001), (1.1234, 1e-4), (1.123456, 1e-6), (1 / 3, 1e-4)]
)
def test_new_files_take_the_coarsest_scale_that_is_exact(
    tmp_path: Path, x: float, scale: float
) -> None:
    cloud = PointCloud([[6e6 + x, 0, 0], [6e6, 1, 1]], {"red": [1, 2], "label": [7, -8]})
    result, header = saved(cloud)
    assert header.header.scales[0] == scale
    assert np.allclose(result.xyz, cloud.xyz, rtol=0, atol=scale / 2 if x == 1 / 3 else 1e-9)
    assert header.header.point_format.id == 7
    assert header.header.system_identifier == "lidar-toolbox"
    assert (result["return_number"] == 1).all()
    assert result["label"].tolist() == [7, -8]


@pytest.mark.parametrize("suffix", [".las", ".laz", ".csv.gz", ".ply"])
def test_the_same_cloud_gives_the_same_file(tmp_path: Path, suffix: str) -> None:
    cloud = PointCloud(np.arange(30.0).reshape(10, 3), {"intensity": np.arange(10)})
    cloud.save(tmp_path / f"a{suffix}")
    cloud.save(tmp_path / f"b{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_an_empty_cloud_is_a_valid_file(tmp_path: Path, suffix: str) -> None:
    result, header = saved(PointCloud(np.empty((0, 3)), {"mine": np.empty(0)}), suffix)
    assert len(result) == len(header.points) == 0
    assert "mine" in result
    again, _ = saved(opened(tmp_path).select([]), suffix)
    assert len(again) == 0
    assert again["height"].shape == again.xyz[:, 0].shape == (0,)


def test_records_in_several_chunks_and_blocks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(las, "_BLOCK", 30_000)
    rng = np.random.default_rng(5)
    cloud = PointCloud(rng.integers(0, 9000, (130_000, 3)) / 100)
    for suffix in (".las", ".laz"):
        result, header = saved(cloud, suffix)
        assert np.array_equal(header.xyz, result.xyz)
        assert np.allclose(result.xyz, cloud.xyz, rtol=0, atol=1e-9)
        assert header.header.number_of_points_by_return[0] == 130_000


def test_reading_and_writing_can_be_stopped(tmp_path: Path) -> None:
    cloud = opened(tmp_path)
    stopped = Context(stop=lambda: True)
    for suffix in (".las", ".laz", ".csv"):
        with pytest.raises(Cancelled):
            cloud.save(tmp_path / f"b{suffix}", ctx=stopped)
        cloud.save(tmp_path / f"c{suffix}")
        with pytest.raises(Cancelled):
            PointCloud.open(tmp_path / f"c{suffix}", ctx=stopped)


def test_a_copc_query_reads_only_what_it_needs(
    data: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = data("copc/simple.copc.laz")
    read: list[int] = []
    plain = las.lazrs.decompress_points_with_chunk_table

    def counted(data: bytes, laszip: bytes, out: Any, table: list[tuple[int, int]]) -> None:
        read.extend(points for points, _ in table)
        plain(data, laszip, out, table)

    monkeypatch.setattr(las.lazrs, "decompress_points_with_chunk_table", counted)
    whole = PointCloud.open(path)
    x, y = whole.xyz[:, 0], whole.xyz[:, 1]
    box = (x.min(), y.min(), np.median(x), np.median(y))
    read.clear()
    part = PointCloud.open(path, bounds=box)
    expected = whole.select((x <= box[2]) & (y <= box[3]))
    assert 0 < sum(read) < len(whole)
    assert np.array_equal(part.xyz, expected.xyz)
    assert np.array_equal(part["gps_time"], expected["gps_time"])
    assert len(PointCloud.open(path, bounds=(0, 0, 1, 1))) == 0
    part.save(tmp_path / "part.laz")
    assert not {"copc", "laszip"} & {v.user_id for v in laspy.read(tmp_path / "part.laz").vlrs}


REAL = [
    "ahn3_delft_bgt/ahn3_cropped_2.laz",
    "ahn_amsterdam/ahn4_2463_9714_rgb.laz",
    "cir_ign_20cm/split_west.laz",
    "facade_street_corner/street_thinned.las",
    "feet/nebraska_wkt_and_geotiff.las",
    "isprs_samples_labelled_laz/samp54_first_last_intensity.laz",
    "lidr_topography/MixedConifer.laz",
    "nir_laz/ign_0698_6260_rgbnir_decimated.laz",
    "robustness/1_4_w_evlr.laz",
    "robustness/extrabytes.las",
    "robustness/nocrs.las",
    "tls_plane_target/plane.laz",
]
LARGE = [
    "autzen_ept/autzen_south_5M.laz",
    "feet/autzen_trim.laz",
    "ign_lidarhd_decimated_1km/0382_6565.laz",
    "ign_urban_50m/77050_627755.laz",
    "isprs_sites/CSite2_orig-utm.laz",
    "isprs_sites/FSite5_orig-utm.laz",
    "nir_laz/ign_484_6632_rgbnir.laz",
    "powerline_ahn4/12AN2_20_as_published.laz",
    "powerline_ahn4/12BZ1_21_as_published.laz",
    "water_denoever_ahn3/AHN3.laz",
]


@pytest.mark.parametrize(
    "name", [*REAL, *(pytest.param(name, marks=pytest.mark.slow) for name in LARGE)]
)
def test_real_files_come_back_unchanged(
    data: Callable[[str], Path], tmp_path: Path, name: str
) -> None:
    path = data(name)
    before = PointCloud.open(path)
    result = tmp_path / f"b{path.suffix}"
    before.save(result)
    old, new = laspy.read(path), laspy.read(result)
    assert old.points.array.tobytes() == new.points.array.tobytes()
    assert (
        path.read_bytes()[: old.header.offset_to_point_data - 300]
        == (result.read_bytes()[: old.header.offset_to_point_data - 300])
    )  # the LASzip record at the end may differ
    assert len(before._metadata.all_vlrs) == len(PointCloud.open(result)._metadata.all_vlrs)  # type: ignore[union-attr]
    for one, other in zip(
        before._metadata.all_vlrs,  # type: ignore[union-attr]
        PointCloud.open(result)._metadata.all_vlrs,  # type: ignore[union-attr]
        strict=True,
    ):
        assert one.head + one.data == other.head + other.data


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("feet/autzen_trim.laz", "EPSG:2994"),
        ("autzen_ept/autzen_south_5M.laz", "EPSG:2994"),
        ("feet/nebraska_wkt_and_geotiff.las", "EPSG:6880"),
        ("isprs_samples_labelled_laz/samp54_first_last_intensity.laz", "EPSG:32632"),
        ("copc/simple.copc.laz", "EPSG:2991+6360"),
        ("robustness/bad_vlr_count.las", "EPSG:32617"),
    ],
)
def test_the_crs_of_real_files(data: Callable[[str], Path], name: str, code: str) -> None:
    path = data(name)
    with path.open("rb") as stream:
        metadata = parse_metadata(stream, path.stat().st_size, lambda text: None)
    crs = read_crs(metadata.all_vlrs, wkt=metadata.header.global_encoding.wkt, name=name)
    assert crs is not None
    assert crs.to_authority() == tuple(code.split(":")) or same_crs(crs, parse_crs(code))


@pytest.mark.parametrize(("minor", "number"), COMBINATIONS)
@pytest.mark.parametrize("compress", [False, True])
def test_parts_join_to_the_whole(
    tmp_path: Path, minor: int, number: int, compress: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """With spare bytes, extra bytes and records; whatever was not changed is as it was."""
    path = write(tmp_path / "a.laz", make(minor, number, compress=compress))
    whole = PointCloud.open(path)
    parts = [PointCloud.open(path, point_range=span) for span in [(0, 7), (7, 7), (7, 40)]]
    joined = PointCloud.concat(parts)
    assert not caplog.text
    whole.save(tmp_path / "b.las")
    joined.save(tmp_path / "c.las")
    assert (tmp_path / "c.las").read_bytes() == (tmp_path / "b.las").read_bytes()


def plain(number: int, minor: int = 4, **fields: Any) -> PointCloud:
    """Three points in a point format, with some fields set."""
    header = laspy.LasHeader(version=f"1.{minor}", point_format=number)
    header.scales = fields.pop("scales", [0.01] * 3)
    header.offsets = fields.pop("offsets", [0] * 3)
    for extra in fields.pop("extras", []):
        header.add_extra_dim(extra)
    header.global_encoding.gps_time_type = fields.pop("clock", 0)
    points = laspy.LasData(header)
    points.X = points.Y = points.Z = [100, 200, 300]
    for name, values in fields.items():
        points[name] = values
    file = io.BytesIO()
    points.write(file)
    metadata = parse_metadata(io.BytesIO(file.getvalue()), len(file.getvalue()), print)
    return PointCloud._of_las(metadata, points.points.array.copy(), f"format{number}.las")


@pytest.mark.parametrize("oldest", [2, 4])
@pytest.mark.parametrize(
    ("formats", "joint"),
    [
        *[((1, 3), 3), ((3, 1), 3), ((2, 1), 3), ((0, 6), 6), ((6, 1), 6), ((7, 8), 8)],
        *[((1, 4), 4), ((3, 6), 7), ((4, 7), 10), ((8, 9), 10), ((0, 1, 2), 3), ((5, 0), 5)],
    ],
)
def test_the_joint_point_format_holds_all_attributes(
    tmp_path: Path, formats: tuple[int, ...], joint: int, oldest: int
) -> None:
    least = {number: 4 if number > 5 else 3 if number > 3 else oldest for number in formats}
    whole = PointCloud.concat([plain(number, least[number]) for number in formats])
    whole.save(tmp_path / "a.las")
    header = laspy.read(tmp_path / "a.las").header
    assert (header.point_format.id, header.point_count) == (joint, 3 * len(formats))
    everything = {name for number in formats for name in plain(number).names}
    assert everything - set(whole.names) <= {"scan_angle_rank"}


def test_no_point_format_may_hold_all_attributes() -> None:
    angles = plain(1, scan_angle_rank=[-90, 0, 7])
    whole = PointCloud.concat([plain(6, classification=[40, 0, 0]), angles])
    assert np.allclose(whole["scan_angle"] * 0.006, [0, 0, 0, -90, 0, 7], atol=0.003)
    assert whole["classification"].tolist() == [40, 0, 0, 0, 0, 0]
    crs = parse_crs("EPSG:32635")
    both = PointCloud.concat([angles.with_crs(crs), plain(6).with_crs(crs)])
    assert both.crs == crs


def test_times_too_large_for_a_week_are_no_times_of_another_day(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Tiles of one flight, two of which call their standard times seconds of the week."""
    members = [plain(6, clock=clock, gps_time=[306_234_562.0] * 3) for clock in (1, 0, 0)]
    for number, cloud in enumerate(members):
        cloud.save(tmp_path / f"{number}.las")
    wanted = (
        "1 more files: the header calls GPS times seconds of the week, for which they are too "
        "large: they count as standard times"
    )
    for join in (
        lambda: PointCloud.concat(members),
        lambda: Survey.open(sorted(tmp_path.glob("*.las"))).template,
    ):
        caplog.clear()
        join()
        assert wanted in caplog.text
        assert "another day" not in caplog.text


def test_what_joining_does_not_keep_is_told(caplog: pytest.LogCaptureFixture) -> None:
    PointCloud.concat([plain(1), plain(3), plain(3)])
    assert "format1.las: has no red, green, blue; 0 is written there" in caplog.text
    caplog.clear()
    PointCloud.concat([plain(6), plain(1)])
    assert not caplog.text  # flags that the older format does not know
    PointCloud.concat([plain(1), plain(1, clock=1), plain(3, clock=1)])
    assert "format1.las and 1 more files: GPS times count from another day" in caplog.text
    caplog.clear()
    PointCloud.concat([plain(1), plain(1, offsets=[0.005, 0, 0])])
    assert "format1.las: coordinates are rounded by up to half a step" in caplog.text
    caplog.clear()
    PointCloud.concat([plain(1), plain(1, offsets=[0.05, 0, 0], scales=[0.1, 0.001, 0.01])])
    assert "rounded" not in caplog.text


def test_scale_and_offset_of_joined_files(caplog: pytest.LogCaptureFixture) -> None:
    far = plain(1, offsets=[3e7, 3, 0], scales=[1, 0.1, 0.02])  # beyond 32 bits at 0.01
    parts = [plain(1, offsets=[0, 0, 9]), far]
    with caplog.at_level(logging.INFO, "toolbox"):
        whole = PointCloud.concat(parts)
    assert np.allclose(whole.xyz, np.concatenate([part.xyz for part in parts]), rtol=1e-15)
    assert "x needs the new offset 15000150" in caplog.text
    assert "y needs" not in caplog.text
    with pytest.raises(DataError, match=r"x reaches from .* in the steps of 0\.01"):
        PointCloud.concat([plain(1), plain(1, offsets=[5e8, 0, 0])])


def test_extra_bytes_of_the_same_name() -> None:
    def extra(kind: str, scale: float | None = None) -> Any:
        how = {} if scale is None else {"scales": [scale], "offsets": [0]}
        return plain(6, extras=[laspy.ExtraBytesParams("a", kind, "text", **how)], a=[1, 2, 3])

    for one, other, dtype in [
        (extra("u1"), extra("u1"), "u1"),
        (extra("u1"), extra("i4"), "i4"),
        (extra("u1"), extra("f4"), "f4"),
        (extra("i2", 0.5), extra("i2", 0.5), "f8"),
        (extra("i2", 0.5), extra("i2", 0.25), "f8"),
        (extra("i2", 0.5), extra("i2"), "f8"),
    ]:
        whole = PointCloud.concat([one, other])
        assert whole["a"].tolist() == [*one["a"], *other["a"]]
        assert whole["a"].dtype == dtype
        assert whole.descriptions["a"] == "text"
    several = plain(6, extras=[laspy.ExtraBytesParams("a", "2u1")])
    with pytest.raises(DataError, match=r"'a' has 1 in format6\.las, 2 in format6\.las elements"):
        PointCloud.concat([extra("u1"), several])
    red = plain(6, extras=[laspy.ExtraBytesParams("red", "u2")], red=[7, 8, 9])
    whole = PointCloud.concat([red, plain(7, red=[1, 2, 3])])
    assert whole["red"].tolist() == [7, 8, 9, 1, 2, 3]
    assert whole.names.count("red") == 1


def test_joined_extra_bytes_are_described(tmp_path: Path) -> None:
    """In the words of the file that has them."""
    one = PointCloud.open(write(tmp_path / "a.las", make(4, 6)))
    whole = PointCloud.concat([plain(6), one])
    whole.save(tmp_path / "b.las")
    other = laspy.read(tmp_path / "b.las")
    assert [extra.name for extra in other.point_format.extra_dimensions] == [
        extra.name for extra in laspy.read(tmp_path / "a.las").point_format.extra_dimensions
    ]
    assert np.array_equal(other["height"][3:], laspy.read(tmp_path / "a.las")["height"])
    assert np.array_equal(other["triple"][3:], one["triple"])
    assert not other["triple"][:3].any()


def test_bytes_that_nothing_describes_are_joined(tmp_path: Path) -> None:
    def spare(count: int) -> PointCloud:
        extras = [laspy.ExtraBytesParams("a", f"{count}u1")]
        values = np.arange(3 * count).reshape(3, count) if count > 1 else np.arange(3)
        plain(6, extras=extras, a=values).save(tmp_path / "a.las", overwrite=True)
        content = (tmp_path / "a.las").read_bytes().replace(b"LASF_Spec", b"LASF_None")
        return PointCloud.open(write(tmp_path / "b.las", content))

    whole = PointCloud.concat([spare(1), spare(3), plain(6), spare(4)])
    whole.save(tmp_path / "c.las")
    raw = laspy.read(tmp_path / "c.las").points.array.view("u1").reshape(12, -1)[:, 30:]
    assert raw[:, :].tolist() == [
        *([i, 0, 0, 0] for i in range(3)),
        *([3 * i, 3 * i + 1, 3 * i + 2, 0] for i in range(3)),
        *([0] * 4 for i in range(3)),
        *([4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3] for i in range(3)),
    ]


def test_waveforms_of_other_files_are_not_kept(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Nor claimed to be: those of the first file alone are there."""

    def scanned(content: bytes) -> PointCloud:
        plain(4, minor=3).save(tmp_path / "a.las", overwrite=True)
        file = bytearray((tmp_path / "a.las").read_bytes())
        struct.pack_into("<H", file, 6, 2)  # waveforms inside
        struct.pack_into("<Q", file, 227, len(file))
        head = struct.pack("<2x16sHQ32s", b"LASF_Spec", 65535, len(content), b"waveforms")
        return PointCloud.open(write(tmp_path / "b.las", bytes(file) + head + content))

    one = scanned(b"abc")
    PointCloud.concat([one, one.select([0]), scanned(b"abc"), plain(4, minor=3)])
    assert "waveform" not in caplog.text
    PointCloud.concat([one, scanned(b"abd")]).save(tmp_path / "c.las")
    assert "b.las: its waveform packets are not kept, only those of the first" in caplog.text
    assert (tmp_path / "c.las").read_bytes().endswith(b"abc")


def test_the_crs_of_joined_files_is_stated_as_their_point_format_wants(tmp_path: Path) -> None:
    """As WKT from point format 6 on, where the first file has GeoTIFF keys."""
    crs = parse_crs("EPSG:32635")
    plain(1, minor=2).with_crs(crs).save(tmp_path / "a.las")
    first = PointCloud.open(tmp_path / "a.las")
    PointCloud.concat([first, plain(6).with_crs(crs)]).save(tmp_path / "b.las")
    other = laspy.read(tmp_path / "b.las")
    records = [(vlr.user_id, vlr.record_id) for vlr in other.header.vlrs]
    assert records == [("LASF_Projection", 2112)]
    assert other.header.global_encoding.wkt
    assert same_crs(PointCloud.open(tmp_path / "b.las").crs, crs)
    content = (tmp_path / "a.las").read_bytes()
    content = content.replace(struct.pack("<H", 32635), struct.pack("<H", 1))  # no such code
    unknown = PointCloud.open(write(tmp_path / "c.las", content))
    assert unknown.crs is None
    PointCloud.concat([unknown, plain(6)]).save(tmp_path / "d.las")
    kept = laspy.read(tmp_path / "d.las").header.vlrs
    assert [vlr.record_id for vlr in kept] == [34735]  # what nobody understands stays


@pytest.mark.parametrize(
    ("given", "written", "says"),
    [
        ([0.25, 0.5, 1.0], [16384, 32768, 65535], "written times 65535"),
        ([10.4, 7856.6, 3.0], [10, 7857, 3], "rounded"),
    ],
)
def test_intensities_with_decimals_are_written_as_whole_numbers(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, given: Any, written: Any, says: str
) -> None:
    cloud = PointCloud(np.eye(3), {"intensity": np.array(given)})
    cloud.save(tmp_path / "a.laz")
    assert PointCloud.open(tmp_path / "a.laz")["intensity"].tolist() == written
    assert says in caplog.text


def test_intensities_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    cloud = PointCloud(np.eye(3), {"intensity": np.array([0.5, -1.0, 2.0])})
    with pytest.raises(DataError, match="LAS holds whole numbers"):
        cloud.save(tmp_path / "a.laz")


def test_an_attribute_that_gets_wider_moves_none_of_those_after_it(tmp_path: Path) -> None:
    count = np.arange(50)
    made = PointCloud(np.column_stack([count, count, count]).astype(float))
    made.with_attributes({"a": count.astype(np.uint8), "b": count * 1.5}).save(tmp_path / "1.las")
    wider = PointCloud.open(tmp_path / "1.las").with_attributes({"a": count * 1000.0, "c": -count})
    wider.save(tmp_path / "2.las")
    found = PointCloud.open(tmp_path / "2.las")
    np.testing.assert_array_equal(found["a"], count * 1000.0)
    np.testing.assert_array_equal(found["b"], count * 1.5)
    np.testing.assert_array_equal(found["c"], -count)
    np.testing.assert_array_equal(found["x"], count)
