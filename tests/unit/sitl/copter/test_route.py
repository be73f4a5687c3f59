from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.unit.sitl.conftest import plain_vehicle, speed_m_s

ARM, MODE, START = 400, 176, 300
AUTO, GUIDED, RTL, BRAKE = 3, 4, 6, 17
WP, TAKEOFF, HOME, LAND = 16, 22, 20, 21
PAUSED, ACTIVE, COMPLETE = 4, 3, 5


class Planner:
    def __init__(self, client):
        self.client = client

    def upload(self, *rows):
        self.client.upload([(WP, 6, (), (0.0, 0.0), 0.0), *rows])  # item 0 is home

    def begin(self):
        assert self.client.result(MODE, 1, GUIDED) == 0
        assert self.client.result(ARM, 1) == 0
        assert self.client.result(MODE, 1, AUTO) == 0
        assert self.client.result(START) == 0

    @property
    def reached(self):
        return [m.seq for m in self.client.seen("MISSION_ITEM_REACHED")]

    @property
    def current(self):
        return self.client.command(512, 42)[-1]


@pytest.fixture
def client(ready):
    return ready


@pytest.fixture
def planner(client):
    return Planner(client)


def row(command, *p, at=(None, None, 0.0)):
    return command, 6, p, None if at[0] is None else at[:2], at[2]


UP = row(TAKEOFF, at=(None, None, 10.0))


def test_mission_is_flown_from_take_off_to_the_ground(client, planner):
    planner.upload(
        UP,
        row(WP, at=(20.0, 0.0, 10.0)),
        row(82, at=(20.0, 20.0, 15.0)),
        row(WP, 3.0, at=(0.0, 20.0, 15.0)),
        row(HOME),
    )
    assert (planner.current.total, planner.current.mission_state) == (5, 2)
    planner.begin()
    visited = client.watch(90.0)
    truth = client.vehicle.truth
    assert planner.reached == [1, 2, 3, 4, 5]
    for goal in ((20, 0, 10), (20, 20, 15), (0, 20, 15)):
        assert min(math.dist(goal, place) for place, _ in visited) < 2.0
    assert truth.landed
    assert not truth.armed
    assert math.hypot(*client.where[:2]) < 0.5
    assert client.seen("HEARTBEAT", 1)[-1].custom_mode == AUTO
    assert planner.current.mission_state == COMPLETE
    times = [t for t, m in client.log if m.get_type() == "MISSION_ITEM_REACHED"]
    assert times[3] - times[2] > 3.0
    assert client.texts[:4] == [
        "Flight plan received", "Arming motors", "Mission: 1 Takeoff", "Mission: 2 WP",
    ]  # fmt: skip


def test_auto_is_refused_with_a_reason(client, planner):
    refused = client.command(MODE, 1, AUTO)
    assert refused[0].result == 4
    assert refused[1].text == "Mode change to AUTO failed: no mission"
    assert client.result(START) == 4  # not armed
    planner.upload(row(WP, at=(5.0, 5.0, 5.0)))
    assert client.result(MODE, 1, AUTO) == 0
    assert client.command(ARM, 1)[1].text == "Arm: AUTO mode not armable"
    client.command(MODE, 1, GUIDED)
    assert client.result(ARM, 1) == 0
    # on the ground, armed, and the first item is no take-off
    assert (
        client.command(MODE, 1, AUTO)[1].text == "Mode change to AUTO failed: Missing Takeoff Cmd"
    )
    assert client.result(START) == 4
    assert client.result(START, 2, 3) == 2
    client.result(ARM, 0)
    client.put(AUTO_OPTIONS=1)
    assert client.result(MODE, 1, AUTO) == 0
    assert client.result(ARM, 1) == 0
    assert client.command(START)[1].text == "Auto: Missing Takeoff Cmd"


def test_auto_waits_on_the_ground_for_the_start(client, planner):
    planner.upload(UP, row(WP, at=(5.0, 5.0, 10.0)))
    client.command(MODE, 1, GUIDED)
    client.command(ARM, 1)
    assert client.result(MODE, 1, AUTO) == 0
    client.run(5.0)
    assert client.where[2] == 0.0
    client.run(7.0)
    assert not client.vehicle.truth.armed  # and disarms itself
    client.put(AUTO_OPTIONS=3)
    assert client.result(ARM, 1) == 0
    assert client.result(START) == 0
    client.run(20.0)
    assert client.where == pytest.approx((5.0, 5.0, 10.0), abs=0.3)
    assert planner.current.mission_state == COMPLETE  # the end of a mission in the air: stay


