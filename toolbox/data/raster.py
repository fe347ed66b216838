"""Rasters with square cells, north up, and the lattice of cells they lie on."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from affine import Affine
from numpy.typing import ArrayLike, DTypeLike, NDArray
from pyproj import CRS

from toolbox.context import QUIET, Context
from toolbox.data.crs import LOCAL, metres_per_unit, same_crs
from toolbox.errors import DataError

MAX_CELLS = 1_000_000_000
"""A lattice with more cells than this is taken for a mistake in the cell size."""

_NODATA = -9999.0  # of float rasters, unless the file or the caller has its own
_ROUNDING = 1e-6  # cells: coordinates this close to a cell boundary lie on it
_DTYPES = frozenset(
    f"{kind}{bits}"
    for kind, sizes in {"uint": (8, 16, 32, 64), "int": (8, 16, 32, 64), "float": (32, 64)}.items()
    for bits in sizes
)


@dataclass(frozen=True)
class Lattice:
    """Square cells in rows from north to south and columns from west to east.

    A cell holds its west and south edge; the last ones hold the outer east and north edge too,
    so that every point of the covered bounds has a cell. Which cell a point falls in does not
    depend on where the lattice begins, so tiles agree with the whole to the last bit.

    Parameters
    ----------
    west, north : outer corner, in CRS units
    cell : size of a cell, in CRS units
    rows, cols : number of cells

    Raises
    ------
    DataError
        The lattice has no cells, or more than `MAX_CELLS`.
    """

    west: float
    north: float
    cell: float
    rows: int
    cols: int

    def __post_init__(self) -> None:
        if not (math.isfinite(self.cell) and self.cell > 0):
            raise DataError(f"the cell size must be > 0, got {self.cell}")
        if self.rows < 1 or self.cols < 1:
            raise DataError(f"a raster needs cells, got {self.rows} rows x {self.cols} columns")
        if self.rows * self.cols > MAX_CELLS:
            raise DataError(
                f"cells of {self.cell:g} make {self.rows} rows x {self.cols} columns, more than "
                f"{MAX_CELLS} cells; choose larger cells or work in tiles"
            )

    @classmethod
    def cover(cls, bounds: Sequence[float], cell: float) -> Lattice:
        """The smallest lattice over bounds whose edges are whole multiples of the cell.

        Parameters
        ----------
        bounds : (xmin, ymin, xmax, ymax), or with heights as a point cloud has them
        cell : in the unit of the bounds

        Raises
        ------
        DataError
            The bounds are not finite, or hold more than `MAX_CELLS` cells.
        """
        if len(bounds) == 6:
            bounds = (*bounds[:2], *bounds[3:5])
        if not (math.isfinite(cell) and cell > 0):
            raise DataError(f"the cell size must be > 0, got {cell}")
        if not all(math.isfinite(value) for value in bounds):
            raise DataError(f"cannot lay cells over the bounds {tuple(bounds)}; no points?")
        low = [math.floor(value / cell + _ROUNDING) for value in bounds[:2]]
        high = [math.ceil(value / cell - _ROUNDING) for value in bounds[2:]]
        cols, rows = (max(1, h - w) for w, h in zip(low, high, strict=True))
        return cls(_multiple(low[0], cell), _multiple(low[1] + rows, cell), cell, rows, cols)

    @classmethod
    def of(cls, raster: Raster) -> Lattice:
        """The lattice of an existing raster, to use it as a template."""
        return cls(raster.transform.c, raster.transform.f, raster.cell, *raster.shape)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.rows, self.cols

    @property
    def transform(self) -> Affine:
        """From (column, row) of a cell corner to coordinates."""
        return Affine(self.cell, 0.0, self.west, 0.0, -self.cell, self.north)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) of the outer edges."""
        (col, east), (top, north) = _place(self.west, self.cell), _place(self.north, self.cell)
        return (
            self.west,
            _multiple(top - self.rows, self.cell) + north * self.cell,
            _multiple(col + self.cols, self.cell) + east * self.cell,
            self.north,
        )

    def centres(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Coordinates of the cell centres: x of shape (cols,), y of shape (rows,)."""
        (col, east), (top, north) = _place(self.west, self.cell), _place(self.north, self.cell)
        cols = np.arange(col, col + self.cols, dtype=np.float64)
        rows = np.arange(top, top - self.rows, -1, dtype=np.float64)
        return (cols + (0.5 + east)) * self.cell, (rows - (0.5 - north)) * self.cell

    def indices(self, x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of the cell that holds each point.

        Points outside get a row < 0 or >= rows, or a column < 0 or >= cols (see `holds`).

        Parameters
        ----------
        x, y : arrays of one shape, finite

        Returns
        -------
        row, col : int64 arrays of that shape
        """
        col, (east, north) = _cells(x, self.west, self.cell), self.bounds[2:]
        row = np.asarray(-1 - _cells(y, self.north, self.cell))
        slack = _ROUNDING * self.cell
        col[(col == self.cols) & (np.asarray(x) <= east + slack)] = self.cols - 1
        row[(row == -1) & (np.asarray(y) <= north + slack)] = 0
        return row, col

    def holds(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Which points lie on the lattice."""
        row, col = self.indices(x, y)
        return (row >= 0) & (row < self.rows) & (col >= 0) & (col < self.cols)


@dataclass(frozen=True, eq=False)
class Raster:
    """One or more bands on one lattice.

    Parameters
    ----------
    values : array of shape (bands, rows, cols), or (rows, cols) for one band; float rasters hold
        NaN where nothing is known, integer ones hold `nodata`; bool becomes uint8
    transform : from cell corner to coordinates; north up, square cells
    crs : None if not known
    nodata : what a file holds where nothing is known; -9999 for floats unless given
    descriptions, units : one text per band, or nothing
    name : of the file, for messages

    Raises
    ------
    ValueError
        The arguments do not fit each other.
    """

    values: NDArray[Any]
    transform: Affine
    crs: CRS | None = field(default=None, kw_only=True)
    nodata: float | None = field(default=None, kw_only=True)
    descriptions: tuple[str, ...] = field(default=(), kw_only=True)
    units: tuple[str, ...] = field(default=(), kw_only=True)
    name: str = field(default="", kw_only=True)

    SUFFIXES: ClassVar[tuple[str, ...]] = (".tif", ".tiff")

    def __post_init__(self) -> None:
        if isinstance(self.values, np.ma.MaskedArray):
            raise ValueError("a masked array; fill it with NaN or the nodata value")
        values = np.asarray(self.values)
        values = values.astype(np.uint8) if values.dtype == bool else values.view()
        values = values[None] if values.ndim == 2 else values
        values.flags.writeable = False
        if values.ndim != 3 or 0 in values.shape or values.dtype.name not in _DTYPES:
            raise ValueError(f"values of shape {values.shape} and type {values.dtype}")
        if problem := _transform_problem(self.transform):
            raise ValueError(f"the raster {problem}")
        nodata = self.nodata
        if values.dtype.kind == "f":
            nodata = _NODATA if nodata is None else float(nodata)
        elif nodata is not None and not _fits(nodata, values.dtype):
            raise ValueError(f"nodata {nodata} does not fit {values.dtype}")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "nodata", nodata)
        for texts in ("descriptions", "units"):
            given = tuple(getattr(self, texts)) or ("",) * len(values)
            if len(given) != len(values):
                raise ValueError(f"{len(given)} {texts} for {len(values)} bands")
            object.__setattr__(self, texts, given)

    @classmethod
    def from_lattice(
        cls,
        values: NDArray[Any],
        lattice: Lattice,
        *,
        crs: CRS | None,
        nodata: float | None = None,
        descriptions: Sequence[str] = (),
        units: Sequence[str] = (),
    ) -> Raster:
        """A raster made in memory; values of shape (bands, rows, cols) or (rows, cols)."""
        if values.shape[-2:] != lattice.shape:
            raise ValueError(f"values of shape {values.shape} on a lattice of {lattice.shape}")
        return cls(
            values,
            lattice.transform,
            crs=crs,
            nodata=nodata,
            descriptions=tuple(descriptions),
            units=tuple(units),
        )

    @classmethod
    def open(cls, path: str | Path, *, ctx: Context = QUIET) -> Raster:
        """Read all bands of any raster that GDAL reads.

        Cells without data are those of the file's nodata value, mask or alpha band. Integers
        stay integers where one nodata value says it all, and become floats with NaN where a mask
        or a scale and offset (which are applied) need it.

        Parameters
        ----------
        path : of any format that GDAL reads
        ctx : where to report progress

        Raises
        ------
        DataError
            The file is missing or unreadable, not georeferenced, not north up, or its cells are
            not square.
        """
        import rasterio
        from rasterio.errors import RasterioError

        try:
            with _position_unchecked(), rasterio.open(path) as source:
                raster = _read(source, Path(path).name)
        except RasterioError as error:
            if not Path(path).exists():
                raise DataError(f"{path}: no such file") from error
            raise DataError(f"{path} cannot be read as a raster: {error}") from error
        ctx.progress(1.0)
        return raster

    def save(
        self,
        path: str | Path,
        *,
        cog: bool = False,
        dtype: DTypeLike | None = None,
        ctx: Context = QUIET,
    ) -> None:
        """Write a GeoTIFF: tiled, deflated, the same bytes for the same raster.

        Parameters
        ----------
        path : ends in .tif or .tiff
        cog : write a Cloud Optimized GeoTIFF, with overviews
        dtype : of the file; by default floats become float32 and integers stay what they are
        ctx : where to report progress

        Raises
        ------
        DataError
            The suffix is another, a value does not fit the type or equals the nodata value, or
            the file cannot be written.
        """
        import rasterio
        from rasterio.errors import RasterioError

        if Path(path).suffix.lower() not in self.SUFFIXES:
            raise DataError(f"{path}: rasters are written as {' or '.join(self.SUFFIXES)}")
        values = self._stored(path, dtype)
        profile = {
            "count": len(values),
            "height": self.shape[0],
            "width": self.shape[1],
            "dtype": values.dtype.name,
            "crs": None if self.crs is None or same_crs(self.crs, LOCAL) else self.crs.to_wkt(),
            "transform": self.transform,
            "nodata": self.nodata,
        }
        profile |= _layout(values.dtype, cog)
        try:
            with _position_unchecked(), rasterio.open(path, "w", **profile) as sink:
                sink.write(values)
                sink.units = self.units
                for band, text in enumerate(self.descriptions, start=1):
                    sink.set_band_description(band, text)
        except (RasterioError, OSError) as error:
            raise DataError(f"{path} cannot be written: {error}") from error
        ctx.progress(1.0)

    def with_crs(self, crs: CRS | None) -> Raster:
        """The same cells, said to be in another CRS; nothing is transformed."""
        return replace(self, crs=crs)

    def _stored(self, path: str | Path, dtype: DTypeLike | None) -> NDArray[Any]:
        """The values as the file holds them, with nodata for NaN."""
        kind = self.values.dtype.kind
        wanted = np.dtype(dtype or (np.float32 if kind == "f" else self.values.dtype))
        if wanted.kind != "f" and (kind == "f" or not np.can_cast(self.values.dtype, wanted)):
            raise DataError(f"{path}: {self.values.dtype} values do not fit {wanted}")
        if kind != "f":
            return self.values.astype(wanted, copy=False)
        with np.errstate(over="ignore"):  # the overflow is the error below
            values = self.values.astype(wanted)
        if np.any(np.isinf(values) & np.isfinite(self.values)):
            raise DataError(f"{path}: values exceed the range of {wanted}; ask for float64")
        if np.any(values == np.array(self.nodata, wanted)):
            raise DataError(f"{path}: valid cells hold the nodata value {self.nodata:g}")
        values[np.isnan(values)] = self.nodata
        return values

    @property
    def cell(self) -> float:
        """Size of a cell, in CRS units."""
        return float(self.transform.a)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.values.shape[1], self.values.shape[2]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) of the outer edges."""
        return Lattice.of(self).bounds

    @property
    def metre(self) -> float:
        """Length of one metre in the unit of the coordinates; 1.0 without a CRS."""
        return 1 / metres_per_unit(self.crs)

    def band(self, i: int = 1) -> NDArray[np.float64]:
        """Band i, counted from 1, as a new array of shape (rows, cols) with NaN for nodata.

        Raises
        ------
        DataError
            There is no such band.
        """
        if not 1 <= i <= len(self.values):
            raise DataError(f"{self.name or 'the raster'} has {len(self.values)} band(s), not {i}")
        values = self.values[i - 1]
        band: NDArray[np.float64] = values.astype(np.float64)
        if values.dtype.kind != "f" and self.nodata is not None:
            band[values == self.nodata] = np.nan
        return band

    def sample(
        self,
        x: ArrayLike,
        y: ArrayLike,
        *,
        band: int = 1,
        method: Literal["nearest", "linear"] = "nearest",
    ) -> NDArray[np.float64]:
        """Values at points; NaN outside and where a needed cell has no data.

        Parameters
        ----------
        x, y : arrays of one shape, in CRS units
        method : "nearest" is the cell that holds the point; "linear" is bilinear between the
            four nearest centres, so NaN within half a cell of the edge
        """
        values, lattice = self.band(band), Lattice.of(self)
        if method == "linear":
            return _bilinear(values, lattice, np.asarray(x, float), np.asarray(y, float))
        found = np.full(np.shape(x), np.nan)
        inside = lattice.holds(x, y)
        row, col = lattice.indices(np.asarray(x)[inside], np.asarray(y)[inside])
        found[inside] = values[row, col]
        return found


def _place(value: float, cell: float) -> tuple[int, float]:
    """A corner as whole cells from the origin and the rest, which is 0 on a snapped lattice."""
    whole = round(value / cell)
    rest = value / cell - whole
    return whole, 0.0 if abs(rest) <= _ROUNDING else rest


def _cells(values: ArrayLike, corner: float, cell: float) -> NDArray[np.int64]:
    """Whole cells between a corner and each value, downwards."""
    whole, rest = _place(corner, cell)
    cells = np.floor(np.asarray(values, float) / cell - rest + _ROUNDING).astype(np.int64)
    return np.asarray(cells - whole)


def _multiple(count: int, cell: float) -> float:
    """`count` cells, as the number a person would write: 3 cells of 0.1 are 0.3."""
    per_unit = round(1 / cell)
    return count / per_unit if per_unit and 1 / per_unit == cell else count * cell


def _bilinear(
    values: NDArray[np.float64], lattice: Lattice, x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weighted mean of the four centres around each point; a centre of weight 0 is not needed."""
    centre_x, centre_y = lattice.centres()
    right, down = (x - centre_x[0]) / lattice.cell, (centre_y[0] - y) / lattice.cell
    col, row = np.floor(right).astype(np.int64), np.floor(down).astype(np.int64)
    total = np.zeros(x.shape)
    for step_row in (0, 1):
        for step_col in (0, 1):
            weight = np.abs(1 - step_row - (down - row)) * np.abs(1 - step_col - (right - col))
            r, c, needed = row + step_row, col + step_col, weight > 0
            inside = (r >= 0) & (r < lattice.rows) & (c >= 0) & (c < lattice.cols)
            total[needed & ~inside] = np.nan
            use = needed & inside
            total[use] += weight[use] * values[r[use], c[use]]
    return total


def _transform_problem(transform: Affine) -> str | None:
    """Why cells of this transform are not ours; continues a sentence with the file name."""
    if transform.is_identity:
        return "is not georeferenced; assign its position and CRS first"
    if transform.b != 0 or transform.d != 0 or transform.a <= 0 or transform.e >= 0:
        return "is not north up; warp it to a north-up raster first"
    if abs(transform.a + transform.e) > 1e-6 * transform.a:
        return f"has cells of {transform.a:g} x {-transform.e:g}; resample it to square cells first"
    return None


def _fits(value: float, dtype: np.dtype[Any]) -> bool:
    limits = np.iinfo(dtype)
    return float(value).is_integer() and limits.min <= value <= limits.max


def _layout(dtype: np.dtype[Any], cog: bool) -> dict[str, Any]:
    """GDAL's creation options: predictor 3 is made for floats, 2 for integers."""
    common = {"compress": "deflate", "bigtiff": "if_safer"}
    if cog:
        resampling = "average" if dtype.kind == "f" else "nearest"
        return common | {"driver": "COG", "predictor": "yes", "resampling": resampling}
    predictor = 3 if dtype.kind == "f" else 2
    tiles = {"tiled": True, "blockxsize": 256, "blockysize": 256}
    return common | tiles | {"driver": "GTiff", "predictor": predictor}


@contextmanager
def _position_unchecked() -> Iterator[None]:
    """Without rasterio's warning: reading refuses what has no position, writing has one.

    It also warns of one unit per cell from (0, 0), which GeoTIFF keeps very well.
    """
    from rasterio.errors import NotGeoreferencedWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        yield


def _read(source: Any, name: str) -> Raster:
    """A Raster from an open rasterio dataset."""
    if source.count == 0:
        parts = ", ".join(source.subdatasets) or "none"
        raise DataError(f"{name} has no bands of its own; name one of its parts: {parts}")
    if problem := _transform_problem(source.transform):
        raise DataError(f"{name} {problem}")
    if any(dtype not in _DTYPES for dtype in source.dtypes):
        raise DataError(f"{name} holds {source.dtypes[0]} values; convert them to float32 first")
    values, nodata = _values(source)
    return Raster(
        values,
        source.transform,
        crs=CRS.from_wkt(source.crs.to_wkt(version="WKT2_2019")) if source.crs else None,
        nodata=nodata,
        descriptions=tuple(text or "" for text in source.descriptions),
        units=tuple(text or "" for text in source.units),
        name=name,
    )


def _values(source: Any) -> tuple[NDArray[Any], float | None]:
    """All bands with NaN for what is masked, or integers and the value that marks it."""
    values, nodata = source.read(), source.nodata
    valid = source.read_masks() != 0
    scaled = set(source.scales) != {1.0} or set(source.offsets) != {0.0}
    if values.dtype.kind != "f" and not scaled:
        nodata = nodata if nodata is not None and _fits(nodata, values.dtype) else None
        if np.array_equal(valid, np.ones_like(valid) if nodata is None else values != nodata):
            return values, nodata
    if scaled:
        scales, offsets = (np.array(v)[:, None, None] for v in (source.scales, source.offsets))
        return np.where(valid, values * scales + offsets, np.nan), None
    small = values.dtype == np.float32 or values.dtype.itemsize <= 2
    values = values.astype(np.float32 if small else np.float64)
    values[~valid] = np.nan
    return values, nodata if source.dtypes[0].startswith("float") else None
