"""A mission is parsed once, its faults have lines, and a journal gives it back as it was."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import uavmap
from missions.errors import MissionFileError, NotFlownError
from missions.mission.sections.detector_section import DetectorSection
from missions.mission.sections.search_sections import PriorPlace
from tests.support.hills import over, slope
from tests.support.plans import named_text, plan_of
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.load.key_lines import with_lines
from uavmap.load.mission_source import load, mission_of_text, shipped_missions
from uavmap.runner import flight
from uavmap.ui.cli import main

TEXT = """\
name = "x"
[search]
box = [
  [1.0, 2.0],
  [3.0]
]
grid = {cell_m = 1.0}
[[vehicles]]
[[vehicles]]  # the second
url = "a"
[fence]
"margin_m" = 2
a.b = 1
"""


def not_flown(*_: object, **__: object) -> dict[str, Any]:
    raise NotFlownError("only planned", could_fly=True)


def from_python() -> None:
    with pytest.raises(NotFlownError):
        uavmap.fly("runway", sim=True, quiet=True)


@pytest.mark.parametrize(
    "work",
    [
        lambda: main(["check", "runway"]),
        lambda: main(["fly", "runway", "--sim", "--seed", "4"]),
        from_python,
    ],
)
def test_a_mission_is_parsed_once(
    work: Callable[[], object], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    parsed: list[str] = []
    parse = tomllib.loads

    def counted(text: str) -> dict[str, Any]:
        parsed.append(text)
        return parse(text)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tomllib, "loads", counted)
    monkeypatch.setattr(flight, "fly", not_flown)
    monkeypatch.setattr("uavmap.ui.cli.flight_options.fly", not_flown)
    work()
    assert parsed == [named_text("runway").text]


@pytest.mark.parametrize(
    ("fault", "line"),
    [
        ("name = 3: must be text", 1),
        ("search.box[1]: 1 given", 3),
        ("search.grid.cell_m = 1: no", 7),
        ("vehicles[1].url = 'a': no", 10),
        ("vehicles[1]: no", 9),
        ("fence.margin_m = 2: no", 12),
        ("fence.a.b = 2: no", 13),
        ("fence: no", 11),
    ],
)
def test_a_fault_has_the_line_of_its_key(fault: str, line: int) -> None:
    assert with_lines(f"f.toml: {fault}", "f.toml", TEXT) == f"f.toml:{line}: {fault}"


@pytest.mark.parametrize("fault", ["f.toml: start: missing; add it", "--detector x: no"])
def test_a_fault_without_a_key_in_the_file_has_no_line(fault: str) -> None:
    assert with_lines(fault, "f.toml", TEXT) == fault


def test_a_long_line_of_dots_is_no_work() -> None:
    text = "a." * 500_000 + "\n[grid]\ncell_m = 0"
    assert with_lines("f: grid.cell_m = 0: no", "f", text) == "f:3: grid.cell_m = 0: no"


def test_several_faults_each_have_their_line(tmp_path: Path) -> None:
    file = tmp_path / "field.toml"
    text = named_text("runway").text.replace("cell_m = 4.0", "cell_m = 0")
    file.write_text(text.replace("[search]", "[search]\nfind = 2"))
    with pytest.raises(MissionFileError) as caught:
        load(str(file))
    lines = file.read_text().splitlines()
    for fault in str(caught.value).splitlines():
        number, key = fault.removeprefix(f"{file}:").split(":")[:2]
        assert lines[int(number) - 1].startswith(key.split(".")[-1].split(" ")[0])


@pytest.mark.parametrize("name", shipped_missions())
def test_a_journal_gives_the_plan_back_as_it_was(name: str, tmp_path: Path) -> None:
    plan = plan_of(name, named_text(name).text, vehicles=2, seed=5)
    assert again(plan, tmp_path) == plan


def test_prior_ground_and_detector_come_back_from_a_journal(tmp_path: Path) -> None:
    mission = over(mission_of_text(named_text("runway").text, "runway"), slope(5.0, 0.0))
    point = PriorPlace(position=mission.start.position, spread_m=3.0)
    area = PriorPlace(polygon=mission.search.box, weight=2.0)
    search = mission.search.model_copy(update={"prior": (point, area)})
    tables = {"name": "paved", "paved": {"greenness": 0.1}, "share": 0.4}
    section = DetectorSection.model_validate(tables)
    mission = mission.model_copy(update={"search": search, "detector": section})
    plan = plan_of("hills", mission)
    found = again(plan, tmp_path)
    assert found == plan
    assert found.mission.ground == mission.ground is not None


def again(plan: FlightPlan, folder: Path) -> FlightPlan:
    """The plan as a journal gives it back."""
    with Journal.create(folder / JOURNAL, {"plan": plan.as_json()}) as journal:
        return FlightPlan.read(journal)
