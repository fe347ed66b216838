"""Outlines of water bodies as polygons, lines and vertices with their attributes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from algorithms.shared.lowest import cells_of
from algorithms.shoreline._cells import CellGrid, window
from algorithms.shoreline._hidden import hidden
from algorithms.shoreline._level import NINETY_FIVE
from algorithms.shoreline._returns import Returns
from algorithms.shoreline._shore import BAND, INSIDE, Shore, area_of, shore
from algorithms.shoreline._smooth import smooth_part
from algorithms.shoreline._surfaces import Water
from toolbox.context import QUIET, Context

Floats = NDArray[np.float64]
Row = dict[str, Any]


SPACINGS, LEAST_SMOOTHING = 2.0, 1.0  # of points, and m: zigzag that is taken out by itself
ALIKE = 20.0  # m of a shore along which errors are taken to be alike
COMMON = 0.5  # of them, which is alike along all of the shore: banks have one form


@dataclass(frozen=True)
class Outline:
    """The outline of a water body, with what its attributes are made of.

    Attributes
    ----------
    number : from 1, by size
    water : the body
    shore : its rings: of every part first the outer one, then its islands
    parts : for each part the numbers of its rings
    cells : in which it was found
    hidden : for each part the area beside it that crowns hide, in the unit of the data;
        empty until the parts are final
    """

    number: int
    water: Water
    shore: Shore
    parts: list[list[int]]
    cells: CellGrid
    hidden: Sequence[float] = ()

    @cached_property
    def polygons(self) -> list[shapely.Polygon]:
        """Polygons of the body, one for each of its separate areas, at the level of the water."""
        rings = [self._raised(ring) for ring in self.shore.rings]
        return [shapely.Polygon(rings[p[0]], [rings[k] for k in p[1:]]) for p in self.parts]

    @property
    def named(self) -> Water:
        """The body with the number and the area that layers and tables give."""
        return replace(self.water, number=self.number, area=sum(p.area for p in self.polygons))

    def _raised(self, ring: Floats) -> Floats:
        return np.column_stack([ring, self.water.level.at(ring)])

    def rows(self) -> Iterator[tuple[shapely.Polygon, Row]]:
        """Polygons with their attributes."""
        level, body, metre = self.water.level, self.water.body, self.cells.metre
        for polygon, part, beside in zip(self.polygons, self.parts, self.hidden, strict=True):
            sigma, length, is_open = (
                np.concatenate(v) for v in zip(*(self._sides(k) for k in part), strict=True)
            )
            at_shore = np.where(is_open, 0.0, length)
            total = max(float(at_shore.sum()), 1e-9)
            error = float(np.sqrt((sigma**2 * at_shore).sum() / total))
            alike = min(1.0, float(np.sqrt(ALIKE * metre / total)))
            # Below crowns all may be water, or nothing: that is no error of which some cancels out.
            of_area = error * total * float(np.hypot(COMMON, alike)) + beside / NINETY_FIVE
            yield (
                polygon,
                {
                    "body": self.number,
                    "level": round(level.height, 4),
                    "level_error": round(level.error, 4),
                    "level_interval": round(level.interval, 4),
                    "scatter": round(level.scatter, 4),
                    "slope": round(float(np.hypot(*level.gradient)), 6),
                    "area": round(polygon.area / metre**2, 2),
                    "area_error": round(of_area / metre**2, 2),
                    "hidden_area": round(beside / metre**2, 2),
                    "perimeter": round(polygon.length / metre, 2),
                    "open_length": round(float(length[is_open].sum()) / metre, 2),
                    "islands": len(part) - 1,
                    "uncertainty": round(error / metre, 3),
                    "density": round(self.cells.density * metre**2, 2),
                    "returned": round(body.lost, 3),
                    "darkness": round(body.dark, 3),
                    "evidence": body.evidence,
                },
            )

    def _sides(self, ring: int) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Standard deviation, length and whether it is an edge of the data, of each ring side."""
        xy, sigma, is_open = (
            getattr(self.shore, name)[ring] for name in ("rings", "sigma", "open")
        )
        length = np.hypot(*(np.roll(xy, -1, axis=0) - xy).T)
        return sigma, length, is_open & np.roll(is_open, -1)

    def lines(self) -> Iterator[tuple[shapely.LineString, Row]]:
        """Lines of the outline, each of one kind, with their attributes."""
        for part in self.parts:
            for place, k in enumerate(part):
                ring = self._raised(self.shore.rings[k])
                _, _, is_open = self._sides(k)
                for line, edge in _stretches(ring, is_open):
                    kind = "data edge" if edge else "island" if place else "shore"
                    yield (
                        shapely.LineString(line),
                        {
                            "body": self.number,
                            "kind": kind,
                            "level": round(self.water.level.height, 4),
                            "length": round(shapely.LineString(line).length / self.cells.metre, 2),
                        },
                    )

    def corners(self) -> Iterator[tuple[shapely.Point, Row]]:
        """Vertices of the outline, with their standard deviation across the shore."""
        for k in (ring for part in self.parts for ring in part):
            spots = np.asarray(shapely.points(self._raised(self.shore.rings[k])))
            for spot, sigma, edge in zip(
                spots, self.shore.sigma[k], self.shore.open[k], strict=True
            ):
                yield (
                    spot,
                    {
                        "body": self.number,
                        "sigma": round(float(sigma) / self.cells.metre, 3),
                        "data_edge": bool(edge),
                    },
                )


