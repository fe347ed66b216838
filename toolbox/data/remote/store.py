"""What is asked of servers: sizes and ranges of bytes, through obstore.

Requests are repeated after errors of the server and of the line, and given up after a time. Each
range is asked for in the version that was seen first, so that a file which is replaced meanwhile is
noticed.
"""

from __future__ import annotations

import errno
import math
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache
from typing import Any
from urllib.parse import unquote, urlsplit, urlunsplit

from toolbox.data.reading import CHANGED
from toolbox.data.remote import credentials
from toolbox.data.remote.address import SCHEMES, Address
from toolbox.data.remote.credentials import is_true
from toolbox.errors import DataError

OFFLINE_VARIABLE = "TOOLBOX_OFFLINE"
TIMEOUT = 60.0  # seconds that a request may take, with its answer of a few megabytes
CONNECT = 10.0  # seconds until a server answers at all
RETRIES = 4  # of a request, each after twice the time
FIRST = 2**14  # bytes that are read to learn the size, which hold the header of most LAS files
FRESH = 5.0  # seconds for which an answer holds, if a change shows in later requests (ETag)
_STATUS = re.compile(r"[Ss]tatus\D{0,40}?\b([45]\d\d)\b")
_KIND = re.compile(r"kind: (Connect|Timeout)\b")
_ALLOW_HTTP = ("AWS_ALLOW_HTTP", "GOOGLE_ALLOW_HTTP", "AZURE_ALLOW_HTTP")


@dataclass(frozen=True)
class Facts:
    """What a server says of a file.

    Attributes
    ----------
    size : in bytes
    etag : of its version; "" if the server says none
    version : text that changes with the content: size with ETag, or with the time of the last
        change; "" if the server tells neither
    first : its first bytes
    """

    size: int
    etag: str
    version: str
    first: bytes


_known: dict[str, tuple[float, Facts | None]] = {}  # by URL: when it was asked for, the answer


def facts_of(address: Address) -> Facts:
    """Size and version of a file, and its first bytes, as they were some seconds ago at most.

    Raises
    ------
    OSError
        The server does not answer, refuses, or has no such file.
    """
    asked, found = _known.get(address.url, (-math.inf, None))
    if found is None or not found.etag or time.monotonic() - asked > FRESH:
        asked, found = time.monotonic(), _asked_for(address)
        _known[address.url] = asked, found
    return found


def _asked_for(address: Address) -> Facts:
    store, key = _opened(address.url, TIMEOUT, CONNECT, RETRIES)
    with _named(address):
        found = store.get(key, options={"range": (0, FIRST)})
        meta, first = found.meta, bytes(found.bytes())
    etag, changed = str(meta["e_tag"] or ""), meta["last_modified"]
    version = etag or (str(changed) if changed.timestamp() > 0 else "")
    if len(first) != min(meta["size"], FIRST):
        raise OSError(errno.EIO, f"the server sends {len(first)} bytes of {FIRST}", str(address))
    return Facts(int(meta["size"]), etag, version and f"{version} {meta['size']}", first)


def fetched(address: Address, facts: Facts, start: int, stop: int) -> bytes:
    """The bytes of a file from start to before stop.

    Raises
    ------
    OSError
        They cannot be had.
    DataError
        The file is another than it was.
    """
    store, key = _opened(address.url, TIMEOUT, CONNECT, RETRIES)
    options: dict[str, Any] = {"range": (start, stop)}
    if facts.etag:
        options["if_match"] = facts.etag
    with _named(address):
        found = store.get(key, options=options)
        meta, data = found.meta, bytes(found.bytes())
    if meta["size"] != facts.size or (facts.etag and str(meta["e_tag"] or "") != facts.etag):
        raise DataError(f"{address} {CHANGED}")
    if len(data) != stop - start:
        text = f"the server sends {len(data)} bytes where {stop - start} were asked for"
        raise OSError(errno.EIO, text, str(address))
    return data


@lru_cache(maxsize=64)
def _opened(url: str, timeout: float, connect: float, retries: int) -> tuple[Any, str]:
    """What reads from the place of a file, and the name of the file there."""
    if is_true(OFFLINE_VARIABLE):
        raise DataError(f"{Address(url)}: nothing is read from the web ({OFFLINE_VARIABLE} is set)")
    parts = urlsplit(url)
    if parts.scheme not in SCHEMES or not parts.netloc:
        known = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        raise DataError(f"{Address(url)}: files on the web are read from {known}")
    try:
        from obstore.store import AzureStore, GCSStore, HTTPStore, S3Store
    except ImportError:
        text = "to read from the web, install obstore (pip install obstore)"
        raise DataError(text) from None
    how: dict[str, Any] = {
        "client_options": {
            "timeout": timedelta(seconds=timeout),
            "connect_timeout": timedelta(seconds=connect),
            "user_agent": "lidar-toolbox",
            "allow_http": parts.scheme == "http" or any(map(is_true, _ALLOW_HTTP)),
        },
        "retry_config": {
            "max_retries": retries,
            "retry_timeout": timedelta(seconds=4 * timeout),
            "backoff": {"init_backoff": timedelta(seconds=0.2)},
        },
    }
    if parts.scheme in ("http", "https"):
        folder, _, name = parts.path.rpartition("/")
        there = urlunsplit((parts.scheme, parts.netloc, folder or "/", parts.query, ""))
        return HTTPStore.from_url(there, **how), unquote(name)
    key = unquote(parts.path.lstrip("/"))
    stores = {"s3": S3Store, "gs": GCSStore, "az": AzureStore}
    how["config"] = credentials.of(parts.scheme)
    with _named_settings(parts.scheme):
        return stores[parts.scheme](parts.netloc, **how), key


@contextmanager
def _named_settings(scheme: str) -> Iterator[None]:
    """Turn an error about keys, which may show them, into one that does not."""
    from obstore import exceptions

    try:
        yield
    except (exceptions.BaseError, ValueError):
        text = "keys, account or endpoint in the environment cannot be used"
        raise DataError(f"{scheme}://: {text}") from None


@contextmanager
def _named(address: Address) -> Iterator[None]:
    """Turn errors of obstore into those that a path raises, without what must stay secret.

    Their texts are not kept: they hold the address with its query, and headers.
    """
    from obstore import exceptions

    try:
        yield
    except exceptions.NotFoundError:
        text = "there is no such file on the server"
        raise FileNotFoundError(errno.ENOENT, text, str(address)) from None
    except exceptions.PreconditionError:
        raise DataError(f"{address} {CHANGED}") from None
    except (exceptions.PermissionDeniedError, exceptions.UnauthenticatedError):
        text = "the server refuses access; are the credentials right?"
        raise PermissionError(errno.EACCES, text, str(address)) from None
    except exceptions.NotSupportedError:
        text = "the server does not answer to ranges of bytes; download it first"
        raise OSError(errno.EIO, text, str(address)) from None
    except (exceptions.BaseError, ValueError) as error:
        raise OSError(errno.EIO, _reason(str(error)), str(address)) from None


def _reason(text: str) -> str:
    """What an error says that is fit to be told."""
    lower = text.lower()
    kinds = set(_KIND.findall(text))
    if found := _STATUS.search(text):
        return f"the server answers with status {found[1]}"
    if "dns error" in lower:
        return "there is no such server"
    if "Timeout" in kinds or "timed out" in lower or "timedout" in lower:
        return f"the server does not answer within {TIMEOUT:g} s"
    if "Connect" in kinds:
        return "the server cannot be reached"
    if "range" in lower:
        return "the server does not answer to ranges of bytes; download it first"
    return "the server breaks off, or its answer is not understood"
