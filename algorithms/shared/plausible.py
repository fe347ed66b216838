"""Data and results of which a ground filter should say that they cannot be what they seem."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.shared.kernels.sorting import counted, grouped
from algorithms.shared.kernels.squares import (
    box,
    ends,
    held,
    layers_above,
    near_bottom,
    numbered,
    rises,
    tops,
    tops_between,
)
from toolbox.context import log
from toolbox.data.crs import horizontal_crs, length_problem

FEW = 9  # points: with fewer, none has another one in each of eight directions
HIGHEST, LOWEST = 9000.0, -500.0  # metres: beyond all land, with 150 m and 60 m to spare
CELL = 8.0  # metres: wide enough that a wood of few points has ground in most cells
STEEPEST = 5.0  # metres per metre, of half the cells; 0.7 in woods on slopes of 42 deg
TALLEST = 150.0  # metres of height within a cell, in a tenth of the cells
SQUARE = 4.0  # metres: of a square in which ground is compared with what is above it
CLEAR, LAYER = 1.0, 0.5  # metres: a layer so thick, so far above all ground of a square, ...
TIMES = 20  # ... with so many times its points is a surface, which hides what is below it
FEW_CELLS = 1_000_000  # as many are never too many
MOST = 0.2  # share of the squares with ground; in real surveys it is 0.07 at most
LOOKED_AT = 1000  # squares: shares of so many are known to 0.03
MANY = 1000  # points that prove of most surveys that they are wide
NARROW = 0.1  # metres to either side of a line: a scanned wall is so thin, and no survey of land
SOME = 3  # points of ground in a square that is looked at: as many as make a plane
ENOUGH = 30  # squares that two flight lines share, so that shares are known to 0.1
DEEPEST = 200.0  # metres above the ground: beyond what two height systems differ by
HALF, QUARTER = 0.5, 0.25  # a second layer has so many of the ground's points, and of all above it
RISE = 0.5  # metres of height from one ground point to the next; see :func:`sparse_ground`
TWICE = 1 / 3  # share of the squares; in real surveys 0.29 at most, with a half moved 0.39 at least
LIFTED = 0.5  # share of the squares; in real surveys 0.01 at most, with a half moved 0.86 at least
# Metres above the ground of others, from which on there are two surfaces; between the quartiles, of
# the median: a line as a whole has some tenths.
HIGHEST_LIFT, EVEN = 1.5, 0.5
LOOKED_AT_POINTS = 2_000_000  # in squares drawn by a factor that scrambles their numbers
SCRAMBLED = 40_503  # 2^16 over the golden ratio: numbers in a row fall far apart (Knuth 1973)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


def height_problem(xyz: Floats, metre: float) -> str | None:
    """What is wrong with heights that no terrain has, as a clause; None where nothing is.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    metre : length of one metre in the unit of the points

    Examples
    --------
    >>> xyz = np.array([[x, y, 12_000.0] for x in range(9) for y in range(9)])
    >>> height_problem(xyz, 1.0)
    'half the heights are above 12000 m, where there is no land: are they in another unit?'
    >>> height_problem(xyz, 1 / 0.3048) is None  # feet
    True
    """
    if not len(xyz):
        return None
    least, most = xyz[:, 2].min(), xyz[:, 2].max()
    within = LOWEST * metre <= least and most <= HIGHEST * metre  # and so is their middle
    middle = 0.0 if within else float(np.median(xyz[:, 2])) / metre
    if not LOWEST <= middle <= HIGHEST:
        side = "above" if middle > 0 else "below"
        return (
            f"half the heights are {side} {middle:.0f} m, where there is no land: "
            "are they in another unit?"
        )
    if most - least < STEEPEST * CELL * metre:
        return None
    cells, cols = _cells(xyz, CELL * metre)
    places, cells = _counted_through(cells)
    low, high = ends(cells, xyz, len(places))
    slope = _typical_slope(places, cols, low) / (CELL * metre)
    if slope > STEEPEST:
        return (
            f"half the slopes between the lowest points of neighbouring cells of {CELL:g} m are "
            f"above {100 * slope:.0f} %, which no terrain has: are the heights in the unit of "
            "x and y?"
        )
    tall = high - low > TALLEST * metre
    spread = _inner_spreads(cells, xyz[:, 2]) / metre if tall.mean() > 0.1 else low[:0]
    if len(spread) and (typical := np.quantile(spread, 0.9)) > TALLEST:
        return (
            f"in a tenth of the cells of {CELL:g} m the points spread over {typical:.0f} m of "
            "height, which no houses or trees do: are the heights in the unit of x and y?"
        )
    return None


def _typical_slope(places: Ints, cols: int, low: Floats) -> float:
    """Median rise of cells to those east and north of them together; 0 without such neighbours."""
    east, north = rises(places, cols, low)
    return float(np.median(np.hypot(east, north))) if len(east) else 0.0


def _inner_spreads(cells: Ints, z: Floats) -> Floats:
    """Heights over which the points of each cell spread, without a tenth of them at either end."""
    order = np.lexsort((z, cells))
    z = z[order]
    counts = np.bincount(cells)
    first, tenth = np.cumsum(counts) - counts, counts // 10
    return np.asarray(z[first + counts - 1 - tenth] - z[first + tenth])


def squares_of(xyz: Floats, metre: float) -> Ints:
    """Number of the square of :data:`SQUARE` metres in which each of n points lies, row by row.

    Numbers begin at 0, and not all of them are those of a square with points.

    Parameters
    ----------
    xyz : array of shape (n, 3), in the unit of the data
    metre : length of one metre in that unit

    Returns
    -------
    array of shape (n,)

    Examples
    --------
    >>> squares_of(np.array([[0.0, 0.0, 0.0], [7.0, 0.0, 0.0], [0.5, 0.0, 9.0]]), 1.0)
    array([0, 1, 0])
    """
    squares = _cells(xyz, SQUARE * metre)[0]
    return grouped(squares)[1] if _is_stretched(squares) else squares


def hidden_share(xyz: Floats, ground: Mask, squares: Ints, metre: float) -> float:
    """Share of the squares with ground in which a surface above it hides it; 0 without any.

    Ground is part of a surface, and under plants, which are spread in height, it still is the
    densest of what is about its height. So where a thin layer above it has many times the points,
    in most of the squares that have ground at all, what was found is noise below the ground. Roofs
    hide no ground: there is none in the squares below them.

    Parameters
    ----------
    xyz : array of shape (n, 3), the points that may be ground
    ground : array of shape (n,), those that were found
    squares : array of shape (n,), see :func:`squares_of`
    metre : length of one metre in the unit of the points

    Examples
    --------
    >>> xyz = np.array([[x / 4, y / 4, 100.0] for x in range(80) for y in range(80)])
    >>> ground = np.arange(6400) % 100 == 0
    >>> xyz[ground, 2] -= 5
    >>> hidden_share(xyz, ground, squares_of(xyz, 1.0), 1.0)
    1.0
    >>> hidden_share(xyz, ~ground, squares_of(xyz, 1.0), 1.0)
    0.0
    """
    if not ground.any():
        return 0.0
    counts, top = tops(squares, ground, xyz, int(squares.max()) + 1)
    others = np.bincount(squares, minlength=len(counts)) - counts
    top[others < TIMES * counts] = np.inf  # too few to hide it, in whatever layers they are
    above, layers = layers_above(squares, xyz, top, metre, CLEAR, LAYER)
    span = int(layers.max(initial=0)) + 1
    found, points = counted(above * span + layers)
    densest = np.zeros(len(counts), np.int64)
    np.maximum.at(densest, found // span, points)
    with_ground = counts > 0
    return float(np.mean(densest[with_ground] >= TIMES * counts[with_ground]))


def second_layer(
    xyz: Floats, ground: Mask, squares: Ints, metre: float, kept: Mask | None = None
) -> tuple[float, float]:
    """Share of squares with a second layer at one height above the ground, and that height.

    Both are zero where the share is proved to be no more than :data:`TWICE`.

    Two surveys in different height systems, or two flights that do not fit, are two surfaces at one
    distance everywhere. Heights above the ground are those above its next point, so that slopes do
    not matter. Crowns and roofs are at many heights, or there is no ground below them.

    Parameters
    ----------
    xyz : array of shape (n, 3), the points that may be ground
    ground : array of shape (n,), those that were found
    squares : array of shape (n,), see :func:`squares_of`
    metre : length of one metre in the unit of the points
    kept : array of shape (n,), the points to look at, with all of the ground; None for all

    Returns
    -------
    share from 0 to 1, and height in metres; zeros without any

    Examples
    --------
    >>> one = np.array([[x / 2, y / 2, 100.0] for x in range(40) for y in range(40)])
    >>> both, ground = np.vstack([one, one + [0.2, 0.1, 12]]), np.arange(3200) < 1600
    >>> share, height = second_layer(both, ground, squares_of(both, 1.0), 1.0)
    >>> round(share, 2), round(height, 2)
    (1.0, 12.0)
    """
    kept = np.ones(len(xyz), bool) if kept is None else kept
    counts, _ = tops(squares, ground, xyz, int(squares.max()) + 1)
    chosen = np.flatnonzero(counts >= SOME)
    if not len(chosen) or np.count_nonzero(ground) == np.count_nonzero(kept):
        return 0.0, 0.0
    chosen = chosen[:: -(-len(chosen) // LOOKED_AT)]
    number = np.full(len(counts), -1)
    number[chosen] = np.arange(len(chosen))
    index = held(squares, number, kept)
    points, ground, square = xyz.take(index, axis=0) / metre, ground[index], number[squares[index]]
    if _most_layered(points, ground, square, counts[chosen]) <= TWICE:
        return 0.0, 0.0
    square, rise = _rises(points, ground, square)
    layers = ((rise - CLEAR) / LAYER).astype(np.int64)
    above = (rise >= CLEAR) & (rise < DEEPEST)
    if not above.any():
        return 0.0, 0.0
    held_by = np.zeros((len(chosen), int(layers[above].max()) + 2), np.int64)
    np.add.at(held_by, (square[above], layers[above]), 1)
    pairs = held_by[:, :-1] + held_by[:, 1:]  # a layer may lie across the border of two
    least = np.maximum(HALF * counts[chosen], QUARTER * held_by.sum(axis=1))
    shares = (pairs >= least[:, None]).mean(axis=0)
    best = int(shares.argmax())
    if shares[best] == 0.0:
        return 0.0, 0.0
    within = above & (layers >= best) & (layers <= best + 1)
    return float(shares[best]), float(np.median(rise[within]))


def _most_layered(points: Floats, ground: Mask, square: Ints, counts: Ints) -> float:
    """What the share of squares with a second layer is at most, without a search.

    A point is no higher above the next ground than above the lowest of its square, and no lower
    than above the highest: it counts for each layer between. Points are in metres, shape (n, 3),
    and `counts` the number of ground points of each square.
    """
    lowest, highest = ends(square[ground], points[ground], len(counts))
    z, square = points[~ground, 2], square[~ground]
    least, most = z - highest[square], z - lowest[square]
    sure = np.bincount(square[(least >= CLEAR) & (most < DEEPEST)], minlength=len(counts))
    some = (most >= CLEAR) & (least < DEEPEST)
    first = ((least[some].clip(CLEAR) - CLEAR) / LAYER).astype(np.int64) - 1  # of the two layers
    last = ((most[some].clip(max=DEEPEST) - CLEAR) / LAYER).astype(np.int64)
    held_by = np.zeros((len(counts), int(last.max(initial=0)) + 2), np.int64)
    np.add.at(held_by, (square[some], first.clip(0)), 1)
    np.add.at(held_by, (square[some], last + 1), -1)
    needed = np.maximum(HALF * counts, QUARTER * sure)
    return float((held_by.cumsum(axis=1) >= needed[:, None]).mean(axis=0).max())


def _rises(points: Floats, ground: Mask, square: Ints) -> tuple[Ints, Floats]:
    """Squares of the points that are not ground, and metres above the next ground of that square.

    Points are in metres, shape (n, 3).
    """
    from scipy.spatial import cKDTree  # of which single surveys have no need

    # Squares are put far from each other, so that the next point is of the same one.
    places = np.column_stack([points[:, :2], square * 1e3])
    _, next_ground = cKDTree(places[ground]).query(places[~ground])
    return square[~ground], points[~ground, 2] - points[ground, 2][next_ground]


def tell_of_ground(xyz: Floats, ground: Mask, strip: NDArray[np.uint16], metre: float) -> None:
    """Warn of ground that says nothing: few points, wrong unit, below a surface, or two surfaces.

    Parameters
    ----------
    xyz : array of shape (n, 3), the points that may be ground
    ground : array of shape (n,), those that were found
    strip : array of shape (n,), their flight lines
    metre : length of one metre in the unit of the points

    Examples
    --------
    >>> xyz = np.array([[x, y, 100.0] for x in range(9) for y in range(9)])
    >>> tell_of_ground(xyz, np.ones(81, bool), np.zeros(81, np.uint16), 1.0)
    """
    if len(xyz) < FEW:
        log.warning(
            "so few points (%d that may be ground) do not tell what is ground: at least %d are "
            "needed, one in each of eight directions and one between them",
            len(xyz),
            FEW,
        )
        return
    if is_upright(xyz, metre):
        log.warning(
            "all points lie within %g m of one line seen from above, as on a wall, which does not "
            "tell what is ground",
            NARROW,
        )
        return
    if problem := height_problem(xyz, metre):
        log.warning("%s", problem)
    squares = squares_of(xyz, metre)
    if (share := hidden_share(xyz, ground, squares, metre)) > MOST:
        log.warning(
            "the ground that was found is probably noise below the ground: in %.0f %% of the "
            "squares of %g m that have any, a layer more than %g m above it has at least %d times "
            "its points; remove low noise first (points.denoise, or --ignore its class)",
            100 * share,
            SQUARE,
            CLEAR,
            TIMES,
        )
    layered = two_surfaces(xyz, ground, squares, metre) or lifted_strip(
        xyz, ground, squares, strip, metre
    )
    for problem in (layered, sparse_ground(xyz, ground, metre)):
        if problem:
            log.warning("%s", problem)


def lifted_strip(
    xyz: Floats, ground: Mask, squares: Ints, strip: NDArray[np.uint16], metre: float
) -> str | None:
    """Whether flight lines lie evenly above the ground of others, as a clause; None if none does.

    A line that lies half a metre above another leaves one surface too thick to be ground, and no
    second one apart from it: ground is that of the lower line alone. So in most of the squares in
    which others have ground it has none, and its lowest points lie at one height above theirs;
    those on crowns do not.

    Parameters
    ----------
    strip : array of shape (n,), the flight line of each point

    The others are those of :func:`hidden_share`.

    Examples
    --------
    >>> xyz = np.array([[x / 2, y / 2, y % 2 / 2] for x in range(80) for y in range(80)])
    >>> low, squares = xyz[:, 2] == 0, squares_of(xyz, 1.0)
    >>> strip = np.where(low, 7, 8).astype(np.uint16)
    >>> print(lifted_strip(xyz, low, squares, strip, 1.0).partition(" of other")[0])
    points of flight line 8 lie some 0.5 m above the ground
    >>> lifted_strip(xyz, np.ones(6400, bool), squares, strip, 1.0) is None
    True
    """
    if not len(strip) or strip.min() == strip.max():
        return None
    each = len(strip) // LOOKED_AT_POINTS + 1
    some = np.flatnonzero((squares * SCRAMBLED >> 16) % each == 0)
    lines, line = np.unique(strip[some], return_inverse=True)
    places, place = grouped(squares[some] * len(lines) + line)
    of_ground, square = ground[some], grouped(places // len(lines))[1]
    points, found = np.bincount(place), np.bincount(place, of_ground)
    others = np.bincount(square, found)[square] - found
    low = ends(place, xyz[some], len(places))[0]
    bottom = ends(square[place[of_ground]], xyz[some[of_ground]], int(square.max()) + 1)[0]
    asked = (points >= SOME) & (others >= SOME)
    lifted = {}
    for number, name in enumerate(lines.tolist()):
        own = asked & (places % len(lines) == number)
        none = own & (found == 0)
        if own.sum() < ENOUGH or none.sum() <= LIFTED * own.sum():
            continue
        quarters = np.percentile(low[none] - bottom[square[none]], (25, 50, 75)) / metre
        if quarters[2] - quarters[0] <= EVEN * quarters[1] and quarters[1] <= HIGHEST_LIFT:
            lifted[name] = quarters[1]
    if not lifted:
        return None
    names = ", ".join(str(name) for name in lifted)
    return (
        f"points of flight line {names} lie some {max(lifted.values()):.1f} m above the ground of "
        "other lines, and have none in most places: do their heights not fit, or was there "
        "snow or a crop? compare them without classes (points.survey_quality), and keep one or "
        "mend the heights"
    )


def sparse_ground(xyz: Floats, ground: Mask, metre: float) -> str | None:
    """Whether ground rises too much from point to point to be told from objects, as a clause.

    What rises by as much as low objects are high between two points may be either. Of eight ISPRS
    samples and two American surveys, thinned to a half to a fiftieth, :data:`RISE` parts those in
    which `ground.classify` loses 3 to 50 % of the ground from those in which it loses less than
    7 %, and mostly less than 2 %.

    Parameters are those of :func:`hidden_share`.

    Examples
    --------
    >>> xyz = np.array([[x, y, 0.2 * x] for x in range(40) for y in range(40)], float)
    >>> sparse_ground(xyz, np.ones(1600, bool), 1.0) is None
    True
    >>> print(sparse_ground(4 * xyz, np.ones(1600, bool), 1.0).partition(":")[0])
    the ground points lie some 4.1 m apart, and rise 0.8 m over that
    """
    if not ground.any():
        return None
    spacing, rise = spacing_and_rise(xyz, ground, metre)
    if rise <= RISE:
        return None
    return (
        f"the ground points lie some {spacing:.1f} m apart, and rise {rise:.1f} m over that: what "
        "rises so much from one point to the next may be ground or an object, and edges and steep "
        "places are probably missing in the ground; look at them, or take denser data"
    )


def spacing_and_rise(xyz: Floats, ground: Mask, metre: float) -> tuple[float, float]:
    """Mean distance of ground points, and how far ground typically rises over it, in metres.

    Heights are compared from cell to cell of about four points. Parameters are those of
    :func:`hidden_share`.

    Examples
    --------
    >>> xyz = np.array([[x, y, 0.3 * x + 0.4 * y] for x in range(40) for y in range(40)], float)
    >>> [round(value, 1) for value in spacing_and_rise(xyz, np.ones(1600, bool), 1.0)]
    [1.0, 0.5]
    """
    count, (west, south, east, north) = np.count_nonzero(ground), box(xyz)
    spacing = math.sqrt((east - west) * (north - south) / count)
    for _ in range(2):  # once more, as the box of all points may be mostly empty
        cell = 2 * spacing
        places, cols, top = _ground_tops(xyz, ground, (west, south, east, north), cell)
        spacing = cell * math.sqrt(len(places) / count)
    slope = _typical_slope(places, cols, top) / cell
    return spacing / metre, slope * spacing / metre


def _ground_tops(
    xyz: Floats, ground: Mask, corners: tuple[float, ...], cell: float
) -> tuple[Ints, int, Floats]:
    """The cells with ground, in order, how far rows are apart, and the highest ground of each."""
    raster = tops_between(corners, ground, xyz, cell, max(FEW_CELLS, 2 * len(xyz)))
    if raster.size:
        places = np.flatnonzero(np.isfinite(raster))
        return places, raster.shape[1], raster.ravel()[places]
    cells, cols = _cells(xyz[ground], cell)  # stray points stretch the box
    places, number = grouped(cells)
    return places, cols, ends(number, xyz[ground], len(places))[1]


def two_surfaces(
    xyz: Floats, ground: Mask, squares: Ints, metre: float, kept: Mask | None = None
) -> str | None:
    """What is wrong with points that are two surfaces, as a clause; None if they are one.

    Parameters are those of :func:`second_layer`.

    Examples
    --------
    >>> one = np.array([[x / 2, y / 2, 100.0] for x in range(40) for y in range(40)])
    >>> both, ground = np.vstack([one, one + [0.2, 0.1, 12]]), np.arange(3200) < 1600
    >>> print(two_surfaces(both, ground, squares_of(both, 1.0), 1.0).partition(":")[0])
    in 100 % of the squares of 4 m with ground there is a second surface 12.0 m above it
    >>> two_surfaces(one, ground[:1600], squares_of(one, 1.0), 1.0) is None
    True
    """
    share, height = second_layer(xyz, ground, squares, metre, kept)
    if share <= TWICE:
        return None
    return (
        f"in {100 * share:.0f} % of the squares of {SQUARE:g} m with ground there is a second "
        f"surface {height:.1f} m above it: are these two surveys, or two flights, whose heights "
        "do not fit? compare them (points.survey_quality), and keep one or mend the heights"
    )


def is_on_map(crs: CRS | None) -> bool:
    """Whether coordinates are lengths in a CRS of the Earth; a local scan may be of a wall.

    Examples
    --------
    >>> is_on_map(CRS(32635)), is_on_map(CRS(4326)), is_on_map(None)
    (True, False, False)
    """
    if crs is None or length_problem(crs):
        return False
    return bool(horizontal_crs(crs).is_projected)


def two_surveys(xyz: Floats, metre: float, kept: Mask | None = None) -> str | None:
    """As :func:`two_surfaces`, where nobody has said yet what is ground: the lowest of each square.

    Of millions of points `kept` takes less than a copy of those that it holds.

    Examples
    --------
    >>> one = np.array([[x / 2, y / 2, 100.0] for x in range(40) for y in range(40)])
    >>> two_surveys(one, 1.0) is None, two_surveys(np.vstack([one, one + [0, 0, 12]]), 1.0) is None
    (True, False)
    """
    kept = np.ones(len(xyz), bool) if kept is None else kept
    if np.count_nonzero(kept) < FEW:
        return None
    squares = squares_of(xyz, metre)
    ground = near_bottom(squares, kept, xyz, int(squares.max()) + 1, CLEAR * metre)
    return two_surfaces(xyz, ground, squares, metre, kept)


def is_upright(xyz: Floats, metre: float) -> bool:
    """Whether points of shape (n, 3) are a wall or a profile: along one line, seen from above.

    Examples
    --------
    >>> wall = np.array([[x, 2.0 * x, z] for x in range(9) for z in range(9)])
    >>> is_upright(wall, 1.0), is_upright(wall + [[z, 0, 0] for z in wall[:, 2]], 1.0)
    (True, False)
    """
    some = xyz[:: len(xyz) // MANY + 1, :2]
    if len(some) > 1 and np.sqrt(np.linalg.eigvalsh(np.cov(some.T, ddof=0))[0]) > NARROW * metre:
        return False  # no points deviate by more than half the width of the strip that holds them
    plan = xyz[:, :2] - xyz[:, :2].mean(axis=0)
    across = np.linalg.eigh(plan.T @ plan)[1][:, 0]
    return float(np.ptp(plan @ across)) <= 2 * NARROW * metre


def _counted_through(cells: Ints) -> tuple[Ints, Ints]:
    """The cells with points, in order, and for each point which of them is its own."""
    if _is_stretched(cells):
        return grouped(cells)
    size = int(cells.max()) + 1
    places = np.flatnonzero(np.bincount(cells, minlength=size))
    number = np.zeros(size, np.int64)
    number[places] = np.arange(len(places))
    return places, number[cells]


def _is_stretched(cells: Ints) -> bool:
    """Whether stray points stretch the box of the cells, of which most are then empty."""
    return bool(cells.max(initial=0) >= max(FEW_CELLS, 2 * len(cells)))


def _cells(xyz: Floats, size: float) -> tuple[NDArray[np.int64], int]:
    """Number of the cell of each point, row by row, and how far apart rows are."""
    if not len(xyz):
        return np.zeros(0, np.int64), 1
    numbers, cols = numbered(xyz, size, 0)
    return numbers, int(cols)
