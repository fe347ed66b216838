"""Clearance rules from tables: the distance that objects must keep from a conductor.

The tables of the toolbox are in the folder `rules`, one CSV file per set. A table of a user has the
same columns.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd

from toolbox.data import Table
from toolbox.errors import DataError, nearest

RULES_FOLDER = Path(__file__).parents[1] / "rules"
TITLES = {  # of the rule sets of the toolbox, as people know them
    "ch_lev": "LeV of Switzerland",
    "cpuc_go95": "CPUC General Order 95",
    "ekaty": "EKATY of Turkey",
    "en_50341": "EN 50341 and EN 50423",
    "nerc_fac_003": "NERC FAC-003-4",
    "thesis": "Muş (2019)",
}
STUDY = "thesis"  # the set that is no regulation
RULE_COLUMNS = (
    "id",
    "source",
    "date",
    "unit",
    "voltage_min",
    "voltage_max",
    "kind",
    "direction",
    "threshold",
    "per_kv",
    "within",
    "altitude",
    "severity",
    "confirmed",
    "note",
)
NEEDED_RULE_COLUMNS = (
    "id",
    "source",
    "date",
    "unit",
    "kind",
    "direction",
    "threshold",
    "severity",
    "confirmed",
)
UNIT_METRES = {"m": 1.0, "ft": 0.3048}
KINDS = ("tree", "building", "other", "unclassified", "ground", "water", "rail", "road", "line")
OBJECTS, SURFACES, LINE = KINDS[:4], KINDS[4:8], KINDS[8]
DIRECTIONS = ("3-D", "vertical", "horizontal")
NO_RULE = "no rule"  # of what is near and has none
UNSURE = "not sure"  # of what may be a part of the line
SEVERITIES = ("critical", "warning", NO_RULE, "watch", UNSURE)  # the most urgent first
BROKEN = SEVERITIES[:2]  # of what is nearer than a rule allows
LARGEST_THRESHOLD = 200.0  # metres that a rule may ask for
NEXT_VOLTAGE = 0.001  # kV from the end of one row to the start of the next without a gap

Voltages: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class Rule:
    """A rule: one distance that objects of a kind must keep, in metres.

    Attributes
    ----------
    id, source, date, note : of the rule, as in the table
    kind : of the objects that it holds for: one of KINDS, or "any" for whatever is no ground
    direction : one of DIRECTIONS
    threshold : what is nearer breaks the rule
    within : of a vertical distance: it holds for what is no farther to the side than this; of a
        horizontal one: for what is no farther above or below
    severity : one of SEVERITIES
    confirmed : whether the value was read in the regulation itself, or in the study
    given : whether the user gave it, as a table or as one distance
    altitude : metres above the sea up to which it is enough; higher up the source asks for more
    """

    id: str
    source: str
    date: str
    kind: str
    direction: str
    threshold: float
    within: float
    severity: str
    confirmed: bool
    note: str = ""
    given: bool = False
    altitude: float = math.inf

    def holds_for(self, kind: str) -> bool:
        """Whether the rule holds for points of a kind.

        What is not classified may be a tree or a building: rules for both hold for it.
        """
        if self.kind == "any":
            return kind in OBJECTS
        return kind == self.kind or (kind == "unclassified" and self.kind in OBJECTS)


def shipped() -> tuple[str, ...]:
    """Names of the rule sets of the toolbox."""
    return tuple(sorted(path.stem for path in RULES_FOLDER.glob("*.csv")))


def unknown_set(name: str) -> str:
    """The problem if no rule set has that name; empty if one has."""
    if name in shipped():
        return ""
    return f"no rule set {name!r}; there are {', '.join(shipped())}{nearest(name, shipped())}"


def is_american(table: Table) -> bool:
    """Whether a table is taken as one of the USA: any of its rows, also of a user's, is in feet."""
    return bool((table.frame["unit"] == "ft").any())


def has_annex(source: str) -> bool:
    """Whether a source is a European standard, to which countries have annexes of their own.

    Examples
    --------
    >>> has_annex("ČSN EN 50423-1 (Czech Republic)"), has_annex("NERC FAC-003-4")
    (True, False)
    """
    return re.search(r"\bEN \d", source) is not None


