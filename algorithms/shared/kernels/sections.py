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

    Cells beside each other are of one section if heights differ by at most `rise` per cell.
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
                    if abs(z[i, j] - z[r, c]) <= rise * k:
                        one, other = root(parent, cell), root(parent, i * cols + j)
                        parent[max(one, other)] = min(one, other)
                    break
    for cell in range(rows * cols):
        if parent[cell] >= 0:
            parent[cell] = root(parent, cell)


@kernel
def boxes(parent, cols, number, box):
    """Set `box`, of shape (sections, 4), to the first row and column and the last of each section.

    `number` is that of a section by its first cell, -1 for those that are not asked for.
    """
    box[:, :2], box[:, 2:] = len(parent), -1
    for cell in range(len(parent)):
        if parent[cell] < 0 or number[parent[cell]] < 0:
            continue
        here = box[number[parent[cell]]]
        r, c = cell // cols, cell % cols
        here[0], here[1] = min(here[0], r), min(here[1], c)
        here[2], here[3] = max(here[2], r), max(here[3], c)


@kernel
def borders(z, parent, first, box, raised, slope, least, sides):
    """Count the sides of cells at the outer border of sections, by what lies beyond them.

    What a section surrounds lies within its border. `sides`, of shape (sections, 8), are all of
    them; those with data beside them; those of these with a step down, of at least `least` beyond
    what `slope` explains, or of any height to a section that is raised; those below what stands on
    the section, which is raised, and by no more than the mean of these steps; and those at the end
    of the data, to the south, north, east and west.

    `first` are the first cells of the sections, and `box` their first and last rows and columns;
    `raised` is told by the first cell of a section.
    """
    rows, cols = z.shape
    ways = ((1, 0), (-1, 0), (0, 1), (0, -1))
    for k in range(len(first)):
        own, (top, left, bottom, right) = first[k], box[k]
        beyond = outside(parent, cols, own, box[k])
        counts, depth = sides[k], 0.0
        counts[:] = 0
        for turn in range(2):  # what the second counts goes by the steps of the first
            highest = depth / max(counts[2], 1)
            for r in range(top, bottom + 1):
                for c in range(left, right + 1):
                    if parent[r * cols + c] != own:
                        continue
                    for way in range(4):
                        i, j = ways[way]
                        if not beyond[r - top + 1 + i, c - left + 1 + j]:
                            continue
                        other, away = next_section(parent, rows, cols, r, c, i, j)
                        if other == own:
                            continue
                        beside = away <= NEXT
                        on_raised = beside and raised[other]
                        rise = z[r + away * i, c + away * j] - z[r, c] if on_raised else 0.0
                        if turn == 1:
                            counts[3] += 0 < rise <= highest
                            continue
                        drop = max(step_down(z, r, c, i, j, slope, least), -rise)
                        depth += drop
                        counts[0] += 1
                        counts[1] += beside
                        counts[2] += drop > 0
                        counts[4 + way] += away > EMPTY


@helper
def outside(parent, cols, own, box):
    """Cells of the box of a section, and of a margin of one, from which its margin is reached."""
    top, left, bottom, right = box
    height, width = bottom - top + 3, right - left + 3
    beyond = np.zeros((height, width), np.bool_)
    beyond[0, 0] = True
    waiting = np.empty(height * width, np.int32)
    waiting[0], count = 0, 1
    while count:
        count -= 1
        r, c = waiting[count] // width, waiting[count] % width
        for i, j in ((r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)):
            if not (0 <= i < height and 0 <= j < width) or beyond[i, j]:
                continue
            inner = 0 < i < height - 1 and 0 < j < width - 1
            if not inner or parent[(top + i - 1) * cols + left + j - 1] != own:
                beyond[i, j] = True
                waiting[count] = i * width + j
                count += 1
    return beyond


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
