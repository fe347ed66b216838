"""From curves to a line: which are wires, where the supports stand, and what a span is.

A wire hangs in arcs that open upwards, and each of them ends at a support. So a support shows in
the wires alone, as the place where arcs of several wires end or meet in a cusp, and its body
confirms it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.corridor import _trace_kernels as kernels
from algorithms.corridor._catenary import Catenary, fit
from algorithms.corridor._trace import TUBE, Airborne

CLEAR, CLEAR_STRONG = 0.65, 0.7  # share of a curve along which it stands out from its surroundings
STRONG = 30.0  # metres from which a curve is a wire by itself
SHORT, FINE, MANY = 18.0, 0.075, 20  # metres, metres, points: a shorter one must be clear
TIGHTEST_C, STRAIGHT_SIGMAS = 5000.0, 3.0  # metres: most tension over weight
BLADE, CARRYING = (0.3, 5.0, 5.0), 0.4  # half width, depth, step in metres; share of steps
LEAST_POINTS, ROUGH = 7, 0.2  # metres: scatter of anything that may be wire
STEEPEST = 0.7  # rise over run of the chord
FATTEST = 30.0  # metres: least c of a wire
JOIN, JOIN_ASIDE, JOIN_HEIGHT = 14.0, 3.0, 1.5  # metres, between wires that meet at a support
PARALLEL, BESIDE = math.radians(6.0), 15.0  # and metres, of wires of one line
CUSP, CUSP_SIGMAS, CUSP_GAIN = -0.02, 8.0, 0.15  # slope, and evidence for a cusp
CUSP_MARGIN, WINDOW = 8.0, 25.0  # metres: from the ends; half of a neighbourhood
ALONG, ACROSS = 10.0, 12.0  # metres between what belongs to one support
LEAST_BODY, ENOUGH_BODY, MUCH_BODY = (
    0.1,
    0.4,
    0.5,
)  # share of its height at which a support shows points
ANGLE = 0.02  # change of slope, or of heading, at a support
FARTHEST = 60.0  # metres of a wire that may be missing
TWIN = 0.7  # metres within which conductors form a bundle

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Piece:
    """Part of a wire within one span: its points and the curve through them."""

    points: Ints
    curve: Catenary

    @property
    def ends(self) -> Floats:
        """First and last place, array of shape (2, 3)."""
        return self.curve.points(np.array([0.0, self.curve.length]))


@dataclass(frozen=True)
class Support:
    """A tower or pole.

    Attributes
    ----------
    x, y : of its axis
    across : unit vector along its arms, from south-west to north-east
    reach : of its arms to the back and front of `across`, metres
    low, high : height of its lowest and highest wire
    ground : height of the terrain
    body : share of its height at which points show
    """

    x: float
    y: float
    across: tuple[float, float]
    reach: tuple[float, float]
    low: float
    high: float
    ground: float
    body: float


@dataclass
class Scene:
    """Points, terrain and what has been found of them.

    Attributes
    ----------
    air : points above the ground
    height : of each of them above the terrain
    wires : those of them that may be wire
    """

    air: Airborne
    height: Floats
    wires: Airborne
    tolerance: float
    ground: Callable[[float, float], float]
    seen: Callable[[float, float], bool]
    free: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.free = np.ones(len(self.air.xyz), bool)

    def take(self, curves: Iterable[Catenary]) -> None:
        """Mark the points around wires, so that they are not taken for anything else."""
        for curve in curves:
            self.free[self.air.around(curve, 2 * self.tolerance)[0]] = False


def pieces_of(scene: Scene, curves: Sequence[tuple[Floats, Ints]]) -> list[Piece]:
    """Those of the curves that look like wires, with catenaries through their points."""
    strong: list[Piece] = []
    weak: list[Piece] = []
    straight: list[Catenary] = []
    for curve, points in curves:
        length = curve[kernels.HI] - curve[kernels.LO]
        clear = clearness(scene, curve, len(points))
        slope = abs(curve[kernels.Z0 + 1]) / curve[kernels.HALF]
        if clear < CLEAR or slope > STEEPEST:
            continue
        catenary = fit(scene.wires.xyz[points], spread=2 * scene.tolerance)
        if catenary is None or len(points) < LEAST_POINTS:
            continue
        fine = curve[kernels.RMS] < FINE and len(points) >= MANY and clear >= 0.9
        sure = clear >= CLEAR_STRONG and length >= (SHORT if fine else STRONG)
        for arc in arcs_of(scene, Piece(points, catenary)):
            if is_straight(arc.curve):
                straight.append(arc.curve)
            elif arc.curve.c > FATTEST and arc.curve.rms < ROUGH:
                (strong if sure else weak).append(arc)
    arcs = joined(scene, connected(strong, weak))
    scene.take(arc.curve for arc in arcs)
    return [arc for arc in arcs if not carries(scene, arc.curve, straight)]


def clearness(scene: Scene, curve: Floats, count: int) -> float:
    """Share of a curve's length along which there are points on it and few just around it."""
    length = curve[kernels.HI] - curve[kernels.LO]
    bins = max(1, int(length / max(2.0, 3 * length / count)))
    tubed, shelled = np.zeros(bins, np.int64), np.zeros(bins, np.int64)
    air = scene.air
    kernels.profile(curve, length / bins, TUBE, air.xyz, air.start, *air.grid, tubed, shelled)
    return float(np.mean((tubed > 0) & (2 * tubed >= shelled)))


