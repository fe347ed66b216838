"""Counterparts: the reference point for each point, by coordinates and attributes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toolbox.context import QUIET, Context

# Coordinates are the same if they agree to this: 0.1 mm on the ground in degrees, or 1 micrometre.
SAME_IN_DEGREES, SAME = 1e-9, 1e-6
DEGREES = 360.0  # larger numbers are no degrees; smaller ones have digits enough for 1e-9
# Borders between two roundings lie at this share of a step, where no decimal number lies.
BORDER = 0.685
BLOCK = 200_000  # points between two checks for cancellation

Columns = Sequence[NDArray[Any]]
# Of some points: what they must share with their counterpart, and what only sorts them.
Ties = Callable[[NDArray[np.int64]], tuple[Columns, Columns]]


def counterparts(
    xyz: NDArray[np.float64],
    reference: NDArray[np.float64],
    ties: Ties = lambda few: ((), ()),
    reference_ties: Ties = lambda few: ((), ()),
    *,
    max_distance: float | None = None,
    ctx: Context = QUIET,
) -> NDArray[np.int64]:
    """Index of the reference point for each point; the order of the clouds does not matter.

    Of several points at one position, those that are alike in all shared attributes belong
    together; of the others the k-th belongs to the k-th of the reference points there. Points left
    over may take the nearest reference point, several of them the same one.

    Parameters
    ----------
    xyz, reference : arrays of shape (n, 3) and (m, 3), in the same unit
    ties, reference_ties : give for an array of indices the columns by which points at one position
        are told apart, the weightiest first, and those by which they are sorted after that
    max_distance : farthest counterpart of points left over, in that unit; None to leave them
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)
        Index into reference, -1 where there is none.
    """
    place, reference_place = shared_places(xyz, reference)
    ctx.progress(0.4)
    finer, reference_finer = told_apart(place, reference_place, ties, reference_ties)
    found = paired(finer, reference_finer, lambda i: ties(i)[1], lambda i: reference_ties(i)[1])
    free = np.ones(len(reference), bool)
    free[found[found >= 0]] = False
    rest, free_rest = np.flatnonzero(found < 0), np.flatnonzero(free)
    second = paired(
        place[rest],
        reference_place[free_rest],
        lambda i: [c for columns in ties(rest[i]) for c in columns],
        lambda i: [c for columns in reference_ties(free_rest[i]) for c in columns],
    )
    found[rest] = np.where(second >= 0, np.append(free_rest, -1)[second], -1)
    ctx.progress(0.5)
    if max_distance is not None and len(reference):
        # The tree is built in a sorted order, which decides between equally near points.
        columns = [c for part in reference_ties(np.arange(len(reference))) for c in part]
        order = np.lexsort([*reversed(columns), *reference.T])
        _take_nearest(found, xyz, reference, order, max_distance, ctx.part(0.5, 1.0))
    return found


def told_apart(
    place: NDArray[np.int64], reference_place: NDArray[np.int64], ties: Ties, reference_ties: Ties
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of positions, split where points differ in a shared attribute."""
    size = max(place.max(initial=-1), reference_place.max(initial=-1)) + 1
    several = np.bincount(place, minlength=size) > 1
    several |= np.bincount(reference_place, minlength=size) > 1
    few, reference_few = np.flatnonzero(several[place]), np.flatnonzero(several[reference_place])
    pairs = zip(
        [place[few], *ties(few)[0]],
        [reference_place[reference_few], *reference_ties(reference_few)[0]],
        strict=True,
    )
    number = size + numbered([np.concatenate(pair).astype(np.float64) for pair in pairs])
    finer, reference_finer = place.copy(), reference_place.copy()
    finer[few], reference_finer[reference_few] = number[: len(few)], number[len(few) :]
    return finer, reference_finer


def paired(
    place: NDArray[np.int64],
    reference_place: NDArray[np.int64],
    order_by: Callable[[NDArray[np.int64]], Columns],
    reference_order_by: Callable[[NDArray[np.int64]], Columns],
) -> NDArray[np.int64]:
    """Index of the k-th reference point for the k-th point at a position; -1 if there is none."""
    rank = rank_in_place(place, order_by)
    reference_rank = rank_in_place(reference_place, reference_order_by)
    count = np.bincount(reference_place, minlength=place.max(initial=-1) + 1)
    first = np.cumsum(count) - count
    order = np.empty(len(reference_place), np.int64)
    order[first[reference_place] + reference_rank] = np.arange(len(reference_place))
    matched = rank < count[place]
    found = np.full(len(place), -1)
    found[matched] = order[first[place[matched]] + rank[matched]]
    return found


def _take_nearest(
    found: NDArray[np.int64],
    xyz: NDArray[np.float64],
    reference: NDArray[np.float64],
    order: NDArray[np.int64],
    max_distance: float,
    ctx: Context,
) -> None:
    """Set the missing counterparts (-1) to the nearest reference point (in place)."""
    tree, left_over = cKDTree(reference[order]), np.flatnonzero(found < 0)
    for start in range(0, len(left_over), BLOCK):
        ctx.progress(start / len(left_over))
        block = left_over[start : start + BLOCK]
        distance, index = tree.query(xyz[block], distance_upper_bound=max_distance)
        found[block] = np.where(np.isfinite(distance), order[index % len(order)], -1)


def shared_places(
    xyz: NDArray[np.float64], reference: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of the position of each point and reference point, equal for equal coordinates.

    Parameters
    ----------
    xyz, reference : arrays of shape (n, 3) and (m, 3)

    Returns
    -------
    arrays of shape (n,) and (m,)
    """
    largest = max(np.abs(part[:, :2]).max(initial=0.0) for part in (xyz, reference))
    step = SAME_IN_DEGREES if largest <= DEGREES else SAME
    columns, reference_columns = (
        [np.floor(part[:, axis] / step + 1 - BORDER) for axis in range(3)]
        for part in (xyz, reference)
    )
    if all(map(np.array_equal, columns, reference_columns)):  # in the same order: half the work
        place = numbered(columns)
        return place, place
    place = numbered(
        [np.concatenate(pair) for pair in zip(columns, reference_columns, strict=True)]
    )
    return place[: len(xyz)], place[len(xyz) :]


def numbered(columns: Sequence[NDArray[np.float64]]) -> NDArray[np.int64]:
    """Number of each row of some columns: equal for equal rows, from 0, in their sorted order."""
    order = np.lexsort(columns)
    another = np.zeros(len(order), bool)
    for column in columns:
        another[1:] |= np.diff(column[order]) != 0
    number = np.empty(len(order), np.int64)
    number[order] = np.cumsum(another)
    return number


def rank_in_place(
    place: NDArray[np.int64], order_by: Callable[[NDArray[np.int64]], Columns]
) -> NDArray[np.int64]:
    """Rank 0, 1, 2, ... of each point among those at the same position.

    Parameters
    ----------
    place : array of shape (n,), numbers from 0
    order_by : gives the columns by which some of the points are sorted, the weightiest first

    Returns
    -------
    array of shape (n,)
    """
    rank = np.zeros(len(place), np.int64)
    crowded = np.flatnonzero(np.bincount(place)[place] > 1)  # few, and only these need sorting
    order = crowded[np.lexsort([*reversed(order_by(crowded)), place[crowded]])]
    starts = np.flatnonzero(np.diff(place[order], prepend=-1))
    rank[order] = np.arange(len(order)) - np.repeat(starts, np.diff(starts, append=len(order)))
    return rank
