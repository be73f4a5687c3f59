"""The state of a vehicle before a flight: link, mode, fix, estimator, battery, place."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator, Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav
from shapely.geometry import Point

from missions.mission.energy import energy_model
from missions.mission.flyable import look_s
from missions.mission.layout import Layout
from missions.mission.places import drawn, home_heights_m
from missions.units import PadHeight
from uavmap.base.printable import printable
from uavmap.mavlink.session import Message, Session
from uavmap.mavlink.vehicle_view import EKF_ABSOLUTE, EKF_CONSTANT, VehicleView
from uavmap.runner.preflight.finding import Finding, bad, ok, warn

MEASURE_S: Final = 4.0
"""Time to listen to a link, s."""
REPORTS_WAIT_S: Final = 8.0
"""Maximum time to wait for missing messages, s."""
PINGS: Final = 5
_NS: Final = 1e9
_NO_VOLTAGE_MV: Final = 65_535


class Measurement:
    """The measurements over a session; make one early, as it knows only later messages."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.frames_hz = 0.0
        """Rate of the autopilot's frames, Hz."""
        self.lost_share = 0.0
        """Share of the autopilot's frames whose number is missing, 0 to 1."""
        self.fix: Message | None = None
        """The last GPS_RAW_INT."""
        self.volts: float | None = None
        """Voltage of the battery, from SYS_STATUS."""
        self.version = ""
        """Version of the autopilot's firmware; empty if it was not reported."""
        self.remote_id: Message | None = None
        """The last OPEN_DRONE_ID_ARM_STATUS."""
        self._sent_ns: dict[int, float] = {}
        self._trips_s: list[float] = []
        session.listen(self._on_message)

    @property
    def round_trip_s(self) -> float | None:
        """Median round trip of TIMESYNC, s; None without an answer."""
        trips_s = sorted(self._trips_s)
        return trips_s[len(trips_s) // 2] if trips_s else None

    async def measure(self, seconds: float = MEASURE_S) -> None:
        """Listen for `seconds`, and request messages that do not come.

        It waits a little longer for the messages that findings need. Late telemetry, or an
        estimator that was just switched on, is no fault of the vehicle.
        """
        session, view = self._session, self._session.view
        loop = asyncio.get_running_loop()
        sender = view.system_id, view.autopilot_component
        received, missing = session.losses.counts(sender)
        begin_s = loop.time()
        for _ in range(PINGS):
            # its own time in the answer identifies the question; zero would be no question
            now_s = loop.time()
            asked_ns = round(now_s * _NS) + 1
            self._sent_ns[asked_ns] = now_s
            session.send(mav.MAVLink_timesync_message(0, asked_ns))
            self._ask()
            await asyncio.sleep(seconds / PINGS)
        until_s = loop.time() + max(REPORTS_WAIT_S, 4.0 * session.ack_wait_s)
        while not self._is_complete() and loop.time() < until_s:
            self._ask()
            await session.until(self._is_complete, seconds / PINGS)
        heard_after, missing_after = session.losses.counts(sender)
        received, missing = heard_after - received, missing_after - missing
        self.frames_hz = received / max(loop.time() - begin_s, 1e-6)
        self.lost_share = missing / max(received + missing, 1)

    def _ask(self) -> None:
        """Request messages that do not come, or came before they were valid."""
        if not _fixed(self.fix):
            self._session.request(mav.MAVLINK_MSG_ID_GPS_RAW_INT)
        if not self.version or self._session.view.identity is None:
            self._session.request(mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION)

    def _is_complete(self) -> bool:
        view = self._session.view
        return (
            _fixed(self.fix)
            and bool(view.ekf_flags & EKF_ABSOLUTE)
            and view.position is not None
            and (view.battery_percent is not None or view.energy_consumed_j is not None)
        )

    def _on_message(self, message: Message) -> None:
        name = message.get_type()
        if name == "GPS_RAW_INT":
            self.fix = message
        elif name == "SYS_STATUS" and 0 < message.voltage_battery < _NO_VOLTAGE_MV:
            self.volts = message.voltage_battery / 1000.0
        elif name == "OPEN_DRONE_ID_ARM_STATUS":
            self.remote_id = message
        elif name == "AUTOPILOT_VERSION":
            self.version = _version(message.flight_sw_version)
        elif name == "TIMESYNC" and message.tc1 != 0:
            sent_s = self._sent_ns.pop(message.ts1, None)
            if sent_s is not None:
                self._trips_s.append(asyncio.get_running_loop().time() - sent_s)


def _fixed(fix: Message | None) -> bool:
    return fix is not None and fix.fix_type >= mav.GPS_FIX_TYPE_3D_FIX


def _version(number: int) -> str:
    """Return a version as text: a byte each for major, minor and patch.

    >>> _version(0x040601FF)
    '4.6.1'
    """
    return f"{number >> 24 & 0xFF}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}" if number else ""


MUCH_LOST: Final = 0.05
"""Share of lost frames that affects a flight: commands and pictures are requested again."""
TOO_MUCH_LOST: Final = 0.3
SLOW_TRIP_S: Final = 0.5
FEW_FRAMES_HZ: Final = 5.0
MIN_SATELLITES: Final = 6
HIGH_HDOP: Final = 2.0
"""HDOP from which on a position is some metres off, half a cell."""
FRESH_PERCENT: Final = 90
PAD_M: Final = 5.0
_FIXES: Final = {
    0: "no GPS", 1: "no fix", 2: "a 2D fix", 3: "a 3D fix", 4: "a 3D fix with DGPS",
    5: "an RTK float fix", 6: "an RTK fix", 7: "a static fix", 8: "a PPP fix",
}  # fmt: skip


def state_findings(
    view: VehicleView, measured: Measurement, setting: Layout | None, number: int
) -> Iterator[Finding]:
    """Yield the findings on the vehicle `number` (from 1) that need no parameters."""
    yield _autopilot(view, measured)
    yield from _link(measured)
    yield from _fix(measured)
    yield _estimator(view)
    yield _remote_id(measured)
    yield _charge(view, setting, number)
    if setting is not None:
        yield from _place(view, setting, number)


def _autopilot(view: VehicleView, measured: Measurement) -> Finding:
    version = f" {measured.version}" if measured.version else ""
    simulated = ", the bundled simulator" if view.is_simulator else ""
    armed = ", armed" if view.armed else ""
    found = f"{view.kind.name}{version}{simulated}, in {view.mode_name}{armed}"
    if view.armed and not view.on_ground:
        return warn(
            "autopilot", found, "on the ground, disarmed",
            "it takes part where it is, and nothing is set on it",
        )  # fmt: skip
    if view.armed:
        return warn("autopilot", found, "disarmed", "disarm it")
    return ok("autopilot", found)


def _link(measured: Measurement) -> Iterator[Finding]:
    lost = measured.lost_share
    found = f"{measured.frames_hz:.0f} frames a second, {100.0 * lost:.1f} % lost"
    trip_s = measured.round_trip_s
    if trip_s is not None:
        found += f", {1000.0 * trip_s:.0f} ms there and back"
    if lost > TOO_MUCH_LOST:
        yield bad("link", found, f"at most {100 * MUCH_LOST:g} % lost", "mend the radio link")
    elif lost > MUCH_LOST or (trip_s is not None and trip_s > SLOW_TRIP_S):
        yield warn(
            "link", found, f"at most {100 * MUCH_LOST:g} % lost and {1000 * SLOW_TRIP_S:g} ms",
            "move the antennas, use a higher baud rate, or take other streams off the link",
        )  # fmt: skip
    elif measured.frames_hz < FEW_FRAMES_HZ:
        yield warn(
            "link", found, f"{FEW_FRAMES_HZ:g} frames a second", "is the baud rate high enough?"
        )
    else:
        yield ok("link", found)


def _fix(measured: Measurement) -> Iterator[Finding]:
    fix = measured.fix
    if fix is None:
        yield warn(
            "GPS", "not reported (GPS_RAW_INT)", "a 3D fix", "look at it in a ground station"
        )
        return
    found = _FIXES.get(fix.fix_type, f"fix {fix.fix_type}")
    if fix.satellites_visible != 255:
        found += f", {fix.satellites_visible} satellites"
    if fix.eph != 65535:
        found += f", HDOP {fix.eph / 100.0:.1f}"
    good = f"a 3D fix, {MIN_SATELLITES} satellites, HDOP below {HIGH_HDOP:g}"
    if fix.fix_type < mav.GPS_FIX_TYPE_3D_FIX:
        yield bad("GPS", found, good, "wait under open sky; is the antenna connected?")
    elif fix.satellites_visible < MIN_SATELLITES or (
        fix.eph != 65535 and fix.eph / 100.0 >= HIGH_HDOP
    ):
        yield warn("GPS", found, good, "wait for more satellites")
    else:
        yield ok("GPS", found)


def _estimator(view: VehicleView) -> Finding:
    unknown = view.ekf_flags & EKF_CONSTANT and not view.kind.rests_constant
    if not view.ekf_flags & EKF_ABSOLUTE or unknown:
        return bad(
            "EKF", f"no position yet (flags {view.ekf_flags:#x})", "an absolute position",
            "wait; an ArduPilot takes some 40 s after it was switched on",
        )  # fmt: skip
    if not view.ready_to_arm:
        why = view.recent_texts() or "; its texts of the last seconds give no reason"
        return warn(
            "EKF", f"has a position; the checks before arming fail{why}", "ready to arm",
            "look at its PreArm texts; it is waited for at the take-off",
        )  # fmt: skip
    return ok("EKF", "has a position, ready to arm")


def _remote_id(measured: Measurement) -> Finding:
    status = measured.remote_id
    if status is None:
        return ok("remote ID", "no module reports; where the law asks for one, check it yourself")
    if status.status == mav.MAV_ODID_ARM_STATUS_GOOD_TO_ARM:
        return ok("remote ID", "ready to arm")
    why = printable(str(status.error).split("\0", 1)[0]).strip() or "without a reason"
    return bad(
        "remote ID", f"not ready to arm: {why}", "ready to arm",
        "set the operator's and the aircraft's identification, and wait for a fix",
    )  # fmt: skip


def _charge(view: VehicleView, setting: Layout | None, number: int) -> Finding:
    percent = view.battery_percent
    if percent is None and view.energy_consumed_j is None:
        return bad(
            "battery", "its charge is not reported", "a charge in percent",
            "set up the battery monitor (ArduPilot: BATT_MONITOR, PX4: BAT1_SOURCE)", binding=True,
        )  # fmt: skip
    charge = "" if percent is None else f"{percent} %"
    if setting is None:
        return ok("battery", charge or "reported as energy")
    capacity_wh = setting.mission.battery.capacity_wh
    left_wh = view.remaining_wh(capacity_wh) or 0.0
    needed_wh = nearest_sortie_wh(setting, number)
    found = f"{charge or 'energy'}: {left_wh:.1f} of {capacity_wh:g} Wh"
    if not view.on_ground and view.armed:
        return ok("battery", found)
    if left_wh < needed_wh:
        return bad(
            "battery", found, f"{needed_wh:.1f} Wh, for a look at the nearest point of the box "
            "and the return with the reserve", "put a charged battery in", binding=True,
        )  # fmt: skip
    if percent is not None and percent < FRESH_PERCENT:
        return warn("battery", found, f"{FRESH_PERCENT} %", "put a charged battery in")
    return ok("battery", found)


def nearest_sortie_wh(setting: Layout, number: int) -> float:
    """Return the energy to observe the box's nearest point, return and keep the reserve, Wh."""
    mission, grid = setting.mission, setting.grid
    box, home = drawn(mission.search.box, grid), Point(setting.pad_of(number))
    away_m = float(box.distance(home))
    layer_m = mission.top_altitude_m(number - 1)
    return energy_model(mission).sortie_wh(away_m, away_m, layer_m, look_s(mission))


def _place(view: VehicleView, setting: Layout, number: int) -> Iterator[Finding]:
    if view.position is None:
        yield bad("place", "no position", "a position", "wait for a fix")
        return
    here = setting.grid.fixed(view.position)
    away_m = here.distance_to(setting.pad_of(number))
    found = f"{away_m:.0f} m from its place in the mission file"
    if not setting.fence.contains(here):
        yield bad(
            "place", f"{found}, outside the geofence", "inside of fence.polygon",
            "carry it there, or draw the fence around it",
        )  # fmt: skip
    elif away_m > PAD_M and view.on_ground:
        yield warn(
            "place", found, f"within {PAD_M:g} m",
            "this is allowed: it returns to where it took off; check vehicles.home and start",
        )  # fmt: skip
    else:
        yield ok("place", found)


SIGMAS = 3.0
"""Maximum difference of two receivers, in standard deviations."""


def pad_heights(setting: Layout, pads: Mapping[int, PadHeight]) -> dict[int, Finding]:
    """Compare the height of each home with the mission's, relative to that of the first vehicle.

    `pads` are the reports of receivers of vehicles on the ground, by number. A finding is bad and
    binding if they contradict the mission by more than their errors and the room between layers.
    """
    if len(pads) < 2:
        return {}
    given_m, team = home_heights_m(setting.mission), setting.mission.team
    room_m = team.layer_m - team.separation_m
    first, *others = sorted(pads)
    found = {}
    for number in others:
        reported_m = pads[number].amsl_m - pads[first].amsl_m
        wanted_m = given_m[number - 1] - given_m[first - 1]
        error_m = SIGMAS * math.hypot(pads[first].sigma_m, pads[number].sigma_m)
        text = f"{reported_m:+.1f} m from vehicle {first}'s by the receivers, +-{error_m:.1f} m"
        wanted = f"{wanted_m:+.1f} m by the mission"
        remedy = (
            f"measure it and set vehicles[{number - 1}].home_height_m, or wait for better fixes"
        )
        off_m = abs(reported_m - wanted_m)
        if off_m <= error_m:
            found[number] = ok("home height", f"{text}; {wanted}")
        elif off_m <= room_m:
            found[number] = warn("home height", text, wanted, remedy)
        else:
            found[number] = bad("home height", text, wanted, remedy, binding=True)
    return found
