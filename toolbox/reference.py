"""Writes metadata/tools/*.json and docs/tools/*.md from the declarations: ``make docs``."""

from __future__ import annotations

import ast
import functools
import json
import math
import re
import shlex
from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

import yaml

from toolbox import catalog
from toolbox.declare.fields import Spec
from toolbox.labels import labelled
from toolbox.models.diagram import markdown
from toolbox.models.model import Model
from toolbox.places import METADATA

ROOT = METADATA.parent
SHELL = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
EXAMPLES = ROOT / "docs" / "examples.yaml"
LINE = 100  # characters
PICTURES = ROOT / "docs" / "images" / "tools"
FIGURES = ROOT / "docs" / "figures.json"  # made by `make bench`
SURVEYS = ROOT / "docs" / "surveys.yaml"
TESTS = ROOT / "tests" / "algorithms"
PAGES = ROOT / "docs" / "explanation"
MOST_PAGES = 3
BEGINS_REFERENCE = re.compile(
    r"[^.:]{2,}?( \(\d{4}\)|, \w\.| et al\.| Std )|LAS \d|\w+, \w+ \(\d{4}\)"
)
OF_HOUSE = {"architecture.md", "speed.md", "provenance.md", "security.md"}  # on no method


def commands(page: Path) -> list[list[str]]:
    """The commands of all shell blocks of a page of the documentation, each as its words."""
    text = "\n".join(SHELL.findall(page.read_text("utf-8"))).replace("\\\n", " ")
    return [words for line in text.splitlines() if (words := shlex.split(line, comments=True))]


def files() -> Iterator[tuple[Path, str]]:
    """The path and text of every generated file."""
    specs = [catalog.load(id) for id in catalog.own_ids()]
    described = [spec.describe() for spec in specs]
    shown = examples()
    for spec, tool in zip(specs, described, strict=True):
        runs = runs_of(spec, shown.get(spec.id))
        commands = {"metadata": list(examples_of(spec.id, runs))}
        yield METADATA / "tools" / f"{spec.id}.json", as_json({**tool, **commands})
        more = [steps(spec), columns(spec), in_tiles(spec), cost(spec.id), tried(spec)]
        more += [in_use(spec.id, runs), elsewhere(spec, runs), papers(spec.id)]
        yield ROOT / "docs" / "tools" / f"{spec.id}.md", page(tool, *more)
    yield ROOT / "docs" / "tools" / "index.md", index(specs)


def examples() -> dict[str, list[dict[str, Any]]]:
    """The values of the runs that docs/examples.yaml shows, by tool."""
    read = yaml.safe_load(EXAMPLES.read_text(encoding="utf-8"))
    return {id: runs if isinstance(runs, list) else [runs] for id, runs in read.items()}


def runs_of(spec: Spec, runs: list[dict[str, Any]] | None) -> list[dict[str, Any]]:
    """The values of the runs that are shown: the examples of a tool, or the inputs it needs."""
    runs = runs or [{n: f"{n}" for n, field in spec.inputs.items() if field.required}]
    return [{k: v for k, v in run.items() if not k.startswith("$")} for run in runs]


def examples_of(id: str, runs: list[dict[str, Any]]) -> Iterator[dict[str, str]]:
    """Two commands, which ``--help`` shows: two examples, or one, and the same with a report."""
    first, second = runs[0], runs[1] if len(runs) > 1 else {**runs[0], "page": "report.html"}
    for run in (first, second):
        command = f"python -m toolbox run {id} {as_words(run)}".strip()
        yield {"role": "example", "title": "Example", "value": command}


def as_json(tool: Mapping[str, Any]) -> str:
    return json.dumps(tool, indent=2, ensure_ascii=False) + "\n"


def index(specs: list[Spec]) -> str:
    """The list of all tools, by group."""
    lines = ["# Tools", "", "```{toctree}", ":hidden:", ":glob:", "", "*.*", "```"]
    for group, members in groupby(specs, lambda spec: spec.group):
        lines += ["", f"## {group}", "", "| tool | title | what it does |", "| --- | --- | --- |"]
        lines += [f"| [`{s.id}`]({s.id}.md) | {s.title} | {s.summary} |" for s in members]
    return "\n".join([*lines, ""])


