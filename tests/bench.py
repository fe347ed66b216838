"""Figures for a note or a release: ``make bench``, or ``python -m tests.bench NAME ...``.

Times of two programs are taken alternately in one run, and medians and their ratio are printed.
Data comes from the folder named by TOOLBOX_TEST_DATA.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("TOOLBOX_TEST_DATA", ROOT.parent / "shared" / "data"))
ROUNDS = 7
FEW = int(os.environ.get("LIDAR_ROUNDS", "3"))  # of what takes minutes
SIZES = (1, 5, 10)  # millions of points
# Peak of this process in KiB; ru_maxrss would hand on the peak of the parent.
PEAK = "next(int(l.split()[1]) for l in open('/proc/self/status') if l.startswith('VmHWM'))"

# Zhang et al. (2016), table 2 and section 4: settings by group, and total errors in percent.
CSF_GROUPS = {
    "12": (2, True, 2.97), "21": (3, False, 3.42), "23": (2, True, 4.79), "31": (3, False, 1.61),
    "42": (3, False, 1.58), "51": (3, False, 3.08), "54": (3, False, 3.18), "61": (1, True, 1.49),
}  # fmt: skip


def say(text: str) -> None:
    sys.stdout.write(text + "\n")


def timed(work: Callable[[], Any], clock: Callable[[], float] = time.perf_counter) -> float:
    start = clock()
    work()
    return clock() - start


def alternately(
    ours: Callable[[], Any],
    theirs: Callable[[], Any],
    rounds: int = ROUNDS,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[float, float]:
    """Medians of both, after one round that is not counted."""
    pairs = [(timed(ours, clock), timed(theirs, clock)) for _ in range(rounds + 1)][1:]
    return tuple(statistics.median(column) for column in zip(*pairs, strict=True))  # type: ignore[return-value]


@contextmanager
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def toolbox(*arguments: Any) -> dict[str, Any]:
    """Run the command line in a process of its own; the result as JSON, the seconds and MiB."""
    command = [sys.executable, "-m", "toolbox", *map(str, arguments)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    seconds = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    found: dict[str, Any] = {"code": done.returncode, "error": done.stderr, "seconds": seconds}
    found["cpu"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return found | (json.loads(done.stdout) if done.stdout.startswith("{") else {})


def startup() -> None:
    """Wall time of the verbs that must answer at once; aim below 0.3 s."""
    for arguments in (["list"], ["describe", "ground.csf"], ["run", "ground.csf", "--help"]):
        seconds = statistics.median(toolbox(*arguments)["seconds"] for _ in range(ROUNDS))
        say(f"startup  {' '.join(arguments):24} {seconds:.3f} s")


def reading() -> None:
    """Reading and writing LAZ against plain laspy; aims 1.15 and 1.25."""
    import laspy

    from toolbox.data import PointCloud

    path = DATA / "autzen_ept/autzen_south_5M.laz"
    ours, theirs = alternately(lambda: PointCloud.open(path).xyz, lambda: laspy.read(path).xyz)
    say(f"reading  {ours:.2f} s, laspy {theirs:.2f} s, ratio {ours / theirs:.2f}")
    cloud, las = PointCloud.open(path), laspy.read(path)
    with folder() as out:
        ours, theirs = alternately(
            lambda: cloud.save(out / "a.laz"), lambda: las.write(out / "b.laz")
        )
    say(f"writing  {ours:.2f} s, laspy {theirs:.2f} s, ratio {ours / theirs:.2f}")


def memory() -> None:
    """Peak memory per point of reading with coordinates, in processes of their own."""
    path = DATA / "autzen_ept/autzen_south_5M.laz"
    code = f"import sys; {{}}; print({PEAK})"
    opened = "from toolbox.data import PointCloud; c = PointCloud.open(sys.argv[1]); c.xyz"
    plain = "import laspy; c = laspy.read(sys.argv[1]); xyz = c.xyz"
    small = DATA / "feet/autzen_trim.laz"
    for name, work in [("ours", opened), ("laspy", plain)]:
        peaks = [
            int(subprocess.check_output([sys.executable, "-c", code.format(work), file], cwd=ROOT))
            for file in (path, small)
        ]
        grown = 1024 * (peaks[0] - peaks[1]) / (5_050_000 - 110_000)
        say(f"memory   {name:6} {peaks[0] / 1024:.0f} MiB at the peak, {grown:.0f} bytes per point")


def isprs() -> None:
    """ground.csf and compare.classes on the ISPRS samples with the paper's settings."""
    errors = []
    with folder() as out:
        for sample, (rigidness, smooth, paper) in CSF_GROUPS.items():
            made = out / f"{sample}.laz"
            settings = ["--rigidness", rigidness, "--smooth_slopes", str(smooth).lower()]
            source = ["--points", DATA / f"isprs_samples/samp{sample}.txt.gz"]
            source += ["--points.columns", "x,y,z,label", "--assume-crs", "EPSG:32632"]
            first = toolbox("run", "ground.csf", *source, *settings, "--classified", made, "--json")
            found = toolbox(
                *["run", "compare.classes", "--points", made, "--reference_attribute", "label"],
                *["--reference_positive", "0", "--json"],
            )["statistics"]
            errors.append((found["total_error"], paper))
            say(
                f"isprs    samp{sample}  Type I {found['type_1']:6.2f}  Type II "
                f"{found['type_2']:6.2f}  total {found['total_error']:5.2f} %  kappa "
                f"{100 * found['kappa']:5.1f}  paper {paper:.2f} %  {first['seconds']:.1f} s"
            )
    ours, papers = (statistics.mean(column) for column in zip(*errors, strict=True))
    say(f"isprs    mean total error {ours:.2f} %, paper {papers:.2f} %")


