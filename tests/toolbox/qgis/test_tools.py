"""What the list of tools tells the dialogs of QGIS."""

from __future__ import annotations

import re

import pytest

from toolbox import catalog, language
from toolbox.qgis.tools import listing, tool


@pytest.mark.parametrize(
    ("word", "id"),
    [
        ("checkpoint", "compare.surfaces"),
        ("contour", "models.terrain"),  # a file of the set that it hands over
        ("outlines", "classify.buildings"),
    ],
)
def test_tools_are_found_by_their_layers(word: str, id: str) -> None:
    assert any(word in tag for tag in tool(catalog.load(id))["tags"])


def test_help_speaks_the_language_of_the_dialog() -> None:
    made = tool(catalog.load("classify.buildings"))["help"]
    assert "at least <i>Lowest roof</i> above it" in made
    for entry in listing()["tools"]:
        names = {f["name"] for f in entry["inputs"] + entry["outputs"]}
        told = set(re.findall(r"<code>([a-z_]+)</code>", entry["help"]))
        assert not told & names, entry["id"]
        assert "--deliver" not in entry["help"], entry["id"]


def test_the_first_result_that_every_qgis_shows_is_written() -> None:
    def first(id: str) -> list[str]:
        return [o["name"] for o in tool(catalog.load(id))["outputs"] if o.get("first")]

    assert first("classify.buildings") == ["classified", "outlines"]
    assert first("points.filter") == ["kept"]
    assert first("surface.contours") == ["contours"]


@pytest.mark.parametrize("id", ["models.urban_classes", "models.terrain", "models.facade"])
def test_layers_of_a_set_look_like_the_same_results_alone(id: str) -> None:
    """Water, crowns and buildings of a town in a folder were all drawn in one blue."""
    looks = {"classes", "colour", "isolines", "texts"}
    outputs = {o["name"]: o for o in tool(catalog.load(id))["outputs"]}
    layers = [layer for layer in outputs["deliver"]["layers"] if layer["name"]]
    assert layers
    for layer in layers:
        alone = outputs[layer["name"]]
        assert {k: layer.get(k) for k in looks} == {k: alone.get(k) for k in looks}


def test_what_an_input_is_needed_for_is_told() -> None:
    """QGIS asks for all results of a model, and would warn of those that nobody can expect."""

    def made_if(id: str) -> dict[str, object]:
        outputs = tool(catalog.load(id))["outputs"]
        return {o["name"]: o["made_if"] for o in outputs if "made_if" in o}

    assert made_if("models.terrain")["water_bodies"] == [{"input": "level_water", "is": None}]
    assert "dtm" not in made_if("models.terrain")
    vertices = made_if("models.reservoir_shoreline")["vertices"]
    assert vertices == [{"input": "preset", "is": "default"}]


def test_rules_are_in_the_language_of_the_dialog() -> None:
    with language.speaking("tr"):
        town = tool(catalog.load("models.urban_classes"))
    assert " ve " in next(f["rule"] for f in town["inputs"] if f["name"] == "min_height")
    assert not [f["name"] for f in town["inputs"] if " and " in f.get("rule", "")]
    assert not re.findall(r"[<>]=? [\d.]+ and ", town["help"])


def test_help_tells_of_every_box_and_result() -> None:
    for entry in listing()["tools"]:
        for one in [*entry["inputs"], *entry["outputs"]]:
            assert f"<p><b>{one['label']}</b>: " in entry["help"], (entry["id"], one["name"])


def test_columns_have_headings_units_and_digits_as_files_hold_them() -> None:
    outlines = next(
        o for o in tool(catalog.load("classify.buildings"))["outputs"] if o["name"] == "outlines"
    )
    assert outlines["columns"]["area"] == ["Area", "unit²", 1]
    objects = next(
        o for o in tool(catalog.load("corridor.clearance"))["outputs"] if o["name"] == "objects"
    )
    told = objects["columns"]["probability"]
    assert told == ["Probability that the rule is broken", "", 2], "a share of 1, not percent"


def test_a_box_at_its_default_is_said_to_be_another_length_for_data_in_feet() -> None:
    """Of a typed 1 m, which is the default, nobody said that cells become 3 ft wide."""
    (cell,) = [f for f in tool(catalog.load("models.terrain"))["inputs"] if f["name"] == "cell"]
    assert cell["help"].endswith("; 3 ft for data in feet while the box has its default")
    with language.speaking("tr"):
        (cell,) = [f for f in tool(catalog.load("models.terrain"))["inputs"] if f["name"] == "cell"]
    assert cell["help"].endswith("feet birimindeki veride 3 ft")
