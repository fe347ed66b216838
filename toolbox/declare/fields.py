"""The specification of a tool (`Spec`), and those of its inputs and outputs (`Field`)."""

from __future__ import annotations

import dataclasses
import functools
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, cast

from pyproj import CRS

from toolbox import __version__
from toolbox.data.crs import UNITS_OF_LENGTH, foot_of
from toolbox.data.layer import crs_of
from toolbox.data.report import Column
from toolbox.data.vector import Vector
from toolbox.declare.delivered import Delivered
from toolbox.declare.kinds import CHOICE, OPTIONS, Kind
from toolbox.declare.show import Show
from toolbox.declare.values import Memory, Range
from toolbox.errors import DataError, ParameterError, ToolboxError, nearest
from toolbox.labels import in_words

COMMA = re.compile(r"-?\d+,\d+")  # a number as it is written where the comma is decimal
METRE_POWERS = {"m": 1, "m2": 2, "m3": 3, "1/m": -1, "1/m2": -2}  # exponents of the metre
_SAID = re.compile(rf"(.*[\d.\s])({'|'.join(UNITS_OF_LENGTH)})([23]?)", re.I)  # 2ft, 0.5 m, 9 ft2
_TIDY, _SHORT = 12, 9  # digits: 2 ft said in metres are 2 in data in feet; 5 m keep all of theirs
UNITS = (*METRE_POWERS, "1", "%", "deg", "s", "degC", "V", "kV", "A", "m/s", "W/m2")
MEETS: Mapping[str, Callable[[Any, Any], bool]] = {
    "gt": operator.gt,
    "ge": operator.ge,
    "lt": operator.lt,
    "le": operator.le,
}
SHAPES = ("point", "line", "polygon")
SHAPE_OF = dict.fromkeys(("Point", "MultiPoint"), "point")
SHAPE_OF |= dict.fromkeys(("LineString", "MultiLineString", "LinearRing"), "line")
SHAPE_OF |= dict.fromkeys(("Polygon", "MultiPolygon"), "polygon")
"""What features are, by the names of their geometries; others may be anything."""
SIGNS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


