"""points.feature_codes: classes become codes, of the classes themselves or of a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from algorithms.points.feature_codes import PointsFeatureCodes
from toolbox.data import PointCloud, Table
from toolbox.errors import DataError


def cloud(*classes: int) -> PointCloud:
    xyz = np.column_stack(
        [np.arange(len(classes)) * 1.0, np.zeros(len(classes)), np.ones(len(classes))]
    )
    return PointCloud(
        xyz,
        {
            "classification": np.array(classes, np.uint8),
            "intensity": np.full(len(classes), 9, np.uint16),
        },
        crs=CRS(32635),
    )


def test_codes_are_classes_unless_a_table_says_otherwise() -> None:
    found = PointsFeatureCodes(points=cloud(2, 14, 2, 7)).run()
    assert found.coded["code"].tolist() == [2, 14, 2]
    assert [(r["code"], r["description"], r["points"]) for r in found.codes.rows()] == [
        (2, "Ground", 2),
        (14, "Wire - conductor", 1),
    ]


def test_a_table_has_codes_and_leaves_out_what_it_lacks(caplog: pytest.LogCaptureFixture) -> None:
    table = Table.from_rows(
        [
            {"classification": 2, "code": 200, "description": "Ground shot"},
            {"classification": 14, "code": 10, "description": "Wire"},
        ]
    )
    found = PointsFeatureCodes(points=cloud(2, 14, 5), code_table=table).run()
    assert found.coded["code"].tolist() == [200, 10]
    assert found.left_out == 1
    assert "1 points are of classes without a code" in caplog.text
    assert [r["code"] for r in found.codes.rows()] == [10, 200]


def test_xyz_has_four_columns(tmp_path: Path) -> None:
    PointsFeatureCodes(points=cloud(2, 14)).run().coded.save(
        tmp_path / "a.xyz", columns=["x", "y", "z", "code"]
    )
    first, second, *_ = (tmp_path / "a.xyz").read_text().splitlines()
    assert first == "x y z code"
    assert second.split()[-1] == "2"


def test_columns_of_text_must_be_there(tmp_path: Path) -> None:
    for columns, says in [
        (["x", "y", "z", "no"], "no column 'no'"),
        (["code"], "begin with x,y,z"),
    ]:
        with pytest.raises(DataError, match=says):
            cloud(2).save(tmp_path / "a.xyz", columns=columns)
    with pytest.raises(DataError, match="columns are for text"):
        cloud(2).save(tmp_path / "a.laz", columns=["x", "y", "z"])


@pytest.mark.parametrize("code", [-1, 2.5, 70_000])
def test_bad_codes(code: float) -> None:
    table = Table.from_rows([{"classification": 2, "code": code, "description": ""}])
    with pytest.raises(DataError, match="codes 0 to 65535"):
        PointsFeatureCodes(points=cloud(2), code_table=table).run()


def test_points_need_classes() -> None:
    bare = PointCloud(np.zeros((1, 3)), crs=CRS(32635))
    with pytest.raises(DataError, match="has no classification"):
        PointsFeatureCodes(points=bare).run()


def test_a_class_has_one_code() -> None:
    rows = [{"classification": 2, "code": code, "description": "x"} for code in (10, 11)]
    with pytest.raises(DataError, match="must have each class once, has class 2 more often"):
        PointsFeatureCodes(points=cloud(2), code_table=Table.from_rows(rows)).run()
