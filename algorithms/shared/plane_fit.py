"""The plane with the most points near it, and the best plane through these.

A search looks at a sample of the points that depends on the points alone, not on their order; so
its time does not grow with the cloud. The plane that it finds is then fitted to all points near it.
To find one plane after the other, search again among the points that are left.

References
----------
Fischler, M. A. and Bolles, R. C. (1981). Random sample consensus. Communications of the ACM 24(6),
381-395: RANSAC, and the number of trials.
Torr, P. H. S. and Zisserman, A. (2000). MLESAC. Computer Vision and Image Understanding 78(1),
138-156: MSAC, which looks at how near the points are, too.
Chum, O., Matas, J. and Kittler, J. (2003). Locally optimized RANSAC. DAGM 2003, 236-243: each
best plane so far is fitted to its points at once.
Pearson, K. (1901). On lines and planes of closest fit to systems of points in space.
Philosophical Magazine 2(11), 559-572.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.chance import random_keys
from algorithms.shared.kernels import plane_fit as kernels
from algorithms.shared.kernels.threads import in_blocks
from toolbox.context import QUIET, Context

SAMPLE = 100_000  # points that a search looks at
BATCH = 32  # trials between two updates of the number that is needed
BLOCK = 500_000  # points between two checks for cancellation
ROUNDS = 100  # of fitting, if the points near the plane go on changing
FLAT = 1e-9  # width of points on one line, as a share of their length
ULPS = 2.0**-50  # share of a coordinate by which rounding moves it, amply

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Plane:
    """A plane in space.

    Attributes
    ----------
    normal : array of shape (3,), of length 1
    centre : array of shape (3,), a position on the plane: the mean of the points it was fitted to
    origin : array of shape (3,), from which the centre is measured, so that no digits are lost

    Examples
    --------
    >>> roof = Plane(np.array([0, 0, 1.0]), np.array([0, 0, 5.0]), np.zeros(3))
    >>> roof.distances(np.array([[9, 9, 7], [9, 9, 4.0]])), roof.offset
    (array([ 2., -1.]), 5.0)
    """

    normal: Floats
    centre: Floats
    origin: Floats

    def distances(self, xyz: Floats) -> Floats:
        """Distances of points of shape (n, 3), positive on the side of the normal; shape (n,)."""
        away = np.zeros(len(xyz))
        for axis in range(3):
            near = (xyz[:, axis] - self.origin[axis]) - self.centre[axis]
            near *= self.normal[axis]
            away += near
        return away

    @property
    def offset(self) -> float:
        """Distance of the plane from the coordinate origin, along the normal."""
        return math.fsum(self.normal * self.centre) + math.fsum(self.normal * self.origin)

    def turned(self, axis: Floats) -> Plane:
        """The same plane with its normal turned to the side of an axis of shape (3,)."""
        if self.normal @ axis >= 0:
            return self
        return Plane(-self.normal, self.centre, self.origin)


@dataclass(frozen=True)
class Cone:
    """Allowed directions of normals: within an angle of an axis, in either sense.

    Attributes
    ----------
    axis : array of shape (3,), of length 1
    cosine : of the angle

    Examples
    --------
    >>> upright = Cone.of(np.array([0, 0, 9.0]), degrees=10)
    >>> upright.holds(np.array([[0, 0, -1], [1, 0, 0.0]]))
    array([ True, False])
    """

    axis: Floats
    cosine: float

    @classmethod
    def of(cls, axis: Floats, degrees: float) -> Cone:
        """Cone around an axis of any length."""
        return cls(axis / np.linalg.norm(axis), math.cos(math.radians(degrees)))

    def holds(self, normals: Floats) -> Mask:
        """True for allowed normals of shape (..., 3), with a tolerance for rounding."""
        return np.asarray(np.abs(normals @ self.axis) >= self.cosine - 1e-12)


@dataclass(frozen=True)
class Fit:
    """A plane fitted to all points within a distance.

    Attributes
    ----------
    plane : that is best for them
    settled : whether the same points were near the plane again at the end

    Examples
    --------
    >>> level = Plane(np.array([0, 0, 1.0]), np.zeros(3), np.zeros(3))
    >>> xyz = np.array([[0, 0, 0.1], [9, 0, 0.1], [0, 9, 0.1], [9, 9, 0.1]])
    >>> fit(xyz, level, limit=0.5).settled
    True
    """

    plane: Plane
    settled: bool


def trials_needed(share: float, confidence: float) -> float:
    """Number of trials until three points of the plane are drawn at once, with a confidence.

    N = log(1 - p) / log(1 - w**3), where w = 1 - e is the share of points on the plane.

    Examples
    --------
    >>> [round(trials_needed(w, 0.99), 1) for w in (0.9, 0.5, 0.2)]
    [3.5, 34.5, 573.3]
    """
    hit = share**3
    if hit >= 1:
        return 1.0
    return math.inf if hit <= 0 else math.log1p(-confidence) / math.log1p(-hit)


def sample(xyz: Floats, seed: int, size: int = SAMPLE) -> Floats:
    """A sample of points, array of shape (m, 3), that does not depend on their order.

    Examples
    --------
    >>> sample(np.array([[2, 0, 0], [1, 0, 0.0]]), seed=0, size=9).shape
    (2, 3)
    """
    points = xyz
    if len(points) > size:
        points = points[np.argpartition(random_keys(points, seed), size)[:size]]
    return points[np.lexsort(points.T)]


def is_line(xyz: Floats) -> bool:
    """Whether points of shape (n, 3) are collinear or equal, within rounding.

    Examples
    --------
    >>> is_line(np.array([[0, 0, 0], [1, 1, 1], [3, 3, 3.0]]))
    True
    """
    if len(xyz) < 3:
        return True
    near = xyz - xyz[0]
    far = near[int(np.argmax((near * near).sum(axis=1)))]
    long = float(np.linalg.norm(far))
    if long == 0:
        return True
    wide = float(np.linalg.norm(np.cross(near, far / long), axis=1).max())
    return wide <= FLAT * long + ULPS * float(np.abs(xyz).max())


def search(
    points: Floats,
    limit: float,
    *,
    cone: Cone | None = None,
    confidence: float = 0.99,
    max_trials: int = 10_000,
    seed: int = 0,
    ctx: Context = QUIET,
) -> tuple[Plane | None, int]:
    """The plane with the highest MSAC score, from random trials.

    Three points make a trial. After each batch of trials their number is worked out anew from the
    best plane so far.

    Parameters
    ----------
    points : array of shape (m, 3), in an order that does not depend on chance; see :func:`sample`
    limit : largest distance of a point that supports a plane, in the unit of the points
    cone : normals that are allowed
    confidence : probability of having drawn three points of the plane
    max_trials : give up after so many
    seed : of the draws
    ctx : progress and cancellation

    Returns
    -------
    plane : None if no three points make one that is allowed
    trials : that were made

    Examples
    --------
    >>> xyz = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [9, 9, 0], [5, 5, 7.0]])
    >>> plane, _ = search(xyz, limit=0.5)
    >>> abs(plane.normal).round(6).tolist()
    [0.0, 0.0, 1.0]
    """
    origin = points[0].copy()
    near = points - origin
    sides = np.ascontiguousarray(near.T)
    rng = np.random.default_rng(seed)
    best, best_gain, trials, needed = None, 0.0, 0, float(max_trials)
    while trials < min(needed, max_trials):
        size = min(BATCH, max_trials - trials)
        planes = _planes(near[rng.integers(len(near), size=(size, 3))], cone)
        gains, counts = _scores(sides, planes, limit)
        winner = int(np.argmax(gains))
        if gains[winner] > best_gain:
            normal, offset = planes[winner, :3], planes[winner, 3]
            best, best_gain, count = (
                Plane(normal, normal * offset, origin),
                gains[winner],
                counts[winner],
            )
            if fitted := fit(points, best, limit, cone=cone):
                normal, centre = fitted.plane.normal, fitted.plane.centre
                row = np.array([[*normal, normal @ centre]])
                gain, number = _scores(sides, row, limit)
                if gain[0] > best_gain:  # else the fit has led away
                    best, best_gain, count = fitted.plane, gain[0], number[0]
            needed = trials_needed(count / len(near), confidence)
        trials += size
        ctx.progress(trials / max_trials)
    return best, trials


def _planes(corners: Floats, cone: Cone | None) -> Floats:
    """Normals and offsets of planes through three points each; NaN where not defined or allowed.

    Parameters
    ----------
    corners : array of shape (k, 3, 3)

    Returns
    -------
    array of shape (k, 4)
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    longest = np.maximum(np.linalg.norm(b - a, axis=1), np.linalg.norm(c - a, axis=1))
    good = area > FLAT * longest**2
    normal[good] /= area[good, None]
    if cone:
        good &= cone.holds(normal)
    planes = np.column_stack([normal, (normal * a).sum(axis=1)])
    planes[~good] = np.nan
    return planes


