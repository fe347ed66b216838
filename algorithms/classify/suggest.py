"""Patches of ground whose labels would teach a classifier most.

References
----------
Zhdanov, F. (2019). Diverse mini-batch active learning. arXiv:1901.05954: of the most uncertain
ones, those in the middle of weighted clusters.
Settles, B. (2009). Active learning literature survey. University of Wisconsin-Madison, Computer
Sciences Technical Report 1648: uncertainty.
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
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Table, Vector
from toolbox.data.crs import crs_conflict
from toolbox.data.report import Column
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import NothingToDo

FEWEST = 5  # points of a patch
MORE = 10  # times as many uncertain patches as are wanted compete by their variety
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

    The ground is cut into squares of `patch`. How uncertain a patch is says `model`: the mean over
    its points of how far the most probable class is from certain. Of the most uncertain ones, ten
    times as many as are wanted, those are taken that differ in their features: one in the middle
    of each of as many clusters as patches are wanted. Without a model, for the first round, only
    the variety counts.

    Open `patches` in QGIS beside the points, label the points in them (or fill in `class` where a
    patch is all of one class, for `areas` of classify.train), train, and ask again with the new
    model and the patches labelled so far as `labelled`, which are not suggested again. `rank` is
    the order by uncertainty.
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
        patches: Vector = sink("Squares to label, the most uncertain first", columns=COLUMNS)
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
        found = squares.described(data, chance)
        free = (squares.count >= FEWEST) & ~self._taken(squares)
        order = suggested(found, squares.mean(doubt[:, None])[:, 0], free, self.wanted, self.seed)
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

    def described(self, data: NDArray[np.float32], chance: Floats) -> Floats:
        """What the points of each square are like: means of scaled features and probabilities."""
        seen = [column[np.isfinite(column)] for column in data.T]
        middle = [float(np.median(column)) if len(column) else 0.0 for column in seen]
        known = np.where(np.isfinite(data), data, middle)
        low, high = np.quantile(known, (0.05, 0.95), axis=0)
        scaled = np.clip((known - low) / np.where(high > low, high - low, 1.0), 0.0, 1.0)
        features = self.mean(scaled) / np.sqrt(data.shape[1])  # all of them count as one class does
        return np.hstack([features, self.mean(chance)])


def suggested(
    described: Floats, doubt: Floats, free: NDArray[np.bool_], wanted: int, seed: int
) -> Ints:
    """Indices of the patches to label, the most uncertain first.

    Parameters
    ----------
    described : what each patch is like, array of shape (m, k)
    doubt : how uncertain each is, array of shape (m,)
    free : True for those that may be chosen
    wanted : number of patches

    Examples
    --------
    >>> like = np.array([[0.0], [0.1], [5.0], [5.1]])
    >>> suggested(like, np.array([0.5, 0.4, 0.3, 0.0]), np.ones(4, bool), 2, 0).tolist()
    [0, 2]
    """
    from sklearn.cluster import KMeans

    index = np.flatnonzero(free)
    index = index[np.argsort(-doubt[index], kind="stable")]
    if doubt.any():
        index = index[: MORE * wanted]
    if len(index) > wanted:
        weight = doubt[index] + 1e-6 if doubt.any() else np.ones(len(index))
        made = KMeans(wanted, n_init=3, random_state=seed).fit(described[index], None, weight)
        away = np.linalg.norm(described[index] - made.cluster_centers_[made.labels_], axis=1)
        order = np.lexsort((away, made.labels_))
        first = np.flatnonzero(np.diff(made.labels_[order], prepend=-1))
        index = index[order[first]]
    return np.asarray(index[np.argsort(-doubt[index], kind="stable")])
