"""Facts of a fleet: any history of partitions, losses and repetitions gives the same knowledge."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.classes import ClassShare
from missions.events import Event, FrameSeen, Vote, from_json, to_json
from missions.fleet_events import Fact, FactsShared
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.flight.team.members import concluded
from missions.flight.team.members import facts_of as facts_in_journal
from missions.flight.vehicle_state import Phase
from missions.mapping.belief import Belief, FrameId
from missions.mapping.frame_sums import FrameSums
from missions.mapping.own_cells import OwnCells
from missions.mission.checks import parse_mission
from missions.units import Cell
from tests.support.fleet_rig import field_text
from tests.support.small_missions import joined, mission_text
from uavmap.fleet.knowledge import Knowledge

CHECKED = settings(max_examples=150, deadline=None)
cells = st.builds(Cell, st.integers(0, 3), st.integers(0, 1))
ballots = st.dictionaries(cells, st.booleans(), min_size=1, max_size=8)
frame_lists = st.lists(st.tuples(st.integers(1, 3), ballots), max_size=60)
looks = st.dictionaries(cells, st.sampled_from(["region", "ground", "unsure"]), max_size=8)
passes = st.lists(
    st.tuples(st.integers(1, 3), st.booleans(), st.lists(looks, max_size=6)), max_size=9
)


def seen_by(frames: list[tuple[int, dict[Cell, bool]]]) -> list[FrameSeen]:
    """Return three frames a second of the given vehicles."""
    return [
        FrameSeen(vehicle, k / 3, None, tuple(Vote(c, v, float(v)) for c, v in votes.items()))
        for k, (vehicle, votes) in enumerate(frames)
    ]


def seen_in_passes(
    flown: list[tuple[int, bool, list[dict[Cell, str]]]],
) -> list[FrameSeen]:
    """Return frames of vehicles over cells, three a second; at `stays` the next follows soon."""
    seen, t_s = list[FrameSeen](), 0.0
    for vehicle, stays, frames in flown:
        for cells in frames:
            votes = tuple(Vote(c, what == "region", 0.5) for c, what in cells.items())
            unsure = tuple(c for c, what in cells.items() if what == "unsure") or None
            seen.append(FrameSeen(vehicle, t_s, None, votes, unsure=unsure))
            t_s += 1 / 3
        t_s += 0.0 if stays else 9.0
    return seen


def facts_of(vehicle: int, seen: list[FrameSeen]) -> list[Fact]:
    own, reported = OwnCells(Belief(5, 3), Belief(5, 3)), list[Fact]()
    for event in seen:
        if event.vehicle == vehicle:
            reported.extend(own.add(event))
    return reported + own.passed(1e6)


@CHECKED
@given(frame_lists)
def test_facts_are_the_verdicts_of_the_frames_of_one_vehicle(
    frames: list[tuple[int, dict[Cell, bool]]],
) -> None:
    seen = seen_by(frames)
    for vehicle in (1, 2, 3):
        belief = Belief(5, 3)
        for event in (event for event in seen if event.vehicle == vehicle):
            shown = {vote.cell: vote.positive for vote in event.votes}
            belief = belief.with_frame(None, FrameId(vehicle, event.t_s), shown)
        facts = facts_of(vehicle, seen)
        reported = [vote for fact in facts if not fact.seen for vote in fact.votes]
        in_passing = [cell for fact in facts if fact.seen for cell, _ in fact.votes]
        assert len(in_passing) == len(set(in_passing))
        assert len(reported) == len(dict(reported))  # each cell once
        for cell in belief.open_ballots:
            assert dict(reported).get(cell) == belief.verdict(cell)


def test_facts_have_mean_shares_of_explored_classes_in_tenths_and_older_journals_none() -> None:
    here, beside = Cell(0, 0), Cell(1, 0)
    shares = [(0.84, 0.0), (0.62, 0.1), (0.7, 0.0)]
    own, reported = OwnCells(Belief(5, 3), Belief(5, 3), (2, 4)), list[Fact]()
    for k, (two, three) in enumerate(shares):
        found = (ClassShare(here, 2, two), ClassShare(here, 3, 0.2), ClassShare(beside, 4, three))
        votes = (Vote(here, True, two), Vote(beside, False, three))
        reported += own.add(FrameSeen(1, k / 4, None, votes, classes=found))
    reported += own.passed(2.0)
    decided = ((here, True), (beside, False))
    assert reported == [Fact(0.0, decided, classes=(ClassShare(here, 2, 0.7),))]
    event = FactsShared(1, 3.0, 0, (reported[0], reported[0]._replace(classes=())))
    assert from_json(to_json(event)) == event
    before = to_json(event).replace(",[],false]", "]").replace("]],false]", "]]]")  # without both
    assert before != to_json(event)
    assert from_json(before) == event


@CHECKED
@given(frame_lists, st.data())
def test_members_that_know_the_same_facts_have_the_same_region(
    frames: list[tuple[int, dict[Cell, bool]]], data: st.DataObject
) -> None:
    seen = seen_by(frames)
    regions = set()
    for member in (0, 1, 2, 3):
        setting = small_setting(member)
        own: list[Event] = [event for event in seen if event.vehicle == member]
        received: list[Event] = [
            FactsShared(vehicle, 0.0, k, (fact,))
            for vehicle in (1, 2, 3)
            if vehicle != member
            for k, fact in enumerate(facts_of(vehicle, seen))
        ]
        places = data.draw(st.lists(st.integers(0, len(own)), min_size=len(received), max_size=60))
        events = list(own)
        for event, place in zip(data.draw(st.permutations(received)), places, strict=False):
            events.insert(place, event)
        events += received  # and all of it once more
        state = joined(setting.initial_state(), events)
        decided = {
            (cell, state.belief.verdict(cell))
            for cell in state.belief.open_ballots
            if state.belief.verdict(cell) is not None
        }
        regions.add(frozenset(decided))
    assert len(regions) == 1


@settings(CHECKED, max_examples=40)
@given(passes, st.data())
def test_members_that_know_the_same_facts_have_the_same_unsure_cells(
    flown: list[tuple[int, bool, list[dict[Cell, str]]]], data: st.DataObject
) -> None:
    seen = seen_in_passes(flown)
    doubted = set[Cell]()
    for vehicle in (1, 2, 3):  # half of the frames of a vehicle
        of_one = FrameSums()
        for event in seen:
            if event.vehicle == vehicle:
                of_one.note(event)
        doubted |= {Cell(*cell) for cell in of_one.cells().tolist()}
    for member in (0, 1, 2, 3):
        received = [
            FactsShared(vehicle, 0.0, k, (fact,))
            for vehicle in (1, 2, 3)
            if vehicle != member
            for k, fact in enumerate(facts_of(vehicle, seen))
        ]
        own = [event for event in seen if event.vehicle == member]
        events: list[FrameSeen | FactsShared] = [
            *data.draw(st.permutations(received)),
            *own,
            *received,
        ]
        facts, live = facts_in_journal(small_setting(member)), FrameSums()
        for event in events:
            facts.add(event)
            live.note(event)
        facts.joined()
        found = FrameSums(facts.doubts)
        of_map = {Cell(*cell) for cell in found.cells().tolist()}
        assert of_map == {Cell(*cell) for cell in live.cells().tolist()} == doubted
        assert all(found.is_unsure(cell) for cell in doubted)
        assert found.which_unsure(np.array(sorted(doubted), np.int32).reshape(-1, 2)).all()


@lru_cache
def small_setting(member: int | None) -> Setting:
    text = mission_text(
        [(0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0)],
        [(-60.0, -60.0), (90.0, -60.0), (90.0, 90.0), (-60.0, 90.0)],
        vehicles=3, homes=[(0.0, -20.0), (20.0, -20.0), (40.0, -20.0)], strategy="swath",
    )  # fmt: skip
    return setting_of(parse_mission(text, "test"), member)


facts = st.lists(st.booleans(), max_size=30).map(
    lambda verdicts: [Fact(float(k), ((Cell(k, 0), v),)) for k, v in enumerate(verdicts)]
)


@CHECKED
@given(st.lists(facts, min_size=2, max_size=4), st.randoms(use_true_random=False))
def test_facts_in_any_order_twice_and_in_any_batches_are_the_same(
    logs: list[list[Fact]], chance: random.Random
) -> None:
    batches = []
    for origin, log in enumerate(logs, start=1):
        for _ in range(3):  # each is sent several times, cut differently
            cuts = sorted({0, len(log), *(chance.randint(0, len(log)) for _ in range(3))})
            batches.extend((origin, a, log[a:b]) for a, b in itertools.pairwise(cuts))
    chance.shuffle(batches)
    known, new = Knowledge(), 0
    for origin, first, frames in batches:
        for run in known.add(origin, first, frames):
            new += len(run.facts)
            assert run.facts == tuple(logs[origin - 1][run.first : run.first + len(run.facts)])
    assert known.facts == {
        origin: dict(enumerate(log)) for origin, log in enumerate(logs, start=1) if log
    }
    assert new == sum(map(len, logs))  # no fact is new twice


@CHECKED
@given(st.lists(facts, min_size=3, max_size=3), st.data())
def test_members_that_compare_their_facts_end_with_the_same(
    logs: list[list[Fact]], data: st.DataObject
) -> None:
    """Any pairs meet and lose messages; then follows one round in contact."""
    members = {number: Knowledge() for number in (1, 2, 3)}
    for number, member in members.items():
        member.add(number, 0, logs[number - 1])
    pairs = st.tuples(st.sampled_from([1, 2, 3]), st.sampled_from([1, 2, 3]), st.booleans())
    history = data.draw(st.lists(pairs, max_size=12))
    last = [(a, b, False) for _ in range(2) for a in members for b in members]
    for one, other, lost in [*history, *last]:
        for origin, numbers in members[one].missing(members[other].have).items():
            reported = numbers if not lost else data.draw(st.lists(st.sampled_from(numbers)))
            for number in reported:
                members[other].add(origin, number, [members[one].facts[origin][number]])
    assert members[1].have == members[2].have == members[3].have
    for origin in members[1].have:
        log = dict(enumerate(logs[origin - 1]))
        assert members[1].facts[origin] == members[2].facts[origin] == log
        assert members[3].facts[origin] == log
    assert not members[1].lacking(members[2].have)


# --- the end -----------------------------------------------------------------------------------
@pytest.mark.parametrize("missing", [0, 1])
def test_member_home_early_is_complete_once_the_others_did_the_rest(missing: int) -> None:
    setting = setting_of(parse_mission(field_text(high=True), "test"), 1)
    state = replace(setting.initial_state(), t_s=300.0)
    for number, phase in ((1, Phase.FAILED), (2, Phase.FINISHED), (3, Phase.FINISHED)):
        came = replace(state.vehicles[number], phase=phase, landed=True, order=None)
        state = state.with_vehicle(came)
    region = {Cell(4, 6), Cell(5, 6)}
    wide = {Cell(c.east + i, c.north + j) for c in region for i in (-1, 0, 1) for j in (-1, 0, 1)}
    cells = sorted({*setting.box_cells, *wide})
    reported = Fact(250.0, tuple((c, c in region) for c in cells[missing:]))
    state = joined(state, [FactsShared(2, 251.0, 0, (reported,))])
    assert not state.completed  # its own service abandoned and ended nothing
    ended = concluded(state)
    assert ended.completed is (missing == 0)
    assert not ended.undecided
    flying = state.with_vehicle(replace(state.vehicles[1], phase=Phase.AIRBORNE, landed=False))
    assert concluded(flying) is flying
