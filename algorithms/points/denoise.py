"""Statistical outlier removal: points too far from their neighbours are noise.

References
----------
Rusu, R. B. et al. (2008). Towards 3D point cloud based object maps for household environments.
Robotics and Autonomous Systems 56(11), 927-941: the mean distance to the k nearest neighbours.
Breunig, M. M. et al. (2000). LOF: identifying density-based local outliers. ACM SIGMOD, 93-104:
a point is judged by the density around its own neighbours.
Rousseeuw, P. J. and Croux, C. (1993). Alternatives to the median absolute deviation. Journal of
the American Statistical Association 88(424), 1273-1283: the factor 1.4826.

What we changed, why, and what each change was worth: docs/explanation/denoise.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.points import _denoise_kernels as kernels
from algorithms.points import _noise
from algorithms.points._noise_bounds import lowest_around
from algorithms.shared import parameters
from algorithms.shared.error_measures import NORMAL
from algorithms.shared.ground import taking_part
from algorithms.shared.kernels.sorting import stable
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks, require_finite
from algorithms.shared.neighbours import PointTree
from algorithms.shared.places import may_be_near
from algorithms.shared.plausible import is_on_map, two_surveys
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud
from toolbox.declare import ClassList, Memory, outputs, param, sink, source, tool
from toolbox.errors import DataError, NothingToDo

LOW, HIGH = kernels.LOW, kernels.HIGH
LEAST_DEVIATION = 0.25  # of what is usual: with the threshold of 10, 3.5 times that is no noise
FEW = 10  # points of which no share is taken
SPARE = 2.0  # times the distance in which half of the points have their neighbours: for four times
# as many
MOSTLY = 98  # percent of the points that have their neighbours within a suitable reach
NEARER, WIDER = 4, 4  # what is usual: for a fourth of the neighbours, and for four times as many
SEARCHED = 0.5  # of the points: where more are in doubt, means of all are found faster one by one
PER_SEARCH = 100  # nodes of the tree that a search may look at
MOST_CELLS = 1 << 31  # along an axis
STRIDE = 2 * MOST_CELLS  # from the number of a cell to that of the next in its row
WINDOW = np.array([i * STRIDE + j for i in (-1, 0, 1) for j in (-1, 0, 1)])  # around a cell

Scope = Literal["local", "global", "classic"]
Floats = NDArray[np.float64]
Verdicts = NDArray[np.uint8]
Indices = NDArray[np.int64]


@tool(
    "points.denoise",
    title="Remove noise",
    tags=(
        "noise",
        "outlier",
        "filter",
        "denoise",
        "sor",
        "clean",
        "isolated",
        "birds",
    ),
)
class PointsDenoise:
    """Remove or label points that lie too far from their neighbours.

    The mean distance of a point to its nearest `neighbours` is compared with what is usual. With
    `scope` local this is the median among the neighbours themselves, both the nearest few and many
    more, so that density may change from place to place and sparse wires stay. `global` compares
    with the median of the whole cloud; `classic` with mean and standard deviation, as the method
    was published. Those two look at neighbours at any distance and need the whole cloud at once.

    Before that, whatever is cut off from the ground below or above it by `height_gap` of empty
    air is noise, such as returns from clouds, mist and birds. Raise it where lines cross valleys.
    What stands no more than `plant_height` above its surroundings may be a plant, a fence or a car,
    and stays, with local.

    Noise becomes class 7, or 18 where it lies above its surroundings. Ignored classes and withheld
    points take no part and stay.
    """

    points: PointCloud = source("Points to clean")
    action: Literal["remove", "label"] = _noise.action()
    neighbours: int = param("Neighbours of a point", default=20, unit="1", ge=1, le=1000)
    threshold: float = param(
        "Standard deviations that the mean distance may lie above the usual",
        default=10.0,
        unit="1",
        ge=0,
    )
    scope: Scope = param(
        "What is usual: local, global or classic",
        default="local",
        label="Neighbours are compared with",
        words={
            "local": "Those around (local)",
            "global": "The whole cloud (global)",
            "classic": "Mean and deviation (classic)",
        },
    )
    reach: float = param(
        "Farthest neighbour to look for, with local; what is missing counts as this far",
        default=20.0,
        unit="m",
        gt=0,
        label="Farthest neighbour",
    )
    min_neighbours: int = param(
        "Points with fewer neighbours than this within reach are noise, with local",
        default=6,
        unit="1",
        ge=1,
        label="Fewest neighbours",
    )
    height_gap: float | None = param(
        "Empty height that cuts points off from the ground; none to skip this",
        default=100.0,
        unit="m",
        gt=0,
        label="Empty height above the ground",
    )
    plant_height: float = param(
        "Height above their surroundings up to which points stay; 0 for scans from the ground",
        default=2.0,
        unit="m",
        ge=0,
        label="Height of plants",
    )
    ignore: ClassList | None = parameters.ignore()

    memory = Memory(point=200.0, area=50.0)  # measured: 137, 0

    @outputs
    class Outputs:
        clean: PointCloud = sink(
            "The points without noise, or with noise as classes 7 and 18",
            label="Points without noise",
        )
        low_noise: int = sink("Points found to be low noise", unit="1")
        high_noise: int = sink("Points found to be high noise", unit="1")

        def in_words(self) -> str:
            """How many points are noise."""
            return _noise.in_words(self.low_noise, self.high_noise)

    def check(self) -> Iterator[tuple[str, str]]:
        """No more neighbours are required than searched for."""
        if self.min_neighbours > self.neighbours:
            text = f"must be <= neighbours ({self.neighbours}), got {self.min_neighbours}"
            yield "min_neighbours", text

    def halo(self) -> float:
        """Four times the search radius, or infinite.

        The distances of neighbours of neighbours are compared, and the height gap is judged
        in a window of cells around each of them.
        """
        return 4 * self.reach if self.scope == "local" else math.inf

    def run(self, ctx: Context = QUIET) -> PointsDenoise.Outputs:
        """Judge the points that take part, and remove or label the noise."""
        cloud = self.points
        part = taking_part(cloud, self.ignore)
        verdict = np.zeros(len(cloud), np.uint8)
        xyz = cloud.xyz if part.all() else cloud.xyz.compress(part, axis=0)
        verdict[part] = noise(
            xyz,
            neighbours=self.neighbours,
            threshold=self.threshold,
            scope=self.scope,
            reach=self.reach,
            min_neighbours=self.min_neighbours,
            height_gap=self.height_gap,
            plant_height=self.plant_height,
            ctx=ctx.part(0.0, 0.9),
        )
        outputs, count = self._outputs(verdict), np.count_nonzero(part)
        if self.scope == "local" and 0 < count <= self.min_neighbours:
            raise NothingToDo(
                f"points: {count} cannot have {self.min_neighbours} neighbours (min_neighbours) "
                "each, so that all would be noise",
                instead=outputs,
            )
        clean = verdict[part] == 0
        if is_on_map(cloud.crs) and (text := two_surveys(xyz, cloud.metre, clean)):
            log.warning("%s", text)
        found = np.count_nonzero(verdict)
        if found > max(FEW, _noise.MOST * count):
            share = f"{found} of {count} points ({100 * found / count:.3g} %) are called noise"
            advice = self._advice(xyz, ctx.part(0.9, 1.0))
            log.warning(
                "%s, and no survey has more than %g %%; %s", share, 100 * _noise.MOST, advice
            )
        ctx.progress(1.0)
        return outputs

    def _advice(self, xyz: Floats, ctx: Context) -> str:
        """What to do where more points are noise than can be."""
        wide = suitable_reach(xyz, self.neighbours, ctx)
        if self.scope == "local" and wide > self.reach:
            metres = math.ceil(wide / self.points.metre)
            return f"they are too sparse for reach: set it to {metres} m, and tiles far larger"
        return "look at them with action label, and raise threshold"

    def _outputs(self, verdict: Verdicts) -> PointsDenoise.Outputs:
        cloud = self.points
        return self.Outputs(
            clean=_noise.without(cloud, verdict, self.action),
            low_noise=int(np.count_nonzero(cloud.core & (verdict == LOW))),
            high_noise=int(np.count_nonzero(cloud.core & (verdict == HIGH))),
        )


def noise(
    xyz: Floats,
    *,
    neighbours: int = 20,
    threshold: float = 10.0,
    scope: Scope = "local",
    reach: float = 20.0,
    min_neighbours: int = 6,
    height_gap: float | None = 100.0,
    plant_height: float = 2.0,
    ctx: Context = QUIET,
) -> Verdicts:
    """Class of noise of each point, from its distances to its neighbours.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    neighbours, threshold, scope, min_neighbours : see :class:`PointsDenoise`
    reach, height_gap, plant_height : as there, in the unit of the points
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)
        0 for points to keep, 7 for low noise, 18 for high noise.

    Raises
    ------
    ValueError
        A coordinate is not a finite number.
    """
    require_finite(xyz)
    verdict = np.zeros(len(xyz), np.uint8)
    ctx.progress(0.0)
    if not len(xyz):
        return verdict
    if height_gap is not None and np.ptp(xyz[:, 2]) > height_gap:
        verdict = cut_off(xyz, reach, height_gap, ctx.part(0.0, 0.2))
    rest = verdict == 0
    main = xyz if rest.all() else xyz.compress(rest, axis=0)
    k = min(neighbours, len(main) - 1)
    if scope == "local":
        rule = (threshold, LEAST_DEVIATION, min_neighbours, plant_height)
        verdict[rest] = _beside_neighbours(main, neighbours, reach, rule, ctx.part(0.2, 0.95))
    elif k > 0:
        verdict[rest] = _beside_all(main, k, threshold, scope, ctx.part(0.2, 0.95))
    alone = np.flatnonzero(verdict == kernels.ISOLATED)
    verdict[alone] = against_columns(xyz, alone, reach, ctx.part(0.95, 1.0))
    ctx.progress(1.0)
    return verdict


def _beside_neighbours(
    xyz: Floats, k: int, reach: float, rule: tuple[float, float, int, float], ctx: Context
) -> Verdicts:
    """Verdicts on points: mean distances compared with those of the neighbours."""
    n, ratio, few = len(xyz), 1.0 + rule[0] * rule[1], max(1, k // NEARER)
    around: NDArray[Any]
    tree, around = lowest_around(xyz, k, reach, ratio, few, ctx.part(0.0, 0.4))
    points = np.flatnonzero(np.isfinite(around[0]))
    if len(points) > SEARCHED * n:
        around, mean, farthest = _all_means(tree, k, reach, ctx.part(0.4, 0.9))
        points = np.arange(n)
    else:
        mean, farthest = np.full(n, np.nan), np.zeros(n)  # zeros take no memory until they are used
    verdict = np.zeros(n, np.uint8)
    side_by_side(
        kernels.judge,
        blocks(len(points), PER_SEARCH),
        tree.xyz,
        tree.boxes,
        tree.depth,
        points,
        np.ascontiguousarray(around[:, points], np.float64),
        mean,
        farthest,
        (k, few, k * WIDER),
        reach,
        rule,
        verdict,
        ctx=ctx.part(0.9, 1.0),
    )
    return _as_given(tree, verdict)


def _as_given(tree: PointTree, verdict: Verdicts) -> Verdicts:
    """Verdicts in the order of the points that the tree was made of."""
    found, noise = np.zeros_like(verdict), np.flatnonzero(verdict)
    found[tree.order[noise]] = verdict[noise]
    return found


def _all_means(
    tree: PointTree, k: int, reach: float, ctx: Context
) -> tuple[Floats, Floats, Floats]:
    """Lowest mean distance around each point, and each one's own mean and largest distance."""
    mean, farthest = tree.mean_distances(k, max_distance=reach, ctx=ctx.part(0.0, 0.9))
    lowest, around = kernels.lowest_means(mean, tree.depth), np.full((2, len(mean)), np.inf)
    side_by_side(
        kernels.lowest_around,
        tree.leaves,
        tree.boxes,
        tree.depth,
        lowest,
        farthest,
        around[0],
        ctx=ctx.part(0.9, 1.0),
    )
    return around, mean, farthest


