"""Mission files, one value at a time."""

from __future__ import annotations

import pytest

from missions.errors import MissionFileError
from missions.mission.schema import Mission, parse_fields
from missions.units import LatLon

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


def test_defaults_are_those_of_the_field_test() -> None:
    mission = parse_fields(HEAD, "m.toml")
    assert mission.grid.cell_m == 4.0
    assert mission.flight.altitude_m == 12.0
    assert mission.detector.intensity == 150
    assert mission.detector.dilations == 7
    assert (mission.votes.frames, mission.votes.positive) == (5, 3)
    assert len(mission.vehicles) == 1
    assert mission.home == LatLon(48.0, 11.0)


def test_every_vehicle_has_its_layer() -> None:
    mission = parse_fields(HEAD + "team.layer_m = 7\nvehicles = [{}, {}, {}]", "m.toml")
    assert [mission.altitude_m(i) for i in range(3)] == [12.0, 19.0, 26.0]


def test_endurance_is_what_hovering_leaves() -> None:
    mission = parse_fields(HEAD + "battery = {capacity_wh = 50, hover_power_w = 250}", "m.toml")
    assert mission.battery.endurance_s == 720.0


def test_a_mission_cannot_be_changed() -> None:
    mission = parse_fields(HEAD, "m.toml")
    with pytest.raises(ValueError, match="frozen"):
        mission.name = "other"


def test_missing_sections_are_named_one_a_line() -> None:
    assert [line.split(":")[0] for line in faults("")] == ["start", "search", "fence"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("detector.intensty = 3", "detector.intensty: unknown key; did you mean 'intensity'?"),
        ("detctor.name = 'a'", "detctor: unknown key; did you mean 'detector'?"),
        ("vehicles = [{hom = 3}]", "vehicles[0].hom: unknown key; did you mean 'home'?"),
        ("zzz = 3", "zzz: unknown key"),
    ],
)
def test_unknown_keys_get_the_nearest_known_one(line: str, expected: str) -> None:
    assert faults(HEAD + line) == [expected]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
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
        ("camera.mounting = 'x'", "camera.mounting = 'x': input should be 'fixed' or 'gimbal'"),
    ],
)
def test_faults_name_key_value_and_what_is_expected(line: str, expected: str) -> None:
    assert faults(HEAD + line) == [expected]


def test_a_latitude_beyond_range_suggests_that_it_was_swapped() -> None:
    swapped = HEAD.replace("[48.0, 11.0]\nsearch", "[153.0, -27.0]\nsearch")
    (line,) = faults(swapped)
    assert line.startswith("start.position[0] = 153.0: ")
    assert "are they swapped?" in line


def test_half_a_position_is_a_fault() -> None:
    (line,) = faults(HEAD.replace("[48.0, 11.0]\nsearch", "[48.0]\nsearch"))
    assert line == "start.position[1]: missing; positions are [latitude, longitude]"


def test_all_faults_come_at_once() -> None:
    assert len(faults(HEAD + "grid.cell_m = -1\nflight.speed_m_s = 0\nwind.speed = 2")) == 3


def test_the_schema_describes_every_section() -> None:
    assert set(Mission.model_json_schema()["required"]) == {"start", "search", "fence"}
