"""Reads a model file, checks all of its links, and reports all of its mistakes at once.

The value of a parameter of a step is a plain value or a reference: ``{from: step.output}`` or
``{from: inputs.name}``. ``{from: [clean.clean, inputs.points]}`` takes the first value that is not
missing. A reference to something that is wrong itself is not reported again.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping
from graphlib import CycleError
from pathlib import Path
from typing import Any

from toolbox import renamed
from toolbox.declare.delivered import Delivered
from toolbox.declare.fields import Field, Spec
from toolbox.declare.kinds import OPTIONS
from toolbox.declare.spec import NAME, RESERVED
from toolbox.errors import ParameterError, nearest
from toolbox.models import documents
from toolbox.models import inputs as model_inputs
from toolbox.models.inputs import parsed, short, word_problems
from toolbox.models.links import condition_of, in_order, is_sure, link_of, misfit, of_inputs
from toolbox.models.model import INPUTS, Condition, Link, Model, Reference, Step, references

MODEL_WORDS = ("id", "title", "summary", "help", "tags", "inputs", "steps", "outputs", "deliver")
NEEDED = ("id", "title", "steps", "outputs")
DELIVER_WORDS = ("values", "steps", "files")
FILE_NEEDS, FILE_FLAGS = ("file", "from", "help"), ("in_report", "needed")  # of a file ...
FILE_WORDS = (*FILE_NEEDS, *FILE_FLAGS)  # ... of the set, beside the options of writing it
STEP_WORDS = ("tool", "when", "repeat")  # of a step, beside the parameters of its tool
ID = re.compile(rf"{NAME.pattern}(\.{NAME.pattern})+")


def load(path: Path, find: Callable[[str], Spec]) -> Model:
    """Read a model.

    Parameters
    ----------
    path : of a YAML file
    find : gives the specification of a tool by its id, or raises ParameterError

    Raises
    ------
    ParameterError
        The file cannot be read, or is no valid model; all mistakes in one error.
    """
    try:
        text = documents.mapping(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError:
        raise ParameterError(f"{path} cannot be read as a model: is no UTF-8 text") from None
    except (OSError, ValueError) as err:
        why = getattr(err, "strerror", None) or err
        raise ParameterError(f"{path} cannot be read as a model: {why}") from None
    return _ModelFile(path, find).model(text)


class _ModelFile:
    """Reads one model file, and collects its problems."""

    def __init__(self, path: Path, find: Callable[[str], Spec]) -> None:
        self.path, self.find = path, find
        self.problems: dict[str, str] = {}
        self.broken: set[str] = (
            set()
        )  # inputs and steps with mistakes, of which nothing more is known

    def model(self, text: Mapping[str, Any]) -> Model:
        self.problems |= word_problems("model", text, MODEL_WORDS, needed=NEEDED)
        id, title = str(text.get("id", "")), str(text.get("title", ""))
        if not ID.fullmatch(id):
            self.problems["id"] = f"must be like models.terrain, got {short(id)}"
        section = self._section(text, "inputs")
        inputs, problems = model_inputs.read(section)
        self.problems |= problems
        self.broken |= {f"{INPUTS}.{name}" for name in section.keys() - inputs.keys()}
        deliver = self._section(text, "deliver")
        self.problems |= word_problems("deliver", deliver, DELIVER_WORDS, needed=())
        own, extra = self._section(text, "steps"), self._section(deliver, "steps")
        steps = self._steps({**extra, **own}, inputs)
        self._apart(own, extra, steps)
        inputs = _labelled(inputs, steps)
        returns, outs = self._returns(self._section(text, "outputs"), inputs, steps)
        self._unused(inputs, steps)
        self._ambiguous(inputs | outs, steps)
        for name, link in returns.items():
            if used := [full for full in link.names if full.partition(".")[0] in extra]:
                self.problems[f"outputs.{name}"] = (
                    f"{used[0]!r} is made only where it is handed over"
                )
        files = self._files(deliver.get("files") or [], outs, steps)
        handed = self._handed(self._section(deliver, "values"), inputs)
        tags = self._tags(text.get("tags"))
        if self.problems:
            raise ParameterError(str(self.path), self.problems)
        summary = str(text.get("summary", "")).rstrip(".")
        help = str(text.get("help", "")).strip() or f"{title}."
        how: dict[str, Any] = {"summary": summary, "tags": tags, "deliver": files, "handed": handed}
        how["extra"] = frozenset(extra)
        made = Model(id, title, help, inputs, outs, steps, returns, **how)
        if problems := made.rules({}):
            raise ParameterError(str(self.path), problems)
        return made

    def _section(self, text: Mapping[str, Any], name: str) -> dict[str, Any]:
        """The names and values of a section of the file."""
        section = text.get(name) or {}
        if not isinstance(section, Mapping):
            self.problems[name] = f"must hold names and values, got {short(section)}"
            return {}
        for key in section:
            if not NAME.fullmatch(str(key)) or key == INPUTS:
                self.problems[f"{name}.{key}"] = "names are lower_case words, and not inputs"
            elif key in RESERVED and name != "steps":
                self.problems[f"{name}.{key}"] = "is an option of every run; choose another name"
        return {str(key): value for key, value in section.items()}

    def _apart(
        self, own: Mapping[str, Any], extra: Mapping[str, Any], steps: Mapping[str, Step]
    ) -> None:
        """Report steps of the set with names of others, and others that need steps of the set."""
        for name in own.keys() & extra.keys():
            self.problems[f"deliver.steps.{name}"] = "is the name of another step too"
        for step in [steps[name] for name in own.keys() & steps.keys()]:
            if used := [need for need in step.needs if need.partition(".")[0] in extra]:
                self.problems[step.name] = f"{used[0]!r} is made only where it is handed over"

    def _files(
        self, said: Any, outs: Mapping[str, Field], steps: Mapping[str, Step]
    ) -> tuple[Delivered, ...]:
        """The files of the set that is handed over."""
        if not isinstance(said, list) or not all(isinstance(one, Mapping) for one in said):
            self.problems["deliver.files"] = "must be a list of {file: ..., from: ..., help: ...}"
            return ()
        known = dict(outs) | {
            n: field for step in steps.values() for n, field in step.outputs.items()
        }
        kinds = {name: field.kind for name, field in known.items()}
        made: list[Delivered] = []
        for number, one in enumerate(said, start=1):
            where = f"deliver.files {number}"
            if missing := word_problems(where, one, (*FILE_WORDS, *OPTIONS), needed=FILE_NEEDS):
                self.problems |= missing
                continue
            flags = {word: one.get(word, False) for word in FILE_FLAGS}
            if wrong := [word for word, flag in flags.items() if not isinstance(flag, bool)]:
                said = short(flags[wrong[0]])
                self.problems[where] = f"{wrong[0]} must be true or false, got {said}"
                continue
            options = {name: value for name, value in one.items() if name not in FILE_WORDS}
            name, output, help = (str(one[word]) for word in FILE_NEEDS)
            file = Delivered(name, output, help, options, **flags)
            if problem := None if self._excused(file.output) else file.problem(kinds):
                self.problems[where] = problem
            elif file.key in {other.key for other in made}:
                self.problems[where] = f"{file.key!r} is declared twice"
            made.append(file)
        return tuple(made)

    def _handed(self, said: Mapping[str, Any], inputs: Mapping[str, Field]) -> dict[str, Any]:
        """The values that inputs have for the set unless they are given."""
        found = {}
        for name, value in said.items():
            if name not in inputs:
                problem: str | None = f"there is no input of that name{nearest(name, inputs)}"
            else:
                found[name], problem = model_inputs.parsed(inputs[name], value)
            if problem:
                self.problems[f"deliver.values.{name}"] = problem
        return found

    def _tags(self, said: Any) -> tuple[str, ...]:
        """The words that people search for; none if nothing is said."""
        words = said or []
        if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
            self.problems["tags"] = f"must be a list of words, got {short(said)}"
            return ()
        return tuple(words)

    def _unused(self, inputs: Mapping[str, Field], steps: Mapping[str, Step]) -> None:
        """Report inputs that no step uses, unless another mistake may be the cause."""
        if self.problems:
            return
        used = {name for step in steps.values() for name in step.needs}
        used |= {step.when.name for step in steps.values() if step.when}
        for name in inputs:
            if f"{INPUTS}.{name}" not in used:
                self.problems[f"{INPUTS}.{name}"] = "no step refers to it"

    def _ambiguous(self, layers: Mapping[str, Field], steps: Mapping[str, Step]) -> None:
        """Report results of steps whose names are also reading options, such as points.bounds."""
        for step in steps.values():
            field = layers.get(step.name)
            options = (*field.kind.open_options, *field.kind.save_options) if field else ()
            for name in {f"{step.name}.{option}" for option in options} & step.outputs.keys():
                self.problems[step.name] = f"{name} would mean two things; rename the step"

    # Steps

    def _steps(self, section: Mapping[str, Any], inputs: Mapping[str, Field]) -> dict[str, Step]:
        drafts = {name: self._step(name, says) for name, says in section.items()}
        steps = self._ordered({name: step for name, step in drafts.items() if step})
        self.broken |= drafts.keys() - steps.keys()
        known = {f"{INPUTS}.{name}": field for name, field in inputs.items()}
        known |= {name: field for step in steps.values() for name, field in step.outputs.items()}
        for step in steps.values():
            self._check(step, known, steps)
        return steps

    def _unknown(self, link: Reference, known: Mapping[str, Field]) -> str | None:
        """Report a name in a reference that does not exist."""
        missing = [n for n in link.names if n not in known and not self._excused(n)]
        return f"nothing called {missing[0]!r}{nearest(missing[0], known)}" if missing else None

    def _excused(self, name: str) -> bool:
        return name in self.broken or name.partition(".")[0] in self.broken

    def _step(self, name: str, says: Any) -> Step | None:
        if not isinstance(says, Mapping) or not isinstance(says.get("tool"), str):
            self.problems[f"{name}.tool"] = "missing: each step says which tool it runs"
            return None
        says = {str(key): value for key, value in says.items()}  # {ignore: 7,18} has a number too
        try:
            spec = self.find(says["tool"])
            says = renamed.values(spec.id, says)
        except ParameterError as err:
            self.problems[f"{name}.tool"] = str(err).replace("\n", "\n  ")
            return None
        links: dict[str, Link] = {}
        plain: dict[str, Any] = {}
        for key in [key for key in says if key not in STEP_WORDS]:
            try:
                link = link_of(says[key])
            except ValueError as err:
                self.problems[f"{name}.{key}"] = str(err)
                continue
            if link:
                links[key] = link
            else:
                plain[key] = says[key]
        step = Step(name, spec, {}, links, self._when(name, says), self._repeat(name, says, spec))
        return dataclasses.replace(step, settings=self._settings(step, plain))

    def _when(self, name: str, says: Mapping[str, Any]) -> Condition | None:
        if "when" not in says:
            return None
        try:
            return condition_of(says["when"])
        except ValueError as err:
            self.problems[f"{name}.when"] = str(err)
            return None

    def _repeat(self, name: str, says: Mapping[str, Any], spec: Spec) -> str | None:
        word = says.get("repeat")
        if word is None:
            return None
        field = spec.inputs.get(str(word))
        if field is None or field.many or word not in says:
            why = "takes a list anyway" if field and field.many else "is no parameter given here"
            self.problems[f"{name}.repeat"] = f"{word!r} {why}"
            return None
        return str(word)

    def _settings(self, step: Step, given: Mapping[str, Any]) -> dict[str, Any]:
        """Read the plain values of a step, by the types of its tool."""
        found: dict[str, Any] = {}
        for name, text in step.spec.names_problems([*given, *step.links]).items():
            self.problems.setdefault(f"{step.name}.{name}", text)
        for name, value in given.items():
            if (field := step.input(name)) is None:
                continue
            if field.kind.is_layer and value is not None:
                problem: str | None = "is a layer; it needs a reference {from: step.output}"
            else:
                found[name], problem = parsed(field, value)
            if problem:
                self.problems[f"{step.name}.{name}"] = problem
        return found

    def _ordered(self, steps: Mapping[str, Step]) -> dict[str, Step]:
        """Sort the steps: each after those that it refers to, else in the order of the file."""
        before = {n: {need.partition(".")[0] for need in s.needs} for n, s in steps.items()}
        try:
            return {name: steps[name] for name in in_order(before)}
        except CycleError as err:
            self.problems["steps"] = f"wait for each other: {' -> '.join(err.args[1])}"
            return dict(steps)

    def _check(self, step: Step, known: Mapping[str, Field], steps: Mapping[str, Step]) -> None:
        """Report links of a step whose values do not exist or do not fit."""
        if step.when and (text := self._condition_problem(step.when, known)):
            self.problems[f"{step.name}.when"] = text
        for name, link in step.links.items():
            want = step.input(name)
            if want and (text := self._link_problem(step, want, link, known, steps)):
                self.problems[f"{step.name}.{name}"] = text

    def _condition_problem(self, when: Condition, known: Mapping[str, Field]) -> str | None:
        if text := self._unknown(Reference((when.name,)), known):
            return text
        choices = known[when.name].choices if when.name in known else ()
        if when.word is None and choices:
            return f"{when.name} is a choice; say which, {{from: {when.name}, is: {choices[0]}}}"
        if when.word is not None and when.name in known and when.word not in choices:
            words = (
                f"one of {', '.join(map(str, choices))}" if choices else "a switch, not a choice"
            )
            return f"{when.name} is {words}, got {when.word!r}"
        return None

    def _link_problem(
        self,
        step: Step,
        want: Field,
        link: Link,
        known: Mapping[str, Field],
        steps: Mapping[str, Step],
    ) -> str | None:
        """Say why a parameter cannot take the values of its link."""
        if isinstance(link, tuple) and not want.many:
            return "takes one value, not a list"
        one = dataclasses.replace(want, many=False) if isinstance(link, tuple) else want
        for reference in references(link):
            if text := self._unknown(reference, known) or misfit(reference, known, one):
                return text
        names = [name for reference in references(link) for name in reference.names]
        excused = any(map(self._excused, names))
        if excused or not want.required or is_sure(names, step.when, known, steps):
            return None
        return (
            f"{names[0]!r} may be missing; say what to take then, {{from: [{names[0]}, ...]}}, "
            "or leave this step out by the same 'when'"
        )

    # Outputs

    def _returns(
        self, section: Mapping[str, Any], inputs: Mapping[str, Field], steps: Mapping[str, Step]
    ) -> tuple[dict[str, Reference], dict[str, Field]]:
        known = {name: field for step in steps.values() for name, field in step.outputs.items()}
        returns: dict[str, Reference] = {}
        outs: dict[str, Field] = {}
        for name, says in section.items():
            text = dict(says) if isinstance(says, Mapping) else {"from": says}
            help, label = text.pop("help", None), text.pop("label", None)
            try:
                link = link_of(text)
            except ValueError as err:
                self.problems[f"outputs.{name}"] = str(err)
                continue
            if problem := self._output_problem(name, link, inputs, known):
                self.problems[f"outputs.{name}"] = problem
            elif isinstance(link, Reference) and not any(map(self._excused, link.names)):
                first = known[link.names[0]]
                theirs = first.label if first.name.rpartition(".")[2] == name else ""
                sure = is_sure(link.names, None, known, steps)
                returns[name] = link
                outs[name] = dataclasses.replace(
                    first,
                    name=name,
                    help=str(help or first.help),
                    label=str(label or theirs),
                    optional=not sure,
                )
        return returns, outs

    def _output_problem(
        self,
        name: str,
        link: Link | None,
        inputs: Mapping[str, Field],
        known: Mapping[str, Field],
    ) -> str | None:
        if not isinstance(link, Reference):
            return "must be {from: step.output}"
        if name in inputs:
            return "is the name of an input too"
        if taken := [full for full in link.names if of_inputs(full)]:
            return f"{taken[0]!r} is what the model is given; an output is what a step gives"
        if text := self._unknown(link, known):
            return text
        there = [known[full] for full in link.names if full in known]
        return misfit(link, known, there[0]) if there else None


def _labelled(inputs: Mapping[str, Field], steps: Mapping[str, Step]) -> dict[str, Field]:
    """The inputs, those without a label with that of a parameter of their name that they feed."""
    found = dict(inputs)
    for step in steps.values():
        for name in step.links.keys() & found.keys():
            theirs, ours = step.spec.inputs[name], found[name]
            named = {full for ref in references(step.links[name]) for full in ref.names}
            if f"{INPUTS}.{name}" in named and theirs.kind is ours.kind:
                words = {} if theirs.choices != ours.choices else theirs.words
                label, words = ours.label or theirs.label, ours.words or words
                offers = theirs.offers
                found[name] = dataclasses.replace(ours, label=label, words=words, offers=offers)
    return found
