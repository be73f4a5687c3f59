"""The guardian's rules, one situation at a time: what it sees, and the rung that follows."""

from __future__ import annotations

from dataclasses import replace

import pytest

from missions.geo.course import Course
from missions.geo.fence import Fence
from missions.geo.trajectory import rounded_path
from missions.guardian import OFF_PLAN_M, Guard, Limits, Seen, Task, Verdict, landing_wh, watch
from missions.mission.energy import EnergyModel
from missions.units import GridPoint

HOME = GridPoint(0.0, 0.0)
FAR = GridPoint(60.0, 0.0)
ENERGY = EnergyModel(
    hover_power_w=300.0, capacity_wh=60.0, reserve=0.15, speed_m_s=5.0, wind_m_s=3.0
)
LIMITS = Limits(
    Fence.of(
        [GridPoint(-50, -50), GridPoint(100, -50), GridPoint(100, 50), GridPoint(-50, 50)],
        holes=[],
        margin_m=2.0,
    ),
    ENERGY,
)
IN_AIR = Seen(0.0, HOME, 12.0, 0.0, HOME, True, True, "follow", 50.0)


class Watched:
    """A guard fed once a second, and the verdicts that came."""

    def __init__(self, task: Task, seen: Seen = IN_AIR) -> None:
        self.seen = seen
        self.guard = Guard().told(task)
        self.verdicts: list[tuple[float, Verdict]] = []
        self.look()

    def look(self, **changes: object) -> Verdict | None:
        self.seen = replace(self.seen, **changes)  # type: ignore[arg-type]
        self.guard, verdict = watch(LIMITS, self.guard, self.seen)
        if verdict is not None:
            self.verdicts.append((self.seen.t_s, verdict))
        return verdict

    def pass_time(self, seconds: int, **each: float) -> list[str]:
        """Seconds go by; place and height change by so much in each."""
        before = len(self.verdicts)
        for _ in range(seconds):
            here = self.seen.position
            self.look(
                t_s=self.seen.t_s + 1.0,
                position=GridPoint(
                    here.east_m + each.get("east_m", 0.0), here.north_m + each.get("north_m", 0.0)
                ),
                height_m=max(self.seen.height_m + each.get("height_m", 0.0), 0.0),
            )
        return [verdict.rung for _, verdict in self.verdicts[before:]]


def leg(*, homeward: bool = False, since_s: float = 0.0) -> Task:
    path = (FAR, HOME) if homeward else (HOME, FAR)
    return Task("leg", since_s, path, homeward, 12.0, estimate_s=16.0, name="FlyTo")


def hold() -> Task:
    return Task("hold", 0.0, (HOME,), False, 12.0, name="Look")


def test_a_leg_that_is_flown_is_left_alone() -> None:
    watched = Watched(leg())
    assert watched.pass_time(12, east_m=5.0) == []
    watched.guard = watched.guard.told(Task("hold", 12.0, (FAR,), False, 12.0))
    assert watched.pass_time(600) == []


def test_no_progress_is_told_once_and_then_climbs_the_ladder() -> None:
    watched = Watched(leg())
    assert watched.pass_time(15) == []
    assert watched.pass_time(2) == ["report"]
    assert watched.pass_time(4) == []
    assert watched.pass_time(2) == ["rtl"]


def test_a_new_order_after_the_report_begins_anew() -> None:
    watched = Watched(leg())
    watched.pass_time(17)
    home = Task("leg", 17.0, (HOME, GridPoint(-40.0, 0.0)), True, 12.0, estimate_s=16.0)
    watched.guard = watched.guard.told(home)
    assert watched.pass_time(14) == []
    assert watched.pass_time(3) == ["rtl"], "on the way home there is nobody to tell"


def test_a_leg_that_crawls_takes_too_long() -> None:
    watched = Watched(leg())
    assert watched.pass_time(67, east_m=0.6) == []
    assert "report" in watched.pass_time(3, east_m=0.6)


def test_who_is_off_its_way_is_told_of() -> None:
    watched = Watched(leg())
    assert watched.pass_time(3, north_m=5.0, east_m=5.0) == []
    assert watched.pass_time(12, east_m=3.0) == ["report"]
    assert "off its way" in watched.verdicts[0][1].reason


