from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.body.sensors import WORST_M, Altimeter
from sitl.quirks import Quirks
from sitl.world.ground import Relief
from tests.unit.sitl.piloted import AMSL_M, AUTOPILOTS, piloted


def heights(seed, seconds, sigma_m=3.0, armed=False):
    altimeter = Altimeter(0.0, [seed], sigma_m)
    found = []
    for _ in range(seconds):
        altimeter.step(1.0, armed=armed)
        found.append(altimeter.receiver_m)
    return np.array(found)


def test_receivers_err_by_metres_and_wander_slowly():
    """Heights of two receivers, or of one before and after a swap, differ by 3 to 8 m."""
    starts = np.array([heights(seed, 1)[0] for seed in range(200)])
    assert 2.5 < starts.std() < 3.5
    long = np.concatenate([heights(seed, 3000) for seed in range(5)])
    assert np.abs(long).max() <= WORST_M
    steps = [abs(b - a) for a, b in pairwise(heights(1, 3000))]
    assert max(steps) < 1.0
    assert np.ptp(heights(1, 3000)) > 4.0


def test_a_battery_swap_is_another_start():
    altimeter = Altimeter(0.0, [3], 3.0)
    before_m = altimeter.datum_m
    altimeter.start()
    assert abs(altimeter.datum_m - before_m) > 0.5
    assert altimeter.datum_m == altimeter.receiver_m


def test_armed_vehicle_keeps_the_height_of_arming():
    altimeter = Altimeter(0.0, [3], 3.0)
    kept_m = altimeter.datum_m
    for _ in range(600):
        altimeter.step(1.0, armed=True)
    assert altimeter.datum_m == kept_m
    assert abs(altimeter.receiver_m - kept_m) > 0.1
    for _ in range(60):
        altimeter.step(1.0, armed=False)
    assert altimeter.datum_m == pytest.approx(altimeter.receiver_m, abs=0.4)


def fleet_of(autopilot, **setup):
    quirks = Quirks(height_sigma_m=3.0, home_moves_m=0.0)
    made = piloted(autopilot=autopilot, gps_sigma_m=0.01, quirks=quirks, **setup)
    made.run(8.0)
    return made


def home_m(vehicle):
    return vehicle.ask("HOME_POSITION").altitude / 1000.0


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_vehicles_side_by_side_on_level_ground_report_other_heights_of_home(autopilot):
    fleet = fleet_of(autopilot, vehicles=3, seed=2)
    reported = [home_m(vehicle) for vehicle in fleet]
    assert max(reported) - min(reported) > 2.0
    assert all(abs(height_m - AMSL_M) <= WORST_M for height_m in reported)
    fleet.run(100.0)
    assert max(abs(home_m(v) - before_m) for v, before_m in zip(fleet, reported, strict=True)) > 0.3


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_vehicle_that_flies_by_heights_above_the_sea_flies_by_its_own(autopilot):
    """The truth is 12 m above the pad at any reported height; GPS_RAW_INT continues to wander."""
    (vehicle,) = fleet_of(autopilot, seed=2)
    if autopilot == "ardupilot":
        assert vehicle.command(176, 1, 4) == 0
    assert vehicle.command(400, 1) == 0
    datum_m = home_m(vehicle)
    assert abs(datum_m - AMSL_M) > 0.5
    place = math.nan, math.nan, math.nan, datum_m + 10.0
    up = (0, 0, 0, 0, 0, 0, 10.0) if autopilot == "ardupilot" else (0, 0, 0, *place)
    assert vehicle.command(22, *up) == 0
    vehicle.run(14.0)
    reported = vehicle.ask("GLOBAL_POSITION_INT")
    frame, flags = mav.MAV_FRAME_GLOBAL_INT, 0
    vehicle.send(
        mav.MAVLink_command_int_message(
            1,
            1,
            frame,
            192,
            0,
            0,
            -1.0,
            flags,
            0.0,
            math.nan,
            reported.lat,
            reported.lon,
            datum_m + 12.0,
        )
    )
    vehicle.run(10.0)
    assert vehicle.truth.height_m == pytest.approx(12.0, abs=0.3)
    raw = []
    for _ in range(4):
        reported = vehicle.ask("GLOBAL_POSITION_INT")
        assert (reported.alt - reported.relative_alt) / 1000.0 == pytest.approx(datum_m, abs=0.01)
        raw.append(vehicle.ask("GPS_RAW_INT").alt / 1000.0)
        vehicle.run(60.0)
    assert max(raw) - min(raw) > 0.5


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_vehicle_on_a_slope_reports_the_height_of_its_own_home_before_arming(autopilot):
    relief = Relief(0.1, 90.0, 0.0, 150.0, 0)  # 10 % up to the east, where they stand in a row
    fleet = piloted(autopilot=autopilot, vehicles=3, relief=relief)
    fleet.run(8.0)
    reported = [home_m(vehicle) for vehicle in fleet]
    assert reported == pytest.approx([AMSL_M, AMSL_M + 0.3, AMSL_M + 0.6], abs=0.02)
