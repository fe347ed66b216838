"""vectors.merge: features of several layers, with the name of each, and labels."""

from __future__ import annotations

from pathlib import Path

import geopandas
import pytest
import shapely
from pyproj import CRS

from algorithms.vectors.merge import VectorsMerge
from toolbox.data import Vector
from toolbox.errors import DataError

UTM = CRS(32635)


def layer(shape: object, **values: object) -> Vector:
    columns = {name: [value] for name, value in values.items()}
    return Vector(geopandas.GeoDataFrame(columns, geometry=[shape], crs=UTM))


def merged(**more: object) -> geopandas.GeoDataFrame:
    wires = layer(shapely.LineString([(0, 0, 5), (10, 0, 7)]), sag=1.5, layer="old")
    towers = layer(shapely.Point(0, 0, 1), tower_id=3)
    made = VectorsMerge(layers=(wires, towers), layer_names=("wires", "towers"), **more)  # type: ignore[arg-type]
    return made.run().merged.frame


def test_each_feature_knows_its_layer() -> None:
    frame = merged()
    assert frame["layer"].tolist() == ["wires", "towers"]
    assert frame["sag"].tolist()[0] == 1.5
    assert frame["tower_id"].tolist()[1] == 3
    assert frame.crs == UTM


def test_labels_stand_beside_features() -> None:
    label = merged(label_attributes=("sag", "tower_id"), label_height=2.0).iloc[2:]
    assert label["layer"].tolist() == ["wires_labels", "towers_labels"]
    assert label["text"].tolist() == ["1.5", "3"]
    places = [tuple(shapely.get_coordinates(g, include_z=True)[0]) for g in label.geometry]
    assert places == [(7.0, 2.0, 6.0), (2.0, 2.0, 1.0)]


def test_a_drawing_has_texts(tmp_path: Path) -> None:
    import ezdxf

    frame = merged(label_attributes=("", "tower_id"), label_height=2.0)
    Vector(frame).save(tmp_path / "a.dxf")
    found = ezdxf.readfile(tmp_path / "a.dxf")  # type: ignore[attr-defined]
    (text,) = found.modelspace().query("TEXT")
    assert (text.dxf.text, text.dxf.height, text.dxf.layer) == ("3", 2.0, "towers_labels")
    assert {"wires", "towers"} <= {one.dxf.name for one in found.layers}


def test_as_many_names_as_layers() -> None:
    one = layer(shapely.Point(0, 0))
    with pytest.raises(DataError, match="layer_names: must be 1, one for each layer, got 2"):
        VectorsMerge(layers=(one,), layer_names=("a", "b")).run()
    with pytest.raises(DataError, match="has no attribute 'height'"):
        VectorsMerge(layers=(one,), layer_names=("a",), label_attributes=("height",)).run()