def _stretches(ring: Floats, edge: NDArray[np.bool_]) -> Iterator[tuple[Floats, bool]]:
    """Lines from a ring, cut where its sides change between shore and edge of the data."""
    changes = np.flatnonzero(edge != np.roll(edge, 1))
    if not len(changes):
        yield np.vstack([ring, ring[:1]]), bool(edge[0])
        return
    ring, edge = np.roll(ring, -changes[0], axis=0), np.roll(edge, -changes[0])
    ends = [*(changes - changes[0]), len(ring)]
    ring = np.vstack([ring, ring[:1]])
    for first, last in pairwise(ends):
        yield ring[first : last + 1], bool(edge[first])


def draw(
    points: Returns,
    cells: CellGrid,
    water: Sequence[Water],
    chosen: Sequence[int],
    least_area: float,
    least_island: float,
    smoothing: float | Literal["auto"],
    ctx: Context = QUIET,
) -> list[Outline]:
    """Outlines of the chosen bodies.

    Parameters
    ----------
    points, cells, water : see :func:`algorithms.shoreline._water.find_water`
    chosen : numbers of the bodies to draw
    least_area, least_island : smaller parts and islands are left out, square units of the data
    smoothing : length of zigzag that is taken out, in the unit of the data
    ctx : progress and cancellation
    """
    of_body = np.zeros(cells.low.size, np.int32)
    for k, one in enumerate(water, 1):
        of_body[one.body.cells] = k
    near, index, strip = _band(points, cells, [water[k] for k in chosen], ctx.part(0.0, 0.5))
    length = detail_of(cells) if smoothing == "auto" else smoothing
    found = []
    for done, k in enumerate(chosen):
        part = ctx.part(0.5 + 0.5 * done / len(chosen), 0.5 + 0.5 * (done + 1) / len(chosen))
        level = water[k].level
        above = np.column_stack([near[:, :2], near[:, 2] - level.shift(near[:, :2], strip)])
        made = shore(above, cells, index, water[k].body.cells, of_body, level, part)
        parts = _parts(made, least_area, least_island)
        smooth = _smoothed(made, parts, length)
        found.append(Outline(done + 1, water[k], smooth, parts, cells))
    ctx.progress(1.0)
    return [_beside_hidden(one, of_body) for one in _apart(found, least_area)]


def _beside_hidden(outline: Outline, of_body: NDArray[np.int32]) -> Outline:
    """An outline with the areas beside its parts that crowns hide."""
    water, parts = outline.water, shapely.force_2d(np.array(outline.polygons))
    squares = hidden(outline.cells, water.body.cells, of_body, water.level)
    area = np.zeros(len(parts))
    if len(squares):
        left = shapely.get_parts(shapely.union_all(squares).difference(shapely.union_all(parts)))
        left = left[~shapely.is_empty(left)]
        np.add.at(area, shapely.STRtree(parts).nearest(left), shapely.area(left))
    return replace(outline, hidden=area.tolist())


def detail_of(cells: CellGrid) -> float:
    """Length below which points do not tell how a shore runs, in the unit of the data."""
    return float(max(SPACINGS / np.sqrt(cells.density), LEAST_SMOOTHING * cells.metre))


