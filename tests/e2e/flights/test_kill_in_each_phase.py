"""`uavmap fly --connect` is killed in each phase of a flight, and resumed each time."""

from __future__ import annotations

import signal
import time

import pytest

from missions.orders import FlyTo, Land, Look, Order, Sweep, TakeOff
from tests.e2e import rig
from tests.e2e.journey import Journey
from tests.e2e.preloaded import Process

SPEEDUP = 20.0
POLL_S = 0.01
PHASES: tuple[type[Order], ...] = (TakeOff, Sweep, FlyTo, Look, Land)


def killed_in(phase: type[Order], process: Process, journey: Journey) -> bool:
    """Kill a process in a phase of the flight; return whether its journal ends in that phase."""
    due_s = time.monotonic() + rig.PATIENCE_S

    def there() -> bool:
        vehicle = journey.vehicle()
        return isinstance(vehicle.order, phase) and vehicle.height_m > 1.0

    while not there():
        assert process.poll() is None, f"over before {phase.__name__}: {process.communicate()}"
        assert time.monotonic() < due_s, f"waited in vain for {phase.__name__}"
        time.sleep(POLL_S)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    return there()


@pytest.mark.parametrize(("autopilot", "phases"), [("ardupilot", PHASES), ("px4", (TakeOff, Look))])
def test_flight_killed_in_each_phase_is_resumed_and_completes(autopilot, phases, speck, folder):
    journey = Journey(folder, "speck")
    hit = 0
    with rig.simulator("speck", speedup=SPEEDUP, autopilot=autopilot) as urls:
        arguments = rig.flying(rig.mission("speck"), urls, folder, SPEEDUP)
        for phase in phases:
            with rig.started(*arguments) as process:
                hit += killed_in(phase, process, journey)
            before = rig.bodies(folder)
            arguments = ["resume", folder, "--json"]
        with rig.started(*arguments) as process:
            done = rig.ended(process)
    done.completed()
    assert done.summary["seed"] is None
    assert done.summary["cells_missed"] is None  # the truth of a real flight is unknown
    assert rig.bodies(folder)[: len(before)] == before
    resumed = rig.events(folder, "resumed")
    assert len(resumed) == len(phases)
    assert hit >= len(phases) // 2  # a phase may end while the signal travels
    airborne = [event for event in rig.events(folder, "connected") if event["airborne"]]
    assert len(airborne) >= len(phases) - 1  # it waited in the air, but perhaps for the last one
    assert rig.maps_alike(folder, speck.folder)  # type: ignore[attr-defined]
