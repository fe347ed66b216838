"""Surveys cut anew into square files, which are written together with an index of them."""

from __future__ import annotations

import itertools
import math
import string
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.context import QUIET, Context, log
from toolbox.data import vpc
from toolbox.data.las.copc_write import points_sink
from toolbox.data.las.header import LasMetadata
from toolbox.data.paths import LAS
from toolbox.data.pointcloud import PointCloud
from toolbox.data.reading import errors_named
from toolbox.data.record import with_record, write_beside
from toolbox.data.survey import Survey, SurveyFile
from toolbox.data.writing import followed, refuse_to_replace
from toolbox.errors import DataError

MARGIN = "tile_margin"
"""Attribute that is 1 for the points of a tile that are the own of a neighbour, else 0."""

FIELDS = ("x", "y", "column", "row")
"""What the name of a tile may hold: its lower left corner, and its place in whole sides from 0."""

MOST = 20_000
"""Files; more are taken for a mistake in the side."""

_BATCH = 1_000_000  # points that are looked at, and written, at a time

Cell = tuple[int, int]


@dataclass(frozen=True)
class Retiled(Survey):
    """The points of a survey, which are written as square files with an index of them.

    Tiles begin at whole multiples of their side. A point on an edge belongs to the tile east or
    north of it, so that each point is the own of one tile.

    Attributes
    ----------
    side : of a tile, in the unit of the coordinates
    overlap : width of the margin around a tile, whose points it holds as well, marked by the
        attribute `tile_margin`; less than the side
    pattern : names of the files, with any of FIELDS, such as "tile_{x}_{y}.laz"

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     PointCloud([[0, 0, 5.0], [8, 9, 6.0]]).save(f"{folder}/a.las")
    ...     survey = Survey.open(f"{folder}/a.las")
    ...     tiles = Retiled(survey.files, survey.name, side=5.0, pattern="{x}_{y}.las")
    ...     tiles.save(f"{folder}/tiles.vpc")
    ...     [file.path.name for file in Survey.open(f"{folder}/tiles.vpc").files]
    ['0_0.las', '5_5.las']
    """

    side: float = field(kw_only=True)
    overlap: float = field(kw_only=True, default=0.0)
    pattern: str = field(kw_only=True)

    def save(
        self,
        path: str | Path,
        *,
        place: Path | None = None,
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write the tiles beside an index of them, with which they are one product.

        The points are sorted into files on the disk first, as large as uncompressed LAS; in memory
        is never more than a few million of them.

        Parameters
        ----------
        path : of the index, ends in .vpc
        place : where the index will be moved to; the tiles stand beside it
        overwrite : whether files at the path may be replaced
        record : how the files were made, as JSON text (see `toolbox.runs.provenance`)

        Raises
        ------
        ParameterError
            A file is there that may not be replaced.
        DataError
            A tile or the index cannot be written, or two tiles have the same name.
        """
        path = followed(path)
        if path.suffix.lower() not in self.SUFFIXES:
            raise DataError(f"{path}: tiles are written with an index, {', '.join(self.SUFFIXES)}")
        refuse_to_replace(path, self.own_files, overwrite=overwrite)
        with errors_named(f"{path} cannot be written"):
            with TemporaryDirectory(dir=path.parent, prefix=".points-") as drafts:
                metadata, cells = self._sorted_into(Path(drafts), ctx.part(0, 0.5))
                names = self._names_of(cells, (place or path).parent)
                tiles = tuple(map(path.with_name, names.values()))
                refuse_to_replace(path, lambda index: tiles, overwrite=overwrite)
                part = ctx.part(0.5, 1)
                files = _write_tiles(path, Path(drafts), with_record(metadata, record), names, part)
            text = vpc.text_of(files, path, own=True)
            path.write_text(text, encoding="utf-8", newline="\n")
            write_beside(path, record)
        log.info("%s: %d tiles", path.name, len(files))
        ctx.progress(1.0)

    def _sorted_into(self, drafts: Path, ctx: Context) -> tuple[LasMetadata, list[Cell]]:
        """Sort point records into a file for each tile; gives what they are, and the tiles."""
        metadata: LasMetadata | None = None
        cells: set[Cell] = set()
        left_out = 0
        for given in self._clouds(ctx):
            cloud = _own(given)
            left_out += len(given) - len(cloud)
            for cell, rows, margin in self._tiles_of(cloud.xyz):
                piece = cloud.select(rows)
                if self.overlap:
                    piece = piece.with_attributes(
                        {MARGIN: margin}, descriptions={MARGIN: "1 if of a neighbouring tile"}
                    )
                metadata, records = piece.as_las()
                with _draft(drafts, cell).open("ab") as stream:
                    np.ascontiguousarray(records).tofile(stream)
                cells.add(cell)
        if left_out:
            log.info("%d points in margins of earlier tiles are left out", left_out)
        if metadata is None:
            raise DataError(f"{self.name} has no points to cut into tiles")
        return metadata, sorted(cells)

    def _clouds(self, ctx: Context) -> Iterator[PointCloud]:
        """All points, as LAS has them; at once if they are not from LAS, which sets their steps."""
        if all(file.version for file in self.files):
            yield from self.batches(_BATCH, ctx=ctx)
        else:
            yield self.read(ctx=ctx).read_back()

    def _tiles_of(
        self, xyz: NDArray[np.float64]
    ) -> Iterator[tuple[Cell, NDArray[np.intp], NDArray[np.uint8]]]:
        """For each tile with any of the points: which of them, and whether each is in its margin.

        A point within the overlap of an edge is also in the tile beyond it: the one that it would
        be in if it were moved by the overlap.
        """
        found: dict[Cell, list[tuple[NDArray[np.intp], int]]] = {}
        own = np.floor(xyz[:, :2] / self.side).astype(np.int64)
        steps = (0, -1, 1) if self.overlap else (0,)
        for step in itertools.product(steps, repeat=2):
            moved = xyz[:, :2] + np.array(step) * self.overlap
            there = np.floor(moved / self.side).astype(np.int64)
            beyond = ((there != own) == (np.array(step) != 0)).all(axis=1)
            rows = np.flatnonzero(beyond)
            names, tile = np.unique(there[rows], axis=0, return_inverse=True)
            order = np.argsort(tile.ravel(), kind="stable")
            parts = np.split(rows[order], np.cumsum(np.bincount(tile.ravel()))[:-1])
            for name, part in zip(names.tolist(), parts, strict=True):
                found.setdefault((name[0], name[1]), []).append((part, int(any(step))))
        for cell, pieces in found.items():
            rows = np.concatenate([part for part, _ in pieces])
            margin = np.repeat([flag for _, flag in pieces], [len(part) for part, _ in pieces])
            order = np.argsort(rows, kind="stable")  # as they are in the survey
            yield cell, rows[order], margin[order].astype(np.uint8)

    def _names_of(self, cells: list[Cell], folder: Path) -> dict[Cell, str]:
        """The name of each tile, which is that of no other and of no file that is read."""
        names = {}
        for cell in cells:
            x, y = (_plain(number * self.side) for number in cell)
            names[cell] = self.pattern.format(x=x, y=y, column=cell[0], row=cell[1])
        if len(set(names.values())) < len(names):
            raise DataError(f"several tiles would be called alike by the pattern {self.pattern!r}")
        read = {path.resolve() for path in self.paths}
        if used := [n for n in names.values() if (folder / n).resolve() in read]:
            raise DataError(f"{used[0]} is also an input; choose another folder or pattern")
        return names


def _own(cloud: PointCloud) -> PointCloud:
    """The points that are not of the margin of an earlier tile."""
    if MARGIN not in cloud:
        return cloud
    return cloud.select(cloud[MARGIN] == 0).without_attributes([MARGIN])


def _write_tiles(
    path: Path, drafts: Path, metadata: LasMetadata, names: dict[Cell, str], ctx: Context
) -> list[SurveyFile]:
    """Write a file for each tile beside a path; gives their headers."""
    files = []
    if metadata.packets:
        text = "waveforms stay in %s: copy it beside each tile, under the name of the tile"
        log.warning(text, metadata.packets.name)
    for number, (cell, name) in enumerate(names.items()):
        ctx.progress(number / len(names))
        made, draft = path.with_name(name), _draft(drafts, cell)
        _write(made, metadata, draft)
        draft.unlink()
        files.append(SurveyFile.open(made))
    return files


def pattern_problem(pattern: str) -> str | None:
    """Say what is wrong with a pattern for the names of tiles; None if nothing is.

    >>> pattern_problem("tile_{x}.laz")
    'must tell tiles apart: by x and y, or by column and row'
    """
    try:
        fields = {name for _, name, _, _ in string.Formatter().parse(pattern) if name is not None}
        if unknown := sorted(fields - set(FIELDS)):
            return f"{{{unknown[0]}}} is not known, only {', '.join(FIELDS)}"
        name = pattern.format(**dict.fromkeys(FIELDS, 0))
    except (ValueError, IndexError, KeyError) as error:
        return f"cannot be read: {error}"
    if not ({"x", "column"} & fields and {"y", "row"} & fields):
        return "must tell tiles apart: by x and y, or by column and row"
    if Path(name).name != name or "\\" in name or name.startswith("."):
        return f"is the name of a file beside the index, got {pattern!r}"
    return None if name.lower().endswith(LAS) else f"ends in {' or '.join(LAS)}, got {pattern!r}"


def count_of(bounds: Sequence[float], side: float) -> int:
    """The largest number of tiles that points within (xmin, ymin, xmax, ymax) can be in.

    >>> count_of((0, 0, 10, 25), 10)
    6
    """
    xmin, ymin, xmax, ymax = (math.floor(value / side) for value in bounds)
    return (xmax - xmin + 1) * (ymax - ymin + 1)


def _write(path: Path, metadata: LasMetadata, draft: Path) -> None:
    """Write point records to LAS, LAZ or COPC."""
    records: NDArray[Any] = np.memmap(draft, metadata.header.point_format.dtype(), "r")
    with points_sink(path, metadata) as write:
        for start in range(0, len(records), _BATCH):
            write(records[start : start + _BATCH])


def _draft(folder: Path, cell: Cell) -> Path:
    return folder / f"{cell[0]}_{cell[1]}"


def _plain(value: float) -> float:
    """A coordinate for a name: a whole number where it is one, else to a thousandth."""
    return int(value) if float(value).is_integer() else round(value, 3)
