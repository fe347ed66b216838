"""Classification by a self-organising map whose clusters are named by physical evidence.

References
----------
Şen, A. and Bayaslı, B. (2020): the filter by a self-organising map, with its size, its weights and
its second stage; there the clusters were named by eye.
Sithole, G. and Vosselman, G. (2004). Experimental comparison of filter algorithms for bare-Earth
extraction from airborne laser scanning point clouds. ISPRS Journal 59(1-2), 85-101: errors.

The map itself: :mod:`algorithms.classify._som`; how well it does and why:
docs/explanation/self-organising-map.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify import _evidence, _som
from algorithms.classify._evidence import GROUND, features_of, missing_feature, no_point_has_all
from algorithms.classify._feature_map import (
    NO_NEURON,
    FeatureMap,
    named,
    split,
    trained,
    with_classes,
)
from algorithms.shared import parameters
from algorithms.shared.chance import random_keys
from algorithms.shared.ground import taking_part
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Raster, Table
from toolbox.declare import Attribute, ClassList, outputs, param, sink, source, tool
from toolbox.errors import DataError

DEFAULT = ("height_above_ground", "ground", "planarity", "returns", "intensity")
PLAIN, IMPORTANT = 1.0, 10.0  # weights of x and y, and of all others (Şen and Bayaslı)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]


@tool(
    "classify.som",
    title="Classify (self-organising map)",
    tags=(
        "som",
        "neural",
        "network",
        "kohonen",
        "unsupervised",
        "clustering",
        "train",
    ),
)
class ClassifySom:
    """Find ground, vegetation and buildings with a self-organising map.

    Neurons on a lattice learn to stand for the points, by the features that are named: x, y, z;
    height_above_ground and ground, both by the filter of ground.classify; planarity, the share of
    the points around that lie on a plane, roughness, their mean distance from planes in metres, and
    returns, the share of them after which the pulse went on; or any attribute of the points, such
    as intensity or one of features.local. Features are brought to the same range and weighted.

    Each cluster of points then gets the class that most of its points have by evidence: ground (2)
    by ground.classify, and of the rest vegetation (5) where pulses go through and nothing is plane,
    or building (6). With `labels`, the classes of some points are the evidence instead, and all
    their classes can be found. Clusters of which more than `max_impurity` of the known points are
    of another class are split by a second map. With `search`, the map grows from two neurons until
    no more than `max_impurity` of the points of any cluster, and so of all, are astray, or until it
    has `rows` and `columns`; `sizes` has the errors of each size.

    `map` is the trained map, which classify.som_apply applies to other data and to tiles. Train it
    on a part of a large survey. Cars, walls and wires are none of the three and become one of them.
    """

    points: PointCloud = source("Points to classify")
    features: tuple[str, ...] | None = param(
        "Names of features; by default height_above_ground ground planarity returns intensity",
        default=None,
        of="points",
        offers=tuple(_evidence.MADE),
    )
    weights: tuple[float, ...] | None = param(
        "Weight of each feature; by default 1 for x and y and 10 for all others",
        default=None,
        unit="1",
        gt=0,
        label="Weights of features",
    )
    labels: Attribute | None = param(
        "Attribute with the classes of some points, 0 where unknown, to name clusters by",
        default=None,
        of="points",
        label="Attribute with known classes",
    )
    rows: int = param("Rows of neurons", default=4, unit="1", ge=1, le=100, label="Rows of neurons")
    columns: int = param(
        "Columns of neurons", default=5, unit="1", ge=1, le=100, label="Columns of neurons"
    )
    lattice: _som.Shape = param("Lattice of the neurons", default="hexagonal")
    neighbourhood: _som.Neighbourhood = param(
        "How neurons follow a neighbour that wins", default="gaussian"
    )
    method: _som.Method = param(
        "How neurons learn: from all points at once, or from one after the other",
        default="batch",
        words={"batch": "From all points at once", "online": "From one after the other"},
    )
    iterations: int = param("Passes over all points", default=200, unit="1", ge=1, le=100_000)
    initial: _som.Initial = param(
        "Weights to begin with: in the principal plane of the data, or random", default="plane"
    )
    final_radius: float = param(
        "Radius of the neighbourhood in the last pass, in steps of the lattice",
        default=_som.FINAL,
        unit="1",
        gt=0,
        le=50,
    )
    search: bool = param(
        "Grow the map from two neurons until max_impurity is met",
        default=False,
        label="Grow the map",
    )
    max_impurity: float = param(
        "Share of points of another class that a cluster may have",
        default=0.2,
        unit="1",
        ge=0,
        le=1,
        label="Largest impurity",
    )
    parts: int = param(
        "Neurons that a mixed cluster is split into; 1 to split none",
        default=3,
        unit="1",
        ge=1,
        le=20,
        label="Parts of a mixed cluster",
    )
    radius: float = parameters.plane_radius()
    context: float = parameters.context()
    sample: int = param(
        "Points that the map learns from; of more, as many chosen by chance",
        default=1_000_000,
        unit="1",
        ge=2,
        le=100_000_000,
        label="Points to learn from",
    )
    seed: int = parameters.seed()
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        classified: PointCloud = sink(
            "The same points with classes, neuron, its distance and confidence",
            label="Classified points",
        )
        map: Table = sink("The trained map: one row per neuron, for classify.som_apply")
        sizes: Table = sink("Errors of each size of the map that was tried: one row per size")
        planes: Raster = sink("Pictures of the map: the U-matrix and each feature, from 0 to 1")
        neurons: int = sink("Clusters that the points were put into", unit="1")
        astray: float = sink("Share of known points whose cluster is of another class", unit="1")
        quantisation_error: float = sink("Mean distance from the neurons, weighted", unit="1")
        topographic_error: float = sink(
            "Share of points whose two nearest neurons are not side by side", unit="1"
        )
        unclassified: int = sink("Points that lack a feature, now of class 1", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """Every feature has one weight, and the map has at least two neurons."""
        if self.features is not None and not self.features:
            yield "features", "give at least one name"
        if self.features and len(set(self.features)) < len(self.features):
            yield "features", "a name is given twice"
        if self.weights is not None:
            count = len(self.features or ())
            if count != len(self.weights):
                text = f"give one for each of {count} features" if count else "name features, too"
                yield "weights", f"{text}, got {len(self.weights)}"
        if self.rows * self.columns < 2:
            yield "columns", "a map needs at least two neurons"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """Features that are not computed are attributes of the points."""
        if text := missing_feature(self.features or (), self.points):
            yield "features", text

    def halo(self) -> float:
        """Infinite, as all points train the map; classify.som_apply applies it to tiles."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> ClassifySom.Outputs:
        """Train a map on the points that take part, name its clusters, and classify."""
        part = taking_part(self.points, self.ignore)
        if not part.any():
            raise DataError("points: there are none to train a map on")
        features = _evidence.PointFeatures(
            self.points if part.all() else self.points.select(part),
            self.radius,
            self.context,
            ctx.part(0.0, 0.4),
        )
        names = self.features or usual_features(features)
        values = features_of(features, names)
        if problem := no_point_has_all(names, values):
            raise DataError(problem)
        known = self._known(features)
        able = np.flatnonzero(np.isfinite(values).all(axis=1))
        chosen = able[drawn(features.xyz[able], self.sample, self.seed)]
        made, sizes = self._map(names, values[chosen], known[chosen], ctx.part(0.4, 0.9))
        best, away = made.neurons(values, ctx.part(0.9, 1.0))
        first = made.stage_one(values[chosen])
        return self.Outputs(
            classified=with_classes(self.points, part, made, best, away),
            map=made.table(),
            sizes=Table.from_rows(sizes),
            planes=made.planes(),
            neurons=int(np.count_nonzero(made.leaves)),
            astray=share_astray(made, best, known),
            quantisation_error=_som.quantisation_error(first),
            topographic_error=_som.topographic_error(first, made.place),
            unclassified=int(np.count_nonzero(best == NO_NEURON)),
        )

    def _known(self, features: _evidence.PointFeatures) -> Bytes:
        """The class of each point by labels or evidence; 0 where not known."""
        if self.labels is None:
            return _evidence.evidence(features)
        known = features.cloud[self.labels]
        if not ((known == known.astype(np.uint8)).all() and known.any()):
            raise DataError(
                f"points: {self.labels} must hold classes from 0 to 255, and some not 0"
            )
        return np.asarray(known, np.uint8)

    def _map(
        self, names: tuple[str, ...], values: Floats, known: Bytes, ctx: Context
    ) -> tuple[FeatureMap, list[dict[str, Any]]]:
        """Train a map of one size or of growing sizes, and split its mixed clusters.

        Returns the map, and the errors of each size that was tried.
        """
        tried: list[dict[str, Any]] = []
        how = _som.Training(
            iterations=self.iterations,
            neighbourhood=self.neighbourhood,
            method=self.method,
            final=self.final_radius,
            seed=self.seed,
            initial=self.initial,
        )
        low, high = values.min(axis=0), values.max(axis=0)
        for name in np.array(names)[low == high]:
            log.warning("feature %s is the same at all points and tells nothing", name)
        metre, nothing = self.points.metre, np.zeros(0)
        empty = FeatureMap(
            names,
            low,
            high,
            self._weights(names),
            nothing,
            nothing,
            nothing.astype(int),
            nothing.astype("u1"),
            nothing.astype(int),
            nothing,
            self.radius / metre,
            self.context / metre,
        )
        sizes = [*growing(self.rows, self.columns)] if self.search else [(self.rows, self.columns)]
        for k, size in enumerate(sizes):
            if len(values) < math.prod(size):
                raise DataError(
                    f"points: {len(values)} are fewer than the {math.prod(size)} neurons; "
                    "lower rows and columns"
                )
            part = ctx.part(k / len(sizes), (k + 0.8) / len(sizes))
            made = trained(values, empty, (*size, self.lattice), how, part)
            best, _ = made.neurons(values)
            made = named(made, best, known)
            tried.append(errors_of_size(size, made, best, known))
            if tried[-1]["worst_cluster"] <= self.max_impurity:  # and so is the error of the whole
                break
        else:
            if self.search:
                log.warning(
                    "max_impurity %g is not met by %d x %d neurons", self.max_impurity, *size
                )
        if self.parts > 1:
            made = split(made, values, best, self.max_impurity, self.parts, how, ctx.part(0.8, 1.0))
            made = named(made, made.neurons(values)[0], known)
        return made, tried

    def _weights(self, names: tuple[str, ...]) -> Floats:
        if self.weights is not None:
            return np.array(self.weights, float)
        return np.array([PLAIN if name in ("x", "y") else IMPORTANT for name in names])


