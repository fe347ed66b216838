"""Lengths, texts and units of the drawing of a known front."""

from __future__ import annotations

import re
from pathlib import Path

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely
from pyproj import CRS
from scenes.fronts import elevation

from algorithms.planes._columns import SCHEDULE, SIDES
from algorithms.planes._labels import box_of
from algorithms.planes._sheet import edges_of, rows_of
from algorithms.planes.drawing import PlanesDrawing
from toolbox import language
from toolbox.data import Vector
from toolbox.data.plan import Plan
from toolbox.data.report import Rows
from toolbox.errors import DataError

UTM = CRS(32635)


def texts(frame: geopandas.GeoDataFrame, layer: str) -> list[str]:
    return frame.loc[(frame["layer"] == layer) & frame["text"].notna(), "text"].tolist()


def test_dimensions_are_those_of_the_wall() -> None:
    found = PlanesDrawing(elevation=elevation(), subject="Town hall", number="A-7").run()
    frame = found.drawing.frame
    assert texts(frame, "dimensions") == [
        *("1.00", "1.00", "2.00", "1.50", "4.50", "1, 2"),
        *("4.00", "1.50", "4.50", "3", "10.00"),
        *("2.10", "3.90", "6.00"),
    ]
    assert texts(frame, "levels") == ["0.00", "+2.10", "+1.00", "+2.50", "+4.00", "+5.00"]
    assert texts(frame, "numbers") == ["1", "2", "3", "Front 1, 0 = height 100.00 m of the points"]
    assert texts(frame, "title") == [
        *("Project", "Drawing", "Town hall", "Client", "Number", "A-7", "Date"),
        *("Scale", "1:50, A4", "Shows", "fronts from outside: 1"),
        *("Unit", "m, rounded to 0.01 m; levels above the lowest point of a front"),
        *("Source", "points of a laser scan"),
    ]


def test_a_set_fills_in_the_title_block() -> None:
    """Title and client were given on the command line, and were not in the drawing."""
    found = PlanesDrawing(elevation=elevation()).run()
    head = {"title": "Survey", "client": "The city", "date": "2026-11-24"}
    for layer in (found.drawing.with_head(head), found.plan.with_head(head)):
        said = texts(layer.frame, "title")
        assert [said[said.index(name) + 1] for name in ("Project", "Client", "Date")] == [
            *head.values()
        ]
    assert "The city" not in texts(found.drawing.frame, "title"), "the tool's own is as it was"


def test_what_nobody_told_is_no_field_or_stays_empty(tmp_path: Path) -> None:
    """The block had an empty field "Number"; and a place without its text is no point of a DXF.

    A set may tell the client later, so that there is a field for it.
    """
    import ezdxf

    found = PlanesDrawing(elevation=elevation()).run()
    said = texts(found.drawing.with_head({"title": "Survey"}).frame, "title")
    assert said[: said.index("Scale")] == [
        *("Project", "Survey", "Drawing", "Fronts of the building", "Client", "Date")
    ]
    found.drawing.save(tmp_path / "a.dxf")
    space = ezdxf.readfile(tmp_path / "a.dxf").modelspace()  # type: ignore[attr-defined]
    assert not space.query("POINT")


def test_a_set_in_another_language_has_its_title_block_in_it() -> None:
    found = PlanesDrawing(elevation=elevation(), unit="m", number="2.5", subject="Blok 1.2").run()
    with language.speaking("tr"):
        drawn = found.drawing.with_head({"title": "Client"}).frame
    said = texts(drawn, "title")
    assert {"Proje", "Ölçek", "Kaynak"} <= set(said)
    assert {"Client", "2.5", "Blok 1.2"} <= set(said), "what people have called it stays"
    numbers = [*texts(drawn, "dimensions"), *texts(drawn, "levels")]
    assert any("," in text for text in numbers)
    assert not any("." in text for text in numbers)
    assert not {"Project", "Scale", "Source"} & set(said)


