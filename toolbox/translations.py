"""Brings the catalogues of translations up to date: ``make translations``.

``tools.po`` has the texts of all tools, from their descriptions; ``messages.po`` those that the
code marks with ``language.text("...")``. Texts that are gone become obsolete entries, from which a
text that comes back takes its translation.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import polib

from toolbox import catalog, language
from toolbox.language import FOLDER

CODE = Path(__file__).parent
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
    for field in spec.inputs.values():  # words of a choice that says enough by itself
        if spec.id != "samples.scene":  # whose presets keep their names
            yield from (field.choice_title(choice) for choice in field.choices)


def of_code() -> list[str]:
    """All texts that the code marks."""
    found: dict[str, None] = {}
    for path in sorted(CODE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "language.text":
                for arg in node.args:
                    if isinstance(arg, ast.Constant):
                        found[str(arg.value)] = None
    return list(found)


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


def main() -> None:
    """Write all catalogues, and say what is missing."""
    sources = {"tools.po": of_tools(), "messages.po": of_code()}
    for folder in sorted(path for path in FOLDER.iterdir() if path.is_dir()):
        for name, texts in sources.items():
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
