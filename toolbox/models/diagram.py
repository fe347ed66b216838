"""The chain of a model as a diagram: Mermaid text, or a picture.

Sources, steps and outputs are nodes; an edge is a result on its way, with its name. Settings stand
in the boxes. A step that may be left out has a dashed frame, one that is repeated a double one.

References
----------
Sugiyama, K., Tagawa, S. and Toda, M. (1981). Methods for visual understanding of hierarchical
system structures. IEEE Transactions on Systems, Man, and Cybernetics 11(2), 109-125: the picture
has the nodes in layers, sorted by the middle of their neighbours.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from toolbox.errors import DataError
from toolbox.models.model import INPUTS, Model, Reference, Step, references

SUFFIXES = (".svg", ".png")
FONT, SMALL = 10.0, 8.0  # points
LINE, PAD, GAP, LAYER_GAP = 12.0, 8.0, 22.0, 48.0  # points, between lines, boxes and layers
SWEEPS = 24
PORTS = 26.0  # points between two edges at one box
LONGEST = 44  # characters of a setting that are shown
COLOURS = {"input": "#e8f0fa", "step": "#ffffff", "output": "#e9f5e6"}
SHAPES = {"input": ("([", "])"), "step": ("[", "]"), "output": ("([", "])")}  # of Mermaid


@dataclass(frozen=True)
class Node:
    """A box. Its key begins with i_, s_ or o_, since Mermaid has words that no node may have."""

    key: str
    kind: str
    title: str
    lines: tuple[str, ...] = ()
    optional: bool = False
    repeated: bool = False


@dataclass(frozen=True)
class Edge:
    """An arrow; a dashed one carries what is taken if there is nothing better."""

    start: str
    end: str
    label: str
    dashed: bool = False


def graph(model: Model) -> tuple[list[Node], list[Edge]]:
    """The nodes and edges of a model."""
    nodes = [Node(f"i_{n}", "input", n, (f.kind.word,)) for n, f in model.sources.items()]
    nodes += [_step_node(step) for step in model.steps.values()]
    nodes += [Node(f"o_{n}", "output", n, (f.word,)) for n, f in model.outputs.items()]
    ends = [(f"s_{s.name}", r) for s in model.steps.values() for r in _layers(s, model)]
    ends += [(f"o_{name}", reference) for name, reference in model.returns.items()]
    labels: dict[tuple[str, str, bool], list[str]] = {}
    for end, reference in ends:
        for place, name in enumerate(reference.names):
            owner, _, result = name.partition(".")
            start, label = (f"i_{result}", "") if owner == INPUTS else (f"s_{owner}", result)
            labels.setdefault((start, end, place > 0), []).append(label)
    return nodes, [Edge(a, b, _joined(texts), dashed) for (a, b, dashed), texts in labels.items()]


def _layers(step: Step, model: Model) -> Iterator[Reference]:
    """The references of a step to layers and to results of others."""
    for wire in step.wires.values():
        for reference in references(wire):
            names = [n for n in reference.names if n.removeprefix(f"{INPUTS}.") in model.sources]
            names += [n for n in reference.names if not n.startswith(f"{INPUTS}.")]
            if names:
                yield Reference(tuple(n for n in reference.names if n in names))


def _joined(texts: list[str]) -> str:
    return ", ".join(dict.fromkeys(filter(None, texts)))


def _step_node(step: Step) -> Node:
    lines = [step.spec.id]
    if step.when:
        word = f" is {step.when.word}" if step.when.word else ""
        lines.append(f"if {step.when.name}{word}")
    if step.repeat:
        lines.append(f"for each {step.repeat}")
    for name, value in step.settings.items():
        field = step.input(name)
        texts = [_text(field, item) for item in (field.items(value) if field else (value,))]
        lines.append(_cut(f"{name}: {', '.join(texts)}"))
    for name, wire in step.params.items():
        names = [full for r in references(wire) for full in r.names]
        lines.append(_cut(f"{name}: {' or '.join(names)}"))
    title, repeated = step.name, step.repeat is not None
    return Node(f"s_{title}", "step", title, tuple(lines), step.when is not None, repeated)


def _text(field: Any, value: Any) -> str:
    """A value as the file would have it."""
    if value is None or field is None or value in field.choices:
        return str(value)
    return str(field.kind.to_json(value))


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def mermaid(model: Model) -> str:
    """The diagram as Mermaid text, which GitHub, GitLab and many editors show as a picture."""
    nodes, edges = graph(model)
    lines = ["flowchart TD"]
    for node in nodes:
        left, right = ("[[", "]]") if node.repeated else SHAPES[node.kind]
        texts = [f"<b>{_escaped(node.title)}</b>", *map(_escaped, node.lines)]
        lines.append(f'    {node.key}{left}"{"<br/>".join(texts)}"{right}')
    for edge in edges:
        arrow = "-.->" if edge.dashed else "-->"
        label = f'|"{_escaped(edge.label)}"|' if edge.label else ""
        lines.append(f"    {edge.start} {arrow}{label} {edge.end}")
    lines += [f"    style {node.key} stroke-dasharray: 5 5" for node in nodes if node.optional]
    return "\n".join(lines) + "\n"


def _escaped(text: str) -> str:
    for sign, code in {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;"}.items():
        text = text.replace(sign, code)
    return text


# The picture


@dataclass
class _Box:
    """A node with its place, or a bend of an edge that passes a layer."""

    node: Node | None
    layer: int
    width: float
    height: float
    x: float = 0.0
    before: list[_Box] = field(default_factory=list)
    after: list[_Box] = field(default_factory=list)


@dataclass(frozen=True)
class _Route:
    """An edge and all boxes that it touches."""

    edge: Edge
    boxes: list[_Box]


def draw(model: Model, path: Path) -> None:
    """Draw the diagram into a file; the same model gives the same bytes.

    Raises
    ------
    DataError
        The file cannot be written, or ends in something else than .svg or .png.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if path.suffix.lower() not in SUFFIXES:
        raise DataError(f"{path}: diagrams are written as {' or '.join(SUFFIXES)}")
    layers, routes = _placed(model)
    tops, bottoms = _edges_of(layers)
    boxes = [box for layer in layers for box in layer]
    left = min(box.x - box.width / 2 for box in boxes) - GAP
    right = max(box.x + box.width / 2 for box in boxes) + GAP
    bottom = bottoms[-1] - GAP
    figure = Figure(figsize=((right - left) / 72, (GAP - bottom) / 72), facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(left, right), ylim=(bottom, GAP))
    axes.axis("off")
    for box in boxes:
        if box.node:
            _draw_box(axes, box, box.node, tops[box.layer])
    ports = _ports(routes)
    for number, route in enumerate(routes):
        _draw_route(axes, route, ports[number, True], ports[number, False], layers)
    svg = path.suffix.lower() == ".svg"
    metadata: dict[str, Any] = {"Date": None} if svg else {"Software": None}
    try:
        with matplotlib.rc_context({"svg.hashsalt": model.id, "svg.fonttype": "none"}):
            figure.savefig(path, dpi=140, metadata=metadata, format=path.suffix[1:].lower())
    except OSError as err:
        raise DataError(f"{path} cannot be written: {err}") from err


