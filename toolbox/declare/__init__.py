"""What the author of a tool imports: the declaration of a tool, and the types of parameters."""

from toolbox.declare import show
from toolbox.declare.expression import Expression
from toolbox.declare.spec import outputs, param, sink, source, tool
from toolbox.declare.values import (
    Attribute,
    ClassList,
    DataFile,
    Direction,
    Extent,
    Memory,
    Position,
    Range,
    Share,
)

__all__ = [
    "Attribute",
    "ClassList",
    "DataFile",
    "Direction",
    "Expression",
    "Extent",
    "Memory",
    "Position",
    "Range",
    "Share",
    "outputs",
    "param",
    "show",
    "sink",
    "source",
    "tool",
]