def _apart(found: Sequence[Outline], least_area: float) -> list[Outline]:
    """Outlines that do not overlap: where two shores cross, the smaller body gives way."""
    apart: list[Outline] = []
    for outline in found:
        shape = shapely.union_all(shapely.force_2d(outline.polygons))
        others = [other for one in apart for other in shapely.force_2d(one.polygons)]
        covers = [other for other in others if shape.intersects(other)]
        if covers and shape.intersection(shapely.union_all(covers)).area > 0:
            left = shapely.get_parts(shape.difference(shapely.union_all(covers)))
            rest = sorted(left, key=lambda part: -part.area)
            kept = [part for k, part in enumerate(rest) if k == 0 or part.area >= least_area]
            apart.append(_redrawn(outline, kept))
        else:
            apart.append(outline)
    return apart


def _redrawn(outline: Outline, shapes: Sequence[shapely.Polygon]) -> Outline:
    """An outline with other polygons, whose corners are as sure as the nearest ones were."""
    old = cKDTree(np.concatenate(outline.shore.rings))
    sigma, is_open = (np.concatenate(getattr(outline.shore, name)) for name in ("sigma", "open"))
    rings: list[Floats] = []
    parts: list[list[int]] = []
    for shape in shapes:
        turned = shapely.geometry.polygon.orient(shape)
        corners = [shapely.get_coordinates(r)[:-1] for r in (turned.exterior, *turned.interiors)]
        parts.append(list(range(len(rings), len(rings) + len(corners))))
        rings += corners
    near = [old.query(ring)[1] for ring in rings]
    shore = Shore(rings, [sigma[k] for k in near], [is_open[k] for k in near])
    return replace(outline, shore=shore, parts=parts)


def _band(
    points: Returns, cells: CellGrid, water: Sequence[Water], ctx: Context
) -> tuple[Floats, NDArray[np.int64], NDArray[np.uint16]]:
    """Points near the edges of bodies, sorted by cell, and the cell and strip of each."""
    band = np.zeros(cells.low.shape, bool)
    square = np.ones((3, 3), bool)
    for one in water:
        (top, left), wet = window(cells.lattice, one.body.cells, BAND + 1)
        near = ndimage.binary_dilation(wet, square, iterations=BAND)
        near &= ~ndimage.binary_erosion(wet, square, iterations=INSIDE, border_value=1)
        band[top : top + wet.shape[0], left : left + wet.shape[1]] |= near
    found, index = [np.zeros((0, 3))], [np.zeros(0, np.int64)]
    strip = [np.zeros(0, np.uint16)]
    for some in points.blocks():
        xyz = points.xyz(some)
        at = cells_of(xyz, cells.lattice)
        use = band.ravel()[at]
        found.append(xyz[use])
        index.append(at[use].astype(np.int64))
        strip.append(points.strip[some][use])
        ctx.progress(some.stop / len(points))
    xyz, cell = np.concatenate(found), np.concatenate(index)
    order = np.lexsort((xyz[:, 2], xyz[:, 1], xyz[:, 0], cell))
    return xyz[order], cell[order], np.concatenate(strip)[order]


def _parts(made: Shore, least_area: float, least_island: float) -> list[list[int]]:
    """Indices of the rings of each polygon: outer ring, then islands; largest polygon first."""
    areas = np.array([area_of(ring) for ring in made.rings])
    outer = [k for k in np.argsort(-areas, kind="stable") if areas[k] > 0]
    outer = [k for rank, k in enumerate(outer) if rank == 0 or areas[k] >= least_area]
    shapes = [shapely.Polygon(made.rings[k]) for k in outer]
    parts = [[int(k)] for k in outer]
    islands = np.flatnonzero(-areas >= max(least_island, 1e-9))
    for k in islands[np.argsort(areas[islands], kind="stable")]:
        spot = shapely.Point(made.rings[k][0])
        holders = [n for n, shape in enumerate(shapes) if shape.contains(spot)]
        if holders:
            parts[min(holders, key=lambda n: shapes[n].area)].append(int(k))
    return parts


def _smoothed(made: Shore, parts: list[list[int]], length: float) -> Shore:
    """The shore with smoothed rings; along the edge of the data they stay as they are."""
    rings = list(made.rings)
    for part in parts if length else []:
        smooth = smooth_part([rings[k] for k in part], [made.open[k] for k in part], length)
        for k, ring in zip(part, smooth, strict=True):
            rings[k] = ring
    return replace(made, rings=rings)
