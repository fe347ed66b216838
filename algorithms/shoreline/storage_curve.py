"""Storage curves: area and volume of the water in a basin at each level.

The rules, and how exact the figures are: docs/explanation/storage-curves.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Literal

import geopandas
import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.shared import parameters
from algorithms.shared.alignment import not_on
from algorithms.shared.ground import without_withheld
from algorithms.shared.heights import heights_problem
from algorithms.shared.lowest import require_finite
from algorithms.shared.polygons import cells_within, polygons
from algorithms.shoreline import _basin_kernels as kernels
from algorithms.shoreline import _columns as columns
from algorithms.shoreline._basin_pieces import BLOCK, Pieces
from algorithms.shoreline._basin_points import PointBasin
from algorithms.shoreline._basin_raster import RasterBasin, Spill
from algorithms.shoreline._level import NINETY_FIVE
from toolbox.context import QUIET, Context, log, setting_name
from toolbox.data import Lattice, PointCloud, Raster, Table, Vector
from toolbox.data.crs import vertical_unit
from toolbox.data.report import Column
from toolbox.declare import ClassList, Position, outputs, param, show, sink, source, tool
from toolbox.errors import DataError, NothingToDo

Array = NDArray[np.float64]
MOST_LEVELS = 10_000  # more are taken for a mistake in the step: no table is read that far
FEWEST_LEVELS = 10  # a curve of fewer steps is drawn as a few straight lines
DIGITS = 9  # of a level after the point, so that three times 0.1 is 0.3
ROUNDING = 1e-9  # steps
GROUND = 2  # class
OVERTOPPED = "overtopped"  # column of the curve of a lake
DISTANCE = "distance to the nearest point"  # description of a band, as surface.grid writes it
# Of the median distance to a ground point: points that lie at random are 0.47 spacings from half of
# all places, and farther than 1.4 spacings from one in 500.
FAR = 3.0
FALL = 0.3  # metres that water must fall behind a rim: roughness of ground is no rim
INTERVAL = "level_interval"  # column of a lake, half of the 95 % interval of its level
# Standard error of heights, metres, that models take if none is given: what the Dutch AHN allows.
ASSUMED = 0.05
ERROR = "area_error"  # column of a lake, standard error of its area in square metres


@tool(
    "shoreline.storage_curve",
    title="Storage curve of a basin",
    tags=(
        "reservoir",
        "volume",
        "area",
        "level",
        "storage",
        "capacity",
        "hypsometric",
    ),
)
class ShorelineStorageCurve:
    """Tell the area and volume of the water that a basin holds, level by level.

    Give points or a raster of heights. Between points the ground is the facets of their Delaunay
    triangulation, between the centres of four cells four triangles around their mean; the water
    below each level is summed up on them in closed form, without sampling. An outline is a wall
    around the water, cut exactly.

    With `connected` water counts where it is one with that over the lowest ground of the basin: a
    side valley that lies lower than the level counts from the level on at which water gets there,
    and the column apart_m2 has its area before. The basin is what a lake of the highest level
    covers, of which `seed_point` names a place; without it it is the one of the lowest
    ground within the outline, or of all. With `all` everything below the level counts.

    Water that reaches the edge of the data, or a gap in it, would run out or go on there: from that
    level on the column open is true, and what lies beyond is not in the figures. Ground under
    water that the survey could not see does not count as depth.

    With a `lake`, and a terrain into which its water was laid by surface.flatten_water, the curve
    is that of this lake: it begins at its level with the area of its polygon, and water rises
    from there, into side valleys as it gets there. The last level is by default the one at which
    the lake runs over its rim: over the lowest saddle behind which the water leaves the data on
    ground lower than the lake in the survey, and 0.3 m below the saddle, or a hollow takes more
    than what the lake has stored by then. That level and place are told. Without such a saddle it
    is the level at which the water reaches the edge of the data. Levels above are marked
    overtopped: they count what lies on the lake's side of the rim, as if it were higher, and never
    a basin behind it. With `distances` the spill point has its distance to the nearest ground
    point, and a warning says where the level is not measured, as under a bridge: no ground point is
    within three times the median of those distances on land, which is 1.4 spacings of points that
    lie at random, nor within a cell.

    With `height_error`, a standard error that all heights have in common, as that of a level or of
    a survey, the table has the limits between which area and volume lie with 95 %: the figures of
    water that much lower and higher, and for a `lake` with its level_interval those of the level
    from which its volumes count; the first volume, none at that level, has none. Errors of single
    heights cancel out beside it. Not in the limits are the spacing of points, plants taken for
    ground, ground under water, and an error of the survey's heights that was not given.

    The table has the level in the unit of the heights, and in metres; areas and volumes are in
    square and cubic metres. Gains are those from the level before; the first level of a lake, which
    is the water of the survey itself, has none, and no volume. The column heights names the height
    system that the levels refer to. Lengths to set are metres.
    """

    points: PointCloud | None = source("Points of the ground", default=None)
    terrain: Raster | None = source("Raster of heights of the ground", default=None)
    outline: Vector | None = source(
        "Polygons around the basin, a wall to the water",
        default=None,
        label="Outline of the basin",
        shapes="polygon",
    )
    step: float | None = param(
        "Height from one level to the next; by default 1 m, or less so that there are ten",
        default=None,
        unit="m",
        gt=0,
        label="Height between levels",
    )
    lowest: float | None = param(
        "First level; by default the last whole step below the ground",
        default=None,
        unit="m",
        label="First level",
    )
    highest: float | None = param(
        "Last level; by the ground unless given",
        default=None,
        unit="m",
        label="Last level",
    )
    fill: Literal["connected", "all"] = param(
        "What counts as water",
        default="connected",
        label="What counts as water",
        words={"connected": "What is joined to the seed point", "all": "All below the level"},
    )
    seed_point: Position | None = param("A position on the water", default=None)
    lake: Vector | None = source(
        "Water of which the level is to rise, the largest polygon of several",
        default=None,
        label="Lake of the basin",
        shapes="polygon",
    )
    distances: Raster | None = source(
        "Distance of the cells of the terrain to ground points, as surface.grid gives with support",
        default=None,
        label="Distances to ground points",
    )
    height_error: float | None = param(
        "Standard error that all heights have in common, for limits of area and volume",
        default=None,
        unit="m",
        gt=0,
        le=10,
        label="Common error of heights",
    )
    classes: ClassList | None = parameters.classes()
    max_gap: float | None = param(
        "Leave empty what lies farther than this from any point",
        default=None,
        unit="m",
        gt=0,
        label="Widest gap to fill",
    )

    @outputs
    class Outputs:
        curve: Table = sink(
            "Level, area and volume with gains, area apart, and whether open",
            show=show.Curve(
                show.Axis("level", "level", unit_in="unit"),
                (
                    show.Axis("area_m2", "area", "m²", limits=("area_low_m2", "area_high_m2")),
                    show.Axis(
                        "volume_m3", "volume", "m³", limits=("volume_low_m3", "volume_high_m3")
                    ),
                ),
                upright=True,
                shaded="open",
                shaded_as="beyond the data, too",
            ),
            label="Storage curve",
            columns=columns.CURVE,
        )
        lowest_ground: float = sink("Height of the lowest ground of the basin", unit="m")
        opens: float | None = sink(
            "Level at which water reaches the edge of the data on the own side of the rim; "
            "none if never",
            unit="m",
            label="Level at which it opens",
        )
        area: float = sink("Area at the last level", unit="m2")
        volume: float = sink("Volume at the last level", unit="m3")
        level_uncertainty: float | None = sink(
            "Uncertainty of the level of the lake with the common error of heights (95 %)",
            unit="m",
            label="Uncertainty of the level",
        )
        common_interval: float | None = sink(
            "Half of the 95 % interval of all heights by the error that they have in common",
            unit="m",
            label="Common error of heights (95 %)",
        )
        spill: float | None = sink(
            "Level at which the lake runs over its rim; none if never",
            unit="m",
            label="Level at which it runs over",
        )
        rim_interval: float | None = sink(
            "Half of the 95 % interval of the rim's level, by common error and roughness of the "
            "ground",
            unit="m",
            label="Uncertainty of the rim (95 %)",
        )
        rim_volume: float | None = sink(
            "Volume that fits below the lower end of that interval",
            unit="m3",
            label="Volume below the lower end of the rim",
        )
        spill_point: Vector = sink(
            "Where the lake runs over its rim, a point at that level",
            label="Spill point",
            columns={
                "level": Column("Level of the rim", "unit", 3),
                "from_ground": Column("Distance to the nearest ground point", "m", 1),
            },
        )
        missing_share: float = sink("Share of the outline, or of all, without ground", unit="1")

        def in_words(self) -> str:
            """Area and volume at the last level, and where the lake runs over."""
            frame = self.curve.frame
            levels = frame["level_m"]
            above = f"its lowest ground, {self.lowest_ground:.3f} m"
            if OVERTOPPED in frame:
                above = f"the level of the survey, that is {self.lowest_ground:.3f} m"
            words = (
                f"At a level of {levels.iloc[-1]:.3f} m the basin has an area of {self.area:.0f} "
                f"m² and holds {self.volume:.0f} m³ above {above}. "
                f"The curve has {len(frame)} levels from {levels.iloc[0]:.3f} m on."
            )
            if OVERTOPPED in frame and levels.iloc[0] <= self.lowest_ground:
                words += (
                    " The first one is the water of the survey itself: its area, and no volume, "
                    "as volumes count from there."
                )
            if frame["open"].all():
                words = (
                    "The water goes on beyond the edge of the data at all levels: the basin here "
                    f"is its part within the data. {words}"
                )
            if self.level_uncertainty is not None:
                words += (
                    f" With the error that all heights have in common the level of the survey is "
                    f"known to ± {self.level_uncertainty:.3f} m (95 %)."
                )
            if self.spill is not None:
                words += f" {self._runs_over()}"
            if self.rim_interval is not None:
                words += (
                    f" That is known to ± {self.rim_interval:.2f} m (95 %) by the error that all "
                    "heights have in common and by how rough the ground around the water is; below "
                    f"the lower end of that it holds {self.rim_volume:.0f} m³."
                )
            return " ".join([words, *self._limits_in_words()])

        def _limits_in_words(self) -> Iterator[str]:
            """What the limits of the curve hold and leave out, and what the rim has of that."""
            if self.common_interval is None:
                return
            error = self.common_interval / NINETY_FIVE
            held = f"an error that all heights have in common (standard error {error:.3g} m)"
            if OVERTOPPED in self.curve.frame:
                held += ", where the shore may lie, and how well the level of the survey is known"
            yield (
                f"The limits (95 %) of areas and volumes hold {held}; they leave out ground that "
                "plants hide, gaps between points, what lies beyond the data, and all depth below "
                "the water of the survey."
            )
            yield (
                "They are for a level that a gauge tells: the common error moves the ground and "
                "the rim alike, so that it does not change what fits below the rim itself."
            )
            if math.isclose(error, ASSUMED):
                yield (
                    f"That error, {error:.3g} m, is an assumption unless it was given for this "
                    "survey."
                )

        def _runs_over(self) -> str:
            """Level and place of the spill, or where a rim that is seen in part is lowest."""
            (place,) = self.spill_point.frame.geometry
            at = f"{place.x:.1f}, {place.y:.1f}"
            if self.curve.frame["open"].all():
                return f"What is seen of its rim is lowest at {self.spill:.3f} m, at {at}."
            return f"The lake runs over its rim at {self.spill:.3f} m, at {at}."

        def not_looked_at(self) -> Iterator[str]:
            """Ground under the lake or missing, and levels at which the water leaves the data."""
            if OVERTOPPED in self.curve.frame:
                yield (
                    "The ground under the water was not seen: no volume below the level of the "
                    "survey is in these figures."
                )
            if self.missing_share:
                share = f"{100 * self.missing_share:.3g} %"
                yield f"{share} of the area has no ground, and holds nothing in these figures."
            if self.opens is not None and self.opens < self.curve.frame["level_m"].iloc[-1]:
                yield (
                    f"From {self.opens:.3f} m on the water reaches the edge of the data, or a gap "
                    "in it: what lies there was not seen, and is not in the figures."
                )
            if self.spill is not None and self.spill < self.curve.frame["level_m"].iloc[-1]:
                yield (
                    f"{self._runs_over()} Higher levels count what lies on its side of the rim, "
                    "and only a rim that is raised would hold that."
                )

    def check(self) -> Iterator[tuple[str, str]]:
        """The levels are in order, and a seed point is given only for connected water."""
        low, high = self.lowest, self.highest
        if low is not None and high is not None and low >= high:
            yield "lowest", f"must be < highest ({high:g}), got {low:g}"
        if self.fill == "all" and self.seed_point:
            yield "seed_point", "is for connected water; with fill all it would make no difference"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """There is one source of ground, and only settings that go with it."""
        if self.lake is not None and (self.seed_point or self.fill == "all"):
            yield "lake", "is for connected water, and in place of a seed point"
        if self.lake is not None and self.terrain is None:
            yield "lake", "is for a terrain, into which surface.flatten_water has laid the water"
        if self.distances and (text := self._unfit_distances()):
            yield "distances", f"{self.distances.name or 'the raster'} {text}"
        if (self.points is None) == (self.terrain is None):
            yield "points", "give points or a terrain, one of both"
            return
        if self.terrain is not None:
            if text := heights_problem(self.terrain):
                yield "terrain", f"{self.terrain.name or 'the raster'} {text}"
            for name in ("classes", "max_gap"):
                if getattr(self, name) is not None:
                    yield name, "is for points, not for a terrain"
        elif self.points and self.classes and "classification" not in self.points:
            yield "classes", f"{self.points.name} has no classification"

    def _unfit_distances(self) -> str | None:
        """Why a raster does not tell how far ground points are; None if it does."""
        assert self.distances is not None
        if DISTANCE not in self.distances.descriptions:
            return f"has no band with the description {DISTANCE!r}"
        if self.terrain is None:
            return "is for a terrain, not for points"
        text = not_on(Lattice.of(self.terrain), Lattice.of(self.distances))
        return f"{text} of the terrain" if text else None

    def halo(self) -> float:
        """Infinite, as a basin may run through the whole survey."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> ShorelineStorageCurve.Outputs:
        """Fill the basin, and sum up its water level by level."""
        ground: Any = self.points if self.terrain is None else self.terrain
        basin = self._basin(ctx.part(0, 0.6))
        if basin.missing:
            log.warning("%.3g %% of the area has no ground, and holds nothing", 100 * basin.missing)
        highest = basin.highest if self.highest is None else self.highest
        if self.fill == "connected":
            self._fill(basin, highest, ctx.part(0.6, 0.8))
        opens, spill = basin.opens(), basin.spill.level if basin.spill else math.inf
        if self.lake is not None and self.highest is None:
            highest = last_level(basin.lowest, spill, opens, highest)
        levels = self._levels(basin.lowest, highest, ground.metre)
        area, volume, everything = storage(basin.pieces(), levels, ctx=ctx.part(0.8, 0.9))
        made = table(levels, area, volume, everything, opens, ground)
        if self.height_error:
            made = with_limits(made, basin.pieces, levels, NINETY_FIVE * self.height_error, ground)
            if self.lake is not None:
                made = with_shore(made, self.lake)
                made = with_level(made, self._interval() / ground.metre)
        if self.lake is not None:
            made = with_rim(made, levels > spill)
        ctx.progress(1.0)
        tell(basin, opens, float(levels[-1]), ground)
        place = spill_point(basin.spill, ground.crs)
        if basin.spill and self.distances and self.lake is not None:
            place = self._with_distance(place, basin.spill)
        rim = self._rim_interval(basin)
        return self.Outputs(
            curve=made,
            lowest_ground=basin.lowest,
            opens=opens if math.isfinite(opens) else None,
            area=float(area[-1]),
            volume=float(volume[-1]),
            level_uncertainty=self._level_uncertainty(),
            common_interval=NINETY_FIVE * self.height_error if self.height_error else None,
            spill=spill if math.isfinite(spill) else None,
            rim_interval=rim,
            rim_volume=None if rim is None else _below(basin, spill - rim),
            spill_point=place,
            missing_share=basin.missing,
        )

    def _with_distance(self, place: Vector, spill: Spill) -> Vector:
        """The place of a spill with its distance to the ground seen, and a warning if it is far."""
        assert self.distances is not None
        assert self.lake is not None
        lattice, metre = Lattice.of(self.distances), self.distances.metre
        away = self.distances.band(self.distances.descriptions.index(DISTANCE) + 1)
        land = np.isfinite(away)
        if (lake := largest(self.lake)) is not None:
            land[cells_within(lake, lattice)] = False
        row, col = (int(k[0]) for k in lattice.indices([spill.x], [spill.y]))
        here = float(away[row, col])
        far = max(FAR * float(np.median(away[land])) if land.any() else 0.0, lattice.cell)
        if not here <= far:  # also if no point is known
            log.warning(
                "the level at which the lake runs over, at %.1f, %.1f, is not measured: no ground "
                "point is within %.1f m of that place, as under a bridge, a building or plants; it "
                "lies between ground farther away",
                spill.x,
                spill.y,
                far / metre,
            )
        return Vector(
            place.frame.assign(from_ground=here / metre), geometry_type=place.geometry_type
        )

    def _levels(self, lowest: float, highest: float, metre: float) -> Array:
        """The levels; those of a lake begin at its level, and go on in whole steps."""
        start = lowest if self.lowest is None else max(lowest, self.lowest)
        step = self.step or usual_step(highest - start, metre)
        first = self._first(lowest, highest, step)
        if self.lake is None:
            return levels_between(first, highest, step)
        first = max(first, lowest)  # a level given in more digits than the raster has
        further = whole(first + step / 100, step)
        if further < highest:
            return np.append(first, levels_between(further, highest, step))
        return levels_between(first, highest, step)

    def _level_uncertainty(self) -> float | None:
        """Half of the 95 % interval of the level of the lake; None if it is not known."""
        if not self.height_error or self.lake is None or INTERVAL not in self.lake.names:
            return None
        known = math.hypot(self._interval(), NINETY_FIVE * self.height_error)
        return known if math.isfinite(known) else None

    def _rim_interval(self, basin: PointBasin | RasterBasin) -> float | None:
        """Half of the 95 % interval of the level at which the lake runs over.

        The rim is one cell of a terrain, and no better known than one.
        """
        if self.lake is None or not isinstance(basin, RasterBasin) or basin.spill is None:
            return None
        rough = basin.roughness(basin.spill.level)
        return NINETY_FIVE * math.hypot(self.height_error or 0.0, rough)

    def _interval(self) -> float:
        """Half of the 95 % interval of the level of the lake within the survey; 0 if not told."""
        if self.lake is None or INTERVAL not in self.lake.names:
            return 0.0
        frame = self.lake.frame
        return float(frame[INTERVAL].iloc[int(np.argmax(frame.geometry.area))])

    def _basin(self, ctx: Context) -> PointBasin | RasterBasin:
        """The ground within the outline."""
        outline = None
        if self.outline is not None:
            outline = shapely.union_all(polygons(self.outline, "outline"))
            if outline.is_empty:
                raise DataError(f"outline: {self.outline.name} holds no polygon")
        if self.terrain is not None:
            found = Lattice.of(self.terrain)
            fall = FALL * self.terrain.metre
            return RasterBasin(self.terrain.band(), found, outline, fall=fall, ctx=ctx)
        return PointBasin(self._ground_points(ctx), outline, self.max_gap or math.inf, ctx=ctx)

    def _ground_points(self, ctx: Context) -> Array:
        """The points of the chosen classes that are not withheld, array of shape (n, 3)."""
        cloud = self.points
        assert cloud is not None
        require_finite(cloud.xyz)
        if self.classes:
            keep = np.isin(cloud["classification"], self.classes)
            if len(keep) and not keep.any():
                raise NothingToDo(f"points: none is of class {self.classes}; classify them first")
            return cloud.xyz[without_withheld(cloud, keep, ctx)]
        found = np.unique(cloud["classification"]) if "classification" in cloud else ()
        if len(found) > 1 and GROUND in found:
            setting = setting_name("classes")
            how = f"; see the setting {setting}" if setting else ""
            log.warning("points of all classes are taken for ground%s", how)
        return cloud.xyz[without_withheld(cloud, np.ones(len(cloud), bool), ctx)]

    def _fill(self, basin: PointBasin | RasterBasin, highest: float, ctx: Context) -> None:
        """Find the connected water, from the seed point or from the lowest ground."""
        name, place, lake = "seed_point", self.seed_point, None
        if self.lake is not None:
            name, lake = "lake", largest(self.lake)
            if lake is None:
                raise DataError("lake: holds no water, so no level can rise")
            place = place_in(lake)
        if place is None:
            basin.fill(None, highest, ctx=ctx)
            return
        try:
            if lake and isinstance(basin, RasterBasin):
                basin.rise(basin.at(*place), lake, ctx=ctx)
            else:
                basin.fill(basin.at(*place), highest, ctx=ctx)
        except DataError as err:
            x, y = place
            raise DataError(f"{name}: {x:.12g}, {y:.12g} {err}") from err

    def _first(self, ground: float, highest: float, step: float) -> float:
        """The first level, checked against the ground and the last level."""
        first = self.lowest
        if first is None:
            first = math.floor(ground / step + ROUNDING) * step
        if highest < ground:
            what = "lowest ground" if self.lake is None else "level of the lake in the survey"
            raise DataError(f"highest: {highest:.9g} is below the {what}, {ground:.9g}")
        if highest < first:
            raise DataError(f"lowest: {first:.9g} is above the highest ground, {highest:.9g}")
        return first


