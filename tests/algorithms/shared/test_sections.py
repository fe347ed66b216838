"""Sections bounded by steps down: roofs with what stands on them, courts, terraces, wide halls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from algorithms.shared.sections import CUT, WIDEST, raised_sections, tell_of_wide
from toolbox.data import Lattice

Cells = NDArray[np.float32]
STEP = 0.8


def raised(z: NDArray[np.float64] | Cells) -> NDArray[np.bool_]:
    return raised_sections(z.astype(np.float32), STEP)[0]


def test_a_section_is_raised_if_its_border_steps_down() -> None:
    z = np.zeros((40, 40))
    z[5:15, 5:15] = 2.0  # a block
    z[:6, 20:30] = 2.0  # one at the edge
    z[25:35, :] = 2.0  # a bank from edge to edge
    z[20:23, 2:4] = 2.0  # too small
    found = raised(z)
    assert found[5:15, 5:15].all()
    assert found[:6, 20:30].all()
    assert np.count_nonzero(found) == 100 + 60
    assert not raised(np.where(z > 0, 1.7, 0)).any()
    z[15:17, 5:15] = z[3:5, 5:15] = 4.0  # a parapet on two of four sides
    assert raised(z)[3:17, 5:15].all()
    z[15:25] = z[:5] = 4.0  # ground that leads on higher up
    assert not raised(z)[5:15, 5:15].any()


def test_skylights_are_of_the_roof_and_a_court_is_none() -> None:
    """None of them falls off by itself, and most sides of the roof would rise to one."""
    z = np.zeros((60, 60))
    z[10:50, 10:50] = 5.0
    z[12:48:4, 12:48] += 1.2
    z[20:40, 24:36] = 0.0  # a court
    assert (raised(z) == (z > 0)).all()


def test_teeth_of_a_roof_are_raised_one_after_the_other() -> None:
    z = np.zeros((60, 80))
    z[10:50, 10:70] = 5.0 + 0.25 * (np.arange(60) % 12)
    assert (raised(z) == (z > 0)).all()


def test_a_hedge_beside_a_low_roof_does_not_join_it_to_the_ground() -> None:
    """The roof rises by 1 in 4, and the hedge leads up to it by 0.8 m from cell to cell."""
    z = np.zeros((40, 40))
    z[10:30, 10:30] = 2.4 + 0.25 * np.arange(19, -1, -1)[:, None]
    z[30, 10:13], z[31, 10:13] = 1.6, 0.8
    assert (raised(z) == (z >= 2.4)).all()


@pytest.mark.parametrize(("higher", "is_roof"), [(11, True), (13, False)])
def test_a_roof_may_lean_on_higher_ground_along_three_tenths(higher: int, is_roof: bool) -> None:
    """Of a border of 40 cells; 28 steps down of 40 are enough."""
    z = np.zeros((40, 40))
    z[15:25, 15:25] = 4.0
    z[:15, 15:] = 9.0
    z[15 : 15 + higher - 10, 25:] = 9.0
    assert raised(z)[15:25, 15:25].all() == is_roof


def test_terraces_in_a_corner_of_the_data_stay_ground() -> None:
    """The highest one alone is cut on two sides, falls off on the third, and is as a roof."""
    rows, cols = np.indices((120, 120))
    z = 2.0 * np.floor((cols + 0.4 * rows) / 12)
    assert (raised(z) == (z == z.max())).all()


def test_a_yard_between_roofs_with_stairs_to_a_basement_stays_ground() -> None:
    z = np.zeros((60, 60))
    z[10:50, 10:50] = 6.0
    z[20:40, 20:40] = 0.0
    z[30:40, 38:40] = -3.0
    assert (raised(z) == (z > 3)).all()


@pytest.mark.parametrize("empty", [0.2, 0.4])
def test_cells_without_points_are_no_border(empty: float) -> None:
    z = np.zeros((160, 160))
    z[20:140, 30:130] = 5.0
    gap = np.random.default_rng(2).random(z.shape) < empty
    z[gap] = np.nan
    found = raised(z)
    roof = (z == 5.0) & ~gap
    assert found[roof].mean() > 0.97
    assert not found[~roof].any()


def test_parcels_and_quays_are_lower_than_wide_halls() -> None:
    """Parcels of 57 x 97 m between upright ditches of 2 m; a roof of 20 x 35 m may be as low."""
    rows, cols = np.indices((203, 183))
    parcels = np.where((rows % 100 < 3) | (cols % 60 < 3), -2.0, 0.0)
    assert not raised(parcels).any()
    assert raised(1.6 * parcels).any()
    roof = np.where((abs(rows - 100) < 17) & (abs(cols - 90) < 10), 2.0, 0.0)
    assert (raised(roof) == (roof > 0)).all()


@pytest.mark.parametrize("widest", [WIDEST, 200])
def test_wider_ones_are_no_roofs(widest: int) -> None:
    z = np.zeros((240, 120))
    z[20 : 20 + widest, 20:100] = 5.0
    assert raised_sections(z.astype(np.float32), STEP, widest)[0].sum() == widest * 80
    z[20 + widest, 20:100] = 5.0
    found, wide = raised_sections(z.astype(np.float32), STEP, widest)
    assert not found.any()
    assert (wide == np.where(z > 0, widest + 1, 0)).all()


@pytest.mark.parametrize("widest", [WIDEST, 180])
def test_large_ones_at_the_end_of_the_data_are_no_roofs(widest: int) -> None:
    z = np.zeros((140, 120))
    rows = round(CUT * widest**2 / 100)
    z[:rows, :100] = 5.0
    assert raised_sections(z.astype(np.float32), STEP, widest)[0].sum() == CUT * widest**2
    z[rows, :100] = 5.0
    found, wide = raised_sections(z.astype(np.float32), STEP, widest)
    assert not found.any()
    assert (wide == np.where(z > 0, math.ceil(math.sqrt(100 * (rows + 1) / CUT)), 0)).all()


def test_of_teeth_that_are_too_wide_all_are_told() -> None:
    """Only the first one falls off on both sides."""
    z = np.zeros((WIDEST + 60, 80))
    z[20 : WIDEST + 40, 10:70] = 5.0 + 0.25 * (np.arange(60) % 12)
    found, wide = raised_sections(z.astype(np.float32), STEP)
    assert not found.any()
    assert (wide == np.where(z > 0, WIDEST + 20, 0)).all()


def test_the_largest_wide_place_is_told_by_a_cell_of_it(caplog: pytest.LogCaptureFixture) -> None:
    """A ring has its mean in its court. Cells without data part no place, and count."""
    cells = np.zeros((100, 200), np.float32)
    cells[10:40, 10:40], cells[15:35, 15:35] = 160, 0
    cells[50:60, 10:30] = 180
    cells[::7] = 0
    tell_of_wide(cells, Lattice(1000.0, 2000.0, 1.0, *cells.shape))
    area, rest = caplog.text.split("ground: 2, the largest of about ")[1].split(" m2 at ")
    assert float(area) == pytest.approx(500, rel=0.1)
    assert "With a longest_building of 180 m none of these is ground" in rest
    x, y = (float(word.strip(",.")) for word in rest.split(" ")[:2])
    assert 10 <= x - 1000 <= 15 or 25 <= x - 1000 <= 40 or 10 <= 2000 - y <= 15
