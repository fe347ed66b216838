"""classify.som: known scenes, steps by hand, bad input."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

import toolbox
from algorithms.classify import _evidence, _som
from algorithms.classify._feature_map import FeatureMap, named
from algorithms.classify.som import ClassifySom, drawn, growing
from tests.scenes.parks import UTM, accuracy, park
from toolbox.data import PointCloud
from toolbox.declare import Attribute, ClassList
from toolbox.errors import DataError, ParameterError

Floats = NDArray[np.float64]


# The map ---------------------------------------------------------------------------------


def test_lattices() -> None:
    """Inner neurons have six neighbours on a hexagonal lattice, and four on a square one."""
    for shape, most in (("hexagonal", 6), ("square", 4)):
        away = _som.distances(_som.places(4, 5, shape))  # type: ignore[arg-type]
        beside = (away > 0) & (away <= _som.TOUCHING)
        assert beside.sum(axis=1).max() == most
        assert away[beside] == pytest.approx(1)


def test_the_online_rule_by_hand() -> None:
    """Two neurons at 0 and 1, radius 1, rate 0.5; the points 0.2 and then 1.0 (or the reverse).

    A neuron beside the winner follows with 0.5 exp(-1 / 2) = 0.303265. From 0.2: 0 becomes 0.1,
    1 becomes 0.757388; then from 1.0: 0.878694 and 0.372939.
    """
    how = _som.Training(
        iterations=1, method="online", start=1.0, final=1.0, rate=0.5, final_rate=0.5
    )
    data = np.array([[0.2], [1.0]])
    away = _som.distances(_som.places(1, 2, "square"))
    pull = how.learning_rate(0) * how.pull(away, 0)
    np.testing.assert_allclose(pull, [[0.5, 0.30326533], [0.30326533, 0.5]], rtol=1e-8)
    weights = np.array([[0.0, 1.0]])
    _som.kernels.learn(np.array([0, 1]), data, pull, weights)
    np.testing.assert_allclose(weights, [[0.37293880, 0.87869387]], rtol=1e-7)
    one, other = _som._online(data, np.array([[0.0], [1.0]]), away, how, _som.QUIET).ravel()
    reverse = np.array([[0.0, 1.0]])
    _som.kernels.learn(np.array([1, 0]), data, pull, reverse)
    assert (one, other) in [tuple(weights[0]), tuple(reverse[0])]


def test_one_pass_of_the_batch_rule_by_hand() -> None:
    """Neurons become the means of all points, weighted by the neighbourhood of their winners."""
    data = np.array([[0.0], [0.1], [0.9], [1.0], [1.0]])
    place = _som.places(1, 2, "square")
    how = _som.Training(iterations=1, start=0.5, final=0.5)
    h = np.exp(-1 / (2 * 0.25))
    first = (0.1 + h * 2.9) / (2 + 3 * h)
    second = (2.9 + h * 0.1) / (3 + 2 * h)
    found = np.sort(_som.train(data, place, how).ravel())
    np.testing.assert_allclose(found, [first, second], atol=1e-6)


@pytest.mark.parametrize(("kind", "middle"), [("gaussian", np.exp(-0.5)), ("linear", 0.5)])
def test_neighbourhoods_shrink(kind: Any, middle: float) -> None:
    how = _som.Training(iterations=11, neighbourhood=kind, start=2.0, final=0.5)
    away = np.array([[0.0, 1.0, 2.0]])
    np.testing.assert_allclose(how.pull(away, 0)[0, 2], middle, rtol=1e-12)
    shares = [how.pull(away, step)[0, 1] for step in range(11)]
    assert shares == sorted(shares, reverse=True)
    np.testing.assert_allclose(how.pull(away, 10)[0, 1], 0 if kind == "linear" else np.exp(-2.0))


def plain_batch(data: Floats, place: Floats, how: _som.Training, weights: Floats) -> Floats:
    """The batch rule without bounds and whole numbers."""
    away = _som.distances(place)
    for step in range(how.iterations):
        best = np.linalg.norm(data[:, None] - weights, axis=2).argmin(axis=1)
        pull = how.pull(away, step)[:, best]
        weights = pull @ data / pull.sum(axis=1)[:, None]
    return weights


def test_bounds_and_whole_numbers_change_nothing() -> None:
    rng = np.random.default_rng(0)
    data = rng.random((800, 4)) * [1, 1, 10, 10]
    place, how = _som.places(3, 4, "hexagonal"), _som.Training(iterations=40)
    fine = _som.FINE / 16
    start = _som.spread_out(np.rint(data * fine).astype(np.int64), place) / fine
    wanted = plain_batch(data, place, how, start)
    np.testing.assert_allclose(_som.train(data, place, how), wanted, atol=1e-5)


@pytest.mark.parametrize("method", ["batch", "online"])
def test_same_map_for_any_order_and_number_of_threads(
    method: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_som, "PER_POINT", 10_000)  # many short runs, side by side
    rng = np.random.default_rng(0)
    data = np.vstack([rng.random((900, 3)), rng.random((3, 3)).repeat(30, axis=0)])
    place, how = _som.places(2, 3, "hexagonal"), _som.Training(iterations=20, method=method)
    first = _som.train(data, place, how)
    np.testing.assert_array_equal(_som.train(data[rng.permutation(len(data))], place, how), first)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        np.testing.assert_array_equal(_som.train(data, place, how), first)
    finally:
        numba.set_num_threads(threads)


def test_both_rules_unfold_the_map_over_a_square() -> None:
    """Neighbours on the lattice stand for neighbouring points, and the errors are small."""
    data = np.random.default_rng(0).random((3000, 2))
    place = _som.places(6, 6, "square")
    for method in ("batch", "online"):
        how = _som.Training(iterations=60, method=method)  # type: ignore[arg-type]
        weights = _som.train(data, place, how)
        found = _som.winners(data, weights)
        assert _som.quantisation_error(found) < 0.075
        assert _som.topographic_error(found, place) < 0.12


def test_u_matrix_shows_the_gap() -> None:
    weights = np.array([[0.0], [0.1], [5.0], [5.1]])
    heights = _som.u_matrix(weights, _som.places(1, 4, "square"))
    np.testing.assert_allclose(heights, [0.1, 2.5, 2.5, 0.1])


# The tool --------------------------------------------------------------------------------


def test_clusters_of_a_park_are_named_without_labels(trained: ClassifySom.Outputs) -> None:
    assert accuracy(trained.classified) > 0.97
    assert trained.astray < 0.03
    assert trained.unclassified == 0
    assert set(np.unique(trained.classified["classification"])) == {2, 5, 6}
    assert trained.classified["confidence"].min() > 0.5


def test_without_returns_planes_alone_tell_roofs_from_trees() -> None:
    cloud = park()
    ones = np.ones(len(cloud), np.uint8)
    cloud = cloud.with_attributes({"return_number": ones, "number_of_returns": ones})
    out = ClassifySom(points=cloud).run()
    assert accuracy(out.classified) > 0.95
    assert "returns" not in out.map.frame.columns


def test_features_and_weights_of_the_study(trained: ClassifySom.Outputs) -> None:
    """x, y, z, intensity; z and intensity count ten times as much; min-max normalisation."""
    features = ("x", "y", "z", "intensity")
    out = ClassifySom(points=park(), features=features, lattice="square").run()
    row = out.map.rows()[0]
    assert [row[f"{name}_weight"] for name in features] == [1, 1, 10, 10]
    made, z = FeatureMap.of(out.map), park()["z"]
    assert (row["z_low"], row["z_high"]) == (z.min(), z.max())
    values = np.column_stack([park()[name] for name in features])
    scaled = made.comparable(values)
    np.testing.assert_allclose(scaled.min(axis=0), 0)
    np.testing.assert_allclose(scaled.max(axis=0), [1, 1, 10, 10])
    assert accuracy(out.classified) > 0.75


def test_few_labelled_points_name_the_clusters() -> None:
    """Classes may be any; here bridge, tower and ground on a twentieth of the points."""
    cloud = park()
    some = np.random.default_rng(1).random(len(cloud)) < 0.05
    other = np.choose(cloud["truth"] // 2 - 1, [2, 15, 17])
    cloud = cloud.with_attributes({"known": np.where(some, other, 0).astype(np.uint8)})
    out = ClassifySom(points=cloud, labels=Attribute("known")).run()
    assert np.mean(out.classified["classification"] == other) > 0.97


def test_the_map_grows_until_the_tolerance_is_met() -> None:
    assert [*growing(4, 5)] == [(1, 2), (1, 3), (2, 3), (2, 4), (3, 4), (3, 5), (4, 5)]
    assert [*growing(3, 1)] == [(2, 1), (3, 1)]
    assert [*growing(1, 4)] == [(1, 2), (1, 3), (1, 4)]
    labels = Attribute("truth")
    how: dict[str, Any] = {"points": park(), "labels": labels, "search": True, "parts": 1}
    loose = ClassifySom(**how, max_impurity=0.5).run()
    close = ClassifySom(**how, max_impurity=0.05).run()
    assert loose.neurons == 2
    assert loose.neurons < close.neurons < 20
    assert close.astray <= 0.05
    sizes = close.sizes.rows()
    assert [(row["rows"], row["columns"]) for row in sizes[:3]] == [(1, 2), (1, 3), (2, 3)]
    assert sizes[-1]["neurons"] == close.neurons
    assert [row["worst_cluster"] <= 0.05 for row in sizes] == [False] * (len(sizes) - 1) + [True]
    for row in sizes:
        assert row["filtering_error"] <= row["astray"] <= row["worst_cluster"] + 1e-9


def test_a_map_that_begins_with_random_weights_ends_near_the_other() -> None:
    """The seed decides; the order of the points does not."""
    cloud = park()
    backwards = cloud.select(np.arange(len(cloud))[::-1])
    plane = ClassifySom(points=cloud).run()
    first, again, other = (
        ClassifySom(points=points, initial="random", seed=seed).run()
        for points, seed in [(cloud, 1), (backwards, 1), (cloud, 2)]
    )
    assert first.map.rows() == again.map.rows()
    assert first.map.rows() != other.map.rows()
    assert first.quantisation_error == pytest.approx(plane.quantisation_error, rel=0.5)


def test_mixed_clusters_are_split() -> None:
    """A map of two neurons cannot hold three classes; its second stage can."""
    how: dict[str, Any] = {"points": park(), "rows": 1, "columns": 2, "max_impurity": 0.05}
    plain, better = ClassifySom(**how, parts=1).run(), ClassifySom(**how, parts=3).run()
    assert plain.neurons == 2
    assert better.neurons > 3
    assert better.astray < plain.astray
    parents = better.map.frame["parent"]
    assert parents.notna().sum() in (3, 6)
    leaves = set(range(len(parents))) - set(parents.dropna())
    assert set(better.classified["neuron"]) == leaves
    assert accuracy(better.classified) > accuracy(plain.classified)


def test_a_neuron_without_known_points_takes_the_nearest_class() -> None:
    weights = np.array([[0.0], [0.4], [1.0]])
    nothing = np.zeros(3, np.int64)
    ones = np.ones(1)
    made = FeatureMap(
        *(("z",), 0 * ones, ones, ones, weights, weights.repeat(2, axis=1), nothing - 1),
        *(nothing.astype(np.uint8), nothing, np.zeros(3), 1.0, 3.0),
    )
    best, known = np.array([0, 0, 0, 1, 2]), np.array([5, 5, 6, 0, 2], np.uint8)
    found = named(made, best, known)
    assert found.classes.tolist() == [5, 5, 2]
    np.testing.assert_allclose(found.astray, [1 / 3, 0, 0])
    assert found.points.tolist() == [3, 1, 1]


def test_pictures_of_the_map(trained: ClassifySom.Outputs) -> None:
    """One picture for the U-matrix and each feature, of as many colours as there are neurons."""
    values = trained.planes.band()
    width = values.shape[1] / 6
    for k in range(6):
        panel = values[:, round(k * width) : round((k + 1) * width)]
        shown = np.unique(panel[np.isfinite(panel)])
        assert 2 <= len(shown) <= 20
        assert (shown.min(), shown.max()) == (0, 1)


def test_pictures_of_a_large_map_need_little_memory() -> None:
    place = _som.places(40, 40, "hexagonal")
    many, one = np.zeros(len(place)), np.ones(2)
    made = FeatureMap(
        *(("z", "intensity"), 0 * one, one, one, place / 40, place),
        *(np.full(len(place), -1), many.astype("u1"), many.astype(int), many, 1.0, 3.0),
    )
    tracemalloc.start()
    table, picture = made.table(), made.planes()
    used = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert used < 200e6
    assert len(table.frame) == 1600
    assert len(np.unique(picture.band()[:, 420:820])) > 40


def test_a_sample_depends_on_places_alone() -> None:
    xyz = park().xyz
    some = drawn(xyz, 500, seed=1)
    assert len(some) == 500
    order = np.random.default_rng(0).permutation(len(xyz))
    again = drawn(xyz[order], 500, seed=1)
    assert set(order[again]) == set(some)
    assert set(drawn(xyz, 500, seed=2)) != set(some)
    out = ClassifySom(points=park(), sample=4000).run()
    assert accuracy(out.classified) > 0.96


def test_what_is_around_counts_cells_within_reach() -> None:
    """Four points in a row of cells; the group of the third is another."""
    xyz = np.array([[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [2.5, 0.5, 0.5], [2.6, 0.5, 0.5]])
    group = np.array([False, False, True, False])
    values = np.array([[0.0], [1.0], [5.0], [0.5]])
    near = _evidence.means_around(xyz - 7.0, group, values, 1.0)
    np.testing.assert_allclose(near.ravel(), [0.5, 0.5, 5.0, 0.75])
    far = _evidence.means_around(xyz, group, values, 2.0)
    np.testing.assert_allclose(far.ravel(), [0.5, 0.5, 5.0, 0.5])


@pytest.mark.parametrize("reach", [1.0, 2.5, 3.0])
def test_what_is_around_is_as_counted_cell_by_cell(reach: float) -> None:
    rng = np.random.default_rng(0)
    xyz, group = rng.uniform(0, (12, 9, 7), (800, 3)), rng.random(800) < 0.4
    values, cell = rng.random((800, 2)), np.floor(xyz)
    away = ((cell[:, None] - cell) ** 2).sum(axis=2)
    near = (away <= reach**2) & (group[:, None] == group)
    means = (near @ values) / near.sum(axis=1)[:, None]
    np.testing.assert_allclose(_evidence.means_around(xyz, group, values, reach), means, atol=1e-6)


# Bad input -------------------------------------------------------------------------------


def bare(n: int = 300, **attributes: Any) -> PointCloud:
    cloud = park(n)
    return PointCloud(cloud.xyz, attributes, crs=UTM, name="bare.laz")


def test_features_that_the_points_lack() -> None:
    with pytest.raises(DataError, match=r"features: 'intensty' is no attribute.*intensity"):
        ClassifySom(points=park(50), features=("intensty",))
    with pytest.raises(DataError, match="returns needs the attributes return_number"):
        ClassifySom(points=bare(), features=("z", "returns"))
    out = ClassifySom(points=bare(3000)).run()
    assert {"ground", "planarity"} <= set(out.map.frame.columns)
    assert "intensity" not in out.map.frame.columns


def test_a_constant_feature_tells_nothing(caplog: pytest.LogCaptureFixture) -> None:
    cloud = bare(2000, intensity=np.full(2000, 7, np.uint16))
    out = ClassifySom(points=cloud, features=("z", "intensity")).run()
    assert "feature intensity is the same at all points" in caplog.text
    alone = ClassifySom(points=cloud, features=("z",)).run()
    np.testing.assert_array_equal(
        out.classified["classification"], alone.classified["classification"]
    )


def test_fewer_points_than_neurons() -> None:
    with pytest.raises(DataError, match="15 are fewer than the 20 neurons"):
        ClassifySom(points=park(15)).run()


def test_points_without_a_feature_become_class_1(caplog: pytest.LogCaptureFixture) -> None:
    intensity = np.random.default_rng(0).uniform(1, 9, 3000)
    intensity[:40] = np.nan
    out = ClassifySom(points=bare(3000, intensity=intensity), features=("z", "intensity")).run()
    assert out.unclassified == 40
    assert (out.classified["classification"][:40] == 1).all()
    assert (out.classified["neuron"][:40] == -1).all()
    assert "40 of 3000 points lack a feature" in caplog.text
    nothing = bare(300, intensity=np.full(300, np.nan))
    with pytest.raises(DataError, match="none has all the features; most lack intensity"):
        ClassifySom(points=nothing, features=("z", "intensity")).run()


def test_ignored_points_stay_as_they_are() -> None:
    cloud = park(6000)
    classes = np.where(np.arange(6000) < 100, 18, 1).astype(np.uint8)
    cloud = cloud.with_attributes({"classification": classes})
    out = ClassifySom(points=cloud, ignore=ClassList([18])).run()
    assert (out.classified["classification"][:100] == 18).all()
    rest = ClassifySom(points=cloud.select(np.arange(100, 6000))).run()
    np.testing.assert_array_equal(
        out.classified["classification"][100:], rest.classified["classification"]
    )


def test_settings_that_cannot_be() -> None:
    points = park(50)
    for settings, text in [
        ({"features": ("z", "z")}, "a name is given twice"),
        ({"features": ()}, "features: give at least one name"),
        ({"weights": (1.0,)}, "weights: name features, too"),
        ({"features": ("z",), "weights": (1.0, 2.0)}, "weights: give one for each of 1 features"),
        ({"rows": 1, "columns": 1}, "columns: a map needs at least two neurons"),
    ]:
        with pytest.raises(ParameterError, match=text):
            ClassifySom(points=points, **settings)  # type: ignore[arg-type]


def test_labels_must_be_classes() -> None:
    for values in (np.zeros(300), np.full(300, 2.5), np.full(300, 300.0)):
        cloud = park(300).with_attributes({"known": values})
        with pytest.raises(DataError, match="known must hold classes from 0 to 255"):
            ClassifySom(points=cloud, labels=Attribute("known"), features=("z",)).run()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tiles", "least"),
    [(("77050_627755", "77055_627755", "77060_627760"), 0.94), (("77060_627760",), 0.92)],
)
def test_real_towns(data: Any, tiles: tuple[str, ...], least: float) -> None:
    """Three classes of real tiles, without labels: the figures of the explanation."""
    paths = [str(data(f"ign_urban_50m/{tile}.laz")) for tile in tiles]
    cloud = PointCloud.concat([PointCloud.open(path) for path in paths])
    found = toolbox.run("classify.som", {"points": cloud})["classified"]["classification"]
    truth = np.where(np.isin(cloud["classification"], (3, 4)), 5, cloud["classification"])
    known = np.isin(truth, (2, 5, 6))
    assert np.mean(found[known] == truth[known]) > least
    assert np.mean((found == 2)[known] != (truth == 2)[known]) < 0.03
