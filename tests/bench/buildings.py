"""Buildings: points with noise in their heights, and vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tests.bench.corners import opened, outlined
from tests.bench.measuring import say

# The rule for noise was chosen on the first three.
TILES = {
    "IGN 77050_627755": "ign_urban_50m/77050_627755.laz",
    "IGN 77060_627760": "ign_urban_50m/77060_627760.laz",
    "AHN3 Delft": "ahn3_delft_bgt/ahn3_cropped_2.laz",
    "IGN 77055_627755": "ign_urban_50m/77055_627755.laz",
    "AHN3 Amsterdam": "ahn_amsterdam/ahn3_2386_9702.laz",
    "AHN4 Amsterdam": "ahn_amsterdam/ahn4_2463_9714_rgb.laz",
}
TOWN = 6  # seed
NOISES = (0.0, 0.04, 0.08, 0.12)  # metres
STREETS, DENSITIES = range(10, 15), (16.0, 8.0, 4.0, 2.0, 1.0)  # seeds; points per m2


def buildings() -> None:
    """Class 6 with noise; vehicles in class 6."""
    for name, cloud in _clouds():
        found = [f"{100 * noise:.0f} cm {_with_noise(cloud, noise)}" for noise in NOISES]
        say(f"buildings  {name:17} IoU with noise of {', '.join(found)}")
    for density in DENSITIES:
        rows = [_street(seed, density) for seed in STREETS]
        vehicles, plants, iou = zip(*rows, strict=True)
        say(
            f"buildings  streets, {density:2.0f} points per m2: vehicles in class 6, mean "
            f"{100 * sum(vehicles) / len(rows):.1f} %, worst {100 * max(vehicles):.1f} %; as "
            f"vegetation {100 * sum(plants) / len(rows):.1f} %; IoU, worst {min(iou):.3f}"
        )


def _clouds() -> Iterator[tuple[str, Any]]:
    """Points whose classes are known."""
    from algorithms.samples.scene import SamplesScene

    for name, path in TILES.items():
        yield name, opened(path)
    yield f"town {TOWN}", SamplesScene(kind="town", size=200.0, density=8.0, seed=TOWN).run().points


def _with_noise(cloud: Any, noise: float) -> str:
    """IoU of class 6 with noise added to the heights."""
    import numpy as np

    up = np.random.default_rng(7).normal(0.0, noise, len(cloud))
    shaken = cloud.with_xyz(cloud.xyz + up[:, None] * (0, 0, 1))
    own = outlined(shaken).classified["classification"] == 6
    true = cloud["classification"] == 6
    return f"{(own & true).sum() / (own | true).sum():.3f}"


def _street(seed: int, density: float) -> tuple[float, float, float]:
    """Vehicles among class 6, vehicles that became vegetation, IoU of buildings."""
    import numpy as np

    from tests.scenes.traffic import confusion, street
    from toolbox import run

    made = street(seed, density)
    bare = made.with_attributes({"classification": np.zeros(len(made), np.uint8)})
    found = run("models.urban_classes", {"points": bare, "water": False})["classified"]
    shares = confusion(found["classification"], made["truth"])
    return shares["of buildings"], shares["plant"], shares["iou"]
