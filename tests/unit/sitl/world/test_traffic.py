"""Aircraft of others in the simulated world, as a client receives them."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.geo.geodesy import LocalPlane
from missions.units import LatLon
from sitl.world.traffic import Intruder

HOME = (47.3, 8.5, 500.0)
PLACE = LatLon(47.31, 8.5)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_transponder_is_received_once_a_second_while_it_sends(sitl_fleet, autopilot):
    flies = Intruder(PLACE, 120.0, 180.0, 40.0, at_s=2.0, for_s=5.0, name="TEST1")
    (vehicle,) = sitl_fleet(1, autopilot=autopilot, home=HOME, traffic=(flies,))
    vehicle.run(10.0)
    received = [m for m in vehicle.receive() if m.get_type() == "ADSB_VEHICLE"]
    assert 5 <= len(received) <= 6
    assert {m.get_srcSystem() for m in received} == {1}
    assert (received[0].callsign, received[0].altitude, received[0].heading) == (
        "TEST1",
        620_000,
        18_000,
    )
    plane = LocalPlane(PLACE)
    places = [plane.to_plane(LatLon(m.lat / 1e7, m.lon / 1e7)) for m in received]
    assert places[1][1] - places[0][1] == pytest.approx(-40.0, abs=0.5)


def test_report_of_a_small_aircraft_is_that_of_a_traffic_management(sitl_fleet):
    (vehicle,) = sitl_fleet(1, home=HOME, traffic=(Intruder(PLACE, 80.0, kind="utm"),))
    received = vehicle.expect("UTM_GLOBAL_POSITION")
    assert received.flags & mav.UTM_DATA_AVAIL_FLAGS_POSITION_AVAILABLE
    assert (received.lat, received.alt) == (round(PLACE.lat_deg * 1e7), 580_000)
