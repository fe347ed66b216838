"""Fronts of houses of many kinds, each with its openings, as a scanner on the street sees them.

Houses stand as those of samples.scene: x along the front, y into the house, z up, front at y = 0.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.samples._facade import BAY, House, angular_step, scanned, stations_of
from algorithms.samples._palace import _ring, _shutters, _tree
from toolbox.data import PointCloud
from toolbox.data.crs import LOCAL

STOREYS = 3
GLASS: dict[str, Any] = {"shade": 3000.0}  # sends a small share of the light back
AWRY = np.radians(88.0)  # sector of a scan along the front
SPOTS = 400  # points per square metre of what a pane mirrors

Floats = NDArray[np.float64]
Frame = tuple[float, float, float, float]  # left, right, bottom, top

KINDS = (
    "panes",
    "mirrors",
    "mirrors of all sizes",
    "shutters",
    "arches",
    "balconies",
    "relief",
    "relief noise 2 cm",
    "hidden",
    "noise 2 cm",
    "noise 4 cm",
    "sparse",
    "sparse noise 2 cm",
    "niches",
    "glass",
    "grazing",
    "surrounds",
    "timber",
    "row",
    "scaffold",
    "nets",
    "ribbons",
    "loggias",
)


class HouseFront(NamedTuple):
    """A front of a kind.

    Attributes
    ----------
    xyz : array of shape (n, 3)
    intensity : array of shape (n,)
    openings : corners of each, arrays of shape (m, 3)
    """

    xyz: Floats
    intensity: NDArray[np.uint16]
    openings: list[Floats]

    def cloud(self) -> PointCloud:
        """The points alone."""
        return PointCloud(self.xyz, {"intensity": self.intensity}, crs=LOCAL)


class _Style(NamedTuple):
    """What all openings of a front share: heights in metres, and what fills them."""

    storey: float
    width: float
    sill: float
    head: float
    recess: float
    kind: str


def house_front(kind: str, seed: int) -> HouseFront:
    """A front of one of the `KINDS`; all sizes are drawn by the seed."""
    if kind == "row":
        return _row(seed)
    house, style = _drawn(kind, seed)
    return _seen(house, style)


def _drawn(kind: str, seed: int) -> tuple[House, _Style]:
    """The faces of a front."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    house = House(BAY * int(rng.integers(4, 7)) + float(rng.uniform(0.2, 1.0)), rng)
    style = _Style(
        storey=float(rng.uniform(2.9, 3.6)),
        width=float(rng.uniform(0.9, 1.5)),
        sill=float(rng.uniform(0.8, 1.0)),
        head=float(rng.uniform(2.2, 2.6)),
        recess=float(rng.uniform(0.07, 0.25)),
        kind=kind,
    )
    _ground_and_sides(house, style)
    if kind == "glass":
        _curtain_wall(house, style)
    elif kind == "ribbons":
        _ribbons(house, style)
    elif kind == "loggias":
        _loggias(house, style)
    else:
        _wall(house, style)
    if "relief" in kind or kind in ("shutters", "grazing"):
        _relief(house, style)
    if kind == "hidden":
        _before(house)
    if kind in ("scaffold", "nets"):
        _scaffold(house, style)
    if kind == "surrounds":
        _surrounds(house)
    if kind == "timber":
        _timber(house, style)
    return house, style


