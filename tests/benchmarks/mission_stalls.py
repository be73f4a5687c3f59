"""A mission's process that stands still.

    python -m tests.benchmarks.mission_stalls [--mission speck] [--stall 3] [--every 10]
        [--autopilot ardupilot]

A mission is flown over sockets in real time, and its process is stopped for some seconds again and
again. It prints the gaps between setpoints on paths, and whether the mission is complete. The exit
status is 1 if a gap is longer than 0.25 s or the mission is not complete.
"""

from __future__ import annotations

import itertools
import json
import signal
import sys
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path

from pymavlink import mavutil

from tests.benchmarks.frame import options_of, spread
from tests.e2e.rig import ended, mission, simulator, started

MAX_GAP_S = 0.25
PATH_ENDS_S = 1.0
"""Length of a gap from which it lies between two paths, s; only stalls make gaps within a path."""


def gaps_of(log: Path, stalls: list[tuple[float, float]]) -> tuple[list[float], list[float]]:
    """Return the gaps between setpoints of a vehicle, s: all, and those in stalls (UTC s)."""
    times = defaultdict[int, list[float]](list)
    reader = mavutil.mavlink_connection(str(log), dialect="ardupilotmega")
    while (message := reader.recv_match(type="SET_POSITION_TARGET_GLOBAL_INT")) is not None:
        times[message.target_system].append(message._timestamp)
    gaps, met = [], []
    pairs = (pair for of_one in times.values() for pair in itertools.pairwise(of_one))
    for begin_s, end_s in pairs:
        stalled = any(begin_s < until_s and end_s > since_s for since_s, until_s in stalls)
        if stalled:
            met.append(end_s - begin_s)
        if stalled or end_s - begin_s < PATH_ENDS_S:
            gaps.append(end_s - begin_s)
    return gaps, met


def main() -> int:
    options = options_of(__doc__, mission="speck", stall=3.0, every=10.0, autopilot="ardupilot")
    stalls: list[tuple[float, float]] = []
    with (
        tempfile.TemporaryDirectory() as below,
        simulator(options.mission, speedup=1.0, autopilot=options.autopilot) as urls,
    ):
        folder = Path(below) / "out"
        with started(
            "fly", mission(options.mission), "--connect", urls[0], "--auto-swap",
            "--strategy", "swath", "--json", "--out", folder,
        ) as process:  # fmt: skip
            over = threading.Event()

            def stall() -> None:
                while not over.wait(options.every) and process.poll() is None:
                    since_s = time.time()
                    process.send_signal(signal.SIGSTOP)
                    time.sleep(options.stall)
                    process.send_signal(signal.SIGCONT)
                    stalls.append((since_s, time.time()))

            stalling = threading.Thread(target=stall)
            stalling.start()
            done = ended(process)
            over.set()
            stalling.join()
        gaps, met = gaps_of(folder / "flight.tlog", stalls)
        summary = json.loads((folder / "summary.json").read_text("utf-8"))
    print(
        f"{len(stalls)} stalls of {options.stall:g} s; {len(gaps)} gaps between setpoints, s: "
        f"{spread(gaps)}; in stalls most {max(met, default=0.0):.3f} s; completed "
        f"{summary['completed']}, {summary['makespan_s']} s, exit {done.code}"
    )
    return 0 if max(gaps) <= MAX_GAP_S and summary["completed"] else 1


if __name__ == "__main__":
    sys.exit(main())
