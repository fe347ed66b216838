"""Whether coordinates can be in the CRS that they are said to be in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from toolbox.data.crs import describe_crs, horizontal_crs
from toolbox.data.lattice import in_plan

MARGIN = 3.0  # degrees, half a UTM zone: at its edge surveys keep the zone they began in
ROUND = 1.0  # degrees that rasters of the whole Earth may reach beyond it
WIDEST = 2.0  # degrees, some 200 km: wider data near the origin are rather metres of a local one
LONGITUDE, LATITUDE = 360.0, 90.0  # the largest in use; some count longitudes from 0 to 360


class Misplaced(NamedTuple):
    """What is wrong with coordinates in a CRS.

    Attributes
    ----------
    text : continues a sentence that begins with the name of the file
    in_other_unit : they cannot be right or are degrees; otherwise they only lie far away
    """

    text: str
    in_other_unit: bool


def misplaced(crs: CRS | None, bounds: Sequence[float]) -> Misplaced | None:
    """Say why coordinates cannot be, or hardly are, in a CRS; None if they may be.

    A single stray point makes no difference: all of the bounds must lie where they should not.
    Local CRS have no place, and a CRS without a known area of use may be anywhere.

    Parameters
    ----------
    bounds : (xmin, ymin, xmax, ymax), or with heights as a point cloud has them

    Examples
    --------
    >>> misplaced(CRS(32635), (500_000, 4_600_000, 501_000, 4_601_000)) is None
    True
    >>> misplaced(CRS(32635), (29.01, 41.0, 29.02, 41.01)).in_other_unit
    True
    """
    bounds = in_plan(bounds)
    if crs is None or not np.isfinite(bounds).all():
        return None
    horizontal, (xmin, ymin, xmax, ymax) = horizontal_crs(crs), bounds
    where = f"has x from {xmin:.10g} to {xmax:.10g} and y from {ymin:.10g} to {ymax:.10g}"
    if horizontal.is_geographic and _beyond(bounds):
        text = f"{where}, which are no degrees, as {describe_crs(crs)} has them"
        return Misplaced(f"{text}; state the CRS in which they are", True)
    area = _area_of_use(horizontal) if horizontal.is_projected else None
    near_origin = max(-xmin, xmax) <= LONGITUDE and max(-ymin, ymax) <= LATITUDE
    if area is None or not _outside(horizontal, area, bounds, 0.0 if near_origin else MARGIN):
        return None
    outside = f"outside the area of use of {describe_crs(crs)} ({_text(area)})"
    if not near_origin:
        return Misplaced(f"{where}, far {outside}; is that its CRS, and x the easting?", False)
    sure = max(xmax - xmin, ymax - ymin) <= WIDEST
    what = "look like degrees" if sure else "look like degrees or metres from a local origin"
    advice = "state the CRS in which they are, such as EPSG:4326, or local for plain metres"
    return Misplaced(f"{where}, which {what}, and lies {outside}; {advice}", sure)


def reaching_beyond(source: CRS, target: CRS, bounds: Sequence[float]) -> str:
    """What part of bounds is far outside the area of use of another CRS, in words; "" if none is.

    Parameters
    ----------
    source : of the bounds, xmin, ymin, xmax, ymax

    Examples
    --------
    >>> reaching_beyond(CRS(4326), CRS(32635), (25, 40, 31, 45))
    ''
    >>> reaching_beyond(CRS(4326), CRS(32635), (-180, -90, 180, 90)).partition(" of it")[0]
    'about 99 %'
    """
    horizontal = horizontal_crs(target)
    area = _area_of_use(horizontal) if horizontal.is_projected else None
    if area is None or not np.isfinite(bounds).all():
        return ""
    inside = _inside(horizontal_crs(source), area, bounds, MARGIN, 21)
    if inside.all():
        return ""
    where = f"the area of use of {describe_crs(horizontal)} ({_text(area)})"
    percent = min(max(round(100 * (1 - inside.mean())), 1), 99)
    share = f"about {percent} % of it is far outside {where}"
    return f"{share}; lengths and areas there are wrong, or it is not there at all"


def centre_in_degrees(crs: CRS | None, bounds: Sequence[float]) -> tuple[float, float] | None:
    """Longitude and latitude of the middle of bounds; None if the CRS has no place on the Earth.

    Who knows where a survey was flown sees by them that its CRS is wrong.

    Examples
    --------
    >>> [round(v, 2) for v in centre_in_degrees(CRS(32635), (500_000, 0, 500_000, 1000))]
    [27.0, 0.0]
    >>> centre_in_degrees(None, (0, 0, 1, 1)) is None
    True
    """
    bounds = in_plan(bounds)
    if crs is None or not np.isfinite(bounds).all():
        return None
    horizontal, (xmin, ymin, xmax, ymax) = horizontal_crs(crs), bounds
    if not (horizontal.is_projected or horizontal.is_geographic) or misplaced(crs, bounds):
        return None
    try:
        to_degrees = Transformer.from_crs(horizontal, CRS(4326), always_xy=True)
    except ProjError:  # of another celestial body
        return None
    east, north = to_degrees.transform((xmin + xmax) / 2, (ymin + ymax) / 2)
    return (float(east), float(north)) if np.isfinite([east, north]).all() else None


def _text(area: Any) -> str:
    """The longitudes and latitudes of an area."""
    return f"{area.west:g} to {area.east:g} E, {area.south:g} to {area.north:g} N"


def _beyond(bounds: Sequence[float]) -> bool:
    """Whether no part of the bounds has longitudes and latitudes."""
    xmin, ymin, xmax, ymax = bounds
    far = xmin > LONGITUDE + ROUND or xmax < -LONGITUDE - ROUND
    return far or ymin > LATITUDE + ROUND or ymax < -LATITUDE - ROUND


def _area_of_use(crs: CRS) -> Any:
    """The area of use (a pyproj AreaOfUse), also of a CRS whose definition comes without; or None.

    That of the registered CRS which it equals in all but names is taken then.
    """
    if crs.area_of_use is not None:
        return crs.area_of_use
    code = crs.to_authority()
    return CRS.from_authority(*code).area_of_use if code else None


def _outside(crs: CRS, area: Any, bounds: Sequence[float], margin: float) -> bool:
    """Whether the corners, the middles of the edges and the centre are all outside an area."""
    return not _inside(crs, area, bounds, margin, 3).any()


def _inside(
    crs: CRS, area: Any, bounds: Sequence[float], margin: float, count: int
) -> NDArray[np.bool_]:
    """Which of count * count places, spread over bounds, are inside an area."""
    xmin, ymin, xmax, ymax = bounds
    x, y = np.meshgrid(np.linspace(xmin, xmax, count), np.linspace(ymin, ymax, count))
    to_degrees = Transformer.from_crs(crs, CRS(4326), always_xy=True)
    east, north = (np.asarray(v, float) for v in to_degrees.transform(x.ravel(), y.ravel()))
    width = (area.east - area.west) % 360 or 360.0  # an area may cross the meridian of 180 degrees
    with np.errstate(invalid="ignore"):  # where a projection ends it gives infinity
        inside: NDArray[np.bool_] = (east - area.west + margin) % 360 <= width + 2 * margin
    inside &= (north >= area.south - margin) & (north <= area.north + margin)
    return inside
