"""Windows and doors of house fronts, and the points seen through them.

How openings are told from shadows and panels, and how exact their edges are:
docs/explanation/planes.md.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

import geopandas
import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from algorithms.planes import _columns as columns
from algorithms.planes import _parameters as options
from algorithms.planes._fronts import DECISIVE, STOREY, UPRIGHT, Front, fronts_of, outside, turn
from algorithms.planes._gaps import too_large
from algorithms.planes._openings import (
    BLIND,
    COLUMNS,
    EITHER,
    OF_TWO,
    Openings,
    marked,
    may_hide_door,
    openings,
)
from algorithms.planes._outlines import View, drawn
from algorithms.planes._relief import Relief, relief_of
from algorithms.planes._screen import Screen
from algorithms.planes._segment import parts_of
from algorithms.planes._shades import by_chance
from algorithms.planes._strips import crossed
from algorithms.shared.plane_fit import Plane
from algorithms.shared.plane_numbers import plane_numbers
from toolbox.context import QUIET, Context, log, setting_name
from toolbox.data import PointCloud, Vector
from toolbox.data.crs import local_like
from toolbox.declare import Attribute, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

POINTS_ACROSS = 4  # points in a row that an opening needs to be told from a gap between points
NOISY = 2.0  # least step that can be seen over the one that is asked for, from which on it is told
TWICE = 0.3  # share of a wall with another before or behind it: 0.12 at most on single ones
TALL = 1.5  # height over width, of the largest opening
APART = STOREY  # metres between two fronts of an elevation
BENT = (
    5.0  # degrees that planes of a front turn along it, from which on it is told: 0.1 on flat ones
)
MUCH_UNSEEN = 0.1  # share of a front without points of its wall, from which on it is told

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@tool(
    "planes.openings",
    title="Find windows and doors",
    tags=(
        "facade",
        "window",
        "door",
        "opening",
        "wall",
    ),
)
class PlanesOpenings:
    """Find the windows and doors of house fronts, and the points seen through them.

    The points are those of planes.extract, with plane_id. All fronts are looked at, or that of
    `plane`: an upright plane, at least 2.5 m wide and high, and the planes parallel to it within
    `front_depth`. Planes wider than `max_width` are wall, those in the depth of one that is, and
    panels with the intensity of the wall that have openings of their own. Bands of windows, with
    wall above and below, may be wider: what is seen in them sends back less than the wall, or is
    deeper than `recess`.

    Where something stands back from the wall around it, by `min_recess` or what the noise allows,
    is an opening: a pane, a door, goods, a curtain. It has to fill most of a level rectangle, or
    have a clear outline of another form, and wall beside it. A gap in which nothing is seen may be
    a shadow of what stands in front, or a dark room: it is an opening if wall lies on all sides of
    a level rectangle and a side has a reveal, or if two others lie in its row and one in its
    column, with the same sides. A recess whose back is as flat and as bright as the wall beside it
    is a blind niche, and no opening; where it is nearly as bright, the certainty is half.

    `found_by` says what tells: recess (something no farther back than `recess`), behind (farther),
    reflectance (it is not that of the wall beside), outline (nothing is seen in it), grid (its
    sides are in line with those of another one). `certainty`, from 0 to 1, is how much of the
    opening, as far as it is seen, is not wall, and how much of its sides has wall beside it; it is
    0.5 at most where three sides are unsure or were not seen, and 0.25 where four are, or three
    were not seen, or neither end of its width or height was. It is half where the width or height
    is below 1.25 times `min_width`, as pieces of something larger are. Gaps that were looked at
    and are no openings are in `dropped`, with the reason. Intensity that points side by side do
    not share is not used.

    A strip without points over the height of a front, or higher than an opening may be, is in the
    shadow of a post or a tree. One no wider than a quarter of `max_width` may cross an opening,
    or hide the pier between two: it is one, with half the certainty, if the whole is as wide as
    another opening of the front and the parts are not; two the other way round; else the parts stay
    with half the certainty. Of those that end at a strip wider than themselves more may be hidden
    than is seen: half as well.

    Each edge of a rectangle is where 95 of 100 rows of points end, but for those that go on alone,
    on the wall or no farther before it than `recess`, as on frames, timber and sills. Where
    something stands farther in front, such as a balcony, the gap ends at its shadow. An edge is
    seen where points lie on both sides: on the wall outside, and behind it inside, no farther away
    than `recess` or what their density tells. `edge_seen` is the share of the outline that is, and
    `hidden` names the sides of a rectangle of which less than half is, or beside which half of the
    rows of points of the wall are missing. They may be elsewhere. Of the others `left_interval` and
    so on say how sure they are (95 %), by the distance of the points and how evenly their rows end
    there; `unsure` names those at which they do not.

    A door is at least 1.8 m high and begins at most 0.3 m above the foot of the wall. An opening
    that begins below 0.8 m, and whose lower side was not seen, may be either: `door or window`,
    with half the certainty.

    Points farther behind the wall than `recess` and within its outline were seen through an
    opening. They get the number of the nearest in opening_id, and `behind` 1; planes of which they
    are more than half, such as curtains, are given up: plane_id becomes 0. Points of panes, doors
    and reveals have opening_id, and keep their plane.

    The elevation shows each front and its openings in its own coordinates, to the right and upwards
    from its lower left corner, one front beside the other. Where each is in space stands in the
    attributes of its facade: corner is the place of (0, 0), right and up are the directions. Parts
    of a front without points of its wall and without an opening are `unseen`: there may be none.
    """

    points: PointCloud = source("Points with the number of their plane")
    attribute: Attribute = param(
        "Attribute with the number of the plane", default=Attribute("plane_id"), of="points"
    )
    plane: int | None = param(
        "Number of a plane of the front that is looked at; all fronts unless given",
        default=None,
        unit="1",
        ge=1,
    )
    min_width: float = param(
        "Least width and height of an opening", default=0.4, unit="m", gt=0, label="Smallest width"
    )
    max_width: float = param(
        "Largest width of an opening that is no band of windows",
        default=4.0,
        unit="m",
        gt=0,
        label="Largest width",
    )
    min_points: int = param(
        "Fewest points behind an opening", default=5, unit="1", ge=1, label="Fewest points behind"
    )
    recess: float = param(
        "Farthest that panes and doors lie behind the facade",
        default=0.25,
        unit="m",
        gt=0,
        label="Deepest recess",
    )
    min_recess: float = param(
        "Least depth behind the wall of what is in an opening",
        default=0.02,
        unit="m",
        gt=0,
        label="Least recess",
    )
    front_depth: float = options.front_depth()
    depth: float = param(
        "Farthest behind that is looked at", default=5.0, unit="m", gt=0, label="Depth looked at"
    )

    @outputs
    class Outputs:
        cleaned: PointCloud = sink(
            "The points with plane_id, opening_id and behind",
            show=show.Planes("plane_id"),
            label="Points with openings",
        )
        openings: Vector = sink(
            "Outline of each opening in space, with its size and what it is",
            show=show.Classes("kind", columns.LOOKS),
            columns=columns.OPENINGS,
        )
        elevation: Vector = sink(
            "Each front and its openings, in its own coordinates",
            show=show.Classes("kind", columns.LOOKS, apart=True),
            also=(".ifc",),
            listed=False,
            columns=columns.ELEVATION,
            label="Elevation of fronts",
        )
        dropped: Vector = sink(
            "Gaps that are no openings, with the reason", columns=columns.DROPPED
        )
        planes: Vector = sink("Outlines of the planes that are left")
        count: int = sink("Openings", unit="1")
        fronts: int = sink("Fronts that were looked at", unit="1")
        dropped_count: int = sink("Gaps that are no openings", unit="1")
        behind: int = sink("Points seen through openings", unit="1")
        given_up: int = sink("Planes that were seen through openings", unit="1")

        def in_words(self) -> str:
            """How many openings in how many fronts, and how sure their edges are."""
            told = (
                f"Openings: {self.count}, in {self.fronts} front{'s'[: self.fronts != 1]}; other "
                f"gaps, which are no openings, each with its reason in the layer dropped: "
                f"{self.dropped_count}."
            )
            return f"{told} {self._edges()}" if self.count else told

        def _edges(self) -> str:
            """How sure the edges are, in metres, and how many are not."""
            frame = self.openings.frame
            every = len(columns.SIDES) * len(frame)
            sides = {
                name: sum(len(text.split(", ")) for text in frame[name] if text)
                for name in ("unsure", "hidden")
            }
            usual = columns.usual_interval(frame) / self.openings.metre
            half = f"± {usual:.2f} m" if math.isfinite(usual) else "± of no known length"
            return (
                f"Edges are known to {half} (95 %, the median of those that were seen). Sides that "
                f"are unsure: {sides['unsure']} of {every}; that were not seen and may be "
                f"elsewhere: {sides['hidden']}. They are named in the table, where sizes up to "
                "them say ca., and broken lines with a star in the drawing."
            )

    def check(self) -> Iterator[tuple[str, str]]:
        """The width limits are in order."""
        if self.max_width < self.min_width:
            yield "max_width", f"is below min_width, {self.min_width:g}"

    def halo(self) -> float:
        """Infinite, as a facade is of any size."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PlanesOpenings.Outputs:
        """Find the gaps of each front, look what is in them, and mark the points behind."""
        cloud = self.points
        ids = plane_numbers(cloud, self.attribute)
        if negative := int(np.sum(ids < 0)):
            raise DataError(
                f"points: {self.attribute} is below 0 at {negative} points; planes must be "
                "numbered from 1, with 0 for none, as by planes.extract"
            )
        seen = self._fronts(ids, ctx)
        opening, behind = np.zeros(len(cloud), np.int32), np.zeros(len(cloud), bool)
        walls = np.zeros(len(cloud), bool)
        for one in seen:
            walls[one.near[one.relief.own]] = True
        before = 0
        for one in seen:
            numbers, through = marked(
                one.relief, one.made, self.recess, self.depth, walls[one.near]
            )
            free = (numbers > 0) & (opening[one.near] == 0)
            opening[one.near[free]] = numbers[free] + before
            behind[one.near[through]] = True
            before += len(one.made.found)
        lost = np.unique(ids[behind & (ids > 0)])
        sizes = {k: int((ids == k).sum()) for k in lost.tolist()}
        given_up = [k for k, size in sizes.items() if 2 * int((behind & (ids == k)).sum()) > size]
        kept = np.where(behind | np.isin(ids, given_up), 0, ids).astype(np.int32)
        ctx.progress(0.7)
        columns: dict[str, NDArray[Any]] = {
            str(self.attribute): kept,
            "opening_id": opening,
            "behind": behind.astype(np.uint8),
        }
        notes = {"opening_id": "0 of none", "behind": "1 seen through an opening"}
        cleaned = cloud.with_attributes(columns, descriptions=notes)
        layer, elevation, dropped = self._layers(seen)
        number_of_fronts = len(seen)
        del seen, opening, ids  # outlines need much memory
        planes = self._planes(kept, ctx.part(0.7, 1.0))
        ctx.progress(1.0)
        return self.Outputs(
            cleaned=cleaned,
            openings=layer,
            elevation=elevation,
            dropped=dropped,
            planes=planes,
            count=len(layer),
            fronts=number_of_fronts,
            dropped_count=len(dropped),
            behind=int((behind & cloud.core).sum()),
            given_up=len(given_up),
        )

    def _fronts(self, ids: Ints, ctx: Context) -> list[_Seen]:
        """The fronts that are looked at, with their openings."""
        cloud = self.points
        numbers, counts = np.unique(ids[ids > 0], return_counts=True)
        numbers = numbers[counts >= 3]
        ranks = np.zeros(len(ids), np.int32)
        some = np.isin(ids, numbers)
        ranks[some] = np.searchsorted(numbers, ids[some]) + 1
        planes = [fitted(cloud.xyz[part]) for part in parts_of(ranks, len(numbers))]
        fronts = self._chosen(ranks, numbers, planes)
        shades = self._shades(some)
        seen = []
        for number, front in enumerate(fronts):
            part = ctx.part(0.6 * number / len(fronts), 0.6 * (number + 1) / len(fronts))
            sides = (front,) if front.sided else (front, front.turned())
            steps = [part.part(k / len(sides), (k + 1) / len(sides)) for k in range(len(sides))]
            near = _near(cloud.xyz, ranks, front, max(self.depth, self.front_depth))
            shade = None if shades is None else shades[near]
            looks = [
                self._looked_at(side, near, ranks, numbers, shade, step)
                for side, step in zip(sides, steps, strict=True)
            ]
            one = looks[-1] if looks[-1].sure_area > DECISIVE * looks[0].sure_area else looks[0]
            seen.append(one)
            relief, made = one.relief, one.made
            self._warn_of_side(number + 1, front.sided, made)
            self._warn_if_bent(number + 1, turn(front, planes, np.bincount(ranks)[1:]))
            self._warn_if_sparse(number + 1, one.spacing)
            self._warn_if_noisy(number + 1, relief.step / cloud.metre)
            self._warn_if_two_sided(number + 1, relief.twice())
            self._warn_of_screen(number + 1, relief.screen)
            self._warn_of_strips(number + 1, made)
            self._warn_of_unseen(number + 1, made)
            self._warn_of_wide(number + 1, made)
            self._warn_of_blind(number + 1, made)
            self._warn_of_either(number + 1, relief, made)
            self._warn_of_glass(number + 1, [int(numbers[k]) for k in relief.glass])
        if not any(one.made.found for one in seen):
            self._warn_of_none([gap.dropped for one in seen for gap in one.made.dropped], seen)
        return seen

    def _looked_at(
        self,
        front: Front,
        near: Ints,
        ranks: NDArray[np.int32],
        numbers: Ints,
        shade: Floats | None,
        ctx: Context,
    ) -> _Seen:
        """A front with its openings among the points near it, from the side its plane points to."""
        cloud = self.points
        widest = max(self.max_width, STOREY * cloud.metre)
        relief = relief_of(
            cloud.xyz[near],
            ranks[near],
            front,
            shade,
            largest=(widest, TALL * widest),
            recess=self.recess,
            depth=self.depth,
            least=self.min_recess,
            front_depth=self.front_depth,
            metre=cloud.metre,
        )
        made = openings(
            relief,
            shade,
            min_width=self.min_width,
            max_width=self.max_width,
            tallest=TALL * widest,
            fewest=self.min_points,
            recess=self.recess,
            depth=self.depth,
            ctx=ctx,
        )
        return _Seen(int(numbers[front.members[0]]), near, relief, made)

    def _shades(self, some: NDArray[np.bool_]) -> Floats | None:
        """Logarithm of the intensity of the points, if it tells anything of those on planes."""
        cloud = self.points
        if "intensity" not in cloud or np.ptp(cloud["intensity"]) == 0:
            return None
        shades: Floats = np.log1p(np.asarray(cloud["intensity"], float))
        if not by_chance(shades[some], cloud.xyz[some]):
            return shades
        log.warning(
            "the intensity of the points tells nothing, as those side by side differ in it as much "
            "as any two: openings are looked for as without it"
        )
        return None

    def _warn_of_none(self, reasons: list[str], seen: list[_Seen]) -> None:
        """Say so where no gap is an opening, and why."""
        names = ", ".join(str(one.number) for one in seen)
        if not reasons:
            log.warning(
                "the front of plane %s has no openings, as its wall has no gaps; of a curtain wall "
                "with much seen on its glass, give the points of its frames alone "
                "(points.filter_intensity)",
                names,
            )
            return
        reason, count = Counter(reasons).most_common(1)[0]
        sizes = [name for name in map(setting_name, ("min_width", "min_points")) if name]
        smaller = f"; smaller ones are looked for with {' and '.join(sizes)}" if sizes else ""
        log.warning(
            "the front of plane %s has no openings; most gaps are: %s (%d of %d), and the layer "
            "dropped has where%s; of a curtain wall with much seen on its glass, give the points "
            "of its frames alone (points.filter_intensity)",
            names,
            reason,
            count,
            len(reasons),
            smaller,
        )

    def _warn_of_side(self, number: int, sided: bool, made: Openings) -> None:
        """Say so where a front with gaps may be drawn from behind, as nothing tells its outside."""
        if not sided and (made.found or made.dropped):
            log.warning(
                "from which side front %d was seen is not told by ground before it, nor by what "
                "stands back in its gaps: it is drawn as seen from where more openings are, and "
                "may be drawn from behind, left for right, with openings missed; give points of "
                "the street with it",
                number,
            )

    def _warn_of_wide(self, number: int, made: Openings) -> None:
        """Say so where gaps are no openings for their size alone."""
        large = [gap.shape.bounds for gap in made.dropped if too_large(gap)]
        sizes = [np.ptp(np.reshape(bounds, (2, 2)), axis=0) for bounds in large]
        sizes = [size for size in sizes if size.min() >= self.min_width]  # no strips
        if not sizes:
            return
        width, height = max(sizes, key=lambda size: float(size.prod())) / self.points.metre
        setting = setting_name("max_width")
        log.warning(
            "gaps of front %d that are too large for openings, of clear form and with wall beside: "
            "%d, the largest about %.1f m wide and %.1f m high; the layer dropped has where%s",
            number,
            len(sizes),
            width,
            height,
            f"; larger ones are looked for with {setting}" if setting else "",
        )

    def _warn_if_bent(self, number: int, degrees: float) -> None:
        """Say so where a front is on a curve, of which a plane holds a piece alone."""
        if degrees > BENT:
            log.warning(
                "the planes of front %d turn by %.0f degrees along it, as on a curve: openings of "
                "parts that slant may be missed, and widths are short; give pieces of it, cut with "
                "points.clip",
                number,
                degrees,
            )

    def _warn_if_sparse(self, number: int, spacing: float) -> None:
        """Say so where points of a wall are too far apart for the openings that are asked for."""
        metres, min_width = spacing / self.points.metre, self.min_width / self.points.metre
        if metres * POINTS_ACROSS > min_width:
            log.warning(
                "the points of front %d are %.2f m apart: openings narrower than %.1f m cannot be "
                "told, wider ones may be missed or of another size, and no edge is surer than "
                "%.2f m; a drawing needs points %.2g m apart",
                number,
                metres,
                metres * POINTS_ACROSS,
                metres,
                min_width / POINTS_ACROSS,
            )

    def _warn_if_noisy(self, number: int, step: float) -> None:
        """Say so where points of a wall scatter so much that the least step is not seen.

        Parameters
        ----------
        step : least distance behind the wall that its own points do not have, in metres
        """
        min_recess = self.min_recess / self.points.metre
        if step > NOISY * min_recess:
            log.warning(
                "the points of front %d scatter about its wall: only what stands back by %.2f m or "
                "more is told from it, not by the %g m that openings are looked for with; those "
                "with panes nearer to the wall may be missed, and others may be none",
                number,
                step,
                min_recess,
            )

    def _warn_of_unseen(self, number: int, made: Openings) -> None:
        """Say so where much of what is drawn as wall has no points."""
        area = sum(part.area for part in made.unseen)
        whole = shapely.union_all([made.wall, *(one.shape for one in made.found)]).area
        if area > MUCH_UNSEEN * whole:
            log.warning(
                "%.0f %% of front %d, %.1f m2, has neither points of its wall nor an opening: air, "
                "something that stands before it, or a gap that is none; the elevation has these "
                "parts as unseen",
                100 * area / whole,
                number,
                area / self.points.metre**2,
            )
        doors = [part for part in made.unseen if may_hide_door(part, made.wall, self.points.metre)]
        if doors:
            log.warning(
                "parts of front %d not seen that are as large as a door and as low: %d, from %s m "
                "on from its left end; each may hide one: look there",
                number,
                len(doors),
                ", ".join(
                    f"{(part.bounds[0] - made.wall.bounds[0]) / self.points.metre:.1f}"
                    for part in sorted(doors, key=lambda part: float(part.bounds[0]))
                ),
            )
            log.info("merge a scan that sees these parts of front %d, if there is one", number)

    def _warn_of_blind(self, number: int, made: Openings) -> None:
        """Say so where recesses are taken for wall, since shutters may be as bright and flat."""
        blind = sum(gap.dropped == BLIND for gap in made.dropped)
        if blind:
            log.warning(
                "recesses of front %d with wall at their back, no openings: %d; shutters as bright "
                "as the wall look the same; dropped has their places",
                number,
                blind,
            )
        if maybe := sum(one.niche for one in made.found):
            log.warning(
                "openings of front %d that may be blind niches: %d; their back is as flat as the "
                "wall and nearly as bright, as a painted niche or a closed shutter is: look there; "
                "certainty is half",
                number,
                maybe,
            )

    def _warn_of_screen(self, number: int, screen: Screen) -> None:
        """Say so where a scaffold or the like stands before a front."""
        if screen.share:
            log.warning(
                "something stands %.1f m before front %d over %.0f %% of its width, as scaffolds "
                "and nets do: openings behind it may be missed, or parts of larger ones; their "
                "certainty is half",
                screen.depth / self.points.metre,
                number,
                100 * screen.share,
            )

    def _warn_of_strips(self, number: int, made: Openings) -> None:
        """Say so where posts or trees hide strips of a front over its whole height."""
        from_left = (made.strips[:, 0] - made.wall.bounds[0]) / self.points.metre
        from_left = from_left[from_left >= 0]  # one beside its end is no part of it
        if not len(from_left):
            return
        log.warning(
            "strips of front %d without points over its height, as in the shadow of a post or a "
            "tree, or a slit or passage as high: %d, from %s m on from its left end",
            number,
            len(from_left),
            ", ".join(f"{left:.1f}" for left in from_left),
        )
        if parted := sum(bool(crossed(one.shape, made.strips).any()) for one in made.found):
            log.warning(
                "openings of front %d that these strips cross: %d, each taken for one though it "
                "may be two, with half the certainty",
                number,
                parted,
            )
        log.info("merge a scan that sees these strips of front %d, if there is one", number)

    def _warn_of_glass(self, number: int, planes: list[int]) -> None:
        """Say so where large planes are taken for panes, not for wall."""
        if planes:
            log.warning(
                "front %d is a curtain wall: plane %s is taken for glass between frames, and the "
                "panels between these for openings",
                number,
                ", ".join(map(str, planes)),
            )

    def _warn_of_either(self, number: int, relief: Relief, made: Openings) -> None:
        """Say so where what stands before openings hides whether they are doors."""
        kinds = [one.row(relief, self.points.metre)["kind"] for one in made.found]
        if either := kinds.count(EITHER):
            log.warning(
                "openings of front %d whose foot was not seen, doors or windows: %d; look there",
                number,
                either,
            )
            log.info("merge a scan that sees their foot on front %d, if there is one", number)

    def _warn_if_two_sided(self, number: int, share: float) -> None:
        """Say so where a wall stands before another one, which nobody sees from one side."""
        if share > TWICE:
            log.warning(
                "%.0f %% of front %d has two walls, one behind the other: scanned from both sides, "
                "or two buildings; openings through both may be missed, and depths are of either; "
                "give the points of one side alone",
                100 * share,
                number,
            )

    def _chosen(self, ranks: NDArray[np.int32], numbers: Ints, planes: list[Plane]) -> list[Front]:
        """The fronts that are looked at: all, or that of one plane."""
        xyz, metre = self.points.xyz, self.points.metre
        if self.plane is not None and self.plane not in numbers:
            raise DataError(f"points: none is on plane {self.plane} by {self.attribute}")
        fronts = fronts_of(xyz, ranks, planes, depth=self.front_depth, metre=metre)
        upright = [k for k, plane in enumerate(planes) if abs(plane.normal[2]) <= UPRIGHT]
        if self.plane is not None:
            alone = int(np.searchsorted(numbers, self.plane))
            fronts = [front for front in fronts if alone in front.members]
        elif not fronts:
            sizes = np.bincount(ranks, minlength=len(planes) + 1)[1:]
            if not upright:
                raise DataError(
                    f"points: no plane of {self.attribute} is upright, so there is no front: "
                    "are they a scan of a building?"
                )
            alone = max(upright, key=lambda k: int(sizes[k]))
            log.warning(
                "no upright plane is %g m wide and high, as a front of a building is: plane %d, "
                "the largest, is looked at alone, as front 1, and the others, %d in all, are in no "
                "elevation",
                STOREY,
                numbers[alone],
                len(planes) - 1,
            )
        if not fronts:
            others = np.isin(ranks, [k + 1 for k in upright if k != alone])
            own = np.flatnonzero(ranks == alone + 1)
            outwards, sided = outside(xyz, planes[alone], own, metre, others)
            fronts = [Front(outwards, [alone], np.zeros(1), sided)]
        return fronts

    def _layers(self, seen: list[_Seen]) -> tuple[Vector, Vector, Vector]:
        """Openings in space, fronts and openings in their coordinates, gaps that were dropped."""
        metre = self.points.metre
        rows: list[dict[str, Any]] = []
        shown: list[dict[str, Any]] = []
        solid, flat, reasons, gaps = [], [], [], []
        aside = 0.0
        for front_id, one in enumerate(seen, start=1):
            shapes = [opening.shape for opening in one.made.found]
            wall = one.made.wall
            left, _, right, _ = wall.bounds
            shift = np.array([aside - left if front_id > 1 else 0.0, 0.0])
            hole = shapely.difference(wall, shapely.union_all(shapes)) if shapes else wall
            whole = {"opening_id": 0, "kind": "facade", "plane_id": one.number}
            whole |= {"spacing": one.spacing}
            shown.append(whole | {"front_id": front_id} | _place(one.relief.view, shift))
            flat.append(_moved(hole, shift))
            for opening in one.made.found:
                row: dict[str, Any] = {"opening_id": len(rows) + 1, "front_id": front_id}
                row |= opening.row(one.relief, metre)
                row["certainty"] *= told_of(opening.shape, one.spacing)
                left, _, right, _ = opening.shape.bounds
                row["certainty"] *= OF_TWO if one.relief.screen.hides(left, right) else 1.0
                rows.append(row)
                shown.append(row)
                solid.append(one.relief.view.raised(opening.shape))
                flat.append(_moved(opening.shape, shift))
            for part in one.made.unseen:
                shown.append({"opening_id": 0, "front_id": front_id, "kind": columns.UNSEEN})
                flat.append(_moved(part, shift))
            for gap in one.made.dropped:
                reasons.append({"front_id": front_id, "reason": gap.dropped})
                gaps.append(one.relief.view.raised(shapely.box(*gap.shape.bounds)))
            aside = right + shift[0] + APART * metre
        crs = self.points.crs
        names = ["opening_id", "front_id", *COLUMNS]
        both = pd.DataFrame(shown)
        both = both.reindex(columns=list(dict.fromkeys([*both, *names])))  # also without openings
        layers = (
            geopandas.GeoDataFrame(rows, columns=names, geometry=solid, crs=crs),
            geopandas.GeoDataFrame(both, geometry=flat, crs=local_like(crs)),
            geopandas.GeoDataFrame(reasons, columns=["front_id", "reason"], geometry=gaps, crs=crs),
        )
        return (
            Vector(layers[0], name="openings", geometry_type="Polygon Z"),
            Vector(layers[1], name="elevation", geometry_type="Polygon"),
            Vector(layers[2], name="dropped", geometry_type="Polygon Z"),
        )

    def _planes(self, ids: NDArray[np.int32], ctx: Context) -> Vector:
        """Outlines of the remaining planes, which keep their numbers."""
        xyz = self.points.xyz
        numbers, rank = np.unique(np.append(ids, 0), return_inverse=True)
        ranks = np.asarray(rank[:-1], np.int32)
        planes = [fitted(xyz[part]) for part in parts_of(ranks, len(numbers) - 1)]
        frame = drawn(xyz, ranks, planes, self.min_width / 2, ctx)
        frame["plane_id"] = numbers[1:]
        return Vector(frame.set_crs(self.points.crs), name="planes", geometry_type="Polygon Z")


