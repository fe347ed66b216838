"""points.denoise: planted noise, real outliers, and wires that must stay."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS
from scenes.layers import cloud
from scipy.spatial import cKDTree

from algorithms.points.denoise import HIGH, LOW, PointsDenoise, cut_off, main_layer, noise
from toolbox.data import PointCloud
from toolbox.data.crs import parse_crs
from toolbox.declare import ClassList
from toolbox.errors import DataError, NothingToDo, ParameterError

Floats = NDArray[np.float64]


def terrain(side: float = 60.0, density: float = 2.0, seed: int = 0) -> Floats:
    """A rough slope."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, side, (2, int(density * side * side)))
    return np.column_stack([x, y, 0.2 * x + rng.normal(0, 0.05, len(x))])


PLANTED = np.array([[20, 20, 14], [40, 30, 300], [30, 40, -4], [10, 50, -250.0]])


def test_single_points_in_the_air_and_below_ground() -> None:
    found = noise(np.vstack([terrain(), PLANTED]))
    assert list(found[-4:]) == [HIGH, HIGH, LOW, LOW]
    assert not found[:-4].any()


@pytest.mark.parametrize("members", [2, 3, 12, 60])
def test_groups_far_away_are_noise_of_any_size(members: int) -> None:
    """More of them than neighbours, so that only the empty height below tells."""
    rng = np.random.default_rng(1)
    group = rng.normal([30, 30, 500], 1.0, (members, 3))
    found = noise(np.vstack([terrain(), group]))
    assert (found[-members:] == HIGH).all()
    assert not found[:-members].any()


@pytest.mark.parametrize("members", [2, 3])
def test_pairs_and_triples_below_the_ground(members: int) -> None:
    """As from multipath: each has the others near by."""
    group = [30, 30, -6] + np.arange(3.0 * members).reshape(members, 3) / 10
    assert (noise(np.vstack([terrain(), group]))[-members:] == LOW).all()


def wires() -> Floats:
    """A wire with a point every 2 m, 7 m above one with 20 points per metre, over the terrain."""
    upper = np.column_stack([np.arange(0, 60, 2.0), np.full((30, 2), [30, 40.0])])
    lower = np.column_stack([np.arange(0, 60, 0.05), np.full((1200, 2), [30, 33.0])])
    return np.vstack([upper, lower])


def test_wires_stay_even_sparse_ones_above_dense_ones() -> None:
    xyz = np.vstack([terrain(), wires()])
    assert not noise(xyz).any()
    found = noise(np.vstack([xyz, PLANTED]))
    assert list(found[-4:]) == [HIGH, HIGH, LOW, LOW]


def test_clumps_make_no_noise_of_their_neighbours() -> None:
    """As where a scan line turns: 25 points within 0.1 m, and the next 1.3 m away."""
    rng = np.random.default_rng(6)
    x, y = (g.ravel() for g in np.meshgrid(np.arange(0, 40, 1.3), np.arange(0, 40, 1.3)))
    even = np.column_stack([x, y, rng.normal(0, 0.02, len(x))])
    clumps = np.repeat(even[100::40], 25, axis=0)
    xyz = np.vstack([even, clumps + rng.normal(0, 0.03, clumps.shape)])
    assert not noise(xyz).any()


def test_density_may_change_a_thousandfold() -> None:
    """Sparse terrain beside dense: nothing is noise, and planted points are found in both."""
    sparse, dense = terrain(400, 0.2), terrain(12, 300, seed=1) + np.array([500, 0, 100])
    near = np.column_stack([np.arange(50, 53), np.full((3, 2), [50, 42.0])])
    planted = np.array([[200.0, 200, 70], [506, 6, 103.5]])
    found = noise(np.vstack([sparse, dense, near, planted]))
    assert (found[-2:] == HIGH).all()
    assert found[: len(sparse) + len(dense)].mean() < 2e-4


