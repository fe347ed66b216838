"""Parameters and outputs that several tools declare: each has one help, one default and one unit.

Each is declared in the same way; its docstring says of which type it is.

Examples
--------
>>> from algorithms.shared import parameters
>>> ignore: ClassList | None = parameters.ignore()
"""

from __future__ import annotations

from typing import Any

from toolbox.declare import ClassList, param, sink

SURFACES = ClassList([9, 10, 11])
"""Classes of what lies on the ground: water, rail and road surface."""

STRUCTURES = ClassList([*range(13, 18), 19])
"""Classes of what stands on the ground or spans it: wires, towers, bridges, other structures."""

DUTCH_STRUCTURES = 26
"""Class of structures (kunstwerk) in the Dutch AHN, which the standard leaves open."""

NAMED_STRUCTURES = ClassList([*STRUCTURES, DUTCH_STRUCTURES])
"""The same where they are named: 26 is reserved, and a bridge, lock or quay in the Dutch AHN."""

WIRE_GAP = 60.0
"""Longest piece of a wire that may be missing, metres."""

MIN_HEIGHT = 4.0
"""Lowest conductor above the ground, metres."""


def ignore() -> Any:
    """Declare the classes of noise, which no tool looks at: ``ClassList | None``."""
    return param(
        "Classes that take no part and stay as they are; none if all take part",
        default=ClassList([7, 18]),
        label="Classes left out",
    )


def keep_classes() -> Any:
    """Declare the classes that a classifier leaves as they are: ``ClassList | None``."""
    return param(
        "Classes that stay: structures (13-17, 19, 26) and 9-11 among them always, "
        "others unless ground",
        default=ClassList([*SURFACES, *STRUCTURES]),
        label="Classes that stay",
    )


def ground_classes() -> Any:
    """Declare the classes that tell the height of the terrain: ``ClassList``."""
    return param(
        "Classes that are ground, with water, rail and road on it",
        default=ClassList([2, *SURFACES]),
    )


def classes() -> Any:
    """Declare the classes of the points that a tool reads: ``ClassList | None``."""
    return param("Classes to use; all by default", default=None, label="Classes used")


def returns() -> Any:
    """Declare the returns of the pulses that a tool reads: ``ReturnKind``."""
    return param(
        "Returns to use",
        default="all",
        label="Returns used",
        words={
            "all": "All returns",
            "first": "First returns",
            "last": "Last returns",
            "only": "Only returns",
            "intermediate": "Between first and last",
            "first_of_many": "First of several returns",
            "last_of_many": "Last of several returns",
        },
    )


def low_ends() -> Any:
    """Declare the height at which low vegetation ends: ``float``, metres."""
    return param(
        "Vegetation below this height is low",
        default=0.5,
        unit="m",
        ge=0,
        label="Low vegetation ends at",
    )


def high_begins() -> Any:
    """Declare the height from which vegetation is high: ``float``, metres."""
    return param(
        "Vegetation from this height on is high",
        default=1.5,
        unit="m",
        ge=0,
        label="High vegetation begins at",
    )


def ground_returns() -> Any:
    """Declare the returns among which a filter looks for ground: ``Returns``."""
    return param(
        "Returns that can be ground; points without return numbers always can",
        default="last",
        label="Returns used",
        words={"last": "Last returns", "all": "All returns"},
    )


def labelled_points() -> Any:
    """Declare the output of a ground filter: ``PointCloud``."""
    return sink("The same points, class 2 on ground and 1 elsewhere", label="Classified points")


def ground_points() -> Any:
    """Declare the ground that a filter finds: ``PointCloud``."""
    return sink(
        "Those of them that are ground, also if they keep their class", label="Ground points"
    )


def ground_share() -> Any:
    """Declare how much of the points is ground: ``float``, a share."""
    return sink("Share of points that are ground", unit="1")


def planarity() -> Any:
    """Declare how flat what is no vegetation is: ``float``, a share."""
    return param(
        "Least share of points on planes around what is no vegetation",
        default=0.1,
        unit="1",
        ge=0,
        le=1,
        label="Share of points on planes",
    )


def plane_radius() -> Any:
    """Declare the radius in which a classifier looks for planes: ``float``."""
    return param(
        "Radius in which a plane is looked for; raise it for sparse points",
        default=1.0,
        unit="m",
        gt=0,
        le=10,
    )


