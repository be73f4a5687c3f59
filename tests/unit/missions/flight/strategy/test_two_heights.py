"""Which cells are plain by frames from the height of a search."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.flight.setting_of import setting_of
from missions.flight.step import assign
from missions.flight.strategy.every_patch import ALL
from missions.flight.vehicle_state import Phase
from missions.mapping.belief import Belief, FrameId
from missions.mapping.overview import from_below, with_plain
from missions.orders import TakeOff
from missions.units import Cell
from uavmap.load.mission_source import load

BOX = frozenset(Cell(east, north) for east in range(6) for north in range(5))
FRAMES = st.lists(st.dictionaries(st.sampled_from(sorted(BOX)), st.booleans()), max_size=25)


def seen(frames: int, region: frozenset[Cell]) -> Belief:
    """What is plain after so many frames of the whole box."""
    nothing = Belief(5, 3)
    belief = overview = nothing
    for t in range(frames):
        votes = {cell: cell in region for cell in sorted(BOX)}
        overview = overview.with_frame(None, FrameId(1, float(t)), votes)
        belief = with_plain(belief, overview, BOX, votes)
    return belief


def test_what_lies_along_an_outline_is_left_to_be_looked_at_from_below() -> None:
    region = frozenset(cell for cell in BOX if cell.east < 3)
    belief = seen(3, region)
    # cells of the region at the rim of the box, beyond which nobody has looked, are not plain
    assert set(belief.roi) == {Cell(1, 1), Cell(1, 2), Cell(1, 3)}
    assert {cell for cell in BOX if belief.verdict(cell) is False} == {
        cell for cell in BOX if cell.east >= 4
    }
    assert not seen(2, region).open_ballots


def seen_from_below(belief: Belief, frames: int, region: frozenset[Cell]) -> Belief:
    """What is decided after so many frames from below of the whole box."""
    votes = {cell: cell in region for cell in sorted(BOX)}
    return belief.with_frames(None, {FrameId(1, 10.0 + t): votes for t in range(frames)})


def west_of(east: int) -> frozenset[Cell]:
    return frozenset(cell for cell in BOX if cell.east < east)


@pytest.mark.parametrize(("high", "column", "says"), [(5, 3, False), (1, 2, True)])
def test_plain_cells_go_by_frames_from_below_where_these_decide_otherwise(
    high: int, column: int, says: bool
) -> None:
    plain = seen(3, west_of(high))  # by an outline that lies two cells beside the true one
    belief = seen_from_below(plain, 5, west_of(3))
    # at the rim of the box a neighbour is undecided
    wrong = {Cell(column, north): says for north in (1, 2, 3)}
    assert all(belief.verdict(cell) is not says for cell in wrong)
    found = from_below(belief, plain)
    assert found == wrong
    corrected = belief.with_verdicts(found)
    assert all(corrected.verdict(cell) is says for cell in wrong)
    assert all((cell in corrected.roi) is says for cell in wrong)


def test_plain_cells_stay_so_while_frames_from_below_have_not_decided() -> None:
    plain = seen(3, west_of(5))
    assert from_below(seen_from_below(plain, 2, west_of(3)), plain) == {}


@settings(max_examples=40)
@given(frames=FRAMES)
def test_looking_at_what_a_frame_has_decided_is_as_good_as_looking_at_all(
    frames: list[dict[Cell, bool]],
) -> None:
    nothing = Belief(3, 2)
    quick = slow = overview = nothing
    for t, votes in enumerate(frames):
        fresh = overview.undecided(votes)
        overview = overview.with_frame(None, FrameId(1, float(t)), votes)
        quick = with_plain(quick, overview, BOX, fresh)
        slow = with_plain(slow, overview, BOX, BOX)
    assert quick == slow


def test_who_has_no_lane_takes_off_as_soon_as_there_is_an_outline_to_map() -> None:
    mission = load("bay")
    setting = setting_of(mission)
    region = frozenset(Cell(east, north) for east in range(10, 20) for north in range(20, 30))
    state = setting.initial_state()
    for number, vehicle in state.vehicles.items():
        lanes = vehicle.lanes[:1] if number < 5 else ()
        grounded = replace(
            vehicle, phase=Phase.GROUNDED, landed=True, lanes=lanes,
            position=setting.pad_of(number), home=setting.pad_of(number),
            remaining_wh=100.0,
        )  # fmt: skip
        state = state.with_vehicle(grounded)
    assert assign(state).vehicles[5].order is None
    belief = state.belief
    for k in range(3):
        belief = belief.with_frame(None, FrameId(1, float(k)), dict.fromkeys(region, True))
    order = assign(replace(state, belief=belief)).vehicles[5].order
    assert order == TakeOff(mission.altitude_m(4))


def test_cell_beside_what_is_region_from_on_high_is_asked_for_until_it_is_decided() -> None:
    setting = setting_of(load("bay"))
    state = setting.initial_state()
    region, beside, far = Cell(10, 20), Cell(11, 20), Cell(30, 20)
    overview, belief = state.overview, state.belief
    for k in range(3):
        overview = overview.with_frame(None, FrameId(1, float(k)), {region: True})
    belief = belief.with_frame(None, FrameId(2, 5.0), {beside: False, far: False})
    state = replace(state, belief=belief, overview=overview)
    asked = ALL.asked_for(state)
    assert beside in asked
    assert far not in asked  # a frame took it for ground, and no region is near
    seen = state.belief
    for k in range(3):
        seen = seen.with_frame(None, FrameId(2, 6.0 + k), {region: False})
    assert beside not in ALL.asked_for(replace(state, belief=seen))
