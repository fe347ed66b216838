"""vectors.clip: known pieces, both sides add up, nothing of lower dimension."""

from __future__ import annotations

from typing import Any

import geopandas
import numpy as np
import pytest
import shapely

from algorithms.vectors.clip import VectorsClip
from toolbox.data import Vector
from toolbox.declare import Extent
from toolbox.errors import DataError

BOX = Extent(0, 0, 10, 10)


def layer(*shapes: Any) -> Vector:
    frame = geopandas.GeoDataFrame({"n": range(len(shapes))}, geometry=list(shapes), crs=32635)
    return Vector(frame, name="a.gpkg")


def clipped(*shapes: Any, **how: Any) -> tuple[list[str], int]:
    out = VectorsClip(features=layer(*shapes), **({"extent": BOX} | how)).run()
    return [shape.wkt for shape in out.clipped.frame.geometry], out.removed


def test_lines_are_cut() -> None:
    line = shapely.LineString([(-5, 5), (15, 5)])
    assert clipped(line) == (["LINESTRING (0 5, 10 5)"], 0)
    (outside,), _ = clipped(line, keep="outside")
    assert outside == "MULTILINESTRING ((-5 5, 0 5), (10 5, 15 5))"


def test_heights_come_from_the_line() -> None:
    (found,), _ = clipped(shapely.LineString([(-5, 5, 0), (15, 5, 20)]))
    assert found == "LINESTRING Z (0 5 5, 10 5 15)"


def test_what_only_touches_is_gone() -> None:
    beside = shapely.box(10, 0, 20, 10)
    along = shapely.LineString([(5, 10), (5, 20)])
    assert clipped(beside, along, shapely.Point(50, 50)) == ([], 3)


def test_polygons_and_attributes() -> None:
    area = layer(shapely.box(0, 0, 4, 10), shapely.box(6, 0, 10, 10))
    out = VectorsClip(
        features=layer(shapely.box(-5, 2, 15, 3), shapely.box(4.5, 0, 5.5, 1)), polygons=area
    ).run()
    assert out.clipped.frame["n"].tolist() == [0]
    assert out.clipped.frame.geometry[0].area == pytest.approx(8)
    both = VectorsClip(
        features=layer(shapely.box(-5, 2, 15, 3)), polygons=area, extent=Extent(0, 0, 5, 5)
    ).run()
    assert both.clipped.frame.geometry[0].area == pytest.approx(4)


def test_both_sides_add_up() -> None:
    rng = np.random.default_rng(1)
    shapes = [shapely.Point(*rng.uniform(-5, 15, 2)).buffer(rng.uniform(1, 4)) for _ in range(50)]
    total = sum(shape.area for shape in shapes)
    parts = [VectorsClip(features=layer(*shapes), extent=BOX, keep=k).run() for k in SIDES]
    assert sum(p.clipped.frame.area.sum() for p in parts) == pytest.approx(total)


SIDES: Any = ("inside", "outside")


def test_nothing_to_clip_by() -> None:
    with pytest.raises(DataError, match="extent: neither a rectangle nor polygons"):
        VectorsClip(features=layer(shapely.Point(0, 0)))
