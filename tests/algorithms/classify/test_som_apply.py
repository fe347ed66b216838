"""classify.som_apply: saved maps, maps named by hand, tables that are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from algorithms.classify.som import ClassifySom
from algorithms.classify.som_apply import ClassifySomApply
from tests.scenes.parks import accuracy, park
from toolbox.data import Table
from toolbox.errors import DataError, NothingToDo


def test_a_saved_map_classifies_as_the_one_that_was_trained(
    trained: ClassifySom.Outputs, tmp_path: Path
) -> None:
    for suffix in (".csv", ".json"):
        trained.map.save(tmp_path / f"map{suffix}")
        table = Table.open(tmp_path / f"map{suffix}")
        out = ClassifySomApply(points=park(), map=table).run()
        for name in ("classification", "neuron", "neuron_distance"):
            np.testing.assert_array_equal(out.classified[name], trained.classified[name])
    elsewhere = ClassifySomApply(points=park(seed=5, shift=3000.0), map=trained.map).run()
    assert accuracy(elsewhere.classified) > 0.96


def test_a_map_can_be_named_by_hand(trained: ClassifySom.Outputs) -> None:
    frame = trained.map.frame
    frame["class"] = frame["class"].replace(6, 17)
    out = ClassifySomApply(points=park(), map=Table(frame)).run()
    np.testing.assert_array_equal(
        out.classified["classification"] == 17, trained.classified["classification"] == 6
    )


def test_points_of_which_none_can_be_ground(trained: ClassifySom.Outputs) -> None:
    """Nothing tells heights above ground; a tile of a survey may be like that, and goes on."""
    cloud = park(300)
    first = np.full(300, 2, np.uint8)
    cloud = cloud.with_attributes({"number_of_returns": first, "return_number": first - 1})
    with pytest.raises(NothingToDo, match="none has all the features") as caught:
        ClassifySomApply(points=cloud, map=trained.map).run()
    instead = caught.value.instead
    assert (instead.classified["classification"] == 1).all()
    assert instead.unclassified == 300
    with pytest.raises(DataError, match="none has all the features"):
        ClassifySom(points=cloud).run()


def test_tables_that_are_no_maps(trained: ClassifySom.Outputs) -> None:
    frame = trained.map.frame
    for table, text in [
        (Table(frame.drop(columns="class")), "no column class"),
        (Table(frame.drop(columns="ground_low")), "no column ground_low"),
        (Table(frame[["neuron"]]), "no column"),
        (Table(frame.iloc[:0]), "has no rows"),
        (Table(frame.assign(parent=77)), "parents that are no neurons"),
        (Table(frame.assign(parent=[0, *[None] * (len(frame) - 1)])), "parents that are no neur"),
        (Table(frame.assign(**{"class": 300})), "numbers from 0 to 255 as class, got 300"),
        (Table(frame.assign(**{"class": 2.5})), "numbers from 0 to 255 as class, got 2.5"),
        (Table(frame.assign(**{"class": "roof"})), "cells that are no numbers"),
        (Table(frame.iloc[::-1]), "must have all its rows, in the order"),
        (Table(frame.assign(context=np.arange(len(frame)))), "the same context in all rows"),
        (Table(frame.assign(radius=0.0)), "must have a radius above 0"),
        (
            Table(frame.assign(ground_weight=-1.0)),
            "must have a weight above 0, and a range, for gr",
        ),
    ]:
        with pytest.raises(DataError, match=text):
            ClassifySomApply(points=park(50), map=table)