def basis_of(name: str, voltage: float | None) -> str:
    """What the distances of a rule set of the toolbox are, in a sentence."""
    title = TITLES[name]
    if name == STUDY:
        return (
            f"Distances required: risk classes of a study, {TITLES[name]}; they are no regulation."
        )
    decides = "the regulation in force decides"
    if has_annex(TITLES[name]):
        decides = "the regulation in force and its national annex decide"
    if voltage is not None:
        title = f"{title} for a voltage of {voltage:g} kV"
    return f"Distances required: {title}, as tabulated by this program; {decides}."


def rule_set(name: str) -> Table:
    """Table of a rule set of the toolbox."""
    return Table.open(RULES_FOLDER / f"{name}.csv")


def single(distance: float) -> list[Rule]:
    """The rule that all objects must keep one distance, in metres."""
    id, source, how = "given distance", "given for this report, in place of a rule set", "critical"
    return [Rule(id, source, "", "any", "3-D", distance, 0.0, how, confirmed=True, given=True)]


def rules_of(table: Table, voltage: float | None) -> list[Rule]:
    """The rules of a table that hold for a voltage.

    Parameters
    ----------
    table : with the columns RULE_COLUMNS; those that are not in NEEDED_RULE_COLUMNS may be missing
    voltage : between two phases, kV; None where no rule depends on it

    Raises
    ------
    DataError
        A column or value is missing or wrong, the rules depend on the voltage and none is given, or
        none of them holds for it. All that is wrong is told at once.
    """
    missing = [name for name in NEEDED_RULE_COLUMNS if name not in table.frame.columns]
    if missing:
        raise DataError(f"{table.name}: no column {', '.join(missing)}; a rule needs them")
    if not len(table):
        raise DataError(f"{table.name}: there are no rules")
    rows = table.frame.to_dict("records")
    wrong = [
        f"row {number}: {problem}"
        for number, row in enumerate(rows, start=1)
        for problem in _problems(row)
    ]
    ids = [str(row["id"]) for row in rows]
    wrong += [
        f"id {name!r} is there twice" for name in sorted({i for i in ids if ids.count(i) > 1})
    ]
    if wrong:
        raise DataError(f"{table.name}: " + "; ".join(wrong))
    classes = [voltages_of(row) for row in rows]
    depends = any(low > 0 or high < math.inf for low, high in classes)
    if depends and voltage is None:
        raise DataError(f"{table.name}: its rules depend on the voltage of the line; give voltage")
    at = voltage or 0.0
    chosen = [
        _rule(row, at)
        for row, (low, high) in zip(rows, classes, strict=True)
        if not depends or low <= at <= high
    ]
    if not chosen:
        spans = ", ".join(f"{low:g}-{high:g}" for low, high in sorted(set(classes)))
        raise DataError(f"{table.name}: no rule holds for {voltage:g} kV; there are {spans} kV")
    return chosen


def why_none(table: Table, voltage: float | None) -> dict[str, str]:
    """For each kind, why no rule of a table holds for it at a voltage, if none does."""
    at = "" if voltage is None else f" at {voltage:g} kV"
    name = TITLES.get(table.name.removesuffix(".csv"), table.name)
    told = {kind: f"the table of {name} used here has none for {kind}" for kind in KINDS}
    for kind, voltages in covered(table).items():
        told[kind] += f"{at}, only for {' and '.join(map(span_of, voltages))}"
    return told


def span_of(voltages: Voltages) -> str:
    """Voltages from and to in words."""
    low, high = voltages
    if high == math.inf:
        return f"above {low:g} kV" if low else "all voltages"
    return f"{low:g}-{high:g} kV" if low < high else f"{low:g} kV"


def covered(table: Table) -> dict[str, list[Voltages]]:
    """Voltages in kV, from and to, for which a table has rows, by kind; kinds without any miss."""
    found: dict[str, list[Voltages]] = {}
    for row in sorted(table.frame.to_dict("records"), key=voltages_of):
        for kind in OBJECTS if row["kind"] == "any" else (row["kind"],):
            known = found.setdefault(kind, [])
            low, high = voltages_of(row)
            if known and low <= known[-1][1] + 1.5 * NEXT_VOLTAGE:
                known[-1] = known[-1][0], max(known[-1][1], high)
            else:
                known.append((low, high))
    return found