def filters() -> None:
    """All ground filters with their defaults, and csf with the paper's settings, on known truth."""
    from pyproj import CRS

    from toolbox.data import PointCloud

    samples, tiles = {}, {}
    for name in CSF_GROUPS:
        path = DATA / f"isprs_samples/samp{name}.txt.gz"
        cloud = PointCloud.open(path, columns=("x", "y", "z", "label")).with_crs(CRS(32632))
        samples[name] = cloud, cloud["label"] == 0
    for path in sorted((DATA / "ign_urban_50m").glob("*.laz")):
        cloud = PointCloud.open(path)
        tiles[path.stem] = cloud, cloud["classification"] == 2
    for id, make in _ground_filters().items():
        _errors(id, make, samples, {})
        _errors(id, make, tiles, {})
    groups = {n: {"rigidness": r, "smooth_slopes": s} for n, (r, s, _) in CSF_GROUPS.items()}
    _errors("ground.csf by group", _ground_filters()["ground.csf"], samples, groups)


def _ground_filters() -> dict[str, Any]:
    from toolbox import catalog

    return {id: catalog.load(id).make for id in catalog.own_ids() if id.startswith("ground.")}


def _errors(
    title: str, make: Any, clouds: dict[str, Any], settings: dict[str, dict[str, Any]]
) -> None:
    """One line of errors per cloud, and their means."""
    from algorithms.compare.classes import Counts

    rows = []
    for name, (cloud, true) in clouds.items():
        found = make(points=cloud, **settings.get(name, {})).run().classified
        counts = Counts.of(found["classification"] == 2, true)
        rows.append((counts.type_1, counts.type_2, counts.total_error, counts.kappa))
    means = tuple(statistics.mean(column) for column in zip(*rows, strict=True))
    for name, (type_1, type_2, total, kappa) in zip([*clouds, "mean"], [*rows, means], strict=True):
        say(
            f"filters  {title:28} {name:12} Type I {type_1:6.2f}  Type II {type_2:6.2f}  "
            f"total {total:5.2f} %  kappa {100 * kappa:5.1f}"
        )


