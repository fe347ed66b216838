"""A server of jobs in a process of its own, which can be killed and started again."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import requests


class Server:
    """A server process that can be killed and started again."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"

    def start(self, *more: str) -> None:
        where = ["--data", str(self.folder / "data"), "--state", str(self.folder / "state")]
        argv = [sys.executable, "-m", "toolbox", "serve", *where, "--port", str(self.port), *more]
        with (self.folder / "said.txt").open("w") as said:
            self.process = subprocess.Popen(argv, stdout=said, stderr=subprocess.STDOUT)
        for _ in range(600):
            try:
                requests.get(f"{self.url}/conformance?f=json", timeout=5)
            except requests.ConnectionError:
                time.sleep(0.1)
            else:
                return
        raise TimeoutError

    def kill(self, by: signal.Signals = signal.SIGKILL) -> int:
        self.process.send_signal(by)
        return self.process.wait(30)

    def execute(self, tool: str, inputs: dict[str, Any], *, wait: bool = True) -> requests.Response:
        headers = {} if wait else {"Prefer": "respond-async"}
        url = f"{self.url}/processes/{tool}/execution"
        return requests.post(url, json={"inputs": inputs}, headers=headers, timeout=300)

    def job(self, place: str) -> dict[str, Any]:
        return dict(requests.get(f"{place}?f=json", timeout=30).json())

    def until(self, place: str, found: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        for _ in range(1200):
            if found(job := self.job(place)):
                return job
            time.sleep(0.1)
        raise TimeoutError(job)


def is_over(job: dict[str, Any]) -> bool:
    return job["status"] not in ("accepted", "running")
