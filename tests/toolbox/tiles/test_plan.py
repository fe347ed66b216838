"""Which steps run together on a tile, and what its surroundings are then."""

from __future__ import annotations

import functools
import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scenes.layers import cloud

import toolbox
from toolbox import PointCloud, Raster, catalog
from toolbox.declare import Memory
from toolbox.models.model import Model
from toolbox.tiles.plan import APART, TilePlan
from toolbox.tiles.tiling import Tiling
from toolbox.tiles.work import _needs


def plan(id: str, *targets: str, **settings: object) -> TilePlan:
    spec = catalog.load(id)
    assert isinstance(spec, Model)
    defaults = {name: field.default for name, field in spec.inputs.items() if not field.required}
    return TilePlan.of(spec, defaults | settings, targets)


def test_steps_that_look_far_run_in_passes_of_their_own() -> None:
    names = ("classified", "dtm", "dsm", "ndsm", "intensity")
    found = plan("models.terrain", *names).passes
    grids = ("top", "bottom", "heights", "brightness")
    assert [one.local for one in found] == [("clean",), ("ground",), grids]
    # 80 m, 240 m and twice max_gap, not their sum; and half a cell to the highest point
    assert [one.halo for one in found] == pytest.approx([80, 240, 50.5], abs=0.01)
    # No raster waits for another pass, where all of its cells would have to be in memory.
    assert not any(name.endswith(".surface") for one in found[:2] for name in one.keep)


def test_rasters_made_of_a_whole_raster_are_made_of_the_whole() -> None:
    """The planner went round for ever: terrain waits for the pass of what needs level water."""
    found = plan("models.terrain", "dtm", "dsm", "ndsm", level_water=True).passes
    grids = ("top", "bottom", "support")
    assert [one.local for one in found][:3] == [("clean",), ("ground",), grids]
    assert found[2].rest[-2:] == ("level", "heights")


ABOVE_WATER = """
id: my.heights
title: Points above a terrain with level water
inputs: {points: {type: PointCloud, help: Points}, lakes: {type: Vector, help: Water}}
steps:
  bare: {tool: surface.grid, points: {from: inputs.points}, max_gap: 1}
  level: {tool: surface.flatten_water, terrain: {from: bare.surface}, water: {from: inputs.lakes}}
  high:
    tool: points.sample_raster
    points: {from: inputs.points}
    raster: {from: [level.flattened, bare.surface]}
outputs:
  heights: {from: high.sampled}
"""


def test_what_a_whole_raster_is_made_of_does_not_wait_for_what_uses_it(tmp_path: Path) -> None:
    path = tmp_path / "heights.yaml"
    path.write_text(ABOVE_WATER)
    found = plan(str(path), "heights").passes
    assert [(one.local, one.rest) for one in found] == [(("bare",), ("level",)), (("high",), ())]


def test_what_nobody_needs_any_more_is_known() -> None:
    rasters = plan("models.terrain", "dtm")
    assert [set(rasters.spent(number)) for number in range(3)] == [
        set(),
        {"clean.clean"},
        {"clean.clean", "ground.classified", "ground.ground"},
    ]
    assert "ground.classified" not in plan("models.terrain", "classified", "dtm").spent(2)


def test_what_stands_in_for_a_result_is_not_read() -> None:
    """The ground takes the points of the survey only where no clean ones are."""
    job: Any = SimpleNamespace(model=catalog.load("models.terrain"), steps=("ground",))
    raw = "inputs.points"
    assert raw not in _needs(job, {"clean.clean": PointCloud([[0, 0, 0]])})
    assert raw in _needs(job, {"clean.clean": None})
    assert raw in _needs(job, {})


CHAIN = """
id: my.chain
title: Two steps
inputs: {{points: {{type: PointCloud, help: Points}}}}
steps:
  clean: {{tool: points.denoise, points: {{from: inputs.points}}, reach: {reach}}}
  low: {{tool: points.filter, points: {{from: clean.clean}}, where: z > -100}}
  top: {{tool: surface.grid, points: {{from: {points}}}, max_gap: {gap}}}
outputs:
  clean: {{from: clean.clean}}
  dtm: {{from: top.surface}}
"""


@pytest.mark.parametrize(
    ("reach", "gap", "passes"),
    [
        (APART / 4, APART / 2, [("clean", "low"), ("top",)]),
        (APART / 4 - 0.1, APART / 2, [("clean", "low", "top")]),
        (APART / 4, APART / 2 - 0.1, [("clean", "low", "top")]),
    ],
)
def test_passes_begin_where_both_steps_look_far(
    reach: float, gap: float, passes: list[tuple[str, ...]], tmp_path: Path
) -> None:
    path = tmp_path / "chain.yaml"
    path.write_text(CHAIN.format(reach=reach, gap=gap, points="low.kept"))
    assert [one.local for one in plan(str(path), "dtm").passes] == passes


