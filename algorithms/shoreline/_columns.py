"""Headings and units of the columns of waters, as reports show them."""

from __future__ import annotations

from algorithms.shared.water_columns import WATER
from toolbox.data.report import Column

VERTICES = {
    "body": WATER["body"],
    "sigma": Column("Standard deviation", "m", 2, never_zero=True),
    "data_edge": Column("Edge of the data"),
}
CURVE = {
    "level": Column("Level in the unit of its heights", "", 3),
    "unit": Column("Unit of heights"),
    "level_m": Column("Level", "m", 3),
    "area_m2": Column("Area", "m²", 0),
    "volume_m3": Column("Volume", "m³", 0),
    "area_low_m2": Column("Least area (95 %)", "m²", 0),
    "area_high_m2": Column("Greatest area (95 %)", "m²", 0),
    "volume_low_m3": Column("Least volume (95 %)", "m³", 0),
    "volume_high_m3": Column("Greatest volume (95 %)", "m³", 0),
    "area_gain_m2": Column("Gain of area", "m²", 0),
    "volume_gain_m3": Column("Gain of volume", "m³", 0),
    "apart_m2": Column(
        "Low ground that no water reaches yet",
        "m²",
        0,
        meaning="Ground of the basin below the level, but behind higher ground: it is in area and "
        "volume from the level on at which water gets there",
    ),
    "open": Column("Reaches the edge of the data"),
    "overtopped": Column("Above the rim of the lake"),
    "heights": Column("Heights"),
}