def test_density_of_a_single_station_falls_off() -> None:
    """A floor seen from 2 m above its middle: spacing grows with the square of the distance."""
    angle, distance = np.meshgrid(np.arange(0, 360, 0.5), np.geomspace(0.05, 40, 400))
    radius, phi = distance.ravel(), np.radians(angle.ravel())
    jitter = np.random.default_rng(0).normal(0, 0.002, len(phi))
    floor = np.column_stack([radius * np.cos(phi), radius * np.sin(phi), jitter])
    found = noise(np.vstack([floor, [[1.0, 1.0, 0.5], [20, 20, 4.0]]]), plant_height=0.0)
    assert (found[-2:] == HIGH).all()
    assert found[:-2].mean() < 1e-3


def test_a_stray_point_far_away_is_noise_and_costs_nothing() -> None:
    found = noise(np.vstack([terrain(), [[2e5, 2e5, 0.0]]]), height_gap=1.0)
    assert found[-1] > 0
    assert not found[:-1].any()


def test_classic_scope_is_the_published_method() -> None:
    rng = np.random.default_rng(2)
    xyz = np.vstack([terrain(20), rng.uniform(-5, 25, (40, 3))])
    mean = np.asarray(cKDTree(xyz).query(xyz, 9)[0])[:, 1:].mean(axis=1)
    wanted = mean > mean.mean() + 1.5 * mean.std(ddof=1)
    found = noise(xyz, neighbours=8, threshold=1.5, scope="classic", height_gap=None)
    np.testing.assert_array_equal(found > 0, wanted)
    middle = np.median(mean)
    wanted = mean > middle + 4 * 1.4826 * np.median(abs(mean - middle))
    found = noise(xyz, neighbours=8, threshold=4, scope="global", height_gap=None)
    np.testing.assert_array_equal(found > 0, wanted)


def test_gross_outliers_hide_others_from_the_classic_scope_only() -> None:
    """The reason for medians: one point far away makes the standard deviation useless."""
    xyz = np.vstack([terrain(), PLANTED[:1], [[0, 0, 9e4]]])
    for scope, seen in (("classic", False), ("global", True), ("local", True)):
        found = noise(xyz, scope=scope, height_gap=None)  # type: ignore[arg-type]
        assert bool(found[-2]) == seen, scope
        assert found[-1] == HIGH


@pytest.mark.parametrize("scope", ["local", "global", "classic"])
def test_hardly_any_points(scope: Any) -> None:
    for n in range(4):
        found = noise(np.arange(3.0 * n).reshape(n, 3), scope=scope)
        assert found.shape == (n,)
        assert not found.any() or scope == "local"


@pytest.mark.parametrize(
    "xyz",
    [
        np.zeros((50, 3)),
        np.arange(150.0).reshape(50, 3) / 10,
        np.linspace(0, 3, 150).reshape(-1, 1) * [0, 0, 1],
        terrain(20) + np.array([5e6, 5e6, 0]),
    ],
    ids=["one place", "on a line", "upright", "far from the origin"],
)
def test_shapes_that_are_no_noise(xyz: Floats) -> None:
    assert not noise(xyz).any()


def test_main_layer() -> None:
    assert main_layer(np.array([5, 6, 7, 200, 201, -300.0]), 100) == (5, 7)
    assert main_layer(np.array([5, 6, 200, 201.0]), 100) == (5, 6)
    assert main_layer(np.array([5, 90, 170.0]), 100) == (5, 170)


def test_order_and_threads_make_no_difference() -> None:
    xyz = np.vstack([terrain(), wires(), PLANTED])
    whole, order = noise(xyz), np.random.default_rng(3).permutation(len(xyz))
    np.testing.assert_array_equal(noise(xyz[order]), whole[order])
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        np.testing.assert_array_equal(noise(xyz), whole)
    finally:
        numba.set_num_threads(threads)


