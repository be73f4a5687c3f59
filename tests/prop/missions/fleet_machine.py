"""Flights as a state machine: troubles, pilots, operators and kills at any moment, in any order.

    python -m tests.prop.missions.fleet_machine --runs 10000 --seed 1

Each run is a flight of the fleet of points to its end, which the referee judges. A run that breaks
a promise is shrunk to few steps and printed.
"""

from __future__ import annotations

import math
import random
import sys
from dataclasses import replace

from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)

from missions.events import Continued, Paused, TrafficSeen
from missions.traffic import Track
from missions.units import GridPoint
from tests.benchmarks.frame import options_of
from tests.campaign import record, reducer
from tests.campaign.plan import Plan
from tests.fake_fleet import TICK_S, Fleet
from tests.fake_fleet.troubles import ACTS, drawn

MOST_TROUBLES = 3
LIMIT_S = 6000.0
KINDS = tuple(kind for kind in ACTS if kind not in ("none", "recall"))
STEPS = 12


class FleetMachine(RuleBasedStateMachine):
    """A flight whose steps Hypothesis chooses."""

    fleet: Fleet

    @initialize(number=st.integers(0, 10_000), pads_m=st.sampled_from([0.0, 10.0]))
    def begin(self, number: int, pads_m: float) -> None:
        self.fleet = reducer.fleet_of(Plan(number, ("none",), ("search",)), pads_m=pads_m)
        self.rng = random.Random(number)
        self.fleet.start()

    @property
    def flies(self) -> bool:
        return not self.fleet.ended

    def ticks(self, times: int) -> None:
        for _ in range(times):
            if self.flies:
                self.fleet.tick()

    @rule(s=st.integers(1, 30))
    def fly(self, s: int) -> None:
        self.ticks(int(s / TICK_S))

    @precondition(lambda self: self.flies and len(self.fleet.troubles) < MOST_TROUBLES)
    @rule(kind=st.sampled_from(KINDS), vehicle=st.integers(1, 3), number=st.integers(0, 1000))
    def trouble(self, kind: str, vehicle: int, number: int) -> None:
        """Begin a trouble with the next tick; its number draws its duration."""
        vehicle = 1 + vehicle % len(self.fleet.vehicles)
        made = drawn(kind, vehicle, "search", random.Random(number))
        self.fleet.troubles.append(replace(made, begun_s=self.fleet.t_s + TICK_S))
        self.ticks(1)

    @precondition(lambda self: self.flies and not self.fleet.is_without_service)
    @rule()
    def kill_and_resume(self) -> None:
        self.fleet.crash_and_resume()

    @precondition(lambda self: self.flies and not self.fleet.is_without_service)
    @rule(s=st.integers(1, 60))
    def pause(self, s: int) -> None:
        self.fleet.post(Paused(self.fleet.now_s))
        self.ticks(int(s / TICK_S))
        self.fleet.post(Continued(self.fleet.now_s))

    @precondition(lambda self: self.flies and not self.fleet.is_without_service)
    @rule(away_m=st.integers(200, 2000), bearing=st.integers(0, 359), speed_m_s=st.integers(0, 80))
    def traffic(self, away_m: int, bearing: int, speed_m_s: int) -> None:
        sin, cos = math.sin(math.radians(bearing)), math.cos(math.radians(bearing))
        place, velocity = (
            GridPoint(away_m * sin, away_m * cos),
            GridPoint(-speed_m_s * sin, -speed_m_s * cos),
        )
        track = Track("A", "A", self.fleet.now_s, place, 50.0, 0.0, velocity)
        self.fleet.post(TrafficSeen(self.fleet.now_s, (track,)))
        self.ticks(4)

    @precondition(lambda self: self.flies and not self.fleet.is_without_service)
    @rule()
    def recall(self) -> None:
        self.fleet.recall()
        self.ticks(4)

    def teardown(self) -> None:
        if not hasattr(self, "fleet"):
            return
        self.fleet.run(LIMIT_S)
        self.fleet.conclude(twice=True)
        assert self.fleet.faults == [], self.fleet.faults


def main() -> int:
    options = options_of(__doc__, runs=100, seed=1, record=False)
    commit = record.commit_of_program()
    chosen = settings(
        max_examples=options.runs, stateful_step_count=STEPS, deadline=None, database=None,
        suppress_health_check=list(HealthCheck), phases=(Phase.generate, Phase.shrink),
        print_blob=False,
    )  # fmt: skip
    run_state_machine_as_test(seed(options.seed)(FleetMachine), settings=chosen)
    if options.record:
        record.keep(record.Run(commit, "machine", "", options.seed, options.runs, {}, {}, {}, []))
    print(f"{options.runs} runs of {STEPS} steps, seed {options.seed}: nothing forbidden")
    return 0


if __name__ == "__main__":
    sys.exit(main())
