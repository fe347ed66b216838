"""Drawing of all fronts of a building: walls, openings, dimensions, title block."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import geopandas
import numpy as np
import pandas as pd
import shapely

from algorithms.planes import _columns as columns
from algorithms.planes._sheet import PENS, Sheet, rounded
from toolbox.context import QUIET, Context
from toolbox.data import Drawing, Table, Vector
from toolbox.data.plan import Plan
from toolbox.declare import outputs, param, sink, source, tool

NEEDED = ("kind", "front_id", "opening_id", "width", "height", "sill")
LETTERS = 2.5  # mm on paper, the lowest height of ISO 3098 for sheets up to A0
SHEETS = (  # scale and paper, from the largest scale; elevations smaller than 1:100 are no plans
    *((scale, paper) for scale in (10, 20) for paper in ("A4", "A3")),
    *((50, paper) for paper in ("A4", "A3", "A2")),
    *((100, paper) for paper in ("A4", "A3", "A2", "A1", "A0")),
    *((scale, "A0") for scale in (200, 500, 1000, 2000, 5000)),
)
SHOWN_DIGITS = 3  # of a certainty
MILLIMETRES = 1000.0  # in a metre
FRONTS = "Fronts of the building"


@tool(
    "planes.drawing",
    title="Drawing of fronts",
    tags=(
        "facade",
        "drawing",
        "dxf",
        "dimension",
        "elevation",
        "title-block",
        "window",
        "schedule",
    ),
)
class PlanesDrawing:
    """Draw all fronts with their openings, dimensions and a title block.

    Write it as .dxf: a layer each for walls, openings, dimensions, numbers and the title block, in
    metres or millimetres as asked. Parts of a front without points of its wall are crossed out on a
    layer of their own, `unseen`; `door?` stands in those that are as large as a door and as low. A
    star at the number of an opening tells that some of its sides are unsure, or were not seen and
    may be elsewhere: they are broken lines on the layer `data_edge`, of an opening that is no
    rectangle the edges that face these sides, and dimensions to them and their levels say "ca.".
    Broken is the outline along a part that was not seen, too, where it is no edge of the wall, but
    of the data.

    Below each front stand, row by row, the widths of the openings and the piers between them, with
    the numbers of the openings at its left, and its whole length; to the left sills and heads of
    the openings that are farthest to the left, and its whole height. Where a dimension is too
    narrow for its text, that stands below its line or above the others. In each opening, or beside
    it, stand its number and the levels of sill and head above the lowest point of the front. Places
    are rounded to `rounding` from the lower left corner of the front, so that dimensions add up. In
    a DXF all dimensions are entities that can be changed.

    The title block, in the lower right corner of the frame, has project, client and date of the set
    that the drawing is handed over with; the notes beside it say how sure the edges are.
    `plan` is the same on a sheet, to scale: the largest from 1:10 to 1:50 at which it fits A3, or
    A2 for 1:50, else 1:100 on as large a sheet as it needs, on A4 where that is enough. Labels are
    2.5 mm high there, unless `text_height` is given.

    The table lists the openings with place, width, height and sill in millimetres, front by front,
    with the figures of the drawing, and how sure the edges of each are. Of each
    front `areas` has the area within its outline, and what of it is openings, wall and not seen.
    """

    elevation: Vector = source("Elevation by planes.openings", label="Elevation of fronts")
    unit: Literal["m", "mm"] = param(
        "Unit of the drawing", default="m", words={"m": "Metres", "mm": "Millimetres"}
    )
    text_height: float | None = param(
        "Height of the labels; as it is 2.5 mm on the sheet unless given",
        default=None,
        unit="m",
        gt=0,
        le=100,
        label="Height of labels",
    )
    rounding: float = param(
        "Step to which dimensions are rounded", default=0.01, unit="m", gt=0, le=1, label="Rounding"
    )
    subject: str | None = param(
        "What is drawn, for the title block", default=None, label="Subject of the drawing"
    )
    number: str | None = param(
        "Number of the drawing, for the title block", default=None, label="Number of the drawing"
    )

    @outputs
    class Outputs:
        drawing: Vector = sink(
            "Walls, openings, dimensions and texts, with a layer each", columns=columns.DRAWING
        )
        plan: Drawing = sink("The drawing on a sheet; as a file it is to scale", label="Drawing")
        schedule: Table = sink(
            "Openings with the places and sizes of the drawing, which are rounded there",
            columns=columns.SCHEDULE,
            label="Schedule of openings",
        )
        areas: Table = sink(
            "Areas of each front, which add up", columns=columns.AREAS, label="Areas of fronts"
        )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The elevation is one of planes.openings."""
        if missing := [name for name in NEEDED if name not in self.elevation.names]:
            yield (
                "elevation",
                f"has no attribute {', '.join(missing)}; take that of planes.openings",
            )

    def halo(self) -> float:
        """Infinite, as all fronts are on one sheet."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PlanesDrawing.Outputs:
        """Draw it at the largest scale that fits its sheet."""
        ctx.progress(0.0)
        frame, metre = self.elevation.frame, self.elevation.metre
        for scale, paper in SHEETS:
            sheet = self._drawn(scale, paper)
            if sheet.fits:
                break
        drawing = sheet.layer(self.elevation)
        return self.Outputs(
            drawing=drawing,
            plan=Plan(
                self.subject or FRONTS,
                (),
                (),
                crs=drawing.crs,
                scale=scale,
                frame=drawing.frame,
                paper=paper,
                pens=PENS,
            ),
            schedule=schedule(frame, self.rounding, metre),
            areas=areas(frame, metre),
        )

    def _drawn(self, scale: int, paper: str) -> Sheet:
        """Draw front by front, then the frame with the title block, at a scale."""
        frame, metre = self.elevation.frame, self.elevation.metre
        mm = scale * metre / MILLIMETRES
        shown = 1 if self.unit == "m" else MILLIMETRES
        sheet = Sheet(paper, mm, self.text_height or LETTERS * mm, self.rounding, metre, shown)
        walls = frame[frame["kind"] == "facade"]
        for wall in walls.itertuples():
            here = frame[frame["front_id"] == wall.front_id]
            bare = here.loc[here["kind"] == columns.UNSEEN].geometry.tolist()
            sheet.front(wall, _openings(here), bare)
        if len(walls):
            head = [
                ("Project", "", "title"),
                ("Drawing", self.subject or FRONTS, "subject" if self.subject else None),
                ("Client", "", "client"),
                *([("Number", self.number, "number")] if self.number else []),
                ("Date", "", "date"),
                ("Scale", f"1:{scale}, {paper}", None),
            ]
            sheet.finish(head, self._notes(sheet, walls))
        return sheet

    def _notes(self, sheet: Sheet, walls: geopandas.GeoDataFrame) -> list[tuple[str, str]]:
        """What is drawn, in which unit, how exactly, and what its signs mean."""
        step = self.rounding / sheet.metre * sheet.shown
        there = {row["layer"] for row in sheet.rows}
        unit = self.unit
        said = [
            ("Shows", f"fronts from outside: {len(walls)}"),
            (
                "Unit",
                f"{unit}, rounded to {step:g} {unit}; levels above the lowest point of a front",
            ),
            ("Source", "points of a laser scan"),
        ]
        half = columns.usual_interval(_openings(self.elevation.frame))
        if math.isfinite(half):
            shown = f"{half / sheet.metre * sheet.shown:.{0 if unit == 'mm' else 2}f} {unit}"
            said.append(("Accuracy", f"edges of openings ± {shown} (95 %, the median)"))
        if columns.UNSEEN in there:
            said.append(("Crossed", "no point of the wall was seen there; openings may be hidden"))
        if columns.DATA_EDGE in there:
            said.append(("Broken", "end of the data, or a side that is unsure or was not seen"))
        if sheet.starred:
            said.append(("*, ca.", "some sides are unsure or were not seen: see the schedule"))
        return said


def _openings(frame: geopandas.GeoDataFrame) -> geopandas.GeoDataFrame:
    return frame[~frame["kind"].isin(["facade", columns.UNSEEN])]


def schedule(frame: geopandas.GeoDataFrame, step: float, metre: float) -> Table:
    """Table of the openings of an elevation, lengths in millimetres, in steps as in its drawing."""
    found = _openings(frame)
    places, foot = np.empty((len(found), 4)), np.empty(len(found))
    for number, front in frame[frame["kind"] != columns.UNSEEN].groupby("front_id"):
        here = (found["front_id"] == number).to_numpy()
        bounds, lowest = found.geometry.bounds[here], front.total_bounds[:2]
        places[here] = rounded(bounds, lowest, step)
        foot[here] = bounds["miny"] - lowest[1] - found["sill"][here]
    left, bottom, right, top = (places / metre * MILLIMETRES).round().astype("int64").T
    sill = places[:, 1] - np.round(foot / step) * step  # so that it and the foot are the level
    rows = pd.DataFrame(
        {
            "front_id": found["front_id"].astype("int64"),
            "opening_id": found["opening_id"].astype("int64"),
            "kind": found["kind"].astype(str),
            "left_mm": left,
            "level_mm": bottom,
            "width_mm": right - left,
            "height_mm": top - bottom,
            "sill_mm": (sill / metre * MILLIMETRES).round().astype("int64"),
        }
    )
    sure, unsure = (half / metre * MILLIMETRES for half in _least_sure(found))
    if sure.notna().any() or unsure.notna().any():
        rows["edge_mm"] = sure.round().astype("Int64")
    if "unsure" in found:
        rows["unsure"] = found["unsure"]
    if unsure.notna().any():
        rows["unsure_mm"] = unsure.round().astype("Int64")
    if "hidden" in found:
        rows["hidden"] = found["hidden"]
    if "set_back" in found:  # not known where nothing was seen in an opening
        back = found["set_back"].astype(float) / metre * MILLIMETRES
        rows["set_back_mm"] = back.round().astype("Int64")
    if "certainty" in found:
        rows["certainty"] = found["certainty"].astype(float).round(SHOWN_DIGITS)
    return Table(rows)


def _least_sure(openings: geopandas.GeoDataFrame) -> tuple[pd.Series[float], pd.Series[float]]:
    """Uncertainty of the least sure of the sides of each opening that are not unsure, and are.

    NaN where there is none.
    """
    each = openings.reindex(columns=[f"{side}_interval" for side in columns.SIDES]).astype(float)
    names = openings["unsure"] if "unsure" in openings else [""] * len(openings)
    vague = [[side in (said or "").split(", ") for side in columns.SIDES] for said in names]
    where = np.reshape(np.array(vague, bool), each.shape)
    return each.mask(where).max(axis=1), each.where(where).max(axis=1)


def areas(frame: geopandas.GeoDataFrame, metre: float) -> Table:
    """Table of the fronts of an elevation: openings, wall and what was not seen make up the whole.

    Square metres, rounded before they are summed.
    """
    rows = []
    for wall in frame[frame["kind"] == "facade"].itertuples():
        here = frame[frame["front_id"] == wall.front_id]
        openings = shapely.union_all(_openings(here).geometry)
        whole = shapely.union_all([wall.geometry, openings])
        unseen = shapely.union_all(here.geometry[here["kind"] == columns.UNSEEN])
        bare = shapely.intersection(unseen, whole) - openings
        parts = {"openings": openings, "wall": whole - openings - bare, "unseen": bare}
        sizes = {f"{name}_m2": round(part.area / metre**2, 2) for name, part in parts.items()}
        gross = round(sum(sizes.values()), 2)
        rows.append({"front_id": int(wall.front_id), "gross_m2": gross, **sizes})
    return Table(pd.DataFrame(rows, columns=list(columns.AREAS)))