def _placed(model: Model) -> tuple[list[list[_Box]], list[_Route]]:
    """All boxes by layer, from left to right, and the ways of the edges."""
    nodes, edges = graph(model)
    rank = _ranks(nodes, edges)
    boxes = {node.key: _Box(node, rank[node.key], *_size(node)) for node in nodes}
    layers: list[list[_Box]] = [[] for _ in range(max(rank.values()) + 1)]
    for box in boxes.values():
        layers[box.layer].append(box)
    routes = []
    for edge in edges:
        start, end = boxes[edge.start], boxes[edge.end]
        bends = [_Box(None, i, 6.0, 0.0) for i in range(start.layer + 1, end.layer)]
        for bend in bends:
            layers[bend.layer].append(bend)
        way = [start, *bends, end]
        for one, other in itertools.pairwise(way):
            one.after.append(other)
            other.before.append(one)
        routes.append(_Route(edge, way))
    for sweep in range(SWEEPS):
        for layer in layers if sweep % 2 == 0 else reversed(layers):
            _arrange(layer, down=sweep % 2 == 0, sort=sweep < SWEEPS - 6)
    return layers, routes


def _ranks(nodes: list[Node], edges: list[Edge]) -> dict[str, int]:
    """The layer of each node: below all that it needs, and sources just above their first use."""
    rank = {node.key: 0 for node in nodes}  # in the order of the steps, so one pass is enough
    for node in nodes:
        befores = [rank[edge.start] + 1 for edge in edges if edge.end == node.key]
        rank[node.key] = max(befores, default=0)
    for node in nodes:
        if node.kind == "input":
            uses = [rank[edge.end] - 1 for edge in edges if edge.start == node.key]
            rank[node.key] = min(uses, default=0)
    return rank


def _size(node: Node) -> tuple[float, float]:
    widths = [_width(node.title, FONT, bold=True), *(_width(t, SMALL) for t in node.lines)]
    return max(widths) + 2 * PAD, LINE * (1 + len(node.lines)) + PAD


def _width(text: str, size: float, *, bold: bool = False) -> float:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    weight = "bold" if bold else "normal"
    path = TextPath((0, 0), text or " ", size=size, prop=FontProperties(weight=weight))
    return float(path.get_extents().width)


