"""surface.grid: exact on surfaces that a method can represent, and on the lattice it promises."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS
from scipy.interpolate import CloughTocher2DInterpolator, LinearNDInterpolator
from scipy.spatial import Delaunay, Voronoi, cKDTree

import toolbox
from algorithms.shared.places import averaged
from algorithms.surface import _centre_triangles
from algorithms.surface._gridding import Method, grid
from algorithms.surface._statistics import Statistic, per_cell
from algorithms.surface._tin import Tin
from algorithms.surface.grid import SurfaceGrid
from toolbox.context import Context
from toolbox.data import Lattice, PointCloud, Raster, Vector
from toolbox.declare import Attribute, ClassList, Expression, Extent
from toolbox.errors import Cancelled, DataError, NothingToDo, ParameterError

UTM = CRS(32635)
FAR = np.array([5e5, 4.6e6])
INTERPOLATE: list[Method] = ["linear", "natural", "cubic", "idw", "nearest"]
TRIANGLES: list[Method] = ["linear", "natural", "cubic"]
STATISTICS: list[Method] = ["min", "max", "mean", "median", "count", "std", "percentile"]


def plane(x: Any, y: Any) -> Any:
    return 3 + 0.25 * (x - 5e5) - 0.5 * (y - 4.6e6)


def wave(x: Any, y: Any) -> Any:
    return np.sin((x - 5e5) / 3) + np.cos((y - 4.6e6) / 4)


def cloud(n: int = 800, crs: CRS | None = UTM, **columns: Any) -> PointCloud:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(5e5, 5e5 + 40, n), rng.uniform(4.6e6, 4.6e6 + 30, n)
    return PointCloud(np.column_stack([x, y, plane(x, y)]), columns, crs=crs)


def scattered(n: int, seed: int = 0, size: float = 30.0) -> tuple[Any, Any]:
    """Places far from the origin, in the order that the tool works in, and a wavy surface."""
    xy = np.random.default_rng(seed).uniform(0, size, (n, 2)) + FAR
    return averaged(xy, wave(*xy.T))


def centres(raster: Raster) -> tuple[Any, Any]:
    return tuple(np.meshgrid(*Lattice.of(raster).centres()))  # type: ignore[return-value]


def cells(lattice: Lattice) -> Any:
    """Cell centres of shape (n, 2)."""
    return np.column_stack([g.ravel() for g in np.meshgrid(*lattice.centres())])


def surface_of(*args: Any, **settings: Any) -> Any:
    return grid(*args, **settings).surface


# What a method can represent -----------------------------------------------------------------


@pytest.mark.parametrize("method", TRIANGLES)
def test_planes_are_exact_at_the_centres_of_cells(method: Method) -> None:
    surface = SurfaceGrid(points=cloud(), method=method).run().surface
    values = surface.band()
    known = np.isfinite(values)
    assert known.mean() > 0.8
    np.testing.assert_allclose(values[known], plane(*centres(surface))[known], atol=1e-5)


def test_cubic_is_exact_on_quadratics_of_known_slope(monkeypatch: pytest.MonkeyPatch) -> None:
    """As far as the method's order goes; the slopes that it estimates are exact on planes only."""
    xy, _ = scattered(300, size=20)
    lattice = Lattice.cover((5e5 + 3, 4.6e6 + 3, 5e5 + 17, 4.6e6 + 17), 0.4)

    def bowl(places: Any) -> Any:
        x, y = (places - FAR).T
        return 1 + 0.3 * x - 0.2 * y + 0.05 * x**2 - 0.07 * x * y + 0.02 * y**2

    def slopes(tin: Tin, values: Any, **_: Any) -> Any:
        x, y = (tin.mesh.xy - FAR).T
        return np.column_stack([0.3 + 0.1 * x - 0.07 * y, -0.2 - 0.07 * x + 0.04 * y])

    true, estimated = bowl(cells(lattice)), surface_of(xy, bowl(xy), lattice, method="cubic")
    assert np.abs(estimated.ravel() - true).max() > 1e-3
    monkeypatch.setattr(Tin, "gradients", slopes)
    known = surface_of(xy, bowl(xy), lattice, method="cubic").ravel()
    np.testing.assert_allclose(known, true, atol=1e-9)


def test_errors_fall_with_density() -> None:
    """By the square of the distance, for nearest by the distance; cubic begins far lower."""
    lattice = Lattice.cover((5e5 + 5, 4.6e6 + 5, 5e5 + 25, 4.6e6 + 25), 0.5)
    true = wave(*np.meshgrid(*lattice.centres()))
    least = {"linear": 1.7, "natural": 1.7, "cubic": 1.9, "idw": 0.8, "nearest": 0.8}
    errors: dict[str, Any] = {
        method: [
            np.sqrt(np.mean((surface_of(*scattered(n), lattice, method=method) - true) ** 2))
            for n in (400, 1600, 6400)
        ]
        for method in least
    }
    for method, order in least.items():
        assert (np.log2(np.array(errors[method][:-1]) / errors[method][1:]) > order).all(), method
    assert errors["cubic"][-1] < errors["linear"][-1] / 4, errors


@pytest.mark.parametrize("method", INTERPOLATE)
def test_values_at_the_points_themselves(method: Method) -> None:
    """Points in the middle of cells: gridded input, where all triangles are doubtful."""
    lattice = Lattice(0.0, 8.0, 1.0, 8, 9)
    places = cells(lattice)
    values = np.random.default_rng(0).uniform(0, 9, len(places))
    np.testing.assert_array_equal(
        surface_of(places, values, lattice, method=method).ravel(), values
    )


# Other programs ------------------------------------------------------------------------------


