"""A large COPC: memory of writing it as a stream, and what a part of it moves over the line."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from tests.bench.measuring import DATA, PEAK, ROOT, folder, say

COPIES = 4  # of the points, side by side: 20 million
SIDE = 328.0  # feet, of the square that is asked for: a hectare

WRITE = f"""
import sys, time
from pathlib import Path
from toolbox.data import Survey
survey = Survey.open(sys.argv[1])
start = time.process_time()
made = survey.batches(1_000_000)
survey.template.save_batches(Path(sys.argv[2]), made, survey.count)
print(survey.count, time.process_time() - start, {PEAK} // 1024)
"""


def remote() -> None:
    """COPC of 20 million points: memory of writing; bytes of a hectare of it from a server."""
    with folder() as out:
        (out / "in").mkdir()
        _copies(out / "in")
        arguments = [sys.executable, "-c", WRITE, str(out / "in"), str(out / "big.copc.laz")]
        said = subprocess.check_output(arguments, cwd=ROOT, text=True).split()
        size = (out / "big.copc.laz").stat().st_size
        say(
            f"remote   COPC of {int(said[0]):,} points ({size / 1e6:.0f} MB) written in "
            f"{float(said[1]):.0f} s of CPU, {said[2]} MiB at the peak"
        )
        _asked(out)


def _copies(place: Path) -> None:
    from toolbox.data import PointCloud

    cloud = PointCloud.open(DATA / "autzen_ept/autzen_south_5M.laz")
    width = cloud.bounds[3] - cloud.bounds[0]
    rng = np.random.default_rng(0)
    for number in range(COPIES):
        moved = cloud.xyz + rng.normal(0, 0.1, cloud.xyz.shape) + (number * width, 0, 0)
        cloud.with_xyz(moved).save(place / f"{number}.laz")


def _asked(out: Path) -> None:
    import os

    from tests.scenes.server import serving
    from toolbox.data import PointCloud

    path = out / "big.copc.laz"
    whole = PointCloud.open(path, bounds=(638000, 849800, 638100, 849900))
    west, south = np.median(whole.xyz[:, :2], axis=0)
    box = (west, south, west + SIDE, south + SIDE)
    here = PointCloud.open(path, bounds=box)
    os.environ["TOOLBOX_REMOTE_CACHE"] = str(out / "kept")
    with serving() as server:
        server.files["/big.copc.laz"] = content = path.read_bytes()
        for word in ("first", "again"):
            before, asked = server.sent, len(server.asked)
            start = time.perf_counter()
            there = PointCloud.open(f"{server.url}/big.copc.laz", bounds=box)
            seconds = time.perf_counter() - start
            moved = server.sent - before
            assert np.array_equal(there.xyz, here.xyz)
            say(
                f"remote   {word}: {len(there):,} points of a hectare, {moved / 1e3:.0f} kB "
                f"({moved / len(content):.2%} of {len(content) / 1e6:.0f} MB) in "
                f"{len(server.asked) - asked} requests, {seconds:.2f} s"
            )
