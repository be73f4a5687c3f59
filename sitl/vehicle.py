"""A simulated vehicle: device, autopilot, camera and their MAVLink, put together.

    bytes -> receive -> bytes        what a client says, and the immediate answers
    step(dt) -> bytes                time passes, and what is sent meanwhile

Vehicle time begins at 0 with the construction and is the world's time: the vehicles of one world
are stepped together. Equal seeds, bytes and steps give equal bytes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from sitl.autopilot import Autopilot
from sitl.battery import Battery
from sitl.camera import CameraSpec, Shot
from sitl.commands import Commands, statustext
from sitl.interpreter import Interpreter
from sitl.modes import Mode
from sitl.payload import Exposure, Payload
from sitl.physics import MAX_STEP_S, Body
from sitl.sensors import PositionError
from sitl.streams import Streams
from sitl.telemetry import Telemetry
from sitl.world import World

_HEARTBEAT_S = 1.0
_TIMESYNC_S = 10.0
_SOON_S = 1e-6
# Power over hovering's: per m/s of climb, per m/s of descent, per (m/s)^2 of airspeed
_CLIMB_POWER, _DESCENT_POWER, _AIRSPEED_POWER = 0.08, 0.02, 0.0015
_IDLE_POWER = 0.08  # motors turning on the ground


@dataclass(frozen=True, slots=True)
class VehicleSpec:
    """One vehicle.

    `swap_after_s`: landed, disarmed and not full for so long, it gets a fresh battery (a ground
    crew); 0 never. `gps_sigma_m` and `gps_tau_s`: size and correlation time of the horizontal
    position error. `image_url_prefix`: what the pictures' addresses begin with; the system id and
    the picture's index follow.
    """

    system_id: int
    home: LatLon
    home_yaw_deg: float = 0.0
    battery_wh: float = 60.0
    hover_power_w: float = 300.0
    swap_after_s: float = 60.0
    camera: CameraSpec = field(default_factory=CameraSpec)
    gps_sigma_m: float = 0.3
    gps_tau_s: float = 60.0
    ready_after_s: float = 5.0
    max_speed_m_s: float = 15.0
    max_accel_m_s2: float = 3.0
    max_tilt_deg: float = 30.0
    image_url_prefix: str = "sim://"

    def __post_init__(self) -> None:
        problems = []
        if not 1 <= self.system_id <= 254:
            problems.append("system_id is 1 to 254")
        if not (self.gps_sigma_m >= 0.0 and self.gps_tau_s > 0.0):
            problems.append("gps_sigma_m is not negative, gps_tau_s positive")
        if not (self.max_speed_m_s > 0.0 and self.max_accel_m_s2 > 0.0):
            problems.append("max_speed_m_s and max_accel_m_s2 are positive")
        if not 5.0 <= self.max_tilt_deg <= 30.0:
            problems.append("max_tilt_deg is 5 to 30")
        if not (self.hover_power_w > 0.0 and self.battery_wh > 0.0):
            problems.append("battery_wh and hover_power_w are positive")
        if len(self.image_url_prefix) > 180:
            problems.append("image_url_prefix is at most 180 characters")
        if problems:
            raise ValueError(f"vehicle {self.system_id}: " + "; ".join(problems))


@dataclass(frozen=True, slots=True)
class VehicleTruth:
    """What is really the case; no client sees it.

    `velocity_m_s` is (east, north, up), `yaw_rad` true bearing, `height_m` over the ground.
    """

    t_s: float
    position: LatLon
    height_m: float
    velocity_m_s: tuple[float, float, float]
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    armed: bool
    landed: bool
    crashed: bool
    energy_wh: float
    mode: Mode
    swaps: int


class SimVehicle:
    """A multicopter with a camera that flies in a `World` and speaks MAVLink 2."""

    def __init__(self, spec: VehicleSpec, world: World) -> None:
        self.spec = spec
        self.world = world
        east, north = world.plane.to_plane(spec.home)
        rng = np.random.default_rng([world.spec.seed, spec.system_id])
        self._body = Body(
            east, north, math.radians(spec.home_yaw_deg), math.radians(spec.max_tilt_deg)
        )
        self._battery = Battery(spec.battery_wh)
        self._ap = Autopilot(
            self._body,
            PositionError(rng, spec.gps_sigma_m, spec.gps_tau_s),
            self._battery,
            ready_after_s=spec.ready_after_s,
            max_speed_m_s=spec.max_speed_m_s,
            max_accel_m_s2=spec.max_accel_m_s2,
        )
        amsl_m = world.spec.origin_amsl_m
        self._telemetry = Telemetry(self._ap, world.plane, amsl_m, self._wind)
        self._streams = Streams()
        prefix = f"{spec.image_url_prefix}{spec.system_id}/"
        self._payload = Payload(spec.camera, world, self._telemetry, prefix, self._expose)
        commands = Commands(
            self._ap, self._telemetry, self._streams, self._payload, world.plane, amsl_m
        )
        self._interpreter = Interpreter(spec.system_id, self._ap, commands, self._streams)
        self._next_heartbeat_s = 0.0
        self._next_timesync_s = 0.0
        self._resting_s = 0.0
        self._swaps = 0

    @property
    def t_s(self) -> float:
        """Seconds since boot."""
        return self._ap.t_s

    def receive(self, data: bytes) -> bytes:
        """Bytes from a client, in any pieces; the immediate replies."""
        replies = self._interpreter.receive(data)
        return replies + self._announce()

    def step(self, dt_s: float) -> bytes:
        """Let `dt_s` pass, in steps of at most 0.05 s; everything sent meanwhile."""
        if not (math.isfinite(dt_s) and dt_s >= 0.0):
            raise ValueError(f"time goes forward: {dt_s}")
        count = max(1, math.ceil(dt_s / MAX_STEP_S - 1e-9)) if dt_s > 0.0 else 0
        sent = bytearray()
        for _ in range(count):
            sent += self._small_step(dt_s / count)
        return bytes(sent)

    def image(self, url: str) -> bytes | None:
        """The JPEG announced under a `file_url`; None when unknown or too old."""
        return self._payload.image(url)

    @property
    def truth(self) -> VehicleTruth:
        """The true state."""
        body = self._body
        roll, pitch = body.roll_pitch
        return VehicleTruth(
            t_s=self._ap.t_s,
            position=self.world.plane.to_wgs84(body.east, body.north),
            height_m=body.up,
            velocity_m_s=(body.v_east, body.v_north, body.v_up),
            roll_rad=roll,
            pitch_rad=pitch,
            yaw_rad=body.yaw,
            armed=self._ap.armed,
            landed=body.on_ground,
            crashed=body.crashed,
            energy_wh=self._battery.energy_wh,
            mode=self._ap.mode,
            swaps=self._swaps,
        )

    def _small_step(self, dt_s: float) -> bytes:
        self._ap.step(self._wind(), dt_s)
        self._spend(dt_s)
        now_s = self._ap.t_s + _SOON_S
        sent = bytearray(self._announce())
        wire = self._interpreter.autopilot_wire
        if now_s >= self._next_heartbeat_s:
            self._next_heartbeat_s += _HEARTBEAT_S
            sent += wire.pack(self._telemetry.heartbeat())
            sent += self._interpreter.camera_wire.pack(self._payload.heartbeat())
            if now_s >= self._next_timesync_s:
                self._next_timesync_s += _TIMESYNC_S
                sent += wire.pack(mav.MAVLink_timesync_message(0, round(self._ap.t_s * 1e9)))
        for message_id in self._streams.due(self._ap.t_s):
            message = self._telemetry.build(message_id)
            if message is not None:
                sent += wire.pack(message)
        picture = self._payload.step(self._ap.t_s)
        if picture is not None:
            sent += self._interpreter.camera_wire.pack(picture)
        return bytes(sent)

    def _announce(self) -> bytes:
        """What is told at once, unasked: a new mode, a new home, status texts."""
        ap = self._ap
        if not (ap.mode_changed or ap.home_changed or ap.texts):
            return b""
        wire = self._interpreter.autopilot_wire
        sent = bytearray()
        if ap.mode_changed:
            sent += wire.pack(self._telemetry.heartbeat())
        if ap.home_changed and ap.home_known:
            sent += wire.pack(self._telemetry.gps_global_origin())
            sent += wire.pack(self._telemetry.home_position())
        if self._interpreter.heard:  # nobody has listened before: no texts
            for severity, text in ap.texts:
                sent += wire.pack(statustext(severity, text))
        ap.mode_changed = ap.home_changed = False
        ap.texts.clear()
        return bytes(sent)

    def _spend(self, dt_s: float) -> None:
        """Battery: drawn from by the motors, swapped by the crew."""
        body, spec = self._body, self.spec
        if body.motors_on:
            self._resting_s = 0.0
            share = _IDLE_POWER
            if not body.on_ground:
                climb = body.v_up * (_CLIMB_POWER if body.v_up > 0.0 else _DESCENT_POWER)
                share = 1.0 + climb + _AIRSPEED_POWER * body.air_speed_m_s**2
            self._battery.draw(spec.hover_power_w * max(_IDLE_POWER, share), dt_s)
            return
        self._battery.draw(0.0, dt_s)
        if not body.on_ground or body.crashed or self._battery.full or spec.swap_after_s <= 0.0:
            self._resting_s = 0.0
            return
        self._resting_s += dt_s
        if self._resting_s >= spec.swap_after_s:
            self._battery.swap()
            self._swaps += 1
            self._resting_s = 0.0

    def _wind(self) -> tuple[float, float]:
        return self.world.wind_at(self._ap.t_s)

    def _expose(self, index: int) -> Exposure:
        """Note what the camera sees now: truth for the picture, belief for its announcement."""
        body, now = self._body, self._ap.estimate
        roll, pitch = body.roll_pitch
        shot = Shot(
            body.east,
            body.north,
            body.up,
            self.spec.camera.attitude(roll, pitch, body.yaw),
            self._ap.t_s,
            self.spec.system_id * 1_000_003 + index,
        )
        return Exposure(shot, (now.east, now.north, now.up), now.up - self._ap.home[2])
