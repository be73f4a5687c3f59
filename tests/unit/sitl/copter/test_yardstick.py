"""The recorded flight of a real ArduCopter, flown again here: the same plan, side by side.

Parameters, requested rates and targets are read from the recording; the client flies them closed
loop: it continues to the next target after arrival at rest, as the recorded one did.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.copter.params import Parameters

SHARED = os.environ.get("UAVMAP_SHARED") or Path(__file__).resolve().parents[4] / "../shared"
LOG = Path(SHARED) / "data/arducopter/flight-4.6.tlog"
SETTINGS = ("WPNAV_", "WP_", "PSC_", "RTL_", "LAND_", "ATC_", "DISARM_", "GUID_")
ARRIVED_M, STANDING_M_S = 1.0, 0.15
M_PER_E7 = 0.0111319  # metres a 1e-7 degree of latitude

pytestmark = pytest.mark.skipif(not LOG.exists(), reason="the recorded flight is not here")


def recorded():
    """Return (seconds since the first message, message) of both directions."""
    link = mavutil.mavlink_connection(str(LOG), dialect="ardupilotmega")
    flight, begin_s = [], None
    while (message := link.recv_match()) is not None:
        begin_s = message._timestamp if begin_s is None else begin_s
        flight.append((message._timestamp - begin_s, message))
    link.close()
    return flight


def messages_of(flight, kind, system=1, component=1):
    return [
        (t, m) for t, m in flight
        if m.get_type() == kind and (m.get_srcSystem(), m.get_srcComponent()) == (system, component)
    ]  # fmt: skip


def changes(values):
    values = list(values)
    return values[:1] + [b for a, b in pairwise(values) if a != b]


def story(flight):
    """Return the observations: modes, armed or not, states, texts, rates and times."""
    hearts = [m for _, m in messages_of(flight, "HEARTBEAT")]
    landed = messages_of(flight, "EXTENDED_SYS_STATE")
    armed_s = next(t for t, m in messages_of(flight, "HEARTBEAT") if m.base_mode & 128)
    steady = [m for t, m in flight if armed_s + 15 <= t < armed_s + 55 and m.get_srcSystem() == 1]
    counts = Counter(m.get_type() for m in steady if m.get_srcComponent() == 1)
    grounded_s = [t for (_, a), (t, b) in pairwise(landed) if a.landed_state == 4 > b.landed_state]
    home_s = next(t for t, m in messages_of(flight, "HEARTBEAT") if m.custom_mode == 6)
    return {
        "modes": changes(m.custom_mode for m in hearts),
        "armed": changes(bool(m.base_mode & 128) for m in hearts),
        "landed_state": changes(m.landed_state for _, m in landed),
        "texts": [m.text for t, m in messages_of(flight, "STATUSTEXT") if t > armed_s - 2],
        "rates": {kind: n / 40.0 for kind, n in counts.items()},
        "return_s": grounded_s[0] - home_s,
    }


def fly(client, flight):
    """Fly the recorded plan; return the times of its targets and of the return."""
    for _, m in messages_of(flight, "PARAM_VALUE"):
        if m.param_id in Parameters() and m.param_id.startswith(SETTINGS):
            client.send(mav.MAVLink_param_set_message(1, 1, m.param_id.encode(), m.param_value, 9))
    for _, m in messages_of(flight, "REQUEST_DATA_STREAM", 255, 190):
        client.send(m)
    commands = [m for _, m in messages_of(flight, "COMMAND_LONG", 255, 190)]
    for m in commands:
        if m.command == 511:
            client.send(m)
    client.run(41.5)
    by_number = {m.command: m for m in commands}
    for number in (176, 400, 22):
        assert client.send(by_number[number])[0].result == 0
    begin_s = client.vehicle.t_s
    while client.where[2] < 0.95 * by_number[22].param7:
        client.run(0.2)
    times = {"climb": client.vehicle.t_s - begin_s}
    client.send(by_number[178])
    sent = []
    for _, m in messages_of(flight, "SET_POSITION_TARGET_GLOBAL_INT", 255, 190):
        sent.append(client.vehicle.t_s)
        client.send(m)
        while not stands_at(client.seen("GLOBAL_POSITION_INT")[-1], m):
            client.run(0.2)
            assert client.vehicle.t_s - sent[-1] < 30.0
    sent.append(client.vehicle.t_s)
    client.send(by_number[20])
    while client.vehicle.truth.armed:
        client.run(0.2)
    client.run(3.0)
    return times, [b - a for a, b in pairwise(sent)]


def stands_at(position, target):
    north = (position.lat - target.lat_int) * M_PER_E7
    east = (position.lon - target.lon_int) * M_PER_E7 * math.cos(math.radians(37.2))
    speed = math.hypot(position.vx, position.vy) / 100.0
    return math.hypot(east, north) < ARRIVED_M and speed < STANDING_M_S


def test_the_recorded_flight_flown_again(make_client):
    flight = recorded()
    client = make_client(ready_after_s=41.0)
    times, legs = fly(client, flight)
    real, here = story(flight), story(client.log)
    targets = [t for t, _ in messages_of(flight, "SET_POSITION_TARGET_GLOBAL_INT", 255, 190)]
    home_s = next(t for t, m in messages_of(flight, "COMMAND_LONG", 255, 190) if m.command == 20)
    climb_s = targets[0] - next(
        t for t, m in messages_of(flight, "COMMAND_LONG", 255, 190) if m.command == 22
    )
    real_legs = [b - a for a, b in pairwise([*targets, home_s])]
    assert len(real_legs) == 10
    rows = [
        (f"waypoint {i + 1}", a, b) for i, (a, b) in enumerate(zip(real_legs, legs, strict=True))
    ]
    rows += [
        ("all waypoints", sum(real_legs), sum(legs)),
        ("take-off to 95 %", climb_s, times["climb"]),
        ("return to ground", real["return_s"], here["return_s"]),
    ]
    common = sorted(real["rates"].keys() & here["rates"].keys() - {"HOME_POSITION", "TIMESYNC"})
    assert real["modes"] == here["modes"] == [0, 4, 6]
    assert real["armed"] == here["armed"]
    assert real["landed_state"] == here["landed_state"]
    # boot and filter of the real one send more texts; each text here is also in the recording
    spoken = [text for text in real["texts"] if text in here["texts"]]
    assert spoken == here["texts"] == ["Arming motors", "Disarming motors"]
    for name, a, b in rows:
        assert b == pytest.approx(a, rel=0.1), name
    assert {"GLOBAL_POSITION_INT", "ATTITUDE", "SYS_STATUS", "EXTENDED_SYS_STATE"} <= set(common)
    for kind in common:
        assert here["rates"][kind] == pytest.approx(real["rates"][kind], rel=0.1), kind
