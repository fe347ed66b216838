"""Points that are too close to the conductors of a power line, from points and catenaries.

Distances are taken from the fitted catenaries, not from points on the wires, in the survey and, if
the conductor is known, when it is hot or in the wind. Rules, uncertainty, limits and figures:
docs/explanation/clearance.md.

References
----------
Chan, T. O. and Lichti, D. D. (2011). 3D catenary curve fitting for geometric calibration. ISPRS
Archives XXXVIII-5/W12, 259-264: the curve.
IEEE Std 738-2012: temperature of a conductor that carries a current.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor import _columns as columns
from algorithms.corridor._clearance.counted import ZONES, count_in_zones, too_low
from algorithms.corridor._clearance.coverage import coverage_of, stand_ins
from algorithms.corridor._clearance.crossings import (
    Crossing,
    crossing_layer,
    crossings_of,
    with_lines,
)
from algorithms.corridor._clearance.distances import Least, Violations, find_violations
from algorithms.corridor._clearance.hanging import (
    HANGING,
    above_wires,
    hanging_elsewhere,
    hanging_objects,
    parted_from_hanging,
    warn_of_what_is_above,
)
from algorithms.corridor._clearance.layers import apart, object_layer, span_table, violation_cloud
from algorithms.corridor._clearance.matters import what_matters
from algorithms.corridor._clearance.missed import (
    WireLike,
    columns_of,
    section,
    texts_of,
    warn_of_wire_like,
    wire_like,
)
from algorithms.corridor._clearance.objects import (
    FALLING,
    Falls,
    clump_of_each,
    clumps_of,
    falling_trees,
    objects_of,
    of_their_clumps,
    rank_as_surveyed,
    with_falls,
)
from algorithms.corridor._clearance.report import doubt, report_of, too_high
from algorithms.corridor._clearance.rest import (
    SURE,
    AtRest,
    Band,
    Temperatures,
    band_of,
    extremes,
)
from algorithms.corridor._clearance.rules import (
    BROKEN,
    KINDS,
    LINE,
    NO_RULE,
    SEVERITIES,
    STUDY,
    TITLES,
    UNSURE,
    Rule,
    basis_of,
    grown,
    is_american,
    reach_of,
    rule_set,
    rules_of,
    shipped,
    single,
    unknown_set,
    why_none,
)
from algorithms.corridor._clearance.sag import (
    Conductor,
    State,
    all_conductors,
    conductor_of,
    conductor_temperature,
    in_state,
    shipped_conductors,
)
from algorithms.corridor._clearance.surroundings import (
    LOW_LISTED,
    LineStates,
    Object,
    Surroundings,
    at_towers,
    line_of,
    surroundings_of,
)
from algorithms.corridor._clearance.weather import place_of, sun_on, time_of
from algorithms.corridor._curves.catenary_kernels import MOST_CURVATURE
from algorithms.corridor._extraction.labels import LINE_CLASSES
from algorithms.corridor._extraction.layers import COVARIANCES, DROP, missing_columns
from algorithms.shared import parameters
from algorithms.shared.heights import HEIGHT
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Report, Survey, Table, Vector
from toolbox.declare import ClassList, outputs, param, show, sink, source, tool
from toolbox.errors import DataError

FARTHEST_TREE = 60.0  # metres to the side from which a tree may fall on a wire
LEAST_REACH = 10.0  # metres to the side up to which the least clearances are looked for
WHOLE_COLUMNS = ("wire_id", "span_id", "from_tower", "to_tower")
NUMBER_COLUMNS = (
    *WHOLE_COLUMNS,
    "azimuth",
    "x0",
    "y0",
    "z_start",
    "z_end",
    "v0",
    "v1",
    "rms",
    "points",
    "seen_from",
    "seen_to",
)
BOUNDED_COLUMNS = {
    "span": (0.0, math.inf),
    "curvature": (0.0, 2 * MOST_CURVATURE),
    "swing": (-90.0, 90.0),
}
VARIANCE_COLUMNS = tuple(name for name, (i, j) in COVARIANCES.items() if i == j)
COLOURS = "#b2182b", "#ef8a62", "#d01c8b", "#fddc7a", "#606060"
LOOKS = {word: (word, colour) for word, colour in zip(SEVERITIES, COLOURS, strict=True)}


class Grouped(TypedDict):
    """How points are grouped into objects: see `objects_of`."""

    gap: float
    fewest: int


@dataclass(frozen=True)
class _Near:
    """What is near the wires of a line.

    Attributes
    ----------
    found : the points that break a rule
    least : the points nearest to each wire, and how near other lines are
    low : severities of objects that are left out as they are too low
    zones : numbers of points, see `count_in_zones`
    band : distances from all that the wires may reach, see `band_of`
    """

    surroundings: Surroundings
    line: LineStates
    found: Violations
    least: Least
    crossings: list[Crossing]
    low: list[str]
    zones: NDArray[np.int64]
    band: Band


@dataclass(frozen=True)
class _Seen:
    """The objects near a line.

    Attributes
    ----------
    rules : those given, and those of trees that fall and of what hangs
    found : the points of all objects
    sure : objects of which it is known that they are none of the line
    hanging : what may be of the line
    """

    rules: list[Rule]
    found: Violations
    sure: list[Object]
    hanging: list[Object]

    @property
    def objects(self) -> list[Object]:
        """All of them, those that are not sure last."""
        return [*self.sure, *self.hanging]


@tool(
    "corridor.clearance",
    title="Clearance of power lines",
    tags=(
        "power",
        "line",
        "vegetation",
        "encroachment",
        "danger",
        "tree",
        "clearance",
        "distance",
        "violation",
        "sag",
        "wind",
    ),
)
class CorridorClearance:
    """Find what is too close to the conductors of a power line.

    `wires` are the catenaries of corridor.extract or corridor.catenaries. Each point that is not of
    the line, and no noise, is measured from the curves of all wires near it: in space, vertically
    and horizontally. `rules` names a table of the toolbox: ch_lev, cpuc_go95, ekaty, en_50341 or
    nerc_fac_003, after regulations, or thesis, the risk classes of a study; a `rule_table` of your
    own has the same columns; `distance` is one distance in space instead. Whose distances hold is
    for the owner of the line to say: of the study, the default, a warning says that it is no
    regulation. Distances that are to be confirmed against a regulation are marked, with a place to
    sign. Kinds for which there is no rule are listed as "no rule" when they are near.
    Points without a class may be trees, buildings or something else, and must keep the rules for
    all; those of the wires and towers are left out if they are near enough.

    With a `conductor` and the temperature it had in the survey, clearances are also looked at when
    it is hot, `temperature`, or as hot as a `current` makes it, and in a `wind` from either side.
    Each point counts in the state in which it breaks its rule worst. The temperature in the survey
    is given, or computed from `survey_current` and the weather there. Each object and span also has
    an interval in which its clearance lies while the wires have any temperature from
    `lowest_temperature` to `highest_temperature`; it is wide if that of the survey is not known.

    What has the class of plants, or none, and hangs in mid-air on a wire, a tower or by itself, may
    be a part of the line that was not recognised, if it has `free_air` around and below it. It is
    "not sure": listed apart in `unsure`, and counted in `unsure_count` alone.

    Plants lower than `min_object_height`, and what may be plants, are no objects; their number is
    told. Points of objects at 0 to 20 m and at 20 to 30 m from the wires are counted.

    `falling` trees are those that would reach a wire if they fell towards it. Conductors of
    different lines, which no tower joins, are measured from each other.

    What may be missing of the line is told: spans with fewer conductors than their neighbours,
    conductors seen along a part only, and points beside the line in the shape of a wire.
    """

    points: PointCloud | Survey = source("Classified points, with the ground")
    wires: Vector = source("Catenaries of the conductors", shapes="line")
    towers: Vector | None = source(
        "Feet of towers; points without a class around them belong to the towers",
        default=None,
        shapes="point",
    )
    rule_table: Table | None = source(
        "Rules of your own, in place of rules", default=None, label="Own rules"
    )
    conductor_table: Table | None = source(
        "Conductors of your own", default=None, label="Own conductors"
    )
    rules: str = param(
        "Name of a rule table of the toolbox",
        default=STUDY,
        label="Rule set",
        offers=shipped(),
        words=TITLES,
    )
    distance: float | None = param(
        "One distance in space that all must keep, in place of rules",
        default=None,
        unit="m",
        gt=0.0,
        le=100.0,
    )
    voltage: float | None = param(
        "Voltage between two phases, for rules that depend on it",
        default=None,
        unit="kV",
        gt=0.0,
        le=1500.0,
        label="Voltage between phases",
    )
    tree_classes: ClassList = param("Classes that are vegetation", default=ClassList([3, 4, 5]))
    building_classes: ClassList = param("Classes that are buildings", default=ClassList([6]))
    ground_classes: ClassList = parameters.ground_classes()
    ignore: ClassList | None = parameters.ignore()
    wire_radius: float = parameters.wire_radius()
    attachment: float = parameters.attachment()
    min_object_height: float = param(
        "Least height above the ground of plants, and of what has no class, to be objects; "
        "0 for none",
        default=2.0,
        unit="m",
        ge=0.0,
        le=50.0,
        label="Lowest object",
    )
    object_gap: float = param(
        "Points farther apart than this belong to different objects",
        default=2.0,
        unit="m",
        ge=0.1,
        le=50.0,
        label="Gap between objects",
    )
    min_points: int = param(
        "Fewest points of an object", default=3, unit="1", ge=1, le=10_000, label="Fewest points"
    )
    free_air: float = param(
        "Empty air around and below plants that rather are of the line; 0: all are plants",
        default=3.0,
        unit="m",
        ge=0.0,
        le=20.0,
        label="Air below what may be of the line",
    )
    growth: float | None = param(
        "How much trees may grow until the next visit; what is too close then is watched",
        default=None,
        unit="m",
        gt=0.0,
        le=20.0,
        label="Growth of trees",
    )
    falling: bool = param(
        "Whether to look for trees that may fall on a wire",
        default=True,
        label="Trees that may fall",
    )
    conductor: str | None = param(
        "Name of the conductor, such as Drake", default=None, offers=shipped_conductors()
    )
    survey_temperature: float | None = param(
        "Temperature of the conductors in the survey", default=None, unit="degC", ge=-60.0, le=250.0
    )
    survey_temperature_sd: float = param(
        "Standard deviation of survey_temperature",
        default=5.0,
        unit="degC",
        ge=0.0,
        le=50.0,
        label="Error of the survey temperature",
    )
    survey_current: float | None = param(
        "Current in the survey, which tells survey_temperature with the weather (IEEE 738)",
        default=None,
        unit="A",
        ge=0.0,
        le=20_000.0,
    )
    survey_air_temperature: float | None = param(
        "Temperature of the air in the survey", default=None, unit="degC", ge=-60.0, le=60.0
    )
    survey_breeze: float | None = param(
        "Wind square to the line in the survey, for survey_current",
        default=None,
        unit="m/s",
        ge=0.0,
        le=50.0,
    )
    survey_sun: float | None = param(
        "Power of the sun square to the wires in the survey, for survey_current",
        default=None,
        unit="W/m2",
        ge=0.0,
        le=1500.0,
    )
    survey_time: str | None = param(
        "Date and time of the survey such as 2024-06-10T11:00+02:00, for the sun of a clear sky",
        default=None,
    )
    lowest_temperature: float = param(
        "Lowest temperature that the conductors may have, for intervals of clearances",
        default=0.0,
        unit="degC",
        ge=-60.0,
        le=60.0,
    )
    highest_temperature: float = param(
        "Highest temperature that the conductors may have, for intervals of clearances",
        default=80.0,
        unit="degC",
        ge=0.0,
        le=300.0,
    )
    temperature: float | None = param(
        "Temperature of hot conductors, a state in which the rules must be kept",
        default=None,
        unit="degC",
        ge=-60.0,
        le=300.0,
        label="Temperature when hot",
    )
    current: float | None = param(
        "Current that heats them, in place of temperature (IEEE 738)",
        default=None,
        unit="A",
        gt=0.0,
        le=20_000.0,
        label="Current (hot)",
    )
    air_temperature: float = param(
        "Temperature of the air, for current", default=40.0, unit="degC", ge=-60.0, le=60.0
    )
    breeze: float = param(
        "Wind square to the line that cools them, for current",
        default=0.6,
        unit="m/s",
        ge=0.0,
        le=50.0,
        label="Wind that cools",
    )
    sun: float = param(
        "Power of the sun, for current",
        default=1000.0,
        unit="W/m2",
        ge=0.0,
        le=1500.0,
        label="Power of the sun",
    )
    wind: float | None = param(
        "Wind square to the line that swings them",
        default=None,
        unit="m/s",
        gt=0.0,
        le=70.0,
        label="Wind that swings",
    )
    wind_temperature: float | None = param(
        "Temperature of the conductors in wind; that of the survey by default",
        default=None,
        unit="degC",
        ge=-60.0,
        le=250.0,
        label="Temperature in wind",
    )
    ruling_span: float | None = param(
        "Length of the ruling span, which sets the tension; by default each span its own",
        default=None,
        unit="m",
        ge=10.0,
        le=3000.0,
        label="Ruling span",
    )
    point_sd: float = param(
        "Standard deviation of a point, in height",
        default=0.05,
        unit="m",
        ge=0.0,
        le=5.0,
        label="Error of a point",
    )

    @outputs
    class Outputs:
        violations: PointCloud = sink(
            "Points of what is listed: too close, no rule, to watch or not sure; with clearances",
            show=show.Classes("severity", dict(enumerate(LOOKS.values(), start=1))),
            label="Points of what is listed",
        )
        objects: Vector = sink(
            "Objects too close, to be watched or near without a rule, each where it is closest",
            show=show.Classes("severity", {word: LOOKS[word] for word in SEVERITIES[:-1]}),
            label="Objects by severity",
            columns=columns.OBJECTS,
        )
        unsure: Vector = sink(
            "Where points hang in mid-air that may be of the line: the closest one to each wire",
            show=show.Classes("severity", {UNSURE: LOOKS[UNSURE]}),
            label="Not sure: plants or the line",
            columns=columns.UNSURE,
        )
        crossings: Vector = sink(
            "Where conductors of different lines come near each other", columns=columns.CROSSINGS
        )
        spans: Table = sink(
            "Least clearance of each span by kind of object and state of the wires",
            columns=columns.SPANS,
        )
        report: Report = sink("Map, profile of each span, and objects in order of urgency")
        object_count: int = sink(
            "Objects too close to a wire, of severity critical or warning", unit="1"
        )
        critical_count: int = sink("Objects of severity critical", unit="1")
        warning_count: int = sink("Objects of severity warning", unit="1")
        watch_count: int = sink(
            "Objects to be watched: trees that may fall on a wire, or will be too close when grown",
            unit="1",
        )
        no_rule_count: int = sink("Objects near a wire for which there is no rule", unit="1")
        unsure_count: int = sink(
            "Wires near which points hang in mid-air that may be of the line; not in object_count",
            unit="1",
        )
        crossing_count: int = sink(
            "Pairs of spans of different lines that are too close or near without a rule", unit="1"
        )
        low_object_count: int = sink(
            "Objects that would be listed, but are lower than the lowest object", unit="1"
        )
        points_0_20: int = sink(
            "Points of objects less than 20 m from a wire, as surveyed", unit="1"
        )
        points_20_30: int = sink(
            "Points of objects 20 to 30 m from the nearest wire, as surveyed", unit="1"
        )
        least_clearance: float | None = sink(
            "Least distance in space of a point that breaks a rule or has none", unit="m"
        )

    def check(self) -> Iterator[tuple[str, str]]:
        """The rules exist, and each setting has those it needs."""
        if problem := unknown_set(self.rules):
            yield "rules", problem
        elif self.rule_table is None:
            yield from self._bad_rules("rules")
        if self.conductor_table is None:
            yield from self._bad_conductor()
        if self.temperature is not None and self.current is not None:
            yield "current", "tells the temperature; give one of both"
        for name in ("temperature", "current", "wind"):
            if getattr(self, name) is None:
                continue
            if self.conductor is None:
                yield "conductor", f"is needed to know the wires at another {name}"
            if self.survey_temperature is None and self.survey_current is None:
                yield "survey_temperature", f"is needed to know the wires at another {name}"
        if self.lowest_temperature >= self.highest_temperature:
            yield (
                "lowest_temperature",
                f"must be below highest_temperature, {self.highest_temperature:g}, "
                f"got {self.lowest_temperature:g}",
            )
        yield from self._bad_weather()
        if self.wind_temperature is not None and self.wind is None:
            yield "wind_temperature", "is for wind, and none is given"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """The points have classes; the catenaries, towers, rules and conductor are valid."""
        if "classification" not in self.points.names:
            yield "points", f"{self.points.name} has no classification; classify the points first"
        if problem := missing_columns(self.wires):
            yield "wires", problem
        else:
            yield from _bad_wires(self.wires)
        if self.towers is not None:
            if not (self.towers.frame.geom_type == "Point").all():
                yield "towers", "must hold points alone"
            if "width" not in self.towers.names:
                yield "towers", "no column width; take the towers of corridor.extract"
        if self.distance is not None and self.rule_table is not None:
            yield "distance", "is in place of rules, and a rule_table is given"
        if self.rule_table is not None:
            yield from self._bad_rules("rule_table")
        if self.conductor_table is not None:
            yield from self._bad_conductor()

    def halo(self) -> float:
        """Infinite, as least clearances of spans, objects and the report need the whole line."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CorridorClearance.Outputs:
        """Measure the clearances, group the violations into objects, and report."""
        metric = self._without_drops()._in_metres()
        rules, conductor = metric._rules(), metric._conductor()
        self._warn_of_study()
        if doubtful := doubt(rules):
            log.warning("%s", doubtful)
        line, temperatures, surveyed = metric._states(conductor)
        if high := too_high(rules, line, self.wires.crs):
            log.warning("%s", high)
        cloud = metric._cloud(line, rules, ctx.part(0.0, 0.3))
        surroundings = metric._surroundings(cloud, line, rules, ctx.part(0.3, 0.4))
        near = metric._nearest(surroundings, line, rules, ctx.part(0.4, 0.8))
        seen = metric._grouped_into_objects(cloud, near, rules, ctx.part(0.8, 0.9))
        coverage = coverage_of(
            surroundings, seen.rules, seen.found, near.least, seen.sure, near.crossings, near.zones
        )
        for sentence in coverage.near:
            log.warning("near a wire: %s", sentence)
        like = wire_like(surroundings, line, ctx.part(0.9, 0.92))
        warn_of_wire_like(like)
        current_known = self.survey_current is not None
        rest = AtRest(temperatures, surveyed, current_known, near.band.may_break)
        layers = metric._layers(cloud, near, seen, like)
        page = report_of(
            surroundings,
            line,
            seen.rules,
            seen.objects,
            layers["objects"].frame,
            layers["unsure"].frame,
            layers["spans"],
            near.least,
            near.low,
            conductor,
            coverage,
            section(texts_of(metric.wires, like)),
            rest,
            layers["crossings"].frame,
            metric._basis(),
            ctx.part(0.92, 1.0),
        )
        ctx.progress(1.0)
        return self.Outputs(**layers, report=page, **self._counts(near, seen))

    def _nearest(
        self, surroundings: Surroundings, line: LineStates, rules: list[Rule], ctx: Context
    ) -> _Near:
        """What is near the wires, point by point and line by line."""
        found, least = self._violations(surroundings, line, rules, ctx.part(0.0, 0.5))
        crossings, from_lines = self._crossings(line, rules, ctx.part(0.5, 0.55))
        least = with_lines(least, from_lines)
        low = self._too_low(surroundings, line, rules, found, ctx.part(0.55, 0.65))
        zones = count_in_zones(surroundings, line, ctx.part(0.65, 0.8))
        reach, rest = _measured(rules), ctx.part(0.8, 1.0)
        band = band_of(surroundings, line, rules, found.point, least, reach=reach, ctx=rest)
        return _Near(surroundings, line, found, least, crossings, low, zones, band)

    def _grouped_into_objects(
        self, cloud: PointCloud, near: _Near, rules: list[Rule], ctx: Context
    ) -> _Seen:
        """The objects, among them trees that may fall and what hangs in mid-air."""
        surroundings, line, found = near.surroundings, near.line, near.found
        objects = self._objects(cloud, surroundings, found, rules)
        if self.falling:
            rules = [*rules, FALLING]
            falls = self._falls(surroundings, line, ctx.part(0.0, 0.9))
            objects, found = with_falls(
                surroundings, line, objects, found, falls, rules, point_sd=self.point_sd
            )
        hanging, free = self._hanging(surroundings, line, rules, ctx.part(0.9, 1.0))
        rules = [*rules, HANGING] if hanging else rules
        return _Seen(rules, found.joined(free), objects, hanging)

    def _layers(
        self, cloud: PointCloud, near: _Near, seen: _Seen, like: WireLike
    ) -> dict[str, Any]:
        """The outputs that are layers and tables, by name; lengths of this tool are in metres."""
        surroundings, line, rules, objects = near.surroundings, near.line, seen.rules, seen.objects
        clump = clump_of_each(surroundings, objects, gap=self.object_gap)
        clumps = clumps_of(objects, clump)
        others = of_their_clumps(surroundings, objects, near.band.may_break, clump)
        ranks = rank_as_surveyed(
            surroundings, line, rules, seen.found, objects, reach=_measured(rules)
        )
        layer, unsure = apart(
            object_layer(
                cloud,
                surroundings,
                line,
                rules,
                objects,
                clumps,
                like,
                others,
                ranks,
                self.wire_radius,
            )
        )
        missed = columns_of(self.wires, like)
        spans = span_table(
            surroundings,
            line,
            rules,
            near.least,
            seen.sure,
            self.point_sd,
            near.band,
            near.zones,
            missed,
        )
        wires = self.wires
        return {
            "violations": violation_cloud(
                cloud, surroundings, line, rules, seen.found, objects, ranks
            ),
            "objects": layer,
            "unsure": unsure,
            "crossings": crossing_layer(near.crossings, line, rules, wires.crs, wires.metre),
            "spans": spans,
        }

    def _counts(self, near: _Near, seen: _Seen) -> dict[str, Any]:
        """The outputs that are numbers, by name."""
        severities = [seen.rules[one.rule].severity for one in seen.objects]
        in_zones = near.zones[0].sum(axis=(0, 1)).tolist()
        nearest = float(near.found.space.min(initial=math.inf))
        return {
            "object_count": sum(severity in BROKEN for severity in severities),
            "critical_count": severities.count(SEVERITIES[0]),
            "warning_count": severities.count("warning"),
            "watch_count": severities.count("watch"),
            "no_rule_count": severities.count(NO_RULE),
            "unsure_count": len(seen.hanging),
            "crossing_count": sum(one.rule >= 0 for one in near.crossings),
            "low_object_count": len(near.low),
            "points_0_20": in_zones[0],
            "points_20_30": in_zones[1],
            "least_clearance": nearest * self.points.metre if math.isfinite(nearest) else None,
        }

    def _states(self, conductor: Conductor | None) -> tuple[LineStates, Temperatures, float | None]:
        """The line in all states, the temperatures it may have, and that of the survey if known."""
        line = line_of(self.wires)
        surveyed = self._surveyed(line, conductor)
        line = self._in_all_states(line, conductor, surveyed)
        if len(line.states) > 1 and line.open_spans:
            log.warning(
                "%d spans end without a tower; hot or in wind: held there, where in truth "
                "they hang on",
                len(line.open_spans),
            )
        temperatures = self._temperatures(line, surveyed)
        return self._at_rest(line, conductor, temperatures), temperatures, surveyed

    def _violations(
        self, surroundings: Surroundings, line: LineStates, rules: list[Rule], ctx: Context
    ) -> tuple[Violations, Least]:
        """The points that break a rule, and the nearest to each wire."""
        if not line.spans:
            log.warning("no wire was found, so no clearance was measured")
            return Violations.none(), Least.none(len(line.states))
        return find_violations(
            surroundings.xyz,
            surroundings.kind,
            line.curves,
            rules,
            reach=_measured(rules),
            point_sd=self.point_sd,
            ctx=ctx,
        )

    def _crossings(
        self, line: LineStates, rules: list[Rule], ctx: Context
    ) -> tuple[list[Crossing], NDArray[np.float64]]:
        """Where lines come near each other, and how near each wire comes to another line."""
        reach = max(reach_of([rule for rule in rules if rule.kind == LINE]), LEAST_REACH)
        return crossings_of(line, rules, reach=reach, attachment=self.attachment, ctx=ctx)

    def _too_low(
        self,
        surroundings: Surroundings,
        line: LineStates,
        rules: list[Rule],
        found: Violations,
        ctx: Context,
    ) -> list[str]:
        """Severities of objects that are left out as they are too low; noted with the points."""
        reach, grouped = _measured(rules), self._grouped
        low, points = too_low(surroundings, line, rules, found, reach=reach, **grouped, ctx=ctx)
        if (surroundings.low >= 0).any():
            told = f"Of these, would break a rule or be near; in {len(low)} objects"
            why = told if points else LOW_LISTED
            surroundings.left_out[why] = points
        return low

    def _objects(
        self, cloud: PointCloud, surroundings: Surroundings, found: Violations, rules: list[Rule]
    ) -> list[Object]:
        """The objects, the most urgent first; points that are too few for one are noted."""
        objects, lone = objects_of(surroundings, found, rules, **self._grouped)
        if len(lone):
            x, y = cloud.xyz[surroundings.index[lone[0]], :2]
            log.warning(
                "%d points are too close, but too few for an object: the most urgent "
                "at %.10g, %.10g; they are in the file of points alone, as object 0",
                len(lone),
                x,
                y,
            )
            surroundings.left_out["Too close, but too few for an object"] = len(lone)
        return objects

    def _falls(self, surroundings: Surroundings, line: LineStates, ctx: Context) -> Falls:
        """The trees that reach a wire if they fall."""
        return falling_trees(surroundings, line, point_sd=self.point_sd, **self._grouped, ctx=ctx)

    @property
    def _grouped(self) -> Grouped:
        """How points are grouped into objects."""
        return {"gap": self.object_gap, "fewest": self.min_points}

    def _without_drops(self) -> CorridorClearance:
        """A copy of this tool without the service drops, of which it is told."""
        frame = self.wires.frame
        if DROP not in frame or not (drop := frame[DROP] == 1).any():
            return self
        log.warning(
            "service drops: nothing was measured from span %s; they end at houses, and the "
            "distances of the line may not hold for them",
            ", ".join(frame.loc[drop, "span_id"].astype(str)),
        )
        return replace(self, wires=Vector(frame[~drop], name=self.wires.name))

    def _in_metres(self) -> CorridorClearance:
        """A copy of this tool whose lengths are in metres, not in the unit of the data."""
        names = (
            "distance",
            "wire_radius",
            "attachment",
            "min_object_height",
            "object_gap",
            "free_air",
            "growth",
            "ruling_span",
            "point_sd",
        )
        given = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        changed: Any = {name: value / self.points.metre for name, value in given.items()}
        return replace(self, **changed)

    def _bad_rules(self, name: str) -> Iterator[tuple[str, str]]:
        """Problems of the rules that the parameter `name` gives."""
        try:
            self._rules()
        except DataError as error:
            yield name, str(error)

    def _bad_conductor(self) -> Iterator[tuple[str, str]]:
        """The problem of a conductor that no table has, or whose values are missing."""
        try:
            self._conductor()
        except DataError as error:
            yield "conductor", str(error)

    def _rules(self) -> list[Rule]:
        american = False
        if self.distance is not None:
            rules = single(self.distance)
            why = {kind: f"the given distance does not hold for {kind}" for kind in KINDS}
        else:
            table = rule_set(self.rules) if self.rule_table is None else self.rule_table
            own = self.rule_table is not None
            rules = [replace(rule, given=own) for rule in rules_of(table, self.voltage)]
            why = why_none(table, self.voltage)
            american = is_american(table)
        later = grown(rules, self.growth) if self.growth else []
        return [*rules, *later, *stand_ins(rules, why, self.voltage, american=american)]

    def _basis(self) -> str:
        """What the distances required are, in a sentence; lengths of this tool are in metres."""
        if self.distance is not None:
            return (
                f"Distance required: {self.distance:g} m from all objects, as given for this "
                "report; no rule set was applied, and it is no regulation."
            )
        if self.rule_table is not None:
            return f"Distances required: those of the table {self.rule_table.name}."
        return basis_of(self.rules, self.voltage)

    def _warn_of_study(self) -> None:
        """Say so where the distances are those of a study, for which no owner of a line asks."""
        if self.rules == STUDY and self.distance is None and self.rule_table is None:
            log.warning(
                "the distances required are the risk classes of a study, %s, and no regulation: "
                "choose those that the line must keep",
                TITLES[STUDY],
            )

    def _conductor(self) -> Conductor | None:
        return conductor_of(self.conductor, self.conductor_table) if self.conductor else None

    def _bad_weather(self) -> Iterator[tuple[str, str]]:
        """Problems of what tells the temperature of the survey."""
        told = ("survey_breeze", "survey_sun", "survey_time")
        if self.survey_time is not None:
            try:
                time_of(self.survey_time)
            except ValueError as error:
                yield "survey_time", str(error)
        if self.survey_current is None:
            for name in told:
                if getattr(self, name) is not None:
                    yield name, "is for survey_current, and none is given"
            return
        if self.survey_temperature is not None:
            yield "survey_current", "tells survey_temperature; give one of both"
        for name in ("conductor", "survey_air_temperature", "survey_breeze"):
            if getattr(self, name) is None:
                yield name, "is needed for survey_current"
        if (self.survey_sun is None) == (self.survey_time is None):
            yield "survey_sun", "is needed for survey_current, or survey_time; give one of both"

    def _surveyed(self, line: LineStates, conductor: Conductor | None) -> float | None:
        """Temperature of the conductors in the survey, if it is known."""
        weather = self.survey_air_temperature, self.survey_breeze
        if conductor is None or self.survey_current is None or None in weather or not line.spans:
            return self.survey_temperature
        sun = self.survey_sun
        if self.survey_time is not None:
            longitude, latitude = place_of(self.wires)
            time = time_of(self.survey_time)
            sun = sun_on(line.curves[0], time, longitude, latitude, line.elevation)
        air, breeze = weather
        return conductor_temperature(
            conductor,
            current=self.survey_current,
            air=air or 0.0,
            wind=breeze or 0.0,
            sun=sun or 0.0,
            height=line.elevation,
        )

    def _temperatures(self, line: LineStates, surveyed: float | None) -> Temperatures:
        """Range of temperatures that the conductors may have, and may have had in the survey."""
        low, high = self.lowest_temperature, self.highest_temperature
        given = [state.temperature for state in line.states if state.temperature is not None]
        low, high = min([low, *given]), max([high, *given])
        if surveyed is not None:
            sure = SURE * self.survey_temperature_sd
            return Temperatures((surveyed - sure, surveyed + sure), low, high)
        air = self.survey_air_temperature
        coldest = low if air is None else min(max(low, air), high)
        return Temperatures((coldest, high), low, high)

    def _at_rest(
        self, line: LineStates, conductor: Conductor | None, temperatures: Temperatures
    ) -> LineStates:
        """The line with the highest and the lowest position of each wire."""
        some = [conductor] if conductor else all_conductors(self.conductor_table)
        ends = [
            extremes(curve, some, temperatures.change, self.ruling_span) for curve in line.curves[0]
        ]
        return replace(line, rest=([high for high, _ in ends], [low for _, low in ends]))

    def _in_all_states(
        self, line: LineStates, conductor: Conductor | None, warm: float | None
    ) -> LineStates:
        """The line with the wires as surveyed and in all other states."""
        if conductor is None or warm is None:
            return line
        surveyed = line.curves[0]
        others = self._other_states(conductor, line.elevation)
        states, curves = [*line.states, *others], [surveyed]
        for state in states[1:]:
            curves.append(
                [
                    in_state(
                        curve,
                        conductor,
                        state,
                        surveyed=warm,
                        surveyed_sd=self.survey_temperature_sd,
                        ruling_span=self.ruling_span,
                    )
                    for curve in surveyed
                ]
            )
        return replace(line, states=states, curves=curves)

    def _other_states(self, conductor: Conductor, elevation: float) -> list[State]:
        """The states other than the survey: hot, and in wind from either side."""
        states = []
        hottest = self.temperature
        if self.current is not None:
            hottest = conductor_temperature(
                conductor,
                current=self.current,
                air=self.air_temperature,
                wind=self.breeze,
                sun=self.sun,
                height=elevation,
            )
        if hottest is not None:
            states.append(State(f"{hottest:.0f} C", hottest))
        if self.wind is not None:
            for side, wind in (("left", self.wind), ("right", -self.wind)):
                states.append(State(f"blown {side}", self.wind_temperature, wind))
        return states

    def _cloud(self, line: LineStates, rules: list[Rule], ctx: Context) -> PointCloud:
        """The points needed for clearances: few if heights are given; lengths are in metres."""
        if HEIGHT not in self.points.names:
            return self.points if isinstance(self.points, PointCloud) else self.points.read(ctx=ctx)
        if not line.spans:
            return (
                self.points.select([])
                if isinstance(self.points, PointCloud)
                else self.points.template
            )
        return what_matters(
            self.points,
            line,
            rules,
            classes=self._classes,
            ignore=self.ignore or ClassList([]),
            reach=self._reach(rules),
            measured=_measured(rules),
            ctx=ctx,
        )

    def _surroundings(
        self, cloud: PointCloud, line: LineStates, rules: list[Rule], ctx: Context
    ) -> Surroundings:
        """The points around the line; lengths of this tool are in metres."""
        around = surroundings_of(
            cloud,
            line,
            classes=self._classes,
            ignore=self.ignore or ClassList([]),
            reach=self._reach(rules),
            wire_radius=self.wire_radius,
            attachment=self.attachment,
            lowest=self.min_object_height,
            towers=self.towers,
            ctx=ctx.part(0.0, 0.9),
        )
        return parted_from_hanging(
            around,
            line,
            at_towers(around.xyz, self.towers, line.origin),
            np.isin(cloud["classification"][around.index], LINE_CLASSES),
            **self._grouped,
            attachment=self.attachment,
            free_air=self.free_air,
            ctx=ctx.part(0.9, 1.0),
        )

    def _hanging(
        self, surroundings: Surroundings, line: LineStates, rules: list[Rule], ctx: Context
    ) -> tuple[list[Object], Violations]:
        """What hangs in mid-air near a wire or above all of a span, and its points; it is told."""
        above = above_wires(surroundings, line, LEAST_REACH, self.min_points)
        objects, found = hanging_objects(
            surroundings,
            line,
            rules,
            above,
            reach=_measured(rules),
            point_sd=self.point_sd,
            ctx=ctx,
        )
        warn_of_what_is_above(surroundings, line, above, self.points.metre)
        surroundings.left_out.update(hanging_elsewhere(surroundings, line, found))
        return objects, found

    def _reach(self, rules: list[Rule]) -> float:
        """Horizontal distance from the wires up to which points are used, metres."""
        least = FARTHEST_TREE if self.falling else max(LEAST_REACH, ZONES[-1])
        return max(reach_of(rules), least)

    @property
    def _classes(self) -> dict[str, Sequence[int]]:
        """Classes of each kind; water, rail and road are separate kinds with rules of their own."""
        return {
            "tree": self.tree_classes,
            "building": self.building_classes,
            "ground": [c for c in self.ground_classes if c not in parameters.SURFACES],
        }


