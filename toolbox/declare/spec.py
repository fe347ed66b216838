"""The vocabulary of a declaration: @tool, @outputs, source(), param(), sink().

A tool is one frozen dataclass. The type, default, unit, limits and help of a parameter are stated
in its field and nowhere else. The Python call, the command line, the process description, the docs
and the tests of every tool are made from the fields.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
import operator
import re
import sys
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, Literal, TypeVar, cast, dataclass_transform

from toolbox.context import QUIET, Context, log
from toolbox.data.crs import crs_conflict, length_problem
from toolbox.data.layer import Layer
from toolbox.data.report import Column
from toolbox.data.vector import Vector
from toolbox.declare import kinds
from toolbox.declare.expression import Expression
from toolbox.declare.fields import MEETS, METRE_POWERS, SHAPES, UNITS, Field, Spec
from toolbox.declare.show import Show
from toolbox.errors import DataError, ParameterError, nearest
from toolbox.labels import LONGEST_TITLE, in_words
from toolbox.shown import SHOWN

T = TypeVar("T", bound=type)
REGISTRY: dict[str, Spec] = {}
RESERVED = {"assume_crs", "events", "help", "json", "overwrite", "params", *SHOWN}
RESERVED |= {"quiet", "result", "verbose", "tile", "workers", "scheduler", "memory", "resume"}
RESERVED |= {"client", "date", "field", "logo", "style", "title"}  # of reports
RESERVED |= {"tool", "when", "repeat"}  # words of a step in a model
NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
TITLE = re.compile(r"[A-Z][^`*<>]*")
HELP = re.compile(r"[A-Z](.*[^.\s])?")
LABEL = re.compile(r"(n|[A-Z0-9]).*[^.\s]")  # also nDSM
LONGEST_LABEL = 40
LONGEST = 100  # characters of a help and of a line of a docstring


def source(
    help: str,
    *,
    default: Any = dataclasses.MISSING,
    label: str = "",
    any_crs: bool = False,
    shapes: str | tuple[str, ...] = (),
) -> Any:
    """Declare a layer that the tool reads.

    One that may be left out is annotated ``X | None`` and has the default None; several of a kind
    are annotated ``tuple[X, ...]``. `label` is its title in dialogs, where the words of its name
    are not those of its users. With `any_crs` the tool itself looks at the CRS of the layer, which
    may be none, in degrees, or another one than that of the other layers. `shapes` says what
    features must be, "point", "line" or "polygon", or which of these: dialogs offer only such
    layers. The tool refuses others by itself.

    Examples
    --------
    >>> points: PointCloud = source("Points to classify")
    >>> roads: PointCloud | None = source("Points on roads, if they are known", default=None)
    >>> yards: Vector = source("Yards to leave out", shapes="polygon")
    """
    shapes = (shapes,) if isinstance(shapes, str) else shapes
    meta = {"role": "source", "help": help, "label": label, "any_crs": any_crs, "shapes": shapes}
    return dataclasses.field(default=default, metadata=meta)


def param(
    help: str,
    *,
    default: Any = dataclasses.MISSING,
    unit: str | None = None,
    of: str | None = None,
    label: str = "",
    words: Mapping[Any, str] | None = None,
    offers: tuple[str, ...] = (),
    **limits: float,
) -> Any:
    """Declare a number, switch, word or other value; without a default it must be given.

    Parameters
    ----------
    help : one sentence without a full stop
    unit : "m" and other lengths are metres for the user whatever the data; "1" is a ratio or count
    of : the source to which an `Attribute` or `Expression` refers, or whose attributes or bands
        dialogs offer for a text or number
    label : its title in dialogs, where the words of its name are not those of its users
    words : what dialogs and reports call each choice, and reports each of `offers`, where its own
        words do not say enough
    offers : texts that dialogs offer, such as names of what the toolbox brings along; others may
        be given
    limits : gt, ge, lt, le

    Examples
    --------
    >>> cell: float = param("Size of a cell", default=1.0, unit="m", gt=0)
    >>> method: Literal["mean", "median"] = param("What a cell holds", default="mean")
    """
    meta: dict[str, Any] = {"role": "param", "help": help, "unit": unit, "limits": limits, "of": of}
    meta |= {"label": label, "words": words or {}, "offers": offers}
    return dataclasses.field(default=default, metadata=meta)


def sink(
    help: str,
    *,
    unit: str | None = None,
    show: Show | tuple[Show, ...] = (),
    label: str = "",
    columns: Mapping[str, Column] = MappingProxyType({}),
    also: tuple[str, ...] = (),
    listed: bool = True,
) -> Any:
    """Declare a layer, number or text that the tool returns.

    Parameters
    ----------
    help : one sentence without a full stop
    unit, label : as of a parameter
    show : how a layer is shown in a plot, see `toolbox.declare.show`; several make several panels
    columns : heading, unit and digits of the columns of a table or of features, in reports; those
        of other names are shown by their names
    also : formats for layers of a certain content, such as ".ifc", that this one has or may have
    listed : False for features that the table of another output has, too: reports list them on
        paper once, and in a browser where they are asked for

    Examples
    --------
    >>> ground_share: float = sink("Share of points that are ground", unit="1")
    """
    shows = show if isinstance(show, tuple) else (show,)
    meta = {"role": "sink", "help": help, "unit": unit, "show": shows, "label": label}
    return dataclasses.field(metadata=meta | {"columns": columns, "also": also, "listed": listed})


@dataclass_transform(
    frozen_default=True, kw_only_default=True, field_specifiers=(param, source, sink)
)
def outputs(cls: T) -> T:
    """Make the class `Outputs` inside a tool, whose fields are the results of the tool.

    It may have ``in_words()``, the result as a paragraph for the summary of a report, and
    ``not_looked_at()``, texts on what the tool did not look at or did not see. Both use nothing but
    the fields.

    Examples
    --------
    >>> @outputs
    ... class Outputs:
    ...     count: int = sink("Number of points", unit="1")
    >>> Outputs(count=3).count
    3
    """
    return cast(T, dataclasses.dataclass(frozen=True, kw_only=True)(cls))


@dataclass_transform(
    frozen_default=True, kw_only_default=True, field_specifiers=(param, source, sink)
)
def tool(id: str, *, title: str = "", tags: tuple[str, ...] = ()) -> Callable[[T], T]:
    """Make a frozen dataclass that checks its values, and register it.

    `title` names the tool in lists, dialogs and reports in at most 30 characters, and `tags` are
    words by which people search for it, besides those of the texts.

    The class has a docstring (first line: what it does, in one sentence), fields, `Outputs`,
    `run(ctx)`, `halo()` if it reads layers, and may have `check()`, which yields (parameter,
    problem) for rules between values, and `check_data()` for what the layers must hold. `halo()`
    gives metres, or `math.inf` for a tool that needs the whole cloud. `check` and `halo` must not
    look at layers: a model and the tile engine ask them before there are any. An attribute
    ``memory = Memory(...)`` says how much is needed, where that was measured, so that tiles are
    not smaller than they must be.

    Inside `run` all lengths are in the unit of the data: a `cell` of 1 m is 3.28 when the
    coordinates are in feet. Lengths that `run` returns are turned back into metres. A constant in
    the code is brought to the unit of the data with ``self.points.metre``. To use what another
    tool does, call its array function: its class would convert the lengths a second time.

    Examples
    --------
    >>> @tool("testing.square", title="Area of a square", tags=("size",))
    ... class TestingSquare:
    ...     '''Compute the area of a square.
    ...
    ...     It is computed from the length of a side.
    ...     '''
    ...
    ...     side: float = param("Length of a side", default=1.0, unit="m", gt=0)
    ...
    ...     @outputs
    ...     class Outputs:
    ...         area: float = sink("Area of the square", unit="m2")
    ...
    ...     def run(self, ctx=QUIET):
    ...         ctx.progress(1.0)
    ...         return self.Outputs(area=self.side**2)
    >>> TestingSquare(side=3.0).run().area
    9.0
    """

    if not isinstance(id, str):
        raise TypeError('the id of a tool is missing: @tool("group.name")')

    def wrap(cls: T) -> T:
        any_cls: Any = cls
        for text in _missing(any_cls):
            raise TypeError(f"{id}: {text}")
        any_cls.__post_init__ = _check
        any_cls.run = _in_data_units(any_cls.run)
        made: Any = dataclasses.dataclass(frozen=True, kw_only=True)(cls)
        first, _, text = (inspect.getdoc(cls) or "").partition("\n")
        inputs, outs = _fields(made), _fields(made.Outputs)
        spec = Spec(
            id,
            title or in_words(id.rpartition(".")[2]),
            text.strip(),
            made,
            inputs,
            outs,
            summary=first.rstrip("."),
            tags=tags,
            heading=_heading(cls),
        )
        _check_declaration(spec, made)
        REGISTRY[id] = made.spec = spec
        return cast(T, made)

    return wrap


def _heading(cls: type) -> str:
    """The title of the group, which is the docstring of the package of the tool, if it is one."""
    package = sys.modules.get(cls.__module__.rpartition(".")[0])
    text = (package and inspect.getdoc(package)) or ""
    return text if len(text) <= LONGEST_TITLE and TITLE.fullmatch(text) else ""


def _fields(cls: type) -> dict[str, Field]:
    hints = typing.get_type_hints(cls)
    return {f.name: _field(f, hints[f.name]) for f in dataclasses.fields(cls)}


def _field(declared: dataclasses.Field[Any], hint: Any) -> Field:
    """Read an annotation: X | None, tuple[X, ...], Literal[...], X | Literal["auto"]."""
    members = _members(hint)
    optional = type(None) in members
    lists = [member for member in members if typing.get_origin(member) is tuple]
    if lists:
        members = _members(typing.get_args(lists[0])[0])
    words = [member for member in members if typing.get_origin(member) is Literal]
    choices = tuple(choice for word in words for choice in typing.get_args(word))
    plain = [member for member in members if member not in (*words, type(None))]
    type_ = functools.reduce(operator.or_, plain) if plain else None
    if "role" not in declared.metadata:
        raise TypeError(f"{declared.name}: declare it with source(), param() or sink()")
    if len(plain) > 1 and type_ not in kinds.KINDS:
        raise TypeError(f"{declared.name}: {hint} is more than one type")
    try:
        kind = kinds.find(type_) if plain else kinds.CHOICE
    except TypeError as err:
        raise TypeError(f"{declared.name}: {err}") from None
    given: dict[str, Any] = {"unit": None, "limits": {}} | dict(declared.metadata)
    return Field(
        declared.name,
        kind,
        default=declared.default,
        choices=choices,
        many=bool(lists),
        optional=optional,
        **given,
    )


def _members(hint: Any) -> list[Any]:
    """The alternatives of a union, or the one type."""
    union = typing.get_origin(hint) in (types.UnionType, typing.Union)
    return list(typing.get_args(hint)) if union else [hint]


def _check_declaration(spec: Spec, made: Any) -> None:
    """Raise the first mistake of the tool's author, when the tool is imported."""
    for text in _mistakes(spec, made):
        raise TypeError(f"{spec.id}: {text}")
    for field in [*spec.inputs.values(), *spec.outputs.values()]:
        for text in _field_mistakes(spec, field):
            raise TypeError(f"{spec.id}.{field.name}: {text}")
    for field in spec.inputs.values():
        for text in _input_mistakes(field):
            raise TypeError(f"{spec.id}.{field.name}: {text}")
    for field in spec.outputs.values():
        if field.role != "sink":
            raise TypeError(f"{spec.id}.{field.name}: an output is a sink()")


