"""Water bodies of synthetic reservoirs."""

from __future__ import annotations

from collections.abc import Iterator

from tests.bench.measuring import say


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