def is_straight(curve: Catenary) -> bool:
    """Whether a curve sags less than the tightest wire, for certain: a rail, a bar or a tie."""
    return curve.sag + STRAIGHT_SIGMAS * curve.sigmas()["sag"] < curve.length**2 / (8 * TIGHTEST_C)


def carries(scene: Scene, curve: Catenary, straight: Sequence[Catenary]) -> bool:
    """Whether something hangs from a curve all along, as from a bridge cable or over a railway.

    It is a straight wire below it in its plane, or hangers: points at all depths in its plane and
    not beside that. Another wire below is at one depth.
    """
    width, depth, step = BLADE
    for other in straight:
        u, _ = curve.along(other.points(np.array([0.0, other.length])))
        shared = min(u.max(), curve.length) - max(u.min(), 0.0)
        if shared > 0.5 * curve.length:
            at = curve.points(np.linspace(max(u.min(), 0.0), min(u.max(), curve.length), 9))
            _, v, z = other.residuals(at)
            if np.abs(v).max() < width and 0.2 < np.median(z) < depth:
                return True
    near, _ = scene.air.around(curve, depth + width)
    near = near[scene.free[near]]
    u, v, z = curve.residuals(scene.air.xyz[near])
    below = (z < -2 * scene.tolerance) & (z > -depth)
    bins = max(1, round(curve.length / step))
    place = np.clip((u / curve.length * bins).astype(np.int64), 0, bins - 1)
    blade = below & (np.abs(v) < width)
    for k in range(bins):  # what is at one depth is another wire
        here = np.flatnonzero(blade & (place == k))
        if len(here):
            blade[here[np.abs(z[here] - np.median(z[here])) < width]] = False
    hung = np.bincount(place[blade], minlength=bins)
    beside = below & (np.abs(v) > 2 * width) & (np.abs(v) < 4 * width)
    around = np.bincount(place[beside], minlength=bins)
    return bool(np.mean((hung >= 2) & (hung > around)) > CARRYING)


def connected(strong: list[Piece], weak: list[Piece]) -> list[Piece]:
    """Short curves count where they go on from, or run beside, one that is known to be a wire."""
    found = list(strong)
    queue = list(strong)
    while queue and weak:
        one = queue.pop()
        near = [piece for piece in weak if goes_on(one, piece) or continues(one, piece)]
        weak = [piece for piece in weak if not any(piece is other for other in near)]
        found += near
        queue += near
    return found


