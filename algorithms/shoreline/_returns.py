"""Last returns of a survey, packed into 19 bytes each: coordinates, intensity, class, strip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.ground import may_be_ground, taking_part
from algorithms.shared.lowest import require_finite
from algorithms.shared.selection import of_classes
from algorithms.shared.strips import strips_of
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Survey
from toolbox.errors import DataError

BATCH = 2_000_000  # points that are read at a time
BLOCK = 50_000  # whose coordinates and cells fit into the cache of a processor
FOR_STEP = 100_000  # heights that tell to what they are rounded
DECKS = (17, 26)  # bridge decks of LAS 1.4, and bridges, quays and the like of Dutch surveys
UNIT = 1e-4  # of coordinates, in the unit of the data: 32 bits reach 200 km

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Returns:
    """Last returns, which may lie on water or ground.

    Attributes
    ----------
    packed : array of shape (n, 3), whole multiples of UNIT from the origin
    intensity : array of shape (n,), zeros where there is none
    water : array of shape (n,), whether a point is of a class of water
    strip : array of shape (n,), the flight line of each point, zeros where it is not known
    origin : array of shape (3,)
    metre : length of one metre in the unit of the data
    decks : array of shape (k, 2), points of bridges and the like, whatever they return
    """

    packed: NDArray[np.int32]
    intensity: NDArray[np.float32]
    water: NDArray[np.bool_]
    strip: NDArray[np.uint16]
    origin: Floats
    metre: float
    decks: Floats

    def __len__(self) -> int:
        return len(self.packed)

    @cached_property
    def step(self) -> float:
        """What heights are rounded to: the largest step of which all are whole multiples apart."""
        heights = self.packed[:: max(1, len(self) // FOR_STEP), 2].astype(np.int64)
        return float(np.gcd.reduce(heights - heights[:1])) * UNIT if len(heights) else 0.0

    def xyz(self, which: slice | NDArray[np.int64]) -> Floats:
        """Coordinates of some points, shape (k, 3)."""
        return np.asarray(self.packed[which] * UNIT + self.origin)

    def blocks(self) -> Iterator[slice]:
        """Slices of points to work on one after the other."""
        return (slice(k, min(k + BLOCK, len(self))) for k in range(0, len(self), BLOCK))

    @classmethod
    def of(
        cls,
        points: PointCloud | Survey,
        ignore: Sequence[int] | None,
        water_classes: Sequence[int] | None,
        ctx: Context = QUIET,
    ) -> Returns:
        """The last returns that are neither withheld nor of ignored classes.

        Raises
        ------
        DataError
            Coordinates are not finite, or too far apart.
        """
        bounds = np.reshape(points.bounds, (2, 3))
        if not len(points) if isinstance(points, PointCloud) else not points.count:
            bounds = np.zeros((2, 3))
        require_finite(bounds)
        origin = np.floor(bounds[0])
        if (bounds[1] - origin).max() / UNIT >= 2**31:
            raise DataError("points: they lie more than 200 000 units apart; remove stray points")
        count = len(points) if isinstance(points, PointCloud) else points.count
        packed, intensity = np.empty((count, 3), np.int32), np.empty(count, np.float32)
        water, strip, size = np.zeros(count, bool), np.zeros(count, np.uint16), 0
        decks = [np.empty((0, 2))]
        parts = [points] if isinstance(points, PointCloud) else points.batches(BATCH, ctx=ctx)
        for cloud in parts:
            use = may_be_ground(cloud, "last") & taking_part(cloud, ignore)
            here = slice(size, size + int(use.sum()))
            packed[here] = np.round((cloud.xyz[use] - origin) / UNIT)
            intensity[here] = cloud["intensity"][use] if "intensity" in cloud else 0
            strip[here] = strips_of(cloud, use)
            if water_classes:
                water[here] = np.isin(cloud["classification"][use], water_classes)
            size = here.stop
            if "classification" in cloud:
                decks.append(cloud.xyz[of_classes(cloud["classification"], DECKS), :2])
        ctx.progress(1.0)
        metre = points.metre
        some = (packed[:size], intensity[:size], water[:size], strip[:size])
        return cls(*some, origin, metre, np.concatenate(decks))
