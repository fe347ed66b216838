"""A hash of everything that every tool and model gives: what a change of the inside must not move.

Run it before and after, and compare the two lists line by line::

    python -m tests.bench fingerprints > before.txt
    python -m tests.bench fingerprints > after.txt
    diff before.txt after.txt
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tests.bench.measuring import DATA, folder, say

SUFFIXES = {
    "PointCloud": ".laz",
    "Raster": ".tif",
    "Vector": ".gpkg",
    "Table": ".csv",
    "Report": ".html",
}
ISPRS = "isprs_samples_labelled_laz/samp53_first_last_intensity.laz"
URBAN = "ign_urban_50m/77055_627755.laz"
LINE = "powerline_ahn4/12AN2_20_as_published.laz"
HILLS = "line_quebec_hills/west.laz"
DAM = "water_denoever_ahn3/AHN3.laz"
CORNER = "facade_street_corner/street_thinned.las"
DELFT = "ahn3_delft_bgt/ahn3_cropped_2.laz"
RECORD = '<script type="application/json" id="provenance">'
FRONT = {"attribute": "plane_id", "assume_crs": "local"}
DUTCH = {"assume_crs": "EPSG:28992"}

Case = tuple[str, str, Mapping[str, Any]]
"""Name, id of the tool, and values. A file in a folder is real data, any other one was made by an
earlier case: ``town-points.laz`` is the output `points` of the case `town`."""

CASES: tuple[Case, ...] = (
    ("town", "samples.scene", {"kind": "town", "size": 120.0}),
    ("lake", "samples.scene", {"kind": "reservoir", "size": 250.0, "density": 4.0, "seed": 3}),
    ("front", "samples.scene", {"kind": "facade", "size": 20.0, "density": 300.0, "seed": 2}),
    ("line", "samples.scene", {"kind": "corridor", "size": 400.0, "density": 10.0, "seed": 1}),
    ("random", "samples.scene", {"kind": "power_lines", "size": 300.0, "density": 12.0, "seed": 5}),
    ("info", "points.info", {"points": URBAN}),
    ("folder", "points.info", {"points": "ign_urban_50m/"}),
    ("filter", "points.filter", {"points": ISPRS, "returns": "last", "where": "intensity > 40"}),
    ("bright", "points.filter_intensity", {"points": DAM, **DUTCH}),
    ("clip", "points.clip", {"points": "town-points.laz", "polygons": "town-features.gpkg"}),
    ("thin", "points.thin", {"points": URBAN, "cell": 1.0}),
    ("merge", "points.merge", {"points": "ign_urban_50m/"}),
    ("denoise", "points.denoise", {"points": "isprs_sites/CSite2_orig-utm.laz"}),
    ("ground", "ground.classify", {"points": ISPRS}),
    ("feet", "ground.classify", {"points": "feet/autzen_trim.laz"}),
    ("csf", "ground.csf", {"points": ISPRS}),
    ("sample", "ground.csf", {"points": "csf_sample/sample.ply.gz", "assume_crs": "local"}),
    ("ptd", "ground.ptd", {"points": ISPRS}),
    ("robust", "ground.robust_interpolation", {"points": ISPRS}),
    ("heights", "points.height_above_ground", {"points": "ground-classified.laz"}),
    ("local", "features.local", {"points": URBAN}),
    *(
        (method, "surface.grid", {"points": URBAN, "classes": "2", "cell": 0.5, "method": method})
        for method in ("linear", "natural", "cubic", "idw", "nearest", "mean", "percentile")
    ),
    ("fine", "surface.grid", {"points": URBAN, "classes": "2,6", "cell": 0.25, "max_gap": 5.0}),
    ("errors", "surface.cross_validation", {"points": URBAN, "classes": "2"}),
    (
        "difference",
        "surface.difference",
        {"surface": "idw-surface.tif", "base": "mean-surface.tif"},
    ),
    ("shade", "surface.hillshade", {"surface": "linear-surface.tif"}),
    ("contours", "surface.contours", {"surface": "linear-surface.tif", "interval": 0.5}),
    (
        "surfaces",
        "compare.surfaces",
        {"surface": "idw-surface.tif", "reference": "mean-surface.tif"},
    ),
    (
        "checked",
        "compare.classes",
        {"points": "ground-classified.laz", "reference": ISPRS, "positive": "2"},
    ),
    ("som", "classify.som", {"points": URBAN}),
    ("applied", "classify.som_apply", {"points": URBAN, "map": "som-map.csv"}),
    ("buildings", "classify.buildings", {"points": DELFT, **DUTCH}),
    (
        "outlines",
        "compare.areas",
        {
            "areas": "buildings-outlines.gpkg",
            "reference": {"path": "ahn3_delft_bgt/bgt_east_cropped_2.gpkg", "layer": "pand"},
        },
    ),
    ("urban", "classify.urban", {"points": URBAN}),
    ("returns", "classify.vegetation_by_returns", {"points": URBAN}),
    ("ndvi", "classify.ndvi", {"image": "cir_ign_20cm/split_west_irc.tif", "nir": "1", "red": "2"}),
    (
        "green",
        "classify.vegetation_by_ndvi",
        {"points": "cir_ign_20cm/split_west.laz", "image": "ndvi-ndvi.tif"},
    ),
    ("plane", "planes.fit", {"points": "tls_plane_target/plane.laz", "assume_crs": "local"}),
    ("planes", "planes.extract", {"points": CORNER, "assume_crs": "local"}),
    ("facade", "planes.extract", {"points": "front-points.laz", "tolerance": 0.02}),
    ("sweep", "planes.sweep", {"points": CORNER, "assume_crs": "local"}),
    ("openings", "planes.openings", {"points": "facade-segmented.laz", "plane": 1, **FRONT}),
    (
        "same",
        "compare.planes",
        {
            "points": "facade-segmented.laz",
            "attribute": "plane_id",
            "reference": "front-points.laz",
            "reference_attribute": "plane_id",
        },
    ),
    ("level", "shoreline.water_level", {"points": "lake-points.laz"}),
    ("shore", "shoreline.extract", {"points": "lake-points.laz"}),
    ("dam", "shoreline.extract", {"points": DAM, **DUTCH}),
    ("alpha", "shoreline.alpha_shape", {"points": DAM, "classes": "9", **DUTCH}),
    (
        "storage",
        "shoreline.storage_curve",
        {"terrain": "lake-terrain.tif", "outline": "lake-features.gpkg"},
    ),
    (
        "lines",
        "compare.lines",
        {"lines": "shore-shoreline.gpkg", "reference": "lake-features.gpkg"},
    ),
    ("above", "ground.classify", {"points": LINE, "heights": True, **DUTCH}),
    ("candidates", "corridor.candidates", {"points": "above-classified.laz"}),
    ("wires", "corridor.extract", {"points": LINE, **DUTCH}),
    ("hills", "corridor.extract", {"points": HILLS}),
    ("few", "corridor.extract", {"points": "random-points.laz"}),
    ("voxels", "corridor.extract_voxels", {"points": LINE, **DUTCH}),
    ("part", "corridor.extract", {"points": "candidates-candidates.laz"}),
    (
        "label",
        "corridor.label",
        {"points": "above-classified.laz", "line": "part-classified.laz"},
    ),
    (
        "curves",
        "corridor.catenaries",
        {
            "points": {
                "path": "powerline_blunomy_catenary/easy.csv.gz",
            },
            "assume_crs": "local",
        },
    ),
    (
        "clearance",
        "corridor.clearance",
        {"points": LINE, "wires": "wires-wires.gpkg", "towers": "wires-towers.gpkg", **DUTCH},
    ),
    ("spans", "compare.spans", {"wires": "few-wires.gpkg", "reference": "random-features.gpkg"}),
    ("terrain", "models.terrain", {"points": URBAN}),
    ("reservoir", "models.reservoir_shoreline", {"points": "lake-points.laz"}),
    ("power", "models.power_line_clearance", {"points": LINE, **DUTCH}),
    ("classes", "models.urban_classes", {"points": URBAN}),
    ("tiles", "models.terrain", {"points": "ign_urban_50m/", "tile": 40.0}),
    ("tiled", "ground.csf", {"points": "ign_urban_50m/", "tile": 40.0}),
)


def fingerprints() -> None:
    """A hash of what each output holds, and one of its file, for every tool and model."""
    logging.getLogger("toolbox").setLevel(logging.ERROR)
    used = {id for _, id, _ in CASES}
    for id in _missing(used):
        say(f"fingerprints {id:30} HAS NO CASE")
    with folder() as out:
        for name, id, values in CASES:
            for output, text in _results(out, name, id, values):
                say(f"fingerprints {name:11} {id:28} {output:14} {text}")


def _missing(used: set[str]) -> list[str]:
    from toolbox import catalog

    return [id for id in catalog.own_ids() if id not in used]


def _results(out: Path, name: str, id: str, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Each output of a case with its hashes, or its value; or the error that the case ends in."""
    import toolbox

    spec = _spec(id)
    settings = {n: _place(out, v) if n in spec.sources else v for n, v in values.items()}
    how = {"assume_crs": settings.pop("assume_crs", None)}
    if size := settings.pop("tile", None):
        how |= {"tiling": _tiling(size)}
    paths = {
        output: out / f"{name}-{output}{SUFFIXES[field.kind.word]}"
        for output, field in spec.outputs.items()
        if field.kind.is_layer
    }
    shown = {} if size else {"picture": out / f"{name}.png", "page": out / f"{name}-page.html"}
    try:
        found = toolbox.run(id, settings | paths | shown, **how)
    except Exception as error:  # noqa: BLE001  an error is a result too, and must stay the same
        yield "error", f"{type(error).__name__}: {' '.join(str(error).split())[:150]}"
        return
    for output, field in spec.outputs.items():
        path = paths.get(output)
        if path is None:
            yield output, repr(found.get(output, "not of tiles"))
        elif not path.exists():
            yield output, "none"
        else:
            yield output, f"{_of_layer(field.kind.word, path)} file {_of_bytes(path)}"
    for what, path in shown.items():
        if path.exists():
            yield what, f"{_of_picture(path) if what == 'picture' else ''} file {_of_bytes(path)}"


