"""Openings of fronts of many kinds; `python -m tests.bench house_fronts` tells of each kind."""

from __future__ import annotations

import numpy as np
import pytest

from tests.scenes.house_fronts import KINDS, house_front

SOLID = [kind for kind in KINDS if kind != "glass"]  # whose panes lie in the plane of the wall


@pytest.mark.parametrize("kind", SOLID)
def test_no_wall_fills_the_openings_of_a_front(kind: str) -> None:
    """Few points in the middle of an opening lie in the plane of its corners."""
    made = house_front(kind, 0)
    assert len(made.openings) >= (4 if kind == "ribbons" else 8)
    for ring in made.openings:
        low, high = ring.min(axis=0), ring.max(axis=0)
        rim = 0.25 * (high - low)
        inside = ((made.xyz > low + rim) & (made.xyz < high - rim))[:, [0, 2]].all(axis=1)
        across = np.cross(ring[1] - ring[0], ring[2] - ring[1])
        away = (made.xyz - ring[0]) @ (across / np.linalg.norm(across))
        assert (inside & (np.abs(away) < 0.02)).sum() < 20
