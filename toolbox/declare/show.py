"""How an output is shown in a plot: the words of ``sink("...", show=...)``.

Without any, a raster is shown by what its bands say of themselves, points by their classes, their
elevation or their intensity, features in one colour, and a table not at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

from toolbox.data import PointCloud, Table, Vector
from toolbox.data.asprs import COLOURS

Look: TypeAlias = tuple[str, str]
"""Name in the key, and colour such as "#d7261e"."""
_DARKER = 0.7  # of the brightness of points, that of lines upon them


@dataclass(frozen=True)
class _ByAttribute:
    """What is shown by one attribute, which holds numbers."""

    attribute: str

    @property
    def columns(self) -> tuple[str, ...]:
        """Names that the layer must have."""
        return (self.attribute,)

    @property
    def numbers(self) -> tuple[str, ...]:
        """Those of them that hold numbers."""
        return self.columns


@dataclass(frozen=True)
class Classes(_ByAttribute):
    """Points or features in the colours of a few codes or words.

    Attributes
    ----------
    attribute : that holds the codes of points, or the words of features
    looks : name and colour of each; those that are not named get colours in turn
    front_of : attribute with the number of the plane of each point, 0 for none: where the largest
        plane is upright, the points are seen from its front
    optional : nothing is said where the attribute is missing
    apart : features are in coordinates of their own, as a drawing of a wall is, and never lie on
        a map of other layers
    """

    layers: ClassVar[tuple[Any, ...]] = (PointCloud, Vector)

    looks: Mapping[Any, Look] = field(default_factory=dict)
    front_of: str = ""
    optional: bool = False
    apart: bool = False

    @property
    def numbers(self) -> tuple[str, ...]:
        """Those of them that hold numbers."""
        return ()


@dataclass(frozen=True)
class Planes(_ByAttribute):
    """Points in a colour for each plane, walls from the front.

    Attributes
    ----------
    attribute : number of the plane of each point, 0 for none
    optional : nothing is said where it is missing
    """

    layers: ClassVar[tuple[Any, ...]] = (PointCloud,)

    optional: bool = False


@dataclass(frozen=True)
class Values(_ByAttribute):
    """Points or features in the colours of a number.

    Attributes
    ----------
    attribute : that holds it, or a pattern such as ``error_*``, of which the first is shown
    label : of the key; the name of the attribute unless given
    note : what else the key says
    length : it is in the unit of the heights, which the key states
    centred : blue below zero and red above
    """

    layers: ClassVar[tuple[Any, ...]] = (PointCloud, Vector)
    optional: ClassVar[bool] = False

    label: str = ""
    note: str = ""
    length: bool = False
    centred: bool = False


@dataclass(frozen=True)
class OfClass:
    """Features that are all of one kind of thing, in the colour of the points of its class.

    So trees are not taken for houses, in a plot, on the map of a report or in QGIS.

    Attributes
    ----------
    code : of the class, as LAS files number them
    thin : lines are thin, beside what else is of that class
    number : attribute with the number by which tables name each feature, written on maps of reports

    Examples
    --------
    >>> COLOURS[9], OfClass(9).colour
    ('#4a90d0', '#346592')
    """

    layers: ClassVar[tuple[Any, ...]] = (Vector,)
    optional: ClassVar[bool] = False
    numbers: ClassVar[tuple[str, ...]] = ()

    code: int
    thin: bool = False
    number: str = ""

    def __post_init__(self) -> None:
        if self.code not in COLOURS:
            raise TypeError(f"no class of points has the code {self.code}")

    @property
    def columns(self) -> tuple[str, ...]:
        """Names that the layer must have."""
        return (self.number,) if self.number else ()

    @property
    def colour(self) -> str:
        """The colour of the class, darker, so that lines are seen upon its points too."""
        parts = (int(COLOURS[self.code][at : at + 2], 16) for at in (1, 3, 5))
        return "#" + "".join(f"{round(part * _DARKER):02x}" for part in parts)


def colour_of(shows: Sequence[Show], other: str) -> str:
    """The one colour that the features of a layer are declared to have; another one if none is."""
    return next((show.colour for show in shows if isinstance(show, OfClass | Isolines)), other)


def is_thin(shows: Sequence[Show]) -> bool:
    """Whether the features of a layer are declared to be thin lines."""
    return any(isinstance(s, Isolines) or (isinstance(s, OfClass) and s.thin) for s in shows)


def number_of(shows: Sequence[Show]) -> str:
    """The attribute with the number of each feature that maps tell; "" if none is declared."""
    return next((show.number for show in shows if isinstance(show, OfClass)), "")


@dataclass(frozen=True)
class Isolines:
    """Lines of one number each, such as contours; heavy ones are index lines.

    Attributes
    ----------
    attribute : number of the line
    heavy : attribute that is true for index lines
    """

    layers: ClassVar[tuple[Any, ...]] = (Vector,)
    optional: ClassVar[bool] = False
    colour: ClassVar[str] = "#7a4a1e"  # brown, as on topographic maps

    attribute: str
    heavy: str

    @property
    def columns(self) -> tuple[str, ...]:
        """Names that the layer must have."""
        return self.attribute, self.heavy

    @property
    def numbers(self) -> tuple[str, ...]:
        """Those of them that hold numbers."""
        return (self.attribute,)


@dataclass(frozen=True)
class Texts:
    """Points where texts are written.

    Attributes
    ----------
    text : what is written
    angle : degrees, counterclockwise from the direction of x, at which it is read
    """

    layers: ClassVar[tuple[Any, ...]] = (Vector,)
    optional: ClassVar[bool] = False

    text: str
    angle: str

    @property
    def columns(self) -> tuple[str, ...]:
        """Names that the layer must have."""
        return self.text, self.angle

    @property
    def numbers(self) -> tuple[str, ...]:
        """Those of them that hold numbers."""
        return (self.angle,)


@dataclass(frozen=True)
class Profile:
    """Values over the way along lines, beside the map of points on these.

    Attributes
    ----------
    line : number of the line of each point
    along : how far along it the point is
    across : the value, a length too
    note : what the sign of the value means
    """

    layers: ClassVar[tuple[Any, ...]] = (Vector,)
    optional: ClassVar[bool] = False

    line: str
    along: str
    across: str
    note: str = ""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names that the layer must have."""
        return self.line, self.along, self.across

    @property
    def numbers(self) -> tuple[str, ...]:
        """Those of them that hold numbers."""
        return self.along, self.across