def goes_on(one: Piece, other: Piece) -> bool:
    """Whether two curves end at one support: they come from both sides and meet."""
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        a, b = heading(one, i), heading(other, j)
        step = other.ends[j] - one.ends[i]
        if a @ b > -0.5 or np.hypot(*step[:2]) > JOIN:
            continue
        axis = (a - b) / np.hypot(*(a - b))
        aside = abs(axis[0] * step[1] - axis[1] * step[0])
        halfway = one.ends[i] + 0.5 * step
        meet = [part.curve.height(part.curve.along(halfway[None])[0])[0] for part in (one, other)]
        if aside < JOIN_ASIDE and abs(meet[1] - meet[0]) < JOIN_HEIGHT:
            return True
    return False


def runs_beside(one: Piece, other: Piece) -> bool:
    """Whether the middle of a curve lies beside another of the same heading."""
    a, b = heading(one, 1), heading(other, 1)
    if abs(a @ b) < math.cos(PARALLEL):
        return False
    middle = other.curve.points(np.array([0.5 * other.curve.length]))
    u, v, z = (float(part[0]) for part in one.curve.residuals(middle))
    length = one.curve.length
    return 0 <= u <= length and abs(v) < BESIDE and abs(z) < BESIDE and (math.hypot(v, z) > TUBE)


def heading(piece: Piece, end: int) -> Floats:
    """Unit vector in plan that leads out of a curve at its first (0) or last (1) end."""
    way = 1.0 if end else -1.0
    return way * np.array([piece.curve.ex, piece.curve.ey])


def continues(one: Piece, other: Piece) -> bool:
    """Whether two curves are parts of one wire, side by side in a bundle or one after the other."""
    if abs(heading(one, 1) @ heading(other, 1)) < math.cos(PARALLEL):
        return False
    u, _ = one.curve.along(other.ends)
    gap = max(u.min() - one.curve.length, -u.max())
    if gap > 0:
        reach = min(FARTHEST, one.curve.length + other.curve.length)
        return gap < reach and apart(one, other) < TWIN and apart(other, one) < TWIN
    return apart(one, other) < TWIN


def apart(one: Piece, other: Piece) -> float:
    """Distance of two curves where both have points, or halfway between their ends."""
    a = one.curve
    u, _ = a.along(other.ends)
    low, high = max(0.0, u.min()), min(a.length, u.max())
    if low > high:  # one goes on where the other ends
        low = high = 0.5 * (low + high)
    at = a.points(np.linspace(low, high, 5))
    _, v, z = other.curve.residuals(at)
    return float(np.median(np.hypot(v, z)))


def joined(scene: Scene, pieces: Sequence[Piece]) -> list[Piece]:
    """Pieces of one wire made one, where a single arc fits them all."""
    order = sorted(pieces, key=lambda p: (-p.curve.length, p.curve.x, p.curve.y))
    found: list[Piece] = []
    for piece in order:
        for k, one in enumerate(found):
            if not continues(one, piece):
                continue
            both = np.union1d(one.points, piece.points)
            curve = fit(scene.wires.xyz[both], spread=2.0)
            if curve is None or not agrees(scene, curve, (one, piece)):
                continue
            found[k] = Piece(both, curve)
            break
        else:
            found.append(piece)
    return found if len(found) == len(pieces) else joined(scene, found)


def agrees(scene: Scene, curve: Catenary, parts: Sequence[Piece]) -> bool:
    """Whether the heights of all parts are as near to a common curve as to their own."""
    for part in parts:
        xyz = scene.wires.xyz[part.points]
        own, common = (np.abs(c.residuals(xyz)[2]) for c in (part.curve, curve))
        if np.median(common) > 2 * np.median(own) + 0.05:
            return False
    return True


# --- supports ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Hint:
    """An end of an arc."""

    place: Floats
    way: Floats  # unit vector out of the wire
    slope: float  # upwards that way
    piece: int


