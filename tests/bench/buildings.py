"""Buildings: points with noise in their heights, vehicles, and corners of outlines beside maps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from tests.bench.measuring import DATA, say

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
WALL = 1.0  # metres, length of walls on both sides of a corner that is looked at
NEAR = 2.0  # metres, within which a corner of the map is the same one
MOST, STEP = 1.5, 0.05  # metres, that a map may be off, and in which steps this is looked for


def buildings() -> None:
    """Class 6 with noise; vehicles in class 6; corners of outlines and those of maps."""
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
    for place in _places():
        _say_corners(place)


def _open(path: str) -> Any:
    from pyproj import CRS

    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / path)
    return cloud if cloud.crs else cloud.with_crs(CRS(28992))


def _clouds() -> Iterator[tuple[str, Any]]:
    """Points whose classes are known."""
    from algorithms.samples.scene import SamplesScene

    for name, path in TILES.items():
        yield name, _open(path)
    yield f"town {TOWN}", SamplesScene(kind="town", size=200.0, density=8.0, seed=TOWN).run().points


def _outlined(points: Any, **settings: Any) -> Any:
    """Ground, then buildings, of points whose classes nobody knows."""
    import numpy as np

    from algorithms.classify.buildings import ClassifyBuildings
    from algorithms.ground.classify import GroundClassify

    bare = points.with_attributes({"classification": np.zeros(len(points), np.uint8)})
    return ClassifyBuildings(points=GroundClassify(points=bare).run().classified, **settings).run()


def _with_noise(cloud: Any, noise: float) -> str:
    """IoU of class 6 with noise added to the heights."""
    import numpy as np

    up = np.random.default_rng(7).normal(0.0, noise, len(cloud))
    shaken = cloud.with_xyz(cloud.xyz + up[:, None] * (0, 0, 1))
    own = _outlined(shaken).classified["classification"] == 6
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


class Place(NamedTuple):
    """Points, and polygons of buildings, all of them within an area."""

    name: str
    points: Any
    shapes: Any
    area: Any


def _places() -> Iterator[Place]:
    """Towns, whose truth are roofs, and surveys with maps of walls."""
    import shapely

    from algorithms.samples.scene import SamplesScene
    from toolbox.data import Vector

    for seed in (5, 6):
        made = SamplesScene(kind="town", size=200.0, density=8.0, seed=seed).run()
        frame = made.features.frame
        shapes = shapely.force_2d(frame[frame.kind == "building"].geometry.to_numpy())
        yield Place(f"town {seed}", made.points, shapes, _box(made.points))
    folder = DATA / "ahn3_delft_bgt"
    plan, area = (
        Vector.open(folder / "bgt_east_cropped_2.gpkg", layer=layer).frame.geometry.to_numpy()
        for layer in ("pand", "coverage")
    )
    delft = _open("ahn3_delft_bgt/ahn3_cropped_2.laz")
    yield Place("BGT, Delft", delft, plan, shapely.union_all(area) & _box(delft))
    folder = DATA / "ign_buildings_bdtopo"
    rural = _open("ign_buildings_bdtopo/870000_6618000_class_1_2_6.laz")
    plan = Vector.open(folder / "bdtopo_buildings.shp").frame.geometry.to_numpy()
    yield Place("BD TOPO, rural", rural, shapely.force_2d(plan), _box(rural))


def _box(points: Any) -> Any:
    import shapely

    x0, y0, _, x1, y1, _ = points.bounds
    return shapely.box(x0, y0, x1, y1)


def _say_corners(place: Place) -> None:
    """Print how far outlines are from a map that was shifted to where it fits best."""
    import numpy as np
    import shapely

    drawn = _outlined(place.points).outlines.frame.geometry.to_numpy()
    inside = place.area.buffer(-NEAR)  # what the edge of the data cuts has corners of its own
    plan = shapely.union_all(shapely.make_valid(place.shapes)) & place.area
    own = shapely.union_all(drawn) & place.area
    shift = _shift(own, plan, MOST)
    moved = shapely.transform(plan, lambda xy: xy + shift)
    iou = own.intersection(moved).area / own.union(moved).area
    away, walls = _distances(own, moved, inside)
    houses = _house_by_house(own, place, inside)
    say(
        f"buildings  {place.name:14} IoU {iou:.3f}, map off by {np.hypot(*shift):.2f} m; corners "
        f"{_rms(away)}, from the walls {_rms(walls)}; each house shifted by itself: {_rms(houses)}"
    )


def _rms(away: Any) -> str:
    import numpy as np

    if not len(away):
        return "none"
    return f"{np.sqrt(np.mean(away**2)):.2f} m RMS, {np.median(away):.2f} m median of {len(away)}"


def _shift(own: Any, plan: Any, most: float) -> Any:
    """East and north by which a plan is moved so that most of it lies on the outlines."""
    import numpy as np
    import shapely

    best = np.zeros(2)
    for step in (0.5, 0.1, STEP):
        reach = most if step == 0.5 else 5 * step
        steps = np.arange(-reach, reach + step / 2, step)
        tries = best + np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
        tries = tries[np.abs(tries).max(axis=1) <= most]
        shared = [
            shapely.intersection(own, shapely.transform(plan, lambda xy, t=t: xy + t)).area  # type: ignore[misc]
            for t in tries
        ]
        best = tries[int(np.argmax(shared))]
    return best


def _corners(shape: Any) -> Any:
    """Corners between walls that are long enough, array of shape (n, 2)."""
    import numpy as np
    import shapely

    found = []
    for part in shapely.get_parts(shape):
        for ring in shapely.get_rings(part):
            xy = shapely.get_coordinates(shapely.simplify(ring, 0.01))[:-1]
            length = np.hypot(*(xy - np.roll(xy, 1, axis=0)).T)
            found.append(xy[(length > WALL) & (np.roll(length, -1) > WALL)])
    return np.concatenate(found) if found else np.zeros((0, 2))


def _distances(own: Any, plan: Any, inside: Any) -> tuple[Any, Any]:
    """Of corners of outlines to the nearest of the plan, if one is near, and to its walls."""
    import numpy as np
    import shapely
    from scipy.spatial import cKDTree

    corners, others = _corners(own), _corners(plan)
    corners = corners[shapely.contains_xy(inside, *corners.T)]
    if not len(corners) or not len(others):
        return np.zeros(0), np.zeros(0)
    away = cKDTree(others).query(corners)[0]
    near = away <= NEAR
    walls = shapely.distance(shapely.points(corners[near]), plan.boundary)
    return away[near], walls


def _house_by_house(own: Any, place: Place, inside: Any) -> Any:
    """Distances of corners where each house of the map is shifted by itself."""
    import numpy as np
    import shapely

    found = [np.zeros(0)]
    for house in shapely.get_parts(shapely.union_all(shapely.make_valid(place.shapes))):
        if not house.intersects(inside):
            continue
        beside = own & house.buffer(NEAR)
        if beside.area < house.area / 2:
            continue
        shift = _shift(beside, house, MOST)
        moved = shapely.transform(house, lambda xy, s=shift: xy + s)  # type: ignore[misc]
        found.append(_distances(own & moved.buffer(NEAR), moved, inside)[0])
    return np.concatenate(found)
