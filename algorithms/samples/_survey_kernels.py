"""Compiled loops of `_survey`: rays against terrain, blocks, crowns and rods."""

from __future__ import annotations

import numpy as np

from algorithms.shared.kernels.compiling import kernel


@kernel
def elevation(values, west, north, cell, x, y):
    """Bilinear elevation at one point."""
    rows, cols = values.shape
    u = min(max((x - west) / cell - 0.5, 0.0), cols - 1.0)
    v = min(max((north - y) / cell - 0.5, 0.0), rows - 1.0)
    col, row = min(int(u), cols - 2), min(int(v), rows - 2)
    u, v = u - col, v - row
    upper = values[row, col] * (1 - u) + values[row, col + 1] * u
    lower = values[row + 1, col] * (1 - u) + values[row + 1, col + 1] * u
    return upper * (1 - v) + lower * v


@kernel
def bilinear(values, west, north, cell, x, y):
    """Bilinear elevation at many points."""
    z = np.empty(len(x))
    for i in range(len(x)):
        z[i] = elevation(values, west, north, cell, x[i], y[i])
    return z


@kernel
def bucket(low, high, rows, cols):
    """Objects in each cell, as starts and items, from the column and row ranges of each object."""
    start = np.zeros(rows * cols + 1, np.int64)
    for i in range(len(low)):
        for row in range(low[i, 1], high[i, 1] + 1):
            for col in range(low[i, 0], high[i, 0] + 1):
                start[row * cols + col + 1] += 1
    start = np.cumsum(start)
    items = np.empty(start[-1], np.int64)
    end = start.copy()
    for i in range(len(low)):
        for row in range(low[i, 1], high[i, 1] + 1):
            for col in range(low[i, 0], high[i, 0] + 1):
                items[end[row * cols + col]] = i
                end[row * cols + col] += 1
    return start, items


@kernel
def near(index, x, y):
    """Indices of the objects in the cell of a position; the border cells extend to infinity."""
    col = min(max(int((x - index.west) / index.cell), 0), index.cols - 1)
    row = min(max(int((y - index.south) / index.cell), 0), index.rows - 1)
    here = row * index.cols + col
    return index.items[index.start[here] : index.start[here + 1]]


@kernel
def first_hits(x0, y0, sx, sy, values, level, west, north, cell, blocks, index):
    """First hit of each ray with the terrain, the water or the blocks."""
    n = len(x0)
    z = np.empty(n)
    source, facet = np.zeros(n, np.uint8), np.zeros(n, np.uint8)
    item = np.zeros(n, np.int64)
    for i in range(n):
        h = elevation(values, west, north, cell, x0[i], y0[i])
        for _ in range(60):  # slopes below 1 / tan(20 degrees) converge
            lower = elevation(values, west, north, cell, x0[i] + sx[i] * h, y0[i] + sy[i] * h)
            change, h = lower - h, lower
            if abs(change) < 1e-4:
                break
        x, y = x0[i] + sx[i] * h, y0[i] + sy[i] * h
        row = min(max(int((north - y) / cell), 0), level.shape[0] - 1)
        col = min(max(int((x - west) / cell), 0), level.shape[1] - 1)
        if level[row, col] > h:
            h, source[i] = level[row, col], 1
        for block in near(index, x, y):
            top, face = enter(blocks[block], x0[i], y0[i], sx[i], sy[i])
            if top > h:
                h, facet[i], item[i], source[i] = top, face, block, 2
        z[i] = h
    return z, source, item, facet


