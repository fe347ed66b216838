"""Entry point of ``python -m toolbox``."""

from __future__ import annotations

import os
import signal
import sys

# A GIS that starts us may point these at its own libraries; our wheels carry their own data.
for _name in ("PROJ_LIB", "PROJ_DATA", "GDAL_DATA", "GDAL_DRIVER_PATH"):
    os.environ.pop(_name, None)


def run() -> None:
    """Run the command line and end the process with its exit code."""
    try:
        from toolbox.cli.main import main

        code = main()
    except KeyboardInterrupt:  # before or after the code that stops in good order
        code = 130
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done: too late to stop anything
    sys.exit(code)


if __name__ == "__main__":
    run()
