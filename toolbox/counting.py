"""Words that agree with their numbers: texts are written for many, and "1 points" is mended.

Messages have one form, that of many, which catalogues know; English alone needs another for one.
"""

from __future__ import annotations

import re

_REGULAR = (
    *("band", "bit", "block", "byte", "cell", "character", "checkpoint", "chunk", "clump"),
    *("column", "conductor", "coordinate", "cover", "crossing", "degree", "difference"),
    *("element", "feature", "file", "fold", "front", "group", "iteration"),
    *("key", "label", "layer", "letter", "level", "line", "name", "neighbour"),
    *("neuron", "number", "object", "opening", "pair", "part", "piece", "pixel", "place", "plane"),
    *("point", "polygon", "problem", "pulse", "region", "request", "return", "round", "row"),
    *("sample", "scan", "section", "span", "square", "step", "strip", "support"),
    *("survey", "tile", "tower", "tree", "trial", "value", "voxel", "warning", "wire"),
    *("building", "change", "contour", "field", "record", "roof"),
)
_ONE = {f"{noun}s": noun for noun in _REGULAR} | {
    "bodies": "body",
    "classes": "class",
    "intensities": "intensity",
    "vertices": "vertex",
}
"""Nouns that texts count, by their form for many."""

_VERBS = {
    **{many: f"{many}s" for many in ("agree", "become", "begin", "come", "differ", "end", "fit")},
    **{many: f"{many}s" for many in ("hang", "hold", "lack", "lie", "make", "meet")},
    **{many: f"{many}s" for many in ("need", "overlap", "promise", "share", "show")},
    **{many: f"{many}s" for many in ("stand", "take", "break", "keep")},
    "are": "is",
    "were": "was",
    "have": "has",
    "do": "does",
    "reach": "reaches",
}
_BESIDE = "among|at|by|from|in|near|of|than|to|with"  # what it counts does not act
_NAMES = "class|body|span|wire|tower|line|strip|front|plane|step|band|level|number|row|object"
"""What is named by a number: the points of "class 1 points" are not counted by it."""
_MANY = "|".join(sorted(_ONE, key=len, reverse=True))
_DO = "|".join(sorted(_VERBS, key=len, reverse=True))
_OWN = "first|last|flat|flagged|negative|independent|more|water|other|low|high|new|level"
_OF = r"(?: (?:of|in|on|near|without) [^\s,;:]+(?: [^\s,;:]+){0,3}?)?"
_COUNTED = re.compile(
    rf"(?<![\w.,:/+-])(?<!°)(?P<name>(?:\b(?:{_NAMES}) )?)"
    rf"(?P<beside>(?:\b(?:{_BESIDE}) )?)(?P<there>(?:\bthere are )?)(?P<one>1 (?:(?:{_OWN}) )*)"
    rf"(?P<noun>{_MANY})\b"
    rf"(?:(?P<of>{_OF})(?P<who> that| which)?(?P<verb> (?:{_DO}))\b(?P<whose> their\b)?)?"
)
_SHARE = re.compile(
    rf"(?<![\w.,:/+-])(?P<share>1 of [\d,]+ (?:\w+ )?(?:{_MANY}))(?P<verb> (?:{_DO}))\b"
)


def agree(text: str) -> str:
    """An English text in which nouns and verbs after the number one are those of one.

    Examples
    --------
    >>> agree("1 points share their place with another"), agree("21 points, class 1 points")
    ('1 point shares its place with another', '21 points, class 1 points')
    >>> agree("1 of 5 points have no class; 1 bodies of water"), agree("0.1 points, 1 lines are")
    ('1 of 5 points has no class; 1 body of water', '0.1 points, 1 line is')
    """
    return _SHARE.sub(_share, _COUNTED.sub(_counted, text))


def _counted(found: re.Match[str]) -> str:
    if found["name"]:
        return found[0]
    there = "there is " if found["there"] else ""
    one = f"{found['beside']}{there}{found['one']}{_ONE[found['noun']]}"
    if found["beside"] or not found["verb"]:
        return f"{one}{found[0][found.end('noun') - found.start() :]}"
    whose = " its" if found["whose"] else ""
    return f"{one}{found['of']}{found['who'] or ''} {_VERBS[found['verb'][1:]]}{whose}"


def _share(found: re.Match[str]) -> str:
    return f"{found['share']} {_VERBS[found['verb'][1:]]}"
