"""The end of a flight that cannot continue, and its lines for the operator."""

import errno
import io
from dataclasses import replace
from pathlib import Path

import pytest

from missions.events import AutopilotText, GivenUp, Landed, LinkLost, Overridden, Released, Tracked
from missions.flight.setting_of import setting_of
from missions.flight.vehicle_state import Phase
from missions.mapping.tree import Tree
from missions.orders import AwaitBattery, StandDown, TakeOff
from missions.units import Cell, GridPoint
from tests.support.shown_lines import BrokenStream
from tests.support.small_missions import mission, square
from tests.unit.missions.flight.test_step import HOME, Service
from uavmap.base.terminal import Terminal
from uavmap.output.facts.figures import aircraft_down
from uavmap.runner.operator.ground_crew import all_wait
from uavmap.runner.operator.progress import ProgressTable
from uavmap.ui.cli import AIRCRAFT_DOWN, INCOMPLETE, complain, parser
from uavmap.ui.cli.common import report

BESIDE = GridPoint(8.0, 0.0)


def service(vehicles):
    made = mission(
        square(-10, 16, 40, 30), square(-60, -60, 160, 160), capacity_wh=60.0, vehicles=vehicles
    )
    begun = Service(made)
    begun.connect(1)
    if vehicles > 1:
        begun.connect(2, at=BESIDE)
    return begun


def airborne(made):
    here = replace(made.state.vehicles[1], phase=Phase.AIRBORNE, landed=False, height_m=12.0)
    made.state = made.state.with_vehicle(here)
    return made


def shown_line(made, event):
    made.post(event)
    out = io.StringIO()
    terminal = ProgressTable(Terminal(out))
    terminal._drawn_s = float("inf")  # without the line of every few seconds
    terminal.notice(event)
    terminal.update(event, made.state, 0)
    return out.getvalue()


# --- a pilot keeps it on the ground ----------------------------------------------------------
def test_vehicle_kept_on_the_ground_does_not_end_the_flight_of_the_others():
    made = service(2)
    line = shown_line(made, Overridden(1, 3.0, "LOITER"))
    assert "vehicle 1 is in LOITER on the ground, not under our control" in line
    assert "it takes off at once" in line
    assert not made.state.is_over
    assert made.order(1) == StandDown()
    assert isinstance(made.order(2), TakeOff)
    made.post(Overridden(2, 4.0, "LOITER"))
    assert made.state.is_over


@pytest.mark.parametrize(
    ("cleared", "expected", "order"),
    [(True, "it takes off at once", TakeOff), (False, "it waits for its crew", AwaitBattery)],
    ids=["before its first flight", "after a flight"],
)
def test_vehicle_given_back_does_as_the_line_announced(cleared, expected, order):
    made = service(2)
    made.state = made.state.with_vehicle(replace(made.state.vehicles[1], cleared=cleared))
    assert expected in shown_line(made, Overridden(1, 3.0, "LOITER"))
    made.track(1, HOME, 0.0)
    made.post(Released(1, 9.0, HOME, 0.0))
    assert isinstance(made.order(1), order)


def test_flight_without_another_vehicle_ends_with_the_reason():
    made = service(1)
    line = shown_line(made, Overridden(1, 3.0, "LOITER"))
    assert made.state.is_over
    assert "no other vehicle flies: the flight ends" in line


def test_flight_after_a_pilots_landing_ends_with_the_reason():
    made = airborne(service(1))
    assert "hands off until" in shown_line(made, Overridden(1, 3.0, "LOITER"))
    assert not made.state.is_over
    line = shown_line(made, Landed(1, 30.0, 40.0, position=HOME))
    assert (
        "vehicle 1 has landed, not under our control; no other vehicle flies: the flight ends"
        in line
    )
    assert made.state.is_over


@pytest.mark.parametrize("landed", [True, False])
def test_flight_does_not_wait_for_a_battery_while_a_pilot_keeps_the_other(landed):
    """In the air, however, the flight waits for it."""
    made = service(2)
    kept = replace(made.state.vehicles[2], phase=Phase.YIELDED, landed=landed, order=StandDown())
    assert all_wait(made.state.with_vehicle(kept), {1}) is landed


# --- a change of mode, and its cause ----------------------------------------------------------
@pytest.mark.parametrize(
    ("after", "line"),
    [
        (AutopilotText(1, 3.3, 2, "Battery Failsafe", cause="battery failsafe"),
         "vehicle 1 is in RTL, not under our control (battery failsafe): hands off"),
        (AutopilotText(1, 3.9, 6, "Mission: 1 WP"),
         "vehicle 1 is in RTL, not under our control: hands off"),
        (Released(1, 3.2, HOME, 12.0), "vehicle 1 is in RTL, not under our control: hands off"),
        (None, "vehicle 1 is in RTL, not under our control: hands off"),
    ],
)  # fmt: skip
def test_change_of_mode_is_shown_once_with_the_cause_that_follows(after, line):
    """A real ArduCopter names the cause in a text 0.1 to 0.4 s after its new mode."""
    made = airborne(service(2))
    out = io.StringIO()
    table = ProgressTable(Terminal(out))
    for event in (Overridden(1, 3.0, "RTL"), *([after] if after else [])):
        assert "not under our control" not in out.getvalue()
        table.notice(event)
        made.post(event)
        table.update(event, made.state, 0)
    table.end()
    assert out.getvalue().count("not under our control") == 1
    assert line in out.getvalue()


