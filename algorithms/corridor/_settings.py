"""The numbers by which power lines are found, each with its unit, its meaning and where it is from.

They are grouped by the steps that need them, and read as `SETTINGS.arcs.coarse_bins`. None is a
parameter of a tool: a user has no means to tell a better one. Lengths are metres, or multiples of
the tolerance at which wires are followed.

Not here are numbers on which nothing hangs but time, memory or how fine something is drawn: the
size of the cells of an index, of bins and buffers, the most rounds of an iteration that ends
before; and those of definitions and papers, such as the cut of Tukey's weights.

How much each is felt: `python -m tests.bench corridor_settings`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any


def number(source: str, default: Any, unit: str, meaning: str) -> Any:
    """A field with a number, or with several of one rule."""
    return field(default=default, metadata={"unit": unit, "meaning": meaning, "source": source})


built = partial(number, "how lines, and what is taken for them, are built")
surveyed = partial(number, "what surveys record: spacing, noise and footprints of points")
unlikely = partial(number, "what is unlikely by chance")
tried = partial(number, "the best of those tried on scenes and tiles")


@dataclass(frozen=True)
class Points:
    """Which points are looked at, and the ground below them."""

    off_ground: float = surveyed(
        0.4, "m", "height above the ground from which a point can be of a tower"
    )
    company_side: float = surveyed(
        2.0, "m", "in which points have others, along a wire and in plan; half of it up"
    )
    company_share: float = tried(
        0.9, "1", "share of the points with such company, from which the others are errors"
    )
    plane_points: int = tried(
        8, "points", "of the ground, through which the plane under a support is laid"
    )
    area_cells: int = tried(
        6, "cells", "of the eight around one that hold points where points lie in an area"
    )
    area_share: float = tried(0.35, "1", "share of such cells, below which points lie along lines")
    fewest_cells: int = unlikely(50, "cells", "with points, from which that is judged")
    fewest_of_cell: float = unlikely(1.5, "points", "in each cell, from which that is judged")


@dataclass(frozen=True)
class Trace:
    """Where wires may begin, and how they are followed."""

    crowd_reach: int = tried(2, "voxels", "to each side that may crowd a wire")
    least_eighths: float = surveyed(
        42.0, "voxels / 8", "that wires fill in 5 m, at least; twice as many at most"
    )
    eighths_per_density: float = surveyed(
        9.0, "voxels / 8 m2", "that six wires side by side fill in 5 m, per point / m2"
    )
    shortest_curve: float = tried(10.0, "m", "length of a curve that is kept")
    seed_reach: float = tried(
        6.0, "m", "to both sides of a seed, of the straight piece in which a wire begins"
    )
    steepest: float = built(0.7, "m / m", "rise over run of a wire")
    least_seed: float = tried(3.5, "m", "of the straight piece with points, where a wire may begin")
    look_share: float = tried(0.4, "1", "share of what is known of a wire by which one looks ahead")
    usual_sag: float = built(
        3e-3, "1 / m", "second coefficient of the height along a wire, by its weight"
    )
    least_rms: float = surveyed(0.04, "m", "scatter of points about what is followed, at least")
    widest: float = tried(2.5, "tolerances", "where a curve is extrapolated far")
    resuming_share: float = tried(
        0.3, "1", "share of the usual number of points that must be found after a gap"
    )


@dataclass(frozen=True)
class Fit:
    """How a catenary is fitted to points."""

    known_curvature: float = built(
        0.1, "1", "standard deviation of a curvature that is known of other wires, as a share of it"
    )
    swaying_sag: float = tried(0.5, "m", "sag from which a swing can be told from an azimuth")


@dataclass(frozen=True)
class Curves:
    """Which curves are wires."""

    clear_share: float = tried(
        0.65,
        "1",
        "share of a curve along which it stands out from its surroundings, of what may be wire",
    )
    fewest_points: int = unlikely(7, "points", "of a curve")
    sure_length: float = tried(30.0, "m", "length from which a curve is a wire by itself")
    fine_length: float = tried(18.0, "m", "the same of a clean curve")
    fine_rms: float = tried(0.3, "tolerances", "scatter of a clean curve")
    roughest: float = tried(0.8, "tolerances", "scatter of anything that may be wire")
    largest_c: float = built(
        5000.0, "m", "most tension over weight of a wire; wind from the side bends it as little"
    )
    smallest_c: float = built(30.0, "m", "least tension over weight of a wire")
    certain_sigmas: float = unlikely(3.0, "sigmas", "from which something is certain")
    largest_swing: float = built(1.5, "tangent", "of the angle by which wind may lift a wire")
    clutter_radius: float = tried(
        1.5, "m", "around a wire, an arm, the top of a support or what a rope carries"
    )
    alone_share: float = tried(
        0.2, "1", "share of a wire along which there is no clutter, at least"
    )
    isolated_points: int = unlikely(
        15,
        "points",
        "of a clean curve, or of one with nothing around it; with fewer on an arc it does not tell "
        "alone where it is held",
    )
    hanger_depth: float = built(
        5.0, "m", "depth of what hangs from a curve, and step along it for which that is counted"
    )
    hanger_share: float = tried(
        0.4, "1", "share of the steps with hangers, from which a curve carries something"
    )


@dataclass(frozen=True)
class Roofs:
    """Which curves are ridges or edges of roofs."""

    slope: float = built(2.0, "m / m", "rise over run of the steepest roof")


@dataclass(frozen=True)
class Network:
    """Which curves belong together."""

    join_gap: float = built(14.0, "m", "along, between wires that meet at a support")
    join_aside: float = built(
        3.0, "m", "aside between wires that meet at a support, and between supports that are one"
    )
    parallel: float = built(6.0, "degrees", "between wires of one line")
    line_width: float = built(15.0, "m", "aside, and up, to the other wires of a line")
    telling_length: float = tried(
        8.0, "m", "along which two wires are beside each other, or one passes a support, to tell so"
    )
    longest_missing: float = tried(
        60.0,
        "m",
        "of a wire that may be missing, of its end that tells where it goes on, and of a drop",
    )
    bundle_width: float = built(
        0.6, "m", "within which conductors form a bundle; what a rope carries is wider"
    )

    @property
    def cos_parallel(self) -> float:
        """Cosine of the angle between wires of one line."""
        return math.cos(math.radians(self.parallel))


@dataclass(frozen=True)
class Structures:
    """What hangs in arcs as wires do, and is none."""

    contact_depth: float = built(
        2.2, "m", "from a messenger wire down to the contact wire that it holds, at most"
    )
    contact_step: float = tried(3.0, "m", "along these two, for which both are looked for")
    fewest: int = unlikely(5, "1", "points, steps or crossings by which something is known")
    filled: float = tried(
        0.6,
        "1",
        "share of steps, cells, metres or points, from which something is so all along",
    )
    contact_bend: float = built(
        0.35, "1", "share of the curvature of the messenger wire: the contact wire has less"
    )
    messenger_least_c: float = built(
        300.0, "m", "tension over weight of a wire that holds another, at least"
    )
    messenger_height: float = built(
        10.0, "m", "above the rails: 6.5 of the contact wire, and what holds it"
    )
    contact_span: float = built(70.0, "m", "longest span of a contact line")
    level_share: float = tried(
        0.3,
        "1",
        "share of pieces, or of the wires of a line, that hold something level; some lie at masts",
    )
    carrier_bottom: float = built(8.0, "m", "below a rope, where what it carries ends")
    carrier_room: float = built(
        2.0,
        "m",
        "of empty air around it; its length, and what lies around a cable above a deck, is twice",
    )
    body_gap: float = surveyed(
        1.0,
        "m",
        "between points of one body, a carrier, a deck or a face of a lattice, at most; from a "
        "rope to what it carries",
    )
    bridge_sag: float = built(1 / 15, "1", "share of its span: more than wires sag")
    mesh_height: float = built(0.4, "m", "up, between wires that are tied")
    mesh_gap: float = built(12.0, "m", "between two crossings of a wire in a mesh, at most")
    mesh_angle: float = built(30.0, "degrees", "between wires that cross")

    @property
    def sin_mesh(self) -> float:
        """Sine of the angle between wires that cross."""
        return math.sin(math.radians(self.mesh_angle))


@dataclass(frozen=True)
class Tracks:
    """How curves become one track per wire."""

    chain_gap: float = tried(
        25.0, "m", "along, between tracks of one wire, more where these have few points"
    )
    chain_aside: float = tried(
        1.6, "tolerances", "aside and up, between tracks of one wire that follow each other"
    )
    chain_overlap: float = tried(
        0.7, "tolerances", "aside and up, between tracks of one wire that overlap"
    )
    chain_rise: float = built(0.06, "m / m", "up along the gap between tracks of one wire")
    end_points: int = tried(12, "points", "at the end of a track, that tell where it goes on")


@dataclass(frozen=True)
class Lanes:
    """How sparse wires are followed all at once."""

    sparse: float = tried(
        1.0, "points / m", "of a track, from which each wire is followed by itself"
    )
    straight_gap: float = built(
        15.0, "m", "along a track that is straight: between two points, and at its end"
    )
    same: float = tried(0.4, "m", "aside and up, within which two tracks are of one lane")
    wander: float = tried(
        0.15, "m", "by which offsets of wires wander; half the half width of a lane"
    )
    tie: float = surveyed(
        0.05, "m", "a point is of more than one lane where these lie above each other"
    )
    ahead: float = built(200.0, "m", "before and behind an alignment that are looked at")
    offset_step: float = tried(10.0, "m", "of an alignment for which one offset is taken")
    rounds: int = tried(
        2, "rounds", "lanes that were not seen beside others may be, once these go on"
    )


@dataclass(frozen=True)
class Sparse:
    """Which wires of a few points are no accident."""

    company: int = surveyed(
        3, "points", "around one that stands alone; several wires of 20 points per 100 m leave less"
    )
    stack_company: int = surveyed(
        12, "points", "the same of wires above each other, four of 60 points per 100 m"
    )
    stack_tolerance: float = built(
        0.1, "m", "how far points may lie from wires above each other, a third of their distance"
    )
    ring: float = tried(
        3.0, "radii", "of a wire, within which points are around it: up to the next of a sheet"
    )
    neighbours: int = tried(256, "points", "that stand alone, among which wires from one are tried")
    reach: float = built(8.0, "m", "aside and up from a wire, to others that it is seen with")
    steps: int = tried(
        24, "steps", "of a wire; points in one count once, as those of a twig are side by side"
    )
    false_alarms: float = unlikely(
        0.01,
        "1",
        "expected by chance at most of what is told: wires of all tried, gaps of a wire's",
    )


@dataclass(frozen=True)
class Stacks:
    """Wires so close above each other that one followed would change over to the next."""

    closest: float = built(
        0.3, "m", "between two wires of a stack; nearer, they are not told apart"
    )
    pair: float = tried(
        0.5, "m", "along a stack between two points that tell how far wires are apart"
    )
    astray: float = tried(0.2, "1", "share of the points of a stack that are on none of its wires")


@dataclass(frozen=True)
class Arcs:
    """Where the wires of a line are held."""

    smooth: float = tried(
        0.48,
        "tolerances",
        "scatter of a wire that locates supports; of the smallest: of what surely is on a wire",
    )
    coarse_bins: int = tried(3, "bins", "put together to find the common curvature")
    curvature_spread: float = built(
        0.3, "1", "share of the curvature or sag by which wires and spans differ"
    )
    least_tried: float = built(1 / 3000, "1 / m", "least curvature that is tried")
    most_tried: float = built(1 / 100, "1 / m", "largest curvature that is tried")
    shortest_span: float = built(20.0, "m", "between two supports")
    least_scatter: float = surveyed(0.03, "m", "of a point about a curve, at least")
    wander_length: float = surveyed(
        25.0,
        "m",
        "along a wire over which it wanders from its arc, and all points of a strip err alike",
    )
    least_wander: float = surveyed(
        0.006, "m", "by which wires wander from their arcs, or points from wires, in clean surveys"
    )
    wander_margin: float = tried(
        1.1, "1", "times what was learned before, below which how far wires wander is learned"
    )
    cut_price: float = unlikely(10.0, "sigmas2", "gain of fit that a cut must bring")
    cut_price_per_wire: float = unlikely(6.0, "sigmas2", "the same, more for each wire")
    certain_arm: float = unlikely(15.0, "sigmas2", "evidence for an arm that is certain")
    most_paid: float = tried(1.4, "1", "share of its part of the price, paid by a wire among many")
    off_wires: float = tried(0.6, "tolerances", "off all wires, of a point of an arm")
    arm_half_width: float = built(
        0.3, "m", "of what holds wires or hangs from them; so far below them an arm may reach"
    )
    least_usual: float = unlikely(
        0.25, "points", "the number that is usual around an arm is not below"
    )
    arm_aside: float = built(
        1.0, "m", "aside of the wires that arms may reach, and of a wire to others of its column"
    )
    arm_above: float = built(1.2, "m", "above the wires that arms may reach")
    tree_below: float = tried(2.6, "m", "below the wires, from where trees are seen to come up")
    column_width: float = tried(0.1, "m", "across the line, of what hangs from one wire")
    ring_inner: float = tried(0.5, "m", "from an arm, where its surroundings begin")
    ring_outer: float = tried(6.0, "m", "from an arm, where what is usual around it ends")
    meeting_sd: float = tried(0.1, "m", "by which arcs may miss each other at a support")
    least_kink: float = built(
        0.03, "1", "share of the bend between two level spans, of a support that shows no arm"
    )
    kink_spread: float = built(
        0.4, "1", "standard deviation of the bends at supports, as shares of that"
    )
    least_arm_share: float = tried(
        0.75, "1", "share of the price of a cut, above which no arm is seen"
    )
    most_shift: float = tried(
        5.0,
        "m",
        "by which a cut may be moved to where arcs meet, or a support to where its body stands; so "
        "far from the ends of a rope insulators hang, not what it carries",
    )


@dataclass(frozen=True)
class Spans:
    """The conductors of a span."""

    found_points: int = unlikely(6, "points", "of a wire that is found beside another, at least")
    found_eighths: int = tried(4, "eighths", "of the span with any of them")
    found_share: float = tried(
        0.15, "1", "share of the points of the wire known best, that one beside it has"
    )
    group_radius: float = tried(
        1.2, "tolerances", "of points of one wire in the cross-section of a span"
    )
    short_share: float = tried(
        0.5, "1", "share of a span, below which a wire is not known by what was followed of it"
    )
    on_wire: float = unlikely(
        2.6, "sigmas", "of the scatter of a wire, within which points are on it"
    )
    on_wire_most: float = tried(
        1.8, "tolerances", "from a wire within which points are on it, at most"
    )
    square: float = built(
        0.7, "cosine", "below which a wire runs along the arms of its support rather than across"
    )
    section_blur: float = surveyed(0.07, "m", "of points in the cross-section of a bundle")
    subconductor_gap: float = built(0.2, "m", "between two subconductors of a bundle, at least")
    section_points: int = unlikely(
        40, "points", "of a bundle whose subconductors can be told apart"
    )
    section_valley: float = tried(0.6, "1", "share of the lower of two peaks: density between them")
    valley_sigmas: float = unlikely(1.5, "sigmas", "of what is missing there")
    section_peak: float = tried(0.25, "1", "share of the highest peak: a lower one that counts")


@dataclass(frozen=True)
class Continued:
    """Wires that the neighbouring spans imply."""

    same_wire: float = tried(
        0.35, "m", "between two wires at a support that are one, and around one that is expected"
    )
    points: int = unlikely(2, "points", "of a wire that is expected, at least")
    share: float = tried(
        0.05, "1", "share of the points that others of the span have, that it has at least"
    )
    loose_end: float = tried(0.05, "m", "standard deviation of the height of an end to be improved")
    lost_end: float = tried(
        0.5, "m", "standard deviation of the height of an end that is not known"
    )


@dataclass(frozen=True)
class Supports:
    """Where supports stand."""

    along: float = built(
        10.0, "m", "along the wires between what belongs to one support, or to one end of the data"
    )
    across: float = built(12.0, "m", "across the wires between what belongs to one support")
    alike_gaps: float = built(
        1.5, "1", "times the usual distance across between wires, that of wires of one support"
    )
    enough_body: float = tried(0.4, "1", "share of its height at which a support shows points")
    much_body_pole: float = tried(0.5, "1", "the same of a pole where nothing else tells of it")
    much_body_tower: float = tried(0.75, "1", "the same of a tower")
    lowest_arm: float = built(
        0.25, "1", "share of its height below which a support holds no wire, those of others on it"
    )
    tallest_pole: float = built(15.0, "m", "height below which a support is a pole")
    settled_slack: float = tried(
        1.0,
        "m",
        "along the wires that the body may be off where they are held; what is less sure is told",
    )
    least_bend: float = built(0.02, "m / m", "change of slope, or of heading, at a support")


@dataclass(frozen=True)
class Towers:
    """Points of towers, and insulators."""

    lattice_width: float = built(0.5, "m", "half width from which a body is a lattice")
    splay_lattice: float = built(0.12, "m / m", "by which a lattice widens downwards")
    splay_pole: float = built(0.02, "m / m", "by which a pole widens downwards")
    slack_lattice: float = surveyed(0.4, "m", "around the body of a lattice")
    slack_pole: float = surveyed(0.15, "m", "around the body of a pole")
    hidden_pole_width: float = built(0.2, "m", "half width of a pole of which little is seen")
    foot_height: float = tried(
        3.0, "m", "below which shrubs may grow inside a lattice, and no support holds a wire"
    )
    jumper_deepest: float = built(4.0, "m", "below its wire, where a jumper ends")
    jumper_width: float = built(
        1.3, "1", "times the part of a jumper that is clear of its wire, by its parabola"
    )
    arm_depth: float = built(
        0.04, "1", "share of the height of a tower: half depth of an arm, and twice the half height"
    )
    known_by_points: int = unlikely(
        4,
        "points",
        "by which a jumper, arms, a neck or a waist are known",
    )
    string_reach: float = built(
        0.15, "1", "share of the height: how far from the tower strings end"
    )
    arms_room: float = built(
        0.1, "1", "share of the height: half depth of the arms, reach beyond and below the wires"
    )
    arms_peak: float = built(0.4, "1", "share of the height: reach of strings and peaks above them")


@dataclass(frozen=True)
class Lines:
    """Which wires make a line."""

    tolerances: tuple[float, float] = surveyed(
        (0.25, 0.625),
        "m",
        "from wires within which are their points: of clean single ones, of bundles and noisy ones",
    )
    between: float = tried(
        0.35,
        "m",
        "the same of thin wires in pairs, at which spans on poles are looked at once more",
    )
    own_radius: float = tried(2.0, "tolerances", "around a wire that are its own")
    fewest_carriers: int = unlikely(3, "bodies", "below the wires of a ropeway")
    carriers_per_wire: float = built(0.5, "bodies", "below each wire of a ropeway")


@dataclass(frozen=True)
class Errors:
    """What is not known of a wire."""

    common_length: float = surveyed(
        200.0, "m", "beyond which points of a strip do not err alike at all; flights wander slowly"
    )
    fewest_points: int = unlikely(
        3, "points", "on a piece of a wire, of which the mean is compared"
    )
    fewest_pieces: float = unlikely(
        2.0, "pieces", "by which the variance of the errors is known at least"
    )
    neighbours: int = tried(2, "spans", "to each side that tell how many conductors a span has")
    typical: float = tried(
        0.25, "1", "share of a wire, that on which its points are closest, that tells their spacing"
    )
    least_seen: float = tried(
        0.75, "1", "share of a conductor with points, below which it is told: the rest is guessed"
    )
    least_dense: float = tried(
        20.0, "points per 100 m", "of the wires found, below which others were not found"
    )


@dataclass
class Settings:
    """All numbers, by the steps that need them."""

    points: Points = Points()
    trace: Trace = Trace()
    fit: Fit = Fit()
    curves: Curves = Curves()
    roofs: Roofs = Roofs()
    network: Network = Network()
    structures: Structures = Structures()
    tracks: Tracks = Tracks()
    lanes: Lanes = Lanes()
    sparse: Sparse = Sparse()
    stacks: Stacks = Stacks()
    arcs: Arcs = Arcs()
    spans: Spans = Spans()
    continued: Continued = Continued()
    supports: Supports = Supports()
    towers: Towers = Towers()
    lines: Lines = Lines()
    errors: Errors = Errors()


SETTINGS = Settings()


def names() -> list[str]:
    """All numbers, as `group.number`."""
    groups = [(group.name, getattr(SETTINGS, group.name)) for group in fields(SETTINGS)]
    return [f"{name}.{one.name}" for name, group in groups for one in fields(group)]


@contextmanager
def changed(name: str, value: Any) -> Iterator[None]:
    """Another value of a number, `group.number`, for a while: for measurements and tests alone."""
    group, one = name.split(".")
    before = getattr(SETTINGS, group)
    setattr(SETTINGS, group, replace(before, **{one: value}))
    try:
        yield
    finally:
        setattr(SETTINGS, group, before)
