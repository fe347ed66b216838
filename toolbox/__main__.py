"""Entry point of ``python -m toolbox``."""

from __future__ import annotations

import gc
import os
import signal
import sys

from toolbox.allocation import keep_memory
from toolbox.places import hidden

# A GIS that starts us may point these at its own libraries; our wheels carry their own data.
for _name in ("PROJ_LIB", "PROJ_DATA", "GDAL_DATA", "GDAL_DRIVER_PATH"):
    os.environ.pop(_name, None)

# Threads of linear algebra wait for work by computing. Ours are small systems of equations, and
# sums do not depend on the number of processors then. To be said before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


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
    gc.freeze()  # or Python looks through all objects before it ends: 0.3 s of a short command
    sys.exit(code)


def _open_streams() -> None:
    """Open what was closed as nothing, or the next file would be what libraries print to."""
    while (stream := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(stream)


if __name__ == "__main__":
    run()
