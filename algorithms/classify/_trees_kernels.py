"""Compiled loop of :mod:`algorithms.classify.trees`: hills, joined where dips are low."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import kernel
from algorithms.shared.sets import root


@kernel
def hills(heights, order, cols, prominence, parent):
    """Set `parent` of each cell to the top of its hill.

    Cells come from the highest to the lowest, as water falls that uncovers them. One without a
    neighbour above the water is a top; where two hills meet, the lower one joins the higher one
    unless its top is at least `prominence` above the place. `heights` and `parent` are rasters row
    by row, with an empty border; `parent` is -1, and stays so in cells that are not in `order`.
    """
    around = np.array([-cols - 1, -cols, -cols + 1, -1, 1, cols - 1, cols, cols + 1])
    for cell in order:
        highest = -1
        for step in around:
            if parent[cell + step] >= 0:
                top = root(parent, cell + step)
                if highest < 0 or heights[top] > heights[highest]:
                    highest = top
        if highest < 0:
            parent[cell] = cell
            continue
        parent[cell] = highest
        for step in around:
            if parent[cell + step] >= 0:
                top = root(parent, cell + step)
                if top != highest and heights[top] - heights[cell] < prominence:
                    parent[top] = highest
    for cell in order:
        parent[cell] = root(parent, cell)
