"""Towers and insulators from supports: the points below, between and above the ends of wires.

A body narrows from its foot to its lowest arm; around the arms there is nothing else in the air.
The ground and what lies on it, such as the blocks of the foundation, is not tower.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtr

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._extraction.spans import Wire, on_wire
from algorithms.corridor._extraction.strays import within
from algorithms.corridor._extraction.supports import Support, sd_of_median
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.clusters import dbscan

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Tower:
    """A support with its points.

    Attributes
    ----------
    points : indices among the points in the air
    top : height of its highest point, or of its highest wire if that is higher
    width : half width of the body below its arms
    stands : whether points of that body are seen, and it stands by itself if it is a pole
    """

    support: Support
    points: Ints
    top: float
    width: float
    stands: bool

    @property
    def lattice(self) -> bool:
        """Whether it is a lattice tower, not a pole."""
        return self.width > SETTINGS.towers.lattice_width

    @property
    def is_certain(self) -> bool:
        """Whether a body and more than its wires tell of it, and where it stands along the line.

        A pole has few points around it; in woods the trunk and the crown of a tree are a body, too.
        """
        return (
            self.stands
            and len(self.points) >= SETTINGS.towers.known_by_points
            and self.support.sd_along <= SETTINGS.supports.settled_slack
        )


def strings_of(corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]) -> Floats:
    """Length in metres of the tension strings at the ends of each wire, 0 where it is suspended.

    A wire that pulls at an arm ends at its height, one that hangs is below it. What stands above
    the arms, as a guard wire, has no insulators.

    Parameters
    ----------
    corridor : in which points on wires are taken
    wires : n wires, from support to support

    Returns
    -------
    array of shape (n, 2), at the beginning and the end of each wire
    """
    found = np.zeros((len(wires), 2))
    for number, support in enumerate(supports):
        height = support.high - support.ground
        left, right = sides_of(support)
        strings = SETTINGS.towers.string_reach * height
        reach = max(-left, right) + strings + SETTINGS.curves.clutter_radius
        near = corridor.air.within(np.array([support.x, support.y]), reach)
        xyz = corridor.air.xyz[near[corridor.free[near]]]
        ends = [
            (k, e) for k, wire in enumerate(wires) for e in (0, 1) if wire.supports[e] == number
        ]
        around = [around_end(wires[k].curve, e, xyz) for k, e in ends]
        level, above = np.array([arms_at(*places, height) for places in around]).T
        if level.sum() <= above.sum():
            continue
        tops = np.array([(wires[k].curve.z_start, wires[k].curve.z_end)[e] for k, e in ends])
        pulls = tops <= tops[level > above].max()
        length = by_jumpers(around, height) or SETTINGS.towers.arm_depth * height
        for (k, e), pull in zip(ends, pulls.tolist(), strict=True):
            found[k, e] = pull * length
    return found


def around_end(curve: Catenary, end: int, xyz: Floats) -> tuple[Floats, Floats, Floats]:
    """Distances of points (n, 3) from an end of a wire: inwards along it, left of it, and above."""
    u, v, z = curve.residuals(xyz)
    return curve.length - u if end else u, v, z


def arms_at(along: Floats, v: Floats, z: Floats, height: float) -> tuple[int, int]:
    """Number of arm points beside the end of a wire, and of those above it."""
    depth, aside = SETTINGS.towers.arm_depth * height, np.abs(v)
    beside = (np.abs(along) < depth) & (aside < SETTINGS.curves.clutter_radius)
    beside &= aside > SETTINGS.network.bundle_width
    level = np.abs(z) < depth / 2
    return (
        int(np.count_nonzero(beside & level)),
        int(np.count_nonzero(beside & (z > 0) & (z < depth) & ~level)),
    )


def by_jumpers(around: Sequence[tuple[Floats, Floats, Floats]], height: float) -> float:
    """Length of the strings between wires and a support, from jumpers; 0 where none are seen.

    Where wires end at both sides of a tower, a jumper leads the current around it, from the end of
    one string to the end of the other.
    """
    found = []
    below, deepest, aside = (
        SETTINGS.network.bundle_width,
        SETTINGS.towers.jumper_deepest,
        SETTINGS.curves.clutter_radius,
    )
    for along, v, z in around:
        loop = (z < -below) & (z > -deepest) & (np.abs(v) < aside)
        loop &= (along > 0.8) & (along < SETTINGS.towers.string_reach * height)
        if np.count_nonzero(loop) >= SETTINGS.towers.known_by_points:
            found.append(SETTINGS.towers.jumper_width * float(np.quantile(along[loop], 0.9)))
    return float(np.median(found)) if len(found) >= 2 else 0.0


def all_centred(
    corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]
) -> list[Support]:
    """The supports of wires, each moved to the middle of its arms and its body."""
    take(corridor, wires)
    ends = [(n, wire.curve.ends[e]) for wire in wires for e, n in enumerate(wire.supports)]
    held = [[end for n, end in ends if n == number] for number in range(len(supports))]
    return [
        centred(corridor, reaching(support, np.array(own)))
        for support, own in zip(supports, held, strict=True)
    ]


def reaching(support: Support, ends: Floats) -> Support:
    """The support with arms as far as the ends, of shape (n, 3), of all wires that it holds."""
    side = (ends[:, :2] - (support.x, support.y)) @ np.array(support.across)
    left, right = support.reach
    return replace(support, reach=(min(left, side.min()), max(right, side.max())))


def centred(corridor: Corridor, support: Support) -> Support:
    """The support, moved along the line to its arms, and across it to the body below them."""
    height = support.high - support.ground
    half = SETTINGS.towers.arms_room * height
    waist = support.low - half
    _, a, s, z = around_axis(corridor, support)
    level = level_with_arms(support, s, z)
    forth, sigma = 0.0, support.sd_along
    for depth in (2 * half, half):  # at first it may be farther off
        arms = level & (np.abs(a - forth) < depth)
        if np.count_nonzero(arms) >= SETTINGS.towers.known_by_points:
            forth = float(np.median(a[arms]))
            sigma = min(support.sd_along, sd_of_median(a[arms]))
    neck = (z > waist - 0.15 * height) & (z < waist)
    near = np.abs(a - forth)

    legs = legs_of(support, s[near < half], z[near < half], waist, half)
    beside = s[neck & (near < half)]
    aside = between_masts(beside, sum(support.reach) / 2, 2 * half)
    if aside is None:
        aside = 0.0
        for reach in (2 * half, half):
            body = neck & (np.hypot(a - forth, s - aside) < reach)
            if np.count_nonzero(body) >= SETTINGS.towers.known_by_points:
                aside = float(np.quantile(s[body], (0.1, 0.9)).mean())  # of a hollow body
    if len(legs) > 1:
        aside = sum(legs) / 2
    (ex, ey), (left, right) = support.across, support.reach
    x = support.x + forth * ey + aside * ex
    y = support.y - forth * ex + aside * ey
    return replace(
        support,
        x=x,
        y=y,
        ground=corridor.ground(x, y),
        reach=(left - aside, right - aside),
        legs=tuple(leg - aside for leg in legs) or (0.0,),
        sd_along=sigma,
    )


def between_masts(s: Floats, middle: float, reach: float) -> float | None:
    """Offset between two masts that lean apart; None if there are none.

    A support was found by one of them. Both are as far from the middle of the wires, and nothing is
    between them: most points have others where they are mirrored there.

    Parameters
    ----------
    s : offsets across the line of points just below the arms, metres
    middle : of the wires
    reach : to both sides of it in which masts are looked for, metres
    """
    wide = SETTINGS.towers.lattice_width
    off = np.sort(s[np.abs(s - middle) < reach] - middle)
    mirrored = np.searchsorted(off, wide - off) > np.searchsorted(off, -wide - off)
    pairs = off[mirrored & (np.abs(off) > wide)]
    sides = pairs[pairs < 0], pairs[pairs > 0]
    enough = min(len(side) for side in sides) >= SETTINGS.towers.known_by_points
    if not enough or 2 * len(pairs) <= len(off):
        return None
    return middle + float(sum(np.median(side) for side in sides)) / 2


def legs_of(support: Support, s: Floats, z: Floats, waist: float, half: float) -> tuple[float, ...]:
    """Offsets of the two legs of a frame, and none of other supports.

    A body was found at offset 0. Of a frame there is another one as far on the other side of the
    wires, both stand upright to the waist, and a beam joins them. Two poles have no beam.

    Parameters
    ----------
    s, z : offset across the line, and height, of points near the axis
    half : half width of the space that a leg has, metres
    """
    aside = sum(support.reach)  # of the second leg
    if abs(aside) <= 2 * half:
        return ()
    found = []
    for leg in (0.0, aside):
        own = np.abs(s - leg) < half
        if share_of_levels(z[own], support.ground + 1.0, waist) < SETTINGS.supports.enough_body:
            return ()
        found.append(float(np.median(s[own & (z < waist)])))
    beam = s[level_with_arms(support, s, z)]
    between = share_of_levels(beam, min(found), max(found))
    return tuple(sorted(found)) if between >= SETTINGS.structures.filled else ()


def share_of_levels(values: Floats, low: float, high: float) -> float:
    """Share of the metres from one value to another in which there are any."""
    inside = values[(values >= low) & (values < high)]
    return len(np.unique(np.floor(inside - low))) / max(1, math.ceil(high - low))


def tower_of(corridor: Corridor, support: Support) -> Tower:
    """The tower at a support: points of its body and its arms, without those on wires."""
    height = support.high - support.ground
    near, a, s, z = around_axis(corridor, support)
    above = corridor.height[near]
    waist = support.low - SETTINGS.towers.arms_room * height
    arms = level_with_arms(support, s, z) & (np.abs(a) < SETTINGS.towers.arms_room * height)
    aside = np.abs(s[:, None] - support.legs).min(axis=1)
    away = np.maximum(np.abs(a), aside)
    width = waist_of(away, z, waist, height)
    lattice = width > SETTINGS.towers.lattice_width
    splay = SETTINGS.towers.splay_lattice if lattice else SETTINGS.towers.splay_pole
    slack = SETTINGS.towers.slack_lattice if lattice else SETTINGS.towers.slack_pole
    wide = width + slack + splay * np.maximum(waist - z, 0)
    body = (away < wide) & (z <= waist)
    if lattice:  # down there it is hollow
        shin = away[
            body & (above > SETTINGS.towers.foot_height) & (above < 2 * SETTINGS.towers.foot_height)
        ]
        foot = float(np.quantile(shin, 0.9)) if len(shin) else width
        body &= (above > SETTINGS.towers.foot_height) | (
            np.abs(away - foot) < SETTINGS.structures.body_gap
        )
    below = (above > 2 * SETTINGS.points.off_ground) & (z <= waist)
    body &= below
    around = np.count_nonzero(below & (away < SETTINGS.curves.clutter_radius))
    stands = bool(body.any() and (lattice or 2 * np.count_nonzero(body) > around))
    mine = near[arms | body]
    top = top_of(corridor.air.xyz[mine, 2]) if len(mine) else support.high
    highest = max(top, support.high)  # of a pole only the foot may show
    return Tower(support, mine, highest, width, stands)


def top_of(z: Floats) -> float:
    """Height of the highest point of a tower, but for one or two far above all others: birds.

    The tip of a peak holds no more points than a bird, but no gap is below it.
    """
    highest = np.sort(z)[-3:]
    apart = np.diff(highest) > SETTINGS.points.company_side / 2
    return float(highest[apart.argmax() if apart.any() else -1])


def around_axis(corridor: Corridor, support: Support) -> tuple[Ints, Floats, Floats, Floats]:
    """Free points around a support: indices, distance along the line and across it, and height."""
    across = np.array(support.across)
    along = np.array([across[1], -across[0]])
    height = support.high - support.ground
    left, right = sides_of(support)
    reach = max(-left, right) + 2 * SETTINGS.towers.arms_room * height
    near = corridor.air.within(np.array([support.x, support.y]), reach)
    near = near[corridor.free[near]]
    step = corridor.air.xyz[near, :2] - (support.x, support.y)
    return near, step @ along, step @ across, corridor.air.xyz[near, 2]


def level_with_arms(support: Support, s: Floats, z: Floats) -> NDArray[np.bool_]:
    """True for points at offsets s across the line and heights z in the range of the arms."""
    height = support.high - support.ground
    out, (left, right) = SETTINGS.towers.arms_room * height, sides_of(support)
    low, high = (
        support.low - SETTINGS.towers.arms_room * height,
        support.high + SETTINGS.towers.arms_peak * height,
    )
    return (z > low) & (z < high) & (s > left - out) & (s < right + out)


def sides_of(support: Support) -> tuple[float, float]:
    """Offsets of the outermost wires or legs on both sides."""
    return min(support.reach[0], *support.legs), max(support.reach[1], *support.legs)


def waist_of(away: Floats, z: Floats, waist: float, height: float) -> float:
    """Half width of a tower's body just below its arms."""
    near = (z < waist) & (z > waist - 0.25 * height) & (away < SETTINGS.towers.arms_room * height)
    width = (
        float(np.quantile(away[near], 0.85))
        if near.sum() >= SETTINGS.towers.known_by_points
        else SETTINGS.towers.hidden_pole_width
    )
    return (
        SETTINGS.towers.hidden_pole_width
        if width > SETTINGS.towers.lattice_width and height < SETTINGS.supports.tallest_pole
        else width
    )  # of trees around a pole


