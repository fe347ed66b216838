"""Errors of two classes, such as ground and objects, with the intervals of independent points.

References
----------
Sithole, G. and Vosselman, G. (2004). Experimental comparison of filter algorithms for bare-Earth
extraction from airborne laser scanning point clouds. ISPRS Journal 59(1-2), 85-101.
Cohen, J. (1960). A coefficient of agreement for nominal scales. Educational and Psychological
Measurement 20(1), 37-46.
Heipke, C. et al. (1997). Evaluation of automatic road extraction. IAPRS 32(3-2W3), 47-56:
correctness, completeness and quality.
Wilson, E. B. (1927). Probable inference, the law of succession, and statistical inference. Journal
of the American Statistical Association 22(158), 209-212: intervals of shares.
Fleiss, J. L., Cohen, J. and Everitt, B. S. (1969). Large sample standard errors of kappa and
weighted kappa. Psychological Bulletin 72(5), 323-327.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROUNDING = 1e-12  # what is left of a difference of shares that is zero
CONFIDENCE = 1.959963984540054  # standard deviations of a normal distribution that hold 95 %


@dataclass(frozen=True)
class Counts:
    """Counts of points by class and reference (Sithole and Vosselman), and measures from them.

    a: ground kept, b: ground lost, c: objects kept as ground, d: objects removed. A measure whose
    denominator is zero is None.
    """

    a: int
    b: int
    c: int
    d: int

    @classmethod
    def of(cls, said: NDArray[np.bool_], true: NDArray[np.bool_]) -> Counts:
        """Count from two arrays of shape (n,): positive as classified, and in the reference."""
        a, said_count, true_count = int((said & true).sum()), int(said.sum()), int(true.sum())
        b, c = true_count - a, said_count - a
        return cls(a, b, c, len(said) - a - b - c)

    @property
    def total(self) -> int:
        return self.a + self.b + self.c + self.d

    @property
    def type_1(self) -> float | None:
        return self._shares["type_1"][1].percent

    @property
    def type_2(self) -> float | None:
        return self._shares["type_2"][1].percent

    @property
    def total_error(self) -> float | None:
        return self._shares["total_error"][1].percent

    @property
    def correctness(self) -> float | None:
        return self._shares["correctness"][1].percent

    @property
    def completeness(self) -> float | None:
        return self._shares["completeness"][1].percent

    @property
    def quality(self) -> float | None:
        return self._shares["quality"][1].percent

    @property
    def kappa(self) -> float | None:
        """(observed - chance) / (1 - chance); None when only one class occurs."""
        if not self.total or (chance := self._chance) == 1:
            return None
        more = 1 - (self.b + self.c) / self.total - chance
        return 0.0 if abs(more) <= ROUNDING else more / (1 - chance)

    @property
    def kappa_interval(self) -> tuple[float | None, float | None]:
        """Limits of the 95 % confidence interval (Fleiss, Cohen and Everitt 1969, equation 13).

        None where the formula has no spread, as without an error: it would say that none can be.
        """
        if (kappa := self.kappa) is None:
            return None, None
        cells = np.array([[self.a, self.b], [self.c, self.d]]) / self.total
        rows, columns, chance = cells.sum(axis=1), cells.sum(axis=0), self._chance
        left = 1 - (self.b + self.c) / self.total
        beside = np.add.outer(columns, rows)  # of cell i, j: column i and row j
        same = np.diag(cells) * ((1 - chance) - np.diag(beside) * (1 - left)) ** 2
        mixed = cells * beside**2
        spread = same.sum() + (1 - left) ** 2 * (mixed.sum() - np.trace(mixed))
        spread -= (left * chance - 2 * chance + left) ** 2
        if spread <= ROUNDING:
            return None, None
        error = math.sqrt(spread / self.total) / (1 - chance) ** 2
        return max(kappa - CONFIDENCE * error, -1.0), min(kappa + CONFIDENCE * error, 1.0)

    @property
    def _chance(self) -> float:
        """Agreement by chance of two independent classifications with these totals."""
        a, b, c, d = self.a, self.b, self.c, self.d
        return ((a + b) * (a + c) + (c + d) * (b + d)) / self.total**2

    @property
    def _shares(self) -> dict[str, tuple[str, Proportion, str]]:
        """Measures that are shares, by name: label, proportion and formula."""
        a, b, c, d = self.a, self.b, self.c, self.d
        return {
            "type_1": ("Type I", Proportion(b, a + b), "b / (a + b)"),
            "type_2": ("Type II", Proportion(c, c + d), "c / (c + d)"),
            "total_error": (
                "total error",
                Proportion(b + c, self.total),
                "(b + c) / (a + b + c + d)",
            ),
            "correctness": ("correctness", Proportion(a, a + c), "a / (a + c)"),
            "completeness": ("completeness", Proportion(a, a + b), "a / (a + b)"),
            "quality": ("quality", Proportion(a, a + b + c), "a / (a + b + c)"),
        }

    def rows(self, unmatched: int, absent: int) -> Iterator[dict[str, Any]]:
        """One row per measure, in the order of the literature."""
        yield _row("a", self.a, (None, None), "points", "positive in both")
        yield _row("b", self.b, (None, None), "points", "positive in the reference only")
        yield _row("c", self.c, (None, None), "points", "positive in the classification only")
        yield _row("d", self.d, (None, None), "points", "positive in neither")
        meaning = "without a counterpart, not counted above"
        yield _row("unmatched", unmatched, (None, None), "points", meaning)
        meaning = "of the reference without a counterpart, not counted above"
        yield _row("absent", absent, (None, None), "points", meaning)
        for measure, share, meaning in self._shares.values():
            if measure == "correctness":
                meant = "agreement beyond chance"
                yield _row("kappa", self.kappa, self.kappa_interval, "1", meant)
            yield _row(measure, share.percent, share.interval, "%", meaning)

    def row(self, unmatched: int) -> dict[str, Any]:
        """Row with all measures side by side, shares in percent."""
        found: dict[str, Any] = {"points": self.total, "unmatched": unmatched}
        found |= {"a": self.a, "b": self.b, "c": self.c, "d": self.d}
        for name, (_, share, _) in self._shares.items():
            found |= _with_limits(name, share.percent, share.interval)
        return found | _with_limits("kappa", self.kappa, self.kappa_interval)


@dataclass(frozen=True)
class Proportion:
    """A counted share of a whole."""

    part: int
    whole: int

    @property
    def percent(self) -> float | None:
        """The share in percent; None if the whole is zero."""
        return 100 * self.part / self.whole if self.whole else None

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Limits of the 95 % confidence interval in percent (Wilson 1927)."""
        if not self.whole:
            return None, None
        n, p, z = self.whole, self.part / self.whole, CONFIDENCE
        middle = (p + z * z / (2 * n)) / (1 + z * z / n)
        half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
        # All or nothing found: the limit is exact, and must not miss it by a rounding.
        low = 0.0 if self.part == 0 else 100 * (middle - half)
        high = 100.0 if self.part == self.whole else 100 * (middle + half)
        return low, high


def _row(
    measure: str,
    value: float | None,
    interval: tuple[float | None, float | None],
    unit: str,
    meaning: str,
) -> dict[str, Any]:
    low, high = interval
    limits = {"value": value, "low": low, "high": high}
    return {"measure": measure} | limits | {"unit": unit, "meaning": meaning}


def _with_limits(
    name: str, value: float | None, interval: tuple[float | None, float | None]
) -> dict[str, Any]:
    return {name: value, f"{name}_low": interval[0], f"{name}_high": interval[1]}
