"""Vector layers: points, lines and polygons with attributes."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox import language
from toolbox.context import QUIET, Context, log
from toolbox.data import (
    cityjson,
    differences,
    dxf,
    feature_table,
    geopackage,
    ifc,
    kmz,
    mesh,
    rounding,
    shapefile,
)
from toolbox.data.crs import (
    ABOVE_ELLIPSOID,
    NOT_STATED,
    crs_from_json,
    crs_of,
    crs_to_json,
    describe_crs,
    height_system,
    horizontal_crs,
    is_local,
    local_crs,
    metres_per_height,
    metres_per_unit,
    parse_crs,
    same_crs,
)
from toolbox.data.drivers import check_vector
from toolbox.data.extras import IFC, PARQUET, PLY, Extra
from toolbox.data.layer import Inside, Layer, refuse_zero_bytes, text_array
from toolbox.data.paths import local, named_as_given
from toolbox.data.reading import errors_named
from toolbox.data.record import (
    own_side_car,
    side_car,
    write_beside,
    write_into_geopackage,
)
from toolbox.data.remote.address import as_path
from toolbox.data.table import Table
from toolbox.data.writing import followed
from toolbox.errors import DataError

if TYPE_CHECKING:
    import geopandas

    from toolbox.data.report import Column, Section

_DRIVERS = {
    ".gpkg": "GPKG",
    ".geojson": "GeoJSON",
    ".fgb": "FlatGeobuf",
    ".shp": "ESRI Shapefile",
    ".kml": "LIBKML",
}
_WGS84 = CRS.from_epsg(4326)
UNDEFINED = "Undefined "  # begins the names of the CRS by which GeoPackages say that there is none


class Vector(Layer):
    """Features (geometries with attributes) in one CRS.

    Parameters
    ----------
    frame : the features; the layer keeps its own copy
    name : of the file, for messages
    geometry_type : of an empty layer, which cannot show it: "Point", "Polygon Z", ...

    Examples
    --------
    >>> import geopandas, shapely
    >>> yard = {"name": ["yard"], "geometry": [shapely.box(0, 0, 9, 9)]}
    >>> layer = Vector(geopandas.GeoDataFrame(yard, crs=32635), name="yard.gpkg")
    >>> len(layer), layer.names, layer.metre
    (1, ('name',), 1.0)
    >>> layer
    <Vector yard.gpkg: 1 features, Polygon>
    """

    numbers_in: ClassVar[str] = "take .frame, a GeoDataFrame"
    SUFFIXES: ClassVar[tuple[str, ...]] = (
        *_DRIVERS,
        ".kmz",
        ".dxf",
        ".parquet",
        ".ply",
        ".csv",
        cityjson.SUFFIX,
        ifc.SUFFIX,
    )
    NEEDS: ClassVar[Mapping[str, Extra]] = MappingProxyType(
        {".parquet": PARQUET, ".ply": PLY, ifc.SUFFIX: IFC}
    )
    SPECIAL: ClassVar[Mapping[str, str]] = MappingProxyType(
        {cityjson.SUFFIX: "buildings with heights", ifc.SUFFIX: "fronts with openings"}
    )
    NEEDING_CRS: ClassVar[tuple[str, ...]] = (".geojson", ".kml", ".kmz")  # one of the Earth
    HEADED: ClassVar[tuple[str, ...]] = (".dxf", ".ifc", cityjson.SUFFIX)  # with title and client
    BALLOONS: ClassVar[tuple[str, ...]] = (".kml", ".kmz")
    is_spatial: ClassVar[bool] = True
    tools: ClassVar[str] = "vectors"
    name: str

    def __init__(
        self, frame: geopandas.GeoDataFrame, *, name: str = "", geometry_type: str = "Unknown"
    ) -> None:
        self._frame, self.name = frame.reset_index(drop=True), name
        self.geometry_type = geometry_type
        self.head: Mapping[str, str] = {}

    def with_head(self, head: Mapping[str, str]) -> Vector:
        """The features, to be written with the title, client and date of the set they belong to.

        IFC and CityJSON have places for them; a feature whose attribute `about` names one of them
        has it as its `text`. What is written beside it is in the language of the set.
        """
        frame = self.frame
        if {"about", "text"} <= set(frame.columns):
            said = frame["text"].map(language.for_people, na_action="ignore")
            own = frame["text"].where(frame["about"].notna(), said)
            frame["text"] = frame["about"].map(head).fillna(own)
        made = self._of(frame)
        made.head = dict(head)
        return made

    @property
    def frame(self) -> geopandas.GeoDataFrame:
        """The features, as a copy that may be changed (made when it is)."""
        return self._frame.copy(deep=False)

    @property
    def crs(self) -> CRS | None:
        """The CRS of the features; None if not known."""
        found: CRS | None = self._frame.crs
        return found

    @property
    def metre(self) -> float:
        """Length of one metre in the unit of the coordinates; 1.0 without a CRS."""
        return 1 / metres_per_unit(self.crs)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) of the features; NaN without any."""
        xmin, ymin, xmax, ymax = self._frame.total_bounds.tolist()
        return xmin, ymin, xmax, ymax

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the attributes."""
        return tuple(map(str, self._frame.columns.drop(self._frame.geometry.name)))

    def __len__(self) -> int:
        return len(self._frame)

    def __repr__(self) -> str:
        kinds = sorted(set(self._frame.geom_type.dropna())) or [self.geometry_type]
        size = ", ".join([f"{len(self)} features", *kinds])
        return f"<Vector {self.name or 'in memory'}: {size}>"

    @classmethod
    def own_files(cls, path: str | Path) -> tuple[Path, ...]:
        """The file at a path, and all files that belong to it, such as .shx and .dbf."""
        path = Path(path)
        if path.suffix.lower() == shapefile.SUFFIX:
            return *shapefile.own_files(path), *own_side_car(path)
        if path.suffix.lower() == geopackage.SUFFIX:
            return geopackage.own_files(path)
        return path, *own_side_car(path)

    @staticmethod
    def layers(path: str | Path) -> tuple[str, ...]:
        """Names of the vector layers in a file; the stem of its own name for GeoParquet.

        Raises
        ------
        DataError
            The file is missing or cannot be read.
        """
        path = as_path(path)
        here = local(path)
        if not here.exists():
            raise DataError(f"{path}: no such file")
        with named_as_given(path), errors_named(f"{here} cannot be read as a vector layer"):
            return _layer_names(here)

    @classmethod
    def open(
        cls,
        path: str | Path,
        *,
        layer: str | None = None,
        columns: Sequence[str] | None = None,
        reproject: CRS | str | None = None,
        assume_crs: CRS | str | int | None = None,
        ctx: Context = QUIET,
    ) -> Vector:
        """Read one layer of a GeoPackage, GeoJSON, FlatGeobuf, Shapefile, KML, GeoParquet, CSV...

        Parameters
        ----------
        path : of a format in `toolbox.data.drivers`, GeoParquet, or CSV with x and y, or wkt
        layer : may be left out where the file has one
        columns : names of all columns of a CSV file, with x and y; instead of its first line
        reproject : bring the features to this CRS as vectors.reproject does; z of formats that say
            nothing of heights is left out
        assume_crs : of a file that states none, or the stated one with its height system
        ctx : where to report progress

        Raises
        ------
        DataError
            The file is missing or unreadable, has no geometry, or has several layers and none
            was named.
        """
        path = as_path(path)
        here = local(path, ctx)
        if not here.exists():
            raise DataError(f"{path}: no such file")
        if columns and path.suffix.lower() != feature_table.SUFFIX:
            raise DataError(f"{path}: columns are for CSV files, not for {path.suffix}")
        with named_as_given(path), errors_named(f"{here} cannot be read as a vector layer"):
            if path.suffix.lower() == ".parquet":
                vector = cls(_read_parquet(here), name=path.name)
            elif path.suffix.lower() == feature_table.SUFFIX:
                vector = cls(feature_table.read(here, columns), name=path.name)
            else:
                vector = _read(here, layer)
        vector = vector.assuming(assume_crs)
        ctx.progress(1.0)
        return vector if reproject is None else vector._reprojected(reproject)

    def _reprojected(self, wanted: CRS | str) -> Vector:
        """The features in another CRS; without heights, if theirs cannot be brought there."""
        import shapely

        from toolbox.data import reprojecting
        from toolbox.data.crs import has_heights
        from toolbox.data.operation import operation

        layer, crs = self, parse_crs(wanted) if isinstance(wanted, str) else wanted
        if self.crs is not None and has_heights(crs) and not has_heights(self.crs):
            log.warning("%s says nothing of heights; its z is left out", self.name)
            frame = self.frame
            layer = self._of(
                frame.set_geometry(shapely.force_2d(frame.geometry.to_numpy()), crs=self.crs)
            )
        try:
            way = operation(layer.crs, crs, layer.bounds, heights=bool(layer.frame.has_z.any()))
        except DataError as error:
            raise DataError(f"{self.name}: {error}") from error
        log.info("%s: %s", self.name, way)
        return reprojecting.features(layer, way)

    def save(
        self,
        path: str | Path,
        *,
        layer: str | None = None,
        add: bool = False,
        rounded: bool = False,
        head: Mapping[str, str] = MappingProxyType({}),
        headings: kmz.Headings = MappingProxyType({}),
        qml: str = "",
        overwrite: bool = False,
        record: str = "",
        ctx: Context = QUIET,
    ) -> None:
        """Write the features to a file in the format that its suffix names.

        The same layer makes the same bytes. GeoPackage is written in version 1.3, which older
        QGIS reads too. GeoJSON keeps the CRS of the layer in its "crs" member, as GDAL does,
        although RFC 7946 knows WGS 84 alone; an empty one keeps no columns. FlatGeobuf sorts its
        features in space. KML is always in WGS 84, so that a layer is transformed to it, heights
        in metres; points and lines are drawn at theirs, outlines on the ground, with names and
        colours; KMZ is the same, packed, with folders. DXF has a unit, but no CRS. PLY is a mesh of
        polygons with heights, CSV a table with x, y and z of points or the WKT of others, both
        without a CRS. CityJSON makes blocks of outlines of buildings with the heights of ground and
        roof (`toolbox.data.cityjson`), IFC walls with openings of an elevation
        (`toolbox.data.ifc`).
        These two and KMZ are not read again. What a Shapefile cannot hold stands in
        `toolbox.data.shapefile`.

        Parameters
        ----------
        path : ends in .gpkg, .geojson, .fgb, .parquet, .shp, .kml, .kmz, .dxf, .ply, .csv,
            .city.json or .ifc
        layer : name of the layer in the file; the stem of the file name unless given
        add : keep the other layers of a GeoPackage
        rounded : write attributes with the digits that a survey knows, see `toolbox.data.rounding`,
            and coordinates in CSV to the millimetre; geometries in other formats are kept
        head : title, client and date (YYYY-MM-DD), for DXF, IFC and CityJSON
        headings : of columns by the name of a layer, for the balloons of KML and KMZ
        qml : the style in which QGIS draws the layer of a GeoPackage; its own choice unless given
        overwrite : whether files at the path, or with `add` a layer of this name, may be replaced
        record : how the file was made, as JSON text (see `toolbox.runs.provenance`)
        ctx : where to report progress

        Raises
        ------
        ParameterError
            A file is there that may not be replaced.
        DataError
            The suffix is another, the format cannot hold the layer (its CRS, a mixture of
            geometry types, a value), or the file cannot be written.
        """
        if head:
            how: dict[str, Any] = {"layer": layer, "add": add, "rounded": rounded, "ctx": ctx}
            how |= {"headings": headings, "qml": qml, "overwrite": overwrite, "record": record}
            self.with_head(head).save(path, **how)
            return
        path = followed(path)
        suffix = _suffix_of(path)
        if suffix not in self.SUFFIXES:
            raise DataError(f"{path}: vector layers are written as {', '.join(self.SUFFIXES)}")
        name = geopackage.name_to_write(path, layer, self.own_files, add=add, overwrite=overwrite)
        local = self.crs if self.crs is not None and is_local(self.crs) else None
        if local is not None and suffix not in (geopackage.SUFFIX, ".parquet"):
            log.info("%s: the format holds no CRS (%s)", path.name, describe_crs(local))
        frame = rounding.rounded(self.frame) if rounded else self.frame
        bare = frame if local is None else Vector(frame).with_crs(None).frame
        if suffix in (".kml", kmz.SUFFIX):
            bare = _for_kml(bare, path)
        with errors_named(f"{path} cannot be written"):
            for old in () if add else self.own_files(path):  # or GDAL would add a layer to them
                old.unlink(missing_ok=True)
            if suffix == ".kml":
                bare = kmz.named(bare, name)
            if suffix in _DRIVERS:
                said = local.name if local else ""
                _write(bare, path, name, self.geometry_type, said, qml)
            elif suffix == kmz.SUFFIX:
                kmz.write(bare, path, name, headings)
            else:
                self._write_otherwise(frame, path, name, rounded=rounded)
            if suffix == ".kml":
                kmz.dress(path, bare, name, headings)
            if side_car(path):
                write_beside(path, record)
            elif record:
                write_into_geopackage(path, record, geopackage.WRITTEN)
        ctx.progress(1.0)

    def _write_otherwise(
        self, frame: geopandas.GeoDataFrame, path: Path, layer: str, *, rounded: bool
    ) -> None:
        """Write a file without GDAL."""
        suffix = _suffix_of(path)
        if suffix == ".parquet":
            PARQUET.need()
            frame.to_parquet(path)
        elif suffix == cityjson.SUFFIX:
            cityjson.write(frame, path, self.head)
        elif suffix == ifc.SUFFIX:
            ifc.write(frame, path, self.metre, self.head)
        elif suffix == ".dxf":
            dxf.write(frame, path, layer)
        elif suffix == ".ply":
            mesh.write(frame, path)
        else:
            decimals = rounding.of_places(self.crs) if rounded else None
            feature_table.write(frame, path, decimals, self.geometry_type)

    def with_crs(self, crs: CRS | str | int | None) -> Vector:
        """The same features, stated to be in another CRS; nothing is transformed."""
        frame = self._frame.set_crs(crs_of(crs), allow_override=True)
        return self._of(frame)

    def _of(self, frame: geopandas.GeoDataFrame) -> Vector:
        made = Vector(frame, name=self.name, geometry_type=self.geometry_type)
        made.head = self.head
        return made

    @classmethod
    def concat(cls, layers: Sequence[Vector]) -> Vector:
        """Join the features of layers to one layer, in their order; at least one layer."""
        import pandas as pd

        filled = [layer.frame for layer in layers if len(layer)] or [layers[0].frame]
        return layers[0]._of(pd.concat(filled))

    # What every layer answers, see toolbox.data.layer ---------------------------------------------

    def size(self, inside: Inside | None = None) -> int:
        """Number of features; only of those that belong to a tile."""
        return len(self) if inside is None else int(np.count_nonzero(self._belong(inside)))

    def _belong(self, inside: Inside) -> NDArray[np.bool_]:
        """The features that belong to a tile: those whose bounding box has its middle inside."""
        box = self._frame.geometry.bounds.to_numpy()
        middle = (box[:, :2] + box[:, 2:]) / 2
        return inside(middle[:, 0], 0) & inside(middle[:, 1], 1)

    def cropped(self, inside: Inside) -> Vector:
        """The features that belong to a tile."""
        return self._of(self.frame[self._belong(inside)])

    def apart(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """The geometries as WKB one after the other, and the attributes."""
        frame, geometry = self._frame, self._frame.geometry
        wkb = [geometry.array.isna().tolist(), geometry.to_wkb()]
        blocks = [b"" if missing else block for missing, block in zip(*wkb, strict=True)]
        arrays: dict[str, NDArray[Any]] = {
            "wkb": np.frombuffer(b"".join(blocks), np.uint8),
            "ends": np.cumsum([len(block) for block in blocks], dtype=np.int64),
        }
        attributes = frame.drop(columns=geometry.name)
        rest: dict[str, Any] = {
            "columns": [_column_to_json(name, column) for name, column in attributes.items()],
            "geometry": [str(geometry.name), frame.columns.get_loc(geometry.name)],
            "crs": crs_to_json(self.crs),
            "name": self.name,
            "geometry_type": self.geometry_type,
        }
        return arrays, rest

    @classmethod
    def of_parts(cls, arrays: Mapping[str, NDArray[Any]], rest: Mapping[str, Any]) -> Vector:
        """The features that :meth:`apart` has taken apart."""
        import geopandas
        import pandas as pd

        blocks = np.split(np.asarray(arrays["wkb"]), arrays["ends"])[:-1]
        shapes = geopandas.GeoSeries.from_wkb(
            [block.tobytes() or None for block in blocks], crs=crs_from_json(rest["crs"])
        )
        columns = {name: _column_from_json(*column) for name, *column in rest["columns"]}
        frame = pd.DataFrame(columns, index=shapes.index)
        name, place = rest["geometry"]
        frame.insert(place, name, shapes)
        made = geopandas.GeoDataFrame(frame, geometry=name)
        return cls(made, name=rest["name"], geometry_type=rest["geometry_type"])

    def contents(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Geometries and attributes as a text."""
        yield "table", text_array(self.frame.to_wkb(hex=True).to_csv(index=False))

    def page_sections(
        self, title: str, help: str, columns: Mapping[str, Column] = MappingProxyType({})
    ) -> tuple[Section, ...]:
        """The attributes of the first features, and where they are."""
        from toolbox.data.report import Rows, Section

        return (Section(title, [Rows(self.listed(), help, columns=columns)]),)

    def listed(self) -> Table:
        """The attributes of the features, and a place in each: in the CRS, and on the Earth."""
        import pandas as pd
        import shapely

        attributes = self.frame.drop(columns=self._frame.geometry.name)
        shapes = self._frame.geometry.to_numpy()
        inside = shapely.point_on_surface(shapely.force_2d(shapes))
        single = shapely.get_type_id(shapes) == 0
        on_the_earth = self.crs is not None and not is_local(self.crs)
        x, y, z = ("easting", "northing", "elevation") if on_the_earth else ("x", "y", "z")
        added = {x: shapely.get_x(inside), y: shapely.get_y(inside)}
        if single.any() and self._frame.has_z.any():
            added[z] = shapely.get_z(np.where(single, shapes, None))
        if self.crs is not None and on_the_earth:
            plane = self._frame.set_geometry(inside, crs=horizontal_crs(self.crs))
            on_earth = plane.geometry.to_crs(_WGS84)
            added |= {"latitude": on_earth.y.to_numpy(), "longitude": on_earth.x.to_numpy()}
        places = pd.DataFrame({n: v for n, v in added.items() if n not in attributes.columns})
        return Table(pd.concat([attributes, places], axis=1))

    def differences(self, now: Vector) -> Iterator[str]:
        """What differs in another layer, in words."""
        return differences.of_frames(self.frame, now.frame)


