"""Layers: points, rasters, vectors and tables, each with its CRS, in memory and in files."""

from toolbox.data.lattice import Lattice
from toolbox.data.pointcloud import PointCloud
from toolbox.data.raster import Raster
from toolbox.data.survey import Survey, SurveyFile
from toolbox.data.table import Table
from toolbox.data.vector import Vector

__all__ = ["Lattice", "PointCloud", "Raster", "Survey", "SurveyFile", "Table", "Vector"]