@given(st.integers(0, 10_000), st.integers(3, 60), st.sampled_from([0.13, 1.0, 4.7]))
def test_linear_agrees_with_scipy(seed: int, count: int, cell: float) -> None:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 10, (count, 2)) + np.array([70.0, 60.0])
    values = rng.normal(size=count)
    lattice = Lattice.cover((*xy.min(axis=0), *xy.max(axis=0)), cell)
    origin = xy.mean(axis=0)
    expected = LinearNDInterpolator(Delaunay(xy - origin), values)(cells(lattice) - origin)
    found = surface_of(xy, values, lattice).ravel()
    either = np.isnan(expected) | np.isnan(found)  # Qhull leaves out slivers at the hull
    assert np.sum(np.isnan(expected) != np.isnan(found)) <= 1
    np.testing.assert_allclose(found[~either], expected[~either], atol=1e-8)  # of slivers


def test_linear_agrees_with_scipy_on_many_points() -> None:
    xy, values = scattered(5000)
    lattice = Lattice.cover((*xy.min(axis=0), *xy.max(axis=0)), 0.3)
    origin = xy.mean(axis=0)
    expected = LinearNDInterpolator(Delaunay(xy - origin), values)(cells(lattice) - origin)
    np.testing.assert_allclose(surface_of(xy, values, lattice).ravel(), expected, atol=1e-9)


def crowded(kind: str, seed: int) -> Any:
    """Many points per cell of 2 m: with gaps, in rows, on a lattice, crowded, or thinned."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 60, (12_000, 2))
    if kind == "crowded":
        return rng.normal(size=xy.shape) * [12, 3] @ [[0.8, 0.6], [-0.6, 0.8]] + 30
    if kind == "in rows":
        return np.column_stack([1.1 * np.round(xy[:, 0] / 1.1), xy[:, 1]])
    if kind == "thinned":
        thin = np.floor(xy / 3) % 2 == 0
        return xy[thin.all(axis=1) | (rng.random(len(xy)) < 0.04)]
    gaps = np.hypot(*(xy - 30).T) > 9
    gaps &= (xy.sum(axis=1) > 35) & (abs(xy[:, 0] % 7 - 3) > 0.6)
    return np.round(2 * xy[gaps]) / 2 if kind == "on a lattice" else xy[gaps]


@pytest.mark.parametrize("limit", [math.inf, 6.0])
@pytest.mark.parametrize("kind", ["gaps", "in rows", "on a lattice", "crowded", "thinned"])
def test_triangles_of_centres_alone_are_those_of_all_points(kind: str, limit: float) -> None:
    # With support all triangles are made.
    for seed in range(3):
        xy = crowded(kind, seed) + FAR
        values = np.random.default_rng(seed).normal(size=len(xy))
        for cell, shift in (2.0, 0.0), (2.3, 0.1), (5.0, 0.25):
            low = FAR + shift
            lattice = Lattice.cover((*low, *(low + 60)), cell)
            found, whole = (
                grid(xy, values, lattice, max_gap=limit, support=all_of_them).surface
                for all_of_them in (False, True)
            )
            np.testing.assert_array_equal(found, whole)
            assert np.isfinite(found).mean() > 0.2


@pytest.mark.parametrize(
    ("middle", "radius", "turns", "place"),
    [
        # A corner two squares beyond the nearest 2 x 2 empty ones, and six from the centre.
        ((20.0, 20.0), 6.02, (0, 120, 240), (20.5, 20.3)),
        # No 2 x 2 squares are empty; the circle reaches 3.6 squares from the centre.
        ((20.5, 20.5), 2.05, (0, 150, 210), (18.9, 20.5)),
    ],
)
def test_corners_far_from_a_centre_are_those_of_all_points(
    middle: tuple[float, float], radius: float, turns: tuple[int, ...], place: tuple[float, float]
) -> None:
    """Squares have a side of 1; all that are not within the circle hold a point outside of it."""
    rng = np.random.default_rng(0)
    across, up = (a.ravel() for a in np.meshgrid(np.arange(40), np.arange(40)))
    inner = np.column_stack([across, up]) + rng.uniform(0.4, 0.6, (1600, 2))
    away = inner - middle
    outer = np.floor(inner) + np.where(away > 0, 0.99, 0.01)  # of each square what is farthest
    spare = rng.uniform(0, 40, (6000, 2))
    inside = np.hypot(*(outer - middle).T) < radius + 0.01  # squares that stay empty
    angle = np.radians(turns)
    on_circle = np.column_stack([np.cos(angle), np.sin(angle)]) * radius + middle
    xy = np.vstack([[[0, 0], [40, 40]], on_circle, outer[~inside], spare])
    far = np.hypot(*(xy - middle).T) > radius + 0.01
    far[:5] = True
    xy = xy[far][:4800]  # three points to a square
    values = rng.normal(size=len(xy))
    lattice = Lattice(place[0] - 0.5, place[1] + 0.5, 1.0, 1, 1)
    found, whole = (
        grid(xy, values, lattice, support=all_of_them).surface for all_of_them in (False, True)
    )
    np.testing.assert_array_equal(found, whole)


@pytest.mark.parametrize("seed", [73, 277, 326])
def test_small_triangles_beside_an_empty_quarter_are_those_of_all_points(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    monkeypatch.setattr(_centre_triangles, "MANY", 0.0)
    monkeypatch.setattr(_centre_triangles, "MOST", 1.1)
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 40, (3000, 2))
    kept = np.ones(len(xy), bool)
    for _ in range(40):
        from_middle, square, size = (
            xy - rng.uniform(0, 40, 2),
            rng.integers(3) == 0,
            rng.uniform(1, 5),
        )
        angle = rng.uniform(0, 6.3)
        turn = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
        if square:
            kept &= (abs(from_middle @ turn) >= [size, rng.uniform(0.5, 5)]).any(axis=1)
        else:
            kept &= np.hypot(*(from_middle @ turn).T) >= rng.uniform(1, 3)
    xy = xy[kept]
    values, lattice = rng.normal(size=len(xy)), Lattice.cover((0, 0, 40, 40), 0.5)
    np.testing.assert_array_equal(
        grid(xy, values, lattice).surface, grid(xy, values, lattice, support=True).surface
    )


def test_points_of_one_place_or_line_are_no_surface() -> None:
    lattice = Lattice.cover((0, 0, 20, 20), 2.0)
    for xy in (np.zeros((900, 2)), np.repeat(np.arange(900.0) / 50, 2).reshape(-1, 2)):
        with pytest.raises(DataError, match="do not span a triangle"):
            grid(xy, np.ones(900), lattice)
        assert np.isnan(grid(xy, np.ones(900), lattice, max_gap=5.0).surface).all()


def test_cubic_agrees_with_scipy() -> None:
    """With scipy's gradients iterated to the end; by default it stops at 1e-6."""
    xy, values = scattered(2000)
    lattice = Lattice.cover((*xy.min(axis=0), *xy.max(axis=0)), 0.3)
    origin = xy.mean(axis=0)
    mesh = Delaunay(xy - origin)
    scipy = CloughTocher2DInterpolator(mesh, values, tol=1e-14, maxiter=1000)
    expected = scipy(cells(lattice) - origin)
    found = surface_of(xy, values, lattice, method="cubic").ravel()
    assert np.isfinite(expected).mean() > 0.9
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_natural_is_the_area_taken_from_voronoi_cells() -> None:
    """Against polygons that are cut by another library."""
    xy, values = scattered(150, size=10)
    xy, frame = xy - [5e5, 4.6e6], np.array([[-500.0, 5], [500, 5], [5, 500], [5, -500]])
    lattice = Lattice.cover((3, 3, 7, 7), 0.5)
    found = surface_of(xy, values, lattice, method="natural").ravel()
    old = [voronoi_cell(np.vstack([xy, frame]), i) for i in range(len(xy))]
    for place, value in zip(cells(lattice), found, strict=True):
        new = voronoi_cell(np.vstack([xy, frame, [place]]), len(xy) + len(frame))
        taken = shapely.area(shapely.intersection(new, old))
        assert value == pytest.approx(taken @ values / new.area, abs=1e-10)