def _scores(sides: Floats, planes: Floats, limit: float) -> tuple[Floats, NDArray[np.int64]]:
    """MSAC scores of planes of shape (k, 4), and the number of points of shape (3, n) near each."""
    gains, counts = np.zeros(len(planes)), np.zeros(len(planes), np.int64)

    def work(first: int, last: int) -> None:
        kernels.score(first, last, sides, planes, limit, gains, counts)

    in_blocks(work, len(planes), BATCH // 4)
    return gains, counts


def fit(
    xyz: Floats, plane: Plane, limit: float, *, cone: Cone | None = None, ctx: Context = QUIET
) -> Fit | None:
    """The least-squares plane through the points near a plane, refined until these stay the same.

    It begins with a plane, is fitted to the points within the limit, and again until these stay
    the same. If it would leave the cone, the last plane within it is taken.

    Parameters
    ----------
    xyz : array of shape (n, 3); their order does not matter
    plane : to begin with
    limit : largest distance, in the unit of xyz
    cone : normals that are allowed
    ctx : progress and cancellation

    Returns
    -------
    None if the points near the plane are on a line

    Examples
    --------
    >>> level = Plane(np.array([0, 0, 1.0]), np.zeros(3), np.zeros(3))
    >>> xyz = np.array([[0, 0, 0.2], [9, 0, 0.2], [0, 9, 0.2], [9, 9, 0.2], [5, 5, 7.0]])
    >>> fit(xyz, level, limit=0.5).plane.offset
    0.2
    """
    points = np.ascontiguousarray(xyz).view()
    points.flags.writeable = False  # the kernel is compiled for such arrays alone
    made, before = None, None
    for done in range(ROUNDS):
        ctx.progress(done / ROUNDS)
        sums = _moments(points, plane, limit)
        count, shift, spread = int(sums[0]), sums[1:4], sums[4:]
        if count < 3:
            return made
        mean = shift / count
        matrix = spread[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3) / count - np.outer(mean, mean)
        values, vectors = np.linalg.eigh(matrix)
        far = float(np.abs(plane.origin).max()) + float(np.abs(plane.centre).max())
        if math.sqrt(max(values[1], 0)) <= FLAT * math.sqrt(max(values[2], 0)) + ULPS * far:
            return made
        new = Plane(vectors[:, 0], plane.centre + mean, plane.origin).turned(plane.normal)
        if cone and not cone.holds(new.normal):
            return made
        settled = before is not None and np.array_equal(sums[0:1], before[0:1])
        settled = settled and bool(np.abs(new.normal - plane.normal).max() <= 1e-12)
        plane, before = new, sums
        made = Fit(plane, settled)
        if settled:
            break
    return made


def _moments(xyz: Floats, plane: Plane, limit: float) -> Floats:
    """Sums over the points near a plane, array of shape (10,); see the kernel."""
    sums = np.zeros((max(1, -(-len(xyz) // BLOCK)), 2, 10))

    def work(first: int, last: int) -> None:
        kernels.moments(
            first, last, xyz, plane.origin, plane.normal, plane.centre, limit, BLOCK, sums
        )

    in_blocks(work, len(xyz), BLOCK)
    return np.array([math.fsum(sums[:, :, k].ravel()) for k in range(10)])
