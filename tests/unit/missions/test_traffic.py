"""A team holds for aircraft of others, comes home, and continues."""

import math

from hypothesis import given
from hypothesis import strategies as st

from missions.traffic import (
    CLEAR_AFTER_S,
    LOOK_AHEAD_S,
    MAX_TRACK_AGE_S,
    MAX_TRACKS,
    Answer,
    Place,
    Rule,
    Track,
    Traffic,
)
from missions.units import GridPoint

RULE = Rule(1000.0, 300.0)
TEAM = [Place(GridPoint(0.0, 0.0), 12.0)]


def track(east_m, north_m, velocity_m_s=(0.0, 0.0), *, height_m=100.0, seen_s=0.0, ident="A"):
    velocity = None if velocity_m_s is None else GridPoint(*velocity_m_s)
    return Track(ident, ident, seen_s, GridPoint(east_m, north_m), height_m, 100.0, velocity)


def answer(*tracks, t_s=0.0, rule=RULE, team=TEAM):
    return Traffic().with_tracks(tracks).with_answer(rule, team, t_s).answer


def test_traffic_far_away_changes_nothing():
    assert answer(track(0.0, 1001.0)) is Answer.GO_ON


def test_traffic_that_passes_abeam_has_the_team_hold():
    assert answer(track(700.0, 700.0, (-40.0, 0.0))) is Answer.HOLD


def test_traffic_that_leads_close_brings_the_team_home():
    assert answer(track(0.0, 990.0, (0.0, -20.0))) is Answer.COME_HOME


def test_traffic_that_leads_close_only_after_a_minute_has_the_team_hold():
    slow_m_s = 490.0 / (LOOK_AHEAD_S + 1.0)
    assert answer(track(0.0, 990.0, (0.0, -slow_m_s))) is Answer.HOLD


def test_traffic_of_unknown_velocity_counts_as_leading_close():
    assert answer(track(0.0, 990.0, None)) is Answer.COME_HOME


def test_traffic_beyond_the_band_and_the_error_of_its_height_changes_nothing():
    assert answer(track(0.0, 100.0, height_m=413.0)) is Answer.GO_ON
    assert answer(track(0.0, 100.0, height_m=411.0)) is Answer.COME_HOME
    assert answer(track(0.0, 100.0, height_m=-389.0)) is Answer.GO_ON


def test_traffic_of_unknown_height_counts_as_within_the_band():
    assert answer(track(0.0, 800.0, height_m=None)) is Answer.HOLD


def test_traffic_that_is_silent_is_followed_then_expires():
    flies = track(0.0, 2500.0, (0.0, -100.0))
    assert answer(flies, t_s=10.0) is Answer.GO_ON
    assert answer(flies, t_s=16.0) is Answer.COME_HOME
    assert answer(flies, t_s=MAX_TRACK_AGE_S + 0.1) is Answer.GO_ON


def test_team_goes_on_some_time_after_the_traffic():
    held = Traffic().with_tracks([track(0.0, 900.0, (0.0, 50.0))]).with_answer(RULE, TEAM, 0.0)
    gone = held.with_tracks([track(0.0, 1100.0, (0.0, 50.0), seen_s=4.0)])
    assert gone.with_answer(RULE, TEAM, CLEAR_AFTER_S - 0.1).answer is Answer.HOLD
    assert gone.with_answer(RULE, TEAM, CLEAR_AFTER_S + 0.1).answer is Answer.GO_ON


def test_distance_of_zero_shows_traffic_and_does_nothing():
    shown = Traffic().with_tracks([track(0.0, 1.0, None)]).with_answer(Rule(0.0, 300.0), TEAM, 0.0)
    assert (len(shown.tracks), shown.answer) == (1, Answer.GO_ON)


def test_ignored_traffic_holds_no_vehicle_and_another_does():
    held = Traffic().with_tracks([track(0.0, 900.0, (0.0, 50.0))]).with_answer(RULE, TEAM, 0.0)
    free = held.ignoring().with_answer(RULE, TEAM, 1.0)
    assert free.answer is Answer.GO_ON
    other = free.with_tracks([track(0.0, 900.0, (0.0, 50.0), ident="B")]).with_answer(
        RULE, TEAM, 1.0
    )
    assert (other.answer, other.because) == (Answer.HOLD, "B")


def test_older_report_does_not_replace_a_newer_one():
    known = Traffic().with_tracks([track(0.0, 900.0, seen_s=5.0)])
    assert known.with_tracks([track(0.0, 5000.0, seen_s=4.0)]).tracks == known.tracks


FINITE = st.floats(-30_000.0, 30_000.0, allow_nan=False).map(lambda m: round(m, 1))
TRACKS = st.builds(
    Track,
    st.sampled_from("ABC"),
    st.text(max_size=9),
    st.floats(0.0, 60.0).map(lambda s: round(s, 1)),
    st.builds(GridPoint, FINITE, FINITE),
    st.none() | FINITE,
    st.floats(0.0, 300.0),
    st.none() | st.builds(GridPoint, st.floats(-600.0, 600.0), st.floats(-600.0, 600.0)),
)
SEEN = st.lists(st.tuples(st.floats(0.0, 60.0), st.lists(TRACKS, max_size=4)), max_size=6)


@given(SEEN)
def test_any_traffic_is_answered_and_releases_the_team_afterwards(reports):
    traffic = Traffic()
    for t_s, tracks in sorted(reports, key=lambda report: report[0]):
        traffic = traffic.with_tracks(tracks).with_answer(RULE, TEAM, t_s)
        assert all(t_s - known.seen_s <= MAX_TRACK_AGE_S for known in traffic.tracks)
        assert bool(traffic.because) <= bool(traffic.answer)
    end_s = 60.0 + MAX_TRACK_AGE_S + 0.1
    last = traffic.with_answer(RULE, TEAM, end_s).with_answer(RULE, TEAM, end_s + CLEAR_AFTER_S)
    assert last.answer is Answer.GO_ON
    assert last.with_answer(RULE, TEAM, math.inf) is last


def test_flood_leaves_the_nearest():
    many = [track(float(k), 0.0, ident=str(k)) for k in range(3 * MAX_TRACKS, 0, -1)]
    kept = Traffic().with_tracks(many).tracks
    assert [one.ident for one in kept] == [str(k) for k in range(1, MAX_TRACKS + 1)]


def test_traffic_that_was_ignored_and_comes_back_counts_anew():
    near = track(0.0, 900.0, None)
    ignored = Traffic().with_tracks([near]).with_answer(RULE, TEAM, 0.0).ignoring()
    assert ignored.with_answer(RULE, TEAM, 1.0).answer is Answer.GO_ON
    gone = ignored.with_answer(RULE, TEAM, MAX_TRACK_AGE_S + 1.0)
    again = gone.with_tracks([near._replace(seen_s=100.0)]).with_answer(RULE, TEAM, 100.0)
    assert again.answer is Answer.COME_HOME
