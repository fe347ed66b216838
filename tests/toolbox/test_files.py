"""Outputs: refused when they would do harm, whole or not there at all."""

from __future__ import annotations

import errno
import os
import re
from pathlib import Path

import pytest

from toolbox import files


def alone(path: Path) -> tuple[Path, ...]:
    """A format of one file."""
    return (path,)


def shapefile(path: Path) -> tuple[Path, ...]:
    """A format of several files."""
    return (path, path.with_suffix(".dbf"), path.with_suffix(".prj"))


def check(
    path: Path,
    inputs: list[Path] | None = None,
    *,
    overwrite: bool = False,
    own_files: files.OwnFiles = alone,
) -> str | None:
    found = files.problems(
        {"out": path},
        {"out": (".laz", ".shp")},
        {"out": own_files},
        inputs or [],
        overwrite=overwrite,
    )
    return found.get("out")


def test_all_is_well(tmp_path: Path) -> None:
    assert check(tmp_path / "new.laz") is None
    assert check(tmp_path / "NEW.LAZ") is None


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.xyz", "cannot write .xyz; use .laz, .shp"),
        ("a", "without ending"),
        (".laz", "without ending"),
        ("no/a.laz", "no folder"),
    ],
)
def test_wrong_name(tmp_path: Path, name: str, text: str) -> None:
    assert text in str(check(tmp_path / name))


def test_a_name_of_another_raster_says_how_it_is_made(tmp_path: Path) -> None:
    kinds, own = {"dtm": (".tif", ".tiff")}, {"dtm": alone}
    problems = files.problems({"dtm": tmp_path / "a.asc"}, kinds, own, [], overwrite=False)
    assert problems["dtm"].endswith("other formats: gdal_translate a.tif a.asc")


def test_existing_file_needs_overwrite(tmp_path: Path) -> None:
    path = tmp_path / "old.laz"
    path.write_text("old")
    assert "overwrite=True" in str(check(path))
    assert check(path, overwrite=True) is None


def test_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.laz").mkdir()
    assert "is a folder" in str(check(tmp_path / "a.laz", overwrite=True))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_no_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    assert "no permission" in str(check(tmp_path / "a.laz"))


def test_a_path_below_a_file_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "town.laz").write_text("points")
    for name in ("town.laz/a.laz", "town.laz/deep/a.laz"):
        assert check(tmp_path / name) == f"{tmp_path / 'town.laz'} is a file, not a folder"


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (OSError(errno.EROFS, "Read-only file system"), "nothing .* in folder .*: Read-only"),
        (PermissionError(errno.EPERM, "Operation not permitted"), "no permission to write"),
    ],
)
def test_what_permissions_do_not_tell_is_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: OSError, says: str
) -> None:
    def refuse(**_: object) -> str:
        raise error

    monkeypatch.setattr(files.tempfile, "mkdtemp", refuse)
    assert re.match(says, str(check(tmp_path / "a.laz")))


def test_a_trial_leaves_nothing_behind(tmp_path: Path) -> None:
    assert files.folder_problem(tmp_path) is None
    assert not list(tmp_path.iterdir())


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
    own_files = {"one": alone, "two": alone}
    found = files.problems({"one": path, "two": path}, endings, own_files, [], overwrite=False)
    assert found.keys() == {"one", "two"}


def test_all_parts_appear_together(tmp_path: Path) -> None:
    one, two = tmp_path / "one.shp", tmp_path / "two.tif"
    with files.staged({one: shapefile, two: alone}, overwrite=False) as places:
        places[one].write_text("1")
        places[one].with_suffix(".dbf").write_text("2")
        places[two].write_text("3")
        assert not one.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one.dbf", "one.shp", "two.tif"]


def test_nothing_stays_after_an_error(tmp_path: Path) -> None:
    old = tmp_path / "old.tif"
    old.write_text("old")

    def fail() -> None:
        with files.staged({old: alone, tmp_path / "new.tif": alone}, overwrite=True) as places:
            places[old].write_text("half")
            raise RuntimeError("disk on fire")

    with pytest.raises(RuntimeError):
        fail()
    assert [p.name for p in tmp_path.iterdir()] == ["old.tif"]
    assert old.read_text() == "old"


def test_unfinished_files_can_be_discarded_from_outside(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"

    def crash() -> None:
        with files.staged({path: alone}, overwrite=False) as places:
            places[path].write_text("half")
            files.discard_unfinished()
            assert list(tmp_path.iterdir()) == []

    with pytest.raises(FileNotFoundError):
        crash()


def test_a_new_folder_goes_at_a_hard_exit_unless_it_holds_outputs(tmp_path: Path) -> None:
    empty, full = tmp_path / "empty", tmp_path / "full"

    def crash() -> None:
        with (
            files.made(empty),
            files.made(full),
            files.staged({empty / "a.tif": alone}, overwrite=False),
        ):
            (full / "b.tif").write_text("an output")
            files.discard_unfinished()
            assert [path.name for path in tmp_path.iterdir()] == ["full"]

    with pytest.raises(FileNotFoundError):
        crash()
    with files.made(empty):
        pass
    files.discard_unfinished()
    assert empty.is_dir(), "its run has ended well"


def test_parts_of_a_format_count_as_outputs(tmp_path: Path) -> None:
    other = tmp_path / "a.dbf"
    other.write_text("not mine")
    assert "a.dbf exists" in str(check(tmp_path / "a.shp", own_files=shapefile))
    assert "also an input" in str(
        check(tmp_path / "a.shp", [other], overwrite=True, own_files=shapefile)
    )


def test_stale_parts_do_not_survive(tmp_path: Path) -> None:
    """An old .prj beside a new layer without CRS would give it one."""
    path = tmp_path / "a.shp"
    for part in shapefile(path):
        part.write_text("old")
    with files.staged({path: shapefile}, overwrite=True) as places:
        places[path].write_text("new")
    assert [p.name for p in tmp_path.iterdir()] == ["a.shp"]


def test_a_folder_named_like_a_part_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "a.dbf").mkdir()
    assert "a.dbf is a folder" in str(
        check(tmp_path / "a.shp", overwrite=True, own_files=shapefile)
    )


def test_a_file_that_appears_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.laz"

    def race() -> None:
        with files.staged({path: alone}, overwrite=False) as places:
            places[path].write_text("ours")
            path.write_text("theirs")

    with pytest.raises(FileExistsError, match="appeared meanwhile"):
        race()
    assert path.read_text() == "theirs"


def test_all_is_put_back_when_one_move_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = tmp_path / "1.laz", tmp_path / "2.laz"
    one.write_text("old")
    real = Path.replace

    def fails_for_two(self: Path, target: Path) -> Path:
        if target == two:
            raise OSError("disk on fire")
        return real(self, target)

    def write() -> None:
        with files.staged({one: alone, two: alone}, overwrite=True) as places:
            for place in places.values():
                place.write_text("new")

    monkeypatch.setattr(Path, "replace", fails_for_two)
    with pytest.raises(OSError, match="disk on fire"):
        write()
    assert [p.name for p in tmp_path.iterdir()] == ["1.laz"]
    assert one.read_text() == "old"


def test_a_private_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, link = tmp_path / "a", tmp_path / "b"
    folder.mkdir(mode=0o700)
    link.symlink_to(folder)
    assert files.is_private(folder)
    assert files.is_private(link)
    for mode in (0o720, 0o702):
        folder.chmod(mode)
        assert not files.is_private(folder)
    folder.chmod(0o755)
    monkeypatch.setattr(files.os, "getuid", lambda: folder.stat().st_uid + 1)
    assert not files.is_private(folder)
