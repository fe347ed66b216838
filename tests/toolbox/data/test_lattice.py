"""The lattice of cells: it holds its points, and its tiles agree with it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from toolbox.data import Lattice, Raster
from toolbox.data.lattice import MAX_CELLS
from toolbox.errors import DataError

CELLS = st.sampled_from([0.05, 0.1, 0.2, 0.25, 0.3, 0.5, 1.0, 2.0, 3.7, 10.0])
PLACES = st.integers(-(10**7), 10**7)


@settings(max_examples=300)
@given(cell=CELLS, west=PLACES, south=PLACES, cols=st.integers(1, 400), rows=st.integers(1, 400))
def test_exact_multiples_stay(cell: float, west: int, south: int, cols: int, rows: int) -> None:
    """Bounds typed in decimals, such as 0.3 with cells of 0.1, are not widened by rounding."""
    bounds = [round(v * cell, 6) for v in (west, south, west + cols, south + rows)]
    lattice = Lattice.cover(bounds, cell)
    assert lattice.shape == (rows, cols)
    assert lattice.bounds == pytest.approx(bounds, abs=1e-7 * cell, rel=1e-14)
    assert Lattice.cover(lattice.bounds, cell) == lattice


@settings(max_examples=300)
@given(
    cell=CELLS,
    x=st.lists(st.floats(-5e6, 5e6), min_size=1, max_size=5),
    y=st.lists(st.floats(-5e6, 5e6), min_size=1, max_size=5),
)
def test_cover_is_snug_and_holds_all(cell: float, x: list[float], y: list[float]) -> None:
    x, y = [min(x), min(min(x) + 300, max(x))], [min(y), min(min(y) + 300, max(y))]
    lattice = Lattice.cover((x[0], y[0], x[1], y[1]), cell)
    assert lattice.holds(x, y).all()
    west, south, east, north = lattice.bounds
    slack = 2e-6 * cell + 1e-8
    assert west - slack <= x[0] < west + cell + slack
    assert south - slack <= y[0] < south + cell + slack
    assert x[1] <= east + slack
    assert y[1] <= north + slack
    assert (west / cell) == pytest.approx(round(west / cell), abs=1e-6)


@settings(max_examples=200)
@given(cell=CELLS, shift=st.tuples(st.integers(0, 40), st.integers(0, 40)), seed=st.integers(0, 99))
def test_a_tile_agrees_with_the_whole(cell: float, shift: tuple[int, int], seed: int) -> None:
    """Same cell and same centre, to the last bit, also for points on cell boundaries."""
    whole = Lattice.cover((4000 * cell, 70000 * cell, 4100 * cell, 70100 * cell), cell)
    right, up = shift
    tile = Lattice.cover(
        [(4000 + right) * cell, (70000 + up) * cell, (4050 + right) * cell, (70050 + up) * cell],
        cell,
    )
    down = 50 - up
    place = np.random.default_rng(seed).integers(0, 49 * 4, (2, 200)) / 4
    x, y = (4000 + right + place[0]) * cell, (70000 + up + place[1]) * cell
    row, col = whole.indices(x, y)
    tile_row, tile_col = tile.indices(x, y)
    assert np.array_equal(tile_row + down, row)
    assert np.array_equal(tile_col + right, col)
    centres, own = whole.centres(), tile.centres()
    assert np.array_equal(centres[0][right : right + 50], own[0])
    assert np.array_equal(centres[1][down : down + 50], own[1])


def test_edges_belong_to_the_cell_on_their_east_and_north() -> None:
    lattice = Lattice.cover((0, 0, 0.3, 0.2), 0.1)
    assert lattice == Lattice(0.0, 0.2, 0.1, 2, 3)
    row, col = lattice.indices([0, 0.1, 0.2, 0.3, 0.05], [0, 0.1, 0.2, 0.15, 0.05])
    assert row.tolist() == [1, 0, 0, 0, 1]
    assert col.tolist() == [0, 1, 2, 2, 0]
    row, col = lattice.indices([-0.01, 0.31, 0.1, 0.1], [0.1, 0.1, 0.21, -0.01])
    assert lattice.holds([-0.01, 0.31, 0.1, 0.1], [0.1, 0.1, 0.21, -0.01]).tolist() == [False] * 4
    assert (row.tolist(), col.tolist()) == ([0, 0, -1, 2], [-1, 3, 1, 1])
    assert [int(index) for index in lattice.indices(0.25, 0.05)] == [1, 2]


def test_template_off_the_multiples() -> None:
    lattice = Lattice(1000.2, 2000.7, 0.5, 4, 3)
    assert lattice.bounds == pytest.approx((1000.2, 1998.7, 1001.7, 2000.7))
    x, y = lattice.centres()
    assert x == pytest.approx([1000.45, 1000.95, 1001.45])
    assert y == pytest.approx([2000.45, 1999.95, 1999.45, 1998.95])
    row, col = np.meshgrid(range(4), range(3), indexing="ij")
    found = lattice.indices(*np.meshgrid(x, y))
    assert np.array_equal(found[0], row)
    assert np.array_equal(found[1], col)
    near_edges = lattice.indices([1000.21, 1000.69, 1000.71], [2000.69, 2000.21, 2000.19])
    assert [index.tolist() for index in near_edges] == [[0, 0, 1], [0, 0, 1]]
    raster = Raster(np.zeros((4, 3), np.float32), lattice.transform)
    assert Lattice.of(raster) == lattice


def test_bounds_of_a_cloud_and_of_one_point() -> None:
    assert Lattice.cover((0.2, 0.2, -5, 1.8, 0.8, 99), 1.0) == Lattice(0.0, 1.0, 1.0, 1, 2)
    assert Lattice.cover((3, 3, 3, 3), 1.0) == Lattice(3.0, 4.0, 1.0, 1, 1)


@pytest.mark.parametrize(
    ("bounds", "cell", "problem"),
    [
        ((0, 0, 1e6, 1e6), 0.01, f"100000000 rows x 100000000 columns, more than {MAX_CELLS}"),
        ((0, 0, 1, 1), 0, "cell size must be > 0, got 0"),
        ((0, 0, 1, 1), float("nan"), "cell size must be > 0, got nan"),
        ((0, 0, float("inf"), 1), 1, "cannot lay cells over the bounds"),
    ],
)
def test_lattices_that_are_refused(bounds: tuple[float, ...], cell: float, problem: str) -> None:
    with pytest.raises(DataError, match=problem):
        Lattice.cover(bounds, cell)


def test_lattice_without_cells() -> None:
    with pytest.raises(DataError, match="0 rows x 3 columns"):
        Lattice(0, 0, 1, 0, 3)


@pytest.mark.parametrize("cell", [5e-324, 1e-300, 1e-10])
def test_cells_too_small_to_be_counted_are_refused(cell: float) -> None:
    with pytest.raises(DataError, match="cannot be counted so far from the origin"):
        Lattice.cover((5e5, 4.4e6, 5e5 + 1, 4.4e6 + 1), cell)