def test_a_drift_of_the_goal_is_allowed_for() -> None:
    task = replace(hold(), drift_m_s=0.5)
    watched = Watched(task)
    assert watched.pass_time(60, east_m=0.5) == []
    assert Watched(hold()).pass_time(60, east_m=0.5) != []


def test_the_wind_of_which_the_autopilot_knows_lands_it() -> None:
    watched = Watched(hold(), replace(IN_AIR, wind_m_s=13.0))
    assert watched.pass_time(2, east_m=4.0) == []
    assert watched.pass_time(2, east_m=4.0) == ["land"]
    assert "wind" in watched.verdicts[0][1].reason


def test_a_hopeless_wind_lands_it_before_it_is_carried_away() -> None:
    assert Watched(hold(), replace(IN_AIR, wind_m_s=18.5)).verdicts[0][1].rung == "land"


def test_a_strong_wind_that_it_holds_is_no_reason() -> None:
    assert Watched(hold(), replace(IN_AIR, wind_m_s=12.5)).pass_time(60) == []


def test_receding_outside_of_the_fence_lands_it_at_once() -> None:
    watched = Watched(hold(), replace(IN_AIR, position=GridPoint(-40.0, 0.0)))
    watched.pass_time(7, east_m=-5.0)
    assert [verdict.rung for _, verdict in watched.verdicts][-1] == "land"
    assert watched.seen.t_s <= 7.0


def test_a_new_order_does_not_hide_that_it_is_carried_away() -> None:
    watched = Watched(leg())
    watched.pass_time(3, east_m=-4.0)
    watched.guard = watched.guard.told(Task("hold", 3.0, (watched.seen.position,), False, 12.0))
    assert watched.pass_time(3, east_m=-4.0) == ["report"]


def test_a_climb_must_stay_over_its_pad() -> None:
    climb = Task("climb", 0.0, (HOME,), False, 12.0, name="TakeOff")
    watched = Watched(climb, replace(IN_AIR, height_m=3.0))
    assert watched.pass_time(6, height_m=1.0) == []
    assert watched.pass_time(5, height_m=0.5, east_m=4.0) == ["report"]


def test_lost_height_is_noticed() -> None:
    watched = Watched(leg())
    watched.pass_time(2, east_m=5.0)
    assert "report" in watched.pass_time(6, east_m=5.0, height_m=-1.5)
    assert "lost height" in watched.verdicts[0][1].reason


# --- the return ------------------------------------------------------------------------------
def returning(seen: Seen) -> Watched:
    watched = Watched(leg(homeward=True), seen)
    watched.guard = watched.guard.acting("rtl", 0.0)
    return watched


def test_a_return_that_is_flown_is_left_alone() -> None:
    watched = returning(replace(IN_AIR, position=FAR, mode="rtl"))
    assert watched.pass_time(12, height_m=1.5) == []
    assert watched.pass_time(12, east_m=-5.0) == []
    assert watched.pass_time(58, height_m=-0.5) == []


def test_a_return_without_progress_ends_in_a_landing() -> None:
    watched = returning(replace(IN_AIR, position=FAR, mode="rtl", height_m=30.0))
    assert watched.pass_time(15) == []
    assert watched.pass_time(3) == ["land"]


def test_a_return_that_is_not_taken_ends_in_a_landing() -> None:
    watched = returning(replace(IN_AIR, mode="follow"))
    assert watched.pass_time(14) == []
    assert watched.pass_time(2) == ["land"]


def test_what_it_has_taken_over_no_order_takes_back() -> None:
    watched = returning(replace(IN_AIR, mode="rtl"))
    assert watched.guard.told(leg()).action == "rtl"
    assert watched.guard.released().action is None


# --- energy ----------------------------------------------------------------------------------
@pytest.mark.parametrize("task", [leg(), hold(), Task("land", 0.0, (HOME,), True, 12.0)])
def test_with_the_last_energy_for_it_it_lands(task: Task) -> None:
    """Also one that was told to land, and hovers; but not by a single message that is wrong."""
    need_wh = 1.25 * landing_wh(ENERGY, 12.0)
    enough = Watched(task, replace(IN_AIR, remaining_wh=need_wh + 0.1))
    assert enough.pass_time(5) == []
    spent = Watched(task, replace(IN_AIR, remaining_wh=need_wh - 0.1))
    assert spent.verdicts == []
    spent.pass_time(4)
    ((_, verdict),) = spent.verdicts
    assert verdict.rung == "land"


