"""points.index: what a virtual point cloud says, and that it is read back."""

from __future__ import annotations

import json
import shutil
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes.layers import cloud

import toolbox
from toolbox.data import PointCloud, Survey
from toolbox.data.record import read_record
from toolbox.errors import DataError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three files, two of which have the same name in two formats, with a letter beyond ASCII."""
    (tmp_path / "ä b").mkdir()
    corners = np.array([[500_000, 4_600_000, 5], [500_100, 4_600_050, 9.0]])
    for number, name in enumerate(["one.copc.laz", "one.las", "two.laz"]):
        xyz = corners + np.array([100 * number, 0, 0])
        cloud(xyz).save(tmp_path / "ä b" / name)
    return tmp_path


def index(folder: Path, path: str) -> list[dict[str, Any]]:
    out = folder / path
    toolbox.run("points.index", {"points": folder / "ä b", "index": out})
    features: list[dict[str, Any]] = json.loads(out.read_text("utf-8"))["features"]
    return features


def test_items_are_those_of_stac(folder: Path) -> None:
    items = index(folder, "all.vpc")
    assert [item["id"] for item in items] == ["one", "one_2", "two"]
    assert next(item["assets"]["data"]["href"] for item in items) == "./ä b/one.copc.laz"
    first = items[0]
    assert first["properties"]["pc:count"] == 2
    box = first["properties"]["proj:bbox"]
    np.testing.assert_allclose(box, [500_000, 4_600_000, 5, 500_100, 4_600_050, 9], atol=0.01)
    assert len(first["bbox"]) == 6
    assert first["bbox"][0] == pytest.approx(27, abs=1e-6)
    assert first["geometry"]["coordinates"][0][0] == first["geometry"]["coordinates"][0][-1]
    assert first["properties"]["proj:epsg"] == 32635
    assert {"name": "intensity", "size": 2, "type": "unsigned"} in first["properties"]["pc:schemas"]


def test_it_is_read_back_wherever_it_stands(folder: Path) -> None:
    for path in ("all.vpc", "ä b/inside.vpc"):
        index(folder, path)
        assert Survey.open(folder / path).count == 6
        assert len(PointCloud.open(folder / path)) == 6
    assert "points.index" in read_record(folder / "all.vpc")


def test_an_overview_is_named_and_not_read_as_points(folder: Path) -> None:
    xyz = np.array([[500_000, 4_600_000, 5.0]])
    cloud(xyz).save(folder / "far.copc.laz")
    values = {"points": folder / "ä b", "index": folder / "ä b/all.vpc"}
    toolbox.run("points.index", {**values, "overview": folder / "far.copc.laz"})
    items = json.loads((folder / "ä b/all.vpc").read_text("utf-8"))["features"]
    overview = {"href": "../far.copc.laz", "roles": ["overview"]}
    assert [item["assets"]["overview"]["roles"] for item in items] == [["overview"]] * 3
    assert items[0]["assets"]["overview"]["href"].removeprefix("./") == overview["href"]
    assert Survey.open(folder / "ä b/all.vpc").count == 6
    with pytest.raises(DataError, match=r"overview: must be one COPC file .* got two\.laz"):
        toolbox.run(
            "points.index",
            {**values, "index": folder / "b.vpc", "overview": folder / "ä b/two.laz"},
        )


def test_an_overview_is_copc_by_its_content(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A LAZ file that was renamed is read as what it is, and is no overview."""
    renamed = folder / "far.copc.laz"
    shutil.copy(folder / "ä b/two.laz", renamed)
    values = {"points": folder / "ä b", "index": folder / "all.vpc", "overview": renamed}
    with pytest.raises(DataError, match=r"far\.copc\.laz is no COPC file by its content"):
        toolbox.run("points.index", values)
    assert not (folder / "all.vpc").exists()
    caplog.clear()
    points = PointCloud.open(renamed)
    assert np.array_equal(points.xyz, PointCloud.open(folder / "ä b/two.laz").xyz)
    assert "far.copc.laz is named .copc.laz, but is none by its content" in caplog.text
    points.save(folder / "true.copc.laz")
    toolbox.run("points.index", values | {"overview": folder / "true.copc.laz"})


def test_the_record_of_copc_is_the_first(folder: Path) -> None:
    """Readers look for it there; behind another record it is a LAZ file like others."""
    cloud([[500_000, 4_600_000, 5.0]]).save(folder / "a.copc.laz")
    content = bytearray((folder / "a.copc.laz").read_bytes())
    assert content[377:381] == b"copc"
    assert Survey.open(folder / "a.copc.laz").files[0].copc
    (length,) = struct.unpack_from("<H", content, 375 + 54 + 160 + 20)
    first, second, end = 375, 375 + 54 + 160, 375 + 54 + 160 + 54 + length
    content[first:end] = content[second:end] + content[first:second]
    (folder / "a.copc.laz").write_bytes(content)
    assert not Survey.open(folder / "a.copc.laz").files[0].copc


def test_without_crs_there_is_no_outline(tmp_path: Path) -> None:
    (tmp_path / "ä b").mkdir()
    cloud([[1, 2, 3.0]], crs=None).save(tmp_path / "ä b" / "a.laz")
    (item,) = index(tmp_path, "all.vpc")
    assert item["geometry"] is None
    assert "proj:wkt2" not in item["properties"]
    assert Survey.open(tmp_path / "all.vpc").count == 1


def test_another_ending_is_refused(folder: Path) -> None:
    with pytest.raises(DataError, match=r"a survey is written as \.vpc"):
        Survey.open(folder / "ä b").save(folder / "all.json")
