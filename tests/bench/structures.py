"""Triangulation and nearest neighbours beside other programs: time, memory, and whether the answer
is exact and the same for any order of the points."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.bench.measuring import DATA, FEW, ROOT, folder, say

NEIGHBOURS = 12
RADIUS = 5.0  # feet, the unit of the points
SIZES = (200_000, 1_000_000)

# Each program is measured in a process of its own. It defines work(points) and check(answer,
# points), where the check gives rows of coordinates that do not depend on the order of points.
MEASURED = """
import json, sys, time
import numpy as np
def memory(what):
    lines = open("/proc/self/status").read().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(what))
{}
points = np.load(sys.argv[1])
work(points[::100].copy())
open("/proc/self/clear_refs", "w").write("5")
before, cpu, wall = memory("VmRSS"), time.process_time(), time.perf_counter()
found = work(points)
print(json.dumps(dict(cpu=time.process_time() - cpu, wall=time.perf_counter() - wall,
                      peak=memory("VmHWM") - before)))
if len(sys.argv) > 2:
    np.save(sys.argv[2], check(found, points))
"""

CORNERS = """
def check(corners, points):  # as a set of triangles: corners in order, then rows
    corners = np.sort(corners.view("c16")[..., 0], axis=1)
    return corners[np.lexsort(corners.T)]
"""

DELAUNAY = {
    "ours": """
from algorithms.shared.delaunay import triangulate
def work(points):
    xy = np.ascontiguousarray(points[:, :2])
    return xy[triangulate(xy).triangles]
"""
    + CORNERS,
    "scipy": """
from scipy.spatial import Delaunay
def work(points):
    xy = np.ascontiguousarray(points[:, :2])
    return xy[Delaunay(xy).simplices]
"""
    + CORNERS,
    "startinpy": """
import startinpy
def spread(n):
    n = n.astype(np.uint64)
    for shift, mask in ((16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF),
                        (4, 0x0F0F0F0F0F0F0F0F), (2, 0x3333333333333333), (1, 0x5555555555555555)):
        n = (n | (n << np.uint64(shift))) & np.uint64(mask)
    return n
def work(points):  # along a Morton curve, of which it makes the best
    low = 4 * (points[:, :2] - points[:, :2].min(0))
    order = np.argsort(spread(low[:, 0]) | (spread(low[:, 1]) << np.uint64(1)))
    mesh = startinpy.DT()
    mesh.snap_tolerance = 1e-9
    mesh.insert(points[order])
    return np.ascontiguousarray(mesh.points[:, :2])[mesh.triangles]
"""
    + CORNERS,
}

BY_PLACE = """
def check(found, points):  # values in the order of the places, to six digits
    return found[np.lexsort(points.T)].round(6)[:, None]
"""

OF_SHAPE = """
def planarity(points, index, starts):  # of the points index[starts[i] : starts[i + 1]]
    near, count = points[index], np.diff(np.append(starts, len(index)))[:, None]
    near -= np.repeat(np.add.reduceat(near, starts) / count, count[:, 0], axis=0)
    squares = np.stack([near[:, a] * near[:, b] for a in range(3) for b in range(3)], axis=1)
    sums = np.add.reduceat(squares, starts).reshape(-1, 3, 3)
    small, middle, large = np.linalg.eigvalsh(sums / count[:, :, None]).T
    return np.where(count[:, 0] < 3, 0.0, (middle - small) / large)
def of_nearest(points, query):
    found, few = np.empty(len(points)), 100_000
    for first in range(0, len(points), few):
        index = query(points[first : first + few])
        starts = np.arange(len(index)) * index.shape[1]
        found[first : first + few] = planarity(points, index.ravel(), starts)
    return found
"""

SCIPY = "from scipy.spatial import cKDTree\n"
PYKDTREE = "from pykdtree.kdtree import KDTree\n"

DISTANCE = {
    "ours": f"""
