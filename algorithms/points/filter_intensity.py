"""Selection of points by intensity: the first step of the shoreline study.

References
----------
Höfle, B. et al. (2009). Water surface mapping from airborne laser scanning using signal intensity
and elevation data. Earth Surface Processes and Landforms 34(12), 1635-1649.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.otsu import otsu_threshold
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud
from toolbox.declare import Share, outputs, param, sink, source, tool
from toolbox.errors import DataError

MISSCALED = 10.0  # a limit so many times below all intensities is for another scale


@tool(
    "points.filter_intensity",
    title="Filter points by intensity",
    tags=(
        "filter",
        "intensity",
        "reflectance",
        "select",
    ),
)
class PointsFilterIntensity:
    """Keep points whose intensity lies within limits.

    Water and wet mud absorb near-infrared light, so that a lower limit separates land from water.
    Intensities are not calibrated between sensors and are rescaled by many programs: `value` uses
    the limits as they are, `percentile` takes them as percentiles of the intensities in the file,
    and `otsu` finds the lower limit that best splits the histogram in two. Points without an
    intensity (NaN) are removed with `value`; the other methods do not accept them.
    """

    points: PointCloud = source("Points with intensity")
    minimum: float | None = param(
        "Lowest intensity or percentile to keep", default=40.0, unit="1", ge=0
    )
    maximum: float | None = param(
        "Highest intensity or percentile to keep", default=None, unit="1", ge=0
    )
    method: Literal["value", "percentile", "otsu"] = param(
        "What the limits mean; with otsu the lower one is found and `minimum` is not used",
        default="value",
        words={"value": "Values", "percentile": "Percentiles", "otsu": "Threshold of Otsu"},
    )

    @outputs
    class Outputs:
        kept: PointCloud = sink(
            "The points within the limits, otherwise unchanged", label="Points kept"
        )
        removed_share: float = sink("Share of points removed", unit="1")
        threshold: float | None = sink("Lowest intensity that is kept", unit="1")

    def check(self) -> Iterator[tuple[str, str]]:
        """The limits fit each other and the method."""
        if self.method == "otsu":
            return
        if self.minimum is None and self.maximum is None:
            yield "minimum", "give a minimum, a maximum or both"
        for name in ("minimum", "maximum"):
            limit = getattr(self, name)
            if self.method == "percentile" and limit is not None and limit > 100:
                yield name, f"must be <= 100 as a percentile, got {limit:g}"
        if self.minimum is not None and self.maximum is not None and self.minimum > self.maximum:
            yield "minimum", f"must be <= maximum ({self.maximum:g}), got {self.minimum:g}"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have intensities."""
        if "intensity" not in self.points:
            yield "points", f"{self.points.name} has no intensity"

    def halo(self) -> float:
        """Zero, as each point is judged by itself; infinite if the histogram of all is needed."""
        return 0.0 if self.method == "value" else math.inf

    def run(self, ctx: Context = QUIET) -> PointsFilterIntensity.Outputs:
        """Keep the points."""
        intensity = self.points["intensity"]
        self._look_for_nan(intensity)
        low, high = self._limits(intensity)
        keep = np.ones(len(intensity), bool)
        if low is not None:
            keep &= intensity >= low
        if high is not None:
            keep &= intensity <= high
        if len(keep) and not keep.any():
            log.warning("no intensity lies within the limits")
        elif low and len(keep) and low * MISSCALED <= intensity.min():
            log.warning(
                "minimum: %g is far below all intensities, which begin at %g: nothing is removed; "
                "are they on another scale? otsu finds a limit",
                low,
                intensity.min(),
            )
        ctx.progress(1.0)
        kept = self.points.select(keep)
        removed = Share.of_points(~keep, self.points.core)
        return self.Outputs(kept=kept, removed_share=removed, threshold=low)

    def _look_for_nan(self, intensity: NDArray[Any]) -> None:
        """Raise an error if missing intensities (NaN) would be ranked; warn if they are removed.

        Points from text files may lack an intensity.
        """
        missing = int(np.isnan(intensity).sum())
        if missing and self.method != "value":
            raise DataError(
                f"points: {missing} of {len(intensity)} intensities are not a number (NaN), so "
                f"method {self.method} cannot rank them; keep intensity >= 0 with points.filter"
            )
        if missing:
            log.warning("%d points without an intensity (NaN) are removed", missing)

    def _limits(self, intensity: NDArray[Any]) -> tuple[float | None, float | None]:
        low, high = (
            None if limit is None else float(limit) for limit in (self.minimum, self.maximum)
        )
        if self.method == "value" or len(intensity) == 0:
            return low, high
        if self.method == "otsu":
            return otsu_threshold(intensity, "points: all intensities"), high
        low, high = (
            None if limit is None else float(np.percentile(intensity, limit))
            for limit in (low, high)
        )
        return low, high
