"""Parameters that several tools of planes declare: each has one help, one default and one unit.

As algorithms/shared/parameters.py, for this theme.
"""

from __future__ import annotations

from typing import Any

from toolbox.declare import param


def max_angle() -> Any:
    """Declare how far normals may be from that of their plane: ``float``."""
    return param(
        "Largest angle between a plane and the normals of its points",
        default=20.0,
        unit="deg",
        gt=0,
        le=90,
        label="Largest angle",
    )


def min_points() -> Any:
    """Declare how few points a plane may have: ``int``."""
    return param("Fewest points of a plane", default=100, unit="1", ge=3, label="Fewest points")


def min_extent() -> Any:
    """Declare how narrow a plane may be: ``float``."""
    return param(
        "Shortest side of the rectangle around a plane",
        default=0.1,
        unit="m",
        ge=0,
        label="Shortest side",
    )


def plane_gap() -> Any:
    """Declare how wide the gaps of a plane may be: ``float | Literal["auto"]``."""
    return param(
        "Widest gap within a plane; auto by the points",
        default="auto",
        unit="m",
        gt=0,
        label="Widest gap in a plane",
    )


def orientation() -> Any:
    """Declare which planes are looked for: ``Orientation``."""
    return param("Planes to look for", default="any", label="Planes to look for")


def orientation_angle() -> Any:
    """Declare how far from upright or level planes may be: ``float``."""
    return param(
        "How far from upright or level a plane may be to be called so",
        default=10.0,
        unit="deg",
        gt=0,
        lt=45,
        label="Tolerance of the orientation",
    )


def front_depth() -> Any:
    """Declare how deep a front is: ``float``."""
    return param(
        "How far the planes of a front stand before or behind the largest",
        default=1.5,
        unit="m",
        gt=0,
        label="Depth of a front",
    )
