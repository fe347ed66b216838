"""Arcs from tracks: all wires of a line are cut at the same chainages, those of its supports.

Between two supports the wires of a line hang as arcs of about one curvature, which the whole line
has in common, for its conductors are of one kind under one tension. Of all the ways to cut the
line the one is taken in which the arcs fit best, at a price for each cut, by dynamic programming
(Bellman 1961). What sticks out of the wires at one chainage, such as an arm, makes a cut there
cheaper. In a valley, where wires pull up at their support and hardly bend there, and where points
are few, that finds what no wire shows alone.

References
----------
Bellman, R. (1961). On the approximation of curves by line segments using dynamic programming.
CACM 4(6), 284.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from algorithms.corridor._curves import arcs_kernels as kernels
from algorithms.corridor._curves.catenary import fit
from algorithms.corridor._curves.hardware import hardware
from algorithms.corridor._curves.lanes import lanes_of, points_per_metre
from algorithms.corridor._curves.network import Corridor, Piece
from algorithms.corridor._curves.tracks import Alignment
from algorithms.corridor._settings import SETTINGS

POSITIONS_PER_BIN = 4  # positions in a bin at which an arm may be

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Binned:
    """Means and weights of the points of each track in each bin, arrays of shape (bins, tracks)."""

    step: float  # metres, length of a bin
    tall: Floats  # 1 / variance of heights; 0 where nothing is seen
    flat: Floats  # the same of offsets
    u: Floats
    z: Floats
    v: Floats

    def of(self, tracks: Ints) -> Binned:
        """Those of some of the tracks."""
        tables = (self.tall, self.flat, self.u, self.z, self.v)
        return Binned(self.step, *(table[:, tracks] for table in tables))

    def tracks(self) -> list[tuple[Floats, Floats, Floats]]:
        """Chainages, offsets and heights of each track, where it is seen."""
        seen = [(k, self.tall[:, k] > 0) for k in range(self.u.shape[1])]
        return [
            (self.u[rows, k], self.v[rows, k], self.z[rows, k]) for k, rows in seen if rows.any()
        ]


def arcs_of(
    corridor: Corridor, alignments: Sequence[Alignment]
) -> tuple[list[Piece], list[Alignment]]:
    """Arcs of wires between their supports, and the alignments with the chainages of the cuts."""
    arcs: list[Piece] = []
    cut: list[Alignment] = []
    for whole, alignment in enumerate(alignments):
        for line in lines_with_cuts(corridor, replace(alignment, whole=whole)):
            for piece in line.pieces:
                arcs += cut_up(corridor, line, piece, len(cut))
            cut.append(line)
    return arcs, cut


def lines_with_cuts(corridor: Corridor, alignment: Alignment) -> Iterator[Alignment]:
    """The lines of an alignment with the chainages of their cuts.

    Lines that run beside each other have supports of their own: there they are cut apart.
    """
    certain = [piece for piece in alignment.pieces if is_certain(corridor, alignment, piece)]
    telling = replace(alignment, pieces=certain or alignment.pieces)
    cuts, sigmas, coarse, bend = cuts_of(corridor, telling, telling.tracks(corridor))
    between = parting(corridor, telling, coarse, bend) if len(cuts) else None
    if between is None:
        cuts, sigmas = cut_together(corridor, alignment, telling, cuts) or (cuts, sigmas)
        yield replace(alignment, cuts=cuts, sigmas=sigmas)
        return
    left = [offset_of(corridor, alignment, piece) > between for piece in alignment.pieces]
    for side in (True, False):
        own = [
            piece for piece, is_left in zip(alignment.pieces, left, strict=True) if is_left == side
        ]
        yield from lines_with_cuts(corridor, replace(alignment, pieces=own))


def cut_together(
    corridor: Corridor, alignment: Alignment, telling: Alignment, cuts: Floats
) -> tuple[Floats, Floats] | None:
    """Cuts of sparse wires by all of them as one, and standard deviations; None for others.

    Arcs through a few points of one wire fit anything, also two spans as one. But the wires of a
    span hang in one shape.

    Parameters
    ----------
    telling : the alignment, but only with the tracks by which it was cut
    cuts : chainages found so, with arcs for each track of its own
    """
    seen = points_per_metre(telling.tracks(corridor))
    usual = alignment.step * alignment.steps / (len(cuts) + 1)
    if seen * usual >= SETTINGS.curves.isolated_points:
        return None
    sure = replace(alignment, pieces=[piece for piece in alignment.pieces if piece.sure])
    tracks = sure.tracks(corridor)
    lanes = lanes_of(corridor, tracks)
    return cuts_of(corridor, sure, lanes.as_one(tracks))[:2] if lanes else None


def parting(corridor: Corridor, alignment: Alignment, bins: Binned, bend: float) -> float | None:
    """Offset between two lines side by side; None if all wires fit arcs with common cuts better.

    Two lines pay for the cuts of each, and so cost more where their supports stand side by side;
    less where each has its own, at which the wires of the other do not bend. Most of their cuts
    must be where the other has none. Arms do not count, for they make cuts cheap that are certain
    anyway. A single wire is no line: it may follow another one, and bend where no other does.

    Parameters
    ----------
    bins, bend : coarse ones, and the curvature that the arcs have in common
    """
    offsets = np.array([offset_of(corridor, alignment, piece) for piece in alignment.pieces])
    order = np.argsort(offsets, kind="stable")
    least, found = solved(bins, bend, usual_price(bins))[0], None
    for k in range(2, len(order) - 1):
        low, high = offsets[order[k - 1]], offsets[order[k]]
        if high - low > SETTINGS.network.bundle_width:
            parts = [bins.of(part) for part in (order[:k], order[k:])]
            costs, edges = zip(*(solved(p, bend, usual_price(p)) for p in parts), strict=True)
            held = (held_within(*own, bend) for own in zip(parts, edges, strict=True))
            if sum(costs) < least and mostly_apart(*held):
                least, found = sum(costs), float(low + high) / 2
    return found


def mostly_apart(one: Floats, other: Floats) -> bool:
    """Whether most supports of two lines are where the other has none; see :func:`held_within`."""
    gap = np.maximum(one[:, None, 0] - other[:, 1], other[:, 0] - one[:, None, 1])
    away = gap > SETTINGS.arcs.most_shift
    alone = np.concatenate([away.all(axis=0), away.all(axis=1)])
    return bool(2 * np.count_nonzero(alone) > len(alone))


def held_within(bins: Binned, edges: Ints, bend: float) -> Floats:
    """From where to where each support may stand of a line that is cut at edges, both ends given.

    A wire is cut at both ends of its strings, where they are as long as those of a bundle. So two
    cuts are of one support where the points between them do not tell that a span hangs there.

    Returns
    -------
    array of shape (n, 2), chainages
    """
    inner = edges[1:-1]
    told = [tells_curvature(bins, *two, bend) for two in itertools.pairwise(inner.tolist())]
    parts = np.split(inner, np.flatnonzero(told) + 1) if len(inner) else []
    return bins.step * np.array([(own[0], own[-1]) for own in parts]).reshape(-1, 2)


def tells_curvature(bins: Binned, low: int, high: int, bend: float) -> bool:
    """Whether points between two edges tell more of the curvature there than the other arcs do."""
    spread, told = SETTINGS.arcs.curvature_spread * bend, 0.0
    for k in np.flatnonzero((bins.tall[low:high] > 0).any(axis=0)).tolist():
        u, z, weight = (table[low:high, k] for table in (bins.u, bins.z, bins.tall))
        fitted = arc(u - low * bins.step, z, weight, bend, spread)
        told += 0.0 if fitted is None else 1 / fitted[1][2, 2] - 1 / spread**2
    return told > 1 / spread**2


def usual_price(bins: Binned) -> Floats:
    """Price of a cut at each edge between two bins, where no arm is seen."""
    return SETTINGS.arcs.cut_price + SETTINGS.arcs.cut_price_per_wire * tracks_at(bins)


def offset_of(corridor: Corridor, alignment: Alignment, piece: Piece) -> float:
    """Mean distance of a track to the left of the axis, metres."""
    return float(alignment.along(corridor.wires.xyz[piece.points])[1].mean())


def is_certain(corridor: Corridor, alignment: Alignment, piece: Piece) -> bool:
    """Whether a track is certain and smooth enough to locate supports.

    Surveys scatter no less where wires above each other are looked for at a smaller tolerance.
    """
    xyz = corridor.wires.xyz[piece.points]
    smooth = SETTINGS.arcs.smooth * max(corridor.tolerance, SETTINGS.lines.tolerances[0])
    return piece.sure and scatter(alignment.along(xyz)[0], xyz[:, 2]) < smooth


def cut_up(corridor: Corridor, alignment: Alignment, piece: Piece, number: int) -> Iterator[Piece]:
    """The arcs of one track, without short stubs beyond the outermost supports."""
    u, _ = alignment.along(corridor.wires.xyz[piece.points])
    arc = np.searchsorted(alignment.cuts, u)
    edges = [0.0, *alignment.cuts, alignment.step * alignment.steps]
    for k in np.unique(arc).tolist():
        stub = (
            len(alignment.cuts) > 0
            and k in (0, len(alignment.cuts))
            and edges[k + 1] - edges[k] < 2 * SETTINGS.trace.seed_reach
        )
        points = piece.points[arc == k]
        curve = fit(corridor.wires.xyz[points], spread=corridor.own_radius)
        if curve is not None and not stub:
            yield replace(piece, points=points, curve=curve, arc=(number, k))


def binned(
    corridor: Corridor,
    alignment: Alignment,
    tracks: Sequence[Floats],
    together: int,
    wander: float,
) -> Binned:
    """Mean chainage, height and offset of the points of each track in each bin, with weights.

    A bin is `together` bins of the alignment, which are counted and not measured: a quotient of
    lengths may come out a little above a whole number, and would have one bin too many.
    """
    step, steps = together * alignment.step, math.ceil(alignment.steps / together)
    bins = Binned(step, *(np.zeros((steps, len(tracks))) for _ in range(5)))
    for k, (u, v, z) in enumerate(track.T for track in tracks):
        cell = np.clip((u / step).astype(np.int64), 0, steps - 1)
        count = np.maximum(np.bincount(cell, minlength=steps), 1e-9)
        for table, values in ((bins.u, u), (bins.z, z), (bins.v, v)):
            table[:, k] = np.bincount(cell, values, steps) / count
        for table, values, blur in (
            (bins.tall, z, wander * math.sqrt(SETTINGS.arcs.wander_length / step)),
            (bins.flat, v, SETTINGS.lanes.wander),
        ):
            variance = scatter(u, values) ** 2
            table[:, k] = np.where(count > 0.5, count / (variance + count * blur**2), 0.0)
        seen = np.flatnonzero(count > 0.5)
        if len(seen) > 4:  # not what sticks out of the wire, such as an arm
            off = np.abs(astray(bins.u[seen, k], bins.z[seen, k]))
            peak = (
                (off > SETTINGS.curves.roughest * corridor.tolerance)
                & (off >= np.append(off[1:], 0))
                & (off >= np.append(0, off[:-1]))
            )
            bins.tall[seen[1:-1][peak], k] = bins.flat[seen[1:-1][peak], k] = 0.0
    return bins


def astray(u: Floats, z: Floats) -> Floats:
    """Difference of each value but the first and last from the line between its neighbours."""
    share = (u[1:-1] - u[:-2]) / np.maximum(u[2:] - u[:-2], 1e-6)
    return z[1:-1] - (1 - share) * z[:-2] - share * z[2:]


def scatter(u: Floats, z: Floats) -> float:
    """Standard deviation of heights along a wire, estimated from neighbouring points."""
    if len(u) < 5:
        return 2 * SETTINGS.arcs.least_scatter
    order = np.argsort(u, kind="stable")
    usual = np.median(np.abs(astray(u[order], z[order])))
    return max(float(usual) / (0.6745 * math.sqrt(1.5)), SETTINGS.arcs.least_scatter)


def cuts_of(
    corridor: Corridor, alignment: Alignment, tracks: Sequence[Floats]
) -> tuple[Floats, Floats, Binned, float]:
    """Chainages of an alignment at which supports hold its wires, and their standard deviations.

    With them come coarse bins, and the curvature that the arcs have in common. How far the wires
    wander from their arcs is learned from these. The more they do, the more a cut must mend, so
    that there are fewer arcs, from which they may wander more.

    Parameters
    ----------
    tracks : by which its wires are cut; lanes may be one
    """
    chainages = chainages_of(alignment)
    wander = SETTINGS.arcs.least_wander
    seen = binned(corridor, alignment, alignment.tracks(corridor), 1, wander)
    arms, poles = hardware(corridor, alignment, seen.tracks(), chainages)
    own_arms = at_edges(arms)
    arms[at_known_supports(corridor, alignment, chainages)] = math.inf
    shown = arms + poles
    at_arms, at_poles = at_edges(arms), at_edges(poles)
    if corridor.tolerance <= SETTINGS.sparse.stack_tolerance:  # their tracks change over
        at_arms = np.where(at_poles >= SETTINGS.arcs.certain_arm, math.inf, at_arms)
    while True:
        coarse = binned(corridor, alignment, tracks, SETTINGS.arcs.coarse_bins, wander)
        bend = usual_bend(coarse)
        fine = binned(corridor, alignment, tracks, 1, wander)
        edges = edges_of(fine, bend, at_arms, at_poles, own_arms)
        learned = wander_of(fine, edges, bend)
        if learned <= SETTINGS.arcs.wander_margin * wander:
            break
        wander = learned
    return *all_settled(fine, edges, bend, chainages, shown), coarse, bend


def settled_at(
    corridor: Corridor, alignment: Alignment, cuts: Floats, bend: float
) -> tuple[Floats, Floats]:
    """Cuts of an alignment, moved to where arcs meet and supports show, and their deviations."""
    chainages = chainages_of(alignment)
    tracks = alignment.tracks(corridor)
    seen = binned(corridor, alignment, tracks, 1, SETTINGS.arcs.least_wander)
    arms, poles = hardware(corridor, alignment, seen.tracks(), chainages)
    inner = np.unique(np.round(cuts / alignment.step).astype(np.int64))
    inner = inner[(inner > 1) & (inner < alignment.steps - 1)]
    edges = np.array([0, *inner.tolist(), alignment.steps])
    edges = bending(seen, edges, bend, np.ones(len(seen.u) + 1, bool), at_edges(arms + poles))
    return all_settled(seen, edges, bend, chainages, arms + poles)


def chainages_of(alignment: Alignment) -> Floats:
    """Chainages of an alignment at which arms may be."""
    return (
        alignment.step
        / POSITIONS_PER_BIN
        * np.arange(POSITIONS_PER_BIN * alignment.steps + 1, dtype=np.float64)
    )


def at_edges(evidence: Floats) -> Floats:
    """The most evidence near each edge of the bins, of that at all chainages."""
    return np.asarray(maximum_filter1d(evidence, POSITIONS_PER_BIN + 1)[::POSITIONS_PER_BIN])


def at_known_supports(
    corridor: Corridor, alignment: Alignment, chainages: Floats
) -> NDArray[np.bool_]:
    """Which chainages of an alignment are those of supports that are known to hold its wires."""
    found = np.zeros(len(chainages), bool)
    offsets = [offset_of(corridor, alignment, piece) for piece in alignment.pieces]
    slack = SETTINGS.network.join_aside
    for ends in corridor.arms:
        u, v = alignment.along(ends)
        if max(v) > min(offsets) - slack and min(v) < max(offsets) + slack:
            found |= np.abs(chainages - u.mean()) <= SETTINGS.arcs.arm_half_width
    return found


def usual_bend(bins: Binned) -> float:
    """The curvature that the arcs of a line have in common, 1 / metre."""
    usual = usual_price(bins)
    return min(bends_tried(), key=lambda bend: solved(bins, bend, usual)[0])


def bends_tried() -> list[float]:
    """Curvatures that are tried, each farther from the last than spans differ, 1 / metre."""
    ratio = 1 + SETTINGS.arcs.curvature_spread
    most = math.log(SETTINGS.arcs.most_tried / SETTINGS.arcs.least_tried)
    steps = np.arange(most / math.log(ratio))
    return [float(bend) for bend in SETTINGS.arcs.least_tried * ratio**steps]


def edges_of(bins: Binned, bend: float, arms: Floats, poles: Floats, seen: Floats) -> Ints:
    """The edges of bins at which a line is cut into arcs of about one curvature, with both ends.

    An arm and a pole make a cut cheaper, a support that is known already free; but a tree may look
    like any of them, so wires that surely do not bend there are not cut.

    Parameters
    ----------
    arms, poles : evidence at each edge, squares of sigmas; infinite at supports that are known
    seen : of arms alone, without what is known
    """
    wires = maximum_filter1d(
        tracks_at(bins), 2 * round(SETTINGS.arcs.shortest_span / bins.step) + 1
    )
    usual = SETTINGS.arcs.cut_price + SETTINGS.arcs.cut_price_per_wire * wires
    price = np.maximum(usual - arms - poles, 0.0)
    edges = agreed(bins, solved(bins, bend, price)[1], bend, usual, price)
    bare = usual - arms > SETTINGS.arcs.least_arm_share * usual
    return bending(bins, edges, bend, bare, seen)


def wander_of(bins: Binned, edges: Ints, bend: float) -> float:
    """How far wires wander from their arcs: the scatter of means over `wander_length`, m."""
    together = max(1, round(SETTINGS.arcs.wander_length / bins.step))
    means = [np.zeros(1)]
    for low, high in itertools.pairwise(edges):
        for k in np.flatnonzero((bins.tall[low:high] > 0).any(axis=0)).tolist():
            rows = low + np.flatnonzero(bins.tall[low:high, k] > 0)
            x, z, weight = bins.u[rows, k] - bins.u[rows[0], k], bins.z[rows, k], bins.tall[rows, k]
            fitted = arc(x, z, weight, bend, SETTINGS.arcs.curvature_spread * bend)
            if fitted is not None:
                off = z - hanging(x, bend) @ fitted[0]
                block = (rows - low) // together
                full = np.bincount(block) > together // 2
                total, of = np.bincount(block, weight * off)[full], np.bincount(block, weight)[full]
                means.append(total / of)
    return float(np.median(np.abs(np.concatenate(means)))) / 0.6745


def misfits(bins: Binned, low: Ints, high: Ints, bend: float) -> Floats:
    """Misfit of each track to each arc, in squares of sigmas, array of shape (arcs, tracks)."""
    found = np.empty((len(low), bins.u.shape[1]))
    kernels.misfits(
        bins.tall,
        bins.flat,
        bins.u / bins.step,
        bins.z,
        bins.v,
        low,
        high,
        bend * bins.step**2,
        SETTINGS.arcs.curvature_spread * bend * bins.step**2,
        1 / (bend * bins.step),
        found,
    )
    return found


def agreed(bins: Binned, edges: Ints, bend: float, usual: Floats, price: Floats) -> Ints:
    """The edges of bins at which a cut improves the fit of enough tracks: about three of four.

    A single track may follow another wire, or be displaced by a crane, and its gain would outweigh
    all others. So the gain counted for each track is limited, in proportion to the price of a cut
    where there is no arm.
    """
    tracks = np.maximum(tracks_at(bins), 1)
    most = SETTINGS.arcs.most_paid * usual / tracks * (tracks + 1) / tracks
    while len(edges) > 2:
        arcs = misfits(bins, edges[:-1], edges[1:], bend)
        gain = misfits(bins, edges[:-2], edges[2:], bend) - arcs[:-1] - arcs[1:]
        paid = np.minimum(gain, most[edges[1:-1], None]).sum(axis=1)
        spare = paid - price[edges[1:-1]]
        worst = int(np.argmin(spare))
        if spare[worst] >= 0:
            break
        edges = np.delete(edges, worst + 1)
    return edges


def bending(bins: Binned, edges: Ints, bend: float, bare: NDArray[np.bool_], seen: Floats) -> Ints:
    """The edges of bins at which the wires bend as they do at supports, up or down.

    In a long span with many points it is significant how wires wander, and a cut would mend it; and
    the top of a tree among wires looks like an arm, its trunk like a pole. But there they do not
    bend: no bend at all is a hundred times as likely as one between two spans, and more than `seen`
    tells of an arm there, or, where it is `bare` of what looks like a support, they hardly do. Such
    a cut, if no arm is certain there, must also be likelier than none where both spans together
    are no longer than another one of the line; a bend that cannot be known is not.
    """
    least, enough = SETTINGS.arcs.least_kink, seen / 2 - math.log(SETTINGS.sparse.false_alarms)
    while len(edges) > 2:
        kinks, sigmas = np.array([kink(bins, *three, bend) for three in threes(edges)]).T
        straight = straightness(kinks, sigmas)
        bends = enough[edges[1:-1]] / np.maximum(straight, 1e-9)
        bends = np.where(bare[edges[1:-1]], np.minimum(bends, np.abs(kinks) / least), bends)
        spare = bare[edges[1:-1]] & (seen[edges[1:-1]] < SETTINGS.arcs.certain_arm)
        spare &= is_known_length(edges) & (straight >= 0)
        bends = np.where(spare, np.minimum(bends, np.exp(-np.abs(straight))), bends)
        worst = int(np.argmin(bends))
        if bends[worst] > 1:
            break
        edges = np.delete(edges, worst + 1)
    return edges


def is_known_length(edges: Ints) -> NDArray[np.bool_]:
    """At which inner edges both spans together are no longer than another one of the line."""
    spans = np.diff(edges)
    numbers = np.arange(len(spans))
    others = (numbers < numbers[:-1, None]) | (numbers > numbers[:-1, None] + 1)
    longest = np.where(others, spans, 0).max(axis=1, initial=0)
    return np.asarray(spans[:-1] + spans[1:] <= longest)


def straightness(kinks: Floats, sigmas: Floats) -> Floats:
    """Logarithm of how much likelier kinks are where there is no support than where one is.

    By normal laws: around none, and around that between two level spans.

    Parameters
    ----------
    kinks, sigmas : as shares of that between two level spans, and their standard deviations
    """
    wide = np.hypot(sigmas, SETTINGS.arcs.kink_spread)
    with np.errstate(invalid="ignore"):  # of kinks that are not known
        found = np.log(wide / sigmas) + (((kinks - 1) / wide) ** 2 - (kinks / sigmas) ** 2) / 2
    return np.asarray(np.nan_to_num(found, nan=0.0))


def kink(bins: Binned, low: int, at: int, high: int, bend: float) -> tuple[float, float]:
    """By how much wires bend down at a cut, as a share of what level spans would, and its sigma.

    Both are infinite if it is not known.

    Between level supports a wire of curvature k leaves a span of length L with a slope of k L / 2.
    """
    total, weights = 0.0, 0.0
    for k in np.flatnonzero((bins.tall[low:high] > 0).any(axis=0)).tolist():
        before, after = (
            arc(
                bins.u[s, k] - at * bins.step,
                bins.z[s, k],
                bins.tall[s, k],
                bend,
                SETTINGS.arcs.curvature_spread * bend,
            )
            for s in (slice(low, at), slice(at, high))
        )
        if before is not None and after is not None:
            weight = 1 / (before[1][1, 1] + after[1][1, 1])
            total += weight * (before[0][1] - after[0][1])
            weights += weight
    level = 0.5 * bend * (high - low) * bins.step
    if not weights:
        return math.inf, math.inf
    return total / weights / level, 1 / math.sqrt(weights) / level


def tracks_at(bins: Binned) -> Floats:
    """Number of tracks that are seen not far before and behind each edge between two bins.

    A wire that is seen far off alone can tell nothing of a support there.
    """
    reach = round(SETTINGS.network.longest_missing / bins.step)
    seen = np.cumsum(np.pad(bins.tall > 0, ((1, 0), (0, 0))), axis=0)
    edge = np.arange(len(seen))
    behind = seen > seen[np.maximum(edge - reach, 0)]
    ahead = seen[np.minimum(edge + reach, edge[-1])] > seen
    return np.asarray((behind & ahead).sum(axis=1), float)


def solved(bins: Binned, bend: float, price: Floats) -> tuple[float, Ints]:
    """Least total cost, and the edges of bins at which to cut the tracks, with both ends."""
    steps = len(bins.u)
    total, before = np.empty(steps + 1), np.zeros(steps + 1, np.int64)
    kernels.cuts(
        bins.tall,
        bins.flat,
        bins.u / bins.step,
        bins.z,
        bins.v,
        price,
        bend * bins.step**2,
        SETTINGS.arcs.curvature_spread * bend * bins.step**2,
        1 / (bend * bins.step),
        max(2, round(SETTINGS.arcs.shortest_span / bins.step)),
        total,
        before,
    )
    edges = [steps]
    while edges[-1] > 0:
        edges.append(int(before[edges[-1]]))
    return float(total[-1]), np.array(edges[::-1])


def all_settled(
    bins: Binned, edges: Ints, bend: float, chainages: Floats, shown: Floats
) -> tuple[Floats, Floats]:
    """Chainages of all cuts, moved to where arcs meet and arms are seen, and their deviations.

    Two that come nearer to each other than supports can be are one, such as those at both ends of
    the strings of a bundle. That stays with which arcs meet better and arms are clearer. The
    nearest two are looked at first.
    """

    @functools.cache
    def moved(low: int, at: int, high: int) -> tuple[float, float, float]:
        return settled(bins, low, at, high, bend, chainages, shown)

    def cost(edges: Ints) -> float:
        return sum(moved(*three)[1] for three in threes(edges))

    while True:
        found = np.array([moved(*three) for three in threes(edges)]).reshape(-1, 3)
        places = found[:, 0]
        between = np.diff(places)
        if not (between < SETTINGS.arcs.shortest_span).any():
            return places, found[:, 2]
        first = int(np.argmin(between)) + 1
        edges = min((np.delete(edges, spare) for spare in (first, first + 1)), key=cost)


def threes(edges: Ints) -> Iterator[tuple[int, int, int]]:
    """Each inner edge between the one before and the one behind."""
    every = edges.tolist()
    return zip(every, every[1:], every[2:], strict=False)


def settled(
    bins: Binned, low: int, at: int, high: int, bend: float, chainages: Floats, shown: Floats
) -> tuple[float, float, float]:
    """Chainage of a cut, moved to where the arcs on both sides meet and an arm is seen.

    It may be anywhere between the last that is seen before it and the first that is seen behind.
    With it come by how much they do not, less the arm, in squares of sigmas, and the standard
    deviation of the chainage: infinite if no chainage can be tried. How likely each chainage is
    follows from that cost, as errors are normal.
    """
    middle = at * bins.step
    seen = low + np.flatnonzero((bins.tall[low:high] > 0).any(axis=1))
    last, first = seen.max(initial=low, where=seen < at), seen.min(initial=high, where=seen >= at)
    near = chainages > min(middle - SETTINGS.arcs.most_shift, bins.step * last)
    near &= chainages < max(middle + SETTINGS.arcs.most_shift, bins.step * first)
    near &= (chainages > low * bins.step + 1.0) & (chainages < high * bins.step - 1.0)
    if not near.any():
        return middle, 0.0, math.inf
    chainages, cost = chainages[near], -np.minimum(shown[near], SETTINGS.arcs.certain_arm)
    x = chainages - middle
    base = hanging(x, bend)
    before, after = slice(low, at), slice(at, high)
    for weight, values, usual in ((bins.tall, bins.z, bend), (bins.flat, bins.v, 0.0)):
        for k in np.flatnonzero((bins.tall[low:high] > 0).any(axis=0)).tolist():
            one, two = (
                arc(
                    bins.u[s, k] - middle,
                    values[s, k],
                    weight[s, k],
                    usual,
                    SETTINGS.arcs.curvature_spread * bend,
                )
                for s in (before, after)
            )
            if one is not None and two is not None:
                gap = base @ (two[0] - one[0])
                variance = (
                    np.einsum("ij,jk,ik->i", base, one[1] + two[1], base)
                    + SETTINGS.arcs.meeting_sd**2
                )
                cost += gap**2 / variance
    best = int(np.argmin(cost))
    likely = np.exp(-0.5 * (cost - cost[best]))
    variance = float(likely @ (chainages - chainages[best]) ** 2 / likely.sum())
    step = bins.step / POSITIONS_PER_BIN
    return float(chainages[best]), float(cost[best]), math.sqrt(variance + step**2 / 12)


def hanging(x: Floats, bend: float) -> Floats:
    """Functions of which every catenary of a curvature is a sum, array of shape (n, 3)."""
    if not bend:
        return np.column_stack([np.ones(len(x)), x, 0.5 * x * x])
    half = 0.5 * bend * x
    return np.column_stack(
        [np.ones(len(x)), np.sinh(bend * x) / bend, 2 * (np.sinh(half) / bend) ** 2]
    )


def arc(
    x: Floats, values: Floats, weight: Floats, usual: float, spread: float
) -> tuple[Floats, Floats] | None:
    """Value, slope and curvature at x = 0 of the arc fitted to values, and their covariance."""
    used = weight > 0
    if np.count_nonzero(used) < 3:
        return None
    x, values, weight = x[used], values[used], weight[used]
    base = hanging(x, usual)
    normal = (base * weight[:, None]).T @ base
    normal[2, 2] += 1 / spread**2
    right = base.T @ (weight * values)
    right[2] += usual / spread**2
    inverse = np.asarray(np.linalg.inv(normal))
    return np.asarray(inverse @ right), inverse
