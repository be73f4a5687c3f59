"""Certificates of patches, against counts by hand, and in any order of the facts."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.events import FrameSeen, Vote
from missions.fleet_events import FactsShared
from missions.flight.setting_of import setting_of
from missions.geo.grid import Grid
from missions.mapping.belief import Belief, FrameId, judging_frames
from missions.mapping.own_cells import OwnCells
from missions.planning.lower_bounds import passing_bound_s
from missions.units import Cell
from tests.fake_fleet import fleet
from tests.golden.recording import STOPS
from tests.support.small_missions import joined, mission, random_scenario, scattered, square
from uavmap.output.facts.figures import figures, summary
from uavmap.output.facts.patch_certificates import beyond_fence, certificates
from uavmap.output.summary import lines
from uavmap.ui.cli.common import report


@lru_cache
def setting(member=None, *, strategy="swath"):
    """Return a box of 7 x 4 cells, its lower left corner at (-1, 3), well inside the fence."""
    made = mission(
        square(-6, 10, 28, 16), square(-40, -40, 100, 110), vehicles=2, strategy=strategy,
        mounting="gimbal",
    )  # fmt: skip
    return setting_of(made, member)


def seen(t_s, region, ground, vehicle=1):
    votes = [*((cell, True) for cell in region), *((cell, False) for cell in ground)]
    return FrameSeen(vehicle, t_s, None, tuple(Vote(c, v, float(v)) for c, v in sorted(votes)))


def state_of(*frames):
    state = setting().initial_state()
    belief = state.belief
    for frame in frames:
        said = {vote.cell: vote.positive for vote in frame.votes}
        belief = belief.with_frame(None, FrameId(frame.vehicle, frame.t_s), said)
    return replace(state, belief=belief, t_s=max((f.t_s for f in frames), default=0.0))


def block(east, north, wide, high):
    return {Cell(east + i, north + j) for i in range(wide) for j in range(high)}


def around(cells):
    return {near for cell in cells for near in cell.neighbours()} - cells


def test_certificates_of_two_patches_and_of_all():
    """A block of two cells that three frames decide, and one cell whose east is never shown."""
    pair, single = block(0, 4, 2, 1), {Cell(4, 5)}
    ground = around(single) - {Cell(5, 5)}
    frames = [seen(20.0 + k, pair, set()) for k in range(3)]
    frames += [seen(30.0 + k, single, around(pair) | ground, 2) for k in range(3)]
    (first, second), in_all = certificates(state_of(*frames), 10.0)
    assert (first["cells"], first["area_m2"], first["complete"]) == (2, 32.0, True)
    assert (first["root"]["column"], first["root"]["row"]) == (0, 4)
    assert (first["root"]["seen_s"], first["found_s"], first["decided_s"]) == (10.0, 12.0, 22.0)
    assert (first["took_s"], first["open"]) == (10.0, {})
    assert second["open"] == {"no_frames": [[5, 5]]}
    assert (second["complete"], second["found_s"], second["took_s"]) == (False, 22.0, 0.0)
    assert (in_all["patches"], in_all["cells"], in_all["complete"]) == (2, 3, False)
    assert in_all["open"] == {"no_frames": 1}
    assert (in_all["found_s"], in_all["decided_s"], in_all["took_s"]) == (12.0, 22.0, 10.0)
    decided = pair | single | around(pair) | ground
    box = set(setting().box_cells)
    assert in_all["box"] == {
        "cells": 28, "decided": len(decided & box), "few_frames": 0,
        "no_frames": len(box - decided), "beyond_fence": 0, "whole": False,
    }  # fmt: skip
    told = list(lines(*certificates(state_of(*frames), 10.0), verbose=True))
    assert "open at 1 cell: 1 in no frame" in told[1]
    assert told[2].startswith("all 2 patches: 48 sq m, open at 1 cell")
    assert told[3].endswith("a patch may be missing there")


def test_lower_bound_covers_the_ground_judged_later():
    """20 x 20 cells, one of which is judged at once; two vehicles, level cameras."""
    region = block(0, 0, 20, 20)
    frames = [seen(float(k), {Cell(0, 0)}, set()) for k in range(3)]
    frames += [seen(90.0 + k, region, around(region)) for k in range(3)]
    (patch,), in_all = certificates(state_of(*frames), 0.0)
    optics = setting().mission.camera.optics
    top_m = max(setting().mission.altitude_m(k) for k in range(2))
    ground_m2 = (400 - 1 + 80) * 16.0
    expected_s = passing_bound_s(ground_m2, 2, 0, optics.footprint(top_m), 0.0, 5.0)
    assert patch["lower_bound_s"] == pytest.approx(expected_s, abs=0.05)
    assert patch["took_s"] == 90.0
    assert patch["ratio"] == pytest.approx(90.0 / expected_s, rel=0.01)
    assert in_all["lower_bound_s"] == patch["lower_bound_s"] > 10.0


def test_open_cell_has_its_reason():
    one = Cell(2, 5)
    frames = [seen(float(k), {one}, set()) for k in range(3)]
    state = state_of(*frames, seen(3.0, set(), {Cell(2, 6)}))

    def reasons(state):
        return certificates(state, 0.0)[1]["open"]

    assert reasons(state) == {"few_frames": 1, "no_frames": 3}
    assert reasons(replace(state, undecided=frozenset({Cell(2, 6)}))) == {
        "given_up": 1, "no_frames": 3,
    }  # fmt: skip
    assert reasons(replace(state, abandoned=frozenset({one}))) == {"out_of_reach": 4}
    assert reasons(replace(state, skipped=frozenset({one}))) == {"skipped": 4}


@pytest.mark.parametrize("strategy", ["swath", "rdfs"])
def test_cell_out_of_every_view_is_beyond_the_fence(strategy):
    """The fence ends at 60 m east: a cell at 80 m is out of every view, one at 40 m is not."""
    cells = [Cell(10, 0), Cell(20, 0), Cell(0, -30)]
    found = beyond_fence(setting(strategy=strategy), cells, 0.0)
    assert found == {Cell(20, 0), Cell(0, -30)}


def test_cell_that_drifted_out_is_beyond_the_fence():
    there = setting()
    grid = Grid.at(there.mission.home, 4.0, 0.5, 90.0)
    drifting = replace(there, grid=grid)
    assert not beyond_fence(drifting, [Cell(10, 0)], 0.0)
    assert beyond_fence(drifting, [Cell(10, 0)], 120.0)  # 60 m farther


def test_box_without_a_region_has_the_only_certificate():
    shown = set(setting().box_cells)
    frames = [seen(float(k), set(), shown) for k in range(3)]
    found, in_all = certificates(state_of(*frames), 0.0)
    assert found == []
    assert (in_all["complete"], in_all["took_s"], in_all["ratio"]) == (False, None, None)
    assert in_all["box"]["whole"]
    assert list(lines(found, in_all, verbose=True)) == ["search box: 28 of 28 cells decided"]


def test_summary_of_a_flight_shows_patches_and_unseen_ground(capsys):
    summary = STOPS.recorded()["summary"]
    assert report(summary, Path("out"), as_json=False) == 0
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "search box: 11 of 12 cells decided, 1 in too few frames; a patch may be" in shown
    assert "patch 1: 96 sq m, complete, at 47.300108, 8.500105" in shown
    assert "depth of the tree" not in shown
    report(summary, Path("out"), as_json=False, verbose=True)
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "patch 1: 96 sq m, complete; decided from 19.4 s on, at 47.300108, 8.500105" in shown
    assert "depth of the tree" in shown


# --- in any order ------------------------------------------------------------------------------
CHECKED = settings(max_examples=60, deadline=None)
cells = st.builds(Cell, st.integers(-1, 3), st.integers(3, 5))
ballots = st.dictionaries(cells, st.booleans(), min_size=1, max_size=8)
frame_lists = st.lists(st.tuples(st.integers(1, 3), ballots), max_size=40)


def frames_of(drawn):
    return [
        FrameSeen(vehicle, k / 3, None, tuple(Vote(c, v, float(v)) for c, v in votes.items()))
        for k, (vehicle, votes) in enumerate(drawn)
    ]


@CHECKED
@given(frame_lists, st.data())
def test_frames_in_any_order_and_twice_give_one_certificate(drawn, data):
    frames = frames_of(drawn)
    state = state_of(*frames)
    again = data.draw(st.permutations(frames + frames[: len(frames) // 2]))
    told = certificates(state, 0.0)
    assert certificates(state_of(*again), 0.0) == told
    judged = judging_frames(state.belief)
    assert set(judged) == {
        cell for cell in state.belief.open_ballots if state.belief.verdict(cell) is not None
    }
    for cell, frame in judged.items():  # it is the frame after which the verdict stayed
        before = [f for f in frames if f.t_s < frame.t_s]
        until = [f for f in frames if f.t_s <= frame.t_s]
        assert state_of(*before).belief.verdict(cell) is None
        assert state_of(*until).belief.verdict(cell) is state.belief.verdict(cell)


@CHECKED
@given(frame_lists, st.data())
def test_facts_of_a_fleet_in_any_order_give_one_certificate(drawn, data):
    told = []
    for vehicle in (1, 2, 3):
        own, facts = OwnCells(Belief(5, 3), Belief(5, 3)), []
        for frame in frames_of(drawn):
            if frame.vehicle == vehicle:
                facts.extend(own.add(frame))
        facts.extend(own.passed(1e6))
        told.extend(FactsShared(vehicle, 0.0, k, (fact,)) for k, fact in enumerate(facts))
    listening = setting(0)

    def certified(events):
        state = joined(listening.initial_state(), events)
        return certificates(state, 0.0)

    assert certified(data.draw(st.permutations(told + told[::2]))) == certified(told)


# --- in flight ---------------------------------------------------------------------------------
def test_flight_from_two_heights_certifies_each_patch():
    seed = 4
    scenario = scattered(random_scenario(seed, strategy="swath"), seed, high=True)
    flight = fleet(scenario.mission, scenario.roi)
    flight.start()
    flight.run()
    state, found = figures(flight.setting, flight.events)
    values = summary(state, found, seed)
    assert state.completed
    in_all = values["patches_in_all"]
    assert in_all["complete"]
    assert in_all["box"]["no_frames"] == 0
    for one in (*values["patches"], in_all):
        assert one["complete"]
        assert 0.0 <= one["lower_bound_s"] <= one["took_s"] + 0.1
        assert 0.0 < one["found_s"] <= one["decided_s"] <= found.makespan_s
    assert in_all["decided_s"] == max(one["decided_s"] for one in values["patches"])
