"""Whole chains, as users run them: what each step takes, beside laspy's reading of the same file.

Each chain is one run in a process of its own, from files to files, that treats its memory as a
command does. Figures of a machine say little on another one; what they are worth is their ratio to
reading, which ``--record`` keeps for each commit and ``--check`` compares with the last that was
kept. A ratio is by processor time: by the
clock a run depends on what else the machine does.

::

    python -m tests.bench chains                      all chains
    python -m tests.bench chains --only terrain town  some
    python -m tests.bench chains --record             keeps the ratios, under this commit
    python -m tests.bench chains --check              what is more than a tenth slower than kept
    python -m tests.bench chains --only tiles --points 20    in tiles, of so many million points
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.bench.measuring import DATA, FEW, ROOT, folder, say

KEPT = Path(__file__).with_name("chains.json")
SLOWER = 1.1  # times the ratio that was kept
READS = 3
AUTZEN = "autzen_ept/autzen_south_5M.laz"
LINE = "powerline_ahn4/12AN2_20_as_published.laz"
TOWN = "ahn3_delft_bgt/ahn3_cropped_2.laz"
DAM = "water_denoever_ahn3/AHN3.laz"

Chain = tuple[str, str, Mapping[str, Any], tuple[str, ...]]
"""Model or id of a tool, file of points, settings, and the outputs that are written."""

TERRAIN = ("classified", "dtm", "dsm", "ndsm", "intensity")
CHAINS: Mapping[str, Chain] = {
    "terrain": ("models.terrain", AUTZEN, {}, TERRAIN),
    "terrain_raw": ("models.terrain", AUTZEN, {"denoise": False}, TERRAIN),
    "ground_dtm": ("models.terrain", AUTZEN, {"denoise": False, "image": False}, ("dtm",)),
    "terrain_small": ("models.terrain", TOWN, {}, TERRAIN),
    "town": ("models.urban_classes", TOWN, {}, ("classified", "outlines")),
    "town_5M": ("models.urban_classes", AUTZEN, {"water": False}, ("classified", "outlines")),
    "shoreline": ("models.reservoir_shoreline", DAM, {}, ("water", "shoreline")),
    "power_line": ("models.power_line_clearance", LINE, {}, ("classified", "wires", "violations")),
    "clean": ("points.denoise", AUTZEN, {}, ("clean",)),
    "ground": ("ground.classify", AUTZEN, {}, ("classified",)),
    "heights": ("ground.classify", AUTZEN, {"heights": True}, ("classified", "surface")),
    "surface": ("surface.grid", AUTZEN, {"cell": 1.0, "method": "max"}, ("surface",)),
    "thin": ("points.thin", AUTZEN, {"cell": 1.0}, ("thinned",)),
}
ENDINGS = {"PointCloud": ".laz", "Raster": ".tif", "Vector": ".gpkg"}
IN_DUTCH = {"assume_crs": "EPSG:28992"}  # what the files that follow do not state
IN_DUTCH_GRID = (LINE, DAM, TOWN)

AS_USERS = {name: v for name, v in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""The environment of a user, whose Python keeps modules that it has compiled."""

READING = """
import sys, time, laspy
start = time.process_time()
laspy.read(sys.argv[1]).xyz
print(time.process_time() - start)
"""

# What is asked of the system when a step begins or ends: processor and wall seconds, the peak of
# the memory so far, and the bytes written.
RUN = """
import json, resource, sys, time
from dataclasses import replace

def state(name):
    used = resource.getrusage(resource.RUSAGE_SELF)
    lines = [line for name in ("status", "io") for line in open("/proc/self/" + name)]
    said = dict(line.split(":", 1) for line in lines if line.startswith(("VmHWM", "wchar")))
    return [name, used.ru_utime + used.ru_stime, time.perf_counter(),
            int(said["VmHWM"].split()[0]) / 1024, int(said["wchar"]) / 1e6]

marks = [["start", 0.0, time.perf_counter(), 0.0, 0.0]]
import toolbox.__main__  # which says how many threads linear algebra has
toolbox.__main__.keep_memory()
import toolbox.execute
from toolbox.context import Context
from toolbox.runs import lineage

counting, write = lineage.counting, toolbox.execute.targets.write

def timed(counts):
    inner = counting(counts)
    def run(step, job, ctx):
        marks.append(state("read" if marks[-1][0] == "import" else "between"))
        result = inner(step, job, ctx)
        marks.append(state(step))
        return result
    return run

def written(*arguments, **options):
    marks.append(state("between"))
    result = write(*arguments, **options)
    marks.append(state("write"))
    return result

toolbox.execute.counting, toolbox.execute.targets.write = timed, written
marks.append(state("import"))
id, values, how = json.loads(sys.argv[1])
toolbox.run(id, values, **how)
marks.append(state("end"))
print(json.dumps(marks))
"""