def cloth() -> None:
    """ground.csf against the package cloth-simulation-filter, in processor time of one thread."""
    import numba

    from algorithms.samples.scene import SamplesScene
    from toolbox.data import PointCloud

    os.environ["OMP_NUM_THREADS"] = "1"
    try:
        import CSF  # type: ignore[import-not-found]
    except ImportError:
        say("cloth    the package cloth-simulation-filter is not installed")
        return
    numba.set_num_threads(1)
    clouds = {
        "autzen": PointCloud.open(DATA / "autzen_ept/autzen_south_5M.laz"),
        "scene": SamplesScene(size=500.0, density=20.0).run().points,
    }
    for name, cloud in clouds.items():
        xyz, metre = cloud.xyz, cloud.metre
        ours, theirs = alternately(
            lambda xyz=xyz, metre=metre: _our_cloth(xyz, metre),  # type: ignore[misc]
            lambda xyz=xyz, metre=metre: _their_cloth(CSF, xyz, metre),  # type: ignore[misc]
            *(3, time.process_time),
        )
        say(
            f"cloth    {name:7} {len(xyz) / 1e6:.2f} M points: {ours:.2f} CPU s, "
            f"package {theirs:.2f} CPU s, ratio {theirs / ours:.1f}"
        )


def _our_cloth(xyz: Any, metre: float) -> Any:
    from algorithms.ground.csf import cloth_simulation, ground_mask

    cloth = cloth_simulation(xyz, cloth_resolution=metre, rigidness=3, metre=metre)
    return ground_mask(xyz, cloth, class_threshold=0.5 * metre)


def _their_cloth(package: Any, xyz: Any, metre: float) -> Any:
    """The same with the package, which knows no units and is given metres."""
    cloth = package.CSF()
    cloth.params.bSloopSmooth = False
    cloth.params.rigidness = 3
    cloth.params.cloth_resolution = 1.0
    cloth.params.class_threshold = 0.5
    cloth.setPointCloud(xyz / metre)
    ground, other = package.VecInt(), package.VecInt()
    cloth.do_filtering(ground, other, False)
    return ground


def terrain() -> None:
    """A dense urban tile: ground by CSF, gridded at 0.5 m, against another program's DTM."""
    import numpy as np

    from toolbox.data import Raster

    tile = "77050_627755"
    with folder() as out:
        source = ["--points", DATA / f"ign_urban_50m/{tile}.laz"]
        toolbox("run", "ground.csf", *source, "--classified", out / "g.laz")
        for name, points in [("csf", out / "g.laz"), ("true", source[1])]:
            grid = ["--points", points, "--classes", "2", "--cell", "0.5"]
            toolbox("run", "surface.grid", *grid, "--surface", out / f"{name}.tif")
            ours = Raster.open(out / f"{name}.tif")
            reference = Raster.open(DATA / f"ign_gridding_reference/DTM_{tile}.tif")
            x, y = (g.ravel() for g in np.meshgrid(*_centres(reference)))
            difference = ours.sample(x, y, method="nearest") - reference.band().ravel()
            difference = difference[np.isfinite(difference)]
            say(
                f"terrain  {name:5} ground: RMSE {np.sqrt(np.mean(difference**2)):.3f} m, "
                f"median {np.median(difference):+.3f} m, "
                f"95 % within {np.quantile(abs(difference), 0.95):.3f} m"
            )


def _centres(raster: Any) -> tuple[Any, Any]:
    from toolbox.data import Lattice

    return Lattice.of(raster).centres()  # type: ignore[no-any-return]


