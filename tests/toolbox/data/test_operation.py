"""Coordinate operations: known coordinates, grids that are missing, heights that would be lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from pyproj import CRS, Transformer

from toolbox.data.crs import crs_text, parse_crs, same_crs
from toolbox.data.operation import Operation, operation
from toolbox.errors import DataError

HERE = {  # a position in each CRS
    "EPSG:32635": (500_000.0, 4_600_000.0, 12.0),
    "EPSG:2263": (1_000_000.0, 200_000.0, 100.0),
    "EPSG:2154": (700_000.0, 6_600_000.0, 100.0),
    "EPSG:9000": (10.0, 50.0, 3.0),
    "EPSG:28992": (121_000.0, 487_000.0, 3.0),
}


def way(source: str, target: str, **how: Any) -> tuple[Operation, np.ndarray[Any, Any]]:
    """The operation, and the position of the source."""
    here = np.array([HERE[source.partition("+")[0]]])
    near = 0.1 if abs(here[0, 0]) < 400 else 50.0
    box = (here[0, 0] - near, here[0, 1] - near, here[0, 0] + near, here[0, 1] + near)
    return operation(parse_crs(source), parse_crs(target), box, **how), here


@pytest.mark.parametrize(
    ("source", "target", "how"),
    [
        ("EPSG:32635", "EPSG:32636", {}),
        ("EPSG:32635", "EPSG:4326", {}),
        ("EPSG:2263", "EPSG:26918", {}),
        ("EPSG:2263+6360", "EPSG:26918+5703", {}),
        ("EPSG:2154+5720", "EPSG:32631", {}),
        ("EPSG:32635+ellipsoid", "EPSG:25835+ellipsoid", {}),
        ("EPSG:28992", "EPSG:25831", {"missing_grid": "next_best"}),
        ("EPSG:9000", "EPSG:4258", {"epoch": 2020.5}),
    ],
)
def test_back_within_a_millimetre(source: str, target: str, how: dict[str, Any]) -> None:
    there, here = way(source, target, **how)
    moved = there.transform(here)
    assert not np.allclose(moved[0, :2], here[0, :2], rtol=0, atol=1e-9)
    # heights take no part in a change of datum in plan, so that the way back is not exact there
    near = 5e-4 if "EPSG:28992" in source else 1e-6
    np.testing.assert_allclose(there.transform(moved, back=True), here, rtol=0, atol=near)


def test_known_coordinates() -> None:
    """The central meridian of zone 35 in degrees, and in zone 36 as pyproj alone has it."""
    there, here = way("EPSG:32635", "EPSG:4326")
    assert there.transform(here)[0].tolist() == [27.0, pytest.approx(41.551664522), 12.0]
    there, here = way("EPSG:32635", "EPSG:32636")
    alone = Transformer.from_crs(32635, 32636, always_xy=True).transform(*here[0, :2])
    np.testing.assert_allclose(there.transform(here)[0, :2], alone, rtol=0, atol=1e-9)
    assert (there.accuracy, there.moves_heights) == (0.0, False)


def test_heights_of_no_system_are_in_the_unit_of_the_plan() -> None:
    there, here = way("EPSG:2263", "EPSG:26918")
    assert there.transform(here)[0, 2] == pytest.approx(100 * 1200 / 3937, abs=1e-9)
    assert there.moves_heights
    there, here = way("EPSG:2263+6360", "EPSG:26918+5703")
    assert there.transform(here)[0, 2] == pytest.approx(100 * 1200 / 3937, abs=1e-9)


def test_heights_keep_their_system_where_the_target_has_none() -> None:
    there, here = way("EPSG:2154+5720", "EPSG:32631")
    assert crs_text(there.target) == "EPSG:32631+5720"
    assert there.transform(here)[0, 2] == 100.0
    there, _ = way("EPSG:32635+ellipsoid", "EPSG:32636")
    assert crs_text(there.target) == "EPSG:32636+ellipsoid"


@pytest.mark.parametrize(
    ("source", "target", "how", "text"),
    [
        ("EPSG:28992", "EPSG:25831", {}, r"nl_nsgi_rdtrans2018\.tif.*pyproj sync.*next_best"),
        ("EPSG:2154+5720", "EPSG:32631+3855", {}, r"fr_ign_RAF18\.tif, us_nga_egm08_25\.tif"),
        (
            "EPSG:2154+5720",
            "EPSG:32631+3855",
            {"missing_grid": "next_best"},
            r"fr_ign_RAF18\.tif.*geoid model of your own",
        ),
        ("EPSG:2154", "EPSG:32631+3855", {}, r"does not say what heights are.*assign_crs"),
        ("EPSG:2263+6360", "EPSG:26918", {}, r"horizontal metre and vertical US survey foot"),
        ("EPSG:9000", "EPSG:4258", {}, r"depends on time .*epoch, such as"),
        ("EPSG:32635", "local", {}, r"no way between local.*no relation to the Earth"),
        ("EPSG:32635+ellipsoid", "EPSG:32636", {"geoid": "a.tif"}, "geoid: .*does not say what"),
        ("EPSG:2154+5720", "EPSG:32631+3855", {"geoid": "a.tif"}, "geoid: leads between"),
        ("EPSG:32635+ellipsoid", "EPSG:32635+5773", {"geoid": "a.tif"}, r"there is no file a\.tif"),
    ],
)
def test_what_is_refused(source: str, target: str, how: dict[str, Any], text: str) -> None:
    with pytest.raises(DataError, match=text):
        way(source, target, **how)


def test_without_heights_their_systems_do_not_matter() -> None:
    there, here = way("EPSG:2154", "EPSG:32631+3855", heights=False)
    assert there.transform(here[:, :2]).shape == (1, 2)


def test_epoch_moves_coordinates() -> None:
    early, here = way("EPSG:9000", "EPSG:4258", epoch=2000.0)
    late, _ = way("EPSG:9000", "EPSG:4258", epoch=2020.0)
    metres = (late.transform(here) - early.transform(here))[0, :2] * (71_000, 111_000)
    assert 0.4 < np.hypot(*metres) < 0.6  # Europe moves by 2.5 cm a year


def test_local_feet() -> None:
    way = operation(parse_crs("local:ft"), parse_crs("local"), (0, 0, 1, 1))
    assert way.transform(np.array([[10.0, 20.0, 30.0]])).tolist() == [[3.048, 6.096, 9.144]]


@pytest.fixture
def geoid(tmp_path: Path) -> Path:
    """Cells that are not square, around 27 E and 41.5 N; 30 + longitude + 2 latitudes."""
    east, north = np.meshgrid(np.arange(26, 28.01, 0.1), np.arange(42.5, 40.9, -0.05))
    path = tmp_path / "my geoid.tif"
    profile = {"driver": "GTiff", "height": len(east), "width": east.shape[1], "count": 1}
    place = Affine(0.1, 0, 26 - 0.05, 0, -0.05, 42.5 + 0.025)
    with rasterio.open(
        path, "w", **profile, dtype="float32", crs="EPSG:4326", transform=place
    ) as sink:
        sink.write((30 + east + 2 * north).astype(np.float32), 1)
    return path


UNDULATION = 30 + 27 + 2 * 41.55166452


@pytest.mark.parametrize(
    ("source", "target", "height"),
    [
        ("EPSG:32635+5773", "EPSG:32635+ellipsoid", 12 + UNDULATION),
        ("EPSG:32635+ellipsoid", "EPSG:32635+5773", 12 - UNDULATION),
        ("EPSG:32635+ellipsoid", "EPSG:25835+5773", 12 - UNDULATION),
        ("EPSG:32635+8228", "EPSG:32635+ellipsoid", 12 * 0.3048 + UNDULATION),  # feet
        ("EPSG:32635+ellipsoid", "EPSG:32635+8228", (12 - UNDULATION) / 0.3048),
    ],
)
def test_geoid_of_the_user(geoid: Path, source: str, target: str, height: float) -> None:
    there, here = way(source, target, geoid=geoid)
    moved = there.transform(here)
    assert moved[0, 2] == pytest.approx(height, abs=1e-4)
    np.testing.assert_allclose(there.transform(moved, back=True), here, rtol=0, atol=1e-6)
    assert there.accuracy is None


def test_beyond_the_geoid_is_no_height(geoid: Path) -> None:
    there, here = way("EPSG:32635+ellipsoid", "EPSG:32635+5773", geoid=geoid)
    with pytest.raises(DataError, match=r"1 of 2 coordinates, such as 500000, 4200000, 12, lie"):
        there.transform(np.vstack([here, [[500_000, 4_200_000, 12]]]))


def test_a_file_that_is_no_geoid(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    path.write_text("no grid")
    with pytest.raises(DataError, match=r"geoid: PROJ cannot read .*a\.tif"):
        way("EPSG:32635+ellipsoid", "EPSG:32635+5773", geoid=path)


def test_ellipsoidal_heights_as_text() -> None:
    crs = parse_crs("EPSG:32635+ellipsoid")
    assert same_crs(crs, CRS(32635).to_3d())
    assert not same_crs(crs, CRS(32635))
    assert crs_text(crs) == "EPSG:32635+ellipsoid"
