"""Points in E57 files (ASTM E2807); read only, and with the optional pye57."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.exceptions import CRSError

from toolbox.context import QUIET, Context, log
from toolbox.data.extras import E57
from toolbox.data.reading import errors_named
from toolbox.errors import DataError

_COLOURS = {"red": "Red", "green": "Green", "blue": "Blue"}
_FULL = 65535  # 16 bit, as LAS has intensities and colours
_BITS = 8  # of a byte; a point has one or more
_ROUNDING = 1e-6  # of the range of values, by which they may go beyond it


def read_e57(
    path: Path, *, ctx: Context = QUIET
) -> tuple[NDArray[np.float64], dict[str, NDArray[Any]], CRS | None]:
    """Read all scans of a file, each transformed by its pose.

    Points that the scanner marked as invalid are left out. `point_source_id` tells the scans
    apart: 1, 2, ... Intensity and colours are stretched from the limits that the file states to
    16 bit; without limits intensity stays as it is. Limits that values go beyond are widened to
    these, and what only some scans have is left out; the log says so.

    Returns
    -------
    xyz : of shape (n, 3), metres
    attributes : point_source_id, and intensity, red, green, blue if there
    crs : that the file states, or None

    Raises
    ------
    DataError
        The file is damaged, or pye57 is not installed.
    """
    E57.need()
    import pye57

    with errors_named(f"{path} cannot be read as an E57 file"), pye57.E57(str(path)) as file:
        scans = []
        for index in range(file.scan_count):
            ctx.progress(index / file.scan_count)
            scans.append(_scan(file, index, _BITS * path.stat().st_size))
        crs = _crs(file, path.name)
    if not scans:
        raise DataError(f"{path} has no scans")
    names = [name for name in scans[0] if all(name in scan for scan in scans)]
    if partial := {name for scan in scans for name in scan} - set(names):
        log.warning("%s: not all scans have %s; left out", path.name, ", ".join(sorted(partial)))
    merged = {name: np.concatenate([scan[name] for scan in scans]) for name in names}
    return merged.pop("xyz"), merged, crs


def _scan(file: Any, index: int, most: int) -> dict[str, NDArray[Any]]:
    """Read a scan of at most so many points."""
    header = file.get_header(index)
    if header.point_count > most:
        raise ValueError(f"scan {index + 1} promises {header.point_count} points in {most} bits")
    if not {"cartesianX", "sphericalRange"} & set(header.point_fields):
        raise ValueError(f"scan {index + 1} has neither cartesian nor spherical coordinates")
    data = file.read_scan(index, intensity=True, colors=True, ignore_missing_fields=True)
    xyz = np.column_stack([data[f"cartesian{axis}"] for axis in "XYZ"]).astype(np.float64)
    scan: dict[str, NDArray[Any]] = {
        "xyz": xyz,
        "point_source_id": np.full(len(xyz), index + 1, np.uint16),
    }
    if "intensity" in data:
        limits = _limits(header, "intensity")
        scan["intensity"] = _stretched("intensity", data["intensity"], limits)
    for name, field in _COLOURS.items():
        if f"color{field}" in data:
            limits = _limits(header, f"color{field}") or (0.0, 255.0)
            scan[name] = _stretched(name, data[f"color{field}"], limits)
    return scan


def _limits(header: Any, name: str) -> tuple[float, float] | None:
    """Least and greatest value of a field as the file states them; None if missing or equal."""
    group = "intensityLimits" if name == "intensity" else "colorLimits"
    if not header.node.isDefined(f"{group}/{name}Maximum"):
        return None
    low, high = (float(header[group][f"{name}{end}"].value()) for end in ("Minimum", "Maximum"))
    return (low, high) if low < high else None


def _stretched(name: str, values: NDArray[Any], limits: tuple[float, float] | None) -> NDArray[Any]:
    if limits is None:
        return values
    low, high = limits
    least, most = float(values.min(initial=low)), float(values.max(initial=high))
    # Values of single precision go beyond limits of double precision by a little.
    if min(least - low, high - most) < -_ROUNDING * (high - low):
        text = "%s goes from %g to %g, beyond the limits that the file states, %g to %g"
        log.warning(text, name, least, most, low, high)
    return np.rint((values.astype(np.float64) - least) / (most - least) * _FULL).astype(np.uint16)


def _crs(file: Any, name: str) -> CRS | None:
    if not file.root.isDefined("coordinateMetadata"):
        return None
    text = file.root["coordinateMetadata"].value().strip()
    try:
        return CRS.from_wkt(text) if text else None
    except CRSError as error:
        log.warning("%s: its CRS cannot be understood: %s", name, error)
        return None