def _measured(rules: list[Rule]) -> float:
    """Horizontal distance from the wires up to which clearances are measured, metres."""
    return max(reach_of(rules), LEAST_REACH)


def _bad_wires(wires: Vector) -> Iterator[tuple[str, str]]:
    """The first invalid value in the layer of wires; swing and covariances may be unknown."""
    names = [*NUMBER_COLUMNS, *BOUNDED_COLUMNS, *VARIANCE_COLUMNS]
    for number, row in enumerate(wires.frame[names].to_dict("records"), start=1):
        for name, value in row.items():
            if rule := _broken(str(name), value):
                yield "wires", f"row {number}: {name} must be {rule}, got {value!r}"
                return


def _broken(name: str, value: object) -> str:
    """The condition that a value of a column of wires fails; empty if it is valid."""
    if name in VARIANCE_COLUMNS:
        return "at least 0" if isinstance(value, float) and value < 0 else ""
    if name == "swing" and (value is None or (isinstance(value, float) and math.isnan(value))):
        return ""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return "a number"
    if name in WHOLE_COLUMNS and value % 1:
        return "a whole number"
    low, high = BOUNDED_COLUMNS.get(name, (-math.inf, math.inf))
    if not low < value < high:
        return f"above {low:g}" + (f" and below {high:g}" if math.isfinite(high) else "")
    return ""
