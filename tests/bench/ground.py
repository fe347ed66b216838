"""Ground filters: errors on known truth, and beside the package of the cloth simulation."""

from __future__ import annotations

import argparse
import itertools
import os
import statistics
import time
from typing import Any

from tests.bench.measuring import DATA, alternately, folder, say, toolbox

# Zhang et al. (2016), table 2 and section 4: settings by group, and total errors in percent.
CSF_GROUPS = {
    "12": (2, True, 2.97),
    "21": (3, False, 3.42),
    "23": (2, True, 4.79),
    "31": (3, False, 1.61),
    "42": (3, False, 1.58),
    "51": (3, False, 3.08),
    "54": (3, False, 3.18),
    "61": (1, True, 1.49),
}
SAMPLES = sorted([*CSF_GROUPS, "53"])

# Modern surveys whose provider has told all of the ground from all else.
SURVEYS = {
    "town 1": "ign_urban_50m/77050_627755.laz",
    "town 2": "ign_urban_50m/77055_627755.laz",
    "town 3": "ign_urban_50m/77060_627760.laz",
    "Delft": "ahn3_delft_bgt/ahn3_cropped_2.laz",
    "Amsterdam 1": "ahn_amsterdam/ahn3_2386_9702.laz",
    "Amsterdam 2": "ahn_amsterdam/ahn4_2463_9714_rgb.laz",
    "sparse": "ign_lidarhd_decimated_1km/0382_6565.laz",
    "line 1": "powerline_ahn4/12AN2_20_as_published.laz",
    "line 2": "powerline_ahn4/12BZ1_21_as_published.laz",
}
# Water, roads, bridges, structures and artefacts are neither ground nor objects.
NOT_COUNTED = (7, 9, 10, 11, 14, 15, 17, 18, 26, 64, 65, 66, 67)


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

    samples = {}
    for name in SAMPLES:
        path = DATA / f"isprs_samples/samp{name}.txt.gz"
        cloud = PointCloud.open(path, columns=("x", "y", "z", "label")).with_crs(CRS(32632))
        samples[name] = cloud, cloud["label"] == 0
    for id, make in ground_filters().items():
        _errors(id, make, samples, {})
    groups = {n: {"rigidness": r, "smooth_slopes": s} for n, (r, s, _) in CSF_GROUPS.items()}
    known = {name: samples[name] for name in CSF_GROUPS}
    _errors("ground.csf by group", ground_filters()["ground.csf"], known, groups)


def surveys() -> None:
    """All ground filters with their defaults against the ground of the providers of surveys."""
    import numpy as np

    clouds = {}
    for name in SURVEYS:
        cloud = _survey(name)
        clouds[name] = cloud, cloud["classification"] == 2
    counted = {
        name: ~np.isin(cloud["classification"], NOT_COUNTED) for name, (cloud, _) in clouds.items()
    }
    for id, make in ground_filters().items():
        _errors(id, make, clouds, {}, counted)


def _survey(name: str) -> Any:
    from pyproj import CRS

    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / SURVEYS[name])
    return cloud if cloud.crs else cloud.with_crs(CRS(28992))


def grounds(*options: str) -> None:
    """A ground filter on scenes with bridges, banks, dams, terraces, ramps, steep woods, hillsides.

    The options `--seeds FIRST LAST` and `--filter ID` tell which; nothing was chosen on any seed.
    """
    from pyproj import CRS

    from tests.scenes.ground import KINDS, draw
    from toolbox.data import PointCloud

    reader = argparse.ArgumentParser("grounds")
    reader.add_argument("--seeds", type=int, nargs=2, default=(100, 102))
    reader.add_argument("--filter", choices=ground_filters(), default="ground.classify")
    chosen = reader.parse_args(options)
    first, last = chosen.seeds
    for kind in KINDS:
        clouds = {}
        for seed in range(first, last + 1):
            survey = draw(kind, seed)
            clouds[f"{kind} {seed}"] = PointCloud(survey.xyz, crs=CRS(32635)), survey.ground
        _errors(chosen.filter, ground_filters()[chosen.filter], clouds, {})