@dataclass(frozen=True)
class Histogram:
    """A table of bins as bars; the first and the last row count what lies beyond the edges.

    Attributes
    ----------
    low, high, count : columns of the edges and of the number in each bin
    unit_in : column that states the unit of the edges
    """

    layers: ClassVar[tuple[Any, ...]] = (Table,)
    optional: ClassVar[bool] = False

    low: str
    high: str
    count: str
    unit_in: str = ""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names that the table must have."""
        return tuple(filter(None, (self.low, self.high, self.count, self.unit_in)))

    @property
    def numbers(self) -> tuple[str, ...]:
        """Those of them that hold numbers."""
        return self.low, self.high, self.count


@dataclass(frozen=True)
class Matrix:
    """A table of counts as a square: a row for each class, a column for each class that is given.

    Attributes
    ----------
    rows : column with the names of the rows
    beside : columns that are no part of the square
    """

    layers: ClassVar[tuple[Any, ...]] = (Table,)
    optional: ClassVar[bool] = False

    rows: str
    beside: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names that the table must have."""
        return self.rows, *self.beside

    @property
    def numbers(self) -> tuple[str, ...]:
        """Those of them that hold numbers."""
        return self.beside


@dataclass(frozen=True)
class Axis:
    """A column of a table as an axis of a chart.

    Attributes
    ----------
    column : that holds the numbers
    label : what they are
    unit : of the numbers as shown; of large ones the axis gives thousands or millions
    unit_in : column that states the unit instead
    factor : that makes numbers in this unit of those in the table
    from_zero : whether the axis begins at zero
    limits : columns of the least and greatest value, drawn as a band if the table has them
    """

    column: str
    label: str
    unit: str = ""
    unit_in: str = ""
    factor: float = 1.0
    from_zero: bool = True
    limits: tuple[str, str] | None = None


@dataclass(frozen=True)
class Curve:
    """One or two columns of a table as lines over a third one.

    Attributes
    ----------
    over : the column whose numbers rise from row to row
    lines : one or two others, each with an axis of its own
    upright : `over` goes upwards, as levels do, instead of to the right
    dots : a dot on each row
    dashed : column that is true in the row where a dashed line is drawn
    shaded : column that is true from the row on from which the ground is grey
    shaded_as : what that stands for; the name of the column if it is not said
    """

    layers: ClassVar[tuple[Any, ...]] = (Table,)
    optional: ClassVar[bool] = False

    over: Axis
    lines: tuple[Axis, ...]
    upright: bool = False
    dots: bool = False
    dashed: str = ""
    shaded: str = ""
    shaded_as: str = ""

    def __post_init__(self) -> None:
        if not all(isinstance(axis, Axis) for axis in (self.over, *self.lines)):
            raise TypeError("the columns of a curve are given as Axis(column, label)")
        if not 1 <= len(self.lines) <= 2:
            raise TypeError(f"a curve has one line or two, not {len(self.lines)}")

    @property
    def columns(self) -> tuple[str, ...]:
        """Names that the table must have."""
        axes = (self.over, *self.lines)
        names = (name for axis in axes for name in (axis.column, axis.unit_in))
        return tuple(filter(None, (*names, self.dashed, self.shaded)))

    @property
    def numbers(self) -> tuple[str, ...]:
        """Those of them that hold numbers."""
        return tuple(axis.column for axis in (self.over, *self.lines))


Show: TypeAlias = (
    Classes | Planes | Values | OfClass | Isolines | Texts | Profile | Histogram | Matrix | Curve
)
