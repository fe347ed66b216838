"""The options of ``run``, made from the process description of the tool."""

from __future__ import annotations

import argparse
import re
import shutil
import textwrap
from collections.abc import Iterable, Mapping
from typing import Any, NoReturn

from toolbox import language, renamed
from toolbox.errors import ParameterError
from toolbox.labels import labelled
from toolbox.models import documents

Description = Mapping[str, Any]
SHAPES = {  # placeholders in --help for values of several numbers
    "extent": "XMIN,YMIN,XMAX,YMAX",
    "position": "X,Y",
    "direction": "X,Y,Z",
    "range": "LOW,HIGH",
}
_KEPT = "\0"  # stands for a blank at which no line is broken
HELP = {"-h", "--help"}
ALL = "all"  # what to say after them to see every option
SEVERAL = ("PointCloud", "Survey")  # types of layers that can be read from several files


class _Parser(argparse.ArgumentParser):
    """A parser that raises ParameterError for what it cannot read."""

    def error(self, message: str) -> NoReturn:
        text = re.sub(
            "argument (.*): ignored explicit argument", r"\1 takes no value, got", message
        )
        raise ParameterError(self.prog, {"command line": text})


class _Formatter(argparse.RawDescriptionHelpFormatter):
    """Help whose first word is translated too."""

    def add_usage(self, usage: Any, actions: Any, groups: Any, prefix: str | None = None) -> None:
        super().add_usage(usage, actions, groups, prefix or f"{language.text('usage')}: ")


def parser(described: Description, *, whole: bool = True) -> argparse.ArgumentParser:
    """Make the parser of one tool; each value is appended to a list under its name.

    Parameters
    ----------
    whole : with all options; else with those that most runs need, for a help of a page or two
    """
    made = _Parser(
        described["id"],
        usage=_usage(described),
        description=f"{described['title']}\n\n{described['description']}",
        epilog=_examples(described),
        formatter_class=_Formatter,
        add_help=False,
        allow_abbrev=False,  # else --windo would quietly be taken for --window
        argument_default=argparse.SUPPRESS,
    )
    inputs = made.add_argument_group(language.text("inputs"))
    for name, field in described["inputs"].items():
        _add_input(inputs, name, field)
        _add_options(inputs, name, field if whole else {})
    results = made.add_argument_group(language.text("outputs"))
    for name, field in described["outputs"].items():
        if is_layer(field["schema"]):
            text = labelled(name, field["title"], field["description"])
            _add(results, name, metavar="PATH", help=text)
            _add_options(results, name, field if whole else {})
    if whole:
        kept = made.add_argument_group(language.text("results of steps"))
        for name, field in described.get("between", {}).items():
            if is_layer(field["schema"]):
                _add(kept, name, metavar="PATH", help=field["description"])
                _add_options(kept, name, field)
    general = made.add_argument_group(language.text("how to run"))
    _add_usual(general, described.get("deliver", ()))
    if whole:
        _add_rest(general)
    return made


def _usage(described: Description) -> str:
    """What must be given; all options would fill twenty lines, and stand below with their help."""
    must = [name for name, field in described["inputs"].items() if field.get("minOccurs", 1)]
    called = described.get("called", described["id"])
    return " ".join([f"python -m toolbox run {called}", *(f"--{n} ..." for n in must), "[options]"])


def _examples(described: Description) -> str | None:
    """The examples of a tool, on lines that the terminal holds and a shell takes as they are."""
    told = described.get("metadata", ())
    commands = [meta["value"] for meta in told if meta["role"] == "example"]
    if not commands:
        return None
    return "\n".join([f"{language.text('examples')}:", *map(_on_lines, commands)])