class _Seen(NamedTuple):
    """A front that was looked at: number of its largest plane, points near it, and its openings."""

    number: int
    near: Ints
    relief: Relief
    made: Openings

    @property
    def sure_area(self) -> float:
        """Area of its openings, each as far as it is sure: none from behind a wall."""
        return sum(one.certainty * float(one.shape.area) for one in self.made.found)

    @property
    def spacing(self) -> float:
        """Distance from one point on the wall to the next, in the unit of the points.

        Of a wall too sparse to have an outline that of its neighbours is the larger one.
        """
        walls = int(np.count_nonzero(self.relief.own))
        bare = self.made.wall.area - sum(one.shape.area for one in self.made.found)
        return max(math.sqrt(max(bare, 0.0) / max(walls, 1)), self.relief.apart)


def told_of(shape: Any, spacing: float) -> float:
    """How far points tell an opening from a gap between points, 0 to 1: as many lie across it.

    Parameters
    ----------
    shape : its outline
    spacing : from one point to the next, in the same unit

    Examples
    --------
    >>> told_of(shapely.box(0, 0, 3, 2), 0.1), told_of(shapely.box(0, 0, 3, 1), 0.5)
    (1.0, 0.5)
    """
    left, bottom, right, top = shape.bounds
    least = POINTS_ACROSS * spacing
    return float(min(1.0, min(right - left, top - bottom) / least)) if least > 0 else 1.0


