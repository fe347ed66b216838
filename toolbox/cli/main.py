"""The command line: demo, list, describe, run, batch, model, qgis, info, history, and so on.

All that comes before a run is read from the process descriptions, so that `list`, `describe` and
`--help` answer at once and import no numerical library.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import shutil
import stat
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from toolbox import __version__, catalog, language
from toolbox.cli import arguments, history, listing
from toolbox.cli import metadata as metadata_cli
from toolbox.cli import models as model_cli
from toolbox.cli import qgis as qgis_cli
from toolbox.cli import serve as serve_cli
from toolbox.cli.console import Console, Events, Unwritable, exit_code
from toolbox.cli.stopping import stoppable
from toolbox.errors import Cancelled, DataError, ParameterError
from toolbox.json_text import json_text
from toolbox.places import ALGORITHMS
from toolbox.shown import DELIVER, PAGE, SHOWN
from toolbox.tiles.tiling import Tiling

CLOSED_PIPE = 141  # the exit code that shells give a program that writes to nobody: 128 + SIGPIPE


def main(argv: list[str] | None = None) -> int:
    """Run one verb and return the exit code.

    0 success, 2 wrong input, 3 unreadable or unsuitable data, 130 cancelled, 141 the reader
    of standard output has gone, 1 a mistake of ours.
    """
    if closed := [name for name in ("stdout", "stderr") if getattr(sys, name) is None]:
        text = f"error: {' and '.join(closed)} closed; direct it to a file, or to {os.devnull}"
        print(text, file=sys.stderr or sys.stdout)
        return ParameterError.exit_code
    for stream in (sys.stdout, sys.stderr):
        _never_failing(stream)
    said = sys.argv[1:] if argv is None else argv
    if untold := language.missing():
        print(untold, file=sys.stderr)
    if not said:
        print(listing.guide())
        return 0
    if said[0] == "help":
        said = _help(said[1:])
    if "." in said[0] and said[0] in catalog.own_ids():
        text = language.text("{id} is a tool; did you mean 'run {id}'?").format(id=said[0])
        return Console().error(ParameterError(text))
    try:
        first = {"run": _run, "batch": _batch, "demo": _demo}.get(said[0] if said else "")
        code = first(said[1:]) if first else _other(said)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader, such as `head`, has seen enough
        code = CLOSED_PIPE
    except (OSError, Unwritable) as err:
        code = Console().error(
            err
            if isinstance(err, Unwritable)
            else Unwritable(f"standard output cannot be written: {err}")
        )
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the end would fail again
    return code


def _help(said: list[str]) -> list[str]:
    """What to run for ``help``, of a verb or a tool.

    >>> _help([]), _help(["list"]), _help(["ground.csf", "all"])
    (['--help'], ['list', '--help'], ['run', 'ground.csf', '--help', 'all'])
    """
    if not said:
        return ["--help"]
    return [said[0], "--help"] if "." not in said[0] else ["run", said[0], "--help", *said[1:]]


def _never_failing(stream: object) -> None:
    """Write letters that the encoding has not as codes, or a run would end in an error there.

    Windows gives a pipe the encoding of the system, which has not all letters of names of files.
    """
    if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
        stream.reconfigure(errors="backslashreplace")


def _other(said: list[str]) -> int:
    args = _parser().parse_args(said)
    verbs = {"list": _list, "describe": _describe, "info": _info, "history": _history}
    verbs |= {
        "provenance": _provenance,
        "metadata": metadata_cli.run,
        "replay": _replay,
        "warm": _warm,
        "model": model_cli.run,
        "qgis": qgis_cli.run,
        "serve": serve_cli.run,
    }
    verb = verbs[args.verb]
    console = Console(as_json=args.json)
    try:
        verb(args, console)
    except BrokenPipeError:
        raise
    except Exception as err:  # noqa: BLE001  the outermost edge: every error becomes an exit code
        return console.error(err)
    return 0


def _parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(
        "python -m toolbox", description="Geoprocessing tools for LiDAR.", allow_abbrev=False
    )
    top.add_argument("--version", action="version", version=f"lidar-toolbox {__version__}")
    verbs = top.add_subparsers(dest="verb", required=True)
    help_of = {
        "demo": language.text(
            "make a small survey, classify it, grid it, and say how good the result is"
        ),
        "list": language.text("show all tools, or those that speak of a word: list dtm"),
        "describe": language.text("show what a tool takes and gives"),
        "run": language.text("run a tool: run ID --name value ..."),
        "batch": language.text(
            "run a tool for each row: batch ID TABLE.csv [--result OUT.csv] --name value ..."
        ),
        "model": language.text("check, show or begin a model"),
        "qgis": language.text(
            "put the tools into QGIS, pack the plugin, or see whether all is well"
        ),
        "serve": language.text("offer the tools as an OGC API - Processes"),
        "info": language.text("show what a file holds, or all files of a survey of points"),
        "history": language.text("show the runs of this user"),
        "provenance": language.text("show how a file was made"),
        "metadata": language.text("write what catalogues ask of a file beside it: ISO 19115"),
        "replay": language.text("make a file again, and say whether it is the same"),
        "warm": language.text(
            "compile ahead, so that no later command waits for it: once after installing"
        ),
    }
    made = {
        verb: verbs.add_parser(verb, help=text, description=text, allow_abbrev=False)
        for verb, text in help_of.items()
    }
    made["demo"].add_argument("--folder", type=Path, default=Path("demo-out"), help="for its files")
    text = "show only tools that speak of it, such as dtm"
    made["list"].add_argument("word", nargs="*", help=text)
    made["describe"].add_argument("id")
    made["info"].add_argument("file", nargs="+")
    arguments.add_assumed(made["info"])
    made["history"].add_argument("--limit", type=int, default=20, help="number of runs (20)")
    made["provenance"].add_argument("file")
    metadata_cli.declare(made["metadata"])
    made["replay"].add_argument("file")
    text = "folder of inputs or of the model, if not beside the file; may be said again"
    made["replay"].add_argument("--inputs", action="append", default=[], help=text)
    model_cli.declare(made["model"])
    qgis_cli.declare(made["qgis"])
    serve_cli.declare(made["serve"])
    for verb in made.keys() - {"run", "batch", "demo", "model", "qgis"}:
        made[verb].add_argument("--json", action="store_true", help="print JSON")
    return top


def _list(args: argparse.Namespace, _: Console) -> None:
    tools = listing.matching(catalog.summaries(), args.word)
    if args.json:
        print(json_text(tools, indent=2))
    elif tools:
        tools = [language.summary(tool) for tool in tools]
        print("\n".join(listing.lines(tools, listing.width_of(sys.stdout))))
    else:
        raise ParameterError("list", {"word": f"no tool speaks of {' '.join(args.word)!r}"})


def _describe(args: argparse.Namespace, _: Console) -> None:
    described = catalog.describe(args.id)
    if args.json:
        print(json_text(described, indent=2))
    else:
        arguments.parser(language.described(described)).print_help()


def _info(args: argparse.Namespace, console: Console) -> None:
    from toolbox.cli.info import describe_files
    from toolbox.cli.tables import properties

    with console.progress() as report:
        tables = stoppable(
            lambda ctx: describe_files(args.file, ctx, args.assume_crs),
            report,
            farewell=lambda: console.error(Cancelled()),
        )
    if console.as_json:
        print(json_text([row for table in tables for row in table.rows()], indent=2))
    elif sys.stdout.isatty() or "COLUMNS" in os.environ:
        wide = shutil.get_terminal_size().columns
        print("\n\n".join(properties(table.frame, wide) for table in tables))
    else:  # programs find each property in a line
        print("\n\n".join(table.text() for table in tables))


def _history(args: argparse.Namespace, _: Console) -> None:
    if args.limit < 0:
        raise ParameterError("history", {"limit": f"must be >= 0, got {args.limit}"})
    entries = list(history.entries())[-args.limit :] if args.limit else []
    if args.json:
        print(json_text(entries, indent=2))
        return
    for entry in entries:
        print(history.text(entry))


def _provenance(args: argparse.Namespace, _: Console) -> None:
    from toolbox.runs.provenance import read

    record = read(args.file)
    if record is None:
        raise DataError(f"{args.file} carries no record of how it was made")
    print(json_text(json.loads(record.to_json()), indent=2) if args.json else record.text())


def _replay(args: argparse.Namespace, console: Console) -> None:
    def work(ctx: Any) -> list[str]:
        from toolbox.cli.replay import replay

        return replay(args.file, inputs=[Path(one) for one in args.inputs], ctx=ctx)

    with console.progress() as report:
        found = stoppable(work, report, farewell=lambda: console.error(Cancelled()))
    if args.json:
        print(json_text({"file": args.file, "same": not found, "differences": found}, indent=2))
    if found:
        listed = "".join(f"\n  {text}" for text in found)
        raise DataError(f"{args.file} is not what its record makes now:{listed}")
    if not args.json:
        print(f"{args.file}: the same")


def _warm(args: argparse.Namespace, console: Console) -> None:
    def work(ctx: Any) -> None:
        from toolbox.cli.warm import warm

        warm(ctx)

    start = time.perf_counter()
    with console.progress() as report:
        stoppable(work, report, farewell=lambda: console.error(Cancelled()))
    seconds = round(time.perf_counter() - start, 1)
    print(json_text({"seconds": seconds}) if args.json else f"compiled in {seconds} s")


def _run(said: list[str]) -> int:
    console = _console(said)
    try:
        _need_tool("run", said)
        described = catalog.describe(said[0])
        said_values, general = arguments.read({**described, "called": said[0]}, said[1:])
        pipe, params = _params(general)
        values = arguments.merged(described, params, said_values)
        if not console.as_json and not isinstance(console, Events):
            _tell_unsaved(described, values, general, console)
            _tell_compiling(console)
        with _kept(said[0], described, values, general) as outputs:
            made = _execute(said[0], values, general, console, pipe)
            outputs.update(made)
        console.result(described, made)
    except BrokenPipeError:
        raise
    except Exception as err:  # noqa: BLE001  the outermost edge: every error becomes an exit code
        return console.error(err)
    return 0


def _tell_unsaved(
    described: Mapping[str, Any],
    values: Mapping[str, Any],
    general: Mapping[str, Any],
    console: Console,
) -> None:
    """Say before the work that none of its layers will be saved; tables are printed."""
    written = described["outputs"].keys() | described.get("between", {}).keys()
    layers = [
        name
        for name, field in described["outputs"].items()
        if arguments.is_layer(field["schema"]) and not _is_printed(field["schema"])
    ]
    if layers and not written & values.keys() and not SHOWN & general.keys():
        text = language.text("nothing will be saved; to keep a result: --{name} PATH")
        console.message("info", text.format(name=layers[0]))


def _tell_compiling(console: Console) -> None:
    """Say why the first command takes longer, on an installation that has compiled nothing."""
    kept = Path(os.environ.get("NUMBA_CACHE_DIR") or ALGORITHMS)
    if not next(kept.rglob("*.nbi"), None):
        console.message("info", language.text("compiling loops, once: this may take a minute"))


def _need_tool(verb: str, said: list[str]) -> None:
    if not said or said[0].startswith("-"):
        if {"-h", "--help"} & set(said):
            _parser().parse_args([verb, "--help"])
        raise ParameterError(f"{verb}: which tool? 'list' shows them all")


def _demo(said: list[str]) -> int:
    from toolbox.cli import demo

    folder = _parser().parse_args(["demo", *said]).folder
    try:
        return demo.show(folder, _run)
    except OSError as err:
        return Console().error(ParameterError("demo", {"folder": f"cannot be made: {err}"}))


def _batch(said: list[str]) -> int:
    """Run a tool for each row of a table; the exit code is 3 if a row has failed."""
    console = _console(said)
    try:
        _need_tool("batch", said)
        described = catalog.describe(said[0])
        if len(said) < 2 or (said[1].startswith("-") and not {"-h", "--help"} & set(said)):
            raise ParameterError("batch: which table? batch ID TABLE.csv ...")
        result, rest = _result(said[1:] if said[1].startswith("-") else said[2:])
        values, general = arguments.read(described, rest)
        if shown := (SHOWN | arguments.PROJECT.keys()) & general.keys():
            problems = dict.fromkeys(sorted(shown), "would be written by each row")
            raise ParameterError("batch", problems)
        pipe, params = _params(general)
        common = arguments.merged(described, params, values)

        def run_row(values: Mapping[str, Any], ctx: Any) -> dict[str, Any]:
            return _work(said[0], values, general, ctx)

        def work(ctx: Any) -> Any:
            from toolbox.cli.batch import Batch

            runs = Batch(said[0], described, Path(said[1]), common, run_row, result)
            runs.check(overwrite="overwrite" in general)
            runs.go(ctx)
            return runs

        with console.progress() as report:
            runs = stoppable(work, report, pipe, lambda: console.error(Cancelled()))
        outputs: dict[str, Any] = {"result": result or runs.table}
        console.result({"id": said[0], "outputs": {}}, outputs | {"failed": runs.failed})
    except BrokenPipeError:
        raise
    except Exception as err:  # noqa: BLE001  the outermost edge: every error becomes an exit code
        return console.error(err)
    return DataError.exit_code if runs.failed else 0


def _result(said: list[str]) -> tuple[Path | None, list[str]]:
    """The path of the result table, and the other words."""
    parser = argparse.ArgumentParser("toolbox batch", add_help=False, allow_abbrev=False)
    parser.add_argument("--result", type=Path)
    found, rest = parser.parse_known_args(said)
    return found.result, rest


def _console(said: Iterable[str]) -> Console:
    """Choose the console before the arguments are read, so that it also reports their errors."""
    words = set(said)
    level = "quiet" if "--quiet" in words else "verbose" if "--verbose" in words else "normal"
    if words & {"--events", "--events=jsonl"}:
        return Events(level)
    return Console(level, as_json="--json" in words)


def _params(general: Mapping[str, Any]) -> tuple[IO[bytes] | None, dict[str, Any]]:
    """Standard input, if its end should stop the run, and the values from --params."""
    name, events = general.get("params"), "events" in general
    stdin = sys.stdin.buffer if sys.stdin else None
    if name == "-" and stdin:
        # With events the caller keeps the pipe open after one line, and closes it to stop the run.
        text = (stdin.readline() if events else stdin.read()).decode(errors="replace")
        pipe = stdin if events and _is_pipe(stdin) else None
        return pipe, arguments.mapping(text, "standard input")
    pipe = stdin if events and _is_pipe(stdin) else None
    if not name:
        return pipe, {}
    try:
        return pipe, arguments.mapping(Path(name).read_text(encoding="utf-8"), name)
    except (OSError, UnicodeDecodeError) as err:
        raise ParameterError("run", {"params": f"cannot read {name}: {err}"}) from None


def _is_pipe(stdin: IO[bytes] | None) -> bool:
    """Whether standard input is a pipe from a program; a file or /dev/null would end at once."""
    mode = os.fstat(stdin.fileno()).st_mode if stdin else 0
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)


@contextmanager
def _kept(
    tool: str, described: Mapping[str, Any], values: Mapping[str, Any], general: Mapping[str, Any]
) -> Iterator[dict[str, Any]]:
    """Add the run inside this context to the history, whether it succeeds or fails."""
    outputs: dict[str, Any] = {}
    started, code = time.monotonic(), 0
    how = ("assume_crs", "tile", "memory", "workers", *SHOWN)
    more = {name: general[name] for name in how if name in general}
    try:
        yield outputs
    except BaseException as err:
        code = exit_code(err)
        raise
    finally:
        seconds = time.monotonic() - started
        history.add(tool, described, {**values, **more}, outputs, seconds=seconds, code=code)


def _execute(
    id: str,
    values: Mapping[str, Any],
    general: Mapping[str, Any],
    console: Console,
    pipe: IO[bytes] | None,
) -> dict[str, Any]:
    with console.progress() as report:
        return stoppable(
            lambda ctx: _work(id, values, general, ctx),
            report,
            pipe,
            lambda: console.error(Cancelled()),
            console.stage,
        )


def _work(
    id: str, values: Mapping[str, Any], general: Mapping[str, Any], ctx: Any
) -> dict[str, Any]:
    from toolbox.execute import run  # in the job's thread: Ctrl-C also stops slow imports

    shown = {name: general[name] for name in sorted(SHOWN & general.keys())}
    return run(
        id,
        _titled(id, {**values, **shown}, arguments.of_project(general)),
        overwrite="overwrite" in general,
        assume_crs=general.get("assume_crs"),
        tiling=Tiling.parse(general),
        resume="resume" in general,
        ctx=ctx,
    )


def _titled(id: str, values: dict[str, Any], project: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a run with what is said of the project for each report that is written.

    Raises
    ------
    ParameterError
        It is said, and no report is written.
    """
    described = catalog.describe(id)
    fields = {**described["outputs"], **described.get("between", {})}
    reports = {
        PAGE,
        DELIVER,
        *(n for n, f in fields.items() if _is_report(f["schema"])),
    } & values.keys()
    if project and not reports:
        problems = dict.fromkeys(project, "is for a report, and none is written; give --page")
        raise ParameterError(id, problems)
    for name in reports:
        given = values[name]
        own = given if isinstance(given, Mapping) else {"path": given}
        values[name] = {**project, **own} if project else given
    return values


def _is_printed(schema: Mapping[str, Any]) -> bool:
    return schema.get("items", schema).get("contentMediaType") in ("text/csv", "text/html")


def _is_report(schema: Mapping[str, Any]) -> bool:
    return bool(schema.get("contentMediaType") == "text/html")
