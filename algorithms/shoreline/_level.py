"""Levels of water from heights, by modes: neither banks above nor errors below affect them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit  # scipy.stats would take half a second to import

from algorithms.shared.otsu import otsu_threshold
from algorithms.shared.water_surface import MOST_SIGMA, WIDEST

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NORMAL = 0.6745  # median deviation of a normal distribution, in standard deviations

FEW = 0.05  # share of the heights that make a mode
FIRST_SIGMA = 0.10  # m: before it is known; the foot of waves of 0.15 is a start, too
LEAST_SIGMA = 0.01  # m: of a calm lake; that of a rough one is MOST_SIGMA
_THERE = math.exp(-(WIDEST**2) / 2) / math.sqrt(math.tau)  # density of a normal distribution
TRIMMED = 1 - 2 * WIDEST * _THERE  # move of their mean for one of all points
MEDIAN_OF_FEW = 0.8  # points that a median deviation lacks (Croux and Rousseeuw 1992)
FEWEST = 6  # points on the water that tell its level, or that of a strip
BLOCKS = 16  # of which the scatter is the error: waves may be as long as a quarter of the body
FINE = 64  # blocks that tell whether a surface has a step: few lie across it
DIRECTIONS = 12  # of lines that are tried as the step
STEPPED = 0.85  # share of the variance of blocks that a step explains: 0.75 of a slope
DAYS = 0.05  # m between flights that is told of
CONFIDENCE = 0.95
NINETY_FIVE = float(ndtri((1 + CONFIDENCE) / 2))  # standard errors to each side of it
RESAMPLED = 100  # times that the points on a shore are drawn anew, for the error of its level
BIN, EDGE = 0.05, 0.3  # m: heights that are counted together, and that belong to an edge
FOOT = 0.25  # share of these heights that is below the level if they are of waves and a bank
ROUNDS = 50  # of narrowing down; it settles after five to fifteen


def mode(heights: NDArray[np.floating[Any]], width: float) -> float:
    """Median of the heights in the fullest interval of a width, the lowest of equally full ones."""
    h = np.sort(heights)
    ends = np.searchsorted(h, h + width, side="right")
    first = int(np.argmax(ends - np.arange(len(h))))
    return float(np.median(h[first : ends[first]]))


def lowest_mode(heights: NDArray[np.floating[Any]], width: float) -> float:
    """Median of the heights in the lowest interval of a width that holds a share of FEW of them."""
    h = np.sort(heights)
    ends = np.searchsorted(h, h + width, side="right")
    many = ends - np.arange(len(h)) >= max(3, FEW * len(h))
    if not many.any():
        return float(h[0])
    first = int(np.argmax(many))
    return float(np.median(h[first : ends[first]]))


@dataclass(frozen=True)
class Sides:
    """Levels on both sides of a straight line across a water, as of flights on two days.

    Attributes
    ----------
    lower, upper : the levels
    towards : unit vector across the line to the upper side
    beyond : how far along it the line is
    """

    lower: float
    upper: float
    towards: tuple[float, float]
    beyond: float

    @property
    def levels(self) -> tuple[float, float]:
        """Both levels, the lower one first."""
        return self.lower, self.upper

    def at(self, xy: Floats) -> Floats:
        """Level on the side of each position, of shape (n, 2)."""
        return np.where(xy @ np.array(self.towards) >= self.beyond, self.upper, self.lower)


@dataclass(frozen=True)
class Level:
    """The surface of a water body: a plane, level in most cases.

    Attributes
    ----------
    height : at `centre`
    error : standard error of the height
    freedom : degrees of freedom of the error
    sigma : standard deviation of single points on the water
    points : number of points that it was found from
    strips : difference between the highest and the lowest level of a strip, 0 for a single one
    basis : points on the water, or on its shore where too few came back from the water
    gradient : rise eastwards and northwards
    centre : where the height is
    of_strip : number and level of each strip of which enough points are on the water
    parts : levels side by side whose flights the points do not name
    cover : levels of the part that returns most, and of the rest, where these differ
    """

    height: float
    error: float
    freedom: float
    sigma: float
    points: int
    strips: float = 0.0
    basis: Literal["water", "shore"] = "water"
    gradient: tuple[float, float] = (0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)
    of_strip: tuple[tuple[int, float], ...] = ()
    parts: Sides | None = None
    cover: tuple[float, float] | None = None

    @property
    def highest(self) -> float:
        """The highest level of a strip."""
        return max([self.height, *(height for _, height in self.of_strip)])

    def shift(self, xy: Floats, strip: NDArray[np.integer[Any]]) -> Floats:
        """How far the level of the strip, or the side, of each point is above that of all.

        Parameters
        ----------
        xy : array of shape (n, 2)
        strip : array of shape (n,)
        """
        shift = np.zeros(len(strip))
        for number, height in self.of_strip:
            shift[strip == number] = height - self.height
        return shift + self.parts.at(xy) - self.height if self.parts else shift

    @property
    def scatter(self) -> float:
        """Standard deviation of single points from the height, at most; NaN if none are on it.

        Levels of strips, or of parts, that differ by some range have a standard deviation of at
        most half of it (Popoviciu's inequality); what covers the water may lie all at its own.
        """
        if self.basis == "shore":
            return math.nan
        apart = max(self.strips, self.parts.upper - self.parts.lower if self.parts else 0.0)
        off = max(abs(height - self.height) for height in self.cover or (self.height,))
        return math.hypot(self.sigma, float(max(apart / 2, off)))

    @property
    def interval(self) -> float:
        """Half width of the 95 % interval of the height, by Student's distribution."""
        return float(self.error * stdtrit(self.freedom, (1 + CONFIDENCE) / 2))

    def at(self, xy: Floats) -> Floats:
        """Heights of the surface at positions of shape (n, 2)."""
        if self.gradient == (0.0, 0.0):
            return np.full(len(xy), self.height)
        return np.asarray(self.height + (xy - np.array(self.centre)) @ np.array(self.gradient))


def level_of(
    xyz: Floats,
    strip: Ints,
    core: NDArray[np.bool_],
    start: float,
    metre: float,
    step: float = 0.0,
) -> Level:
    """Level of a water body from points on the water.

    Banks, boats and reeds above and errors below hardly move it: of the points within three
    standard deviations of their own median the mean is taken, as far to both sides. Of points that
    scatter more than those on water do, the level is no surer than one of them.

    Parameters
    ----------
    xyz : array of shape (n, 3)
    strip : array of shape (n,), the flight line of each point
    core : array of shape (n,), points far from the shore, which tell the level
    start : a first estimate
    metre : length of one metre in the unit of the points
    step : what heights are rounded to
    """
    heights, strips = xyz[core, 2], strip[core]
    middle = _of_strips(heights, strips, _settled(heights, start, metre)[0], metre)
    shift, sigma = _settled(heights - middle, 0.0, metre)
    near = abs(heights - middle - shift) <= WIDEST * sigma
    if near.sum() < FEWEST:
        return Level(start, MOST_SIGMA * metre, math.inf, MOST_SIGMA * metre, int(near.sum()))
    level = float(heights[near].mean())
    scatter, freedom, apart = _error(xyz[core][near], strips[near])
    error, freedom = _with_known(scatter, freedom, _rounding(heights[near], step))
    if sigma >= MOST_SIGMA * metre:  # rougher than water: banks or islands are among the points
        error, freedom = sigma, math.inf
    own = _levels(heights, strips, near)
    found = Level(level, error, freedom, sigma, int(near.sum()), apart, of_strip=own)
    places = xyz[core][near, :2]
    flat = np.column_stack([places, heights[near] - found.shift(places, strips[near])])
    if parts := _parts(flat, metre):
        found = replace(holding(found, parts.levels), parts=parts)
    below = level + found.shift(xyz[:, :2], strip) - xyz[:, 2]
    below = below[(below > 0) & (below < MOST_SIGMA * WIDEST * metre)]
    if len(below) >= FEWEST:  # nearer to the shore waves may be higher; banks are never below
        sigma = max(sigma, min(float(np.median(below)) / NORMAL, MOST_SIGMA * metre))
    return replace(found, sigma=sigma)


def side_by_side(xyz: Floats, level: Level, most: float, metre: float) -> Level:
    """A level with those on both sides of a line, where it may be that of one of them alone.

    Points that scatter little are taken for those of the fuller side, and the rest for banks.

    Parameters
    ----------
    xyz : array of shape (n, 3), points far from the shore
    level : as found from the points near it
    most : by which the sides may differ
    metre : length of one metre in the unit of the points
    """
    if level.parts:
        return level
    near = abs(xyz[:, 2] - level.height) <= most + WIDEST * level.sigma
    parts = _parts(xyz[near], metre)
    if parts is None or parts.upper - parts.lower > most:
        return level
    on = abs(xyz[:, 2] - parts.at(xyz[:, :2])) <= WIDEST * level.sigma
    height = float(xyz[on, 2].mean())
    mean = replace(level, height=height, points=int(on.sum()), of_strip=())
    return replace(holding(mean, parts.levels), parts=parts)


def holding(level: Level, parts: tuple[float, float]) -> Level:
    """A level whose interval holds those of both its parts: nobody knows which of them is meant."""
    apart = max(abs(level.height - part) for part in parts)
    error, freedom = _with_known(level.error, level.freedom, apart)
    return replace(level, error=error, freedom=freedom)


def under_cover(level: Level, metre: float) -> Level:
    """The level of water of which a part is covered: the lower one, if other flights explain it.

    Plants, ice and mud lie above the water, and returns that blind the scanner seem to. Nobody
    knows whether it was a flight at another time: the interval reaches to the other level, and
    the levels of strips, by which the shore is drawn, stay.
    """
    if not level.cover or abs(np.subtract(*level.cover)) < DAYS * metre:
        return level
    low, high = sorted(level.cover)
    held = max(level.height - low, high - level.height)
    own = math.sqrt(max(level.error**2 - held**2, 0.0))
    error = math.hypot(own, (high - low) / NINETY_FIVE)
    return replace(level, height=low, error=error, freedom=math.inf)


def _with_known(error: float, freedom: float, known: float) -> tuple[float, float]:
    """An error with a known part, which has no degrees of freedom to lose, and its freedom."""
    both = math.hypot(error, known)
    return both, freedom * (both / error) ** 4 if error else math.inf


def _levels(heights: Floats, strip: Ints, near: NDArray[np.bool_]) -> tuple[tuple[int, float], ...]:
    """Number and mean height of each strip of which enough points are on the water."""
    own = {int(one): heights[near & (strip == one)] for one in np.unique(strip)}
    return tuple((one, float(z.mean())) for one, z in own.items() if len(z) >= FEWEST)


def _of_strips(heights: Floats, strip: Ints, middle: float, metre: float) -> Floats:
    """Median of the strip of each point; that of all for strips of which few points are on water.

    If one median were taken of all, strips that differ by more than their noise would be left out.
    """
    medians = np.full(len(heights), middle)
    for one in np.unique(strip):
        of_it = strip == one
        own, sigma = _settled(heights[of_it], middle, metre)
        near = abs(heights[of_it] - own) <= WIDEST * sigma
        if near.sum() >= FEWEST and abs(own - middle) <= MOST_SIGMA * metre:
            medians[of_it] = own
    return medians


def _settled(heights: Floats, middle: float, metre: float) -> tuple[float, float]:
    """Median and standard deviation of the heights around a first estimate."""
    sigma, count = FIRST_SIGMA * metre, -1
    for _ in range(ROUNDS):
        near = heights[abs(heights - middle) <= WIDEST * sigma]
        if len(near) < FEWEST and sigma < MOST_SIGMA * metre:
            sigma = min(2 * sigma, MOST_SIGMA * metre)
            continue
        if len(near) in (count, 0):
            break
        middle, count = float(np.median(near)), len(near)
        inner = float(np.median(abs(near - middle))) / NORMAL
        inner *= count / (count - MEDIAN_OF_FEW)
        sigma = min(max(inner, LEAST_SIGMA * metre), MOST_SIGMA * metre)
    return middle, sigma


def _error(xyz: Floats, strip: Ints) -> tuple[float, float, float]:
    """Standard error of the mean height, its degrees of freedom, and the difference of strips.

    Errors of neighbouring points are alike, by waves, so the mean is as sure as that of the means
    of compact blocks, less one for each strip, whose mean is taken off. Each strip is also wrong by
    a shift of its own, and there are only as many shifts as strips: their variance is that of the
    means of strips beyond their own errors. It counts wherever it is more than 0: a test for it
    would pass over the shifts that happen to be alike. Degrees of freedom of the sum as by
    Satterthwaite (1946).

    With b means m_k of blocks, s strips, their shares p_i of the points and their offsets o_i:
    within = sum (m_k - mean)^2 / (b - s) / b, and between = max(var(o_i) - mean(within / p_i), 0)
    times sum p_i^2. The error is the root of within + between.
    """
    _, of, counts = np.unique(strip, return_inverse=True, return_counts=True)
    offset = np.bincount(of, xyz[:, 2]) / counts - xyz[:, 2].mean()
    rest = xyz[:, 2] - offset[of]
    means = np.array([rest[k].mean() for k in even_blocks(xyz[:, :2])])
    freedom = float(max(len(means) - len(counts), 1))
    within = float(((means - means.mean()) ** 2).sum()) / freedom / len(means) / TRIMMED**2
    many = counts >= FEWEST
    if many.sum() < 2:
        return float(np.sqrt(within)), freedom, 0.0
    share, offset, more = counts[many] / counts[many].sum(), offset[many], int(many.sum()) - 1
    excess = float(np.var(offset, ddof=1) - (within / share).mean())
    between = max(excess, 0.0) * float(share @ share)
    both = within + between
    if both:  # not so where all heights are rounded to one
        freedom = both**2 / (within**2 / freedom + between**2 / more)
    return float(np.sqrt(both)), freedom, float(np.ptp(offset))


def _parts(xyz: Floats, metre: float) -> Sides | None:
    """Levels on both sides of a straight line across a surface, if a step there explains it.

    A slope explains three quarters as a step, waves and noise less; two levels nearly all.
    """
    means = np.array([xyz[some].mean(axis=0) for some in even_blocks(xyz, FINE)])
    if len(means) < FINE:
        return None
    z = means[:, 2] - means[:, 2].mean()
    best, parts = STEPPED * float(z @ z), None
    few = len(z) // 10
    for angle in np.arange(DIRECTIONS) * math.pi / DIRECTIONS:
        towards = math.cos(angle), math.sin(angle)
        along = means[:, :2] @ towards
        order = np.argsort(along, kind="stable")
        sums, count = np.cumsum(z[order])[:-1], np.arange(1, len(z))
        explained = sums**2 * (1 / count + 1 / (len(z) - count))
        at = few + int(np.argmax(explained[few:-few]))
        if explained[at] > best:
            best = float(explained[at])
            sides = [float(np.median(means[some, 2])) for some in np.split(order, [at + 1])]
            line = float(along[order[at : at + 2]].mean())
            sign = 1 if sides[0] < sides[1] else -1
            towards = sign * towards[0], sign * towards[1]
            parts = Sides(min(sides), max(sides), towards, sign * line)
    return parts if parts and parts.upper - parts.lower >= DAYS * metre else None


def _rounding(heights: Floats, step: float) -> float:
    """Standard error of a mean by the rounding of the heights.

    Heights on calm water are all rounded the same way, and the mean is as wrong as each of them.
    Noise makes them fall on several steps, and the error of the mean fade as the Fourier transform
    of its distribution does at one over the step (Widrow and Kollar 2008, quantization theorem).
    """
    if not step:
        return 0.0
    noise = max(float(np.var(heights)) - step**2 / 12, 0.0)  # Sheppard's correction
    return step / math.sqrt(12) * math.exp(-2 * math.pi**2 * noise / step**2)


def two_levels_fit(z: Floats, fit: Floats) -> bool:
    """Whether two levels explain heights, of shape (n,), better than a fit to them does."""
    upper = z >= otsu_threshold(z)
    levels = np.where(upper, z[upper].mean(), z[~upper].mean())
    return bool(((z - levels) ** 2).sum() < ((z - fit) ** 2).sum())


def even_blocks(xy: Floats, most: int = BLOCKS) -> list[Ints]:
    """Indices of points in compact blocks that hold equally many, the most if there are enough.

    All blocks at once are cut in halves across their longer sides.
    """
    order, first, count = np.arange(len(xy)), np.zeros(1, np.int64), np.array([len(xy)])
    while len(count) < most and len(xy) >= 2 * len(count):
        x, y = xy[order, :2].T
        wide, high = (np.maximum.reduceat(v, first) - np.minimum.reduceat(v, first) for v in (x, y))
        along = np.where(np.repeat(high > wide, count), y, x)
        order = order[np.lexsort((along, np.repeat(np.arange(len(count)), count)))]
        count = np.stack([(count + 1) // 2, count // 2], axis=1).ravel()
        first = np.cumsum(count) - count
    return np.split(order, first[1:])


def edge_level(
    xyz: Floats, amid: NDArray[np.bool_], start: float, metre: float, step: float = 0.0
) -> Level:
    """Level of a water body without returns, from points on its shore.

    The lowest points on a bank lie between the level and a spacing up the slope: their heights
    begin at the level. That is where their number per height reaches half of its most. But if
    waves sent returns from among them, they begin in a trough, and the level is nearer to their
    lower quartile. Few heights do not tell which: how far these are apart is part of the error. So
    is how far the lowest heights are below: most of a shore may be a ledge above the water.

    Ground that is seen amid a body is not below its level, but for a few errors. Where it was
    poured up to a ledge all round, points on the bank say that this was too high.

    Parameters
    ----------
    xyz, start, metre, step : see :func:`level_of`
    amid : array of shape (n,), points within the body rather than around it
    """
    heights = np.sort(xyz[:, 2])
    few = max(FEWEST, math.ceil(FEW * np.count_nonzero(amid)))
    if np.count_nonzero(amid) >= few:
        seen = float(np.partition(xyz[amid, 2], few - 1)[few - 1])
        start = seen if seen < start - EDGE * metre else start
    heights = heights[abs(heights - start) <= EDGE * metre]
    if len(heights) < FEWEST:
        rough = MOST_SIGMA * metre
        return Level(start, rough, math.inf, rough, len(heights), basis="shore")
    width = BIN * metre
    rng = np.random.default_rng(0)
    drawn = np.sort(rng.choice(heights, (RESAMPLED, len(heights))), axis=1)
    scatter = float(np.std([_onset(some, start, width) for some in drawn]))
    level = _onset(heights, start, width)
    waves = float(np.quantile(heights, FOOT)) - level
    ledge = max(level - float(np.quantile(heights, FEW)), 0.0)
    error = math.hypot(scatter, width / math.sqrt(12), step / math.sqrt(12), waves, ledge)
    return Level(level, error, math.inf, width, len(heights), basis="shore")


def _onset(heights: Floats, last: float, width: float) -> float:
    """Where the number of sorted heights per width reaches half of its most up to a last height."""
    at = np.arange(heights[0], max(last, heights[0]) + width, width / 10)
    many = np.searchsorted(heights, at + width) - np.searchsorted(heights, at)
    return float(at[np.argmax(many >= many.max() / 2)] + width / 2)
