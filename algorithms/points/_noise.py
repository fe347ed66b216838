"""What the tools that look for noise have in common: what becomes of it, and how it is told."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.data import PointCloud
from toolbox.declare import param

MOST = 0.01  # share of points that can be noise: ten times what surveyors have labelled so

Verdicts = NDArray[np.uint8]


def action() -> Any:
    """Declare what becomes of noise: ``Literal["remove", "label"]``."""
    return param(
        "What to do with noise",
        default="remove",
        label="What to do with noise",
        words={"label": "Label as noise"},
    )


def without(cloud: PointCloud, verdict: Verdicts, action: str) -> PointCloud:
    """The cloud without the noise, or with it in classes 7 and 18.

    Parameters
    ----------
    verdict : array of shape (n,): 0 for points to keep, or the class of the noise
    """
    if action == "remove":
        return cloud.select(verdict == 0)
    old: NDArray[Any] = cloud["classification"] if "classification" in cloud else 0 * verdict
    classes = np.where(verdict > 0, verdict, old).astype(np.uint8)
    return cloud.with_attributes({"classification": classes})


def in_words(low: int, high: int) -> str:
    """How many points are noise, as a report says it."""
    if not (found := low + high):
        return "No point was taken for noise."
    if found == 1:
        return f"{found} point was taken for noise: {low} low, {high} high."
    return f"{found} points were taken for noise: {low} low, {high} high."
