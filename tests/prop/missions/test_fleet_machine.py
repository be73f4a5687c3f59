"""A few runs of the state machine of flights; `fleet_machine` itself does thousands."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

from tests.prop.missions.fleet_machine import STEPS, FleetMachine

TestFleetMachine = FleetMachine.TestCase
TestFleetMachine.settings = settings(
    max_examples=8, stateful_step_count=STEPS, deadline=None,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip
