"""What every ground filter keeps: one answer however points are given, and errors that say why.

The scene is a town on a slope: each filter tells its roofs from its ground, so labels are known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS
from scenes import towns
from scenes.layers import UTM, cloud
from scenes.towns import Box, inside

from algorithms.ground.classify import GroundClassify
from algorithms.ground.csf import GroundCsf
from algorithms.ground.ptd import GroundPtd
from algorithms.ground.robust_interpolation import GroundRobustInterpolation
from toolbox.context import Context
from toolbox.data import PointCloud, Raster
from toolbox.declare import ClassList
from toolbox.errors import Cancelled, DataError

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
THREADS = numba.get_num_threads()
FOOT = 1200 / 3937  # metres, US survey
BOXES: dict[Box, float] = {(10, 20, 10, 25): 4.0, (32, 62, 25, 55): 8.0, (15, 19, 40, 44): 5.0}
FILTERS = (GroundClassify, GroundCsf, GroundPtd, GroundRobustInterpolation)


@pytest.fixture(params=FILTERS, ids=lambda tool: str(tool.__name__))
def tool(request: pytest.FixtureRequest) -> Any:
    """A ground filter."""
    return request.param


@pytest.fixture
def threads() -> Iterator[Callable[[int], None]]:
    """Sets how many threads compiled loops have, until the test ends."""
    yield numba.set_num_threads
    numba.set_num_threads(THREADS)


def plane(side: float = 90.0) -> Floats:
    return towns.plane(side=side)


def town() -> Floats:
    return towns.town(plane(), BOXES)[0]


def on_roof(xyz: Floats) -> Mask:
    return towns.town(xyz, BOXES)[1]


def classes(out: Any) -> Any:
    return out.classified["classification"]


def surface(out: Any) -> Raster:
    found: Raster = getattr(out, "cloth", None) or out.surface
    return found


def test_roofs_are_told_from_the_ground(tool: Any) -> None:
    xyz = town()
    out = tool(points=cloud(xyz)).run()
    np.testing.assert_array_equal(classes(out), np.where(on_roof(xyz), 1, 2))
    assert classes(out).dtype == np.uint8
    assert out.ground_share == pytest.approx(1 - on_roof(xyz).mean())
    assert len(out.ground) == np.count_nonzero(classes(out) == 2)


def test_the_order_of_the_points_does_not_matter(tool: Any) -> None:
    xyz = np.concatenate([town(), town()[:500]])  # with duplicates
    xyz[:, 2] = xyz[:, 2].round(1)  # and equal heights
    order = np.random.default_rng(3).permutation(len(xyz))
    first, second = (tool(points=cloud(given)).run() for given in (xyz, xyz[order]))
    np.testing.assert_array_equal(classes(first)[order], classes(second))
    np.testing.assert_array_equal(surface(first).band(), surface(second).band())


@pytest.mark.skipif(THREADS < 2, reason="one thread only")
def test_the_number_of_threads_does_not_matter(tool: Any, threads: Callable[[int], None]) -> None:
    threads(1)
    one = tool(points=cloud(town())).run()
    threads(2)
    two = tool(points=cloud(town())).run()
    np.testing.assert_array_equal(classes(one), classes(two))
    np.testing.assert_array_equal(surface(one).band(), surface(two).band())


@pytest.mark.parametrize("move", [(-700_000, -5_200_000, 0), (4_000_000, -6_000_000, -1000)])
def test_the_place_of_the_origin_does_not_matter(tool: Any, move: tuple[float, ...]) -> None:
    xyz = town().round(3)
    there = classes(tool(points=cloud(xyz + move)).run())
    np.testing.assert_array_equal(there, classes(tool(points=cloud(xyz)).run()))


def test_the_tool_in_feet_is_the_tool_in_metres(tool: Any) -> None:
    """Lengths of parameters, and those within the code, are metres."""
    xyz = town()
    metric = tool(points=cloud(xyz)).run()
    feet = tool(points=PointCloud(xyz / FOOT, crs=CRS(2263))).run()
    np.testing.assert_array_equal(classes(feet), classes(metric))
    assert surface(feet).units[0] == "US survey foot"
    assert surface(feet).cell == pytest.approx(surface(metric).cell / FOOT)


def test_progress_rises_to_one_and_a_run_can_be_cancelled(tool: Any) -> None:
    seen: list[float] = []
    tool(points=cloud(town())).run(Context(seen.append))
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)
    assert len(seen) > 30
    for count in (3, 20):
        calls = iter([False] * count + [True])
        with pytest.raises(Cancelled):
            tool(points=cloud(town())).run(Context(stop=lambda calls=calls: next(calls)))


@pytest.mark.parametrize("count", [1, 2, 3])
def test_very_few_points_are_ground(tool: Any, count: int) -> None:
    xyz = np.array([[5.0, 5.0, 1.0], [6.0, 8.0, 1.2], [9.0, 4.0, 0.9]])[:count]
    assert (classes(tool(points=cloud(xyz)).run()) == 2).all()


def test_points_on_a_line_are_ground(tool: Any) -> None:
    along = np.arange(0.0, 200, 0.5)
    for xyz in ([along, 2 * along, 0.3 * along], [along, 0 * along + 7, 0 * along]):
        assert (classes(tool(points=cloud(np.column_stack(xyz))).run()) == 2).all()


def test_points_in_one_cell(tool: Any) -> None:
    xyz = np.array([[5.1, 5.1, 1.0], [5.2, 5.1, 1.2], [5.1, 5.2, 4.0], [5.1, 5.1, 1.0]])
    np.testing.assert_array_equal(classes(tool(points=cloud(xyz)).run()), [2, 2, 1, 2])


def test_ignored_classes_take_no_part_and_stay(tool: Any) -> None:
    xyz = town()
    low = inside(xyz, (70, 76, 70, 76))
    bad = xyz - np.where(low[:, None], (0, 0, 3.0), 0)  # too many to be outliers
    alone = tool(points=cloud(xyz[~low])).run()
    out = tool(points=cloud(bad, np.where(low, 7, 0))).run()
    assert (classes(out)[low] == 7).all()
    np.testing.assert_array_equal(classes(out)[~low], classes(alone))
    np.testing.assert_array_equal(surface(out).band(), surface(alone).band())
    careless = tool(points=cloud(bad, np.where(low, 7, 0)), ignore=None).run()
    assert not np.array_equal(surface(careless).band(), surface(alone).band())


def test_other_classes_may_be_kept_but_not_ground(tool: Any) -> None:
    xyz = town()
    roof = on_roof(xyz)
    before = np.where(roof, 6, 5)
    before[np.flatnonzero(roof)[::2]] = 2
    kept = tool(points=cloud(xyz, before), keep_classes=ClassList(range(256))).run()
    expected = np.where(roof, np.where(before == 2, 1, 6), 2)
    np.testing.assert_array_equal(classes(kept), expected)


@pytest.mark.parametrize("number", [17, 26])
def test_a_structure_that_stays_does_so_on_the_ground(tool: Any, number: int) -> None:
    """A deck or quay at the level of the ground beside it, in Dutch surveys of class 26."""
    xyz = plane()
    deck = inside(xyz, (70, 76, 70, 76))
    kept = tool(
        points=cloud(xyz, np.where(deck, number, 1)), keep_classes=ClassList([number])
    ).run()
    np.testing.assert_array_equal(classes(kept), np.where(deck, number, 2))


def test_only_last_returns_can_be_ground(tool: Any) -> None:
    """Unless all may be, or their numbers are zero."""
    xyz = plane()
    first = np.arange(len(xyz)) % 5 == 0
    numbers = {"return_number": np.ones(len(xyz)), "number_of_returns": np.where(first, 2, 1)}
    for known, returns, expected in ((1, "last", ~first), (0, "last", True), (1, "all", True)):
        given = {name: (known * column).astype(np.uint8) for name, column in numbers.items()}
        out = tool(points=PointCloud(xyz, given, crs=UTM), returns=returns).run()
        assert ((classes(out) == 2) == expected).all()


@pytest.mark.parametrize("ignore", [None, ClassList([7])])
def test_nothing_to_classify(tool: Any, ignore: ClassList | None) -> None:
    points = cloud(plane(5), np.full(len(plane(5)), 7))
    points = points if ignore else points.select([])
    reason = f"{len(points)} are of classes that take no part .*" if ignore else "there are none"
    with pytest.raises(DataError, match=f"points: none can be ground: {reason}"):
        tool(points=points, ignore=ignore).run()


def test_a_stray_point_far_away_is_refused_before_memory_is_taken(tool: Any) -> None:
    xyz = np.vstack([plane(), [[900_000.0, 5_000_000.0, 300.0]]])
    with pytest.raises(DataError, match=r"y 5000000\.00 to .*remove stray points"):
        tool(points=cloud(xyz)).run()
