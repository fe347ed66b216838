"""Spans of catenaries from points that may be wire: the steps that extraction and fitting share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.arcs import arcs_of
from algorithms.corridor._curves.lanes import followed_together
from algorithms.corridor._curves.network import Corridor, curves_of, wires_among
from algorithms.corridor._curves.trace import trace_all
from algorithms.corridor._curves.tracks import alignments_among
from algorithms.corridor._extraction.continued import completed
from algorithms.corridor._extraction.spans import Wire, spans_of, with_supports
from algorithms.corridor._extraction.supports import Support, supports_of
from toolbox.context import Context


def follow(
    corridor: Corridor, voxel: NDArray[np.int64], max_gap: float, ctx: Context
) -> tuple[list[Wire], Sequence[Support]]:
    """The conductors of all spans, and the supports between them.

    Parameters
    ----------
    corridor : points, and those of them that may be wire
    voxel : of each of these; one of a voxel may be the beginning of a wire
    max_gap : longest piece of a wire that may be missing, metres
    """
    curves = trace_all(
        corridor.wires,
        voxel,
        tolerance=corridor.tolerance,
        max_gap=max_gap,
        ctx=ctx.part(0.0, 0.7),
    )
    here = ctx.part(0.7, 0.7)
    found = alignments_among(corridor, curves_of(corridor, curves))
    arcs, alignments = arcs_of(
        corridor, [followed_together(corridor, alignment, max_gap, here) for alignment in found]
    )
    pieces = wires_among(corridor, arcs)
    ctx.progress(0.8)
    if not pieces:
        return [], []
    supports = supports_of(corridor, pieces, alignments)
    wires = completed(corridor, spans_of(corridor, pieces, supports), supports)
    return with_supports(wires, supports)
