"""Entry point of ``python -m toolbox``."""

from __future__ import annotations

import os
import signal
import sys
from importlib.util import find_spec
from pathlib import Path

from toolbox.allocation import keep_memory

# A GIS that starts us may point these at its own libraries; our wheels carry their own data.
for _name in ("PROJ_LIB", "PROJ_DATA", "GDAL_DATA", "GDAL_DRIVER_PATH"):
    os.environ.pop(_name, None)


def run() -> None:
    """Run the command line and end the process with its exit code."""
    _open_streams()
    keep_memory()
    if problem := hidden():
        print(f"error: {problem}", file=sys.stderr)
        sys.exit(2)
    try:
        from toolbox.cli.main import main

        code = main()
    except KeyboardInterrupt:  # before or after the code that stops in good order
        code = 130
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done: too late to stop anything
    sys.exit(code)


def hidden() -> str:
    """Why our tools cannot be imported: another package has their name; empty if none has.

    Python looks into the working folder first, when it is started with ``-m``.
    """
    ours = Path(__file__).resolve().parents[1] / "algorithms"
    spec = find_spec("algorithms")
    found = Path((spec and spec.origin) or ours / "__init__.py").resolve().parent
    if found == ours:
        return ""
    return (
        f"{found} hides the package 'algorithms' of lidar-toolbox; "
        "rename it, or run lidar-toolbox, or python -m toolbox, in another folder"
    )


def _open_streams() -> None:
    """Open what was closed as nothing, or the next file would be what libraries print to."""
    while (stream := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(stream)


if __name__ == "__main__":
    run()
