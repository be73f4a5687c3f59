"""A vehicle whose autopilot reports a low battery does not continue its mission."""

from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, AutopilotText, BatterySwapped, Landed, Tracked
from tests.support.flights import fly, flying
from tests.support.plans import plan_of
from tests.support.running import by
from uavmap.journal.event_log import JournalReader
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S
from uavmap.runner.flight import fly as fly_plan
from uavmap.runner.simulation import Simulation

LOW_MAH = 2500.0
"""Charge below which the autopilot reports it as low, mAh, some 40 s after lift-off."""


def put(vehicle, name, value):
    codec = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    return bytes(vehicle.receive(mav.MAVLink_param_set_message(1, 1, name, value, 9).pack(codec)))


@by(fly)
async def test_low_battery_in_flight_counts_as_empty_and_is_reported(flight, /):
    """A real ArduCopter 4.6.2 with 64 % and 9.9 V was given back in GUIDED 0.4 m over its pad.

    It climbed and continued the search.
    """
    await flying(flight)
    assert flight.seen(Tracked)[-1].remaining_wh > 20.0
    put(flight.vehicle, b"BATT_LOW_TIMER", 0.0)
    put(flight.vehicle, b"BATT_LOW_VOLT", 99.0)
    await flight.until(lambda: flight.session.view.battery_low == "low")
    tracked = await flight.sees(Tracked, len(flight.seen(Tracked)) + 2)
    assert tracked.remaining_wh == 0.0
    assert "its battery is reported as low" in [told.text for told in flight.seen(AutopilotText)]


def test_mission_low_battery_swaps_and_flies_on(tmp_path, monkeypatch):
    open_session = Simulation.open_session

    def warned(self, index, record):
        put(self._vehicles[index], b"BATT_LOW_MAH", LOW_MAH)
        return open_session(self, index, record)

    monkeypatch.setattr(Simulation, "open_session", warned)
    text = (Path(__file__).parents[3] / "data" / "speck.toml").read_text()
    plan = plan_of("speck.toml", text, epoch_utc_s=SIM_EPOCH_UTC_S)
    summary = fly_plan(plan, tmp_path / "out")
    (file,) = (tmp_path / "out").glob("*.jsonl")
    events = list(JournalReader(file).events())
    swaps = [event.t_s for event in events if isinstance(event, BatterySwapped)]
    ups = [event.t_s for event in events if isinstance(event, Airborne)]
    downs = [event.t_s for event in events if isinstance(event, Landed)]
    assert summary["completed"]
    assert len(ups) >= 2
    assert all(
        any(down < swap < up for swap in swaps) for down, up in zip(downs, ups[1:], strict=False)
    )
