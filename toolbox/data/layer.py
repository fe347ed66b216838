"""What the framework asks of a layer, whichever of the layer classes it is.

Points, rasters, features, tables and reports answer for themselves how large they are, what they
hold, which part of them belongs to a tile, and how a page lists them. So no other module of the
framework asks of which class a layer is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.context import QUIET, Context
from toolbox.data.crs import assumed, describe_crs
from toolbox.data.extras import Extra
from toolbox.data.lattice import in_plan
from toolbox.errors import DataError

if TYPE_CHECKING:
    import pandas as pd

    from toolbox.data.report import Column, Section

Inside = Callable[[NDArray[np.float64], int], NDArray[np.bool_]]
"""Which coordinates along an axis, 0 for x and 1 for y, are those of a tile."""


_DAY = re.compile(r"\d{4}-\d\d-\d\d")


def day_of(head: Mapping[str, str]) -> str:
    """The date of a set if it is a day, YYYY-MM-DD as formats ask (RFC 3339); else "".

    >>> day_of({"date": "2026-11-24"}), day_of({"date": "autumn of 2026"})
    ('2026-11-24', '')
    """
    date = head.get("date", "")
    return date if _DAY.fullmatch(date) else ""


class Layer:
    """What a tool reads and gives; the defaults are those of a layer without a position.

    Attributes
    ----------
    SUFFIXES : endings of the files that it can be written to
    NEEDS : optional libraries that files with some endings need
    is_spatial : whether it has coordinates, and so may have a CRS
    is_gridded : whether it is made of cells, which reach beyond the points that they were made from
    in_blocks : whether its file can be written block by block, so that it need not be in memory
    tools : group of the tools for such layers, of which one is called reproject; "" without
    axes : coordinates that can be used like attributes; x, y and z where each point has a height
    numbers_in : where its numbers are, for who takes the layer for an array
    """

    SUFFIXES: ClassVar[tuple[str, ...]] = ()
    NEEDS: ClassVar[Mapping[str, Extra]] = MappingProxyType({})
    is_spatial: ClassVar[bool] = False
    is_gridded: ClassVar[bool] = False
    in_blocks: ClassVar[bool] = False
    tools: ClassVar[str] = ""
    axes: ClassVar[tuple[str, ...]] = ()
    numbers_in: ClassVar[str] = ""

    if TYPE_CHECKING:  # attributes of some classes, and properties of others

        @property
        def name(self) -> str:
            """Of the file, for messages."""

        @property
        def crs(self) -> CRS | None:
            """None if not known."""

        @property
        def metre(self) -> float:
            """Length of one metre in the unit of the coordinates; 1.0 without a CRS."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Refuse, but for an array of objects: numpy would make one of one object.

        Raises
        ------
        TypeError
            Numbers are asked for; it says where they are.
        """
        if dtype is not None and np.dtype(dtype) == object:
            made = np.empty((), object)
            made[()] = self
            return made
        where = f"; {self.numbers_in}" if self.numbers_in else ""
        raise TypeError(f"a {type(self).__name__} is no array{where}")

    @property
    def bounds(self) -> tuple[float, ...]:
        """(xmin, ymin, xmax, ymax), of points also with heights; NaN where nothing has a place."""
        return (np.nan,) * 4

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the attributes or columns."""
        return ()

    @property
    def paths(self) -> tuple[Path, ...]:
        """Files that hold what the layer does not have in memory."""
        return ()

    def with_crs(self, crs: CRS | str | int | None) -> Self:
        """The same layer, said to be in another CRS; as it is if it has no coordinates."""
        return self

    def assuming(self, crs: CRS | str | int | None) -> Self:
        """The same layer, in the CRS that it states or else in this one; see `crs.assumed`."""
        known = assumed(self.crs, crs)
        return self if known is self.crs else self.with_crs(known)

    def with_head(self, head: Mapping[str, str]) -> Self:
        """The layer with the title, client and date of the set that it is handed over with."""
        return self

    def size(self, inside: Inside | None = None) -> int | None:
        """Number of points, features, rows, or cells with a value; None where nothing is counted.

        Parameters
        ----------
        inside : count only what belongs to this tile
        """
        return None

    def contents(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """All that the layer has in memory, as named arrays, which can be hashed."""
        return iter(())

    def cropped(self, inside: Inside) -> Self | None:
        """What belongs to a tile; None if nothing does, or nothing has a position."""
        return None

    def apart(self) -> tuple[Mapping[str, NDArray[Any]], dict[str, Any]]:
        """The arrays of what there is many of, and all the rest as values that JSON knows.

        Raises
        ------
        DataError
            No piece of a layer of this class belongs to a tile.
        """
        raise DataError(f"a {type(self).__name__} is not taken apart")

    @classmethod
    def of_parts(cls, arrays: Mapping[str, NDArray[Any]], rest: Mapping[str, Any]) -> Self:
        """The layer that :meth:`apart` has taken apart; its arrays may be read from disk.

        Raises
        ------
        DataError
            No piece of a layer of this class belongs to a tile.
        """
        raise DataError(f"a {cls.__name__} is not put together")

    def size_text(self) -> str:
        """The size in words, for a page that does not list what is in the layer; else ""."""
        return ""

    def page_sections(
        self, title: str, help: str, columns: Mapping[str, Column] = MappingProxyType({})
    ) -> tuple[Section, ...]:
        """How a page lists what is in the layer; nothing where there is too much of it.

        Parameters
        ----------
        columns : how columns are shown, by name
        """
        return ()

    def _repr_html_(self) -> str:
        """What a notebook shows: a small table of size, CRS, bounds and attributes."""
        count = self.size()
        rows = {"size": self.size_text() or ("" if count is None else f"{count:,}")}
        if self.is_spatial:
            rows["CRS"] = describe_crs(self.crs)
            rows["bounds"] = ", ".join(f"{value:.10g}" for value in self.bounds)
        rows["attributes"] = ", ".join(self.names)
        body = "".join(
            f"<tr><th>{title}</th><td>{escape(text)}</td></tr>"
            for title, text in rows.items()
            if text
        )
        name = escape(getattr(self, "name", "") or "in memory")
        return f"<table><caption>{type(self).__name__} {name}</caption>{body}</table>"

    def differences(self, now: Self) -> Iterator[str]:
        """What differs in a later version of the layer, apart from the CRS, in words."""
        return iter(())

    def save(
        self,
        path: str | Path,
        *,
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write a file; most classes have more options.

        Parameters
        ----------
        overwrite : whether files at the path may be replaced
        record : how the file was made, as JSON text (see `toolbox.runs.provenance`)
        ctx : where to report progress

        Raises
        ------
        ParameterError
            A file is there that may not be replaced.
        DataError
            The format cannot hold the layer, or the file cannot be written.
        """
        raise DataError(f"{path}: a {type(self).__name__} is not written")


def extents(**layers: Layer) -> str:
    """Where layers lie, in words: two that do not meet have different CRS, axes or units.

    Examples
    --------
    >>> from toolbox.data import PointCloud
    >>> extents(points=PointCloud([[0, 7, 1.0], [5, 9, 1.0]]))
    'points x 0 to 5, y 7 to 9'
    """
    texts = []
    for name, layer in layers.items():
        west, south, east, north = in_plan(layer.bounds)
        texts.append(f"{name} x {west:.10g} to {east:.10g}, y {south:.10g} to {north:.10g}")
    return "; ".join(texts)


def text_array(text: str) -> NDArray[np.uint8]:
    """A text as an array of its bytes, to be hashed."""
    return np.frombuffer(text.encode(), np.uint8)


def refuse_zero_bytes(frame: pd.DataFrame, path: Path) -> None:
    """Raise a DataError for a text with a zero byte, at which GDAL would cut it without a word.

    Raises
    ------
    DataError
        Names the column and the text.
    """
    for name, column in frame.items():
        texts = [name, *column] if column.dtype.kind == "O" else [name]
        if cut := next((text for text in texts if isinstance(text, str) and "\0" in text), None):
            raise DataError(f"{path}: {name!r} has a zero byte in {cut[:60]!r}; take it out")


def crs_of(layers: Iterable[Layer]) -> CRS | None:
    """The CRS of the first layer with a place."""
    return next((layer.crs for layer in layers if layer.is_spatial and layer.crs), None)
