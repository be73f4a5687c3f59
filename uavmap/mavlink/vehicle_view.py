"""The latest values of a vehicle's messages, in our units; `uavmap.mavlink.view_updates` sets
them."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import GeodesyError
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import GridPoint, LatLon, PadHeight, Quaternion
from uavmap.mavlink.autopilots import ARDUPILOT, AUTOPILOTS, Autopilot
from uavmap.mavlink.continuity import distance_m
from uavmap.mavlink.message_gate import Gate
from uavmap.mavlink.position_history import Attitudes, Place, Whereabouts
from uavmap.mavlink.status_texts import Text, Texts


class GroundBelow:
    """The ground of one vehicle, relative to its home.

    An autopilot uses heights above its home. A mission may fly above the ground
    (`flight.height_above`). Then the height of the ground below is added to every height that is
    sent, and subtracted from every height that is received. It happens here only, for both drivers.
    Heights of satellite navigation above the sea do not matter.

    `home` is set by its message; until then the vehicle is at its home.
    """

    def __init__(self, terrain: Terrain, grid: Grid) -> None:
        self.terrain = terrain
        self.grid = grid
        self._home: LatLon | None = None
        self._home_m = 0.0

    def above_home_m(self, place: LatLon, home: LatLon | None) -> float:
        """Return the height of the ground at a place above home, m; 0 for an invalid place."""
        try:
            point = self.grid.fixed(place)
        except GeodesyError:
            return 0.0
        return self.lift_m(point, home) if all(map(math.isfinite, point)) else 0.0

    def lift_m(self, point: GridPoint, home: LatLon | None) -> float:
        """Return the same for a point of the fixed frame."""
        return 0.0 if home is None else self.terrain.height_m(point) - self._at_home_m(home)

    def climb_m_s(self, point: GridPoint, v_east_m_s: float, v_north_m_s: float) -> float:
        """Return how fast the ground rises below a moving point, m/s."""
        ahead_s = 0.25
        a, b = (
            GridPoint(point.east_m + s * v_east_m_s, point.north_m + s * v_north_m_s)
            for s in (-ahead_s, ahead_s)
        )
        return (self.terrain.height_m(b) - self.terrain.height_m(a)) / (2.0 * ahead_s)

    def _at_home_m(self, home: LatLon) -> float:
        if home != self._home:
            self._home = home
            self._home_m = self.terrain.height_m(self.grid.fixed(home))
        return self._home_m


Message = Any

EKF_RELATIVE: Final = 0x08
EKF_ABSOLUTE: Final = 0x10
EKF_CONSTANT: Final = 0x80
TEXT_HORIZON_S: Final = 5.0
STAMP_SLACK_S: Final = 0.5
LEAP_M: Final = 0.5
"""Minimum jump of a reported place that is no flight, m."""
LEAP_GAP_S: Final = 0.5
"""Maximum time between two positions over which a jump can be distinguished from flight, s."""
HEIGHT_ERROR_M: Final = 3.0
"""Standard deviation of a receiver's height if it reports none, m."""
WORST_ERROR_M: Final = 10.0
"""Maximum standard deviation that is accepted, m: a larger one would excuse any height."""
OFF_GROUND_M: Final = 2.0
"""Height above which an armed vehicle without a landed state counts as airborne, m."""
OFF_GROUND: Final = (
    mav.MAV_LANDED_STATE_TAKEOFF,
    mav.MAV_LANDED_STATE_IN_AIR,
    mav.MAV_LANDED_STATE_LANDING,
)
"""Parameters of a cancelled take-off, from the first of these to the last."""
SIMULATOR_IDENTITY: Final = (0x5541, 0x534D)
"""vendor_id and product_id of the bundled simulator, whose aircraft have no crew."""


