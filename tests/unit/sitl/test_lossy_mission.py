from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

COUNT = 61  # item 0 is home
RETRIES = 12
GOOD, REFUSED, TIMEOUT = "good", "refused", "timeout"


class Radio:
    """A client that repeats what has no answer, as ground stations do."""

    def __init__(self, client):
        self.client = client
        self.inbox = []

    def say(self, message):
        self.inbox += self.client.send(message)

    def wait(self, kinds, seconds):
        for _ in range(round(seconds / 0.05)):
            while self.inbox:
                message = self.inbox.pop(0)
                if message.get_type() in kinds:
                    return message
            self.inbox += self.client.run(0.05)
        return None

    def upload(self, items):
        last, silent = mav.MAVLink_mission_count_message(1, 1, len(items), 0), 0
        self.say(last)
        while silent < RETRIES:
            m = self.wait(("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"), 1.0)
            if m is None:
                silent += 1
                self.say(last)
            elif m.get_type() == "MISSION_ACK":
                if m.type == mav.MAV_MISSION_INVALID_SEQUENCE:
                    continue  # to a second copy; it goes on asking
                return GOOD if m.type == mav.MAV_MISSION_ACCEPTED else REFUSED
            else:
                silent, last = 0, items[m.seq]
                self.say(last)
        return TIMEOUT

    def ask(self, request, kind, fits):
        for _ in range(RETRIES):
            self.say(request)
            m = self.wait((kind,), 0.5)
            while m is not None and not fits(m):
                m = self.wait((kind,), 0.5)
            if m is not None:
                return m
        return None

    def download(self):
        asked = mav.MAVLink_mission_request_list_message(1, 1, 0)
        count = self.ask(asked, "MISSION_COUNT", lambda m: True)
        if count is None:
            return None
        items = []
        for n in range(count.count):
            asked = mav.MAVLink_mission_request_int_message(1, 1, n, 0)
            item = self.ask(asked, "MISSION_ITEM_INT", lambda m, n=n: m.seq == n)
            if item is None:
                return None
            items.append(item)
        self.say(mav.MAVLink_mission_ack_message(1, 1, mav.MAV_MISSION_ACCEPTED, 0))
        return items


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
    radio = Radio(client)
    ended = radio.upload(survey())
    fetched = radio.download() if ended == GOOD else None
    client.vehicle.fail.clear("link")
    client.run(10.0)  # what is still under way, and the vehicle's own time-out
    return ended, fetched, Radio(client).download()


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("seed", range(3))
def test_a_fifth_lost_each_way_with_jitter(make_client, seed, autopilot):
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
def test_other_bad_radios(make_client, bad):
    ended, fetched, kept = fly_through(make_client, 1, **bad)
    assert ended == GOOD
    assert places(fetched) == places(kept) == places(survey())


def test_late_copies_of_the_count_cost_no_items(ready):
    """The radio holds copies of the count back until the first item has come."""
    radio = Radio(ready)
    begin = mav.MAVLink_mission_count_message(1, 1, COUNT, 0)
    radio.say(begin)
    ready.vehicle.fail.link(delay_s=0.05, way="down")
    ready.vehicle.fail.link(duplicate=1.0, reorder=1.0, way="up", for_s=0.08)
    radio.inbox += ready.run(0.05)
    radio.say(begin)
    radio.inbox += ready.run(0.05)
    items, asked = survey(), []
    while (m := radio.wait(("MISSION_REQUEST", "MISSION_ACK"), 2.0)) is not None:
        if m.get_type() == "MISSION_ACK":
            if m.type == mav.MAV_MISSION_INVALID_SEQUENCE:
                continue
            break
        asked.append(m.seq)
        radio.say(items[m.seq])
    assert m is not None
    assert m.type == mav.MAV_MISSION_ACCEPTED
    assert asked.count(0) == 1
    assert places(radio.download()) == places(items)


@pytest.mark.parametrize("seed", range(3))
def test_a_radio_that_hardly_works_never_says_good_of_a_part(make_client, seed):
    ended, _, kept = fly_through(make_client, seed, loss=0.75, jitter_s=0.1)
    if ended == GOOD:
        assert places(kept) == places(survey())
    else:
        assert ended in (REFUSED, TIMEOUT)


def test_a_link_that_breaks_is_refused_aloud(ready):
    radio = Radio(ready)
    ready.vehicle.fail.link(delay_s=0.1)
    ready.vehicle.fail.link(silent=True, way="up", after_s=3.0)
    assert radio.upload(survey()) == REFUSED  # ACK 15 after 8 s
    assert ready.vehicle.t_s < 20.0
