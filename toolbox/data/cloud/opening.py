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
from toolbox.data.reading import Reading
from toolbox.data.remote.address import Address

COARSE = 1e-3  # in the unit of the data: smaller steps are below what scanners measure

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


def rounded_to_single(xyz: NDArray[np.float64]) -> str | None:
    """What single precision has done to coordinates, as a clause; None where nothing is seen.

    Numbers of 32 bits hold 24 binary digits. Programs that keep coordinates of a map in them round
    these to steps such as 0.03125, and write them out with as many digits as they like.

    Parameters
    ----------
    xyz : array of shape (n, 3)

    Examples
    --------
    >>> scan = np.random.default_rng(0).uniform(0, 20, (99, 3)) + [500_000, 4_500_000, 100]
    >>> rounded_to_single(scan.astype(np.float32).astype(float))
    'its coordinates were rounded to single precision, x to 0.03125, y to 0.5'
    >>> rounded_to_single(scan.round(2)) is None
    True
    """
    steps = {}
    for name, values in zip("xyz", xyz.T, strict=True):
        with np.errstate(over="ignore"):
            single = values.astype(np.float32)
        if len(values) and np.array_equal(single, values):
            step = float(np.spacing(np.abs(single).max()))
            # Whole and quarter steps are those of many a regular grid, in any precision.
            steps[name] = step, bool((4 * values % 1).any())
    if not any(fine and step >= COARSE for step, fine in steps.values()):
        return None
    told = [f"{name} to {step:g}" for name, (step, _) in steps.items() if step >= COARSE]
    return f"its coordinates were rounded to single precision, {', '.join(told)}"
