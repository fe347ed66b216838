"""points.survey_quality: density, voids, strips and their differences where they are known."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

import toolbox
from algorithms.points.survey_quality import PointsSurveyQuality
from toolbox import catalog
from toolbox.data import PointCloud
from toolbox.errors import NothingToDo


def strip(number: int, west: float, east: float, height: float = 0.0, **more: int) -> PointCloud:
    """Four points per square metre on a level field between two eastings, 40 m long."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(west, east, 0.5), np.arange(0, 40, 0.5)))
    xyz = np.column_stack([x + 0.25, y + 0.25, np.full(len(x), 100.0 + height)])
    values = {"point_source_id": number, "return_number": 1, "number_of_returns": 1, **more}
    return PointCloud(
        xyz,
        {name: np.full(len(x), value, np.uint16) for name, value in values.items()},
        crs=CRS(32635),
    )


def quality(*strips: PointCloud, **settings: float) -> PointsSurveyQuality.Outputs:
    return PointsSurveyQuality(points=PointCloud.concat(strips), **settings).run()


def test_density_and_spacing_of_pulses() -> None:
    found = quality(strip(1, 0, 40), cell=2.0)
    assert found.mean_density == pytest.approx(4.0)
    assert found.spacing == pytest.approx(0.5)
    assert (found.density.band() == 4.0).all()
    assert found.void_share == found.overlap_share == 0.0
    assert found.strip_rms is None


def test_rasters_have_units_of_their_own() -> None:
    """Without one, GDAL takes that of the heights of the CRS."""
    crs = CRS("EPSG:28992+5709")
    points = PointCloud.concat([strip(1, 0, 20), strip(2, 10, 30)]).with_crs(crs)
    found = PointsSurveyQuality(points=points).run()
    units = [layer.units for layer in (found.density, found.strips, found.strip_difference)]
    assert units == [("1/m2",), ("1",), ("metre",)]


def test_later_returns_are_no_pulses() -> None:
    found = quality(strip(1, 0, 40), strip(1, 0, 40, -2.0, return_number=2), cell=2.0)
    assert found.mean_density == pytest.approx(4.0)


def test_cells_are_four_spacings_wide() -> None:
    assert quality(strip(1, 0, 40)).density.cell == pytest.approx(2.0, rel=0.15)


def test_a_hole_is_a_void() -> None:
    cloud = strip(1, 0, 40)
    x, y = cloud.xyz[:, 0], cloud.xyz[:, 1]
    found = quality(cloud.select(~((x > 10) & (x < 14) & (y > 10) & (y < 14))), cell=2.0)
    assert found.void_share == pytest.approx(4 / 400)
    assert (found.strips.band() == 0).sum() == 4


def test_strips_overlap_and_differ() -> None:
    found = quality(strip(7, 0, 24), strip(9, 16, 40, 0.05), cell=2.0)
    assert found.strip_count == 2
    assert found.overlap_share == pytest.approx(8 / 40)
    (row,) = found.pairs.rows()
    assert (row["first"], row["second"], row["cells"]) == (7, 9, 80)
    assert row["mean_m"] == pytest.approx(0.05)
    assert found.strip_rms == pytest.approx(0.05)
    assert np.nanmax(found.strip_difference.band()) == pytest.approx(0.05, abs=1e-6)


def test_strips_that_hardly_overlap_do_so_on_no_0_percent() -> None:
    """A report said that strips overlap on 0 % of the survey, and differ there by 0.03 m."""
    far, beside = (quality(strip(7, 0, 24), strip(9, west, 50), cell=2.0) for west in (26, 23.5))
    assert "2 strips overlap nowhere." in far.in_words()
    assert far.in_words() != beside.in_words()
    hardly = dataclasses.replace(beside, overlap_share=0.0004)
    assert "overlap on 0.04 % of it" in hardly.in_words()


def test_a_few_cells_tell_no_difference_of_strips() -> None:
    """Of one cell a report said by how much strips differ, as an RMS."""
    some, few = (quality(strip(7, 0, 24), strip(9, x, 40), cell=2.0).in_words() for x in (16, 22))
    assert "differ there by" in some
    assert "differ there by" not in few
    assert "of flat ground there are 20 cells with both, fewer than 30" in few


def test_density_is_told_of_the_survey_and_of_each_strip() -> None:
    found = quality(strip(7, 0, 24), strip(9, 16, 40), cell=2.0)
    rows = {row["strip"]: row for row in found.by_strip.rows()}
    assert list(rows) == ["all", "7", "9"]
    assert rows["7"]["per_m2"] == pytest.approx(4.0)
    assert rows["9"]["area_m2"] == 24 * 40
    assert rows["all"]["per_m2"] == pytest.approx(found.mean_density)
    assert rows["all"]["first_returns"] == rows["7"]["first_returns"] + rows["9"]["first_returns"]


def test_voids_of_a_strip_are_its_own() -> None:
    """What another strip has filled is no void of the survey."""
    first = strip(7, 0, 24)
    x, y = first.xyz[:, 0], first.xyz[:, 1]
    holed = first.select(~((x > 18) & (x < 22) & (y > 10) & (y < 14)))
    rows = {row["strip"]: row for row in quality(holed, strip(9, 16, 40), cell=2.0).by_strip.rows()}
    assert rows["7"]["void_share"] == pytest.approx(4 / 240)
    assert rows["9"]["void_share"] == rows["all"]["void_share"] == 0.0


