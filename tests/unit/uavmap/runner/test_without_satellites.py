"""Whole simulated flights with lost or wrong satellites: the detection and the landing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from missions.events import Navigated, Tracked
from missions.flight.state import Setting
from missions.units import GridPoint
from sitl.vehicle import SimVehicle
from tests.support.plans import plan_of
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, SIM_EPOCH_UTC_S
from uavmap.runner.flight import fly
from uavmap.runner.simulation import Truth

WINDY = Path(__file__).parents[3] / "data" / "windy.toml"
FLOW = "optical_flow = true\nodometry_drift = 0.03\n"
SMALLER = {
    "48.0010072": "48.0007000",
    "interval_s = 0.2": "interval_s = 0.3",
}
LOST = '[[sim.faults]]\nkind = "gps"\nat_s = 25\n'


@dataclass(slots=True)
class SatelliteFlight:
    """A flight, and the truth about it."""

    summary: dict[str, Any]
    shown: str
    navigated: list[Navigated]
    tracked: list[Tracked]
    true: list[tuple[float, GridPoint]] = field(default_factory=list)
    modes: set[str] = field(default_factory=set)

    @property
    def pad_m(self) -> float:
        """Return the distance from its home at the end, m."""
        return math.hypot(*self.true[-1][1])

    def off_m(self, t_s: float) -> float:
        """Return the error of the service's position at a time, m."""
        event = min(self.tracked, key=lambda e: abs(e.t_s - t_s))
        _, place = min(self.true, key=lambda entry: abs(entry[0] - event.t_s))
        return event.position.distance_to(place)


@pytest.fixture
def flown(tmp_path, monkeypatch, log_lines):
    """Fly the small box with more keys in its file."""

    def flying(navigation: str, faults: str, sim: str = "") -> SatelliteFlight:
        true: list[tuple[float, GridPoint]] = []
        modes: set[str] = set()
        watch = Truth.watch

        def watching(self: Truth, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
            truth = vehicles[0].truth
            true.append((truth.t_s, setting.grid.fixed(truth.position)))
            modes.add(truth.mode.name)
            watch(self, vehicles, setting)

        monkeypatch.setattr(Truth, "watch", watching)
        text = WINDY.read_text(encoding="utf-8").replace("[sim]\n", f"[sim]\n{sim}")
        for old, new in SMALLER.items():
            assert old in text
            text = text.replace(old, new)
        text += f"\n[navigation]\n{navigation}\n{faults}"
        plan = plan_of("windy.toml", text, None, None, 3, (), None, SIM_EPOCH_UTC_S)
        summary = fly(plan, tmp_path / "out")
        with Journal.open(tmp_path / "out" / JOURNAL) as journal:
            events = list(journal.events())
        return SatelliteFlight(
            summary,
            "\n".join(log_lines),
            [event for event in events if isinstance(event, Navigated)],
            [event for event in events if isinstance(event, Tracked)],
            true,
            modes,
        )

    return flying


def test_satellites_that_are_lost_end_no_flight_led_by_its_map(flown):
    flight = flown('gnss_loss = "map"', LOST, FLOW)
    assert flight.summary["completed"], flight.summary["notes"]
    assert flight.summary["fence_breaches"] == 0
    assert flight.summary["iou_cells"] > 0.6
    assert flight.pad_m < 3.0
    assert "satellite navigation is lost; it continues by its own map" in flight.shown
    known = flight.summary["navigation"]["1"]
    assert known["noticed_s"] == flight.navigated[0].t_s
    assert known["lost_s"] > 20.0
    assert 0.0 < known["sigma_m"] < 2.0
    off_m = [(event.t_s, flight.off_m(event.t_s)) for event in flight.navigated]
    assert max(metres for _, metres in off_m) < 3.0, off_m


def test_mission_that_requires_a_return_without_satellites_returns(flown):
    flight = flown('gnss_loss = "rtl"', LOST, FLOW)
    assert "satellite navigation is lost; it is commanded to return (RTL)" in flight.shown
    assert "RTL" in flight.modes
    assert not flight.summary["completed"]
    assert flight.summary["notes"]["1"].startswith("returning by its guardian: satellite")
    assert flight.summary["navigation"]["1"]["sigma_m"] is None


def test_vehicle_without_flow_is_left_to_its_autopilot(flown):
    flight = flown('gnss_loss = "map"', LOST)
    assert "changed by the pilot or a failsafe" in flight.shown or flight.summary["notes"]
    assert not flight.summary["completed"]
    assert flight.modes >= {"GUIDED", "LAND"}
    assert "RTL" not in flight.modes


def test_satellites_that_drift_are_noticed_before_they_are_off_by_a_cell(flown):
    drift = '[[sim.faults]]\nkind = "gps_drift"\nat_s = 15\nm_s = 0.1\ntoward_deg = 70\n'
    flight = flown('gnss_loss = "map"', drift)
    assert flight.navigated
    assert flight.navigated[0].gnss == "wrong"
    assert flight.off_m(flight.navigated[0].t_s - 0.5) < 5.0
    assert "satellite navigation gives a wrong position" in flight.shown
    assert flight.summary["fence_breaches"] == 0


def test_leap_of_satellites_does_not_lead_it_astray(flown):
    leap = '[[sim.faults]]\nkind = "gps_glitch"\nat_s = 30\nmetres = 15\ntoward_deg = 200\n'
    flight = flown('gnss_loss = "map"', leap)
    assert flight.navigated[0].gnss == "wrong"
    assert flight.navigated[0].t_s < 34.0
    assert flight.pad_m < 3.0
    assert flight.summary["fence_breaches"] == 0


def test_camera_that_repeats_its_picture_is_no_fault_of_satellites(flown, monkeypatch):
    image = SimVehicle.image
    kept: list[bytes] = []

    def repeated(self: SimVehicle, url: str) -> bytes | None:
        picture = image(self, url)
        if picture is not None and len(kept) < 30:
            kept.append(picture)
        return kept[-1]

    monkeypatch.setattr(SimVehicle, "image", repeated)
    flight = flown('gnss_loss = "map"', "")
    assert not flight.navigated
    assert not flight.summary["completed"]
    assert flight.pad_m < 3.0
