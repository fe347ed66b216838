"""What `inside.py` checks in the Python of QGIS, in one start of it; each check is a test."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
from filelock import FileLock
from qgis_program import Qgis

SCRIPT = Path(__file__).with_name("inside.py")
CHECKS = re.findall(r"(?m)^def (check_\w+)", SCRIPT.read_text("utf-8"))


@pytest.fixture(scope="session")
def inside(qgis: Qgis, cloud: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What each check found wrong; the processes that run the tests share one start of QGIS."""
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    result = folder / "inside.json"
    with FileLock(f"{result}.lock"):
        if not result.exists():
            made = tmp_path_factory.mktemp("inside")
            done = qgis.python(SCRIPT, qgis.home / "profiles" / "default", cloud, made)
            found = re.search(r"(?m)^RESULT (.*)$", done.stdout)
            assert found, done.stderr[-3000:]
            result.write_text(found[1], encoding="utf-8")
    return dict(json.loads(result.read_text(encoding="utf-8")))


@pytest.mark.parametrize("check", CHECKS)
def test_inside(check: str, inside: dict[str, str]) -> None:
    assert inside[check] == ""
