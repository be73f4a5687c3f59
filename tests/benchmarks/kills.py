"""Kill -9 at random moments, and disks that fail; prints a table.

    python -m tests.benchmarks.kills [--kills 200] [--twice 40] [--full 30] [--calls 60] [--seed 1]

A small mission is flown in the simulator and killed at a random moment in flight: between its first
and its last event. A kill that comes later does not count: the folder is checked, and the mission
is flown again. In `twice` its resumption is killed as well. In `full` no file may grow beyond a
random size, in the flight and in a first resumption. In `calls` one call to the disk fails, each
time another one: by an I/O error, a full disk, or after half of its bytes. For the
telemetry log it is each fiftieth call. Then it is resumed without faults.

The exit status is 1 if an event that was on the disk is missing, or if a folder cannot be resumed.
It is also 1 if the map or the journal differs from those of an uninterrupted flight, or if a
traceback is shown.

Children are forked, so that a flight takes a second and not the time of all imports.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from multiprocessing import get_context
from multiprocessing.context import ForkProcess
from pathlib import Path
from typing import Final

import numpy as np

from missions.errors import JournalError
from tests.benchmarks.frame import options_of
from tests.e2e.rig import bodies, mission, written
from tests.failing_disk import How, failing_disk
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import TLOG
from uavmap.ui.cli import main as uavmap

SAME = ("map.geojson", "map.kml", "map.png")
POLL_S = 0.002
ERRORS: Final[tuple[How, ...]] = ("EIO", "ENOSPC", "short")


def started(
    arguments: list[str],
    said: Path,
    room: int | None = None,
    disk: Callable[[], AbstractContextManager[object]] = nullcontext,
) -> ForkProcess:
    """Start a process that runs the command on a disk; its output goes into a file."""

    def run() -> None:
        out = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        os.dup2(out, 1)
        os.dup2(out, 2)
        sys.stdout, sys.stderr = open(1, "w"), open(2, "w")  # noqa: SIM115 - as long as the process
        if room is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
        with disk():
            code = uavmap(arguments)
        sys.exit(code)

    child = get_context("fork").Process(target=run)
    child.start()
    return child


def ended(child: ForkProcess) -> int | None:
    """Return the exit status of a process, negative for a signal."""
    child.join()
    return child.exitcode


def killed_after(child: ForkProcess, delay_s: float, folder: Path) -> tuple[bool, int]:
    """Kill a process a time after the first event; return if it still ran, and the confirmed
    events.
    """
    due_s = float("inf")
    while time.monotonic() < due_s:
        if not child.is_alive():
            return False, len(bodies(folder))
        if due_s == float("inf") and written(folder):
            due_s = time.monotonic() + delay_s
        time.sleep(POLL_S)
    confirmed = len(bodies(folder))
    child.kill()
    return ended(child) == -signal.SIGKILL, confirmed


class Trials:
    """Runs of all kinds against one uninterrupted flight."""

    def __init__(self, name: str, below: Path, seed: int) -> None:
        self._fly = ["fly", mission(name), "--sim", "--json", "--out"]
        self._below = below
        self._rng = np.random.default_rng(seed)
        folder = below / "whole"
        child = started([*self._fly, str(folder)], below / "whole.txt")
        while not written(folder):
            time.sleep(POLL_S)
        begun_s = time.monotonic()
        assert ended(child) == 0
        self._lasts_s = time.monotonic() - begun_s
        self._whole = folder  # the uninterrupted flight
        self._bodies = bodies(folder)
        self.calls = self._chosen()

    def _chosen(self) -> list[int]:
        """Fly once more; return the numbers of the calls to the disk that will fail."""
        folder, names = self._below / "counted", self._below / "counted.calls"

        @contextmanager
        def disk() -> Iterator[None]:
            with failing_disk(folder) as found:
                yield
            names.write_text("\n".join(found.calls))

        child = started([*self._fly, str(folder)], self._below / "counted.txt", disk=disk)
        assert ended(child) == 0
        calls = list(enumerate(names.read_text().splitlines(), 1))
        log = [number for number, name in calls if name.endswith(TLOG)]
        return sorted({number for number, _ in calls} - set(log) | set(log[::50]))

    def run(self, kind: str, number: int, tally: Counter[str]) -> str | None:
        """Do one run to its end; return its fault, or None."""
        folder = self._below / f"{kind}-{number}"
        said = folder.with_suffix(".txt")
        try:
            match kind:
                case "full":
                    self._full(folder, said, tally)
                case "calls":
                    self._fail(folder, said, tally, number)
                case _:
                    self._kill(folder, said, tally, kind == "twice")
            self._judge(folder, said)
        except AssertionError as error:
            return f"{folder.name}: {error}"
        tally["as if nothing had been"] += 1
        shutil.rmtree(folder)
        said.unlink()
        return None

    def _kill(self, folder: Path, said: Path, tally: Counter[str], twice: bool) -> None:
        confirmed = kills = 0
        while kills < (2 if twice else 1):
            child = started(self._again(folder), said)
            delay_s = float(self._rng.uniform(0.0, self._lasts_s))
            died, seen = killed_after(child, delay_s, folder)
            confirmed = max(confirmed, seen)
            self._check(folder, confirmed)
            if died and 0 < confirmed < len(self._bodies):
                kills += 1
                continue
            tally["after the end"] += 1
            self._lasts_s *= 0.9  # the machine is faster than before
            shutil.rmtree(folder)
            confirmed = kills = 0
        tally["killed in flight"] += kills

    def _fail(self, folder: Path, said: Path, tally: Counter[str], number: int) -> None:
        """Fly while one call fails: numbers go through all calls, and then through all ways."""
        way, k = divmod(number, len(self.calls))
        how, fails_at = ERRORS[way % len(ERRORS)], self.calls[k]
        code = ended(
            started(self._again(folder), said, disk=lambda: failing_disk(folder, fails_at, how))
        )
        assert code in (0, 2), f"call {fails_at} ({how}): exit status {code}"
        tally["disk failed" if code else "had no need of it"] += 1
        self._check(folder, len(self._bodies) if code == 0 else 0)

    def _full(self, folder: Path, said: Path, tally: Counter[str]) -> None:
        largest = max(path.stat().st_size for path in self._whole.iterdir())
        room = int(np.exp(self._rng.uniform(np.log(1000), np.log(1.2 * largest))))
        confirmed = 0
        for _ in range(2):
            code = ended(started(self._again(folder), said, room))
            assert code in (0, 2), f"{room} bytes: exit status {code}"
            tally["disk full" if code else "had room"] += 1
            confirmed = max(confirmed, len(bodies(folder)))
            self._check(folder, confirmed)

    def _again(self, folder: Path) -> list[str]:
        """Return the command that the last run named for the resumption."""
        if (folder / "journal.jsonl").exists():
            return ["resume", str(folder), "--json"]
        return [*self._fly, str(folder)]

    def _check(self, folder: Path, confirmed: int) -> None:
        """Check that confirmed events are there, and that a copy of the folder can be opened."""
        path = folder / "journal.jsonl"
        if not path.exists():
            assert confirmed == 0, f"{confirmed} events were there, and no journal is"
            return
        copy = folder.with_name(f"{folder.name}-copy")
        shutil.copytree(folder, copy)
        try:
            with Journal.open(copy / path.name) as journal:
                found = journal.bodies()
        except JournalError as error:
            raise AssertionError(f"cannot be gone on with: {error}") from None
        finally:
            shutil.rmtree(copy)
        assert found == self._bodies[: len(found)], "other events than without a kill"
        assert len(found) >= confirmed, f"{confirmed} events were there, {len(found)} are"

    def _judge(self, folder: Path, said: Path) -> None:
        """Continue to the end, and compare the outcome with the uninterrupted flight."""
        code = ended(started(self._again(folder), said))
        text = said.read_text("utf-8", errors="replace")
        assert "Traceback" not in text, f"a traceback: see {said}"
        assert code == 0, f"exit status {code}: see {said}"
        found = bodies(folder)
        # a mission that is completed is not flown on for its last reports
        known = len(found) if "completed already" in text else len(self._bodies)
        assert found == self._bodies[:known], "another journal than without a kill"
        for name in SAME:
            same = (folder / name).read_bytes() == (self._whole / name).read_bytes()
            assert same, f"another {name} than without a kill"


def main() -> int:
    """Run and print; return the exit status. The mission is one of tests/data."""
    options = options_of(__doc__, kills=200, twice=40, full=30, calls=60, seed=1, mission="speck")
    faults: list[str] = []
    below = Path(tempfile.mkdtemp(prefix="uavmap-kills-"))
    trials = Trials(options.mission, below, options.seed)
    for kind in ("kills", "twice", "full", "calls"):
        tally, runs = Counter[str](), getattr(options, kind)
        stride = max(1, len(trials.calls) * len(ERRORS) // max(1, runs)) if kind == "calls" else 1
        numbers = range(0, runs * stride, stride)
        found = [fault for k in numbers if (fault := trials.run(kind, k, tally))]
        counts = ", ".join(f"{name} {n}" for name, n in sorted(tally.items()))
        print(f"{kind:6} {runs:4d} runs: {counts}; faults {len(found)}", flush=True)
        faults += found
    for fault in faults:
        print(f"  {fault}")
    if faults:
        print(f"what is left of them: {below}")
    else:
        shutil.rmtree(below)
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
