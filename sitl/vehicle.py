"""A simulated vehicle: device, autopilot, camera and their MAVLink.

Vehicle time begins at 0 with the construction and is the world's time: the vehicles of one world
are stepped together. Equal seeds, bytes and steps give equal bytes.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import Quaternion
from sitl.body.battery import Battery
from sitl.body.estimator import Estimator
from sitl.body.physics import MAX_STEP_S, Body
from sitl.body.sensors import Altimeter, AttitudeError
from sitl.camera.pinhole import Shot
from sitl.codec import Message
from sitl.copter.aircraft import Device
from sitl.copter.motion import Airframe
from sitl.faults.faults import Faults
from sitl.faults.injection import SIM_PARAMETERS, inject
from sitl.mavlink.camera_component import Exposure, Payload
from sitl.mavlink.commands import Request
from sitl.mavlink.links import Link, Signing
from sitl.mavlink.streams import Streams
from sitl.vehicle_spec import FLAVOURS, VehicleSpec, VehicleTruth
from sitl.world.tags import TAG_OVER_FEET_M, TagPose, check_number
from sitl.world.traffic import reports
from sitl.world.world import World

__all__ = ["SimVehicle", "VehicleSpec", "VehicleTruth"]

_HEARTBEAT_S, _HEARTBEAT = 1.0, mav.MAVLINK_MSG_ID_HEARTBEAT
_TIMESYNC_S = 10.0
_SOON_S = 1e-6
_MAX_LINKS = 256
_HEIGHT_SEED, _ATTITUDE_SEED = 45, 46
# Power over hovering's: per m/s of climb, per m/s of descent, per (m/s)^2 of airspeed
_CLIMB_POWER, _DESCENT_POWER, _AIRSPEED_POWER = 0.08, 0.02, 0.0015
_IDLE_POWER = 0.08  # motors turning on the ground


class SimVehicle:
    """A multicopter with a camera that flies in a `World` and uses MAVLink 2."""

    def __init__(self, spec: VehicleSpec, world: World) -> None:
        self.spec = spec
        self.world = world
        east, north = world.plane.to_plane(spec.home)
        self._seed = (world.spec.seed, spec.system_id)
        rng = np.random.default_rng(list(self._seed))
        self.fail = Faults()
        """The faults of this vehicle."""
        quirks, errs = spec.quirks, spec.gps_sigma_m > 0.0  # exact over ground: exact in all
        tilt_rad, heading_rad = (
            math.radians(sigma_deg) if errs else 0.0
            for sigma_deg in (quirks.tilt_sigma_deg, quirks.heading_sigma_deg)
        )
        self._body = Body(
            east, north, math.radians(spec.home_yaw_deg), math.radians(spec.max_tilt_deg),
            world.ground_m(east, north),
            AttitudeError((*self._seed, _ATTITUDE_SEED), tilt_rad, heading_rad),
        )  # fmt: skip
        self._battery = Battery(spec.battery_wh)
        self._error = Estimator(
            rng, spec.gps_sigma_m, spec.gps_tau_s, seed=self._seed, flow=spec.optical_flow,
            drift=spec.odometry_drift,
        )  # fmt: skip
        if spec.autopilot not in FLAVOURS:
            raise ValueError(f"autopilot {spec.autopilot!r}: there is {', '.join(FLAVOURS)}")
        sigma_m = quirks.height_sigma_m if errs else 0.0
        self._altimeter = Altimeter(world.spec.origin_amsl_m, (*self._seed, _HEIGHT_SEED), sigma_m)
        flavour = FLAVOURS[spec.autopilot]
        airframe = Airframe(
            spec.max_speed_m_s, spec.max_accel_m_s2, spec.ready_after_s, quirks.stick
        )
        device = Device(self._body, self._error, self._battery, airframe, quirks, self._seed)
        self._ap = flavour.aircraft(device)
        self._telemetry = flavour.telemetry(self._ap, world, self._altimeter, self._wind, quirks)
        self._streams = Streams()
        for message_id, interval_s in flavour.commands.default_s.items():
            if self._telemetry.knows(message_id):
                self._streams.set(message_id, interval_s, 0.0)
        prefix = f"{spec.image_url_prefix}{spec.system_id}/"
        self._payload = Payload(spec.camera, world, self._telemetry, prefix, self._expose, quirks)
        commands = flavour.commands(
            self._ap, self._telemetry, self._streams, self._payload, quirks.camera,
            self._intercept,
        )  # fmt: skip
        self._ap.parameters.watch = self._parameter_set
        if spec.optical_flow:
            for name in ("FLOW_TYPE", "EK3_SRC_OPTIONS", "EKF2_OF_CTRL"):
                if name in self._ap.parameters:
                    self._ap.parameters.preset(name, 1.0)
        self._ap.parameters.set_up(spec.parameters)
        self._interpreter = flavour.interpreter(
            spec.system_id, self._ap, commands, self._streams, self._telemetry
        )
        self._next_heartbeat_s = 0.0
        self._next_timesync_s = 0.0
        self._resting_s = 0.0
        self._swaps = 0
        self._signing = Signing()
        self._links: list[Link] = []
        self._main = self.connect()
        if world.spec.tag_m > 0.0:
            check_number(world.spec.tag_dictionary, spec.system_id)
            world.carriers.join(spec.system_id, self._tag_at)

    def _tag_at(self, t_s: float) -> TagPose:
        """Return the marker on its top at a time that differs from its own by a step at most."""
        body, after_s = self._body, t_s - self._ap.t_s
        roll, pitch, yaw = body.turned(after_s)
        return TagPose(
            self.spec.system_id,
            body.east + body.v_east * after_s,
            body.north + body.v_north * after_s,
            body.up + body.v_up * after_s + TAG_OVER_FEET_M,
            Quaternion.from_euler(roll, pitch, yaw),
            (body.v_east, body.v_north, body.v_up),
        )

    @property
    def t_s(self) -> float:
        """Seconds since boot."""
        return self._ap.t_s

    def receive(self, data: bytes) -> bytes:
        """Take bytes from a client, in any pieces; return the immediate replies."""
        self._main.receive(data)
        return self._main.read()

    def step(self, dt_s: float) -> bytes:
        """Let `dt_s` pass, in steps of at most 0.05 s; return what was sent meanwhile."""
        if not (math.isfinite(dt_s) and dt_s >= 0.0):
            raise ValueError(f"time goes forward: {dt_s}")
        count = max(1, math.ceil(dt_s / MAX_STEP_S - 1e-9)) if dt_s > 0.0 else 0
        for _ in range(count):
            self._broadcast(self._small_step(dt_s / count))
            for link in self._links:
                link.step()
        return self._main.read()

    def connect(self, *, trusted: bool = False) -> Link:
        """Return a further client's link, beside that of `receive` and `step`.

        Every link carries the same, replies to other clients too. Call `Link.read` after each
        step and each `Link.receive` of any link. A `trusted` one (USB) accepts unsigned frames.
        Raises `ValueError` above 256 links.
        """
        used = {link.link_id for link in self._links}
        link_id = next((n for n in range(_MAX_LINKS) if n not in used), None)
        if link_id is None:
            raise ValueError(f"a vehicle has at most {_MAX_LINKS} links")
        link = Link(
            link_id, self._seed, self.fail, self._signing, self._handle, trusted=trusted,
            texts_to_stations=self._interpreter.texts_to_stations,
        )  # fmt: skip
        self._links.append(link)
        return link

    def disconnect(self, link: Link) -> None:
        """Forget a client's link; the signatures that it has verified are kept."""
        self._links.remove(link)

    def set_speedup(self, times: float) -> None:
        """Set SIM_SPEEDUP, where there is one."""
        if "SIM_SPEEDUP" in self._ap.parameters:
            self._ap.parameters.preset("SIM_SPEEDUP", times)

    def image(self, url: str) -> bytes | None:
        """Return the JPEG announced under a `file_url`; None if it is unknown or too old."""
        return self._payload.image(url)

    def announce_pictures_at(self, prefix: str) -> None:
        """Set what the addresses of further pictures begin with."""
        self.spec = replace(self.spec, image_url_prefix=prefix)
        self._payload.url_prefix = f"{prefix}{self.spec.system_id}/"

    @property
    def banner(self) -> bytes:
        """Greeting of a TCP client."""
        return self._interpreter.banner

    @property
    def up_m(self) -> float:
        """Height above the ground at the world's origin."""
        return self._body.up

    @property
    def truth(self) -> VehicleTruth:
        """True state."""
        body = self._body
        roll, pitch = body.roll_pitch
        return VehicleTruth(
            t_s=self._ap.t_s,
            position=self.world.plane.to_wgs84(body.east, body.north),
            height_m=body.up - body.ground,
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
            failsafe=self._ap.failsafes.active,
            estimate_error_m=(self._error.east, self._error.north),
        )

    def _handle(self, messages: list[Message]) -> None:
        for message in messages:
            if message.get_msgId() == mav.MAVLINK_MSG_ID_SETUP_SIGNING:
                self._set_up_signing(message)
        self._broadcast(self._interpreter.handle(messages) + self._announce())

    def _broadcast(self, frames: bytes) -> None:
        if frames:
            for link in self._links:
                link.send(frames)

    def _intercept(self, request: Request) -> int | None:
        """Return the answer of a fault to a command, and to the command that injects faults."""
        result = self.fail.rejection(request.command)
        if result is not None or request.command != mav.MAV_CMD_INJECT_FAILURE:
            return result
        enabled = self._ap.parameters["SYS_FAILURE_EN"] == 1.0
        return inject(self.fail, request.integer(1), request.integer(2), enabled)

    def _parameter_set(self, name: str, value: float) -> None:
        if name in SIM_PARAMETERS:
            SIM_PARAMETERS[name](self.fail, value)

    def _set_up_signing(self, m: Message) -> None:
        if m.target_system not in (0, self.spec.system_id):
            return
        if self._ap.armed:
            text = "ERROR: Can't setup signing while armed"
            self._ap.send_text(mav.MAV_SEVERITY_CRITICAL, text)
            return
        self._signing.set_up(bytes(m.secret_key), m.initial_timestamp)

    def _small_step(self, dt_s: float) -> bytes:
        ap, fail = self._ap, self.fail
        fail.step(ap.t_s + dt_s, self._error, self._battery, self._body)
        ap.radio_lost = fail.rc_lost
        body = self._body
        body.ground = self.world.ground_m(body.east, body.north)
        self._altimeter.step(dt_s, armed=ap.armed)
        body.attitude_error.step(dt_s)
        ap.step(self._wind(), dt_s)
        self._spend(dt_s)
        t_s = ap.t_s
        now_s = t_s + _SOON_S
        sent = self._interpreter.step() + self._announce()
        wire = self._interpreter.autopilot_wire
        if now_s >= self._next_heartbeat_s:
            self._next_heartbeat_s += _HEARTBEAT_S
            if self._streams.interval_s(_HEARTBEAT) is None:
                sent += wire.pack(self._telemetry.heartbeat())
            if self.spec.quirks.camera == "component":
                sent += self._interpreter.camera_wire.pack(self._payload.heartbeat())
            spec = self.world.spec
            for report in reports(spec.traffic, self.world.plane, spec.origin_amsl_m, t_s):
                sent += wire.pack(report)
            if now_s >= self._next_timesync_s:
                self._next_timesync_s += _TIMESYNC_S
                sent += wire.pack(mav.MAVLink_timesync_message(0, round(t_s * 1e9)))
        if due := self._streams.due(t_s):
            messages = map(self._telemetry.build, due)
            sent += b"".join([wire.pack(message) for message in messages if message is not None])
        if fail.camera_stalled:
            return sent
        picture = self._payload.step(t_s)
        if picture is not None:
            if self.spec.quirks.camera == "component":
                sent += self._interpreter.camera_wire.pack(picture)
            if self._interpreter.camera_feedback:
                sent += wire.pack(self._payload.feedback)
        return sent

    def _announce(self) -> bytes:
        ap = self._ap
        if not (ap.mode_changed or ap.home_changed or ap.texts):
            return b""
        wire = self._interpreter.autopilot_wire
        sent = bytearray()
        if ap.mode_changed and self._interpreter.sends_mode_at_once:
            sent += wire.pack(self._telemetry.heartbeat())
        if ap.home_changed and ap.home_known:
            sent += wire.pack(self._telemetry.gps_global_origin())
            sent += wire.pack(self._telemetry.home_position())
        if self._interpreter.has_client:  # before that no client listens
            for notice in ap.texts:
                sent += self._interpreter.pack_notice(notice)
        ap.mode_changed = ap.home_changed = False
        ap.texts.clear()
        return bytes(sent)

    def _spend(self, dt_s: float) -> None:
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
            self.fail.swap_battery()
            self._altimeter.start()
            self._swaps += 1
            self._resting_s = 0.0

    def _wind(self) -> tuple[float, float]:
        east, north = self.world.wind_at(self._ap.t_s)
        if self.fail.gust_m_s == (0.0, 0.0):
            return east, north  # as it is: a sum would lose the sign of a zero
        return east + self.fail.gust_m_s[0], north + self.fail.gust_m_s[1]

    def _expose(self, index: int) -> Exposure:
        body, now = self._body, self._ap.estimate
        camera, open_s = self.spec.camera, self.spec.camera.exposure_s
        roll, pitch = body.roll_pitch
        shot = Shot(
            body.east,
            body.north,
            body.up - body.ground,
            camera.attitude(roll, pitch, body.yaw),
            self._ap.t_s,
            self.spec.system_id * 1_000_003 + index,
            (body.v_east * open_s, body.v_north * open_s, body.v_up * open_s),
            camera.attitude(*body.turned(open_s)),
            body.ground,
            self.world.carriers.others(self.spec.system_id, self._ap.t_s),
        )
        return Exposure(
            shot,
            now.place,
            now.up - self._ap.home[2],
            (*body.estimated_roll_pitch, body.heading),
            self.spec.camera.attitude(*body.estimated_roll_pitch, body.heading),
            self.fail.picture,
        )
