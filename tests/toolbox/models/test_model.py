"""Models: what is wrong with a file, in which order steps run, what they reach and keep."""

from __future__ import annotations

import copy
import itertools
import json
import math
import weakref
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from pyproj import CRS

from toolbox import catalog, language
from toolbox.context import QUIET, Context, setting_name, settings_named
from toolbox.data import PointCloud, Raster, Table
from toolbox.declare import ClassList
from toolbox.declare.fields import Spec
from toolbox.declare.spec import REGISTRY, outputs, param, sink, source, tool
from toolbox.errors import Cancelled, DataError, ParameterError
from toolbox.execute import run
from toolbox.models import reader as model_reader
from toolbox.models.model import Model, ModelRun

Load = Callable[[str], Model]
seen: list[weakref.ref[PointCloud]] = []  # clouds that toy.shift has made


@tool("toy.shift")
class ToyShift:
    """Move points up.

    By as much as it is told.
    """

    points: PointCloud = source("Points")
    by: float = param("How far", default=1.0, unit="m", lt=100, label="Metres upwards")
    least: float = param("Not less than this", default=0.0, unit="m")
    word: Literal["no", "yes"] = param("A word that YAML could take for a switch", default="yes")

    @outputs
    class Outputs:
        moved: PointCloud = sink("Moved points")
        top: float = sink("Highest", unit="m")
        what: str = sink("The word")

    def check(self) -> Iterator[tuple[str, str]]:
        if self.by < self.least:
            yield "by", f"must be at least {self.least:g}, got {self.by:g}"

    def halo(self) -> float:
        return self.by

    def run(self, ctx: Context = QUIET) -> ToyShift.Outputs:
        ctx.progress(0.5)
        if self.by == 13:
            raise DataError("unlucky", {"points": "are unlucky"})
        moved = self.points.with_xyz(self.points.xyz + np.array([0, 0, self.by]))
        seen.append(weakref.ref(moved))
        ctx.progress(1.0)
        top = float(moved.xyz[:, 2].max())
        return self.Outputs(moved=moved, top=top, what=self.word)


@tool("toy.join")
class ToyJoin:
    """Count points of several clouds.

    Each counts as often as it is given.
    """

    points: tuple[PointCloud, ...] = source("Several clouds")
    raster: Raster | None = source("A raster", default=None)
    factor: float = param("A number", default=1.0, unit="1")
    heights: tuple[float, ...] = param("Several lengths", default=(), unit="m")
    classes: ClassList | None = param("Classes", default=None)
    weight: float | None = param("A number or none", default=5.0, unit="1")
    size: int = param("A count", default=1, unit="1", ge=1)

    @outputs
    class Outputs:
        count: int = sink("Points, all together", unit="1")
        tops: Table = sink("The heights")
        used: float | None = sink("The weight", unit="1")

    def halo(self) -> float:
        return 5.0

    def run(self, ctx: Context = QUIET) -> ToyJoin.Outputs:
        ctx.progress(1.0)
        count = sum(map(len, self.points)) * self.size
        rows = [{"height": height} for height in self.heights]
        return self.Outputs(count=count, tops=Table.from_rows(rows), used=self.weight)


TOYS = {id: REGISTRY[id] for id in ("toy.shift", "toy.join")}
HEAD = "id: my.test\ntitle: Test\ninputs:\n  points: {type: PointCloud, help: Points}\n"
SHIFT = "{tool: toy.shift, points: {from: inputs.points}"


@pytest.fixture(autouse=True)
def _nothing_seen() -> None:
    seen.clear()


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """Read a model of toys from its text."""

    def find(id: str) -> Spec:
        if id not in TOYS:
            raise ParameterError(f"no tool called {id!r}")
        return TOYS[id]

    def made(text: str) -> Model:
        path = tmp_path / "model.yaml"
        path.write_text(text, encoding="utf-8")
        return model_reader.load(path, find)

    return made


@pytest.fixture
def cloud() -> PointCloud:
    return PointCloud(np.array([[0.0, 0, 5], [1, 1, 6]]), crs=CRS(32635), name="two.laz")


def problems(load: Load, text: str) -> Mapping[str, str]:
    with pytest.raises(ParameterError) as error:
        load(text)
    return error.value.problems


def chain(steps: str, outs: str = "n: {from: a.top}", inputs: str = "") -> str:
    """A model with these steps, one a line."""
    lines = "".join(f"  {line}\n" for line in steps.splitlines() if line.strip())
    more = "".join(f"  {line}\n" for line in inputs.splitlines() if line.strip())
    return f"{HEAD}{more}steps:\n{lines}outputs:\n  {outs}\n"


# What is wrong with a file


