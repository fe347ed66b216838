"""What tells water from other places: few returns, darkness, a level surface, higher banks.

Near-infrared light is absorbed by water or mirrored away from it, so a lake is a hole in the data,
or flat and dark with few returns. But shadows behind buildings and gaps between strips are holes
too, and roads and sports grounds are flat and dark.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import fdtrc

from algorithms.shared.otsu import otsu_threshold
from algorithms.shared.water_surface import WIDEST
from algorithms.shoreline._cells import (
    KNOWN,
    LEVEL,
    REACH,
    CellGrid,
    Tilt,
    around,
    median_of_counts,
    window,
)
from algorithms.shoreline._level import BLOCKS, FINE, even_blocks, two_levels_fit

Ints = NDArray[np.int64]
Floats = NDArray[np.floating[Any]]
Doubles = NDArray[np.float64]

# Lengths in metres.
STEP = 0.10  # above the level where a first look at a body ends
DROP = 0.25  # below the level: water does not stay above such ground
SPARSE = 0.5  # of the density of the shore: pulses were lost
FEWER = 0.75  # half of the way from SPARSE to all: enough for what is level without a shape
DARK = 0.5  # separation of intensities on water and on the shore, 0 for none, 1 for a full one
LEVEL_SPREAD = 0.06  # m between the heights of a surface that is level
SIGMAS = 1.683  # standard deviations of a normal distribution between its 20 % and its 80 %
BENT = 0.02  # m between places of a dark surface that is none of water: strips fit to so much
SHAPE = 6  # terms of a quadratic surface
CHANCE = 0.001  # that noise has a shape so clear: of flat waters that are very dark one in 1000
PAVED = 0.005  # slope: half of what drains paved ground at least; calm rivers fall by less
PIECES = 4  # of a river, along it, of which each has a shape across
FOR_SHAPE = 20  # cells that tell that shape
ENDS = 0.1, 0.9  # share of a river that is its end
LONG = 2.0  # length of a place that falls as a river may, in widths
CORE = 0.3  # of the distance to the middle of a body, from where its level is taken
RIM = 3.0  # m from a shore, to where a bank reaches but no parapet
WALL = 1.0  # m that a wall is high
BANK = 20.0  # m from a shore, to where it rises by what water does not run over
BANKS = 0.75  # of the rim of a water: rivers go on beyond the data, and at rapids
WIDE = 0.2  # of its cells are not at the edge of a hole that nothing else speaks for
WITHOUT_WAVES = 0.12  # of the root of the cells of a body, over which heights are averaged
COMPACT = 0.8  # of the cells of a part at one level are in one piece
FEW = "few returns"  # evidence that thin points on land give, too
LEVEL_ALONE = "level"  # evidence that is not enough, unless it is the level of other water
LARGE = 500.0  # m2 of a level surface that need not be dark
VERY_DARK = 0.75  # separation, as DARK, of a surface that returns its pulses


@dataclass(frozen=True)
class Body:
    """A water body as a set of cells, with the evidence for it.

    Attributes
    ----------
    cells : array of shape (n,), indices into the raveled cells, rising
    level : a first estimate, in the unit of the data, to be added to the tilt
    tilt : of a river
    lost : density of points on the water over that on its shore
    dark : separation of the intensities on water and shore, 0 to 1
    evidence : what speaks for water
    waves : height above the level up to which a cell is on open water, rather than on a bank
    amid : separation of the intensities if other water beside it counts as shore, as `dark` else
    """

    cells: Ints
    level: float
    tilt: Tilt
    lost: float
    dark: float
    evidence: str
    waves: float = math.inf
    amid: float = 0.0

    @property
    def few(self) -> bool:
        """Whether it returns few pulses, which banks and roads do not."""
        return self.lost <= SPARSE

    @property
    def holds(self) -> bool:
        """Whether it may stand above other water beside it, as behind a sluice or a weir.

        A bank of that water returns its pulses, and is hardly darker than land and water around.
        """
        return self.few or self.amid >= VERY_DARK

    @property
    def doubtful(self) -> bool:
        """Whether its level is all that speaks for it: squares and cuttings are level, too."""
        return self.evidence == LEVEL_ALONE

    def rough(self, metre: float) -> bool:
        """Whether waves are known to be higher than islands and banks may be."""
        return STEP * metre < self.waves < math.inf


def flows(cells: CellGrid, some: Ints, tilt: Tilt) -> bool:
    """Whether a tilted place falls along itself alone, from one edge of the data to another.

    A river does, and not much, where it is calm. Paved ground is drained: it falls or bends across
    as well, or ends in the data.
    """
    along = tilt.at(some // cells.lattice.cols, some % cells.lattice.cols)
    low, high = np.quantile(along, ENDS)
    cut = ~cells.whole.ravel()[some]
    if not (is_long(cells, some) and cut[along <= low].any() and cut[along >= high].any()):
        return False
    core = core_of(cells, some)
    drained = _drained(cells, core[np.isfinite(cells.low.ravel()[core])])
    return max(drained, math.hypot(tilt.south, tilt.east) / cells.lattice.cell) <= PAVED


def is_long(cells: CellGrid, some: Ints) -> bool:
    """Whether cells lie along a line, as rivers and roads do."""
    return _along_a_line(some // cells.lattice.cols, some % cells.lattice.cols)


def _along_a_line(south: NDArray[Any], east: NDArray[Any]) -> bool:
    if len(south) < 2:
        return False
    spread = np.linalg.eigvalsh(np.cov(south, east))
    wide, long = np.sqrt(np.maximum(spread, 0))  # of one row it may be rounded below 0
    return bool(long >= LONG * wide)


def _drained(cells: CellGrid, some: Ints) -> float:
    """How much a long place rises to one side, or to its middle: the median of pieces along it.

    Waves are averaged, which local slopes would be of.
    """
    if len(some) < FOR_SHAPE:
        return math.inf
    spots = np.column_stack([some // cells.lattice.cols, some % cells.lattice.cols]).astype(float)
    centred = spots - spots.mean(axis=0)
    across, along = (centred @ np.linalg.eigh(np.cov(centred.T))[1]).T
    order = np.argsort(along, kind="stable")
    steep = []
    for piece in np.array_split(order, PIECES):
        if len(piece) >= FOR_SHAPE:
            line = np.vander(along[piece] - along[piece].mean(), 3)
            aside = across[piece] - line @ np.linalg.lstsq(line, across[piece], rcond=None)[0]
            shape = np.column_stack([aside, np.abs(aside), line])
            rise = np.linalg.lstsq(shape, cells.low.ravel()[some[piece]], rcond=None)[0][:2]
            steep.append(np.abs(rise).max() / cells.lattice.cell)
    return float(np.median(steep)) if steep else math.inf


def judge(
    cells: CellGrid,
    body: Ints,
    level: float,
    tilt: Tilt,
    ring: Ints,
    shore: Ints,
    *,
    rough: bool = False,
) -> tuple[Body | None, str]:
    """The body with the evidence that it is water, or none if that is too weak, and why.

    An area that returns no pulses is water, unless it is narrow as shadows are. One that returns
    them must be level, and very dark or large. A rough one must be dark in any case. What one
    flight covers beside ground that two cover has fewer points, but no banks.

    Parameters
    ----------
    ring : the cells of its shore, but for other water
    shore : these and those of other water, see :func:`shore_of`
    """
    count = cells.count.ravel()
    here = body[count[body] > 0]
    lost = _lost(cells, body, ring)
    if lost <= FEWER < (for_each := _lost(cells, body, ring, by_flights=True)):
        lost = for_each
    amid = darkness(cells, body, shore)
    dark = amid if rough else darkness(cells, body, ring)  # wet banks are rough and dark, too
    classed = cells.water.ravel()[body].sum() > 0.5 * count[body].sum()
    core = _known(cells, body) if tilt == LEVEL else body[:0]
    level_enough = _is_level(cells, core)
    shaped = level_enough and _bent(cells, core, surely=dark >= VERY_DARK)
    fewer = SPARSE < lost <= FEWER and level_enough and not shaped
    across = tilt != LEVEL and dark >= VERY_DARK and flows(cells, body, tilt)
    reasons = {
        FEW: lost <= SPARSE,
        "fewer returns": fewer and _beside_banks(cells, body, level),
        "level": level_enough,
        "level across": across,
        "dark": dark >= DARK and not shaped,
        "class": classed,
    }
    few = lost <= SPARSE and (dark >= DARK or level_enough or is_wide(cells, body))
    large = len(here) >= LARGE * cells.metre**2 / cells.area
    enough = few or classed or across or (level_enough and (dark >= VERY_DARK or large))
    if not enough or (rough and dark < DARK):
        return None, (
            f"it returns {lost:.0%} of the pulses that its shore does, its intensities separate by "
            f"{dark:.2f} (1 is fully), and it is {'' if level_enough else 'not '}level"
        )
    if not (few or classed) and _raised(cells, body, level):
        return None, f"ground {WALL:g} m lower is close behind its rim, as around a roof"
    evidence = ", ".join(name for name, holds in reasons.items() if holds)
    return Body(body, cells.base + level, tilt, lost, dark, evidence, amid=amid), ""


def _lost(cells: CellGrid, body: Ints, ring: Ints, *, by_flights: bool = False) -> float:
    """Number of points in a cell of a body over that on its shore; 1 where it is not known.

    Cells at the edge of the data lie only in part in them: they do not count. With `by_flights`
    the points of a cell are those for each flight that covers it: ground that one covers has half
    of those where two do.
    """
    whole = cells.whole.ravel()
    body, ring = body[whole[body]], ring[whole[ring]]
    if not (len(body) and len(ring)):
        return 1.0
    count, flights = cells.count.ravel(), cells.flights.ravel()
    if by_flights:
        return float((count[body] / flights[body]).mean() / np.median(count[ring] / flights[ring]))
    return float(count[body].mean() / median_of_counts(count[ring]))


def _beside_banks(cells: CellGrid, body: Ints, level: float) -> bool:
    """Whether ground beside most of the rim of a place is higher than water runs over.

    Ground that one flight covers has half of the points of that which two cover, and level ground
    ends where it rises by little, or at the edge of the data, beyond which no bank is known.
    """
    width = max(REACH, math.ceil(BANK * cells.metre / cells.lattice.cell))
    (top, left), wet = window(cells.lattice, body, width)
    ground = cells.middle[top : top + wet.shape[0], left : left + wet.shape[1]]
    ground = np.where(wet | np.isnan(ground), -np.inf, ground)
    banks = ndimage.maximum_filter(ground, 2 * width + 1) >= level + DROP * cells.metre
    rim = ndimage.binary_dilation(wet, np.ones((3, 3), bool)) & ~wet
    return bool(banks[rim].mean() >= BANKS)


def looks_like_water(cells: CellGrid, some: Ints, shore: Ints) -> bool:
    """Whether cells return few of the pulses that those of a shore do, or are darker."""
    return _lost(cells, some, shore) <= SPARSE or darkness(cells, some, shore) >= DARK


def _raised(cells: CellGrid, body: Ints, level: float) -> bool:
    """Whether the ground is lower close behind the rim of a body, as around a flat roof."""
    width = max(2, math.ceil(RIM * cells.metre / cells.lattice.cell))
    ring = around(cells.lattice, body, width, width - 1)
    heights = cells.low.ravel()[ring]
    heights = heights[np.isfinite(heights)]
    return bool(len(heights) and np.median(heights) < level - WALL * cells.metre)


def darkness(cells: CellGrid, body: Ints, ring: Ints) -> float:
    """Separation of the intensities in the cells of a body and of its shore."""
    bright, count = cells.bright.ravel(), cells.count.ravel()
    return separation(bright[body[count[body] > 0]], bright[ring])


def separation(water: Floats, land: Floats) -> float:
    """Largest difference of the distribution functions of two samples, where water is darker."""
    if not (len(water) and len(land)):
        return 0.0
    water, land = np.sort(water), np.sort(land)
    at = np.concatenate([water, land])
    below = [np.searchsorted(some, at, side="right") / len(some) for some in (water, land)]
    return max(0.0, float((below[0] - below[1]).max()))


def is_wide(cells: CellGrid, hole: Ints) -> bool:
    """Whether enough cells of a hole are not at its edge, unlike those of gaps and shadows."""
    return len(core_of(cells, hole, 0.0)) >= WIDE * len(hole)


def _known(cells: CellGrid, some: Ints) -> Ints:
    """Cells far from the edge of some around which heights are known."""
    core = core_of(cells, some)
    return np.asarray(core[np.isfinite(cells.middle.ravel()[core])])


def _is_level(cells: CellGrid, core: Ints) -> bool:
    """Whether cells lie on one level surface, more exactly than fields do.

    Waves may be longer than a cell and its neighbours, so the means of compact blocks are compared.
    They still differ, by no more than the waves are high.
    """
    if len(core) < KNOWN:
        return False
    middle, waves = cells.middle.ravel()[core], waves_of(cells, core)
    return _flat(cells, core, middle, waves) or _two_levels(cells, core, middle, waves)


def is_bent(cells: CellGrid, body: Body) -> bool:
    """Whether a level body as it is in the end has a shape: it may have grown from a flat part.

    A place is asked when it is found, too, and the middle of a crown or of a twist is flat.
    """
    return _bent(cells, _known(cells, body.cells), surely=body.dark >= VERY_DARK)


def _bent(cells: CellGrid, core: Ints, *, surely: bool) -> bool:
    """Whether cells that are nearly level lie on a tilted or curved surface, as paved ground does.

    Water has no shape: what the heights of its blocks differ by are waves, noise, and steps between
    flights. Two levels explain all of these better than a quadratic surface does, as noise is
    halved by its median, and a step is one. Only rivers fall, which are long.

    With `surely` the shape must also be more than chance: see :func:`_is_by_chance`.
    """
    heights = cells.middle.ravel()[core].astype(float)
    spots = np.column_stack([core // cells.lattice.cols, core % cells.lattice.cols]).astype(float)
    parts = even_blocks(spots, FINE)
    if len(parts) < BLOCKS:
        return False
    z = np.array([heights[part].mean() for part in parts])
    z, fit, _ = _fitted(np.array([spots[part].mean(axis=0) for part in parts]), z)
    bent = np.ptp(fit) >= BENT * cells.metre and not two_levels_fit(z, fit)
    return bool(bent and not (surely and _is_by_chance(cells, core, spots)))


def _is_by_chance(cells: CellGrid, core: Ints, spots: Floats) -> bool:
    """Whether noise alone may be the shape of a surface, by the F-test of independent heights.

    Medians of cells side by side share most of their heights, so those of a few dozen cells lie on
    a smooth surface though the water is flat. The lowest heights themselves share none.
    """
    low = cells.low.ravel()[core].astype(float)
    off = abs(low - cells.middle.ravel()[core])
    near = off <= WIDEST * waves_of(cells, core)  # but for boats and errors
    z, fit, terms = _fitted(spots[near], low[near])
    freedom = len(z) - SHAPE
    if freedom <= 0:
        return False
    ratio = (fit @ fit / terms) / max(float(((z - fit) ** 2).sum()) / freedom, 1e-12)
    return bool(fdtrc(terms, freedom, ratio) > CHANCE)


def _fitted(spots: Floats, heights: Floats) -> tuple[Doubles, Doubles, int]:
    """Heights about their mean, a quadratic surface through them, and its terms but for that.

    Of a long place they are those about a plane, which has two of the terms.
    """
    south, east = (spots - spots.mean(axis=0)).T
    design = np.column_stack([np.ones(len(south)), south, east, south**2, south * east, east**2])
    known = 3 if _along_a_line(south, east) else 1
    z = heights - design[:, :known] @ np.linalg.lstsq(design[:, :known], heights, rcond=None)[0]
    return z, design @ np.linalg.lstsq(design, z, rcond=None)[0], SHAPE - known


def waves_of(cells: CellGrid, some: Ints) -> float:
    """Standard deviation of the lowest heights in cells from those around."""
    off = (cells.low.ravel() - cells.middle.ravel())[some]
    off = off[np.isfinite(off)]
    return float(np.ptp(np.percentile(off, (20, 80)))) / SIGMAS if len(off) else 0.0


def _flat(cells: CellGrid, some: Ints, heights: Floats, waves: float) -> bool:
    """Whether heights at cells neither fall, nor sag, nor differ between blocks beyond waves."""
    cols, limit = cells.lattice.cols, LEVEL_SPREAD * cells.metre
    spots = np.column_stack([some // cols, some % cols])
    (top, left), inside = window(cells.lattice, some, 1)
    depth = ndimage.distance_transform_edt(inside)[spots[:, 0] - top, spots[:, 1] - left]
    centred = spots - spots.mean(axis=0)
    design = np.column_stack([np.ones(len(some)), centred, depth - depth.mean()])
    (_, south, east, inward), *_ = np.linalg.lstsq(design, heights.astype(float), rcond=None)
    fall = math.hypot(south, east) * math.sqrt(len(some))
    sag = abs(inward) * float(np.ptp(depth))  # hollows in land are deepest far from their edge
    means = [float(heights[block].mean()) for block in even_blocks(spots.astype(float))]
    low, high = np.percentile(means, (10, 90))
    return bool(max(fall, sag) <= limit and high - low <= math.hypot(limit, waves))


def _two_levels(cells: CellGrid, some: Ints, heights: Floats, waves: float) -> bool:
    """Whether heights at cells are of two flat parts side by side, as of flights on two days."""
    smooth = smoothed(cells, some, heights)
    upper = smooth >= otsu_threshold(smooth)
    for part in (upper, ~upper):
        labels, _ = ndimage.label(window(cells.lattice, some[part], 0)[1])
        of_one = np.bincount(labels.ravel())[1:].max(initial=0)
        if part.sum() < KNOWN or of_one < COMPACT * part.sum():
            return False
        if not _flat(cells, some[part], heights[part], waves):
            return False
    apart = float(heights[upper].mean() - heights[~upper].mean())
    return apart <= DROP * cells.metre


def smoothed(cells: CellGrid, some: Ints, heights: Floats) -> Floats:
    """Heights at cells without waves, which are averaged over a share of the place."""
    (top, left), inside = window(cells.lattice, some, 0)
    spot = some // cells.lattice.cols - top, some % cells.lattice.cols - left
    held, mean = np.zeros(inside.shape), float(heights.mean())
    held[spot] = heights - mean
    reach = WITHOUT_WAVES * math.sqrt(len(some))
    smooth = ndimage.gaussian_filter(held, reach) / np.maximum(
        ndimage.gaussian_filter(inside.astype(float), reach), 1e-9
    )
    return np.asarray(smooth[spot] + mean)


def core_of(cells: CellGrid, some: Ints, share: float = CORE, among: Ints | None = None) -> Ints:
    """Indices of the cells far from the edge of some, where flat banks may count as water.

    Parameters
    ----------
    cells : see :class:`CellGrid`
    some : cells; gaps between them of a cell or two are filled
    share : of the way from the edge to the middle that is left out, a cell at least
    among : cells that may be filled; all by default
    """
    (top, left), mask = window(cells.lattice, some, 1)
    wet = mask | ndimage.binary_closing(mask, np.ones((3, 3), bool))
    if among is not None:
        r, c = among // cells.lattice.cols - top, among % cells.lattice.cols - left
        here = (r >= 0) & (r < mask.shape[0]) & (c >= 0) & (c < mask.shape[1])
        allowed = np.zeros_like(mask)
        allowed[r[here], c[here]] = True
        wet &= allowed
    depth = ndimage.distance_transform_edt(wet)
    r, c = np.nonzero((depth > 1) & (depth >= share * depth.max()))
    return np.asarray((r + top) * cells.lattice.cols + c + left)
