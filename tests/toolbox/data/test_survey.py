"""Surveys: which files a place stands for, what their headers say, and reading them in parts."""

from __future__ import annotations

import json
import logging
import os
import pickle
import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from pyproj import CRS

from toolbox.data import PointCloud, Survey
from toolbox.data.crs import LOCAL
from toolbox.data.paths import PointFiles
from toolbox.errors import DataError

FRANCE = CRS("EPSG:2154+5720")


def tile(path: Path, east: float = 0.0, *, count: int = 200, crs: CRS | None = FRANCE) -> Path:
    """A file of points in a square of 10 m."""
    rng = np.random.default_rng(int(east) + 1)
    xyz = np.round(rng.uniform(0, 10, (count, 3)), 2) + np.array([east, 0, 100])
    columns = {
        "intensity": rng.integers(0, 99, count, np.uint16),
        "height": rng.integers(0, 9, count) / 4,
    }
    PointCloud(xyz, columns, crs=crs).save(path)
    return path


def same(one: PointCloud, other: PointCloud) -> bool:
    """Whether two clouds hold the same points, bit for bit."""
    columns = [(one[name], other[name]) for name in (*one.names, "x", "y", "z")]
    alike = all(a.dtype == b.dtype and a.tobytes() == b.tobytes() for a, b in columns)
    return one.names == other.names and alike