def test_all_mistakes_are_reported_at_once(load: Load) -> None:
    text = """
id: my.test
title: Test
inputs:
  points: {type: PointCloud, help: Points}
  shares: {type: number, unit: 1, help: No length}
  bad: {type: numbr, help: Unknown type}
steps:
  a: {tool: toy.shift, points: {from: inputs.point}, bye: 2}
  b: {tool: toy.shift, by: 100, points: {from: a.mooved}}
  c: {tool: toy.shift, points: {from: b.top}}
  d: {tool: toy.smooth, points: {from: b.moved}}
  e: {tool: toy.shift, points: {from: d.gone}, by: {from: inputs.shares}, word: {from: inputs.bad}}
  f: {tool: toy.shift}
  g: {tool: toy.join, points: {from: a.moved}, size: a, factor: {from: q.xyz}}
  h: {tool: toy.shift, points: a.laz}
  i: {tool: toy.shift, points: [{from: a.moved}]}
  j: {tool: toy.shift, points: {from: a}}
outputs:
  x: {from: b.tpo}
  y: {from: d.gone}
  z: {from: inputs.points}
  points: {from: a.moved}
"""
    assert problems(load, text) == {
        "inputs.bad.type": "no type 'numbr'; did you mean 'number'?",
        "a.points": "nothing called 'inputs.point'; did you mean 'inputs.points'?",
        "a.bye": "unknown parameter; did you mean 'by'?",
        "b.by": "must be < 100 m, got 100",
        "b.points": "nothing called 'a.mooved'; did you mean 'a.moved'?",
        "c.points": "needs a PointCloud, but 'b.top' is a number",
        "d.tool": "no tool called 'toy.smooth'",
        "e.by": "is in m, but 'inputs.shares' in 1",
        "f.points": "missing (Points)",
        "g.points": "takes a list; write [{from: a.moved}]",
        "g.size": "must be an integer, got 'a'",
        "g.factor": "nothing called 'q.xyz'",
        "h.points": "is a layer; it needs a reference {from: step.output}",
        "i.points": "takes one value, not a list",
        "j.points": "a reference is {from: step.output}, got {'from': 'a'}",
        "outputs.x": "nothing called 'b.tpo'; did you mean 'b.top'?",
        "outputs.z": "'inputs.points' is what the model is given; an output is what a step gives",
        "outputs.points": "is the name of an input too",
    }


def test_steps_that_wait_for_each_other(load: Load) -> None:
    steps = """
a: {tool: toy.shift, points: {from: b.moved}}
b: {tool: toy.shift, points: {from: a.moved}}
c: {tool: toy.shift, points: {from: inputs.points}}"""
    found = problems(load, chain(steps))
    assert found.keys() == {"steps"}
    assert found["steps"] in (
        "wait for each other: a -> b -> a",
        "wait for each other: b -> a -> b",
    )


@pytest.mark.parametrize(
    ("text", "name", "problem"),
    [
        ("title: x\nsteps: {}\noutputs: {}", "model.id", "missing"),
        ("id: Bad.Id\ntitle: x\nsteps: []\noutputs: 3", "id", "must be like models.terrain"),
        ("id: a.b\ntitle: x\nsteps: [1]\noutputs: {x: a.b}", "steps", "must hold names and values"),
        ("idd: a.b\ntitle: x", "model.idd", "unknown word; did you mean 'id'?"),
    ],
)
def test_files_that_are_hardly_models(load: Load, text: str, name: str, problem: str) -> None:
    assert problem in problems(load, text)[name]


@pytest.mark.parametrize(
    ("says", "word", "problem"),
    [
        ("5", "", "must be {type: ..., help: ...}, got 5"),
        ("{type: number, help: x}", ".unit", "missing: m for lengths"),
        ("{type: number, unit: feet, help: x}", ".unit", "must be one of m, m2"),
        ("{type: number, unit: m}", ".help", "missing"),
        ("{type: number, unit: m, help: x, gt: big}", ".gt", "must be a number"),
        ("{type: text, help: x, gt: 1}", ".gt", "of a number or range"),
        ("{type: number, unit: m, help: x, gt: 0, default: -1}", ".default", "must be > 0 m"),
        ("{type: number, unit: m, help: x, default: a}", ".default", "must be a number"),
        ("{type: number, unit: m, help: x, feet: a}", ".feet", "must be a number, of a length"),
        ("{type: number, unit: m2, help: x, feet: 3}", ".feet", "must be a number, of a length"),
        ("{type: choice, help: x}", ".choices", "missing: the words"),
        ("{type: choice, help: x, choices: a}", ".choices", "must be a list of words"),
        ("{type: choice, help: x, choices: [a, b], default: c}", ".default", "must be one of a, b"),
        ("{type: text, help: x, many: no}", ".many", "must be true or false"),
        ("{type: PointCloud, help: x, default: a.laz}", ".default", "a layer has none"),
        ("{type: PointCloud, help: x, shapes: [line]}", ".shapes", "of vector layers"),
        ("{type: Vector, help: x, shapes: [area]}", ".shapes", "must be of point, line, polygon"),
        ("{type: text, help: x, of: points}", ".of", "is for attributes"),
        ("{type: attribute, help: x, of: pints}", ".of", "no source called 'pints'; did you mean"),
        ("{type: text, help: x, defalt: 3}", ".defalt", "did you mean 'default'?"),
        ("{type: text, help: x}", "", "no step refers to it"),
    ],
)
def test_inputs_that_make_no_sense(load: Load, says: str, word: str, problem: str) -> None:
    found = problems(load, chain(f"a: {SHIFT}}}", inputs=f"extra: {says}"))
    assert problem in found[f"inputs.extra{word}"]
    assert len(found) == 1


@pytest.mark.parametrize("name", ["overwrite", "json", "tile", "Big", "two-words", "inputs"])
def test_names_that_cannot_be_options(load: Load, name: str) -> None:
    extra = f"{name}: {{type: number, unit: m, help: x}}"
    steps = f"a: {{tool: toy.shift, points: {{from: inputs.points}}, by: {{from: inputs.{name}}}}}"
    assert f"inputs.{name}" in problems(load, chain(steps, inputs=extra))


