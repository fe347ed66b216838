"""corridor.label: the line found among candidates is that of the whole cloud."""

from __future__ import annotations

import numpy as np
import pytest
from scenes.corridors import cloud, ground, line

import toolbox
from toolbox.data import PointCloud
from toolbox.errors import DataError

LABELS = ("classification", "wire_id", "span_id", "tower_id", "confidence")


@pytest.fixture(scope="module")
def scene() -> dict[str, PointCloud]:
    """Two spans with heights; a class of a line that is not true, and noise on a wire."""
    _, wires, poles = line([0, 60, 120], [-1, 1], 9, 300)
    points = cloud(ground(120, 50, 6), *wires, poles)
    classes = np.ones(len(points), np.uint8)
    classes[:50] = 14
    on_wire = np.flatnonzero(points.xyz[:, 2] > 107)[::20]
    classes[on_wire] = 7
    points = points.with_attributes({"classification": classes})
    settings = {"points": points, "ignore": "7", "heights": True, "keep_classes": "0-255"}
    whole = toolbox.run("ground.classify", settings)["classified"]
    few = toolbox.run("corridor.candidates", {"points": whole, "ignore": "7"})["candidates"]
    return {"whole": whole, "few": few, "noise": points.select(on_wire)}


def test_chosen_points_give_the_line_of_all(scene: dict[str, PointCloud]) -> None:
    whole = toolbox.run("corridor.extract", {"points": scene["whole"], "ignore": "7"})
    few = toolbox.run("corridor.extract", {"points": scene["few"], "ignore": "7"})
    assert len(scene["few"]) < 0.6 * len(scene["whole"])
    assert whole["span_count"] == few["span_count"] == 2
    assert whole["wires"].frame.equals(few["wires"].frame)
    assert whole["towers"].frame.equals(few["towers"].frame)
    line = few["classified"]
    line = line.select(line["wire_id"] + line["tower_id"] > 0)
    sources = {"points": scene["whole"], "line": line, "ignore": "7"}
    labels = toolbox.run("corridor.label", sources)["classified"]
    for name in LABELS:
        np.testing.assert_array_equal(labels[name], whole["classified"][name])
    assert (labels["classification"] == 14).sum() > 400
    assert not (labels["classification"][:50] == 14).any()
    assert (labels["classification"] == 7).sum() == len(scene["noise"])


def test_a_part_of_the_survey_gets_its_own_labels(scene: dict[str, PointCloud]) -> None:
    """A tile knows the places of its points in the survey; its neighbours count from -1 down."""
    few = toolbox.run("corridor.extract", {"points": scene["few"], "ignore": "7"})["classified"]
    sources = {"points": scene["whole"], "line": few, "ignore": "7"}
    labels = toolbox.run("corridor.label", sources)["classified"]
    chosen = np.flatnonzero(scene["whole"].xyz[:, 0] < 500_030)
    core = scene["whole"].xyz[chosen, 0] < 500_020
    tile = scene["whole"].select(chosen).with_origin(np.where(core, chosen, -1 - chosen))
    part = toolbox.run("corridor.label", sources | {"points": tile})["classified"]
    for name in LABELS:
        np.testing.assert_array_equal(part[name], labels[name][chosen])
    assert (part["wire_id"] > 0).any()


def test_classes_that_chosen_points_got_are_taken_over(scene: dict[str, PointCloud]) -> None:
    """But those of points that were not chosen stay, and a wire is a wire."""
    line = toolbox.run("corridor.extract", {"points": scene["few"], "ignore": "7"})["classified"]
    before = toolbox.run("corridor.label", {"points": scene["whole"], "line": line})["classified"]
    bush = np.flatnonzero(line["wire_id"] + line["tower_id"] == 0)[:30]
    classes = np.array(line["classification"])
    classes[bush] = 4
    line = line.with_attributes({"classification": classes})
    after = toolbox.run("corridor.label", {"points": scene["whole"], "line": line})["classified"]
    changed = np.flatnonzero(after["classification"] != before["classification"])
    assert changed.tolist() == line["point_number"][bush].tolist()
    assert (after["classification"][changed] == 4).all()


def test_points_of_another_cloud_are_refused(scene: dict[str, PointCloud]) -> None:
    few = toolbox.run("corridor.extract", {"points": scene["few"], "ignore": "7"})["classified"]
    moved = scene["whole"].with_xyz(scene["whole"].xyz + np.array([0, 0, 1]))
    with pytest.raises(DataError, match=r"was not chosen from line\.laz"):
        toolbox.run("corridor.label", {"points": moved, "line": few})
    with pytest.raises(DataError, match="no attribute point_number, wire_id"):
        toolbox.run("corridor.label", {"points": moved, "line": moved})


def test_no_label_is_lost_or_made_up(scene: dict[str, PointCloud]) -> None:
    found = toolbox.run("corridor.extract", {"points": scene["few"], "ignore": "7"})["classified"]
    line = found.select(found["wire_id"] + found["tower_id"] > 0)
    number, wire = np.array(line["point_number"]), np.array(line["wire_id"], float)
    twice = np.where(np.arange(len(line)) == 1, number[0], number)
    unknown, negative = wire.copy(), wire.copy()
    unknown[0], negative[0] = np.nan, -3
    for changed, message in (
        ({"point_number": number + len(scene["whole"])}, "was not chosen from"),
        ({"point_number": -1 - number}, "values of point_number that are not 0 or more"),
        ({"point_number": twice}, f"more than one point of point_number {number[0]}"),
        ({"wire_id": unknown}, "values of wire_id that are not 0 or more"),
        ({"wire_id": negative}, "values of wire_id that are not 0 or more"),
    ):
        sources = {"points": scene["whole"], "line": line.with_attributes(changed)}
        with pytest.raises(DataError, match=message):
            toolbox.run("corridor.label", sources)
    less = scene["whole"].select(np.arange(number[len(number) // 2]))
    tile = less.with_origin(np.arange(len(less)))
    for points, part in ((less, line), (tile, line.with_origin(np.arange(len(line))))):
        with pytest.raises(DataError, match="was not chosen from"):
            toolbox.run("corridor.label", {"points": points, "line": part})