def _row(seed: int) -> HouseFront:
    """Three houses in a row, each turned by up to 6° and standing forward or back."""
    rng = np.random.default_rng([seed, KINDS.index("row")])
    parts, shades, openings = [], [], []
    corner = np.zeros(3)
    for place, kind in enumerate(("panes", "shutters", "relief")):
        house, style = _drawn(kind, 10 * seed + place)
        made = _seen(house, style)
        origin = house.placed(np.zeros((1, 3)))
        axes = house.placed(np.eye(3)) - origin
        xyz = (made.xyz - origin) @ axes.T
        past = 15.0 * np.array([place == 0, place == 2])  # the street beyond the ends of the row
        here = (xyz[:, 0] > -past[0]) & (xyz[:, 0] < house.size + past[1]) & (xyz[:, 1] < 1.5)
        turn = np.radians(rng.uniform(-6.0, 6.0))
        turned = np.eye(3)
        turned[:2, :2] = [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        parts.append(xyz[here] @ turned + corner)
        shades.append(made.intensity[here])
        openings += [(ring - origin) @ axes.T @ turned + corner for ring in made.openings]
        corner = corner + [house.size, 0.0, 0.0] @ turned + [0.0, rng.uniform(-0.8, 0.8), 0.0]
    return HouseFront(np.vstack(parts), np.concatenate(shades), openings)


def _seen(house: House, style: _Style) -> HouseFront:
    """The front as it is scanned."""
    noise = float(house.rng.uniform(0.003, 0.008))
    if style.kind.endswith("cm"):
        noise = 0.01 * float(style.kind.split()[-2])
    density = 200.0 if "sparse" in style.kind else 500.0
    stations, sector = stations_of(house.size), np.radians(65.0)
    if style.kind == "grazing":
        stations, sector = np.array([[-4.0, -house.rng.uniform(1.2, 3.0), 1.7]]), AWRY
    step = angular_step(house.size, density, stations, sector)
    xyz, columns = scanned(house, stations, step, noise, sector=sector)
    shade = columns["intensity"]
    if "mirrors" in style.kind:
        far = _mirrored(house, stations[0])
        xyz = np.vstack([xyz, far])
        shade = np.append(shade, np.full(len(far), 2000, shade.dtype))
    holes = [
        shapely.get_coordinates(shape, include_z=True)
        for shape, told in house.features
        if told["kind"] == "opening"
    ]
    return HouseFront(xyz, shade, holes)


def _ground_and_sides(house: House, style: _Style) -> None:
    size, top = house.size, STOREYS * style.storey
    house.face("ground", (-15.0, -25.0, 0.0), (size + 30, 0, 0), (0, 40.0, 0), shade=9000)
    for x in (0.0, size):
        house.face("side wall", (x, 0, -1), (0, 9.0, 0), (0, 0, top + 1), shade=26000)


def _wall(house: House, style: _Style) -> None:
    """The wall with an opening or two in each bay and storey."""
    size, top = house.size, STOREYS * style.storey
    house.face("wall", (0, 0, -1), (size, 0, 0), (0, 0, top + 1), pierced=True)
    bays = int(size // BAY)
    doors = house.rng.choice(bays, 2, replace=False)
    for bay, storey in itertools.product(range(bays), range(STOREYS)):
        middle, floor = (bay + 0.5) * BAY, storey * style.storey
        low, high, half = floor + style.sill, floor + style.head, style.width / 2
        kind = "window"
        if storey == 0:
            half *= 1.2
            if bay in doors:
                low, kind = 0.05, "door"
        elif style.kind == "balconies" and (bay + storey) % 2:
            low = floor + 0.1
            _balcony(house, bay, middle, floor)
        if style.kind == "mirrors of all sizes" and kind == "window":
            half *= float(house.rng.uniform(0.6, 1.3))
            low += float(house.rng.uniform(-0.2, 0.5))
            middle += float(house.rng.uniform(-0.4, 0.4))
        frame = (middle - half, middle + half, low, high)
        arch = style.kind == "arches" and (storey == 0 or (bay + storey) % 2 == 0)
        niche = style.kind == "niches" and kind == "window" and house.rng.random() < 0.4
        _opening(house, bay, frame, style, "niche" if niche else kind, arch)
        if style.kind == "shutters" and storey and (bay + storey) % 2:
            _shutters(house, bay, frame, 0.0, int(house.rng.random() < 0.4))


def _opening(
    house: House, bay: int, frame: Frame, style: _Style, kind: str, arch: bool = False
) -> None:
    """A hole with its reveals and what closes it; a blind niche is none."""
    x1, x2, z1, z2 = frame
    rng, y = house.rng, style.recess
    rise = (x2 - x1) / 2 if arch else 0.0
    house.openings.append((*frame, rise, bay))
    ring = _ring(frame, rise)
    for (xa, za), (xb, zb) in itertools.pairwise([*ring, ring[0]]):
        house.face("reveal", (xa, 0, za), (xb - xa, 0, zb - za), (0, y, 0), bay=bay, shade=28000)
    side, up = (x2 - x1, 0, 0), (0, 0, z2 - z1)
    if kind == "niche":
        house.face("niche", (x1, y, z1), side, up, bay=bay, shade=30000 * rng.uniform(0.9, 1.1))
        return
    luck = rng.random()
    if kind == "door":
        house.face("door", (x1, y, z1), side, up, bay=bay, shade=12000)
    elif "mirrors" in style.kind and luck < 0.7:
        kind = "dark" if luck < 0.35 else "mirror"
    else:
        chance = float(rng.uniform(0.05, 0.3))
        house.face("glass", (x1, y, z1), side, up, bay=bay, chance=chance, **GLASS)
        bar = (x1 + x2) / 2 - 0.03
        house.face("frame", (bar, y - 0.02, z1), (0.06, 0, 0), up, bay=bay, shade=24000)
        if rng.random() < 0.6:
            corner = (x1 - 0.1, y + float(rng.uniform(0.2, 0.8)), z1)
            wide = (x2 - x1 + 0.2, 0, 0)
            house.face("curtain", corner, wide, up, bay=bay, shade=20000, chance=0.8)
    corners = np.array([(x, 0.0, z) for x, z in ring])
    told = {"kind": "opening", "type": kind, "frame": frame}
    house.features.append((shapely.Polygon(house.placed(corners)), told))


def _mirrored(house: House, station: Floats) -> Floats:
    """Points that panes put as far behind the front as what they mirror stands before it."""
    parts = []
    for _, told in house.features:
        if told.get("type") == "mirror":
            x1, x2, z1, z2 = told["frame"]
            uv = house.rng.random((int(SPOTS * (x2 - x1) * (z2 - z1)), 2))
            pane = np.column_stack(
                [x1 + uv[:, 0] * (x2 - x1), 0 * uv[:, 0], z1 + uv[:, 1] * (z2 - z1)]
            )
            ray = pane - station
            ray /= np.linalg.norm(ray, axis=1, keepdims=True)
            away = house.rng.uniform(3.0, 9.0) + house.rng.normal(0, 0.2, (len(pane), 1))
            parts.append(pane + away * ray)
    return house.placed(np.vstack(parts)) if parts else np.empty((0, 3))


def _balcony(house: House, bay: int, middle: float, floor: float) -> None:
    low, high = (middle - 1.3, -1.1, floor - 0.1), (middle + 1.3, 0.0, floor + 0.05)
    house.box("balcony", low, high, bay=bay, shade=24000)
    if house.rng.random() < 0.5:  # a parapet
        low, high = (low[0], -1.1, high[2]), (high[0], -1.05, floor + 0.95)
        house.box("balcony", low, high, bay=bay, shade=20000)
        return
    for x in np.arange(low[0], high[0], 0.12):  # bars
        bar = (float(x), -1.1, high[2])
        house.face("bar", bar, (0.02, 0, 0), (0, 0, 0.9), bay=bay, shade=15000)


def _relief(house: House, style: _Style) -> None:
    """Courses, a plinth and a cornice that stand before the wall, and pilasters."""
    deep = "relief" in style.kind
    relief = float(house.rng.choice([0.1, 0.3, 0.6, 1.0])) if deep else 0.08
    size, top = house.size, STOREYS * style.storey
    house.box("plinth", (0.0, -0.3 * relief, -1.0), (size, 0.0, 0.4), shade=22000)
    for storey in range(1, STOREYS):
        z = storey * style.storey - 0.25
        house.box("course", (0.0, -0.6 * relief, z), (size, 0.0, z + 0.25), shade=29000)
    house.box("cornice", (0.0, -1.3 * relief, top - 0.4), (size, 0.0, top), shade=29000)
    if not deep:
        return
    bays = int(size // BAY)
    for bay in range(bays + 1):
        x = min(bay * BAY, size - 0.3)
        low, high = (x - 0.3, -relief, 0.4), (x + 0.3, 0.0, top - 0.4)
        house.box("pilaster", low, high, bay=min(bay, bays - 1), shade=29000)


def _surrounds(house: House) -> None:
    """Stone of another colour before the wall, around each opening, and sills."""
    rng = house.rng
    deep, wide = float(rng.uniform(0.03, 0.08)), float(rng.uniform(0.12, 0.22))
    stone: dict[str, Any] = {"shade": float(rng.choice([12000, 20000, 42000]))}
    for x1, x2, z1, z2, _, bay in house.openings:
        for low, high in ((x1 - wide, x1), (x2, x2 + wide)):
            house.box("surround", (low, -deep, z1), (high, 0.0, z2), bay=bay, **stone)
        house.box("head", (x1 - wide, -deep, z2), (x2 + wide, 0.0, z2 + wide), bay=bay, **stone)
        if z1 > 0.3:
            low, high = (x1 - wide, -0.15, z1 - 0.1), (x2 + wide, 0.0, z1)
            house.box("sill", low, high, bay=bay, **stone)


def _timber(house: House, style: _Style) -> None:
    """Dark posts and rails before the panels of a half-timbered wall, some beside its openings."""
    deep, wide = float(house.rng.uniform(0.02, 0.04)), 0.16
    dark: dict[str, Any] = {"shade": 12000}
    for storey in range(STOREYS + 1):
        low = storey * style.storey - wide / 2
        house.box("rail", (0.0, -deep, low), (house.size, 0.0, low + wide), **dark)
    for x1, x2, z1, z2, _, bay in house.openings:
        left, right, floor = bay * BAY, (bay + 1) * BAY, z1 // style.storey * style.storey
        for x in (left, x1 - wide, x2):
            low, high = (x, -deep, floor), (x + wide, 0.0, floor + style.storey)
            house.box("post", low, high, bay=bay, **dark)
        for z in (z1 - wide, z2):
            house.box("rail", (left, -deep, z), (right, 0.0, z + wide), bay=bay, **dark)
        for low, high in ((left, x1), (x2, right)):
            middle = (z1 + z2) / 2
            house.box("rail", (low, -deep, middle), (high, 0.0, middle + wide), bay=bay, **dark)


def _before(house: House) -> None:
    """A tree before every third bay, two cars and a cable."""
    rng, bays = house.rng, int(house.size // BAY)
    for bay in range(int(rng.integers(0, 3)), bays, 3):
        _tree(house, bay, (bay + float(rng.uniform(0.2, 0.8))) * BAY)
    for x in rng.choice(int(house.size - 5), 2):
        house.box("van", (x, -4.0, 0.3), (x + 4.4, -2.2, float(rng.uniform(1.4, 1.9))), shade=40000)
    z = float(rng.uniform(4.0, 7.0))
    house.box("cable", (0.0, -0.5, z), (house.size, -0.47, z + 0.03), shade=8000)


def _scaffold(house: House, style: _Style) -> None:
    """Two rows of tubes with boards between them and rails; nets hang before all or half of it."""
    rng, size, top = house.rng, house.size, STOREYS * style.storey
    gap, deep, tube = float(rng.uniform(0.2, 0.35)), float(rng.uniform(0.6, 1.0)), 0.05
    rows, lift = (-gap, -gap - deep), 2.0
    fields = max(2, round(size / float(rng.uniform(2.0, 2.6))))
    posts = np.linspace(0.0, size - tube, fields + 1)
    steel: dict[str, Any] = {"shade": 18000}
    for x, y in itertools.product(posts.tolist(), rows):
        low, high = (x, y - tube, 0.0), (x + tube, y, top + 0.5)
        house.box("tube", low, high, **steel)
    for level in np.arange(lift, top, lift).tolist():
        low, high = (0.0, -gap - deep, level - 0.05), (size, -gap, level)
        house.box("boards", low, high, shade=22000)
        board = (0.0, -gap - deep - 0.03, level)
        house.face("toe board", board, (size, 0, 0), (0, 0, 0.15), shade=22000)
        for up in (0.5, 1.0):
            low = (0.0, -gap - deep - tube, level + up)
            house.box("rail", low, (size, low[1] + tube, low[2] + tube), **steel)
    for field, x in enumerate(posts[:-1:3].tolist()):  # braces
        rise = (posts[1] - posts[0], 0, lift)
        for number in range(int(top // lift)):
            start = x if (number + field) % 2 == 0 else x + rise[0]
            along = rise if (number + field) % 2 == 0 else (-rise[0], 0, lift)
            corner = (start, -gap - deep - tube, number * lift)
            house.face("brace", corner, along, (0, 0, tube), **steel)
    if style.kind == "nets":
        chance, left = float(rng.uniform(0.3, 0.95)), float(rng.choice([0.0, size / 2]))
        bays = int(size // BAY)
        ends = [*(bay * BAY for bay in range(bays)), size]
        for bay, (x1, x2) in enumerate(itertools.pairwise(ends)):  # a face of all bays is opaque
            for level in np.arange(0.0 if bay % 2 else lift, top, lift).tolist():
                if x1 >= left - BAY / 2:
                    corner = (x1, -gap - deep - 0.1 - 0.05 * float(rng.random()), level)
                    net = (x2 - x1, 0, 0), (0, 0, lift)
                    house.face("net", corner, *net, bay=bay, shade=9000, chance=chance)


def _ribbons(house: House, style: _Style) -> None:
    """A band of glass in each storey, over the whole front or most of it; a door below."""
    rng, size, top = house.rng, house.size, STOREYS * style.storey
    house.face("wall", (0, 0, -1), (size, 0, 0), (0, 0, top + 1), pierced=True)
    whole, frames = rng.random() < 0.4, rng.random() < 0.5
    ends = (0.0, size) if whole else (float(rng.uniform(0.5, 1.5)), size - rng.uniform(0.5, 3.0))
    ends = (float(ends[0]), float(ends[1]))
    chance = float(rng.uniform(0.05, 0.5))
    for storey in range(STOREYS):
        z1, z2 = storey * style.storey + style.sill, storey * style.storey + style.head
        left = ends[0] + (3.0 if storey == 0 else 0.0)
        _band(house, style, (left, ends[1], z1, z2), chance, frames)
    middle = ends[0] + 1.5
    frame = (middle - 0.6, middle + 0.6, 0.05, style.head)
    _opening(house, int(middle // BAY), frame, style, "door")
    house.openings.sort(key=lambda hole: hole[-1])  # a scan looks for them bay by bay


def _band(house: House, style: _Style, frame: Frame, chance: float, frames: bool) -> None:
    """One band of glass with its reveals, blinds behind some of it, and bars if it has frames."""
    x1, x2, z1, z2 = frame
    rng, y = house.rng, style.recess
    up = (0, 0, z2 - z1)
    bays = range(int(x1 // BAY), math.ceil(x2 / BAY))
    for bay in bays:
        a, b = max(x1, bay * BAY), min(x2, (bay + 1) * BAY)
        house.openings.append((a, b, z1, z2, 0.0, bay))
        side = (b - a, 0, 0)
        house.face("glass", (a, y, z1), side, up, bay=bay, chance=chance, **GLASS)
        for z in (z1, z2):
            house.face("reveal", (a, 0, z), side, (0, y, 0), bay=bay, shade=28000)
        for x in np.arange(a, b, 1.2) if frames else ():
            bar = (float(x), y - 0.03, z1)
            house.face("frame", bar, (0.06, 0, 0), up, bay=bay, shade=24000)
        if rng.random() < 0.4:
            blind = (a, y + 0.15, z1 + float(rng.uniform(0.0, 0.8)) * (z2 - z1))
            house.face("blind", blind, side, (0, 0, z2 - blind[2]), bay=bay, shade=22000)
        elif rng.random() < 0.5:
            room = (a, y + float(rng.uniform(0.5, 1.2)), z1)
            house.face("cupboard", room, side, up, bay=bay, shade=16000)
    for x in (x1, x2):
        house.face("reveal", (x, 0, z1), (0, y, 0), up, shade=28000)
    corners = np.array([(x1, 0, z1), (x2, 0, z1), (x2, 0, z2), (x1, 0, z2)])
    told = {"kind": "opening", "type": "ribbon", "frame": frame}
    house.features.append((shapely.Polygon(house.placed(corners)), told))


def _loggias(house: House, style: _Style) -> None:
    """Recesses a storey high in every second bay, with a parapet or bars and a window at the back.

    The open front of a loggia is an opening; the window at its back is seen through it.
    """
    rng, size, top = house.rng, house.size, STOREYS * style.storey
    house.face("wall", (0, 0, -1), (size, 0, 0), (0, 0, top + 1), pierced=True)
    deep, solid = float(rng.uniform(0.9, 1.5)), rng.random() < 0.5
    width, first = float(rng.uniform(2.2, 3.2)), int(rng.integers(0, 2))
    for bay, storey in itertools.product(range(int(size // BAY)), range(STOREYS)):
        middle, floor = (bay + 0.5) * BAY, storey * style.storey
        if storey == 0 or bay % 2 != first:
            half = style.width / 2
            low, high = floor + style.sill, floor + style.head
            _opening(house, bay, (middle - half, middle + half, low, high), style, "window")
            continue
        parapet = 1.0 if solid else 0.0
        frame = (
            middle - width / 2,
            middle + width / 2,
            floor + parapet,
            floor + style.storey - 0.3,
        )
        _loggia(house, bay, frame, floor, deep)
        if not solid:
            for x in np.arange(frame[0], frame[1], 0.12):
                bar = (float(x), 0.03, floor)
                house.face("bar", bar, (0.02, 0, 0), (0, 0, 1.0), bay=bay, shade=15000)


def _loggia(house: House, bay: int, frame: Frame, floor: float, deep: float) -> None:
    x1, x2, z1, z2 = frame
    rng = house.rng
    house.openings.append((*frame, 0.0, bay))
    across, up, inwards = (x2 - x1, 0, 0), (0, 0, z2 - floor), (0, deep, 0)
    for x in (x1, x2):
        house.face("loggia", (x, 0, floor), inwards, up, bay=bay, shade=28000)
    for z in (floor, z2):
        house.face("loggia", (x1, 0, z), across, inwards, bay=bay, shade=25000)
    glass = float(rng.uniform(0.4, 0.7)) * (x2 - x1)
    left = x1 + float(rng.uniform(0.1, 0.9)) * (x2 - x1 - glass)
    chance = float(rng.uniform(0.1, 0.4))
    pane = (left, deep + 0.1, floor), (glass, 0, 0), (0, 0, 2.3)
    house.face("glass", *pane, bay=bay, chance=chance, **GLASS)
    for a, b in ((x1, left), (left + glass, x2)):
        house.face("back", (a, deep, floor), (b - a, 0, 0), up, bay=bay, shade=30000)
    over = (left, deep, floor + 2.3)
    house.face("back", over, (glass, 0, 0), (0, 0, z2 - floor - 2.3), bay=bay, shade=30000)
    corners = np.array([(x1, 0, z1), (x2, 0, z1), (x2, 0, z2), (x1, 0, z2)])
    told = {"kind": "opening", "type": "loggia", "frame": frame}
    house.features.append((shapely.Polygon(house.placed(corners)), told))


def _curtain_wall(house: House, style: _Style) -> None:
    """Frames before glass, and in half of the fronts opaque bands below it."""
    rng, size = house.rng, house.size
    deep, wide = float(rng.uniform(0.04, 0.12)), float(rng.uniform(0.05, 0.1))
    panels = int(size // rng.uniform(1.2, 1.8))
    chance = float(rng.uniform(0.0, 0.15))
    spandrel = float(rng.choice([0.0, 0.8]))
    pitch, top = (size - wide) / panels, STOREYS * style.storey
    solid: dict[str, Any] = {"shade": 27000}
    for column in range(panels + 1):
        x = column * pitch
        house.box("mullion", (x, -deep, 0.0), (x + wide, 0.0, top), **solid)
    for storey in range(STOREYS + 1):
        z = min(storey * style.storey, top - wide)
        house.box("transom", (0.0, -deep, z), (size, 0.0, z + wide), **solid)
        if storey < STOREYS and spandrel:
            corner = (0.0, 0.0, z)
            house.face("spandrel", corner, (size, 0, 0), (0, 0, spandrel), shade=20000)
            house.box(
                "transom", (0.0, -deep, z + spandrel), (size, 0.0, z + spandrel + wide), **solid
            )
    if chance:
        bays = int(size // BAY)
        ends = [*(bay * BAY for bay in range(bays)), size]
        for bay, (x1, x2) in enumerate(itertools.pairwise(ends)):  # a face of all bays is opaque
            glass = (x1, 0.0, 0.0), (x2 - x1, 0, 0), (0, 0, top)
            house.face("glass", *glass, bay=bay, **GLASS, chance=chance)
    for column, storey in itertools.product(range(panels), range(STOREYS)):
        x1, x2 = column * pitch + wide, (column + 1) * pitch
        z1 = storey * style.storey + wide + spandrel
        z2 = min((storey + 1) * style.storey, top - wide)
        corners = np.array([(x1, 0, z1), (x2, 0, z1), (x2, 0, z2), (x1, 0, z2)])
        told = {"kind": "opening", "type": "pane"}
        house.features.append((shapely.Polygon(house.placed(corners)), told))
