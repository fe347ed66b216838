"""Models: chains of tools that are tools themselves. `toolbox.models.reader` reads their files."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from types import SimpleNamespace
from typing import Any

from toolbox import language
from toolbox.context import QUIET, Context, log, settings_named
from toolbox.data import PointCloud, Survey
from toolbox.data.crs import FEET
from toolbox.declare.delivered import Delivered
from toolbox.declare.fields import Field, Spec
from toolbox.declare.kinds import find
from toolbox.declare.spec import shape_problems
from toolbox.declare.values import Memory
from toolbox.errors import DataError, ParameterError

INPUTS = "inputs"  # stands in a reference for the inputs of the model
CLOUD, EITHER = find(PointCloud), find(PointCloud | Survey)
EMPTY = "is an empty list; there is nothing to repeat the step for"


@dataclasses.dataclass(frozen=True)
class Reference:
    """``{from: step.output}``: the first of the named values that is not missing."""

    names: tuple[str, ...]


Link = Reference | tuple[Reference, ...]
"""The connection of an input of a step; for a list several references, missing values left out."""


@dataclasses.dataclass(frozen=True)
class Condition:
    """The condition of a step: an input that is a switch turned on, or a layer that is given.

    Attributes
    ----------
    name : inputs.name, from ``{from: inputs.name}``
    word : the value that a choice must have, from ``{from: inputs.name, is: word}``
    """

    name: str
    word: str | None = None

    def holds(self, known: Mapping[str, Any]) -> bool:
        """Whether the condition is met; an input that is not known yet meets it."""
        value = known.get(self.name, self.word or True)
        if self.word is not None:
            return bool(value == self.word)
        return value if isinstance(value, bool) else value is not None


@dataclasses.dataclass(frozen=True)
class Step:
    """One step of a model: a tool, its settings and its links.

    Attributes
    ----------
    settings : values that the model file gives, by parameter
    links : references to other values, by parameter
    when : the condition without which the step is left out
    repeat : the parameter that takes a list, one value of it for each run of the step
    """

    name: str
    spec: Spec
    settings: Mapping[str, Any]
    links: Mapping[str, Link]
    when: Condition | None = None
    repeat: str | None = None

    @property
    def needs(self) -> list[str]:
        """The names of all values that the step refers to."""
        return [name for link in self.links.values() for name in _names(link)]

    @property
    def params(self) -> dict[str, Link]:
        """The links of parameters that are no layers."""
        inputs = self.spec.inputs
        return {
            n: link for n, link in self.links.items() if n in inputs and inputs[n].role == "param"
        }

    @property
    def names(self) -> dict[str, str]:
        """The inputs of the model by the input of the step that each is handed on to."""
        given = [(name, full) for name, link in self.links.items() for full in _names(link)]
        begin = f"{INPUTS}."
        return {n: full.removeprefix(begin) for n, full in given if full.startswith(begin)}

    def input(self, name: str) -> Field | None:
        """The field of an input; the repeated parameter is a required list."""
        field = self.spec.inputs.get(name)
        if field is None or name != self.repeat:
            return field
        return dataclasses.replace(field, many=True, optional=False, default=dataclasses.MISSING)

    @property
    def outputs(self) -> dict[str, Field]:
        """The fields of its outputs, by step.output; those of a repeated step are lists."""
        found = {}
        for name, field in self.spec.outputs.items():
            full = f"{self.name}.{name}"
            many = field.many or self.repeat is not None
            found[full] = dataclasses.replace(field, name=full, many=many)
        return found


@dataclasses.dataclass(frozen=True)
class Model(Spec):
    """The specification of a tool that is a chain of other tools.

    Attributes
    ----------
    steps : by name, each after the steps that it refers to
    returns : the reference of each output
    deliver : the files of the set that is handed over
    handed : values that inputs have for the set unless they are given
    extra : names of steps that run only where one of their results is asked for
    """

    make: Callable[..., ModelRun] = dataclasses.field(init=False, repr=False, compare=False)
    steps: Mapping[str, Step]
    returns: Mapping[str, Reference]
    deliver: tuple[Delivered, ...] = ()
    handed: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    extra: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        object.__setattr__(self, "make", self._run)

    def _run(self, **values: Any) -> ModelRun:
        """Check values as the class of a tool does, and make a run of the model with them."""
        if problems := self.problems(values) or self.rules(values):
            raise ParameterError(self.id, problems)
        defaults = {name: f.default for name, f in self.inputs.items() if not f.required}
        return ModelRun(self, defaults | self.in_feet(values) | values)

    def subset(self, names: Collection[str]) -> Model:
        """The model with these steps only, and the outputs that refer to them."""
        steps = {name: step for name, step in self.steps.items() if name in names}
        made = {name for step in steps.values() for name in step.outputs}
        returns = {name: r for name, r in self.returns.items() if made & set(r.names)}
        outs = {name: self.outputs[name] for name in returns}
        return dataclasses.replace(self, steps=steps, returns=returns, outputs=outs)

    def wanting(self, results: Iterable[str]) -> Model:
        """The model with those extra steps only that some results (step.output) need."""
        needed = leading_steps(self.steps, results)
        left_out = self.extra.difference(needed)
        steps = {name: step for name, step in self.steps.items() if name not in left_out}
        return dataclasses.replace(self, steps=steps, extra=self.extra - left_out)

    def under(self, settings: Mapping[str, Any]) -> Model:
        """The model whose clouds are opened as surveys, where all steps that run can read these."""
        steps = self.active(settings)
        inputs = dict(self.inputs)
        for name, field in self.sources.items():
            if field.kind is CLOUD and reads_batches(steps, f"{INPUTS}.{name}"):
                inputs[name] = dataclasses.replace(field, kind=EITHER)
        return dataclasses.replace(self, inputs=inputs)

    @property
    def between(self) -> Mapping[str, Field]:
        """The fields of all results of steps, by step.output; a run may write these, too."""
        return {name: f for step in self.steps.values() for name, f in step.outputs.items()}

    def active(self, settings: Mapping[str, Any]) -> list[Step]:
        """The steps that run with these settings, or may run if a condition is not known yet."""
        return _active(self.steps, self._known(settings))

    def idle(self, settings: Mapping[str, Any]) -> list[str]:
        """The inputs that no active step uses."""
        used = {name for step in self.active(settings) for name in step.needs}
        used |= {step.when.name for step in self.steps.values() if step.when}
        return [name for name in self.inputs if f"{INPUTS}.{name}" not in used]

    def users(self, name: str) -> list[str]:
        """The titles of the tools of the steps that use an input."""
        using = (step for step in self.steps.values() if f"{INPUTS}.{name}" in step.needs)
        return list(dict.fromkeys(step.spec.title for step in using))

    def switches(self, name: str) -> list[str]:
        """The inputs without which the steps that use an input are left out."""
        using = (step for step in self.steps.values() if f"{INPUTS}.{name}" in step.needs)
        asked = (step.when.name.removeprefix(f"{INPUTS}.") for step in using if step.when)
        return list(dict.fromkeys(asked))

    def halo(self, settings: Mapping[str, Any]) -> float:
        """The largest distance in metres that a result looks into the sources.

        Lengths without a value may be those for data in metres or in feet, which is not known yet.
        """
        in_feet = {n: f.default_in(max(FEET)) for n, f in self.inputs.items() if f.feet}
        each = (self.reach(settings), self.reach({**in_feet, **settings}))
        return max((metres for reach in each for metres in reach.values()), default=0.0)

    def reach(self, settings: Mapping[str, Any]) -> dict[str, float]:
        """The distance in metres that the results of each active step look into the sources."""
        found: dict[str, float] = {}
        for step in self.active(settings):
            before = (found.get(name.partition(".")[0], 0.0) for name in step.needs)
            found[step.name] = max(before, default=0.0) + self.step_halo(step, settings)
        return found

    def step_halo(self, step: Step, settings: Mapping[str, Any]) -> float:
        """The distance in metres that a step looks into its layers; inf if it is not known yet."""
        known = self._known(settings)
        if not _ready(step, known):
            return math.inf
        return max(map(step.spec.halo, _each(step, _draft(step, known))), default=0.0)

    @property
    def memory(self) -> Memory:
        """What a tile with its neighbourhood needs for the hungriest of its steps."""
        return Memory.most(step.spec.memory for step in self.steps.values())

    def rules(self, settings: Mapping[str, Any]) -> dict[str, str]:
        """All problems of the values of steps, by step.parameter."""
        known = self._known(settings)
        found: dict[str, str] = {}
        for step in _active(self.steps, known):
            draft = _draft(step, known)
            if step.repeat and draft.get(step.repeat) == ():
                found[f"{step.name}.{step.repeat}"] = EMPTY
            for each in _each(step, draft):
                texts = _limits(step, each)
                # With a value that another step will give, the rules between values are not known.
                if not texts and _ready(step, known):
                    texts = step.spec.rules(each)
                found |= {f"{step.name}.{name}": text for name, text in texts.items()}
        return found

    def _known(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """The values of parameters, given or by default, by inputs.name."""
        params = {n: f for n, f in self.inputs.items() if f.role == "param"}
        defaults = {name: f.default for name, f in params.items() if not f.required}
        given = {name: value for name, value in settings.items() if name in params}
        return {f"{INPUTS}.{name}": value for name, value in (defaults | given).items()}

    def describe(self) -> dict[str, Any]:
        """The process description of the model, with the results of its steps under "between"."""
        between = {name: field.schema() for name, field in self.between.items()}
        files = [{"file": d.file, "output": d.output, "description": d.help} for d in self.deliver]
        return super().describe() | {"between": between} | ({"deliver": files} if files else {})


def reads_batches(steps: Iterable[Step], name: str) -> bool:
    """Whether all of the steps that take a cloud can read it in batches, and some step does."""
    takers = [
        step.spec.inputs[parameter].kind
        for step in steps
        for parameter, link in step.links.items()
        if any(name in reference.names for reference in references(link))
    ]
    return bool(takers) and all(kind is EITHER for kind in takers)


def references(link: Link) -> tuple[Reference, ...]:
    """The single references of a link."""
    return link if isinstance(link, tuple) else (link,)


def _names(link: Link) -> list[str]:
    """The names of all values that a link refers to."""
    return [name for reference in references(link) for name in reference.names]


def step_values(step: Step, links: Mapping[str, Link], found: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a step; a link without a value leaves the default of the tool."""
    values = dict(step.settings)
    for name, link in links.items():
        value = resolved(link, found)
        stated = any(full in found for r in references(link) for full in r.names)
        if value is not None or (stated and step.spec.inputs[name].optional):
            values[name] = value
    return values


