"""What plugins.qgis.org asks of a plugin: metadata from the settings of the project, and checks.

The rules are those of the site's own validator (November 2026), but for asking the addresses.
"""

from __future__ import annotations

import re
import tomllib
import zipfile
from collections.abc import Iterator
from configparser import ConfigParser
from configparser import Error as BadConfig
from pathlib import Path
from urllib.parse import urlparse

from toolbox import __version__
from toolbox.places import METADATA

# An installed wheel carries both files in the folder of metadata, a checkout has them beside it.
_HERE = next(p for p in (METADATA, METADATA.parent) if (p / "pyproject.toml").is_file())
PROJECT, CHANGES = _HERE / "pyproject.toml", _HERE / "CHANGELOG.md"
SETTINGS = "tool.lidar-toolbox.addresses"
KEYS = {"homepage": "homepage", "repository": "repository", "tracker": "tracker", "email": "mail"}
"""The name in the settings of each key of the metadata."""

REQUIRED = ("name", "description", "version", "qgisMinimumVersion", "author", "about")
URLS = ("homepage", "repository", "tracker")
FLAGS = ("experimental", "deprecated", "hasProcessingProvider")
LARGEST = 25_000_000  # bytes
FORBIDDEN = ("__MACOSX", ".git", "__pycache__")
LINES = 60  # of the changes that the site shows


def addresses() -> dict[str, str]:
    """The addresses of the project by key of the metadata; empty where there is none yet."""
    said = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["tool"]["lidar-toolbox"]["addresses"]
    return {key: str(said.get(name, "")) for key, name in KEYS.items()}


def metadata(template: str) -> str:
    """The text of metadata.txt with version, addresses and changes; what is empty is left out."""
    text = template.replace("version=0\n", f"version={__version__}\n")
    known = {key: address for key, address in addresses().items() if address}
    lines = [f"{key}={_plain(address)}" for key, address in known.items()]
    return "\n".join([text.rstrip("\n"), *lines, f"changelog={_changes()}"]) + "\n"


def _changes() -> str:
    """What is new in this version for users of QGIS, as an indented text of the metadata."""
    if not CHANGES.is_file():
        return __version__
    newest = re.split(r"(?m)^## ", CHANGES.read_text(encoding="utf-8"))[1]
    entries = re.findall(r"(?ms)^- .*?(?=^- |^#|\Z)", newest)
    told = [" ".join(entry.split()) for entry in entries if "QGIS" in entry]
    return "\n  ".join([__version__, *(_plain(entry) for entry in told[:LINES])])


def _plain(text: str) -> str:
    """A value without signs that the format gives a meaning."""
    return text.replace("%", "%%")


# Checks ------------------------------------------------------------------------------------------


def problems(path: Path) -> list[str]:
    """What plugins.qgis.org would refuse in a packed plugin; empty if it would take it."""
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        found = [*_of_files(names)]
        folder = names[0].partition("/")[0]
        text = archive.read(f"{folder}/metadata.txt").decode("utf-8")
    if path.stat().st_size > LARGEST:
        found.append(f"it has more than {LARGEST // 1_000_000} MB")
    return [*found, *_of_metadata(text, {name.partition("/")[2] for name in names})]


def _of_files(names: list[str]) -> Iterator[str]:
    folders = {name.partition("/")[0] for name in names}
    if len(folders) != 1 or not all(folder.isidentifier() for folder in folders):
        yield f"its files must be in one folder with a name of Python, got {sorted(folders)}"
    for name in names:
        if ".." in name or name.startswith("/") or "\\" in name or re.match("[A-Za-z]:", name):
            yield f"{name} is no plain path"
        if ".pyc" in name or {*name.split("/")} & {*FORBIDDEN}:
            yield f"{name} must not be in it"
    within = {name.partition("/")[2] for name in names}
    yield from (f"there is no {name}" for name in ("__init__.py", "LICENSE") if name not in within)


def _of_metadata(text: str, files: set[str]) -> Iterator[str]:
    parser = ConfigParser()
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    try:
        parser.read_string(text)
        said = dict(parser.items("general"))
    except BadConfig as err:
        yield f"metadata.txt cannot be read: {err}"
        return
    yield from (f"metadata.txt has no {key}" for key in REQUIRED if not said.get(key))
    if missing := [name for key, name in KEYS.items() if not said.get(key)]:
        yield f"fill in {', '.join(missing)} under [{SETTINGS}] in pyproject.toml"
    for key in (key for key in URLS if said.get(key)):
        parts = urlparse(said[key])
        if not (parts.scheme and parts.netloc):
            yield f"{key} must be an address of the web, got {said[key]}"
    if "/" in said.get("author", ""):
        yield "author has a slash"
    if said.get("icon") not in files:
        yield f"there is no icon {said.get('icon')}"
    if "supportsQt6" in said:
        yield "supportsQt6 is no longer read"
    for key in ("qgisMinimumVersion", "qgisMaximumVersion"):
        if not re.fullmatch(r"\d+\.\d+", said.get(key, "0.0")):
            yield f"{key} must be two numbers such as 3.22, got {said[key]}"
    for key in FLAGS:
        if said.get(key, "False").lower() not in ("true", "false", "yes", "no"):
            yield f"{key} must be True or False, got {said[key]}"