def _arrange(layer: list[_Box], *, down: bool, sort: bool) -> None:
    """Place the boxes of a layer below (or above) the middle of their neighbours."""

    def middle(box: _Box) -> float:
        near = (box.before if down else box.after) or box.before + box.after
        return sum(other.x for other in near) / len(near) if near else box.x

    wanted = {id(box): middle(box) for box in layer}
    if sort:
        layer.sort(key=lambda box: wanted[id(box)])
    # Blocks of boxes that touch each other; each lies where its boxes want to be on average.
    blocks: list[list[float]] = []  # [sum of wishes for the left end, number]
    offset, offsets = 0.0, []
    for one, other in zip([None, *layer], layer, strict=False):
        offset += (one.width / 2 + GAP + other.width / 2) if one else 0.0
        offsets.append(offset)
        blocks.append([wanted[id(other)] - offset, 1])
        while len(blocks) > 1 and _mean(blocks[-2]) > _mean(blocks[-1]):
            total, count = blocks.pop()
            blocks[-1][0] += total
            blocks[-1][1] += count
    starts = [_mean(block) for block in blocks for _ in range(int(block[1]))]
    for box, start, at in zip(layer, starts, offsets, strict=True):
        box.x = start + at


def _mean(block: list[float]) -> float:
    return block[0] / block[1]


def _edges_of(layers: list[list[_Box]]) -> tuple[list[float], list[float]]:
    """The upper and the lower edge of each layer; y points upwards."""
    tops: list[float] = []
    bottoms: list[float] = []
    for layer in layers:
        tops.append(bottoms[-1] - LAYER_GAP if bottoms else 0.0)
        bottoms.append(tops[-1] - max(box.height for box in layer))
    return tops, bottoms


def _ports(routes: list[_Route]) -> dict[tuple[int, bool], float]:
    """Where each edge leaves (True) and enters (False) its boxes: side by side, uncrossed."""
    found: dict[tuple[int, bool], float] = {}
    for leaves in (True, False):
        ends: dict[int, list[tuple[float, int, _Box]]] = {}
        for number, route in enumerate(routes):
            box, other = route.boxes[:2] if leaves else route.boxes[:-3:-1]
            ends.setdefault(id(box), []).append((other.x, number, box))
        for group in ends.values():
            group.sort(key=lambda end: end[:2])
            for place, (_, number, box) in enumerate(group):
                apart = min(PORTS, box.width / (len(group) + 1))
                found[number, leaves] = box.x + (place - (len(group) - 1) / 2) * apart
    return found


def _draw_box(axes: Any, box: _Box, node: Node, top: float) -> None:
    from matplotlib.patches import FancyBboxPatch

    style = "round,pad=0,rounding_size=" + ("3" if node.kind == "step" else f"{box.height / 2:g}")
    for shift in (3.0, 0.0) if node.repeated else (0.0,):
        corner = (box.x - box.width / 2 + shift, top - box.height - shift)
        patch = FancyBboxPatch(
            corner,
            box.width,
            box.height,
            boxstyle=style,
            facecolor=COLOURS[node.kind],
            edgecolor="#333333",
            linestyle=(0, (4, 3)) if node.optional else "solid",
            linewidth=0.9,
            zorder=3,
        )
        axes.add_patch(patch)
    y = top - PAD / 2 - LINE / 2
    texts = [(node.title, FONT, "bold"), *((line, SMALL, "normal") for line in node.lines)]
    for text, size, weight in texts:
        axes.text(
            box.x,
            y,
            text,
            ha="center",
            va="center",
            fontsize=size,
            fontweight=weight,
            zorder=4,
            parse_math=False,
        )
        y -= LINE


def _draw_route(
    axes: Any, route: _Route, leaves: float, enters: float, layers: list[list[_Box]]
) -> None:
    """A line that is straight within layers and bends between them, and its label."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path as Line

    tops, bottoms = _edges_of(layers)
    xs = [leaves, *(box.x for box in route.boxes[1:-1]), enters]
    start = route.boxes[0]
    points = [(leaves, tops[start.layer] - start.height)]
    codes = [Line.MOVETO]
    for box, here, there in zip(route.boxes, xs, xs[1:], strict=False):
        low, high = bottoms[box.layer], tops[box.layer + 1]
        middle = (low + high) / 2
        points += [(here, low), (here, middle), (there, middle), (there, high)]
        codes += [Line.LINETO, Line.CURVE4, Line.CURVE4, Line.CURVE4]
    arrow = FancyArrowPatch(
        path=Line(points, codes),
        arrowstyle="-|>",
        mutation_scale=9,
        color="#555555",
        linewidth=0.9,
        linestyle=(0, (4, 3)) if route.edge.dashed else "solid",
        zorder=2,
    )
    axes.add_patch(arrow)
    if route.edge.label:
        low, high = bottoms[route.boxes[-2].layer], tops[route.boxes[-1].layer]
        axes.text(
            0.25 * xs[-2] + 0.75 * enters,
            0.33 * low + 0.67 * high,
            route.edge.label,
            ha="center",
            va="center",
            fontsize=SMALL,
            color="#1f4e79",
            parse_math=False,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
            zorder=2.5,
        )
