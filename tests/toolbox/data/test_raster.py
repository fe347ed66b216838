"""Rasters in memory and in files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from pyproj import CRS

import toolbox
from toolbox.data import Lattice, Raster
from toolbox.data.crs import LOCALS, crs_text, describe_crs, length_problem, parse_crs, same_crs
from toolbox.errors import DataError

NORTH_UP = Affine(0.5, 0, 1000, 0, -0.5, 2000)


# In memory ---------------------------------------------------------------------------------


def test_values_are_read_only_and_bands_are_copies() -> None:
    values = np.arange(6, dtype=np.int16).reshape(2, 3)
    raster = Raster(values, NORTH_UP, nodata=4)
    assert raster.values.shape == (1, 2, 3)
    with pytest.raises(ValueError, match="read-only"):
        raster.values[0, 0, 0] = 9
    band = raster.band()
    assert np.array_equal(band, [[0, 1, 2], [3, np.nan, 5]], equal_nan=True)
    band[:] = 7
    assert raster.values[0, 0, 0] == 0
    assert (raster.cell, raster.shape) == (0.5, (2, 3))
    assert raster.bounds == (1000, 1999, 1001.5, 2000)
    with pytest.raises(DataError, match="has 1 band"):
        raster.band(2)


def test_metre_is_the_length_of_one_in_crs_units() -> None:
    feet = Raster(np.zeros((2, 2)), NORTH_UP, crs=CRS(2992))
    assert feet.metre == pytest.approx(1 / 0.3048)
    assert feet.with_crs(None).metre == 1.0
    assert feet.crs == CRS(2992)


@pytest.mark.parametrize(
    ("values", "transform", "more"),
    [
        (np.zeros(3), NORTH_UP, {}),
        (np.zeros((0, 3)), NORTH_UP, {}),
        (np.zeros((2, 2), complex), NORTH_UP, {}),
        (np.ma.masked_equal([[1, 2]], 1), NORTH_UP, {}),
        (np.zeros((2, 2)), Affine(1, 0, 0, 0, 1, 0), {}),
        (np.zeros((2, 2)), Affine(1, 0, 5, 0, -2, 0), {}),
        (np.zeros((2, 2), np.uint8), NORTH_UP, {"nodata": -1}),
        (np.zeros((2, 2)), NORTH_UP, {"units": ("metre", "metre")}),
    ],
)
def test_arguments_that_do_not_fit(values: Any, transform: Affine, more: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"values|masked|raster|nodata|units"):
        Raster(values, transform, **more)


def test_values_must_fit_their_lattice() -> None:
    with pytest.raises(ValueError, match="lattice"):
        Raster.from_lattice(np.zeros((3, 2)), Lattice(0, 0, 1, 2, 3), crs=None)


# Sampling ----------------------------------------------------------------------------------


def test_linear_sampling_is_exact_on_a_plane() -> None:
    lattice = Lattice.cover((0, 0, 8, 6), 0.5)
    x, y = np.meshgrid(*lattice.centres())
    raster = Raster.from_lattice(2 * x - 3 * y + 1, lattice, crs=None)
    at = np.random.default_rng(0).uniform(0.25, [7.75, 5.75], (100, 2)).T
    assert raster.sample(*at, method="linear") == pytest.approx(2 * at[0] - 3 * at[1] + 1)
    assert np.isnan(raster.sample([0.2, 8.1], [3, 3], method="linear")).all()


def test_sampling_at_centres_needs_no_neighbour() -> None:
    lattice = Lattice.cover((0, 0, 3, 3), 1.0)
    values = np.array([[1, np.nan, 3], [4, 5, 6], [7, 8, np.nan]])
    raster = Raster.from_lattice(values, lattice, crs=None)
    x, y = np.meshgrid(*lattice.centres())
    for method in ("nearest", "linear"):
        found = raster.sample(x, y, method=method)  # type: ignore[arg-type]
        assert np.array_equal(found, values, equal_nan=True)
    beside = raster.sample([0.5, 1.5, 2.0], [1.9, 1.9, 1.5], method="linear")
    assert beside[[0, 2]] == pytest.approx([0.6 * 4 + 0.4 * 1, 5.5])
    assert np.isnan(beside[1])


def test_nearest_sampling_takes_the_cell_that_holds_the_point() -> None:
    raster = Raster(np.array([[1, 2], [3, 4]], np.uint8), Affine(1, 0, 0, 0, -1, 2))
    found = raster.sample([0, 1, 2, 1.99, 2.01], [2, 1, 0, 0.99, 1])
    assert np.array_equal(found, [1, 2, 4, 4, np.nan], equal_nan=True)


# Files -------------------------------------------------------------------------------------


def noise(dtype: str, bands: int = 2) -> Raster:
    values = np.random.default_rng(0).integers(0, 100, (bands, 70, 300)).astype(dtype)
    if dtype.startswith("float"):
        values[0, :5] = np.nan
    lattice = Lattice.cover((1000.3, 2000.1, 1030.3, 2007.1), 0.1)
    names, units = ("Elevation", "Höhe"), ("metre", "1")
    return Raster.from_lattice(
        values, lattice, crs=parse_crs("EPSG:2154+5720"), descriptions=names, units=units
    )


@pytest.mark.parametrize("cog", [False, True])
@pytest.mark.parametrize(
    "dtype", ["uint8", "int8", "int16", "uint16", "int32", "uint32", "int64", "float32"]
)
def test_round_trip(tmp_path: Path, dtype: str, cog: bool) -> None:
    raster = noise(dtype)
    raster.save(tmp_path / "a.tif", cog=cog)
    found = Raster.open(tmp_path / "a.tif")
    assert found.values.dtype == dtype
    assert np.array_equal(found.values, raster.values, equal_nan=dtype == "float32")
    assert found.transform == raster.transform
    assert found.bounds == (1000.3, 2000.1, 1030.3, 2007.1)
    assert (found.descriptions, found.units) == (raster.descriptions, raster.units)
    assert found.nodata == (-9999.0 if dtype == "float32" else None)
    assert found.name == "a.tif"
    assert describe_crs(found.crs).startswith("EPSG:2154+5720")


def test_file_as_other_programs_want_it(tmp_path: Path) -> None:
    noise("float32").save(tmp_path / "a.tif")
    with rasterio.open(tmp_path / "a.tif") as file:
        assert file.block_shapes == [(256, 256)] * 2
        assert file.nodata == -9999
        assert file.tags()["AREA_OR_POINT"] == "Area"
        structure = file.tags(ns="IMAGE_STRUCTURE")
        assert (structure["COMPRESSION"], structure["PREDICTOR"]) == ("DEFLATE", "3")
        assert np.all(file.read(1)[:5] == -9999)
    noise("int16").save(tmp_path / "b.tif")
    with rasterio.open(tmp_path / "b.tif") as file:
        assert file.tags(ns="IMAGE_STRUCTURE")["PREDICTOR"] == "2"
    noise("int16").save(tmp_path / "c.tif", cog=True)
    with rasterio.open(tmp_path / "c.tif") as file:
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"


@pytest.mark.parametrize("cog", [False, True])
def test_same_bytes_on_every_run(tmp_path: Path, cog: bool) -> None:
    for name in ("a.tif", "b.tif"):
        noise("float32").save(tmp_path / name, cog=cog)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.tif", "b.tif"]


@pytest.mark.parametrize(
    "text",
    ["EPSG:2154", "EPSG:2227+6360", "EPSG:2227+5703", "EPSG:28992+5709", "EPSG:2193", "EPSG:6880"],
)
def test_crs_round_trip(tmp_path: Path, text: str) -> None:
    crs = parse_crs(text)
    Raster(np.zeros((2, 2)), NORTH_UP, crs=crs).save(tmp_path / "a.tif")
    assert same_crs(Raster.open(tmp_path / "a.tif").crs, crs)


@pytest.mark.parametrize("text", ["EPSG:7415", "EPSG:5699", "EPSG:25832+7837"])
def test_both_codes_of_a_compound_crs_are_in_the_file(tmp_path: Path, text: str) -> None:
    """Else it is a CRS of its own, to which no checkpoints are known to belong."""
    crs = parse_crs(text)
    Raster(np.zeros((2, 2)), NORTH_UP, crs=crs).save(tmp_path / "a.tif")
    assert crs_text(Raster.open(tmp_path / "a.tif").crs) == crs_text(crs)
    assert "+" in crs_text(crs)


def test_crs_of_a_survey_in_feet_round_trip(tmp_path: Path, data: Callable[[str], Path]) -> None:
    laspy = pytest.importorskip("laspy")
    with laspy.open(data("feet/autzen_trim.laz")) as file:
        crs = file.header.parse_crs()
    Raster(np.zeros((2, 2)), NORTH_UP, crs=crs).save(tmp_path / "a.tif")
    found = Raster.open(tmp_path / "a.tif")
    assert same_crs(found.crs, crs)
    assert found.metre == pytest.approx(1 / 0.3048)


def test_without_crs(tmp_path: Path) -> None:
    Raster(np.zeros((2, 2)), NORTH_UP).save(tmp_path / "a.tif")
    found = Raster.open(tmp_path / "a.tif")
    assert found.crs is None
    assert "assume_crs" in str(length_problem(found.crs))


@pytest.mark.parametrize("cog", [False, True])
@pytest.mark.parametrize("crs", LOCALS.values())
def test_a_local_crs_is_kept_where_other_programs_do_not_look(
    tmp_path: Path, crs: CRS, cog: bool
) -> None:
    Raster(np.zeros((2, 2)), NORTH_UP, crs=crs).save(tmp_path / "a.tif", cog=cog)
    with rasterio.open(tmp_path / "a.tif") as source:
        assert source.crs is None
    assert same_crs(Raster.open(tmp_path / "a.tif").crs, crs)


def test_a_crs_of_the_earth_counts_more_than_a_local_one(tmp_path: Path) -> None:
    """Another program has given one to our file, and has left our metadata in it."""
    Raster(np.zeros((2, 2)), NORTH_UP, crs=LOCALS["local:mm"]).save(tmp_path / "a.tif")
    with rasterio.open(tmp_path / "a.tif", "r+") as sink:
        sink.crs = rasterio.CRS.from_epsg(32635)
        assert sink.tags()["LOCAL_CRS"] == "local:mm"
    assert Raster.open(tmp_path / "a.tif").crs == CRS(32635)


def test_raster_at_the_origin_keeps_its_place(tmp_path: Path) -> None:
    """One unit per cell from (0, 0) is what GDAL takes for no position at all."""
    raster = Raster(np.arange(6.0).reshape(2, 3), Affine(1, 0, 0, 0, -1, 0), crs=CRS(2154))
    raster.save(tmp_path / "a.tif")
    assert Raster.open(tmp_path / "a.tif").bounds == (0, -2, 3, 0)


def test_file_has_the_type_of_the_values(tmp_path: Path) -> None:
    """A GPS time to the microsecond is a long number; float32 would round it to 16 s."""
    times = Raster(np.array([[300_000_000.000001, np.nan]]), NORTH_UP)
    times.save(tmp_path / "a.tif")
    assert np.array_equal(Raster.open(tmp_path / "a.tif").values, times.values, equal_nan=True)
    times.save(tmp_path / "a.tif", dtype="float32", overwrite=True)
    assert Raster.open(tmp_path / "a.tif").values[0, 0, 0] == np.float32(3e8)
    Raster(np.array([[1, 2]], np.uint8), NORTH_UP).save(
        tmp_path / "a.tif", dtype="int16", overwrite=True
    )
    assert Raster.open(tmp_path / "a.tif").values.dtype == np.int16


@pytest.mark.parametrize("nodata", [-1.797e308, 1e39, float(np.finfo(float).min)])
def test_nodata_that_does_not_fit_the_file(tmp_path: Path, nodata: float) -> None:
    """ArcGIS marks what is unknown with the lowest float64."""
    raster = Raster(np.array([[1 / 3, np.nan]]), NORTH_UP, nodata=nodata)
    raster.save(tmp_path / "a.tif")
    raster.save(tmp_path / "b.tif", dtype="float32")
    for name, stored in (("a.tif", nodata), ("b.tif", -9999)):
        with rasterio.open(tmp_path / name) as file:
            assert file.nodata == stored
            assert file.read(1)[0, 1] == stored
    found = Raster.open(tmp_path / "b.tif")
    assert np.array_equal(found.values, raster.values.astype(np.float32), equal_nan=True)


@pytest.mark.parametrize(
    ("values", "dtype", "problem"),
    [
        ([[1e300, 0.0]], "float32", "values exceed the range of float32; ask for float64"),
        ([[-9999.0, 0.0]], None, "valid cells hold the nodata value -9999"),
        ([[1.0, 0.0]], "int16", "float64 values do not fit int16"),
        ([[1.0, 0.0]], "float16", "float64 values do not fit float16"),
        ([[1, 2]], "uint8", "int64 values do not fit uint8"),
        ([[1, 2]], "float32", "int64 values do not fit float32"),
    ],
)
def test_values_that_a_file_cannot_hold(
    tmp_path: Path, values: list[list[float]], dtype: str | None, problem: str
) -> None:
    with pytest.raises(DataError, match=problem) as error:
        Raster(np.array(values), NORTH_UP).save(tmp_path / "a.tif", dtype=dtype)
    assert "a.tif" in str(error.value)
    assert not (tmp_path / "a.tif").exists()


def test_stale_parts_are_removed(tmp_path: Path) -> None:
    """A CRS in an .aux.xml would be taken for that of the new file, and so would a mask."""
    path, *side_cars = Raster.own_files(tmp_path / "a.tif")
    assert path == tmp_path / "a.tif"
    noise("uint8").save(path)
    with rasterio.open(path, "r+") as file:
        file.build_overviews([2])
    (tmp_path / "a.tif.aux.xml").write_text("<PAMDataset><SRS>EPSG:32631</SRS></PAMDataset>")
    with rasterio.open(path) as file:
        assert file.crs == "EPSG:32631"
        assert {Path(name) for name in file.files} <= {path, *side_cars}
    path.unlink()  # or GDAL would remove the others with it
    Raster(np.zeros((2, 2)), NORTH_UP).save(path, overwrite=True)
    assert Raster.open(path).crs is None
    assert list(tmp_path.iterdir()) == [path]


def test_suffix_and_folder_are_checked(tmp_path: Path) -> None:
    raster = noise("uint8")
    with pytest.raises(DataError, match=r"rasters are written as \.tif or \.tiff"):
        raster.save(tmp_path / "a.png")
    with pytest.raises(DataError, match=r"no.a\.tif cannot be written"):
        raster.save(tmp_path / "no" / "a.tif")


def foreign(path: Path, values: Any, **more: Any) -> Path:
    """A GeoTIFF as another program would make it."""
    values = np.asarray(values)
    profile = {"driver": "GTiff", "transform": NORTH_UP, "crs": "EPSG:2154", **more}
    bands, rows, cols = values.shape
    with rasterio.open(
        path, "w", count=bands, height=rows, width=cols, dtype=values.dtype.name, **profile
    ) as file:
        file.write(values)
    return path


def test_integers_with_nodata_stay_integers(tmp_path: Path) -> None:
    path = foreign(tmp_path / "a.tif", np.array([[[0, 1, 255]]], np.uint8), nodata=255)
    raster = Raster.open(path)
    assert (raster.values.dtype, raster.nodata) == (np.uint8, 255)
    assert np.array_equal(raster.band(), [[0, 1, np.nan]], equal_nan=True)
    raster.save(tmp_path / "b.tif")
    assert Raster.open(tmp_path / "b.tif").nodata == 255


def test_integers_with_a_mask_become_floats(tmp_path: Path) -> None:
    path = foreign(tmp_path / "a.tif", np.array([[[0, 1, 255]]], np.uint8))
    with rasterio.open(path, "r+") as file:
        file.write_mask(np.array([[255, 0, 255]], np.uint8))
    raster = Raster.open(path)
    assert raster.values.dtype == np.float32
    assert np.array_equal(raster.band(), [[0, np.nan, 255]], equal_nan=True)


def test_alpha_band_is_a_mask(tmp_path: Path) -> None:
    values = np.array([[[7, 8]], [[7, 8]], [[7, 8]], [[0, 255]]], np.uint8)
    path = foreign(tmp_path / "a.tif", values, photometric="RGB", alpha="YES")
    assert np.array_equal(Raster.open(path).band(), [[np.nan, 8]], equal_nan=True)


def test_float_nodata_of_any_kind_is_nan(tmp_path: Path) -> None:
    lowest = float(np.finfo(np.float32).min)
    for nodata in (lowest, float("nan"), 0.0):
        path = foreign(tmp_path / "a.tif", np.array([[[nodata, 5]]], np.float32), nodata=nodata)
        raster = Raster.open(path)
        assert np.array_equal(raster.values, [[[np.nan, 5]]], equal_nan=True)
        raster.save(tmp_path / "b.tif", overwrite=True)
        assert np.array_equal(Raster.open(tmp_path / "b.tif").values, raster.values, equal_nan=True)


def test_scale_and_offset_are_applied(tmp_path: Path) -> None:
    path = foreign(tmp_path / "a.tif", np.array([[[0, 100, 200]]], np.int16), nodata=0)
    with rasterio.open(path, "r+") as file:
        file.scales, file.offsets = (0.01,), (5.0,)
    raster = Raster.open(path)
    assert raster.values[0, 0, 1:] == pytest.approx([6, 7])
    assert np.isnan(raster.values[0, 0, 0])


@pytest.mark.parametrize(
    ("transform", "problem"),
    [
        (Affine(1, 0, 5, 0, 1, 5), "is not north up"),
        (Affine(1, 0.1, 5, 0.1, -1, 5), "is not north up"),
        (Affine(1, 0, 5, 0, -2, 5), "has cells of 1 x 2; resample it to square cells first"),
        (None, "is not georeferenced"),
    ],
)
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")  # is meant to be
def test_lattices_that_are_not_ours(tmp_path: Path, transform: Affine | None, problem: str) -> None:
    path = foreign(tmp_path / "a.tif", np.ones((1, 2, 2), np.uint8), transform=transform)
    with pytest.raises(DataError, match=rf"a\.tif {problem}"):
        Raster.open(path)


@pytest.mark.parametrize(
    ("size", "bands", "tile", "problem"),
    [
        (10**6, 1, 8192, r"a\.tif, 1,000,000 rows x 1,000,000 columns, needs 2e\+03 GB"),
        (16, 60_000, 4096, r"a\.tif keeps its 60,000 bands together in blocks of 4,096 x 4,096"),
    ],
)
def test_rasters_that_no_memory_holds(
    tmp_path: Path, size: int, bands: int, tile: int, problem: str
) -> None:
    """A file of some kilobytes may claim them: what nobody wrote is not stored."""
    options = {"sparse_ok": True, "bigtiff": "yes", "tiled": True, "interleave": "pixel"}
    with rasterio.open(
        path := tmp_path / "a.tif",
        "w",
        driver="GTiff",
        width=size,
        height=size,
        count=bands,
        dtype="uint8",
        transform=Affine(1, 0, 5, 0, -1, 5),
        blockxsize=tile,
        blockysize=tile,
        **options,
    ):
        pass
    with pytest.raises(DataError, match=problem):
        Raster.open(path)


def test_missing_broken_and_complex_files(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"none\.tif: no such file"):
        Raster.open(tmp_path / "none.tif")
    (tmp_path / "text.tif").write_text("no raster")
    with pytest.raises(DataError, match=r"text\.tif cannot be read as a raster"):
        Raster.open(tmp_path / "text.tif")
    noise("float32").save(tmp_path / "a.tif")
    (tmp_path / "cut.tif").write_bytes((tmp_path / "a.tif").read_bytes()[:3000])
    with pytest.raises(DataError, match=r"cut\.tif cannot be read as a raster"):
        Raster.open(tmp_path / "cut.tif")
    foreign(tmp_path / "complex.tif", np.ones((1, 2, 2), np.complex64))
    with pytest.raises(DataError, match=r"complex\.tif holds complex64 values"):
        Raster.open(tmp_path / "complex.tif")


def test_reference_surfaces(data: Callable[[str], Path]) -> None:
    """A terrain model that another program made, with its nodata and CRS."""
    path = data("ign_gridding_reference/DTM_77055_627755.tif")
    raster = Raster.open(path)
    assert (raster.shape, raster.cell, raster.nodata) == ((100, 100), 0.5, -9999)
    assert describe_crs(raster.crs) == "EPSG:2154 RGF93 v1 / Lambert-93"
    assert raster.bounds == (770550, 6277500, 770600, 6277550)
    assert Lattice.of(raster) == Lattice.cover(raster.bounds, 0.5)
    with rasterio.open(path) as file:
        assert np.isnan(raster.band()).sum() == (file.read(1) == -9999).sum()
        x, y = file.xy([3, 40], [7, 99])
        assert raster.sample(x, y) == pytest.approx(
            [v[0] for v in file.sample(zip(x, y, strict=True))]
        )


def test_bands_of_an_image(data: Callable[[str], Path]) -> None:
    raster = Raster.open(data("multispectral_rasters/s2a_l2a_fishbourne.tif"))
    assert raster.values.shape == (4, 201, 301)
    assert describe_crs(raster.crs).startswith("EPSG:32630")
    red, near_infrared = raster.band(3), raster.band(4)
    total = red + near_infrared  # 0 on the sea, which the figure below counts as 0
    ndvi = np.divide(near_infrared - red, total, out=np.zeros(red.shape), where=total != 0)
    assert np.median(ndvi) == pytest.approx(0.40, abs=0.005)


def test_one_band_of_several(tmp_path: Path) -> None:
    both = Raster(
        np.arange(8.0).reshape(2, 2, 2),
        Affine(1, 0, 0, 0, -1, 2),
        descriptions=("z", "points"),
        units=("m", ""),
    )
    both.save(tmp_path / "a.tif")
    second = Raster.open(tmp_path / "a.tif", band=2)
    assert (second.values == both.values[1:]).all()
    assert (second.descriptions, second.units) == (("points",), ("",))
    for band in (0, 3):
        with pytest.raises(DataError, match=f"a.tif has bands 1 to 2, not {band}"):
            Raster.open(tmp_path / "a.tif", band=band)


def test_band_on_the_way_into_a_tool(tmp_path: Path) -> None:
    slope = np.add.outer(np.arange(9.0), np.arange(9.0))
    raster = Raster(np.stack([slope * 0, slope]), Affine(1, 0, 0, 0, -1, 9), crs=CRS(32635))
    raster.save(tmp_path / "a.tif")
    with pytest.raises(DataError, match="choose one with the option band"):
        toolbox.run("surface.hillshade", {"surface": tmp_path / "a.tif"})
    shade = toolbox.run("surface.hillshade", {"surface": {"path": tmp_path / "a.tif", "band": "2"}})
    assert np.nanmean(shade["hillshade"].values) < 230


def test_as_xarray() -> None:
    values = np.array([[1, 2], [3, 255]], np.uint8)
    lattice = Lattice(500_000, 4_600_000, 2.0, 2, 2)
    raster = Raster.from_lattice(
        values, lattice, crs=CRS(32635), nodata=255, descriptions=["class"], units=[""]
    )
    array = raster.to_xarray()
    assert array.dtype == np.uint8
    assert array.sel(band=1, x=500_003, y=4_599_999).item() == 2
    assert array.attrs == {"long_name": ("class",), "_FillValue": 255}
    reference = array.spatial_ref.attrs
    assert CRS(reference["crs_wkt"]) == CRS(32635)
    assert reference["GeoTransform"] == "500000.0 2.0 0.0 4600000.0 0.0 -2.0"
