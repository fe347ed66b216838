"""What reports say of rasters, and of points by class: in memory, and of tiles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.data import Lattice, PointCloud, Raster, Rows, Section, Table
from toolbox.data.asprs import class_name
from toolbox.data.crs import LENGTHS, describe_crs, height_system, length_problem, short_unit
from toolbox.data.report import Column, unit_text
from toolbox.declare.fields import Spec
from toolbox.reports import words

_UNCLASSIFIED = {0, 1}  # of which alone, as of scans of a building, nothing is to be told
_SHARE = {"Share": Column("Share", "%", 1, 100.0)}
_OF_RASTERS = {
    "Rows": Column("Rows"),
    "Columns": Column("Columns"),
    "Lowest": Column("Lowest", "", 2),
    "Highest": Column("Highest", "", 2),
    "Empty": Column("Empty cells", "%", 1, 100.0),
}

Became = Mapping[int, Counter[int]]


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
    head = f"Rasters have cells of {' and '.join(sorted(sizes))}."
    ranges = (_range(words.titled(spec.outputs[name]), one) for name, one in known.items())
    return f"{head} {'; '.join(ranges)}."


def _range(title: str, one: Cells) -> str:
    """The values of a raster, in a piece that can be translated by itself."""
    highest = f"{one.highest:z.2f} {unit_text(one.unit)}".rstrip()
    share = 100 * one.empty
    return f"{title} from {one.lowest:z.2f} to {highest}, {share:.1f} % of its cells empty"


def rasters(spec: Spec, cells: Mapping[str, Cells], files: Mapping[str, str]) -> list[Section]:
    """Section with a row for each raster, by the name of its result.

    Parameters
    ----------
    files : names of the files that hold them; what is empty and in none is left out
    """
    rows = [
        {
            "Raster": words.titled(spec.results[name]),
            **({"File": files.get(name)} if files else {}),
            "Holds": spec.results[name].help,
            "Cell": one.cell,
            "Rows": one.rows,
            "Columns": one.columns,
            "Unit": unit_text(one.unit),
            "Lowest": one.lowest,
            "Highest": one.highest,
            "Empty": one.empty,
        }
        for name, one in cells.items()
        if name in files or one.lowest is not None or not files
    ]
    first = next(iter(cells.values()), None)
    if first is None or not rows:
        return []
    crs, columns = first.crs, {**_OF_RASTERS, "Cell": Column("Cell", first.length, 2)}
    caption = "" if crs is None else f"{describe_crs(crs)}; heights: {height_system(crs)}"
    return [Section("Rasters", [Rows(Table.from_rows(rows), caption, columns=columns)])]


def classes(spec: Spec, after: Mapping[str, Counter[int]], before: Counter[int]) -> list[Section]:
    """Section with the points of each class, before and after a run that classified them.

    Of a part of the points nothing is said of before: these were not all of a class.
    """
    whole = {name for name, counts in after.items() if counts.total() == before.total()}
    rows = [
        {
            **({"Points": words.titled(spec.results[name])} if len(after) > 1 else {}),
            "Class": code,
            "Name": class_name(code),
            **({"Before": before[code] if name in whole else None} if whole else {}),
            **({"After": counts[code]} if whole else {"Count": counts[code]}),
            "Share": counts[code] / counts.total(),
        }
        for name, counts in after.items()
        for code in sorted({*counts, *(before if name in whole else ())})
        if {*counts, *before} - _UNCLASSIFIED
    ]
    return (
        [Section("Points by class", [Rows(Table.from_rows(rows), columns=_SHARE)])] if rows else []
    )


def given_up(before: Counter[int], after: Counter[int], became: Became) -> Iterator[str]:
    """What is said of classes of the input that no point has any more.

    Parameters
    ----------
    became : how many points of a class have which other class now, as far as it is known
    """
    gone = sorted(set(before) - set(after)) if before.total() == after.total() else []
    if gone:
        yield f"Classes of the input that no point has any more: {_gone(gone, before, became)}."


def _gone(gone: Sequence[int], before: Counter[int], became: Became) -> str:
    told = []
    for code in gone:
        now = [f"{n} {class_name(k)}" for k, n in became.get(code, Counter()).most_common()]
        to = f", now {', '.join(now)}" if now else ""
        told.append(f"{code} ({class_name(code)}, points: {before[code]}{to})")
    return "; ".join(told)


def became(before: Any, after: Any) -> Became:
    """How many points of each class have which class after a run that kept points and their order.

    Nothing of layers that are no points, or other ones.
    """
    clouds = [one for one in (before, after) if isinstance(one, PointCloud)]
    if len(clouds) < 2 or not all("classification" in one for one in clouds):
        return {}
    first, second = clouds
    if len(first) != len(second) or not np.array_equal(first["x"], second["x"]):
        return {}
    both = np.column_stack([one["classification"] for one in clouds])
    pairs, counts = np.unique(both, axis=0, return_counts=True)
    found: dict[int, Counter[int]] = {}
    for (old, new), count in zip(pairs.tolist(), counts.tolist(), strict=True):
        found.setdefault(old, Counter())[new] = count
    return found


def by_class(layer: Any) -> Counter[int]:
    """The number of points of each class of a cloud in memory."""
    if not isinstance(layer, PointCloud) or "classification" not in layer:
        return Counter()
    codes, counts = np.unique(layer["classification"], return_counts=True)
    return Counter(dict(zip(codes.tolist(), counts.tolist(), strict=True)))
