"""Everything that happens, as values: the journal is a list of these.

Positions are in the grid's fixed frame, rounded to a centimetre; times are mission seconds, rounded
to a millisecond. The journal has exactly the input of the service, in the order of the fields.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, fields
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import Field, TypeAdapter
from pydantic_core import PydanticSerializationError

from missions.classes import ClassShare
from missions.errors import EventError
from missions.fleet_events import (
    AirLeased,
    AirRequested,
    FactsShared,
    MemberApart,
    MemberReport,
    OfVehicle,
    PartsAllotted,
)
from missions.traffic import Track
from missions.units import Cell, GridPoint


class Vote(NamedTuple):
    """The vote of one frame on one cell; `share` is the part of it that looks like ROI."""

    cell: Cell
    positive: bool
    share: float


@dataclass(frozen=True, slots=True)
class Connected(OfVehicle):
    """A vehicle answered: at the start, after a resume, or when a lost link is back."""

    home: GridPoint
    position: GridPoint
    height_m: float
    airborne: bool
    ours: bool
    """True if its mode follows our commands."""
    remaining_wh: float
    kind: Literal["connected"] = "connected"
    home_amsl_m: float | None = None
    """Height of home above the sea, m; None if the vehicle has not reported it."""
    mode: Literal["follow", "rtl", "land", "other"] | None = None
    """Activity of its autopilot in the air: follows us, returns, lands, or other."""


@dataclass(frozen=True, slots=True)
class LiftedOff(OfVehicle):
    """The vehicle left the ground with its motors on, by an order or not."""

    kind: Literal["lifted_off"] = "lifted_off"


@dataclass(frozen=True, slots=True)
class Airborne(OfVehicle):
    """A take-off reached its height."""

    kind: Literal["airborne"] = "airborne"
    home: GridPoint | None = None
    """Present home; arming moves it to the vehicle's position."""
    home_amsl_m: float | None = None


@dataclass(frozen=True, slots=True)
class Tracked(OfVehicle):
    """Position and battery of a vehicle, about once a second."""

    position: GridPoint
    height_m: float
    remaining_wh: float
    kind: Literal["tracked"] = "tracked"
    wind_m_s: float | None = None
    """Wind measured in flight, m/s; None if it is unknown."""


@dataclass(frozen=True, slots=True)
class Arrived(OfVehicle):
    """The ordered leg is flown."""

    position: GridPoint
    kind: Literal["arrived"] = "arrived"


@dataclass(frozen=True, slots=True)
class FrameSeen(OfVehicle):
    """A picture was judged: taken over `vantage`, or (None) anywhere."""

    vantage: Cell | None
    votes: tuple[Vote, ...]
    kind: Literal["frame_seen"] = "frame_seen"
    overview: Literal[True] | None = None
    """Taken from search height, where a cell has few pixels."""
    unsure: tuple[Cell, ...] | None = None
    """Cells that resemble nothing that the detector knows; their votes are negative."""
    classes: tuple[ClassShare, ...] | None = None
    """Shares above 0 of its cells by class, from a detector that distinguishes several."""


@dataclass(frozen=True, slots=True)
class FrameWeighed(OfVehicle):
    """Weights of the votes of the last judged picture, 0 to 1 each, in their order.

    It is a recorded picture, whose cells are decided by evidence (`missions.mapping.evidence`).
    """

    weights: tuple[float, ...]
    kind: Literal["weighed"] = "weighed"


@dataclass(frozen=True, slots=True)
class FrameLost(OfVehicle):
    """A requested picture is missing or cannot be read."""

    reason: str
    kind: Literal["frame_lost"] = "frame_lost"


@dataclass(frozen=True, slots=True)
class LookEnded(OfVehicle):
    """All pictures of an observation were taken; some cells may lack votes."""

    kind: Literal["look_ended"] = "look_ended"


@dataclass(frozen=True, slots=True)
class Landed(OfVehicle):
    """A vehicle is on the ground, motors off."""

    remaining_wh: float
    kind: Literal["landed"] = "landed"
    position: GridPoint | None = None
    """Position on the ground; None in old journals, which do not record it."""


@dataclass(frozen=True, slots=True)
class Crashed(OfVehicle):
    """A vehicle is down without a command to land: the crew has to fetch it."""

    position: GridPoint
    reason: str
    kind: Literal["crashed"] = "crashed"


@dataclass(frozen=True, slots=True)
class Guarded(OfVehicle):
    """The guardian of a vehicle has its autopilot return or land, and keeps control until it is
    down."""

    action: Literal["rtl", "land"]
    reason: str
    kind: Literal["guarded"] = "guarded"


@dataclass(frozen=True, slots=True)
class Navigated(OfVehicle):
    """The source of a vehicle's navigation: at changes, and regularly without satellites.

    No rule acts on it: positions of other events are corrected already.
    """

    gnss: Literal["good", "lost", "wrong"]
    sigma_m: float | None = None
    """Standard deviation of its position by its own pictures, m; None if that is unknown."""
    off_m: GridPoint | None = None
    """Error of the position that its autopilot reports, along the grid's axes, m."""
    kind: Literal["navigated"] = "navigated"


@dataclass(frozen=True, slots=True)
class BatterySwapped(OfVehicle):
    """A vehicle on the ground has a fresh battery."""

    remaining_wh: float
    kind: Literal["battery_swapped"] = "battery_swapped"


CAUSE_NOT_REPORTED: Final = "a failsafe; the autopilot has not reported which"
"""Cause of an `Overridden` whose vehicle reports only that a failsafe flies it."""


