"""What is learned of files while they are read: the SHA-256 of each, and the record it carries."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from toolbox.context import QUIET, Context
from toolbox.errors import DataError

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

_BLOCK = 2**22  # bytes hashed between two reports of progress, some milliseconds


@dataclass
class Reading:
    """What is known of the files of a run.

    Attributes
    ----------
    hashes : SHA-256 of each file, as hexadecimal digits
    sizes : bytes in each file that is hashed
    records : how each file was made, as JSON text, or ""; see `toolbox.data.record`
    """

    hashes: dict[Path, str] = field(default_factory=dict)
    sizes: dict[Path, int] = field(default_factory=dict)
    records: dict[Path, str] = field(default_factory=dict)

    def hash_of(self, path: Path, ctx: Context = QUIET) -> str:
        """The hash of a file, which is read for it only if it was not read before.

        Raises
        ------
        DataError
            It cannot be read.
        """
        if path not in self.hashes:
            self.hashes[path], self.sizes[path] = _hashed(path, ctx)
        return self.hashes[path]


@contextmanager
def opened(
    path: Path, reading: Reading | None, ctx: Context = QUIET
) -> Iterator[io.BufferedReader]:
    """Open a file to read it; the hash of its bytes is noted, where it is wanted.

    The reader may go to and fro, and skip bytes, which are read at the end. The hash is of the
    bytes as they were read, also if the file is changed meanwhile.

    Parameters
    ----------
    reading : where the hash is noted; None if nobody asks for it
    ctx : asked whether to stop while skipped bytes are read
    """
    with path.open("rb", buffering=0) as file:  # stays open if the reader closes what it is given
        if reading is None or path in reading.hashes:
            yield io.BufferedReader(io.FileIO(file.fileno(), closefd=False))
            return
        hashed = _HashedFile(file.fileno(), closefd=False)
        yield io.BufferedReader(hashed)
        reading.hashes[path] = hashed.digest(file, ctx)
        reading.sizes[path] = hashed.size


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
