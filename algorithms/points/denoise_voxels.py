"""Isolated voxels: points that have next to no others around them are noise.

References
----------
Roussel, J.-R. et al. (2020). lidR: An R package for analysis of Airborne Laser Scanning (ALS) data.
Remote Sensing of Environment 251, 112061: the isolated voxels filter.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.points import _noise
from algorithms.points._groups import ROUNDING, cells
from algorithms.shared import parameters
from algorithms.shared.ground import taking_part
from algorithms.shared.kernels.sorting import sums_around
from algorithms.shared.lowest import require_finite
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud
from toolbox.declare import ClassList, outputs, param, sink, source, tool
from toolbox.errors import DataError

LOW, HIGH = 7, 18  # classes of noise, ASPRS LAS 1.4
FINE = 1000.0  # steps of a voxel in which heights are summed up, so that sums are exact
MOST = 1 << 60  # voxels in the box around the points, and one more at the end of each row
NEXT = (-1, 0, 1)  # cells before, its own and after

Floats = NDArray[np.float64]
Verdicts = NDArray[np.uint8]


@tool(
    "points.denoise_voxels",
    title="Remove isolated points",
    tags=("noise", "isolated", "voxel", "ivf", "filter", "denoise", "outlier", "clean"),
)
class PointsDenoiseVoxels:
    """Remove or label points in voxels that have hardly any points in and around them.

    A voxel is a cube with sides of `cell`; their lattice begins at the origin of the coordinates.
    Where a voxel and the 26 around it together hold no more than `most` points, these points are
    noise. This is fast, and what it takes is easily said; but it knows no density: where pulses are
    sparse, as on wires, water and far from a scanner, real points stand alone as well, and what is
    noise depends on where the lattice lies. points.denoise asks instead how far points usually are
    from others there, and also takes groups of noise.

    Noise becomes class 7, or 18 where it lies above the mean height of the points in the columns of
    voxels around it. Ignored classes and withheld points take no part and stay.
    """

    points: PointCloud = source("Points to clean")
    action: Literal["remove", "label"] = _noise.action()
    cell: float = parameters.cell(default=5.0)
    most: int = param(
        "Points in 27 voxels up to which they are noise",
        default=6,
        unit="1",
        ge=1,
        label="Most points of noise",
    )
    ignore: ClassList | None = parameters.ignore()

    @outputs
    class Outputs:
        clean: PointCloud = sink(
            "The points without noise, or with noise as classes 7 and 18",
            label="Points without noise",
        )
        low_noise: int = sink("Points found to be low noise", unit="1")
        high_noise: int = sink("Points found to be high noise", unit="1")

        def in_words(self) -> str:
            """How many points are noise."""
            return _noise.in_words(self.low_noise, self.high_noise)

    def halo(self) -> float:
        """Two voxels, since those around a voxel may lie across the edge of a tile."""
        return 2 * self.cell * (1 + ROUNDING)

    def run(self, ctx: Context = QUIET) -> PointsDenoiseVoxels.Outputs:
        """Count the points around those that take part, and remove or label the noise."""
        cloud = self.points
        part = taking_part(cloud, self.ignore)
        verdict = np.zeros(len(cloud), np.uint8)
        verdict[part] = isolated(cloud.xyz[part], self.cell, self.most, ctx=ctx)
        found, count = np.count_nonzero(verdict), np.count_nonzero(part)
        if found > self.most and found > _noise.MOST * count:
            log.warning(
                "%d of %d points (%.3g %%) are called noise, and no survey has more than %g %%: "
                "raise cell or lower most",
                found,
                count,
                100 * found / count,
                100 * _noise.MOST,
            )
        ctx.progress(1.0)
        return self._outputs(verdict)

    def _outputs(self, verdict: Verdicts) -> PointsDenoiseVoxels.Outputs:
        cloud = self.points
        return self.Outputs(
            clean=_noise.without(cloud, verdict, self.action),
            low_noise=int(np.count_nonzero(cloud.core & (verdict == LOW))),
            high_noise=int(np.count_nonzero(cloud.core & (verdict == HIGH))),
        )


def isolated(xyz: Floats, voxel: float, most: int, *, ctx: Context = QUIET) -> Verdicts:
    """Class of noise of each point, from the number of points in the 27 voxels around it.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    voxel : side of the voxels, in the unit of xyz
    most : points that 27 voxels of noise hold at most
    ctx : progress and cancellation

    Returns
    -------
    array of shape (n,)
        0 for points to keep, 7 for low noise, 18 for high noise.

    Raises
    ------
    ValueError
        A coordinate is not a finite number.
    DataError
        The box around the points has more than MOST voxels.
    """
    require_finite(xyz)
    verdict = np.zeros(len(xyz), np.uint8)
    if not len(xyz):
        return verdict
    place = cells(xyz, voxel)
    place -= place.min(axis=0)
    size = [int(last) + 2 for last in place.max(axis=0)]  # an empty one keeps rows apart
    if size[0] * size[1] * size[2] > MOST:
        raise DataError(f"points: they extend over more than {MOST} voxels: remove stray points")
    column = place[:, 0] * size[1] + place[:, 1]
    step = np.array([east * size[1] + north for east in NEXT for north in NEXT])
    one = np.ones_like(step)
    found, cell = sums_around(column * size[2] + place[:, 2], (), step * size[2], one)
    count = found[cell, 0]
    ctx.progress(0.5)
    if not (noise := count <= most).any():
        return verdict
    steps = np.rint(xyz[:, 2] / voxel * FINE)
    found, cell = sums_around(column, (steps,), size[1] * np.array(NEXT), one[: len(NEXT)])
    held, height = found[cell].T
    above = steps * held > height
    verdict[noise] = np.where(above[noise], HIGH, LOW)
    return verdict
