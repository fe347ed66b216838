"""Reads names and values from JSON or YAML text, and refuses a name that is given twice.

YAML is read as version 1.2: only `true` and `false` are switches, and `no`, `on`, `012`, `13:14`
and dates are words, so that class lists are not taken for something else.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from typing import Any

PLAIN = {  # pattern and possible first letters of all that is no text, in the order of trial
    "null": (r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    "bool": (r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    "int": (r"[-+]?(0|[1-9][0-9]*)", list("-+0123456789")),
    "float": (
        r"[-+]?(\.[0-9]+|(0|[1-9][0-9]*)(\.[0-9]*)?)([eE][-+]?[0-9]+)?",
        list("-+.0123456789"),
    ),
}


def mapping(text: str) -> dict[str, Any]:
    """Read names and values from JSON or YAML.

    Raises
    ------
    ValueError
        The text is neither JSON nor YAML, holds something else, or gives a name twice.
    """
    try:
        values = json.loads(text, object_pairs_hook=_once)  # first: it needs no import
    except json.JSONDecodeError:
        values = _yaml(text)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
        raise ValueError("must hold names and values")
    return values


def text(values: dict[str, Any]) -> str:
    """Write names and values as YAML that :func:`mapping` reads; line breaks in texts are kept."""
    import yaml

    class Dumper(yaml.SafeDumper):
        pass

    def shown(dumper: Any, value: str) -> Any:
        style = "|" if "\n" in value else None
        return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=style)

    Dumper.add_representer(str, shown)
    how: dict[str, Any] = {"sort_keys": False, "allow_unicode": True, "width": 100}
    return str(yaml.dump(values, Dumper=Dumper, **how))


def _yaml(text: str) -> Any:
    import yaml

    try:
        return yaml.load(text, _yaml_loader(yaml.SafeLoader))
    except yaml.MarkedYAMLError as err:
        mark = err.problem_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise ValueError(f"{where}{err.problem or err.context}") from None
    except yaml.YAMLError as err:
        raise ValueError(str(err)) from None
    except RecursionError:
        raise ValueError("is nested too deeply") from None


def _yaml_loader(base: Any) -> Any:
    """Make a safe loader of YAML 1.2 that refuses a name that is given twice."""

    def construct(loader: Any, node: Any) -> dict[str, Any]:
        return _once(loader.construct_pairs(node, deep=True))

    def compose(loader: Any, parent: Any, index: Any) -> Any:
        event = loader.peek_event()
        if getattr(event, "anchor", None):  # aliases of aliases: ten lines, a billion values
            raise ValueError(f"line {event.start_mark.line + 1}: & and * are not read")
        if getattr(event, "tag", None):  # which calls a function on the text, whatever it holds
            raise ValueError(
                f"line {event.start_mark.line + 1}: tags such as {event.tag} are not read"
            )
        return base.compose_node(loader, parent, index)

    made: Any = type("Loader", (base,), {"yaml_implicit_resolvers": {}, "compose_node": compose})
    for name, (pattern, first) in PLAIN.items():
        made.add_implicit_resolver(f"tag:yaml.org,2002:{name}", re.compile(f"({pattern})$"), first)
    made.add_constructor("tag:yaml.org,2002:map", construct)
    return made


def _once(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    """Make a mapping of pairs, or refuse a name that is given twice."""
    names = [name for name, _ in pairs]
    if odd := [name for name in names if not isinstance(name, str | int | float)]:
        raise ValueError(f"{odd[0]!r} is no name")
    if len(made := dict(pairs)) < len(names):
        twice, _ = Counter(names).most_common(1)[0]
        raise ValueError(f"{twice!r} is given more than once")
    return made