def scaled(metre: float) -> Vector:
    frame = elevation().frame
    frame.geometry = frame.geometry.scale(metre, metre, origin=(0, 0))
    return Vector(frame)


def test_the_largest_scale_that_fits_a_sheet_is_taken() -> None:
    """Labels had 0.2 m: four times as high as a cornice of a metre, and dust on a palace."""
    for metre, scale, paper in (
        (0.1, 10, "A4"),
        (1, 50, "A4"),
        (1.5, 50, "A3"),
        (2.5, 50, "A2"),
        (4, 100, "A2"),
    ):
        found = PlanesDrawing(elevation=scaled(metre)).run()
        assert isinstance(found.plan, Plan)
        assert (found.plan.scale, found.plan.paper) == (scale, paper)
        high = found.drawing.frame["text_height"].max()
        assert high == pytest.approx(0.0025 * scale), "2.5 mm on paper"
    given = PlanesDrawing(elevation=elevation(), text_height=0.2).run().drawing.frame
    assert given["text_height"].max() == pytest.approx(0.2)


def test_the_drawing_fills_its_sheet_and_keeps_clear_of_the_title_block() -> None:
    """At 1:100 on A3 it took a third of it."""
    for metre in np.geomspace(0.3, 8.0, 12):
        frame = PlanesDrawing(elevation=scaled(float(metre))).run().drawing.frame
        parts = {
            name: shapely.box(*frame[frame["layer"].isin(layers)].total_bounds)
            for name, layers in {
                "sheet": ["frame"],
                "block": ["title"],
                "drawn": ["walls", "dimensions", "numbers"],
            }.items()
        }
        wide, high = np.ptp(np.reshape(parts["drawn"].bounds, (2, 2)), axis=0) / np.ptp(
            np.reshape(parts["sheet"].bounds, (2, 2)), axis=0
        )
        assert max(wide, high) > 0.55, metre
        assert parts["sheet"].contains(parts["drawn"])
        assert parts["sheet"].covers(parts["block"])
        assert not parts["block"].intersects(parts["drawn"])
        (east, south), (right, low) = (
            np.array(parts[name].bounds)[[2, 1]] for name in ("sheet", "block")
        )
        assert (right, low) == pytest.approx((east, south)), "in the lower right corner"


def narrow() -> Vector:
    """Openings 0.45 m wide, 0.15 m apart, of a wall 10 m long, in two rows."""
    holes = [
        shapely.box(x, y, x + 0.45, y + 0.6) for y in (0, 1.2) for x in 0.2 + 0.6 * np.arange(16)
    ]
    frame = elevation().frame.iloc[[0, *[1] * len(holes)]].reset_index(drop=True)
    frame["opening_id"] = range(len(frame))
    return Vector(frame.set_geometry([shapely.box(0, 0, 10, 6), *holes]))


def test_no_text_touches_another_or_a_stroke() -> None:
    """Those of narrow dimensions ran over their ends, and levels over numbers of openings."""
    frame = PlanesDrawing(elevation=narrow(), unit="mm").run().drawing.frame
    shown = frame[frame["text"].notna() & frame["layer"].isin(["dimensions", "levels", "numbers"])]
    boxes = []
    for row in shown.itertuples():
        xy = shapely.get_coordinates(row.geometry)
        x, y = xy.mean(axis=0)
        upright = len(xy) == 2 and abs(xy[0, 0] - xy[1, 0]) < 1e-6
        away = row.shift * row.text_height if len(xy) == 2 else 0.0
        x, y = (x - away, y) if upright else (x, y + away)
        box = box_of(row.text, x, y, row.text_height, angle=90.0 if upright else 0.0)
        boxes.append(box.buffer(-0.15 * row.text_height))
    tree = shapely.STRtree(boxes)
    one, other = tree.query(boxes, predicate="intersects")
    apart = one != other
    assert not shown["text"].iloc[one[apart]].tolist()
    lines = shown[shapely.get_dimensions(shown.geometry) == 1]
    shifts = set(lines["shift"].round(1))
    assert shifts > {0.8, -1.3}
    ends = shapely.points(shapely.get_coordinates(lines.geometry)).tolist()
    strokes = [end.buffer(0.5 * shown["text_height"].max()) for end in ends]
    assert not len(tree.query(strokes, predicate="intersects")[0])


