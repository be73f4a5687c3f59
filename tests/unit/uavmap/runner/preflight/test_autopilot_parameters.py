"""Findings about parameters, for each autopilot: suitable, unsuitable, or not reported."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink import mavutil

from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.mission.schema import NavigationSection
from tests.e2e.rig import SHARED
from tests.support.field import mission_of
from uavmap.mavlink.autopilots import ARDUPILOT, PX4, Autopilot
from uavmap.mavlink.links.framing import Losses
from uavmap.mavlink.parameters import Parameter
from uavmap.runner.preflight.autopilot_fence import ARDUPILOT_FENCE
from uavmap.runner.preflight.autopilot_parameters import (
    ARDUPILOT_CHECKS,
    PX4_CHECKS,
    names_of,
    parameter_findings,
)
from uavmap.runner.preflight.finding import Finding, Level

RECORDED = SHARED / "arducopter" / "flight-4.6.tlog"
GOOD_ARDUPILOT = {
    "ARMING_CHECK": 1, "BATT_FS_LOW_ACT": 2, "BATT_LOW_VOLT": 10.5, "BATT_LOW_MAH": 0,
    "FS_THR_ENABLE": 1, "FS_EKF_ACTION": 1, "FS_GCS_ENABLE": 1, "SYSID_MYGCS": 245,
    "RTL_ALT": 1500, "WPNAV_ACCEL": 250, "WPNAV_SPEED": 1000, "BATT_CAPACITY": 1126,
}  # fmt: skip
GOOD_PX4 = {
    "COM_LOW_BAT_ACT": 3, "BAT_LOW_THR": 0.1, "NAV_RCL_ACT": 2, "NAV_DLL_ACT": 2,
    "COM_OF_LOSS_T": 1, "COM_OBL_RC_ACT": 3, "RTL_RETURN_ALT": 30, "MPC_XY_CRUISE": 5,
    "BAT1_CAPACITY": 1126,
}  # fmt: skip


def findings_of(
    kind: Autopilot,
    values: dict[str, Any],
    volts: float | None = 24.9,
    vehicles: int = 1,
    setting: Setting | None = None,
) -> list[Finding]:
    setting = setting or setting_of(mission_of("ardupilot", vehicles))
    told = {name: Parameter(float(value), 9) for name, value in values.items()}
    return list(parameter_findings(kind, told, setting, volts))


def not_ok(findings: list[Finding]) -> list[str]:
    return [finding.what for finding in findings if finding.level is not Level.OK]


@pytest.mark.parametrize(("kind", "good"), [(ARDUPILOT, GOOD_ARDUPILOT), (PX4, GOOD_PX4)])
def test_autopilot_that_is_set_well_has_no_findings(kind, good):
    assert set(good) == set(names_of(kind))
    assert not_ok(findings_of(kind, good)) == []
    rows = PX4_CHECKS if kind is PX4 else ARDUPILOT_CHECKS
    assert all(row.wanted and row.why for row in rows if row.name not in
               ("WPNAV_SPEED", "MPC_XY_CRUISE"))  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (ARDUPILOT, "ARMING_CHECK", 0),
        (ARDUPILOT, "BATT_FS_LOW_ACT", 0),
        (ARDUPILOT, "BATT_LOW_VOLT", 0),
        (ARDUPILOT, "BATT_LOW_MAH", 900),
        (ARDUPILOT, "FS_THR_ENABLE", 0),
        (ARDUPILOT, "FS_GCS_ENABLE", 0),
        (ARDUPILOT, "SYSID_MYGCS", 255),
        (ARDUPILOT, "RTL_ALT", 5000),
        (ARDUPILOT, "WPNAV_ACCEL", 100),
        (ARDUPILOT, "BATT_CAPACITY", 5000),
        (PX4, "COM_LOW_BAT_ACT", 0),
        (PX4, "BAT_LOW_THR", 0.4),
        (PX4, "NAV_RCL_ACT", 0),
        (PX4, "NAV_DLL_ACT", 0),
        (PX4, "COM_OF_LOSS_T", 5),
        (PX4, "COM_OBL_RC_ACT", 0),  # a real one, with a stick: POSITION 0.9 s after a kill
        (PX4, "RTL_RETURN_ALT", 60),
    ],
)
def test_unsuitable_parameter_is_a_finding_with_a_reason(kind, name, value):
    good = GOOD_PX4 if kind is PX4 else GOOD_ARDUPILOT
    findings = findings_of(kind, good | {name: value})
    assert not_ok(findings) == [name]
    (finding,) = [f for f in findings if f.what == name]
    assert finding.wanted
    assert finding.remedy


def test_parameter_that_the_autopilot_does_not_report_is_a_finding():
    values = {name: value for name, value in GOOD_ARDUPILOT.items() if name != "BATT_LOW_MAH"}
    findings = findings_of(ARDUPILOT, values)
    assert not_ok(findings) == ["BATT_LOW_MAH"]  # a voltage limit needs no second limit
    assert [f.level for f in findings_of(ARDUPILOT, {})] == [Level.BAD]


def test_return_height_of_a_team_is_no_finding():
    assert not_ok(findings_of(ARDUPILOT, GOOD_ARDUPILOT | {"RTL_ALT": 5000}, vehicles=2)) == []


class Numbered:
    """A frame of which only the number matters."""

    def __init__(self, seq: int) -> None:
        self._seq = seq

    def get_srcSystem(self) -> int:  # noqa: N802 - pymavlink's name
        return 1

    def get_srcComponent(self) -> int:  # noqa: N802, as above
        return 1

    def get_seq(self) -> int:
        return self._seq


@pytest.mark.parametrize(
    ("numbers", "missing"),
    [([1, 2, 3], 0), ([254, 255, 0, 1], 0), ([1, 4], 2), ([1, 3, 2, 4], 0), ([250, 3], 8)],
)
def test_missing_frames_are_counted_by_their_numbers(numbers, missing):
    losses = Losses()
    for number in numbers:
        losses.count(Numbered(number))
    assert losses.counts((1, 1)) == (len(numbers), missing)


@pytest.mark.skipif(not RECORDED.exists(), reason="a recorded flight of a real ArduCopter")
def test_real_arducopter_has_every_parameter_that_is_checked():
    log = mavutil.mavlink_connection(str(RECORDED))
    told: dict[str, Parameter] = {}
    while (message := log.recv_match(type="PARAM_VALUE")) is not None:
        told[message.param_id] = Parameter(message.param_value, message.param_type)
    log.close()
    assert {*names_of(ARDUPILOT), *ARDUPILOT_FENCE} <= set(told)
    setting = setting_of(mission_of("ardupilot"))
    findings = list(parameter_findings(ARDUPILOT, told, setting, 12.6))
    assert not_ok(findings) == ["BATT_FS_LOW_ACT", "FS_GCS_ENABLE", "BATT_CAPACITY"]
    assert findings[-1].found.startswith("3300 mAh, with 12.6 V (taken for 3 cells) about 37 Wh")


@pytest.mark.parametrize("kind", [ARDUPILOT, PX4])
def test_mission_that_continues_without_satellites_needs_flow(kind):
    mission = mission_of("ardupilot", 1)
    on = setting_of(mission.model_copy(update={"navigation": NavigationSection(gnss_loss="map")}))
    more = set(names_of(kind, on)) - set(names_of(kind))
    assert len(more) == 2
    good = GOOD_PX4 if kind is PX4 else GOOD_ARDUPILOT
    flow = {"FLOW_TYPE": 6, "EK3_SRC_OPTIONS": 1, "EKF2_OF_CTRL": 1, "COM_POS_FS_EPH": -1}
    with_flow = {**good, **{name: flow[name] for name in more}}
    assert not_ok(findings_of(kind, with_flow, setting=on)) == []
    without = {**good, **dict.fromkeys(more, 0)}
    assert set(not_ok(findings_of(kind, without, setting=on))) == more


@pytest.mark.parametrize(
    ("kind", "good", "name", "value"),
    [
        (ARDUPILOT, GOOD_ARDUPILOT, "WPNAV_SPEED_UP", 500),
        (ARDUPILOT, GOOD_ARDUPILOT, "WPNAV_SPEED_DN", 300),
        (PX4, GOOD_PX4, "MPC_Z_V_AUTO_UP", 5),
        (PX4, GOOD_PX4, "MPC_Z_V_AUTO_DN", 3),
    ],
)
def test_autopilot_with_slower_climb_than_the_mission_is_a_finding(kind, good, name, value):
    mission = mission_of("ardupilot", 1)
    flight = mission.flight.model_copy(update={"climb_m_s": 5.0, "descent_m_s": 3.0})
    setting = setting_of(mission.model_copy(update={"flight": flight}))
    rates = (
        {"WPNAV_SPEED_UP": 500, "WPNAV_SPEED_DN": 300}
        if kind is ARDUPILOT
        else {"MPC_Z_V_AUTO_UP": 5, "MPC_TKO_SPEED": 5, "MPC_Z_V_AUTO_DN": 3}
    )
    assert set(names_of(kind, setting)) == {*good, *rates}
    assert not_ok(findings_of(kind, {**good, **rates}, setting=setting)) == []
    assert not_ok(findings_of(kind, {**good, **rates, name: value / 2}, setting=setting)) == [name]
