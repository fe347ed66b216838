"""Programs that grid, each as text that runs in a process of its own.

Each defines ``work(xy, z, x, y)``: from points to the values at the crossings of x and y."""

from __future__ import annotations

# Gridding: each program in a process of its own, which has a function work(xy, z, x, y), from
# points to the values at the crossings of x and y, and prints what that took.
MEASURED = """
import json, sys, time
import numpy as np
def memory(what):
    lines = open("/proc/self/status").read().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(what))
{}
p, cell = np.load(sys.argv[1]), float(sys.argv[2])
xy, z = p[:, :2].copy(), p[:, 2].copy()
del p
(west, south), (east, north) = np.floor(xy.min(0) / cell), np.ceil(xy.max(0) / cell)
x, y = cell * (np.arange(west, east) + 0.5), cell * (np.arange(north, south, -1) - 0.5)
work(xy[::500], z[::500], x[::50], y[::50])
open("/proc/self/clear_refs", "w").write("5")
before, cpu, wall = memory("VmRSS"), time.process_time(), time.perf_counter()
work(xy, z, x, y)
print(json.dumps(dict(cpu=time.process_time() - cpu, wall=time.perf_counter() - wall,
                      peak=memory("VmHWM") - before, cells=len(x) * len(y), points=len(z))))
"""


OURS = """
from algorithms.surface._gridding import grid
from toolbox.data import Lattice
def work(xy, z, x, y):
    cell = x[1] - x[0]
    lattice = Lattice(x[0] - cell / 2, y[0] + cell / 2, cell, len(y), len(x))
    return grid(xy, z, lattice, method="{}")
"""


GRIDDATA = """
from scipy.interpolate import griddata
def work(xy, z, x, y):
    return griddata(xy, z, tuple(np.meshgrid(x, y)), method="{}")
"""


CKDTREE = """
from scipy.spatial import cKDTree
def work(xy, z, x, y):
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    far, near = cKDTree(xy).query(places, 12, workers=-1)
    weight = 1 / np.maximum(far, 1e-9) ** 2
    return (weight * z[near]).sum(axis=1) / weight.sum(axis=1)
"""


PYKDTREE = """
from pykdtree.kdtree import KDTree
def work(xy, z, x, y):
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    far, near = KDTree(xy).query(places, 12)
    weight = 1 / np.maximum(far, 1e-9) ** 2
    return (weight * z[near]).sum(axis=1) / weight.sum(axis=1)
"""


STARTINPY = """
import startinpy
def spread(n):
    n = n.astype(np.uint64)
    for shift, mask in ((16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF),
                        (4, 0x0F0F0F0F0F0F0F0F), (2, 0x3333333333333333), (1, 0x5555555555555555)):
        n = (n | (n << np.uint64(shift))) & np.uint64(mask)
    return n
def work(xy, z, x, y):  # along a Morton curve, of which it makes the best
    low = 4 * (xy - xy.min(0))
    order = np.argsort(spread(low[:, 0]) | (spread(low[:, 1]) << np.uint64(1)))
    mesh = startinpy.DT()
    mesh.insert(np.column_stack([xy, z])[order])
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return mesh.interpolate({"method": "TIN"}, places)
"""


VERDE = """
import verde
def work(xy, z, x, y):
    return verde.Linear().fit((xy[:, 0], xy[:, 1]), z).predict(np.meshgrid(x, y))
"""


MATPLOTLIB = """
from matplotlib.tri import LinearTriInterpolator, Triangulation
def work(xy, z, x, y):
    triangles = Triangulation(xy[:, 0], xy[:, 1])
    return LinearTriInterpolator(triangles, z)(*np.meshgrid(x, y))
"""


PEERS = (  # method, name, program, bar, aim, step between the points that are used
    ("linear", "startinpy", STARTINPY, 1, 3, 1),
    ("idw", "cKDTree", CKDTREE, 2, 5, 1),
    ("idw", "pykdtree", PYKDTREE, 2, 5, 1),
    ("nearest", "griddata", GRIDDATA.format("nearest"), 1, 1, 1),
    ("linear", "griddata", GRIDDATA.format("linear"), 5, 20, 5),
    ("cubic", "griddata", GRIDDATA.format("cubic"), 5, 20, 5),
    ("linear", "verde", VERDE, 15, 60, 5),
    ("linear", "matplotlib", MATPLOTLIB, 15, 60, 5),
)
GDAL = {  # method: what gdal_grid calls it, bar, aim
    "linear": ("linear:radius=-1", 10, 40),
    "nearest": ("nearest", 3, 10),
    "idw": ("invdistnn:power=2:max_points=12:radius=20", 3, 5),
}