def usual_step(height: float, metre: float) -> float:
    """One, two or five times a power of ten: at most a metre, so that a curve has ten steps.

    Parameters
    ----------
    height : from the first level to the last
    metre : length of a metre in the unit of the heights

    Examples
    --------
    >>> usual_step(42.0, 1.0), usual_step(0.72, 1.0), usual_step(42.0, 1 / 0.3048)
    (1.0, 0.05, 2.0)
    """
    most = metre if height <= 0 else min(metre, height / FEWEST_LEVELS)
    tens = 10.0 ** math.floor(math.log10(most))
    return float(f"{tens * max(n for n in (1, 2, 5) if n * tens <= most * (1 + ROUNDING)):.1g}")


def whole(level: float, step: float) -> float:
    """The next whole multiple of a step above a level.

    Examples
    --------
    >>> whole(499.98, 1.0), whole(500.0, 0.5)
    (500.0, 500.5)
    """
    return (math.floor(level / step + ROUNDING) + 1) * step


def last_level(level: float, spill: float, opens: float, top: float) -> float:
    """Up to where the curve of a lake goes if it is not told.

    It is the level at which the lake runs over; without a spill the one at which it reaches the
    edge of the data, and if it lies there from the beginning, the top of the ground.

    Examples
    --------
    >>> inf = float("inf")
    >>> last_level(5.0, 8.0, 5.0, 20.0), last_level(5.0, inf, 6.0, 20.0)
    (8.0, 6.0)
    >>> last_level(5.0, inf, 5.0, 20.0)
    20.0
    """
    if math.isfinite(spill):
        return spill
    return opens if level < opens < math.inf else top


