"""classify.suggest: uncertain patches, of all kinds, none twice."""

from __future__ import annotations

from typing import Any

import geopandas
import numpy as np
import pytest
import shapely

from algorithms.classify.suggest import ClassifySuggest, Held, Squares, kinds, suggested
from algorithms.classify.train import ClassifyTrain
from tests.scenes.parks import NAMES, QUICK, UTM, yard
from toolbox.data import PointCloud, Table, Vector
from toolbox.errors import DataError


@pytest.fixture(scope="module")
def model() -> Any:
    return ClassifyTrain(points=yard(1), features=NAMES, **QUICK).run().model


def test_patches_are_uncertain_and_of_all_kinds(model: Table) -> None:
    cloud = yard()
    job: dict[str, Any] = {"points": cloud, "wanted": 8}
    out = ClassifySuggest(**job, model=model).run()
    frame = out.patches.frame
    assert len(frame) == 8
    assert (frame.geometry.area == 25).all()
    assert frame["rank"].tolist() == list(range(1, 9))
    assert 100 * frame["uncertainty"].mean() > 2 * out.uncertainty
    blind = ClassifySuggest(**job).run()
    inside = shapely.contains_xy(blind.patches.frame.union_all(), *cloud.xyz[:, :2].T)
    assert set(np.unique(cloud["classification"][inside])) == {2, 5, 6}
    assert blind.patches.frame["uncertainty"].isna().all()
    assert blind.uncertainty is None


def test_what_is_labelled_is_not_suggested_again(model: Table) -> None:
    job: dict[str, Any] = {"points": yard(), "model": model, "wanted": 10}
    first = ClassifySuggest(**job).run().patches
    second = ClassifySuggest(**job, labelled=first).run().patches
    assert len(second.frame) == 10
    assert first.frame.union_all().intersection(second.frame.union_all()).area == 0


def test_the_order_of_the_points_does_not_matter(model: Table) -> None:
    cloud = yard()
    turned = cloud.select(np.random.default_rng(0).permutation(len(cloud)))
    one, other = (ClassifySuggest(points=c, model=model).run().patches for c in (cloud, turned))
    assert one.frame.geometry.geom_equals(other.frame.geometry).all()


def test_kinds_do_not_depend_on_the_order_of_points_in_one_place() -> None:
    rng = np.random.default_rng(0)
    xyz, data = np.repeat(rng.random((15_000, 3)), 2, axis=0), rng.random((30_000, 2), np.float32)
    order = rng.permutation(len(xyz))
    np.testing.assert_array_equal(kinds(xyz, data, 0)[order], kinds(xyz[order], data[order], 0))


def test_no_kind_is_taken_twice_before_all_are() -> None:
    cells = np.repeat(np.arange(6), [9, 9, 9, 4, 4, 4])
    squares = Squares.of(5.0 * np.column_stack([cells, np.zeros(len(cells))]), 5.0)
    kind = np.array([0, 0, 1, 1, 2, 2])[cells]
    held = Held.of(squares, kind, np.ones((len(cells), 1)))
    none, free = np.zeros(6, bool), np.ones(6, bool)
    assert suggested(held, none, free, 3).tolist() == [0, 2, 4]
    assert suggested(held, np.arange(6) == 2, np.arange(6) != 2, 3).tolist() == [0, 4, 1]
    assert suggested(held, none, np.arange(6) > 3, 8).tolist() == [4, 5]


def test_kinds_count_by_how_unsure_the_model_is_of_their_points() -> None:
    squares = Squares.of(np.array([[1.0, 1], [2, 1], [7, 1], [8, 1]]), 5.0)
    kind, half, sure = np.array([0, 0, 1, 1]), [0.5, 0.5], [1.0, 0.0]
    held = Held.of(squares, kind, np.array([sure, half, half, half]))
    np.testing.assert_allclose(held.weight[:3], np.log(2) * np.array([1, 2, 0]))
    assert suggested(held, np.zeros(2, bool), np.ones(2, bool), 1).tolist() == [1]


def test_a_kind_of_which_much_is_labelled_tells_little() -> None:
    held = Held(np.array([0, 1]), np.array([0, 1]), np.array([3, 3]), np.array([2.0, 1.0]), 2)
    np.testing.assert_allclose(held.added(np.array([0.0, 0.0])), np.log(4) * np.array([2, 1]))
    np.testing.assert_allclose(held.added(np.array([96.0, 0.0])), [2 * np.log(100 / 97), np.log(4)])


def test_unlike_points_are_of_other_kinds() -> None:
    rng = np.random.default_rng(0)
    data = rng.random((3000, 3)).astype(np.float32)
    data[::2, 0] += 50
    data[5, 1] = np.nan
    found = kinds(rng.random((3000, 3)), data, 0)
    assert not set(found[::2]) & set(found[1::2])
    assert len(set(found)) == 100
    assert kinds(rng.random((7, 3)), data[:7], 0).max() < 7


def test_squares_hold_means() -> None:
    squares = Squares.of(np.array([[0.5, 0.5], [1.5, 0.5], [7.0, 0.5]]), 5.0)
    assert squares.count.tolist() == [2, 1]
    assert squares.low.tolist() == [[0, 0], [5, 0]]
    assert squares.mean(np.array([[1.0], [3.0], [9.0]])).ravel().tolist() == [2, 9]


def test_what_cannot_be(model: Table) -> None:
    far = geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)], crs=3035)
    with pytest.raises(DataError, match="labelled: "):
        ClassifySuggest(points=yard(), labelled=Vector(far, name="a.gpkg"))
    plain = PointCloud(yard().xyz, {}, crs=UTM)
    with pytest.raises(DataError, match="points: 'intensity' is no attribute"):
        ClassifySuggest(points=plain, model=model)
