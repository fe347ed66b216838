"""corridor.surroundings: what is near the wires in plan, and what is no line."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import CRS

import toolbox
from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._extraction.layers import wire_layer
from algorithms.corridor._extraction.spans import Wire
from toolbox.data import PointCloud, Vector
from toolbox.errors import DataError

METRE = 3937 / 1200  # US survey feet


def points(metre: float = 1.0, crs: int = 32635) -> PointCloud:
    """A row of points square to a wire along x, one per metre, high and low in turn."""
    y = np.arange(-30.0, 31.0)
    xyz = np.column_stack([np.full(61, 50.0), y, np.where(y % 2, 0.0, 900.0)])
    return PointCloud(xyz * metre, crs=CRS(crs), name="a.laz")


def wires(*lengths: float, metre: float = 1.0, crs: int = 32635) -> Vector:
    """Wires along x from 0, 20 m high."""
    made = [Catenary(0.0, 0.0, 1.0, 0.0, length, 20.0, 20.0, 1 / 900) for length in lengths]
    found = [Wire(curve, (-1, -1), (0.0, curve.length), 0.25, 1, 1, 1) for curve in made]
    return wire_layer(found, np.zeros(3), metre, CRS(crs))


@pytest.mark.parametrize(("metre", "crs"), [(1.0, 32635), (METRE, 2263)])
def test_near_is_told_in_plan_and_to_the_centimetre(metre: float, crs: int) -> None:
    sources = {"points": points(metre, crs), "wires": wires(100.0, metre=metre, crs=crs)}
    found = toolbox.run("corridor.surroundings", sources | {"to_side": 12.01})
    y = found["near"].xyz[:, 1] / metre
    assert np.round(y).tolist() == list(range(-12, 13))
    assert found["removed_share"] == pytest.approx(36 / 61)


def test_beyond_the_end_of_a_wire_the_end_counts() -> None:
    sources = {"points": points(), "wires": wires(45.0), "to_side": 13.002}
    y = toolbox.run("corridor.surroundings", sources)["near"].xyz[:, 1]
    assert np.abs(y).max() == 12.0  # 5 m behind the end


@pytest.mark.parametrize(("metre", "crs"), [(1.0, 32635), (METRE, 2263)])
def test_what_is_of_the_line_and_has_no_class_is_left_out(metre: float, crs: int) -> None:
    """On the wire, and at its end; a tree there that has its class, and the wire itself, stay."""
    low = 20 - 50**2 / 2 / 900  # of the wire, nearly
    xyz = np.array([(50, 0.3, low), (50, 0.8, low), (2, 3, 18), (2, 6, 18)], float).repeat(
        3, axis=0
    )
    classes = np.tile(np.array([1, 5, 14], np.uint8), 4)
    cloud = PointCloud(xyz * metre, {"classification": classes}, crs=CRS(crs), name="a.laz")
    sources = {"points": cloud, "wires": wires(100.0, metre=metre, crs=crs)}
    near = toolbox.run("corridor.surroundings", sources)["near"]
    assert near["classification"].tolist() == [5, 14, 1, 5, 14, 5, 14, 1, 5, 14]


def test_no_wire_has_no_surroundings() -> None:
    found = toolbox.run("corridor.surroundings", {"points": points(), "wires": wires()})
    assert len(found["near"]) == 0


def test_other_layers_are_refused() -> None:
    frame = wires(100.0).frame[["wire_id", "geometry"]]
    with pytest.raises(DataError, match=r"wires: no column span_id, .*; take the wires of corr"):
        toolbox.run("corridor.surroundings", {"points": points(), "wires": Vector(frame)})
