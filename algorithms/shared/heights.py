"""The attribute for heights above ground, and checks that points and rasters hold heights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from toolbox.data import PointCloud, Raster
from toolbox.data.crs import length_problem, vertical_unit
from toolbox.errors import DataError

HEIGHT = "HeightAboveGround"  # attribute of points, named as in other programs
# Names of units as other programs write them; ours are those of `vertical_unit`.
_SPELT = {
    **dict.fromkeys(("m", "meter", "meters", "metres"), "metre"),
    **dict.fromkeys(("ft", "feet"), "foot"),
    **dict.fromkeys(("us-ft", "us ft", "ftus"), "us survey foot"),
}


def given_heights(cloud: PointCloud) -> NDArray[np.float64]:
    """Heights above the ground that the points have, in metres; NaN where not known.

    Raises
    ------
    DataError
        Some are infinite.

    Examples
    --------
    >>> given_heights(PointCloud(np.zeros((2, 3)), {HEIGHT: np.array([0.5, np.nan])}))
    array([0.5, nan])
    """
    height = np.asarray(cloud[HEIGHT], float) / cloud.metre
    if infinite := np.count_nonzero(np.isinf(height)):
        raise DataError(
            f"points: {HEIGHT} of {cloud.name} must be a number, or NaN where it is not known, "
            f"but is infinite for {infinite}"
        )
    return height


def heights_problem(raster: Raster) -> str | None:
    """The problem if a raster is not one band of heights in the unit of its coordinates, or None.

    A band without a unit is taken to have that of the coordinates. The text continues a sentence
    that begins with the name of the raster.

    Examples
    --------
    >>> from pyproj import CRS
    >>> from toolbox.data import Lattice
    >>> lattice = Lattice(0, 2, 1.0, 2, 2)
    >>> feet = Raster.from_lattice(np.ones((2, 2)), lattice, crs=CRS(32635), units=("foot",))
    >>> heights_problem(feet)
    'holds values in foot, not in metre as its coordinates; convert them'
    """
    if len(raster.values) != 1:
        return f"has {len(raster.values)} bands; choose one with the option band"
    if text := length_problem(raster.crs) or infinity_problem(raster):
        return text
    unit, plane = raster.units[0].lower(), vertical_unit(raster.crs)
    if unit and _SPELT.get(unit, unit) != plane.lower():
        return f"holds values in {raster.units[0]}, not in {plane} as its coordinates; convert them"
    return None


def infinity_problem(raster: Raster) -> str | None:
    """The problem if a raster holds infinite values, or None; NaN is nodata. Continues a sentence.

    Examples
    --------
    >>> from toolbox.data import Lattice
    >>> lattice = Lattice(0, 1, 1.0, 1, 2)
    >>> infinity_problem(Raster.from_lattice(np.array([[1, np.inf]]), lattice, crs=None))
    'holds infinite values; set them to nodata'
    """
    if raster.values.dtype.kind == "f" and np.isinf(raster.values).any():
        return "holds infinite values; set them to nodata"
    return None
