"""Tools of the end-to-end tests: the command as a process, journals, simulators, a relay."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.sockets.server import free_ports
from tests.e2e.preloaded import Process
from uavmap.journal.event_log import JournalReader
from uavmap.runner.aircraft_takeover import ADDRESS

ROOT = Path(__file__).resolve().parents[2]
MISSIONS = ROOT / "tests" / "data"
SHARED = ROOT / "../shared/data"
LOOPBACK = "127.0.0.1"
PATIENCE_S = 300.0
RESTS = 4.0
"""Time between two evaluations of a condition, in times of its own."""
ROI_STATES = ("explored", "under exploration", "unexplored")
"""States of a cell in a map that belongs to the region."""


def mission(name: str) -> str:
    """Return the path of a mission of the tests; else the name, which may be a shipped one's."""
    path = MISSIONS / f"{name}.toml"
    return str(path) if path.exists() else name


def kinder(name: str, folder: Path, **quirks: float) -> str:
    """Return the name of a mission with other traits of its simulated aircraft, for `mission`."""
    lines = [f"{key} = {str(value).lower()}" for key, value in quirks.items()]
    text = Path(mission(name)).read_text(encoding="utf-8")
    made = folder / f"{name}-kinder"
    made.with_suffix(".toml").write_text("\n".join([text, "[sim.quirks]", *lines, ""]))
    return str(made)


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def command(*arguments: object) -> list[str]:
    """Return the command line of `uavmap`, for a process without preloaded modules."""
    return [sys.executable, "-m", "uavmap", *map(str, arguments)]


@dataclass(frozen=True, slots=True)
class Finished:
    code: int
    out: str
    err: str

    @property
    def summary(self) -> dict[str, Any]:
        values: dict[str, Any] = json.loads(self.out)
        return values

    def completed(self) -> dict[str, Any]:
        """Return the summary of a mission that is complete; fail unless it is."""
        assert self.code == 0, self.err
        assert self.summary["completed"] is True, self.summary["finding"]
        return self.summary


def uavmap(*arguments: object, cwd: Path | None = None, hash_seed: str | None = None) -> Finished:
    """Run `uavmap` to its end; no traceback may be shown.

    With a seed for hashes it is a process without preloaded modules.
    """
    if hash_seed is None:
        with started(*arguments, cwd=cwd) as process:
            return ended(process)
    done = python("-m", "uavmap", *arguments, cwd=cwd, PYTHONHASHSEED=hash_seed)
    assert "Traceback" not in done.err, done.err
    return done


def python(*words: object, cwd: Path | None = None, **changed: str) -> Finished:
    """Run Python on the source tree to its end; `changed` are variables of its environment."""
    done = subprocess.run(
        [sys.executable, *map(str, words)], cwd=cwd, env=environment() | changed,
        capture_output=True, text=True, timeout=2 * PATIENCE_S, check=False,
    )  # fmt: skip
    return Finished(done.returncode, done.stdout, done.stderr)


