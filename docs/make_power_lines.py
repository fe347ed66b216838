"""Makes docs/images/power-lines.png: a synthetic corridor as corridor.extract sees it.

python docs/make_power_lines.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from algorithms.corridor.extract import CorridorExtract
from algorithms.samples.scene import SamplesScene

PICTURE = Path(__file__).parent / "images" / "power-lines.png"
WIRES, TOWERS = (13, 14), (15, 16)  # guard wires count as wires, insulators as towers


def made() -> tuple[NDArray[np.float64], dict[str, tuple[NDArray[np.bool_], str, float]]]:
    """Coordinates, and what is drawn one above the other: points, colour and size."""
    points = SamplesScene(kind="power_lines", size=400.0, density=16.0, seed=4).run().points
    true = points["classification"]
    bare = points.with_attributes({"classification": np.ones(len(points), np.uint8)})
    said = CorridorExtract(points=bare).run().classified["classification"]
    wire, tower = np.isin(true, WIRES), np.isin(true, TOWERS)
    return points.xyz - points.xyz.min(axis=0), {
        "neither": (np.isin(said, (14, 15), invert=True) & ~wire & ~tower, "#cccccc", 0.5),
        "wire": ((said == 14) & wire, "#d62728", 1.0),
        "tower": ((said == 15) & tower, "#1f77b4", 1.0),
        "missed": ((wire | tower) & ~np.isin(said, (14, 15)), "#2ca02c", 2.0),
        "invented": (np.isin(said, (14, 15)) & ~(wire | tower), "#000000", 2.0),
        "one for the other": ((said == 14) & tower | (said == 15) & wire, "#ff00ff", 2.0),
    }


def main() -> None:
    xyz, layers = made()
    figure = Figure(figsize=(11, 7), layout="constrained")
    FigureCanvasAgg(figure)
    plan, side = figure.subplots(2, 1, height_ratios=[2, 1], sharex=True)
    for name, (shown, colour, size) in layers.items():
        for place, other in ((plan, 1), (side, 2)):
            places = xyz[shown]
            place.scatter(
                places[:, 0], places[:, other], s=size, c=colour, linewidths=0, label=name
            )
    for place, text in ((plan, "northing, m"), (side, "height, m")):
        place.set_aspect("equal")
        place.set_ylabel(text)
    side.set_xlabel("easting, m")
    side.set_ylim(5.0, 90.0)  # without the noise above and below
    plan.legend(loc="upper left", markerscale=6, frameon=False, ncols=2)
    figure.savefig(PICTURE, dpi=100)


if __name__ == "__main__":
    main()
