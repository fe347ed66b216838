"""--resume: which steps are taken from the cache, and what happens to damaged entries."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from affine import Affine
from filelock import FileLock
from pyproj import CRS

from algorithms.points.filter import PointsFilter
from toolbox.context import Context
from toolbox.data import PointCloud, Raster
from toolbox.errors import Cancelled, DataError, ParameterError
from toolbox.execute import run
from toolbox.runs import cache

MODEL = """
id: my.test
title: Test
inputs:
  points: {type: PointCloud, help: Points}
  cell: {type: number, unit: m, default: 2, help: Cell}
steps:
  low: {tool: points.filter, points: {from: inputs.points}, classes: 1-2}
  dtm: {tool: surface.grid, points: {from: low.kept}, method: mean, cell: {from: inputs.cell}}
  dsm: {tool: surface.grid, points: {from: inputs.points}, method: max, cell: {from: inputs.cell}}
  tall: {tool: surface.difference, surface: {from: dsm.surface}, base: {from: dtm.surface}}
outputs:
  height: {from: tall.difference}
"""
STEPS = ["low", "dtm", "dsm", "tall"]
Go = Callable[..., list[str]]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(cache.FOLDER_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A model and points."""
    model, points = tmp_path / "test.yaml", tmp_path / "points.laz"
    model.write_text(MODEL, "utf-8")
    cloud().save(points)
    return model, points


def cloud(lift: float = 0.0) -> PointCloud:
    xyz = np.random.default_rng(1).uniform(0, 20, (400, 3)) + np.array([0, 0, lift])
    classes = np.repeat(np.array([1, 6], np.uint8), 200)
    return PointCloud(xyz, {"classification": classes}, crs=CRS(32635))


@pytest.fixture
def go(files: tuple[Path, Path], place: Path, caplog: pytest.LogCaptureFixture) -> Go:
    """Run the model with --resume; gives the steps that came from the cache."""

    def taken(points: Any = None, **values: Any) -> list[str]:
        caplog.clear()
        source = files[1] if points is None else points
        with caplog.at_level(logging.INFO, "toolbox"):
            result = run(str(files[0]), {"points": source} | values, resume=True)
        fresh = run(str(files[0]), {"points": source} | values)
        np.testing.assert_array_equal(result["height"].values, fresh["height"].values)
        texts = [record.getMessage() for record in caplog.records]
        return [text.split()[1].rstrip(":") for text in texts if "taken from the cache" in text]

    return taken


def test_unchanged_steps_are_taken_from_the_cache(go: Go, files: tuple[Path, Path]) -> None:
    assert go() == []
    assert go() == STEPS
    assert go(cell=4.0) == ["low"]
    assert go() == STEPS
    text = MODEL.replace("1-2", "1")
    files[0].write_text(text, "utf-8")
    assert go() == ["dsm"]
    files[0].write_text(MODEL.replace("method: max", "method: min"), "utf-8")
    assert go() == ["low", "dtm"]


def test_layers_are_known_by_what_they_hold(
    go: Go, files: tuple[Path, Path], tmp_path: Path
) -> None:
    assert go() == []
    again = tmp_path / "again" / "points.laz"
    again.parent.mkdir()
    cloud().save(again)
    assert go(again) == STEPS
    cloud(lift=1.0).save(files[1], overwrite=True)
    assert go() == []
    cloud().with_crs(CRS(32636)).save(files[1], overwrite=True)
    assert go() == []
    assert go(PointCloud.open(files[1])) == STEPS
    bounded = {"path": files[1], "bounds": [0, 0, 10, 10]}
    assert go(bounded) == []
    assert go(bounded) == STEPS


@pytest.mark.slow
@pytest.mark.usefixtures("place")
def test_another_process_finds_them(files: tuple[Path, Path]) -> None:
    command = [sys.executable, "-m", "toolbox", "run", str(files[0]), "--points", str(files[1])]
    for taken in (0, len(STEPS)):
        done = subprocess.run([*command, "--resume"], capture_output=True, text=True, check=True)
        assert done.stderr.count("unchanged, taken from the cache") == taken


