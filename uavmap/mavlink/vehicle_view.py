"""The latest of what a vehicle has said, in our units; `uavmap.mavlink.view_updates` keeps it
so.
"""

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

    An autopilot is told, and tells, heights above its home. Where a mission flies above the ground
    (`flight.height_above`), the height of the ground below is added to every height that is sent
    and taken from every height that is heard: here and nowhere else, for both drivers. What
    satellite navigation says of heights above the sea does not matter.

    `home` is taken when it is told; until then the vehicle stands on its home.
    """

    def __init__(self, terrain: Terrain, grid: Grid) -> None:
        self.terrain = terrain
        self.grid = grid
        self._home: LatLon | None = None
        self._home_m = 0.0

    def above_home_m(self, place: LatLon, home: LatLon | None) -> float:
        """How much higher the ground at a place is than at home; 0 for what is no place."""
        try:
            point = self.grid.fixed(place)
        except GeodesyError:
            return 0.0
        return self.lift_m(point, home) if all(map(math.isfinite, point)) else 0.0

    def lift_m(self, point: GridPoint, home: LatLon | None) -> float:
        """The same for a point of the fixed frame."""
        return 0.0 if home is None else self.terrain.height_m(point) - self._at_home_m(home)

    def climb_m_s(self, point: GridPoint, v_east_m_s: float, v_north_m_s: float) -> float:
        """How fast the ground rises below what moves over it."""
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
"""Least leap of a reported place that is none of its flight, m."""
LEAP_GAP_S: Final = 0.5
"""Longest time between two positions over which a leap can be known from flight, s."""
HEIGHT_ERROR_M: Final = 3.0
"""Standard deviation of a receiver's height where it states none, m."""
WORST_ERROR_M: Final = 10.0
"""Greatest standard deviation that is believed: a greater one would excuse any height, m."""
OFF_GROUND_M: Final = 2.0
"""Height above which an armed vehicle without a landed state counts as airborne, m."""
OFF_GROUND: Final = (
    mav.MAV_LANDED_STATE_TAKEOFF,
    mav.MAV_LANDED_STATE_IN_AIR,
    mav.MAV_LANDED_STATE_LANDING,
)
"""A take-off that is called off goes from the first of these to the last."""
SIMULATOR_IDENTITY: Final = (0x5541, 0x534D)
"""vendor_id and product_id of the bundled simulator, whose aircraft have no crew."""