def _problems(row: Mapping[Any, Any]) -> list[str]:
    """Problems of one row of a rule table."""
    found = [
        f"{name} is empty" for name in NEEDED_RULE_COLUMNS if pd.isna(row[name]) or row[name] == ""
    ]
    choices = {
        "unit": tuple(UNIT_METRES),
        "direction": DIRECTIONS,
        "severity": tuple(word for word in SEVERITIES if word not in (NO_RULE, UNSURE)),
        "kind": (*KINDS, "any"),
    }
    for name, words in choices.items():
        if not pd.isna(row[name]) and row[name] not in words:
            found.append(f"{name} must be one of {', '.join(words)}, got {row[name]!r}")
    for name in ("threshold", "per_kv", "within", "altitude", "voltage_min", "voltage_max"):
        value = row.get(name)
        if not _is_missing(value) and not _is_number(value):
            found.append(f"{name} must be a number of at least 0, got {value!r}")
    if _is_number(row["threshold"]) and row["unit"] in UNIT_METRES:
        metres = float(row["threshold"]) * UNIT_METRES[row["unit"]]
        if not 0 < metres <= LARGEST_THRESHOLD:
            found.append(
                f"threshold must be above 0 and at most {LARGEST_THRESHOLD:g} m, got {metres:g} m"
            )
    low: Any = row.get("voltage_min")
    high: Any = row.get("voltage_max")
    if _is_number(low) and _is_number(high) and float(low) > float(high):
        found.append(f"voltage_min {low} is above voltage_max {high}")
    if str(row["confirmed"]).lower() not in ("true", "false") and not pd.isna(row["confirmed"]):
        found.append(f"confirmed must be true or false, got {row['confirmed']!r}")
    return found


def _is_missing(value: Any) -> bool:
    return value is None or bool(pd.isna(value))


def _is_number(value: Any) -> bool:
    """Whether a value is a number of at least 0; it may be a text.

    A column with one word in it has its numbers as texts.
    """
    if _is_missing(value) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(float(value)) and float(value) >= 0
    except ValueError:
        return False


def voltages_of(row: Mapping[Any, Any]) -> Voltages:
    """Voltages from and to, in kV, for which a row of a rule table holds."""
    low: Any = row.get("voltage_min")
    high: Any = row.get("voltage_max")
    return 0.0 if _is_missing(low) else float(low), math.inf if _is_missing(high) else float(high)


def _rule(row: Mapping[Any, Any], voltage: float) -> Rule:
    unit = UNIT_METRES[row["unit"]]
    more = 0.0 if _is_missing(row.get("per_kv")) else float(row["per_kv"])
    threshold = (float(row["threshold"]) + more * voltage) * unit
    within: Any = row.get("within")
    altitude: Any = row.get("altitude")
    note = row.get("note")
    return Rule(
        str(row["id"]),
        str(row["source"]),
        str(row["date"]),
        row["kind"],
        row["direction"],
        threshold,
        threshold if _is_missing(within) else float(within) * unit,
        row["severity"],
        str(row["confirmed"]).lower() == "true",
        "" if _is_missing(note) else str(note),
        altitude=math.inf if _is_missing(altitude) else float(altitude) * unit,
    )


def grown(rules: Sequence[Rule], growth: float) -> list[Rule]:
    """Rules for trees that keep the rules also after growing by some metres."""
    return [
        replace(
            rule,
            id=f"{rule.id}+{growth:g}m",
            kind="tree",
            threshold=rule.threshold + growth,
            severity="watch",
            note=f"After {growth:g} m of growth",
        )
        for rule in rules
        if rule.holds_for("tree")
    ]


def is_broken(rule: Rule, space: float, tall: float, flat: float) -> bool:
    """Whether distances in space, vertical and horizontal, in metres, break a rule."""
    value, other = {
        "3-D": (space, 0.0),
        "vertical": (tall, flat),
        "horizontal": (flat, tall),
    }[rule.direction]
    return value < rule.threshold and other <= rule.within


def reach_of(rules: Sequence[Rule]) -> float:
    """Largest horizontal distance from a conductor at which any of the rules applies, metres."""
    sideways = [r.within if r.direction == "vertical" else r.threshold for r in rules]
    return max(sideways, default=0.0)