@dataclass(frozen=True, slots=True)
class Overridden(OfVehicle):
    """The mode changed without our command: a pilot or a failsafe flies the vehicle now."""

    mode: str
    kind: Literal["overridden"] = "overridden"
    cause: str | None = None
    """Cause as the vehicle reports it: "battery failsafe: Battery 1 is low 9.90V"."""


@dataclass(frozen=True, slots=True)
class Released(OfVehicle):
    """The vehicle is back under our control: it is in the mode in which it follows us."""

    position: GridPoint
    height_m: float
    kind: Literal["released"] = "released"


@dataclass(frozen=True, slots=True)
class LinkLost(OfVehicle):
    """No heartbeat arrived for too long."""

    kind: Literal["link_lost"] = "link_lost"


@dataclass(frozen=True, slots=True)
class GivenUp(OfVehicle):
    """A silent vehicle is not waited for any longer; it takes part again when its link is back."""

    reason: str
    kind: Literal["given_up"] = "given_up"


@dataclass(frozen=True, slots=True)
class OrderFailed(OfVehicle):
    """An order failed; the vehicle returns and takes no further part.

    One that is only `behind` its path may continue from its place.
    """

    order: str
    reason: str
    kind: Literal["order_failed"] = "order_failed"
    behind: bool = False


@dataclass(frozen=True, slots=True)
class Recalled:
    """The operator recalls all vehicles."""

    t_s: float
    kind: Literal["recalled"] = "recalled"
    stamp: int | None = None
    """Number of an operator's order to a fleet; None for an order given here."""


@dataclass(frozen=True, slots=True)
class Paused:
    """The operator has all vehicles hold; those that return continue."""

    t_s: float
    kind: Literal["paused"] = "paused"
    stamp: int | None = None


@dataclass(frozen=True, slots=True)
class Continued:
    """The operator continues a paused mission."""

    t_s: float
    kind: Literal["continued"] = "continued"
    stamp: int | None = None


@dataclass(frozen=True, slots=True)
class VehicleRecalled(OfVehicle):
    """The operator recalls one vehicle; it takes no further part until a resume."""

    kind: Literal["vehicle_recalled"] = "vehicle_recalled"
    stamp: int | None = None


@dataclass(frozen=True, slots=True)
class CellSkipped(OfVehicle):
    """The operator skips a cell: the one that a vehicle observed, or was on its way to."""

    cell: Cell
    kind: Literal["cell_skipped"] = "cell_skipped"


@dataclass(frozen=True, slots=True)
class AutopilotText(OfVehicle):
    """A text of a vehicle (STATUSTEXT). No decision depends on it."""

    severity: int
    """MAV_SEVERITY: 0 is an emergency, 7 for debugging."""
    text: str
    kind: Literal["told"] = "told"
    times: int = 1
    """Number of times that it was received since it was last recorded."""
    cause: str | None = None
    """Cause of a failsafe that has already taken control."""


@dataclass(frozen=True, slots=True)
class TrafficSeen:
    """Aircraft of others that vehicles' receivers have reported since the last such event."""

    t_s: float
    tracks: tuple[Track, ...]
    kind: Literal["traffic_seen"] = "traffic_seen"


@dataclass(frozen=True, slots=True)
class Resumed:
    """The operator continues an interrupted mission."""

    t_s: float
    kind: Literal["resumed"] = "resumed"


VehicleEvent = (
    Connected
    | LiftedOff
    | Airborne
    | Tracked
    | Arrived
    | FrameSeen
    | FrameWeighed
    | FrameLost
    | LookEnded
    | Landed
    | Crashed
    | Guarded
    | Navigated
    | BatterySwapped
    | Overridden
    | Released
    | LinkLost
    | GivenUp
    | OrderFailed
    | VehicleRecalled
    | CellSkipped
    | AutopilotText
    | MemberReport
    | FactsShared
    | PartsAllotted
    | MemberApart
    | AirRequested
    | AirLeased
)
Event = VehicleEvent | Recalled | Paused | Continued | TrafficSeen | Resumed
AnyEvent = Annotated[Event, Field(discriminator="kind")]

_ADAPTER: TypeAdapter[Event] = TypeAdapter(AnyEvent)
_MAY_OVERFLOW: Final = re.compile(r"NaN|Infinity|\d[eE]\+?\d{2}|\d{300}")
"""Text in which a number may not be finite."""


def to_json(event: Event) -> str:
    """Return the text of an event in the journal. Raises `EventError` if no journal can hold it."""
    try:
        # a frame without a vantage records that; elsewhere None means that nothing was reported
        if isinstance(event, FrameSeen):
            unsaid = {
                key for key in ("overview", "unsure", "classes") if getattr(event, key) is None
            }
            data, nones = _ADAPTER.dump_json(event, exclude=unsaid), event.vantage is None
        else:
            data, nones = _ADAPTER.dump_json(event, exclude_none=True), False
        text = data.decode()
    except (PydanticSerializationError, UnicodeError) as error:
        raise EventError(f"{event.kind}: no text of an event: {error}") from None
    if data.count(b"null") > nones:  # a NaN and an infinity are written as null
        _refuse_what_json_cannot_hold(event)
    return text


def from_json(text: str) -> Event:
    """Return the event of a text: the inverse of `to_json`. Raises ValueError for any other
    text."""
    event = _ADAPTER.validate_json(text, strict=True)
    if _MAY_OVERFLOW.search(text):
        _refuse_what_json_cannot_hold(event)
    return event


def _refuse_what_json_cannot_hold(event: Event) -> None:
    """Raise `EventError` for a NaN or an infinity."""
    for field in fields(event):
        if not _finite(value := getattr(event, field.name)):
            raise EventError(f"{event.kind}: {field.name} = {value!r} is no finite number")


def _finite(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    return all(map(_finite, value)) if isinstance(value, tuple) else True
