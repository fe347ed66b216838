"""The command line: list, describe, run, info.

Everything before a run is served from the process descriptions, so that `list`, `describe` and
`--help` answer at once and import no numerical library.
"""

from __future__ import annotations

import argparse
import json
import os
import stat
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

from toolbox import __version__, arguments, catalog
from toolbox.console import Console, Events
from toolbox.errors import Cancelled, ParameterError
from toolbox.stopping import stoppable


def main(argv: list[str] | None = None) -> int:
    """Run one verb and return the exit code.

    0 worked, 2 wrong input, 3 unreadable or unsuitable data, 130 cancelled, 1 a mistake of ours.
    """
    said = sys.argv[1:] if argv is None else argv
    try:
        code = _run(said[1:]) if said[:1] == ["run"] else _other(said)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return code


def _other(said: list[str]) -> int:
    args = _parser().parse_args(said)
    verb = {"list": _list, "describe": _describe, "info": _info}[args.verb]
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
        "toolbox", description="Geoprocessing tools for LiDAR.", allow_abbrev=False
    )
    top.add_argument("--version", action="version", version=f"lidar-toolbox {__version__}")
    verbs = top.add_subparsers(dest="verb", required=True)
    help_of = {
        "list": "show all tools",
        "describe": "show what a tool takes and gives",
        "run": "run a tool: run ID --name value ...",
        "info": "show what a file holds",
    }
    made = {
        verb: verbs.add_parser(verb, help=text, description=text, allow_abbrev=False)
        for verb, text in help_of.items()
    }
    made["describe"].add_argument("id")
    made["info"].add_argument("file")
    for verb in ("list", "describe", "info"):
        made[verb].add_argument("--json", action="store_true", help="print JSON")
    return top


def _list(args: argparse.Namespace, _: Console) -> None:
    tools = catalog.summaries()
    if args.json:
        print(json.dumps(tools, indent=2))
        return
    width = max(len(tool["id"]) for tool in tools)
    for tool in tools:
        print(f"{tool['id']:{width}}  {tool['title']}")


def _describe(args: argparse.Namespace, _: Console) -> None:
    described = catalog.describe(args.id)
    if args.json:
        print(json.dumps(described, indent=2))
    else:
        arguments.parser(described).print_help()


def _info(args: argparse.Namespace, console: Console) -> None:
    from toolbox.info import describe_file

    with console.progress() as report:
        table = stoppable(
            lambda ctx: describe_file(Path(args.file), ctx),
            report,
            farewell=lambda: console.error(Cancelled()),
        )
    print(json.dumps(table.records(), indent=2) if console.as_json else table.text())


def _run(said: list[str]) -> int:
    console = _console(said)
    try:
        if not said or said[0].startswith("-"):
            if {"-h", "--help"} & set(said):
                _parser().parse_args(["run", "--help"])
            raise ParameterError("run: which tool? 'list' shows them all")
        described = catalog.describe(said[0])
        said_values, general = arguments.read(described, said[1:])
        pipe, params = _params(general)
        values = arguments.merged(params, said_values, described["id"])
        outputs = _execute(described["id"], values, general, console, pipe)
        console.result(described, outputs)
    except BrokenPipeError:
        raise
    except Exception as err:  # noqa: BLE001  the outermost edge: every error becomes an exit code
        return console.error(err)
    return 0


def _console(said: Iterable[str]) -> Console:
    """Chosen before the arguments are read, so that their errors go the right way too."""
    words = set(said)
    level = "quiet" if "--quiet" in words else "verbose" if "--verbose" in words else "normal"
    if words & {"--events", "--events=jsonl"}:
        return Events(level)
    return Console(level, as_json="--json" in words)


def _params(general: Mapping[str, Any]) -> tuple[IO[bytes] | None, dict[str, Any]]:
    """Standard input if its end should stop the run, and the values from --params."""
    name, events = general.get("params"), "events" in general
    stdin = sys.stdin.buffer if sys.stdin else None
    if name == "-" and stdin:
        # With events our caller keeps the pipe open after one line, and ends it to stop us.
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
    """Whether a program holds the other end; a file or /dev/null would end at once."""
    mode = os.fstat(stdin.fileno()).st_mode if stdin else 0
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)


def _execute(
    id: str,
    values: Mapping[str, Any],
    general: Mapping[str, Any],
    console: Console,
    pipe: IO[bytes] | None,
) -> dict[str, Any]:
    def work(ctx: Any) -> dict[str, Any]:
        from toolbox.execute import run  # in the job's thread: Ctrl-C also stops slow imports

        return run(
            id,
            values,
            overwrite="overwrite" in general,
            assume_crs=general.get("assume_crs"),
            picture=general.get("picture"),
            ctx=ctx,
        )

    with console.progress() as report:
        return stoppable(work, report, pipe, lambda: console.error(Cancelled()))