def chain() -> Floats:
    """Whether the first point is noise depends on others more than twice the reach (10 m) away.

    Its only neighbour is in the air if there is ground in the next cell but one.
    """
    ground = np.column_stack([np.linspace(27, 29.5, 12), np.zeros((12, 2))])
    return np.vstack([[[0.2, 0, 50], [10.1, 0, 50]], ground])


@pytest.mark.parametrize(("xyz", "width"), [(chain(), 1.0), (terrain(120, 0.5), 30.0)])
def test_tiles_equal_the_whole_and_need_their_halo(xyz: Floats, width: float) -> None:
    rng = np.random.default_rng(4)
    if len(xyz) > 100:
        xyz = np.vstack([xyz, rng.uniform([0, 0, 0], [120, 120, 40], (600, 3))])
    settings: dict[str, Any] = {"reach": 10.0, "height_gap": 20.0, "min_neighbours": 1}
    settings |= {"neighbours": 4, "threshold": 1.0}
    whole = noise(xyz, **settings)
    job = PointsDenoise(points=cloud(xyz), **settings)
    assert job.halo() == 40

    def differences(halo: float) -> int:
        total = 0
        for west in np.arange(0, 120, width):
            core = (xyz[:, 0] >= west) & (xyz[:, 0] < west + width)
            if core.any():
                tile = (xyz[:, 0] >= west - halo) & (xyz[:, 0] < west + width + halo)
                total += int((noise(xyz[tile], **settings) != whole[tile])[core[tile]].sum())
        return total

    assert whole.any()
    assert differences(job.halo()) == 0
    assert differences(job.halo() / 2 if len(xyz) < 100 else 0.0) > 0


def test_remove_and_label() -> None:
    xyz = np.vstack([terrain(), PLANTED])
    points = cloud(xyz, classification=np.full(len(xyz), 2, np.uint8))
    out = PointsDenoise(points=points).run()
    assert (out.low_noise, out.high_noise) == (2, 2)
    np.testing.assert_array_equal(out.clean.xyz, xyz[:-4])
    out = PointsDenoise(points=points, action="label").run()
    assert list(out.clean["classification"][-5:]) == [2, HIGH, HIGH, LOW, LOW]
    bare = PointsDenoise(points=cloud(xyz), action="label").run().clean
    assert list(bare["classification"][-5:]) == [0, HIGH, HIGH, LOW, LOW]


def test_ignored_and_withheld_points_take_no_part() -> None:
    """They stay, and nobody has them as neighbours: a point among them alone is noise."""
    aside = np.array([30, 30, 60]) + np.random.default_rng(5).normal(0, 0.5, (40, 3))
    xyz = np.vstack([terrain(), aside, [[30, 30, 60.0]]])
    flagged = np.zeros(len(xyz), np.uint8)
    flagged[-41:-1] = 1
    for points, ignore in (
        (cloud(xyz, withheld=flagged), None),
        (cloud(xyz, classification=14 * flagged), ClassList([14])),
    ):
        out = PointsDenoise(points=points, ignore=ignore, action="label").run()
        assert out.high_noise == 1
        assert out.clean["classification"][-1] == HIGH
        assert not (out.clean["classification"][:-1] == HIGH).any()
    assert not noise(xyz).any()


def test_feet() -> None:
    foot = 1200 / 3937
    xyz = np.vstack([terrain(), PLANTED])
    out = PointsDenoise(points=PointCloud(xyz / foot, crs=CRS(2263))).run()
    assert (out.low_noise, out.high_noise) == (2, 2)


