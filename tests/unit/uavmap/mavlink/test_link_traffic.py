"""Reports of other aircraft on a link: incomplete, wrong, too many, or of an own vehicle."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from tests.support.mavlink_peer import position
from tests.support.running import by
from tests.unit.uavmap.mavlink.test_session import conversation
from uavmap.mavlink.link_traffic import GEOID_ERROR_M, MAX_AIRCRAFT, PRESSURE_ERROR_M

HERE = LatLon(47.3, 8.5)
ALL = 0x1F
UTM_ALL = 2 | 4 | 8 | 32


def adsb(lat_deg=47.31, lon_deg=8.5, *, flags=ALL, icao=0x3C6444, **how):
    values = {"altitude_type": 1, "altitude": 650_000, "heading": 9000, "hor_velocity": 5000}
    values |= {"callsign": b"DLH1\0", "emitter_type": 1, "tslc": 2} | how
    return mav.MAVLink_adsb_vehicle_message(
        icao, round(lat_deg * 1e7), round(lon_deg * 1e7), values["altitude_type"],
        values["altitude"], values["heading"], values["hor_velocity"], 0, values["callsign"],
        values["emitter_type"], values["tslc"], flags, 0,
    )  # fmt: skip


def utm(lat_deg=47.31, lon_deg=8.5, *, flags=UTM_ALL, state=3, ident=7):
    return mav.MAVLink_utm_global_position_message(
        0, [ident] * 18, round(lat_deg * 1e7), round(lon_deg * 1e7), 650_000, 0, 300, 400, 0,
        0, 0, 0, 0, 0, 0, 100, state, flags,
    )  # fmt: skip


def receive(peer, *messages, system=1):
    sender = mav.MAVLink(None, srcSystem=system, srcComponent=156)
    peer.session.feed(peer.frame(position(HERE, t_s=1.0)))
    for message in messages:
        peer.session.feed(message.pack(sender))
    return peer.session.traffic.aircraft


@by(conversation)
async def test_adsb_report_has_place_height_name_and_velocity(peer, /):
    (heard,) = receive(peer, adsb()).values()
    assert (heard.ident, heard.name, heard.position) == ("3C6444 DLH1", "DLH1", LatLon(47.31, 8.5))
    assert (heard.amsl_m, heard.error_m) == (650.0, GEOID_ERROR_M)
    assert heard.velocity_m_s == pytest.approx((50.0, 0.0))
    assert heard.received_s == pytest.approx(-2.0, abs=0.1)


@by(conversation)
async def test_adsb_report_without_flags_has_unknown_fields(peer, /):
    (heard,) = receive(peer, adsb(flags=1, altitude_type=0)).values()
    assert (heard.name, heard.amsl_m, heard.velocity_m_s) == ("3C6444", None, None)
    assert heard.error_m == PRESSURE_ERROR_M


@by(conversation)
async def test_fields_that_make_no_sense_are_unknown_and_the_aircraft_is_seen(peer, /):
    wild = adsb(altitude=-2_000_000_000, heading=65535, callsign=b"\xff\x1b[2J\0")
    (heard,) = receive(peer, wild).values()
    assert (heard.amsl_m, heard.velocity_m_s) == (None, None)
    assert heard.name.isprintable()


@by(conversation)
async def test_reports_without_a_place_near_the_vehicle_are_no_traffic(peer, /):
    messages = [adsb(flags=ALL & ~1), adsb(0.0, 0.0), adsb(95.0, 8.5), adsb(47.3, 200.0)]
    messages += [
        adsb(8.5, 47.3),
        adsb(48.0, 8.5),
        adsb(emitter_type=18),
        utm(flags=2),
        utm(state=2),
    ]
    assert receive(peer, *messages) == {}
    assert peer.session.view.gate.refused["ADSB_VEHICLE", "lat is out of range"] == 1


@by(conversation)
async def test_utm_report_of_another_system_is_accepted(peer, /):
    heard, other = receive(peer, utm(), utm(flags=4), system=77).values()
    assert (heard.ident, heard.amsl_m) == ("07" * 18, 650.0)
    assert heard.velocity_m_s == (4.0, 3.0)
    assert (other.ident, other.amsl_m, other.velocity_m_s) == ("system 77", None, None)
    assert peer.session.view.system_id == 1


@by(conversation)
async def test_traffic_before_the_vehicle_has_a_place_is_left_out(peer, /):
    sender = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    peer.session.feed(adsb().pack(sender))
    assert peer.session.traffic.aircraft == {}


@by(conversation)
async def test_flood_keeps_the_nearest_and_no_more(peer, /):
    near = adsb(47.3001, icao=1)
    flood = [adsb(47.32 + k * 1e-5, icao=0x1000 + k) for k in range(4 * MAX_AIRCRAFT)]
    aircraft = receive(peer, near, *flood)
    assert len(aircraft) <= MAX_AIRCRAFT
    assert "000001 DLH1" in aircraft


@by(conversation)
async def test_older_report_does_not_replace_a_newer_one(peer, /):
    (heard,) = receive(peer, adsb(47.31, tslc=1), adsb(47.35, tslc=20)).values()
    assert heard.position == LatLon(47.31, 8.5)
