"""Whole flights with other aircraft on the wire: the team avoids them, continues and maps all."""

from __future__ import annotations

import pytest

from tests.support.scenarios import scenario

ABEAM = """
[[sim.traffic]]                         # passes 700 m north of the start
position = [47.3063, 8.5150]
height_m = 100.0
toward_deg = 270.0
speed_m_s = 50.0
at_s = 14.0
name = "ABEAM"
"""
OVERHEAD = """
[[sim.traffic]]                         # flies over the start
position = [47.2890, 8.5000]
height_m = 90.0
speed_m_s = 40.0
at_s = 14.0
kind = "utm"
"""


@pytest.mark.parametrize(
    ("autopilot", "intruder", "answer"),
    [
        ("ardupilot", ABEAM, "vehicles hold"),
        ("px4", OVERHEAD, "vehicles come home"),
    ],
)
def test_intruder_that_passes_delays_a_flight_and_no_more(autopilot, intruder, answer):
    flight = scenario(autopilot, change=lambda text: text + intruder)
    assert flight.code == 0
    assert answer in flight.stderr
    assert "no traffic is near any more" in flight.stderr
    assert flight.kinds["traffic_seen"] > 5
    assert flight.columns >= {"home"}
    assert (flight.kinds["order_failed"], flight.kinds["guarded"]) == (0, 0)
