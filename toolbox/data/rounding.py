"""Numbers of tables and features rounded to what measurements allow, for files that people read.

Columns say what they hold by their names, as `area`, `volume_m3`, `share` or `latitude`. All others
are lengths, heights and angles, which a survey does not know below a thousandth of their unit. A
column whose largest number would be left with one digit is in another unit, and keeps four. Of a
table of measures each row has the digits of its unit.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from toolbox.data.crs import horizontal_crs
from toolbox.data.measures import TELLING, row_digits, telling

if TYPE_CHECKING:
    import pandas as pd
    from pyproj import CRS

LENGTH = 3  # decimals of metres, feet and degrees of an angle
PLACE = 8  # decimals of a degree of latitude: 1 mm
_BY_NAME = (
    (re.compile(r"^(lat|lon|latitude|longitude)$", re.I), PLACE),
    (re.compile(r"(share|probability|confidence|certainty|kappa|iou)", re.I), 4),
    (re.compile(r"volume", re.I), 1),
    (re.compile(r"(area|_m2|_ft2|overlap)(_|$)", re.I), 2),
)


def rounded(frame: pd.DataFrame) -> pd.DataFrame:
    """The frame with its decimal numbers rounded; whole numbers, texts and geometries are kept.

    Examples
    --------
    >>> import pandas as pd
    >>> rounded(pd.DataFrame({"length": [217.19582], "area": [8983.73794], "share": [0.9584421]}))
        length     area   share
    0  217.196  8983.74  0.9584
    """
    import pandas as pd

    made = frame.copy()
    rows = row_digits(frame)
    for name in frame:
        column = frame[name]
        if column.dtype.kind == "f":
            counts = [_decimals(str(name), column)] * len(column) if rows is None else rows
            # As texts are: of 800.0975, a little less in binary, numpy would make 800.098.
            values = column.to_numpy(float, na_value=np.nan).tolist()
            exact = [round(value, n) for value, n in zip(values, counts, strict=True)]
            made[name] = pd.Series(exact, column.index, column.dtype)
    return made


def of_places(crs: CRS | None) -> int:
    """Decimals of coordinates: a millimetre."""
    return PLACE if crs is not None and horizontal_crs(crs).is_geographic else LENGTH


def _decimals(name: str, column: pd.Series[float]) -> int:
    usual = next((count for known, count in _BY_NAME if known.search(name)), LENGTH)
    sizes = np.abs(column.to_numpy(float, na_value=np.nan))
    largest = float(np.max(sizes, where=np.isfinite(sizes), initial=0.0))
    left_with_one = 0 < largest * 10.0**usual < 9.95
    return telling(largest, TELLING) if left_with_one else usual
