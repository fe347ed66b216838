"""Walls of outlines of buildings beside those of maps, and beside where their points end.

Every half metre along the walls of one, the nearest parallel wall of the other is looked for,
square to it. What is the map's own is taken apart: its shift, how far eaves reach beyond walls, and
the shift of each of its houses, which were drawn one by one. What is left to the outline is how far
its walls are from where the points end that the provider of the survey calls buildings.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tests.bench.corners import (
    NEAR,
    Place,
    eaves_of,
    ends_of_points,
    is_one,
    maps,
    outlined,
    shift_of,
)
from tests.bench.measuring import say

APART = 0.5  # metres between places along a wall
REACH = 2.0  # metres, up to which a wall is looked for
PARALLEL = 15.0  # degrees between walls that may be the same
DENSITIES = (8.0, 4.0, 2.0, 1.0)  # points per m2
SEEDS = range(50, 58)  # of drawn roofs; limits were chosen on 0 to 3


def walls() -> None:
    """Walls of outlines beside those of maps, and of drawn roofs."""
    for place in maps():
        drawn = outlined(place.points).outlines.frame.geometry.to_numpy()
        for told, away in _beside(place, drawn):
            say(f"walls    {place.name:14} {told}: {_figures(away)}")
    for kind, shapes in drawn_roofs().items():
        for density in DENSITIES:
            rms, farthest = _of_drawn(shapes, density)
            say(
                f"walls    {kind} roofs, {density:g} points per m2: {rms:.2f} m RMS, worst place "
                f"{farthest:.1f} m"
            )


def _beside(place: Place, drawn: Any) -> Iterator[tuple[str, Any]]:
    """What is measured, and distances in metres, outwards; not a number where no wall is."""
    import numpy as np
    import shapely

    own = shapely.union_all(drawn) & place.area
    plan = shapely.union_all(shapely.make_valid(place.shapes)) & place.area
    plan = _moved(plan, shift_of(own, plan))
    houses = [house for house in shapely.get_parts(plan) if is_one(house, own)]
    inside = place.area.buffer(-NEAR)
    yield "map with one shift", _from_houses(houses, own, inside)
    shifts = [shift_of(own & house.buffer(NEAR), house) for house in houses]
    moved = [_moved(house, shift) for house, shift in zip(houses, shifts, strict=True)]
    yield (
        "each house moved, by " + ", ".join(f"{np.hypot(*shift):.2f}" for shift in shifts) + " m",
        _from_houses(moved, own, inside),
    )
    away = _from_walls([own], ends_of_points(place), inside, any_direction=True)
    yield "where points end", -away


def _moved(shape: Any, shift: Any) -> Any:
    import shapely

    return shapely.transform(shape, lambda xy: xy + shift)


def _from_houses(houses: list[Any], own: Any, inside: Any) -> Any:
    """Distances from the walls of a map, each house made wider by its eaves, to outlines."""
    wide = [house.buffer(eaves_of(house, own), join_style="mitre") for house in houses]
    return _from_walls(wide, own, inside)


def _from_walls(shapes: list[Any], other: Any, inside: Any, *, any_direction: bool = False) -> Any:
    """Distances from walls of shapes to those of another shape, outwards, array of shape (n,)."""
    import numpy as np
    import shapely

    begin, end = _edges(other)
    step = end - begin
    length = np.hypot(*step.T)
    along = step / length[:, None]
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    least = 0.0 if any_direction else np.cos(np.radians(PARALLEL))
    away = []
    for place, outward in zip(*_places(shapes), strict=True):
        if not shapely.contains_xy(inside, *place):
            continue
        alike = normal @ outward
        meets = alike > max(least, 1e-6)
        far = ((begin[meets] - place) * normal[meets]).sum(axis=1) / alike[meets]
        at = ((place + far[:, None] * outward - begin[meets]) * along[meets]).sum(axis=1)
        far = far[(at >= 0) & (at <= length[meets]) & (np.abs(far) < REACH)]
        away.append(far[np.abs(far).argmin()] if len(far) else np.nan)
    return np.array(away)


def _edges(shape: Any) -> tuple[Any, Any]:
    """Begins and ends of the edges of polygons, two arrays of shape (n, 2), inside on the left."""
    import numpy as np
    import shapely
    from shapely.geometry.polygon import orient

    parts = [orient(part) for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    chains = [np.asarray(r.coords) for part in parts for r in (part.exterior, *part.interiors)]
    return np.concatenate([c[:-1] for c in chains]), np.concatenate([c[1:] for c in chains])


def _places(shapes: list[Any]) -> tuple[Any, Any]:
    """Places along the walls of polygons, and the directions outwards there."""
    import numpy as np

    places, outward = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for begin, end in (edge for shape in shapes for edge in zip(*_edges(shape), strict=True)):
        step = end - begin
        count = max(1, round(float(np.hypot(*step)) / APART))
        places.append(begin + (np.arange(count) + 0.5)[:, None] / count * step)
        outward.append(np.tile([step[1], -step[0]] / np.hypot(*step), (count, 1)))
    return np.concatenate(places), np.concatenate(outward)


def _figures(away: Any) -> str:
    import numpy as np

    both = away[np.isfinite(away)]
    middle = np.median(both)
    return (
        f"{100 * len(both) / len(away):.0f} % of {len(away)} places; mean {both.mean():+.2f} m, "
        f"{np.sqrt(np.mean(both**2)):.2f} m RMS, median of absolute deviations "
        f"{np.median(np.abs(both - middle)):.2f} m"
    )


def drawn_roofs() -> dict[str, list[Any]]:
    """Polygons of roofs with square, slanted and round walls, by kind."""
    import numpy as np
    import shapely

    def arc(inner: float, outer: float, first: float, last: float, count: int) -> Any:
        turn = np.radians(np.linspace(first, last, count))[:, None]
        around = np.hstack([np.cos(turn), np.sin(turn)])
        whole = last - first == 360
        return shapely.Polygon(
            outer * around if whole else [*(outer * around), *(inner * around[::-1])]
        )

    box = shapely.box
    yard = box(0, 0, 24, 22)
    bow = [(30 - x, 10 + 2.5 * np.sin(np.pi * x / 30)) for x in np.linspace(0, 30, 31)]
    return {
        "square": [
            *(box(0, 0, 14, 9), box(0, 0, 60, 10), box(0, 0, 16, 8) | box(0, 0, 7, 18)),
            *(box(0, 0, 9, 14) | box(2.5, 0, 7.5, 19.5), box(0, 0, 14, 9) | box(5, 9, 9, 11.5)),
            *(box(0, 0, 20, 10) - box(8, 7.5, 12, 10), yard - box(8, 8, 16, 15)),
        ],
        "slanted": [
            shapely.Polygon(corners)
            for corners in (
                [(0, 0), (14, 0), (14, 6), (10.5, 9.5), (0, 9.5)],
                [(0, 0), (18, 0), (18, 12), (0, 8)],
                [(0, 0), (16, 0), (19, 10), (3, 10)],
            )
        ]
        + [arc(0, 9, 0, 360, 7), arc(0, 8, 0, 360, 9)],
        "round": [
            *(arc(0, 9, 0, 360, 73), arc(0, 5, 0, 360, 73), arc(22, 34, 10, 140, 60)),
            *(box(-16, -6, 0.1, 6) | arc(0, 6, -90, 90, 60), arc(0, 22, 0, 90, 60)),
            shapely.Polygon([(0, 0), (30, 0), *bow]),
        ],
    }


def _of_drawn(shapes: list[Any], density: float) -> tuple[float, float]:
    """Root mean square and largest distance between drawn roofs and their outlines, metres."""
    import numpy as np
    import shapely

    from algorithms.shared.alpha_shape import alpha_shape

    spacing = 1 / np.sqrt(density)
    away = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        for shape in shapes:
            roof = shapely.affinity.rotate(shape, rng.uniform(0, 90), origin=(0, 0))
            x0, y0, x1, y1 = roof.bounds
            count = rng.poisson(density * (x1 - x0) * (y1 - y0))
            xy = rng.uniform((x0, y0), (x1, y1), (count, 2))
            xy = xy[shapely.contains_xy(roof, *xy.T)]
            found = _outline(alpha_shape, xy, spacing)
            away += [_between(roof, found), _between(found, roof)]
    every = np.concatenate(away)
    return float(np.sqrt(np.mean(every**2))), float(every.max())


def _outline(alpha_shape: Any, xy: Any, spacing: float) -> Any:
    """The outline of the largest roof, as classify.buildings draws it with its defaults."""
    import shapely

    from algorithms.classify._outlines import margin, without_spikes
    from algorithms.classify._squared import squared
    from algorithms.classify.buildings import SIMPLE, SIMPLE_BY_SPACING

    alpha = max(1.5, 2.25 * spacing)
    shapes = without_spikes(alpha_shape(xy, alpha, hole_threshold=10.0).polygons, alpha)
    shape = max(shapes, key=shapely.area)
    depth = margin(len(xy) / shape.area, alpha)
    tolerance = max(SIMPLE, SIMPLE_BY_SPACING * spacing)
    return squared(shape.buffer(depth, join_style="mitre"), tolerance, alpha)[0]


def _between(one: Any, other: Any) -> Any:
    """Distances from places along the edge of one polygon to that of another."""
    import shapely

    places = shapely.get_coordinates(shapely.segmentize(one.boundary, APART / 2))
    return shapely.distance(shapely.points(places), other.boundary)