def usual_features(features: _evidence.PointFeatures) -> tuple[str, ...]:
    """The features of DEFAULT for which the points have data."""
    left_out, cloud = set(), features.cloud
    if not features.has_several_returns:
        left_out.add("returns")
    if "intensity" not in cloud or np.ptp(cloud["intensity"]) == 0:
        left_out.add("intensity")
    if left_out:
        log.info("without %s, which the points do not have", " and ".join(sorted(left_out)))
    return tuple(name for name in DEFAULT if name not in left_out)


def drawn(xyz: Floats, count: int, seed: int) -> Ints:
    """Indices of `count` points chosen at random by their coordinates, whatever their order."""
    if len(xyz) <= count:
        return np.arange(len(xyz))
    keys = random_keys(xyz, seed)
    return np.flatnonzero(keys <= np.partition(keys, count - 1)[count - 1])


def growing(rows: int, columns: int) -> Iterator[tuple[int, int]]:
    """Sizes (rows, columns) of a growing map, from two neurons to the size given."""
    size = (1, min(2, columns)) if columns > 1 else (2, 1)
    while True:
        yield size
        if size == (rows, columns):
            return
        wider = size[1] < columns and (size[1] <= size[0] + 1 or size[0] == rows)
        size = (size[0], size[1] + 1) if wider else (size[0] + 1, size[1])


def errors_of_size(
    size: tuple[int, int], made: FeatureMap, best: Ints, known: Bytes
) -> dict[str, Any]:
    """Row of the table of sizes: shares of points of known class that are on the wrong side.

    `filtering_error` is that between ground and all else (Sithole and Vosselman), `astray` that of
    all classes, `worst_cluster` that of the neuron with the largest share.
    """
    told = (known > 0) & (best != NO_NEURON)
    ground, given = known[told] == GROUND, made.classes[best[told]] == GROUND
    return {
        "rows": size[0],
        "columns": size[1],
        "neurons": len(made.values),
        "filtering_error": float(np.mean(ground != given)) if told.any() else 0.0,
        "astray": share_astray(made, best, known),
        "worst_cluster": float(made.astray.max()),
    }


def share_astray(made: FeatureMap, best: Ints, known: Bytes) -> float:
    """Share of the points of known class whose neuron has another class."""
    told = (known > 0) & (best != NO_NEURON)
    if not told.any():
        return 0.0
    return float(np.mean(made.classes[best[told]] != known[told]))
