"""A service on each aircraft: members that communicate by a simulated radio, and one map of all."""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from missions.errors import PreflightError
from missions.events import Event
from missions.fleet_events import FactsShared, MemberApart, MemberReport
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.mission.fleet_checks import check_fleet, with_pads_apart
from missions.mission.places import homes
from missions.mission.schema import VehicleSection
from missions.units import Cell, PadHeight
from tests.e2e import rig
from tests.support.fleet_rig import field_text
from tests.support.plans import plan_of
from tests.support.small_missions import joined, mission_text, square, with_small_pictures
from uavmap.fleet.radio import Radios, SealedRadio
from uavmap.fleet.simulated_radio import LinkModel
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.load.mission_source import load
from uavmap.mavlink.vehicle_view import VehicleView
from uavmap.runner import simulated_fleet
from uavmap.runner.one_flight import Flight
from uavmap.runner.operator.company import folded
from uavmap.runner.simulated_fleet import SimulatedFleet, fly_fleet, prefixed_lines

TRUE = [(10.0, 18.0), (34.0, 16.0), (36.0, 28.0), (24.0, 31.0), (12.0, 29.0)]


def fleet_mission(tmp_path: Path, vehicles: int = 3) -> Path:
    text = field_text(vehicles, box=square(0.0, 14.0, 44.0, 20.0), region=TRUE)
    file = tmp_path / "field.toml"
    file.write_text(with_small_pictures(text), encoding="utf-8")
    return file


def summary_of_flight(file: Path, comms: str, out: Path) -> dict[str, Any]:
    summary = rig.fly(file, out, "--comms", comms).complete()
    assert summary["false_positives"] == 0
    assert summary["min_separation_m"] > 3.0
    return summary


def journal(folder: Path) -> tuple[Setting, list[Event]]:
    with Journal.open(folder / JOURNAL) as opened:
        return FlightPlan.read(opened).known_setting(), list(opened.events())


def region(folder: Path) -> frozenset[Cell]:
    setting, events = journal(folder)
    return frozenset(joined(setting.initial_state(), events).belief.roi)


def members(out: Path, count: int = 3) -> Sequence[Path]:
    return [out / f"vehicle-{number}" for number in range(1, count + 1)]


def test_three_members_with_radio_map_a_region_together(tmp_path):
    out = tmp_path / "out"
    summary = summary_of_flight(fleet_mission(tmp_path), "free,loss:0.1,delay:0.1", out)
    regions = [region(folder) for folder in (*members(out), out)]
    assert len(set(regions)) == 1, "the maps differ"
    assert len(regions[0]) == summary["cells_roi"]
    for folder, words in ((out, "several journals"), (members(out)[0], "a simulated fleet")):
        again = rig.uavmap("resume", folder)
        assert again.code == 2
        assert words in again.err
    minutes = (summary["makespan_s"] + 20.0) / 60.0
    for number, sent in summary["bytes_on_air"].items():
        assert sent < 5_000 * minutes, number
    for folder in members(out):
        _, events = journal(folder)
        shared = [event for event in events if isinstance(event, FactsShared)]
        assert {event.vehicle for event in shared} | {int(folder.name[-1])} == {1, 2, 3}
        assert any(isinstance(event, MemberReport) and event.path for event in events)
        assert json.loads((folder / "summary.json").read_text())["completed"]


def test_two_members_without_radio_map_the_whole_region_each(tmp_path):
    """Each keeps to its own air: they lose time, and no cells."""
    out = tmp_path / "out"
    summary_of_flight(fleet_mission(tmp_path, 2), "range:0", out)
    regions = [region(folder) for folder in (*members(out, 2), out)]
    for folder, found in zip(members(out, 2), regions, strict=False):
        _, events = journal(folder)
        assert not any(
            isinstance(event, FactsShared | MemberReport | MemberApart) for event in events
        )
        assert len(found) > 0.9 * len(regions[-1])


def test_invalid_radio_is_refused(tmp_path):
    done = rig.fly(fleet_mission(tmp_path), tmp_path / "out", "--comms", "range:x").done
    assert done.code == 2
    assert "--comms range:x" in done.err


def test_pads_too_near_to_each_other_are_refused(tmp_path):
    file = fleet_mission(tmp_path)
    text = file.read_text()
    near = [place for line in text.splitlines() if (place := line).startswith("home = ")]
    file.write_text(text.replace(near[-1], near[-2]), encoding="utf-8")
    done = rig.fly(file, tmp_path / "out", "--comms", "free").done
    assert done.code == 2
    assert "vehicles[].home" in done.err or "pads" in done.err


