"""Returns of pulses: what their numbers say, and where they cannot be believed.

Some old surveys are lists of first and of last returns. Each pulse is in both then, and claims two
returns, also where it hit one surface and has one place twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from toolbox.context import log
from toolbox.data import PointCloud

NAMES = ("return_number", "number_of_returns")
SAME_PLACE = 0.3  # metres between two returns that are one: pulses of 4 ns are 1.2 m long, and
# surfaces nearer to each other than half of that give one return
MANY = 0.01  # share of points with impossible numbers that is worth a warning
LEAST_LAST = (
    0.5  # last returns over first ones of pulses with several; whole surveys have 0.86 to 1.03
)

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ReturnNumbers:
    """The returns of n points.

    Attributes
    ----------
    number, count : arrays of shape (n,), return number and number of returns of the pulse; of 16
        bits where they came in 8, as in LAS, which are looked at faster than 64
    """

    number: NDArray[np.integer]
    count: NDArray[np.integer]

    @classmethod
    def of(cls, cloud: PointCloud) -> ReturnNumbers:
        """The numbers of a cloud; zeros where it has none.

        Examples
        --------
        >>> ReturnNumbers.of(PointCloud(np.zeros((2, 3)))).number
        array([0, 0])
        """
        if not has_numbers(cloud):
            return cls(np.zeros(len(cloud), np.int64), np.zeros(len(cloud), np.int64))
        given = [cloud[name] for name in NAMES]
        narrow = all(values.dtype == np.uint8 for values in given)
        wide: type[np.integer] = np.int16 if narrow else np.int64
        return cls(*(np.asarray(values, wide) for values in given))

    @property
    def known(self) -> Mask:
        """True where the number is one of 1 to the number of returns, shape (n,)."""
        known: Mask = (self.number >= 1) & (self.number <= self.count)
        return known

    @property
    def impossible(self) -> Mask:
        """True where the numbers contradict each other, as return 5 of 1; shape (n,).

        Zeros, which some files have for what is not known, do not.
        """
        stated: Mask = (self.number != 0) | (self.count != 0)
        return ~self.known & stated

    @property
    def in_lists(self) -> bool:
        """Whether no pulse has a single return, as in lists of first and of last returns."""
        known = self.known
        return bool(known.any() and not (self.count[known] == 1).any())


def has_numbers(cloud: PointCloud) -> bool:
    """Whether points have return numbers and numbers of returns.

    Examples
    --------
    >>> has_numbers(PointCloud(np.zeros((2, 3)), {"return_number": [1, 2]}))
    False
    """
    return set(NAMES) <= set(cloud.names)


def warn_of_impossible(found: ReturnNumbers, consequence: str) -> None:
    """Warn if many points have numbers that contradict each other.

    Parameters
    ----------
    consequence : what becomes of them, continues a sentence

    Examples
    --------
    >>> warn_of_impossible(ReturnNumbers(np.array([1, 2]), np.array([2, 2])), "they are left out")
    """
    wrong, count = found.impossible, np.count_nonzero(found.impossible)
    if count > MANY * len(wrong):
        first = int(np.argmax(wrong))
        log.warning(
            "%d of %d points have a return number that cannot be, such as return %d of %d; %s",
            count,
            len(wrong),
            found.number[first],
            found.count[first],
            consequence,
        )


def warn_of_missing(found: ReturnNumbers, consequence: str) -> None:
    """Warn if many pulses with several returns lack their last one.

    The numbers are wrong then, or only a part of the returns was handed over.

    Parameters
    ----------
    consequence : what becomes of the other returns, continues a sentence

    Examples
    --------
    >>> warn_of_missing(ReturnNumbers(np.array([1, 2]), np.array([2, 2])), "they are left out")
    """
    several = found.known & (found.count > 1)
    first = np.count_nonzero(several & (found.number == 1))
    last = np.count_nonzero(several & (found.number == found.count))
    if first > MANY * len(several) and last < LEAST_LAST * first:
        log.warning(
            "%d points are the first of several returns, but only %d are a last one: returns are "
            "missing, or their numbers are wrong; %s",
            first,
            last,
            consequence,
        )


def let_through(cloud: PointCloud, found: ReturnNumbers | None = None) -> Mask:
    """True for returns after which the pulse went on, array of shape (n,).

    In lists of first and last returns, a pulse that has one place in both did not go on. That is
    told from the points around, so that it holds in tiles, too.

    Parameters
    ----------
    found : the returns of the cloud, where they are known already

    Examples
    --------
    >>> returns = {"return_number": [1, 1, 2, 2], "number_of_returns": [2, 2, 2, 2]}
    >>> xyz = [[0, 0, 9.0], [5, 0, 1.0], [0, 0, 1.0], [5, 0, 1.02]]
    >>> let_through(PointCloud(xyz, returns))
    array([ True, False, False, False])
    """
    found = found or ReturnNumbers.of(cloud)
    warn_of_impossible(found, "they are taken for last returns")
    before = found.known & (found.number < found.count)
    if not (before.any() and found.in_lists):
        return before
    last = found.known & (found.number == found.count)
    if not last.any():
        return before
    from scipy.spatial import cKDTree  # of which most clouds have no need

    some = np.flatnonzero(before)
    tree = cKDTree(cloud.xyz[last])
    reach = SAME_PLACE * cloud.metre
    away, _ = tree.query(cloud.xyz[some], distance_upper_bound=reach)
    before[some[np.isfinite(away)]] = False
    log.info(
        "lists of first and last returns: of %d pulses %d have one place twice, and are single",
        len(some),
        len(some) - np.count_nonzero(before),
    )
    return before
