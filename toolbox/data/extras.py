"""Optional libraries: what needs each of them, and the extra that installs it."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from toolbox.errors import DataError


@dataclass(frozen=True)
class Extra:
    """A library that is needed for one thing, and not installed with the toolbox.

    Attributes
    ----------
    what : is not to be had without it
    library : name under which it is imported
    name : of the extra, as in ``pip install lidar-toolbox[name]``
    """

    what: str
    library: str
    name: str

    def missing(self) -> str | None:
        """How to get the library; None if it is there."""
        if find_spec(self.library) is not None:
            return None
        return f"{self.what} needs {self.library}: pip install lidar-toolbox[{self.name}]"

    def need(self) -> None:
        """Raise an error unless the library is there.

        Raises
        ------
        DataError
            Says how to get it.
        """
        if text := self.missing():
            raise DataError(text)


E57 = Extra("E57", "pye57", "e57")
ISO = Extra("Metadata after ISO 19115", "pygeometa", "metadata")
PARQUET = Extra("Parquet", "pyarrow", "parquet")
PDF = Extra("PDF", "weasyprint", "pdf")
PLY = Extra("PLY", "plyfile", "ply")