@dataclass(slots=True)
class VehicleView:
    """What is known of the vehicle from its messages; None where it is not reported yet."""

    system_id: int = 0
    wanted_system: int | None = None
    """The only system that is listened to; None: the first that is heard."""
    autopilot: int | None = None
    autopilot_component: int = 0
    """Bound with `system_id` by the first heartbeat of an autopilot."""
    camera_component: int = mav.MAV_COMP_ID_CAMERA
    """The first that sent a camera's heartbeat, while it is heard."""
    camera_heard_s: float = float("-inf")
    gate: Gate = field(default_factory=Gate)
    heard_s: float = float("-inf")
    mode: int | None = None
    armed: bool = False
    failsafe: bool = False
    """The autopilot flies by itself, whatever the mode."""
    critical: bool = False
    """Its reported state; with an ArduPilot a failsafe lasts, whatever flies it."""
    position: LatLon | None = None
    """Where it is: as reported, less the error that was found."""
    told: LatLon | None = None
    """Where it reports to be."""
    off_deg: tuple[float, float] = (0.0, 0.0)
    """Error of the position that its autopilot reports, degrees of latitude and longitude, by its
    pictures (`uavmap.aircraft.map_navigation`); added to targets, too."""
    aided_until_s: float = float("-inf")
    """Until when its reported place may leap because it was sent its place."""
    position_s: float = float("-inf")
    height_m: float = 0.0
    """Above home; where there is a `ground`, above the ground below."""
    ground: GroundBelow | None = None
    """What a mission flies above, if that is not flat."""
    home_amsl_m: float = 0.0
    """Height above the sea that heights are above: home at take-off where commands are above the
    sea (a PX4 corrects its home for minutes, by metres), else home as reported."""
    velocity_ned_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    whereabouts: Whereabouts = field(default_factory=Whereabouts)
    attitudes: Attitudes = field(default_factory=Attitudes)
    home: LatLon | None = None
    ground_home: LatLon | None = None
    """The home that `home_amsl_m` is of: the same, but for one that is moved in the air."""
    keeps_home: bool = False
    """Whether its take-off is to a height above home as it is: a PX4 moves its home before it
    reports that it has left the ground."""
    landed_state: int = 0
    prearm_ok: bool = False
    ekf_flags: int = 0
    gps_fix: int | None = None
    """GPS_FIX_TYPE; None where it was not asked for."""
    satellites: int | None = None
    """Number of satellites in use; None where it is not reported."""
    hdop: float | None = None
    """Horizontal dilution of precision; None where it is not reported."""
    volts: float | None = None
    """Voltage of the battery; None where it is not reported."""
    height_error_m: float = HEIGHT_ERROR_M
    """Standard deviation of the receiver's height, as it states it."""
    battery_s: float = float("-inf")
    """When the battery's charge was last reported, on the loop's clock."""
    battery_percent: int | None = None
    battery_percent_from: str = ""
    """The kind of message that held the percentage."""
    battery_status_s: float = float("-inf")
    """When BATTERY_STATUS held a percentage last, on the loop's clock, s."""
    battery_low: str = ""
    """The charge state with which no mission is flown, in words; empty for a good one."""
    battery_id: int | None = None
    """Of the battery that the vehicle flies on: the lowest that was heard."""
    energy_consumed_j: float | None = None
    identity: tuple[int, int] | None = None
    """vendor_id and product_id."""
    uid: str = ""
    """The hardware's own number, hexadecimal; empty where it has none or did not report it."""
    texts: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=20))
    texts_heard: int = 0
    landed_state_s: float = float("-inf")
    """When the landed state was last heard, on the loop's clock."""
    rose: bool = False
    """Whether it was above `OFF_GROUND_M` since it was armed."""
    hear: Callable[[Text], None] = lambda text: None
    """Takes every text of the vehicle as it is complete."""
    chunks: Texts = field(default_factory=Texts)
    """Texts that are not yet complete."""

    def hear_text(self, text: Text, now_s: float) -> None:
        """Keep a text of the vehicle, and pass it on."""
        self.texts.append((now_s, text.words))
        self.texts_heard += 1
        self.hear(text)

    def corrected(self, told: LatLon) -> LatLon:
        """The true place of one that the vehicle reports."""
        if self.off_deg == (0.0, 0.0):
            return told
        return LatLon(told.lat_deg - self.off_deg[0], told.lon_deg - self.off_deg[1])

    def as_told(self, place: LatLon) -> LatLon:
        """How a place is told to the vehicle, which believes to be elsewhere than it is.

        >>> view = VehicleView()
        >>> view.off_deg = (0.5, 0.25)
        >>> view.as_told(LatLon(47.0, 8.0)), view.corrected(view.as_told(LatLon(47.0, 8.0)))
        (LatLon(lat_deg=47.5, lon_deg=8.25), LatLon(lat_deg=47.0, lon_deg=8.0))
        """
        if self.off_deg == (0.0, 0.0):
            return place
        return LatLon(place.lat_deg + self.off_deg[0], place.lon_deg + self.off_deg[1])

    def follow_leap(self, told: LatLon, boot_s: float, now_s: float) -> None:
        """Take off the error what the reported place leaps by after the vehicle was sent it."""
        before = self.whereabouts.at(boot_s)
        if now_s > self.aided_until_s or before is None or before.gap_s > LEAP_GAP_S:
            return
        if distance_m(told, before.position) > LEAP_M:
            self.off_deg = (
                self.off_deg[0] + told.lat_deg - before.position.lat_deg,
                self.off_deg[1] + told.lon_deg - before.position.lon_deg,
            )

    @property
    def by_satellites(self) -> bool:
        """Whether its filter has a position on Earth, as far as it has reported that."""
        return not self.ekf_flags or bool(self.ekf_flags & EKF_ABSOLUTE)

    @property
    def has_no_fix(self) -> bool:
        """Whether its receiver reports no fix: its filter may hold out for a while."""
        return self.gps_fix is not None and self.gps_fix < mav.GPS_FIX_TYPE_3D_FIX

    @property
    def by_dead_reckoning(self) -> bool:
        """Whether its filter goes on without satellites: by optical flow, or by a place sent."""
        known = self.ekf_flags & EKF_RELATIVE and not self.ekf_flags & EKF_CONSTANT
        return bool(known) and not self.by_satellites

    @property
    def boot_offset_s(self) -> float | None:
        """Loop time minus the vehicle's own time since boot."""
        return self.gate.clock.offset_s

    def age_s(self, now_s: float) -> float:
        """Age of the latest position at a time of the loop's clock, s, by the vehicle's own clock:
        a busy computer and a slow link hand over seconds at once."""
        clock = self.gate.clock
        valid_s = self.position_s
        if clock.boot_s is not None and clock.offset_s is not None:
            valid_s = min(valid_s, clock.boot_s + clock.offset_s)
        return max(now_s - valid_s, 0.0)

    def silent_s(self, now_s: float) -> float:
        """Time since which a heartbeat or a position is missing, s: an autopilot that restarted has
        forgotten its streams. What a link hands over late is of when it was sent."""
        known_s = now_s - min(self.heard_s, self.position_s)
        return max(known_s, self.age_s(now_s)) if self.gate.clock.late else known_s

    def captured_s(self, boot_ms: int, now_s: float, since_s: float = float("-inf")) -> float:
        """When, on the loop's clock, a camera took an announced picture: not later than now, nor
        much before `since_s`, the order, for a camera's clock may be wrong."""
        offset_s = (self.boot_offset_s or 0.0) + self.gate.camera_clock.lead_s
        return min(max(boot_ms / 1000.0 + offset_s, since_s - STAMP_SLACK_S), now_s)

    def place_at(self, loop_s: float) -> Place | None:
        """The reported place at a time of the loop's clock; None without one."""
        return self.whereabouts.at(loop_s - (self.boot_offset_s or 0.0))

    def attitude_at(self, loop_s: float) -> Quaternion | None:
        """The reported attitude at a time of the loop's clock; None without one."""
        return self.attitudes.at(loop_s - (self.boot_offset_s or 0.0))

    @property
    def kind(self) -> Autopilot:
        """How it is flown; `connect` refuses those that are not known."""
        return AUTOPILOTS.get(self.autopilot or 0, ARDUPILOT)

    @property
    def ready_to_arm(self) -> bool:
        """The prearm bit alone turns true before the position is usable."""
        unknown = self.ekf_flags & EKF_CONSTANT and not self.kind.rests_constant
        return self.prearm_ok and bool(self.ekf_flags & EKF_ABSOLUTE) and not unknown

    @property
    def since_boot_s(self) -> float | None:
        """The autopilot's own time since it was started, None while it is not reported."""
        if self.boot_offset_s is None:
            return None
        return asyncio.get_running_loop().time() - self.boot_offset_s

    @property
    def on_ground(self) -> bool:
        """Landed and disarmed."""
        return self.landed_state == mav.MAV_LANDED_STATE_ON_GROUND and not self.armed

    @property
    def off_ground(self) -> bool:
        """Armed, and reported off the ground; without a landed state, once it rose."""
        unsaid = self.landed_state == mav.MAV_LANDED_STATE_UNDEFINED
        return self.armed and (self.rose if unsaid else self.landed_state in OFF_GROUND)

    @property
    def home_is_kept(self) -> bool:
        """Whether heights stay above home as it was, wherever the vehicle moves it."""
        return self.kind.amsl and (self.off_ground or (self.armed and self.keeps_home))

    @property
    def pad_height(self) -> PadHeight:
        """The height of its home above the sea, as its receiver reports it."""
        return PadHeight(self.home_amsl_m, self.height_error_m)

    def height_of(self, message: Message) -> float:
        """The height in a message, m above `home_amsl_m`, or above the `ground` at its place."""
        ground_m = self.ground_m(LatLon(message.lat / 1e7, message.lon / 1e7))
        if self.kind.amsl and message.alt:
            return float(message.alt / 1000.0 - self.home_amsl_m) - ground_m
        return float(message.relative_alt / 1000.0) - ground_m

    def ground_m(self, place: LatLon) -> float:
        """How much higher the ground is there than at home; 0 where it is taken to be flat."""
        return 0.0 if self.ground is None else self.ground.above_home_m(place, self.ground_home)

    @property
    def is_simulator(self) -> bool:
        """Whether this is an aircraft of the bundled simulator, over whatever link."""
        return self.identity == SIMULATOR_IDENTITY

    @property
    def ground_speed_m_s(self) -> float:
        """Horizontal speed."""
        north, east, _ = self.velocity_ned_m_s
        return float((north**2 + east**2) ** 0.5)

    @property
    def mode_name(self) -> str:
        """The mode in the autopilot's words."""
        if self.mode is None:
            return "unknown"
        names = self.kind.mode_names
        if self.failsafe:
            names = {**names, **self.kind.failsafe_names}
        name = names.get(self.mode, f"mode {self.mode}")
        if not self.failsafe:
            return name
        # no failsafe selects the mode of a stream: one has begun, and has not yet changed the mode
        return f"{name} {'with' if self.mode == self.kind.stream_mode else 'by'} a failsafe"

    def remaining_wh(self, capacity_wh: float) -> float | None:
        """What is left in the battery, the lower of what two messages report; None if unknown."""
        found = []
        if self.battery_percent is not None and self.battery_percent >= 0:
            found.append(capacity_wh * min(self.battery_percent + 1, 100) / 100.0)
        if self.energy_consumed_j is not None:
            found.append(max(capacity_wh - self.energy_consumed_j / 3600.0, 0.0))
        return min(found) if found else None

    @property
    def grounded_by(self) -> str:
        """What its autopilot reports that forbids a mission, in words, else empty. The state
        CRITICAL alone does not: a lost radio has it, too, and no fresh battery ends it."""
        low = self.battery_low
        return low and f"its autopilot reports its battery as {low}"

    def words_since(self, since_s: float) -> list[str]:
        """The vehicle's texts since a time of the loop's clock, oldest first."""
        return [text for at_s, text in self.texts if at_s >= since_s]

    def recent_texts(self, now_s: float | None = None, since_s: float = float("inf")) -> str:
        """The vehicle's texts of the seconds before now (the loop's), or since `since_s`, when it
        was asked, if that is longer ago; for an error message."""
        if now_s is None:
            now_s = asyncio.get_running_loop().time()
        texts = self.words_since(min(now_s - TEXT_HORIZON_S, since_s))
        return " (vehicle: " + "; ".join(dict.fromkeys(texts)) + ")" if texts else ""
