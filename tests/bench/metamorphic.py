"""Every cloud, changed in a way whose consequence is known, through every tool that suits it.

A tool ends with a result or a clear error, whatever the change; it keeps the points that it says it
keeps; and where the change means nothing, the result stays the same, within stated limits.

References
----------
Chen, T. Y. et al. (2018). Metamorphic testing: a review of challenges and opportunities. ACM
Computing Surveys 51(1), 4.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import logging
import resource
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPoint, Point

import toolbox
from tests.bench.measuring import DATA, say
from toolbox import catalog
from toolbox.context import Context
from toolbox.data import Lattice, PointCloud, Raster, Vector
from toolbox.data.crs import LOCALS
from toolbox.errors import Cancelled, DataError, ParameterError, ToolboxError

MOST, MOST_CI = 30_000, 8_000  # points of a cloud: a thousand runs in an hour, a hundred in minutes
MEMORY = 12 * 2**30  # bytes that a run may ask for, before it ends in an error
LEAST = 500  # points in a disc
SLOWEST = 300.0  # seconds; none of these clouds is worth more
ENDINGS = (".las", ".laz", ".txt.gz", ".csv.gz", ".ply", ".ply.gz", ".pcd")
UNIT = {"facade_pcl_cornice": "local:mm"}  # of coordinates, where it is no metre
FOOT = 0.3048  # metres

Rng = np.random.Generator


# Clouds -------------------------------------------------------------------------------------------

THEMES = {"line": ("line", "powerline"), "water": ("water",), "front": ("facade", "tls")}
SCENES: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "scene-town": ("land", {"kind": "town", "size": 70.0, "density": 4.0}),
    "scene-corridor": ("line", {"kind": "corridor", "size": 400.0, "density": 6.0}),
    "scene-power-lines": ("line", {"kind": "power_lines", "size": 300.0, "density": 8.0}),
    "scene-reservoir": ("water", {"kind": "reservoir", "size": 150.0, "density": 1.5}),
    "scene-facade": ("front", {"kind": "facade", "size": 20.0, "density": 60.0}),
}


def subjects(*, ci: bool) -> dict[str, str]:
    """The theme of each cloud: scenes, and all that the folder of data has."""
    found = {name: theme for name, (theme, _) in SCENES.items()}
    for path in sorted(DATA.rglob("*")) if DATA.is_dir() else ():
        folder = path.parent.name
        small = path.is_file() and (not ci or path.stat().st_size < 2_000_000)
        if path.name.lower().endswith(ENDINGS) and folder != "robustness" and small:
            themes = (t for t, starts in THEMES.items() if folder.startswith(starts))
            found[f"{folder}/{path.name}"] = next(themes, "land")
    return found


@functools.lru_cache(maxsize=4)
def loaded(name: str, seed: int, most: int) -> PointCloud:
    """A scene, or the points of a file: a part of either."""
    rng = rng_of(name, seed)
    if name in SCENES:
        _, values = SCENES[name]
        points: PointCloud = toolbox.run("samples.scene", {**values, "seed": seed})["points"]
    else:
        unit = UNIT.get(Path(name).parent.name, "local")
        points = PointCloud.open(DATA / name, assume_crs=LOCALS[unit])
    return points.select(disc_of(points, rng, most))


def disc_of(points: PointCloud, rng: Rng, most: int) -> NDArray[np.int64]:
    """So many points at most, in a disc within the box of all; a disc keeps its box when it turns.

    Where the box is mostly empty, as around a line, those that are nearest to the middle.
    """
    low, high = np.reshape(points.bounds, (2, 3))[:, :2]
    middle = low + rng.uniform(0.25, 0.75, 2) * (high - low)
    away = np.hypot(*(points.xyz[:, :2] - middle).T)
    inside = int(np.count_nonzero(away < np.min([middle - low, high - middle])))
    wanted = min(inside if inside >= LEAST else len(points), most)
    return np.sort(np.argpartition(away, wanted - 1)[:wanted])


def rng_of(name: str, seed: int) -> Rng:
    return np.random.default_rng([zlib.crc32(name.encode()), seed])


# Transformations ----------------------------------------------------------------------------------


def cropped(points: PointCloud, rng: Rng) -> PointCloud:
    """A quarter of the square around a point."""
    away = np.abs(points.xyz[:, :2] - points.xyz[rng.integers(len(points)), :2]).max(axis=1)
    return points.select(away < np.ptp(points.xyz[:, :2], axis=0).max() / 4)


def turned(points: PointCloud, rng: Rng) -> PointCloud:
    """About the vertical through the middle."""
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    xyz = np.array(points.xyz)
    middle = np.rint(xyz[:, :2].mean(axis=0))
    xyz[:, :2] = (xyz[:, :2] - middle) @ turn + middle
    return points.with_xyz(xyz)


def shifted(points: PointCloud, rng: Rng) -> PointCloud:
    """By whole multiples of any usual cell, up to 60 m."""
    return points.with_xyz(points.xyz + np.array([10_800.0, -21_600.0, 60.0]) * points.metre)


def thinned(points: PointCloud, rng: Rng) -> PointCloud:
    """To half a point per square metre of the box."""
    wide = np.ptp(points.xyz[:, :2], axis=0) / points.metre
    share = min(1.0, 0.5 * float(wide.prod()) / len(points))
    return points.select(rng.random(len(points)) < share)


def doubled(points: PointCloud, rng: Rng) -> PointCloud:
    """Every point twice, as where a file was merged with itself."""
    return points.select(np.tile(np.arange(len(points)), 2))


def of_last_returns(points: PointCloud, rng: Rng) -> PointCloud:
    """Without the returns before; a third of the points where none are told."""
    if "return_number" in points:
        return points.select(points["return_number"] == points["number_of_returns"])
    return points.select(rng.random(len(points)) > 1 / 3)


def shuffled(points: PointCloud, rng: Rng) -> PointCloud:
    return points.select(rng.permutation(len(points)))


def in_feet(points: PointCloud, rng: Rng) -> PointCloud:
    scaled = points.xyz / points.metre / FOOT
    return points.with_xyz(scaled).with_crs(LOCALS["local:ft"])


def of_mixed_density(points: PointCloud, rng: Rng) -> PointCloud:
    """Thinned to an eighth on one side."""
    east = points.xyz[:, 0] > np.median(points.xyz[:, 0])
    return points.select(east | (rng.random(len(points)) < 1 / 8))


def with_far_points(points: PointCloud, rng: Rng) -> PointCloud:
    """With one at 3 km and one at 300 km, as errors of ranges and of positions make them."""
    xyz = np.array(points.xyz)
    for at, far in zip(rng.choice(len(xyz), 2, replace=False), (3e3, 3e5), strict=True):
        xyz[at] += np.array([far, -far / 3, far / 30]) * points.metre
    return points.with_xyz(xyz)


Transformation = Callable[[PointCloud, Rng], PointCloud]
TRANSFORMATIONS: Mapping[str, Transformation] = {
    made.__name__.replace("_", "-"): made
    for made in (
        cropped,
        turned,
        shifted,
        thinned,
        doubled,
        of_last_returns,
        shuffled,
        in_feet,
        of_mixed_density,
        with_far_points,
    )
}


# Tools --------------------------------------------------------------------------------------------

Step = tuple[str, str, Mapping[str, Any]]
"""Id of a tool, the output that the next one reads, and values."""


@dataclass(frozen=True)
class Case:
    """A tool with the steps before it, and what it promises.

    Attributes
    ----------
    themes : of the clouds that it suits; none for all
    before : steps that make its input of the points
    keeps : output that holds all points, in their order
    source : input that the points, or the result of the last step before, go to
    others : further inputs, made of the points
    """

    id: str
    values: Mapping[str, Any] = field(default_factory=dict)
    themes: tuple[str, ...] = ()
    before: tuple[Step, ...] = ()
    keeps: str | None = None
    source: str = "points"
    others: Callable[[PointCloud], Mapping[str, Any]] = lambda points: {}
    label: str = ""

    @property
    def name(self) -> str:
        return self.label or self.id

    def steps(self) -> tuple[Step, ...]:
        return (*self.before, (self.id, "", self.values))


def disc(points: PointCloud) -> Mapping[str, Any]:
    """A polygon around the middle of the points."""
    import geopandas

    xy = np.sort(points.xyz[:, :2], axis=0) if len(points) else np.zeros((1, 2))
    radius = 0.3 * float(np.hypot(*np.ptp(xy, axis=0)))
    shape = Point(xy.mean(axis=0)).buffer(radius or 1.0, quad_segs=64)
    return {"polygons": Vector(geopandas.GeoDataFrame(geometry=[shape], crs=points.crs))}


LAND, OUTSIDE = ("land",), ("land", "line", "water")
GROUND: Step = ("ground.classify", "classified", {})
TALL: Step = ("ground.classify", "classified", {"heights": True})
HOUSES: Step = ("classify.buildings", "classified", {})
TOWN: Step = ("classify.urban", "classified", {})
GRID: Step = ("surface.grid", "surface", {"cell": 1.0, "max_gap": 5.0})
CASES: tuple[Case, ...] = (
    Case("points.info"),
    Case("points.filter", {"where": "intensity > 40 or return_number == 1"}),
    Case("points.filter_intensity", themes=OUTSIDE),
    Case("points.thin", {"cell": 1.0}),
    Case("points.thin", {"method": "duplicates"}, label="points.thin-duplicates"),
    Case("points.clip", others=disc),
    Case("points.cluster", {"classes": "5"}, themes=LAND, before=(GROUND, HOUSES, TOWN)),
    Case("points.denoise", {"action": "label"}, keeps="clean"),
    Case("points.height_above_ground", themes=OUTSIDE, before=(GROUND,), keeps="heights"),
    Case("features.local", keeps="described"),
    Case("ground.classify", themes=OUTSIDE, keeps="classified"),
    Case("ground.csf", themes=OUTSIDE, keeps="classified"),
    Case("ground.ptd", themes=OUTSIDE, keeps="classified"),
    Case("ground.robust_interpolation", themes=OUTSIDE, keeps="classified"),
    *(
        Case("surface.grid", {"cell": 1.0, "method": method}, OUTSIDE, label=f"grid-{method}")
        for method in ("linear", "natural", "cubic", "idw", "nearest", "mean", "percentile")
    ),
    Case("surface.cross_validation", {"folds": 3}, OUTSIDE, before=(GROUND,)),
    Case("surface.hillshade", {}, OUTSIDE, before=(GRID,), source="surface"),
    Case("surface.contours", {"interval": 1.0}, OUTSIDE, before=(GRID,), source="surface"),
    Case(
        "compare.classes",
        {"positive": "2"},
        OUTSIDE,
        before=(GROUND,),
        others=lambda points: {"reference": points},
    ),
    Case("classify.som", themes=LAND, keeps="classified"),
    Case("classify.buildings", themes=LAND, before=(GROUND,), keeps="classified"),
    Case("classify.urban", themes=LAND, before=(GROUND, HOUSES), keeps="classified"),
    Case("classify.trees", themes=LAND, before=(GROUND, HOUSES, TOWN)),
    Case(
        "classify.vegetation_by_returns", themes=LAND, before=(GROUND, HOUSES), keeps="classified"
    ),
    Case("planes.fit", {"tolerance": 0.05}, ("front",)),
    Case("planes.extract", themes=("front",), keeps="segmented"),
    Case("planes.sweep", themes=("front",)),
    Case("shoreline.extract", themes=("water",)),
    Case("shoreline.water_level", themes=("water",)),
    Case("shoreline.alpha_shape", themes=OUTSIDE),
    Case("corridor.extract", themes=("line",), keeps="classified"),
    Case("corridor.extract_voxels", themes=("line",)),
    Case("corridor.candidates", themes=("line",), before=(TALL,)),
    Case("corridor.catenaries", themes=("line",), before=(("corridor.extract", "classified", {}),)),
    Case("models.terrain", {"max_gap": 10.0}, OUTSIDE),
    Case("models.urban_classes", themes=LAND, keeps="classified"),
    Case("models.reservoir_shoreline", themes=("water",)),
    Case("models.power_line_clearance", themes=("line",), keeps="classified"),
)


# Promises -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Promise:
    """How far a result may move under a transformation that means nothing.

    Attributes
    ----------
    points : share of the points whose class or whose being on a plane may change
    ratio : of the change of a length, area or count to the greater one; of a share, its change
    counted : by how many of its square roots a count may change beside, as what is drawn anew does
    why : the reason for these limits
    """

    points: float
    ratio: float
    why: str
    counted: float = 0.0


PROMISES: Mapping[str, Promise] = {
    "shuffled": Promise(0.0, 1e-6, "the order of points says nothing; sums are rounded"),
    "shifted": Promise(0.002, 0.01, "coordinates far from the origin are rounded by 2e-9 m"),
    "in-feet": Promise(0.002, 0.01, "lengths in feet are rounded elsewhere"),
    "turned": Promise(0.10, 0.10, "cells and seeds lie elsewhere", counted=2.0),
}
"""Of all tools that are not among the EXCEPTIONS; other transformations promise nothing."""

EXCEPTIONS: Mapping[tuple[str, str], Promise | None] = {
    ("classify.som", "in-feet"): Promise(
        0.01, 0.03, "heights above other ground, of a point or two, lead to another map"
    ),
    # Cells of the ground lie on the grid of the map. Where there is one tree, which then falls into
    # three (ISPRS sample 23), no share of the count can be promised.
    ("classify.trees", "shifted"): None,
    ("surface.contours", "turned"): Promise(
        0.0, 0.25, "lines end at the gaps of a grid whose cells lie elsewhere", counted=2.0
    ),
}
"""By name of the case and transformation; None for no promise."""


def promise_of(case: Case, transformation: str) -> Promise | None:
    usual = PROMISES.get(transformation)
    return EXCEPTIONS.get((case.name, transformation), usual)


# Runs ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """One case on one cloud, changed in one way."""

    case: Case
    subject: str
    transformation: str
    seed: int
    most: int

    @property
    def name(self) -> str:
        return f"{self.case.name}:{self.subject}:{self.transformation}"

    def points(self) -> PointCloud:
        points = loaded(self.subject, self.seed, self.most)
        rng = rng_of(self.transformation + self.subject, self.seed)
        return TRANSFORMATIONS[self.transformation](points, rng)


def planned(runs: int | None, seed: int, *, ci: bool) -> list[Run]:
    """So many of all runs, in an order that the seed decides; all of them with None."""
    most = MOST_CI if ci else MOST
    every = [
        Run(case, subject, transformation, seed, most)
        for case, (subject, theme), transformation in itertools.product(
            CASES, subjects(ci=ci).items(), TRANSFORMATIONS
        )
        if not case.themes or theme in case.themes
    ]
    order = rng_of("order", seed).permutation(len(every))[:runs]
    # those of one cloud follow each other, so that it is read once
    return sorted((every[k] for k in order), key=lambda run: (run.subject, run.case.name))


def done(case: Case, points: PointCloud) -> Mapping[str, Any]:
    """The results of the tool on points; raises what it raises."""
    end = time.monotonic() + SLOWEST
    ctx = Context(stop=lambda: time.monotonic() > end)
    layer: Any = points
    found: Mapping[str, Any] = {}
    for id, output, values in case.steps():
        is_last = not output
        source = case.source if is_last else "points"
        others = case.others(points) if is_last else {}
        found = toolbox.run(id, {source: layer, **others, **values}, ctx=ctx)
        layer = found.get(output)
    return found


@functools.lru_cache(maxsize=64)
def before(case_name: str, subject: str, seed: int, most: int) -> Mapping[str, Any] | str:
    """The results on the cloud as it is, or the error."""
    case = next(case for case in CASES if case.name == case_name)
    try:
        return done(case, loaded(subject, seed, most))
    except ToolboxError as error:
        return str(error)


def outcome(run: Run) -> tuple[bool, list[str]]:
    """Whether a run gives a result, and what is wrong."""
    points = run.points()
    try:
        found = done(run.case, points)
    except Cancelled:
        return False, [f"does not end within {SLOWEST:g} s"]
    except (ParameterError, DataError) as error:
        return False, list(_refused(run, error))
    except Exception as error:  # noqa: BLE001  that is what is looked for
        return False, [f"a mistake in the toolbox: {type(error).__name__}: {error}"]
    return True, list(_wrong(run, found, points))


def _wrong(run: Run, found: Mapping[str, Any], points: PointCloud) -> Iterator[str]:
    """What is wrong with a result."""
    keeps = run.case.keeps
    if keeps and len(found[keeps]) != len(points):
        yield f"{len(points)} points became {len(found[keeps])}"
        return
    promise = promise_of(run.case, run.transformation)
    if promise:
        yield from _moved(run, found, points, promise)


def _refused(run: Run, error: ToolboxError) -> Iterator[str]:
    """An error is an outcome, but not where the cloud as it is gave a result."""
    if promise_of(run.case, run.transformation):
        was = before(run.case.name, run.subject, run.seed, run.most)
        if not isinstance(was, str):
            yield f"only now an error: {' '.join(str(error).split())}"


def _moved(
    run: Run, found: Mapping[str, Any], points: PointCloud, promise: Promise
) -> Iterator[str]:
    """Results that differ by more than promised from those on the cloud as it is."""
    was = before(run.case.name, run.subject, run.seed, run.most)
    if isinstance(was, str):
        yield f"an error only without the change: {' '.join(was.split())}"
        return
    old = loaded(run.subject, run.seed, run.most)
    order = np.arange(len(old))
    if run.transformation == "shuffled":
        rng = rng_of(run.transformation + run.subject, run.seed)
        order = rng.permutation(len(old))
    keeps = run.case.keeps
    if keeps:
        for name in ("classification", "plane_id"):
            if name in found[keeps] and name in was[keeps]:
                one, two = (_labels(c[name], name) for c in (was[keeps], found[keeps]))
                share = float(np.mean(one[order] != two))
                if share > promise.points:
                    yield f"{name} of {share:.3%} of points changed (limit {promise.points:.1%})"
    wholes = {n: WHOLES.get(out.unit, 0.0) for n, out in catalog.load(run.case.id).outputs.items()}
    here, there = dict(measures(found, points)), dict(measures(was, old))
    for name in sorted(here.keys() | there.keys()):
        one, two = there.get(name, np.nan), here.get(name, np.nan)
        size = max(abs(one), abs(two), wholes.get(name, 0.0))
        limit = promise.ratio * size + promise.counted * np.sqrt(size if one.is_integer() else 0)
        same = one == two or (np.isnan(one) and np.isnan(two))
        if not (same or abs(two - one) <= limit):
            yield f"{name} was {one:.6g}, is {two:.6g} (may move by {limit:.3g})"


def _labels(values: NDArray[Any], name: str) -> NDArray[Any]:
    """Classes as they are; of planes, whose numbers mean nothing, whether a point is on one."""
    return values if name == "classification" else values > 0


def measures(found: Mapping[str, Any], points: PointCloud) -> Iterator[tuple[str, float]]:
    """Sizes of the results that do not depend on where the points are, in metres.

    Of a raster, what lies between the points: a surface that fills their box turns with that.
    """
    metre = points.metre
    for name, value in found.items():
        if isinstance(value, PointCloud):
            yield f"{name}, points", float(len(value))
        elif isinstance(value, Vector):
            shapes = value.frame.geometry
            yield f"{name}, length in m", float(shapes.length.sum()) / metre
            yield f"{name}, area in m2", float(shapes.area.sum()) / metre**2
        elif isinstance(value, Raster) and value.crs is not None:  # not the map of a SOM
            known = np.isfinite(value.band()) & between(points, value)
            yield f"{name}, area in m2", float(known.sum()) * (value.cell / metre) ** 2
        elif isinstance(value, int | float) and not name.startswith(PLACED):
            yield name, float(value)


def between(points: PointCloud, raster: Raster) -> NDArray[np.bool_]:
    """True for cells in the convex hull of the points, array of shape (rows, cols)."""
    hull = shapely.convex_hull(MultiPoint(points.xyz[:, :2]))
    x, y = Lattice.of(raster).centres()
    return np.asarray(shapely.contains_xy(hull, *np.meshgrid(x, y)))


WHOLES = {"1": 1.0, "%": 100.0}
"""What shares are of, by their unit."""
PLACED = ("level", "height", "offset", "azimuth", "normal", "trials", "lowest")
"""Beginnings of the names of numbers that go with the place of the points, or with the draws."""


def failures(runs: Sequence[Run], *, loud: bool = False) -> list[tuple[Run, str]]:
    """The runs that fail, with what is wrong."""
    found: list[tuple[Run, str]] = []
    results = 0
    for number, run in enumerate(runs, start=1):
        start = time.perf_counter()
        has_result, texts = outcome(run)
        results += has_result
        found += [(run, text) for text in texts]
        if loud:
            seconds = time.perf_counter() - start
            ended = "; ".join(texts)[:300] or ("result" if has_result else "error")
            say(f"metamorphic {number:4} {seconds:6.1f} s  {run.name}  {ended}")
    if loud:
        say(f"metamorphic {results} results, {len(runs) - results} errors")
    return found


def metamorphic(*options: str) -> None:
    """Runs that fail, with the command that repeats each.

    Options: --runs N (1000), --seed S (0), --ci (small clouds), --only CASE:CLOUD:TRANSFORMATION
    """
    parser = argparse.ArgumentParser("metamorphic", allow_abbrev=False)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--ci", action="store_true")
    parser.add_argument("--only", default="")
    given = parser.parse_args(options)
    logging.getLogger("toolbox").setLevel(logging.CRITICAL)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    runs = planned(None if given.only else given.runs, given.seed, ci=given.ci)
    runs = [run for run in runs if given.only in ("", run.name)]
    found = failures(runs, loud=True)
    how = f"--seed {given.seed}{' --ci' if given.ci else ''}"
    for run, text in found:
        say(f"metamorphic {text}\n    python -m tests.bench metamorphic {how} --only {run.name}")
    say(f"metamorphic {len({run.name for run, _ in found})} of {len(runs)} runs fail")
    if missing := [id for id in catalog.own_ids() if id not in {case.id for case in CASES}]:
        say(f"metamorphic has no case of {', '.join(missing)}")
