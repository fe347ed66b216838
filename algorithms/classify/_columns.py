"""Headings and units of the columns of buildings and trees, as reports show them."""

from __future__ import annotations

from toolbox.data.report import Column

BUILDINGS = {
    "id": Column("Building"),
    "area": Column("Area", "unit²", 1),
    "perimeter": Column("Perimeter", "unit", 1),
    "points": Column("Points", meaning="Points on planes of the roof"),
    "ground": Column("Elevation of the ground", "unit", 2),
    "eave": Column(
        "Elevation of the eave",
        "unit",
        2,
        meaning="Elevation of the eave of the largest section of the roof",
    ),
    "ridge": Column("Elevation of the ridge", "unit", 2),
    "mean": Column("Mean elevation of the roof", "unit", 2),
    "height": Column("Height", "unit", 1),
    "form": Column("Form of the roof"),
    "confidence": Column(
        "Confidence",
        "%",
        0,
        100.0,
        meaning="Share of the points of a roof on its planes, less where ground is seen between "
        "them: 0 doubtful, 1 clear",
    ),
    "squared": Column("Right angles"),
    "sections": Column("Sections of the roof, between steps"),
    "parts": Column("Parts by height"),
    "cut": Column("Cut by the edge of the data"),
}
PARTS = {"id": Column("Part"), "building": Column("Building")} | {
    name: BUILDINGS[name]
    for name in ("area", "points", "ground", "eave", "ridge", "mean", "height", "form", "cut")
}
PARTS |= {"building_height": Column("Height of the building", "unit", 1)}
REFUSED = {
    "id": Column("Region"),
    "area": Column("Area", "unit²", 1),
    "points": Column("Points"),
    "ground": Column("Elevation of the ground", "unit", 2),
    "top": Column("Elevation of the highest point", "unit", 2),
    "height": Column("Height", "unit", 1),
    "cut": Column("Cut by the edge of the data"),
}
TREES = {
    "id": Column("Tree"),
    "height": Column("Height", "unit", 1, meaning="Above the ground below the top"),
    "elevation": Column(
        "Elevation of the top",
        "unit",
        2,
        meaning="Of the point highest above its ground: on uneven ground others may lie higher",
    ),
    "crown_area": Column("Area of the crown", "unit²", 1),
    "crown_diameter": Column("Diameter of the crown", "unit", 1),
    "points": Column("Points"),
    "cut": Column("Cut by the edge of the data"),
}
