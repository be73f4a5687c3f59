from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

COUNT = 61  # item 0 is home
GOOD, CANCELLED = mav.MAV_MISSION_ACCEPTED, mav.MAV_MISSION_OPERATION_CANCELLED


def survey():
    made = []
    for n in range(COUNT):
        command = mav.MAV_CMD_NAV_TAKEOFF if n == 1 else mav.MAV_CMD_NAV_WAYPOINT
        lat, lon = 372000000 + 1000 * (n // 8), -804000000 + 1000 * (n % 8)
        made.append(
            mav.MAVLink_mission_item_int_message(
                1, 1, n, 3, command, 0, 1, 0, 0, 0, 0, lat, lon, 10.0 + n, 0
            )
        )
    return made


def places(items):
    return [(m.seq, m.command, m.x, m.y, round(m.z)) for m in items[1:]]  # item 0 is its own home


def fly_through(make_client, seed, autopilot="ardupilot", **bad):
    client = make_client(world={"seed": seed}, autopilot=autopilot)
    client.run(6.0)
    client.vehicle.fail.link(**bad)
    ended = client.transfer(survey())
    fetched = client.fetch() if ended == GOOD else None
    client.vehicle.fail.clear("link")
    client.run(10.0)  # what is still under way, and the vehicle's own time-out
    return ended, fetched, client.fetch()


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("seed", range(3))
def test_mission_with_a_fifth_lost_each_way_arrives_whole(make_client, seed, autopilot):
    ended, fetched, kept = fly_through(make_client, seed, autopilot, loss=0.2, jitter_s=0.1)
    if ended == GOOD:
        assert places(kept) == places(survey())
        assert fetched is None or places(fetched) == places(survey())
    # a client of this patience gets through
    assert ended == GOOD
    assert fetched is not None


@pytest.mark.parametrize(
    "bad",
    [
        {"loss": 0.1, "duplicate": 0.2, "reorder": 0.2, "corrupt": 0.05, "delay_s": 0.2},
        {"delay_s": 0.6, "jitter_s": 0.1},
        {"duplicate": 1.0},
        {"reorder": 0.5},
    ],
)
def test_mission_over_other_bad_radios_arrives_whole(make_client, bad):
    ended, fetched, kept = fly_through(make_client, 1, **bad)
    assert ended == GOOD
    assert places(fetched) == places(kept) == places(survey())


def test_late_copies_of_the_count_cost_no_items(ready):
    """The radio holds copies of the count back until the first item has come."""
    begin = mav.MAVLink_mission_count_message(1, 1, COUNT, 0)
    ready.send(begin)
    ready.vehicle.fail.link(delay_s=0.05, way="down")
    ready.vehicle.fail.link(duplicate=1.0, reorder=1.0, way="up", for_s=0.08)
    ready.run(0.05)
    ready.send(begin)
    ready.run(0.05)
    items, asked = survey(), []
    while (m := ready.unread(("MISSION_REQUEST", "MISSION_ACK"), 2.0)) is not None:
        if m.get_type() == "MISSION_ACK":
            if m.type == mav.MAV_MISSION_INVALID_SEQUENCE:
                continue
            break
        asked.append(m.seq)
        ready.send(items[m.seq])
    assert m is not None
    assert m.type == mav.MAV_MISSION_ACCEPTED
    assert asked.count(0) == 1
    assert places(ready.fetch()) == places(items)


@pytest.mark.parametrize("seed", range(3))
def test_mission_that_arrived_in_part_is_never_acknowledged(make_client, seed):
    ended, _, kept = fly_through(make_client, seed, loss=0.75, jitter_s=0.1)
    assert ended != GOOD or places(kept) == places(survey())


def test_upload_over_a_broken_link_is_refused(ready):
    ready.vehicle.fail.link(delay_s=0.1)
    ready.vehicle.fail.link(silent=True, way="up", after_s=3.0)
    assert ready.transfer(survey()) == CANCELLED  # after 8 s
    assert ready.vehicle.t_s < 20.0