def cusps(points: Floats, curve: Catenary) -> list[float]:
    """Distances u at which arcs of one wire meet although it was followed as one.

    There the heights have a kink beside a parabola: that of the whole, or of the neighbourhood if
    there are several cusps.
    """
    u, v, z = curve.residuals(points)
    good = np.hypot(v, z) < 1.0
    u, z = u[good], z[good]
    found: list[float] = []
    if len(u) < 12 or np.ptp(u) < 3 * CUSP_MARGIN:
        return found
    at = np.arange(u.min() + CUSP_MARGIN, u.max() - CUSP_MARGIN, 1.0)
    if (place := cusp_at(u, z, at)) is not None:
        found.append(place)
    for middle in np.arange(at[0], at[-1], 0.5 * WINDOW):
        near = np.abs(u - middle) < WINDOW
        inner = at[np.abs(at - middle) < 0.5 * WINDOW]
        if np.count_nonzero(near) < 12 or not len(inner):
            continue
        place = cusp_at(u[near], z[near], inner)
        if place is not None and all(abs(place - other) > WINDOW / 2 for other in found):
            found.append(place)
    return sorted(found)


def cusp_at(u: Floats, z: Floats, at: Floats) -> float | None:
    """The place of the clearest kink downwards, if it is certain."""
    slope, square, total = kinks(u, z, at)
    gain = np.where(slope > CUSP, 0.0, slope**2 * square)
    k = int(np.argmax(gain))
    sigma = math.sqrt(max(total - gain[k], 1e-12) / max(len(u) - 4, 1))
    certain = gain[k] > CUSP_GAIN * total and math.sqrt(gain[k]) > CUSP_SIGMAS * sigma
    return float(at[k]) if certain else None


def arcs_of(scene: Scene, piece: Piece) -> Iterator[Piece]:
    """A curve that was followed across supports, cut at the cusps there."""
    xyz = scene.wires.xyz[piece.points]
    places = cusps(xyz, piece.curve)
    if not places:
        yield piece
        return
    u, _ = piece.curve.along(xyz)
    number = np.searchsorted(places, u)
    for k in range(len(places) + 1):
        mine = piece.points[number == k]
        curve = fit(scene.wires.xyz[mine], spread=2 * scene.tolerance)
        if curve is not None:
            yield Piece(mine, curve)


def kinks(u: Floats, z: Floats, at: Floats) -> tuple[Floats, Floats, float]:
    """By how much the slope of heights changes at each of several places, beside any parabola.

    Parameters
    ----------
    u, z : arrays of shape (n,), distances along a wire and heights above its catenary
    at : array of shape (k,)

    Returns
    -------
    slope : array of shape (k,), of the kink that explains most of the heights
    square : array of shape (k,); what a kink explains of the sum of squares is slope**2 * square
    total : sum of squares beside a parabola
    """
    base, _ = np.linalg.qr(np.column_stack([np.ones(len(u)), u, u * u]))
    bend = np.maximum(u[:, None] - at, 0.0)
    bend -= base @ (base.T @ bend)
    left = z - base @ (base.T @ z)
    square = np.maximum((bend**2).sum(axis=0), 1e-9)
    return (bend.T @ left) / square, square, float((left**2).sum())


def hints_of(pieces: Sequence[Piece]) -> list[Hint]:
    """Both ends of all arcs."""
    hints = []
    for number, piece in enumerate(pieces):
        for end, place in enumerate(piece.ends):
            u = piece.curve.length * end + np.array([-0.5, 0.5])
            rise = float(np.diff(piece.curve.height(u))[0])
            hints.append(Hint(place, heading(piece, end), rise if end else -rise, number))
    return hints


def supports_of(scene: Scene, pieces: Sequence[Piece]) -> list[Support]:
    """Where wires end together, or have cusps, and what stands there.

    Parameters
    ----------
    scene : whose points around the curves are taken
    """
    scene.free[:] = True
    scene.take(piece.curve for piece in pieces)
    hints = hints_of(pieces)
    found = []
    for group in clusters(hints):
        support = support_of(scene, pieces, group)
        if support is not None:
            found.append(support)
    return sorted(found, key=lambda s: (s.x, s.y))


