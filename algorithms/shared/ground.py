"""What ground filters share: the choice of points, and the classes that these get."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.parameters import DUTCH_STRUCTURES, NAMED_STRUCTURES, SURFACES
from algorithms.shared.returns import ReturnNumbers, let_through, warn_of_missing
from algorithms.shared.selection import of_classes
from toolbox.context import QUIET, Context, log, setting_name
from toolbox.data import PointCloud
from toolbox.declare import Share
from toolbox.errors import NothingToDo

GROUND, OTHER = np.uint8(2), np.uint8(1)  # ASPRS classes
NOWHERE = np.zeros(0, bool)  # ground among no points

Returns = Literal["last", "all"]
Mask = NDArray[np.bool_]


def taking_part(cloud: PointCloud, *without: Sequence[int] | None) -> Mask:
    """True for the points that a tool looks at: neither of these classes nor withheld.

    Parameters
    ----------
    without : lists of classes, or None for no class

    Returns
    -------
    array of shape (n,)

    Examples
    --------
    >>> cloud = PointCloud(np.zeros((3, 3)), {"classification": [2, 7, 18]})
    >>> taking_part(cloud, (7, 18))
    array([ True, False, False])
    """
    part = ~is_withheld(cloud)
    if "classification" in cloud:
        part &= ~of_classes(cloud["classification"], [*chain(*(some or () for some in without))])
    return part


def among(keep: Sequence[int] | None, classes: Sequence[int]) -> tuple[int, ...]:
    """The classes that are both kept and in a given list.

    Examples
    --------
    >>> among((9, 17), SURFACES)
    (9,)
    """
    return tuple(set(keep or ()).intersection(classes))


def is_withheld(cloud: PointCloud) -> Mask:
    """True for points flagged as withheld, array of shape (n,).

    Examples
    --------
    >>> is_withheld(PointCloud(np.zeros((2, 3)), {"withheld": np.array([0, 1], np.uint8)}))
    array([False,  True])
    """
    if "withheld" not in cloud:
        return np.zeros(len(cloud), bool)
    return np.asarray(cloud["withheld"] != 0)


def without_withheld(cloud: PointCloud, keep: Mask, ctx: Context = QUIET) -> Mask:
    """The points of a mask, without those flagged as withheld, which a warning counts.

    Withheld means deleted (ASPRS LAS 1.4, table 9): such points make no surface and no figure. The
    steps of a model that leave out the same points tell it once.

    Parameters
    ----------
    keep : array of shape (n,)

    Returns
    -------
    array of shape (n,)

    Examples
    --------
    >>> cloud = PointCloud(np.zeros((2, 3)), {"withheld": np.array([0, 1], np.uint8)})
    >>> without_withheld(cloud, np.array([True, True]))
    array([ True, False])
    """
    left_out = keep & is_withheld(cloud)
    if count := int(np.count_nonzero(left_out & cloud.core)):
        text = "%d points are flagged as withheld (deleted), and are left out"
        ctx.once("withheld", (count, len(cloud)), lambda: log.warning(text, count))
    return np.asarray(keep & ~left_out)


def may_be_ground(cloud: PointCloud, returns: Returns) -> Mask:
    """True for points that may be ground: last and only returns, or all.

    A pulse goes on to the ground after all its other returns. Points without return numbers, with
    zeros in them, or with numbers above the number of returns may all be last returns, and so may
    both returns of a pulse that has one place in lists of first and of last returns.

    Returns
    -------
    array of shape (n,)

    Examples
    --------
    >>> returns = {"return_number": [1, 2], "number_of_returns": [2, 2]}
    >>> may_be_ground(PointCloud([[0, 0, 9.0], [0, 0, 1.0]], returns), "last")
    array([False,  True])
    """
    if returns == "all":
        return np.ones(len(cloud), bool)
    found = ReturnNumbers.of(cloud)
    warn_of_missing(found, "all but last returns are no ground, unless returns is all")
    return ~let_through(cloud, found)


@dataclass(frozen=True)
class Candidates:
    """The points of a cloud that a filter decides on: ground or not.

    Attributes
    ----------
    cloud : n points
    part : array of shape (n,), see :func:`taking_part`; all other points keep their class
    chosen : array of shape (n,), the m points to decide on; the rest of `part` is not ground
    keep : classes of points that keep them unless they are ground, and of `SURFACES` even then

    Examples
    --------
    >>> cloud = PointCloud(np.eye(3), {"classification": np.array([1, 1, 7], np.uint8)})
    >>> candidates = Candidates.of(cloud, "all", ignore=(7,))
    >>> found = candidates.xyz[:, 0] > 0.5
    >>> candidates.classified(found)["classification"]
    array([2, 1, 7], dtype=uint8)
    """

    cloud: PointCloud
    part: Mask
    chosen: Mask
    keep: Sequence[int] = ()

    @classmethod
    def of(
        cls,
        cloud: PointCloud,
        returns: Returns = "last",
        ignore: Sequence[int] | None = None,
        keep: Sequence[int] | None = None,
    ) -> Candidates:
        """Choose the points that take part and may be ground; structures to keep are left out."""
        part = taking_part(cloud, ignore, among(keep, NAMED_STRUCTURES))
        return cls(cloud, part, part & may_be_ground(cloud, returns), keep or ())

    @functools.cached_property
    def xyz(self) -> NDArray[np.float64]:
        """Coordinates of the chosen points, array of shape (m, 3).

        Read-only in any case: kernels would be compiled for writable ones once more.
        """
        xyz = self.cloud.xyz
        if not self.chosen.all():
            xyz = xyz.compress(self.chosen, axis=0)  # far faster than a mask in brackets
        xyz.flags.writeable = False
        return xyz

    def classified(self, found: Mask) -> PointCloud:
        """The cloud with class 2 for ground and 1 for other points; kept classes stay.

        Parameters
        ----------
        found : array of shape (m,), ground among the chosen points
        """
        cloud, ground = self.cloud, self._of_all(found)
        old = cloud["classification"] if "classification" in cloud else np.zeros(len(cloud), "u1")
        still = of_classes(old, among(self.keep, SURFACES))  # a class of its own on the ground, too
        kept = np.where(ground, still, of_classes(old, self.keep) & (old != GROUND))
        classes = np.where(ground, GROUND, OTHER)
        classes = np.where(kept | ~self.part, old, classes).astype(np.uint8, copy=False)
        self._tell_lost(old, classes)
        self._tell_built(old, classes)
        return cloud.with_attributes({"classification": classes})

    def _tell_lost(self, old: NDArray[Any], new: NDArray[np.uint8]) -> None:
        """Say that there was ground, and which classes are gone that somebody gave to objects."""
        if (self.part & (old == GROUND)).any():
            log.info("class 2 (ground) of the file is replaced by what is found here")
        gone = np.unique(old[old != new])
        if named := [str(number) for number in gone if number not in (0, OTHER, GROUND)]:
            setting = setting_name("keep_classes")
            log.info(
                "points of class %s become 2 on the ground and 1 elsewhere%s",
                ", ".join(named),
                f", unless they are named by {setting}" if setting else "",
            )

    def _tell_built(self, old: NDArray[Any], new: NDArray[np.uint8]) -> None:
        """Say whether points of class 26 are ground: no standard names it, but Dutch surveys do."""
        built = (old == DUTCH_STRUCTURES) & self.cloud.core
        setting = setting_name("keep_classes")
        if kept := np.count_nonzero(built & (new == DUTCH_STRUCTURES)):
            log.warning(
                "points: %d points keep class 26 and are no ground, as bridges, quays and other "
                "structures of Dutch surveys: the terrain is that beside and below them",
                kept,
            )
            # No warning, which a report would show to people who run nothing.
            if setting:
                log.info("where 26 means something else, %s without it takes it away", setting)
        if lost := np.count_nonzero(built & (new == GROUND)):
            log.warning(
                "points: %d points of class 26 become ground: in Dutch surveys they are bridges, "
                "quays and other structures, which then stand in the terrain",
                lost,
            )
            if setting:
                log.info("%s with 26 among the others keeps them", setting)

    def ground(self, classified: PointCloud, found: Mask) -> PointCloud:
        """The ground points, whatever their class.

        `found` has the shape (m,): ground among the chosen points.
        """
        return classified.select(self._of_all(found))

    def share(self, found: Mask, classified: PointCloud) -> Share:
        """Share of ground among all points, without those that keep a class of their own there.

        `found` is as for :meth:`classified`, whose result is `classified`: its user counts class 2.
        """
        ground = self._of_all(found) & (classified["classification"] == GROUND)
        return Share.of_points(ground, self.cloud.core)

    def _of_all(self, found: Mask) -> Mask:
        """Mask of ground among all points, shape (n,), from that among the chosen ones."""
        ground = np.zeros(len(self.cloud), bool)
        ground[self.chosen] = found
        return ground

    def nothing_to_do(self, classified: PointCloud, **others: Any) -> NothingToDo:
        """The error that no point is chosen, with the outputs for tiles without ground.

        Parameters
        ----------
        classified : what the filter gives then, see :meth:`classified`
        others : other outputs beside the share of ground
        """
        withheld = is_withheld(self.cloud)
        excluded = {
            "withheld": withheld,
            "of classes that take no part (ignore, keep_classes)": ~withheld & ~self.part,
            "no last returns (--returns all takes them, too)": self.part,
        }
        counts = {why: np.count_nonzero(which) for why, which in excluded.items()}
        reasons = "; ".join(f"{count} are {why}" for why, count in counts.items() if count)
        return NothingToDo(
            f"points: none can be ground: {reasons or 'there are none'}",
            instead=SimpleNamespace(
                classified=classified,
                ground=self.ground(classified, NOWHERE),
                ground_share=self.share(NOWHERE, classified),
                **others,
            ),
        )
