"""Cells are counted before the work: a slip of the decimal point is told or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pyproj import CRS
from scenes.layers import cloud, raster

import toolbox
from algorithms.surface.grid import SurfaceGrid
from toolbox import execute
from toolbox.data import PointCloud
from toolbox.errors import DataError, MemoryShort
from toolbox.tiles.tiling import Tiling

FEET = CRS("EPSG:2994")


def square(crs: CRS | str = "EPSG:32635") -> PointCloud:
    """100 points, 1 unit apart."""
    return cloud([[x, y, 0] for x in range(10) for y in range(10)]).with_crs(crs)


def test_more_cells_than_memory_holds_are_refused_before_the_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(SurfaceGrid, "run", None)
    many = "cell: 81,000,000,000,000 cells of 1e-06 m, where points are about 0.9 m apart, needs"
    with pytest.raises(MemoryShort, match=rf"{many} 2\.\d+e\+06 GB .* or work in tiles"):
        toolbox.run("surface.grid", {"points": square(), "cell": 1e-6})


@pytest.mark.parametrize(
    ("crs", "cell", "told"),
    [
        ("EPSG:32635", 0.1, True),
        ("EPSG:32635", 0.2, False),
        (FEET, 0.05, True),
        (FEET, 0.06, False),  # a fifth of 0.9 feet
    ],
)
def test_cells_far_smaller_than_the_points_are_apart_are_told(
    crs: CRS | str, cell: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    toolbox.run("surface.grid", {"points": square(crs), "cell": cell})
    assert ("are far smaller than the data can fill" in caplog.text) == told


def test_cells_of_a_template_or_an_extent_are_those(caplog: pytest.LogCaptureFixture) -> None:
    points = square()
    west, south = points.bounds[:2]
    template = raster([[1.0]], west=west, north=south + 1)
    toolbox.run("surface.grid", {"points": points, "cell": 1e-9, "template": template})
    extent = (west, south, west + 0.001, south + 0.001)
    toolbox.run("surface.grid", {"points": points, "cell": 1e-3, "extent": extent})
    assert "1 cells of 0.001 m" in caplog.text
    toolbox.run("points.thin", {"points": points, "cell": 1e-3})  # whose cells are no raster
    assert caplog.text.count("far smaller") == 1


def test_lengths_are_told_in_the_unit_of_the_data(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    heights = raster([[1.0, 2.0], [3.0, 9.0]], crs=FEET)
    with caplog.at_level("INFO", "toolbox"):
        made = toolbox.run("surface.contours", {"surface": heights, "interval": "2ft"})
        assert "interval 0.6096 m = 2 ft" in caplog.text
        toolbox.run("surface.contours", {"surface": heights, "interval": 2})
        assert "lengths are in metres, the data in ft: interval 2 m = 6.56168 ft" in caplog.text
        caplog.clear()
        toolbox.run("surface.contours", {"surface": raster([[1.0, 2.0]]), "interval": 2})
        assert "lengths are" not in caplog.text
    assert set(made.contours.frame["elevation"]) <= {2.0, 4.0, 6.0, 8.0}
    assert len(made.contours)


def test_cells_of_tiles_are_told_and_those_of_one_tile_must_fit(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    square().save(tmp_path / "a.laz")
    run = {"points": [tmp_path / "a.laz"], "method": "max"}
    how: dict[str, Any] = {"tiling": Tiling(10.0, workers=1), "overwrite": True}
    out = {"surface": tmp_path / "a.tif"}
    execute.run("surface.grid", run | {"cell": 0.1} | out, **how)
    assert "are far smaller than the data can fill" in caplog.text
    with pytest.raises(MemoryShort, match=r"choose larger cells, or smaller tiles \(tile\)"):
        execute.run("surface.grid", run | {"cell": 1e-6} | out, **how)


def test_points_in_degrees_are_told_with_their_name_and_what_to_do() -> None:
    """It was "EPSG:4326 WGS 84 is in degrees, which are not a length", and of nothing."""
    points = square("EPSG:4326")
    with pytest.raises(
        DataError, match=r"points: .* is in degrees .*; reproject it to a projected"
    ):
        toolbox.run("surface.grid", {"points": points, "cell": 1.0})
