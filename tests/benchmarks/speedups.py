"""Missions over sockets at several speed-ups: `python -m tests.benchmarks.speedups`.

    [--missions runway spill] [--speedups 1 3 10 20] [--autopilots ardupilot px4]
    [--drivers pymavlink mavsdk] [--seed 1]

`uavmap sitl` in one process, `uavmap fly --connect` in another. A line is printed for each flight;
the exit status is 1 when one was not complete.
"""

from __future__ import annotations

import itertools
import json
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.benchmarks.frame import asked
from tests.e2e.rig import arguments_of, simulator, started

MOST_S = 3000.0
"""Of the vehicles' time: a flight that takes longer is ended."""
SLACK_S = 120.0


@dataclass(frozen=True, slots=True)
class Landed:
    code: int
    summary: dict[str, Any]
    said: str
    wall_s: float

    @property
    def line(self) -> str:
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
        with simulator(
            mission, speedup=speedup, vehicles=vehicles, autopilot=autopilot, seed=seed
        ) as urls:
            begin_s = time.monotonic()
            arguments = ["fly", mission, *arguments_of(urls), "--vehicles", vehicles]
            arguments += ["--speedup", speedup, "--auto-swap", "--json", "--out", Path(below) / "o"]
            arguments += ["--driver", driver, "--yes"]
            with started(*arguments) as process:
                out, said = process.communicate(timeout=SLACK_S + MOST_S / speedup)
        wall_s = time.monotonic() - begin_s
    return Landed(process.returncode, json.loads(out) if out else {}, said, wall_s)


def main() -> int:
    options = asked(
        __doc__, missions=("runway", "spill"), speedups=(1.0, 3.0, 10.0, 20.0),
        autopilots=("ardupilot", "px4"), drivers=("pymavlink", "mavsdk"), vehicles=1, seed=1,
    )  # fmt: skip
    codes = []
    for mission, autopilot, driver, speedup in itertools.product(
        options.missions, options.autopilots, options.drivers, options.speedups
    ):
        flight = flown(
            mission, speedup, autopilot, driver, vehicles=options.vehicles, seed=options.seed
        )
        codes.append(flight.code)
        print(f"{mission} {autopilot} {driver} {speedup:g}x: {flight.line}", flush=True)
    return int(any(codes))


if __name__ == "__main__":
    sys.exit(main())
