"""Layers with whose coordinates a later step of a model cannot work: found before it runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from toolbox.data.crs import crs_conflict, length_problem
from toolbox.data.layer import Layer
from toolbox.declare.spec import measures_lengths
from toolbox.models.model import INPUTS, Step, references, step_values


def unmeasurable(steps: Iterable[Step], found: Mapping[str, Any]) -> dict[str, str]:
    """The problem of each input whose coordinates are no lengths, which some step measures.

    Parameters
    ----------
    steps : those that run, in their order
    found : the inputs, by inputs.name

    Returns
    -------
    dict
        By name of the input: what is wrong with its CRS, and which step needs it.
    """
    wrong = {name: text for name, layer in found.items() if (text := _problem(layer))}
    source = {name: name for name in wrong}  # the input that each result takes its CRS from
    problems: dict[str, str] = {}
    for step in steps:
        uses = _uses(step, source)
        if not uses:
            continue
        values = {n: f.default for n, f in step.spec.inputs.items() if not f.required}
        values = dict.fromkeys(step.spec.inputs) | values | step_values(step, step.links, found)
        if measures_lengths(step.spec, values):
            for name in uses:
                text = f"{wrong[name]} (step '{step.name}' measures lengths)"
                problems.setdefault(name.removeprefix(f"{INPUTS}."), text)
        source |= dict.fromkeys(step.outputs, uses[0])
    return problems


def conflicting(steps: Iterable[Step], found: Mapping[str, Any]) -> dict[str, str]:
    """The problem of each input that meets another one, of another CRS, in some step.

    A result has the CRS of the first input of its step, and none that is known after a step that
    takes layers of any CRS. Heights are compared when the step runs.

    Parameters
    ----------
    steps : those that run, in their order
    found : the inputs, by inputs.name

    Returns
    -------
    dict
        By name of the input: with which other it does not go, and the step where they meet.
    """
    layers = {name: layer for name, layer in found.items() if _is_place(layer)}
    source = {name: name for name in layers}
    problems: dict[str, str] = {}
    for step in steps:
        uses = _uses(step, source)
        for name in uses[1:]:
            one, first = layers[name], layers[uses[0]]
            text = crs_conflict(one.crs, first.crs, heights=False, tools=one.tools)
            if text:
                other = f"{uses[0].removeprefix(f'{INPUTS}.')} {first.name}".strip()
                problems.setdefault(
                    name.removeprefix(f"{INPUTS}."),
                    f"{one.name} {text} of {other} (step '{step.name}' takes both)".strip(),
                )
        if uses and not any(field.any_crs for field in step.spec.sources.values()):
            source |= dict.fromkeys(step.outputs, uses[0])
    return problems


def _uses(step: Step, source: Mapping[str, str]) -> list[str]:
    """The inputs from which a step takes the CRS of its layers, in the order of its sources.

    Parameters
    ----------
    source : the input that each input and result has its CRS from
    """
    fields = step.spec.sources
    firsts = [
        next((name for name in reference.names if name in source), None)
        for parameter in fields
        if parameter in step.links and not fields[parameter].any_crs
        for reference in references(step.links[parameter])
    ]
    return [source[name] for name in firsts if name]


def _is_place(layer: Any) -> bool:
    """Whether it is a layer with coordinates."""
    return isinstance(layer, Layer) and layer.is_spatial


def _problem(layer: Any) -> str | None:
    """What is wrong with the CRS of a layer; None of what is no layer, or has a good one."""
    if not _is_place(layer):
        return None
    text = length_problem(layer.crs)
    return f"{layer.name} {text}".strip() if text else None
