"""Declarations: what the vocabulary makes of a class, and what it refuses."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from typing import Any, Literal, cast

import numpy as np
import pytest
from pyproj import CRS

from toolbox import catalog
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Raster, Table, Vector
from toolbox.data.crs import LOCAL
from toolbox.declare import Attribute, ClassList, Expression, Range, show
from toolbox.declare.spec import REGISTRY, outputs, param, sink, source, tool
from toolbox.errors import Cancelled, DataError, ParameterError

XYZ = np.array([[0.0, 0, 0], [10, 0, 1], [0, 10, 2]])
METRES, FEET, DEGREES = CRS(32635), CRS(2263), CRS(4326)


@tool("toy.measure")
class ToyMeasure:
    """Return what it was given.

    A second line of help.
    """

    points: PointCloud = source("Points")
    other: PointCloud | None = source("More points", default=None)
    width: float = param("A length", default=2.0, unit="m", gt=0, le=100)
    gap: float | None = param("A length or nothing", default=None, unit="m", ge=0)
    band: Range | None = param("Two lengths", default=None, unit="m", ge=0)
    count: int = param("A number", default=3, unit="1", ge=1)
    strict: bool = param("A switch", default=False)
    level: Literal[1, 2, 3] = param("A level", default=2)
    mode: Literal["fast", "exact"] = param("A word", default="fast")
    classes: ClassList | None = param("Classes", default=None)
    column: Attribute | None = param("An attribute", default=None, of="points")
    where: Expression | None = param("A condition", default=None, of="points")
    steps: tuple[float, ...] = param("Several lengths", default=(1.0, 2.0), unit="m", gt=0)
    tolerance: float | Literal["auto"] = param("Length or word", default="auto", unit="m", gt=0)
    stiffness: Literal[1, 2, "auto"] = param("Number or word", default=1)
    word: Literal["none", "some"] | None = param("An optional word", default=None)
    features: tuple[Attribute, ...] = param("Attributes", default=(), of="points")

    @outputs
    class Outputs:
        inside: float = sink("Width as the array function sees it", unit="1")
        width_out: float = sink("Width as the user sees it", unit="m")
        area: float = sink("Width squared", unit="m2")
        density: float = sink("One point on that area", unit="1/m2")

    def check(self) -> Iterator[tuple[str, str]]:
        """A rule between parameters."""
        if self.gap is not None and self.gap > self.width:
            yield "gap", f"must be <= width ({self.width:g} m), got {self.gap:g}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """A rule between a parameter and a layer."""
        if self.count > len(self.points):
            yield "points", f"need {self.count}, got {len(self.points)}"

    def halo(self) -> float:
        return self.width

    def run(self, ctx: Context = QUIET) -> ToyMeasure.Outputs:
        """Give the width back."""
        w = self.width
        return self.Outputs(inside=w, width_out=w, area=w * w, density=1 / (w * w))


SPEC = REGISTRY.pop("toy.measure")  # the laws of test_every_tool are for real tools


def cloud(crs: CRS | None = METRES, **columns: Any) -> PointCloud:
    return PointCloud(XYZ, columns, crs=crs, name="a.laz")


def test_all_problems_at_once_with_the_nearest_names() -> None:
    with pytest.raises(ParameterError) as caught:
        SPEC.build({"points": cloud(), "widht": 1, "mode": "exakt"})
    assert caught.value.problems == {"widht": "unknown parameter; did you mean 'width'?"}
    with pytest.raises(ParameterError) as caught:
        ToyMeasure(points=cloud(), width=-1.0, count=0, mode="exakt")  # type: ignore[arg-type]
    assert caught.value.problems == {
        "width": "must be > 0 and <= 100 m, got -1.0",
        "count": "must be >= 1, got 0",
        "mode": "must be one of fast, exact, got 'exakt'; did you mean 'exact'?",
    }


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("width", True),
        ("width", float("nan")),
        ("width", float("inf")),
        ("count", True),
        ("level", 4),
        ("points", "a.laz"),
        ("points", None),
        ("band", Range(-1, 2)),
    ],
)
def test_wrong_values_are_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(ParameterError, match=rf"{name}: must be"):
        SPEC.build({"points": cloud()} | {name: value})


def test_what_is_no_text_is_refused_without_a_colon_at_the_end() -> None:
    with pytest.raises(ParameterError) as caught:
        SPEC.build({"points": cloud(), "column": 5, "where": 5, "classes": b"2"})
    assert caught.value.problems == {
        "column": "must be an attribute, got 5",
        "where": "must be an expression, got 5",
        "classes": "must be a class list, got b'2': b'2' is no whole number",
    }


def test_numpy_numbers_are_numbers() -> None:
    job = ToyMeasure(points=cloud(), width=np.float32(2), count=np.int64(3))  # type: ignore[arg-type]
    assert job.run().inside == 2


def test_a_class_takes_plain_values_of_python() -> None:
    plain = {"classes": (9, 2), "column": "intensity", "where": "a > 1", "band": (0, 0.2)}
    job = SPEC.build(
        {"points": cloud(a=[2, 2, 2], intensity=[1, 1, 1]), "features": ["z"], **plain}
    )
    own = (ClassList([2, 9]), Attribute("intensity"), Expression("a > 1"), Range(0, 0.2))
    made = (job.classes, job.column, job.where, job.band, *job.features)
    assert made == (*own, Attribute("z"))
    assert [type(value) for value in made[:2]] == [ClassList, Attribute]


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("width", "2.5", 2.5),
        ("count", "4", 4),
        ("count", 4.0, 4),
        ("strict", "yes", True),
        ("strict", "0", False),
        ("level", "3", 3),
        ("gap", "none", None),
        ("gap", None, None),
        ("band", "0,0.2", Range(0, 0.2)),
        ("band", [0, 1], Range(0, 1)),
        ("classes", "2,4-6", ClassList([2, 4, 5, 6])),
        ("classes", [2, 9], ClassList([2, 9])),
        ("classes", 2, ClassList([2])),
        ("column", "intensity", Attribute("intensity")),
        ("where", "a > 1", Expression("a > 1")),
        ("steps", ["0.5", 2], (0.5, 2.0)),
        ("steps", "3", (3.0,)),
        ("tolerance", "auto", "auto"),
        ("tolerance", "0.5", 0.5),
        ("stiffness", "2", 2),
        ("stiffness", 2.0, 2),
        ("stiffness", "auto", "auto"),
        ("word", "none", "none"),
        ("word", None, None),
        ("features", ["z", "intensity"], (Attribute("z"), Attribute("intensity"))),
    ],
)
def test_texts_and_json_values_are_parsed(name: str, text: Any, value: Any) -> None:
    values, problems = SPEC.parse({name: text}, present=["points"])
    assert (values, problems) == ({name: value}, {})
    assert type(values[name]) is type(value)


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("width", "wide", "must be a number, got 'wide'"),
        ("width", "nan", "must be a number, got 'nan'"),
        ("width", None, "must be a number, got none"),
        ("count", "2.5", "must be an integer, got '2.5'"),
        ("strict", "perhaps", "must be a boolean, got 'perhaps'"),
        ("classes", "2,x", "must be a class list, got '2,x'"),
        ("where", "import os", "must be an expression"),
        ("tolerance", "much", "must be a number, got 'much'"),
        ("stiffness", "3", "must be one of 1, 2, auto, got '3'"),
        ("band", "3,1", "the lower limit 3 is above the upper limit 1"),
    ],
)
def test_texts_that_cannot_be_read(name: str, text: Any, why: str) -> None:
    _, problems = SPEC.parse({name: text}, present=["points"])
    assert why in problems[name]


def test_lengths_reach_the_tool_in_the_unit_of_the_data_and_come_back_in_metres() -> None:
    metres = ToyMeasure(points=cloud(METRES)).run()
    feet = ToyMeasure(points=cloud(FEET)).run()
    assert metres.inside == 2
    assert feet.inside == pytest.approx(2 / (1200 / 3937))
    assert feet.width_out == pytest.approx(2)
    assert feet.area == pytest.approx(4)
    assert feet.density == pytest.approx(0.25)


def test_lists_and_words_are_scaled_with_sense() -> None:
    field = SPEC.inputs["steps"]
    assert field.scaled((1.0, 2.0), 3.0) == (3.0, 6.0)
    assert SPEC.inputs["tolerance"].scaled("auto", 3.0) == "auto"
    assert SPEC.inputs["band"].scaled(Range(1, 2), 3.0) == Range(3, 6)


def test_limits_are_in_metres_whatever_the_data() -> None:
    assert ToyMeasure(points=cloud(FEET), width=100.0).run().width_out == pytest.approx(100)
    with pytest.raises(ParameterError, match="got 101"):
        ToyMeasure(points=cloud(FEET), width=101.0)


def test_halo_is_known_before_there_are_layers() -> None:
    assert SPEC.halo({}) == 2
    assert SPEC.halo({"width": 7.0}) == 7


def test_halo_is_in_metres() -> None:
    assert ToyMeasure(points=cloud(FEET), width=5.0).halo() == 5


@pytest.mark.parametrize(
    ("crs", "text"),
    [(None, "assume_crs"), (DEGREES, "degrees"), (CRS("EPSG:2263+5703"), "vertical")],
)
def test_lengths_without_meaning_are_refused(crs: CRS | None, text: str) -> None:
    with pytest.raises(DataError, match=text) as caught:
        ToyMeasure(points=cloud(crs))
    assert caught.value.problems.keys() == {"points"}
    assert "a.laz" in caught.value.problems["points"]


def test_local_coordinates_are_metres() -> None:
    assert ToyMeasure(points=cloud(LOCAL)).run().inside == 2


def test_different_crs_are_refused_by_both_names() -> None:
    with pytest.raises(DataError, match=r"EPSG:32636.*EPSG:32635"):
        ToyMeasure(points=cloud(), other=cloud(CRS(32636)))
    with pytest.raises(DataError, match=r"5773.*"):
        ToyMeasure(points=cloud(), other=cloud(CRS("EPSG:32635+5773")))


def test_unknown_attributes_are_refused_with_the_nearest_name() -> None:
    points = cloud(intensity=np.zeros(3, np.uint16))
    assert ToyMeasure(points=points, column=Attribute("intensity"), where=Expression("z > 1"))
    with pytest.raises(ParameterError, match="features: no attribute 'q'"):
        ToyMeasure(points=points, features=(Attribute("z"), Attribute("q")))
    with pytest.raises(ParameterError) as caught:
        ToyMeasure(points=points, column=Attribute("intensty"), where=Expression("q > 1"))
    assert caught.value.problems["column"].startswith("no attribute 'intensty'; did you mean")
    assert caught.value.problems["where"].startswith("no attribute 'q'; there are x, y, z")


def test_rules_between_parameters() -> None:
    with pytest.raises(ParameterError, match=r"gap: must be <= width \(2 m\), got 3"):
        ToyMeasure(points=cloud(), gap=3.0)


def test_rules_between_parameters_and_layers() -> None:
    with pytest.raises(DataError, match="points: need 9, got 3"):
        ToyMeasure(points=cloud(), count=9)


def test_build_names_the_step_of_a_model() -> None:
    with pytest.raises(ParameterError, match=r"step 'ground'.*\n.*width"):
        SPEC.build({"points": cloud(), "width": -1.0}, "models.a, step 'ground' (toy.measure)")


def test_errors_can_be_sent_to_other_processes() -> None:
    for error in (ParameterError("a", {"b": "c"}), DataError("text"), Cancelled()):
        copy = pickle.loads(pickle.dumps(error))
        assert (type(copy), str(copy)) == (type(error), str(error))


def test_a_job_is_frozen() -> None:
    with pytest.raises(AttributeError):
        ToyMeasure(points=cloud()).width = 3.0  # type: ignore[misc]


def declare(annotations: dict[str, Any], **members: Any) -> type:
    """A minimal tool with something added."""
    body: dict[str, Any] = {
        "__doc__": "Do something.\n\nIn some way.",
        "__annotations__": {"points": PointCloud} | annotations,
        "points": source("Points"),
        "Outputs": ToyMeasure.Outputs,
        "halo": lambda self: 0.0,
        "run": lambda self, ctx: None,
    }
    body = {name: value for name, value in (body | members).items() if value is not None}
    try:
        return tool("toy.wrong")(type(members.pop("__name__", "ToyWrong"), (), body))
    finally:
        REGISTRY.pop("toy.wrong", None)


def test_a_sound_declaration_is_accepted() -> None:
    assert declare({"a": float}, a=param("X", default=1.0, unit="m"))


@pytest.mark.parametrize(
    ("annotations", "members", "text"),
    [
        ({}, {"halo": None}, "needs halo"),
        ({"area": PointCloud}, {"area": source("Twice")}, "declared twice"),
        ({"a": float}, {"a": param("X", default=1.0, max=2)}, "limits are"),
        ({"a": Attribute}, {"a": param("X", default=None, of="dots")}, "no source called 'dots'"),
        ({"Bad": int}, {"Bad": param("X", default=1)}, "lower_case"),
        ({"a": complex}, {"a": param("X", default=1j)}, "cannot be declared"),
        ({"a": float | str}, {"a": param("X", default=1.0)}, "more than one type"),
        ({"a": PointCloud | Raster}, {"a": source("X")}, "more than one type"),
        ({"a": float}, {"a": param("X", default=1.0, unit="metres")}, "unit 'metres'"),
        ({"picture": float}, {"picture": param("X", default=1.0)}, "option of every run"),
        ({"a": float}, {"a": param("X", default=1.0)}, r"wrong\.a: a number has a unit"),
        ({"a": int | None}, {"a": param("X", default=None)}, r"wrong\.a: a number has a unit"),
        ({"a": bool}, {"a": param("Ends so.", default=True)}, "one sentence .* got 'Ends so.'"),
        ({"a": bool}, {"a": param("begins so", default=True)}, "one sentence"),
        ({"a": bool}, {"a": param("X" * 101, default=True)}, "at most 100 characters"),
        ({}, {"points": source("points")}, r"wrong\.points: help is one sentence"),
        ({}, {"__doc__": "Do something."}, "needs a text below its first line"),
        ({}, {"__doc__": "Do something.\n\nSo"}, "ends with a full stop"),
        ({}, {"__doc__": "Do *something*.\n\nSo."}, "without markup, got"),
        ({}, {"__doc__": ""}, "needs a sentence as first line"),
        ({}, {"__doc__": f"Do.\n\nSo{101 * ' '}."}, "a line of more than 100"),
        (
            {"a": bool},
            {"a": param("X", default=True, label="begins so")},
            "a label has a capital .* got 'begins so'",
        ),
        (
            {"a": Literal["b"]},
            {"a": param("X", default="b", words={"c": "See"})},
            "words for what is no choice: c",
        ),
        ({}, {"__name__": "Wrong"}, "is called Wrong, must be ToyWrong"),
        ({}, {"run": None}, r"needs run\(ctx\)"),
        ({}, {"Outputs": type("Outputs", (), {})}, "needs a class Outputs, with @outputs"),
        ({"a": float}, {"a": 1.0}, r"a: declare it with source\(\), param\(\)"),
        ({"a": float}, {"a": source("X")}, r"wrong\.a: a number is a param\(\)"),
        ({"a": Raster}, {"a": param("X", default=None)}, r"a Raster is a source\(\)"),
        ({"a": Raster | None}, {"a": source("X")}, "left out has the default None"),
        ({"a": bool}, {"a": param("X", default="no")}, "its default must be a boolean, got 'no'"),
        ({"a": bool}, {"a": param("X", default=None)}, "its default must be a boolean, got None"),
        (
            {"a": float},
            {"a": param("X", default=5.0, unit="m", le=3)},
            "its default must be <= 3 m, got 5.0",
        ),
    ],
)
def test_mistakes_of_authors_are_found_on_import(
    annotations: dict[str, Any], members: dict[str, Any], text: str
) -> None:
    with pytest.raises(TypeError, match=text):
        declare(annotations, **members)


def test_an_id_is_words_and_a_dot() -> None:
    with pytest.raises(TypeError, match="the id of a tool is missing"):
        tool(cast(Any, ToyMeasure))
    with pytest.raises(TypeError, match="lower_case words with a dot"):
        tool("Toy.Wrong")(type("ToyWrong", (ToyMeasure,), {"__doc__": ToyMeasure.__doc__}))


def test_names_for_people_are_stated_or_made_of_those_in_the_code() -> None:
    spec = ToyMeasure.spec  # type: ignore[attr-defined]
    assert spec.title == "Measure"
    assert spec.group == "Toy"
    assert spec.text.startswith(f"{spec.summary}.\n\n")
    mode = spec.inputs["mode"]
    assert (mode.title, mode.choice_title("fast")) == ("Mode", "Fast")
    assert declare({"a": str}, a=param("X", default="b", offers=("b", "c"))).spec.inputs[
        "a"
    ].offers == ("b", "c")
    said = {"label": "How carefully", "words": {"fast": "Quickly"}}
    stated = param("A word", default="fast", **said)
    made = declare({"manner": Literal["fast", "exact"]}, manner=stated).spec.inputs["manner"]
    assert (made.title, made.choice_title("fast")) == ("How carefully", "Quickly")
    assert made.schema()["title"] == "How carefully"
    assert {"role": "choice", "title": "fast", "value": "Quickly"} in made.schema()["metadata"]
    named = type("ToyNamed", (ToyMeasure,), {"__doc__": ToyMeasure.__doc__})
    with pytest.raises(TypeError, match="at most 30 characters, got 'Aaaa"):
        tool("toy.named", title="A" + 30 * "a")(named)


def declare_sink(kind: Any, way: Any) -> Any:
    body = {"__annotations__": {"found": kind}, "found": sink("What was found", show=way)}
    return declare({}, Outputs=outputs(type("Outputs", (), body)))


def test_outputs_say_how_they_are_shown() -> None:
    ways = show.Values("offset", centred=True), show.Profile("line", "along", "offset")
    assert declare_sink(Vector, ways).spec.outputs["found"].show == ways
    assert declare_sink(Vector, ways[0]).spec.outputs["found"].show == ways[:1]


@pytest.mark.parametrize(
    ("kind", "way", "text"),
    [
        (Table, show.Planes("plane"), "Planes shows a PointCloud, not a Table"),
        (PointCloud, show.Histogram("a", "b", "c"), "Histogram shows a Table, not a PointCloud"),
        (Raster, show.Classes("class"), "Classes shows a PointCloud or Vector, not a Raster"),
        (float, show.Values("error"), "not a number"),
        (Vector, show.Classes(""), "'' is no name of a column or attribute"),
        (Vector, show.Profile("line", cast(Any, 3), "c"), "3 is no name"),
        (Table, "a curve", "show is one of the words of toolbox.declare.show, got 'a curve'"),
    ],
)
def test_mistakes_in_how_outputs_are_shown_are_found_on_import(
    kind: Any, way: Any, text: str
) -> None:
    with pytest.raises(TypeError, match=text):
        declare_sink(kind, way)


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("2ft", 0.6096),
        ("2 FT", 0.6096),
        ("0.5m", 0.5),
        ("-1e1 cm", -0.1),
    ],
)
def test_a_length_may_have_its_unit(text: str, metres: float) -> None:
    field = catalog.load("surface.contours").inputs["base"]
    assert field.parse(text) == metres


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("base", "2 feet", r"got '2 feet'; a unit behind it is one of m, ft, us-ft, cm, mm, km$"),
        ("base", "0,5", r"got '0,5'; did you mean 0.5\?$"),
        ("base", "2ft2", "must be a number"),
        ("index_every", "2m", "must be an integer"),
    ],
)
def test_other_units_are_none(name: str, text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        catalog.load("surface.contours").inputs[name].parse(text)


def test_bands_and_areas_may_have_their_unit() -> None:
    band = catalog.load("points.filter").inputs["elevation_above_lowest"]
    assert band.parse("1,10ft") == (0.3048, 3.048)
    smallest = catalog.load("shoreline.extract").inputs["min_area"]
    assert smallest.parse("100 ft2") == pytest.approx(9.290304)
    with pytest.raises(ValueError, match="must be a number"):
        smallest.parse("100ft")


def test_feet_said_in_metres_are_feet_in_the_data() -> None:
    field = catalog.load("surface.contours").inputs["base"]
    for unit, metre in (("ft", 1 / 0.3048), ("us-ft", 3937 / 1200)):
        assert [field.scaled(field.parse(f"{n}{unit}"), metre) for n in (1, 3, 7)] == [1, 3, 7]
