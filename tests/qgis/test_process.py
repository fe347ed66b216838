"""qgis_process with the plugin: list, run, errors, exit codes, cancel."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import psutil
from qgis_program import Qgis

from toolbox import catalog
from toolbox.cli.main import main
from toolbox.data import Raster


def test_the_list_is_complete_and_starts_no_python(qgis: Qgis, recorder: tuple[Path, Path]) -> None:
    program, note = recorder
    done = qgis("list", "--json", LIDAR_TOOLBOX_PYTHON=str(program))
    assert done.returncode == 0, done.stderr
    ours = json.loads(done.stdout)["providers"]["lidartoolbox"]["algorithms"]
    assert len(ours) == len(catalog.ids())
    assert not note.exists()


def test_a_run_in_a_polluted_environment(
    qgis: Qgis, cloud: Path, tmp_path: Path, recorder: tuple[Path, Path]
) -> None:
    """What launchers of QGIS set would break our Python; the path has a space and an accent."""
    program, note = recorder
    (tmp_path / "laspy.py").write_text("raise SystemExit('the wrong laspy')\n")
    proj = tmp_path / "proj"
    proj.mkdir()
    (proj / "proj.db").write_text("not a database")
    wrong = {"PYTHONHOME": "/usr", "PYTHONPATH": str(tmp_path), "GDAL_DATA": "/nowhere"}
    wrong |= {"PROJ_LIB": str(proj), "PROJ_DATA": str(proj), "LIDAR_TOOLBOX_PYTHON": str(program)}
    surface = tmp_path / "Gelände ñ.tif"
    values = [f"POINTS={cloud}", "CELL=2", "CLASSES=2", f"SURFACE={surface}"]
    done = qgis("run", "lidartoolbox:surfacegrid", "--json", "--", *values, **wrong)
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)["results"]
    assert results["SURFACE"] == str(surface)
    assert results["FILLED_SHARE"] > 0.5
    assert note.read_text() == "started\n"
    raster = Raster.open(surface)
    assert raster.crs is not None
    assert raster.crs.to_epsg() == 32635
    assert 99 < np.nanmedian(raster.values) < 105


def test_a_wrong_value_fails_with_the_sentence_of_the_command_line(
    qgis: Qgis, cloud: Path, tmp_path: Path, capsys: object
) -> None:
    surface = tmp_path / "a.tif"
    for name, value, why in (
        ("classes", "2,x", "must be"),
        ("cell", "-2", "must be"),
        ("method", "idww", "did you mean 'idw'"),
        ("points", "/no/file.laz", "there is no file"),
        ("colour", "red", "unknown parameter"),
    ):
        given = {"points": str(cloud), "surface": str(surface)} | {name: value}
        words = [f"{key.upper()}={text}" for key, text in given.items()]
        done = qgis("run", "lidartoolbox:surfacegrid", "--", *words)
        assert main(["run", "surface.grid", *(f"--{k}={v}" for k, v in given.items())]) == 2
        told = capsys.readouterr().err.removeprefix("error: ").strip()  # type: ignore[attr-defined]
        assert done.returncode == 1
        assert told in done.stderr
        assert f"{name}: {why}" in told or why in told
        assert not surface.exists()


def test_without_an_environment_it_says_what_to_do(qgis: Qgis, cloud: Path) -> None:
    values = [f"POINTS={cloud}"]
    done = qgis("run", "lidartoolbox:pointsinfo", "--", *values, LIDAR_TOOLBOX_PYTHON="/no/python")
    assert done.returncode == 1
    assert "No Python environment" in done.stderr
    assert "at /no/python" in done.stderr
    assert "python -m toolbox qgis install" in done.stderr


def test_interrupt_stops_the_tool_and_leaves_nothing(
    qgis: Qgis, tmp_path: Path, cloud: Path
) -> None:
    """A stand-in that works for a minute, and stops when its standard input ends."""
    program, note = tmp_path / "python", tmp_path / "pid"
    program.write_text(f'#!/bin/sh\necho $$ > "{note}"\nread line\nread more\nexit 130\n')
    os.chmod(program, 0o755)
    out = tmp_path / "out.laz"
    values = [f"POINTS={cloud}", f"KEPT={out}", "CLASSES=2"]
    process = qgis.start(
        "run",
        "lidartoolbox:pointsfilter",
        "--json",
        "--",
        *values,
        LIDAR_TOOLBOX_PYTHON=str(program),
    )
    until = time.monotonic() + 60
    while not (note.exists() and note.read_text().strip()) and time.monotonic() < until:
        time.sleep(0.05)
    child = int(note.read_text())
    time.sleep(0.5)
    asked = time.monotonic()
    process.send_signal(signal.SIGINT)
    while psutil.pid_exists(child) and time.monotonic() < asked + 10:
        time.sleep(0.02)
    took = time.monotonic() - asked
    try:
        _, err = process.communicate(timeout=30)
    finally:
        process.kill()  # if it was not stopped
    assert process.returncode == 1
    assert "Cancelled." in err
    assert took < 1.0, took
    assert not out.exists()


def test_a_killed_qgis_leaves_no_tool_behind(qgis: Qgis, tmp_path: Path, cloud: Path) -> None:
    out = tmp_path / "out.laz"
    values = [f"POINTS={cloud}", f"CLASSIFIED={out}"]
    process = qgis.start("run", "lidartoolbox:groundptd", "--", *values)
    mine = psutil.Process(process.pid)
    until = time.monotonic() + 60
    while not mine.children() and time.monotonic() < until:
        time.sleep(0.02)
    child = mine.children()[0]
    time.sleep(0.3)
    process.kill()
    process.communicate(timeout=60)
    _, alive = psutil.wait_procs([child], timeout=20)
    assert not alive
