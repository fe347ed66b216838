"""Runs the commands of the jobs' pages, and keeps the pictures that the pages show: make gallery.

A page that shows `../images/jobs/town-errors.webp` has a command that writes `errors.png`.
"""

from __future__ import annotations

import os
import re
import shlex
import sys
import tempfile
from pathlib import Path

from make_tool_pictures import shrink

from toolbox.cli.main import main as command_line
from toolbox.reference import ROOT, commands

JOBS = ROOT / "docs" / "jobs"
WIDTH = 1100  # of a picture: texts of three maps beside each other can be read when it is enlarged
SHOWN = re.compile(r"\]\(\.\./images/jobs/([\w.-]+)\.webp\)")


def draw(page: Path) -> None:
    """Run the commands of a page in an empty folder, and keep what it shows."""
    shown = SHOWN.findall(page.read_text(encoding="utf-8"))
    if not shown:
        return
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for words in commands(page):
            if command_line(words[3:]):  # after python -m toolbox
                raise SystemExit(f"{page.name}: {shlex.join(words)} failed")
        for name in shown:
            picture = Path(f"{name.removeprefix(f'{page.stem}-')}.png")
            shrink(picture, JOBS.parent / "images" / "jobs" / f"{name}.webp", WIDTH)
        os.chdir(ROOT)


def main(names: list[str]) -> None:
    """Draw the pictures of these pages, or of all."""
    (JOBS.parent / "images" / "jobs").mkdir(parents=True, exist_ok=True)
    for page in sorted(JOBS.glob("*.md")):
        if not names or page.stem in names:
            draw(page)


if __name__ == "__main__":
    main(sys.argv[1:])
