"""Entwine point tiles: all nodes, those of a place, on the web, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes.layers import cloud
from scenes.server import serving

import toolbox
from toolbox.data import PointCloud, Survey, ept
from toolbox.data.remote import store, stream
from toolbox.errors import DataError

SIDE = 400.0
LOW = np.array([500_000.0, 4_600_000.0, 0.0])


def tiles(folder: Path, count: int = 4000, **changes: Any) -> PointCloud:
    """Write a tree of three levels, whose last one has pages of its own; gives all its points."""
    rng = np.random.default_rng(3)
    whole = cloud(LOW + rng.uniform(0, SIDE, (count, 3)), 2, gps_time=np.arange(float(count)))
    depth = rng.integers(0, 3, count)
    place = np.floor((whole.xyz - LOW) / SIDE * 2.0 ** depth[:, None]).astype(int)
    keys = np.array(["-".join(map(str, key)) for key in np.column_stack([depth, place])])
    (folder / "ept-data").mkdir(parents=True)
    (folder / "ept-hierarchy").mkdir()
    pages: dict[str, dict[str, int]] = {"0-0-0-0": {}}
    for key in np.unique(keys):
        own = whole.select(keys == key)
        own.save(folder / "ept-data" / f"{key}.laz")
        level, *at = map(int, key.split("-"))
        if level < 2:
            pages["0-0-0-0"][key] = len(own)
        else:
            root = "-".join(map(str, (1, *(k // 2 for k in at))))
            page = pages.setdefault(root, {root: int(np.sum(keys == root))})
            page[key] = len(own)
            pages["0-0-0-0"][root] = -1
    for root, page in pages.items():
        (folder / "ept-hierarchy" / f"{root}.json").write_text(json.dumps(page))
    head = {"dataType": "laszip", "bounds": [*LOW, *(LOW + SIDE)], "points": count}
    (folder / "ept.json").write_text(json.dumps({**head, **changes}))
    return whole


def test_all_points_and_those_of_a_place(tmp_path: Path) -> None:
    whole = tiles(tmp_path)
    path = tmp_path / "ept.json"
    assert Survey.open(path).count == len(whole)
    assert sorted(PointCloud.open(path)["gps_time"]) == sorted(whole["gps_time"])
    box = (500_010, 4_600_010, 500_050, 4_600_050)
    near = PointCloud.open(path, bounds=box)
    assert sorted(near["gps_time"]) == sorted(whole.within(box)["gps_time"])
    files = ept.files_of(path, box)
    assert len(files) == 1 + 2 + 4 < len(ept.files_of(path)) == 1 + 8 + 64
    out = tmp_path / "thinned.laz"
    source = {"path": str(path), "bounds": list(box)}
    values = {"points": source, "cell": 0.001, "thinned": out}
    toolbox.run("points.thin", values)
    assert len(PointCloud.open(out)) == len(near)


def test_on_the_web_only_what_a_place_needs_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("obstore")
    whole = tiles(tmp_path / "in")
    monkeypatch.setenv(stream.FOLDER_VARIABLE, str(tmp_path / "kept"))
    monkeypatch.setattr(store, "FRESH", 60.0)
    with serving() as server:
        for path in (tmp_path / "in").rglob("*.*"):
            server.files[f"/e/{path.relative_to(tmp_path / 'in').as_posix()}"] = path.read_bytes()
        box = (500_010, 4_600_010, 500_050, 4_600_050)
        near = PointCloud.open(f"{server.url}/e/ept.json?key=secret", bounds=box)
        assert sorted(near["gps_time"]) == sorted(whole.within(box)["gps_time"])
        asked = {path.partition("?")[0] for path, *_ in server.asked}
        assert len([path for path in asked if path.endswith(".laz")]) == 7
        assert len([path for path in asked if "hierarchy" in path]) == 1 + 2


def test_points_that_the_hierarchy_does_not_list_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tiles(tmp_path / "a")
    path = tmp_path / "a/ept.json"
    ept.files_of(path)
    assert not caplog.messages
    (tmp_path / "a/ept-hierarchy/0-0-0-0.json").write_text(json.dumps({"0-0-0-0": 5}))
    assert len(ept.files_of(path)) == 1
    assert "says 4000 points, and its hierarchy lists 5" in caplog.text


@pytest.mark.parametrize("bounds", [[1, 2, 3], [0, 0, 0, 1, 1, float("nan")]])
def test_bounds_that_are_no_box(bounds: list[float], tmp_path: Path) -> None:
    tiles(tmp_path / "a", bounds=bounds)
    with pytest.raises(DataError, match="its bounds must be six numbers, got"):
        ept.files_of(tmp_path / "a/ept.json")


def test_what_cannot_be_read(tmp_path: Path) -> None:
    tiles(tmp_path / "a", dataType="zstandard")
    with pytest.raises(DataError, match="points are read from EPT of laszip, not of zstandard"):
        PointCloud.open(tmp_path / "a/ept.json")
    tiles(tmp_path / "b")
    with pytest.raises(DataError, match="has no points there"):
        PointCloud.open(tmp_path / "b/ept.json", bounds=(0, 0, 1, 1))
    page = tmp_path / "b/ept-hierarchy/1-0-0-0.json"
    page.write_text(json.dumps({"1-0-0-0": -1}))
    with pytest.raises(DataError, match="its hierarchy leads to 1-0-0-0 twice"):
        PointCloud.open(tmp_path / "b/ept.json")
    page.write_text("7")
    with pytest.raises(DataError, match=r"1-0-0-0\.json is no page of the hierarchy of an EPT"):
        PointCloud.open(tmp_path / "b/ept.json")
    page.unlink()
    with pytest.raises(DataError, match=r"1-0-0-0\.json"):
        PointCloud.open(tmp_path / "b/ept.json")
