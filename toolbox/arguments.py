"""The options of ``run``: built from a tool's description, so that nothing is typed twice."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping
from typing import Any, NoReturn

from toolbox.errors import ParameterError

Description = Mapping[str, Any]


class _Parser(argparse.ArgumentParser):
    """Reports what it cannot read as we report everything else."""

    def error(self, message: str) -> NoReturn:
        raise ParameterError(self.prog.removeprefix("toolbox run "), {"command line": message})


def parser(described: Description) -> argparse.ArgumentParser:
    """All options of one tool; every value that is given ends up in a list under its name."""
    made = _Parser(
        f"toolbox run {described['id']}",
        description=f"{described['title']}.\n\n{described['description']}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,  # else --windo would quietly be taken for --window
        argument_default=argparse.SUPPRESS,
    )
    inputs = made.add_argument_group("inputs")
    for name, field in described["inputs"].items():
        _add_input(inputs, name, field)
    results = made.add_argument_group("outputs")
    for name, field in described["outputs"].items():
        if field["schema"].get("format") == "uri-reference":
            _add(results, name, metavar="PATH", help=field["description"])
            _add_options(results, name, field)
    _add_general(made.add_argument_group("how to run"))
    return made


def _add_input(group: Any, name: str, field: Description) -> None:
    says = {meta["role"]: meta["value"] for meta in field["metadata"]}
    schema = field["schema"]
    rule = f" [{says['rule']}]" if "rule" in says else ""
    default = f" (default {schema['default']})" if "default" in schema else ""
    how: dict[str, Any] = {}
    if field["maxOccurs"] != 1:
        how = {"nargs": "+"}
    elif schema.get("type") == "boolean":
        how = {"nargs": "?", "const": "true"}
    kind = says["type"].upper().replace(" ", "_")
    _add(group, name, metavar=kind, help=field["description"] + rule + default, **how)
    _add_options(group, name, field)


def _add_options(group: Any, name: str, field: Description) -> None:
    """How a layer is read or written: ``--points.columns x,y,z,label``."""
    for meta in field["metadata"]:
        if meta["role"] == "option":
            option = meta["title"]
            _add(group, f"{name}.{option}", metavar=option.upper(), help=meta["value"])


def _add(group: Any, name: str, *, help: str, **how: Any) -> None:
    names = dict.fromkeys([f"--{name}", f"--{name.replace('_', '-')}"])
    group.add_argument(*names, dest=name, action="append", help=help.replace("%", "%%"), **how)


def _add_general(group: Any) -> None:
    group.add_argument(
        "--assume-crs", "--assume_crs", metavar="CRS", help="CRS of files that state none, or local"
    )
    group.add_argument("--params", metavar="FILE", help="values as JSON or YAML; - is stdin")
    group.add_argument("--overwrite", action="store_true", help="let outputs replace files")
    group.add_argument("--picture", metavar="PNG", help="draw the resulting layers")
    group.add_argument("--json", action="store_true", help="print the result as JSON")
    group.add_argument("--events", choices=["jsonl"], help="one JSON line per event, for programs")
    loudness = group.add_mutually_exclusive_group()
    loudness.add_argument("--quiet", action="store_true", help="print errors only")
    loudness.add_argument("--verbose", action="store_true", help="print details and tracebacks")


def read(described: Description, arguments: Iterable[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Take a command line apart.

    Returns
    -------
    values : what is said of inputs and outputs, by name, and under ``name.option`` how a layer is
        to be read or written; unknown names are kept, to be reported with all other problems
    general : the options of "how to run" that were given, by name

    Raises
    ------
    ParameterError
        An option is repeated, or a word belongs to none.
    """
    found, unknown = parser(described).parse_known_args(_joined(arguments))
    given = vars(found)
    general = {name: given.pop(name) for name in list(given) if not isinstance(given[name], list)}
    problems = {name: "given more than once" for name, texts in given.items() if len(texts) > 1}
    misspelt = {_name_of(text): "" for text in unknown if text.startswith("--")}
    if unknown and not misspelt:
        problems["command line"] = f"does not know what to do with {' '.join(unknown)!r}"
    if problems:
        raise ParameterError(described["id"], problems)
    return {name: texts[0] for name, texts in given.items()} | misspelt, general


def merged(params: Mapping[str, Any], said: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Values of a parameter file and of the command line, which wins; options join their layers.

    Raises
    ------
    ParameterError
        An option speaks about a layer that is not given.
    """
    values = dict(params) | {name: value for name, value in said.items() if "." not in name}
    problems = {}
    for name in said.keys() - values.keys():
        layer, _, option = name.partition(".")
        if layer in values:
            values[layer] = _with_option(values[layer], option, said[name])
        elif option and said[name]:
            problems[name] = f"speaks about {layer}, which is not given"
        else:
            values[name] = said[name]  # unknown, and reported as such
    if problems:
        raise ParameterError(where, problems)
    return values


def _with_option(value: Any, option: str, text: str) -> Any:
    if isinstance(value, list):
        return [_with_option(item, option, text) for item in value]
    return {**(value if isinstance(value, dict) else {"path": value}), option: text}


def _joined(arguments: Iterable[str]) -> list[str]:
    """Write ['--extent', '-5,0,5,9'] as ['--extent=-5,0,5,9'], else argparse sees two options."""
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
    """Read names and values from JSON or YAML.

    Raises
    ------
    ParameterError
        The text is neither, or holds something else; names `where` it comes from.
    """
    try:
        values = json.loads(text, object_pairs_hook=_once)  # first: it needs no import
    except ParameterError:
        raise
    except (ValueError, RecursionError):
        import yaml

        try:
            values = yaml.load(text, _yaml_loader(yaml.SafeLoader))
        except ParameterError:
            raise
        except (yaml.YAMLError, ValueError, RecursionError) as err:
            raise ParameterError("run", {"params": f"{where}: {err}"}) from None
    if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
        raise ParameterError("run", {"params": f"{where} must hold names and values"})
    return values


def _yaml_loader(base: Any) -> Any:
    """A safe loader that refuses a name that stands twice, as _once does for JSON."""

    def construct(loader: Any, node: Any) -> dict[str, Any]:
        return _once(loader.construct_pairs(node, deep=True))

    made = type("Loader", (base,), {})
    made.add_constructor("tag:yaml.org,2002:map", construct)  # type: ignore[attr-defined]
    return made


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A mapping in which no name stands twice."""
    names = [name for name, _ in pairs]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ParameterError("run", {"params": f"{sorted(twice)[0]!r} is given more than once"})
    return dict(pairs)
