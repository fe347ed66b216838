"""Starts the server: pygeoapi with a configuration made of the catalogue, behind waitress."""

from __future__ import annotations

import importlib
import ipaddress
import json
import logging
import os
import re
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from toolbox import __version__, catalog
from toolbox.errors import DataError, ParameterError
from toolbox.server.jobs import Limits
from toolbox.server.requests import problem_of

BODY = 1 << 20  # bytes of a request: layers come by reference
THREADS = 32  # each request that waits for its job holds one


def check(
    host: str, port: int, data: Path, limits: Limits, *, exposed: bool, url: str | None = None
) -> None:
    """Refuse what would open the server to others, serve no folder, or never run a job.

    Raises
    ------
    ParameterError
        The address is not of this computer alone, and nobody has said that this is known; or a
        value is out of its limits.
    """
    problems = {}
    try:
        local = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = False
    if not local and not exposed:
        problems["host"] = (
            f"{host} may be reached by others, and the server asks nobody who they are; put a "
            "proxy that does in front, and say --behind-authentication"
        )
    if not data.is_dir():
        problems["data"] = f"must be a folder, got {data}"
    if not 0 < port < 2**16:
        problems["port"] = f"must be from 1 to {2**16 - 1}, got {port}"
    if url is not None and not _is_address(url):
        problems["url"] = f"must be like https://example.org/lidar, got {url}"
    above_zero = {
        "jobs": limits.at_once,
        "waiting": limits.waiting,
        "seconds": limits.seconds,
        "megabytes": limits.megabytes,
    }
    problems |= {
        name: f"must be > 0, got {value:g}" for name, value in above_zero.items() if not value > 0
    }
    if problems:
        raise ParameterError("serve", problems)


def _is_address(url: str) -> bool:
    """Whether a text is an address of the web without a query, a fragment or a password."""
    try:
        parts = urlsplit(url)
        known = bool(parts.hostname) and (parts.port or 1) > 0
    except ValueError:
        return False
    plain = not (parts.query or parts.fragment or parts.username or re.search(r"\s", url))
    return known and plain and parts.scheme in ("http", "https")


def configuration(data: Path, jobs: Path, url: str, limits: Limits) -> dict[str, Any]:
    """The configuration of pygeoapi."""
    processor = "toolbox.server.manager.ToolProcessor"
    return {
        "server": {
            "bind": {"host": "127.0.0.1", "port": 0},  # waitress binds
            "url": url,
            "mimetype": "application/json; charset=UTF-8",
            "encoding": "utf-8",
            "languages": ["en-US"],
            "pretty_print": True,
            "limits": {"default_items": 1000, "max_items": 1000},
            "map": {"url": "", "attribution": ""},
            "manager": {
                "name": "toolbox.server.manager.JobManager",
                "url": url,
                "data": str(data),
                "jobs": str(jobs),
                "limits": vars(limits),
            },
        },
        "logging": {"level": "ERROR", "logformat": "%(asctime)s %(levelname)s %(message)s"},
        "metadata": {
            "identification": {
                "title": "LiDAR toolbox",
                "description": "Geoprocessing tools for LiDAR",
                "keywords": ["lidar"],
                "terms_of_service": "",
                "url": url,
            },
            "license": {"name": "MIT", "url": "https://opensource.org/license/mit"},
            "provider": {"name": "LiDAR toolbox", "url": url},
            "contact": {"name": "", "email": ""},
        },
        "resources": {
            id: {"type": "process", "processor": {"name": processor, "tool": id}}
            for id in catalog.own_ids()
        },
    }


def without_traceback(record: logging.LogRecord) -> bool:
    """Take the traceback off a refused request, which is in order; pygeoapi logs it as an error."""
    exceptions = importlib.import_module("pygeoapi.process.base")
    refusals = (
        exceptions.ProcessorGenericError,
        exceptions.JobError,
        exceptions.ProcessError,
    )
    if record.exc_info and isinstance(record.exc_info[1], refusals):
        record.exc_info = None
        record.levelno, record.levelname = logging.WARNING, "refused:"
    return True


def application(data: Path, state: Path, url: str, limits: Limits) -> Any:
    """The application of pygeoapi for our tools, with the files of results.

    Raises
    ------
    DataError
        The extra is not installed.
    """
    state.mkdir(parents=True, exist_ok=True, mode=0o700)
    says = configuration(data, state / "jobs", url, limits)
    paths = {"PYGEOAPI_CONFIG": "pygeoapi.json", "PYGEOAPI_OPENAPI": "openapi.json"}
    os.environ.update({name: str(state / file) for name, file in paths.items()})
    (state / "pygeoapi.json").write_text(json.dumps(says), encoding="utf-8")  # JSON is YAML
    try:
        openapi = importlib.import_module("pygeoapi.openapi")
        flask = importlib.import_module("flask")
    except ImportError as err:
        raise DataError(f"{err}; pip install pygeoapi waitress") from None
    (state / "openapi.json").write_text(
        json.dumps(openapi.get_oas(says), default=str), encoding="utf-8"
    )
    front = importlib.import_module("pygeoapi.flask_app")
    app, manager = front.APP, front.api_.manager
    logging.getLogger("pygeoapi.api").addFilter(without_traceback)

    def file(id: str, name: str) -> Any:
        path = manager.file_of(id, name)
        return flask.send_file(path) if path else ("no such file", 404)

    def refusal() -> Any:
        asked = flask.request
        if asked.method == "POST" and (problem := problem_of(asked.get_data())):
            says = {"code": "InvalidParameterValue", "type": "InvalidParameterValue"}
            return says | {"description": problem}, 400
        return None

    app.add_url_rule("/files/<id>/<name>", "files", file)
    app.before_request(refusal)
    return app


def serve(
    data: Path,
    state: Path,
    host: str,
    port: int,
    limits: Limits,
    *,
    url: str | None = None,
    ready: Callable[[str], None],
) -> None:
    """Serve until the process is ended; ready is told the address as soon as it is ours.

    Parameters
    ----------
    url : at which clients see the server, behind a proxy; links in answers begin with it

    Raises
    ------
    DataError
        The address is taken, or another server uses the folder of state.
    """
    here = f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
    app = application(data, state, (url or here).rstrip("/"), limits)
    waitress = importlib.import_module("waitress")
    try:
        server = waitress.create_server(
            app,
            host=host,
            port=port,
            threads=THREADS,
            max_request_body_size=BODY,
            ident=f"lidar-toolbox {__version__}",
        )
    except OSError as err:
        raise DataError(f"cannot listen at {host}:{port}: {err.strerror}") from None
    ready(f"{here}/processes")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # which ends the server as Ctrl-C does
    server.run()
    importlib.import_module("toolbox.server.manager").queue_of(state / "jobs", limits).rest()
