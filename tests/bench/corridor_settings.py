"""How much each number by which power lines are found is felt: halved, and doubled."""

from __future__ import annotations

import argparse
import hashlib
import logging
import pickle
import statistics
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from tests.bench.corridor_presets import towers_found
from tests.bench.measuring import DATA, say

REAL = {"12BZ1_21": 0.3, "hills": 0.2}  # share of the length of a real line that is looked at
LINES = ("wood_poles", "portal_frames", "street_flat_arms", "two_wires")
NO_LINES = ("no_line_railway", "no_line_hop_garden", "no_line_suspension_bridge")
MORE = ("branch_poles", "street_low_voltage", "old_survey", "crossing_over_poles", "shifted_strips")
LATE = ("towers", "errors")  # groups that are needed after wires were followed alone
_CLASS_OF_REFERENCE = np.array([1, 14, 15], np.uint8)  # of the attribute: other, wire, tower


def corridor_settings(*options: str) -> None:
    """Wires, towers and spans with each number of the extraction halved, and doubled.

    Options: --only GROUP,GROUP.NUMBER (all), --cases quick|none|all|NAME,NAME (quick: scenes of
    lines, and pieces of real ones; none: scenes without a line; or some of these)
    """
    from algorithms.corridor._settings import SETTINGS, changed, names

    parser = argparse.ArgumentParser("corridor_settings", allow_abbrev=False)
    parser.add_argument("--only", default="", help="groups, or group.number (default all)")
    parser.add_argument("--cases", default="quick", help="quick, none, all or names of cases")
    given = parser.parse_args(options)
    logging.getLogger("toolbox").setLevel(logging.ERROR)
    quick = (*LINES, *REAL)
    chosen = {"quick": quick, "none": NO_LINES, "all": (*quick, *NO_LINES, *MORE)}
    wanted = chosen.get(given.cases) or given.cases.split(",")
    cases = [_real(name, REAL[name]) if name in REAL else _scene(name) for name in wanted]
    usual = [case.row() for case in cases]
    for case, row in zip(cases, usual, strict=True):
        say(f"settings {case.name:26} {row}")
    only = tuple(given.only.split(","))
    silent = 0
    for name in names():
        if given.only and not {name, name.split(".")[0]} & set(only):
            continue
        group, one = name.split(".")
        late = group in LATE
        for title, value, other in _others(getattr(getattr(SETTINGS, group), one), _unit(name)):
            with changed(name, other):
                rows = [case.row(late=late, anew=group == "points") for case in cases]
            felt = sum(a.print != b.print for a, b in zip(rows, usual, strict=True))
            silent += not felt
            text = _difference(cases, usual, rows) if felt else "not felt"
            say(f"settings {name + title:34} {value:>8} {_unit(name)[:12]:12} {text}")
            sys.stdout.flush()
    say(f"settings {silent} of the changes were not felt")


# --- what is changed -----------------------------------------------------------------------


def _unit(name: str) -> str:
    """Unit of a number."""
    from algorithms.corridor._settings import SETTINGS

    group, one = name.split(".")
    unit = {field.name: field.metadata["unit"] for field in fields(getattr(SETTINGS, group))}[one]
    return str(unit)


def _others(value: Any, unit: str) -> Iterator[tuple[str, str, Any]]:
    """Words, the number that is changed to, and the value to set: for each number, both ways."""
    every = value if isinstance(value, tuple) else (value,)
    for k, own in enumerate(every):
        for word, factor in (("/2", 0.5), ("*2", 2.0)):
            other = factor * own
            if isinstance(own, int):
                other = min(own - 1, round(other)) if factor < 1 else max(own + 1, round(other))
            elif unit in ("1", "cosine") and own < 1 <= other:
                other = (1 + own) / 2
            place = f"[{k}]" if len(every) > 1 else ""
            made = (*every[:k], other, *every[k + 1 :])
            yield f"{place}{word}", f"{other:.4g}", made if len(every) > 1 else other


