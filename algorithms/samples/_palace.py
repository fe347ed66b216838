"""A house front with relief: pilasters, cornices, balconies, arches, shutters; trees and cables.

Three storeys. The wall is pierced by openings, and stands behind all that is in relief; the upper
storey of every second house stands back.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from algorithms.samples._survey import GROUND, UNCLASSIFIED

if TYPE_CHECKING:
    from algorithms.samples._facade import House

STOREYS, STOREY = 3, 3.3  # metres high each
PILASTER, COURSE, CORNICE, PLINTH = 0.6, 0.3, 0.5, 0.4  # metres wide or high
TREE, LEAVES, LEAF = 7, 700, 0.1  # of eight bays; leaves of a crown, and their side in metres
ARCH_SIDES = 8  # straight pieces of the soffit of an arch
CABLE = 0.03  # metres thick


def palace(house: House, bay_width: float, relief: float, seed: int, fall: Any) -> None:
    """Add the faces of a front with relief to an empty house.

    Parameters
    ----------
    bay_width : metres between the middles of pilasters
    relief : how far pilasters and the cornice stand before the wall, metres
    seed : the upper storey of houses with an odd one stands back
    fall : height of the ground at x, y
    """
    size, top = house.size, STOREYS * STOREY
    ground = (-15.0, -25.0, fall(-15.0, -25.0))
    along = (size + 30, 0, fall(size + 15, 0) - fall(-15, 0))
    inwards = (0, 40.0, fall(0, 40.0) - fall(0, 0))
    house.face("ground", ground, along, inwards, cls=GROUND, shade=9000)
    upper, back = (STOREYS - 1) * STOREY, 0.4 * relief * (seed % 2)
    house.face("wall", (0, 0, -1), (size, 0, 0), (0, 0, upper + 1), pierced=True)
    house.face("wall", (0, back, upper), (size, 0, 0), (0, 0, STOREY), pierced=True)
    for x in (0, size):
        house.face("side wall", (x, 0, -1), (0, 9.0, 0), (0, 0, top + 1), shade=26000)
    _bands(house, size, top, relief)
    bays = int(size // bay_width)
    for bay in range(bays + 1):
        x = min(bay * bay_width, size - PILASTER / 2)
        low, high = (x - PILASTER / 2, -relief, PLINTH), (x + PILASTER / 2, 0.0, top - CORNICE)
        house.box("pilaster", low, high, bay=min(bay, bays - 1), shade=29000)
    for bay, storey in itertools.product(range(bays), range(STOREYS)):
        depth = back if storey == STOREYS - 1 else 0.0
        _place(house, bay, storey, ((bay + 0.5) * bay_width, depth), relief)
    for bay in range(TREE, bays, 8):
        _tree(house, bay, (bay + 0.5) * bay_width)
    low, high = (
        (0.0, -relief - 0.3, upper - 0.2),
        (size, -relief - 0.3 + CABLE, upper - 0.2 + CABLE),
    )
    house.box("cable", low, high, cls=UNCLASSIFIED, shade=8000)
    car = 0.45 * size
    low, high = (car, -5.0, fall(car, -5) + 0.3), (car + 4.4, -3.2, fall(car, -5) + 1.5)
    house.box("van", low, high, cls=UNCLASSIFIED, shade=40000)


def _bands(house: House, size: float, top: float, relief: float) -> None:
    """Plinth, string courses between the storeys, and cornice."""
    house.box("plinth", (0.0, -0.3 * relief, -1.0), (size, 0.0, PLINTH), shade=22000)
    for storey in range(1, STOREYS):
        z = storey * STOREY - COURSE
        house.box("course", (0.0, -0.6 * relief, z), (size, 0.0, z + COURSE), shade=29000)
    house.box("cornice", (0.0, -1.3 * relief, top - CORNICE), (size, 0.0, top), shade=29000)


def _place(house: House, bay: int, storey: int, at: tuple[float, float], relief: float) -> None:
    """A door or an arch, a shop window, a window with shutters, a balcony with its door."""
    middle, depth = at
    floor = storey * STOREY
    if storey == 0:
        if bay % 4 == 1:
            _opening(house, bay, (middle - 0.9, middle + 0.9, 0.05, 2.6), depth, "door", arch=True)
        elif bay % 4 == 3:
            _opening(house, bay, (middle - 0.6, middle + 0.6, 0.05, 2.2), depth, "door")
        else:
            _opening(house, bay, (middle - 1.0, middle + 1.0, 0.7, 2.5), depth, "window")
        return
    frame = (middle - 0.55, middle + 0.55, floor + 0.9, floor + 2.5)
    if storey == 1 and bay % 4 == 2:
        frame = (middle - 0.6, middle + 0.6, floor + 0.1, floor + 2.4)
        low, high = (middle - 1.1, -relief - 0.7, floor - 0.1), (middle + 1.1, 0.0, floor + 0.05)
        house.box("balcony", low, high, bay=bay, shade=24000)
        low, high = (low[0], low[1], high[2]), (high[0], low[1] + 0.05, floor + 0.95)
        house.box("balcony", low, high, bay=bay, shade=20000)
    _opening(house, bay, frame, depth, "window", arch=storey == 2 and bay % 3 == 0)
    if (bay + storey) % 3 == 1:
        _shutters(house, bay, frame, depth, (bay + storey) % 2)


def _shutters(house: House, bay: int, frame: Any, depth: float, closed: int) -> None:
    """Two leaves, the left one open beside the opening, the right one closed or open too."""
    x1, x2, z1, z2 = frame
    half, up = (x2 - x1) / 2, (0, 0, z2 - z1)
    for x, open_ in ((x1 - half, True), (x2, not closed), (x2 - half, bool(closed))):
        if open_:
            y = depth + (0.06 if x == x2 - half else -0.05)
            house.face("shutter", (x, y, z1), (half, 0, 0), up, bay=bay, shade=14000)


def _tree(house: House, bay: int, x: float) -> None:
    """A trunk and leaves in a ball before the front."""
    rng = np.random.default_rng(bay)
    low, high = (x - 0.1, -2.2, -0.3), (x + 0.1, -2.0, 3.0)
    house.box("clutter", low, high, bay=bay, cls=UNCLASSIFIED, shade=9000)
    for _ in range(LEAVES):
        place = rng.normal((x, -2.1, 3.9), (0.6, 0.35, 0.7))
        e, f = np.linalg.qr(rng.normal(size=(3, 2)))[0].T * LEAF
        house.face("clutter", place, e, f, bay=bay, cls=UNCLASSIFIED, shade=9000)


def _opening(
    house: House,
    bay: int,
    frame: tuple[float, float, float, float],
    depth: float,
    kind: str,
    *,
    arch: bool = False,
) -> None:
    """A hole with its reveals and what closes it: a leaf, or a pane with or without echoes."""
    x1, x2, z1, z2 = frame
    rng = house.rng
    recess = round(float(rng.uniform(0.1, 0.25)), 3)
    rise = (x2 - x1) / 2 if arch else 0.0
    house.openings.append((*frame, rise, bay))
    number = len(house.openings)
    own: dict[str, Any] = {"bay": bay, "opening": number}
    ring = _ring(frame, rise)
    for (xa, za), (xb, zb) in itertools.pairwise([*ring, ring[0]]):
        corner, side = (xa, depth, za), (xb - xa, 0, zb - za)
        house.face("reveal", corner, side, (0, recess, 0), shade=28000, **own)
    pane: tuple[Any, Any, Any] = (x1, depth + recess, z1), (x2 - x1, 0, 0), (0, 0, z2 - z1)
    closed = rng.random()
    if kind == "door":
        house.face("door", pane[0], pane[1], pane[2], shade=12000, **own)
    elif closed < 0.25:  # a pane that reflects the beam away: nothing comes back
        kind = "reflecting window"
    else:
        glass: dict[str, Any] = {"cls": UNCLASSIFIED, "shade": 3000, "chance": 0.3}
        house.face("glass", pane[0], pane[1], pane[2], **glass, **own)
        bar = (x1 + x2) / 2 - 0.03
        house.face("frame", (bar, depth + recess - 0.03, z1), (0.06, 0, 0), pane[2], **own)
        if closed < 0.7:
            behind = depth + recess + float(rng.uniform(0.2, 0.8))
            width = (x2 - x1 + 0.2, 0, 0)
            hung: dict[str, Any] = {"cls": UNCLASSIFIED, "shade": 20000, "chance": 0.8}
            house.face("curtain", (x1 - 0.1, behind, z1), width, pane[2], **hung, **own)
    properties = {
        "kind": "opening",
        "type": kind,
        "opening_id": number,
        "width": round(x2 - x1, 3),
        "height": round(z2 - z1, 3),
        "recess": recess,
        "curtain": 0.0,
    }
    corners = np.array([(x, depth, z) for x, z in ring])
    house.features.append((shapely.Polygon(np.round(house.placed(corners), 4)), properties))


def _ring(frame: tuple[float, float, float, float], rise: float) -> list[tuple[float, float]]:
    """Corners of an opening on the wall, with half a circle of radius `rise` at its top."""
    x1, x2, z1, z2 = frame
    ring = [(x1, z1), (x2, z1)]
    if not rise:
        return [*ring, (x2, z2), (x1, z2)]
    middle, spring = (x1 + x2) / 2, z2 - rise
    for k in range(ARCH_SIDES + 1):
        angle = math.pi * k / ARCH_SIDES
        ring.append((middle + rise * math.cos(angle), spring + rise * math.sin(angle)))
    return ring
