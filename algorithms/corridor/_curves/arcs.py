"""Where the supports of a line stand: all its wires are cut into arcs at the same places.

Between two supports the wires of a line hang as arcs of about one curvature, which the whole line
has in common, for its conductors are of one kind under one tension. Of all the ways to cut the
line the one is taken in which the arcs fit best, at a price for each cut, by dynamic programming
(Bellman 1961). What sticks out of the wires at one place, such as an arm, makes a cut there
cheaper. In a valley, where wires pull up at their support and hardly bend there, and where points
are few, that finds what no wire shows alone.

References
----------
Bellman, R. (1961). On the approximation of curves by line segments using dynamic programming.
CACM 4(6), 284.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from algorithms.corridor._curves import arcs_kernels as kernels
from algorithms.corridor._curves.catenary import fit
from algorithms.corridor._curves.network import Piece, Scene
from algorithms.corridor._curves.tracks import Run
from algorithms.shared.kernels.sorting import distinct

STICKS = 0.2  # metres off its neighbours, of what is no part of a wire
SMOOTH = 0.12  # metres: scatter of a wire
COARSE = 3  # steps, to find the common curvature
TIGHT, SLACK, RATIO = 1 / 3000, 1 / 100, 1.3  # 1 / metre: curvatures to try, and their ratio
SPREAD = 0.3  # of the curvature of a line, by which wires and spans differ
SHORTEST = 20.0  # metres between two supports
NOISE, BLUR, SWAY = 0.03, 0.03, 0.15  # metres: least scatter of a point; of many, up and aside
CUT, CUT_EACH = 10.0, 6.0  # squares of sigmas: price of a cut, and for each wire
CLEAR = 15.0  # squares of sigmas: a certain arm
MOST_PAID = 1.4  # of its share of the price, by a wire among many
OFF, ARM, FEWEST = 0.15, 0.3, 0.25  # metres off all wires, half width of an arm; points
ASIDE, ABOVE, BELOW, DEEP = 1.0, 1.2, 0.3, 2.6  # metres around the wires: an arm, and trees
COLUMN = 0.1  # metres: across the line, what hangs from one wire
CLOSE, NEXT, WIDE = 0.5, 1.5, 6.0  # metres from an arm, where the usual points are counted
FINER = 4  # places between stations at which an arm may be
STUB = 12.0  # metres: what goes on so far beyond the outermost support
MEET = 0.1  # metres by which arcs may miss each other at a support
SHIFT = 5.0  # metres by which a cut may be moved to where they meet

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Binned:
    """What is seen of the tracks between stations, arrays of shape (steps, tracks)."""

    step: float  # metres between stations
    tall: Floats  # 1 / variance of heights; 0 where nothing is seen
    flat: Floats  # the same of offsets
    u: Floats
    z: Floats
    v: Floats


def arcs_of(scene: Scene, runs: Sequence[Run]) -> tuple[list[Piece], list[Run]]:
    """The wires of runs cut at their supports, and the runs with the places of these."""
    arcs: list[Piece] = []
    cut: list[Run] = []
    for number, run in enumerate(runs):
        certain = [piece for piece in run.pieces if is_certain(scene, run, piece)]
        cuts = cuts_of(scene, replace(run, pieces=certain or run.pieces))
        cut.append(replace(run, cuts=cuts))
        for piece in run.pieces:
            arcs += cut_up(scene, cut[-1], piece, number)
    return arcs, cut


def is_certain(scene: Scene, run: Run, piece: Piece) -> bool:
    """Whether a track has a say in where supports are: it is a wire by itself, and smooth."""
    xyz = scene.wires.xyz[piece.points]
    return piece.sure and scatter(run.along(xyz)[0], xyz[:, 2]) < SMOOTH


def cut_up(scene: Scene, run: Run, piece: Piece, number: int) -> Iterator[Piece]:
    """The arcs of one track; none of what goes a short way beyond the outermost supports."""
    u, _ = run.along(scene.wires.xyz[piece.points])
    arc = np.searchsorted(run.cuts, u)
    edges = [0.0, *run.cuts, run.step * run.steps]
    for k in np.unique(arc).tolist():
        stub = len(run.cuts) > 0 and k in (0, len(run.cuts)) and edges[k + 1] - edges[k] < STUB
        points = piece.points[arc == k]
        curve = fit(scene.wires.xyz[points], spread=2 * scene.tolerance)
        if curve is not None and not stub:
            yield replace(piece, points=points, curve=curve, arc=(number, k))


def binned(scene: Scene, run: Run, step: float) -> Binned:
    """Mean place, height and offset of the points of each track between stations."""
    steps = math.ceil(run.step * run.steps / step)
    parts = Binned(step, *(np.zeros((steps, len(run.pieces))) for _ in range(5)))
    for k, piece in enumerate(run.pieces):
        xyz = scene.wires.xyz[piece.points]
        u, v = run.along(xyz)
        cell = np.clip((u / step).astype(np.int64), 0, steps - 1)
        count = np.maximum(np.bincount(cell, minlength=steps), 1e-9)
        for part, values in ((parts.u, u), (parts.z, xyz[:, 2]), (parts.v, v)):
            part[:, k] = np.bincount(cell, values, steps) / count
        for part, values, blur in ((parts.tall, xyz[:, 2], BLUR), (parts.flat, v, SWAY)):
            variance = scatter(u, values) ** 2
            part[:, k] = np.where(count > 0.5, count / (variance + count * blur**2), 0.0)
        seen = np.flatnonzero(count > 0.5)
        if len(seen) > 4:  # not what sticks out of the wire, such as an arm
            off = np.abs(astray(parts.u[seen, k], parts.z[seen, k]))
            peak = (off > STICKS) & (off >= np.append(off[1:], 0)) & (off >= np.append(0, off[:-1]))
            parts.tall[seen[1:-1][peak], k] = parts.flat[seen[1:-1][peak], k] = 0.0
    return parts


def astray(u: Floats, z: Floats) -> Floats:
    """How far each value but the first and last is off the line between its neighbours."""
    share = (u[1:-1] - u[:-2]) / np.maximum(u[2:] - u[:-2], 1e-6)
    return z[1:-1] - (1 - share) * z[:-2] - share * z[2:]


def scatter(u: Floats, z: Floats) -> float:
    """Standard deviation of heights along a wire, from that of each between its neighbours."""
    if len(u) < 5:
        return 2 * NOISE
    order = np.argsort(u, kind="stable")
    usual = np.median(np.abs(astray(u[order], z[order])))
    return max(float(usual) / (0.6745 * math.sqrt(1.5)), NOISE)


def hardware(scene: Scene, run: Run, parts: Binned, places: Floats) -> Floats:
    """How sure it is, in squares of sigmas, that an arm stands at places along a run.

    An arm is points among the wires that lie on none of them. It reaches across, so columns with
    points are counted, and is thin: a little way before and behind, a tree that comes up from
    below has as many. Twice the logarithm of the ratio of likelihoods of two Poisson distributions.
    """
    seen = [parts.tall[:, k] > 0 for k in range(parts.u.shape[1])]
    tracks = [
        (parts.u[rows, k], parts.v[rows, k], parts.z[rows, k])
        for k, rows in enumerate(seen) if rows.any()
    ]  # fmt: skip
    shape = np.full((4, len(places)), np.nan)  # left, right, low, high
    for u, v, z in tracks:
        cover = (places >= u[0]) & (places <= u[-1])
        for row, which, values in zip(range(4), (np.fmin, np.fmax) * 2, (v, v, z, z), strict=True):
            shape[row, cover] = which(shape[row, cover], np.interp(places[cover], u, values))
    known = np.flatnonzero(~np.isnan(shape[0]))
    if not len(known):
        return np.zeros(len(places))
    reach = float(np.nanmax(np.abs(shape[:2]))) + ASIDE + WIDE
    spots = run.places(np.arange(places[0], places[-1] + WIDE, WIDE))
    box = distinct(np.concatenate([scene.air.within(spot, reach) for spot in spots]))
    u, v = run.along(scene.air.xyz[box])
    z = scene.air.xyz[box, 2]
    left, right, low, high = (np.interp(u, places[known], values[known]) for values in shape)
    stray = (v > left - ASIDE) & (v < right + ASIDE) & (z > low - DEEP) & (z < high + ABOVE)
    for along, aside, up in tracks:
        off = np.hypot(v - np.interp(u, along, aside), z - np.interp(u, along, up))
        stray &= (off > OFF) | (u < along[0] - 1) | (u > along[-1] + 1)
    around, among = (columns(u[rows], v[rows]) for rows in (stray, stray & (z > low - BELOW)))

    def count(u: Floats, a: float, b: float) -> Floats:
        within = np.searchsorted(u, places + b) - np.searchsorted(u, places + a)
        return np.asarray(within, float)

    here, usual = count(among, -ARM, ARM), np.full(len(places), FEWEST)
    for u, a, b in ((around, CLOSE, NEXT), (among, NEXT, WIDE)):
        beside = np.maximum(count(u, -b, -a), count(u, a, b))
        usual = np.maximum(usual, beside * 2 * ARM / (b - a))
    more = 2 * (here * np.log(np.maximum(here, 1.0) / usual) - (here - usual))
    spread = max(1.0, float(np.median(more)) / 0.4549)  # more than by chance
    return np.where(here > usual, more / spread, 0.0)


def columns(u: Floats, v: Floats) -> Floats:
    """Places along a run of upright columns with points: what hangs from a wire is only one."""
    cell = np.floor(np.column_stack([u, v]) / COLUMN)
    _, which, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    return np.sort(np.bincount(which.ravel(), u, len(count)) / count)


def cuts_of(scene: Scene, run: Run) -> Floats:
    """Places along a run at which its wires are held, in order."""
    coarse = binned(scene, run, COARSE * run.step)
    usual = CUT + CUT_EACH * tracks_at(coarse)
    bends = TIGHT * RATIO ** np.arange(math.log(SLACK / TIGHT) / math.log(RATIO))
    bend = min(bends, key=lambda bend: solved(coarse, bend, usual)[0])
    fine = binned(scene, run, run.step)
    places = run.step / FINER * np.arange(FINER * run.steps + 1, dtype=np.float64)
    shown = hardware(scene, run, fine, places)
    wires = maximum_filter1d(tracks_at(fine), 2 * round(SHORTEST / run.step) + 1)
    usual = CUT + CUT_EACH * wires
    price = np.maximum(usual - maximum_filter1d(shown, FINER + 1)[::FINER], 0.0)
    edges = solved(fine, bend, price)[1]
    edges = agreed(fine, edges, bend, usual, price)
    return np.array([
        settled(fine, edges[k - 1], edges[k], edges[k + 1], bend, places, shown)
        for k in range(1, len(edges) - 1)
    ])  # fmt: skip


def misfits(parts: Binned, low: Ints, high: Ints, bend: float) -> Floats:
    """Squares of sigmas by which each track is off an arc, array of shape (arcs, tracks)."""
    found = np.empty((len(low), parts.u.shape[1]))
    kernels.misfits(
        parts.tall, parts.flat, parts.u / parts.step, parts.z, parts.v, low, high,
        bend * parts.step**2, SPREAD * bend * parts.step**2, found,
    )  # fmt: skip
    return found


def agreed(parts: Binned, edges: Ints, bend: float, usual: Floats, price: Floats) -> Ints:
    """The cuts for which enough of the tracks pay: some three of four, of few tracks one less.

    One may follow another wire, or be pushed off by a crane beside it, and would pay for all. What
    the most is that one pays goes by the usual price, where none sees an arm.
    """
    tracks = np.maximum(tracks_at(parts), 1)
    most = MOST_PAID * usual / tracks * (tracks + 1) / tracks
    while len(edges) > 2:
        arcs = misfits(parts, edges[:-1], edges[1:], bend)
        gain = misfits(parts, edges[:-2], edges[2:], bend) - arcs[:-1] - arcs[1:]
        paid = np.minimum(gain, most[edges[1:-1], None]).sum(axis=1)
        spare = paid - price[edges[1:-1]]
        worst = int(np.argmin(spare))
        if spare[worst] >= 0:
            break
        edges = np.delete(edges, worst + 1)
    return edges


def tracks_at(parts: Binned) -> Floats:
    """Number of tracks that go on across each station."""
    seen = parts.tall > 0
    behind = np.maximum.accumulate(seen, axis=0)
    ahead = np.maximum.accumulate(seen[::-1], axis=0)[::-1]
    across = np.zeros(len(seen) + 1)
    across[1:-1] = (behind[:-1] & ahead[1:]).sum(axis=1)
    return across


def solved(parts: Binned, bend: float, price: Floats) -> tuple[float, Ints]:
    """Least cost, and the stations at which the tracks are cut for it, with both ends."""
    steps = len(parts.u)
    total, before = np.empty(steps + 1), np.zeros(steps + 1, np.int64)
    kernels.cuts(
        parts.tall, parts.flat, parts.u / parts.step, parts.z, parts.v, price,
        bend * parts.step**2, SPREAD * bend * parts.step**2,
        max(2, round(SHORTEST / parts.step)), total, before,
    )  # fmt: skip
    edges = [steps]
    while edges[-1] > 0:
        edges.append(int(before[edges[-1]]))
    return float(total[-1]), np.array(edges[::-1])


def settled(
    parts: Binned, low: int, at: int, high: int, bend: float, places: Floats, shown: Floats
) -> float:
    """A cut moved to where the arcs on both sides meet, and where an arm shows."""
    middle = at * parts.step
    near = np.abs(places - middle) < SHIFT
    near &= (places > low * parts.step + 1.0) & (places < high * parts.step - 1.0)
    if not near.any():
        return middle
    places, cost = places[near], -np.minimum(shown[near], CLEAR)
    x = places - middle
    base = np.column_stack([np.ones(len(x)), x, 0.5 * x * x])
    before, after = slice(low, at), slice(at, high)
    for weight, values, usual in ((parts.tall, parts.z, bend), (parts.flat, parts.v, 0.0)):
        for k in np.flatnonzero((parts.tall[low:high] > 0).any(axis=0)).tolist():
            one, two = (
                arc(parts.u[s, k] - middle, values[s, k], weight[s, k], usual, SPREAD * bend)
                for s in (before, after)
            )
            if one is not None and two is not None:
                gap = base @ (two[0] - one[0])
                variance = np.einsum("ij,jk,ik->i", base, one[1] + two[1], base) + MEET**2
                cost += gap**2 / variance
    return float(places[int(np.argmin(cost))])


def arc(
    x: Floats, values: Floats, weight: Floats, usual: float, spread: float
) -> tuple[Floats, Floats] | None:
    """Value, slope and curvature at x = 0 of the arc through values, and their covariance."""
    used = weight > 0
    if np.count_nonzero(used) < 3:
        return None
    x, values, weight = x[used], values[used], weight[used]
    base = np.column_stack([np.ones(len(x)), x, 0.5 * x * x])
    normal = (base * weight[:, None]).T @ base
    normal[2, 2] += 1 / spread**2
    right = base.T @ (weight * values)
    right[2] += usual / spread**2
    inverse = np.asarray(np.linalg.inv(normal))
    return np.asarray(inverse @ right), inverse
