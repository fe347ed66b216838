"""What tiles store comes back as it was, and is no code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely
from affine import Affine
from pandas.testing import assert_frame_equal
from pyproj import CRS

from toolbox.data import PointCloud, Raster, Vector
from toolbox.data.crs import LOCAL
from toolbox.data.survey import Survey
from toolbox.declare.values import Share
from toolbox.errors import DataError
from toolbox.runs.provenance import Count
from toolbox.tiles import store
from toolbox.tiles.work import Result

ISO = "ISO8601"


def stored(layer: Any, folder: Path) -> Any:
    store.save_layer(folder / "piece", layer)
    files = [path for path in (folder / "piece").rglob("*") if path.is_file()]
    assert {path.suffix for path in files} == {".npy", ".json"}
    return store.load_layer(folder / "piece")


def memory() -> PointCloud:
    columns = {"a/b": [1, 2], "../c": [0.5, np.nan], "triple": [[1, 2, 3], [4, 5, 6]]}
    described = {"a/b": "a number"}
    return PointCloud([[0, 0, 1], [2, 3, 4]], columns, crs=CRS(32635), descriptions=described)


@pytest.mark.parametrize("crs", [None, LOCAL, CRS(2154), CRS("EPSG:2227+6360")])
def test_points_in_memory(crs: CRS | None, tmp_path: Path) -> None:
    layer = memory().with_crs(crs).with_origin(np.array([7, 9]))
    found = stored(layer, tmp_path)
    assert found.names == layer.names
    np.testing.assert_array_equal(found.xyz, layer.xyz)
    np.testing.assert_array_equal(found.origin, [7, 9])
    for name in layer.names:
        np.testing.assert_array_equal(found[name], layer[name])
        assert found[name].dtype == layer[name].dtype
    assert found.crs == crs
    np.testing.assert_array_equal(store.box_of(tmp_path / "piece"), [[0, 0, 1], [2, 3, 4]])
    empty = store.load_layer(tmp_path / "piece", empty=True)
    assert (len(empty), empty.names) == (0, layer.names)


FILES = [
    "copc/simple.copc.laz",
    "feet/nebraska_wkt_and_geotiff.las",
    "ahn_amsterdam/ahn4_2463_9714_rgb.laz",
]


@pytest.mark.parametrize("name", FILES)
def test_points_of_a_file_are_written_as_if_they_had_not_been_stored(
    name: str, data: Callable[[str], Path], tmp_path: Path
) -> None:
    """Header, records and extra bytes too."""
    read = PointCloud.open(data(name))
    changed = read.select(np.arange(0, len(read), 7)).with_attributes(
        {"n": np.arange(-(-len(read) // 7))}
    )
    for number, layer in enumerate((read, changed, changed.read_back())):
        folder = tmp_path / str(number)
        folder.mkdir()
        layer.save(folder / "a.las")
        stored(layer, folder).save(folder / "b.las")
        assert (folder / "a.las").read_bytes() == (folder / "b.las").read_bytes()


@pytest.mark.parametrize(
    ("values", "nodata"),
    [
        (np.array([[1.5, np.nan]], np.float32), None),
        (np.array([[1, 2]], np.uint8), 2),
        (np.array([[1, 2]], np.int16), None),
    ],
)
def test_rasters(values: Any, nodata: float | None, tmp_path: Path) -> None:
    said: dict[str, Any] = {"nodata": nodata, "descriptions": ("é",), "units": ("m",), "name": "a"}
    layer = Raster(values, Affine(0.1, 0, 5, 0, -0.1, 7), crs=CRS(2154), **said)
    found = stored(layer, tmp_path)
    np.testing.assert_array_equal(found.values, layer.values)
    assert found.values.dtype == layer.values.dtype
    for name in ("transform", "crs", *said):
        assert getattr(found, name) == getattr(layer, name)


def frame() -> geopandas.GeoDataFrame:
    columns = {
        "text": ["é\n", None, "\0"],
        "mixed": [1, "a", None],
        "float": [0.1, np.nan, np.inf],
        "single": np.array([0.1, 2, 3], np.float32),
        "whole": np.array([1, 2, 2**62], np.int64),
        "byte": np.array([1, 2, 255], np.uint8),
        "maybe": pd.array([1, None, 3], dtype="Int64"),
        "yes": [True, False, True],
        "perhaps": pd.array([True, None, False], dtype="boolean"),
        "when": pd.to_datetime(["2020-01-01", None, "2021-05-06T07:08:09.123456"], format=ISO),
        "zoned": pd.to_datetime(["2020-01-01", None, "2021-05-06"], utc=True),
        "long": pd.to_timedelta([1, None, 3], unit="s"),
        "geometry": [shapely.Point(0.1, 2, 3), None, shapely.Polygon()],
        "last": [1, 2, 3],
    }
    return geopandas.GeoDataFrame(columns, crs=2154)


@pytest.mark.parametrize("rows", [slice(None), slice(0)])
def test_features(rows: slice, tmp_path: Path) -> None:
    layer = Vector(frame()[rows], name="a.gpkg", geometry_type="Point Z")
    found = stored(layer, tmp_path)
    assert_frame_equal(pd.DataFrame(found.frame), pd.DataFrame(layer.frame))
    assert found.frame.geometry.has_z.tolist() == layer.frame.geometry.has_z.tolist()
    assert (found.crs, found.name, found.geometry_type) == (CRS(2154), "a.gpkg", "Point Z")


def test_numbers_of_a_tile() -> None:
    values = {"n": 3, "share": Share(1, 3), "x": 0.1, "none": float("inf")}
    result = Result(values, (Count("step", "points", 5),), ("mind",), ("dark",), ("bare",), 10**9)
    found = Result.from_json(result.to_json())
    assert found == result
    assert repr(found.values["share"]) == "0.3333333333333333 (1 of 3)"


@pytest.mark.parametrize("harm", ["array", "text", "missing"])
def test_what_is_damaged_names_its_folder(harm: str, tmp_path: Path) -> None:
    piece = tmp_path / "piece"
    store.save_layer(piece, memory())
    if harm == "array":
        next(piece.glob("*.npy")).write_bytes(b"no array")
    elif harm == "text":
        (piece / store.LAYER).write_text("[1]", "utf-8")
    else:
        (piece / store.LAYER).write_text("{}", "utf-8")
    with pytest.raises(DataError, match=r"piece is damaged .*remove it"):
        store.load_layer(piece)


def test_a_block_that_lacks_points_is_damaged(tmp_path: Path) -> None:
    cloud = PointCloud([[0, 0, 1], [2, 3, 4]], crs=CRS(32635))
    cloud.save(tmp_path / "a.laz")
    survey = Survey.open(tmp_path)
    (block,) = store.blocks("points", survey, 0, 10)
    grid = store.TileGrid(1.0)
    store.split(survey, block, grid, tmp_path)
    np.save(tmp_path / block.name / "table.npy", np.array([[0, 0, 1]]))
    with pytest.raises(DataError, match="another number of points"):
        store.split(survey, block, grid, tmp_path)


def test_points_around_a_tile_are_those_within_its_bounds(tmp_path: Path) -> None:
    """Whole runs of points are within, others beyond, and some across, also just on the edge."""
    y, x = np.divmod(np.arange(100 * store.RUN), 400)
    cloud = PointCloud.from_arrays(x, y, y + 0.5, weight=x, crs=CRS(32635))
    pieces = [np.arange(0), np.arange(300), np.arange(300, 90_000), np.arange(90_000, len(x))]
    for number, rows in enumerate(pieces):
        store.save_layer(tmp_path / str(number), cloud.select(rows).with_origin(rows))
    folders = [tmp_path / str(number) for number in range(len(pieces))]
    for bounds in [(0, 50, 399, 150), (30, 0, 200, 230), (-1, -1, 400, 256), (399, 255, 500, 500)]:
        found = store.joined(folders, bounds)
        assert found is not None
        inside = cloud.inside(bounds)
        assert np.array_equal(found.origin, np.flatnonzero(inside))
        assert np.array_equal(found.xyz, cloud.xyz[inside])
        assert np.array_equal(found["weight"], x[inside])
    assert store.joined(folders, (400, 0, 500, 500)) is None
