"""What a vehicle says of itself before a flight: link, mode, fix, estimator, battery, place."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav
from shapely.geometry import Point

from missions.flight.setting import Setting
from missions.mission.flyable import look_s
from missions.mission.places import drawn, homes
from missions.mission.views import energy_model
from missions.units import GridPoint
from uavmap.mavlink.vehicle_view import EKF_ABSOLUTE, EKF_CONSTANT, VehicleView
from uavmap.runner.preflight.finding import Finding, bad, ok, warn
from uavmap.runner.preflight.measurement import Measured

MUCH_LOST: Final = 0.05
"""A link that loses more is felt: commands are repeated, pictures asked for again."""
TOO_MUCH_LOST: Final = 0.3
SLOW_TRIP_S: Final = 0.5
FEW_FRAMES_HZ: Final = 5.0
LEAST_SATELLITES: Final = 6
HIGH_HDOP: Final = 2.0
"""From here on a position is some metres off, half a cell."""
FRESH_PERCENT: Final = 90
PAD_M: Final = 5.0
_FIXES: Final = {
    0: "no GPS", 1: "no fix", 2: "a 2D fix", 3: "a 3D fix", 4: "a 3D fix with DGPS",
    5: "an RTK float fix", 6: "an RTK fix", 7: "a static fix", 8: "a PPP fix",
}  # fmt: skip


def state_findings(
    view: VehicleView, measured: Measured, setting: Setting | None, number: int
) -> Iterator[Finding]:
    """All that can be told without parameters, of the vehicle `number` (from 1)."""
    yield _autopilot(view, measured)
    yield from _link(measured)
    yield from _fix(measured)
    yield _estimator(view)
    yield _charge(view, setting, number)
    if setting is not None:
        yield from _place(view, setting, number)


def _autopilot(view: VehicleView, measured: Measured) -> Finding:
    version = f" {measured.version}" if measured.version else ""
    simulated = ", the bundled simulator" if view.is_simulator else ""
    armed = ", armed" if view.armed else ""
    found = f"{view.kind.name}{version}{simulated}, in {view.mode_name}{armed}"
    if view.armed and not view.on_ground:
        return warn(
            "autopilot", found, "on the ground, disarmed",
            "it is taken up where it is, and nothing is set on it",
        )  # fmt: skip
    if view.armed:
        return warn("autopilot", found, "disarmed", "disarm it")
    return ok("autopilot", found)


def _link(measured: Measured) -> Iterator[Finding]:
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


def _fix(measured: Measured) -> Iterator[Finding]:
    fix = measured.fix
    if fix is None:
        yield warn("GPS", "not told (GPS_RAW_INT)", "a 3D fix", "look at it in a ground station")
        return
    found = _FIXES.get(fix.fix_type, f"fix {fix.fix_type}")
    if fix.satellites_visible != 255:
        found += f", {fix.satellites_visible} satellites"
    if fix.eph != 65535:
        found += f", HDOP {fix.eph / 100.0:.1f}"
    good = f"a 3D fix, {LEAST_SATELLITES} satellites, HDOP below {HIGH_HDOP:g}"
    if fix.fix_type < mav.GPS_FIX_TYPE_3D_FIX:
        yield bad("GPS", found, good, "wait under open sky; is the antenna connected?")
    elif fix.satellites_visible < LEAST_SATELLITES or (
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
        why = view.recent_texts() or "; its texts of the last seconds do not say why"
        return warn(
            "EKF", f"has a position; the checks before arming fail{why}", "ready to arm",
            "look at its PreArm texts; it is waited for at the take-off",
        )  # fmt: skip
    return ok("EKF", "has a position, ready to arm")


def _charge(view: VehicleView, setting: Setting | None, number: int) -> Finding:
    percent = view.battery_percent
    if percent is None and view.energy_consumed_j is None:
        return bad(
            "battery", "its charge is not told", "a charge in percent",
            "set up the battery monitor (ArduPilot: BATT_MONITOR, PX4: BAT1_SOURCE)", binding=True,
        )  # fmt: skip
    told = "" if percent is None else f"{percent} %"
    if setting is None:
        return ok("battery", told or "told as energy")
    capacity_wh = setting.mission.battery.capacity_wh
    left_wh = view.remaining_wh(capacity_wh) or 0.0
    needed_wh = nearest_sortie_wh(setting, number)
    found = f"{told or 'energy'}: {left_wh:.1f} of {capacity_wh:g} Wh"
    if not view.on_ground and view.armed:
        return ok("battery", found)
    if left_wh < needed_wh:
        return bad(
            "battery", found, f"{needed_wh:.1f} Wh, for a look at the nearest point of the box "
            "and the way home with the reserve", "put a charged battery in", binding=True,
        )  # fmt: skip
    if percent is not None and percent < FRESH_PERCENT:
        return warn("battery", found, f"{FRESH_PERCENT} %", "put a charged battery in")
    return ok("battery", found)


def nearest_sortie_wh(setting: Setting, number: int) -> float:
    """What a look at the point of the box that is nearest to a vehicle's home takes in all, in Wh:
    climb, way there and back, landing, reserve."""
    mission, grid = setting.mission, setting.grid
    box, home = drawn(mission.search.box, grid), Point(_pad(setting, number))
    away_m = float(box.distance(home))
    layer_m = mission.top_altitude_m(number - 1)
    return energy_model(mission).sortie_wh(away_m, away_m, layer_m, look_s(mission))


def _pad(setting: Setting, number: int) -> GridPoint:
    """Where a vehicle stands by the mission file."""
    return setting.grid.fixed(homes(setting.mission)[number - 1])


def _place(view: VehicleView, setting: Setting, number: int) -> Iterator[Finding]:
    if view.position is None:
        yield bad("place", "no position", "a position", "wait for a fix")
        return
    here = setting.grid.fixed(view.position)
    away_m = here.distance_to(_pad(setting, number))
    found = f"{away_m:.0f} m from its place in the mission file"
    if not setting.fence.contains(here):
        yield bad(
            "place", f"{found}, outside of the geofence", "inside of fence.polygon",
            "carry it there, or draw the fence around it",
        )  # fmt: skip
    elif away_m > PAD_M and view.on_ground:
        yield warn(
            "place", found, f"within {PAD_M:g} m",
            "that is allowed: it returns to where it took off; check vehicles.home and start",
        )  # fmt: skip
    else:
        yield ok("place", found)
