"""Standard deviations of wires, with the errors that points near each other have in common.

The points of a wire do not err each for itself. The position of the aircraft is off by centimetres
that change over tens of metres, a strip lies higher than the next, and wind lifts the wire between
two flights. The covariance of a fit knows nothing of that. Where strips overlap, they disagree by
as much; along a strip, the means of many points stray from the wire.

How much few points scatter is not well known. All of a survey scatter alike, so a wire is no surer
than its points are by the scatter of all.

What all strips have in common, such as an error of the geoid, no point cloud can tell.

References
----------
Liang, K.-Y. and Zeger, S. L. (1986). Longitudinal data analysis using generalized linear models.
Biometrika 73(1), 13-22: the covariance of a fit to observations that err in groups.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit  # scipy.stats would take half a second to import

from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._extraction.spans import Wire, on_wire
from algorithms.corridor._settings import SETTINGS

NORMAL_LEVEL = 0.975  # of both sides: two standard deviations

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Residuals:
    """Points on a wire: distances along it, heights above it, and strips."""

    u: Floats
    z: Floats
    strip: Ints

    def means(self, by_strip: bool) -> tuple[Ints, Floats, Floats]:
        """Stretches on which points err alike, means of heights in each, and variances by chance.

        Parameters
        ----------
        by_strip : a mean for each strip, not of all
        """
        keys = np.column_stack(
            [self.u // SETTINGS.arcs.wander_length, self.strip if by_strip else 0 * self.strip]
        )
        place, piece, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        piece = piece.ravel()
        mean = np.bincount(piece, self.z) / count
        square = ((self.z - mean[piece]) ** 2).sum() / max(len(self.z) - len(count), 1)
        full = count >= SETTINGS.errors.fewest_points
        return place[full, 0].astype(np.int64), mean[full], square / count[full]


def with_common_errors(corridor: Corridor, wires: Sequence[Wire]) -> list[Wire]:
    """The wires, whose covariances hold the errors that points near each other have in common.

    Parameters
    ----------
    corridor : in whose air the points on wires are taken
    """
    residuals = [residuals_of(corridor, wire) for wire in wires]
    common = between_strips(residuals) + along_strips(residuals)
    # From a few independent pieces a variance is not well known: as wide as Student's law.
    student = float(stdtrit(pieces_of(wires), NORMAL_LEVEL) / ndtri(NORMAL_LEVEL))
    common *= student**2
    scatter = scatters_of(wires, residuals)
    return [
        widened(wire, own, scatter[wire.tolerance], common)
        for wire, own in zip(wires, residuals, strict=True)
    ]


def scatters_of(wires: Sequence[Wire], residuals: Sequence[Residuals]) -> dict[float, float]:
    """Variance of the heights of points, of all wires that were followed at each tolerance.

    Each wire takes three parameters from its points.
    """
    found = {}
    for tolerance in {wire.tolerance for wire in wires}:
        pairs = zip(wires, residuals, strict=True)
        heights = [own.z for wire, own in pairs if wire.tolerance == tolerance and len(own.z)]
        spare = sum(max(len(z) - 3, 1) for z in heights)
        found[tolerance] = float(sum((z**2).sum() for z in heights)) / max(spare, 1)
    return found


def pieces_of(wires: Sequence[Wire]) -> float:
    """Number of pieces of the lines that err each for themselves, not below the fewest."""
    length: dict[int, float] = {}
    for wire in wires:
        length[wire.span] = max(length.get(wire.span, 0.0), wire.seen_length)
    return max(sum(length.values()) / SETTINGS.errors.common_length, SETTINGS.errors.fewest_pieces)


def residuals_of(corridor: Corridor, wire: Wire) -> Residuals:
    """The points on a wire."""
    near, _, _ = on_wire(corridor, wire)
    u, _, z = wire.curve.residuals(corridor.air.xyz[near])
    return Residuals(u, z, corridor.strip[near].astype(np.int64))


def between_strips(residuals: Sequence[Residuals]) -> float:
    """Variance of the height of a strip, by how strips disagree on the same stretch of a wire."""
    found = []
    for own in residuals:
        stretch, mean, by_chance = own.means(by_strip=True)
        for one in np.unique(stretch):
            here = stretch == one
            if np.count_nonzero(here) > 1:
                found.append(float(mean[here].var(ddof=1) - by_chance[here].mean()))
    return max(float(np.mean(found)), 0.0) if found else 0.0


def along_strips(residuals: Sequence[Residuals]) -> float:
    """Variance of the means of stretches about the wire that was fitted to them."""
    found = []
    for own in residuals:
        _, mean, by_chance = own.means(by_strip=False)
        found += (mean**2 - by_chance).tolist()
    return max(float(np.mean(found)), 0.0) if found else 0.0


def widened(wire: Wire, own: Residuals, scatter: float, common: float) -> Wire:
    """A wire whose covariance holds a common error of a given variance of each strip.

    It is the same along the length that errors have in common, and another one beyond: the points
    of such a piece add to the fit as a group.

    Parameters
    ----------
    scatter : variance of the heights of points by themselves, at least
    common : variance of what they have in common
    """
    covariance = wire.curve.covariance
    if covariance is None or len(own.u) < 2:
        return wire
    slopes = wire.curve.slopes(own.u)
    # That of a point in the covariance; less where the curvature is known of other wires as well.
    square = float(np.linalg.eigvals(covariance @ slopes.T @ slopes).real.max())
    inverse = covariance / square
    group = (own.u / SETTINGS.errors.common_length).astype(np.int64)
    total = np.zeros((3, 3))
    for one in np.unique(group):
        of_strip = np.bincount(np.unique(own.strip[group == one], return_inverse=True)[1])
        strips = of_strip.sum() ** 2 / (of_strip**2).sum()
        add = slopes[group == one].sum(axis=0)
        total += np.outer(add, add) * common / strips
    covariance = inverse * max(square, scatter) + inverse @ total @ inverse
    return replace(wire, curve=replace(wire.curve, covariance=covariance))
