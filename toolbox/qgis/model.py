"""Converts models to .model3 files of the QGIS model designer, and back.

What the other side cannot express is never left out silently. All of it is reported at once: as an
error or, where the meaning stays the same, as a note.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from graphlib import CycleError
from pathlib import Path
from typing import Any

from toolbox import catalog
from toolbox.declare.fields import Field
from toolbox.declare.kinds import CHOICE
from toolbox.declare.spec import NAME
from toolbox.declare.values import Extent
from toolbox.errors import ParameterError
from toolbox.labels import in_words
from toolbox.models.links import in_order
from toolbox.models.model import INPUTS, Link, Model, Reference, Step, references
from toolbox.qgis import model3
from toolbox.qgis.model3 import Foreign
from toolbox.qgis.tools import PROVIDER, SEPARATOR, algorithm, field, names

OURS = f"{PROVIDER}:"
SUFFIX = ".model3"
INPUT, STEP, CONSTANT, EXPRESSION, _, OUTPUT = range(6)  # what gives a parameter its value
OPTIONAL = 8  # flag of a parameter
PAGE = "PAGE"  # the output of our tools that is a report of all results
FAR = 1.7976931348623157e308
POINT_FILES = "Point clouds (*.laz *.las *.copc.laz);;All files (*)"
SOURCES = {"raster": 3, "vector": -1, "table": 5, "pointcloud": 8, "file": 4}  # types of QGIS
WIDE, HIGH = 300.0, 110.0  # distances on the canvas


# To QGIS -----------------------------------------------------------------------------------------


def to_qgis(
    model: Model,
    values: Mapping[str, Any] | None = None,
    *,
    given: tuple[str, ...] = (),
    point_layers: bool = False,
) -> tuple[str, list[str]]:
    """Convert a model to the text of a .model3 file, with notes on what is different in QGIS.

    QGIS runs all steps of a model, so a switch or choice that leaves steps out gets a fixed value.

    Parameters
    ----------
    values : of inputs, in place of their defaults
    given : optional layers to keep, with the steps that need them; the others are left out
    point_layers : take point clouds as layers, which needs QGIS with PDAL, and not as files

    Raises
    ------
    ParameterError
        All that cannot be converted.
    """
    return _ToQgis(model, dict(values or {}), given, point_layers).text()


class _ToQgis:
    def __init__(
        self, model: Model, values: dict[str, Any], given: tuple[str, ...], point_layers: bool
    ) -> None:
        model = model.wanting(())  # without the steps of a set that is handed over
        self.model, self.given, self.point_layers = model, given, point_layers
        self.problems: dict[str, str] = {}
        self.notes: list[str] = []
        self.help = {"ALG_DESC": model.help}
        parsed, self.problems = self._parsed(values)
        defaults = {n: f.default for n, f in model.inputs.items() if not f.required}
        whens = [step.when.name.partition(".")[2] for step in model.steps.values() if step.when]
        self.fixed = {n for n in whens if model.inputs[n].role == "param"}
        self.values = dict.fromkeys(self.fixed) | defaults | parsed
        for name in self.fixed - defaults.keys() - parsed.keys():
            self.problems.setdefault(name, f"is fixed in QGIS; say its value, --set {name}=VALUE")
        self.absent = {n for n in whens if n not in self.fixed and n not in given}
        self.steps = self._steps()

    def _parsed(self, values: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
        found, problems = {}, {}
        for name, value in values.items():
            f = self.model.inputs.get(name)
            if f is None or f.role != "param":
                problems[name] = "is no setting of the model"
                continue
            try:
                found[name] = f.parse(value)
            except ValueError as err:
                problems[name] = str(err)
        optional = {n for n, f in self.model.sources.items() if f.optional}
        problems |= {n: "is no optional layer" for n in self.given if n not in optional}
        return found, problems

    def _steps(self) -> dict[str, Step]:
        """The steps that run with these values."""
        layers = dict.fromkeys(self.given, True)
        known = {f"{INPUTS}.{name}": value for name, value in (self.values | layers).items()}
        known |= {f"{INPUTS}.{name}": None for name in self.absent}
        steps = self.model.steps.values()
        return {step.name: step for step in steps if step.when is None or step.when.holds(known)}

    def text(self) -> tuple[str, list[str]]:
        children = {name: self._child(step) for name, step in self.steps.items()}
        for name, reference in self.model.returns.items():
            self._return(name, reference, children)
        inputs = {n: self._definition(f) for n, f in self.model.inputs.items() if self._asked(n)}
        self._note_defaults(inputs)
        if self.problems:
            raise ParameterError(f"{self.model.id} cannot be a model of QGIS", self.problems)
        fixed = {name for name in self.fixed if self.values[name] is not None}
        self.notes += [f"{name} is fixed to {self.values[name]}" for name in sorted(fixed)]
        for name in sorted(self.fixed - fixed | self.absent):
            self.notes.append(f"{name} and the steps that need it are left out")
        boxes = {d["name"]: _component(d["name"], 0, i) for i, d in enumerate(inputs.values())}
        made = {
            "model_name": self.model.title,
            "model_group": "LiDAR Toolbox",
            "help": self.help,
            "children": children,
            "parameters": boxes,
            "parameterDefinitions": {d["name"]: d for d in inputs.values()},
            "parameterOrder": [d["name"] for d in inputs.values()],
            "groupBoxes": [],
            "modelVariables": {},
            "designerParameterValues": {},
        }
        return model3.text(made), self.notes

    def _note_defaults(self, inputs: Mapping[str, Any]) -> None:
        """Note the inputs that mean something else in QGIS when they are left empty."""
        for name, says in inputs.items():
            value = self.values.get(name)
            if value is not None and says["default"] is None:
                self.notes.append(f"{name} has no default in QGIS: state it, here it is {value}")
            elif value is not None and self.model.inputs[name].optional:
                self.notes.append(f"{name} left empty means its default, {value}, not none")

    def _asked(self, name: str) -> bool:
        """Whether the model of QGIS has this input: a step uses it, and its value is not fixed."""
        used = {full for step in self.steps.values() for full in step.needs}
        return f"{INPUTS}.{name}" in used and name not in self.fixed | self.absent

    def _child(self, step: Step) -> dict[str, Any]:
        if step.repeat:
            self.problems[step.name] = "is repeated, for which models of QGIS have nothing"
        id = step.spec.id
        if isinstance(step.spec, Model) and id not in catalog.own_ids():
            self.problems[step.name] = f"runs the model file {id}, which QGIS does not have"
        foreign = id.startswith(catalog.QGIS)
        params = {}
        for name, value in {**self._defaults(step), **step.settings}.items():
            plain = self._plain(step, name, value)
            params[name.upper()] = [{"source": CONSTANT, "static_value": plain}]
        for name, link in step.links.items():
            if sources := self._sources(step, name, link):
                params[name.upper()] = sources
        made = _component(None, self._column(step.name), list(self.steps).index(step.name))
        return made | {
            "id": step.name,
            "component_description": step.name.replace("_", " ").capitalize(),
            "alg_id": id.removeprefix(catalog.QGIS) if foreign else OURS + algorithm(id),
            "alg_config": {},
            "active": True,
            "params": params,
            "dependencies": [],
            "outputs": {},
        }

    @staticmethod
    def _defaults(step: Step) -> dict[str, Any]:
        """The defaults of a tool of ours: the designer draws a step red that says none of them."""
        if step.spec.id.startswith(catalog.QGIS):
            return {}
        params = {name: f for name, f in step.spec.inputs.items() if f.role == "param"}
        return {n: f.default for n, f in params.items() if not (f.required or f.default is None)}

    def _column(self, name: str) -> int:
        """The column of a step on the canvas: right of all steps that it needs."""
        before = {full.partition(".")[0] for full in self.steps[name].needs} & self.steps.keys()
        return 1 + max(map(self._column, before), default=0)

    def _plain(self, step: Step, name: str, value: Any) -> Any:
        f = step.spec.inputs[name]
        if step.spec.id.startswith(catalog.QGIS) and f.kind is CHOICE:
            numbers = [f.choices.index(item) for item in f.items(value)]
            return numbers if f.many else numbers[0]
        return constant(f, value)

    def _sources(self, step: Step, name: str, link: Link) -> list[dict[str, Any]]:
        found = [self._source(step, name, reference) for reference in references(link)]
        return [source for source in found if source]

    def _source(self, step: Step, name: str, reference: Reference) -> dict[str, Any] | None:
        """What QGIS takes for a reference: the first of its values that the model has."""
        for full in reference.names:
            owner, _, word = full.partition(".")
            if owner == INPUTS and word in self.fixed:
                value = constant(step.spec.inputs[name], self.values[word])
                return {"source": CONSTANT, "static_value": value}
            if owner == INPUTS and word not in self.absent:
                return self._of_input(step, name, word)
            if owner in self.steps:
                return {"source": STEP, "child_id": owner, "output_name": word.upper()}
        return None

    def _of_input(self, step: Step, name: str, word: str) -> dict[str, Any]:
        """An input, or an expression with its default, which QGIS does not hand to a step."""
        says = self._definition(self.model.inputs[word])
        if step.spec.id.startswith(catalog.QGIS) and step.spec.inputs[name].kind is CHOICE:
            self.problems[f"{step.name}.{name}"] = (
                "is a choice that QGIS takes by its number; give it in the step itself"
            )
        if says["default"] is None:
            return {"source": INPUT, "parameter_name": says["name"]}
        return {"source": EXPRESSION, "expression": or_default(says["name"], says["default"])}

    def _return(self, name: str, reference: Reference, children: dict[str, Any]) -> None:
        full = next((n for n in reference.names if n.partition(".")[0] in self.steps), None)
        if full is None:
            self.notes.append(f"{name} is left out with the step that gives it")
            return
        owner, _, word = full.partition(".")
        if not self.model.outputs[name].kind.is_layer:
            self._value(name, owner, children)
            return
        # QGIS does not make an output that is skipped, even where another step waits for it.
        needed = any(full in step.needs for step in self.steps.values())
        self.help[f"{owner}:{name.upper()}"] = self.model.outputs[name].help
        title = self.model.outputs[name].title  # which becomes the name of the layer
        self._result(children[owner], name.upper(), word.upper(), title, needed)

    def _value(self, name: str, owner: str, children: dict[str, Any]) -> None:
        """Note where a value can be read, since models of QGIS give layers and files alone."""
        if self.steps[owner].spec.id.startswith(catalog.QGIS):
            self.notes.append(f"{name} is a value, which models of QGIS do not give")
            return
        self.notes.append(f"{name} is a value: it is in the report of step {owner}, {owner}:{PAGE}")
        if PAGE not in children[owner]["outputs"]:
            title = f"Report of step {owner}"
            self._result(children[owner], PAGE, PAGE, title, needed=False)

    def _result(
        self, child: dict[str, Any], name: str, word: str, title: str, needed: bool
    ) -> None:
        """Make an output of a step an output of the model."""
        column, row = self._column(child["id"]), list(self.steps).index(child["id"]) + 0.5
        made = _component(name, column, row + 0.25 * len(child["outputs"]))
        made |= {"child_id": child["id"], "output_name": word, "default_value": None}
        child["outputs"][name] = made | {"component_description": title, "mandatory": needed}

    def _definition(self, f: Field) -> dict[str, Any]:
        """Describe an input as a parameter of QGIS."""
        default = constant(f, self.values.get(f.name))
        if f.kind.word == "extent":  # an expression, which would state it, sees no extents
            default = None
        neutral = field(f) | {"default": default}
        type, more = _parameter_type(neutral, self.point_layers)
        optional = f.optional and f.name not in self.given
        return {
            "parameter_type": type,
            "name": f.name.upper(),
            "description": f.title,
            "default": neutral["default"],
            "defaultGui": None,
            "flags": OPTIONAL if optional else 0,
            "help": f.help,
            "metadata": {},
            **more,
        }


def _component(name: str | None, column: float, row: float) -> dict[str, Any]:
    """A box on the canvas."""
    made: dict[str, Any] = {"component_width": 200.0, "component_height": 30.0}
    made |= {"component_pos_x": 120 + WIDE * column, "component_pos_y": 60 + HIGH * row}
    made |= {"component_description": "", "color": ""}
    made |= {"parameters_collapsed": True, "outputs_collapsed": True}
    return made if name is None else made | {"name": name}


def _parameter_type(f: Mapping[str, Any], point_layers: bool) -> tuple[str, dict[str, Any]]:
    """The type of a parameter of QGIS, and its other properties."""
    type, many = f["type"], f["many"]
    if type == "pointcloud" and not point_layers:
        type = "file"
    if type in SOURCES and many:
        return "multilayer", {"layer_type": SOURCES[type], "min_inputs": 1}
    if type == "file":
        return "file", {"behavior": 0, "extension": "", "filefilter": POINT_FILES}
    if type in ("vector", "table"):
        return "source", {"data_types": [SOURCES[type]]}
    low, high = float(f.get("ge", f.get("gt", -FAR))), float(f.get("le", f.get("lt", FAR)))
    number = {"min": low, "max": high, "data_type": 0 if type == "integer" else 1}
    plain: dict[str, tuple[str, dict[str, Any]]] = {
        "number": ("number", number),
        "integer": ("number", number),
        "length": ("distance", number | {"parent": "", "default_unit": 0}),
        "choice": ("enum", {"allow_multiple": many, "uses_static_strings": True}),
        "text": ("string", {"multiline": False}),
        "classes": ("string", {"multiline": False}),
        "range": ("range", {"data_type": 1}),
        "position": ("point", {}),
    }
    word, more = plain.get(type, (type, {}))
    return word, more | ({"options": f["choices"]} if type == "choice" else {})


OR_DEFAULT = re.compile(
    r"coalesce\(@(\w+), (?:[-+.\deE]+|true|false|'(?:[^']|'')*'|array\([^@()]*\))\)"
)


def or_default(name: str, default: Any) -> str:
    """The expression of QGIS that gives an input, or its default where it is left empty.

    >>> or_default("METHOD", "it's")
    "coalesce(@METHOD, 'it''s')"
    """
    return f"coalesce(@{name}, {_literal(default)})"


def _literal(value: Any) -> str:
    """A constant in an expression of QGIS."""
    if isinstance(value, list):
        return f"array({', '.join(map(_literal, value))})"
    if isinstance(value, str):
        return "'" + value.replace("\\", r"\\").replace("'", "''").replace("\n", r"\n") + "'"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def constant(f: Field, value: Any) -> Any:
    """Convert a value to that of a parameter of QGIS; `from_constant` converts it back."""
    if value is None:
        return None
    if f.kind is CHOICE:
        return [str(v) for v in f.items(value)] if f.many else str(value)
    if isinstance(value, Extent):  # QGIS says both x first
        return f"{value.xmin!r},{value.xmax!r},{value.ymin!r},{value.ymax!r}"
    items = [v if v in f.choices else f.kind.to_json(v) for v in f.items(value)]
    if f.many or isinstance(items[0], list) or f.choices:
        texts = (",".join(map(repr, i)) if isinstance(i, list) else str(i) for i in items)
        return SEPARATOR.join(texts)
    return items[0]


# From QGIS ---------------------------------------------------------------------------------------


def from_qgis(text: str, where: str) -> tuple[dict[str, Any], list[str]]:
    """Convert the text of a .model3 file to the content of our model file, with notes.

    Parameters
    ----------
    where : path of the file, for messages and the id of the model

    Raises
    ------
    ParameterError
        All that cannot be converted.
    """
    try:
        says = model3.value(text)
    except ValueError as err:
        raise ParameterError(f"{where} cannot be read as a model of QGIS: {err}") from None
    if not isinstance(says, dict) or "children" not in says:
        raise ParameterError(f"{where} is no model of QGIS: it has no steps")
    try:
        return _FromQgis(says, where).model()
    except ParameterError:
        raise
    except (AttributeError, LookupError, TypeError, ValueError) as err:  # of another shape
        raise ParameterError(f"{where} is damaged: {err!r}") from err


class _FromQgis:
    def __init__(self, says: Mapping[str, Any], where: str) -> None:
        self.says, self.where = says, where
        self.problems: dict[str, str] = {}
        self.notes: list[str] = []
        self.ours = names()
        children = {id: c for id, c in (says["children"] or {}).items() if c.get("active", True)}
        for id in says["children"].keys() - children.keys():
            self.notes.append(f"step {id} is switched off and left out")
        self.children: dict[str, Any] = children
        self.step_names = _names_of(children)
        self.input_names = {name: _name(name) for name in says.get("parameterDefinitions") or {}}
        self.fields: dict[str, Field] = {}  # of each input, the parameter that first uses it
        self.specs = {id: spec for id in children if (spec := self._spec(id))}

    def _spec(self, id: str) -> Any:
        alg = str(self.children[id]["alg_id"])
        tool = self.ours.get(alg.removeprefix(OURS)) if alg.startswith(OURS) else f"qgis:{alg}"
        name = self.step_names[id]
        if tool is None:
            self.problems[name] = f"{alg} is no tool of ours; it may be of another version"
            return None
        try:
            return catalog.load(tool)
        except ParameterError as err:
            self.problems[name] = str(err)
            return None

    def model(self) -> tuple[dict[str, Any], list[str]]:
        steps = _in_order({self.step_names[id]: self._step(id) for id in self.specs})
        outputs = self._outputs()
        inputs = {name: self._input(name) for name in self._order() if name in self.fields}
        for name in self.input_names.keys() - self.fields.keys():
            self.notes.append(f"input {name} is not used and left out")
        if not outputs and not self.problems:
            self.problems["outputs"] = "the model gives nothing"
        if self.problems:
            raise ParameterError(f"{self.where} cannot be converted", self.problems)
        title = str(self.says.get("model_name") or "Model")
        made: dict[str, Any] = {"id": f"my.{_name(Path(self.where).stem)}", "title": title}
        if help := (self.says.get("help") or {}).get("ALG_DESC"):
            made["help"] = str(help)
        made |= {"inputs": {self.input_names[n]: says for n, says in inputs.items()}}
        return made | {"steps": steps, "outputs": outputs}, self.notes

    def _order(self) -> list[str]:
        said = [name for name in self.says.get("parameterOrder") or [] if name in self.input_names]
        return list(dict.fromkeys([*said, *self.input_names]))

    def _step(self, id: str) -> dict[str, Any]:
        child, spec = self.children[id], self.specs[id]
        made: dict[str, Any] = {"tool": spec.id}
        for one in child.get("dependencies") or []:
            if isinstance(one, dict) and one.get("conditional_branch"):
                self.problems[self.step_names[id]] = "runs on a condition; use 'when' in our model"
        for key, said in (child.get("params") or {}).items():
            name = key.lower()
            sources = [s for s in said or [] if s.get("source") != OUTPUT]
            f = spec.inputs.get(name)
            full = f"{self.step_names[id]}.{name}"
            if f is None:
                self._of_no_input(full, sources)
                continue
            each = dataclasses.replace(f, many=f.many and len(sources) == 1)
            values = [self._value(full, each, source) for source in sources]
            values = [value for value in values if value is not _NOTHING]
            if values:
                made[name] = values if _is_list(f, values) else values[0]
        return made

    def _of_no_input(self, full: str, sources: list[dict[str, Any]]) -> None:
        """Report a value of what is no input of the tool: an option of a run, or an output."""
        empty = (None, "", False)
        said = [s for s in sources if s["source"] != CONSTANT or s.get("static_value") not in empty]
        if said:
            self.problems[full] = "is no parameter of the tool; say it when the model is run"

    def _value(self, full: str, f: Field, source: Mapping[str, Any]) -> Any:
        kind = source.get("source")
        if kind == EXPRESSION and (name := self._input_of(str(source.get("expression")).strip())):
            kind, source = INPUT, {"parameter_name": name}
        if kind == INPUT:
            name = str(source["parameter_name"])
            self.fields.setdefault(name, f)
            return {"from": f"{INPUTS}.{self.input_names.get(name, _name(name))}"}
        if kind == STEP:
            step = self.step_names.get(str(source["child_id"]), "?")
            return {"from": f"{step}.{str(source['output_name']).lower()}"}
        if kind == CONSTANT:
            return self._constant(full, f, source.get("static_value"))
        says = source.get("expression") or source.get("expression_text") or ""
        self.problems[full] = f"is an expression of QGIS, {str(says)!r}, which has no counterpart"
        return _NOTHING

    def _input_of(self, expression: str) -> str | None:
        """The input that an expression names, alone or with its default; None for any other."""
        alone, filled = re.fullmatch(r"@(\w+)", expression), OR_DEFAULT.fullmatch(expression)
        name = str((alone or filled or [None, ""])[1])
        says = (self.says.get("parameterDefinitions") or {}).get(name)
        if says is None or (filled and says.get("default") is None):
            return None
        if filled and expression != or_default(name, says["default"]):  # changed in the designer
            shown = f"{self.input_names[name]} is {says['default']} by default"
            self.notes.append(f"{shown}, although a step says {expression}")
        return name

    def _constant(self, full: str, f: Field, value: Any) -> Any:
        """A plain value; the default of the tool is left out."""
        if isinstance(value, Foreign):
            self.problems[full] = f"is a {value.type}, which has no counterpart"
            return _NOTHING
        if value in (None, "", {}) or (f.kind.word == "range" and not _numbers(value)):
            cleared = value is None and f.optional and not f.required and f.default is not None
            return None if cleared else _NOTHING
        if f.kind.is_layer:
            self.problems[full] = f"is the file {value!r}; make it an input of the model"
            return _NOTHING
        if f.kind.word == "CRS" and not isinstance(value, str):
            self.problems[full] = f"is {value!r}, which has no counterpart"
            return _NOTHING
        try:
            plain = from_constant(f, value)
            same = not f.required and f.parse(plain) == f.default
        except ValueError as err:
            self.problems[full] = str(err)
            return _NOTHING
        return _NOTHING if same else plain

    def _input(self, name: str) -> dict[str, Any]:
        """An input of our model, with the type of the parameter that uses it."""
        says, f = self.says["parameterDefinitions"][name], self.fields[name]
        title = says.get("description")
        made: dict[str, Any] = {"type": f.kind.word}
        made |= {"help": str(says.get("help") or title or name)}
        made |= _label(self.input_names[name], title) if says.get("help") else {}
        optional = bool(int(says.get("flags") or 0) & OPTIONAL)
        if f.many:
            made["many"] = True
        if f.kind.is_layer:
            return made | ({"optional": True} if optional else {})
        if f.kind is CHOICE:
            made["choices"] = list(f.choices)
        if f.unit or f.kind.word in ("number", "integer"):
            made["unit"] = f.unit or "1"  # QGIS states none: its lengths are in that of the layer
        made |= f.limits
        default = says.get("default")
        if default not in (None, "", {}):
            made["default"] = from_constant(f, default)
        elif optional:
            made["default"] = None
        return made

    def _outputs(self) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for id in self.specs:
            for name, says in (self.children[id].get("outputs") or {}).items():
                word = str(says["output_name"]).lower()
                full = f"{self.step_names[id]}.{word}"
                if word not in self.specs[id].outputs:  # such as a report, which any run may write
                    self.notes.append(
                        f"output {full} is left out; ask for it when the model is run"
                    )
                    continue
                helps, title = self.says.get("help") or {}, says.get("component_description")
                made = _unused(_name(name), [*found, *self.input_names.values()])
                about = str(helps.get(f"{id}:{name}") or title or name)
                label = _label(made, title) if about != title else {}
                found[made] = {"from": full, "help": about} | label
        return found


def _label(name: str, title: Any) -> dict[str, str]:
    """The label of a field, if its title in QGIS says more than its name."""
    return {"label": str(title)} if title and str(title) != in_words(name) else {}


_NOTHING = object()


def from_constant(f: Field, value: Any) -> Any:
    """Convert a value of a parameter of QGIS to that of our model file."""
    if f.kind is CHOICE and not isinstance(value, str):
        items = value if isinstance(value, list) else [value]
        known = dict(enumerate(f.choices))
        words = [known.get(i, i) if isinstance(i, int) else i for i in items]
        return words if f.many else next(iter(words), None)
    if not isinstance(value, str):
        return value
    if f.many:
        items = [item.strip() for item in value.split(SEPARATOR) if item.strip()]
        whole, number = f.kind.word == "integer", f.kind.word == "number"
        return [int(i) if whole else float(i) if number else i for i in items]
    if f.kind.word in ("extent", "position", "range"):
        numbers = _numbers(value)
        if f.kind.word == "extent" and len(numbers) == len(Extent._fields):
            return [numbers[i] for i in (0, 2, 1, 3)]
        return numbers
    return value


def _numbers(value: Any) -> list[float]:
    """Read the numbers in a text of QGIS, which may end in a CRS; "None,None" holds none.

    >>> _numbers("1,-2.5e3 [EPSG:2154]"), _numbers("None,nan")
    ([1.0, -2500.0], [])
    """
    found = re.findall(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", str(value).partition("[")[0])
    return [float(number) for number in found]


def _is_list(f: Field, values: list[Any]) -> bool:
    """Whether values are references that make up a list; a single input is a list already."""
    refers = isinstance(values[0], dict)
    return f.many and refers and (len(values) > 1 or f"{INPUTS}." not in values[0]["from"])


def _in_order(steps: dict[str, Any]) -> dict[str, Any]:
    """Sort steps for the readers of the file: each after those that it refers to."""
    try:
        return {name: steps[name] for name in in_order({n: _needs(s) for n, s in steps.items()})}
    except CycleError:
        return steps


def _needs(says: Mapping[str, Any]) -> set[str]:
    values = [v for value in says.values() for v in (value if isinstance(value, list) else [value])]
    return {str(v["from"]).partition(".")[0] for v in values if isinstance(v, dict)}


def _names_of(children: Mapping[str, Any]) -> dict[str, str]:
    """The name of each step: its id in lower case, with _ between the words."""
    found: dict[str, str] = {}
    for id in children:
        found[id] = _unused(_name(id.rpartition(":")[2]), [*found.values(), INPUTS])
    return found


def _name(text: str) -> str:
    """Turn a text into lower-case words with _ between."""
    name = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")
    name = name if NAME.fullmatch(name) else re.sub(r"^[0-9_]+", "", f"{name}")
    return name or "step"


def _unused(name: str, taken: list[str]) -> str:
    number = 2
    made = name
    while made in taken:
        made, number = f"{name}_{number}", number + 1
    return made
