"""Drawings of sections to scale, which are written as SVG, PDF, PNG or DXF."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.context import QUIET, Context
from toolbox.data import dxf
from toolbox.data.crs import crs_of, metres_per_unit, short_height_unit
from toolbox.data.layer import Layer, text_array
from toolbox.data.reading import errors_named
from toolbox.data.record import CHUNK, own_side_car, side_car, write_beside
from toolbox.data.writing import followed, refuse_to_replace
from toolbox.errors import DataError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from toolbox.data.report import Column, Section

SCALES = (20, 50, 100, 200, 250, 500, 1000, 2000, 2500, 5000, 10_000, 25_000, 50_000)
"""Scales that are chosen from, as 1 : n."""

_WIDEST, _HIGHEST = 380.0, 240.0  # mm of a section whose scale is chosen: the frame of a sheet A3
_LEFT, _RIGHT, _TOP, _BOTTOM = 20.0, 8.0, 12.0, 14.0  # mm around a section
_KEY = 9.0  # mm for the line with scale and colours
_LARGEST = 5000.0  # mm of a sheet: what a roll of paper and readers of PDF bear
_DPI = 200  # of a PNG, and of the points in a PDF or SVG
_PIXELS = 100_000_000  # of a PNG; more are taken for a mistake in the scale
_APART = 8.0  # mm between two lines of the grid at least
_MARK = 0.5  # mm, size of a point on paper
_INK, _GRID = "#222222", "#d9d9d9"

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Panel:
    """One section of a drawing.

    Attributes
    ----------
    title : above it
    length : of the section, in the unit of the drawing
    origin : what the axis says at its beginning: a length along the section
    xy : points of shape (n, 2), length along the section and height
    group : array of shape (n,), index among the groups of the drawing
    lines : of shape (k, 2) each, the surface
    """

    title: str
    length: float
    origin: float
    xy: Array
    group: NDArray[np.integer[Any]]
    lines: Sequence[Array] = ()

    @property
    def heights(self) -> tuple[float, float]:
        """Lowest and highest height; 0 without any."""
        found = np.concatenate([self.xy[:, 1], *(line[:, 1] for line in self.lines)])
        return (float(found.min()), float(found.max())) if len(found) else (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Drawing(Layer):
    """Sections to scale, one below the other.

    Attributes
    ----------
    title : above all
    panels : the sections
    groups : name and colour (#rrggbb) of each group of points
    crs : whose unit lengths and heights have; plain metres if None
    scale : 1 : n on paper; one that fits a sheet A3 unless given
    exaggeration : of heights over lengths

    Examples
    --------
    >>> points = np.array([[0.0, 5.0], [40.0, 7.0]])
    >>> panel = Panel("A", 50.0, 0.0, points, np.zeros(2, int))
    >>> drawing = Drawing("Road", (panel,), (("Ground", "#c2a477"),))
    >>> drawing.chosen_scale
    200
    >>> drawing
    <Drawing in memory: 'Road', 1 sections, 1:200>
    """

    title: str
    panels: tuple[Panel, ...]
    groups: tuple[tuple[str, str], ...]
    crs: CRS | None = None
    scale: int | None = None
    exaggeration: float = 1.0
    name: str = ""

    SUFFIXES: ClassVar[tuple[str, ...]] = (".pdf", ".svg", ".png", ".dxf")
    HEADED: ClassVar[tuple[str, ...]] = SUFFIXES

    def __post_init__(self) -> None:
        object.__setattr__(self, "crs", crs_of(self.crs))

    def __repr__(self) -> str:
        size = f"{self.title!r}, {len(self.panels)} sections, 1:{self.chosen_scale}"
        return f"<Drawing {self.name or 'in memory'}: {size}>"

    @classmethod
    def open(cls, path: str | Path, *, ctx: Context = QUIET) -> Drawing:
        """Refuse: a drawing is for people, and its points are written to a file of their own.

        Raises
        ------
        DataError
            Always.
        """
        raise DataError(f"{path}: drawings are written, not read")

    @classmethod
    def own_files(cls, path: str | Path) -> tuple[Path, ...]:
        """The file at a path, and the record beside it."""
        return Path(path), *own_side_car(path)

    @property
    def metre(self) -> float:
        """Length of one metre in the unit of the drawing."""
        return 1 / metres_per_unit(self.crs)

    @property
    def chosen_scale(self) -> int:
        """The scale, as 1 : n."""
        if self.scale is not None:
            return self.scale
        wide = max((panel.length for panel in self.panels), default=0.0) / _WIDEST
        tall = [high - low for low, high in (panel.heights for panel in self.panels)]
        high = max(tall, default=0.0) * self.exaggeration / _HIGHEST
        fits = (scale for scale in SCALES if max(wide, high) * self._mm(scale) <= 1)
        return next(fits, SCALES[-1])

    def _mm(self, scale: int) -> float:
        """Millimetres on paper for one unit of length."""
        return 1000 / self.metre / scale

    def save(
        self,
        path: str | Path,
        *,
        head: Mapping[str, str] = MappingProxyType({}),
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write a PDF with a page for each section, an SVG or PNG of all, or a DXF.

        A DXF has the unit of the data, heights as they are at the first section, and the others
        below it; its layers are the groups of points. The same drawing makes the same bytes.

        Parameters
        ----------
        path : ends in .pdf, .svg, .png or .dxf
        head : title, client and date, for a drawing that has places for them
        overwrite : whether files at the path may be replaced
        record : how the file was made, as JSON text
        ctx : where to report progress

        Raises
        ------
        ParameterError
            A file is there that may not be replaced.
        DataError
            The suffix is another, or the sheet would be too large.
        """
        if head:
            self.with_head(head).save(path, overwrite=overwrite, record=record, ctx=ctx)
            return
        path = followed(path)
        suffix = path.suffix.lower()
        if suffix not in self.SUFFIXES:
            raise DataError(f"{path}: drawings are written as {', '.join(self.SUFFIXES)}")
        refuse_to_replace(path, self.own_files, overwrite=overwrite)
        with errors_named(f"{path} cannot be written"):
            if suffix == ".dxf":
                self._write_dxf(path)
            elif suffix == ".pdf":
                self._write_pdf(path, ctx)
            else:
                texts: dict[str, Any] = {"Date" if suffix == ".svg" else "Software": None}
                texts |= {CHUNK: record} if suffix == ".png" and record else {}
                self._save(self._sheet(self.panels), path, texts)
            if side_car(path):
                write_beside(path, record)
        ctx.progress(1.0)

    def _write_dxf(self, path: Path) -> None:
        dxf.write_entities(path, self._entities(), self.crs, dict(self.groups))

    def _write_pdf(self, path: Path, ctx: Context) -> None:
        from matplotlib.backends.backend_pdf import PdfPages

        with PdfPages(path, metadata={"CreationDate": None}) as pages:
            for number, panel in enumerate(self.panels):
                ctx.progress(number / len(self.panels))
                pages.savefig(self._sheet((panel,)), dpi=_DPI)

    def _save(self, figure: Figure, path: Path, texts: Mapping[str, Any]) -> None:
        import matplotlib

        width, height = figure.get_size_inches() * _DPI
        if path.suffix.lower() == ".png" and width * height > _PIXELS:
            raise DataError(f"it would have {width:.0f} x {height:.0f} pixels; write .pdf or .svg")
        with matplotlib.rc_context({"svg.hashsalt": "drawing", "svg.fonttype": "none"}):
            figure.savefig(path, dpi=_DPI, metadata=dict(texts))

    def _sheet(self, panels: Sequence[Panel]) -> Figure:
        """A sheet just as large as its sections, one below the other."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        scale = self.chosen_scale
        mm = self._mm(scale)
        up = mm * self.exaggeration
        step = _grid_step(up)
        boxes = [_box(panel, step) for panel in panels]
        width = max(panel.length for panel in panels) * mm + _LEFT + _RIGHT
        tall = [(high - low) * up for low, high in boxes]
        height = sum(tall) + (_TOP + _BOTTOM) * len(panels) + _KEY
        if max(width, height) > _LARGEST:
            raise DataError(
                f"the sheet would be {width / 1000:.1f} m wide and {height / 1000:.1f} m high; "
                "take a smaller scale (a larger number), or .pdf with a page for each section"
            )
        figure = Figure(figsize=(width / 25.4, height / 25.4), facecolor="white")
        FigureCanvasAgg(figure)
        self._write_key(figure, scale, width, height)
        top = height - _KEY
        for panel, box, high in zip(panels, boxes, tall, strict=True):
            bottom = top - _TOP - high
            place = (_LEFT / width, bottom / height, panel.length * mm / width, high / height)
            self._draw(figure, panel, box, place, _grid_step(mm), step)
            top = bottom - _BOTTOM
        return figure

    def _write_key(self, figure: Figure, scale: int, width: float, height: float) -> None:
        """Title and scale, and the colours of the groups that are there."""
        text = f"{self.title}    1 : {scale}"
        if self.exaggeration != 1:
            text += f"  (heights 1 : {scale / self.exaggeration:g})"
        line = 1 - 0.5 * _KEY / height
        figure.text(_LEFT / width, line, text, size=8, color=_INK, va="center", weight="bold")
        used = np.unique(np.concatenate([panel.group for panel in self.panels])).astype(int)
        shown = [self.groups[number] for number in used]
        place = (width - _RIGHT) / width
        for label, colour in reversed(shown):
            if place * width < _LEFT + 2.0 * len(text):  # some 2 mm for a letter of the title
                break
            figure.text(place, line, f"● {label}", size=6, color=colour, va="center", ha="right")
            place -= (1.25 * len(label) + 6) / width

    def _draw(
        self,
        figure: Figure,
        panel: Panel,
        box: tuple[float, float],
        place: tuple[float, float, float, float],
        step: float,
        step_up: float,
    ) -> None:
        from matplotlib.ticker import MultipleLocator

        axes = figure.add_axes(place)
        begin, end = panel.origin, panel.origin + panel.length
        axes.set(xlim=(begin, end), ylim=box)
        axes.xaxis.set_major_locator(MultipleLocator(step))
        axes.yaxis.set_major_locator(MultipleLocator(step_up))
        axes.grid(visible=True, color=_GRID, linewidth=0.4)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=6, colors=_INK, width=0.4, length=2)
        axes.ticklabel_format(useOffset=False, style="plain")
        unit = short_height_unit(self.crs)
        axes.set_ylabel(f"height [{unit}]" if unit else "height", size=6, color=_INK)
        axes.set_xlabel(f"length [{unit}]" if unit else "length", size=6, color=_INK)
        axes.set_title(panel.title, size=7, color=_INK, loc="left", pad=3)
        for spine in axes.spines.values():
            spine.set(linewidth=0.5, color=_INK)
        for number in np.unique(panel.group).astype(int):
            xy = panel.xy[panel.group == number]
            axes.scatter(
                panel.origin + xy[:, 0],
                xy[:, 1],
                s=(_MARK * 72 / 25.4) ** 2,
                c=self.groups[number][1],
                linewidths=0,
                rasterized=True,
            )
        for line in panel.lines:
            axes.plot(panel.origin + line[:, 0], line[:, 1], color=_INK, linewidth=0.7)

    def _entities(self) -> Iterator[dxf.Entity]:
        """Points, surface, frame and title of each section, one below the other."""
        below = 0.0
        for number, panel in enumerate(self.panels):
            low, high = panel.heights
            down = 0.0 if number == 0 else high - below
            title = panel.title + (f", heights less {down:.3f}" if number else "")
            move = np.array([panel.origin, -down])
            for group in np.unique(panel.group).astype(int):
                name = self.groups[group][0]
                yield dxf.Entity(name, panel.xy[panel.group == group] + move, points=True)
            for line in panel.lines:
                yield dxf.Entity("Surface", line + move)
            corner = np.array([panel.origin, low - down])
            frame = corner + np.array([[0, high - low], [0, 0], [panel.length, 0]])
            yield dxf.Entity("Frame", frame)
            yield dxf.Entity("Text", corner[None], title, panel.length / 60)
            below = low - down - panel.length / 10

    # What every layer answers, see toolbox.data.layer ---------------------------------------------

    def size(self, inside: Any = None) -> int | None:
        """Number of sections; None for a tile."""
        return len(self.panels) if inside is None else None

    def contents(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Points, lines and texts of all sections."""
        said = repr((self.title, self.groups, self.scale, self.exaggeration))
        yield "drawing", text_array(said + "".join(panel.title for panel in self.panels))
        for number, panel in enumerate(self.panels):
            yield f"points {number}", panel.xy
            yield from ((f"line {number} {k}", line) for k, line in enumerate(panel.lines))

    def page_sections(
        self, title: str, help: str, columns: Mapping[str, Column] = MappingProxyType({})
    ) -> tuple[Section, ...]:
        """The first sections as images."""
        import io

        from toolbox.data.report import Figure as Image
        from toolbox.data.report import Section

        images = []
        for panel in self.panels[:_ON_PAGE]:
            made = io.BytesIO()
            self._sheet((panel,)).savefig(made, dpi=_DPI, format="png", metadata={"Software": None})
            images.append(Image(made.getvalue(), panel.title))
        more = len(self.panels) - len(images)
        texts = [f"{more} more sections are in the drawing."] if more > 0 else []
        return (Section(title, [*images, *texts]),)

    def differences(self, now: Drawing) -> Iterator[str]:
        """Whether the drawing differs; it is not said where."""
        for (_, one), (_, other) in zip(self.contents(), now.contents(), strict=False):
            if not np.array_equal(one, other):
                yield "the drawing differs"
                return


_ON_PAGE = 6  # sections that a report shows


def _grid_step(mm: float) -> float:
    """The smallest of 1, 2, 5, 10, ... whose lines are far enough apart, given mm per unit."""
    least = _APART / mm
    size = 10.0 ** math.floor(math.log10(least))
    return next(f * size for f in (1, 2, 5, 10, 20) if f * size >= least * (1 - 1e-9))


def _box(panel: Panel, step: float) -> tuple[float, float]:
    """Heights at the lower and upper edge: whole steps of the grid around all points."""
    low, high = panel.heights
    bottom, top = math.floor(low / step) * step, math.ceil(high / step) * step
    return bottom, top if top > bottom else bottom + step
