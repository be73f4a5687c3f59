"""Positions of a vehicle at the exposures of its pictures, and while it gets position estimates."""

import asyncio
import math
import statistics
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, Arrived, FrameLost, FrameSeen
from missions.geo.grid import Grid
from missions.geo.trajectory import rounded_path
from missions.mission.sim_section import SimRegion
from missions.orders import FlyPath, FlyTo, TakeOff
from missions.units import Cell, GridPoint, LatLon, Pose, Quaternion
from tests.support.flights import fly
from tests.support.mavlink_peer import Peer, ack, heartbeat, position
from tests.support.running import by, on_virtual_time
from tests.support.small_missions import CELL_M, START, mission, square
from uavmap.aircraft.cameras.mavlink import reported_pose
from uavmap.aircraft.cameras.pose import pose_fault
from uavmap.aircraft.controlled_commands import ControlledCommands
from uavmap.aircraft.guardian.monitor import Monitor
from uavmap.aircraft.reporter import Reporter
from uavmap.base.clock import VirtualClock, run
from uavmap.mavlink.continuity import distance_m
from uavmap.mavlink.position_history import HISTORY_S, Fix, Whereabouts

Message = Any
FAST = settings(max_examples=100, deadline=None)
HOME = LatLon(48.0, 11.0)
M_PER_DEG = 111_195.0
STILL = (0.0, 0.0, 0.0)


def north_of_home(metres):
    return LatLon(HOME.lat_deg + metres / M_PER_DEG, HOME.lon_deg)


def track_of_a_flight(rate_hz, speed_m_s, last_s=20.0, first_s=10.0):
    track = Whereabouts()
    for i in range(round((last_s - first_s) * rate_hz) + 1):
        t_s = first_s + i / rate_hz
        place = north_of_home(speed_m_s * (t_s - 10.0))
        track.add(Fix(t_s, place, 12.0 + 0.5 * (t_s - 10.0), (speed_m_s, 0.0, -0.5)))
    return track


# --- the track -------------------------------------------------------------------------------
@FAST
@given(st.floats(5.0, 25.0), st.sampled_from([1.0, 4.0, 5.0, 10.0]), st.floats(0.0, 15.0))
def test_straight_flight_is_placed_exactly(t_s, rate_hz, speed_m_s):
    place = track_of_a_flight(rate_hz, speed_m_s).at(t_s)
    assert distance_m(place.position, north_of_home(speed_m_s * (t_s - 10.0))) < 0.01
    assert place.height_m == pytest.approx(12.0 + 0.5 * (t_s - 10.0))
    outside_s = max(10.0 - t_s, t_s - 20.0, 0.0)
    assert outside_s - 1e-9 <= place.gap_s <= outside_s + 0.5 / rate_hz + 1e-9


def test_vehicle_without_a_report_has_no_place():
    assert Whereabouts().at(10.0) is None


def test_clock_that_restarts_clears_the_track():
    track = track_of_a_flight(5.0, 8.0)
    track.add(Fix(1.0, north_of_home(500.0), 0.0, STILL))
    place = track.at(15.0)
    assert distance_m(place.position, north_of_home(500.0)) < 0.01
    assert place.gap_s == 14.0


def test_old_positions_are_forgotten():
    track = track_of_a_flight(5.0, 8.0, last_s=100.0)
    place = track.at(100.0 - HISTORY_S - 10.0)
    assert place.gap_s == pytest.approx(10.0)


def test_track_across_the_date_line_is_interpolated():
    track = Whereabouts()
    track.add(Fix(1.0, LatLon(0.0, 179.9999), 12.0, STILL))
    track.add(Fix(2.0, LatLon(0.0, -179.9997), 12.0, STILL))
    place = track.at(1.5)
    assert place.position.lon_deg == pytest.approx(-179.9999)


# --- the pose that a camera tells ------------------------------------------------------------
GRID = Grid.at(HOME, CELL_M)
DOWN = Quaternion.from_euler(0.0, -math.pi / 2, 0.0)
SPEED_M_S = 8.0


