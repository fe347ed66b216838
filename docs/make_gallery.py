"""Makes the pictures and prints the figures of docs/explanation/gridding-gallery.md.

python docs/make_gallery.py pictures     # docs/images/gallery-*.png, of a synthetic town
python docs/make_gallery.py figures      # tables, of the real surveys in TOOLBOX_TEST_DATA
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from pyproj import CRS

from algorithms.ground.classify import GroundClassify
from algorithms.samples.scene import SamplesScene
from algorithms.shared.error_measures import measures
from algorithms.surface.cross_validation import SurfaceCrossValidation
from algorithms.surface.grid import SurfaceGrid
from algorithms.surface.hillshade import hillshade
from toolbox.data import PointCloud, Raster
from toolbox.declare import ClassList, Extent

IMAGES = Path(__file__).parent / "images"
DATA = Path(os.environ.get("TOOLBOX_TEST_DATA", ""))
INTERPOLATIONS = ("linear", "natural", "cubic", "idw", "nearest")
METHODS = (*INTERPOLATIONS, "mean")
MEASURES = {
    "RMSE": "rmse",
    "MAE": "mae",
    "P95": "le95",
    "bias": "bias",
    "largest": "largest",
    "share without a value": "share",
}
COLOURS = dict(
    zip(METHODS, ("#d7261e", "#2166d1", "#7f3f98", "#e5a93c", "#58b2a3", "#8a6036"), strict=True)
)
GROUND = ClassList([2])
WHOLE = "single points"

# Name, file, cell, and the sizes of blocks in metres that leave enough of the survey.
SURVEYS: tuple[tuple[str, str, float, tuple[float, ...]], ...] = (
    ("IGN town", "ign_urban_50m/77055_627755.laz", 0.5, (2, 5)),
    ("AHN3 Delft", "ahn3_delft_bgt/ahn3_cropped_2.laz", 0.5, (2, 5, 10)),
    ("Autzen", "autzen_ept/autzen_south_5M.laz", 0.5, (2, 5, 10, 20)),
    ("Topography", "lidr_topography/Topography.laz", 1.0, (5, 10, 20)),
)


# Pictures of a synthetic town ----------------------------------------------------------------

BOX = Extent(500_014, 4_400_002, 500_064, 4_400_052)  # two houses, grass, and a bank
CUT = 500_026.25  # easting of the profile, along cell centres through a house and the bank


def pictures() -> None:
    """A town whose true ground is known, under each method."""
    scene = SamplesScene(kind="town", size=120.0, density=4.0).run()
    surfaces = {"truth": scene.terrain} | {
        method: SurfaceGrid(
            points=scene.points, classes=GROUND, method=method, cell=0.5, extent=BOX
        )
        .run()
        .surface
        for method in METHODS
    }
    ground = scene.points.select(scene.points["classification"] == 2).within(BOX)
    maps(surfaces, ground).savefig(IMAGES / "gallery-methods.png", dpi=66)
    profiles(surfaces, ground).savefig(IMAGES / "gallery-profiles.png", dpi=80)


def canvas(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def on_cells(surface: Raster) -> Any:
    """Heights at the centres of half-metre cells of the box."""
    x = np.arange(BOX[0] + 0.25, BOX[2], 0.5)
    y = np.arange(BOX[3] - 0.25, BOX[1], -0.5)
    return surface.sample(*np.meshgrid(x, y))


def maps(surfaces: dict[str, Raster], ground: PointCloud) -> Figure:
    """The points, and each surface in colours, lit by a low sun where it has no holes."""
    figure = canvas(13, 6.9)
    axes = figure.subplots(2, 4, sharex=True, sharey=True).ravel()
    place = {"extent": (0, BOX[2] - BOX[0], 0, BOX[3] - BOX[1])}
    xy = ground.xyz[:, :2] - (BOX[0], BOX[1])
    axes[0].plot(*xy.T, ".", ms=0.6, color="#3a3a3a")
    axes[0].set(title=f"{len(xy):,} ground points", aspect="equal")
    low, high = np.nanpercentile(on_cells(surfaces["truth"]), (0, 100))
    for axis, (name, surface) in zip(axes[1:], surfaces.items(), strict=True):
        heights = on_cells(surface)
        shade = hillshade(heights, 0.5, altitude=35.0, z_factor=2.0, edges=True)
        axis.imshow(heights, cmap="terrain", vmin=low - 3, vmax=high + 2, **place)
        axis.imshow(shade, cmap="gray", vmin=0.15, vmax=1.0, alpha=0.7, **place)
        axis.axvline(CUT - BOX[0], color="#d7261e", lw=0.8, ls=":")
        axis.set_title(name)
    for axis in axes[4:]:
        axis.set_xlabel("m")
    return figure


def profiles(surfaces: dict[str, Raster], ground: PointCloud) -> Figure:
    """A cut from south to north: all surfaces and the truth, and how far they are apart."""
    figure = canvas(13, 7)
    heights, errors = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    y = np.arange(BOX[1] + 0.25, BOX[3], 0.5)  # centres of cells
    true = surfaces["truth"].sample(np.full_like(y, CUT), y, method="linear")
    near = ground.xyz[np.abs(ground.xyz[:, 0] - CUT) < 0.25]
    heights.plot(
        near[:, 1] - BOX[1], near[:, 2], ".", color="#a3a3a3", label="points within 0.25 m"
    )
    heights.plot(y - BOX[1], true, color="black", lw=3, alpha=0.4, label="truth")
    for method in METHODS:
        found = surfaces[method].sample(np.full_like(y, CUT), y)
        style = {"color": COLOURS[method], "lw": 1.2}
        heights.plot(y - BOX[1], found, label=method, **style)
        errors.plot(y - BOX[1], found - true, **style)
    heights.set(ylabel="height (m)")
    heights.legend(ncols=4, fontsize=8, frameon=False)
    errors.axhline(0, color="black", lw=0.8)
    errors.set(xlabel="m from south to north", ylabel="surface minus truth (m)")
    for axis in (heights, errors):
        axis.spines[["top", "right"]].set_visible(False)
    return figure


# Figures of real surveys ---------------------------------------------------------------------


def figures() -> None:
    """Cross-validation by survey, size of gap and density."""
    for name, path, cell, blocks in SURVEYS:
        points = real(path)
        say(f"\n### {name}: {len(points):,} ground points, cells of {cell:g} m\n")
        cases: list[tuple[str, PointCloud, float | None]] = [(WHOLE, points, None)]
        cases += [(f"gaps of {block:g} m", points, block) for block in blocks]
        if name == "IGN town":
            cases += [(f"1 of {n} points", thinned(points, n), None) for n in (4, 16, 64)]
        head = ("left out", "", *METHODS)
        say(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
        for case, some, block in cases:
            for cells in tabled(some, cell, block, whole=case == WHOLE):
                say(f"| {case} | {' | '.join(cells)} |")


def real(path: str) -> PointCloud:
    """Ground points of a survey; of the one without classes, those that ground.classify finds."""
    points = PointCloud.open(DATA / path)
    points = points if points.crs else points.with_crs(CRS(28992))  # AHN: Amersfoort / RD New
    if "autzen" in path:
        west, south, _, east, north, _ = points.bounds
        x, y, half = (west + east) / 2, (south + north) / 2, 125 * points.metre
        points = points.within((x - half, y - half, x + half, y + half))
        points = GroundClassify(points=points).run().classified
    return points.select(points["classification"] == 2)


def thinned(points: PointCloud, one_of: int) -> PointCloud:
    chance = np.random.default_rng(0).random(len(points))
    return points.select(chance < 1 / one_of)


def tabled(
    points: PointCloud, cell: float, block: float | None, whole: bool
) -> Iterator[list[str]]:
    """Rows of measure and one number per method, metres, at points where all have a value."""
    methods = METHODS if whole else INTERPOLATIONS
    out = SurfaceCrossValidation(points=points, methods=methods, cell=cell, block=block).run()
    errors = np.array([out.residuals[f"error_{method}"] for method in methods]) / points.metre
    known = np.isfinite(errors)
    some = known[: len(INTERPOLATIONS)].all(axis=0)  # the mean has its own points, and fewer
    columns = [
        measures(error[some & there]) | {"share": 1 - there.mean()}
        for error, there in zip(errors, known, strict=True)
    ]
    for column in columns:
        column["largest"] = max(-column["min"], column["max"])
    for title, name in MEASURES.items():
        yield [title, *(f"{column[name]:z.3f}" for column in columns), ""][: 1 + len(METHODS)]


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    for chosen in sys.argv[1:] or ("pictures", "figures"):
        {"pictures": pictures, "figures": figures}[chosen]()
