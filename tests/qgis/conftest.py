"""A QGIS with the plugin in a profile of its own, and small data."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from qgis_program import Qgis

from toolbox.data import PointCloud
from toolbox.qgis import process as qgis_process
from toolbox.qgis.install import install


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All tests here need QGIS, and each start of it takes seconds."""
    for item in items:
        if Path(__file__).parent in Path(item.fspath).parents:
            item.add_marker(pytest.mark.qgis)
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def qgis(tmp_path_factory: pytest.TempPathFactory) -> Qgis:
    """The plugin, put where its user would put it; the path has a space and an accent."""
    program = qgis_process.find()
    if program is None:
        if os.environ.get("TOOLBOX_TEST_QGIS") == "required":
            pytest.fail("QGIS is not installed, and TOOLBOX_TEST_QGIS requires it")
        pytest.skip("QGIS is not installed")
    home = tmp_path_factory.mktemp("Größe ñ")
    home.chmod(0o700)
    install(home / "profiles" / "default")
    return Qgis(program, home)


@pytest.fixture(scope="session")
def cloud(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A slope with a few blocks on it, classified; the path has a space and an accent."""
    rng = np.random.default_rng(7)
    xyz = rng.uniform(0, 60, (6000, 3))
    xyz[:, 2] = 100 + 0.05 * xyz[:, 0] + rng.normal(0, 0.02, len(xyz))
    high = ((xyz[:, :2] // 10).sum(axis=1) % 5 == 0) & (xyz[:, 0] > 20)
    xyz[high, 2] += 6
    classes = np.where(high, 6, 2).astype(np.uint8)
    intensity = np.where(high, 900, 300).astype(np.uint16)
    path = tmp_path_factory.mktemp("Daten für é") / "punkte.laz"
    attributes = {"classification": classes, "intensity": intensity}
    PointCloud(xyz + np.array([500000, 4500000, 0]), attributes, crs=CRS(32635)).save(path)
    return path


@pytest.fixture
def recorder(tmp_path: Path) -> tuple[Path, Path]:
    """A stand-in for Python that notes each start of it, and the note."""
    note, program = tmp_path / "started", tmp_path / "python"
    program.write_text(f'#!/bin/sh\necho started >> "{note}"\nexec {sys.executable} "$@"\n')
    os.chmod(program, 0o755)
    return program, note
