"""Power lines of real surveys: points of wires, towers in plan, spans, and lines of a town."""

from __future__ import annotations

import argparse
import logging
import time
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from tests.bench.corridor_presets import towers_found, wire_points
from tests.bench.measuring import DATA, say

CLASS_OF_REFERENCE = np.array([1, 14, 15], np.uint8)  # of the attribute: other, wire, tower
# Towers of line_quebec_hills, east and north of HILL_ORIGIN, from its README to a few metres; the
# middle of the reference points around each is taken for its foot.
HILL_TOWERS = ((80.0, 270.0), (445.0, 500.0), (118.0, 215.0), (468.0, 432.0))
HILL_ORIGIN = (267000.0, 5481184.0)
TOWER_RADIUS = 15.0  # m around a tower, of its points
NEAR_TOWER = 3.0  # m in plan: the middles of points of lattices are known to 1 or 2 m
# Axes in plan of the wires of line_williams_town, metres east and north of TOWN_ORIGIN, drawn by
# eye on its points 3 m above the ground. Wires side by side within 1 m are one axis. Left out is
# what fewer than five points tell.
TOWN_ORIGIN = (391867.0, 3901019.0)
TOWN_AXES = {
    "street, north wire": ((40.5, 164.8), (66.0, 175.8)),
    "street, north wire, east": ((83.0, 182.3), (109.0, 192.0), (192.3, 224.3)),
    "street, south wire": ((70.5, 172.5), (84.0, 178.3), (192.3, 220.5)),
    "branch": ((114.8, 189.5), (130.0, 150.2), (123.0, 119.5)),
    "branch, south": ((130.0, 150.2), (137.0, 132.0)),
    "yard": ((172.0, 204.0), (178.7, 190.0), (192.3, 195.9)),
    "school, east": ((157.0, 87.3), (192.3, 102.3)),
    "school, south": ((135.2, 57.5), (138.0, 37.5)),
    "drop, west": ((58.0, 143.0), (66.5, 148.2)),
    "drop, north-east": ((188.0, 247.5), (192.3, 243.3)),
}
# Where these go on with fewer than five points, or hidden in a crown: neither missed nor wrong.
TOWN_UNSURE = (
    ((32.6, 161.5), (40.5, 164.8)),
    ((66.0, 175.8), (83.0, 182.3)),
    ((30.7, 156.4), (70.5, 172.5)),
)
ON_AXIS = 1.0  # m in plan from an axis, of a wire that is one of those drawn
STEP = 0.5  # m along axes and wires between places that are compared
LEFT_OUT = 0.01  # of the points, of each draw
AT_END = 3.0  # m in plan from a place where axes end or meet, of a pole


def corridor_real(*options: str) -> None:
    """Extraction from real corridors.

    Options: --data 12AN2_20,12BZ1_21,hills,town (all) --draws 0 (of the town, a hundredth left out)
    --first 0 (seed; 0 to 5 were chosen on)
    """
    parser = argparse.ArgumentParser("corridor_real", allow_abbrev=False)
    parser.add_argument("--data", default="12AN2_20,12BZ1_21,hills,town", help="names (all)")
    parser.add_argument("--draws", type=int, default=0, help="of the town, points left out (0)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first draw (0)")
    chosen = parser.parse_args(options)
    logging.getLogger("toolbox").setLevel(logging.ERROR)
    for name in chosen.data.split(","):
        if name == "town":
            _town(name, range(chosen.first, chosen.first + chosen.draws))
        else:
            {"hills": _hills}.get(name, _tile)(name)


def _tile(name: str) -> None:
    """A tile with a line of one circuit, whose classes are the truth."""
    from pyproj import CRS

    from toolbox.data import PointCloud

    path = DATA / f"powerline_ahn4/{name}_as_published.laz"
    cloud = PointCloud.open(path).with_crs(CRS(28992))
    truth = cloud["classification"]
    foot = np.median(cloud.xyz[truth == 15, :2], axis=0)
    _said(name, cloud, truth, foot[None])


def _hills(name: str) -> None:
    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / "line_quebec_hills/west.laz")
    truth = CLASS_OF_REFERENCE[cloud["reference"]]
    tower = cloud.xyz[truth == 15, :2]
    feet = [
        np.median(tower[np.hypot(*(tower - place).T) < TOWER_RADIUS], axis=0)
        for place in np.add(HILL_TOWERS, HILL_ORIGIN)
    ]
    _said(name, cloud, truth, np.array(feet))


