"""Metadata of a file after ISO 19115, as catalogues of agencies take them in.

What can be known is taken from the file and its record: extent, reference system, cell size, how
it was made. Whose it is must be said.

References
----------
ISO 19115:2003, Geographic information, Metadata, and its encoding ISO/TS 19139:2007, which is what
INSPIRE asks for.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS, Transformer

from toolbox import files
from toolbox.context import QUIET, Context
from toolbox.data import Raster, Survey, Vector
from toolbox.data.crs import describe_crs, is_local
from toolbox.data.drivers import RASTERS, VECTORS
from toolbox.data.extras import ISO
from toolbox.data.lattice import in_plan
from toolbox.data.layer import Layer
from toolbox.data.operation import plane
from toolbox.data.reading import file_hash
from toolbox.errors import DataError, ParameterError
from toolbox.runs import provenance

SUFFIX = ".xml"  # is added to the name of the file
LONG_LAT = CRS(4326)
_GEOMETRIES = {"Point": "point", "LineString": "curve", "Polygon": "surface"}


@dataclass(frozen=True, kw_only=True)
class Said:
    """What only people know of a file.

    Attributes
    ----------
    organisation, email : of who answers for it
    title, abstract : of the file; made of its record where they are ""
    rights : what others may do with it
    date : on which it was made, such as 2026-11-23
    """

    organisation: str
    email: str
    title: str = ""
    abstract: str = ""
    rights: str = "not stated"
    date: str


def write(path: Path, said: Said, *, overwrite: bool = False, ctx: Context = QUIET) -> Path:
    """Write the metadata of a raster, vector layer or points beside the file.

    Returns
    -------
    the file that was written: dtm.tif.xml for dtm.tif

    Raises
    ------
    ParameterError
        The path is of a folder, or the metadata stand there already and may not be replaced.
    DataError
        The file cannot be read, has no position on the Earth, or a library is missing.
    """
    ISO.need()
    from pygeometa.schemas.iso19139 import ISO19139OutputSchema

    path = path.resolve()
    if path.is_dir():
        raise ParameterError("metadata", {"file": f"must be a file, and {path} is a folder"})
    target = path.with_name(path.name + SUFFIX)
    found = files.problems(
        {"file": target}, {"file": (SUFFIX,)}, {"file": files.itself}, [], overwrite=overwrite
    )
    if found:
        raise ParameterError("metadata", found)
    text = ISO19139OutputSchema().write(described(path, said, ctx))
    with files.staged({target: files.itself}, overwrite=overwrite) as staged:
        staged[target].write_text(text, encoding="utf-8", newline="\n")
    return target


def described(path: Path, said: Said, ctx: Context = QUIET) -> dict[str, Any]:
    """What is known of a file, in the form that pygeometa takes (a metadata control file).

    Raises
    ------
    DataError
        The file cannot be read, has no position on the Earth, or layers in more than one CRS.
    """
    layers = list(layers_of(path, ctx))
    if not layers:
        raise DataError(f"{path.name}: holds no layer with a position")
    record = provenance.read(path)
    crs = layers[0].crs
    if crs is None or is_local(crs):
        raise DataError(f"{path.name}: has no CRS of the Earth, so that no place can be stated")
    if other := next((layer for layer in layers if layer.crs != crs), None):
        names = [describe_crs(layer.crs) if layer.crs else "no CRS" for layer in (layers[0], other)]
        raise DataError(f"{path.name}: its layers must have one CRS, got {' and '.join(names)}")
    kind, geometry = representation(layers[0])
    made = f"{record.title} ({record.tool})" if record else ""
    title = said.title or (f"{path.name}: {made}" if record else path.name)
    lineage = record.text() if record else "not recorded"
    facts = [f"Coordinates are in {describe_crs(crs)}."]
    if isinstance(layers[0], Raster):
        facts.append(f"Cells are {layers[0].cell / layers[0].metre:.4g} m wide.")
    party = {"organization": said.organisation, "email": said.email, "url": ""}
    return {
        "mcf": {"version": "1.0"},
        "metadata": {
            "identifier": str(uuid.uuid5(uuid.NAMESPACE_OID, file_hash(path, ctx))),
            "language": "eng",
            "charset": "utf8",
            "hierarchylevel": "dataset",
            "datestamp": said.date,
            "dataseturi": path.name,
        },
        "spatial": {"datatype": kind, "geomtype": geometry},
        "identification": {
            "language": "eng",
            "charset": "utf8",
            "title": title,
            "abstract": " ".join([said.abstract or f"{made or path.name}.", *facts]),
            "dates": {"creation": said.date},
            "keywords": {"default": {"keywords": ["LiDAR"], "keywords_type": "theme"}},
            "topiccategory": ["elevation"],
            "extents": {"spatial": list(extents(path.name, crs, layers)), "temporal": []},
            "rights": said.rights,
            "license": {"name": said.rights},
            "url": path.name,
            "status": "completed",
            "maintenancefrequency": "unknown",
            "accessconstraints": "otherRestrictions",
        },
        "contact": {"pointOfContact": party, "owner": party},
        "distribution": {},
        "dataquality": {"scope": {"level": "dataset"}, "lineage": {"statement": lineage}},
    }


def layers_of(path: Path, ctx: Context = QUIET) -> list[Layer]:
    """The layers with a position of a file."""
    suffix = path.suffix.lower()
    if suffix in VECTORS:  # before rasters, of which some may be GeoPackages too
        return [Vector.open(path, layer=name, ctx=ctx) for name in Vector.layers(path)]
    if suffix in RASTERS:
        return [Raster.open(path, ctx=ctx)]
    return [Survey.open(path, ctx=ctx)]


def representation(layer: Layer) -> tuple[str, str]:
    """How a layer represents space, and the kind of its geometry, in the words of the standard."""
    if isinstance(layer, Raster):
        return "grid", "surface"
    if not isinstance(layer, Vector):
        return "vector", "point"
    kinds = {name.removeprefix("Multi") for name in layer.frame.geom_type.dropna()}
    return "vector", _GEOMETRIES[kinds.pop()] if len(kinds) == 1 else "complex"


def extents(name: str, crs: CRS, layers: Sequence[Layer]) -> Iterator[dict[str, Any]]:
    """The extent in the CRS of the file, whose code stands with it, and in WGS 84.

    Raises
    ------
    DataError
        There is nothing in the layers, or the CRS has no code.
    """
    flat = plane(crs)
    corners = np.array([in_plan(layer.bounds) for layer in layers])
    corners = corners[np.isfinite(corners).all(axis=1)]
    if not len(corners):
        raise DataError(f"{name}: holds nothing, and so has no extent")
    code = flat.to_epsg()
    if code is None:
        raise DataError(
            f"{name}: its CRS has no EPSG code, which is what is stated: {describe_crs(crs)}"
        )
    box = [*corners[:, :2].min(axis=0).tolist(), *corners[:, 2:].max(axis=0).tolist()]
    if code != LONG_LAT.to_epsg():
        yield {"bbox": box, "crs": code}
    wide = Transformer.from_crs(flat, LONG_LAT, always_xy=True).transform_bounds(*box)
    yield {"bbox": [round(value, 7) for value in wide], "crs": LONG_LAT.to_epsg()}
