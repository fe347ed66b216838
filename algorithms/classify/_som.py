"""Self-organising maps: neurons on a lattice, trained to represent points by their features.

References
----------
Kohonen, T. (1990). The self-organizing map. Proceedings of the IEEE 78(9), 1464-1480.
Kohonen, T. (2013). Essentials of the self-organizing map. Neural Networks 37, 52-65: the batch
algorithm, and weights to begin with along the principal plane of the data.
Şen, A. and Bayaslı, B. (2020): equations 3 to 5 are the online rule as it is here.
Kiviluoto, K. (1996). Topology preservation in self-organizing maps. ICNN, 294-299: the topographic
error.
Ultsch, A. and Siemon, H. P. (1990). Kohonen's self organizing feature maps for exploratory data
analysis. INNC, 305-308: the U-matrix.
Hamerly, G. (2010). Making k-means even faster. SIAM Data Mining, 130-140: bounds of distances.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from algorithms.classify import _som_kernels as kernels
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks
from toolbox.context import QUIET, Context

Shape = Literal["hexagonal", "square"]
Neighbourhood = Literal["gaussian", "linear"]
Method = Literal["batch", "online"]
Initial = Literal["plane", "random"]
FINE = float(1 << 24)  # steps of a weighted feature in which sums are made, so that they are exact
HALF = 4096.0
FINAL = 0.4  # radius of the neighbourhood in the end, in steps of the lattice
RATE, FINAL_RATE = 0.5, 0.01  # of learning with the online rule, at the start and in the end
TOUCHING = 1.0 + 1e-9  # distance of neurons that are neighbours on the lattice
ROUNDING = 1.0 + 1e-9
PER_POINT = 5  # blocks are this many times as long as a point is wide

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def places(rows: int, columns: int, shape: Shape) -> Floats:
    """Positions of the neurons, one step from their neighbours, shape (rows * columns, 2)."""
    row, column = (part.ravel().astype(float) for part in np.mgrid[:rows, :columns])
    if shape == "square":
        return np.column_stack([column, row])
    return np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(0.75)])


def distances(place: Floats) -> Floats:
    """Distances between all neurons on the lattice, array of shape (m, m)."""
    return np.asarray(cdist(place, place))


@dataclass(frozen=True)
class Training:
    """Settings of the training of a map.

    Attributes
    ----------
    iterations : passes over all points
    neighbourhood : "gaussian" is exp(-d^2 / (2 s^2)) at the distance d on the lattice, for a radius
        s; "linear" falls from 1 to 0 at 2 s
    method : "batch" moves all neurons after each pass, to the weighted mean of the points;
        "online" moves them after each point
    start : radius in the first pass; None for half the longer side of the lattice
    final : radius in the last pass, with those between on a straight line
    rate, final_rate : of learning with the online rule, in the same way
    seed : for the order of points of the online rule, and for random weights
    initial : weights to begin with: in the principal plane of the data, or "random" between its
        lowest and highest values, as in the study
    """

    iterations: int = 200
    neighbourhood: Neighbourhood = "gaussian"
    method: Method = "batch"
    start: float | None = None
    final: float = FINAL
    rate: float = RATE
    final_rate: float = FINAL_RATE
    seed: int = 0
    initial: Initial = "plane"

    def pull(self, away: Floats, step: int) -> Floats:
        """How far each neuron follows each winner in a pass, from 0 to 1, array of shape (m, m).

        Parameters
        ----------
        away : distances on the lattice, see :func:`distances`
        step : number of the pass, from 0
        """
        done = step / max(self.iterations - 1, 1)
        start = max(away.max() / 2, self.final) if self.start is None else self.start
        radius = start + (self.final - start) * done
        if self.neighbourhood == "gaussian":
            return np.asarray(np.exp(-(away**2) / (2 * radius**2)))
        return np.maximum(0.0, 1.0 - away / (2 * radius))

    def learning_rate(self, step: int) -> float:
        """Learning rate of the online rule in a pass."""
        done = step / max(self.iterations - 1, 1)
        return self.rate + (self.final_rate - self.rate) * done


def train(data: Floats, place: Floats, how: Training, ctx: Context = QUIET) -> Floats:
    """Weights of neurons on a lattice, trained on points.

    Parameters
    ----------
    data : array of shape (n, features), n > 0
    place : of the m neurons on their lattice, see :func:`places`
    how : settings
    ctx : progress and cancellation, after each pass

    Returns
    -------
    array of shape (m, features)
        The same for any order of the points and any number of threads.
    """
    data = np.ascontiguousarray(data)
    largest = float(np.abs(data).max())
    fine = FINE / 2.0 ** np.ceil(np.log2(largest)) if largest > 0 else FINE
    steps = np.rint(data * fine).astype(np.int64)
    if how.initial == "random":
        low, high = data.min(axis=0), data.max(axis=0)
        chance = np.random.default_rng(how.seed).random((len(place), data.shape[1]))
        weights = low + chance * (high - low)
    else:
        weights = spread_out(steps, place) / fine
    if how.method == "online":
        return _online(data, weights, distances(place), how, ctx)
    return _batch(data, steps, fine, weights, distances(place), how, ctx)


def spread_out(steps: Ints, place: Floats) -> Floats:
    """Initial weights: the lattice laid into the plane of the two largest variances of the data.

    Parameters
    ----------
    steps : array of shape (n, features), whole numbers not larger than FINE
    place : array of shape (m, 2)

    Returns
    -------
    array of shape (m, features)
    """
    mean = steps.sum(axis=0) / len(steps)
    centred = steps - np.rint(mean)
    # Products of halves of the digits have exact sums, whatever the order of the points.
    high = np.rint(centred / HALF)
    low = centred - high * HALF
    mixed = high.T @ low
    products = (high.T @ high * HALF + mixed + mixed.T) * HALF + low.T @ low
    variance, axes = np.linalg.eigh(products / len(steps))
    flat = place - place.mean(axis=0)
    flat /= np.maximum(flat.std(axis=0), 1e-12)
    longer_first = np.argsort(-np.ptp(place, axis=0), kind="stable")
    weights = np.tile(mean, (len(place), 1))
    for side, k in zip(longer_first, range(len(variance) - 1, -1, -1), strict=False):
        axis = axes[:, k] * np.sign(axes[np.abs(axes[:, k]).argmax(), k])
        weights += np.outer(flat[:, side], np.sqrt(max(variance[k], 0.0)) * axis)
    return np.asarray(weights)


def _online(data: Floats, weights: Floats, away: Floats, how: Training, ctx: Context) -> Floats:
    """Weights after online training: points one by one, in each pass in another random order."""
    columns = np.ascontiguousarray(weights.T)
    straight = np.lexsort(data.T)  # the same for any order in which the points come
    rng = np.random.default_rng(how.seed)
    for step in range(how.iterations):
        pull = how.learning_rate(step) * how.pull(away, step)
        order = straight[rng.permutation(len(data))]
        for first, last in blocks(len(data), PER_POINT * len(weights)):
            kernels.learn(order[first:last], data, pull, columns)
            ctx.progress((step + last / len(data)) / how.iterations)
    return np.ascontiguousarray(columns.T)


def _batch(
    data: Floats,
    steps: Ints,
    fine: float,
    weights: Floats,
    away: Floats,
    how: Training,
    ctx: Context,
) -> Floats:
    """Weights after batch training: each neuron moves to the weighted mean of its neighbourhood."""
    runs = blocks(len(data), PER_POINT)
    shape = (len(runs), *weights.shape)
    sums, counts = np.zeros(shape, np.int64), np.zeros(shape[:2], np.int64)
    best, upper, lower = np.full(len(data), -1), np.zeros(len(data)), np.zeros(len(data))
    moved = np.zeros(len(weights))
    number = {first: k for k, (first, _) in enumerate(runs)}

    def assign(first: int, last: int) -> None:
        part = number[first]
        kernels.assign(
            first,
            last,
            data,
            steps,
            columns,
            moved,
            moved.max(),
            best,
            upper,
            lower,
            sums[part],
            counts[part],
        )

    for step in range(how.iterations):
        columns = np.ascontiguousarray(weights.T)
        if len(runs) == 1:
            assign(*runs[0])
        else:
            side_by_side(assign, runs)
        pull = how.pull(away, step)
        heard = pull @ counts.sum(axis=0)
        reached = heard > 0
        new = weights.copy()
        new[reached] = (pull @ (sums.sum(axis=0) / fine))[reached] / heard[reached, None]
        moved = np.linalg.norm(new - weights, axis=1) * ROUNDING
        weights = new
        ctx.progress((step + 1) / how.iterations)
    return weights


@dataclass(frozen=True)
class Winners:
    """The nearest and the second nearest neuron of each point.

    Attributes
    ----------
    best, second : the nearest neurons, arrays of shape (n,)
    distance : from the nearest, array of shape (n,)
    """

    best: Ints
    second: Ints
    distance: Floats


def winners(data: Floats, weights: Floats, ctx: Context = QUIET) -> Winners:
    """The two nearest neurons of points of shape (n, features)."""
    found = Winners(
        np.zeros(len(data), np.int64), np.zeros(len(data), np.int64), np.zeros(len(data))
    )
    side_by_side(
        kernels.nearest,
        blocks(len(data), PER_POINT),
        np.ascontiguousarray(data),
        np.ascontiguousarray(weights.T),
        found.best,
        found.second,
        found.distance,
        ctx=ctx,
    )
    return found


def quantisation_error(found: Winners) -> float:
    """Mean distance of the points from their neurons, the same for any order of the points."""
    return float(np.sort(found.distance).mean()) if len(found.distance) else 0.0


def topographic_error(found: Winners, place: Floats) -> float:
    """Share of points whose two nearest neurons are no neighbours on the lattice."""
    apart = np.linalg.norm(place[found.best] - place[found.second], axis=1) > TOUCHING
    return float(apart.mean()) if len(apart) else 0.0


def u_matrix(weights: Floats, place: Floats) -> Floats:
    """Mean distance of the weights of each neuron from those of its neighbours on the lattice."""
    one, other = cKDTree(place).query_pairs(TOUCHING, output_type="ndarray").T
    ends, apart = np.r_[one, other], np.linalg.norm(weights[one] - weights[other], axis=1)
    total, count = (np.bincount(ends, w, len(place)) for w in (np.tile(apart, 2), None))
    return np.asarray(total / np.maximum(count, 1))
