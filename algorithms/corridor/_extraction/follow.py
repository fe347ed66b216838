"""From points that may be wire to spans of catenaries: what extraction and fitting share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves.arcs import arcs_of
from algorithms.corridor._curves.lanes import followed_together
from algorithms.corridor._curves.network import Scene, curves_of, wires_among
from algorithms.corridor._curves.trace import trace_all
from algorithms.corridor._curves.tracks import runs_among
from algorithms.corridor._extraction.continued import completed
from algorithms.corridor._extraction.spans import Wire, spans_of, with_supports
from algorithms.corridor._extraction.supports import Support, supports_of
from toolbox.context import Context


def follow(
    scene: Scene, voxel: NDArray[np.int64], max_gap: float, ctx: Context
) -> tuple[list[Wire], Sequence[Support]]:
    """The conductors of all spans, and the supports between them.

    Parameters
    ----------
    scene : points, and those of them that may be wire
    voxel : of each of these; one of a voxel may be the beginning of a wire
    max_gap : longest piece of a wire that may be missing, metres
    """
    curves = trace_all(
        scene.wires, voxel, tolerance=scene.tolerance, max_gap=max_gap,
        ctx=ctx.part(0.0, 0.7),
    )  # fmt: skip
    here = ctx.part(0.7, 0.7)
    found = runs_among(scene, curves_of(scene, curves))
    arcs, runs = arcs_of(scene, [followed_together(scene, run, max_gap, here) for run in found])
    pieces = wires_among(scene, arcs)
    ctx.progress(0.8)
    if not pieces:
        return [], []
    supports = supports_of(scene, pieces, runs)
    wires = completed(scene, spans_of(scene, pieces, supports), supports)
    return with_supports(wires, supports)
