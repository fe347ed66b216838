"""Compiled loop of :mod:`algorithms.classify.buildings`: which points lie on planes near them."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels import neighbours as tree
from algorithms.shared.kernels.compiling import kernel


@kernel
def on_planes(begin, end, places, xyz, normal, box, depth, reach, thick, found):
    """Set `found` for positions near a plane: within its `thick` of that of a point within `reach`.

    `xyz`, `box` and `depth` are those of a tree, whose points have planes with the `normal`.
    """
    n, limit = len(xyz), reach * reach
    held = np.empty(tree.DEEPEST, np.int64)
    for k in range(begin, end):
        x, y, z = places[k, 0], places[k, 1], places[k, 2]
        held[0], waiting = 1, 1
        while waiting > 0 and not found[k]:
            waiting -= 1
            here = held[waiting]
            if tree.away(box, here, x, y, z) > limit:
                continue
            if not here >> depth:
                held[waiting], held[waiting + 1] = 2 * here, 2 * here + 1
                waiting += 2
                continue
            leaf = here - (1 << depth)
            for i in range(tree.first(leaf, depth, n), tree.first(leaf + 1, depth, n)):
                dx, dy, dz = x - xyz[i, 0], y - xyz[i, 1], z - xyz[i, 2]
                off = dx * normal[i, 0] + dy * normal[i, 1] + dz * normal[i, 2]
                if dx * dx + dy * dy + dz * dz <= limit and abs(off) <= thick[k]:
                    found[k] = True
                    break