def tell(basin: PointBasin | RasterBasin, opens: float, last: float, ground: Any) -> None:
    """Warn of an edge of the data that the water reaches, and of a rim that it runs over."""
    unit = "m" if ground.metre == 1 else vertical_unit(ground.crs)
    if opens < last:
        log.warning(
            "from %.3f %s on the water reaches the edge of the data, or a gap in it: what lies "
            "there was not seen, and is not in the figures",
            opens,
            unit,
        )
    if spill := basin.spill:
        place = (spill.level, unit, spill.x, spill.y)
        log.info("the lake runs over its rim at %.3f %s, at %.1f, %.1f", *place)
        if spill.level < last:
            log.warning(
                "the lake runs over its rim at %.3f %s, at %.1f, %.1f: levels above are marked "
                "overtopped, and count its own side of the rim alone",
                *place,
            )


def spill_point(spill: Spill | None, crs: CRS | None) -> Vector:
    """Where a lake runs over, as a layer of one point with the level; empty if it never does."""
    points = [shapely.Point(spill.x, spill.y, spill.level)] if spill else []
    levels = {"level": np.array([spill.level] if spill else [], float)}
    return Vector(geopandas.GeoDataFrame(levels, geometry=points, crs=crs), geometry_type="Point Z")


def largest(lake: Vector) -> shapely.Polygon | None:
    """The largest polygon of a layer; None if it holds none."""
    shapes = polygons(lake, "lake")
    return shapely.force_2d(shapes[int(np.argmax(shapely.area(shapes)))]) if len(shapes) else None