def _missing(cls: Any) -> Iterator[str]:
    """What a class lacks to be a tool."""
    if not hasattr(cls, "run"):
        yield "needs run(ctx)"
    if not dataclasses.is_dataclass(getattr(cls, "Outputs", None)):
        yield "needs a class Outputs, with @outputs above it"


def _mistakes(spec: Spec, made: Any) -> Iterator[str]:
    """What is wrong with a declaration as a whole."""
    name = "".join(word.capitalize() for word in re.split(r"[._]", spec.id))
    if not all(map(NAME.fullmatch, spec.id.split("."))):
        yield "an id is lower_case words with a dot between"
    if made.__name__ != name:
        yield f"the class is called {made.__name__}, must be {name}"
    if not TITLE.fullmatch(spec.summary):
        yield f"the docstring needs a sentence as first line, without markup, got {spec.summary!r}"
    if not TITLE.fullmatch(spec.title) or len(spec.title) > LONGEST_TITLE:
        yield (
            f"a title has a capital, no markup and at most {LONGEST_TITLE} characters, "
            f"got {spec.title!r}"
        )
    if not spec.help.endswith("."):
        yield "the docstring needs a text below its first line, which ends with a full stop"
    if max(map(len, spec.help.splitlines())) > LONGEST:
        yield f"the docstring has a line of more than {LONGEST} characters"
    if twice := (spec.inputs.keys() & spec.outputs.keys() or REGISTRY.keys() & {spec.id}):
        yield f"declared twice: {sorted(twice)}"
    if spec.sources and not hasattr(made, "halo"):
        yield "reads layers, so it needs halo()"