def voronoi_cell(sites: Any, i: int) -> Any:
    diagram = Voronoi(sites)
    region = diagram.regions[diagram.point_region[i]]
    if -1 in region:
        return shapely.box(1e6, 1e6, 1e6 + 1, 1e6 + 1)  # at the frame, far from all places
    return shapely.Polygon(diagram.vertices[region])


@given(st.integers(0, 10_000), st.integers(4, 30))
def test_natural_takes_areas_however_few_points(seed: int, count: int) -> None:
    """Against cut polygons, where the Voronoi cell of the centre ends well before the frame."""
    rng = np.random.default_rng(seed)
    xy, far = rng.uniform(0, 10, (count, 2)), 1e4
    xy, values = averaged(xy, rng.normal(size=count))
    frame = far * np.array([[-1.0, 0.1], [1.1, 0], [0, 1.2], [0.1, -1]])
    lattice = Lattice(0.13, 9.7, 2.1, 5, 5)
    found = surface_of(xy, values, lattice, method="natural").ravel()
    old = [voronoi_cell(np.vstack([xy, frame]), i) for i in range(count)]
    for place, value in zip(cells(lattice), found, strict=True):
        new = voronoi_cell(np.vstack([xy, frame, [place]]), count + len(frame))
        if np.abs(new.bounds).max() < 50:
            taken = shapely.area(shapely.intersection(new, old))
            assert value == pytest.approx(taken @ values / new.area, abs=1e-7)


@pytest.mark.parametrize(
    "settings",
    [
        {"method": "nearest"},
        {"method": "idw"},
        {"method": "idw", "neighbours": 3, "power": 1.3, "smoothing": 0.4},
        {"method": "idw", "radius": 1.1, "power": 3.0},
        {"method": "idw", "radius": 2.0, "max_gap": 0.6},
    ],
    ids=str,
)
@pytest.mark.parametrize("spread", ["even", "crowded", "gridded"])
def test_distances_agree_with_a_plain_loop(settings: dict[str, Any], spread: str) -> None:
    xy, _ = scattered(400)
    if spread == "crowded":
        xy[50:] = xy[50:] / 300 + np.array([5e5, 4.6e6]) * 299 / 300
    elif spread == "gridded":
        xy = np.round(xy)
    values = np.random.default_rng(1).normal(size=len(xy))
    xy, values = averaged(xy, values)
    lattice = Lattice.cover((*(xy.min(axis=0) - 3), *(xy.max(axis=0) + 3)), 1.0)
    expected = [plain(xy, values, place, **settings) for place in cells(lattice)]
    found = surface_of(xy, values, lattice, **settings).ravel()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    if settings["method"] == "nearest":
        np.testing.assert_array_equal(found, expected)


def plain(
    xy: Any,
    values: Any,
    place: Any,
    method: str = "idw",
    neighbours: int = 12,
    power: float = 2.0,
    smoothing: float = 0.0,
    radius: float = math.inf,
    max_gap: float = math.inf,
) -> float:
    square = ((xy - place) ** 2).sum(axis=1)
    order = np.argsort(square, kind="stable")[: 1 if method == "nearest" else neighbours]
    order = order[square[order] <= radius**2]
    if not len(order) or square[order[0]] > max_gap**2:
        return math.nan
    if square[order[0]] + smoothing == 0 or method == "nearest":
        return float(values[order[0]])
    weight = np.sqrt(square[order] + smoothing**2) ** -power
    return float(weight @ values[order] / weight.sum())


