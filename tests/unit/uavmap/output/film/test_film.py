"""The film of a run or a journal shows the knowledge and the positions of each time."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.events import Connected, FrameSeen, Tracked, Vote
from missions.flight.setting_of import setting_of
from missions.lab.arena.arena_run import Comms
from missions.units import Cell, GridPoint
from tests.support.small_missions import mission, square
from tests.unit.uavmap.output.film.runs import START, explored, small_film, small_roi, tree_until
from uavmap.lab.run_film import film_of_run
from uavmap.output.film import film as films


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 5), st.floats(0.0, 1.0))
def test_film_shows_the_tree_as_it_was(seed, robots, part):
    roi = small_roi(20, seed)
    run = explored(roi, robots)
    t = part * run.makespan
    reel, tree = films.Reel(film_of_run(run, roi, "")), tree_until(run, roi, t)
    list(reel.forward(t))
    assert reel.states == {cell: tree.state(cell).value for cell in tree.vertices}
    parents = {cell: vertex.parent for cell, vertex in tree.vertices.items()}
    assert reel.parents == {cell: above for cell, above in parents.items() if above is not None}


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 5))
def test_robots_that_only_meet_show_the_cells_of_all(seed, robots):
    roi = small_roi(20, seed)
    run = explored(roi, robots, Comms.MEETING)
    film = film_of_run(run, roi, "")
    reel, seen = films.Reel(film), {START}
    for t in sorted({leg.end_t for leg in run.legs}):
        seen |= {leg.end for leg in run.legs if leg.end_t <= t}
        list(reel.forward(t))
        known = seen | {n for cell in seen for n in cell.neighbours() if n in roi}
        assert set(reel.states) == known
        assert {c for c, state in reel.states.items() if state != "unexplored"} == seen
    assert set(reel.states.values()) == {"explored"}


def test_robots_move_along_their_legs_and_wait_between():
    crowd = small_film(robots=20)  # each is drawn inside of its cell
    for robot in range(20):
        assert max(map(abs, crowd.fix(robot, 0.0).place)) + crowd.radius < 0.5
    roi = {Cell(0, 0), Cell(1, 0), Cell(2, 0), Cell(0, 1)}
    run = explored(roi, 2)
    film = film_of_run(run, roi, "")
    spot = {robot: track[0].place for robot, track in film.tracks.items()}
    assert len(set(spot.values())) == 2  # no disc hides another
    for leg in run.legs:
        for part in (0.0, 0.25, 1.0):
            place = film.fix(leg.robot, leg.start_t + part * (leg.end_t - leg.start_t)).place
            east = leg.start.east + part * (leg.end.east - leg.start.east)
            north = leg.start.north + part * (leg.end.north - leg.start.north)
            assert place.east - spot[leg.robot].east == pytest.approx(east)
            assert place.north - spot[leg.robot].north == pytest.approx(north)
    for robot in film.tracks:
        assert film.fix(robot, -1.0).place == spot[robot]
        assert film.fix(robot, film.end_t + 1.0).place == pytest.approx(spot[robot])


@pytest.mark.parametrize("unit", list(films.Unit))
@pytest.mark.parametrize("end_t", [0.0, 0.5, 7.0, 300.0, 1e6])
def test_film_is_never_longer_than_twenty_seconds(unit, end_t):
    film = films.Film("", unit, end_t, frozenset(), (), {}, films.Place(0.0, 0.0))
    times = film.times()
    assert (times[0], times[-1]) == (0.0, end_t)
    assert len(times) / films.FPS + films.HOLD_S <= films.LONGEST_S
    assert times == sorted(times)


def test_trail_goes_round_the_corners():
    corner, end = films.Place(1.0, 0.0), films.Place(1.0, 1.0)
    track = (films.Fix(0.0, films.Place(0.0, 0.0)), films.Fix(1.0, corner), films.Fix(2.0, end))
    film = films.Film("", films.Unit.STEPS, 2.0, frozenset(), (), {0: track}, films.Place(0.0, 0.0))
    assert film.trail(0, 0.5, 1.5) == [films.Place(0.5, 0.0), corner, films.Place(1.0, 0.5)]


# --- of a journal, from events alone -------------------------------------------------------------
BOX = square(0.0, 0.0, 40.0, 40.0)
FENCE = square(-30.0, -30.0, 120.0, 120.0)


def seen(t_s, positive):
    votes = (Vote(Cell(2, 0), positive, 1.0), Vote(Cell(3, 0), False, 0.0))
    return FrameSeen(1, t_s, Cell(2, 0), votes)


def test_film_shows_cells_and_vehicle_relative_to_the_roi():
    setting = setting_of(mission(BOX, FENCE, drift_m_s=0.4, toward_deg=90.0))
    events = [
        Connected(1, 0.0, GridPoint(0.0, 0.0), GridPoint(0.0, 0.0), 0.0, False, True, 25.0),
        Tracked(1, 10.0, GridPoint(8.0, 0.0), 12.0, 24.0),
        seen(10.0, True),
        seen(10.2, True),
        seen(10.4, True),
    ]
    film, state = films.film_of_flight(setting, events, "a flight")
    assert film.unit is films.Unit.SECONDS
    assert film.end_t == 10.4
    first, second = film.tracks[1]
    assert not first.aloft
    assert second.aloft
    assert abs(second.place.east - 1.0) < 0.05  # 8 m out, 4 m of them drifted away below it
    assert abs(film.start_at(10.0).east + 1.0) < 0.05
    states = [(change.t, change.cell, change.state) for change in film.changes]
    assert states[:2] == [(10.0, Cell(2, 0), "non-roi"), (10.0, Cell(3, 0), "non-roi")]
    assert [state for t, cell, state in states if cell == Cell(2, 0)][-1] != "non-roi"
    assert Cell(2, 0) in state.belief.roi


def test_film_of_photographs_has_cells_and_no_tracks():
    setting = setting_of(mission(BOX, FENCE))
    events = [seen(0.1 * i, True) for i in range(5)]
    film, _ = films.film_of_flight(setting, events, "photographs", recorded=True)
    assert film.tracks == {}
    assert film.start == films.Place(0.0, 0.0)
    assert {change.cell: change.state for change in film.changes} == {
        Cell(2, 0): "explored",
        Cell(3, 0): "non-roi",
    }
