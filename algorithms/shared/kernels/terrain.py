"""Compiled loops of :mod:`algorithms.shared.terrain`.

All rasters hold metres and have cells of one metre, so distances in cells are metres. Loops run
over the rows first..last, each of which writes its own cells only: the result is the same for any
number of threads. Loops that cost little stay serial, which saves their compilation.
"""

from __future__ import annotations

import math

import numpy as np

from algorithms.shared.kernels.compiling import helper, inlined, kernel


@kernel
def steps(z, first, last, reach, slope, side, out):
    """The largest step down from each cell to one within `reach`, minus what `slope` explains.

    `side` tells which way it leads: 0 to 3 to the south, north, east or west, and -1 any.
    """
    rows, cols = z.shape
    deepest = np.empty(cols)
    for r in range(first, last):
        deepest[:] = -np.inf
        for i in range(max(0, r - reach), min(rows, r + reach + 1)):
            for right in range(-reach, reach + 1):
                square = (i - r) ** 2 + right**2
                if 0 < square <= reach * reach and (side < 0 or _leads(side, i - r, right)):
                    start = max(0, -right)
                    stop = max(start, min(cols, cols - right))  # none beyond a narrow grid
                    there, least = z[i, start + right : stop + right], slope * math.sqrt(square)
                    _deepen(z[r, start:stop], there, least, deepest[start:stop])
        out[r] = deepest


@helper
def _leads(side, south, east):
    """Whether a way leads to a side, or to halfway between that and the next one."""
    along, across = (south, east) if side < 2 else (east, south)
    return (-along if side % 2 else along) >= abs(across)


@helper
def _deepen(here, there, least, deepest):
    """Raise the deepest steps to those from here to there, along a row without a branch."""
    for c in range(len(deepest)):
        step = here[c] - there[c] - least
        deepest[c] = step if step > deepest[c] else deepest[c]  # a step to NaN is none


@helper
def _sector_minima(low, row, look, offsets, stop, minima):
    """Lowest value in each sector around the cells of a row of a level, shape (8, cols)."""
    cols = low.shape[1] - 2 * look
    minima[:, :cols] = np.inf
    for k in range(stop):  # along the row without a branch, which the processor does in parallel
        here = low[row + look + offsets[k, 0], look + offsets[k, 1] :]
        lowest = minima[offsets[k, 2]]
        for c in range(cols):
            lowest[c] = here[c] if here[c] < lowest[c] else lowest[c]


@helper
def _falls(r, c, slope, lows, minima, look, offsets, starts, away, nearest, limit, way):
    """Bits of the 8 sectors around a cell with data, and of those with a cell below their limit.

    Of each such sector `way` receives where the cell is whose cone with `slope` is lowest here, in
    rows and columns, and its height. `lows` have a margin of `look` cells, `minima` are those of
    the sectors by level; for the others see :func:`algorithms.shared.terrain.sectors`. `limit`, of
    8 heights, is used up.
    """
    seen = falls = 0
    for level in range(len(lows) - 1, -1, -1):
        low, size = lows[level], 1 << level
        i, j = (r >> level) + look, (c >> level) + look
        down, right = r & (size - 1), c & (size - 1)
        far, near = away[level, down, right], nearest[level, down, right]
        for sector in range(8):
            least = minima[level, sector, j - look]
            if least < np.inf:
                seen |= 1 << sector
            # No cone is lower than this; most ground needs no look.
            if not least + slope * near[sector] < limit[sector]:
                continue
            best = -1
            for k in range(starts[level, sector], starts[level, sector + 1]):
                cone = low[i + offsets[level, k, 0], j + offsets[level, k, 1]] + slope * far[k]
                if cone < limit[sector]:
                    limit[sector], best = cone, k
            if best >= 0:
                falls |= 1 << sector
                south, east = offsets[level, best, 0], offsets[level, best, 1]
                way[sector, 0] = south * size + 0.5 * (size - 1) - down
                way[sector, 1] = east * size + 0.5 * (size - 1) - right
                way[sector, 2] = low[i + south, j + east]
    return seen, falls


