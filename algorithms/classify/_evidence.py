"""Features of points by name, and the class of each point by physical evidence.

Vegetation lets part of a pulse through, and its points do not lie on planes. A building is what
stands on the ground and does neither. Single points say little: a branch may lie on a plane by
chance, and the edge of a roof does not. So planarity, roughness and returns are those of all
points around, on the same side of the ground: above it, or on it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.classify import _flatness
from algorithms.classify._flatness import FLAT
from algorithms.classify._sorted_points import SortedPoints
from algorithms.shared.covariance import covariance_features
from algorithms.shared.ground import Candidates, is_withheld
from algorithms.shared.heights import HEIGHT, given_heights
from algorithms.shared.kernels.sorting import sums_around
from algorithms.shared.returns import NAMES as RETURNS
from algorithms.shared.returns import ReturnNumbers, has_numbers, let_through
from algorithms.shared.selection import of_classes
from algorithms.shared.terrain import KNOWN_HALO, find_terrain, height_above, verdict
from toolbox.context import QUIET, Context, log, setting_name
from toolbox.data import PointCloud
from toolbox.errors import DataError, nearest

FOOT = 0.5  # metres above ground from which points in an outline are building
GROUND, VEGETATION, BUILDING = 2, 5, 6
# Of known ground that of one square of so many times so many is looked at; squares are as wide as
# the radius, so that there are points in them.
EACH = 2  # where the noise of the survey is learned
EACH_TO_WARN = 5  # where it is but told whether there is so much that roofs are lost
ENOUGH = 4  # points that can tell whether they lie on a plane
NOISY = 1.5  # times what points may be from a plane without noise, from which on it is told
FEW = 0.2  # share of points that may lack neighbours before a warning
VOXEL = 1.0  # metres, the cells in which points are counted
LOWEST_ROOF = 1.5  # metres above ground
LET_THROUGH, ON_PLANES = 0.25, 0.12  # shares around, of vegetation at least and of roofs
HALO = KNOWN_HALO + 40.0  # metres, for the largest radius (10) and context (20), and voxels
FINE = float(1 << 20)  # steps in which features are summed up, so that sums are exact
MOST = 1 << 20  # voxels along an axis

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class PointFeatures:
    """Features of the points of a cloud, each computed when it is first asked for.

    Attributes
    ----------
    cloud : n points
    radius : of the neighbourhood in which planes are looked for, in the unit of the points
    context : points up to this far away share what they look like, in that unit
    ctx : progress and cancellation
    flat : metres from a plane up to which points lie on it
    ground_classes : classes that are ground; None to look for ground
    by_noise : whether `flat` is the least, and more where the points on the ground scatter more;
        not if no pulse has several returns, since crowns are told by planes alone then
    given_scatter : the scatter about planes, see :attr:`scatter`; None to look for planes
    """

    cloud: PointCloud
    radius: float
    context: float
    ctx: Context = QUIET
    flat: float = FLAT
    ground_classes: tuple[int, ...] | None = None
    by_noise: bool = False
    given_scatter: Floats | None = None

    def feature(self, name: str) -> Floats:
        """One feature of all points, array of shape (n,): one of MADE, or an attribute."""
        if name in MADE:
            return MADE[name](self)
        return np.asarray(self.cloud[name], np.float64)

    @property
    def xyz(self) -> Floats:
        """Coordinates, array of shape (n, 3)."""
        return self.cloud.xyz

    @functools.cached_property
    def _sorted(self) -> SortedPoints:
        """The points sorted into squares."""
        xyz, metre = self.xyz, self.cloud.metre
        return self.ctx.once(
            "sorted", (self.cloud.places, metre), lambda: SortedPoints.of(xyz, metre)
        )

    def within(self, shape: Any, some: Mask | None = None) -> NDArray[np.int64]:
        """Indices of the points in a polygon, in rising order; see :meth:`SortedPoints.within`."""
        return self._sorted.within(shape, self.xyz, some)

    @functools.cached_property
    def terrain(self) -> tuple[Mask, Floats]:
        """Which points are ground, and metres of all points above the terrain.

        The ground is that of `ground_classes`, with the heights that the points have, or else with
        those above it; without classes it is found as in :mod:`algorithms.ground.classify`.
        Heights are NaN where there is no terrain near, or no
        point that could be ground.
        """
        cloud, ctx = self.cloud, self.ctx.part(0.0, 0.4)
        if self.ground_classes is not None:
            ground = of_classes(cloud["classification"], self.ground_classes) & ~is_withheld(cloud)
            if HEIGHT in cloud:
                return ground, given_heights(cloud)
            bare, metre = _frozen(self.xyz.compress(ground, axis=0)), cloud.metre
            found = ctx.once(
                "terrain",
                (bare, metre),
                lambda: find_terrain(bare, known=True, mistakes=True, metre=metre, ctx=ctx),
            )
            return ground, height_above(self.xyz, found)
        candidates = Candidates.of(cloud)
        ground = np.zeros(len(cloud), bool)
        if not candidates.chosen.any():
            return ground, np.full(len(ground), np.nan)
        found = find_terrain(candidates.xyz, metre=cloud.metre, ctx=ctx)
        ground[candidates.chosen] = verdict(candidates.xyz, found)[0]
        return ground, height_above(self.xyz, found)

    @functools.cached_property
    def planes(self) -> tuple[Floats, NDArray[np.float32]]:
        """Scatter of points about the plane around each point, and the normal of that plane.

        The scatter is the standard deviation of the distances in metres, array of shape (n,), NaN
        where there are too few points; the normals have the shape (n, 3). Points at one position
        count once, since duplicates would make a plane of any two positions. On known ground, where
        planes tell the noise of the survey alone, they are looked for in some squares: in few where
        that noise is not followed.
        """
        some = np.ones(len(self.xyz), bool)
        if self.ground_classes is not None:
            each = EACH if self.follows_noise else EACH_TO_WARN
            some = ~self.terrain[0] | in_some_squares(self.xyz, self.radius, each)
        inputs = self.cloud.places, some, self.radius, self.cloud.metre
        found = self.ctx.once("planes", inputs, lambda: self._planes(some))
        self._warn_of_few(np.isnan(found[0]))
        return found

    def _planes(self, some: Mask) -> tuple[Floats, NDArray[np.float32]]:
        """Scatter and normals of some points, see `planes`."""
        found = covariance_features(
            self.xyz,
            neighbours=None,
            radius=self.radius,
            names=("eigenvalue3", "neighbours", "nx", "ny", "nz"),
            some=some,
            once=True,
            ctx=self.ctx.part(0.4, 0.8),
        )
        off_plane = scatter_of(found["eigenvalue3"], found["neighbours"]) / self.cloud.metre
        normals = np.column_stack([found["nx"], found["ny"], found["nz"]])
        return _frozen(off_plane), _frozen(normals)

    @functools.cached_property
    def scatter(self) -> Floats:
        """Metres by which points scatter about the plane around each point, shape (n,)."""
        if self.given_scatter is None:
            return self.planes[0]
        self._warn_of_few(np.isnan(self.given_scatter))
        return self.given_scatter

    @property
    def follows_noise(self) -> bool:
        """Whether points may be farther from planes where the ground scatters more."""
        return self.by_noise and self.has_several_returns

    @functools.cached_property
    def flatness(self) -> Floats:
        """Metres from a plane up to which points around each point lie on it, shape (n,)."""
        if not self.follows_noise:
            return np.broadcast_to(np.float64(self.flat), len(self.xyz))
        scatter, ground, metre = self.scatter, self.terrain[0], self.cloud.metre
        found = _flatness.by_noise(self.xyz[:, :2], scatter, ground, self.flat, metre)
        largest = found.max(initial=self.flat)
        if largest > NOISY * self.flat:
            flat = setting_name("flat")
            log.warning(
                "points on the ground scatter so much that points may be up to %.2f m from a "
                "plane, not %.2g m: trees and hedges are told less surely%s",
                largest,
                self.flat,
                f"; `{flat}` sets how far" if flat else "",
            )
        return found

    def _warn_of_few(self, shapeless: Mask) -> None:
        """Log that many points above the ground lack neighbours, array of shape (n,)."""
        above = ~self.terrain[0]
        few, total = np.count_nonzero(shapeless & above), np.count_nonzero(above)
        if few > FEW * total:
            log.warning(
                "%d of %d points above the ground lack neighbours to lie on a plane with; raise "
                "radius",
                few,
                total,
            )

    def _warn_of_noise(self) -> None:
        """Log that the ground itself is rougher than a plane may be, as noise makes it.

        Roofs are known by a share ON_PLANES of their points. Where not even the ground has it,
        which is as smooth as they are, no roof can.
        """
        if self.follows_noise:
            return
        scatter = self.scatter[self.terrain[0]]
        scatter = scatter[np.isfinite(scatter)]
        if not len(scatter) or np.mean(scatter <= self.flat) >= ON_PLANES:
            return
        log.warning(
            "points on the ground scatter by %.2f m about the planes around them, and only %.0f %% "
            "by no more than %.2g m, as points on roofs must: by planes roofs cannot be told from "
            "vegetation; the points are too noisy; a tool with `flat` needs some %.2f m",
            np.median(scatter),
            100 * np.mean(scatter <= self.flat),
            self.flat,
            1.5 * np.median(scatter),
        )

    @functools.cached_property
    def let_through(self) -> Mask:
        """True for returns after which the pulse went on, array of shape (n,)."""
        return let_through(self.cloud)

    @functools.cached_property
    def has_several_returns(self) -> bool:
        """Whether any pulse is known to have gone on after a return."""
        return bool(self.let_through.any())

    def warn_without_returns(self, consequence: str) -> None:
        """Warn if no pulse is known to have gone on: each had one return, or nobody knows.

        Parameters
        ----------
        consequence : continues a sentence
        """
        if self.has_several_returns:
            return
        if ReturnNumbers.of(self.cloud).known.any():
            log.warning("no pulse has several returns: %s", consequence)
        else:
            log.warning("no return numbers are recorded: %s", consequence)

    def ground_below(self, some: NDArray[np.int64]) -> Floats:
        """Elevations of the ground below some points, given by index, in their unit."""
        return np.asarray(self.xyz[some, 2] - self.terrain[1][some] * self.cloud.metre)

    @functools.cached_property
    def around(self) -> Mapping[str, Floats]:
        """Planarity, roughness and returns, as means over the points around each point.

        Only points on the same side of the ground count: those on it, or those above it. Where
        classes say what is ground, nobody asks for those on it, which get NaN.
        """
        self._warn_of_noise()
        how = self.radius, self.context, self.flat, self.by_noise, self.cloud.metre
        given = b"" if self.given_scatter is None else self.given_scatter
        known = self.ground_classes is not None
        inputs = self.cloud.places, self.terrain[0], self.let_through, given, known, *how
        return self.ctx.once("around", inputs, self._around)

    def _around(self) -> Mapping[str, Floats]:
        """Means over the points around, see `around`."""
        ground, metre = self.terrain[0], self.cloud.metre
        some = ~ground if self.ground_classes is not None else np.ones(len(ground), bool)
        off_plane = self.scatter[some]
        values = {
            "planarity": np.where(off_plane <= self.flatness[some], 1.0, 0.0),
            "roughness": np.where(np.isnan(off_plane), self.radius / metre, off_plane),
            "returns": self.let_through[some].astype(np.float64),
        }
        found = means_around(
            self.xyz.compress(some, axis=0) / (VOXEL * metre),
            ground[some],
            np.column_stack([*values.values()]),
            round(self.context / (VOXEL * metre), 6),  # whole metres stay whole in feet
            ctx=self.ctx.part(0.8, 1.0),
        )
        means = np.full((len(ground), len(values)), np.nan)
        means[some] = found
        return dict(zip(values, _frozen(means).T, strict=True))


MADE: Mapping[str, Callable[[PointFeatures], Floats]] = {
    "x": lambda features: features.xyz[:, 0],
    "y": lambda features: features.xyz[:, 1],
    "z": lambda features: features.xyz[:, 2],
    "height_above_ground": lambda features: features.terrain[1],
    "ground": lambda features: features.terrain[0].astype(np.float64),
    "planarity": lambda features: features.around["planarity"],
    "roughness": lambda features: features.around["roughness"],
    "returns": lambda features: features.around["returns"],
}
"""Features that are not attributes of the points."""


def in_some_squares(xyz: Floats, size: float, each: int) -> Mask:
    """True for points in one of `each` times `each` squares, array of shape (n,).

    The lattice of squares begins at the origin of the coordinates, as for a part of the points.

    >>> in_some_squares(np.array([[1.0, 1], [1, 3], [5, 1]]), 2.0, 2).tolist()
    [True, False, True]
    """
    east, north = (xyz[:, axis] / (each * size) for axis in (0, 1))
    return np.asarray((east - np.floor(east) < 1 / each) & (north - np.floor(north) < 1 / each))


def scatter_of(variance: NDArray[np.float32], count: NDArray[np.float32]) -> Floats:
    """Standard deviation of points about the plane through them; NaN of fewer than ENOUGH.

    Three points always lie on a plane, so as many less are left to tell how far off it is.

    Parameters
    ----------
    variance : across the plane, of `count` points, arrays of shape (n,)
    """
    known = count.astype(np.float64)
    freedom = np.where(known < ENOUGH, np.nan, known - 3)
    return np.asarray(np.sqrt(variance * known / freedom))


def evidence(features: PointFeatures) -> NDArray[np.uint8]:
    """Class of each point by its features: GROUND, VEGETATION or BUILDING, array of shape (n,)."""
    (ground, height), around = features.terrain, features.around
    on_planes = around["planarity"] / ON_PLANES
    if features.has_several_returns:
        plant = around["returns"] / LET_THROUGH > on_planes
    else:
        plant = on_planes < 1
    plant |= height < LOWEST_ROOF
    return np.where(ground, GROUND, np.where(plant, VEGETATION, BUILDING)).astype(np.uint8)


def means_around(
    xyz: Floats, group: Mask, values: Floats, reach: float, *, ctx: Context = QUIET
) -> Floats:
    """Means of values over the points of the same group around each point.

    Points are counted in cells of one unit; cells whose middles are no farther apart than `reach`
    share their points. The lattice of cells begins at the origin of the coordinates, so that any
    part of the points, with enough around, gets what the whole gets.

    Parameters
    ----------
    xyz : array of shape (n, 3), in units of the cells
    group : array of shape (n,)
    values : array of shape (n, k), from 0 to about 1000
    reach : in units of the cells

    Returns
    -------
    array of shape (n, k)
        The same for any order of the points.
    """
    if not len(xyz):
        return np.zeros(values.shape)
    floors = [np.floor(axis).astype(np.int64) for axis in xyz.T]
    cells = [axis - (axis.min() - int(reach) - 1) for axis in floors]
    if max(axis.max() for axis in cells) >= MOST:
        raise DataError(f"points: they extend over more than {MOST} m: remove stray points")
    size = [int(axis.max()) + int(reach) + 2 for axis in cells]
    strides = size[1] * size[2], size[2]
    keys = cells[0] * strides[0] + cells[1] * strides[1] + cells[2]
    keys[group] += size[0] * strides[0]
    ctx.progress(0.2)
    east, north, far = _ball(reach).T
    step = east * strides[0] + north * strides[1]
    total, place = sums_around(keys, [np.rint(one * FINE) for one in values.T], step, far)
    ctx.progress(0.9)
    return _frozen((total[:, 1:] / FINE / total[:, :1]).take(place, axis=0))


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The same array, set read-only: for a writable one kernels would be compiled once more."""
    array.flags.writeable = False
    return array


