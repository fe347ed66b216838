"""Draws the diagrams of models as SVG, in place of their Mermaid text."""

from __future__ import annotations

import html
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from toolbox import catalog
from toolbox.models.diagram import Edge, Node, graph
from toolbox.models.model import Model

LINE, LETTER, PAD, ACROSS, DOWN = 15, 6.4, 10, 18, 44  # pixels: text of 11 px, and spaces
SWEEPS = 8


@dataclass
class Box:
    """A box, or with no node a bend where an arrow passes a row."""

    node: Node | None = None
    row: int = 0
    x: float = 0.0
    y: float = 0.0
    above: list[str] = field(default_factory=list)
    below: list[str] = field(default_factory=list)

    @property
    def texts(self) -> tuple[str, ...]:
        return (self.node.title, *self.node.lines) if self.node else ()

    @property
    def width(self) -> float:
        return max((len(text) for text in self.texts), default=0) * LETTER + 2 * PAD

    @property
    def height(self) -> float:
        return len(self.texts) * LINE + PAD


def svg(model: Model) -> str:
    """The steps of a model in rows, each below all that it needs."""
    found, edges = graph(model)
    boxes = {node.key: Box(node) for node in found}
    _rank(boxes, edges)
    ways = {edge: _way(edge, boxes) for edge in edges}
    rows = _ordered(boxes)
    width = max(sum(boxes[key].width + ACROSS for key in row) for row in rows)
    y = 4.0
    for row in rows:
        tall = max(boxes[key].height for key in row)
        x = (width - sum(boxes[key].width + ACROSS for key in row) + ACROSS) / 2
        for key in row:
            box = boxes[key]
            box.x, box.y = x, y + (tall - box.height) / 2
            x += box.width + ACROSS
        y += tall + DOWN
    parts = [_arrow(edge, [boxes[key] for key in way]) for edge, way in ways.items()]
    parts += [_drawn(box) for box in boxes.values() if box.node]
    size = f'width="{width:.0f}" height="{y - DOWN + 4:.0f}"'
    return (
        f'<div class="diagram"><svg {size} role="img" aria-label="Steps of {model.id}">'
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path d="M0 0 8 4 0 8z"/></marker></defs>'
        f"{''.join(parts)}</svg></div>"
    )


def _rank(boxes: dict[str, Box], edges: Iterable[Edge]) -> None:
    """Put each box one row below the lowest that it needs."""
    needs = defaultdict(list)
    for edge in edges:
        needs[edge.end].append(edge.start)
    for key, box in boxes.items():  # a model lists steps after those that they need
        box.row = max((boxes[start].row + 1 for start in needs[key]), default=0)


def _way(edge: Edge, boxes: dict[str, Box]) -> list[str]:
    """The boxes and bends that an arrow passes, one in each row."""
    first, last = boxes[edge.start].row, boxes[edge.end].row
    bends = [f"{edge.start} {edge.end} {edge.dashed} {row}" for row in range(first + 1, last)]
    for row, key in enumerate(bends, first + 1):
        boxes[key] = Box(row=row)
    way = [edge.start, *bends, edge.end]
    for upper, lower in pairwise(way):
        boxes[upper].below.append(lower)
        boxes[lower].above.append(upper)
    return way


def _ordered(boxes: dict[str, Box]) -> list[list[str]]:
    """The rows, sorted again and again by the middle of what each box is joined to."""
    rows: list[list[str]] = [[] for _ in range(1 + max(box.row for box in boxes.values()))]
    for key, box in boxes.items():
        rows[box.row].append(key)
    for sweep in range(SWEEPS):
        for row in rows if sweep % 2 == 0 else reversed(rows):
            place = {key: i / len(other) for other in rows for i, key in enumerate(other)}
            means = {}
            for key in row:
                ends = boxes[key].above if sweep % 2 == 0 else boxes[key].below
                means[key] = sum(place[end] for end in ends) / len(ends) if ends else place[key]
            row.sort(key=means.__getitem__)
    return rows


def _arrow(edge: Edge, way: list[Box]) -> str:
    middles = [(box.x + box.width / 2, box) for box in way]
    x, first = middles[0]
    path = f"M{x:.0f} {first.y + first.height:.0f}"
    y = first.y + first.height
    for to, box in middles[1:]:
        half = (y + box.y) / 2
        path += f"C{x:.0f} {half:.0f} {to:.0f} {half:.0f} {to:.0f} {box.y:.0f}"
        x, y = to, box.y + box.height
        if not box.node:
            path += f"L{x:.0f} {y:.0f}"
    style = ' stroke-dasharray="4 4"' if edge.dashed else ""
    title = f"<title>{html.escape(edge.label)}</title>" if edge.label else ""
    return f'<path class="arrow" d="{path}"{style} marker-end="url(#tip)">{title}</path>'


def _drawn(box: Box) -> str:
    assert box.node
    round_, dash = (0 if box.node.kind == "step" else 12), box.node.optional
    style = ' stroke-dasharray="5 4"' if dash else ""
    style += ' stroke-width="3"' if box.node.repeated else ""
    middle = box.x + box.width / 2
    texts = "".join(  # the first, which is its name, is bold
        f'<text x="{middle:.0f}" y="{box.y + line * LINE:.0f}">{html.escape(text)}</text>'
        for line, text in enumerate(box.texts, 1)
    )
    return (
        f'<rect x="{box.x:.0f}" y="{box.y:.0f}" width="{box.width:.0f}" '
        f'height="{box.height:.0f}" rx="{round_}"{style}/>{texts}'
    )


class Diagram(SphinxDirective):
    """The diagram of the model whose page this is."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        model = catalog.load(self.env.docname.rpartition("/")[2])
        return [nodes.raw("", svg(model), format="html")] if isinstance(model, Model) else []


def setup(app: Sphinx) -> None:
    """Let blocks of Mermaid on the pages of models be drawn."""
    app.add_directive("mermaid", Diagram)