def compared(
    corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]
) -> list[Support]:
    """The supports of a line, each with the chance that so few of its points are seen.

    A survey sees about as much of each, so the number of points is that of a Poisson distribution
    about the median of the others. A support is in doubt only where it hardly shows.
    """
    take(corridor, wires)
    points = np.array([len(tower_of(corridor, support).points) for support in supports])
    found = list(supports)
    for k in np.flatnonzero(points < SETTINGS.towers.known_by_points).tolist():
        if len(others := np.delete(points, k)):
            chance = float(pdtr(points[k], np.median(others)))
            found[k] = replace(found[k], chance=math.log(max(chance, np.finfo(float).tiny)))
    return found


# --- wires that end at their insulators ----------------------------------------------------


def dressed(
    corridor: Corridor, wires: Sequence[Wire], supports: Sequence[Support]
) -> tuple[list[Wire], list[Tower], list[float]]:
    """Wires cut at their insulator strings, towers, and the longest string of each tower."""
    take(corridor, wires)
    strings = strings_of(corridor, wires, supports)
    ended = [without_strings(wire, *own) for wire, own in zip(wires, strings, strict=True)]
    take(corridor, ended)
    held = np.array([wire.supports for wire in wires])
    longest = [float(strings[held == number].max()) for number in range(len(supports))]
    towers = [with_overhang(corridor, tower_of(corridor, support)) for support in supports]
    return ended, towers, longest


