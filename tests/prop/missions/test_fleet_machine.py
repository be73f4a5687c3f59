"""A few runs of the state machine of flights; `fleet_machine` itself does thousands."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

from tests.prop.missions.fleet_machine import STEPS, FleetMachine

TestFleetMachine = FleetMachine.TestCase
TestFleetMachine.settings = settings(
    max_examples=8, stateful_step_count=STEPS, deadline=None,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip


def test_vehicle_taking_off_as_its_process_is_killed_lands_again_while_the_team_holds():
    """The resumed mission counted it as landed, and gave it no order."""
    machine = FleetMachine()
    machine.begin(number=246, pads_m=10.0)
    machine.traffic(away_m=691, bearing=245, speed_m_s=1)
    machine.kill_and_resume()
    machine.teardown()


def test_vehicle_taking_off_as_its_process_is_killed_lands_again_if_it_waits_for_a_battery():
    machine = FleetMachine()
    machine.begin(number=0, pads_m=0.0)
    machine.trouble(kind="battery cell", number=0, vehicle=1)
    machine.trouble(kind="battery cell", number=0, vehicle=1)
    machine.kill_and_resume()
    machine.teardown()
