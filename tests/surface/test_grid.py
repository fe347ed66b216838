"""surface.grid: exact on surfaces that a method can represent, and on the lattice it promises."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS
from scipy.interpolate import LinearNDInterpolator, griddata
from scipy.spatial import Delaunay

from algorithms.surface.grid import Method, SurfaceGrid, averaged, facets, grid, interpolate
from toolbox.context import QUIET, Context
from toolbox.data import Lattice, PointCloud, Raster
from toolbox.errors import Cancelled, DataError
from toolbox.values import Attribute, ClassList

UTM = CRS(32635)
METHODS: list[Method] = ["linear", "idw", "nearest", "cubic"]


def plane(x: Any, y: Any) -> Any:
    return 3 + 0.25 * (x - 5e5) - 0.5 * (y - 4.6e6)


def cloud(n: int = 800, crs: CRS | None = UTM, **columns: Any) -> PointCloud:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(5e5, 5e5 + 40, n), rng.uniform(4.6e6, 4.6e6 + 30, n)
    return PointCloud(np.column_stack([x, y, plane(x, y)]), columns, crs=crs)


def centres(raster: Raster) -> tuple[Any, Any]:
    rows, cols = raster.shape
    x = raster.transform.c + (np.arange(cols) + 0.5) * raster.cell
    y = raster.transform.f - (np.arange(rows) + 0.5) * raster.cell
    return np.meshgrid(x, y)


@pytest.mark.parametrize("method", ["linear", "cubic"])
def test_planes_are_exact_at_the_centres_of_cells(method: Method) -> None:
    surface = SurfaceGrid(points=cloud(), method=method).run().surface
    values = surface.band()
    known = np.isfinite(values)
    assert known.mean() > 0.8
    np.testing.assert_allclose(values[known], plane(*centres(surface))[known], atol=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_agrees_with_an_independent_calculation(method: Method) -> None:
    points = cloud(200)
    points = points.with_xyz(points.xyz + [0, 0, 1] * np.sin(points.xyz[:, :1]))
    xy, z = points.xyz[:, :2], points["z"]
    surface = SurfaceGrid(points=points, method=method).run().surface
    x, y = centres(surface)
    cells = np.column_stack([x.ravel(), y.ravel()])
    if method == "idw":
        distance = np.hypot(*(cells[:, None] - xy).transpose(2, 0, 1))
        nearest = np.argsort(distance, axis=1)[:, :12]
        weight = np.take_along_axis(distance, nearest, 1) ** -2.0
        expected = (weight * z[nearest]).sum(1) / weight.sum(1)
    else:
        expected = griddata(xy - xy.mean(0), z, cells - xy.mean(0), method=method)
    np.testing.assert_allclose(surface.band().ravel(), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_values_at_the_points_themselves(method: Method) -> None:
    """Points in the middle of cells: gridded input, where all triangles are doubtful."""
    lattice = Lattice(0.0, 8.0, 1.0, 8, 9)
    x, y = (g.ravel() for g in np.meshgrid(*lattice.centres()))
    values = np.random.default_rng(0).uniform(0, 9, len(x))
    grid = interpolate(np.column_stack([x, y]), values, lattice, method=method)
    np.testing.assert_allclose(grid.ravel(), values, atol=1e-9)


@given(st.integers(0, 10_000), st.integers(3, 60), st.sampled_from([0.13, 1.0, 4.7]))
def test_facets_agree_with_scipy(seed: int, count: int, cell: float) -> None:
    """Drawing triangles gives what looking up each cell's triangle gives, hull edges included."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 10, (count, 2)) + np.array([70.0, 60.0])
    values = rng.normal(size=count)
    lattice = Lattice.cover((*xy.min(axis=0), *xy.max(axis=0)), cell)
    mesh = Delaunay(xy - xy.mean(axis=0))
    cells = np.column_stack([g.ravel() for g in np.meshgrid(*lattice.centres())])
    expected = LinearNDInterpolator(mesh, values)(cells - xy.mean(axis=0))
    found = facets(xy, values, mesh.simplices, lattice, QUIET).ravel()
    hull = np.isnan(expected) | np.isnan(found)  # rounding may decide for a cell on the very hull
    assert np.sum(np.isnan(expected) != np.isnan(found)) <= 1
    np.testing.assert_allclose(found[~hull], expected[~hull], atol=1e-8)  # slivers lose some digits


