"""The sections of a mission file: limits of single values, faults of a simulation, and messages."""

from __future__ import annotations

import pytest

from missions.errors import MissionFileError
from missions.mission.schema import MAX_VEHICLES, Mission, parse_fields, parse_toml
from missions.mission.sections.sim_section import SimFault
from tests.unit.missions.mission.test_mission_file import HEAD, faults


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
def test_values_at_a_limit_are_good_and_beyond_it_a_fault(key: str, good: str, bad: str) -> None:
    parse_fields(HEAD + f"{key} = {good}\n", "m.toml")
    (line,) = faults(HEAD + f"{key} = {bad}\n")
    assert line.startswith(f"{key} = ")
    assert "input should be" in line


def test_a_fleet_has_a_limit() -> None:
    assert len(mission("vehicles = [" + "{}, " * MAX_VEHICLES + "]").vehicles) == MAX_VEHICLES
    (line,) = faults(HEAD + "vehicles = [" + "{}, " * (MAX_VEHICLES + 1) + "]")
    assert line.startswith("vehicles")


# --- faults of a simulation ------------------------------------------------------------------
GOOD = {
    "gps": "",
    "gps_glitch": "metres = 5.0",
    "gps_drift": "m_s = 2.0",
    "battery_sag": "volts = 4.0",
    "battery_cell": "",
    "compass": "deg = 20.0",
    "wind_gust": "m_s = 5.0",
    "motor": "share = 0.5",
    "camera_stall": "",
    "camera_black": "",
    "camera_corrupt": "",
    "reject": "command = 192",
    "rc": "",
    "link": "loss = 0.2",
    "companion_reboot": "",
}


def sim_fault(kind: str, more: str = "") -> str:
    keys = "\n".join(part.strip() for part in more.split(",") if part.strip())
    return HEAD + f'[[sim.faults]]\nat_s = 1.0\nkind = "{kind}"\n{keys}\n'


@pytest.mark.parametrize("kind", sorted(GOOD))
def test_every_kind_of_fault_can_be_asked_for(kind: str) -> None:
    (fault,) = parse_fields(sim_fault(kind, GOOD[kind]), "m.toml").sim.faults
    assert fault.kind == kind
    key, _, value = GOOD[kind].partition(" = ")
    assert fault.values == ({key: float(value)} if key else {})


def test_no_kind_of_fault_is_forgotten_here() -> None:
    kinds = SimFault.model_json_schema()["properties"]["kind"]["enum"]
    assert sorted(kinds) == sorted(GOOD)


@pytest.mark.parametrize("kind", [kind for kind, more in GOOD.items() if more and kind != "motor"])
def test_a_fault_without_its_number_is_refused(kind: str) -> None:
    (line,) = faults(sim_fault(kind))
    assert line.startswith("sim.faults[0]: ")
    assert f"kind = '{kind}' needs" in line


@pytest.mark.parametrize("kind", ["gps", "camera_black", "compass"])
def test_a_fault_with_the_number_of_another_is_refused(kind: str) -> None:
    (line,) = faults(sim_fault(kind, f"{GOOD[kind]}, volts = 3.0" if GOOD[kind] else "volts = 3.0"))
    assert f"kind = '{kind}' has no volts" in line


def test_a_dead_cell_stays_dead() -> None:
    (line,) = faults(sim_fault("battery_cell", "for_s = 3.0"))
    assert "stays dead" in line


def test_an_unknown_kind_lists_the_known_ones() -> None:
    (line,) = faults(sim_fault("meteor"))
    assert line.startswith("sim.faults[0].kind = 'meteor': ")
    assert "'camera_black'" in line


def test_a_list_that_is_short_because_of_a_faulty_item_has_one_fault() -> None:
    text = HEAD.replace("[48.0, 11.001]", "['x', 11.001]", 1)
    (line,) = faults(text)
    assert line.startswith("search.box[1][0] = 'x': ")


@pytest.mark.parametrize("text", ["a = ", "[a", "a = 1\na = 2", "\x00", 'a = "\\q"'])
def test_what_is_not_toml_is_named_with_its_file(text: str) -> None:
    with pytest.raises(MissionFileError, match=r"^field\.toml: not a TOML file: "):
        parse_toml(text, "field.toml")
