"""Whose behaviour a simulated vehicle has: the one place where an autopilot is chosen.

Body, physics, battery, camera, links, faults and signing are the same for all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from sitl.ardupilot.autopilot import Autopilot
from sitl.body.battery import Battery
from sitl.body.estimator import Estimator
from sitl.body.physics import Body
from sitl.copter.aircraft import Aircraft
from sitl.copter.motion import Airframe
from sitl.mavlink.commands import Commands
from sitl.mavlink.flight_commands import FlightCommands
from sitl.mavlink.interpreter import Interpreter
from sitl.mavlink.telemetry import Telemetry
from sitl.px4.autopilot import Px4Autopilot
from sitl.px4.commander import HomeCorrection
from sitl.px4.commands import Px4Commands
from sitl.px4.interpreter import Px4Interpreter
from sitl.px4.telemetry import Px4Telemetry
from sitl.vehicle_spec import VehicleSpec

_HOME_SEED = 43


@dataclass(frozen=True, slots=True)
class Kit:
    """The device that an autopilot is built into."""

    spec: VehicleSpec
    body: Body
    error: Estimator
    battery: Battery
    seed: tuple[int, ...]

    @property
    def airframe(self) -> Airframe:
        """What the autopilot cannot change."""
        spec = self.spec
        return Airframe(
            spec.max_speed_m_s, spec.max_accel_m_s2, spec.ready_after_s, spec.quirks.stick
        )


def _ardupilot(kit: Kit) -> Aircraft:
    autopilot = Autopilot(kit.body, kit.error, kit.battery, kit.airframe)
    if kit.spec.quirks.camera == "autopilot":
        autopilot.parameters.preset("CAM1_TYPE", 1)
    return autopilot


def _px4(kit: Kit) -> Aircraft:
    return Px4Autopilot(
        kit.body,
        kit.error,
        kit.battery,
        kit.airframe,
        system_id=kit.spec.system_id,
        correction=HomeCorrection((*kit.seed, _HOME_SEED), kit.spec.quirks.home_moves_m),
    )


class Flavour(NamedTuple):
    """An autopilot and its ways on the wire."""

    aircraft: Callable[[Kit], Aircraft]
    telemetry: type[Telemetry]
    commands: type[Commands]
    interpreter: type[Interpreter]


FLAVOURS: Mapping[str, Flavour] = {
    "ardupilot": Flavour(_ardupilot, Telemetry, FlightCommands, Interpreter),
    "px4": Flavour(_px4, Px4Telemetry, Px4Commands, Px4Interpreter),
}
