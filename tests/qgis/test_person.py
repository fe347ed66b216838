"""What a person does in the window of QGIS, under Xvfb; each scenario of `person.py` is a test.

The pictures of all windows are kept in the folder that TOOLBOX_PICTURES names.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock
from qgis_program import Qgis

from toolbox.cli.main import main
from toolbox.data import PointCloud

SCRIPT = Path(__file__).with_name("person.py")
SCENARIOS = re.findall(r"(?m)^def play_(\w+)", SCRIPT.read_text("utf-8"))
NEEDED = ("qgis", "xvfb-run")


@pytest.fixture(scope="session")
def person(qgis: Qgis, cloud: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What went wrong in each scenario; all are played in one start of QGIS."""
    if missing := [name for name in NEEDED if shutil.which(name) is None]:
        pytest.skip(f"there is no {missing[0]}")
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    result = folder / "person.json"
    with FileLock(f"{result}.lock"):
        if not result.exists():
            result.write_text(json.dumps(_played(qgis, cloud, tmp_path_factory.mktemp("person"))))
    return dict(json.loads(result.read_text(encoding="utf-8")))


def _played(qgis: Qgis, cloud: Path, folder: Path) -> dict[str, str]:
    pictures = Path(os.environ.get("TOOLBOX_PICTURES") or folder / "pictures")
    pictures.mkdir(parents=True, exist_ok=True)
    (pictures / "results.json").unlink(missing_ok=True)
    says = {"folder": str(pictures), "cloud": str(cloud), "scenarios": []} | _data(cloud, folder)
    file = folder / "says.json"
    file.write_text(json.dumps(says), "utf-8")
    env = {name: value for name, value in qgis.env.items() if name != "QT_QPA_PLATFORM"}
    # QGIS names layers otherwise in the folder of temporary files, where that of the tests is.
    env["TMPDIR"] = str(folder / "temporary")
    Path(env["TMPDIR"]).mkdir()
    words = ["xvfb-run", "-a", "-s", "-screen 0 1500x1000x24", "qgis", "--nologo"]
    done = subprocess.run(
        [*words, "--noversioncheck", "--code", str(SCRIPT)],
        env=env | {"TOOLBOX_PERSON": str(file)},
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
        timeout=900,
    )
    (pictures / "stderr.txt").write_text(done.stderr, "utf-8")
    results = pictures / "results.json"
    assert results.exists(), done.stderr[:3000]
    played = dict(json.loads(results.read_text("utf-8"))["results"])
    ended = f"QGIS ended before with exit code {done.returncode}:\n{done.stderr[-3000:]}"
    return {name: played.get(name, ended) for name in SCENARIOS}


def _data(cloud: Path, folder: Path) -> dict[str, object]:
    """A survey of two files, a scan without a CRS, and a model of the designer."""
    whole, survey = PointCloud.open(cloud), folder / "Vermessung ü"
    survey.mkdir()
    east = whole.xyz[:, 0] > 500030
    tiles = [survey / "west.laz", survey / "east.laz"]
    for path, part in zip(tiles, (~east, east), strict=True):
        whole.select(part).save(path)
    scan, model = folder / "scan.xyz", folder / "terrain.model3"
    np.savetxt(scan, (whole.xyz[:3000] - [500000, 4500000, 100]) * 1000, fmt="%.1f")
    assert main(["model", "to-qgis", "models.terrain", str(model)]) == 0
    names = {"survey": survey, "scan": scan, "model": model}
    return {name: str(path) for name, path in names.items()} | {"tiles": list(map(str, tiles))}


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_person(scenario: str, person: dict[str, str]) -> None:
    assert person[scenario] == ""
