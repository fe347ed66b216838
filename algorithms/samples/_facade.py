"""A two-storey house front as a terrestrial scanner sees it, from stations along the street.

The house stands in its own frame: x along the front, y into the house, z up, front at y = 0.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from algorithms.samples._palace import palace
from algorithms.samples._survey import (
    BUILDING,
    EAST,
    GROUND,
    NORTH,
    UNCLASSIFIED,
    Features,
    Floats,
    Records,
    SceneData,
    blank_terrain,
)
from algorithms.shared.kernels.compiling import kernel
from toolbox.context import QUIET, Context

BAY, DEPTH, EAVE, PITCH = 3.6, 9.0, 6.0, 0.8  # house, m; pitch is rise over run
TURN, BASE = np.radians(17.0), 150.0  # of the front against east; elevation of the ground
FALL = (0.01, 0.02)  # of the ground along the front and into the house
NOISE = 0.004  # standard deviation along the beam, m
STAND, EYE = 12.0, 1.7  # of the scanner, in front of the house and above the ground, m
SECTOR = np.radians(65.0)  # of a scan, to both sides
RISE = (np.radians(-20.0), np.radians(42.0))  # lowest and highest elevation of a scan
JUTTING, BUSH, LEAVES = 5, 6, 120  # of eight bays; leaves of a bush
REACH = (-3.5, 1.6)  # y between which trees, balconies, reveals and curtains lie
RAYS_PER_BLOCK = 400_000

FACE = np.dtype(
    [
        *((name, "f8", 3) for name in ("o", "e", "f")),  # corner, unit vectors along the sides
        *((name, "f8") for name in ("a", "b", "peak", "chance")),
        ("plane_id", "u4"),
        ("opening_id", "u2"),
        ("cls", "u1"),
        ("shade", "f4"),
        ("pierced", "u1"),
    ]
)
OPENING = np.dtype([(name, "f8") for name in ("x1", "x2", "z1", "z2", "rise")] + [("bay", "i8")])


@dataclass
class House:
    """Faces of a house front: those that all rays are tested with, and those of single bays."""

    size: float
    rng: np.random.Generator
    faces: list[tuple[Any, ...]] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    bays: list[int] = field(default_factory=list)  # -1: every ray
    openings: list[tuple[float, ...]] = field(default_factory=list)
    features: Features = field(default_factory=list)

    def face(
        self,
        kind: str,
        o: Any,
        e: Any,
        f: Any,
        *,
        cls: int = BUILDING,
        shade: float = 30000,
        bay: int = -1,
        opening: int = 0,
        chance: float = 1.0,
        peak: float = 0.0,
        pierced: bool = False,
    ) -> None:
        """Add a rectangle from corner o along the vectors e and f; with `peak` it is a gable.

        The openings are holes in one that is `pierced`.
        """
        a, b = float(np.linalg.norm(e)), float(np.linalg.norm(f))
        plane = len(self.faces) + 1
        e, f = np.divide(e, a), np.divide(f, b)
        self.faces.append((o, e, f, a, b, peak, chance, plane, opening, cls, shade, pierced))
        self.kinds.append(kind)
        self.bays.append(bay)

    def placed(self, xyz: Floats) -> Floats:
        """Projected coordinates, from coordinates of the house."""
        return _placed(xyz)

    def box(self, kind: str, low: Any, high: Any, **options: Any) -> None:
        """Add the five faces of a box that are visible from the street, without its back."""
        (x1, y1, z1), (x2, y2, z2) = low, high
        w, d, h = (x2 - x1, 0, 0), (0, y2 - y1, 0), (0, 0, z2 - z1)
        self.face(kind, (x1, y1, z1), w, h, **options)
        self.face(kind, (x1, y1, z1), d, h, **options)
        self.face(kind, (x2, y1, z1), d, h, **options)
        self.face(kind, (x1, y1, z2), w, d, **options)
        self.face(kind, (x1, y1, z1), w, d, **options)


def facade(
    *,
    size: float,
    density: float,
    seed: int,
    noise: float = NOISE,
    relief: float = 0.0,
    ctx: Context = QUIET,
) -> SceneData:
    """A front of `size` metres, `density` points per square metre of visible wall; see `scene`."""
    rng = np.random.default_rng(seed)
    if relief:
        house = House(size, rng)
        palace(house, BAY, relief, seed, _ground)
    else:
        house = _house(size, rng)
    stations = stations_of(size)
    step = angular_step(size, density, stations)
    xyz, attributes = scanned(house, stations, step, noise, ctx)
    faces = np.array(house.faces, FACE)
    features = [*_face_features(house, faces), *house.features, *_station_features(stations)]
    return SceneData(xyz, attributes, _ground_raster(size), features)


def scanned(
    house: House,
    stations: Floats,
    step: float,
    noise: float,
    ctx: Context = QUIET,
    sector: float = SECTOR,
) -> tuple[Floats, dict[str, NDArray[Any]]]:
    """Points of a house in projected coordinates, and their attributes.

    Parameters
    ----------
    stations : array of shape (n, 3), places of the scanner, in coordinates of the house
    step : angle between rays, radians
    noise : standard deviation along the beam, metres
    sector : of a scan, to both sides of square to the front, radians
    """
    rng, faces = house.rng, np.array(house.faces, FACE)
    everywhere, start, items = _by_bay(np.array(house.bays), int(np.ceil(house.size / BAY)))
    openings = np.array(house.openings, OPENING)
    parts = []
    for number, station in enumerate(stations, start=1):
        for directions, time in _sweep(step, rng, sector):
            ctx.progress((number - 1) / len(stations))
            distance, face = _first_face(
                station,
                directions,
                rng.random(len(directions)),
                faces,
                everywhere,
                start,
                items,
                openings,
                np.searchsorted(openings["bay"], np.arange(len(start))),
            )
            met = face >= 0
            noisy = distance[met] + rng.normal(0, noise, met.sum())
            xyz = station + noisy[:, None] * directions[met]
            columns = _columns(faces[face[met]], directions[met], distance[met], rng)
            columns["gps_time"] = 3.0e8 + 600.0 * number + time[met]
            columns["point_source_id"] = np.full(len(xyz), number, "u2")
            parts.append((np.round(_placed(xyz), 3), columns))
    xyz = np.concatenate([xyz for xyz, _ in parts])
    names = tuple(parts[0][1])
    ctx.progress(1.0)
    return xyz, {name: np.concatenate([c.pop(name) for _, c in parts]) for name in names}


# --- the house -----------------------------------------------------------------------------


def _house(size: float, rng: np.random.Generator) -> House:
    """Faces of ground, walls and roof, of a van that casts a shadow, and of doors and windows."""
    house = House(size, rng)
    slope = np.hypot(1, PITCH)
    ground = (-15.0, -25.0, _ground(-15.0, -25.0))
    along, inwards = (size + 30, 0, FALL[0] * (size + 30)), (0, 40.0, FALL[1] * 40.0)
    house.face("ground", ground, along, inwards, cls=GROUND, shade=9000)
    house.face("wall", (0, 0, -1), (size, 0, 0), (0, 0, EAVE + 1), pierced=True)
    ridge = EAVE + PITCH * DEPTH / 2
    for x in (0, size):
        up = (0, 0, ridge + 1)
        house.face("side wall", (x, 0, -1), (0, DEPTH, 0), up, peak=PITCH, shade=26000)
    rafter = (DEPTH / 2 + 0.4) * slope
    eave, upwards = (-0.3, -0.4, EAVE - 0.4 * PITCH), np.array([0, 1, PITCH]) / slope
    house.face("roof", eave, (size + 0.6, 0, 0), upwards * rafter, shade=15000)
    van = 0.45 * size
    house.box(
        "van",
        (van, -5.0, _ground(van, -5) + 0.3),
        (van + 4.6, -3.1, _ground(van, -5) + 2.0),
        cls=UNCLASSIFIED,
        shade=40000,
    )
    for bay in range(int(size // BAY)):
        _bay(house, bay)
    return house


def _bay(house: House, bay: int) -> None:
    """Below a window, or a door in every fourth bay; above a window, or a balcony with a door.

    The sixth of eight bays juts out below instead, and a bush stands before the seventh.
    """
    middle, rng = (bay + 0.5) * BAY, house.rng
    if bay % 8 == JUTTING:
        _jutting(house, bay, middle)
    elif bay % 4 == 1:
        _opening(house, bay, (middle - 0.55, middle + 0.55, 0.05, 2.15), "door")
    else:
        _opening(house, bay, (middle - 0.6, middle + 0.6, 0.9, 2.3), "window")
    if bay % 4 == 2:
        _opening(house, bay, (middle - 0.7, middle + 0.7, 3.05, 5.2), "window")
        low, high = (middle - 1.4, -1.2, 2.85), (middle + 1.4, 0.0, 3.0)
        house.box("balcony", low, high, bay=bay, shade=24000)
        house.box("balcony", (low[0], -1.2, 3.0), (high[0], -1.1, 3.95), bay=bay, shade=20000)
    else:
        width = rng.uniform(0.45, 0.75)
        _opening(house, bay, (middle - width, middle + width, 3.7, 5.1), "window")
    if bay % 8 == BUSH:
        _bush(house, bay, middle + 1.2)


def _jutting(house: House, bay: int, middle: float) -> None:
    """A bay window of three faces, 0.6 m deep and 2.7 m high, with a flat roof between them."""
    places = [(-1.2, 0.0), (-0.7, -0.6), (0.7, -0.6), (1.2, 0.0)]
    for (x1, y1), (x2, y2) in itertools.pairwise(places):
        side = (x2 - x1, y2 - y1, 0)
        house.face("bay", (middle + x1, y1, 0), side, (0, 0, 2.7), bay=bay, shade=27000)
    house.face("bay", (middle - 0.7, -0.6, 2.7), (1.4, 0, 0), (0, 0.6, 0), bay=bay, shade=20000)


def _bush(house: House, bay: int, x: float) -> None:
    """Leaves of 8 cm in a ball, each a face of its own."""
    rng = np.random.default_rng(bay)  # of its own, so that the rest of the house stays the same
    for _ in range(LEAVES):
        place = rng.normal((x, -0.6, 0.6), 0.18)
        e, f = np.linalg.qr(rng.normal(size=(3, 2)))[0].T * 0.08
        house.face("clutter", place, e, f, bay=bay, cls=UNCLASSIFIED, shade=9000)


def _opening(house: House, bay: int, frame: tuple[float, float, float, float], kind: str) -> None:
    """A hole in the wall with four reveals and a pane; behind some panes hangs a curtain."""
    x1, x2, z1, z2 = frame
    recess = round(float(house.rng.uniform(0.1, 0.2)), 3)
    house.openings.append((*frame, 0.0, bay))
    number = len(house.openings)
    own: dict[str, Any] = {"bay": bay, "opening": number}
    w, h, d = (x2 - x1, 0, 0), (0, 0, z2 - z1), (0, recess, 0)
    for corner, e, f in (
        ((x1, 0, z1), d, h),
        ((x2, 0, z1), d, h),
        ((x1, 0, z1), w, d),
        ((x1, 0, z2), w, d),
    ):
        house.face("reveal", corner, e, f, shade=28000, **own)
    if kind == "door":
        house.face("door", (x1, recess, z1), w, h, shade=12000, **own)
        curtain = 0.0
    else:
        glass: dict[str, Any] = {"cls": UNCLASSIFIED, "shade": 3000, "chance": 0.06}
        house.face("glass", (x1, recess, z1), w, h, **glass, **own)
        curtain = float(house.rng.uniform(0.3, 1.0)) if house.rng.random() < 0.6 else 0.0
    if curtain:
        house.face(
            "curtain",
            (x1 - 0.1, curtain, z1),
            (x2 - x1 + 0.2, 0, 0),
            h,
            cls=UNCLASSIFIED,
            shade=20000,
            chance=0.8,
            **own,
        )
    ring = [(x1, 0, z1), (x2, 0, z1), (x2, 0, z2), (x1, 0, z2)]
    properties = {
        "kind": "opening",
        "type": kind,
        "opening_id": number,
        "width": round(x2 - x1, 3),
        "height": round(z2 - z1, 3),
        "recess": recess,
        "curtain": round(curtain, 3),
    }
    house.features.append((shapely.Polygon(np.round(_placed(np.array(ring)), 4)), properties))


def _ground(x: float, y: float) -> float:
    """Height of the ground in the coordinates of the house."""
    return FALL[0] * x + FALL[1] * y


# --- scanning ------------------------------------------------------------------------------


def stations_of(size: float) -> Floats:
    """Scanner positions, shape (n, 3); the last is past the corner, where the side is visible."""
    count = max(1, int(np.ceil(size / 25.0)))
    x = np.append((np.arange(count) + 0.4) * size / count, size + 6.0)
    y = np.full(count + 1, -STAND)
    return np.column_stack([x, y, EYE + FALL[0] * x + FALL[1] * y])


def angular_step(size: float, density: float, stations: Floats, sector: float = SECTOR) -> float:
    """Step between rays that gives the wall its mean density, from all stations together."""
    x, z = np.meshgrid((np.arange(60) + 0.5) * size / 60, np.linspace(0.3, EAVE - 0.3, 12))
    rays = np.zeros(x.shape)
    for sx, sy, sz in stations:
        flat, up = np.hypot(x - sx, sy), z - sz
        seen = np.abs(np.arctan2(x - sx, -sy)) < sector
        # Rays per steradian grow towards the poles: 1 / cos(elevation).
        rays += seen * -sy / (flat**2 + up**2) / flat
    return float(np.sqrt(rays.mean() / density))


def _sweep(step: float, rng: np.random.Generator, sector: float) -> Any:
    """Unit vectors and times of the rays of a scan, column by column, in blocks."""
    azimuths = np.arange(-sector, sector, step)
    elevations = np.arange(RISE[0], RISE[1], step)
    width = max(1, RAYS_PER_BLOCK // len(elevations))
    for first in range(0, len(azimuths), width):
        azimuth = azimuths[first : first + width, None]
        shape = (len(azimuth), len(elevations))
        azimuth = azimuth + rng.normal(0, 0.05 * step, shape)
        elevation = elevations + rng.normal(0, 0.05 * step, shape)
        flat = np.cos(elevation)
        xyz = np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)], axis=-1)
        ray = first * len(elevations) + np.arange(azimuth.size)
        yield xyz.reshape(-1, 3), ray * 1e-6


def _by_bay(
    bays: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Faces for every ray, and those of each bay as starts and items."""
    order = np.argsort(bays, kind="stable")
    own = order[bays[order] >= 0]
    return np.flatnonzero(bays < 0), np.searchsorted(bays[own], np.arange(count + 1)), own