@helper
def _is_abrupt(step, r, c, south, east, least):
    """Whether the straight way has a step of at least `least`, down it if `step` tells sides.

    `step` has cells of 2 m, and is of shape (1, rows, cols), or (4, rows, cols) for the sides.
    """
    count = int(max(abs(south), abs(east)) / 2) + 1
    for t in range(count + 1):
        i, j = int(r + 0.5 + south * t / count) >> 1, int(c + 0.5 + east * t / count) >> 1
        if i < step.shape[1] and j < step.shape[2]:
            for side in range(len(step)):
                if step[side, i, j] > least and (len(step) == 1 or _leads(side, south, east)):
                    return True
    return False


@kernel
def raised(
    first,
    last,
    z,
    lows,
    look,
    offsets,
    starts,
    away,
    nearest,
    slope,
    thin,
    step,
    fall,
    least,
    share,
    asked,
    out,
):
    """Share of the sectors with data in which the terrain falls off abruptly from each cell.

    At least half the sectors are counted as having data. `step` has the steps that count for cells
    that are not `thin`, and for those that are. `least` and `share` (of the whole way
    down) say how much of the fall must be in one step. `asked` are the bits of the sectors in which
    there may be a fall, and receives those in which there is one; for the others see `_falls`.
    """
    way, limit = np.empty((8, 3)), np.empty(8)
    minima = np.empty((len(lows), 8, z.shape[1]), np.float32)
    for r in range(first, last):
        for level in range(len(lows)):
            if r == first or not r & ((1 << level) - 1):
                _sector_minima(
                    lows[level], r >> level, look, offsets[level], starts[level, 8], minima[level]
                )
        for c in range(z.shape[1]):
            out[r, c] = 0.0
            if math.isnan(z[r, c]) or not asked[r, c]:
                continue
            for k in range(8):
                limit[k] = z[r, c] - fall if (asked[r, c] >> k) & 1 else -np.inf
            seen, falls = _falls(  # arguments in a tuple would take a fifth of the time
                r, c, slope[r, c], lows, minima, look, offsets, starts, away, nearest, limit, way
            )
            asked[r, c] = falls
            count, votes = 0, 0
            for k in range(8):
                count += (seen >> k) & 1
                if (falls >> k) & 1:
                    need = max(least, share * (z[r, c] - way[k, 2]))
                    votes += _is_abrupt(step[int(thin[r, c])], r, c, way[k, 0], way[k, 1], need)
            out[r, c] = votes / max(count, 4)


@kernel
def levelled(first, last, votes, z, reach, step, slope, out):
    """Mean of the votes around each cell, over cells at about the same height."""
    rows, cols = z.shape
    total, count = np.empty(cols), np.empty(cols, np.float32)
    for r in range(first, last):
        total[:], count[:] = 0.0, 0.0
        for i in range(max(0, r - reach), min(rows, r + reach + 1)):
            for right in range(-reach, reach + 1):
                away = math.sqrt((i - r) ** 2 + right**2)
                if away <= reach:
                    start = max(0, -right)
                    stop = max(start, min(cols, cols - right))
                    there = slice(start + right, stop + right)
                    _add_alike(
                        *(z[r, start:stop], z[i, there], step + slope * away, votes[i, there]),
                        *(total[start:stop], count[start:stop]),
                    )
        for c in range(cols):
            out[r, c] = total[c] / count[c] if count[c] else 0.0


@helper
def _add_alike(here, there, limit, votes, total, count):
    """Add and count the votes of cells within a limit of height, along a row without a branch."""
    for c in range(len(total)):
        # A comparison with NaN is false: cells without data never count.
        same = abs(there[c] - here[c]) <= limit
        total[c] += votes[c] if same else np.float32(0.0)
        count[c] += np.float32(1.0) if same else np.float32(0.0)


@kernel
def gathered(z, surface, weight, level, weights, residuals):
    """Sums of the weights, and of weight times z - surface, over cells of 2**level metres."""
    size = 1 << level
    for i in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            total, product = 0.0, 0.0
            for r in range(i * size, (i + 1) * size):
                for c in range(j * size, (j + 1) * size):
                    if weight[r, c] > 0:
                        total += weight[r, c]
                        product += weight[r, c] * (z[r, c] - surface[r, c])
            weights[i, j], residuals[i, j] = total, product


