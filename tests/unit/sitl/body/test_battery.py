"""What moves the battery's voltage."""

from __future__ import annotations

from itertools import pairwise

from sitl.body.battery import Battery


def test_each_of_these_moves_the_voltage():
    battery = Battery(10.0)
    seen = [battery.voltage_v]
    for happens in (
        lambda: battery.draw(300.0, 5.0),
        lambda: battery.draw(0.0, 5.0),
        lambda: battery.disturb(sag_v=1.0, set_v=0.0),
        battery.fail_cell,
        lambda: battery.disturb(sag_v=0.0, set_v=20.0),
        lambda: battery.disturb(sag_v=0.0, set_v=0.0),
        battery.swap,
    ):
        happens()
        seen.append(battery.voltage_v)
    assert all(a != b for a, b in pairwise(seen))
    assert seen[-1] == seen[0]
