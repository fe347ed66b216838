"""Makes the picture and prints the figures of docs/explanation/urban-classes.md.

python docs/make_urban.py picture     # docs/images/urban-classes.png, of a synthetic town
python docs/make_urban.py figures     # tables, of towns and the real surveys in TOOLBOX_TEST_DATA
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pyproj import CRS
from scipy.spatial import cKDTree

import toolbox
from algorithms.classify._evidence import PointFeatures
from algorithms.classify._outlines import margin, without_spikes
from algorithms.classify.buildings import ClassifyBuildings, on_planes
from algorithms.classify.ndvi import ClassifyNdvi
from algorithms.classify.vegetation_by_ndvi import ClassifyVegetationByNdvi
from algorithms.classify.vegetation_by_returns import ClassifyVegetationByReturns
from algorithms.compare.areas import CompareAreas
from algorithms.ground.classify import GroundClassify
from algorithms.points.height_above_ground import PointsHeightAboveGround
from algorithms.samples.scene import SamplesScene
from algorithms.shared.alpha_shape import alpha_shape
from toolbox.data import PointCloud, Raster, Vector
from toolbox.declare import Extent

PICTURE = Path(__file__).parent / "images" / "urban-classes.png"
DATA = Path(os.environ.get("TOOLBOX_TEST_DATA", ""))
IGN = ("77050_627755", "77055_627755", "77060_627760")
RD_NEW = CRS(28992)
NAMES = {1: "rest", 2: "ground", 3: "low", 4: "medium", 5: "high vegetation", 6: "building"}
NAMES |= {9: "water", 17: "bridge"}
COLOURS = {1: "#8d8d8d", 2: "#e8dcc6", 3: "#c9e29b", 4: "#86c06c", 5: "#3a8f4b", 6: "#d7543f"}
COLOURS |= {9: "#3c7fd0", 17: "#7f3f98"}
PLANTS = (3, 4, 5)

Bytes = NDArray[np.uint8]


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def town(seed: int = 0, density: float = 8.0) -> Any:
    return SamplesScene(kind="town", size=200.0, density=density, seed=seed).run()


def bare(points: PointCloud) -> PointCloud:
    """Points whose classes nobody knows."""
    return points.with_attributes({"classification": np.zeros(len(points), np.uint8)})


def of_model(points: PointCloud, **settings: Any) -> Any:
    return toolbox.run("models.urban_classes", {"points": bare(points), **settings})


def picture() -> None:
    """True and found classes of a town, with the outlines found."""
    made = town()
    found = of_model(made.points)
    figure = Figure((13, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, points, title in zip(
        figure.subplots(1, 2), (made.points, found["classified"]), ("truth", "found"), strict=True
    ):
        order = np.argsort(points.xyz[:, 2])  # as seen from above
        xy = points.xyz[order, :2] - points.xyz[:, :2].min(axis=0)
        classes = points["classification"][order]
        shown = np.isin(classes, list(COLOURS))
        axes.scatter(*xy[shown].T, s=0.3, c=[COLOURS[k] for k in classes[shown]], rasterized=True)
        axes.set(title=title, aspect="equal", xlim=(0, 200), ylim=(0, 200), xlabel="m")
        for k, colour in COLOURS.items():
            axes.scatter([], [], c=colour, s=30, label=f"{k} {NAMES[k]}")
    for shape in found["outlines"].frame.geometry:
        xy = np.asarray(shape.exterior.coords) - made.points.xyz[:, :2].min(axis=0)
        axes.plot(*xy.T, "k", lw=1.2)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=8)
    figure.savefig(PICTURE, dpi=100)


def surveys() -> Iterator[tuple[str, PointCloud, bool]]:
    """Name, points, and whether they tell vegetation from the rest."""
    for name in IGN:
        yield f"IGN {name}", PointCloud.open(DATA / "ign_urban_50m" / f"{name}.laz"), True
    for seed in (0, 1):
        yield f"town {seed}", town(seed).points, True
    delft = DATA / "ahn3_delft_bgt" / "ahn3_cropped_2.laz"
    yield "AHN3 Delft", PointCloud.open(delft, assume_crs=RD_NEW), False
    ahn = DATA / "ahn_amsterdam"
    yield "AHN3 Amsterdam", PointCloud.open(ahn / "ahn3_2386_9702.laz", assume_crs=RD_NEW), False
    yield "AHN4 Amsterdam", PointCloud.open(ahn / "ahn4_2463_9714_rgb.laz"), False


def iou(found: NDArray[np.bool_], true: NDArray[np.bool_]) -> float:
    return float((found & true).sum() / max(1, (found | true).sum()))


def joint(classes: Bytes) -> Bytes:
    """All vegetation as 5."""
    return np.where(np.isin(classes, PLANTS), 5, classes).astype(np.uint8)


def scores(found: Bytes, true: Bytes) -> str:
    """Overall accuracy, and IoU of ground, building and vegetation, of points of these classes."""
    known = np.isin(true, (2, 3, 4, 5, 6))
    one, other = joint(found)[known], joint(true)[known]
    each = " | ".join(f"{iou(one == k, other == k):.3f}" for k in (2, 6, 5))
    return f"{np.mean(one == other):.1%} | {each}"


def model_figures() -> None:
    every: list[tuple[Bytes, Bytes]] = []
    for name, points, knows_plants in surveys():
        found, true = of_model(points)["classified"]["classification"], points["classification"]
        if knows_plants:
            say(f"| {name} | {scores(found, true)} |")
        else:
            two = " | ".join(f"{iou(found == k, true == k):.3f}" for k in (2, 6))
            say(f"| {name} | | {two} | |")
        if name.startswith("IGN"):
            every.append((found, true))
    found, true = (np.concatenate(parts) for parts in zip(*every, strict=True))
    say(f"| IGN, all | {scores(found, true)} |")
    columns = [1, 2, 3, 4, 5, 6, 7, 9, 18]
    for k in (1, 2, 3, 4, 5, 6):
        counts = " | ".join(f"{np.count_nonzero((true == k) & (found == c)):,}" for c in columns)
        say(f"| {k} | {counts} |")


def maps() -> Iterator[tuple[str, PointCloud, Vector, Vector | None]]:
    """Points, and polygons of buildings with the area in which they are complete."""
    for seed in (0, 1):
        made = town(seed)
        frame = made.features.frame
        houses = frame[frame.kind == "building"].copy()
        houses["geometry"] = shapely.force_2d(houses.geometry.to_numpy())
        yield f"town {seed}", made.points, Vector(houses), None
    plan = DATA / "ahn3_delft_bgt" / "bgt_east_cropped_2.gpkg"
    delft = PointCloud.open(plan.with_name("ahn3_cropped_2.laz"), assume_crs=RD_NEW)
    yield "AHN3 Delft", delft, *(Vector.open(plan, layer=k) for k in ("pand", "coverage"))
    folder = DATA / "ign_buildings_bdtopo"
    rural = PointCloud.open(folder / "870000_6618000_class_1_2_6.laz")
    yield "IGN rural", rural, Vector.open(folder / "bdtopo_buildings.shp"), None


def building_figures() -> None:
    ways: dict[str, dict[str, Any]] = {
        "squared": {"outline": "squared"},
        "alpha": {"outline": "alpha"},
        "squared, overhang 0.2 m": {"outline": "squared", "overhang": 0.2},
    }
    for name, points, reference, coverage in maps():
        ground = GroundClassify(points=points).run().classified
        for how, settings in ways.items():
            outlines = ClassifyBuildings(points=ground, **settings).run().outlines
            say(f"| {name}, {how} | {map_scores(points, outlines, reference, coverage)} |")
        if not name.startswith("town"):
            given = class_six(points, reference.crs)
            say(f"| {name}, class 6 as given | {map_scores(points, given, reference, coverage)} |")
            false_area(name, ground, reference, coverage)


def class_six(points: PointCloud, crs: Any) -> Vector:
    """Outlines of the points that the provider calls buildings, drawn as our own."""
    xy = points.xyz[points["classification"] == 6, :2]
    made = alpha_shape(xy, 1.5, hole_threshold=10.0, region_threshold=10.0).polygons
    shapes = without_spikes(made, 1.5)
    density = len(xy) / shapely.area(shapes).sum()
    drawn = shapely.buffer(shapes, margin(density, 1.5), join_style="mitre")
    return Vector(geopandas.GeoDataFrame(geometry=drawn, crs=crs))


def false_area(name: str, ground: PointCloud, reference: Vector, coverage: Vector | None) -> None:
    """What the area consists of that the map does not have, in cells of 0.1 m."""
    alpha, own = (
        shapely.union_all(
            ClassifyBuildings(points=ground, outline=how).run().outlines.frame.geometry.to_numpy()
        )
        for how in ("alpha", "squared")
    )
    true = shapely.union_all(shapely.make_valid(reference.frame.geometry.to_numpy()))
    x0, y0, _, x1, y1, _ = ground.bounds
    region = shapely.box(x0, y0, x1, y1)
    if coverage is not None:
        region &= shapely.union_all(coverage.frame.geometry.to_numpy())
    false = (own & region) - true
    shapely.prepare(false)
    cells = np.stack(np.meshgrid(np.arange(x0, x1, 0.1), np.arange(y0, y1, 0.1)), -1).reshape(-1, 2)
    cells = cells[shapely.contains_xy(false, *cells.T)]
    scene = PointFeatures(ground, 1.0, 3.0, ground_classes=(2,))
    height = scene.terrain[1]
    plane = on_planes(scene, height > 2)
    around = cKDTree(ground.xyz[:, :2]).query_ball_point(cells, 0.5)
    top = np.array([max(near, key=lambda k: ground.xyz[k, 2], default=-1) for near in around])
    away = shapely.distance(shapely.points(cells), true)
    shapely.prepare(alpha)
    causes = {
        "beyond the points, by squaring": ~shapely.contains_xy(alpha, *cells.T),
        "on ground, or lower than 2 m": ~(height[top] > 2) | (top < 0),
        "rough": ~plane[top],
        "plane of a roof, up to 0.6 m from the map": away <= 0.6,
        "plane of a roof, farther from it": away > 0.6,
    }
    cause = np.select([*causes.values()], range(len(causes)))
    say(f"{name}: {false.area:.0f} m2 too much")
    for number, text in enumerate(causes):
        say(f"| {text} | {np.mean(cause == number):.0%} |")


def map_scores(
    points: PointCloud, outlines: Vector, reference: Vector, coverage: Vector | None
) -> str:
    """Completeness and correctness by area and by object."""
    x0, y0, _, x1, y1, _ = points.bounds
    k = CompareAreas(
        areas=Vector(outlines.frame.set_crs(reference.crs, allow_override=True)),
        reference=reference,
        coverage=coverage,
        extent=Extent(x0, y0, x1, y1),
        min_area=50.0,
        repair=True,
    ).run()
    found = f"{k.completeness:.1f} / {k.similarity:.1f}"
    return f"{found} | {k.object_completeness:.0f} / {k.object_correctness:.0f}"


def with_wall_returns(points: PointCloud, houses: Any, seed: int = 0) -> PointCloud:
    """The survey with a last return on the ground below six of ten points at edges of roofs."""
    rng = np.random.default_rng(seed)
    edge = shapely.union_all(shapely.force_2d(houses.geometry.to_numpy())).boundary
    roof = np.flatnonzero((points["classification"] == 6) & (points["number_of_returns"] == 1))
    away = shapely.distance(shapely.points(points.xyz[roof, :2]), edge)
    roof = roof[(away < 0.35) & (rng.random(len(roof)) < 0.6)]
    ground = points.xyz[points["classification"] == 2]
    _, nearest = cKDTree(ground[:, :2]).query(points.xyz[roof, :2])
    low = np.column_stack(
        [points.xyz[roof, :2] + rng.normal(0, 0.15, (len(roof), 2)), ground[nearest, 2]]
    )
    size = len(points)
    columns = {name: np.concatenate([points[name], points[name][roof]]) for name in points.names}
    columns["number_of_returns"][np.r_[roof, size : size + len(roof)]] = 2
    columns["return_number"][roof] = 1
    columns["return_number"][size:] = columns["classification"][size:] = 2
    return PointCloud(np.vstack([points.xyz, low]), columns, crs=points.crs)


def returns_figures() -> None:
    def f1(found: NDArray[np.bool_], true: NDArray[np.bool_]) -> float:
        return float(2 * (found & true).sum() / (found.sum() + true.sum()))

    def cases() -> Iterator[tuple[str, PointCloud, tuple[int, ...]]]:
        for seed in (0, 1):
            made = town(seed)
            frame = made.features.frame
            houses = frame[frame.kind == "building"]
            yield f"town {seed}", with_wall_returns(made.points, houses), PLANTS
        for name, points, knows_plants in surveys():
            if not name.startswith("town"):
                yield name, points, PLANTS if knows_plants else (1,)

    for name, points, plants in cases():
        ground = GroundClassify(points=points).run().classified
        built = ClassifyBuildings(points=ground).run().classified
        true, wall = (np.isin(points["classification"], k) for k in (plants, 6))
        every, kept = (
            np.isin(
                ClassifyVegetationByReturns(points=built, **how).run().classified["classification"],
                PLANTS,
            )
            for how in ({"building_classes": None}, {})
        )
        kept &= every
        rates = (1 - kept[wall].sum() / every[wall].sum(), 1 - kept[true].sum() / every[true].sum())
        before, after = f1(every, true & every), f1(kept, true & every)
        say(f"| {name} | {before:.3f} | {after:.3f} | {rates[0]:.1%} | {rates[1]:.1%} |")


def ndvi_figures() -> None:
    folder = DATA / "cir_ign_20cm"
    points = PointCloud.open(folder / "split_west.laz")
    image = Raster.open(folder / "split_west_irc.tif")
    made = ClassifyNdvi(image=image, nir="1", red="2").run()
    say(f"threshold of Otsu {made.threshold_used:.3f}")
    ground = GroundClassify(points=points).run().classified
    heights = PointsHeightAboveGround(points=ground).run().heights
    plant, other = (np.isin(points["classification"], k) for k in (PLANTS, (2, 6)))
    for name, layer in (("alone", points), ("with heights", heights)):
        for limit in (0.1, 0.0, -0.05):
            out = ClassifyVegetationByNdvi(points=layer, image=made.ndvi, threshold=limit).run()
            found = np.isin(out.classified["classification"], PLANTS)
            say(f"| {name} | {limit} | {found[plant].mean():.3f} | {found[other].mean():.3f} |")


TASKS: dict[str, tuple[Callable[[], None], ...]] = {
    "picture": (picture,),
    "figures": (model_figures, building_figures, returns_figures, ndvi_figures),
}

if __name__ == "__main__":
    for task in TASKS[sys.argv[1]]:
        task()
