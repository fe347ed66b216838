"""Every format carries the record of how a file was made, and nothing else changes by it."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import geopandas
import laspy
import numpy as np
import pandas as pd
import pytest
import shapely
from affine import Affine

from toolbox.data import PointCloud, Raster, Table, Vector
from toolbox.data.crs import parse_crs
from toolbox.data.record import foreign_side_car, is_record, read_record, side_car
from toolbox.errors import DataError
from toolbox.pictures.draw import draw

CRS = parse_crs("EPSG:2154+5720")
RECORD = json.dumps({"lidar-toolbox": "0.1.0", "text": "é <&> \"'\\", "number": 0.1 + 0.2})
OTHER = json.dumps({"lidar-toolbox": "0.2.0"})


def cloud() -> PointCloud:
    return PointCloud(np.arange(30.0).reshape(10, 3), {"intensity": np.arange(10)}, crs=CRS)


def raster() -> Raster:
    return Raster(np.arange(12, dtype=np.float32).reshape(3, 4), Affine(1, 0, 5, 0, -1, 9), crs=CRS)


def vector() -> Vector:
    return Vector(geopandas.GeoDataFrame({"n": [1]}, geometry=[shapely.Point(3, 4)], crs=2154))


def building() -> Vector:
    outline = shapely.box(0, 0, 8, 6)
    values = {"n": [1], "ground": [100.0], "eave": [106.0], "ridge": [108.0], "height": [8.0]}
    return Vector(geopandas.GeoDataFrame(values, geometry=[outline], crs=2154))


def table() -> Table:
    return Table(pd.DataFrame({"n": [1, 2]}))


LAYERS: list[tuple[Callable[[], Any], str, dict[str, Any]]] = [
    *((cloud, suffix, {}) for suffix in PointCloud.SUFFIXES),
    (raster, ".tif", {}),
    (raster, ".TIFF", {"cog": True}),
    *(
        (vector, suffix, {})
        for suffix in Vector.SUFFIXES
        if suffix not in (".ply", ".city.json", ".ifc")
    ),
    (building, ".city.json", {}),
    *((table, suffix, {}) for suffix in Table.SUFFIXES),
]
WRITTEN_ONLY = [(cloud, ".parquet"), (vector, ".kmz"), (building, ".city.json")]
layers = pytest.mark.parametrize(
    ("make", "suffix", "how"), LAYERS, ids=[f"{m.__name__}{s}" for m, s, _ in LAYERS]
)
read_layers = pytest.mark.parametrize(
    ("make", "suffix", "how"),
    [case for case in LAYERS if (case[0], case[1]) not in WRITTEN_ONLY],
)
INSIDE = (".laz", ".copc.laz", ".las", ".tif", ".TIFF", ".gpkg")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@layers
def test_round_trip(make: Any, suffix: str, how: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    make().save(path, record=RECORD, **how)
    assert read_record(path) == RECORD
    assert (tmp_path / f"a{suffix}.json").exists() is (suffix not in INSIDE)
    assert set(tmp_path.iterdir()) <= set(type(make()).own_files(path))


@layers
def test_same_bytes_on_every_run(
    make: Any, suffix: str, how: dict[str, Any], tmp_path: Path
) -> None:
    for run in ("first", "second"):
        (tmp_path / run).mkdir()
        make().save(tmp_path / run / f"a{suffix}", record=RECORD, **how)
    assert contents(tmp_path / "first") == contents(tmp_path / "second")


@read_layers
def test_the_layer_is_the_same_with_and_without(
    make: Any, suffix: str, how: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / f"a{suffix}"
    make().save(path, **how)
    assert read_record(path) == ""
    assert not path.with_name(f"{path.name}.json").exists()
    plain = type(make()).open(path)
    make().save(path, record=RECORD, **how, overwrite=True)
    found = type(make()).open(path)
    assert set(tmp_path.iterdir()) <= set(
        type(make()).own_files(path)
    )  # nothing written by reading
    if isinstance(found, Vector | Table):
        assert found.frame.equals(plain.frame)
    elif isinstance(found, Raster):
        assert np.array_equal(found.values, plain.values)
        assert (found.crs, found.transform) == (plain.crs, plain.transform)
    else:
        assert np.array_equal(found.xyz, plain.xyz)
        assert found.names == plain.names
        assert found.crs == plain.crs


@read_layers
def test_what_an_earlier_run_said_goes(
    make: Any, suffix: str, how: dict[str, Any], tmp_path: Path
) -> None:
    path, kind = tmp_path / f"a{suffix}", type(make())
    make().save(path, **how)
    kind.open(path).save(path, **how, overwrite=True)
    plain = contents(tmp_path)
    for record in (RECORD, OTHER):
        make().save(path, overwrite=True, record=record, **how)
    assert read_record(path) == OTHER
    again = kind.open(path)  # a LAS file keeps its records, but for this one
    again.save(path, overwrite=True, **how)
    assert read_record(path) == ""
    assert contents(tmp_path) == plain


def test_other_records_of_a_las_file_stay(tmp_path: Path) -> None:
    cloud().save(tmp_path / "a.las", record=RECORD)
    found = laspy.read(tmp_path / "a.las")
    assert [vlr.user_id for vlr in found.vlrs] == ["LASF_Projection", "lidar-toolbox"]
    assert found.vlrs[1].description == "provenance"
    PointCloud.open(tmp_path / "a.las").save(tmp_path / "b.las", record=OTHER)
    assert [vlr.user_id for vlr in laspy.read(tmp_path / "b.las").vlrs] == [
        "LASF_Projection",
        "lidar-toolbox",
    ]


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_a_long_record_stands_behind_the_points(suffix: str, tmp_path: Path) -> None:
    """A VLR holds 65 535 bytes."""
    for size, evlrs in [(65_535, 0), (65_536, 1)]:
        long = json.dumps({"lidar-toolbox": ""})
        long = json.dumps({"lidar-toolbox": "x" * (size - len(long))})
        cloud().save(tmp_path / f"a{suffix}", record=long, overwrite=True)
        assert read_record(tmp_path / f"a{suffix}") == long
        found = laspy.read(tmp_path / f"a{suffix}")
        assert len(found.evlrs) == evlrs
        assert np.array_equal(found.xyz, cloud().xyz)


def test_a_long_record_is_refused_by_older_las(tmp_path: Path) -> None:
    old = laspy.LasData(laspy.LasHeader(version="1.2", point_format=0))
    old.write(str(tmp_path / "a.las"))
    long = json.dumps({"lidar-toolbox": "x" * 66_000})
    with pytest.raises(DataError, match=r"b\.las cannot be written: a record of 660\d\d bytes"):
        PointCloud.open(tmp_path / "a.las").save(tmp_path / "b.las", record=long)


def test_pictures(tmp_path: Path) -> None:
    draw({"dtm": raster()}, tmp_path / "plain.png")
    for name in ("a.png", "b.png"):
        draw({"dtm": raster()}, tmp_path / name, record=RECORD)
    assert read_record(tmp_path / "plain.png") == ""
    assert read_record(tmp_path / "a.png") == RECORD
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_side_cars_of_others_are_left_alone(tmp_path: Path) -> None:
    path, beside = tmp_path / "a.csv", tmp_path / "a.csv.json"
    for text in ('{"mine": 1}', "[]", "no json", "[" * 100_000):
        beside.write_text(text)
        table().save(path, overwrite=True)
        assert read_record(path) == ""
        assert Table.own_files(path) == (path,)
        assert foreign_side_car(path) == beside
        with pytest.raises(DataError, match=r"a\.csv\.json is no record of ours"):
            table().save(path, record=RECORD, overwrite=True)
        assert beside.read_text() == text
    assert side_car("a.laz") is None
    assert foreign_side_car("a.laz") is None


def test_what_is_no_record_is_not_written(tmp_path: Path) -> None:
    assert not is_record('{"tool": "x"}')
    for make, suffix, how in LAYERS:
        with pytest.raises(ValueError, match="member 'lidar-toolbox'"):
            make().save(tmp_path / f"a{suffix}", overwrite=True, record='{"tool": "x"}', **how)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"none\.laz: no such file"):
        read_record(tmp_path / "none.laz")
    for suffix in (".laz", ".tif", ".gpkg", ".png"):
        path = tmp_path / f"a{suffix}"
        path.write_bytes(b"nothing of the kind")
        with pytest.raises(DataError, match=rf"a\{suffix} "):
            read_record(path)
    (tmp_path / "a.txt").write_text("no points")
    assert read_record(tmp_path / "a.txt") == ""


def test_a_clipped_picture_has_no_record(tmp_path: Path) -> None:
    head = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4s", 1 << 30, b"tEXt") + b"provenance\0{}"
    (tmp_path / "a.png").write_bytes(head)
    assert read_record(tmp_path / "a.png") == ""


def test_a_geopackage_of_several_layers(data: Callable[[str], Path]) -> None:
    assert read_record(data("ahn3_delft_bgt/bgt_east_cropped_2.gpkg")) == ""
