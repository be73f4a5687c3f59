"""`uavmap resume` for aircraft on the ground: it restores settings and names their places."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, Connected, Tracked
from missions.units import GridPoint
from tests.support.field import Field, mission_of
from uavmap.aircraft.process.port import Port
from uavmap.base.clock import VirtualClock
from uavmap.base.messages import shown_on
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightOptions, FlightPlan
from uavmap.runner import before_flight, flight, one_flight
from uavmap.runner.aircraft_side import in_this_process
from uavmap.runner.flight_links import Link
from uavmap.runner.operator.company import Company, Preflight
from uavmap.runner.preflight import examination
from uavmap.runner.preflight.autopilot_setup import FILE
from uavmap.ui.cli.flight_options import not_flown

URL = "udpin://127.0.0.1:14550"


@pytest.fixture
def field(monkeypatch):
    """Make a simulated vehicle that answers at the URL of a flight, on virtual time."""
    made = Field(mission_of("ardupilot"))

    @contextlib.asynccontextmanager
    async def opened(*given: Any) -> AsyncIterator[list[Link]]:
        made.links = [made._link(vehicle) for vehicle in made.vehicles]
        async with asyncio.TaskGroup() as tasks:
            world = tasks.create_task(made.turn())
            yield made.links
            world.cancel()

    class Here:
        """The aircraft of a flight, in the process of the test."""

        def __init__(self, plan: FlightPlan, folder: Path, *_: object, append: bool) -> None:
            self.plan, self.folder = plan, folder

        @contextlib.asynccontextmanager
        async def connected(self, port: Port, begin: object) -> AsyncIterator[None]:
            setting = self.plan.known_setting()
            async with (
                opened() as links,
                in_this_process(port, self.plan, setting, self.folder, links),
            ):
                yield

    monkeypatch.setattr(one_flight, "AircraftProcess", Here)
    monkeypatch.setattr(examination, "opened_links", opened)
    for module in (one_flight, before_flight):
        monkeypatch.setattr(module, "ScaledClock", lambda *_: VirtualClock())
    return made


def dry_run(field: Field, folder: Path) -> int:
    mission = field.setting.mission
    options = FlightOptions(mission_source="small", urls=(URL,))
    plan = FlightPlan.make(options, mission, 0.0)
    company = Company(preflight=Preflight(yes=True, dry_run=True))
    with shown_on(field.lines), pytest.raises(ExceptionGroup) as over:
        flight.fly(plan, folder, company)
    return not_flown(over.value)


def test_dry_run_that_cannot_restore_fails_and_resume_restores(field, tmp_path, capsys):
    """A real PX4 kept the mission's fence after two of six dry runs; no command restored it."""
    folder = tmp_path / "flight"
    field.put(0, "FENCE_ALT_MAX", 77.0)
    field.lose = lambda: any("set and read back" in text for text in field.lines)
    assert dry_run(field, folder) == 3
    assert "what was set is not put back" in capsys.readouterr().err
    assert f"`uavmap resume {folder}` restores them" in field.lines[-1]
    assert (folder / JOURNAL).exists()
    assert field.parameter(0, "FENCE_ALT_MAX") == 25.0

    def resumed() -> int:
        with shown_on(field.lines), pytest.raises(flight.NotFlownError) as over:
            flight.resume(folder)
        return not_flown(over.value)

    field.lose = lambda: True  # it is still switched off
    assert resumed() == 3
    assert (folder / FILE).exists()
    field.lose = lambda: False
    assert resumed() == 0
    assert field.parameter(0, "FENCE_ALT_MAX") == 77.0
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 0
    assert not field.vehicles[0].truth.armed
    assert not (folder / FILE).exists()
    assert not (folder / JOURNAL).exists()


def test_dry_run_that_restored_all_leaves_no_folder(field, tmp_path):
    folder = tmp_path / "flight"
    before = field.parameter(0, "FENCE_ALT_MAX")
    assert dry_run(field, folder) == 0
    assert field.parameter(0, "FENCE_ALT_MAX") == before
    assert [path.name for path in folder.iterdir()] == ["test-picture-1.png"]


def test_resume_without_an_answer_names_the_last_place_of_the_aircraft(field, tmp_path):
    home = GridPoint(0.0, 0.0)
    plan = FlightPlan.make(
        FlightOptions(mission_source="small", urls=(URL,)), field.setting.mission, 0.0
    )
    with Journal.create(tmp_path / JOURNAL, {"plan": plan.as_json()}) as journal:
        journal.append(Connected(1, 1.0, home, home, 0.0, False, True, 25.0))
        journal.append(Airborne(1, 9.0, home=home))
        journal.append(Tracked(1, 30.0, GridPoint(20.0, 10.0), 12.0, 24.0))
    field.lose = lambda: True
    with shown_on(field.lines), pytest.raises(ExceptionGroup, match="unhandled"):
        flight.resume(tmp_path)
    (line,) = [text for text in field.lines if "no contact in this run" in text]
    place = field.setting.grid.position(GridPoint(20.0, 10.0))
    assert f"at 30 s of the mission: vehicle 1 near {place.lat_deg:.6f}, " in line
