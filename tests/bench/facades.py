"""Planes of synthetic house fronts against their truth, and beside Open3D."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

from tests.bench.measuring import DATA, alternately, say

FEWEST = 200  # points of a true plane that is judged
SAME_FRONT = 2.0  # metres between openings and the middle of the true ones, of one front
SMALLEST = 0.5  # square metres, of the same


def facades() -> None:
    """Fronts with noise of 2 to 10 mm: walls, normals beside their limit, openings, real fronts."""
    for seed in range(10):
        say(f"facades  {_front(seed)}")
    _openings()
    _beside_open3d()


class Match(NamedTuple):
    """A true plane and the found one with most of its points.

    Attributes
    ----------
    true, found, both : points
    angle : between the normals, degrees
    limit : standard deviation of the normal of least squares through all true points, degrees
    offset : of the middle of the points found from the true plane, metres
    """

    kind: str
    true: int
    found: int
    both: int
    angle: float
    limit: float
    offset: float


def _front(seed: int) -> str:
    """What is told of one front."""
    from pyproj import CRS

    from algorithms.planes.extract import PlanesExtract
    from algorithms.samples.scene import scene
    from toolbox.data import PointCloud

    noise = (0.002, 0.004, 0.006, 0.01)[seed % 4]
    data = scene("facade", size=26.0 + seed, density=900.0, seed=seed, noise=noise)
    start = time.process_time()
    out = PlanesExtract(points=PointCloud(data.xyz, {}, crs=CRS(32635))).run()
    seconds = time.process_time() - start
    matches, invented, split = _matched(data, out)
    wall = max((m for m in matches if m.kind == "wall"), key=lambda m: m.true)
    shares = (wall.both / wall.found, wall.both / wall.true)
    whole = wall.both / (wall.found + wall.true - wall.both)
    found = [m for m in matches if m.both > 0.8 * m.true]
    worst = max(found, key=lambda m: m.angle)
    ratio = math.sqrt(sum((m.angle / m.limit) ** 2 for m in found) / len(found))
    return (
        f"seed {seed} noise {1e3 * noise:2.0f} mm  wall {100 * shares[0]:.2f} / "
        f"{100 * shares[1]:.2f} / {100 * whole:.2f}  planes {len(found)} of {len(matches)}, "
        f"{invented} invented, {split} split  normals {ratio:.2f} times the limit, over 0.05 deg "
        f"{sum(m.angle > 0.05 for m in found)}, worst {worst.angle:.3f} (limit {worst.limit:.3f})  "
        f"offset {1e3 * max(m.offset for m in found):.1f} mm  "
        f"{len(data.xyz) / 1e6:.2f} M points, {seconds:.1f} CPU s"
    )


def _matched(data: Any, out: Any) -> tuple[list[Match], int, int]:
    """The true planes that are large enough, and how many planes are invented and split."""
    import numpy as np

    from tests.algorithms.planes.test_extract import ids_of, truth_of

    true, faces = truth_of(data)
    ids = ids_of(out)
    count = np.zeros((out.count + 1, true.max() + 1), np.int64)
    np.add.at(count, (ids, true), 1)
    matches = list(_matches(data.xyz, true, ids, count, faces, out.planes.frame))
    size, top = count[1:].sum(axis=1), count[1:].max(axis=1)
    pieces = (count[1:] > 0.1 * count.sum(axis=0)).sum(axis=0)
    large = count.sum(axis=0) >= FEWEST
    large[0] = False
    return matches, int((2 * top <= size).sum()), int((pieces[large] > 1).sum())


def _matches(xyz: Any, true: Any, ids: Any, count: Any, faces: Any, planes: Any) -> Iterator[Match]:
    import numpy as np
    import shapely

    from tests.algorithms.planes.test_extract import least_error

    planes = planes.set_index("plane_id")
    for face in np.flatnonzero(count.sum(axis=0) >= FEWEST):
        if (
            face == 0
            or _area(shapely.get_coordinates(faces.geometry[face], include_z=True)) < SMALLEST
        ):
            continue
        best = int(count[1:, face].argmax()) + 1
        one, other = (
            row[["normal_x", "normal_y", "normal_z"]].to_numpy(float)
            for row in (faces.loc[face], planes.loc[best])
        )
        middle = xyz[ids == best].mean(axis=0)
        yield Match(
            faces.kind[face],
            *(int(count[:, face].sum()), int(count[best].sum()), int(count[best, face])),
            angle=math.degrees(math.asin(min(1.0, float(np.linalg.norm(np.cross(one, other)))))),
            limit=least_error(xyz[true == face], one),
            offset=float(abs(one @ middle - faces.offset[face])),
        )


def _area(ring: Any) -> float:
    """Of a polygon in space."""
    import numpy as np

    sides = ring[1:-1] - ring[0]
    return float(0.5 * np.linalg.norm(np.cross(sides[:-1], sides[1:]).sum(axis=0)))


PALACES = (  # relief and noise in metres, seed
    (0.5, 0.005, 51),
    (0.2, 0.01, 52),
    (0.0, 0.006, 53),
    (0.1, 0.003, 54),
    (1.0, 0.005, 55),
    (0.7, 0.01, 56),
    (0.4, 0.02, 57),
    (0.3, 0.05, 58),
)
REAL = "facade_street_openings/facade_{}.txt.gz"
# Of the real fronts: share of the points, noise in metres that is added, degrees turned, seed
WORSE = (
    *((1.0, 0.0, degrees, 0) for degrees in (33, 75)),
    *((0.5, 0.0, 0, seed) for seed in (11, 12, 13)),
    *((1.0, 0.02, 0, seed) for seed in (11, 12, 13)),
    (0.5, 0.02, 75, 14),
    *((0.5, 0.02, degrees, seed) for degrees, seed in ((20, 21), (110, 22), (160, 23))),
    (1.0, 0.03, 50, 26),
    *((1.0, 0.03, degrees, seed) for degrees, seed in ((130, 41), (200, 42), (0, 43))),
    *((0.5, 0.03, degrees, seed) for degrees, seed in ((15, 44), (100, 45))),
    *((1.0, 0.04, degrees, seed) for degrees, seed in ((60, 46), (300, 47))),
)


def _openings() -> None:
    """F1 of openings at an IoU of one half: fronts with relief, and two real ones."""
    import numpy as np
    import shapely

    from algorithms.samples.scene import scene

    for relief, noise, seed in PALACES:
        data = scene("facade", size=30.0, density=900.0, seed=seed, relief=relief, noise=noise)
        true = [
            shapely.get_coordinates(shape, include_z=True)
            for shape, p in data.features
            if p["kind"] == "opening"
        ]
        name = f"relief {relief} m noise {1e3 * noise:.0f} mm seed {seed}"
        for shade in (data.attributes["intensity"], None):
            bare = "" if shade is not None else " without intensity"
            say(f"facades  {name}{bare}  {_f1(data.xyz, shade, true)}")
    for number in (1, 2):
        path = DATA / REAL.format(number)
        if not path.exists():
            say(f"facades  {REAL.format(number)} is not there")
            continue
        table = np.loadtxt(path, skiprows=1)
        for shade in (table[:, 3].astype(np.uint16), None):
            bare = "" if shade is not None else " without intensity"
            say(f"facades  real front {number}{bare}  {_f1(table[:, :3], shade, _labelled(table))}")
        for share, noise, degrees, seed in WORSE:
            worse = _worsened(table, share, noise, degrees, seed)
            found = _f1(worse[:, :3], worse[:, 3].astype(np.uint16), _labelled(worse))
            say(
                f"facades  real front {number}, {100 * share:.0f} % of the points, "
                f"{100 * noise:.0f} cm of noise added, turned by {degrees}  {found}"
            )


def _labelled(table: Any) -> list[Any]:
    """Points of each door and window."""
    import numpy as np

    kind, number = table[:, 4], table[:, 5]
    return [
        table[(kind == k) & (number == n), :3] for k in (2, 3) for n in np.unique(number[kind == k])
    ]


def _worsened(table: Any, share: float, noise: float, degrees: float, seed: int) -> Any:
    """Some of the points, scattered and turned."""
    import numpy as np

    rng = np.random.default_rng(seed)
    some = table[rng.random(len(table)) < share]
    some[:, :3] += rng.normal(0.0, noise, (len(some), 3))
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    some[:, :2] = some[:, :2] @ np.array([[cosine, sine], [-sine, cosine]])
    return some


class Score(NamedTuple):
    """Openings that are right at an IoU of one half.

    Attributes
    ----------
    right, true, found : numbers of openings
    iou : median of the best of each true one
    """

    right: int
    true: int
    found: int
    iou: float

    @property
    def f1(self) -> float:
        """Harmonic mean of the shares of the true ones that are found, and of the found ones."""
        return 2 * self.right / max(self.true + self.found, 1)


def score(true: list[Any], found: list[Any]) -> Score:
    """How many openings of a front are found; see :func:`compared`."""
    return compared(true, found)[0]


def compared(true: list[Any], found: list[Any], others: Any = ()) -> tuple[Score, list[int]]:
    """How many openings of a front are found, and which are wrong.

    Parameters
    ----------
    true : points of each, shape (m, 3)
    found : corners of each, shape (m, 3); those of other fronts do not count
    others : points of true ones that nobody judges, as their front is cut there
    """
    import numpy as np
    import shapely
    from scipy.optimize import linear_sum_assignment

    corners = np.vstack(true)
    middle = corners[:, :2].mean(axis=0)
    along, across = np.linalg.svd(corners[:, :2] - middle, full_matrices=False)[2]

    def hull(one: Any) -> Any:
        uv = np.column_stack([(one[:, :2] - middle) @ along, one[:, 2]])
        return shapely.convex_hull(shapely.multipoints(uv))

    cut = shapely.union_all([hull(one) for one in others])
    places = [
        place
        for place, one in enumerate(found)
        if abs(((one[:, :2] - middle) @ across).mean()) < SAME_FRONT
        and hull(one).intersection(cut).area <= hull(one).area / 2
    ]
    if not places:
        return Score(0, len(true), 0, 0.0), []
    a = np.array([hull(one) for one in true])[:, None]
    b = np.array([hull(found[place]) for place in places])[None]
    shared = shapely.area(shapely.intersection(a, b))
    iou = shared / (shapely.area(a) + shapely.area(b) - shared)
    rows, columns = linear_sum_assignment(-iou)
    right = columns[iou[rows, columns] >= 0.5].tolist()
    wrong = [place for column, place in enumerate(places) if column not in right]
    made = Score(len(right), len(true), len(places), float(np.median(iou.max(axis=1))))
    return made, wrong


def _f1(xyz: Any, intensity: Any, true: list[Any]) -> str:
    """Precision, recall and F1 of the openings of the front that holds most true ones."""
    import shapely

    from algorithms.planes.extract import PlanesExtract
    from algorithms.planes.openings import PlanesOpenings
    from toolbox.data import PointCloud
    from toolbox.data.crs import LOCAL

    columns = {} if intensity is None else {"intensity": intensity}
    planes = PlanesExtract(points=PointCloud(xyz, columns, crs=LOCAL)).run()
    out = PlanesOpenings(points=planes.segmented).run()
    found = [shapely.get_coordinates(s, include_z=True) for s in out.openings.frame.geometry]
    made = score(true, found)
    return (
        f"F1 {made.f1:.2f}: {made.right} of {made.true} openings, {made.found} found, "
        f"median IoU {made.iou:.2f}, {out.dropped_count} gaps dropped"
    )


def _beside_open3d() -> None:
    """Twelve planes one after another, with all of a thousand draws and with its early stop."""
    from algorithms.planes import _segment
    from algorithms.planes._search import Rules
    from algorithms.samples.scene import scene

    try:
        import open3d  # type: ignore[import-not-found]
    except ImportError:
        say("facades  Open3D is not installed")
        return
    xyz = scene("facade", size=40.0, density=900.0, seed=3).xyz
    xyz -= xyz.mean(axis=0)
    rules = Rules(tolerance=0, angle=math.radians(20), gap=0, min_points=2000, min_extent=0.1)
    planes = len(_segment.segment(xyz, rules).planes)

    def theirs(probability: float) -> None:
        left = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(xyz))
        for _ in range(planes):
            _, inside = left.segment_plane(0.012, 3, 1000, probability=probability)
            left = left.select_by_index(inside, invert=True)

    for name, probability in (("all draws", 1.0), ("early stop", 0.99)):
        ours, other = alternately(
            lambda: _segment.segment(xyz, rules),
            lambda probability=probability: theirs(probability),  # type: ignore[misc]
            *(2, time.process_time),
        )
        say(
            f"facades  {planes} planes of {len(xyz) / 1e6:.2f} M points: {ours:.2f} CPU s, Open3D "
            f"with {name} {other:.2f}, ratio {other / ours:.0f}"
        )
