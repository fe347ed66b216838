"""No file is read as another format than its name says, and none sends us elsewhere."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import geopandas
import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from affine import Affine

from toolbox.data import Raster, Vector
from toolbox.data.drivers import check_vector
from toolbox.data.record import read_record
from toolbox.errors import DataError

VRT = """<VRTDataset rasterXSize="2" rasterYSize="2"><GeoTransform>0,1,0,2,0,-1</GeoTransform>
<VRTRasterBand dataType="Byte" band="1"><SimpleSource>
<SourceFilename relativeToVRT="0">{place}</SourceFilename><SourceBand>1</SourceBand>
</SimpleSource></VRTRasterBand></VRTDataset>"""
WMS = """<GDAL_WMS><Service name="TMS"><ServerUrl>{place}/${{z}}/${{x}}/${{y}}</ServerUrl></Service>
<DataWindow><UpperLeftX>0</UpperLeftX><UpperLeftY>2</UpperLeftY><LowerRightX>2</LowerRightX>
<LowerRightY>0</LowerRightY><SizeX>2</SizeX><SizeY>2</SizeY></DataWindow></GDAL_WMS>"""
OGR = """<OGRVRTDataSource><OGRVRTLayer name="a"><SrcDataSource>{place}</SrcDataSource>
<SrcLayer>b</SrcLayer></OGRVRTLayer></OGRVRTDataSource>"""
GDALG = '{{"type": "gdal_streamed_alg", "command_line": "gdal vector pipeline ! read {place}"}}'


@pytest.fixture
def listener() -> Iterator[tuple[str, list[str]]]:
    """The address of a server on this computer, and who has called it."""
    calls: list[str] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def wait() -> None:
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                with connection:
                    calls.append(connection.recv(200).decode())

        thread = threading.Thread(target=wait, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}", calls
        server.shutdown(socket.SHUT_RDWR)
    thread.join(5)


def raster(path: Path) -> Path:
    Raster(np.ones((2, 2), np.uint8), Affine(1, 0, 0, 0, -1, 2)).save(path)
    return path


@pytest.mark.parametrize("suffix", [".tif", ".asc", ".png", ".vrt", ".xml", ""])
@pytest.mark.parametrize("content", [VRT, WMS])
def test_a_raster_that_is_elsewhere_is_not_looked_for(
    content: str, suffix: str, tmp_path: Path, listener: tuple[str, list[str]]
) -> None:
    address, calls = listener
    path, place = (
        tmp_path / f"a{suffix}",
        address if content is WMS else f"/vsicurl/{address}/b.tif",
    )
    path.write_text(content.format(place=place))
    with pytest.raises(DataError):
        Raster.open(path)
    if suffix == ".tif":
        with pytest.raises(DataError):
            read_record(path)
    assert calls == []


def test_a_virtual_raster_does_not_read_other_files(tmp_path: Path) -> None:
    (tmp_path / "a.tif").write_text(VRT.format(place=raster(tmp_path / "b.tif")))
    with pytest.raises(DataError, match=r"a\.tif cannot be read as a raster"):
        Raster.open(tmp_path / "a.tif")


@pytest.mark.parametrize("ending", [".msk", ".ovr"])
def test_nor_does_a_mask_beside_a_raster(
    ending: str, tmp_path: Path, listener: tuple[str, list[str]]
) -> None:
    address, calls = listener
    path = raster(tmp_path / "a.tif")
    Path(f"{path}{ending}").write_text(VRT.format(place=f"/vsicurl/{address}/b.tif"))
    with pytest.raises(DataError, match=f"beside it that are no TIFF: .*{ending}"):
        Raster.open(path)
    assert calls == []


@pytest.mark.parametrize(
    "suffix", [".gpkg", ".geojson", ".json", ".kml", ".gml", ".shp", ".vrt", ""]
)
@pytest.mark.parametrize(
    "content", [OGR, "<kml/>" + OGR, "\ufeff<!-- x -->" + OGR, GDALG, '{{"a": 1}}' + OGR]
)
def test_features_that_are_elsewhere_are_not_looked_for(
    content: str, suffix: str, tmp_path: Path, listener: tuple[str, list[str]]
) -> None:
    address, calls = listener
    path = tmp_path / f"a{suffix}"
    path.write_text(content.format(place=f"/vsicurl/{address}/b.geojson"), encoding="utf-8")
    for read in (Vector.open, Vector.layers):
        with pytest.raises(DataError, match=r"does not begin as|vector layers are read from"):
            read(path)
    assert calls == []


def test_the_tests_would_hear_a_call(tmp_path: Path, listener: tuple[str, list[str]]) -> None:
    address, calls = listener
    path = tmp_path / "a.tif"
    path.write_text(VRT.format(place=f"/vsicurl/{address}/b.tif"))
    with pytest.raises(rasterio.errors.RasterioError), rasterio.open(path) as source:
        source.read()
    assert calls


@pytest.mark.parametrize("driver", ["GML", "GPX", "MapInfo File", "SQLite"])
def test_formats_that_other_programs_write_are_read(driver: str, tmp_path: Path) -> None:
    suffixes = {"GML": "gml", "GPX": "gpx", "MapInfo File": "tab", "SQLite": "sqlite"}
    path = tmp_path / f"waypoints.{suffixes[driver]}"
    frame = geopandas.GeoDataFrame({"name": ["a"]}, geometry=[shapely.Point(1, 2)], crs=4326)
    pyogrio.write_dataframe(frame, path, driver=driver)
    name = Vector.layers(path)[0]
    assert Vector.open(path, layer=name).frame.geometry[0].x == 1


def test_drawings_are_read(tmp_path: Path) -> None:
    Vector(geopandas.GeoDataFrame(geometry=[shapely.Point(1, 2)])).save(tmp_path / "a.dxf")
    assert Vector.open(tmp_path / "a.dxf").frame.geometry[0].x == 1


def test_a_missing_file_and_an_address() -> None:
    with pytest.raises(DataError, match="no such file"):
        Raster.open("none.tif")
    with pytest.raises(DataError, match=r"/vsicurl/http:/127\.0\.0\.1/a\.tif: no such file"):
        Raster.open("/vsicurl/http://127.0.0.1/a.tif")
    with pytest.raises(DataError, match=r"rasters are read from \.tif.*convert it with gdal_trans"):
        Raster.open("a.vrt")
    with pytest.raises(DataError, match=r"a\.laz holds points; surface\.grid makes a raster"):
        Raster.open("a.laz")
    with pytest.raises(
        DataError, match=r"not \.txt; save it as \.csv whose first line has the names"
    ):
        check_vector(Path("a.txt"))
