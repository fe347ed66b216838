"""Puts the plugin into a QGIS profile or a zip, and checks its installation."""

from __future__ import annotations

import hashlib
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

from toolbox import __version__, language
from toolbox.errors import DataError, ToolboxError
from toolbox.qgis import process as qgis_process
from toolbox.qgis.published import metadata
from toolbox.qgis.tools import listing

SOURCE = Path(__file__).parent / "plugin"
FOLDER = "lidar_toolbox"
PLUGINS, SETTINGS = Path("python/plugins"), Path("QGIS")
ENVIRONMENT = "environment.json"
OWN = "lidar_toolbox_env"  # the environment that the settings page of the plugin creates
PACKED = (".py", ".txt", ".svg", "LICENSE")
# Must run in the Python of the tools, which needs their libraries, too.
CHECK = "from toolbox.qgis.tools import listing; print('lidar-toolbox', listing()['toolbox'])"
PAGE = """<!DOCTYPE html>
<html lang="{code}"><head><meta charset="utf-8"><title>{title}</title>
<style>body {{font: 15px sans-serif; max-width: 46em; margin: 2em auto; line-height: 1.45}}</style>
</head><body><h1>{title}</h1>
{help}
</body></html>
"""


def contents() -> dict[str, str]:
    """The text of each file of the plugin by its path: code, list of tools, help pages."""
    made = {
        path.relative_to(SOURCE).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted(SOURCE.rglob("*"))
        if path.name.endswith(PACKED)
    }
    made["metadata.txt"] = metadata(made["metadata.txt"])
    for code in ("en", *language.languages()):
        made |= _texts_of(code)
    return made


def _texts_of(code: str) -> dict[str, str]:
    """The list of tools, the help and the texts of the dialogs in a language."""
    ending = "" if code == "en" else f".{code}"
    with language.speaking(code):
        listed = listing()
    made = {f"tools{ending}.json": _json(listed)}
    for tool in listed["tools"]:
        page = PAGE.format(code=code, title=tool["title"], help=tool["help"])
        made[f"help/{tool['id']}{ending}.html"] = page
    if ending:
        made[f"texts{ending}.json"] = _json(language.catalogue(code, "messages.po"))
    return made


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, indent=1) + "\n"


def package(path: Path, wheel: Path | None = None, needs: Path | None = None) -> int:
    """Write the zip that plugins.qgis.org takes; return the number of its files.

    Parameters
    ----------
    wheel : of the toolbox, from which the plugin creates an environment
    needs : what the wheel needs, with hashes, in the form of pip's requirements

    Raises
    ------
    DataError
        It cannot be written, or a file to pack cannot be read.
    """
    made: dict[str, str | bytes] = {**contents()}
    try:
        made |= _wheel(wheel, needs) if wheel else {}
    except OSError as err:
        raise DataError(f"{err.filename} cannot be read: {err.strerror}") from err
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, text in made.items():
                entry = zipfile.ZipInfo(f"{FOLDER}/{name}")  # of one date: the same zip each time
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, text)
    except OSError as err:
        raise DataError(f"{path} cannot be written: {err.strerror}") from err
    return len(made)


def _wheel(wheel: Path, needs: Path | None) -> dict[str, bytes]:
    """The wheel, its hash, and the list of what it needs, as the settings page reads them.

    Raises
    ------
    DataError
        It is no wheel of this version, or the list has an entry without a hash.
    """
    if not wheel.name.startswith(f"lidar_toolbox-{__version__}-") or wheel.suffix != ".whl":
        raise DataError(f"{wheel} is no wheel of lidar-toolbox {__version__}")
    body = wheel.read_bytes()
    line = f"{hashlib.sha256(body).hexdigest()}  {wheel.name}\n"
    made = {f"wheel/{wheel.name}": body, "wheel/SHA256": line.encode()}
    if needs is None:
        return made
    lines = needs.read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
    entries = [line for line in lines if line.strip() and not line.lstrip().startswith(("#", "--"))]
    if bare := [line for line in entries if "--hash=" not in line]:
        raise DataError(f"{needs}: {bare[0].split()[0]} has no hash; pip-compile --generate-hashes")
    return made | {"wheel/requirements.txt": needs.read_bytes()}


