"""Metadata after ISO 19115, read by a client that nobody here wrote."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pyproj
import pytest
import shapely
from affine import Affine

pytest.importorskip("pygeometa")
from lxml import etree
from owslib.iso import MD_Metadata

import toolbox
from toolbox.cli.main import main
from toolbox.data import PointCloud, Raster, Vector
from toolbox.data.crs import parse_crs

CRS = parse_crs("EPSG:2154+5720")
DEGREES = r"<gmd:\w+Bound\w+>\s*<gco:Decimal>(\S+)</gco:Decimal>"
WHO = ["--organisation", "Ağ & Co <x>", "--email", "a@b.org"]


def terrain(path: Path, crs: Any = CRS) -> Path:
    transform = Affine(2, 0, 650_000, 0, -2, 6_860_000)
    Raster(np.ones((1, 50, 100), np.float32), transform, crs=crs).save(path)
    return path


def read(path: Path) -> MD_Metadata:
    return MD_Metadata(etree.parse(path).getroot())


def test_of_a_raster(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = terrain(tmp_path / "dtm.tif")
    before = path.read_bytes()
    assert main(["metadata", str(path), *WHO, "--title", "A & B", "--date", "2026-01-31"]) == 0
    assert capsys.readouterr().out == f"metadata: {tmp_path / 'dtm.tif.xml'}\n"
    target = tmp_path / "dtm.tif.xml"
    found = read(target)
    about = found.identification[0]
    assert (about.title, found.datestamp) == ("A & B", "2026-01-31")
    assert "EPSG:2154+5720" in about.abstract
    assert "2 m wide" in about.abstract
    assert found.referencesystem.code == "urn:ogc:def:crs:EPSG:2154"
    corners = [float(value) for value in re.findall(DEGREES, target.read_text(encoding="utf-8"))]
    box = pyproj.Transformer.from_crs(2154, 4326, always_xy=True).transform_bounds(
        650_000, 6_859_900, 650_200, 6_860_000
    )
    west, east, south, north = corners
    assert (west, south, east, north) == pytest.approx(box, abs=1e-7)
    assert about.contact[0].organization == "Ağ & Co <x>"
    assert path.read_bytes() == before


def test_says_how_the_file_was_made(tmp_path: Path) -> None:
    xyz = np.random.default_rng(1).uniform(0, 50, (500, 3)) + np.array([650_000, 6_860_000, 0])
    PointCloud(xyz, crs=CRS).save(tmp_path / "a.laz")
    grid = {"points": tmp_path / "a.laz", "surface": tmp_path / "dtm.tif", "cell": 5.0}
    toolbox.run("surface.grid", grid)
    assert main(["metadata", str(tmp_path / "dtm.tif"), *WHO]) == 0
    text = read(tmp_path / "dtm.tif.xml").dataquality.lineage
    assert "a.laz" in text
    assert "surface.grid" in text
    assert read(tmp_path / "dtm.tif.xml").identification[0].title.startswith("dtm.tif: Grid points")


@pytest.mark.parametrize("name", ["a.laz", "a.gpkg"])
def test_of_points_and_lines(name: str, tmp_path: Path) -> None:
    line = shapely.LineString([(650_000, 6_860_000), (651_000, 6_861_000)])
    if name == "a.laz":
        PointCloud([[*xy, 1.0] for xy in line.coords], crs=CRS).save(tmp_path / name)
    else:
        Vector(geopandas.GeoDataFrame(geometry=[line], crs=CRS)).save(tmp_path / name)
    assert main(["metadata", str(tmp_path / name), *WHO]) == 0
    text = (tmp_path / f"{name}.xml").read_text(encoding="utf-8")
    kind = "point" if name == "a.laz" else "curve"
    assert f'codeListValue="{kind}"' in text
    assert "651000" in text


def test_the_same_file_has_the_same_identifier(tmp_path: Path) -> None:
    names = [terrain(tmp_path / name) for name in ("a.tif", "b.tif")]
    found = []
    for path in names:
        assert main(["metadata", str(path), *WHO]) == 0
        found.append(read(path.with_name(path.name + ".xml")).identifier)
    assert found[0] == found[1] != ""


def test_nothing_is_replaced_unless_it_may_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = terrain(tmp_path / "dtm.tif")
    target = tmp_path / "dtm.tif.xml"
    target.write_text("mine")
    assert main(["metadata", str(path), *WHO]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert target.read_text() == "mine"
    assert main(["metadata", str(path), *WHO, "--overwrite"]) == 0
    assert "MD_Metadata" in target.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("crs", "text"),
    [
        (parse_crs("local"), "has no CRS of the Earth"),
        (pyproj.CRS("+proj=tmerc +lon_0=31 +ellps=GRS80 +units=m"), "has no EPSG code"),
    ],
)
def test_without_a_place_or_a_code(
    crs: pyproj.CRS, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = terrain(tmp_path / "dtm.tif", crs)
    assert main(["metadata", str(path), *WHO]) == 3
    assert text in capsys.readouterr().err
    assert not (tmp_path / "dtm.tif.xml").exists()


def test_layers_in_two_crs_are_not_taken_as_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "two.gpkg"
    for layer, crs, point in (("a", 32635, (500_000, 4_400_000)), ("b", 4326, (27.5, 39.9))):
        frame = geopandas.GeoDataFrame(geometry=[shapely.Point(point)], crs=crs)
        frame.to_file(path, layer=layer, driver="GPKG")
    assert main(["metadata", str(path), *WHO]) == 3
    said = capsys.readouterr().err
    assert "two.gpkg: its layers must have one CRS" in said
    assert "EPSG:32635" in said
    assert "EPSG:4326" in said
    assert not (tmp_path / "two.gpkg.xml").exists()


def test_of_nothing_and_of_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "none.gpkg"
    frame = geopandas.GeoDataFrame({"n": []}, geometry=geopandas.GeoSeries([], crs=32635))
    frame.to_file(path, driver="GPKG")
    assert main(["metadata", str(path), *WHO]) == 3
    assert "none.gpkg: holds nothing" in capsys.readouterr().err
    assert main(["metadata", str(tmp_path), *WHO]) == 2
    assert f"file: must be a file, and {tmp_path} is a folder" in capsys.readouterr().err


def test_without_its_library(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("toolbox.data.extras.find_spec", lambda name: None)
    assert main(["metadata", str(terrain(tmp_path / "dtm.tif")), *WHO]) == 3
    assert "pip install pygeometa" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--date", "99/99"], "such as 2026-11-23"),
        ([], "--organisation"),
        (["--email", " "], "--email: must not be blank, got ' '"),
        (["--title", "a\x01b"], r"--title: must be of printable characters, got 'a\x01b'"),
    ],
)
def test_arguments_of_no_use(
    more: list[str], text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = terrain(tmp_path / "dtm.tif")
    with pytest.raises(SystemExit) as ended:
        main(["metadata", str(path), *(WHO if more else WHO[2:]), *more])
    assert ended.value.code == 2
    assert text in capsys.readouterr().err
