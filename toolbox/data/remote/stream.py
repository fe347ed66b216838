"""A file on the web as a stream: ranges are fetched when they are read, and kept on the disk."""

from __future__ import annotations

import hashlib
import io
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from toolbox import places
from toolbox.context import QUIET, Context, log
from toolbox.data.remote.address import Address
from toolbox.data.remote.store import Facts, facts_of, fetched
from toolbox.errors import DataError

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

FOLDER_VARIABLE, LIMIT_VARIABLE = "TOOLBOX_REMOTE_CACHE", "TOOLBOX_REMOTE_CACHE_LIMIT"
LIMIT = 5e9  # bytes of all that is kept
AHEAD = 2**14  # bytes that are fetched at least, unless they are there
_PIECE = 2**22  # bytes of one request: a minute of a line of half a megabit
_GAP = 2**14  # bytes between two ranges that are fetched with them, rather than asked for apart
_AT_ONCE = 8  # requests

Span = tuple[int, int]
"""A range of bytes: from the first up to, but without, the second."""


class RangeFile(io.RawIOBase):
    """A file on the web; what is read of it is fetched, and kept on the disk for the next time.

    Each version of a file has a folder of its own, with a file for each range. So several processes
    can share it, and nothing that is kept is ever changed.
    """

    def __init__(self, address: Address) -> None:
        super().__init__()
        self._address, self._facts = address, facts_of(address)
        self._at, self._moved, self._requests = 0, len(self._facts.first), 1
        self._folder = _folder_of(address, self._facts)
        self._spans = sorted(_kept(self._folder))
        if self._facts.first:
            self._keep(0, self._facts.first)

    @property
    def size(self) -> int:
        """Bytes of the whole file."""
        return self._facts.size

    @property
    def moved(self) -> int:
        """Bytes that have come from the server."""
        return self._moved

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = 0) -> int:
        self._at = offset + (0, self._at, self.size)[whence]
        return self._at

    def readinto(self, buffer: WriteableBuffer) -> int:
        view = memoryview(buffer).cast("B")
        stop = min(self._at + len(view), self.size)
        if stop <= self._at:
            return 0
        self.prefetch([(self._at, stop - self._at)])
        done = 0
        while self._at + done < stop:
            data = self._read_kept(self._at + done, stop)
            view[done : done + len(data)] = data
            done += len(data)
        self._at = stop
        return done

    def prefetch(self, ranges: Iterable[tuple[int, int]], ctx: Context = QUIET) -> None:
        """Fetch ranges (start, size) that will be read, several at the same time.

        Raises
        ------
        OSError
            They cannot be had.
        DataError
            The file has changed.
        """
        pieces = list(self._missing(ranges))
        if not pieces:
            return
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            work = [pool.submit(fetched, self._address, self._facts, *piece) for piece in pieces]
            try:
                for number, (piece, job) in enumerate(zip(pieces, work, strict=True)):
                    self._keep(piece[0], job.result())
                    self._moved += piece[1] - piece[0]
                    self._requests += 1
                    ctx.progress(number / len(pieces))
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise

    def _missing(self, ranges: Iterable[tuple[int, int]]) -> Iterator[Span]:
        """The pieces to ask for, so that these ranges are there: at least AHEAD bytes each."""
        wanted: list[Span] = []
        for start, size in sorted(ranges):
            for low, high in _without((start, min(start + size, self.size)), self._spans):
                reach = min(max(high, low + AHEAD), self.size)
                if wanted and low - wanted[-1][1] <= _GAP:
                    wanted[-1] = wanted[-1][0], max(wanted[-1][1], reach)
                else:
                    wanted.append((low, reach))
        for low, high in wanted:
            yield from ((at, min(at + _PIECE, high)) for at in range(low, high, _PIECE))

    def _keep(self, start: int, data: bytes) -> None:
        span = start, start + len(data)
        path = self._folder / _name(span)
        if not path.exists():
            draft = path.with_name(f".{path.name}.{os.getpid()}")
            draft.write_bytes(data)
            draft.replace(path)
        if span not in self._spans:
            self._spans = sorted([*self._spans, span])

    def _read_kept(self, start: int, stop: int) -> bytes:
        """Bytes from a start on, as many as one kept range has up to a stop."""
        span = next(span for span in self._spans if span[0] <= start < span[1])
        try:
            with (self._folder / _name(span)).open("rb") as stream:
                stream.seek(start - span[0])
                data = stream.read(min(stop, span[1]) - start)
        except FileNotFoundError:  # another process has made room
            self._folder.mkdir(parents=True, exist_ok=True)
            data = fetched(self._address, self._facts, start, min(stop, span[1]))
        return data

    def close(self) -> None:
        if not self.closed:
            moved, size = self._moved / 1e6, self.size / 1e6
            text = "%s: %.3g of %.3g MB read in %d requests"
            log.info(text, self._address, moved, size, self._requests)
            make_room(self._folder)
        super().close()


