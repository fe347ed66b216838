"""A scene of a preset while it is built: what stands and hangs in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from algorithms.samples._corridor.catenary import Catenary, placed
from algorithms.samples._corridor.routes import Route
from algorithms.samples._objects import SceneBuilder
from algorithms.samples._survey import ROD, WIRE, Features, Floats, Records

OVERHEAD = 19  # ASPRS: overhead structure, which is no power line
Area = shapely.Polygon | shapely.MultiPolygon
Place = tuple[float, float, float]
BAR = 0.1  # radius of bars, with half a footprint of the laser, m


def rods(
    ends: Floats,
    radius: float,
    cls: int,
    owner: int,
    *,
    wire: int = 0,
    span: int = 0,
    tower: int = 0,
) -> Records:
    """The rods between successive points of an array of shape (n, 3)."""
    made = np.zeros(len(ends) - 1, ROD)
    for k, name in enumerate("xyz"):
        made[f"{name}1"], made[f"{name}2"] = ends[:-1, k], ends[1:, k]
    made["radius"], made["cls"], made["object_id"] = radius, cls, owner
    made["wire_id"], made["span_id"], made["tower_id"] = wire, span, tower
    return made


@dataclass(frozen=True)
class Frame:
    """Axes of a structure: u to the left of the line, v along it, h up from its foot."""

    site: Site
    x: float
    y: float
    ground: float
    left: Floats  # unit vector
    owner: int
    cls: int
    tower: int = 0

    def at(self, u: float, v: float, h: float) -> Floats:
        """Position in the scene."""
        x, y = np.array([self.x, self.y]) + u * self.left + v * self._ahead
        return np.array([x, y, self.ground + h])

    def foot(self, u: float, v: float) -> Floats:
        """Position on the ground."""
        x, y, _ = self.at(u, v, 0.0)
        return np.array([x, y, float(self.site.builder.terrain.at(x, y))])

    def bar(self, *points: Floats, radius: float = BAR) -> None:
        """Add rods from point to point."""
        self.site.rods.append(
            rods(np.array(points), radius, self.cls, self.owner, tower=self.tower)
        )

    @property
    def _ahead(self) -> Floats:
        return np.array([self.left[1], -self.left[0]])


@dataclass(frozen=True)
class Support:
    """Where wires are held: its foot, its height, and the direction of its arms."""

    tower_id: int
    object_id: int
    x: float
    y: float
    ground: float
    height: float
    left: Floats
    tension: bool  # wires pull at their strings instead of hanging from them


@dataclass(frozen=True)
class Wire:
    """One wire of one span, and what is recorded of it.

    Attributes
    ----------
    seen : shares of its span between which points are recorded, array of shape (n, 2)
    towers : numbers of the supports at its ends, 0 for a house
    """

    curve: Catenary
    cls: int
    owner: int
    wire_id: int
    span_id: int
    line: str
    towers: tuple[int, int]
    seen: Floats

    def points(self, step: float, swing: float = 0.0) -> Floats:
        """Positions along it at about `step` metres, blown to the left by an angle in radians."""
        places = self.curve.points(step)
        share = np.linspace(0, 1, len(places))
        chord = places[0, 2] + share * (places[-1, 2] - places[0, 2])
        hang = chord - places[:, 2]
        ahead = (places[-1] - places[0])[:2]
        left = np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead)
        places[:, :2] += np.outer(hang * np.sin(swing), left)
        places[:, 2] = chord - hang * np.cos(swing)
        return places

    @property
    def step(self) -> float:
        """Length of rods that leave the wire by less than 3 mm, m."""
        return float(np.clip(np.sqrt(0.024 * self.curve.c), 1.0, 8.0))

    def rods(self, radius: float, swing: float) -> list[Records]:
        """What a strip records of it."""
        places = self.points(self.step, swing)
        share = np.linspace(0, 1, len(places))
        made = []
        for first, last in self.seen:
            inner = places[(share >= first) & (share <= last)]
            if len(inner) > 1:
                ids = {"wire": self.wire_id, "span": self.span_id}
                made.append(rods(inner, radius, self.cls, self.owner, **ids))
        return made


@dataclass
class Site:
    """The objects of a scene, and the counters that number them.

    Attributes
    ----------
    route : the axis, along which everything is placed
    area : what the survey covers, in scene coordinates
    half : distance from the axis as far as which it does, metres
    hidden : share of each wire of which no point is recorded
    clearings : along what no woods grow
    """

    builder: SceneBuilder
    route: Route
    area: Area
    half: float
    hidden: float = 0.0
    clearings: list[shapely.Geometry] = field(default_factory=list)
    rods: list[Records] = field(default_factory=list)
    wires: list[Wire] = field(default_factory=list)
    features: Features = field(default_factory=list)
    towers: int = 0
    wire_ids: int = 0
    spans: int = 0

    @property
    def rng(self) -> np.random.Generator:
        return self.builder.rng

    def hang(
        self,
        curve: Catenary,
        cls: int,
        wire: int,
        line: str,
        towers: tuple[int, int],
    ) -> Wire:
        """Add a wire in the span that was begun last."""
        owner = self.builder.new_object()
        seen = _seen(curve.span, self.hidden, self.rng)
        made = Wire(curve, cls, owner, wire, self.spans, line, towers, seen)
        self.wires.append(made)
        return made

    def drop(self, start: Place, end: Place, c: float, tower: int) -> None:
        """Add a wire from a pole to a house, which is a span of its own."""
        self.spans += 1
        self.wire_ids += 1
        self.hang(Catenary(start, end, c), WIRE, self.wire_ids, "service drop", (tower, 0))

    def tell_of_tower(self, support: Support, kind: str) -> None:
        """Feature of a support: an upright line from its foot to its top."""
        foot = np.array([support.x, support.y, support.ground])
        properties = {
            "kind": "tower",
            "object_id": support.object_id,
            "tower_id": support.tower_id,
            "type": kind,
            "height": support.height,
            "tension": support.tension,
        }
        top = foot + np.array([0.0, 0.0, support.height])
        self.features.append((placed(np.array([foot, top])), properties))

    def ground(self, place: Sequence[float] | Floats) -> float:
        """Elevation at a position."""
        return float(self.builder.terrain.at(place[0], place[1]))

    def frame(self, place: Floats, left: Floats, cls: int) -> Frame:
        """Axes of a new structure."""
        x, y = place
        return Frame(self, x, y, self.ground(place), left, self.builder.new_object(), cls)

    def covers(self, places: Floats) -> Floats:
        """Tell which positions of shape (n, 2 or 3) are in the area of the survey."""
        return np.asarray(shapely.contains_xy(self.area, places[:, 0], places[:, 1]))


def _seen(span: float, hidden: float, rng: np.random.Generator) -> Floats:
    """Shares of a span between which a wire is seen, shape (n, 2).

    Stretches of 5 to 25 m are hidden: as many as make up the share.
    """
    count = int(rng.poisson(hidden * span / 15.0)) if hidden else 0
    first = np.sort(rng.uniform(0, 1, count))
    last = np.minimum(first + rng.uniform(5, 25, count) / span, 1.0)
    return np.column_stack([np.append(0.0, last), np.append(first, 1.0)])
