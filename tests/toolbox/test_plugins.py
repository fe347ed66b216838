"""Tools of other packages: installed by pip, found by their entry point."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb

MODULE = '''
from __future__ import annotations
from toolbox.context import QUIET, Context
from toolbox.data import PointCloud, Table
from toolbox.declare import outputs, show, sink, source, tool

@tool("acme.count", title="Count points")
class AcmeCount:
    """Count points.

    It does no more than that.
    """

    points: PointCloud = source("Points to count")

    @outputs
    class Outputs:
        count: int = sink("Number of points", unit="1")
        table: Table = sink(
            "Number of points up to each",
            show=show.Curve(show.Axis("place", "place"), (show.Axis("points", "points"),)),
        )

    def halo(self) -> float:
        return 0.0

    def run(self, ctx: Context = QUIET) -> AcmeCount.Outputs:
        rows = [{"place": n, "points": n + 1} for n in range(len(self.points))]
        return self.Outputs(count=len(self.points), table=Table.from_rows(rows))
'''
FILES = {
    "acme_lidar.py": MODULE,
    "acme_lidar-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: acme-lidar\nVersion: 1.0\n",
    "acme_lidar-1.0.dist-info/WHEEL": (
        "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    ),
    "acme_lidar-1.0.dist-info/entry_points.txt": (
        "[toolbox.tools]\nacme.count = acme_lidar:AcmeCount\nacme.broken = no_such_module:Nothing\n"
    ),
    "acme_lidar-1.0.dist-info/RECORD": "",
}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which pip has installed the package."""
    folder = tmp_path_factory.mktemp("plugin")
    wheel = folder / "acme_lidar-1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, text in FILES.items():
            archive.writestr(name, text)
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
    command += ["--disable-pip-version-check", "--target", str(folder / "site"), str(wheel)]
    subprocess.run(command, check=True, capture_output=True)
    return folder / "site"


def toolbox(site: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    root = Path(__file__).resolve().parents[2]
    paths = os.pathsep.join([str(site), str(root)])
    return subprocess.run(
        [sys.executable, "-m", "toolbox", *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": paths},
    )


@pytest.mark.slow
def test_a_plugin_is_listed_described_and_run(site: Path, tmp_path: Path) -> None:
    assert "acme.count" in toolbox(site, "list").stdout
    described = json.loads(toolbox(site, "describe", "acme.count", "--json").stdout)
    assert described["title"] == "Count points"
    points = tmp_path / "a.xyz"
    points.write_text("x y z\n1 2 3\n4 5 6\n")
    plot = tmp_path / "a.png"
    words = ("--points", str(points), "--picture", str(plot))
    assert "count: 2  (number of points)\n" in toolbox(site, "run", "acme.count", *words).stdout
    picture = np.asarray(matplotlib.image.imread(plot))[..., :3]
    line = np.abs(picture - to_rgb("#c4742b")).max(axis=-1) < 2 / 255
    assert line.sum() > 200  # the curve that the tool declares


@pytest.mark.slow
def test_a_broken_plugin_does_no_harm_to_others(site: Path) -> None:
    listed = toolbox(site, "list")
    assert listed.returncode == 0
    assert "points.filter" in listed.stdout
    assert "(cannot be loaded: No module named 'no_such_module')" in listed.stdout
    assert toolbox(site, "describe", "acme.broken").returncode == 2
