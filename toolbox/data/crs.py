"""Coordinate reference systems: reading, naming and comparing them, and their units.

A length is only a length in a projected or local CRS. Heights are in the unit of the vertical
component; a CRS without one says nothing about heights, which are then taken to be in the
unit of the horizontal component, as the LAS and GeoTIFF files in daily use mean it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

from pyproj import CRS
from pyproj.exceptions import CRSError

from toolbox.data.measures import telling
from toolbox.errors import DataError


def _local(unit: str, units: str, metres: float) -> CRS:
    """An engineering CRS for coordinates in a unit, without a relation to the Earth."""
    axes = ("easting (X)", "east"), ("northing (Y)", "north"), ("up (Z)", "up")
    listed = ",".join(f'AXIS["{n}",{way},ORDER[{k}]]' for k, (n, way) in enumerate(axes, start=1))
    return CRS.from_wkt(
        f'ENGCRS["Local coordinates in {units}",EDATUM["Local"],CS[Cartesian,3],{listed},'
        f'LENGTHUNIT["{unit}",{metres!r}]]'
    )


LOCAL = _local("metre", "metres", 1.0)
"""The engineering CRS of coordinates in metres, without a relation to the Earth.

No file but GeoParquet states it as its CRS, since other programs would not know what to do with
it. It is said where they leave it alone: a VLR of LAS, a comment of PLY, a metadata item of a
GeoTIFF, the description of a layer in a GeoPackage.
"""
LOCALS = {
    "local": LOCAL,
    "local:mm": _local("millimetre", "millimetres", 0.001),
    "local:cm": _local("centimetre", "centimetres", 0.01),
    "local:ft": _local("foot", "feet", 0.3048),
}
"""The engineering CRS for each text that a user may give, also in other units."""

_FORMS = (
    "give 'EPSG:2154', 'EPSG:2154+5720' (with heights), 'EPSG:2154+ellipsoid' (with heights above "
    "the ellipsoid), a WKT text, or 'local' (plain metres; local:mm, local:cm, local:ft)"
)
_CODE = re.compile(r"[A-Za-z]\w*:\w+(\+([A-Za-z]\w*:)?\w+)?")
_NUMBER = re.compile(r"\d{4,5}(\+(\d{4,5}|ellipsoid))?", re.I)  # codes of EPSG, said without it
ABOVE_ELLIPSOID = "above the ellipsoid"
NOT_STATED = "not stated by the data"
"""What :func:`height_system` says of heights that are not above a geoid."""

_ELLIPSOID = "+ellipsoid"  # behind a code: heights are measured from the ellipsoid of its datum
UNITS_OF_LENGTH = {"m": 1.0, "ft": 0.3048, "us-ft": 1200 / 3937, "cm": 0.01, "mm": 0.001, "km": 1e3}
"""Metres of the units that may be written behind a value, such as ``2ft``."""

_UNITS = {1.0: "metre", 0.3048: "foot", 1200 / 3937: "US survey foot"}
_UNITS |= {0.001: "millimetre", 0.01: "centimetre"}
LENGTHS = {"metre": "m", "foot": "ft", "US survey foot": "US ft"}
LENGTHS |= {"millimetre": "mm", "centimetre": "cm"}
"""Units of length as people write them, by their names."""

FEET = (0.3048, 1200 / 3937)
"""Metres of the international foot and of the US survey foot."""

Unit = tuple[str, float]
"""A unit of length as people write it, and its metres."""


def parse_crs(text: str) -> CRS:
    """Make a CRS of a text: authority code, compound code, WKT or a key of LOCALS.

    A number alone is a code of EPSG. A code with "+ellipsoid" behind it has heights above the
    ellipsoid.

    Raises
    ------
    ValueError
        The text has another form, is unknown to PROJ, or names a height system alone.

    Examples
    --------
    >>> parse_crs("EPSG:2154+5720").name
    'RGF93 v1 / Lambert-93 + NGF-IGN69 height'
    >>> parse_crs("28992") == parse_crs("EPSG:28992")
    True
    >>> parse_crs("local:mm").name
    'Local coordinates in millimetres'
    """
    text = text.strip()
    close = re.sub(r"\s*\+\s*", "+", text)
    text = close if _CODE.fullmatch(close) or _NUMBER.fullmatch(close) else text
    if _NUMBER.fullmatch(text):
        text = f"EPSG:{text}"
    if text.lower() in LOCALS:
        return LOCALS[text.lower()]
    if text.lower().endswith(_ELLIPSOID):
        return parse_crs(text[: -len(_ELLIPSOID)]).to_3d()
    if not (_CODE.fullmatch(text) or "[" in text):
        raise ValueError(f"{text!r} is not a CRS; {_FORMS}")
    try:
        crs = _read(text)
    except CRSError as error:
        why = _no_heights(text) or f"{text!r} is not a CRS that PROJ knows"
        raise ValueError(f"{why}; {_FORMS}") from error
    if crs.is_vertical and not crs.is_compound:
        raise ValueError(f"{text!r} is a height system alone ({crs.name}); {_FORMS}")
    return crs


def _read(text: str) -> CRS:
    """The CRS of a text; heights of EPSG may stand behind a code of ESRI without their authority.

    >>> _read("ESRI:102008+5703") == _read("ESRI:102008+EPSG:5703")
    True
    """
    try:
        return CRS.from_user_input(text)
    except CRSError:
        plane, _, code = text.partition("+")
        if plane.upper().startswith("ESRI:") and code.isdigit():
            return CRS.from_user_input(f"{plane}+EPSG:{code}")
        raise


def _no_heights(text: str) -> str:
    """Why the code behind the + of a compound code is none of a height system; "" if it is one.

    >>> _no_heights("EPSG:2154+32635")
    "'EPSG:2154+32635': behind the + stands no height system but WGS 84 / UTM zone 35N"
    """
    plane, plus, code = text.partition("+")
    try:
        crs = CRS.from_user_input(code if ":" in code else f"{plane.partition(':')[0]}:{code}")
    except CRSError:
        return f"{text!r}: PROJ knows no height system {code}" if plus else ""
    if not plus or crs.is_vertical:
        return ""
    return f"{text!r}: behind the + stands no height system but {crs.name}"


def assumed(stated: CRS | None, given: CRS | str | int | None) -> CRS | None:
    """The CRS of a layer: the one it states, or else the given one.

    Where the given one is the stated one with a height system, which the layer does not state,
    the heights are in that.

    Examples
    --------
    >>> assumed(CRS(2154), CRS("EPSG:2154+5720")) == CRS("EPSG:2154+5720")
    True
    >>> assumed(CRS(2154), CRS("EPSG:32631+5720")) == CRS(2154)
    True
    """
    crs = crs_of(given)
    return crs if stated is None or (crs and adds_heights(stated, crs)) else stated


def adds_heights(stated: CRS, given: CRS) -> bool:
    """Whether a CRS is another one with a height system, which that does not state.

    Examples
    --------
    >>> adds_heights(CRS(2154), CRS("EPSG:2154+5720")), adds_heights(CRS(2154), CRS(2154))
    (True, False)
    """
    flat = not (has_heights(stated) or stated.is_engineering) and has_heights(given)
    return flat and same_crs(_plane(stated), _plane(given))


def crs_of(given: CRS | str | int | None) -> CRS | None:
    """The CRS of a layer that is made in Python: as it is, or by its code or another text.

    Raises
    ------
    DataError
        It is none of these, or PROJ does not know it.

    Examples
    --------
    >>> crs_of("EPSG:32635") == crs_of(32635) == CRS(32635)
    True
    >>> crs_of("EPSG:2")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    toolbox.errors.DataError: crs: 'EPSG:2' is not a CRS that PROJ knows; give 'EPSG:2154', ...
    """
    if given is None or isinstance(given, CRS):
        return given
    try:
        return parse_crs(str(given))
    except ValueError as error:
        raise DataError(f"crs: {error}") from error


def crs_to_json(crs: CRS | None) -> str | None:
    """A text of which :func:`crs_from_json` makes the same CRS; None for None.

    >>> crs_to_json(CRS(2154))
    'EPSG:2154'
    """
    return None if crs is None else str(crs.srs)


@lru_cache
def crs_from_json(text: str | None) -> CRS | None:
    """The CRS of a text that :func:`crs_to_json` has made.

    >>> crs_from_json("EPSG:2154") == CRS(2154)
    True
    """
    return None if text is None else CRS(text)


def length_problem(crs: CRS | None) -> str | None:
    """Say why lengths cannot be measured in this CRS, and what to do; None if they can.

    The text continues a sentence that begins with the name of the file.

    Examples
    --------
    >>> length_problem(CRS(32635)) is None
    True
    >>> length_problem(CRS(4326))
    'is in degrees (EPSG:4326 WGS 84); reproject it to a projected CRS first'
    """
    if crs is None:
        return (
            "has no CRS; state it with assume_crs EPSG:..., "
            "or assume_crs local for plain metres, local:mm for millimetres"
        )
    return _horizontal_problem(crs) or _vertical_problem(crs)


def _horizontal_problem(crs: CRS) -> str | None:
    horizontal = horizontal_crs(crs)
    if horizontal.is_geographic:
        return f"is in degrees ({describe_crs(crs)}); reproject it to a projected CRS first"
    if not (horizontal.is_projected or horizontal.is_engineering):
        kind = horizontal.type_name
        return f"is in a {kind} ({describe_crs(crs)}); reproject it to a projected CRS first"
    if horizontal.axis_info[0].unit_name == "unknown":
        return f"has a CRS of unknown unit ({describe_crs(crs)}); state it with assume_crs"
    return None


def _vertical_problem(crs: CRS) -> str | None:
    unit, vertical = horizontal_crs(crs).axis_info[0], _vertical_axis(crs)
    if vertical and vertical.direction == "down":
        return f"has depths, not heights ({describe_crs(crs)}); turn them upwards first"
    if vertical and not _close(vertical.unit_conversion_factor, unit.unit_conversion_factor):
        return (
            f"has horizontal {_unit_name(unit)} and vertical {_unit_name(vertical)} "
            f"({describe_crs(crs)}); convert its heights to the horizontal unit first"
        )
    return None


def metres_per_unit(crs: CRS | None) -> float:
    """Metres per horizontal unit of the CRS; 1.0 without a CRS.

    Raises
    ------
    DataError
        The horizontal unit is not a length, as in a geographic CRS.

    Examples
    --------
    >>> round(metres_per_unit(CRS(2263)), 6)  # US survey feet
    0.304801
    """
    if crs is None:
        return 1.0
    horizontal = horizontal_crs(crs)
    if horizontal.is_geographic:
        raise DataError(f"{describe_crs(crs)} is in degrees, which are not a length")
    return float(horizontal.axis_info[0].unit_conversion_factor)


def metres_per_height(crs: CRS) -> float:
    """Metres per unit of height; of a CRS without heights the horizontal unit, if a length.

    Examples
    --------
    >>> metres_per_height(CRS("EPSG:2154+5720"))
    1.0
    """
    vertical = _vertical_axis(crs)
    if vertical is not None:
        return float(vertical.unit_conversion_factor)
    return 1.0 if horizontal_crs(crs).is_geographic else metres_per_unit(crs)


def vertical_unit(crs: CRS | None) -> str:
    """Name of the unit of heights: "metre", "foot", "US survey foot", ...; "" if not known.

    Examples
    --------
    >>> vertical_unit(CRS(2263)), vertical_unit(CRS(4326))
    ('US survey foot', '')
    """
    if crs is None:
        return ""
    horizontal, vertical = horizontal_crs(crs), _vertical_axis(crs)
    if vertical is None and horizontal.is_geographic:
        return ""
    return _unit_name(vertical or horizontal.axis_info[0])


def short_unit(crs: CRS) -> str:
    """The unit of lengths in a CRS, as people write it.

    Examples
    --------
    >>> short_unit(CRS(2263)), short_unit(CRS(32635))
    ('US ft', 'm')
    """
    name = str(horizontal_crs(crs).axis_info[0].unit_name)
    metres = metres_per_unit(crs)
    return next((LENGTHS[known] for size, known in _UNITS.items() if _close(metres, size)), name)


def unit_of(metres: float) -> str:
    """The unit of so many metres, as it may be written behind a value; "" for another one.

    Examples
    --------
    >>> unit_of(0.3048), unit_of(0.7)
    ('ft', '')
    """
    return next((name for name, size in UNITS_OF_LENGTH.items() if _close(metres, size)), "")


def short_height_unit(crs: CRS | None) -> str:
    """The unit of heights, as people write it; "" if it is not known.

    Examples
    --------
    >>> short_height_unit(CRS(2263)), short_height_unit(CRS(32635)), short_height_unit(None)
    ('US ft', 'm', '')
    """
    name = vertical_unit(crs)
    return LENGTHS.get(name, name)


def unit_of_heights(crs: CRS | None) -> Unit | None:
    """The unit of heights where it is known, and not the metre.

    Examples
    --------
    >>> unit_of_heights(CRS(2222)), unit_of_heights(CRS(32635))
    (('ft', 0.3048), None)
    """
    unit = short_height_unit(crs)
    return None if crs is None or unit in ("m", "") else (unit, metres_per_height(crs))


def unit_of_lengths(crs: CRS | None) -> Unit | None:
    """The unit of lengths where it is known, and not the metre.

    Examples
    --------
    >>> unit_of_lengths(CRS(2222)), unit_of_lengths(CRS(32635)), unit_of_lengths(CRS(4326))
    (('ft', 0.3048), None, None)
    """
    if crs is None or length_problem(crs):
        return None
    unit = short_unit(crs)
    return None if unit == "m" else (unit, metres_per_unit(crs))


def foot_of(crs: CRS | None) -> float | None:
    """Metres of the foot that lengths are in; None where they are in another unit.

    Examples
    --------
    >>> foot_of(CRS(2222)), foot_of(CRS(32635)), foot_of(CRS(4326))
    (0.3048, None, None)
    """
    _, metres = unit_of_lengths(crs) or ("", 1.0)
    return next((foot for foot in FEET if _close(metres, foot)), None)


def own_unit(size: float, unit: Unit | None, power: int = 1, digits: int = 3) -> str:
    """A length, area (power 2), volume (3) or density (-2) in the unit of the data, in brackets.

    Parameters
    ----------
    size : in metres
    unit : of the data; None of data in metres, which have nothing in brackets
    digits : that tell something; whole numbers have none after the point

    A size that is not known (NaN) has nothing in brackets, either.

    Examples
    --------
    >>> own_unit(0.68, ("ft", 0.3048)), own_unit(100.0, ("ft", 0.3048), 2)
    (' (2.23 ft)', ' (1076 ft²)')
    >>> own_unit(0.04, ("US ft", 1200 / 3937), -2), own_unit(0.6096, ("ft", 0.3048), digits=4)
    (' (0.00372/US ft²)', ' (2 ft)')
    >>> own_unit(100.0, None, 2)
    ''
    """
    if unit is None or not math.isfinite(size):
        return ""
    name, text = unit[0], own_number(size, unit, power, digits)
    raised = {1: "", 2: "²", 3: "³"}
    said = {-2: f"{text}/{name}²"} | {n: f"{text} {name}{sign}" for n, sign in raised.items()}
    return f" ({said[power]})"


def own_number(size: float, unit: Unit, power: int = 1, digits: int = 3, least: int = 0) -> str:
    """The number of :func:`own_unit` alone, with at least so many digits after the point.

    >>> own_number(562.123, ("ft", 0.3048)), own_number(562.123, ("ft", 0.3048), least=2)
    ('1844', '1844.24')
    """
    own = size / unit[1] ** power
    whole = _close(own, round(own)) and not least
    return f"{own:.{0 if whole else max(telling(abs(own), digits), least)}f}"


def has_heights(crs: CRS) -> bool:
    """Whether a CRS says what heights are measured from.

    Examples
    --------
    >>> has_heights(CRS("EPSG:2154+5720")), has_heights(CRS(2154))
    (True, False)
    """
    return _vertical_axis(crs) is not None


def same_crs(a: CRS | None, b: CRS | None) -> bool:
    """Whether two CRS are the same for coordinates: datum, projection, units and heights.

    Names, the WKT dialect, the order in which the axes are listed and an attached transformation
    to WGS 84 make no difference. A CRS with a vertical component differs from the same without it,
    and LOCAL or no CRS is the same only as itself.

    Examples
    --------
    >>> same_crs(CRS("EPSG:2154"), CRS("EPSG:2154+5720"))
    False
    """
    if a is None or b is None:
        return a is b
    if a.is_engineering or b.is_engineering:  # PROJ would take any two of them for the same
        return a.name == b.name and a.equals(b)
    return a.equals(b, ignore_axis_order=True) or _plain(a).equals(
        _plain(b), ignore_axis_order=True
    )


def is_local(crs: CRS) -> bool:
    """Whether a CRS is one of LOCALS, which have no relation to the Earth.

    Examples
    --------
    >>> is_local(parse_crs("local:ft")), is_local(CRS(32635))
    (True, False)
    """
    return any(same_crs(crs, local) for local in LOCALS.values())


def local_crs(text: str) -> CRS | None:
    """The CRS of LOCALS that a file names with its key or its own name; None for other texts.

    Examples
    --------
    >>> local_crs("local:mm").name, local_crs("a lake")
    ('Local coordinates in millimetres', None)
    """
    return next((crs for word, crs in LOCALS.items() if text in (word, crs.name)), None)


def local_like(crs: CRS | None) -> CRS | None:
    """Local coordinates in the unit of a CRS, as of a drawing in a plane; None if none is known.

    Examples
    --------
    >>> str(local_like(CRS(32635)).name), local_like(None)
    ('Local coordinates in metres', None)
    """
    if crs is None or length_problem(crs) is not None:
        return None
    metres = metres_per_unit(crs)
    return next((local for local in LOCALS.values() if metres_per_unit(local) == metres), None)


def crs_conflict(a: CRS | None, b: CRS | None, *, heights: bool, tools: str = "") -> str | None:
    """Say why a layer in CRS `a` cannot be used with one in `b`, and what to do; None if it can.

    Both must place things on the ground in the same way. Their height systems must agree where
    both state one, so that outlines without heights go with points that have them.

    Parameters
    ----------
    heights : whether the heights of the two are compared, as those of two point clouds, so that
        both must state the same height system or none
    tools : the group of those that mend such a layer, see :class:`toolbox.data.layer.Layer`

    Returns
    -------
    str or None
        Continues a sentence that begins with the name of the first layer, and is continued by
        "of" and the name of the second one.

    Examples
    --------
    >>> crs_conflict(CRS(32636), CRS(32635), heights=False)
    'is in EPSG:32636 WGS 84 / UTM zone 36N; reproject it to EPSG:32635 WGS 84 / UTM zone 35N'
    >>> crs_conflict(CRS("EPSG:2154"), CRS("EPSG:2154+5720"), heights=False) is None
    True
    """
    if same_crs(a, b):
        return None
    if a is None:
        return f"has no CRS; state it with assume_crs, to go with {describe_crs(b)}"
    advice = _advice(a, b, heights) if b else "state with assume_crs the missing CRS"
    command = _command(advice, tools, b) if advice and tools and b else ""
    return f"is in {describe_crs(a)}; {advice}{command}" if advice else None


def _command(advice: str, tools: str, crs: CRS) -> str:
    """The command that brings a layer to a CRS, if there is one."""
    text = crs_text(crs)
    word = text if _CODE.fullmatch(text) else '"its WKT"'
    if advice.startswith(("reproject it", "bring its heights")):
        option = "" if tools == "points" else f", or read it with the option reproject={word}"
        return f" ({tools}.reproject --crs {word}{option})"
    assigned = advice.startswith("assign it the heights") and tools == "points"
    return f" (points.assign_crs --crs {word})" if assigned else ""


def crs_conflicts(named: Sequence[tuple[str, CRS | None]]) -> list[str]:
    """Say of each point cloud, given by name and CRS, why it cannot be used with the first one.

    Examples
    --------
    >>> crs_conflicts([("a.laz", CRS(32635)), ("b.laz", None)])[0][:22]
    'b.laz has no CRS; stat'
    """
    (first_name, first), *others = named
    return [
        f"{name} {text} of {first_name}"
        for name, crs in others
        if crs is not first and (text := crs_conflict(crs, first, heights=True, tools="points"))
    ]


def _advice(a: CRS, b: CRS, heights: bool) -> str | None:
    """Say how to bring a layer from CRS `a` to `b`; None if both can be used as they are."""
    name, high_a, high_b = describe_crs(b), _vertical_axis(a), _vertical_axis(b)
    if a.is_engineering or b.is_engineering:
        return f"it cannot be compared with {name}"
    if not same_crs(_plane(a), _plane(b)):
        return f"reproject it to {name}"
    if high_a and high_b:
        return f"bring its heights to {name}"
    if not heights:
        return None
    return f"assign its heights to {name}" if high_a else f"assign it the heights of {name}"


def describe_crs(crs: CRS | None) -> str:
    """Authority code and name, e.g. "EPSG:2154+5720 RGF93 v1 / Lambert-93 + NGF-IGN69 height".

    Examples
    --------
    >>> describe_crs(CRS(32635))
    'EPSG:32635 WGS 84 / UTM zone 35N'
    """
    if crs is None:
        return "no CRS"
    if is_local(crs):
        return crs.name.lower()
    code = _code(crs)
    return f"{code} {_usual_name(code)}" if code else crs.name


@cache
def _usual_name(code: str) -> str:
    """The name of a code in the registry; files have others, such as those of ESRI."""
    return parse_crs(code).name


def height_system(crs: CRS) -> str:
    """What heights refer to, in words.

    Examples
    --------
    >>> height_system(CRS("EPSG:2154+5720")), height_system(CRS(2154))
    ('NGF-IGN69 height', 'not stated by the data')
    """
    parts = _components(crs)
    if len(parts) > 1:
        return str(parts[1].name)
    if is_local(crs):
        return "as in the data, no datum"
    flat = len(parts[0].axis_info) < 3
    return NOT_STATED if flat else ABOVE_ELLIPSOID


def crs_text(crs: CRS | None) -> str:
    """A text that :func:`parse_crs` reads as the same CRS: a code, "local", WKT; "" of none.

    Examples
    --------
    >>> crs_text(CRS("EPSG:2154+5720")), crs_text(parse_crs("local")), crs_text(None)
    ('EPSG:2154+5720', 'local', '')
    """
    if crs is None:
        return ""
    word = next((word for word, local in LOCALS.items() if crs.equals(local)), "")
    return word or _code(crs) or str(crs.to_wkt())


def horizontal_crs(crs: CRS) -> CRS:
    """The horizontal component of a CRS, without TOWGS84.

    Examples
    --------
    >>> horizontal_crs(CRS("EPSG:2154+5720")).to_epsg()
    2154
    """
    return _components(crs)[0]


def _plane(crs: CRS) -> CRS:
    """The horizontal component of a CRS in two dimensions, also of a 3-D CRS."""
    return horizontal_crs(crs).to_2d()


def _code(crs: CRS) -> str:
    """AUTHORITY:CODE, or AUTHORITY:CODE+CODE of a compound CRS; "" if a component has no code."""
    if len(crs.axis_info) == 3 and crs.is_projected and not crs.is_compound:
        flat = _code(crs.to_2d())
        return f"{flat}{_ELLIPSOID}" if flat and same_crs(parse_crs(flat).to_3d(), crs) else ""
    found = [authority for component in _components(crs) if (authority := component.to_authority())]
    if len(found) < len(_components(crs)) or len({authority for authority, _ in found}) > 1:
        return ""
    return f"{found[0][0]}:" + "+".join(code for _, code in found)


def _components(crs: CRS) -> list[CRS]:
    """The horizontal component of a CRS, and the vertical one if there is one."""
    crs = _without_bound(crs)
    return [_without_bound(component) for component in crs.sub_crs_list] or [crs]


def _without_bound(crs: CRS) -> CRS:
    """The CRS itself, without the transformation to WGS 84 that TOWGS84 attaches."""
    return crs.source_crs if crs.is_bound and crs.source_crs else crs


def _vertical_axis(crs: CRS) -> Any:
    """The axis of heights (a pyproj Axis), or None."""
    axes = [axis for component in _components(crs) for axis in component.axis_info]
    return next((axis for axis in axes if axis.direction in ("up", "down")), None)


def _unit_name(axis: Any) -> str:
    """One name per unit, since WKT dialects spell them differently (Meter, Foot_US)."""
    named = (n for factor, n in _UNITS.items() if _close(factor, axis.unit_conversion_factor))
    return next(named, str(axis.unit_name))


def _close(a: float, b: float) -> bool:
    """Whether two factors are equal within rounding (1e-9); the two feet differ by 2e-6."""
    return abs(a - b) <= 1e-9 * abs(b)


def _plain(crs: CRS) -> CRS:
    """The CRS without TOWGS84 and with easting before northing, as files hold coordinates.

    PROJ forgives the axis order of geographic CRSs only.
    """
    return CRS.from_json_dict(_reordered(crs.to_json_dict()))


def _reordered(node: dict[str, Any]) -> dict[str, Any]:
    if node["type"] == "BoundCRS":
        return _reordered(node["source_crs"])
    if node["type"] == "CompoundCRS":
        return node | {"components": [_reordered(component) for component in node["components"]]}
    if node["type"] == "ProjectedCRS":
        system = node["coordinate_system"]
        axes = sorted(system["axis"], key=lambda axis: axis["direction"] not in ("east", "west"))
        return node | {"coordinate_system": system | {"axis": axes}}
    return node
