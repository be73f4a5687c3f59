"""The operator's orders from the page: the same as the keys, by the same way into the service.

Everything above the service stays above it: the gate for what pilots fly, the guardians, and the
rules by which who is on its way home goes on.
"""

from __future__ import annotations

from typing import Any, Final

from uavmap.runner.operator.caller import Steered

PAUSE: Final = "pause"
GO_ON: Final = "continue"
HOME: Final = "return"
"""Everybody comes home, or the vehicle that is named."""


def carry_out(service: Steered, order: dict[str, Any]) -> str:
    """Do what the page asks; returns the answer in words. Nothing else than the three is done."""
    if not service.flying:
        return "nobody flies now: nothing is ordered"
    match order:
        case {"do": "pause"}:
            done = service.pause()
            return "paused: everybody holds" if done else "it is paused already"
        case {"do": "continue"}:
            return "the mission goes on" if service.go_on() else "it is not paused"
        case {"do": "return", "vehicle": int(number)} if not isinstance(number, bool):
            if number not in service.state.vehicles:
                return f"there is no vehicle {number}"
            if service.recall_vehicle(number):
                return f"vehicle {number} comes home and stays there; the others go on"
            return f"vehicle {number} is called home already"
        case {"do": "return", "vehicle": None}:
            service.recall()
            return "everybody comes home; the mission can be resumed"
    return "that is no order: nothing is done"
