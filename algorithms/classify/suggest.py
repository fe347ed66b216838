"""Patches of ground whose labels would teach a classifier most.

References
----------
Wei, K., Iyer, R. and Bilmes, J. (2015). Submodularity in data subset selection and active learning.
ICML, PMLR 37, 1954-1963: what is chosen covers what is uncertain, and nothing twice.
Nemhauser, G. L., Wolsey, L. A. and Fisher, M. L. (1978). An analysis of approximations for
maximizing submodular set functions. Mathematical Programming 14, 265-294: one after the other.
Settles, B. (2009). Active learning literature survey. University of Wisconsin-Madison, Computer
Sciences Technical Report 1648: entropy as uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.classify._learning import features as names_of
from algorithms.classify._learning.model import Trained, problems
from algorithms.shared import parameters
from algorithms.shared.chance import random_keys
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Table, Vector
from toolbox.data.crs import crs_conflict
from toolbox.data.report import Column
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import NothingToDo

FEWEST = 5  # points of a patch
KINDS = 100  # of points, by their features; with 30 unlike points are of one kind
SAMPLE = 20_000  # points that kinds are found in, 200 for each
COLUMNS = {
    "rank": Column("Rank"),
    "uncertainty": Column("Uncertainty", "%", 1, 100.0),
    "points": Column("Points"),
    "likely": Column("Most probable class"),
    "class": Column("Class, to fill in"),
}

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@tool(
    "classify.suggest",
    title="Suggest patches to label",
    tags=("classify", "train", "learn", "active-learning", "label", "sample", "annotate"),
)
class ClassifySuggest:
    """Suggest the patches of ground whose labels would teach a model most.

    The ground is cut into squares of `patch`. The points are sorted into 100 kinds by their
    features. Patches are taken one after the other, each time the one whose labels would add most:
    of each kind the logarithm of the points that are labelled then, so that one more tells less
    where many of its kind are labelled, by `labelled` or in a patch taken before. Kinds count by
    how unsure `model` is of their points (the sum of the entropies of their probabilities); without
    a model, for the first round, all kinds count the same.

    Open `patches` in QGIS beside the points, label the points in them (or fill in `class` where a
    patch is all of one class, for `areas` of classify.train), train, and ask again with the new
    model and the patches labelled so far as `labelled`, which are not suggested again. `rank` is
    the order in which they are taken; `uncertainty` is the mean over the points of how far the most
    probable class is from certain.
    """

    points: PointCloud = source("Points of which some are to be labelled")
    model: Table | None = source(
        "Model of the labels so far, as classify.train gives it; none at first", default=None
    )
    labelled: Vector | None = source(
        "Polygons that are labelled already", default=None, shapes="polygon"
    )
    wanted: int = param("Patches to suggest", default=20, unit="1", ge=1, le=10_000)
    patch: float = param("Side of a patch", default=5.0, unit="m", gt=0, le=1000)
    seed: int = parameters.seed()
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        patches: Vector = sink("Squares to label, the most telling first", columns=COLUMNS)
        uncertainty: float | None = sink(
            "Mean over all points of how far the most probable class is from certain", unit="%"
        )

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The model is one of these points, and the polygons lie in their CRS."""
        if self.model is not None:
            yield from problems(self.model, self.points)
        if self.labelled is None:
            return
        if conflict := crs_conflict(self.labelled.crs, self.points.crs, heights=False):
            yield (
                "labelled",
                f"{self.labelled.name or 'the layer'} {conflict}, which is that of the points",
            )

    def halo(self) -> float:
        """Patches compete over the whole survey."""
        return np.inf

    def run(self, ctx: Context = QUIET) -> ClassifySuggest.Outputs:
        """Describe the points, judge each patch, and choose."""
        part = taking_part(self.points, self.ignore)
        chosen = self.points if part.all() else self.points.select(part)
        made = None if self.model is None else Trained.of(self.model)
        if not len(chosen):
            raise NothingToDo("points: there are none to label", instead=self._outputs([], None))
        names = made.features if made else names_of.usual(chosen, names_of.RADII)
        data = names_of.described(chosen, names, ctx=ctx.part(0.0, 0.8))
        chance = np.ones((len(data), 1)) if made is None else made.probabilities(data)
        squares = Squares.of(chosen.xyz[:, :2], self.patch)
        doubt = 1.0 - chance.max(axis=1)
        taken = self._taken(squares)
        held = Held.of(squares, kinds(chosen.xyz, data, self.seed), chance)
        order = suggested(held, taken, (squares.count >= FEWEST) & ~taken, self.wanted)
        ctx.progress(1.0)
        rows = list(self._rows(squares, order, doubt, chance, made))
        return self._outputs(rows, 100 * float(doubt.mean()) if made else None)

    def _taken(self, squares: Squares) -> NDArray[np.bool_]:
        """Squares that are labelled already, by their middles."""
        if self.labelled is None or not len(self.labelled.frame):
            return np.zeros(len(squares.count), bool)
        middles = shapely.points(squares.low + squares.side / 2)
        return np.asarray(
            shapely.intersects(shapely.union_all(self.labelled.frame.geometry.to_numpy()), middles)
        )

    def _rows(
        self, squares: Squares, order: Ints, doubt: Floats, chance: Floats, made: Trained | None
    ) -> Iterator[dict[str, Any]]:
        """Attributes and outline of each patch."""
        mean, likely = squares.mean(doubt[:, None])[:, 0], squares.mean(chance).argmax(axis=1)
        for rank, k in enumerate(order, start=1):
            west, south = squares.low[k]
            yield {
                "rank": rank,
                "uncertainty": float(mean[k]) if made else None,
                "points": int(squares.count[k]),
                "likely": int(made.classes[likely[k]]) if made else None,
                "class": None,
                "geometry": shapely.box(west, south, west + squares.side, south + squares.side),
            }

    def _outputs(self, rows: list[dict[str, Any]], doubt: float | None) -> ClassifySuggest.Outputs:
        import geopandas

        frame = geopandas.GeoDataFrame(
            rows, columns=[*COLUMNS, "geometry"], geometry="geometry", crs=self.points.crs
        )
        for name in ("likely", "class"):
            frame[name] = frame[name].astype("Int64")
        frame["uncertainty"] = frame["uncertainty"].astype(float)
        return self.Outputs(patches=Vector(frame, geometry_type="Polygon"), uncertainty=doubt)