def resolved(link: Link, found: Mapping[str, Any]) -> Any:
    """The value of a link; None if it is missing."""
    if isinstance(link, tuple):
        values = (resolved(reference, found) for reference in link)
        return tuple(value for value in values if value is not None)
    return next((found[name] for name in link.names if found.get(name) is not None), None)


def _ready(step: Step, known: Mapping[str, Any]) -> bool:
    """Whether all parameters of a step that are no layers have known values."""
    return all(_there(link, known) for link in step.params.values())


def _there(link: Link, known: Mapping[str, Any]) -> bool:
    return all(name in known for r in references(link) for name in r.names)


def _draft(step: Step, known: Mapping[str, Any]) -> dict[str, Any]:
    """The values of the parameters of a step that are known."""
    links = {name: link for name, link in step.params.items() if _there(link, known)}
    return step_values(step, links, known)


def _each(step: Step, draft: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """The values for each run of a step."""
    if step.repeat is None or step.repeat not in draft:
        yield draft
        return
    for item in draft[step.repeat]:
        yield {**draft, step.repeat: item}


def _limits(step: Step, draft: Mapping[str, Any]) -> dict[str, str]:
    """The problems of single values of a step, by parameter."""
    texts = {name: step.spec.inputs[name].problem(value) for name, value in draft.items()}
    return {name: text for name, text in texts.items() if text}


def leading_steps(steps: Mapping[str, Step], results: Iterable[str]) -> list[str]:
    """The names of the steps that are needed for some results (step.output), in their order."""
    found: set[str] = set()
    ahead = [name.partition(".")[0] for name in results]
    while ahead:
        name = ahead.pop()
        if name in steps and name not in found:
            found.add(name)
            ahead += [need.partition(".")[0] for need in steps[name].needs]
    return [name for name in steps if name in found]


def _active(steps: Mapping[str, Step], known: Mapping[str, Any]) -> list[Step]:
    return [step for step in steps.values() if step.when is None or step.when.holds(known)]


Runner = Callable[[str, Any, Context], Any]
"""Runs the tool of a step: takes the name of the step, the tool with its values and a context."""


def run_tool(name: str, job: Any, ctx: Context) -> Any:
    """Run the tool of a step, and do nothing else."""
    return job.run(ctx)


@dataclasses.dataclass(frozen=True)
class ModelRun:
    """A model with its values, ready to run.

    Attributes
    ----------
    keep : results of steps that are wanted too, by step.output
    given : results of steps that are not run here, by step.output
    runner : runs each tool; a step of an inner model is named "step/inner step"
    gaps : whether a step without a layer that it needs is left out, and is no error: in a tile,
        the step before it may have found nothing
    """

    spec: Model
    values: Mapping[str, Any]
    keep: frozenset[str] = frozenset()
    given: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    runner: Runner = run_tool
    gaps: bool = False

    def run(self, ctx: Context = QUIET) -> SimpleNamespace:
        """Run the steps in order; each result is released after its last use."""
        ctx = ctx.keeping()
        found = {f"{INPUTS}.{name}": value for name, value in self.values.items()}
        found |= self.given
        steps = _active(self.spec.wanting(self.keep).steps, found)
        from toolbox.models.places import (
            conflicting,
            unmeasurable,
        )  # which look at steps themselves

        problems = unmeasurable(steps, found) or conflicting(steps, found)
        if problems := problems or shape_problems(self.spec, self.values):
            raise DataError(self.spec.id, problems)
        wanted = {name for r in self.spec.returns.values() for name in r.names} | self.keep
        for index, step in enumerate(steps):
            part = ctx.part(index / len(steps), (index + 1) / len(steps))
            part.progress(0.0)
            log.debug("%s: step %s (%s)", self.spec.id, step.name, step.spec.id)
            found |= self._results(step, found, part)
            used = wanted.union(*(left.needs for left in steps[index + 1 :]))
            found = {name: value for name, value in found.items() if name in used}
        ctx.progress(1.0)
        outs = {name: resolved(link, found) for name, link in self.spec.returns.items()}
        return SimpleNamespace(**outs, **{name: found.get(name) for name in self.keep})

    def _results(self, step: Step, found: Mapping[str, Any], ctx: Context) -> dict[str, Any]:
        """Run a step: its results by step.output, as tuples if it is repeated."""
        values = step_values(step, step.links, found)
        if step.repeat is None:
            result = self._result(step, step.name, values, ctx)
            return {f"{step.name}.{name}": getattr(result, name) for name in step.spec.outputs}
        items = values[step.repeat]
        if not items:
            raise ParameterError(self._where(step, step.name), {step.repeat: EMPTY})
        results = []
        for index, item in enumerate(items):
            part = ctx.part(index / len(items), (index + 1) / len(items))
            each = values | {step.repeat: item}
            results.append(self._result(step, f"{step.name} {index + 1}", each, part))
        names = step.spec.outputs
        return {f"{step.name}.{n}": tuple(getattr(r, n) for r in results) for n in names}

    def _result(self, step: Step, name: str, values: Mapping[str, Any], ctx: Context) -> Any:
        where = self._where(step, name)
        needed = [n for n, field in step.spec.sources.items() if not field.optional]
        if self.gaps and any(values.get(n) is None for n in needed):
            return SimpleNamespace(**dict.fromkeys(step.spec.outputs))
        job = step.spec.build(values, where)
        title = language.text(step.spec.title)
        ctx.stage(language.text("Step {name}: {title}").format(name=name, title=title))
        try:
            with settings_named(step.names):
                if not isinstance(job, ModelRun):
                    return self.runner(name, job, ctx)
                inner = dataclasses.replace(job, runner=self._runner_within(name), gaps=self.gaps)
                return inner.run(ctx)
        except (ParameterError, DataError) as err:
            if (
                isinstance(job, ModelRun) and err.problems
            ):  # named after the step of that model, too
                where = f"{where}: {err.where}"
            raise err.named(where) from err
        except Exception as err:
            err.add_note(f"in {where}")
            raise

    def _runner_within(self, step: str) -> Runner:
        return lambda name, job, ctx: self.runner(f"{step}/{name}", job, ctx)

    def _where(self, step: Step, name: str) -> str:
        return f"{self.spec.id}, step '{name}' ({step.spec.id})"
