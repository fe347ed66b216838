"""How likely points lie along a curve by chance, by how many are around it.

References
----------
Chernoff, H. (1952). A measure of asymptotic efficiency for tests of a hypothesis based on the sum
of observations. Annals of Mathematical Statistics 23(4), 493-507: the bound.
Desolneux, A., Moisan, L. and Morel, J.-M. (2000). Meaningful alignments. International Journal of
Computer Vision 40(1), 7-23: the number of false alarms.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._settings import SETTINGS

if TYPE_CHECKING:
    from algorithms.corridor._curves.network import Corridor

Ints = NDArray[np.int64]

EXPONENTS = np.linspace(0.05, 0.95, 19)  # of Chernoff's bound, of which the best is taken


def chance(
    corridor: Corridor,
    curve: Catenary,
    tolerance: float,
    taken: NDArray[np.bool_],
    step: float | None = None,
) -> float:
    """Logarithm of the probability, at most, that chance fills a curve with points as it is filled.

    The curve is parted into steps. By chance points are as dense on it as they are around it; so
    the probability that a step holds any is known, and each that does is the more surprising, the
    emptier the air around. What all steps surprise by is bounded after Chernoff.

    Parameters
    ----------
    tolerance : from the curve within which points are on it, metres
    taken : which points above the ground are on wires, and so are not around others
    step : length of the steps, metres; two by default
    """
    on_it, beside = by_step(corridor, curve, taken, step or SETTINGS.points.company_side, tolerance)
    own, around = tolerance**2, SETTINGS.curves.clutter_radius**2
    near = np.convolve(beside, np.ones(3), "full")[1:-1] / 3
    usual = np.maximum(near, SETTINGS.arcs.least_usual) * own / (around - own)
    by_chance = -np.expm1(-usual)
    surprise = -float(np.log(by_chance[on_it > 0]).sum())
    tilted = np.log1p(by_chance[:, None] ** (1 - EXPONENTS) - by_chance[:, None]).sum(axis=0)
    return float(min(0.0, (tilted - EXPONENTS * surprise).min()))


def is_no_accident(corridor: Corridor, chances: Iterable[float]) -> bool:
    """Whether of curves as unlikely as some together a hundredth of one is expected at most.

    Of each of them one is tried from each point.

    Parameters
    ----------
    chances : of each curve, as :func:`chance` gives it
    """
    tried = math.log(max(1, len(corridor.wires.xyz)))
    together = sum(min(0.0, one + tried) for one in chances)
    return together < math.log(SETTINGS.sparse.false_alarms)


def by_step(
    corridor: Corridor, curve: Catenary, taken: NDArray[np.bool_], step: float, tolerance: float
) -> tuple[Ints, Ints]:
    """Number of points on a curve per step along it, and of others around it that are not taken."""
    own, around = (
        corridor.air.around(curve, r)[0] for r in (tolerance, SETTINGS.curves.clutter_radius)
    )
    own = own[corridor.may[own]]
    beside = np.setdiff1d(around[~taken[around]], own, assume_unique=True)
    bins = max(1, round(curve.length / step))
    on_it, beside = (
        np.histogram(curve.along(corridor.air.xyz[points])[0], bins, (0.0, curve.length))[0]
        for points in (own, beside)
    )
    return on_it, beside
