"""Selection of points by class, return and condition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.returns import ReturnNumbers, has_numbers
from toolbox.context import log
from toolbox.data import PointCloud
from toolbox.declare import ClassList, Expression
from toolbox.errors import NothingToDo

ReturnKind = Literal[
    "all", "first", "last", "only", "intermediate", "first_of_many", "last_of_many"
]


def of_classes(given: NDArray[np.integer], classes: Iterable[int]) -> NDArray[np.bool_]:
    """True for points whose class is one of some, array of shape (n,).

    np.isin takes ten times as long for numbers of 8 bits.

    Examples
    --------
    >>> of_classes(np.array([2, 6, 9], np.uint8), (2, 9))
    array([ True, False,  True])
    """
    found = np.zeros(len(given), bool)
    for one in classes:
        found |= given == one
    return found


def choice_problems(
    cloud: PointCloud, classes: ClassList | None, returns: ReturnKind
) -> Iterator[tuple[str, str]]:
    """Problems of a choice of points: parameters for which the cloud lacks attributes.

    Examples
    --------
    >>> bare = PointCloud([[0, 0, 5.0]])
    >>> [name for name, _ in choice_problems(bare, ClassList([2]), "last")]
    ['classes', 'returns']
    """
    if classes and "classification" not in cloud:
        yield "classes", f"{cloud.name} has no classification"
    if returns != "all" and not has_numbers(cloud):
        yield "returns", f"{cloud.name} has no return numbers"


def chosen(
    cloud: PointCloud, classes: ClassList | None, returns: ReturnKind, where: Expression | None
) -> NDArray[np.bool_]:
    """True for the points of the chosen classes and returns that meet a condition, shape (n,).

    Raises
    ------
    NothingToDo
        See :func:`return_mask`.

    Examples
    --------
    >>> cloud = PointCloud([[0, 0, 5.0], [1, 0, 9.0]], {"classification": [2, 2]})
    >>> chosen(cloud, ClassList([2]), "all", Expression("z > 6"))
    array([False,  True])
    """
    keep = np.ones(len(cloud), bool)
    if classes:
        keep &= of_classes(cloud["classification"], classes)
    if returns != "all":
        keep &= return_mask(ReturnNumbers.of(cloud), returns)
    if where:
        keep &= where.mask({name: cloud[name] for name in where.names}, len(cloud))
    return keep


def return_mask(found: ReturnNumbers, returns: ReturnKind) -> NDArray[np.bool_]:
    """True for the returns of one kind.

    Parameters
    ----------
    found : the returns of n points
    returns : see :class:`PointsFilter`

    Returns
    -------
    array of shape (n,)

    Raises
    ------
    NothingToDo
        No point has a valid return number (1 to the number of returns).

    Examples
    --------
    >>> return_mask(ReturnNumbers(np.array([1, 1, 2]), np.array([1, 2, 2])), "last")
    array([ True, False,  True])
    """
    number, count = found.number, found.count
    valid = found.known
    if len(valid) and not valid.any():
        text = "points: no point has a valid return number, so returns cannot be chosen"
        raise NothingToDo(text)
    if not valid.all():
        log.warning("%d points have an invalid return number and are left out", (~valid).sum())
    if found.in_lists and returns in ("only", "first_of_many", "last_of_many"):
        log.warning(
            "no pulse has a single return, as in lists of first and of last returns, where a pulse "
            "with one return is in both; %s does not tell them apart",
            returns,
        )
    first, last, single = number == 1, number == count, count == 1
    masks = {
        "all": valid,
        "first": first,
        "last": last,
        "only": single,
        "intermediate": ~first & ~last,
        "first_of_many": first & ~single,
        "last_of_many": last & ~single,
    }
    return np.asarray(valid & masks[returns])
