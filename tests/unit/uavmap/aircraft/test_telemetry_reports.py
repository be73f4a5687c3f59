"""Reports of vehicles beside events: their rate, and their figures of a link."""

import asyncio

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import LinkLost, Tracked
from missions.units import GridPoint
from uavmap.aircraft.telemetry_reports import TelemetryReports
from uavmap.mavlink.session import Session


def frames(*numbers):
    """Return GPS_RAW_INT and SYS_STATUS of a vehicle, numbered by its link."""
    sender = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    heartbeat = mav.MAVLink_heartbeat_message(
        mav.MAV_TYPE_QUADROTOR, mav.MAV_AUTOPILOT_ARDUPILOTMEGA, 209, 4, 4, 3
    )
    gps = mav.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 90, 65535, 0, 0, 17)
    status = mav.MAVLink_sys_status_message(0, 0, 0, 0, 15600, 0, 50, 0, 0, 0, 0, 0, 0)
    for at, message in zip(numbers, (heartbeat, gps, status), strict=False):
        sender.seq = at % 256
        yield message.pack(sender)


def test_report_after_a_place_has_telemetry_and_the_loss_of_the_link():
    async def scenario():
        session, sent = Session(lambda frame: None, lambda data: None), []
        reports = TelemetryReports({1: session}, sent.append)
        place = GridPoint(1.0, 2.0)
        for frame in frames(250, 251, 252):
            session.feed(frame)
        reports.follow(Tracked(1, 10.0, place, 3.0, 40.0))
        reports.follow(Tracked(1, 10.5, place, 3.0, 40.0))
        reports.follow(Tracked(2, 11.0, place, 3.0, 40.0))  # of a vehicle without a session
        for frame in frames(254, 255, 258):
            session.feed(frame)
        reports.follow(LinkLost(1, 11.2))
        reports.follow(Tracked(1, 11.5, place, 3.0, 40.0))
        return sent

    first, second = asyncio.run(scenario())
    assert (first.vehicle, first.mode, first.satellites) == (1, "GUIDED", 17)
    assert (first.hdop, first.volts, first.loss_percent) == (0.9, 15.6, None)
    assert second.loss_percent == 50


def test_report_of_a_receiver_that_states_nothing_has_no_figures():
    async def scenario():
        session, sent = Session(lambda frame: None, lambda data: None), []
        sender = mav.MAVLink(None, srcSystem=1, srcComponent=1)
        for frame in frames(0):
            session.feed(frame)
        unknown = mav.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, 65535, 65535, 0, 0, 255)
        session.feed(unknown.pack(sender))
        nothing = mav.MAVLink_sys_status_message(0, 0, 0, 0, 65535, 0, -1, 0, 0, 0, 0, 0, 0)
        session.feed(nothing.pack(sender))
        reports = TelemetryReports({1: session}, sent.append)
        reports.follow(Tracked(1, 0.0, GridPoint(0.0, 0.0), 0.0, 0.0))
        return sent

    (report,) = asyncio.run(scenario())
    assert (report.satellites, report.hdop, report.volts) == (None, None, None)
