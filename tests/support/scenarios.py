"""Whole flights by the command, on virtual time, with one fault from outside."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.flight.state import Setting
from sitl.vehicle import SimVehicle
from tests.benchmarks.watched import WatchedFlight, fly_watched, mission_text
from tests.support.sitl_truth import Observer

FORBIDDEN = frozenset({"air", "lie", "unrep", "end", "tb"})
BOTH = ("ardupilot", "px4")
Act = Callable[[SimVehicle], bool]
"""A check of a vehicle ten times a second; it returns True once it has acted."""


@dataclass(slots=True)
class Meddler(Observer):
    """An observer that acts on a vehicle, one act after the other."""

    acts: list[Act] = field(default_factory=list)
    done_s: list[float] = field(default_factory=list)

    def watch(self, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        Observer.watch(self, vehicles, setting)
        if self.acts and self.acts[0](vehicles[0]):
            self.acts.pop(0)
            self.done_s.append(self.t_s)


def scenario(
    autopilot: str,
    *acts: Act,
    mission: str = "speck",
    parameters: Mapping[str, float] = {},
    quirks: Mapping[str, Any] = {},
    faults: Sequence[Mapping[str, Any]] = (),
    seed: int = 1,
    more: Sequence[str] = (),
    change: Callable[[str], str] = lambda text: text,
) -> WatchedFlight:
    def table(name: str, values: Mapping[str, Any]) -> str:
        lines = [
            f"{key} = {str(value).lower() if isinstance(value, bool) else repr(value)}"
            for key, value in values.items()
        ]
        return f"\n[sim.{name}]\n" + "\n".join(lines) + "\n"

    text = change(mission_text(mission, faults))
    text = text.replace("[sim]\n", f'[sim]\nautopilot = "{autopilot}"\n')
    text += table("parameters", parameters) + table("quirks", quirks)
    flight = fly_watched(autopilot, text, seed, *more, observer=Meddler(acts=list(acts)))
    assert not flight.columns & FORBIDDEN, flight.line() + flight.raised + flight.stderr
    return flight


def command(vehicle: SimVehicle, number: int, *p: float) -> None:
    """Send a command of a pilot or a ground station, with immediate effect."""
    filled = (*p, *([0.0] * (7 - len(p))))
    message = mav.MAVLink_command_long_message(1, 1, number, 0, *filled)
    pilot = mav.MAVLink(None, srcSystem=250, srcComponent=190)
    vehicle.receive(message.pack(pilot))


def into(vehicle: SimVehicle, mode: int) -> None:
    if vehicle.spec.autopilot == "px4":
        command(vehicle, mav.MAV_CMD_DO_SET_MODE, 1, mode >> 16 & 0xFF, mode >> 24)
    else:
        command(vehicle, mav.MAV_CMD_DO_SET_MODE, 1, mode)


def set_parameter(vehicle: SimVehicle, name: str, value: float) -> None:
    """Change a parameter in flight, as the owner may."""
    assert vehicle._ap.parameters.set(name, value)


def once(when: Callable[[SimVehicle], bool], do: Callable[[SimVehicle], object]) -> Act:
    """Act at the first moment at which a condition holds."""

    def act(vehicle: SimVehicle) -> bool:
        if not when(vehicle):
            return False
        do(vehicle)
        return True

    return act


def flying(vehicle: SimVehicle, *, height_m: float = 11.0) -> bool:
    return vehicle.truth.height_m > height_m


def after(seconds: float) -> Callable[[SimVehicle], bool]:
    """Return a condition that holds a time after its first check."""
    begun: list[float] = []

    def when(vehicle: SimVehicle) -> bool:
        if not begun:
            begun.append(vehicle.t_s)
        return vehicle.t_s - begun[0] >= seconds

    return when
