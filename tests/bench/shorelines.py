"""Water bodies of synthetic reservoirs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

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
