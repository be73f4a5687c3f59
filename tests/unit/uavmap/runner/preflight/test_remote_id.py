"""The state of a Remote ID module, from its bytes to the doctor's line."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.support.mavlink_peer import heartbeat
from uavmap.mavlink.session import Session
from uavmap.runner.preflight.vehicle_check import Measurement, state_findings

READY, NOT_READY = mav.MAV_ODID_ARM_STATUS_GOOD_TO_ARM, mav.MAV_ODID_ARM_STATUS_PRE_ARM_FAIL_GENERIC


def status(number, error=b""):
    return mav.MAVLink_open_drone_id_arm_status_message(number, error)


def line(*messages, system=1):
    """Return the doctor's line after messages of a module on the vehicle."""

    async def examined():
        session = Session(lambda frame: None, lambda data: None)
        measured = Measurement(session)
        session.feed(heartbeat().pack(mav.MAVLink(None, srcSystem=1, srcComponent=1)))
        for message in messages:
            session.feed(message.pack(mav.MAVLink(None, srcSystem=system, srcComponent=236)))
        (found,) = (
            finding
            for finding in state_findings(session.view, measured, None, 1)
            if finding.what == "remote ID"
        )
        return found.line()

    return asyncio.run(examined())


def test_remote_id_without_a_module_is_information():
    assert line().startswith("ok    remote ID: no module reports")


def test_remote_id_that_is_ready_is_shown():
    assert line(status(NOT_READY, b"no fix"), status(READY)) == "ok    remote ID: ready to arm"


@pytest.mark.parametrize(
    ("error", "shown"),
    [
        (b"operator ID missing", "operator ID missing"),
        (b"", "without a reason"),
        (b"\x1b[2Jlost\x00rest", "lost"),
        (b"\xffodd", "\ufffdodd"),
    ],
)
def test_remote_id_that_is_not_ready_is_shown_with_its_reason(error, shown):
    assert line(status(NOT_READY, error)).startswith(f"bad   remote ID: not ready to arm: {shown}")


def test_remote_id_of_another_system_is_not_that_of_the_vehicle():
    assert "no module reports" in line(status(NOT_READY, b"no fix"), system=9)
