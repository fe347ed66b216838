"""What of a tool or model is run on tiles of a survey, and the survey itself."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pyproj import CRS

from toolbox.context import Context
from toolbox.data import PointCloud, Survey
from toolbox.data.crs import crs_conflict, length_problem
from toolbox.errors import DataError, ParameterError
from toolbox.fields import Spec
from toolbox.kinds import located, parsed_options
from toolbox.model import INPUTS, Model, Reference, Step, leading_steps, references
from toolbox.provenance import Count

ALONE = "tool"  # the step of a model that stands for a tool


def as_model(spec: Spec) -> Model:
    """A tool as a model of one step; a model as it is."""
    if isinstance(spec, Model):
        return spec
    wires = {name: Reference((f"{INPUTS}.{name}",)) for name in spec.inputs}
    returns = {name: Reference((f"{ALONE}.{name}",)) for name in spec.outputs}
    steps = {ALONE: Step(ALONE, spec, {}, wires)}
    return Model(
        id=spec.id,
        title=spec.title,
        help=spec.help,
        inputs=spec.inputs,
        outputs=spec.outputs,
        steps=steps,
        returns=returns,
    )


@dataclass(frozen=True)
class Plan:
    """Which steps of a model are run on tiles, and which on what these give.

    Attributes
    ----------
    local : steps that need no more than the neighbourhood of a tile
    rest : steps that need the whole
    keep : results of the local steps that are wanted, by step.output
    stored : for outputs that come from local steps, their step.output
    halo : metres that the local steps reach
    """

    model: Model
    settings: Mapping[str, Any]
    local: tuple[str, ...]
    rest: tuple[str, ...]
    keep: frozenset[str]
    stored: Mapping[str, str]
    halo: float

    @classmethod
    def of(cls, model: Model, settings: Mapping[str, Any], targets: Iterable[str]) -> Plan:
        """Cut a model where the whole cloud is needed; steps that nobody asks for are left out.

        Raises
        ------
        ParameterError
            No step can be run on tiles.
        """
        if not any(field.kind.several for field in model.sources.values()):
            raise ParameterError(model.id, {"tile": "the tool reads no points; leave it out"})
        active = {step.name: step for step in model.active(settings)}
        results = {name for step in active.values() for name in step.outputs}
        returned = {
            output: next((name for name in wire.names if name in results), "")
            for output, wire in model.returns.items()
        }
        returned |= {name: name for name in targets if name in results}
        numbers = {n for n, f in model.outputs.items() if not f.kind.is_layer}
        wanted = {returned[n] for n in {*targets, *numbers} & returned.keys()} - {""}
        needed = leading_steps(active, wanted)
        reach = model.reach(settings)
        local = [n for n in active if n in needed and math.isfinite(reach[n])]
        for name in list(local):
            if not _is_local(active[name], local, active, model):
                local.remove(name)
        if not wanted:
            raise ParameterError(model.id, {"tile": "say which output to write"})
        if not local:
            raise ParameterError(model.id, {"tile": _whole(model, reach)})
        rest = [name for name in active if name in needed and name not in local]
        asked = wanted | {need for name in rest for need in active[name].needs}
        return cls(
            model,
            settings,
            tuple(local),
            tuple(rest),
            frozenset(n for n in asked if n.partition(".")[0] in local),
            {n: full for n, full in returned.items() if full.partition(".")[0] in local},
            max(reach[name] for name in local),
        )

    @property
    def gives_rasters(self) -> bool:
        """Whether a raster is put together from tiles."""
        return any(self.model.between[name].kind.word == "Raster" for name in self.keep)

    def ordered(self, counts: Iterable[Count]) -> list[Count]:
        """Counts of tiles and of the whole in the order of the steps."""
        places = {name: place for place, name in enumerate(self.model.steps)}
        return sorted(counts, key=lambda c: places.get(c.step.partition("/")[0].split()[0], 0))


def _whole(model: Model, reach: Mapping[str, float]) -> str:
    """Why nothing can be run on tiles, in the words of the first tool that looks too far."""
    text = "the whole cloud is needed with these settings; leave it out"
    far = [model.steps[name].spec for name, metres in reach.items() if math.isinf(metres)]
    tools: list[Any] = [spec.make for spec in far if not isinstance(spec, Model)]
    return f"{text} ({inspect.getdoc(tools[0].halo)})" if tools else text


def _is_local(step: Step, local: Iterable[str], active: Mapping[str, Step], model: Model) -> bool:
    """Whether a step works on the points, directly or not, and waits for no number of a step.

    A number that a tile gives is not that of the whole survey.
    """
    if step.repeat:
        return False  # its results are lists, which are not put together from tiles
    on_points = False
    for name, wire in step.wires.items():
        for need in (need for reference in references(wire) for need in reference.names):
            maker, _, output = need.partition(".")
            if maker == INPUTS:
                kind = model.inputs[output].kind
                on_points |= kind.several
            elif maker not in active:
                continue  # left out under these settings; another value stands in for it
            elif maker not in local or not step.spec.inputs[name].kind.is_layer:
                return False
            else:
                on_points = True
    return on_points


def surveys_of(
    spec: Spec, sources: Mapping[str, Any], assume_crs: CRS | None, ctx: Context
) -> dict[str, Survey]:
    """Headers of all point clouds, which must be in one CRS that knows metres."""
    found: dict[str, Survey] = {}
    problems: dict[str, str] = {}
    for name, field in spec.sources.items():
        value = sources.get(name)
        if not field.kind.several or value is None:
            continue
        try:
            found[name] = _survey(value, field.many, assume_crs, ctx)
        except DataError as err:
            problems[name] = str(err)
    for name, survey in found.items():
        first = next(iter(found.values()))
        text = length_problem(survey.crs) or crs_conflict(survey.crs, first.crs, heights=True)
        if text:
            problems[name] = f"{survey.name} {text}"
        elif not survey.count:
            problems[name] = f"{survey.name} has no points"
    if problems:
        raise DataError(spec.id, problems)
    for survey in found.values():
        _ = survey.template  # made here once, and sent to all workers
    return found


def _survey(value: Any, many: bool, assume_crs: CRS | None, ctx: Context) -> Survey:
    if many or isinstance(value, PointCloud):
        raise DataError("is no survey in files; run the tool without tiles")
    places, options = located(value)
    how = parsed_options(options, ("bounds", "columns", "separator"))
    bounds = how.pop("bounds", None)
    survey = Survey.open(places, assume_crs=assume_crs, ctx=ctx.part(0, 0), **how)
    survey = survey.absolute()
    return survey.part(bounds) if bounds else survey