def _suffix_of(path: Path) -> str:
    """The ending of a file, of two parts for a city model."""
    name = path.name.lower()
    return cityjson.SUFFIX if name.endswith(cityjson.SUFFIX) else path.suffix.lower()


@contextmanager
def _warnings_logged(name: str) -> Iterator[None]:
    """Log the warnings of GDAL about a file, e.g. that M values are left out."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        yield
    for warning in heard:
        log.warning("%s: %s", name, warning.message)


def _read(path: Path, layer: str | None) -> Vector:
    import pyogrio

    with _warnings_logged(path.name):
        name = _choose(path, layer)
        frame = pyogrio.read_dataframe(path, layer=name)
        info = pyogrio.read_info(path, layer=name)
    if path.suffix.lower() == shapefile.SUFFIX:
        frame = frame.rename(columns=shapefile.attribute_names(path))
    if frame.crs is not None and frame.crs.name.startswith(UNDEFINED):
        frame = frame.set_crs(None, allow_override=True)
    if path.suffix.lower() == geopackage.SUFFIX and frame.crs is None:
        frame = frame.set_crs(local_crs(geopackage.description(path, name)))
    return Vector(frame, name=path.name, geometry_type=info["geometry_type"])


def _column_to_json(name: Any, column: Any) -> tuple[str, str, list[Any]]:
    """Name, type and values of a column; times as whole numbers of their unit."""
    if column.dtype.kind in "mM":
        values = column.astype("int64")
    else:
        missing = column.isna() & (column.dtype.kind not in "fO")
        values = column.astype(object).where(~missing, None)
    return str(name), str(column.dtype), values.tolist()


def _column_from_json(kind: Any, values: list[Any]) -> Any:
    """The column of which :func:`_column_to_json` has given type and values."""
    import pandas as pd

    if kind.startswith(("datetime", "timedelta")):
        return pd.Series(values, dtype="int64").astype(kind)
    return pd.Series(pd.array(values, dtype=kind))


def _choose(path: Path, layer: str | None) -> str:
    """Choose the layer to read: the one asked for, or the only one with a geometry."""
    names = _layer_names(path)
    if layer is not None and layer not in names:
        raise DataError(f"{path} has no vector layer {layer!r}, only {', '.join(names) or 'none'}")
    if layer is None and len(names) != 1:
        listed = f"; name one: {', '.join(names)}" if names else ""
        raise DataError(f"{path} has {len(names)} vector layers{listed}")
    return layer or names[0]


def _layer_names(path: Path) -> tuple[str, ...]:
    import pyogrio

    if path.suffix.lower() == ".parquet":
        return (path.stem,) if _is_geoparquet(path) else ()
    if path.suffix.lower() == feature_table.SUFFIX:
        return (path.stem,)
    check_vector(path)
    return tuple(str(name) for name, geometry in pyogrio.list_layers(path) if geometry)


def _is_geoparquet(path: Path) -> bool:
    PARQUET.need()
    import pyarrow.parquet

    return b"geo" in (pyarrow.parquet.read_schema(path).metadata or {})


def _read_parquet(path: Path) -> geopandas.GeoDataFrame:
    import geopandas

    PARQUET.need()
    return geopandas.read_parquet(path)


def _write(
    frame: geopandas.GeoDataFrame,
    path: Path,
    layer: str,
    geometry_type: str,
    description: str,
    qml: str,
) -> None:
    import pyogrio

    refuse_zero_bytes(frame.drop(columns=frame.geometry.name), path)
    suffix = path.suffix.lower()
    if suffix == shapefile.SUFFIX:
        frame = shapefile.with_fields(frame, path)
    options: dict[str, Any] = {}
    if suffix == geopackage.SUFFIX:
        options = {**geopackage.OPTIONS, "layer_options": {"DESCRIPTION": description}}
    if suffix == ".shp":
        options = {"encoding": "UTF-8", "layer_options": {"DBF_DATE_LAST_UPDATE": geopackage.DAY}}
    if frame.empty:
        options["geometry_type"] = geometry_type
    with geopackage.same_date(), warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        warnings.filterwarnings("ignore", "'crs' was not provided")  # plain coordinates
        pyogrio.write_dataframe(frame, path, layer=layer, driver=_DRIVERS[suffix], **options)
    if heard:  # GDAL only warns where a format cuts a value; we do not leave such a file
        path.unlink()
        raise DataError(f"{path} cannot hold the layer: {heard[0].message}")
    _check_crs(frame.crs, path, layer)
    if qml and suffix == geopackage.SUFFIX:
        geopackage.add_style(path, layer, qml)


def _check_crs(crs: CRS | None, path: Path, layer: str) -> None:
    """Raise a DataError if the file written does not hold the CRS, as in some formats."""
    import pyogrio

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an empty Shapefile with heights counts as measured (M)
        name = (
            layer if path.suffix.lower() == geopackage.SUFFIX else None
        )  # some formats choose their own
        text = pyogrio.read_info(path, layer=name)["crs"]
    found = CRS.from_user_input(text) if text else None
    if not same_crs(crs, found):
        path.unlink()
        raise DataError(
            f"{path} cannot hold the CRS of the layer ({describe_crs(crs)}) and would claim "
            f"{describe_crs(found)}; write a GeoPackage (.gpkg)"
        )


def _for_kml(frame: geopandas.GeoDataFrame, path: Path) -> geopandas.GeoDataFrame:
    """The features in WGS 84 longitude and latitude with heights in metres, as KML has them."""
    import shapely

    if frame.crs is None:
        raise DataError(f"{path}: KML is in WGS 84, and the layer has no CRS to transform it from")
    plane = frame.set_crs(horizontal_crs(frame.crs), allow_override=True).to_crs(_WGS84)
    if (metres := metres_per_height(frame.crs)) != 1.0:
        upright = frame.has_z.to_numpy()
        plane.loc[upright, plane.geometry.name] = shapely.transform(
            plane.geometry[upright], lambda xyz: xyz * (1.0, 1.0, metres), include_z=True
        )
    if (frame.has_z & ~frame.geom_type.str.contains("Polygon", na=True)).any():
        plane["altitudeMode"] = "absolute"  # or wires would be drawn on the ground
        if height_system(frame.crs) == NOT_STATED:
            text = (
                "%s: the data do not state what heights refer to, and KML has them above the sea: "
                "what hangs in the air may be drawn too high or too low"
            )
            log.warning(text, path.name)
        if height_system(frame.crs) == ABOVE_ELLIPSOID:
            text = (
                "%s: its heights are above the ellipsoid, and KML has them above the sea: what "
                "hangs in the air is drawn too high or too low; reproject it to such heights"
            )
            log.warning(text, path.name)
    return plane
