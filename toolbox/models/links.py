"""Links of a model file: reads them, and checks whether their values fit the parameters."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from graphlib import TopologicalSorter
from typing import Any

from toolbox.declare.fields import Field
from toolbox.models.inputs import short
from toolbox.models.model import INPUTS, Condition, Link, Reference, Step


def link_of(value: Any) -> Link | None:
    """Read a reference, or a list of references, from a value of the file; None for a plain value.

    Raises
    ------
    ValueError
        A reference is malformed, or a list mixes references and plain values.
    """
    if isinstance(value, list) and any(map(_looks_linked, value)):
        links = [link_of(item) for item in value]
        found = tuple(link for link in links if isinstance(link, Reference))
        if len(found) < len(links):
            raise ValueError("must be references alone, or values alone")
        return found
    if not _looks_linked(value):
        return None
    names = value["from"] if isinstance(value["from"], list) else [value["from"]]
    if value.keys() != {"from"} or not names or not all(map(_is_reference, names)):
        raise ValueError(f"a reference is {{from: step.output}}, got {short(value)}")
    return Reference(tuple(names))


def _looks_linked(value: Any) -> bool:
    return isinstance(value, Mapping) and "from" in value


def _is_reference(name: Any) -> bool:
    return isinstance(name, str) and re.fullmatch(r"\w+\.\w+", name) is not None


def condition_of(value: Any) -> Condition:
    """Read the condition of a step from its value of `when`.

    Raises
    ------
    ValueError
        It is malformed.
    """
    says = dict(value) if isinstance(value, Mapping) else {}
    name, word = says.pop("from", None), says.pop("is", None)
    good = _is_reference(name) and of_inputs(name) and (word is None or isinstance(word, str))
    if says or not good:
        text = "{from: inputs.name}, or {from: inputs.name, is: word}"
        raise ValueError(f"must be {text}, got {short(value)}")
    return Condition(name, word)


def of_inputs(name: str) -> bool:
    return name.startswith(f"{INPUTS}.")


def in_order(needs: Mapping[str, Collection[str]]) -> list[str]:
    """Sort names so that each comes after those that it needs, and else as they are given.

    >>> in_order({"b": ["a"], "c": [], "a": []})
    ['c', 'a', 'b']

    Raises
    ------
    CycleError
        Some need each other.
    """
    names = list(needs)
    sorter = TopologicalSorter({name: needs.keys() & needed for name, needed in needs.items()})
    sorter.prepare()
    order: list[str] = []
    ready: set[str] = set()
    while sorter.is_active():
        ready |= set(sorter.get_ready())
        order.append(min(ready, key=names.index))
        ready.remove(order[-1])
        sorter.done(order[-1])
    return order


def misfit(link: Reference, known: Mapping[str, Field], want: Field) -> str | None:
    """Say why the values of a reference do not fit a parameter."""
    for name in [name for name in link.names if name in known]:
        have = known[name]
        words = have.kind.word, want.kind.word  # a PointCloud also for who takes surveys too
        alike = words[0] == words[1] or words == ("integer", "number")
        if alike and want.many and not have.many:
            return f"takes a list; write [{{from: {name}}}]"
        if not alike or have.many != want.many:
            return f"needs a {want.word}, but {name!r} is a {have.word}"
        if have.unit and want.unit and have.unit != want.unit:
            return f"is in {want.unit}, but {name!r} in {have.unit}"
        if odd := [choice for choice in have.choices if choice not in want.choices]:
            return f"must be {want.rule()}, but {name!r} may be {odd[0]!r}"
    return None


def is_sure(
    names: Iterable[str],
    when: Condition | None,
    known: Mapping[str, Field],
    steps: Mapping[str, Step],
) -> bool:
    """Whether at least one of some values exists whenever a step with this condition runs."""
    there = [name for name in names if name in known]
    if any(_is_sure(name, when, known, steps) for name in there):
        return True
    words: dict[str, set[str | None]] = {}  # of each choice, the words with which a value exists
    for name in there:
        maker = None if of_inputs(name) else steps[name.partition(".")[0]]
        if maker and maker.when and not known[name].optional:
            words.setdefault(maker.when.name, set()).add(maker.when.word)
    choices = {name: known[name].choices for name in words if name in known}
    return any(given and words[name].issuperset(given) for name, given in choices.items())


def _is_sure(
    name: str, when: Condition | None, known: Mapping[str, Field], steps: Mapping[str, Step]
) -> bool:
    if of_inputs(name):
        return not known[name].optional or when == Condition(name)
    maker = steps[name.partition(".")[0]]
    return maker.when in (None, when) and not known[name].optional
