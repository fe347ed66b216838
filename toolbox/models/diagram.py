"""The diagram of a model as Mermaid text, which GitHub, GitLab and many editors draw.

Sources, steps and outputs are boxes. An arrow is a result that goes from one step to another, and
bears its name. Settings stand in the box of their step. The box of a step that may be left out has
a dashed border, and that of a repeated step a double one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from toolbox.models.model import INPUTS, Model, Reference, Step, references

LONGEST = 44  # characters of a setting that are shown
SHAPES = {"input": ("([", "])"), "step": ("[", "]"), "output": ("([", "])")}  # of Mermaid


@dataclass(frozen=True)
class Node:
    """A box. Its key begins with i_, s_ or o_, since Mermaid reserves some words."""

    key: str
    kind: str
    title: str
    lines: tuple[str, ...] = ()
    optional: bool = False
    repeated: bool = False


@dataclass(frozen=True)
class Edge:
    """An arrow; a dashed one carries a value that is used if the first one is missing."""

    start: str
    end: str
    label: str
    dashed: bool = False


def graph(model: Model) -> tuple[list[Node], list[Edge]]:
    """Make the nodes and edges of a model."""
    nodes = [Node(f"i_{n}", "input", n, (f.kind.word,)) for n, f in model.sources.items()]
    nodes += [_step_node(step) for step in model.steps.values()]
    nodes += [Node(f"o_{n}", "output", n, (f.word,)) for n, f in model.outputs.items()]
    ends = [(f"s_{s.name}", r) for s in model.steps.values() for r in _layers(s, model)]
    ends += [(f"o_{name}", reference) for name, reference in model.returns.items()]
    labels: dict[tuple[str, str, bool], list[str]] = {}
    for end, reference in ends:
        for index, name in enumerate(reference.names):
            owner, _, result = name.partition(".")
            start, label = (f"i_{result}", "") if owner == INPUTS else (f"s_{owner}", result)
            labels.setdefault((start, end, index > 0), []).append(label)
    return nodes, [Edge(a, b, _joined(texts), dashed) for (a, b, dashed), texts in labels.items()]


def _layers(step: Step, model: Model) -> Iterator[Reference]:
    """The references of a step to layers and to results of other steps."""
    for link in step.links.values():
        for reference in references(link):
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
    for name, link in step.params.items():
        names = [full for r in references(link) for full in r.names]
        lines.append(_cut(f"{name}: {' or '.join(names)}"))
    title, repeated = step.name, step.repeat is not None
    return Node(f"s_{title}", "step", title, tuple(lines), step.when is not None, repeated)


def _text(field: Any, value: Any) -> str:
    """The text of a value as in the model file."""
    if value is None or field is None or value in field.choices:
        return str(value)
    return str(field.kind.to_json(value))


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def mermaid(model: Model) -> str:
    """The diagram of a model as the text of a Mermaid flowchart."""
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


def markdown(model: Model) -> str:
    """The diagram of a model as a block of a Markdown file."""
    return f"```mermaid\n{mermaid(model)}```\n"


def _escaped(text: str) -> str:
    for sign, code in {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;"}.items():
        text = text.replace(sign, code)
    return text
