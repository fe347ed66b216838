"""Brings the catalogues of translations up to date: ``make translations``.

``tools.po`` has the texts of all tools, from their descriptions; ``messages.po`` those that the
code marks with ``language.text("...")``; ``told.po`` those with values in them that warnings,
errors and reports say, in which {1}, {2} stand for the values. Texts that are gone become obsolete
entries, from which a text that comes back takes its translation.
"""

from __future__ import annotations

import ast
import csv
import functools
import itertools
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import polib

from toolbox import catalog, language
from toolbox.data import dxf
from toolbox.data.asprs import NAMES, within_sentence
from toolbox.data.report.columns import LIMITS, guessed
from toolbox.declare.show import Curve
from toolbox.language import FOLDER

CODE = Path(__file__).parent
RULES = CODE.parent / "algorithms" / "corridor" / "rules"
OF_ROW = re.compile(r"(?<=, D_el )[\d.]+(?= m$)|(?<=table 2, )\d+(?= kV)|(?<=case )\d+$")
SILENT = (
    "qgis/plugin",
    "qgis/published",
    "declare/spec",
    "corridor/_settings",
    "toolbox/reference",
    "toolbox/translations",
    "toolbox/server",
    "toolbox/cli",
)
ELSEWHERE = ("source", "param", "sink", "text", "compile", "add_argument")
WORD, FEW = re.compile(r"[A-Za-z]{2,}"), 2  # of so many words a text is hardly one
NO_TEXT = re.compile(  # tags, SQL, code, names, paths, styles
    r"</|<\w|SELECT |CREATE |PRAGMA|INSERT |VALUES |==|::|;;|^\S+$|^\w+(,\s?\w+)*$|[A-Z]{4,}\["
    r"|^import |^from \w+\.|^python -m |^~/|^[A-Z]:\\|stroke-|proj=|^image/|^'crs'"
)
ON_PAGES = re.compile(r'(?<=")[^"{]+(?:\{\w+\}[^"{]*)*(?=" \| said)|(?<=word\(")[^"]+(?="\))')
PROBLEMS = ("{1}: 1 problem", "{1}: {2} problems")  # heads of errors
# Heads, of one word most of them.
HEADS = [
    "Coordinates",
    "Given by hand",
    "Defaults used",
    "Made with",
    "Map",
    "Files",
    "Drawings",
    "Left out",
    "Checksums",
    "Warning",
]
HEADS += ["Shows", "Source", "Crossed", "Broken", "Scale", "door?", "*, ca."]  # in title blocks
HEADS += ["Wall", "Window", "Door", "elevation of fronts"]
HEADS += ["Easting", "Northing", "East", "North", "Up", "Class", "Intensity"]  # at maps and views
LOCAL = "local coordinates in"
COUNTS = ["{1} points", "{1} points {2}", "listed within {1} m", "listed within {1} m ({2})"]
COUNTS += ["{1} % are lower", "{1} water bodies", ": water body {1}{2}"]
COUNTS += ["number of lines: {1}", "number of polygons: {1}"]
COUNTS += ["{1} to {2}", "Front {1}", "Plane {1}", "Class {1}", "{1} to {2} m"]
COUNTS += ["Opening {1}", ", certainty {1} %", "; unsure sides: {1}"]  # in IFC
COUNTS += ["{1}, {2} bytes, sha256 {3}"]  # of an input
COUNTS += ["{1} (conductors of {2} °C)"]
COUNTS += [guessed("{1}")]
COUNTS += [f"{{1}}, {limit}" for limit in LIMITS.values()]
COUNTS += ["about {1} m2 at {2},{3}"]
COUNTS += [f"{low} {{1}} and {high} {{2}}" for low in (">", ">=") for high in ("<", "<=")]
SHORT = ["no rule", "as surveyed", "below a wire", "least distance", "not given", "near a wire"]
SHORT += ["written with", "made from"]  # in the record of a run
SHORT += ["given distance"]  # a rule
SHORT += ["the ground", "other objects", "another line"]
SHORT += ["trees", "buildings", "roads", "rails", "its level", "a spreadsheet", "few returns"]
SHORT += ["of interest", "all others"]  # the classes of a comparison
SHORT += ["NO", "3-D"]
SHORT += ["a number", "unknown parameter", "unknown output", "well spread"]
SHORT += ["north-west", "north-east", "south-west", "south-east"]
SHORT += ["No plane", "Not seen", "rounded", *dxf.COLOUR_NAMES.values()]
SHORT += [f"{where} {unit}" for unit in dxf.UNIT_NAMES.values() for where in ("in", LOCAL)]
SHORT += [within_sentence(name) for name in NAMES.values()]
# Words in the columns that reports show.
WORDS = "ground tree building water rail road line other tower pole conductor wire door window"
WORDS += " critical watch falling plane shore island flat gable hip left right"
WORDS += " recess behind reflectance outline grid none others height span survey"
WORDS += " facade any horizontal vertical known"
WORDS += " wires parameters counts"
WORDS += " bottom top unseen unclassified blocks all level dark raster vector table"
FAULTS = ("AssertionError", "AttributeError", "TypeError")  # of code, told to who writes it
PERCENT = re.compile(r"%[-+#0 ]*\d*(?:\.\d+)?[sdgfr]")
VALUE = re.compile(r"\{\d+\}")
# what a translation must hold as it is: `names`, {places}, %s, --options, ids of tools
KEPT = re.compile(r"``[^`]+``|`[^`]+`|\{[^}]*\}|%[sd]|--[a-z][\w-]*|\b[a-z]+\.[a-z_]+\b(?!\.)")