def test_who_lands_already_is_not_told_to() -> None:
    assert Watched(hold(), replace(IN_AIR, mode="land", remaining_wh=0.1)).verdicts == []


def test_an_unknown_charge_is_the_missions_matter() -> None:
    assert Watched(hold(), replace(IN_AIR, remaining_wh=None)).pass_time(30) == []


# --- down ------------------------------------------------------------------------------------
def test_motors_off_away_from_home_is_a_crash() -> None:
    watched = Watched(leg(), replace(IN_AIR, position=FAR))
    verdict = watched.look(t_s=1.0, armed=False, airborne=False, height_m=0.1)
    assert verdict is not None
    assert verdict.rung == "crashed"
    assert watched.look(t_s=2.0) is None, "it is told once"


def test_no_height_with_the_motors_on_is_a_crash() -> None:
    watched = Watched(leg(), replace(IN_AIR, position=FAR, height_m=3.0))
    assert "crashed" in watched.pass_time(9, height_m=-1.0)


@pytest.mark.parametrize("mode", ["follow", "other", "rtl", "land"])
def test_a_fall_is_a_crash_whoever_flies(mode: str) -> None:
    watched = Watched(Task("land", 0.0, (HOME,), True, 12.0), replace(IN_AIR, mode=mode))
    assert watched.pass_time(2, height_m=-9.0) == ["crashed"]


@pytest.mark.parametrize("mode", ["follow", "other", "rtl", "land"])
@pytest.mark.parametrize("armed", [True, False])
def test_who_struck_its_pad_has_crashed_whoever_flew(mode: str, armed: bool) -> None:
    low = replace(IN_AIR, mode=mode, height_m=3.0)
    watched = Watched(Task("land", 0.0, (HOME,), True, 12.0), low)
    stands = {"height_m": 0.1, "armed": armed, "airborne": False}
    assert watched.look(t_s=1.0, struck_m_s=2.4, **stands) is None
    verdict = watched.look(t_s=2.0, struck_m_s=2.6)
    assert verdict is not None
    assert verdict.rung == "crashed"
    assert "2.6 m/s, 0 m from home" in verdict.reason
    assert watched.look(t_s=3.0, struck_m_s=0.0) is None


def test_a_pilots_landing_is_none() -> None:
    watched = Watched(leg(), replace(IN_AIR, mode="other", position=FAR))
    assert watched.pass_time(8, height_m=-2.0) == []
    assert watched.look(t_s=9.0, armed=False, airborne=False) is None


def test_a_landing_that_was_ordered_is_none() -> None:
    watched = Watched(Task("land", 0.0, (HOME,), True, 12.0), replace(IN_AIR, mode="land"))
    assert watched.pass_time(24, height_m=-0.5) == []
    assert watched.look(t_s=26.0, armed=False, airborne=False) is None


def test_motors_that_turn_for_ever_after_a_landing_are_told() -> None:
    watched = Watched(
        Task("land", 0.0, (HOME,), True, 12.0), replace(IN_AIR, mode="land", height_m=3.0)
    )
    assert watched.pass_time(20, height_m=-0.5) == []
    assert watched.pass_time(16) == ["crashed"]


def test_a_climb_that_does_not_begin_is_told() -> None:
    climb = Task("climb", 0.0, (HOME,), False, 12.0, name="TakeOff")
    watched = Watched(climb, replace(IN_AIR, height_m=0.2))
    assert watched.pass_time(19) == []
    assert watched.pass_time(3) == ["crashed"]


def test_who_stands_on_the_ground_is_left_alone() -> None:
    on_ground = replace(IN_AIR, height_m=0.0, airborne=False)
    assert Watched(Task("ground", 0.0), on_ground).pass_time(300) == []
    climb = Task("climb", 0.0, (HOME,), False, 12.0, name="TakeOff")
    assert Watched(climb, on_ground).pass_time(30) == [], "its motors spin up"