HALOS = (64.0, 100.0, 150.0, 200.0, 250.0)  # metres


# Survey, share of the points that become noise, metres below the lowest 2 %: at most; at least.
LOW_NOISE = (
    ("town 1", 0.003, 5.0, 1.5),
    ("town 1", 0.01, 15.0, 1.5),
    ("town 1", 0.05, 30.0, -60.0),
    ("town 2", 0.004, 7.0, 1.5),
    ("town 3", 0.01, 4.0, 1.5),
    ("town 3", 0.02, 15.0, 1.5),
    ("Delft", 0.005, 15.0, 1.5),
    ("Delft", 0.01, 4.0, 1.5),
    ("Delft", 0.01, 15.0, 1.5),
    ("Delft", 0.02, 15.0, 1.5),
    ("Delft", 0.05, 30.0, -60.0),
    ("Amsterdam 1", 0.005, 8.0, 1.5),
    ("Amsterdam 1", 0.02, 20.0, 1.5),
    ("Amsterdam 2", 0.01, 4.0, 1.5),
    ("Amsterdam 2", 0.02, 15.0, 1.5),
    ("line 1", 0.004, 10.0, 1.5),
)


def low_noise() -> None:
    """ground.classify with noise below the lowest 2 % of the heights: ground that is found.

    The points are drawn at random, three times. Nothing else is done about noise before.
    """
    import numpy as np

    from algorithms.ground.classify import GroundClassify

    for name, share, deep, least in LOW_NOISE:
        cloud = _survey(name)
        low = np.quantile(cloud.xyz[:, 2], 0.02)
        shares, noise = [], []
        for seed in (1, 2, 3):
            rng = np.random.default_rng(seed)
            moved = rng.random(len(cloud)) < share
            xyz = cloud.xyz.copy()
            xyz[moved, 2] = low - rng.uniform(least, deep, moved.sum())
            found = GroundClassify(points=cloud.with_xyz(xyz)).run().classified
            ground = found["classification"] == 2
            shares.append(100 * ground[(cloud["classification"] == 2) & ~moved].mean())
            noise.append(100 * ground[moved].mean())
        say(
            f"low_noise  {name:12} {100 * share:.1f} % of the points, {least:g} to {deep:g} m "
            f"deep: ground found, worst {min(shares):.1f} %, mean "
            f"{statistics.mean(shares):.1f} %; noise taken for ground {max(noise):.1f} %"
        )


def halos() -> None:
    """ground.classify on tiles with halos of several widths: labels that differ from the whole.

    Each sample is cut in two, in both ways; each half with its halo is a tile. The change of the
    terrain is the mean over the points within 32 m of the cut.
    """
    import numpy as np

    from algorithms.shared.terrain import find_terrain, height_above, verdict
    from toolbox.data import PointCloud

    rows: dict[float, list[tuple[int, float]]] = {halo: [] for halo in HALOS}
    for name in ("51", "53", "61"):
        path = DATA / f"isprs_samples/samp{name}.txt.gz"
        xyz = PointCloud.open(path, columns=("x", "y", "z", "label")).xyz
        terrain = find_terrain(xyz)
        whole, above = verdict(xyz, terrain)[0], height_above(xyz, terrain)
        for axis, sign, halo in itertools.product((0, 1), (-1, 1), HALOS):
            ahead = sign * (xyz[:, axis] - xyz[:, axis].min() - np.ptp(xyz[:, axis]) / 2)
            tile, core = ahead >= -halo, ahead >= 0
            if tile.all():
                continue
            part = find_terrain(xyz[tile])
            found, edge = verdict(xyz[tile], part)[0], core & (ahead < 32)
            moved = np.abs(height_above(xyz[edge], part) - above[edge])
            rows[halo].append((int((found != whole[tile])[core[tile]].sum()), np.nanmean(moved)))
    for halo, tiles in rows.items():
        differ, moved = zip(*tiles, strict=True)
        say(
            f"halos    {halo:3.0f} m: {sum(differ)} labels differ in {len(tiles)} tiles, "
            f"terrain at the edge by {statistics.mean(moved):.1e} m"
        )


