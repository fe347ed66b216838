"""From a cloud, the points in which a power line is sought, in metres, with heights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._extraction.candidates import STANDS_FOR, candidates
from algorithms.corridor._extraction.ground import heights_of
from algorithms.corridor._settings import SETTINGS
from algorithms.shared.lowest import lattice_around
from algorithms.shared.strips import strips_of
from toolbox.context import Context, log
from toolbox.data import PointCloud
from toolbox.errors import DataError

CELLS_AROUND = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class CorridorPoints:
    """Points of a corridor, and those of them that are off the ground.

    Attributes
    ----------
    index : array of shape (n,), which points of the cloud these are
    origin : array of shape (3,), in the unit of the cloud
    xyz : array of shape (n, 3), metres from the origin
    height : array of shape (n,), above the ground, metres; NaN where not known
    air : the m points off the ground, in the order of plan cells
    own : array of shape (m,), which of the n points each of these is
    strip : array of shape (m,), by point_source_id; all 0 where it is not known
    seen : whether there are points around a position in plan
    density : points per square metre, where there are any
    """

    index: Ints
    origin: Floats
    xyz: Floats
    height: Floats
    air: Airborne
    own: Ints
    strip: NDArray[np.uint16]
    seen: Callable[[float, float], bool]
    density: float

    @classmethod
    def of(
        cls,
        cloud: PointCloud,
        use: NDArray[np.bool_],
        ground_classes: Sequence[int] | None,
        ctx: Context,
    ) -> CorridorPoints:
        """Choose points of a cloud, and find their heights; see :func:`heights_of`.

        Parameters
        ----------
        use : array with a value for each point of the cloud: whether it takes part

        Raises
        ------
        DataError
            The points lie along lines, without ground, or one is too far from the others.
        """
        height = heights_of(cloud, use, ground_classes, ctx)
        if STANDS_FOR in cloud:
            index = np.flatnonzero(use)
            stands_for = cloud[STANDS_FOR][index]
        else:
            index, stands_for = candidates(cloud.xyz, height, use, metre=cloud.metre)
        xyz, height = cloud.xyz[index], height[index]
        size, origin = SETTINGS.points.company_side * cloud.metre, np.zeros(3)
        if len(xyz):
            lattice_around(xyz, size)  # which says so if a stray point is too far away
            origin = np.floor(xyz.min(axis=0) / size) * size
        xyz = (xyz - origin) / cloud.metre
        seen, density = footprint(xyz[:, :2], stands_for)
        off = np.flatnonzero(height > SETTINGS.points.off_ground)
        air = Airborne.of(xyz[off])
        own = off[air.order]
        strip = strips_of(cloud, index[own])
        return cls(index, origin, xyz, height, air, own, strip, seen, density)

    def warn_of_no_line(self) -> None:
        """Log that no line was found, and why."""
        unknown = len(self.height) > 0 and np.isnan(self.height).all()
        why = ": no height above the ground is known" if unknown else ""
        log.warning("no power line was found%s", why)


def footprint(
    xy: Floats, stands_for: NDArray[np.uint32]
) -> tuple[Callable[[float, float], bool], float]:
    """A function that tells whether points lie around a position, and the density where they do.

    The points must not lie along lines only, as wires without ground do, the lowest of which would
    be taken for it. Seen from above, cells with ground have others around them; those with wires
    have others before and behind. Points that are few, or so sparse that most cells of ground have
    one, cannot be judged.

    Parameters
    ----------
    xy : array of shape (n, 2), metres, none below 0
    stands_for : array of shape (n,), how many points each is of

    Raises
    ------
    DataError
        They lie along lines.
    """
    table = occupied(xy)
    cells = int(np.count_nonzero(table))
    of_cell = float(stands_for.sum()) / max(cells, 1)
    enough = cells >= SETTINGS.points.fewest_cells and of_cell >= SETTINGS.points.fewest_of_cell
    if (
        enough
        and min(
            share_beside(occupied(xy + shift)) for shift in (0.0, SETTINGS.points.company_side / 2)
        )
        < SETTINGS.points.area_share
    ):
        raise DataError(
            "points: lie along lines, as wires do, without the ground from which heights are "
            "measured; give the ground too, or fit the wires with corridor.catenaries"
        )

    def seen(x: float, y: float) -> bool:
        i, j = (
            int(x // SETTINGS.points.company_side) + 1,
            int(y // SETTINGS.points.company_side) + 1,
        )
        return bool(table[max(i - 1, 0) : max(i + 2, 0), max(j - 1, 0) : max(j + 2, 0)].any())

    return seen, of_cell / SETTINGS.points.company_side**2


def occupied(xy: Floats) -> NDArray[np.bool_]:
    """True for cells with points, with one row and column of empty cells on all sides."""
    cell = np.floor(xy / SETTINGS.points.company_side).astype(np.int64) + 1
    table = np.zeros(cell.max(axis=0, initial=0) + 2, bool)
    table[cell[:, 0], cell[:, 1]] = True
    return table


def share_beside(table: NDArray[np.bool_]) -> float:
    """Share of the cells with points that have enough such cells around them."""
    beside = sum(np.roll(table, step, (0, 1))[table].astype(np.uint8) for step in CELLS_AROUND)
    return float(np.mean(np.asarray(beside) >= SETTINGS.points.area_cells))
