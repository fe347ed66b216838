"""Report on a clearance analysis: map, profiles of spans, list of objects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.corridor import _columns as columns
from algorithms.corridor._clearance.counted import ZONE_COLUMNS
from algorithms.corridor._clearance.coverage import Coverage
from algorithms.corridor._clearance.distances import Least, distances
from algorithms.corridor._clearance.drawing import Drawing
from algorithms.corridor._clearance.objects import FALLING
from algorithms.corridor._clearance.rest import AtRest
from algorithms.corridor._clearance.rules import (
    BROKEN,
    KINDS,
    NO_RULE,
    OBJECTS,
    SEVERITIES,
    SURFACES,
    UNSURE,
    Rule,
    has_annex,
)
from algorithms.corridor._clearance.sag import Conductor, State
from algorithms.corridor._clearance.surroundings import (
    LOW_LISTED,
    OF_LINE,
    LineStates,
    Object,
    Surroundings,
)
from algorithms.corridor._curves.catenary import Catenary
from toolbox.context import QUIET, Context
from toolbox.data import Figure, Report, Rows, Section, Table, Vector
from toolbox.data.crs import short_unit
from toolbox.data.report import Column, Head

MOST_PROFILES, MOST_OBJECTS, MOST_SPANS, MOST_NUMBERS = 100, 200, 400, 30
PROFILE_BESIDE = 20.0  # metres to both sides of a span that its profile shows
SHEET, MOST_SHEETS = 800.0, 20  # length of a sheet of the map, metres; longer if there were more
# Shares of the width and the height of a profile around what it shows: room for a name of a tower.
PROFILE_ROOM = np.array([0.02, 0.06])
MAP_SIZE, PROFILE_SIZE = (850.0, 930.0), (880.0, 350.0)  # pixels, the former at most
STRETCH_LENGTH = 10.0  # metres
RIGHT_BELOW, BELOW_COLOUR = 1.0, "#7a4a10"  # metres to the side of a wire, and colour in profiles
LEAST_COLOUR = "#000000"
KIND_COLOURS = {
    "tree": "#4a9c4a",
    "building": "#b0703c",
    "other": "#7a5ea8",
    "unclassified": "#9a9a9a",
    "ground": "#c9b48a",
    "water": "#7fb2e0",
    "rail": "#6b6b6b",
    "road": "#8c8c8c",
    "line": "#0040a0",
}
SEVERITY_COLOURS = {
    "critical": "#d40000",
    "warning": "#f08000",
    NO_RULE: "#d01c8b",
    "watch": "#d8c000",
    UNSURE: "#606060",
}
SURVEYED = ("severity_surveyed", "clearance_surveyed")
LISTED = (
    "object_id",
    "clump",
    "severity",
    "kind",
    "rule",
    "clearance",
    "clearance_low",
    "clearance_high",
    "required",
    "sd",
    "probability",
    "falls",
    "distance",
    "state",
    *SURVEYED,
    "span_id",
    "wire_id",
    "chainage",
    "height",
    "points",
    "may_be_wire",
    "may_touch",
)
LIST_CAPTION = (
    "Each object stands where it is closest to a wire. The clearance at other temperatures is that "
    "in the wind of the survey (see Temperature of the wires). Objects of one clump touch, if need "
    "be through points between them that are not listed: a wide group of trees is listed tree by "
    "tree, and a tree part by part if only parts of it are too close. Where Shape of a wire says "
    "yes, the points may be a wire that was not found"
)
UNSURE_CAPTION = (
    "Listed is the point nearest to each wire. What has the class of plants, or none, and hangs in "
    "mid-air on a wire, a tower or by itself, may be a part of the line that was not recognised. "
    "It counts in no figure of what is too close: look at it. The numbers go on from those of the "
    "objects"
)
SPAN_CAPTION = (
    "For each span and state of the wires: the least distances in space to what is near the wires "
    "in plan. Clearance is that to the nearest object; at other temperatures, see Temperature of "
    "the wires. The swing is empty where the wires sag too little to tell. A bundle counts as one "
    "conductor, and so do a guard wire, and two positions of a wire that wind swung between "
    "flights. Wire-like points have the shape of a wire, and are none"
)
KIND_CAPTION = (
    "For each kind of object: its least distance in space from a wire, of what is near the wires "
    "in plan; how many objects are too close, are to be watched as trees that grow, reach a wire "
    "only if they fall, or are near and have no rule; its points by their distance from the wires; "
    "and the rules it is held to. Several objects of one clump may be parts of one tree. Line "
    "means the conductors of another line"
)
NO_PART_CAPTION = "These points are part of no object"
ZONE_CAPTION = (
    "For each span: how many points of objects lie how far, in space, from the nearest wire as "
    "surveyed; the ground, and plants that are too low, do not count"
)
CROSSING_CAPTION = (
    "The table lists where conductors of two lines come near each other: the two states in which "
    "they are closest, and between which values the distance lies if each line has any temperature "
    "that it may have. A state such as 80 C is that of conductors of 80 °C, survey is as surveyed"
)
RULE_CAPTION = (
    "The distances that were required. Within: of a vertical distance, how far to the side it "
    "holds; of a horizontal one, how far above and below. No rule: what comes so near is listed"
)
TO_CONFIRM = (
    "The distances marked “to be confirmed” were not read in the regulation itself. They are to be "
    "confirmed by the engineer in charge against the regulation in force."
)
OF_EUROPE = "Of European standards (EN), the national annex is a part of it."
TO_SIGN = (
    "Confirmed by: ______________________  Date: ______________  Signature: ______________________"
)
TOWER_COLOUR = "#8a2be2"
WIRE_COLOUR, WIRE_DASHES = "#0040a0", ("", "6 3", "1 3", "6 3 1 3")  # of wires, by state

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Spot = tuple[int, Object, Floats]  # number of an object, the object, its position in a picture


def report_of(
    surroundings: Surroundings,
    line: LineStates,
    rules: Sequence[Rule],
    objects: Sequence[Object],
    listed: pd.DataFrame,
    unsure: pd.DataFrame,
    spans: Table,
    least: Least,
    low: Sequence[str],
    conductor: Conductor | None,
    coverage: Coverage,
    missing: Section,
    rest: AtRest,
    crossings: pd.DataFrame,
    basis: str,
    ctx: Context = QUIET,
) -> Report:
    """Report with a list of objects, a map, and tables and profiles of spans.

    Parameters
    ----------
    objects : also those that are not sure, last
    listed, unsure : the columns of the layers of objects and of those, in the same order
    least : the points nearest to each wire
    low : severities of objects that are left out as they are too low
    missing : on wires that may be missing
    crossings : the columns of the layer of crossings
    basis : what the distances required are, in a sentence
    """
    across, near = _Across.of(surroundings, line), ctx.part(0.0, 0.3)
    axes = _Axes(Vector(listed).metre, short_unit(listed.crs) if listed.crs else "")
    profiled = ctx.part(0.3, 1.0)
    sections = [
        missing,
        Section("Kinds and their rules", _kind_list(coverage) if line.spans else []),
        Section("Map with numbers", _map(across, line, rules, objects, axes, near)),
        Section("Objects, the most urgent first", _list(listed, line)),
        Section("Not sure: plants or parts of the line", _unsure_list(unsure)),
        Section("Crossing lines", _crossing_list(crossings)),
        Section("Spans", _span_list(spans)),
        Section("Points near the wires", _zone_list(spans)),
        Section("Temperature of the wires", [_rest_text(line, rest, conductor)]),
        Section("Profiles", _profiles(across, line, rules, objects, least, axes, profiled)),
        Section("Distances required", _required(rules, coverage, line, Vector(listed).crs)),
        Section("States of the wires", [_wires_text(line, conductor)]),
        Section("Points that take no part", _left_out(surroundings)),
    ]
    shown = [section for section in sections if section.blocks]
    summary = _summary(surroundings, line, rules, objects, listed, least, low, coverage, basis)
    unseen = _unseen(surroundings, line, coverage, missing)
    unseen += _may_break(surroundings, line, rest) if line.spans else []
    head = Head(unseen=unseen)
    title = "Clearances of a power line"
    return Report(title, shown, summary=summary, head=head, name="clearance")


def _unseen(
    surroundings: Surroundings, line: LineStates, coverage: Coverage, missing: Section
) -> list[str]:
    """What was not looked at: kinds without a rule, wires not seen, ends of the data, points."""
    if not line.spans:
        return ["Anything: no wire was found, so no distance was measured."]
    unruled = _unruled(coverage)
    told = [f"No rule holds for: {', '.join(unruled)}."] if unruled else []
    told += _unnamed(surroundings)
    told += [
        f"{why}: {count} points."
        for why, count in surroundings.left_out.items()
        if (count or why == LOW_LISTED) and why != OF_LINE
    ]
    told += [text for block in missing.blocks for text in str(block).split("\n")[1:]]
    if line.open_spans:
        spans = ", ".join(map(str, line.open_spans))
        told.append(f"Spans that go on beyond the data: {spans}.")
    return told


def _unnamed(surroundings: Surroundings) -> list[str]:
    """Of what lies on the ground, the kinds that no point has the class of."""
    seen = {KINDS[number] for number in np.unique(surroundings.kind[surroundings.kind >= 0])}
    missing = [kind for kind in SURFACES if kind not in seen]
    if not missing:
        return []
    return [
        f"No point near the wires has the class of: {', '.join(missing)}. What there is of it was "
        "held to the rules for the class that its points have."
    ]


def _unruled(coverage: Coverage) -> list[str]:
    """The kinds that have no rule at all."""
    kinds = coverage.kinds.frame
    return [str(kind) for kind in kinds["kind"][kinds["rule"].str.startswith("no rule")]]


def _summary(
    surroundings: Surroundings,
    line: LineStates,
    rules: Sequence[Rule],
    objects: Sequence[Object],
    listed: pd.DataFrame,
    least: Least,
    low: Sequence[str],
    coverage: Coverage,
    basis: str,
) -> str:
    """What was found, by which rules, and what was looked at: one paragraph."""
    if not line.spans:
        return "No wire was found, so no clearance was measured."
    severities = [rules[one.rule].severity for one in objects]
    fall = [rules[one.rule].id == FALLING.id for one in objects]
    falling, unruled, unsure = sum(fall), severities.count(NO_RULE), severities.count(UNSURE)
    watched = severities.count("watch") - falling
    near = [one for one, word in zip(objects, severities, strict=True) if word in BROKEN]
    told = [_too_near(line, rules, near, coverage)]
    told.append(_worst_when(line.states[near[0].state], listed.iloc[0]) if near else "")
    told += [
        _in_clumps(listed),
        _touching(listed),
        _only_moved(listed),
        _least_of_kinds(line, least),
    ]
    told.append(f"Further trees that reach a wire if they fall: {falling}." if falling else "")
    told.append(f"Trees that will be too near when they have grown: {watched}." if watched else "")
    told.append(f"Objects that are near and have no rule: {unruled}." if unruled else "")
    told += [_low(low), _like_wires(listed)]
    if unsure:
        told.append(
            f"Not sure: points near {unsure} wires hang in mid-air, and may be of the line; they "
            "are in a list of their own."
        )
    told += [basis, _looked_at(line)]
    if not np.isfinite(surroundings.height).any():
        told.append("No point is ground: heights are not known, and falling trees not looked for.")
    return " ".join(filter(None, told))


def _too_near(
    line: LineStates, rules: Sequence[Rule], near: Sequence[Object], coverage: Coverage
) -> str:
    """How many objects break a rule, and the most urgent of them; if none, what has no rule."""
    if not near:
        kinds = ", ".join(_unruled(coverage))
        unruled = f"; there is no rule for: {kinds}" if kinds else ""
        return f"No object is nearer to the conductors than is required{unruled}."
    words = [rules[one.rule].severity for one in near]
    counts = ", ".join(f"{words.count(word)} {word}" for word in BROKEN if word in words)
    worst = near[0]
    return (
        f"{len(near)} objects are nearer to the conductors than is required ({counts}). The "
        f"worst is {worst.measure:.2f} m from a wire of span {line.span[worst.wire]} where "
        f"{rules[worst.rule].threshold:.2f} m are required: {worst.kind}."
    )


def _worst_when(state: State, worst: pd.Series) -> str:
    """In which state of the wires the worst is so near, and how near as surveyed; "" if it is so.

    Parameters
    ----------
    worst : its row in the layer of objects
    """
    if worst["state"] == "survey":
        return ""
    if state.wind:
        when = f"the wires {state.name} by {abs(state.wind):g} m/s"
    else:
        when = f"the conductors at {state.temperature:g} °C"
    now = float(worst["clearance_surveyed"])
    if not math.isfinite(now):
        return f"That is with {when}."
    if worst["severity_surveyed"] in BROKEN:
        return f"That is with {when}; as surveyed it is {now:.2f} m."
    return f"That is only with {when}; as surveyed it is {now:.2f} m."


def _least_of_kinds(line: LineStates, least: Least) -> str:
    """How near each kind comes, in which span and state of the wires; "" if nothing is near."""
    told = []
    for number, kind in enumerate(KINDS):
        values = least.distance[:, :, number]
        state, wire = np.unravel_index(values.argmin(), values.shape)
        if math.isfinite(values[state, wire]):
            moved = f", {line.states[state].name}" if state else ""
            told.append(f"{kind} {values[state, wire]:.2f} m (span {line.span[wire]}{moved})")
    return f"Least distances in space: {', '.join(told)}." if told else ""


def _low(severities: Sequence[str]) -> str:
    """How many objects are not listed only as they are too low, by severity; "" for none."""
    words = [word for word in SEVERITIES if word in severities]
    told = ", ".join(f"{severities.count(word)} {word}" for word in words)
    return f"Lower than the lowest object, which else would be listed: {told}." if told else ""


def _like_wires(listed: pd.DataFrame) -> str:
    """How many objects may be wires that were not found."""
    count = int(listed["may_be_wire"].sum())
    if not count:
        return ""
    return f"Objects in the shape of a wire, which may be wires that were not found: {count}."


def _looked_at(line: LineStates) -> str:
    """Spans, their length, and the states of the wires."""
    lengths = [
        max(c.length for c, own in zip(line.curves[0], line.span, strict=True) if own == span)
        for span in line.spans
    ]
    if len(line.states) == 1:
        return (
            f"Looked at: {len(lengths)} spans of {sum(lengths):.0f} m in all, with the wires as "
            "surveyed; hotter, in wind or under ice they were not held to the rules."
        )
    states = ", ".join(["as surveyed", *(_told(state) for state in line.states[1:])])
    return f"Looked at: {len(lengths)} spans of {sum(lengths):.0f} m in all; wires: {states}."


def doubt(rules: Sequence[Rule]) -> str:
    """Which required distances nobody has read in the regulation itself; "" for none."""
    unsure = _distances([rule for rule in rules if not rule.confirmed])
    if not unsure:
        return ""
    return (
        f"to be confirmed against the regulation in force by the engineer in charge: the distances "
        f"required ({unsure})"
    )


def too_high(rules: Sequence[Rule], line: LineStates, crs: CRS | None) -> str:
    """Which required distances do not hold so far above the sea as the wires are; "" for none."""
    low = [rule for rule in rules if rule.altitude < line.highest]
    if not low:
        return ""
    altitude = min(rule.altitude for rule in low)
    unknown = crs is None or not crs.is_compound
    sure = ", if the heights of the data are above the sea, which is not stated" if unknown else ""
    return (
        f"the wires reach {line.highest:.0f} m above the sea{sure}, and the distances required "
        f"({_distances(low)}) hold up to {altitude:.0f} m above the sea: the regulation asks for "
        "more higher up; give its distances there as a table of your own"
    )


def _distances(rules: Sequence[Rule]) -> str:
    """Kinds, distances and their directions of rules, without those that only let trees grow."""
    return ", ".join(
        f"{r.kind} {r.threshold:.4g} m {r.direction}" for r in rules if r.severity != "watch"
    )


def _touching(listed: pd.DataFrame) -> str:
    """How many objects may touch a wire as surveyed; "" for none."""
    count = int(listed["may_touch"].sum())
    if not count:
        return ""
    return (
        f"Objects that may touch a wire as surveyed: {count}; points on a wire count as of it, so "
        "that no smaller distance can be seen than that to the next point beside it."
    )


def _in_clumps(listed: pd.DataFrame) -> str:
    """In how many clumps the objects that break a rule stand; "" where each is one of its own."""
    own = listed[listed["severity"].isin(BROKEN)]
    clumps = own["clump"].nunique()
    return f"They stand in {clumps} clumps." if 0 < clumps < len(own) else ""


def _only_moved(listed: pd.DataFrame) -> str:
    """How many objects break a rule only with the wires hot or in wind, by state; "" for none."""
    own = listed[listed["severity"].isin(BROKEN) & ~listed["severity_surveyed"].isin(BROKEN)]
    states = own["state"].value_counts(sort=False)
    told = ", ".join(f"{count} ({name})" for name, count in states.items())
    return f"Too near only when the wires are hot or in wind: {told}." if told else ""


def _list(listed: pd.DataFrame, line: LineStates) -> list[Rows | str]:
    if not len(listed):
        return ["None: nothing breaks a rule, and nothing is near without one or to be watched."]
    same = SURVEYED if len(line.states) == 1 else ()
    some = listed[[*(name for name in LISTED if name not in same), "geometry"]]
    return [_places(some, LIST_CAPTION, columns.OBJECTS, "objects")]


def _unsure_list(unsure: pd.DataFrame) -> list[Rows | str]:
    if not len(unsure):
        return []
    some = unsure.drop(columns="severity")
    if some["source"].nunique() == 1:
        some = some.drop(columns="source")  # the same in all rows, and said above them
    return [_places(some, UNSURE_CAPTION, columns.UNSURE, "unsure")]


def _places(some: pd.DataFrame, caption: str, how: Mapping[str, Column], layer: str) -> Rows:
    """Table of objects with their places."""
    unit: str = short_unit(some.crs) if some.crs else ""
    how = {**how, "elevation": replace(how["elevation"], unit=unit)}
    return Rows(Vector(some).listed(), caption, MOST_OBJECTS, how, layer)


def _crossing_list(crossings: pd.DataFrame) -> list[Rows | str]:
    if not len(crossings):
        return []
    table = Vector(crossings).listed()
    return [Rows(table, CROSSING_CAPTION, MOST_OBJECTS, columns.CROSSINGS, "crossings")]


def _as_surveyed(spans: Table) -> pd.DataFrame:
    """The rows of the spans as surveyed."""
    return spans.frame[spans.frame["state"] == "survey"]


def _zone_list(spans: Table) -> list[Rows]:
    """Numbers of points of each span, and of all."""
    if not len(spans):
        return []
    frame = _as_surveyed(spans)[["span_id", *ZONE_COLUMNS]].astype({"span_id": str})
    total = pd.DataFrame([{"span_id": "all", **frame[list(ZONE_COLUMNS)].sum()}])
    return [Rows(Table(pd.concat([frame, total])), ZONE_CAPTION, MOST_SPANS, columns.SPANS)]


def _rest_text(line: LineStates, rest: AtRest, conductor: Conductor | None) -> str:
    """What is known of the temperature, and what the intervals of clearances mean."""
    told = rest.temperatures
    if rest.surveyed is None:
        text = (
            "The temperature of the wires in the survey is not known. It is taken to be from "
            f"{told.surveyed[0]:g} to {told.surveyed[1]:g} °C."
        )
    else:
        source = "computed from current and weather (IEEE 738)" if rest.computed else "given"
        text = (
            f"In the survey the wires had {rest.surveyed:.1f} °C, as {source}; it is taken to be "
            f"from {told.surveyed[0]:g} to {told.surveyed[1]:g} °C."
        )
    which = f"{conductor.name}" if conductor else "not known: any of the table of conductors"
    colder, warmer = told.change
    up, down = _moves(line)
    held = (
        f" Spans {', '.join(map(str, line.open_spans))} end where the data end, and are taken as "
        "held there: their intervals are too narrow."
    )
    return (
        f"{text} At other times they may have from {told.lowest:g} to {told.highest:g} °C, so up "
        f"to {warmer:.0f} degrees more or {-colder:.0f} less than in the survey. Conductor: "
        f"{which}. A wire may hang up to {down:.2f} m lower or {up:.2f} m higher than it was "
        "surveyed. The clearances at other temperatures are the least and the greatest in that "
        "range: of an object, and of what hangs together with it up to 15 m from it, from the wire "
        "with which it is listed; of a span from all that is near. The wind is that of the "
        "survey, and there is no ice. They are no standard "
        "deviation: nobody "
        "knows from the survey where in the range a wire is at another time. The clearance itself "
        "is that of the moment of the survey, or of the state that is named."
        f"{held if line.open_spans else ''}"
    )


def _moves(line: LineStates) -> tuple[float, float]:
    """By how much the wires may hang higher and lower than in the survey, metres."""
    if not line.spans:
        return 0.0, 0.0
    sags = np.array([[c.sag for c in curves] for curves in (line.curves[0], *line.rest)])
    return float((sags[0] - sags[1]).max()), float((sags[2] - sags[0]).max())


def _may_break(surroundings: Surroundings, line: LineStates, rest: AtRest) -> list[str]:
    """How many points may break a rule at another temperature, by kind; none if none may."""
    kinds = np.bincount(surroundings.kind[rest.may_break], minlength=len(KINDS))
    told = ", ".join(f"{kind} {count}" for kind, count in zip(KINDS, kinds, strict=True) if count)
    if not told:
        return []
    looked, more = "in all states that were looked at", ""
    if len(line.states) == 1:
        looked = "as surveyed"
        more = (
            ": to have those of hot wires listed, give the conductor and its temperature in the "
            "survey and when hot"
        )
    return [
        f"Points that keep the rules {looked}, and may break one at another temperature of the "
        f"wires: {told}. They are not listed for that{more}."
    ]


def _kind_list(coverage: Coverage) -> list[Rows]:
    return [Rows(coverage.kinds, KIND_CAPTION, columns=columns.KINDS)]


def _span_list(spans: Table) -> list[Rows]:
    """Table of spans without what is in a table of its own."""
    table = Table(spans.frame.drop(columns=list(ZONE_COLUMNS)))
    return [Rows(table, SPAN_CAPTION, MOST_SPANS, columns.SPANS, "spans")]


def _required(
    rules: Sequence[Rule], coverage: Coverage, line: LineStates, crs: CRS | None
) -> list[Rows | str]:
    """The rules, with a place to sign where one is to be confirmed.

    Those in place of missing ones are told of the kinds that are near.
    """
    kinds = coverage.kinds.frame
    near = set(kinds["kind"][kinds["nearest"].notna()])
    told = [rule for rule in rules if rule.severity != NO_RULE or rule.kind in near]
    table = Rows(_rule_table(told), RULE_CAPTION, columns=columns.RULES)
    doubtful = [rule for rule in told if not rule.confirmed]
    high = too_high(told, line, crs)
    higher = [f"{high[0].upper()}{high[1:]}."] if high else []
    if not doubtful:
        return [table, *higher]
    europe = [OF_EUROPE] if any(has_annex(rule.source) for rule in doubtful) else []
    return [table, *higher, TO_CONFIRM, *europe, TO_SIGN]


def _rule_table(rules: Sequence[Rule]) -> Table:
    return Table.from_rows(
        {
            "number": number,
            "rule": rule.id,
            "kind": rule.kind,
            "direction": rule.direction,
            "distance": round(rule.threshold, 3),
            "within": None if rule.direction == "3-D" else round(rule.within, 3),
            "severity": rule.severity,
            "confirmed": _confirmed(rule),
            "source": rule.source,
            "date": rule.date,
            "note": rule.note,
        }
        for number, rule in enumerate(rules, start=1)
    )


def _confirmed(rule: Rule) -> str | None:
    """Who vouches for the value of a rule; None of what has no such value."""
    if rule.severity in (NO_RULE, UNSURE) or rule.id == FALLING.id:
        return None
    if not rule.confirmed:
        return "to be confirmed"
    return "given for this report" if rule.given else "read in the source"


def _wires_text(line: LineStates, conductor: Conductor | None) -> str:
    states = ", ".join(_told(state) for state in line.states)
    text = f"States of the wires: {states}."
    if len(line.states) > 1 and line.open_spans:
        text += (
            f" Spans {', '.join(map(str, line.open_spans))} end without a tower: hot or in wind "
            "they are taken as held there, where in truth they hang on. Do not rely on these "
            "states near such ends."
        )
    if conductor is not None:
        text += (
            f" Conductor {conductor.name}: diameter {conductor.diameter * 1e3:.2f} mm, weight "
            f"{conductor.weight:.2f} N/m, stiffness {conductor.stiffness / 1e6:.2f} MN, expansion "
            f"{conductor.expansion * 1e6:.2f} per million and degree. Source: {conductor.source}."
        )
        if not conductor.confirmed:
            text += " To be confirmed against the data sheet of the conductor."
    return text


def _told(state: State) -> str:
    """Name of a state with its wind and the temperature of its conductors."""
    wind = f" by {abs(state.wind):g} m/s" if state.wind else ""
    warm = f" (conductors of {state.temperature:g} °C)" if state.temperature is not None else ""
    return state.name + wind + warm


def _left_out(surroundings: Surroundings) -> list[Rows]:
    """Which points were measured from no wire, and why."""
    rows = [
        {"Which points": why, "Points": count}
        for why, count in surroundings.left_out.items()
        if count or why == LOW_LISTED
    ]
    return [Rows(Table.from_rows(rows), NO_PART_CAPTION)] if rows else []


@dataclass(frozen=True)
class _Across:
    """Points sorted along the main direction of the line, x or y, into stretches.

    Attributes
    ----------
    side : 0 if that is x, 1 if it is y
    order : array of shape (n,), indices of points, stretch by stretch of STRETCH_LENGTH metres
    low : where the first stretch begins
    starts : where each stretch begins in that order
    """

    surroundings: Surroundings
    side: int
    order: Ints
    low: float
    starts: Ints

    @classmethod
    def of(cls, surroundings: Surroundings, line: LineStates) -> _Across:
        side = int(np.ptp(_ends(line), axis=0).argmax()) if line.spans else 0
        along = surroundings.xyz[:, side]
        low = float(along.min(initial=0.0))
        stretch = ((along - low) / STRETCH_LENGTH).astype(np.uint16)  # quick to sort; up to 655 km
        order = np.argsort(stretch, kind="stable")
        return cls(surroundings, side, order, low, np.append(0, np.cumsum(np.bincount(stretch))))

    def between(self, low: float, high: float) -> tuple[Floats, NDArray[np.int8]]:
        """Positions and kinds of the points between two coordinates, and up to a stretch beyond."""
        ends = (low - self.low) / STRETCH_LENGTH, (high - self.low) / STRETCH_LENGTH + 1
        first, last = self.starts[np.clip(np.floor(ends).astype(int), 0, len(self.starts) - 1)]
        some = self.order[first:last]
        some = some[self.surroundings.kind[some] >= 0]
        return self.surroundings.xyz[some], self.surroundings.kind[some]


@dataclass(frozen=True)
class _Axes:
    """The unit of the coordinates of the data, and how many of it are a metre."""

    metre: float
    unit: str


def _ends(line: LineStates) -> Floats:
    """End points of all wires in plan."""
    return np.concatenate([c.points(np.array([0.0, c.length]))[:, :2] for c in line.curves[0]])


def _map(
    across: _Across,
    line: LineStates,
    rules: Sequence[Rule],
    objects: Sequence[Object],
    axes: _Axes,
    ctx: Context,
) -> list[Figure]:
    """Maps of wires, objects and their surroundings, in sheets along the line."""
    if not line.spans:
        return []
    side = across.side
    wires = [
        (span, curve.points(np.linspace(0.0, curve.length, 50))[:, :2])
        for curve, span in zip(line.curves[0], line.span.tolist(), strict=True)
    ]
    ends = np.array([(xy[:, side].min(), xy[:, side].max()) for _, xy in wires])
    first, last = ends[:, 0].min(), ends[:, 1].max()
    count = min(max(math.ceil((last - first) / SHEET), 1), MOST_SHEETS)
    edges = np.linspace(first, last, count + 1)
    way = ("from west to east", "from south to north")[side]
    figures = []
    for k in range(count):
        ctx.progress(k / count)
        own = np.flatnonzero((ends[:, 1] >= edges[k]) & (ends[:, 0] <= edges[k + 1]))
        if len(own):
            seen = [wires[wire] for wire in own]
            svg, marked = _sheet(across, line, rules, objects, seen, axes, edges[k], edges[k + 1])
            told = [f"Wires in plan, towers and objects; {_numbered(marked)}."]
            told += [f"This is sheet {k + 1} of {count}, {way}."] if count > 1 else []
            figures.append(Figure(svg, " ".join(told)))
    return figures


def _sheet(
    across: _Across,
    line: LineStates,
    rules: Sequence[Rule],
    objects: Sequence[Object],
    wires: Sequence[tuple[int, Floats]],
    axes: _Axes,
    first: float,
    last: float,
) -> tuple[bytes, int]:
    """Map of the line between two coordinates, with wires and spans, as SVG; objects on it."""
    side = across.side
    seen = np.concatenate([xy for _, xy in wires])
    low, high = seen.min(axis=0) - PROFILE_BESIDE, seen.max(axis=0) + PROFILE_BESIDE
    low[side], high[side] = first - PROFILE_BESIDE, last + PROFILE_BESIDE
    wide, tall = high - low
    scale = min(MAP_SIZE[0] / wide, MAP_SIZE[1] / tall)
    size, labels = (wide * scale, tall * scale), (f"x [{axes.unit}]", f"y [{axes.unit}]")
    drawing = Drawing(low, high, size, labels, origin=line.origin[:2], metre=axes.metre)
    xyz, kinds = across.between(low[side], high[side])
    above = kinds != KINDS.index("ground")
    _draw_points(drawing, xyz[above, :2].T, kinds[above], 0.6)
    middles: dict[int, list[Floats]] = {}
    for span, xy in wires:
        drawing.curve(xy[:, 0], xy[:, 1], "#333333", 0.8)
        middles.setdefault(span, []).append(xy[len(xy) // 2])
    for span, some in middles.items():
        x, y = np.mean(some, axis=0).tolist()
        drawing.text(x, y, f"span {span}", WIRE_COLOUR)
    for tower, place in line.towers.items():
        if (place[:2] >= low).all() and (place[:2] <= high).all():
            _draw_tower(drawing, tower, *place[:2])
    places = [across.surroundings.xyz[one.nearest, :2] for one in objects]
    spots = list(zip(range(1, len(objects) + 1), objects, places, strict=True))
    here = [s for s in spots if (s[2] >= low).all() and (s[2] <= high).all()]
    _mark(drawing, rules, here)
    return drawing.svg(), len(here)


def _draw_tower(drawing: Drawing, number: int, x: float, y: float) -> None:
    """Draw a tower with its number in the tables."""
    drawing.mark(x, y, TOWER_COLOUR)
    drawing.text(x, y, f"tower {number}", TOWER_COLOUR)
    if "tower" not in [key["name"] for key in drawing.keys]:
        drawing.key("mark", "tower", TOWER_COLOUR)


def _draw_points(drawing: Drawing, xy: Floats, kinds: NDArray[np.int8], opacity: float) -> None:
    """Draw the points around the line, in the colours of their kinds."""
    drawing.points(xy[0], xy[1], kinds, [KIND_COLOURS[kind] for kind in KINDS], opacity)
    for number in np.flatnonzero(np.bincount(kinds)).tolist():
        drawing.key("points", KINDS[number], KIND_COLOURS[KINDS[number]])


def _mark(drawing: Drawing, rules: Sequence[Rule], spots: Sequence[Spot]) -> None:
    """Draw objects where they are closest, the most urgent on top; the first ones with numbers."""
    told = [rules[one.rule].severity for _, one, _ in spots]
    for _, one, place in reversed(spots):
        drawing.mark(place[0], place[1], SEVERITY_COLOURS[rules[one.rule].severity])
    for number, _, place in spots[:MOST_NUMBERS]:
        drawing.text(place[0], place[1], str(number))
    for severity, colour in SEVERITY_COLOURS.items():
        if severity in told:
            drawing.key("mark", severity, colour)


def _profiles(
    across: _Across,
    line: LineStates,
    rules: Sequence[Rule],
    objects: Sequence[Object],
    least: Least,
    axes: _Axes,
    ctx: Context,
) -> list[Figure | str]:
    """Profile of each span, the most urgent first."""
    urgent = [int(line.span[one.wire]) for one in objects]
    order = list(dict.fromkeys([*urgent, *line.spans]))
    shown: list[Figure | str] = []
    for k, span in enumerate(order[:MOST_PROFILES]):
        ctx.progress(k / len(order))
        shown.append(_profile(across, line, rules, objects, least, axes, span))
    if len(order) > MOST_PROFILES:
        shown.append(f"Profiles of the {len(order) - MOST_PROFILES} other spans are not shown.")
    return shown


def _profile(
    across: _Across,
    line: LineStates,
    rules: Sequence[Rule],
    objects: Sequence[Object],
    least: Least,
    axes: _Axes,
    span: int,
) -> Figure:
    """Profile of a span: wires in each state, points around them, objects."""
    own = np.flatnonzero(line.span == span)
    axis = line.axis(span)
    stretch = axis.points(np.array([0.0, axis.length]))[:, across.side]
    xyz, kinds = across.between(stretch.min() - PROFILE_BESIDE, stretch.max() + PROFILE_BESIDE)
    along, beside = axis.along(xyz)
    near = (np.abs(beside) < PROFILE_BESIDE) & (along > -5) & (along < axis.length + 5)
    along, z, kinds = along[near], xyz[near, 2], kinds[near]
    wires = [
        (number, curves[k].points(np.linspace(0.0, line.curves[0][k].length, 100)))
        for number, curves in enumerate(line.curves)
        for k in own
    ]
    held = {*line.start[own].tolist(), *line.end[own].tolist()}
    towers = {
        tower: np.array([axis.along(place[None])[0][0], place[2]])
        for tower, place in line.towers.items()
        if tower in held
    }
    spots = _spots(across, line, objects, axis, span)
    leasts = _leasts(across, line, least, axis, own)
    shown = [
        np.column_stack([along, z]),
        *(np.column_stack([axis.along(places)[0], places[:, 2]]) for _, places in wires),
        *(place[None] for place in (*towers.values(), *(place for _, _, place in spots))),
        *(ends for _, ends in leasts),
    ]
    first, last = _window(np.concatenate(shown))
    labels = f"along the span [{axes.unit}]", f"height [{axes.unit}]"
    drawing = Drawing(first, last, PROFILE_SIZE, labels, metre=axes.metre)
    _draw_points(drawing, np.array([along, z]), kinds, 1.0)
    _draw_below(drawing, axis, xyz[near], kinds, [line.curves[0][k] for k in own])
    for number, places in wires:
        drawing.curve(
            axis.along(places)[0], places[:, 2], WIRE_COLOUR, 1.0, WIRE_DASHES[min(number, 3)]
        )
    for number, state in enumerate(line.states):
        drawing.key("curve", f"wires: {state.name}", WIRE_COLOUR, WIRE_DASHES[min(number, 3)])
    for tower, place in towers.items():  # an axis: its foot and top are not known here
        drawing.curve(np.repeat(place[0], 2), np.array([first[1], last[1]]), TOWER_COLOUR, 1.0)
        drawing.text(place[0], place[1], f"tower {tower}", TOWER_COLOUR)
    if towers:
        drawing.key("curve", "axis of a tower", TOWER_COLOUR, "")
    for _, ends in leasts:
        drawing.curve(ends[:, 0], ends[:, 1], LEAST_COLOUR, 1.5)
    if leasts:
        drawing.key("curve", "least distance", LEAST_COLOUR, "")
    for _, one, place in spots:
        foot = line.curves[one.state][one.wire].points(np.array([one.u]))
        x, y = np.array([place, (axis.along(foot)[0][0], foot[0, 2])]).T
        drawing.curve(x, y, SEVERITY_COLOURS[rules[one.rule].severity], 1.0)
    _mark(drawing, rules, spots)
    sure = [one for _, one, _ in spots if rules[one.rule].severity != UNSURE]
    words = [rules[one.rule].severity for one in sure]
    close = sum(word in BROKEN for word in words)
    told = [
        f"Span {span}, {axis.length:.0f} m, {len(own)} wires, {close} objects too close, "
        f"{words.count('watch')} to be watched."
    ]
    if NO_RULE in words:
        told.append(f"Near without a rule: {words.count(NO_RULE)}.")
    if leasts:
        told.append(f"Least distances in space: {', '.join(text for text, _ in leasts)}.")
    if sure:
        told.append(f"The most urgent: {_urgency(sure[0], rules[sure[0].rule])}.")
    if len(sure) < len(spots):
        told.append(f"Not sure whether of the line: {len(spots) - len(sure)}.")
    told.append(
        f"Points up to {PROFILE_BESIDE:.0f} m to the side, darker the ground up to "
        f"{RIGHT_BELOW:.0f} m from below a wire; {_numbered(len(spots))}."
    )
    return Figure(drawing.svg(), " ".join(told))


def _leasts(
    across: _Across, line: LineStates, least: Least, axis: Catenary, own: Ints
) -> list[tuple[str, Floats]]:
    """How near objects and the ground come to the wires of a span, and where, in a profile."""
    found = []
    for kinds in (range(len(OBJECTS)), [KINDS.index("ground")]):
        values = least.distance[:, own][:, :, kinds]
        state, wire, kind = np.unravel_index(values.argmin(), values.shape)
        if not math.isfinite(values[state, wire, kind]):
            continue
        curve = line.curves[state][own[wire]]
        point = across.surroundings.xyz[[least.point[state, own[wire], kinds[kind]]]]
        foot = curve.points(distances(point, curve)[:, 3])
        ends = np.concatenate([point, foot])
        moved = f" ({line.states[state].name})" if state else ""
        text = f"{KINDS[kinds[kind]]} {values[state, wire, kind]:.2f} m{moved}"
        found.append((text, np.column_stack([axis.along(ends)[0], ends[:, 2]])))
    return found


def _window(places: Floats) -> tuple[Floats, Floats]:
    """The corners of a profile that shows positions along a span and heights, with room around."""
    low, high = places.min(axis=0), places.max(axis=0)
    room = PROFILE_ROOM * (high - low)
    return low - room, high + room


def _numbered(count: int) -> str:
    """Which of the objects in a picture have their numbers there."""
    if count <= MOST_NUMBERS:
        return "numbers as in the tables"
    return f"numbers as in the tables, of the {MOST_NUMBERS} most urgent alone"


def _urgency(one: Object, rule: Rule) -> str:
    """What an object lacks: a tree that may fall is as high as its foot is far, and more."""
    if rule.id == FALLING.id:
        return f"a tree that reaches {-one.measure:.2f} m beyond the wire if it falls"
    return f"{one.measure:.2f} m, {rule.id}"


def _draw_below(
    drawing: Drawing,
    axis: Catenary,
    xyz: Floats,
    kinds: NDArray[np.int8],
    curves: Sequence[Catenary],
) -> None:
    """Draw the ground right below the wires: in a slope that to the side is higher or lower."""
    ground = xyz[kinds >= len(OBJECTS)]
    away = [np.abs(curve.residuals(ground)[1]) for curve in curves]
    below = ground[np.min(away, axis=0) <= RIGHT_BELOW]
    drawing.points(
        axis.along(below)[0], below[:, 2], np.zeros(len(below), np.int64), [BELOW_COLOUR], 1.0
    )
    if len(below):
        drawing.key("points", "below a wire", BELOW_COLOUR)


def _spots(
    across: _Across, line: LineStates, objects: Sequence[Object], axis: Catenary, span: int
) -> list[Spot]:
    """Objects of a span at their closest points, as distance along its axis and height."""
    spots: list[Spot] = []
    for number, one in enumerate(objects, start=1):
        if line.span[one.wire] == span:
            point = across.surroundings.xyz[[one.nearest]]
            spots.append((number, one, np.array([axis.along(point)[0][0], point[0, 2]])))
    return spots
