"""Algorithms of QGIS as tools, with a stand-in for qgis_process that says what QGIS says."""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
from affine import Affine
from pyproj import CRS

import toolbox
from toolbox.cli.replay import replay
from toolbox.context import QUIET
from toolbox.data import Raster
from toolbox.errors import Cancelled, DataError, ParameterError
from toolbox.qgis import process as qgis_process
from toolbox.qgis import steps as qgis_steps
from toolbox.runs import provenance


def parameter(name: str, type: str, default: object = None, **raw: object) -> dict[str, object]:
    out = type.endswith("Destination")
    about = {"name": name, "description": name, "type": {"id": type}, "default_value": default}
    about |= {"optional": bool(raw.pop("optional", False)), "is_destination": out}
    return about | {"raw_definition": {"flags": 0} | raw}


HELP = {
    "qgis_version": "3.40.6-Bratislava",
    "algorithm_details": {"name": "Fake", "short_description": None},
    "parameters": {
        "INPUT": parameter("INPUT", "raster"),
        "METHOD": parameter(
            "METHOD",
            "enum",
            1,
            options=["Low", "High"],
            allow_multiple=False,
            uses_static_strings=False,
        ),
        "SIZE": parameter("SIZE", "number", 3.5, data_type=1),
        "COUNT": parameter("COUNT", "number", None, data_type=0, optional=True),
        "EXTENT": parameter("EXTENT", "extent", None, optional=True),
        "TARGET": parameter("TARGET", "crs", "EPSG:2154"),
        "OUTPUT": parameter("OUTPUT", "rasterDestination"),
    },
    "outputs": {
        "OUTPUT": {"type": "outputRaster", "description": "Out"},
        "MEAN": {"type": "outputNumber", "description": "Mean"},
    },
}


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Notes what it is given, copies the input, or waits if there is no output yet."""
    path = tmp_path / "qgis_process"
    (tmp_path / "help.json").write_text(json.dumps(HELP))
    path.write_text(
        "#!/bin/bash\n"
        f'cd "{tmp_path}"\n'
        'if [ "$1" = help ]; then cat help.json; exit; fi\n'
        'printf "%s\\n" "$@" > given; echo $$ > pid\n'
        "if [ -e wait ]; then sleep 60 & echo $! > child; wait; fi\n"
        'if [ -e fail ]; then echo "ERROR:	No luck" >&2; exit 1; fi\n'
        'for word; do case "$word" in INPUT=*) from="${word#*=}";; OUTPUT=*) to="${word#*=}";;'
        " esac; done\n"
        'cp "$from" "$to"\n'
        'echo "{\\"results\\": {\\"OUTPUT\\": \\"$to\\", \\"MEAN\\": 2.5}}"\n'
    )
    os.chmod(path, 0o755)
    monkeypatch.setenv(qgis_process.VARIABLE, str(path))
    qgis_steps.load.cache_clear()
    return path


@pytest.fixture
def raster() -> Raster:
    return Raster(np.ones((3, 3)), Affine(1, 0, 0, 0, -1, 3), crs=CRS(32635))


def test_values_and_layers_go_there_and_back(program: Path, raster: Raster) -> None:
    spec = qgis_steps.load("qgis:fake:one")
    inputs = spec.inputs
    assert inputs["method"].choices == ("Low", "High")
    assert inputs["method"].default == "High"
    assert (inputs["size"].kind.word, inputs["count"].kind.word) == ("number", "integer")
    assert inputs["target"].default == CRS(2154)
    assert inputs["input"].required
    assert not inputs["count"].required
    extent = inputs["extent"].parse([1, 2, 3, 4])
    result = spec.build({"input": raster, "extent": extent, "method": "Low"}).run()
    assert result.mean == 2.5
    np.testing.assert_array_equal(result.output.values, raster.values)
    given = program.with_name("given").read_text().split("\n")
    assert given[:3] == ["run", "fake:one", "--json"]
    assert {"METHOD=0", "SIZE=3.5", "EXTENT=1.0,3.0,2.0,4.0", "TARGET=EPSG:2154"} <= {*given}
    assert not [word for word in given if word.startswith("COUNT")]
    folders = {Path(word.partition("=")[2]).parent for word in given if "PUT=/" in word}
    assert len(folders) == 1
    assert not folders.pop().exists()


def test_wrong_values_and_failures(program: Path, raster: Raster) -> None:
    spec = qgis_steps.load("qgis:fake:two")
    with pytest.raises(ParameterError, match="must be one of Low, High"):
        spec.build({"input": raster, "method": "Middle"})
    program.with_name("fail").touch()
    with pytest.raises(DataError, match="fake:two: No luck"):
        spec.build({"input": raster}).run()


def test_cancel_ends_the_program(program: Path, raster: Raster) -> None:
    job = qgis_steps.load("qgis:fake:three").build({"input": raster})
    program.with_name("wait").touch()
    pid, child = program.with_name("pid"), program.with_name("child")
    ctx = replace(QUIET, stop=lambda: child.exists() and bool(child.read_text().strip()))
    began = time.monotonic()
    with pytest.raises(Cancelled):
        job.run(ctx)
    assert time.monotonic() - began < 10
    for number in (pid, child):  # what QGIS has started must not go on
        assert _ends(int(number.read_text()))


def _ends(pid: int) -> bool:
    """Whether a process is over at once, or was all but over."""
    try:
        process = psutil.Process(pid)
        if process.status() != psutil.STATUS_ZOMBIE:
            process.wait(timeout=2)
    except psutil.NoSuchProcess:
        return True
    except psutil.TimeoutExpired:
        return process.status() == psutil.STATUS_ZOMBIE
    return True


def test_a_record_names_the_version_of_qgis(
    program: Path, raster: Raster, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    source, product = tmp_path / "r.tif", tmp_path / "made.tif"
    raster.save(source)
    model = tmp_path / "m.yaml"
    model.write_text(
        "id: my.m\ntitle: M\ninputs:\n  raster: {type: Raster, help: R}\n"
        "steps:\n  one: {tool: 'qgis:fake:five', input: {from: inputs.raster}}\n"
        "outputs:\n  made: {from: one.output, help: M}\n"
    )
    toolbox.run(str(model), {"raster": source, "made": product})
    record = provenance.read(product)
    assert record is not None
    assert record.qgis == "3.40.6"
    assert "QGIS 3.40.6" in record.text()
    assert replay(product) == []
    help = program.with_name("help.json")
    help.write_text(help.read_text().replace("3.40.6", "3.44.0"))
    qgis_steps.load.cache_clear()
    assert replay(product) == []
    assert "was made with QGIS 3.40.6; this is 3.44.0" in caplog.text
    toolbox.run("surface.hillshade", {"surface": source, "hillshade": tmp_path / "h.tif"})
    other = provenance.read(tmp_path / "h.tif")
    assert other is not None
    assert "qgis" not in json.loads(other.to_json())


def test_no_library_of_ours_reaches_qgis(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PYTHONPATH", "PROJ_LIB", "GDAL_DATA", "LD_LIBRARY_PATH", "CONDA_PREFIX"):
        monkeypatch.setenv(name, "/conda")
    monkeypatch.setenv("GDAL_NUM_THREADS", "2")
    env = qgis_process.environment("/opt/bin/qgis_process")
    assert "/conda" not in env.values()
    assert env["GDAL_NUM_THREADS"] == "2"
    assert env["PATH"].startswith("/opt/bin")


def test_without_qgis(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(qgis_process.VARIABLE, "/no/program")
    qgis_steps.load.cache_clear()
    with pytest.raises(ParameterError, match="QGIS was not found"):
        qgis_steps.load("qgis:fake:four")
