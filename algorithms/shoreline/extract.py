"""Water bodies from a point cloud: outlines and levels, with their uncertainty.

How it works, how exact it is and what it cannot know: docs/explanation/shoreline.md.

References
----------
Höfle, B., Vetter, M., Pfeifer, N., Mandlburger, G. & Stötter, J. (2009). Water surface mapping from
airborne laser scanning using signal intensity and elevation data. Earth Surface Processes and
Landforms 34, 1635-1649: lost pulses, intensity and level as signs of water.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from algorithms.shared import parameters
from algorithms.shared.water_columns import LOOKS, SHORELINE, WATER
from algorithms.shoreline import _columns as columns
from algorithms.shoreline._level import NINETY_FIVE
from toolbox.context import QUIET, Context, log, setting_name
from toolbox.data import PointCloud, Survey, Vector
from toolbox.data.crs import Unit, own_unit, short_height_unit, unit_of_lengths
from toolbox.declare import ClassList, Position, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

if TYPE_CHECKING:
    from algorithms.shoreline._cells import CellGrid
    from algorithms.shoreline._outline import Outline
    from algorithms.shoreline._surfaces import Water

Row = dict[str, Any]
OTHER_TYPES = {"body": int, "islands": int, "evidence": str, "kind": str, "data_edge": bool}
LEAST_TOLD = 0.001  # the last digit of a level as it is told; what is smaller is rounded up


@tool(
    "shoreline.extract",
    title="Find water bodies",
    tags=(
        "water",
        "lake",
        "river",
        "flood",
        "reservoir",
        "shoreline",
        "outline",
        "breakline",
        "hydro",
        "flattening",
    ),
)
class ShorelineExtract:
    """Find water bodies, and draw their outlines at their levels.

    Nothing needs to be set. Holes in the data and calm places are filled with water up to the level
    found there; what does not run off, and swallows pulses, or is level and dark, is water. What
    is only level may be ice, or a square: it is left out and told of, unless other water is at its
    level, the `seed_point` is on it, or `level_alone` is set. The level is that of the points on
    the water, whatever lies above or below. The outline runs between the points, where the bank
    reaches the level. What each body was found by is in its attribute evidence.

    By default the largest body is given, with `seed_point` the one at that place. The others come
    as `other_waters`, their outlines, and `other_bodies`, their polygons. Ponds are bodies of their
    own even at the same level, islands are holes of the polygon. Where the data end and the water
    does not, the outline follows the edge of the data: attribute open_length, and lines of kind
    data edge. Parts that were flown at different levels on different days are one body.

    `vertices` are the corners of the outlines with the standard deviation across the shore, from
    the spacing of points, the slope of the bank and the error of the level. It says nothing about
    water hidden below trees or bridges.

    Corners between single points make a zigzag, which is longer than the shore: `smoothing` takes
    out what is shorter than some times its length, and hardly moves bends, islands and the area.
    With auto it is two spacings of points, and at least 1 m. It rounds sharp corners, as of walls.

    A river is not level: with `sloped` its surface is a plane, without it is an error, or left out
    where all bodies are asked for.

    Heights are in the unit of the data, areas and lengths in metres.
    """

    points: PointCloud | Survey = source("Points of the survey, classified or not")
    seed_point: Position | None = param("A position on the water", default=None)
    bodies: Literal["largest", "all"] = param(
        "Bodies to give",
        default="largest",
        label="Water bodies",
        words={"largest": "The largest", "all": "All"},
    )
    min_area: float = param(
        "Smallest body", default=100.0, unit="m2", gt=0, label="Smallest body of water"
    )
    min_island: float = param(
        "Smallest island", default=20.0, unit="m2", ge=0, label="Smallest island"
    )
    smoothing: float | Literal["auto"] = param(
        "Length of zigzag to take out; 0 for none", default="auto", unit="m", ge=0
    )
    sloped: bool = param(
        "Allow rivers, whose surface is not level", default=False, label="Rivers too"
    )
    level_alone: bool = param(
        "Give bodies, too, that are known by their level alone, as ice may be",
        default=False,
        label="Bodies known by their level alone",
    )
    water_classes: ClassList | None = param("Classes that are water, if known", default=None)
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        water: Vector = sink(
            "Polygons of the water, at its level",
            show=show.OfClass(9, number="body"),
            columns=WATER,
        )
        shoreline: Vector = sink(
            "Their outlines: shore, islands, and edges of the data",
            show=show.Classes("kind", LOOKS),
            columns=SHORELINE,
        )
        vertices: Vector = sink(
            "Corners of the outlines with their standard deviation", columns=columns.VERTICES
        )
        other_waters: Vector = sink(
            "Outlines of the water bodies that were found and are not given",
            show=show.OfClass(9, thin=True),
            columns=SHORELINE,
            listed=False,
        )
        other_bodies: Vector = sink(
            "Polygons of these, at their levels",
            show=show.OfClass(9, thin=True),
            columns=WATER,
            listed=False,
        )
        level: float | None = sink("Level of the largest body given", unit="m")
        level_error: float | None = sink("Its standard error within the survey", unit="m")
        level_interval: float | None = sink(
            "Uncertainty of the level within the survey (95 %)", unit="m"
        )
        area: float = sink("Area of all bodies given", unit="m2")
        count: int = sink("Number of bodies given", unit="1")
        detail: float | None = sink(
            "Length below which the outlines are not known: two spacings of points, at least 1 m",
            unit="m",
            label="Detail of the outlines",
        )
        least_area: float = sink("Area of the smallest body that was looked for", unit="m2")
        narrowest: float | None = sink(
            "Width below which waters may be missing, as creeks and ditches",
            unit="m",
            label="Narrowest water",
        )

        def in_words(self) -> str:
            """How many bodies, their area and level."""
            if not self.count or self.level is None:
                return "No water body was found."
            bodies = "One water body" if self.count == 1 else f"{self.count} water bodies"
            which = "its level" if self.count == 1 else "the level of the largest"
            level, interval = (
                float(self.water.frame[name].iloc[0]) for name in ("level", "level_interval")
            )
            unit = short_height_unit(self.water.crs)
            lengths = unit_of_lengths(self.water.crs)
            area = f"{self.area:.0f} m²{own_unit(self.area, lengths, 2)}"
            reach = f"{self._area_reach:.0f} m²{own_unit(self._area_reach, lengths, 2)}"
            words = (
                f"{bodies} of {area} in all, {reach} more or less, without what lies below "
                f"bridges, jetties and boats; "
                f"{which} is {f'{level:.3f} {unit}'.rstrip()}"
            )
            fall = self._fall(unit)
            if not math.isfinite(interval):
                return f"{words}. {fall}".rstrip()
            reach = f"{max(interval, LEAST_TOLD):.3f} {unit}".rstrip()
            words = (
                f"{words}, ± {reach} within the survey (95 % "
                "intervals); an error that all of its heights have in common comes on top."
            )
            return f"{words} {fall}".rstrip()

        def _fall(self, unit: str) -> str:
            """Sentence on the fall of the largest body, "" if it is level."""
            frame = self.water.frame
            if not frame["slope"].iloc[0]:
                return ""
            own = frame.geometry[frame["body"] == frame["body"].iloc[0]]
            z = own.get_coordinates(include_z=True)["z"]
            low = f"{z.min():.3f} {unit}".rstrip()
            return (
                f"The surface of the largest falls from {z.max():.3f} to {low}; the level is that "
                "of its middle."
            )

        @property
        def _area_reach(self) -> float:
            """Half of the 95 % interval of the area of all bodies; their errors are independent."""
            return NINETY_FIVE * float(np.linalg.norm(self.water.frame["area_error"]))

        def _by(self, evidence: str) -> int:
            """How many bodies are told by one thing, and being level, alone."""
            frame = self.water.frame
            looks = [
                set(told.split(", ")) - {"level", "level across"} for told in frame["evidence"]
            ]
            return int(frame["body"][[rest == {evidence} for rest in looks]].nunique())

        @property
        def _by_bright_returns(self) -> int:
            """How many bodies have their level from few returns that are as bright as land.

            Returns of a class of water are of water.
            """
            from algorithms.shoreline._evidence import DARK, SPARSE

            frame = self.water.frame
            some = (frame["returned"] <= SPARSE) & (frame["darkness"] < DARK)
            some &= ~frame["evidence"].str.contains("class")
            return int(frame["body"][some & frame["scatter"].notna()].nunique())

        def not_looked_at(self) -> Iterator[str]:
            """Small waters, what looks like one, hidden shores, and outlines that are no shore."""
            lengths = unit_of_lengths(self.water.crs)
            small = f"{self.least_area:.0f} m²{own_unit(self.least_area, lengths, 2)}"
            if self.narrowest is not None:
                yield (
                    f"Waters of less than {small}, as pieces of a canal between bridges and pools, "
                    f"are not looked for; those narrower than {self.narrowest:.1f} m"
                    f"{own_unit(self.narrowest, lengths)}, as creeks and ditches, may be missing"
                )
            if not self.count:
                return
            if bright := self._by_bright_returns:
                yield (
                    "Waters of which little came back, as bright as land: "
                    f"{bright} of {self.count} (columns returned and darkness); it may be of "
                    "plants, ice or foam that float above the level, which is therefore told no "
                    "surer than one return"
                )
            if hidden := float(self.water.frame["hidden_area"].sum()):
                yield (
                    f"Shores below crowns: {hidden:.0f} m²{own_unit(hidden, lengths, 2)} beside "
                    "the outlines were not seen there; they are not in the areas, whose errors "
                    "hold that they may be water"
                )
            if alone := self._by("dark"):
                yield (
                    "Waters that return their pulses and are told by being level and dark alone: "
                    f"{alone} of {self.count} (column evidence); paved ground as dark and level "
                    "looks like them"
                )
            if alone := self._by("fewer returns"):
                yield (
                    "Waters that are as bright as land and are told by being level and returning "
                    f"fewer pulses alone: {alone} of {self.count} (column evidence); bogs, wet "
                    "meadows and fields that fewer flights cover look like them"
                )
            yield (
                "Shores below bridges, decks and wide woods, and behind jetties and moored boats: "
                "outlines of water end there, up to some metres short of the true shore; the "
                "intervals of areas do not hold that"
            )
            if text := open_edges(self.water.frame.to_dict("records"), lengths):
                yield text

    def check(self) -> Iterator[tuple[str, str]]:
        """A seed point is not combined with all bodies."""
        if self.seed_point and self.bodies == "all":
            yield "bodies", "must be largest with a seed_point"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have a classification if classes are used."""
        if self.water_classes and "classification" not in self.points.names:
            yield "water_classes", f"{self.points.name} has no classification"
        if self.seed_point and not _within(self.seed_point, self.points.bounds):
            yield "seed_point", f"{self.seed_point} is outside of {self.points.name}"

    def halo(self) -> float:
        """Infinite, as a body may be of any size."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> ShorelineExtract.Outputs:
        """Find the bodies, choose among them and draw them."""
        # of which a model that looks for no water has no need
        from algorithms.shoreline._decks import decks, decks_in_words
        from algorithms.shoreline._outline import draw
        from algorithms.shoreline._returns import Returns
        from algorithms.shoreline._water import find_water

        points = Returns.of(self.points, self.ignore, self.water_classes, ctx.part(0.0, 0.3))
        if not len(points):
            log.warning("points: there are none, and no water")
            return self._packed([], [])
        cells, water = find_water(
            points,
            self.min_area,
            level_alone=self.level_alone or bool(self.seed_point),
            ctx=ctx.part(0.3, 0.7),
        )
        chosen = self._chosen(cells, water)
        how = self.min_area, self.min_island, self.smoothing
        outlines = draw(points, cells, water, chosen, *how, ctx.part(0.7, 0.9))
        rest = [k for k in range(len(water)) if k not in chosen]
        others = draw(points, cells, water, rest, *how, ctx.part(0.9, 1.0)) if rest else []
        others = [replace(one, number=one.number + len(outlines)) for one in others]
        self._tell(cells, outlines, others)
        if found := list(decks(points.decks, outlines, cells)):
            log.warning(
                "outlines of water end at bridges, quays and the like (classes 17 and 26), below "
                "which water may go on that is in no area, and a terrain may stand out of it: %s",
                decks_in_words(found, cells.metre),
            )
        return self._packed(outlines, others, cells)

    def _chosen(self, cells: CellGrid, water: Sequence[Water]) -> list[int]:
        """Indices of the bodies to give out."""
        from algorithms.shoreline._water import at_place, sloping

        if self.seed_point:
            chosen = [at_place(cells, water, self.seed_point)]
        else:
            chosen = list(range(len(water) if self.bodies == "all" else min(1, len(water))))
        if self.sloped or not (rivers := [water[k] for k in chosen if water[k].fall]):
            return chosen
        if self.bodies != "all":
            raise DataError(f"points: {sloping(cells, rivers[0])}; it is no lake{_takes_rivers()}")
        return [k for k in chosen if not water[k].fall]

    def _tell(
        self, cells: CellGrid, outlines: Sequence[Outline], others: Sequence[Outline]
    ) -> None:
        """Log the bodies with the numbers and areas of tables, and what is doubtful about them."""
        from algorithms.shoreline._water import in_unit, name_of, sloping, some_of, tell, warn_of

        given, rest = ([one.named for one in some] for some in (outlines, others))
        tell(cells, [*given, *rest])
        if self.bodies == "all":  # what is left are rivers
            for river in rest:
                text = sloping(cells, river)
                log.warning("points: %s; it is no lake%s; left out", text, _takes_rivers())
        elif rest:
            names = [
                f"{name_of(cells, one)}, level {in_unit(cells, one.level.height)}" for one in rest
            ]
            log.warning(
                "points: other water bodies: %d, given apart; they do not count in area and level: "
                "%s",
                len(rest),
                some_of(names),
            )
            # No warning, which a report would show to people who run nothing.
            if bodies := setting_name("bodies"):
                log.info("%s all gives every one", bodies)
            if place := setting_name("seed_point"):
                log.info("%s takes the water at a place, such as one that is named here", place)
        warn_of(cells, given)
        own = [row for one in outlines for _, row in one.rows()]
        if text := open_edges(own, unit_of_lengths(self.points.crs)):
            log.warning("%s", text)

    def _packed(
        self, outlines: Sequence[Outline], others: Sequence[Outline], cells: CellGrid | None = None
    ) -> ShorelineExtract.Outputs:
        from algorithms.shoreline._outline import detail_of
        from algorithms.shoreline._water import NARROW

        crs = self.points.crs
        polygons = [feature for o in outlines for feature in o.rows()]
        lines = [feature for o in outlines for feature in o.lines()]
        corners = [feature for o in outlines for feature in o.corners()]
        beside = [feature for o in others for feature in o.lines()]
        first = outlines[0].water.level if outlines else None
        return self.Outputs(
            water=_layer(polygons, crs, "Polygon Z", WATER),
            shoreline=_layer(lines, crs, "LineString Z", SHORELINE),
            vertices=_layer(corners, crs, "Point Z", columns.VERTICES),
            other_waters=_layer(beside, crs, "LineString Z", SHORELINE),
            other_bodies=_layer([f for o in others for f in o.rows()], crs, "Polygon Z", WATER),
            level=first.height if first else None,
            level_error=first.error if first else None,
            level_interval=first.interval if first else None,
            area=sum(shape.area for shape, _ in polygons),
            count=len(outlines),
            detail=detail_of(cells) if cells else None,
            least_area=self.min_area,
            narrowest=NARROW * cells.lattice.cell if cells else None,
        )


def _takes_rivers() -> str:
    """Text on the setting that takes rivers, if the user may set it."""
    setting = setting_name("sloped")
    return f": the setting {setting} takes rivers" if setting else ""


def _within(place: Position, bounds: Sequence[float]) -> bool:
    """Whether a position is within bounds: least x, y and z, greatest x, y and z."""
    return bounds[0] <= place.x <= bounds[3] and bounds[1] <= place.y <= bounds[4]


def open_edges(rows: Sequence[Row], unit: Unit | None = None) -> str:
    """Text on the waters of which a part of the outline is no shore; "" if there are none.

    Parameters
    ----------
    rows : of outlines, lengths in metres
    unit : of the data, in which lengths are told, too

    Examples
    --------
    >>> open_edges([{"body": 3, "open_length": 51.0, "perimeter": 265.0}])
    'water body 3: 51 m of 265 m of its outline is the edge of the data, not a shore'
    """
    from algorithms.shoreline._water import some_of

    of_body: dict[int, list[Row]] = {}
    for row in rows:
        if row["open_length"]:
            of_body.setdefault(row["body"], []).append(row)
    sums = {
        body: [sum(part[name] for part in parts) for name in ("open_length", "perimeter")]
        for body, parts in of_body.items()
    }
    said = {
        body: [f"{size:.0f} m{own_unit(size, unit)}" for size in sizes]
        for body, sizes in sums.items()
    }
    if len(said) == 1:
        ((body, (cut, whole)),) = said.items()
        return (
            f"water body {body}: {cut} of {whole} of its outline is the edge of the data, not a "
            "shore"
        )
    each = [f"body {body}, {cut} of {whole}" for body, (cut, whole) in said.items()]
    return (
        f"{len(sums)} water bodies meet the edge of the data, where their outlines are no shore: "
        f"{some_of(each)}"
        if each
        else ""
    )


def _layer(
    features: Sequence[tuple[Any, Row]], crs: Any, kind: str, names: Mapping[str, Any]
) -> Vector:
    """A layer of features; without any it has the same attributes."""
    import geopandas  # of which a model that looks for no water has no need
    import pandas as pd

    rows = pd.DataFrame([row for _, row in features], columns=list(names))
    if not features:
        rows = rows.astype({name: OTHER_TYPES.get(name, float) for name in names})
    frame = geopandas.GeoDataFrame(rows, geometry=[shape for shape, _ in features], crs=crs)
    return Vector(frame, geometry_type=kind)
