"""Shared parts of benchmarks: options, simulated flights, workers, rows of tables, statistics."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from missions.events import Event
from missions.flight.state import Setting
from sitl.vehicle import SimVehicle
from tests.support.plans import named_text, plan_of
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.runner.flight import fly
from uavmap.runner.simulation import Truth

Job = TypeVar("Job")
Found = TypeVar("Found")


def options_of(doc: str | None, **defaults: Any) -> argparse.Namespace:
    """Parse the options of a benchmark, each from its name and default.

    False is a flag, a tuple takes several values of its first one's type, and a type is an option
    without a default.
    """
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, default in defaults.items():
        how: dict[str, Any] = {"type": type(default), "default": default}
        if default is False:
            how = {"action": "store_true"}
        elif isinstance(default, type):
            how = {"type": default}
        elif isinstance(default, tuple):
            how |= {"type": type(default[0]), "nargs": "+"}
        parser.add_argument(f"--{name.replace('_', '-')}", **how)
    return parser.parse_args()


def in_turn(
    work: Callable[[Job], Found], jobs: Sequence[Job], workers: int
) -> Iterator[tuple[Job, Found]]:
    """Yield each job with its result, computed by processes, in the order of the jobs."""
    with ProcessPoolExecutor(workers) as pool:
        yield from zip(jobs, pool.map(work, jobs), strict=True)


# --- simulated flights ---------------------------------------------------------------------------
@contextmanager
def flight_of(
    name: str,
    text: str | None = None,
    fly: Callable[[FlightPlan, Path], dict[str, Any]] = fly,
    **how: Any,
) -> Iterator[tuple[dict[str, Any], Path]]:
    """Fly a mission in the simulator; yield its summary, and its folder while the context lasts.

    `text` is the mission file, by default that of the name; `how` as for `plan_of`.
    """
    plan = plan_of(name, named_text(name).text if text is None else text, **how)
    with tempfile.TemporaryDirectory() as folder:
        yield fly(plan, Path(folder)), Path(folder)


def summary_of(name: str, text: str | None = None, **how: Any) -> dict[str, Any]:
    with flight_of(name, text, **how) as (summary, _):
        return summary


def events_of(folder: Path) -> list[Event]:
    with Journal.open(folder / JOURNAL) as journal:
        return list(journal.events())


@contextmanager
def truth_shown(look: Callable[[Sequence[SimVehicle], Setting], None]) -> Iterator[None]:
    """Show a function the vehicles of every simulation, ten times a second, in the context."""
    watch = Truth.watch

    def watching(self: Truth, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        look(vehicles, setting)
        watch(self, vehicles, setting)

    with mock.patch.object(Truth, "watch", watching):
        yield


# --- tables and statistics -----------------------------------------------------------------------
def row(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def head(*names: str) -> str:
    return f"{row(*names)}\n|{'---|' * len(names)}"


def spread(values: Sequence[float] | NDArray[np.float64]) -> str:
    """Return the median, 95 % and the largest of some values.

    >>> spread([1.0, 2.0, 3.0])
    'p50 2.00 p95 2.90 max 3.00'
    """
    if not len(values):
        return "none"
    p50, p95, most = np.percentile(values, [50, 95, 100])
    return f"p50 {p50:.2f} p95 {p95:.2f} max {most:.2f}"


def cpu_ms(work: Callable[[], object], times: int = 1) -> float:
    """Return the CPU time of a call, ms; the least of several."""
    found = []
    for _ in range(times):
        begin_s = time.process_time()
        work()
        found.append(1e3 * (time.process_time() - begin_s))
    return min(found)
