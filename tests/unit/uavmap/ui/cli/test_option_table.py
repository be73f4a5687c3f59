"""Options are declared once: parsers, `FlightOptions`, Python and the page follow the table."""

import inspect
from dataclasses import fields
from pathlib import Path

import pytest

import uavmap
from missions.errors import MissionFileError, UavmapError
from uavmap.journal.flight_plan import FlightOptions, FlightPlan
from uavmap.load.mission_source import load
from uavmap.ui.cli import main, parser
from uavmap.ui.cli.flight_options import flight_options
from uavmap.ui.cli.option_table import TABLE, options_of, reference

DOCS = Path(__file__).parents[5] / "docs"
URL = "udpin://0.0.0.0:14550"


@pytest.mark.parametrize(("command", "more"), [("fly", {"quiet"}), ("resume", {"folder", "quiet"})])
def test_parameters_of_python_are_those_of_the_table(command, more):
    signature = inspect.signature(getattr(uavmap, command)).parameters
    python = {o.destination: o for o in options_of(command) if o.python}
    assert {*python, *more} == set(signature)
    for name, option in python.items():
        if not option.name.startswith("--"):
            continue
        unchanged = command == "resume" and name == "forward"  # () would end the arguments
        switch = option.metavar is None and option.choices is None
        empty = () if option.several and not unchanged else False if switch else option.default
        assert signature[name].default == empty


def test_fields_of_options_are_those_of_the_table():
    made = {option.field for option in TABLE} - {None}
    assert made == {field.name for field in fields(FlightOptions)} - {"network"}


@pytest.mark.parametrize("command", ["fly", "onboard", "resume", "watch", "replay", "look", "tune"])
def test_command_has_its_options_of_the_table(command):
    commands = parser(command)._subparsers._group_actions[0].choices
    known = commands[command]._option_string_actions
    for option in options_of(command):
        if option.name.startswith("--"):
            assert known[option.name].help == option.help_of(command)


def test_options_of_a_command_become_those_of_a_flight(monkeypatch):
    monkeypatch.delenv("UAVMAP_KEY_FILE", raising=False)
    line = ["fly", "runway", "--connect", URL, "--seed", "3", "--key", "/k", "--auto-swap"]
    made = flight_options(parser("fly").parse_args(line))
    assert made == FlightOptions(
        mission_source="runway", urls=(URL,), seed=3, key_file="/k", auto_swap=True
    )


def test_page_of_reference_is_that_of_the_table():
    assert (DOCS / "reference" / "options.md").read_text("utf-8") == reference()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"seed": -1}, "seed = -1: expected a whole number from 0"),
        ({"vehicles": 51}, "vehicles = 51: expected a whole number from 1 to 50"),
        ({"speedup": 0.0}, "speedup = 0.0: expected a number from 0.001 to 1000"),
        ({"driver": "ros"}, "driver = 'ros': expected one of pymavlink, mavsdk"),
        ({"urls": (URL,)}, "--sim and --connect exclude each other"),
        ({"cameras": ("mavlink",)}, "--camera goes with --connect"),
        ({"driver": "mavsdk"}, "--driver mavsdk cannot fly with --sim"),
        ({"simulated": False, "comms": "free"}, "--comms is for --sim"),
        ({"simulated": False, "all_strategies": True}, "--all-strategies is for --sim"),
        ({"simulated": False, "driver": "mavsdk", "key_file": "k"}, "mavsdk does not sign"),
    ],
)
def test_options_out_of_range_or_against_each_other_are_refused(wrong, words):
    with pytest.raises(UavmapError) as caught:
        FlightOptions(**{"mission_source": "runway", "simulated": True} | wrong)
    assert words in str(caught.value)


def test_strategies_of_papers_fly_only_in_simulation_and_when_asked_for(tmp_path, capsys):
    out = str(tmp_path / "out")
    assert main(["fly", "runway", "--sim", "--strategy", "greedy", "--out", out]) == 2
    assert "give --all-strategies with it, or take one of swath" in capsys.readouterr().err
    mission = load("runway")
    asked = FlightOptions(mission_source="runway", simulated=True, all_strategies=True)
    greedy = mission.model_copy(update={"strategy": "greedy"})
    assert FlightPlan.make(asked, greedy, 0.0).mission.strategy == "greedy"
    with pytest.raises(MissionFileError, match="strategy = 'greedy': only for comparisons"):
        FlightPlan.make(FlightOptions(mission_source="runway", urls=(URL,)), greedy, 0.0)