def test_a_result_that_would_be_an_option_of_an_input_is_refused() -> None:
    """--points.bounds cannot be both a rectangle to read and a result to write."""
    spec = REGISTRY["toy.join"]
    field = spec.outputs["tops"]
    clash = Spec("toy.clash", "T", "H.", spec.make, spec.inputs, {"bounds": field})
    text = chain("points: {tool: toy.clash, points: [{from: inputs.points}]}", "n: points.bounds")
    path = Path("unused")
    reader = model_reader._ModelFile(path, lambda id: clash)
    with pytest.raises(ParameterError) as error:
        reader.model(model_reader.documents.mapping(text))
    assert error.value.problems == {
        "points": "points.bounds would mean two things; rename the step"
    }


@pytest.mark.parametrize(
    ("says", "key", "problem"),
    [
        ("when: yes", "when", "{from: inputs.name, is: word}, got 'yes'"),
        ("when: {from: a.top}", "when", "must be {from: inputs.name}"),
        ("when: {from: inputs.flg}", "when", "did you mean 'inputs.flag'?"),
        ("when: {from: inputs.flag, is: on}", "when", "inputs.flag is a switch, not a choice"),
        ("when: {from: inputs.flag, if: on}", "when", "must be {from: inputs.name}"),
        ("when: {from: inputs.flag, is: 3}", "when", "must be {from: inputs.name}"),
        ("repeat: by", "repeat", "'by' is no parameter given here"),
        ("repeat: nothing", "repeat", "'nothing' is no parameter given here"),
        ("by: [1, x], repeat: by", "by", "must be a number, got 'x'"),
        ("by: [], repeat: by", "by", "is an empty list"),
        ("by: [1, 200], repeat: by", "by", "must be < 100 m, got 200"),
        ("by: 1, least: 2", "by", "must be at least 2, got 1"),
        ("by: {from: inputs.far}", "by", "must be < 100 m, got 500"),
        ("by: {from: inputs.far, to: 3}", "by", "a reference is {from: step.output}"),
        ("by: [{from: inputs.far}, 3], repeat: by", "by", "references alone, or values alone"),
    ],
)
def test_steps_that_make_no_sense(load: Load, says: str, key: str, problem: str) -> None:
    inputs = "flag: {type: boolean, default: true, help: x}\n"
    inputs += "far: {type: number, unit: m, default: 500, help: x}\n"
    steps = f"a: {SHIFT}}}\nb: {SHIFT}, {says}}}\n"
    steps += f"c: {SHIFT}, when: {{from: inputs.flag}}}}\n"
    if "inputs.far}" not in says:  # else it would be reported as unused
        inputs = inputs.replace("default: 500", "default: 5")
        steps += f"d: {SHIFT}, by: {{from: inputs.far}}}}\n"
    found = problems(load, chain(steps, inputs=inputs))
    assert problem in found[f"b.{key}"]
    assert len(found) == 1


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "must hold names and values"),
        ("- a\n- b", "must hold names and values"),
        ("id: a.b\nid: a.c", "'id' is given more than once"),
        ("id: a.b\n\ttitle: x", "line 2, column 1: found character '\\t'"),
        ("id: {{", "line 1"),
        ("id: &a x\ntitle: *a", "& and * are not read"),
        ("[" * 100_000, "nested too deeply"),
        ("a: " + "{a: " * 100_000, "nested too deeply"),
        ("id: !!python/object:os.system x", "tag"),
        ("id: !!int ''", "line 1: tags such as tag:yaml.org,2002:int are not read"),
        ("id: a.b\ninputs: !x {}", "line 2: tags such as !x are not read"),
    ],
)
def test_text_that_is_no_document(load: Load, text: str, problem: str) -> None:
    with pytest.raises(ParameterError, match=r"model.yaml cannot be read as a model: ") as error:
        load(text)
    assert problem in str(error.value)
    assert len(str(error.value)) < 300


def test_files_that_are_no_text(tmp_path: Path) -> None:
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00\x01")
    folder = tmp_path / "folder.yaml"
    folder.mkdir()
    for path, text in [
        (binary, "is no UTF-8 text"),
        (folder, "Is a directory"),
        (tmp_path / "none.yaml", "No such file"),
    ]:
        with pytest.raises(ParameterError, match=text):
            catalog.load(str(path))


def test_words_and_numbers_are_what_they_look_like(load: Load) -> None:
    """`no` is a word, `yes` a switch where one is wanted, and numbers may stand in quotes."""
    inputs = "flag: {type: boolean, default: no, help: x}\n"
    inputs += "word: {type: choice, choices: [no, yes], default: no, help: x}"
    steps = f"a: {SHIFT}, by: '2.5', least: 1e-3, word: {{from: inputs.word}}}}\n"
    steps += f"on: {SHIFT}, when: {{from: inputs.flag}}, word: no}}\n"
    steps += "c: {tool: toy.join, points: [{from: a.moved}], classes: 2-5, size: 3.0}"
    made = load(chain(steps, inputs=inputs))
    assert made.inputs["flag"].default is False
    assert made.inputs["word"].default == "no"
    assert dict(made.steps["a"].settings) == {"by": 2.5, "least": 0.001}
    assert made.steps["on"].settings["word"] == "no"
    assert made.steps["c"].settings["classes"] == ClassList([2, 3, 4, 5])
    assert made.steps["c"].settings["size"] == 3
    bom = "\ufeff" + chain(f"a: {SHIFT}}}")
    assert load(bom).id == "my.test"


