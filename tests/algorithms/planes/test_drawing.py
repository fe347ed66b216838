"""Lengths, texts and units of the drawing of a known front."""

from __future__ import annotations

from pathlib import Path

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely
from pyproj import CRS
from scenes.fronts import elevation

from algorithms.planes.drawing import PlanesDrawing, rows_of
from toolbox.data import Vector
from toolbox.errors import DataError

UTM = CRS(32635)


def texts(frame: geopandas.GeoDataFrame, layer: str) -> list[str]:
    return frame.loc[(frame["layer"] == layer) & frame["text"].notna(), "text"].tolist()


def test_dimensions_are_those_of_the_wall() -> None:
    found = PlanesDrawing(elevation=elevation(), subject="Town hall").run()
    frame = found.drawing.frame
    assert texts(frame, "dimensions") == [
        *("1.00", "1.00", "2.00", "1.50", "4.50", "1, 2"),
        *("4.00", "1.50", "4.50", "3", "10.00"),
        *("2.10", "3.90", "6.00"),
    ]
    assert texts(frame, "levels") == ["0.00", "+2.10", "+1.00", "+2.50", "+4.00", "+5.00"]
    assert texts(frame, "numbers") == ["1", "2", "3", "Front 1"]
    assert texts(frame, "title")[:3] == [
        "Town hall",
        "Elevation of 1 front, outside",
        "Dimensions in m, rounded to 0.01 m",
    ]


def uneven() -> Vector:
    """The elevation with openings whose gaps would each be rounded away from their sum."""
    frame = elevation().frame
    holes = [shapely.box(k + 0.1147, 0.1147, k + 0.6294, 2.6294) for k in range(8)]
    frame = frame.iloc[[0, *[1] * len(holes)]].reset_index(drop=True)
    frame["opening_id"] = range(len(frame))
    return Vector(frame.set_geometry([shapely.box(0.003, 0.004, 8.2, 3.1), *holes]))


def test_dimensions_add_up_to_the_whole_and_to_those_of_the_table() -> None:
    """Places are rounded, not the distances between them."""
    found = PlanesDrawing(elevation=uneven(), unit="mm").run()
    said = texts(found.drawing.frame, "dimensions")
    row, whole = [int(text) for text in said[:17]], int(said[18])
    assert sum(row) == whole
    up = [int(text) for text in said[19:]]
    assert sum(up[:3]) == up[3]
    for number, one in enumerate(found.schedule.rows()):
        assert one["width_mm"] == row[2 * number + 1]
        assert one["left_mm"] == sum(row[: 2 * number + 1])
        assert (one["level_mm"], one["height_mm"]) == (up[0], up[1])


def test_every_row_of_openings_has_its_dimensions() -> None:
    """A window that reaches through two rows stands in the lower one."""
    boxes = np.array([[0, 0, 1, 2], [2, 1, 3, 4.5], [0, 3, 1, 4], [5, 3.2, 6, 4.2], [8, 9, 9, 10]])
    assert [row.tolist() for row in rows_of(boxes)] == [[0, 1], [2, 3], [4]]


def test_the_title_block_says_how_far_apart_the_points_are() -> None:
    layer = elevation()
    layer = Vector(layer.frame.assign(spacing=[0.052, *[np.nan] * 3]), name="elevation")
    for unit, says in (("m", "0.05 m"), ("mm", "52 mm")):
        frame = PlanesDrawing(elevation=layer, unit=unit).run().drawing.frame  # type: ignore[arg-type]
        assert texts(frame, "title")[-1] == f"Points {says} apart: no edge is surer than that"