@kernel
def planes(first, last, weights, residuals, sigma, enough, stiff, out):
    """Height of the plane fitted to the residuals around each cell.

    Weighted least squares in a Gaussian window of `sigma` cells; `stiff` (of the square of sigma)
    holds the plane level where there is little data. The height fades to nothing where the
    weights in the window sum to less than `enough` points. NaN where there is no data.
    """
    rows, cols = weights.shape
    reach = math.ceil(3 * sigma)
    bell = np.empty(2 * reach + 1)
    for k in range(len(bell)):
        bell[k] = math.exp(-0.5 * ((k - reach) / sigma) ** 2)
    for r in range(first, last):
        # Moments along the column first, one value per column; the margins are zeros.
        line = np.zeros((5, cols + 2 * reach))
        for k in range(2 * reach + 1):
            i = r + k - reach
            if 0 <= i < rows:
                g, d = bell[k], float(k - reach)
                for c in range(cols):
                    w, v = g * weights[i, c], g * residuals[i, c]
                    line[0, c + reach] += w
                    line[1, c + reach] += w * d
                    line[2, c + reach] += w * d * d
                    line[3, c + reach] += v
                    line[4, c + reach] += v * d
        m = np.zeros((9, cols))
        for k in range(2 * reach + 1):
            g, d = bell[k], float(k - reach)
            for c in range(cols):
                w, wy, wyy = g * line[0, c + k], g * line[1, c + k], g * line[2, c + k]
                v, vy = g * line[3, c + k], g * line[4, c + k]
                m[0, c] += w
                m[1, c] += w * d
                m[2, c] += wy
                m[3, c] += w * d * d
                m[4, c] += wy * d
                m[5, c] += wyy
                m[6, c] += v
                m[7, c] += v * d
                m[8, c] += vy
        _plane(m, stiff * sigma * sigma, enough, out[r])


@inlined
def _plane(m, hold, enough, out):
    """Height of the plane of each cell of a row, from the moments; see :func:`planes`."""
    for c in range(len(out)):
        if m[0, c] < 1e-6:
            out[c] = np.nan
            continue
        x, y, v = m[1, c] / m[0, c], m[2, c] / m[0, c], m[6, c] / m[0, c]
        xx = m[3, c] / m[0, c] - x * x + hold
        xy = m[4, c] / m[0, c] - x * y
        yy = m[5, c] / m[0, c] - y * y + hold
        xv, yv = m[7, c] / m[0, c] - x * v, m[8, c] / m[0, c] - y * v
        determinant = xx * yy - xy * xy
        east = (xv * yy - yv * xy) / determinant
        south = (yv * xx - xv * xy) / determinant
        trust = min(max(m[0, c] / enough - 0.5, 0.0), 1.0)
        out[c] = (v - east * x - south * y) * trust


@kernel
def add_bilinear(surface, coarse, level):
    """Add a surface with cells of 2**level metres to a surface, interpolated bilinearly.

    Beyond the middle of its outer cells it goes on as between the last two: hillsides do so.
    """
    size = 1 << level
    rows, cols = coarse.shape
    lines = np.empty((rows, surface.shape[1]))
    for c in range(surface.shape[1]):
        x = (c + 0.5) / size - 0.5
        j = min(int(max(x, 0.0)), max(cols - 2, 0))
        right, u = min(j + 1, cols - 1), x - j
        for i in range(rows):
            lines[i, c] = coarse[i, j] * (1 - u) + coarse[i, right] * u
    for r in range(surface.shape[0]):
        y = (r + 0.5) / size - 0.5
        i = min(int(max(y, 0.0)), max(rows - 2, 0))
        below, v = min(i + 1, rows - 1), y - i
        for c in range(surface.shape[1]):
            surface[r, c] += lines[i, c] * (1 - v) + lines[below, c] * v


@helper
def _between(surface, y, x):
    """Bilinear height at row y and column x, and the slope there."""
    rows, cols = surface.shape
    i, j = min(int(y), rows - 2), min(int(x), cols - 2)
    v, u = y - i, x - j
    nw, ne = surface[i, j], surface[i, j + 1]
    sw, se = surface[i + 1, j], surface[i + 1, j + 1]
    height = (nw * (1 - u) + ne * u) * (1 - v) + (sw * (1 - u) + se * u) * v
    east, south = (ne - nw) * (1 - v) + (se - sw) * v, (sw - nw) * (1 - u) + (se - ne) * u
    return height, math.sqrt(east * east + south * south)