# Inputs, outputs, order


def test_inputs_have_types_units_limits_and_defaults(load: Load) -> None:
    inputs = "by: {type: number, unit: m, default: 3, gt: 0, le: 9, help: How far}\n"
    inputs += "word: {type: choice, choices: [no, yes], default: yes, help: A word}\n"
    inputs += "extra: {type: Raster, optional: true, help: A raster}\n"
    inputs += "hs: {type: number, unit: m, many: true, default: [1, 2], help: Heights}\n"
    inputs += "weight: {type: number, unit: 1, default: null, help: A number}"
    steps = f"a: {SHIFT}, by: {{from: inputs.by}}, word: {{from: inputs.word}}}}\n"
    steps += "b: {tool: toy.join, points: [{from: a.moved}], raster: {from: inputs.extra}, "
    steps += "heights: {from: inputs.hs}, weight: {from: inputs.weight}}"
    made = load(chain(steps, inputs=inputs))
    assert made.inputs["by"].rule() == "> 0 and <= 9 m"
    assert not made.inputs["extra"].required
    assert made.inputs["hs"].default == (1.0, 2.0)
    assert made.inputs["weight"].optional
    described = made.describe()
    assert described["inputs"]["by"]["schema"]["maximum"] == 9
    assert described["inputs"]["hs"]["maxOccurs"] == "unbounded"
    assert "a.moved" in described["between"]
    assert made.parse({"by": 10}, ["points"])[1] == {"by": "must be > 0 and <= 9 m, got 10"}


def test_order_comes_from_the_references(load: Load, cloud: PointCloud) -> None:
    steps = """
c: {tool: toy.shift, points: {from: b.moved}}
b: {tool: toy.shift, points: {from: a.moved}, by: 2}
a: {tool: toy.shift, points: {from: inputs.points}, by: 4}"""
    made = load(chain(steps, "n: {from: c.top, help: Top}"))
    assert list(made.steps) == ["a", "b", "c"]
    assert made.build({"points": cloud}).run().n == 6 + 4 + 2 + 1
    assert made.outputs["n"].help == "Top"


def test_a_none_replaces_a_default_but_a_step_left_out_does_not(
    load: Load, cloud: PointCloud
) -> None:
    inputs = "weight: {type: number, unit: 1, default: null, help: A number}\n"
    inputs += "flag: {type: boolean, default: false, help: x}"
    steps = """
a: {tool: toy.join, points: [{from: inputs.points}], weight: {from: inputs.weight}}
b: {tool: toy.join, when: {from: inputs.flag}, points: [{from: inputs.points}]}
c: {tool: toy.join, points: [{from: inputs.points}], weight: {from: b.used}}"""
    made = load(chain(steps, "n: {from: a.used}\n  m: {from: c.used}", inputs))
    result = made.build({"points": cloud}).run()
    assert (result.n, result.m) == (None, 5.0)


# Optional and repeated steps


OPTIONAL = f"""
a: {SHIFT}, when: {{from: inputs.flag}}}}
b: {{tool: toy.shift, points: {{from: [a.moved, inputs.points]}}, by: 10}}"""
FLAG = "flag: {type: boolean, default: true, help: x}"


def test_a_step_is_told_by_its_title_in_the_language_of_the_user(cloud: PointCloud) -> None:
    told: list[str] = []
    model = catalog.load("models.reservoir_shoreline").build({"points": cloud})
    with language.speaking("tr"):
        model.run(Context(stage=told.append))
    assert told[0].endswith(": Su kütlelerini bul"), told  # its Turkish title


def test_a_setting_has_the_name_by_which_the_user_of_the_model_gives_it(
    load: Load, cloud: PointCloud
) -> None:
    """Warnings told the user of a model to set what only the tool of one of its steps has."""
    steps = "a: {tool: toy.shift, points: {from: inputs.points}, by: {from: inputs.rise}, least: 1}"
    inputs = "rise: {type: number, unit: m, default: 2, help: x}"
    made = load(chain(steps, "n: {from: a.top}", inputs)).build({"points": cloud})
    told: list[str | None] = []

    def runner(name: str, job: Any, ctx: Context) -> Any:
        told.extend(map(setting_name, ("points", "by", "least")))
        with settings_named({"inside": "by", "word": "word"}):  # as a model in a model does
            told.extend(map(setting_name, ("inside", "word")))
        return job.run(ctx)

    replace(made, runner=runner).run()
    assert told == ["points", "rise", None, "rise", None]
    assert setting_name("by") == "by"


def test_a_step_may_be_left_out(load: Load, cloud: PointCloud) -> None:
    made = load(chain(OPTIONAL, "n: {from: b.top}\n  m: {from: a.top}", FLAG))
    assert made.build({"points": cloud}).run().n == 17
    without = made.build({"points": cloud, "flag": False}).run()
    assert (without.n, without.m) == (16, None)
    assert made.outputs["m"].optional
    assert not made.outputs["n"].optional
    assert [step.name for step in made.active({"flag": False})] == ["b"]


