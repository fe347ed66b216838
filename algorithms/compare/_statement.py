"""The statement of accuracy of a surface, after the standard of the ASPRS.

The standard prescribes the sentences of a class that is met, and of a test with fewer checkpoints
than it asks for; the others are in words of our own.

References
----------
ASPRS (2024). Positional Accuracy Standards for Digital Geospatial Data, Edition 2, Version 2: what
a statement names is the class, the actual RMSE with that of the checkpoints, for ground without
(NVA) and with vegetation (VVA), and the number of checkpoints; without enough of them nothing is
called tested.
FGDC (1998). Geospatial Positioning Accuracy Standards, Part 3: National Standard for Spatial Data
Accuracy (NSSDA), 3.2.2: a fifth of the checkpoints in each quarter of the area. Its other advice, a
spacing of a tenth of the diagonal, is for 20 checkpoints: 100 have no room for it in a square. So
that they are not crowded is judged against places taken by chance.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from algorithms.compare._spread import LEAST
from toolbox.data.crs import Unit, own_unit

STANDARD = (
    "ASPRS Positional Accuracy Standards for Digital Geospatial Data, Edition 2, Version 2 (2024)"
)
FEWEST = 30  # checkpoints, by the standard
_NAMES = {
    "NVA": "Non-Vegetated Vertical Accuracy (NVA)",
    "VVA": "Vegetated Vertical Accuracy (VVA)",
}
NSSDA = "NSSDA, 1998, 3.2.2"
EMPTIEST, APART = "NVA emptiest quarter", "NVA mean distance to next"  # items of a report
WET = "Checkpoints on water"  # item of a report
CENTIMETRES = 100.0  # in a metre; classes of the standard are centimetres
_MOST = 4  # digits after the point of centimetres, a micrometre


def statement(report: pd.DataFrame, unit: Unit | None = None) -> Iterator[str]:
    """Sentences on NVA and VVA from the rows of a report.

    Parameters
    ----------
    report : columns item and value, metres; and note, where checkpoints are uneven
    unit : of heights that are not in metres; errors are told in it, too

    Examples
    --------
    >>> items = ["NVA checkpoints", "NVA RMSEV1", "NVA RMSEV2", "NVA RMSEV", "NVA accuracy class"]
    >>> values = [40, 0.03, 0.04, 0.05, 0.1]
    >>> for said in statement(pd.DataFrame({"item": items, "value": values})):
    ...     print(said)
    This data set was tested to meet ASPRS Positional Accuracy Standards for Digital Geospatial \
Data, Edition 2, Version 2 (2024) for a 10 (cm) RMSEV Vertical Accuracy Class. The Non-Vegetated \
Vertical Accuracy (NVA) was found to be RMSEV = 5.0 (cm).
    Non-vegetated vertical accuracy (NVA) at 40 checkpoints: RMSEV 5.0 cm, of which 3.0 cm are \