def place_in(lake: shapely.Polygon) -> Position:
    """A position well inside a polygon."""
    x, y = shapely.get_coordinates(shapely.maximum_inscribed_circle(lake))[0].tolist()
    return Position(x, y)


def _below(basin: PointBasin | RasterBasin, level: float) -> float:
    """Volume of the water up to a level; none if the lake stands higher."""
    _, volume, _ = storage(basin.pieces(), np.array([max(level, basin.lowest)]))
    return float(volume[0])


def with_limits(
    made: Table, pieces: Callable[[], Iterable[Pieces]], levels: Array, reach: float, ground: Any
) -> Table:
    """A storage curve with columns for the least and greatest area and volume.

    Ground that is all too high or too low by `reach`, in the unit of the heights, is the same as
    water that is as much lower or higher. The surveyed water is there: no area is less than the
    first.
    """
    frame = made.frame
    for name, shift in (("low", -reach), ("high", reach)):
        area, volume, _ = storage(pieces(), levels + shift)
        frame[f"area_{name}_m2"] = np.maximum(area / ground.metre**2, frame["area_m2"].iloc[0])
        frame[f"volume_{name}_m3"] = volume / ground.metre**3
    return Table(frame)


def with_shore(made: Table, lake: Vector) -> Table:
    """Limits of the areas that also hold where the shore of the surveyed lake may lie.

    The lake has the column area_error, as that of shoreline.extract, or nothing changes. Its area
    is the first of the curve, and a part of all others.
    """
    frame = made.frame
    if ERROR not in lake.frame:
        return made
    sizes = shapely.area(lake.frame.geometry.to_numpy())
    reach = NINETY_FIVE * float(lake.frame[ERROR].iloc[int(np.argmax(sizes))])
    area = frame["area_m2"]
    frame["area_low_m2"] = area - np.hypot(area - frame["area_low_m2"], reach)
    frame["area_high_m2"] = area + np.hypot(frame["area_high_m2"] - area, reach)
    return Table(frame)


