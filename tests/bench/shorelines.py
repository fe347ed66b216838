"""Water bodies of synthetic reservoirs, and of scenes of many kinds."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from tests.bench.measuring import say

if TYPE_CHECKING:
    from algorithms.samples._survey import SceneData
    from toolbox.data import PointCloud


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

    from algorithms.samples.scene import scene
    from algorithms.shoreline.extract import ShorelineExtract

    made = scene("reservoir", size=size, density=density, seed=seed)
    points = _cloud(made)
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


def waters(*options: str) -> None:
    """Scenes of every kind of water and of dry land: found, invented, levels.

    The option `--seeds FIRST LAST` tells which; the method was chosen on 0 to 9.
    """
    from tests.scenes.waters import DRY, KINDS

    reader = argparse.ArgumentParser("waters")
    reader.add_argument("--seeds", type=int, nargs=2, default=(100, 101))
    first, last = reader.parse_args(options).seeds
    rows: list[_Found] = []
    for kind in KINDS:
        for seed in range(first, last + 1):
            rows.append(_waters(kind, seed))
            say(f"waters  {kind:12} {seed} {rows[-1].text()}")
    wet = [row for row in rows if row.kind not in {make.__name__ for make in DRY}]
    level = [row for row in wet if row.kind == "ice"]
    for name, some in (
        ("water", [row for row in wet if row not in level]),
        ("ice, which is left out and told", level),
        ("dry", [row for row in rows if row not in wet]),
    ):
        say(f"waters  {name}: {_summed(some)}")


class _Found(NamedTuple):
    """What was found in a scene.

    Attributes
    ----------
    iou : of each true body, 0 where it is lost
    off, interval : error of each level found and half of its 95 % interval, m
    area_off, area_error : error of each area found and its standard deviation, m2
    invented : areas of bodies that are none, m2
    overlap : largest area that two bodies share, m2
    """

    kind: str
    iou: list[float]
    off: list[float]
    interval: list[float]
    area_off: list[float]
    area_error: list[float]
    invented: list[float]
    overlap: float

    def text(self) -> str:
        """The scene in one line."""
        level = [f"{v:+.3f}+-{w:.3f}" for v, w in zip(self.off, self.interval, strict=True)]
        return (
            f"IoU {' '.join(f'{v:.3f}' for v in self.iou) or '-'}  level {' '.join(level)}"
            f"  invented {' '.join(f'{v:.0f}' for v in self.invented) or '-'}"
            f"  overlap {self.overlap:.2f}"
        )


def _summed(rows: list[_Found]) -> str:
    import numpy as np

    iou = np.array([v for row in rows for v in row.iou])
    off = np.array([v for row in rows for v in row.off])
    interval = np.array([v for row in rows for v in row.interval])
    invented = [v for row in rows for v in row.invented]
    of_area = [pair for row in rows for pair in zip(row.area_off, row.area_error, strict=True)]
    here = iou[iou > 0.5]
    text = f"{len(rows)} scenes, {len(here)} of {len(iou)} bodies found"
    if len(here):
        text += (
            f", IoU mean {here.mean():.3f}, worst {here.min():.3f}, below 0.9 {(here < 0.9).sum()}"
            f"; {(abs(off) <= interval).sum()} of {len(off)} intervals of levels and "
            f"{sum(abs(a) <= 1.96 * e for a, e in of_area)} of areas hold"
        )
    overlap = max((row.overlap for row in rows), default=0.0)
    return f"{text}; {len(invented)} invented, of {sum(invented):.0f} m2; overlap {overlap:.2f} m2"


def _waters(kind: str, seed: int) -> _Found:
    import numpy as np
    import shapely

    from algorithms.shoreline.extract import ShorelineExtract
    from tests.scenes.waters import ORIGIN, survey

    made = survey(kind, seed)
    water = ShorelineExtract(points=made.points, bodies="all", sloped=True).run().water.frame
    shapes = shapely.force_2d(water.geometry.to_numpy()) if len(water) else np.zeros(0, object)
    true = [pair for pair in zip(made.outlines, made.waters, strict=True) if pair[0].area >= 100]
    iou, off, interval, area_off, area_error = [], [], [], [], []
    for outline, known in true:
        shared = shapely.area(shapely.intersection(shapes, outline))
        best = int(np.argmax(shared)) if len(shapes) else -1
        iou.append(float(shared[best] / shapes[best].union(outline).area) if best >= 0 else 0.0)
        if iou[-1] > 0.5:
            corners = shapely.get_coordinates(water.geometry.iloc[best], include_z=True)
            truth = known.level + np.mean(made.land.strips)
            truth -= known.fall * float(np.mean(corners[:, 0] - ORIGIN[0]))
            off.append(float(corners[:, 2].mean() - truth))
            interval.append(float(water.level_interval.iloc[best]))
            area_off.append(float(water.area.iloc[best] - outline.area))
            area_error.append(float(water.area_error.iloc[best]))
    all_water = shapely.union_all([outline.buffer(3) for outline, _ in true])
    dry = [s.area for s in shapes if s.intersection(all_water).area < s.area / 2]
    pairs = ((a, b) for k, a in enumerate(shapes) for b in shapes[:k])
    overlap = max((a.intersection(b).area for a, b in pairs), default=0.0)
    invented = [a for a in dry if a >= 100]
    return _Found(kind, iou, off, interval, area_off, area_error, invented, overlap)


def water_levels() -> None:
    """Levels of 300 synthetic reservoirs and their ponds, and how often their intervals hold."""
    say("water_levels  noise  points/m2 | " + _HEADING)
    for noise in (0.01, 0.02, 0.05, 0.08, 0.12, 0.15):
        for density in (0.5, 2.0, 8.0, 20.0):
            say(f"water_levels  {noise:.2f} m {density:9g} | {_levels(noise, density, 300)}")


_HEADING = "lost none | by water: bodies    bias     RMS   error held | by shore: bodies ..."


def _levels(noise: float, density: float, scenes: int) -> str:
    """Bodies lost and invented; errors of the levels, and the share that the intervals hold."""
    import shapely

    from algorithms.samples.scene import scene
    from algorithms.shoreline.water_level import ShorelineWaterLevel

    off: dict[str, list[tuple[float, float, float]]] = {"water": [], "shore": []}
    lost, invented = 0, 0
    for seed in range(2000, 2000 + scenes):
        size = (100.0, 150.0, 200.0, 100.0)[seed % 4]
        made = scene("reservoir", size=size, density=density, seed=seed, water_noise=noise)
        true = [(shapely.force_2d(shape).buffer(3), known) for shape, known in made.features]
        seen = set()
        for row in ShorelineWaterLevel(points=_cloud(made)).run().levels.rows():
            place = shapely.Point(row["x"], row["y"])
            here = [known for shape, known in true if shape.contains(place)]
            if not here:
                invented += 1
                continue
            seen.add(here[0]["object_id"])
            error = row["level"] - here[0]["level"]
            off[row["basis"]].append((error, row["standard_error"], row["interval"]))
        large = {known["object_id"] for _, known in made.features if known["area"] >= 100}
        lost += len(large - seen)
    return f"{lost:4d} {invented:4d} | {_held(off['water'])} | {_held(off['shore'])}"


def _held(rows: list[tuple[float, float, float]]) -> str:
    """Number, bias, RMS error, mean standard error, and the share that the intervals hold."""
    import numpy as np

    if not rows:
        return "   0"
    off, error, interval = np.array(rows).T
    return (
        f"{len(rows):4d} {off.mean():+.4f} {np.sqrt((off**2).mean()):.4f} "
        f"{np.sqrt((error**2).mean()):.4f} {(abs(off) <= interval).mean():.3f}"
    )


def _cloud(made: SceneData) -> PointCloud:
    from pyproj import CRS

    from toolbox.data import PointCloud

    return PointCloud(made.xyz, made.attributes, crs=CRS(32635))
