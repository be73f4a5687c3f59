"""The people beside a flight: what they want of it, and what looks on for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from missions.flight.setting import Setting
from uavmap.aircraft.process.messages import Asked
from uavmap.runner.operator.interrupts import Caller
from uavmap.runner.operator.onlooker import Onlooker
from uavmap.runner.preflight.plan_figures import plan_lines


@dataclass(frozen=True, slots=True)
class Preflight:
    """What the operator wants of it."""

    yes: bool = False
    """Fly without a question."""
    dry_run: bool = False
    """Do all but arm."""
    keep_fence: bool = False
    """Leave the fence of the autopilot as it is, and do not fly a mission that leaves it."""

    def asked(self, setting: Setting) -> Asked:
        """As it is sent to the aircraft."""
        return Asked(tuple(plan_lines(setting)), self.yes, self.dry_run)


@dataclass(frozen=True, slots=True, kw_only=True)
class Company:
    """The people beside a flight, and what looks on.

    `onlookers` see the flight, and pass on orders to real aircraft. `preflight` is None for a
    flight that is simulated or resumed. `caller` interrupts a flight outside of the main thread.
    `ask` asks the operator, where there is one. With `recall` vehicles in the air are only brought
    home.
    """

    onlookers: Sequence[Onlooker] = ()
    preflight: Preflight | None = None
    caller: Caller | None = None
    ask: Callable[[str], bool] | None = None
    recall: bool = False
