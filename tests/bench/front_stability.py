"""Two labelled fronts turned, moved, mirrored, thinned, scattered, cut and scaled: what holds."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from tests.bench.facades import REAL, Score, compared
from tests.bench.measuring import DATA, say
from toolbox.context import listening
from toolbox.data import PointCloud
from toolbox.data.crs import LOCAL, parse_crs

FOOT = 0.3048  # metres
SURE = 0.7  # certainty of an invented opening that is told as sure
WHOLE, CUT = 0.95, 0.05  # shares of a true opening that is left: judged above, none below
LOW = 3.6  # metres above the foot: over the doors of both fronts, below their windows
STREET = 8.0  # metres before the front
FAR = (412345.6, 5412345.6, 250.0)  # metres: corner of a front in a zone of UTM

Floats = NDArray[np.float64]
Rng = np.random.Generator


class Scan(NamedTuple):
    """A labelled front in coordinates of its own: along it, behind its wall, and up; metres.

    Attributes
    ----------
    xyz : array of shape (n, 3)
    intensity : array of shape (n,)
    true : points of each door and window, arrays of shape (m, 3)
    left : share of each that is in the cloud
    second : how many of the last ones are of a front in another plane
    crs : of the points
    metre : in the unit of the points
    """

    xyz: Floats
    intensity: NDArray[np.uint16] | None
    true: list[Floats]
    left: list[float]
    crs: Any = LOCAL
    metre: float = 1.0
    second: int = 0

    def only(self, keep: NDArray[np.bool_]) -> Scan:
        """Some of its points, with all labels."""
        shade = None if self.intensity is None else self.intensity[keep]
        return self._replace(xyz=self.xyz[keep], intensity=shade)

    def moved(self, change: Callable[[Floats], Floats]) -> Scan:
        """All coordinates changed, those of the labels too."""
        return self._replace(xyz=change(self.xyz), true=[change(one) for one in self.true])

    def cloud(self) -> PointCloud:
        """Its points."""
        columns = {} if self.intensity is None else {"intensity": self.intensity}
        return PointCloud(self.xyz, columns, crs=self.crs)


def read(number: int) -> Scan:
    """A real front, its foot at 0, the inside of the house where the panes of its openings are."""
    table = np.loadtxt(DATA / REAL.format(number), skiprows=1)
    kind, number_of = table[:, 4], table[:, 5]
    wall = table[kind == 1, :3]
    middle = wall.mean(axis=0)
    along, across = np.linalg.svd(wall[:, :2] - middle[:2], full_matrices=False)[2]
    flat = table[:, :2] - middle[:2]
    xyz = np.column_stack([flat @ along, flat @ across, table[:, 2] - table[:, 2].min()])
    xyz[:, 0] -= xyz[:, 0].min()
    behind = np.quantile(xyz[kind > 1, 1], 0.9) > -np.quantile(xyz[kind > 1, 1], 0.1)
    xyz = xyz if behind else xyz * [1, -1, 1]
    true = [
        xyz[(kind == k) & (number_of == n)] for k in (2, 3) for n in np.unique(number_of[kind == k])
    ]
    return Scan(xyz, table[:, 3].astype(np.uint16), true, [1.0] * len(true))


def turned(scan: Scan, degrees: float) -> Scan:
    """About the vertical."""
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
    return scan.moved(lambda xyz: xyz @ turn)


def thinned(scan: Scan, share: float, rng: Rng) -> Scan:
    return scan.only(rng.random(len(scan.xyz)) < share)


def by_voxel(scan: Scan, side: float, rng: Rng) -> Scan:
    """One point, drawn by chance, of each voxel."""
    order = rng.permutation(len(scan.xyz))
    _, first = np.unique(np.floor(scan.xyz[order] / side), axis=0, return_index=True)
    keep = np.zeros(len(order), bool)
    keep[order[first]] = True
    return scan.only(keep)


def scattered(scan: Scan, noise: float, rng: Rng) -> Scan:
    return scan._replace(xyz=scan.xyz + rng.normal(0.0, noise, scan.xyz.shape))


def cropped(scan: Scan, keep: Callable[[Floats], NDArray[np.bool_]]) -> Scan:
    """What is left of it; openings that are cut are judged by nobody."""
    left = [float(keep(one).mean()) for one in scan.true]
    return scan.only(keep(scan.xyz))._replace(left=left)


def with_shadows(scan: Scan, rng: Rng) -> Scan:
    """Twelve round holes of 0.3 to 1 m."""
    flat, high = scan.xyz[:, [0, 2]], scan.xyz[:, [0, 2]].max(axis=0)
    keep = np.ones(len(flat), bool)
    for _ in range(12):
        place, size = rng.random(2) * high, rng.uniform(0.3, 1.0)
        keep &= np.hypot(*(flat - place).T) > size / 2
    return scan.only(keep)


def behind_post(scan: Scan, rng: Rng) -> Scan:
    """Without a strip of 0.5 m, over the whole height."""
    place = rng.uniform(1.0, scan.xyz[:, 0].max() - 1.0)
    return scan.only(np.abs(scan.xyz[:, 0] - place) > 0.25)


def with_street(scan: Scan, rng: Rng) -> Scan:
    """A pavement, a car, a hedge and a lamp post before it, and a neighbour that stands back."""
    size = float(scan.xyz[:, 0].max())
    street = rng.random((int(100 * STREET * (size + 12)), 3)) * [size + 12, -STREET, 0]
    faces = [street - [6, 0, 0]]
    car = rng.random((3000, 3)) * [4.0, 0.0, 1.4] + [0.3 * size, -3.0, 0.2]
    hedge = rng.random((4000, 3)) * [3.0, 0.6, 1.0] + [0.7 * size, -1.6, 0.0]
    angle = rng.uniform(np.pi, 2 * np.pi, 2000)
    post = np.column_stack([0.08 * np.cos(angle), 0.08 * np.sin(angle), rng.random(2000) * 6])
    next_house = rng.random((9000, 3)) * [6.0, 0.0, 9.0] + [-6.2, 1.8, 0.0]
    faces += [car, hedge, np.add(post, [0.5 * size, -1.2, 0.0]), next_house]
    more = np.vstack(faces)
    more += rng.normal(0.0, 0.005, more.shape)
    return with_more(scan, more)


def beside(scan: Scan, other: Scan) -> Scan:
    """Two fronts in one cloud."""
    shade = np.concatenate([scan.intensity, other.intensity])  # type: ignore[list-item]
    true, left = [*scan.true, *other.true], [*scan.left, *other.left]
    xyz = np.vstack([scan.xyz, other.xyz])
    return scan._replace(xyz=xyz, intensity=shade, true=true, left=left)


def with_more(scan: Scan, xyz: Floats) -> Scan:
    """More points, of no opening."""
    return beside(scan, Scan(xyz, np.full(len(xyz), 20000, np.uint16), [], []))


def at_corner(scan: Scan, other: Scan, degrees: float) -> Scan:
    """Another front at the right end of one, the angle of the house between them."""
    wide = float(scan.xyz[:, 0].max())
    there = turned(other, degrees - 180).moved(lambda xyz: np.add(xyz, (wide, 0, 0)))
    return beside(scan, there)._replace(second=len(other.true))


def in_row(scan: Scan, other: Scan, step: float) -> Scan:
    """Another front to the right of one, farther back by a step."""
    wide = float(scan.xyz[:, 0].max()) + 0.2
    return beside(scan, other.moved(lambda xyz: np.add(xyz, (wide, step, 0))))


def across_the_street(scan: Scan, other: Scan) -> Scan:
    """Another front on the other side of a street, which looks at one."""
    there = turned(other, 180).moved(lambda xyz: np.add(xyz, (8, -2 * STREET, 0)))
    return beside(scan, there)._replace(second=len(other.true))


def with_back_wall(scan: Scan, rng: Rng) -> Scan:
    """A wall of the house 8 m behind its front, without openings."""
    wide, high = scan.xyz[:, [0, 2]].max(axis=0)
    wall = rng.random((int(400 * wide * high), 3)) * [wide, 0, high] + [0, 8, 0]
    wall += rng.normal(0.0, 0.005, wall.shape)
    return with_more(scan, wall)


def with_far_points(scan: Scan, rng: Rng) -> Scan:
    """One point in a hundred anywhere in the box and 3 m around it."""
    low, high = scan.xyz.min(axis=0) - 3, scan.xyz.max(axis=0) + 3
    return with_more(scan, rng.uniform(low, high, (len(scan.xyz) // 100, 3)))


def leaning(scan: Scan, degrees: float) -> Scan:
    """Its top farther back than its foot."""
    slope = math.tan(math.radians(degrees))
    return scan.moved(lambda xyz: xyz + xyz[:, 2:] * [0, slope, 0])


def of_two_scans(scan: Scan, apart: float, rng: Rng) -> Scan:
    """Half of its points farther back than the others, as of scans that do not fit."""
    return scan._replace(xyz=scan.xyz + np.outer(rng.random(len(scan.xyz)) < 0.5, (0, apart, 0)))


def sparser_above(scan: Scan, rng: Rng) -> Scan:
    """Points fewer with the square of the distance to a scanner 6 m before its foot."""
    away = 36 + scan.xyz[:, 2] ** 2
    return scan.only(rng.random(len(away)) < 36 / away)


def in_feet(scan: Scan) -> Scan:
    made = scan.moved(lambda xyz: xyz / FOOT)
    return made._replace(crs=parse_crs("local:ft"), metre=1 / FOOT)


def in_another_order(scan: Scan, rng: Rng) -> Scan:
    order = rng.permutation(len(scan.xyz))
    return scan._replace(xyz=scan.xyz[order], intensity=scan.intensity[order])  # type: ignore[index]


def shuffled_intensity(scan: Scan, rng: Rng) -> Scan:
    return scan._replace(intensity=rng.permutation(scan.intensity))


def variants(scan: Scan, other: Scan) -> Iterator[tuple[str, Callable[[Rng], Scan]]]:
    """Name and maker of each change; `other` is the other labelled front."""
    wide, high = scan.xyz[:, [0, 2]].max(axis=0)
    yield "as measured", lambda rng: scan
    for degrees in (17, 41, 90):
        yield f"turned by {degrees}", lambda rng, d=degrees: turned(scan, d)  # type: ignore[misc]
    yield "far away", lambda rng: scan.moved(lambda xyz: np.add(xyz, FAR))
    yield "mirrored", lambda rng: scan.moved(lambda xyz: xyz * [-1, 1, 1])
    yield "another order", lambda rng: in_another_order(scan, rng)
    yield "in feet", lambda rng: in_feet(scan)
    for share in (2, 4, 8):
        yield f"1/{share} of points", lambda rng, s=share: thinned(scan, 1 / s, rng)  # type: ignore[misc]
    for side in (5, 10, 15):
        yield f"voxels of {side} cm", lambda rng, s=side: by_voxel(scan, s / 100, rng)  # type: ignore[misc]
    for noise in (1, 2, 3, 4):
        yield f"noise of {noise} cm", lambda rng, n=noise: scattered(scan, n / 100, rng)  # type: ignore[misc]
    for name, keep in (
        ("left half", lambda xyz: xyz[:, 0] < wide / 2),
        ("right half", lambda xyz: xyz[:, 0] > wide / 2),
        ("lower half", lambda xyz: xyz[:, 2] < high / 2),
        ("upper half", lambda xyz: xyz[:, 2] > high / 2),
        ("above the doors", lambda xyz: xyz[:, 2] > LOW),
        ("the doors alone", lambda xyz: xyz[:, 2] < LOW),
    ):
        yield name, lambda rng, k=keep: cropped(scan, k)  # type: ignore[misc]
    yield (
        "the doors, turned by 41",
        lambda rng: turned(cropped(scan, lambda xyz: xyz[:, 2] < LOW), 41),
    )
    yield "with a street", lambda rng: with_street(scan, rng)
    for factor in (0.9, 1.1):
        yield f"{factor} times as large", lambda rng, f=factor: scan.moved(lambda xyz: xyz * f)  # type: ignore[misc]
    yield "shadows", lambda rng: with_shadows(scan, rng)
    yield "behind a post", lambda rng: behind_post(scan, rng)
    yield "no intensity", lambda rng: scan._replace(intensity=None)
    yield "intensity by chance", lambda rng: shuffled_intensity(scan, rng)
    yield (
        "1/2, 2 cm, turned by 41",
        lambda rng: turned(scattered(thinned(scan, 0.5, rng), 0.02, rng), 41),
    )
    for degrees in (60, 90, 120):
        yield f"corner of {degrees}", lambda rng, d=degrees: at_corner(scan, other, d)  # type: ignore[misc]
    for step in (0.5, 2.0):
        yield f"row, step {step} m", lambda rng, s=step: in_row(scan, other, s)  # type: ignore[misc]
    yield "both sides of a street", lambda rng: across_the_street(scan, other)
    yield "back wall", lambda rng: with_back_wall(scan, rng)
    yield "far points", lambda rng: with_far_points(scan, rng)
    yield "leaning by 2", lambda rng: leaning(scan, 2)
    for apart in (1, 3):
        yield f"two scans {apart} cm off", lambda rng, a=apart: of_two_scans(scan, a / 100, rng)  # type: ignore[misc]
    yield "sparser above", lambda rng: sparser_above(scan, rng)
    yield "all points twice", lambda rng: beside(scan, scan._replace(true=[], left=[]))
    yield "rounded to 1 cm", lambda rng: scan._replace(xyz=np.round(scan.xyz, 2))
    for name, at in (("left", 0.3), ("right", 0.7)):
        yield (
            f"without the {name}",
            lambda rng, n=name, a=at: cropped(  # type: ignore[misc]
                scan, lambda xyz: (xyz[:, 0] > a * wide) == (n == "left")
            ),
        )


class Judged(NamedTuple):
    """What came out: the score, invented openings that are told as sure, planes, fronts, words."""

    score: Score
    sure: int
    planes: int
    fronts: int
    told: list[str]


def judged(scan: Scan, **settings: Any) -> Judged:
    """Openings of a scan beside its labels; those at the edge of the data do not count."""
    from algorithms.planes.extract import PlanesExtract
    from algorithms.planes.openings import PlanesOpenings

    with listening(aloud=False) as told:
        planes = PlanesExtract(points=scan.cloud()).run()
        if not planes.count:
            return Judged(Score(0, sum(s >= WHOLE for s in scan.left), 0, 0.0), 0, 0, 0, told)
        out = PlanesOpenings(points=planes.segmented, **settings).run()
    found = [
        shapely.get_coordinates(s, include_z=True) / scan.metre for s in out.openings.frame.geometry
    ]
    first = len(scan.true) - scan.second
    scores, wrong = [], []
    for part in (slice(0, first), slice(first, None))[: 1 + bool(scan.second)]:
        labels = [
            (t / scan.metre, s) for t, s in zip(scan.true[part], scan.left[part], strict=True)
        ]
        whole = [one for one, share in labels if share >= WHOLE]
        made, own = compared(whole, found, [one for one, s in labels if CUT < s < WHOLE])
        scores.append(made)
        wrong += own
    certain = out.openings.frame["certainty"].to_numpy()[wrong] >= SURE
    right, true, seen = (sum(column) for column in list(zip(*scores, strict=True))[:3])
    made = Score(right, true, seen, float(np.mean([one.iou for one in scores])))
    return Judged(made, int(certain.sum()), planes.count, out.fronts, told)


TOLD = {
    "noise": "scatter about its wall",
    "sparse": "m apart:",
    "none": "has no openings",
    "unseen": "has neither points",
    "side": "from which side",
    "strip": "strips of front",
    "wide": "too large for openings",
    "two walls": "has two walls",
    "glass": "is a curtain wall",
    "screen": "something stands",
    "blind": "with wall at their back",
    "small": "no upright plane is",
    "no plane": "no plane was found",
}


def front_stability(*options: str) -> None:
    """Openings of the labelled fronts, changed in ways that a method has to bear.

    The method was chosen on front 1 with draws 0 and 1; `--fronts`, `--draws` and `--only` tell
    which are made.
    """
    reader = argparse.ArgumentParser(prog="front_stability", allow_abbrev=False)
    reader.add_argument("--fronts", type=int, nargs="+", default=(1, 2))
    reader.add_argument("--draws", type=int, nargs="+", default=(0,))
    reader.add_argument("--only", default="")
    given = reader.parse_args(options)
    for number in given.fronts:
        scan = read(number)
        every = []
        for name, make in variants(scan, read(3 - number)):
            if given.only not in name:
                continue
            for draw in given.draws:
                made = judged(make(np.random.default_rng([draw, number])))
                every.append(made)
                words = [key for key, text in TOLD.items() if any(text in t for t in made.told)]
                say(
                    f"front_stability  front {number}  {name:24} draw {draw}  F1 "
                    f"{made.score.f1:.2f}  {made.score.right} of {made.score.true}, "
                    f"{made.score.found - made.score.right} invented ({made.sure} sure), IoU "
                    f"{made.score.iou:.2f}  {made.fronts} fronts, {made.planes} planes  told: "
                    f"{', '.join(words)}"
                )
        mean = float(np.mean([one.score.f1 for one in every]))
        sure = sum(one.sure for one in every)
        say(f"front_stability  front {number}  mean of {len(every)} {mean:.3f}, {sure} sure wrong")
