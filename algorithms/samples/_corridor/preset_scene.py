"""Scenes of presets: the land, what stands on it, the flight, and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import shapely

from algorithms.samples._corridor.catenary import placed
from algorithms.samples._corridor.flights import flown, strips
from algorithms.samples._corridor.land import MARGIN, drops, grow, relief, street
from algorithms.samples._corridor.lines import Course, build, courses
from algorithms.samples._corridor.presets import Preset
from algorithms.samples._corridor.routes import Route, winding
from algorithms.samples._corridor.site import Area, Site, Wire
from algorithms.samples._corridor.trees import tree_features
from algorithms.samples._survey import EAST, NORTH, Features, Floats, SceneData
from toolbox.context import QUIET, Context

SHORTEST = 5.0  # of a piece of a wire that is truth, m
# m between two positions of a wire that are one: a curve between them is within 0.05 m of both, as
# near as heights of catenaries are asked to be, and no survey of these scenes shows two.
ONE_POSITION = 0.1


def preset_scene(preset: Preset, seed: int, ctx: Context = QUIET) -> SceneData:
    """The scene of a preset; the seed decides on the details."""
    rng = np.random.default_rng(seed)
    site, routes = built(preset, rng)
    terrain = site.builder.terrain
    x, y = (v.ravel() for v in np.broadcast_arrays(*terrain.centres()))
    inside = terrain.values.ravel()[site.covers(np.column_stack([x, y]))]
    all_strips = strips(routes, preset.flight, (float(inside.min()), float(inside.max())), rng)
    xyz, attributes = flown(site, preset.flight, all_strips, ctx)
    swings = list(dict.fromkeys(strip.swing for strip in all_strips))
    return SceneData(xyz, attributes, terrain.placed(), truth(site, swings))


def built(preset: Preset, rng: np.random.Generator) -> tuple[Site, list[Route]]:
    """A site with all that stands, hangs and grows there, and the routes of the flight."""
    site, routes = _with_lines(preset, rng)
    if preset.street:
        street(site, preset.street)
    for structure in preset.others:
        structure(site)
    if preset.street:
        drops(site, preset.street.drops)
    grow(site, preset.plants)
    return site, routes


def _with_lines(preset: Preset, rng: np.random.Generator) -> tuple[Site, list[Route]]:
    """The land with its power lines, and the routes along which it is flown."""
    route = winding(rng, preset.length, preset.legs, preset.bends)
    made = courses(preset.lines, route, rng)
    half = preset.flight.half
    all_routes = [route, *(course.route for course in made if course.line.way != "along")]
    area = cast(Area, shapely.union_all([each.area(half) for each in all_routes]))
    step = MARGIN - np.array(area.bounds[:2])
    area = shapely.transform(area, lambda xy: xy + step)
    all_routes = [each.moved(step) for each in all_routes]
    builder = relief(preset.land, area, all_routes[0], rng)
    site = Site(builder, all_routes[0], area, half, preset.flight.hidden)
    build(site, [_moved(course, step) for course in made])
    return site, all_routes


def _moved(course: Course, step: Floats) -> Course:
    return replace(course, route=course.route.moved(step))


# --- truth ---------------------------------------------------------------------------------


def truth(site: Site, swings: Sequence[float] = (0.0,)) -> Features:
    """Wires in the survey, blown aside by each of some angles, their attachments, and the rest."""
    wires = [feature for wire in site.wires for feature in _wire_features(site, wire, swings)]
    crowns = site.builder.world().crowns
    trees = tree_features(site.builder.terrain, site.wires, crowns)
    return [*site.features, *wires, *site.builder.features, *trees]


def _wire_features(site: Site, wire: Wire, swings: Sequence[float]) -> Features:
    """The part of a wire that is in the survey, in each position, and its ends if they are.

    Parameters
    ----------
    swings : angles by which wind blew it aside while it was surveyed, radians
    """
    apart = told_apart(swings, wire.curve.sag)
    positions = [feature for swing in apart for feature in _position(site, wire, swing)]
    made: Features = []
    for end, tower in zip((wire.curve.start, wire.curve.end), wire.towers, strict=True):
        if site.covers(np.array([end]))[0]:
            point = shapely.Point(np.round(np.array(end) + np.array([EAST, NORTH, 0.0]), 4))
            made.append((point, {"kind": "attachment", "tower_id": tower, **_ids(wire)}))
    return [*positions, *made]


def told_apart(swings: Sequence[float], sag: float) -> list[float]:
    """Angles of positions of a wire that are apart; those next to each other are one, their mean.

    Parameters
    ----------
    swings : angles by which it was blown aside, radians
    sag : metres, by which its middle is from the line about which wind turns it
    """
    groups: list[list[float]] = []
    for swing in swings:
        near = (own for own in groups if 2 * sag * abs(np.sin((swing - own[0]) / 2)) < ONE_POSITION)
        if (own := next(near, None)) is None:
            groups.append([swing])
        else:
            own.append(swing)
    return [float(np.mean(own)) for own in groups]


def _position(site: Site, wire: Wire, swing: float) -> Features:
    """The part of a wire, blown aside by an angle, that is in the survey; none if it is short."""
    places = wire.points(0.25, swing)
    inside = np.flatnonzero(site.covers(places))
    curve = wire.curve
    if len(inside) < 2 or curve.span * len(inside) / len(places) < SHORTEST:
        return []
    properties = {
        "kind": "wire",
        "object_id": wire.owner,
        **_ids(wire),
        "classification": wire.cls,
        "from_tower": wire.towers[0],
        "to_tower": wire.towers[1],
        "a": curve.a,
        "b": curve.b,
        "c": curve.c,
        "sag": curve.sag,
        "span": curve.span,
        "length": curve.length,
        "swing": float(np.degrees(swing)),
    }
    drawn = places[[*inside[:-1:8], inside[-1]]]  # 2 m apart, and the last
    return [(placed(drawn), properties)]


def _ids(wire: Wire) -> dict[str, Any]:
    return {"wire_id": wire.wire_id, "span_id": wire.span_id, "line": wire.line}
