"""The parameters of an autopilot for a mission, without its fence."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from missions.mission.layout import Layout
from uavmap.mavlink.autopilots import PX4, Autopilot
from uavmap.mavlink.parameters import Parameter
from uavmap.mavlink.session import GROUND_SYSTEM_ID
from uavmap.runner.preflight.finding import Finding, bad, ok, warn

HIGHEST_RETURN_M: Final = 30.0
"""Height up to which others keep away from a vehicle in RTL, m."""
CAPACITY_SHARE: Final = 0.2
"""Difference of the autopilot's battery from the mission's that makes a finding, as a share."""
CELL_FULL_V: Final = 4.25
CELL_V: Final = 3.7
"""Voltage of a lithium polymer cell: full, and in the middle of its discharge."""

Values = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Needs:
    """The mission's requirements on an autopilot; the defaults suit most."""

    reserve: float = 0.15
    """Maximum share of the charge at which the autopilot's own failsafe may act."""
    accel_m_s2: float = 2.0
    several: bool = False
    climb_m_s: float = 0.0
    """Rate by the mission, m/s; 0 without one."""
    descent_m_s: float = 0.0


def needs_of(setting: Layout | None) -> Needs:
    """Return the requirements of a mission; without one, those of most."""
    if setting is None:
        return Needs()
    mission = setting.mission
    # parameters that are set for the flight need no check
    several = len(mission.vehicles) > 1 or setting.ground is not None
    return Needs(
        mission.battery.reserve,
        setting.energy.accel_m_s2,
        several,
        mission.flight.climb_m_s or 0.0,
        mission.flight.descent_m_s or 0.0,
    )


@dataclass(frozen=True, slots=True)
class Check:
    """The check of one parameter by all of them and the requirements of the mission."""

    name: str
    holds: Callable[[Values, Needs], bool]
    wanted: str
    why: str


ARDUPILOT_CHECKS: Final = (
    Check("ARMING_CHECK", lambda v, n: v["ARMING_CHECK"] != 0, "1",
          "at 0 it arms without looking at its sensors"),
    Check("BATT_FS_LOW_ACT", lambda v, n: v["BATT_FS_LOW_ACT"] in (1, 2, 3, 4, 6), "2 (RTL)",
          "with a low battery it returns, even without this computer"),
    Check("BATT_LOW_VOLT", lambda v, n: v["BATT_LOW_VOLT"] > 0 or v["BATT_LOW_MAH"] > 0,
          "the voltage of your pack at the mission's reserve",
          "without it and BATT_LOW_MAH the low-battery failsafe never acts"),
    Check("BATT_LOW_MAH",
          lambda v, n: v["BATT_LOW_MAH"] <= n.reserve * v.get("BATT_CAPACITY", 0.0) * 1.01,
          "not above the mission's reserve (battery.reserve of BATT_CAPACITY)",
          "the autopilot would end the flight before the mission does"),
    Check("FS_THR_ENABLE", lambda v, n: v["FS_THR_ENABLE"] != 0, "1 (RTL)",
          "a lost radio control is not noticed"),
    Check("FS_EKF_ACTION", lambda v, n: v["FS_EKF_ACTION"] in (1, 3), "1 (land)",
          "without a position it drifts"),
    Check("FS_GCS_ENABLE", lambda v, n: v["FS_GCS_ENABLE"] != 0, "1 (RTL)",
          f"when this computer dies it hovers until its battery is low; with SYSID_MYGCS "
          f"{GROUND_SYSTEM_ID} it listens to this program"),
    Check("SYSID_MYGCS",
          lambda v, n: v["FS_GCS_ENABLE"] == 0 or v["SYSID_MYGCS"] == GROUND_SYSTEM_ID,
          str(GROUND_SYSTEM_ID),
          "FS_GCS_ENABLE listens to another ground station than this program: right only if that "
          "one is yours and runs"),
    Check("RTL_ALT", lambda v, n: n.several or v["RTL_ALT"] <= 100 * HIGHEST_RETURN_M,
          f"at most {100 * HIGHEST_RETURN_M:.0f} cm",
          "others keep away from a returning vehicle up to that height"),
    Check("WPNAV_ACCEL", lambda v, n: v["WPNAV_ACCEL"] >= 100.0 * n.accel_m_s2 - 1,
          "200 cm/s2, flight.accel_m_s2, or more",
          "legs take longer than estimated"),
    Check("WPNAV_SPEED", lambda v, n: True, "", ""),
)  # fmt: skip

