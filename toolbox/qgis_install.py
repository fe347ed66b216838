"""Putting the plugin together, into a QGIS profile or a zip, and looking whether all is well."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from toolbox import __version__, qgis_process
from toolbox.errors import DataError, ToolboxError
from toolbox.qgis_tools import listing

SOURCE = Path(__file__).parent / "qgis_plugin"
FOLDER = "lidar_toolbox"
PLUGINS, INI = Path("python/plugins"), Path("QGIS/QGIS3.ini")
ENVIRONMENT = "environment.json"
PACKED = (".py", ".txt", ".svg", "LICENSE")
PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>body {{font: 15px sans-serif; max-width: 46em; margin: 2em auto; line-height: 1.45}}</style>
</head><body><h1>{title}</h1>
{help}
</body></html>
"""


def contents() -> dict[str, str]:
    """The files of the plugin by their paths in its folder: its code, the tools, their help."""
    made = {
        path.name: path.read_text(encoding="utf-8")
        for path in sorted(SOURCE.iterdir())
        if path.name.endswith(PACKED)
    }
    made["metadata.txt"] = made["metadata.txt"].replace("version=0\n", f"version={__version__}\n")
    listed = listing()
    made["tools.json"] = json.dumps(listed, ensure_ascii=False, indent=1) + "\n"
    for tool in listed["tools"]:
        made[f"help/{tool['id']}.html"] = PAGE.format(title=tool["title"], help=tool["help"])
    return made


def package(path: Path) -> int:
    """Write the zip that plugins.qgis.org takes; return the number of its files.

    Raises
    ------
    DataError
        It cannot be written.
    """
    made = contents()
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, text in made.items():
                entry = zipfile.ZipInfo(f"{FOLDER}/{name}")  # of one date: the same zip each time
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, text)
    except OSError as err:
        raise DataError(f"{path} cannot be written: {err.strerror}") from err
    return len(made)


def install(profile: Path) -> Path:
    """Put the plugin into a profile, switch it on there, and let it use this Python.

    Raises
    ------
    DataError
        The profile cannot be written.
    """
    home = profile / PLUGINS / FOLDER
    made = contents()
    made[ENVIRONMENT] = json.dumps(this_environment(), ensure_ascii=False, indent=1) + "\n"
    try:
        home.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=home.parent, prefix=f".{FOLDER}-") as temporary:
            new, old = Path(temporary) / "new", Path(temporary) / "old"
            for name, text in made.items():
                (new / name).parent.mkdir(parents=True, exist_ok=True)
                (new / name).write_text(text, encoding="utf-8")
            if home.exists():
                home.rename(old)
            new.rename(home)
        ini = profile / INI
        ini.parent.mkdir(parents=True, exist_ok=True)
        text = ini.read_text(encoding="utf-8") if ini.exists() else ""
        if (enabled := switched_on(text)) != text:
            ini.write_text(enabled, encoding="utf-8")
    except OSError as err:
        raise DataError(f"{err.filename or home}: cannot be written: {err.strerror}") from err
    return home


def switched_on(ini: str) -> str:
    """The settings of QGIS with the plugin switched on, and all else as it is.

    >>> switched_on("[app]\\na=1\\n")
    '[app]\\na=1\\n\\n[PythonPlugins]\\nlidar_toolbox=true\\n'
    """
    line = f"{FOLDER}=true"
    section = re.search(r"(?m)^\[PythonPlugins\]\s*$", ini)
    if section is None:
        gap = "\n" if ini else ""
        end = "" if not ini or ini.endswith("\n") else "\n"
        return f"{ini}{end}{gap}[PythonPlugins]\n{line}\n"
    start, rest = ini[: section.end()], ini[section.end() :]
    body, heading, others = re.match(r"(?s)(.*?)(^\[.*|\Z)(.*)", rest, re.M).groups()  # type: ignore[union-attr]
    said = re.compile(rf"(?m)^{FOLDER}=.*$")
    if said.search(body):
        return start + said.sub(line, body, count=1) + heading + others
    return f"{start}\n{line}{body}{heading}{others}"


