"""What reports say of rasters, and of points by class: in memory, and of tiles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.data import Lattice, PointCloud, Raster, Rows, Section, Table
from toolbox.data.asprs import CLASSES
from toolbox.data.crs import describe_crs, height_system
from toolbox.data.report import Column
from toolbox.declare.fields import Spec
from toolbox.pictures.images import LENGTHS
from toolbox.reports import words

_SHARE = {"Share": Column("Share", "%", 1, 100.0)}
_OF_RASTERS = {
    "Cell": Column("Cell", "", 2),
    "Lowest": Column("Lowest", "", 2),
    "Highest": Column("Highest", "", 2),
    "Empty": Column("Empty cells", "%", 1, 100.0),
}


@dataclass(frozen=True)
class Cells:
    """The cells of a raster, and the range of what they hold; None if all are empty.

    Attributes
    ----------
    empty : share of the cells
    """

    cell: float
    rows: int
    columns: int
    unit: str
    crs: CRS | None
    lowest: float | None
    highest: float | None
    empty: float

    @classmethod
    def of(cls, raster: Raster) -> Cells:
        """Those of a raster in memory."""
        return cls.of_parts(raster, Lattice.of(raster), [raster.band()])

    @classmethod
    def of_parts(
        cls, first: Raster, lattice: Lattice, parts: Iterable[NDArray[np.float64]]
    ) -> Cells:
        """Those of a raster of which no more than a part is in memory at a time.

        Parameters
        ----------
        first : a raster with its unit and CRS
        lattice : of all cells
        parts : all values, NaN where a cell is empty
        """
        known, low, high = 0, np.inf, -np.inf
        for values in parts:
            full = values[np.isfinite(values)]
            known += len(full)
            low, high = min(low, full.min(initial=np.inf)), max(high, full.max(initial=-np.inf))
        size = lattice.rows * lattice.cols
        unit = LENGTHS.get(first.units[0], first.units[0])
        lowest, highest = (float(low), float(high)) if known else (None, None)
        share = 1 - known / size
        return cls(
            lattice.cell, lattice.rows, lattice.cols, unit, first.crs, lowest, highest, share
        )


def rasters(spec: Spec, cells: Mapping[str, Cells], files: Mapping[str, str]) -> list[Section]:
    """Section with a row for each raster, by the name of its result.

    Parameters
    ----------
    files : names of the files that hold them
    """
    rows = [
        {
            "Raster": words.titled(spec.results[name]),
            **({"File": files.get(name)} if files else {}),
            "Holds": spec.results[name].help,
            "Cell": one.cell,
            "Rows": one.rows,
            "Columns": one.columns,
            "Unit": one.unit,
            "Lowest": one.lowest,
            "Highest": one.highest,
            "Empty": one.empty,
        }
        for name, one in cells.items()
    ]
    crs = next((one.crs for one in cells.values()), None)
    if not rows:
        return []
    caption = "" if crs is None else f"{describe_crs(crs)}; heights: {height_system(crs)}"
    return [Section("Rasters", [Rows(Table.from_rows(rows), caption, columns=_OF_RASTERS)])]


def classes(spec: Spec, after: Mapping[str, Counter[int]], before: Counter[int]) -> list[Section]:
    """Section with the points of each class, before and after a run that classified them."""
    rows = [
        {
            "Points": words.titled(spec.results[name]),
            "Class": code,
            "Name": CLASSES.get(code, ""),
            **({"Before": before.get(code, 0)} if before else {}),
            "After": counts.get(code, 0),
            "Share": counts.get(code, 0) / counts.total(),
        }
        for name, counts in after.items()
        for code in sorted({*counts, *before})
    ]
    return (
        [Section("Points by class", [Rows(Table.from_rows(rows), columns=_SHARE)])] if rows else []
    )


def by_class(layer: Any) -> Counter[int]:
    """The number of points of each class of a cloud in memory."""
    if not isinstance(layer, PointCloud) or "classification" not in layer:
        return Counter()
    codes, counts = np.unique(layer["classification"], return_counts=True)
    return Counter(dict(zip(codes.tolist(), counts.tolist(), strict=True)))
