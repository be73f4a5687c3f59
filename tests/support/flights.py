"""One simulated vehicle under its driver; the test controls the link and the mode switch."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, Event, FrameSeen, Overridden
from missions.flight.setting_of import setting_of
from missions.geo.grid import Grid
from missions.mission.schema import Mission
from missions.mission.sim_section import SimQuirks, SimRegion
from missions.orders import FlyTo, Look, Order, StandDown, TakeOff
from missions.units import Cell, GridPoint
from tests.support.small_missions import CELL_M, START, mission, square
from uavmap.aircraft.cameras.mavlink import MavlinkSource
from uavmap.aircraft.cameras.pose import Poses
from uavmap.aircraft.imaging.classifier import Classifier, PictureJudge, PosedPicture
from uavmap.aircraft.imaging.imaging import CameraDriver
from uavmap.aircraft.vehicle import MavlinkVehicle
from uavmap.base.clock import VirtualClock, run
from uavmap.mavlink.session import GROUND_SYSTEM_ID, Session
from uavmap.runner.flight_links import mount_of
from uavmap.runner.simulation import STEP_S, make_vehicles

PATIENCE_S = 3600.0
"""Maximum wait for an event, s of the flight: on a busy machine these pass quickly."""

Message = Any
PILOT_SYSTEM_ID = 255
WIDTH_PX, HEIGHT_PX = 160, 120
UP_M = 12.0


def small_mission(
    swap_s: float = 20.0,
    autopilot: str = "ardupilot",
    quirks: SimQuirks = SimQuirks(),  # noqa: B008 - a value that nobody changes
    **how: Any,
) -> Mission:
    """Return a dark square of 8 m north-east of the start, in a box of 24 m by 16 m."""
    made = mission(square(-4, 10, 24, 16), square(-40, -40, 100, 110), **how)
    grid = Grid.at(START, CELL_M)
    corners = [grid.position(GridPoint(*xy)) for xy in square(6, 14, 8, 8)]
    region = SimRegion(polygon=tuple((p.lat_deg, p.lon_deg) for p in corners))
    sim = made.sim.model_copy(
        update={
            "roi": (region,), "swap_s": swap_s, "gps_sigma_m": 0.05, "autopilot": autopilot,
            "quirks": quirks,
        }
    )  # fmt: skip
    # a sixteenth of the pixels: pictures are most of the cost of a simulated flight
    camera = made.camera.model_copy(
        update={"width_px": WIDTH_PX, "height_px": HEIGHT_PX, "pixels_per_cell": 20.0}
    )
    return made.model_copy(update={"sim": sim, "camera": camera})


def by_pymavlink(send: Callable[[bytes], None]) -> Session:
    return Session(send, lambda frame: None)


class Flight:
    """A driver and the simulated vehicle at the other end.

    `to_vehicle` and `to_driver` see every message and may drop it (None) or change its frame.
    """

    def __init__(
        self,
        made: Mission,
        seed: int = 1,
        *,
        driver: Callable[[Callable[[bytes], None]], Session] = by_pymavlink,
        **patience: Any,
    ) -> None:
        self.setting = setting_of(made)
        self.vehicle = make_vehicles(made, seed)[0]
        self.events: list[Event] = []
        self.sent: list[tuple[float, Message]] = []
        self.lines: list[str] = []
        self.driving: asyncio.Task[None]
        """Task that runs as long as the service."""
        self.to_vehicle: Callable[[Message], bool] = lambda message: True
        self.to_driver: Callable[[Message], bool] = lambda message: True
        self.change: Callable[[bytes], bytes] = lambda picture: picture
        self._ours, self._theirs = mav.MAVLink(None), mav.MAVLink(None)
        self._pilot = mav.MAVLink(None, srcSystem=PILOT_SYSTEM_ID, srcComponent=190)
        self.session = driver(self._send)
        grid = self.setting.grid
        self._judge = PictureJudge({1: Classifier.for_mission(made, grid)})
        source = MavlinkSource(self.session, self._fetch)
        poses = Poses(self.session, mount_of(made.camera), grid)
        self.driver = MavlinkVehicle(
            1,
            "sim",
            self.session,
            CameraDriver(1, source, poses, made, self.judge, self.now_s),
            self.setting,
            self.now_s,
            self._crew,
            tell=self.lines.append,
            **patience,
        )

    @property
    def service_lines(self) -> list[str]:
        """Return the lines of the service, without the vehicle's own texts."""
        return [line for line in self.lines if not line.startswith("[vehicle ")]

    @staticmethod
    def now_s() -> float:
        return asyncio.get_running_loop().time()

    async def _crew(self, vehicle: int) -> None:
        """Swap a battery at once."""

    async def _fetch(self, url: str) -> bytes:
        data = self.vehicle.image(url)
        assert data is not None
        return self.change(data)

    def _send(self, frame: bytes) -> None:
        (message,) = self._ours.parse_buffer(frame)
        self.sent.append((self.now_s(), message))
        if self.to_vehicle(message):
            self._deliver(self.vehicle.receive(frame), later=True)

    def _deliver(self, data: bytes, *, later: bool = False) -> None:
        kept = b"".join(
            bytes(m.get_msgbuf())
            for m in self._theirs.parse_buffer(data) or []
            if self.to_driver(m)
        )
        if not kept:
            return
        if later:
            asyncio.get_running_loop().call_soon(self.session.feed, kept)
        else:
            self.session.feed(kept)

    async def fly_world(self) -> None:
        loop = asyncio.get_running_loop()
        start_s, steps = loop.time(), 0
        while True:
            self._deliver(self.vehicle.step(STEP_S))
            steps += 1
            await asyncio.sleep(start_s + steps * STEP_S - loop.time())

    # --- the pilot and the bystander ---------------------------------------------------------
    def pilot(self, command: int, *params: float) -> None:
        """Send a command of another system, with immediate effect."""
        filled = (*params, *([0.0] * (7 - len(params))))
        message = mav.MAVLink_command_long_message(1, 1, command, 0, *filled)
        self._deliver(self.vehicle.receive(message.pack(self._pilot)))

    def pilot_mode(self, mode: int) -> None:
        """Turn the pilot's mode switch; return once a heartbeat has shown the mode."""
        self.pilot(mav.MAV_CMD_DO_SET_MODE, 1, mode)
        assert self.session.view.mode == mode

    def commands_after(self, index: int) -> list[Message]:
        """Return the messages sent from a point on, but for heartbeats and the camera's stop."""
        return [
            message
            for _, message in self.sent[index:]
            if message.get_type() != "HEARTBEAT"
            and getattr(message, "command", None) != mav.MAV_CMD_IMAGE_STOP_CAPTURE
        ]

    async def sends_nothing(self, seconds: float) -> None:
        """Assert that only heartbeats and the camera's stop are sent for a time."""
        sent = len(self.sent)
        await asyncio.sleep(seconds)
        assert self.commands_after(sent) == []

    # --- the service's part ------------------------------------------------------------------
    def report(self, event: Event) -> None:
        """Report as the reducer does: an overridden vehicle stands down."""
        self.events.append(event)
        if isinstance(event, Overridden) and not self.driving.done():
            self.driver.give(StandDown())

    async def taken_in(self) -> None:
        """Return at once: reports are accepted immediately."""

    async def judge(self, taken: PosedPicture) -> bool:
        """Judge a picture at once."""
        verdict = self._judge.verdict(taken)
        self.report(verdict)
        await self.taken_in()
        return isinstance(verdict, FrameSeen)

    def seen(self, *kinds: type[Event]) -> list[Any]:
        return [event for event in self.events if isinstance(event, kinds)]

    async def sees(self, kind: type[Event], count: int = 1, within_s: float = PATIENCE_S) -> Any:
        """Wait for the n-th event of a kind; return it."""
        async with asyncio.timeout(within_s):
            while len(self.seen(kind)) < count:  # noqa: ASYNC110
                await asyncio.sleep(STEP_S)
        return self.seen(kind)[count - 1]

    async def until(self, condition: Callable[[], bool], within_s: float = PATIENCE_S) -> None:
        async with asyncio.timeout(within_s):
            while not condition():  # noqa: ASYNC110
                await asyncio.sleep(STEP_S)

    async def after(self, order: Order, kind: type[Event], within_s: float = PATIENCE_S) -> Any:
        count = len(self.seen(kind))
        self.driver.give(order)
        return await self.sees(kind, count + 1, within_s)