def announcement(t_s, metres, height_m=12.0):
    place = north_of_home(metres)
    return mav.MAVLink_camera_image_captured_message(
        round(t_s * 1000), 0, 0, round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), 512_000,
        round(height_m * 1000), list(DOWN), 0, 1, b"http://127.0.0.1/0.jpg",
    )  # fmt: skip


def fault_of(message, received_s=10.0, last_s=10.0):
    """Return the fault of an announcement of a vehicle that flies north since 0 s of its clock.

    Its positions come five times a second until `last_s`; the announcement is judged at
    `received_s`.
    """

    async def main():
        peer, loop = Peer(), asyncio.get_running_loop()
        for fifth in range(round(last_s * 5) + 1):
            t_s = fifth / 5.0
            await asyncio.sleep(max(t_s - loop.time(), 0.0))
            if fifth % 5 == 0:
                peer.session.feed(peer.frame(heartbeat()))
            place = north_of_home(SPEED_M_S * t_s)
            here = position(place, t_s=t_s, velocity=(round(SPEED_M_S * 100), 0, 0))
            peer.session.feed(peer.frame(here))
        await asyncio.sleep(received_s - loop.time())
        view = peer.session.view
        taken_s = view.captured_s(message.time_boot_ms, loop.time())
        reported = reported_pose(message, view)
        return pose_fault(
            Pose(reported.position, reported.height_m, reported.attitude),
            view,
            GRID,
            taken_s,
        )

    return run(main(), VirtualClock())


@pytest.mark.parametrize("age_s", [0.0, 0.1, 1.0, 3.0, 8.0])
def test_picture_judged_late_is_held_against_place_of_then(age_s):
    taken_s = 10.0 - age_s
    assert fault_of(announcement(taken_s, SPEED_M_S * taken_s)) is None
    assert fault_of(announcement(taken_s, SPEED_M_S * taken_s + 14.0)) is None
    for off_m in (16.0, -16.0):
        fault = fault_of(announcement(taken_s, SPEED_M_S * taken_s + off_m))
        assert fault == "the position is not where the vehicle was"


def test_camera_place_that_lags_by_seconds_is_refused():
    """It reports the vehicle's place of three seconds before: 24 m behind the picture."""
    assert (
        fault_of(announcement(10.0, SPEED_M_S * 7.0)) == "the position is not where the vehicle was"
    )


def test_height_of_a_picture_is_that_of_its_exposure():
    assert (
        fault_of(announcement(7.0, 56.0, height_m=28.0)) == "the height is not that of the vehicle"
    )
    assert fault_of(announcement(7.0, 56.0, height_m=26.0)) is None


def test_picture_without_telemetry_may_be_farther_on():
    """Two seconds after its last position the limit is 50 m wider: it may have turned."""
    assert fault_of(announcement(12.0, 96.0), received_s=12.0) is None
    assert fault_of(announcement(12.0, 96.0 - 60.0), received_s=12.0) is None
    assert fault_of(announcement(12.0, 96.0 - 70.0), received_s=12.0) is not None


# --- in flight -------------------------------------------------------------------------------
# The ROI reaches from 4 to 24 m east and from 12 to 20 m north: its western and eastern borders
# halve a column of cells each.
WEST, EAST = (Cell(1, 4),), (Cell(6, 4),)
UP_M = 12.0


def strip():
    """Fly a vehicle at 8 m/s over a dark strip; its position is exact, its detector simple."""
    made = mission(
        square(-10, 8, 60, 16), square(-60, -40, 160, 110), speed_m_s=8.0, interval_s=0.2
    )
    grid = Grid.at(START, CELL_M)
    corners = [grid.position(GridPoint(*xy)) for xy in square(4, 12, 20, 8)]
    region = SimRegion(polygon=tuple((p.lat_deg, p.lon_deg) for p in corners))
    sim = made.sim.model_copy(
        update={"roi": (region,), "gps_sigma_m": 0.0, "texture": 0.0, "sensor_noise": 1.0}
    )
    detector = made.detector.model_copy(update={"dilations": 0})
    return made.model_copy(update={"sim": sim, "detector": detector})


