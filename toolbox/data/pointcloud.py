"""Point clouds: coordinates, attributes and CRS, read from and written to files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyproj import CRS

from toolbox.context import QUIET, Context, log
from toolbox.data import las_points
from toolbox.data.crs import describe_crs, metres_per_unit
from toolbox.data.las import read_las, write_las
from toolbox.data.las_header import Frame
from toolbox.errors import DataError, nearest

_LAS = (".las", ".laz")
_TEXT = (".xyz", ".txt", ".csv", ".pts", ".asc")
_READABLE = (*_LAS, *_TEXT, *(f"{suffix}.gz" for suffix in _TEXT), ".ply", ".ply.gz")
_READABLE += (".pcd", ".e57")


class PointCloud:
    """Points with attributes, immutable; what comes from a LAS file stays as it was, bit for bit.

    A cloud from LAS keeps the packed point records of the file (20 to 38 bytes per point and the
    extra bytes), and beside them only what was changed. Coordinates are computed when first
    asked for (24 bytes per point more); attributes are unpacked at each access.

    Attributes have the names of LAS: intensity, return_number, number_of_returns,
    classification, gps_time, red, ... and those of extra bytes. Colours are 16 bit.

    Parameters
    ----------
    xyz : of shape (n, 3), in the unit of the CRS
    attributes : name to array of n numbers
    crs : None if not known
    name : of the file, for messages
    descriptions : of attributes that LAS does not know, with their unit, at most 32 characters

    Raises
    ------
    DataError
        The shapes do not fit, or an attribute is not made of numbers.
    """

    SUFFIXES: ClassVar[tuple[str, ...]] = (".laz", ".las", ".csv", ".xyz", ".txt", ".ply")
    SUFFIXES += (".csv.gz", ".xyz.gz", ".txt.gz")

    def __init__(
        self,
        xyz: ArrayLike,
        attributes: Mapping[str, ArrayLike] | None = None,
        *,
        crs: CRS | None = None,
        name: str = "",
        descriptions: Mapping[str, str] | None = None,
    ) -> None:
        self._xyz: NDArray[np.float64] | None = _coordinates(xyz)
        self._size = len(self._xyz)
        self._frame: Frame | None = None
        self._record: NDArray[Any] | None = None
        self._moved = False  # whether the coordinates differ from those of the record
        self._columns = _columns(attributes or {}, self._size)
        self._descriptions = dict(descriptions or {})
        self.crs, self.name = crs, name

    @classmethod
    def open(
        cls,
        path: str | Path,
        *,
        columns: Sequence[str] | None = None,
        separator: str | None = None,
        bounds: Sequence[float] | None = None,
        ctx: Context = QUIET,
    ) -> PointCloud:
        """Read a file; its suffix says which format it has.

        Parameters
        ----------
        path : of a .las, .laz, .ply, .pcd, .e57 or a text file (.xyz .txt .csv .pts .asc); text
            and PLY also compressed, with .gz behind
        columns : names of the columns of a text file, with x, y and z among them
        separator : between the columns of a text file; found out unless given
        bounds : (xmin, ymin, xmax, ymax), in the CRS of the file: only points within, or on the
            edge; of a COPC file no more than needed is read
        ctx : told of progress, and asked whether to stop

        Raises
        ------
        DataError
            The file is missing, damaged or of an unknown format, or the options do not suit it.
        """
        path = Path(path)
        suffix = _suffix(path)
        _check_file(path, suffix)
        if suffix not in _TEXT and (columns or separator):
            raise DataError(f"{path}: columns and separator are for text files, not for {suffix}")
        if bounds is not None and not _is_box(bounds):
            raise DataError(f"{path}: bounds must be xmin ymin xmax ymax, got {list(bounds)}")
        try:
            cloud = cls._read(path, suffix, columns, separator, bounds, ctx)
        except OSError as error:
            raise DataError(f"{path} cannot be read: {error.strerror or error}") from error
        return cloud if bounds is None else cloud._within(bounds)

    @classmethod
    def _read(
        cls,
        path: Path,
        suffix: str,
        columns: Sequence[str] | None,
        separator: str | None,
        bounds: Sequence[float] | None,
        ctx: Context,
    ) -> PointCloud:
        if suffix in _LAS:
            return cls._of_las(*read_las(path, bounds=bounds, ctx=ctx), path.name)
        crs = None
        if suffix in _TEXT:
            from toolbox.data.text import read_text

            xyz, attributes = read_text(path, columns=columns, separator=separator, ctx=ctx)
        elif suffix == ".ply":
            from toolbox.data.ply import read_ply

            xyz, attributes = read_ply(path)
        elif suffix == ".pcd":
            from toolbox.data.pcd import read_pcd

            xyz, attributes = read_pcd(path)
        else:
            from toolbox.data.e57 import read_e57

            xyz, attributes, crs = read_e57(path, ctx=ctx)
        return cls(xyz, attributes, crs=crs, name=path.name)

    @classmethod
    def _of_las(cls, frame: Frame, record: NDArray[Any], name: str) -> PointCloud:
        cloud = cls(np.empty((0, 3)), crs=frame.crs, name=name)
        record.flags.writeable = False
        cloud._frame, cloud._record, cloud._size = frame, record, len(record)
        cloud._xyz = None
        return cloud

    def __len__(self) -> int:
        return self._size

    @property
    def xyz(self) -> NDArray[np.float64]:
        """Coordinates of shape (n, 3), in the unit of the CRS; read-only."""
        if self._xyz is None:
            assert self._frame is not None
            assert self._record is not None
            self._xyz = las_points.coordinates(self._frame.header, self._record)
            self._xyz.flags.writeable = False
        return self._xyz

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the attributes, those of the file first."""
        of_file = self._frame.names if self._frame else ()
        return of_file + tuple(name for name in self._columns if name not in of_file)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, name: str) -> NDArray[Any]:
        """An attribute of n points, or "x", "y" or "z"; read-only.

        Scaled extra bytes are given in their unit. An extra-byte dimension of k elements has the
        shape (n, k).

        Raises
        ------
        DataError
            There is no such attribute.
        """
        if name in self._columns:
            return self._columns[name]
        if name in ("x", "y", "z"):
            values: NDArray[Any] = np.ascontiguousarray(self.xyz[:, "xyz".index(name)])
        elif self._frame is not None and self._record is not None and name in self.names:
            values = las_points.attribute(self._frame.header.point_format, self._record, name)
        else:
            raise DataError(self._unknown(name))
        values.flags.writeable = False
        return values

    def _unknown(self, name: str) -> str:
        listed = ", ".join(self.names) or "none"
        hint = nearest(str(name), self.names)
        return f"{self.name or 'the cloud'} has no attribute {name!r}, only {listed}{hint}"

    @property
    def descriptions(self) -> dict[str, str]:
        """Descriptions of attributes that LAS does not know."""
        extras = self._frame.extras if self._frame else ()
        return {extra.name: extra.description for extra in extras} | self._descriptions

    @property
    def bounds(self) -> tuple[float, float, float, float, float, float]:
        """xmin, ymin, zmin, xmax, ymax, zmax of the points; NaN without points."""
        if len(self) == 0:
            return (np.nan,) * 6
        low, high = self.xyz.min(axis=0).tolist(), self.xyz.max(axis=0).tolist()
        return (*low, *high)

    @property
    def metre(self) -> float:
        """Length of one metre in the unit of the coordinates; 1.0 without a CRS."""
        return 1 / metres_per_unit(self.crs)

    def select(self, which: ArrayLike) -> PointCloud:
        """The points of a mask, or of an array of indices in that order."""
        index = _indices(np.asarray(which), len(self))
        cloud = self._copy()
        cloud._size = len(index)
        cloud._record = None if self._record is None else _frozen(self._record[index])
        keeps = self._moved or self._record is None
        cloud._xyz = _frozen(self.xyz[index]) if keeps else None
        cloud._columns = {name: _frozen(values[index]) for name, values in self._columns.items()}
        return cloud

    def _within(self, bounds: Sequence[float]) -> PointCloud:
        x, y = self.xyz[:, 0], self.xyz[:, 1]
        inside = (x >= bounds[0]) & (x <= bounds[2]) & (y >= bounds[1]) & (y <= bounds[3])
        return self if inside.all() else self.select(inside)

    def with_attributes(
        self,
        attributes: Mapping[str, ArrayLike],
        *,
        descriptions: Mapping[str, str] | None = None,
    ) -> PointCloud:
        """The same points with attributes added or changed.

        Parameters
        ----------
        attributes : name to array of n numbers
        descriptions : of those that LAS does not know, with their unit
        """
        cloud = self._copy()
        cloud._columns = self._columns | _columns(attributes, len(self))
        cloud._descriptions = self._descriptions | dict(descriptions or {})
        return cloud

    def with_xyz(self, xyz: ArrayLike) -> PointCloud:
        """The same points elsewhere: coordinates of shape (n, 3)."""
        moved = _coordinates(xyz)
        if len(moved) != len(self):
            raise DataError(f"{len(moved)} coordinates do not fit {len(self)} points")
        cloud = self._copy()
        cloud._xyz, cloud._moved = moved, True
        return cloud

    def with_crs(self, crs: CRS | None) -> PointCloud:
        """The same coordinates, said to be in another CRS."""
        cloud = self._copy()
        cloud.crs = crs
        return cloud

    def _copy(self) -> PointCloud:
        cloud = object.__new__(type(self))
        cloud.__dict__.update(self.__dict__)
        return cloud

    def save(self, path: str | Path, *, ctx: Context = QUIET) -> None:
        """Write a file; its suffix says in which format.

        A LAS file keeps header, records and all that was not changed. It is written in a newer
        point format where the attributes need it (classes above 31, NIR, ...), and attributes
        that LAS does not know become extra bytes; both are logged. COPC becomes LAZ, since its
        order of points is lost.

        Parameters
        ----------
        path : ends in one of SUFFIXES
        ctx : told of progress, and asked whether to stop

        Raises
        ------
        DataError
            The format cannot hold a value, or the file cannot be written.
        """
        path = Path(path)
        suffix = _suffix(path)
        if not path.name.lower().endswith(self.SUFFIXES):
            raise DataError(f"{path}: points are written as {', '.join(self.SUFFIXES)}")
        if suffix not in _LAS and self.crs is not None:
            log.info("%s: the format holds no CRS (%s)", path.name, describe_crs(self.crs))
        try:
            if suffix in _LAS:
                self._save_las(path, compress=suffix == ".laz", ctx=ctx)
            elif suffix == ".ply":
                from toolbox.data.ply import write_ply

                write_ply(path, self)
            else:
                from toolbox.data.text import write_text

                write_text(path, self, ctx=ctx)
        except OSError as error:
            raise DataError(f"{path} cannot be written: {error.strerror or error}") from error

    def _save_las(self, path: Path, *, compress: bool, ctx: Context) -> None:
        frame, record, xyz = self._frame, self._record, self.xyz if self._moved else None
        if frame is None or record is None:
            xyz = self.xyz
            frame, record = las_points.new_frame(xyz, self._columns)
        try:
            frame, record = las_points.revised(
                frame,
                record,
                xyz=xyz,
                columns=self._columns,
                descriptions=self._descriptions,
                crs=self.crs,
            )
        except DataError as error:
            raise DataError(f"{path} cannot be written: {error}") from error
        write_las(path, frame, record, compress=compress, ctx=ctx)

    @property
    def decimals(self) -> tuple[int | None, int | None, int | None]:
        """Decimals that say x, y and z without loss; None where only all digits do."""
        if self._frame is not None and not self._moved:
            header = self._frame.header
            pairs = zip(header.scales, header.offsets, strict=True)
            return tuple(las_points.step_decimals(*pair) for pair in pairs)  # type: ignore[return-value]
        return tuple(las_points.decimals(self.xyz[:, axis]) for axis in range(3))  # type: ignore[return-value]

    def __repr__(self) -> str:
        return f"<PointCloud {self.name or 'in memory'}: {len(self)} points>"


