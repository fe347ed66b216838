"""Outputs: refused when they would do harm, whole or not there at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from toolbox import files


def check(path: Path, inputs: list[Path] | None = None, *, overwrite: bool = False) -> str | None:
    found = files.problems({"out": path}, {"out": (".laz",)}, inputs or [], overwrite=overwrite)
    return found.get("out")


def test_all_is_well(tmp_path: Path) -> None:
    assert check(tmp_path / "new.laz") is None
    assert check(tmp_path / "NEW.LAZ") is None


@pytest.mark.parametrize(
    ("name", "text"),
    [("a.xyz", "cannot write .xyz; use .laz"), ("a", "without ending"), ("no/a.laz", "no folder")],
)
def test_wrong_name(tmp_path: Path, name: str, text: str) -> None:
    assert text in str(check(tmp_path / name))


def test_existing_file_needs_overwrite(tmp_path: Path) -> None:
    path = tmp_path / "old.laz"
    path.write_text("old")
    assert "--overwrite" in str(check(path))
    assert check(path, overwrite=True) is None


def test_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.laz").mkdir()
    assert "is a folder" in str(check(tmp_path / "a.laz", overwrite=True))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_no_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    assert "no permission" in str(check(tmp_path / "a.laz"))


def test_input_is_refused_under_any_name(tmp_path: Path) -> None:
    path, link, hard = tmp_path / "in.laz", tmp_path / "link.laz", tmp_path / "hard.laz"
    path.write_text("points")
    link.symlink_to(path)
    hard.hardlink_to(path)
    for name in (path, link, hard, tmp_path / ".." / tmp_path.name / "in.laz"):
        assert "also an input" in str(check(name, [path], overwrite=True))


def test_two_outputs_may_not_share_a_path(tmp_path: Path) -> None:
    path = tmp_path / "a.laz"
    endings = {"one": (".laz",), "two": (".laz",)}
    found = files.problems({"one": path, "two": path}, endings, [], overwrite=False)
    assert found.keys() == {"one", "two"}


def test_all_parts_appear_together(tmp_path: Path) -> None:
    one, two = tmp_path / "one.shp", tmp_path / "two.tif"
    with files.staged([one, two]) as places:
        places[one].write_text("1")
        places[one].with_suffix(".dbf").write_text("2")
        places[two].write_text("3")
        assert not one.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one.dbf", "one.shp", "two.tif"]


def test_nothing_stays_after_an_error(tmp_path: Path) -> None:
    old = tmp_path / "old.tif"
    old.write_text("old")

    def fail() -> None:
        with files.staged([old, tmp_path / "new.tif"]) as places:
            places[old].write_text("half")
            raise RuntimeError("disk on fire")

    with pytest.raises(RuntimeError):
        fail()
    assert [p.name for p in tmp_path.iterdir()] == ["old.tif"]
    assert old.read_text() == "old"


def test_unfinished_files_can_be_discarded_from_outside(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"

    def crash() -> None:
        with files.staged([path]) as places:
            places[path].write_text("half")
            files.discard_unfinished()
            assert list(tmp_path.iterdir()) == []

    with pytest.raises(FileNotFoundError):
        crash()