class Beset(SimulatedFleet):
    """A fleet whose member 1 dies after 21 s, as a process does.

    It sends no farewell, its queue is lost, and its vehicle gets no more commands. It starts again
    with its journal 2 s later.
    """

    async def fly(self) -> dict[str, Any]:
        async with asyncio.timeout(1_500.0):
            return await super().fly()

    async def live(self, number: int) -> None:
        flight, loop = self.flights[number], asyncio.get_running_loop()
        flight.clock.set(7.0 if number == 3 else 0.0)
        if number != 1:
            await super().live(number)
            return
        sealed, folder = self.radio(flight, number), self.folder(number)
        radios = [sealed.radio]
        with prefixed_lines(number):
            speaking = SealedRadio(Radios(radios), sealed.seal)
            program = asyncio.create_task(flight.fly_member(self.world, speaking))
        await asyncio.wait([program], timeout=21.0 - loop.time())
        clock_s = flight.clock.now_s() - loop.time()
        self.world.open_session(number - 1, lambda frame: None)  # no member receives it any more
        self.air.silence(number)
        radios.clear()  # scheduled calls may still run, without a receiver
        flight._journal.close()
        program.cancel()
        await asyncio.gather(program, return_exceptions=True)
        await asyncio.sleep(2.0)
        opened, mine = Journal.open(folder / JOURNAL), setting_of(self.setting.mission, number)
        state = folded(mine, opened.events())
        again = self.flights[number] = Flight(FlightPlan.read(opened), folder, opened, state)
        again.clock.set(clock_s + loop.time())
        with prefixed_lines(number):
            await again.fly_member(self.world, self.radio(again, number, 2))
        self.air.silence(number)


def test_fleet_continues_when_a_program_dies_and_a_vehicle_falls(folder, monkeypatch):
    """Messages overtake each other, one clock is 7 s ahead, and no member is informed of it."""
    text = field_text(more='[[sim.faults]]\nvehicle = 2\nat_s = 40.9\nkind = "motor"\n')
    model = LinkModel(delay_s=0.1, jitter_s=4.0, doubled=0.3)
    monkeypatch.setattr(simulated_fleet, "link_model", lambda words: model)
    monkeypatch.setattr(simulated_fleet, "SimulatedFleet", Beset)
    summary = fly_fleet(plan_of("field.toml", text, seed=22, comms="free"), folder)
    (down,) = summary["aircraft_down"]
    assert down.startswith("vehicle 2 ")
    assert summary["cells_missed"] == summary["cells_undecided"] == summary["unsearched_m"] == 0
    assert summary["fence_breaches"] == summary["reserve_violations"] == 0
    assert summary["min_separation_m"] > 3.9
    assert min(summary["bytes_on_air"].values()) > 0
    first, _, third = members(folder)
    assert region(first) == region(third)
    for member in (first, third):
        assert rig.events(member, "landed")
        assert not rig.events(member, "crashed")
    assert rig.events(first, "resumed")


def test_pads_without_a_place_lie_far_enough_apart():
    mission = with_pads_apart(load("burn").model_copy(
        update={"vehicles": (VehicleSection(),) * 4}
    ))  # fmt: skip
    check_fleet(mission, "burn")
    grid = Grid.at(mission.home, mission.grid.cell_m)
    east_m = [grid.fixed(place).east_m for place in homes(mission)]
    assert [round(b - a) for a, b in itertools.pairwise(east_m)] == [13, 13, 13]


def test_summary_with_an_aircraft_down_is_not_complete(tmp_path):
    file, out = fleet_mission(tmp_path), tmp_path / "out"
    fault = '[[sim.faults]]\nkind = "motor"\nvehicle = 3\nat_s = 40\nshare = 0.0\n'
    file.write_text(file.read_text("utf-8") + fault, "utf-8")
    done = rig.fly(file, out, "--comms", "free").done
    assert done.code == 4, done.err
    folders = (out, *members(out))
    found = [json.loads((folder / "summary.json").read_text("utf-8")) for folder in folders]
    assert [summary["completed"] for summary in found] == [False] * 4


@pytest.mark.parametrize("second_m", [0.0, -6.0])
def test_pads_with_wrong_heights_keep_a_fleet_on_the_ground(tmp_path, monkeypatch, second_m):
    """Pads 60 m apart on a slope of a tenth, receivers that are good to half a metre."""
    homes_m = [(0.0, 0.0), (60.0, 0.0)]
    text = mission_text(
        square(8.0, 14.0, 40.0, 20.0), square(-20.0, -14.0, 104.0, 84.0), vehicles=2,
        homes=homes_m, capacity_wh=60.0, strategy="swath", regions=[TRUE],
    )  # fmt: skip
    first, one, two = text.split("[[vehicles]]\n")
    text = f"{first}[[vehicles]]\n{one}[[vehicles]]\nhome_height_m = {second_m}\n{two}"
    text = with_small_pictures(text)
    text += "[sim.quirks]\nheight_sigma_m = 0.0\n"
    text += "[sim.terrain]\nslope_percent = 10.0\nrises_toward_deg = 270.0\n"
    monkeypatch.setattr(
        VehicleView, "pad_height", property(lambda view: PadHeight(view.home_amsl_m, 0.5))
    )
    plan = plan_of("field.toml", text, comms="free")
    if second_m == 0.0:
        with pytest.raises(PreflightError, match=r"2 home height: -6.0 m.*home_height_m"):
            fly_fleet(plan, tmp_path)
    else:
        summary = fly_fleet(plan, tmp_path)
        assert summary["completed"]
        assert summary["min_separation_m"] > 4.0
