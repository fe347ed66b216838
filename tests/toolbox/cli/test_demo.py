"""The verb demo, and the guard against packages that hide ours."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from toolbox import catalog
from toolbox.cli import demo
from toolbox.cli.arguments import read
from toolbox.cli.main import main


def test_each_command_is_one_that_its_tool_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ran: list[str] = []

    def run(words: list[str]) -> int:
        read(catalog.describe(words[0]), words[1:])
        ran.append(words[0])
        return 0

    assert demo.show(tmp_path / "a folder", run) == 0
    assert ran == ["samples.scene", "ground.classify", "compare.classes", "surface.grid"]
    said = capsys.readouterr().out
    assert "terrain.png" in said
    assert said.count("  python -m toolbox ") == 3


def test_a_step_that_fails_ends_the_demo(tmp_path: Path) -> None:
    assert demo.show(tmp_path, lambda words: 3) == 3


def test_a_folder_that_cannot_be_made_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert main(["demo", "--folder", str(tmp_path / "file" / "folder")]) == 2
    assert "folder: cannot be made" in capsys.readouterr().err


@pytest.mark.slow
def test_the_demo_runs(tmp_path: Path) -> None:
    assert main(["demo", "--folder", str(tmp_path)]) == 0
    assert (tmp_path / "terrain.png").stat().st_size > 100_000


def test_a_package_that_hides_ours_is_named(tmp_path: Path) -> None:
    (tmp_path / "algorithms").mkdir()
    (tmp_path / "algorithms" / "__init__.py").touch()
    ran = subprocess.run(
        [sys.executable, "-m", "toolbox", "list"],
        cwd=tmp_path,
        check=False,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 2
    assert f"{tmp_path / 'algorithms'} hides the package 'algorithms'" in ran.stderr
