"""The page of a clearance analysis: map, profiles of the spans, objects in order of urgency."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from algorithms.corridor._rules import KINDS, SEVERITIES, Rule
from algorithms.corridor._sag import Conductor, State
from algorithms.corridor._surroundings import Line, Object, Scene
from toolbox.context import QUIET, Context
from toolbox.data import Figure, Report, Rows, Section, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

MOST_PROFILES, MOST_OBJECTS, MOST_SPANS, MOST_NUMBERS = 100, 200, 400, 30
BESIDE = 20.0  # metres to both sides of a span that its profile shows
SHEET, MOST_SHEETS = 800.0, 20  # length of a sheet of the map, metres; longer if there were more
PIXEL = (0.4, 0.2)  # metres along and up: of what is in one of these, one point is drawn
MAP_PIXEL = 1.0  # metres
COLOURS = {
    "tree": "#4a9c4a", "building": "#b0703c", "other": "#7a5ea8", "unclassified": "#9a9a9a",
    "ground": "#c9b48a", "water": "#7fb2e0", "rail": "#6b6b6b", "road": "#8c8c8c",
}  # fmt: skip
SIGNS = {"critical": "#d40000", "warning": "#f08000", "watch": "#d8c000"}
LISTED = (
    *("object_id", "severity", "kind", "rule", "clearance", "required", "sd", "probability"),
    *("falls", "distance", "state", "span_id", "wire_id", "station", "height", "points"),
)
LIST_CAPTION = (
    "Lengths in metres, places as in the data. sd is the standard deviation of the clearance; "
    "falls is by how much a tree reaches beyond the wire when it falls towards it, below 0"
)
SPAN_CAPTION = "Least distances in space to what is near the wires in plan, m"
LABEL = {"pad": 0.4, "facecolor": "white", "edgecolor": "none", "alpha": 0.7}
STYLES = ("-", "--", ":", "-.")

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Spot = tuple[int, Object, Floats]  # number of an object, the object, its place in a picture


def report_of(
    scene: Scene,
    line: Line,
    rules: Sequence[Rule],
    objects: Sequence[Object],
    listed: pd.DataFrame,
    spans: Table,
    conductor: Conductor | None,
    ctx: Context = QUIET,
) -> Report:
    """Put the page together.

    Parameters
    ----------
    listed : the columns of the layer of objects, in the same order
    """
    across = _Across.of(scene, line)
    sections = [
        Section("Objects, the most urgent first", _list(listed)),
        Section("Map", _map(across, line, rules, objects, ctx.part(0.0, 0.3))),
        Section("Spans", [Rows(_span_list(spans), SPAN_CAPTION, MOST_SPANS)]),
        Section("Profiles", _profiles(across, line, rules, objects, ctx.part(0.3, 1.0))),
        Section("Rules", [Rows(_rule_table(rules), "Distances in metres")]),
        Section("Wires", [_wires_text(line, conductor)]),
        Section("Points that take no part", [_left_out(scene)] if scene.left_out else []),
    ]
    shown = [section for section in sections if section.blocks]
    summary = _summary(scene, line, rules, objects)
    return Report("Clearances of a power line", shown, summary=summary, name="clearance")


def _summary(scene: Scene, line: Line, rules: Sequence[Rule], objects: Sequence[Object]) -> str:
    if not line.spans:
        return "There are no wires, so nothing is too close to one."
    counts = {word: sum(rules[o.rule].severity == word for o in objects) for word in SEVERITIES}
    found = ", ".join(f"{count} {word}" for word, count in counts.items())
    text = f"{len(objects)} objects in {len(line.spans)} spans: {found}."
    if not np.isfinite(scene.height).any():
        text += "\nNo point is ground: heights are not known, and falling trees not looked for."
    doubtful = [rule.id for rule in rules if not rule.confirmed]
    if doubtful:
        text += (
            f"\nNot confirmed: the values of {', '.join(doubtful)}. They were not found in a "
            "document; look them up in the regulation before you rely on them."
        )
    return text


def _list(listed: pd.DataFrame) -> list[Rows | str]:
    if not len(listed):
        return ["Nothing breaks a rule."]
    frame = pd.DataFrame(listed[list(LISTED)])
    for axis in "xyz":
        frame[axis] = getattr(listed.geometry, axis)
    return [Rows(_rounded(frame), LIST_CAPTION, MOST_OBJECTS)]


def _span_list(spans: Table) -> Table:
    """The table of spans without columns that say nothing."""
    frame = spans.frame
    return _rounded(frame.drop(columns=[name for name in frame if frame[name].isna().all()]))


def _rounded(frame: pd.DataFrame) -> Table:
    """Centimetres are enough for people."""
    return Table(frame.round(dict.fromkeys(frame.select_dtypes("float").columns, 2)))


def _rule_table(rules: Sequence[Rule]) -> Table:
    return Table.from_rows(
        {
            "number": number, "rule": rule.id, "kind": rule.kind, "direction": rule.direction,
            "distance": round(rule.threshold, 3),
            "within": None if rule.direction == "3-D" else round(rule.within, 3),
            "severity": rule.severity, "confirmed": "yes" if rule.confirmed else "NO",
            "source": rule.source, "date": rule.date, "note": rule.note,
        }
        for number, rule in enumerate(rules, start=1)
    )  # fmt: skip


def _wires_text(line: Line, conductor: Conductor | None) -> str:
    states = ", ".join(_told(state) for state in line.states)
    text = f"States of the wires: {states}."
    if len(line.states) > 1 and line.open_spans:
        text += (
            f" Spans {', '.join(map(str, line.open_spans))} end without a tower: hot or in wind "
            "they are taken as held there, where in truth they hang on. Do not rely on these "
            "states near such ends."
        )
    if conductor is not None:
        text += (
            f" Conductor {conductor.name}: diameter {conductor.diameter * 1e3:.2f} mm, weight "
            f"{conductor.weight:.2f} N/m, stiffness {conductor.stiffness / 1e6:.2f} MN, expansion "
            f"{conductor.expansion * 1e6:.2f} per million and degree. Source: {conductor.source}."
        )
        if not conductor.confirmed:
            text += " Not confirmed: look these up in the data sheet of the conductor."
    return text


def _told(state: State) -> str:
    """A state with its numbers."""
    wind = f" by {abs(state.wind):g} m/s" if state.wind else ""
    warm = f" at {state.temperature:g} C" if state.wind and state.temperature is not None else ""
    return state.name + wind + warm


def _left_out(scene: Scene) -> str:
    return "\n".join(f"{count} points {why}" for why, count in scene.left_out.items())


def _pixels(across: Floats, up: Floats, size: tuple[float, float]) -> tuple[Floats, Floats]:
    """One place for all points in a pixel, in the same order whatever that of the points."""
    cells = np.unique(np.floor(np.column_stack([across / size[0], up / size[1]])), axis=0)
    return (cells[:, 0] + 0.5) * size[0], (cells[:, 1] + 0.5) * size[1]


def _canvas(width: float, height: float) -> tuple[Canvas, Axes]:
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(width, height))
    return canvas, canvas.add_subplot()


def _png(canvas: Canvas) -> bytes:
    stream = io.BytesIO()
    canvas.savefig(stream, format="png")
    return stream.getvalue()


@dataclass(frozen=True)
class _Across:
    """The points in order along the longer side of the line, to have those of a stretch at once.

    Attributes
    ----------
    side : 0 if that is x, 1 if it is y
    order : array of shape (n,), indices of points
    along : array of shape (n,), their coordinates on that side, rising
    """

    scene: Scene
    side: int
    order: Ints
    along: Floats

    @classmethod
    def of(cls, scene: Scene, line: Line) -> _Across:
        side = int(np.ptp(_ends(line), axis=0).argmax()) if line.spans else 0
        order = np.argsort(scene.xyz[:, side], kind="stable")
        return cls(scene, side, order, scene.xyz[order, side])

    def between(self, low: float, high: float) -> tuple[Floats, NDArray[np.int8]]:
        """Places and kinds of the points of a stretch that are of a kind."""
        first, last = np.searchsorted(self.along, (low, high))
        some = self.order[first:last]
        some = some[self.scene.kind[some] >= 0]
        return self.scene.xyz[some], self.scene.kind[some]


def _ends(line: Line) -> Floats:
    """Both ends of each wire in plan."""
    return np.concatenate([c.points(np.array([0.0, c.length]))[:, :2] for c in line.curves[0]])


def _map(
    across: _Across, line: Line, rules: Sequence[Rule], objects: Sequence[Object], ctx: Context
) -> list[Figure]:
    """Wires, objects, and what stands around them: sheet by sheet along the line."""
    if not line.spans:
        return []
    first, last = _ends(line)[:, across.side].min(), _ends(line)[:, across.side].max()
    count = min(max(math.ceil((last - first) / SHEET), 1), MOST_SHEETS)
    edges = np.linspace(first, last, count + 1)
    way = ("from west to east", "from south to north")[across.side]
    figures = []
    for k in range(count):
        ctx.progress(k / count)
        if png := _sheet(across, line, rules, objects, *edges[k : k + 2]):
            sheet = f"; sheet {k + 1} of {count}, {way}" if count > 1 else ""
            caption = f"Wires in plan, and objects with their number in the list{sheet}"
            figures.append(Figure(png, caption))
    return figures


def _sheet(
    across: _Across, line: Line, rules: Sequence[Rule], objects: Sequence[Object],
    first: float, last: float,
) -> bytes:  # fmt: skip
    """A picture of the stretch of the line between two coordinates; none where no wire is."""
    wires = [
        (span, curve.points(np.linspace(0.0, curve.length, 50))[:, :2])
        for curve, span in zip(line.curves[0], line.span.tolist(), strict=True)
    ]
    side = across.side
    wires = [(n, xy) for n, xy in wires if xy[:, side].max() >= first and xy[:, side].min() <= last]
    if not wires:
        return b""
    seen = np.concatenate([xy for _, xy in wires])
    low, high = seen.min(axis=0) - BESIDE, seen.max(axis=0) + BESIDE
    low[side], high[side] = first - BESIDE, last + BESIDE
    wide, tall = high - low
    canvas, axes = _canvas(10.0, min(max(8.5 * tall / wide + 0.7, 2.0), 10.0))
    canvas.set_layout_engine("constrained")
    _surroundings(axes, across, low, high)
    _draw_wires(axes, wires)
    places = [across.scene.xyz[one.nearest, :2] for one in objects]
    spots = list(zip(range(1, len(objects) + 1), objects, places, strict=True))
    _mark(axes, rules, [s for s in spots if (s[2] >= low).all() and (s[2] <= high).all()])
    axes.set_aspect("equal")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    _legend(axes)
    axes.set_xlabel(f"m from x = {line.origin[0]:.0f}")
    axes.set_ylabel(f"m from y = {line.origin[1]:.0f}")
    return _png(canvas)


def _draw_wires(axes: Axes, wires: Sequence[tuple[int, Floats]]) -> None:
    """Wires in plan, each with its span, whose number is written once."""
    middles: dict[int, list[Floats]] = {}
    for span, xy in wires:
        axes.plot(*xy.T, "-", color="#333333", linewidth=0.6, zorder=2)
        middles.setdefault(span, []).append(xy[len(xy) // 2])
    for span, some in middles.items():
        axes.annotate(
            f"span {span}", tuple(np.mean(some, axis=0)), fontsize=7, color="#0040a0", zorder=4,
            annotation_clip=True,
        )  # fmt: skip


def _surroundings(axes: Axes, across: _Across, low: Floats, high: Floats) -> None:
    """What is no ground in a window in plan."""
    xyz, kinds = across.between(low[across.side], high[across.side])
    inside = ((xyz[:, :2] >= low) & (xyz[:, :2] <= high)).all(axis=1)
    size = max(MAP_PIXEL, float((high - low).max()) / 900)
    for number, kind in reversed(list(enumerate(KINDS))):
        some = xyz[inside & (kinds == number)]
        if kind != "ground" and len(some):
            x, y = _pixels(some[:, 0], some[:, 1], (size, size))
            axes.plot(x, y, ",", color=COLOURS[kind], alpha=0.6, zorder=1)


def _mark(axes: Axes, rules: Sequence[Rule], spots: Sequence[Spot]) -> None:
    """Objects where they are closest, with the numbers of the first."""
    for severity, colour in SIGNS.items():
        own = [place for _, one, place in spots if rules[one.rule].severity == severity]
        if own:
            x, y = np.array(own).T
            axes.plot(x, y, "o", markersize=4, color=colour, markeredgecolor="black",
                      markeredgewidth=0.4, label=severity, zorder=5)  # fmt: skip
    for number, _, place in spots[:MOST_NUMBERS]:
        axes.annotate(str(number), tuple(place), xytext=(3, 3), textcoords="offset points",
                      fontsize=7, bbox=LABEL, zorder=6)  # fmt: skip


def _legend(axes: Axes) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False, markerscale=2
        )


def _profiles(
    across: _Across, line: Line, rules: Sequence[Rule], objects: Sequence[Object], ctx: Context
) -> list[Figure | str]:
    """One picture per span, the most urgent first."""
    urgent = [int(line.span[one.wire]) for one in objects]
    order = list(dict.fromkeys([*urgent, *line.spans]))
    shown: list[Figure | str] = []
    for k, span in enumerate(order[:MOST_PROFILES]):
        ctx.progress(k / len(order))
        shown.append(_profile(across, line, rules, objects, span))
    if len(order) > MOST_PROFILES:
        shown.append(f"Profiles of the {len(order) - MOST_PROFILES} other spans are not shown.")
    return shown


def _profile(
    across: _Across, line: Line, rules: Sequence[Rule], objects: Sequence[Object], span: int
) -> Figure:
    """A span from the side: wires in each state, what is around them, objects."""
    canvas, axes = _canvas(11.0, 4.2)
    canvas.subplots_adjust(left=0.07, right=0.87, bottom=0.12, top=0.97)  # all alike, and quick
    own = np.flatnonzero(line.span == span)
    axis = max((line.curves[0][k] for k in own), key=lambda curve: curve.length)
    stretch = axis.points(np.array([0.0, axis.length]))[:, across.side]
    xyz, kinds = across.between(stretch.min() - BESIDE, stretch.max() + BESIDE)
    along, beside = axis.along(xyz)
    near = (np.abs(beside) < BESIDE) & (along > -5) & (along < axis.length + 5)
    for number, kind in reversed(list(enumerate(KINDS))):
        some = near & (kinds == number)
        if some.any():
            x, y = _pixels(along[some], xyz[some, 2], PIXEL)
            axes.plot(x, y, ".", markersize=1.5, color=COLOURS[kind], label=kind, zorder=1)
    for number, state in enumerate(line.states):
        for k in own:
            places = line.curves[number][k].points(np.linspace(0.0, line.curves[0][k].length, 100))
            axes.plot(
                axis.along(places)[0], places[:, 2], STYLES[min(number, 3)], color="#0040a0",
                linewidth=0.8, label=state.name if k == own[0] else None, zorder=3,
            )  # fmt: skip
    spots: list[Spot] = []
    for number, one in enumerate(objects, start=1):
        if line.span[one.wire] == span:
            point = across.scene.xyz[[one.nearest]]
            spots.append((number, one, np.array([axis.along(point)[0][0], point[0, 2]])))
            foot = line.curves[one.state][one.wire].points(np.array([one.u]))
            axes.plot(
                [spots[-1][2][0], axis.along(foot)[0][0]], [point[0, 2], foot[0, 2]], "-",
                color=SIGNS[rules[one.rule].severity], linewidth=0.9, zorder=4,
            )  # fmt: skip
    _mark(axes, rules, spots)
    axes.set_xlabel("m along the span")
    axes.set_ylabel("height, m")
    _legend(axes)
    worst = f"; closest: {spots[0][1].measure:.2f} m" if spots else ""
    caption = (
        f"Span {span}, {axis.length:.0f} m, {len(own)} wires, {len(spots)} objects{worst}. "
        f"Points up to {BESIDE:.0f} m to the side; numbers as in the list."
    )
    return Figure(_png(canvas), caption)
