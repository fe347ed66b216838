"""classify.suggest: uncertain patches, of all kinds, none twice."""

from __future__ import annotations

from typing import Any

import geopandas
import numpy as np
import pytest
import shapely

from algorithms.classify.suggest import ClassifySuggest, Squares, suggested
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
    assert frame["uncertainty"].is_monotonic_decreasing
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


def test_the_most_uncertain_compete_by_variety() -> None:
    like = np.repeat(np.array([[0.0], [5.0], [9.0]]), 10, axis=0)
    doubt = np.linspace(0.9, 0.1, 30)
    chosen = suggested(like, doubt, np.ones(30, bool), 3, 0)
    assert sorted(like[chosen, 0].tolist()) == [0, 5, 9]
    free = np.arange(30) < 5
    assert set(suggested(like, doubt, free, 8, 0).tolist()) == {0, 1, 2, 3, 4}


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