def _columns(
    faces: Records, directions: Floats, distance: Floats, rng: np.random.Generator
) -> dict[str, NDArray[Any]]:
    """Attributes of points from the faces that they lie on."""
    n = len(faces)
    normal = np.cross(faces["e"], faces["f"])
    incidence = np.abs((normal * directions).sum(axis=1))
    # Diffuse light falls with the cosine; near range is damped by the receiver.
    light = faces["shade"] * (0.25 + 0.75 * incidence) * np.clip(STAND / distance, 0.3, 1.3)
    return {
        "classification": faces["cls"].copy(),
        "intensity": (light * rng.lognormal(0, 0.1, n)).clip(1, 65535).astype("u2"),
        "return_number": np.ones(n, "u1"),
        "number_of_returns": np.ones(n, "u1"),
        "plane_id": faces["plane_id"].copy(),
        "opening_id": faces["opening_id"].copy(),
    }


# --- placing -------------------------------------------------------------------------------


def _placed(xyz: Floats) -> Floats:
    """Projected coordinates, from coordinates of the house."""
    c, s = np.cos(TURN), np.sin(TURN)
    x, y = xyz[:, 0], xyz[:, 1]
    return np.column_stack([EAST + x * c - y * s, NORTH + x * s + y * c, BASE + xyz[:, 2]])


