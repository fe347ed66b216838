"""Fits to wires of known shape."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from scenes.corridors import cloud, line, wire

from algorithms.corridor._curves.catenary import Catenary, fit
from algorithms.corridor._extraction.layers import catenaries_of, swing_sigmas, wire_layer
from algorithms.corridor._extraction.spans import Wire
from algorithms.corridor.catenaries import CorridorCatenaries
from toolbox.declare import ClassList
from toolbox.errors import ParameterError

ROOT = Path(__file__).parents[3]


def test_the_catenary_obeys_its_equation() -> None:
    curve = Catenary(0, 0, 1, 0, 100, 20, 26, 1 / 300)
    u = np.linspace(0, 100, 11)
    z = curve.z0 + 300 * (np.cosh((u - curve.u0) / 300) - 1)
    np.testing.assert_allclose(curve.height(u), z, atol=1e-9)
    fine = curve.points(np.linspace(0, 100, 10_001))
    steps = np.linalg.norm(np.diff(fine, axis=0), axis=1)
    assert curve.arc == pytest.approx(steps.sum(), abs=1e-4)
    chord = 20 + 0.06 * np.linspace(0, 100, 10_001)
    assert curve.sag == pytest.approx((chord - fine[:, 2]).max(), abs=1e-5)


@pytest.mark.parametrize("metre", [1.0, 3.28083333])
def test_the_formula_of_the_page_gives_the_lines_of_the_layer(metre: float) -> None:
    page = (ROOT / "docs/explanation/power-lines.md").read_text("utf-8")
    (block,) = re.findall(
        r"^```python\n(.*?)^```", page.partition("## A wire from its columns")[2], re.M | re.S
    )
    names: dict[str, Any] = {}
    exec(block, names)
    uphill = Catenary(3, 4, 0.6, -0.8, 100, 20, 36, 1 / 300, 0.1, 0.01, 0.2, 0.03, 9, np.eye(3))
    curves = uphill, replace(uphill, ex=-0.6, ey=0.8, swing=-0.4), replace(uphill, swing=0.0)
    wires = [Wire(curve, (0, 1), (0.0, 100.0), 0.25, 1, 1, k) for k, curve in enumerate(curves)]
    layer = wire_layer(wires, np.array([5e5, 4e6, 100.0]), metre, None).frame
    for row, shape in zip(layer.to_dict("records"), layer.geometry, strict=True):
        corners = shapely.get_coordinates(shape, include_z=True)
        made = names["positions"](row, len(corners), metre)
        np.testing.assert_allclose(made, corners, rtol=0, atol=5e-9)  # 4e6 has steps of 5e-10


def test_a_swing_above_0_is_to_the_left() -> None:
    north = Catenary(0, 0, 0, 1, 100, 20, 20, 1 / 300, swing=0.2)
    assert north.points(np.array([0.0, 50.0]))[:, 0] == pytest.approx([0, -0.2 * north.sag])


def test_a_part_of_a_catenary_is_the_same_curve() -> None:
    curve = Catenary(3, 4, 0.6, 0.8, 100, 20, 26, 1 / 300, 0.1, 0.01, 0.2, covariance=np.eye(3))
    part = curve.between(-5.0, 60.0)
    np.testing.assert_allclose(
        part.points(np.array([5.0, 65.0])), curve.points(np.array([0, 60.0]))
    )
    np.testing.assert_allclose(
        part.points(np.array([30.0])), curve.points(np.array([25.0])), atol=1e-9
    )
    assert part.height_sigma(np.array([30.0])) == pytest.approx(
        curve.height_sigma(np.array([25.0])), rel=1e-3
    )


def test_a_fit_finds_the_wire_in_spite_of_outliers() -> None:
    true, points = wire((0, 0, 20), (200, 10, 35), 900, per_metre=3)
    stray = points[::10] + np.array([0, 0.4, -0.6])
    curve = fit(np.vstack([points, stray]))
    assert curve is not None
    assert curve.c == pytest.approx(900, rel=0.01)
    _, v, z = curve.residuals(true.points(np.linspace(1, 199, 50)))
    assert np.abs(z).max() < 0.02
    assert np.abs(v).max() < 0.02


def test_the_covariance_is_that_of_repeated_fits() -> None:
    fits = [fit(wire((0, 0, 20), (150, 0, 22), 800, 2, seed=k)[1]) for k in range(60)]
    curvature = np.array([f.curvature for f in fits if f])
    said = np.mean([f.variance_of_curvature for f in fits if f])
    assert 0.6 < curvature.std() / np.sqrt(said) < 1.6


@pytest.mark.parametrize("noise", [(0.012, 0.03), (0.1, 0.1)], ids=["upright", "round"])
def test_standard_deviations_hold_whatever_the_errors_are_like(noise: tuple[float, float]) -> None:
    """Far points lose weight, and what is left scatters less: no fit is surer for that."""
    rng, off = np.random.default_rng(1), []
    for _ in range(300):
        u = np.sort(rng.uniform(0, 200, 150))
        aside, up = rng.normal(0, noise[0], 150), rng.normal(0, noise[1], 150)
        curve = fit(np.column_stack([u, aside, 20 + (u - 100) ** 2 / 2000 + up]), spread=0.5)
        assert curve is not None
        middle, _ = curve.along(np.array([[100.0, 0.0, 0.0]]))
        off.append((curve.height(middle)[0] - 20) / curve.height_sigma(middle)[0])
    assert np.std(off) == pytest.approx(1.0, abs=0.1)


def test_wind_is_seen_as_a_swing() -> None:
    true, _ = wire((0, 0, 20), (200, 0, 20), 800)
    blown = Catenary(0, 0, 1, 0, 200, 20, 20, 1 / 800, swing=0.2)
    rng = np.random.default_rng(3)
    points = blown.points(rng.uniform(0, 200, 600)) + rng.normal(0, 0.03, (600, 3))
    curve = fit(points)
    assert curve is not None
    assert curve.swing == pytest.approx(0.2, abs=0.01)
    assert true.sag == pytest.approx(curve.sag, abs=0.03)


def test_few_points_are_no_wire() -> None:
    assert fit(np.zeros((3, 3))) is None
    assert fit(np.zeros((9, 3))) is None


@pytest.mark.parametrize("towers", [True, False])
def test_wires_alone_are_enough(towers: bool) -> None:
    curves, wires, poles = line([0, 70, 140], [-1.5, 0, 1.5], 10, 500)
    parts, classes = [*wires], [14] * 6
    if towers:
        parts, classes = [*parts, poles], [*classes, 15]
    points = cloud(*parts, classes=classes)
    points = points.with_attributes({"classification": points["truth"]})
    result = CorridorCatenaries(points=points).run()
    assert result.span_count == 2
    assert len(result.spans) == len(curves) == 6
    np.testing.assert_allclose(result.spans.frame.c, 500, rtol=0.03)
    assert (result.spans.frame.rms < 0.06).all()


def test_all_points_of_a_cloud_without_classes_are_wire() -> None:
    points = cloud(*line([0, 120], [-2, 2], 15, 700)[1])
    result = CorridorCatenaries(points=points).run()
    assert len(result.wires) == 2


def test_curves_come_back_from_their_layer() -> None:
    points = cloud(*line([0, 120], [-2, 2], 15, 700)[1])
    layer = CorridorCatenaries(points=points).run().wires
    origin = np.array([500_000.0, 4_400_000.0, 0.0])
    for curve, shape in zip(catenaries_of(layer, origin), layer.frame.geometry, strict=True):
        corners = np.array(shape.coords) - origin
        _, v, z = curve.residuals(corners)
        assert np.abs(v).max() < 1e-6
        assert np.abs(z).max() < 1e-6


def test_no_wire_is_an_empty_layer(caplog: pytest.LogCaptureFixture) -> None:
    points = cloud(np.random.default_rng(0).uniform(0, 50, (2000, 3)))
    assert len(CorridorCatenaries(points=points).run().wires) == 0
    assert "no wire was found" in caplog.text


def test_a_class_is_wire_or_tower() -> None:
    points = cloud(np.zeros((5, 3)))
    with pytest.raises(ParameterError, match="tower_classes: must not be among wire_classes"):
        CorridorCatenaries(points=points, tower_classes=ClassList([14, 15]))


@pytest.mark.parametrize("seen", [90.0, 150.0])
def test_the_swing_of_a_cut_span_tells_how_well_it_is_known(seen: float) -> None:
    """Of a wire of 300 m that hangs 15 degrees aside; a third of it knows its swing to degrees."""
    rng = np.random.default_rng(7)
    whole = Catenary(0.0, 0.0, 0.0, 1.0, 300.0, 30.0, 30.0, 1 / 1200, swing=math.tan(0.26))
    found = []
    for _ in range(60):
        points = whole.points(np.sort(rng.uniform(0.0, seen, 400)))
        curve = fit(points + rng.normal(0.0, 0.04, (400, 3)))
        assert curve is not None
        found.append(Wire(curve, (-1, -1), (0.0, curve.length), 0.25))
    layer = wire_layer(found, np.zeros(3), 1.0, None)
    told = np.median(swing_sigmas(layer))
    assert np.std(layer.frame["swing"]) == pytest.approx(told, rel=0.25)


def test_a_swing_that_was_not_looked_for_has_no_error() -> None:
    curve = Catenary(0.0, 0.0, 0.0, 1.0, 60.0, 30.0, 30.0, 1 / 1200, rms=0.04, count=50)
    layer = wire_layer([Wire(curve, (-1, -1), (0.0, 60.0), 0.25)], np.zeros(3), 1.0, None)
    assert np.isnan(swing_sigmas(layer)).all()