def test_what_was_not_seen_is_crossed_out() -> None:
    """And an opening with a side that was not seen has a star, but no door for what is below it."""
    frame = elevation().frame
    assert "unseen" not in set(PlanesDrawing(elevation=elevation()).run().drawing.frame["layer"])
    frame["hidden"] = [None, "bottom", "", "left, top"]
    bare = geopandas.GeoDataFrame(
        {"kind": ["unseen"], "front_id": [1], "opening_id": [0]},
        geometry=[shapely.box(8, 3, 9, 5)],
        crs=frame.crs,
    )
    both = Vector(geopandas.GeoDataFrame(pd.concat([frame, bare], ignore_index=True)))
    out = PlanesDrawing(elevation=both).run()
    drawn = out.drawing.frame
    lines = drawn.loc[drawn["layer"] == "unseen"].geometry
    assert sorted(lines.length.round(3)) == [2.236, 2.236, 6.0]
    assert texts(drawn, "numbers") == ["1", "2", "3*", "Front 1"]
    assert "Crossed out: no point of the wall was seen there" in texts(drawn, "title")
    assert any(text.startswith("* some sides were not seen") for text in texts(drawn, "title"))
    assert out.schedule.rows()[-1]["opening_id"] == 3
    assert texts(drawn, "dimensions")[:5] == ["1.00", "1.00", "2.00", "1.50", "4.50"]


def test_areas_add_up_and_edges_are_no_surer_than_points_are_apart() -> None:
    """A part that was not seen counts once, also where it lies on an opening."""
    for crs, metre in (("local", 1.0), ("local:mm", 1000.0)):
        frame = elevation(crs, metre).frame
        frame["spacing"] = [0.052 * metre, *[np.nan] * 3]
        bare = geopandas.GeoDataFrame(
            {"kind": ["unseen"], "front_id": [1], "opening_id": [0]},
            geometry=[shapely.box(5, 1, 6.5, 2.5)],
            crs=frame.crs,
        )
        bare.geometry = bare.geometry.scale(metre, metre, origin=(0, 0))
        both = Vector(geopandas.GeoDataFrame(pd.concat([frame, bare], ignore_index=True)))
        out = PlanesDrawing(elevation=both).run()
        (row,) = out.areas.rows()
        assert row == {
            "front_id": 1,
            "gross_m2": 60.0,
            "openings_m2": 5.85,
            "wall_m2": 52.65,
            "unseen_m2": 1.5,
        }
        assert [row["edge_mm"] for row in out.schedule.rows()] == [52] * 3


def test_millimetres() -> None:
    found = PlanesDrawing(elevation=elevation(), unit="mm", rounding=0.005).run().drawing
    assert texts(found.frame, "dimensions")[10] == "10000"
    walls = found.frame[found.frame["layer"] == "walls"]
    assert walls.geometry.length.sum() == pytest.approx(32_000)
    assert found.crs is not None
    assert found.crs.axis_info[0].unit_name == "millimetre"


def test_the_schedule_is_in_millimetres_whatever_the_unit() -> None:
    for made in (elevation(), elevation("local:mm", 1000.0)):
        rows = PlanesDrawing(elevation=made).run().schedule.rows()
        names = ("kind", "left_mm", "width_mm", "height_mm", "sill_mm")
        assert [tuple(row[name] for name in names) for row in rows] == [
            ("door", 1000, 1000, 2100, 0),
            ("window", 4000, 1500, 1500, 1000),
            ("window", 4000, 1500, 1000, 4000),
        ]


def test_the_schedule_has_the_depth_in_millimetres_where_it_is_known(tmp_path: Path) -> None:
    for metre, crs in ((1.0, "local"), (1000.0, "local:mm")):
        made = elevation(crs, metre)
        frame = made.frame.copy()
        frame["set_back"] = np.where(frame["kind"] == "door", np.nan, 0.16358 * metre)
        frame["certainty"] = 0.9628956
        table = PlanesDrawing(elevation=Vector(frame)).run().schedule
        rows = list(table.rows())
        assert [row["set_back_mm"] for row in rows[1:]] == [164, 164]
        assert [row["certainty"] for row in rows] == [0.963] * 3
        table.save(tmp_path / f"{crs[-2:]}.csv")
        lines = (tmp_path / f"{crs[-2:]}.csv").read_text().splitlines()
        assert lines[1:] == [
            "1,1,door,1000,0,1000,2100,0,,0.963",
            "1,2,window,4000,1000,1500,1500,1000,164,0.963",
            "1,3,window,4000,4000,1500,1000,4000,164,0.963",
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
    assert sizes == {120, 200}
    assert not found.audit().errors


def test_another_layer_is_refused() -> None:
    other = Vector(geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)], crs=UTM))
    with pytest.raises(DataError, match=r"take that of planes\.openings"):
        PlanesDrawing(elevation=other).run()
