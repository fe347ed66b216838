"""Headings, units and looks of polygons and lines of water, as reports show them."""

from __future__ import annotations

from toolbox.data.report import Column

WATER = {
    "body": Column("Body"),
    "level": Column("Level", "unit", 3),
    "level_error": Column(
        "Standard error of the level within the survey",
        "unit",
        3,
        never_zero=True,
        meaning="Standard error of the level by the points of this survey alone; an error that all "
        "of its heights have in common comes on top",
    ),
    "level_interval": Column(
        "Uncertainty of the level within the survey (95 %)",
        "unit",
        3,
        never_zero=True,
        meaning="Half of the 95 % interval of the level by the points of this survey alone; an "
        "error that all of its heights have in common comes on top",
    ),
    "scatter": Column(
        "Scatter of returns",
        "unit",
        3,
        never_zero=True,
        meaning="Standard deviation of single returns from the level; empty where too few came "
        "back from the water to tell it",
    ),
    "slope": Column("Slope of the level", "", 6),
    "area": Column("Area", "m²", 0),
    "area_error": Column("Standard error of the area", "m²", 0, never_zero=True),
    "hidden_area": Column(
        "Hidden by crowns beside it",
        "m²",
        0,
        meaning="Between the outline and the first ground, where crowns hide what is below: it is "
        "not in the area, and the standard error of the area holds that all of it may be water",
    ),
    "perimeter": Column("Perimeter", "m", 0),
    "open_length": Column("Edge of the data in it", "m", 0),
    "islands": Column("Islands"),
    "uncertainty": Column("Standard error of the shore", "m", 2, never_zero=True),
    "density": Column("Last returns per area, on land in all the survey", "1/m²", 2),
    "returned": Column("Returns, of those on the shore", "%", 0, 100.0),
    "darkness": Column("Darkness against the shore, 0 to 1", "", 2),
    "evidence": Column("What tells that it is water"),
}
SHORELINE = {
    "body": WATER["body"],
    "kind": Column("Kind"),
    "level": WATER["level"],
    "length": Column("Length", "m", 1),
}
KNOWN = "known"  # kind of lines of water that was given
LOOKS = {
    "shore": ("shore", "#e08a00"),
    "island": ("island", "#00806b"),
    "data edge": ("edge of the data, no shore", "#c2185b"),
}
LOOKS_LAID = LOOKS | {KNOWN: ("known water, as it was given", "#5e35b1")}