# --- other hands -----------------------------------------------------------------------------
def test_nothing_is_done_to_what_a_pilot_flies() -> None:
    outside = GridPoint(300.0, 0.0)
    watched = Watched(leg(), replace(IN_AIR, mode="other", position=outside, remaining_wh=0.5))
    assert watched.pass_time(60, east_m=3.0) == []
    assert watched.guard.action is None


def test_who_is_carried_off_faster_than_it_flies_lands_without_a_detour() -> None:
    """No wind is known: only the air can do that."""
    watched = Watched(hold())
    assert watched.pass_time(3, east_m=8.0) == []
    watched.guard = watched.guard.told(leg())
    assert watched.pass_time(2, east_m=-8.0) == ["land"]
    assert "carried off" in watched.verdicts[0][1].reason


def test_orders_that_follow_one_another_faster_than_looks_hide_nothing() -> None:
    """A vehicle that looks from cell to cell is told a new place each second."""
    watched = Watched(hold())
    verdicts: list[str] = []
    for _ in range(4):
        here = watched.seen.position
        watched.guard = watched.guard.told(replace(hold(), since_s=watched.seen.t_s, path=(here,)))
        verdicts += watched.pass_time(1, east_m=8.0)
    assert verdicts == ["land"]


def test_who_is_carried_off_and_out_of_the_fence_lands_at_once() -> None:
    at_fence = GridPoint(84.0, 0.0)
    watched = Watched(replace(hold(), path=(at_fence,)), replace(IN_AIR, position=at_fence))
    assert watched.pass_time(2, east_m=8.0) == ["land"]
    assert watched.verdicts[0][1].hurry
    inside = Watched(hold())
    assert inside.pass_time(2, east_m=8.0) == []


CLIMB = Task("climb", 0.0, (HOME,), False, 12.0, name="TakeOff")


@pytest.mark.parametrize(("speed_m_s", "rungs"), [(7.0, ["land"]), (1.5, [])])
def test_a_climb_that_does_not_go_straight_up_ends_at_once(
    speed_m_s: float, rungs: list[str]
) -> None:
    """A wrong compass shows at the first gust; a gust alone does not carry it far."""
    climbing = replace(IN_AIR, height_m=1.0, ground_speed_m_s=speed_m_s)
    watched = Watched(CLIMB, climbing)
    assert watched.pass_time(2, east_m=speed_m_s, height_m=1.5) == rungs
    assert all(verdict.hurry for _, verdict in watched.verdicts)


def test_a_leap_in_a_climb_is_no_reason_to_land() -> None:
    watched = Watched(CLIMB, replace(IN_AIR, height_m=1.0))
    watched.pass_time(1, east_m=40.0, height_m=1.5)
    assert watched.pass_time(4, east_m=-4.0, height_m=1.5) == []


def test_who_is_carried_off_while_it_lands_descends_faster() -> None:
    """By the mission's order or by its guardian's: once, and not where the ground is near."""
    watched = Watched(Task("land", 0.0, name="Land"), replace(IN_AIR, mode="land"))
    assert watched.pass_time(8, east_m=8.0, height_m=-0.5) == ["land"]
    assert watched.verdicts[0][1].hurry
    slowly = Watched(hold())
    slowly.guard = slowly.guard.acting("land", 0.0)
    assert slowly.pass_time(8, east_m=8.0, height_m=-0.5) == ["land"]
    low = Watched(Task("land", 0.0, name="Land"), replace(IN_AIR, height_m=2.0, mode="land"))
    assert low.pass_time(3, east_m=8.0, height_m=-0.3) == []
    calm = Watched(Task("land", 0.0, name="Land"), replace(IN_AIR, mode="land"))
    assert calm.pass_time(10, east_m=3.0, height_m=-0.5) == []


def test_a_single_jump_of_the_position_is_no_reason_to_land() -> None:
    watched = Watched(hold())
    watched.pass_time(2)
    watched.pass_time(1, east_m=40.0)
    assert watched.pass_time(5) == []
    assert watched.pass_time(6, east_m=-40.0 / 6) == []


