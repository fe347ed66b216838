"""Optional libraries: what needs each of them, and how to get it.

Messages name the library itself: the toolbox may have come as a file, and its own name need not be
that of a package on an index.
"""

from __future__ import annotations

from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from io import StringIO

from toolbox.errors import DataError


@dataclass(frozen=True)
class Extra:
    """A library that is needed for one thing, and not installed with the toolbox.

    Attributes
    ----------
    what : is not to be had without it
    library : its name, under which it is imported and installed
    system : the library of the system that it needs, and how to get that; "" for none
    """

    what: str
    library: str
    system: str = ""

    def missing(self) -> str | None:
        """How to get the library; None if it is there."""
        if find_spec(self.library) is None:
            return f"{self.what} needs {self.library}: pip install {self.library}"
        if self.system:
            try:
                with redirect_stdout(StringIO()):  # where WeasyPrint explains at length
                    import_module(self.library)
            except OSError:
                return f"{self.what} needs {self.system}"
        return None

    def need(self) -> None:
        """Raise an error unless the library is there.

        Raises
        ------
        DataError
            Says how to get it.
        """
        if text := self.missing():
            raise DataError(text)


E57 = Extra("E57", "pye57")
IFC = Extra("IFC", "ifcopenshell")
ISO = Extra("Metadata after ISO 19115", "pygeometa")
PARQUET = Extra("Parquet", "pyarrow")
PDF = Extra(
    "PDF",
    "weasyprint",
    "Pango, of the system: apt install libpango-1.0-0 libpangoft2-1.0-0, brew install pango",
)
PLY = Extra("PLY", "plyfile")
