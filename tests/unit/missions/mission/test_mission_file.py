"""Mission files, one value at a time: defaults, limits, faults of a simulation, and messages."""

from __future__ import annotations

import pytest

from missions.errors import MissionFileError
from missions.mission.schema import MAX_VEHICLES, Mission, parse_fields, parse_toml
from missions.mission.sim_section import SimFault
from missions.units import LatLon
from tests.support.small_missions import FAULTS

HEAD = """
start.position = [48.0, 11.0]
search.box = [[48.0, 11.0], [48.0, 11.001], [48.001, 11.001], [48.001, 11.0]]
fence.polygon = [[47.999, 10.999], [47.999, 11.002], [48.002, 11.002], [48.002, 10.999]]
"""


def faults(text: str) -> list[str]:
    with pytest.raises(MissionFileError) as caught:
        parse_fields(text, "m.toml")
    lines = str(caught.value).splitlines()
    assert all(line.startswith("m.toml: ") for line in lines)
    return [line.removeprefix("m.toml: ") for line in lines]


def test_defaults_are_those_of_the_field_test():
    mission = parse_fields(HEAD, "m.toml")
    assert mission.grid.cell_m == 4.0
    assert mission.flight.altitude_m == 12.0
    assert mission.detector.intensity == 150
    assert mission.detector.dilations == 7
    assert (mission.votes.frames, mission.votes.positive) == (5, 3)
    assert len(mission.vehicles) == 1
    assert mission.home == LatLon(48.0, 11.0)


def test_endurance_is_that_of_hovering():
    mission = parse_fields(HEAD + "battery = {capacity_wh = 50, hover_power_w = 250}", "m.toml")
    assert mission.battery.endurance_s == 720.0


def test_missing_sections_are_named_one_a_line():
    assert [line.split(":")[0] for line in faults("")] == ["start", "search", "fence"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("detector.intensty = 3", "detector.intensty: unknown key; did you mean 'intensity'?"),
        ("detctor.name = 'a'", "detctor: unknown key; did you mean 'detector'?"),
        ("vehicles = [{hom = 3}]", "vehicles[0].hom: unknown key; did you mean 'home'?"),
        ("zzz = 3", "zzz: unknown key"),
        ("grid.cell_m = 0", "grid.cell_m = 0: input should be greater than 0"),
        ("grid.cell_m = nan", "grid.cell_m = nan: input should be a finite number"),
        ("grid.cell_m = '4'", "grid.cell_m = '4': input should be a valid number"),
        ("grid.cell_m = true", "grid.cell_m = True: input should be a valid number"),
        ("votes.frames = 2.5", "votes.frames = 2.5: input should be a valid integer"),
        ("votes.frames = [1, 1]", "votes.frames = list: input should be a valid integer"),
        ("votes.positive = 9", "votes: positive = 9 can never be reached with frames = 5"),
        ("vehicles = []", "vehicles: 0 given, at least 1 needed"),
        ("grid = 3", "grid: must be a table, [grid]"),
        ("fence.holes = [[[48.0, 11.0]]]", "fence.holes[0]: 1 given, at least 3 needed"),
        (
            "flight.altitude_m = 'automatic'",
            "flight.altitude_m = 'automatic': must be a number or \"auto\"",
        ),
        ("flight.altitude_m = true", "flight.altitude_m = True: input should be a valid number"),
        ("flight.altitude_m = [12.0]", "flight.altitude_m = list: input should be a valid number"),
        ("camera.mounting = 'x'", "camera.mounting = 'x': input should be 'fixed' or 'gimbal'"),
    ],
)
def test_faults_name_key_value_and_expectation(line, expected):
    assert faults(HEAD + line) == [expected]


@pytest.mark.parametrize(
    ("old", "new", "begin", "end"),
    [
        (
            "[48.0, 11.0]\nsearch", "[153.0, -27.0]\nsearch",
            "start.position[0] = 153.0: ", "are they swapped?)",
        ),
        (
            "[48.0, 11.0]\nsearch", "[48.0]\nsearch",
            "start.position[1]: missing; positions are [latitude, longitude]", "",
        ),
        # the list is short because of a faulty item: one fault
        ("[48.0, 11.001]", "['x', 11.001]", "search.box[1][0] = 'x': ", ""),
    ],
)  # fmt: skip
def test_a_faulty_position_is_one_line(old, new, begin, end):
    (line,) = faults(HEAD.replace(old, new, 1))
    assert line.startswith(begin)
    assert line.endswith(end)