def _field_mistakes(spec: Spec, field: Field) -> Iterator[str]:
    """What is wrong with one field of a declaration."""
    if not NAME.fullmatch(field.name):
        yield "names are lower_case words"
    if field.name in RESERVED:
        yield "is an option of every run"
    if not HELP.fullmatch(field.help) or len(field.help) > LONGEST:
        yield (
            "help is one sentence with a capital and no full stop, of at most "
            f"{LONGEST} characters, got {field.help!r}"
        )
    if field.label and (not LABEL.fullmatch(field.label) or len(field.label) > LONGEST_LABEL):
        yield f"a label has a capital and at most {LONGEST_LABEL} characters, got {field.label!r}"
    if unknown := field.words.keys() - {*field.choices, *field.offers}:
        yield f"words for what is no choice: {', '.join(map(str, unknown))}"
    if field.limits.keys() - MEETS.keys():
        yield f"limits are {', '.join(MEETS)}"
    if field.unit and field.unit not in UNITS:
        yield f"unit {field.unit!r} is not in {UNITS}"
    if field.role == "param" and field.kind.word in ("number", "integer") and not field.unit:
        yield "a number has a unit, such as 'm', or '1' for a ratio or count"
    if field.of and field.of not in spec.sources:
        yield f"no source called {field.of!r}"
    yield from filter(None, (_show_mistake(field, show) for show in field.show))


