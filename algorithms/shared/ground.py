"""What all ground filters share: which points take part, and what becomes of their classes."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from toolbox.data import PointCloud
from toolbox.declare import Share
from toolbox.errors import NothingToDo

GROUND, OTHER = np.uint8(2), np.uint8(1)  # ASPRS classes
NOWHERE = np.zeros(0, bool)  # ground among no points

Returns = Literal["last", "all"]
Mask = NDArray[np.bool_]


def taking_part(cloud: PointCloud, ignore: Sequence[int] | None) -> Mask:
    """True for the points that a filter looks at: neither of an ignored class nor withheld.

    Returns
    -------
    array of shape (n,)
    """
    part = ~is_withheld(cloud)
    if ignore and "classification" in cloud:
        part &= ~np.isin(cloud["classification"], ignore)
    return part


def is_withheld(cloud: PointCloud) -> Mask:
    """True for the points that their producer wants nobody to use, array of shape (n,)."""
    if "withheld" not in cloud:
        return np.zeros(len(cloud), bool)
    return np.asarray(cloud["withheld"] != 0)


def may_be_ground(cloud: PointCloud, returns: Returns) -> Mask:
    """True for last and only returns, or for all.

    A pulse goes on to the ground after all its other returns. Points without return numbers, or
    with zeros in them, may all be last returns.

    Returns
    -------
    array of shape (n,)
    """
    if returns == "all" or not {"return_number", "number_of_returns"} <= set(cloud.names):
        return np.ones(len(cloud), bool)
    number, count = cloud["return_number"], cloud["number_of_returns"]
    last: Mask = (number == 0) | (number >= count)
    return last


@dataclass(frozen=True)
class Candidates:
    """The points of a cloud of which a filter decides whether they are ground.

    Attributes
    ----------
    cloud : n points
    part : array of shape (n,), see :func:`taking_part`; all other points keep their class
    chosen : array of shape (n,), the m points to decide on; the rest of `part` is not ground
    """

    cloud: PointCloud
    part: Mask
    chosen: Mask

    @classmethod
    def of(cls, cloud: PointCloud, returns: Returns, ignore: Sequence[int] | None) -> Candidates:
        """The points that take part and may be ground."""
        part = taking_part(cloud, ignore)
        return cls(cloud, part, part & may_be_ground(cloud, returns))

    @functools.cached_property
    def xyz(self) -> NDArray[np.float64]:
        """Coordinates of the chosen points, array of shape (m, 3).

        Read-only in any case: kernels would be compiled for writable ones once more.
        """
        xyz = self.cloud.xyz if self.chosen.all() else self.cloud.xyz[self.chosen]
        xyz.flags.writeable = False
        return xyz

    def classified(self, found: Mask, *, keep_classes: bool) -> PointCloud:
        """The cloud with class 2 on ground and 1 elsewhere.

        Parameters
        ----------
        found : array of shape (m,), ground among the chosen points
        keep_classes : let points that are not ground keep their class, unless it was 2
        """
        cloud, ground = self.cloud, np.zeros(len(self.cloud), bool)
        ground[self.chosen] = found
        old = cloud["classification"] if "classification" in cloud else np.zeros(len(cloud), "u1")
        classes = np.where(ground, GROUND, OTHER)
        if keep_classes:
            classes = np.where(ground | (old == GROUND), classes, old)
        classes = np.where(self.part, classes, old).astype(np.uint8, copy=False)
        return cloud.with_attributes({"classification": classes})

    def share(self, found: Mask) -> Share:
        """Share of all points that are ground, given it for the chosen ones."""
        ground = np.zeros(len(self.cloud), bool)
        ground[self.chosen] = found
        return Share.of_points(ground, self.cloud.core)

    def nothing_to_do(self, classified: PointCloud, **others: Any) -> NothingToDo:
        """The error where no point is chosen; a tile of a survey has no ground there.

        Parameters
        ----------
        classified : what the filter gives then, see :meth:`classified`
        others : other outputs beside the share of ground
        """
        withheld = is_withheld(self.cloud)
        excluded = {
            "withheld": withheld,
            "of classes to ignore": ~withheld & ~self.part,
            "no last returns (--returns all takes them, too)": self.part,
        }
        counts = {why: np.count_nonzero(which) for why, which in excluded.items()}
        reasons = "; ".join(f"{count} are {why}" for why, count in counts.items() if count)
        return NothingToDo(
            f"points: none can be ground: {reasons or 'there are none'}",
            instead=SimpleNamespace(
                classified=classified, ground_share=self.share(NOWHERE), **others
            ),
        )
