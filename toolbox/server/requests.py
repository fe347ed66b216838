"""Turns a request to execute a tool into its values, and keeps it inside its folders.

Layers and other files come by reference: ``{"href": "a.laz"}`` is a file in the folder of data, and
the address of a result of an earlier job is that file. Nothing else can be named.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from toolbox.errors import ParameterError

REFUSED = (".vpc", ".yaml", ".yml", ".vrt")  # files that name other files
FILES = re.compile(r"/files/([0-9a-f-]{36})/([\w.-]+)")  # address of a result
ELSEWHERE = re.compile(r"[/\\]")  # a text that may be a path


class Places:
    """The folder of data, and that of jobs, and the path of the address at which clients see us."""

    def __init__(self, data: Path, jobs: Path, url: str = "") -> None:
        self.data, self.jobs = data.resolve(), jobs.resolve()
        self.base = urlsplit(url).path

    def path_of(self, href: str) -> Path:
        """The file that a reference names.

        Raises
        ------
        ValueError
            It is none of the data and no result, or of a kind that names other files.
        """
        result = FILES.fullmatch(urlsplit(href).path.removeprefix(self.base))
        root = self.jobs / result[1] if result else self.data
        path = (root / (result[2] if result else unquote(href))).resolve()
        if not path.is_relative_to(root) or not path.exists() or path == root:
            raise ValueError(f"{href!r} is no file of the data of this server, and no result")
        if path.suffix.lower() in REFUSED:
            raise ValueError(f"{path.suffix} names other files, and is not taken")
        return path


def problem_of(body: bytes) -> str | None:
    """Why the body of a request is none that asks for a job; None if it may be one.

    pygeoapi takes for granted what is looked at here.
    """
    try:
        said = json.loads(body or b"{}")
    except (ValueError, RecursionError):
        return "the body is not JSON"
    if not isinstance(said, dict):
        return 'the body must be an object: {"inputs": {...}}'
    for name in ("inputs", "outputs", "subscriber"):
        if not isinstance(said.get(name, {}), dict):
            return f"{name} must be an object, by names"
    return None


def values_of(
    described: Mapping[str, Any], inputs: Mapping[str, Any], places: Places
) -> dict[str, Any]:
    """The inputs of a run.

    Raises
    ------
    ParameterError
        All inputs that are unknown, missing or not allowed here.
    """
    problems, values = {}, {}
    for name, field in described["inputs"].items():
        if field["minOccurs"] and name not in inputs:
            problems[name] = f"missing ({field['description']})"
    for name, value in inputs.items():
        try:
            values[name] = _value(described["inputs"].get(name), value, places)
        except ValueError as err:
            problems[name] = str(err)
    if problems:
        raise ParameterError(described["id"], problems)
    return values


def _value(field: Mapping[str, Any] | None, value: Any, places: Places) -> Any:
    if field is None:
        raise ValueError("unknown parameter")
    if not _is_layer(field):
        plain = value["value"] if isinstance(value, Mapping) and "value" in value else value
        kinds = [meta["value"] for meta in field["metadata"] if meta["role"] == "type"]
        texts = plain if isinstance(plain, list) else [plain]
        if "text" in kinds and any(ELSEWHERE.search(str(text)) for text in texts):
            raise ValueError("a text with / or \\ may be a path, and is not taken here")
        if "file" in kinds:
            return str(places.path_of(_href(value)))
        return plain
    given = value if isinstance(value, list) else [value]
    paths = [str(places.path_of(_href(item))) for item in given]
    return paths if isinstance(value, list) else paths[0]


def _href(value: Any) -> str:
    """The reference that stands for a file."""
    if isinstance(value, Mapping) and isinstance(href := value.get("href"), str):
        return href
    raise ValueError('a layer or file is given by reference: {"href": "name.laz"}')


def outputs_of(described: Mapping[str, Any], wanted: Iterable[str] | None) -> dict[str, str]:
    """The name of the file of each layer that is asked for, or of all.

    Raises
    ------
    ParameterError
        An output is unknown.
    """
    known = described["outputs"]
    names = list(known) if wanted is None else list(wanted)
    if unknown := {name: "unknown output" for name in names if name not in known}:
        raise ParameterError(described["id"], unknown)
    layers = [name for name in names if _is_layer(known[name])]
    return {name: f"{name}{_suffix(known[name])}" for name in layers}


def media_type(described: Mapping[str, Any], name: str) -> str:
    """The media type of an output."""
    schema = described["outputs"][name]["schema"]
    return str(schema.get("items", schema).get("contentMediaType", "application/octet-stream"))


def _suffix(field: Mapping[str, Any]) -> str:
    found = [meta["value"] for meta in field["metadata"] if meta["role"] == "suffix"]
    return ".laz" if ".laz" in found else str(found[0])


def _is_layer(field: Mapping[str, Any]) -> bool:
    schema = field["schema"]
    return bool(schema.get("items", schema).get("format") == "uri-reference")
