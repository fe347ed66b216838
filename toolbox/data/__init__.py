"""Layers: points, rasters, vectors, tables and reports, in memory and in files."""

from toolbox.data.drawing import Drawing
from toolbox.data.lattice import Lattice
from toolbox.data.pointcloud import PointCloud
from toolbox.data.raster import Raster
from toolbox.data.report import Figure, Report, Rows, Section
from toolbox.data.survey import Survey, SurveyFile
from toolbox.data.table import Table
from toolbox.data.vector import Vector

__all__ = [
    "Drawing",
    "Figure",
    "Lattice",
    "PointCloud",
    "Raster",
    "Report",
    "Rows",
    "Section",
    "Survey",
    "SurveyFile",
    "Table",
    "Vector",
]
