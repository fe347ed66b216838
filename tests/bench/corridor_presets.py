"""Power lines in the presets of synthetic corridors, and what is wrongly taken for one."""

from __future__ import annotations

import argparse
import itertools
import logging
import math
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tests.bench.measuring import say

CHOOSING, REPORTING = (0, 1, 2), (100, 101, 102)
NEAR_FOOT = 2.0  # m within which a tower is found
STEP = 5.0  # m between the heights of a catenary that are compared
WORST = 12  # presets named at the end


@dataclass(frozen=True)
class Row:
    """What was found of one scene; shares in per cent, lengths in metres.

    Attributes
    ----------
    towers : found, true, invented, and found a second time
    unsaid : of the invented ones, those that are said to be certain
    away : mean distance of the towers found from the true ones
    spans : found in full, true
    invented : wires that are not in the truth
    rms : of the heights of wires over the true ones
    within : share of heights of wires found in full within two standard deviations of the truth
    """

    preset: str
    seed: int
    correct: float
    complete: float
    towers: tuple[int, int, int, int]
    unsaid: int
    away: float
    spans: tuple[int, int]
    invented: int
    rms: float
    within: float
    seconds: float

    @property
    def quality(self) -> float:
        """Points that are wire by both, among those that are by either, per cent."""
        if not self.correct or not self.complete:
            return 0.0
        return 100 / (100 / self.correct + 100 / self.complete - 1)


def corridor_presets(*options: str) -> None:
    """Extraction from each preset of samples.scene --kind corridor, all points unlabelled.

    Options: --seeds 0,1,2 (for choosing; 100,101,102 are for reporting alone: look at no scene of
    theirs before a change is settled), --presets NAME,NAME (all)
    """
    from algorithms.samples._corridor.presets import PRESETS

    parser = argparse.ArgumentParser("corridor_presets", allow_abbrev=False)
    choose, report = (",".join(map(str, seeds)) for seeds in (CHOOSING, REPORTING))
    parser.add_argument(
        "--seeds",
        default=choose,
        help=f"{choose} are for choosing, {report} for reporting alone (default {choose})",
    )
    parser.add_argument("--presets", default=",".join(PRESETS), help="names (default all)")
    given = parser.parse_args(options)
    logging.getLogger("toolbox").setLevel(logging.ERROR)
    seeds = [int(word) for word in given.seeds.split(",")]
    rows = []
    for preset, seed in itertools.product(given.presets.split(","), seeds):
        rows.append(measured(preset, seed))
        say(f"presets {_text(rows[-1])}")
    _summary(rows)


def measured(preset: str, seed: int) -> Row:
    """Extract the power lines of a scene, and compare them with its truth."""
    from algorithms.compare.spans import CompareSpans
    from algorithms.corridor.extract import CorridorExtract
    from algorithms.samples.scene import SamplesScene
    from toolbox.data import Vector

    made = SamplesScene(kind="corridor", preset=preset, seed=seed).run()  # type: ignore[arg-type]
    truth, features = made.points["classification"], made.features.frame
    blank = made.points.with_attributes({"classification": np.ones(len(truth), np.uint8)})
    start = time.process_time()
    found = CorridorExtract(points=blank).run()
    seconds = (time.process_time() - start) / len(truth) * 1e6
    correct, complete = wire_points(found.classified["classification"], truth)
    true_towers = features[features.kind == "tower"].geometry
    feet = [shapely.get_coordinates(shape)[0] for shape in true_towers]
    near, away = towers_found(
        np.array(feet).reshape(-1, 2), shapely.get_coordinates(found.towers.frame.geometry)
    )
    row: dict[str, Any] = {
        "preset": preset,
        "seed": seed,
        "correct": correct,
        "complete": complete,
        "towers": (len(away), len(feet), int((~near).sum()), int(near.sum()) - len(away)),
        "unsaid": int((~near & (found.towers.frame["certain"] == 1).to_numpy()).sum()),
        "away": float(np.mean(away)) if len(away) else math.nan,
        "seconds": seconds,
    }
    lines = features[features.kind == "wire"]
    if not len(lines):
        no_span = {"spans": (0, 0), "rms": math.nan, "within": math.nan}
        return Row(invented=len(found.wires), **no_span, **row)
    spans = CompareSpans(wires=found.wires, reference=Vector(lines)).run()
    return Row(
        spans=(spans.in_full, spans.in_full + spans.in_part + spans.missed),
        invented=spans.invented,
        rms=math.nan if spans.height_rms is None else spans.height_rms,
        within=_within(found.wires, list(lines.geometry), spans.table.frame),
        **row,
    )


