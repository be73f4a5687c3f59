"""The guardian's rules, one situation at a time: observations, and the rung that follows."""

from dataclasses import replace

import pytest

from missions.geo.braking import Course
from missions.geo.fence import Fence
from missions.geo.trajectory import rounded_path
from missions.guardian import Guard, Limits, Snapshot, Task, watch
from missions.guardian.rules import landing_wh
from missions.guardian.thresholds import OFF_PLAN_M
from missions.mission.energy import EnergyModel
from missions.units import GridPoint

HOME = GridPoint(0.0, 0.0)
FAR, AT_FENCE = GridPoint(60.0, 0.0), GridPoint(84.0, 0.0)
ENERGY = EnergyModel(
    hover_power_w=300.0, capacity_wh=60.0, reserve=0.15, speed_m_s=5.0, wind_m_s=3.0
)
LIMITS = Limits(
    Fence.from_rings(
        [GridPoint(-50, -50), GridPoint(100, -50), GridPoint(100, 50), GridPoint(-50, 50)],
        holes=[],
        margin_m=2.0,
    ),
    ENERGY,
)
IN_AIR = Snapshot(0.0, HOME, 12.0, 0.0, HOME, True, True, "follow", 50.0)


class Watched:
    def __init__(self, task, seen=IN_AIR):
        self.seen = seen
        self.guard = Guard().with_task(task)
        self.verdicts = []
        self.look()

    def look(self, **changes):
        self.seen = replace(self.seen, **changes)
        self.guard, verdict = watch(LIMITS, self.guard, self.seen)
        if verdict is not None:
            self.verdicts.append((self.seen.t_s, verdict))
        return verdict

    def pass_time(self, seconds, **each):
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


def leg(*, homeward=False, since_s=0.0):
    path = (FAR, HOME) if homeward else (HOME, FAR)
    return Task("leg", since_s, path, homeward, 12.0, estimate_s=16.0, name="FlyTo")


def hold():
    return Task("hold", 0.0, (HOME,), False, 12.0, name="Look")