CELLS = """
id: my.cells
title: A raster that looks far, and what takes it
inputs: {points: {type: PointCloud, help: Points}}
steps:
  near: {tool: surface.grid, points: {from: inputs.points}, max_gap: 30}
  clean: {tool: points.denoise, points: {from: inputs.points}, reach: 20}
  again:
    tool: surface.grid
    points: {from: clean.clean}
    max_gap: 30
    template: {from: near.surface}
outputs:
  dtm: {from: again.surface}
"""


def test_a_raster_that_looks_far_stays_with_those_that_take_it(tmp_path: Path) -> None:
    path = tmp_path / "cells.yaml"
    path.write_text(CELLS)
    (one,) = plan(str(path), "dtm").passes
    assert one.local == ("near", "clean", "again")
    assert one.halo == pytest.approx(80 + 60, abs=0.01)


@pytest.mark.slow
def test_points_that_las_would_round_are_not_rounded_between_passes(
    tmp_path: Path,
) -> None:
    """A text file keeps digits that LAS loses; the raster must be that of the whole."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 120, (2, 6000))
    z = 0.05 * x + rng.uniform(0, 1e-4, 6000)
    xyz = np.column_stack([x + 500_000, y + 4_600_000, z])
    source = tmp_path / "a.txt"
    np.savetxt(source, xyz, fmt="%.9f")
    chain = tmp_path / "chain.yaml"
    chain.write_text(CHAIN.format(reach=APART / 4, gap=APART / 2, points="clean.clean"))
    run = functools.partial(toolbox.run, str(chain), assume_crs="EPSG:32635")
    whole = run({"points": source})
    paths = {"clean": tmp_path / "b.laz", "dtm": tmp_path / "b.tif"}
    run({"points": source, **paths}, tiling=Tiling(60.0, workers=1))
    assert not np.array_equal(PointCloud.open(paths["clean"]).xyz, whole["clean"].xyz)
    np.testing.assert_array_equal(Raster.open(paths["dtm"]).values, whole["dtm"].values)


def test_tiles_are_as_large_as_each_pass_allows() -> None:
    """The ground looks farthest, the rasters need most: both at once would be a smaller tile."""
    found = plan("models.terrain", "dtm", "dsm")
    kilometre = 1e6 * (200 * 8 + 100)  # bytes for the ground of eight points per m2
    assert found.side(8.0, kilometre) == pytest.approx(1000 - 2 * 240, abs=0.01)
    town = plan("models.urban_classes", "classified")  # most of its steps declare nothing
    assert town.side(8.0, kilometre) < 520
    assert catalog.load("models.urban_classes").memory == Memory() == Memory(400.0, 200.0)
    assert found.side(0.1, kilometre) < found.side(0.01, kilometre) < 10_000  # by cells, not points


NEED = """
import json, resource, sys, threading, time
import psutil
import toolbox
from toolbox import catalog
from toolbox.allocation import keep_memory

keep_memory()
id, small, large, values = json.loads(sys.argv[1])
catalog.load(id).build({"points": toolbox.PointCloud.open(small), **values}).run()
info, most, done = psutil.Process().memory_info, [0], threading.Event()

def used():
    return info().rss - info().shared

def look():
    while not done.wait(0.01):
        most[0] = max(most[0], used())

before = used()
threading.Thread(target=look, daemon=True).start()
catalog.load(id).build({"points": toolbox.PointCloud.open(large), **values}).run()
done.set()
print(most[0] - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="what is mapped is told apart there only")
@pytest.mark.parametrize(
    ("id", "values"),
    [
        ("points.denoise", {}),
        ("ground.classify", {}),
        ("surface.grid", {"method": "linear", "max_gap": 25.0}),
    ],
)
def test_tools_need_no_more_memory_than_they_declare(
    id: str, values: dict[str, Any], tmp_path: Path
) -> None:
    rng, side, density = np.random.default_rng(1), 400.0, 4
    for name, share in (("small.las", 0.01), ("large.las", 1.0)):
        xy = rng.uniform(0, side * share**0.5, (int(side**2 * density * share), 2))
        z = np.sin(xy[:, 0] / 30) * 5 + rng.exponential(2, len(xy)) * (rng.random(len(xy)) < 0.3)
        cloud(np.column_stack([xy, z])).save(tmp_path / name)
    task = json.dumps([id, str(tmp_path / "small.las"), str(tmp_path / "large.las"), values])
    command = [sys.executable, "-c", NEED, task]
    needed = int(subprocess.check_output(command, text=True, cwd=tmp_path))
    declared = catalog.load(id).memory
    assert 0.3 < needed / side**2 / declared.per_area(density) < 1
