"""The numbers by which power lines are found: all in one place, and each of them explained."""

from __future__ import annotations

import ast
from dataclasses import fields
from pathlib import Path

import pytest

from algorithms.corridor import extract
from algorithms.corridor._settings import SETTINGS, changed, names

MOST = 169  # numbers; raise it with a reason alone
CODE = Path(extract.__file__).parent
# Nothing but time, memory or how fine something is drawn hangs on these, or they are definitions.
ELSEWHERE = {
    "CELLS_AROUND",
    "CHORD_ERROR",
    "COARSE",
    "COVARIANCES",
    "DOUBTFUL",
    "EXPONENTS",
    "FINE",
    "FINER",
    "FIT_ROUNDS",
    "GROUND_CELL",
    "LEAST_CURVATURE",
    "LINE_CLASSES",
    "MOST_CURVATURE",
    "MOST_EXTENSIONS",
    "MOST_POINTS",
    "MOST_POINTS_OF_WIRE",
    "MOST_TRACK_BINS",
    "MOST_WIRES",
    "NEAR",
    "NORMAL_LEVEL",
    "OTHER",
    "PLAN_CELL",
    "POSITIONS_PER_BIN",
    "RIDGE",
    "SECTION_BIN",
    "SLOTS",
    "STEM_CELLS",
    "STEP",
    "TINY",
    "TOWER",
    "TRACK_BIN",
    "TUKEY_CUT",
    "WIRE",
}


def test_there_are_not_more_numbers_than_were_needed() -> None:
    count = 0
    for name in names():
        group, one = name.split(".")
        value = getattr(getattr(SETTINGS, group), one)
        count += len(value) if isinstance(value, tuple) else 1
    assert count <= MOST


def test_each_number_has_a_unit_a_meaning_and_a_source() -> None:
    for group in fields(SETTINGS):
        for one in fields(getattr(SETTINGS, group.name)):
            assert all(one.metadata[key] for key in ("unit", "meaning", "source")), one.name


def test_numbers_of_the_extraction_stand_in_the_settings() -> None:
    """A constant beside the code is one of those on which no result hangs."""
    found = set()
    for path in [*CODE.glob("_curves/*.py"), *CODE.glob("_extraction/*.py"), CODE / "extract.py"]:
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.Assign) and any(
                isinstance(part, ast.Constant) and type(part.value) in (int, float)
                for part in ast.walk(node.value)
            ):
                named = [part for target in node.targets for part in ast.walk(target)]
                found |= {part.id for part in named if isinstance(part, ast.Name)}
    fields_of_arrays = {name for name in found if name.startswith(("CURVE_", "FIT_"))}
    assert found - fields_of_arrays | {"FIT_ROUNDS"} == ELSEWHERE


def test_a_number_is_changed_for_a_while() -> None:
    before = SETTINGS.arcs.cut_price
    with changed("arcs.cut_price", 2 * before):
        assert SETTINGS.arcs.cut_price == 2 * before
    assert SETTINGS.arcs.cut_price == before
    with pytest.raises(TypeError), changed("arcs.no_such", 1):
        pass