def wire_points(said: NDArray[Any], truth: NDArray[Any]) -> tuple[float, float]:
    """Correctness and completeness of class 14, per cent; nan where there is nothing to count.

    Guard wires (13) count as wires; insulators (16) may be wire, tower or neither.
    """
    wire, may = np.isin(truth, (13, 14)), truth != 16
    both = float(((said == 14) & wire).sum())
    claimed, true = ((said == 14) & may).sum(), wire.sum()
    return 100 * both / claimed if claimed else math.nan, 100 * both / true if true else math.nan


def towers_found(
    true: NDArray[np.float64], found: NDArray[np.float64], radius: float = NEAR_FOOT
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Which towers found are within a radius of a true one, and distances one to one, in plan.

    Parameters
    ----------
    true, found : arrays of shape (n, 2) and (m, 2), metres
    radius : metres
    """
    away = np.hypot(*(true[:, None, :] - found[None, :, :]).transpose(2, 0, 1))
    near = (away <= radius).any(axis=0)
    far = 1e3
    away = np.where(away <= radius, away, far)
    chosen = away[linear_sum_assignment(away)]
    return near, chosen[chosen < far]


def _within(wires: Any, lines: Sequence[Any], table: Any) -> float:
    """Share of heights of the wires found in full that are within two sigma of the truth."""
    from algorithms.corridor._extraction.layers import catenaries_of

    origin = np.array([*shapely.get_coordinates(lines[0])[0], 0.0])
    curves = catenaries_of(wires, origin)
    inside = []
    for line, row in zip(lines, table.to_dict("records"), strict=False):
        if row["found"] != "in full":
            continue
        curve = curves[int(row["wire"])]
        xyz = shapely.get_coordinates(line, include_z=True) - origin
        u, _ = curve.along(xyz)
        order = np.argsort(u)
        places = np.arange(max(0.0, u.min()), min(curve.length, u.max()), STEP)
        error = curve.height(places) - np.interp(places, u[order], xyz[order, 2])
        inside.append(np.abs(error) <= 2 * curve.height_sigma(places))
    return 100 * float(np.concatenate(inside).mean()) if inside else math.nan


# --- what is printed -----------------------------------------------------------------------


def _text(row: Row) -> str:
    """One line on a scene."""
    towers, true, more, twice = row.towers
    text = f"{row.preset:26} seed {row.seed:3}"
    if not row.spans[1]:
        return (
            f"{text}  no line: wires invented {row.invented}, towers {more} ({row.unsaid} certain)"
        )
    return (
        f"{text}  wires {row.correct:5.1f} / {row.complete:5.1f}"
        f"  towers {towers:2} of {true:2}, invented {more:2} ({row.unsaid} certain), "
        f"twice {twice}, off {row.away:4.2f} m"
        f"  spans in full {row.spans[0]:2} of {row.spans[1]:2}, wires invented {row.invented:2}"
        f"  height RMS {row.rms:.3f} m, within 2 sigma {row.within:3.0f} %"
        f"  {row.seconds:.1f} CPU s / M points"
    )


def _summary(rows: Sequence[Row]) -> None:
    """Means over all scenes, and the presets whose wires are found worst."""
    lines, none = [row for row in rows if row.spans[1]], [row for row in rows if not row.spans[1]]
    if lines:
        found, true, more, twice = (sum(row.towers[k] for row in lines) for k in range(4))
        full, spans = (sum(row.spans[k] for row in lines) for k in range(2))
        say(
            f"presets mean of {len(lines)} scenes: wires correct {_mean(lines, 'correct'):.1f}, "
            f"complete {_mean(lines, 'complete'):.1f}, quality {_mean(lines, 'quality'):.1f}; "
            f"towers {found} of {true}, invented {more} "
            f"({sum(row.unsaid for row in lines)} certain), twice {twice}, "
            f"off {_mean(lines, 'away'):.2f} m; spans in full {full} of {spans}, "
            f"wires invented {sum(row.invented for row in lines)}; "
            f"height RMS {_mean(lines, 'rms'):.3f} m, within 2 sigma {_mean(lines, 'within'):.0f} %"
        )
    if none:
        say(
            f"presets {len(none)} scenes without a line: "
            f"wires invented {sum(row.invented for row in none)}, "
            f"towers {sum(row.towers[2] for row in none)}"
        )
    worst = sorted(lines, key=lambda row: row.quality)[:WORST]
    for row in worst:
        say(f"presets worst: quality of wires {row.quality:5.1f}  {_text(row)}")


def _mean(rows: Sequence[Row], name: str) -> float:
    """Mean of those that have a value."""
    values = [getattr(row, name) for row in rows if math.isfinite(getattr(row, name))]
    return statistics.mean(values) if values else math.nan