@kernel
def reweighted(z, candidate, surface, tolerance, slope_tolerance, below, weight):
    """Weights of candidates by their residuals; they fall faster above the surface than below."""
    rows, cols = z.shape
    for r in range(rows):
        for c in range(cols):
            weight[r, c] = 0.0
            if candidate[r, c]:
                height, slope = _between(surface, float(r), float(c))
                residual = z[r, c] - height
                limit = tolerance + slope_tolerance * slope
                if residual < 0:
                    limit *= below
                weight[r, c] = 1.0 / (1.0 + (residual / limit) ** 4)


@helper
def _of_blocks(values, y, x):
    """Value at row y and column x of a raster, bilinear from one per block of 8 x 8 cells."""
    rows, cols = values.shape
    y = min(max((y + 0.5) / 8 - 0.5, 0.0), rows - 1.0)
    x = min(max((x + 0.5) / 8 - 0.5, 0.0), cols - 1.0)
    return _between(values, y, x)[0]


@helper
def _place(xyz, k, metre, left, top, shape):
    """Row and column of a point on rasters of this shape; NaN outside."""
    row, col = top - xyz[k, 1] / metre - 0.5, xyz[k, 0] / metre - left - 0.5
    if not (-1 < row < shape[0] and -1 < col < shape[1]):
        return np.nan, np.nan
    return min(max(row, 0.0), shape[0] - 1.0), min(max(col, 0.0), shape[1] - 1.0)


@kernel
def heights_above(first, last, xyz, metre, left, top, surface, height):
    """Height above the surface in metres; NaN outside.

    The surface begins `left` and `top` metres from the origin of the coordinates.
    """
    for k in range(first, last):
        row, col = _place(xyz, k, metre, left, top, surface.shape)
        height[k] = np.nan
        if not math.isnan(row):
            height[k] = xyz[k, 2] / metre - _between(surface, row, col)[0]


@kernel
def verdicts(
    first,
    last,
    xyz,
    metre,
    left,
    top,
    surface,
    bend,
    tolerance,
    least,
    below,
    highest,
    ground,
    confidence,
    beside,
):
    """Whether points are ground, and how sure that is; see :func:`terrain.verdict`.

    The rasters begin `left` and `top` metres from the origin of the coordinates. `tolerance` is
    that of level ground and that per slope, of shape (2, rows / 8, cols / 8), in metres; `least` is
    that beside which bends and heights beyond the limit count, `below` how many times as deep
    ground may lie. `beside` receives the cell of points that may be at the top of a step, -1
    elsewhere: they are above the limit, and at most by `least` above the `highest` ground beside.
    """
    for k in range(first, last):
        row, col = _place(xyz, k, metre, left, top, surface.shape)
        ground[k], confidence[k], beside[k] = False, 1.0, -1
        if math.isnan(row):
            continue
        height, slope = _between(surface, row, col)
        residual = xyz[k, 2] / metre - height
        if not math.isfinite(residual):
            continue
        level, more = _of_blocks(tolerance[0], row, col), _of_blocks(tolerance[1], row, col)
        allowed = level + more * slope
        deepest, wide = below * allowed + 1.0, max(allowed, least)
        limit = allowed if residual > 0 else deepest
        if -deepest <= residual <= allowed:
            bent = _between(bend, row, col)[0]
            ground[k], sure = True, 1 - abs(residual) / limit - abs(bent) / wide
        else:
            sure = (abs(residual) - limit) / (wide if residual > 0 else limit)
            i, j = int(row + 0.5), int(col + 0.5)
            if residual > 0 and xyz[k, 2] / metre <= highest[i, j] + least:
                beside[k] = i * surface.shape[1] + j
        confidence[k] = min(max(sure, 0.0), 1.0)


@kernel
def blocks_of(cells, cols, out):
    """The block of 8 x 8 cells of each cell of a raster with `cols` columns, counted by row."""
    for k in range(len(cells)):
        row = cells[k] // cols
        out[k] = (row >> 3) * (cols >> 3) + ((cells[k] - row * cols) >> 3)
