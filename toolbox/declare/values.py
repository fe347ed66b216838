"""Values that a parameter may hold beside numbers and words, each with its text form."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

CLASSES = re.compile(r"([0-9]{1,9})(?:-([0-9]{1,9}))?")
HIGHEST_CLASS = 255  # ASPRS LAS 1.4: one byte


class ClassList(tuple[int, ...]):
    """ASPRS classes, sorted and without repeats; as text ``2,9,14-16``."""

    __slots__ = ()

    def __new__(cls, classes: Iterable[int]) -> Self:
        """Take classes in any order.

        Raises
        ------
        ValueError
            There is none, or one is not between 0 and 255.
        """
        found = sorted(set(classes))
        if not found:
            raise ValueError("needs at least one class")
        if found[0] < 0 or found[-1] > HIGHEST_CLASS:
            raise ValueError(f"classes lie between 0 and {HIGHEST_CLASS}")
        return super().__new__(cls, found)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read single classes and ranges: ``2,9,14-16``."""
        classes: list[int] = []
        for part in text.split(","):
            found = CLASSES.fullmatch(part.strip())
            if not found:
                raise ValueError(f"{part.strip()!r} is no class or range of classes")
            first, last = int(found[1]), int(found[2] or found[1])
            if first > last or last > HIGHEST_CLASS:
                raise ValueError(f"{part.strip()!r} is not a range within 0 and {HIGHEST_CLASS}")
            classes += range(first, last + 1)
        return cls(classes)

    def __str__(self) -> str:
        """Write neighbouring classes as a range, so that parse(str(x)) == x."""
        starts = [c for c in self if c - 1 not in self]
        ends = [c for c in self if c + 1 not in self]
        return ",".join(f"{a}" if a == b else f"{a}-{b}" for a, b in zip(starts, ends, strict=True))


class Range(NamedTuple):
    """A lower and an upper limit, both included; as text ``0,0.2``."""

    low: float
    high: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read two numbers, the lower first."""
        return cls.of(_numbers(text, 2))

    @classmethod
    def of(cls, numbers: Iterable[float]) -> Self:
        """Take two numbers.

        Raises
        ------
        ValueError
            They are not two finite numbers in rising order.
        """
        low, high = _finite(numbers, 2)
        if low > high:
            raise ValueError(f"the lower limit {low:g} is above the upper limit {high:g}")
        return cls(low, high)

    def __str__(self) -> str:
        return f"{self.low:g},{self.high:g}"


class Extent(NamedTuple):
    """A rectangle in the coordinates of the data; as text ``xmin,ymin,xmax,ymax``."""

    xmin: float
    ymin: float
    xmax: float
    ymax: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read four numbers in the order of OGC bounding boxes."""
        return cls.of(_numbers(text, 4))

    @classmethod
    def of(cls, numbers: Iterable[float]) -> Self:
        """Take four numbers.

        Raises
        ------
        ValueError
            They are not four finite numbers, or the rectangle is empty.
        """
        box = cls(*_finite(numbers, 4))
        if box.xmin >= box.xmax or box.ymin >= box.ymax:
            raise ValueError("xmin must be below xmax, and ymin below ymax")
        return box

    def __str__(self) -> str:
        return ",".join(f"{number!r}" for number in self)


class Position(NamedTuple):
    """A place in the coordinates of the data; as text ``x,y``."""

    x: float
    y: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read two numbers, easting first."""
        return cls.of(_numbers(text, 2))

    @classmethod
    def of(cls, numbers: Iterable[float]) -> Self:
        """Take two numbers.

        Raises
        ------
        ValueError
            They are not two finite numbers.
        """
        return cls(*_finite(numbers, 2))

    def __str__(self) -> str:
        return f"{self.x!r},{self.y!r}"


class Direction(NamedTuple):
    """A direction in space, of any length; as text ``0,0,1``, which is upwards."""

    x: float
    y: float
    z: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read three numbers: eastwards, northwards, upwards."""
        return cls.of(_numbers(text, 3))

    @classmethod
    def of(cls, numbers: Iterable[float]) -> Self:
        """Take three numbers.

        Raises
        ------
        ValueError
            They are not three finite numbers, or all of them are 0.
        """
        made = cls(*_finite(numbers, 3))
        if not any(made):
            raise ValueError("a direction has a length, and 0,0,0 has none")
        return made

    def __str__(self) -> str:
        return ",".join(f"{number!r}" for number in self)


class Attribute(str):
    """The name of an attribute of a point cloud, such as ``intensity``."""

    __slots__ = ()


def _numbers(text: str, count: int) -> list[float]:
    return [float(part) for part in re.split(r"[,;\s]+", text.strip(" []()"), maxsplit=count)]


def _finite(numbers: Iterable[float], count: int) -> list[float]:
    found = [float(number) for number in numbers]
    if len(found) != count:
        raise ValueError(f"needs {count} numbers, got {len(found)}")
    if not all(abs(number) < float("inf") for number in found):  # false for NaN as well
        raise ValueError("numbers must be finite")
    return found


class Share(float):
    """Part of a number of things, from 0 to 1, which shares of other things can be added to.

    >>> Share(1, 4) + Share(1, 1)
    Share(2, 5)
    """

    part: int
    of: int

    def __new__(cls, part: int, of: int) -> Share:
        made = super().__new__(cls, part / of if of else 0.0)
        made.part, made.of = int(part), int(of)
        return made

    @classmethod
    def of_points(cls, which: NDArray[np.bool_], core: NDArray[np.bool_]) -> Share:
        """The share of points in a mask, of those alone that are no neighbours of a tile."""
        return cls(int(np.count_nonzero(which & core)), int(np.count_nonzero(core)))

    def __getnewargs__(self) -> tuple[int, int]:  # type: ignore[override]
        """For pickle."""
        return self.part, self.of

    def __add__(self, other: float) -> Share | float:
        if isinstance(other, Share):
            return Share(self.part + other.part, self.of + other.of)
        return float(self) + other

    def __repr__(self) -> str:
        return f"Share({self.part}, {self.of})"