the fit to the checkpoints and 4.0 cm these themselves.
    """
    found = dict(zip(report["item"], report["value"], strict=True))
    count = int(found.get("NVA checkpoints", 0))
    wanted = found.get("NVA accuracy class")
    met = wanted is not None and count > 0 and found["NVA RMSEV"] <= wanted
    if met:
        yield " ".join(_prescribed(found, count))
    elif count < FEWEST and not (count and wanted):
        yield (
            f"Not tested by the {STANDARD}, which asks for {FEWEST} checkpoints without "
            f"vegetation; there are {count}. What follows is how well the surface fits these."
        )
    elif wanted is None:
        yield f"Tested at {count} checkpoints by the {STANDARD}; no accuracy class was asked for."
    elif count < FEWEST:
        yield (
            f"Tested at {count} checkpoints, fewer than the {FEWEST} of the {STANDARD}: the "
            f"vertical accuracy class of {_exact(wanted)} cm RMSEV is not met."
        )
    else:
        yield (
            f"Tested at {count} checkpoints by the {STANDARD}: the vertical accuracy class of "
            f"{_exact(wanted)} cm RMSEV is not met."
        )
    if count:
        yield from _distribution(report)
        said = _actual("NVA", found, unit)
        yield f"Non-vegetated vertical accuracy (NVA) at {count} checkpoints: {said}"
    if green := int(found.get("VVA checkpoints", 0)):
        yield (
            f"Vegetated vertical accuracy (VVA), reported as found at {green} checkpoints: "
            f"{_actual('VVA', found, unit)}"
        )
    if wet := int(found.get(WET, 0)):
        yield f"On water that was laid level, which is no terrain and counted apart: {wet} points."
    if unit and count:
        name, metres = unit
        yield (
            f"The data are in {name}, and so are errors on a map. Files of measures are in metres, "
            f"1 m = {1 / metres:.4f} {name}."
        )


def _prescribed(found: Mapping[str, float], count: int) -> Iterator[str]:
    """The sentences of the standard for a class that the errors meet."""
    wanted = f"{_exact(found['NVA accuracy class'])} (cm) RMSEV Vertical Accuracy Class"
    few = count < FEWEST
    if few:
        yield f"This data set was tested as required by {STANDARD}."
        yield (
            f"Although the Standards call for a minimum of thirty ({FEWEST}) checkpoints, this "
            f"test was performed using ONLY {count} checkpoints."
        )
        yield f"This data set was produced to meet a {wanted}."
    else:
        yield f"This data set was tested to meet {STANDARD} for a {wanted}."
    for kind, name in _NAMES.items():
        if not found.get(f"{kind} checkpoints", 0):
            continue
        size = f"{found[f'{kind} RMSEV'] * CENTIMETRES:.1f}"
        whole = f"The {name} was found to be RMSEV = {size} (cm)."
        reduced = (
            f"The {name} was found to be RMSEV = {size} (cm) using the reduced number of "
            "checkpoints."
        )
        yield reduced if few else whole


def _distribution(report: pd.DataFrame) -> Iterator[str]:
    """What is to be said of checkpoints without vegetation that lie unevenly; nothing if not."""
    rows = {row["item"]: row for row in report.to_dict("records")}
    problems = []
    if EMPTIEST in rows and (share := rows[EMPTIEST]["value"]) < LEAST:
        where = rows[EMPTIEST]["note"].rpartition(" ")[2]
        text = f"{100 * share:.0f} % of them are in its {where} quarter, where a fifth belongs"
        problems.append(text)
    if APART in rows and rows[APART]["note"].startswith("CROWDED"):
        problems.append("they are closer together than places taken by chance")
    if problems:
        yield (
            f"The checkpoints do not stand for the whole area: {' and '.join(problems)} "
            f"({NSSDA}). What is said holds where they are."
        )


def _actual(kind: str, found: Mapping[str, float], unit: Unit | None) -> str:
    """The RMSE found, and what it is made of."""
    sizes = [found[f"{kind} RMSEV{part}"] for part in ("", "1", "2")]
    _, fit, own = (f"{x * CENTIMETRES:.1f} cm{own_unit(x, unit)}" for x in sizes)
    wanted = found.get(f"{kind} accuracy class")
    total = f"{_beyond(sizes[0], wanted)} cm{own_unit(sizes[0], unit)}"
    if pd.isna(found[f"{kind} RMSEV2"]):
        return f"RMSEV {total}, the fit alone, as the error of the checkpoints is not given."
    return (
        f"RMSEV {total}, of which {fit} are the fit to the checkpoints and {own} these themselves."
    )


def _exact(size: float) -> str:
    """Metres that are given, such as a class, in centimetres without a power of ten.

    >>> _exact(12.0), _exact(0.15), _exact(0.3048)
    ('1200', '15', '30.48')
    """
    return np.format_float_positional(round(size * CENTIMETRES, _MOST), trim="-")


def _beyond(size: float, wanted: float | None) -> str:
    """Metres in centimetres, with so many digits that those beyond a class look so.

    >>> _beyond(0.1002, 0.1), _beyond(0.0998, 0.1), _beyond(0.1002, None)
    ('10.02', '10.0', '10.0')
    """
    digits = 1
    if wanted is not None and size > wanted:
        limit, found = wanted * CENTIMETRES, size * CENTIMETRES
        while digits < _MOST and round(found, digits) <= limit:
            digits += 1
    return f"{size * CENTIMETRES:.{digits}f}"


def horizontal(rmse: float | None) -> str:
    """What is to be said of the horizontal accuracy, which heights do not tell."""
    stated = "" if rmse is None else f"; its maker states RMSEH {_exact(rmse)} cm"
    return f"Horizontal accuracy (RMSEH) was not tested{stated}."