def _beside_all(xyz: Floats, k: int, threshold: float, scope: Scope, ctx: Context) -> Verdicts:
    """Verdicts on points: mean distances compared with those of the whole cloud."""
    tree = PointTree.of(xyz, ctx=ctx.part(0.0, 0.2))
    mean, _ = tree.mean_distances(k, ctx=ctx.part(0.2, 0.8))
    ordered = np.sort(mean)  # sums depend on the order
    if scope == "classic":
        usual, deviation = ordered.mean(), ordered.std(ddof=1)
    else:
        usual = np.median(ordered)
        deviation = NORMAL * np.median(np.abs(ordered - usual))
    verdict = np.zeros(len(mean), np.uint8)
    found = np.flatnonzero(mean > usual + threshold * deviation)
    side_by_side(
        kernels.sides,
        blocks(len(found), 100),
        tree.xyz,
        tree.boxes,
        tree.depth,
        found,
        k,
        verdict,
        ctx=ctx.part(0.8, 1.0),
    )
    return _as_given(tree, verdict)


def suitable_reach(xyz: Floats, neighbours: int, ctx: Context = QUIET) -> float:
    """A reach in which nearly all points have their neighbours, and half of them far more.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    neighbours : see :class:`PointsDenoise`
    """
    k = min(neighbours, len(xyz) - 1)
    _, farthest = PointTree.of(xyz).mean_distances(k, ctx=ctx)
    return float(max(SPARE * np.median(farthest), np.percentile(farthest, MOSTLY)))


