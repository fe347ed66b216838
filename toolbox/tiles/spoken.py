"""What the steps that ran tile by tile say in words of the whole survey."""

from __future__ import annotations

from typing import Any

from toolbox.reports.page import Told
from toolbox.tiles.crew import Crew


class _Unknown(Exception):
    """A result is not known of the whole survey."""


class _Whole:
    """The results of a step on all tiles, read when they are asked for."""

    def __init__(self, crew: Crew, step: str) -> None:
        self._crew, self._step = crew, step

    def __getattr__(self, output: str) -> Any:
        name = f"{self._step}.{output}"
        found = self._crew.found.get(name)
        plan = self._crew.plan
        if found is None and name in plan.wanted and name in plan.keep:
            kind = plan.model.between[name].kind
            found = self._crew.read(name) if kind.is_layer and not kind.in_blocks else None
        if found is None:
            raise _Unknown(name)
        return found


def tell(crew: Crew, told: Told) -> None:
    """Add what each local step says of the sums of its tiles, and which cannot say anything."""
    if crew.failures:
        return
    words: list[tuple[str, str]] = []
    silent: list[str] = []
    for name in (name for one in crew.plan.passes for name in one.local):
        spec = crew.plan.model.steps[name].spec
        in_words = getattr(getattr(spec.make, "Outputs", None), "in_words", None)
        if in_words is None:
            continue
        try:
            words.append((name, in_words(_Whole(crew, name))))
        except _Unknown:
            silent.append(spec.title)
    told.words = words + told.words
    if silent:
        titles = ", ".join(dict.fromkeys(silent))
        told.unseen.insert(0, f"In words, as these steps ran tile by tile: {titles}.")
