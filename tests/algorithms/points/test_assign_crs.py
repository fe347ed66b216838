"""A CRS is said of points, and nothing else of them changes."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import CRS
from scenes.layers import cloud

from algorithms.points.assign_crs import PointsAssignCrs
from toolbox.data.crs import same_crs
from toolbox.errors import DataError

XYZ = [[500_000.0, 4_600_000.0, 3.0], [500_900.0, 4_600_700.0, 80.0]]


def test_assigning_keeps_coordinates() -> None:
    points = cloud(XYZ, crs=None)
    out = PointsAssignCrs(points=points, crs=CRS("EPSG:32635")).run().assigned
    assert same_crs(out.crs, CRS(32635))
    np.testing.assert_array_equal(out.xyz, points.xyz)


def test_a_stated_crs_is_replaced_only_if_asked() -> None:
    points = cloud(XYZ)
    with pytest.raises(DataError, match=r"a\.laz states EPSG:32635 .*--replace true"):
        PointsAssignCrs(points=points, crs=CRS(32636))
    out = PointsAssignCrs(points=points, crs=CRS(32636), replace=True).run().assigned
    assert same_crs(out.crs, CRS(32636))
    high = CRS("EPSG:32635+5773")  # adds what was not said
    assert same_crs(PointsAssignCrs(points=points, crs=high).run().assigned.crs, high)


def test_coordinates_that_cannot_be_there_are_refused() -> None:
    degrees = cloud([[29.0, 41.0, 0.0], [29.001, 41.001, 0.0]], crs=None)
    with pytest.raises(DataError, match="look like degrees"):
        PointsAssignCrs(points=degrees, crs=CRS(32635))


def test_coordinates_far_from_the_area_of_use_are_told(caplog: pytest.LogCaptureFixture) -> None:
    """A Dutch survey became a French one, and nothing was said."""
    dutch = cloud([[132_000.0, 549_000.0, 0.0], [132_900.0, 549_700.0, 3.0]], crs=None)
    PointsAssignCrs(points=dutch, crs=CRS(28992)).run()
    assert not caplog.text
    PointsAssignCrs(points=dutch, crs=CRS(2154)).run()
    assert "far outside the area of use of EPSG:2154" in caplog.text
