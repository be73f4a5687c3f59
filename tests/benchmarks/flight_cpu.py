"""Processor time of a simulated flight by its parts; prints a table.

    python -m tests.benchmarks.flight_cpu                    runway, about 20 s
    python -m tests.benchmarks.flight_cpu --mission burn

The flight's side of a frame is the work of its process beside the simulator. It decodes and judges
the picture, decides, keeps the journal, exchanges messages, and adds to the mosaic in a thread. A
flight before it compiles the kernels and warms up. The command has the costs of its imports and of
ortho.tif in addition: `time uavmap fly runway --sim` has its user and system time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest import mock

from sitl.mavlink import camera_component
from sitl.vehicle import SimVehicle
from tests.benchmarks.frame import flight_of, head, options_of, row, summary_of
from uavmap.runner import one_flight

PARTS = {
    "whole flight": (one_flight.Flight, "run", time.process_time),
    "in flight": (one_flight.Flight, "_flown", time.process_time),
    "rendering": (camera_component, "render", time.thread_time),
    "simulated vehicles": (SimVehicle, "step", time.thread_time),
    "results": (one_flight, "written_results", time.process_time),
}
"""Names of functions, and the clocks that count them: of all threads, or of the calling one."""


@contextmanager
def timed(spent: dict[str, float], part: str) -> Iterator[None]:
    """Add the processor time of a part to `spent` while the context lasts, s."""
    owner, name, clock = PARTS[part]
    work: Callable[..., Any] = getattr(owner, name)

    def counted(*given: Any, **named: Any) -> Any:
        begin_s = clock()
        try:
            return work(*given, **named)
        finally:
            spent[part] = spent.get(part, 0.0) + clock() - begin_s

    with mock.patch.object(owner, name, counted):
        yield


def main() -> None:
    options = options_of(__doc__, mission="runway")
    summary_of(options.mission)
    spent: dict[str, float] = {}
    with ExitStack() as parts:
        for part in PARTS:
            parts.enter_context(timed(spent, part))
        with flight_of(options.mission) as (summary, _):
            frames = summary["frames_judged"]
    simulator_s = spent["rendering"] + spent["simulated vehicles"]
    spent["the flight's side"] = spent["in flight"] - simulator_s
    print(head("part", "CPU, s", f"ms for each of {frames} frames"))
    for part, cpu_s in spent.items():
        print(row(part, f"{cpu_s:.2f}", f"{1e3 * cpu_s / frames:.1f}"))


if __name__ == "__main__":
    main()
