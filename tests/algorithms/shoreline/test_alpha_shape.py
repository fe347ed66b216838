"""shoreline.alpha_shape: points in, polygons with attributes out."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pyproj import CRS
from scenes.layers import UTM, cloud

from algorithms.shoreline.alpha_shape import ShorelineAlphaShape
from toolbox.context import Context
from toolbox.data import PointCloud, Vector
from toolbox.declare import Attribute, ClassList
from toolbox.errors import Cancelled, DataError, NothingToDo, ParameterError

FEET = CRS(2263)
FOOT = 1200 / 3937


def squares(*origins: tuple[float, float], side: int = 11) -> Any:
    """Lattices of 1 m, one after the other; shape (n, 3)."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(side), np.arange(side)))
    return np.vstack([np.column_stack([x + e, y + n, 0 * x]) for e, n in origins]).astype(float)


def test_regions_come_with_their_measures() -> None:
    out = ShorelineAlphaShape(
        points=cloud(squares((500_000, 4e6), (500_050, 4e6))), alpha=1.0
    ).run()
    frame = out.shapes.frame
    assert list(frame.columns) == ["area", "perimeter", "alpha", "points", "geometry"]
    assert frame["area"].tolist() == [100, 100]
    assert frame["perimeter"].tolist() == [40, 40]
    assert frame["points"].tolist() == [121, 121]
    assert frame.crs == UTM
    assert (out.regions, out.area, out.alpha_used, out.outside_share) == (2, 200, 1, 0)


def test_auto_joins_all_and_says_how() -> None:
    out = ShorelineAlphaShape(points=cloud(squares((0, 0), (30, 0)))).run()
    # The circle through the ends of the facing sides: 20 m apart, 10 m long.
    assert out.alpha_used == pytest.approx(math.hypot(10, 0.5), rel=1e-9)
    assert out.regions == 1
    assert out.area == pytest.approx(400)


def test_lengths_are_metres_in_feet_too() -> None:
    xyz = squares((500_000, 200_000))
    feet = ShorelineAlphaShape(
        points=cloud(xyz / FOOT, crs=FEET), hole_threshold=3.0, alpha=0.8
    ).run()
    assert feet.alpha_used == pytest.approx(0.8)
    assert feet.area == pytest.approx(100)
    assert feet.shapes.frame["area"][0] == pytest.approx(100 / FOOT**2)
    assert feet.shapes.frame["alpha"][0] == pytest.approx(0.8 / FOOT)


def test_groups_have_shapes_of_their_own() -> None:
    """Two that overlap, and one that is a line."""
    xyz = np.vstack([squares((0, 0), (5, 0)), [[90, 0, 0], [91, 0, 0], [92, 0, 0]]])
    plane = np.repeat([7, 3, 5], [121, 121, 3]).astype(np.uint16)
    order = np.random.default_rng(0).permutation(len(xyz))
    points = cloud(xyz[order], plane=plane[order])
    out = ShorelineAlphaShape(points=points, group=Attribute("plane")).run()
    frame = out.shapes.frame
    assert frame["plane"].tolist() == [3, 7]
    assert frame["area"].tolist() == [100, 100]
    assert frame.geometry[0].bounds == (5, 0, 15, 10)
    assert out.outside_share == 3 / 245


def test_only_the_classes_asked_for() -> None:
    xyz = squares((0, 0), (30, 0))
    points = cloud(xyz, classification=np.repeat([9, 2], 121).astype(np.uint8))
    out = ShorelineAlphaShape(points=points, classes=ClassList([9])).run()
    assert out.area == 100
    with pytest.raises(NothingToDo, match="none is of class 6"):
        ShorelineAlphaShape(points=points, classes=ClassList([6])).run()


def test_no_area_is_empty_and_says_where_it_begins(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        out = ShorelineAlphaShape(points=cloud(squares((0, 0))), alpha=0.5).run()
    assert "begins at an alpha of 0.707 m" in caplog.text
    assert (out.regions, out.area, out.outside_share) == (0, 0, 1)
    out.shapes.save(tmp_path / "a.gpkg")
    assert Vector.open(tmp_path / "a.gpkg").geometry_type == "Polygon"


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"alpha": 0.0}, "alpha: must be > 0 m"),
        ({"hole_threshold": -1.0}, "hole_threshold: must be >= 0 m2"),
        ({"group": Attribute("plane")}, "no attribute 'plane'"),
    ],
)
def test_wrong_settings(settings: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        ShorelineAlphaShape(points=cloud(squares((0, 0))), **settings)


def test_wrong_data() -> None:
    line = squares((0, 0))[:11]
    with pytest.raises(DataError, match="points: all 11 lie on one line"):
        ShorelineAlphaShape(points=cloud(line)).run()
    with pytest.raises(DataError, match="no CRS"):
        ShorelineAlphaShape(points=cloud(squares((0, 0)), crs=None))
    with pytest.raises(DataError, match=r"classes: a\.laz has no classification"):
        ShorelineAlphaShape(points=cloud(squares((0, 0))), classes=ClassList([9]))
    area = cloud(squares((0, 0)), area=np.zeros(121))
    with pytest.raises(DataError, match="group: area is what an attribute"):
        ShorelineAlphaShape(points=area, group=Attribute("area"))
    unknown = cloud(squares((0, 0)), body=np.full(121, np.nan))
    with pytest.raises(DataError, match="group: body is not a number"):
        ShorelineAlphaShape(points=unknown, group=Attribute("body")).run()
    lines = cloud(line, body=np.zeros(11))
    with pytest.raises(NothingToDo, match="no body has points that span a triangle"):
        ShorelineAlphaShape(points=lines, group=Attribute("body")).run()


def test_progress_within_groups_and_cancel() -> None:
    points = cloud(squares((0, 0), (30, 0)), body=np.repeat([0, 1], 121))
    job = ShorelineAlphaShape(points=points, group=Attribute("body"))
    seen: list[float] = []
    job.run(Context(seen.append))
    assert seen == sorted(seen)
    with pytest.raises(Cancelled):
        job.run(Context(stop=lambda: True))


def test_real_water_is_one_lake(data: Any) -> None:
    points = PointCloud.open(data("water_denoever_ahn3") / "AHN3.laz").with_crs(CRS(28992))
    out = ShorelineAlphaShape(
        points=points, alpha=3.0, classes=ClassList([9]), region_threshold=100.0
    ).run()
    assert shapely.is_valid(out.shapes.frame.geometry).all()
    assert out.outside_share < 0.01
