"""Standard deviations of wires whose points err together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes.corridors import Floats, wire
from scipy.ndimage import gaussian_filter1d

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._curves.network import Corridor
from algorithms.corridor._curves.trace import Airborne
from algorithms.corridor._extraction.errors import with_common_errors
from algorithms.corridor._extraction.spans import Wire

Truth = list[Catenary]
U = np.linspace(0, 100, 21)


def surveyed(strips: int, shift: float, wander: float) -> tuple[Truth, list[Floats]]:
    """Twenty spans of 100 m one behind the other, each strip with errors of its own."""
    rng = np.random.default_rng(7)
    curves, parts = [], []
    for k in range(20):
        curve, points = wire((100 * k, 0, 20), (100 * k + 100, 0, 20), 800, 2.0, seed=k)
        curves.append(curve)
        parts.append(points)
    xyz = np.vstack(parts)
    strip = rng.integers(0, strips, len(xyz))
    for one in range(strips):
        stray = gaussian_filter1d(rng.normal(0, 1, 2000), 20)
        here = strip == one
        xyz[here, 2] += wander / stray.std() * np.interp(xyz[here, 0], np.arange(2000), stray)
        xyz[here, 2] += shift * (one - (strips - 1) / 2)
    return curves, [xyz, strip]


def found(xyz: Floats, strip: Floats, told: bool) -> tuple[list[Wire], list[Wire]]:
    """The wires as they are fitted, and with their common errors."""
    air = Airborne.of(xyz)
    count = len(xyz)
    corridor = Corridor(
        air,
        np.full(count, 20.0),
        np.ones(count, bool),
        0.25,
        lambda x, y: 0.0,
        lambda x, y: True,
        strip=(told * strip[air.order]).astype(np.uint16),
    )
    fitted = [fit(xyz[(xyz[:, 0] // 100).clip(0, 19) == k], spread=0.5) for k in range(20)]
    wires = [
        Wire(curve, (-1, -1), (0.0, curve.length), 0.25, span=k)
        for k, curve in enumerate(fitted)
        if curve
    ]
    return wires, with_common_errors(corridor, wires)


def within(wires: list[Wire], truth: Truth) -> float:
    """Share of heights within two standard deviations of the true ones."""
    shares = []
    for wire_, true in zip(wires, truth, strict=True):
        u, _ = wire_.curve.along(true.points(U))
        off = np.abs(wire_.curve.height(u) - true.height(U))
        shares.append(off < 2 * wire_.curve.height_sigma(u))
    return float(np.mean(shares))


@pytest.mark.parametrize(
    ("strips", "shift", "wander"), [(2, 0.0, 0.03), (3, 0.0, 0.05)], ids=["two", "three"]
)
def test_standard_deviations_hold_where_strips_wander(
    strips: int, shift: float, wander: float
) -> None:
    truth, (xyz, strip) = surveyed(strips, shift, wander)
    before, after = found(xyz, strip, told=True)
    assert within(before, truth) < 0.7
    assert within(after, truth) > 0.9


def test_strips_that_disagree_widen_the_covariance_by_as_much() -> None:
    truth, (xyz, strip) = surveyed(2, 0.1, 0.0)
    _, after = found(xyz, strip, told=True)
    sigma = np.median([wire_.curve.height_sigma(np.array([50.0]))[0] for wire_ in after])
    assert sigma == pytest.approx(0.1 / np.sqrt(2) / np.sqrt(2), rel=0.25)
    assert within(after, truth) == 1.0


def test_of_one_strip_its_wander_along_the_wires_is_told() -> None:
    _, (xyz, strip) = surveyed(1, 0.0, 0.05)
    before, after = found(xyz, strip, told=False)
    wider = [
        b.curve.height_sigma(U) / a.curve.height_sigma(U)
        for a, b in zip(before, after, strict=True)
    ]
    assert np.median(wider) > 1.3  # what is slower than a span, it cannot tell


def test_where_points_err_by_themselves_nothing_changes() -> None:
    truth, (xyz, strip) = surveyed(2, 0.0, 0.0)
    before, after = found(xyz, strip, told=True)
    ratio = [
        b.curve.height_sigma(U) / a.curve.height_sigma(U)
        for a, b in zip(before, after, strict=True)
    ]
    assert np.max(ratio) < 1.35
    assert within(before, truth) > 0.9


def test_a_wire_whose_few_points_agree_by_chance_is_no_surer_than_the_others_tell() -> None:
    _, (xyz, strip) = surveyed(1, 0.0, 0.0)
    first = np.flatnonzero(xyz[:, 0] < 100)
    few = first[:: len(first) // 6][:6]
    xyz[few] = wire((0, 0, 20), (100, 0, 20), 800)[0].points(np.linspace(2, 98, 6))
    here = (xyz[:, 0] >= 100) | np.isin(np.arange(len(xyz)), few)
    before, after = found(xyz[here], strip[here], told=False)
    alone = [float(np.median(some[0].curve.height_sigma(U))) for some in (before, after)]
    others = [float(np.median(one.curve.height_sigma(U))) for one in after[1:]]
    assert alone[0] < 0.006  # the least scatter that a fit knows
    assert alone[1] > 3 * np.median(others)  # with a thirtieth of the points


def test_a_wire_without_covariance_stays() -> None:
    _, (xyz, strip) = surveyed(2, 0.1, 0.0)
    wires, _ = found(xyz, strip, told=True)
    bare = [replace(wire_, curve=replace(wire_.curve, covariance=None)) for wire_ in wires]
    air = Airborne.of(xyz)
    corridor = Corridor(
        air,
        np.full(len(xyz), 20.0),
        np.ones(len(xyz), bool),
        0.25,
        lambda x, y: 0.0,
        lambda x, y: True,
        strip=strip[air.order].astype(np.uint16),
    )
    assert with_common_errors(corridor, bare) == bare
