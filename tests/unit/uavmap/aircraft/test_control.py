"""Control and flight as values: the tables of the page, and rules for any sequence of reports."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.unit.uavmap.aircraft.control_tables import BEGIN, END, PAGE, tables
from uavmap.aircraft.control import LATE_REQUEST_S, AirState, Beat, Control, Holder, Request
from uavmap.mavlink.autopilots import ARDUPILOT, PX4

GUIDED, RTL, LAND, LOITER = 4, 6, 9, 5
FLYING = Control(air=AirState.AIRBORNE, mode=GUIDED, armed=True)


def test_safety_page_holds_the_tables_of_the_module():
    """`python -m tests.unit.uavmap.aircraft.control_tables` writes these tables."""
    page = PAGE.read_text(encoding="utf-8")
    assert page.partition(BEGIN)[2].partition(END)[0].strip() == tables()


def in_air(kind):
    confirmed = Request(kind.follows, 0.0, confirmed=True)
    return Control(air=AirState.AIRBORNE, mode=kind.follows, armed=True, request=confirmed)


@given(
    kind=st.sampled_from([ARDUPILOT, PX4]),
    steps=st.lists(st.tuples(st.booleans(), st.integers(0, 30), st.floats(0.1, 2.0)), max_size=12),
)
def test_control_mode_not_requested_is_never_under_our_control(kind, steps):
    modes = sorted(kind.mode_names)
    control, now_s = in_air(kind), 0.0
    asked, asked_s, seen = kind.follows, 0.0, True
    ever = {kind.follows}
    """Modes since the vehicle was given back."""
    for asks, index, passed_s in steps:
        mode, now_s = modes[index % len(modes)], now_s + passed_s
        before = control
        if asks and control.is_under_control:
            control = control.with_request(mode, now_s)
            asked, asked_s, seen = mode, now_s, mode == before.mode
            ever.add(mode)
            continue
        control = control.with_beat(kind, Beat(mode, True, False, now_s))
        if not control.is_under_control:
            continue
        if not before.is_under_control:  # the vehicle was given back
            asked, ever = kind.follows, {kind.follows}
        elif before.mode in kind.by_itself and mode == kind.follows:
            asked, seen = mode, True
        assert mode in ever | {asked}
        seen = seen or mode == asked
        if seen and now_s - asked_s > LATE_REQUEST_S:
            assert mode == asked


@pytest.mark.parametrize(("after_s", "holder"), [(1.0, Holder.OURS), (4.0, Holder.PILOT)])
def test_control_late_request_is_accepted_for_a_while(after_s, holder):
    control = FLYING.with_request(RTL, 0.0).with_request(LAND, 0.5)
    assert control.with_beat(ARDUPILOT, Beat(RTL, True, False, 0.5 + after_s)).holder is holder
    assert LATE_REQUEST_S == 3.0


@pytest.mark.parametrize(("age_s", "known"), [(0.2, True), (0.4, False)])
def test_control_mode_is_known_well_enough_for_a_fraction_of_a_second(age_s, known):
    told = FLYING.with_beat(ARDUPILOT, Beat(GUIDED, True, False, 5.0))
    assert told.is_mode_known(5.0 + age_s) is known


def test_control_refused_request_leaves_the_mode_before_it():
    control = FLYING.with_request(RTL, 0.0).with_refusal()
    assert control.with_beat(ARDUPILOT, Beat(GUIDED, True, False, 9.0)).holder is Holder.OURS
    assert control.with_beat(ARDUPILOT, Beat(RTL, True, False, 9.0)).holder is Holder.PILOT


@pytest.mark.parametrize(
    ("mode", "resumed", "holder"),
    [
        (GUIDED, False, Holder.OURS),
        (RTL, False, Holder.PILOT),
        (RTL, True, Holder.OURS),
        (LOITER, True, Holder.PILOT),
    ],
)
def test_control_found_in_air_depends_on_the_mode(mode, resumed, holder):
    found = Control(air=AirState.AIRBORNE).with_content(Beat(mode, True, False, 1.0))
    assert found.with_connection(ARDUPILOT, resumed=resumed).holder is holder


STANDS, LANDING = mav.MAV_LANDED_STATE_ON_GROUND, mav.MAV_LANDED_STATE_LANDING
HOLD = PX4.follows


def lands(mode, holder):
    confirmed = Request(mode, 0.0, confirmed=True) if holder is Holder.OURS else None
    return Control(
        air=AirState.LANDING,
        mode=mode,
        armed=True,
        received_s=9.0,
        request=confirmed,
        holder=holder,
    )


@pytest.mark.parametrize("mode", [PX4.rtl, PX4.land])
@pytest.mark.parametrize("holder", [Holder.OURS, Holder.PILOT, Holder.FAILSAFE])
def test_px4_that_disarms_into_hold_is_judged_by_its_heartbeat(mode, holder):
    """CURRENT_MODE reports Hold up to a second before a heartbeat reports the motors off.

    An earlier version counted it as the pilot's mode. After a landing by a pilot or a failsafe it
    counted the vehicle as given back.
    """
    told = lands(mode, holder).with_beat(PX4, Beat(HOLD, True, False, 9.1, STANDS))
    assert told.holder is holder
    assert not told.is_mode_known(9.1)  # and no mode is commanded before that
    assert told.with_beat(PX4, Beat(HOLD, False, False, 9.9)).holder is holder


@pytest.mark.parametrize("mode", [PX4.rtl, PX4.land])
def test_control_pilots_hold_in_a_landing_counts_at_once_until_a_heartbeat(mode):
    ours = lands(mode, Holder.OURS)
    assert ours.with_beat(PX4, Beat(HOLD, True, False, 9.1, LANDING)).holder is Holder.PILOT
    told = lands(mode, Holder.PILOT).with_beat(PX4, Beat(HOLD, True, False, 9.1, LANDING))
    assert told.holder is Holder.PILOT
    assert told.with_beat(PX4, Beat(HOLD, True, False, 9.9)).holder is Holder.OURS


def test_another_mode_in_current_mode_is_the_pilots_at_once():
    flying = replace(lands(PX4.stream_mode, Holder.OURS), air=AirState.AIRBORNE)
    for mode in (HOLD, 3 << 16, PX4.rtl):
        for state in (STANDS, LANDING):
            assert flying.with_beat(PX4, Beat(mode, True, False, 9.1, state)).holder is Holder.PILOT