PX4_CHECKS: Final = (
    Check("COM_LOW_BAT_ACT", lambda v, n: v["COM_LOW_BAT_ACT"] in (2, 3), "3 (return)",
          "with a low battery it returns, even without this computer"),
    Check("BAT_LOW_THR", lambda v, n: v["BAT_LOW_THR"] <= n.reserve + 0.01,
          "not above battery.reserve of the mission",
          "the autopilot would warn, or end the flight, before the mission does"),
    Check("NAV_RCL_ACT", lambda v, n: v["NAV_RCL_ACT"] in (1, 2, 3), "2 (return)",
          "a lost radio control is not noticed"),
    Check("NAV_DLL_ACT", lambda v, n: v["NAV_DLL_ACT"] in (1, 2, 3), "2 (return)",
          "when this computer dies it hovers until its battery is low; any ground station "
          "counts, this program included"),
    Check("COM_OF_LOSS_T", lambda v, n: 0.5 <= v["COM_OF_LOSS_T"] <= 2.0, "1 s",
          "time that it flies on without setpoints"),
    Check("COM_OBL_RC_ACT", lambda v, n: v["COM_OBL_RC_ACT"] in (3, 4, 5), "3 (return)",
          "when setpoints stay away and a radio control is on, it hovers until its pilot flies it"),
    Check("RTL_RETURN_ALT", lambda v, n: n.several or v["RTL_RETURN_ALT"] <= HIGHEST_RETURN_M,
          f"at most {HIGHEST_RETURN_M:g} m",
          "others keep away from a returning vehicle up to that height"),
    Check("MPC_XY_CRUISE", lambda v, n: True, "", ""),
)  # fmt: skip

ARDUPILOT_CLIMB_CHECKS: Final = (
    Check("WPNAV_SPEED_UP", lambda v, n: v["WPNAV_SPEED_UP"] >= 100.0 * n.climb_m_s - 1,
          "flight.climb_m_s or more", "it climbs slower than in the mission"),
    Check("WPNAV_SPEED_DN", lambda v, n: v["WPNAV_SPEED_DN"] >= 100.0 * n.descent_m_s - 1,
          "flight.descent_m_s or more", "it descends slower than in the mission"),
)  # fmt: skip
PX4_CLIMB_CHECKS: Final = (
    Check("MPC_Z_V_AUTO_UP", lambda v, n: v["MPC_Z_V_AUTO_UP"] >= n.climb_m_s - 0.01,
          "flight.climb_m_s or more", "it climbs slower than in the mission"),
    Check("MPC_TKO_SPEED", lambda v, n: v["MPC_TKO_SPEED"] >= n.climb_m_s - 0.01,
          "flight.climb_m_s or more", "it takes off slower than in the mission"),
    Check("MPC_Z_V_AUTO_DN", lambda v, n: v["MPC_Z_V_AUTO_DN"] >= n.descent_m_s - 0.01,
          "flight.descent_m_s or more", "it descends slower than in the mission"),
)  # fmt: skip
"""Only for missions that give the climb and descent rates of their autopilots."""

_ON_BY_FLOW: Final = (
    'navigation.gnss_loss is "map": without optical flow it lands when satellites go'
)
ARDUPILOT_FLOW_CHECKS: Final = (
    Check("FLOW_TYPE", lambda v, n: v["FLOW_TYPE"] != 0, "the type of your sensor", _ON_BY_FLOW),
    Check("EK3_SRC_OPTIONS", lambda v, n: bool(int(v["EK3_SRC_OPTIONS"]) & 1), "1",
          "its optical flow is used beside satellites, and goes on without them"),
)  # fmt: skip
PX4_FLOW_CHECKS: Final = (
    Check("EKF2_OF_CTRL", lambda v, n: v["EKF2_OF_CTRL"] != 0, "1", _ON_BY_FLOW),
    Check("COM_POS_FS_EPH", lambda v, n: not 0.0 <= v["COM_POS_FS_EPH"] < FLOW_EPH_M, "-1",
          "its position counts as lost when its own accuracy has become worse than that, though "
          "its own map still gives its position"),
)  # fmt: skip
"""Only for missions that continue without satellites."""
FLOW_EPH_M: Final = 50.0

