"""Charts on a matplotlib figure: a table of bins as bars, offsets along lines as a profile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from toolbox.data import Table, Vector
from toolbox.data.crs import vertical_unit
from toolbox.pictures.images import LENGTHS
from toolbox.pictures.maps import INK, WIDTH, Place, fractions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BINS = {"low", "high", "count"}
_ALONG = {"line", "chainage", "offset"}
_INSIDE, _BEYOND, _CURVE = "#7f9fbf", "#c9c9c9", "#1f3a5f"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Bars:
    """A histogram; the first and the last count are those of all that lies beyond the edges.

    Attributes
    ----------
    edges : of the bins, rising
    counts : one more than there are edges
    """

    title: str
    edges: Sequence[float]
    counts: Sequence[int]
    unit: str
    height: float = 0.7 * WIDTH  # inches
    key_height: float = 0.3

    @classmethod
    def of(cls, title: str, table: Table) -> Bars | None:
        """The histogram in a table of the columns low, high and count; None if it is no such."""
        frame = table.frame
        if not (set(frame.columns) >= _BINS and len(frame) > 2):
            return None
        unit = str(frame["unit"].iloc[0]) if "unit" in frame else ""
        return cls(title, [float(v) for v in frame["high"][:-1]], [*frame["count"]], unit)


def show_bars(figure: Figure, bars: Bars, place: Place) -> None:
    """Draw one histogram; what lies beyond is as wide as the bin beside it, and lighter."""
    axes = figure.add_axes(fractions(figure, place.map))
    edges = np.array(bars.edges)
    steps = np.diff(edges)
    left = np.concatenate([[edges[0] - steps[0]], edges])
    width = np.concatenate([steps[:1], steps, steps[-1:]])
    colours = [_BEYOND, *[_INSIDE] * len(steps), _BEYOND]
    axes.bar(left, bars.counts, width, align="edge", color=colours, edgecolor="white", lw=0.3)
    if left[0] < 0 < left[-1]:
        axes.axvline(0, color=INK, lw=0.8)
    axes.set_xlabel(f"{bars.unit}; grey: all beyond".removeprefix("; "), fontsize=7.5, color=INK)
    _plain(axes, bars.title)


@dataclass(frozen=True)
class Profile:
    """Offsets to the side along lines.

    Attributes
    ----------
    lines : of each line its chainages and offsets, arrays of shape (n,)
    """

    title: str
    lines: Sequence[tuple[Array, Array]]
    unit: str
    height: float = 0.7 * WIDTH  # inches
    key_height: float = 0.3

    @classmethod
    def of(cls, title: str, layer: Vector) -> Profile | None:
        """The profile in points with chainage, offset and line; None if there is none."""
        frame = layer.frame
        if not set(frame.columns) >= _ALONG or not frame["offset"].notna().any():
            return None
        lines = [
            (part["chainage"].to_numpy(float), part["offset"].to_numpy(float))
            for _, part in frame.groupby("line")
        ]
        unit = vertical_unit(layer.crs)
        return cls(f"{title} along the line", lines, LENGTHS.get(unit, unit))


def show_profile(figure: Figure, profile: Profile, place: Place) -> None:
    """Draw offsets over chainages; left of the reference is above zero."""
    axes = figure.add_axes(fractions(figure, place.map))
    for chainage, offset in profile.lines:
        axes.plot(chainage, offset, lw=0.8, color=_CURVE)
    axes.axhline(0, color=INK, lw=0.8)
    unit = f" ({profile.unit})" if profile.unit else ""
    axes.set_xlabel(f"chainage{unit}", fontsize=7.5, color=INK)
    axes.set_ylabel(f"offset{unit}, left +", fontsize=7.5, color=INK, labelpad=1)
    _plain(axes, profile.title)


def _plain(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10, color=INK, loc="left", pad=6, fontweight="bold")
    axes.tick_params(labelsize=6.5, colors="#6a6a6a", length=2.5, width=0.5, pad=2)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)