# --- a path that is flown without stopping --------------------------------------------------------
LANES = [HOME, FAR, GridPoint(60, 12), GridPoint(0, 12), GridPoint(0, 24), GridPoint(40, 24)]


def along(begin_s: float = 2.0) -> Task:
    course = Course((rounded_path(LANES, begin_s, speed_m_s=6.0),))
    return Task("path", 0.0, height_m=12.0, name="FlyPath", course=course)


def fly_path(watched: Watched, until_s: float, late_s: float = 0.0, off_m: float = 0.0) -> None:
    course = watched.guard.task.course
    assert course is not None
    while watched.seen.t_s < until_s:
        t_s = watched.seen.t_s + 1.0
        place = course.at(t_s - late_s).place
        watched.look(t_s=t_s, position=GridPoint(place.east_m, place.north_m + off_m))


@pytest.mark.parametrize("late_s", [0.0, 0.5])
def test_a_path_that_is_followed_is_left_alone(late_s: float) -> None:
    watched = Watched(along())
    course = watched.guard.task.course
    assert course is not None
    fly_path(watched, course.end_s + 10.0, late_s)
    assert not watched.verdicts


def test_a_path_that_replaces_another_is_left_alone() -> None:
    """Until it begins the older one is flown; it is some way off by then."""
    watched = Watched(along())
    fly_path(watched, 6.0)
    course = watched.guard.task.course
    assert course is not None
    here = course.at(9.0)
    corners = [here.place, GridPoint(50, 0), GridPoint(50, 40)]
    plan = rounded_path(corners, 9.0, speed_m_s=6.0, begin_speed_m_s=here.v_east_m_s)
    task = replace(along(), since_s=6.0, course=course.then(plan, 6.0))
    watched.guard = watched.guard.told(task)
    fly_path(watched, plan.end_s + 5.0)
    assert not watched.verdicts


def test_who_does_not_follow_a_path_is_reported_within_seconds_and_not_taken_for_swept() -> None:
    watched = Watched(along())
    watched.pass_time(20)  # it hovers
    t_s, verdict = watched.verdicts[0]
    assert (verdict.rung, verdict.reason) == ("report", "it is 21 m off its path by now")
    assert t_s == 7.0
    assert [v.rung for _, v in watched.verdicts] == ["report", "rtl"]


def test_beside_a_path_is_off_it_and_a_strong_wind_explains_some_of_it() -> None:
    watched = Watched(along())
    fly_path(watched, 15.0, off_m=OFF_PLAN_M + 1.0)
    assert watched.verdicts[0][1].rung == "report"
    windy = Watched(along(), replace(IN_AIR, wind_m_s=3.0))
    fly_path(windy, 15.0, off_m=OFF_PLAN_M + 1.0)
    assert not windy.verdicts


def test_who_is_carried_away_from_a_path_is_known() -> None:
    watched = Watched(along())
    fly_path(watched, 5.0)
    rungs = watched.pass_time(8, north_m=-8.0)
    assert rungs[0] in ("report", "land")
    assert watched.verdicts[-1][1].rung == "land"


def test_a_path_that_never_comes_to_rest_is_reported() -> None:
    watched = Watched(along())
    course = watched.guard.task.course
    assert course is not None
    fly_path(watched, course.end_s + 25.0)
    assert [v.rung for _, v in watched.verdicts] == ["report"]
    assert "has not come to rest" in watched.verdicts[0][1].reason


def test_height_that_is_lost_on_a_path_is_known() -> None:
    watched = Watched(along())
    fly_path(watched, 6.0)
    watched.seen = replace(watched.seen, height_m=6.0)
    fly_path(watched, 12.0)
    assert "lost height" in watched.verdicts[0][1].reason


def test_a_movement_that_nobody_saw_for_long_has_not_lasted() -> None:
    """Telemetry is late while it moves away, an order calls it home, and 20 s later it is seen."""
    watched = Watched(leg())
    assert watched.pass_time(2, east_m=-4.0) == []
    watched.guard = watched.guard.told(leg(homeward=True, since_s=3.0))
    watched.look(t_s=23.0, position=GridPoint(-6.0, 0.0))
    assert watched.verdicts == []
    assert watched.pass_time(3, east_m=4.0) == []