@pytest.mark.parametrize("cell", [0.5, 0.7, 1.0, 3.0])
def test_cells_are_whole_multiples_and_cover_the_points(cell: float) -> None:
    points = cloud()
    surface = SurfaceGrid(points=points, cell=cell, method="nearest").run().surface
    for edge in surface.bounds:
        assert edge / cell == pytest.approx(round(edge / cell), abs=1e-6)
    west, south, east, north = surface.bounds
    assert west <= points["x"].min() < west + cell
    assert north - cell < points["y"].max() <= north
    assert south <= points["y"].min()
    assert east >= points["x"].max()


def test_cells_of_a_template() -> None:
    lattice = Lattice(5e5 + 3.3, 4.6e6 + 20.1, 0.7, 12, 20)
    template = Raster.from_lattice(np.zeros(lattice.shape, np.float32), lattice, crs=UTM)
    surface = SurfaceGrid(points=cloud(), template=template, cell=9.0).run().surface
    assert (surface.transform, surface.shape) == (lattice.transform, lattice.shape)
    np.testing.assert_allclose(surface.band(), plane(*centres(surface)), atol=1e-5)
    elsewhere = template.with_crs(CRS(32636))
    with pytest.raises(DataError, match=r"template: .*32636"):
        SurfaceGrid(points=cloud(), template=elsewhere)


def test_cell_in_feet_is_given_in_metres() -> None:
    foot = 1200 / 3937
    metres = cloud()
    feet = PointCloud(metres.xyz / foot, crs=CRS(2263))
    surface = SurfaceGrid(points=feet, cell=2.0).run().surface
    assert surface.cell == pytest.approx(2 / foot)
    assert surface.units == ("US survey foot",)


def test_attribute_classes_and_descriptions() -> None:
    classes = np.where(np.arange(800) % 2, 2, 6).astype(np.uint8)
    intensity = np.where(classes == 2, 100, 900).astype(np.uint16)
    points = cloud(classification=classes, intensity=intensity)
    out = SurfaceGrid(
        points=points,
        attribute=Attribute("intensity"),
        classes=ClassList([2]),
        method="idw",
    ).run()
    np.testing.assert_allclose(out.surface.band(), 100)
    assert out.surface.descriptions == ("intensity (idw)",)
    assert out.surface.crs == points.crs


def test_points_at_one_place_are_averaged_in_any_order() -> None:
    xyz = np.array([[0, 0, 1.0], [0, 0, 3], [9, 0, 2], [0, 9, 2]])
    for order in ([0, 1, 2, 3], [3, 1, 0, 2]):
        points = PointCloud(xyz[order], crs=CRS(32635))
        np.testing.assert_allclose(
            SurfaceGrid(points=points, method="nearest").run().surface.band(), 2
        )


@given(st.lists(st.tuples(*[st.integers(0, 3)] * 3), min_size=1, max_size=40), st.randoms())
def test_averaged_is_the_mean_of_each_place(rows: list[tuple[int, ...]], random: Any) -> None:
    table = np.array(rows, float) * [1, 1, 0.1]
    xy, values = averaged(table[:, :2], table[:, 2])
    expected, which = np.unique(table[:, :2], axis=0, return_inverse=True)
    np.testing.assert_array_equal(xy, expected)
    means = [table[which.ravel() == k, 2].mean() for k in range(len(expected))]
    np.testing.assert_allclose(values, means, atol=1e-12)
    order = random.sample(range(len(rows)), len(rows))
    shuffled = averaged(table[order, :2], table[order, 2])
    np.testing.assert_array_equal(shuffled[1], values)


def test_a_run_can_be_cancelled_before_it_interpolates() -> None:
    """Each stage of the preparation asks, so that no one sorts millions of points in vain."""
    seen: list[float] = []
    SurfaceGrid(points=cloud(), method="nearest").run(Context(seen.append))
    assert seen == sorted(seen)
    assert sum(fraction < 0.2 for fraction in seen) >= 4
    for count in range(4):
        answers = iter([False] * count + [True])
        with pytest.raises(Cancelled):
            SurfaceGrid(points=cloud()).run(Context(stop=lambda left=answers: next(left)))