HILLS = (
    (0.05, 90.0),
    (0.08, 90.0),
    (0.1, 90.0),
    (0.1, 180.0),
    (0.2, 45.0),
    (0.2, 225.0),
    (0.4, 0.0),
    (0.4, 90.0),
)
TOWNS = [name for name in SURVEYS if not name.startswith("line")]
HOUSE = 12.0  # metres up the hill: longer buildings stand in steps


def hillsides(*options: str) -> None:
    """A ground filter on towns that are put on even hillsides, whose buildings stay level.

    Eight hills of a town, as slope and direction; the option `--filter ID` tells which filter.
    """
    import numpy as np

    reader = argparse.ArgumentParser("hillsides")
    reader.add_argument("--filter", choices=ground_filters(), default="ground.classify")
    chosen = reader.parse_args(options).filter
    for name in TOWNS:
        cloud = _survey(name)
        given = cloud["classification"]
        other = ~np.isin(given, (2, *NOT_COUNTED))
        for slope, towards in ((0.0, 0.0), *HILLS):
            hill = _on_a_hill(cloud, slope, towards)
            found = ground_filters()[chosen](points=hill).run().classified["classification"] == 2
            type_1, type_2, roofs = (
                100 * part.mean() for part in (~found[given == 2], found[other], found[given == 6])
            )
            say(
                f"hillsides {chosen:16} {name:12} slope {slope:.2f} to {towards:3.0f} degrees: "
                f"Type I {type_1:5.2f}  Type II {type_2:5.2f}  of buildings {roofs:5.2f} %"
            )


def _on_a_hill(cloud: Any, slope: float, towards: float) -> Any:
    """The same town on a plane that rises in this direction, each building level."""
    import numpy as np
    from scipy.ndimage import label

    xyz, house = cloud.xyz.copy(), cloud["classification"] == 6
    turn = np.radians(towards)
    up = (xyz[:, :2] - xyz[:, :2].mean(axis=0)) @ (np.sin(turn), np.cos(turn))
    cell = np.floor(xyz[house, :2] - xyz[:, :2].min(axis=0)).astype(int)
    grid = np.zeros(cell.max(axis=0) + 1, bool)
    grid[tuple(cell.T)] = True
    part = np.stack([label(grid, np.ones((3, 3)))[0][tuple(cell.T)], up[house] // HOUSE], axis=1)
    part = np.unique(part, axis=0, return_inverse=True)[1].ravel()
    up[house] = (np.bincount(part, up[house]) / np.bincount(part))[part]
    xyz[:, 2] += slope * up
    return cloud.with_xyz(xyz)


def ground_filters() -> dict[str, Any]:
    from toolbox import catalog

    return {id: catalog.load(id).make for id in catalog.own_ids() if id.startswith("ground.")}


def _errors(
    title: str,
    make: Any,
    clouds: dict[str, Any],
    settings: dict[str, dict[str, Any]],
    counted: dict[str, Any] | None = None,
) -> None:
    """One line of errors per cloud, and their means; of the points that count, if not of all."""
    from algorithms.compare._counts import Counts

    rows = []
    for name, (cloud, true) in clouds.items():
        found = make(points=cloud, **settings.get(name, {})).run().classified
        part = counted[name] if counted else slice(None)
        counts = Counts.of((found["classification"] == 2)[part], true[part])
        rows.append((counts.type_1, counts.type_2, counts.total_error, counts.kappa))
    means = tuple(statistics.mean(column) for column in zip(*rows, strict=True))
    for name, (type_1, type_2, total, kappa) in zip([*clouds, "mean"], [*rows, means], strict=True):
        say(
            f"filters  {title:28} {name:16} Type I {type_1:6.2f}  Type II {type_2:6.2f}  "
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
