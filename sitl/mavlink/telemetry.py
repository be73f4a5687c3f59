"""The autopilot's state as MAVLink messages, a method for each, in the messages' own units."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from sitl import codec
from sitl.body.sensors import Altimeter
from sitl.codec import Message, Packed, int16, int32, uint16
from sitl.copter.aircraft import Aircraft
from sitl.copter.modes import Mode, Phase
from sitl.quirks import Quirks
from sitl.world.world import World

_CLAIMS_ACTIVE_S = 3.0  # after boot the heartbeat reports ACTIVE although the vehicle does not fly
_AUTO = Mode.AUTO
_GUIDED_FLAG_MODES = (Mode.AUTO, Mode.GUIDED, Mode.LOITER, Mode.RTL, Mode.POSHOLD, Mode.BRAKE)

# 3D gyro, accelerometer, compass, absolute pressure; the controllers; motors, AHRS, battery
_SENSORS = 0x0000_000F | 0x0000_FC00 | 0x0220_0000
_GPS = mav.MAV_SYS_STATUS_SENSOR_GPS
_GEOFENCE = mav.MAV_SYS_STATUS_GEOFENCE
_PREARM = mav.MAV_SYS_STATUS_PREARM_CHECK
_PRESENT = _SENSORS | _GPS | _GEOFENCE | _PREARM
_PRESENT_AT_REST = _PRESENT & ~mav.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS

_SMALL = (0.01, 0.01, 0.01, 0.01, 0.0, 0.0)  # variances
# attitude, velocities, relative and absolute position, predictions
_EKF_READY = codec.ekf_status_report(0x33F, *_SMALL)
_EKF_RELATIVE = codec.ekf_status_report(0x12F, *_SMALL)  # where on earth it is not known
_EKF_CONSTANT_POSITION = codec.ekf_status_report(0xA7, *_SMALL)  # no absolute position yet
_TARGET_POSITION_ONLY = 0xFDF8
_TARGET_VELOCITY_ONLY = 0xFDC7
_TARGET_BOTH = 0xFDC0
_CAPABILITIES = (
    mav.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mav.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mav.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mav.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
_VERSION_4_6_0 = (4 << 24) | (6 << 16) | (255)  # FIRMWARE_VERSION_TYPE_OFFICIAL

_KEPT_PLACES = 16
_NAN4 = (math.nan,) * 4
_NO_CELLS = (65535,) * 9
_NO_HASHES = (0,) * 24  # of the firmware, the middleware and the operating system

_LANDED_STATE = {
    Phase.LANDED: mav.MAV_LANDED_STATE_ON_GROUND,
    Phase.SPOOL: mav.MAV_LANDED_STATE_ON_GROUND,
    Phase.CLIMB: mav.MAV_LANDED_STATE_TAKEOFF,
    Phase.DESCEND: mav.MAV_LANDED_STATE_LANDING,
}

IDENTITY = (0x5541, 0x534D)
"""vendor_id and product_id in AUTOPILOT_VERSION: a simulated vehicle, which can hurt no person."""


def _id_of(name: str) -> int:
    """Return the number of a message; CURRENT_MODE is not in the dialect."""
    if name == "current_mode":
        return codec.CURRENT_MODE
    return int(getattr(mav, f"MAVLINK_MSG_ID_{name.upper()}"))


class Telemetry:
    """Builds packed messages from an autopilot."""

    kinds: ClassVar[tuple[str, ...]] = (
        "heartbeat", "sys_status", "system_time", "gps_raw_int", "attitude", "local_position_ned",
        "global_position_int", "mission_current", "gps_global_origin", "vfr_hud",
        "position_target_global_int", "battery_status", "autopilot_version", "wind",
        "ekf_status_report", "home_position", "extended_sys_state", "fence_status",
    )  # fmt: skip
    """Messages that it sends, each by the method of its name."""

    def __init__(
        self,
        autopilot: Aircraft,
        world: World,
        altimeter: Altimeter,
        wind: Callable[[], tuple[float, float]],
        quirks: Quirks,
    ) -> None:
        self._ap = autopilot
        self._world = world
        self.plane = world.plane
        self._altimeter = altimeter
        self._wind = wind
        self._clock_rate = 1.0 + quirks.clock_ppm * 1e-6  # beside time
        self.origin = autopilot.home
        """Origin of LOCAL_POSITION_NED, in the world's plane: the boot position."""
        self._places: dict[tuple[float, float], tuple[int, int]] = {}
        self._builders: dict[int, Callable[[], Packed | None]] = {
            _id_of(name): getattr(self, name) for name in self.kinds
        }
        if not quirks.landed_state:
            del self._builders[mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE]

    @property
    def amsl_m(self) -> float:
        """Height of the world's plane above the sea by the autopilot."""
        return self._altimeter.amsl_m

    @property
    def streamable(self) -> Collection[int]:
        """Messages whose interval can be set."""
        return self._builders.keys()

    def knows(self, message_id: int) -> bool:
        """Return whether this autopilot sends such a message."""
        return message_id in self._builders

    def build(self, message_id: int) -> Packed | None:
        """Return the message, or None while it has no content."""
        return self._builders[message_id]()

    @property
    def boot_ms(self) -> int:
        """Milliseconds since boot, as in `time_boot_ms`."""
        return round(self._ap.t_s * self._clock_rate * 1000.0) & 0xFFFFFFFF

    def place(self, east_m: float, north_m: float, up_m: float) -> tuple[int, int, int]:
        """Return latitude, longitude (1e7 degrees) and AMSL (mm) of a place in the plane."""
        # several messages of one moment have the same place, and a target stays for long
        found = self._places.get((east_m, north_m))
        if found is None:
            if len(self._places) >= _KEPT_PLACES:
                self._places.clear()
            position = self.plane.to_wgs84(east_m, north_m)
            found = int32(position.lat_deg * 1e7), int32(position.lon_deg * 1e7)
            self._places[east_m, north_m] = found
        return found[0], found[1], int32((self.amsl_m + up_m) * 1000.0)

    def terrain_report(self, lat_e7: int, lon_e7: int, *, loaded: bool) -> Message:
        """Return TERRAIN_REPORT of a place; without spacing while the data load."""
        if not loaded:
            return mav.MAVLink_terrain_report_message(lat_e7, lon_e7, 0, 0.0, 0.0, 56, 0)
        east, north = self.plane.to_plane(LatLon(lat_e7 / 1e7, lon_e7 / 1e7))
        ground_m = self._world.ground_m(east, north)
        return mav.MAVLink_terrain_report_message(
            lat_e7,
            lon_e7,
            100,
            self._altimeter.sea_m + ground_m,
            self._ap.estimate.up - ground_m,
            0,
            504,
        )

    def heartbeat(self) -> Packed:
        """HEARTBEAT."""
        ap = self._ap
        base = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= mav.MAV_MODE_FLAG_STABILIZE_ENABLED | mav.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        if ap.mode in _GUIDED_FLAG_MODES:
            base |= mav.MAV_MODE_FLAG_GUIDED_ENABLED
        if ap.armed:
            base |= mav.MAV_MODE_FLAG_SAFETY_ARMED
        status = mav.MAV_STATE_STANDBY
        if ap.body.crashed:
            status = mav.MAV_STATE_EMERGENCY
        elif ap.failsafes.active:
            status = mav.MAV_STATE_CRITICAL
        elif ap.airborne or ap.t_s < _CLAIMS_ACTIVE_S:
            status = mav.MAV_STATE_ACTIVE
        return codec.heartbeat(
            mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_ARDUPILOTMEGA, base, int(ap.mode), status, 3
        )

    def sys_status(self) -> Packed:
        """SYS_STATUS, with the prearm bit."""
        ap = self._ap
        health = _SENSORS
        if not ap.fence.broken:
            health |= _GEOFENCE
        if ap.home_known and not ap.error.lost:
            health |= _GPS
        if ap.prearm_ok:
            health |= _PREARM
        battery = ap.battery
        return codec.sys_status(
            _PRESENT, _PRESENT if ap.armed else _PRESENT_AT_REST, health, 100,
            uint16(battery.voltage_v * 1000.0), self._current_ca,
            self._percents[0], 0, 0, 0, 0, 0, 0,
        )  # fmt: skip

    @property
    def _percents(self) -> tuple[int, int]:
        """Remaining charge in SYS_STATUS and in BATTERY_STATUS."""
        percent = self._ap.battery.remaining_percent
        return percent, percent

    @property
    def _current_ca(self) -> int:
        """Hundredths of an ampere."""
        return int16(self._ap.battery.current_a * 100.0)

    @property
    def _consumed(self) -> tuple[int, int]:
        """Since the pack was full: mAh, hectojoules."""
        battery = self._ap.battery
        return int32(battery.consumed_mah), int32(battery.consumed_wh * 36.0)

    def battery_status(self) -> Packed:
        """BATTERY_STATUS: mAh, hectojoules, percent."""
        battery = self._ap.battery
        return codec.battery_status(
            0, mav.MAV_BATTERY_FUNCTION_ALL, mav.MAV_BATTERY_TYPE_LIPO, 32767,
            uint16(battery.voltage_v * 1000.0), *_NO_CELLS, self._current_ca, *self._consumed,
            self._percents[1], 0, self._ap.failsafes.charge_state,
        )  # fmt: skip

    def system_time(self) -> Packed:
        """SYSTEM_TIME; the date is not known."""
        return codec.system_time(0, self.boot_ms)

    def gps_raw_int(self) -> Packed:
        """GPS_RAW_INT, of the first receiver; no fix until home is known."""
        ap = self._ap
        if not ap.home_known or ap.error.lost:
            kind = mav.GPS_FIX_TYPE_NO_FIX if ap.home_known else mav.GPS_FIX_TYPE_NO_GPS
            return codec.gps_raw_int(0, kind, 0, 0, 0, 65535, 65535, 0, 0, 0, 0, 0, 0)
        now = ap.estimate
        receiver_m = self._altimeter.receiver_m - self._altimeter.datum_m
        lat, lon, amsl = self.place(*self._fix, now.up + receiver_m)
        course = math.degrees(math.atan2(now.v_east, now.v_north)) % 360.0
        return codec.gps_raw_int(
            int(ap.t_s * 1e6), mav.GPS_FIX_TYPE_3D_FIX, lat, lon, amsl, 121, 200,
            uint16(100.0 * math.hypot(now.v_east, now.v_north)), uint16(course * 100.0) % 36000,
            10, amsl, 300, max(300, int(1000.0 * self._altimeter.sigma_m)),
        )  # fmt: skip

    @property
    def _fix(self) -> tuple[float, float]:
        """The first receiver's own position."""
        ap = self._ap
        if ap.error.by_satellites:
            return ap.estimate.east, ap.estimate.north
        return ap.body.east + ap.error.fix[0], ap.body.north + ap.error.fix[1]

    def attitude(self) -> Packed:
        """ATTITUDE."""
        body = self._ap.body
        roll, pitch = body.estimated_roll_pitch
        yaw = math.remainder(body.heading, math.tau)
        return codec.attitude(self.boot_ms, roll, pitch, yaw, 0.0, 0.0, body.yaw_rate)

    def local_position_ned(self) -> Packed | None:
        """LOCAL_POSITION_NED around the boot position."""
        if not self._ap.home_known:
            return None
        now, (east, north, up) = self._ap.estimate, self.origin
        return codec.local_position_ned(
            self.boot_ms, now.north - north, now.east - east, up - now.up,
            now.v_north, now.v_east, -now.v_up,
        )  # fmt: skip

    def global_position_int(self) -> Packed | None:
        """GLOBAL_POSITION_INT; zeros until there is a fix."""
        ap = self._ap
        heading = uint16(math.degrees(ap.body.heading) * 100.0) % 36000
        if not ap.home_known:
            return codec.global_position_int(self.boot_ms, 0, 0, 0, 0, 0, 0, 0, heading)
        now = ap.estimate
        lat, lon, amsl = self.place(*now.place)
        return codec.global_position_int(
            self.boot_ms, lat, lon, amsl, int32((now.up - ap.home[2]) * 1000.0),
            int16(now.v_north * 100.0), int16(now.v_east * 100.0), int16(-now.v_up * 100.0),
            heading,
        )  # fmt: skip

    def mission_current(self) -> Packed:
        """MISSION_CURRENT; the total leaves out home."""
        route = self._ap.route
        total = route.total
        state = int(route.progress) if total else mav.MISSION_STATE_NO_MISSION
        return codec.mission_current(route.current, total, state, int(self._ap.in_mission))

    def fence_status(self) -> Packed | None:
        """FENCE_STATUS, while the fence is on."""
        ap = self._ap
        if not ap.fence.enabled(ap.parameters):
            return None
        fence = ap.fence
        return codec.fence_status(
            int(fence.broken != 0), uint16(fence.count), fence.breach_type,
            round(fence.at_s * 1000.0) & 0xFFFFFFFF,
        )  # fmt: skip

    def gps_global_origin(self) -> Packed | None:
        """GPS_GLOBAL_ORIGIN: the origin of LOCAL_POSITION_NED."""
        if not self._ap.home_known:
            return None
        return codec.gps_global_origin(*self.place(*self.origin))

    def vfr_hud(self) -> Packed:
        """VFR_HUD."""
        body, now = self._ap.body, self._ap.estimate
        return codec.vfr_hud(
            body.air_speed_m_s, math.hypot(now.v_east, now.v_north),
            int16(math.degrees(body.heading)) % 360, 50 if self._ap.airborne else 0,
            self.amsl_m + now.up, now.v_up,
        )  # fmt: skip

    def position_target_global_int(self) -> Packed | None:
        """POSITION_TARGET_GLOBAL_INT: the guided target that was accepted, AMSL."""
        ap = self._ap
        if ap.target is not None:
            lat, lon, _ = self.place(*ap.target)
            return codec.position_target_global_int(
                self.boot_ms, mav.MAV_FRAME_GLOBAL, _TARGET_POSITION_ONLY, lat, lon,
                self.amsl_m + ap.target[2], *([0.0] * 8),
            )  # fmt: skip
        if ap.stream is not None:
            place, (east, north, up) = ap.stream
            lat, lon, amsl_m = 0, 0, 0.0
            if place is not None:
                lat, lon, _ = self.place(*place)
                amsl_m = self.amsl_m + place[2]
            mask = _TARGET_VELOCITY_ONLY if place is None else _TARGET_BOTH
            return codec.position_target_global_int(
                self.boot_ms, mav.MAV_FRAME_GLOBAL, mask, lat, lon, amsl_m,
                north, east, -up, *([0.0] * 5),
            )  # fmt: skip
        return None

    def autopilot_version(self) -> Packed:
        """AUTOPILOT_VERSION of an ArduCopter 4.6, with the simulator's own vendor and product."""
        return codec.autopilot_version(
            _CAPABILITIES, _VERSION_4_6_0, 0, 0, 0, *_NO_HASHES, *IDENTITY, 0
        )

    def wind(self) -> Packed:
        """WIND: the direction it comes from, degrees, and its speed."""
        east, north = self._wind()
        coming_from = math.degrees(math.atan2(-east, -north))
        return codec.wind(coming_from, math.hypot(east, north), 0.0)

    def ekf_status_report(self) -> Packed:
        """EKF_STATUS_REPORT: constant position mode until ready."""
        if not self._ap.position_ok:
            return _EKF_CONSTANT_POSITION
        return _EKF_READY if self._ap.aiding.absolute else _EKF_RELATIVE

    def home_position(self) -> Packed | None:
        """HOME_POSITION, once known; arming moves it."""
        ap = self._ap
        if not ap.home_known:
            return None
        east, north, up = ap.home
        boot_east, boot_north, boot_up = self.origin
        return codec.home_position(
            *self.place(east, north, up), north - boot_north, east - boot_east, boot_up - up,
            *_NAN4, 0.0, 0.0, 0.0, int(ap.t_s * 1e6),
        )  # fmt: skip

    def extended_sys_state(self) -> Packed:
        """EXTENDED_SYS_STATE: on the ground, taking off, in the air, landing."""
        state = _LANDED_STATE.get(self._ap.phase, mav.MAV_LANDED_STATE_IN_AIR)
        return codec.extended_sys_state(mav.MAV_VTOL_STATE_MC, state)
