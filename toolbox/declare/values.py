"""Types of parameters beside numbers and words; each reads and writes its text form."""

from __future__ import annotations

import math
import numbers
import re
from collections.abc import Iterable
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from toolbox.data.asprs import CLASSES as CLASSES_OF_LAS

CLASSES = re.compile(r"([0-9]{1,9})(?:-([0-9]{1,9}))?")
BYTES = (bytes, bytearray, memoryview)
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
    def parse(cls, value: str | int | Iterable[int] | NDArray[Any]) -> Self:
        """Read classes and ranges of classes from a text, or classes from a number or a list.

        >>> ClassList.parse("2,9,14-16") == ClassList.parse([9, 2, 14, 15, 16])
        True

        Raises
        ------
        ValueError
            There is none, or one is not a whole number between 0 and 255.
        """
        if isinstance(value, np.ndarray):
            value = value.ravel().tolist()  # also of an array of one number without a shape
        if not isinstance(value, str):
            return cls(map(whole, _items(value)))
        classes: list[int] = []
        for item in map(str.strip, value.split(",")):
            found = CLASSES.fullmatch(item)
            if not found:
                raise ValueError(f"{item!r} is no class or range of classes{_class_called(item)}")
            first, last = int(found[1]), int(found[2] or found[1])
            if first > last or last > HIGHEST_CLASS:
                raise ValueError(f"{item!r} is not a range within 0 and {HIGHEST_CLASS}")
            classes += range(first, last + 1)
        return cls(classes)

    def __str__(self) -> str:
        """Write neighbouring classes as a range, so that parse(str(x)) == x."""
        starts = [c for c in self if c - 1 not in self]
        ends = [c for c in self if c + 1 not in self]
        return ",".join(f"{a}" if a == b else f"{a}-{b}" for a, b in zip(starts, ends, strict=True))


def _class_called(name: str) -> str:
    """Say '; did you mean ...?' with the number of the class that is called so, or nothing."""
    found = [code for code, known in CLASSES_OF_LAS.items() if known.lower() == name.lower()]
    return f"; did you mean {found[0]}?" if found else ""


class Range(NamedTuple):
    """A lower and an upper limit, both included; as text ``0,0.2``.

    Examples
    --------
    >>> Range.parse("0,0.2")
    Range(low=0.0, high=0.2)
    """

    low: float
    high: float

    @classmethod
    def parse(cls, value: str | Iterable[float]) -> Self:
        """Read two numbers, the lower first, from a text or a list.

        Raises
        ------
        ValueError
            They are not two finite numbers in rising order.
        """
        low, high = _numbers(value, 2)
        if low > high:
            raise ValueError(f"the lower limit {low:g} is above the upper limit {high:g}")
        return cls(low, high)

    def __str__(self) -> str:
        return f"{self.low:g},{self.high:g}"


class Extent(NamedTuple):
    """A rectangle in the coordinates of the data; as text ``xmin,ymin,xmax,ymax``.

    Examples
    --------
    >>> Extent.parse("0,0,10,5").xmax
    10.0
    """

    xmin: float
    ymin: float
    xmax: float
    ymax: float

    @classmethod
    def parse(cls, value: str | Iterable[float]) -> Self:
        """Read four numbers, as in an OGC bounding box, from a text or a list.

        Raises
        ------
        ValueError
            They are not four finite numbers, or the rectangle is empty.
        """
        box = cls(*_numbers(value, 4))
        if box.xmin >= box.xmax or box.ymin >= box.ymax:
            raise ValueError("xmin must be below xmax, and ymin below ymax")
        return box

    def __str__(self) -> str:
        return ",".join(f"{number!r}" for number in self)


class Position(NamedTuple):
    """A position in the coordinates of the data; as text ``x,y``.

    Examples
    --------
    >>> Position.parse([500_000, 4_600_000])
    Position(x=500000.0, y=4600000.0)
    """

    x: float
    y: float

    @classmethod
    def parse(cls, value: str | Iterable[float]) -> Self:
        """Read two numbers, easting first, from a text or a list.

        Raises
        ------
        ValueError
            They are not two finite numbers.
        """
        return cls(*_numbers(value, 2))

    def __str__(self) -> str:
        return f"{self.x!r},{self.y!r}"


