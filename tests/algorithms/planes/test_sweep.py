"""planes.sweep: the knee of known curves, of a wall with known noise, and its picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import CRS

from algorithms.planes.extract import PlanesExtract
from algorithms.planes.sweep import PlanesSweep, knee, whole
from toolbox.data import PointCloud
from toolbox.errors import ParameterError
from toolbox.pictures.charts import Curves
from toolbox.pictures.draw import draw

UTM = CRS(32635)


def room(noise: float, metre: float = 1.0) -> NDArray[np.float64]:
    """A floor and two walls."""
    rng = np.random.default_rng(1)
    a, b = rng.random((2, 6000)) * [[6], [4]]
    zero = np.zeros(6000)
    xyz = np.vstack(
        [np.column_stack(sides) for sides in ((a, b, zero), (a, zero, b), (zero, a * 2 / 3, b))]
    )
    return np.asarray((xyz + rng.normal(0, noise, xyz.shape)) * metre)


def swept(xyz: NDArray[np.float64], crs: CRS = UTM, **settings: Any) -> PlanesSweep.Outputs:
    return PlanesSweep(points=PointCloud(xyz, crs=crs), **settings).run()


@pytest.mark.parametrize(
    ("planes", "shares", "place"),
    [
        ([26, 18, 16, 14, 13, 12, 12, 11], None, 5),  # Çömert and Avdan, table 1: 5.0 cm
        ([9, 8, 7, 6], None, None),
        ([0, 0, 5, 5], None, 2),
        ([5, 5, 5, 5], [60.0, 80.0, 90.0, 90.1], 2),
        ([100, 99, 98], None, 0),  # one of a hundred is no change
    ],
)
def test_knee(planes: list[int], shares: list[float] | None, place: int | None) -> None:
    assert knee(planes, shares) == place


@pytest.mark.parametrize(
    ("pieces", "place"),
    [
        ([17.0, 9.0, 5.0, 2.1, 2.0], 3),
        ([9.0, 5.0, 2.0, 1.0], None),
        ([np.nan, np.nan, 3.0, 2.9], 2),
        ([9.0, 9.0, 3.0, 3.0], 2),
        ([np.nan, np.nan], None),
    ],
)
def test_whole(pieces: list[float], place: int | None) -> None:
    assert whole(pieces) == place


def test_a_front_that_is_bent_stays_whole_from_its_bend_on() -> None:
    """A wall that bows by 6 cm over 12 m falls into strips with a tolerance below that."""
    rng = np.random.default_rng(2)
    u, v = rng.random((2, 40_000)) * [[12], [5]]
    away = 0.06 * np.cos(np.pi * u / 12) ** 2 + rng.normal(0, 0.002, u.size)
    steps = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
    out = swept(np.column_stack([u, away, v]), tolerances=steps)
    assert out.whole is not None
    assert 0.03 < out.whole < 0.1
    frame = out.table.frame
    assert frame.pieces.iloc[0] > 2
    assert frame.pieces.iloc[-1] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_auto_is_at_the_knee(noise: float) -> None:
    out = swept(room(noise))
    assert out.knee is not None
    assert abs(out.auto - out.knee) < 0.005
    assert out.noise == pytest.approx(noise, rel=0.2)
    frame = out.table.frame
    columns = ["tolerance", "planes", "share", "largest", "trials", "fronts", "pieces", "knee"]
    assert list(frame.columns) == columns
    assert frame.tolerance.is_monotonic_increasing
    assert frame.share.iloc[0] < 80
    assert frame.share.iloc[-1] > 99
    assert frame.knee.sum() == 1
    assert frame.planes[frame.knee].iloc[0] == 3


def test_rows_are_those_of_extract() -> None:
    xyz = room(0.004)
    frame = swept(xyz, tolerances=(0.02, 0.005)).table.frame
    assert list(frame.tolerance) == [0.005, 0.02]
    for row in frame.itertuples():
        one = PlanesExtract(points=PointCloud(xyz, crs=UTM), tolerance=float(row.tolerance)).run()
        assert (one.count, one.share * 100) == (row.planes, pytest.approx(row.share))


def test_feet() -> None:
    metres, feet = swept(room(0.004)), swept(room(0.004, 1 / 0.3048), crs=CRS(2992))
    assert list(feet.table.frame.tolerance) == pytest.approx(list(metres.table.frame.tolerance))
    assert feet.knee == pytest.approx(metres.knee)


@pytest.mark.slow
def test_no_knee_is_said(caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(2)
    ball = rng.normal(size=(20_000, 3))
    ball *= 5 / np.linalg.norm(ball, axis=1)[:, None]
    assert swept(ball, tolerances=(0.02, 0.05, 0.1)).knee is None
    assert "there is no knee" in caplog.text


def test_one_tolerance_is_no_choice() -> None:
    with pytest.raises(ParameterError, match="tolerances: give at least two"):
        swept(room(0.004), tolerances=(0.01, 0.01))


def test_picture(tmp_path: Path) -> None:
    table = swept(room(0.004)).table
    spec: Any = PlanesSweep
    (show,) = spec.spec.outputs["table"].show
    curve = Curves.of("sweep", table, show)
    assert curve is not None
    assert curve.dashed == 100 * float(table.frame.tolerance[table.frame.knee].iloc[0])
    draw({"sweep": (table, (show,))}, tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000
