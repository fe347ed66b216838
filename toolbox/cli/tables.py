"""Tables on a terminal: as wide as that, with limits beside their values."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from toolbox import language
from toolbox.data.table import cell_texts, is_number

if TYPE_CHECKING:
    import pandas as pd

GAP = "  "
WORDS = {
    "": "",
    "_block": " by blocks",
}  # of the limits in columns that end so, before _low and _high
SENTENCES = ("heights", "warning")  # properties of files whose values are in words
MEANING = "meaning"  # a column that says in words what stands beside it
NARROWEST = 24  # characters to which a text is wrapped at least


@dataclass(frozen=True)
class _Column:
    """A column as texts; numbers stand to the right."""

    name: str
    cells: Sequence[str]
    number: bool

    @property
    def width(self) -> int:
        return max(map(len, [self.name, *self.cells]))

    def lines(self, width: int) -> list[list[str]]:
        """The name and each cell in lines of a width."""
        texts = [self.name, *self.cells]
        if self.number:
            return [[text.rjust(width)] for text in texts]
        wrapped = [textwrap.wrap(text, width, break_on_hyphens=False) or [""] for text in texts]
        return [[line.ljust(width) for line in lines] for lines in wrapped]


def fitted(frame: pd.DataFrame, width: int) -> str:
    """A table as text that is not wider than a number of characters, if its columns allow.

    Limits, in columns named like another one with _low and _high, stand beside its values. Columns
    that do not fit follow below, each part with the first column; of a single row each value
    stands in a line then. Long texts go on in the next line.

    Examples
    --------
    >>> import pandas as pd
    >>> frame = pd.DataFrame({"class": ["2", "6"], "f1": [0.91, 0.5]})
    >>> print(fitted(frame.assign(f1_low=[0.9, 0.25], f1_high=[0.92, 0.75]), 40))
    class                  f1
    2      0.91 (0.9 to 0.92)
    6      0.5 (0.25 to 0.75)
    """
    columns = list(_columns(frame))
    if not columns:
        return ""
    parts = list(_parts(columns, width))
    if len(parts) > 1 and len(frame) == 1:
        names = [column.name for column in columns]
        values = [column.cells[0] for column in columns]
        parts = [[_Column("", names, number=False), _Column("", values, number=False)]]
        return "\n".join(_printed(parts[0], width)[1:])
    return "\n".join("\n".join(_printed(part, width)) for part in parts)


def properties(frame: pd.DataFrame, width: int) -> str:
    """A table of property, value and unit, with the unit behind its value.

    Long values go on in the next line; on a narrow terminal each stands below its property.

    Examples
    --------
    >>> import pandas as pd
    >>> rows = {"property": ["area", "file"], "value": [5.5, "a b"], "unit": ["m2", ""]}
    >>> print(properties(pd.DataFrame(rows), 40))
    area  5.5 m2
    file  a b
    """
    names = list(map(str, frame["property"]))
    values = zip(cell_texts(frame["value"], missing="-"), frame["unit"].fillna(""), strict=True)
    texts = [f"{value} {unit}".strip() for value, unit in values]
    said = [name in SENTENCES for name in names]
    texts = [language.told(t) if is_said else t for t, is_said in zip(texts, said, strict=True)]
    left = max(map(len, names), default=0) + len(GAP)
    if width - left >= NARROWEST:
        heads = [name.ljust(left) for name in names]
        return "\n".join(_hung(*pair, " " * left, width) for pair in zip(heads, texts, strict=True))
    lines = []
    for name, text in zip(names, texts, strict=True):
        short = f"{name}{GAP}{text}"
        lines += [short] if len(short) <= width else [name, _hung(GAP, text, GAP, width)]
    return "\n".join(lines)


def _hung(head: str, text: str, indent: str, width: int) -> str:
    """A text behind a head, whose further lines are indented."""
    how = {"initial_indent": head, "subsequent_indent": indent, "break_on_hyphens": False}
    return textwrap.fill(text, width, **how) or head.rstrip()  # type: ignore[arg-type]


def _columns(frame: pd.DataFrame) -> Iterator[_Column]:
    """The columns, those of limits within that of their values."""
    import pandas as pd

    names = [str(name) for name in frame]
    frame = frame.set_axis(names, axis=1)
    kinds = {f"{n}{kind}": kind for kind in WORDS for n in names}
    found = [n for n in kinds if {f"{n}_low", f"{n}_high"} <= set(names)]
    with_limits = {n.removesuffix(kinds[n]): kinds[n] for n in found}
    limits = {f"{name}_{end}" for name in found for end in ("low", "high")}
    for name in names:
        texts = cell_texts(frame[name], missing="-")
        if name == MEANING:
            texts = [language.told(text) for text in texts]
        if name in with_limits:
            kind = with_limits[name]
            low_high = (frame[f"{name}{kind}_{end}"] for end in ("low", "high"))
            ends = zip(frame[name], *low_high, strict=True)
            by = WORDS[kind]
            texts = [
                text if pd.isna(high) else f"{value:.4g} ({low:.4g} to {high:.4g}{by})"
                for text, (value, low, high) in zip(texts, ends, strict=True)
            ]
        if name not in limits:
            yield _Column(name, texts, is_number(frame[name]))


def _parts(columns: list[_Column], width: int) -> Iterator[list[_Column]]:
    """Columns that fit beside each other, the first one in each part."""
    first, *rest = columns
    part = [first]
    for column in rest:
        left = width - sum(one.width + len(GAP) for one in part)
        fits = column.width <= left or (not column.number and left >= NARROWEST)
        if not fits and len(part) > 1:
            yield part
            part = [first]
        part.append(column)
    yield part


def _printed(part: Sequence[_Column], width: int) -> list[str]:
    """The lines of some columns; the last one, if it is text, is wrapped."""
    *others, last = part
    left = width - sum(one.width + len(GAP) for one in others)
    widths = [*(one.width for one in others), max(min(last.width, left), NARROWEST)]
    if last.number or last.width <= left:
        widths[-1] = last.width
    cells = [column.lines(wide) for column, wide in zip(part, widths, strict=True)]
    empty = [" " * wide for wide in widths]
    made = []
    for row in zip(*cells, strict=True):
        for lines in itertools.zip_longest(*row):
            texts = [
                blank if text is None else text for text, blank in zip(lines, empty, strict=True)
            ]
            made.append(GAP.join(texts).rstrip())
    return made
