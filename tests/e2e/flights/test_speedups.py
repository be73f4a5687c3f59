"""A flight over sockets at a high speed-up, on both autopilots; more: tests.benchmarks.speedups."""

from __future__ import annotations

import pytest

from tests.benchmarks.speedups import flown
from tests.e2e.rig import mission


@pytest.mark.parametrize("autopilot", ["ardupilot"])
def test_at_20_times_real_time_the_mission_is_complete(autopilot):
    flight = flown(mission("speck"), 20.0, autopilot)
    assert (flight.code, flight.summary["completed"]) == (0, True), flight.said