def test_a_result_that_may_be_missing_needs_an_alternative(load: Load) -> None:
    text = chain(OPTIONAL.replace("[a.moved, inputs.points]", "a.moved"), "n: {from: b.top}", FLAG)
    found = problems(load, text)
    assert found == {
        "b.points": "'a.moved' may be missing; say what to take then, {from: [a.moved, ...]}, "
        "or leave this step out by the same 'when'"
    }
    same = text.replace("by: 10", "by: 10, when: {from: inputs.flag}")
    assert load(same).outputs["n"].optional


CHOICE = "way: {type: choice, choices: [up, down], default: up, help: x}"
WAYS = f"""
a: {SHIFT}, by: 10, when: {{from: inputs.way, is: up}}}}
b: {SHIFT}, by: 20, when: {{from: inputs.way, is: down}}}}
c: {{tool: toy.shift, points: {{from: [a.moved, b.moved]}}, by: 1}}"""


def test_a_choice_between_steps(load: Load, cloud: PointCloud) -> None:
    made = load(chain(WAYS, "n: {from: c.top}\n  m: {from: b.top}", CHOICE))
    assert made.build({"points": cloud}).run().n == 17
    down = made.build({"points": cloud, "way": "down"}).run()
    assert (down.n, down.m) == (27, 26)
    assert [step.name for step in made.active({"way": "down"})] == ["b", "c"]
    assert not made.outputs["n"].optional  # one of the two is always there
    assert made.outputs["m"].optional


def test_inputs_that_no_step_uses(load: Load) -> None:
    more = CHOICE + "\nby: {type: number, unit: m, default: 2.0, help: A step}"
    made = load(chain(WAYS.replace("by: 20", "by: {from: inputs.by}"), inputs=more))
    assert made.idle({}) == ["by"]
    assert made.idle({"way": "down"}) == []


def test_a_choice_that_does_not_say_all(load: Load) -> None:
    more = CHOICE.replace("down]", "down, off]")
    found = problems(load, chain(WAYS, "n: {from: c.top}", more))
    assert list(found) == ["c.points"]
    found = problems(load, chain(WAYS.replace("is: down", "is: sideways"), inputs=CHOICE))
    assert found["b.when"] == "inputs.way is one of up, down, got 'sideways'"
    found = problems(load, chain(WAYS.replace(", is: down", ""), inputs=CHOICE))
    assert found["b.when"] == "inputs.way is a choice; say which, {from: inputs.way, is: up}"


def test_when_an_optional_source_is_there(load: Load, cloud: PointCloud) -> None:
    extra = "more: {type: PointCloud, optional: true, help: x}"
    step = "b: {tool: toy.shift, points: {from: inputs.more}, by: 3"
    steps = f"a: {SHIFT}}}\n{step}}}"
    assert "b.points" in problems(load, chain(steps, inputs=extra))
    steps = f"a: {SHIFT}}}\n{step}, when: {{from: inputs.more}}}}"
    made = load(chain(steps, "n: {from: [b.top, a.top]}", extra))
    assert made.build({"points": cloud}).run().n == 7
    assert made.build({"points": cloud, "more": cloud}).run().n == 9


def test_lists_keep_what_there_is(load: Load, cloud: PointCloud) -> None:
    joined = "c: {tool: toy.join, points: [{from: a.moved}, {from: inputs.points}]}"
    made = load(chain(OPTIONAL + "\n" + joined, "n: {from: c.count}", FLAG))
    assert made.build({"points": cloud}).run().n == 4
    assert made.build({"points": cloud, "flag": False}).run().n == 2
    alone = joined.replace(", {from: inputs.points}", "")
    assert "c.points" in problems(load, chain(OPTIONAL + "\n" + alone, "n: {from: c.count}", FLAG))


@pytest.mark.parametrize(
    "by", ["[1, 2, 3]", "{from: inputs.bys}", "[{from: inputs.x}, {from: a.top}]"]
)
def test_repeated_over_a_list(load: Load, cloud: PointCloud, by: str) -> None:
    """What each run gives feeds a source of several layers, and a further repeated step."""
    inputs = "bys: {type: number, unit: m, many: true, default: [1, 2, 3], help: x}\n"
    inputs += "x: {type: number, unit: m, default: 1, help: x}"
    steps = f"a: {SHIFT}, least: {{from: inputs.x}}}}\n"
    steps += f"b: {SHIFT}, repeat: by, by: {by}}}\n"
    steps += "c: {tool: toy.shift, repeat: points, points: {from: b.moved}}\n"
    steps += "d: {tool: toy.join, points: {from: c.moved}, heights: {from: c.top}}\n"
    steps += f"e: {SHIFT}, repeat: by, by: {{from: inputs.bys}}}}"
    made = load(
        chain(steps, "n: {from: d.count}\n  all: {from: c.top}\n  t: {from: d.tops}", inputs)
    )
    result = made.build({"points": cloud}).run()
    wanted = {"[{from": (8.0, 14.0)}.get(by[:6], (8.0, 9.0, 10.0))
    assert result.all == wanted
    assert result.n == 2 * len(wanted)
    assert [row["height"] for row in result.t.rows()] == list(wanted)
    assert made.outputs["all"].many