def damaged() -> None:
    """Every odd or damaged file: outcome, seconds and the memory of the process."""
    for path in sorted((DATA / "robustness").glob("*.la[sz]")):
        code = (
            "import sys\nfrom toolbox.cli import main\n"
            "code = main(['info', sys.argv[1], '--json'])\n"
            f"print({PEAK} // 1024, code, file=sys.stderr)"
        )
        start = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", code, str(path)],
            capture_output=True, text=True, cwd=ROOT, check=False,
        )  # fmt: skip
        *messages, last = done.stderr.strip().splitlines()
        points = next(
            (r["value"] for r in json.loads(done.stdout or "[]") if r["property"] == "points"), "-"
        )
        mib, exit_code = last.split()
        note = messages[0][:90] if messages else ""
        say(
            f"damaged  {path.name:32} exit {exit_code}  {points:>6} points  "
            f"{time.perf_counter() - start:.1f} s  {mib} MiB  {note}"
        )


def roundtrip() -> None:
    """Every readable cloud through PointCloud.open and save; what comes back differently."""
    from toolbox.data import PointCloud
    from toolbox.errors import DataError

    same = 0
    endings = (".las", ".laz", ".txt.gz", ".csv.gz", ".ply", ".ply.gz", ".pcd")
    paths = sorted(p for p in DATA.rglob("*") if p.name.lower().endswith(endings))
    with folder() as out:
        for path in paths:
            suffix = ".ply" if ".ply" in path.name or path.suffix == ".pcd" else path.suffix
            suffix = ".txt.gz" if suffix == ".gz" else suffix
            try:
                cloud = PointCloud.open(path)
                cloud.save(out / f"a{suffix}")
                differences = list(_differences(cloud, path, out / f"a{suffix}"))
            except DataError as err:
                differences = [str(err)]
            same += not differences
            for text in differences:
                say(f"roundtrip  {path.parent.name}/{path.name}: {text[:150]}")
    say(f"roundtrip  {same} of {len(paths)} files came back without a difference")


def _differences(cloud: Any, path: Path, copy: Path) -> Iterator[str]:
    import laspy
    import numpy as np

    from toolbox.data import PointCloud
    from toolbox.data.crs import same_crs

    back = PointCloud.open(copy)
    if not np.array_equal(cloud.xyz, back.xyz):
        yield f"coordinates differ by up to {abs(cloud.xyz - back.xyz).max():.1g}"
    lost = [n for n in cloud.names if n not in back or not _equal(cloud[n], back[n])]
    if lost:
        yield f"attributes differ: {', '.join(lost)}"
    if not same_crs(cloud.crs, back.crs):
        yield "the CRS differs"
    if path.suffix.lower() in (".las", ".laz") and path.parent.name != "robustness":
        one, two = laspy.read(path), laspy.read(copy)
        if one.points.array.tobytes() != two.points.array.tobytes():
            yield "raw point records differ"
        records = [
            {
                (v.user_id, v.record_id, v.record_data_bytes())
                for v in las.vlrs
                if "copc" not in v.user_id
            }
            for las in (one, two)
        ]
        if records[0] != records[1]:
            yield "VLRs differ"
        if "copc" in {vlr.user_id for vlr in one.vlrs}:
            yield "COPC records are left out, the copy is plain LAZ"


def _equal(one: Any, two: Any) -> bool:
    import numpy as np

    return bool(np.array_equal(one, two, equal_nan=one.dtype.kind == "f"))


def speed() -> None:
    """Tools by themselves, filters beside laspy's reading, and denoise beside Open3D."""
    _command_line()
    _growth()
    _beside_open3d()


def _command_line() -> None:
    """Seconds per million points, reading and writing included."""
    path = DATA / "autzen_ept/autzen_south_5M.laz"
    with folder() as out:
        runs = {
            "ground.csf": ["--cloth_resolution", "1", "--classified", out / "a.laz"],
            "points.filter": ["--classes", "2", "--kept", out / "b.laz"],
            "surface.grid": ["--cell", "1", "--surface", out / "c.tif"],
            "points.info": [],
        }
        for id, arguments in runs.items():
            found = toolbox("run", id, "--points", path, *arguments, "--json")
            say(
                f"speed    {id:28} {found['seconds'] / 5.05:.2f} s, "
                f"{found['cpu'] / 5.05:.2f} CPU s per million points (exit {found['code']})"
            )


