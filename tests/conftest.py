"""Rules for every test: an error log of asyncio fails it; property tests draw the same examples.

Two marks are set here, and nowhere else. `slow` marks the tests that `slow.txt` lists. `system`
marks files that need a simulator, a socket, another process or a whole command.

Files whose tests wait for sockets and processes are spread evenly among those that compute. Thus
several workers keep all cores busy.

A test that draws other examples at every run may fail for a reason that is not in the change.
`HYPOTHESIS_PROFILE=random` draws new examples, in a search for unforeseen cases. A case that it
finds becomes an `@example`.
"""

from __future__ import annotations

import functools
import gc
import logging
import os
import re
import signal
from collections.abc import Generator, Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import pytest
from _pytest.doctest import DoctestModule
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

import missions.lab.strategies  # noqa: F401 - the strategies of papers register themselves
from tests.support.shown_lines import ShownLines
from uavmap.base.messages import shown_on

# objects of imports are no garbage: see `pytest_collection_finish`
gc.disable()
# the present speed of the machine is no property of the program
_PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("repeatable", _PATIENT, derandomize=True)
settings.register_profile("random", _PATIENT, derandomize=False)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))


# Hypothesis would draw constants from all loaded files. Then an edit of any file, or a run of one
# test alone, would change the examples of the others.
providers._get_local_constants = lambda: providers._local_constants

# a background job of a shell ignores Ctrl-C, and so do its children
signal.signal(signal.SIGINT, signal.default_int_handler)


class _Complaints(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(record.getMessage())


@pytest.fixture(autouse=True)
def no_complaints_of_asyncio() -> Iterator[None]:
    complaints = _Complaints()
    logger = logging.getLogger("asyncio")
    logger.addHandler(complaints)
    yield
    logger.removeHandler(complaints)
    assert not complaints.texts


SLOW = [
    line
    for line in Path(__file__).with_name("slow.txt").read_text("utf-8").splitlines()
    if not line.startswith("#")
]
SYSTEM = re.compile(
    r"^(?:from|import) (?:sitl|socket|subprocess|multiprocessing"
    r"|uavmap\.(?:runner\.simulation|ui\.cli|lab\.commands|__main__)"
    r"|tests\.(?:conformance|e2e|fake_fleet|support\.(?:fleet_rig|flights|mavlink_peer|scenarios)))\b",
    re.MULTILINE,
)
"""Imports of a file of system tests."""


@pytest.fixture
def log_lines() -> Iterator[ShownLines]:
    """Collect the lines for the operator, of the test's own context."""
    lines = ShownLines()
    with shown_on(lines):
        yield lines


WAITING = ("e2e", "conformance")
"""Folders of tests that wait most of their time."""


@functools.cache
def _needs_system(path: Path) -> bool:
    return "sitl" in path.parts or SYSTEM.search(path.read_text("utf-8")) is not None


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Import no file without a test of the requested marks: that takes seconds."""
    asked, name = config.option.markexpr, collection_path.name
    if collection_path.suffix != ".py" or name == "__init__.py":
        return None
    if asked == "slow":
        return name not in {Path(line.partition("::")[0]).name for line in SLOW} or None
    return ("not system" in asked and _needs_system(collection_path)) or None


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(file_path: Path) -> Generator[None, list[Any], list[Any]]:
    """Import and search no file without doctests; benchmarks have to import."""
    found = yield
    if "benchmarks" in file_path.parts or ">>> " in file_path.read_text("utf-8", "ignore"):
        return found
    return [each for each in found if not isinstance(each, DoctestModule)]


def _is_quick(file: tuple[Path, list[pytest.Item]]) -> bool:
    return not any(test.get_closest_marker("slow") for test in file[1])


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests; spread the files that wait, those that compute, and doctests evenly.

    In each kind the files with slow tests come first: none of them is the last to end.
    """
    kinds: dict[str, dict[Path, list[pytest.Item]]] = {}
    for item in items:
        # a line without parameters means all of them
        names = {item.name, item.name.partition("[")[0]}
        lines = [line for line in SLOW if item.path.name in line]
        if any(fnmatchcase(f"{item.path}::{n}", f"*/{line}") for n in names for line in lines):
            item.add_marker("slow")
        if _needs_system(item.path):
            item.add_marker("system")
        kind = "computing" if item.path.name.startswith("test_") else "doctests"
        kind = "waiting" if {*WAITING} & {*item.path.parts} else kind
        kinds.setdefault(kind, {}).setdefault(item.path, []).append(item)
    places = [
        ((i + 0.5) / len(files), path, tests)
        for files in kinds.values()
        for i, (path, tests) in enumerate(sorted(files.items(), key=_is_quick))
    ]
    items[:] = [item for *_, tests in sorted(places, key=lambda p: p[:2]) for item in tests]


def pytest_collection_finish() -> None:
    """Leave the collected tests out of every later collection of garbage."""
    gc.collect()
    gc.freeze()
    gc.enable()
