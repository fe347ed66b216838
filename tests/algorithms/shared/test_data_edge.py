"""Shapes at the edge of the data, which is neither a canal nor a yard in shadow."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from algorithms.shared.data_edge import GAP, cut
from toolbox.context import Context, Digested


def survey(gap: float) -> np.ndarray:
    """100 x 100 m of points, half a metre apart, with a gap from x = 60 that runs to both ends."""
    axis = np.arange(0, 100, 0.5)
    xy = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    return xy[(xy[:, 0] < 60) | (xy[:, 0] > 60 + gap)]


@pytest.mark.parametrize(("gap", "ends"), [(0.6 * GAP, False), (2.4 * GAP, True)])
def test_a_canal_is_within_the_data_and_a_wide_gap_is_not(gap: float, ends: bool) -> None:
    house, beside = shapely.box(20, 40, 30, 50), shapely.box(50, 40, 59.9, 50)
    assert cut([house, beside], Digested(survey(gap)), 0.5, 1.0).tolist() == [False, ends]


def test_units_and_places_do_not_matter() -> None:
    foot = 0.3048
    xy, shapes = survey(0.0), [shapely.box(0, 40, 9, 50), shapely.box(10, 10, 20, 20)]
    moved = [shapely.transform(s, lambda p: p / foot + 1e6) for s in shapes]
    assert cut(moved, Digested(xy / foot + 1e6), 0.5 / foot, 1 / foot).tolist() == [True, False]
    assert cut([], Digested(xy), 0.5, 1.0).shape == (0,)


def test_steps_share_the_edge_of_the_same_points_alone() -> None:
    ctx, beside = Context().keeping(), [shapely.box(50, 40, 59.9, 50)]
    for gap, ends in ((0.0, False), (2.4 * GAP, True), (0.0, False)):
        assert cut(beside, Digested(survey(gap)), 0.5, 1.0, ctx=ctx).tolist() == [ends]
    assert cut(beside, Digested(survey(0.0)), 0.5, 1.0, ctx=ctx).tolist() == [False]
    assert ctx.kept is not None
    assert set(ctx.kept) == {"edge"}