def install(profile: Path) -> Path:
    """Put the plugin into a profile, enable it there, and let it use this Python.

    Raises
    ------
    DataError
        The profile cannot be written.
    """
    folder = profile / PLUGINS / FOLDER
    made = contents()
    made[ENVIRONMENT] = json.dumps(this_environment(), ensure_ascii=False, indent=1) + "\n"
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{FOLDER}-") as temporary:
            new, old = Path(temporary) / "new", Path(temporary) / "old"
            for name, text in made.items():
                (new / name).parent.mkdir(parents=True, exist_ok=True)
                (new / name).write_text(text, encoding="utf-8")
            if folder.exists():
                folder.rename(old)
            new.rename(folder)
        for ini in settings_files(profile):
            if (enabled := switched_on(text := _settings(ini))) != text:
                _replace(ini, enabled)
    except OSError as err:
        raise DataError(f"{err.filename or folder}: cannot be written: {err.strerror}") from err
    return folder


def uninstall(profile: Path) -> Path:
    """Take the plugin out of a profile.

    Raises
    ------
    DataError
        It is not there, or cannot be removed.
    """
    folder = profile / PLUGINS / FOLDER
    if not folder.is_dir():
        raise DataError(f"the plugin is not in {folder.parent}")
    try:
        shutil.rmtree(folder)
        for ini in settings_files(profile):
            if f"\n{FOLDER}=" in (text := _settings(ini)):
                _replace(ini, re.sub(rf"(?m)^{FOLDER}=.*\n?", "", text))
    except OSError as err:
        raise DataError(f"{err.filename or folder}: cannot be removed: {err.strerror}") from err
    return folder


def settings_files(profile: Path) -> list[Path]:
    """The settings files of a profile, of QGIS 3 and 4; the one that QGIS will make if none is."""
    folder = profile / SETTINGS
    found = [path for path in (folder / "QGIS3.ini", folder / "QGIS4.ini") if path.is_file()]
    return found or [folder / ("QGIS4.ini" if "QGIS4" in profile.parts else "QGIS3.ini")]


def _settings(ini: Path) -> str:
    return ini.read_text(encoding="utf-8", errors="surrogateescape") if ini.is_file() else ""


def _replace(ini: Path, text: str) -> None:
    """Replace a settings file of QGIS, completely or not at all."""
    ini.parent.mkdir(parents=True, exist_ok=True)
    new = ini.with_name(f".{ini.name}-{os.getpid()}")
    try:
        new.write_text(text, encoding="utf-8", errors="surrogateescape")
        new.replace(ini)
    finally:
        new.unlink(missing_ok=True)