def test_sides_that_were_not_seen_are_broken_lines() -> None:
    frame = elevation().frame
    frame["hidden"] = [None, "bottom", "left, top", ""]
    drawn = PlanesDrawing(elevation=Vector(frame)).run().drawing.frame
    broken = shapely.union_all(drawn.geometry[drawn["layer"] == "data_edge"])
    assert broken.equals(shapely.LineString([(4, 1), (4, 2.5), (5.5, 2.5)])), "no foot of a door"
    whole = shapely.union_all(drawn.geometry[drawn["layer"] == "openings"])
    assert whole.length == pytest.approx(6.2 + 3.0 + 5.0)


def test_a_part_not_seen_that_may_hide_a_door_says_so() -> None:
    frame = elevation().frame
    bare = geopandas.GeoDataFrame(
        {"kind": ["unseen"] * 3, "front_id": [1] * 3, "opening_id": [0] * 3},
        geometry=[shapely.box(7, 0.1, 8, 5.8), shapely.box(7, 3, 9, 5), shapely.box(9, 0, 9.5, 2)],
        crs=frame.crs,
    )
    both = Vector(geopandas.GeoDataFrame(pd.concat([frame, bare], ignore_index=True)))
    drawn = PlanesDrawing(elevation=both).run().drawing.frame
    assert texts(drawn, "unseen") == ["door?"]
    (place,) = drawn.geometry[drawn["text"] == "door?"]
    assert bare.geometry[0].contains(place)
    assert place.y < 2.5, "where doors are"


def test_a_sheet_is_printed_to_its_scale(tmp_path: Path) -> None:
    """A PDF of the size of the paper, in which 10 m at 1:50 are 200 mm."""
    found = PlanesDrawing(elevation=elevation(), subject="Town hall").run().plan
    found.save(tmp_path / "a.pdf")
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", (tmp_path / "a.pdf").read_bytes())
    assert box is not None
    assert [float(v) / 72 * 25.4 for v in box.groups()] == pytest.approx([297, 210], abs=0.1)
    (axes,) = found._sheet(()).axes
    across = np.ptp(axes.get_xlim())
    assert 297 / across == pytest.approx(1000 / 50)
    assert {"10.00", "Town hall"} <= {text.get_text() for text in axes.texts}
    (section,) = found.page_sections("Drawing", "To scale")
    assert section.title == "Drawing"


def test_the_outline_along_what_was_not_seen_is_no_edge_of_the_wall() -> None:
    frame = elevation().frame.assign(spacing=[0.05, *[np.nan] * 3])
    bare = geopandas.GeoDataFrame(
        {"kind": ["unseen"], "front_id": [1], "opening_id": [0]},
        geometry=[shapely.box(8, 3, 9.95, 6)],
        crs=frame.crs,
    )
    both = Vector(geopandas.GeoDataFrame(pd.concat([frame, bare], ignore_index=True)))
    drawn = PlanesDrawing(elevation=both).run().drawing.frame
    along, wall = (
        shapely.union_all(drawn.geometry[drawn["layer"] == name]) for name in ("data_edge", "walls")
    )
    assert along.length == pytest.approx(2.0 + 3.0, abs=0.2)
    assert along.length + wall.length == pytest.approx(32.0)
    assert along.bounds == pytest.approx((8, 3, 10, 6), abs=0.1)


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


def with_intervals(frame: geopandas.GeoDataFrame, metre: float = 1.0) -> geopandas.GeoDataFrame:
    """The openings with sides known to 21 mm, and the right side of the second to 300 mm."""
    sides = {f"{side}_interval": [None, *[0.021 * metre] * 3] for side in SIDES}
    frame = frame.assign(**sides, unsure=[None, "", "right", ""])
    frame["edge_interval"] = [None, 0.021 * metre, 0.3 * metre, 0.021 * metre]
    frame.loc[2, "right_interval"] = 0.3 * metre
    return frame