def whole(address: Address, ctx: Context = QUIET) -> Path:
    """A copy of a file on this computer, for what can read nothing else; kept as ranges are.

    Raises
    ------
    OSError
        It cannot be had.
    DataError
        The file has changed meanwhile.
    """
    with RangeFile(address) as stream:
        path = stream._folder / "whole" / address.name
        if not (path.exists() and path.stat().st_size == stream.size):
            stream.prefetch([(0, stream.size)], ctx)
            path.parent.mkdir(exist_ok=True)
            draft = path.with_name(f".{path.name}.{os.getpid()}")
            with draft.open("wb") as target:
                shutil.copyfileobj(io.BufferedReader(stream), target, _PIECE)
            draft.replace(path)
    return path


def folder() -> Path:
    """Folder in which ranges of files are kept."""
    return places.cache(FOLDER_VARIABLE, "remote")


def limit() -> float:
    """Largest size of all that is kept, in bytes.

    Raises
    ------
    DataError
        The environment says something else than a number.
    """
    said = os.environ.get(LIMIT_VARIABLE, str(LIMIT))
    try:
        return float(said)
    except ValueError:
        raise DataError(f"{LIMIT_VARIABLE} must be a number of bytes, got {said!r}") from None


def make_room(used: Path) -> None:
    """Remove what was not used for longest, until what is kept is within the limit.

    Parameters
    ----------
    used : a folder that is in use, which goes last
    """
    there = [path for path in folder().iterdir() if path.is_dir()] if folder().is_dir() else []
    sizes = {path: _size(path) for path in there}
    total = sum(sizes.values())
    for path in sorted(there, key=lambda path: (path == used, _time(path))):
        if total <= limit():
            return
        shutil.rmtree(path, ignore_errors=True)
        total -= sizes[path]


def _folder_of(address: Address, facts: Facts) -> Path:
    """The folder of this version of a file; a temporary one if its versions cannot be told apart.

    The query of an address is no part of the name: signatures change, what is signed does not.
    """
    if not facts.version:
        return Path(tempfile.mkdtemp(prefix="lidar-toolbox-"))
    says = f"{address}\n{facts.version}"
    found = folder() / hashlib.sha256(says.encode()).hexdigest()[:32]
    found.mkdir(parents=True, exist_ok=True, mode=0o700)
    folder().chmod(0o700)
    os.utime(found)
    return found


def _kept(place: Path) -> Iterator[Span]:
    for path in place.iterdir():
        start, sign, stop = path.name.partition("-")
        if sign and not path.name.startswith("."):
            yield int(start, 16), int(stop, 16)


def _name(span: Span) -> str:
    return f"{span[0]:x}-{span[1]:x}"


def _without(span: Span, there: list[Span]) -> Iterator[Span]:
    """The parts of a range that are not in others, which are sorted."""
    low, high = span
    for start, stop in there:
        if stop <= low or start >= high:
            continue
        if start > low:
            yield low, start
        low = max(low, stop)
    if low < high:
        yield low, high


def _size(place: Path) -> int:
    return sum(path.stat().st_size for path in place.rglob("*") if path.is_file())


def _time(place: Path) -> float:
    try:
        return place.stat().st_mtime
    except OSError:
        return 0.0