def _input_mistakes(field: Field) -> Iterator[str]:
    """What is wrong with one input of a declaration."""
    role = "source" if field.kind.is_layer else "param"
    if field.role != role:
        yield f"a {field.kind.word} is a {role}()"
    if field.role == "source" and field.optional and field.required:
        yield "what may be left out has the default None"
    if wrong := [shape for shape in field.shapes if shape not in SHAPES]:
        yield f"shapes are {', '.join(SHAPES)}, not {wrong[0]}"
    if field.shapes and field.kind is not kinds.find(Vector):
        yield f"a {field.kind.word} has no shapes"
    if not field.required and (problem := field.problem(field.default)):
        yield f"its default {problem}"


def _show_mistake(field: Field, show: Show) -> str | None:
    """Why an output of its type cannot be shown so."""
    if not isinstance(show, typing.get_args(Show)):
        return f"show is one of the words of toolbox.declare.show, got {show!r}"
    if field.kind not in [kinds.find(layer) for layer in show.layers]:
        words = " or ".join(layer.__name__ for layer in show.layers)
        return f"{type(show).__name__} shows a {words}, not a {field.kind.word}"
    wrong = [name for name in show.columns if not (isinstance(name, str) and name)]
    return f"{wrong[0]!r} is no name of a column or attribute" if wrong else None


def _check(job: Any) -> None:
    """Read and check the values of a tool; raise all problems that can be known before the run.

    Plain values of Python are read as `toolbox.run` reads them: (2, 9) as classes, a name as an
    attribute, a path as a file.
    """
    spec: Spec = job.spec
    given = {name: getattr(job, name) for name in spec.inputs}
    read, wrong = spec.parse(given)
    values = given | read
    for name, value in read.items():
        object.__setattr__(job, name, value)  # the dataclass is frozen
    unsuitable = _layer_problems(spec, values)
    if wrong:
        raise ParameterError(spec.id, unsuitable | wrong)
    if unsuitable:
        raise DataError(spec.id, unsuitable)
    found = [*_attribute_problems(spec, values), *_rules(job, "check")]
    if found:
        raise ParameterError(spec.id, dict(found))
    if problems := dict(_rules(job, "check_data")):
        raise DataError(spec.id, problems)


