"""Many points of one layer in a DXF drawing, which are one object in memory.

One object of ezdxf for each point takes 60 µs to make and to write; a section has 100,000.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from ezdxf.entities.point import Point
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ezdxf.layouts.layout import Modelspace
    from ezdxf.lldxf.tagwriter import AbstractTagWriter

_POINT = (  # group codes and values of an entity, its handle, owner, layer and place left open
    "  0\nPOINT\n  5\n{:X}\n330\n{}\n100\nAcDbEntity\n  8\n{}\n100\nAcDbPoint\n"
    " 10\n{}\n 20\n{}\n 30\n0.0\n"
)


class _Points(Point):
    """The first of them stands for all: they have the numbers (handles) from its own on."""

    xy: NDArray[np.float64]

    def export_dxf(self, tagwriter: AbstractTagWriter) -> None:
        """Write all as ezdxf writes each."""
        first, owner, layer = int(self.dxf.handle, 16), self.dxf.owner, self.dxf.layer
        for number, (x, y) in enumerate(self.xy.tolist(), start=first):
            tagwriter.write_str(_POINT.format(number, owner, layer, x, y))


def add_points(space: Modelspace, xy: NDArray[np.float64], layer: str) -> None:
    """Add points of shape (n, 2), at least one, to a drawing of AutoCAD 2000 or later."""
    made = _Points.new(dxfattribs={"layer": layer})
    made.xy = xy
    space.add_entity(made)  # takes the next number
    for _ in xy[1:]:
        space.doc.entitydb.handles.next()