class Direction(NamedTuple):
    """A direction in space, of any length; as text ``0,0,1``, which is upwards.

    Examples
    --------
    >>> str(Direction.parse("0 0 1"))
    '0.0,0.0,1.0'
    """

    x: float
    y: float
    z: float

    @classmethod
    def parse(cls, value: str | Iterable[float]) -> Self:
        """Read numbers to the east, to the north and upwards from a text or a list.

        Raises
        ------
        ValueError
            They are not three finite numbers, or all of them are 0.
        """
        made = cls(*_numbers(value, 3))
        if not any(made):
            raise ValueError("a direction has a length, and 0,0,0 has none")
        return made

    def __str__(self) -> str:
        return ",".join(f"{number!r}" for number in self)


class Attribute(str):
    """The name of an attribute of a point cloud, such as ``intensity``.

    Examples
    --------
    >>> Attribute("intensity")
    'intensity'
    """

    __slots__ = ()


class DataFile(str):
    """The path of a file that a tool reads itself, such as a grid; records hold its hash.

    Examples
    --------
    >>> DataFile("geoid.tif")
    'geoid.tif'
    """

    __slots__ = ()


def whole(value: object) -> int:
    """Read a whole number from a text or from JSON, which does not tell 3 from 3.0.

    Raises
    ------
    ValueError
        It is none.
    """
    if isinstance(value, str | numbers.Integral) and not isinstance(value, bool):
        return int(value)
    if isinstance(value, float) and value.is_integer():
        return int(value)
    raise ValueError(f"{value!r} is no whole number")


def _items(value: Any) -> Iterable[Any]:
    """The items of a list; bytes have none, as these would be the codes of their letters."""
    return value if isinstance(value, Iterable) and not isinstance(value, BYTES) else [value]


def _numbers(value: str | Iterable[float], count: int) -> list[float]:
    """Read so many finite numbers from a text or a list."""
    if isinstance(value, str):
        items: Iterable[str | float] = re.split(r"[,;\s]+", value.strip(" []()"), maxsplit=count)
    else:
        items = _items(value)
    found = [float(item) for item in items]
    if len(found) != count:
        raise ValueError(f"needs {count} numbers, got {len(found)}")
    if not all(map(math.isfinite, found)):
        raise ValueError("numbers must be finite")
    return found


class Memory(NamedTuple):
    """What a tool needs of the memory beyond its libraries, by which tiles are made as large.

    Without a declaration it is what the hungriest tools need.

    Attributes
    ----------
    point : bytes for each point that is read
    area : bytes for each square metre, for cells
    """

    point: float = 400.0
    area: float = 200.0

    def per_area(self, density: float) -> float:
        """Bytes for each square metre with so many points on it.

        >>> Memory(point=100.0, area=50.0).per_area(8.0)
        850.0
        """
        return self.point * density + self.area

    @classmethod
    def most(cls, needs: Iterable[Memory]) -> Memory:
        """What is enough for each of some tools, one after the other."""
        found = list(needs)
        return cls(max(one.point for one in found), max(one.area for one in found))


class Share(float):
    """The ratio of a count to a total, from 0 to 1; shares of several totals can be added.

    >>> Share(1, 4) + Share(1, 1)
    0.4 (2 of 5)
    >>> print(Share(1, 4))
    0.25
    """

    count: int
    total: int

    def __new__(cls, count: int, total: int) -> Share:
        made = super().__new__(cls, count / total if total else 0.0)
        made.count, made.total = int(count), int(total)
        return made

    @classmethod
    def of_points(cls, which: NDArray[np.bool_], core: NDArray[np.bool_]) -> Share:
        """The share of the core points, which lie in the tile itself, that a mask holds."""
        return cls(int(np.count_nonzero(which & core)), int(np.count_nonzero(core)))

    def __getnewargs__(self) -> tuple[int, int]:  # type: ignore[override]
        """For pickle."""
        return self.count, self.total

    def __add__(self, other: float) -> Share | float:
        if isinstance(other, Share):
            return Share(self.count + other.count, self.total + other.total)
        return float(self) + other

    def __repr__(self) -> str:
        return f"{self} ({self.count} of {self.total})"

    def __str__(self) -> str:
        return str(float(self))