def _growth() -> None:
    """Processor time of the filters beside that of laspy's reading, and how it grows."""
    import laspy

    from algorithms.points.denoise import PointsDenoise
    from toolbox.data import PointCloud

    makes = _ground_filters() | {"points.denoise": PointsDenoise}
    seconds: dict[str, list[float]] = {id: [] for id in makes}
    with folder() as out:
        for millions in SIZES:
            path = out / f"{millions}.laz"
            _survey(millions, path)
            cloud, count = PointCloud.open(path), laspy.read(path).header.point_count / 1e6
            reading = statistics.median(
                timed(lambda path=path: laspy.read(path).xyz, time.process_time)  # type: ignore[misc]
                for _ in range(3)
            )
            for id, make in makes.items():
                make(points=cloud.select(range(50_000))).run()  # compiles
                seconds[id].append(timed(make(points=cloud).run, time.process_time) / count)
                say(
                    f"speed    {id:28} {count:5.2f} M points: {seconds[id][-1]:.2f} CPU s "
                    f"per million, {seconds[id][-1] * count / reading:.1f} times reading"
                )
    for id, found in seconds.items():
        growth = found[-1] / found[0]
        say(f"speed    {id:28} per point, {SIZES[-1]} M over {SIZES[0]} M: {growth:.2f}")


def _survey(millions: int, path: Path) -> None:
    """Write the west of two copies of a survey side by side, at its own density."""
    import laspy
    import numpy as np

    las = laspy.read(DATA / "autzen_ept/autzen_south_5M.laz")
    west, count = las.points.array, millions * 1_000_000
    east = west.copy()
    east["X"] += np.ptp(west["X"]) + 1
    both = np.concatenate([west, east])
    both = both[both["X"] <= np.partition(both["X"], count - 1)[count - 1]]
    scales, offsets = las.header.scales, las.header.offsets
    las.points = laspy.ScaleAwarePointRecord(both, las.point_format, scales, offsets)
    las.write(path)


def _beside_open3d() -> None:
    """Statistical outlier removal of 5 M points with 20 neighbours, in processor time."""
    from algorithms.points.denoise import noise
    from toolbox.data import PointCloud

    try:
        import open3d  # type: ignore[import-not-found]
    except ImportError:
        say("speed    Open3D is not installed")
        return
    cloud = PointCloud.open(DATA / "autzen_ept/autzen_south_5M.laz")
    xyz, metre = cloud.xyz, cloud.metre
    theirs = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(xyz.copy()))
    for scope in ("local", "classic"):
        our_seconds, their_seconds = alternately(
            lambda scope=scope: noise(xyz, scope=scope, reach=20 * metre, height_gap=100 * metre),  # type: ignore[misc]
            lambda: theirs.remove_statistical_outlier(21, 5.0),  # it counts the point itself
            *(3, time.process_time),
        )
        say(
            f"speed    points.denoise {scope:7} {our_seconds:.1f} CPU s, Open3D "
            f"{their_seconds:.1f} CPU s, ratio {their_seconds / our_seconds:.2f}"
        )


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
from algorithms.surface.grid import grid
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


def gridding() -> None:
    """surface.grid beside other programs: processor time, alternately, and memory.

    LIDAR_PEERS may name a Python in which scipy, startinpy, verde and matplotlib are installed.
    """
    import numpy as np

    with folder() as out:
        xyz = _in_metres()
        for step in (1, 5):
            np.save(out / f"{step}.npy", xyz[::step])
        for method, name, program, bar, aim, step in PEERS:
            for cell in (1.0, 0.5):
                found = [
                    [_measured(code, out / f"{step}.npy", cell, peer) for code, peer in pair]
                    for pair in [((OURS.format(method), False), (program, True))] * FEW
                ]
                if not all(map(all, found)):
                    say(f"gridding {method:8} {name}: not installed")
                    break
                _say_ratio(method, name, bar, aim, found)
        for method in ("linear", "natural", "cubic", "idw", "nearest", "mean"):
            _memory_of(f"ours {method}", OURS.format(method), out / "5.npy", peer=False)
        for method in ("linear", "cubic"):
            _memory_of(f"griddata {method}", GRIDDATA.format(method), out / "5.npy", peer=True)
        _beside_gdal_grid(xyz, out)
        _beside_floor(out)


