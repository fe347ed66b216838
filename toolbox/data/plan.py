"""Sheets of lines and texts to scale, which are printed as they are: elevations with dimensions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from toolbox.context import Context
from toolbox.data import dxf
from toolbox.data.drawing import Drawing, Panel
from toolbox.data.layer import text_array

if TYPE_CHECKING:
    import geopandas
    from matplotlib.figure import Figure

    from toolbox.data.report import Column, Section

PAPERS: Mapping[str, tuple[float, float]] = {
    "A4": (297.0, 210.0),
    "A3": (420.0, 297.0),
    "A2": (594.0, 420.0),
    "A1": (841.0, 594.0),
    "A0": (1189.0, 841.0),
}
"""Width and height of sheets in millimetres, ISO 216."""

MARGIN = 10.0  # mm from the edge of the sheet to its frame, ISO 5457
_CAPITAL = 0.73  # height of a capital over the size of the letters that matplotlib writes
_INCH = 25.4  # mm
_ACROSS = 2000  # pixels of the picture that a report has of a sheet


@dataclass(frozen=True)
class Pen:
    """How the lines of a layer look: millimetres on paper, colour, and whether they are broken."""

    width: float
    colour: str = "#000000"
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Plan(Drawing):
    """A sheet to scale with lines and texts, as `Vector` has them for a DXF.

    Attributes
    ----------
    frame : lines, and points with the attributes text, angle and text_height, each with a layer; a
        straight line with a text is a dimension
    paper : a name in `PAPERS`
    pens : by layer; others are thin and black

    Examples
    --------
    >>> import geopandas
    >>> lines = geopandas.GeoDataFrame({"layer": ["walls"]}, geometry=[shapely.box(0, 0, 9, 6)])
    >>> Plan("House", (), (), scale=100, frame=lines)
    <Drawing in memory: 'House', 1:100 on A3>
    """

    frame: geopandas.GeoDataFrame | None = None
    paper: str = "A3"
    pens: Mapping[str, Pen] = field(default_factory=dict)

    def __repr__(self) -> str:
        return (
            f"<Drawing {self.name or 'in memory'}: {self.title!r}, "
            f"1:{self.chosen_scale} on {self.paper}>"
        )

    def with_head(self, head: Mapping[str, str]) -> Plan:
        """The sheet with the title, client and date of the set in its title block."""
        from toolbox.data.vector import Vector

        return replace(self, frame=Vector(self.frame).with_head(head).frame)

    def _write_pdf(self, path: Path, ctx: Context) -> None:
        from matplotlib.backends.backend_pdf import PdfPages

        with PdfPages(path, metadata={"CreationDate": None}) as pages:
            pages.savefig(self._sheet(()))

    def _write_dxf(self, path: Path) -> None:
        dxf.write(self._rows, path, "drawing")

    @property
    def _rows(self) -> geopandas.GeoDataFrame:
        assert self.frame is not None
        return self.frame

    def _sheet(self, panels: Sequence[Panel]) -> Figure:
        """The sheet with what is drawn in the middle of it: its frame, if that is drawn."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        wide, high = PAPERS[self.paper]
        figure = Figure(figsize=(wide / _INCH, high / _INCH), facecolor="white")
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        mm = self._mm(self.chosen_scale)
        west, south, east, north = self._rows.total_bounds
        x0, y0 = (west + east - wide / mm) / 2, (south + north - high / mm) / 2
        axes.set(xlim=(x0, x0 + wide / mm), ylim=(y0, y0 + high / mm))
        for row in self._rows.to_dict("records"):
            self._draw_row(axes, row, row[self._rows.geometry.name], mm)
        return figure

    def _draw_row(self, axes: Any, row: Mapping[Any, Any], shape: Any, mm: float) -> None:
        """A line, a text, or a dimension with its strokes and its text above it."""
        pen = self.pens.get(str(row["layer"]), Pen(0.18))
        text = row.get(dxf.TEXT) if isinstance(row.get(dxf.TEXT), str) else None
        xy = shapely.get_coordinates(shape)
        size = float(row.get(dxf.SIZE) or 0.0)
        angle = float(row.get(dxf.ANGLE) or 0.0)
        if len(xy) > 1:
            style = (0, (6, 4)) if pen.dashed else "-"
            axes.plot(*xy.T, color=pen.colour, linewidth=_points(pen.width), linestyle=style)
        if text is None:
            return
        anchor = "left" if row.get(dxf.ANCHOR) == "left" else "center"
        place = xy[0]
        if len(xy) == 2:
            along = xy[1] - xy[0]
            angle = math.degrees(math.atan2(along[1], along[0]))
            up = np.array([-along[1], along[0]]) / np.hypot(*along)
            place = xy.mean(axis=0) + up * dxf.shift_of(row) * size
            stroke = math.sqrt(2) * dxf.TICK * size * _turned(angle + 45.0)
            for end in xy:
                line = np.array([end - stroke, end + stroke])
                axes.plot(*line.T, color=pen.colour, linewidth=_points(2 * pen.width))
        axes.text(
            *place,
            text.replace("$", r"\$"),
            size=_points(size * mm / _CAPITAL),
            color=pen.colour,
            rotation=angle,
            rotation_mode="anchor",
            ha=anchor,
            va="center_baseline",
        )

    # What every layer answers, see toolbox.data.layer ---------------------------------------------

    def size(self, inside: Any = None) -> int | None:
        """One sheet; none without anything on it."""
        return min(1, len(self._rows)) if inside is None else None

    def contents(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Lines and texts."""
        rows = self._rows.drop(columns=self._rows.geometry.name).to_csv(index=False)
        yield "drawing", text_array(repr((self.title, self.scale, self.paper)) + rows)
        for number, wkb in enumerate(shapely.to_wkb(self._rows.geometry.to_numpy())):
            yield f"line {number}", np.frombuffer(wkb, np.uint8)

    def page_sections(
        self, title: str, help: str, columns: Mapping[str, Column] = MappingProxyType({})
    ) -> tuple[Section, ...]:
        """The sheet as an image."""
        import io

        from toolbox.data.report import Figure as Image
        from toolbox.data.report import Section

        if not self.size():
            return ()
        made = io.BytesIO()
        sheet = self._sheet(())
        dpi = _ACROSS / sheet.get_size_inches()[0]
        sheet.savefig(made, dpi=dpi, format="png", metadata={"Software": None})
        return (Section(title, [Image(made.getvalue(), help)]),)


def _points(mm: float) -> float:
    """Millimetres as the points of a printer."""
    return mm * 72 / _INCH


def _turned(degrees: float) -> NDArray[np.float64]:
    return np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
