"""The people beside a flight, and what looks on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from uavmap.runner.before_flight import Preflight
from uavmap.runner.operator.caller import Caller
from uavmap.runner.operator.onlooker import Onlooker


@dataclass(frozen=True, slots=True, kw_only=True)
class Company:
    """The people beside a flight, and what looks on.

    Attributes:
        onlookers: See the flight, and pass on orders to real aircraft.
        preflight: What is examined, asked and set before real aircraft take off; None for a flight
            that is simulated or resumed.
        caller: Interrupts a flight that does not run in the program's main thread.
        ask: Puts a question to the operator, where there is one.
        recall: Whether vehicles in the air are only brought home.
    """

    onlookers: Sequence[Onlooker] = ()
    preflight: Preflight | None = None
    caller: Caller | None = None
    ask: Callable[[str], bool] | None = None
    recall: bool = False
