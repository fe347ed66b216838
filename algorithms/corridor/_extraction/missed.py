"""What may be missing of a line: conductors that neighbouring spans have, and parts without points.

A conductor that was not found cannot be measured from, so clearances come out too large. Whether
one is missing shows in the spans before and behind; whether one was seen all along shows in the
gaps between its points.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import gammaincinv

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._extraction.points import CorridorPoints
from algorithms.corridor._extraction.spans import Wire, on_wire
from algorithms.corridor._settings import SETTINGS
from toolbox.context import log, setting_name
from toolbox.data import Vector

Floats = NDArray[np.float64]


def with_gaps(corridor: Corridor, wires: Sequence[Wire]) -> list[Wire]:
    """The wires with what was seen of them: share of the length, and longest gap."""
    found = []
    for wire in wires:
        near, _, _ = on_wire(corridor, wire)
        u = np.sort(wire.curve.along(corridor.air.xyz[near])[0])
        held = (wire.supports[0] >= 0, wire.supports[1] >= 0)
        share, gap = seen_share(u, wire.curve.length, held)
        found.append(replace(wire, seen_share=share, longest_gap=gap))
    return found


def seen_share(u: Floats, length: float, held: tuple[bool, bool]) -> tuple[float, float]:
    """Share of a wire along which there are points, and the longest gap between them.

    Not seen is what lies in gaps longer than the spacing of the points explains. The spacing is
    that of the quarter of the wire on which they are closest.

    Parameters
    ----------
    u : distances of the points along the wire, sorted, metres
    length : of the wire, metres
    held : whether it ends at a support, at its beginning and end; where it ends with the data, it
        is not known how far it should be seen

    Returns
    -------
    share, and metres

    Examples
    --------
    >>> share, gap = seen_share(np.append(np.arange(50.0), 100.0), 100.0, (True, True))
    >>> round(share, 2), gap
    (0.49, 51.0)
    """
    if len(u) < 2 or u[0] == u[-1]:
        return 0.0, length
    low, high = (0.0 if held[0] else float(u[0])), (length if held[1] else float(u[-1]))
    gaps = np.diff(np.concatenate([[low], np.clip(u, low, high), [high]]))
    unseen = gaps[gaps > longest_by_chance(gaps)].sum()
    return 1 - float(unseen) / (high - low), float(gaps.max())


def longest_by_chance(gaps: Floats) -> float:
    """Length in metres of gaps of which `false_alarms` are expected by chance along a wire.

    Points at random are a Poisson process. Of n of them on a wire, n exp(-x) are followed by a gap
    of more than x mean spacings. A place on the wire lies in a gap
    whose length has the density x exp(-x): the Gamma distribution of shape 2 tells up to which
    gap the share `typical` of the wire is. Points in a row, as of scan lines, are told to be
    farther apart than they are.

    Parameters
    ----------
    gaps : array of shape (n,), between neighbouring points, metres
    """
    order = np.sort(gaps)
    share = np.cumsum(order) / order.sum()
    spacing = order[np.searchsorted(share, SETTINGS.errors.typical)]
    spacing /= gammaincinv(2, SETTINGS.errors.typical)
    return float(spacing * math.log(max(order.sum() / spacing, 1.0) / SETTINGS.sparse.false_alarms))


# --- conductors of the neighbouring spans --------------------------------------------------


def conductor_counts(wires: Sequence[Wire]) -> dict[int, tuple[int, int | None]]:
    """Number of conductors of each span, and how many its neighbours lead one to expect.

    A bundle counts as one. Expected is what most of up to `neighbours` spans of the same line to
    each side have; its own number, if as many have that; None for a span that is alone.
    """
    bundles: dict[int, set[int]] = {}
    ends: dict[int, set[tuple[int, int]]] = {}
    for wire in wires:
        bundles.setdefault(wire.span, set()).add(wire.bundle)
        held = {(number, wire.bundle) for number in wire.supports if number >= 0}
        ends.setdefault(wire.span, set()).update(held)
    beside = {
        one: {other for other in ends if other != one and ends[one] & ends[other]} for one in ends
    }
    found = {span: len(own) for span, own in bundles.items()}
    return {span: (count, _expected(span, found, beside)) for span, count in found.items()}


def _expected(span: int, found: dict[int, int], beside: dict[int, set[int]]) -> int | None:
    near, edge = {span}, {span}
    for _ in range(SETTINGS.errors.neighbours):
        edge = {other for one in edge for other in beside[one]} - near
        near |= edge
    counts = Counter(found[one] for one in near - {span})
    if not counts:
        return None
    most = max(counts.values())
    usual = [count for count, times in counts.items() if times == most]
    return found[span] if found[span] in usual else max(usual)


# --- what is told --------------------------------------------------------------------------


def warn_of_missed(wires: Vector) -> None:
    """Log which spans lack conductors, what was seen in part, and if points are too few."""
    _warn_of_drops(wires)
    setting = setting_name("wire_tolerance")
    how = f", or try another value of {setting}" if setting else ""
    for text in missed(wires):
        log.warning("%s; look at it, try denser data%s", text, how)
    frame = wires.frame[wires.frame["drop"] == 0]
    if not len(frame):
        return
    per_100_m = float((100 * frame["points"] / frame["length"]).median())
    if per_100_m < SETTINGS.errors.least_dense:
        log.warning(
            "the points are too few to see all wires: those found have %.0f per 100 m, and below "
            "%.0f there may be others that were not found; clearances to these are not measured",
            per_100_m,
            SETTINGS.errors.least_dense,
        )


def _warn_of_drops(wires: Vector) -> None:
    """Log which spans are service drops, and that others may not have been seen."""
    spans = wires.frame.loc[wires.frame["drop"] == 1, "span_id"].astype(str)
    if len(spans):
        log.warning(
            "service drops: span %s leads from a pole to a house; of others too few points may be "
            "seen: at least %d are needed, and points in as many metres of it",
            ", ".join(spans),
            SETTINGS.towers.known_by_points,
        )


def warn_of_unseen_supports(towers: Vector) -> None:
    """Log which supports are known by their wires alone, since hardly a point is of their body."""
    frame = towers.frame
    unseen = frame.loc[frame["points"] < SETTINGS.towers.known_by_points, "tower_id"].astype(str)
    if len(unseen):
        log.warning(
            "%d of %d towers show fewer than %d points of their own (tower_id %s): only their "
            "wires tell of them; they may stand metres off along the line, or be none",
            len(unseen),
            len(frame),
            SETTINGS.towers.known_by_points,
            ", ".join(unseen),
        )


def warn_of_open_ends(
    wires: Sequence[Wire], seen: Callable[[float, float], bool], origin: Floats, metre: float
) -> None:
    """Log where spans end without a support that was seen, though the data go on behind.

    Parameters
    ----------
    wires : in metres from the origin
    seen : whether there are points around a position in plan, metres
    origin : array of shape (3,), in the unit of the data
    metre : length of one metre in that unit
    """
    found: dict[int, Floats] = {}
    for wire in (wire for wire in wires if not wire.drop):
        for place, number, way in zip(wire.curve.ends, wire.supports, (-1, 1), strict=True):
            step = way * SETTINGS.supports.along
            behind = place[:2] + step * np.array([wire.curve.ex, wire.curve.ey])
            if number < 0 and seen(*behind):
                found.setdefault(wire.span, place[:2] * metre + origin[:2])
    if found:
        log.warning(
            "support not seen: span %s has an end without one, where the data go on (%s): a "
            "support may stand there or farther on, and wires behind it may be missing",
            ", ".join(map(str, found)),
            "; ".join(f"{x:.0f}, {y:.0f}" for x, y in found.values()),
        )


def warn_of_unsure_places(towers: Vector) -> None:
    """Log which supports may stand elsewhere along the line, so that spans may be longer."""
    frame, most = towers.frame, SETTINGS.supports.settled_slack
    unsure = frame.loc[~(frame["sd_along"] <= most), "tower_id"].astype(str)
    if len(unsure):
        log.warning(
            "tower_id %s: the place along the line has a standard deviation (sd_along) of more "
            "than %g m, or none that is known: few points show the tower or how its wires bend; "
            "spans end there at about this place",
            ", ".join(unsure),
            most,
        )


def warn_of_scatter(wires: Vector) -> None:
    """Warn of wires about which points lie so far apart that they may be bundles.

    Two conductors of one that are half of its width apart scatter by a quarter of it.
    """
    frame, most = wires.frame, SETTINGS.network.bundle_width / 4
    wide = frame[frame["rms"] > most]
    if len(wide):
        log.warning(
            "the points of %d of %d wires lie %.2f m and more from them (rms, up to %.2f m; spans "
            "%s): noise, or conductors of a bundle that the points do not tell apart, of which the "
            "lowest hangs as much lower",
            len(wide),
            len(frame),
            most,
            wide["rms"].max(),
            ", ".join(map(str, sorted(set(wide["span_id"])))),
        )


def warn_of_bodiless_supports(towers: Vector) -> None:
    """Log which supports show points level with their wires, but no body that stands alone."""
    frame, seen = towers.frame, SETTINGS.towers.known_by_points
    sure = (frame["points"] >= seen) & (frame["sd_along"] <= SETTINGS.supports.settled_slack)
    bare = frame.loc[sure & (frame["certain"] == 0), "tower_id"].astype(str)
    if len(bare):
        log.warning(
            "tower_id %s: there are points level with the wires, but none of a body below them, or "
            "as many around it; this may be a tree or the edge of a roof, and no support",
            ", ".join(bare),
        )


def warn_of_edges(points: CorridorPoints, labels: Mapping[str, NDArray[np.uint32]]) -> None:
    """Log which spans run beside other things nearly all along, as edges of buildings do.

    Parameters
    ----------
    labels : span_id and tower_id of the points, 0 for none
    """
    xyz = points.air.xyz
    span, tower = labels["span_id"][points.own], labels["tower_id"][points.own]
    others, told = xyz[(span == 0) & (tower == 0)], []
    reach = SETTINGS.curves.clutter_radius
    for number in np.unique(span[span > 0]).tolist():
        own = xyz[span == number]
        near = (others > own.min(axis=0) - reach) & (others < own.max(axis=0) + reach)
        beside = others[near.all(axis=1)]
        if len(beside):
            away, _ = cKDTree(beside).query(own, distance_upper_bound=reach)
            told += [str(number)] * bool(np.isfinite(away).mean() > SETTINGS.structures.filled)
    if told:
        log.warning(
            "span %s: nearly all along, other points lie within %g m of the wires; edges of roofs, "
            "balconies and rails look like wires: look whether this is a line",
            ", ".join(told),
            reach,
        )


def warn_of_left_out(curves: Sequence[Catenary], origin: Floats, metre: float) -> None:
    """Log how much hangs in arcs as wires do, and is left out since something is tied to it.

    Parameters
    ----------
    curves : in metres from the origin
    origin : array of shape (3,), in the unit of the data
    metre : length of one metre in that unit
    """
    lines = [shapely.LineString(curve.ends[:, :2]) for curve in curves]
    half = SETTINGS.network.bundle_width
    around = shapely.union_all([line.buffer(half, cap_style="flat") for line in lines])
    length = around.area / (2 * half)
    if length < SETTINGS.curves.sure_length:
        return
    west, south, east, north = np.array(around.bounds) * metre + np.tile(origin[:2], 2)
    log.warning(
        "about %.0f m of wires between %.0f, %.0f and %.0f, %.0f were left out: something hangs "
        "from them or is tied to them, as to those of a railway, ropeway, bridge or trellis; "
        "look whether these are power lines",
        length,
        *(west, south, east, north),
    )


def missed(wires: Vector) -> Iterator[str]:
    """What may be missing of the line, span by span, from the layer of wires, without drops."""
    frame = wires.frame
    frame = frame[frame["drop"] == 0]
    for span, own in frame.groupby("span_id"):
        found, usual = own["conductors"].max(), own["expected"].max()
        if found < usual:
            text = f"span {span}: {found:.0f} conductors, where its neighbours have {usual:.0f}"
            if (own[["from_tower", "to_tower"]] == 0).any(axis=None):
                text += " (it ends where the data end: not known whether there are more)"
            yield text
    for one in frame[frame["seen_share"] < SETTINGS.errors.least_seen].itertuples():
        yield (
            f"span {one.span_id}: conductor {one.wire_id} was seen along "
            f"{100 * one.seen_share:.0f} % only, with a gap of {one.longest_gap:.0f} m"
        )
