"""The tasks of a run in tiles: given to the workers, their results and failures collected."""

from __future__ import annotations

import functools
import math
import operator
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.context import Context, log
from toolbox.declare.values import Share
from toolbox.errors import DataError, ToolboxError
from toolbox.models.model import INPUTS, ModelRun, reads_batches
from toolbox.reports.page import Told
from toolbox.runs.lineage import counting, telling
from toolbox.runs.provenance import Count, Record
from toolbox.tiles import products as tile_products
from toolbox.tiles import store as tile_store
from toolbox.tiles import work as tile_work
from toolbox.tiles.plan import TilePlan
from toolbox.tiles.products import Product, StoredSurvey
from toolbox.tiles.store import SIDE, FileBlock
from toolbox.tiles.work import Tile, TileJob
from toolbox.tiles.workers import DIED, Workers

BLOCK = 2_000_000  # points that are read and sorted at a time
SLACK, NEAR = 1 + 1e-9, 1e-6  # of the halo, and metres: what lies on its edge is not lost
MOST_TILES = 10**6  # more are taken for a mistake in the size
LISTED = 10  # problems and warnings that are listed


def reach_of(halo: float, metre: float) -> float:
    """A halo in coordinate units, a little wider, so that points on its edge are within."""
    return (halo * SLACK + NEAR) * metre


@dataclass(frozen=True)
class _Failed:
    """The result of a task that has failed twice."""

    why: str


