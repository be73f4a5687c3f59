"""The film of a journal, from events alone."""

from __future__ import annotations

from missions.events import Connected, FrameSeen, Tracked, Vote
from missions.flight.setting_of import setting_of
from missions.units import Cell, GridPoint
from tests.support.small_missions import mission, square
from uavmap.output.film.film import Place, Unit, film_of_flight

BOX = square(0.0, 0.0, 40.0, 40.0)
FENCE = square(-30.0, -30.0, 120.0, 120.0)


def seen(t_s: float, positive: bool) -> FrameSeen:
    votes = (Vote(Cell(2, 0), positive, 1.0), Vote(Cell(3, 0), False, 0.0))
    return FrameSeen(1, t_s, Cell(2, 0), votes)


def test_what_was_judged_and_where_the_vehicle_was_as_seen_from_the_roi():
    setting = setting_of(mission(BOX, FENCE, drift_m_s=0.4, toward_deg=90.0))
    events = [
        Connected(1, 0.0, GridPoint(0.0, 0.0), GridPoint(0.0, 0.0), 0.0, False, True, 25.0),
        Tracked(1, 10.0, GridPoint(8.0, 0.0), 12.0, 24.0),
        seen(10.0, True),
        seen(10.2, True),
        seen(10.4, True),
    ]
    film, state = film_of_flight(setting, events, "a flight")
    assert film.unit is Unit.SECONDS
    assert film.end_t == 10.4
    first, second = film.tracks[1]
    assert not first.aloft
    assert second.aloft
    assert abs(second.place.east - 1.0) < 0.05  # 8 m out, 4 m of them drifted away below it
    assert abs(film.start_at(10.0).east + 1.0) < 0.05
    states = [(change.t, change.cell, change.state) for change in film.changes]
    assert states[:2] == [
        (10.0, Cell(2, 0), "non-roi"),
        (10.0, Cell(3, 0), "non-roi"),
    ]
    assert [state for t, cell, state in states if cell == Cell(2, 0)][-1] != "non-roi"
    assert Cell(2, 0) in state.belief.roi


def test_of_photographs_there_are_cells_and_no_tracks():
    setting = setting_of(mission(BOX, FENCE))
    events = [seen(0.1 * i, True) for i in range(5)]
    film, _ = film_of_flight(setting, events, "photographs", recorded=True)
    assert film.tracks == {}
    assert film.start == Place(0.0, 0.0)
    assert {change.cell: change.state for change in film.changes} == {
        Cell(2, 0): "explored",
        Cell(3, 0): "non-roi",
    }
