"""Compile ahead: a few runs on made data, after which the loops lie in the cache of numba."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from importlib.resources import files as resources
from pathlib import Path
from typing import Any

import yaml

from toolbox import catalog, execute, files
from toolbox.context import Context, log

RUNS = "warm.yaml"  # in algorithms/


def warm(ctx: Context) -> None:
    """Do all runs in a temporary folder, of which nothing is left but what was compiled.

    Raises
    ------
    Cancelled
        `ctx` asked to stop; what was compiled by then stays.
    """
    runs = yaml.safe_load((resources("algorithms") / RUNS).read_text(encoding="utf-8"))
    level = log.level
    log.setLevel(logging.ERROR)  # what they say of made data means nothing
    try:
        with files.scratch() as folder:
            for number, run in enumerate(runs):
                ctx.stage(f"Compiling for {run['tool']}")
                part = ctx.part(number / len(runs), (number + 1) / len(runs))
                execute.run(run["tool"], _placed(run["tool"], run["values"], folder), ctx=part)
    finally:
        log.setLevel(level)


def _placed(id: str, values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The values of a run with its layers in a folder."""
    spec = catalog.load(id)
    layers = spec.sources.keys() | spec.outputs.keys()
    return {name: folder / value if name in layers else value for name, value in values.items()}