class Crew:
    """Gives tasks to the workers of a run, and collects their results and failures.

    Attributes
    ----------
    job : what all passes have in common
    told : takes what steps say in words, and what they did not look at
    found : results so far, by step.output: numbers, summed over the tiles (None where they have no
        sum), and numbers and layers of the steps that ran on the whole survey
    counts : sizes of the layers of each step
    empty : why steps had nothing to do in some tiles
    done : passes whose tiles were run
    failed : the reason, for each tile that could not be run
    unreadable : the reason, for each file whose points could not be read or stored
    """

    def __init__(
        self, workers: Workers, id: str, work: Path, job: TileJob, plan: TilePlan, told: Told
    ) -> None:
        self.workers, self.id, self.work, self.job, self.plan = workers, id, work, job, plan
        self.told = told
        self.found: dict[str, Any] = {}
        self.counts: list[Count] = []
        self.empty: dict[str, None] = {}
        self.done: set[int] = set()
        self.failed: dict[Tile, str] = {}
        self.unreadable: dict[Path, str] = {}

    def folder(self, number: int) -> Path:
        """The folder of a pass."""
        return self.work / str(number)

    def read(self, name: str) -> Any:
        """Join a result of the tiles in memory."""
        return tile_products.read(self.folder(self.plan.keep[name]), name)

    def all(
        self,
        task: Callable[..., Any],
        job: Any,
        calls: list[tuple[Any, ...]],
        ctx: Context,
        what: str,
    ) -> list[Any]:
        """Run a task for each tuple of arguments: its results, or `_Failed` after a second try.

        Parameters
        ----------
        job : shared with the workers, which give it to each task
        what : the calls are, in the text that says how many are done
        """
        futures = [self.workers.submit(task, job, *call) for call in calls]
        try:
            said = 0
            while left := sum(not future.done() for future in futures):
                ctx.progress(1 - left / len(futures))
                if (done := len(futures) - left) != said:
                    ctx.stage(f"{what}: {done} of {len(futures)} done")
                    said = done
                time.sleep(0.05)
        except BaseException:
            self.workers.cancel(futures)
            raise
        ctx.progress(1.0)
        return [_Failed(_reason(f.exception())) if f.exception() else f.result() for f in futures]

    # Points

    def split(self, rim: float, ctx: Context) -> dict[Tile, list[FileBlock]]:
        """Store all points, and give the stored blocks with points in or near each tile.

        Parameters
        ----------
        rim : distance beyond the points to which a result may extend, in coordinate units
        """
        blocks: list[FileBlock] = []
        for source, survey in self.job.surveys.items():
            for number, file in enumerate(survey.files):
                try:
                    blocks += tile_store.blocks(source, survey, number, BLOCK)
                except DataError as err:
                    self.unreadable[file.path] = str(err)
        tables = self.all(
            tile_work.split,
            self._shared(0),
            [(block,) for block in blocks],
            ctx,
            "Parts of files read",
        )
        reach = math.ceil(self.job.halo * SIDE / self.job.grid.size)
        near: dict[Tile, list[FileBlock]] = {}
        core: set[Tile] = set()
        for block, table in zip(blocks, tables, strict=True):
            if isinstance(table, _Failed):
                path = self.job.surveys[block.source].files[block.file].path
                self.unreadable[path] = table.why
                continue
            for tile in _tiles(table, reach):
                near.setdefault(tile, []).append(block)
            core |= _tiles(table, 0) if block.source == self.job.first else set()
        self._give_up(near.keys() | core)
        if not core:
            return {}
        if len(core) > MOST_TILES:
            raise DataError(f"{self.id}: {len(core)} tiles are too many; take larger ones")
        xmin, ymin, _, xmax, ymax, _ = self.job.surveys[self.job.first].bounds
        corners = np.array([[xmin - rim, ymin - rim], [xmax + rim, ymax + rim]])
        edge = map(tuple, (self.job.grid.buckets(corners) // SIDE).tolist()) if rim else ()
        rows, cols = (range(min(n), max(n) + 1) for n in zip(*core, *edge, strict=True))
        # Also tiles without points among those that have some: a gap may be filled there.
        among = {t: b for t, b in near.items() if t[0] in rows and t[1] in cols}
        return {tile: b for tile, b in among.items() if tile not in self.failed}

    def _give_up(self, tiles: Iterable[Tile]) -> None:
        """Mark the tiles that need points of unreadable files as failed."""
        survey_files = [file for survey in self.job.surveys.values() for file in survey.files]
        lost = [file for file in survey_files if file.path in self.unreadable]
        for tile in tiles if lost else ():
            bounds = self.job.grid.bounds(tile, self.job.halo)
            for file in [file for file in lost if file.touches(bounds)]:
                self.failed[tile] = self.unreadable[file.path]

    # Tiles

    def run_pass(self, number: int, tiles: Mapping[Tile, list[FileBlock]], ctx: Context) -> None:
        """Run the local steps of a pass on all tiles, then its other steps on whole results."""
        one = self.plan.passes[number]
        if one.local:
            self._run_tiles(number, tiles, ctx.part(0, 0.7))
            self.done.add(number)
        if one.rest and not self.failures:
            self.found |= self._run_rest(number, ctx.part(0.7, 1))
        if not self.failures:
            for name in self.plan.spent(number):
                tile_products.remove(self.folder(self.plan.keep[name]), name)

    def _shared(self, number: int) -> Any:
        """The job of a pass, handed to the workers."""
        one, model, keep = self.plan.passes[number], self.plan.model, self.plan.keep
        needs = {need for name in one.local for need in model.steps[name].needs}
        earlier = {n for n in needs & keep.keys() if keep[n] < number}
        clouds = {n for n in earlier if model.between[n].kind.several}
        job = replace(
            self.job,
            folder=self.folder(number),
            steps=one.local,
            given={n: value for n, value in self.found.items() if n in needs}
            | {n: self.read(n) for n in earlier - clouds},
            before={n: self.folder(keep[n]) for n in sorted(clouds)},
            keep=one.keep,
            halo=reach_of(one.halo, self.job.surveys[self.job.first].metre),
        )
        return self.workers.share(job)

    def _run_tiles(self, number: int, tiles: Mapping[Tile, list[FileBlock]], ctx: Context) -> None:
        calls = [(tile, tuple(tiles[tile])) for tile in sorted(tiles)]
        results = self.all(tile_work.run_tile, self._shared(number), calls, ctx, "Tiles")
        said: dict[str, list[Tile]] = {}
        unseen: dict[str, list[Tile]] = {}
        numbers: dict[str, list[Any]] = {}
        counts: dict[tuple[str, str], int] = {}
        for (tile, _), result in zip(calls, results, strict=True):
            if isinstance(result, _Failed):
                self.failed[tile] = result.why
                continue
            for text in dict.fromkeys(result.said):
                said.setdefault(text, []).append(tile)
            for text in dict.fromkeys(result.unseen):
                unseen.setdefault(text, []).append(tile)
            self.empty |= dict.fromkeys(result.empty)
            for name, value in result.values.items():
                numbers.setdefault(name, []).append(value)
            for count in result.counts:
                key = count.step, count.name
                counts[key] = counts.get(key, 0) + count.count
        for text in _of_tiles(said):
            log.warning("%s", text)
        self.told.unseen += _of_tiles(unseen, len(calls))
        memory = max((r.memory for r in results if not isinstance(r, _Failed)), default=0)
        log.debug("%d tiles; a worker needed up to %d MB", len(calls), memory // 10**6)
        self.found |= {name: _sum(values) for name, values in numbers.items()}
        self.counts += [Count(*key, count) for key, count in counts.items()]

    def _run_rest(self, number: int, ctx: Context) -> dict[str, Any]:
        """Run the steps of a pass that need the whole survey or whole results."""
        one = self.plan.passes[number]
        model = self.plan.model
        rest = model.subset(one.rest)
        steps = rest.steps.values()
        needs = {need for step in steps for need in step.needs}
        clouds = {
            name: survey
            if reads_batches(steps, f"{INPUTS}.{name}")
            else survey.read(ctx=ctx.part(0, 0.1))
            for name, survey in self.job.surveys.items()
            if f"{INPUTS}.{name}" in needs
        }
        given = self.found | {
            name: StoredSurvey.of(self.folder(self.plan.keep[name]), name)
            if reads_batches(steps, name)
            else self.read(name)
            for name in needs & self.plan.keep.keys()
        }
        values = dict.fromkeys(model.sources) | dict(self.plan.settings) | self.job.layers | clouds
        runner = telling(self.told, counting(self.counts))
        run = ModelRun(rest, values, keep=one.gives, given=given, runner=runner)
        result = run.run(ctx.part(0.1, 1))
        return {name: getattr(result, name) for name in one.gives}

    # Products

    def write(self, products: list[Product], record: Record | None, ctx: Context) -> None:
        """Write products to the temporary paths where they are prepared."""
        self._check_there(products)
        folders = [self.folder(self.plan.keep[p.result]) for p in products]
        calls = [
            (folder, p.output, p.result, p.path, p.target.how, p.file, record)
            for folder, p in zip(folders, products, strict=True)
        ]
        job = self.workers.share(replace(self.job))  # without what is opened for it here
        done = self.all(tile_products.write, job, calls, ctx, "Products written")
        pairs = zip(products, done, strict=True)
        if wrong := {p.output: d.why for p, d in pairs if isinstance(d, _Failed)}:
            raise DataError(self.id, wrong)

    def _check_there(self, products: list[Product]) -> None:
        """Raise an error if no tile gave any cell of a raster; files of points may be empty."""
        missing = [
            product.output
            for product in products
            if self.plan.model.between[product.result].kind.is_gridded
            and not tile_products.pieces_of(
                self.folder(self.plan.keep[product.result]), product.result
            )
        ]
        if missing:
            why = "; ".join([*self.empty][:LISTED]) or "no tile has points"
            raise DataError(self.id, dict.fromkeys(missing, f"no tile has data for it ({why})"))

    @property
    def failures(self) -> bool:
        """Whether anything has gone wrong."""
        return bool(self.failed or self.unreadable)

    def complete(self) -> set[int]:
        """The indices of the files of the survey that no failed tile touches."""
        files = enumerate(self.job.surveys[self.job.first].files)
        boxes = [self.job.grid.bounds(tile) for tile in self.failed]
        lost = self.unreadable
        return {n for n, f in files if f.path not in lost and not any(map(f.touches, boxes))}

    def report(self) -> None:
        """Raise an error that lists the failures, if there are any."""
        if not self.failures:
            return
        where: dict[str, list[Tile]] = {}
        for tile in sorted(self.failed):
            where.setdefault(self.failed[tile], []).append(tile)
        lines = {str(path): why for path, why in list(self.unreadable.items())[:LISTED]}
        for why, tiles in list(where.items())[:LISTED]:
            lines[self._names(tiles)] = why
        if (more := len(where) - LISTED) > 0:
            lines["and"] = f"{more} more problems"
        lines["what to do"] = (
            f"mend the cause and run again with --resume; what is done is kept in {self.work}"
        )
        raise DataError(self.id, lines)

    def _names(self, tiles: list[Tile]) -> str:
        """Name the first of some tiles, with its bounds, and the number of the others."""
        box = ", ".join(f"{value:.10g}" for value in self.job.grid.bounds(tiles[0]))
        more = f" and {len(tiles) - 1} more tiles" if len(tiles) > 1 else ""
        return f"tile {tile_work.name_of(tiles[0])} ({box}){more}"


def _tiles(table: NDArray[np.int64], reach: int) -> set[Tile]:
    """The tiles that have one of some buckets within reach, which is a number of buckets.

    Parameters
    ----------
    table : of shape (m, 3): row, column and number of points of each bucket
    """
    low, high = (table[:, :2] - reach) // SIDE, (table[:, :2] + reach) // SIDE
    found: set[Tile] = set()
    for down in range(int((high - low).max(initial=0)) + 1):
        for right in range(int((high - low).max(initial=0)) + 1):
            tiles = np.minimum(low + np.array([down, right]), high)
            found |= set(map(tuple, np.unique(tiles, axis=0).tolist()))
    return found


def _of_tiles(texts: Mapping[str, list[Tile]], tiles: int = 0) -> list[str]:
    """The first of the texts, each with where it was said first, and in how many tiles more.

    Parameters
    ----------
    tiles : what so many tiles say holds everywhere, and needs no place; 0: all need it

    Examples
    --------
    >>> _of_tiles({"no shore": [(0, 1), (0, 2)]}, 2)
    ['no shore']
    """
    return [
        text
        if len(where) == tiles
        else f"tile {tile_work.name_of(where[0])}"
        + (f" and {len(where) - 1} more tiles" if len(where) > 1 else "")
        + f": {text}"
        for text, where in list(texts.items())[:LISTED]
    ]


def _sum(values: list[Any]) -> Any:
    """The sum of the numbers of all tiles; None if they are no counts and no shares."""
    if all(isinstance(value, Share) for value in values) or all(type(v) is int for v in values):
        return functools.reduce(operator.add, values)
    return None


def _reason(error: BaseException) -> str:
    if isinstance(error, ToolboxError):
        return str(error)
    if type(error).__name__ == "KilledWorker":  # of Dask
        return DIED
    return f"{type(error).__name__}: {error}"