def _place(view: View, shift: Floats) -> dict[str, float]:
    """Where a front of the elevation is in space: its corner, and its directions right and up."""
    vectors = {"corner": view.solid(-shift[None])[0], "right": view.axes[0], "up": view.axes[1]}
    return {f"{n}_{axis}": float(v[k]) for n, v in vectors.items() for k, axis in enumerate("xyz")}


def _moved(shape: Any, shift: Floats) -> Any:
    return shapely.transform(shape, lambda uv: uv + shift)


def _near(xyz: Floats, ranks: NDArray[np.int32], front: Front, depth: float) -> Ints:
    """Indices of the points no farther than the depth from a front and from the box around it."""
    own = xyz[np.isin(ranks, np.array(front.members) + 1)]
    near = np.abs(front.plane.distances(xyz)) <= depth
    near &= (xyz >= own.min(axis=0) - depth).all(axis=1)
    near &= (xyz <= own.max(axis=0) + depth).all(axis=1)
    return np.flatnonzero(near)


def fitted(xyz: Floats) -> Plane:
    """Least-squares plane through points of shape (n, 3)."""
    origin = xyz[0].copy()
    near = xyz - origin
    centre = near.mean(axis=0)
    near -= centre
    return Plane(np.linalg.eigh(near.T @ near)[1][:, 0], centre, origin)
