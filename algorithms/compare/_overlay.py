"""Overlay of the polygons of two layers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.compare._shapes import Shapes
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context

BLOCK = 1000  # polygons between two checks for cancellation
TOUCHED = 0.1  # of the smaller of two polygons: less overlap is what errors of outlines make

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Side(NamedTuple):
    """Polygons of one of the two layers, cut to the region that is compared.

    Attributes
    ----------
    shapes : array of shape (n,), polygons within the region
    pieces : array of shape (n,), the same without what an earlier polygon covers
    area : array of shape (n,), of the shapes
    inside : array of shape (n,), share of each polygon that lies within the region
    covering : indices of polygons that cover part of an earlier one
    """

    shapes: Shapes
    pieces: Shapes
    area: Array
    inside: Array
    covering: Indices

    @classmethod
    def of(cls, shapes: Shapes, region: Any, ctx: Context = QUIET) -> Side:
        """Cut polygons to a region, if there is one, and take overlaps within the layer apart."""
        whole = shapely.area(shapes)
        shapes = clipped(shapes, region, ctx.part(0.0, 0.5))
        area = shapely.area(shapes)
        pieces, covering = disjoint(shapes, ctx.part(0.5, 1.0))
        inside = np.divide(area, whole, out=np.zeros(len(area)), where=whole > 0)
        return cls(shapes, pieces, area, inside, covering)

    @property
    def total(self) -> float:
        """Area of all polygons together; overlaps count once."""
        return float(shapely.area(self.pieces).sum())

    @property
    def twice(self) -> float:
        """Area of the overlaps of polygons within the layer."""
        return max(0.0, float(self.area.sum()) - self.total) if len(self.covering) else 0.0


class Pairs(NamedTuple):
    """Intersections of polygons of two layers, sorted by first and second.

    Attributes
    ----------
    first, second : arrays of shape (m,), indices
    shape : array of shape (m,), the intersection
    area : array of shape (m,), above zero
    """

    first: Indices
    second: Indices
    shape: Shapes
    area: Array


class Overlay(NamedTuple):
    """Overlay of both layers.

    Attributes
    ----------
    pairs : of polygons
    exact : of pieces, whose areas add up
    covered, covered_reference : area of each polygon that the other layer covers
    commission, omission : what is left of each piece, of the polygons and of the reference
    """

    pairs: Pairs
    exact: Pairs
    covered: Array
    covered_reference: Array
    commission: Shapes
    omission: Shapes

    @classmethod
    def of(cls, own: Side, other: Side, ctx: Context = QUIET) -> Overlay:
        """Overlay of two layers; computed once for both uses where no layer overlaps itself."""
        pairs = meet(own.shapes, other.shapes, ctx.part(0.0, 0.3))
        own_whole, other_whole = not len(own.covering), not len(other.covering)
        onto = pairs if other_whole else meet(own.shapes, other.pieces, ctx.part(0.3, 0.4))
        back = pairs if own_whole else meet(own.pieces, other.shapes, ctx.part(0.4, 0.5))
        exact = pairs
        if not (own_whole and other_whole):
            exact = meet(own.pieces, other.pieces, ctx.part(0.5, 0.6))
        count, second_count = len(own.shapes), len(other.shapes)
        turned = np.lexsort([exact.first, exact.second])
        return cls(
            pairs,
            exact,
            np.bincount(onto.first, onto.area, count).astype(np.float64),
            np.bincount(back.second, back.area, second_count).astype(np.float64),
            remainder(own.pieces, exact.first, exact.second, other.pieces, ctx.part(0.6, 0.8)),
            remainder(
                other.pieces,
                exact.second[turned],
                exact.first[turned],
                own.pieces,
                ctx.part(0.8, 1.0),
            ),
        )


def belonging(own: Shapes, other: Shapes, region: Any) -> Shapes:
    """Polygons of another layer without the parts that belong to none of some polygons.

    A part belongs to a polygon if their overlap is at least TOUCHED of the smaller one, or if it is
    the part that overlaps the polygon most.

    Parameters
    ----------
    own, other : arrays of shape (n,) and (m,)
    region : what lies outside of it does not count; None for everywhere

    Returns
    -------
    array of shape (m,), with empty polygons where nothing is left
    """
    parts, owner = shapely.get_parts(other, return_index=True)
    inside = clipped(parts, region)
    pairs = meet(own, inside)
    smaller = np.minimum(shapely.area(own)[pairs.first], shapely.area(inside)[pairs.second])
    belongs = pairs.area >= TOUCHED * smaller
    order = np.lexsort([pairs.second, -pairs.area, pairs.first])
    belongs[order[np.unique(pairs.first[order], return_index=True)[1]]] = True
    chosen = np.unique(pairs.second[belongs])
    found = np.full(len(other), shapely.Polygon(), object)
    if len(chosen):  # of none, shapely does not give `out` back
        shapely.multipolygons(parts[chosen], indices=owner[chosen], out=found)
    return found


def clipped(shapes: Shapes, region: Any, ctx: Context = QUIET) -> Shapes:
    """Polygons cut to a region; empty where they lie outside."""
    if region is None:
        return shapes
    shapely.prepare(region)
    found = shapes.copy()
    cut = np.flatnonzero(~shapely.covers(region, shapes) & ~shapely.is_empty(shapes))

    def work(first: int, last: int) -> None:
        some = cut[first:last]
        found[some] = only_areas(shapely.intersection(shapes[some], region))

    in_blocks(work, len(cut), BLOCK, ctx)
    return found


def only_areas(shapes: Shapes) -> Shapes:
    """Shapes of an overlay without the lines and points in which polygons only touch."""
    mixed = shapely.get_dimensions(shapes) < 2
    shapes[mixed] = shapely.Polygon()
    for index in np.flatnonzero(
        shapely.get_type_id(shapes) == shapely.GeometryType.GEOMETRYCOLLECTION
    ):
        parts = shapely.get_parts(shapes[index])
        shapes[index] = shapely.multipolygons(parts[shapely.get_dimensions(parts) == 2])
    return shapes


def disjoint(shapes: Shapes, ctx: Context = QUIET) -> tuple[Shapes, Indices]:
    """Polygons without what earlier ones cover; together they cover the same area.

    Returns
    -------
    array of shape (n,), and the indices of those that have changed
    """
    pairs = meet(shapes, shapes, ctx, earlier=True)
    pieces = remainder(shapes, pairs.first, pairs.second, shapes)
    return pieces, np.unique(pairs.first)


def meet(one: Shapes, other: Shapes, ctx: Context = QUIET, *, earlier: bool = False) -> Pairs:
    """Intersections of the polygons of two layers that have an area in common.

    Parameters
    ----------
    one, other : arrays of shape (n,) and (m,)
    earlier : whether to take those pairs only whose second index is below the first
    """
    shapely.prepare(one)
    shapely.prepare(other)
    tree = shapely.STRtree(other)
    found: dict[int, Pairs] = {}

    def work(start: int, end: int) -> None:
        first, second = tree.query(one[start:end], predicate="intersects")
        first = first + start
        if earlier:
            first, second = first[second < first], second[second < first]
        shape = intersections(one[first], other[second])
        area = shapely.area(shape)
        keep = np.flatnonzero(area > 0)
        keep = keep[np.lexsort([second[keep], first[keep]])]
        found[start] = Pairs(first[keep], second[keep], shape[keep], area[keep])

    in_blocks(work, len(one), BLOCK, ctx)
    blocks = [found[start] for start in sorted(found)]
    if not blocks:
        none = np.empty(0, np.int64)
        return Pairs(none, none, np.empty(0, object), np.empty(0))
    return Pairs(*(np.concatenate(column) for column in zip(*blocks, strict=True)))


def intersections(one: Shapes, other: Shapes) -> Shapes:
    """The intersection of each pair of polygons; computed only where neither covers the other.

    That matters where a large polygon of many vertices holds many small ones.
    """
    found = np.empty(len(one), object)
    within, around = shapely.covers(other, one), shapely.covers(one, other)
    found[around] = other[around]
    found[within] = one[within]
    crossing = ~(within | around)
    found[crossing] = only_areas(shapely.intersection(one[crossing], other[crossing]))
    return found


def remainder(
    shapes: Shapes, first: Indices, second: Indices, other: Shapes, ctx: Context = QUIET
) -> Shapes:
    """Each polygon minus those of the other layer that it intersects.

    Parameters
    ----------
    shapes, other : arrays of shape (n,) and (m,)
    first, second : arrays of shape (k,), the pairs that meet, first rising
    """
    found = shapes.copy()
    met, starts = np.unique(first, return_index=True)
    ends = np.append(starts[1:], len(first))

    def work(start: int, end: int) -> None:
        some = met[start:end]
        cutters = np.array(
            [
                _together(other[second[a:b]])
                for a, b in zip(starts[start:end], ends[start:end], strict=True)
            ],
            object,
        )
        found[some] = only_areas(shapely.difference(shapes[some], cutters))

    in_blocks(work, len(met), BLOCK, ctx)
    return found


def _together(shapes: Shapes) -> Any:
    return shapes[0] if len(shapes) == 1 else shapely.union_all(shapes)