def of_tools() -> list[str]:
    """All texts of tools that people read, each once, in the order of the tools."""
    return list(dict.fromkeys(text for id in catalog.own_ids() for text in _of_tool(id)))


def _of_tool(id: str) -> Iterator[str]:
    spec = catalog.load(id)
    tool = spec.describe()
    first, _, more = tool["description"].partition("\n\n")
    yield from (spec.group, tool["title"], first.removesuffix("."))
    yield from filter(None, more.split("\n\n"))
    for field in [*tool["inputs"].values(), *tool["outputs"].values()]:
        yield from (field["title"], field["description"])
        spoken = (meta["value"] for meta in field["metadata"] if meta["role"] in language.SPOKEN)
        yield from spoken
    yield from (file["description"] for file in tool.get("deliver", []))
    for field in spec.results.values():
        yield from filter(None, (text for show in field.show for text in _in_plots(show)))
    for field in spec.inputs.values():  # words of a choice that says enough by itself
        if spec.id != "samples.scene":  # whose presets keep their names
            yield from (field.choice_title(choice) for choice in field.choices)


def _in_plots(show: Any) -> Iterator[str]:
    """The texts that a plot has because of how a layer is shown."""
    yield from (name for name, _ in getattr(show, "looks", {}).values())
    yield from (getattr(show, name, "") for name in ("label", "note", "shaded_as"))
    axes = (show.over, *show.lines) if isinstance(show, Curve) else ()
    yield from (axis.label for axis in axes)


