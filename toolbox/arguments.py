"""The options of ``run``: built from a tool's description, so that nothing is typed twice."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

from toolbox.errors import ParameterError

# How a source is to be read, where its file does not say so: --points.columns x,y,z,label
SOURCE_OPTIONS: Mapping[str, Mapping[str, str]] = {
    "PointCloud": {
        "columns": "names of the columns of a text file, such as x,y,z,intensity",
        "separator": "what stands between the columns of a text file",
        "bounds": "read only xmin,ymin,xmax,ymax",
    },
    "Vector": {"layer": "name of the layer in the file"},
}
NEGATIVE = re.compile(r"-[\d.]")
Description = Mapping[str, Any]


def parser(described: Description) -> argparse.ArgumentParser:
    """All options of one tool; every value that is given ends up in a list under its name."""
    made = argparse.ArgumentParser(
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
    _add_general(made.add_argument_group("how to run"))
    return made


def _add_input(group: Any, name: str, field: Description) -> None:
    says = {meta["role"]: meta["value"] for meta in field["metadata"]}
    schema = field["schema"]
    rule = f" [{says['rule']}]" if "rule" in says else ""
    default = f" (default {schema['default']})" if "default" in schema else ""
    how: dict[str, Any] = {}
    if says["type"] in SOURCE_OPTIONS and schema["type"] == "array":
        how = {"nargs": "+"}
    elif schema.get("type") == "boolean":
        how = {"nargs": "?", "const": "true"}
    kind = says["type"].upper().replace(" ", "_")
    _add(group, name, metavar=kind, help=field["description"] + rule + default, **how)
    for option, text in SOURCE_OPTIONS.get(says["type"], {}).items():
        _add(group, f"{name}.{option}", metavar=option.upper(), help=text)


def _add(group: Any, name: str, *, help: str, **how: Any) -> None:
    names = dict.fromkeys([f"--{name}", f"--{name.replace('_', '-')}"])
    group.add_argument(*names, dest=name, action="append", help=help.replace("%", "%%"), **how)


def _add_general(group: Any) -> None:
    group.add_argument("--assume-crs", metavar="CRS", help="CRS of files that state none, or local")
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
    values : what is said of inputs and outputs, by name; unknown names are kept, to be reported
        together with all other problems of the values
    general : the options of "how to run" that were given, by name

    Raises
    ------
    ParameterError
        An option is repeated, or says how to read a source that is not given.
    """
    found, unknown = parser(described).parse_known_args(_joined(arguments))
    given = vars(found)
    general = {name: given.pop(name) for name in list(given) if not isinstance(given[name], list)}
    said, options, problems = _sorted(given)
    stray = {_name_of(text): "" for text in unknown if text.startswith("--")}
    if unknown and not stray:
        problems["run"] = f"does not know what to do with {' '.join(unknown)!r}"
    if problems:
        raise ParameterError(described["id"], problems)
    values = {name: _with_options(value, options.get(name)) for name, value in said.items()}
    return values | stray, general


def _joined(arguments: Iterable[str]) -> list[str]:
    """Write ['--extent', '-5,0,5,9'] as ['--extent=-5,0,5,9'], else argparse sees two options."""
    made: list[str] = []
    for text in arguments:
        if NEGATIVE.match(text) and made and made[-1].startswith("--") and "=" not in made[-1]:
            made[-1] += "=" + text
        else:
            made.append(text)
    return made


def _sorted(
    given: Mapping[str, list[Any]],
) -> tuple[dict[str, Any], dict[str, dict[str, str]], dict[str, str]]:
    """Values, options of sources (``points.columns``), and problems."""
    said = {name: texts[0] for name, texts in given.items() if "." not in name}
    problems = {name: "given more than once" for name, texts in given.items() if len(texts) > 1}
    options: dict[str, dict[str, str]] = {}
    for name in given.keys() - said.keys():
        source, _, option = name.partition(".")
        options.setdefault(source, {})[option] = given[name][0]
        if source not in said:
            problems[name] = f"says how to read {source}, which is not given"
    return said, options, problems


def _name_of(text: str) -> str:
    return text[2:].partition("=")[0].replace("-", "_")


def _with_options(said: Any, options: Mapping[str, str] | None) -> Any:
    if isinstance(said, list):
        return [_with_options(item, options) for item in said]
    return {"path": said, **options} if options else said


def mapping(text: str, where: str) -> dict[str, Any]:
    """Read names and values from JSON or YAML.

    Raises
    ------
    ParameterError
        The text is neither, or holds something else; names `where` it comes from.
    """
    try:
        values = json.loads(text)  # first, because it needs no import
    except ValueError:
        import yaml

        try:
            values = yaml.safe_load(text)
        except yaml.YAMLError as err:
            raise ParameterError("run", {"params": f"{where}: {err}"}) from None
    if not isinstance(values, dict):
        raise ParameterError("run", {"params": f"{where} must hold names and values"})
    return values
