"""What the ground filters have in common: which points take part, and what becomes of the rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.shared.ground import Candidates
from toolbox import catalog
from toolbox.data import PointCloud
from toolbox.declare import ClassList, Share
from toolbox.errors import DataError, NothingToDo

FILTERS = ["ground.classify", "ground.csf", "ground.ptd", "ground.robust_interpolation"]


def cloud(**attributes: list[int]) -> PointCloud:
    columns: dict[str, Any] = {n: np.array(v, np.uint8) for n, v in attributes.items()}
    size = len(next(iter(columns.values())))
    return PointCloud(np.zeros((size, 3)), columns, crs=CRS(32635))


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (cloud(withheld=[1, 1]), "2 are withheld"),
        (
            cloud(classification=[7, 18, 7]),
            r"3 are of classes that take no part \(ignore, keep_classes\)",
        ),
        (
            cloud(return_number=[1], number_of_returns=[2]),
            r"1 are no last returns \(--returns all takes them, too\)",
        ),
        (
            cloud(
                withheld=[1, 0, 0],
                classification=[7, 7, 2],
                return_number=[1, 1, 1],
                number_of_returns=[2, 2, 2],
            ),
            "1 are withheld; 1 are of classes that take no part .*; 1 are no last returns .*",
        ),
        (cloud(classification=[7, 14, 17]), "3 are of classes that take no part .*"),
        (cloud(classification=[]), "there are none"),
    ],
)
@pytest.mark.parametrize("id", FILTERS)
def test_what_excluded_all_points_is_said(id: str, points: PointCloud, reason: str) -> None:
    made = catalog.load(id).make(points=points)
    with pytest.raises(NothingToDo, match=f"points: none can be ground: {reason}$"):
        made.run()


@pytest.mark.parametrize("keep", [None, ClassList([3, 4, 5])])
@pytest.mark.parametrize("id", FILTERS)
def test_a_tile_without_ground(id: str, keep: ClassList | None) -> None:
    """Points that take part are class 1, or keep theirs; the others keep theirs in any case."""
    points = cloud(
        withheld=[1, 0, 0, 0],
        classification=[2, 7, 5, 2],
        return_number=[1, 1, 1, 1],
        number_of_returns=[2, 2, 2, 2],
    ).with_origin(np.array([0, 1, 2, -4]))
    made = catalog.load(id).make(points=points, ignore=ClassList([7]), keep_classes=keep)
    with pytest.raises(NothingToDo) as caught:
        made.run()
    instead = caught.value.instead
    assert vars(instead).keys() == catalog.load(id).outputs.keys()
    found = instead.classified
    assert found["classification"].tolist() == [2, 7, 5 if keep else 1, 1]
    assert repr(instead.ground_share) == repr(Share(0, 3))
    if id == "ground.classify":
        assert found["confidence"].tolist() == [0, 0, 1, 1]


def test_points_that_take_part() -> None:
    points = cloud(
        withheld=[1, 0, 0, 0],
        classification=[2, 7, 5, 2],
        return_number=[1, 1, 1, 1],
        number_of_returns=[2, 2, 2, 1],
    )
    candidates = Candidates.of(points, "last", ClassList([7]))
    assert candidates.part.tolist() == [False, False, True, True]
    assert candidates.chosen.tolist() == [False, False, False, True]
    found = np.ones(1, bool)
    assert repr(candidates.share(found, candidates.classified(found))) == repr(Share(1, 4))
    assert Candidates.of(points, "all", None).chosen.tolist() == [False, True, True, True]


@pytest.mark.parametrize("id", [*FILTERS, "points.denoise", "points.height_above_ground"])
def test_coordinates_beyond_all_measure(id: str) -> None:
    """A clear error, without warnings of overflow before it."""
    points = PointCloud(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 1e300]]),
        {"classification": np.full(3, 2, "u1")},
        crs=CRS(32635),
    )
    settings = {"method": "nearest"} if id == "points.height_above_ground" else {}
    with pytest.raises(DataError, match=r"below 1e\+12 in size, got z = 1e\+300 at point 2"):
        catalog.load(id).make(points=points, **settings).run()


STREET = {  # class: columns of a street from west to east, in metres
    11: (18, 26),  # road
    9: (40, 48),  # water
    17: (60, 70),  # the deck of a bridge, 6 m above the ground
    14: (76, 77),  # a wire
    6: (84, 94),  # a building
}


def street() -> tuple[PointCloud, NDArray[np.int64]]:
    """Level ground with what lies and stands on it, and for each point its class."""
    x, y = (axis.ravel() + 0.01 for axis in np.mgrid[0:110:0.5, 0:40:0.5])
    z = 0.02 * np.sin(x) * np.cos(y)
    kind = np.full(len(x), 2)
    for which, (west, east) in STREET.items():
        inside = (x >= west) & (x < east) & ((which != 6) | (abs(y - 20) < 6))
        kind[inside] = which
        z[inside] += {17: 6.0, 14: 12.0, 6: 5.0}.get(which, 0.0)
    columns = {"classification": kind.astype(np.uint8)}
    return PointCloud(np.column_stack([x, y, z]), columns, crs=CRS(32635)), kind


@pytest.mark.parametrize("id", FILTERS)
def test_roads_and_water_keep_their_class_on_the_ground(id: str) -> None:
    """They carry the terrain as ever; bridges and wires take no part in it."""
    points, kind = street()
    out = catalog.load(id).make(points=points).run()
    found = out.classified["classification"]
    np.testing.assert_array_equal(found, np.where(kind == 6, 1, kind))
    np.testing.assert_array_equal(out.ground.xyz, points.xyz[np.isin(kind, (2, 9, 11))])
    assert out.ground_share == pytest.approx((found == 2).mean()), "what its user can count"
    plain = catalog.load(id).make(points=points, keep_classes=None).run()
    assert set(np.unique(plain.classified["classification"])) == {1, 2}
    assert (plain.classified["classification"][np.isin(kind, (9, 11))] == 2).all()
    bare = points.select(~np.isin(kind, (14, 17)))
    alone = catalog.load(id).make(points=bare, keep_classes=None).run()
    np.testing.assert_array_equal(out.ground.xyz, alone.ground.xyz)


@pytest.mark.parametrize("id", FILTERS)
def test_a_road_above_the_ground_is_kept_but_no_ground(id: str) -> None:
    """Older files have the decks of bridges in class 11."""
    points, kind = street()
    points = points.with_attributes({"classification": np.where(kind == 6, 11, kind)})
    out = catalog.load(id).make(points=points).run()
    np.testing.assert_array_equal(out.classified["classification"], points["classification"])
    assert out.ground.xyz[:, 2].max() < 1


@pytest.mark.parametrize(("classes", "told"), [([2, 1, 1], True), ([0, 1, 1], False)])
def test_ground_of_the_file_is_replaced_and_that_is_told(
    classes: list[int], told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    points = cloud(classification=classes)
    part = np.ones(3, bool)
    candidates = Candidates(points, part, part, ())
    with caplog.at_level("INFO", "toolbox"):
        made = candidates.classified(np.array([False, True, True]))
    assert made["classification"].tolist() == [1, 2, 2]
    assert ("class 2 (ground) of the file is replaced" in caplog.text) is told


@pytest.mark.parametrize("kept", [True, False])
def test_points_of_class_26_are_told_as_ground_or_not(
    kept: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """A bridge of the Dutch AHN became ground, and no set said so."""
    points = cloud(classification=[26, 26, 1])
    candidates = Candidates.of(points, "all", keep=ClassList([17, 26] if kept else [17]))
    candidates.classified(np.ones(np.count_nonzero(candidates.chosen), bool))
    lost, stays = "2 points of class 26 become ground", "2 points keep class 26 and are no ground"
    assert (stays in caplog.text) == kept
    assert (lost in caplog.text) == (not kept)
