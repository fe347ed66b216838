"""A server of files on this computer that answers to ranges, and may misbehave."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import unquote, urlsplit


@dataclass
class Server:
    """Files by path, how they are served, and what was asked for.

    Attributes
    ----------
    files : content by path, such as "/a.laz"
    tags : ETag by path; none where it is ""
    faults : what goes wrong, by path: stall, cut, short, lie, whole, busy (once), or a status
    asked : path with query, range and headers of each request
    sent : bytes of all answers
    """

    files: dict[str, bytes] = field(default_factory=dict)
    tags: dict[str, str] = field(default_factory=dict)
    faults: dict[str, Any] = field(default_factory=dict)
    asked: list[tuple[str, str, dict[str, str]]] = field(default_factory=list)
    sent: int = 0
    url: str = ""


@contextmanager
def serving() -> Iterator[Server]:
    """A server that runs meanwhile."""
    state = Server()
    ready = ThreadingHTTPServer(("127.0.0.1", 0), _handler(state))
    ready.daemon_threads = True
    state.url = f"http://127.0.0.1:{ready.server_port}"
    thread = threading.Thread(target=ready.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield state
    finally:
        ready.shutdown()
        ready.server_close()


def _handler(state: Server) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: Any) -> None:
            """Say nothing."""

        def do_GET(self) -> None:
            path = unquote(urlsplit(self.path).path)
            wanted = self.headers.get("Range", "")
            state.asked.append((self.path, wanted, dict(self.headers)))
            fault, data = state.faults.get(path), state.files.get(path)
            tag = state.tags.get(path, '"one"')
            if fault == "busy":
                del state.faults[path]
                fault = 503
            if isinstance(fault, int) or data is None:
                return self.refuse(fault or 404)
            if self.headers.get("If-Match", tag) != tag:
                return self.refuse(412)
            if fault == "stall":
                time.sleep(3)
            first, last = 0, len(data) - 1
            if wanted and fault != "whole":
                low, _, high = wanted.removeprefix("bytes=").partition("-")
                first, last = int(low), min(int(high), last)
                if first >= len(data):
                    return self.refuse(416)
                self.send_response(206)
                total = len(data) + (7 if fault == "lie" and first else 0)
                self.send_header("Content-Range", f"bytes {first}-{last}/{total}")
            else:
                self.send_response(200)
            body = data[first : last + 1]
            self.send_header("Content-Length", str(len(body)))
            if tag:
                self.send_header("ETag", tag)
                self.send_header("Last-Modified", "Sat, 14 Nov 2026 10:00:00 GMT")
            self.end_headers()
            cut = fault in ("cut", "cut later") and (first or fault == "cut")
            body = body[: len(body) // 2] if cut else body
            self.wfile.write(body)
            state.sent += len(body)
            self.close_connection = bool(cut)
            return None

        def refuse(self, status: int) -> None:
            self.send_response(status)
            self.send_header("Content-Length", "0")
            self.end_headers()

    return Handler
