"""Terrain with level water: hydro-flattening.

References
----------
USGS (2024). Lidar Base Specification 2024 rev. A, hydro-flattening: water bodies are flat and
level, with the water surface at or just below the immediately surrounding terrain.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.shared.alignment import not_on
from algorithms.shared.heights import heights_problem
from algorithms.shared.polygons import cells_within
from algorithms.shared.water_columns import KNOWN, LOOKS_LAID, SHORELINE, WATER
from algorithms.shared.water_surface import LEVEL, SCATTER, SLOPE, as_number, surfaces
from algorithms.surface._beneath import Beneath, Wet, beneath, unseen
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, Raster, Vector
from toolbox.data.crs import own_unit, unit_of_heights, unit_of_lengths
from toolbox.declare import outputs, param, show, sink, source, tool

if TYPE_CHECKING:
    import geopandas

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
BODY, KIND, AREA, LENGTH = "body", "kind", "area", "length"  # attributes of water
EVIDENCE = "evidence"
INTERVAL = "level_interval"  # half of the 95 % interval of the level
COVERED = 0.5  # share of a found water: if more of it is known to be another one, it goes
NAMED = 10  # waters in one warning
EVEN = 0.01  # m: as far as heights of a map are written; a river falls by more
PLACES = 5  # that one warning names
NOISE = 0.1  # m: three standard deviations of airborne points, of 0.03 m
NO_SHORE = 1.0  # m below the water, as high as a wall: more than noise, waves and ditches explain


@tool(
    "surface.flatten_water",
    title="Flatten water",
    tags=("hydro-flattening", "water", "lake", "dtm", "level", "breakline", "shore"),
)
class SurfaceFlattenWater:
    """Lay water level into a terrain, with no shore lower than the water.

    Cells whose centre is in a polygon of water get its level: that of the attribute `level`, or of
    a `level` that is given for all. Cells beyond the shore that are joined to it over lower ground
    are raised to the level as far as `shore` from the water, so that noise and the spacing of
    points leave no ditch around a lake; what lies lower farther away, such as the land below a dam,
    stays. How many cells were raised, and by how much at most, is told. Empty cells between the
    water and the ground around it, none of them farther than `shore` from the water, get heights
    between both: the ground at a shore is known, though no point may be near.

    A river is not level: where the attribute `slope` is not 0, as `shoreline.extract` gives it with
    `sloped`, or a polygon has no level, its surface runs between the heights of its vertices. So do
    breaklines along both banks that fall downstream.

    What is known better, as outlines from a map or drawn by hand where none was found, comes as
    `known`: polygons with the attribute `level`, or without, with heights at their vertices. They
    are laid as they are. A found water that they cover by more than half goes, of another one the
    rest stays. What was laid is `laid`, in which known water is numbered after the found one, and
    `laid_shoreline` its outlines, if those of the found water are given as `shoreline`.

    A `surface` with objects on it, as of the highest points, gets the water, too: its cells on the
    water that are empty or lower have the height of the water, so that there is no hole where the
    pulses were lost. Bridges, boats and crowns above the water stay, and other empty cells, too.

    Below a bridge or in a sluice no ground is seen, or a few points that are on the water, and the
    terrain between them may lie below the water beside it. With `ground_count`, the number of
    points of the ground in each cell, lower cells that are joined to water are raised to it at any
    distance where less than half as many cells as on land hold such points; between two waters to
    the lower one. They are told, and given as `beneath`.
    """

    terrain: Raster = source("Raster of heights of the ground")
    water: Vector = source("Polygons of water", shapes="polygon")
    known: Vector | None = source(
        "Polygons of water that are known, with level or heights, in place of found ones",
        shapes="polygon",
        default=None,
        label="Known water",
    )
    shoreline: Vector | None = source(
        "Outlines of the water as lines, of which those of known water take the place",
        shapes="line",
        default=None,
        label="Outlines as lines",
    )
    surface: Raster | None = source(
        "Surface with objects on the same cells, into which the water is laid, too",
        default=None,
        label="Surface with objects",
    )
    ground_count: Raster | None = source(
        "Number of points of the ground in each cell of the terrain",
        default=None,
        label="Points of the ground in cells",
    )
    level: float | None = param(
        "Level of all water, in place of the attribute level of the polygons",
        default=None,
        unit="m",
        label="Level of the water",
    )
    shore: float = param(
        "How far from the water lower ground is raised to its level",
        default=5.0,
        unit="m",
        ge=0,
        le=100,
        label="Width of the shore",
    )
    contour_interval: float | None = param(
        "Height between contours; water whose level is less certain than that is told",
        default=None,
        unit="m",
        gt=0,
        label="Height between lines",
    )

    @outputs
    class Outputs:
        flattened: Raster = sink("The terrain with level water", label="Flattened terrain")
        surface_with_water: Raster | None = sink(
            "The surface with water where nothing stands above it", label="Surface with water"
        )
        laid: Vector = sink(
            "Polygons of the water that was laid",
            show=show.OfClass(9, number="body"),
            columns=WATER,
            listed=False,
        )
        laid_shoreline: Vector | None = sink(
            "Outlines of the water that was laid, as lines; of kind known where it was given",
            show=show.Classes(KIND, LOOKS_LAID),
            columns=SHORELINE,
            label="Outlines of water as lines",
            listed=False,
        )
        beneath: Vector = sink(
            "Places where water goes on and no ground is seen, as below bridges, with its level",
            label="Water below bridges",
            columns=WATER,
            listed=False,
        )
        filled: int = sink(
            "Empty cells of the surface that are water", unit="1", label="Filled cells"
        )
        raised: int = sink("Cells of the shore that were raised", unit="1", label="Raised cells")
        largest_raise: float = sink("By how much at most", unit="m", label="Largest raise")
        bodies: int = sink("Water bodies laid level", unit="1", label="Water bodies")

        def in_words(self) -> str:
            """What was done to the shore."""
            if not self.bodies:
                return "No water lies on the terrain: it is as it was."
            words = "The water is level, and no ground at its shore lies lower."
            if self.raised:
                unit, metres = unit_of_heights(self.flattened.crs) or ("m", 1.0)
                words = (
                    f"The water is level; {self.raised} cells of the shore were lower, and raised "
                    f"to it by at most {self.largest_raise / metres:.2f} {unit}."
                )
            rows = self.laid.frame.to_dict("records")
            if known := sum(row.get(EVIDENCE) == KNOWN for row in rows):
                area = self.laid.frame.geometry.area.sum() / self.flattened.metre**2
                own = own_unit(area, unit_of_lengths(self.flattened.crs), 2)
                words += (
                    f" The water that was laid has {area:.0f} m²{own} in all. Water bodies that "
                    f"were given as known: {known}; what is said of waters that were found, of "
                    "their area and their shores, counts what gave way to these, and not these."
                )
            if self._falls():
                words += " Rivers among it are not level: they fall downstream."
            if self.filled:
                words += (
                    f" {self.filled} cells of the surface in which nothing came back from the "
                    "water have its height, too."
                )
            return words

        def _falls(self) -> bool:
            """Whether the surface of some of the water is not level."""
            return any(
                as_number(row.get(SLOPE)) > 0
                if math.isfinite(as_number(row.get(LEVEL)))
                else not even
                for row, even in zip(
                    self.laid.frame.to_dict("records"),
                    _are_even(self.laid.frame.geometry.to_numpy(), self.flattened.metre),
                    strict=True,
                )
            )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The raster holds heights, and the level is known."""
        if text := heights_problem(self.terrain):
            yield "terrain", f"{self.terrain.name or 'the raster'} {text}"
        if self.surface:
            name = self.surface.name or "the raster"
            if text := heights_problem(self.surface):
                yield "surface", f"{name} {text}"
            elif text := not_on(Lattice.of(self.terrain), Lattice.of(self.surface)):
                yield "surface", f"{name} {text} of the terrain"
        if self.ground_count and (
            text := not_on(Lattice.of(self.terrain), Lattice.of(self.ground_count))
        ):
            yield "ground_count", f"{self.ground_count.name or 'the raster'} {text} of the terrain"
        if self.level is None and len(self.water) and not _tells_heights(self.water):
            yield (
                "level",
                f"must be given, as {self.water.name or 'the water'} has no attribute level, and "
                "no heights",
            )
        if self.known and (text := _unfit(self.known, Lattice.of(self.terrain).cell ** 2)):
            yield "known", f"{text} in {self.known.name or 'the layer'}"

    def halo(self) -> float:
        """Infinite, as ground may be joined to the shore along any way."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> SurfaceFlattenWater.Outputs:
        """Fill body by body."""
        heights = self.terrain.band().copy()
        before = heights.copy()
        lattice = Lattice.of(self.terrain)
        east, north = lattice.centres()
        reach = math.ceil(self.shore / lattice.cell)
        found, known = (
            [
                Wet(one.at, one.scatter, *cells_within(one.shape, lattice))
                for one in surfaces(layer, name)
            ]
            if layer
            else []
            for layer, name in ((self._found, "water"), (self.known, "known"))
        )
        bodies = found + known
        there = [body for body in bodies if len(body.rows)]
        self._tell_deep(known, before, lattice)
        self._tell_unsure()
        wet = np.zeros(heights.shape, bool)
        for body in there:
            wet[body.rows, body.cols] = True
        for number, (surface, _, rows, cols) in enumerate(there):
            ctx.progress(number / len(there))
            part = tuple(
                slice(max(0, k.min() - reach - 1), k.max() + reach + 2) for k in (rows, cols)
            )
            inside = np.zeros(heights[part].shape, bool)
            inside[rows - part[0].start, cols - part[1].start] = True
            level = surface(east[part[1]][None, :], north[part[0]][:, None])
            land = np.where(wet[part] & ~inside, np.inf, heights[part])  # other water is no shore
            filled = inside | shore_below(land, inside, level, reach)
            heights[part] = np.where(filled, level, heights[part])
            heights[part] = without_gaps(heights[part], inside, reach)
        raised = (heights != before) & ~wet & np.isfinite(before)
        rise = np.where(raised, heights - before, 0.0)
        most = float(rise.max(initial=0.0))
        self._tell_no_shore(rise, lattice)
        hidden = self._beneath(before, wet, there)
        for one in hidden:
            heights[one.rows, one.cols] = np.fmax(heights[one.rows, one.cols], one.level)
        beyond = (heights != before) & ~wet & ~raised & np.isfinite(before)
        self._tell_beneath(np.where(beyond, heights - before, 0.0), lattice)
        if closed := np.count_nonzero(np.isnan(before) & np.isfinite(heights) & ~wet):
            log.warning(
                "%d empty cells at shores have heights between water and ground, at most %g m from "
                "the water",
                closed,
                self.shore / self.terrain.metre,
            )
        if apart := len(bodies) - len(there):
            log.warning("%d of %d bodies of water hold no cell of the terrain", apart, len(bodies))
        if self.surface and min(heights.shape) > 1:  # of one row no slope is known
            self._tell_above_surface(heights - self.surface.band(), heights, wet, lattice)
        made = heights.astype(np.float32)
        top = self.surface.band() if self.surface else None
        return self.Outputs(
            flattened=Raster.from_lattice(
                made,
                lattice,
                crs=self.terrain.crs,
                descriptions=("terrain",),
                units=self.terrain.units[:1],
            ),
            laid=self._laid,
            laid_shoreline=self.shoreline and self._lines(self.shoreline),
            surface_with_water=self.surface and self._with_water(made, wet | raised | beyond),
            beneath=self._outlined(hidden, lattice),
            filled=0
            if top is None
            else int(np.count_nonzero((wet | raised | beyond) & np.isnan(top))),
            raised=int(np.count_nonzero(raised)),
            largest_raise=most,
            bodies=len(there),
        )

    def _beneath(self, heights: Array, wet: Mask, waters: Sequence[Wet]) -> list[Beneath]:
        """Places without ground that the waters go on over; none if it is not known where it is."""
        if not self.ground_count:
            return []
        few = unseen(self.ground_count.band(), wet)
        return list(beneath(heights, few, waters, Lattice.of(self.terrain).centres()))

    def _tell_beneath(self, rise: Array, lattice: Lattice) -> None:
        """Log how much of the terrain was below water that goes on there, and where."""
        if count := np.count_nonzero(rise):
            log.warning(
                "%d cells of the terrain lay below the water that they are joined to, by up to "
                "%.2f %s at %.1f,%.1f, and hardly any ground was seen there, as below a bridge or "
                "in a sluice: they have its level, the lower one between two waters; where there "
                "is land below the water, it is lost",
                count,
                *self._most(rise, lattice),
            )

    def _most(self, rise: Array, lattice: Lattice) -> tuple[float, str, float, float]:
        """The largest rise with its unit, and where it is."""
        unit, _ = unit_of_heights(self.terrain.crs) or ("m", 1.0)
        row, col = np.unravel_index(rise.argmax(), rise.shape)
        east, north = lattice.centres()
        return float(rise.max()), unit, float(east[col]), float(north[row])

    def _outlined(self, hidden: Sequence[Beneath], lattice: Lattice) -> Vector:
        """Places below which water goes on as polygons of cells, with level and scatter."""
        import geopandas

        east, north = lattice.centres()
        half = lattice.cell / 2
        shapes = [
            shapely.union_all(
                shapely.box(
                    east[one.cols] - half,
                    north[one.rows] - half,
                    east[one.cols] + half,
                    north[one.rows] + half,
                )
            )
            for one in hidden
        ]
        rows = {
            LEVEL: [float(one.level.min()) for one in hidden],
            SCATTER: [one.scatter for one in hidden],
        }
        frame = geopandas.GeoDataFrame(rows, geometry=shapes, crs=self.terrain.crs)
        return Vector(frame.explode(ignore_index=True), geometry_type="Polygon")

    def _tell_above_surface(
        self, above: Array, heights: Array, wet: Mask, lattice: Lattice
    ) -> None:
        """Log where the terrain is above all points of a cell, by more than it falls within it.

        Ground was not seen there, and what is between its points is lower than they are.
        """
        south, east = np.gradient(heights)
        within = (abs(south) + abs(east)) / 2 + NOISE * self.terrain.metre
        rise = np.where(~wet & (above > np.nan_to_num(within, nan=math.inf)), above, 0.0)
        if count := np.count_nonzero(rise):
            unit, _ = unit_of_heights(self.terrain.crs) or ("m", 1.0)
            x, y = lattice.centres()
            first = np.argsort(-rise, axis=None, kind="stable")[: min(count, PLACES)]
            places = zip(*np.unravel_index(first, rise.shape), strict=True)
            log.warning(
                "cells in which the terrain lies above all points, by more than it falls within a "
                "cell, so that objects have heights below 0: %d; no ground was seen there, as "
                "beside walls, quays and bridges, and the terrain spans what is lower: %s",
                count,
                "; ".join(f"{rise[r, c]:.2f} {unit} at {x[c]:.1f},{y[r]:.1f}" for r, c in places),
            )

    def _tell_no_shore(self, rise: Array, lattice: Lattice) -> None:
        """Log where ground was raised by more than a shore is lower: the water may be none."""
        _, metres = unit_of_heights(self.terrain.crs) or ("m", 1.0)
        if deep := np.count_nonzero(rise * metres > NO_SHORE):
            log.warning(
                "%d cells beside water were raised by more than %g m, by up to %.2f %s at "
                "%.1f,%.1f: so low ground is no shore, and the water there may be none, or held by "
                "a dam that is narrower than the cells",
                deep,
                NO_SHORE,
                *self._most(rise, lattice),
            )

    def _tell_unsure(self) -> None:
        """Log water that may stand on the other side of a contour than its shore shows."""
        found = self._laid.frame
        if self.contour_interval is None or INTERVAL not in found:
            return
        unsure = found[2 * found[INTERVAL] > self.contour_interval].sort_values(INTERVAL)
        if len(unsure):
            unit, _ = unit_of_heights(self.terrain.crs) or ("m", 1.0)
            place, worst = unsure.geometry.iloc[-1].representative_point(), unsure.iloc[-1]
            log.warning(
                "%d water bodies have a level that is less certain (95 %%) than contours are "
                "apart, so that lines there may be of another height: that of the least certain "
                "one, at %.1f,%.1f, is %.2f ± %.2f %s",
                len(unsure),
                place.x,
                place.y,
                worst[LEVEL],
                worst[INTERVAL],
                unit,
            )

    def _tell_deep(self, bodies: Sequence[Wet], heights: Array, lattice: Lattice) -> None:
        """Log where water is far below the ground that was there: its level may be wrong."""
        unit, metres = unit_of_heights(self.terrain.crs) or ("m", 1.0)
        (east, north), deep = lattice.centres(), [0.0]
        for surface, _, rows, cols in bodies:
            below = heights[rows, cols] - surface(east[cols], north[rows])
            if np.isfinite(below).any() and np.nanmedian(below) * metres > NO_SHORE:
                deep.append(float(np.nanmedian(below)))
        if len(deep) > 1:
            log.warning(
                "%d known waters lie more than %g m below the ground that was there, half of "
                "their cells by up to %.2f %s: between high banks it is so; else their level is in "
                "another unit or height system",
                len(deep) - 1,
                NO_SHORE,
                max(deep),
                unit,
            )

    def _with_water(self, terrain: NDArray[np.float32], laid: Mask) -> Raster:
        """The surface, nowhere below the water and the shore that was raised to it."""
        assert self.surface is not None
        top = self.surface.band()
        top = np.where(laid, np.fmax(top, terrain), top)
        return Raster.from_lattice(
            top.astype(np.float32),
            Lattice.of(self.surface),
            crs=self.surface.crs,
            descriptions=self.surface.descriptions[:1],
            units=self.surface.units[:1],
        )

    @cached_property
    def _found(self) -> Vector:
        """The water that was found, at the given level, without what is known to be another one."""
        found, kind = self.water.frame, self.water.geometry_type
        if self.level is not None:
            found = found.assign(**{LEVEL: self.level, SLOPE: 0.0})
        if self.known and len(found):
            found, kind = self._without_known(found, self.known.frame), "Polygon Z"
        return Vector(found, name=self.water.name, geometry_type=kind)

    def _without_known(
        self, found: geopandas.GeoDataFrame, known: geopandas.GeoDataFrame
    ) -> geopandas.GeoDataFrame:
        """The found waters without those that are mostly known ones, and without parts of these."""
        every = shapely.union_all(shapely.force_2d(known.geometry.to_numpy()))
        shapes = found.geometry.to_numpy()
        shared = shapely.area(shapely.intersection(shapes, every))
        gone = shared > COVERED * shapely.area(shapes)
        if np.any(gone):
            log.warning(
                "%d of %d found waters give way to known ones%s",
                np.count_nonzero(gone),
                len(found),
                _numbers(found[gone]),
            )
        if np.any(cut := ~gone & (shared > Lattice.of(self.terrain).cell ** 2)):
            log.warning(
                "known water is cut out of %d found waters, whose attributes are of all of them%s",
                np.count_nonzero(cut),
                _numbers(found[cut]),
            )
        rest = found.set_geometry(np.where(cut, shapely.difference(shapes, every), shapes))
        return rest[~gone]

    @cached_property
    def _laid(self) -> Vector:
        """The water that is laid: what was found, and what is known, numbered after it."""
        if not self.known:
            return self._found
        known, metre = self.known.frame.assign(**{EVIDENCE: KNOWN}), self.terrain.metre
        shapes = known.geometry.to_numpy()
        if BODY in self.water.names:
            last = int(self.water.frame[BODY].max()) if len(self.water) else 0
            known[BODY] = np.arange(last + 1, last + 1 + len(known))
            known[AREA] = shapely.area(shapes) / metre**2
        tops = [shapely.get_coordinates(shape, include_z=True)[:, 2].mean() for shape in shapes]
        levels = known[LEVEL] if LEVEL in known else [None] * len(known)
        known[LEVEL] = [
            as_number(level) if math.isfinite(as_number(level)) else top if even else math.nan
            for level, top, even in zip(levels, tops, _are_even(shapes, metre), strict=True)
        ]
        return Vector.concat([self._found, Vector(known)])

    def _lines(self, shoreline: Vector) -> Vector:
        """Outlines of what was laid: those of found water where it stays, then of known water."""
        found, metre = shoreline.frame, self.terrain.metre
        if not self.known:
            return shoreline
        laid = self._laid.frame
        known = laid[laid[EVIDENCE] == KNOWN]
        every = shapely.union_all(shapely.force_2d(known.geometry.to_numpy()))
        found = found[found[BODY].isin(laid[BODY])]
        found = found.set_geometry(shapely.difference(found.geometry.to_numpy(), every))
        rings = known.set_geometry(shapely.boundary(known.geometry.to_numpy()))
        rings = rings.assign(**{KIND: KNOWN})[[BODY, KIND, LEVEL, rings.geometry.name]]
        both = Vector.concat([Vector(found), Vector(rings)]).frame.explode(ignore_index=True)
        both = both[~both.geometry.is_empty]
        both[LENGTH] = np.round(both.geometry.length / metre, 2)
        return Vector(both, geometry_type="LineString Z")


def _numbers(waters: geopandas.GeoDataFrame) -> str:
    """Text on the numbers of the first of some waters, if they have some."""
    if BODY not in waters:
        return ""
    numbers = [str(number) for number in waters[BODY].unique()]
    more = ", ..." if len(numbers) > NAMED else ""
    return f": water body {', '.join(numbers[:NAMED])}{more}"


def _are_even(shapes: Sequence[shapely.Polygon], metre: float) -> list[bool]:
    """Whether the vertices of polygons have one height, to a centimetre as levels are told."""
    heights = [shapely.get_coordinates(shape, include_z=True)[:, 2] for shape in shapes]
    return [bool(np.ptp(z) <= EVEN * metre) for z in heights]


def _unfit(known: Vector, least: float) -> str:
    """Why polygons cannot be laid as water, with the row from 1; "" if they can.

    Parameters
    ----------
    least : area by which two may overlap, as where one was drawn beside the other
    """
    shapes = known.frame.geometry.to_numpy()
    levels = known.frame[LEVEL] if LEVEL in known.names else [None] * len(shapes)
    for row, (shape, level) in enumerate(zip(shapes, levels, strict=True), 1):
        if not shapely.is_valid(shape):
            return f"row {row} is no valid polygon ({shapely.is_valid_reason(shape)})"
        tops = shapely.get_coordinates(shape, include_z=True)[:, 2]
        if not (math.isfinite(as_number(level)) or np.isfinite(tops).all()):
            return f"row {row} has no number in the attribute level, and no heights"
    pairs = shapely.STRtree(shapes).query(shapes, predicate="intersects").T
    for one, other in pairs[pairs[:, 0] < pairs[:, 1]].tolist():
        if shapely.area(shapely.intersection(shapes[one], shapes[other])) > least:
            return f"rows {one + 1} and {other + 1} overlap, and one place has one level"
    return ""


def _tells_heights(water: Vector) -> bool:
    """Whether polygons have levels, or heights at their vertices."""
    return LEVEL in water.names or bool(shapely.has_z(water.frame.geometry.to_numpy()).all())


def shore_below(heights: Array, water: Mask, level: Array, reach: int) -> Mask:
    """The cells outside the water that lie lower than it and are joined to it within some cells.

    Parameters
    ----------
    heights : array of shape (rows, cols), NaN where not known
    water : its cells
    level : height of its surface at each cell
    reach : cells from the water that are looked at
    """
    from scipy.ndimage import binary_dilation

    lower = (heights < level) & ~water
    eight = np.ones((3, 3), bool)
    return (
        binary_dilation(water, eight, iterations=reach, mask=water | lower) & lower
        if reach
        else lower & False
    )


def without_gaps(heights: Array, water: Mask, reach: int) -> Array:
    """Heights in which the empty cells of a shore lie between the water and the ground.

    Parameters
    ----------
    heights : array of shape (rows, cols), NaN where not known
    water : its cells, which have heights
    reach : cells from the water within which all cells of a gap must lie

    Examples
    --------
    >>> heights = np.tile([5.0, 5.0, np.nan, 7.0, 7.0], (5, 1))
    >>> heights[[0, -1], 2] = 6.0
    >>> without_gaps(heights, heights == 5.0, 1)[2]
    array([5., 5., 6., 7., 7.])
    """
    from scipy import ndimage
    from scipy.interpolate import LinearNDInterpolator

    eight = np.ones((3, 3), bool)
    gaps, count = ndimage.label(~np.isfinite(heights), eight)
    if not count or not reach:
        return heights
    near = ndimage.binary_dilation(water, eight, iterations=reach)
    edges = (gaps[[0, -1]], gaps[:, [0, -1]], gaps[~near])  # where a gap goes on
    open_ = np.unique(np.concatenate([edge.ravel() for edge in edges]))
    beside = np.unique(gaps[ndimage.binary_dilation(water, eight)])
    closed = np.isin(gaps, np.setdiff1d(beside, open_))
    if not closed.any():
        return heights
    around = ndimage.binary_dilation(closed, eight) & np.isfinite(heights)
    between = LinearNDInterpolator(np.argwhere(around), heights[around])
    made = heights.copy()
    made[closed] = between(np.argwhere(closed))
    return made
