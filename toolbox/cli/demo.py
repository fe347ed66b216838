"""The verb ``demo``: a small survey from points to a terrain model and its accuracy."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

STEPS = (  # what is said, and the words after ``python -m toolbox``
    (
        "A small survey of a town, and the true terrain below it",
        "run samples.scene --kind town --points {0}/town.laz --terrain {0}/truth.tif",
    ),
    (
        "Which points are ground",
        "run ground.classify --points {0}/town.laz --classified {0}/ground.laz",
    ),
    (
        "How many of them are right",
        "run compare.classes --points {0}/ground.laz --reference {0}/town.laz"
        " --map 2=ground 1,3-7,9,17,18=object --errors {0}/errors.laz --picture {0}/errors.png",
    ),
    (
        "A terrain model",
        "run surface.grid --points {0}/ground.laz --classes 2 --cell 0.5"
        " --surface {0}/terrain.tif --picture {0}/terrain.png",
    ),
)
NEXT = (
    ("what a file holds; try your own", "info {0}/town.laz"),
    ("a page to hand over", "run models.terrain --points {0}/town.laz --page {0}/terrain.html"),
    ("all tools", "list"),
)


def show(folder: Path, run: Callable[[list[str]], int]) -> int:
    """Run the steps, each as a user would type it, and return the first exit code that is not 0."""
    folder.mkdir(parents=True, exist_ok=True)
    place = shlex.quote(str(folder))
    for number, (says, command) in enumerate(STEPS, 1):
        words = command.format(place)
        print(f"\n[{number}/{len(STEPS)}] {says}:\n$ python -m toolbox {words}", flush=True)
        if code := run([*shlex.split(words)[1:], "--overwrite"]):
            return code
    print(f"\nLook at {folder / 'terrain.png'} and {folder / 'errors.png'}. To go on:\n")
    for says, command in NEXT:
        print(f"  python -m toolbox {command.format(place)}    # {says}")
    return 0
