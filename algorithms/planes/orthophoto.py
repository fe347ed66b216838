"""Image of fronts seen square to them, from the points of a scan."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.ground import without_withheld
from algorithms.shared.windows import filled
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, PointCloud, Raster, Vector
from toolbox.declare import outputs, param, sink, source, tool
from toolbox.errors import DataError, NothingToDo

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]
Flat = tuple[NDArray[np.int64], Floats, Floats]  # points near a front: index, place, how far out
PLACE = [f"{name}_{axis}" for name in ("corner", "right", "up") for axis in "xyz"]
COLOURS = ("red", "green", "blue")
RELIEF = "relief"
DARKEST, BRIGHTEST = 1.0, 99.0  # percentiles that are black and white
BLACK, WHITE = 1, 255  # of the image, in which 0 is nodata


@tool(
    "planes.orthophoto",
    title="Orthophoto of fronts",
    tags=("facade", "orthophoto", "image", "front", "elevation", "rectified"),
)
class PlanesOrthophoto:
    """Make an image of all fronts, each seen square to it, on the elevation.

    Each cell shows the point that stands farthest out within `image_depth` before and behind the
    front, in its colour, or else its intensity. Of points without both it shows the relief: what
    stands farther out is brighter. Cells without points take the nearest within `fill_cells`. The
    image has the coordinates of the elevation of planes.openings, and of drawings of it, so lengths
    can be taken from it.
    """

    points: PointCloud = source("Points of the scan")
    elevation: Vector = source("Elevation by planes.openings", any_crs=True)
    cell: float | Literal["auto"] = param(
        "Size of the cells; by the density with auto",
        default="auto",
        unit="m",
        gt=0,
        le=100,
        label="Cell size",
    )
    image_depth: float = param(
        "How far before and behind a front points are shown",
        default=0.5,
        unit="m",
        gt=0,
        le=10,
        label="Depth of the image",
    )
    fill_cells: int = param(
        "Cells without points that are filled beside one with points",
        default=2,
        unit="1",
        ge=0,
        le=20,
    )

    @outputs
    class Outputs:
        image: Raster = sink("Image of all fronts, 1 to 255, 0 for no point")
        cell_size: float = sink("Size of its cells", unit="m")
        filled_share: float = sink("Share of the fronts that the image shows", unit="1")

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The elevation tells where its fronts are."""
        if missing := [name for name in PLACE if name not in self.elevation.names]:
            yield "elevation", f"has no attribute {missing[0]}; take that of planes.openings"

    def halo(self) -> float:
        """Infinite, as all fronts are on one image."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> PlanesOrthophoto.Outputs:
        """Project front by front, take the outermost point of each cell."""
        frame = self.elevation.frame
        fronts = frame[frame["kind"] == "facade"]
        if not len(fronts):
            raise DataError("planes.orthophoto", {"elevation": "holds no front"})
        xyz = self.points.xyz
        firm = without_withheld(self.points, np.ones(len(xyz), bool), ctx)
        flat = [self._flat(xyz, firm, front) for _, front in fronts.iterrows()]
        if not any(len(which) for which, *_ in flat):
            raise NothingToDo("points: none lies near a front")
        size = self._cell(fronts.geometry.area.sum(), flat)
        lattice = Lattice.cover(self.elevation.bounds, size)
        shades = self._shades(flat)
        image = np.zeros((len(shades[0]), *lattice.shape), np.uint8)
        for number, (front, (_, uv, out), own) in enumerate(
            zip(fronts.geometry, flat, shades, strict=True)
        ):
            ctx.progress(number / len(flat))
            left, bottom, right, top = front.bounds
            near = (uv[:, 0] >= left) & (uv[:, 0] < right) & (uv[:, 1] >= bottom) & (uv[:, 1] < top)
            order = np.flatnonzero(near)[np.argsort(out[near], kind="stable")]
            row, col = lattice.indices(*uv[order].T)
            for band, shade in zip(image, own, strict=True):
                band[row, col] = shade[order]
        shown = filled(image, image[0] == 0, self.fill_cells)
        inside = np.zeros(lattice.shape, bool)
        x, y = lattice.centres()
        import shapely

        union = shapely.union_all(np.array([shapely.box(*f.bounds) for f in fronts.geometry]))
        inside |= shapely.contains_xy(union, *np.meshgrid(x, y))
        shown[:, ~inside] = 0
        made = Raster.from_lattice(
            shown,
            lattice,
            crs=self.elevation.crs,
            nodata=0.0,
            descriptions=self._bands() or (RELIEF,),
        )
        return self.Outputs(
            image=made,
            cell_size=size,
            filled_share=float((shown[0][inside] > 0).mean()) if inside.any() else 0.0,
        )

    def _bands(self) -> tuple[str, ...]:
        """The attributes that are shown."""
        if all(name in self.points for name in COLOURS):
            return COLOURS
        return ("intensity",) if "intensity" in self.points else ()

    def _shades(self, flat: list[Flat]) -> list[list[NDArray[np.uint8]]]:
        """The bands of the image, 1 to 255, at the points near each front."""
        if names := self._bands():
            bands = [stretched(self.points[name].astype(float)) for name in names]
            return [[band[which] for band in bands] for which, *_ in flat]
        log.warning(
            "%s has neither colours nor intensity: the image of fronts shows their relief, what "
            "stands farther out is brighter",
            self.points.name,
        )
        relief = stretched(np.concatenate([out for *_, out in flat]))
        ends = np.cumsum([len(out) for *_, out in flat])[:-1]
        return [[part] for part in np.split(relief, ends)]

    def _flat(self, xyz: Floats, firm: NDArray[np.bool_], front: pd.Series[Any]) -> Flat:
        """Indices of points of a mask near a front, their places on it, and how far out."""
        corner, right, up = np.asarray(front[PLACE], np.float64).reshape(3, 3)
        near = xyz - corner
        out = near @ np.cross(right, up)
        which = np.flatnonzero(firm & (np.abs(out) <= self.image_depth))
        return which, near[which] @ np.column_stack([right, up]), out[which]

    def _cell(self, area: float, flat: list[Flat]) -> float:
        """The size of the cells: one and a half spacings of the points unless it is given."""
        if self.cell != "auto":
            return float(self.cell)
        count = sum(len(which) for which, *_ in flat)
        metre = self.points.metre
        return float(f"{1.5 * math.sqrt(area / count) / metre:.1g}") * metre


def stretched(values: Floats) -> NDArray[np.uint8]:
    """Values from the 1st to the 99th percentile as 1 to 255."""
    low, high = np.percentile(values, [DARKEST, BRIGHTEST])
    share = (
        np.clip((values - low) / (high - low), 0, 1) if high > low else np.full(len(values), 0.5)
    )
    return np.asarray(np.rint(BLACK + (WHITE - BLACK) * share), np.uint8)
