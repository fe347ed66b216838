"""Curves on a matplotlib figure: area and volume over the level, planes over the tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from toolbox.data import Table
from toolbox.pictures.images import LENGTHS
from toolbox.pictures.maps import INK, WIDTH, Place, fractions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = {"level", "unit", "area_m2", "volume_m3"}
_SWEEP = {"tolerance", "planes", "share", "knee"}
_AREA, _VOLUME, _OPEN = "#c4742b", "#2f6da8", "#c9c9c9"
_UNITS = (1.0, ""), (1e3, "1000 "), (1e6, "million ")  # of the axes, below a thousand of them


@dataclass(frozen=True)
class Curve:
    """Area and volume of a basin by level.

    Attributes
    ----------
    levels, area, volume : arrays of one shape; m2 and m3
    unit : of the levels
    opens : first level of which the figures are lower limits; infinity if none
    """

    title: str
    levels: NDArray[np.float64]
    area: NDArray[np.float64]
    volume: NDArray[np.float64]
    unit: str
    opens: float
    height: float = 0.8 * WIDTH  # inches
    key_height: float = 0.3

    @classmethod
    def of(cls, title: str, table: Table) -> Curve | None:
        """The curve in a table of the columns level, unit, area_m2, volume_m3; None if no such."""
        frame = table.frame
        if not (set(frame.columns) >= _COLUMNS and len(frame) > 1):
            return None
        level, area, volume = (
            frame[name].to_numpy(float) for name in ("level", "area_m2", "volume_m3")
        )
        opened = level[frame["open"].to_numpy(bool)] if "open" in frame else level[:0]
        unit = str(frame["unit"].iloc[0])
        return cls(title, level, area, volume, unit, float(opened.min(initial=np.inf)))


def show_curve(figure: Figure, curve: Curve, place: Place) -> None:
    """Draw the level upwards, the area along the lower axis and the volume along the upper one."""
    left, bottom, width, height = place.map
    axes = figure.add_axes(fractions(figure, (left, bottom, width, height - 0.3)))
    above = axes.twiny()
    _line(axes, curve.area, curve.levels, _AREA, "area", "m²")
    _line(above, curve.volume, curve.levels, _VOLUME, "volume", "m³")
    if curve.opens <= curve.levels[-1]:
        axes.axhspan(curve.opens, curve.levels[-1], color=_OPEN, alpha=0.4, lw=0, zorder=0)
    name = LENGTHS.get(curve.unit, curve.unit)
    axes.set_ylabel(f"level, {name}" if name else "level", fontsize=7.5, color=INK)
    axes.set_title(curve.title, fontsize=10, color=INK, loc="left", pad=28, fontweight="bold")
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_ylim(curve.levels[0], curve.levels[-1])
    axes.grid(color="#e4e4e4", lw=0.5)


def _line(
    axes: Axes,
    values: NDArray[np.float64],
    levels: NDArray[np.float64],
    colour: str,
    name: str,
    unit: str,
) -> None:
    """One line on its own axis, in the largest unit that keeps its numbers above one."""
    size, word = next(u for u in reversed(_UNITS) if values.max() >= u[0] or u[0] == 1)
    axes.plot(values / size, levels, color=colour, lw=1.4)
    axes.set_xlim(left=0)
    axes.set_xlabel(f"{name}, {word}{unit}", fontsize=7.5, color=colour)
    axes.tick_params(labelsize=6.5, colors="#6a6a6a", length=2.5, width=0.5, pad=2)
    axes.tick_params(axis="x", colors=colour)
    axes.spines[:].set_color("#9a9a9a")


@dataclass(frozen=True)
class Sweep:
    """How many planes are found with each tolerance, and the share of points on them.

    Attributes
    ----------
    tolerances, planes, share : arrays of one shape; metres, numbers, percent
    knee : tolerance that was chosen, if one was
    """

    title: str
    tolerances: NDArray[np.float64]
    planes: NDArray[np.float64]
    share: NDArray[np.float64]
    knee: float | None
    height: float = 0.7 * WIDTH  # inches
    key_height: float = 0.3

    @classmethod
    def of(cls, title: str, table: Table) -> Sweep | None:
        """The sweep in a table of the columns tolerance, planes, share, knee; None if no such."""
        frame = table.frame
        if not (set(frame.columns) >= _SWEEP and len(frame) > 1):
            return None
        steps, planes, share = (frame[n].to_numpy(float) for n in ("tolerance", "planes", "share"))
        chosen = frame["tolerance"][frame["knee"].to_numpy(bool)]
        return cls(title, steps, planes, share, float(chosen.iloc[0]) if len(chosen) else None)


def show_sweep(figure: Figure, sweep: Sweep, place: Place) -> None:
    """Draw the planes along the left axis and the share along the right one."""
    left, bottom, width, height = place.map
    axes = figure.add_axes(fractions(figure, (left, bottom, width - 0.35, height)))
    beside = axes.twinx()
    centimetres = 100 * sweep.tolerances
    axes.plot(centimetres, sweep.planes, color=_AREA, lw=1.4, marker="o", ms=3)
    beside.plot(centimetres, sweep.share, color=_VOLUME, lw=1.4, marker="o", ms=3)
    if sweep.knee is not None:
        axes.axvline(100 * sweep.knee, color=INK, lw=0.8, ls="--")
    for own, name, colour in ((axes, "planes", _AREA), (beside, "points on planes, %", _VOLUME)):
        own.set_ylabel(name, fontsize=7.5, color=colour)
        own.tick_params(labelsize=6.5, colors="#6a6a6a", length=2.5, width=0.5, pad=2)
        own.tick_params(axis="y", colors=colour)
        own.spines[:].set_color("#9a9a9a")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("tolerance, cm; dashed: the knee", fontsize=7.5, color=INK)
    axes.set_title(sweep.title, fontsize=10, color=INK, loc="left", pad=6, fontweight="bold")
    axes.grid(color="#e4e4e4", lw=0.5)
