"""Whatever the links: everything is explored, everybody is home and knows it all."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.lab.arena.arena_run import Comms, Run, run
from missions.lab.arena.radio import Links
from missions.lab.arena.roi import Roi, component, grown
from missions.partition import Partition
from missions.planning.stepwise import EXPLORERS, Explorer
from missions.planning.stepwise.metric import Metric

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
def test_every_robot_ends_at_home_and_every_cell_is_explored(
    explorer: Explorer, roi: Roi, robots: int, metric: Metric, radio: Links
) -> None:
    done = run(explorer, roi.cells, roi.start, robots, metric=metric, comms=radio)
    assert set(done.tree.vertices) == component(roi.cells, roi.start)
    assert done.tree.is_explored(roi.start)
    assert set(done.at.values()) == {roi.start}


@settings(max_examples=40)
@given(explorers, rois, teams, metrics)
def test_a_radio_without_limits_is_shared_communication(
    explorer: Explorer, roi: Roi, robots: int, metric: Metric
) -> None:
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
def test_a_radio_that_nobody_hears_is_meeting(
    explorer: Explorer, roi: Roi, robots: int, metric: Metric, silent: Links
) -> None:
    meeting, apart = (
        run(explorer, roi.cells, roi.start, robots, metric=metric, comms=comms)
        for comms in (Comms.MEETING, silent)
    )
    assert facts(apart) == facts(meeting)


@settings(max_examples=20)
@given(explorers, rois, links)
def test_the_same_seed_gives_the_same_moves(explorer: Explorer, roi: Roi, radio: Links) -> None:
    once, again = (run(explorer, roi.cells, roi.start, 4, comms=radio) for _ in range(2))
    assert facts(once) == facts(again)


def test_nobody_is_led_astray_by_what_another_remembers_that_is_done() -> None:
    """With the memory of a robot at home, which is out of date, `bfdn` led three to and fro."""
    roi = grown("thin", 18, 176)
    done = run(EXPLORERS["bfdn"], roi.cells, roi.start, 5, comms=Links(range_cells=2.0))
    assert done.makespan < 50


def test_another_seed_loses_other_messages() -> None:
    roi = grown("eden", 60, 3)
    seen = {
        run(EXPLORERS["rdfs"], roi.cells, roi.start, 4, comms=Links(loss=0.6, seed=seed)).legs
        for seed in range(4)
    }
    assert len(seen) > 1


@pytest.mark.parametrize("name", ["rdfs", "horizon"])
def test_between_meeting_and_shared_a_radio_helps(name: str) -> None:
    """In the mean over regions, not in each: who knows more may still choose worse."""

    def mean(comms: Comms | Links) -> float:
        regions = [grown("eden", 60, seed) for seed in range(4)]
        makespans = [run(EXPLORERS[name], r.cells, r.start, 4, comms=comms) for r in regions]
        return sum(each.makespan for each in makespans) / len(regions)

    shared, near, far = mean(Comms.SHARED), mean(Links(range_cells=2.0)), mean(Comms.MEETING)
    assert shared < near < far
