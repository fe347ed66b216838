"""points.info: the figures of a cloud that is known by heart, and its warnings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pyproj import CRS

from algorithms.points.info import PointsInfo, covered_area
from toolbox.data import PointCloud


def grid(side: int = 100, **columns: Any) -> PointCloud:
    """A square of side x side points, one metre apart."""
    x, y = (g.ravel().astype(float) for g in np.meshgrid(np.arange(side), np.arange(side)))
    crs = columns.pop("crs", CRS("EPSG:2154+5720"))
    return PointCloud(np.column_stack([x, y, x / 100]), columns, crs=crs, name="grid.laz")


def report(cloud: PointCloud) -> tuple[dict[str, Any], list[str]]:
    """Properties by name, and the warnings."""
    rows = PointsInfo(points=cloud).run().table.records()
    found = {row["property"]: row["value"] for row in rows if row["property"] != "warning"}
    return found, [row["value"] for row in rows if row["property"] == "warning"]


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
    rows = PointsInfo(points=grid(crs=CRS(4326))).run().table.records()
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
        (grid(crs=None), "--assume-crs"),
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