def _ball(reach: float) -> NDArray[np.int64]:
    """Columns of cells within reach, array of shape (m, 3): east, north, and how far up and down.

    Cells above each other have numbers one after the other, so that a column is one range.
    """
    far = np.arange(-int(reach), int(reach) + 1)
    east, north, up = np.meshgrid(far, far, far, indexing="ij")
    within = (east**2 + north**2 + up**2 <= reach**2).sum(axis=2)
    columns = np.column_stack([east[:, :, 0][within > 0], north[:, :, 0][within > 0]])
    return np.column_stack([columns, within[within > 0] // 2])


def solid(features: PointFeatures) -> Mask:
    """True for points whose surroundings speak more for planes than for vegetation.

    The share of points on planes and that of returns that let the pulse through are compared,
    each relative to its threshold.
    """
    flat = features.around["planarity"] / ON_PLANES
    return np.asarray((flat > 0) & (flat >= features.around["returns"] / LET_THROUGH))


def missing_feature(names: tuple[str, ...], cloud: PointCloud) -> str:
    """The problem with a list of feature names, as a text; empty if all can be had."""
    for name in names:
        if name not in MADE and name not in cloud:
            near = nearest(name, [*MADE, *cloud.names])
            return f"{name!r} is no attribute of {cloud.name or 'the points'}{near}"
        if name == "returns" and not has_numbers(cloud):
            return f"returns needs the attributes {' and '.join(RETURNS)}"
    return ""


def features_of(features: PointFeatures, names: tuple[str, ...]) -> Floats:
    """Array of shape (n, f) of the named features; NaN where a point lacks one."""
    values = np.column_stack([features.feature(name) for name in names])
    missing = int(np.count_nonzero(~np.isfinite(values).all(axis=1)))
    if missing:
        log.warning("%d of %d points lack a feature and become class 1", missing, len(values))
    return values


def no_point_has_all(names: tuple[str, ...], values: Floats) -> str:
    """The problem that no point has all features, as a text; empty if one has."""
    known = np.isfinite(values)
    if known.all(axis=1).any():
        return ""
    return f"points: none has all the features; most lack {names[int(known.sum(axis=0).argmin())]}"