def test_all_faults_come_at_once():
    assert len(faults(HEAD + "grid.cell_m = -1\nflight.speed_m_s = 0\nwind.speed = 2")) == 3


def mission(text: str = "") -> Mission:
    return parse_fields(HEAD + text, "m.toml")


# --- limits ----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("key", "good", "bad"),
    [
        ("flight.altitude_m", "1000", "1001"),
        ("flight.altitude_m", "0.1", "0"),
        ("flight.speed_m_s", "30", "30.1"),
        ("flight.settle_m_s", "0.01", "0"),
        ("flight.max_airspeed_m_s", "60", "61"),
        ("flight.max_airspeed_m_s", "0.5", "0"),
        ("camera.hfov_deg", "169", "170"),
        ("camera.width_px", "16", "15"),
        ("camera.interval_s", "60", "61"),
        ("detector.intensity", "255", "256"),
        ("detector.share", "1", "0"),
        ("votes.frames", "100", "101"),
        ("battery.reserve", "0.999", "1"),
        ("battery.reserve", "0", "-0.01"),
        ("wind.speed_m_s", "40", "41"),
        ("drift.speed_m_s", "20", "20.5"),
        ("fence.margin_m", "0", "-1"),
        ("start.amsl_m", "-500", "-501"),
        ("sim.illumination", "0.99", "1"),
        ("sim.roi_intensity", "0", "-1"),
    ],
)
def test_values_at_a_limit_are_good_and_beyond_it_a_fault(key, good, bad):
    parse_fields(HEAD + f"{key} = {good}\n", "m.toml")
    (line,) = faults(HEAD + f"{key} = {bad}\n")
    assert line.startswith(f"{key} = ")
    assert "input should be" in line


def test_a_fleet_has_a_limit():
    assert len(mission("vehicles = [" + "{}, " * MAX_VEHICLES + "]").vehicles) == MAX_VEHICLES
    (line,) = faults(HEAD + "vehicles = [" + "{}, " * (MAX_VEHICLES + 1) + "]")
    assert line.startswith("vehicles")


# --- faults of a simulation ------------------------------------------------------------------


def sim_fault(kind: str, more: str = "") -> str:
    keys = "\n".join(part.strip() for part in more.split(",") if part.strip())
    return HEAD + f'[[sim.faults]]\nat_s = 1.0\nkind = "{kind}"\n{keys}\n'


@pytest.mark.parametrize("kind", sorted(FAULTS))
def test_every_kind_of_fault_can_be_asked_for(kind):
    (fault,) = parse_fields(sim_fault(kind, FAULTS[kind]), "m.toml").sim.faults
    assert fault.kind == kind
    key, _, value = FAULTS[kind].partition(" = ")
    assert fault.values == ({key: float(value)} if key else {})


def test_no_kind_of_fault_is_forgotten_here():
    kinds = SimFault.model_json_schema()["properties"]["kind"]["enum"]
    assert sorted(kinds) == sorted(FAULTS)


@pytest.mark.parametrize(
    ("kind", "more", "begin", "part"),
    [
        *((kind, "", "sim.faults[0]: ", f"kind = '{kind}' needs")
          for kind, more in FAULTS.items() if more and kind != "motor"),
        *((kind, f"{FAULTS[kind]}, volts = 3.0", "", f"kind = '{kind}' has no volts")
          for kind in ("gps", "camera_black", "compass")),
        ("battery_cell", "for_s = 3.0", "", "stays dead"),
        ("meteor", "", "sim.faults[0].kind = 'meteor': ", "'camera_black'"),
    ],
)  # fmt: skip
def test_a_fault_with_wrong_values_is_refused(kind, more, begin, part):
    (line,) = faults(sim_fault(kind, more))
    assert line.startswith(begin)
    assert part in line


@pytest.mark.parametrize("text", ["a = ", "[a", "a = 1\na = 2", "\x00", 'a = "\\q"'])
def test_text_that_is_not_toml_is_named_with_its_file(text):
    with pytest.raises(MissionFileError, match=r"^field\.toml: not a TOML file: "):
        parse_toml(text, "field.toml")
