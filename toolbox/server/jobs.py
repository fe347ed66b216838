"""A queue of jobs, each a process of the command line in a folder of its own.

What is known of a job is in an SQLite file, so that nothing is lost when the server is killed: jobs
that waited or ran are done from the beginning when it starts again. One that ran when the server
was killed, and again, has failed: it may be what ends the server. A process ends with the server,
since it ends when its standard input does.
"""

from __future__ import annotations

import json
import os
import queue
import re
import shutil
import sqlite3
import subprocess
import sys
import threading
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from toolbox.errors import DataError

WAITS, RUNS, DONE, FAILED, DISMISSED = "accepted", "running", "successful", "failed", "dismissed"
OPEN = (WAITS, RUNS)
ENDED = "ended"  # of a request: whether a server was ended while the job ran
STOPPING = 5.0  # seconds from the end of its input until a process is killed
COLUMNS = ("process", "status", "message", "progress", "request", "result")
TIMES = ("created", "started", "finished", "updated")
SANDBOX = {  # nothing but plain files, see docs/explanation/security.md
    "GDAL_SKIP": "VRT,WMS,WMTS,WCS,HTTP,EEDA,EEDAI,PLMOSAIC,STACIT,STACTA,"
    "OGR_VRT,WFS,OAPIF,OGCAPI,CSW,NGW,GDALG",
    "CPL_VSIL_CURL_ALLOWED_EXTENSIONS": "none",
    "PROJ_NETWORK": "OFF",
}


class Full(Exception):
    """As many jobs wait as may."""


@dataclass(frozen=True)
class Limits:
    """What jobs may take.

    Attributes
    ----------
    at_once : jobs that run at a time
    waiting : jobs that run or wait
    seconds : of a job, after which it is stopped
    megabytes : of each file that a job writes
    kept : finished jobs, of which the oldest are forgotten with their files
    """

    at_once: int = 2
    waiting: int = 100
    seconds: float = 3600.0
    megabytes: int = 4096
    kept: int = 1000