def of_code() -> list[str]:
    """All texts that the code marks."""
    found: dict[str, None] = {}
    for path in sorted(CODE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "language.text":
                for arg in node.args:
                    if isinstance(arg, ast.Constant):
                        found[str(arg.value)] = None
    for name in ("page.html", "page.js"):
        page = (CODE / "data" / "report" / name).read_text(encoding="utf-8")
        found |= dict.fromkeys(ON_PAGES.findall(page))
    return list(dict.fromkeys([*found, "warning", "error"]))


def of_told() -> list[str]:
    """All texts that warnings, errors and reports may say: of some words, with marks for values."""
    told = dict.fromkeys(" ".join(text.split()) for text in pieces())
    elsewhere = {*of_tools(), *of_code()}
    heads = [*PROBLEMS, *HEADS, *COUNTS, *SHORT, *WORDS.split(), *NAMES.values(), *_of_rules()]
    return list(dict.fromkeys(text for text in [*told, *heads] if text not in elsewhere))


def _of_rules() -> Iterator[str]:
    """The sources and notes of the rule tables, with marks for what differs from row to row."""
    for path in sorted(RULES.glob("*.csv")):
        with path.open(encoding="utf-8") as table:
            for row in csv.DictReader(table):
                texts = filter(None, (row["source"], row["note"]))
                yield from (OF_ROW.sub("{1}", text) for text in texts)


@functools.cache
def pieces() -> list[str]:
    """The texts of `of_told` with the blanks of the code, each once, in the order of the code."""
    found: dict[str, None] = {}
    for folder in (CODE, CODE.parent / "algorithms"):
        for path in sorted(folder.rglob("*.py")):
            if not any(part in path.as_posix() for part in SILENT):
                tree = ast.parse(path.read_text(encoding="utf-8"))
                found |= dict.fromkeys(_told_by(tree, "report" in path.as_posix()))
    return list(found)


def _told_by(tree: ast.AST, reports: bool) -> Iterator[str]:
    """The texts of a module that people may read, in the order of the code."""
    silent = {id(part) for node in ast.walk(tree) for part in _silent_in(node)}
    short = {id(part) for node in ast.walk(tree) for part in _headings_in(node, reports)}
    for node in ast.walk(tree):
        if id(node) in silent or (text := _with_marks(node)) is None:
            continue
        words = WORD.findall(VALUE.sub(" ", text))
        is_text = len(words) > FEW and not NO_TEXT.search(" ".join(text.split()))
        if is_text or (id(node) in short and words):
            yield text


def _silent_in(node: ast.AST) -> Iterator[ast.AST]:
    """Parts of a node that are no texts, or stand in another catalogue."""
    body = getattr(node, "body", None)
    if isinstance(body, list):
        yield from (s.value for s in body if isinstance(s, ast.Expr))  # docstrings
    if isinstance(node, ast.JoinedStr):
        yield from node.values
    if isinstance(node, ast.Raise) and node.exc and _is_call(node.exc, *FAULTS):
        yield from ast.walk(node)
    if _is_call(node, *ELSEWHERE):
        inside = list(ast.walk(node))
        columns = {id(p) for call in inside if _is_call(call, "Column") for p in ast.walk(call)}
        yield from (part for part in inside if id(part) not in columns)


def _headings_in(node: ast.AST, reports: bool) -> Iterator[ast.AST]:
    """Texts that may be of one word: headings of sections, columns and facts."""
    if _is_call(node, "Column", "Section", "Rows", "Figure"):
        yield from (part for arg in ast.iter_child_nodes(node) for part in _plain(arg))
    if isinstance(node, ast.Dict) and reports:  # elsewhere names that other programs ask for
        keys = [k.value for k in node.keys if isinstance(k, ast.Constant)]
        named = [k for k, v in zip(node.keys, node.values, strict=True) if not _is_none(v)]
        if keys and all(isinstance(key, str) and key[:1].isupper() for key in keys):
            yield from filter(None, named)


def _plain(arg: ast.AST) -> Iterator[ast.AST]:
    value = arg.value if isinstance(arg, ast.keyword) else arg
    if not isinstance(arg, ast.keyword) or arg.arg in ("heading", "meaning", "caption", "title"):
        yield value


def _is_none(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _is_call(node: ast.AST, *names: str) -> bool:
    called = node.func if isinstance(node, ast.Call) else None
    return getattr(called, "attr", None) in names or getattr(called, "id", None) in names


def _with_marks(node: ast.AST) -> str | None:
    """A text of the code, with {1}, {2} in place of its values; None of what is no text."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and "{" not in node.value:
        text = PERCENT.sub("\0", node.value).replace("%%", "%")
    elif isinstance(node, ast.JoinedStr):
        text = "".join(str(v.value) if isinstance(v, ast.Constant) else "\0" for v in node.values)
    else:
        return None
    number = itertools.count(1)
    return re.sub("\0", lambda _: f"{{{next(number)}}}", text)


def update(path: Path, texts: Iterable[str], code: str) -> polib.POFile:
    """The catalogue of a file with an entry for each of the texts; it is not written."""
    old = polib.pofile(str(path), encoding="utf-8") if path.exists() else polib.POFile()
    known = {entry.msgid: entry.msgstr for entry in old if entry.msgstr}
    made = polib.POFile(wrapwidth=98)
    made.metadata = {
        "Language": code,
        "MIME-Version": "1.0",
        "Content-Type": "text/plain; charset=utf-8",
        "Content-Transfer-Encoding": "8bit",
    }
    wanted = list(texts)
    made.extend(polib.POEntry(msgid=text, msgstr=known.pop(text, "")) for text in wanted)
    made.extend(
        polib.POEntry(msgid=text, msgstr=said, obsolete=True) for text, said in known.items()
    )
    return made


def wrong(entry: polib.POEntry) -> set[str]:
    """Names and places that a translation lacks, or has too many."""
    return _kept(entry.msgid) ^ _kept(entry.msgstr)


def _kept(text: str) -> set[str]:
    return {" ".join(word.split()) for word in KEPT.findall(text)}


def sources() -> dict[str, list[str]]:
    """The texts that each catalogue must have."""
    return {"tools.po": of_tools(), "messages.po": of_code(), language.TOLD: of_told()}


def main() -> None:
    """Write all catalogues, and say what is missing."""
    found = sources()
    for folder in sorted(path for path in FOLDER.iterdir() if path.is_dir()):
        for name, texts in found.items():
            made = update(folder / name, texts, folder.name)
            made.save(str(folder / name))
            done, all_ = len(made.translated_entries()), len(texts)
            bad = [entry.msgid for entry in made.translated_entries() if wrong(entry)]
            gone = len(made.obsolete_entries())
            says = f"{done} of {all_} texts, {gone} obsolete, {len(bad)} wrong"
            sys.stdout.write(f"{folder.name}/{name}: {says}\n")
            sys.stdout.writelines(f"  wrong: {text[:80]}\n" for text in bad)


if __name__ == "__main__":
    main()
