"""What a clearance analysis works on: wires in several states, points around them, objects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._catenary import Catenary
from algorithms.corridor._sag import State

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Line:
    """Wires in all states, in metres from an origin.

    Attributes
    ----------
    origin : array of shape (3,), in the unit of the data
    states : of the wires
    curves : for each state those of the m wires
    wire, span, start, end : arrays of shape (m,), numbers of the conductor, span and towers
    """

    origin: Floats
    states: list[State]
    curves: list[list[Catenary]]
    wire: Ints
    span: Ints
    start: Ints
    end: Ints

    @property
    def spans(self) -> list[int]:
        """Numbers of the spans."""
        return [int(number) for number in np.unique(self.span)]


@dataclass(frozen=True)
class Scene:
    """The points around the line, in metres from its origin.

    Attributes
    ----------
    index : array of shape (n,), of the points in the cloud
    xyz : array of shape (n, 3)
    kind : array of shape (n,), index into KINDS, -1 for points that take no part
    height : array of shape (n,), above the ground
    left_out : how many points take no part, and why
    """

    index: Ints
    xyz: Floats
    kind: NDArray[np.int8]
    height: Floats
    left_out: dict[str, int]


@dataclass(frozen=True)
class Object:
    """Points that are one thing, and the one of them that breaks its rule worst, in metres."""

    points: Ints
    nearest: int
    kind: str
    rule: int
    wire: int
    state: int
    measure: float
    space: float
    vertical: float
    flat: float
    u: float
    sd: float
    probability: float
    height: float
