"""The verb ``serve``: the tools as an OGC API - Processes."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from toolbox.cli.console import Console


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--data", type=Path, default=Path(), help="folder of the files that jobs may read (.)"
    )
    parser.add_argument(
        "--state", type=Path, default=Path("server"), help="folder of jobs and results (server)"
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at (127.0.0.1)")
    parser.add_argument("--port", type=int, default=5000, help="port to listen at (5000)")
    parser.add_argument(
        "--url", help="address at which clients see the server, where a proxy is in front"
    )
    parser.add_argument(
        "--behind-authentication",
        action="store_true",
        help="others may reach the address, and a proxy in front asks who they are",
    )
    parser.add_argument("--jobs", type=int, default=2, help="jobs that run at a time (2)")
    parser.add_argument("--waiting", type=int, default=100, help="jobs that run or wait (100)")
    parser.add_argument("--seconds", type=float, default=3600, help="time of a job (3600)")
    parser.add_argument("--megabytes", type=int, default=4096, help="size of a result (4096)")


def run(args: argparse.Namespace, _: Console) -> None:
    """Check, and serve until the process is ended."""
    from toolbox.server import serve
    from toolbox.server.jobs import Limits

    limits = Limits(args.jobs, args.waiting, args.seconds, args.megabytes)
    exposed = args.behind_authentication
    serve.check(args.host, args.port, args.data, limits, exposed=exposed, url=args.url)
    data, state = args.data.resolve(), args.state.resolve()
    ready = partial(print, flush=True)
    serve.serve(data, state, args.host, args.port, limits, url=args.url, ready=ready)