def _coordinates(xyz: ArrayLike) -> NDArray[np.float64]:
    found = np.array(xyz, np.float64, order="C", ndmin=2)
    if found.size == 0:
        found = found.reshape(0, 3)
    if found.ndim != 2 or found.shape[1] != 3:
        raise DataError(f"coordinates must have the shape (n, 3), got {found.shape}")
    return _frozen(found)


def _columns(attributes: Mapping[str, ArrayLike], size: int) -> dict[str, NDArray[Any]]:
    """Own, read-only copies of attributes."""
    columns = {}
    for name, values in attributes.items():
        column = np.array(values, order="C")
        if name in ("x", "y", "z", "X", "Y", "Z"):
            raise DataError(f"{name!r} is a coordinate, not an attribute; see with_xyz")
        if column.dtype.kind not in "biuf":
            raise DataError(f"attribute {name!r} must be numbers, got {column.dtype}")
        if column.shape[:1] != (size,) or column.ndim > 2:
            raise DataError(f"attribute {name!r} must have {size} values, got {column.shape}")
        columns[name] = _frozen(column)
    return columns


def _indices(which: NDArray[Any], size: int) -> NDArray[np.intp]:
    """A mask as indices; indices as they are."""
    # An array of bytes is more likely a mask that lost its type than indices up to 255.
    if which.size and (which.dtype.kind not in "biu" or which.dtype in (np.uint8, np.int8)):
        raise DataError(f"points are selected by a mask or by indices, not by {which.dtype}")
    if which.dtype.kind != "b":
        return which.astype(np.intp)
    if which.shape != (size,):
        raise DataError(f"a mask of shape {which.shape} does not fit a cloud of {size} points")
    return np.flatnonzero(which)


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array


def _suffix(path: Path) -> str:
    """The suffix in lower case, the one before it of a compressed text file."""
    name = path.name.lower()
    return Path(name.removesuffix(".gz")).suffix


def _is_box(bounds: Sequence[float]) -> bool:
    return len(bounds) == 4 and bool(bounds[0] <= bounds[2] and bounds[1] <= bounds[3])


def _check_file(path: Path, suffix: str) -> None:
    if path.is_dir():
        raise DataError(f"{path} is a folder, not a file of points")
    if not path.exists():
        raise DataError(f"{path}: no such file")
    if not path.name.lower().endswith(_READABLE):
        raise DataError(f"{path}: points are read from {', '.join(_READABLE)}, not {suffix!r}")
    if path.stat().st_size == 0:
        raise DataError(f"{path} is empty (0 bytes)")
