"""Bands of windows, and what is as wide and none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from algorithms.planes._bands import is_band
from algorithms.planes._gaps import _in_band, _parted
from algorithms.planes.openings import PlanesOpenings
from toolbox.data import PointCloud
from toolbox.data.crs import LOCAL

Floats = NDArray[np.float64]


def part(box: Any, depth: float, **other: Any) -> Any:
    """A plane with points every 10 cm, of 20 cm apart unless told."""
    left, bottom, right, top = box
    x, y = np.meshgrid(np.arange(left, right, 0.1), np.arange(bottom, top, 0.1))
    some = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel() + depth])
    told = {"apart": 0.2, "shade": 10.0, "shade_spread": 0.2, "holes": 0.0, "spread": 0.003}
    size = np.array([right - left, top - bottom])
    return SimpleNamespace(depth=depth, size=size, some=some, **(told | other))


def band(
    glass: dict[str, Any], back: float = 0.15, height: float = 1.5, above: Any = (0, 10)
) -> bool:
    """Whether a plane between two strips of wall is taken for a band of windows."""
    below = part((0, 0, 10, 1), 0.0)
    high = part((above[0], 1 + height, above[1], 3 + height), 0.0)
    one = part((0.3, 1, 9.7, 1 + height), back, **glass)
    return is_band(one, [below, high, one], step=0.02, recess=0.25, widest=4.0)


SPARSE = {"apart": 0.3}  # less than half of the points of the wall


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        (band(SPARSE), True),
        (band({"apart": 0.26}), False),
        (band({"apart": 0.26}, back=0.3), True),
        (band({"shade": 10.65}), True),
        (band({"shade": 10.55}), False),
        (band({"shade": np.nan}), False),
        (band(SPARSE, height=1.9), True),
        (band(SPARSE, height=2.1), False),
        (band(SPARSE, above=(0, 8)), True),
        (band(SPARSE, above=(0, 6.5)), False),
        (band(SPARSE, back=0.01), False),
        (band(SPARSE | {"holes": 0.04}), True),
        (band(SPARSE | {"holes": 0.06}), False),
    ],
    ids=[
        "glass",
        "a frieze as dense and as bright as the wall",
        "deeper than a frieze",
        "blinds of another colour",
        "blinds of nearly the same",
        "a frieze without intensity",
        "as high as from breast to head",
        "a storey that stands back",
        "wall above most of it",
        "wall above a part of it",
        "in the plane of the wall",
        "glass that sends back little",
        "the back of a gallery with doors",
    ],
)
def test_what_is_a_band_of_windows(told: bool, expected: bool) -> None:
    assert told is expected


@pytest.mark.parametrize(("away", "told"), [(1.8, True), (2.2, False)])
def test_blinds_end_above_the_lower_side_of_a_band(away: float, told: bool) -> None:
    blinds, above = part((0, 3, 10, 3.4), 0.3), part((0, 3.4, 10, 5), 0.0)
    below = part((0, 0, 10, 3 - away), 0.0)
    assert is_band(blinds, [above, below, blinds], 0.02, 0.25, 4.0) == told


def test_wall_above_alone_makes_no_band() -> None:
    glass, wall = part((0, 0, 10, 1), 0.15, **SPARSE), part((0, 1, 10, 3), 0.0)
    assert not is_band(glass, [wall, glass], 0.02, 0.25, 4.0)


def test_a_stray_point_of_glass_does_not_move_its_sides() -> None:
    glass = part((0.3, 1, 9.7, 2.5), 0.15, **SPARSE)
    glass.some = np.vstack([glass.some, [[5.0, 4.4, 0.15]]])
    walls = [part((0, 0, 10, 1), 0.0), part((0, 2.5, 10, 4.3), 0.0)]
    assert is_band(glass, walls, 0.02, 0.25, 4.0)


def front(echoes: float, right: float) -> PointCloud:
    """A wall of 12 by 4 m, a band of glass 12 cm behind it, and a door as deep."""
    rng = np.random.default_rng(2)
    uv = rng.random((60_000, 2)) * [12, 4]
    x, z = uv.T
    glass = (x > 3) & (x < right) & (z > 1.0) & (z < 2.4)
    door = (x > 1) & (x < 2) & (z < 2.2)
    seen = ~glass | (rng.random(len(uv)) < echoes)
    away = np.where(glass | door, 0.12, 0.0) + rng.normal(0, 0.003, len(uv))
    kind = np.where(glass, 2, np.where(door, 3, 1))[seen]
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(0, 12, 0.1), np.arange(-8, 0, 0.1)))
    xyz = np.vstack([np.column_stack([x, away, z])[seen], np.column_stack([u, v, 0 * u])])
    ids = np.append(kind, np.full(len(u), 4)).astype(np.int32)
    return PointCloud(xyz, {"plane_id": ids}, crs=LOCAL)


@pytest.mark.parametrize("right", [11.0, 12.1], ids=["within the wall", "to its end"])
def test_a_band_and_a_door_in_its_depth_are_openings(right: float) -> None:
    """The glass had been wall, and so had been the door."""
    frame = PlanesOpenings(points=front(0.2, right)).run().openings.frame
    frame = frame.sort_values("width")
    assert frame.kind.tolist() == ["door", "window"]
    assert frame.width.to_numpy() == pytest.approx([1.0, min(right, 12.0) - 3.0], abs=0.15)
    assert frame.height.to_numpy() == pytest.approx([2.2, 1.4], abs=0.1)


def test_a_frieze_is_wall() -> None:
    assert not PlanesOpenings(points=front(1.0, 11.0)).run().openings.frame.width.gt(4.0).any()


def test_a_board_in_which_nothing_is_seen_is_no_band() -> None:
    """With a reveal, as an empty window has: signs above shops are as wide."""
    cloud = front(0.0, 11.0)
    x, away = (grid.ravel() for grid in np.meshgrid(np.arange(3, 11, 0.03), [0.05, 0.08]))
    xyz = np.vstack([cloud.xyz, np.column_stack([x, away, 0 * x + 1.02])])
    ids = np.append(cloud["plane_id"], np.zeros(len(x), np.int32)).astype(np.int32)
    out = PlanesOpenings(points=PointCloud(xyz, {"plane_id": ids}, crs=LOCAL)).run()
    assert out.openings.frame.kind.tolist() == ["door"]


@pytest.mark.parametrize(
    ("beside", "height", "told"),
    [((0, 0.8, 0, 0.9), 1.5, True), ((1, 0.7, 1, 1), 1.5, False), ((1, 1, 1, 1), 2.1, False)],
)
def test_a_gap_too_wide_for_a_window_may_be_a_band(beside: Any, height: float, told: bool) -> None:
    import shapely

    assert _in_band(shapely.box(0, 0, 9, height), beside, 4.0) == told


def test_squares_without_echoes_do_not_part_a_band() -> None:
    """Two bands that are joined at the corner of the house, with a third of their squares empty."""
    full = np.zeros((40, 80), bool)
    full[2:18], full[22:38], full[:, 78:] = True, True, True
    back = full & (np.random.default_rng(1).random(full.shape) < 0.67)
    parts = _parted(back, full & ~back, 4.0)
    assert [int(part.any(axis=0).sum()) for part in parts] == pytest.approx([80, 80], abs=3)