def _ground_raster(size: float) -> tuple[NDArray[np.float32], float, float, float]:
    """Raster of the ground over the whole scene."""
    corners = np.array([(x, y, 0) for x in (-15.0, size + 15) for y in (-25.0, 15.0)])
    box = _placed(corners) - (EAST, NORTH, BASE)
    terrain = blank_terrain(*box[:, :2].min(axis=0), *box[:, :2].max(axis=0))
    x, y = terrain.centres()
    c, s = np.cos(TURN), np.sin(TURN)
    z = BASE + FALL[0] * (x * c + y * s) + FALL[1] * (y * c - x * s)
    return z.astype(np.float32), EAST + terrain.west, NORTH + terrain.north, terrain.cell


def _face_features(house: House, faces: Records) -> Features:
    """Each face as a polygon with its plane: normal . xyz = offset, normal towards the street."""
    features: Features = []
    for kind, face in zip(house.kinds, faces, strict=True):
        ring = _placed(_outline(face))
        normal = np.cross(ring[1] - ring[0], ring[-1] - ring[0])
        normal /= np.linalg.norm(normal)
        if normal @ (_placed(np.array([(house.size / 2, -50.0, 50.0)]))[0] - ring[0]) < 0:
            normal = -normal
        properties = {
            "kind": kind,
            "plane_id": int(face["plane_id"]),
            "opening_id": int(face["opening_id"]),
            **{f"normal_{axis}": float(v) for axis, v in zip("xyz", normal, strict=True)},
            "offset": float(normal @ ring[0]),
        }
        inner = _holes(house, face) if face["pierced"] else []
        features.append((shapely.Polygon(ring, inner), properties))
    return features


