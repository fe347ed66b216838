"""Reading files: within bounds, and with what is learned on the way, such as the SHA-256 of each.

A file of a few bytes may promise billions of points, or unpack to more than any disk holds. So what
a reader is about to do is compared with the size of the file before it begins.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import psutil

from toolbox.context import QUIET, Context
from toolbox.data.remote.address import Address
from toolbox.errors import DataError, MemoryShort, ToolboxError

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

CHANGED = "changed while the run was reading: the result would be a mixture; run it again"
_VAGUE = (LookupError, TypeError, AttributeError, NameError)  # whose texts name an object at best
_PANIC = "PanicException"  # of a library in Rust; it is no Exception, and has no public name
_BLOCK = 2**22  # bytes hashed between two reports of progress, some milliseconds
LONGEST = 2**20  # bytes of a line of text; a line of a thousand numbers has some 20 kB
_SMALL = 2**26  # bytes that a packed file may always unpack to
_PACKED = (
    100  # to one: further no file of points packs, as its coordinates differ; deflate makes 1032
)


@contextmanager
def errors_named(text: str) -> Iterator[None]:
    """Turn whatever a library raises on a file into a DataError that begins with a text.

    On a damaged file a library fails wherever it happens to fail, with an error of any type: a list
    of types is never complete. What we say of the file ourselves stays.

    Raises
    ------
    DataError
        Of any other error inside this context.

    Examples
    --------
    >>> with errors_named("a.json cannot be read as a table"):
    ...     {}["rows"]
    Traceback (most recent call last):
    toolbox.errors.DataError: a.json cannot be read as a table: KeyError: 'rows'
    """
    try:
        yield
    except ToolboxError:
        raise
    except MemoryError as error:
        raise DataError(f"{text}: it claims more than fits in memory") from error
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != _PANIC:
            raise
        raise DataError(f"{text}: {_said(error)}") from error


def _said(error: BaseException) -> str:
    """What an error says; with its type, where that says more."""
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, OSError):
        return error.strerror or str(error)
    telling = str(error) and not isinstance(error, _VAGUE)
    return str(error) if telling else f"{type(error).__name__}: {error}"


def need_memory(size: float, text: str, advice: str = "") -> None:
    """Raise a MemoryShort unless so many bytes are free; asked before they are set aside.

    A system that lends more memory than it has ends the process only when it is used.

    Raises
    ------
    MemoryShort
        Begins with the text, and ends with the advice.

    Examples
    --------
    >>> need_memory(1e6, "a raster of a million cells")
    """
    free = psutil.virtual_memory().available
    if size > free:
        have = f"{free / 1e9:.3g} GB are free"
        raise MemoryShort(f"{text} needs {size / 1e9:.3g} GB of memory, and {have}{advice}")


@dataclass
class Reading:
    """What is known of the files of a run.

    Attributes
    ----------
    hashes : SHA-256 of each file, as hexadecimal digits
    sizes : bytes in each file that is hashed
    records : how each file was made, as JSON text, or ""; see `toolbox.data.record`
    states : what the system said, before they were read, of files that are read more than once
    """

    hashes: dict[Path, str] = field(default_factory=dict)
    sizes: dict[Path, int] = field(default_factory=dict)
    records: dict[Path, str] = field(default_factory=dict)
    states: dict[Path, os.stat_result] = field(default_factory=dict)

    @classmethod
    def of(cls, paths: Iterable[Path]) -> Reading:
        """What is known before anything is read; files that are not there are left out."""
        return cls(states={path: path.stat() for path in paths if path.is_file()})

    def hash_of(self, path: Path, ctx: Context = QUIET) -> str:
        """The hash of a file, which is read for it only if it was not read before.

        Raises
        ------
        DataError
            It cannot be read.
        """
        if path not in self.hashes:
            known = _version(path) if isinstance(path, Address) else _hashed(path, ctx)
            self.hashes[path], self.sizes[path] = known
        return self.hashes[path]

    def check_unchanged(self, paths: Iterable[Path] | None = None) -> None:
        """Raise an error if files are not any more what they were before they were read.

        Parameters
        ----------
        paths : the files to look at; all unless given

        Raises
        ------
        DataError
            Names the files.
        """
        if changed := self.changed(paths):
            raise DataError(f"{', '.join(map(str, changed))} {CHANGED}")

    def changed(self, paths: Iterable[Path] | None = None) -> list[Path]:
        """Files that are not any more what they were before they were read.

        Other contents may have the same size and even the same time; so a file of which the system
        says anything else than before is hashed again. One that is gone was needed no longer.

        Parameters
        ----------
        paths : the files to look at; all unless given
        """
        known = self.states if paths is None else {*paths} & self.states.keys()
        return [path for path in sorted(known) if self._has_changed(path)]

    def _has_changed(self, path: Path) -> bool:
        before = self.states[path]
        try:
            now = path.stat()
        except FileNotFoundError:
            return False
        if state(now) != state(before):
            return True
        same = (now.st_ino, now.st_ctime_ns) == (before.st_ino, before.st_ctime_ns)
        if isinstance(path, Address):
            return False
        return not same and path in self.hashes and file_hash(path) != self.hashes[path]


def state(found: os.stat_result) -> tuple[int, int]:
    """Size and time of a file, in microseconds, as all computers that share a disk tell them."""
    return found.st_size, found.st_mtime_ns // 1000


@contextmanager
def opened(
    path: Path, reading: Reading | None, ctx: Context = QUIET
) -> Iterator[io.BufferedReader]:
    """Open a file to read it; the hash of its bytes is noted, where it is wanted.

    The reader may go to and fro, and skip bytes, which are read at the end.

    Parameters
    ----------
    reading : where the hash is noted; None if nobody asks for it
    ctx : asked whether to stop while skipped bytes are read

    Raises
    ------
    DataError
        The file was changed meanwhile.
    """
    if isinstance(path, Address):
        with path.open("rb") as stream:
            yield stream
        return
    with path.open("rb", buffering=0) as file:  # stays open if the reader closes what it is given
        before = state(os.fstat(file.fileno()))
        if reading is None or path in reading.hashes:
            yield io.BufferedReader(io.FileIO(file.fileno(), closefd=False))
        else:
            hashed = _HashedFile(file.fileno(), closefd=False)
            yield io.BufferedReader(hashed)
            found = hashed.digest(file, ctx), hashed.size
        if state(os.fstat(file.fileno())) != before:
            raise DataError(f"{path} {CHANGED}")
        if reading is not None and path not in reading.hashes:
            reading.hashes[path], reading.sizes[path] = found
            reading.states.pop(path, None)  # all of it is read: what becomes of it is no matter


def _version(address: Address) -> tuple[str, int]:
    """What stands for the hash of a file on the web, of which not all is read; and its size."""
    try:
        found = address.stat()
    except OSError as error:
        raise DataError(f"{address} cannot be read: {error.strerror or error}") from error
    says = f"{address} {found.st_mtime_ns} {found.st_size}"
    return f"version {hashlib.sha256(says.encode()).hexdigest()}", found.st_size


def announced(stream: BinaryIO, ranges: Iterable[tuple[int, int]], ctx: Context = QUIET) -> None:
    """Tell which ranges (start, size) will be read, so that a stream on the web fetches them.

    Raises
    ------
    OSError, DataError
        They cannot be had.
    """
    fetch = getattr(getattr(stream, "raw", None), "prefetch", None)
    if fetch is not None:
        fetch(ranges, ctx)


def room(path: Path) -> int:
    """Bytes that a file may hold when it is unpacked; without .gz those that it has."""
    size = path.stat().st_size
    return max(_SMALL, _PACKED * size) if path.suffix.lower() == ".gz" else size


def unpacked(file: BinaryIO, path: Path, *, lines: bool = False) -> io.BufferedReader:
    """The content of an open file, unpacked as it is read if its name ends in .gz.

    Reading raises a DataError where a packed file goes beyond its `room`, and where a line of a
    text has more than `LONGEST` bytes.

    Parameters
    ----------
    lines : whether the content is text
    """
    packed = path.suffix.lower() == ".gz"
    content = gzip.GzipFile(fileobj=file) if packed else file
    return io.BufferedReader(_Bounded(content, path, lines), LONGEST)


class _Bounded(io.RawIOBase):
    """Reads a stream up to the room of its file, and no longer lines than it may have."""

    def __init__(self, content: BinaryIO | gzip.GzipFile, path: Path, lines: bool) -> None:
        self._content, self._path, self._lines = content, path, lines
        self._left, self._line = room(path), 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: WriteableBuffer) -> int:
        data = self._content.read(min(len(memoryview(buffer)), LONGEST))
        memoryview(buffer)[: len(data)] = data
        self._left -= len(data)
        if self._left < 0:
            text = f"unpacks to more than {room(self._path):,} bytes, as no file of points does"
            raise DataError(f"{self._path} {text}")
        if self._lines:
            self._measure(data)
        return len(data)

    def _measure(self, data: bytes) -> None:
        """Add up the line that goes on from one block of bytes to the next."""
        ends = [at for end in (b"\n", b"\r") for at in (data.find(end), data.rfind(end)) if at >= 0]
        if self._line + min(ends, default=len(data)) > LONGEST:
            raise DataError(f"{self._path} has a line of more than {LONGEST:,} bytes")
        self._line = len(data) - max(ends) if ends else self._line + len(data)


def file_hash(path: Path, ctx: Context = QUIET) -> str:
    """The SHA-256 of a file, as hexadecimal digits.

    Raises
    ------
    DataError
        It cannot be read.
    """
    return _hashed(path, ctx)[0]


def _hashed(path: Path, ctx: Context) -> tuple[str, int]:
    """The hash of a file, and how many bytes it is of."""
    made, done = hashlib.sha256(), 0
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            while block := stream.read(_BLOCK):
                made.update(block)
                done += len(block)
                ctx.progress(min(done / max(size, 1), 1.0))
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error
    return made.hexdigest(), done


class _HashedFile(io.FileIO):
    """A file whose bytes are hashed when they are read, in whatever order that happens."""

    def __init__(self, file: int, *, closefd: bool) -> None:
        super().__init__(file, closefd=closefd)
        self._hash = hashlib.sha256()
        self._done = 0  # bytes from the start that are in the hash
        self._ahead: list[tuple[int, bytes]] = []  # what was read beyond, and where it begins

    def readinto(self, buffer: WriteableBuffer) -> int:
        start, view = self.tell(), memoryview(buffer)
        count = super().readinto(view)
        self._note(start, view[:count])
        return count

    def readall(self) -> bytes:
        start, data = self.tell(), super().readall()
        self._note(start, memoryview(data))
        return data

    def _note(self, start: int, data: memoryview) -> None:
        """Hash those bytes that are not hashed yet; keep those whose turn has not come."""
        if start > self._done:
            self._ahead.append((start, bytes(data)))
            return
        new = data[self._done - start :]
        self._hash.update(new)
        self._done += len(new)

    @property
    def size(self) -> int:
        """Bytes from the start that are hashed."""
        return self._done

    def digest(self, file: io.FileIO, ctx: Context) -> str:
        """The hash of the whole file.

        Parameters
        ----------
        file : the same, from which the bytes are read that were skipped
        """
        for start, data in sorted(self._ahead):
            self._fill(file, start, ctx)
            self._note(start, memoryview(data))
        self._fill(file, None, ctx)
        return self._hash.hexdigest()

    def _fill(self, file: io.FileIO, end: int | None, ctx: Context) -> None:
        """Hash what was skipped before a place, or up to the end."""
        file.seek(self._done)
        while block := file.read(_BLOCK if end is None else max(0, min(_BLOCK, end - self._done))):
            self._note(self._done, memoryview(block))
            ctx.progress(1.0)
