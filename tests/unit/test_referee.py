"""The rules of the referee, on tracks of a few samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from shapely.geometry import Polygon, box

from missions.units import Cell, GridPoint
from tests.referee import FORGIVENESSES, RULES, Bounds, ProductReport, Referee, Sample
from tests.referee.rules import AT_THE_END

HOME = GridPoint(0.0, 0.0)
L_SHAPE = Polygon([(-50, -50), (50, -50), (50, 0), (0, 0), (0, 50), (-50, 50)])


def bounds(**more: object) -> Bounds:
    given = Bounds(box(-50.0, -50.0, 50.0, 50.0), {1: HOME, 2: HOME}, 5.0, 3.0)
    return replace(given, **more)  # type: ignore[arg-type]


def at(t_s: float, east_m: float = 0.0, north_m: float = 0.0, **more: object) -> Sample:
    given = Sample(t_s, GridPoint(east_m, north_m), 10.0, flying=True, wh=50.0)
    return replace(given, **more)  # type: ignore[arg-type]


def referee_of(samples: Sequence[Sample], others: Sequence[Sample] = (), **more: object) -> Referee:
    referee = Referee(bounds(**more))
    tracks = [(1, sample) for sample in samples] + [(2, sample) for sample in others]
    for number, sample in sorted(tracks, key=lambda pair: pair[1].t_s):
        referee.see(number, sample)
    return referee


def kinds(referee: Referee) -> list[str]:
    return [kind for kind, _ in referee.found]


def test_separation_crossing_between_samples_is_seen():
    """At every sample they are at least 20 m apart; half-way they are 3 m apart."""
    one = [at(0.0, -20.0), at(1.0, 20.0)]
    other = [at(0.0, 20.0, 3.0), at(1.0, -20.0, 3.0)]
    referee = referee_of(one, other)
    assert referee.found == [("near", "1.00 s: vehicle 1 and 2 are 3.00 m apart")]
    assert referee.nearest_m == pytest.approx(3.0)


@pytest.mark.parametrize(("late_s", "seen"), [(0.4, True), (1.4, False)])
def test_separation_samples_of_different_times_are_compared_at_the_same_time(late_s, seen):
    one = [at(0.0, 0.0), at(0.8, 8.0)]
    other = [at(late_s, 10.0 * late_s, 1.0), at(late_s + 0.8, 10.0 * late_s + 8.0, 1.0)]
    assert (kinds(referee_of(one, other)) == ["near"]) == seen


def test_separation_least_distance_of_an_encounter_is_kept():
    one = [at(0.1 * k) for k in range(30)]
    other = [at(0.1 * k, 8.0 - 0.4 * k if k < 15 else 0.4 * k - 4.0) for k in range(30)]
    referee = referee_of(one, other)
    assert [text.split(": ")[1] for _, text in referee.found] == [
        "vehicle 1 and 2 are 2.00 m apart"
    ]


def test_separation_counts_heights():
    one, other = [at(0.0), at(1.0)], [at(0.0, up_m=15.5), at(1.0, up_m=15.5)]
    assert kinds(referee_of(one, other)) == []
    assert referee_of(one, other).nearest_m == pytest.approx(5.5)


def test_fence_corner_that_is_cut_between_samples_is_seen():
    referee = referee_of([at(0.0, -10.0, 20.0), at(1.0, 20.0, -10.0)], fence=L_SHAPE)
    assert kinds(referee) == ["breach"]
    assert "5.0 m outside" in referee.found[0][1]


@pytest.mark.parametrize(("ails", "held_s"), [({"blind"}, 50.0), ({"blind"}, 70.0), (set(), 1.0)])
def test_fence_is_forgiven_for_60_s_after_wrong_positions(ails, held_s):
    outside = [at(float(t), 60.0) for t in range(2, 2 + int(held_s))]
    referee = referee_of([at(0.0, 49.0, ails=frozenset(ails)), at(1.0, 49.0), *outside])
    assert kinds(referee) == (["breach"] if held_s > 60.0 or not ails else [])
    assert referee.forgiven["uncontrolled"] == (1 if ails else 0)


@pytest.mark.parametrize(("mode", "found"), [("RTL", []), ("GUIDED", ["breach"])])
def test_fence_is_forgiven_for_an_rtl_after_commands_did_not_arrive(mode, found):
    """Its guardian commanded RTL meanwhile: an RTL is straight, also over a hole."""
    deaf = [at(float(t), 49.0, ails=frozenset({"deaf"})) for t in range(50)]
    referee = referee_of([*deaf, at(50.0, 49.0, mode=mode), at(51.0, 60.0, mode=mode)])
    assert kinds(referee) == found
    assert referee.forgiven["straight return"] == (not found)


@pytest.mark.parametrize(("after_s", "found"), [(5.0, []), (20.0, ["near"])])
def test_separation_is_forgiven_while_others_leave_the_air_of_a_failsafe(after_s, found):
    """A fleet's member returned through the layer of another, 5 s after its failsafe."""
    there = [at(0.0, 30.0), at(0.5, 30.0, mode="RTL", holder="failsafe")]
    passes = [at(t, 2.0, mode="RTL", holder="failsafe") for t in (after_s, after_s + 1.0)]
    referee = referee_of([*there, *passes], [at(float(t)) for t in range(25)])
    assert kinds(referee) == found
    assert referee.forgiven["leaves its air"] == (not found)


