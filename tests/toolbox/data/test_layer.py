"""What every layer class answers to the framework."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely
from affine import Affine
from numpy.typing import NDArray
from pyproj import CRS

from toolbox import language
from toolbox.data import PointCloud, Raster, Report, Section, Survey, Table, Vector
from toolbox.data.drawing import Drawing
from toolbox.data.layer import Layer
from toolbox.data.retiled import Retiled
from toolbox.errors import DataError, ParameterError

UTM = CRS(32631)
POINTS = PointCloud([[0.5, 0.5, 1], [1.5, 0.5, 2], [1.5, 2.5, 3]], {"intensity": [1, 2, 3]})
CELLS = Raster(np.array([[1, np.nan], [2, 3], [4, 5]], np.float32), Affine(1, 0, 0, 0, -1, 3))
SQUARES = geopandas.GeoDataFrame(
    {"n": [1, 2]}, geometry=[shapely.box(0, 0, 1, 1), shapely.box(0.2, 0, 3, 1)], crs=UTM
)
LAYERS: dict[str, Any] = {
    "points": POINTS,
    "cells": CELLS,
    "squares": Vector(SQUARES),
    "rows": Table(pd.DataFrame({"a": [1, 2], "b": [3, 4]})),
    "page": Report("Title", [Section("One", ["text"])]),
}


def west(values: NDArray[np.float64], axis: int) -> NDArray[np.bool_]:
    """The tile from 0 to 1 in x, and all of y."""
    return (values < 1) if axis == 0 else np.full(len(values), True)


def nowhere(values: NDArray[np.float64], axis: int) -> NDArray[np.bool_]:
    return np.full(len(values), False)


FILES = [
    ("points", ".las"),
    ("points", ".xyz"),
    ("cells", ".tif"),
    ("squares", ".shp"),
    ("squares", ".gpkg"),
    ("rows", ".csv"),
    ("rows", ".gpkg"),
    ("page", ".html"),
    ("section", ".dxf"),
    ("survey", ".vpc"),
    ("tiles", ".vpc"),
]


def layer_of(name: str, folder: Path) -> Any:
    """A layer of a class; a survey of a file in the folder."""
    POINTS.save(folder / "a.las")
    survey = Survey.open(folder / "a.las")
    tiles = Retiled(survey.files, "a", side=1.0, pattern="{x}_{y}.las")
    more = {"section": Drawing("Road", (), (), scale=500), "survey": survey, "tiles": tiles}
    return {**LAYERS, **more}[name]


@pytest.mark.parametrize(("name", "ending"), FILES)
def test_no_file_is_replaced_unless_that_is_said(name: str, ending: str, tmp_path: Path) -> None:
    layer, path = layer_of(name, tmp_path), tmp_path / f"b{ending}"
    layer.save(path)
    before = path.read_bytes()
    with pytest.raises(ParameterError, match=rf"b\{ending} exists; allow it with overwrite=True"):
        layer.save(path)
    assert path.read_bytes() == before
    layer.save(path, overwrite=True)


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize(("name", "ending"), FILES)
def test_what_the_system_refuses_is_told_of_the_path(
    name: str, ending: str, overwrite: bool, tmp_path: Path
) -> None:
    layer = layer_of(name, tmp_path)
    for path in (tmp_path / f"{'b' * 300}{ending}", tmp_path / "gone" / f"b{ending}"):
        with pytest.raises(DataError, match=f"^{re.escape(str(path))} cannot be written"):
            layer.save(path, overwrite=overwrite)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such modes")
@pytest.mark.parametrize(("name", "ending"), FILES)
def test_a_folder_that_may_not_be_entered_is_told_of_the_path(
    name: str, ending: str, tmp_path: Path
) -> None:
    layer = layer_of(name, tmp_path)
    shut = tmp_path / "shut"
    shut.mkdir(mode=0o600)
    layer.save(tmp_path / f"b{ending}")  # what it imports, nobody else may be able to read
    with (
        somebody_else(),
        pytest.raises(DataError, match=rf"shut/b\{ending} cannot be written: Permission denied"),
    ):
        layer.save(shut / f"b{ending}")


@contextmanager
def somebody_else() -> Iterator[None]:
    """Be a user without rights, if this one is root, who has all."""
    own = os.geteuid()
    if own == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(own)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows lets few users make links")
@pytest.mark.parametrize(("name", "ending"), FILES)
def test_a_link_is_followed(name: str, ending: str, tmp_path: Path) -> None:
    layer, there = layer_of(name, tmp_path), tmp_path / "there"
    there.mkdir()
    link, path = tmp_path / f"link{ending}", there / f"b{ending}"
    link.symlink_to(path)
    layer.save(link)  # as on the command line, also if nothing is there
    assert link.is_symlink()
    before = path.read_bytes()
    with pytest.raises(ParameterError, match=rf"there/b\{ending} exists"):
        layer.save(link)
    assert path.read_bytes() == before
    layer.save(link, overwrite=True)
    assert link.is_symlink()
    assert path.is_file()
    assert {file.name for file in tmp_path.iterdir()} == {"a.las", "there", link.name}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows lets few users make links")
@pytest.mark.parametrize(("name", "ending"), FILES)
def test_a_circular_link_is_told(name: str, ending: str, tmp_path: Path) -> None:
    layer, link = layer_of(name, tmp_path), tmp_path / f"link{ending}"
    link.symlink_to(link)
    with pytest.raises(DataError, match=rf"link\{ending} cannot be written"):
        layer.save(link, overwrite=True)
    assert link.is_symlink()


def test_tiles_replace_no_file_of_somebody_else(tmp_path: Path) -> None:
    POINTS.save(tmp_path / "a.las")
    (tmp_path / "0_0.las").write_text("notes")
    tiles = Retiled(Survey.open(tmp_path / "a.las").files, "a", side=1.0, pattern="{x}_{y}.las")
    with pytest.raises(ParameterError, match=r"0_0\.las exists"):
        tiles.save(tmp_path / "b.vpc")
    assert (tmp_path / "0_0.las").read_text() == "notes"


@pytest.mark.parametrize("name", ["squares", "rows"])
def test_a_layer_is_added_to_a_geopackage_but_replaces_none(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    LAYERS[name].save(path, layer="one")
    LAYERS[name].save(path, layer="two", add=True)
    with pytest.raises(ParameterError, match=r"layer two of .*a\.gpkg exists; .* beside add=True"):
        LAYERS[name].save(path, layer="Two", add=True)
    LAYERS[name].save(path, layer="Two", add=True, overwrite=True)
    layers = Vector.layers(path) if name == "squares" else Table.layers(path)
    assert sorted(layers) == ["one", "two"]  # the one replaced keeps its name


@pytest.mark.parametrize("name", ["squares", "rows"])
def test_a_layer_is_added_to_no_other_kind_of_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    path.write_text("notes")
    with pytest.raises(DataError, match=r"a\.gpkg cannot be read as a GeoPackage"):
        LAYERS[name].save(path, add=True, overwrite=True)
    assert path.read_text() == "notes"


@pytest.mark.parametrize(
    ("name", "sizes"),
    [("points", (3, 1)), ("cells", (5, 3)), ("squares", (2, 1)), ("rows", (2, None)), ("page", ())],
)
def test_size_of_all_and_of_a_tile(name: str, sizes: tuple[int | None, ...]) -> None:
    layer: Layer = LAYERS[name]
    assert (layer.size(), layer.size(west)) == (sizes or (None, None))
    part = layer.cropped(west)
    assert (part.size() if part is not None else None) == layer.size(west)


def test_a_tile_without_cells_has_no_raster_but_no_points() -> None:
    assert CELLS.cropped(nowhere) is None
    assert len(POINTS.cropped(nowhere)) == 0


def test_points_of_a_tile_with_neighbours_belong_where_their_origin_says() -> None:
    tile = POINTS.with_origin(np.array([-1, 1, 2]))
    assert tile.size(nowhere) == 2
    assert tile.cropped(nowhere)["intensity"].tolist() == [2, 3]


@pytest.mark.parametrize("name", LAYERS)
def test_what_is_told_apart_has_other_contents(name: str) -> None:
    layers = {n: {k: v.tobytes() for k, v in layer.contents()} for n, layer in LAYERS.items()}
    assert layers.pop(name)
    assert all(layers.values())


def test_thousands_have_no_comma_where_it_is_the_decimal_sign() -> None:
    """A Turkish page had "54,864 nokta", which is 55 points."""
    cloud = PointCloud(np.zeros((54864, 3)))
    assert cloud.size_text() == "54,864 points"
    with language.speaking("tr"):
        assert language.told(cloud.size_text()) == "54\u202f864 nokta"


@pytest.mark.parametrize("name", LAYERS)
def test_a_page_lists_rows_and_says_how_large_the_rest_is(name: str) -> None:
    layer: Layer = LAYERS[name]
    said = {"points": "3 points", "cells": "3 rows, 2 columns"}
    assert layer.size_text() == said.get(name, "")
    assert bool(layer.page_sections("title", "help")) == (name not in said)


@pytest.mark.parametrize("name", LAYERS)
def test_only_layers_with_coordinates_take_a_crs(name: str) -> None:
    layer: Layer = LAYERS[name]
    assert (layer.with_crs(UTM).crs == UTM) == layer.is_spatial
    assert layer.is_spatial == (name in ("points", "cells", "squares"))


def test_differences_in_words() -> None:
    assert list(POINTS.differences(POINTS)) == []
    moved = POINTS.with_xyz(np.add(POINTS.xyz, [0, 0, 2])).with_attributes({"b": [1, 2, 3]})
    assert list(POINTS.differences(moved)) == ["z: 3 of 3 points differ by up to 2", "b: is new"]
    assert list(CELLS.differences(CELLS.window(slice(0, 2), slice(0, 2)))) == [
        "(1, 3, 2) cells of 1 from (0.0, 0.0), now (1, 2, 2) of 1 from (0.0, 1.0)"
    ]
    assert list(Vector(SQUARES).differences(Vector(SQUARES.assign(n=[1, 3])))) == [
        "n: 1 of 2 rows differ by up to 1"
    ]


def test_joined_features_are_those_of_all_layers_in_order() -> None:
    joint = Vector.concat([Vector(SQUARES[:1], name="a"), Vector(SQUARES[:0]), Vector(SQUARES)])
    assert (joint.frame["n"].tolist(), joint.name, joint.crs) == ([1, 1, 2], "a", UTM)


def test_what_has_no_file_format_is_not_written() -> None:
    class Strange(Layer):
        crs, name, metre = None, "", 1.0

    with pytest.raises(DataError, match=r"a\.txt: a Strange is not written"):
        Strange().save("a.txt")


def test_a_notebook_shows_a_table() -> None:
    points = PointCloud([[1.0, 2.0, 3.0]], {"own": [1]}, crs=CRS(32635), name="a<b>.laz")
    html = points._repr_html_()
    assert html.startswith("<table><caption>PointCloud a&lt;b&gt;.laz</caption>")
    assert "<td>1 points</td>" in html
    assert "<td>EPSG:32635 WGS 84 / UTM zone 35N</td>" in html
    assert "<td>1, 2, 3, 1, 2, 3</td>" in html
    assert "<td>own</td>" in html
    for layer in (CELLS, Table(pd.DataFrame({"a": [1]}))):
        assert layer._repr_html_().startswith(f"<table><caption>{type(layer).__name__} in memory")


@pytest.mark.parametrize(
    ("layer", "text"),
    [
        (POINTS, "<PointCloud in memory: 3 points>"),
        (CELLS, "<Raster in memory: 3 rows, 2 columns, cell 1>"),
        (
            Raster(np.zeros((2, 1, 1)), Affine(0.5, 0, 0, 0, -0.5, 3), name="a.tif"),
            "<Raster a.tif: 2 bands, 1 rows, 1 columns, cell 0.5>",
        ),
        (Vector(SQUARES, name="a.gpkg"), "<Vector a.gpkg: 2 features, Polygon>"),
        (Vector(SQUARES[:0], geometry_type="Point Z"), "<Vector in memory: 0 features, Point Z>"),
        (LAYERS["rows"], "<Table in memory: 2 rows, 2 columns>"),
        (LAYERS["page"], "<Report in memory: 'Title', 1 sections>"),
        (Drawing("Road", (), (), scale=500), "<Drawing in memory: 'Road', 0 sections, 1:500>"),
    ],
)
def test_a_layer_is_shown_in_one_line(layer: Layer, text: str) -> None:
    assert repr(layer) == text


@pytest.mark.parametrize(
    ("layer", "says"),
    [
        (LAYERS["cells"], r"a Raster is no array; take .band\(\) for heights"),
        (LAYERS["points"], "a PointCloud is no array; take .xyz, or one attribute"),
        (LAYERS["squares"], "a Vector is no array; take .frame, a GeoDataFrame"),
        (LAYERS["rows"], "a Table is no array; take .frame, a DataFrame"),
    ],
)
def test_a_layer_taken_for_an_array_says_where_its_numbers_are(layer: Layer, says: str) -> None:
    for how in ({}, {"dtype": float}):
        with pytest.raises(TypeError, match=says):
            np.asarray(layer, **how)
    assert np.array([layer], dtype=object)[0] is layer