def test_the_table_has_square_metres_of_data_in_feet() -> None:
    feet = strip(7, 0, 24).with_xyz(strip(7, 0, 24).xyz / 0.3048).with_crs(CRS(2994))
    (row,) = quality(feet, cell=2.0).by_strip.rows()
    assert row["per_m2"] == pytest.approx(4.0, rel=1e-3)
    assert row["spacing_m"] == pytest.approx(0.5, rel=1e-3)


def test_words_have_the_feet_of_the_data_beside_metres(tmp_path: Path) -> None:
    feet = strip(7, 0, 24).with_xyz(strip(7, 0, 24).xyz / 0.3048).with_crs(CRS(2994))
    place = tmp_path / "a.html"
    made = toolbox.run("points.survey_quality", {"points": feet, "cell": 2.0, "page": place})
    density, spacing = made["mean_density"], made["spacing"]
    said = f"{density:.1f} pulses per square metre ({density * 0.3048**2:.3f}/ft²), "
    assert f"{said}{spacing:.2f} m ({spacing / 0.3048:.2f} ft) apart" in place.read_text()


def test_rough_cells_are_not_compared() -> None:
    one, other = strip(1, 0, 24), strip(2, 16, 40)
    rough = other.with_xyz(other.xyz + [0, 0, 1] * (np.arange(len(other)) % 2)[:, None])
    assert quality(one, rough, cell=2.0).strip_rms is None


def test_a_roof_that_one_strip_sees_is_not_compared_with_the_street() -> None:
    street = strip(1, 0, 24, classification=2)
    roof = strip(2, 16, 20, 6.0, classification=6)
    more = strip(2, 20, 40, 0.02, classification=2)
    assert quality(street, roof, more, cell=2.0).strip_rms == pytest.approx(0.02)


def test_noise_takes_no_part() -> None:
    noise = strip(1, 0, 40, 90.0, classification=18)
    found = quality(strip(1, 0, 40, classification=2), noise, cell=2.0)
    assert found.mean_density == pytest.approx(4.0)


def test_cells_that_the_data_covers_in_part_do_not_thin_it() -> None:
    """One row of points beyond a line of the grid makes cells of a quarter."""
    found = quality(strip(1, 0.5, 40.5), cell=2.0)
    assert found.mean_density == pytest.approx(4.0)
    assert found.thin_share == 0.0


def test_data_narrower_than_cells_is_told(caplog: pytest.LogCaptureFixture) -> None:
    assert quality(strip(1, 0, 40), cell=30.0).mean_density < 4.0
    assert "no cell of 30 m is within the data" in caplog.text


def test_points_on_a_line_have_no_density() -> None:
    cloud = strip(1, 0, 40)
    one = cloud.select(cloud.xyz[:, 0] == cloud.xyz[0, 0])
    for some in (one, one.select(np.arange(len(one)) < 1)):
        with pytest.raises(NothingToDo, match="no density"):
            quality(some)


@pytest.mark.parametrize(("height", "told"), [(0.079, False), (0.081, True)])
def test_strips_that_differ_more_than_surveys_may_are_told(
    height: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """0.08 m is the largest RMSDz at quality levels 1 and 2, in feet as in metres."""
    quality(strip(1, 0, 24), strip(2, 16, 40, height), cell=2.0)
    foot = 1200 / 3937
    metres = PointCloud.concat([strip(1, 0, 24), strip(2, 16, 40, height)])
    names = {name: metres[name] for name in metres.names}
    quality(PointCloud(metres.xyz / foot, names, crs=CRS(2263)), cell=2.0 / foot)
    assert caplog.text.count("more than the 0.08 m") == 2 * told


def test_ground_of_the_lower_strip_alone_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """A filter took the lower of two strips: those left to compare agree by its choice."""
    low = [strip(1, 0, 40, classification=2), strip(2, 0, 16, classification=2)]
    quality(*low, strip(2, 16, 40, 1.0, classification=1), cell=2.0)
    assert "in 240 of 400 flat cells where strips overlap, one has points" in caplog.text
    caplog.clear()
    quality(low[0], strip(2, 0, 38, classification=2), strip(2, 38, 40, 5.0, classification=6))
    assert "flat cells" not in caplog.text


@pytest.mark.parametrize(("share", "told"), [(0.0, False), (0.009, False), (0.02, True), (1, True)])
def test_copies_of_points_are_told(
    share: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    cloud = strip(1, 0, 40)
    copies = cloud.select(np.arange(len(cloud)) < share * len(cloud))
    quality(cloud, copies, cell=2.0)
    text = f"{len(copies)} of {len(cloud) + len(copies)} points lie at the place (x, y, z)"
    assert (text in caplog.text) is told


def test_cells_may_be_a_whole_number_of_those_of_another_raster() -> None:
    """Density and strips of data in feet lay across the cells of 3 ft of all other rasters."""
    step = 0.9144
    found = quality(strip(1, 0, 40), multiple_of=step).density
    assert found.cell == pytest.approx(3 * step), "not less than four spacings"
    for edge in (found.bounds[0], found.bounds[3]):
        assert edge / step == pytest.approx(round(edge / step))


def test_cells_may_be_those_of_the_widest_raster_of_a_terrain() -> None:
    """Sets of a terrain with cells of more than 100 m were refused."""
    widest = catalog.describe("models.terrain")["inputs"]["cell"]["schema"]["maximum"]
    assert quality(strip(1, 0, 40), multiple_of=widest).density.cell == widest


def test_a_whole_number_of_cells_is_no_more_by_rounding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("algorithms.points.survey_quality.suitable_cell", lambda _: 19.6)
    found = quality(strip(1, 0, 40), multiple_of=0.7).density
    assert found.cell == pytest.approx(28 * 0.7), "19.6 / 0.7 is 28.000000000000004"