@contextlib.contextmanager
def no_task_left() -> Iterator[None]:
    before = asyncio.all_tasks()
    yield
    assert asyncio.all_tasks() == before


@contextlib.asynccontextmanager
async def under_way(flight: Flight) -> AsyncIterator[Flight]:
    """Run the world and the connected driver; at the end no task is left."""
    with no_task_left():
        async with running(flight):
            yield flight


@contextlib.asynccontextmanager
async def running(flight: Flight) -> AsyncIterator[None]:
    async with asyncio.TaskGroup() as tasks:
        world = tasks.create_task(flight.fly_world())
        await flight.driver.connect()
        driving = tasks.create_task(flight.driver.run(flight.report))
        flight.driving = driving
        guarding = tasks.create_task(flight.driver.guardian.run())
        await asyncio.sleep(0)
        yield
        driving.cancel()
        guarding.cancel()
        world.cancel()


def fly(body: Callable[[Flight], Coroutine[Any, Any, None]], made: Mission | None = None) -> Flight:
    flight = Flight(made if made is not None else small_mission())

    async def main() -> None:
        async with under_way(flight):
            await body(flight)

    run(main(), VirtualClock())
    assert all(m.get_srcSystem() == GROUND_SYSTEM_ID for _, m in flight.sent)
    return flight


def fly_up(
    body: Callable[[Flight], Coroutine[Any, Any, None]], made: Mission | None = None
) -> Flight:
    async def up(flight: Flight) -> None:
        await flight.after(TakeOff(UP_M), Airborne)
        await body(flight)

    return fly(up, made)


def to(east_m: float, north_m: float = 0.0, height_m: float = UP_M, *, stop: bool = True) -> FlyTo:
    return FlyTo((GridPoint(east_m, north_m),), None, stop=stop, height_m=height_m)


# --- phases of a flight --------------------------------------------------------------------------
Phase = Callable[[Flight], Coroutine[Any, Any, None]]


async def climbing(flight: Flight) -> None:
    flight.driver.give(TakeOff(UP_M))
    await flight.until(lambda: flight.vehicle.truth.height_m > 5.0)


async def flying(flight: Flight) -> None:
    await flight.after(TakeOff(UP_M), Airborne)
    flight.driver.give(to(60.0, 0.0))
    await asyncio.sleep(4.0)


async def looking(flight: Flight) -> None:
    await flight.after(TakeOff(UP_M), Airborne)
    flight.driver.give(Look(Cell(0, 0), 15, UP_M))
    await flight.sees(FrameSeen, 2)
