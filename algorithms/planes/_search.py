"""Patches of planes from a cloud, one after the other: RANSAC among the cells of an octree.

Three cells are drawn from one cell of the octree of any size, since points that are near each other
are likely to be on one plane. The plane through their centres must agree with their normals. It is
scored by all cells near it whose normals agree. How many must be drawn follows from the chance that
one draw hits the best plane so far, which is found from its cells. Planes that were drawn are kept:
when the best one is taken out, the others have lost no more than the cells that are gone.

References
----------
Fischler, M. A. and Bolles, R. C. (1981). Random sample consensus. Communications of the ACM 24(6),
381-395: RANSAC and the number of draws.
Schnabel, R., Wahl, R. and Klein, R. (2007). Efficient RANSAC for point-cloud shape detection.
Computer Graphics Forum 26(2), 214-226: local draws, normals, patches, planes that are kept.
Torr, P. H. S. and Zisserman, A. (2000). MLESAC. Computer Vision and Image Understanding 78(1),
138-156: nearer points count more (MSAC).
Minoux, M. (1978). Accelerated greedy algorithms for maximizing submodular set functions. Lecture
Notes in Control and Information Sciences 7, 234-243: scores that only fall are looked at late.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.planes import _search_kernels as kernels
from algorithms.planes._cells import Cells
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context

Orientation = Literal["any", "vertical", "horizontal", "sloped"]

BATCH = 256  # draws between two checks whether they are enough
SOME = 200  # cells from which the chance of a draw is found
ROUNDS = 10  # of fitting a plane to its cells
LEAST = 0.5  # share of the fewest points of a plane that lie in flat cells that face its way
FITS = 3  # of a patch to its points
ALIKE = math.cos(math.radians(3.0))  # of the angle between planes that are almost the same

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Rules:
    """Conditions that a plane must meet; lengths in the unit of the points.

    Attributes
    ----------
    tolerance : largest distance of a point from its plane
    angle : largest between the plane and the normals of its points, radians
    gap : squares of this side with points hang together if they touch
    min_points : in a plane
    min_extent : shorter side of a plane
    steep : least and largest size of the third part of the normal
    connected : whether a plane is one patch
    confidence : probability that the best plane was drawn
    max_trials : draws in all
    seed : of the draws
    centres : largest distance of the centre of a cell from its plane, over that of a point
    """

    tolerance: float
    angle: float
    gap: float
    min_points: int
    min_extent: float
    steep: tuple[float, float] = (0.0, 1.0)
    connected: bool = True
    confidence: float = 0.99
    max_trials: int = 1_000_000
    seed: int = 0
    centres: float = 1.0


@dataclass(frozen=True)
class Patch:
    """A connected piece of a plane.

    Attributes
    ----------
    plane : array of shape (4,), normal and offset from the origin of the cells
    axes : array of shape (2, 3), along the plane
    squares : sorted numbers of the squares of a grid on it that hold its points
    spread : standard deviation of its points about it; the same of all while not known
    """

    plane: Floats
    axes: Floats
    squares: Ints
    spread: float = 1.0

    @cached_property
    def wider(self) -> Ints:
        """The squares of the patch and all squares that touch them, sorted."""
        row, column = (1 << 31) * np.array([-1, 0, 1])[:, None], np.array([-1, 0, 1])
        return np.unique(self.squares + (row + column).reshape(-1, 1))

    def moved(self, plane: Floats, spread: float) -> Patch:
        """The same patch with a refined plane."""
        made = replace(self, plane=plane, spread=spread)
        made.__dict__["wider"] = self.wider
        return made

    def over(self, xyz: Floats, gap: float) -> NDArray[np.bool_]:
        """Which points of shape (n, 3) lie over the patch."""
        return np.asarray(kernels.over(xyz, self.axes, gap, self.squares))


@dataclass
class Search:
    """The search that takes one patch after the other out of the cells.

    Attributes
    ----------
    whole : whether the points of a cell hang together; in large cells of few points they may not
    """

    cells: Cells
    rules: Rules
    whole: bool = True
    weights: Floats = field(init=False)
    planes: Floats = field(default_factory=lambda: np.empty((0, 4)))
    gains: Floats = field(default_factory=lambda: np.empty(0))
    scored: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    taken: int = 0
    trials: int = 0

    def __post_init__(self) -> None:
        cells = self.cells
        self.counts = cells.counts.copy()
        self.weights = np.where(cells.flat, self.counts, 0.0)
        self.free = np.ones(len(cells.xyz), bool)
        self.group = kernels.boxes(cells.reach)
        self.rng = np.random.default_rng(self.rules.seed)
        self.cosine = math.cos(self.rules.angle)
        self.near = self.rules.centres * self.rules.tolerance
        self.least = (LEAST if self.whole else 1.0) * self.rules.min_points
        self.worth = 0.0  # draws so far, each counted by the points that were there in its time

    def patches(self, ctx: Context = QUIET) -> list[Patch]:
        """All patches, in the order in which they are found."""
        found: list[Patch] = []
        whole = max(self.weights.sum(), 1.0)
        while self.weights.sum() >= self.rules.min_points and self.trials < self.rules.max_trials:
            ctx.progress(1.0 - self.weights.sum() / whole)
            self._draw()
            while (best := self._best()) is not None:
                cells, plane = self._grown(self.planes[best])
                if self.weights[cells].sum() < self.least:
                    self.gains[best] = 0.0
                    self._forget(plane, self.cells.centres[cells].mean(axis=0))
                    continue
                if self.worth < self._needed(cells):
                    break
                self.gains[best] = 0.0
                if (patch := self._patch(cells, plane)) is not None:
                    self._take(patch)
                    found.append(patch)
            if best is None and self.worth >= self._needed_for_least():
                break
        ctx.progress(1.0)
        return found

    def _draw(self) -> None:
        """Draw further planes, and score them."""
        cells, rules = self.cells, self.rules
        size = min(BATCH, rules.max_trials - self.trials)
        planes = np.empty((size, 4))
        running = np.cumsum(self.weights)
        kernels.draw(
            self.rng.random((size, 4)),
            running,
            cells.keys,
            cells.levels,
            cells.centres,
            cells.normals,
            self.weights,
            self.cosine,
            np.array(rules.steep),
            planes,
        )
        self.trials += size
        self.worth += size / running[-1]
        planes = planes[~np.isnan(planes[:, 0])]
        gains = self._scores(planes)
        if len(planes) and gains.max() > self.gains.max(initial=0.0):
            _, better = self._grown(planes[np.argmax(gains)])
            planes = np.vstack([planes, better])
            gains = np.append(gains, self._scores(better[None]))
        good = gains >= self.rules.min_points / 3  # points spread evenly count two thirds
        self.planes = np.vstack([self.planes, planes[good]])
        self.gains = np.append(self.gains, gains[good])
        self.scored = np.append(self.scored, np.full(good.sum(), self.taken))

    def _scores(self, planes: Floats) -> Floats:
        gains = np.empty(len(planes))
        cells = self.cells

        def work(first: int, last: int) -> None:
            kernels.score(
                first,
                last,
                planes,
                cells.centres,
                cells.normals,
                self.weights,
                self.group,
                self.near,
                self.cosine,
                gains,
            )

        in_blocks(work, len(planes), 32)
        return gains

    def _best(self) -> int | None:
        """Index of the plane with the highest score; planes with too low scores are dropped."""
        while len(self.gains):
            best = int(np.argmax(self.gains))
            if self.gains[best] < self.rules.min_points / 3:
                keep = self.gains >= self.rules.min_points / 3
                self.planes, self.gains = self.planes[keep], self.gains[keep]
                self.scored = self.scored[keep]
                return None
            if self.scored[best] == self.taken:
                return best
            old = np.flatnonzero(self.scored < self.taken)
            some = old[np.argsort(-self.gains[old], kind="stable")[:64]]
            self.gains[some] = self._scores(self.planes[some])
            self.scored[some] = self.taken
        return None

    def _support(self, plane: Floats) -> Ints:
        """Indices of the cells that support a plane."""
        cells, found = self.cells, np.empty(len(self.weights), np.int64)
        count = kernels.support(
            plane,
            cells.centres,
            cells.normals,
            self.weights,
            self.group,
            self.near,
            self.cosine,
            found,
        )
        return found[:count].copy()

    def _grown(self, plane: Floats) -> tuple[Ints, Floats]:
        """A plane refitted to its cells until these no longer change; the cells and the plane."""
        cells = self._support(plane)
        for _ in range(ROUNDS):
            if len(cells) < 3:
                break
            better = _through(self.cells.centres[cells], self.weights[cells])
            if better is None or not self._allowed(better):
                break
            more = self._support(better)
            if self.weights[more].sum() < self.weights[cells].sum():
                break
            same = np.array_equal(more, cells)
            plane, cells = better, more
            if same:
                break
        return cells, plane

    def _allowed(self, plane: Floats) -> bool:
        low, high = self.rules.steep
        return bool(low <= abs(plane[2]) <= high)

    def _needed(self, cells: Ints) -> float:
        """Draws needed to find a plane with these cells with the confidence, counted as `worth`."""
        some = cells
        if len(cells) > SOME:
            some = cells[np.linspace(0, len(cells) - 1, SOME).astype(np.int64)]
        all_cells = self.cells
        hit = kernels.hits(some, cells, all_cells.keys, all_cells.levels, self.weights, cells)
        return -math.log1p(-self.rules.confidence) / max(
            float(hit * self.weights[cells].sum()), 1e-300
        )

    def _needed_for_least(self) -> float:
        """The same for the smallest plane allowed, with a quarter for the chance `kernels.hits`."""
        return -math.log1p(-self.rules.confidence) / (0.25 * self.rules.min_points)

    def _patch(self, cells: Ints, plane: Floats) -> Patch | None:
        """The largest connected piece of a plane, fitted to its points; None if it is too small."""
        for _ in range(FITS):
            if (piece := self._piece(cells, plane)) is None:
                return None
            cells, squares, axes = piece
            sums, middle = self._sums(cells, plane)
            if sums[0] < self.least:
                self._forget(plane, middle)
                return None
            better = plane_of(sums, middle, plane[:3])
            if better is None or not self._allowed(better):
                return None
            patch = Patch(plane, axes, squares)
            plane, cells = better, self._support(better)
        if sums[0] < self.rules.min_points and self._count(patch) < self.rules.min_points:
            self._forget(plane, middle)
            return None
        return patch

    def _count(self, patch: Patch) -> int:
        """Number of the free points of a patch, in all cells."""
        cells, rules = self.cells, self.rules
        return int(
            kernels.near(
                patch.plane,
                patch.axes,
                rules.tolerance,
                rules.gap,
                patch.squares,
                cells.xyz,
                cells.starts,
                cells.reach,
                self.group,
                self.free,
            )
        )

    def _forget(self, plane: Floats, middle: Floats) -> None:
        """Drop planes nearly equal to one whose piece, around `middle`, was too small."""
        alike = np.abs(self.planes[:, :3] @ plane[:3]) >= ALIKE
        away = np.abs(self.planes[:, :3] @ middle - self.planes[:, 3])
        self.gains[alike & (away < self.rules.tolerance)] = 0.0

    def _piece(self, cells: Ints, plane: Floats) -> tuple[Ints, Ints, Floats] | None:
        """Cells, squares and axes of the largest piece of a plane; None if it has no points."""
        if not len(cells):
            return None
        all_cells, rules = self.cells, self.rules
        axes = axes_of(plane[:3])
        size = int(all_cells.counts[cells].sum())
        keys, owner = np.empty(size, np.int64), np.empty(size, np.int64)
        count = kernels.squares(
            cells,
            all_cells.xyz,
            all_cells.starts,
            self.free,
            plane,
            axes,
            rules.tolerance,
            rules.gap,
            keys,
            owner,
        )
        if not count:
            return None
        squares, place = np.unique(keys[:count], return_inverse=True)
        owner = owner[:count]
        if not rules.connected:
            return cells[np.unique(owner)], squares, axes
        next_of = np.flatnonzero((owner[1:] == owner[:-1]) & self.whole)
        piece = kernels.pieces(squares, np.column_stack([place[next_of], place[next_of + 1]]))
        # A cell is of the piece of its first square.
        first_of = np.unique(owner, return_index=True)
        cell_piece = piece[place[first_of[1]]]
        weight = np.bincount(cell_piece, self.weights[cells[first_of[0]]], minlength=len(squares))
        largest = int(np.argmax(weight))
        return cells[first_of[0][cell_piece == largest]], squares[piece == largest], axes

    def _sums(self, cells: Ints, plane: Floats) -> tuple[Floats, Floats]:
        found, middle = np.empty(10), self.cells.centres[cells].mean(axis=0)
        kernels.sums(
            cells,
            self.cells.xyz,
            self.cells.starts,
            self.free,
            plane,
            middle,
            self.rules.tolerance,
            found,
        )
        return found, middle

    def _take(self, patch: Patch) -> None:
        cells, rules = self.cells, self.rules
        kernels.take(
            patch.plane,
            patch.axes,
            1.5 * rules.tolerance,
            rules.gap,
            patch.wider,
            cells.xyz,
            cells.starts,
            cells.reach,
            self.group,
            self.free,
            self.weights,
            self.counts,
        )
        self.weights[~self.cells.flat] = 0.0
        self.taken += 1


def plane_of(sums: Floats, middle: Floats, normal: Floats) -> Floats | None:
    """Plane from sums over points, see the kernel; None if the points are on a line.

    Parameters
    ----------
    sums : array of shape (10,)
    middle : array of shape (3,), from which they are measured
    normal : to the side of which that of the plane shall point
    """
    count = sums[0]
    if count < 3:
        return None
    mean = sums[1:4] / count
    matrix = sums[[4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(3, 3) / count - np.outer(mean, mean)
    values, vectors = np.linalg.eigh(matrix)
    if values[1] <= 1e-12 * values[2]:
        return None
    axis = vectors[:, 0] if vectors[:, 0] @ normal >= 0 else -vectors[:, 0]
    return np.array([*axis, axis @ (mean + middle)])


def _through(places: Floats, weights: Floats) -> Floats | None:
    """Least-squares plane through weighted points of shape (k, 3); None if they are on a line."""
    middle = places.mean(axis=0)
    near = places - middle
    moved = near * weights[:, None]
    second = (moved.T @ near)[np.triu_indices(3)]
    return plane_of(np.array([weights.sum(), *moved.sum(axis=0), *second]), middle, near[0])


def axes_of(normal: Floats) -> Floats:
    """Two unit vectors along a plane at right angles: horizontal, and upwards; shape (2, 3)."""
    along = np.array([-normal[1], normal[0], 0.0])
    length = math.hypot(*along)
    along = np.array([1.0, 0.0, 0.0]) if length < 1e-9 else along / length
    x, y, z = normal
    up = np.array([-z * along[1], z * along[0], x * along[1] - y * along[0]])
    return np.array([along, up if up[2] >= 0 else -up])


def steepness(orientation: Orientation, degrees: float) -> tuple[float, float]:
    """Limits of the absolute z component of the normals of planes with an orientation."""
    upright, level = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    limits = {"any": (0.0, 1.0), "vertical": (0.0, upright), "horizontal": (level, 1.0)}
    return limits.get(orientation, (upright, level))