def this_environment() -> dict[str, str]:
    """This Python, and the folder of the toolbox if it is not installed there."""
    own = Path(__file__).resolve().parents[1]
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    words = [sys.executable, "-s", "-c", "import toolbox; print(toolbox.__file__)"]
    with tempfile.TemporaryDirectory() as elsewhere:
        done = subprocess.run(
            words, env=env, cwd=elsewhere, capture_output=True, text=True, check=False
        )
    there = Path(done.stdout.strip() or elsewhere).resolve()
    found = {"python": sys.executable}
    return found if own in there.parents else found | {"root": str(own)}


def default_profile() -> Path:
    """The profile that QGIS opens for this user."""
    homes = [home for home in _homes() if home.is_dir()]
    profiles = (homes or _homes()[:1])[0] / "profiles"
    try:
        said = re.search(r"(?m)^defaultProfile=(.+)$", (profiles / "profiles.ini").read_text())
    except OSError:
        said = None
    return profiles / (said[1].strip() if said else "default")


def _homes() -> list[Path]:
    """Where QGIS keeps its settings: of QGIS 3 first."""
    if said := os.environ.get("QGIS_CUSTOM_CONFIG_PATH"):
        return [Path(said)]
    base = {
        "win32": os.environ.get("APPDATA", ""),
        "darwin": "~/Library/Application Support",
    }.get(sys.platform, os.environ.get("XDG_DATA_HOME") or "~/.local/share")
    return [Path(base).expanduser() / "QGIS" / name for name in ("QGIS3", "QGIS4")]


# Doctor ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at; `mend` says what to do if it is not well."""

    what: str
    mend: str = ""


def findings(profile: Path) -> Iterator[Finding]:
    """What is found, what is missing, and how to mend it."""
    yield _program()
    home = profile / PLUGINS / FOLDER
    again = "python -m toolbox qgis install"
    if profile != default_profile():
        again += f" --profile {profile}"
    if not (home / "metadata.txt").is_file():
        yield Finding(f"the plugin is not in {home.parent}", again)
        return
    yield Finding(f"plugin {home}")
    yield _tools(home, again)
    ini = profile / INI
    text = ini.read_text(encoding="utf-8") if ini.is_file() else ""
    on = switched_on(text) == text
    yield Finding("switched on") if on else Finding(f"not switched on in {ini}", again)
    yield _python(home, again)


def _program() -> Finding:
    path = qgis_process.find()
    if path is None:
        return Finding("QGIS was not found", qgis_process.ABSENT)
    try:
        return Finding(f"QGIS {qgis_process.version()} ({path})")
    except ToolboxError as err:
        mend = f"let {qgis_process.VARIABLE} name a program that works, such as qgis_process.bin"
        return Finding(f"{path} does not work: {err}", mend)


def _tools(home: Path, again: str) -> Finding:
    try:
        tools = json.loads((home / "tools.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as err:
        return Finding(f"tools.json cannot be read: {err}", again)
    if tools != listing():
        return Finding(f"tools.json is of version {tools.get('toolbox')}, or of other tools", again)
    return Finding(f"{len(tools['tools'])} tools")


def _python(home: Path, again: str) -> Finding:
    """The Python that the plugin would start, if the settings page does not name another."""
    said = os.environ.get("LIDAR_TOOLBOX_PYTHON")
    try:
        known = json.loads((home / ENVIRONMENT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        known = {}
    python = said or known.get("python") or ""
    if not python:
        return Finding("no Python is set for the tools", again)
    if shutil.which(python) is None:
        return Finding(f"there is no Python {python}", again)
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    env["PYTHONPATH"] = known.get("root", "")
    words = [python, "-s", "-m", "toolbox", "--version"]
    done = subprocess.run(words, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["it does not start"])[-1]
        return Finding(f"{python}: {last}", again)
    found = done.stdout.strip()
    if found != f"lidar-toolbox {__version__}":
        return Finding(f"{python} has {found}, this is {__version__}", again)
    return Finding(f"Python {python} with {found}")
