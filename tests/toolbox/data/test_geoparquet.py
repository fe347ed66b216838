"""Points as GeoParquet, read back by geopandas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scenes.layers import cloud

from toolbox.data import PointCloud, Vector
from toolbox.data.crs import LOCALS

geopandas = pytest.importorskip("geopandas")
pytest.importorskip("pyarrow")


def points(count: int = 30) -> PointCloud:
    rng = np.random.default_rng(0)
    xyz = rng.uniform((500_000, 4_600_000, 0), (500_400, 4_600_400, 9), (count, 3))
    made = cloud(xyz, 2, gps_time=np.arange(float(count)))
    return made.with_attributes({"vector": rng.uniform(size=(count, 2)).astype(np.float32)})


def test_points_and_attributes_come_back(tmp_path: Path) -> None:
    given = points()
    given.save(tmp_path / "a.parquet")
    found = geopandas.read_parquet(tmp_path / "a.parquet")
    assert found.crs == given.crs
    xyz = np.column_stack([found.geometry.x, found.geometry.y, found.geometry.z])
    np.testing.assert_array_equal(xyz, given.xyz)
    assert found["classification"].dtype == np.uint8
    np.testing.assert_array_equal(found["gps_time"], given["gps_time"])
    np.testing.assert_array_equal(found["vector_1"], given["vector"][:, 1])
    assert Vector.open(tmp_path / "a.parquet").frame.has_z.all()


def test_blocks_make_one_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("toolbox.data.geoparquet._BLOCK", 7)
    points().save(tmp_path / "a.parquet")
    found = geopandas.read_parquet(tmp_path / "a.parquet")
    assert found["gps_time"].tolist() == list(range(30))


def test_a_crs_that_is_none_and_an_empty_cloud(tmp_path: Path) -> None:
    points(0).save(tmp_path / "a.parquet")
    assert len(geopandas.read_parquet(tmp_path / "a.parquet")) == 0
    points().with_crs(LOCALS["local"]).save(tmp_path / "b.parquet")
    assert geopandas.read_parquet(tmp_path / "b.parquet").crs is None
