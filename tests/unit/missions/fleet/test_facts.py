"""Facts of a fleet: any history of partitions, losses and repetitions gives the same knowledge."""

from __future__ import annotations

import itertools
import random

from hypothesis import given, settings
from hypothesis import strategies as st

from missions.events import FrameSeen, SharedFrame, Vote
from missions.fleet.knowledge import Knowledge
from missions.fleet.own_votes import OwnVotes
from missions.mapping.belief import Belief, FrameId
from missions.units import Cell

CHECKED = settings(max_examples=150, deadline=None)
cells = st.builds(Cell, st.integers(0, 3), st.integers(0, 1))
ballots = st.dictionaries(cells, st.booleans(), min_size=1, max_size=8)


@CHECKED
@given(st.lists(st.tuples(st.integers(1, 3), ballots), max_size=60), st.data())
def test_the_votes_that_are_told_decide_as_all_votes_do(
    frames: list[tuple[int, dict[Cell, bool]]], data: st.DataObject
) -> None:
    """Whoever cast them, in whatever order their owner got to know them."""
    own = {vehicle: OwnVotes.none(5, 3) for vehicle in (1, 2, 3)}
    everything, told = Belief(5, 3), Belief(5, 3)
    seen = [
        FrameSeen(vehicle, float(t_s), None, tuple(Vote(c, v, 1.0) for c, v in votes.items()))
        for t_s, (vehicle, votes) in enumerate(frames)
    ]
    for event in data.draw(st.permutations(seen)):
        frame = FrameId(event.vehicle, event.t_s)
        says = {vote.cell: vote.positive for vote in event.votes}
        everything = everything.with_frame(None, frame, says)
        own[event.vehicle], fact = own[event.vehicle].with_frame(event)
        if fact is not None:
            told = told.with_frame(None, frame, dict(fact.votes))
    assert told.roi == everything.roi
    for cell in everything.open_ballots:
        assert told.verdict(cell) == everything.verdict(cell), cell


def test_of_a_cell_that_stays_the_same_three_votes_are_told() -> None:
    own, told = OwnVotes.none(5, 3), 0
    for t_s in range(20):
        votes = (Vote(Cell(0, 0), False, 0.0), Vote(Cell(1, 0), True, 1.0))
        own, fact = own.with_frame(FrameSeen(1, float(t_s), None, votes))
        told += 0 if fact is None else len(fact.votes)
    assert told == 6


facts = st.lists(st.booleans(), max_size=30).map(
    lambda says: [SharedFrame(float(k), ((Cell(k, 0), v),)) for k, v in enumerate(says)]
)


@CHECKED
@given(st.lists(facts, min_size=2, max_size=4), st.randoms(use_true_random=False))
def test_facts_in_any_order_twice_and_in_any_batches_are_the_same(
    logs: list[list[SharedFrame]], chance: random.Random
) -> None:
    batches = []
    for origin, log in enumerate(logs, start=1):
        for _ in range(3):  # each is told several times, cut otherwise
            cuts = sorted({0, len(log), *(chance.randint(0, len(log)) for _ in range(3))})
            batches.extend((origin, a, log[a:b]) for a, b in itertools.pairwise(cuts))
    chance.shuffle(batches)
    known, new = Knowledge(), 0
    for origin, first, frames in batches:
        new += len(known.take(origin, first, frames))
    assert known.facts == {origin: log for origin, log in enumerate(logs, start=1) if log}
    assert new == sum(map(len, logs))  # nothing is new twice


@CHECKED
@given(st.lists(facts, min_size=3, max_size=3), st.data())
def test_whoever_compares_what_they_have_ends_with_the_same(
    logs: list[list[SharedFrame]], data: st.DataObject
) -> None:
    """Any history of meetings, of any pairs, with messages lost; then one round in contact."""
    members = {number: Knowledge() for number in (1, 2, 3)}
    for number, member in members.items():
        member.take(number, 0, logs[number - 1])
    pairs = st.tuples(st.sampled_from([1, 2, 3]), st.sampled_from([1, 2, 3]), st.booleans())
    history = data.draw(st.lists(pairs, max_size=12))
    last = [(a, b, False) for _ in range(2) for a in members for b in members]
    for one, other, lost in [*history, *last]:
        for origin, first in members[one].missing(members[other].have).items():
            if not lost:
                members[other].take(origin, first, members[one].facts[origin][first:])
    assert members[1].have == members[2].have == members[3].have
    for origin in members[1].have:
        assert members[1].facts[origin] == logs[origin - 1]
        assert members[2].facts[origin] == members[3].facts[origin] == logs[origin - 1]
    assert not members[1].lacking(members[2].have)