# Columns -----------------------------------------------------------------------------------


def cell_numbers(xyz: Floats, cell: float) -> Indices:
    """Number of the square cell of each point; cells around it have that number plus WINDOW."""
    places = np.floor(np.ascontiguousarray(xyz[:, :2].T) / cell)
    places -= places.min(axis=1, keepdims=True)
    extent = places.max()
    if extent >= MOST_CELLS:
        raise DataError(
            f"points: they extend over {extent:,.0f} times reach ({cell:g}), and {MOST_CELLS:,} "
            "times is the limit: remove stray points or raise reach"
        )
    col, row = places.astype(np.int64)
    return np.asarray(col * STRIDE + row)


class Columns:
    """Points sorted by cell; only cells with points are stored."""

    def __init__(self, number: Indices) -> None:
        order, number = stable(number)
        self.order: Indices = order
        starts = np.flatnonzero(np.r_[True, number[1:] != number[:-1]])
        self.numbers: Indices = number[starts]
        self.edges: Indices = np.append(starts, len(number))

    def around(self, numbers: Indices) -> Indices:
        """Indices of the 3 x 3 cells around each cell, shape (9, m); -1 for one without points."""
        wanted = numbers + WINDOW[:, None]
        return np.where(is_among(wanted, self.numbers), np.searchsorted(self.numbers, wanted), -1)

    def points(self, cell: Any) -> Indices:
        """Indices of the points in a cell."""
        return self.order[self.edges[cell] : self.edges[cell + 1]]

    def window(self, cells: Indices) -> Indices:
        """Indices of the points in some cells; those of -1 have none."""
        return np.concatenate([self.points(cell) for cell in cells[cells >= 0]])