def with_level(made: Table, interval: float) -> Table:
    """Limits of the volumes that also hold how well the level is known from which they count.

    Water that stood lower by the interval, in metres, leaves room for the area of the lake times
    that. Without a finite interval nothing changes.
    """
    frame = made.frame
    if not math.isfinite(interval):
        return made
    reach = interval * float(frame["area_m2"].iloc[0])
    volume = frame["volume_m3"]
    low = volume - np.hypot(volume - frame["volume_low_m3"], reach)
    frame["volume_low_m3"] = np.maximum(low, 0.0)
    frame["volume_high_m3"] = volume + np.hypot(frame["volume_high_m3"] - volume, reach)
    return Table(frame)


def with_rim(made: Table, overtopped: NDArray[np.bool_]) -> Table:
    """A storage curve with a column that marks the levels above the rim of the lake.

    At its first level, that of the survey, nothing was gained yet: its area was there before.
    Volumes count from there, so the first one is none by definition, and has no limits.
    """
    frame = made.frame
    counted = ["area_gain_m2", "volume_gain_m3", "volume_low_m3", "volume_high_m3"]
    frame.loc[0, frame.columns.intersection(counted)] = np.nan
    frame.insert(frame.columns.tolist().index("open") + 1, OVERTOPPED, overtopped)
    return Table(frame)