def test_mission_in_flight_is_left_and_resumed(client, planner):
    planner.upload(UP, row(WP, at=(0.0, 40.0, 10.0)), row(WP, at=(40.0, 40.0, 10.0)))
    planner.begin()
    client.run(12.0)
    client.command(MODE, 1, BRAKE)
    assert (planner.current.seq, planner.current.mission_state) == (2, PAUSED)
    client.run(5.0)
    where = client.where
    assert 3.0 < where[1] < 35.0
    assert client.result(MODE, 1, AUTO) == 0
    client.run(20.0)
    assert planner.reached == [1, 2, 3]
    client.put(MIS_RESTART=1)
    client.command(MODE, 1, BRAKE)
    client.command(MODE, 1, AUTO)
    client.run(1.0)
    assert planner.reached == [1, 2, 3, 1]  # again: it is as high as the take-off commands
    assert planner.current.seq == 2


def test_set_current_changes_the_next_item(client, planner):
    planner.upload()
    assert client.send(mav.MAVLink_mission_set_current_message(1, 1, 0)) == []
    planner.upload(UP, row(WP, at=(0.0, 40.0, 10.0)), row(WP, at=(30.0, 0.0, 10.0)))
    assert client.send(mav.MAVLink_mission_set_current_message(1, 1, 9)) == []
    assert client.result(224, 9) == 4
    planner.begin()
    client.run(9.0)
    answer = client.send(mav.MAVLink_mission_set_current_message(1, 1, 3))[0]
    assert (answer.get_type(), answer.seq) == ("MISSION_CURRENT", 3)
    client.run(10.0)
    assert client.where[0] == pytest.approx(30.0, abs=0.3)
    assert client.result(224, 2) == 0


def test_items_on_the_way_set_speed_yaw_and_camera(client, planner):
    planner.upload(
        UP,
        row(178, 1.0, 2.0),
        row(115, 180.0),
        row(115, 10.0, 0.0, 1.0, 1.0),
        row(115, 10.0, 0.0, -1.0, 1.0),
        row(2001),
        row(203),
        row(WP, at=(0.0, 20.0, 10.0)),
        row(2000, 0.0, 1.0, 3.0),
        row(19, 5.0, at=(0.0, 21.0, 10.0)),
        row(205, 1.0),
        row(LAND),
    )
    planner.begin()
    truths = [truth for _, truth in client.watch(60.0)]
    yaws = [abs(math.remainder(truth.yaw_rad, math.tau)) for truth in truths]
    assert max(map(speed_m_s, truths)) == pytest.approx(2.0, abs=0.2)
    assert max(yaws) == pytest.approx(math.pi, abs=0.1)
    assert len(client.seen("CAMERA_IMAGE_CAPTURED")) == 4
    assert client.vehicle.truth.landed
    assert planner.reached == [1, 8, 10, 12]
    assert "Mission: 11 MountControl has no effect" in client.texts
    times = {m.seq: t for t, m in client.log if m.get_type() == "MISSION_ITEM_REACHED"}
    assert times[10] - times[8] > 5.0


def test_pictures_by_distance_are_taken(client, planner):
    planner.upload(UP, row(206, 5.0), row(WP, at=(0.0, 31.0, 10.0)), row(206, 0.0), row(HOME))
    planner.begin()
    client.run(40.0)
    assert len(client.seen("CAMERA_IMAGE_CAPTURED")) in (6, 7)


def test_jumps_are_counted(client, planner):
    planner.upload(
        UP,
        row(WP, at=(0.0, 5.0, 10.0)),
        row(WP, at=(5.0, 5.0, 10.0)),
        row(177, 2.0, 2.0),
        row(LAND),
    )
    planner.begin()
    client.run(70.0)
    assert planner.reached == [1, 2, 3, 2, 3, 2, 3, 5]


def test_endless_jumps_end(planner):
    planner.upload(UP, row(177, 2.0, -1.0))
    planner.begin()
    planner.client.run(15.0)
    assert planner.current.mission_state == COMPLETE


def test_conditions_hold_back_the_items_that_follow(client, planner):
    planner.upload(
        UP, row(112, 4.0), row(203), row(114, 10.0), row(203), row(WP, at=(0.0, 60.0, 10.0))
    )
    planner.begin()
    at = []

    def watch():
        at.append((client.vehicle.t_s, client.where[1], len(client.seen("CAMERA_IMAGE_CAPTURED"))))

    client.run(25.0, watch)
    begun = next(t for t, m in client.log if getattr(m, "text", "") == "Mission: 6 WP")
    first = next(t for t, _, n in at if n == 1)
    second = next(north for _, north, n in at if n == 2)
    assert first - begun == pytest.approx(4.0, abs=0.2)
    assert second == pytest.approx(50.0, abs=0.8)  # the place of the next step, at speed


