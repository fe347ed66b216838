"""Features of points by name, each the same whatever part of a survey is looked at.

Beside those of :mod:`algorithms.classify._evidence` and any attribute of the points there are, as
``name@radius`` with a radius in metres, the features of :mod:`algorithms.shared.covariance`, which
features.local gives, and those of :mod:`algorithms.classify._learning.columns`. Larger radii take
coarser points, one for each voxel of a third of the radius: so that each costs about the same.

References
----------
Hackel, T., Wegner, J. D. and Schindler, K. (2016). Fast semantic segmentation of 3D point clouds
with strongly varying density. ISPRS Annals III-3, 177-184: coarser points for larger radii.
Weinmann, M. et al. (2015). Semantic point cloud interpretation based on optimal neighborhoods,
relevant features and efficient classifiers. ISPRS Journal 105, 286-304.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._evidence import MADE, PointFeatures, scatter_of
from algorithms.classify._learning import columns, kernels
from algorithms.classify._learning.columns import BORDER, Measured
from algorithms.classify._learning.columns import NAMES as COLUMN
from algorithms.shared.covariance import FEATURES, covariance_features
from algorithms.shared.kernels.sorting import grouped
from algorithms.shared.kernels.threads import in_blocks
from algorithms.shared.returns import NAMES as RETURNS
from algorithms.shared.returns import has_numbers
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud
from toolbox.errors import DataError, nearest

RADII = (1.0, 2.0, 4.0)  # metres, of features of which none are named
OFFERED = (*MADE, *(f"{name}@2" for name in (*FEATURES, *COLUMN)))  # in dialogs
PER_RADIUS = 3  # voxels along a radius
FINE = float(1 << 20)  # steps of a voxel in which positions are summed up, so that sums are exact
MOST = 1 << 20  # voxels, and cells, along an axis
LIGHT = ("mean_intensity", "intensity_spread")
WITHOUT_HEIGHTS = {"above_lowest", "below_highest", *LIGHT}
BENT = {"flat_share", "mean_variation"}
LARGEST = 10.0  # metres, of a radius
RUN = 1 << 16  # points that one thread takes at once
DIGITS = 4  # of features, so that what arithmetic rounds otherwise makes no other tree
PLANE_RADIUS, CONTEXT = 1.0, 3.0  # metres, of the features of classify.som
LOCAL = (  # others of FEATURES say nearly the same as these
    *("linearity", "planarity", "surface_variation", "verticality", "height_deviation"),
    *("roughness", "surface_density"),
)
AROUND = ("planarity", "roughness", "returns")  # need the scatter about planes
SINGLE = ("height_above_ground", "ground", *AROUND)
ECHOES = ("returns", "passing_share")

Floats = NDArray[np.float64]


def usual(cloud: PointCloud, radii: Sequence[float]) -> tuple[str, ...]:
    """Names of the features that are taken if none are named, of those that the points can have."""
    given = [
        name
        for name in ("return_number", "number_of_returns", "intensity")
        if name in cloud and np.ptp(cloud[name]) > 0
    ]
    missing = set() if has_numbers(cloud) else set(ECHOES)
    if "intensity" not in given:
        missing |= set(LIGHT)
    single = [name for name in SINGLE if name not in missing]
    each = [name for name in (*LOCAL, *COLUMN) if name not in missing]
    return (*single, *given, *(f"{name}@{radius:g}" for radius in radii for name in each))


def split(name: str) -> tuple[str, float | None]:
    """The feature and the radius of a name; None without one.

    >>> split("planarity@0.5"), split("intensity")
    (('planarity', 0.5), ('intensity', None))

    Raises
    ------
    ValueError
        The radius is no number from above 0 to LARGEST.
    """
    base, _, text = name.partition("@")
    if not text:
        return name, None
    radius = float(text)
    if not 0 < radius <= LARGEST:
        raise ValueError(f"the radius must be above 0 and at most {LARGEST:g} m")
    return base, radius


def problem(names: Sequence[str], cloud: PointCloud) -> str:
    """What is wrong with the names of features, for these points; empty if nothing is."""
    for name in names:
        try:
            base, radius = split(name)
        except ValueError as error:
            return f"{name!r}: {error}"
        known = (*FEATURES, *COLUMN) if radius else (*MADE, *cloud.names)
        if base not in known:
            text = (
                "no feature of a radius"
                if radius
                else f"no attribute of {cloud.name or 'the points'}"
            )
            return f"{name!r} is {text}{nearest(base, known)}"
        if base in ECHOES and not has_numbers(cloud):
            return f"{base} needs the attributes {' and '.join(RETURNS)}"
    return ""


def described(
    cloud: PointCloud, names: Sequence[str], *, ctx: Context = QUIET
) -> NDArray[np.float32]:
    """Features of points in metres, array of shape (n, f); NaN where a point has none.

    Raises
    ------
    DataError
        The points extend over too many voxels.
    """
    made = np.empty((len(names), len(cloud)), np.float32)  # each is written in a row
    place: dict[tuple[str, float | None], list[int]] = {}
    for k, name in enumerate(names):
        place.setdefault(split(name), []).append(k)
    asked: dict[float, list[str]] = {}
    for base, radius in place:
        if radius is not None:
            asked.setdefault(radius, []).append(base)
    metre = cloud.metre
    shapes = _shapes(cloud.xyz / metre, names, asked, ctx.part(0.0, 0.2))
    scatter = None
    if "neighbours" in shapes:
        scatter = scatter_of(shapes["eigenvalue3"], shapes["neighbours"])
    single = PointFeatures(
        cloud, PLANE_RADIUS * metre, CONTEXT * metre, ctx.part(0.2, 0.5), given_scatter=scatter
    )
    for k, name in enumerate(names):
        if split(name)[1] is None:
            made[k] = single.feature(name)
    for base, radius, values in _of_radii(cloud, single, asked, shapes, ctx.part(0.5, 1.0)):
        made[place[base, radius]] = values
    found = np.empty((len(cloud), len(names)), np.float32)

    def fill(first: int, last: int) -> None:
        """Write the features of some points side by side."""
        kernels.rounded_rows(first, last, made, 10.0**DIGITS, found)

    in_blocks(fill, len(cloud), RUN)
    ctx.progress(1.0)
    return found


def _shapes(
    xyz: Floats, names: Sequence[str], asked: Mapping[float, Sequence[str]], ctx: Context
) -> dict[str, NDArray[np.float32]]:
    """Features of the neighbourhoods of PLANE_RADIUS, which others are made of as well."""
    wanted = {name for name in asked.get(PLANE_RADIUS, ()) if name in FEATURES}
    if set(AROUND) & set(names):
        wanted |= {"eigenvalue3", "neighbours"}
    if any(BENT & set(bases) for bases in asked.values()):
        wanted.add("surface_variation")
    return _local(xyz, PLANE_RADIUS, sorted(wanted), ctx) if wanted and len(xyz) else {}


def _of_radii(
    cloud: PointCloud,
    single: PointFeatures,
    asked: Mapping[float, Sequence[str]],
    shapes: Mapping[str, NDArray[np.float32]],
    ctx: Context,
) -> Iterator[tuple[str, float, NDArray[np.floating]]]:
    """Name, radius and values of each feature that is asked for, by radius."""
    if not len(cloud):
        return
    xyz = cloud.xyz / cloud.metre
    for done, (radius, bases) in enumerate(sorted(asked.items())):
        part = ctx.part(done / len(asked), (done + 1) / len(asked))
        local = [name for name in bases if name in FEATURES]
        found = _local(xyz, radius, local, part) if local and radius != PLANE_RADIUS else shapes
        yield from ((name, radius, found[name]) for name in local)
    of_columns = {r: [name for name in bases if name in COLUMN] for r, bases in asked.items()}
    wanted = {name for some in of_columns.values() for name in some}
    if not wanted:
        return
    bent = shapes.get("surface_variation", np.full(len(cloud), np.nan, np.float32))
    measured = _measured(cloud, xyz, single, wanted, bent.astype(float))
    for radius, bases in of_columns.items():
        if bases:
            made = columns.features(measured, radius, bases)
            yield from ((name, radius, values) for name, values in made.items())


def _local(
    xyz: Floats, radius: float, names: Sequence[str], ctx: Context
) -> dict[str, NDArray[np.float32]]:
    """Features of the neighbourhoods of points in metres, by coarser points for larger radii."""
    coarse, place = voxel_means(xyz, radius / PER_RADIUS)
    local = [name for name in FEATURES if name in names]
    made = covariance_features(coarse, neighbours=None, radius=radius, names=local, ctx=ctx)
    return {name: values[place] for name, values in made.items()}


def _measured(
    cloud: PointCloud, xyz: Floats, single: PointFeatures, bases: set[str], bent: Floats
) -> Measured:
    """What columns need of points (xyz in metres); heights only if a feature asks for them."""
    count = len(cloud)
    ground, height = np.zeros(count, bool), np.zeros(count)
    if bases - WITHOUT_HEIGHTS:
        ground, height = single.terrain
        height = np.asarray(height, float)
    passing = single.let_through if has_numbers(cloud) else np.zeros(count, bool)
    light = np.asarray(cloud["intensity"], float) if "intensity" in cloud else np.zeros(count)
    return Measured(xyz, height, ground, passing, light, bent)


def voxel_means(xyz: Floats, side: float) -> tuple[Floats, NDArray[np.int64]]:
    """Mean position of the points in each voxel, and for each point the number of its voxel.

    The voxels begin at the origin of the coordinates and sums are exact, so that neither other
    voxels nor the order of the points matter.

    Parameters
    ----------
    xyz : array of shape (n, 3), at least one point
    side : of a voxel, in the unit of xyz

    Raises
    ------
    DataError
        There are more than MOST voxels along an axis.
    """
    index, inside = np.empty((3, len(xyz)), np.int64), np.empty((3, len(xyz)), np.int64)
    kernels.in_voxels(xyz, BORDER, side, FINE, index, inside)
    lowest = index.min(axis=1)
    size = index.max(axis=1) - lowest + 1
    if size.max() > MOST:
        raise DataError(f"points: more than {MOST} voxels along an axis: remove stray points")
    keys = ((index[0] - lowest[0]) * size[1] + (index[1] - lowest[1])) * size[2]
    voxels, number = grouped(keys + (index[2] - lowest[2]))
    count, sums = np.bincount(number, minlength=len(voxels)), np.zeros((3, len(voxels)), np.int64)
    kernels.add_up(number, inside, sums)
    means = np.empty((len(voxels), 3))
    for axis in (2, 1, 0):
        voxels, own = np.divmod(voxels, size[axis])
        means[:, axis] = (own + lowest[axis] + sums[axis] / FINE / count) * side - BORDER
    return means, number


def density(xyz: Floats) -> float:
    """Points per square metre where there are any, counted in cells of one metre; 0 for none.

    >>> density(np.array([[0.1, 0.1, 0], [0.2, 0.2, 0], [5.0, 5.0, 0]]))
    1.5
    """
    if not len(xyz):
        return 0.0
    cells = np.floor(xyz[:, :2]).astype(np.int64)
    cells -= cells.min(axis=0)
    return len(xyz) / len(np.unique(cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]))
