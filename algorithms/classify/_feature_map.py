"""Maps of features: trained, named, split, kept in a table, and applied to points.

A map is a table: a row for each neuron, with its position on the lattice, its class, its weights in
the unit of each feature, and the lowest and highest values and the weight by which features are
made comparable. All that is known of a map stands there, so that a map from a file does what the
map did that was trained.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from algorithms.classify import _som as som
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context
from toolbox.data import Lattice, PointCloud, Raster, Table
from toolbox.errors import DataError

UNKNOWN = 1  # class of points that lack a feature
BLOCK = 200_000  # points between two checks for cancellation
NO_NEURON = -1  # neuron of a point without features
PIXEL = 0.1  # of pictures, in steps of the lattice
GAP = 1.0  # between pictures
LENGTHS = ("radius", "context")  # columns in metres

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class FeatureMap:
    """Neurons with their weights and classes; those of the first stage come first.

    Attributes
    ----------
    names : of the f features
    low, high, weight : array of shape (f,); a feature counts as weight * (value - low) / (high -
        low), and as 0 if it was the same everywhere
    values : array of shape (k, f), of the neurons, in the unit of the features
    place : array of shape (k, 2), on the lattice
    parent : array of shape (k,), the neuron of the first stage that a neuron of the second is part
        of; NO_NEURON for those of the first
    classes : array of shape (k,)
    points : array of shape (k,), how many points trained the neuron
    astray : array of shape (k,), the share of those that are known to be of another class
    radius, context : in metres, in which features were made
    """

    names: tuple[str, ...]
    low: Floats
    high: Floats
    weight: Floats
    values: Floats
    place: Floats
    parent: Ints
    classes: Bytes
    points: Ints
    astray: Floats
    radius: float
    context: float

    def comparable(self, values: Floats) -> Floats:
        """Features of shape (n, f) brought to the scale in which distances are measured."""
        extent = self.high - self.low
        factor = np.divide(self.weight, extent, out=np.zeros_like(extent), where=extent > 0)
        return np.ascontiguousarray((values - self.low) * factor)

    @property
    def first_stage(self) -> Ints:
        """Indices of the neurons of the first stage, which are on the lattice."""
        return np.flatnonzero(self.parent == NO_NEURON)

    @property
    def leaves(self) -> NDArray[np.bool_]:
        """True for the neurons that are not split; points are assigned to these only."""
        return ~np.isin(np.arange(len(self.parent)), self.parent)

    def stage_one(self, values: Floats, ctx: Context = QUIET) -> som.Winners:
        """The nearest neurons of the first stage to features of shape (n, f)."""
        neurons = self.comparable(self.values)[self.first_stage]
        return som.winners(self.comparable(values), neurons, ctx)

    def neurons(self, values: Floats, ctx: Context = QUIET) -> tuple[Ints, Floats]:
        """The neuron of each point with features of shape (n, f), and how far from it the point is.

        NO_NEURON and NaN where a feature is NaN.
        """
        best, away = np.full(len(values), NO_NEURON), np.full(len(values), np.nan)

        def find(first: int, last: int) -> None:
            best[first:last], away[first:last] = self._neurons(values[first:last])

        in_blocks(find, len(values), BLOCK, ctx)
        return best, away

    def _neurons(self, values: Floats) -> tuple[Ints, Floats]:
        best, away = np.full(len(values), NO_NEURON), np.full(len(values), np.nan)
        known = np.isfinite(values).all(axis=1)
        found = self.stage_one(values[known])
        best[known], away[known] = found.best, found.distance
        for parent in np.unique(self.parent[self.parent != NO_NEURON]):
            members, parts = np.flatnonzero(best == parent), np.flatnonzero(self.parent == parent)
            within = self.comparable(self.values)[parts]
            found = som.winners(self.comparable(values[members]), within)
            best[members], away[members] = parts[found.best], found.distance
        return best, away

    def table(self) -> Table:
        """The map as a table."""
        first = self.first_stage
        heights = np.full(len(self.values), np.nan)
        heights[first] = som.u_matrix(self.comparable(self.values)[first], self.place[first])
        frame = pd.DataFrame({"neuron": np.arange(len(self.values))})
        frame["parent"] = pd.array(self.parent, "Int64")
        frame.loc[first, "parent"] = pd.NA
        frame["class"] = self.classes.astype(np.int64)
        frame["points"] = self.points
        frame["astray"] = self.astray
        frame["u_matrix"] = heights
        frame["east"], frame["north"] = self.place.T
        for k, name in enumerate(self.names):
            frame[name] = self.values[:, k]
            for part, numbers in (("low", self.low), ("high", self.high), ("weight", self.weight)):
                frame[f"{name}_{part}"] = numbers[k]
        frame["radius"], frame["context"] = self.radius, self.context
        return Table(frame)

    @classmethod
    def of(cls, table: Table) -> FeatureMap:
        """The map that a table holds.

        Raises
        ------
        DataError
            It is no such table.
        """
        frame = table.frame
        names = tuple(c[: -len("_weight")] for c in frame.columns if c.endswith("_weight"))
        needed = ["neuron", "parent", "class", "points", "astray", "east", "north", *LENGTHS]
        needed += [name + part for name in names for part in ("", "_low", "_high")]
        if missing := [c for c in needed if c not in frame.columns] or (
            ["..._weight"] * (not names)
        ):
            raise DataError(f"map: {table.name} is no map of classify.som: no column {missing[0]}")
        numbers = frame[[*needed, *(f"{name}_weight" for name in names)]]
        numbers = numbers.apply(pd.to_numeric, errors="coerce").astype(float)
        if text := next(_map_problems(numbers, frame["parent"].notna(), names), ""):
            raise DataError(f"map: {table.name} {text}")
        parent = numbers["parent"].fillna(NO_NEURON).to_numpy().astype(np.int64)

        def once(part: str) -> Floats:
            return np.array([numbers[name + part].iloc[0] for name in names])

        return cls(
            names,
            once("_low"),
            once("_high"),
            once("_weight"),
            numbers[list(names)].to_numpy(),
            numbers[["east", "north"]].to_numpy(),
            parent,
            numbers["class"].to_numpy().astype(np.uint8),
            numbers["points"].to_numpy().astype(np.int64),
            numbers["astray"].to_numpy(),
            float(numbers["radius"].iloc[0]),
            float(numbers["context"].iloc[0]),
        )

    def planes(self) -> Raster:
        """Pictures of the lattice side by side: the U-matrix, and each feature from 0 to 1."""
        first = self.first_stage
        place, values = self.place[first], self.comparable(self.values)[first]
        shown = [som.u_matrix(values, place), *values.T]
        low, high = place.min(axis=0) - 0.6, place.max(axis=0) + 0.6
        width, height = high - low
        size = np.array([len(shown) * (width + GAP) - GAP, height])
        lattice = Lattice.cover((0.0, 0.0, *size), PIXEL)
        x, y = np.meshgrid(*lattice.centres())
        panel, inside = np.divmod(x, width + GAP)
        pixels = np.stack([inside + low[0], high[1] - y], axis=-1)  # the first row on top
        away, nearest = map(np.asarray, cKDTree(place).query(pixels))
        picture = np.full(x.shape, np.nan, np.float32)
        for number, numbers in enumerate(shown):
            here = (panel == number) & (away < 0.62)
            extent = np.ptp(numbers)
            level = (numbers - numbers.min()) / extent if extent > 0 else np.zeros(len(numbers))
            picture[here] = level[nearest[here]]
        title = "u-matrix, " + ", ".join(self.names)
        return Raster.from_lattice(picture, lattice, crs=None, descriptions=(title,), units=("1",))


def _map_problems(
    numbers: pd.DataFrame, has_parent: pd.Series[bool], names: tuple[str, ...]
) -> Iterator[str]:
    """Problems with the columns of a map, which people may have edited.

    Stop at the first one: those after it may be wrong.
    """
    number = np.arange(len(numbers))
    cells = numbers.drop(columns=["parent", "astray"]).to_numpy()
    if not len(numbers) or not np.isfinite(cells).all():
        yield "has no rows, or cells that are no numbers"
    if (numbers["neuron"] != number).any():
        yield "must have all its rows, in the order of the column neuron"
    for value in numbers["class"][~numbers["class"].isin(range(256))]:
        yield f"must have whole numbers from 0 to 255 as class, got {value:g}"
    if not numbers["parent"][has_parent].isin(number[~has_parent]).all():
        yield "has parents that are no neurons of the first stage"
    for name in [n + part for n in names for part in ("_low", "_high", "_weight")] + [*LENGTHS]:
        if numbers[name].nunique() > 1:
            yield f"must have the same {name} in all rows"
    one = numbers.iloc[0]
    if one["radius"] <= 0 or one["context"] < 0:
        yield "must have a radius above 0 and a context of at least 0"
    for name in names:
        if one[f"{name}_weight"] <= 0 or one[f"{name}_high"] < one[f"{name}_low"]:
            yield f"must have a weight above 0, and a range, for {name}"


def trained(
    values: Floats,
    template: FeatureMap,
    lattice: tuple[int, int, som.Shape],
    how: som.Training,
    ctx: Context = QUIET,
) -> FeatureMap:
    """The map with neurons trained on features of shape (n, f), still without classes.

    Parameters
    ----------
    lattice : rows, columns and shape
    """
    place = som.places(*lattice)
    weights = som.train(template.comparable(values), place, how, ctx)
    return replace(
        template,
        values=_in_units(weights, template),
        place=place,
        parent=np.full(len(place), NO_NEURON),
        classes=np.zeros(len(place), np.uint8),
        points=np.zeros(len(place), np.int64),
        astray=np.zeros(len(place)),
    )


def _in_units(weights: Floats, template: FeatureMap) -> Floats:
    """Weights of neurons, converted to the unit of each feature."""
    extent = (template.high - template.low) / np.where(template.weight > 0, template.weight, 1.0)
    return np.asarray(template.low + weights * extent)


def named(made: FeatureMap, best: Ints, known: Bytes) -> FeatureMap:
    """The map with a class for each neuron: that of most of its points of known class.

    A neuron without such a point takes the class of the nearest that has one.

    Parameters
    ----------
    best : array of shape (n,), the neuron of each point
    known : array of shape (n,), the class of each point as far as it is known, or 0
    """
    size = len(made.values)
    votes = np.zeros((size, 256), np.int64)
    np.add.at(votes, (best[known > 0], known[known > 0]), 1)
    total = votes.sum(axis=1)
    classes = votes.argmax(axis=1).astype(np.uint8)
    weights, heard = made.comparable(made.values), np.flatnonzero(total > 0)
    for silent in np.flatnonzero(total == 0):
        away = np.linalg.norm(weights[heard] - weights[silent], axis=1)
        classes[silent] = classes[heard[away.argmin()]]
    astray = 1.0 - votes.max(axis=1) / np.maximum(total, 1)
    astray[total == 0] = 0.0
    return replace(made, classes=classes, astray=astray, points=np.bincount(best, minlength=size))


def split(
    made: FeatureMap,
    values: Floats,
    best: Ints,
    tolerance: float,
    parts: int,
    how: som.Training,
    ctx: Context = QUIET,
) -> FeatureMap:
    """The map in which clusters of mixed classes are split by small maps of their own.

    Parameters
    ----------
    values, best : features and neurons of the points
    tolerance : share of points astray that is too many
    parts : neurons in a row, that a cluster is split into
    """
    mixed = np.flatnonzero(made.astray > tolerance)
    for done, cluster in enumerate(mixed):
        members = values[best == cluster]
        if len(members) < parts:
            continue
        part = ctx.part(done / len(mixed), (done + 1) / len(mixed))
        small = trained(members, made, (parts, 1, "square"), how, part)
        made = replace(
            made,
            values=np.vstack([made.values, small.values]),
            place=np.vstack([made.place, np.tile(made.place[cluster], (parts, 1))]),
            parent=np.append(made.parent, np.full(parts, cluster)),
            classes=np.append(made.classes, small.classes),
            points=np.append(made.points, small.points),
            astray=np.append(made.astray, small.astray),
        )
    return made


def with_classes(
    cloud: PointCloud, part: NDArray[np.bool_], made: FeatureMap, best: Ints, away: Floats
) -> PointCloud:
    """The cloud in which the points that take part have the classes of their neurons.

    Parameters
    ----------
    part : array of shape (n,), true for the m points that take part
    best, away : arrays of shape (m,), the neuron of each and the distance from it
    """
    classes = np.array(
        cloud["classification"] if "classification" in cloud else np.zeros(len(part))
    )
    classes = classes.astype(np.uint8)
    neuron, confidence = np.full(len(part), NO_NEURON, np.int16), np.zeros(len(part), np.float32)
    distance = np.full(len(part), np.nan, np.float32)
    found = best != NO_NEURON
    classes[part] = np.where(found, made.classes[best], UNKNOWN)
    neuron[part] = best
    confidence[part] = np.where(found, 1.0 - made.astray[best], 0.0)
    distance[part] = away
    return cloud.with_attributes(
        {
            "classification": classes,
            "neuron": neuron,
            "confidence": confidence,
            "neuron_distance": distance,
        },
        descriptions={
            "neuron": "of the self-organising map",
            "confidence": "share of its cluster that agrees",
            "neuron_distance": "weighted: how unlike its neuron",
        },
    )