def test_pilot_mode_changed_by_the_service_is_seen():
    pilots = at(1.0, mode="LAND", holder="pilot", changes=(("pilot", "LAND"),))
    taken = at(2.0, mode="RTL", changes=(("service", "RTL"),))
    assert kinds(referee_of([at(0.0), pilots, taken])) == ["taken"]
    given_back = at(1.5, mode="GUIDED", changes=(("pilot", ""),))
    assert kinds(referee_of([at(0.0), pilots, given_back, taken])) == []


@pytest.mark.parametrize(
    ("charge", "order", "alone"),
    [("mission", "FlyTo", False), ("mission", "", True), ("others", "", True), ("lost", "", True),
     ("silent", "", False), ("ground", "TakeOff", False), ("ground", "", True), ("", "", False)],
)  # fmt: skip
def test_vehicle_in_the_air_without_responsible_part_is_seen(charge, order, alone):
    samples = [at(float(t), charge=charge, order=order) for t in range(10)]
    assert (kinds(referee_of(samples)) == ["alone"]) == alone


def test_order_for_a_vehicle_of_a_pilot_is_seen():
    referee = referee_of([at(0.0)])
    referee.ordered(1, 0.0, "StandDown", "others", "pilot")
    assert kinds(referee) == []
    referee.ordered(1, 0.0, "FlyTo", "others", "pilot")
    assert kinds(referee) == ["hands off"]


def test_order_for_a_vehicle_that_a_pilot_has_unnoticed_is_seen():
    referee = referee_of([at(float(t), holder="pilot") for t in range(8)])
    referee.ordered(1, 7.0, "FlyTo", "mission", "service")  # given back just now
    assert kinds(referee) == []
    referee.ordered(1, 7.0, "FlyTo", "mission", "pilot")
    assert kinds(referee) == ["hands off"]


def test_energy_below_the_reserve_and_at_zero_is_seen():
    landing = at(1.0, flying=False, up_m=0.0, wh=2.0)
    assert kinds(referee_of([at(0.0), landing])) == ["reserve"]
    assert kinds(referee_of([at(0.0), at(1.0, wh=0.0)])) == ["fell", "reserve"]
    stormy = referee_of([at(-1.0, flying=False), at(0.0, ails=frozenset({"stormy"})), landing])
    assert kinds(stormy) == []
    assert stormy.forgiven == {"not reckoned with": 1}


def test_energy_below_the_reserve_is_seen_before_a_failsafe_of_the_battery_acts():
    failsafe = at(2.0, wh=1.0, mode="RTL", holder="failsafe")
    landing = at(3.0, wh=0.5, flying=False, up_m=0.0)
    referee = referee_of([at(0.0), at(1.0, wh=2.0), failsafe, landing])
    assert referee.found == [("reserve", "1.00 s: vehicle 1 flies with 2.00 Wh, reserve 3")]