def levels_between(first: float, last: float, step: float) -> Array:
    """Levels that are a step apart, with the last one.

    Raises
    ------
    DataError
        They are more than `MOST_LEVELS`.
    """
    steps = (last - first) / step + ROUNDING
    if not steps < MOST_LEVELS:
        raise DataError(
            f"step: makes {steps + 1:.7g} levels, more than {MOST_LEVELS}; take a larger one"
        )
    levels = np.round(first + step * np.arange(math.floor(steps) + 1), DIGITS)
    near = ROUNDING * min(step, last - first)
    return levels if last - levels[-1] <= near else np.append(levels, last)


def storage(
    pieces: Iterable[Pieces], levels: Array, *, ctx: Context = QUIET
) -> tuple[Array, Array, Array]:
    """Area and volume of the water below each level, summed up over triangles of ground.

    In a triangle with heights a <= b <= c and area S the water below a level h covers
    S (h - a)^2 / (b - a) / (c - a) up to b, and S less the same from above up to c; the volume is
    the integral of that over h. A triangle adds to the levels that cut it, and with all of its
    area to the first one above it, from where the sum goes on upwards.

    Parameters
    ----------
    levels : array of shape (k,), rising

    Returns
    -------
    area, volume : arrays of shape (k,), of water that is joined
    everything : array of shape (k,), area of all ground below the level
    """
    sums = np.zeros((6, len(levels) + 1))
    for some in pieces:
        for first in range(0, len(some.triangles), BLOCK):
            last = min(first + BLOCK, len(some.triangles))
            kernels.add_block(*some, levels, first, last, sums)
            ctx.progress(0.0)
    whole, weighted, everything = np.cumsum(sums[[2, 3, 5], :-1], axis=1)
    area, volume = sums[0, :-1] + whole, sums[1, :-1] + whole * (levels - levels[0]) - weighted
    volume = np.where(volume < ROUNDING * area, 0.0, volume)  # what sums have lost of nothing
    ctx.progress(1.0)
    return area, volume, sums[4, :-1] + everything


