"""The installed QGIS, as the tests start it."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

from toolbox.qgis import process as qgis_process


@dataclass(frozen=True)
class Qgis:
    """The installed QGIS.

    Attributes
    ----------
    program : qgis_process
    home : its settings; the plugin is in the profile "default" below
    """

    program: str
    home: Path

    @property
    def env(self) -> dict[str, str]:
        env = qgis_process.environment(self.program)
        env |= {"QGIS_CUSTOM_CONFIG_PATH": str(self.home), "HOME": str(self.home)}
        env |= {"XDG_RUNTIME_DIR": str(self.home), "TOOLBOX_HISTORY": "", "LANG": "C.UTF-8"}
        return env

    def start(self, *words: str | Path, **env: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [self.program, *map(str, words)],
            env=self.env | env,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
        )

    def __call__(self, *words: str | Path, **env: str) -> subprocess.CompletedProcess[str]:
        process = self.start(*words, **env)
        out, err = process.communicate(timeout=300)
        return subprocess.CompletedProcess(words, process.returncode, out, err)

    def python(self, *words: str | Path) -> subprocess.CompletedProcess[str]:
        """Run a script in the Python that has `qgis`."""
        return subprocess.run(
            ["/usr/bin/python3", *map(str, words)],
            env=self.env,
            capture_output=True,
            encoding="utf-8",
            check=False,
            timeout=600,
        )
