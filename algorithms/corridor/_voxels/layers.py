"""What the voxels hold, and the layers of voxels, hull and towers."""

from __future__ import annotations

from dataclasses import dataclass

import geopandas
import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.corridor._voxels.growing import seeds_of
from algorithms.corridor._voxels.hull import Hull
from algorithms.corridor._voxels.voxels import Voxels
from toolbox.data import Vector

HULL_COLUMNS = ("hull_id", "faces", "volume")
TOWER_COLUMNS = ("tower_id", "points", "low", "top", "width", "length")

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Found:
    """What v voxels of points high above the ground hold.

    Attributes
    ----------
    kept : array of shape (v,), those whose variance is that of wires
    direction, share : see :func:`~algorithms.corridor._voxels.voxels.lines_in`
    group, tower : arrays of shape (v,), from 1, 0 for none
    bounds : array of shape (towers, 4), west, south, east and north, metres
    hull : of the wires
    """

    voxels: Voxels
    kept: Mask
    direction: Floats
    share: Floats
    group: Ints
    tower: Ints
    bounds: Floats
    hull: Hull

    def wires_down_to(self, height: float, far: Floats) -> int:
        """How many voxels of wires have a point no higher than this.

        Parameters
        ----------
        height : metres
        far : array of shape (n,), distance of the points to the ground, metres
        """
        least = np.full(len(self.group), np.inf)
        np.minimum.at(least, self.voxels.of_point, far)
        wire = (self.group > 0) & (self.tower == 0)
        return int(np.count_nonzero(wire & (least < height)))


@dataclass(frozen=True)
class Frame:
    """Where metres from a corner lie in the coordinates of the data.

    Attributes
    ----------
    corner : array of shape (3,), in the unit of the data
    metre : length of one metre in that unit
    """

    corner: Floats
    metre: float
    crs: CRS | None

    def place(self, xyz: Floats) -> Floats:
        """Coordinates in the data of positions of shape (..., 3), metres."""
        return np.asarray(xyz * self.metre + self.corner)


def voxel_layer(found: Found, frame: Frame) -> Vector:
    """One point per voxel at the centroid of its points, with all that is known of it."""
    voxels = found.voxels
    east, north, up = found.direction.T
    columns = {
        "voxel_id": np.arange(1, len(voxels.count) + 1),
        "points": voxels.count,
        "density": voxels.density,
        "variance": voxels.variance,
        "line_east": east,
        "line_north": north,
        "line_up": up,
        "line_share": found.share,
        "kept": found.kept,
        "seed": seeds_of(found.group, found.share, voxels.count),
        "group_id": found.group,
        "tower_id": found.tower,
    }
    places = shapely.points(frame.place(voxels.centroid))
    return Vector(
        geopandas.GeoDataFrame(columns, geometry=places, crs=frame.crs), geometry_type="Point Z"
    )


def hull_layer(hull: Hull, frame: Frame) -> Vector:
    """One feature per connected part of a hull, of the triangles around it."""
    rows, shapes = [], []
    for number, (faces, volume) in enumerate(hull.bodies(), start=1):
        rows.append((number, len(faces), volume))
        shapes.append(shapely.MultiPolygon([shapely.Polygon(f) for f in frame.place(faces)]))
    layer = geopandas.GeoDataFrame(rows, columns=HULL_COLUMNS, geometry=shapes, crs=frame.crs)
    return Vector(layer, geometry_type="MultiPolygon Z")


def tower_box_layer(bounds: Floats, xyz: Floats, tower: Ints, frame: Frame) -> Vector:
    """One rectangle per tower, its bounds in plan.

    Parameters
    ----------
    bounds : array of shape (towers, 4), metres
    xyz : array of shape (n, 3), metres
    tower : array of shape (n,), number of the tower of each point, from 1, 0 for none
    """
    rows, shapes = [], []
    for number, box in enumerate(bounds, start=1):
        z = frame.place(xyz[tower == number])[:, 2]
        low, top = (z.min(), z.max()) if len(z) else (np.nan, np.nan)  # inside smaller bounds
        sides = sorted(box[2:] - box[:2])
        rows.append((number, len(z), low, top, *sides))
        corners = np.array([[*box[:2], 0.0], [*box[2:], 0.0]])
        shapes.append(shapely.box(*frame.place(corners)[:, :2].ravel()))
    layer = geopandas.GeoDataFrame(rows, columns=TOWER_COLUMNS, geometry=shapes, crs=frame.crs)
    return Vector(layer, geometry_type="Polygon")