@pytest.mark.parametrize("method", METHODS)
def test_attributes_keep_their_digits(method: Method) -> None:
    """Seconds of the GPS week plus 1e9: a 32-bit float would round them to 32."""
    time = 3e8 + plane(*cloud().xyz[:, :2].T) / 100
    points = cloud(gps_time=time, intensity=np.arange(800, dtype=np.uint16))
    found = SurfaceGrid(points=points, attribute=Attribute("gps_time"), method=method).run().surface
    x, y = centres(found)
    error = found.band() - 3e8 - plane(x, y) / 100
    assert found.values.dtype == np.float64
    assert np.nanmax(np.abs(error)) < 0.05
    for name in ("z", "intensity"):
        small = SurfaceGrid(points=points, attribute=Attribute(name), method=method).run().surface
        assert small.values.dtype == np.float32


def test_grid_is_the_tool_without_layers() -> None:
    points = cloud(200)
    surface = SurfaceGrid(points=points, method="idw", max_gap=2.0).run().surface
    found = grid(points.xyz[:, :2], points["z"], Lattice.of(surface), method="idw", max_gap=2.0)
    np.testing.assert_array_equal(found.astype(np.float32), surface.band())


def test_max_gap_leaves_far_cells_empty() -> None:
    points = cloud()
    hole = (points["x"] > 5e5 + 10) & (points["x"] < 5e5 + 30)
    out = SurfaceGrid(points=points.select(~hole), max_gap=3.0, method="idw").run()
    x, _ = centres(out.surface)
    empty = np.isnan(out.surface.band())
    assert empty[(x > 5e5 + 14) & (x < 5e5 + 26)].all()
    assert not empty[x < 5e5 + 10].any()
    assert out.filled_share == pytest.approx(1 - empty.mean())


@pytest.mark.parametrize(
    "xyz", [[[0, 0, 1]], [[0, 0, 1], [5, 5, 2]], [[0, 0, 1], [1, 1, 2], [2, 2, 4]]]
)
def test_too_few_places_for_a_triangle(xyz: list[list[float]]) -> None:
    points = PointCloud(np.array(xyz, float), crs=CRS(32635))
    with pytest.raises(DataError, match="do not span a triangle"):
        SurfaceGrid(points=points, method="linear").run()
    surface = SurfaceGrid(points=points, method="nearest").run().surface
    assert np.isfinite(surface.band()).all()


@pytest.mark.parametrize("classes", [None, ClassList([9])])
def test_no_points(classes: ClassList | None) -> None:
    points = cloud(5, classification=np.full(5, 2, np.uint8))
    points = points if classes else points.select([])
    with pytest.raises(DataError, match="points: "):
        SurfaceGrid(points=points, classes=classes).run()


def test_absurd_cell_is_refused_before_memory_is_taken() -> None:
    with pytest.raises(DataError, match="choose larger cells"):
        SurfaceGrid(points=cloud(), cell=1e-4, method="nearest").run()


@pytest.mark.parametrize("tile", ["77050_627755", "77055_627755", "77060_627760"])
def test_terrain_model_of_other_software(data: Callable[[str], Path], tile: str) -> None:
    """Linear TIN of the true ground against the mapping agency's tools: RMSE 0.04 m."""
    points = PointCloud.open(data(f"ign_urban_50m/{tile}.laz"))
    reference = Raster.open(data(f"ign_gridding_reference/DTM_{tile}.tif"))
    surface = SurfaceGrid(points=points, cell=0.5, classes=ClassList([2])).run().surface
    x, y = centres(surface)
    col = ((x - reference.transform.c) / 0.5).astype(int)
    row = ((reference.transform.f - y) / 0.5).astype(int)
    rows, cols = reference.shape
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    difference = surface.band()[inside] - reference.band()[row[inside], col[inside]]
    difference = difference[np.isfinite(difference)]
    assert len(difference) > 0.8 * rows * cols
    assert np.sqrt(np.mean(difference**2)) < 0.05
