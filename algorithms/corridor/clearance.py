"""What is too close to which conductor of a power line, where, by how much and under which rule.

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
from dataclasses import replace
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from algorithms.corridor._clearance_report import report_of
from algorithms.corridor._distances import (
    BLOCK,
    TAKES_NO_PART,
    TREE,
    UNCLASSIFIED,
    Least,
    Near,
    Violations,
    clearance_sd,
    distances,
    fall_in,
    find_violations,
    own_points,
)
from algorithms.corridor._lines import WIRE_COLUMNS, catenaries_of
from algorithms.corridor._objects import CROWN, groups, parted, tree_tops
from algorithms.corridor._rules import (
    KINDS,
    OBJECTS,
    SEVERITIES,
    Rule,
    grown,
    reach_of,
    rule_set,
    rules_of,
    single,
    unknown_set,
)
from algorithms.corridor._sag import (
    Conductor,
    State,
    conductor_of,
    conductor_temperature,
    in_state,
)
from algorithms.corridor._surroundings import Line, Object, Scene
from algorithms.ground.classify import find_terrain, height_above
from algorithms.shared.ground import is_withheld
from algorithms.shared.lowest import require_finite
from toolbox.context import QUIET, Context, log
from toolbox.data import PointCloud, Report, Table, Vector
from toolbox.errors import DataError
from toolbox.spec import outputs, param, sink, source, tool
from toolbox.values import ClassList

SPAN_COLUMNS = (
    *("span_id", "state", "temperature", "wind", "from_tower", "to_tower", "wires", "length"),
    *("sag", "swing", "clearance", "clearance_sd", *KINDS, "objects"),
)
CURVE = (
    *("azimuth", "x0", "y0", "span", "z_start", "z_end", "curvature", "v0", "v1", "swing"),
    *("wire_id", "span_id", "from_tower", "to_tower"),
)
LINE = (13, 14, 15, 16)  # classes: wire guard, conductor, tower, connector
NO_CLASS = (0, 1)
OTHER_GROUND = {"water": 9, "rail": 10, "road": 11}
FARTHEST_TREE = 60.0  # metres to the side from which a tree may fall on a wire
BESIDE_TOWER = 1.0  # metres around the arms of a tower
LEAST_REACH = 10.0  # metres to the side up to which the least clearances are looked for
HEIGHT = "HeightAboveGround"
FALLING = Rule(
    "falling", "height of the tree against the distance of its foot", "", "tree", "3-D", 0.0, 0.0,
    "watch", confirmed=True, note="A tree that falls towards the line reaches it",
)  # fmt: skip
OBJECT_COLUMNS = (
    *("object_id", "severity", "rule", "kind", "clearance", "required", "direction", "sd"),
    *("probability", "span_id", "wire_id", "state", "distance", "vertical", "horizontal"),
    *("station", "height", "points", "confirmed", "source"),
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@tool("corridor.clearance")
class CorridorClearance:
    """Find what is too close to the conductors of a power line.

    `wires` are the catenaries of corridor.extract or corridor.catenaries. Each point that is not of
    the line, and no noise, is measured from the curves of all wires near it: in space, vertically
    and horizontally. `rules` names a table of the toolbox: thesis, nerc_fac_003, cpuc_go95,
    en_50341, ch_lev or ekaty; a `rule_table` of your own has the same columns; `distance` is one
    distance in space instead. Values that have not been confirmed are marked; look them up before
    you rely on them. Points without a class may be trees or buildings, and must keep the rules for
    both. Points of the wires and towers that have no class are left out if they are near enough.

    With a `conductor` and the temperature it had in the survey, clearances are also looked at when
    it is hot, `temperature`, or as hot as a `current` makes it, and in a `wind` from either side.
    Each point counts in the state in which it breaks its rule worst.

    `falling` trees are those that would reach a wire if they fell towards it.
    """

    points: PointCloud = source("Classified points, with the ground")
    wires: Vector = source("Catenaries of the conductors")
    towers: Vector | None = source(
        "Feet of towers, around which points may be theirs", default=None
    )
    rule_table: Table | None = source("Rules of your own, in place of rules", default=None)
    conductor_table: Table | None = source("Conductors of your own", default=None)
    rules: str = param("Name of a rule table of the toolbox", default="thesis")
    distance: float | None = param(
        "One distance in space that all must keep, in place of rules", default=None, unit="m",
        gt=0.0, le=100.0,
    )  # fmt: skip
    voltage: float | None = param(
        "Voltage between two phases, for rules that depend on it", default=None, unit="kV", gt=0.0,
        le=1500.0,
    )  # fmt: skip
    tree_classes: ClassList = param("Classes that are vegetation", default=ClassList([3, 4, 5]))
    building_classes: ClassList = param("Classes that are buildings", default=ClassList([6]))
    ground_classes: ClassList = param("Classes that are ground", default=ClassList([2]))
    ignore: ClassList | None = param(
        "Classes that take no part, such as noise", default=ClassList([7, 18])
    )
    wire_radius: float = param(
        "Points without a class that are nearer to a wire are of it", default=0.5, unit="m",
        ge=0.0, le=5.0,
    )  # fmt: skip
    attachment: float = param(
        "Points without a class that are nearer to the end of a wire are of its support",
        default=5.0, unit="m", ge=0.0, le=20.0,
    )  # fmt: skip
    object_gap: float = param(
        "Points that are farther apart are of different objects", default=2.0, unit="m", gt=0.0,
        le=50.0,
    )  # fmt: skip
    min_points: int = param("Fewest points of an object", default=3, unit="1", ge=1, le=10_000)
    growth: float | None = param(
        "How much trees may grow until the next visit; what is too close then is watched",
        default=None, unit="m", gt=0.0, le=20.0,
    )  # fmt: skip
    falling: bool = param("Whether to look for trees that may fall on a wire", default=True)
    conductor: str | None = param("Name of the conductor, such as Drake", default=None)
    survey_temperature: float | None = param(
        "Temperature of the conductors in the survey", default=None, unit="degC", ge=-60.0, le=250.0
    )
    survey_temperature_sd: float = param(
        "Standard deviation of survey_temperature", default=5.0, unit="degC", ge=0.0, le=50.0
    )
    temperature: float | None = param(
        "Highest temperature of the conductors", default=None, unit="degC", ge=-60.0, le=300.0
    )
    current: float | None = param(
        "Current that heats them, in place of temperature (IEEE 738)", default=None, unit="A",
        gt=0.0, le=20_000.0,
    )  # fmt: skip
    air_temperature: float = param(
        "Temperature of the air, for current", default=40.0, unit="degC", ge=-60.0, le=60.0
    )
    breeze: float = param(
        "Wind square to the line that cools them, for current", default=0.6, unit="m/s", ge=0.0,
        le=50.0,
    )  # fmt: skip
    sun: float = param(
        "Power of the sun, for current", default=1000.0, unit="W/m2", ge=0.0, le=1500.0
    )
    wind: float | None = param(
        "Wind square to the line that swings them", default=None, unit="m/s", gt=0.0, le=70.0
    )
    wind_temperature: float | None = param(
        "Temperature of the conductors in wind; that of the survey by default", default=None,
        unit="degC", ge=-60.0, le=250.0,
    )  # fmt: skip
    ruling_span: float | None = param(
        "Level span that tells the tension; each span its own by default", default=None, unit="m",
        ge=10.0, le=3000.0,
    )  # fmt: skip
    point_sd: float = param(
        "Standard deviation of a point, in height", default=0.05, unit="m", ge=0.0, le=5.0
    )

    @outputs
    class Outputs:
        violations: PointCloud = sink("Points that break a rule, with their clearances in metres")
        objects: Vector = sink("These put together to objects, where they are closest")
        spans: Table = sink("Least clearance of each span by kind of object and state of the wires")
        report: Report = sink("Map, profile of each span, and objects in order of urgency")
        object_count: int = sink("Objects too close to a wire", unit="1")
        critical_count: int = sink("Critical ones of these", unit="1")
        least_clearance: float | None = sink("Least distance in space of any object", unit="m")

    def check(self) -> Iterator[tuple[str, str]]:
        """Names that exist, and settings that need each other."""
        if problem := unknown_set(self.rules):
            yield "rules", problem
        if self.temperature is not None and self.current is not None:
            yield "current", "tells the temperature; give one of both"
        for name in ("temperature", "current", "wind"):
            for needed in ("conductor", "survey_temperature"):
                if getattr(self, name) is not None and getattr(self, needed) is None:
                    yield needed, f"is needed to know the wires at another {name}"
        if self.wind_temperature is not None and self.wind is None:
            yield "wind_temperature", "is for wind, and none is given"

    def check_data(self) -> Iterator[tuple[str, str]]:
        """Classes, catenaries, and rules that can be used."""
        if "classification" not in self.points:
            yield "points", f"{self.points.name} has no classification; classify the points first"
        if missing := [name for name in WIRE_COLUMNS if name not in self.wires.names]:
            shown = ", ".join(missing[:5]) + (", ..." if len(missing) > 5 else "")
            yield "wires", f"no column {shown}; take the wires of corridor.extract"
        else:
            yield from _bad_wires(self.wires)
        if self.towers and (lacking := {"arms", "width"} - set(self.towers.names)):
            yield "towers", f"no column {', '.join(sorted(lacking))}"
        if self.distance is not None and self.rule_table is not None:
            yield "distance", "is in place of rules, and a rule_table is given"
        if not unknown_set(self.rules):
            try:
                self._rules()
            except DataError as error:
                yield ("rules" if self.rule_table is None else "rule_table"), str(error)
        if self.conductor is not None:
            try:
                conductor_of(self.conductor, self.conductor_table)
            except DataError as error:
                yield "conductor", str(error)

    def halo(self) -> float:
        """The least clearance of a span, an object and the page are of the whole line."""
        return math.inf

    def run(self, ctx: Context = QUIET) -> CorridorClearance.Outputs:
        """Measure, group and report."""
        metric = self._in_metres()
        rules, conductor = metric._rules(), metric._conductor()
        states = metric._states(conductor)
        line = metric._line(states, conductor)
        scene = metric._scene(line, ctx.part(0.0, 0.4))
        if not line.spans:
            log.warning("there are no wires, so nothing is too close to one")
            violations, least = _none(), Least(np.empty((len(states), 0, 0)), np.empty(0, int))
            objects: list[Object] = []
        else:
            violations, least = find_violations(
                scene.xyz, scene.kind, line.curves, rules,
                reach=max(reach_of(rules), LEAST_REACH), point_sd=metric.point_sd,
                ctx=ctx.part(0.4, 0.8),
            )  # fmt: skip
            falls = metric._falling(scene, line, violations, ctx.part(0.8, 0.9))
            violations = _joined(violations, replace(falls, rule=falls.rule + len(rules)))
            objects = metric._objects(scene, violations, [*rules, FALLING], line)
        used = [*rules, FALLING] if metric.falling else rules
        spans = _span_table(line, least, objects, scene, metric.point_sd)
        ctx.progress(0.95)
        layer = self._object_layer(objects, line, used, scene)
        page = report_of(scene, line, used, objects, layer.frame, spans, conductor)
        ctx.progress(1.0)
        near = [o.space for o in objects if o.rule < len(rules)]
        return self.Outputs(
            violations=self._violation_cloud(scene, violations, objects, line, used),
            objects=layer,
            spans=spans,
            report=page,
            object_count=len(objects),
            critical_count=sum(used[o.rule].severity == SEVERITIES[0] for o in objects),
            least_clearance=min(near) * self.points.metre if near else None,
        )

    def _in_metres(self) -> CorridorClearance:
        """The same job with lengths in metres, not in the unit of the data."""
        names = (
            *("distance", "wire_radius", "attachment", "object_gap", "growth", "ruling_span"),
            "point_sd",
        )
        given = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        changed: Any = {name: value / self.points.metre for name, value in given.items()}
        return replace(self, **changed)

    def _rules(self) -> list[Rule]:
        if self.distance is not None:
            rules = single(self.distance)
        else:
            rules = rules_of(self.rule_table or rule_set(self.rules), self.voltage)
        return [*rules, *grown(rules, self.growth)] if self.growth else rules

    def _conductor(self) -> Conductor | None:
        return conductor_of(self.conductor, self.conductor_table) if self.conductor else None

    def _states(self, conductor: Conductor | None) -> list[State]:
        """The survey, and whatever else is asked for."""
        states = [State("survey")]
        hottest = self.temperature
        if self.current is not None and conductor is not None:
            hottest = conductor_temperature(
                conductor, current=self.current, air=self.air_temperature, wind=self.breeze,
                sun=self.sun,
            )  # fmt: skip
        if hottest is not None:
            states.append(State(f"{hottest:.0f} C", hottest))
        if self.wind is not None:
            for side, wind in (("left", self.wind), ("right", -self.wind)):
                states.append(State(f"blown {side}", self.wind_temperature, wind))
        return states

    def _line(self, states: Sequence[State], conductor: Conductor | None) -> Line:
        """The wires in each state, in metres from an origin near by."""
        frame = self.wires.frame
        bounds = shapely.total_bounds(frame.geometry.to_numpy()) if len(frame) else np.zeros(4)
        metre = self.points.metre  # whole metres: the same place whatever the unit
        origin = np.array([*np.floor(bounds[:2] / metre), 0.0]) * metre
        surveyed = catenaries_of(self.wires, origin) if len(frame) else []
        curves = [surveyed]
        for state in states[1:]:
            assert conductor is not None
            assert self.survey_temperature is not None
            curves.append([
                in_state(
                    curve, conductor, state, surveyed=self.survey_temperature,
                    surveyed_sd=self.survey_temperature_sd, ruling_span=self.ruling_span,
                )
                for curve in surveyed
            ])  # fmt: skip
        columns = ("wire_id", "span_id", "from_tower", "to_tower")
        numbers = [frame[name].to_numpy(np.int64) for name in columns]
        return Line(origin, list(states), curves, *numbers)

    def _scene(self, line: Line, ctx: Context) -> Scene:
        """Points in metres, what they are, and how high above the ground."""
        cloud, metre = self.points, self.points.metre
        require_finite(cloud.xyz)
        index = self._near(line)
        classes = np.asarray(cloud["classification"])
        kind = np.full(len(cloud), KINDS.index("other"), np.int8)
        for name, codes in (
            ("unclassified", NO_CLASS),
            *((name, (code,)) for name, code in OTHER_GROUND.items()),
            ("tree", self.tree_classes),
            ("building", self.building_classes),
            ("ground", self.ground_classes),
        ):
            kind[np.isin(classes, codes)] = KINDS.index(name)
        withheld, noise = is_withheld(cloud), np.isin(classes, self.ignore or ())
        of_line = np.isin(classes, LINE)
        left_out = {
            "withheld": int(withheld.sum()),
            f"of ignored classes ({self.ignore})": int((noise & ~withheld).sum()),
            "classes of the line (13 to 16)": int((of_line & ~noise & ~withheld).sum()),
        }
        kind[withheld | noise | of_line] = TAKES_NO_PART
        kind = kind[index]
        height = self._heights(index, kind == KINDS.index("ground"), ctx.part(0.0, 0.5))
        xyz = cloud.xyz[index]
        xyz -= line.origin
        xyz /= metre
        if line.spans:
            mine = own_points(
                xyz, kind, line.curves[0], radius=self.wire_radius, attachment=self.attachment,
                ctx=ctx.part(0.5, 1.0),
            )  # fmt: skip
            mine |= self._beside_towers(xyz, kind, line.origin, metre)
            kind[mine] = TAKES_NO_PART
            left_out["without a class, on a wire or at a support"] = int(mine.sum())
        return Scene(index, xyz, kind, height, left_out)

    def _near(self, line: Line) -> Ints:
        """Indices of the points to look at, near the wires in plan."""
        if not line.spans:
            return np.empty(0, np.int64)
        reach = max(reach_of(self._rules()), FARTHEST_TREE if self.falling else LEAST_REACH)
        cells, cloud = Near.of(line.curves, reach), self.points
        found = []
        for first in range(0, len(cloud), BLOCK):
            xy = (cloud.xyz[first : first + BLOCK, :2] - line.origin[:2]) / cloud.metre
            found.append(first + np.flatnonzero(cells.has(xy)))
        return np.concatenate(found or [np.empty(0, np.int64)])

    def _heights(self, index: Ints, ground: NDArray[np.bool_], ctx: Context) -> Floats:
        """Metres above the ground of some points; NaN where not known."""
        cloud = self.points
        if HEIGHT in cloud:
            return np.asarray(cloud[HEIGHT], float)[index] / cloud.metre
        if not len(index):
            return np.empty(0)
        if not ground.any():
            log.warning("no point is ground: heights are not known, falling trees not looked for")
            return np.full(len(index), np.nan)
        places = cloud.xyz[index]
        bare = places[ground]
        bare.flags.writeable = places.flags.writeable = False  # as the kernels are compiled for
        return height_above(places, find_terrain(bare, metre=cloud.metre, ctx=ctx))

    def _beside_towers(
        self, xyz: Floats, kind: NDArray[np.int8], origin: Floats, metre: float
    ) -> NDArray[np.bool_]:
        """Points without a class within the arms of a tower."""
        mine = np.zeros(len(xyz), bool)
        if self.towers is None or not len(self.towers) or self.attachment == 0:
            return mine
        frame = self.towers.frame
        feet = (shapely.get_coordinates(frame.geometry.to_numpy()) - origin[:2]) / metre
        radius = frame[["arms", "width"]].max(axis=1).to_numpy(float) / 2 + BESIDE_TOWER
        some = np.flatnonzero(kind == UNCLASSIFIED)
        away, nearest = cKDTree(feet).query(xyz[some, :2])
        mine[some] = away <= np.nan_to_num(radius, nan=BESIDE_TOWER)[nearest]
        return mine

    def _falling(
        self, scene: Scene, line: Line, violations: Violations, ctx: Context
    ) -> Violations:
        """Tops of trees that reach a wire, as violations of the first rule after the others."""
        trees = np.flatnonzero((scene.kind == TREE) | (scene.kind == UNCLASSIFIED))
        if not self.falling or not len(trees):
            return _none()
        tops = trees[tree_tops(scene.xyz[trees], scene.height[trees])]
        near = violations.point[np.isin(scene.kind[violations.point], (TREE, UNCLASSIFIED))]
        if len(near) and len(tops):  # those are told already
            away = cKDTree(scene.xyz[near, :2]).query(scene.xyz[tops, :2])[0]
            tops = tops[away > CROWN]
        left, wire, state, u = fall_in(
            np.ascontiguousarray(scene.xyz[tops]), scene.height[tops], line.curves, ctx=ctx
        )
        hit = left < 0
        nan = np.full(int(hit.sum()), np.nan)
        sd = clearance_sd(line.curves, state[hit], wire[hit], u[hit], self.point_sd)
        return Violations(
            tops[hit], wire[hit], np.zeros(len(nan), np.int64), state[hit], left[hit],
            left[hit], nan, nan, nan, u[hit], sd, ndtr(-left[hit] / sd),
        )  # fmt: skip

    def _objects(
        self, scene: Scene, violations: Violations, rules: Sequence[Rule], line: Line
    ) -> list[Object]:
        """Violations put together, the most urgent first."""
        xyz, kind = scene.xyz[violations.point], scene.kind[violations.point].astype(np.int64)
        falls = violations.rule == len(rules) - 1
        found = groups(xyz, np.where(falls, -1, kind), self.object_gap)
        may_part = ((kind == TREE) | (kind == UNCLASSIFIED)) & ~falls
        tops = xyz[may_part][tree_tops(xyz[may_part], scene.height[violations.point][may_part])]
        found = parted(xyz, found, may_part, tops)
        found[falls] = found.max(initial=-1) + 1 + np.arange(int(falls.sum()))
        rank = np.array([SEVERITIES.index(rule.severity) for rule in rules])[violations.rule]
        order = np.lexsort((*xyz.T, violations.ratio, rank))  # the worst first, and always the same
        first = np.sort(np.unique(found[order], return_index=True)[1])
        members = _members(found)
        objects, lone = [], 0
        for worst in order[first]:
            own = members[found[worst]]
            if len(own) < self.min_points and not falls[worst]:
                lone += len(own)
                continue
            heights = scene.height[violations.point[own]]
            known = heights[np.isfinite(heights)]
            objects.append(
                Object(
                    points=violations.point[own],
                    nearest=int(violations.point[worst]),
                    kind=KINDS[kind[worst]],
                    rule=int(violations.rule[worst]),
                    wire=int(violations.wire[worst]),
                    state=int(violations.state[worst]),
                    measure=float(violations.measure[worst]),
                    space=float(violations.space[worst]),
                    vertical=float(violations.vertical[worst]),
                    flat=float(violations.flat[worst]),
                    u=float(violations.u[worst]),
                    sd=float(violations.sd[worst]),
                    probability=float(violations.probability[worst]),
                    height=float(known.max()) if len(known) else math.nan,
                )
            )
        if lone:
            log.warning("%d points break a rule, but are too few for an object", lone)
            scene.left_out["break a rule, but are too few for an object"] = lone
        return objects

    def _object_layer(
        self, objects: Sequence[Object], line: Line, rules: Sequence[Rule], scene: Scene
    ) -> Vector:
        """One point per object, where it is closest."""
        rows: list[dict[str, Any]] = []
        for number, one in enumerate(objects, start=1):
            rule = rules[one.rule]
            rows.append({
                "object_id": number, "severity": rule.severity, "rule": rule.id, "kind": one.kind,
                "clearance": one.measure, "required": rule.threshold, "direction": rule.direction,
                "sd": one.sd, "probability": one.probability,
                "span_id": int(line.span[one.wire]), "wire_id": int(line.wire[one.wire]),
                "state": line.states[one.state].name, "distance": one.space,
                "vertical": one.vertical, "horizontal": one.flat, "station": one.u,
                "height": one.height, "points": len(one.points), "confirmed": rule.confirmed,
                "source": rule.source,
            })  # fmt: skip
        places = shapely.points(self.points.xyz[scene.index[[one.nearest for one in objects]]])
        frame = geopandas.GeoDataFrame(
            rows, columns=OBJECT_COLUMNS, geometry=places, crs=self.points.crs
        )
        return Vector(frame, geometry_type="Point Z")

    def _violation_cloud(
        self,
        scene: Scene,
        found: Violations,
        objects: Sequence[Object],
        line: Line,
        rules: Sequence[Rule],
    ) -> PointCloud:
        """The points that break a rule, in their order."""
        order = np.argsort(found.point, kind="stable")
        number = np.zeros(len(scene.index), np.uint32)
        for k, one in enumerate(objects, start=1):
            number[one.points] = k
        severity = np.array([SEVERITIES.index(rule.severity) + 1 for rule in rules], np.uint8)
        wire = found.wire[order]
        cloud = self.points.select(scene.index[found.point[order]])
        return cloud.with_attributes(
            {
                "clearance": found.measure[order].astype(np.float32),
                "clearance_sd": found.sd[order].astype(np.float32),
                "probability": found.probability[order].astype(np.float32),
                "distance": found.space[order].astype(np.float32),
                "vertical": found.vertical[order].astype(np.float32),
                "horizontal": found.flat[order].astype(np.float32),
                "severity": severity[found.rule[order]],
                "rule": (found.rule[order] + 1).astype(np.uint16),
                "state": found.state[order].astype(np.uint8),
                "wire_id": line.wire[wire].astype(np.uint32),
                "span_id": line.span[wire].astype(np.uint32),
                "object_id": number[found.point[order]],
            },
            descriptions={
                "clearance": "in the direction of the rule, m",
                "clearance_sd": "standard deviation, m",
                "probability": "that the rule is broken",
                "distance": "in space from the wire, m",
                "vertical": "below the wire, m",
                "horizontal": "beside the wire, m",
                "severity": "1 critical 2 warning 3 watch",
                "rule": "its place in the report",
                "state": "0 survey, others see report",
                "wire_id": "conductor",
                "span_id": "between two towers",
                "object_id": "0 for none",
            },
        )


def _bad_wires(wires: Vector) -> Iterator[tuple[str, str]]:
    """Curves must have an extent and be bent; their covariance need not be known."""
    for number, row in enumerate(wires.frame[list(CURVE)].to_dict("records"), start=1):
        for name, value in row.items():
            positive = name in ("span", "curvature")
            number_like = isinstance(value, int | float) and math.isfinite(value)
            if not number_like or (positive and value <= 0):
                rule = "a number above 0" if positive else "a number"
                yield "wires", f"row {number}: {name} must be {rule}, got {value!r}"
                return


def _none() -> Violations:
    whole, real = np.empty(0, np.int64), np.empty(0)
    return Violations(whole, whole, whole, whole, *([real] * 8))


def _joined(one: Violations, other: Violations) -> Violations:
    names = Violations.__dataclass_fields__
    return Violations(*(np.concatenate([getattr(one, n), getattr(other, n)]) for n in names))


def _members(group: Ints) -> list[Ints]:
    """The indices in each group."""
    order = np.argsort(group, kind="stable")
    edges = np.searchsorted(group[order], np.arange(1, int(group.max(initial=-1)) + 1))
    return np.split(order, edges) if len(group) else []


def _span_table(
    line: Line, least: Least, objects: Sequence[Object], scene: Scene, sd: float
) -> Table:
    """One row per span and state; clearances in space, in metres."""
    rows = []
    for span in line.spans:
        own = np.flatnonzero(line.span == span)
        for number, state in enumerate(line.states):
            curves = [line.curves[number][k] for k in own]
            rows.append({
                "span_id": span, "state": state.name, "temperature": state.temperature,
                "wind": state.wind, "from_tower": int(line.start[own[0]]),
                "to_tower": int(line.end[own[0]]), "wires": len(own),
                "length": max(curve.length for curve in curves),
                "sag": max(curve.sag for curve in curves),
                "swing": math.degrees(math.atan(max((c.swing for c in curves), key=abs))),
                **_least_of(line, least, own, number, scene, sd),
                "objects": sum(o.state == number and line.span[o.wire] == span for o in objects),
            })  # fmt: skip
    return Table(pd.DataFrame(rows, columns=SPAN_COLUMNS), name="spans")


def _least_of(
    line: Line, least: Least, own: Ints, state: int, scene: Scene, sd: float
) -> dict[str, float | None]:
    """Least clearance of a span from anything, its standard deviation, and that of each kind."""
    table = least.distance[state, own]
    wire, kind = np.unravel_index(table[:, : len(OBJECTS)].argmin(), (len(own), len(OBJECTS)))
    row: dict[str, float | None] = {"clearance": None, "clearance_sd": None}
    if math.isfinite(table[wire, kind]):
        curve = line.curves[state][own[wire]]
        point = scene.xyz[[least.point[state, own[wire], kind]]]
        sigma = float(curve.height_sigma(distances(point, curve)[:, 3])[0])
        row["clearance"] = float(table[wire, kind])
        row["clearance_sd"] = math.hypot(sd, sigma) if math.isfinite(sigma) else sd
    nearest = table.min(axis=0)
    return row | {
        name: float(near) if math.isfinite(near) else None
        for name, near in zip(KINDS, nearest, strict=True)
    }