def test_nothing_to_repeat_for(load: Load, cloud: PointCloud) -> None:
    inputs = "bys: {type: number, unit: m, many: true, default: [1], help: x}"
    made = load(chain(f"a: {SHIFT}, repeat: by, by: {{from: inputs.bys}}}}", inputs=inputs))
    assert made.rules({"bys": ()}) == {
        "a.by": "is an empty list; there is nothing to repeat the step for"
    }
    assert made.rules({"bys": (1.0, 500.0)}) == {"a.by": "must be < 100 m, got 500.0"}
    with pytest.raises(ParameterError, match="empty list"):
        ModelRun(made, {"points": cloud, "bys": ()}).run()
    one = inputs.replace("many: true, default: [1]", "default: 1")
    wrong = problems(load, chain(f"a: {SHIFT}, repeat: by, by: {{from: inputs.bys}}}}", inputs=one))
    assert wrong == {"a.by": "takes a list; write [{from: inputs.bys}]"}


# Reach and rules, before anything is read


def test_reach_is_the_longest_way(load: Load) -> None:
    inputs = "far: {type: number, unit: m, default: 7, help: x}\n" + FLAG
    steps = f"""
a: {SHIFT}, by: {{from: inputs.far}}}}
b: {{tool: toy.shift, points: {{from: a.moved}}, by: 20, when: {{from: inputs.flag}}}}
c: {{tool: toy.shift, points: {{from: a.moved}}, by: [1, 4], repeat: by}}
d: {{tool: toy.join, points: [{{from: b.moved}}, {{from: inputs.points}}]}}
e: {{tool: toy.join, points: {{from: c.moved}}}}"""
    made = load(chain(steps, "n: {from: d.count}\n  m: {from: e.count}", inputs))
    assert made.reach({}) == {"a": 7, "b": 27, "c": 11, "d": 32, "e": 16}
    assert made.halo({}) == 32
    assert made.halo({"flag": False, "far": 1.0}) == 1 + 4 + 5
    assert made.build({"points": PointCloud(np.zeros((1, 3)))}).spec.halo({"far": 2.0}) == 27


def test_reach_is_unknown_where_another_step_decides(load: Load) -> None:
    steps = f"a: {SHIFT}}}\nb: {SHIFT}, by: {{from: a.top}}, least: 3}}"
    made = load(chain(steps))  # whether `by` is at least 3 is not known yet, either
    assert math.isinf(made.halo({}))
    assert made.rules({}) == {}


def test_rules_are_named_after_steps_and_told_before_anything_is_read(
    load: Load, tmp_path: Path
) -> None:
    inputs = "by: {type: number, unit: m, default: 3, help: x}"
    steps = f"a: {SHIFT}, least: 2, by: {{from: inputs.by}}}}"
    made = load(chain(steps, inputs=inputs))
    assert made.rules({"by": 1.0}) == {"a.by": "must be at least 2, got 1"}
    (tmp_path / "no.laz").write_bytes(b"unreadable")
    text = catalog.own_files()["models.terrain"].read_text("utf-8").replace("gt: 0, ", "")
    (tmp_path / "t.yaml").write_text(text, "utf-8")
    with pytest.raises(ParameterError, match=r"top.cell: must be > 0 and <= 10000 m, got -1"):
        run(str(tmp_path / "t.yaml"), {"points": tmp_path / "no.laz", "cell": -1.0})


# Running


def test_layers_in_between_are_forgotten_after_their_last_use(
    load: Load, cloud: PointCloud
) -> None:
    names = "abcdefgh"
    steps = [f"a: {SHIFT}}}"]
    steps += [
        f"{this}: {{tool: toy.shift, points: {{from: {last}.moved}}}}"
        for last, this in itertools.pairwise(names)
    ]
    made = load(chain("\n".join(steps), "n: {from: h.top}"))
    alive: list[int] = []

    def runner(name: str, job: Any, ctx: Context) -> Any:
        alive.append(sum(ref() is not None for ref in seen))
        return job.run(ctx)

    assert ModelRun(made, {"points": cloud}, runner=runner).run().n == 14
    assert alive == [0, 1, 1, 1, 1, 1, 1, 1]
    alive.clear()
    seen.clear()
    kept = ModelRun(made, {"points": cloud}, frozenset({"b.moved"}), runner=runner).run()
    assert getattr(kept, "b.moved").xyz[0, 2] == 7
    assert alive == [0, 1, 1, 2, 2, 2, 2, 2]


def test_part_of_a_model_with_given_results(load: Load, cloud: PointCloud) -> None:
    steps = f"a: {SHIFT}, by: 2}}\nb: {{tool: toy.shift, points: {{from: a.moved}}}}"
    made = load(chain(steps, "n: {from: a.top}\n  m: {from: b.top}"))
    first, second = made.subset(["a"]), made.subset(["b"])
    assert (list(first.outputs), list(second.outputs)) == (["n"], ["m"])
    one = ModelRun(first, {"points": cloud}, keep=frozenset({"a.moved"})).run()
    two = ModelRun(second, {"points": cloud}, given={"a.moved": getattr(one, "a.moved")}).run()
    assert (one.n, two.m) == (8, 9)


def test_errors_are_named_after_their_step(load: Load, cloud: PointCloud) -> None:
    steps = f"a: {SHIFT}}}\nb: {SHIFT}, repeat: by, by: [1, 13]}}"
    with pytest.raises(DataError, match=r"my.test, step 'b 2' \(toy.shift\): 1 problem") as error:
        load(chain(steps)).build({"points": cloud}).run()
    assert error.value.problems == {"points": "are unlucky"}
    degrees = cloud.with_crs(CRS(4326))
    with pytest.raises(DataError, match=r"points: .* degrees .*\(step 'a' measures lengths\)"):
        load(chain(steps)).build({"points": degrees}).run()


