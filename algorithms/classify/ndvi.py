"""NDVI of an image, and a mask of where it means vegetation.

References
----------
Demir, N. and Acar, U.: vegetation from colour-infrared images, (NIR - red) / (NIR + red).
Otsu, N. (1979). A threshold selection method from gray-level histograms. IEEE Transactions on
Systems, Man, and Cybernetics 9(1), 62-66.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.classify._ndvi import chosen_threshold, named, ndvi
from algorithms.shared.alignment import not_on
from toolbox.context import QUIET, Context, log
from toolbox.data import Lattice, Raster
from toolbox.data.crs import crs_conflict
from toolbox.declare import outputs, param, sink, source, tool

NIR = re.compile(r"\bnir\b|near[- ]?infra", re.IGNORECASE)
RED = re.compile(r"(?<!infra[- ])\bred\b(?![- ]?edge)", re.IGNORECASE)
VEGETATION, OTHER, UNKNOWN = np.uint8(1), np.uint8(0), 255
MOSTLY = 0.95  # share of cells below 0 that makes a user think again

Floats = NDArray[np.float64]


@tool(
    "classify.ndvi",
    title="NDVI of an image",
    tags=(
        "ndvi",
        "vegetation",
        "index",
        "infrared",
        "green",
        "image",
        "cir",
    ),
)
class ClassifyNdvi:
    """Compute the vegetation index NDVI of an image, and a mask of what is green.

    NDVI is (NIR - red) / (NIR + red), from -1 to 1: leaves are bright in the near infrared and dark
    in red. Bands are named by number, counted from 1, or by a word of their description; without a
    name, a band that is described as near infrared, and one as red, are taken. If red is in another
    file, give it as `red_image`.

    Values of any type are turned into reflectance, value times `scale` plus `offset`, in double
    precision. NDVI is empty where a band has no data or is below 0, as dark cells of corrected
    images may be, and where both are 0.

    Vegetation is where NDVI is at least `threshold`: in reflectances 0.2 to 0.3 is common, in
    uncalibrated images it may lie near 0. With `otsu` it splits the histogram into two groups as
    well as can be, which assumes that there are two.
    """

    image: Raster = source("Image with a near-infrared and a red band", label="Image")
    red_image: Raster | None = source(
        "Image with the red band, if in another file", default=None, label="Image with the red band"
    )
    nir: str | None = param(
        "Near-infrared band: its number, or a word of its description",
        default=None,
        of="image",
        label="Near-infrared band",
    )
    red: str | None = param(
        "Red band: its number, or a word of its description",
        default=None,
        of="image",
        label="Red band",
    )
    threshold: float | Literal["otsu"] = param(
        "Lowest NDVI of vegetation; otsu splits the values in two",
        default="otsu",
        unit="1",
        ge=-1,
        le=1,
    )
    scale: float = param(
        "Reflectance per value", default=1.0, unit="1", gt=0, label="Reflectance per value"
    )
    offset: float = param(
        "Reflectance of the value 0", default=0.0, unit="1", label="Reflectance of 0"
    )
    nodata_is_valid: bool = param(
        "Take the nodata value of integers for a measurement, such as 255 in bright cells",
        default=False,
        label="Nodata is a measurement",
    )

    @outputs
    class Outputs:
        ndvi: Raster = sink("NDVI, from -1 to 1, empty where it is not known", label="NDVI")
        mask: Raster = sink("Cells with vegetation 1, others 0, empty where not known")
        threshold_used: float | None = sink("Lowest NDVI of vegetation", unit="1")
        vegetation_share: float = sink("Share of the cells with NDVI that are green", unit="1")
        filled_share: float = sink("Share of the cells that have NDVI", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """Both bands are given and differ."""
        if self.nir is not None and self.nir == self.red and self.red_image is None:
            yield "red", f"must be another band than nir, got {self.red} for both"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The image has the bands, and both are on the same cells."""
        other = self.red_image or self.image
        nir, red = (
            band_number(self.image, self.nir, NIR, alone=self.red_image is not None),
            band_number(other, self.red, RED, alone=self.red_image is not None),
        )
        for name, found in (("nir", nir), ("red", red)):
            if isinstance(found, str):
                yield name, found
        if isinstance(nir, int) and isinstance(red, int):
            if other is self.image and nir == red:
                yield "red", f"must be another band than nir, got {red} for both"
            elif swapped(self.image.descriptions[nir - 1], other.descriptions[red - 1]):
                called = f"{self.image.descriptions[nir - 1]!r} and {other.descriptions[red - 1]!r}"
                yield "nir", f"the bands are called {called}; are nir and red swapped?"
        if text := crs_conflict(other.crs, self.image.crs, heights=False):
            yield "red_image", f"{named(other)} {text} of {named(self.image)}"
        if text := not_on(Lattice.of(self.image), Lattice.of(other)):
            yield "red_image", f"{named(other)} {text} of {named(self.image)}"

    def halo(self) -> float:
        """Rasters are not read in tiles."""
        return 0.0

    def run(self, ctx: Context = QUIET) -> ClassifyNdvi.Outputs:
        """Compute NDVI, find the threshold, and compare the two."""
        other = self.red_image or self.image
        alone = self.red_image is not None
        nir, red = (
            self._reflectance(image, int(band_number(image, word, pattern, alone=alone)))
            for image, word, pattern in ((self.image, self.nir, NIR), (other, self.red, RED))
        )
        ctx.progress(0.3)
        values = ndvi(nir, red)
        known = np.isfinite(values)
        warn(values[known])
        ctx.progress(0.6)
        limit = chosen_threshold(values[known], self.threshold, "image: all NDVI")
        mask = np.full(values.shape, UNKNOWN, np.uint8)
        if limit is not None:
            mask[known] = np.where(values[known] >= limit, VEGETATION, OTHER)
        ctx.progress(1.0)
        lattice, green = Lattice.of(self.image), int(np.count_nonzero(mask == VEGETATION))
        return self.Outputs(
            ndvi=Raster.from_lattice(
                values.astype(np.float32), lattice, crs=self.image.crs, descriptions=("NDVI",)
            ),
            mask=Raster.from_lattice(
                mask, lattice, crs=self.image.crs, nodata=UNKNOWN, descriptions=("vegetation",)
            ),
            threshold_used=limit,
            vegetation_share=green / max(1, int(known.sum())),
            filled_share=float(known.mean()),
        )

    def _reflectance(self, image: Raster, number: int) -> Floats:
        """Values of a band as reflectance, NaN where there is no data."""
        is_integer = image.values.dtype.kind != "f"
        if self.nodata_is_valid and is_integer:
            band = image.values[number - 1].astype(np.float64)
        else:
            band = image.band(number)
        return np.asarray(band * self.scale + self.offset)


