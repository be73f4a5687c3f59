"""Kill -9 at random moments: `python -m tests.benchmarks.kills [--kills 200] [--twice 40]
[--full 30] [--seed 1]` prints a table.

A small mission is flown in the simulator and killed at a random moment in flight: after its first
event is on the disk and before its last one. A kill that comes later has not landed; what it left
is checked, and the mission is flown anew. In `twice` its resumption is killed as well; in
`full` no file may grow beyond a random size, in the flight and in a first resumption. Then it is
resumed with all it needs. The exit status is 1 when an event that was on the disk is missing, a
folder cannot be gone on with, the map or the journal comes out otherwise than those of an
uninterrupted flight, or anybody is shown a traceback.

Children are forked, so that a flight takes a second and not the time of all imports.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from missions.errors import JournalError
from tests.e2e.rig import bodies, mission, written
from uavmap.journal.event_log import Journal
from uavmap.ui.cli import main as uavmap

SAME = ("map.geojson", "map.kml", "map.png")
POLL_S = 0.002


@dataclass(slots=True)
class Tally:
    """What happened in the runs of a kind."""

    runs: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Whole:
    """The flight that nobody interrupted."""

    folder: Path
    bodies: list[str]


def started(arguments: list[str], said: Path, room: int | None = None) -> int:
    """A process that runs the command; what it says goes into a file."""
    if child := os.fork():
        return child
    status = 70
    try:
        out = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        os.dup2(out, 1)
        os.dup2(out, 2)
        sys.stdout, sys.stderr = open(1, "w"), open(2, "w")  # noqa: SIM115 - as long as the process
        if room is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
        try:
            status = uavmap(arguments)
        except BaseException as error:
            sys.excepthook(type(error), error, error.__traceback__)
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(status)


def ended(child: int) -> int:
    """The exit status of a process, negative for a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def killed_after(child: int, delay_s: float, folder: Path) -> tuple[bool, int]:
    """Kill a process so long after the first event: whether it still lived, and how many events
    were confirmed."""
    due_s = float("inf")
    while time.monotonic() < due_s:
        if os.waitpid(child, os.WNOHANG) != (0, 0):
            return False, len(bodies(folder))
        if due_s == float("inf") and written(folder):
            due_s = time.monotonic() + delay_s
        time.sleep(POLL_S)
    confirmed = len(bodies(folder))
    os.kill(child, signal.SIGKILL)
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
        self._whole = Whole(folder, bodies(folder))

    def run(self, kind: str, number: int, tally: Tally) -> None:
        """One run to its end."""
        tally.runs += 1
        folder = self._below / f"{kind}-{number}"
        said = folder.with_suffix(".txt")
        try:
            (self._full if kind == "full" else self._kill)(folder, said, tally, kind == "twice")
            self._judge(folder, said)
        except AssertionError as error:
            tally.faults.append(f"{folder.name}: {error}")
        else:
            tally.counts["as if nothing had been"] += 1
            shutil.rmtree(folder)
            said.unlink()

    def _kill(self, folder: Path, said: Path, tally: Tally, twice: bool) -> None:
        confirmed = kills = 0
        while kills < (2 if twice else 1):
            child = started(self._again(folder), said)
            delay_s = float(self._rng.uniform(0.0, self._lasts_s))
            died, seen = killed_after(child, delay_s, folder)
            confirmed = max(confirmed, seen)
            self._check(folder, confirmed)
            if died and 0 < confirmed < len(self._whole.bodies):
                kills += 1
                continue
            tally.counts["after the end"] += 1
            self._lasts_s *= 0.9  # the machine is faster than it was
            shutil.rmtree(folder)
            confirmed = kills = 0
        tally.counts["killed in flight"] += kills

    def _full(self, folder: Path, said: Path, tally: Tally, twice: bool) -> None:
        largest = max(path.stat().st_size for path in self._whole.folder.iterdir())
        room = int(np.exp(self._rng.uniform(np.log(1000), np.log(1.2 * largest))))
        confirmed = 0
        for _ in range(2):
            code = ended(started(self._again(folder), said, room))
            assert code in (0, 2), f"{room} bytes: exit status {code}"
            tally.counts["disk full" if code else "had room"] += 1
            confirmed = max(confirmed, len(bodies(folder)))
            self._check(folder, confirmed)

    def _again(self, folder: Path) -> list[str]:
        """The command that the last one left to give."""
        if (folder / "journal.jsonl").exists():
            return ["resume", str(folder), "--json"]
        return [*self._fly, str(folder)]

    def _check(self, folder: Path, confirmed: int) -> None:
        """What was confirmed is there, and a copy of the folder can be opened."""
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
        assert found == self._whole.bodies[: len(found)], "other events than without a kill"
        assert len(found) >= confirmed, f"{confirmed} events were there, {len(found)} are"

    def _judge(self, folder: Path, said: Path) -> None:
        """Go on to the end, and hold the outcome against the uninterrupted flight."""
        code = ended(started(self._again(folder), said))
        text = said.read_text("utf-8", errors="replace")
        assert "Traceback" not in text, f"a traceback: see {said}"
        assert code == 0, f"exit status {code}: see {said}"
        assert bodies(folder) == self._whole.bodies, "another journal than without a kill"
        for name in SAME:
            same = (folder / name).read_bytes() == (self._whole.folder / name).read_bytes()
            assert same, f"another {name} than without a kill"


def main(arguments: list[str] | None = None) -> int:
    """Run and print; the exit status."""
    parser = argparse.ArgumentParser(description="Kill -9 at random moments.")
    parser.add_argument("--kills", type=int, default=200, help="flights that are killed once")
    parser.add_argument("--twice", type=int, default=40, help="... and again when resumed")
    parser.add_argument("--full", type=int, default=30, help="flights on a disk that fills")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mission", default="speck", help="a mission of tests/data")
    options = parser.parse_args(arguments)
    faults: list[str] = []
    below = Path(tempfile.mkdtemp(prefix="uavmap-kills-"))
    trials = Trials(options.mission, below, options.seed)
    for kind in ("kills", "twice", "full"):
        tally = Tally()
        for number in range(getattr(options, kind)):
            trials.run(kind, number, tally)
        counts = ", ".join(f"{name} {n}" for name, n in sorted(tally.counts.items()))
        print(f"{kind:6} {tally.runs:4d} runs: {counts}; faults {len(tally.faults)}", flush=True)
        faults += tally.faults
    for fault in faults:
        print(f"  {fault}")
    if faults:
        print(f"what is left of them: {below}")
    else:
        shutil.rmtree(below)
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
