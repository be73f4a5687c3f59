"""Whose behaviour a simulated vehicle has: the one place where an autopilot is chosen.

Body, physics, battery, camera, links, faults and signing are the same for all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from missions.geo.geodesy import LocalPlane
from sitl.ardupilot.autopilot import Autopilot
from sitl.body.altimeter import Altimeter
from sitl.body.battery import Battery
from sitl.body.estimator import Estimator
from sitl.body.physics import Body
from sitl.codec.wire import Packed
from sitl.copter.aircraft import Aircraft, Notice
from sitl.copter.motion import Airframe
from sitl.mavlink.base_commands import BaseCommands
from sitl.mavlink.commands import Commands
from sitl.mavlink.flight_commands import FlightCommands
from sitl.mavlink.interpreter import Interpreter
from sitl.mavlink.streams import Streams
from sitl.mavlink.telemetry import Telemetry
from sitl.px4.autopilot import Px4Autopilot
from sitl.px4.commander import HomeCorrection
from sitl.px4.commands import Px4Commands
from sitl.px4.events import Events
from sitl.px4.interpreter import Px4Interpreter
from sitl.px4.telemetry import DEFAULT_S, Px4Telemetry
from sitl.vehicle_spec import VehicleSpec

_HOME_SEED = 43


@dataclass(frozen=True, slots=True)
class Kit:
    """What an autopilot is built into: a device, and the plane that the world lies on."""

    spec: VehicleSpec
    body: Body
    error: Estimator
    battery: Battery
    plane: LocalPlane
    altimeter: Altimeter
    wind: Callable[[], tuple[float, float]]
    seed: tuple[int, ...]

    @property
    def airframe(self) -> Airframe:
        """What the autopilot cannot change."""
        spec = self.spec
        return Airframe(
            spec.max_speed_m_s, spec.max_accel_m_s2, spec.ready_after_s, spec.quirks.stick
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Flavour:
    """An autopilot and its ways on the wire.

    `default_s` are the messages that are streamed unasked and their intervals, `banner` is what a
    TCP client is greeted with. `texts_to_stations`: texts go to links on which a ground station
    was heard; `event` makes of a notice and the time what everybody is told instead.
    """

    aircraft: Aircraft
    telemetry: Telemetry
    flight: BaseCommands
    interpreter: Callable[[Commands, Streams], Interpreter]
    default_s: Mapping[int, float] = field(default_factory=dict)
    banner: bytes = b""
    tells_mode_at_once: bool = True
    camera_feedback: bool = True
    answers_for_camera: bool = True
    texts_to_stations: bool = False
    event: Callable[[Notice, float], Packed] | None = None


def _ardupilot(kit: Kit) -> Flavour:
    spec = kit.spec
    autopilot = Autopilot(
        kit.body,
        kit.error,
        kit.battery,
        kit.airframe,
    )
    if spec.quirks.camera == "autopilot":
        autopilot.parameters.preset("CAM1_TYPE", 1)
    telemetry = Telemetry(autopilot, kit.plane, kit.altimeter, kit.wind, spec.quirks)
    return Flavour(
        aircraft=autopilot,
        telemetry=telemetry,
        flight=FlightCommands(autopilot, kit.plane, kit.altimeter),
        interpreter=lambda commands, streams: Interpreter(
            spec.system_id, autopilot, commands, streams, telemetry
        ),
        banner=b"\r\n\r\nInit ArduCopter V4.6.0\r\n\r\nFree RAM: 131072\r\n",
    )


def _px4(kit: Kit) -> Flavour:
    spec = kit.spec
    autopilot = Px4Autopilot(
        kit.body,
        kit.error,
        kit.battery,
        kit.airframe,
        system_id=spec.system_id,
        correction=HomeCorrection((*kit.seed, _HOME_SEED), spec.quirks.home_moves_m),
    )
    telemetry = Px4Telemetry(autopilot, kit.plane, kit.altimeter, kit.wind, spec.quirks)
    return Flavour(
        aircraft=autopilot,
        telemetry=telemetry,
        flight=Px4Commands(autopilot, kit.plane, kit.altimeter),
        interpreter=lambda commands, streams: Px4Interpreter(
            spec.system_id, autopilot, commands, streams, telemetry
        ),
        default_s=DEFAULT_S,
        tells_mode_at_once=False,
        camera_feedback=False,
        answers_for_camera=False,
        texts_to_stations=True,
        event=Events().of,
    )


FLAVOURS: Mapping[str, Callable[[Kit], Flavour]] = {"ardupilot": _ardupilot, "px4": _px4}
