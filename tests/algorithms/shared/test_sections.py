"""Sections bounded by steps down: roofs with what stands on them, courts, terraces, wide halls."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from numpy.typing import NDArray

from algorithms.shared.sections import LARGEST_CUT, WIDEST, raised_sections
from toolbox.data import Lattice

Cells = NDArray[np.float32]
STEP = 0.8


def raised(z: NDArray[np.float64] | Cells) -> NDArray[np.bool_]:
    return raised_sections(z.astype(np.float32), STEP, Lattice(1000.0, 2000.0, 1.0, *z.shape))


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
    z = np.zeros((40, 40))
    z[10:30, 10:30] = 2.5
    z[30:32, 10:14] = 1.2
    assert (raised(z) == (z == 2.5)).all()


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


def test_wider_ones_are_told(caplog: pytest.LogCaptureFixture) -> None:
    z = np.zeros((WIDEST + 40, 120))
    z[20 : 20 + WIDEST, 20:100] = 5.0
    assert raised(z).sum() == WIDEST * 80
    assert not caplog.records
    z[20 + WIDEST, 20:100] = 5.0
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert not raised(z).any()
    assert f"ground: 1, the largest of about {(WIDEST + 1) * 80} m2 at 1060, 1910." in caplog.text


def test_large_ones_at_the_end_of_the_data_are_told(caplog: pytest.LogCaptureFixture) -> None:
    z = np.zeros((120, 120))
    z[:50, :100] = 5.0
    assert raised(z).sum() == LARGEST_CUT
    assert not caplog.records
    z[50, :100] = 5.0
    with caplog.at_level(logging.WARNING, "toolbox"):
        assert not raised(z).any()
    assert "cut by the end of the data" in caplog.text
