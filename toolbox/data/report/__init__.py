"""Reports: texts, tables, maps and views in one HTML file that needs no other file, or as PDF."""

from toolbox.data.report.blocks import Block, Figure, Head, Plot, Rows, Section
from toolbox.data.report.columns import COMMON, Column, column_of, guessed, unit_text
from toolbox.data.report.document import Report

__all__ = [
    "COMMON",
    "Block",
    "Column",
    "Figure",
    "Head",
    "Plot",
    "Report",
    "Rows",
    "Section",
    "column_of",
    "guessed",
    "unit_text",
]
