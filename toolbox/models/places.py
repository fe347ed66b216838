"""Layers in whose coordinates a later step of a model cannot measure: found before it runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from toolbox.data.crs import length_problem
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
        fields = step.spec.sources
        uses = [
            source[name]
            for parameter, link in step.links.items()
            if parameter in fields and not fields[parameter].any_crs
            for reference in references(link)
            for name in reference.names
            if name in source
        ]
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


def _problem(layer: Any) -> str | None:
    """What is wrong with the CRS of a layer; None of what is no layer, or has a good one."""
    if not isinstance(layer, Layer) or not layer.is_spatial:
        return None
    text = length_problem(layer.crs)
    return f"{layer.name} {text}".strip() if text else None
