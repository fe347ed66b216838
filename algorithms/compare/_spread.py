"""Whether checkpoints are spread over the area of a surface instead of crowded.

References
----------
FGDC (1998). Geospatial Positioning Accuracy Standards, Part 3: National Standard for Spatial Data
Accuracy (NSSDA), 3.2.2: at least a fifth of the points in each quarter of the area.
Clark, P. J. and Evans, F. C. (1954). Distance to nearest neighbor as a measure of spatial
relationships in populations. Ecology 35(4), 445-453: equations 2 and 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from toolbox.context import log
from toolbox.data import Lattice, Raster

Array = NDArray[np.float64]
LEAST = 0.2  # of the checkpoints in each quarter
CROWDED = -1.959963984540054  # standard deviations below the mean distance of random positions
MOST = 10_000  # more are laser points, which lie along their tracks
NAMES = ("south-west", "north-west", "south-east", "north-east")


class Quarters(NamedTuple):
    """Division of a surface into four quarters of equal area, by its cells with values.

    Attributes
    ----------
    east : x at which the eastern half begins
    north : y at which the northern quarters begin, in the western and in the eastern half
    area : of all cells with a value
    """

    east: float
    north: tuple[float, float]
    area: float

    @classmethod
    def of(cls, surface: Raster) -> Quarters:
        """Halve the area from west to east, then each half from south to north."""
        known, lattice = np.isfinite(surface.band()), Lattice.of(surface)
        column = _middle(known.sum(axis=0))
        cut = round(column)
        rows = (_middle(half.sum(axis=1)) for half in (known[:, :cut], known[:, cut:]))
        west, east = (lattice.north - row * lattice.cell for row in rows)
        area = float(np.count_nonzero(known)) * lattice.cell**2
        return cls(lattice.west + column * lattice.cell, (west, east), area)

    def shares(self, xy: Array) -> Array:
        """Share of positions of shape (n, 2) in each of the quarters, in the order of `NAMES`."""
        eastern = xy[:, 0] >= self.east
        northern = xy[:, 1] >= np.where(eastern, self.north[1], self.north[0])
        return np.bincount(2 * eastern + northern, minlength=4) / len(xy)


def _middle(counts: NDArray[Any]) -> float:
    """Position along rows or columns at which half of the counted cells is reached."""
    edges = np.concatenate([[0.0], np.cumsum(counts)])
    return float(np.interp(edges[-1] / 2, edges, np.arange(len(edges))))


def spread(kind: str, xy: Array, quarters: Quarters) -> Iterator[dict[str, Any]]:
    """Rows of the report on the distribution of checkpoints; warns where it is uneven.

    Parameters
    ----------
    kind : "NVA" or "VVA"
    xy : array of shape (n, 2)
    """
    if not len(xy):
        return
    shares = quarters.shares(xy)
    few, where = float(shares.min()), NAMES[int(shares.argmin())]
    note = "well spread" if few >= LEAST else "UNEVEN"
    note += f": at least {LEAST:.0%} of them belong in each quarter; fewest in the {where}"
    if few < LEAST:
        log.warning("%s: only %.0f %% of the checkpoints are in the %s", kind, 100 * few, where)
    yield {"item": f"{kind} emptiest quarter", "value": few, "unit": "1", "note": note}
    if 1 < len(xy) <= MOST:
        yield _apart(kind, xy, quarters.area)


def _apart(kind: str, xy: Array, area: float) -> dict[str, Any]:
    """The row of the report on the mean distance from a checkpoint to its nearest neighbour."""
    from scipy.spatial import cKDTree

    apart = float(np.mean(cKDTree(xy).query(xy, k=[2])[0]))
    by_chance = 0.5 * math.sqrt(area / len(xy))
    deviation = 0.26136 * math.sqrt(area) / len(xy)  # of the mean
    crowded = apart < by_chance + CROWDED * deviation
    note = f"{apart / by_chance:.2f} times that of random places"
    if crowded:
        note = f"CROWDED: {note}"
        log.warning("%s: the checkpoints are crowded", kind)
    return {"item": f"{kind} mean distance to next", "value": apart, "unit": "m", "note": note}
