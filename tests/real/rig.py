"""One scenario: aircraft with their relays and cameras, `uavmap` as a process, the referee."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from socket import SOCK_DGRAM
from statistics import median
from typing import Final

from missions.mission.places import homes
from missions.units import LatLon
from sitl.sockets.server import PictureServer
from tests.e2e.rig import ROOT, aircraft_process, command, environment
from tests.real.autopilot import Autopilot, Pad, Truth, Values
from tests.real.figures import Row, simulated, summary_of
from tests.real.pilot import FENCE, RALLY, Item, Message, changed
from tests.real.referee import Referee, middle_of_region, scored
from tests.real.relay import Relay
from tests.support.ports import free_port
from tests.support.small_missions import first_patch
from uavmap.load.mission_source import load
from uavmap.runner.aircraft_takeover import ADDRESS
from uavmap.runner.simulation import make_vehicles, setup_of

AFFORDED: Final = 2.5
"""Maximum speed on a computer on which an aircraft keeps the speed of its start."""
SEEDS: Final = (1, 2, 3, 4, 5)
"""Seeds of the simulated flights beside a real one; the medians count."""
SPEEDS: Final = (0.25, 0.5, 1.0)
READY_S: Final = 240.0
_LOOK_S: Final = 0.02
_LAST_WORDS_S: Final = 3.0
_SLOWEST: Final = 12.0
"""Maximum duration of a scenario, in multiples of the time by the vehicle's clock."""
CLOCK: Final = re.compile(r'"mission_s":([0-9.]+),.*?"since_boot_s":([0-9.]+)')
CHANGING: Final = (
    "STAT_", "SIM_", "MOT_THST_HOVER", "CAL_", "COM_FLIGHT_UUID", "LND_FLIGHT_T", "_HASH_CHECK",
)  # fmt: skip
"""Parameters that an autopilot changes by itself in a flight, and those of its simulation."""


@dataclass(slots=True)
class Run:
    process: asyncio.subprocess.Process
    lines: list[str] = field(default_factory=list)
    reader: asyncio.Task[None] | None = None

    @property
    def over(self) -> bool:
        return self.process.returncode is not None

    @property
    def code(self) -> int:
        assert self.process.returncode is not None
        return self.process.returncode

    def has_line(self, text: str) -> bool:
        return any(text in line for line in self.lines)

    def interrupt(self) -> None:
        self.process.send_signal(signal.SIGINT)

    async def kill(self) -> None:
        """Kill it, as a power cut does."""
        self.process.kill()
        # not `wait()`: the process of the aircraft keeps the pipe open
        while self.process.returncode is None:  # noqa: ASYNC110 - nothing else tells it
            await asyncio.sleep(_LOOK_S)


@dataclass(frozen=True, slots=True)
class Kept:
    """Settings that an autopilot keeps for its owner."""

    parameters: dict[str, float]
    fence: list[Item]
    rally: list[Item]


