"""What is known of a roof: heights of its eave and ridge, and its form.

A building has one main roof and may have lower parts: annexes, balconies, porches, and walls, which
lie on planes as well. So points on planes as steep as walls are left out, and the rest is parted
into sections where the surface steps. Eave and form are those of the largest section.

References
----------
Vosselman, G. and Dijkman, S. (2001). 3D building model reconstruction from point clouds and ground
plans. ISPRS Archives 34(3/W4), 37-44: the directions of its faces tell the form of a roof.
OGC 12-019 (2012), CityGML 2.0, annex C: names of roof forms.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from toolbox.data import Lattice

STEEPEST = np.radians(75)  # mansards are that steep; walls are steeper
LEVEL = np.radians(10)  # of roofs that are called flat, at most: water must run off
FLAT, SLOPED = 2 / 3, 1 / 3  # shares of level points from which a roof is flat, and up to which not
SOME = 0.05  # share of the points that a face has, and dormers have not
SQUARE = 0.85  # share of its bounding rectangle that a roof with four hips covers
CELL = 1.0  # metres, of the cells in which sections are told apart
BY_SPACING = 1.5  # times the spacing of points: the same where they are sparse
STEP = 0.5  # metres, beyond what its slope explains, by which a surface steps
ROOF = 10.0  # square metres of a section that counts: dormers are smaller, and so are sheds

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]


class Roof(NamedTuple):
    """Points on planes of one roof, at least one.

    Attributes
    ----------
    xyz : array of shape (n, 3), in metres
    normal : of the plane around each, array of shape (n, 3); NaN where there is none
    """

    xyz: Floats
    normal: NDArray[np.floating[Any]]

    def select(self, some: Mask) -> Roof:
        """Some of the points."""
        return Roof(self.xyz[some], self.normal[some])

    @property
    def slope(self) -> Floats:
        """Slope of the planes in radians, array of shape (n,); 0 where there is none."""
        upright = np.abs(np.nan_to_num(self.normal[:, 2].astype(np.float64), nan=1.0))
        return np.asarray(np.arccos(np.minimum(upright, 1.0)))

    @property
    def no_walls(self) -> Mask:
        """True for points of planes less steep than walls, or for all if there are no others."""
        roof = self.slope <= STEEPEST
        return roof if roof.any() else np.ones(len(roof), bool)

    def without_walls(self) -> Roof:
        """Those points."""
        return self.select(self.no_walls)


class Section(NamedTuple):
    """The largest part of a roof that has no step within, and its points at the border.

    Attributes
    ----------
    roof : its points
    border : array of shape (n,), those at its border
    parts : number of the sections of the whole roof that are as large as roofs, at least this one
    """

    roof: Roof
    border: Mask
    parts: int

    @property
    def eave(self) -> float:
        """Height of the eave: a tenth of the border is lower, so that no gutter decides."""
        z = self.roof.xyz[:, 2]
        return float(np.percentile(z[self.border] if self.border.any() else z, 10))


class Sections(NamedTuple):
    """Pieces of a roof between the steps of its surface, in cells seen from above.

    Attributes
    ----------
    number : of the section of each cell, array of shape (rows, cols)
    areas : of each section, without empty cells, array of shape (m,), m²
    row, col : of the cell of each of n points, arrays of shape (n,)
    on_top : which points lie on the surface and not below it, array of shape (n,)
    """

    number: Ints
    areas: Floats
    row: Ints
    col: Ints
    on_top: Mask

    @property
    def of_points(self) -> Ints:
        """Number of the section of each point, -1 for those below the surface."""
        return np.where(self.on_top, self.number[self.row, self.col], -1)


def sections(roof: Roof, spacing: float) -> Sections:
    """Part a roof where its surface steps.

    Parameters
    ----------
    roof : points that are no walls
    spacing : metres between the points
    """
    cell = max(CELL, BY_SPACING * spacing)
    x, y, z = roof.xyz.T
    lattice = Lattice.cover((x.min(), y.min(), x.max(), y.max()), cell)
    row, col = lattice.indices(x, y)
    top, rise = np.full(lattice.shape, -np.inf), np.zeros(lattice.shape)
    np.maximum.at(top, (row, col), z)
    own = row * lattice.cols + col
    order = np.lexsort((roof.slope, own))
    first = np.flatnonzero(np.diff(own[order], prepend=-1))
    middle = order[(first + np.append(first[1:], len(own)) - 1) // 2]
    rise[row[middle], col[middle]] = cell * np.tan(np.minimum(roof.slope, STEEPEST))[middle]
    number = _without_step(top, STEP + rise)
    areas = np.bincount(number.ravel(), np.isfinite(top).ravel()).astype(np.float64) * cell**2
    return Sections(number, areas, row, col, z >= (top - STEP - rise)[row, col])


def main_section(roof: Roof, spacing: float) -> Section:
    """The largest section of a roof, seen from above.

    Parameters
    ----------
    roof : points that are no walls
    spacing : metres between the points
    """
    found = sections(roof, spacing)
    largest = found.areas.argmax()
    own = found.of_points == largest
    there = np.zeros(found.number.shape, bool)
    there[found.row, found.col] = True
    inner = binary_erosion(there & (found.number == largest), np.ones((3, 3), bool))
    count = int(np.count_nonzero(found.areas >= ROOF))
    return Section(roof.select(own), ~inner[found.row, found.col][own], max(count, 1))


def _without_step(top: Floats, step: Floats) -> Ints:
    """Number of the section of each cell: cells beside each other join without a step.

    Parameters
    ----------
    top : height of the cells, -inf where they are empty, array of shape (rows, cols)
    step : by which that of the next cell may differ, array of the same shape
    """
    number = np.arange(top.size).reshape(top.shape)
    pairs = []
    for one, other in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        with np.errstate(invalid="ignore"):  # of two empty cells
            joined = np.abs(top[one] - top[other]) <= np.minimum(step[one], step[other])
        pairs.append(np.stack([number[one][joined], number[other][joined]]))
    i, j = np.concatenate(pairs, axis=1)
    links = coo_array((np.ones(len(i), bool), (i, j)), shape=(top.size, top.size))
    _, section = connected_components(links, directed=False)
    return np.asarray(section.reshape(top.shape), np.int64)


def form(roof: Roof, outline: Any) -> str:
    """Form of a roof by the directions of its faces.

    Parameters
    ----------
    roof : points of its main section
    outline : shapely polygon

    Returns
    -------
    flat; monopitch, with one face; gable, with two that look away from each other; hip, with
    four around a rectangle; other; or unknown, if no point lies on a plane of its own
    """
    known = np.isfinite(roof.normal).all(axis=1)
    if not known.any():
        return "unknown"
    slope, normal = roof.slope[known], roof.normal[known]
    level = float(np.mean(slope <= LEVEL))
    if level >= FLAT:
        return "flat"
    if level > SLOPED:
        return "other"
    upward = normal[slope > LEVEL] * np.sign(normal[slope > LEVEL, 2:])
    towards = np.arctan2(upward[:, 1], upward[:, 0])
    main = np.angle(np.exp(4j * towards).sum()) / 4
    face = np.rint((towards - main) / (np.pi / 2)).astype(np.int64) % 4
    return _by_faces(np.bincount(face, minlength=4) / len(face) >= SOME, outline)


def _by_faces(there: Mask, outline: Any) -> str:
    """Form of a roof that has faces to some of four sides."""
    count = int(there.sum())
    if count == 1:
        return "monopitch"
    if count == 2 and there[0] == there[2]:
        return "gable"
    whole = shapely.minimum_rotated_rectangle(outline).area
    return "hip" if count == 4 and outline.area >= SQUARE * whole else "other"
