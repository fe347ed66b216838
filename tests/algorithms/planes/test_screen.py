"""Scaffolds and nets before a front, and what is none of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from algorithms.planes._screen import Screen, screen_of
from algorithms.planes.openings import PlanesOpenings
from toolbox.data import PointCloud
from toolbox.data.crs import LOCAL

Floats = NDArray[np.float64]
POSTS = (1.0, 3.0, 5.0)


def wall(right: float = 10.0) -> Floats:
    """Points 4 cm apart on a wall 6 m high."""
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(0, right, 0.04), np.arange(0, 6, 0.04)))
    return np.column_stack([x, z, 0 * x])


def posts(places: Any = POSTS, top: float = 6.0, away: float = 1.0) -> Floats:
    """Tubes with a point every 4 cm of their height."""
    x, z = (grid.ravel() for grid in np.meshgrid(places, np.arange(0, top, 0.04)))
    return np.column_stack([x + 0.05, z, 0 * x - away])


def sides(share: float) -> Floats:
    """What joins tubes to the wall over a share of their height."""
    x, z, away = np.meshgrid(POSTS, np.arange(0, 6 * share, 0.04), np.arange(0, 1, 0.05))
    return np.column_stack([x.ravel() + 0.05, z.ravel(), -away.ravel()])


thin = sides(1.0)


def seen(before: Floats, hidden: Any = None, metre: float = 1.0) -> Screen:
    """What is told of points before a wall, some of which is not seen."""
    whole = wall()
    whole = whole if hidden is None else whole[~hidden(whole[:, 0], whole[:, 1])]
    xyz = np.vstack([whole, before]) * metre
    return screen_of(xyz[:, :2], xyz[:, 2], xyz[:, 2] == 0, 1.5 * metre, metre)


def net(left: float = 2.0, right: float = 8.0) -> Floats:
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(left, right, 0.04), wall()[:, 1][::250]))
    return np.column_stack([x, z, 0 * x - 1.0])


def beside_posts(x: Floats, z: Floats) -> Any:
    return np.abs(x[:, None] - np.array(POSTS) - 0.05).min(axis=1) < 0.25


@pytest.mark.parametrize(
    ("before", "hidden"),
    [
        (posts(), None),
        (posts(away=0.7), None),
        (posts((1.0, 4.1, 7.2)), None),
        (posts(top=5.2), None),
        (
            np.vstack([posts(np.array(POSTS) + wide) for wide in (0, 0.06, 0.12)]),
            lambda x, z: (x % 2 > 0.98) & (x % 2 < 1.22) & (x < 6),
        ),
        (np.delete(posts(), np.flatnonzero(np.abs(posts()[:, 1] - 3) < 0.18), axis=0), None),
        (np.vstack([posts(), sides(0.2)]), None),
        (posts(), lambda x, z: beside_posts(x, z) & (z > 3.6)),
        (np.vstack([posts(away=0.3), posts(away=0.5), posts()]), None),
        (
            net(),
            lambda x, z: (x > 2) & (x < 8) & ((np.floor(z / 0.1) % 3 > 0) | (x % 1 < 0.14)),
        ),
    ],
    ids=[
        "three tubes",
        "boards as narrow as they are made",
        "fields as long as they are made",
        "two storeys high",
        "posts of timber, 12 cm wide",
        "behind a rail",
        "tied to the wall",
        "wall beside them in the shadow of boards",
        "rows of tubes behind each other",
        "a net before tubes through which a third of the wall is seen",
    ],
)
def test_a_scaffold_is_told(before: Floats, hidden: Any) -> None:
    made = seen(before, hidden)
    assert made.points[-len(before) :][before[:, 2] < -0.2].all()
    assert made.share == pytest.approx(np.ptp(before[:, 0]) / 10, abs=0.05)
    assert made.depth == pytest.approx(-before[:, 2].min(), abs=0.11)


@pytest.mark.parametrize(
    ("before", "hidden"),
    [
        (posts((1.0, 3.0)), None),
        (posts((1.0, 3.0, 3.3)), None),
        (posts((1.0, 4.5, 8.0)), None),
        (posts(top=4.6), None),
        (posts(away=0.4), None),
        (np.delete(posts(), np.flatnonzero(np.abs(posts()[:, 1] - 3) < 0.35), axis=0), None),
        (np.vstack([posts(), sides(0.4)]), None),
        (np.vstack([posts(), thin[np.abs(thin[:, 2] + 0.4) > 0.06]]), None),
        (posts(), lambda x, z: beside_posts(x, z) & (z > 2.4)),
        (net(), lambda x, z: (x > 2) & (x < 8) & (np.floor(z / 0.1) % 10 > 0)),
        (
            np.vstack([net(left, left + 0.6) for left in (1.0, 3.0, 5.0)]),
            lambda x, z: (x % 2 > 1.02) & (x % 2 < 1.58) & (x < 6),
        ),
        (
            np.vstack([net(left, left + 0.6) for left in (1.0, 3.0, 5.0)]),
            lambda x, z: (x % 2 > 1.29) & (x % 2 < 1.58) & (x < 6),
        ),
    ],
    ids=[
        "a lamp and a mast",
        "two masts side by side",
        "masts farther apart",
        "less than two storeys",
        "pipes",
        "rails and parapets of balconies above each other",
        "joined to the wall as pilasters are",
        "pilasters whose sides were seen in part",
        "no wall seen beside",
        "another wall with a few windows",
        "pilasters whose sides were not seen",
        "pilasters behind which wall is seen from beside",
    ],
)
def test_what_is_no_scaffold(before: Floats, hidden: Any) -> None:
    made = seen(before, hidden)
    assert not made.share
    assert not made.points.any()


def test_a_scaffold_in_feet_and_beyond_the_wall() -> None:
    """Tubes end above the wall, and boards past its ends."""
    beyond = np.array([[3.0, 6.8, -1.0], [-0.9, 2.0, -1.0], [10.9, 2.0, -1.0]])
    before = np.vstack([posts((0.0, 3.0, 6.0, 9.0, 9.9)), beyond])
    metres, feet = seen(before), seen(before, metre=1 / 0.3048)
    assert metres.points[-3:].all()
    assert (metres.points == feet.points).all()
    assert feet.depth == pytest.approx(metres.depth / 0.3048)
    assert feet.share == metres.share


def test_windows_behind_a_scaffold_are_found_and_told(caplog: pytest.LogCaptureFixture) -> None:
    """A rail as wide as the front had been wall: windows ended at it, and more lay beside it."""
    xyz = wall()
    window = np.zeros(len(xyz), bool)
    for left, low in ((1.4, 1.0), (5.4, 1.0), (1.4, 4.0), (5.4, 4.0), (8.3, 4.0)):
        window |= (np.abs(xyz[:, 0] - left - 0.5) < 0.5) & (np.abs(xyz[:, 1] - low - 0.7) < 0.7)
    xyz[window, 2] = 0.12
    rails = np.vstack([wall()[np.abs(wall()[:, 1] - up) < 0.05] - [0, 0, 1] for up in (1.7, 4.7)])
    tubes = posts((0.5, 2.5, 4.5, 6.5))
    rails = rails[rails[:, 0] < 7.0]
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(0, 10, 0.1), np.arange(-8, -2, 0.1)))
    parts = [xyz[~window], xyz[window], rails, tubes, np.column_stack([u, 0 * u, v])]
    ids = np.repeat([1, 2, 3, 3, 4], [len(part) for part in parts]).astype(np.int32)
    noise = np.random.default_rng(1).normal(0, 0.003, (len(ids), 3))
    cloud = PointCloud((np.vstack(parts) + noise)[:, [0, 2, 1]], {"plane_id": ids}, crs=LOCAL)
    out = PlanesOpenings(points=cloud).run()
    frame = out.openings.frame
    assert out.count == 5
    assert frame.width.between(0.9, 1.1).all()
    assert frame.height.between(1.3, 1.5).all()
    assert "something stands 1.0 m before front 1 over 62 % of its width" in caplog.text
    behind = frame.geometry.bounds.minx < 7.0
    assert (frame.certainty[behind] <= 0.5).all()
    assert (frame.certainty[~behind] > 0.8).all()
    assert behind.sum() == 4
