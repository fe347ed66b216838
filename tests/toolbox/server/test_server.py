"""The server as a client that we did not write meets it (OWSLib), and when it is killed."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import requests
from owslib.ogcapi.processes import Processes
from pyproj import CRS
from scenes.jobs_server import Server, is_over

from toolbox import catalog
from toolbox.data import PointCloud

pytestmark = pytest.mark.slow
SLOW = {"kind": "town", "size": 400, "density": 20}  # a scene that takes long enough to be stopped


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    (tmp_path / "data").mkdir()
    columns = {"classification": np.array([2, 5, 2], np.uint8)}
    PointCloud(np.zeros((3, 3)), columns, crs=CRS(32635)).save(tmp_path / "data" / "a.laz")
    made = Server(tmp_path)
    made.start()
    yield made
    made.kill()


def test_owslib_lists_describes_and_runs(server: Server, tmp_path: Path) -> None:
    client = Processes(server.url)
    assert [tool["id"] for tool in client.processes()] == catalog.own_ids()
    described = client.process("points.filter")
    assert described["inputs"] == catalog.describe("points.filter")["inputs"]
    assert "async-execute" in described["jobControlOptions"]
    result = client.execute("points.filter", {"points": {"href": "a.laz"}, "classes": "2"})
    (tmp_path / "kept.laz").write_bytes(requests.get(result["kept"]["href"], timeout=30).content)
    assert len(PointCloud.open(tmp_path / "kept.laz")) == 2
    assert result["removed_share"] == pytest.approx(1 / 3)


def test_links_have_the_public_address(tmp_path: Path) -> None:
    """As a client behind a proxy sees them: the one of the tests takes the path off."""
    (tmp_path / "data").mkdir()
    PointCloud(np.zeros((3, 3)), crs=CRS(32635)).save(tmp_path / "data" / "a.laz")
    server, public = Server(tmp_path), "https://example.org/lidar"
    server.start("--url", f"{public}/")
    try:
        reply = server.execute("points.filter", {"points": {"href": "a.laz"}}, wait=False)
        place = reply.headers["Location"]
        assert place.startswith(f"{public}/jobs/")
        here = place.replace(public, server.url)
        server.until(here, is_over)
        kept = requests.get(f"{here}/results?f=json", timeout=30).json()["kept"]
        assert kept["href"].startswith(f"{public}/files/")
        assert requests.get(kept["href"].replace(public, server.url), timeout=30).content
        again = server.execute("points.filter", {"points": kept})
        assert again.json()["removed_share"] == 0
        for page in ("", "/processes", "/jobs"):
            text = requests.get(f"{server.url}{page}?f=json", timeout=30).text
            assert public in text
            assert server.url not in text
    finally:
        server.kill()


def test_jobs_in_the_background_and_chains(server: Server) -> None:
    reply = server.execute("points.filter", {"points": {"href": "a.laz"}}, wait=False)
    assert reply.status_code == 201
    place = reply.headers["Location"]
    told = reply.json()  # as the standard asks, for clients that read no headers
    assert place.endswith(f"/jobs/{told['jobID']}")
    assert (told["processID"], told["status"]) == ("points.filter", "accepted")
    assert told["links"][0]["href"] == place
    job = server.until(place, is_over)
    assert (job["status"], job["progress"]) == ("successful", 100)
    kept = requests.get(f"{place}/results?f=json", timeout=30).json()["kept"]
    again = server.execute("points.filter", {"points": kept, "classes": "5"})
    assert again.json()["removed_share"] == pytest.approx(2 / 3)
    assert requests.delete(place, timeout=30).status_code == 200  # over: forgotten
    assert requests.get(place, timeout=30).status_code == 404
    assert requests.get(kept["href"], timeout=30).status_code == 404


def test_wrong_requests_are_refused_in_words(server: Server) -> None:
    reply = server.execute("points.filter", {"points": {"href": "../a.laz"}})
    assert reply.status_code == 400
    assert "is no file of the data" in reply.json()["description"]
    reply = server.execute("surface.grid", {"points": {"href": "a.laz"}, "cell": -1})
    assert reply.status_code == 400
    assert "cell: must be > 0 and <= 10000 m, got -1" in reply.json()["description"]
    url = f"{server.url}/processes/points.filter/execution"
    reply = requests.post(url, data=b"[]", timeout=30)
    assert reply.status_code == 400
    assert "must be an object" in reply.json()["description"]
    assert server.execute("points.nothing", {}).status_code == 404
    assert requests.get(f"{server.url}/jobs/nothing?f=json", timeout=30).status_code == 404
    said = (server.folder / "said.txt").read_text()
    assert "refused: points.filter: 1 problem" in said
    assert "Traceback" not in said


def test_a_second_server_of_an_address_or_of_a_folder_is_refused(server: Server) -> None:
    argv = [sys.executable, "-m", "toolbox", "serve", "--data", str(server.folder / "data")]
    taken = [*argv, "--state", str(server.folder / "other"), "--port", str(server.port)]
    second = subprocess.run(taken, check=False, capture_output=True, text=True, timeout=60)
    assert second.stdout == ""
    assert "cannot listen at 127.0.0.1" in second.stderr
    same = [*argv, "--state", str(server.folder / "state"), "--port", str(server.port)]
    second = subprocess.run(same, check=False, capture_output=True, text=True, timeout=60)
    assert second.returncode
    assert "is used by another server" in second.stderr


def test_a_job_that_runs_can_be_dismissed(server: Server) -> None:
    place = server.execute("samples.scene", SLOW, wait=False).headers["Location"]
    server.until(place, lambda job: job["status"] == "running")
    assert requests.delete(place, timeout=30).json()["status"] == "dismissed"
    assert server.job(place)["status"] == "dismissed"
    id = place.rpartition("/")[2]
    assert not list((server.folder / "state" / "jobs" / id).glob("*.laz"))


def test_nothing_is_lost_when_the_server_is_killed(server: Server) -> None:
    inputs = {"points": {"href": "a.laz"}}
    jobs = [server.execute("points.filter", inputs, wait=False) for _ in range(8)]
    places = [job.headers["Location"] for job in jobs]
    server.until(places[0], lambda job: job["status"] != "accepted")
    server.kill()
    server.start()
    ended = [server.until(place, is_over) for place in places]
    assert [(job["status"], job["message"]) for job in ended] == 8 * [("successful", "done")]


def test_a_killed_server_leaves_no_half_results_and_goes_on(server: Server) -> None:
    """A job that runs when the server ends is done once more; if that ends it again, it failed."""
    slow = server.execute("samples.scene", SLOW, wait=False).headers["Location"]
    waits = server.execute("points.filter", {"points": {"href": "a.laz"}}, wait=False)
    for told in ("waits again", "the server was ended twice while it ran"):
        server.until(slow, lambda job: job["status"] == "running" and job["progress"] > 0)
        server.kill()
        server.start("--jobs", "1")
        assert requests.get(f"{slow}/results?f=json", timeout=30).status_code >= 400
        if told == "waits again":
            assert server.job(slow)["status"] in ("accepted", "running")
    job = server.job(slow)
    assert (job["status"], job["message"]) == ("failed", told)
    assert not (server.folder / "state" / "jobs" / slow.rpartition("/")[2]).exists()
    ended = server.until(waits.headers["Location"], is_over)
    assert (ended["status"], ended["message"]) == ("successful", "done")


@pytest.mark.parametrize("by", [signal.SIGTERM, signal.SIGINT])
def test_jobs_outlive_a_server_that_is_stopped_in_good_order(
    server: Server, by: signal.Signals
) -> None:
    """As often as that is: no update of the computer makes a long job one that has failed."""
    place = server.execute("samples.scene", SLOW, wait=False).headers["Location"]
    for _ in range(3):
        server.until(place, lambda job: job["status"] == "running" and job["progress"] > 0)
        assert server.kill(by) == 0
        server.start()
        assert server.job(place)["status"] in ("accepted", "running")
    assert requests.delete(place, timeout=30).json()["status"] == "dismissed"


def test_limits_of_time_and_jobs(server: Server) -> None:
    server.kill()
    server.start("--seconds", "1", "--waiting", "2")
    first, second = (server.execute("samples.scene", SLOW, wait=False) for _ in range(2))
    assert server.execute("samples.scene", SLOW, wait=False).status_code == 503
    for reply in (first, second):
        job = server.until(reply.headers["Location"], is_over)
        assert (job["status"], job["message"]) == ("failed", "stopped after 1 s")
    assert all(path.is_file() for path in (server.folder / "state" / "jobs").iterdir())