@dataclass(slots=True)
class VehicleView:
    """The knowledge of the vehicle from its messages; None if it is not reported yet."""

    system_id: int = 0
    wanted_system: int | None = None
    """Only system that is received; None: the first one."""
    autopilot: int | None = None
    autopilot_component: int = 0
    """Bound with `system_id` by the first heartbeat of an autopilot."""
    camera_component: int = mav.MAV_COMP_ID_CAMERA
    """First component that sent a camera's heartbeat, while it is received."""
    camera_received_s: float = float("-inf")
    gate: Gate = field(default_factory=Gate)
    received_s: float = float("-inf")
    mode: int | None = None
    armed: bool = False
    failsafe: bool = False
    """True if the autopilot flies by itself, in any mode."""
    critical: bool = False
    """True if it reports CRITICAL; with an ArduPilot a failsafe lasts, whatever flies it."""
    position: LatLon | None = None
    """Position: as reported, less the error that was found."""
    reported: LatLon | None = None
    """Reported position."""
    off_deg: tuple[float, float] = (0.0, 0.0)
    """Error of the reported position by its pictures, degrees of latitude and longitude.

    See `uavmap.aircraft.map_navigation`; it is added to targets as well.
    """
    aided_until_s: float = float("-inf")
    """Time until which its reported place may jump because it was sent its place."""
    position_s: float = float("-inf")
    height_m: float = 0.0
    """Height above home, m; with a `ground`, above the ground below."""
    ground: GroundBelow | None = None
    """Ground below a mission, if it is not flat."""
    home_amsl_m: float = 0.0
    """Height above the sea of the origin of heights, m.

    It is home at take-off if commands are above the sea (a PX4 corrects its home for minutes, by
    metres), else home as reported.
    """
    velocity_ned_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    whereabouts: Whereabouts = field(default_factory=Whereabouts)
    attitudes: Attitudes = field(default_factory=Attitudes)
    home: LatLon | None = None
    ground_home: LatLon | None = None
    """Home for `home_amsl_m`: the same, but for one that is moved in the air."""
    keeps_home: bool = False
    """True if its take-off is to a height above home as it is.

    A PX4 moves its home before it reports that it has left the ground.
    """
    landed_state: int = 0
    prearm_ok: bool = False
    ekf_flags: int = 0
    gps_fix: int | None = None
    """GPS_FIX_TYPE; None if it was not requested."""
    satellites: int | None = None
    """Number of satellites in use; None if it is not reported."""
    hdop: float | None = None
    """Horizontal dilution of precision; None if it is not reported."""
    volts: float | None = None
    """Voltage of the battery; None if it is not reported."""
    height_error_m: float = HEIGHT_ERROR_M
    """Standard deviation of the receiver's height, as it reports it, m."""
    battery_s: float = float("-inf")
    """Time of the battery's last reported charge, on the loop's clock, s."""
    battery_percent: int | None = None
    battery_percent_from: str = ""
    """Kind of message that held the percentage."""
    battery_status_s: float = float("-inf")
    """Time when BATTERY_STATUS last held a percentage, on the loop's clock, s."""
    battery_low: str = ""
    """Charge state that forbids a mission, as text; empty for a good one."""
    battery_id: int | None = None
    """Id of the vehicle's main battery: the lowest that was received."""
    energy_consumed_j: float | None = None
    identity: tuple[int, int] | None = None
    """vendor_id and product_id."""
    uid: str = ""
    """Hardware number, hexadecimal; empty if it has none or did not report it."""
    texts: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=20))
    text_count: int = 0
    landed_state_s: float = float("-inf")
    """Time of the last landed state, on the loop's clock, s."""
    rose: bool = False
    """True if it was above `OFF_GROUND_M` since it was armed."""
    on_text: Callable[[Text], None] = lambda text: None
    """Takes every text of the vehicle once it is complete."""
    chunks: Texts = field(default_factory=Texts)
    """Texts that are not yet complete."""

    def add_text(self, text: Text, now_s: float) -> None:
        """Keep a text of the vehicle, and pass it on."""
        self.texts.append((now_s, text.words))
        self.text_count += 1
        self.on_text(text)

    def corrected(self, reported: LatLon) -> LatLon:
        """Return the true place of a reported one."""
        if self.off_deg == (0.0, 0.0):
            return reported
        return LatLon(reported.lat_deg - self.off_deg[0], reported.lon_deg - self.off_deg[1])

    def as_reported(self, place: LatLon) -> LatLon:
        """Return a place as the vehicle would report it, with its error.

        >>> view = VehicleView()
        >>> view.off_deg = (0.5, 0.25)
        >>> view.as_reported(LatLon(47.0, 8.0)), view.corrected(view.as_reported(LatLon(47.0, 8.0)))
        (LatLon(lat_deg=47.5, lon_deg=8.25), LatLon(lat_deg=47.0, lon_deg=8.0))
        """
        if self.off_deg == (0.0, 0.0):
            return place
        return LatLon(place.lat_deg + self.off_deg[0], place.lon_deg + self.off_deg[1])

    def follow_leap(self, reported: LatLon, boot_s: float, now_s: float) -> None:
        """Correct the error by the jump of the reported place after the vehicle was sent it."""
        before = self.whereabouts.at(boot_s)
        if now_s > self.aided_until_s or before is None or before.gap_s > LEAP_GAP_S:
            return
        if distance_m(reported, before.position) > LEAP_M:
            self.off_deg = (
                self.off_deg[0] + reported.lat_deg - before.position.lat_deg,
                self.off_deg[1] + reported.lon_deg - before.position.lon_deg,
            )

    @property
    def by_satellites(self) -> bool:
        """True if its filter has a position on Earth, as far as it has reported that."""
        return not self.ekf_flags or bool(self.ekf_flags & EKF_ABSOLUTE)

    @property
    def has_no_fix(self) -> bool:
        """True if its receiver reports no fix: its filter may hold out for a while."""
        return self.gps_fix is not None and self.gps_fix < mav.GPS_FIX_TYPE_3D_FIX

    @property
    def by_dead_reckoning(self) -> bool:
        """True if its filter continues without satellites: by optical flow, or by a place sent."""
        known = self.ekf_flags & EKF_RELATIVE and not self.ekf_flags & EKF_CONSTANT
        return bool(known) and not self.by_satellites

    @property
    def boot_offset_s(self) -> float | None:
        """Loop time minus the vehicle's own time since boot, s."""
        return self.gate.clock.offset_s

    def age_s(self, now_s: float) -> float:
        """Return the age of the latest position at a time of the loop's clock, s.

        It is by the vehicle's own clock: a busy computer and a slow link deliver seconds at once.
        """
        clock = self.gate.clock
        valid_s = self.position_s
        if clock.boot_s is not None and clock.offset_s is not None:
            valid_s = min(valid_s, clock.boot_s + clock.offset_s)
        return max(now_s - valid_s, 0.0)

    def silent_s(self, now_s: float) -> float:
        """Return the time since which a heartbeat or a position is missing, s.

        An autopilot that restarted has lost its streams. Late messages count from when they were
        sent.
        """
        known_s = now_s - min(self.received_s, self.position_s)
        return max(known_s, self.age_s(now_s)) if self.gate.clock.late else known_s

    def captured_s(self, boot_ms: int, now_s: float, since_s: float = float("-inf")) -> float:
        """Return when, on the loop's clock, a camera took an announced picture, s.

        It is not later than now, nor much before `since_s`, the order: a camera's clock may be
        wrong.
        """
        offset_s = (self.boot_offset_s or 0.0) + self.gate.camera_clock.lead_s
        return min(max(boot_ms / 1000.0 + offset_s, since_s - STAMP_SLACK_S), now_s)

    def place_at(self, loop_s: float) -> Place | None:
        """Return the reported place at a time of the loop's clock; None without one."""
        return self.whereabouts.at(loop_s - (self.boot_offset_s or 0.0))

    def attitude_at(self, loop_s: float) -> Quaternion | None:
        """Return the reported attitude at a time of the loop's clock; None without one."""
        return self.attitudes.at(loop_s - (self.boot_offset_s or 0.0))

    @property
    def kind(self) -> Autopilot:
        """Kind of autopilot; `connect` refuses unknown ones."""
        return AUTOPILOTS.get(self.autopilot or 0, ARDUPILOT)

    @property
    def ready_to_arm(self) -> bool:
        """True if it can arm; the prearm bit alone turns true before the position is usable."""
        unknown = self.ekf_flags & EKF_CONSTANT and not self.kind.rests_constant
        return self.prearm_ok and bool(self.ekf_flags & EKF_ABSOLUTE) and not unknown

    @property
    def since_boot_s(self) -> float | None:
        """Autopilot's own time since its start, s; None while it is not reported."""
        if self.boot_offset_s is None:
            return None
        return asyncio.get_running_loop().time() - self.boot_offset_s

    @property
    def on_ground(self) -> bool:
        """True if it is landed and disarmed."""
        return self.landed_state == mav.MAV_LANDED_STATE_ON_GROUND and not self.armed

    @property
    def off_ground(self) -> bool:
        """True if it is armed, and reported off the ground; without a landed state, once it
        rose."""
        unsaid = self.landed_state == mav.MAV_LANDED_STATE_UNDEFINED
        return self.armed and (self.rose if unsaid else self.landed_state in OFF_GROUND)

    @property
    def home_is_kept(self) -> bool:
        """True if heights stay above home as it was, wherever the vehicle moves it."""
        return self.kind.amsl and (self.off_ground or (self.armed and self.keeps_home))

    @property
    def pad_height(self) -> PadHeight:
        """Height of its home above the sea, as its receiver reports it."""
        return PadHeight(self.home_amsl_m, self.height_error_m)

    def height_of(self, message: Message) -> float:
        """Return the height in a message, m above `home_amsl_m`, or above the `ground` at its
        place."""
        ground_m = self.ground_m(LatLon(message.lat / 1e7, message.lon / 1e7))
        if self.kind.amsl and message.alt:
            return float(message.alt / 1000.0 - self.home_amsl_m) - ground_m
        return float(message.relative_alt / 1000.0) - ground_m

    def ground_m(self, place: LatLon) -> float:
        """Return the height of the ground there above home, m; 0 if it is taken as flat."""
        return 0.0 if self.ground is None else self.ground.above_home_m(place, self.ground_home)

    @property
    def is_simulator(self) -> bool:
        """True if this is an aircraft of the bundled simulator, over any link."""
        return self.identity == SIMULATOR_IDENTITY

    @property
    def ground_speed_m_s(self) -> float:
        """Horizontal speed, m/s."""
        north, east, _ = self.velocity_ned_m_s
        return float((north**2 + east**2) ** 0.5)

    @property
    def mode_name(self) -> str:
        """Mode by the autopilot's name."""
        if self.mode is None:
            return "unknown"
        names = self.kind.mode_names
        if self.failsafe:
            names = {**names, **self.kind.failsafe_names}
        name = names.get(self.mode, f"mode {self.mode}")
        if not self.failsafe:
            return name
        # no failsafe selects the mode of a stream: it has begun, and has not yet changed the mode
        return f"{name} {'with' if self.mode == self.kind.stream_mode else 'by'} a failsafe"

    def remaining_wh(self, capacity_wh: float) -> float | None:
        """Return the rest of the battery, the lower of two reports, Wh; None if unknown."""
        found = []
        if self.battery_percent is not None and self.battery_percent >= 0:
            found.append(capacity_wh * min(self.battery_percent + 1, 100) / 100.0)
        if self.energy_consumed_j is not None:
            found.append(max(capacity_wh - self.energy_consumed_j / 3600.0, 0.0))
        return min(found) if found else None

    @property
    def grounded_by(self) -> str:
        """Text on a state of its autopilot that forbids a mission, else empty.

        The state CRITICAL alone does not: it also means a lost radio, and no fresh battery ends it.
        """
        low = self.battery_low
        return low and f"its autopilot reports its battery as {low}"

    def texts_since(self, since_s: float) -> list[str]:
        """Return the vehicle's texts since a time of the loop's clock, oldest first."""
        return [text for at_s, text in self.texts if at_s >= since_s]

    def recent_texts(self, now_s: float | None = None, since_s: float = float("inf")) -> str:
        """Return the vehicle's texts of the last seconds, for an error message.

        The seconds are before now (the loop's), or since `since_s`, the command, if that is longer
        ago.
        """
        if now_s is None:
            now_s = asyncio.get_running_loop().time()
        texts = self.texts_since(min(now_s - TEXT_HORIZON_S, since_s))
        return " (vehicle: " + "; ".join(dict.fromkeys(texts)) + ")" if texts else ""
