"""Layers: points, rasters, vectors and tables, each with its CRS, read from and written to files."""

from toolbox.data.pointcloud import PointCloud
from toolbox.data.raster import Lattice, Raster
from toolbox.data.table import Table
from toolbox.data.vector import Vector

__all__ = ["Lattice", "PointCloud", "Raster", "Table", "Vector"]
