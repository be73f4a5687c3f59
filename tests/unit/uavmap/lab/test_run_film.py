"""The film of a run without stopping: paths, provisional and decided cells, footprints."""

from __future__ import annotations

from missions.lab.arena.nonstop import Camera, Team
from missions.lab.arena.roi import Roi
from missions.lab.arena.survey import surveyed
from missions.units import Cell
from uavmap.lab.run_film import film_of_nonstop
from uavmap.output.film.film import Place, Reel, Unit
from uavmap.output.film.film_writers import Stage, caption

ROI = Roi("three", Cell(0, 0), frozenset({Cell(0, 0), Cell(1, 0), Cell(2, 0)}))


def test_cells_are_seen_before_they_are_decided():
    run = surveyed(ROI, Team(1, Camera(15.0, 15.0)), record=True)
    film = film_of_nonstop(run, ROI, 4.0, (15.0, 12.0), "three")
    assert (film.unit, film.end_t, film.footprint) == (Unit.SECONDS, run.makespan_s, Place(3.75, 3))
    states: dict[Cell, list[str]] = {}
    for change in film.changes:
        states.setdefault(change.cell, []).append(change.state)
    for cell in ROI.cells:
        assert states[cell] == ["under exploration", "explored"]
    assert states[Cell(3, 0)] == ["non-roi"]
    assert [change.t for change in film.changes] == sorted(change.t for change in film.changes)
    reel = Reel(film)
    assert len(list(reel.forward(film.end_t))) == len(film.changes)
    assert "3 of 3 cells seen, 3 decided" in caption(film, reel, film.end_t)


def test_track_is_the_path_and_the_footprint_is_around_the_vehicle():
    run = surveyed(ROI, Team(2, Camera(15.0, 15.0)), record=True)
    large, small = (film_of_nonstop(run, ROI, 4.0, (m, m), "three") for m in (15.0, 7.0))
    assert set(large.tracks) == {0, 1}
    (path,) = run.paths[0]
    for t in (0.0, 1.3, run.makespan_s / 2, run.makespan_s):
        there, place = path.at(t).place, large.fix(0, t).place
        assert abs(4.0 * place.east - there.east_m) < 0.1
        assert abs(4.0 * place.north - there.north_m) < 0.1
    (one,), (other,) = (Stage(film).frames([run.makespan_s / 2]) for film in (large, small))
    assert one.size == other.size
    assert one.tobytes() != other.tobytes()
