"""Polynomials through the vertices of lines, and how well two of them agree (Odabaş 2018)."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from math import comb
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from algorithms.shared.routes import IndexedRoute, Route, farthest
from toolbox.errors import DataError

Array = NDArray[np.float64]
Row = dict[str, Any]
PIECES = 2000  # of a curve, to take distances
WITHIN = 1e-6  # metres


class PolynomialCurve(NamedTuple):
    """A polynomial y of x.

    Attributes
    ----------
    centred : coefficients of powers of x - centre, for y - centre, the constant first
    low, high : the range of x of its points
    r2, rmse : how well it fits its own points
    """

    centred: Array
    low: float
    high: float
    r2: float | None
    rmse: float

    @classmethod
    def fit(cls, points: Array, centre: Array, degree: int) -> PolynomialCurve:
        """Polynomial of a degree through points by least squares, in x scaled to -1..1.

        The scaling keeps the digits that large coordinates would lose.

        Parameters
        ----------
        points : array of shape (n, 2), metres
        centre : array of shape (2,)

        Raises
        ------
        DataError
            The points have too few different x for the degree.
        """
        x, y = (points - centre).T
        if (count := len(np.unique(x))) <= degree:
            raise DataError(
                f"polynomial: degree {degree} needs vertices at {degree + 1} different x, "
                f"there are {count}"
            )
        made = Polynomial.fit(x, y, degree).convert()
        centred = np.zeros(degree + 1)
        centred[: len(made.coef)] = made.coef
        left = y - Polynomial(centred)(x)
        spread = float(((y - y.mean()) ** 2).sum())
        r2 = 1 - float((left**2).sum()) / spread if spread else None
        rmse = float(np.sqrt((left**2).mean()))
        return cls(centred, float(x.min()), float(x.max()), r2, rmse)

    def uncentred(self, centre: Array) -> Array:
        """Coefficients of the powers of x, not centred, by exact arithmetic."""
        x0, y0 = (Fraction(float(value)) for value in centre)
        exact = [Fraction(float(value)) for value in self.centred]
        found = [
            sum(
                (
                    c * comb(k, power) * (-x0) ** (k - power)
                    for k, c in enumerate(exact)
                    if k >= power
                ),
                Fraction(0),
            )
            for power in range(len(exact))
        ]
        found[0] += y0
        return np.array([float(value) for value in found])


def curve_rows(own: Array, reference: Array, degree: int) -> Iterator[Row]:
    """Table rows: coefficients of both curves, their fit, and how well they agree.

    Parameters
    ----------
    own, reference : vertices, arrays of shape (n, 2) and (m, 2), metres
    """
    centre = reference.mean(axis=0)
    one, other = (
        PolynomialCurve.fit(own, centre, degree),
        PolynomialCurve.fit(reference, centre, degree),
    )
    for name, value in zip("xy", centre, strict=True):
        yield _row(f"{name}0", value, value, "m", "centre: mean of the vertices of the reference")
    for power, (a, b) in enumerate(zip(one.centred, other.centred, strict=True)):
        yield _row(f"c{power}", a, b, _unit(power), f"y - y0 per (x - x0)^{power}, centred")
    plain = zip(one.uncentred(centre), other.uncentred(centre), strict=True)
    for power, (a, b) in enumerate(plain):
        what = f"y per x^{power}: of no use unless with all its digits"
        yield _row(f"p{degree + 1 - power}", a, b, _unit(power), what)
    yield _row("r2", one.r2, other.r2, "1", "fit of each curve to its own vertices; no agreement")
    yield _row("rmse", one.rmse, other.rmse, "m", "the same in y")
    yield from _agreement(one, other)


def _agreement(one: PolynomialCurve, other: PolynomialCurve) -> Iterator[Row]:
    """Table rows: differences of two curves over the x that both cover; none if they share no x."""
    low, high = max(one.low, other.low), min(one.high, other.high)
    width = max(high - low, 0.0)
    yield _row("common", width, None, "m", "range of x that both lines have")
    if not width:
        return
    apart = Polynomial(one.centred) - Polynomial(other.centred)
    square, turns = apart**2, apart.deriv().roots() if apart.degree() > 1 else np.empty(0)
    inner = turns.real[(abs(turns.imag) < 1e-9) & (turns.real > low) & (turns.real < high)]
    size = float(np.abs(apart(np.array([low, high, *inner]))).max())

    def mean(values: Polynomial) -> float:
        whole = values.integ(lbnd=low)
        return float(whole(high) / width)

    yield _row("mean_dy", mean(apart), None, "m", "mean of curve minus reference curve, in y")
    yield _row("rms_dy", max(mean(square), 0.0) ** 0.5, None, "m", "root mean square of the same")
    yield _row("max_dy", size, None, "m", "largest size of the same")
    x = np.linspace(low, high, PIECES + 1)
    none = np.full(len(x), np.nan)
    a, b = (
        Route.of([np.column_stack([x, Polynomial(curve.centred)(x), none])])
        for curve in (one, other)
    )
    to, back = IndexedRoute(b), IndexedRoute(a)
    there, here = to.feet(a.nodes[:, :2]), back.feet(b.nodes[:, :2])
    longest = max(farthest(a, there, to, WITHIN), farthest(b, here, back, WITHIN))
    yield _row("hausdorff", longest, None, "m", "Hausdorff distance of the curves")


def _row(measure: str, own: float | None, reference: float | None, unit: str, text: str) -> Row:
    numbers = [None if value is None else float(value) for value in (own, reference)]
    return {
        "measure": measure,
        "lines": numbers[0],
        "reference": numbers[1],
        "unit": unit,
        "meaning": text,
    }


def _unit(power: int) -> str:
    return {0: "m", 1: "1", 2: "1/m"}.get(power, f"1/m{power - 1}")
