"""The figures of the documentation: docs/figures.json, from which `make docs` writes its tables."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tests.bench.measuring import ROOT, folder, say

FILE = ROOT / "docs" / "figures.json"
SURVEYS = {  # sizes in metres of the sample surveys of docs/examples.yaml: small, large
    "town": (120, 360),
    "corridor": (600, 2400),
    "reservoir": (160, 480),
    "facade": (24, 72),
}
FEW = 1000  # points by which two runs must differ to tell what a point takes
LIBRARIES = ("numpy", "scipy", "numba", "laspy", "lazrs", "rasterio", "geopandas", "scikit-learn")
PEERS = ("open3d", "cloth-simulation-filter")
ACCURACY = {  # measurement: its options
    "isprs": [],
    "filters": [],
    "corridor_real": ["--data", "hills,12AN2_20"],
    "waters": ["--seeds", "100", "101"],
    "real_fronts": [],
    "outlines": [],
}


def figures(*names: str) -> None:
    """Measure what the documentation says: the tools by themselves, and accuracies.

    The options `--tools` and `--NAME` of an accuracy measure these alone, and keep the others.
    """
    known = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    wanted = {name.lstrip("-") for name in names} or {"tools", *ACCURACY}
    if unknown := wanted - {"tools", *ACCURACY}:
        raise SystemExit(f"no figures called {', '.join(sorted(unknown))}")
    if "tools" in wanted:
        known["tools"] = {"machine": machine(), "runs": tools()}
    for name in [name for name in ACCURACY if name in wanted]:
        lines = list(printed(name, ACCURACY[name]))
        known.setdefault("accuracy", {})[name] = {"machine": machine(), "lines": lines}
    FILE.write_text(json.dumps(known, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def machine() -> dict[str, Any]:
    """Where and with what something is measured."""
    found = {name: _version(name) for name in (*LIBRARIES, *PEERS)}
    return {
        "day": datetime.now(UTC).date().isoformat(),
        "commit": _printed("git", "rev-parse", "--short", "HEAD").strip(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "libraries": {name: version for name, version in found.items() if version},
    }


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _processor() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor())


def _printed(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout


def printed(name: str, options: list[str]) -> Iterator[str]:
    """The lines of a measurement, without its name."""
    for line in _printed(sys.executable, "-m", "tests.bench", name, *options).splitlines():
        say(line)
        yield line.removeprefix(name).strip()


def tools() -> dict[str, Any]:
    """Points, processor time and memory of the example of each tool, on small and large surveys."""
    runs: dict[str, list[dict[str, float]]] = {}
    for size in (0, 0, 1):  # the first one compiles
        with folder() as out:
            for id, run in _all(size, out):
                runs.setdefault(id, []).append(run)
    return {id: _per_million(*found[1:]) for id, found in runs.items()}


def _all(size: int, out: Path) -> Iterator[tuple[str, dict[str, float]]]:
    """Run all examples in the order of the file; what the first of each tool took."""
    from toolbox.reference import examples

    for id, values in examples().items():
        for number, said in enumerate(values):
            if said.get("$run") is False:
                continue
            given = {name: value for name, value in said.items() if not name.startswith("$")}
            if id == "samples.scene":
                given["size"] = SURVEYS[given["kind"]][size]
            run = _run(id, given, out)
            say(f"figures  {id:28} {run}")
            if number == 0:
                yield id, run


def _run(id: str, given: dict[str, Any], out: Path) -> dict[str, float]:
    """Millions of points that are read, processor seconds, and MB at the peak of one command."""
    command = [sys.executable, "-m", "toolbox", "run", id, *_words(given), "--overwrite", "--quiet"]
    where = {"PYTHONPATH": str(ROOT), "TOOLBOX_HISTORY": ""}
    process = subprocess.Popen(command, cwd=out, env=os.environ | where)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    return {
        "points": sum(_points(out / str(file)) for file in _listed(given.get("points"))),
        "seconds": used.ru_utime + used.ru_stime,
        "megabytes": used.ru_maxrss / 1024,
    }


def _words(given: dict[str, Any]) -> list[str]:
    """Values as the words of a command."""
    made = []
    for name, value in given.items():
        texts = (str(v).lower() if isinstance(v, bool) else str(v) for v in _listed(value))
        made += [f"--{name}", *texts]
    return made


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]


def _points(path: Path) -> float:
    """Millions of points of a LAZ file; of another, or of one that the run makes itself, none."""
    import laspy

    if path.suffix != ".laz" or not path.exists():
        return 0.0
    with laspy.open(path) as file:
        return float(file.header.point_count) / 1e6


def _per_million(small: dict[str, float], large: dict[str, float]) -> dict[str, float | None]:
    """What a million points more takes; None where the runs have hardly another number of points.

    The difference of two runs leaves out what starting takes.
    """
    more = large["points"] - small["points"]
    rates: dict[str, float | None] = {"seconds_more": None, "megabytes_more": None}
    if more * 1e6 > FEW:
        for name in ("seconds", "megabytes"):
            rates[f"{name}_more"] = round((large[name] - small[name]) / more, 2)
    return {name: round(value, 2) for name, value in large.items()} | rates


def real_fronts() -> None:
    """Openings of two scanned fronts, which people have labelled, at an IoU of one half."""
    import numpy as np

    from tests.bench.facades import REAL, _f1, _labelled
    from tests.bench.measuring import DATA

    for number in (1, 2):
        table = np.loadtxt(DATA / REAL.format(number), skiprows=1)
        shade = table[:, 3].astype(np.uint16)
        say(f"real_fronts  front {number}  {_f1(table[:, :3], shade, _labelled(table))}")


def outlines() -> None:
    """Class 6 and corners of outlines in towns, beside the provider's classes and a map."""
    from tests.bench.buildings import TILES, _with_noise
    from tests.bench.corners import compared, opened, places

    for name, path in TILES.items():
        say(f"outlines  {name:17} class 6 {_with_noise(opened(path), 0.0)}")
    for place in places():
        if place.name in ("BGT, Delft", "BD TOPO, rural", "town 17", "town 18"):
            say(f"outlines  {place.name:17} {compared(place)}")