def test_crash_that_is_not_reported_is_seen():
    fall = [at(0.5 * k, 20.0, up_m=12.0 - 4.0 * k) for k in range(3)]
    lies = at(1.5, 20.0, up_m=0.0, flying=False, crashed=True)
    for reported, completed, found in (
        ({1}, False, []), (set(), False, ["unreported"]), ({1}, True, ["lie"]),
    ):  # fmt: skip
        referee = referee_of([at(-1.0, 20.0, up_m=12.0), *fall, lies])
        referee.conclude(ProductReport(2.0, completed=completed, reported=frozenset(reported)))
        assert kinds(referee) == found


@pytest.mark.parametrize(
    ("code", "completed", "away_m", "found"),
    [(0, True, 0.0, []), (3, False, 0.0, []), (4, False, 30.0, []), (0, False, 0.0, ["lie"]),
     (3, True, 0.0, ["lie"]), (4, False, 0.0, ["lie"]), (3, False, 9.0, ["away"])],
)  # fmt: skip
def test_exit_code_that_is_not_so_is_seen(code, completed, away_m, found):
    referee = referee_of([at(0.0, away_m, up_m=1.0), at(1.0, away_m, up_m=0.0, flying=False)])
    referee.conclude(ProductReport(2.0, code=code, completed=completed))
    assert kinds(referee) == found


def test_map_that_is_not_the_truth_is_seen():
    owed, more = frozenset({Cell(0, 0), Cell(1, 0)}), frozenset({Cell(5, 5)})
    whole = ProductReport(1.0, completed=True, region=owed, owed=owed, mapped=owed)
    for message, found in (
        (whole, []), (replace(whole, mapped=owed - {Cell(1, 0)}), ["lie"]),
        (replace(whole, mapped=owed | more), ["false"]),
        (replace(whole, lost=["a frame"]), ["lost votes"]),
        (replace(whole, owners="vehicle 1: fence"), ["owner"]),
        (replace(whole, lanes=[(HOME, GridPoint(9.0, 0.0))], frames=[(HOME, 2.0)]), ["lie"]),
    ):  # fmt: skip
        referee = Referee(bounds())
        referee.conclude(message)
        assert kinds(referee) == found


def test_every_forgiveness_is_of_a_rule_that_there_is():
    there = {rule.kind for rule in RULES} | set(AT_THE_END)
    assert {kind for forgiveness in FORGIVENESSES for kind in forgiveness.kinds} <= there
    names = [forgiveness.name for forgiveness in FORGIVENESSES]
    assert len(set(names)) == len(names)


def test_the_page_of_the_referee_has_every_rule_and_every_forgiveness():
    page = (Path(__file__).parents[2] / "docs" / "reference" / "referee.md").read_text("utf-8")
    promises = {rule.kind: rule.promise for rule in RULES} | AT_THE_END
    rows = [f"| {kind} | {promise} |" for kind, promise in promises.items()]
    rows += [f"| {f.name} | {', '.join(f.kinds)} | {f.why} |" for f in FORGIVENESSES]
    assert [row for row in rows if row not in page] == []


def test_vehicle_far_outside_and_one_left_in_the_air_are_seen():
    assert "far" in kinds(referee_of([at(0.0), at(1.0, 400.0)]))
    referee = referee_of([at(0.0, up_m=9.0)])
    referee.conclude(ProductReport(1.0))
    assert kinds(referee) == ["air"]


def test_vehicle_that_is_carried_out_on_the_ground_breaches_the_fence_once_it_flies():
    away = [at(0.5 * k, 40.0 * k, up_m=0.0, flying=False) for k in range(9)]
    referee = referee_of([at(-1.0), *away, at(5.0, 321.0)])
    assert "breach" in kinds(referee)


def test_low_crash_is_a_lie_of_a_complete_flight_where_each_is_noticed():
    lies = [at(0.0, up_m=1.0), at(1.0, up_m=0.0, flying=False, crashed=True)]
    for known, found in ((False, []), (True, ["lie"])):
        referee = referee_of(lies, crash_is_known=known)
        referee.conclude(ProductReport(2.0, completed=True))
        assert kinds(referee) == found


def test_speed_of_an_impact_is_that_of_the_world_where_it_is_recorded():
    slow = [at(0.0, up_m=1.0), at(1.0, up_m=0.0, flying=False)]
    struck = [slow[0], replace(slow[1], down_m_s=5.0)]
    assert [referee_of(seen).memories[1].struck for seen in (slow, struck)] == [False, True]
