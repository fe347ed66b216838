"""Vegetation by an NDVI that points have, or that an image gives them.

References
----------
Demir, N. and Acar, U.: vegetation from first and last pulses and from colour-infrared images.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._heights import PLANTS, by_height
from algorithms.classify._ndvi import chosen_threshold, named, ndvi
from algorithms.shared import parameters
from algorithms.shared.ground import taking_part
from algorithms.shared.heights import HEIGHT
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Raster
from toolbox.data.crs import crs_conflict
from toolbox.declare import Attribute, ClassList, Share, outputs, param, sink, source, tool
from toolbox.errors import DataError

ENOUGH = 100  # points of a kind that tell whether bands were swapped

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@tool(
    "classify.vegetation_by_ndvi",
    title="Classify vegetation (NDVI)",
    tags=(
        "ndvi",
        "vegetation",
        "tree",
        "green",
        "infrared",
    ),
)
class ClassifyVegetationByNdvi:
    """Classify vegetation by its NDVI, and by height where points have one.

    Points take NDVI from the cell of a raster that they lie in, such as classify.ndvi makes, or,
    without a raster, from their own attributes `nir` and `red`. Those of at least `threshold`
    become vegetation; the attribute NDVI is added to all.

    An image sees what is on top. So below a crown the ground seems green as well, and a lawn is
    green but ground. Points with the attribute HeightAboveGround, of points.height_above_ground,
    are vegetation only from `min_height` on, and low (3), medium (4) or high (5) by their height.
    Without heights all vegetation becomes class 5.

    What is not vegetation keeps its class, and becomes 1 if that was vegetation. Points without
    NDVI keep theirs.
    """

    points: PointCloud = source("Points to classify")
    image: Raster | None = source("NDVI, of one band", default=None, label="NDVI raster")
    nir: Attribute = param(
        "Attribute with near infrared",
        default=Attribute("nir"),
        label="Attribute with near infrared",
    )
    red: Attribute = param(
        "Attribute with red", default=Attribute("red"), label="Attribute with red"
    )
    threshold: float | Literal["otsu"] = param(
        "Lowest NDVI of vegetation; otsu splits the values in two",
        default=0.1,
        unit="1",
        ge=-1,
        le=1,
    )
    min_height: float = param(
        "Lowest height above ground of vegetation",
        default=0.2,
        unit="m",
        ge=0,
        label="Lowest vegetation",
    )
    low: float = parameters.low_ends()
    high: float = parameters.high_begins()
    ignore: ClassList | None = parameters.ignore()
    keep_classes: ClassList | None = parameters.keep_classes()

    @outputs
    class Outputs:
        classified: PointCloud = sink(
            "The same points with classes and NDVI", label="Classified points"
        )
        threshold_used: float | None = sink("Lowest NDVI of vegetation", unit="1")
        vegetation_share: float = sink("Share of points that became vegetation", unit="1")
        covered_share: float = sink("Share of points that have NDVI", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """The height limits are in order."""
        if self.low > self.high:
            yield "low", f"must be <= high ({self.high:g}), got {self.low:g}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have the bands, or the image is NDVI in the CRS of the points."""
        if self.image is None:
            for name in ("nir", "red"):
                if (wanted := getattr(self, name)) not in self.points:
                    lacking = f"{self.points.name or 'the cloud'} has no {wanted}"
                    yield name, f"{lacking}; name the attribute, or give an image"
            return
        if text := crs_conflict(self.image.crs, self.points.crs, heights=False):
            yield "image", f"{named(self.image)} {text} of {self.points.name or 'the points'}"
        if len(self.image.values) != 1:
            count = len(self.image.values)
            yield "image", f"must be NDVI, of one band, got {count}; make it with classify.ndvi"
        elif np.abs(self.image.band()[np.isfinite(self.image.band())]).max(initial=0) > 1:
            yield "image", "must be NDVI, from -1 to 1; make it with classify.ndvi"

    def halo(self) -> float:
        """Infinite where all points decide on the threshold, else 0."""
        return math.inf if self.threshold == "otsu" else 0.0

    def run(self, ctx: Context = QUIET) -> ClassifyVegetationByNdvi.Outputs:
        """Give the points their NDVI, and compare it with the threshold."""
        cloud = self.points
        values = self._ndvi()
        ctx.progress(0.4)
        part = taking_part(cloud, self.ignore, self.keep_classes)
        known = part & np.isfinite(values)
        self._warn(values, known)
        limit = chosen_threshold(values[known], self.threshold, "points: all NDVI")
        ctx.progress(0.6)
        green = known & (values >= (np.inf if limit is None else limit))
        height = np.full(len(cloud), np.nan)
        if HEIGHT in cloud:
            height = cloud[HEIGHT].astype(np.float64)
            green &= ~(height < self.min_height)
        else:
            log.info("points have no %s: all vegetation becomes class 5", HEIGHT)
        old = cloud["classification"] if "classification" in cloud else np.zeros(len(cloud), "u1")
        classes = np.where(known & np.isin(old, PLANTS), 1, old).astype(np.uint8)
        classes[green] = by_height(height[green], self.low, self.high)
        ctx.progress(1.0)
        return self.Outputs(
            classified=cloud.with_attributes(
                {"classification": classes, "NDVI": values.astype(np.float32)},
                descriptions={"NDVI": "-1 to 1"},
            ),
            threshold_used=limit,
            vegetation_share=Share.of_points(green, cloud.core),
            covered_share=Share.of_points(np.isfinite(values), cloud.core),
        )

    def _ndvi(self) -> Floats:
        """NDVI of each point, from the image or its own bands; NaN where not known."""
        cloud = self.points
        if self.image is not None:
            return self.image.sample(cloud.xyz[:, 0], cloud.xyz[:, 1])
        nir, red = cloud[self.nir], cloud[self.red]
        if len(cloud) and not (nir.any() or red.any()):
            raise DataError(f"points: {self.nir} and {self.red} are 0 at all points")
        return ndvi(nir, red)

    def _warn(self, values: Floats, known: Mask) -> None:
        """Log what may not be as the user intended."""
        cloud = self.points
        missing = int(np.isnan(values).sum())
        if missing and self.image is not None:
            share = 100 * missing / len(cloud)
            log.warning("%.3g %% of the points have no NDVI in %s", share, named(self.image))
        if "number_of_returns" not in cloud:
            return
        several = cloud["number_of_returns"] > 1
        torn, whole = values[known & several], values[known & ~several]
        if min(len(torn), len(whole)) >= ENOUGH and np.median(torn) < np.median(whole):
            log.warning(
                "pulses with several returns, mostly from plants, have a lower NDVI (%.2f) than "
                "others (%.2f): are nir and red swapped?",
                np.median(torn),
                np.median(whole),
            )
