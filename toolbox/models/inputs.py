"""Reads the inputs of a model from the section `inputs` of its file."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from toolbox.declare import kinds
from toolbox.declare.fields import MEETS, SHAPES, UNITS, Field
from toolbox.declare.kinds import Kind
from toolbox.errors import nearest
from toolbox.models.model import INPUTS

WORDS = (
    "type",
    "help",
    "label",
    "default",
    "feet",
    "unit",
    "choices",
    "many",
    "optional",
    "of",
    "shapes",
    *MEETS,
)
TYPES = {kind.word: kind for kind in (*kinds.KINDS.values(), kinds.CHOICE)}
SHOWN = 60  # characters of a wrong value that a message shows


def read(section: Mapping[str, Any]) -> tuple[dict[str, Field], dict[str, str]]:
    """Read the fields of valid inputs, and the problems of the others, by name."""
    fields: dict[str, Field] = {}
    problems: dict[str, str] = {}
    for name, says in section.items():
        found = _input_problems(says)
        if not found:
            fields[name] = _field(name, says)
        if not found and says.get("default") is not None:
            default, problem = parsed(fields[name], says["default"])
            fields[name] = dataclasses.replace(fields[name], default=default)
            found = {".default": problem} if problem else {}
        problems |= {f"{INPUTS}.{name}{word}": text for word, text in found.items()}
    sources = [name for name, field in fields.items() if field.role == "source"]
    for name, field in fields.items():
        if field.of and field.of not in sources:
            text = f"no source called {field.of!r}{nearest(field.of, sources)}"
            problems[f"{INPUTS}.{name}.of"] = text
    return fields, problems


def _field(name: str, says: Mapping[str, Any]) -> Field:
    """Make the field of an input, without its default."""
    kind = TYPES[says["type"]]
    optional = says.get("optional") is True or ("default" in says and says["default"] is None)
    return Field(
        name,
        kind,
        "source" if kind.is_layer else "param",
        str(says["help"]),
        None if optional else dataclasses.MISSING,
        None if says.get("unit") is None else str(says["unit"]),
        {key: says[key] for key in MEETS if key in says},
        choices=tuple(says.get("choices", ())),
        many=says.get("many") is True,
        optional=optional,
        of=says.get("of"),
        label=str(says.get("label", "")),
        shapes=tuple(says.get("shapes", ())),
        feet=says.get("feet"),
    )


def _input_problems(says: Any) -> dict[str, str]:
    """The problems of the declaration of an input, by ".word"."""
    if not isinstance(says, Mapping):
        return {"": f"must be {{type: ..., help: ...}}, got {short(says)}"}
    found = word_problems("", says, WORDS, needed=("type", "help"))
    if word := says.get("type"):
        kind = TYPES.get(str(word))
        hint = nearest(str(word), TYPES) or f"; there are {', '.join(TYPES)}"
        more = _kind_problems(kind, says) if kind else {"type": f"no type {short(word)}{hint}"}
        found |= {f".{key}": text for key, text in more.items()}
    return found


def _kind_problems(kind: Kind, says: Mapping[str, Any]) -> dict[str, str]:
    """The problems of the words that do not suit the type, by word."""
    found: dict[str, str] = {}
    number, unit, choices = (
        kind.word in ("number", "integer"),
        says.get("unit"),
        says.get("choices"),
    )
    if unit is not None and str(unit) not in UNITS:
        found["unit"] = f"must be one of {', '.join(UNITS)}, got {short(unit)}"
    if unit is None and number and "choices" not in says:
        found["unit"] = "missing: m for lengths in metres, 1 for a ratio or a count"
    if kind is kinds.CHOICE and not choices:
        found["choices"] = "missing: the words to choose from"
    elif choices is not None and not _is_list(choices):
        found["choices"] = f"must be a list of words, got {short(choices)}"
    for key in [key for key in MEETS if key in says]:
        if not kinds.KINDS[float].accepts(says[key]) or not (number or kind.word == "range"):
            found[key] = f"must be a number, of a number or range; got {short(says[key])}"
    for key in ("many", "optional"):
        if key in says and not isinstance(says[key], bool):
            found[key] = f"must be true or false, got {short(says[key])}"
    if kind.is_layer and says.get("default") is not None:
        found["default"] = "a layer has none; it may be optional: true"
    if "feet" in says and not (kinds.KINDS[float].accepts(says["feet"]) and unit == "m"):
        found["feet"] = f"must be a number, of a length in m; got {short(says['feet'])}"
    found |= _shapes_problem(kind, says)
    if says.get("of") is not None and kind.word not in ("attribute", "expression"):
        found["of"] = "is for attributes and expressions"
    elif not isinstance(says.get("of"), str | None):
        found["of"] = f"must be the name of a source, got {short(says['of'])}"
    return found


def _shapes_problem(kind: Kind, says: Mapping[str, Any]) -> dict[str, str]:
    """The problem of the shapes that features are to be."""
    if "shapes" not in says:
        return {}
    if kind.word != "Vector" or not _is_list(says["shapes"]):
        return {"shapes": "is a list, of vector layers"}
    wrong = [shape for shape in says["shapes"] if shape not in SHAPES]
    return {"shapes": f"must be of {', '.join(SHAPES)}, got {short(wrong[0])}"} if wrong else {}


def _is_list(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(v, str | int | float) for v in value)


def word_problems(
    where: str, says: Mapping[str, Any], known: tuple[str, ...], needed: tuple[str, ...]
) -> dict[str, str]:
    """The unknown words of a declaration and its missing ones, by where.word."""
    found = {}
    for word in [word for word in says if word not in known]:
        hint = nearest(str(word), known) or f"; there are {', '.join(known)}"
        found[f"{where}.{word}"] = f"unknown word{hint}"
    return found | {f"{where}.{word}": "missing" for word in needed if not says.get(word)}


def parsed(field: Field, value: Any) -> tuple[Any, str | None]:
    """Read a plain value of a field; if it cannot be read or is not allowed, also its problem."""
    try:
        made = field.parse(value)
    except ValueError as err:
        return None, str(err)
    return made, field.problem(made)


def short(value: Any) -> str:
    """The text of a wrong value in a message, cut if it is long."""
    text = repr(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