class Rig:
    def __init__(
        self, kind: type[Autopilot], program: Path, folder: Path, row: Row, mission: str, *,
        near: bool, speed_m_s: float | None, parameters: Values, shipped: bool,
    ) -> None:  # fmt: skip
        self.kind, self.row, self.folder, self.out = kind, row, folder, folder / "out"
        self.source = folder / "mission.toml"
        text = (ROOT / "missions" / "shipped" / f"{mission}.toml").read_text("utf-8")
        text = text if shipped else first_patch(text)
        if near:
            at = middle_of_region(load(mission))
            prior = f"prior = [{at.lat_deg:.6f}, {at.lon_deg:.6f}]"
            text = text.replace("[search]\n", f"[search]\n{prior}\n", 1)
        if speed_m_s is not None:
            text = re.sub(r"(?m)^speed_m_s = \S+", f"speed_m_s = {speed_m_s}", text, count=1)
        # for `--sim` alone: a real flight does not read it
        text = text.replace("[sim]\n", f'[sim]\nautopilot = "{kind.name}"\n', 1)
        self.source.write_text(text, "utf-8")
        self.mission = load(str(self.source))
        self.speed = SPEEDS[0]
        pads, amsl_m = homes(self.mission), self.mission.start.amsl_m
        first = kind.free_instance(len(pads))
        self.aircraft = [
            kind(program, Pad(first + k, place, amsl_m, self._made(f"aircraft{k + 1}")), parameters)
            for k, place in enumerate(pads)
        ]
        self.referee = Referee(self.mission)
        self.runs: list[Run] = []
        self.relays: list[Relay] = []
        self.before: list[Kept] = []
        self._pictures = PictureServer(self._picture)
        self._crew: asyncio.Task[None] | None = None
        self._noted: tuple[float, float] | None = None
        """Mission time and computer's time of one moment."""

    def _made(self, name: str) -> Path:
        (self.folder / name).mkdir(parents=True, exist_ok=True)
        return self.folder / name

    # --- to begin and to end ---------------------------------------------------------------------
    async def __aenter__(self) -> Rig:
        try:
            await self._begin()
        except BaseException:
            await self.__aexit__()
            raise
        return self

    async def _begin(self) -> None:
        world, camera = make_vehicles(self.mission, 1)[0].world, setup_of(self.mission, 1).camera
        self._port = await self._pictures.open(0)
        for k, one in enumerate(self.aircraft):
            port = free_port(SOCK_DGRAM)
            prefix = f"http://127.0.0.1:{self._port}/{k + 1}/"
            self.relays.append(Relay(one, world, camera, port, prefix))
            self.relays[-1].mission_s = self.mission_s
            await self.relays[-1].open()
            one.pilot.follow.append(self._watch(k, one))
        await asyncio.gather(*(one.start(self.kind.boot_speed) for one in self.aircraft))
        begun_s, wall_s = self.now_s, time.monotonic()
        await asyncio.sleep(3.0)
        held = (self.now_s - begun_s) / (time.monotonic() - wall_s)
        afforded = max(AFFORDED * held / self.kind.boot_speed, SPEEDS[0])
        self.speed = max(speed for speed in SPEEDS if speed <= afforded)
        await self._until_ready()
        await asyncio.gather(*(one.keep_pace(self.speed) for one in self.aircraft))
        await self._until_ready()
        self.before = [await self.kept(one) for one in self.aircraft]
        self.row.version, self.row.speed = await self.aircraft[0].version(), self.speed
        self.row.load = round(os.getloadavg()[0], 1)
        self._begun = self.now_s, time.monotonic()

    async def _until_ready(self) -> None:
        await self.until(lambda: all(one.pilot.ready for one in self.aircraft), "ready", READY_S)

    async def __aexit__(self, *_: object) -> None:
        for run in self.runs:
            if not run.over:
                await run.kill()
        with contextlib.suppress(OSError, ValueError, KeyError):
            os.kill(aircraft_process(self.out), signal.SIGKILL)
        if self._crew is not None:
            self._crew.cancel()
        await asyncio.gather(*(one.stop() for one in self.aircraft))
        for relay in self.relays:
            relay.close()
        await self._pictures.close()
        log = [line for run in self.runs for line in (*run.lines, "")]
        (self.folder / "said.txt").write_text("\n".join(log), "utf-8")

    def _watch(self, number: int, one: Autopilot) -> Callable[[Message], None]:
        last: list[Truth | None] = [None]

        def observe(told: Message) -> None:
            if one.truth is not None and one.truth is not last[0]:
                last[0] = one.truth
                self.referee.watch(number, one.truth)

        return observe

    def _picture(self, path: str) -> bytes | None:
        url = f"http://127.0.0.1:{self._port}{path}"
        found = (relay.image(url) for relay in self.relays)
        return next((data for data in found if data is not None), None)

    # --- time ------------------------------------------------------------------------------------
    @property
    def now_s(self) -> float:
        """Return the time of the first vehicle's clock."""
        return self.aircraft[0].pilot.time_s

    async def until(self, so: Callable[[], bool], what: str, within_s: float) -> None:
        """Wait for a condition, up to a time by the vehicle's clock."""
        end_s = self.now_s + within_s
        wall_s = time.monotonic() + _SLOWEST * within_s / self.speed + 60.0
        while not so():
            assert self.now_s < end_s, f"not within {within_s:g} s: {what}"
            assert time.monotonic() < wall_s, f"the computer is too slow: {what}"
            await asyncio.sleep(_LOOK_S)

    async def rest(self, for_s: float) -> None:
        """Let time of the vehicle's clock pass."""
        end_s = self.now_s + for_s
        await self.until(lambda: self.now_s >= end_s, f"{for_s:g} s", for_s + 60.0)

    def mission_s(self) -> float:
        """Return the mission's time, by its journal: it passes with the computer's clock."""
        if self._noted is None:
            path = self.out / "journal.jsonl"
            found = CLOCK.search(path.read_text("utf-8")) if path.exists() else None
            self._noted = None if found is None else (float(found[1]), float(found[2]))
        if self._noted is None:
            return 0.0
        mission_s, since_boot_s = self._noted
        passed_s = time.clock_gettime(time.CLOCK_BOOTTIME) - since_boot_s
        return mission_s + self.speed * passed_s

    # --- uavmap ----------------------------------------------------------------------------------
    async def uavmap(self, *words: object) -> Run:
        process = await asyncio.create_subprocess_exec(
            *command(*words), cwd=self.folder, env=environment() | {"PYTHONUNBUFFERED": "1"},
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        run = Run(process, [f"$ uavmap {' '.join(map(str, words))}"])
        run.reader = asyncio.create_task(self._read(run))
        self.runs.append(run)
        return run

    async def _read(self, run: Run) -> None:
        assert run.process.stdout is not None
        async for line in run.process.stdout:
            run.lines.append(line.decode(errors="replace").rstrip())

    @property
    def links(self) -> list[str]:
        """Return `--connect` for each vehicle, and the speed."""
        urls = [f"udpin://127.0.0.1:{relay.client_port}" for relay in self.relays]
        words = [word for url in urls for word in ("--connect", url)]
        return [*words, "--speedup", f"{self.speed:g}"]

    async def fly(self, *words: object, yes: bool = True) -> Run:
        agreed = ("--yes",) if yes else ()
        run = await self.uavmap(
            "fly", self.source, *self.links, "--out", self.out, *agreed, *words
        )  # fmt: skip
        if self._crew is None:
            self._crew = asyncio.create_task(self._swap())
        return run

    async def resume(self, *words: object) -> Run:
        return await self.uavmap("resume", self.out, *words)

    async def end_of(self, run: Run, within_s: float = 900.0) -> int:
        """Wait for the end of a process; return its exit code."""
        await self.until(lambda: run.over, "the end of uavmap", within_s)
        if run.reader is not None:
            await asyncio.wait([run.reader], timeout=_LAST_WORDS_S)
        return run.code

    async def fly_simulated(self, *words: object) -> float:
        """Fly the same mission in the bundled simulator, for the row; return the median IoU."""
        found = []
        for seed in SEEDS:
            out = self.folder / f"sim-{seed}"
            run = await self.uavmap(
                "fly", self.source, "--sim", "--seed", seed, "--out", out, *words
            )
            await run.process.wait()
            found.append(summary_of(out))
        self.row.simulated = simulated(found)
        return float(median(summary["iou_cells"] for summary in found))

    async def called_off(self, run: Run) -> int:
        """Press Ctrl-C and wait for the end."""
        if not run.over:
            run.interrupt()
        return await self.end_of(run, 300.0)

    async def _swap(self) -> None:
        """Swap the battery of each vehicle that has landed, a minute later."""
        landed_s: list[float | None] = [None] * len(self.aircraft)
        flown = [False] * len(self.aircraft)
        while True:
            await asyncio.sleep(0.1)
            for k, one in enumerate(self.aircraft):
                if self.referee.up_m(k) > 2.0:
                    flown[k], landed_s[k] = True, None
                elif flown[k] and not one.pilot.armed:
                    landed_s[k] = one.pilot.time_s if landed_s[k] is None else landed_s[k]
                    if one.pilot.time_s - (landed_s[k] or 0.0) > 60.0:
                        flown[k], landed_s[k] = False, None
                        await one.swap_battery()

    async def fly_by_hand(self, to: LatLon) -> None:
        """Have the pilot take off the first aircraft, and fly it to a place."""
        one, up_m = self.aircraft[0], 12.0
        await one.take_off(up_m)
        await self.until(lambda: self.referee.up_m(0) > 0.9 * up_m, "in the air", 60.0)
        await one.pilot.go_to(to, one.pad.amsl_m + up_m)
        await self.rest(20.0)

    # --- where the flight is ---------------------------------------------------------------------
    async def in_search(self, run: Run) -> None:
        await self._fast(run, lambda: True, "on a path")
        await self.rest(4.0)

    async def exploring(self, run: Run) -> None:
        await self._fast(run, lambda: run.has_line(" s  exploring, "), "exploring")

    async def _fast(self, run: Run, so: Callable[[], bool], what: str) -> None:
        least_m_s = 0.6 * self.mission.flight.speed_m_s
        high_m = 0.8 * self.mission.altitude_m(0)

        def flies() -> bool:
            assert not run.over, f"it has ended with {run.code} before it was {what}"
            pilot, up_m = self.aircraft[0].pilot, self.referee.up_m(0)
            return pilot.speed_m_s > least_m_s and up_m > high_m and so()

        await self.until(flies, what, 400.0)

    async def climbing(self, run: Run) -> None:
        await self.until(lambda: run.over or self.referee.up_m(0) > 4.0, "climbing", 200.0)

    async def descending(self, run: Run) -> None:
        """Recall all, and wait until the first aircraft is in its descent."""
        run.interrupt()
        low_m = 0.6 * self.mission.altitude_m(0)
        await self.until(lambda: self.referee.up_m(0) < low_m, "in its descent", 200.0)

    async def all_down(self, within_s: float = 300.0) -> None:
        await self.until(
            lambda: (
                not self.referee.judge.in_the_air and not any(o.pilot.armed for o in self.aircraft)
            ),
            "all on the ground, their motors off",
            within_s,
        )  # fmt: skip

    def kill_aircraft_process(self) -> None:
        os.kill(aircraft_process(self.out), signal.SIGKILL)

    @property
    def aircraft_process_lives(self) -> bool:
        return (self.out / ADDRESS).exists()

    # --- what is left behind ---------------------------------------------------------------------
    async def kept(self, one: Autopilot) -> Kept:
        found = await one.pilot.parameters()
        values = {k: v for k, v in found.items() if not k.startswith(CHANGING)}
        return Kept(values, await one.pilot.items(FENCE), await one.pilot.items(RALLY))

    async def not_put_back(self) -> str:
        """Return the owner's settings that are not as before; empty if all are."""
        found = []
        for k, one in enumerate(self.aircraft):
            before, now = self.before[k], await self.kept(one)
            names = [f"{n} {v}" for n, v in changed(before.parameters, now.parameters).items()]
            names += ["fence"] if before.fence != now.fence else []
            names += ["rally points"] if before.rally != now.rally else []
            found += [f"vehicle {k + 1}: {', '.join(names)}"] if names else []
        return "; ".join(found)

    async def comes_home(self, run: Run) -> None:
        """Press Ctrl-C; assert that all come home."""
        await self.called_off(run)
        await self.ends_well(run, 3)

    async def ends_well(
        self, run: Run, *codes: int, put_back: bool = True, within_s: float = 300.0
    ) -> None:
        """Wait for the end; assert it, by the truth, and record the figures."""
        code, summary = await self.end_of(run, within_s), summary_of(self.out)
        self.row.code = code
        sim_s, wall_s = self.now_s - self._begun[0], time.monotonic() - self._begun[1]
        self.row.held = round(sim_s / wall_s, 2)
        self.row.add_flight(summary, self.referee, scored(self.out, self.mission))
        await self.all_down()
        left = await self.not_put_back()
        self.row.put_back = left or "all"
        wrong = self.referee.dishonest(code, run.lines, summary, left if put_back else "")
        assert not wrong, wrong
        assert code in codes, f"exit {code}, not {' or '.join(map(str, codes))}"
