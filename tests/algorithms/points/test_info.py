"""points.info: the figures of a cloud that is known by heart, and its warnings."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from pyproj import CRS
from scenes.layers import cloud
from scenes.towns import plane

from algorithms.points.info import PointsInfo, covered_area
from toolbox.data import PointCloud, Survey
from toolbox.data.crs import parse_crs


def grid(side: int = 100, **columns: Any) -> PointCloud:
    """A square of side x side points, one metre apart."""
    x, y = (g.ravel().astype(float) for g in np.meshgrid(np.arange(side), np.arange(side)))
    crs = columns.pop("crs", CRS("EPSG:2154+5720"))
    return PointCloud(np.column_stack([x, y, x / 100]), columns, crs=crs, name="grid.laz")


PLACE = "outside the area of use"  # where all these points are, as they begin at 0


def report(cloud: PointCloud | Survey) -> tuple[dict[str, Any], list[str]]:
    """Properties by name, and the warnings, but for that of their place."""
    rows = PointsInfo(points=cloud).run().table.rows()
    found = {row["property"]: row["value"] for row in rows if row["property"] != "warning"}
    warnings = [row["value"] for row in rows if row["property"] == "warning"]
    return found, [text for text in warnings if PLACE not in text]


def test_points_outside_the_area_of_use_of_their_crs(tmp_path: Path) -> None:
    for points in (grid(), tiles(tmp_path, [(0, 0), (1, 0)])):
        assert PLACE in " ".join(map(str, PointsInfo(points=points).run().table.frame["value"]))


def test_where_on_the_earth_the_points_are_is_told(tmp_path: Path) -> None:
    """Who knows the place of a survey sees that its CRS is wrong."""
    here = cloud([[500_000.0, 4_600_000.0, 3.0], [500_100.0, 4_600_100.0, 8.0]])
    here.save(tmp_path / "a.laz")
    for points in (here, Survey.open([tmp_path / "a.laz"])):
        found, _ = report(points)
        assert found["longitude of the centre"] == pytest.approx(27.0, abs=0.001)
        assert found["latitude of the centre"] == pytest.approx(41.55, abs=0.01)
    found, _ = report(grid(crs=None))
    assert "latitude of the centre" not in found


def test_lists_of_first_and_last_returns_are_told() -> None:
    twos = np.full(10_000, 2, np.uint8)
    _, warnings = report(grid(return_number=1 + np.arange(10_000) % 2, number_of_returns=twos))
    assert "no pulse has a single return: are these lists of first and of last returns?" in warnings


def test_figures() -> None:
    n = 10_000
    classes = np.where(np.arange(n) < 2500, 2, 64).astype(np.uint8)
    intensity = np.arange(n, dtype=np.uint16)
    found, warnings = report(grid(classification=classes, intensity=intensity))
    assert found["points"] == n
    assert (found["xmin"], found["ymax"], found["zmax"]) == (0, 99, 0.99)
    assert "2154" in found["crs"]
    assert "5720" in found["crs"]
    assert found["classification 2 Ground"] == 2500
    assert found["classification 64"] == 7500
    assert found["intensity percentile 50"] == pytest.approx(4999.5)
    assert warnings == []


def test_density_counts_covered_ground_only() -> None:
    assert PointsInfo(points=grid()).run().density == pytest.approx(1, rel=0.05)
    corner = grid()
    with_gap = corner.select((corner["x"] < 30) | (corner["y"] < 30))
    assert PointsInfo(points=with_gap).run().density == pytest.approx(1, rel=0.15)


def test_density_in_feet_is_per_square_metre() -> None:
    metres = grid()
    feet = PointCloud(metres.xyz / 0.3048, crs=CRS(2222))
    assert PointsInfo(points=feet).run().density == pytest.approx(1, rel=0.05)
    found, _ = report(feet)
    assert found["density"] == pytest.approx(1, rel=0.05)


@pytest.mark.parametrize(("crs", "foot"), [(2222, 0.3048), (2263, 1200 / 3937)])
def test_covered_area_in_feet_is_in_square_metres(crs: int, foot: float) -> None:
    metres = grid()
    feet = PointCloud(metres.xyz / foot, crs=CRS(crs))
    expected, _ = report(metres)
    found, _ = report(feet)
    assert expected["covered area"] == pytest.approx(10_000, rel=0.05)
    assert found["covered area"] == pytest.approx(expected["covered area"])
    returns = {"return_number": np.ones(10_000, np.uint8)}
    returns["number_of_returns"] = returns["return_number"]
    found, _ = report(PointCloud(feet.xyz, returns, crs=CRS(crs)))
    assert found["pulse density"] == pytest.approx(expected["density"])


def test_the_covered_area_of_degrees_is_in_their_unit() -> None:
    rows = PointsInfo(points=grid(crs=CRS(4326))).run().table.rows()
    (row,) = (row for row in rows if row["property"] == "covered area")
    assert row["unit"] == "square unit"
    assert row["value"] == pytest.approx(10_000, rel=0.05)


def test_density_of_degrees_is_not_given() -> None:
    out = PointsInfo(points=grid(crs=CRS(4326))).run()
    assert out.density is None


def test_area_of_a_line_or_nothing_is_zero() -> None:
    line = grid().select(grid()["y"] == 0)
    assert covered_area(line) == 0
    assert covered_area(line.select([])) == 0


@pytest.mark.parametrize(
    ("cloud", "text"),
    [
        (grid(crs=None), "assume_crs"),
        (grid(crs=CRS(4326)), "degrees"),
        (grid(2).select([]), "no points"),
        (grid(10, intensity=np.zeros(100, np.uint16)), "all intensities are 0"),
        (grid(10, classification=np.zeros(100, np.uint8)), "100 points were never classified"),
        (grid(10, withheld=np.ones(100, np.uint8)), "100 points are flagged as withheld"),
        (
            grid(
                10,
                return_number=np.full(100, 2, np.uint8),
                number_of_returns=np.ones(100, np.uint8),
            ),
            "100 points have a return number",
        ),
    ],
)
def test_warnings(cloud: PointCloud, text: str) -> None:
    _, warnings = report(cloud)
    assert any(text in warning for warning in warnings), warnings


def test_gross_outliers_are_counted() -> None:
    cloud = grid()
    z = cloud["z"].copy()
    z[:3], z[3] = -500, 900
    _, warnings = report(cloud.with_xyz(np.column_stack([cloud.xyz[:, :2], z])))
    assert any("3 points lie far below" in w for w in warnings)
    assert any("1 points lie far above" in w for w in warnings)


@pytest.mark.parametrize(("depth", "warned"), [(9.0, False), (13.0, True)])
@pytest.mark.parametrize(("crs", "foot"), [(32635, 1.0), (2222, 0.3048)])
def test_gross_outliers_lie_ten_metres_beyond_the_body(
    crs: int, foot: float, depth: float, warned: bool
) -> None:
    """On level ground of 0.3 m, so that ten metres decide, in feet as well."""
    cloud = grid()
    z = np.linspace(0, 0.3, len(cloud))
    z[0] = -depth
    points = PointCloud(np.column_stack([cloud.xyz[:, :2], z]) / foot, crs=CRS(crs))
    _, warnings = report(points)
    assert any("1 points lie far below" in w for w in warnings) == warned


@pytest.mark.parametrize(("depth", "warned"), [(290.0, False), (320.0, True)])
def test_gross_outliers_lie_three_ranges_beyond_a_slope(depth: float, warned: bool) -> None:
    z = np.linspace(0, 100, 10_000)
    z[0] = -depth
    _, warnings = report(grid().with_xyz(np.column_stack([grid().xyz[:, :2], z])))
    assert any("1 points lie far below" in w for w in warnings) == warned


@pytest.mark.parametrize(("crs", "told"), [(CRS(32635), True), (parse_crs("local"), False)])
def test_two_surveys_whose_heights_do_not_fit_are_told(crs: CRS, told: bool) -> None:
    """On a map; a local scan may be of two floors."""
    one = plane(60.0, 0.5, jitter=0.2)
    for xyz, two in ((one, False), (np.vstack([one, one + np.array([0.1, 0.1, 3.0])]), True)):
        _, warnings = report(PointCloud(xyz + np.array([5e5, 4.4e6, 0]), crs=crs))
        assert any("a second surface 3.0 m above it" in w for w in warnings) == (two and told)


def test_single_precision_is_told() -> None:
    xyz = grid().xyz + np.random.default_rng(0).uniform(0, 1, (10_000, 3)) + 5e5
    _, warnings = report(PointCloud(xyz.astype(np.float32).astype(float), crs=CRS(32635)))
    assert any("rounded to single precision" in w for w in warnings)


RING = [(column, row) for column in range(3) for row in range(3) if (column, row) != (1, 1)]


def tiles(
    folder: Path, places: Iterable[tuple[float, float]], crs: int = 2154, metre: float = 1
) -> Survey:
    """Squares of 10 m, each with 121 points, by column and row."""
    for column, row in places:
        square = grid(11, crs=CRS(crs), intensity=np.ones(121, np.uint16))
        xyz = (square.xyz + np.array([10 * column, 10 * row, 0])) * metre
        square.with_xyz(xyz).save(folder / f"{column}_{row}.las")
    return Survey.open(folder)


@pytest.mark.parametrize(("crs", "metre"), [(2154, 1), (2222, 1 / 0.3048)])
def test_a_survey_is_described_from_its_headers(tmp_path: Path, crs: int, metre: float) -> None:
    survey = tiles(tmp_path, RING, crs, metre)
    for file in survey.files:
        file.path.write_bytes(b"")  # nothing is read any more
    out = PointsInfo(points=survey).run()
    assert out.count == 8 * 121
    assert out.density == pytest.approx(1.21, rel=1e-3)
    found, warnings = report(survey)
    assert (found["survey"], found["files"], found["points"]) == (tmp_path.name, 8, 8 * 121)
    assert (found["xmin"], found["xmax"]) == (0, pytest.approx(30 * metre, abs=0.01))
    assert str(crs) in found["crs"]
    assert found["attribute intensity"] == "uint16"
    assert found["covered area"] == pytest.approx(800, rel=1e-3)
    assert found["overlap area"] == pytest.approx(0, abs=0.1)
    assert found["hull area without files"] == pytest.approx(100, rel=1e-2)
    assert (found["holes"], found["hole area"]) == (1, pytest.approx(100, rel=1e-2))
    assert found["density"] == pytest.approx(1.21, rel=1e-3)
    assert found["format LAS 1.4, point format 6"] == 8
    assert warnings == []


def test_one_row_per_file(tmp_path: Path) -> None:
    table = PointsInfo(points=tiles(tmp_path, RING)).run().files
    assert table is not None
    assert len(table) == 8
    assert table.rows()[1] == {
        "file": str(tmp_path / "0_1.las"),
        "points": 121,
        "xmin": 0,
        "ymin": 10,
        "zmin": 0,
        "xmax": 10,
        "ymax": 20,
        "zmax": 0.1,
        "density": pytest.approx(1.21),
        "format": "LAS 1.4, point format 6",
    }
    assert PointsInfo(points=grid()).run().files is None


def test_overlaps_and_seams(tmp_path: Path) -> None:
    """Three files of which each two share ground; and a ring of files that do not quite meet."""
    (tmp_path / "a").mkdir()
    found, _ = report(tiles(tmp_path / "a", [(0, 0), (0.5, 0), (0.8, 0), (5, 5)]))
    assert found["covered area"] == pytest.approx(180 + 100)
    assert found["overlap area"] == pytest.approx(50 + 70 - 20)
    assert found["holes"] == 0
    (tmp_path / "b").mkdir()
    found, _ = report(tiles(tmp_path / "b", [(1.2 * x, 1.2 * y) for x, y in RING]))
    assert found["holes"] == 1
    assert found["hole area"] == pytest.approx(14**2)


def test_warnings_of_a_survey(tmp_path: Path) -> None:
    tiles(tmp_path, [(0, 0), (1, 0)], 4326)
    first = PointCloud.open(tmp_path / "0_0.las")
    first.save(tmp_path / "copy.laz")
    first.select([]).save(tmp_path / "none.laz")
    xyz = first.xyz + np.array([0, 20.001, 0])
    PointCloud(xyz, {"red": np.ones(121, np.uint16)}, crs=first.crs).save(tmp_path / "z.las")
    content = bytearray((tmp_path / "1_0.las").read_bytes())
    (tmp_path / "1_0.las").write_bytes(content + bytes(60))
    found, warnings = report(Survey.open(tmp_path))
    for text in (
        "is in degrees",
        "none.laz holds no points",
        "1_0.las has room for 2 points more",
        "only 1 of 5 files have the attribute red",
        "the files have several scales",
        "copy.laz has as many points and the same bounds as 0_0.las",
    ):
        assert any(text in warning for warning in warnings), (text, warnings)
    assert len(warnings) == 6 + 2  # green and blue
    assert found["density"] == pytest.approx(4 * 121 / 300, rel=0.01)
    assert PointsInfo(points=Survey.open(tmp_path)).run().density is None


@pytest.mark.parametrize("places", [[], [(0, 0)]])
def test_surveys_without_ground(tmp_path: Path, places: list[tuple[int, int]]) -> None:
    """No points, or all in one line."""
    empty = grid(2, crs=CRS(2154)).select([])
    for name in ("a.las", "b.las"):
        empty.save(tmp_path / name)
    for column, row in places:
        line = grid(11, crs=CRS(2154))
        line.select(line["x"] == 0).save(tmp_path / f"{column}_{row}.las")
    out = PointsInfo(points=Survey.open(tmp_path)).run()
    assert (out.count, out.density) == (11 * len(places), None)
    found, warnings = report(Survey.open(tmp_path))
    assert (found["covered area"], found["holes"]) == (0, 0)
    assert "density" not in found
    assert ("there are no points" in warnings) == (not places)


def test_real_survey(data: Callable[[str], Path]) -> None:
    found, warnings = report(Survey.open(data("ign_urban_50m")))
    assert (found["points"], found["covered area"]) == (216_900, 7500)
    assert found["hull area without files"] == 3750
    assert found["format LAZ 1.4, point format 8"] == 3
    assert warnings == []


def scanned(path: Path, numbers: list[int], described: int = 1) -> PointCloud:
    """Points with waveforms of these descriptors in a file beside, of which some are described."""
    header = laspy.LasHeader(version="1.3", point_format=4)
    header.global_encoding.waveform_data_packets_external = True
    for number in range(1, described + 1):
        data = struct.pack("<2B2I2d", 8, 0, 128 * number, 1000, 1.0, 0.0)
        header.vlrs.append(laspy.VLR("LASF_Spec", 99 + number, "waveform", data))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.random.default_rng(0).uniform(0, 9, (3, len(numbers)))
    las.wavepacket_index = np.array(numbers, np.uint8)
    las.write(path)
    return PointCloud.open(path)


OFFSETS = np.array([999, 60, 188, 316, 317])  # the first point has no waveform


def test_waveforms_are_listed(tmp_path: Path) -> None:
    cloud = scanned(tmp_path / "a.las", [0, 1, 2, 2, 1], described=2)
    assert report(cloud)[0]["waveforms"] == "in a file .wdp, which is not beside it"
    (tmp_path / "a.wdp").write_bytes(bytes(444))
    cloud = PointCloud.open(tmp_path / "a.las").with_attributes({"wavepacket_offset": OFFSETS})
    cloud = cloud.with_attributes({"wavepacket_size": np.full(5, 128)})
    found, warned = report(cloud)
    assert found["waveforms"] == "in a file .wdp beside it"
    assert found["waveform packets"] == 444
    assert "waveforms of 1 points are beyond the end of the packets: they are cut off" in warned
    assert found["points with waveform"] == 4
    assert found["waveforms of descriptor 2"] == "256 samples of 8 bits, 1000 ps apart"
    assert not [text for text in warned if "descriptors" in text]


def test_waveforms_that_stay_behind_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cloud = scanned(tmp_path / "a.las", [1, 1])
    cloud.save(tmp_path / "b.laz")
    assert "its waveforms are in a file .wdp that was not beside the input" in caplog.text
    assert PointCloud.open(tmp_path / "b.laz")["wavepacket_index"].tolist() == [1, 1]


def test_waveforms_without_a_descriptor_are_warned_of(tmp_path: Path) -> None:
    _, warned = report(scanned(tmp_path / "a.las", [0, 1, 3]))
    assert "points have waveforms of descriptors that are not there: 3" in warned
    found, _ = report(grid())
    assert not [name for name in found if "waveform" in name]
