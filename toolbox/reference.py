"""Writes metadata/tools/*.json and docs/tools/*.md from the declarations: ``make docs``."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from toolbox import catalog
from toolbox.declare.fields import Spec
from toolbox.labels import labelled
from toolbox.models.diagram import markdown
from toolbox.models.model import Model

ROOT = catalog.METADATA.parent


def files() -> Iterator[tuple[Path, str]]:
    """The path and text of every generated file."""
    specs = [catalog.load(id) for id in catalog.own_ids()]
    described = [spec.describe() for spec in specs]
    for spec, tool in zip(specs, described, strict=True):
        yield catalog.METADATA / "tools" / f"{spec.id}.json", as_json(tool)
        yield ROOT / "docs" / "tools" / f"{spec.id}.md", page(tool, steps(spec))
    yield ROOT / "docs" / "tools" / "index.md", index(described)


def as_json(tool: Mapping[str, Any]) -> str:
    return json.dumps(tool, indent=2, ensure_ascii=False) + "\n"


def index(tools: list[dict[str, Any]]) -> str:
    """The list of all tools."""
    lines = ["# Tools", "", "| tool | title | what it does |", "| --- | --- | --- |"]
    for tool in tools:
        says = tool["description"].partition("\n")[0].rstrip(".")
        lines.append(f"| [`{tool['id']}`]({tool['id']}.md) | {tool['title']} | {says} |")
    return "\n".join([*lines, ""])


def steps(spec: Spec) -> str:
    """The section of a page with the diagram of a model; empty for a tool."""
    if not isinstance(spec, Model):
        return ""
    text = "An output of a step is written with `--step.output PATH`, such as"
    first = next(name for name, field in spec.between.items() if field.kind.is_layer)
    return f"## Steps\n\n{text} `--{first}`.\n\n{markdown(spec)}"


def page(tool: Mapping[str, Any], steps: str = "") -> str:
    """The reference page of one tool, with a section on its steps if it is a model."""
    lines = [f"# {tool['id']}: {tool['title']}", "", tool["description"], ""]
    lines += [
        "## Inputs",
        "",
        "| name | type | what | rule | default |",
        "| --- | --- | --- | --- | --- |",
    ]
    lines += [_row(name, field) for name, field in tool["inputs"].items()]
    lines += ["", "## Outputs", "", "| name | type | what |", "| --- | --- | --- |"]
    for name, field in tool["outputs"].items():
        says = _says(field)
        unit = f" [{says['unit']}]" if says.get("unit", "1") != "1" else ""
        text = labelled(name, field["title"], field["description"])
        lines.append(f"| `{name}` | {says['type']} | {text}{unit} |")
    if steps:
        lines += ["", steps.rstrip()]
    group = tool["id"].partition(".")[0]
    lines += ["", f"Declared in `algorithms/{group}/{catalog.own_files()[tool['id']].name}`.", ""]
    return "\n".join(lines)


def _row(name: str, field: Mapping[str, Any]) -> str:
    says, schema = _says(field), field["schema"]
    unit = f" [{says['unit']}]" if says.get("unit", "1") != "1" else ""
    default = f"`{schema['default']}`" if "default" in schema else ""
    if field["minOccurs"]:
        default = "required"
    rule = says.get("rule", "")
    words = [meta for meta in field["metadata"] if meta["role"] == "choice"]
    if words:
        rule += " (" + "; ".join(f"{m['title']}: {m['value']}" for m in words) + ")"
    text = labelled(name, field["title"], field["description"])
    return f"| `{name}` | {says['type']} | {text}{unit} | {rule} | {default} |"


def _says(field: Mapping[str, Any]) -> dict[str, str]:
    return {meta["role"]: meta["value"] for meta in field["metadata"]}


def main() -> None:
    """Write all generated files, and remove those of tools that no longer exist."""
    wanted = dict(files())
    for path, text in wanted.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    for folder in {path.parent for path in wanted}:
        for path in set(folder.iterdir()) - wanted.keys():
            path.unlink()


if __name__ == "__main__":
    main()