def test_the_title_block_says_how_sure_the_edges_are_as_the_report_does() -> None:
    layer = Vector(with_intervals(elevation().frame), name="elevation")
    for unit, says in (("m", "0.02 m"), ("mm", "21 mm")):
        out = PlanesDrawing(elevation=layer, unit=unit).run()  # type: ignore[arg-type]
        told = texts(out.drawing.frame, "title")
        assert f"edges of openings ± {says} (95 %, the median)" in told
        assert texts(out.drawing.frame, "numbers")[:3] == ["1", "2*", "3"]
        assert [row["edge_mm"] for row in out.schedule.rows()] == [21, 21, 21]
        assert [row["unsure_mm"] for row in out.schedule.rows()] == [None, 300, None]
        assert [row["unsure"] for row in out.schedule.rows()] == ["", "right", ""]
    broken = out.drawing.frame.query("layer == 'data_edge'").geometry
    assert len(broken) == 1
    frame = layer.frame.assign(left_interval=[None, 0.021, 0.021, 0.9])
    drawn = PlanesDrawing(elevation=Vector(frame)).run().drawing.frame
    assert "edges of openings ± 0.02 m (95 %, the median)" in texts(drawn, "title")


def vague() -> Vector:
    """The elevation whose first window has an unsure right side, and the upper one no seen top."""
    frame = with_intervals(elevation().frame)
    return Vector(frame.assign(hidden=[None, "", "", "top"]), name="elevation")


def test_dimensions_to_sides_that_are_unsure_or_not_seen_say_ca(tmp_path: Path) -> None:
    """They read as if they were as sure as the others; and CAD goes on measuring them."""
    import ezdxf

    found = PlanesDrawing(elevation=vague(), unit="m").run()
    frame = found.drawing.frame
    assert texts(frame, "dimensions")[:11] == [
        *("1.00", "1.00", "2.00", "ca. 1.50", "ca. 4.50", "1, 2"),
        *("4.00", "1.50", "4.50", "3", "10.00"),
    ]
    assert texts(frame, "levels") == ["0.00", "+2.10", "+1.00", "+2.50", "+4.00", "ca. +5.00"]
    assert "*, ca." in texts(frame, "title")
    with language.speaking("tr"):
        drawn = found.drawing.with_head({"title": "Ev"})
    assert "yak. 1,50" in texts(drawn.frame, "dimensions")
    assert "yak. +5,00" in texts(drawn.frame, "levels")
    said = texts(drawn.frame, "title")
    assert "*, yak." in said
    assert not [text for text in said if "see the schedule" in text], "it stayed English"
    for layer, says in ((found.drawing, "ca. <>"), (drawn, "yak. <>")):
        layer.save(tmp_path / f"{says[:2]}.dxf")
        space = ezdxf.readfile(tmp_path / f"{says[:2]}.dxf").modelspace()  # type: ignore[attr-defined]
        made = [one for one in space.query("DIMENSION") if one.dxf.text == says]
        assert [round(one.get_measurement(), 2) for one in made] == [1.5, 4.5]
        (shown,) = (p.text for p in made[0].virtual_entities() if p.dxftype() == "MTEXT")
        assert shown in ("ca. 1.50", "yak. 1,50")


def test_levels_of_the_openings_farthest_to_the_left_are_dimensions_that_say_ca() -> None:
    frame = elevation().frame.assign(unsure=[None, "top", "", ""])
    drawn = PlanesDrawing(elevation=Vector(frame)).run().drawing.frame
    assert texts(drawn, "dimensions")[-3:] == ["ca. 2.10", "ca. 3.90", "6.00"]


