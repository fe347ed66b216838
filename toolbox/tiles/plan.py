"""Decides which steps of a tool or model run on the tiles of a survey, and opens the survey."""

from __future__ import annotations

import inspect
import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pyproj import CRS

from toolbox.context import Context
from toolbox.data import Survey
from toolbox.data.crs import crs_conflict, length_problem
from toolbox.declare.fields import Spec
from toolbox.declare.values import Memory
from toolbox.errors import DataError, ParameterError
from toolbox.models.model import INPUTS, Model, Reference, Step, leading_steps, references
from toolbox.runs.provenance import Count
from toolbox.runs.source import Source, Sources, check_place

ALONE = "tool"  # the step of a model that stands for a tool
APART = 20.0  # metres that both of two steps must look for the second to begin another pass: for
# less, storing the points between them costs more than the surroundings that it saves


def as_model(spec: Spec) -> Model:
    """Turn a tool into a model of one step; a model stays as it is."""
    if isinstance(spec, Model):
        return spec
    links = {name: Reference((f"{INPUTS}.{name}",)) for name in spec.inputs}
    returns = {name: Reference((f"{ALONE}.{name}",)) for name in spec.outputs}
    steps = {ALONE: Step(ALONE, spec, {}, links)}
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
class Pass:
    """One pass over the tiles: local steps run on each tile, then the others on whole results.

    Attributes
    ----------
    local : steps that need no more than a tile and its neighbourhood
    rest : steps that need the whole survey or whole results, run after all tiles
    keep, gives : results of the local and of the other steps that are asked for or used later
    halo : metres beyond a tile that the local steps look
    """

    local: tuple[str, ...]
    rest: tuple[str, ...]
    keep: frozenset[str]
    gives: frozenset[str]
    halo: float


