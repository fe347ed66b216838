"""Which columns of a table are x, y and z, by the words that programs and surveyors have for them.

Programs call the easting x, and surveyors of many countries (Germany and Turkey among them) call it
Y, and the northing X. A word such as Easting, Rechtswert or Sağa says what it is; the bare letters
do not, so that columns Y, X in this order are refused instead of guessed at.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

AXES = ("x", "y", "z")

_WORDS = {  # English, German, Turkish
    "x": "easting,east,eastings,xcoordinate,xcoord,rechtswert,ostwert,saga,sagadeger,dogu",
    "y": "northing,north,northings,ycoordinate,ycoord,hochwert,nordwert,yukari,yukarideger,kuzey",
    "z": "elevation,height,altitude,elev,zcoordinate,zcoord,hohe,hoehe,kot,yukseklik",
}
_HEIGHTS = {  # Dutch, French, Spanish, Italian, Portuguese; only where no other column is z
    *("hoogte", "hauteur", "altura", "altitud", "cota", "elevacion", "elevacao", "quota"),
}
_AXIS = {word: axis for axis, words in _WORDS.items() for word in words.split(",")}
_LETTERS = {"e": "x", "n": "y", "h": "z"}  # where easting and northing are there as such letters


def plain(name: str) -> str:
    """A name without case, accents, blanks, underscores, and what stands in brackets.

    >>> plain("Sağa Değer (Y) [m]")
    'sagadeger'
    """
    return _letters(re.sub(r"[\[(].*", "", name))


def axes_of(names: Sequence[str]) -> dict[str, str]:
    """The axis of each column that may hold coordinates; several may be of one axis.

    >>> axes_of(["Nokta", "Sağa (Y)", "Yukarı (X)", "Kot"])
    {'Sağa (Y)': 'x', 'Yukarı (X)': 'y', 'Kot': 'z'}
    >>> axes_of(["punt", "X", "Y", "Hoogte"])
    {'X': 'x', 'Y': 'y', 'Hoogte': 'z'}
    """
    words = {plain(name) for name in names}
    letters = _LETTERS if {"e", "n"} <= words else {}
    if {"x", "y"} <= words:
        letters = {"h": "z"}
    found = {}
    for name in names:
        word = plain(name)
        axis = word if word in AXES else _AXIS.get(word) or letters.get(word)
        within = _AXIS.get(_letters(name)[len(word) :])  # "Y (Easting)"
        if within or axis:
            found[name] = within or axis or ""
    if {"x", "y"} <= {*found.values()} and "z" not in found.values():
        found |= {name: "z" for name in names if plain(name) in _HEIGHTS}
    return found


def chosen(names: Sequence[str]) -> dict[str, str]:
    """The column of each axis that is found: the one called x, y or z, or else the first.

    >>> chosen(["height", "East", "North", "z"])
    {'x': 'East', 'y': 'North', 'z': 'z'}
    """
    axes = axes_of(names)
    found = {axis: name for name, axis in reversed(axes.items())}
    found |= {axis: name for name, axis in axes.items() if plain(name) == axis}
    return dict(sorted(found.items()))


def ambiguity(names: Sequence[str]) -> str:
    """What is not clear about the columns of coordinates; "" if nothing is.

    >>> ambiguity(["No", "Y", "X", "Z"])
    'its columns Y, X stand in this order, in which Y may be the easting'
    """
    axes = axes_of(names)
    for axis in AXES:
        of_axis = [name for name, found in axes.items() if found == axis]
        if len(of_axis) > 1 and not any(plain(name) == axis for name in of_axis):
            return f"its columns {' and '.join(of_axis)} may both be {axis}"
    taken = chosen(names)
    x, y = taken.get("x", ""), taken.get("y", "")
    bare = _letters(x) == "x" and _letters(y) == "y"
    if bare and list(names).index(y) < list(names).index(x):
        return f"its columns {y}, {x} stand in this order, in which {y} may be the easting"
    return ""


def _letters(name: str) -> str:
    """The letters and digits of a name, without case and accents."""
    text = unicodedata.normalize("NFKD", name.casefold().replace("\u0131", "i"))
    found = re.sub(r"[^a-z0-9]", "", text)
    return found if len(found) > 1 or name.isascii() else ""  # \xff is no y
