"""Checks whether this computer is fast enough for a mission, as findings."""

from __future__ import annotations

import asyncio
import importlib.metadata
import math
import platform
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import shapely
from shapely.geometry import Point

from missions.events import Airborne, Arrived, Connected, Event, FrameSeen, LiftedOff, Tracked, Vote
from missions.flight.path_orders import PLAN_LEAD_S
from missions.flight.state import Setting
from missions.flight.step import step
from missions.mission.height_and_speed import footprint_over
from missions.mission.places import drawn
from missions.orders import FlyPath
from missions.units import Cell, GridPoint, Pose, Quaternion
from uavmap.aircraft.imaging.classifier import Classifier
from uavmap.aircraft.path_stream import INTERVAL_S
from uavmap.base.extras import install_command
from uavmap.base.image_files import decoded
from uavmap.base.version import __version__
from uavmap.load.strategy_source import compile_planner
from uavmap.runner.preflight.finding import Finding, bad, ok, warn
from vision.projection import Frame

PYTHON: Final = (3, 11)
LITTLE_DISK_B: Final = 200 * 2**20
"""Minimum free disk space, bytes: the journal and log of an hour have some ten megabytes."""
NO_DISK_B: Final = 20 * 2**20
NEEDED: Final = (
    "numpy", "opencv-python-headless", "pillow", "pydantic", "pymavlink", "pyproj", "pyserial",
    "rich", "shapely",
)  # fmt: skip


def installation(folder: Path) -> Iterator[Finding]:
    """Yield the findings on this computer; `folder` is the place of results."""
    yield from _python()
    yield from _packages()
    yield _compiled()
    yield _disk(folder)
    yield from _formats()


def _python() -> Iterator[Finding]:
    found = f"{platform.python_version()} on {platform.machine()}, uavmap {__version__}"
    if sys.version_info >= PYTHON:
        yield ok("Python", found)
    else:
        wanted = ".".join(map(str, PYTHON))
        yield bad("Python", found, f"{wanted} or newer", "install a newer Python")


def _packages() -> Iterator[Finding]:
    versions, missing = [], []
    for name in NEEDED:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    if missing:
        names = ", ".join(missing)
        yield bad("packages", f"missing: {names}", "all of them", f"pip install {names}")
    yield ok("packages", ", ".join(versions))


def _compiled() -> Finding:
    from missions.planning.kernels.jit import COMPILED  # noqa: PLC0415 - numba takes a second

    if COMPILED:
        return ok("planning", f"compiled (numba {importlib.metadata.version('numba')})")
    remedy = f"{install_command('fast')}; strategies that stop do without"
    return warn("planning", "not compiled: numba is not installed", "numba", remedy)


def _disk(folder: Path) -> Finding:
    there = folder.absolute()
    while not there.exists():
        there = there.parent
    free_b = shutil.disk_usage(there).free
    found = f"{free_b / 2**20:.0f} MB free at {there}"
    if free_b < NO_DISK_B:
        return bad("disk", found, f"{LITTLE_DISK_B // 2**20} MB", "make room")
    if free_b < LITTLE_DISK_B:
        return warn("disk", found, f"{LITTLE_DISK_B // 2**20} MB", "make room before a long flight")
    return ok("disk", found)


def _formats() -> Iterator[Finding]:
    picture = np.full((16, 16, 3), 90, np.uint8)
    broken = []
    for suffix in (".jpg", ".png"):
        done, data = cv2.imencode(suffix, picture)
        if not done or cv2.imdecode(data, cv2.IMREAD_COLOR) is None:
            broken.append(suffix)
    if broken:
        remedy = "pip install --force-reinstall opencv-python-headless"
        found = f"this OpenCV has no {' and '.join(broken)}"
        yield bad("picture formats", found, "JPEG and PNG", remedy)
    else:
        yield ok("picture formats", "JPEG and PNG can be read and written")


STALL_S: Final = 1.5
"""Time to watch the event loop, s."""
BEAT_S: Final = 0.01
FRAMES_S: Final = 1.0
"""Time to judge frames, s, and their maximum number."""
FRAMES: Final = 10
PLANS_S: Final = 3.0
"""Time of a computed flight over the made-up region, s."""
REGION_SHARE: Final = 0.25
"""Area of the made-up region, as a share of the search box."""
_NADIR: Final = Quaternion.from_euler(0.0, -math.pi / 2.0, 0.0)


