"""A fleet as in flight: a process a vehicle, each in a network namespace of its own.

    python -m tests.benchmarks.fleet_processes --mission FILE [--network group] [--loss 0.1]

It needs root, `ip` and /dev/net/tun. Each namespace holds a simulated vehicle, reached by its own
loopback, and `uavmap onboard`. The only connection to another is a TAP device; its other end is
here, an air that loses and delays frames. The bytes are the counts of the interfaces, with Ethernet
headers, from a vehicle's first frame to its last, by minutes of the mission.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import fcntl
import heapq
import json
import math
import os
import random
import selectors
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from missions.events import Landed, LiftedOff
from missions.flight.state import Setting
from tests.benchmarks.frame import options_of
from tests.support.small_missions import joined
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.load.mission_source import load
from uavmap.mavlink.links.signing import new_key
from uavmap.runner import simulation

ROOT = Path(__file__).resolve().parents[2]
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x2, 0x1000
RADIO = "radio0"
PATIENCE_S = 1800.0


@dataclass
class Air:
    """Carry frames between TAP devices: to their receiver, or to all."""

    taps: dict[int, int]
    """File descriptors by vehicle."""
    loss: float
    delay_s: float
    chance: random.Random = field(default_factory=lambda: random.Random(1))
    parted: bool = False
    over: bool = False
    spoken_s: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Times of the first and the last frame of each vehicle."""

    def carry(self) -> None:
        with selectors.DefaultSelector() as ready:
            for number, tap in self.taps.items():
                os.set_blocking(tap, False)
                ready.register(tap, selectors.EVENT_READ, number)
            waiting: list[tuple[float, int, int, bytes]] = []
            count = 0
            while not self.over:
                now_s = time.monotonic()
                while waiting and waiting[0][0] <= now_s:
                    *_, other, frame = heapq.heappop(waiting)
                    with contextlib.suppress(OSError):
                        os.write(self.taps[other], frame)
                left_s = min(0.05, waiting[0][0] - now_s) if waiting else 0.05
                for key, _ in ready.select(left_s):
                    with contextlib.suppress(OSError):
                        frame = os.read(self.taps[key.data], 4096)
                        now_s = time.monotonic()
                        first_s, _ = self.spoken_s.get(key.data, (now_s, now_s))
                        self.spoken_s[key.data] = first_s, now_s
                        to = frame[5] if frame[0] == 0x02 else None  # or a group
                        for other in self.taps:
                            lost = self.parted or self.chance.random() < self.loss
                            if other != key.data and to in (None, other) and not lost:
                                count += 1
                                due_s = time.monotonic() + self.delay_s
                                heapq.heappush(waiting, (due_s, count, other, frame))


def ip(*words: object) -> None:
    subprocess.run(["ip", *map(str, words)], check=True, capture_output=True, text=True)


@contextlib.contextmanager
def namespaces(count: int) -> Iterator[dict[int, int]]:
    """Make network namespaces with a radio each; yield the other ends of the radios."""
    taps: dict[int, int] = {}
    try:
        for number in range(1, count + 1):
            name, device = _name(number), f"uavmap{number}"
            tap = taps[number] = os.open("/dev/net/tun", os.O_RDWR)
            fcntl.ioctl(tap, TUNSETIFF, struct.pack("16sH", device.encode(), IFF_TAP | IFF_NO_PI))
            ip("netns", "add", name)
            ip("link", "set", device, "netns", name)
            inside = ("-n", name)
            ip(*inside, "link", "set", device, "name", RADIO)
            ip(*inside, "link", "set", RADIO, "address", f"02:00:00:00:00:{number:02x}")
            _in(name, "sysctl", "-qw", "net.ipv6.conf.all.disable_ipv6=1")
            ip(*inside, "addr", "add", f"10.77.0.{number}/24", "dev", RADIO)
            ip(*inside, "link", "set", RADIO, "up")
            ip(*inside, "link", "set", "lo", "up")
        yield taps
    finally:
        for number, tap in taps.items():
            os.close(tap)
            with contextlib.suppress(subprocess.CalledProcessError):
                ip("netns", "del", _name(number))


def _name(number: int) -> str:
    return f"uavmap-{number}"


def _in(name: str, *words: object) -> None:
    subprocess.run(["ip", "netns", "exec", name, *map(str, words)], check=True)


