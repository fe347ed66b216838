"""A catenary from points of a wire: robust least squares, with covariance.

A wire of constant weight under horizontal tension hangs as z = z0 + c (cosh((u - u0) / c) - 1),
where u runs horizontally along it, c is tension over weight, and (u0, z0) the lowest point
(Chan and Lichti 2011, equations 2 and 3). The three are hard to tell apart where the sag is small,
so the fit is for the heights at both ends and the curvature 1 / c, which are not.

Wind swings a wire about the line between its ends; in plan it then bows with its sag.

References
----------
Chan, T. O. and Lichti, D. D. (2011). 3D catenary curve fitting for geometric calibration. ISPRS
Archives XXXVIII-5/W12, 259-264.
Beaton, A. E. and Tukey, J. W. (1974). The fitting of power series. Technometrics 16(2), 147-185.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from algorithms.corridor._curves import catenary_kernels as kernels
from algorithms.corridor._settings import SETTINGS

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Catenary:
    """Catenary of one wire in one span, in metres.

    Attributes
    ----------
    x, y : the start of the axis, in plan
    ex, ey : unit vector of the axis; u runs along it, v to the left of it
    length : u of the end; the wire begins at u = 0
    z_start, z_end : heights there
    curvature : 1 / c
    v0, v1 : offset from the axis, v = v0 + v1 u
    swing : tangent of the angle by which wind lifts it to the left
    rms : of the residuals square to the wire
    count : points that the fit rests on
    covariance : array of shape (3, 3), of z_start, z_end and curvature
    """

    x: float
    y: float
    ex: float
    ey: float
    length: float
    z_start: float
    z_end: float
    curvature: float
    v0: float = 0.0
    v1: float = 0.0
    swing: float = 0.0
    rms: float = 0.0
    count: int = 0
    covariance: Floats | None = None

    @property
    def c(self) -> float:
        """Horizontal tension over weight, metres."""
        return 1 / self.curvature

    @property
    def u0(self) -> float:
        """Distance along the axis of the lowest point, which may lie beyond the ends."""
        return _lowest(self.length, self.z_start, self.z_end, self.curvature)

    @property
    def z0(self) -> float:
        """Height of the lowest point."""
        return self.z_start - _hang(self.u0, self.curvature)

    @property
    def sag(self) -> float:
        """Greatest vertical distance below the chord."""
        slope = (self.z_end - self.z_start) / self.length
        u = self.u0 + math.asinh(slope) / self.curvature
        return float(self.z_start + slope * u - self.height(np.array(u)))

    @property
    def arc(self) -> float:
        """Length of the wire."""
        k, u0 = self.curvature, self.u0
        return (math.sinh(k * (self.length - u0)) + math.sinh(k * u0)) / k

    @property
    def parameters(self) -> int:
        """How many numbers it has: heights of both ends, curvature, a line in plan, and swing."""
        return 6 if self.swing else 5

    @property
    def variance_of_curvature(self) -> float:
        """Variance of the fitted curvature, 1 / square metre; infinite where it is not known."""
        return math.inf if self.covariance is None else float(self.covariance[2, 2])

    def height(self, u: Floats) -> Floats:
        """Height at u, for arrays of any shape."""
        return _heights(u, self.length, self.z_start, self.z_end, self.curvature)

    def offset(self, u: Floats) -> Floats:
        """Offset of the wire to the left of its axis at u."""
        chord = self.z_start + (self.z_end - self.z_start) * u / self.length
        return np.asarray(self.v0 + self.v1 * u + self.swing * (chord - self.height(u)))

    def along(self, xyz: Floats) -> tuple[Floats, Floats]:
        """Distances of points of shape (n, 3) along the axis, and to the left of it."""
        dx, dy = xyz[:, 0] - self.x, xyz[:, 1] - self.y
        return dx * self.ex + dy * self.ey, dy * self.ex - dx * self.ey

    def residuals(self, xyz: Floats) -> tuple[Floats, Floats, Floats]:
        """Distances of points of shape (n, 3) along the axis, left of the wire, and above it."""
        u, v = self.along(xyz)
        return u, v - self.offset(u), xyz[:, 2] - self.height(u)

    def points(self, u: Floats) -> Floats:
        """Positions on the wire at u, array of shape (n, 3)."""
        v = self.offset(u)
        x, y = self.x + u * self.ex - v * self.ey, self.y + u * self.ey + v * self.ex
        return np.column_stack([x, y, self.height(u)])

    @functools.cached_property
    def ends(self) -> Floats:
        """Positions of the first and the last end, array of shape (2, 3)."""
        return self.points(np.array([0.0, self.length]))

    def away(self, xyz: Floats) -> Floats:
        """Distances of points of shape (n, 3) from the wire, in the plane across it."""
        return np.asarray(np.hypot(*self.residuals(xyz)[1:]))

    def between(self, low: float, high: float) -> Catenary:
        """The section of the wire from u = low to u = high, as a catenary of its own."""
        ends = self.height(np.array([low, high]))
        moved = replace(
            self,
            x=self.x + low * self.ex,
            y=self.y + low * self.ey,
            length=high - low,
            z_start=float(ends[0]),
            z_end=float(ends[1]),
            swing=0.0,
            v0=self.v0 + self.v1 * low,
        )
        if self.swing:  # the same plan curve, seen from the new chord
            slope = (self.z_end - self.z_start) / self.length
            change = (moved.z_end - moved.z_start) / moved.length - slope
            lift = self.z_start + slope * low - moved.z_start
            moved = replace(
                moved,
                swing=self.swing,
                v0=moved.v0 + self.swing * lift,
                v1=self.v1 - self.swing * change,
            )
        if self.covariance is not None:
            step = self.slopes(np.array([low, high]))
            turn = np.vstack([step, [0.0, 0.0, 1.0]])
            moved = replace(moved, covariance=turn @ self.covariance @ turn.T)
        return moved

    def height_sigma(self, u: Floats) -> Floats:
        """Standard deviation of the height at u, array of shape (n,)."""
        if self.covariance is None:
            return np.full(np.shape(u), np.nan)
        step = self.slopes(u)
        return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", step, self.covariance, step)))

    def slopes(self, u: Floats) -> Floats:
        """Derivatives of the height at u by z_start, z_end and curvature, array of shape (n, 3)."""
        return _jacobian(u, self.length, self.z_start, self.z_end, self.curvature)

    def sigma(self, name: str) -> float:
        """Standard deviation of c, u0, z0 or sag, from the covariance of the fit."""
        if self.covariance is None:
            return math.nan
        value = getattr(self, name)
        steps = {"z_start": 1e-4, "z_end": 1e-4, "curvature": max(1e-4 * self.curvature, 1e-9)}
        slope = np.array(
            [
                (getattr(replace(self, **{key: getattr(self, key) + step}), name) - value) / step
                for key, step in steps.items()
            ]
        )
        return float(np.sqrt(max(slope @ self.covariance @ slope, 0.0)))

    def sigmas(self) -> dict[str, float]:
        """Standard deviations of c, u0, z0 and sag."""
        return {name: self.sigma(name) for name in ("c", "u0", "z0", "sag")}


def _hang(u: float, curvature: float) -> float:
    """Height of a catenary above its lowest point, at the horizontal distance u from it."""
    return 2 * math.sinh(0.5 * curvature * u) ** 2 / curvature


def _lowest(length: float, z_start: float, z_end: float, curvature: float) -> float:
    half = math.sinh(0.5 * curvature * length)
    return length / 2 - math.asinh(0.5 * curvature * (z_end - z_start) / half) / curvature


def _heights(u: Floats, length: float, z_start: float, z_end: float, curvature: float) -> Floats:
    u0 = _lowest(length, z_start, z_end, curvature)
    hung = 2 * np.sinh(0.5 * curvature * (np.asarray(u) - u0)) ** 2 / curvature
    return np.asarray(z_start - _hang(u0, curvature) + hung)


def _jacobian(u: Floats, length: float, z_start: float, z_end: float, curvature: float) -> Floats:
    """Derivatives of the height by z_start, z_end and curvature, array of shape (n, 3)."""
    base = _heights(u, length, z_start, z_end, curvature)
    step = 1e-3 * curvature + 1e-9
    bent = _heights(u, length, z_start, z_end, curvature + step)
    raised = _heights(u, length, z_start, z_end + 1e-3, curvature)
    end = (raised - base) / 1e-3
    return np.column_stack([1 - end, end, (bent - base) / step])


def fit(
    xyz: Floats,
    *,
    sways: bool = True,
    spread: float = 1.0,
    curvature: float | None = None,
    scatter: float | None = None,
) -> Catenary | None:
    """The catenary through points of one wire, from its first to its last point.

    Parameters
    ----------
    xyz : array of shape (n, 3), metres
    sways : also look for a swing by wind
    spread : points farther than this from the first curve lose all weight, metres
    curvature : known of other wires, to a tenth, 1 / metre
    scatter : of points, known of other wires, metres; a few points do not tell their own

    Returns
    -------
    Catenary or None
        None where there are fewer than four points, or they do not extend in plan.
    """
    if len(xyz) < 4:
        return None
    middle = xyz[:, :2].mean(axis=0)
    aside = xyz[:, :2] - middle
    direction = np.linalg.eigh(aside.T @ aside)[1][:, 1]
    direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
    u = aside @ direction
    length = float(np.ptp(u))
    if length < 1.0:
        return None
    x, y = middle + u.min() * direction
    v = aside[:, 1] * direction[0] - aside[:, 0] * direction[1]
    shape, covariance = np.empty(kernels.FIT_SIZE), np.empty((3, 3))
    count = kernels.fitted(
        u - u.min(),
        v,
        np.ascontiguousarray(xyz[:, 2]),
        length,
        spread,
        curvature or 0.0,
        SETTINGS.fit.known_curvature,
        scatter or SETTINGS.arcs.least_wander,
        sways,
        SETTINGS.fit.swaying_sag,
        shape,
        covariance,
    )
    if not count:
        return None
    z_start, z_end, bent, v0, v1, swing, rms, _ = shape.tolist()
    return Catenary(
        float(x),
        float(y),
        float(direction[0]),
        float(direction[1]),
        length,
        z_start,
        z_end,
        bent,
        v0,
        v1,
        swing,
        rms,
        count,
        covariance,
    )