@dataclass(frozen=True, slots=True)
class ComputerSpeed:
    """Times of this computer, s; None without a mission, or for a strategy that stops."""

    stall_s: float
    """Maximum delay of an event loop beside other programs here, s."""
    frame_s: float | None = None
    """Time to decode and judge a frame, median of several, s."""
    plan_s: float | None = None
    """Time of the slowest plan, s."""

    @classmethod
    def measured(cls, setting: Setting | None) -> ComputerSpeed:
        """Measure, in some seconds. Raises `MissionFileError` for a missing detector."""
        stall_s = asyncio.run(longest_stall_s())
        if setting is None:
            return cls(stall_s)
        return cls(stall_s, frame_s(setting), longest_plan_s(setting))


async def longest_stall_s(watch_s: float = STALL_S) -> float:
    """Return the maximum delay of an event loop, s."""
    loop = asyncio.get_running_loop()
    end_s, worst_s = loop.time() + watch_s, 0.0
    while (begin_s := loop.time()) < end_s:
        await asyncio.sleep(BEAT_S)
        worst_s = max(worst_s, loop.time() - begin_s - BEAT_S)
    return worst_s


# --- frames ----------------------------------------------------------------------------------
def frame_s(setting: Setting) -> float:
    """Return the time to decode and judge a frame of the mission's camera by its detector, s."""
    mission = setting.mission
    height_m = mission.altitude_m(0)
    judge = Classifier.for_mission(mission, setting.grid, height_m)
    camera = judge.camera
    size_px = camera.width_px, camera.height_px
    # the same picture twice is a stalled camera
    pictures = [_picture(size_px, seed) for seed in (1, 2)]
    middle = drawn(mission.search.box, setting.grid).centroid
    pose = Pose(setting.grid.position(GridPoint(middle.x, middle.y)), height_m, _NADIR)
    took_s: list[float] = []
    for k in range(FRAMES + 1):
        begin_s = time.perf_counter()
        image = decoded(pictures[k % 2], "a made-up picture", size_px)
        judge.votes_anywhere(Frame(image, pose, 0.0, camera))
        took_s.append(time.perf_counter() - begin_s)
        if sum(took_s) > FRAMES_S:
            break
    timed = sorted(took_s[1:] or took_s)  # the first loads data for the others
    return timed[len(timed) // 2]


def _picture(size_px: tuple[int, int], seed: int) -> bytes:
    width, height = size_px
    noise = np.random.default_rng(seed).integers(40, 200, (height, width, 3), np.uint8)
    _, data = cv2.imencode(".jpg", cv2.GaussianBlur(noise, (0, 0), 2.0))
    return bytes(data)


# --- plans -----------------------------------------------------------------------------------
def longest_plan_s(setting: Setting, for_s: float = PLANS_S) -> float | None:
    """Return the time of the slowest plan over a made-up region, s; None for stops."""
    if setting.strategy.stops:
        return None
    compile_planner(setting.mission.strategy, lambda text: None)
    for _ in range(2):  # the first flight loads the planner
        flight = _ComputedFlight(setting)
        flight.fly(for_s / 2.0)
    return flight.slowest_s


class _ComputedFlight:
    """A computed flight whose vehicles are exactly on their paths, over a round region."""

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        self._state = setting.initial_state()
        self._t_s = 0.0
        self.slowest_s = 0.0
        box = drawn(setting.mission.search.box, setting.grid)
        # a disc at the beginning of the search: it is soon found
        middle = Point(setting.lanes[0][0]) if setting.lanes else box.centroid
        self._region = middle.buffer(math.sqrt(REGION_SHARE * box.area / math.pi))
        shapely.prepare(self._region)
        mission = setting.mission
        self._half_m = footprint_over(mission, mission.altitude_m(0)).short_m / 2.0

    def fly(self, for_s: float) -> None:
        """Take off, search and explore for `for_s` seconds of this computer."""
        setting = self._setting
        full_wh = setting.mission.battery.capacity_wh
        for number in self._state.vehicles:
            pad = setting.pad_of(number)
            self._post(Connected(number, self._t_s, pad, pad, 0.0, False, True, full_wh))
        for number in self._state.vehicles:
            self._t_s += 10.0
            self._post(LiftedOff(number, self._t_s))
            self._post(Airborne(number, self._t_s, home=setting.pad_of(number)))
        self.slowest_s = 0.0  # on the ground no vehicle waits
        end_s = time.perf_counter() + for_s
        while time.perf_counter() < end_s and not self._state.exploration_finished:
            self._t_s = round(self._t_s + setting.mission.camera.interval_s, 3)
            for number in self._state.vehicles:
                self._go_on(number, 0.9 * full_wh)

    def _go_on(self, number: int, left_wh: float) -> None:
        order = self._state.vehicles[number].order
        if not isinstance(order, FlyPath):
            return
        path, t_s = order.trajectory, self._t_s
        place = path.at(min(max(t_s, path.begin_s), path.end_s)).place
        self._post(FrameSeen(number, t_s, None, tuple(self._votes(place))))
        height_m = self._setting.mission.altitude_m(number - 1)
        self._post(Tracked(number, t_s, place, height_m, left_wh))
        if t_s >= path.end_s and self._state.vehicles[number].order is order:
            self._post(Arrived(number, t_s, place))

    def _votes(self, place: GridPoint) -> Iterator[Vote]:
        grid = self._setting.grid
        cell_m = self._setting.mission.grid.cell_m
        reach = int(self._half_m / cell_m) + 1
        here = grid.cell_at(grid.position(place), self._t_s)
        for east in range(-reach, reach + 1):
            for north in range(-reach, reach + 1):
                cell = Cell(here.east + east, here.north + north)
                middle = grid.to_fixed(grid.centre_of(cell), self._t_s)
                off_m = max(abs(a - b) for a, b in zip(middle, place, strict=True))
                if off_m + cell_m / 2.0 <= self._half_m:
                    yield Vote(cell, bool(self._region.contains(Point(middle))), 1.0)

    def _post(self, event: Event) -> None:
        begin_s = time.perf_counter()
        self._state, _ = step(self._state, event)
        self.slowest_s = max(self.slowest_s, time.perf_counter() - begin_s)


GAP_S: Final = 0.25
"""Maximum gap between setpoints in a flight, s. A PX4 leaves its path after 0.5 to 1 s."""
COMFORT_SHARE: Final = 0.5
"""Share of the mission's need above which a computer has little to spare."""
_FREE: Final = "end other programs on this computer, or take a faster one"


def computer_findings(
    speed: ComputerSpeed, setting: Setting | None, vehicles: int
) -> Iterator[Finding]:
    """Yield the measurements against the needs of a mission with `vehicles` vehicles here."""
    yield _finding(
        "event loop", speed.stall_s, GAP_S - INTERVAL_S, "late at worst",
        f"set-points go out every {INTERVAL_S:g} s, with gaps under {GAP_S:g} s", _FREE,
    )  # fmt: skip
    if setting is None:
        return
    if speed.frame_s is not None:
        each_s = setting.mission.camera.interval_s / vehicles
        yield _finding(
            "frames", speed.frame_s, each_s, "to judge one",
            f"{vehicles} x {1.0 / setting.mission.camera.interval_s:g} frames a second",
            "raise camera.interval_s, take fewer pixels or a faster detector, or a faster computer",
        )  # fmt: skip
    if speed.plan_s is not None:
        yield _finding(
            "plans", speed.plan_s, PLAN_LEAD_S, "for the slowest",
            f"a path begins {PLAN_LEAD_S:g} s after it is asked for", _FREE,
        )  # fmt: skip


def _finding(what: str, took_s: float, most_s: float, of: str, need: str, remedy: str) -> Finding:
    found = f"{1000.0 * took_s:.0f} ms {of}"
    wanted = f"at most {1000.0 * most_s:.0f} ms: {need}"
    if took_s > most_s:
        return bad(what, found, wanted, remedy)
    if took_s > COMFORT_SHARE * most_s:
        return warn(what, found, wanted, remedy)
    return ok(what, f"{found}; {wanted}")