def table(
    levels: Array, area: Array, volume: Array, everything: Array, opens: float, ground: Any
) -> Table:
    """Table of the storage curve in metres; levels also in the unit of the heights."""
    square = ground.metre**2
    apart = np.where(everything - area > ROUNDING * everything, everything - area, 0.0)
    frame = pd.DataFrame(
        {
            "level": levels,
            "unit": vertical_unit(ground.crs),
            "level_m": levels / ground.metre,
            "area_m2": area / square,
            "volume_m3": volume / (square * ground.metre),
            "area_gain_m2": np.diff(area, prepend=0.0) / square,
            "volume_gain_m3": np.diff(volume, prepend=0.0) / (square * ground.metre),
            "apart_m2": apart / square,
            "open": np.round(levels, DIGITS) >= round(opens, DIGITS),
            "heights": height_system(ground.crs),
        }
    )
    return Table(frame)


def height_system(crs: CRS | None) -> str:
    """Name of the height system that the levels refer to, with its unit."""
    if crs is None:
        return "not stated"
    system, *vertical = [part.name for part in crs.sub_crs_list] or [crs.name]
    if not vertical and len(crs.axis_info) < 3:
        return f"height system not stated, in {vertical_unit(crs)}"
    return f"{(vertical or [system])[0]}, in {vertical_unit(crs)}"
