"""features.local: what becomes an attribute, in which unit, and for which points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

import toolbox
from algorithms.features.local import FeaturesLocal
from algorithms.shared.covariance import FEATURES
from toolbox.data import PointCloud
from toolbox.errors import ParameterError

METRES, FEET = CRS("EPSG:32635+5773"), CRS("EPSG:2263+6360")
FOOT = 1200 / 3937


def roof(n: int = 400, crs: CRS | None = METRES) -> PointCloud:
    """A gable roof of 10 x 10 m above level ground, in metres."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-10, 20, (2, 3 * n))
    over = (abs(x - 5) < 5) & (abs(y - 5) < 5)
    z = np.where(over, 10 - abs(x - 5), 0.0)
    xyz = np.column_stack([x + 500_000, y + 4_600_000, z])
    classes = np.where(over, 6, 2).astype(np.uint8)
    return PointCloud(xyz, {"classification": classes}, crs=crs, name="roof.laz")


def test_slopes_of_a_gable_roof_point_outwards() -> None:
    cloud = roof()
    out = FeaturesLocal(points=cloud, neighbours=8, features=("nx", "nz", "planarity")).run()
    x, y = cloud["x"] - 500_000, cloud["y"] - 4_600_000
    within = (abs(y - 5) < 3.5) & (abs(x - 5) < 3.5) & (abs(x - 5) > 1.5)
    nx = out.described["nx"]
    np.testing.assert_allclose(nx[within & (x < 5)], -np.sqrt(0.5), atol=1e-4)
    np.testing.assert_allclose(nx[within & (x > 5)], np.sqrt(0.5), atol=1e-4)
    np.testing.assert_allclose(out.described["nz"][within], np.sqrt(0.5), atol=1e-4)
    assert out.without_shape == 0
    assert out.described["planarity"].dtype == np.float32


def test_units_of_feet_and_metres() -> None:
    """Lengths stay in the unit of the data, areas and densities are in metres."""
    cloud = roof()
    in_feet = PointCloud(cloud.xyz / FOOT, crs=FEET)
    names = tuple(FEATURES)
    here, there = (
        FeaturesLocal(points=points, features=names, radius=4.0).run().described
        for points in (cloud, in_feet)
    )
    for name, feature in FEATURES.items():
        unit = FOOT if feature.power == 1 else 1.0
        np.testing.assert_allclose(there[name] * unit, here[name], rtol=1e-3, atol=1e-4)
    assert here.descriptions["roughness"].endswith(", metre")
    assert there.descriptions["roughness"].endswith("foot")
    assert here.descriptions["surface_density"] == "points, 1/m2"
    assert all(len(text) <= 32 for text in there.descriptions.values())


def test_ignored_and_withheld_points_are_nobodys_neighbours() -> None:
    cloud = roof()
    withheld = np.zeros(len(cloud), np.uint8)
    withheld[:100] = 1
    cloud = cloud.with_attributes({"withheld": withheld})
    names = {"features": ("neighbours", "planarity"), "neighbours": None, "radius": 3.0}
    out = toolbox.run("features.local", {"points": cloud, "ignore": "2", **names})
    part = (cloud["classification"] != 2) & (withheld == 0)
    alone = toolbox.run("features.local", {"points": cloud.select(part), **names})
    for name in ("neighbours", "planarity"):
        np.testing.assert_array_equal(out["described"][name][part], alone["described"][name])
        assert np.isnan(out["described"][name][~part]).all()
    assert out["without_shape"] == alone["without_shape"]


def test_points_without_neighbours_are_counted() -> None:
    xyz = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5], [100, 0, 0], [100.5, 0, 0]], float)
    out = FeaturesLocal(points=PointCloud(xyz, crs=METRES), features=("sphericity",)).run()
    assert np.isnan(out.described["sphericity"]).tolist() == [False] * 3 + [True] * 2
    assert out.without_shape == 2


def test_several_radii_side_by_side_in_a_file(tmp_path: Path) -> None:
    small = FeaturesLocal(points=roof(), radius=2.0, suffix="_2m").run().described
    both = FeaturesLocal(points=small, radius=5.0, suffix="_5m").run().described
    both.save(tmp_path / "both.laz")
    again = PointCloud.open(tmp_path / "both.laz")
    assert {"planarity_2m", "planarity_5m"} <= set(again.names)
    np.testing.assert_array_equal(again["planarity_2m"], small["planarity_2m"])


def test_settings_that_cannot_be() -> None:
    points = roof(20)
    with pytest.raises(ParameterError, match="radius: give a radius, neighbours or both"):
        FeaturesLocal(points=points, neighbours=None, radius=None)
    with pytest.raises(ParameterError, match="features: give at least one name"):
        FeaturesLocal(points=points, features=())
    with pytest.raises(ParameterError, match="more than 32 letters"):
        FeaturesLocal(points=points, suffix="_" * 30)
    with pytest.raises(ParameterError, match="planarity"):
        toolbox.run("features.local", {"points": points, "features": ["planarty"]})
