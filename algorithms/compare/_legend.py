"""Which codes are which class: merged, named and left out before anything is counted."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from algorithms.shared.accuracy.blocks import Tallies
from algorithms.shared.accuracy.confusion import Confusion
from toolbox.declare import ClassList
from toolbox.errors import DataError

ENTRY = re.compile(r"\s*([^=]+?)\s*=\s*([^=]+?)\s*")  # a second "=": two entries in one word
MOST = 256  # classes
CHUNK = 1 << 20  # values counted at a time
NONE = -1  # class of what is left out, or has no counterpart


def names_of(entries: Sequence[str]) -> dict[int, str]:
    """Name of each code in entries such as ``3,4,5=vegetation``.

    Raises
    ------
    ValueError
        An entry cannot be read, or a code is named twice.

    Examples
    --------
    >>> names_of(["3-5=vegetation", "6=building"])
    {3: 'vegetation', 4: 'vegetation', 5: 'vegetation', 6: 'building'}
    """
    names: dict[int, str] = {}
    for entry in entries:
        found = ENTRY.fullmatch(entry)
        if not found:
            raise ValueError(f"{entry!r} is not classes=name, such as 3,4,5=vegetation")
        for code in ClassList.parse(found[1]):
            if names.setdefault(code, found[2]) != found[2]:
                raise ValueError(f"class {code} is both {names[code]!r} and {found[2]!r}")
    return names


def map_problem(entries: Sequence[str] | None) -> str:
    """What is wrong with entries of :func:`names_of`; empty if nothing is."""
    try:
        names_of(entries or ())
    except ValueError as error:
        return str(error)
    return ""


@dataclass(frozen=True)
class Legend:
    """The classes of two classifications, and the number of the class of each code.

    Attributes
    ----------
    labels : names of the classes, in the order of their lowest codes
    said, true : number of the class of each code of the classification and of the reference;
        NONE for codes of the reference that are left out
    """

    labels: tuple[str, ...]
    said: Mapping[int, int]
    true: Mapping[int, int]

    @classmethod
    def of(
        cls,
        said: NDArray[np.int64],
        true: NDArray[np.int64],
        names: Mapping[int, str],
        true_names: Mapping[int, str],
        leave_out: Sequence[int] = (),
    ) -> Legend:
        """Name the codes that occur; those without a name are ``class 7``.

        Raises
        ------
        DataError
            There are more than MOST classes.
        """
        kept = [int(code) for code in true if code not in leave_out]
        named = [(int(c), names.get(int(c), f"class {c}")) for c in said]
        true_named = [(c, true_names.get(c, f"class {c}")) for c in kept]
        labels = tuple(dict.fromkeys(name for _, name in sorted(named + true_named)))
        if len(labels) > MOST:
            raise DataError(
                f"attribute: there are {len(labels)} classes, at most {MOST} are allowed"
            )
        number = {name: k for k, name in enumerate(labels)}
        left_out = {int(code): NONE for code in true if code in leave_out}
        return cls(
            labels,
            {code: number[name] for code, name in named},
            {code: number[name] for code, name in true_named} | left_out,
        )

    def tally(
        self,
        said: NDArray[Any],
        true: NDArray[Any],
        block: NDArray[np.int64],
        square: NDArray[np.int64],
    ) -> Tallies:
        """Confusion matrix of each block; what is left out is not counted.

        Parameters
        ----------
        said, true : codes, arrays of shape (n,)
        block : number of the block, array of shape (n,)
        square : of each block the square of four, array of shape (b,)
        """
        k, count = len(self.labels), max(len(square), 1)
        found = np.zeros(count * k * k, np.int64)
        for first in range(0, len(said), CHUNK):
            part = slice(first, first + CHUNK)
            row, column = numbers(true[part], self.true), numbers(said[part], self.said)
            counted = row != NONE
            cell = (block[part] * k + row) * k + column
            found += np.bincount(cell[counted], minlength=len(found))
        return Tallies(found.reshape(count, k, k), square)

    def confusion(self, by_block: Tallies) -> Confusion:
        """The matrix of all blocks together."""
        return Confusion(self.labels, by_block.counts.sum(axis=0))


def numbers(codes: NDArray[Any], table: Mapping[int, int]) -> NDArray[np.int64]:
    """The number that a table gives for each code."""
    known = np.array(sorted(table), np.int64)
    return np.array([table[c] for c in known.tolist()], np.int64)[np.searchsorted(known, codes)]


def codes_in(values: NDArray[Any], name: str) -> NDArray[np.int64]:
    """The codes that occur, sorted.

    Raises
    ------
    DataError
        A value is not a whole number; the text begins with the name of the parameter.
    """
    found: set[Any] = set()
    for first in range(0, len(values), CHUNK):
        found |= set(np.unique(values[first : first + CHUNK]).tolist())
    if odd := [value for value in found if value % 1 != 0]:
        raise DataError(f"{name}: classes must be whole numbers, got {odd[0]:g}")
    return np.array(sorted(map(int, found)), np.int64)