def with_overhang(corridor: Corridor, tower: Tower) -> Tower:
    """A lattice tower with what hangs on to it around its arms: their ends, peaks, and its waist.

    Chains of points that begin at a point of the tower are of it if all of them are about as high
    as its highest wires. A tree that reaches up to it has points below.
    """
    if not tower.lattice or not len(tower.points):
        return tower
    support, gap = tower.support, SETTINGS.points.company_side
    near, *_ = around_axis(corridor, support)
    rest = np.setdiff1d(near, tower.points, assume_unique=True)
    if not len(rest):
        return tower
    xyz, height = corridor.air.xyz[rest], support.high - support.ground
    low = xyz[:, 2] < support.high - 2 * SETTINGS.towers.arms_room * height
    touches = within(xyz, corridor.air.xyz[tower.points], gap)
    chain = dbscan(xyz, gap, 1)
    hangs = (np.bincount(chain, touches) > 0) & (np.bincount(chain, low) == 0)
    points = np.union1d(tower.points, rest[hangs[chain]])
    top = top_of(corridor.air.xyz[points, 2])
    return replace(tower, points=points, top=max(top, support.high))


def take(corridor: Corridor, wires: Sequence[Wire]) -> None:
    """Mark the points on wires as taken, and all others as free."""
    corridor.free[:] = True
    for wire in wires:
        corridor.free[on_wire(corridor, wire)[0]] = False


def without_strings(wire: Wire, low: float, high: float) -> Wire:
    """A wire shortened by the length of the strings at both ends."""
    if 3 * (low + high) >= wire.curve.length:
        return wire
    curve = wire.curve.between(low, wire.curve.length - high)
    known = (max(wire.known[0] - low, 0.0), min(wire.known[1] - low, curve.length))
    return replace(wire, curve=curve, known=known)