def in_batches(survey: Survey, size: int) -> PointCloud:
    """The whole survey, read batch by batch, as by other processes."""
    survey, template = pickle.loads(pickle.dumps((survey, survey.template)))
    return PointCloud.concat(
        [
            file.read(start, stop).like(template)
            for file in survey.files
            for start, stop in file.ranges(size)
        ]
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three tiles beside what is none."""
    folder = tmp_path / "survey"
    (folder / "nested").mkdir(parents=True)
    tile(folder / "b.laz", 10)
    tile(folder / "a.las", 0)
    tile(folder / "c.LAZ".lower(), 20)
    tile(folder / "nested" / "d.laz", 30)
    (folder / ".hidden.laz").write_bytes(b"LASF")
    (folder / "notes.md").write_text("# Notes")
    return folder


def vpc(path: Path, *links: str, **more: Any) -> Path:
    """A virtual point cloud that names files, as PDAL writes it."""
    features = [
        {
            "type": "Feature",
            "properties": {"pc:count": 1, "proj:bbox": [0, 0, 0, 1, 1, 1]},
            "assets": {
                "data": {"href": link, "roles": ["data"]},
                "overview": {"href": "./none.copc.laz", "roles": ["overview"]},
            },
        }
        for link in links
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features} | more))
    return path


def names(places: Any) -> list[str]:
    return [path.name for path in PointFiles.of(places).paths]


def test_links_to_files_that_are_gone_are_not_passed_over(folder: Path) -> None:
    (folder / "e.laz").symlink_to(folder / "gone.laz")
    for given in (folder, str(folder / "*.laz")):
        with pytest.raises(DataError, match=r"there is no file .*e\.laz"):
            names(given)


def test_places(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert names(folder) == ["a.las", "b.laz", "c.laz"]
    assert names(str(folder / "*.laz")) == ["b.laz", "c.laz"]
    assert names(str(folder / "**" / "*.laz")) == ["b.laz", "c.laz", "d.laz"]
    assert names([folder / "c.laz", folder / "nested", str(folder / "a*")]) == [
        "a.las",
        "c.laz",
        "d.laz",
    ]
    assert names(folder / "a.las") == ["a.las"]
    monkeypatch.chdir(folder)
    assert names(".") == ["a.las", "b.laz", "c.laz"]
    (folder / "x[1].las").write_bytes((folder / "a.las").read_bytes())
    assert names("x[1].las") == ["x[1].las"]  # a file of that name, not a pattern


@pytest.mark.parametrize("form", ["./{}", "{}", "ABSOLUTE", "file://ABSOLUTE"])
def test_virtual_point_clouds(folder: Path, form: str) -> None:
    form = form.replace("ABSOLUTE", f"{folder}/{{}}")
    path = vpc(folder / "all.vpc", *(form.format(name) for name in ("b.laz", "nested/d.laz")))
    assert names(path) == ["b.laz", "d.laz"]
    assert Survey.open(path).count == 400  # as the files say
    assert Survey.open(path).name == "all.vpc"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no virtual point cloud"),
        ("[]", "no virtual point cloud"),
        ('{"features": [1]}', "no virtual point cloud"),
        ('{"features": [{"assets": {"data": {}}}]}', "no virtual point cloud"),
        ('{"features": []}', "names no files"),
        ("\xff\xfe", "no virtual point cloud"),
        ('{"features": ' + "[" * 100_000, "nested too deeply"),
    ],
)
def test_what_is_no_virtual_point_cloud(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "a.vpc").write_text(content, encoding="latin-1")
    with pytest.raises(DataError, match=message):
        PointFiles.of(tmp_path / "a.vpc")


def test_virtual_point_clouds_with_files_that_are_not_there(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TOOLBOX_OFFLINE", "1")
    path = vpc(folder / "a.vpc", "a.las", "x.laz", "y.laz")
    with pytest.raises(DataError, match=r"not there: .*x\.laz, .*y\.laz"):
        PointFiles.of(path)
    path = vpc(folder / "a.vpc", "a.las", "https://example.org/x.laz", "s3://bucket/y.laz")
    with pytest.raises(DataError, match=r"https://example.org/x\.laz\n.*s3://bucket/y"):
        PointFiles.of(path)


def test_texts_beside_las_files_are_left_out(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (folder / "readme.txt").write_text("Hello")
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert len(Survey.open(folder).files) == 3
    assert "only its LAS and LAZ files are read, not readme.txt" in caplog.text


def test_folders_of_other_formats(tmp_path: Path) -> None:
    for east, name in enumerate(("a.xyz", "b.csv.gz", "c.ply")):
        points = PointCloud([[east, 0, 1], [east, 1, 2]], {"intensity": [east, 7]})
        points.save(tmp_path / name)
    survey = Survey.open(tmp_path)
    assert [file.count for file in survey.files] == [2, 2, 2]
    assert survey.bounds == (0, 0, 1, 2, 1, 2)
    assert survey.names == ("intensity",)
    whole = PointCloud.open(tmp_path)
    assert whole["intensity"].tolist() == [0, 7, 1, 7, 2, 7]
    assert same(whole, in_batches(survey, 1))
    (tmp_path / "d.csv").write_text("x,y,z,height\n1,2,3,4\n")
    with pytest.raises(
        DataError, match=r"a\.xyz has no attribute height.*\n.*\n.*\n.*d\.csv has no"
    ):
        PointCloud.open(tmp_path)


def test_options_of_text_files(tmp_path: Path) -> None:
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text("1;2;3;4\n5;6;7;8\n")
    how: dict[str, Any] = {"columns": ["y", "x", "z", "label"], "separator": ";"}
    survey = Survey.open(tmp_path, **how)
    assert survey.bounds == (2, 1, 3, 6, 5, 7)
    assert same(PointCloud.open(tmp_path, **how), in_batches(survey, 1))
    tile(tmp_path / "c.las")
    with pytest.raises(DataError, match=r"c\.las: columns and separator are for text files"):
        Survey.open([tmp_path / "a.txt", tmp_path / "c.las"], **how)


def test_what_the_headers_say(folder: Path) -> None:
    survey = Survey.open(folder)
    whole = PointCloud.open(folder)
    assert survey.name == whole.name == "survey"
    assert survey.count == len(whole) == 600
    assert survey.crs == whole.crs == FRANCE
    assert survey.bounds == pytest.approx(whole.bounds)
    assert survey.metre == 1
    assert set(survey.names) == set(whole.names)
    first = survey.files[0]
    assert (first.path, first.count) == (folder / "a.las", 200)
    assert (first.version, first.point_format, first.scales) == ("1.4", 6, (0.01,) * 3)
    assert pickle.loads(pickle.dumps(survey)) == survey


@pytest.mark.parametrize("size", [1, 60, 10**6])
def test_reading_in_parts_gives_the_whole(folder: Path, size: int) -> None:
    whole = PointCloud.open(folder)
    assert same(whole, in_batches(Survey.open(folder), size))
    single = [PointCloud.open(path) for path in PointFiles.of(folder).paths]
    assert np.array_equal(whole["intensity"], np.concatenate([c["intensity"] for c in single]))
    assert np.array_equal(whole["height"], np.concatenate([c["height"] for c in single]))
    assert np.array_equal(whole.xyz.round(2), np.concatenate([c.xyz for c in single]).round(2))


def test_batches(folder: Path, tmp_path: Path) -> None:
    plain, packed, _ = Survey.open(folder).files
    assert plain.ranges(80) == [(0, 80), (80, 160), (160, 200)]
    assert packed.ranges(80) == [(0, 200)]  # one chunk
    assert plain.ranges(200) == [(0, 200)]
    empty = Survey.open(tile(tmp_path / "e.laz", count=0)).files[0]
    assert empty.ranges(80) == [(0, 0)]
    assert len(empty.read(0, 0)) == 0


def test_chunks_are_read_on_their_own(tmp_path: Path) -> None:
    path = tile(tmp_path / "a.laz", count=120_001)
    file = Survey.open(path).files[0]
    whole = PointCloud.open(path)
    assert file.ranges(1) == [(0, 50_000), (50_000, 100_000), (100_000, 120_001)]
    assert file.ranges(100_000) == [(0, 100_000), (100_000, 120_001)]
    ranges = [(0, 1), (49_999, 50_001), (50_000, 100_000), (60_000, 120_001), (120_001, 120_001)]
    for start, stop in ranges:
        assert same(file.read(start, stop), whole.select(np.arange(start, stop)))
    for start, stop in [(0, 120_002), (-1, 5), (7, 3)]:
        with pytest.raises(DataError, match="has no points"):
            file.read(start, stop)


def test_only_the_needed_chunks_are_unpacked(tmp_path: Path) -> None:
    path = tile(tmp_path / "a.laz", count=120_001)
    whole, file = PointCloud.open(path), replace(Survey.open(path).files[0], state=None)
    content = bytearray(path.read_bytes())
    (start,) = struct.unpack_from("<I", content, 96)
    content[start + 8 : start + 2000] = bytes(1992)  # the first chunk
    path.write_bytes(content)
    assert same(file.read(50_000, 120_001), whole.select(np.arange(50_000, 120_001)))
    with pytest.raises(DataError, match="damaged"):
        file.read(49_999, 60_000)


def test_reading_within_bounds(folder: Path) -> None:
    bounds = (8.0, 2.0, 13.0, 5.0)
    whole = PointCloud.open(folder)
    x, y = whole["x"], whole["y"]
    inside = (x >= 8) & (x <= 13) & (y >= 2) & (y <= 5)
    assert 0 < inside.sum() < len(whole)
    assert same(PointCloud.open(folder, bounds=bounds), whole.select(inside))
    none = PointCloud.open(folder, bounds=(100, 100, 101, 101))
    assert len(none) == 0
    assert none.names == whole.names


def test_files_out_of_bounds_are_not_read(folder: Path) -> None:
    inside = PointCloud.open(folder, bounds=(21, 0, 29, 10))
    content = bytearray((folder / "b.laz").read_bytes())
    (start,) = struct.unpack_from("<I", content, 96)
    content[start + 8 : -200] = bytes(len(content) - 208 - start)
    (folder / "b.laz").write_bytes(content)
    assert same(PointCloud.open(folder, bounds=(21, 0, 29, 10)), inside)
    with pytest.raises(DataError, match=r"b\.laz"):
        PointCloud.open(folder)


def test_cancelled_while_headers_are_read(folder: Path) -> None:
    from toolbox.context import Context
    from toolbox.errors import Cancelled

    with pytest.raises(Cancelled):
        Survey.open(folder, ctx=Context(stop=lambda: True))


@pytest.mark.parametrize(
    ("places", "message"),
    [
        (["survey/nope.laz", "survey/a.las", "none"], r"no file .*nope\.laz\n.*no file .*none"),
        ("survey/*.copc.laz", r"no file of points that matches .*\*\.copc\.laz"),
        ("empty", r"holds no files of points .*nested|holds no files of points .*\*\*"),
        (["survey/a.las", "survey"], r"a\.las is given twice"),
        (["survey/a.las", "link.las"], r"link\.las|a\.las is given twice \(as .*link\.las\)"),
        ("survey/notes.md", "points are read from"),
        (["survey/a.las", "survey/notes.md"], r"notes\.md: points are read from"),
        ([], "no files of points are given"),
        ("", "an empty path"),
        ("a\0.las", "there is no file"),
        (["survey/a.las", "zero.las"], r"zero\.las is empty"),
    ],
)
def test_places_that_cannot_be_read(
    folder: Path, monkeypatch: pytest.MonkeyPatch, places: Any, message: str
) -> None:
    monkeypatch.chdir(folder.parent)
    Path("empty").mkdir()
    Path("zero.las").touch()
    Path("link.las").symlink_to("survey/a.las")
    for read in (Survey.open, PointCloud.open):
        with pytest.raises(DataError, match=message):
            read(places)


def test_damaged_files_are_all_named(folder: Path) -> None:
    (folder / "b.laz").write_bytes(b"LASFnot")
    (folder / "c.laz").write_bytes((folder / "c.laz").read_bytes()[:300])
    for read in (Survey.open, PointCloud.open):
        with pytest.raises(DataError, match=r"b\.laz ends within.*\n.*c\.laz claims"):
            read(folder)


def test_files_that_may_not_be_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Path.open

    def refuse(path: Path, *args: Any, **more: Any) -> Any:
        if path.name == "b.laz":
            raise PermissionError(13, "Permission denied")
        return real(path, *args, **more)

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(DataError, match=r"b\.laz cannot be read: Permission denied"):
        Survey.open(folder)


def test_folders_that_may_not_be_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path) -> Any:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(DataError, match="survey cannot be read: Permission denied"):
        Survey.open(folder)


@pytest.mark.parametrize(
    ("others", "message"),
    [
        ([CRS("EPSG:32631")], r"b\.laz is in EPSG:32631.*reproject it to EPSG:2154.*a\.las"),
        ([CRS("EPSG:2154")], r"b\.laz is in EPSG:2154 .*assign it the heights of"),
        ([None], r"b\.laz has no CRS; state it with assume_crs"),
        ([CRS("EPSG:2994"), None], r"b\.laz is in EPSG:2994.*\n.*c\.laz has no CRS"),
        ([CRS("EPSG:2154+6360")], r"b\.laz .*bring its heights to"),  # feet
    ],
)
def test_another_crs_is_refused_by_name(
    tmp_path: Path, others: Sequence[CRS | None], message: str
) -> None:
    tile(tmp_path / "a.las")
    for name, crs in zip(("b.laz", "c.laz"), others, strict=False):
        tile(tmp_path / name, 10, crs=crs)
    for read in (Survey.open, PointCloud.open):
        with pytest.raises(DataError, match=message) as caught:
            read(tmp_path)
        assert "a.las is" not in str(caught.value)


def test_a_crs_is_assumed_for_files_that_state_none(tmp_path: Path) -> None:
    tile(tmp_path / "a.las")
    tile(tmp_path / "b.las", 10, crs=None)
    survey = Survey.open(tmp_path, assume_crs=FRANCE)
    assert survey.crs == FRANCE
    assert survey.files[1].read(0, 5).crs == FRANCE
    assert PointCloud.open(tmp_path / "b.las", assume_crs=FRANCE).crs == FRANCE
    assert PointCloud.open(tmp_path / "a.las", assume_crs=LOCAL).crs == FRANCE
    whole = PointCloud.open(tmp_path, assume_crs=FRANCE)
    assert whole.crs == FRANCE
    assert same(whole, in_batches(survey, 50))
    with pytest.raises(DataError, match=r"b\.las is in .*local"):
        Survey.open(tmp_path, assume_crs=LOCAL)
    (tmp_path / "a.las").unlink()
    tile(tmp_path / "c.las", 20, crs=None)
    assert Survey.open(tmp_path).crs is None
    assert Survey.open(tmp_path).with_crs(LOCAL).files[0].read(0, 5).crs is LOCAL


def test_empty_files_in_a_survey(tmp_path: Path) -> None:
    tile(tmp_path / "a.laz", 500, count=0)
    tile(tmp_path / "b.laz", 20)
    survey = Survey.open(tmp_path)
    assert survey.count == 200
    assert np.isnan(survey.files[0].bounds).all()
    assert survey.bounds == survey.files[1].bounds
    assert not survey.files[0].touches(survey.bounds[:2] + survey.bounds[3:5])
    assert same(PointCloud.open(tmp_path), in_batches(survey, 50))
    empty = Survey.open(tmp_path / "a.laz")
    assert np.isnan(empty.bounds).all()
    assert len(PointCloud.open(tmp_path / "a.laz")) == 0


@pytest.mark.parametrize("box", [[0.0] * 6, [1.0, 9.0] * 3, [np.nan] * 6, [np.inf, -np.inf] * 3])
def test_bounds_of_a_header_without_any_are_found(
    tmp_path: Path, box: list[float], caplog: pytest.LogCaptureFixture
) -> None:
    path = tile(tmp_path / "a.las", 10)
    right = Survey.open(path).bounds
    content = bytearray(path.read_bytes())
    struct.pack_into("<6d", content, 179, *box)  # xmax, xmin, ymax, ...
    path.write_bytes(content)
    with caplog.at_level(logging.WARNING, "toolbox"):
        file = Survey.open(path).files[0]
    assert file.bounds == pytest.approx(right)
    assert "has no bounding box" in caplog.text
    assert "has no bounding box" in file.remarks[0]


def test_files_of_different_layout(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Another scale, offset, point format and extra bytes, and what becomes of them."""
    tile(tmp_path / "a.las", 0)
    header = laspy.LasHeader(version="1.2", point_format=3)
    header.scales, header.offsets = [0.001, 0.01, 0.05], [7, 70_000, 3]
    header.add_extra_dim(laspy.ExtraBytesParams("height", "i2", "", [0.5], [0.25]))
    header.add_extra_dim(laspy.ExtraBytesParams("pair", "2u1"))
    other = laspy.LasData(header)
    other.X, other.Y, other.Z = np.arange(5) * 1000, np.arange(5) - 7_000_000, np.arange(5)
    other.scan_angle_rank, other.red = np.arange(5), np.arange(5) * 9
    other["height"], other["pair"] = np.arange(5) + 0.5, np.arange(10).reshape(5, 2)
    other.write(str(tmp_path / "b.las"))
    laspy_cloud = PointCloud.open(tmp_path / "b.las").with_crs(FRANCE)
    with caplog.at_level(logging.INFO, "toolbox"):
        whole = PointCloud.open(tmp_path, assume_crs=FRANCE)
    b = whole.select(np.arange(200, 205))
    assert np.allclose(b.xyz, laspy_cloud.xyz, rtol=0, atol=1e-9)
    assert np.array_equal(b["height"], laspy_cloud["height"])
    assert np.array_equal(b["pair"], laspy_cloud["pair"])
    assert b["red"].tolist() == [0, 9, 18, 27, 36]
    assert np.allclose(b["scan_angle"] * 0.006, np.arange(5), atol=0.003)
    a, alone = whole.select(np.arange(200)), PointCloud.open(tmp_path / "a.las")
    assert np.allclose(a.xyz, alone.xyz, rtol=0, atol=1e-9)
    for name in alone.names:
        assert np.array_equal(a[name], alone[name]), name
    assert not a["red"].any()
    assert not a["pair"].any()
    assert caplog.text.count("a.las: has no red, green, blue, pair; 0 is written there") == 1
    assert "b.las: has no" not in caplog.text
    assert caplog.text.count("different layouts") == 1
    assert same(whole, in_batches(Survey.open(tmp_path, assume_crs=FRANCE), 60))
    whole.save(tmp_path / "c.las")
    again = laspy.read(tmp_path / "c.las")
    assert (again.header.point_format.id, again.header.version.minor) == (7, 4)
    assert again.header.scales.tolist() == [0.001, 0.01, 0.01]
    assert np.array_equal(again.xyz, whole.xyz)
    assert np.array_equal(again["pair"], whole["pair"])


def test_a_header_whose_box_is_far_off(tmp_path: Path) -> None:
    """The offset is chosen for the boxes in the headers; points beyond its reach are refused."""
    tile(tmp_path / "a.las")
    far = tile(tmp_path / "b.las", 0)
    content = bytearray(far.read_bytes())
    struct.pack_into("<3d", content, 131, 0.005, 0.01, 0.01)
    struct.pack_into("<3d", content, 155, 9e8, 0, 0)
    far.write_bytes(content)
    with pytest.raises(DataError, match=r"b\.las .*outside the bounding box in its header"):
        PointCloud.open(tmp_path)


def test_real_tiles(data: Callable[[str], Path], tmp_path: Path) -> None:
    folder = data("ign_urban_50m")
    survey = Survey.open(folder)
    assert survey.count == 216_900
    assert survey.bounds[:2] == (770_500, 6_277_500)
    whole = PointCloud.open(folder)
    assert same(whole, in_batches(survey, 30_000))
    whole.save(tmp_path / "whole.laz")
    assert same(PointCloud.open(tmp_path / "whole.laz"), whole)


def test_real_copc_in_parts(data: Callable[[str], Path]) -> None:
    path = data("copc/ign_77050_627755_ground.copc.laz")
    survey = Survey.open(path)
    whole = PointCloud.open(path)
    batches = survey.files[0].ranges(1000)
    assert len(batches) > 3
    assert same(whole, in_batches(survey, 1000))
    bounds = (770_500, 6_277_500, 770_520, 6_277_510)
    assert 0 < len(survey.read(bounds=bounds)) < len(whole)
    assert same(survey.read(bounds=bounds), PointCloud.open(path, bounds=bounds))


def test_real_feet_beside_metres(data: Callable[[str], Path]) -> None:
    feet, metres = data("feet/autzen_trim.laz"), data("ign_urban_50m/77050_627755.laz")
    with pytest.raises(DataError, match=r"77050_627755\.laz is in EPSG:2154.*reproject"):
        Survey.open([feet, metres])


@pytest.mark.parametrize("name", ["a.laz", "a.csv"])
def test_a_file_that_changed_since_its_header_was_read(name: str, tmp_path: Path) -> None:
    """The points would be those of another file than bounds, attributes and the record."""
    path = tmp_path / name
    points = PointCloud([[0, 0, 1.0], [1, 0, 2.0]])
    points.save(path)
    os.utime(path, (1000, 1000))
    survey = Survey.open(tmp_path)
    assert len(survey.read()) == 2
    points.save(path, overwrite=True)
    for read in (survey.read, lambda: list(survey.batches(1))):
        with pytest.raises(DataError, match=f"{name} changed while the run was reading"):
            read()