def is_among(numbers: Indices, few: Indices) -> NDArray[np.bool_]:
    """True for numbers in a short sorted array, without sorting them."""
    at = np.minimum(np.searchsorted(few, numbers), len(few) - 1)
    return np.asarray(few[at] == numbers)


def cut_off(xyz: Floats, cell: float, height_gap: float, ctx: Context = QUIET) -> Verdicts:
    """Noise in layers far above or below the main layer of points, however many points these have.

    In the window of 3 x 3 cells around each cell, the points fall into layers, with more than
    `height_gap` between them. All layers but the one of most points are noise.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    cell, height_gap : in the unit of the points
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)
        0 for points to keep, 7 for low noise, 18 for high noise.
    """
    columns, z = Columns(cell_numbers(xyz, cell)), xyz[:, 2]
    ctx.progress(0.3)
    lowest = np.minimum.reduceat(z[columns.order], columns.edges[:-1])
    highest = np.maximum.reduceat(z[columns.order], columns.edges[:-1])
    around = columns.around(columns.numbers)
    low = np.where(around >= 0, lowest[around], np.inf).min(axis=0)
    high = np.where(around >= 0, highest[around], -np.inf).max(axis=0)
    ctx.progress(0.5)
    verdict = np.zeros(len(xyz), np.uint8)
    deep = np.flatnonzero(high - low > height_gap)
    for done, cell_number in enumerate(deep):
        own = columns.points(cell_number)
        bottom, top = main_layer(z[columns.window(around[:, cell_number])], height_gap)
        verdict[own] = np.where(z[own] > top, HIGH, np.where(z[own] < bottom, LOW, 0))
        ctx.progress(0.5 + 0.5 * (done + 1) / len(deep))
    return verdict


def main_layer(z: Floats, gap: float) -> tuple[float, float]:
    """Lowest and highest z of the largest layer; layers are more than `gap` apart.

    Of layers of the same size the lowest is taken.
    """
    z = np.sort(z)
    cuts = np.flatnonzero(np.diff(z) > gap) + 1
    starts, stops = np.r_[0, cuts], np.r_[cuts, len(z)]
    largest = np.argmax(stops - starts)
    return float(z[starts[largest]]), float(z[stops[largest] - 1])


def against_columns(xyz: Floats, points: Indices, cell: float, ctx: Context = QUIET) -> Verdicts:
    """Low or high noise, by the median height of the window around each of some points.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    points : array of shape (m,), indices
    cell : in the unit of the points
    ctx : progress and cancellation

    Returns
    -------
    array of shape (m,)
        7 for low noise, 18 for high noise.
    """
    if not len(points):
        return np.zeros(0, np.uint8)
    near = np.flatnonzero(may_be_near(xyz[:, :2], xyz[points, :2], 2 * cell))
    numbers = cell_numbers(xyz[near], cell)
    columns, z = Columns(numbers), xyz[near, 2]
    cells, which = np.unique(numbers[np.searchsorted(near, points)], return_inverse=True)
    around = columns.around(cells)
    middle = np.empty(len(cells))
    for k in range(len(cells)):
        middle[k] = np.median(z[columns.window(around[:, k])])
        ctx.progress((k + 1) / len(cells))
    return np.where(xyz[points, 2] > middle[which], HIGH, LOW).astype(np.uint8)
