"""The dict that a run gives: what it shows, and that it is a dict."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from affine import Affine
from pyproj import CRS

import toolbox
from toolbox import catalog
from toolbox.data import PointCloud, Raster
from toolbox.declare.values import Share
from toolbox.errors import ToolboxError, UnknownResult
from toolbox.runs.results import Results

CELLS = Raster(np.zeros((3, 2)), Affine(1, 0, 0, 0, -1, 3))
VALUES: dict[str, Any] = {
    "surface": CELLS,
    "file": Path("out/a.tif"),
    "level": 12.5,
    "area": 8529.4,
    "water_share": Share(1, 4),
    "count": 3,
    "flat": True,
    "missing": None,
    "levels": (1.0, 2.0, 3.0, 4.0),
    "said": "word " * 40,
    "ground.kept": 7,
}
RESULTS = Results(
    VALUES,
    tool="a.b",
    units={"level": "m", "levels": "m", "area": "m2", "water_share": "1"},
    help={"level": "Height of <water>"},
)


def test_each_result_is_shown_in_one_line_with_its_unit() -> None:
    said = "  said: " + "word " * 15 + "..."
    assert repr(RESULTS).splitlines() == [
        "<Results of a.b>",
        "  surface: <Raster in memory: 3 rows, 2 columns, cell 1>",
        f"  file: {Path('out/a.tif')}",
        "  level: 12.500 m",
        "  area: 8529 m²",
        "  water_share: 0.25",
        "  count: 3",
        "  flat: yes",
        "  missing: none",
        "  levels: 1.000 m, 2.000 m, 3.000 m, and 1 more",
        said,
        "  ground.kept: 7",
    ]


def test_a_notebook_shows_a_table_with_what_each_result_is() -> None:
    html = RESULTS._repr_html_()
    assert html.startswith("<table><caption>a.b</caption><tr><th>surface</th>")
    assert "<tr><th>level</th><td>12.500 m</td><td>Height of &lt;water&gt;</td></tr>" in html
    assert f"<td>{escape(repr(CELLS))}</td>" in html


def test_results_are_attributes_but_cannot_be_set_so() -> None:
    assert RESULTS.surface is CELLS
    assert {"surface", "level", "items"} <= set(dir(RESULTS))
    assert "ground.kept" not in dir(RESULTS)
    with pytest.raises(AttributeError):
        RESULTS.level = 3.0  # type: ignore[misc]


@pytest.mark.parametrize("get", [lambda r: r["levl"], lambda r: r.levl])
@pytest.mark.parametrize("kind", [KeyError, AttributeError, ToolboxError])
def test_an_unknown_result_names_all_and_the_nearest(
    get: Callable[[Results], Any], kind: type[Exception]
) -> None:
    with pytest.raises(kind) as caught:
        get(RESULTS)
    assert isinstance(caught.value, UnknownResult)
    text = f"a.b has no result 'levl', only {', '.join(VALUES)}; did you mean 'level'?"
    assert str(caught.value) == text
    assert not hasattr(RESULTS, "levl")
    assert RESULTS.get("levl") is None


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda r: pickle.loads(pickle.dumps(r))]
)
def test_copies_are_the_same(again: Callable[[Results], Results]) -> None:
    small = Results({"level": 1.5}, tool="a.b", units={"level": "m"}, help={"level": "Height"})
    made = again(small)
    assert (type(made), made) == (Results, {"level": 1.5})
    assert made._repr_html_() == small._repr_html_()


def test_it_is_a_dict() -> None:
    plain = {name: VALUES[name] for name in ("level", "water_share", "count")}
    made = Results(plain, tool="a.b")
    assert isinstance(made, dict)
    assert made == plain
    assert (
        json.dumps(made) == json.dumps(plain) == '{"level": 12.5, "water_share": 0.25, "count": 3}'
    )
    assert made | {"level": 1} == plain | {"level": 1}


def test_a_run_knows_units_and_help_of_its_results(tmp_path: Path) -> None:
    points = PointCloud(np.random.default_rng(1).uniform(0, 20, (500, 3)), crs=CRS(32635))
    made = toolbox.run("surface.grid", {"points": points, "surface": tmp_path / "a.tif"})
    assert made.surface == tmp_path / "a.tif"
    assert catalog.load("surface.grid").outputs["surface"].help in made._repr_html_()
    info = toolbox.run("points.survey_quality", {"points": points})
    assert any(line.endswith((" 1/m²", " m")) for line in repr(info).splitlines())