def path(flight, *points):
    begin_s = flight.now_s() + 0.5
    planned = rounded_path([GridPoint(*p) for p in points], begin_s, speed_m_s=8.0)
    return FlyPath(planned, UP_M, None, 0.2)


@pytest.mark.parametrize("towards", ["east", "west"])
@by(fly, strip)
async def test_border_of_roi_at_8_m_s_within_two_decimetres(flight, /, towards):
    """From the pictures' own poses, between positions that come five times a second."""
    way = [(-25.0, 16.0), (50.0, 16.0)]
    if towards == "west":
        way.reverse()
    await flight.after(TakeOff(UP_M), Airborne)
    await flight.after(FlyTo((GridPoint(*way[0]),), None, stop=True, height_m=UP_M), Arrived)
    await flight.after(path(flight, *way), Arrived)
    frames = [e for e in flight.seen(FrameSeen) if e.vantage is None]
    assert not flight.seen(FrameLost)
    assert len(frames) > 40
    ahead = 1.0 if towards == "east" else -1.0
    errors_m = []
    for cells, sign in ((WEST, -1.0), (EAST, 1.0)):
        for cell in cells:
            shares = [v.share for f in frames for v in f.votes if v.cell == cell]
            assert len(shares) >= 5
            # distance of the border east of the truth
            errors_m += [sign * (share - 0.5) * CELL_M for share in shares]
    assert max(abs(error) for error in errors_m) < 0.2
    # a pose that is late or early would shift both borders along the track
    assert abs(statistics.fmean(errors_m) * ahead) < 0.1


# --- a vehicle without satellites: its told place leaps, its place does not ----------------------
LAT, LON = 47.3, 8.5
DEG = 1e-5
"""Angle of 1.1 m to the north, degrees."""
OFF = 18.0 * DEG
ESTIMATE = mav.MAV_CMD_EXTERNAL_POSITION_ESTIMATE


@by(on_virtual_time)
async def test_place_of_vehicle_that_takes_an_estimate_does_not_leap():
    """Until the next picture place and targets were off by the autopilot's correction."""
    peer, taken_s = Peer(), list[float]()
    view, loop = peer.session.view, asyncio.get_running_loop()
    peer.session.feed(peer.frame(heartbeat(armed=True)))

    def answer(message):
        if getattr(message, "command", None) == ESTIMATE:
            taken_s.append(loop.time() + 0.05)
            peer.send(ack(ESTIMATE, mav.MAV_RESULT_ACCEPTED), after_s=0.05)

    peer.answer = answer
    places = []

    async def fly():
        """Fly at 6 m/s to the north, with positions 20 m too far north."""
        for n in range(60):
            true = LAT + 0.6 / 111_195.0 * n
            leapt = bool(taken_s) and loop.time() > taken_s[0]
            lat_deg = true + (0.1 * OFF if leapt else OFF)
            message = position(LatLon(lat_deg, LON), t_s=loop.time(), velocity=(600, 0, 0))
            peer.session.feed(peer.frame(message))
            assert view.position is not None
            places.append(distance_m(view.position, LatLon(true, LON)))
            await asyncio.sleep(0.1)

    view.off_deg = (OFF, 0.0)
    flying = asyncio.create_task(fly())
    await asyncio.sleep(2.0)
    here = view.position or LatLon(LAT, LON)
    reporter = Reporter(1, "sim", view, 60.0, Grid.at(here, 4.0), loop.time, loop.time)
    await ControlledCommands(peer.session, Monitor(reporter)).send_external_position_estimate(
        here, 1.0
    )
    await flying
    assert max(places) < 0.2
    assert abs(view.off_deg[0] - 0.1 * OFF) < 0.1 * DEG


@by(on_virtual_time)
async def test_leap_of_a_place_without_an_estimate_is_left_to_the_gate():
    peer = Peer()
    peer.session.feed(peer.frame(heartbeat(armed=True)))
    for n, north in enumerate((0.0, 0.0, 18.0 * DEG)):
        peer.session.feed(peer.frame(position(LatLon(LAT + north, LON), t_s=1.0 + 0.1 * n)))
    assert peer.session.view.off_deg == (0.0, 0.0)