class Jobs:
    """The jobs in a folder, and the threads that see to them.

    Raises
    ------
    DataError
        Another server uses the folder.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        self.folder, self.limits = folder, limits
        self.queue: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.processes: dict[str, subprocess.Popen[str]] = {}
        self.changed = threading.Condition()
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        self.lock = _lock(folder)
        columns = ", ".join(f"{name} TEXT" for name in (*COLUMNS, *TIMES))
        with self._db() as db:
            db.execute(f"CREATE TABLE IF NOT EXISTS jobs (id TEXT PRIMARY KEY, {columns})")
        for job in self.all(OPEN):
            self._begin_again(job)
        for _ in range(limits.at_once):
            threading.Thread(target=self._work, daemon=True).start()

    def _begin_again(self, job: Mapping[str, Any]) -> None:
        """Put a job of a server that has ended into the queue, unless it ran in two of them."""
        id, request = job["id"], json.loads(job["request"])
        if job["status"] == RUNS and request.get(ENDED):
            text = "the server was ended twice while it ran"
            self.set(id, status=FAILED, message=text, finished=_now())
            shutil.rmtree(self.folder / id, ignore_errors=True)
            return
        told = json.dumps(request | {ENDED: request.get(ENDED) or job["status"] == RUNS})
        self.set(id, status=WAITS, progress=0, message="waits again", request=told)
        self.queue.put(id)

    def rest(self) -> None:
        """Let jobs that run wait for the next server, as this one is stopped in good order."""
        for job in self.all((RUNS,)):
            self.set(job["id"], only=(RUNS,), status=WAITS, progress=0, message="waits again")

    @contextmanager
    def _db(self) -> Iterator[sqlite3.Connection]:
        db = sqlite3.connect(self.folder / "jobs.sqlite", timeout=30)
        db.row_factory = sqlite3.Row
        try:
            with db:
                yield db
        finally:
            db.close()

    def add(self, process: str, values: Mapping[str, Any], files: Mapping[str, str]) -> str:
        """Put a job into the queue, and return its id.

        Raises
        ------
        Full
            As many jobs wait as may.
        """
        id, now = str(uuid.uuid4()), _now()
        request = json.dumps({"values": dict(values), "files": dict(files)})
        with self.changed:
            if len(self.all(OPEN)) >= self.limits.waiting:
                raise Full(f"{self.limits.waiting} jobs wait already; try again later")
            with self._db() as db:
                db.execute(
                    "INSERT INTO jobs (id, process, status, message, progress, request, created,"
                    " updated) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                    (id, process, WAITS, "waits", 0, request, now, now),
                )
        self._forget()
        self.queue.put(id)
        return id

    def all(self, status: tuple[str, ...] = ()) -> list[dict[str, Any]]:
        """All jobs, or those of a status, the oldest first."""
        marks = ", ".join("?" * len(status))
        where = f" WHERE status IN ({marks})" if status else ""
        with self._db() as db:
            rows = db.execute(f"SELECT * FROM jobs{where} ORDER BY created, rowid", status)
            return [dict(row) for row in rows]

    def get(self, id: str) -> dict[str, Any] | None:
        """What is known of a job."""
        with self._db() as db:
            row = db.execute("SELECT * FROM jobs WHERE id = ?", (id,)).fetchone()
        return dict(row) if row else None

    def set(self, id: str, *, only: tuple[str, ...] = OPEN, **values: Any) -> bool:
        """Change what is known of a job, if it has one of these states."""
        values["updated"] = _now()
        names = ", ".join(f"{name} = ?" for name in values)
        marks = ", ".join("?" * len(only))
        with self.changed, self._db() as db:
            done = db.execute(
                f"UPDATE jobs SET {names} WHERE id = ? AND status IN ({marks})",
                (*values.values(), id, *only),
            )
            self.changed.notify_all()
            return done.rowcount > 0

    def wait(self, id: str) -> dict[str, Any]:
        """Wait until a job is no longer open."""
        with self.changed:
            while (job := self.get(id)) and job["status"] in OPEN:
                self.changed.wait(1.0)
        return job or {"id": id, "status": DISMISSED, "message": "forgotten"}

    def dismiss(self, id: str) -> bool:
        """Stop an open job; forget one that is over, with its files."""
        if self.set(id, status=DISMISSED, message="dismissed", finished=_now()):
            if process := self.processes.get(id):
                _stop(process)
            return True
        with self._db() as db:
            gone = db.execute("DELETE FROM jobs WHERE id = ?", (id,)).rowcount > 0
        shutil.rmtree(self.folder / id, ignore_errors=True)
        return gone

    def _forget(self) -> None:
        over = [job["id"] for job in self.all((DONE, FAILED, DISMISSED))]
        for id in over[: max(0, len(over) - self.limits.kept)]:
            self.dismiss(id)

    def _work(self) -> None:
        """See to one job after the other."""
        while True:
            id = self.queue.get()
            try:
                self._run(id)
            except Exception as err:  # noqa: BLE001  one bad job must not end the thread
                self.set(id, status=FAILED, message=f"server: {err}", finished=_now())

    def _run(self, id: str) -> None:
        job = self.get(id)
        if job is None or not self.set(id, status=RUNS, message="runs", started=_now()):
            return
        shutil.rmtree(self.folder / id, ignore_errors=True)  # of a run that was killed
        # A new name: the process of a server that was killed may still be about to stop.
        folder = self.folder / id / uuid.uuid4().hex
        (folder / "tmp").mkdir(parents=True, mode=0o700)
        request = json.loads(job["request"])
        files = {name: str(folder / file) for name, file in request["files"].items()}
        process = _start(job["process"], folder, self.limits)
        self.processes[id] = process
        late = threading.Event()

        def stop() -> None:
            late.set()
            _stop(process)

        timer = threading.Timer(self.limits.seconds, stop)
        timer.start()
        try:
            assert process.stdin
            with suppress(BrokenPipeError):
                process.stdin.write(json.dumps(request["values"] | files) + "\n")
                process.stdin.flush()
            last = self._listen(id, process)
        finally:
            timer.cancel()
            _stop(process)
            del self.processes[id]
        if last["event"] == "result":
            for file in map(Path, files.values()):
                if file.exists():
                    file.replace(self.folder / id / file.name)
        shutil.rmtree(folder, ignore_errors=True)
        self._end(id, last, late=late.is_set())

    def _listen(self, id: str, process: subprocess.Popen[str]) -> dict[str, Any]:
        """Take note of the progress of a process; return its last event."""
        last: dict[str, Any] = {"event": "error", "message": "the process was ended"}
        assert process.stdout
        for line in process.stdout:
            with suppress(ValueError):
                event = json.loads(line)
                if event["event"] == "progress":
                    self.set(id, progress=int(event["value"]))
                elif event["event"] == "stage":
                    self.set(id, message=event["text"])
                elif event["event"] in ("error", "result"):
                    last = event
        return last

    def _end(self, id: str, last: Mapping[str, Any], *, late: bool) -> None:
        if last["event"] == "result":
            result = json.dumps(last["outputs"])
            self.set(id, status=DONE, message="done", progress=100, result=result, finished=_now())
            return
        text = f"stopped after {self.limits.seconds:g} s" if late else str(last["message"])
        text = re.sub(rf"{re.escape(str(self.folder))}/[-0-9a-f/]*", "", text)
        self.set(id, status=FAILED, message=text, finished=_now())
        shutil.rmtree(self.folder / id, ignore_errors=True)


def _lock(folder: Path) -> sqlite3.Connection:
    """What keeps other servers from a folder, whose jobs they would begin again, until it closes.

    SQLite locks on every system, and the lock goes with the process, however that ends.
    """
    lock = sqlite3.connect(folder / "lock.sqlite", timeout=0, check_same_thread=False)
    try:
        lock.execute("BEGIN EXCLUSIVE")
    except sqlite3.OperationalError:
        lock.close()
        raise DataError(f"{folder} is used by another server; name another (--state)") from None
    return lock


def _start(tool: str, folder: Path, limits: Limits) -> subprocess.Popen[str]:
    """Start the command line in a folder, whose files and state it keeps to."""
    own = {name: str(folder / "tmp") for name in ("TMPDIR", "TOOLBOX_CACHE")}
    own["TOOLBOX_HISTORY"] = str(folder / "tmp" / "history.jsonl")
    process = subprocess.Popen(
        [sys.executable, "-m", "toolbox", "run", tool, "--params", "-", "--events", "jsonl"],
        cwd=folder,
        env=os.environ | SANDBOX | own,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,  # Ctrl-C is for the server
    )
    with suppress(ImportError, AttributeError, OSError):  # Linux alone can limit another process
        import resource

        most = limits.megabytes * 2**20
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (most, most))
    return process


def _stop(process: subprocess.Popen[str]) -> None:
    """End a process: by the end of its input, or else by force."""
    with suppress(OSError):
        if process.stdin:
            process.stdin.close()
    try:
        process.wait(STOPPING)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