def context() -> Any:
    """Declare how far features are averaged: ``float``."""
    return param(
        "Radius within which planarity, roughness and returns are averaged",
        default=3.0,
        unit="m",
        ge=0,
        le=20,
    )


def radius_by_density() -> Any:
    """Declare the radius in which planes are looked for, if not left open: ``float | None``."""
    return param(
        "Radius in which a plane is looked for; without it, by the density: 1 m or more",
        default=None,
        unit="m",
        gt=0,
        le=10,
    )


def flat_by_noise() -> Any:
    """Declare how far points may be from a plane, if not left open: ``float | None``."""
    return param(
        "Standard deviation of points from their plane; without it, by their noise: 0.06 m or more",
        default=None,
        unit="m",
        gt=0,
        le=1,
        label="Flatness of planes",
    )


def context_by_density() -> Any:
    """Declare how far features are averaged, if not left open: ``float | None``."""
    return param(
        "Radius within which features are averaged; without it, by the density: 3 m or more",
        default=None,
        unit="m",
        ge=0,
        le=20,
    )


def cell(default: float = 1.0) -> Any:
    """Declare the size of the cells of a raster: ``float``."""
    return param("Size of the cells", default=default, unit="m", gt=0, le=10_000, label="Cell size")


def seed() -> Any:
    """Declare the seed of all that a tool draws: ``int``."""
    return param("Seed of the random numbers", default=0, unit="1", ge=0, label="Random seed")


def block() -> Any:
    """Declare the side of the blocks of ground for intervals: ``float | None``."""
    return param(
        "Side of the square blocks for intervals; without it, so that some 100 hold points",
        default=None,
        unit="m",
        gt=0,
        label="Side of blocks for intervals",
    )


def map() -> Any:
    """Declare which classes are one, and their names: ``tuple[str, ...] | None``."""
    return param("Classes that are one, with a name, such as 3,4,5=vegetation", default=None)


def reference_map() -> Any:
    """Declare which classes of the reference are one: ``tuple[str, ...] | None``."""
    return param("The same for the codes of the reference, if they differ", default=None)


def leave_out() -> Any:
    """Declare the classes of the reference that are no truth: ``ClassList | None``."""
    return param(
        "Classes of the reference that are left out, such as 0 for points without a label",
        default=None,
    )


def wire_gap() -> Any:
    """Declare how far wires are followed without points: ``float``."""
    return param(
        "Longest piece of a wire that may be missing",
        default=WIRE_GAP,
        unit="m",
        ge=0,
        le=500,
        label="Longest gap in a wire",
    )


def wire_tolerance() -> Any:
    """Declare how near to a wire its points are: ``float``."""
    return param(
        "Farthest that a point may lie from the wire followed; without it, found for each line",
        default=None,
        unit="m",
        ge=0.05,
        le=2,
        label="Tolerance of the wire",
    )


def wire_radius() -> Any:
    """Declare how near to a wire points without a class are of it: ``float``."""
    return param(
        "Points without a class that are nearer to a wire than this belong to it",
        default=0.5,
        unit="m",
        ge=0.0,
        le=5.0,
        label="Reach of a wire",
    )


def attachment() -> Any:
    """Declare how near to the end of a wire points are of the support: ``float``."""
    return param(
        "Points without a class nearer to the end of a wire than this belong to its support",
        default=5.0,
        unit="m",
        ge=0.0,
        le=20.0,
        label="Reach of a support",
    )


def target_crs() -> Any:
    """Declare the CRS that a layer is brought to: ``CRS``."""
    return param(
        "CRS to bring the data to, such as EPSG:32635, EPSG:2154+5720, EPSG:32635+ellipsoid"
    )


def geoid() -> Any:
    """Declare the geoid model of the user: ``DataFile | None``."""
    return param(
        "File of a geoid model (.tif or .gtx) between heights above ellipsoid and geoid",
        default=None,
    )


def epoch() -> Any:
    """Declare the time of coordinates: ``float | None``."""
    return param(
        "Year of the coordinates with decimals, for reference frames that move",
        default=None,
        unit="1",
        ge=1900,
        le=2200,
    )


def missing_grid() -> Any:
    """Declare what happens where PROJ lacks a grid: ``MissingGrid``."""
    return param(
        "Without a grid of the best operation: refuse, or take the next best", default="refuse"
    )
