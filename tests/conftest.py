"""Fixtures that every test may use."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# Compilation makes the first example slow; in CI a failure must be the fault of the change.
# On a desk each run draws other examples, so fewer do; CI takes hypothesis' hundred.
settings.register_profile("local", deadline=None, max_examples=25)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")

os.environ["TOOLBOX_HISTORY"] = ""  # runs of tests are none of the user

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("TOOLBOX_TEST_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def data() -> Callable[[str], Path]:
    """Give the path of a real data file; skip the test where it is absent."""

    def find(name: str) -> Path:
        path = DATA / name
        if not path.exists():
            pytest.skip(f"no {name} in TOOLBOX_TEST_DATA")
        return path

    return find


@pytest.fixture(autouse=True)
def _log_as_it_was() -> Iterator[None]:
    """A console takes the log over for its process; no test, or fixture of many, may find it so."""
    _reset_log()
    yield
    _reset_log()


def _reset_log() -> None:
    log = logging.getLogger("toolbox")
    log.handlers, log.propagate = [], True
    log.setLevel(logging.NOTSET)
