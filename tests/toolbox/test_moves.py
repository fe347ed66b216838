"""Moves of several files: all or none, also if the process is killed at any step of them."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from toolbox import files, moves

STEPS = ("replace", "rename", "link", "unlink", "fsync")  # of a move, before each of which we kill
KILLED = 77
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs fork")


def of_shapefile(path: Path) -> tuple[Path, ...]:
    return (path, path.with_suffix(".dbf"), path.with_suffix(".prj"))


def alone(path: Path) -> tuple[Path, ...]:
    return (path,)


def write(tmp_path: Path, text: str) -> None:
    """Write outputs to two folders: of the second version, one has a part less, one is new."""
    a, b = tmp_path / "one" / "a.shp", tmp_path / "two" / "b.laz"
    with files.staged({a: of_shapefile, b: alone}, overwrite=True) as places:
        for suffix in (".shp", ".dbf", *([".prj"] if text == "old" else [])):
            places[a].with_suffix(suffix).write_text(text)
        places[b].write_text(text)
        if text == "new":
            places[b].with_suffix(".json").write_text(text)


def found(tmp_path: Path) -> dict[str, str]:
    """All files of the two folders, but for what is hidden."""
    paths = (path for path in tmp_path.glob("*/*") if not path.name.startswith("."))
    return {path.name: path.read_text() for path in sorted(paths)}


OLD = {"a.dbf": "old", "a.prj": "old", "a.shp": "old", "b.laz": "old"}
NEW = {"a.dbf": "new", "a.shp": "new", "b.json": "new", "b.laz": "new"}


@pytest.fixture
def there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two folders with outputs of an earlier run; nothing waits for the disk."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    write(tmp_path, "old")
    assert found(tmp_path) == OLD
    return tmp_path


def begin_again(there: Path) -> None:
    """Write the outputs of the earlier run again."""
    (there / "two" / "b.json").unlink(missing_ok=True)
    write(there, "old")


def killed_before(step: int, work: Callable[[], None]) -> bool:
    """Do work in another process that is killed before a step; false if it has fewer steps."""
    child = os.fork()
    if child == 0:
        done = iter(range(step))

        def dying(real: Callable[..., object]) -> Callable[..., object]:
            def call(*args: object, **how: object) -> object:
                if next(done, None) is None:
                    os._exit(KILLED)
                return real(*args, **how)

            return call

        for name in STEPS:
            setattr(os, name, dying(getattr(os, name)))
        work()
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) in (0, KILLED)
    return os.waitstatus_to_exitcode(status) == KILLED


def steps() -> Iterator[int]:
    yield from range(200)


def test_a_kill_at_any_step_leaves_the_old_outputs_or_the_new_ones(there: Path) -> None:
    ends = []
    for step in steps():
        if not killed_before(step, lambda: write(there, "new")):
            break
        torn = found(there)
        assert {"a.dbf", "a.shp", "b.laz"} <= torn.keys()  # never is nothing there
        assert set(torn.values()) <= {"old", "new"}  # nor half a file
        for name in ("one", "two") if step % 2 else ("two", "one"):
            files.recover(there / name)
        assert found(there) in (OLD, NEW)
        assert not list(there.glob("*/.*"))
        ends.append(found(there) == NEW)
        begin_again(there)
    assert found(there) == NEW
    assert ends == sorted(ends)  # first the old ones, and after one step the new ones
    assert set(ends) == {False, True}
    assert len(ends) > 15


def test_a_kill_while_undoing_is_undone_by_the_next(there: Path) -> None:
    torn = next(step for step in steps() if is_torn(there, step))
    for step in steps():
        if not killed_before(step, lambda: files.recover(there / "two")):
            break
        files.recover(there / "one")
        files.recover(there / "two")
        assert found(there) == OLD
        assert is_torn(there, torn)
    assert found(there) == OLD


def is_torn(there: Path, step: int) -> bool:
    """Write, with a kill before a step; tell whether it leaves old and new files together."""
    begin_again(there)
    assert killed_before(step, lambda: write(there, "new"))
    return set(found(there).values()) == {"old", "new"}


def test_what_somebody_wrote_after_a_kill_is_left_alone(there: Path) -> None:
    next(step for step in steps() if is_torn(there, step))
    (there / "one" / "a.dbf").write_text("theirs")
    files.recover(there / "one")
    assert found(there) == OLD | {"a.dbf": "theirs"}


def test_the_next_run_recovers_before_it_looks_for_files(there: Path) -> None:
    """Or it would be refused because of a file that the killed run has put there."""
    path = there / "two" / "b.json"
    next(step for step in steps() if is_torn(there, step) and path.exists())
    assert not files.problems(
        {"out": path}, {"out": (".json",)}, {"out": alone}, [], overwrite=False
    )


def test_a_run_that_lives_is_left_alone(there: Path) -> None:
    """Whatever its number is, and on whichever computer: another container may share the folder."""
    target = there / "one" / "c.laz"
    with files.staged({target: alone}, overwrite=False) as places:
        places[target].write_text("whole")
        assert not killed_before(10_000, lambda: files.recover(there / "one"))
        files.recover(there / "one")
    assert target.read_text() == "whole"


def test_without_links_files_are_copied(there: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_links(*args: object, **how: object) -> None:
        raise PermissionError("this file system has no links")

    monkeypatch.setattr(os, "link", no_links)
    for step in steps():
        if not killed_before(step, lambda: write(there, "new")):
            break
        files.recover(there / "one")
        files.recover(there / "two")
        assert found(there) in (OLD, NEW)
        begin_again(there)


def test_an_error_undoes_all(there: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Path.replace

    def fails(self: Path, target: Path) -> Path:
        if Path(target).name == "b.laz" and self.parent.name == "new":
            raise OSError("disk on fire")
        return real(self, target)

    monkeypatch.setattr(Path, "replace", fails)
    with pytest.raises(OSError, match="disk on fire"):
        write(there, "new")
    assert found(there) == OLD
    assert not list(there.glob("*/.*"))


def test_what_cannot_be_put_back_is_kept(there: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Path.replace

    def fails(self: Path, target: Path) -> Path:
        if Path(target).name == "b.laz":
            raise OSError("disk on fire")
        if self.parent.name == "old":
            raise OSError("still burning")
        return real(self, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", fails)
        with pytest.raises(OSError, match="still burning"):
            write(there, "new")
    files.recover(there / "two")
    files.recover(there / "one")
    assert found(there) == OLD


def test_files_are_on_the_disk_before_they_are_moved(
    there: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    replace = Path.replace

    def synced(descriptor: int) -> None:
        done.append(f"sync {os.path.basename(os.readlink(f'/proc/self/fd/{descriptor}'))}")

    def replaced(self: Path, target: Path) -> Path:
        done.append(f"move {self.name}")
        return replace(self, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(Path, "replace", replaced)
    write(there, "new")
    moved = done.index("move journal.draft")
    names = {"a.shp", "a.dbf", "b.laz", "b.json", "journal.draft"}
    assert {f"sync {name}" for name in names} <= set(done[:moved])
    assert {f"move {name}" for name in names - {"journal.draft"}} <= set(done[moved:])
    assert {"sync one", "sync two"} <= set(done[moved:])


def test_permissions_stay_those_of_the_file_that_is_replaced(there: Path) -> None:
    path = there / "two" / "b.laz"
    path.chmod(0o640)
    write(there, "new")
    assert path.stat().st_mode & 0o777 == 0o640


def test_a_journal_out_of_an_archive_reaches_no_other_folder(tmp_path: Path) -> None:
    """Whoever unpacks a folder and writes into it has not asked for what its journal says."""
    home, data = tmp_path / "home", tmp_path / "data"
    hidden = data / f"{moves.PREFIX}theirs"
    for folder in (home, hidden / "old"):
        folder.mkdir(parents=True)
    (hidden / "link").symlink_to(home)
    (home / "secret").write_text("secret")
    theirs = hidden / "old" / ".profile"
    theirs.write_text("evil")
    for entry in (
        ["../../home", ".profile", True, None],
        [".", "../../home/.profile", True, None],
        ["../../home/.", ".profile", True, None],
        ["link", ".profile", True, None],
        ["../../home/.profile", "old/.profile", None],
        [1, 2, 3, 4],
        5,
    ):
        (hidden / "journal").write_text(json.dumps([entry]))
        files.recover(data)
        assert [path.name for path in home.iterdir()] == ["secret"], entry
        assert theirs.exists(), entry
    theirs.unlink()
    (hidden / "old").rmdir()
    (hidden / "old").symlink_to(home)
    (hidden / "journal").write_text(json.dumps([[".", "secret", True, None]]))
    files.recover(data)
    assert (home / "secret").exists()


def test_a_link_to_a_folder_is_nobodys_hidden_folder(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / f"{moves.PREFIX}link").symlink_to(tmp_path / "there")
    files.recover(tmp_path)
    assert not list((tmp_path / "there").iterdir())


def test_outputs_of_two_runs_at_once_do_not_mix(tmp_path: Path) -> None:
    """The last one wins, with all its files."""
    target = tmp_path / "a.shp"

    def run() -> None:
        os.close(closing)
        os.read(gate, 1)  # until the gate is closed
        with files.staged({target: of_shapefile}, overwrite=True) as places:
            for part in of_shapefile(places[target]):
                part.write_text(str(os.getpid()))

    for _ in range(25):
        gate, closing = os.pipe()
        runs = [in_another_process(run) for _ in range(2)]
        os.close(closing)
        os.close(gate)
        for number in runs:
            assert os.waitpid(number, 0)[1] == 0
        assert len({part.read_text() for part in of_shapefile(target)}) == 1


def in_another_process(work: Callable[[], None]) -> int:
    """Start work in another process; gives its number."""
    child = os.fork()
    if child == 0:
        try:
            work()
            os._exit(0)
        finally:
            os._exit(1)
    return child
