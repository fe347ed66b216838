"""Point clouds: coordinates, attributes and CRS, read from and written to files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyproj import CRS

from toolbox import language
from toolbox.context import QUIET, Context, Digested
from toolbox.data.cloud import joining, parts, saving
from toolbox.data.cloud.arrays import columns_of, coordinates, frozen, indices
from toolbox.data.cloud.gps_time import days_of
from toolbox.data.cloud.opening import read_other
from toolbox.data.crs import crs_of, metres_per_unit
from toolbox.data.extras import PARQUET, PLY, Extra
from toolbox.data.las import points as las_points
from toolbox.data.las.header import LasMetadata
from toolbox.data.las.joint import with_layout
from toolbox.data.las.read import read_las
from toolbox.data.las.waveforms import (
    Pulse,
    WaveformDescriptor,
    descriptors,
    own_packets,
    place_of,
    pulse,
    size_of,
)
from toolbox.data.layer import Inside, Layer
from toolbox.data.paths import COPC, LAS, TEXT, Paths, PointFiles, suffix_of
from toolbox.data.reading import Reading
from toolbox.data.record import own_side_car
from toolbox.data.writing import followed, refuse_to_replace
from toolbox.errors import DataError, nearest

if TYPE_CHECKING:
    import pandas as pd


class PointCloud(Layer):
    """Points with attributes and a CRS, immutable; data of a LAS file stay the same, bit for bit.

    A cloud from LAS keeps the packed point records of the file (20 to 38 bytes per point and the
    extra bytes), and in addition only what was changed. Coordinates are computed when first
    asked for (24 bytes per point more); attributes are unpacked at each access.

    Attributes have the names of LAS: intensity, return_number, number_of_returns,
    classification, gps_time, red, ... and those of extra bytes. Colours are 16 bit.

    Parameters
    ----------
    xyz : of shape (n, 3), in the unit of the CRS
    attributes : name to array of n numbers
    crs : also as a text or number, such as "EPSG:32635"; None if not known
    name : of the file, for messages
    descriptions : of attributes that LAS does not know, with their unit, at most 32 characters

    Raises
    ------
    DataError
        The shapes do not fit, or an attribute is not made of numbers.

    Examples
    --------
    >>> cloud = PointCloud([[0, 0, 5.0], [1, 0, 6.0]], {"classification": [2, 6]})
    >>> cloud.select(cloud["classification"] == 2).xyz
    array([[0., 0., 5.]])
    >>> cloud.with_attributes({"height": cloud["z"] - 5.0}).names
    ('classification', 'height')
    """

    SUFFIXES: ClassVar[tuple[str, ...]] = (".laz", ".las", ".csv", ".xyz", ".txt", ".ply")
    numbers_in: ClassVar[str] = 'take .xyz, or one attribute by its name such as cloud["intensity"]'
    SUFFIXES += (".csv.gz", ".xyz.gz", ".txt.gz", COPC, ".parquet")
    NEEDS: ClassVar[Mapping[str, Extra]] = MappingProxyType({".parquet": PARQUET, ".ply": PLY})
    OF_LAS: ClassVar[frozenset[str]] = las_points.STANDARD  # attributes of some point format
    is_spatial: ClassVar[bool] = True
    tools: ClassVar[str] = "points"
    axes: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    name: str
    crs: CRS | None
    in_blocks: ClassVar[bool] = True

    def __init__(
        self,
        xyz: ArrayLike,
        attributes: Mapping[str, ArrayLike] | None = None,
        *,
        crs: CRS | str | int | None = None,
        name: str = "",
        descriptions: Mapping[str, str] | None = None,
    ) -> None:
        self._xyz: NDArray[np.float64] | None = coordinates(xyz)
        self._size = len(self._xyz)
        self._metadata: LasMetadata | None = None
        self._packed: NDArray[Any] | None = None
        self._moved = False  # whether the coordinates differ from those of the point records
        self._origin: NDArray[np.int64] | None = None  # see `origin`
        self._file: NDArray[np.int32] | None = None  # see `file`
        self._extent: tuple[float, ...] | None = None  # see `extent`
        self._steps: las_points.Steps | None = None  # see `with_steps`
        self._places: Digested | None = None  # see `places`
        self._columns = columns_of(attributes or {}, self._size)
        self._descriptions = dict(descriptions or {})
        self.crs, self.name = crs_of(crs), name

    @classmethod
    def from_arrays(
        cls,
        x: ArrayLike,
        y: ArrayLike,
        z: ArrayLike,
        *,
        crs: CRS | str | int | None = None,
        name: str = "",
        **attributes: ArrayLike,
    ) -> PointCloud:
        """Points of three arrays of coordinates, with attributes by name.

        Raises
        ------
        DataError
            The arrays are of different lengths, or hold no numbers.

        Examples
        --------
        >>> PointCloud.from_arrays([0, 1], [0, 0], [5, 6], classification=[2, 6])["z"]
        array([5., 6.])
        """
        axes = [np.asarray(axis, np.float64) for axis in (x, y, z)]
        if len({axis.shape for axis in axes}) > 1 or axes[0].ndim != 1:
            shapes = ", ".join(str(axis.shape) for axis in axes)
            raise DataError(f"x, y and z must be three arrays of one length, got {shapes}")
        return cls(np.column_stack(axes), attributes, crs=crs, name=name)

    def to_dataframe(self) -> pd.DataFrame:
        """A table of pandas with x, y, z and all attributes, one row per point.

        An attribute of several elements becomes several columns, `name_0`, `name_1`, ...; the CRS
        is in `attrs["crs"]` of the table, as a text.

        Examples
        --------
        >>> PointCloud([[0, 0, 5.0]], {"classification": [2]}).to_dataframe()
             x    y    z  classification
        0  0.0  0.0  5.0               2
        """
        return parts.dataframe(self)

    @classmethod
    def open(
        cls,
        path: Paths | PointFiles,
        *,
        columns: Sequence[str] | None = None,
        separator: str | None = None,
        bounds: Sequence[float] | None = None,
        point_range: tuple[int, int] | None = None,
        assume_crs: CRS | str | int | None = None,
        reading: Reading | None = None,
        ctx: Context = QUIET,
    ) -> PointCloud:
        """Read a file in the format that its suffix names, or join all files of a survey.

        Parameters
        ----------
        path : of a .las, .laz, .ply, .pcd, .e57, .ptx or a text file (.xyz .txt .csv .pts .asc);
            text and PLY also compressed, with .gz behind. Or a folder of such files, a pattern such
            as ``tiles/*.laz``, a virtual point cloud (.vpc), or a list of these, whose points come
            in the order of the sorted paths; see :class:`toolbox.data.Survey`
        columns : names of the columns of a text file, with x, y and z among them
        separator : between the columns of a text file; found out unless given
        bounds : (xmin, ymin, xmax, ymax), in the CRS of the file: only points within, or on the
            edge; of a COPC file no more than needed is read, and of a survey only the files whose
            bounding boxes touch it
        point_range : (start, stop): only the points with these indices, stop excluded
        assume_crs : of files that state none, or the stated one with its height system
        reading : where hashes and records of the files that are read from end to end are noted
        ctx : told of progress, and asked whether to stop

        Raises
        ------
        DataError
            The file is missing, damaged or of an unknown format, or the options do not suit it.
        """
        if bounds is not None and not _is_box(bounds):
            text = f"bounds must be xmin ymin xmax ymax, got {list(bounds)}"
            raise DataError(f"{PointFiles.of(path).name}: {text}")
        files = PointFiles.of(path, bounds)
        if len(files.paths) > 1:
            from toolbox.data.survey import Survey

            how: dict[str, Any] = {"columns": columns, "separator": separator}
            survey = Survey.open(files, assume_crs=assume_crs, ctx=ctx.part(0, 0.05), **how)
            return survey.read(bounds=bounds, reading=reading, ctx=ctx.part(0.05, 1))
        (file,) = files.paths
        suffix = suffix_of(file)
        if suffix not in TEXT and (columns or separator):
            raise DataError(f"{file}: columns and separator are for text files, not for {suffix}")
        try:
            cloud = cls._read(file, suffix, columns, separator, bounds, point_range, reading, ctx)
        except OSError as error:
            raise DataError(f"{file} cannot be read: {error.strerror or error}") from error
        cloud = cloud.assuming(assume_crs)
        return cloud if bounds is None else cloud.within(bounds)

    @classmethod
    def _read(
        cls,
        path: Path,
        suffix: str,
        columns: Sequence[str] | None,
        separator: str | None,
        bounds: Sequence[float] | None,
        point_range: tuple[int, int] | None,
        reading: Reading | None,
        ctx: Context,
    ) -> PointCloud:
        if suffix in LAS:
            found = read_las(path, bounds=bounds, point_range=point_range, reading=reading, ctx=ctx)
            return cls._of_las(*found, path.name)
        xyz, attributes, crs = read_other(
            path, suffix, columns=columns, separator=separator, reading=reading, ctx=ctx
        )
        cloud = cls(xyz, attributes, crs=crs, name=path.name)
        return cloud.select(np.arange(*point_range)) if point_range else cloud

    @classmethod
    def concat(cls, clouds: Iterable[PointCloud]) -> PointCloud:
        """Join clouds into one, in their order.

        Clouds from LAS files of the same layout (point format, extra bytes, scale, offset) are
        joined bit for bit. Otherwise the point format is one that has the attributes of all, the
        scale is the finest, and header and VLRs are those of the first. What a file
        lacks, extra bytes too, is 0 in its points, as LAS has it for what is not known; a warning
        names the file and the attributes. Clouds that did not come from LAS must have the same
        attributes.

        Parameters
        ----------
        clouds : at least one, all in the same CRS

        Raises
        ------
        DataError
            The CRS or the attributes of two clouds differ, or no LAS layout suits all of them.
        """
        given = list(clouds)
        if not given:
            raise DataError("there are no clouds to join")
        if len(given) == 1:
            return given[0]
        joining.warn_of_clocks(given, lambda: [cloud for cloud in given if len(cloud)])
        empty = cls.template([cloud.select([]) for cloud in given], lambda: joining.boxes_of(given))
        return empty.filled((cloud.like(empty) for cloud in given), sum(map(len, given)))

    @classmethod
    def template(
        cls, clouds: Sequence[PointCloud], boxes: Callable[[], Sequence[las_points.Box]]
    ) -> PointCloud:
        """A cloud without points in the layout that joins some clouds; see :meth:`like`.

        Parameters
        ----------
        clouds : all that will be joined, with or without their points
        boxes : lowest and highest coordinates of those that have points

        Raises
        ------
        DataError
            As for :meth:`concat`.
        """
        return joining.template(clouds, boxes)

    def like(self, template: PointCloud) -> PointCloud:
        """The same points in the layout of a template: point format, attributes and CRS.

        Raises
        ------
        DataError
            The points do not fit the point format of the template.
        """
        return joining.like(self, template)

    def filled(self, clouds: Iterable[PointCloud], size: int) -> PointCloud:
        """This template filled with the points of clouds that are like it.

        Parameters
        ----------
        clouds : made one after the other, so that they need not be in memory at the same time
        size : number of all their points
        """
        return joining.filled(self, clouds, size)

    @classmethod
    def _of_las(cls, metadata: LasMetadata, packed: NDArray[Any], name: str) -> PointCloud:
        cloud = cls(np.empty((0, 3)), crs=metadata.crs, name=name)
        packed.flags.writeable = False
        cloud._metadata, cloud._packed, cloud._size = metadata, packed, len(packed)
        cloud._xyz = None
        return cloud

    @classmethod
    def of_metadata(cls, metadata: LasMetadata, name: str) -> PointCloud:
        """A cloud without points, from the metadata of a LAS file."""
        return cls._of_las(metadata, np.empty(0, metadata.header.point_format.dtype()), name)

    def __len__(self) -> int:
        return self._size

    @property
    def xyz(self) -> NDArray[np.float64]:
        """Coordinates of shape (n, 3), in the unit of the CRS; read-only."""
        if self._xyz is None:
            assert self._metadata is not None
            assert self._packed is not None
            self._xyz = las_points.coordinates(self._metadata.header, self._packed)
            self._xyz.flags.writeable = False
        return self._xyz

    @property
    def places(self) -> Digested:
        """The coordinates with their digest, which clouds with other attributes take over.

        Steps that look at the same points are told by it, see :meth:`toolbox.context.Context.once`.
        """
        if self._places is None or self._places.array is not self.xyz:
            self._places = Digested(self.xyz)
        return self._places

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the attributes; those of the file come first."""
        of_file = self._metadata.names if self._metadata else ()
        return of_file + tuple(name for name in self._columns if name not in of_file)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __setitem__(self, name: str, values: Any) -> NoReturn:
        """Layers are not changed in place."""
        how = f"with_attributes({{{name!r}: values}})"
        raise TypeError(f"layers are not changed in place; {how} gives a new one")

    def __getitem__(self, name: str) -> NDArray[Any]:
        """An attribute of n points, or "x", "y" or "z"; read-only.

        Scaled extra bytes are given in their unit. An extra-byte dimension of k elements has the
        shape (n, k).

        Raises
        ------
        DataError
            There is no such attribute.
        TypeError
            It is no name.
        """
        if not isinstance(name, str):
            raise TypeError(
                f"[...] takes the name of an attribute, got {type(name).__name__}; "
                "select(mask) gives the points of a mask or of indices"
            )
        if name in self._columns:
            return self._columns[name]
        if name in ("x", "y", "z"):
            values: NDArray[Any] = np.ascontiguousarray(self.xyz[:, "xyz".index(name)])
        elif self._metadata is not None and self._packed is not None and name in self.names:
            values = las_points.attribute(self._metadata.header.point_format, self._packed, name)
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
        extras = self._metadata.extras if self._metadata else ()
        return {extra.name: extra.description for extra in extras} | self._descriptions

    @property
    def bounds(self) -> tuple[float, float, float, float, float, float]:
        """xmin, ymin, zmin, xmax, ymax, zmax of the points; NaN without points."""
        if len(self) == 0:
            return (np.nan,) * 6
        if self._xyz is None and self._metadata is not None and self._packed is not None:
            low, high = las_points.box_of(self._metadata.header, self._packed)
        else:
            axes = self.xyz.T  # one by one, which takes a tenth of the time of rows of three
            low, high = (np.array([end(axis) for axis in axes]) for end in (np.min, np.max))
        return (*low.tolist(), *high.tolist())

    def days(self) -> tuple[date, date] | None:
        """First and last day on which points were measured, UTC; None if the data do not tell.

        GPS time tells the day if the file says that it is adjusted standard time: seconds since
        6 January 1980, less a billion (LAS 1.4 R15, 2.4, global encoding bit 0).
        """
        if self._metadata is None or "gps_time" not in self:
            return None
        if not self._metadata.header.global_encoding.gps_time_type:
            return None
        return days_of(self["gps_time"])

    @property
    def waveforms(self) -> tuple[str, int, tuple[WaveformDescriptor, ...]]:
        """Where the packets of waveforms are, "" without any; their bytes; how they are sampled."""
        if self._metadata is None:
            return "", 0, ()
        return place_of(self._metadata), size_of(self._metadata), descriptors(self._metadata)

    def pulse(self, number: int) -> Pulse:
        """The waveform of one point, by its number from 0.

        Raises
        ------
        DataError
            The point has none, or its packet is not there or cannot be read.
        """
        if self._metadata is None or self._packed is None:
            raise DataError(f"{self.name or 'the cloud'} has no waveforms")
        return pulse(self._metadata, self._packed, number)

    @property
    def extent(self) -> tuple[float, ...]:
        """As `bounds`, but of the whole survey that a tile is cut from, so that tiles agree."""
        return self.bounds if self._extent is None else self._extent

    def with_extent(self, extent: tuple[float, ...] | None) -> PointCloud:
        """The same points as those of a survey with these bounds, see `extent`."""
        cloud = self._copy()
        cloud._extent = extent
        return cloud

    @property
    def metre(self) -> float:
        """Length of one metre in the unit of the coordinates; 1.0 without a CRS."""
        return 1 / metres_per_unit(self.crs)

    def select(self, which: ArrayLike) -> PointCloud:
        """The points of a mask, or of an array of indices in that order."""
        index = indices(np.asarray(which), len(self))
        cloud = self._copy()
        cloud._size, cloud._places = len(index), None
        # Of records and rows, take() is far faster than an index in brackets.
        cloud._packed = None if self._packed is None else frozen(self._packed.take(index))
        cloud._xyz = None if self._xyz is None else frozen(self._xyz.take(index, axis=0))
        cloud._columns = {name: frozen(values[index]) for name, values in self._columns.items()}
        cloud._origin = None if self._origin is None else frozen(self._origin[index])
        cloud._file = None if self._file is None else frozen(self._file[index])
        return cloud

    def within(self, bounds: Sequence[float]) -> PointCloud:
        """The points within (xmin, ymin, xmax, ymax), or on the edge."""
        inside = self.inside(bounds)
        return self if inside.all() else self.select(inside)

    def inside(self, bounds: Sequence[float]) -> NDArray[np.bool_]:
        """Mask of the points within (xmin, ymin, xmax, ymax), or on the edge."""
        x, y = self._x_and_y()
        found = (x >= bounds[0]) & (x <= bounds[2]) & (y >= bounds[1]) & (y <= bounds[3])
        return np.asarray(found)

    def boxes(self, size: int) -> NDArray[np.float64]:
        """(xmin, ymin, xmax, ymax) of the first so many points, the next, and so on: shape (m, 4).

        >>> PointCloud.from_arrays([0, 1, 7], [5, 4, 7], [9, 9, 9]).boxes(2)
        array([[0., 4., 1., 5.],
               [7., 7., 7., 7.]])
        """
        xy, starts = self._x_and_y(), np.arange(0, len(self), size)
        if not len(starts):
            return np.empty((0, 4))
        ends = (function.reduceat(xy, starts, axis=1) for function in (np.minimum, np.maximum))
        return np.vstack([*ends]).T

    def _x_and_y(self) -> NDArray[np.float64]:
        """The two axes of shape (2, n); those of all points are not kept to choose a few."""
        if self._xyz is None and self._metadata is not None and self._packed is not None:
            return las_points.axes_of(self._metadata.header, self._packed, "XY")
        return self.xyz[:, :2].T

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
        cloud._columns = self._columns | columns_of(attributes, len(self))
        cloud._descriptions = self._descriptions | dict(descriptions or {})
        return cloud

    def without_attributes(self, names: Iterable[str]) -> PointCloud:
        """The same points without attributes that LAS does not know (extra bytes).

        Raises
        ------
        DataError
            An attribute belongs to the point format, or there is no such one.
        """
        dropped = set(names)
        cloud = self._copy()
        cloud._columns = {n: v for n, v in self._columns.items() if n not in dropped}
        if self._metadata is not None and self._packed is not None:
            extras = {extra.name for extra in self._metadata.extras}
            if dropped & extras:
                made = las_points.without_extras(self._metadata, self._packed, dropped & extras)
                cloud._metadata, cloud._packed = made[0], frozen(made[1])
        if left := dropped & set(cloud.names):
            raise DataError(f"{', '.join(sorted(left))} belongs to the point format")
        if unknown := sorted(dropped - set(self.names)):
            raise DataError(self._unknown(unknown[0]))
        cloud._descriptions = {n: t for n, t in self._descriptions.items() if n not in dropped}
        return cloud

    def with_xyz(self, xyz: ArrayLike) -> PointCloud:
        """The same points with other coordinates, of shape (n, 3)."""
        moved = coordinates(xyz)
        if len(moved) != len(self):
            raise DataError(f"{len(moved)} coordinates do not fit {len(self)} points")
        cloud = self._copy()
        cloud._xyz, cloud._moved, cloud._extent, cloud._places = moved, True, None, None
        return cloud

    @property
    def steps(self) -> las_points.Steps | None:
        """Scales and offsets with which LAS holds the coordinates; None where nothing says it."""
        if self._metadata is None:
            return self._steps
        header = self._metadata.header
        return tuple(header.scales.tolist()), tuple(header.offsets.tolist())

    def with_steps(self, steps: las_points.Steps) -> PointCloud:
        """The same points, for which LAS has these scales and offsets when they are written."""
        cloud = self._copy()
        cloud._xyz, cloud._moved, cloud._steps = self.xyz, True, steps
        if self._metadata is not None:
            header = self._metadata.header.copy()
            header.scales, header.offsets = map(np.array, steps)
            cloud._metadata = replace(self._metadata, header=header)
        return cloud

    @property
    def origin(self) -> NDArray[np.int64] | None:
        """Index of each of the n points in the survey, if the cloud is a tile of it; else None.

        The index counts through all files. A point in the halo of the tile has -1 - index. What is
        selected from the tile keeps its origin.
        """
        return self._origin

    @property
    def core(self) -> NDArray[np.bool_]:
        """Mask of shape (n,): true for points of the tile itself, false for those of its halo."""
        return np.ones(len(self), bool) if self._origin is None else self._origin >= 0

    @property
    def number(self) -> NDArray[np.int64]:
        """Index of each point in the survey, also of points in the halo of a tile; see `origin`."""
        if self._origin is None:
            return np.arange(len(self))
        return np.where(self._origin < 0, -1 - self._origin, self._origin)

    def with_origin(self, origin: NDArray[np.int64] | None) -> PointCloud:
        """The same points as a tile of a survey, see `origin`."""
        cloud = self._copy()
        cloud._origin = None if origin is None else frozen(origin)
        return cloud

    @property
    def file(self) -> NDArray[np.int32]:
        """Index of the file of a survey that each of the n points comes from."""
        return frozen(np.zeros(len(self), np.int32)) if self._file is None else self._file

    def with_file(self, file: NDArray[np.integer[Any]] | None) -> PointCloud:
        """The same points as those of several files, see `file`."""
        cloud = self._copy()
        cloud._file = None if file is None else frozen(file.astype(np.int32))
        return cloud

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of n rows that hold the points, by name; see :meth:`with_arrays`."""
        found = {f"column {name}": values for name, values in self._columns.items()}
        if self._packed is not None:
            found["packed"] = self._packed
        if self._moved or self._packed is None:
            found["xyz"] = self.xyz
        return found

    def with_arrays(self, arrays: Mapping[str, NDArray[Any]]) -> PointCloud:
        """A cloud in the layout of this one with the points of :meth:`arrays` of another."""
        cloud = self._copy()
        cloud._size = len(next(iter(arrays.values())))
        cloud._packed = arrays.get("packed")
        cloud._xyz = arrays.get("xyz")
        cloud._columns = {name: arrays[f"column {name}"] for name in self._columns}
        cloud._origin = cloud._file = cloud._places = None
        return cloud

    def with_crs(self, crs: CRS | str | int | None) -> PointCloud:
        """The same points, stated to be in another CRS; nothing is transformed."""
        cloud = self._copy()
        cloud.crs = crs_of(crs)
        return cloud

    # What every layer answers, see toolbox.data.layer ---------------------------------------------

    def size(self, inside: Inside | None = None) -> int:
        """Number of points; only of those that belong to a tile."""
        return len(self) if inside is None else int(np.count_nonzero(self._belong(inside)))

    def _belong(self, inside: Inside) -> NDArray[np.bool_]:
        """The points that belong to a tile: of new ones, those that are inside."""
        if self._origin is not None:
            return self.core
        return inside(self.xyz[:, 0], 0) & inside(self.xyz[:, 1], 1)

    def cropped(self, inside: Inside) -> PointCloud:
        """The points that belong to a tile."""
        return self.select(self._belong(inside))

    def contents(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Coordinates and attributes."""
        yield "xyz", self.xyz
        yield from ((name, self[name]) for name in self.names)

    def apart(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """The arrays of the points; header, layout, and the box around them."""
        return parts.apart(self)

    @classmethod
    def of_parts(cls, arrays: Mapping[str, NDArray[Any]], rest: Mapping[str, Any]) -> PointCloud:
        """The points that :meth:`apart` has taken apart."""
        return parts.joined(cls, arrays, rest)

    def size_text(self) -> str:
        """The number of points in words."""
        return f"{language.counted(len(self))} points"

    def differences(self, now: PointCloud) -> Iterator[str]:
        """What differs in another cloud, in words."""
        return parts.differing(self, now)

    def _copy(self) -> PointCloud:
        cloud = object.__new__(type(self))
        cloud.__dict__.update(self.__dict__)
        return cloud

    @classmethod
    def own_files(cls, path: str | Path) -> tuple[Path, ...]:
        """The file at a path, and what an earlier run has put beside it: record and waveforms."""
        return Path(path), *own_side_car(path), *own_packets(Path(path))

    def save(
        self,
        path: str | Path,
        *,
        columns: Sequence[str] | None = None,
        version: str | None = None,
        format: int | None = None,
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write a file; its suffix says in which format.

        A LAS file keeps header, VLRs and all that was not changed. It is written in a newer
        point format where the attributes need it (classes above 31, NIR, ...), and attributes
        that LAS does not know become extra bytes; both are logged. Intensities with decimals, as
        scanners give them, are rounded, those from 0 to 1 after they are spread to 65535; a
        warning says so. A name that ends in .copc.laz
        makes a COPC file, whose points come in another order, in a point format from 6 to 8. The
        provenance record that the points were read with is not kept.

        Parameters
        ----------
        path : ends in one of SUFFIXES
        columns : of text, such as x, y, z and classification; all unless given
        version, format : of LAS, such as "1.2" and 3; those that suit the data unless given
        overwrite : whether files at the path may be replaced
        record : how the file was made, as JSON text (see `toolbox.runs.provenance`)
        ctx : told of progress, and asked whether to stop

        Raises
        ------
        ParameterError
            A file is there that may not be replaced.
        DataError
            The format cannot hold a value, something would be lost in the version or point
            format asked for, or the file cannot be written.
        """
        saving.save(
            self,
            followed(path),
            columns=columns,
            version=version,
            format=format,
            overwrite=overwrite,
            record=record,
            ctx=ctx,
        )

    def as_las(self) -> tuple[LasMetadata, NDArray[Any]]:
        """What a LAS file of the points holds: its metadata, and point records of shape (n,).

        Raises
        ------
        DataError
            LAS cannot hold a value.
        """
        metadata, points, xyz = self._metadata, self._packed, self.xyz if self._moved else None
        if metadata is None or points is None:
            xyz = self.xyz
            metadata, points = las_points.new_metadata(xyz, self._columns, self._steps)
        return las_points.revised(
            metadata,
            points,
            xyz=xyz,
            columns=self._columns,
            descriptions=self._descriptions,
            crs=self.crs,
        )

    def save_batches(
        self,
        path: Path,
        clouds: Iterable[PointCloud],
        size: int,
        *,
        version: str | None = None,
        format: int | None = None,
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write a LAS file from clouds that are made one after the other.

        Parameters
        ----------
        path : ends in .las or .laz; for .copc.laz the points are kept in a file beside it first
        clouds : clouds like this one, a template of clouds that are as read from LAS
        size : number of all their points
        version, format, overwrite, record, ctx : as for :meth:`save`

        Raises
        ------
        ParameterError
            A file is there that may not be replaced.
        DataError
            The file cannot be written.
        """
        path = followed(path)
        refuse_to_replace(path, self.own_files, overwrite=overwrite)
        saving.save_batches(
            self,
            path,
            clouds,
            size,
            version=version,
            format=format,
            record=record,
            ctx=ctx,
        )

    def with_header_of(self, owner: PointCloud) -> PointCloud:
        """This template with header and VLRs of another cloud (owner), but its own layout."""
        cloud = self._copy()
        if self._metadata is not None and owner._metadata is not None:
            cloud._metadata = with_layout(self._metadata, owner._metadata)
        return cloud

    def read_back(self) -> PointCloud:
        """The cloud as it would be if it were saved to a LAS file and read again."""
        cloud = self._of_las(*self.as_las(), self.name)
        return cloud.with_origin(self._origin)

    @property
    def decimals(self) -> tuple[int | None, int | None, int | None]:
        """Decimals that write x, y and z without loss; None where all digits are needed."""
        if self.steps and (self._steps or not self._moved):
            pairs = zip(*self.steps, strict=True)
            return tuple(las_points.step_decimals(*pair) for pair in pairs)  # type: ignore[return-value]
        return tuple(las_points.decimals(self.xyz[:, axis]) for axis in range(3))  # type: ignore[return-value]

    def __repr__(self) -> str:
        return f"<PointCloud {self.name or 'in memory'}: {len(self)} points>"


def _is_box(bounds: Sequence[float]) -> bool:
    return len(bounds) == 4 and bool(bounds[0] <= bounds[2] and bounds[1] <= bounds[3])
