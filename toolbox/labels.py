"""Words that people read in place of names: the titles of parameters, choices and groups."""

from __future__ import annotations

from toolbox import language

LONGEST_TITLE = 30  # characters: what the toolbox of QGIS and the heading of a report have room for
WRITTEN = {  # as it is written, by the word of a name
    word.lower(): word
    for word in ("DTM", "DSM", "nDSM", "CHM", "CRS", "RMSE", "IoU", "NDVI", "NMAD", "RMS", "IDW")
}


def in_words(name: str) -> str:
    """A name or word of a declaration as a text, with abbreviations as they are written.

    >>> in_words("cell_size"), in_words("ndsm"), in_words("mean_crs")
    ('Cell size', 'nDSM', 'Mean CRS')
    """
    first, *others = name.split("_")
    words = [WRITTEN.get(first.lower(), first.capitalize())]
    return " ".join([*words, *(WRITTEN.get(word.lower(), word) for word in others)])


def labelled(name: str, title: str, help: str) -> str:
    """A help, after the title of the field if that says more than its name and the help.

    >>> labelled("cell", "Cell", "Size of the cells")
    'Size of the cells'
    >>> labelled("ignore", "Classes left out", "Classes that take no part")
    'Classes left out: classes that take no part'
    """
    if title == in_words(name) or help.lower().startswith(title.lower()):
        return help
    flows = language.uncapitalised(help) if help[1:2].islower() else help
    return f"{title}: {flows}"