@dataclasses.dataclass(frozen=True)
class Field:
    """One declared input or output of a tool.

    Attributes
    ----------
    kind : the type: how values are read, checked and described
    role : "source", "param" or "sink"
    choices : allowed words or numbers, from a Literal annotation; where there is a kind such as
        number (``float | Literal["auto"]``), they are allowed as well
    many : whether the value is a tuple of values of `kind`
    optional : whether None is a valid value
    of : the source to which an attribute name or expression refers, or whose names dialogs offer
    any_crs : whether the tool itself looks at the CRS of a source
    shapes : what the features of a source are, some of SHAPES; any if it is empty
    show : how an output is shown in a plot
    label : its title, where the words of the name are not those of its users
    offers : texts that dialogs offer, besides which others are valid
    words : what a choice or an offer is called, where its own words do not say enough
    columns : how the columns of an output are shown in a report, by name
    listed : whether a report lists the features of an output, which no other table has
    also : formats for layers of a certain content that an output is written in, too
    feet : default for data in feet, in feet, where products are to be round in them
    """

    name: str
    kind: Kind
    role: Literal["source", "param", "sink"]
    help: str
    default: Any
    unit: str | None
    limits: Mapping[str, float]
    choices: tuple[Any, ...] = ()
    many: bool = False
    optional: bool = False
    of: str | None = None
    any_crs: bool = False
    shapes: tuple[str, ...] = ()
    show: tuple[Show, ...] = ()
    label: str = ""
    offers: tuple[str, ...] = ()
    words: Mapping[Any, str] = dataclasses.field(default_factory=dict)
    columns: Mapping[str, Column] = dataclasses.field(default_factory=dict)
    listed: bool = True
    also: tuple[str, ...] = ()
    feet: float | None = None

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Endings of the files that an output can be written to."""
        special = self.kind.special.keys() - set(self.also)
        return tuple(suffix for suffix in self.kind.suffixes if suffix not in special)

    @property
    def title(self) -> str:
        """What dialogs, docs and reports call it."""
        return self.label or in_words(self.name)

    def choice_title(self, choice: Any) -> str:
        """What dialogs call one of the choices."""
        return self.words.get(choice) or in_words(str(choice))

    @property
    def required(self) -> bool:
        return self.default is dataclasses.MISSING

    def default_in(self, foot: float | None) -> Any:
        """The default of data in feet of so many metres, or of data in another unit, in metres."""
        return self.default if self.feet is None or foot is None else self.feet * foot

    @property
    def default_of_feet(self) -> str:
        """What --help and the docs say of the default for data in feet; "" if it is no other."""
        return "" if self.feet is None else f"{self.feet:g} ft for data in feet"

    @property
    def word(self) -> str:
        """The name of the type in --help and in errors."""
        return f"list of {self.kind.word}" if self.many else self.kind.word

    def rule(self) -> str:
        """The limits and choices as a text, which --help, the docs and errors print."""
        words = ", ".join(map(str, self.choices))
        if self.kind is CHOICE:
            return f"one of {words}"
        text = " and ".join(f"{SIGNS[key]} {limit:g}" for key, limit in self.limits.items())
        text = f"{text} {self.unit}" if text and self.unit != "1" else text
        return f"{text} or {words}".strip() if words else text

    def problem(self, value: Any) -> str | None:
        """Say what is wrong with a value; None if it is valid."""
        if value is None and self.optional:
            return None
        if self.many and not isinstance(value, tuple):
            return f"must be a tuple, got {value!r}"
        return next(filter(None, map(self._item_problem, self.items(value))), None)

    def shape_problem(self, layer: Any) -> str | None:
        """Why none of the features can be of use; of what some are wrong the tool decides."""
        if not (self.shapes and isinstance(layer, Vector)):
            return None
        types = sorted(layer.frame.geometry.geom_type.dropna().unique())
        if not types or any(SHAPE_OF.get(name) in (None, *self.shapes) for name in types):
            return None
        wanted = " or ".join(f"{shape}s" for shape in self.shapes)
        return f"must be {wanted}, {layer.name or 'the layer'} holds a {types[0]}"

    def items(self, value: Any) -> tuple[Any, ...]:
        """Split a value into its single values."""
        return value if self.many and isinstance(value, tuple) else (value,)

    def given(self, value: Any) -> list[Any]:
        """Split the raw value of a source into layers; a list for one layer names its files."""
        return list(value) if self.many and isinstance(value, list | tuple) else [value]

    def _item_problem(self, value: Any) -> str | None:
        if any(value == choice and type(value) is type(choice) for choice in self.choices):
            return None
        if self.kind is CHOICE:
            return f"must be {self.rule()}, got {value!r}{nearest(str(value), self.choices)}"
        if not self.kind.accepts(value):
            return f"must be {_a(self.kind.word)}, got {value!r}"
        numbers = value if isinstance(value, Range) else (value,)
        meets = (MEETS[key](n, limit) for key, limit in self.limits.items() for n in numbers)
        return None if all(meets) else f"must be {self.rule()}, got {value!r}"

    def parse(self, value: Any) -> Any:
        """Read a value of the declared type from a text or a JSON value.

        Raises
        ------
        ValueError
            It is not of that type.
        """
        none = value is None or (isinstance(value, str) and value.lower() in ("none", "null"))
        if none and str(value) not in map(str, self.choices):
            if self.optional:
                return None
            raise ValueError(f"must be {_a(self.word)}, got none")
        if self.many:
            items = value if isinstance(value, list | tuple) else [value]
            return tuple(map(self._parse_item, items))
        return self._parse_item(value)

    def _parse_item(self, value: Any) -> Any:
        for choice in self.choices:
            # JSON does not tell 3 from 3.0; True is not 1 here.
            if str(choice) == str(value) or (isinstance(value, float) and choice == value):
                return choice
        if self.kind.accepts(value):
            return value
        if self.kind is CHOICE:
            raise ValueError(self._item_problem(value))
        try:
            return self._in_metres(value)
        except ToolboxError:
            raise
        except (ValueError, TypeError) as err:
            comma = isinstance(value, str) and COMMA.fullmatch(value.strip())
            why = "" if self.kind.plain or not str(err) else f": {err}"
            if self.kind.word == "number" and comma:
                why = f"; did you mean {value.strip().replace(',', '.')}?"
            elif self.unit == "m" and self.kind.word == "number" and str(value)[:1].isdigit():
                why = f"; a unit behind it is one of {', '.join(UNITS_OF_LENGTH)}"
            raise ValueError(f"must be {_a(self.kind.word)}, got {value!r}{why}") from None

    def _in_metres(self, value: Any) -> Any:
        """Read a value; of a length, area or volume also one with its unit, such as 2ft."""
        power = METRE_POWERS.get(self.unit or "", 0)
        said = _SAID.fullmatch(value.strip()) if power > 0 and isinstance(value, str) else None
        if said is None or self.kind.word not in ("number", "range"):
            return self.kind.parse(value)
        if int(said[3] or 1) != power:
            raise ValueError
        return _times(self.kind.parse(said[1].strip()), UNITS_OF_LENGTH[said[2].lower()] ** power)

    def to_json(self, value: Any) -> Any:
        """A value as JSON, from which the same value is parsed again."""
        made = [
            v if v is None or v in self.choices else self.kind.to_json(v) for v in self.items(value)
        ]
        return made if self.many and value is not None else made[0]

    def scaled(self, value: Any, metre: float) -> Any:
        """Convert a length from metres to the unit of the data, of which `metre` make one metre."""
        power = METRE_POWERS.get(self.unit or "")
        if power is None or value is None or self.kind.is_layer:
            return value
        factor = metre**power
        scaled = tuple(_times(item, factor) for item in self.items(value))
        if factor != 1:
            scaled = tuple(map(_tidy, scaled))
        return scaled if self.many else scaled[0]

    def schema(self) -> dict[str, Any]:
        """Describe the field as an input or output of an OGC API - Processes description."""
        body = self._item_schema()
        if self.many:
            body = {"type": "array", "items": body}
        if self.role == "param" and self.default is not None and not self.required:
            body["default"] = self.to_json(self.default)
        says = {"type": self.kind.word, "unit": self.unit, "rule": self.rule(), "of": self.of}
        says |= {"coordinates": self.kind.coordinates, "feet": self.default_of_feet}
        meta = [{"role": role, "value": value} for role, value in says.items() if value]
        options = self.kind.save_options if self.role == "sink" else self.kind.open_options
        for option in options:
            meta.append({"role": "option", "title": option, "value": OPTIONS[option].help})
        if self.role == "sink":
            meta += [{"role": "suffix", "value": suffix} for suffix in self.suffixes]
        for choice in self.words:
            meta.append({"role": "choice", "title": str(choice), "value": self.words[choice]})
        made: dict[str, Any] = {"title": self.title}
        made |= {"description": self.help, "schema": body, "metadata": meta}
        if self.role != "sink":
            made["minOccurs"] = int(self.required)
            made["maxOccurs"] = "unbounded" if self.many else 1
        return made

    def _item_schema(self) -> dict[str, Any]:
        """The JSON schema of one value: that of the kind and of the choices, joined by oneOf."""
        texts = [choice for choice in self.choices if isinstance(choice, str)]
        numbers = [choice for choice in self.choices if not isinstance(choice, str)]
        sorts: list[dict[str, Any]] = []
        if self.kind is not CHOICE:
            sorts.append(dict(self.kind.schema) | self._schema_limits())
        if numbers:
            sorts.append({"type": "integer", "enum": numbers})
        if texts:
            sorts.append({"type": "string", "enum": texts})
        return sorts[0] if len(sorts) == 1 else {"oneOf": sorts}

    def _schema_limits(self) -> dict[str, Any]:
        # A strict limit is written as "not that very number": exclusiveMinimum is a boolean in
        # OpenAPI 3.0 (OGC API - Processes 1.0) and a number in JSON Schema 2020-12.
        body: dict[str, Any] = {}
        for key, limit in self.limits.items():
            body["minimum" if key[0] == "g" else "maximum"] = limit
        strict = [limit for key, limit in self.limits.items() if key in ("gt", "lt")]
        return body | ({"not": {"enum": strict}} if strict else {})


@dataclasses.dataclass(frozen=True)
class Spec:
    """The specification of one tool, for the command line, QGIS, the docs and models.

    Attributes
    ----------
    title : a few words that name the tool in lists and headings
    summary : one sentence without a full stop that says what it does
    help : all else that its users should know
    tags : words that people search for, besides those of the texts
    heading : the title of its group, where that is not the first word of the id
    """

    id: str
    title: str
    help: str
    make: Callable[..., Any]
    inputs: Mapping[str, Field]
    outputs: Mapping[str, Field]
    summary: str = dataclasses.field(default="", kw_only=True)
    tags: tuple[str, ...] = dataclasses.field(default=(), kw_only=True)
    heading: str = dataclasses.field(default="", kw_only=True)

    @property
    def group(self) -> str:
        """The title of the group that the tool stands in."""
        return self.heading or in_words(self.id.partition(".")[0])

    @property
    def text(self) -> str:
        """The summary as a sentence, and the help below it."""
        return "\n\n".join(filter(None, (self.summary and f"{self.summary}.", self.help)))

    @functools.cached_property
    def sources(self) -> Mapping[str, Field]:
        return {name: f for name, f in self.inputs.items() if f.role == "source"}

    def crs_of(self, values: Mapping[str, Any]) -> CRS | None:
        """The CRS of the first layer among some values that has one."""
        layers = (x for n, f in self.sources.items() for x in f.items(values.get(n)))
        return crs_of(x for x in layers if x is not None)

    def in_feet(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The defaults for data in feet of inputs without a value, metres; none of other data."""
        fields = self.inputs.items() if (foot := foot_of(self.crs_of(values))) else ()
        return {n: f.default_in(foot) for n, f in fields if f.feet and n not in values}

    def under(self, settings: Mapping[str, Any]) -> Spec:
        """The specification for these settings; a model may then open its clouds as surveys."""
        return self

    def idle(self, settings: Mapping[str, Any]) -> list[str]:
        """Inputs that nothing uses with these settings; only a model has such."""
        return []

    def users(self, name: str) -> list[str]:
        """The titles of the tools that use an input; only a model has such."""
        return []

    def switches(self, name: str) -> list[str]:
        """Inputs without which an input is not used; only a model has such."""
        return []

    @property
    def between(self) -> Mapping[str, Field]:
        """The fields of the results of the steps of a model, by step.output; a tool has none."""
        return {}

    @functools.cached_property
    def results(self) -> Mapping[str, Field]:
        """The fields of all that a run can write."""
        return {**self.outputs, **self.between}

    @property
    def deliver(self) -> Sequence[Delivered]:
        """The files of the set that is handed over; only a model declares one."""
        return ()

    def names_problems(self, names: Iterable[str]) -> dict[str, str]:
        """The problems of unknown and missing inputs, by name."""
        given, known = set(names), [*self.inputs, *self.outputs]
        found = {n: f"unknown parameter{nearest(n, known)}" for n in given - set(self.inputs)}
        for name, field in self.inputs.items():
            if field.required and name not in given:
                found[name] = f"missing ({field.help})"
        return dict(sorted(found.items()))

    def problems(self, values: Mapping[str, Any]) -> dict[str, str]:
        """The problems of values of the declared types, by input."""
        found = self.names_problems(values)
        for name, field in self.inputs.items():
            if name in values and (text := field.problem(values[name])):
                found[name] = text
        return found

    def parse(
        self, raw: Mapping[str, Any], present: Iterable[str] = ()
    ) -> tuple[dict[str, Any], dict[str, str]]:
        """Read texts or JSON values: the values that can be read, and the problems of the others.

        `present` names inputs that are given elsewhere, and so are not missing.
        """
        values, problems = {}, self.names_problems([*raw, *present])
        for name in raw.keys() & self.inputs.keys():
            try:
                values[name] = self.inputs[name].parse(raw[name])
            except ValueError as err:
                problems[name] = str(err)
                continue
            if text := self.inputs[name].problem(values[name]):
                problems[name] = text
        return values, problems

    def build(self, values: Mapping[str, Any], where: str | None = None) -> Any:
        """Check all values and make the tool.

        Raises
        ------
        ParameterError, DataError
            All problems, under the name `where` or that of the tool.
        """
        if problems := self.names_problems(values):
            raise ParameterError(where or self.id, problems)
        try:
            return self.make(**values)
        except (ParameterError, DataError) as err:
            raise (err.named(where) if where else err) from None

    def halo(self, settings: Mapping[str, Any]) -> float:
        """The `halo` of the tool in metres with these settings, before any layer is read."""
        return float(self._draft(settings).halo())

    @property
    def memory(self) -> Memory:
        """What a tile with its neighbourhood needs for this tool."""
        found: Memory = getattr(self.make, "memory", Memory())
        return found

    def rules(self, settings: Mapping[str, Any]) -> dict[str, str]:
        """The problems that the `check` of the tool finds in settings, before any layer is read."""
        job = self._draft(settings)
        return dict(job.check()) if hasattr(job, "check") else {}

    def _draft(self, settings: Mapping[str, Any]) -> Any:
        """The tool with these settings, not checked and without layers."""
        defaults = {name: None if f.required else f.default for name, f in self.inputs.items()}
        job: Any = object.__new__(cast(type, self.make))
        job.__dict__.update(defaults | dict(settings))
        return job

    def describe(self) -> dict[str, Any]:
        """The process description of the tool, as in OGC API - Processes, Part 1."""
        return {
            "id": self.id,
            "version": __version__,
            "title": self.title,
            "description": self.text,
            "keywords": [self.group, *self.tags],
            "jobControlOptions": ["sync-execute", "dismiss"],
            "inputs": {name: field.schema() for name, field in self.inputs.items()},
            "outputs": {name: field.schema() for name, field in self.outputs.items()},
        }


def _times(value: Any, factor: float) -> Any:
    """Multiply numbers by a factor; words such as "auto" and None stay as they are."""
    if isinstance(value, Range):
        return Range(*(number * factor for number in value))
    return value if value is None or isinstance(value, str) else value * factor


def _tidy(value: Any) -> Any:
    """A length in another unit; one of few digits without the last, which conversion has left."""
    if isinstance(value, Range):
        return Range(*map(_tidy, value))
    if value is None or isinstance(value, str):
        return value
    tidy = float(f"{value:.{_TIDY}g}")
    return tidy if tidy == float(f"{value:.{_SHORT}g}") else value


def _a(word: str) -> str:
    return f"{'an' if word[0] in 'aeiou' else 'a'} {word}"