# --- what it is tried on -------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """What was found of one case.

    Attributes
    ----------
    wires, bodies : points that are wire by both, or tower, among those that are by either, per
        cent; NaN without any
    towers : found, invented; all and 0 of a real line
    spans : found in full; all of a real line
    invented : wires that are not in the truth
    print : of all that was found, to the last digit
    """

    wires: float
    bodies: float
    towers: tuple[int, int]
    spans: int
    invented: int
    print: str

    def __str__(self) -> str:
        return (
            f"wires {self.wires:5.1f} %, points of towers {self.bodies:5.1f} %  "
            f"towers {self.towers[0]}, invented {self.towers[1]}  "
            f"spans {self.spans}, wires invented {self.invented}"
        )


@dataclass
class Case:
    """A cloud, with what is true of it: classes, feet of towers and wires, if there are."""

    name: str
    cloud: Any
    truth: Any
    feet: Any = None
    lines: Any = None

    def points(self) -> Any:
        """The points in which a line is sought."""
        from algorithms.corridor._extraction.points import CorridorPoints
        from toolbox.context import QUIET

        return CorridorPoints.of(self.cloud, np.ones(len(self.cloud), bool), None, QUIET)

    @cached_property
    def _points(self) -> Any:
        return self.points()

    @cached_property
    def _followed(self) -> Any:
        return self._follow(self._points)

    def _follow(self, points: Any) -> Any:
        """The corridor, wires and supports."""
        from algorithms.corridor.extract import followed

        return followed(points)

    def row(self, *, late: bool = False, anew: bool = False) -> Row:
        """Extract the line.

        Parameters
        ----------
        late : the wires as they were followed with all numbers as they are
        anew : the points too are chosen anew
        """
        from algorithms.compare.spans import CompareSpans
        from algorithms.corridor._extraction.layers import wire_layer
        from algorithms.corridor.extract import finished

        points = self.points() if anew else self._points
        line = finished(points, *(self._followed if late else self._follow(points)))
        wires = self._quality(points.index, line.labels["wire_id"], (13, 14))
        bodies = self._quality(points.index, line.labels["tower_id"], (15,))
        towers, spans = (len(line.towers), 0), len({one.span for one in line.wires})
        invented = len(line.wires) if self.feet is not None else 0
        if self.feet is not None:
            spans = 0
            place = np.array([(t.support.x, t.support.y) for t in line.towers]).reshape(-1, 2)
            near, away = towers_found(self.feet, place + points.origin[:2])
            towers = len(away), len(place) - int(near.sum())
        if self.lines is not None:
            layer = wire_layer(line.wires, points.origin, 1.0, self.cloud.crs)
            compared = CompareSpans(wires=layer, reference=self.lines).run()
            spans, invented = compared.in_full, compared.invented
        everything = pickle.dumps((line.labels, line.wires, line.towers, line.strings))
        return Row(wires, bodies, towers, spans, invented, hashlib.sha256(everything).hexdigest())

    def _quality(self, index: Any, number: Any, classes: tuple[int, ...]) -> float:
        """Points with a number and of the classes, among those with either; insulators are open."""
        said = np.zeros(len(self.cloud), bool)
        said[index] = number > 0
        true, may = np.isin(self.truth, classes), self.truth != 16
        either = (may & (said | true)).sum()
        return 100 * float((said & true).sum()) / either if either else float("nan")


def _scene(preset: str) -> Case:
    """A preset of synthetic corridors, unlabelled."""
    from algorithms.samples.scene import SamplesScene
    from toolbox.data import Vector

    made = SamplesScene(kind="corridor", preset=preset, seed=0).run()  # type: ignore[arg-type]
    truth, features = made.points["classification"], made.features.frame
    blank = made.points.with_attributes({"classification": np.ones(len(truth), np.uint8)})
    towers = features[features.kind == "tower"].geometry
    feet = np.array([shapely.get_coordinates(one)[0] for one in towers]).reshape(-1, 2)
    lines = features[features.kind == "wire"]
    return Case(preset, blank, truth, feet, Vector(lines) if len(lines) else None)


def _real(name: str, share: float) -> Case:
    """A share of the length of a real line."""
    from pyproj import CRS

    from toolbox.data import PointCloud

    if name == "hills":
        cloud = PointCloud.open(DATA / "line_quebec_hills/west.laz")
        truth = _CLASS_OF_REFERENCE[cloud["reference"]]
    else:
        cloud = PointCloud.open(DATA / f"powerline_ahn4/{name}_as_published.laz")
        cloud = cloud.with_crs(CRS(28992))
        truth = cloud["classification"]
    xy = cloud.xyz[:, :2] - cloud.xyz[:, :2].mean(axis=0)
    wire = xy[np.isin(truth, (13, 14))]
    way = np.linalg.eigh(np.cov(wire.T))[1][:, 1]
    along = xy @ way
    low, high = np.quantile(wire @ way, (0, 1))
    near = along <= low + share * (high - low)
    return Case(name, cloud.select(near), truth[near])


# --- what is printed -----------------------------------------------------------------------


def _difference(cases: Sequence[Case], usual: Sequence[Row], rows: Sequence[Row]) -> str:
    """By how much it is better or worse."""
    text = ""
    for what in ("wires", "bodies"):
        change = [getattr(b, what) - getattr(a, what) for a, b in zip(usual, rows, strict=True)]
        known = [k for k, value in enumerate(change) if np.isfinite(value)]
        if known:
            worst = min(known, key=lambda k: change[k])
            mean = statistics.mean(change[k] for k in known)
            text += f"{what} {mean:+6.2f} %, worst {change[worst]:+6.2f} ({cases[worst].name}) "
    sums = [
        sum(of(b) - of(a) for a, b in zip(usual, rows, strict=True))
        for of in (
            lambda row: row.towers[0],
            lambda row: row.towers[1],
            lambda row: row.spans,
            lambda row: row.invented,
        )
    ]
    felt = sum(a.print != b.print for a, b in zip(usual, rows, strict=True))
    text += "towers {:+d}, invented {:+d}; spans {:+d}, wires invented {:+d}".format(*sums)
    return f"{text}  felt in {felt} of {len(cases)}"