@dataclass(frozen=True)
class TilePlan:
    """The passes in which a model is run on tiles.

    A local step that needs the result of a step on the whole survey runs in the pass after it, and
    so does one that looks far around itself and takes points from another one that does: the
    surroundings of a tile are those of one step then, not of all together.

    Attributes
    ----------
    passes : in the order in which they are run
    stored : for each output that comes from a local step, its step.output
    wanted : the results that are asked for, by step.output
    """

    model: Model
    settings: Mapping[str, Any]
    passes: tuple[Pass, ...]
    stored: Mapping[str, str]
    wanted: frozenset[str]

    @classmethod
    def of(cls, model: Model, settings: Mapping[str, Any], targets: Iterable[str]) -> TilePlan:
        """Distribute the steps of a model over passes; steps that no target needs are left out.

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
            output: next((name for name in link.names if name in results), "")
            for output, link in model.returns.items()
        }
        returned |= {name: name for name in targets if name in results}
        numbers = {n for n, f in model.outputs.items() if not f.kind.is_layer}
        wanted = {returned[n] for n in {*targets, *numbers} & returned.keys()} - {""}
        if not wanted:
            raise ParameterError(model.id, {"tile": "say which output to write"})
        needed = {name: active[name] for name in leading_steps(active, wanted)}
        halos = {name: model.step_halo(step, settings) for name, step in needed.items()}
        turns = _Turns.of(model, active, needed, halos)
        if not turns.reach:
            raise ParameterError(model.id, {"tile": _whole(model, model.reach(settings))})
        stored = {n: full for n, full in returned.items() if full.partition(".")[0] in turns.reach}
        told = {name for step in needed.values() for name in _spoken(step)}
        passes = tuple(turns.passes(needed, wanted | told))
        return cls(model, settings, passes, stored, frozenset(wanted))

    @property
    def halo(self) -> float:
        """Metres beyond a tile that the local steps of any pass look."""
        return max(one.halo for one in self.passes)

    def side(self, density: float, memory: float) -> float:
        """The largest tile with which each pass stays within some bytes of memory, metres.

        Parameters
        ----------
        density : points per square metre
        """
        steps = self.model.steps
        needs = [
            (one.halo, Memory.most(steps[name].spec.memory for name in one.local))
            for one in self.passes
            if one.local
        ]
        sides = (math.sqrt(memory / need.per_area(density)) - 2 * halo for halo, need in needs)
        return min(sides)

    @property
    def keep(self) -> dict[str, int]:
        """The number of the pass that makes each stored result of local steps, by step.output."""
        return {name: number for number, one in enumerate(self.passes) for name in one.keep}

    def spent(self, number: int) -> frozenset[str]:
        """The stored results that nobody needs when this pass is done, by step.output.

        A run that goes on where one was killed does not run the tiles of this pass again, but the
        steps on whole results, of which nothing is stored.
        """
        later = [name for one in self.passes[number + 1 :] for name in one.local]
        whole = [name for one in self.passes for name in one.rest]
        used = {need for name in (*later, *whole) for need in self.model.steps[name].needs}
        there = {name for one in self.passes[: number + 1] for name in one.keep}
        layers = {name for name in there if self.model.between[name].kind.is_layer}
        return frozenset(layers - used - self.wanted)

    @property
    def gives_rasters(self) -> bool:
        """Whether any raster is joined from tiles."""
        return any(self.model.between[name].kind.is_gridded for name in self.keep)

    def ordered(self, counts: Iterable[Count]) -> list[Count]:
        """Sort the counts of tiles and of whole results in the order of the steps."""
        order = {name: index for index, name in enumerate(self.model.steps)}
        return sorted(counts, key=lambda c: order.get(c.step.partition("/")[0].split()[0], 0))


class _Turns:
    """Assigns each step to a pass, in the order of the model.

    `models.terrain` as an example, where each of these takes the points of the one before it:

    - "clean" looks 80 m around. Nothing is before it: turn 0, reach 80 m.
    - "ground" looks 200 m. In turn 0 it would reach 80 + 200 m into the points. Both look farther
      than APART, so the clean points are stored, and it begins turn 1 with a reach of 200 m.
    - "bottom", the terrain model, looks 50 m: turn 2, reach 50 m. Were it 5 m, less than APART, it
      would stay in turn 1 with a reach of 205 m: storing all points costs more than 5 m do.

    "shade" needs the whole raster. It has a turn, but no reach: it runs after the tiles of turn 2,
    and a local step that used its result would run in turn 3.

    Attributes
    ----------
    least : the first pass that a step may run in, where that is not 0
    turn : number of the pass of each step added so far
    reach : of each local step, metres that it looks into the points given to its pass
    halos : of each local step, metres that it looks around by itself
    """

    def __init__(
        self, model: Model, active: Mapping[str, Step], least: Mapping[str, int] | None = None
    ) -> None:
        self.model, self.active, self.least = model, active, least or {}
        self.turn: dict[str, int] = {}
        self.reach: dict[str, float] = {}
        self.halos: dict[str, float] = {}

    @classmethod
    def of(
        cls,
        model: Model,
        active: Mapping[str, Step],
        steps: Mapping[str, Step],
        halos: Mapping[str, float],
    ) -> _Turns:
        """Assign steps, given in their order, of which each looks some metres around.

        A step that looks hardly around itself, and whose raster a later pass uses, runs in that
        one: there the cells are at hand, else all of them would have to be in memory.
        """
        least: dict[str, int] = {}
        while True:
            turns = cls(model, active, least)
            for step in steps.values():
                turns.add(step, halos[step.name])
            late = {
                maker: turns.turn[name]
                for name, step in steps.items()
                for maker in turns._gridders(step) - turns._before_whole(step)
                if name in turns.reach and turns.turn[maker] < turns.turn[name]
                if turns.halos[maker] < APART
            }
            if not late:
                return turns
            least |= late

    def add(self, step: Step, halo: float) -> None:
        """Find the pass of a step, after those of the steps that it needs."""
        makers = {need.partition(".")[0] for need in step.needs} & self.turn.keys()
        local = {name for name in makers if name in self.reach}
        after = max((self.turn[name] for name in makers), default=0)
        if math.isinf(halo) or not self._is_local(step):
            self.turn[step.name] = after
            return
        whole = max((self.turn[name] + 1 for name in makers - local), default=0)
        turn = max(after, whole, self.least.get(step.name, 0))
        behind = max((self.reach[name] for name in local if self.turn[name] == turn), default=0.0)
        # What is stored between the two needs no surroundings; but rasters would come whole.
        if min(halo, behind) >= APART and all(
            self.halos[name] < APART for name in self._gridders(step, deep=True)
        ):
            turn, behind = turn + 1, 0.0
        self.turn[step.name], self.reach[step.name] = turn, halo + behind
        self.halos[step.name] = halo

    def _gridders(self, step: Step, *, deep: bool = False) -> set[str]:
        """The local steps whose rasters a step needs; with `deep`, also whose these need."""
        grids = [name for name in step.needs if self._is_grid(name)]
        found = {name.partition(".")[0] for name in grids} & self.reach.keys()
        for name in list(found) if deep else ():
            found |= self._gridders(self.active[name], deep=True)
        return found

    def _before_whole(self, step: Step) -> set[str]:
        """The steps that one needs by way of a step on the whole: never in the pass of that one."""
        before = leading_steps(self.active, step.needs)
        whole = [name for name in before if name in self.turn and name not in self.reach]
        return set(leading_steps(self.active, whole))

    def _is_grid(self, name: str) -> bool:
        field = self.model.between.get(name)
        return field is not None and field.kind.is_gridded

    def _is_local(self, step: Step) -> bool:
        """Whether a step can run on tiles: it takes points, and no number that tiles give.

        The number of a tile is not that of the whole survey. A step on rasters alone, of which one
        is made of the whole, has all cells at hand.
        """
        if step.repeat:
            return False  # its results are lists, which are not put together from tiles
        on_tiles = on_cloud = on_whole = False
        for name, link in step.links.items():
            for need in (need for reference in references(link) for need in reference.names):
                maker, _, output = need.partition(".")
                if maker == INPUTS:
                    on_cloud |= self.model.inputs[output].kind.several
                elif maker not in self.active:
                    continue  # left out under these settings; another value stands in for it
                elif maker in self.reach:
                    if not step.spec.inputs[name].kind.is_layer:
                        return False
                    on_tiles = True
                    on_cloud |= not self._is_grid(need)
                elif self.active[maker].repeat:
                    return False
                else:
                    on_whole |= self._is_grid(need)
        return on_cloud or (on_tiles and not on_whole)

    def passes(self, steps: Mapping[str, Step], wanted: Collection[str]) -> Iterator[Pass]:
        """Make the passes of some steps, of which some results are wanted."""
        for turn in range(max(self.turn.values()) + 1):
            local = tuple(n for n in steps if self.turn[n] == turn and n in self.reach)
            rest = tuple(n for n in steps if self.turn[n] == turn and n not in self.reach)
            halo = max((self.reach[name] for name in local), default=0.0)
            yield Pass(
                local, rest, self._kept(local, steps, wanted), self._kept(rest, steps, wanted), halo
            )

    @staticmethod
    def _kept(
        makers: Collection[str], steps: Mapping[str, Step], wanted: Collection[str]
    ) -> frozenset[str]:
        """The results of some steps that are wanted, or used by other steps."""
        used = {need for name, step in steps.items() if name not in makers for need in step.needs}
        return frozenset(n for n in {*wanted, *used} if n.partition(".")[0] in makers)


def _spoken(step: Step) -> Iterator[str]:
    """The numbers of which a step says something in words."""
    if hasattr(getattr(step.spec.make, "Outputs", None), "in_words"):
        yield from (name for name, field in step.outputs.items() if not field.kind.is_layer)


def _whole(model: Model, reach: Mapping[str, float]) -> str:
    """Say why nothing can run on tiles: the docstring of `halo` of the first tool with no limit."""
    text = "the whole cloud is needed with these settings; leave it out"
    far = [model.steps[name].spec for name, metres in reach.items() if math.isinf(metres)]
    tools: list[Any] = [spec.make for spec in far if not isinstance(spec, Model)]
    return f"{text} ({inspect.getdoc(tools[0].halo)})" if tools else text


def surveys_of(
    spec: Spec, sources: Sources, assume_crs: CRS | None, ctx: Context
) -> dict[str, Survey]:
    """Open all point clouds as surveys; they must be in one CRS in which metres have a meaning."""
    found: dict[str, Survey] = {}
    problems: dict[str, str] = {}
    for name, field in spec.sources.items():
        if not field.kind.several or name not in sources:
            continue
        try:
            found[name] = _survey(sources[name], field.many, assume_crs, ctx)
            check_place(found[name], assume_crs)
        except DataError as err:
            problems[name] = str(err)
    for name, survey in found.items():
        first = next(iter(found.values()))
        text = length_problem(survey.crs) or crs_conflict(
            survey.crs, first.crs, heights=True, tools=survey.tools
        )
        if text:
            problems[name] = f"{survey.name} {text}"
        elif not survey.count:
            problems[name] = f"{survey.name} has no points"
    if problems:
        raise DataError(spec.id, problems)
    for survey in found.values():
        _ = survey.template  # made here once, and sent to all workers
    return found


def _survey(
    sources: tuple[Source, ...], many: bool, assume_crs: CRS | None, ctx: Context
) -> Survey:
    if many or sources[0].layer is not None:
        raise DataError("is no survey in files; run the tool without tiles")
    (source,) = sources
    how = dict(source.options)
    bounds = how.pop("bounds", None)
    how = {"assume_crs": assume_crs, **how}
    survey = Survey.open(source.points, ctx=ctx.part(0, 0), **how)
    survey = survey.absolute()
    return survey.limited_to(bounds) if bounds else survey
