"""How far apart points are, and lengths that grow with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._flatness import FLAT
from algorithms.shared.kernels.sorting import counted
from algorithms.shared.kernels.squares import numbered
from algorithms.shared.places import once_each
from algorithms.shared.returns import ReturnNumbers
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud

CELL = 4.0  # metres, of the cells in which points are counted
SAMPLE = 500_000  # points at least, of whole cells, whose number per area is that of all
RADIUS, CONTEXT, ALPHA = 1.0, 3.0, 1.5  # metres, where points are dense
BY_SPACING = (1.75, 5.0, 2.25)  # times the spacing: the same where they are sparse, see the page
SPARSE = 1.9  # metres between points from which on half of the trees and many roofs are lost;
# spacings are 1.4, 2, 2.8 m
LARGEST = (10.0, 20.0, 20.0)  # metres, for which halos are made


def spacing(cloud: PointCloud, ctx: Context = QUIET) -> float:
    """Metres between the points on a surface, from the number of last returns per area.

    The number is the median over the cells that have any, so that water and the edge of the data
    do not count, and is rounded to a power of two: tiles of one survey get the same.

    Examples
    --------
    >>> xyz = np.array([[x, y, 0.0] for x in range(40) for y in range(40)])
    >>> spacing(PointCloud(xyz))
    1.0
    """
    returns = ReturnNumbers.of(cloud)
    last = ~returns.known | (returns.number == returns.count)
    inputs = cloud.places, last, cloud.metre
    return ctx.once(
        "spacing", inputs, lambda: _spacing(cloud.xyz.compress(last, axis=0), cloud.metre)
    )


def _spacing(xyz: NDArray[np.float64], metre: float) -> float:
    """Metres between points of shape (n, 3); those at one position count once."""
    if not len(xyz):
        return 1.0
    some = _cells(xyz, metre) % (len(xyz) // SAMPLE + 1) == 0
    positions = once_each(xyz.compress(some, axis=0) if some.any() else xyz)
    per_area = float(np.median(counted(_cells(positions, metre))[1])) / CELL**2
    return float(2.0 ** (-np.rint(np.log2(per_area)) / 2))


def _cells(xyz: NDArray[np.float64], metre: float) -> NDArray[np.int64]:
    """Number of the cell of each point."""
    view = xyz.view()
    view.flags.writeable = False  # kernels would be compiled for writable ones once more
    return np.asarray(numbered(view, CELL * metre, 0)[0])


class Lengths(NamedTuple):
    """Lengths that classifiers work with, in the unit of the points but for `flat`.

    Attributes
    ----------
    spacing : of the points
    radius : of the neighbourhood in which planes are looked for
    context : within which features are averaged
    alpha : radius of the disc that rolls around roofs
    flat : metres that points may be from a plane, as standard deviation
    by_noise : whether they may be farther from it where the noise of the points asks for it
    """

    spacing: float
    radius: float
    context: float
    alpha: float
    flat: float
    by_noise: bool

    @classmethod
    def of(
        cls,
        cloud: PointCloud,
        flat: float | None = None,
        radius: float | None = None,
        context: float | None = None,
        alpha: float | None = None,
        *,
        ctx: Context = QUIET,
    ) -> Lengths:
        """The lengths given, and for those that are not what suits the density of the points.

        A surface that bends is farther from its plane the farther one looks, so `flat` grows
        with a radius that was not given.
        """
        apart, metre = spacing(cloud, ctx), cloud.metre
        dense, sparse = (RADIUS, CONTEXT, ALPHA), np.multiply(BY_SPACING, apart)
        suits = np.minimum(np.maximum(dense, sparse), LARGEST) * metre
        given = (radius, context, alpha)
        plane, around, disc = (
            float(other) if one is None else one for one, other in zip(given, suits, strict=True)
        )
        wider = plane / (RADIUS * metre) if radius is None else 1.0
        if None in given and wider > 1:
            log.info(
                "points are some %.1f m apart: radius %.2g m, context %.2g m, alpha %.2g m",
                apart,
                plane / metre,
                around / metre,
                disc / metre,
            )
        metres = FLAT if flat is None else flat / metre
        return cls(apart * metre, plane, around, disc, metres * wider, flat is None)
