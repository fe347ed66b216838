"""Fixtures that every test may use, and which tests are slow."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# Compilation makes the first example slow; in CI a failure must be the fault of the change.
# On a desk each run draws other examples, so fewer do; CI takes hypothesis' hundred.
settings.register_profile("local", deadline=None, max_examples=25)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")

# A job in the background of a shell ignores Ctrl-C, and so would the programs that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

_BEFORE = pytest.StashKey[float]()

os.environ["TOOLBOX_HISTORY"] = ""  # runs of tests are none of the user

ROOT = Path(__file__).resolve().parents[1]
SLOW = Path(__file__).with_name("slow.txt")  # tests that were measured to be slow, a line each
LONGEST = 0.1  # seconds of processor time of a test that is not slow
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


def pytest_addoption(parser: pytest.Parser) -> None:
    text = f"measure which tests are slow, and rewrite {SLOW.name}; once before, all is compiled"
    parser.addoption("--find-slow", action="store_true", help=text)


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--find-slow") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(FindSlow())


@pytest.hookimpl(tryfirst=True)  # before those that are not wanted are left out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    slow = set(SLOW.read_text(encoding="utf-8").splitlines())
    for item in items:
        if item.nodeid in slow:
            item.add_marker(pytest.mark.slow)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    item.stash[_BEFORE] = _seconds()
    yield


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item) -> Iterator[None]:
    yield
    item.user_properties.append(("seconds", _seconds() - item.stash[_BEFORE]))


def _seconds() -> float:
    """Processor time of this process, and of those that it has waited for."""
    return sum(os.times()[:4])


class FindSlow:
    """Collects the tests that take long, from all processes that run some."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        took = dict(report.user_properties).get("seconds")
        if isinstance(took, float) and took > LONGEST:
            self.found.append(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        SLOW.write_text("".join(f"{name}\n" for name in sorted(self.found)), encoding="utf-8")
