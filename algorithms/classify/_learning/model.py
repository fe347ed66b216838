"""Trained models as tables of numbers: nothing in them can be run, and all of them is checked.

A model is a table: its first row holds what is known of it as JSON, each other
row a node of a tree, or the coefficients of a feature. It is read without scikit-learn, and by eye.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from algorithms.classify._learning import features as names_of
from algorithms.classify._learning import kernels
from algorithms.classify._learning.kernels import AT_ONCE, MOST_LEAVES
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.lowest import blocks
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Table
from toolbox.errors import DataError

FORMAT = 2  # since planarity and roughness are those of coarser points, as all others
FIXED = ("about", "tree", "feature", "threshold", "left", "right", "missing_left")
MOST_CLASSES, MOST_NODES = 64, 20_000_000
LEAF = -1  # feature of a node without branches
FAR = 1e300  # threshold above all values, in place of infinity
FLOAT = float(np.finfo(np.float32).max)
COST = 2000  # points in a run of the kernel are as many less as nodes are visited
KINDS = ("boosting", "forest", "logistic")

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Trained:
    """A trained model.

    Attributes
    ----------
    about : kind, classes, features, temperature, baseline, ... ; see :meth:`of`
    tree : number of the tree of each node, array of shape (m,)
    feature : that the node asks for, LEAF for leaves
    threshold : points with at most this go left
    left, right : nodes that follow
    missing_left : points without the feature go left
    values : array of shape (m, k), what a leaf adds to the score of each class
    """

    about: Mapping[str, Any]
    tree: Ints
    feature: Ints
    threshold: Floats
    left: Ints
    right: Ints
    missing_left: NDArray[np.bool_]
    values: Floats

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features, in the order of the columns."""
        return tuple(self.about["features"])

    @property
    def classes(self) -> NDArray[np.uint8]:
        """Codes of the k classes, rising."""
        return np.array(self.about["classes"], np.uint8)

    def probabilities(self, data: NDArray[np.float32], ctx: Context = QUIET) -> Floats:
        """Calibrated probability of each class of points with features of shape (n, f), (n, k)."""
        return softmax(self.scores(data, ctx) / float(self.about["temperature"]))

    @property
    def limits(self) -> tuple[Floats, Floats]:
        """Least and greatest value of each feature in all of the training, arrays of shape (f,)."""
        edges = np.array(self.about["quantiles"])
        return edges.min(axis=(1, 2)), edges.max(axis=(1, 2))

    def _within(self, data: NDArray[np.float32]) -> NDArray[np.float32]:
        """Features no farther out than any that was learnt from, as trees take them by nature.

        A line goes on for ever: intensities of another sensor would outweigh all other features.
        """
        if "quantiles" not in self.about:  # of a fold, whose kept points lie in the same survey
            return data
        low, high = (limit.astype(np.float32) for limit in self.limits)
        return np.clip(data, low, high)

    def scores(self, data: NDArray[np.float32], ctx: Context = QUIET) -> Floats:
        """Logarithms of the probabilities before calibration, but for a term of each point."""
        if self.about["kind"] == "logistic":
            known = np.where(np.isnan(data), self.about["middle"], self._within(data))
            scaled = (known - np.array(self.about["middle"])) / np.array(self.about["scale"])
            return np.asarray(scaled @ self.values + np.array(self.about["baseline"]))
        found = np.tile(np.array(self.about["baseline"], float), (len(data), 1))
        roots = np.flatnonzero(np.diff(self.tree, prepend=-1))
        column, rows = self._columns(roots), np.ascontiguousarray(data)
        runs = blocks(len(data), COST)
        if (column >= 0).all() and np.bincount(
            self.tree[self.feature == LEAF]
        ).max() <= MOST_LEAVES:
            packed = self._packed(roots, column)
            side_by_side(kernels.scores_of_small, runs, rows, *packed, found, ctx=ctx)
        else:
            nodes = self.feature, self.threshold, self.left, self.right, self.missing_left
            values = np.ascontiguousarray(self.values)
            side_by_side(kernels.scores, runs, rows, roots, column, *nodes, values, found, ctx=ctx)
        if self.about["kind"] == "forest":
            return np.asarray(np.log(np.maximum(found / len(roots), 1e-6)))
        return found

    def _packed(self, roots: Ints, column: Ints) -> tuple[NDArray[Any], ...]:
        """Trees of few leaves as :func:`kernels.scores_of_small` takes them."""
        count, inner = len(self.tree), self.feature != LEAF
        held, before = np.empty(count, np.int64), np.zeros(count, np.int64)
        kernels.leaves(self.feature, self.left, self.right, held, before)
        branch = np.flatnonzero(inner)
        row = self.feature[branch] + np.where(self.missing_left[branch], 0, len(self.features))
        limit = self.threshold[branch].clip(-FLOAT, FLOAT).astype(np.float32)
        above = limit > self.threshold[branch]  # by rounding, which would move points of that value
        limit[above] = np.nextafter(limit[above], np.float32(-np.inf))
        left = self.left[branch]
        hidden = ((np.uint64(1) << held[left].astype(np.uint64)) - np.uint64(1)) << before[
            left
        ].astype(np.uint64)
        kept = (~hidden & np.uint64(0xFFFFFFFF)).astype(np.uint32)
        own = self.tree[branch]
        begin = np.searchsorted(own, np.arange(len(roots) + 1))
        # Room for AT_ONCE branches at a time; nothing goes right of those that fill the rest.
        room = np.r_[0, np.cumsum(-(-np.diff(begin) // AT_ONCE) * AT_ONCE)]
        at, every = room[own] + np.arange(len(branch)) - begin[own], kernels.EVERY_LEAF
        filled = tuple(
            _placed(values, at, int(room[-1]), other)
            for values, other in ((row, 0), (limit, np.inf), (kept, every))
        )
        first = np.cumsum(held[roots]) - held[roots]
        values, leaf = np.empty(held[roots].sum()), np.flatnonzero(~inner)
        own = self.tree[leaf]
        values[first[own] + before[leaf]] = self.values[leaf, column[own]]
        return *filled, room, first, column, values

    def _columns(self, roots: Ints) -> Ints:
        """The only class to whose score each tree adds, -1 if there are several."""
        speaks = np.logical_or.reduceat(self.values != 0, roots, axis=0)
        return np.where(speaks.sum(axis=1) == 1, speaks.argmax(axis=1), -1)

    def table(self) -> Table:
        """The model as a table, as :meth:`of` reads it."""
        count, k = self.values.shape
        columns: dict[str, Any] = {
            "about": [json.dumps(self.about, sort_keys=True), *[""] * count],
            "tree": np.r_[LEAF, self.tree],
            "feature": np.r_[LEAF, self.feature],
            "threshold": np.r_[0.0, np.minimum(self.threshold, FAR)],
            "left": np.r_[LEAF, self.left],
            "right": np.r_[LEAF, self.right],
            "missing_left": np.r_[0, self.missing_left.astype(np.int64)],
        }
        columns |= {f"value_{j}": np.r_[0.0, self.values[:, j]] for j in range(k)}
        return Table(pd.DataFrame(columns))

    @classmethod
    def of(cls, table: Table) -> Trained:
        """Read a model from a table, and check all of it.

        Raises
        ------
        DataError
            The table holds no model, or one that would lead outside of its arrays.
        """
        frame, name = table.frame, table.name or "the table"
        if missing := [column for column in FIXED if column not in frame]:
            raise DataError(
                f"model: {name} is no model of classify.train: no column {missing[0]!r}"
            )
        if not 2 <= len(frame) <= MOST_NODES:
            raise DataError(f"model: {name} has {len(frame)} rows, from 2 to {MOST_NODES:,} can be")
        about = _about(str(frame["about"].iloc[0]), name)
        k = len(about["classes"])
        try:
            nodes = frame.iloc[1:]
            numbers = {c: nodes[c].to_numpy(np.int64) for c in ("tree", "feature", "left", "right")}
            floats = [
                nodes[c].to_numpy(float) for c in ("threshold", *(f"value_{j}" for j in range(k)))
            ]
            missing_left = nodes["missing_left"].to_numpy(float) > 0
        except (KeyError, ValueError, TypeError) as error:
            raise DataError(f"model: {name} is damaged: {error}") from error
        made = cls(
            about,
            **numbers,
            threshold=floats[0],
            missing_left=missing_left,
            values=np.column_stack(floats[1:]),
        )
        made._check(name)
        return made

    def _check(self, name: str) -> None:
        """Raise DataError unless all branches lead forward, within their tree and the arrays."""
        count, leaf = len(self.tree), self.feature == LEAF
        if not all(np.isfinite(part).all() for part in (self.threshold, self.values)):
            raise DataError(f"model: {name} is damaged: a number is missing or not finite")
        if self.about["kind"] == "logistic":
            if self.values.shape[0] != len(self.features):
                raise DataError(f"model: {name} is damaged: not one row for each feature")
            return
        inner = np.flatnonzero(~leaf)
        known = bool(((self.feature >= LEAF) & (self.feature < len(self.features))).all())
        for child in (self.left[inner], self.right[inner]):
            forward = bool(((child > inner) & (child < count)).all())
            known = known and forward and bool((self.tree[child] == self.tree[inner]).all())
        steps = np.diff(self.tree, prepend=-1)
        led_to = np.bincount(np.r_[self.left[inner], self.right[inner]].clip(0), minlength=count)
        known = known and bool((led_to[:count] == (steps == 0)).all())  # each node but roots once
        if not known or not np.isin(steps, (0, 1)).all():
            raise DataError(f"model: {name} is damaged: a branch leads to no node")


def problems(table: Table, cloud: PointCloud) -> Iterator[tuple[str, str]]:
    """What is wrong with a model for these points, as pairs of the parameter and a text."""
    try:
        made = Trained.of(table)
    except DataError as error:
        yield "model", str(error).removeprefix("model: ")
        return
    if text := names_of.problem(made.features, cloud):
        yield "points", text


def _about(text: str, name: str) -> Mapping[str, Any]:
    """What is known of a model, checked."""
    try:
        about = json.loads(text)
        if about["format"] != FORMAT:
            raise ValueError(
                f"it is of format {about['format']}, this version reads {FORMAT}: train anew"
            )
        _check_about(about)
    except (ValueError, TypeError, KeyError) as error:
        text = f"{name} is no model of classify.train, or damaged: {error}"
        raise DataError(f"model: {text}") from error
    return dict(about)


def _check_about(about: Mapping[str, Any]) -> None:
    """Raise ValueError, TypeError or KeyError unless all that a model says of itself fits."""
    classes, features = about["classes"], about["features"]
    k, f = len(classes), len(features)
    if about["kind"] not in KINDS or not 2 <= k <= MOST_CLASSES or not f:
        raise ValueError("its kind is unknown, or it has no classes or features")
    if classes != sorted({code for code in classes if type(code) is int and 0 <= code <= 255}):
        raise ValueError("its classes are no codes from 0 to 255")
    if not all(isinstance(feature, str) for feature in features):
        raise TypeError("its features are no names")
    shapes = {"temperature": (), "density": (), "baseline": (k,), "usual": (f,)}
    if about["kind"] == "logistic":
        shapes |= {"middle": (f,), "scale": (f,)}
    for key, shape in shapes.items():
        if np.shape(about[key]) != shape or not np.isfinite(np.array(about[key], float)).all():
            raise ValueError(f"{key} is not as many numbers as it should be")
    quantiles = np.array(about["quantiles"], float)
    if quantiles.ndim != 3 or quantiles.shape[:2] != (f, k) or not np.isfinite(quantiles).all():
        raise ValueError("its quantiles are not those of its features and classes")
    if about["temperature"] <= 0 or about["density"] < 0 or 0 in about.get("scale", ()):
        raise ValueError("a number that must be above zero is not")


def _placed(values: NDArray[Any], at: Ints, total: int, other: Any) -> NDArray[Any]:
    """An array of `total` items with values at some places, and another value elsewhere."""
    placed = np.full(total, other, values.dtype)
    placed[at] = values
    return placed


def softmax(scores: Floats) -> Floats:
    """Probabilities of shape (n, k) from scores.

    >>> softmax(np.array([[0.0, np.log(3)]])).round(2).tolist()
    [[0.25, 0.75]]
    """
    powers = np.exp(scores - scores.max(axis=1, keepdims=True))
    return np.asarray(powers / powers.sum(axis=1, keepdims=True))