def steps(spec: Spec) -> str:
    """The section of a page with the diagram of a model; empty for a tool."""
    if not isinstance(spec, Model):
        return ""
    text = "An output of a step is written with `--step.output PATH`, such as"
    first = next(name for name, field in spec.between.items() if field.kind.is_layer)
    return f"## Steps\n\n{text} `--{first}`.\n\n{markdown(spec)}"


def columns(spec: Spec) -> str:
    """The sections of a page on the columns of tables and features that name theirs."""
    parts = []
    for name, field in spec.outputs.items():
        rows = [
            f"| `{key}` | {column.meaning or column.heading or 'for programs'} | {column.unit} |"
            for key, column in field.columns.items()
        ]
        if rows:
            head = [f"## Columns of {name}", "", "| column | what | unit |", "| --- | --- | --- |"]
            parts.append("\n".join([*head, *rows]))
    return "\n\n".join(parts)


def in_tiles(spec: Spec) -> str:
    """The section of a page on what a tile reads; empty for a tool that reads no layers."""
    if not spec.sources:
        return ""
    reach = spec.halo({})
    if math.isinf(reach):
        says = "Needs the whole of its data at once with these defaults."
    elif reach:
        says = f"Reads {reach:.4g} m around each tile with these defaults."
    else:
        says = "Reads nothing around a tile."
    return f"## In tiles\n\n{says}"


def papers(id: str) -> str:
    """The section of a page with the references that the file of a tool gives; empty without any.

    A line that begins with authors and a year, or what stands for them, begins one.
    """
    path = catalog.own_files()[id]
    text = ast.get_docstring(ast.parse(path.read_text("utf-8"))) if path.suffix == ".py" else None
    found: list[str] = []
    for paragraph in (text or "").partition("References\n----------\n")[2].split("\n\n"):
        lines = paragraph.splitlines()
        if not (lines and BEGINS_REFERENCE.match(lines[0])):
            break  # what follows tells where we depart from them
        for line in lines:
            if BEGINS_REFERENCE.match(line):
                found.append(line)
            else:
                found[-1] += f" {line}"
    listed = "\n".join(f"- {one}" for one in found)
    return f"## References\n\n{listed}" if found else ""


def in_use(id: str, runs: list[dict[str, Any]]) -> str:
    """The section of a page with runs in the shell and in Python."""
    shell = "\n".join(f"python -m toolbox run {id} {as_words(run)}".strip() for run in runs)
    return f"## Example\n\n```sh\n{shell}\n```\n\n```python\n{_as_call(id, runs[0])}\n```"


def cost(id: str) -> str:
    """The section of a page on time and memory, as `make bench` has measured them."""
    run = figures()["tools"]["runs"].get(id)
    if run is None:
        return ""
    many = f"{run['points']:.1f} million points" if run["points"] else "the large sample survey"
    says = f"The first example takes {run['seconds']:.1f} s of processor time and "
    says += f"{run['megabytes']:.0f} MB of memory on {many}, starting and libraries included"
    if run["seconds_more"] is not None:
        says += f"; each further million points {run['seconds_more']:.1f} s and "
        says += f"{max(run['megabytes_more'], 0):.0f} MB"
    return f"## Time and memory\n\n{says}. [How this was measured](../reference/figures.md)."


@functools.cache
def figures() -> dict[str, Any]:
    """What `make bench` has measured."""
    return dict(json.loads(FIGURES.read_text(encoding="utf-8")))


def tried(spec: Spec) -> str:
    """The section of a page on the real surveys of its tests, and what explains its limits."""
    names = yaml.safe_load(SURVEYS.read_text(encoding="utf-8"))
    own = re.compile(rf'"{re.escape(spec.id)}"|\b{spec.make.__name__}\b')
    used = "".join(text for text in _texts(TESTS, "test_*.py").values() if own.search(text))
    found = [name for name in sorted(names) if re.search(rf"[\"/]{name}[\"/]", used)]
    lines = ["## Where it was tried", "", "Its own tests use sample surveys with known truth"]
    lines[-1] += ", and these real ones:\n" if found else " alone."
    lines += [f"- {names[name]}" for name in found]
    if links := [f"[{_heading(p)}](../explanation/{p.name})" for p in _pages_on(spec.id)]:
        lines += ["", f"What it does, how well, and where it fails: {', '.join(links)}."]
    return "\n".join(lines)


