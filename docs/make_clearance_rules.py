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
    AMERICAN,
    AMERICAN_SOURCE,
    APPROACH,
    APPROACH_SOURCE,
    UNKNOWN_APPROACH,
)
from algorithms.corridor._clearance.rules import (
    KINDS,
    NEXT_VOLTAGE,
    OBJECTS,
    STUDY,
    TITLES,
    Voltages,
    covered,
    rule_set,
    shipped,
    span_of,
    voltages_of,
)

FOR = {  # where a set is asked for, and what else to know
    "ch_lev": "Switzerland. Trees: ask the owner of the line",
    "cpuc_go95": "California, USA; other states follow the NESC, which is not here",
    "ekaty": "Türkiye",
    "en_50341": "Countries of CENELEC. To 45 kV the Czech values; above, the main body of the "
    "standard: the national annex (NNA) of the country decides",
    "nerc_fac_003": "USA, and the provinces of Canada that adopted it; from 200 kV, below it for "
    "lines that an authority has named. Distances at sea level: they grow with altitude, which "
    "the report says",
    "thesis": "No country: risk classes of a study, the default",
}
PAGE = Path(__file__).parent / "reference" / "clearance-rules.md"
TOLD = [kind for kind in KINDS if kind != "unclassified"]
HEAD = """# Clearance rules, by set, kind and voltage

Made from the tables in `algorithms/corridor/rules` by `docs/make_clearance_rules.py`. What the
columns mean, and how the rules are used: [clearances](../explanation/clearance.md#rules).

No table is the regulation itself: its edition in force decides, of European standards with the
national annex. Name a set
(`--rules en_50341 --voltage 110`), a table of your own (`--rule_table`,
[below](#your-own-table)), or one distance for all (`--distance 5`); the report says which it was.
Of the default, a study, it warns that this is no regulation.

A distance is in space, below a wire (v) or beside it (h), in the unit of the table; *(w)* marks a
warning, and an asterisk a value that was not read in the regulation itself, but in a secondary text
or in none: the engineer in charge confirms it, for which the report has a place to sign. **A dash
is no rule**: what comes near is listed as "no rule"
([what near is](../explanation/clearance.md#without-a-rule)). Voltages that are not in the table of
a set are refused. Where all distances of a kind are (v), what is beside the
wire has no rule. Unclassified points may be a tree, a building or something else, and are held to
the strictest of these columns.
"""
OWN = """## Your own table

A company's or a country's distances are a CSV file with these columns, a row for each distance:

```text
id,source,date,unit,kind,direction,threshold,within,severity,confirmed,note
tree,"Grid code, 4.2",2026-01,m,tree,3-D,3.0,,critical,true,At the largest sag
ground,"Grid code, 4.1",2026-01,m,ground,vertical,7.5,3.0,critical,true,
```

```console
python -m toolbox run models.power_line_clearance --points line.laz --rule_table grid.csv \\
    --deliver line12
```

`kind` is one of tree, building, other, unclassified, ground, water, rail, road, line, or any;
`direction` 3-D, vertical or horizontal; `severity` critical, warning or watch. Further columns are
`voltage_min` and `voltage_max`, in kV, with which `--voltage` must be given, `per_kv`, added
per kV, and `altitude`, up to which the distance is enough (of a regulation whose distances grow
with altitude, take the row for your line). `within` and `note` may be empty or missing.
`confirmed` tells if you vouch
for the value: the report says *given for this report*, and *to be confirmed* otherwise. If any row
is in ft, what is near without a rule follows the order of the USA. What is wrong in a table is told
row by row, before the run.
"""


def page() -> str:
    """The page, as Markdown."""
    sets = [line for name in shipped() for line in _set(name)]
    return "\n".join([HEAD, *_which(), *_near(), *sets, OWN])


def _which() -> Iterator[str]:
    """A table of the sets: where each is asked for, and for which kinds it has no distance."""
    yield "## Which set\n"
    yield "For other countries: [a table of your own](#your-own-table), or `--distance`.\n"
    yield "| set | source | where | voltages | no distance at any voltage for |"
    yield "| --- | --- | --- | --- | --- |"
    for name in shipped():
        table = rule_set(name)
        known = covered(table)
        silent = ", ".join(kind for kind in TOLD if kind not in known) or "-"
        voltages = [voltages_of(row) for row in table.frame.to_dict("records")]
        span = span_of((min(low for low, _ in voltages), max(high for _, high in voltages)))
        yield f"| `{name}` | {TITLES[name]} | {FOR[name]} | {span} | {silent} |"
    yield ""


def _near() -> Iterator[str]:
    """What is near without a rule, in Europe and elsewhere, and with the tables of the USA."""
    yield "## Near, where there is no rule\n"
    yield f"{APPROACH_SOURCE}:\n"
    yield "| voltage | distance |\n| --- | --- |"
    yield from (f"| to {voltage} kV | {metres:g} m |" for voltage, metres in APPROACH)
    yield f"| not given | {UNKNOWN_APPROACH:g} m |\n"
    yield f"With tables in feet, and above {APPROACH[-1][0]} kV: {AMERICAN_SOURCE}:\n"
    yield "| voltage | distance |\n| --- | --- |"
    for voltage, feet in AMERICAN:
        more = " and above" if voltage == AMERICAN[-1][0] else ""
        yield f"| to {voltage} kV{more} | {feet} ft |"
    yield ""


def _set(name: str) -> Iterator[str]:
    """A section on a rule set: a row for each range of voltage in which the same rules hold."""
    rows = rule_set(name).frame.to_dict("records")
    study = ", the risk classes of a study, which are no regulation" if name == STUDY else ""
    yield f"## {name}\n\n{TITLES[name]}{study}.\n"
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
    doubt = "" if row["confirmed"] else "\\*"
    return f"{row['threshold']:g} {row['unit']}{more}{direction}{mark}{doubt}"


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