def _on_lines(command: str) -> str:
    """A command on several lines, if it must be; an option and its values stay together."""
    words = command.replace(" ", _KEPT).replace(f"{_KEPT}--", " --")
    wide = shutil.get_terminal_size().columns - len(" \\")
    lines = textwrap.wrap(
        words,
        wide,
        initial_indent="  ",
        subsequent_indent="      ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return " \\\n".join(lines).replace(_KEPT, " ")


def is_layer(schema: Mapping[str, Any]) -> bool:
    """Whether an output is a layer, or several, which are written to files."""
    return bool(schema.get("items", schema).get("format") == "uri-reference")


def _add_input(group: Any, name: str, field: Description) -> None:
    says = {meta["role"]: meta["value"] for meta in field["metadata"]}
    schema = field["schema"]
    said = [says.get("rule", ""), _unit(says), says.get("coordinates", "")]
    rule = f" [{'; '.join(filter(None, said))}]" if any(said) else ""
    defaults = "; ".join(
        filter(None, (str(schema.get("default", "")), language.told(says.get("feet", ""))))
    )
    default = f" (default {defaults})" if defaults else ""
    how: dict[str, Any] = {}
    if field["maxOccurs"] != 1 or says["type"] in SEVERAL:
        how = {"nargs": "+"}
    elif schema.get("type") == "boolean":
        how = {"nargs": "?", "const": "true"}
    kind = SHAPES.get(says["type"], says["type"].upper().replace(" ", "_"))
    text = labelled(name, field["title"], field["description"])
    _add(group, name, metavar=kind, help=text + rule + default, **how)


def _unit(says: Mapping[str, str]) -> str:
    """The unit of a value, unless its rule has said it, or it has none."""
    unit = says.get("unit", "1")
    return "" if unit == "1" or says.get("rule", "").endswith(f" {unit}") else unit


def _add_options(group: Any, name: str, field: Description) -> None:
    """Add the options of reading or writing a layer: ``--points.columns x,y,z,label``."""
    for meta in field.get("metadata", ()):
        if meta["role"] == "option":
            option = meta["title"]
            _add(group, f"{name}.{option}", metavar=option.upper(), help=meta["value"])


def _add(group: Any, name: str, *, help: str, **how: Any) -> None:
    names = dict.fromkeys([f"--{name}", f"--{name.replace('_', '-')}"])
    group.add_argument(*names, dest=name, action="append", help=help.replace("%", "%%"), **how)


def add_assumed(group: Any) -> None:
    """Add the CRS of files that state none."""
    group.add_argument(
        "--assume-crs",
        "--assume_crs",
        metavar="CRS",
        help=language.text("CRS of files that state none, or local"),
    )


def _add_usual(group: Any, delivered: Iterable[Description]) -> None:
    """Add what most runs need."""
    add_assumed(group)
    group.add_argument(
        "--overwrite", action="store_true", help=language.text("let outputs replace files")
    )
    group.add_argument(
        "--picture", metavar="PNG", help=language.text("draw a plot of the resulting layers")
    )
    group.add_argument(
        "--page",
        metavar="FILE",
        help=language.text("write a report of all results: .html, .pdf or .xlsx"),
    )
    if names := dict.fromkeys(one["file"] for one in delivered):
        text = language.text("write the set that is handed over:")
        text += f" {', '.join(names)}, README.txt"
        group.add_argument("--deliver", metavar="FOLDER", help=text)
    group.add_argument(
        "--tile", metavar="METRES", help=language.text("work in tiles of this size, or auto")
    )
    group.add_argument(
        "-h",
        "--help",
        nargs="?",
        metavar=ALL,
        help=language.text("the usual options; with all also those of formats and of steps"),
    )


def _add_rest(group: Any) -> None:
    group.add_argument(
        "--params", metavar="FILE", help=language.text("values as JSON or YAML; - is stdin")
    )
    _add_project(group)
    group.add_argument(
        "--counts",
        metavar="TABLE",
        help=language.text("write how much each step read and gave, as a table"),
    )
    group.add_argument(
        "--workers", metavar="N", help=language.text("processes that work on tiles (all cores)")
    )
    group.add_argument(
        "--memory", metavar="SIZE", help=language.text("that they may use together, such as 4GB")
    )
    group.add_argument(
        "--scheduler", metavar="URL", help=language.text("Dask scheduler to use instead of them")
    )
    group.add_argument(
        "--resume",
        action="store_true",
        help=language.text("take over steps, or tiles, of earlier runs"),
    )
    group.add_argument(
        "--json", action="store_true", help=language.text("print the result as JSON")
    )
    group.add_argument(
        "--events", choices=["jsonl"], help=language.text("one JSON line per event, for programs")
    )
    loudness = group.add_mutually_exclusive_group()
    loudness.add_argument(
        "--quiet",
        action="store_true",
        help=language.text("print errors only, and what --json or --events ask for"),
    )
    loudness.add_argument(
        "--verbose", action="store_true", help=language.text("print details and tracebacks")
    )


PROJECT = {  # what the head of a report says of a project, by option: placeholder and help
    "title": ("TEXT", "title of the report"),
    "client": ("TEXT", "for whom the report is made"),
    "field": ("NAME=TEXT", "more of its head, such as Contract=2026-17; may be repeated"),
    "date": ("TEXT", "date of the report (today)"),
    "style": ("CSS", "stylesheet of a company, whose rules come after those of the toolbox"),
    "logo": ("IMAGE", "logo of a company, PNG, SVG or JPEG"),
}


def _add_project(group: Any) -> None:
    for name, (placeholder, help) in PROJECT.items():
        how = {"action": "append"} if name == "field" else {}
        group.add_argument(f"--{name}", metavar=placeholder, help=language.text(help), **how)


def of_project(general: Mapping[str, Any]) -> dict[str, Any]:
    """The options that were given for the head and the look of reports, by their names there."""
    given = {name: general[name] for name in PROJECT if name in general}
    return {"fields" if name == "field" else name: value for name, value in given.items()}


def read(described: Description, arguments: Iterable[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read a command line.

    Returns
    -------
    values : inputs and outputs by name, and options of reading or writing a layer by
        ``name.option``; unknown names are kept, to be reported with all other problems
    general : the options of "how to run" that were given, by name

    Raises
    ------
    ParameterError
        An option is repeated, or a word belongs to no option.
    """
    said = _joined(renamed.words(described["id"], arguments))
    _help(described, said)
    found, unknown = parser(described).parse_known_args(said)
    given = vars(found)
    whole = [n for n, value in given.items() if n in PROJECT or not isinstance(value, list)]
    general = {name: given.pop(name) for name in whole}
    problems = {name: "given more than once" for name, texts in given.items() if len(texts) > 1}
    misspelt = {_name_of(text): "" for text in unknown if text.startswith("--")}
    if unknown and not misspelt:
        hint = _hint(described, unknown[0])
        problems["command line"] = f"does not know what to do with {' '.join(unknown)!r}{hint}"
    if problems:
        raise ParameterError(described["id"], problems)
    values = {name: _alone(described, name, texts[0]) for name, texts in given.items()}
    return values | misspelt, general


def _help(described: Description, said: list[str]) -> None:
    """Print the help and leave, where a command line asks for it."""
    asked = [place for place, word in enumerate(said) if word.partition("=")[0] in HELP]
    if asked:
        whole = ALL in (said[asked[0]].partition("=")[2], *said[asked[0] + 1 :][:1])
        parser(language.described(described), whole=whole).print_help()
        raise SystemExit(0)


def _hint(described: Description, word: str) -> str:
    """What a word without an option may be: one more class, or the path of the first input.

    >>> _hint({"inputs": {}}, "9")
    '; several values of an option have commas between them, such as 2,9'
    """
    if word.replace("-", "").isdigit():
        return "; several values of an option have commas between them, such as 2,9"
    layers = [name for name, field in described["inputs"].items() if is_layer(field["schema"])]
    return f"; did you mean --{layers[0]} {word}?" if layers and "." in word else ""


def _alone(described: Description, name: str, value: Any) -> Any:
    """Unwrap the single path of a source that takes one layer; several paths are one survey."""
    field = described["inputs"].get(name, {"maxOccurs": "unbounded"})
    one = field["maxOccurs"] == 1 and isinstance(value, list) and len(value) == 1
    return value[0] if one else value


def merged(
    described: Description, params: Mapping[str, Any], said: Mapping[str, Any]
) -> dict[str, Any]:
    """Join the values of a parameter file and of the command line, which take precedence.

    Raises
    ------
    ParameterError
        An option belongs to a layer that is not given.
    """
    whole = {name for name in said if "." not in name or name in described.get("between", ())}
    values = dict(params) | {name: value for name, value in said.items() if name in whole}
    problems = {}
    for name in said.keys() - values.keys():
        layer, _, option = name.rpartition(".")
        if layer in values:
            values[layer] = _with_option(values[layer], option, said[name])
        elif layer and said[name]:
            problems[name] = f"speaks about {layer}, which is not given"
        else:
            values[name] = said[name]  # unknown, and reported as such
    if problems:
        raise ParameterError(described["id"], problems)
    return values


def _with_option(value: Any, option: str, text: str) -> Any:
    if isinstance(value, list):
        return [_with_option(item, option, text) for item in value]
    return {**(value if isinstance(value, dict) else {"path": value}), option: text}


def _joined(arguments: Iterable[str]) -> list[str]:
    """Write ['--extent', '-5,0,5,9'] as ['--extent=-5,0,5,9'], or argparse sees two options."""
    made: list[str] = []
    for text in arguments:
        value = text.startswith("-") and not text.startswith("--") and text not in ("-", "-h")
        if value and made and made[-1].startswith("--") and "=" not in made[-1]:
            made[-1] += "=" + text
        else:
            made.append(text)
    return made


def _name_of(text: str) -> str:
    return text[2:].partition("=")[0].replace("-", "_")


def mapping(text: str, where: str) -> dict[str, Any]:
    """Read the text of a parameter file; errors name `where`, its path.

    Raises
    ------
    ParameterError
        It does not hold names and values.
    """
    try:
        return documents.mapping(text)
    except ValueError as err:
        raise ParameterError("run", {"params": f"{where}: {err}"}) from None
