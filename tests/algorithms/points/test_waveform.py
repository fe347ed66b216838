"""points.waveform: the samples of a packet, their places, and what cannot be read."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from scenes.layers import cloud
from scenes.waves import GAIN, SAMPLES, TO_SENSOR, location, packet, scanned

import toolbox
from algorithms.points.waveform import PointsWaveform
from toolbox.data import PointCloud
from toolbox.declare import Position
from toolbox.errors import DataError, ParameterError
from toolbox.tiles.tiling import Tiling


def line(count: int = 9, crs: CRS | None = None) -> PointCloud:
    """Points ten metres apart."""
    xyz = np.column_stack([10.0 * np.arange(count), np.zeros(count), np.arange(count) / 2])
    return cloud(xyz, crs=crs or CRS(32635))


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_samples_are_those_of_the_packet(tmp_path: Path, suffix: str, inside: bool) -> None:
    points = scanned(line(), tmp_path / f"a{suffix}", inside=inside)
    found = PointsWaveform(points=points, place=Position(31.0, 1.0)).run()
    frame = found.samples.frame
    assert found.sharing == 1
    assert frame["volts"].tolist() == pytest.approx(
        [GAIN * value for value in packet(3)], abs=1e-12
    )
    assert frame["time"].tolist() == list(range(SAMPLES))
    assert frame["volts"].idxmax() == round(location(3) / 1000)
    assert frame["point"].tolist() == [row == frame["volts"].idxmax() for row in range(SAMPLES)]


def test_places_lie_on_the_line_of_the_pulse(tmp_path: Path) -> None:
    points = scanned(line(), tmp_path / "a.las")
    frame = PointsWaveform(points=points).run().samples.frame  # of the middle one
    speed = float(np.linalg.norm(TO_SENSOR))  # metres per picosecond
    beyond = 1000.0 * np.arange(SAMPLES) - location(4)
    np.testing.assert_allclose(frame["distance"], beyond * speed, rtol=1e-6)
    assert frame["z"].iloc[0] > 2.0 > frame["z"].iloc[-1]  # light comes from above
    np.testing.assert_allclose(frame["z"], 2.0 - beyond * TO_SENSOR[2], atol=1e-5)
    np.testing.assert_allclose(frame["x"], 40.0)


def test_feet_give_distances_in_metres(tmp_path: Path) -> None:
    frames = [
        PointsWaveform(points=scanned(line(crs=crs), tmp_path / name)).run().samples.frame
        for crs, name in ((CRS(32635), "metres.las"), (CRS(2263), "feet.las"))
    ]
    np.testing.assert_allclose(frames[0]["distance"], frames[1]["distance"], rtol=1e-5)
    assert np.ptp(frames[1]["z"]) == pytest.approx(3.280833 * np.ptp(frames[0]["z"]), rel=1e-4)


def test_returns_of_one_pulse_share_it(tmp_path: Path) -> None:
    points = scanned(line(), tmp_path / "a.las")
    shared = points["wavepacket_offset"].copy()
    shared[5] = shared[4]
    points = points.with_attributes({"wavepacket_offset": shared})
    points.save(tmp_path / "b.las")
    assert PointsWaveform(points=PointCloud.open(tmp_path / "b.las")).run().sharing == 2


def test_packets_stay_with_tools_that_choose_points(tmp_path: Path) -> None:
    """Also in tiles, where the pieces go through processes."""
    scanned(line(), tmp_path / "a.las")
    settings = {"points": tmp_path / "a.las", "extent": "15,-5,55,5"}
    for name, how in (("whole.laz", {}), ("tiled.laz", {"tiling": Tiling(30.0, 1)})):
        toolbox.run(
            "points.clip", {**settings, "clipped": tmp_path / name}, assume_crs="EPSG:32635", **how
        )
        found = PointCloud.open(tmp_path / name)
        assert len(found) == 4
        assert (tmp_path / name).with_suffix(".wdp").read_bytes() == (
            tmp_path / "a.wdp"
        ).read_bytes()
        volts = PointsWaveform(points=found, place=Position(30.0, 0.0)).run().samples.frame["volts"]
        assert volts.tolist() == pytest.approx([GAIN * value for value in packet(3)])


def test_waveforms_of_another_file_are_not_replaced(tmp_path: Path) -> None:
    scanned(line(), tmp_path / "a.las")
    scanned(line(4), tmp_path / "b.las")
    before = (tmp_path / "b.wdp").read_bytes()
    run = {"points": tmp_path / "a.las", "extent": "15,-5,55,5"}
    with pytest.raises(ParameterError, match=r"b\.wdp holds the waveforms of another file"):
        toolbox.run(
            "points.clip",
            {**run, "clipped": tmp_path / "b.laz"},
            overwrite=True,
            assume_crs="local",
        )
    assert (tmp_path / "b.wdp").read_bytes() == before
    toolbox.run(
        "points.clip", {**run, "clipped": tmp_path / "b.las"}, overwrite=True, assume_crs="local"
    )
    assert (tmp_path / "b.wdp").read_bytes() == (tmp_path / "a.wdp").read_bytes()


def test_what_cannot_be_read_is_told(tmp_path: Path, data: Callable[[str], Path]) -> None:
    scanned(line(), tmp_path / "a.las")
    with pytest.raises(DataError, match="has no points with a waveform"):
        PointsWaveform(points=line()).run()
    (tmp_path / "a.wdp").unlink()
    with pytest.raises(DataError, match=r"\.wdp, which is not beside it"):
        PointsWaveform(points=PointCloud.open(tmp_path / "a.las")).run()
    with pytest.raises(DataError, match=r"beyond the end of the waveforms, .* they are cut off"):
        PointsWaveform(points=PointCloud.open(data("robustness/simple1_3.las"))).run()


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ((12, 0, SAMPLES), "have 12 bits a sample; 8, 16, 32 can be read"),
        ((8, 1, SAMPLES), "are compressed"),
        ((16, 0, SAMPLES), "packet of 60 bytes; descriptor 1 needs 120"),
    ],
)
def test_odd_packets_are_refused(tmp_path: Path, kind: tuple[int, int, int], text: str) -> None:
    scanned(line(), tmp_path / "a.las")
    content = bytearray((tmp_path / "a.las").read_bytes())
    struct.pack_into("<2BI", content, 375 + 54, *kind)
    (tmp_path / "a.las").write_bytes(content)
    with pytest.raises(DataError, match=text):
        PointsWaveform(points=PointCloud.open(tmp_path / "a.las")).run()