def test_pause_in_auto_holds_until_continued(client, planner):
    planner.upload(UP, row(WP, at=(0.0, 40.0, 10.0)))
    assert client.result(193, 0) == 4
    planner.begin()
    client.run(12.0)
    assert client.result(193, 0) == 0
    assert planner.current.mission_state == PAUSED
    assert client.result(193, 0) == 4
    client.run(6.0)
    where = client.where
    client.run(4.0)
    assert client.where == pytest.approx(where, abs=0.2)
    assert client.result(193, 1) == 0
    assert client.result(193, 1) == 4
    client.run(15.0)
    assert client.where[1] == pytest.approx(40.0, abs=0.3)
    assert planner.reached == [1, 2]


def test_delivery_lands_waits_and_returns(client, planner):
    planner.upload(UP, row(LAND, at=(0.0, 20.0, 0.0)), row(93, 3.0), UP, row(HOME))
    planner.begin()
    seen = client.watch(130.0)
    assert any(truth.landed and truth.armed and where[1] > 19.0 for where, truth in seen)
    assert planner.reached == [1, 2, 3, 4, 5]
    assert not client.vehicle.truth.armed
    assert math.hypot(*client.where[:2]) < 0.5


def test_a_running_mission_is_not_cleared(client, planner):
    planner.upload(UP, row(WP, at=(0.0, 40.0, 10.0)))
    planner.begin()
    client.run(5.0)
    (ack,) = client.send(mav.MAVLink_mission_clear_all_message(1, 1, 0))
    assert ack.type == mav.MAV_MISSION_ERROR
    # replaced by a shorter one while it is flown
    planner.upload(row(WP, at=(0.0, 10.0, 10.0)))
    client.run(20.0)
    assert client.vehicle.truth.armed
    assert planner.current.mission_state == COMPLETE


def test_return_to_a_rally_point(client, planner):
    client.upload([(5100, 3, (), (60.0, 0.0), 10.0)], kind=2)
    client.take_off()
    client.target(50.0, 0.0, 12.0)
    client.run(14.0)
    client.command(MODE, 1, RTL)
    client.run(60.0)
    assert client.vehicle.truth.landed
    assert client.where[0] == pytest.approx(60.0, abs=0.3)


_NUMBER = st.one_of(
    st.floats(-1e9, 1e9, width=32), st.sampled_from([0.0, 1.0, -1.0, 2.0, 3.4e38, -3.4e38])
)


@settings(max_examples=25)
@given(
    rows=st.lists(
        st.tuples(
            st.sampled_from([16, 17, 19, 20, 21, 22, 82, 93, 112, 114, 115, 177, 178, 203, 206, 207,
                             2000, 2001, 205]),
            st.tuples(*[_NUMBER] * 4),
            st.integers(-900000000, 900000000), st.integers(-1800000000, 1800000000),
            st.floats(-80000, 80000, width=32), st.sampled_from([0, 3, 5, 6, 10, 11]),
        ),
        max_size=10,
    )
)  # fmt: skip
def test_any_mission_leaves_a_sane_vehicle(rows):
    vehicle = plain_vehicle()
    vehicle.step(6.0)
    link = mav.MAVLink(None, 255, 190)
    rows = [(16, (0.0,) * 4, 0, 0, 0.0, 0), (22, (0.0,) * 4, 0, 0, 8.0, 3), *rows]
    vehicle.receive(mav.MAVLink_mission_count_message(1, 1, len(rows)).pack(link))
    for seq, (command, p, x, y, z, frame) in enumerate(rows):
        m = mav.MAVLink_mission_item_int_message(1, 1, seq, frame, command, 0, 1, *p, x, y, z)
        vehicle.receive(m.pack(link))
    for command, p1, p2 in ((176, 1, 4), (400, 1, 0), (300, 0, 0)):
        m = mav.MAVLink_command_long_message(1, 1, command, 0, p1, p2, 0, 0, 0, 0, 0)
        vehicle.receive(m.pack(link))
    vehicle.receive(mav.MAVLink_command_long_message(1, 1, 511, 0, 42, 1e5, *[0] * 5).pack(link))
    vehicle.step(20.0)
    truth = vehicle.truth
    assert all(map(math.isfinite, (*truth.velocity_m_s, truth.height_m, truth.yaw_rad)))
    assert math.hypot(*truth.velocity_m_s) < 60.0