CAPACITY: Final = {True: "BAT1_CAPACITY", False: "BATT_CAPACITY"}
"""Parameter of the battery's capacity, mAh, by whether the autopilot is a PX4."""


def parameter_checks(kind: Autopilot, setting: Layout | None) -> tuple[Check, ...]:
    """Return the checks for a mission; without one, for most."""
    wishes: tuple[Check, ...] = PX4_CHECKS if kind is PX4 else ARDUPILOT_CHECKS
    if setting is None:
        return wishes
    flight = setting.mission.flight
    if flight.climb_m_s is not None or flight.descent_m_s is not None:
        wishes += PX4_CLIMB_CHECKS if kind is PX4 else ARDUPILOT_CLIMB_CHECKS
    if setting.mission.navigation.gnss_loss != "map":
        return wishes
    return wishes + (PX4_FLOW_CHECKS if kind is PX4 else ARDUPILOT_FLOW_CHECKS)


def names_of(kind: Autopilot, setting: Layout | None = None) -> tuple[str, ...]:
    """Return the names of the requested parameters."""
    wishes = parameter_checks(kind, setting)
    extra = () if kind is PX4 else ("BATT_LOW_MAH",)
    return tuple(dict.fromkeys([*(w.name for w in wishes), *extra, CAPACITY[kind is PX4]]))


def parameter_findings(
    kind: Autopilot,
    parameters: Mapping[str, Parameter],
    setting: Layout | None,
    volts: float | None,
) -> Iterator[Finding]:
    """Yield the findings on the requested parameters; `volts` of the battery, if known."""
    values = {name: parameter.value for name, parameter in parameters.items()}
    needs = needs_of(setting)
    if not values:
        yield bad(
            "parameters", "none was reported", "answers", "does the link carry anything to it?"
        )
        return
    for wish in parameter_checks(kind, setting):
        yield _finding_of(wish, values, needs)
    yield _capacity(CAPACITY[kind is PX4], values, setting, volts)


def _finding_of(wish: Check, values: Values, needs: Needs) -> Finding:
    if wish.name not in values:
        return warn(wish.name, "not reported", wish.wanted or "a value", "this autopilot has none?")
    found = f"{values[wish.name]:g}"
    try:
        held = wish.holds(values, needs)
    except KeyError as missing:
        other = missing.args[0]
        return warn(
            wish.name, found, wish.wanted, f"{other}, which belongs to it, was not reported"
        )
    return ok(wish.name, found) if held else warn(wish.name, found, wish.wanted, wish.why)


def _capacity(name: str, values: Values, setting: Layout | None, volts: float | None) -> Finding:
    mah = values.get(name)
    if mah is None or mah <= 0.0:
        return warn(name, "not set", "the capacity of the pack, mAh", "the charge is by voltage")
    if volts is None or setting is None:
        return ok(name, f"{mah:g} mAh")
    cells = max(math.ceil(volts / CELL_FULL_V), 1)
    found_wh = mah / 1000.0 * cells * CELL_V
    wanted_wh = setting.mission.battery.capacity_wh
    found = f"{mah:g} mAh, with {volts:.1f} V (taken for {cells} cells) about {found_wh:.0f} Wh"
    if abs(found_wh - wanted_wh) > CAPACITY_SHARE * wanted_wh:
        return warn(
            name, found, f"battery.capacity_wh = {wanted_wh:g}",
            f"set the one that is wrong: {name}, or battery.capacity_wh to {found_wh:.0f} (and "
            "battery.hover_power_w to what it draws)",
        )  # fmt: skip
    return ok(name, found)
