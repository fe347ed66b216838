"""Covariance features of the neighbourhoods of points: linear, planar, vertical, rough, ...

The coordinates of a point and its neighbours have a covariance matrix. Its eigenvalues l1 >= l2 >=
l3 are the variances along three axes square to each other; the last axis is the normal.

References
----------
Demantké, J. et al. (2011). Dimensionality based scale selection in 3D lidar point clouds. ISPRS
Archives 38(5/W12), 97-102: linear, planar and scattered neighbourhoods.
Weinmann, M. et al. (2015). Semantic point cloud interpretation based on optimal neighborhoods,
relevant features and efficient classifiers. ISPRS Journal 105, 286-304: section 3.2.
West, K. F. et al. (2004). Context-driven automated target detection in 3D data. SPIE 5426,
133-143: the features made of eigenvalues.
Pauly, M., Gross, M. and Kobbelt, L. (2002). Efficient simplification of point-sampled surfaces.
IEEE Visualization, 163-170: surface variation.
Smith, O. K. (1961). Eigenvalues of a symmetric 3 x 3 matrix. Communications of the ACM 4(4), 168.
Eberly, D. (2014). A robust eigensolver for 3 x 3 symmetric matrices. Geometric Tools.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.cells import SortedCells
from algorithms.shared.kernels import covariance as kernels
from algorithms.shared.kernels.threads import side_by_side
from algorithms.shared.neighbours import PointTree
from toolbox.context import QUIET, Context, log

Name = Literal[
    "linearity",
    "planarity",
    "sphericity",
    "anisotropy",
    "omnivariance",
    "eigenentropy",
    "surface_variation",
    "verticality",
    "roughness",
    "nx",
    "ny",
    "nz",
    "height_range",
    "height_deviation",
    "volume_density",
    "surface_density",
    "neighbours",
    "eigenvalue1",
    "eigenvalue2",
    "eigenvalue3",
]
FEWEST = 3  # points in a neighbourhood that have a shape

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Made = dict[Name, NDArray[np.float32]]


@dataclass(frozen=True)
class Feature:
    """One number that describes a neighbourhood.

    Attributes
    ----------
    text : what it is
    power : of the unit of length in it: 1 for a length, -2 for a number per area
    of : computes it from the rows of :mod:`algorithms.shared.kernels.covariance`
    shape : it needs FEWEST points

    Examples
    --------
    >>> FEATURES["planarity"].power  # a ratio
    0
    """

    text: str
    power: int
    of: Callable[[Floats], Floats]
    shape: bool = True


def _row(number: int) -> Callable[[Floats], Floats]:
    return lambda found: found[number]


def _ratio(above: Callable[[Floats, Floats, Floats], Floats]) -> Callable[[Floats], Floats]:
    """Function of the eigenvalues, divided by the largest one."""
    return lambda found: above(*found[kernels.LARGE : kernels.SMALL + 1]) / found[kernels.LARGE]


def _shares(found: Floats) -> Floats:
    """The eigenvalues as shares of their sum, shape (3, n)."""
    values = found[kernels.LARGE : kernels.SMALL + 1]
    return np.asarray(values / values.sum(axis=0))


def _entropy(found: Floats) -> Floats:
    shares = _shares(found)
    return np.asarray(-(shares * np.log(np.where(shares > 0, shares, 1.0))).sum(axis=0))


def _density(ball: float, power: int) -> Callable[[Floats], Floats]:
    return lambda found: found[kernels.COUNT] / (ball * found[kernels.REACH] ** power)


FEATURES: Mapping[Name, Feature] = {
    "linearity": Feature("(l1 - l2) / l1", 0, _ratio(lambda a, b, c: a - b)),
    "planarity": Feature("(l2 - l3) / l1", 0, _ratio(lambda a, b, c: b - c)),
    "sphericity": Feature("l3 / l1", 0, _ratio(lambda a, b, c: c)),
    "anisotropy": Feature("(l1 - l3) / l1", 0, _ratio(lambda a, b, c: a - c)),
    "omnivariance": Feature("(e1 e2 e3)^(1/3)", 0, lambda f: np.cbrt(_shares(f).prod(axis=0))),
    "eigenentropy": Feature("-sum of e ln e", 0, _entropy),
    "surface_variation": Feature("l3 / (l1 + l2 + l3)", 0, lambda f: _shares(f)[2]),
    "verticality": Feature("1 - |nz|", 0, lambda f: 1.0 - np.abs(f[kernels.NZ])),
    "roughness": Feature("away from plane", 1, _row(kernels.OFF_PLANE)),
    "nx": Feature("normal, x", 0, _row(kernels.NX)),
    "ny": Feature("normal, y", 0, _row(kernels.NY)),
    "nz": Feature("normal, z, not below 0", 0, _row(kernels.NZ)),
    "height_range": Feature("range of z", 1, _row(kernels.RISE), shape=False),
    "height_deviation": Feature("std. dev. of z", 1, _row(kernels.SPREAD), shape=False),
    "volume_density": Feature("points", -3, _density(4 / 3 * np.pi, 3), shape=False),
    "surface_density": Feature("points", -2, _density(np.pi, 2), shape=False),
    "neighbours": Feature("with the point itself", 0, _row(kernels.COUNT), shape=False),
    "eigenvalue1": Feature("variance, l1", 2, _row(kernels.LARGE)),
    "eigenvalue2": Feature("variance, l2", 2, _row(kernels.MIDDLE)),
    "eigenvalue3": Feature("variance, l3", 2, _row(kernels.SMALL)),
}
"""What can be asked for; e are the eigenvalues l as shares of their sum."""


def covariance_features(
    xyz: Floats,
    *,
    neighbours: int | None = 20,
    radius: float | None = None,
    names: Sequence[Name] = ("linearity", "planarity", "sphericity"),
    some: Mask | None = None,
    once: bool = False,
    ctx: Context = QUIET,
) -> Made:
    """Features of the neighbourhood of every point, to which the point itself belongs.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    neighbours : the nearest others taken, see :mod:`algorithms.shared.neighbours` for equally
        near ones; None for all within the radius
    radius : neighbours must be nearer than this, in the unit of xyz; None for any distance
    names : of FEATURES
    some : array of shape (n,), the points to describe if all within the radius are neighbours; the
        others get NaN
    once : whether of points at one position one is a neighbour, if all within the radius are
    ctx : progress and cancellation

    Returns
    -------
    dict of arrays of shape (n,)
        In the unit of xyz. The radius of a density is that given, or with `neighbours` the distance
        of the farthest. NaN where there are fewer than three points or all are at one position, and
        for what the normal tells (verticality, roughness, nx, ny, nz) if they lie on a line.
        The same for any order of the points and any number of threads.

    Raises
    ------
    ValueError
        A coordinate is not a finite number, or there is neither a number nor a radius.

    Examples
    --------
    >>> xyz = np.array([[x, y, 0.5 * x] for x in range(5) for y in range(5)], float)
    >>> found = covariance_features(xyz, neighbours=8, names=("planarity", "nz"))
    >>> found["nz"][12].round(3)  # of the point in the middle: cos(atan(0.5))
    np.float32(0.894)
    """
    if neighbours is None and radius is None:
        raise ValueError("give neighbours, a radius or both")
    made = {name: np.full(len(xyz), np.nan, np.float32) for name in names}
    if neighbours is None:
        some = np.ones(len(xyz), bool) if some is None else some
        _of_all_within(xyz, float(radius or 0.0), some, once, made, ctx)
    else:
        reach = np.inf if radius is None else float(radius)
        _of_the_nearest(xyz, neighbours, reach, made, ctx)
    return made


def _of_all_within(
    xyz: Floats, reach: float, some: Mask, once: bool, made: Made, ctx: Context
) -> None:
    """Fill in the features of neighbourhoods of all points within reach, for some points."""
    cells = SortedCells.of(xyz, reach)
    asked = some[cells.order]
    again = kernels.repeated(cells.xyz, cells.start) if once else np.zeros(len(xyz), bool)
    if again.any():
        log.info("%d points share their place with another", np.count_nonzero(again))

    def describe(first: int, last: int) -> None:
        """Compute the features of the points in cells first..last."""
        own = slice(cells.start[first], cells.start[last])
        index = cells.order[own][asked[own]]
        found = np.empty((kernels.ROWS, len(index)))
        layout = (cells.xyz, cells.key, cells.start, cells.stride)
        kernels.within(first, last, *layout, reach, asked, again, found)
        _fill(made, index, found)

    ctx.progress(0.2)
    side_by_side(describe, cells.runs, ctx=ctx.part(0.2, 1.0))


def _of_the_nearest(xyz: Floats, neighbours: int, reach: float, made: Made, ctx: Context) -> None:
    """Fill in the features of neighbourhoods of the nearest points within reach."""
    tree = PointTree.of(xyz, ctx=ctx.part(0.0, 0.2))

    def describe(first: int, last: int) -> None:
        """Compute the features of the points in leaves first..last."""
        some = slice(*((leaf * len(xyz)) >> tree.depth for leaf in (first, last)))
        found = np.empty((kernels.ROWS, some.stop - some.start))
        kernels.nearest(first, last, tree.xyz, tree.boxes, tree.depth, neighbours, reach, found)
        _fill(made, tree.order[some], found)

    side_by_side(describe, tree.leaves, ctx=ctx.part(0.2, 1.0))


def _fill(made: Made, index: NDArray[np.int64], found: Floats) -> None:
    """Write the features of some points."""
    with np.errstate(divide="ignore", invalid="ignore"):
        for name, values in made.items():
            values[index] = _values(FEATURES[name], found)


def _values(feature: Feature, found: Floats) -> Floats:
    """Values of a feature; NaN where it is not defined."""
    values = feature.of(found)
    known = np.isfinite(values)
    if feature.shape:
        known &= (found[kernels.COUNT] >= FEWEST) & (found[kernels.LARGE] > 0)
    return np.where(known, values, np.nan)
