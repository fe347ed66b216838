"""planes.drawing and planes.orthophoto: lengths, texts, units and places of a known front."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS

from algorithms.planes.drawing import PlanesDrawing
from algorithms.planes.orthophoto import PlanesOrthophoto
from toolbox.data import PointCloud, Vector
from toolbox.data.crs import parse_crs
from toolbox.errors import DataError

UTM = CRS(32635)


def elevation(unit: str = "local", metre: float = 1.0) -> Vector:
    """A wall of 10 m by 6 m that looks south, with a door and two windows above each other."""
    holes = [(1, 0, 2, 2.1), (4, 1, 5.5, 2.5), (4, 4, 5.5, 5)]
    boxes = [shapely.box(*np.array(hole) * metre) for hole in holes]
    wall = shapely.box(0, 0, 10 * metre, 6 * metre).difference(shapely.union_all(boxes))
    sizes = [((e - w) * metre, (n - s) * metre, s * metre) for w, s, e, n in holes]
    corner = (500_000.0, 4_400_000.0, 100.0, 1, 0, 0, 0, 0, 1)
    names = [f"{name}_{axis}" for name in ("corner", "right", "up") for axis in "xyz"]
    rows: list[dict[str, Any]] = [
        {"kind": "facade", "front_id": 1, "opening_id": 0, **dict(zip(names, corner, strict=True))}
    ]
    for number, (width, height, sill) in enumerate(sizes, start=1):
        kind = "door" if number == 1 else "window"
        size = {"width": width, "height": height, "sill": sill}
        rows.append({"kind": kind, "front_id": 1, "opening_id": number, **size})
    frame = geopandas.GeoDataFrame(rows, geometry=[wall, *boxes], crs=parse_crs(unit))
    return Vector(frame, name="elevation")


def texts(frame: geopandas.GeoDataFrame, layer: str) -> list[str]:
    return frame.loc[(frame["layer"] == layer) & frame["text"].notna(), "text"].tolist()


def test_dimensions_are_those_of_the_wall() -> None:
    found = PlanesDrawing(elevation=elevation(), subject="Town hall").run()
    frame = found.drawing.frame
    assert texts(frame, "dimensions") == [
        *("1.00", "1.00", "2.00", "1.50", "4.50", "10.00"),
        *("2.10", "3.90", "6.00"),
    ]
    assert texts(frame, "numbers") == ["1", "2", "3", "Front 1"]
    assert texts(frame, "title")[:3] == [
        "Town hall",
        "Elevation of 1 front, outside",
        "Dimensions in m, rounded to 0.01 m",
    ]


def test_the_title_block_says_how_far_apart_the_points_are() -> None:
    layer = elevation()
    layer = Vector(layer.frame.assign(spacing=[0.052, *[np.nan] * 3]), name="elevation")
    for unit, says in (("m", "0.05 m"), ("mm", "52 mm")):
        frame = PlanesDrawing(elevation=layer, unit=unit).run().drawing.frame  # type: ignore[arg-type]
        assert texts(frame, "title")[-1] == f"Points {says} apart: no edge is surer than that"


def test_millimetres() -> None:
    found = PlanesDrawing(elevation=elevation(), unit="mm", rounding=0.005).run().drawing
    assert texts(found.frame, "dimensions")[5] == "10000"
    walls = found.frame[found.frame["layer"] == "walls"]
    assert walls.geometry.length.sum() == pytest.approx(32_000)
    assert found.crs is not None
    assert found.crs.axis_info[0].unit_name == "millimetre"


def test_the_schedule_is_in_millimetres_whatever_the_unit() -> None:
    for made in (elevation(), elevation("local:mm", 1000.0)):
        rows = PlanesDrawing(elevation=made).run().schedule.rows()
        found = [(r["kind"], r["width_mm"], r["height_mm"], r["sill_mm"]) for r in rows]
        assert found == [
            ("door", 1000, 2100, 0),
            ("window", 1500, 1500, 1000),
            ("window", 1500, 1000, 4000),
        ]


def test_a_dxf_has_layers_texts_and_its_unit(tmp_path: Path) -> None:
    import ezdxf

    drawing = PlanesDrawing(elevation=elevation(), unit="mm").run().drawing
    drawing.save(tmp_path / "a.dxf")
    found = ezdxf.readfile(tmp_path / "a.dxf")  # type: ignore[attr-defined]
    assert found.header["$INSUNITS"] == 4
    layers = {one.dxf.name for one in found.layers}
    assert {"walls", "openings", "dimensions", "numbers", "title"} <= layers
    sizes = {round(text.dxf.height) for text in found.modelspace().query("TEXT")}
    assert sizes == {200}
    assert not found.audit().errors


def test_another_layer_is_refused() -> None:
    other = Vector(geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)], crs=UTM))
    with pytest.raises(DataError, match=r"take that of planes\.openings"):
        PlanesDrawing(elevation=other).run()


def test_an_image_shows_points_where_they_are_on_the_elevation() -> None:
    u, v = (a.ravel() for a in np.meshgrid(np.arange(0.05, 10, 0.1), np.arange(0.05, 6, 0.1)))
    bright = (u > 4) & (u < 5.5) & (v > 4) & (v < 5)
    xyz = np.column_stack([500_000 + u, np.full(len(u), 4_400_000.02), 100 + v])
    behind = xyz[:200] + np.array([0, 3, 0])  # too far behind to be shown
    shade = np.concatenate([np.where(bright, 900, 100), np.full(200, 5000)]).astype(np.uint16)
    points = PointCloud(np.vstack([xyz, behind]), {"intensity": shade}, crs=UTM)
    found = PlanesOrthophoto(points=points, elevation=elevation(), cell=0.1).run()
    band = found.image.band()
    assert band.shape == (60, 100)
    assert found.filled_share == 1.0
    window = band[10:20, 40:55]
    assert window.min() > band[30:].max()


def test_empty_cells_take_the_nearest_within_reach() -> None:
    u, v = (a.ravel() for a in np.meshgrid(np.arange(0.05, 10, 0.3), np.arange(0.05, 6, 0.3)))
    xyz = np.column_stack([500_000 + u, np.full(len(u), 4_400_000.0), 100 + v])
    points = PointCloud(xyz, {"intensity": np.arange(len(u)).astype(np.uint16)}, crs=UTM)
    shares = [
        PlanesOrthophoto(points=points, elevation=elevation(), cell=0.1, fill_cells=n)
        .run()
        .filled_share
        for n in (0, 2)
    ]
    assert shares[0] == pytest.approx(1 / 9, abs=0.02)
    assert shares[1] > 0.95
