"""The vocabulary of a declaration: @tool, @outputs, source(), param(), sink().

A tool is one frozen dataclass. Its fields are the only place where a parameter's type, default,
unit, limits and help stand; the Python call, the command line, the process description, the docs
and the tests that hold for every tool are made from them.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
import re
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal, TypeVar, cast, dataclass_transform

from toolbox import kinds
from toolbox.context import QUIET, Context, log
from toolbox.data.crs import describe_crs, length_problem, same_crs
from toolbox.errors import DataError, ParameterError
from toolbox.expression import Expression
from toolbox.fields import LENGTHS, MEETS, Field, Spec, nearest

T = TypeVar("T", bound=type)
REGISTRY: dict[str, Spec] = {}
NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


def source(help: str, *, default: Any = dataclasses.MISSING) -> Any:
    """Declare a layer that the tool reads.

    One that may be left out is annotated ``X | None`` and has the default None; several of a kind
    are annotated ``tuple[X, ...]``.
    """
    return dataclasses.field(default=default, metadata={"role": "source", "help": help})


def param(
    help: str, *, default: Any, unit: str | None = None, of: str | None = None, **limits: float
) -> Any:
    """Declare a number, switch, word or other value.

    Parameters
    ----------
    help : one sentence without a full stop
    unit : "m" and other lengths are metres for the user whatever the data; "1" is a ratio or count
    of : the source that an `Attribute` or `Expression` speaks about
    limits : gt, ge, lt, le
    """
    meta = {"role": "param", "help": help, "unit": unit, "limits": limits, "of": of}
    return dataclasses.field(default=default, metadata=meta)


def sink(help: str, *, unit: str | None = None) -> Any:
    """Declare a layer, number or text that the tool gives back."""
    return dataclasses.field(metadata={"role": "sink", "help": help, "unit": unit})


@dataclass_transform(
    frozen_default=True, kw_only_default=True, field_specifiers=(param, source, sink)
)
def outputs(cls: T) -> T:
    """Make the class inside a tool that names what the tool gives back."""
    return cast(T, dataclasses.dataclass(frozen=True, kw_only=True)(cls))


@dataclass_transform(
    frozen_default=True, kw_only_default=True, field_specifiers=(param, source, sink)
)
def tool(id: str) -> Callable[[T], T]:
    """Make a frozen dataclass that checks its values, and register it.

    The class has a docstring (first line: title), fields, `Outputs`, `run(ctx)`, `halo()` if it
    reads layers, and may have `check()`, which yields (parameter, problem) for rules between
    values. `halo()` gives metres, or `math.inf` for a tool that needs the whole cloud.

    Inside `run` all lengths are in the unit of the data: a `cell` of 1 m is 3.28 when the
    coordinates are in feet. Lengths that `run` returns are turned back into metres. A constant in
    the code is brought to the unit of the data with ``self.points.metre``. To use what another
    tool does, call its array function: its class would convert the lengths a second time.
    """

    def wrap(cls: T) -> T:
        any_cls: Any = cls
        any_cls.__post_init__ = _check
        any_cls.run = _in_data_units(any_cls.run)
        made: Any = dataclasses.dataclass(frozen=True, kw_only=True)(cls)
        title, _, text = (inspect.getdoc(cls) or "").partition("\n")
        inputs, outs = _fields(made), _fields(made.Outputs)
        spec = Spec(id, title.rstrip("."), text.strip(), made, inputs, outs)
        _check_declaration(spec, made)
        REGISTRY[id] = made.spec = spec
        return cast(T, made)

    return wrap


def _fields(cls: type) -> dict[str, Field]:
    hints = typing.get_type_hints(cls)
    return {f.name: _field(f, hints[f.name]) for f in dataclasses.fields(cls)}


def _field(declared: dataclasses.Field[Any], hint: Any) -> Field:
    """Take the annotation apart: X | None, tuple[X, ...], Literal[...], or plain X."""
    args = typing.get_args(hint)
    optional = isinstance(hint, types.UnionType) and type(None) in args
    if optional:
        hint = next(arg for arg in args if arg is not type(None))
    many = typing.get_origin(hint) is tuple
    if many:
        hint = typing.get_args(hint)[0]
    choices = typing.get_args(hint) if typing.get_origin(hint) is Literal else ()
    kind = kinds.find(type(choices[0]) if choices else hint)
    given: dict[str, Any] = {"unit": None, "limits": {}} | dict(declared.metadata)
    return Field(
        declared.name,
        kind,
        default=declared.default,
        choices=choices,
        many=many,
        optional=optional,
        **given,
    )


def _check_declaration(spec: Spec, made: Any) -> None:
    """Mistakes of the tool's author, found when the tool is imported."""
    fields = [*spec.inputs.values(), *spec.outputs.values()]
    if twice := (spec.inputs.keys() & spec.outputs.keys() or REGISTRY.keys() & {spec.id}):
        raise TypeError(f"{spec.id}: declared twice: {sorted(twice)}")
    if spec.sources and not hasattr(made, "halo"):
        raise TypeError(f"{spec.id}: reads layers, so it needs halo()")
    for field in fields:
        if not NAME.fullmatch(field.name):
            raise TypeError(f"{spec.id}.{field.name}: names are lower_case words")
        if field.limits.keys() - MEETS.keys():
            raise TypeError(f"{spec.id}.{field.name}: limits are {', '.join(MEETS)}")
        if field.of and field.of not in spec.sources:
            raise TypeError(f"{spec.id}.{field.name}: no source called {field.of!r}")