def test_the_lowest_and_the_highest_are_the_ends_of_what_is_sorted() -> None:
    """In cells without points as well, and with points beyond the raster."""
    rng = np.random.default_rng(8)
    xy, values = rng.uniform(-3, 13, (60, 2)), rng.normal(0, 9, 60)
    lattice = Lattice.cover((0, 0, 10, 10), 2.0)
    ways: list[tuple[Statistic, float]] = [("min", 0.0), ("max", 100.0)]
    for statistic, percentile in ways:
        got = per_cell(xy, values, lattice, statistic)
        wanted = per_cell(xy, values, lattice, "percentile", percentile=percentile)
        for one, other in zip(got, wanted, strict=True):
            np.testing.assert_array_equal(one, other)
            assert one.dtype == other.dtype
    assert 0 < np.count_nonzero(np.isnan(got[0])) < 20
    assert got[1].sum() < 60


def test_statistics_of_each_cell() -> None:
    rng = np.random.default_rng(2)
    xy, values = rng.uniform(0, 9, (500, 2)), rng.normal(1e6, 1, 500)
    lattice = Lattice.cover((0, 0, 10, 9), 1.0)
    row, col = lattice.indices(*xy.T)
    numpy: dict[Method, Any] = {name: getattr(np, name) for name in STATISTICS[:4]}
    numpy |= {"std": np.std, "count": len, "percentile": lambda v: np.percentile(v, 30)}
    for method, function in numpy.items():
        found = surface_of(xy, values, lattice, method=method, percentile=30.0)
        for r in range(lattice.rows):
            for c in range(lattice.cols):
                inside = values[(row == r) & (col == c)]
                empty = 0 if method == "count" else np.nan
                expected = function(inside) if len(inside) else empty
                np.testing.assert_allclose(found[r, c], expected, rtol=1e-15, atol=1e-12)


REFERENCE_OFFSET = (0.25, -0.25)  # of these rasters: pixel centres lie on whole half metres
MODELS: dict[str, tuple[list[int], float, float]] = {  # classes, and shares of cells within 1 mm
    "DTM": ([2], 0.95, 0.99),
    "DSM": ([2, 3, 4, 5, 6], 0.98, 0.985),
}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("tile", ["77050_627755", "77055_627755", "77060_627760"])
def test_models_of_other_software(data: Callable[[str], Path], tile: str, model: str) -> None:
    """Linear, of the mapping agency, within 1 mm, but at the edges, where they had more points."""
    classes, everywhere, inside = MODELS[model]
    points = PointCloud.open(data(f"ign_urban_50m/{tile}.laz"))
    reference = Raster.open(data(f"ign_gridding_reference/{model}_{tile}.tif"))
    chosen = points.xyz[np.isin(points["classification"], classes)]
    found = surface_of(chosen[:, :2] - REFERENCE_OFFSET, chosen[:, 2], Lattice.of(reference))
    apart = np.abs(found - reference.band())
    assert np.isfinite(apart).mean() > 0.97
    for shown, least in ((apart, everywhere), (apart[10:-10, 10:-10], inside)):
        assert np.mean(shown[np.isfinite(shown)] < 0.001) > least


@pytest.mark.parametrize("tile", ["77050_627755", "77055_627755", "77060_627760"])
@pytest.mark.parametrize("method", ["linear", "natural"])
def test_terrain_model_where_it_says_it_lies(
    data: Callable[[str], Path], tile: str, method: Method
) -> None:
    """A quarter of a metre off in place: RMSE 0.03 to 0.04 m."""
    points = PointCloud.open(data(f"ign_urban_50m/{tile}.laz"))
    reference = Raster.open(data(f"ign_gridding_reference/DTM_{tile}.tif"))
    surface = SurfaceGrid(points=points, cell=0.5, classes=ClassList([2]), method=method)
    found = surface.run().surface.sample(*centres(reference))
    difference = (found - reference.band())[np.isfinite(found) & np.isfinite(reference.band())]
    assert difference.size > 0.8 * reference.band().size
    assert np.sqrt(np.mean(difference**2)) < 0.04


# The same whatever the order, the tile, the threads --------------------------------------------