def test_commanded_mode_selected_by_others_is_not_under_our_control():
    made = airborne(service(2))
    line = shown_line(made, Overridden(1, 3.0, "GUIDED"))
    assert "vehicle 1 is in GUIDED, not under our control: its pilot or its autopilot" in line


# --- when a line is shown ---------------------------------------------------------------------
def test_line_of_an_event_is_shown_when_it_arrives_and_once():
    made, out = airborne(service(2)), io.StringIO()
    table = ProgressTable(Terminal(out))
    for event in (Tracked(1, 66.0, HOME, 12.0, 40.0), LinkLost(1, 64.0)):
        table.notice(event)
    assert out.getvalue() == "     66 s  vehicle 1: link lost\n"
    table._drawn_s = float("inf")
    made.post(LinkLost(1, 64.0))
    table.update(LinkLost(1, 64.0), made.state, 0)
    assert out.getvalue().count("link lost") == 1


def test_line_that_waits_for_an_answer_keeps_its_place_among_those_that_arrive():
    made, out = airborne(service(2)), io.StringIO()
    table = ProgressTable(Terminal(out))
    table._drawn_s = float("inf")
    refused = Landed(2, float("nan"), 40.0)
    events = Overridden(1, 3.0, "LOITER"), refused, Landed(1, 9.0, 40.0), LinkLost(2, 9.0)
    for event in events:
        table.notice(event)
    assert not out.getvalue()
    for event in events:
        if event is not refused:
            made.post(event)
            table.update(event, made.state, 0)
    lines = [line[11:45] for line in out.getvalue().splitlines()]
    assert lines == [
        "vehicle 1 is in LOITER, not under ",
        "vehicle 1 has landed, not under ou",
        "vehicle 2: link lost",
    ]


# --- an aircraft that is down, and a map that is whole ----------------------------------------
def map_region(phase, landed_away_m):
    """Return the end of a whole exploration; the second vehicle landed 45 m from its pad."""
    made = service(2)
    root = Cell(0, 6)
    made.state = replace(made.state, tree=Tree.rooted(root).with_observation(root, ()))
    for number, how in ((1, Phase.FINISHED), (2, phase)):
        there = replace(
            made.state.vehicles[number], phase=how, lanes=(), order=StandDown(),
            landed_away_m=landed_away_m if number == 2 else 0.0,
        )  # fmt: skip
        made.state = made.state.with_vehicle(there)
    return made


@pytest.mark.parametrize(
    ("phase", "away_m", "completed"), [(Phase.YIELDED, 45.0, True), (Phase.DOWN, 0.0, False)]
)
def test_aircraft_that_is_down_is_exit_code_4_with_a_map_that_is_whole(
    phase, away_m, completed, capsys
):
    made = map_region(phase, away_m)
    assert made.state.exploration_finished
    assert made.state.completed is completed
    down = aircraft_down(made.state)
    assert len(down) == 1
    summary = {
        "mission": "m", "strategy": "rdfs", "completed": made.state.completed, "seed": None,
        "aircraft_down": down,
    }  # fmt: skip
    assert report(summary, Path("results/m-1"), as_json=False) == AIRCRAFT_DOWN
    out, err = capsys.readouterr()
    assert ("yes" if completed else "no") in out
    assert "vehicle 2 near" in err
    home = {**summary, "completed": False, "aircraft_down": []}
    assert report(home, Path("r"), as_json=True) == INCOMPLETE


@pytest.mark.parametrize("command", ["fly", "resume"])
def test_help_lists_the_exit_codes(command, capsys):
    with pytest.raises(SystemExit):
        parser().parse_args([command, "--help"])
    text = capsys.readouterr().out
    assert "even if the map is complete" in text


SUMMARY = {"mission": "field", "strategy": "rdfs", "completed": True, "finding": ""}


FAILURES = (BrokenPipeError(), OSError(errno.EIO, "gone"), ValueError("closed file"))


@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("failure", FAILURES, ids=repr)
def test_progress_without_an_output_continues_in_silence(failure, terminal):
    setting = setting_of(mission(square(-10, 16, 40, 30), square(-60, -60, 160, 160)))
    state, stream = setting.initial_state(), BrokenStream(failure, terminal=terminal)
    terminal_ = Terminal(stream)
    progress = ProgressTable(terminal_)
    progress.begin(setting, again=False)
    terminal_.show("vehicle 1: it returns by its autopilot")
    for second in range(3):
        event = GivenUp(1, float(second), "silent")
        progress.notice(event)
        progress.update(event, state, 0)
    progress.end()
    assert stream.tried == 1


@pytest.mark.parametrize("as_json", [False, True])
@pytest.mark.parametrize("failure", FAILURES[:2], ids=repr)
def test_exit_code_is_that_of_the_flight(failure, as_json, monkeypatch):
    monkeypatch.setattr("sys.stdout", BrokenStream(failure))
    monkeypatch.setattr("sys.stderr", BrokenStream(failure))
    folder = Path("results/field-1")
    assert report(SUMMARY, folder, as_json=as_json) == 0
    assert report({**SUMMARY, "completed": False}, folder, as_json=as_json) == INCOMPLETE
    down = {**SUMMARY, "completed": False, "aircraft_down": ["vehicle 1 near 1, 2: down"]}
    assert report(down, folder, as_json=as_json) == AIRCRAFT_DOWN
    complain("interrupted")
