"""Compiled loops of :mod:`algorithms.shared.sections`.

Heights are metres, and cells are one metre wide. Loops that cost little stay serial, which saves
their compilation.
"""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import helper, kernel
from algorithms.shared.sets import root

NEXT = 2  # cells: what lies so near is beside a cell, whether there is an empty one between or not
EMPTY = 8  # cells: where nothing lies as near, the data end; pulses at random leave no such gap


@kernel
def sections(z, rise, parent):
    """Set `parent` of each cell to the first one of its section, -1 where there is no data.

    Cells beside each other are of one section if their heights differ by at most `rise`.
    """
    rows, cols = z.shape
    for r in range(rows):
        for c in range(cols):
            cell = r * cols + c
            parent[cell] = -1
            if math.isnan(z[r, c]):
                continue
            parent[cell] = cell
            for up, left in ((1, 0), (0, 1)):
                for k in range(1, NEXT + 1):
                    i, j = r - k * up, c - k * left
                    if i < 0 or j < 0 or math.isnan(z[i, j]):
                        continue
                    if abs(z[i, j] - z[r, c]) <= rise:
                        one, other = root(parent, cell), root(parent, i * cols + j)
                        parent[max(one, other)] = min(one, other)
                    break
    for cell in range(rows * cols):
        if parent[cell] >= 0:
            parent[cell] = root(parent, cell)


@kernel
def borders(z, parent, number, raised, slope, least, sides, depth):
    """Count the sides of cells at the border of sections, by what lies beyond them.

    `sides`, of shape (sections, 8), are all of them; those with data beside them; those of these
    with a step down, of at least `least` beyond what `slope` explains; those below a section that
    is raised, by no more than the mean of these steps; and those at the end of the data, to the
    south, north, east and west. Beyond a gap within a section there is no border. `depth`, of shape
    (sections,), is the sum of the steps down.

    `number` is that of a section by its first cell, -1 for those that are not asked for; `raised`
    is told by the first cell, too.
    """
    rows, cols = z.shape
    ways = ((1, 0), (-1, 0), (0, 1), (0, -1))
    sides[:], depth[:] = 0, 0
    for turn in range(1 + raised.any()):  # what the second counts goes by the steps of the first
        for r in range(rows):
            for c in range(cols):
                own = parent[r * cols + c]
                k = number[own] if own >= 0 else -1
                if k < 0:
                    continue
                for way in range(4):
                    i, j = ways[way]
                    other, away = next_section(parent, rows, cols, r, c, i, j)
                    if other == own:
                        continue
                    if turn == 1:
                        if away <= NEXT and raised[other]:
                            rise = z[r + away * i, c + away * j] - z[r, c]
                            sides[k, 3] += 0 < rise * sides[k, 2] <= depth[k]
                        continue
                    drop = step_down(z, r, c, i, j, slope, least)
                    depth[k] += drop
                    sides[k, 0] += 1
                    sides[k, 1] += away <= NEXT
                    sides[k, 2] += drop > 0
                    sides[k, 4 + way] += away > EMPTY


@helper
def next_section(parent, rows, cols, r, c, down, right):
    """Section of the next cell with data in a direction, and how far it is; -1 without any."""
    away = 1
    i, j = r + down, c + right
    while 0 <= i < rows and 0 <= j < cols:
        if parent[i * cols + j] >= 0:
            return parent[i * cols + j], away
        i, j, away = i + down, j + right, away + 1
    return -1, rows + cols


@helper
def step_down(z, r, c, down, right, slope, least):
    """The deepest step beside a cell in a direction, beyond a slope; 0 if less than `least`."""
    rows, cols = z.shape
    deepest, drop = -np.inf, 0.0
    for k in range(1, NEXT + 1):
        i, j = r + k * down, c + k * right
        if 0 <= i < rows and 0 <= j < cols and z[r, c] - z[i, j] - slope * k > deepest:
            drop = z[r, c] - z[i, j]
            deepest = drop - slope * k
    return drop if deepest >= least else 0.0