from algorithms.shared.neighbours import PointTree
def work(points):
    tree, found = PointTree.of(points), np.empty(len(points))
    found[tree.order] = tree.mean_distances({NEIGHBOURS})[0]
    return found
""",
    "scipy": SCIPY
    + f"""
def work(points):
    return cKDTree(points).query(points, {NEIGHBOURS + 1}, workers=-1)[0][:, 1:].mean(axis=1)
""",
    "pykdtree": PYKDTREE
    + f"""
def work(points):
    return KDTree(points).query(points, {NEIGHBOURS + 1})[0][:, 1:].mean(axis=1)
""",
}

SHAPE = {
    "ours": f"""
from algorithms.shared.covariance import covariance_features
def work(points):
    return covariance_features(points, neighbours={NEIGHBOURS}, names=["planarity"])["planarity"]
""",
    "scipy": SCIPY
    + OF_SHAPE
    + f"""
def work(points):
    tree = cKDTree(points)
    return of_nearest(points, lambda some: tree.query(some, {NEIGHBOURS + 1}, workers=-1)[1])
""",
    "pykdtree": PYKDTREE
    + OF_SHAPE
    + f"""
def work(points):
    tree = KDTree(points)
    return of_nearest(points, lambda some: tree.query(some, {NEIGHBOURS + 1})[1])
""",
}

WITHIN = {
    "ours": f"""
from algorithms.shared.covariance import covariance_features
def work(points):
    return covariance_features(
        points, neighbours=None, radius={RADIUS}, names=["planarity"]
    )["planarity"]
""",
    "scipy": SCIPY
    + OF_SHAPE
    + f"""
def work(points):
    tree, found, few = cKDTree(points), np.empty(len(points)), 100_000
    for first in range(0, len(points), few):
        near = tree.query_ball_point(points[first : first + few], {RADIUS}, workers=-1)
        starts = np.concatenate([[0], np.cumsum([len(some) for some in near])[:-1]])
        index = np.concatenate(near).astype(np.int64)
        found[first : first + few] = planarity(points, index, starts)
    return found