def _holes(house: House, face: np.void) -> list[Floats]:
    """Corners of the openings in a wall, arches as rectangles."""
    _, y, low = face["o"]
    return [
        _placed(np.array([(x1, y, z1), (x2, y, z1), (x2, y, z2), (x1, y, z2)]))
        for x1, x2, z1, z2, *_ in house.openings
        if low < z1 and z2 < low + face["b"]
    ]


def _outline(face: np.void) -> Floats:
    """Corners of a face in the coordinates of the house."""
    o, e, f, a, b = (face[name] for name in ("o", "e", "f", "a", "b"))
    if not face["peak"]:
        return np.array([o, o + a * e, o + a * e + b * f, o + b * f])
    low = b - face["peak"] * a / 2
    return np.array([o, o + a * e, o + a * e + low * f, o + a / 2 * e + b * f, o + low * f])


def _station_features(stations: Floats) -> Features:
    """Scanner positions: a square decimetre each, so that all shapes are polygons."""
    features: Features = []
    for number, (x, y, z) in enumerate(_placed(stations), start=1):
        corners = ((-0.05, -0.05), (0.05, -0.05), (0.05, 0.05), (-0.05, 0.05))
        square = [(x + i, y + j, z) for i, j in corners]
        properties = {"kind": "scanner", "station": number, "x": x, "y": y, "z": z}
        features.append((shapely.Polygon(square), properties))
    return features