def _said(name: str, cloud: Any, truth: NDArray[np.uint8], feet: NDArray[np.float64]) -> None:
    """Say what is found of a cloud of which each wire point and tower is known."""
    found, seconds = _extracted(cloud)
    correct, complete = wire_points(found.classified["classification"], truth)
    places = shapely.get_coordinates(found.towers.frame.geometry)
    near, away = towers_found(feet, places, NEAR_TOWER)
    say(
        f"corridor_real {name:9} wires {correct:5.1f} / {complete:5.1f}  "
        f"towers {len(away)} of {len(feet)}, invented {int((~near).sum())}  "
        f"spans {found.span_count}, wires {len(found.wires)}  {seconds:.1f} CPU s / M points"
    )


def _town(name: str, draws: range) -> None:
    """Wires of a town, by length along the axes drawn: their points are not told apart.

    What a single run finds depends on single points, so the means of draws say more: each with a
    hundredth of the points left out at random.
    """
    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / "line_williams_town/west.laz")
    axes = {key: shapely.LineString(np.add(xy, TOWN_ORIGIN)) for key, xy in TOWN_AXES.items()}
    rows = []
    for seed in draws:
        kept = np.random.default_rng(seed).random(len(cloud)) >= LEFT_OUT
        rows.append(_town_run(f"{name} {seed}", cloud.select(kept), axes, False))
    if draws:
        found, right, poles, good = np.mean(rows, axis=0)
        least, draw = np.min(rows, axis=0), np.argmin(rows, axis=0)
        say(
            f"corridor_real {name:9} mean of {len(draws)} draws: found {found:.1f} %, "
            f"right {right:.1f} % (least {least[0]:.1f} % in draw {draws[draw[0]]}, "
            f"{least[1]:.1f} % in draw {draws[draw[1]]})  poles {poles:.1f}, "
            f"where lines bend or end {good:.1f}"
        )
    else:
        _town_run(name, cloud, axes, True)


def _town_run(
    name: str, cloud: Any, axes: dict[str, Any], each: bool
) -> tuple[float, float, int, int]:
    """Say what of the axes is found; per cent found, per cent right, poles, those at ends."""
    found, seconds = _extracted(cloud)
    wires = [shapely.force_2d(line) for line in found.wires.frame.geometry]
    shares = {key: share_within(axis, wires) for key, axis in axes.items()}
    length = sum(axis.length for axis in axes.values())
    seen = 100 * sum(shares[key] * axis.length for key, axis in axes.items()) / length
    unsure = [shapely.LineString(np.add(xy, TOWN_ORIGIN)) for xy in TOWN_UNSURE]
    on_axis = sum(share_within(wire, list(axes.values())) * wire.length for wire in wires)
    either = sum(share_within(wire, [*axes.values(), *unsure]) * wire.length for wire in wires)
    claimed = on_axis + sum(wire.length for wire in wires) - either
    right = 100 * on_axis / max(claimed, 1e-9)
    ends = shapely.MultiPoint(np.vstack([axis.coords for axis in axes.values()]))
    poles = [point.distance(ends) < AT_END for point in found.towers.frame.geometry]
    say(
        f"corridor_real {name:9} of {length:.0f} m of line found {seen:.1f} %, "
        f"of {claimed:.0f} m found {right:.1f} % are line  "
        f"poles {len(poles)}, where lines bend or end {sum(poles)}  spans {found.span_count}, "
        f"wires {len(found.wires)}  {seconds:.1f} CPU s / M points"
    )
    for key, share in shares.items():
        if each:
            say(
                f"corridor_real {name:9}   {key:26} {axes[key].length:4.0f} m  {100 * share:3.0f} %"
            )
    return seen, right, len(poles), sum(poles)


def share_within(line: Any, others: list[Any]) -> float:
    """Share of the length of a line that is within ON_AXIS of one of the others, in plan."""
    if not others:
        return 0.0
    places = shapely.line_interpolate_point(line, np.arange(STEP / 2, line.length, STEP))
    return float((shapely.distance(places, shapely.union_all(others)) < ON_AXIS).mean())


def _extracted(cloud: Any) -> tuple[Any, float]:
    """What is found, and CPU seconds per million points."""
    from algorithms.corridor.extract import CorridorExtract

    start = time.process_time()
    found = CorridorExtract(points=cloud).run()
    return found, (time.process_time() - start) / len(cloud) * 1e6