def sent_bytes(number: int) -> int:
    read = f"cat /sys/class/net/{RADIO}/statistics/tx_bytes"
    found = subprocess.run(
        ["ip", "netns", "exec", _name(number), "sh", "-c", read],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    return int(found.stdout)


def network(kind: str, number: int) -> list[str]:
    if kind == "group":
        return ["--listen", f"udp/224.0.0.224:7447#iface={RADIO}"]
    mine = ["--listen", f"{kind}/10.77.0.{number}:7447"]
    return mine + [
        word for k in range(1, number) for word in ("--peer", f"{kind}/10.77.0.{k}:7447")
    ]


def serve(mission_file: str, number: int, speedup: float, seed: int) -> None:
    """Simulate one vehicle of a mission, until it is killed."""
    mission = load(mission_file, None)
    own = mission.model_copy(update={"vehicles": mission.vehicles[number - 1 : number]})
    at = simulation.pictures_at(8150)
    asyncio.run(
        simulation.serve_vehicles(
            simulation.make_vehicles(own, seed + number, image_url_prefix=at), speedup=speedup,
            tcp=False, base_port=None, http_port=8150,
            on_ready=lambda urls: print(urls[0], flush=True),
        )
    )  # fmt: skip


def begun(number: int, words: Sequence[str], stderr: IO[str] | None) -> subprocess.Popen[str]:
    return subprocess.Popen(
        ["ip", "netns", "exec", _name(number), sys.executable, "-m", *words],
        env={**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
        text=True, stdout=subprocess.PIPE, stderr=stderr, cwd=ROOT,
    )  # fmt: skip


def fly_and_measure(
    options: argparse.Namespace, folder: Path, count: int, taps: dict[int, int]
) -> Any:
    key = folder / "key"
    new_key(key)
    air = Air(taps, options.loss, options.delay)
    carrying = threading.Thread(target=air.carry, daemon=True)
    carrying.start()
    served: list[subprocess.Popen[str]] = []
    members: dict[int, subprocess.Popen[str]] = {}
    speedup = ["--speedup", str(options.speedup)]
    try:
        for number in range(1, count + 1):
            words = ["tests.benchmarks.fleet_processes", "--mission", options.mission]
            words += ["--serve", str(number), *speedup]
            served.append(begun(number, words, stderr=None))
        for number, simulator in enumerate(served, start=1):
            assert simulator.stdout is not None
            url = simulator.stdout.readline().strip()
            words = ["uavmap", "onboard", options.mission, "--vehicle", str(number)]
            words += ["--connect", url, "--fleet-key", str(key), *speedup, "--json", "--yes"]
            words += ["--out", str(folder / f"vehicle-{number}"), *network(options.network, number)]
            said = (folder / f"vehicle-{number}.txt").open("w")
            members[number] = begun(number, words, stderr=said)
        begin_s, before = time.monotonic(), {n: sent_bytes(n) for n in members}
        while any(member.poll() is None for member in members.values()):
            now_s = time.monotonic() - begin_s
            assert now_s < PATIENCE_S, "still flying"
            air.parted = options.parted_from <= now_s < options.parted_until
            time.sleep(0.1)
        minutes = {n: (last - first) / 60.0 for n, (first, last) in air.spoken_s.items()}
        sent = {n: sent_bytes(n) - before[n] for n in members}
    finally:
        air.over = True
        for process in (*served, *members.values()):
            process.kill()
            process.wait()
        carrying.join()
    return {
        "codes": {n: member.returncode for n, member in members.items()},
        "bytes_a_minute": {
            n: round(count / minutes[n] / options.speedup) for n, count in sent.items()
        },
        "minutes": {n: round(spoken * options.speedup, 2) for n, spoken in minutes.items()},
    }


def journals(folder: Path, count: int) -> Any:
    """Compare all journals: the times of flight, and whether the regions are the same."""
    begun, ended, regions, frames = [], [], {}, {}
    for number in range(1, count + 1):
        with Journal.open(folder / f"vehicle-{number}" / JOURNAL) as journal:
            setting: Setting = FlightPlan.read(journal).known_setting()
            events = list(journal.events())
        begun += [event.t_s for event in events if isinstance(event, LiftedOff)]
        ended += [event.t_s for event in events if isinstance(event, Landed)]
        regions[number] = frozenset(joined(setting.initial_state(), events).belief.roi)
        frames[number] = sum(event.kind == "frame_seen" for event in events)
    return {
        "lift_off_to_landing_s": round(max(ended) - min(begun), 1),
        "cells": {number: len(region) for number, region in regions.items()},
        "regions_equal": len(set(regions.values())) == 1,
        "frames": frames,
    }


def main() -> int:
    options = options_of(
        __doc__, mission="bay", network="group", loss=0.0, delay=0.0, parted_from=math.inf,
        parted_until=math.inf, speedup=2.0, seed=1, out=str, serve=int,
    )  # fmt: skip
    options.mission = str(Path(options.mission).absolute())
    if options.serve is not None:
        serve(options.mission, options.serve, options.speedup, options.seed)
        return 0
    count = len(load(options.mission, None).vehicles)
    with contextlib.ExitStack() as stack:
        folder = Path(options.out or stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        try:
            taps = stack.enter_context(namespaces(count))
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"no network namespaces can be made here: {error}", file=sys.stderr)
            return 2
        figures = fly_and_measure(options, folder, count, taps)
        print(json.dumps({**figures, **journals(folder, count)}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
