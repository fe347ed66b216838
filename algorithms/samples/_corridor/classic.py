"""A plain corridor: lattice towers, poles, a road, and trees that come too near the wires."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.samples._corridor.catenary import Catenary, placed
from algorithms.samples._corridor.site import rods
from algorithms.samples._corridor.trees import tree_features
from algorithms.samples._objects import SceneBuilder, Wing, building, shrub, tree
from algorithms.samples._survey import (
    ASPHALT,
    CONNECTOR,
    FOREST,
    GRASS,
    GUARD,
    MEADOW,
    ROD,
    ROUND,
    TOWER,
    WIRE,
    Features,
    FlightLine,
    Floats,
    SceneData,
    blank_terrain,
    graded,
    rolling,
    survey,
)
from toolbox.context import QUIET, Context

WIDTH = 120.0
BEND = np.radians(18.0)  # change of direction at the middle tower
WIRE_RADIUS, BAR_RADIUS, POLE_RADIUS = 0.08, 0.12, 0.2  # with half a footprint of the laser, m
OUTLIERS = 0.0005


@dataclass(frozen=True)
class Support:
    """A tower or pole: its foot, the direction of its arms, and where its wires are attached."""

    tower_id: int
    object_id: int
    x: float
    y: float
    ground: float
    arm: tuple[float, float]  # unit vector along the cross arms
    tension: bool  # wires pull at their strings instead of hanging from them


@dataclass(frozen=True)
class System:
    """Properties of a line: its wires and supports, and the cleared belt."""

    name: str
    offset: float  # of the line from the axis, to the left, m
    spacing: float  # between supports, m
    height: float
    wires: tuple[tuple[float, float, float, int], ...]  # offset, height, catenary c, class
    string: float  # length of the insulators
    lattice: bool  # towers, not poles
    cleared: float  # half width of the belt without trees


TRANSMISSION = System(
    "transmission",
    14.0,
    220.0,
    40.0,
    string=2.0,
    lattice=True,
    cleared=17.0,
    wires=(
        (-5.0, 22.0, 1100.0, WIRE),
        (5.0, 22.0, 1100.0, WIRE),
        (-7.0, 29.0, 1100.0, WIRE),
        (7.0, 29.0, 1100.0, WIRE),
        (-5.0, 35.0, 1100.0, WIRE),
        (5.0, 35.0, 1100.0, WIRE),
        (0.0, 40.0, 1500.0, GUARD),
    ),
)
DISTRIBUTION = System(
    "distribution",
    -22.0,
    45.0,
    10.0,
    string=0.3,
    lattice=False,
    cleared=7.0,
    wires=(
        (-0.9, 9.3, 320.0, WIRE),
        (0.0, 9.3, 320.0, WIRE),
        (0.9, 9.3, 320.0, WIRE),
        (0.0, 7.2, 260.0, WIRE),
    ),
)


@dataclass(frozen=True)
class Design:
    """Settings of a corridor: its lines, the relief, and how the wires are recorded."""

    systems: tuple[System, ...] = (TRANSMISSION, DISTRIBUTION)
    bend: float = BEND
    relief: float = 1.0  # of the hills, as a factor
    hidden: float = 0.0  # share of the wires of which no point is recorded, in stretches
    outliers: float = OUTLIERS
    loops: bool = False  # jumpers below the arms where wires pull at a tower


def random_design(rng: np.random.Generator) -> Design:
    """Random lines: two to twelve wires in bundles, on towers of 26 to 60 m or on poles."""
    both = [_transmission(rng), _distribution(rng)]
    kept = both if rng.random() < 0.6 else [both[int(rng.integers(2))]]
    return Design(
        tuple(kept),
        bend=float(np.radians(rng.uniform(0, 30))),
        relief=float(rng.uniform(0.2, 2.0)),
        hidden=float(rng.uniform(0, 0.06)),
        outliers=float(rng.uniform(0, OUTLIERS)),
        loops=True,
    )


def _transmission(rng: np.random.Generator) -> System:
    """Conductors on both sides of a lattice tower, at one to three heights, and a guard wire."""
    height, c = float(rng.uniform(26, 60)), float(rng.uniform(900, 2000))
    shares = [(0.9,), (0.72, 0.9), (0.55, 0.72, 0.9)][int(rng.integers(3))]
    bundle = [(0.0,), (-0.2, 0.2), (-0.25, 0.25)][int(rng.integers(3))]
    reach = 0.15 * height + 1.0
    wires = [
        (side * reach * (1.2 if k == 1 else 1.0) + aside, share * height, c, WIRE)
        for k, share in enumerate(shares)
        for side in (-1, 1)
        for aside in bundle
    ]
    wires.append((0.0, height, 1.3 * c, GUARD))
    return System(
        "transmission",
        14.0,
        float(rng.uniform(150, 320)),
        height,
        tuple(wires),
        string=0.05 * height,
        lattice=True,
        cleared=17.0,
    )


def _distribution(rng: np.random.Generator) -> System:
    """Two to five conductors on poles."""
    height, c = float(rng.uniform(9, 13)), float(rng.uniform(250, 700))
    count = int(rng.integers(2, 5))
    top = [(float(x), height - 0.7, c, WIRE) for x in np.linspace(-1.0, 1.0, count)]
    low = [(0.0, height - 2.4, 0.8 * c, WIRE)] if rng.random() < 0.5 else []
    return System(
        "distribution",
        -22.0,
        float(rng.uniform(35, 60)),
        height,
        tuple(top + low),
        string=0.3,
        lattice=False,
        cleared=7.0,
    )


@dataclass(frozen=True)
class Axis:
    """Centre line of two legs; chainages run along it, offsets to its left."""

    start: tuple[float, float]
    leg: float
    headings: tuple[tuple[float, float], tuple[float, float]]

    @property
    def bend(self) -> tuple[float, float]:
        (hx, hy), (x, y) = self.headings[0], self.start
        return x + hx * self.leg, y + hy * self.leg

    def locate(self, x: Any, y: Any) -> tuple[Floats, Floats]:
        """Chainage and offset of positions."""
        (ax, ay), (bx, by) = self.headings
        dx, dy = x - self.bend[0], y - self.bend[1]
        second = dx * (ax + bx) + dy * (ay + by) > 0
        hx, hy = np.where(second, bx, ax), np.where(second, by, ay)
        return self.leg + dx * hx + dy * hy, dy * hx - dx * hy

    def place(self, chainage: float, offset: float) -> tuple[float, float]:
        """Position of a chainage and offset; at the bend on the bisector of the legs."""
        (ax, ay), (bx, by) = self.headings
        x, y = self.bend
        if abs(chainage - self.leg) < 1e-6:
            mx, my = ax + bx, ay + by
            offset *= 2 / (mx * mx + my * my)
            return x - offset * my, y + offset * mx
        hx, hy = (ax, ay) if chainage < self.leg else (bx, by)
        along = chainage - self.leg
        return x + along * hx - offset * hy, y + along * hy + offset * hx

    def arm(self, chainage: float) -> tuple[float, float]:
        """Unit vector to the left of the line."""
        (ax, ay), (bx, by) = self.headings
        hx, hy = (ax, ay) if chainage <= self.leg else (bx, by)
        if abs(chainage - self.leg) < 1e-6:
            hx, hy = ax + bx, ay + by
        norm = float(np.hypot(hx, hy))
        return -hy / norm, hx / norm


@dataclass
class Network:
    """The bars, strings and wires of a corridor while they are built."""

    builder: SceneBuilder
    axis: Axis
    design: Design = field(default_factory=Design)
    rods: list[Any] = field(default_factory=list)
    spans: list[Catenary] = field(default_factory=list)
    features: Features = field(default_factory=list)
    towers: int = 0
    wires: int = 0
    span_count: int = 0


def corridor(*, size: float, density: float, seed: int, ctx: Context = QUIET) -> SceneData:
    """A corridor `size` metres long and 120 m wide at most; see `scene`."""
    return _built(Design(), size, density, np.random.default_rng(seed), ctx)


def power_lines(*, size: float, density: float, seed: int, ctx: Context = QUIET) -> SceneData:
    """A corridor with lines that the seed decides on; see `scene`."""
    rng = np.random.default_rng(seed)
    return _built(random_design(rng), size, density, rng, ctx)


def _built(
    design: Design, size: float, density: float, rng: np.random.Generator, ctx: Context
) -> SceneData:
    width = min(WIDTH, size)
    builder, axis = _land(design, size, width, rng)
    network = Network(builder, axis, design)
    for system in design.systems:
        if abs(system.offset) + 8 < width / 2:
            _string_up(network, system, size)
    x, y = axis.place(0.72 * size, -0.36 * width)
    turn = float(np.arctan2(*axis.headings[1][::-1]))
    building(builder, x, y, turn, wings=[Wing(0, 0, 7.0, 4.5, slope=0.8)], storeys=2)
    _vegetation(network, size, width, ctx)

    world = replace(builder.world(), rods=np.concatenate([np.empty(0, ROD), *network.rods]))

    def inside(x: Floats, y: Floats) -> NDArray[np.bool_]:
        chainage, offset = axis.locate(x, y)
        return np.asarray((chainage >= 0) & (chainage < size) & (np.abs(offset) <= width / 2))

    xyz, attributes = survey(
        world,
        _flights(axis, width, float(builder.terrain.values.mean())),
        float(np.sqrt(1.8 / density)),
        rng,
        inside=inside,
        truth=("wire_id", "span_id", "tower_id"),
        outliers=design.outliers,
        ctx=ctx.part(0.2, 1.0),
    )
    features = [*network.features, *tree_features(builder.terrain, network.spans, world.crowns)]
    return SceneData(xyz, attributes, builder.terrain.placed(), features)


def _land(
    design: Design, size: float, width: float, rng: np.random.Generator
) -> tuple[SceneBuilder, Axis]:
    """Scene of hills, a road across and woods on both sides of the cleared belt, and its axis."""
    leg, half = size / 2, design.bend / 2
    rise, run = float(np.sin(half)), float(np.cos(half))
    axis = Axis((0.5 * width * rise, 0.5 * width), leg, ((run, rise), (run, -rise)))
    east, north = size * run + width * rise, leg * rise + width
    terrain = blank_terrain(0, 0, east, north)
    x, y = terrain.centres()
    waves = ((6.0, 420), (3.0, 210), (0.8, 95), (0.12, 23))
    z = 210 + rolling(rng, x, y, [(design.relief * height, length) for height, length in waves])
    chainage, offset = axis.locate(x, y)
    road = chainage - 0.3 * size - 4.0 * np.sin(offset / 30)
    # The road follows the hills along its centre line and is level across.
    reach = np.linspace(-width, width, 200)
    line = np.array([axis.place(0.3 * size + 4.0 * float(np.sin(v / 30)), float(v)) for v in reach])
    profile = replace(terrain, values=z.astype(np.float32)).at(line[:, 0], line[:, 1]) + 0.5
    z = graded(z, np.interp(offset, reach, profile), np.abs(road) - 3.5, 1 / 1.5)
    cleared = np.any([np.abs(offset - s.offset) < s.cleared for s in design.systems], axis=0)
    cover = np.where(cleared, MEADOW, FOREST)
    cover[np.abs(road) < 9] = GRASS
    cover[np.abs(road) < 3] = ASPHALT
    terrain = replace(terrain, values=z.astype(np.float32))
    taken = np.zeros((int(np.ceil(north)), int(np.ceil(east))), bool)
    dry = np.full(z.shape, -np.inf, np.float32)
    builder = SceneBuilder(terrain, cover.astype(np.uint8), dry, taken, size, rng)
    px, py = np.arange(taken.shape[1]) + 0.5, np.arange(taken.shape[0]) + 0.5
    builder.taken |= np.abs(road)[terrain.index(px[None, :], py[:, None])] < 5
    return builder, axis


def _flights(axis: Axis, width: float, ground: float) -> list[FlightLine]:
    """Two flight lines along each leg, in opposite directions."""
    lines = []
    for first, heading in enumerate(axis.headings):
        hx, hy = heading
        x, y = axis.start if first == 0 else axis.bend
        extra = 0.25 * width  # to cover the wedge at the bend
        for side in (-0.21, 0.21):
            px, py = x - side * width * hy - extra * hx, y + side * width * hx - extra * hy
            length = axis.leg + 2 * extra
            way = (px, py), (hx, hy)
            if side > 0:
                way = (px + length * hx, py + length * hy), (-hx, -hy)
            lines.append(FlightLine(*way, length, 0.375 * width, ground))
    return lines


# --- towers and wires ----------------------------------------------------------------------


def _string_up(network: Network, system: System, size: float) -> None:
    """Build the supports along the axis, one of them at the bend, and the wires between them."""
    margin = min(12.0, 0.1 * size)
    leg = size / 2 - margin
    count = max(1, round(leg / system.spacing))
    first = margin + leg * np.arange(count) / count
    chainages = [*first, size / 2, *(size - first[::-1])]
    raise_tower = _lattice if system.lattice else _pole
    supports = []
    for chainage in chainages:
        x, y = network.axis.place(float(chainage), system.offset)
        builder = network.builder
        network.towers += 1
        tension = chainage in (chainages[0], size / 2, chainages[-1])
        support = Support(
            network.towers,
            builder.new_object(),
            x,
            y,
            float(builder.terrain.at(x, y)),
            network.axis.arm(float(chainage)),
            tension,
        )
        raise_tower(network, support, system)
        builder.claim(x, y, 0.0, a=3.0, b=3.0)
        supports.append(support)
    for i in range(len(supports) - 1):
        network.span_count += 1
        for k, wire in enumerate(system.wires):
            _hang(network, system, supports[i : i + 2], wire, network.wires + k + 1)
        if network.design.loops and system.lattice and i and supports[i].tension:
            _loop(network, system, supports[i], len(system.wires))
    network.wires += len(system.wires)


def _hang(
    network: Network,
    system: System,
    supports: Sequence[Support],
    wire: tuple[float, float, float, int],
    wire_id: int,
) -> None:
    """Build one wire of one span, with its strings of insulators."""
    offset, height, c, cls = wire
    one, two = supports
    tips = [
        np.array([s.x + offset * s.arm[0], s.y + offset * s.arm[1], s.ground + height])
        for s in supports
    ]
    ahead = (tips[1] - tips[0]) / np.hypot(*(tips[1] - tips[0])[:2])
    ahead[2] = 0.0
    string = 0.0 if cls == GUARD else system.string
    ends = []
    for support, tip, way in ((one, tips[0], ahead), (two, tips[1], -ahead)):
        end = tip + (way if support.tension else np.array([0.0, 0.0, -1.0])) * string
        ends.append((float(end[0]), float(end[1]), float(end[2])))
        if string and (support.tension or support is one):
            network.rods.append(
                rods(
                    np.array([end, tip]),
                    BAR_RADIUS,
                    CONNECTOR,
                    support.object_id,
                    tower=support.tower_id,
                )
            )
    span = Catenary(ends[0], ends[1], c)
    network.spans.append(span)
    owner = network.builder.new_object()
    for seen in _recorded(network, span):
        network.rods.append(
            rods(seen, WIRE_RADIUS, cls, owner, wire=wire_id, span=network.span_count)
        )
    network.features.append(
        (
            placed(span.points(2.0)),
            {
                "kind": "wire",
                "object_id": owner,
                "wire_id": wire_id,
                "span_id": network.span_count,
                "system": system.name,
                "classification": cls,
                "from_tower": one.tower_id,
                "to_tower": two.tower_id,
                "a": span.a,
                "b": span.b,
                "c": c,
                "sag": span.sag,
                "span": span.span,
                "length": span.length,
            },
        )
    )


def _recorded(network: Network, span: Catenary) -> list[Floats]:
    """Points of the stretches of a wire that are recorded."""
    points = span.points(2.0)
    hidden = network.design.hidden
    if not hidden:
        return [points]
    # Stretches of 5 to 25 m are hidden: as many as make up the share.
    seen = np.ones(len(points) - 1, bool)
    for _ in range(network.builder.rng.poisson(hidden * span.span / 15.0)):
        first = int(network.builder.rng.integers(len(seen)))
        seen[first : first + int(network.builder.rng.integers(3, 13))] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[0], seen, [0]])))
    return [points[a : b + 1] for a, b in edges.reshape(-1, 2)]


def _loop(network: Network, system: System, support: Support, count: int) -> None:
    """Build jumpers below the arms, from the end of one string to the end of the next."""
    before, after = network.spans[-2 * count : -count], network.spans[-count:]
    for (_, _, _, cls), one, two in zip(system.wires, before, after, strict=True):
        if cls == GUARD:
            continue
        a, b = np.array(one.end), np.array(two.start)
        t = np.linspace(0, 1, 13)[:, None]
        places = a + t * (b - a)
        places[:, 2] -= 0.9 * system.string * (1 - (2 * t[:, 0] - 1) ** 4)
        network.rods.append(
            rods(places, WIRE_RADIUS, CONNECTOR, support.object_id, tower=support.tower_id)
        )


def _lattice(network: Network, support: Support, system: System) -> None:
    """Build a lattice tower: four legs with crossed braces, and tapered arms."""
    levels = np.array([0.0, 5.0, 10.0, 15.0, 20.0, 22.0, 26.0, 29.0, 32.0, 35.0, 37.0])
    half = np.interp(levels, (0, 20, 37), (3.2, 1.0, 0.6)) * system.height / 40
    levels *= system.height / 40
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    (ax, ay), z = support.arm, support.ground
    across, along = np.array([ax, ay]), np.array([ay, -ax])

    def at(u: float, v: float, h: float) -> Floats:
        px, py = np.array([support.x, support.y]) + u * across + v * along
        return np.array([px, py, z + h])

    def bar(*points: Floats) -> None:
        network.rods.append(
            rods(np.array(points), BAR_RADIUS, TOWER, support.object_id, tower=support.tower_id)
        )

    rings = list(zip(levels, half, strict=True))
    legs = [[at(h * u, h * v, level) for level, h in rings] for u, v in corners]
    peak = at(0, 0, system.height)
    for i in range(4):
        here, there = legs[i], legs[(i + 1) % 4]
        bar(*here, peak)
        for k in range(len(levels) - 1):
            bar(here[k], there[k + 1])
            bar(there[k], here[k + 1])
    for offset, height, _, cls in system.wires:
        if cls == GUARD:
            continue
        tip, side = at(offset, 0, height), np.sign(offset)
        for v in (-0.8, 0.8):
            bar(at(0.8 * side, v, height), tip)
            bar(at(0.8 * side, v, height + 1.8), tip)
    _post(network, support, system)


def _pole(network: Network, support: Support, system: System) -> None:
    """Build a wooden pole with one cross arm."""
    (ax, ay), z = support.arm, support.ground
    x, y = support.x, support.y
    pole = np.array([(x, y, z), (x, y, z + system.height)])
    level = z + system.height - 0.7
    arm = np.array([(x + s * ax, y + s * ay, level) for s in (-1.1, 1.1)])
    for ends in (pole, arm):
        network.rods.append(
            rods(ends, POLE_RADIUS, TOWER, support.object_id, tower=support.tower_id)
        )
    _post(network, support, system)


def _post(network: Network, support: Support, system: System) -> None:
    """Feature of a tower: a vertical line."""
    foot = np.array([support.x, support.y, support.ground])
    network.features.append(
        (
            placed(np.array([foot, foot + np.array([0.0, 0.0, system.height])])),
            {
                "kind": "tower",
                "object_id": support.object_id,
                "tower_id": support.tower_id,
                "system": system.name,
                "height": system.height,
                "tension": support.tension,
            },
        )
    )


# --- vegetation ----------------------------------------------------------------------------


def _vegetation(network: Network, size: float, width: float, ctx: Context) -> None:
    """Grow woods beside the line, shrubs below it, and a few trees close to the wires."""
    builder, axis, systems = network.builder, network.axis, network.design.systems
    rng = builder.rng
    for k, gap in enumerate((0.8, 1.5, 2.5)):
        for system, share in zip(systems, (0.34, 0.61), strict=False):
            _intruder(network, system, (share + 0.1 * k) * size, gap)
    spots = rng.uniform((0, -width / 2), (size, width / 2), (int(size * width / 28), 2))
    for number, (chainage, offset) in enumerate(spots):
        if number % 500 == 0:
            ctx.progress(0.2 * number / len(spots))
        x, y = axis.place(chainage, offset)
        away = min(abs(offset - system.offset) - system.cleared for system in systems)
        if away < 0:
            if rng.random() < 0.4:
                shrub(builder, x, y)
        elif away > 3:
            tree(builder, x, y)


def _intruder(network: Network, system: System, chainage: float, gap: float) -> None:
    """Grow a round tree whose top is `gap` metres below the lowest wire above it."""
    builder = network.builder
    x, y = network.axis.place(chainage, system.offset + system.wires[0][0])
    if not network.spans or not builder.claim(x, y, 0.0, a=1.5, b=1.5):
        return
    wires = np.concatenate([span.points(0.5) for span in network.spans])
    near = wires[np.hypot(wires[:, 0] - x, wires[:, 1] - y) < 1.0]
    ground = float(builder.terrain.at(x, y))
    if len(near) == 0:
        return
    top = float(near[:, 2].min()) - gap
    height = top - ground
    builder.crowns.append(
        (x, y, ground + 0.3 * height, top, 0.25 * height, ROUND, builder.new_object())
    )
