"""First and last returns of the same pulse."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.shared.returns import SAME_PLACE, ReturnNumbers, warn_of_impossible
from toolbox.context import log
from toolbox.data import PointCloud
from toolbox.errors import DataError

How = Literal["gps_time", "order"]
KEYS = ("gps_time", "point_source_id", "scanner_channel", "number_of_returns")
MANY = 0.5  # share of points in pulses with several first or last returns that is too many
HARDLY = 0.1  # share of returns in whole pulses below which points are not in the order of the scan
FEW = 0.5  # the same, below which it is said that much is missing
STEEPEST = 0.6  # plan distance over height between two returns: scanners look 30 degrees aside
ASIDE = 0.5  # metres in plan between returns of one height: the footprint of a laser
ALL = 0.99  # share of pairs that must be possible pulses for all of them to be pulses

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Pulses(NamedTuple):
    """Pulses with several returns whose first and last one are present.

    Attributes
    ----------
    members : array of shape (m,), indices of their returns
    first, last : arrays of shape (m,), index of the first and last return of the pulse of each
    """

    members: Ints
    first: Ints
    last: Ints


def pulses(cloud: PointCloud, how: How) -> Pulses:
    """Pulses with several returns whose first and last one are present.

    Parameters
    ----------
    cloud : n points
    how : by time, flight line and channel; or by the order of the points, in which the returns of
        a pulse follow each other from the first to the last, or all first returns come before all
        last ones. If the order tells nothing, by their places, see :func:`of_lists`.

    Raises
    ------
    DataError
        The times do not distinguish pulses, or the order does not and there are times.
    """
    returns = ReturnNumbers.of(cloud)
    warn_of_impossible(returns, "they belong to no pulse")
    some = np.flatnonzero(returns.known & (returns.count >= 2))
    number, count = (kind[some].astype(np.int64) for kind in (returns.number, returns.count))
    pulse = _by_time(cloud, some) if how == "gps_time" else _by_order(number, count)
    found = _whole(some, number, count, pulse)
    if how == "order" and len(some):
        xyz = cloud.xyz / cloud.metre
        few = len(found.members) < HARDLY * len(some)
        if few or not _are_pulses(xyz[found.first], xyz[found.last], ASIDE):
            if "gps_time" in cloud and np.ptp(cloud["gps_time"][some]) > 0:
                raise DataError(
                    "points: their order does not tell which returns are of one pulse; use pairs "
                    "gps_time"
                )
            found = of_lists(xyz, some[number == 1], some[number == count])
    if len(found.members) < FEW * len(some):
        log.warning(
            "only %d of %d returns of several are of pulses whose first and last return are there; "
            "nothing is known of the others: are the points thinned, or pairs not %s?",
            len(found.members),
            len(some),
            how,
        )
    return found


def of_lists(xyz: Floats, firsts: Ints, lasts: Ints) -> Pulses:
    """Pulses of a list of first and a list of last returns, such as those of old surveys.

    If both lists have one length, and the k-th of one and the k-th of the other can be of one
    pulse, they are. Else they are paired by place, see :func:`near_each_other`. A pulse that hit
    one surface has one place twice.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    firsts, lasts : indices of the first and of the last returns, in the order of the points
    """
    one, other = xyz[firsts], xyz[lasts]
    if len(firsts) == len(lasts) > 0 and _are_pulses(one, other, _step(one)):
        log.info("pulses: the lists of %d first and last returns are in the same order", len(one))
    else:
        k, m = near_each_other(one, other)
        log.warning(
            "the order of the points does not tell pulses: of %d first and %d last returns %d are "
            "paired by their places, where slanted pulses may be mixed up with those beside them",
            len(firsts),
            len(lasts),
            len(k),
        )
        firsts, lasts, one, other = firsts[k], lasts[m], one[k], other[m]
    same = np.linalg.norm(one - other, axis=1) <= SAME_PLACE
    log.info("pulses: %d of %d have one place twice, and are single", np.sum(same), len(same))
    return Pulses(np.concatenate([firsts, lasts]), np.tile(firsts, 2), np.tile(lasts, 2))


def near_each_other(one: Floats, other: Floats) -> tuple[Ints, Ints]:
    """Pairs of first and last returns by their places, each in one pair at most.

    Those at one place come first. Of the rest each is paired with the nearest in plan if it is the
    nearest of that one, too, again and again, as long as the scanner could look so far aside.
    Needs some 200 bytes per return.

    Parameters
    ----------
    one, other : arrays of shape (n, 3) and (m, 3), metres

    Returns
    -------
    arrays of shape (k,), indices of both
    """
    k, m = _mutual(one, other, SAME_PLACE)
    found, left, left_other = [(k, m)], _without(len(one), k), _without(len(other), m)
    while len(k) and len(left) and len(left_other):
        k, m = _mutual(one[left, :2], other[left_other, :2])
        possible = _possible(one[left[k]], other[left_other[m]], ASIDE)
        k, m = k[possible], m[possible]
        found.append((left[k], left_other[m]))
        left, left_other = np.delete(left, k), np.delete(left_other, m)
    pairs = (np.concatenate(side) for side in zip(*found, strict=True))
    return next(pairs), next(pairs)


def _are_pulses(one: Floats, other: Floats, aside: float) -> bool:
    """Whether all pairs of returns but a few, such as those of gross errors, may be pulses."""
    return bool(_possible(one, other, aside).mean() >= ALL)


def _possible(one: Floats, other: Floats, aside: float) -> NDArray[np.bool_]:
    """True for pairs of returns that may be of one pulse, by how slanted it would be."""
    away = np.hypot(*(one - other)[:, :2].T)
    return np.asarray(away <= aside + STEEPEST * abs(one[:, 2] - other[:, 2]))


def _step(xyz: Floats) -> float:
    """How far aside a last return may be at most: half a step of the scan, so that it has one."""
    steps = np.hypot(*np.diff(xyz[:, :2], axis=0).T)
    return min(ASIDE, float(np.median(steps)) / 2) if len(steps) else ASIDE


def _mutual(one: Floats, other: Floats, reach: float = np.inf) -> tuple[Ints, Ints]:
    """Indices of the points that are nearest to each other in both directions, within reach."""
    if not (len(one) and len(other)):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    of_one = np.asarray(cKDTree(other).query(one, distance_upper_bound=reach)[1])
    of_other = np.asarray(cKDTree(one).query(other, distance_upper_bound=reach)[1])
    back = np.append(of_other, -1)[of_one]  # of those without a neighbour, the last: none
    mutual = np.flatnonzero(back == np.arange(len(one)))
    return mutual, of_one[mutual]


def _without(count: int, some: Ints) -> Ints:
    return np.delete(np.arange(count), some)


# Returns that follow each other, or share a time ----------------------------------------------


def _whole(some: Ints, number: Ints, count: Ints, pulse: Ints) -> Pulses:
    """Whole pulses of some returns, by the number of the pulse of each."""
    total = int(pulse.max()) + 1 if len(pulse) else 0
    is_first, is_last = number == 1, number == count
    firsts, lasts = (np.bincount(pulse[which], minlength=total) for which in (is_first, is_last))
    mixed = ((firsts > 1) | (lasts > 1))[pulse]
    if len(pulse) and mixed.mean() > MANY:
        raise DataError(
            f"points: {np.count_nonzero(mixed)} of {len(pulse)} returns share their gps_time with "
            "other pulses; use pairs order if the points are in the order of the scan"
        )
    whole = ((firsts == 1) & (lasts == 1))[pulse]
    first, last = np.full(total, -1), np.full(total, -1)
    first[pulse[is_first]], last[pulse[is_last]] = some[is_first], some[is_last]
    return Pulses(some[whole], first[pulse[whole]], last[pulse[whole]])


def _by_time(cloud: PointCloud, some: Ints) -> Ints:
    """Number of the pulse of each point, by its time, flight line, channel and return count."""
    columns = [cloud[name][some] for name in KEYS if name in cloud]
    order = np.lexsort(columns[::-1])
    new = np.zeros(len(some), bool)
    for column in columns:
        new[1:] |= np.diff(column[order].astype(np.float64)) != 0
    pulse = np.empty(len(some), np.int64)
    pulse[order] = np.cumsum(new)
    return pulse


def _by_order(number: Ints, count: Ints) -> Ints:
    """Number of the pulse of each point in file order; a gap in return numbers begins a new one."""
    new = np.ones(len(number), bool)
    new[1:] = (np.diff(number) != 1) | (np.diff(count) != 0)
    return np.cumsum(new) - 1
