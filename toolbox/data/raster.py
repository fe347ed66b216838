"""Rasters: bands of values on square cells, north up, read and written with GDAL."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal
from xml.sax.saxutils import escape

import numpy as np
from affine import Affine
from numpy.typing import ArrayLike, DTypeLike, NDArray
from pyproj import CRS

from toolbox.context import QUIET, Context
from toolbox.data import asprs, differences
from toolbox.data.crs import (
    crs_from_json,
    crs_of,
    crs_text,
    crs_to_json,
    is_local,
    local_crs,
    metres_per_unit,
    parse_crs,
)
from toolbox.data.drivers import raster_driver
from toolbox.data.lattice import Lattice
from toolbox.data.layer import Inside, Layer
from toolbox.data.paths import local, named_as_given
from toolbox.data.reading import errors_named, need_memory
from toolbox.data.record import ITEM, checked
from toolbox.data.remote.address import as_path
from toolbox.data.writing import followed, refuse_to_replace
from toolbox.errors import DataError

STRIP = 256  # rows that are written at a time; one row of tiles of the file
_COMPRESSED = {"compress": "deflate", "bigtiff": "if_safer"}
_SAID = ("nodata", "descriptions", "units", "classes", "name")  # of a raster, besides its place
_LOCAL = "LOCAL_CRS"  # metadata item of a raster without CRS, with a word such as "local:mm"
_NODATA = -9999.0  # of float rasters, unless the file or the caller has its own
_SIDE_CARS = (".aux.xml", ".ovr", ".msk", ".msk.ovr")  # what GDAL reads with a GeoTIFF
_LARGEST_BLOCK = 2**30  # bytes; a quarter of them is 256 x 256 cells of a thousand bands
_DTYPES = frozenset(
    f"{kind}{bits}"
    for kind, sizes in {"uint": (8, 16, 32, 64), "int": (8, 16, 32, 64), "float": (32, 64)}.items()
    for bits in sizes
)


@dataclass(frozen=True, eq=False)
class Raster(Layer):
    """One or more bands of values on one lattice, with a CRS.

    Parameters
    ----------
    values : array of shape (bands, rows, cols), or (rows, cols) for one band; float rasters hold
        NaN where nothing is known, integer ones hold `nodata`; bool becomes uint8
    transform : from cell corner to coordinates; north up, square cells
    crs : also as a text or number, such as "EPSG:32635"; None if not known
    nodata : what a file holds where nothing is known; -9999 for floats unless given, or where the
        type of the file cannot hold what is given
    descriptions, units : one text per band, or nothing
    classes : the values are point classes of LAS; a file has their colours, and their names beside
        it (.aux.xml), and no unit of heights
    name : of the file, for messages

    Raises
    ------
    ValueError
        The arguments do not fit each other.

    Examples
    --------
    >>> lattice = Lattice.cover((0, 0, 2, 2), cell=1.0)
    >>> raster = Raster.from_lattice(np.array([[7.0, 8.0], [9.0, np.nan]]), lattice, crs=None)
    >>> raster.band()[0], raster.bounds
    (array([7., 8.]), (0.0, 0.0, 2.0, 2.0))
    >>> raster
    <Raster in memory: 2 rows, 2 columns, cell 1>
    >>> raster.sample(np.array([0.2, 1.9]), np.array([1.8, 1.5]))
    array([7., 8.])
    """

    values: NDArray[Any]
    transform: Affine
    crs: CRS | None = field(default=None, kw_only=True)
    nodata: float | None = field(default=None, kw_only=True)
    descriptions: tuple[str, ...] = field(default=(), kw_only=True)
    units: tuple[str, ...] = field(default=(), kw_only=True)
    classes: bool = field(default=False, kw_only=True)
    name: str = field(default="", kw_only=True)

    SUFFIXES: ClassVar[tuple[str, ...]] = (".tif", ".tiff")
    numbers_in: ClassVar[str] = (
        "take .band() for heights with NaN where cells are empty, or .values for all bands"
    )
    is_spatial: ClassVar[bool] = True
    tools: ClassVar[str] = "surface"
    in_blocks: ClassVar[bool] = True
    is_gridded: ClassVar[bool] = True

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
        object.__setattr__(self, "crs", crs_of(self.crs))
        object.__setattr__(self, "nodata", nodata)
        for texts in ("descriptions", "units"):
            given = tuple(getattr(self, texts)) or ("",) * len(values)
            if len(given) != len(values):
                raise ValueError(f"{len(given)} {texts} for {len(values)} bands")
            object.__setattr__(self, texts, given)

    def __repr__(self) -> str:
        bands = f"{len(self.values)} bands, " if len(self.values) > 1 else ""
        size = f"{bands}{self.size_text()}, cell {self.cell:g}"
        return f"<Raster {self.name or 'in memory'}: {size}>"

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
        """Make a raster of values (bands, rows, cols) or (rows, cols) on a lattice."""
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

    @property
    def _told(self) -> str | None:
        """The CRS as GDAL is told it.

        Of some compound ones, as EPSG:7415, the WKT of PROJ loses names and codes in GeoTIFF keys.
        """
        if self.crs is None or is_local(self.crs):
            return None
        return crs_text(self.crs) if self.crs.is_compound else str(self.crs.to_wkt())

    @classmethod
    def own_files(cls, path: str | Path) -> tuple[Path, ...]:
        """The raster file, and what GDAL reads with it: another CRS, overviews, a mask.

        World files are none of them, since the position in the file comes first.
        """
        return Path(path), *(Path(f"{path}{ending}") for ending in _SIDE_CARS)

    @classmethod
    def open(
        cls,
        path: str | Path,
        *,
        band: int | None = None,
        reproject: CRS | str | None = None,
        assume_crs: CRS | str | int | None = None,
        ctx: Context = QUIET,
    ) -> Raster:
        """Read a raster: GeoTIFF, ASCII grid and more, see `toolbox.data.drivers`.

        Cells without data are those of the file's nodata value, mask or alpha band. Integers
        stay integers where one nodata value says it all, and become floats with NaN where a mask
        or a scale and offset (which are applied) need it.

        Parameters
        ----------
        path : of a file in a format that does not refer to other files, as virtual rasters do
        band : its number, counted from 1; all bands unless given
        reproject : bring the raster to this CRS as surface.reproject does, integers by the cell
            that they lie in and floats between cells; refused where that changes heights
        assume_crs : of a file that states none, or the stated one with its height system
        ctx : where to report progress

        Raises
        ------
        DataError
            The file is missing or unreadable, not georeferenced, not north up, its cells are not
            square, or it has no such band.
        """
        import rasterio

        path = as_path(path)
        here = local(path, ctx)
        with named_as_given(path), errors_named(f"{here} cannot be read as a raster"):
            driver = raster_driver(here)
            with _position_unchecked(), rasterio.open(here, driver=driver) as source:
                raster = _read(source, path.name)
        raster = raster if band is None else raster._alone(band)
        raster = raster.assuming(assume_crs)
        if reproject is not None:
            from toolbox.data.resampling import on_the_way

            wanted = parse_crs(reproject) if isinstance(reproject, str) else reproject
            raster = on_the_way(raster, wanted, ctx=ctx.part(0.2, 1.0))
        ctx.progress(1.0)
        return raster

    def _alone(self, band: int) -> Raster:
        """The raster of one of the bands."""
        if not 1 <= band <= len(self.values):
            raise DataError(f"{self.name} has bands 1 to {len(self.values)}, not {band}")
        only = slice(band - 1, band)
        return replace(
            self,
            values=self.values[only],
            descriptions=self.descriptions[only],
            units=self.units[only],
        )

    def save(
        self,
        path: str | Path,
        *,
        cog: bool = False,
        dtype: DTypeLike | None = None,
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write a GeoTIFF: tiled, deflated, the same bytes for the same raster.

        The file has the type of the values. A tool makes float32 of elevations, which it rounds
        to a quarter of a millimetre below 8192 m; longer numbers, as GPS times, need float64.

        Parameters
        ----------
        path : ends in .tif or .tiff
        cog : write a Cloud Optimized GeoTIFF, with overviews
        dtype : of the file, if not that of the values; float32 rounds float64
        overwrite : whether files at the path may be replaced
        record : how the file was made, as JSON text (see `toolbox.runs.provenance`)
        ctx : where to report progress

        Raises
        ------
        ParameterError
            A file is there that may not be replaced.
        DataError
            The suffix is another, a value does not fit the type or equals the nodata value, or
            the file cannot be written.
        """
        lattice = Lattice.of(self)
        starts = range(0, lattice.rows, STRIP)
        strips = (self.values[:, start : start + STRIP] for start in starts)
        how: dict[str, Any] = {"cog": cog, "dtype": dtype, "overwrite": overwrite}
        self.save_strips(path, lattice, strips, record=record, ctx=ctx, **how)

    def save_strips(
        self,
        path: str | Path,
        lattice: Lattice,
        strips: Iterable[NDArray[Any]],
        *,
        cog: bool = False,
        dtype: DTypeLike | None = None,
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write a GeoTIFF from strips of rows that are made one after the other.

        Parameters
        ----------
        lattice : its cells
        strips : values of shape (bands, STRIP, cols) from north to south, the last may be shorter
        path, cog, dtype, overwrite, record, ctx : as for :meth:`save`, which makes the same file

        Raises
        ------
        ParameterError, DataError
            As for :meth:`save`.
        """
        import rasterio
        import rasterio.shutil
        from rasterio.errors import RasterioError
        from rasterio.windows import Window

        path, wanted = followed(path), np.dtype(dtype or self.values.dtype)
        if path.suffix.lower() not in self.SUFFIXES:
            raise DataError(f"{path}: rasters are written as {' or '.join(self.SUFFIXES)}")
        refuse_to_replace(path, self.own_files, overwrite=overwrite)
        one = replace(self, values=self.values[:, :1, :1])  # what is written where nothing is known
        profile = {
            "count": len(self.values),
            "height": lattice.rows,
            "width": lattice.cols,
            "dtype": wanted.name,
            "crs": self._told,
            "transform": lattice.transform,
            "nodata": one._stored(path, wanted)[1],
        }
        plain = path.with_name(f".plain.{path.name}") if cog else path
        try:
            for old in self.own_files(path):  # or a CRS that is stale would be read back
                old.unlink(missing_ok=True)
            with (
                _position_unchecked(),
                rasterio.open(plain, "w", **profile, **_layout(wanted)) as sink,
            ):
                for number, values in enumerate(strips):
                    top = number * STRIP
                    ctx.progress(top / lattice.rows)
                    stored, _ = replace(self, values=values)._stored(path, wanted)
                    sink.write(stored, window=Window(0, top, lattice.cols, values.shape[1]))
                sink.units = self.units
                if self.classes:
                    sink.write_colormap(1, _class_colours())
                if self.crs is not None and is_local(self.crs):
                    sink.update_tags(**{_LOCAL: crs_text(self.crs)})
                if record:
                    sink.update_tags(**{ITEM: checked(record)})
                for band, text in enumerate(self.descriptions, start=1):
                    sink.set_band_description(band, text)
            if cog:
                rasterio.shutil.copy(plain, path, **_cog_layout(wanted))
            if self.classes:
                Path(f"{path}{_SIDE_CARS[0]}").write_text(_class_names(), encoding="utf-8")
        except (RasterioError, OSError) as error:
            raise DataError(f"{path} cannot be written: {error}") from error
        finally:
            if cog:
                plain.unlink(missing_ok=True)
        ctx.progress(1.0)

    def window(self, rows: slice, cols: slice) -> Raster:
        """The raster of some rows and columns."""
        lattice = Lattice.of(self).window(rows, cols)
        return replace(self, values=self.values[:, rows, cols], transform=lattice.transform)

    def with_crs(self, crs: CRS | str | int | None) -> Raster:
        """The same raster, stated to be in another CRS; nothing is transformed."""
        return replace(self, crs=crs_of(crs))

    # What every layer answers, see toolbox.data.layer ---------------------------------------------

    def size(self, inside: Inside | None = None) -> int | None:
        """Number of cells with a value in any band; only of those that belong to a tile."""
        if inside is not None:
            part = self.cropped(inside)
            return None if part is None else part.size()
        known = (
            ~np.isnan(self.values) if self.values.dtype.kind == "f" else self.values != self.nodata
        )
        return int(np.count_nonzero(known.any(axis=0)))

    def cropped(self, inside: Inside) -> Raster | None:
        """The cells whose centres are inside; None if there are none."""
        x, y = Lattice.of(self).centres()
        cols, rows = np.flatnonzero(inside(x, 0)), np.flatnonzero(inside(y, 1))
        if not (len(rows) and len(cols)):
            return None
        return self.window(slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1))

    def contents(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Where the cells are, what stands for no value, and the values."""
        yield "transform", np.array(self.transform)
        yield "nodata", np.array([np.nan if self.nodata is None else self.nodata])
        yield "values", self.values

    def apart(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """The values, and all that is said of them."""
        rest = {"transform": self.transform[:6], "crs": crs_to_json(self.crs)}
        rest |= {name: getattr(self, name) for name in _SAID}
        return {"values": self.values}, rest

    @classmethod
    def of_parts(cls, arrays: Mapping[str, NDArray[Any]], rest: Mapping[str, Any]) -> Raster:
        """The raster that :meth:`apart` has taken apart."""
        crs, said = crs_from_json(rest["crs"]), {name: rest[name] for name in _SAID}
        return cls(arrays["values"], Affine(*rest["transform"]), crs=crs, **said)

    def size_text(self) -> str:
        """Rows and columns in words."""
        return "{:,} rows, {:,} columns".format(*self.shape)

    def differences(self, now: Raster) -> Iterator[str]:
        """What differs in another raster, in words."""
        if self.values.shape != now.values.shape or self.transform != now.transform:
            yield (
                f"{self.values.shape} cells of {self.cell:g} from {self.bounds[:2]}, "
                f"now {now.values.shape} of {now.cell:g} from {now.bounds[:2]}"
            )
            return
        bands = range(1, len(self.values) + 1)
        arrays = ({f"band {i}": raster.band(i) for i in bands} for raster in (self, now))
        yield from differences.of_arrays(next(arrays), next(arrays), "cells")

    def _stored(self, path: str | Path, wanted: np.dtype[Any]) -> tuple[NDArray[Any], float | None]:
        """The values as the file holds them, with nodata for NaN; and the nodata value."""
        rounds = self.values.dtype.kind == wanted.kind == "f"
        if wanted.name not in _DTYPES or not (rounds or np.can_cast(self.values.dtype, wanted)):
            raise DataError(f"{path}: {self.values.dtype} values do not fit {wanted}")
        if self.values.dtype.kind != "f":
            return self.values.astype(wanted, copy=False), self.nodata
        with np.errstate(over="ignore"):  # the overflow is the error below
            values = self.values.astype(wanted)
            nodata = float(wanted.type(self.nodata))
        if np.any(np.isinf(values) & np.isfinite(self.values)):
            raise DataError(f"{path}: values exceed the range of {wanted}; ask for float64")
        if math.isinf(nodata) and self.nodata != nodata:  # of a DEM in float64, say -1.8e308
            nodata = _NODATA
        if np.any(values == nodata):
            raise DataError(f"{path}: valid cells hold the nodata value {nodata:g}")
        values[np.isnan(values)] = nodata
        return values, nodata

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

    def to_xarray(self) -> Any:
        """The raster as a DataArray of xarray, with the dimensions band, y and x.

        Coordinates are those of the centres of cells; `spatial_ref` says the CRS as rioxarray and
        CF have it. Integers keep their type, and what marks cells without a value.

        Raises
        ------
        DataError
            xarray is not installed.
        """
        try:
            import xarray
        except ImportError as error:
            raise DataError("xarray is not installed: pip install xarray") from error
        x, y = Lattice.of(self).centres()
        place = " ".join(map(repr, self.transform.to_gdal()))
        reference = {"GeoTransform": place} | (
            {"crs_wkt": self.crs.to_wkt(), "spatial_ref": self.crs.to_wkt()} if self.crs else {}
        )
        texts = {"long_name": self.descriptions, "units": self.units}
        said: dict[str, Any] = {name: text for name, text in texts.items() if any(text)}
        if self.nodata is not None and self.values.dtype.kind != "f":
            said["_FillValue"] = self.nodata
        numbers = np.arange(1, len(self.values) + 1)
        return xarray.DataArray(
            self.values,
            dims=("band", "y", "x"),
            coords={"band": numbers, "y": y, "x": x, "spatial_ref": ((), 0, reference)},
            name=self.name or None,
            attrs=said,
        )

    def band(self, i: int = 1) -> NDArray[np.float64]:
        """Band i, counted from 1, as a new array of shape (rows, cols) with NaN for nodata.

        Raises
        ------
        DataError
            There is no such band.
        """
        if not 1 <= i <= len(self.values):
            raise DataError(f"{self.name or 'the raster'} has {len(self.values)} bands, not {i}")
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
        """Values of a band at points; NaN outside and where a needed cell has no data.

        Parameters
        ----------
        x, y : arrays of one shape, in CRS units
        method : "nearest" is the cell that holds the point; "linear" is bilinear between the
            four nearest centres, so NaN within half a cell of the edge
        """
        return self.sampler(band, method=method)(x, y)

    def sampler(
        self, band: int = 1, *, method: Literal["nearest", "linear"] = "nearest"
    ) -> Callable[[ArrayLike, ArrayLike], NDArray[np.float64]]:
        """A function of x and y that samples a band as :meth:`sample`, for many calls."""
        values, lattice = self.band(band), Lattice.of(self)

        def nearest(x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
            found = np.full(np.shape(x), np.nan)
            inside = lattice.holds(x, y)
            row, col = lattice.indices(np.asarray(x)[inside], np.asarray(y)[inside])
            found[inside] = values[row, col]
            return found

        def linear(x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
            return _bilinear(values, lattice, np.asarray(x, float), np.asarray(y, float))

        return linear if method == "linear" else nearest


def _bilinear(
    values: NDArray[np.float64], lattice: Lattice, x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Bilinear mean of the four cell centres around each point; NaN if one that counts is NaN."""
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
    """Say why a transform is not of square cells, north up; continues the name of the file."""
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


def _layout(dtype: np.dtype[Any]) -> dict[str, Any]:
    """GDAL creation options of a GeoTIFF; predictor 3 is made for floats, 2 for integers."""
    predictor = 3 if dtype.kind == "f" else 2
    tiles = {"tiled": True, "blockxsize": STRIP, "blockysize": STRIP}
    return _COMPRESSED | tiles | {"driver": "GTiff", "predictor": predictor}


def _cog_layout(dtype: np.dtype[Any]) -> dict[str, Any]:
    """GDAL creation options of a cloud-optimised GeoTIFF, which is copied from another file."""
    resampling = "average" if dtype.kind == "f" else "nearest"
    return _COMPRESSED | {"driver": "COG", "predictor": "yes", "resampling": resampling}


@contextmanager
def _position_unchecked() -> Iterator[None]:
    """Silence rasterio's warning of files without a position, which reading refuses itself.

    It also warns of one unit per cell from (0, 0), which GeoTIFF keeps very well.
    """
    from rasterio.errors import NotGeoreferencedWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        yield


def _class_colours() -> dict[int, tuple[int, int, int]]:
    """Red, green and blue of each point class of LAS."""
    colours = {number: bytes.fromhex(text[1:]) for number, text in asprs.COLOURS.items()}
    return {number: (each[0], each[1], each[2]) for number, each in colours.items()}


def _class_names() -> str:
    """What GDAL reads beside a file for the names of its values, which GeoTIFF does not hold."""
    names = (asprs.NAMES.get(number, "") for number in range(max(asprs.NAMES) + 1))
    listed = "".join(f"<Category>{escape(name)}</Category>" for name in names)
    band = f'<PAMRasterBand band="1"><CategoryNames>{listed}</CategoryNames></PAMRasterBand>'
    return f"<PAMDataset>{band}</PAMDataset>\n"


def _read(source: Any, name: str) -> Raster:
    """Make a Raster of an open rasterio dataset."""
    if source.count == 0:
        listed = ", ".join(source.subdatasets) or "none"
        raise DataError(
            f"{name} has no bands of its own; make a GeoTIFF of one of its parts: {listed}"
        )
    if problem := _transform_problem(source.transform):
        raise DataError(f"{name} {problem}")
    if any(dtype not in _DTYPES for dtype in source.dtypes):
        raise DataError(f"{name} holds {source.dtypes[0]} values; convert them to float32 first")
    _check_size(source, name)
    values, nodata = _values(source)
    return Raster(
        values,
        source.transform,
        crs=_crs(source),
        nodata=nodata,
        descriptions=tuple(text or "" for text in source.descriptions),
        units=tuple(text or "" for text in source.units),
        name=name,
    )


def _crs(source: Any) -> CRS | None:
    """The CRS that a dataset states; else the local one that we have noted in it."""
    if source.crs:
        return CRS.from_wkt(source.crs.to_wkt(version="WKT2_2019"))
    return local_crs(source.tags().get(_LOCAL, ""))


def _check_size(source: Any, name: str) -> None:
    """Raise a DataError if a raster does not fit into memory, or cannot be unpacked in time.

    Bands that are kept together are unpacked together, for each of them anew where their block is
    larger than what GDAL keeps.
    """
    each: int = np.dtype(source.dtypes[0]).itemsize
    rows, cols = source.block_shapes[0]
    together = source.count if source.profile.get("interleave") == "pixel" else 1
    if rows * cols * each * together > _LARGEST_BLOCK:
        raise DataError(
            f"{name} keeps its {source.count:,} bands together in blocks of {rows:,} x {cols:,} "
            "cells, which are too large to unpack; store the bands apart (INTERLEAVE=BAND)"
        )
    size = source.height * source.width * source.count * (each + 1)  # with the mask
    need_memory(size, f"{name}, {source.height:,} rows x {source.width:,} columns,")


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
