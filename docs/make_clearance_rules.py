"""Makes docs/reference/clearance-rules.md from the rule tables in algorithms/corridor/rules.

python docs/make_clearance_rules.py
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pandas as pd

from algorithms.corridor._clearance.coverage import (
    APPROACH,
    APPROACH_SOURCE,
    UNKNOWN_APPROACH,
    UNKNOWN_SOURCE,
)
from algorithms.corridor._clearance.rules import (
    KINDS,
    NEXT_VOLTAGE,
    OBJECTS,
    Voltages,
    rule_set,
    shipped,
    span_of,
    voltages_of,
)

PAGE = Path(__file__).parent / "reference" / "clearance-rules.md"
TOLD = [kind for kind in KINDS if kind != "unclassified"]
HEAD = """# Clearance rules, by set, kind and voltage

Made from the tables in `algorithms/corridor/rules` by `docs/make_clearance_rules.py`. What the
columns mean, and how the rules are used: [clearances](../explanation/clearance.md#rules).

A distance is in space, below a wire (v) or beside it (h), in the unit of the table; *(w)* marks a
warning, *?* a value that was not found in a document. **A dash is no rule**: what comes near is
listed as "no rule" ([what near is](../explanation/clearance.md#without-a-rule)). Voltages that are
not in the table of a set are refused. Where all distances of a kind are (v), what is beside the
wire has no rule. Unclassified points may be a tree, a building or something else, and are held to
the strictest of these columns.
"""


def page() -> str:
    """The page, as Markdown."""
    return "\n".join([HEAD, *_near(), *(line for name in shipped() for line in _set(name))])


def _near() -> Iterator[str]:
    yield "## Near, where there is no rule\n"
    yield f"{APPROACH_SOURCE}; {UNKNOWN_SOURCE}.\n"
    yield "| voltage | distance |\n| --- | --- |"
    for voltage, feet in APPROACH:
        more = " and above" if voltage == APPROACH[-1][0] else ""
        yield f"| to {voltage} kV{more} | {feet} ft |"
    yield f"| not given | {UNKNOWN_APPROACH:g} m |\n"


def _set(name: str) -> Iterator[str]:
    """A section on a rule set: a row for each range of voltage in which the same rules hold."""
    rows = rule_set(name).frame.to_dict("records")
    yield f"## {name}\n"
    yield f"| voltage | {' | '.join(TOLD)} |"
    yield "| --- " * (len(TOLD) + 1) + "|"
    for span in _spans(rows):
        holding = [row for row in rows if _holds(row, span)]
        if holding:
            cells = [", ".join(_told(row) for row in _of(holding, kind)) or "-" for kind in TOLD]
            yield f"| {span_of(span)} | {' | '.join(cells)} |"
    yield ""


def _spans(rows: list[dict[Any, Any]]) -> list[Voltages]:
    """Ranges of voltage between those at which a rule begins or ends."""
    held = [voltages_of(row) for row in rows]
    starts = {low for low, _ in held} | {high + NEXT_VOLTAGE for _, high in held if high < math.inf}
    order = [*sorted(round(start, 3) for start in starts), math.inf]
    return [(low, round(high - NEXT_VOLTAGE, 3)) for low, high in pairwise(order)]


def _holds(row: dict[Any, Any], span: Voltages) -> bool:
    low, high = voltages_of(row)
    return low <= span[0] <= high


def _of(rows: list[dict[Any, Any]], kind: str) -> list[dict[Any, Any]]:
    return [
        row for row in rows if row["kind"] == kind or (row["kind"] == "any" and kind in OBJECTS)
    ]


def _told(row: dict[Any, Any]) -> str:
    """Distance of a row, such as `2.5 m + 0.01 m/kV h ?`."""
    more = "" if pd.isna(row["per_kv"]) else f" + {row['per_kv']:g} {row['unit']}/kV"
    direction = {"3-D": "", "vertical": " v", "horizontal": " h"}[row["direction"]]
    mark = " (w)" if row["severity"] == "warning" else ""
    doubt = "" if row["confirmed"] else " ?"
    return f"{row['threshold']:g} {row['unit']}{more}{direction}{mark}{doubt}"


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