def switched_on(ini: str) -> str:
    """The text of settings of QGIS with the plugin enabled, and all else unchanged.

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
    """This Python, and the folder of the toolbox if it is not installed in it."""
    own = Path(__file__).resolve().parents[2]
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
    folders = [folder for folder in _settings_folders() if folder.is_dir()]
    profiles = (folders or _settings_folders())[0] / "profiles"
    text = _settings(profiles / "profiles.ini")
    said = dict(re.findall(r"(?m)^(defaultProfile|lastProfile|selectionPolicy)=(.+?)\s*$", text))
    last = said.get("lastProfile", "") if said.get("selectionPolicy", "0") == "0" else ""
    named = [last, said.get("defaultProfile", "")]
    return profiles / next((n for n in named if n and (profiles / n).is_dir()), "default")


def _settings_folders() -> list[Path]:
    """The folders of the settings of QGIS 3 and 4."""
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
    """The result of one check; `mend` says what to do if it failed."""

    what: str
    mend: str = ""


def findings(profile: Path) -> Iterator[Finding]:
    """Check the installation: what is found, what is missing, and how to mend it."""
    yield _program()
    folder = profile / PLUGINS / FOLDER
    again = "python -m toolbox qgis install"
    if profile != default_profile():
        again += f" --profile {profile}"
    if not (folder / "metadata.txt").is_file():
        yield Finding(f"the plugin is not in {folder.parent}", again)
        return
    yield Finding(f"plugin {folder}")
    yield _tools(folder, again)
    inis = settings_files(profile)
    off = [ini for ini in inis if switched_on(text := _settings(ini)) != text]
    yield Finding(f"not switched on in {off[0]}", again) if off else Finding("switched on")
    yield _python(profile, again)


def _program() -> Finding:
    path = qgis_process.find()
    if path is None:
        return Finding("QGIS was not found", qgis_process.ABSENT)
    try:
        return Finding(f"QGIS {qgis_process.version()} ({path})")
    except ToolboxError as err:
        mend = f"let {qgis_process.VARIABLE} name a program that works, such as qgis_process.bin"
        return Finding(f"{path} does not work: {err}", mend)


def _tools(folder: Path, again: str) -> Finding:
    try:
        tools = json.loads((folder / "tools.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as err:
        return Finding(f"tools.json cannot be read: {err}", again)
    with language.speaking("en"):
        listed = listing()
    if tools != listed:
        return Finding(f"tools.json is of version {tools.get('toolbox')}, or of other tools", again)
    return Finding(f"{len(tools['tools'])} tools")


def _python(profile: Path, again: str) -> Finding:
    """Check the Python that the plugin would start."""
    try:
        known = json.loads((profile / PLUGINS / FOLDER / ENVIRONMENT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        known = {}
    python, by = _named(profile)
    mend = f"set another in {by}" if by else again
    own = profile / OWN / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    whole = (profile / OWN / "complete.txt").is_file()  # else its creation was cut off
    usual = (str(known.get("python", "")), str(own) if whole else "")
    python = python or next(filter(os.path.isfile, usual), usual[0])
    if not python:
        return Finding("no Python is set for the tools", mend)
    if not os.path.isfile(python):
        return Finding(f"there is no Python {python}", mend)
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    env |= {"PYTHONPATH": known.get("root", ""), "PYTHONSAFEPATH": "1"}  # as the plugin does
    try:
        done = subprocess.run(
            [python, "-s", "-c", CHECK], env=env, capture_output=True, text=True, check=False
        )
    except OSError as err:
        return Finding(f"{python} does not start: {err.strerror}", mend)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["it does not start"])[-1]
        return Finding(f"{python}: {last}", mend)
    found = done.stdout.strip()
    if found != f"lidar-toolbox {__version__}":
        return Finding(f"{python} has {found}, this is {__version__}", mend)
    return Finding(f"Python {python} with {found}")


def _named(profile: Path) -> tuple[str, str]:
    """The Python that the user has chosen, and where."""
    if said := os.environ.get("LIDAR_TOOLBOX_PYTHON"):
        return said, "LIDAR_TOOLBOX_PYTHON"
    for ini in settings_files(profile):
        section = re.search(r"(?ms)^\[lidar_toolbox\]$(.*?)(?=^\[|\Z)", _settings(ini))
        line = section and re.search(r"(?m)^python=(.+)$", section[1])
        if line:
            return _unescaped(line[1].strip()), "Settings > Options > LiDAR Toolbox"
    return "", ""


def _unescaped(value: str) -> str:
    r"""Decode a text of the settings of QGIS.

    >>> _unescaped(r'"C:\\Pyth\xf6n, 3\\python.exe"')
    'C:\\Pythön, 3\\python.exe'
    """
    plain = re.sub(r"\\x([0-9a-fA-F]{1,4})", lambda found: chr(int(found[1], 16)), value.strip('"'))
    return plain.replace("\\\\", "\\")