def test_a_tool_by_itself(place: Path, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(2):
        with caplog.at_level(logging.INFO, "toolbox"):
            found = run("points.filter", {"points": cloud(), "classes": "1"}, resume=True)
        assert len(found["kept"]) == 200
    assert caplog.text.count("step points.filter: unchanged") == 1


def test_warnings_of_a_step_are_told_again(place: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "toolbox")
    for _ in range(2):
        caplog.clear()
        run("points.filter", {"points": cloud(), "classes": "77"}, resume=True)
        texts = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
        assert any("no point" in text for text in texts), texts
    assert "taken from the cache" in caplog.text


class HandsOn:
    """A filter that gives back the very points that it is given."""

    spec = PointsFilter.spec  # type: ignore[attr-defined]

    def __init__(self, job: Any) -> None:
        self.job = job

    def __getattr__(self, name: str) -> Any:
        return getattr(self.job, name)

    def run(self, ctx: Context) -> Any:
        return PointsFilter.Outputs(kept=self.job.points, removed_share=0.0)


def test_a_layer_that_is_handed_on_keeps_its_key(place: Path) -> None:
    """Whether a step is taken from the cache must not change what the next ones look for."""
    keys = []
    for _ in range(2):
        store = cache.Cache()
        found = store.run("a", HandsOn(PointsFilter(points=cloud())), Context())
        keys.append(store.keys[found.kept])
    assert keys[0] == keys[1] == cache.content_of(cloud())


def test_damaged_entries_are_made_again(go: Go, place: Path, caplog: Any) -> None:
    assert go() == []
    entries = sorted(place.glob("*" + cache.SUFFIX))
    assert len(entries) == len(STEPS)
    for path in entries:
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    assert go() == []
    assert caplog.text.count("in the cache is not used: its checksum is wrong") == len(STEPS)
    assert go() == STEPS
    for path in entries:
        path.write_bytes(path.read_bytes()[:10])
    assert go() == []
    entries[0].write_bytes(b"")
    assert len(go()) == len(STEPS) - 1


def test_another_version_of_the_code_is_another_result(
    go: Go, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert go() == []
    monkeypatch.setattr(cache, "code_of", lambda package: "new")
    assert go() == []


def test_what_was_not_used_for_longest_goes_first(
    go: Go, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert go() == []
    sizes = {path: path.stat().st_size for path in place.glob("*" + cache.SUFFIX)}
    old = min(sizes, key=lambda path: path.stat().st_mtime_ns)
    for age, path in enumerate(sizes):
        os.utime(path, (1000 + age, 1000 + age) if path != old else (1, 1))
    monkeypatch.setenv(cache.LIMIT_VARIABLE, str(sum(sizes.values())))
    run("points.filter", {"points": cloud(), "classes": "6"}, resume=True)
    assert not old.exists()
    assert sum(path.stat().st_size for path in place.glob("*")) <= sum(sizes.values())
    monkeypatch.setenv(cache.LIMIT_VARIABLE, "0")
    run("points.filter", {"points": cloud(), "classes": "1,6"}, resume=True)
    assert list(place.iterdir()) == []


def test_leftovers_of_a_crash_are_removed(go: Go, place: Path) -> None:
    left, busy = place / ".unfinished-old", place / ".unfinished-new"
    for folder in (left, busy):
        folder.mkdir(mode=0o700, parents=True)
        (folder / "lock").touch()
    place.chmod(0o700)
    with FileLock(busy / "lock"):
        go()
        assert not left.exists()
        assert busy.exists()


@pytest.mark.skipif(os.name == "nt", reason="has no such permissions")
def test_nobody_else_may_read_it(go: Go, place: Path) -> None:
    place.mkdir(mode=0o755)
    before = os.umask(0)
    try:
        go()
    finally:
        os.umask(before)
    assert {path.stat().st_mode & 0o777 for path in place.glob("*.result")} == {0o600}


def test_a_folder_for_all_is_refused(place: Path) -> None:
    """A pickle of somebody else could do anything."""
    place.mkdir()
    place.chmod(0o777)
    with pytest.raises(ParameterError, match="only you may write"):
        run("points.filter", {"points": cloud()}, resume=True)
    place.chmod(0o700)
    run("points.filter", {"points": cloud()}, resume=True)


def test_a_limit_that_is_no_number(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(cache.LIMIT_VARIABLE, "20GB")
    with pytest.raises(ParameterError, match="must be a number of bytes, got '20GB'"):
        run("points.filter", {"points": cloud()}, resume=True)


def test_a_cache_that_cannot_be_written_does_no_harm(
    place: Path, caplog: pytest.LogCaptureFixture
) -> None:
    place.write_text("a file where the folder should be")
    place.chmod(0o600)
    found = run("points.filter", {"points": cloud(), "classes": "1"}, resume=True)
    assert len(found["kept"]) == 200
    assert "is not kept in the cache" in caplog.text


def test_a_step_that_fails_leaves_the_others(
    go: Go, files: tuple[Path, Path], caplog: pytest.LogCaptureFixture
) -> None:
    files[0].write_text(MODEL.replace("1-2", "4"), "utf-8")
    for taken in (0, 1):
        with pytest.raises(DataError, match="step 'dtm'"):
            go()
        assert caplog.text.count("step low: unchanged") == taken


def test_cancel_keeps_what_was_done(go: Go, files: tuple[Path, Path], place: Path) -> None:
    """Stopped while the second step runs: the first one need not run again."""

    def stop() -> bool:
        return len(list(place.glob("*" + cache.SUFFIX))) == 1

    with pytest.raises(Cancelled):
        run(str(files[0]), {"points": files[1]}, resume=True, ctx=Context(stop=stop))
    assert list(place.glob(".*")) == []
    assert go() == ["low"]


def test_equal_layers_have_equal_keys() -> None:
    cells = Affine(1, 0, 0, 0, -1, 2)
    keys = [cache.content_of(Raster(np.eye(2) * k, cells, crs=CRS(32635))) for k in (1, 1, 2)]
    assert keys[0] == keys[1] != keys[2]