def _rules(job: Any, name: str) -> Iterable[tuple[str, str]]:
    return getattr(job, name)() if hasattr(job, name) else ()


def _layers(spec: Spec, values: Mapping[str, Any]) -> Iterator[tuple[str, Layer]]:
    """The layers among the sources that can have a CRS, with the names of their inputs."""
    for name, field in spec.sources.items():
        for layer in field.items(values[name]):
            if field.kind.accepts(layer) and layer.is_spatial:
                yield name, layer


def measures_lengths(spec: Spec, values: Mapping[str, Any]) -> bool:
    """Whether a tool with these values needs to know how long a metre is in the data."""
    if any(f.unit in METRE_POWERS and values[name] is not None for name, f in spec.inputs.items()):
        return True
    # A halo of some metres is a length, even if there is none to set.
    settings = {name: value for name, value in values.items() if name not in spec.sources}
    return 0 < spec.halo(settings) < math.inf


def _layer_problems(spec: Spec, values: Mapping[str, Any]) -> dict[str, str]:
    """The problems of layers: different CRS, one in which metres have no meaning, other shapes."""
    found: dict[str, str] = {}
    told: dict[str, str] = {}
    layers = [(n, layer) for n, layer in _layers(spec, values) if not spec.sources[n].any_crs]
    lengths = measures_lengths(spec, values)
    for name, layer in layers:
        if not (text := length_problem(layer.crs)):
            continue
        if lengths:
            found.setdefault(name, f"{layer.name} {text}".strip())
        else:
            told[name] = f"{layer.name} {text}".strip()
    for name, layer in layers[1:]:
        first_name, first = layers[0]
        heights = "z" in first.axes and "z" in layer.axes
        if text := crs_conflict(layer.crs, first.crs, heights=heights, tools=layer.tools):
            found[name] = f"{layer.name} {text} of {first_name} {first.name}".strip()
    found = shape_problems(spec, values) | found
    for name in told.keys() - found.keys():  # else the error says it
        log.warning("%s: %s", name, told[name])
    return found


def shape_problems(spec: Spec, values: Mapping[str, Any]) -> dict[str, str]:
    """What is wrong with layers of which no feature is of the declared shapes, by input."""
    found = ((n, spec.sources[n].shape_problem(layer)) for n, layer in _layers(spec, values))
    return {name: text for name, text in found if text}


def _attribute_problems(spec: Spec, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The problems of attributes that their source does not have."""
    for name, field in spec.inputs.items():
        named = field.of and field.kind.word in ("attribute", "expression")
        layer = values[field.of] if named and field.of else None
        if layer is None or values[name] is None:
            continue
        wanted: set[str] = set()
        for value in field.items(values[name]):
            wanted |= value.names if isinstance(value, Expression) else {str(value)}
        known = (*layer.axes, *layer.names)
        for missing in sorted(wanted - set(known)):
            hint = nearest(missing, known)
            yield name, f"no attribute {missing!r}{hint}; there are {', '.join(known)}"


def _in_data_units(run: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap `run` of a tool: convert lengths from metres to the unit of the data, and back."""

    @functools.wraps(run)
    def wrapped(self: Any, ctx: Context = QUIET) -> Any:
        spec: Spec = self.spec
        values = {name: getattr(self, name) for name in spec.inputs}
        metric = (layer for _, layer in _layers(spec, values) if not length_problem(layer.crs))
        metre = next((layer.metre for layer in metric), 1.0)
        inside = {name: f.scaled(values[name], metre) for name, f in spec.inputs.items()}
        try:
            result = run(_unchecked(self, inside), ctx)
        except DataError as err:
            raise (err if err.problems else err.named(spec.id)) from err.__cause__
        outside = {n: f.scaled(getattr(result, n), 1 / metre) for n, f in spec.outputs.items()}
        return dataclasses.replace(result, **outside)

    return wrapped


def _unchecked(job: Any, values: Mapping[str, Any]) -> Any:
    """A copy of a tool with other values, not checked again: limits are in metres."""
    copy = object.__new__(type(job))
    copy.__dict__.update(values)
    return copy
