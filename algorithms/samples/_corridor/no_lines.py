"""What looks like a power line and is none: ropes, contact wires, cranes, fences, masts.

Their points are of class 19 (overhead structure) where they hang or reach over the ground, and of
class 1 where they stand on it. None has a wire_id, span_id or tower_id.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np

from algorithms.samples._corridor.catenary import Catenary, placed
from algorithms.samples._corridor.routes import Range, Route, drawn, straight
from algorithms.samples._corridor.site import OVERHEAD, Frame, Site, rods
from algorithms.samples._corridor.supports import braced
from algorithms.samples._objects import Wing, building, crown
from algorithms.samples._survey import BRIDGE, COLUMN, ROUND, UNCLASSIFIED, Floats

Structure = Callable[[Site], None]
ROPE, CABLE = 0.06, 0.04  # radii with half a footprint of the laser, m


def railway(site: Site, *, offset: float = 0.0, tracks: int = 2, height: float = 5.5) -> None:
    """Tracks with masts at their sides, a contact wire each, and the wire that carries it."""
    for track in range(tracks):
        side = 1 if track >= tracks / 2 else -1
        middle = site.route.beside(offset + 4.5 * (track - (tracks - 1) / 2))
        masts = _row(site, middle, 55.0)
        frames = [site.frame(middle.place(c, 3.0 * side), middle.left(c), OVERHEAD) for c in masts]
        for frame in frames:
            _cantilever(frame, side, height)
        for k, (one, two) in enumerate(itertools.pairwise(frames)):
            zigzag = 0.25 * (-1) ** k
            ends = (one.at(-3 * side + zigzag, 0, height), two.at(-3 * side - zigzag, 0, height))
            _contact_wire(site, *ends)
    _tell(site, "railway", site.route.beside(offset))


def _cantilever(frame: Frame, side: int, height: float) -> None:
    """A mast beside the track and the bars that hold the wires above it."""
    top, out = height + 2.3, -3.0 * side
    frame.bar(frame.foot(0, 0), frame.at(0, 0, top), radius=0.15)
    frame.bar(frame.at(0, 0, height + 1.5), frame.at(out, 0, height + 1.4), radius=0.05)
    frame.bar(frame.at(0, 0, height + 0.2), frame.at(out, 0, height + 1.4), radius=0.05)
    frame.bar(frame.at(0.5 * out, 0, height + 0.8), frame.at(out, 0, height), radius=0.04)


def _contact_wire(site: Site, start: Floats, end: Floats) -> None:
    """A straight wire, one that sags above it, and the hangers between them."""
    owner = site.builder.new_object()
    share = np.linspace(0, 1, 9)
    low = start + share[:, None] * (end - start)
    high = low.copy()
    high[:, 2] += 1.4 - 3.2 * share * (1 - share)
    for places in (low, high):
        site.rods.append(rods(places, CABLE, OVERHEAD, owner))
    for pair in zip(low[1:-1], high[1:-1], strict=True):
        site.rods.append(rods(np.array(pair), 0.02, OVERHEAD, owner))


def cableway(
    site: Site,
    *,
    angle: float = 0.0,
    every: float = 90.0,
    height: float = 14.0,
    hangs: float = 18.0,
    cabins: bool = False,
) -> None:
    """A chairlift or gondola: T-shaped towers, a rope up and one down, and what hangs from them.

    Parameters
    ----------
    angle : between the cableway and the route, degrees; 0 runs along it
    hangs : distance from chair to chair, metres
    """
    route = site.route
    if angle:
        middle = route.length * drawn(site.rng, (0.35, 0.65))
        heading = float(np.arctan2(*route.heading(middle)[::-1])) + np.radians(angle)
        route = straight(route.place(middle), heading, 2.6 * site.half)
    frames = [site.frame(route.place(c), route.left(c), OVERHEAD) for c in _row(site, route, every)]
    high = height * (1.3 if cabins else 1.0)
    for frame in frames:
        frame.bar(frame.foot(0, 0), frame.at(0, 0, high), radius=0.35)
        frame.bar(frame.at(-2.8, 0, high), frame.at(2.8, 0, high), radius=0.15)
    for one, two in itertools.pairwise(frames):
        for side in (-2.6, 2.6):
            ends = [tuple(map(float, f.at(side, 0, high))) for f in (one, two)]
            rope = Catenary(
                (ends[0][0], ends[0][1], ends[0][2]), (ends[1][0], ends[1][1], ends[1][2]), 900.0
            )
            _rope(site, rope, hangs, cabins)
    _tell(site, "cableway", route)


def _rope(site: Site, rope: Catenary, hangs: float, cabins: bool) -> None:
    """A rope with chairs or cabins below it."""
    owner = site.builder.new_object()
    places = rope.points(3.0)
    site.rods.append(rods(places, ROPE, OVERHEAD, owner))
    for k in range(int(hangs / 6), len(places), max(2, int(hangs / 3))):
        x, y, z = places[k]
        site.rods.append(rods(np.array([(x, y, z), (x, y, z - 2.5)]), 0.05, OVERHEAD, owner))
        size, tall = (1.1, 2.2) if cabins else (0.5, 1.0)
        site.builder.block(
            x,
            y,
            0.0,
            a=size,
            b=size,
            top=z - 2.5,
            base=z - 2.5 - tall,
            cls=OVERHEAD,
            owner=owner,
            shade=15000.0,
        )


def cranes(
    site: Site,
    *,
    count: int = 3,
    offset: Range = (-20.0, 20.0),
    height: Range = (28.0, 55.0),
) -> None:
    """Tower cranes beside houses that they build."""
    for share in np.linspace(0.15, 0.85, count):
        chainage = share * site.route.length + site.rng.normal(0, 5)
        aside = drawn(site.rng, offset)
        place = site.route.place(chainage, aside)
        turn = drawn(site.rng, (0, 2 * np.pi))
        frame = site.frame(place, np.array([np.cos(turn), np.sin(turn)]), OVERHEAD)
        x, y = site.route.place(chainage + 14, aside)
        _crane(frame, drawn(site.rng, height), drawn(site.rng, (25, 45)))
        building(
            site.builder,
            float(x),
            float(y),
            turn,
            wings=[Wing(0, 0, 9.0, 7.0)],
            storeys=int(site.rng.integers(2, 6)),
        )
        _tell(site, "crane", straight(place, turn, 40.0))


def _crane(frame: Frame, height: float, jib: float) -> None:
    """A mast, a jib, a shorter one with the weight, ties from the top, and the rope of the hook."""
    levels = np.linspace(0, height, int(height / 3))
    braced(frame, levels, np.full(len(levels), 0.9))
    peak = frame.at(0, 0, height + 7)
    for u in (-0.9, 0.9):
        frame.bar(frame.at(u, 0, height), peak)
    for v in (-0.6, 0.6):
        frame.bar(frame.at(-13, v, height), frame.at(jib, v, height))
    count = int(jib / 2)
    frame.bar(*(frame.at(k * jib / count, 0, height + 1.4 * (k % 2)) for k in range(count + 1)))
    frame.bar(frame.at(1, 0, height + 1.4), frame.at(jib, 0, height + 1.4))
    for u in (-12.0, 0.35 * jib, 0.75 * jib):
        frame.bar(peak, frame.at(u, 0, height + 0.3), radius=0.04)
    hook = 0.6 * jib
    frame.bar(frame.at(hook, 0, height), frame.at(hook, 0, 0.3 * height), radius=0.04)


def fences(site: Site, *, offsets: tuple[float, ...] = (-14.0, 11.0), height: float = 1.8) -> None:
    """Fences of wires between posts along the route."""
    for offset in offsets:
        route = site.route.beside(offset)
        frames = [
            site.frame(route.place(c), route.left(c), UNCLASSIFIED) for c in _row(site, route, 3.0)
        ]
        for frame in frames:
            frame.bar(frame.foot(0, 0), frame.at(0, 0, height), radius=0.06)
        for one, two in itertools.pairwise(frames):
            for share in (0.35, 0.65, 1.0):
                one.bar(one.at(0, 0, share * height), two.at(0, 0, share * height), radius=0.05)
        _tell(site, "fence", route)


def viaduct(site: Site, *, offset: float = 0.0, height: float = 9.0) -> None:
    """A road on piers along the route, with guard rails and handrails high above the ground."""
    route = site.route.beside(offset)
    step = 6.0
    chainages = np.arange(0.1 * route.length, 0.9 * route.length, step)
    first, last = (site.ground(route.place(c)) for c in (chainages[0], chainages[-1]))
    owner = site.builder.new_object()
    before: dict[tuple[float, float], Floats] = {}
    for c in chainages:
        share = (c - chainages[0]) / (chainages[-1] - chainages[0])
        deck = first + share * (last - first) + height
        (x, y), (hx, hy) = route.place(c), route.heading(c)
        turn = float(np.arctan2(hy, hx))
        _deck(site, (x, y), turn, half=(step / 2, 5.0), top=deck, owner=owner)
        for side, up in itertools.product((-4.8, 4.8), (0.75, 1.2)):
            here = np.array([*route.place(c, side), deck + up])
            if (side, up) in before:
                ends = np.array([before[side, up], here])
                site.rods.append(rods(ends, 0.05, UNCLASSIFIED, owner))
            before[side, up] = here
    _tell(site, "viaduct", route)


def _deck(
    site: Site,
    place: tuple[float, float],
    turn: float,
    *,
    half: tuple[float, float],
    top: float,
    owner: int,
) -> None:
    """A slab of a bridge; `half` are its half sides along and across."""
    site.builder.block(
        *place,
        turn,
        a=half[0],
        b=half[1],
        top=top,
        base=top - 1.0,
        cls=BRIDGE,
        owner=owner,
        shade=15000.0,
    )


def lamps(site: Site, *, every: float = 28.0, offset: float = 5.0) -> None:
    """Street lamps with an arm each, and no wire between them."""
    route = site.route.beside(offset)
    for c in _row(site, route, every):
        frame = site.frame(route.place(c), route.left(c), UNCLASSIFIED)
        frame.bar(frame.foot(0, 0), frame.at(0, 0, 8.5), radius=0.12)
        frame.bar(frame.at(0, 0, 8.5), frame.at(-1.8, 0, 8.8), radius=0.12)
    _tell(site, "lamps", route)


def tree_rows(site: Site, *, offsets: tuple[float, ...] = (-9.0, 9.0), every: float = 8.0) -> None:
    """Avenues of trees of one height."""
    tall = drawn(site.rng, (8, 14))
    for offset in offsets:
        route = site.route.beside(offset)
        for c in _row(site, route, every):
            x, y = route.place(c)
            shape = ROUND if offset > 0 else COLUMN
            height = tall * drawn(site.rng, (0.93, 1.07))
            crown(site.builder, x, y, trunk=2.5, height=height, radius=0.25 * tall, shape=shape)
        _tell(site, "avenue", route)


def radio_masts(site: Site, *, count: int = 2) -> None:
    """Tall masts held by ropes at three heights in three directions."""
    for share in np.linspace(0.25, 0.75, count):
        place = site.route.place(
            share * site.route.length, drawn(site.rng, (-0.2, 0.2)) * site.half
        )
        frame = site.frame(place, site.route.left(0.0), OVERHEAD)
        height = drawn(site.rng, (35, 70))
        levels = np.linspace(0, height, int(height / 2))
        braced(frame, levels, np.full(len(levels), 0.35))
        for turn in np.radians((10, 130, 250)):
            for up in (0.35, 0.65, 0.95):
                away = 0.45 * height
                anchor = frame.foot(away * np.cos(turn), away * np.sin(turn))
                frame.bar(anchor, frame.at(0, 0, up * height), radius=CABLE)
        _tell(site, "radio mast", straight(place, 0.0, 2.0))


def hop_garden(site: Site, *, height: float = 6.5) -> None:
    """Rows of poles with straight wires over them, from which plants climb."""
    owner = site.builder.new_object()
    route, half = site.route, 0.7 * site.half
    chainages = np.arange(0.2, 0.8, 8.0 / route.length) * route.length
    offsets = np.arange(-half, half, 6.0)
    places = np.array([[route.place(c, o) for o in offsets] for c in chainages])
    ground = site.builder.terrain.at(places[..., 0], places[..., 1])
    tops = np.dstack([places, ground + height])
    for row in (*tops, *tops.transpose(1, 0, 2)):
        site.rods.append(rods(row, CABLE, UNCLASSIFIED, owner))
    for top, low in zip(tops.reshape(-1, 3), ground.ravel(), strict=True):
        ends = np.array([(top[0], top[1], low), top])
        site.rods.append(rods(ends, 0.08, UNCLASSIFIED, owner))
    _tell(site, "hop garden", route)


def suspension_bridge(site: Site, *, height: float = 12.0) -> None:
    """Two cables over two portals, hangers, and the deck that they carry."""
    route = site.route
    span, middle = 0.5 * route.length, 0.5 * route.length
    deck = site.ground(route.place(middle)) + height
    owner, tall = site.builder.new_object(), 0.11 * span + 2.0
    hx, hy = route.heading(middle)
    turn = float(np.arctan2(hy, hx))
    x, y = route.place(middle)
    _deck(site, (x, y), turn, half=(0.8 * span, 4.0), top=deck, owner=owner)
    for side in (-4.2, 4.2):
        share = np.linspace(-0.8, 0.8, 65)
        inner = np.abs(share) <= 0.5
        rise = np.where(inner, 4 * share**2, (0.8 - np.abs(share)) / 0.3)
        cable = np.array([[*route.place(middle + s * span, side), 0.0] for s in share])
        cable[:, 2] = deck + 1.5 + (tall - 1.5) * rise
        site.rods.append(rods(cable, 0.15, OVERHEAD, owner))
        for place in cable[inner][::2]:
            hanger = np.array([place, (place[0], place[1], deck)])
            site.rods.append(rods(hanger, 0.04, OVERHEAD, owner))
        for end in (-0.5, 0.5):
            px, py = route.place(middle + end * span, side)
            tower = np.array([(px, py, site.ground((px, py))), (px, py, deck + tall)])
            site.rods.append(rods(tower, 0.6, OVERHEAD, owner))
    _tell(site, "suspension bridge", route)


def _row(site: Site, route: Route, every: float) -> Iterator[float]:
    """Chainages at about equal distances along a route."""
    count = max(2, round(route.length / every))
    margin = min(4.0, 0.1 * route.length)
    return iter(np.linspace(margin, route.length - margin, count))


def _tell(site: Site, kind: str, route: Route) -> None:
    """Feature of a structure: where it runs, on the ground."""
    places = np.array([[x, y, site.ground((x, y))] for x, y in route.vertices])
    site.features.append((placed(places), {"kind": kind}))
    site.clearings.append(route.line)
