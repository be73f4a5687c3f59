"""The battery's voltage, however often it was asked for in between."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from sitl.body.battery import Battery

happenings = st.one_of(
    st.tuples(st.just("draw"), st.floats(0.0, 900.0), st.floats(0.0, 60.0)),
    st.tuples(st.just("disturb"), st.floats(0.0, 5.0), st.sampled_from([0.0, 20.0])),
    st.sampled_from([("swap",), ("fail_cell",)]),
)


def happen(battery, kind, *numbers):
    if kind == "disturb":
        battery.disturb(sag_v=numbers[0], set_v=numbers[1])
    else:
        getattr(battery, kind)(*numbers)


@given(st.lists(happenings, max_size=20))
def test_asking_changes_nothing(events):
    asked, unasked = Battery(10.0), Battery(10.0)
    for event in events:
        happen(asked, *event)
        happen(unasked, *event)
        assert asked.voltage_v > 0.0
    assert asked.voltage_v == unasked.voltage_v
    assert (asked.energy_wh, asked.consumed_mah) == (unasked.energy_wh, unasked.consumed_mah)


def test_each_of_these_moves_the_voltage():
    battery = Battery(10.0)
    seen = [battery.voltage_v]
    for event in (("draw", 300.0, 5.0), ("draw", 0.0, 5.0), ("disturb", 1.0, 0.0), ("fail_cell",),
                  ("disturb", 0.0, 20.0), ("disturb", 0.0, 0.0), ("swap",)):  # fmt: skip
        happen(battery, *event)
        seen.append(battery.voltage_v)
    assert all(a != b for a, b in pairwise(seen))
    assert seen[-1] == seen[0]
