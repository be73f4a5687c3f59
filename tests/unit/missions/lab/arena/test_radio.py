"""Radio in the arena: reception, knowledge over time, and full exploration."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.fleet_events import Partition
from missions.lab.arena.arena_run import Comms, Run, run
from missions.lab.arena.radio import Links, Mind, Radio, observe
from missions.lab.arena.roi import component, grown
from missions.mapping.tree import Tree
from missions.planning.stepwise import EXPLORERS
from missions.planning.stepwise.interface import Metric
from missions.units import Cell

START = Cell(0, 0)
ROW = [Cell(e, 0) for e in range(8)]


class Team:
    """Robots that stand in a row; the first has observed it."""

    def __init__(self, links: Links, *easts: int, looks: int = 4) -> None:
        self.radio = Radio(links, ROW)
        self.at = {robot: Cell(east, 0) for robot, east in enumerate(easts)}
        known = observe(Tree.rooted(START), START, ROW)
        received = dict.fromkeys(self.at, (0.0, START))
        self.minds = {robot: Mind(known, received) for robot in self.at}
        tree, looked = known, 0
        for cell in ROW[1 : looks + 1]:
            tree, looked = observe(tree, cell, ROW), looked | self.radio.bit(cell)
        self.minds[0] = Mind(tree, received, observed=looked)

    def instant(self, t: float) -> list[int]:
        """Let them receive and send at an instant; return how far each then knows the row."""
        places = {robot: (float(cell.east), float(cell.north)) for robot, cell in self.at.items()}
        self.radio.tune(t, places, self.at)
        self.radio.deliver(self.minds)
        self.radio.send(self.minds)
        return [len(mind.tree) - 2 for mind in self.minds.values()]


@pytest.mark.parametrize(
    ("links", "easts", "known"),
    [
        (Links(range_cells=3.0), (0, 3, 7), {0.0: [4, 4, 0]}),
        # from one to the other
        (Links(range_cells=3.0), (0, 3, 6), {0.0: [4, 4, 4]}),
        (Links(range_cells=3.0, rate=100.0), (0, 3, 6), {0.0: [4, 4, 4]}),
        # a delayed message is known at the first instant after its delay; each hop has the delay
        (Links(delay=1.5), (0, 3), {0.0: [4, 0], 1.0: [4, 0], 1.4: [4, 0], 1.5: [4, 4]}),
        (
            Links(range_cells=3.0, delay=1.0),
            (0, 3, 6),
            {0.0: [4, 0, 0], 1.0: [4, 4, 0], 2.0: [4, 4, 4]},
        ),
        # a rate below one sends a cell now and then; all receivers share one message
        (Links(rate=0.5), (0, 3), {float(t): [4, n] for t, n in enumerate((1, 1, 2, 2, 3))}),
        (Links(rate=2.0), (0, 3, 6, 7), {0.0: [4, 2, 2, 2]}),
    ],
)
def test_robots_know_facts_after_the_delay_of_the_radio(links, easts, known):
    team = Team(links, *easts)
    assert {t: team.instant(t) for t in known} == known


def test_rate_sends_the_cells_nearest_to_the_root_first():
    team = Team(Links(rate=1.0), 0, 3, looks=6)
    assert [team.instant(t)[1] for t in (0.0, 1.0, 1.5, 2.0, 9.0, 10.0)] == [1, 2, 2, 3, 4, 5]


def test_lost_message_is_sent_again():
    team = Team(Links(loss=0.9, rate=100.0, seed=1), 0, 3)
    known = [team.instant(float(t))[1] for t in range(40)]
    assert known[0] == 0
    assert known[-1] == 4
    assert set(known) == {0, 4}


def test_the_loss_is_of_pairs_at_instants():
    radio = Radio(Links(loss=0.3, seed=1), ROW)
    places = {0: (0.0, 0.0), 1: (1.0, 0.0)}
    received = 0
    for t in range(2000):
        radio.tune(float(t), places, {})
        received += radio.touch[0] == (0, 1)
    assert received / 2000 == pytest.approx(0.7, abs=0.03)


@pytest.mark.parametrize(
    ("named", "touch"),
    [((), {(0,), (1,), (2,)}), ((frozenset({0, 2}),), {(0, 2), (1,)})],
    ids=["none", "a group"],
)
def test_a_partition_lasts_from_its_beginning_to_its_end(named, touch):
    radio = Radio(Links(apart=(Partition(2.0, 4.0, named),)), ROW)
    places = dict.fromkeys(range(3), (0.0, 0.0))
    found = []
    for t in (1.9, 2.0, 3.9, 4.0):
        radio.tune(t, places, {})
        found.append(set(radio.touch.values()))
    assert found == [{(0, 1, 2)}, touch, touch, {(0, 1, 2)}]


def test_robots_at_one_vertex_receive_each_other_without_radio():
    radio = Radio(Links(loss=1.0, apart=(Partition(0.0, 9.0),)), ROW)
    places = dict.fromkeys(range(3), (2.0, 0.0))
    radio.tune(1.0, places, {0: Cell(2, 0), 2: Cell(2, 0)})  # 1 flies by
    assert radio.touch == {0: (0, 2), 1: (1,), 2: (0, 2)}


def test_robots_in_contact_share_the_memory_of_the_first_that_is_not_done():
    team = Team(Links(), 0, 3, 6)
    team.minds = {r: replace(mind, memory=f"of {r}") for r, mind in team.minds.items()}
    team.radio.tune(0.0, {r: (float(c.east), 0.0) for r, c in team.at.items()}, team.at)
    team.radio.deliver(team.minds, done={0})
    assert {mind.memory for mind in team.minds.values()} == {"of 1"}


def test_place_that_is_in_no_tree_yet_is_not_received():
    team = Team(Links(rate=1.0), 0, 3)
    team.minds[0] = Mind(
        team.minds[0].tree, {0: (5.0, Cell(5, 0)), 1: (0.0, START)}, None, team.minds[0].observed
    )
    assert team.instant(0.0)[1] == 1
    assert team.minds[1].known_at[0] == (0.0, START)
    for t in range(1, 4):
        team.instant(float(t))
    assert team.minds[1].known_at[0] == (5.0, Cell(5, 0))


RESTING, DRIFTING = Metric(), Metric(1.0, 0.3, -0.2)

rois = st.builds(
    grown,
    st.sampled_from(["eden", "ragged", "thin"]),
    st.integers(1, 30),
    st.integers(0, 1000),
)
teams = st.integers(1, 5)
metrics = st.sampled_from([RESTING, DRIFTING])
explorers = st.sampled_from([EXPLORERS[name] for name in EXPLORERS])
groups = st.sampled_from([(), (frozenset({0, 1}),), (frozenset({0, 2}), frozenset({1, 3, 4}))])
aparts = st.builds(
    lambda begin, lasting, named: Partition(begin, begin + lasting, named),
    st.integers(0, 20),
    st.integers(1, 60),
    groups,
)
links = st.builds(
    Links,
    range_cells=st.sampled_from([0.0, 1.0, 2.0, 4.0, 8.0, math.inf]),
    loss=st.sampled_from([0.0, 0.1, 0.5, 0.9, 1.0]),
    delay=st.sampled_from([0.0, 0.5, 1.0, 3.0, 20.0]),
    rate=st.sampled_from([math.inf, 0.2, 1.0, 4.0]),
    apart=st.lists(aparts, max_size=2).map(tuple),
    seed=st.integers(0, 1000),
)


def facts(result: Run) -> tuple[object, ...]:
    return result.makespan, result.legs, dict(result.tree.vertices)


@settings(max_examples=150)
@given(explorers, rois, teams, metrics, links)
def test_every_robot_ends_at_home_and_every_cell_is_explored(explorer, roi, robots, metric, radio):
    done = run(explorer, roi.cells, roi.start, robots, metric=metric, comms=radio)
    assert set(done.tree.vertices) == component(roi.cells, roi.start)
    assert done.tree.is_explored(roi.start)
    assert set(done.at.values()) == {roi.start}


@settings(max_examples=40)
@given(explorers, rois, teams, metrics)
def test_a_radio_without_limits_is_shared_communication(explorer, roi, robots, metric):
    shared, free = (
        run(explorer, roi.cells, roi.start, robots, metric=metric, comms=comms)
        for comms in (Comms.SHARED, Links())
    )
    assert facts(free) == facts(shared)


@settings(max_examples=60)
@given(
    explorers,
    rois,
    teams,
    metrics,
    st.sampled_from(
        [
            Links(loss=1.0),
            Links(range_cells=0.0),
            Links(apart=(Partition(0.0, math.inf),)),
            Links(loss=1.0, delay=2.0),
            Links(range_cells=0.0, rate=1.0),
        ]
    ),
)
def test_radio_without_receivers_is_meeting(explorer, roi, robots, metric, silent):
    meeting, apart = (
        run(explorer, roi.cells, roi.start, robots, metric=metric, comms=comms)
        for comms in (Comms.MEETING, silent)
    )
    assert facts(apart) == facts(meeting)


@settings(max_examples=20)
@given(explorers, rois, links)
def test_the_same_seed_gives_the_same_moves(explorer, roi, radio):
    once, again = (run(explorer, roi.cells, roi.start, 4, comms=radio) for _ in range(2))
    assert facts(once) == facts(again)


def test_memory_of_a_robot_that_is_done_misleads_no_other():
    """With the memory of a robot at home, which is out of date, `bfdn` led three to and fro."""
    roi = grown("thin", 18, 176)
    done = run(EXPLORERS["bfdn"], roi.cells, roi.start, 5, comms=Links(range_cells=2.0))
    assert done.makespan < 50


def test_another_seed_loses_other_messages():
    roi = grown("eden", 60, 3)
    seen = {
        run(EXPLORERS["rdfs"], roi.cells, roi.start, 4, comms=Links(loss=0.6, seed=seed)).legs
        for seed in range(4)
    }
    assert len(seen) > 1


@pytest.mark.parametrize("name", ["rdfs", "horizon"])
def test_radio_is_between_meeting_and_shared(name):
    """This holds in the mean over regions: with more knowledge a robot may still choose worse."""

    def mean(comms: Comms | Links) -> float:
        regions = [grown("eden", 60, seed) for seed in range(4)]
        makespans = [run(EXPLORERS[name], r.cells, r.start, 4, comms=comms) for r in regions]
        return sum(each.makespan for each in makespans) / len(regions)

    shared, near, far = mean(Comms.SHARED), mean(Links(range_cells=2.0)), mean(Comms.MEETING)
    assert shared < near < far
