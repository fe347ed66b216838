"""Headings and units of the columns of planes, fronts and openings, as reports show them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from toolbox.data.report import Column

if TYPE_CHECKING:
    import pandas as pd

SIDES = ("left", "bottom", "right", "top")
"""Of an opening, in the order of the bounds of a shape."""


def _by(*sides: str) -> dict[str, frozenset[str]]:
    """The sides that make a size of an opening a guess, where they are unsure or were not seen."""
    return {name: frozenset(sides) for name in ("unsure", "hidden")}


PLANES = {
    "plane_id": Column("Plane"),
    **{
        f"normal_{axis}": Column("", meaning=f"Normal of the plane, along {axis}") for axis in "xyz"
    },
    "offset": Column(
        "", "unit", meaning="Distance from the zero of the coordinates, along the normal"
    ),
    "height": Column("", "unit", meaning="Height in the middle of its points"),
    "tilt": Column("Tilt", "°", 1),
    "azimuth": Column("Azimuth", "°", 1),
    "rms": Column("Root mean square error", "unit", 3),
    "standard_error": Column("Standard error", "unit", 4, never_zero=True),
    "area": Column("Area", "unit²", 2),
    "length": Column("Length", "unit", 2),
    "width": Column("Width", "unit", 2),
    "lowest": Column("Lowest", "unit", 2),
    "highest": Column("Highest", "unit", 2),
    "points": Column("Points"),
    "front_id": Column("Front"),
    "relief": Column("Relief", "unit", 3),
}
FRONTS = {
    "front_id": Column("Front"),
    "planes": Column("Planes"),
    "azimuth": Column("Azimuth", "°", 1),
    "length": Column("Length", "unit", 2),
    "height": Column("Height", "unit", 2),
    "area": Column("Area with points", "unit²", 2),
    "relief_from": Column("Relief from", "unit", 3),
    "relief_to": Column("Relief to", "unit", 3),
}
DATA_EDGE = "data_edge"  # layer of drawings: an outline that is no edge of the wall
UNSEEN = "unseen"  # kind of a part of a front without points of its wall, and layer of drawings

OPENINGS = {
    "opening_id": Column("Opening"),
    "front_id": Column("Front"),
    "kind": Column("Kind"),
    "width": Column("Width", "unit", 2, circa=_by("left", "right")),
    "height": Column("Height", "unit", 2, circa=_by("bottom", "top")),
    "area": Column("Area", "unit²", 2, circa=_by(*SIDES)),
    "sill": Column("Sill above the foot", "unit", 2, circa=_by("bottom")),
    "set_back": Column("Set back", "unit", 2),
    "seen": Column("Points behind"),
    "edge_seen": Column("Edge seen", "%", 0, 100.0),
    "edge_interval": Column(
        "Least sure side ± (95 %)",
        "unit",
        2,
        meaning="± (95 %) of the least sure of the sides that were seen",
    ),
    "unsure": Column(
        "Unsure sides", meaning="Sides that were seen, at which the points of the wall end unevenly"
    ),
    "hidden": Column(
        "Sides not seen",
        meaning="Sides that were not seen: they may be elsewhere, and count in no interval",
    ),
    **{
        f"{side}_interval": Column("", "unit", meaning=f"Uncertainty of the {side} side (95 %)")
        for side in SIDES
    },
    "rectangle": Column("Rectangle"),
    "found_by": Column("Found by"),
    "certainty": Column("Certainty", "%", 0, 100.0),
}
DROPPED = {"front_id": OPENINGS["front_id"], "reason": Column("Why it is no opening")}
LOOKS = {  # of kinds; as drawings have them, so that windows are not doors on the map of a report
    "facade": ("Wall", "#b9a98c"),
    "window": ("Window", "#1f6fd0"),
    "door": ("Door", "#8c4a1c"),
    "door or window": ("Door or window", "#d9822b"),
    UNSEEN: ("Not seen", "#8a8a8a"),
}
_AXES = {
    "corner": ("unit", "Zero of the front's coordinates in space"),
    "right": ("", "Direction to the right in space"),
    "up": ("", "Direction upwards in space"),
}
ELEVATION = {
    **OPENINGS,
    "plane_id": Column("Plane"),
    "spacing": Column("Distance of points on the wall", "unit", 3),
    **{
        f"{name}_{axis}": Column("", unit, meaning=f"{text}, {axis}")
        for name, (unit, text) in _AXES.items()
        for axis in "xyz"
    },
}
SCHEDULE = {
    "front_id": OPENINGS["front_id"],
    "opening_id": OPENINGS["opening_id"],
    "kind": OPENINGS["kind"],
    "left_mm": Column("Left side from the left end of the front", "mm", 0, circa=_by("left")),
    "level_mm": Column("Sill above the lowest point of the front", "mm", 0, circa=_by("bottom")),
    "width_mm": Column("Width", "mm", 0, circa=OPENINGS["width"].circa),
    "height_mm": Column("Height", "mm", 0, circa=OPENINGS["height"].circa),
    "sill_mm": Column("Sill above the foot of the wall below it", "mm", 0, circa=_by("bottom")),
    "edge_mm": Column(
        "Edges ± (95 %)",
        "mm",
        0,
        meaning="± (95 %) of the least sure of the sides that are neither unsure nor not seen",
    ),
    "unsure": OPENINGS["unsure"],
    "unsure_mm": Column(
        "Unsure sides ± (95 %)", "mm", 0, meaning="± (95 %) of the least sure of the unsure sides"
    ),
    "hidden": OPENINGS["hidden"],
    "set_back_mm": Column("Set back", "mm", 0),
    "certainty": OPENINGS["certainty"],
}
AREAS = {
    "front_id": OPENINGS["front_id"],
    "gross_m2": Column("Within the outline", "m²", 2),
    "openings_m2": Column("Openings", "m²", 2),
    "wall_m2": Column("Wall", "m²", 2),
    "unseen_m2": Column("Not seen", "m²", 2),
}
DRAWING = {
    "layer": Column("Layer"),
    "text": Column("Text"),
    "angle": Column("Angle of the text, counterclockwise", "°", 1),
    "text_height": Column("Height of the text", "unit", 2),
    "shift": Column(
        "", meaning="Distance of a dimension's text above its line, in heights of the text"
    ),
    "anchor": Column("", meaning="left where the text begins at its point, else it is centred"),
    "about": Column("", meaning="What of the set stands there: title, client, date or number"),
}


def usual_interval(openings: pd.DataFrame) -> float:
    """Median uncertainty of the sides that were seen, in the unit of the data; NaN without any."""
    each = openings.reindex(columns=[f"{side}_interval" for side in SIDES]).to_numpy(float)
    known = each[np.isfinite(each)]
    return float(np.median(known)) if len(known) else math.nan