def test_the_schedule_says_ca_to_people_and_numbers_to_programs() -> None:
    table = PlanesDrawing(elevation=vague()).run().schedule
    rows = Rows(table, columns=SCHEDULE)
    names = [str(name) for name in rows.shown]
    told = [dict(zip(names, cells, strict=True)) for cells in rows.cells]
    assert [row["width_mm"] for row in told] == ["1000", "ca. 1500", "1500"]
    assert [row["height_mm"] for row in told] == ["2100", "1500", "ca. 1000"]
    assert [row["left_mm"] for row in told] == ["1000", "4000", "4000"]
    assert [row["width_mm"] for row in table.rows()] == [1000, 1500, 1500]


def test_an_opening_that_is_no_rectangle_is_broken_where_it_is_unsure() -> None:
    """Its outline was whole, though the title block and the report say unsure sides are broken."""
    frame = elevation().frame.assign(unsure=[None, "", "top", ""])
    slanted = shapely.Polygon([(4, 1), (5.5, 1), (5.5, 2.1), (5, 2.5), (4, 2.5)])
    frame.loc[2, "geometry"] = slanted
    drawn = PlanesDrawing(elevation=Vector(frame)).run().drawing.frame
    (broken,) = drawn.geometry[drawn["layer"] == "data_edge"]
    assert broken.equals(shapely.LineString([(5.5, 2.1), (5, 2.5), (4, 2.5)]))
    sure = drawn.geometry[drawn["layer"] == "openings"]
    assert len(sure) == len(frame) - 1, "each opening is there"
    assert any(line.equals(slanted.exterior - broken) for line in sure)


def test_a_side_that_no_edge_faces_is_broken_where_edges_end_at_it() -> None:
    """The sharp end of a gable's window, which is the first that is lost."""
    gable = edges_of(shapely.Polygon([(0, 0), (4, 0), (0, 1)]))
    assert gable["right"].equals(shapely.MultiLineString([[(0, 0), (4, 0)], [(4, 0), (0, 1)]]))
    assert gable["top"].equals(shapely.LineString([(4, 0), (0, 1)]))


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
    assert texts(drawn, "numbers")[:3] == ["1", "2", "3*"]
    crossed = "no point of the wall was seen there; openings may be hidden"
    assert crossed in texts(drawn, "title")
    assert any(text.startswith("some sides are unsure or were") for text in texts(drawn, "title"))
    assert out.schedule.rows()[-1]["opening_id"] == 3
    assert texts(drawn, "dimensions")[:5] == ["1.00", "1.00", "2.00", "1.50", "4.50"]


def test_areas_add_up() -> None:
    """A part that was not seen counts once, also where it lies on an opening."""
    for crs, metre in (("local", 1.0), ("local:mm", 1000.0)):
        frame = with_intervals(elevation(crs, metre).frame, metre)
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
        assert [row["edge_mm"] for row in out.schedule.rows()] == [21, 21, 21]


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


def test_sills_are_levels_less_the_foot_of_the_front() -> None:
    """Rounded by themselves, a sill of 1.004 m at the level of 1.006 m would be 10 mm lower."""
    frame = elevation().frame.copy()
    window = frame["opening_id"] == frame.loc[frame["kind"] == "window", "opening_id"].iloc[0]
    window &= frame["kind"] == "window"
    frame.loc[window, "geometry"] = frame.loc[window].translate(0, 0.006)
    frame.loc[window, "sill"] = 1.004
    rows = PlanesDrawing(elevation=Vector(frame), rounding=0.01).run().schedule.rows()
    assert [(row["level_mm"], row["sill_mm"]) for row in rows][1] == (1010, 1010)


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
    assert sizes == {90, 125}
    dimensions = list(found.modelspace().query("DIMENSION"))
    assert [round(one.get_measurement()) for one in dimensions][:2] == [1000, 1000]
    assert {one.dxf.layer for one in dimensions} == {"dimensions"}
    assert not found.audit().errors


def test_another_layer_is_refused() -> None:
    other = Vector(geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)], crs=UTM))
    with pytest.raises(DataError, match=r"take that of planes\.openings"):
        PlanesDrawing(elevation=other).run()