def test_mistakes_of_ours_say_the_step_too(load: Load, cloud: PointCloud) -> None:
    def broken(name: str, job: Any, ctx: Context) -> Any:
        raise ZeroDivisionError

    made = load(chain(f"a: {SHIFT}}}"))
    with pytest.raises(ZeroDivisionError) as error:
        ModelRun(made, {"points": cloud}, runner=broken).run()
    assert error.value.__notes__ == ["in my.test, step 'a' (toy.shift)"]


def test_progress_and_cancel(load: Load, cloud: PointCloud) -> None:
    steps = f"a: {SHIFT}}}\nb: {SHIFT}, repeat: by, by: [1, 2]}}"
    job = load(chain(steps)).build({"points": cloud})
    told: list[float] = []
    job.run(Context(told.append))
    assert told == sorted(told)
    assert told[0] == 0.0
    assert {0.25, 0.5, 0.625, 0.75, 1.0} <= set(told)
    calls = 0

    def stop() -> bool:
        nonlocal calls
        calls += 1
        return calls > 3  # in the middle of the second step

    with pytest.raises(Cancelled):
        job.run(Context(stop=stop))


def test_feet_are_metres_to_the_user(load: Load, cloud: PointCloud) -> None:
    foot = 1200 / 3937
    feet = PointCloud(cloud.xyz / foot, crs=CRS(2263), name="feet.laz")
    made = load(chain(f"a: {SHIFT}, by: 2}}"))
    assert made.build({"points": feet}).run().n == pytest.approx(8)


# Models in models


INNER = """
id: my.inner
title: Inner
inputs:
  points: {type: PointCloud, help: Points}
  cell: {type: number, unit: m, default: 2, gt: 0, help: Cell}
steps:
  grid: {tool: surface.grid, points: {from: inputs.points}, method: mean, cell: {from: inputs.cell}}
outputs:
  mean: {from: grid.surface}
"""
OUTER = """
id: my.outer
title: Outer
inputs:
  points: {type: PointCloud, help: Points}
steps:
  clean: {tool: points.filter, points: {from: inputs.points}, classes: 1-2}
  sub: {tool: inner.yaml, points: {from: clean.kept}, cell: 4}
outputs:
  raster: {from: sub.mean}
"""


@pytest.fixture
def models(tmp_path: Path) -> Path:
    (tmp_path / "inner.yaml").write_text(INNER, "utf-8")
    (tmp_path / "outer.yaml").write_text(OUTER, "utf-8")
    return tmp_path


@pytest.fixture
def classified() -> PointCloud:
    xyz = np.random.default_rng(1).uniform(0, 20, (200, 3))
    classes = np.repeat(np.array([1, 6], np.uint8), 100)
    return PointCloud(xyz, {"classification": classes}, crs=CRS(32635), name="c.laz")


def test_a_model_runs_another_beside_it(models: Path, classified: PointCloud) -> None:
    outer = catalog.load(str(models / "outer.yaml"))
    assert isinstance(outer, Model)
    assert outer.halo({}) == pytest.approx(2, rel=1e-4)  # half a cell of 4 m
    names: list[str] = []

    def runner(name: str, job: Any, ctx: Context) -> Any:
        names.append(name)
        return job.run(ctx)

    result = ModelRun(outer, {"points": classified}, runner=runner).run()
    assert result.raster.cell == 4
    assert names == ["clean", "sub/grid"]
    assert run(str(models / "outer.yaml"), {"points": classified})["raster"].cell == 4


def test_a_tool_that_also_takes_surveys_takes_points(models: Path, classified: PointCloud) -> None:
    text = OUTER.replace(
        "inner.yaml, points: {from: clean.kept}, cell: 4", "points.info, points: {from: clean.kept}"
    ).replace("sub.mean", "sub.count")
    (models / "outer.yaml").write_text(text, "utf-8")
    assert run(str(models / "outer.yaml"), {"points": classified})["raster"] == 100


def test_errors_in_a_model_in_a_model_name_both_steps(models: Path, classified: PointCloud) -> None:
    none = classified.select([])
    where = r"my.outer, step 'sub' \(my.inner\): my.inner, step 'grid' \(surface.grid\)"
    with pytest.raises(DataError, match=where):
        run(str(models / "outer.yaml"), {"points": none})
    (models / "outer.yaml").write_text(OUTER.replace("cell: 4", "cell: -4"), "utf-8")
    with pytest.raises(ParameterError, match=r"sub.cell: must be > 0 m, got -4"):
        catalog.load(str(models / "outer.yaml"))
    (models / "inner.yaml").write_text(INNER.replace("surface.grid", "surface.gird"), "utf-8")
    with pytest.raises(ParameterError, match=r"sub.tool") as error:
        catalog.load(str(models / "outer.yaml"))
    assert "grid.tool: no tool called 'surface.gird'; did you mean" in str(error.value)


@pytest.mark.parametrize("name", ["outer.yaml", "./outer.yaml", "../{folder}/outer.yaml"])
def test_models_that_run_each_other(models: Path, name: str) -> None:
    name = name.format(folder=models.name)
    (models / "inner.yaml").write_text(INNER.replace("surface.grid", name), "utf-8")
    with pytest.raises(ParameterError, match="run each other: outer -> inner -> outer"):
        catalog.load(str(models / "outer.yaml"))