def band_number(
    image: Raster, word: str | None, pattern: re.Pattern[str], *, alone: bool
) -> int | str:
    """Index of a band by name or number, or why there is none.

    Parameters
    ----------
    word : number or part of a description; None to look for the pattern
    alone : the image is for this band only, so that a single one is that band
    """
    count = len(image.values)
    if word is not None and word.strip().isdecimal():
        number = int(word)
        if 1 <= number <= count:
            return number
        return f"must be from 1 to {count}, the bands of {named(image)}, got {number}"
    if word is None and alone and count == 1:
        return 1
    matching = [
        i
        for i, text in enumerate(image.descriptions, start=1)
        if (pattern.search(text) if word is None else word.lower() in text.lower())
    ]
    if len(matching) == 1:
        return matching[0]
    bands = ", ".join(f"{i} {t!r}" for i, t in enumerate(image.descriptions, start=1))
    problem = "says" if not matching else "alone says"
    wanted = "which it is" if word is None else repr(word)
    return f"no band of {named(image)} {problem} {wanted}: {bands}; give its number"


def swapped(nir: str, red: str) -> bool:
    """Whether the descriptions of the bands contradict the roles they are given."""
    return bool(RED.search(nir) and NIR.search(red))


def warn(values: Floats) -> None:
    """Log what may not be as the user intended."""
    if not len(values):
        log.warning("no cell has NDVI")
    elif (share := np.mean(values < 0)) > MOSTLY:
        log.warning(
            "NDVI is below 0 in %.0f %% of the cells: is it water, or are the bands swapped?",
            100 * share,
        )