@dataclass(frozen=True)
class Squares:
    """Squares of ground that hold points.

    Attributes
    ----------
    low : south-western corners, array of shape (m, 2)
    side : of the squares
    count : points in each
    own : for each of n points the index of its square
    """

    low: Floats
    side: float
    count: Ints
    own: Ints

    @classmethod
    def of(cls, xy: Floats, side: float) -> Squares:
        """The squares, which begin at whole multiples of their side, of points of shape (n, 2)."""
        cells, own, count = np.unique(
            np.floor(xy / side), axis=0, return_inverse=True, return_counts=True
        )
        return cls(cells * side, side, count, own.reshape(-1))

    def mean(self, values: NDArray[Any]) -> Floats:
        """Means of values of shape (n, k) in each square, shape (m, k)."""
        sums = [np.bincount(self.own, column, len(self.count)) for column in values.T]
        return np.asarray(np.column_stack(sums) / self.count[:, None])


@dataclass(frozen=True)
class Held:
    """How many points of each kind each square holds, where it holds any.

    Attributes
    ----------
    square, kind, count : index of the square, index of the kind, and points, arrays of one length
    weight : what each kind counts
    squares : their number
    """

    square: Ints
    kind: Ints
    count: Ints
    weight: Floats
    squares: int

    @classmethod
    def of(cls, squares: Squares, kind: Ints, chance: Floats) -> Held:
        """Kinds of n points, which count by the entropy of the points' probabilities (n, k)."""
        from scipy.special import entr

        pairs, count = np.unique(squares.own * KINDS + kind, return_counts=True)
        told = np.bincount(kind, entr(chance).sum(axis=1), KINDS).astype(float)
        weight = told if told.any() else np.ones(KINDS)
        return cls(pairs // KINDS, pairs % KINDS, count, weight, len(squares.count))

    def within(self, some: NDArray[np.bool_]) -> Floats:
        """Points of each kind in some squares."""
        own = some[self.square]
        return np.asarray(np.bincount(self.kind[own], self.count[own], len(self.weight)))

    def added(self, labelled: Floats) -> Floats:
        """What each square adds to points of each kind that are labelled."""
        before = labelled[self.kind]
        gain = np.log1p(self.count / (1.0 + before))  # log(1 + before + count) - log(1 + before)
        return np.asarray(np.bincount(self.square, self.weight[self.kind] * gain, self.squares))


def kinds(xyz: Floats, data: NDArray[np.float32], seed: int) -> Ints:
    """Kind of each point, by its features scaled to what nine tenths of the points have.

    They are found in a sample by place, so that the order of the points does not matter.
    """
    from sklearn.cluster import MiniBatchKMeans

    seen = [column[np.isfinite(column)] for column in data.T]
    middle = np.array([np.median(c) if len(c) else 0.0 for c in seen], np.float32)
    known = np.where(np.isfinite(data), data, middle)
    low, high = np.quantile(known, (0.05, 0.95), axis=0).astype(np.float32)
    scaled = np.clip((known - low) / np.where(high > low, high - low, 1), 0, 1)
    sample = np.lexsort([*scaled.T, *xyz.T, random_keys(xyz, seed)])[:SAMPLE]
    number = min(KINDS, len(sample))
    made = MiniBatchKMeans(number, n_init=1, random_state=seed).fit(scaled[sample])
    return np.asarray(made.predict(scaled), np.int64)


def suggested(
    held: Held, labelled: NDArray[np.bool_], free: NDArray[np.bool_], wanted: int
) -> Ints:
    """Indices of the patches to label, in the order in which they are taken.

    Parameters
    ----------
    held : what points they hold
    labelled : True for those that are labelled already
    free : True for those that may be taken
    wanted : number of patches

    Examples
    --------
    Two patches hold nine points of the first kind, one holds four of the second:

    >>> of = np.array([0, 1, 2]), np.array([0, 0, 1]), np.array([9, 9, 4])
    >>> suggested(Held(*of, np.ones(2), 3), np.zeros(3, bool), np.ones(3, bool), 2).tolist()
    [0, 2]
    """
    known, free, order = held.within(labelled), free.copy(), []
    for _ in range(min(wanted, int(free.sum()))):
        best = int(np.where(free, held.added(known), -1.0).argmax())
        order.append(best)
        free[best] = False
        known = known + held.within(np.arange(held.squares) == best)
    return np.array(order, np.int64)