def _pages_on(id: str) -> list[Path]:
    """The explanations that speak of a tool, those that do so most first."""
    pages = {
        path: text for path, text in _texts(PAGES, "*.md").items() if path.name not in OF_HOUSE
    }
    counts = {path: text.count(f"`{id}`") for path, text in pages.items()}
    return sorted(filter(counts.get, pages), key=lambda path: -counts[path])[:MOST_PAGES]


@functools.cache
def _texts(folder: Path, pattern: str) -> dict[Path, str]:
    """The texts of the files below a folder, in the order of their paths."""
    return {path: path.read_text(encoding="utf-8") for path in sorted(folder.rglob(pattern))}


def _heading(page: Path) -> str:
    first = page.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
    return first[:1].lower() + first[1:] if first[1:2].islower() else first


def elsewhere(spec: Spec, runs: list[dict[str, Any]]) -> str:
    """The folded section of a page on the same run in QGIS, and as a step of a model."""
    given = {k: v for k, v in runs[0].items() if not isinstance(v, list)}
    capitals = [f"{name.upper()}={shlex.quote(_shell(value))}" for name, value in given.items()]
    command = f"qgis_process run lidartoolbox:{re.sub('[^a-z0-9]', '', spec.id)} -- "
    read = [name for name in given if name in spec.sources]
    said = [f"{name}: {_literal(v)}" for name, v in given.items() if name in spec.inputs]
    said = [f"{name}: {{from: inputs.{name}}}" for name in read] + [
        line for line in said if line.partition(":")[0] not in read
    ]
    step = "\n".join([f"  tool: {spec.id}", *(f"  {line}" for line in said)])
    return (
        "<details><summary>In QGIS, and as a step of a model</summary>\n\n"
        f"In the Processing toolbox: *LiDAR Toolbox > {spec.group} > {spec.title}*. In a "
        f"terminal:\n\n```console\n$ {command}{' '.join(capitals)}\n```\n\n"
        f"In a [model](../howto/write-a-model.md):\n\n```yaml\nstep:\n{step}\n```\n\n</details>"
    )


def _shell(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _as_call(id: str, values: Mapping[str, Any]) -> str:
    """A run in Python, laid out as a formatter would."""
    pairs = [f"{_literal(name)}: {_literal(value)}" for name, value in values.items()]
    line = f'result = toolbox.run("{id}", {{{", ".join(pairs)}}})'
    if len(line) > LINE:
        inside = "".join(f"        {pair},\n" for pair in pairs)
        line = f'result = toolbox.run(\n    "{id}",\n    {{\n{inside}    }},\n)'
    return f"import toolbox\n\n{line}"


def _literal(value: Any) -> str:
    return repr(value) if isinstance(value, bool) else json.dumps(value, ensure_ascii=False)


def as_words(values: Mapping[str, Any]) -> str:
    """Values as options of the command line.

    >>> as_words({"points": ["a.laz", "b.laz"], "where": "z > 2", "denoise": False})
    "--points a.laz b.laz --where 'z > 2' --denoise false"
    """
    words = []
    for name, value in values.items():
        items = value if isinstance(value, list) else [value]
        texts = [str(v).lower() if isinstance(v, bool) else str(v) for v in items]
        words += [f"--{name}", *map(shlex.quote, texts)]
    return " ".join(words)


def page(tool: Mapping[str, Any], *sections: str) -> str:
    """The reference page of one tool, with sections after those on inputs and outputs."""
    lines = [f"# {tool['id']}: {tool['title']}", "", tool["description"], ""]
    if (PICTURES / f"{tool['id']}.webp").exists():
        lines += [f"![{tool['title']}](../images/tools/{tool['id']}.webp)", ""]
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
    if files := tool.get("deliver"):
        lines += ["", "## Files of `--deliver FOLDER`", "", "| file | holds |", "| --- | --- |"]
        lines += [f"| `{one['file']}` | {one['description']} |" for one in files]
    for section in filter(None, sections):
        lines += ["", section.rstrip()]
    group = tool["id"].partition(".")[0]
    lines += ["", f"Declared in `algorithms/{group}/{catalog.own_files()[tool['id']].name}`.", ""]
    return "\n".join(lines)


def _row(name: str, field: Mapping[str, Any]) -> str:
    says, schema = _says(field), field["schema"]
    unit = f" [{says['unit']}]" if says.get("unit", "1") != "1" else ""
    default = f"`{schema['default']}`" if "default" in schema else ""
    default += f"; {says['feet']}" if "feet" in says else ""
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
