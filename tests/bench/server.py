"""The server of jobs: jobs and requests in a second, and what is lost when it is killed."""

from __future__ import annotations

import statistics
import time

import requests

from tests.bench.measuring import folder, say, timed, toolbox
from tests.scenes.jobs_server import Server, is_over

JOBS = 8  # asked for at once
REQUESTS = 300


def server() -> None:
    """Jobs a second, latency of small requests beside jobs and alone, and a kill -9 in between."""
    with folder() as place:
        (place / "data").mkdir()
        town = place / "data" / "town.laz"
        toolbox("run", "samples.scene", "--kind", "town", "--points", town)
        ours = Server(place)
        ours.start()
        try:
            _jobs(ours)
            _requests(ours, "alone")
            _killed(ours)
        finally:
            ours.kill()


def _asked(ours: Server) -> list[str]:
    """The places of jobs that classify a town."""
    inputs = {"points": {"href": "town.laz"}}
    replies = [ours.execute("ground.classify", inputs, wait=False) for _ in range(JOBS)]
    return [reply.headers["Location"] for reply in replies]


def _jobs(ours: Server) -> None:
    start = time.perf_counter()
    places = _asked(ours)
    _requests(ours, "beside jobs")
    ended = [ours.until(place, is_over)["status"] for place in places]
    seconds = time.perf_counter() - start
    good = ended.count("successful")
    say(f"server   {good} of {JOBS} jobs well, in {seconds:.1f} s: {JOBS / seconds:.2f} jobs/s")


def _requests(ours: Server, word: str) -> None:
    url = f"{ours.url}/processes/ground.classify?f=json"
    times = [timed(lambda: requests.get(url, timeout=60)) for _ in range(REQUESTS)]
    slow = statistics.quantiles(times, n=100)[-1]
    say(
        f"server   {REQUESTS} requests {word}: median {1000 * statistics.median(times):.0f} ms, "
        f"slowest hundredth {1000 * slow:.0f} ms or more"
    )


def _killed(ours: Server) -> None:
    places = _asked(ours)
    ours.until(places[1], is_over)
    ours.kill()
    start = time.perf_counter()
    ours.start()
    up = time.perf_counter() - start
    ended = [ours.until(place, is_over)["status"] for place in places]
    good = ended.count("successful")
    say(f"server   killed in the middle: up again after {up:.1f} s, {good} of {JOBS} jobs well")
