"""Finds and calls the program `qgis_process`."""

from __future__ import annotations

import glob
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from toolbox.errors import DataError

# On Debian 12 the wrapper without .bin passes an option that the program does not know.
NAMES = ("qgis_process.bin", "qgis_process", "qgis_process-qgis", "qgis_process-qgis-ltr")
FOLDERS = {  # of installations that set no search path; the newest first
    "darwin": ["/Applications/QGIS*.app/Contents/MacOS/bin"],
    "win32": [r"C:\Program Files\QGIS *\bin", r"C:\OSGeo4W\bin"],
}
VARIABLE = "QGIS_PROCESS"
NO_WINDOW = 0x08000000 if sys.platform == "win32" else 0  # of a console
# Variables that an environment such as conda sets for its own libraries, not those of QGIS.
FOREIGN = (
    "PYTHON",
    "VIRTUAL_ENV",
    "CONDA_PREFIX",
    "PROJ_LIB",
    "PROJ_DATA",
    "GDAL_DATA",
    "GDAL_DRIVER_PATH",
    "LD_LIBRARY_PATH",
    "DYLD_",
)
ABSENT = (
    "QGIS was not found: there is no qgis_process on the search path. Install QGIS, or let "
    f"{VARIABLE} name the program."
)


def find() -> str | None:
    """The path of the program; None if it is not installed."""
    if said := os.environ.get(VARIABLE):
        return said if Path(said).is_file() else None
    folders = [os.environ.get("PATH", os.defpath)]
    for pattern in FOLDERS.get(sys.platform, ()):
        folders += sorted(glob.glob(pattern), reverse=True)
    found = (shutil.which(name, path=os.pathsep.join(folders)) for name in NAMES)
    return next(filter(None, found), None)


def version() -> str:
    """The version of QGIS, such as 3.22.16.

    Raises
    ------
    DataError
        The program is not installed or does not start.
    """
    said = call(["--version"])
    found = re.search(r"QGIS (\d+\.\d+\.\d+)", said)
    return found[1] if found else said.strip()


def call(words: Sequence[str], *, env: Mapping[str, str] | None = None) -> str:
    """Call the program and give what it prints.

    Raises
    ------
    DataError
        The program is not installed, or failed; with its message.
    """
    program = find()
    if program is None:
        raise DataError(ABSENT)
    done = subprocess.run(
        [program, *words],
        env=environment(program) if env is None else dict(env),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
        creationflags=NO_WINDOW,
    )
    if done.returncode:
        raise DataError(f"qgis_process {' '.join(words[:2])}: {reason(done.stderr)}")
    return done.stdout


def ask(words: Sequence[str]) -> Any:
    """Call the program and give the JSON that it prints.

    Raises
    ------
    DataError
        As of :func:`call`.
    """
    said = call(words)
    return json.loads(said[said.index("{") :])


def environment(program: str) -> dict[str, str]:
    """Our environment variables without those that would lead QGIS and its Python to our libraries.

    No window is opened. The Python of QGIS uses the libraries beside the first `python3` on the
    search path.
    """
    env = {name: value for name, value in os.environ.items() if not name.startswith(FOREIGN)}
    env["PATH"] = os.pathsep.join([str(Path(program).parent), env.get("PATH", os.defpath)])
    env["QT_QPA_PLATFORM"] = "offscreen"
    return env


def reason(stderr: str) -> str:
    """The error message, without the warnings that libraries print."""
    noise = re.compile(r"Warning|QStandardPaths|setapi|^\s*(import|from) |^-+$|^\s*$|^ERROR:?$")
    lines = [line.strip() for line in stderr.splitlines() if not noise.search(line)]
    return "\n".join(line.removeprefix("ERROR:").strip() for line in lines[-12:]) or "failed"
