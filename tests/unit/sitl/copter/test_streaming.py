from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.geo.trajectory import rounded_path
from missions.units import GridPoint

CUT_M = 2.5
SMOOTH_S = 0.5


def lanes(begin_s, speed_m_s, cut_m=CUT_M, **how):
    corners = [(0, 0), (60, 0), (60, 12), (0, 12), (0, 24), (30, 24), (30, 28), (34, 28), (40, 34)]
    points = [GridPoint(*corner) for corner in corners]
    return rounded_path(points, begin_s, speed_m_s=speed_m_s, cut_m=cut_m, **how)


def fly(client, plan, *, lead_s=0.5, until_s=math.inf, smooth_s=SMOOTH_S):
    """Stream a plan at 10 Hz; return the distance to it at each moment from beginning to end."""
    errors = []

    def send():
        t_s = client.vehicle.t_s
        steps = [plan.at(t_s + smooth_s * share) for share in (-0.5, -0.25, 0.0, 0.25, 0.5)]
        weights = (0.125, 0.25, 0.25, 0.25, 0.125)
        place = (
            sum(w * m.east_m for w, m in zip(weights, steps, strict=True)),
            sum(w * m.north_m for w, m in zip(weights, steps, strict=True)),
        )
        ahead_s = t_s + lead_s
        first, last = plan.at(ahead_s - smooth_s / 2), plan.at(ahead_s + smooth_s / 2)
        velocity = (
            (last.east_m - first.east_m) / smooth_s,
            (last.north_m - first.north_m) / smooth_s,
        )
        client.along(place, velocity)

    while client.vehicle.t_s < min(plan.end_s + 4.0, until_s) - 1e-6:
        send()
        for _ in range(2):
            client.run(0.05)
            if plan.begin_s < client.vehicle.t_s < plan.end_s:
                now = plan.at(client.vehicle.t_s)
                east, north, _ = client.where
                errors.append(math.hypot(east - now.east_m, north - now.north_m))
    return sorted(errors)


def within(errors, share=0.95):
    return errors[int(share * len(errors))]


@pytest.fixture
def client(flying):
    return flying


def test_a_rounded_path_with_its_velocity_led_is_followed(client):
    plan = lanes(client.vehicle.t_s + 1.0, 6.0)
    errors = fly(client, plan)
    assert 0.3 < within(errors) <= 0.7  # measured 0.54
    assert sum(errors) / len(errors) < 0.35
    assert client.where == pytest.approx((40.0, 34.0, 12.0), abs=0.2)


def test_a_velocity_that_is_not_led_is_late_by_half_a_second(client):
    errors = fly(client, lanes(client.vehicle.t_s + 1.0, 6.0), lead_s=0.0)
    assert 0.9 < within(errors) < 2.0  # measured 1.7


def test_target_on_raw_corners_runs_away(client):
    plan = lanes(client.vehicle.t_s + 1.0, 6.0, cut_m=0.02, accel_m_s2=1e6)
    errors = fly(client, plan, smooth_s=0.02)
    assert within(errors) > 8.0  # measured 18.6
    assert errors[-1] < 30.0


@pytest.mark.parametrize("timeout_s", [0.5, 1.0, 3.0])
def test_a_stream_that_ends_stops_the_vehicle(client, timeout_s):
    """From 6 m/s 12 and 15 m after 0.5 and 1 s were measured, 27 m by default, then back."""
    client.put(GUID_TIMEOUT=timeout_s)
    plan = rounded_path(
        [GridPoint(0, 0), GridPoint(300, 0)], client.vehicle.t_s + 1.0, speed_m_s=6.0
    )
    fly(client, plan, until_s=plan.begin_s + 10.0)
    begin = client.where[0]
    along = [where[0] - begin for where, _ in client.watch(15.0)]
    expected_m = {0.5: 12.0, 1.0: 15.0, 3.0: 27.0}[timeout_s]
    assert max(along) == pytest.approx(expected_m, abs=2.0)
    assert along[-1] == pytest.approx(6.0 * timeout_s, abs=1.0)
    assert max(along) - along[-1] > 3.0
    assert math.hypot(*client.vehicle.truth.velocity_m_s) < 0.1


@pytest.mark.parametrize(
    ("speed", "time_s", "way_m"), [(3.0, 1.7, 3.1), (6.0, 2.9, 9.8), (10.0, 4.2, 23.9)]
)
def test_velocity_zero_is_the_way_to_stop(client, speed, time_s, way_m):
    for _ in range(90):
        client.velocity(speed, 0.0)
        client.run(0.1)
    begin, begin_s, seen = client.where[0], client.vehicle.t_s, []
    for _ in range(70):
        client.velocity(0.0, 0.0)
        seen += client.watch(0.1)
    along = [where[0] - begin for where, _ in seen]
    stopped_s = next(truth.t_s for _, truth in seen if truth.velocity_m_s[0] < 0.3)
    assert stopped_s - begin_s == pytest.approx(time_s, rel=0.25)
    assert max(along) == pytest.approx(way_m, rel=0.2)
    assert max(along) - along[-1] < 0.5


def test_stream_obeys_no_speed_and_reports_its_target(client):
    client.every(mav.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT, 0.1)
    client.target(0.0, 0.0, 12.0)
    client.result(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 2.0)
    for _ in range(80):
        client.velocity(0.0, 5.0)
        client.run(0.1)
    assert client.vehicle.truth.velocity_m_s[1] == pytest.approx(5.0, abs=0.3)
    assert client.seen("POSITION_TARGET_GLOBAL_INT")[-1].vx == pytest.approx(5.0)
    _, north, _ = client.where
    client.along((0.0, north), (0.0, 1.0))
    client.run(0.2)
    reported = client.seen("POSITION_TARGET_GLOBAL_INT")[-1]
    assert (reported.vx, reported.alt) == pytest.approx((1.0, 612.0), abs=0.5)
    assert reported.type_mask & 0x3F == 0
