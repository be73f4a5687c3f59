"""Figures of vehicles and alarms of a flight, by the events of a recorded one."""

import json

import pytest

from missions.events import Connected, FrameLost, LinkLost, Overridden, Tracked, from_json
from missions.flight.step import step
from missions.units import GridPoint
from tests.golden.recording import PASSES, STOPS
from uavmap.ui.page.watching import Watcher


class RecordedFlight:
    def __init__(self, recording):
        self.state = recording.setting().initial_state()
        self.watcher = Watcher(self.state, now_s=lambda: 0.0)
        self.events = [from_json(line) for line in recording.lines()]

    def happen(self, event):
        self.state, _ = step(self.state, event)
        self.watcher.apply(event, self.state)

    def until(self, t_s):
        for event in self.events:
            self.happen(event)
            if isinstance(event, Tracked) and event.t_s > t_s:
                return event
        raise AssertionError

    def figures_and_alarms(self):
        self.watcher.refresh()
        board = self.watcher.board.since(0)
        return board["vehicles"]["1"], [words for _, words in board["fields"]["alarms"]]


@pytest.mark.parametrize("recording", [STOPS, PASSES])
def test_flight_without_trouble_has_no_alarms(recording):
    flown = RecordedFlight(recording)
    for event in flown.events:
        flown.happen(event)
        flown.watcher.refresh()
        assert flown.watcher.board.field("alarms") == []


def test_figures_of_a_vehicle_in_the_air_are_those_of_its_events():
    flown = RecordedFlight(STOPS)
    last = flown.until(40.0)
    record, _ = flown.figures_and_alarms()
    json.dumps(record)
    places = [event for event in flown.events if isinstance(event, Tracked)]
    before = [event for event in places if event.t_s <= last.t_s - 2.0][-1]
    moved_m = before.position.distance_to(last.position)
    assert record["speed_m_s"] == pytest.approx(moved_m / (last.t_s - before.t_s), abs=0.06)
    assert record["home_m"] >= int(flown.state.vehicles[1].pad.distance_to(last.position))
    assert record["home_s"] > record["home_m"] / flown.state.setting.energy.speed_m_s
    assert (record["control"], record["low"], record["lost"]) == ("uavmap", False, 0)
    assert 0.2 < record["rate_hz"] < 20.0
    flown.happen(FrameLost(1, last.t_s, "no answer"))
    assert flown.figures_and_alarms()[0]["lost"] == 1


def test_alarms_follow_link_pilot_battery_and_fence():
    flown = RecordedFlight(STOPS)
    last = flown.until(40.0)
    flown.happen(LinkLost(1, last.t_s))
    record, alarms = flown.figures_and_alarms()
    assert (record["control"], alarms) == ("no contact", ["vehicle 1: link lost"])
    home = flown.state.vehicles[1].home
    flown.happen(Connected(1, last.t_s, home, last.position, 12.0, True, True, 40.0))
    assert flown.figures_and_alarms()[1] == []
    flown.happen(Overridden(1, last.t_s, "LOITER"))
    record, alarms = flown.figures_and_alarms()
    assert record["control"] == "pilot or failsafe"
    assert alarms == ["vehicle 1: a pilot or a failsafe flies it"]
    flown.happen(Tracked(1, last.t_s + 2.0, last.position, 12.0, 4.0))
    record, alarms = flown.figures_and_alarms()
    assert record["low"]
    assert "vehicle 1: battery below the need of the return path" in alarms
    flown.happen(Tracked(1, last.t_s + 4.0, GridPoint(900.0, 0.0), 12.0, 40.0))
    assert "vehicle 1: outside of the fence" in flown.figures_and_alarms()[1]