def clusters(hints: Sequence[Hint]) -> Iterator[list[Hint]]:
    """Hints near each other: less far along the wires than across them."""
    if not hints:
        return
    place = np.array([hint.place for hint in hints])
    way = np.array([hint.way for hint in hints])
    step = place[None, :, :2] - place[:, None, :2]
    along = np.abs((step * way[:, None]).sum(axis=2))
    across = np.abs(step[..., 0] * way[:, None, 1] - step[..., 1] * way[:, None, 0])
    near = (along < ALONG) & (across < ACROSS)
    alike = np.abs(way @ way.T) > 0.7
    link = near & near.T & alike
    _, label = connected_components(coo_array(link), directed=False)
    for number in range(label.max() + 1):
        yield [hints[i] for i in np.flatnonzero(label == number).tolist()]


def support_of(scene: Scene, pieces: Sequence[Piece], group: Sequence[Hint]) -> Support | None:
    """The support at a group of ends and cusps, or None if there is no reason for one."""
    place = np.array([hint.place for hint in group])
    way = np.array([hint.way for hint in group])
    axis = way * np.sign(way @ way[0] + 1e-12)[:, None]
    mean = axis.mean(axis=0)
    mean /= np.hypot(*mean)
    across = np.array([-mean[1], mean[0]])
    centre = place[:, :2].mean(axis=0)
    side = (place[:, :2] - centre) @ across
    forward = way @ mean > 0
    here, there = np.flatnonzero(forward), np.flatnonzero(~forward)
    pairs, bend = 0, 0.0
    for i in here.tolist():
        match = [
            j
            for j in there.tolist()
            if abs(side[j] - side[i]) < 3.0 and abs(place[j, 2] - place[i, 2]) < 3.0
        ]
        if match:
            pairs += 1
            turn = abs(way[i, 0] * way[match[0], 1] - way[i, 1] * way[match[0], 0])
            bend = max(bend, turn, group[i].slope + group[match[0]].slope)
    mine = {hint.piece for hint in group}
    others = [piece for k, piece in enumerate(pieces) if k not in mine]
    passing = sum(passes(piece, centre, across, side, place[:, 2]) for piece in others)
    if passing > len(mine):
        return None
    # The middle between opposite ends, or where the ends are.
    forth = (place[:, :2] - centre) @ mean
    if len(here) and len(there):
        middle = 0.5 * (np.median(forth[here]) + np.median(forth[there]))
    else:
        middle = float(np.median(forth))
    spot = centre + middle * mean
    low, high = float(place[:, 2].min()), float(place[:, 2].max())
    bottom = float(scene.ground(spot[0], spot[1]))
    body, spot = body_at(scene, spot, mean, (side.min(), side.max()), high - bottom)
    certain = pairs >= 2 or (pairs == 1 and (body >= ENOUGH_BODY or bend > ANGLE))
    if pairs == 0:
        out = mean if len(here) else -mean
        ends = forth[here if len(here) else there]
        beyond = all(scene.seen(*(spot + metres * out)) for metres in (7.0, 10.0))
        certain = len(ends) >= 2 and np.ptp(ends) < 6 and beyond
        certain |= body >= MUCH_BODY and topped(scene, spot, mean, side, high)
    if not certain:
        return None
    shift = (spot - centre) @ across
    side = side - shift
    return Support(
        float(spot[0]), float(spot[1]), (float(across[0]), float(across[1])),
        (float(side.min()), float(side.max())), low, high,
        float(scene.ground(spot[0], spot[1])), body,
    )  # fmt: skip


def topped(scene: Scene, spot: Floats, mean: Floats, side: Floats, high: float) -> bool:
    """Whether there are points of a body as high as the highest wire."""
    near = within(scene.air, spot, ALONG + float(np.ptp(side)))
    near = near[scene.free[near]]
    step = scene.air.xyz[near, :2] - spot
    z = scene.air.xyz[near, 2]
    inside = (np.abs(step @ mean) < 3) & (z > high - 2) & (z < high + 4)
    return int(inside.sum()) >= 3


