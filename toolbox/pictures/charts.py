"""Charts on a matplotlib figure: histograms and curves from tables, profiles along lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from toolbox.data import Table, Vector
from toolbox.data.crs import LENGTHS, short_height_unit
from toolbox.declare.show import Axis, Curve, Histogram, Profile
from toolbox.pictures.maps import INK, LEFT, WIDTH, Place, fractions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INSIDE, _BEYOND, _ALONG = "#7f9fbf", "#c9c9c9", "#1f3a5f"
_LINES, _OPEN = ("#c4742b", "#2f6da8"), "#c9c9c9"
_SIZES = (1.0, ""), (1e3, "1000 "), (1e6, "million ")  # of the axes, below a thousand of them
_FEWEST_BINS, _FEWEST_ROWS = 3, 2

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Bars:
    """A histogram; the first and the last bin count all values beyond the edges.

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
    def of(cls, title: str, table: Table, show: Histogram) -> Bars | None:
        """The histogram of a table; None if it has too few rows."""
        frame = table.frame
        if len(frame) < _FEWEST_BINS:
            return None
        edges = [float(value) for value in frame[show.high][:-1]]
        return cls(title, edges, [*frame[show.count]], _unit(table, show.unit_in))

    def draw_on(self, figure: Figure, place: Place) -> None:
        """Draw the bars; the open bins are grey, and as wide as their neighbours."""
        axes = figure.add_axes(fractions(figure, place.map))
        edges = np.array(self.edges)
        steps = np.diff(edges)
        left = np.concatenate([[edges[0] - steps[0]], edges])
        width = np.concatenate([steps[:1], steps, steps[-1:]])
        colours = [_BEYOND, *[_INSIDE] * len(steps), _BEYOND]
        axes.bar(left, self.counts, width, align="edge", color=colours, edgecolor="white", lw=0.3)
        if left[0] < 0 < left[-1]:
            axes.axvline(0, color=INK, lw=0.8)
        text = f"{self.unit}; grey: all beyond".removeprefix("; ")
        axes.set_xlabel(text, fontsize=7.5, color=INK)
        _plain(axes, self.title)


@dataclass(frozen=True)
class Sections:
    """Profiles: values over the distance along lines.

    Attributes
    ----------
    lines : of each line how far its points are along it, and their values, arrays of shape (n,)
    labels : of the way and of the values
    """

    title: str
    lines: Sequence[tuple[Array, Array]]
    labels: tuple[str, str]
    height: float = 0.7 * WIDTH  # inches
    key_height: float = 0.3

    @classmethod
    def of(cls, title: str, layer: Vector, show: Profile) -> Sections | None:
        """The profiles of a layer of points on lines; None if no point has a value."""
        frame = layer.frame
        if not frame[show.across].notna().any():
            return None
        lines = [
            (own[show.along].to_numpy(float), own[show.across].to_numpy(float))
            for _, own in frame.groupby(show.line)
        ]
        unit = short_height_unit(layer.crs)
        text = f" ({unit})" if unit else ""
        note = f", {show.note}" if show.note else ""
        labels = f"{show.along}{text}", f"{show.across}{text}{note}"
        return cls(f"{title} along the line", lines, labels)

    def draw_on(self, figure: Figure, place: Place) -> None:
        """Draw the values of each line over the distance from its beginning."""
        axes = figure.add_axes(fractions(figure, place.map))
        for along, values in self.lines:
            axes.plot(along, values, lw=0.8, color=_ALONG)
        axes.axhline(0, color=INK, lw=0.8)
        axes.set_xlabel(self.labels[0], fontsize=7.5, color=INK)
        axes.set_ylabel(self.labels[1], fontsize=7.5, color=INK, labelpad=1)
        _plain(axes, self.title)


def _plain(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10, color=INK, loc="left", pad=6, fontweight="bold")
    axes.tick_params(labelsize=6.5, colors="#6a6a6a", length=2.5, width=0.5, pad=2)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)


@dataclass(frozen=True)
class Line:
    """The values of an axis with their limits, if there are any, and its label."""

    values: Array
    label: str
    from_zero: bool = False
    limits: tuple[Array, Array] | None = None

    @classmethod
    def of(cls, table: Table, axis: Axis, *, scaled: bool) -> Line:
        """An axis from a column of a table.

        Parameters
        ----------
        scaled : in the largest unit that keeps the numbers above one
        """
        values = table.frame[axis.column].to_numpy(float) * axis.factor
        unit = _unit(table, axis.unit_in) if axis.unit_in else axis.unit
        unit = LENGTHS.get(unit, unit)
        size, word = _SIZES[0]
        if scaled and unit:
            size, word = next(s for s in reversed(_SIZES) if values.max() >= s[0] or s[0] == 1)
        label = f"{axis.label}, {word}{unit}" if unit else axis.label
        if axis.limits is None or not set(axis.limits) <= set(table.names):
            return cls(values / size, label, axis.from_zero)
        low, high = (table.frame[n].to_numpy(float) * axis.factor / size for n in axis.limits)
        return cls(values / size, f"{label} (band: 95 %)", axis.from_zero, (low, high))