def _check(job: Any) -> None:
    """All that can be known before the run."""
    spec: Spec = job.spec
    values = {name: getattr(job, name) for name in spec.inputs}
    wrong, unsuitable = spec.problems(values), _layer_problems(spec, values)
    if wrong:
        raise ParameterError(spec.id, unsuitable | wrong)
    if unsuitable:
        raise DataError(spec.id, unsuitable)
    if problems := dict(_attribute_problems(spec, values)):
        raise ParameterError(spec.id, problems)
    if hasattr(job, "check") and (problems := dict(job.check())):
        raise ParameterError(spec.id, problems)


def _layers(spec: Spec, values: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Every layer among the sources that can have a CRS, with the name of its parameter."""
    for name, field in spec.sources.items():
        for layer in field.items(values[name]):
            if field.kind.accepts(layer) and hasattr(layer, "with_crs"):
                yield name, layer


def _layer_problems(spec: Spec, values: Mapping[str, Any]) -> dict[str, str]:
    """CRS that differ, and data in which a length given in metres has no meaning."""
    found: dict[str, str] = {}
    layers = list(_layers(spec, values))
    lengths = any(f.unit in LENGTHS and values[n] is not None for n, f in spec.inputs.items())
    for name, layer in layers:
        if not (text := length_problem(layer.crs)):
            continue
        if lengths:
            found.setdefault(name, f"{layer.name} {text}".strip())
        else:
            log.warning("%s: %s %s", name, layer.name, text)
    for name, layer in layers[1:]:
        first_name, first = layers[0]
        if not same_crs(first.crs, layer.crs):
            found[name] = (
                f"{layer.name} is in {describe_crs(layer.crs)}, but {first_name} "
                f"{first.name} is in {describe_crs(first.crs)}; reproject one of them first"
            )
    return found


def _attribute_problems(spec: Spec, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Attribute names that their source does not have."""
    for name, field in spec.inputs.items():
        layer = values[field.of] if field.of else None
        if layer is None or values[name] is None:
            continue
        value = values[name]
        wanted = value.names if isinstance(value, Expression) else {str(value)}
        known = ("x", "y", "z", *layer.names)
        for missing in sorted(wanted - set(known)):
            hint = nearest(missing, known)
            yield name, f"no attribute {missing!r}{hint}; there are {', '.join(known)}"


def _in_data_units(run: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a tool's run: lengths go in as metres of the user and come out as metres."""

    @functools.wraps(run)
    def wrapped(self: Any, ctx: Context = QUIET) -> Any:
        spec: Spec = self.spec
        values = {name: getattr(self, name) for name in spec.inputs}
        metric = (layer for _, layer in _layers(spec, values) if not length_problem(layer.crs))
        metre = next((layer.metre for layer in metric), 1.0)
        if math.isclose(metre, 1.0, rel_tol=1e-12):
            return run(self, ctx)
        inside = {name: f.scaled(values[name], metre) for name, f in spec.inputs.items()}
        result = run(_unchecked(self, inside), ctx)
        outside = {n: f.scaled(getattr(result, n), 1 / metre) for n, f in spec.outputs.items()}
        return dataclasses.replace(result, **outside)

    return wrapped


def _unchecked(job: Any, values: Mapping[str, Any]) -> Any:
    """A copy of job with other values; limits are in metres, so they are not checked again."""
    copy = object.__new__(type(job))
    copy.__dict__.update(values)
    return copy
