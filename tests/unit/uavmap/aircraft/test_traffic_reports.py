"""Traffic as events of the mission: after positions of vehicles, with new reports only."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import LinkLost, Tracked
from missions.flight.setting_of import setting_of
from missions.units import GridPoint, LatLon
from tests.support.mavlink_peer import heartbeat, position
from tests.support.small_missions import START, mission, square
from tests.unit.uavmap.mavlink.test_link_traffic import adsb, utm
from uavmap.aircraft.traffic_reports import MAX_TRACKS, TrafficReports
from uavmap.mavlink.session import Session

NORTH = LatLon(START.lat_deg + 0.01, START.lon_deg)
OWN = 0x11


def here(number, t_s):
    return Tracked(number, t_s, GridPoint(0.0, 0.0), 12.0, 20.0)


def reporting(*rounds):
    """Return the events after rounds of (messages by vehicle, event that is followed)."""
    drawn = mission(square(4, 4, 16, 16), square(-40, -40, 90, 90), vehicles=2)
    setting, found = setting_of(drawn), []

    async def main():
        sessions = {n: Session(lambda frame: None, lambda data: None) for n in (1, 2)}
        senders = {n: mav.MAVLink(None, srcSystem=n, srcComponent=1) for n in sessions}
        for number, session in sessions.items():
            for message in (heartbeat(), position(START, t_s=1.0)):
                session.feed(message.pack(senders[number]))
        version = mav.MAVLink_autopilot_version_message(0, 0, 0, 0, 0, *[[0] * 8] * 3, 0, 0, 0)
        version.uid2 = [OWN] * 18
        sessions[2].feed(version.pack(senders[2]))
        reports = TrafficReports(sessions, setting, lambda: 100.0, found.append)
        for messages, event in rounds:
            for number, message in messages:
                sessions[number].feed(message.pack(senders[number]))
            reports.follow(event)

    asyncio.run(main())
    return found


def test_report_has_the_track_in_the_frame_of_the_mission():
    north = adsb(NORTH.lat_deg, NORTH.lon_deg, tslc=3)
    (event,) = reporting(([(1, north)], here(1, 10.0)))
    (track,) = event.tracks
    assert (event.t_s, track.name) == (10.0, "DLH1")
    assert track.seen_s == pytest.approx(97.0, abs=0.2)
    assert track.place.north_m == pytest.approx(1112.0, abs=2.0)
    assert abs(track.place.east_m) < 50.0
    assert track.height_m == 150.0  # homes of these vehicles lie 500 m above the sea
    assert track.velocity_m_s.east_m == pytest.approx(50.0, abs=0.2)


def test_report_comes_after_a_place_once_a_second_and_only_with_news():
    one = adsb(NORTH.lat_deg, NORTH.lon_deg, icao=1)
    two = adsb(NORTH.lat_deg, NORTH.lon_deg, icao=2)
    events = reporting(
        ([(1, one)], LinkLost(1, 10.0)),
        ([], here(1, 10.5)),
        ([(1, two)], here(2, 11.0)),
        ([], here(1, 11.6)),
        ([], here(1, 13.0)),
    )
    assert [event.t_s for event in events] == [10.5, 11.6]
    assert [len(event.tracks) for event in events] == [1, 1]


def test_report_of_two_receivers_is_one_track():
    north = adsb(NORTH.lat_deg, NORTH.lon_deg)
    (event,) = reporting(([(1, north), (2, north)], here(1, 10.0)))
    assert len(event.tracks) == 1


def test_broadcast_of_an_own_vehicle_is_no_traffic():
    ours, other = utm(NORTH.lat_deg, NORTH.lon_deg, ident=OWN), utm(NORTH.lat_deg, NORTH.lon_deg)
    (event,) = reporting(([(1, ours), (1, other)], here(1, 10.0)))
    assert [track.ident for track in event.tracks] == ["07" * 18]


def test_report_of_a_flood_has_the_nearest():
    flood = [(1, adsb(NORTH.lat_deg + k * 1e-4, NORTH.lon_deg, icao=k + 1)) for k in range(90)]
    (event,) = reporting((flood, here(1, 10.0)))
    assert len(event.tracks) == MAX_TRACKS
    assert event.tracks[0].ident.startswith("000001")
