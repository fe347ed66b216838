"""Tiles that hold nothing a tool can work on get what the whole gives there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS

import toolbox
from toolbox import PointCloud, catalog
from toolbox.tiles import engine
from toolbox.tiles.tiling import Tiling
from toolbox.tiles.workers import processes

GIB = 2**30
ALONE = {"return_number": 1, "number_of_returns": 1, "classification": 1, "withheld": 0}
FIRST = ALONE | {"number_of_returns": 2}
ISLANDS: list[tuple[list[tuple[float, float, float]], dict[str, int]]] = [  # in a lake, apart
    ([(50, 50, 3)], ALONE),
    ([(50, 50, 3), (52, 51, 3.1)], ALONE),
    ([(50, 50, 3), (60, 60, 3), (70, 70, 9)], ALONE),
    ([(50 + i, 50, 3) for i in range(6)], ALONE),
    ([(50 + i, 50 + i * i, 3) for i in range(7)], ALONE),
    ([(50 + i, 50 + i * i, 3) for i in range(5)], ALONE | {"withheld": 1}),
    ([(50 + i, 50 + i * i, 3) for i in range(5)], ALONE | {"classification": 7}),
    ([(50 + i, 50 + i * i, 3) for i in range(9)], FIRST),
    ([(50 + i, 50 + i * i, 3) for i in range(9)], FIRST | {"classification": 2}),
    ([(50 + i, 50 + i * i, 3) for i in range(9)], ALONE | {"number_of_returns": 0}),
]
MAP = "map.csv"  # beside the survey
RUNS: list[tuple[str, dict[str, Any]]] = [
    ("classify.som_apply", {"ignore": "7", "map": MAP}),
    ("features.local", {"radius": 5, "neighbours": 8}),
    ("features.local", {"radius": 3, "neighbours": None, "ignore": "7"}),
    ("ground.classify", {"ignore": "7"}),
    ("ground.csf", {"ignore": "7", "keep_classes": "0-255", "cloth_resolution": 1}),
    ("ground.ptd", {"ignore": "7"}),
    ("ground.robust_interpolation", {"ignore": "7", "keep_classes": "0-255"}),
    ("points.denoise", {"reach": 5}),
    ("points.denoise", {"ignore": "7", "action": "label", "height_gap": None}),
    ("points.filter", {"returns": "last"}),
    ("points.filter", {"where": "z < -100"}),
    ("points.filter_intensity", {"minimum": 400}),
    ("points.height_above_ground", {"method": "nearest", "max_distance": 20}),
]


@pytest.fixture(scope="module")
def tiling() -> Iterator[Tiling]:
    """Tiles of 100 m on two workers that all tests share."""
    with processes(2, 4 * GIB) as workers, pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "workers_of", lambda tiling: nullcontext(workers))
        yield Tiling(100.0, 2, 4 * GIB)


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A town, and a lake whose islands are a kilometre apart."""
    folder = tmp_path_factory.mktemp("survey")
    save(town(), ALONE | {"classification": 2}, folder / "town.laz")
    places = [xyz + np.array([1000.0 * (k + 1), 0, 0]) for k, (xyz, _) in enumerate(ISLANDS)]
    counts = [len(xyz) for xyz in places]
    columns = {n: np.repeat([c[n] for _, c in ISLANDS], counts) for n in ALONE}
    save(np.vstack(places), columns, folder / "lake.laz")
    trained = {"points": folder / "town.laz", "map": folder.parent / MAP, "rows": 2, "columns": 3}
    toolbox.run("classify.som", trained, overwrite=True)
    return folder


def town() -> NDArray[np.float64]:
    """100 x 100 m with a house and a bird."""
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, 100, (2, 20_000))
    z = 0.05 * x + rng.normal(0, 0.03, len(x))
    z[(abs(x - 50) < 9) & (abs(y - 30) < 12)] += 6
    return np.vstack([np.column_stack([x, y, z]), [[50, 80, 70]]])


def save(xyz: NDArray[np.float64], columns: dict[str, Any], path: Path) -> None:
    attributes = {n: np.full(len(xyz), v, np.uint8) for n, v in columns.items()}
    attributes["intensity"] = np.arange(len(xyz), dtype=np.uint16) % 900
    moved = xyz + np.array([500_000, 4_600_000, 0])
    PointCloud(moved.round(3), attributes, crs=CRS(32635)).save(path)


@pytest.mark.slow
@pytest.mark.parametrize(("id", "settings"), RUNS, ids=[id for id, _ in RUNS])
def test_tiles_of_a_lake(
    id: str, settings: dict[str, Any], survey: Path, tiling: Tiling, tmp_path: Path
) -> None:
    """Labels and heights of each point, and all numbers that tiles can add up."""
    output = catalog.load(id).outputs
    points = next(name for name, field in output.items() if field.kind.word == "PointCloud")
    if "map" in settings:
        settings = settings | {"map": survey.parent / settings["map"]}
    found = {}
    for how in (None, tiling):
        path = tmp_path / f"{how is None}.laz"
        result = toolbox.run(id, {"points": survey, **settings, points: path}, tiling=how)
        found[how is None] = PointCloud.open(path), result
    (tiles, numbers), (whole, wanted) = found[False], found[True]
    assert tiles.names == whole.names
    for name in ("x", "y", "z", *whole.names):
        allowed = 0.001 if name in ("confidence", "neuron_distance") else 0
        np.testing.assert_allclose(tiles[name], whole[name], 0, allowed, err_msg=name)
    for name, value in numbers.items():
        if isinstance(value, float | int):
            assert value == wanted[name], name