@kernel
def enter(block, x0, y0, sx, sy):
    """Height and facet where a ray enters a block; -inf where it misses.

    A block is convex: the ray is inside where a + b z <= 0 holds for all its half-spaces.
    """
    dx, dy = x0 - block.x, y0 - block.y
    u, v = dx * block.ux + dy * block.uy, dy * block.ux - dx * block.uy
    du, dv = sx * block.ux + sy * block.uy, sy * block.ux - sx * block.uy
    eave = block.top + block.hip * (block.a - block.b)
    planes = (
        (block.slope * v - block.top, 1 + block.slope * dv),
        (-block.slope * v - block.top, 1 - block.slope * dv),
        (block.hip * u - eave, 1 + block.hip * du),
        (-block.hip * u - eave, 1 - block.hip * du),
        (u - block.a, du),
        (-u - block.a, -du),
        (v - block.b, dv),
        (-v - block.b, -dv),
        (block.base, -1.0),
    )
    upper, lower, facet = np.inf, -np.inf, 0
    for k in range(9):
        a, b = planes[k]
        if abs(b) < 1e-12:
            if a > 0:
                return -np.inf, 0
        elif b > 0:
            if -a / b < upper:
                upper, facet = -a / b, k
        else:
            lower = max(lower, -a / b)
    if upper <= lower:
        return -np.inf, 0
    return upper, facet


@kernel
def crown_width(shape, t):
    """Radius of a crown of unit radius at fraction t of its height."""
    if shape == 0:
        return np.sqrt(max(0.0, 1 - (2 * t - 1) ** 2))
    if shape == 1:
        return 1 - t
    return np.sqrt(max(0.0, 1 - t**4)) * min(1.0, 0.4 + 3 * t)


@kernel
def chords(x0, y0, sx, sy, ground, crowns, index):
    """Entry and exit height of each ray in the highest crown that it hits; item -1 for none."""
    n, steps = len(x0), 24
    top, bottom = np.full(n, -np.inf), np.full(n, np.inf)
    item = np.full(n, -1, np.int64)
    for i in range(n):
        for number in near(index, x0[i] + sx[i] * ground[i], y0[i] + sy[i] * ground[i]):
            crown = crowns[number]
            step = (crown.top - crown.base) / steps
            first, last = -np.inf, np.inf
            for j in range(steps):
                t = 1 - (j + 0.5) / steps
                h = crown.base + t * (crown.top - crown.base)
                dx, dy = x0[i] + sx[i] * h - crown.x, y0[i] + sy[i] * h - crown.y
                if dx * dx + dy * dy < (crown.radius * crown_width(crown.shape, t)) ** 2:
                    first = max(first, h + step / 2)
                    last = h - step / 2
            if first > top[i]:
                top[i], bottom[i], item[i] = first, last, number
    return top, bottom, item


@kernel
def strikes(x0, y0, sx, sy, ground, rods, index):
    """All approaches of rays to rods: pulse, height of the nearest point of the rod, rod."""
    pulse, rod, height = [], [], []
    for i in range(len(x0)):
        for number in near(index, x0[i] + sx[i] * ground[i], y0[i] + sy[i] * ground[i]):
            h, away = approach(rods[number], x0[i], y0[i], sx[i], sy[i])
            if away < rods[number].radius:
                pulse.append(i)
                rod.append(number)
                height.append(h)
    return np.array(pulse, np.int64), np.array(height, np.float64), np.array(rod, np.int64)


@kernel
def approach(rod, x0, y0, sx, sy):
    """Height of the point of a rod nearest to a ray, and the distance between them."""
    ex, ey, ez = rod.x2 - rod.x1, rod.y2 - rod.y1, rod.z2 - rod.z1
    dx, dy, dz = rod.x1 - x0, rod.y1 - y0, rod.z1
    ee = ex * ex + ey * ey + ez * ez
    ff = sx * sx + sy * sy + 1
    ef = ex * sx + ey * sy + ez
    ed = ex * dx + ey * dy + ez * dz
    fd = sx * dx + sy * dy + dz
    across = ee * ff - ef * ef
    t = 1.0 if across < 1e-12 else min(max((ef * fd - ff * ed) / across, 0.0), 1.0)
    h = (fd + t * ef) / ff
    ax, ay, az = dx + t * ex - sx * h, dy + t * ey - sy * h, dz + t * ez - h
    return rod.z1 + t * ez, np.sqrt(ax * ax + ay * ay + az * az)