@contextlib.contextmanager
def started(*arguments: object, **how: Any) -> Iterator[Process]:
    """Run `uavmap` as a process, which ends with the block. `how` as for `Process`."""
    process = Process([str(argument) for argument in arguments], environment(), **how)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def ended(process: Process) -> Finished:
    out, err = process.communicate(timeout=PATIENCE_S)
    assert "Traceback" not in err, err
    return Finished(process.wait(), out, err)


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight that has ended."""

    done: Finished
    folder: Path

    @property
    def summary(self) -> dict[str, Any]:
        return self.done.summary

    def complete(self, most_missed: int = 0) -> dict[str, Any]:
        """Return its summary; fail unless it is complete, safe, and has missed no more cells."""
        summary = self.done.completed()
        assert summary["cells_missed"] <= most_missed
        assert summary["fence_breaches"] == summary["reserve_violations"] == 0
        return summary


def fly(source: object, folder: Path, *more: object, hash_seed: str | None = None) -> Flight:
    """Fly in the simulator: a mission file, one of the tests by name, or a shipped one."""
    words = ("fly", mission(str(source)), "--sim", "--json", "--out", folder, *more)
    return Flight(uavmap(*words, hash_seed=hash_seed), folder)


def flown_text(text: str, folder: Path, *more: object) -> Flight:
    """Fly the text of a mission, which is kept as `field.toml` in a folder, into `out` there."""
    file = folder / "field.toml"
    file.write_text(text, encoding="utf-8")
    return fly(file, folder / "out", *more)


def wait_until(condition: Callable[[], bool], what: str, timeout_s: float = PATIENCE_S) -> None:
    """Wait until a condition holds. One that takes long to evaluate is evaluated more rarely."""
    begin_s = now_s = time.monotonic()
    while not condition():
        took_s = time.monotonic() - now_s
        assert now_s < begin_s + timeout_s, f"waited {timeout_s:g} s in vain for {what}"
        time.sleep(max(0.01, RESTS * took_s))
        now_s = time.monotonic()


# --- journals --------------------------------------------------------------------------------
def bodies(folder: Path, after: int = 0) -> list[str]:
    """Return the texts of the events that are on the disk by now, but for the first ones."""
    path = folder / "journal.jsonl"
    return JournalReader(path).bodies()[after:] if path.exists() else []


def written(folder: Path) -> int:
    path = folder / "journal.jsonl"
    return path.read_bytes().count(b',"event":{') if path.exists() else 0


def events(folder: Path, *kinds: str) -> list[dict[str, Any]]:
    found = [json.loads(body) for body in bodies(folder)]
    return [event for event in found if not kinds or event["kind"] in kinds]


def wait_for(folder: Path, kind: str) -> None:
    wait_until(lambda: bool(events(folder, kind)), f"the first {kind}")


def since_resumed(folder: Path) -> list[dict[str, Any]]:
    """Return the events since the last resume, itself the first."""
    found = events(folder)
    last = max(index for index, event in enumerate(found) if event["kind"] == "resumed")
    return found[last:]


def aircraft_process(folder: Path) -> int:
    return int(json.loads((folder / ADDRESS).read_text("utf-8"))["process"])


def roi_cells(folder: Path) -> set[tuple[int, int]]:
    found = json.loads((folder / "map.geojson").read_text("utf-8"))
    return {
        (feature["properties"]["column"], feature["properties"]["row"])
        for feature in found["features"]
        if feature["properties"]["kind"] == "cell" and feature["properties"]["state"] in ROI_STATES
    }


def maps_alike(one: Path, other: Path, most: int = 2) -> bool:
    return len(roi_cells(one) ^ roi_cells(other)) <= most


def stop_after(
    process: Process, folder: Path, count: int, number: signal.Signals
) -> Finished | None:
    """Send a signal when a process has stopped at this number of events; None after a SIGKILL."""
    wait_until(lambda: written(folder) >= count or process.poll() is not None, f"{count} events")
    assert process.poll() is None, f"over before event {count}: {process.communicate()}"
    process.send_signal(number)
    process.send_signal(signal.SIGCONT)
    if number is signal.SIGKILL:
        process.communicate()
        return None
    return ended(process)


# --- sockets ---------------------------------------------------------------------------------
@contextlib.contextmanager
def simulator(
    name: str, *, speedup: float, vehicles: int = 1, autopilot: str = "ardupilot", seed: int = 1
) -> Iterator[list[str]]:
    """Run `uavmap sitl` in a process of its own; yield its URLs.

    The mission is one of the tests, or any.
    """
    port, http_port = free_ports(vehicles)
    arguments = ["sitl", "--mission", mission(name), "--speedup", speedup, "--vehicles", vehicles]
    arguments += ["--autopilot", autopilot, "--seed", seed]
    with started(*arguments, "--port", port, "--http-port", http_port) as process:
        urls = [process.stdout.readline().strip() for _ in range(vehicles)]
        assert all(urls), process.communicate()
        yield urls
        assert process.poll() is None, "the simulator has died"


class Relay(threading.Thread):
    """A relay between a simulated vehicle and its client: it forwards and counts each datagram.

    The vehicle's own address, which a second client needs, is known here.
    """

    def __init__(self, vehicle_sends_to: int) -> None:
        super().__init__()
        self._outer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._outer.bind((LOOPBACK, vehicle_sends_to))
        self._inner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._inner.bind((LOOPBACK, 0))
        self.client_port, _ = free_ports(1)
        self.vehicle: tuple[str, int] | None = None
        self.commands: list[str] = []
        """Commands of the client, but for its heartbeats."""
        self._over = threading.Event()
        for end in (self._outer, self._inner):
            end.settimeout(0.02)

    @property
    def url(self) -> str:
        return f"udpin://{LOOPBACK}:{self.client_port}"

    def run(self) -> None:
        codec = mav.MAVLink(None)
        codec.robust_parsing = True
        client = (LOOPBACK, self.client_port)
        down = threading.Thread(target=self._carry_down, args=(client,))
        down.start()
        while not self._over.is_set():
            with contextlib.suppress(TimeoutError, ConnectionError):
                data, _ = self._inner.recvfrom(4096)
                for message in codec.parse_buffer(data) or ():
                    if message.get_type() != "HEARTBEAT":
                        self.commands.append(str(message))
                if self.vehicle is not None:
                    self._outer.sendto(data, self.vehicle)
        down.join()

    def _carry_down(self, client: tuple[str, int]) -> None:
        while not self._over.is_set():
            with contextlib.suppress(TimeoutError, ConnectionError):
                data, self.vehicle = self._outer.recvfrom(4096)
                self._inner.sendto(data, client)

    def __enter__(self) -> Relay:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self.join()
        self._outer.close()
        self._inner.close()


def arguments_of(urls: Sequence[str]) -> list[str]:
    return [word for url in urls for word in ("--connect", url)]


@contextlib.contextmanager
def in_flight(
    urls: Sequence[str],
    folder: Path,
    speedup: float,
    *more: object,
    source: object = "speck",
    frames: int = 1,
    **how: Any,
) -> Iterator[Process]:
    """Start a flight over sockets; wait for a number of judged frames. `how` as for `Process`."""
    words = flying(mission(str(source)), urls, folder, speedup, *more)
    with started(*words, **how) as process:
        wait_until(
            lambda: len(events(folder, "frame_seen")) >= frames or process.poll() is not None,
            "judged frames",
        )
        assert process.poll() is None, process.communicate()
        yield process


def flying(
    source: object, urls: Sequence[str], folder: Path, speedup: float, *more: object
) -> list[object]:
    told = ("--speedup", speedup, "--json", "--out", folder)
    return ["fly", source, *arguments_of(urls), *told, *more]