LAND = Task("land", 0.0, (HOME,), True, 12.0)
CLIMB = Task("climb", 0.0, (HOME,), False, 12.0, name="TakeOff")
LANDING = replace(IN_AIR, mode="land")
RETURNING = replace(IN_AIR, position=FAR, mode="rtl")
ON_GROUND = replace(IN_AIR, height_m=0.0, airborne=False)
Moves = dict[str, float]
SITUATIONS = {
    # duration, changes in each second, the rungs that follow; text of the first verdict
    "no progress is reported once and then climbs the ladder": (
        leg(), IN_AIR, [(15, {}, []), (2, {}, ["report"]), (4, {}, []), (2, {}, ["rtl"])], "",
    ),
    "off its way": (
        leg(), IN_AIR,
        [(3, {"north_m": 5.0, "east_m": 5.0}, []), (12, {"east_m": 3.0}, ["report"])],
        "off its way",
    ),
    "a leg that crawls takes too long": (
        leg(), IN_AIR, [(67, {"east_m": 0.6}, []), (3, {"east_m": 0.6}, ["report"])], "",
    ),
    "lost height": (
        leg(), IN_AIR,
        [(2, {"east_m": 5.0}, []), (6, {"east_m": 5.0, "height_m": -1.5}, ["report"])],
        "lost height",
    ),
    "carried off and out of the fence": (
        replace(hold(), path=(AT_FENCE,)), replace(IN_AIR, position=AT_FENCE),
        [(2, {"east_m": 8.0}, ["land"])], "carried off",
    ),
    "carried off inside of the fence": (hold(), IN_AIR, [(2, {"east_m": 8.0}, [])], ""),
    "a drift of the goal is allowed for": (
        replace(hold(), drift_m_s=0.5), IN_AIR, [(60, {"east_m": 0.5}, [])], "",
    ),
    "the wind of which the autopilot knows lands it": (
        hold(), replace(IN_AIR, wind_m_s=13.0),
        [(2, {"east_m": 4.0}, []), (2, {"east_m": 4.0}, ["land"])], "wind",
    ),
    "a strong wind that it holds is no reason": (
        hold(), replace(IN_AIR, wind_m_s=12.5), [(60, {}, [])], "",
    ),
    "receding outside of the fence lands it at once": (
        hold(), replace(IN_AIR, position=GridPoint(-40.0, 0.0)),
        [(4, {"east_m": -5.0}, []), (3, {"east_m": -5.0}, ["land"])], "geofence",
    ),
    "a climb must stay over its pad": (
        CLIMB, replace(IN_AIR, height_m=3.0),
        [(6, {"height_m": 1.0}, []), (5, {"height_m": 0.5, "east_m": 4.0}, ["report"])], "",
    ),
    "a wrong compass shows at the first gust of a climb": (
        CLIMB, replace(IN_AIR, height_m=1.0, ground_speed_m_s=7.0),
        [(2, {"east_m": 7.0, "height_m": 1.5}, ["land"])], "carried off while it climbs",
    ),
    "a gust alone does not carry a climb far": (
        CLIMB, replace(IN_AIR, height_m=1.0, ground_speed_m_s=1.5),
        [(2, {"east_m": 1.5, "height_m": 1.5}, [])], "",
    ),
    "a leap in a climb is no reason to land": (
        CLIMB, replace(IN_AIR, height_m=1.0),
        [(1, {"east_m": 40.0, "height_m": 1.5}, []), (4, {"east_m": -4.0, "height_m": 1.5}, [])],
        "",
    ),
    "a single jump of the position is no reason to land": (
        hold(), IN_AIR,
        [(2, {}, []), (1, {"east_m": 40.0}, []), (5, {}, []), (6, {"east_m": -40.0 / 6}, [])], "",
    ),
    "a landing that is carried off is hastened": (
        LAND, LANDING, [(8, {"east_m": 8.0, "height_m": -0.5}, ["land"])], "while it lands",
    ),
    "a landing near the ground is not hastened": (
        LAND, replace(LANDING, height_m=2.0), [(3, {"east_m": 8.0, "height_m": -0.3}, [])], "",
    ),
    "a landing that drifts a little is not hastened": (
        LAND, LANDING, [(10, {"east_m": 3.0, "height_m": -0.5}, [])], "",
    ),
    # an order that the autopilot does not fly by itself ends in a landing
    "a return that is flown": (
        leg(homeward=True), RETURNING,
        [(12, {"height_m": 1.5}, []), (12, {"east_m": -5.0}, []), (58, {"height_m": -0.5}, [])], "",
    ),
    "a return without progress": (
        leg(homeward=True), replace(RETURNING, height_m=30.0), [(15, {}, []), (3, {}, ["land"])],
        "",
    ),
    "a return that is not taken": (
        leg(homeward=True), IN_AIR, [(14, {}, []), (2, {}, ["land"])], "",
    ),
    # down
    "no height with the motors on is a crash": (
        leg(), replace(IN_AIR, position=FAR, height_m=3.0),
        [(6, {"height_m": -1.0}, []), (3, {"height_m": -1.0}, ["crashed"])], "it has no height",
    ),
    "motors that turn for ever after a landing": (
        LAND, replace(LANDING, height_m=3.0),
        [(20, {"height_m": -0.5}, []), (16, {}, ["crashed"])], "",
    ),
    "a landing that ends higher than home": (
        LAND, replace(LANDING, height_m=4.0),
        [(6, {"height_m": -0.5}, []), (22, {}, ["crashed"])], "it sinks no more",
    ),
    "a landing that is slow": (LAND, LANDING, [(100, {"height_m": -0.1}, [])], ""),
    "a hover that waits for its landing": (LAND, IN_AIR, [(40, {}, ["land"])], "hovers"),
    "a climb that does not begin": (
        CLIMB, replace(IN_AIR, height_m=0.2), [(19, {}, []), (3, {}, ["crashed"])], "",
    ),
    "a vehicle on the ground": (Task("ground", 0.0), ON_GROUND, [(300, {}, [])], ""),
    "motors that spin up": (CLIMB, ON_GROUND, [(30, {}, [])], ""),
    # others
    "a vehicle of a pilot is left alone": (
        leg(), replace(IN_AIR, mode="other", position=GridPoint(300.0, 0.0), remaining_wh=0.5),
        [(60, {"east_m": 3.0}, [])], "",
    ),
    "an unknown charge is the mission's matter": (
        hold(), replace(IN_AIR, remaining_wh=None), [(30, {}, [])], "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("situation", SITUATIONS)
def test_observation_leads_to_a_rung_of_the_ladder(situation):
    task, seen, passes, expected = SITUATIONS[situation]
    watched = returning(seen) if situation.startswith("a return") else Watched(task, seen)
    for seconds, moves, rungs in passes:
        assert watched.pass_time(seconds, **moves) == rungs
    for _, verdict in watched.verdicts[:1]:
        assert expected in verdict.reason
        is_carried = any(part in verdict.reason for part in ("carrie", ", outside the"))
        assert verdict.hurry is (verdict.rung == "land" and is_carried)


def test_a_leg_that_is_flown_is_left_alone():
    watched = Watched(leg())
    assert watched.pass_time(12, east_m=5.0) == []
    watched.guard = watched.guard.with_task(Task("hold", 12.0, (FAR,), False, 12.0))
    assert watched.pass_time(600) == []


def test_a_new_order_after_the_report_begins_anew():
    watched = Watched(leg())
    watched.pass_time(17)
    home = Task("leg", 17.0, (HOME, GridPoint(-40.0, 0.0)), True, 12.0, estimate_s=16.0)
    watched.guard = watched.guard.with_task(home)
    assert watched.pass_time(14) == []
    assert watched.pass_time(3) == ["rtl"], "on the return no report is due"


def test_a_hopeless_wind_lands_it_before_it_is_carried_away():
    assert Watched(hold(), replace(IN_AIR, wind_m_s=18.5)).verdicts[0][1].rung == "land"


def test_a_new_order_does_not_hide_that_it_is_carried_away():
    watched = Watched(leg())
    watched.pass_time(3, east_m=-4.0)
    watched.guard = watched.guard.with_task(
        Task("hold", 3.0, (watched.seen.position,), False, 12.0)
    )
    assert watched.pass_time(3, east_m=-4.0) == ["report"]


def returning(seen):
    watched = Watched(leg(homeward=True), seen)
    watched.guard = watched.guard.with_action("rtl", 0.0)
    return watched


def test_vehicle_of_the_guardian_is_not_taken_back_by_an_order():
    watched = returning(replace(IN_AIR, mode="rtl"))
    assert watched.guard.with_task(leg()).action == "rtl"
    assert watched.guard.released().action is None


@pytest.mark.parametrize("task", [leg(), hold(), LAND])
def test_vehicle_with_the_last_energy_for_a_landing_lands(task):
    """A vehicle that hovers after an order to land also counts; a single wrong message does not."""
    need_wh = 1.25 * landing_wh(ENERGY, 12.0)
    enough = Watched(task, replace(IN_AIR, remaining_wh=need_wh + 0.1))
    assert enough.pass_time(5) == []
    spent = Watched(task, replace(IN_AIR, remaining_wh=need_wh - 0.1))
    assert spent.verdicts == []
    spent.pass_time(4)
    ((_, verdict),) = spent.verdicts
    assert verdict.rung == "land"
    assert Watched(task, replace(LANDING, remaining_wh=0.1)).verdicts == [], "it lands already"


# --- down ------------------------------------------------------------------------------------
def test_motors_off_away_from_home_is_a_crash():
    watched = Watched(leg(), replace(IN_AIR, position=FAR))
    verdict = watched.look(t_s=1.0, armed=False, airborne=False, height_m=0.1)
    assert verdict.rung == "crashed"
    assert watched.look(t_s=2.0) is None, "it is reported once"


@pytest.mark.parametrize("mode", ["follow", "other", "rtl", "land"])
def test_fall_is_a_crash_under_any_control(mode):
    watched = Watched(LAND, replace(IN_AIR, mode=mode))
    assert watched.pass_time(2, height_m=-9.0) == ["crashed"]


@pytest.mark.parametrize("mode", ["follow", "other", "rtl", "land"])
@pytest.mark.parametrize("armed", [True, False])
def test_vehicle_that_struck_its_pad_has_crashed_under_any_control(mode, armed):
    watched = Watched(LAND, replace(IN_AIR, mode=mode, height_m=3.0))
    stands = {"height_m": 0.1, "armed": armed, "airborne": False}
    assert watched.look(t_s=1.0, struck_m_s=2.4, **stands) is None
    verdict = watched.look(t_s=2.0, struck_m_s=2.6)
    assert verdict.rung == "crashed"
    assert "2.6 m/s, 0 m from home" in verdict.reason
    assert watched.look(t_s=3.0, struck_m_s=0.0) is None


@pytest.mark.parametrize(
    ("task", "seen", "seconds", "sinks_m_s"),
    [(leg(), replace(IN_AIR, mode="other", position=FAR), 8, -2.0), (LAND, LANDING, 24, -0.5)],
)
def test_landing_of_pilot_or_by_order_is_no_crash(task, seen, seconds, sinks_m_s):
    watched = Watched(task, seen)
    assert watched.pass_time(seconds, height_m=sinks_m_s) == []
    assert watched.look(t_s=seconds + 2.0, armed=False, airborne=False) is None


# --- carried off -----------------------------------------------------------------------------
def test_a_home_that_is_moved_after_the_landing_is_no_fall():
    """A real PX4 1.17 reported 0.17, 1.02 and -0.35 m within a second, on its pad, motors off."""
    watched = Watched(LAND, replace(LANDING, home_amsl_m=535.0))
    watched.pass_time(24, height_m=-0.5)
    stands = {"airborne": False, "armed": False, "mode": "follow"}
    for home_amsl_m, height_m in ((534.2, 1.02), (535.5, -0.35), (536.9, -1.7)):
        assert watched.look(
            t_s=watched.seen.t_s + 0.3, home_amsl_m=home_amsl_m, height_m=height_m, **stands
        ) is None  # fmt: skip
    assert not watched.guard.down


def test_vehicle_carried_off_faster_than_it_flies_lands_without_a_detour():
    """No wind is known: only the air can move it like that."""
    watched = Watched(hold())
    assert watched.pass_time(3, east_m=8.0) == []
    watched.guard = watched.guard.with_task(leg())
    assert watched.pass_time(2, east_m=-8.0) == ["land"]
    assert "carried off" in watched.verdicts[0][1].reason


def test_orders_faster_than_the_guardians_checks_hide_nothing():
    """A vehicle that observes cell after cell gets a new target each second."""
    watched = Watched(hold())
    verdicts = []
    for _ in range(4):
        here = watched.seen.position
        watched.guard = watched.guard.with_task(
            replace(hold(), since_s=watched.seen.t_s, path=(here,))
        )
        verdicts += watched.pass_time(1, east_m=8.0)
    assert verdicts == ["land"]


def test_a_landing_by_its_guardian_that_is_carried_off_is_hastened_once():
    slowly = Watched(hold())
    slowly.guard = slowly.guard.with_action("land", 0.0)
    assert slowly.pass_time(8, east_m=8.0, height_m=-0.5) == ["land"]


# --- a path that is flown without stopping --------------------------------------------------------
LANES = [HOME, FAR, GridPoint(60, 12), GridPoint(0, 12), GridPoint(0, 24), GridPoint(40, 24)]


def along(begin_s=2.0):
    course = Course((rounded_path(LANES, begin_s, speed_m_s=6.0),))
    return Task("path", 0.0, height_m=12.0, name="FlyPath", course=course)


def fly_path(watched, until_s, late_s=0.0, off_m=0.0):
    course = watched.guard.task.course
    while watched.seen.t_s < until_s:
        t_s = watched.seen.t_s + 1.0
        place = course.at(t_s - late_s).place
        watched.look(t_s=t_s, position=GridPoint(place.east_m, place.north_m + off_m))


@pytest.mark.parametrize("late_s", [0.0, 0.5])
def test_a_path_that_is_followed_is_left_alone(late_s):
    watched = Watched(along())
    course = watched.guard.task.course
    fly_path(watched, course.end_s + 10.0, late_s)
    assert not watched.verdicts


def test_a_path_that_replaces_another_is_left_alone():
    """The vehicle flies the older path until the new one begins, and is some way off by then."""
    watched = Watched(along())
    fly_path(watched, 6.0)
    course = watched.guard.task.course
    here = course.at(9.0)
    corners = [here.place, GridPoint(50, 0), GridPoint(50, 40)]
    plan = rounded_path(corners, 9.0, speed_m_s=6.0, begin_speed_m_s=here.v_east_m_s)
    task = replace(along(), since_s=6.0, course=course.then(plan, 6.0))
    watched.guard = watched.guard.with_task(task)
    fly_path(watched, plan.end_s + 5.0)
    assert not watched.verdicts


def test_vehicle_off_its_path_is_reported_within_seconds_and_not_taken_for_swept():
    watched = Watched(along())
    watched.pass_time(20)  # it hovers
    t_s, verdict = watched.verdicts[0]
    assert (verdict.rung, verdict.reason) == ("report", "it is 21 m off its path by now")
    assert t_s == 7.0
    assert [v.rung for _, v in watched.verdicts] == ["report", "rtl"]


def test_vehicle_beside_a_path_is_off_it_and_a_strong_wind_explains_some_of_it():
    watched = Watched(along())
    fly_path(watched, 15.0, off_m=OFF_PLAN_M + 1.0)
    assert watched.verdicts[0][1].rung == "report"
    windy = Watched(along(), replace(IN_AIR, wind_m_s=3.0))
    fly_path(windy, 15.0, off_m=OFF_PLAN_M + 1.0)
    assert not windy.verdicts


def test_vehicle_carried_away_from_a_path_is_noticed():
    watched = Watched(along())
    fly_path(watched, 5.0)
    rungs = watched.pass_time(8, north_m=-8.0)
    assert rungs[0] in ("report", "land")
    assert watched.verdicts[-1][1].rung == "land"


def test_a_path_that_never_comes_to_rest_is_reported():
    watched = Watched(along())
    course = watched.guard.task.course
    fly_path(watched, course.end_s + 25.0)
    assert [v.rung for _, v in watched.verdicts] == ["report"]
    assert "has not come to rest" in watched.verdicts[0][1].reason


def test_height_lost_on_a_path_is_noticed():
    watched = Watched(along())
    fly_path(watched, 6.0)
    watched.seen = replace(watched.seen, height_m=6.0)
    fly_path(watched, 12.0)
    assert "lost height" in watched.verdicts[0][1].reason


def test_movement_without_observations_for_long_has_not_lasted():
    """Telemetry is late while it moves away, a return is ordered, and a check comes 20 s later."""
    watched = Watched(leg())
    assert watched.pass_time(2, east_m=-4.0) == []
    watched.guard = watched.guard.with_task(leg(homeward=True, since_s=3.0))
    watched.look(t_s=23.0, position=GridPoint(-6.0, 0.0))
    assert watched.verdicts == []
    assert watched.pass_time(3, east_m=4.0) == []


def test_vehicle_that_hovers_outside_of_the_fence_is_reported_within_seconds():
    outside = GridPoint(0.0, 53.0)
    task = Task("hold", 0.0, (outside,), False, 12.0, name="Look")
    assert Watched(task, replace(IN_AIR, position=outside)).pass_time(4) == ["report"]
