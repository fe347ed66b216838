"""Rasters brought to another CRS as they are read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from scenes.layers import raster

import toolbox
from algorithms.surface.reproject import SurfaceReproject
from toolbox.cli.main import main
from toolbox.data import Raster
from toolbox.errors import DataError

NEXT = CRS(32636)


def sloping(kind: type = np.float32) -> Raster:
    rows, cols = np.mgrid[0:30, 0:40]
    return raster((100 + 3 * rows + cols).astype(kind))


@pytest.mark.parametrize(("kind", "method"), [(np.uint8, "nearest"), (np.float32, "linear")])
def test_it_is_what_the_tool_makes(tmp_path: Path, kind: type, method: str) -> None:
    sloping(kind).save(tmp_path / "a.tif")
    read = Raster.open(tmp_path / "a.tif", reproject="EPSG:32636")
    there = (
        SurfaceReproject(surface=sloping(kind), crs=NEXT, method=method, values="other")
        .run()
        .reprojected
    )
    np.testing.assert_array_equal(read.band(), there.band())
    assert read.transform == there.transform
    assert read.crs == NEXT
    assert read.values.dtype == kind
    kept = np.unique(read.band()[~np.isnan(read.band())])
    assert (kind is np.float32) == bool(set(kept) - set(np.unique(sloping().band())))


def test_heights_that_would_change_are_refused(tmp_path: Path) -> None:
    heights, feet = sloping(), CRS("EPSG:2991+6360")
    Raster(heights.values, heights.transform, crs=feet).save(tmp_path / "a.tif")
    with pytest.raises(DataError, match=r"a\.tif: its heights change .* surface\.reproject does"):
        Raster.open(tmp_path / "a.tif", reproject="EPSG:2991+5703")
    classes = Raster(heights.values.astype(np.uint8), heights.transform, crs=feet)
    classes.save(tmp_path / "b.tif")
    assert Raster.open(tmp_path / "b.tif", reproject="EPSG:2991+5703").band().size == 30 * 40


def test_a_map_in_another_crs_can_be_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ours = sloping(np.uint8)
    ours = Raster(ours.values // 50, ours.transform, crs=ours.crs)
    ours.save(tmp_path / "ours.tif")
    how = {"surface": ours, "crs": NEXT, "method": "nearest"}
    toolbox.run("surface.reproject", {**how, "reprojected": tmp_path / "theirs.tif"})
    given = ["run", "compare.rasters", "--classes", str(tmp_path / "ours.tif")]
    given += ["--reference", str(tmp_path / "theirs.tif")]
    assert main(given) == 3
    assert "or read it with --reference.reproject EPSG:32635" in capsys.readouterr().err
    assert main([*given, "--reference.reproject", "EPSG:32635"]) == 0