""",
}


def structures() -> None:
    """Triangulation, and what tools find out of the neighbours of each point: ours and others.

    Delaunay triangulation beside scipy (Qhull) and startinpy. Beside the k-d trees of scipy and
    pykdtree: the mean distance of 12 neighbours, which points.denoise takes; how planar these
    12 are, and all within a radius, as features.local tells.

    LIDAR_PEERS may name a Python in which scipy, startinpy and pykdtree are installed.
    """
    import numpy as np

    from toolbox.data import PointCloud

    xyz = PointCloud.open(DATA / "autzen_ept/autzen_south_5M.laz").xyz
    xyz = xyz[np.unique(xyz, axis=0, return_index=True)[1]]
    with folder() as out:
        rng = np.random.default_rng(0)
        for size in SIZES:
            east = np.argsort(xyz[:, 0], kind="stable")[:size]  # at the density of the survey
            points = rng.permutation(xyz[east])
            _, first = np.unique(points[:, :2], axis=0, return_index=True)
            for name, programs, given in (
                ("Delaunay", DELAUNAY, points[np.sort(first)]),
                ("distance", DISTANCE, points),
                ("planarity", SHAPE, points),
                ("in radius", WITHIN, points),
            ):
                np.save(out / "points.npy", given)
                np.save(out / "other.npy", rng.permutation(given))
                _compare(name, programs, len(given), out)


def _compare(name: str, programs: dict[str, str], size: int, out: Path) -> None:
    """Print what each program took, alternately, and whether its answer hangs on the order."""
    import numpy as np

    runs: dict[str, list[Any]] = {program: [] for program in programs}
    for k in range(FEW):
        for program, code in programs.items():
            answer = str(out / f"{program}.npy") if k == 0 else None
            runs[program].append(_measured(code, program, out / "points.npy", answer))
    for program, code in programs.items():
        if not all(runs[program]):
            say(f"{name:10} {program}: not installed")
            continue
        cpu, wall, peak = (
            statistics.median(run[what] for run in runs[program])
            for what in ("cpu", "wall", "peak")
        )
        _measured(code, program, out / "other.npy", str(out / "again.npy"))
        one, two = np.load(out / f"{program}.npy"), np.load(out / "again.npy")
        say(
            f"{name:10} {program:9} {size / 1e6:.2f} M points: {cpu:6.2f} CPU s, {wall:6.2f} s, "
            f"{peak / size:4.0f} bytes per point; {_differing(one, two)} of {len(one)} rows "
            f"differ in another order{_not_delaunay(name, one)}"
        )


def _measured(code: str, program: str, points: Path, answer: str | None) -> Any:
    """What a program took; None if it is not installed."""
    python = sys.executable if program == "ours" else os.environ.get("LIDAR_PEERS", sys.executable)
    command = [
        python,
        "-c",
        MEASURED.format(code + ("" if "def check" in code else BY_PLACE)),
        str(points),
        *([answer] if answer else []),
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    if "ModuleNotFoundError" in done.stderr:
        return None
    if done.returncode:
        raise RuntimeError(done.stderr)
    return json.loads(done.stdout)


def _differing(one: Any, two: Any) -> int:
    """Rows that only one of two answers has."""
    import numpy as np

    if one.dtype.kind == "f":  # values by place
        return int((one != two).sum() - (np.isnan(one) & np.isnan(two)).sum())
    both = np.concatenate([one, two])
    both = both[np.lexsort(both.T)]
    twins = int((both[1:] == both[:-1]).all(axis=1).sum())
    return len(one) - twins


def _not_delaunay(name: str, corners: Any) -> str:
    """How many edges have the far corner of one side within the circle of the other, exactly."""
    if name != "Delaunay":
        return ""
    import numpy as np

    flat = np.ascontiguousarray(corners).view("f8").reshape(-1, 3, 2)
    east, north = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    clockwise = east[:, 0] * north[:, 1] - east[:, 1] * north[:, 0] < 0
    flat[clockwise] = flat[clockwise][:, ::-1]
    ends = np.stack([corners[:, [1, 2]], corners[:, [0, 2]], corners[:, [0, 1]]], axis=1)
    ends = np.sort(ends.reshape(-1, 2), axis=1)
    order = np.lexsort(ends.T)
    twin = np.flatnonzero((ends[order][1:] == ends[order][:-1]).all(axis=1))
    one, other = order[twin], order[twin + 1]
    opposite = corners.reshape(-1)[other].view("f8").reshape(-1, 2)
    return f"; {_wrong(flat[one // 3], opposite)} of {len(one)} edges are not Delaunay"


def _wrong(triangles: Any, places: Any) -> int:
    """How many places lie within the circle through the triangle of the same row, exactly."""
    from fractions import Fraction

    import numpy as np

    a, b, c = (triangles[:, k] - places for k in range(3))
    terms = [(u * u).sum(axis=1) for u in (a, b, c)]
    cross = [v[:, 0] * w[:, 1] - v[:, 1] * w[:, 0] for v, w in ((b, c), (c, a), (a, b))]
    inside = sum(s * t for s, t in zip(terms, cross, strict=True))
    size = sum(np.abs(s * t) for s, t in zip(terms, cross, strict=True))
    doubtful = np.flatnonzero(np.abs(inside) <= 1e-9 * size)
    wrong = int((np.delete(inside, doubtful) > 0).sum())
    for k in doubtful:
        rows = []
        for corner in triangles[k]:
            x, y = (Fraction(u) - Fraction(v) for u, v in zip(corner, places[k], strict=True))
            rows.append((x, y, x * x + y * y))
        (ax, ay, aa), (bx, by, bb), (cx, cy, cc) = rows
        exact = aa * (bx * cy - by * cx) + bb * (cx * ay - cy * ax) + cc * (ax * by - ay * bx)
        wrong += exact > 0
    return wrong
