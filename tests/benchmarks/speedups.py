"""Missions over sockets at several speed-ups: `python -m tests.benchmarks.speedups`.

    [--missions runway spill] [--speedups 1 3 10 20] [--autopilots ardupilot px4]
    [--drivers pymavlink mavsdk] [--seed 1]

`uavmap sitl` in one process, `uavmap fly --connect` in another. A line is printed for each flight;
the exit status is 1 when one was not complete.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import queue
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.e2e.rig import PATIENCE_S, arguments_of, free_ports, started

MOST_S = 3000.0
"""Of the vehicles' time: a flight that takes longer is ended."""
SLACK_S = 120.0


@dataclass(frozen=True, slots=True)
class Landed:
    """A flight that is over."""

    code: int
    summary: dict[str, Any]
    said: str
    wall_s: float

    @property
    def line(self) -> str:
        """What came of it."""
        found = self.summary
        failed = [text for text in self.said.splitlines() if "failed" in text]
        return (
            f"exit {self.code}, {found.get('flight_time_s')} s of flight, "
            f"{found.get('sorties')} sorties, {found.get('cells_roi')} cells, "
            f"{self.wall_s:.0f} s on the clock {' | '.join(failed[-2:])}"
        )


def flown(
    mission: str,
    speedup: float,
    autopilot: str,
    driver: str = "pymavlink",
    *,
    vehicles: int = 1,
    seed: int = 1,
) -> Landed:
    """Fly a mission (a name, or the path of a file) over sockets to its end."""
    with tempfile.TemporaryDirectory() as below:
        with _simulator(mission, speedup, autopilot, vehicles, seed) as urls:
            begin_s = time.monotonic()
            arguments = ["fly", mission, *arguments_of(urls), "--vehicles", vehicles]
            arguments += ["--speedup", speedup, "--auto-swap", "--json", "--out", Path(below) / "o"]
            arguments += ["--driver", driver, "--yes"]
            with started(*arguments) as process:
                out, said = process.communicate(timeout=SLACK_S + MOST_S / speedup)
        wall_s = time.monotonic() - begin_s
    return Landed(process.returncode, json.loads(out) if out else {}, said, wall_s)


@contextlib.contextmanager
def _simulator(
    mission: str, speedup: float, autopilot: str, vehicles: int, seed: int
) -> Iterator[list[str]]:
    port, http_port = free_ports(vehicles)
    arguments = ["sitl", "--mission", mission, "--speedup", speedup, "--vehicles", vehicles]
    arguments += ["--autopilot", autopilot, "--seed", seed]
    with started(*arguments, "--port", port, "--http-port", http_port) as process:
        lines: queue.Queue[str] = queue.Queue()
        stdout = process.stdout
        assert stdout is not None
        reader = threading.Thread(target=lambda: [lines.put(line) for line in stdout])
        reader.start()
        try:
            yield [lines.get(timeout=PATIENCE_S).strip() for _ in range(vehicles)]
        finally:
            process.kill()
            reader.join()


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(description="Missions over sockets at several speed-ups.")
    parser.add_argument("--missions", nargs="+", default=["runway", "spill"])
    parser.add_argument("--speedups", nargs="+", type=float, default=[1.0, 3.0, 10.0, 20.0])
    parser.add_argument("--autopilots", nargs="+", default=["ardupilot", "px4"])
    parser.add_argument("--drivers", nargs="+", default=["pymavlink", "mavsdk"])
    parser.add_argument("--vehicles", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    codes = []
    cases = itertools.product(
        options.missions, options.autopilots, options.drivers, options.speedups
    )
    for mission, autopilot, driver, speedup in cases:
        flight = flown(
            mission, speedup, autopilot, driver, vehicles=options.vehicles, seed=options.seed
        )
        codes.append(flight.code)
        print(f"{mission} {autopilot} {driver} {speedup:g}x: {flight.line}", flush=True)
    return int(any(codes))


if __name__ == "__main__":
    sys.exit(main())
