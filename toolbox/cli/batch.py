"""The verb ``batch``: runs a tool once for each row of a table."""

from __future__ import annotations

import csv
import io
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from toolbox import files
from toolbox.cli import arguments, history
from toolbox.cli.arguments import is_layer
from toolbox.cli.console import as_options, exit_code
from toolbox.context import Context, log
from toolbox.data import Table
from toolbox.errors import Cancelled, DataError, ParameterError, ToolboxError, nearest

DONE, FAILED = "done", "failed"
STATUS = ("status", "message", "seconds")  # columns of the result beside those of the table
SEVERAL = ";"  # between the values of a cell for a source or parameter that takes several
Row = Mapping[str, str]


@dataclass
class Batch:
    """A tool or model with the table of values for its runs.

    Attributes
    ----------
    id : of the tool or model
    described : its process description
    file : path of the table, whose cells by column are `rows`
    common : values for all rows, as `arguments.read` gives them; those of a row take precedence
    run : runs the tool with values, such as `execute.run`
    result : path of the result table, which is written after each row, if any
    done : the rows run so far, with status and numbers
    """

    id: str
    described: Mapping[str, Any]
    file: Path
    common: Mapping[str, Any]
    run: Callable[[Mapping[str, Any], Context], Mapping[str, Any]]
    result: Path | None = None
    done: list[dict[str, Any]] = field(default_factory=list)
    rows: list[Row] = field(init=False)

    def __post_init__(self) -> None:
        self.rows = read_rows(self.file)

    def check(self, *, overwrite: bool) -> None:
        """Check that all columns have a meaning and no file would be overwritten.

        Raises
        ------
        ParameterError
            All problems.
        """
        columns = list(dict.fromkeys(name for row in self.rows for name in row))
        known = _names(self.described)
        found = {c: f"is no column{nearest(c, known)}" for c in columns if c not in known}
        for name in self.common.keys() - set(known):
            found[name] = f"unknown parameter{nearest(name, known)}"
        found |= {c: "stands in the table and in the command" for c in columns if c in self.common}
        outputs = {*self.described["outputs"], *self.described.get("between", {})}
        if shared := outputs & self.common.keys() if len(self.rows) > 1 else set():
            text = "would be written by each row; give it a column"
            found |= dict.fromkeys(shared, text)
        paths = Counter(
            Path(path).resolve()
            for row in self.rows
            for name, path in row.items()
            if name in outputs
        )
        if twice := [path for path, times in paths.items() if times > 1]:
            found["rows"] = f"{paths[twice[0]]} of them write {twice[0]}"
        if self.result:
            named, suffixes = {"result": self.result}, {"result": Table.SUFFIXES}
            own_files = {"result": Table.own_files}
            found |= files.problems(named, suffixes, own_files, [self.file], overwrite=overwrite)
        if found:
            raise ParameterError(self.id, dict(sorted(found.items())))

    def go(self, ctx: Context) -> None:
        """Run all rows; a row that fails is noted in the result, and does not stop the others.

        Raises
        ------
        Cancelled
            The rows before are in `done` and in the result table.
        """
        for number, row in enumerate(self.rows):
            part = ctx.part(number / len(self.rows), (number + 1) / len(self.rows))
            part.progress(0.0)
            outcome = self._outcome(row, part)
            log.info("row %d of %d: %s", number + 1, len(self.rows), _ended(outcome))
            self.done.append({**row, **outcome})
            self._write()
        ctx.progress(1.0)

    def _outcome(self, row: Row, ctx: Context) -> dict[str, Any]:
        """Run a row: its status, message and seconds, and the numbers that the tool gave."""
        started = time.monotonic()
        values: Mapping[str, Any] = row
        outputs: Mapping[str, Any] = {}
        status, message, code = DONE, "", 0
        try:
            said = {**self.common, **{name: self._cell(name, text) for name, text in row.items()}}
            values = arguments.merged(self.described, {}, said)
            outputs = self.run(values, ctx)
        except Cancelled:
            raise
        except Exception as err:  # noqa: BLE001  the other rows are not to suffer
            status, message = FAILED, _message(err)
            code = exit_code(err)
        seconds = round(time.monotonic() - started, 2)
        history.add(self.id, self.described, values, outputs, seconds=seconds, code=code)
        numbers = {n: v for n, v in outputs.items() if isinstance(v, int | float | str)}
        return {**dict(zip(STATUS, (status, message, seconds), strict=True)), **numbers}

    def _cell(self, name: str, text: str) -> Any:
        """The text of a cell, or the list of values in it."""
        says = self.described["inputs"].get(name, {"maxOccurs": 1})
        several = says["maxOccurs"] != 1 or _is_points(says)
        items = [item.strip() for item in text.split(SEVERAL) if item.strip()] if several else []
        return items if len(items) > 1 else text

    @property
    def table(self) -> Table:
        """The result table: for each run its cells, its status and its numbers."""
        columns = dict.fromkeys([*(n for row in self.rows for n in row), *STATUS])
        return Table.from_rows([{**columns, **row} for row in self.done])

    @property
    def failed(self) -> int:
        """The number of rows that failed."""
        return sum(row["status"] == FAILED for row in self.done)

    def _write(self) -> None:
        """Write the result table with all rows so far."""
        if self.result is None:
            return
        try:
            with files.staged({self.result: Table.own_files}, overwrite=True) as paths:
                self.table.save(paths[self.result])
        except OSError as err:
            raise DataError(self.id, {"result": f"cannot be written: {err}"}) from err