def _in_metres() -> Any:
    """Five million points of a survey."""
    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / "autzen_ept/autzen_south_5M.laz")
    return cloud.xyz / cloud.metre


def _measured(code: str, points: Path, cell: float, peer: bool) -> dict[str, float] | None:
    """What a program took; None if it is not installed."""
    python = os.environ.get("LIDAR_PEERS", sys.executable) if peer else sys.executable
    done = subprocess.run(
        [python, "-c", MEASURED.format(code), str(points), str(cell)],
        capture_output=True, text=True, cwd=ROOT, check=False,
    )  # fmt: skip
    if "ModuleNotFoundError" in done.stderr:
        return None
    if done.returncode:
        raise RuntimeError(done.stderr)
    return dict(json.loads(done.stdout))


def _say_ratio(method: str, name: str, bar: float, aim: float, found: list[Any]) -> None:
    cpu, wall = (
        [statistics.median(row[i][clock] for row in found) for i in (0, 1)]
        for clock in ("cpu", "wall")
    )
    points, cells = (found[0][0][what] / 1e6 for what in ("points", "cells"))
    peaks = [found[0][i]["peak"] / 2**20 for i in (0, 1)]
    say(
        f"gridding {method:8} {points:.1f} M points, {cells:.1f} M cells: {cpu[0]:6.2f} CPU s, "
        f"{name} {cpu[1]:6.2f}, ratio {cpu[1] / cpu[0]:5.1f} (bar {bar}, aim {aim}); seconds "
        f"{wall[0]:.2f}, {wall[1]:.2f}, ratio {wall[1] / wall[0]:.1f}; MiB "
        f"{peaks[0]:.0f}, {peaks[1]:.0f}"
    )


def _memory_of(name: str, code: str, points: Path, *, peer: bool) -> None:
    """Bytes at the peak beyond the points, per point and per cell."""
    coarse, fine = (_measured(code, points, cell, peer) for cell in (4.0, 0.5))
    if coarse is None or fine is None:
        say(f"gridding memory {name}: not installed")
        return
    per_cell = (fine["peak"] - coarse["peak"]) / (fine["cells"] - coarse["cells"])
    per_point = (coarse["peak"] - per_cell * coarse["cells"]) / coarse["points"]
    say(f"gridding memory {name:16} {per_point:5.0f} bytes per point, {per_cell:3.0f} per cell")


def _beside_gdal_grid(xyz: Any, out: Path) -> None:
    """Whole commands, processor time; gdal_grid reads text, which it takes best, and we LAZ."""
    if not shutil.which("gdal_grid"):
        say("gridding gdal_grid is not installed")
        return
    cloud = DATA / "autzen_ept/autzen_south_5M.laz"
    _write_text(xyz, out / "p.csv")
    (west, south, _), (east, north, _) = xyz.min(axis=0), xyz.max(axis=0)
    edges = ["-txe", west, east, "-tye", north, south]
    command = ["gdal_grid", "-q", "--config", "GDAL_NUM_THREADS", "ALL_CPUS", *edges]

    def theirs(algorithm: str, cell: float) -> float:
        size = ["-outsize", *(max(1, round(d / cell)) for d in (east - west, north - south))]
        files = ["-l", "p", out / "p.vrt", out / "g.tif"]
        return _command_seconds([*command, *size, "-a", algorithm, *files])

    reading = theirs("average", 1e6)  # into a single cell
    say(f"gridding gdal_grid reads the points in {reading:.1f} CPU s")
    for method, (algorithm, bar, aim) in GDAL.items():
        for cell in (1.0, 0.5):
            options = ["--points", cloud, "--method", method, "--cell", cell, "--json"]
            done = [
                (
                    toolbox("run", "surface.grid", *options, "--surface", out / f"{n}{cell}.tif"),
                    theirs(algorithm, cell),
                )
                for n in range(FEW)
            ]
            ours, other = (
                statistics.median(column)
                for column in zip(*((row[0]["cpu"], row[1]) for row in done), strict=True)
            )
            inside = _measured(OURS.format(method), out / "1.npy", cell, peer=False)
            assert inside
            say(
                f"gridding {method:8} cells of {cell} m: command {ours:.1f} CPU s, gdal_grid "
                f"{other:.1f}, ratio {other / ours:.1f} (bar {bar}, aim {aim}); interpolation "
                f"{inside['cpu']:.1f}, {other - reading:.1f}, "
                f"ratio {(other - reading) / inside['cpu']:.1f}"
            )


