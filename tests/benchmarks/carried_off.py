"""How far one gets that nobody can steer: `python -m tests.benchmarks.carried_off SEED ...`.

Seeds are those of `python -m tests.campaign --world sitl`. Each is flown three times: as it is, and
with an oracle for a guardian, which lands the aircraft in the moment in which the fault begins,
and when it is first 3 m off its way. What is as far with the oracle is physics, and no guardian's
fault. Distances are metres outside of the fence, in truth.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest
from shapely.geometry import Point

from missions.flight.setting import Setting
from missions.guardian.measures import off_path_m, planned
from missions.units import GridPoint
from sitl.vehicle import SimVehicle
from tests.campaign import simulated
from uavmap.aircraft.guardian.guardian import Guardian

OFF_M = 3.0
CANNOT_BE_FLOWN = ("compass", "wind_gust")


@dataclass(slots=True)
class Seen:
    """What came of one flight, of the aircraft that has the fault."""

    vehicle: int
    begins_s: float
    off_s: float | None = None
    acted_s: float | None = None
    left_s: float | None = None
    down_s: float | None = None
    far_m: float = 0.0
    found: Sequence[tuple[str, str]] = field(default_factory=tuple)

    def watch(self, vehicle: SimVehicle, setting: Setting) -> None:
        """Look at it at one instant."""
        truth = vehicle.truth
        out_m = float(setting.fence.outer.distance(Point(setting.grid.fixed(truth.position))))
        self.far_m = max(self.far_m, out_m)
        if out_m > 0.0 and self.left_s is None and not truth.landed:
            self.left_s = truth.t_s
        if truth.landed and self.acted_s is not None and self.down_s is None:
            self.down_s = truth.t_s


def _off_m(guardian: Guardian, begun: list[GridPoint]) -> float:
    """How far it is off its way; a landing goes straight down."""
    seen, task = guardian._seen(), guardian._guard.task
    if seen is None or not seen.airborne:
        return 0.0
    place = planned(task, seen)
    if task.doing == "land":
        begun.append(seen.position)
        return begun[0].distance_to(seen.position)
    path = task.path if place is None else (place,)
    return off_path_m(seen.position, path) if path else 0.0


def _look(
    guardian: Guardian, watched: Seen, begun: list[GridPoint], oracle_s: float | None
) -> None:
    """Whether it is off its way by now, and what the oracle says."""
    now_s = guardian._reporter.now_s()
    if now_s >= watched.begins_s and watched.off_s is None and _off_m(guardian, begun) > OFF_M:
        watched.off_s = now_s
    if oracle_s is not None and now_s >= oracle_s and watched.acted_s is None:
        guardian.take_over("land", "the oracle", hurry=True)


def flown(seed: int, oracle_s: float | None) -> Seen:
    """One flight, with an oracle that lands it at a time, or without."""
    text = simulated.named_text(simulated.plan_of(seed))
    faults = [f for f in tomllib.loads(text)["sim"]["faults"] if f["kind"] in CANNOT_BE_FLOWN]
    watched = Seen(faults[0]["vehicle"], faults[0]["at_s"])

    guardians: list[Guardian] = []
    begun: list[GridPoint] = []
    take_over, run = Guardian.take_over, Guardian.run

    class Witness(simulated.Witness):
        def watch(self, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
            super().watch(vehicles, setting)
            watched.watch(vehicles[watched.vehicle - 1], setting)
            for guardian in guardians:
                _look(guardian, watched, begun, oracle_s)

    def noted(self: Guardian, action: str, reason: str, *, hurry: bool = False) -> None:
        if self in guardians and watched.acted_s is None:
            watched.acted_s = self._reporter.now_s()
        take_over(self, action, reason, hurry=hurry)  # type: ignore[arg-type]

    async def known(self: Guardian) -> None:
        if self._reporter.number == watched.vehicle:
            guardians.append(self)
        await run(self)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(simulated, "Witness", Witness)
        patched.setattr(Guardian, "take_over", noted)
        patched.setattr(Guardian, "run", known)
        watched.found = simulated.fly(seed).found
    return watched


def main(arguments: list[str] | None = None) -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description="How far one gets that nobody can steer.")
    parser.add_argument("seeds", type=int, nargs="+")
    columns = ("seed", "begins", "3 m off", "taken", "left", "down", "far", "oracle", "late oracle")
    print("".join(f"{column:>12s}" for column in columns))
    for seed in parser.parse_args(arguments).seeds:
        ours = flown(seed, None)
        at_once = flown(seed, ours.begins_s)
        late = flown(seed, ours.off_s) if ours.off_s is not None else None
        row = (ours.begins_s, ours.off_s, ours.acted_s, ours.left_s, ours.down_s, ours.far_m,
               at_once.far_m, None if late is None else late.far_m)  # fmt: skip
        cells = "".join(f"{'-':>12s}" if value is None else f"{value:12.1f}" for value in row)
        print(f"{seed:12d}{cells}  {'; '.join(kind for kind, _ in ours.found)}", flush=True)


if __name__ == "__main__":
    main()
