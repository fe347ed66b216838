"""PLY meshes of polygons in space: triangles that cover them and leave their holes open."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import plyfile
import pytest
import shapely
from numpy.typing import NDArray

from toolbox.data import Vector
from toolbox.errors import DataError

FAR = np.array([700_000.25, 6_600_000.5, 120.0])
SHELL = np.array([[0, 0], [8, 0], [8, 5], [4, 5], [4, 3], [0, 3]], float)
HOLE = np.array([[1, 1], [1, 2], [3, 2], [3, 1]], float)


def raised(uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """On an upright plane that faces south-west."""
    return FAR + np.column_stack([0.6 * uv[:, 0], -0.8 * uv[:, 0], uv[:, 1]])


def written(path: Path, shapes: list[Any], **columns: Any) -> Any:
    Vector(geopandas.GeoDataFrame(columns, geometry=shapes, crs=2154)).save(path)
    return plyfile.PlyData.read(path)


def corners_of(mesh: Any) -> NDArray[np.float64]:
    xyz = np.column_stack([mesh["vertex"][axis] for axis in "xyz"])
    return np.asarray(xyz[np.vstack(mesh["face"]["vertex_indices"])])


def test_an_upright_wall_with_a_hole(tmp_path: Path) -> None:
    wall = shapely.Polygon(raised(SHELL), [raised(HOLE)])
    corners = corners_of(written(tmp_path / "a.ply", [wall]))
    a, b, c = corners.transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    assert area.sum() == pytest.approx(8 * 5 - 4 * 2 - 2 * 1)
    middle = (corners.mean(axis=1) - FAR)[:, [0, 2]] / [0.6, 1]
    flat = shapely.Polygon(SHELL, [HOLE])
    assert shapely.contains_xy(flat, *middle.T).all()
    known = {tuple(p) for p in np.vstack([raised(SHELL), raised(HOLE)])}
    assert {tuple(p) for p in corners.reshape(-1, 3)} <= known  # bit for bit


def test_features_and_their_numbers(tmp_path: Path) -> None:
    one, two = shapely.Polygon(raised(SHELL)), shapely.Polygon(raised(HOLE + 20))
    mesh = written(
        tmp_path / "a.ply",
        [one, shapely.MultiPolygon([two, shapely.Polygon(raised(HOLE + 30))])],
        plane_id=[7, 9],
        tilt=[89.5, np.nan],
        kind=["wall", "door"],
    )
    face = mesh["face"]
    assert set(face.data.dtype.names) == {"vertex_indices", "feature", "plane_id", "tilt"}
    assert [int((face["plane_id"] == k).sum()) for k in (7, 9)] == [4, 4]
    assert (face["feature"] == (face["plane_id"] == 9)).all()
    assert np.isnan(face["tilt"][face["feature"] == 1]).all()


def test_other_geometries_are_refused_and_none_is_an_empty_mesh(tmp_path: Path) -> None:
    for shape in (shapely.Polygon(SHELL), shapely.LineString(raised(SHELL))):
        with pytest.raises(DataError, match="polygons with heights"):
            written(tmp_path / "a.ply", [shape])
    mesh = written(tmp_path / "b.ply", [])
    assert len(mesh["vertex"].data) == len(mesh["face"].data) == 0


def test_the_same_bytes(tmp_path: Path) -> None:
    wall = shapely.Polygon(raised(SHELL), [raised(HOLE)])
    for name in "ab":
        written(tmp_path / f"{name}.ply", [wall], plane_id=[1])
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
