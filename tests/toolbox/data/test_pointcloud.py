"""Point clouds in memory: reading, selecting, changing; always without touching the original."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import CRS

from toolbox.context import Digested, digest
from toolbox.data import PointCloud
from toolbox.data.crs import parse_crs
from toolbox.data.las import points as las_points
from toolbox.errors import DataError


@pytest.fixture
def cloud() -> PointCloud:
    xyz = [[0, 0, 1], [1, 0, 2], [0, 2, 3], [5, 5, 9.5]]
    return PointCloud(xyz, {"classification": [2, 2, 6, 7], "height": [0.5, 1, 1.5, 2]}, name="c")


@pytest.fixture(params=["memory", "las", "laz"])
def any_cloud(request: pytest.FixtureRequest, cloud: PointCloud, tmp_path) -> PointCloud:
    if request.param == "memory":
        return cloud
    cloud.save(tmp_path / f"c.{request.param}")
    return PointCloud.open(tmp_path / f"c.{request.param}")


def test_what_a_cloud_holds(any_cloud: PointCloud) -> None:
    assert len(any_cloud) == 4
    assert any_cloud.xyz.shape == (4, 3)
    assert any_cloud.xyz.dtype == np.float64
    assert any_cloud["z"].tolist() == [1, 2, 3, 9.5]
    assert any_cloud["classification"].tolist() == [2, 2, 6, 7]
    assert any_cloud["height"].tolist() == [0.5, 1, 1.5, 2]
    assert {"classification", "height"} <= set(any_cloud.names)
    assert "height" in any_cloud
    assert "z" not in any_cloud
    assert any_cloud.bounds == (0, 0, 1, 5, 5, 9.5)
    assert any_cloud.metre == 1


def test_nothing_that_is_handed_out_can_be_changed(any_cloud: PointCloud) -> None:
    for name in ("x", "classification", "height"):
        with pytest.raises(ValueError, match="read-only"):
            any_cloud[name][0] = 3
    with pytest.raises(ValueError, match="read-only"):
        any_cloud.xyz[0] = 3


def test_a_cloud_does_not_share_the_arrays_it_is_made_of() -> None:
    xyz, heights = np.zeros((2, 3)), np.zeros(2)
    cloud = PointCloud(xyz, {"height": heights})
    xyz[:], heights[:] = 7, 7
    assert not cloud.xyz.any()
    assert not cloud["height"].any()


@pytest.mark.parametrize("moved", [False, True])
def test_selecting(any_cloud: PointCloud, moved: bool) -> None:
    cloud = any_cloud.with_xyz(any_cloud.xyz + 10) if moved else any_cloud
    cloud = cloud.with_attributes({"number": np.arange(4)})
    by_mask = cloud.select(cloud["classification"] == 2)
    assert by_mask["number"].tolist() == [0, 1]
    by_index = cloud.select([3, 0, 3])
    assert by_index["number"].tolist() == [3, 0, 3]
    assert by_index["height"].tolist() == [2, 0.5, 2]
    assert np.array_equal(by_index.xyz, cloud.xyz[[3, 0, 3]])
    assert len(cloud.select([])) == len(cloud.select(np.zeros(4, bool))) == 0
    assert len(cloud) == 4


def test_a_selection_takes_coordinates_that_are_known(
    any_cloud: PointCloud, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = any_cloud.select([3, 0])
    computed, box = some.xyz.tobytes(), any_cloud.select([3, 0]).bounds
    _ = any_cloud.xyz
    monkeypatch.setattr(las_points, "coordinates", None)
    assert any_cloud.select([3, 0]).xyz.tobytes() == computed
    assert any_cloud.select([3, 0]).bounds == box


@pytest.mark.parametrize("which", [[True, False], [1.0, 2.0], ["a"]])
def test_what_selects_no_points_is_refused(any_cloud: PointCloud, which: list[object]) -> None:
    with pytest.raises(DataError, match="mask"):
        any_cloud.select(which)


def test_clouds_that_share_coordinates_share_their_digest_and_others_do_not(
    any_cloud: PointCloud,
) -> None:
    """Whatever came first: the question, or the change."""
    places = any_cloud.places
    assert digest(places) == digest(Digested(any_cloud.xyz.copy()))
    assert any_cloud.with_attributes({"a": np.zeros(len(any_cloud))}).places is places
    some = any_cloud.select(np.arange(len(any_cloud))[1:])
    moved, empty = any_cloud.with_xyz(any_cloud.xyz + 1.0), any_cloud.select([])
    arrays = any_cloud.with_arrays(some.arrays())
    for other in (some, moved, arrays, empty, moved.like(some), any_cloud.with_crs(None)):
        assert other.places.array is other.xyz
        assert digest(other.places) == digest(Digested(other.xyz.copy()))
    assert some._places is not None
    assert any_cloud.select([0])._places is None  # which would hold all coordinates


def test_changes_make_a_new_cloud(any_cloud: PointCloud) -> None:
    crs = parse_crs("EPSG:2994")  # feet
    other = (
        any_cloud.with_attributes({"classification": [1, 1, 1, 1]}, descriptions={"height": "m"})
        .with_xyz(any_cloud.xyz * 2)
        .with_crs(crs)
    )
    assert other["classification"].tolist() == [1, 1, 1, 1]
    assert other["height"].tolist() == [0.5, 1, 1.5, 2]
    assert other.descriptions["height"] == "m"
    assert other["z"].tolist() == [2, 4, 6, 19]
    assert other.metre == pytest.approx(1 / 0.3048)
    assert any_cloud["classification"].tolist() == [2, 2, 6, 7]
    assert any_cloud["z"].tolist() == [1, 2, 3, 9.5]
    assert any_cloud.crs is None


def test_an_unknown_attribute_is_named_with_the_nearest(any_cloud: PointCloud) -> None:
    with pytest.raises(DataError, match=r"no attribute 'hieght'.*classification.*mean 'height'"):
        any_cloud["hieght"]


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("height", [1.0], "4 values"),
        ("height", [["a"]] * 4, "must be numbers"),
        ("height", [1j] * 4, "must be numbers"),
        ("x", [1, 2, 3, 4], "with_xyz"),
        ("height", np.zeros((4, 1, 1)), "4 values"),
    ],
)
def test_attributes_that_do_not_fit(
    any_cloud: PointCloud, name: str, values: object, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        any_cloud.with_attributes({name: values})  # type: ignore[dict-item]


@pytest.mark.parametrize("xyz", [[[1, 2]], [1, 2, 3, 4], np.zeros((2, 3, 4))])
def test_coordinates_that_do_not_fit(any_cloud: PointCloud, xyz: object) -> None:
    with pytest.raises(DataError, match=r"shape \(n, 3\)"):
        PointCloud(xyz)  # type: ignore[arg-type]
    with pytest.raises(DataError, match="do not fit 4 points"):
        any_cloud.with_xyz([[1, 2, 3]])


def test_an_empty_cloud() -> None:
    cloud = PointCloud(np.empty((0, 3)))
    assert len(cloud) == 0
    assert np.isnan(cloud.bounds).all()
    assert len(PointCloud([])) == 0


@pytest.mark.parametrize("suffix", [".las", ".laz", ".csv", ".ply"])
def test_reading_within_bounds(cloud: PointCloud, tmp_path, suffix: str) -> None:
    path = tmp_path / f"c{suffix}"
    cloud.save(path)
    inside = PointCloud.open(path, bounds=(0, 0, 1, 2))  # the edges belong to it
    assert inside["height"].tolist() == [0.5, 1, 1.5]
    assert len(PointCloud.open(path, bounds=(10, 10, 11, 11))) == 0
    for bounds in [(1, 0, 0, 1), (0, 0, 1), (0, 0, np.nan, 1)]:
        with pytest.raises(DataError, match="xmin ymin xmax ymax"):
            PointCloud.open(path, bounds=bounds)


def test_options_of_text_files_are_for_text_files(cloud: PointCloud, tmp_path) -> None:
    cloud.save(tmp_path / "c.las")
    with pytest.raises(DataError, match="are for text files"):
        PointCloud.open(tmp_path / "c.las", columns=["x", "y", "z"])


def test_joining(any_cloud: PointCloud) -> None:
    """Also clouds with changes, which stay what they are."""
    moved = any_cloud.with_xyz(any_cloud.xyz + 0.001234)
    changed = any_cloud.with_attributes({"classification": [300, 1, 1, 1]})
    parts = [any_cloud.select([2, 1]), moved, any_cloud.select([]), changed]
    whole = PointCloud.concat(parts)
    assert len(whole) == 10
    assert np.array_equal(whole.xyz, np.concatenate([part.xyz for part in parts]))
    assert whole["classification"].tolist() == [6, 2, 2, 2, 6, 7, 300, 1, 1, 1]
    assert whole["height"].tolist() == [1.5, 1, 0.5, 1, 1.5, 2, 0.5, 1, 1.5, 2]
    assert whole["z"][0] == 3
    for values in (whole.xyz, whole["height"], whole["classification"]):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 3
    assert any_cloud["classification"].tolist() == [2, 2, 6, 7]


def test_joining_nothing_or_one(any_cloud: PointCloud) -> None:
    assert PointCloud.concat([any_cloud]) is any_cloud
    assert len(PointCloud.concat([any_cloud.select([])] * 2)) == 0
    with pytest.raises(DataError, match="no clouds to join"):
        PointCloud.concat([])


def test_joining_clouds_in_memory(cloud: PointCloud) -> None:
    other = PointCloud([[9, 9, 9]], {"height": [7], "classification": [1.5]}, name="other")
    whole = PointCloud.concat(iter([cloud, other]))
    assert whole["classification"].tolist() == [2, 2, 6, 7, 1.5]
    assert whole["height"].tolist() == [0.5, 1, 1.5, 2, 7]
    assert whole.name == "c and 1 more"
    lacking = PointCloud([[9, 9, 9]], {"height": [7]}, name="other")
    with pytest.raises(DataError, match="other has no attribute classification, which c has"):
        PointCloud.concat([cloud, lacking])
    more = other.with_attributes({"truth": [1]})
    with pytest.raises(DataError, match="c has no attribute truth, which other has"):
        PointCloud.concat([cloud, more])
    pairs = PointCloud(cloud.xyz, {"height": np.ones((4, 2)), "classification": np.ones(4)})
    with pytest.raises(DataError, match="'height' has not the same number of elements"):
        PointCloud.concat([cloud, pairs])


def test_joining_refuses_another_crs(any_cloud: PointCloud) -> None:
    metres = any_cloud.with_crs(parse_crs("EPSG:32635"))
    feet = any_cloud.with_crs(parse_crs("EPSG:2994"))
    with pytest.raises(DataError, match=r"is in EPSG:2994.*reproject it to EPSG:32635"):
        PointCloud.concat([metres, metres, feet])
    with pytest.raises(DataError, match="has no CRS"):
        PointCloud.concat([metres, any_cloud])


def test_attributes_that_only_some_clouds_got(
    cloud: PointCloud,
    tmp_path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    cloud.save(tmp_path / "c.las")
    las = PointCloud.open(tmp_path / "c.las")
    more = las.with_attributes({"truth": [1, 2, 3, 4]}, descriptions={"truth": "known"})
    whole = PointCloud.concat([las, more])
    assert whole["truth"].tolist() == [0, 0, 0, 0, 1, 2, 3, 4]
    assert "c.las: has no truth; it is 0 there" in caplog.text
    whole.save(tmp_path / "d.las")
    again = PointCloud.open(tmp_path / "d.las")
    assert again["truth"].tolist() == [0, 0, 0, 0, 1, 2, 3, 4]
    assert again.descriptions["truth"] == "known"
    caplog.clear()
    both = PointCloud.concat([again, las.with_attributes({"truth": [5, 5, 5, 5]})])
    assert both["truth"].tolist() == [0, 0, 0, 0, 1, 2, 3, 4, 5, 5, 5, 5]
    assert not caplog.text  # nobody lacks it
    with pytest.raises(DataError, match="has no LAS records"):
        cloud.like(las)


def test_as_a_data_frame() -> None:
    several = np.arange(6).reshape(2, 3)
    points = PointCloud.from_arrays([0, 1], [2, 3], [4, 5], crs=CRS(32635), rgb=several, own=[7, 8])
    frame = points.to_dataframe()
    assert list(frame) == ["x", "y", "z", "rgb_0", "rgb_1", "rgb_2", "own"]
    assert frame["rgb_1"].tolist() == [1, 4]
    assert frame["y"].tolist() == [2.0, 3.0]
    assert frame.attrs["crs"] == "EPSG:32635"
    with pytest.raises(DataError, match=r"three arrays of one length, got \(2,\), \(1,\), \(2,\)"):
        PointCloud.from_arrays([0, 1], [2], [4, 5])


def test_coordinates_that_nobody_can_change_are_not_copied() -> None:
    free = np.arange(6.0).reshape(2, 3)
    cloud = PointCloud(free)
    free[0, 0] = 9.0
    assert cloud.xyz[0, 0] == 0.0
    fixed = np.arange(6.0).reshape(2, 3).copy()
    fixed.flags.writeable = False
    assert PointCloud(fixed).xyz is fixed
    part = fixed[:1]  # a view of an array that its owner may set free again
    assert PointCloud(part).xyz is not part


def test_what_arrays_can_and_points_cannot_is_answered_with_what_can() -> None:
    cloud = PointCloud(np.zeros((3, 3)), {"intensity": np.array([1, 2, 3])})
    with pytest.raises(
        TypeError, match=r"not changed in place; with_attributes\({'intensity': val"
    ):
        cloud["intensity"] = np.zeros(3)
    with pytest.raises(TypeError, match=r"got ndarray; select\(mask\) gives the points"):
        cloud[cloud["intensity"] > 1]  # type: ignore[index]
