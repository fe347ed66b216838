"""Kinds of objects that no rule holds for: when they are near, and what is said of them.

No rule is no permission: what comes near a wire and has no rule is listed so, with its distance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._clearance.counted import ZONE_COLUMNS
from algorithms.corridor._clearance.crossings import Crossing
from algorithms.corridor._clearance.distances import Least, Violations
from algorithms.corridor._clearance.objects import FALLING, TREES
from algorithms.corridor._clearance.rules import (
    KINDS,
    LINE,
    NO_RULE,
    OBJECTS,
    SURFACES,
    UNIT_METRES,
    UNSURE,
    Rule,
)
from algorithms.corridor._clearance.surroundings import Object, Surroundings
from toolbox.data import Table

# How near work, such as with cranes, may come to a line: highest voltage, kV, and distance.
APPROACH = ((1, 1.0), (110, 3.0), (220, 4.0), (380, 5.0))  # metres
APPROACH_SOURCE = "DIN VDE 0105-100, by DGUV Regel 114-014, § 6.7"
UNKNOWN_APPROACH = 5.0  # metres
UNKNOWN_SOURCE = "DIN VDE 0105-100 for an unknown voltage, by DGUV Regel 114-014, § 6.7"
AMERICAN = ((50, 10), (200, 15), (350, 20), (500, 25), (750, 35), (1000, 45))  # feet
AMERICAN_SOURCE = "29 CFR § 1926.1408, table A, which cranes must keep in the USA"
LARGEST_SOURCE = "the largest distance that other objects must keep"
LEAST_SOURCE = "the least distance that other surfaces must keep"
LINE_SOURCE = "the largest distance that lines must keep"
OWN_SOURCE = "as far as these rules reach"
BESIDE = "nothing is asked for what is beside the wire"
BELOW = "nothing is asked for what is below the wire"
NEAR = "near, no rule"
FALL = "may fall"
WAYS = ("too close", "watched", FALL, NEAR)


@dataclass(frozen=True)
class Coverage:
    """What the rules cover.

    Attributes
    ----------
    kinds : a row for each kind, with its rules, its nearest point and its objects
    near : a sentence for each kind that is near and has no rule
    """

    kinds: Table
    near: list[str]


def approach(voltage: float | None, *, american: bool) -> tuple[float, str]:
    """Distance that anything should keep from a line of a voltage in kV, metres; its source.

    With rules of the USA that of the USA, which also goes on where the European table ends.
    """
    if voltage is None:
        return UNKNOWN_APPROACH, UNKNOWN_SOURCE
    if not american and voltage <= APPROACH[-1][0]:
        return next(far for highest, far in APPROACH if voltage <= highest), APPROACH_SOURCE
    feet = next((far for highest, far in AMERICAN if voltage <= highest), AMERICAN[-1][1])
    return feet * UNIT_METRES["ft"], AMERICAN_SOURCE


def stand_ins(
    rules: Sequence[Rule], why: Mapping[str, str], voltage: float | None, *, american: bool = False
) -> list[Rule]:
    """Rules in place of missing ones, so that nothing that comes near is passed over.

    A kind without a rule is near within the distance of `approach`, or within that which the rules
    ask of others of its sort, if it is larger. Of objects above the ground that is the largest of
    all, as nothing should be there; of the ground and what lies on it the least that any of it must
    keep, as the ground is below every wire. A kind whose rules are all vertical has none for what
    is beside the wire, such as a slope: that is near within the distance of `approach`, but no
    farther than the rules reach downwards; likewise if they are all horizontal.

    Parameters
    ----------
    rules : that hold for the voltage
    why : for each kind, why none of them holds for it
    voltage : between two phases, kV; None if not known
    american : whether the rules are of the USA
    """
    made = []
    usual = approach(voltage, american=american)
    sorts = (
        (OBJECTS, max, LARGEST_SOURCE),
        (SURFACES, min, LEAST_SOURCE),
        ((LINE,), max, LINE_SOURCE),
    )
    for sort, choose, source in sorts:
        own = {kind: [rule for rule in rules if rule.holds_for(kind)] for kind in sort}
        asked = {kind: max(r.threshold for r in held) for kind, held in own.items() if held}
        near = max(usual, (choose(asked.values(), default=0.0), source))
        for kind in sort:
            directions = {rule.direction for rule in own[kind]}
            if kind == "unclassified":  # rules for other objects hold for it
                continue
            if not directions:
                made.append(_stand_in(kind, *near, why[kind]))
            elif len(directions) == 1 and directions != {"3-D"}:
                beside = min(usual, (asked[kind], OWN_SOURCE))
                note = BESIDE if directions == {"vertical"} else BELOW
                made.append(_stand_in(kind, *beside, note))
    return made


def _stand_in(kind: str, near: float, source: str, note: str) -> Rule:
    return Rule(NO_RULE, source, "", kind, "3-D", near, near, NO_RULE, confirmed=True, note=note)


def coverage_of(
    surroundings: Surroundings,
    rules: Sequence[Rule],
    found: Violations,
    least: Least,
    objects: Sequence[Object],
    crossings: Sequence[Crossing],
    zones: NDArray[np.int64],
) -> Coverage:
    """Which kinds have rules, how near each comes, and what is near without a rule.

    Parameters
    ----------
    zones : array of shape (states, wires, kinds, zones), numbers of points; see `count_in_zones`
    """
    nearest = least.distance.min(axis=(0, 1), initial=np.inf)
    broken = [(one.kind, one.rule) for one in objects]
    broken += [(LINE, one.rule) for one in crossings if one.rule >= 0]
    may_fall = TREES if FALLING in rules else ()
    rows = []
    for number, (kind, distance) in enumerate(zip(KINDS, nearest.tolist(), strict=True)):
        own = [_way(rules[rule]) for other, rule in broken if other == kind]
        counts = zones[0, :, number].sum(axis=0).tolist() if kind in OBJECTS else [None, None]
        rows.append(
            {
                "kind": kind,
                "nearest": round(distance, 2) if math.isfinite(distance) else None,
                **{way: own.count(way) for way in WAYS},
                FALL: own.count(FALL) if number in may_fall else None,
                **dict(zip(ZONE_COLUMNS, counts, strict=True)),
                "rule": rules_for(kind, rules, sources=False),
            }
        )
    return Coverage(Table.from_rows(rows), list(_near(surroundings, rules, found, objects)))


def _way(rule: Rule) -> str:
    """In which of several ways an object is listed."""
    if rule.severity == NO_RULE:
        return NEAR
    if rule.id == FALLING.id:
        return FALL
    return "watched" if rule.severity == "watch" else "too close"


def rules_for(kind: str, rules: Sequence[Rule], *, sources: bool = True) -> str:
    """What a kind is held to, and what it has no rule for, in words; with where that is from."""
    own = [rule for rule in rules if rule.severity != UNSURE and rule.id != FALLING.id]
    held = [rule for rule in own if rule.holds_for(kind)]
    missing = [rule for rule in held if rule.severity == NO_RULE]
    ids = [rule.id for rule in held if rule.severity != NO_RULE]
    told = ", ".join(ids)
    if len(ids) > 1 and kind == "unclassified":
        told = f"held to the strictest of {told}"
    if not missing:
        return told
    why = missing[0].note if missing[0].note in (BESIDE, BELOW) else f"no rule: {missing[0].note}"
    if kind == "unclassified":
        why = f"no rule if it is {' or '.join(rule.kind for rule in missing)}"
    far = max(missing, key=lambda rule: rule.threshold)
    near = f"listed within {far.threshold:.2f} m" + (f" ({far.source})" if sources else "")
    return f"{told}{'; ' if told else ''}{why}; {near}"


def _near(
    surroundings: Surroundings,
    rules: Sequence[Rule],
    found: Violations,
    objects: Sequence[Object],
) -> Iterator[str]:
    """A sentence for each kind that comes near without a rule, also if it is no object."""
    without = np.array([rule.severity == NO_RULE for rule in rules], bool)[found.rule]
    for number, kind in enumerate(KINDS):
        own = without & (surroundings.kind[found.point] == number)
        if own.any():
            listed = sum(one.kind == kind and _way(rules[one.rule]) == NEAR for one in objects)
            yield (
                f"{kind}: objects {listed}, points {own.sum()}, the nearest at "
                f"{found.space[own].min():.2f} m; {rules_for(kind, rules)}"
            )