def _beside_floor(out: Path) -> None:
    """Each method as one command, and what no program can do without: read, sort, write."""
    path = DATA / "autzen_ept/autzen_south_5M.laz"
    code = (
        "import sys, time, laspy, numpy as np, rasterio\n"
        "def lap(name, work, start=time.process_time):\n"
        "    begin = start(); found = work(); print(name, start() - begin); return found\n"
        "xyz = lap('reading', lambda: laspy.read(sys.argv[1]).xyz)\n"
        "lap('sorting', lambda: xyz[np.argsort(xyz[:, 0])])\n"
        "values = np.random.default_rng(0).normal(100, 5, (1354, 2044)).astype('float32')\n"
        "how = dict(driver='GTiff', dtype='float32', count=1, width=2044, height=1354,\n"
        "           compress='deflate', predictor=3)\n"
        "lap('writing', lambda: rasterio.open(sys.argv[2], 'w', **how).write(values, 1))\n"
    )
    command = [sys.executable, "-W", "ignore", "-c", code, str(path), str(out / "floor.tif")]
    lines = subprocess.check_output(command, text=True, cwd=ROOT).split("\n")
    floor = {line.split()[0]: float(line.split()[1]) for line in lines if line}
    total = sum(floor.values())
    parts = ", ".join(f"{name} {seconds:.1f}" for name, seconds in floor.items())
    say(f"gridding floor {total:.1f} CPU s: {parts}")
    for method in ("mean", "nearest", "idw", "linear", "natural", "cubic"):
        options = ["--points", path, "--method", method, "--cell", 0.5, "--json"]
        seconds = toolbox("run", "surface.grid", *options, "--surface", out / f"{method}.tif")
        say(
            f"gridding floor {method:8} {seconds['cpu']:.1f} CPU s, "
            f"{seconds['cpu'] / total:.1f} times the floor"
        )


def _write_text(xyz: Any, path: Path) -> None:
    import numpy as np

    np.savetxt(path, xyz, "%.3f", delimiter=",", header="x,y,z", comments="")
    path.with_suffix(".vrt").write_text(
        f"""<OGRVRTDataSource><OGRVRTLayer name="{path.stem}">
        <SrcDataSource>{path}</SrcDataSource><GeometryType>wkbPoint25D</GeometryType>
        <GeometryField encoding="PointFromColumns" x="x" y="y" z="z"/>
        </OGRVRTLayer></OGRVRTDataSource>"""
    )