def test_a_model_by_its_id(models: Path) -> None:
    text = OUTER.replace("inner.yaml", "models.terrain").replace("sub.mean", "sub.dtm")
    (models / "outer.yaml").write_text(text, "utf-8")
    outer = catalog.load(str(models / "outer.yaml"))
    assert outer.halo({}) == catalog.load("models.terrain").halo({"cell": 4.0})


# Running one from files


def test_only_what_is_asked_for_is_written(models: Path, classified: PointCloud) -> None:
    source = models / "c.laz"
    classified.save(source)
    before = set(models.iterdir())
    result = run(
        str(models / "outer.yaml"),
        {"points": source, "clean.kept": models / "kept.laz", "raster": models / "r.tif"},
    )
    assert {p.name for p in set(models.iterdir()) - before} == {"kept.laz", "r.tif"}
    assert len(PointCloud.open(result["clean.kept"])) == 100
    with pytest.raises(ParameterError, match=r"clean.kpt: unknown parameter"):
        run(str(models / "outer.yaml"), {"points": source, "clean.kpt": "a.laz"})


def test_shipped_models_have_the_id_of_their_file() -> None:
    paths = {id: p for id, p in catalog.own_files().items() if p.suffix in catalog.MODEL}
    assert "models.terrain" in paths
    for id in paths:
        assert catalog.load(id).id == id


def nodes(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The places of all values in a document."""
    for key, item in value.items() if isinstance(value, dict) else ():
        yield (*place, key)
        yield from nodes(item, (*place, key))


ODD = [None, 3, -1.5, "x", True, [], [[]], {}, {"from": 1}, {"from": "a.b"}, {"from": ["a.b", 2]}]
ODD += [{"x": {"y": 1}}, [{"from": "a.top"}], ["a", None], {"from": []}, {"from": {}}, 10**400]


@pytest.mark.parametrize("odd", ODD, ids=lambda value: str(value)[:20])
def test_any_value_anywhere_is_fine_or_a_clear_error(load: Load, odd: Any) -> None:
    inputs = "by: {type: number, unit: m, default: 3, gt: 0, help: How far}\n"
    inputs += "word: {type: choice, choices: [no, yes], default: yes, help: A word}\n"
    inputs += "what: {type: attribute, of: points, default: z, help: A name}\n" + FLAG
    steps = f"a: {SHIFT}, by: {{from: inputs.by}}, word: {{from: inputs.word}}}}\n"
    steps += (
        "b: {tool: toy.shift, points: {from: [a.moved, inputs.points]}, repeat: by, by: [1, 2]}\n"
    )
    steps += "c: {tool: toy.join, points: {from: b.moved}, when: {from: inputs.flag}, classes: 2}"
    text = chain(steps, "n: {from: c.count}\n  m: {from: [a.top], help: x}", inputs)
    whole = model_reader.documents.mapping(text)
    places = list(nodes(whole))
    assert len(places) > 50
    for place in places:
        changed = copy.deepcopy(whole)
        at = changed
        for key in place[:-1]:
            at = at[key]
        at[place[-1]] = odd
        try:
            made = load(json.dumps(changed))
        except ParameterError as err:
            longest = max(map(len, str(err).splitlines()))
        else:
            made.halo({})
            longest = len(made.title)
        assert longest < 500


def test_inputs_have_the_labels_of_the_parameters_that_they_feed(load: Load) -> None:
    steps = f"a: {SHIFT}, by: {{from: inputs.by}}, least: {{from: inputs.low}}}}"
    number = "{type: number, unit: m, default: 1.0, help: How far"
    inputs = f"by: {number}}}\nlow: {number}, label: Lower limit}}"
    out = "moved: {from: a.moved, label: Points at last}"
    made = load("tags: [dtm, forest]\nsummary: Move points.\n" + chain(steps, out, inputs))
    assert made.inputs["by"].title == "Metres upwards"
    assert made.inputs["low"].title == "Lower limit"
    assert made.outputs["moved"].title == "Points at last"
    assert (made.summary, made.tags) == ("Move points", ("dtm", "forest"))
    assert made.text.startswith("Move points.\n\n")
    found = problems(load, "tags: dtm\n" + chain(steps, out, inputs))
    assert found == {"tags": "must be a list of words, got 'dtm'"}


def test_defaults_in_feet_are_those_of_models_in_models_too(
    load: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The inner model had taken its default in metres."""
    by = "  by: {type: number, default: 1.0, feet: 6, unit: m, help: How far}\n"
    step = f"steps: {{a: {SHIFT}, by: {{from: inputs.by}}}}}}\n"
    made = "outputs: {moved: {from: a.moved, help: Moved}}\n"
    inner = load(HEAD.replace("my.test", "my.inner") + by + step + made)
    monkeypatch.setitem(TOYS, "my.inner", inner)
    outer = load(f"{HEAD}steps: {{a: {SHIFT.replace('toy.shift', 'my.inner')}}}}}\n{made}")
    for crs, moved in ((2263, 6.0), (32635, 1.0)):
        points = PointCloud(np.array([[0.0, 0, 5]]), crs=CRS(crs))
        assert outer.build({"points": points}).run().moved.xyz[0, 2] == pytest.approx(5 + moved)
    assert outer.halo({}) == pytest.approx(6 * 1200 / 3937), "whichever is the farther"
    assert inner.halo({"by": 0.5}) == 0.5
