"""A short campaign: the long one is `python -m tests.campaign --flights 10000`."""

from collections import Counter

import pytest

from tests.campaign import fleets, simulated
from tests.campaign.outcome import COLUMNS, FORBIDDEN, Outcome, table
from tests.campaign.reducer import KINDS, fly, plan_of
from tests.fake_fleet.troubles import PHASES

FLIGHTS = 24
# A seed alone is not enough: another list of troubles would draw another flight from it.
ONCE_WRONG = {
    71: "motor (search)",
    81: "homes (search)",
    113: "battery cell (look)",
    653: "motor (search)",
    993: "process ends (look)",
    300136: "pilot (explore) + storm (search)",
    300307: "homes (ground) + storm (look)",
    400336: "homes (search) + order refused (search)",
    403040: "homes (landing)",
    411284: "process ends (take-off)",
    502372: "homes (look)",
    602159: "gnss jump (take-off) + process ends (search)",
    710327: "camera lost (search) + compass (explore)",
    1002180: "commands lost (take-off)",
    1003368: "process ends (search) + battery sag (explore)",
    1200818: "motor (look) + process ends (look)",
    1302717: "motor (look) + order refused (return)",
    1303268: "pilot (search) + failsafe (search)",
    1402077: "process ends (landing) + link silent (take-off)",
    1506497: "process ends (landing) + failsafe (return)",
    31000774: "pilot (look)",
    31002439: "failsafe (return) + pilot (landing)",
}
ONCE_FAR = {
    910005: "compass (ground)",
    910146: "gps_drift (landing) + wind_gust (explore)",
    920099: "camera_corrupt (take-off) + wind_gust (return)",
    940038: "compass (look) + battery_cell (explore)",
    950056: "compass (search) + battery_sag (landing)",
    960105: "compass (search)",
    960437: "compass (look) + reject (look)",
}


def test_fleet_of_points_in_an_unkind_world_breaks_no_rule():
    """A third of the kinds of trouble comes alone, and all kinds in pairs."""
    outcomes = [fly(seed) for seed in range(FLIGHTS)]
    assert [(o.plan, o.found) for o in outcomes if o.found] == []
    assert any("ok" in o.counts for o in outcomes)


@pytest.mark.parametrize(("seed", "plan"), ONCE_WRONG.items())
def test_flight_that_once_broke_a_rule_breaks_none(seed, plan):
    """Two vehicles that a pilot left side by side waited for each other.

    A storm took another one down a slope.
    """
    outcome = fly(seed)
    assert outcome.plan == f"--seed {seed}: {plan}"
    assert outcome.found == ()


def test_member_of_a_fleet_is_not_complete_while_one_that_it_never_received_is_down():
    outcome = fleets.fly(25)
    assert outcome.found == ()
    assert "crash" in outcome.counts
    assert "inc" in outcome.counts


def test_the_same_seed_flies_the_same_flight():
    assert [fly(seed) for seed in (6, 9)] == [fly(seed) for seed in (6, 9)]


def test_every_kind_is_planned_alone_in_every_phase():
    seeds = range(len(KINDS) * len(PHASES) * 10 // 6 + 10)
    alone = Counter(
        (plan.kinds[0], plan.phases[0]) for plan in map(plan_of, seeds) if len(plan.kinds) == 1
    )
    assert set(alone) == {(kind, phase) for kind in KINDS for phase in PHASES}


def test_the_table_counts_each_flight_in_its_row_and_in_all():
    one = Outcome(1, "storm", "", frozenset({"ok", "home"}), ())
    two = Outcome(2, "storm", "", frozenset({"inc", "far"}), (("far", "200 m"),))
    header, *rows = table([one, two]).splitlines()
    assert header.split() == list(COLUMNS)
    for row in rows:
        cells = dict(zip(COLUMNS, row.split()[1:], strict=True))
        assert (cells["n"], cells["ok"], cells["inc"], cells["far"]) == ("2", "1", "1", "1")
    assert set(FORBIDDEN.values()) <= set(COLUMNS)


@pytest.mark.parametrize(("seed", "plan"), ONCE_FAR.items())
def test_vehicle_with_a_reversed_compass_in_a_storm_is_not_carried_far(seed, plan):
    """The compass points backwards in the climb and in the landing, in storms of 25 m/s."""
    outcome = simulated.fly(seed)
    assert outcome.plan == f"--seed {seed}: {plan}"
    assert outcome.found == ()


@pytest.mark.parametrize("seed", [103, 110, 131, 210, 258])
def test_vehicle_of_a_pilot_is_not_taken_back(seed):
    """A pilot selects LAND, POSITION, RTL, BRAKE, or STABILIZE while a guardian lands.

    After 20 s the pilot lands.
    """
    outcome = simulated.fly(seed, pilots=True)
    assert outcome.found == ()


@pytest.mark.parametrize("seed", [1, 3, 4, 9, 1600328])
def test_service_against_the_simulator_breaks_no_rule(seed):
    """Single faults and pairs of `sitl.faults` pass through the driver and the wire."""
    outcome = simulated.fly(seed)
    assert outcome.found == ()
    assert outcome.counts & {"ok", "inc"}
