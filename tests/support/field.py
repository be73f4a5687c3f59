"""Simulated vehicles in this process, each at the end of a session, and a ground station beside."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.flight.setting_of import setting_of
from missions.mission.schema import Mission, VehicleSection
from missions.mission.sim_section import SimFault
from sitl.vehicle import SimVehicle
from tests.support.flights import small_mission
from tests.support.shown_lines import ShownLines
from uavmap.base.clock import VirtualClock, run
from uavmap.base.messages import shown_on
from uavmap.mavlink.session import Session
from uavmap.runner.flight_links import Link, mavlink_link
from uavmap.runner.preflight.autopilot_setup import AutopilotSetup
from uavmap.runner.preflight.examination import connect
from uavmap.runner.simulation import STEP_S, make_vehicles

Message = Any
BOTH = ("ardupilot", "px4")


def mission_of(
    autopilot: str, vehicles: int = 1, faults: tuple[SimFault, ...] = (), **changes: Any
) -> Mission:
    made = small_mission(autopilot=autopilot)
    sim = made.sim.model_copy(update={"faults": faults})
    team = tuple(VehicleSection() for _ in range(vehicles))
    return made.model_copy(update={"sim": sim, "vehicles": team, **changes})


class Field:
    """The vehicles of a mission. `lose` decides for each frame, either way, whether it is lost."""

    def __init__(self, made: Mission) -> None:
        self.setting = setting_of(made)
        self.vehicles = make_vehicles(made, 1)
        self.lines = ShownLines()
        self.lose: Callable[[], bool] = lambda: False
        self._codec = mav.MAVLink(None, srcSystem=255, srcComponent=190)
        self.links = [self._link(vehicle) for vehicle in self.vehicles]

    def _link(self, vehicle: SimVehicle) -> Link:
        session = self._session(vehicle)
        return mavlink_link(f"sim {vehicle.spec.system_id}", session, self._fetch)

    def _session(self, vehicle: SimVehicle) -> Session:
        def send(frame: bytes) -> None:
            if not self.lose() and (answer := vehicle.receive(frame)) and not self.lose():
                asyncio.get_running_loop().call_soon(session.feed, answer)

        session = Session(send, lambda frame: None)
        return session

    async def _fetch(self, url: str) -> bytes:
        found = [data for v in self.vehicles if (data := v.image(url)) is not None]
        return found[0]

    async def turn(self) -> None:
        loop = asyncio.get_running_loop()
        for steps in itertools.count(1):
            for vehicle, link in zip(self.vehicles, self.links, strict=True):
                if (frames := vehicle.step(STEP_S)) and not self.lose():
                    link.session.feed(frames)
            await asyncio.sleep(steps * STEP_S - loop.time())

    # --- the ground station beside -----------------------------------------------------------
    def ask(self, index: int, message: Message) -> list[Message]:
        """Send a frame of another system to a vehicle; return its immediate answer."""
        answer = self.vehicles[index].receive(message.pack(self._codec))
        return mav.MAVLink(None).parse_buffer(answer) or []

    def parameter(self, index: int, name: str) -> float:
        system = self.vehicles[index].spec.system_id
        read = mav.MAVLink_param_request_read_message(system, 1, name.encode(), -1)
        (value,) = [m for m in self.ask(index, read) if m.get_type() == "PARAM_VALUE"]
        if self.vehicles[index].spec.autopilot == "px4" and value.param_type != 9:
            from sitl.px4.params import from_bytewise  # noqa: PLC0415

            return from_bytewise(value.param_value)
        return float(value.param_value)

    def put(self, index: int, name: str, value: float) -> None:
        """Set a real parameter, or one of an ArduPilot."""
        system = self.vehicles[index].spec.system_id
        self.ask(index, mav.MAVLink_param_set_message(system, 1, name.encode(), value, 9))

    def count(self, index: int, kind: int) -> int:
        system = self.vehicles[index].spec.system_id
        ask = mav.MAVLink_mission_request_list_message(system, 1, kind)
        (answer,) = [m for m in self.ask(index, ask) if m.get_type() == "MISSION_COUNT"]
        return int(answer.count)

    def setup(self, number: int, folder: Path) -> AutopilotSetup:
        link = self.links[number - 1]
        return AutopilotSetup(number, link.session, self.setting, folder)


@dataclass
class Ran:
    field: Field


def on_field(
    body: Callable[[Field], Coroutine[Any, Any, None]], made: Mission, ready_s: float = 8.0
) -> Ran:
    """Run a test with connected vehicles, once they have a position."""
    field = Field(made)

    async def main() -> None:
        async with asyncio.TaskGroup() as tasks:
            world = tasks.create_task(field.turn())
            for link in field.links:
                await connect(link.session, link.name)
            await asyncio.sleep(ready_s)
            await body(field)
            world.cancel()

    with shown_on(field.lines):
        run(main(), VirtualClock())
    return Ran(field)