def _spec(id: str) -> Any:
    from toolbox import catalog

    return catalog.load(id)


def _tiling(size: float) -> Any:
    from toolbox.tiles.tiling import Tiling

    return Tiling(size=size, workers=2)


def _place(out: Path, value: Any) -> Any:
    """The path of a source; of real data if it is in a folder."""
    if isinstance(value, Mapping):
        return {**value, "path": _place(out, value["path"])}
    return (DATA if "/" in value else out) / value


def _of_bytes(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]


def _of_layer(word: str, path: Path) -> str:
    """Of what a layer holds, without the record of how it was made."""
    parts = {"PointCloud": _of_cloud, "Raster": _of_raster, "Vector": _of_vector}
    made = hashlib.sha256()
    for part in parts.get(word, _of_text)(path):
        made.update(part)
    return made.hexdigest()[:12]


def _of_cloud(path: Path) -> Iterator[bytes]:
    import laspy

    las = laspy.read(path)
    yield las.points.array.tobytes()
    yield repr((las.header.scales, las.header.offsets, las.header.parse_crs())).encode()
    yield repr([d.description for d in las.point_format.extra_dimensions]).encode()


def _of_raster(path: Path) -> Iterator[bytes]:
    import rasterio

    with rasterio.open(path) as raster:
        yield raster.read().tobytes()
        about = (raster.transform, raster.crs, raster.nodata, raster.descriptions, raster.units)
        yield repr(about).encode()


def _of_vector(path: Path) -> Iterator[bytes]:
    import geopandas

    frame = geopandas.read_file(path)
    yield repr((frame.crs, list(frame.columns))).encode()
    yield b"".join(frame.geometry.to_wkb())
    yield frame.drop(columns=frame.geometry.name).to_csv().encode()


def _of_text(path: Path) -> Iterator[bytes]:
    """A table, or a page without the record in it."""
    head, start, rest = path.read_text(encoding="utf-8").partition(RECORD)
    yield (head + start + rest.partition("</script>")[2]).encode()


def _of_picture(path: Path) -> str:
    from matplotlib.image import imread

    return hashlib.sha256(imread(path).tobytes()).hexdigest()[:12]
