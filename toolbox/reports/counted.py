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
from toolbox.data.crs import describe_crs, height_system, length_problem, short_unit
from toolbox.data.report import Column, unit_text
from toolbox.declare.fields import Spec
from toolbox.pictures.images import LENGTHS
from toolbox.reports import words

_SHARE = {"Share": Column("Share", "%", 1, 100.0)}
_OF_RASTERS = {
    "Rows": Column("Rows", detail=True),
    "Columns": Column("Columns", detail=True),
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

    @property
    def length(self) -> str:
        """The unit of the width of cells; "" if it is not known."""
        crs = self.crs
        return "" if crs is None or length_problem(crs) else short_unit(crs)

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


def in_words(spec: Spec, cells: Mapping[str, Cells], files: Mapping[str, str]) -> str:
    """The heights of the rasters that are written, in a sentence; "" without any.

    Of a run in tiles no more is known. The width of cells is told once where all have the same.
    """
    known = {
        name: one
        for name, one in cells.items()
        if name in files
        and name in spec.outputs
        and one.unit in LENGTHS.values()
        and one.lowest is not None
    }
    if not known:
        return ""
    sizes = {f"{one.cell:.4g} {one.length}".rstrip() for one in known.values()}
    ranges = (
        f"{words.titled(spec.outputs[name])} {one.lowest:.2f} to {one.highest:.2f} "
        f"{unit_text(one.unit)}".rstrip()
        + f", {100 * one.empty:.1f} % of its cells empty"
        for name, one in known.items()
    )
    return f"Rasters with cells of {' and '.join(sorted(sizes))}: {'; '.join(ranges)}."


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
    first = next(iter(cells.values()), None)
    if first is None:
        return []
    crs, columns = first.crs, {**_OF_RASTERS, "Cell": Column("Cell", first.length, 2)}
    caption = "" if crs is None else f"{describe_crs(crs)}; heights: {height_system(crs)}"
    return [Section("Rasters", [Rows(Table.from_rows(rows), caption, columns=columns)])]


def classes(spec: Spec, after: Mapping[str, Counter[int]], before: Counter[int]) -> list[Section]:
    """Section with the points of each class, before and after a run that classified them."""
    rows = [
        {
            **({"Points": words.titled(spec.results[name])} if len(after) > 1 else {}),
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