@dataclass(frozen=True)
class Curves:
    """One or two curves over a column of a table.

    Attributes
    ----------
    upright : `over` goes upwards, the lines to the right
    dashed : value of `over` where a dashed line is drawn
    shaded : from which value of `over` on the ground is grey; infinity if from none
    """

    title: str
    over: Line
    lines: Sequence[Line]
    upright: bool
    dots: bool
    dashed: float | None
    shaded: float
    key_height: float = 0.3

    @classmethod
    def of(cls, title: str, table: Table, show: Curve) -> Curves | None:
        """The curves of a table; None if it has too few rows."""
        frame = table.frame
        if len(frame) < _FEWEST_ROWS:
            return None
        over = Line.of(table, show.over, scaled=False)
        marked = over.values[frame[show.dashed].to_numpy(bool)] if show.dashed else over.values[:0]
        beyond = over.values[frame[show.shaded].to_numpy(bool)] if show.shaded else over.values[:0]
        return cls(
            title,
            Line(over.values, over.label + _meaning(show, bool(len(beyond)))),
            [Line.of(table, axis, scaled=True) for axis in show.lines],
            show.upright,
            show.dots,
            float(marked[0]) if len(marked) else None,
            float(beyond.min(initial=np.inf)),
        )

    @property
    def height(self) -> float:
        """Height of the chart in inches."""
        return (0.8 if self.upright else 0.7) * WIDTH

    def draw_on(self, figure: Figure, place: Place) -> None:
        """Draw the curves, the second one with an axis on the opposite side."""
        left, bottom, width, height = place.map
        two, over = len(self.lines) == 2, self.over.values
        if self.upright:
            height -= 0.3 * two
        else:
            width -= 0.35 * two
        axes = figure.add_axes(fractions(figure, (left, bottom, width, height)))
        sides = [axes, *([axes.twiny() if self.upright else axes.twinx()] if two else [])]
        for side, line, colour in zip(sides, self.lines, _LINES, strict=False):
            self._draw_line(side, line, colour)
        if self.dashed is not None:
            (axes.axhline if self.upright else axes.axvline)(
                self.dashed, color=INK, lw=0.8, ls="--"
            )
        if self.shaded <= over[-1]:
            span = axes.axhspan if self.upright else axes.axvspan
            span(self.shaded, over[-1], color=_OPEN, alpha=0.4, lw=0, zorder=0)
        if self.upright:
            axes.ticklabel_format(axis="y", useOffset=False)
            axes.set_ylim(over[0], over[-1])
        (axes.set_ylabel if self.upright else axes.set_xlabel)(
            self.over.label, fontsize=7.5, color=INK
        )
        pad = 28 if self.upright and two else 6
        axes.set_title(self.title, fontsize=10, color=INK, loc="left", pad=pad, fontweight="bold")
        axes.grid(color="#e4e4e4", lw=0.5)
        _keep_right_of(figure, left - LEFT, sides)

    def _draw_line(self, axes: Axes, line: Line, colour: str) -> None:
        dots = {"marker": "o", "ms": 3.0} if self.dots else {}
        pair = (line.values, self.over.values) if self.upright else (self.over.values, line.values)
        axes.plot(*pair, color=colour, lw=1.4, **dots)  # type: ignore[arg-type]
        if line.limits is not None:
            fill = axes.fill_betweenx if self.upright else axes.fill_between
            fill(self.over.values, *line.limits, color=colour, alpha=0.2, lw=0)
        if line.from_zero:
            axes.set(xlim=(0, None)) if self.upright else axes.set(ylim=(0, None))
        (axes.set_xlabel if self.upright else axes.set_ylabel)(
            line.label, fontsize=7.5, color=colour, labelpad=1
        )
        axes.tick_params(labelsize=6.5, colors="#6a6a6a", length=2.5, width=0.5, pad=2)
        axes.tick_params(axis="x" if self.upright else "y", colors=colour)
        axes.spines[:].set_color("#9a9a9a")


def _keep_right_of(figure: Figure, edge: float, sides: Sequence[Axes]) -> None:
    """Make axes narrower whose texts reach beyond an edge, in inches: levels have many digits."""
    found = sides[0].get_tightbbox()
    beyond = edge - found.x0 / figure.dpi if found else 0.0
    if beyond > 0:
        share, box = beyond / figure.get_figwidth(), sides[0].get_position()
        for side in sides:
            side.set_position((box.x0 + share, box.y0, box.width - share, box.height))


def _meaning(show: Curve, grey: bool) -> str:
    """What the dashed line and the grey ground of a chart stand for."""
    dashed = f"; dashed: the {show.dashed}" if show.dashed else ""
    return f"{dashed}; grey: {show.shaded_as or show.shaded}" if grey else dashed


def _unit(table: Table, column: str) -> str:
    """The unit of a table, from the first row of a column; "" without a column."""
    return str(table.frame[column].iloc[0]) if column else ""
