"""Addresses of files on the web, which are read like the paths of files on this computer."""

from __future__ import annotations

import hashlib
import io
import os
import stat
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urljoin, urlsplit, urlunsplit

SCHEMES = ("https", "http", "s3", "gs", "az")
"""What addresses of files that can be read begin with."""


def is_remote(path: str | Path) -> bool:
    """Whether a path is an address of something that is not on this computer.

    >>> is_remote("https://example.org/a.laz"), is_remote("file:///a.laz"), is_remote("C:/a.laz")
    (True, False, False)
    """
    return "://" in str(path) and urlsplit(str(path)).scheme not in ("", "file")


def as_path(path: str | Path) -> Path:
    """An address for a text that is one, else a plain path."""
    if isinstance(path, Address):
        return path
    return Address(str(path)) if is_remote(path) else Path(path)


class Address(type(Path())):  # type: ignore[misc]  # PosixPath or WindowsPath
    """An address that can be read wherever a path can: its size, its beginning, any part of it.

    As a text it shows neither the user nor the query, where keys and signatures stand.

    Attributes
    ----------
    url : as it was given

    Examples
    --------
    >>> found = Address("https://me:secret@example.org/a b/c.copc.laz?signature=secret")
    >>> print(found), found.name, found.suffix
    https://example.org/a b/c.copc.laz
    (None, 'c.copc.laz', '.laz')
    >>> print(found.joined("../d.laz"))
    https://example.org/d.laz
    """

    url: str

    def __new__(cls, url: str) -> Address:
        made = super().__new__(cls, url)
        made.url = str(url)
        return made  # type: ignore[no-any-return]

    def __reduce__(self) -> Any:
        return Address, (self.url,)

    def __str__(self) -> str:
        parts = urlsplit(self.url)
        return urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path, "", ""))

    def __repr__(self) -> str:
        return f"Address({str(self)!r})"

    def __fspath__(self) -> str:
        return str(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Address) and self.url == other.url

    def __hash__(self) -> int:
        return hash(self.url)

    def __lt__(self, other: Any) -> bool:
        return str(self) < str(other)

    @property
    def name(self) -> str:
        """The last part of the address."""
        return unquote(urlsplit(self.url).path.rpartition("/")[2])

    @property
    def parent(self) -> Address:
        """The address of the folder."""
        own = urlsplit(self.url)
        folder = own.path.rpartition("/")[0]
        return Address(urlunsplit((own.scheme, own.netloc, folder, own.query, "")))

    def joined(self, link: str) -> Address:
        """The address that a link in this file leads to; a relative one keeps the query."""
        if is_remote(link):
            return Address(link)
        own = urlsplit(self.url)
        plain = urlunsplit(("https", own.netloc, own.path, "", ""))  # urljoin knows few schemes
        there = urlsplit(urljoin(plain, link))
        return Address(urlunsplit((own.scheme, own.netloc, there.path, own.query, "")))

    # What a path answers --------------------------------------------------------------------------

    def stat(self, *, follow_symlinks: bool = True) -> os.stat_result:
        """Size, and a time that changes with the content.

        Raises
        ------
        OSError
            The server does not answer, or refuses.
        """
        from toolbox.data.remote.store import facts_of

        facts = facts_of(self)
        number = int.from_bytes(hashlib.sha256(self.url.encode()).digest()[:6])
        time = int.from_bytes(hashlib.sha256(facts.version.encode()).digest()[:4])
        mode = stat.S_IFREG | 0o444
        said = (mode, number, 0, 1, 0, 0, facts.size, time, time, time)
        return os.stat_result(said, {"st_mtime_ns": time * 10**9, "st_ctime_ns": time * 10**9})

    def exists(self) -> bool:
        """Whether there is a file.

        Raises
        ------
        OSError
            The server does not answer, or refuses.
        """
        try:
            self.stat()
        except FileNotFoundError:
            return False
        return True

    def is_file(self) -> bool:
        return self.exists()

    def is_dir(self) -> bool:
        return False

    def is_symlink(self) -> bool:
        return False

    def resolve(self, strict: bool = False) -> Address:
        return self

    def absolute(self) -> Address:
        return self

    def samefile(self, other_path: Any) -> bool:
        return bool(self == other_path)

    def open(self, mode: str = "r", buffering: int = -1, *_: Any, **how: Any) -> Any:
        """Open the file to read it.

        Raises
        ------
        OSError
            It cannot be read, or is to be written.
        """
        from toolbox.data.remote.stream import RangeFile

        if set(mode) & set("wax+"):
            raise PermissionError(1, "nothing is written to the web", str(self))
        raw = RangeFile(self)
        if buffering == 0:
            return raw
        found = io.BufferedReader(raw)
        return found if "b" in mode else io.TextIOWrapper(found, how.get("encoding", "utf-8"))

    def read_bytes(self) -> bytes:
        with self.open("rb") as stream:
            found: bytes = stream.read()
        return found

    def read_text(self, encoding: str | None = None, errors: str | None = None) -> str:
        return self.read_bytes().decode(encoding or "utf-8", errors or "strict")
