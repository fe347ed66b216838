"""A file of the set that a run hands over with ``--deliver FOLDER``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from toolbox.data import Report
from toolbox.declare.kinds import Kind, find, parsed_options
from toolbox.shown import PAGE


@dataclass(frozen=True)
class Delivered:
    """A file of the set, or a layer of a GeoPackage that is one.

    Attributes
    ----------
    file : its name in the folder
    output : the result that it holds: an output, step.output, or "page" for the report
    help : what it holds, for its line in the README
    options : of writing, as on the command line
    in_report : whether the report of the set shows the result, too, where it is no output
    needed : whether the set is not handed over without it, as that would say nothing
    """

    file: str
    output: str
    help: str
    options: Mapping[str, Any] = field(default_factory=dict)
    in_report: bool = False
    needed: bool = False

    @property
    def key(self) -> str:
        """What tells it from all others of the set."""
        return " ".join(filter(None, (self.file, str(self.options.get("layer", "")))))

    def kind(self, kinds: Mapping[str, Kind]) -> Kind | None:
        """The kind of its result, given those of all results; None if there is no such result."""
        return find(Report) if self.output == PAGE else kinds.get(self.output)

    def problem(self, kinds: Mapping[str, Kind]) -> str | None:
        """What is wrong with its declaration; None if all is well."""
        kind = self.kind(kinds)
        if kind is None:
            return f"nothing called {self.output!r}"
        if not self.file.lower().endswith(kind.suffixes or ("?",)) or "/" in self.file:
            return f"{self.file!r} cannot hold a {kind.word}"
        try:
            parsed_options(self.options, kind.save_options)
        except ValueError as err:
            return str(err)
        return None
