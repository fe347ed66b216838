"""Wires close above each other on poles without arms, as in streets."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scenes.corridors import Floats, bar, cloud, ground, tree, unlabelled, wire

from algorithms.corridor._curves.catenary import Catenary
from algorithms.corridor._curves.hardware import Beside, stems
from algorithms.corridor._extraction.continued import known_curvature
from algorithms.corridor._extraction.sheets import levelled, levels
from algorithms.corridor._extraction.spans import Wire
from algorithms.corridor._settings import SETTINGS
from algorithms.corridor.extract import CorridorExtract
from algorithms.samples.scene import SamplesScene

POLES = (0.0, 34.0, 66.0, 102.0, 135.0)  # along the street, metres
TOPS = (7.0, 7.35, 7.7, 8.05)  # heights of the wires at the poles, metres
C = 130.0  # metres: they sag by 1.1 m over 34 m


def street(per_metre: float, seed: int) -> tuple[list[Floats], Floats]:
    """Points of four wires on five poles, of each span, and those of the poles."""
    spans = []
    for a, b in itertools.pairwise(POLES):
        ends = [((a, 0.2, top), (b, 0.2, top)) for top in TOPS]
        made = [wire(*each, C, per_metre, seed=seed + k)[1] for k, each in enumerate(ends)]
        spans.append(np.vstack(made))
    poles = [
        bar((x, 0.0, 0.0), (x, 0.0, 8.4), 1.2, 0.04, seed=seed + k) for k, x in enumerate(POLES)
    ]
    return spans, np.vstack(poles)


# Of the second, only 9 of 16 wires are found if they are followed one by one.
@pytest.mark.parametrize(("per_metre", "seed"), [(0.6, 1), (0.3, 0)])
def test_wires_above_each_other_are_found_span_by_span(per_metre: float, seed: int) -> None:
    spans, poles = street(per_metre, seed)
    result = CorridorExtract(points=cloud(ground(140, 60, 10), *spans, poles)).run()
    wires, towers = result.wires.frame, result.towers.frame.geometry
    east = np.array([point.x for point in towers]) - 500_000
    for place in POLES[1:-1]:  # at the ends of the data a pole may be missing
        assert np.abs(east - place).min() < 1.0
    assert wires.groupby("span_id").size().tolist() == [len(TOPS)] * (len(POLES) - 1)
    assert wires.rms.max() < 0.1  # none changes over to the next
    assert wires.c.between(0.8 * C, 1.2 * C).all()


def test_a_street_whose_spans_rise_and_fall_is_found_to_its_end() -> None:
    """Where arcs as long as two spans were taken first, five of ten poles were found."""
    made = SamplesScene(kind="corridor", preset="street_low_voltage", seed=309).run()
    truth = made.points["classification"]
    found = CorridorExtract(points=unlabelled(made.points)).run()
    on_wire = found.classified["classification"] == 14
    assert np.mean(on_wire[truth == 14]) > 0.9
    assert found.tower_count == np.count_nonzero(made.features.frame.kind == "tower")


def below(*parts: Floats) -> Beside:
    """Points beside a wire that hangs 8 m above level ground, along x."""
    u, v, z = np.vstack(parts).T
    same = np.ones(len(u))
    return Beside(u, v, z, z, -0.3 * same, 0.3 * same, 8.0 * same, 8.6 * same)


CHAINAGES = np.arange(0.0, 60.0, 0.25)
POLE = np.array([(30.0, 0.0, z) for z in (1.5, 3.2, 4.6, 6.1, 7.4)])


def test_a_few_points_of_a_pole_tell_of_it() -> None:
    found = stems(below(POLE), CHAINAGES)
    assert found.max() > SETTINGS.arcs.certain_arm
    assert np.abs(CHAINAGES[found > 0] - 30.0).max() < 1.0


def test_what_does_not_reach_the_wires_is_no_pole() -> None:
    low = np.array([(30.0, 0.0, z) for z in (1.2, 1.9, 2.7, 3.6, 4.6)])
    assert stems(below(low), CHAINAGES).max() == 0.0


def test_a_drop_from_a_wire_is_no_pole() -> None:
    drop = np.array([(30.0, 0.0, z) for z in (4.3, 5.1, 5.9, 6.6, 7.4)])
    assert stems(below(drop), CHAINAGES).max() == 0.0


def test_a_tree_is_no_pole() -> None:
    crown = tree(30.0, 0.0, 7.5, 2.5, 400)
    assert stems(below(crown), CHAINAGES).max() < SETTINGS.arcs.certain_arm


def test_a_single_point_is_no_pole() -> None:
    assert stems(below(POLE[-1:]), CHAINAGES).max() == 0.0


def test_the_shape_of_wires_above_each_other_is_found() -> None:
    spans, _ = street(0.5, 3)
    u, z = spans[0][:, 0], spans[0][:, 2]
    flat, bend = levelled(u, z, POLES[1], 0.1)
    assert bend == pytest.approx(1 / C, rel=0.15)
    found = levels(flat, 0.1)
    assert len(found) == len(TOPS)
    assert sum(map(len, found)) > 0.9 * len(u)


def test_a_curvature_that_is_not_known_is_taken_from_other_wires() -> None:
    curve = wire((0.0, 0.0, 8.0), (40.0, 0.0, 8.0), C)[0]
    vague, known = (
        Wire(_with_sd(curve, share), (-1, -1), (0.0, 40.0), 0.1) for share in (0.5, 0.02)
    )
    assert known_curvature([vague], [known]) == pytest.approx(1 / C)
    assert known_curvature([vague]) is None


def _with_sd(curve: Catenary, share: float) -> Catenary:
    """A curve whose curvature is known to a share of it."""
    return replace(curve, covariance=np.diag([1e-4, 1e-4, (share * curve.curvature) ** 2]))
