"""A square of counts on a matplotlib figure, such as a confusion matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from toolbox.data import Table
from toolbox.declare.show import Matrix
from toolbox.pictures.maps import INK, WIDTH, Place, fractions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RIGHT, _WRONG = "#2f7d3b", "#c4342b"  # of a share of 1
_MOST_TEXTS = 12  # rows that leave room for numbers in the cells
_LONGEST = 14  # letters of a name beside a row
_DARK = 0.55  # share from which texts are white


@dataclass(frozen=True)
class Square:
    """Counts as shares of their rows: green on the diagonal, red beside it, each with its percent.

    Attributes
    ----------
    names, given : of the rows and columns
    counts : array of shape (rows, columns)
    """

    title: str
    label: str
    names: Sequence[str]
    given: Sequence[str]
    counts: NDArray[np.float64]
    key_height: float = 0.3

    @classmethod
    def of(cls, title: str, table: Table, show: Matrix) -> Square | None:
        """The square of a table; None if all counts are zero, as rows without any are left out."""
        frame = table.frame
        counts = frame.drop(columns=[*show.columns])
        held = counts.sum(axis=1) > 0
        counts, names = counts[held], [str(name) for name in frame[show.rows][held]]
        if not counts.size:
            return None
        given = [str(name) for name in counts.columns]
        return cls(title, show.rows, names, given, counts.to_numpy(float))

    @property
    def height(self) -> float:
        """Height of the square in inches."""
        return 0.75 * WIDTH

    def draw_on(self, figure: Figure, place: Place) -> None:
        """Draw the cells in colours of their shares, with percents in them."""
        left, bottom, width, height = place.map
        names = 0.09 * min(max(map(len, self.names)), _LONGEST)  # inches
        above = 0.25
        box = (left + names, bottom, width - names, height - above)
        axes = figure.add_axes(fractions(figure, box))
        total = self.counts.sum(axis=1, keepdims=True)
        shares = np.divide(self.counts, total, out=np.zeros_like(self.counts), where=total > 0)
        axes.imshow(self._colours(shares), aspect="auto", interpolation="none")
        axes.set_xticks(range(len(self.given)), [_short(name) for name in self.given])
        axes.set_yticks(range(len(self.names)), [_short(name) for name in self.names])
        axes.tick_params(labelsize=6.5, colors=INK, length=0, labeltop=True, labelbottom=False)
        axes.set_xlabel(f"percent of each row ({self.label})", fontsize=7.5, color=INK)
        if len(self.names) <= _MOST_TEXTS:
            for (row, column), share in np.ndenumerate(shares):
                if self.counts[row, column]:
                    ink = "white" if share > _DARK else INK
                    axes.text(
                        column, row, _percent(share), ha="center", va="center", color=ink, size=7
                    )
        axes.spines[:].set_visible(False)
        axes.set_title(self.title, fontsize=10, color=INK, loc="left", pad=18, fontweight="bold")

    def _colours(self, shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Red, green and blue of each cell."""
        from matplotlib.colors import to_rgb

        right = np.equal.outer(np.array(self.names), np.array(self.given))[..., None]
        full = np.where(right, to_rgb(_RIGHT), to_rgb(_WRONG))
        return np.asarray(1 - shares[..., None] ** 0.6 * (1 - full))  # so that few errors show


def _short(name: str) -> str:
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"


def _percent(share: float) -> str:
    """A share in percent; what is not nothing, or not all, is not rounded to it."""
    if share < 0.0005:
        return "< 0.1"
    return "> 99.9" if 0.9995 <= share < 1 else f"{100 * share:.1f}"