def passes(piece: Piece, centre: Floats, across: Floats, side: Floats, heights: Floats) -> bool:
    """Whether a wire goes through the arms of a support as if there was none."""
    u, _ = piece.curve.along(np.array([[*centre, 0.0]]))
    if not CUSP_MARGIN < u[0] < piece.curve.length - CUSP_MARGIN:
        return False
    x, y, z = piece.curve.points(u)[0]
    s = (np.array([x, y]) - centre) @ across
    beside = side.min() - ACROSS / 2 < s < side.max() + ACROSS / 2
    return bool(beside and heights.min() - ACROSS / 2 < z < heights.max() + ACROSS / 2)


def support_at(scene: Scene, places: Floats, mean: Floats, clear: bool) -> Support | None:
    """The support at a kink of several wires, if it is clear or there is a body.

    Parameters
    ----------
    places : array of shape (n, 3), one for each wire
    mean : unit vector along them
    """
    centre = places[:, :2].mean(axis=0)
    across = np.array([-mean[1], mean[0]])
    side = (places[:, :2] - centre) @ across
    low, high = float(places[:, 2].min()), float(places[:, 2].max())
    top = high - float(scene.ground(*centre))
    body, spot = body_at(scene, centre, mean, (side.min(), side.max()), top)
    if not clear and body < LEAST_BODY:
        return None
    side = side - (spot - centre) @ across
    return Support(
        float(spot[0]), float(spot[1]), (float(across[0]), float(across[1])),
        (float(side.min()), float(side.max())), low, high, float(scene.ground(*spot)), body,
    )  # fmt: skip


def body_at(
    scene: Scene, spot: Floats, mean: Floats, sides: tuple[float, float], top: float
) -> tuple[float, Floats]:
    """Share of the height at which there are points of a vertical body, and where it stands."""
    air = scene.air
    reach = ALONG + abs(sides[1] - sides[0])
    near = within(air, spot, reach)
    near = near[scene.free[near]]
    if not len(near):
        return 0.0, spot
    across = np.array([-mean[1], mean[0]])
    step = air.xyz[near, :2] - spot
    along, side, height = step @ mean, step @ across, scene.height[near]
    keep = (np.abs(along) < 6) & (side > sides[0] - 2) & (side < sides[1] + 2)
    keep &= (height > 1) & (height < top)
    along, side, height = along[keep], side[keep], height[keep]
    half = 1.0 if top < 15 else 2.5
    levels = max(1, int(top - 1))
    best, at = 0.0, spot
    for a in np.arange(-5, 5.5, 1.0):
        for s in np.arange(math.floor(sides[0]) - 1, sides[1] + 2, 1.0):
            inside = (np.abs(along - a) < half) & (np.abs(side - s) < half)
            share = len(np.unique(height[inside].astype(np.int64))) / levels
            share -= 0.002 * math.hypot(a, s)
            if share > best:
                best = share
                at = spot + np.median(along[inside]) * mean + np.median(side[inside]) * across
    return min(best, 1.0), at if best >= ENOUGH_BODY else spot


def within(air: Airborne, spot: Floats, reach: float) -> Ints:
    """Indices of the points in a square around a place."""
    west, south, cell, rows, cols = air.grid
    r0, r1 = (int((spot[1] + d - south) // cell) for d in (-reach, reach))
    c0, c1 = (int((spot[0] + d - west) // cell) for d in (-reach, reach))
    r0, r1, c0, c1 = max(r0, 0), min(r1, rows - 1), max(c0, 0), min(c1, cols - 1)
    if c0 > c1:
        return np.zeros(0, np.int64)
    runs = [
        np.arange(air.start[r * cols + c0], air.start[r * cols + c1 + 1]) for r in range(r0, r1 + 1)
    ]
    return np.concatenate([np.zeros(0, np.int64), *runs])
