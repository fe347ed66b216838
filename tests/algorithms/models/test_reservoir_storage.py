"""models.reservoir_storage: the curve of the lake that is there; without one, an error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

import toolbox
from algorithms.samples.scene import SamplesScene
from toolbox.cli.main import main
from toolbox.data import PointCloud


@pytest.fixture(scope="module")
def lake() -> PointCloud:
    return SamplesScene(kind="reservoir", size=160.0, density=2.0).run().points


@pytest.mark.slow
def test_the_curve_begins_with_the_lake_whatever_the_order_of_the_points(lake: PointCloud) -> None:
    before = lake.xyz.copy()
    found = toolbox.run("models.reservoir_storage", {"points": lake, "highest": 506.0})
    np.testing.assert_array_equal(lake.xyz, before)
    frame = found["curve"].frame
    assert frame["level_m"].iloc[0] == pytest.approx(found["level"], abs=0.01)
    assert frame["area_m2"].iloc[0] == pytest.approx(found["water_area"], rel=0.03)
    assert (np.diff(frame["volume_m3"]) > 0).all()
    order = np.random.default_rng(1).permutation(len(lake))
    values = {"points": lake.select(order), "highest": 506.0}
    again = toolbox.run("models.reservoir_storage", values)["curve"].frame
    np.testing.assert_allclose(again["volume_m3"], frame["volume_m3"], rtol=1e-9)


def test_a_survey_without_a_lake_is_an_error_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 60, (2, 9000))
    xyz = np.column_stack([x + 5e5, y + 4.4e6, 100 + 0.2 * x + rng.normal(0, 0.03, 9000)])
    PointCloud(xyz, crs=CRS(32635)).save(tmp_path / "slope.laz")
    out = tmp_path / "out"
    words = ["--points", str(tmp_path / "slope.laz"), "--deliver", str(out)]
    assert main(["run", "models.reservoir_storage", *words]) == 3
    assert "lake: holds no water" in capsys.readouterr().err
    assert not out.exists()