def _command_seconds(command: list[Any]) -> float:
    """Processor time of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(list(map(str, command)), check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def shorelines() -> None:
    """Water bodies of 20 synthetic reservoirs against their true outlines and levels."""
    for density in (8.0, 2.0):
        for seed in range(100, 120):
            for text in _reservoir(seed, (200.0, 300.0, 400.0, 250.0)[seed % 4], density):
                say(f"shorelines  {density:g}/m2 seed {seed} {text}")


def _reservoir(seed: int, size: float, density: float) -> Iterator[str]:
    """A line for each true body, and for each that is none."""
    import numpy as np
    import shapely
    from pyproj import CRS

    from algorithms.samples.scene import scene
    from algorithms.shoreline.extract import ShorelineExtract
    from toolbox.data import PointCloud

    made = scene("reservoir", size=size, density=density, seed=seed)
    points = PointCloud(made.xyz, made.attributes, crs=CRS(32635))
    water = ShorelineExtract(points=points, bodies="all").run().water.frame
    shapes, used = shapely.force_2d(water.geometry.to_numpy()), set()
    for shape, known in made.features:
        truth = shapely.force_2d(shape)
        if truth.area < 100 or not len(shapes):
            continue
        best = int(np.argmax(shapely.area(shapely.intersection(shapes, truth))))
        used.add(best)
        found = shapes[best]
        spots = shapely.points(shapely.get_coordinates(shapely.segmentize(truth.boundary, 0.5)))
        away = shapely.distance(spots, found.boundary)
        yield (
            f"{known['body']:9} {truth.area:8.0f} m2 IoU "
            f"{truth.intersection(found).area / truth.union(found).area:.4f} "
            f"RMS {np.sqrt((away**2).mean()):.2f} m "
            f"level {water.level[best] - known['level']:+.4f} m "
            f"perimeter {found.length / truth.length:.3f} "
            f"islands {water.islands[best]} of {len(truth.interiors)}"
        )
    if len(used) < len(shapes):
        yield f"{len(shapes) - len(used)} bodies that are none"


def corridor() -> None:
    """Wires, towers and spans of two real tiles and ten synthetic corridors."""
    import numpy as np
    from pyproj import CRS

    from algorithms.compare.spans import CompareSpans
    from algorithms.corridor.extract import CorridorExtract
    from algorithms.samples.scene import SamplesScene
    from toolbox.data import PointCloud, Vector

    def shares(said: Any, true: Any) -> str:
        both = (said & true).sum()
        whole = (said.sum(), true.sum(), (said | true).sum())
        return " / ".join(f"{100 * both / max(n, 1):5.1f}" for n in whole)

    def report(name: str, points: PointCloud, truth: Any, lines: Vector | None) -> None:
        start = time.process_time()
        found = CorridorExtract(points=points).run()
        seconds = (time.process_time() - start) / len(points) * 1e6
        said = found.classified["classification"]
        text = f"wires {shares(said == 14, np.isin(truth, (13, 14)))}"
        text += f"  towers {shares(said == 15, np.isin(truth, (15, 16)))}"
        if lines:
            spans = CompareSpans(wires=found.wires, reference=lines).run()
            text += f"  spans {spans.in_full}/{spans.in_part}/{spans.missed}"
            text += f"  invented {spans.invented}  height {spans.height_rms} m"
        say(f"corridor {name:12} {text}  {seconds:.1f} CPU s / M points")

    for tile in ("12AN2_20", "12BZ1_21"):
        cloud = PointCloud.open(DATA / f"powerline_ahn4/{tile}_as_published.laz")
        report(tile, cloud.with_crs(CRS(28992)), cloud["classification"], None)
    for seed, density in enumerate((5, 8, 10, 12, 16, 20, 25, 30, 40, 60)):
        made = SamplesScene(kind="power_lines", size=400.0, density=float(density), seed=seed).run()
        truth = made.points["classification"]
        features = made.features.frame
        blank = made.points.with_attributes({"classification": np.ones(len(truth), np.uint8)})
        wires = Vector(features[features.kind == "wire"])
        report(f"seed {seed}", blank, truth, wires)


ALL = (
    *(startup, reading, memory, isprs, filters, cloth, terrain, damaged, roundtrip, speed),
    *(gridding, shorelines, corridor),
)
BENCHES = {b.__name__: b for b in ALL}

if __name__ == "__main__":
    for name in sys.argv[1:] or BENCHES:
        BENCHES[name]()
