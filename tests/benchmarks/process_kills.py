"""Kill -9 of one of a flight's two processes; prints a table.

    python -m tests.benchmarks.process_kills [--kills 40] [--at-once 3] [--seed 1]

A small mission is flown over sockets, with both autopilots and both drivers. The mission's process
or the process of the aircraft is killed at a random moment in flight. If the mission dies, the
aircraft must be on the ground within 5 m of their pads when their process ends. A resumed mission
must then complete. If the process of the aircraft dies, the same mission must complete. The exit
status is 1 if one of these does not hold.
"""

from __future__ import annotations

import itertools
import math
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from tests.benchmarks.frame import options_of
from tests.e2e import rig
from uavmap.runner.aircraft_takeover import ADDRESS

SPEEDUP = 4.0
HOLD_S = 2.0
HOME_WALL_S = 90.0
NEAR_M = 5.0
LASTS_S = 75.0
"""Duration of the small mission in flight, s of mission time."""


def one(number: int, who: str, autopilot: str, driver: str, at_s: float, below: Path) -> str:
    """Fly and kill; return the fault, or an empty text."""
    folder = below / f"{who}-{autopilot}-{driver}-{number}"
    source = below / f"{folder.name}.toml"
    text = Path(rig.mission("speck")).read_text("utf-8")
    source.write_text(f"{text}\n[guardian]\norphan_hold_s = {HOLD_S}\n", "utf-8")
    with rig.simulator("speck", speedup=SPEEDUP, autopilot=autopilot) as urls:
        with rig.started(
            "fly", source, *rig.arguments_of(urls), "--speedup", SPEEDUP, "--auto-swap", "--json",
            "--driver", driver, "--out", folder,
        ) as process:  # fmt: skip
            while not rig.events(folder, "lifted_off"):
                if process.poll() is not None:
                    return f"ended before it lifted off: {process.communicate()[1][-300:]}"
                time.sleep(0.05)
            time.sleep(at_s / SPEEDUP)
            if process.poll() is not None:
                return "over"
            if who == "aircraft":
                os.kill(rig.aircraft_process(folder), signal.SIGKILL)
                done = rig.ended(process)
                good = done.code == 0 and done.summary["completed"]
                return "" if good else f"exit {done.code}: {done.err[-400:]}"
            process.send_signal(signal.SIGKILL)
            process.communicate()
        before = len(rig.events(folder))
        due_s = time.monotonic() + HOME_WALL_S
        while (folder / ADDRESS).exists():
            if time.monotonic() > due_s:
                return f"not at home {HOME_WALL_S:.0f} s later"
            time.sleep(0.2)
        done = rig.uavmap("resume", folder, "--json")
        landed = [event for event in rig.events(folder)[before:] if event["kind"] == "landed"]
        if not landed:
            return f"no landing: {done.err[-300:]}"
        away_m = math.hypot(*landed[0]["position"])
        if away_m > NEAR_M:
            return f"landed {away_m:.1f} m from its pad"
        return "" if done.code == 0 else f"resume: exit {done.code}: {done.err[-300:]}"


def main() -> int:
    options = options_of(__doc__, kills=40, at_once=3, seed=1)
    rng = np.random.default_rng(options.seed)
    kinds = itertools.cycle(itertools.product(("ardupilot", "px4"), ("pymavlink", "mavsdk")))
    count: Counter[tuple[str, str, str]] = Counter()
    faults = 0
    with tempfile.TemporaryDirectory() as below, ThreadPoolExecutor(options.at_once) as pool:
        waiting = {}
        for who in ("mission", "aircraft"):
            for number, (autopilot, driver) in zip(range(options.kills), kinds, strict=False):
                at_s = float(rng.uniform(0.0, LASTS_S))
                job = pool.submit(one, number, who, autopilot, driver, at_s, Path(below))
                waiting[job] = (who, autopilot, driver, at_s)
        for job, (who, autopilot, driver, at_s) in waiting.items():
            fault = job.result()
            count[who, "over" if fault == "over" else "wrong" if fault else "right", autopilot] += 1
            if fault not in ("", "over"):
                faults += 1
                print(f"{who} killed {at_s:.0f} s after lift-off, {autopilot}, {driver}: {fault}")
    for key, times in sorted(count.items()):
        print(*key, times)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