def holey(seed: int) -> tuple[Any, Any]:
    """60 x 12: random, gridded and doubled places, with a hole, and sparse in the east."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, (60, 12), (3000, 2))
    xy[:800] = np.round(xy[:800] * 2) / 2
    sparse = (xy[:, 0] > 36) & (rng.random(3000) > 0.08)
    xy = xy[(np.hypot(*(xy - [30, 6]).T) > 4) & ~sparse] + FAR
    return xy, np.sin(7 * xy[:, 0]) + np.cos(5 * xy[:, 1])


EXACT: list[dict[str, Any]] = [
    *({"method": method} for method in STATISTICS),
    {"method": "mean", "support": True},
    {"method": "nearest", "max_gap": 2.0, "support": True, "uncertainty": True},
    {"method": "idw", "radius": 2.0, "support": True, "uncertainty": True},
    {"method": "linear", "max_gap": 2.0, "support": True, "uncertainty": True},
    {"method": "natural", "max_gap": 2.0, "support": True, "uncertainty": True},
    {"method": "cubic", "max_gap": 0.4, "support": True, "uncertainty": True},
]


@pytest.mark.parametrize("settings", EXACT, ids=str)
def test_tiles_are_the_whole_to_the_last_bit(settings: dict[str, Any]) -> None:
    xy, values = holey(0)
    points = PointCloud(np.column_stack([xy, values]), crs=UTM)
    whole = SurfaceGrid(points=points, cell=0.5, **settings)
    surface = whole.run().surface
    x, _ = Lattice.of(surface).centres()
    for west, east in pairwise(5e5 + np.array([-1, 17.3, 31, 44, 61])):
        reach = whole.halo()
        near = points.select((xy[:, 0] >= west - reach) & (xy[:, 0] < east + reach))
        box = Extent(*surface.bounds)
        tile = SurfaceGrid(points=near, cell=0.5, extent=box, **settings).run().surface
        core = (x >= west) & (x < east)
        np.testing.assert_array_equal(tile.values[:, :, core], surface.values[:, :, core])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["linear", "natural", "idw", "nearest"])
@pytest.mark.parametrize("uncertainty", [False, True])
def test_halo_is_enough_and_not_too_much_where_points_are_few(
    method: Method, uncertainty: bool
) -> None:
    """Of 200 cuts through points about as far apart as the largest gap, some need the halo."""
    limit: dict[str, Any] = {"radius" if method == "idw" else "max_gap": 2.0}
    settings: Any = {"method": method, "uncertainty": uncertainty}
    reach = SurfaceGrid(points=cloud(), **settings, **limit).halo()
    west = Lattice(0.0, 12.0, 0.5, 24, 20)
    noticed = 0
    for seed in range(200):
        xy = np.random.default_rng(seed).uniform(0, (26, 12), (80, 2))
        xy[:40] = np.round(xy[:40])
        values = np.sin(7 * xy[:, 0]) + np.cos(5 * xy[:, 1])
        whole, tile, less = (
            grid(xy[near], values[near], west, **settings, **limit)
            for near in (xy[:, 0] < 10 + share * reach for share in (9.0, 1.0, 0.6))
        )
        for here, there, cut in zip(whole, tile, less, strict=True):
            if here is not None and there is not None:
                np.testing.assert_array_equal(here, there)
                noticed += not np.array_equal(here, cut, equal_nan=True)  # type: ignore[arg-type]
    assert noticed > 0


@pytest.mark.parametrize("method", [*INTERPOLATE, *STATISTICS])
def test_any_order_of_points_gives_the_same_bits(method: Method) -> None:
    xy, values = holey(1)
    lattice = Lattice.cover((*xy.min(axis=0), *xy.max(axis=0)), 0.5)
    more = {"support": True, "uncertainty": method not in STATISTICS}
    order = np.random.default_rng(2).permutation(len(xy))
    straight = grid(xy, values, lattice, method=method, **more)
    shuffled = grid(xy[order], values[order], lattice, method=method, **more)
    for here, there in zip(straight, shuffled, strict=True):
        assert here is there is None or np.array_equal(here, there, equal_nan=True)  # type: ignore[arg-type]


# Cells ---------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("method", ["linear", "mean"])
def test_only_cells_near_the_window_are_filled(method: Method) -> None:
    points = cloud()
    west, south, _, east, north, _ = points.bounds
    template = SurfaceGrid(points=points, cell=1.0).run().surface
    tool = SurfaceGrid(points=points, template=template, method=method, max_gap=None)
    whole = tool.run().surface
    window = west + 3.0, south + 2.0, west + 7.0, south + 5.0
    part = tool.run(Context(window=window)).surface
    assert part.values.size < 60
    row, col = Lattice.of(whole).position_of(Lattice.of(part))
    inner = whole.values[:, row : row + part.shape[0], col : col + part.shape[1]]
    np.testing.assert_array_equal(part.values, inner)
    with pytest.raises(NothingToDo, match="no cell of the raster"):
        tool.run(Context(window=(east + 9.0, south, east + 99.0, north)))


def test_cells_of_a_template() -> None:
    lattice = Lattice(5e5 + 3.3, 4.6e6 + 20.1, 0.7, 12, 20)
    template = Raster.from_lattice(np.zeros(lattice.shape, np.float32), lattice, crs=UTM)
    surface = SurfaceGrid(points=cloud(), template=template, cell=9.0).run().surface
    assert (surface.transform, surface.shape) == (lattice.transform, lattice.shape)
    np.testing.assert_allclose(surface.band(), plane(*centres(surface)), atol=1e-5)
    elsewhere = template.with_crs(CRS(32636))
    with pytest.raises(DataError, match=r"template: .*32636"):
        SurfaceGrid(points=cloud(), template=elsewhere)
    with pytest.raises(DataError, match="extent: a template has its own"):
        SurfaceGrid(points=cloud(), template=template, extent=Extent(0, 0, 1, 1))


@pytest.mark.parametrize("method", [*INTERPOLATE, "mean"])
def test_extent_is_a_window_of_the_whole(method: Method) -> None:
    """Points around it count, as far as they matter."""
    points = cloud()
    limit = {"radius" if method == "idw" else "max_gap": 2.5}
    settings: Any = {"method": method} | ({} if method == "mean" else limit)
    whole = SurfaceGrid(points=points, **settings).run().surface
    box = Extent(5e5 + 10, 4.6e6 + 4.4, 5e5 + 18.5, 4.6e6 + 12)
    window = SurfaceGrid(points=points, extent=box, **settings).run().surface
    assert window.bounds == (5e5 + 10, 4.6e6 + 4, 5e5 + 19, 4.6e6 + 12)
    np.testing.assert_array_equal(window.band(), whole.sample(*centres(window)))
    away = Extent(6e5, 4.6e6, 6e5 + 5, 4.6e6 + 5)
    out = SurfaceGrid(points=points, extent=away, **settings).run()
    assert out.filled_share == 0


def test_cell_in_feet_is_given_in_metres() -> None:
    foot = 1200 / 3937
    metres = cloud()
    feet = PointCloud(metres.xyz / foot, crs=CRS(2263))
    surface = SurfaceGrid(points=feet, cell=2.0).run().surface
    assert surface.cell == pytest.approx(2 / foot)
    assert surface.units == ("US survey foot",)


def test_absurd_cell_is_refused_before_memory_is_taken() -> None:
    with pytest.raises(DataError, match="choose larger cells"):
        SurfaceGrid(points=cloud(), cell=1e-4, method="nearest").run()


# Points --------------------------------------------------------------------------------------


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


def test_returns_and_condition_choose_points() -> None:
    number = (np.arange(800) % 2 + 1).astype(np.uint8)
    columns = {"return_number": number, "number_of_returns": np.full(800, 2, np.uint8)}
    points = cloud(**columns, intensity=np.arange(800, dtype=np.uint16))

    def taken(**choice: Any) -> int:
        out = SurfaceGrid(points=points, method="count", **choice).run()
        return int(out.surface.band().sum())

    assert taken() == 800
    assert taken(returns="last") == 400
    assert taken(where=Expression("intensity < 100")) == 100
    assert taken(returns="last", where=Expression("intensity < 100")) == 50
    with pytest.raises(DataError, match=r"returns: .* has no return numbers"):
        SurfaceGrid(points=cloud(), returns="last")
    with pytest.raises(DataError, match="there are none to grid"):
        taken(where=Expression("intensity > 1000"))


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


@pytest.mark.parametrize("method", [*INTERPOLATE, "mean"])
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


@pytest.mark.parametrize(
    "xyz", [[[0, 0, 1]], [[0, 0, 1], [5, 5, 2]], [[0, 0, 1], [1, 1, 2], [2, 2, 4]]]
)
def test_too_few_places_for_a_triangle(xyz: list[list[float]]) -> None:
    points = PointCloud(np.array(xyz, float), crs=CRS(32635))
    for method in TRIANGLES:
        with pytest.raises(DataError, match="do not span a triangle, which"):
            SurfaceGrid(points=points, method=method).run()
        assert SurfaceGrid(points=points, method=method, max_gap=9.0).run().filled_share == 0
    for method in (*INTERPOLATE[3:], *STATISTICS):
        surface = SurfaceGrid(points=points, method=method, support=True).run().surface
        assert np.isfinite(surface.band()).any()


@pytest.mark.parametrize("classes", [None, ClassList([9])])
def test_no_points(classes: ClassList | None) -> None:
    points = cloud(5, classification=np.full(5, 2, np.uint8))
    points = points if classes else points.select([])
    with pytest.raises(DataError, match="points: "):
        SurfaceGrid(points=points, classes=classes).run()


def test_values_that_are_not_finite_are_refused() -> None:
    points = cloud(reflectance=np.r_[np.nan, np.zeros(799)])
    with pytest.raises(DataError, match="'reflectance' holds values that are not finite"):
        SurfaceGrid(points=points, attribute=Attribute("reflectance")).run()


# Where the surface ends ------------------------------------------------------------------------


@pytest.mark.parametrize("method", INTERPOLATE)
def test_max_gap_leaves_far_cells_empty(method: Method) -> None:
    points = cloud()
    hole = (points["x"] > 5e5 + 10) & (points["x"] < 5e5 + 30)
    out = SurfaceGrid(points=points.select(~hole), max_gap=3.0, method=method).run()
    x, y = centres(out.surface)
    empty = np.isnan(out.surface.band())
    assert empty[(x > 5e5 + 14) & (x < 5e5 + 26)].all()
    inner = (x < 5e5 + 8) & (x > 5e5 + 2) & (y > 4.6e6 + 2) & (y < 4.6e6 + 28)
    assert not empty[inner].any()
    assert out.filled_share == pytest.approx(1 - empty.mean())


def test_gap_is_the_largest_circle_without_points() -> None:
    xy = np.array([[0.0, 0], [10, 0], [0, 10], [10, 10]])  # one circle of radius 7.07
    lattice = Lattice.cover((0, 0, 10, 10), 1.0)
    for max_gap, filled in [(7.0, 0.0), (7.1, 1.0)]:
        found = surface_of(xy, xy[:, 0], lattice, max_gap=max_gap)
        assert np.isfinite(found).mean() == filled


def test_clip_empties_all_bands_outside_the_polygon() -> None:
    triangle = shapely.Polygon([(5e5 + 5, 4.6e6 + 5), (5e5 + 35, 4.6e6 + 5), (5e5 + 5, 4.6e6 + 25)])
    clip = Vector(geopandas.GeoDataFrame(geometry=[triangle], crs=UTM), name="clip.gpkg")
    surface = SurfaceGrid(points=cloud(), clip=clip, support=True).run().surface
    inside = shapely.intersects_xy(triangle, *centres(surface))
    for band in (1, 2, 3):
        np.testing.assert_array_equal(np.isfinite(surface.band(band)), inside)
    line = Vector(geopandas.GeoDataFrame(geometry=[triangle.exterior], crs=UTM), name="l.gpkg")
    with pytest.raises(DataError, match=r"clip: must be polygons, l\.gpkg holds a Line"):
        SurfaceGrid(points=cloud(), clip=line).run()
    bow = shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])
    crossed = Vector(geopandas.GeoDataFrame(geometry=[bow], crs=UTM), name="b.gpkg")
    with pytest.raises(DataError, match=r"clip: a polygon of b\.gpkg is not valid"):
        SurfaceGrid(points=cloud(), clip=crossed).run()


def layer(*shapes: Any) -> Vector:
    return Vector(geopandas.GeoDataFrame(geometry=list(shapes), crs=UTM), name="shapes.gpkg")


def ridge(n: int = 1500) -> PointCloud:
    """A roof-shaped surface whose top runs along x = 20, with points 0.4 away from it at least."""
    points = cloud(n)
    x = points["x"] - 5e5
    points = points.select(abs(x - 20) > 0.4)
    xyz = points.xyz.copy()
    xyz[:, 2] = 10 - abs(xyz[:, 0] - 5e5 - 20)
    return points.with_xyz(xyz)


def test_breaklines_make_edges() -> None:
    """Without the top line, triangles cut the ridge off."""
    points = ridge()
    top = layer(shapely.LineString([(5e5 + 20, 4.6e6 - 5, 10), (5e5 + 20, 4.6e6 + 35, 10)]))
    blunt, sharp = (
        SurfaceGrid(points=points, cell=0.5, breaklines=lines).run().surface
        for lines in (None, top)
    )
    for surface, worst in [(blunt, 0.3), (sharp, 1e-5)]:
        x, y = centres(surface)
        away = abs(x - 5e5 - 20)
        inside = (away < 10) & (abs(y - 4.6e6 - 15) < 13)
        error = abs(surface.band() - (10 - away))[inside].max()
        assert error > worst if surface is blunt else error < worst


def test_exclusions_that_hold_all_points_are_to_blame() -> None:
    everywhere = shapely.box(4e5, 4e6, 6e5, 5e6)
    layer = Vector(geopandas.GeoDataFrame(geometry=[everywhere], crs=UTM))
    with pytest.raises(DataError, match="exclusions: hold all points"):
        SurfaceGrid(points=cloud(), exclusions=layer).run()
    out = SurfaceGrid(points=cloud(), exclusions=layer, max_gap=5.0).run()
    assert out.filled_share == 0


@pytest.mark.parametrize("apart", [0.0, 2.0])
def test_breaklines_that_meet_at_other_heights_are_named(
    apart: float, caplog: pytest.LogCaptureFixture
) -> None:
    x, y = 5e5 + 10, 4.6e6 + 10
    one = shapely.LineString([(x, y, 5), (x + 10, y + 10, 7)])
    other = shapely.LineString([(x, y + 10, 4 + apart), (x + 10, y, 8 + apart)])
    lines = Vector(geopandas.GeoDataFrame(geometry=[one, other], crs=UTM))
    SurfaceGrid(points=cloud(), breaklines=lines).run()
    text = "breaklines meet at different heights in 1 places, by 2 m at 500015, 4600015"
    assert (text in caplog.text) == bool(apart)


@pytest.mark.parametrize("name", ["breaklines", "exclusions"])
def test_a_vertex_without_a_height_is_no_breakline(name: str) -> None:
    x, y = 5e5 + 10, 4.6e6 + 10
    corners = [(x, y, 5), (x + 10, y, 5), (x + 10, y + 9, math.nan), (x, y + 9, 5)]
    shape = shapely.LineString(corners) if name == "breaklines" else shapely.Polygon(corners)
    layer = Vector(geopandas.GeoDataFrame(geometry=[shape], crs=UTM), name="s.gpkg")
    with pytest.raises(DataError, match=f"{name}: a vertex of s.gpkg has no height, at 5000"):
        SurfaceGrid(points=cloud(), **{name: layer}).run()  # type: ignore[arg-type]


def test_points_beside_a_breakline_give_way() -> None:
    """Points within a quarter of a cell of the middles of its pieces would cut the edge."""
    points, y = ridge(), np.arange(4.6e6 + 5.25, 4.6e6 + 25, 0.5)
    spikes = np.column_stack([np.full(len(y), 5e5 + 20.2), y, np.full(len(y), 50)])
    top = layer(shapely.LineString([(5e5 + 20, 4.6e6 - 5, 10), (5e5 + 20, 4.6e6 + 35, 10)]))
    spiky = PointCloud(np.vstack([points.xyz, spikes]), crs=UTM)
    heights = [
        np.nanmax(SurfaceGrid(points=spiky, breaklines=lines).run().surface.band())
        for lines in (None, top)
    ]
    assert heights[0] > 15
    assert heights[1] <= 10


def test_a_lake_has_one_level_and_a_footprint_none_of_its_points() -> None:
    points = cloud(3000)
    lake_xy = shapely.Point(5e5 + 12, 4.6e6 + 15).buffer(7)
    lake = shapely.force_3d(lake_xy, z=-2.5)
    house = shapely.box(5e5 + 25, 4.6e6 + 10, 5e5 + 30, 4.6e6 + 15)
    x, y = points["x"], points["y"]
    xyz = points.xyz.copy()
    inside = shapely.contains_xy(house, x, y)
    xyz[inside, 2] += 50
    out = SurfaceGrid(points=points.with_xyz(xyz), exclusions=layer(lake, house), max_gap=4.0)
    surface = out.run().surface
    band, (x, y) = surface.band(), centres(surface)
    wet = shapely.contains_xy(lake_xy, x, y)
    np.testing.assert_array_equal(band[wet], -2.5)
    dry = ~shapely.contains_xy(lake_xy.buffer(2), x, y) & np.isfinite(band)
    np.testing.assert_allclose(band[dry], plane(x, y)[dry], atol=1e-5)
    assert np.isfinite(band[shapely.contains_xy(house, x, y)]).all()


def test_shapes_are_for_heights_and_linear() -> None:
    line = layer(shapely.LineString([(5e5, 4.6e6, 1), (5e5 + 9, 4.6e6, 1)]))
    with pytest.raises(DataError, match="breaklines: are for heights and method linear"):
        SurfaceGrid(points=cloud(), breaklines=line, method="idw")
    flat = layer(shapely.LineString([(5e5, 4.6e6), (5e5 + 9, 4.6e6)]))
    with pytest.raises(DataError, match=r"breaklines: a line of shapes\.gpkg has no heights"):
        SurfaceGrid(points=cloud(), breaklines=flat).run()
    with pytest.raises(DataError, match="exclusions: must be polygons"):
        SurfaceGrid(points=cloud(), exclusions=line).run()


# Support and uncertainty -----------------------------------------------------------------------


def test_support_is_points_used_and_distance() -> None:
    points = cloud()
    xy = points.xyz[:, :2]
    used: dict[Method, Any] = {"linear": 3, "cubic": 3, "idw": 12, "nearest": 1}
    for method in (*INTERPOLATE, "mean"):
        surface = SurfaceGrid(points=points, method=method, support=True).run().surface
        names = (f"z ({method})", "points used", "distance to the nearest point")
        assert surface.descriptions == names
        filled = np.isfinite(surface.band())
        distance, _ = cKDTree(xy).query(np.column_stack([g[filled] for g in centres(surface)]))
        np.testing.assert_allclose(surface.band(3)[filled], distance, atol=1e-5)
        assert np.isnan(surface.band(3)[~filled]).all()
        if method in used:
            assert (surface.band(2)[filled] == used[method]).all()
    natural = SurfaceGrid(points=points, method="natural", support=True).run().surface.band(2)
    assert 5 < natural[natural > 0].mean() < 7  # six neighbours on average (Euler)


@pytest.mark.parametrize("method", INTERPOLATE)
def test_uncertainty_is_the_error_without_a_point(method: Method) -> None:
    """Nothing on a plane, for the methods that know planes; the size of the noise on noise."""
    points, noise = cloud(2000), np.random.default_rng(0).normal(0, 0.1, 2000)
    more: Any = {"uncertainty": True, "method": method}
    band = SurfaceGrid(points=points, **more).run().surface.band(2)
    assert np.isfinite(band).mean() > 0.8
    if method in TRIANGLES:
        assert np.nanmax(band) < 1e-5
    rough = points.with_xyz(points.xyz * [1, 1, 0] + np.outer(noise, [0, 0, 1]))
    surface = SurfaceGrid(points=rough, **more).run().surface
    assert surface.descriptions[1] == "error without the points used"
    assert 0.09 < np.sqrt(np.nanmean(surface.band(2) ** 2)) < 0.16


def test_leaving_out_is_really_leaving_out() -> None:
    xy, values = scattered(60, size=8)
    for k in (11, 23, 37):
        lattice = Lattice(xy[k, 0] - 0.5, xy[k, 1] + 0.5, 1.0, 1, 1)  # its centre is point k
        error = grid(xy, values, lattice, uncertainty=True).error
        rest = np.arange(len(xy)) != k
        origin = xy.mean(axis=0)
        without = LinearNDInterpolator(Delaunay(xy[rest] - origin), values[rest])(*(xy[k] - origin))
        assert error is not None
        assert error[0, 0] == pytest.approx(abs(float(without) - values[k]), abs=1e-9)


# Being a good tool -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"method": "mean", "max_gap": 1.0}, "max_gap: is for interpolation"),
        ({"method": "mean", "uncertainty": True}, "uncertainty: is for interpolation"),
        ({"method": "linear", "radius": 1.0}, "radius: is for method idw"),
        ({"method": "nearest", "smoothing": 1.0}, "smoothing: is for method idw"),
    ],
)
def test_settings_that_mean_nothing_are_refused(settings: Any, problem: str) -> None:
    with pytest.raises(ParameterError, match=problem):
        SurfaceGrid(points=cloud(), **settings)


@pytest.mark.parametrize("method", [*INTERPOLATE, "median"])
def test_a_run_can_be_cancelled_at_any_time(method: Method) -> None:
    seen: list[float] = []
    more: Any = {"support": True, "uncertainty": method != "median"}
    SurfaceGrid(points=cloud(), method=method, **more).run(Context(seen.append))
    assert seen == sorted(seen)
    assert sum(fraction < 0.2 for fraction in seen) >= 4
    for count in range(0, len(seen), 5):
        answers = iter([False] * count + [True])
        with pytest.raises(Cancelled):
            SurfaceGrid(points=cloud(), method=method, **more).run(
                Context(stop=lambda left=answers: next(left, True))
            )


def test_grid_is_the_tool_without_layers() -> None:
    points = cloud(200)
    surface = SurfaceGrid(points=points, method="idw", max_gap=2.0).run().surface
    found = grid(points.xyz[:, :2], points["z"], Lattice.of(surface), method="idw", max_gap=2.0)
    np.testing.assert_array_equal(found.surface.astype(np.float32), surface.band())


def test_cells_too_small_for_the_points_are_told(caplog: pytest.LogCaptureFixture) -> None:
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 40, 2.0), np.arange(0, 40, 2.0)))
    cloud = PointCloud(np.column_stack([x, y, x]), crs=CRS(32635))
    told = "choose larger cells"
    for cell, method in ((2.0, "max"), (1.0, "linear"), (4.0, "count")):
        toolbox.run("surface.grid", {"points": cloud, "cell": cell, "method": method})
        assert told not in caplog.text, (cell, method)
    for method in ("max", "count"):
        caplog.clear()
        toolbox.run("surface.grid", {"points": cloud, "cell": 1.0, "method": method})
        assert told in caplog.text, method
