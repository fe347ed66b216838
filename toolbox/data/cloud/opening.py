"""Reading point clouds from files of other formats than LAS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from toolbox.context import Context, log
from toolbox.data.paths import TEXT, local, named_as_given
from toolbox.data.precision import rounded_to_single
from toolbox.data.reading import Reading
from toolbox.data.remote.address import Address

Read = tuple[NDArray[np.float64], Mapping[str, NDArray[Any]], CRS | None]
"""Coordinates of shape (n, 3), attributes, and the CRS if the file states one."""


def read_other(
    path: Path,
    suffix: str,
    *,
    columns: Sequence[str] | None,
    separator: str | None,
    reading: Reading | None,
    ctx: Context,
) -> Read:
    """Read a file in the format of a suffix; see :meth:`PointCloud.open`."""
    here = local(path, ctx)
    known = None if isinstance(path, Address) else reading  # its version is noted
    crs: CRS | None = None
    with named_as_given(path):
        if suffix in TEXT:
            from toolbox.data.text import read_text

            xyz, attributes = read_text(
                here, columns=columns, separator=separator, reading=known, ctx=ctx
            )
        elif suffix == ".ply":
            from toolbox.data.ply import read_ply

            xyz, attributes, crs = read_ply(here, known)
        elif suffix == ".pcd":
            from toolbox.data.pcd import read_pcd

            xyz, attributes = read_pcd(here, known)
        elif suffix == ".ptx":
            from toolbox.data.ptx import read_ptx

            xyz, attributes = read_ptx(here, known, ctx)
        else:
            from toolbox.data.e57 import read_e57

            xyz, attributes, crs = read_e57(here, ctx=ctx)
    if text := rounded_to_single(xyz):
        log.warning("%s: %s", path.name, text)
    return xyz, attributes, crs