# --- kernels -------------------------------------------------------------------------------


@kernel
def _first_face(station, directions, luck, faces, everywhere, start, items, openings, first):
    """Distance and face of the nearest hit of each ray; face -1 for the sky and dark rooms."""
    n, bays = len(directions), len(start) - 1
    distance = np.full(n, np.inf)
    face = np.full(n, -1, np.int64)
    for i in range(n):
        d = directions[i]
        window = np.inf  # distance at which the ray passes a hole in the wall
        for k in everywhere:
            t = _meet(faces[k], station, d)
            if t < distance[i]:
                x, z = station[0] + t * d[0], station[2] + t * d[2]
                if faces[k].pierced and _open(x, z, openings, first, bays):
                    window = t
                else:
                    distance[i], face[i] = t, k
        if distance[i] > window:
            distance[i], face[i] = np.inf, -1
        if d[1] <= 0:
            continue
        x1 = station[0] + (REACH[0] - station[1]) / d[1] * d[0]
        x2 = station[0] + (REACH[1] - station[1]) / d[1] * d[0]
        low, high = int(np.floor(min(x1, x2) / BAY)), int(np.floor(max(x1, x2) / BAY))
        for bay in range(max(low, 0), min(high, bays - 1) + 1):
            for k in items[start[bay] : start[bay + 1]]:
                if luck[i] <= faces[k].chance:
                    t = _meet(faces[k], station, d)
                    if t < distance[i]:
                        distance[i], face[i] = t, k
    return distance, face


@kernel
def _open(x, z, openings, first, bays):
    """True where the front wall has an opening."""
    bay = int(np.floor(x / BAY))
    if bay < 0 or bay >= bays:
        return False
    for k in range(first[bay], first[bay + 1]):
        hole = openings[k]
        if hole.x1 < x < hole.x2 and hole.z1 < z < hole.z2:
            above, aside = z - hole.z2 + hole.rise, x - (hole.x1 + hole.x2) / 2
            return above <= 0 or above * above + aside * aside < hole.rise * hole.rise
    return False


@kernel
def _meet(face, station, d):
    """Distance along a ray to a face; inf where the ray misses it."""
    e, f = face.e, face.f
    nx, ny, nz = e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]
    facing = nx * d[0] + ny * d[1] + nz * d[2]
    if abs(facing) < 1e-12:
        return np.inf
    wx, wy, wz = face.o[0] - station[0], face.o[1] - station[1], face.o[2] - station[2]
    t = (nx * wx + ny * wy + nz * wz) / facing
    if t <= 0:
        return np.inf
    px, py, pz = t * d[0] - wx, t * d[1] - wy, t * d[2] - wz
    u, v = px * e[0] + py * e[1] + pz * e[2], px * f[0] + py * f[1] + pz * f[2]
    if u < 0 or u > face.a or v < 0 or v > face.b - face.peak * abs(u - face.a / 2):
        return np.inf
    return t
