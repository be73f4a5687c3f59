"""Orders of the mission to a vehicle: one at a time, a new one replaces the last.

Points are in the grid's fixed frame; a cell drifts with the ROI.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from missions.geo.trajectory import Trajectory
from missions.units import Cell, GridPoint


@dataclass(frozen=True, slots=True)
class TakeOff:
    """Arm and climb to the vehicle's layer. Ends with `Airborne` or `OrderFailed`."""

    height_m: float
    kind: Literal["take_off"] = "take_off"


@dataclass(frozen=True, slots=True)
class Sweep:
    """Fly a search lane to its end and take frames regularly. Ends with `Arrived`."""

    end: GridPoint
    every_m: float
    height_m: float
    kind: Literal["sweep"] = "sweep"


@dataclass(frozen=True, slots=True)
class FlyTo:
    """Fly the points of a route, then to the cell if one is given; `stop` to rest.

    Ends with `Arrived`.
    """

    route: tuple[GridPoint, ...]
    cell: Cell | None
    stop: bool
    height_m: float
    kind: Literal["fly_to"] = "fly_to"


@dataclass(frozen=True, slots=True)
class FlyPath:
    """Fly a path without stopping, with frames regularly all along. Ends with `Arrived`, at rest.

    The path holds the vehicle's place at each moment of the mission. One that replaces another
    begins in the future, at a state of the older one, without a halt.
    """

    trajectory: Trajectory
    height_m: float
    yaw_deg: float | None
    """True bearing of the nose, degrees; None: the autopilot chooses."""
    every_s: float
    kind: Literal["fly_path"] = "fly_path"


@dataclass(frozen=True, slots=True)
class Look:
    """Observe a cell: hover over it and take at most `frames` frames. Ends with `LookEnded`."""

    cell: Cell
    frames: int
    height_m: float
    kind: Literal["look"] = "look"


@dataclass(frozen=True, slots=True)
class Hold:
    """Hold the position until a new order comes."""

    kind: Literal["hold"] = "hold"


@dataclass(frozen=True, slots=True)
class Land:
    """Land here, over home. Ends with `Landed`."""

    kind: Literal["land"] = "land"


@dataclass(frozen=True, slots=True)
class ReturnToLaunch:
    """Let the autopilot bring the vehicle home: when our own return fails. Ends with `Landed`."""

    kind: Literal["return_to_launch"] = "return_to_launch"


@dataclass(frozen=True, slots=True)
class AwaitBattery:
    """Wait on the ground for a fresh battery and the crew's clearance. Ends with
    `BatterySwapped`."""

    kind: Literal["await_battery"] = "await_battery"


@dataclass(frozen=True, slots=True)
class StandDown:
    """Do nothing more."""

    kind: Literal["stand_down"] = "stand_down"


Order = Annotated[
    TakeOff
    | Sweep
    | FlyTo
    | FlyPath
    | Look
    | Hold
    | Land
    | ReturnToLaunch
    | AwaitBattery
    | StandDown,
    Field(discriminator="kind"),
]