def chains(*options: str) -> None:
    """Processor and wall time, peak memory and bytes written of whole chains, by step."""
    asked = _options(options)
    found: dict[str, float] = {}
    for name in asked.only:
        if name == "tiles":
            from tests.bench.chains_in_tiles import in_tiles

            found[name] = in_tiles(asked.points, asked.workers)
        else:
            found[name] = _chain(name)
    if asked.record:
        _record(found)
    if asked.check:
        _check(found)


def _options(options: tuple[str, ...]) -> argparse.Namespace:
    parser = argparse.ArgumentParser("chains")
    parser.add_argument("--only", nargs="+", choices=[*CHAINS, "tiles"], default=list(CHAINS))
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--points", type=int, default=20, help="millions, for tiles")
    parser.add_argument("--workers", type=int, default=2, help="for tiles")
    return parser.parse_args(options)


def reading(path: Path) -> float:
    """Processor seconds that laspy takes to read a file with its coordinates, undisturbed."""
    command = [sys.executable, "-c", READING, str(path)]
    return min(float(subprocess.check_output(command)) for _ in range(READS))


def _chain(name: str) -> float:
    """Run a chain, say what its steps take, and give its processor time as times of reading."""
    id, file, settings, _ = CHAINS[name]
    points = DATA / file
    base = reading(points)
    runs = [_run(name) for _ in range(FEW)]
    marks = sorted(runs, key=lambda marks: marks[-1][1])[len(runs) // 2]
    total = marks[-1]
    say(
        f"chains   {name:14} {total[1]:.2f} CPU s, {total[2] - marks[0][2]:.2f} s, peak "
        f"{total[3]:.0f} MiB, {total[4]:.0f} MB written, {total[1] / base:.1f} times reading "
        f"({base:.2f} s); {id} {json.dumps(settings)}"
    )
    for before, after in itertools.pairwise(marks):
        cpu, seconds = after[1] - before[1], after[2] - before[2]
        if after[0] not in ("between", "end") or cpu > 0.05:
            say(
                f"chains   {name:14}   {after[0]:12} {cpu:6.2f} CPU s, {seconds:6.2f} s, peak "
                f"{after[3]:5.0f} MiB, {after[4] - before[4]:5.0f} MB written"
            )
    return float(total[1] / base)


def _run(name: str) -> list[list[Any]]:
    """The states of a run of a chain at the ends of its steps."""
    from toolbox import catalog

    id, file, settings, outputs = CHAINS[name]
    spec = catalog.load(id)
    how = IN_DUTCH if file in IN_DUTCH_GRID else {}
    with folder() as out:
        paths = {n: f"{out / n}{ENDINGS[spec.outputs[n].kind.word]}" for n in outputs}
        values = {"points": str(DATA / file), **settings, **paths}
        command = [sys.executable, "-c", RUN, json.dumps([id, values, how])]
        done = subprocess.run(
            command, capture_output=True, text=True, cwd=ROOT, env=AS_USERS, check=False
        )
    if done.returncode:
        sys.exit(f"{name}: {done.stderr}")
    marks: list[list[Any]] = json.loads(done.stdout.splitlines()[-1])
    return marks


def _record(found: Mapping[str, float]) -> None:
    """Keep ratios under the present commit, beside those of other chains."""
    command = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.check_output(command, text=True, cwd=ROOT).strip()
    kept = _kept()
    kept[commit] = kept.get(commit, {}) | {name: round(ratio, 2) for name, ratio in found.items()}
    KEPT.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def _kept() -> dict[str, dict[str, float]]:
    """The ratios that were recorded, by commit, the oldest first."""
    return dict(json.loads(KEPT.read_text(encoding="utf-8"))) if KEPT.exists() else {}


def _check(found: Mapping[str, float]) -> None:
    """Say what is slower than the last ratio that was kept for it."""
    kept: dict[str, float] = {}
    for ratios in _kept().values():
        kept |= ratios
    for name, ratio in found.items():
        if name not in kept:
            say(f"chains   {name:14} was never recorded")
        else:
            verdict = "SLOWER" if ratio > SLOWER * kept[name] else "as before or faster"
            say(f"chains   {name:14} {ratio:.1f} times reading, kept {kept[name]:.1f}: {verdict}")