def test_bad_input(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(ParameterError, match=r"min_neighbours: must be <= neighbours \(4\), got 6"):
        PointsDenoise(points=cloud(terrain(5)), neighbours=4)
    with pytest.raises(ValueError, match="finite numbers, got z = nan at point 1"):
        noise(np.array([[0, 0, 0], [0, 0, np.nan]]))


@pytest.mark.parametrize("crs", [CRS(32635), CRS(2263)])
def test_more_noise_than_can_be_is_told_with_what_to_do(
    crs: CRS, caplog: pytest.LogCaptureFixture
) -> None:
    sparse = PointCloud(terrain() * [100, 100, 1] * (1 if crs == CRS(32635) else 3.28), crs=crs)
    PointsDenoise(points=sparse).run()
    assert "7200 of 7200 points (100 %) are called noise, and no survey has more than 1 %" in (
        caplog.text
    )
    (reach,) = map(int, re.findall(r"too sparse for reach: set it to (\d+) m", caplog.text))
    caplog.clear()
    out = PointsDenoise(points=sparse, reach=float(reach)).run()
    assert len(out.clean) >= 0.999 * len(sparse)
    assert not caplog.text
    noisy = np.vstack([terrain(), np.random.default_rng(0).uniform(0, [60, 60, 90], (80, 3))])
    PointsDenoise(points=cloud(noisy), scope="global").run()
    assert "look at them with action label, and raise threshold" in caplog.text
    caplog.clear()
    PointsDenoise(points=cloud(np.vstack([terrain(), PLANTED]))).run()
    assert not caplog.text


def test_plants_over_a_meadow_stay_and_what_lies_below_it_does_not() -> None:
    """Stems that single pulses hit, over ground of 100 points per square metre."""
    rng = np.random.default_rng(0)
    ground = rng.uniform(0, [20, 20, 0.05], (40_000, 3))
    plants = rng.uniform([1, 1, 0.4], [19, 19, 1.6], (150, 3))
    planted = np.array([[5, 5, 8.0], [15, 8, 9], [10, 15, -1.5], [4, 12, -3]])
    found = noise(np.vstack([ground, plants, planted]))
    assert not found[:-4].any()
    assert list(found[-4:]) == [HIGH, HIGH, LOW, LOW]
    bare = noise(np.vstack([ground, plants, planted]), plant_height=0.0)
    assert (bare[40_000:-4] == HIGH).mean() > 0.5


CLEAN = [  # of AHN, IGN, ISPRS and others; their few gross errors are among what may be found
    "ahn3_delft_bgt/ahn3_cropped_2.laz",
    "ahn_amsterdam/ahn3_2386_9702.laz",
    "ign_urban_50m/77055_627755.laz",
    "ign_urban_50m/77060_627760.laz",
    "isprs_samples_labelled_laz/samp31_first_last_intensity.laz",
    "isprs_samples_labelled_laz/samp42_first_last_intensity.laz",
    "lidr_topography/MixedConifer.laz",
]


@pytest.mark.parametrize("name", CLEAN)
def test_hardly_any_real_point_is_noise(name: str, data: Callable[[str], Path]) -> None:
    assert (noise(PointCloud.open(data(name)).xyz) > 0).mean() <= 0.0005


@pytest.mark.parametrize("count", range(1, 9))
def test_a_few_points_are_judged_alone_as_beside_others(count: int) -> None:
    """A tile on a lake gets the labels of the whole; a cloud without neighbours is refused."""
    few = np.array([5000.0, 30, 0]) + np.arange(3.0 * count).reshape(count, 3) / 10
    beside = noise(np.vstack([terrain(), few]))[-count:]
    np.testing.assert_array_equal(noise(few), beside)
    assert (beside > 0).all() == (count < 7)
    job = PointsDenoise(points=cloud(few), action="label")
    if count > 6:
        assert job.run().low_noise == 0
        return
    with pytest.raises(NothingToDo, match=f"points: {count} cannot have 6 neighbours") as caught:
        job.run()
    classes = caught.value.instead.clean["classification"]
    np.testing.assert_array_equal(classes, beside)
    assert caught.value.instead.low_noise == (beside == LOW).sum()


def test_points_that_take_no_part_are_not_counted() -> None:
    few = cloud(np.zeros((9, 3)), classification=[14] * 3 + [1] * 6)
    with pytest.raises(NothingToDo, match="points: 6 cannot have"):
        PointsDenoise(points=few, ignore=ClassList([14])).run()
    none = PointsDenoise(points=few, ignore=ClassList([1, 14])).run()
    assert len(none.clean) == 9


def test_more_cells_than_can_be_numbered() -> None:
    xyz = np.array([[0, 0, 0], [1, 1, 50], [0, 3e9, 0.0]])
    with pytest.raises(DataError, match=r"extend over 3,000,000,000 times reach \(1\)"):
        noise(xyz, reach=1.0, height_gap=10.0)


@pytest.mark.parametrize("west", [-4e9, -1.0, 0.0, 4e9])
def test_cells_are_numbered_wherever_they_lie(west: float) -> None:
    """Two in a cell, one above them at each of two corners, and one two cells away."""
    xyz = np.array([[0.5, 0.5, 0], [0.5, 0.6, 0], [1.5, -0.5, 9], [1.5, 1.5, 9], [-1.5, 0.5, 9]])
    found = cut_off(xyz + np.array([west, -west, 0]), 1.0, 5.0)
    np.testing.assert_array_equal(found, [0, 0, HIGH, HIGH, 0])


@pytest.mark.slow
def test_real_gross_outliers(data: Callable[[str], Path]) -> None:
    """ISPRS site 5: a cloud of 187 first returns at 777 to 899 m, and one point at 123.7 m."""
    points = PointCloud.open(data("isprs_sites/FSite5_orig-utm.laz"))
    found = noise(points.xyz)
    z = points.xyz[:, 2]
    assert (found[(z > 500) | (z < 200)] > 0).all()
    assert (found[z > 500] == HIGH).mean() > 0.99  # below one at the edge there is no ground
    assert (found[z < 200] == LOW).all()
    assert (found > 0).mean() < 0.001


@pytest.mark.parametrize(
    ("sample", "low", "high", "pairs"),
    [("31", 292.25, None, 0), ("23", 270, 400, 0), ("54", 242, 500, 2), ("61", None, 500, 0)],
)
def test_real_low_and_high_points(
    sample: str, low: float | None, high: float | None, pairs: int, data: Callable[[str], Path]
) -> None:
    path = data(f"isprs_samples_labelled_laz/samp{sample}_first_last_intensity.laz")
    points = PointCloud.open(path)
    found, z = noise(points.xyz), points.xyz[:, 2]
    if low:
        assert (found[z < low] == LOW).sum() == (z < low).sum() - pairs  # near each other
    if high:
        assert (found[z > high] == HIGH).all()
    assert (found > 0).mean() < 0.0005


@pytest.mark.slow
@pytest.mark.parametrize("tile", ["12AN2_20", "12BZ1_21"])
def test_power_lines_stay(tile: str, data: Callable[[str], Path]) -> None:
    points = PointCloud.open(data(f"powerline_ahn4/{tile}_as_published.laz"))
    found, classes = noise(points.xyz) > 0, points["classification"]
    assert found[classes == 14].mean() < 0.001
    assert found[classes == 15].mean() < 0.005
    assert found.mean() < 0.0005


def test_the_count_of_noise_is_said_in_words() -> None:
    out = PointsDenoise(points=cloud(np.vstack([terrain(), PLANTED]))).run()
    assert out.in_words() == "4 points were taken for noise: 2 low, 2 high."
    assert PointsDenoise(points=cloud(terrain())).run().in_words() == (
        "No point was taken for noise."
    )


@pytest.mark.parametrize(("crs", "told"), [(CRS(32635), True), (parse_crs("local"), False)])
def test_two_surveys_whose_heights_do_not_fit_are_told(
    crs: CRS, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    one = terrain()
    both = np.vstack([one, one + np.array([0.1, 0.1, 3.0])])
    PointsDenoise(points=PointCloud(one, crs=crs)).run()
    assert "second surface" not in caplog.text
    PointsDenoise(points=PointCloud(both, crs=crs)).run()
    assert ("a second surface 3.0 m above it" in caplog.text) == told