def read_rows(path: Path) -> list[Row]:
    """Read the rows of a CSV file in UTF-8, with comma or semicolon; empty cells are left out.

    Raises
    ------
    ParameterError
        It cannot be read, or a row has more cells than there are columns.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        head = text.partition("\n")[0]
        separator = ";" if head.count(";") > head.count(",") else ","
        lines = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
        cells = [line for line in lines if any(line)]
    except (OSError, ValueError, csv.Error) as err:
        raise ParameterError("batch", {"table": f"{path} cannot be read: {err}"}) from None
    if len(cells) < 2:
        raise ParameterError("batch", {"table": f"{path} has no rows"})
    names, *rows = [[cell.strip() for cell in row] for row in cells]
    if twice := [name for name in names if not name or names.count(name) > 1]:
        raise ParameterError("batch", {"table": f"{path}: column {twice[0]!r} is empty or twice"})
    if long := [row for row in rows if len(row) > len(names)]:
        text = f"{path}: {long[0]} has more cells than the {len(names)} columns"
        raise ParameterError("batch", {"table": text})
    return [{n: c for n, c in zip(names, row, strict=False) if c} for row in rows]


def _names(described: Mapping[str, Any]) -> list[str]:
    """The allowed names of columns: inputs and outputs, and options of their layers."""
    sections = ("inputs", "outputs", "between")
    return [name for section in sections for name in _names_of(described, section)]


def _names_of(described: Mapping[str, Any], section: str) -> Iterator[str]:
    for name, says in described.get(section, {}).items():
        if section == "inputs" or is_layer(says["schema"]):
            yield name
            yield from (f"{name}.{m['title']}" for m in says["metadata"] if m["role"] == "option")


def _is_points(says: Mapping[str, Any]) -> bool:
    """Whether an input is a point cloud, which can be read from several files."""
    types = [meta["value"] for meta in says.get("metadata", ()) if meta["role"] == "type"]
    return any(kind in arguments.SEVERAL for kind in types)


def _message(err: Exception) -> str:
    """The text of an error in one line."""
    text = as_options(str(err)) if isinstance(err, ToolboxError) else f"{type(err).__name__}: {err}"
    return "; ".join(line.strip() for line in text.splitlines())


def _ended(outcome: Mapping[str, Any]) -> str:
    return f"{outcome['status']} {outcome['message']}".strip()
