"""The cells that a run is going to make, counted before the work.

One rule for all that makes rasters of points: a slip of the decimal point in the size of the cells
is told, or refused where they cannot fit into memory.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from toolbox.context import log
from toolbox.data.crs import length_problem
from toolbox.data.lattice import in_plan
from toolbox.data.layer import Layer
from toolbox.data.reading import need_memory
from toolbox.declare.fields import Spec

CELL, EXTENT = "cell", "extent"  # parameters that mean the same in all tools
WORK, EACH = 24, 4  # bytes of memory per cell: of the work, and of each raster that is made;
# measured: 28 of surface.grid, 40 of models.terrain, which makes four
MANY = 25  # cells per point: their side is a fifth of the distance between points


def check(
    spec: Spec, settings: Mapping[str, Any], layers: Mapping[str, Any], side: float = math.inf
) -> None:
    """Warn of cells far smaller than the points are apart; refuse what memory does not hold.

    Where a raster is read, its cells are those that are made.

    Parameters
    ----------
    side : metres, of the square whose cells are in memory at a time: a tile with what is around

    Raises
    ------
    MemoryShort
        The cells need more memory than is free.
    """
    field = spec.inputs.get(CELL)
    rasters = sum(f.kind.is_gridded for f in spec.outputs.values())
    if field is None or field.unit != "m" or not rasters:
        return
    cell = settings.get(CELL, field.default)
    read = [layer for n, f in spec.sources.items() if n in layers for layer in f.items(layers[n])]
    clouds = [layer for layer in read if "z" in layer.axes and layer.size()]
    if not isinstance(cell, int | float) or not clouds or any(layer.is_gridded for layer in read):
        return
    for cloud in clouds:
        if not length_problem(cloud.crs):  # else the tool says what is wrong with it
            _check(cell, settings.get(EXTENT), cloud, WORK + EACH * rasters, side)


def _check(cell: float, extent: Any, cloud: Layer, bytes_per_cell: int, side: float) -> None:
    west, south, east, north = in_plan(cloud.bounds)
    count, area = cloud.size() or 0, (east - west) * (north - south)
    spacing = math.sqrt(area / count) / cloud.metre
    if extent is not None:
        area = (extent.xmax - extent.xmin) * (extent.ymax - extent.ymin)
    cells = area / (cell * cloud.metre) ** 2
    text = f"cell: {cells:,.0f} cells of {cell:g} m, where points are about {spacing:.2g} m apart,"
    more = "work in tiles (tile)" if math.isinf(side) else "smaller tiles (tile)"
    at_a_time = min(cells, (side / cell) ** 2)
    need_memory(at_a_time * bytes_per_cell, text, f"; choose larger cells, or {more}")
    if cell < spacing / math.sqrt(MANY):
        log.warning("%s are far smaller than the data can fill", text.removesuffix(","))
