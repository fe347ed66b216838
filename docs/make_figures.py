"""Writes docs/reference/figures.md from docs/figures.json, which `make bench` measures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from toolbox.reference import ROOT, figures

PAGE = ROOT / "docs" / "reference" / "figures.md"
HEAD = """# Accuracy and speed in figures

All figures of this page are printed by one command, which takes about an hour on two cores:

```console
$ make bench
```

For the accuracies it needs the surveys that `TOOLBOX_TEST_DATA` names; `python -m tests.bench
figures --tools` needs none. Open3D and the package cloth-simulation-filter were not installed:
tools beside them are in the [explanation of speed](../explanation/speed.md) and those of the
methods.
"""
SECTIONS = {
    "isprs": (
        "Ground: cloth simulation beside its paper",
        "`ground.csf` on eight samples of the ISPRS filter test, with the settings of its paper "
        "(Zhang et al., 2016). Type I is ground that was missed, Type II other points taken for "
        "ground, both in percent; *paper* is the total error printed there.",
    ),
    "filters": (
        "Ground: all filters with their defaults",
        "The same and one more sample, nothing set. The last rows have the settings of the paper. "
        "The test has 15 samples; the other six are kept apart, so that nobody tunes to them, and "
        "defaults were looked at on these nine: expect errors a little larger on other data.",
    ),
    "corridor_real": (
        "Power lines",
        "`corridor.extract` on two real lines. Wires: share of the points found that are right / "
        "share of the true points that are found, in percent. Both were looked at while "
        "the method was made.",
    ),
    "waters": (
        "Water",
        "`shoreline.extract` on 31 kinds of made scenes with known water, seeds 100 and 101; the "
        "method was chosen on seeds 0 to 9, and two scenes here were looked at since (rice_wet "
        "100, river 101). IoU is the area that both have in common, by the area of both together.",
    ),
    "real_fronts": (
        "Windows and doors",
        "`planes.openings` on two scanned fronts whose openings people have labelled. An opening "
        "is found if its IoU is at least one half. The method was chosen with these two in view.",
    ),
    "outlines": (
        "Buildings",
        "Points of class 6 beside those of the provider (IoU), the classes taken away before; then "
        "corners of outlines beside those of a map. Towns 17 and 18 are made. The rules for noise "
        "were chosen on the first three tiles.",
    ),
}


def page() -> str:
    """The text of the page."""
    known = figures()
    parts = [HEAD, *_tools(known["tools"])]
    for name, (title, text) in SECTIONS.items():
        part = known["accuracy"][name]
        lines = "\n".join(part["lines"] if name != "waters" else _sums(part["lines"]))
        parts.append(
            f"## {title}\n\n{text}\n\n```text\n{lines}\n```\n\n{_machine(part['machine'])}"
        )
    return "\n".join(parts)


def _sums(lines: list[str]) -> list[str]:
    """The lines on all scenes together."""
    return [line for line in lines if " scenes, " in line]


def _tools(part: dict[str, Any]) -> Iterator[str]:
    yield (
        "## Time and memory of each tool\n\n"
        "The first [example](../tools/index.md) of each tool, as a command of its own, on the "
        "sample surveys made larger: a town of 360 m, a corridor of 2400 m, a reservoir of 480 m "
        "and a front of 72 m. Seconds are processor time, all cores together. What starting "
        "takes is in the columns s and MB, and not in the last two, which are the difference to "
        "a small survey. Tools that read rasters or features alone have none of these.\n\n"
        "| tool | million points | s | MB | s per million more | MB per million more |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: |"
    )
    for id, run in part["runs"].items():
        more = run["seconds_more"], run["megabytes_more"]
        texts = ["", ""] if more[0] is None else [f"{more[0]:.1f}", f"{max(more[1], 0):.0f}"]
        points = f"{run['points']:.2f}" if run["points"] else ""
        cells = [f"[`{id}`](../tools/{id}.md)", points, f"{run['seconds']:.1f}"]
        megabytes = f"{run['megabytes']:.0f}"
        yield f"| {' | '.join([*cells, megabytes, *texts])} |"
    yield f"\n{_machine(part['machine'])}"


def _machine(made: dict[str, Any]) -> str:
    libraries = ", ".join(f"{name} {version}" for name, version in made["libraries"].items())
    return (
        f"*Measured on {made['day']} at commit {made['commit']}: {made['processor']}, "
        f"{made['cores']} cores that others used as well, {made['system']}, Python "
        f"{made['python']}, {libraries}.*\n"
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
